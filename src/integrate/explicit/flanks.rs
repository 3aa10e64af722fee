//! Toothed flanks of silent links in their gaps: a block of ends at a time.

use super::LANES;
use super::ends::{Poses, Seated, Seen};
use crate::elements::arc_lanes::Found;
use crate::elements::end_contact::{EndBody, EndShape};
use crate::elements::flank_lanes::{FlankLanes, Placed};
use crate::elements::tooth_contact::{Mask, any, mask, take};
use crate::geometry::chain::silent::SilentLinkContour;

/// What a block of ends touches with, and the tooth gaps they were in last.
pub(super) struct Flanked {
    flanks: FlankLanes,
    seated: Seated,
}

impl Flanked {
    pub(super) fn new(body: &EndBody, rows: &[SilentLinkContour], at: usize, front: bool) -> Flanked {
        let (outer, seats) = match &body.shape {
            EndShape::OuterFlanks { seats, .. } => (true, Some(seats)),
            EndShape::InnerFlanks { seats, .. } => (false, Some(seats)),
            _ => (true, None),
        };
        Flanked { flanks: FlankLanes::new(rows, at, front, outer), seated: seats.map(Seated::new).unwrap_or_default() }
    }
}

/// Touches of a block. Returns whether there is any.
#[inline(always)]
pub(super) fn touches(seen: &Seen<'_>, own: &Mask, flanked: &mut Flanked, found: &mut Found) -> bool {
    let (tooth, seats, outer) = match &seen.body.shape {
        EndShape::OuterFlanks { tooth, seats } => (tooth, seats, true),
        EndShape::InnerFlanks { tooth, seats } => (tooth, seats, false),
        _ => return false,
    };
    let poses = Poses::of(seen);
    let (jx, jy) = poses.joints(seen);
    let lever = take(&seen.model.chain.lever, seen.at);
    let mut near = [0; LANES];
    for i in 0..LANES {
        let limit = tooth.reach_m(lever[i].abs());
        near[i] = own[i] & !mask(jx[i] * jx[i] + jy[i] * jy[i] > limit * limit);
    }
    if !any(&near) {
        return false;
    }
    flanked.seated.settle(seats, seen.rotor, &near, (&jx, &jy));
    let (axis_x, axis_y) = flanked.seated.axes(seen.rotor);
    let (x, y, cos, sin) = (&poses.x, &poses.y, &poses.cos, &poses.sin);
    let placed = Placed { x, y, cos, sin, axis_x: &axis_x, axis_y: &axis_y };
    // Ahead of a front end for the outer flank, behind it for the inner one.
    let side = usize::from(seen.front == outer);
    let bounds = (&near, seen.far_m);
    found.tooth = flanked.seated.seat;
    if outer {
        flanked.flanks.deepest::<true>(tooth, side, &placed, bounds, found)
    } else {
        flanked.flanks.deepest::<false>(tooth, side, &placed, bounds, found)
    }
}
