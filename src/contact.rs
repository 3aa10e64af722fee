//! Contact detection: who touches whom, where, how deep. Knows no force law.
//!
//! Exact pairs of elements: circle with arc, circle with line, line with line, corner with line or arc. A pair touches
//! where its gap has a local minimum; the gap is signed, negative in overlap, and its negative is the penetration. Every
//! such place is a contact of its own, so a link may have several. A contact is counted for the element whose interior
//! holds the perpendicular foot, or for the convex corner where none does; joints that are C1 are owned by the element that
//! begins there, so that no contact is counted twice.
//!
//! Two ways lead to the same answer and a test compares them on random poses: [`BodyContour`] asks a bounding-volume hierarchy
//! over all elements (parry2d), [`gap_contact`] folds the query into one tooth gap by its seat index first, as the time step
//! does.

use crate::geometry::profile::{Element, Profile};
use crate::geometry::sprocket::Sprocket;
use crate::geometry::{Vec2, cross, perp};
use crate::recording::frame::Segment;
use crate::units::{atan2, wrap_angle};
use parry2d_f64::bounding_volume::Aabb;
use parry2d_f64::math::Vector;
use parry2d_f64::partitioning::{Bvh, BvhBuildStrategy};

/// A place where two contours touch or overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContourTouch {
    /// Element of the body that is touched, or the element that ends in the touched corner.
    pub element: usize,
    /// True: the contact is at the corner after `element`.
    pub corner: bool,
    /// Point of the body's contour.
    pub on_body: Vec2,
    /// Deepest point of the other contour.
    pub on_other: Vec2,
    /// Unit normal out of the body.
    pub normal: Vec2,
    /// Penetration [m], negative where a gap is left.
    pub penetration_m: f64,
}

/// Circle against an element: the touch whose foot lies in the element's interior, if there is one.
///
/// A circle inside a concave arc touches it on the far side from the arc's centre; outside a convex arc on the near side.
pub fn circle_element(centre: Vec2, radius_m: f64, index: usize, element: &Element) -> Option<ContourTouch> {
    let (on_body, normal, distance_m) = match *element {
        Element::Line { start, end } => {
            let along = element.foot_along(centre);
            if !(0.0..1.0).contains(&along) {
                return None;
            }
            let foot = start + (end - start) * along;
            let normal = element.normal(0.0);
            (foot, normal, (centre - foot).dot(&normal))
        }
        Element::Arc { centre: c, radius_m: r, start_rad, sweep_rad } => {
            let d = centre - c;
            let distance = d.norm();
            if distance == 0.0 {
                return None;
            }
            let middle = start_rad + 0.5 * sweep_rad;
            let along = 0.5 + wrap_angle(atan2(d.y, d.x) - middle) / sweep_rad;
            if !(0.0..1.0).contains(&along) {
                return None;
            }
            let outward = d / distance;
            if sweep_rad > 0.0 {
                (c + outward * r, outward, distance - r)
            } else {
                (c + outward * r, -outward, r - distance)
            }
        }
    };
    Some(ContourTouch {
        element: index,
        corner: false,
        on_body,
        on_other: centre - normal * radius_m,
        normal,
        penetration_m: radius_m - distance_m,
    })
}

/// Circle against the corner where `before` ends and `after` begins: a touch when the corner is convex and the circle's
/// centre faces neither element squarely.
pub fn circle_corner(
    centre: Vec2,
    radius_m: f64,
    index: usize,
    before: &Element,
    after: &Element,
) -> Option<ContourTouch> {
    let point = before.end();
    let d = centre - point;
    let (t0, t1) = (before.tangent(1.0), after.tangent(0.0));
    // Convex: the contour turns left. The normal cone of the corner lies ahead of `before` and behind `after`.
    if cross(t0, t1) <= CORNER_KINK || d.dot(&t0) < 0.0 || d.dot(&t1) >= 0.0 {
        return None;
    }
    let distance = d.norm();
    if distance == 0.0 {
        return None;
    }
    let normal = d / distance;
    Some(ContourTouch {
        element: index,
        corner: true,
        on_body: point,
        on_other: centre - normal * radius_m,
        normal,
        penetration_m: radius_m - distance,
    })
}

