//! Contours at one instant: poses of links and bodies, path data in millimetres of the world, y up.

use crate::recording::frame::{Frame, Header, Outline, OutlineCircle, OutlineElement};
use crate::units::sin_cos;
use std::f64::consts::PI;
use std::fmt::Write;

/// Sweep above which an arc is written as two [rad]: an SVG arc with coinciding ends is not drawn, and just below a
/// full circle its ends determine the centre poorly.
pub const LONGEST_ARC_RAD: f64 = 1.75 * PI;

/// Maximum number of pieces of an arc.
const MAX_PIECES: f64 = 100.0;

/// Distance up to which the start of an element equals the end of the last one [m].
const SAME_POINT_M: f64 = 1e-9;

/// Transformation from body to world: rotation, then translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    pub x_m: f64,
    pub y_m: f64,
    pub angle_rad: f64,
}

impl Pose {
    /// Transforms a point of the body to the world [m].
    pub fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (s, c) = sin_cos(self.angle_rad);
        [self.x_m + c * x - s * y, self.y_m + s * x + c * y]
    }
}

/// Pose of link `i`.
pub fn link_pose(frame: &Frame, i: usize) -> Pose {
    Pose { x_m: frame.links.x_m[i], y_m: frame.links.y_m[i], angle_rad: frame.links.angle_rad[i] }
}

/// Pose of body `k`.
pub fn body_pose(header: &Header, frame: &Frame, k: usize) -> Pose {
    let ([x_m, y_m], angle_rad) = header.bodies[k].pose(frame);
    Pose { x_m, y_m, angle_rad }
}

/// Upper bound of the distance of an outline's points from its origin [m].
pub fn reach_m(outline: &Outline) -> f64 {
    let element = |e: &OutlineElement| {
        // The height of an arc above its chord is its sagitta, at most its diameter.
        let sagitta_m = e.radius_m.max(0.0) * (1.0 - libm::cos(0.5 * e.sweep_rad.abs().min(2.0 * PI)));
        libm::hypot(e.start_x_m, e.start_y_m).max(libm::hypot(e.end_x_m, e.end_y_m)) + sagitta_m
    };
    let circles = outline.circles.iter().map(|c| libm::hypot(c.x_m, c.y_m) + c.radius_m);
    outline.elements.iter().map(element).chain(circles).fold(0.0, f64::max)
}

/// Sweep above which an arc is written in pieces [rad].
///
/// Viewers replace an arc by cubics of up to a quarter turn. Their deviation is 2.7e-4 of the radius and falls with the
/// sixth power of the sweep. Where it would be visible, the pieces are made short enough. In a view 0.05 mm wide, a
/// penetration of 1.89 um was drawn as 2.1 um without this.
pub fn longest_arc_rad(radius_m: f64, units_per_m: f64) -> f64 {
    const QUARTER_TURN_ERROR: f64 = 2.7e-4;
    /// Invisible error [user units].
    const INVISIBLE_ERROR: f64 = 0.025;
    let share = INVISIBLE_ERROR / (QUARTER_TURN_ERROR * radius_m * units_per_m);
    if share >= 1.0 { LONGEST_ARC_RAD } else { 0.5 * PI * libm::cbrt(share.sqrt()) }
}

/// Path data of the contour [mm], rounded to 1e-7 mm: arcs as arcs, at a scale of `units_per_m` user units per metre.
pub fn path_data(outline: &Outline, pose: Pose, units_per_m: f64) -> String {
    let mut d = String::new();
    let mut last: Option<[f64; 2]> = None;
    for e in &outline.elements {
        let (start, end) = ([e.start_x_m, e.start_y_m], [e.end_x_m, e.end_y_m]);
        if last.is_none_or(|l| libm::hypot(l[0] - start[0], l[1] - start[1]) > SAME_POINT_M) {
            let [x, y] = pose.apply(start).map(mm);
            let _infallible = write!(d, "M{x} {y}");
        }
        push_element(&mut d, e, pose, units_per_m);
        last = Some(end);
    }
    if outline.closed && !outline.elements.is_empty() {
        d.push('Z');
    }
    d
}

/// Path data of a whole circle [mm], as [`path_data`].
pub fn circle_data(circle: &OutlineCircle, pose: Pose, units_per_m: f64) -> String {
    let (x_m, y_m) = (circle.x_m + circle.radius_m, circle.y_m);
    let around = OutlineElement {
        start_x_m: x_m,
        start_y_m: y_m,
        end_x_m: x_m,
        end_y_m: y_m,
        centre_x_m: circle.x_m,
        centre_y_m: circle.y_m,
        radius_m: circle.radius_m,
        sweep_rad: 2.0 * PI,
    };
    path_data(&Outline { elements: vec![around], closed: true, ..Outline::default() }, pose, units_per_m)
}

fn push_element(d: &mut String, e: &OutlineElement, pose: Pose, units_per_m: f64) {
    let end = pose.apply([e.end_x_m, e.end_y_m]).map(mm);
    if e.radius_m <= 0.0 || e.sweep_rad == 0.0 {
        let _infallible = write!(d, "L{} {}", end[0], end[1]);
        return;
    }
    let (r, ccw) = (mm(e.radius_m), u8::from(e.sweep_rad > 0.0));
    let pieces = (e.sweep_rad.abs() / longest_arc_rad(e.radius_m, units_per_m)).ceil().clamp(1.0, MAX_PIECES);
    let large = u8::from(e.sweep_rad.abs() / pieces > PI);
    let from = [e.start_x_m - e.centre_x_m, e.start_y_m - e.centre_y_m];
    for k in 1..pieces as usize {
        let (s, c) = sin_cos(e.sweep_rad * k as f64 / pieces);
        let inner = [e.centre_x_m + c * from[0] - s * from[1], e.centre_y_m + s * from[0] + c * from[1]];
        let [x, y] = pose.apply(inner).map(mm);
        let _infallible = write!(d, "A{r} {r} 0 {large} {ccw} {x} {y}");
    }
    let _infallible = write!(d, "A{r} {r} 0 {large} {ccw} {} {}", end[0], end[1]);
}

/// Converts metres to millimetres, rounded to 1e-7 mm.
pub fn mm(v_m: f64) -> f64 {
    // Adding zero turns -0 into 0.
    (v_m * 1e10).round() / 1e7 + 0.0
}
