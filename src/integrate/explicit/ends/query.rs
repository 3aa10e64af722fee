//! One end of a block of links against one body: the query, its result, and what is cached for the next step.

use super::super::LANES;
use super::super::abutments::{self, AbutmentCache};
use super::super::flanks::{self, FlankCache};
use super::{BodyInStep, EndSources, LinkSources, from_origin};
use crate::geometry::Vec2;
use crate::lanes::{LaneBlock, LaneMask, any, mask};
use crate::model::Model;
use crate::pairs::arc_lanes::EndContactLanes;
use crate::pairs::contour_body::{EndBody, LinkContour, SeatDirections};

/// One end of a block of links against one body.
pub(in super::super) struct Query<'a> {
    pub(in super::super) body: &'a EndBody,
    pub(in super::super) front: bool,
    /// Cosine and sine of the sprocket's angle.
    pub(in super::super) rotor: (f64, f64),
    /// Gap beyond which nothing is of interest in this step [m].
    pub(in super::super) far_m: f64,
    /// As in [`BodyInStep`].
    pub(in super::super) extent_m: f64,
    /// Whether radii of curvature and segments are asked for.
    pub(in super::super) details: bool,
    pub(in super::super) own: &'a LaneMask,
    pub(in super::super) poses: Poses<'a>,
    /// Where the body stands, in the world.
    pub(in super::super) origin: Vec2,
    /// The joints at the ends, in the world.
    pub(in super::super) joint_x: &'a LaneBlock,
    pub(in super::super) joint_y: &'a LaneBlock,
}

impl<'a> Query<'a> {
    #[inline(always)]
    pub(super) fn new(
        links: &LinkSources<'a>,
        far_m: f64,
        meeting: &BodyInStep<'a>,
        (ends, at): (&EndSources<'a>, usize),
        own: &'a LaneMask,
    ) -> Query<'a> {
        Query {
            body: meeting.body,
            front: ends.sign > 0.0,
            rotor: meeting.rotor,
            far_m,
            extent_m: meeting.extent_m,
            details: meeting.details,
            own,
            poses: Poses::new(links, at, meeting.motion.origin),
            origin: meeting.motion.origin,
            joint_x: &ends.x[at],
            joint_y: &ends.y[at],
        }
    }

    /// The joints from the body's origin.
    #[inline(always)]
    pub(in super::super) fn joints(&self) -> (LaneBlock, LaneBlock) {
        from_origin(self.origin, self.joint_x, self.joint_y)
    }
}

/// What a query tells of a block.
pub(in super::super) enum QueryResult {
    /// Something touches, or is nearer than [`Query::far_m`].
    Near,
    /// Nothing is near. None: the query does not know the clearances; the caller may compute them.
    Apart(Option<Clearances>),
}

/// Centres of links from the body's origin, and their headings.
pub(in super::super) struct Poses<'a> {
    pub(in super::super) x: LaneBlock,
    pub(in super::super) y: LaneBlock,
    pub(in super::super) cos: &'a LaneBlock,
    pub(in super::super) sin: &'a LaneBlock,
}

impl<'a> Poses<'a> {
    #[inline(always)]
    fn new(from: &LinkSources<'a>, at: usize, origin: Vec2) -> Poses<'a> {
        let (x, y) = from_origin(origin, &from.x[at], &from.y[at]);
        Poses { x, y, cos: &from.cos[at], sin: &from.sin[at] }
    }

    /// Turns a direction of the world into the frame of the link of lane `i`.
    #[inline(always)]
    pub(in super::super) fn link(&self, i: usize, x: f64, y: f64) -> (f64, f64) {
        (self.cos[i] * x + self.sin[i] * y, self.cos[i] * y - self.sin[i] * x)
    }

    /// Turns a direction of the link of lane `i` into the world.
    #[inline(always)]
    pub(in super::super) fn world(&self, i: usize, x: f64, y: f64) -> (f64, f64) {
        (self.cos[i] * x - self.sin[i] * y, self.sin[i] * x + self.cos[i] * y)
    }

    /// The body's origin in the frames of the links.
    #[inline(always)]
    pub(in super::super) fn origin(&self) -> (LaneBlock, LaneBlock) {
        let mut out = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            (out.0[i], out.1[i]) = self.link(i, -self.x[i], -self.y[i]);
        }
        out
    }
}

/// The tooth gaps that joints are in: number, and direction of the axis in the sprocket's frame.
#[derive(Clone, Debug, Default)]
pub(in super::super) struct ToothGaps {
    pub(in super::super) seat: LaneBlock,
    pub(in super::super) cos: LaneBlock,
    pub(in super::super) sin: LaneBlock,
    /// Tangent of how far off an axis it is surely the nearest.
    sure_tan: f64,
}

impl ToothGaps {
    pub(in super::super) fn new(seats: &SeatDirections) -> ToothGaps {
        ToothGaps { sure_tan: seats.sure_tan(), ..ToothGaps::default() }
    }

