//! Toothed flanks of silent links in their gaps: a block of ends at a time.

use super::LANES;
use super::ends::{Clearances, Query, QueryResult, ToothGaps};
use crate::geometry::Vec2;
use crate::geometry::chain::silent::SilentLinkContour;
use crate::lanes::{LaneBlock, any, mask, take};
use crate::pairs::arc_lanes::EndContactLanes;
use crate::pairs::contour_body::{EndBody, EndShape, SeatDirections};
use crate::pairs::flank_lanes::{FlankLanes, LinksInBodyFrame};

/// What a block of ends touches with, and the tooth gaps they were in last.
#[derive(Clone)]
pub(super) struct FlankCache {
    flanks: FlankLanes,
    tooth_gaps: ToothGaps,
    /// Distance of a joint from the axis beyond which its link touches no tooth [m], and its square.
    limit: LaneBlock,
    limit_squared: LaneBlock,
}

impl FlankCache {
    /// `levers`: signed or not, of the joints of all links [m]; `at`: the first lane of the block, and of the chain.
    pub(super) fn new(
        body: &EndBody,
        (rows, levers): (&[SilentLinkContour], &[f64]),
        (at, first): (usize, usize),
        front: bool,
    ) -> FlankCache {
        let (tooth, seats, outer) = match &body.shape {
            EndShape::OuterFlanks { tooth, seats } => (Some(tooth), Some(seats), true),
            EndShape::InnerFlanks { tooth, seats } => (Some(tooth), Some(seats), false),
            EndShape::Circle { .. } | EndShape::Lobes { .. } | EndShape::Face { .. } => (None, None, true),
        };
        let most_shift_m = seats.map_or(0.0, SeatDirections::most_shift_m);
        let reach = |lever: f64| tooth.map_or(0.0, |tooth| tooth.reach_m(lever.abs()) + most_shift_m);
        let limit = take(levers, at).map(reach);
        FlankCache {
            flanks: FlankLanes::new(rows, at - first, front, outer),
            tooth_gaps: seats.map(ToothGaps::new).unwrap_or_default(),
            limit,
            limit_squared: limit.map(|limit| limit * limit),
        }
    }
}

/// Touches of a block.
#[inline(always)]
pub(super) fn touches(query: &Query<'_>, cache: &mut FlankCache, found: &mut EndContactLanes) -> QueryResult {
    let (tooth, seats, outer) = match &query.body.shape {
        EndShape::OuterFlanks { tooth, seats } => (tooth, seats, true),
        EndShape::InnerFlanks { tooth, seats } => (tooth, seats, false),
        EndShape::Circle { .. } | EndShape::Lobes { .. } | EndShape::Face { .. } => return QueryResult::Apart(None),
    };
    let (jx, jy) = query.joints();
    let mut near = [0; LANES];
    for i in 0..LANES {
        near[i] = query.own[i] & !mask(jx[i] * jx[i] + jy[i] * jy[i] > cache.limit_squared[i]);
    }
    if !any(&near) {
        return QueryResult::Apart(Some(Clearances::new(query.own, &beyond_limit(cache, (&jx, &jy)))));
    }
    cache.tooth_gaps.update_gaps(seats, query.rotor, &near, (&jx, &jy));
    let (axis_x, axis_y) = cache.tooth_gaps.axes(query.rotor);
    let (cos, sin) = (query.poses.cos, query.poses.sin);
    let shift = shifts(seats, &cache.tooth_gaps, (&axis_x, &axis_y));
    let (x, y) = beside((&query.poses.x, &query.poses.y), shift.as_ref());
    let placed = LinksInBodyFrame { x: &x, y: &y, cos, sin, axis_x: &axis_x, axis_y: &axis_y };
    // Ahead of a front end for the outer flank, behind it for the inner one.
    let side = usize::from(query.front == outer);
    let bounds = (&near, query.far_m);
    found.tooth = cache.tooth_gaps.seat;
    let touches = if outer {
        cache.flanks.deepest::<true>(tooth, side, &placed, bounds, found)
    } else {
        cache.flanks.deepest::<false>(tooth, side, &placed, bounds, found)
    };
    if let Some([shift_x, shift_y]) = &shift {
        for i in 0..LANES {
            found.point_x[i] += shift_x[i];
            found.point_y[i] += shift_y[i];
        }
    }
    if touches { QueryResult::Near } else { QueryResult::Apart(None) }
}

/// By how much the gap of every lane lies beside its place, x and y; none where no gap does.
#[inline(always)]
fn shifts(seats: &SeatDirections, gaps: &ToothGaps, (ax, ay): (&LaneBlock, &LaneBlock)) -> Option<[LaneBlock; 2]> {
    if !seats.is_shifted() {
        return None;
    }
    let mut out = [[0.0; LANES]; 2];
    for i in 0..LANES {
        let shift = seats.shift(gaps.seat[i] as usize, Vec2::new(ax[i], ay[i]));
        (out[0][i], out[1][i]) = (shift.x, shift.y);
    }
    Some(out)
}

/// Links as seen by gaps that lie beside their places.
#[inline(always)]
fn beside((x, y): (&LaneBlock, &LaneBlock), shift: Option<&[LaneBlock; 2]>) -> (LaneBlock, LaneBlock) {
    let (mut x, mut y) = (*x, *y);
    if let Some([shift_x, shift_y]) = shift {
        for i in 0..LANES {
            x[i] -= shift_x[i];
            y[i] -= shift_y[i];
        }
    }
    (x, y)
}

/// How far joints are outside of the circle within which their links touch teeth [m].
#[inline(always)]
fn beyond_limit(cache: &FlankCache, (x, y): (&LaneBlock, &LaneBlock)) -> LaneBlock {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = (x[i] * x[i] + y[i] * y[i]).sqrt() - cache.limit[i];
    }
    out
}

/// Clearances of a block whose tooth gaps [`touches`] has looked up: to the contour there, or to where another tooth gap begins.
#[inline(always)]
pub(super) fn gaps(query: &Query<'_>, cache: &FlankCache) -> Clearances {
    let (tooth, seats, outer) = match &query.body.shape {
        EndShape::OuterFlanks { tooth, seats } => (tooth, seats, true),
        EndShape::InnerFlanks { tooth, seats } => (tooth, seats, false),
        EndShape::Circle { .. } | EndShape::Lobes { .. } | EndShape::Face { .. } => return Clearances::default(),
    };
    let (jx, jy) = query.joints();
    let (axis_x, axis_y) = cache.tooth_gaps.axes(query.rotor);
    let (cos, sin) = (query.poses.cos, query.poses.sin);
    let shift = shifts(seats, &cache.tooth_gaps, (&axis_x, &axis_y));
    let (x, y) = beside((&query.poses.x, &query.poses.y), shift.as_ref());
    let placed = LinksInBodyFrame { x: &x, y: &y, cos, sin, axis_x: &axis_x, axis_y: &axis_y };
    let side = usize::from(query.front == outer);
    let to_contour = if outer {
        cache.flanks.clearances::<true>(tooth, side, &placed, query.extent_m)
    } else {
        cache.flanks.clearances::<false>(tooth, side, &placed, query.extent_m)
    };
    let to_next = cache.tooth_gaps.margins((&jx, &jy), (&axis_x, &axis_y));
    let mut out = beyond_limit(cache, (&jx, &jy));
    for i in 0..LANES {
        let within = if to_contour[i] < to_next[i] { to_contour[i] } else { to_next[i] };
        out[i] = if out[i] > within { out[i] } else { within };
    }
    Clearances::new(query.own, &out)
}