/// Sine of the smallest kink that counts as a corner: rounding of C1 joints stays far below.
const CORNER_KINK: f64 = 1e-9;

/// Two lines face to face: the two ends of their overlap, each with its own penetration, when they are parallel to within
/// `tolerance_rad`; nothing otherwise (then a corner or an arc touches, which are other pairs).
pub fn line_line(body: &Element, other: &Element, index: usize, tolerance_rad: f64) -> Option<[ContourTouch; 2]> {
    let (Element::Line { start: a0, end: a1 }, Element::Line { start: b0, end: b1 }) = (*body, *other) else {
        return None;
    };
    let t = body.tangent(0.0);
    let normal = body.normal(0.0);
    // Facing contours run in opposite directions.
    if cross(t, -other.tangent(0.0)).abs() > tolerance_rad || t.dot(&other.tangent(0.0)) > 0.0 {
        return None;
    }
    let length = (a1 - a0).dot(&t);
    let (s0, s1) = ((b1 - a0).dot(&t), (b0 - a0).dot(&t));
    let (low, high) = (s0.max(0.0), s1.min(length));
    if low > high {
        return None;
    }
    let at = |s: f64| {
        let on_body = a0 + t * s;
        let share = if s1 > s0 { (s - s0) / (s1 - s0) } else { 0.0 };
        let on_other = b1 + (b0 - b1) * share;
        let penetration_m = (on_body - on_other).dot(&normal);
        ContourTouch { element: index, corner: false, on_body, on_other, normal, penetration_m }
    };
    Some([at(low), at(high)])
}

/// Two arcs, the other one convex: along the line of centres, when the point lies in both arcs.
pub fn arc_element(body: &Element, other: &Element, index: usize) -> Option<ContourTouch> {
    let Element::Arc { centre, radius_m, start_rad, sweep_rad } = *other else { return None };
    if sweep_rad <= 0.0 {
        return None;
    }
    let touch = circle_element(centre, radius_m, index, body)?;
    let d = -touch.normal;
    let along = 0.5 + wrap_angle(atan2(d.y, d.x) - (start_rad + 0.5 * sweep_rad)) / sweep_rad;
    (0.0..1.0).contains(&along).then_some(touch)
}

/// A body's contour with a bounding-volume hierarchy over its elements.
pub struct BodyContour {
    profile: Profile,
    bvh: Bvh,
}

impl BodyContour {
    pub fn new(profile: Profile) -> BodyContour {
        let boxes = profile.elements().iter().enumerate().map(|(i, e)| {
            let (low, high) = e.bounds();
            (i, Aabb::new(Vector::new(low.x, low.y), Vector::new(high.x, high.y)))
        });
        let bvh = Bvh::from_iter(BvhBuildStrategy::Binned, boxes);
        BodyContour { profile, bvh }
    }

    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// Every overlap of a circle with the contour, in the order of elements. `centre` in the body's frame.
    pub fn circle(&self, centre: Vec2, radius_m: f64) -> Vec<ContourTouch> {
        self.near(centre - Vec2::repeat(radius_m), centre + Vec2::repeat(radius_m))
            .into_iter()
            .flat_map(|i| self.circle_touches(centre, radius_m, i))
            .filter(|t| overlaps(t, radius_m))
            .collect()
    }

    /// As [`BodyContour::circle`], looking at every element: the reference.
    pub fn circle_brute_force(&self, centre: Vec2, radius_m: f64) -> Vec<ContourTouch> {
        (0..self.profile.elements().len())
            .flat_map(|i| self.circle_touches(centre, radius_m, i))
            .filter(|t| overlaps(t, radius_m))
            .collect()
    }

