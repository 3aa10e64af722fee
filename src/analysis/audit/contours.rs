//! Where the contours that links touch stand, against those that another recording of the drive declares.
//!
//! Every contact tells a point p of a contour and its normal n there. Against the nearest point q of the declared contour the touched one is off by
//! d = (p - q) . n. A contour that moves as a whole, by t and by a small angle a about the middle of the touched points, has d = (t + a z x p) . n: least
//! squares over the touched points tell both, and what they leave tells whether the form is another. What is known best is how far the contour moved
//! along the mean normal.

use super::findings::{Finding, Judged};
use super::gaps::SprocketFit;
use super::guides::{GuideFit, TouchedPoint};
use super::least_squares::NormalEquations;
use super::measures::{AuditPart, GAP_FORM, GUIDE_HEIGHT, Measure, Measured, RAIL_PLACE, TOUCHED};
use super::{Audit, Estimate};
use crate::geometry::profile::Element;
use crate::geometry::{Vec2, rotated};
use crate::recording::frame::{BodyInfo, BodyKind, Header, Outline, Segment};
use crate::statistics::median;

/// An axis that moves turns the line of its span: a guide counts as higher only from this share of that way on. assumed: its ends lie in the
/// first and last third of their span.
const LEANS: f64 = 0.3;
/// Share of what contours are off that one number for all of them leaves at most, to be told as that.
const LEFT: f64 = 0.25;
/// The same of a rail that moved as a whole: another radius looks much like a large shift along the rail. Measured: shifts of 30 to 140 um and a turn
/// of 0.26 degrees leave 3e-5 to 5e-5; other radii of rails 0.07 to 0.09, and of an arc that links touch alone 1.1e-3.
const LEFT_OF_MOTION: f64 = 5e-4;
/// Spread of the normals' directions across their contour below which they are one direction. assumed: a tenth, six degrees.
const ONE_DIRECTION: f64 = 0.1;
/// A contour that is off its own header's by more bends [m]. Measured: rails that do not bend 1e-13, the blade of `v12-primary` 5e-4.
const BENDS_M: f64 = 5e-6;
/// Share of each column that holds a motion at zero where normals do not tell it.
const RIDGE: f64 = 1e-9;
/// Share of a guide's length that links must touch, for its face to be told by that alone. assumed: half tells how the other half stands.
const TOUCHED_SHARE: f64 = 0.5;

/// How far a contour stands off another, in the frame of the other [m, rad].
#[derive(Clone, Copy, Debug)]
struct ContourMotion {
    shift: Vec2,
    turned_rad: f64,
    /// Mean way along the normals, and the largest one of a point.
    nearer_m: f64,
    largest_m: f64,
    /// Whether it moved as a whole.
    is_whole: bool,
    /// Root mean square of what the contours are off.
    off_m: f64,
    samples: usize,
}

/// The motion that explains how far points, with the normals there, are off a contour.
fn motion_of(touched: &[(Vec2, Vec2)], elements: &[Element]) -> Option<ContourMotion> {
    let n = touched.len() as f64;
    let middle = touched.iter().map(|(point, _)| point).sum::<Vec2>() / n;
    let mut sums = NormalEquations::<3>::default();
    let (mut nearer_m, mut largest_m) = (0.0, 0.0_f64);
    for (point, normal) in touched {
        let (arm, off_m) = (point - middle, off(*point, *normal, elements)?);
        sums.add([normal.x, normal.y, arm.x * normal.y - arm.y * normal.x], off_m);
        nearer_m += off_m / n;
        largest_m = if off_m.abs() > largest_m.abs() { off_m } else { largest_m };
    }
    let solved = sums.solve(RIDGE)?;
    let off_m = (sums.yy / n).sqrt();
    Some(ContourMotion {
        shift: Vec2::new(solved.value[0], solved.value[1]),
        turned_rad: solved.value[2],
        nearer_m,
        largest_m,
        is_whole: solved.residual <= LEFT_OF_MOTION * off_m,
        off_m,
        samples: sums.samples,
    })
}

/// How far a point stands off a contour, along the normal there.
fn off(point: Vec2, normal: Vec2, elements: &[Element]) -> Option<f64> {
    let feet = elements.iter().map(|e| e.closest(point).point);
    let nearest = feet.min_by(|a, b| (a - point).norm().total_cmp(&(b - point).norm()))?;
    Some((point - nearest).dot(&normal))
}

