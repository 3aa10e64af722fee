//! Outlines as polylines and triangles, for sinks that draw.

use super::frame::{BodyInfo, Frame, Header, Outline, OutlineElement};

/// Largest distance between an arc and its chords in drawings [m].
pub const DRAWING_TOLERANCE_M: f64 = 5e-6;

/// Points along an outline [m], in its own frame; a closed one does not repeat its first point.
pub fn polyline(outline: &Outline) -> Vec<[f64; 2]> {
    let mut points = Vec::new();
    for (i, element) in outline.elements.iter().enumerate() {
        if i == 0 {
            points.push([element.start_x_m, element.start_y_m]);
        }
        push_element(element, &mut points);
    }
    if outline.closed {
        points.pop();
    }
    points
}

fn push_element(e: &OutlineElement, points: &mut Vec<[f64; 2]>) {
    if e.radius_m > 0.0 && e.sweep_rad != 0.0 {
        let start = libm::atan2(e.start_y_m - e.centre_y_m, e.start_x_m - e.centre_x_m);
        let cos = (1.0 - DRAWING_TOLERANCE_M / e.radius_m).clamp(-1.0, 1.0);
        let piece = (2.0 * libm::acos(cos)).max(0.02);
        let pieces = (e.sweep_rad.abs() / piece).ceil().clamp(1.0, 1000.0) as usize;
        for k in 1..pieces {
            let (s, c) = libm::sincos(start + e.sweep_rad * k as f64 / pieces as f64);
            points.push([e.centre_x_m + e.radius_m * c, e.centre_y_m + e.radius_m * s]);
        }
    }
    points.push([e.end_x_m, e.end_y_m]);
}

/// A circle as a closed polyline, fine enough not to look like a polygon next to its contacts.
pub fn circle(x_m: f64, y_m: f64, radius_m: f64) -> Vec<[f64; 2]> {
    let cos = (1.0 - DRAWING_TOLERANCE_M / radius_m.max(DRAWING_TOLERANCE_M)).clamp(-1.0, 1.0);
    let pieces = (std::f64::consts::PI / libm::acos(cos)).ceil().clamp(32.0, 1000.0) as usize;
    (0..pieces)
        .map(|k| {
            let (s, c) = libm::sincos(std::f64::consts::TAU * k as f64 / pieces as f64);
            [x_m + radius_m * c, y_m + radius_m * s]
        })
        .collect()
}

/// A force that is drawn as an arrow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnForce {
    /// Where it acts [m].
    pub point_m: [f64; 2],
    pub force_n: [f64; 2],
    /// Its part along the normal.
    pub normal_n: f64,
    /// Its part by friction.
    pub friction_n: [f64; 2],
}

/// Forces of contacts on links, then those of arms on the tips of sliders.
pub fn drawn_forces(frame: &Frame) -> impl Iterator<Item = DrawnForce> + '_ {
    // The tangent is the normal turned by +90 degrees.
    let drawn = |point_m: [f64; 2], [nx, ny]: [f64; 2], normal_n: f64, along_n: f64| DrawnForce {
        point_m,
        force_n: [normal_n * nx - along_n * ny, normal_n * ny + along_n * nx],
        normal_n,
        friction_n: [-along_n * ny, along_n * nx],
    };
    let (c, t) = (&frame.contacts, &frame.touches);
    let contacts = (0..c.link.len()).map(move |i| {
        let point_m = [c.point_body_x_m[i], c.point_body_y_m[i]];
        drawn(point_m, [c.normal_x[i], c.normal_y[i]], c.normal_force_n[i], c.tangential_force_n[i])
    });
    // Stops have no place.
    let is_tip = move |i: &usize| t.normal_force_n[*i] > 0.0 && [t.normal_x[*i], t.normal_y[*i]] != [0.0; 2];
    let tips = (0..t.normal_force_n.len()).filter(is_tip).map(move |i| {
        let normal = [t.normal_x[i], t.normal_y[i]];
        drawn([t.x_m[i], t.y_m[i]], normal, t.normal_force_n[i], t.tangential_force_n[i])
    });
    contacts.chain(tips)
}

/// Bounding box of all static bodies: (lower, upper) corner [m]; the chain extends beyond it by a few pitches at most.
pub fn scene_bounds(header: &Header) -> ([f64; 2], [f64; 2]) {
    bounds_of(&header.bodies)
}

/// The same of some bodies.
pub fn bounds_of<'a>(bodies: impl IntoIterator<Item = &'a BodyInfo>) -> ([f64; 2], [f64; 2]) {
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for body in bodies {
        let Some(outline) = &body.outline else { continue };
        let (s, c) = libm::sincos(body.angle_rad);
        for [x, y] in polyline(outline) {
            let p = [body.x_m + c * x - s * y, body.y_m + s * x + c * y];
            for k in 0..2 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
    }
    (low, high)
}