    /// Every overlap of another profile's arcs, lines and corners with this contour; `other` given in this body's frame.
    pub fn profile_touches(&self, other: &Profile, parallel_tolerance_rad: f64) -> Vec<ContourTouch> {
        let mut touches = Vec::new();
        let others = other.elements();
        let other_kinks = other.kinks_rad();
        for (k, theirs) in others.iter().enumerate() {
            let (low, high) = theirs.bounds();
            let margin = Vec2::repeat(DEEPEST_OVERLAP_M);
            for i in self.near(low - margin, high + margin) {
                let mine = &self.profile.elements()[i];
                touches.extend(arc_element(mine, theirs, i));
                touches.extend(line_line(mine, theirs, i, parallel_tolerance_rad).into_iter().flatten());
                if other_kinks[k] > CORNER_KINK {
                    touches.extend(corner_element(theirs, &others[(k + 1) % others.len()], i, mine));
                }
                if let Some(after) = self.next_after_corner(i) {
                    touches.extend(their_element_corner(theirs, i, mine, after));
                }
            }
        }
        touches.retain(|t| t.penetration_m > 0.0 && t.penetration_m < DEEPEST_OVERLAP_M);
        touches
    }

    fn near(&self, low: Vec2, high: Vec2) -> Vec<usize> {
        let query = Aabb::new(Vector::new(low.x, low.y), Vector::new(high.x, high.y));
        let mut near: Vec<usize> = self.bvh.intersect_aabb(&query).map(|i| i as usize).collect();
        near.sort_unstable();
        near
    }

    fn next_after_corner(&self, i: usize) -> Option<&Element> {
        let elements = self.profile.elements();
        match elements.get(i + 1) {
            Some(next) => Some(next),
            None if self.profile.is_closed() => elements.first(),
            None => None,
        }
    }

    fn circle_touches(&self, centre: Vec2, radius_m: f64, i: usize) -> impl Iterator<Item = ContourTouch> + use<> {
        let element = &self.profile.elements()[i];
        let face = circle_element(centre, radius_m, i, element);
        let corner = self.next_after_corner(i).and_then(|after| circle_corner(centre, radius_m, i, element, after));
        face.into_iter().chain(corner)
    }
}

/// Whether the contour cuts the circle at this touch: deeper than its diameter the circle lies behind it.
fn overlaps(touch: &ContourTouch, radius_m: f64) -> bool {
    touch.penetration_m > 0.0 && touch.penetration_m < 2.0 * radius_m
}

/// Deepest overlap of two profiles that is looked for [m]: far beyond any that contact forces allow.
const DEEPEST_OVERLAP_M: f64 = 0.2e-3;

/// A convex corner of the other contour inside an element of the body: a circle of radius zero whose normal cone holds the
/// direction into the body.
fn corner_element(before: &Element, after: &Element, index: usize, body: &Element) -> Option<ContourTouch> {
    let touch = circle_element(before.end(), 0.0, index, body)?;
    let inward = -touch.normal;
    let in_cone = inward.dot(&before.tangent(1.0)) >= 0.0 && inward.dot(&after.tangent(0.0)) < 0.0;
    in_cone.then_some(touch)
}

/// An element of the other contour against a convex corner of the body.
fn their_element_corner(theirs: &Element, index: usize, before: &Element, after: &Element) -> Option<ContourTouch> {
    let (t0, t1) = (before.tangent(1.0), after.tangent(0.0));
    if cross(t0, t1) <= CORNER_KINK {
        return None;
    }
    let point = before.end();
    let seen = circle_element(point, 0.0, index, theirs)?;
    let normal = -seen.normal;
    if normal.dot(&t0) < 0.0 || normal.dot(&t1) >= 0.0 {
        return None;
    }
    Some(ContourTouch { corner: true, on_body: point, on_other: seen.on_body, normal, ..seen })
}

/// What a bush meets in a tooth gap, in the sprocket's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GapTouch {
    pub tooth: u32,
    pub segment: Segment,
    pub touch: ContourTouch,
    /// Radius of curvature of the tooth there [m], negative concave, zero at the corner.
    pub body_radius_m: f64,
}