/// A point and a direction that stand in the frame of a body at rest, in the world; and back.
fn to_world(info: &BodyInfo, [x, y]: [f64; 2], is_point: bool) -> Vec2 {
    let turned = rotated(Vec2::new(x, y), info.angle_rad);
    if is_point { turned + Vec2::new(info.x_m, info.y_m) } else { turned }
}

fn to_body(info: &BodyInfo, at: Vec2, is_point: bool) -> Vec2 {
    let at = if is_point { at - Vec2::new(info.x_m, info.y_m) } else { at };
    rotated(at, -info.angle_rad)
}

/// A finding that a contour stands elsewhere than in the other recording.
fn told(
    (part, measure): (AuditPart, &'static Measure),
    (value, samples): (f64, usize),
    header: &Header,
    text: String,
) -> Option<Finding> {
    let estimate = Estimate { value, error: 0.0, samples };
    let m = Measured { part, measure, estimate, declared: None, group: None };
    let mut finding = Judged { reference: 0.0, scatter: 0.0, against: "recording" }.finding(&m, header)?;
    finding.text = format!("{text} (score {:.0})", finding.score);
    Some(finding)
}

fn path_of(header: &Header, body: usize) -> &str {
    header.bodies.get(body).map_or("", |b| b.path.as_str())
}

fn higher(height: f64) -> &'static str {
    if height > 0.0 { "higher" } else { "lower" }
}

/// How far straight guides stand above those of the other recording: over the line that touches both pitch circles of their span, so that a
/// sprocket that was moved to tighten the chain does not count.
pub fn guide_heights(audit: &Audit, (header, good): (&Header, &Header), moved_m: f64) -> Vec<Finding> {
    // Drives of several chains have pitches that the guides do not tell apart.
    if good.chains().len() > 1 {
        return Vec::new();
    }
    let pitch_m = median(good.links.iter().map(|l| l.pitch_m));
    let of = |guide: &GuideFit| {
        let info = header.bodies.get(guide.body)?;
        let other = good.bodies.iter().find(|b| b.path == info.path)?;
        let straight = info.kind == BodyKind::Guide as u32 && !info.moves();
        let by_pose = || pose_height(guide, (header, info), (good, other), (pitch_m, moved_m));
        match guide.face {
            Some(face) => {
                let found = face_height(guide, face, (header, good, other), (pitch_m, moved_m));
                found.or_else(|| if is_short(face, info) { by_pose() } else { None })
            }
            None if !straight => None,
            None => end_height(guide, (header, info), (good, other), (pitch_m, moved_m)).or_else(by_pose),
        }
    };
    audit.guides.iter().filter_map(of).collect()
}

/// Whether links touch a small part of a guide's face alone.
fn is_short(face: [[f64; 2]; 2], info: &BodyInfo) -> bool {
    let touched_m = libm::hypot(face[1][0] - face[0][0], face[1][1] - face[0][1]);
    ends_of(info).is_some_and(|[from_m, to_m]| touched_m < TOUCHED_SHARE * (to_m - from_m))
}

/// Where a straight guide begins and ends along its x-axis [m].
fn ends_of(info: &BodyInfo) -> Option<[f64; 2]> {
    let ends = info.outline.as_ref()?.elements.iter().flat_map(|e| [e.start_x_m, e.end_x_m]);
    let (from_m, to_m) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
    (from_m < to_m).then_some([from_m, to_m])
}

