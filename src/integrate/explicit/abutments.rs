//! Abutments on rings, lobes and guide faces: a block of ends at a time, from what they faced in the step before.

use super::LANES;
use super::ends::{Answer, GapCache, Gaps, Poses, Query};
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
pub(super) struct AbutmentCache {
    feet: FootLanes,
    support: SupportLanes,
    pairs: PairLanes,
    gaps: GapCache,
    /// Arcs of the abutment that touch a lobe in one place only.
    sure: Arc<[bool]>,
    /// Whether the abutment has no hollow.
    convex: bool,
    /// Elements of lanes that were looked up anew.
    searches: u64,
}

impl AbutmentCache {
    pub(super) fn new(body: &EndBody, abutment: &Contour) -> AbutmentCache {
        let convex = abutment.arcs().iter().all(|arc| arc.radius_m >= 0.0);
        let EndShape::Lobes { ring, seats, .. } = &body.shape else {
            return AbutmentCache { convex, ..AbutmentCache::default() };
        };
        let (gaps, sure) = (GapCache::new(seats), sure_arcs(abutment, ring).into());
        AbutmentCache { gaps, sure, convex, ..AbutmentCache::default() }
    }

    pub(super) fn searches(&self) -> u64 {
        self.searches
    }
}

/// Touches of a block.
#[inline(always)]
pub(super) fn touches(query: &Query<'_>, abutment: &Contour, cache: &mut AbutmentCache, found: &mut Found) -> Answer {
    match &query.body.shape {
        EndShape::Circle { radius_m } => circle(query, abutment, *radius_m, cache, found),
        EndShape::Lobes { ring, seats, turn } => lobes(query, abutment, (ring, seats, *turn), cache, found),
        EndShape::Face { along, length_m } => face(query, abutment, *along, *length_m, cache, found),
        EndShape::OuterFlanks { .. } | EndShape::InnerFlanks { .. } => Answer { near: false, gaps: None },
    }
}

/// Feet of the perpendiculars from these points; what each lane faces is looked up where it has changed.
#[inline(always)]
fn feet(abutment: &Contour, own: &Mask, (x, y): (&Column, &Column), cache: &mut AbutmentCache) -> Feet {
    let lanes = &mut cache.feet;
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
        cache.searches += 1;
    }
    lanes.feet(x, y)
}

