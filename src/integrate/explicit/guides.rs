//! The part of a step that concerns guides: plate ends on straight faces, many at a time.

use super::watch::ContactBlock;
use super::{
    BodyReaction, ContactGroup, MemoryBlocks, Scratch, Window, coordinate_columns, load_links, move_out_of_reach,
    owned_lanes, shift_and_lever, take, write_block,
};
use crate::elements::body_frame::FrameMotion;
use crate::lanes::{LANES, LaneBlock};
use crate::model::Model;
use crate::pairs::bush_tooth::{self, FrictionInput, Lanes};
use crate::pairs::contour_forces::BlockStep;
use crate::pairs::plate_guide;
use crate::state::State;
use std::time::Instant;

/// Contacts of both ends of all links near guide `k`.
#[inline(always)]
pub(super) fn contacts<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch, k: usize) {
    let body = &model.guides[k].body;
    let count = model.chain.padded / LANES;
    let reach_m = scratch.fastest_m_s * model.step_s;
    let frame = &model.guides[k].frame;
    let (motion, mobility) = (frame.motion(&coordinate_columns(model, state)), frame.mobility(&model.coordinates));
    let moves = !frame.shifts.is_empty();
    let mut given = BodyReaction::default();
    let mut own_lanes = scratch.lanes.take().unwrap_or_default();
    let lanes = &mut *own_lanes;
    for w in 0..scratch.guide_windows[k].len() {
        let Window { start, end, shared } = scratch.guide_windows[k][w];
        for block in start / LANES..end / LANES {
            let at = block * LANES;
            for rear in 0..2 {
                let sign = if rear == 0 { 1.0 } else { -1.0 };
                let set = 2 * body.side + rear;
                let group = ContactGroup::Guides(set).index();
                let begun = scratch.counts.is_some().then(Instant::now);
                let ends = if rear == 0 { &scratch.front } else { &scratch.rear };
                let within = plate_guide::any_within(body, reach_m, take(&ends.x, at), take(&ends.y, at));
                let near = shared
                    || moves
                    || within && {
                        let held = take(&state.contacts[group].normal_force, at);
                        let motion = [take(&ends.x, at), take(&ends.y, at), take(&ends.vx, at), take(&ends.vy, at)];
                        let push = acceleration_bounds(model, scratch, at);
                        plate_guide::any_near(body, reach_m, model.step_s, held, motion, push)
                    };
                if !near {
                    if scratch.groups[group].stale[block] != 0 {
                        super::memory_of(state, scratch, group, count).clear_block(block);
                    }
                    if let (Some(begun), Some(counts)) = (begun, &mut scratch.counts) {
                        counts.plates[k].record(false, None, begun);
                    }
                    continue;
                }
                load_ends(model, scratch, at, sign, (&motion, moves), lanes);
                if shared {
                    move_out_of_reach(&scratch.nearest_guide[body.side][at..at + LANES], k, lanes);
                }
                plate_guide::penetrations(body, lanes);
                super::memory_of(state, scratch, group, count).load_past(block, lanes);
                let (mu, stick, radius) = (body.friction, body.stick_speed_m_s, body.plate_radius_m);
                if moves {
                    let (sliding, radii) = (FrictionInput { mu, stick_speed: stick, radius }, [radius; LANES]);
                    bush_tooth::forces_on_body(&body.law, sliding, &radii, model.step_s, (0.0, mobility), lanes);
                    given.add(true, [&lanes.force_x, &lanes.force_y, &lanes.torque]);
                } else {
                    bush_tooth::forces(&body.law, mu, stick, radius, model.step_s, 0.0, lanes);
                }
                scratch.end_forces[block].add(lanes);
                if WATCHED {
                    observe(model, scratch, k, (at, shared), set, lanes);
                }
                if shared {
                    let nearest = &scratch.nearest_guide[body.side][at..at + LANES];
                    for i in (0..LANES).filter(|i| nearest[*i] == k) {
                        let columns = &mut scratch.groups[group];
                        columns.rate[at + i] = lanes.rate[i];
                        columns.slide[at + i] = lanes.slide[i];
                        columns.depth[at + i] = lanes.penetration[i];
                    }
                    let (now, stale) = (&mut scratch.contacts[group], &mut scratch.groups[group].stale);
                    MemoryBlocks::new(&state.contacts[group], now, stale, count).store_lanes(
                        |i| nearest[i] == k,
                        block,
                        lanes,
                    );
                } else {
                    let columns = &mut scratch.groups[group];
                    write_block(&mut columns.rate, at, lanes.rate);
                    write_block(&mut columns.slide, at, lanes.slide);
                    write_block(&mut columns.depth, at, lanes.penetration);
                    super::memory_of(state, scratch, group, count).store(block, lanes);
                }
                if let (Some(begun), Some(counts)) = (begun, &mut scratch.counts) {
                    counts.plates[k].record(true, Some(&lanes.normal_force), begun);
                }
            }
        }
    }
    given.give_back(frame, &mut scratch.chain_torque);
    scratch.lanes = Some(own_lanes);
}