/// The height of a guide whose face links touch.
fn face_height(
    guide: &GuideFit,
    face: [[f64; 2]; 2],
    (header, good, other): (&Header, &Header, &BodyInfo),
    (pitch_m, moved_m): (f64, f64),
) -> Option<Finding> {
    let ends = face.map(|[x, y]| Vec2::new(x, y));
    let middle = 0.5 * (ends[0] + ends[1]);
    let (own_line, line) = (tangent_near(header, middle, pitch_m)?, tangent_near(good, middle, pitch_m)?);
    let towards_chain = to_world(other, [0.0, 1.0], false);
    let height = |p: Vec2| {
        let own = (p - own_line.0).dot(&own_line.1);
        // The face of the other recording is the x-axis of its guide, at the same way along it.
        let origin = Vec2::new(other.x_m, other.y_m);
        let there = p - towards_chain * (p - origin).dot(&towards_chain);
        let theirs = (there - line.0).dot(&line.1);
        (own - theirs) * line.1.dot(&towards_chain).signum()
    };
    let ends = ends.map(height);
    let larger = if ends[0].abs() > ends[1].abs() { 0 } else { 1 };
    // Axes that moved turn the line of the span.
    if ends[larger].abs() < LEANS * moved_m {
        return None;
    }
    // The chain arrives at the start.
    let at = |end: usize| if (end == 0) == guide.forwards { "start" } else { "end" };
    let text = format!(
        "{}: where links touch it near its {}, its face stands {} {} than in the other recording, {} {} near its {}",
        path_of(header, guide.body),
        at(larger),
        GUIDE_HEIGHT.size(ends[larger]),
        higher(ends[larger]),
        GUIDE_HEIGHT.size(ends[1 - larger]),
        higher(ends[1 - larger]),
        at(1 - larger),
    );
    told((AuditPart::Body(guide.body), &GUIDE_HEIGHT), (ends[larger], guide.touched), header, text)
}

/// The height of a guide whose roundings alone links touch: a face that is higher by h moves a point of a rounding, with the normal n there, by h n_y
/// off its place.
fn end_height(
    guide: &GuideFit,
    (header, info): (&Header, &BodyInfo),
    (good, other): (&Header, &BodyInfo),
    (pitch_m, moved_m): (f64, f64),
) -> Option<Finding> {
    let elements = elements(other.outline.as_ref()?);
    let towards_chain = to_world(other, [0.0, 1.0], false);
    let mut sums = NormalEquations::<1>::default();
    for TouchedPoint { point, normal } in &guide.points {
        let (p, n) = (to_world(info, *point, true), to_body(other, to_world(info, *normal, false), false));
        let (own_line, line) = (tangent_near(header, p, pitch_m)?, tangent_near(good, p, pitch_m)?);
        // As high over the line of the other recording as over the own.
        let side = line.1.dot(&towards_chain).signum();
        let moved = ((p - own_line.0).dot(&own_line.1) - (p - line.0).dot(&line.1)) * side;
        let p = to_body(other, p + towards_chain * moved, true);
        sums.add([n.y], off(p, n, &elements)?);
    }
    let height = sums.solve(0.0).filter(|_| sums.samples >= TOUCHED)?;
    let is_shift = height.residual <= LEFT * (sums.yy / sums.samples as f64).sqrt();
    let [height_m] = height.value;
    if !is_shift || height_m.abs() < LEANS * moved_m {
        return None;
    }
    let text = format!(
        "{}: its ends, which alone links touch, stand {} {} than in the other recording",
        path_of(header, guide.body),
        GUIDE_HEIGHT.size(height_m),
        higher(height_m),
    );
    told((AuditPart::Body(guide.body), &GUIDE_HEIGHT), (height_m, sums.samples), header, text)
}

/// The height of a guide that hardly any link touches, as its pose was recorded.
fn pose_height(
    guide: &GuideFit,
    (header, info): (&Header, &BodyInfo),
    (good, other): (&Header, &BodyInfo),
    (pitch_m, moved_m): (f64, f64),
) -> Option<Finding> {
    let height = |header: &Header, info: &BodyInfo, along_m: f64| {
        let p = to_world(info, [along_m, 0.0], true);
        let line = tangent_near(header, p, pitch_m)?;
        let side = line.1.dot(&to_world(info, [0.0, 1.0], false)).signum();
        Some((p - line.0).dot(&line.1) * side)
    };
    let differences = ends_of(info)?.map(|x| Some(height(header, info, x)? - height(good, other, x)?));
    let [Some(start_m), Some(end_m)] = differences else { return None };
    let height_m = if start_m.abs() > end_m.abs() { start_m } else { end_m };
    if height_m.abs() < LEANS * moved_m {
        return None;
    }
    let touched = if guide.points.is_empty() { "no link touches it" } else { "links touch little of it" };
    let text = format!(
        "{}: {touched}; by its pose it stands up to {} {} than in the other recording",
        path_of(header, guide.body),
        GUIDE_HEIGHT.size(height_m),
        higher(height_m),
    );
    told((AuditPart::Body(guide.body), &GUIDE_HEIGHT), (height_m, 1), header, text)
}