/// Tooth gap whose axis is nearest to the direction of `p`, in the sprocket's frame.
pub fn seat_index(sprocket: &Sprocket, p: Vec2) -> u32 {
    let z = f64::from(sprocket.spec.teeth);
    let k = libm::round(atan2(p.y, p.x) / sprocket.pitch_angle_rad());
    (k - libm::floor(k / z) * z) as u32 % sprocket.spec.teeth
}

/// Nearest element of the tooth gap to a bush at `centre` (sprocket's frame), with its signed penetration. A bush that fits
/// the gap touches it in one place at most: the gap widens outwards and its seat is wider than the bush.
pub fn gap_contact(sprocket: &Sprocket, centre: Vec2, bush_radius_m: f64) -> GapTouch {
    let tooth = seat_index(sprocket, centre);
    let axis = crate::geometry::unit(f64::from(tooth) * sprocket.pitch_angle_rad());
    contact_in_gap(sprocket, (tooth, axis), centre, bush_radius_m)
}

/// As [`gap_contact`], of the gap that the bush is known to be in: its index, and the direction of its axis.
pub fn contact_in_gap(sprocket: &Sprocket, (tooth, axis): (u32, Vec2), centre: Vec2, bush_radius_m: f64) -> GapTouch {
    let shift = sprocket.gap_shift_m(tooth);
    let radial = centre.dot(&axis) - shift.x;
    let lateral = cross(axis, centre) - shift.y;
    let side = if lateral < 0.0 { -1.0 } else { 1.0 };
    let folded = folded_gap_contact(sprocket, Vec2::new(lateral.abs(), radial), bush_radius_m);
    let unfold = |v: Vec2| axis * v.y + perp(axis) * (v.x * side);
    let out = axis * shift.x + perp(axis) * shift.y;
    let segment = match folded.segment {
        Segment::FlankCounterclockwise if side < 0.0 => Segment::FlankClockwise,
        s => s,
    };
    let t = folded.touch;
    GapTouch {
        tooth,
        segment,
        touch: ContourTouch {
            on_body: unfold(t.on_body) + out,
            on_other: unfold(t.on_other) + out,
            normal: unfold(t.normal),
            ..t
        },
        ..folded
    }
}

/// The same in the gap frame folded onto x >= 0 (gap axis = +y). The rules that choose the element are those of the time
/// step's kernel, written out.
fn folded_gap_contact(s: &Sprocket, q: Vec2, bush_radius_m: f64) -> GapTouch {
    let seat_centre = Vec2::new(0.0, s.seat_centre_m);
    let to_end = s.seat_end - seat_centre;
    let from_flank = q - s.flank_centre;
    let (segment, element, centre, radius_m, concave) = if cross(to_end, q - seat_centre) <= 0.0 {
        (Segment::Seat, 2, seat_centre, s.seat_radius_m, true)
    } else if cross(s.tip_corner - s.flank_centre, from_flank) >= 0.0 {
        (Segment::FlankCounterclockwise, 1, s.flank_centre, s.flank_radius_m, false)
    } else if cross(s.tip_corner, q) >= 0.0 {
        (Segment::TipCorner, 0, s.tip_corner, 0.0, false)
    } else {
        (Segment::TipLand, 0, Vec2::zeros(), s.tip_radius_m, false)
    };
    let d = q - centre;
    let distance = d.norm().max(1e-12);
    let outward = d / distance;
    let (normal, penetration_m) = if concave {
        (-outward, distance - (radius_m - bush_radius_m))
    } else {
        (outward, radius_m + bush_radius_m - distance)
    };
    let touch = ContourTouch {
        element,
        corner: segment == Segment::TipCorner,
        on_body: centre + outward * radius_m,
        on_other: q - normal * bush_radius_m,
        normal,
        penetration_m,
    };
    let body_radius_m = if concave { -radius_m } else { radius_m };
    GapTouch { tooth: 0, segment, touch, body_radius_m }
}
