//! Abutments on rings, lobes and guide faces: a block of ends at a time, from what they faced in the step before.

use super::LANES;
use super::ends::{Poses, Seated, Seen};
use crate::elements::arc_lanes::{Feet, FootLanes, Found, NOTHING_M, Pair, PairLanes, SupportLanes, sure_arcs};
use crate::elements::end_contact::{EndBody, EndShape, Seats};
use crate::elements::tooth_contact::{Column, Mask, any, mask};
use crate::geometry::smartchain::contour::Contour;
use crate::geometry::smartchain::ring::LobedRing;
use crate::geometry::{Vec2, perp};
use crate::recording::frame::Segment;
use std::sync::Arc;

/// What a block of ends faced last. Changes no bit: see [`crate::elements::arc_lanes`].
#[derive(Clone, Debug, Default)]
pub(super) struct Faced {
    feet: FootLanes,
    support: SupportLanes,
    pairs: PairLanes,
    seated: Seated,
    /// Arcs of the abutment that touch a lobe in one place only.
    sure: Arc<[bool]>,
}

impl Faced {
    pub(super) fn new(body: &EndBody, abutment: &Contour) -> Faced {
        let EndShape::Lobes { ring, seats, .. } = &body.shape else { return Faced::default() };
        Faced { seated: Seated::new(seats), sure: sure_arcs(abutment, ring).into(), ..Faced::default() }
    }
}

/// Touches of a block. Returns whether there is any.
#[inline(always)]
pub(super) fn touches(seen: &Seen<'_>, abutment: &Contour, own: &Mask, faced: &mut Faced, found: &mut Found) -> bool {
    match &seen.body.shape {
        EndShape::Circle { radius_m } => circle(seen, abutment, *radius_m, own, faced, found),
        EndShape::Lobes { ring, seats, turn } => lobes(seen, abutment, (ring, seats, *turn), own, faced, found),
        EndShape::Face { along, length_m } => face(seen, abutment, *along, *length_m, own, faced, found),
        EndShape::OuterFlanks { .. } | EndShape::InnerFlanks { .. } => false,
    }
}

/// Feet of the perpendiculars from the body's origin; what each lane faces is looked up where it has changed.
#[inline(always)]
fn feet(abutment: &Contour, own: &Mask, (x, y): (&Column, &Column), lanes: &mut FootLanes) -> Feet {
    let (feet, mut strayed) = (lanes.feet(x, y), lanes.strayed(x, y));
    for i in 0..LANES {
        // Inside of a contour signs do not tell all.
        strayed[i] = own[i] & (strayed[i] | !mask(feet.distance[i] > 0.0));
    }
    if !any(&strayed) {
        return feet;
    }
    for i in (0..LANES).filter(|i| strayed[*i] != 0) {
        lanes.search(i, abutment, Vec2::new(x[i], y[i]));
    }
    lanes.feet(x, y)
}

#[inline(always)]
fn circle(
    seen: &Seen<'_>,
    abutment: &Contour,
    radius_m: f64,
    own: &Mask,
    faced: &mut Faced,
    found: &mut Found,
) -> bool {
    let poses = Poses::of(seen);
    let (x, y) = poses.origin();
    let feet = feet(abutment, own, (&x, &y), &mut faced.feet);
    let mut near = [0; LANES];
    for i in 0..LANES {
        let penetration = radius_m - feet.distance[i];
        near[i] = own[i] & mask(penetration > -seen.far_m);
        found.penetration[i] = if near[i] != 0 { penetration } else { NOTHING_M };
    }
    if !any(&near) {
        return false;
    }
    poses.put(&feet, found);
    found.body_radius = [radius_m; LANES];
    true
}