/// Where rails stand against those of the other recording, in the frame of what bears them.
pub fn rail_places(audit: &Audit, theirs: &Audit, header: &Header, good: &Header) -> Vec<Finding> {
    audit.guides.iter().filter_map(|guide| rail_place(guide, theirs, header, good)).collect()
}

fn rail_place(guide: &GuideFit, theirs: &Audit, header: &Header, good: &Header) -> Option<Finding> {
    let info = header.bodies.get(guide.body).filter(|b| b.kind == BodyKind::Rail as u32)?;
    let other = good.bodies.iter().find(|b| b.path == info.path)?;
    let elements = elements(other.outline.as_ref()?);
    let motion = |fit: &GuideFit, info: &BodyInfo| {
        let there = |at: [f64; 2], is_point| to_body(other, to_world(info, at, is_point), is_point);
        let touched: Vec<(Vec2, Vec2)> =
            fit.points.iter().map(|p| (there(p.point, true), there(p.normal, false))).collect();
        motion_of(&touched, &elements).filter(|m| m.samples >= TOUCHED)
    };
    let own = motion(guide, info)?;
    let is_same = |g: &&GuideFit| good.bodies.get(g.body).is_some_and(|b| b.path == info.path);
    let before = theirs.guides.iter().find(is_same).and_then(|g| motion(g, other));
    // A blade that bends stands off the contour that its own header declares: then only means are compared.
    let bends = before.filter(|b| b.off_m > BENDS_M);
    let nearer_m = own.nearer_m - bends.map_or(0.0, |b| b.nearer_m);
    let way = |way_m: f64| {
        let word = if way_m > 0.0 { RAIL_PLACE.more } else { RAIL_PLACE.less };
        format!("{} {word}", RAIL_PLACE.size(way_m))
    };
    let (path, than, mean) = (path_of(header, guide.body), "than in the other recording", way(nearer_m));
    let (value, text) = match (bends, own.is_whole) {
        (None, true) => {
            // No sign before a zero.
            let shown = |x: f64| if x.abs() < 5e-4 { 0.0 } else { x };
            let (x_mm, y_mm) = (shown(own.shift.x * 1e3), shown(own.shift.y * 1e3));
            let turned_deg = shown(own.turned_rad / crate::units::DEG);
            let how = format!(
                "where links touch it, it is shifted by ({x_mm:.3}, {y_mm:.3}) mm and turned by {turned_deg:.3} deg in its own frame"
            );
            (nearer_m, format!("{path}: its contour stands {mean} {than}; {how}"))
        }
        (None, false) => {
            let most = way(own.largest_m);
            (
                own.largest_m,
                format!("{path}: its contour has another form: it stands up to {most} {than}, {mean} in the mean"),
            )
        }
        (Some(_), _) => (nearer_m, format!("{path}: its contour, which bends, stands {mean} {than} in the mean")),
    };
    told((AuditPart::Body(guide.body), &RAIL_PLACE), (value, own.samples), header, text)
}

/// The line that touches the pitch circles of two sprockets and lies nearest to a point: a point of it, and its normal.
fn tangent_near(header: &Header, at: Vec2, pitch_m: f64) -> Option<(Vec2, Vec2)> {
    let sprockets: Vec<(Vec2, f64)> = header
        .bodies
        .iter()
        .filter(|b| b.rotor && b.teeth > 0)
        .map(|b| {
            let half = crate::units::sin_cos(std::f64::consts::PI / f64::from(b.teeth)).0;
            (Vec2::new(b.x_m, b.y_m), 0.5 * pitch_m / half)
        })
        .collect();
    let mut lines = Vec::new();
    for (k, (a, radius)) in sprockets.iter().enumerate() {
        for (b, other) in sprockets.iter().skip(k + 1) {
            let between = b - a;
            let distance = between.norm();
            for (own, theirs) in [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)] {
                // n . (b - a) = theirs r_b - own r_a: the normal stands so far from the line of the axes.
                let lean = (theirs * other - own * radius) / distance;
                if lean.abs() >= 1.0 {
                    continue;
                }
                let along = between / distance;
                let normal = along * lean + Vec2::new(-along.y, along.x) * (1.0 - lean * lean).sqrt();
                lines.push((a + normal * (own * radius), normal));
            }
        }
    }
    lines.into_iter().min_by(|a, b| (at - a.0).dot(&a.1).abs().total_cmp(&(at - b.0).dot(&b.1).abs()))
}

