//! Abutments on rings, lobes and guide faces: a block of ends at a time, from what they faced in the step before.

use super::LANES;
use super::ends::{Clearances, Poses, Query, QueryResult, ToothGaps};
use crate::geometry::smartchain::contour::AbutmentContour;
use crate::geometry::smartchain::ring::{LobedRing, RingContact};
use crate::geometry::{Vec2, perp};
use crate::lanes::{LaneBlock, LaneMask, any, mask};
use crate::pairs::arc_lanes::{
    EndContactLanes, FootLanes, FootPoint, NO_CONTACT_M, PairLanes, PairSearchResult, SupportLanes,
    arcs_with_one_contact,
};
use crate::pairs::contour_body::{EndBody, EndShape, SeatDirections};
use crate::recording::frame::Segment;
use std::sync::Arc;

/// What a block of ends faced last. Changes no bit: see [`crate::pairs::arc_lanes`].
#[derive(Clone, Debug, Default)]
pub(super) struct AbutmentCache {
    feet: FootLanes,
    support: SupportLanes,
    pairs: PairLanes,
    tooth_gaps: ToothGaps,
    /// Arcs of the abutment that touch a lobe in one place only.
    sure: Arc<[bool]>,
    /// Whether the abutment has no hollow.
    convex: bool,
    /// Clearances to a face's plane, or to the highest circle of lobes [m].
    gaps_m: LaneBlock,
    /// Of ends past a face's ends to its corner [m]; whether there are any.
    past_m: LaneBlock,
    beyond: LaneMask,
    /// Elements of lanes that were looked up anew.
    searches: u64,
}

impl AbutmentCache {
    pub(super) fn new(body: &EndBody, abutment: &AbutmentContour) -> AbutmentCache {
        let convex = abutment.arcs().iter().all(|arc| arc.radius_m >= 0.0);
        let EndShape::Lobes { ring, seats, .. } = &body.shape else {
            return AbutmentCache { convex, ..AbutmentCache::default() };
        };
        let (tooth_gaps, sure) = (ToothGaps::new(seats), arcs_with_one_contact(abutment, ring).into());
        AbutmentCache { tooth_gaps, sure, convex, ..AbutmentCache::default() }
    }

    pub(super) fn searches(&self) -> u64 {
        self.searches
    }
}

/// Touches of a block.
#[inline(always)]
pub(super) fn touches(
    query: &Query<'_>,
    abutment: &AbutmentContour,
    cache: &mut AbutmentCache,
    found: &mut EndContactLanes,
) -> QueryResult {
    match &query.body.shape {
        EndShape::Circle { radius_m } => circle(query, abutment, *radius_m, cache, found),
        EndShape::Lobes { ring, seats, turn } => lobes(query, abutment, (ring, seats, *turn), cache, found),
        EndShape::Face { along, length_m } => face(query, abutment, (*along, *length_m), cache, found),
        EndShape::OuterFlanks { .. } | EndShape::InnerFlanks { .. } => QueryResult::Apart(None),
    }
}

/// Perpendiculars from points in the frames of the links onto their contours.
struct FootColumns {
    point_x: LaneBlock,
    point_y: LaneBlock,
    normal_x: LaneBlock,
    normal_y: LaneBlock,
    distance: LaneBlock,
}

impl FootColumns {
    #[inline(always)]
    fn set(&mut self, i: usize, foot: &FootPoint) {
        (self.point_x[i], self.point_y[i]) = (foot.point_x, foot.point_y);
        (self.normal_x[i], self.normal_y[i], self.distance[i]) = (foot.normal_x, foot.normal_y, foot.distance);
    }

    fn zero() -> FootColumns {
        let zero = [0.0; LANES];
        FootColumns { point_x: zero, point_y: zero, normal_x: zero, normal_y: zero, distance: zero }
    }