#[inline(always)]
fn circle(
    query: &Query<'_>,
    abutment: &Contour,
    radius_m: f64,
    cache: &mut AbutmentCache,
    found: &mut Found,
) -> Answer {
    let (x, y) = query.poses.origin();
    let feet = feet(abutment, query.own, (&x, &y), cache);
    let (mut near, mut gaps_m) = ([0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let penetration = radius_m - feet.distance[i];
        near[i] = query.own[i] & mask(penetration > -query.far_m);
        gaps_m[i] = 0.0 - penetration;
        found.penetration[i] = if near[i] != 0 { penetration } else { NOTHING_M };
    }
    let answer = Answer { near: any(&near), gaps: Some(Gaps::of(query.own, &gaps_m)) };
    if answer.near {
        query.poses.put(&feet, found);
        found.body_radius = [radius_m; LANES];
        found.tooth = [0.0; LANES];
        found.segment = [f64::from(Segment::Ring as u32); LANES];
    }
    answer
}

#[inline(always)]
fn face(
    query: &Query<'_>,
    abutment: &Contour,
    along: Vec2,
    length_m: f64,
    cache: &mut AbutmentCache,
    found: &mut Found,
) -> Answer {
    let (poses, own) = (&query.poses, query.own);
    let up = perp(along);
    // Down into the face, as the links see it.
    let (x, y) = poses.link_frame(&[-up.x; LANES], &[-up.y; LANES]);
    let mut strayed = cache.support.strayed(&x, &y);
    for i in 0..LANES {
        strayed[i] &= own[i];
    }
    if any(&strayed) {
        for i in (0..LANES).filter(|i| strayed[*i] != 0) {
            cache.support.search(i, abutment, Vec2::new(x[i], y[i]));
            cache.searches += 1;
        }
    }
    let (px, py) = cache.support.points(&x, &y);
    let (mut gaps_m, mut near) = ([0.0; LANES], [0; LANES]);
    for i in 0..LANES {
        let height = px[i] * x[i] + py[i] * y[i];
        gaps_m[i] = (poses.x[i] * up.x + poses.y[i] * up.y) - height;
        near[i] = own[i] & !mask(gaps_m[i] > query.far_m);
    }
    let mut answer = Answer { near: any(&near), gaps: Some(Gaps::of(own, &gaps_m)) };
    if !answer.near {
        return answer;
    }
    let (wx, wy) = poses.world_frame(&px, &py);
    let (mut on, mut beyond, mut at) = ([0; LANES], [0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let (qx, qy) = (poses.x[i] + wx[i], poses.y[i] + wy[i]);
        at[i] = qx * along.x + qy * along.y;
        on[i] = near[i] & mask((at[i] >= 0.0) & (at[i] <= length_m));
        beyond[i] = near[i] & !on[i];
        found.penetration[i] = if on[i] != 0 { 0.0 - gaps_m[i] } else { NOTHING_M };
        (found.point_x[i], found.point_y[i]) = (qx, qy);
    }
    (found.normal_x, found.normal_y) = ([up.x; LANES], [up.y; LANES]);
    found.body_radius = [f64::INFINITY; LANES];
    found.tooth = [0.0; LANES];
    found.segment = [f64::from(Segment::GuideFace as u32); LANES];
    if any(&beyond) {
        let (touches, past_m) = corners(query, abutment, (along * length_m, &at), &beyond, cache, found);
        answer.near = touches | any(&on);
        if let Some(gaps) = &mut answer.gaps {
            for i in 0..LANES {
                gaps.at_least_m[i] = if beyond[i] != 0 { past_m[i] } else { gaps.at_least_m[i] };
                gaps.past_end[i] = if beyond[i] != 0 { 1.0 } else { 0.0 };
            }
        }
    }
    answer
}

/// Lanes past an end of a face: its corner against the contour. Whether any is near, and how far they are at least: of a convex
/// contour that rests on the face's plane past its end, nothing is nearer to the face than to its corner.
#[inline(always)]
fn corners(
    query: &Query<'_>,
    abutment: &Contour,
    (last, at): (Vec2, &Column),
    beyond: &Mask,
    cache: &mut AbutmentCache,
    found: &mut Found,
) -> (bool, Column) {
    let poses = &query.poses;
    let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let (cx, cy) = (if at[i] < 0.0 { 0.0 } else { last.x }, if at[i] < 0.0 { 0.0 } else { last.y });
        (x[i], y[i]) = (cx - poses.x[i], cy - poses.y[i]);
    }
    let (x, y) = poses.link_frame(&x, &y);
    let feet = feet(abutment, beyond, (&x, &y), cache);
    let mut near = [0; LANES];
    for i in 0..LANES {
        // Corner to corner there is no normal.
        near[i] = beyond[i] & mask((cache.feet.radius[i] != 0.0) & (feet.distance[i] < query.far_m));
    }
    let past_m = if cache.convex { feet.distance } else { [0.0; LANES] };
    if !any(&near) {
        return (false, past_m);
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
    (true, past_m)
}

#[inline(always)]
fn lobes(
    query: &Query<'_>,
    abutment: &Contour,
    (ring, seats, turn): (&LobedRing, &Seats, (f64, f64)),
    cache: &mut AbutmentCache,
    found: &mut Found,
) -> Answer {
    let poses = &query.poses;
    let (x, y) = poses.origin();
    let feet = feet(abutment, query.own, (&x, &y), cache);
    // The highest circle first: most links are beyond it.
    let (mut near, mut gaps_m) = ([0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        gaps_m[i] = feet.distance[i] - ring.crest_radius_m;
        near[i] = query.own[i] & !mask(gaps_m[i] > query.far_m);
    }
    // Between lobes it is not known how fast a gap closes.
    let gaps = Some(Gaps::of(query.own, &gaps_m));
    if !any(&near) {
        return Answer { near: false, gaps };
    }
    let (jx, jy) = query.joints();
    cache.gaps.settle(seats, query.rotor, &near, (&jx, &jy));
    let (turn_x, turn_y) = turns(poses, turn, cache.gaps.axes(query.rotor));
    let mut lean = [0.0; LANES];
    for i in 0..LANES {
        let at = Vec2::new(feet.point_x[i] - x[i], feet.point_y[i] - y[i]);
        lean[i] = ring.lean(at, Vec2::new(turn_x[i], turn_y[i]));
    }
    let (mut contacts, mut strayed) = cache.pairs.contacts([&x, &y], [&turn_x, &turn_y], &lean);
    found.body_radius = cache.pairs.ring_radius;
    for i in 0..LANES {
        strayed[i] &= near[i];
    }
    if any(&strayed) {
        let mut alone = [None; LANES];
        for i in (0..LANES).filter(|i| strayed[*i] != 0) {
            let (axis, turn) = (Vec2::new(x[i], y[i]), Vec2::new(turn_x[i], turn_y[i]));
            cache.searches += 1;
            match cache.pairs.search(i, (abutment, &cache.sure), ring, axis, turn) {
                Pair::Kept => {}
                Pair::Alone(contact) => alone[i] = Some(contact),
                Pair::Nothing => near[i] = 0,
            }
        }
        contacts = cache.pairs.contacts([&x, &y], [&turn_x, &turn_y], &lean).0;
        found.body_radius = cache.pairs.ring_radius;
        for (i, c) in alone.iter().enumerate() {
            let Some(c) = c else { continue };
            found.body_radius[i] = c.ring_radius_m;
            (contacts.point_x[i], contacts.point_y[i]) = (c.point.x, c.point.y);
            (contacts.normal_x[i], contacts.normal_y[i], contacts.distance[i]) = (c.normal.x, c.normal.y, c.gap_m);
        }
    }
    for i in 0..LANES {
        let penetration = -contacts.distance[i];
        near[i] &= mask(penetration > -query.far_m);
        found.penetration[i] = if near[i] != 0 { penetration } else { NOTHING_M };
    }
    let answer = Answer { near: any(&near), gaps };
    if answer.near {
        found.tooth = cache.gaps.seat;
        found.segment = [f64::from(Segment::Ring as u32); LANES];
        poses.put(&contacts, found);
    }
    answer
}

/// Directions of the gap frames' +x in the frames of the links. `(gx, gy)`: of the gaps' axes in the world.
#[inline(always)]
fn turns(poses: &Poses<'_>, (c, s): (f64, f64), (gx, gy): (Column, Column)) -> (Column, Column) {
    let (mut ax, mut ay) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        (ax[i], ay[i]) = (c * gx[i] - s * gy[i], s * gx[i] + c * gy[i]);
    }
    // +y of the gap frame points along the seat.
    let (x, y) = poses.link_frame(&ax, &ay);
    (y, x.map(|x| 0.0 - x))
}