/// Where the gaps of sprockets lie off the contours that the other recording declares.
pub fn gap_forms(audit: &Audit, header: &Header, good: &Header) -> Vec<Finding> {
    let of = |(body, fit): (usize, &SprocketFit)| gap_form(body, fit, header, good);
    audit.sprockets.iter().enumerate().filter_map(of).collect()
}

/// How all of what links touch of the gaps lies off, or the part of a gap that is off most.
fn gap_form(body: usize, fit: &SprocketFit, header: &Header, good: &Header) -> Option<Finding> {
    let path = path_of(header, body);
    let other = good.bodies.iter().find(|b| b.path == path)?;
    let elements = elements(other.outline.as_ref()?);
    let mut outwards = NormalEquations::<1>::default();
    let (mut largest_m, mut segment, mut samples) = (0.0_f64, Segment::Seat as u32, 0);
    let (mut least_x, mut most_x) = (f64::INFINITY, f64::NEG_INFINITY);
    for form in fit.forms.iter().filter(|f| f.samples >= 10 * TOUCHED) {
        for ([x, y], [normal_x, normal_y]) in form.places() {
            let off_m = off(Vec2::new(x, y), Vec2::new(normal_x, normal_y), &elements)?;
            // Gap 0 lies on the x-axis of its sprocket.
            outwards.add([normal_x], off_m);
            (least_x, most_x) = (least_x.min(normal_x), most_x.max(normal_x));
            if off_m.abs() > largest_m.abs() {
                (largest_m, segment) = (off_m, form.segment);
            }
        }
        samples = samples.max(form.samples);
    }
    let word = |value: f64| if value > 0.0 { GAP_FORM.more } else { GAP_FORM.less };
    let than = "than the contour that the other recording declares";
    let all = outwards.solve(0.0).filter(|all| {
        let off_m = (outwards.yy / outwards.samples as f64).sqrt();
        all.residual <= LEFT * off_m && least_x > ONE_DIRECTION
    });
    let (name, size) = (Segment::name(segment), GAP_FORM.size(largest_m));
    let (value, text) = match all.map(|all| all.value) {
        Some([out_m]) if most_x - least_x > ONE_DIRECTION => {
            (out_m, format!("{path}: its gaps lie {} {} {than}", GAP_FORM.size(out_m), word(out_m)))
        }
        // Flanks of one slope tell one number: how deep the gaps are, or how their flanks stand.
        Some([out_m]) => {
            let deep = if out_m > 0.0 { "shallower" } else { "deeper" };
            let (lies, out) = (word(largest_m), GAP_FORM.size(out_m));
            let text = format!(
                "{path}: the {name} of its gaps lies {size} {lies} {than}, as it does in gaps that are {out} {deep}"
            );
            (out_m, text)
        }
        None => (largest_m, format!("{path}: the {name} of its gaps lies up to {size} {} {than}", word(largest_m))),
    };
    told((AuditPart::Body(body), &GAP_FORM), (value, samples), header, text)
}

/// A contour of a header, in the geometry's own terms.
fn elements(outline: &Outline) -> Vec<Element> {
    let of = |e: &crate::recording::frame::OutlineElement| {
        let (start, end) = (Vec2::new(e.start_x_m, e.start_y_m), Vec2::new(e.end_x_m, e.end_y_m));
        let centre = Vec2::new(e.centre_x_m, e.centre_y_m);
        if e.radius_m > 0.0 {
            let start_rad = crate::units::atan2(start.y - centre.y, start.x - centre.x);
            Element::Arc { centre, radius_m: e.radius_m, start_rad, sweep_rad: e.sweep_rad }
        } else {
            Element::Line { start, end }
        }
    };
    outline.elements.iter().map(of).collect()
}