    /// Of the lanes of `own`; those that have come to face another element are searched for.
    #[inline(always)]
    fn find(
        abutment: &AbutmentContour,
        own: &LaneMask,
        (x, y): (&LaneBlock, &LaneBlock),
        cache: &mut AbutmentCache,
    ) -> FootColumns {
        let mut out = FootColumns::zero();
        let mut outdated = [0; LANES];
        for i in 0..LANES {
            let (foot, faced) = cache.feet.foot(i, x[i], y[i]);
            // Inside of a contour signs do not tell all.
            outdated[i] = own[i] & !mask(faced & (foot.distance > 0.0));
            out.set(i, &foot);
        }
        if any(&outdated) {
            for i in (0..LANES).filter(|i| outdated[*i] != 0) {
                cache.feet.search(i, abutment, Vec2::new(x[i], y[i]));
                cache.searches += 1;
                out.set(i, &cache.feet.foot(i, x[i], y[i]).0);
            }
        }
        out
    }
}

#[inline(always)]
fn circle(
    query: &Query<'_>,
    abutment: &AbutmentContour,
    radius_m: f64,
    cache: &mut AbutmentCache,
    found: &mut EndContactLanes,
) -> QueryResult {
    let (x, y) = query.poses.origin();
    let feet = FootColumns::find(abutment, query.own, (&x, &y), cache);
    let (mut near, mut gaps_m) = ([0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let penetration = radius_m - feet.distance[i];
        gaps_m[i] = 0.0 - penetration;
        near[i] = query.own[i] & mask(penetration > -query.far_m);
        found.penetration[i] = if near[i] != 0 { penetration } else { NO_CONTACT_M };
    }
    cache.gaps_m = gaps_m;
    if !any(&near) {
        return QueryResult::Apart(Some(Clearances::new(query.own, &gaps_m)));
    }
    write_contacts(&query.poses, &feet, found);
    if query.details {
        found.body_radius = [radius_m; LANES];
        found.link_radius = cache.feet.radius;
        found.segment = [f64::from(Segment::Ring as u32); LANES];
    }
    QueryResult::Near
}

/// Points and normals of the links in the world.
#[inline(always)]
fn write_contacts(poses: &Poses<'_>, feet: &FootColumns, found: &mut EndContactLanes) {
    for i in 0..LANES {
        let (px, py) = poses.world(i, feet.point_x[i], feet.point_y[i]);
        let (nx, ny) = poses.world(i, feet.normal_x[i], feet.normal_y[i]);
        (found.point_x[i], found.point_y[i]) = (poses.x[i] + px, poses.y[i] + py);
        (found.normal_x[i], found.normal_y[i]) = (-nx, -ny);
    }
}

#[inline(always)]
fn face(
    query: &Query<'_>,
    abutment: &AbutmentContour,
    (along, length_m): (Vec2, f64),
    cache: &mut AbutmentCache,
    found: &mut EndContactLanes,
) -> QueryResult {
    let (poses, own) = (&query.poses, query.own);
    let up = perp(along);
    let (mut outdated, mut near, mut beyond) = ([0; LANES], [0; LANES], [0; LANES]);
    let (mut gaps_m, mut at) = ([0.0; LANES], [0.0; LANES]);
    for searched in [false, true] {
        for i in 0..LANES {
            // Down into the face, as the link sees it.
            let (dx, dy) = poses.link(i, -up.x, -up.y);
            let ((px, py), faced) = cache.support.point(i, dx, dy);
            outdated[i] = own[i] & !mask(faced);
            let gap = (poses.x[i] * up.x + poses.y[i] * up.y) - (px * dx + py * dy);
            // The face's direction is the one down turned by +90 degrees.
            let x = (poses.x[i] * along.x + poses.y[i] * along.y) + (py * dx - px * dy);
            near[i] = own[i] & !mask(gap > query.far_m);
            let on = near[i] & mask((x >= 0.0) & (x <= length_m));
            beyond[i] = near[i] & !on;
            (gaps_m[i], at[i]) = (gap, x);
            found.penetration[i] = if on != 0 { 0.0 - gap } else { NO_CONTACT_M };
            found.point_x[i] = along.x * x + up.x * gap;
            found.point_y[i] = along.y * x + up.y * gap;
        }
        if searched || !any(&outdated) {
            break;
        }
        for i in (0..LANES).filter(|i| outdated[*i] != 0) {
            let (x, y) = poses.link(i, -up.x, -up.y);
            cache.support.search(i, abutment, Vec2::new(x, y));
            cache.searches += 1;
        }
    }
    if !any(&near) {
        return QueryResult::Apart(Some(Clearances::new(own, &gaps_m)));
    }
    (found.normal_x, found.normal_y) = ([up.x; LANES], [up.y; LANES]);
    if query.details {
        found.body_radius = [f64::INFINITY; LANES];
        for i in 0..LANES {
            let (dx, dy) = poses.link(i, -up.x, -up.y);
            found.link_radius[i] = cache.support.radius(i, dx, dy);
        }
        found.segment = [f64::from(Segment::GuideFace as u32); LANES];
    }
    (cache.gaps_m, cache.beyond) = (gaps_m, beyond);
    if any(&beyond) {
        corners(query, abutment, (along * length_m, &at), cache, found);
    }
    QueryResult::Near
}

/// Lanes past an end of a face: its corner against the contour.
#[inline(always)]
fn corners(
    query: &Query<'_>,
    abutment: &AbutmentContour,
    (last, at): (Vec2, &LaneBlock),
    cache: &mut AbutmentCache,
    found: &mut EndContactLanes,
) {
    let (poses, beyond) = (&query.poses, cache.beyond);
    let (mut x, mut y, mut near) = ([0.0; LANES], [0.0; LANES], [0; LANES]);
    for i in 0..LANES {
        let (cx, cy) = (if at[i] < 0.0 { 0.0 } else { last.x }, if at[i] < 0.0 { 0.0 } else { last.y });
        (x[i], y[i]) = poses.link(i, cx - poses.x[i], cy - poses.y[i]);
    }
    let feet = FootColumns::find(abutment, &beyond, (&x, &y), cache);
    for i in 0..LANES {
        // Corner to corner there is no normal.
        near[i] = beyond[i] & mask((cache.feet.radius[i] != 0.0) & (feet.distance[i] < query.far_m));
    }
    cache.past_m = feet.distance;
    for i in (0..LANES).filter(|i| near[*i] != 0) {
        let (px, py) = poses.world(i, feet.point_x[i], feet.point_y[i]);
        let (nx, ny) = poses.world(i, feet.normal_x[i], feet.normal_y[i]);
        found.penetration[i] = 0.0 - feet.distance[i];
        (found.point_x[i], found.point_y[i]) = (poses.x[i] + px, poses.y[i] + py);
        (found.normal_x[i], found.normal_y[i]) = (-nx, -ny);
        (found.body_radius[i], found.link_radius[i]) = (0.0, cache.feet.radius[i]);
        let end = if at[i] < 0.0 { Segment::GuideLeadIn } else { Segment::GuideLeadOut };
        found.segment[i] = f64::from(end as u32);
    }
}

/// Clearances of a block that [`touches`] found near, though nothing acts on it: to a plane or a circle; past a face's ends to its corner, from
/// which nothing of a convex contour is nearer to the face.
#[inline(always)]
pub(super) fn near_gaps(query: &Query<'_>, cache: &AbutmentCache) -> Clearances {
    let mut out = Clearances::new(query.own, &cache.gaps_m);
    if matches!(query.body.shape, EndShape::Face { .. }) && any(&cache.beyond) {
        for i in (0..LANES).filter(|i| cache.beyond[*i] != 0) {
            out.at_least_m[i] = if cache.convex { cache.past_m[i] } else { 0.0 };
            out.past_end[i] = 1.0;
        }
    }
    out
}

#[inline(always)]
fn lobes(
    query: &Query<'_>,
    abutment: &AbutmentContour,
    (ring, seats, turn): (&LobedRing, &SeatDirections, (f64, f64)),
    cache: &mut AbutmentCache,
    found: &mut EndContactLanes,
) -> QueryResult {
    let poses = &query.poses;
    let (x, y) = poses.origin();
    let feet = FootColumns::find(abutment, query.own, (&x, &y), cache);
    // The highest circle first: most links are beyond it.
    let (mut near, mut over_crest_m) = ([0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        over_crest_m[i] = feet.distance[i] - ring.crest_radius_m;
        near[i] = query.own[i] & !mask(over_crest_m[i] > query.far_m);
    }
    cache.gaps_m = over_crest_m;
    if !any(&near) {
        return QueryResult::Apart(Some(Clearances::new(query.own, &over_crest_m)));
    }
    let (jx, jy) = query.joints();
    cache.tooth_gaps.update_gaps(seats, query.rotor, &near, (&jx, &jy));
    let gap_turn = turned(turn, query.rotor);
    let (mut turn_x, mut turn_y, mut offset_ratio) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        // +y of the gap frame points along the seat.
        let (seat_x, seat_y) = turned(gap_turn, (cache.tooth_gaps.cos[i], cache.tooth_gaps.sin[i]));
        let (gx, gy) = poses.link(i, seat_x, seat_y);
        (turn_x[i], turn_y[i]) = (gy, 0.0 - gx);
        offset_ratio[i] =
            ring.crest_offset_ratio(Vec2::new(feet.point_x[i] - x[i], feet.point_y[i] - y[i]), Vec2::new(gy, 0.0 - gx));
    }
    let (mut contacts, mut outdated) = (FootColumns::zero(), [0; LANES]);
    for i in 0..LANES {
        let (foot, holds) = cache.pairs.contact(i, (x[i], y[i]), (turn_x[i], turn_y[i]), offset_ratio[i]);
        outdated[i] = near[i] & !mask(holds);
        contacts.set(i, &foot);
    }
    if query.details {
        (found.body_radius, found.link_radius) = (cache.pairs.ring_radius, cache.pairs.radius);
        found.segment = [f64::from(Segment::Ring as u32); LANES];
    }
    if any(&outdated) {
        for i in (0..LANES).filter(|i| outdated[*i] != 0) {
            let turn = (turn_x[i], turn_y[i]);
            let (axis, gap_x) = (Vec2::new(x[i], y[i]), Vec2::new(turn.0, turn.1));
            cache.searches += 1;
            match cache.pairs.search(i, (abutment, &cache.sure), ring, axis, gap_x) {
                PairSearchResult::Kept => {
                    contacts.set(i, &cache.pairs.contact(i, (axis.x, axis.y), turn, offset_ratio[i]).0);
                    found.body_radius[i] = cache.pairs.ring_radius[i];
                    found.link_radius[i] = cache.pairs.radius[i];
                }
                PairSearchResult::Alone(contact) => {
                    contacts.set(i, &foot_of(&contact));
                    found.body_radius[i] = contact.ring_radius_m;
                    found.link_radius[i] = contact.abutment_radius_m;
                }
                PairSearchResult::Nothing => near[i] = 0,
            }
        }
    }
    for i in 0..LANES {
        let penetration = -contacts.distance[i];
        near[i] &= mask(penetration > -query.far_m);
        found.penetration[i] = if near[i] != 0 { penetration } else { NO_CONTACT_M };
    }
    if !any(&near) {
        return QueryResult::Apart(Some(Clearances::new(query.own, &over_crest_m)));
    }
    found.tooth = cache.tooth_gaps.seat;
    write_contacts(poses, &contacts, found);
    QueryResult::Near
}

fn foot_of(c: &RingContact) -> FootPoint {
    let (point_x, point_y, normal_x, normal_y) = (c.point.x, c.point.y, c.normal.x, c.normal.y);
    FootPoint { point_x, point_y, normal_x, normal_y, distance: c.gap_m }
}

/// One unit vector turned by the angle of another.
#[inline(always)]
fn turned((c, s): (f64, f64), (x, y): (f64, f64)) -> (f64, f64) {
    (c * x - s * y, s * x + c * y)
}