/// For observers of every step.
#[inline(always)]
fn observe(model: &Model, scratch: &mut Scratch, k: usize, (at, shared): (usize, bool), set: usize, lanes: &Lanes) {
    let Some(watched) = &mut scratch.watched else { return };
    let body = &model.guides[k].body;
    let nearest = &scratch.nearest_guide[body.side];
    let own = owned_lanes(model.chain.link_lanes(at), shared.then_some(&nearest[at..at + LANES]), k);
    let part = ContactGroup::Guides(set);
    if watched.wants_segments() {
        let along = |i: usize| lanes.x[i] * body.along.x + lanes.y[i] * body.along.y;
        let segment = |i: usize| f64::from(model.guides[k].segment(along(i)) as u32);
        watched.record_segments(part, at, std::array::from_fn(segment), own.as_ref());
    }
    watched.record(&ContactBlock { part, at, lanes }, own.as_ref());
}

/// Forces on a block of links that add up, of guides and of all that contours touch: at the centres, with moments.
#[derive(Clone, Default)]
#[repr(align(64))]
pub(super) struct BlockForces {
    pub(super) x: LaneBlock,
    pub(super) y: LaneBlock,
    pub(super) moment: LaneBlock,
    /// Whether anything was added, be it zero.
    pub(super) used: bool,
}

impl BlockForces {
    #[inline(always)]
    pub(super) fn add_at_centre(&mut self, step: &BlockStep) {
        for i in 0..LANES {
            self.x[i] += step.force_x[i];
            self.y[i] += step.force_y[i];
            self.moment[i] += step.moment[i];
        }
        self.used = true;
    }

    #[inline(always)]
    pub(super) fn add(&mut self, lanes: &Lanes) {
        for i in 0..LANES {
            let arm = lanes.lever[i] * (lanes.cos[i] * lanes.force_y[i] - lanes.sin[i] * lanes.force_x[i]);
            self.x[i] += lanes.force_x[i];
            self.y[i] += lanes.force_y[i];
            self.moment[i] += lanes.moment[i] + arm;
        }
        self.used = true;
    }
}

/// Accelerations of the ends of the links `at` .. `at + LANES`, at most [m/s2].
#[inline(always)]
fn acceleration_bounds(model: &Model, scratch: &Scratch, at: usize) -> LaneBlock {
    let w = &scratch.wrapped;
    let (ax, ay, alpha) = (take(&w.ax, at), take(&w.ay, at), take(&w.alpha, at));
    let lever = take(&model.chain.lever, at);
    let mut push = [0.0; LANES];
    for i in 0..LANES {
        push[i] = ax[i].abs() + ay[i].abs() + lever[i] * alpha[i].abs();
    }
    push
}

/// One end of the links `at` .. `at + LANES`, relative to a guide's origin.
#[inline(always)]
fn load_ends(
    model: &Model,
    scratch: &Scratch,
    at: usize,
    sign: f64,
    (frame, moves): (&FrameMotion, bool),
    lanes: &mut Lanes,
) {
    let ends = if sign > 0.0 { &scratch.front } else { &scratch.rear };
    lanes.x = take(&ends.x, at);
    lanes.y = take(&ends.y, at);
    lanes.vx = take(&ends.vx, at);
    lanes.vy = take(&ends.vy, at);
    load_links(model, scratch, at, lanes);
    for lever in &mut lanes.lever {
        *lever *= sign;
    }
    let alpha = take(&scratch.wrapped.alpha, at);
    shift_and_lever(lanes, &alpha, frame.origin.x, frame.origin.y);
    if moves {
        lanes.take_off(frame);
    }
}
