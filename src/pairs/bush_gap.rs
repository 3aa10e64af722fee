//! Where a bush meets the tooth gap that it is in, and how deep. Knows no force law.
//!
//! The gap is signed, negative in overlap, and its negative is the penetration. [`gap_contact`] folds the query into one tooth
//! gap by its seat index first, as the time step does; a test compares it on random poses with a search over all elements of
//! the contour.

use crate::geometry::sprocket::Sprocket;
use crate::geometry::{Vec2, cross, perp};
use crate::recording::frame::Segment;
use crate::units::atan2;

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