    /// Directions of the axes in the world.
    #[inline(always)]
    pub(in super::super) fn axes(&self, (c, s): (f64, f64)) -> (LaneBlock, LaneBlock) {
        let mut out = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            out.0[i] = c * self.cos[i] - s * self.sin[i];
            out.1[i] = s * self.cos[i] + c * self.sin[i];
        }
        out
    }

    /// How far joints are from where they leave their gaps, at least [m]; `(gx, gy)`: as [`ToothGaps::axes`] has them.
    #[inline(always)]
    pub(in super::super) fn margins(
        &self,
        (x, y): (&LaneBlock, &LaneBlock),
        (gx, gy): (&LaneBlock, &LaneBlock),
    ) -> LaneBlock {
        let per_length = 1.0 / (1.0 + self.sure_tan * self.sure_tan).sqrt();
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            let (along, across) = (x[i] * gx[i] + y[i] * gy[i], gx[i] * y[i] - gy[i] * x[i]);
            out[i] = (self.sure_tan * along - across.abs()) * per_length;
        }
        out
    }

    /// Looks up the gaps of the lanes of `near` that have left theirs.
    #[inline(always)]
    pub(in super::super) fn update_gaps(
        &mut self,
        seats: &SeatDirections,
        rotor: (f64, f64),
        near: &LaneMask,
        (x, y): (&LaneBlock, &LaneBlock),
    ) {
        let (gx, gy) = self.axes(rotor);
        let mut outdated = [0; LANES];
        for i in 0..LANES {
            let (along, across) = (x[i] * gx[i] + y[i] * gy[i], gx[i] * y[i] - gy[i] * x[i]);
            outdated[i] = near[i] & !mask(across.abs() < self.sure_tan * along);
        }
        if any(&outdated) {
            for i in (0..LANES).filter(|i| outdated[*i] != 0) {
                let seat = seats.nearest(Vec2::new(x[i], y[i]), rotor).0;
                (self.cos[i], self.sin[i]) = seats.direction(seat);
                self.seat[i] = seat as f64;
            }
        }
    }
}

/// Clearances between a block of ends and a body.
#[derive(Clone, Copy, Debug, Default)]
pub(in super::super) struct Clearances {
    /// At least this wide [m]; of lanes of other bodies infinite.
    pub(in super::super) at_least_m: LaneBlock,
    /// 1 where motion along a face narrows them too: past its ends; else 0.
    pub(in super::super) past_end: LaneBlock,
}

impl Clearances {
    /// Of these lanes; the others' are infinite.
    #[inline(always)]
    pub(in super::super) fn new(own: &LaneMask, gaps_m: &LaneBlock) -> Clearances {
        let mut out = Clearances::default();
        for i in 0..LANES {
            out.at_least_m[i] = if own[i] != 0 { gaps_m[i] } else { f64::INFINITY };
        }
        out
    }

    /// Narrows them by what the links have moved. Returns whether all are still too wide for this step.
    #[inline(always)]
    pub(super) fn remain_clear(&mut self, motion: &MotionBounds) -> bool {
        let mut due = [0; LANES];
        for i in 0..LANES {
            let along = self.past_end[i] * motion.along_m[i];
            self.at_least_m[i] -= motion.moved_m[i] + along;
            due[i] = !mask(self.at_least_m[i] > motion.way_m[i] + along + along);
        }
        !any(&due)
    }
}

/// How points of a block of links move against a body, at most: those that may touch it.
pub(super) struct MotionBounds {
    /// In the step before [m].
    pub(super) moved_m: LaneBlock,
    /// In this one, with the speeds that contacts use [m].
    pub(super) way_m: LaneBlock,
    /// Along a face, in the step before; in this one no more than twice that [m].
    pub(super) along_m: LaneBlock,
}

/// What a block of ends touches with.
#[derive(Clone)]
pub(super) enum Cache {
    Abutments(Box<AbutmentCache>),
    Flanks(Box<FlankCache>),
}

impl Cache {
    /// Of front or rear ends of a block of links, as the body `body` meets them.
    pub(super) fn new(model: &Model, body: &EndBody, block: usize, front: bool) -> Cache {
        match &model.contours[body.chain] {
            Some(LinkContour::Flanks(rows)) => {
                let first = model.chain.loops[body.chain].start;
                Cache::Flanks(Box::new(FlankCache::new(
                    body,
                    (rows, &model.chain.lever),
                    (block * LANES, first),
                    front,
                )))
            }
            Some(LinkContour::Abutments { front: ahead, rear }) => {
                Cache::Abutments(Box::new(AbutmentCache::new(body, if front { ahead } else { rear })))
            }
            None => Cache::Abutments(Box::default()),
        }
    }

    /// Where the ends of a block meet the body.
    #[inline(always)]
    pub(super) fn touches(
        &mut self,
        query: &Query<'_>,
        contour: &LinkContour,
        found: &mut EndContactLanes,
    ) -> QueryResult {
        match (self, contour) {
            (Cache::Abutments(cache), LinkContour::Abutments { front, rear }) => {
                abutments::touches(query, if query.front { front } else { rear }, cache, found)
            }
            (Cache::Flanks(cache), _) => flanks::touches(query, cache, found),
            _ => QueryResult::Apart(None),
        }
    }
}