#[inline(always)]
fn face(
    seen: &Seen<'_>,
    abutment: &Contour,
    along: Vec2,
    length_m: f64,
    own: &Mask,
    faced: &mut Faced,
    found: &mut Found,
) -> bool {
    let poses = Poses::of(seen);
    let up = perp(along);
    // Down into the face, as the links see it.
    let (x, y) = poses.link_frame(&[-up.x; LANES], &[-up.y; LANES]);
    let mut strayed = faced.support.strayed(&x, &y);
    for i in 0..LANES {
        strayed[i] &= own[i];
    }
    if any(&strayed) {
        for i in (0..LANES).filter(|i| strayed[*i] != 0) {
            faced.support.search(i, abutment, Vec2::new(x[i], y[i]));
        }
    }
    let (px, py) = faced.support.points(&x, &y);
    let (wx, wy) = poses.world_frame(&px, &py);
    let (mut on, mut beyond, mut at) = ([0; LANES], [0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let height = px[i] * x[i] + py[i] * y[i];
        let penetration = height - (poses.x[i] * up.x + poses.y[i] * up.y);
        let near = own[i] & !mask(penetration < -seen.far_m);
        let (qx, qy) = (poses.x[i] + wx[i], poses.y[i] + wy[i]);
        at[i] = qx * along.x + qy * along.y;
        on[i] = near & mask((at[i] >= 0.0) & (at[i] <= length_m));
        beyond[i] = near & !on[i];
        found.penetration[i] = if on[i] != 0 { penetration } else { NOTHING_M };
        (found.point_x[i], found.point_y[i]) = (qx, qy);
    }
    (found.normal_x, found.normal_y) = ([up.x; LANES], [up.y; LANES]);
    found.body_radius = [f64::INFINITY; LANES];
    found.segment = [f64::from(Segment::GuideFace as u32); LANES];
    if any(&beyond) {
        return corners(seen, abutment, &poses, (along * length_m, &at), &beyond, faced, found) | any(&on);
    }
    any(&on)
}

/// Lanes past an end of a face: its corner against the contour.
#[inline(always)]
fn corners(
    seen: &Seen<'_>,
    abutment: &Contour,
    poses: &Poses,
    (last, at): (Vec2, &Column),
    beyond: &Mask,
    faced: &mut Faced,
    found: &mut Found,
) -> bool {
    let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let (cx, cy) = (if at[i] < 0.0 { 0.0 } else { last.x }, if at[i] < 0.0 { 0.0 } else { last.y });
        (x[i], y[i]) = (cx - poses.x[i], cy - poses.y[i]);
    }
    let (x, y) = poses.link_frame(&x, &y);
    let feet = feet(abutment, beyond, (&x, &y), &mut faced.feet);
    let mut near = [0; LANES];
    for i in 0..LANES {
        // Corner to corner there is no normal.
        near[i] = beyond[i] & mask((faced.feet.radius[i] != 0.0) & (feet.distance[i] < seen.far_m));
    }
    if !any(&near) {
        return false;
    }
    let mut placed = Found::nothing();
    poses.put(&feet, &mut placed);
    for i in (0..LANES).filter(|i| near[*i] != 0) {
        found.penetration[i] = 0.0 - feet.distance[i];
        (found.point_x[i], found.point_y[i]) = (placed.point_x[i], placed.point_y[i]);
        (found.normal_x[i], found.normal_y[i]) = (placed.normal_x[i], placed.normal_y[i]);
        found.body_radius[i] = 0.0;
        let end = if at[i] < 0.0 { Segment::GuideLeadIn } else { Segment::GuideLeadOut };
        found.segment[i] = f64::from(end as u32);
    }
    true
}

#[inline(always)]
fn lobes(
    seen: &Seen<'_>,
    abutment: &Contour,
    (ring, seats, turn): (&LobedRing, &Seats, (f64, f64)),
    own: &Mask,
    faced: &mut Faced,
    found: &mut Found,
) -> bool {
    let poses = Poses::of(seen);
    let (x, y) = poses.origin();
    let feet = feet(abutment, own, (&x, &y), &mut faced.feet);
    // The highest circle first: most links are beyond it.
    let mut near = [0; LANES];
    for i in 0..LANES {
        near[i] = own[i] & !mask(ring.crest_radius_m - feet.distance[i] < -seen.far_m);
    }
    if !any(&near) {
        return false;
    }
    let (jx, jy) = poses.joints(seen);
    faced.seated.settle(seats, seen.rotor, &near, (&jx, &jy));
    let (turn_x, turn_y) = turns(&poses, turn, faced.seated.axes(seen.rotor));
    let mut lean = [0.0; LANES];
    for i in 0..LANES {
        let at = Vec2::new(feet.point_x[i] - x[i], feet.point_y[i] - y[i]);
        lean[i] = ring.lean(at, Vec2::new(turn_x[i], turn_y[i]));
    }
    let (mut contacts, mut strayed) = faced.pairs.contacts([&x, &y], [&turn_x, &turn_y], &lean);
    found.body_radius = faced.pairs.ring_radius;
    for i in 0..LANES {
        strayed[i] &= near[i];
    }
    if any(&strayed) {
        let mut alone = [None; LANES];
        for i in (0..LANES).filter(|i| strayed[*i] != 0) {
            let (axis, turn) = (Vec2::new(x[i], y[i]), Vec2::new(turn_x[i], turn_y[i]));
            match faced.pairs.search(i, (abutment, &faced.sure), ring, axis, turn) {
                Pair::Kept => {}
                Pair::Alone(contact) => alone[i] = Some(contact),
                Pair::Nothing => near[i] = 0,
            }
        }
        contacts = faced.pairs.contacts([&x, &y], [&turn_x, &turn_y], &lean).0;
        found.body_radius = faced.pairs.ring_radius;
        for (i, c) in alone.iter().enumerate() {
            let Some(c) = c else { continue };
            found.body_radius[i] = c.ring_radius_m;
            (contacts.point_x[i], contacts.point_y[i]) = (c.point.x, c.point.y);
            (contacts.normal_x[i], contacts.normal_y[i], contacts.distance[i]) = (c.normal.x, c.normal.y, c.gap_m);
        }
    }
    for i in 0..LANES {
        let penetration = -contacts.distance[i];
        near[i] &= mask(penetration > -seen.far_m);
        found.penetration[i] = if near[i] != 0 { penetration } else { NOTHING_M };
    }
    if !any(&near) {
        return false;
    }
    found.tooth = faced.seated.seat;
    poses.put(&contacts, found);
    true
}

/// Directions of the gap frames' +x in the frames of the links. `(gx, gy)`: of the gaps' axes in the world.
#[inline(always)]
fn turns(poses: &Poses, (c, s): (f64, f64), (gx, gy): (Column, Column)) -> (Column, Column) {
    let (mut ax, mut ay) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        (ax[i], ay[i]) = (c * gx[i] - s * gy[i], s * gx[i] + c * gy[i]);
    }
    // +y of the gap frame points along the seat.
    let (x, y) = poses.link_frame(&ax, &ay);
    (y, x.map(|x| 0.0 - x))
}
