//! The part of a step that concerns teeth: bushes in their gaps, many at a time.

use super::rollers;
use super::scratch::{LinkEnds, WrappedColumns};
use super::watch::{ContactBlock, ObservedStep};
use super::{BodyReaction, ContactGroup, MemoryBlocks, Scratch, Window, move_out_of_reach, owned_lanes};
use crate::elements::body_frame::{BodyMobility, FrameMotion};
use crate::geometry::Vec2;
use crate::lanes::{LANES, LaneBlock, blocks, blocks_mut};
use crate::model::{ChainModel, Model};
use crate::pairs::bush_tooth::{self, FrictionInput, Lanes, SprocketMotion};
use crate::state::State;
use std::time::Instant;

/// What the bushes near a sprocket are loaded from: blocks of columns of one length, so that one bounds check does for all.
/// Of the link before each joint, and of the link behind it.
pub(super) struct BushSources<'a> {
    on_front: &'a [LaneBlock],
    x: [&'a [LaneBlock]; 2],
    y: [&'a [LaneBlock]; 2],
    vx: [&'a [LaneBlock]; 2],
    vy: [&'a [LaneBlock]; 2],
    omega: [&'a [LaneBlock]; 2],
    cos: [&'a [LaneBlock]; 2],
    sin: [&'a [LaneBlock]; 2],
    ax: [&'a [LaneBlock]; 2],
    ay: [&'a [LaneBlock]; 2],
    alpha: [&'a [LaneBlock]; 2],
    lever: &'a [LaneBlock],
    inverse_mass: &'a [LaneBlock],
    inverse_inertia: &'a [LaneBlock],
}

impl<'a> BushSources<'a> {
    #[inline(always)]
    pub(super) fn new(
        c: &'a ChainModel,
        (front, rear): (&'a LinkEnds, &'a LinkEnds),
        omega: &'a [f64],
        wrapped: &'a WrappedColumns,
    ) -> BushSources<'a> {
        let count = c.padded / LANES;
        BushSources {
            on_front: blocks(&c.bush_on_front[1..], count),
            x: [blocks(&front.x, count), blocks(&rear.x[1..], count)],
            y: [blocks(&front.y, count), blocks(&rear.y[1..], count)],
            vx: [blocks(&front.vx, count), blocks(&rear.vx[1..], count)],
            vy: [blocks(&front.vy, count), blocks(&rear.vy[1..], count)],
            omega: [blocks(omega, count), blocks(&omega[1..], count)],
            cos: [blocks(&wrapped.cos, count), blocks(&wrapped.cos[1..], count)],
            sin: [blocks(&wrapped.sin, count), blocks(&wrapped.sin[1..], count)],
            ax: [blocks(&wrapped.ax, count), blocks(&wrapped.ax[1..], count)],
            ay: [blocks(&wrapped.ay, count), blocks(&wrapped.ay[1..], count)],
            alpha: [blocks(&wrapped.alpha, count), blocks(&wrapped.alpha[1..], count)],
            lever: blocks(&c.bush_lever, count),
            inverse_mass: blocks(&c.bush_inverse_mass, count),
            inverse_inertia: blocks(&c.bush_inverse_inertia, count),
        }
    }
}

/// Tooth gaps of the joints near a sprocket: direction of their axes, how far they lie beside their place, number.
struct SeatColumns<'a> {
    cos: &'a mut [LaneBlock],
    sin: &'a mut [LaneBlock],
    out: &'a mut [LaneBlock],
    left: &'a mut [LaneBlock],
    index: &'a mut [u32],
    reseats: &'a mut u64,
}

/// What bushes give to their links, and what is known of them at the node.
struct BushResults<'a> {
    force_x: &'a mut [LaneBlock],
    force_y: &'a mut [LaneBlock],
    moment: &'a mut [LaneBlock],
    rate: &'a mut [LaneBlock],
    slide: &'a mut [LaneBlock],
    depth: &'a mut [LaneBlock],
}

/// Contacts of all bushes near sprocket `k`.
#[inline(always)]
pub(super) fn contacts<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch, k: usize) {
    // Compiled apart, so that bushes do not pay for what rollers need.
    if model.bores[model.sprockets[k].chain].is_some() {
        contacts_of::<WATCHED, true>(model, state, scratch, k);
    } else {
        contacts_of::<WATCHED, false>(model, state, scratch, k);
    }
}

#[inline(always)]
fn contacts_of<const WATCHED: bool, const ROLLERS: bool>(
    model: &Model,
    state: &State,
    scratch: &mut Scratch,
    k: usize,
) {
    let body = &model.sprockets[k].body;
    let (c, count) = (&model.chain, model.chain.padded / LANES);
    let frame = &model.sprockets[k].frame;
    let motion = frame.motion(&super::coordinate_columns(model, state));
    let FrameMotion { cos, sin, omega, .. } = motion;
    let turning = SprocketMotion { cos, sin, omega };
    // A sprocket on a fixed axis gives way by a hundredth of what a link does: its contacts take the link's mass alone.
    let moves = !frame.shifts.is_empty();
    let mobility = if moves { frame.mobility(&model.coordinates) } else { BodyMobility::default() };
    let reach_m = scratch.fastest_m_s * model.step_s;
    // Bushes sit at either end that meets in a joint: as far from the front end as the joint is stretched.
    let tip_reach_m = body.tip_radius_m
        + body.bush_radius_m
        + body.most_shift_m
        + reach_m
        + model.chain.joints[model.sprockets[k].chain].clearance_m
        + JOINT_STRETCH_M;
    let s = scratch;
    let sources = BushSources::new(c, (&s.front, &s.rear), &s.omega, &s.wrapped);
    let mut seats = SeatColumns {
        cos: blocks_mut(&mut s.seat_cos[k], count),
        sin: blocks_mut(&mut s.seat_sin[k], count),
        out: blocks_mut(&mut s.seat_out[k], count),
        left: blocks_mut(&mut s.seat_left[k], count),
        index: &mut s.seat_index[k],
        reseats: &mut s.reseats,
    };
    let group = ContactGroup::Bushes.index();
    let columns = &mut s.groups[group];
    let mut memory = MemoryBlocks::new(&state.contacts[group], &mut s.contacts[group], &mut columns.stale, count);
    let results = BushResults {
        force_x: blocks_mut(s.bush_x.values_mut(), count),
        force_y: blocks_mut(s.bush_y.values_mut(), count),
        moment: blocks_mut(s.bush_moment.values_mut(), count),
        rate: blocks_mut(&mut columns.rate, count),
        slide: blocks_mut(&mut columns.slide, count),
        depth: blocks_mut(&mut columns.depth, count),
    };
    let (bore, past) =
        (model.bores[model.sprockets[k].chain].as_ref(), blocks(&state.contacts[group].tangential_force, count));
    let lanes: &mut Lanes = s.lanes.get_or_insert_default();
    let mut given = BodyReaction::default();
    for Window { start, end, shared } in &s.tooth_windows[k] {
        for at in start / LANES..(end / LANES).min(count) {
            let nearest = &s.nearest_sprocket[at * LANES..];
            let begun = s.counts.is_some().then(|| (Instant::now(), *seats.reseats));
            if !shared && !bush_tooth::any_inside(motion.origin, tip_reach_m, &sources.x[0][at], &sources.y[0][at]) {
                // Outside the tip circle.
                if memory.clear_block(at) {
                    let nothing = [0.0; LANES];
                    results.force_x[at] = nothing;
                    results.force_y[at] = nothing;
                    results.moment[at] = nothing;
                }
                continue;
            }
            load(&sources, at, (&motion, moves), lanes);
            lanes.seat_cos = seats.cos[at];
            lanes.seat_sin = seats.sin[at];
            lanes.seat_out = seats.out[at];
            lanes.seat_left = seats.left[at];
            memory.load_past(at, lanes);
            if *shared {
                move_out_of_reach(nearest, k, lanes);
            }
            if !bush_tooth::penetrations(body, turning, lanes) {
                reseat(model, &mut seats, k, turning, at, lanes);
                bush_tooth::penetrations(body, turning, lanes);
            }
            let near = bush_tooth::any_within(reach_m, lanes);
            if near {
                let (mu, stick, radius) = (body.friction, body.stick_speed_m_s, body.bush_radius_m);
                if moves {
                    let sliding = FrictionInput { mu, stick_speed: stick, radius };
                    let (radii, body_motion) = ([radius; LANES], (omega, mobility));
                    bush_tooth::forces_on_body(&body.law, sliding, &radii, model.step_s, body_motion, lanes);
                } else {
                    bush_tooth::forces(&body.law, mu, stick, radius, model.step_s, omega, lanes);
                }
                if ROLLERS && let Some(bore) = bore {
                    let sliding = (FrictionInput { mu, stick_speed: stick, radius }, &past[at]);
                    rollers::couple(model, state, &mut s.bores, (bore, at * LANES), sliding, mobility, lanes);
                }
                given.add(moves, [&lanes.force_x, &lanes.force_y, &lanes.torque]);
            } else {
                lanes.release();
            }
            if WATCHED && let Some(watched) = &mut s.watched {
                observe(model, watched, nearest, k, (at * LANES, *shared), turning, lanes);
            }
            if *shared {
                for i in (0..LANES).filter(|i| nearest[*i] == k) {
                    results.rate[at][i] = lanes.rate[i];
                    results.slide[at][i] = lanes.slide[i];
                    results.depth[at][i] = lanes.penetration[i];
                }
                memory.store_lanes(|i| nearest[i] == k, at, lanes);
                for i in 0..LANES {
                    results.force_x[at][i] += lanes.force_x[i];
                    results.force_y[at][i] += lanes.force_y[i];
                    results.moment[at][i] += lanes.moment[i];
                }
            } else {
                results.rate[at] = lanes.rate;
                results.slide[at] = lanes.slide;
                results.depth[at] = lanes.penetration;
                results.force_x[at] = lanes.force_x;
                results.force_y[at] = lanes.force_y;
                results.moment[at] = lanes.moment;
                memory.store(at, lanes);
            }
            if let (Some((begun, reseats)), Some(counts)) = (begun, &mut s.counts) {
                counts.bushes[k].searches += *seats.reseats - reseats;
                counts.bushes[k].record(near, near.then_some(&lanes.normal_force), begun);
            }
        }
    }
    given.give_back(frame, &mut s.chain_torque);
}

/// For observers of every step.
#[inline(always)]
fn observe(
    model: &Model,
    watched: &mut ObservedStep,
    nearest: &[usize],
    k: usize,
    (at, shared): (usize, bool),
    turning: SprocketMotion,
    lanes: &Lanes,
) {
    let body = &model.sprockets[k].body;
    let own = owned_lanes(model.chain.link_lanes(at), shared.then_some(nearest), k);
    if watched.wants_segments() && lanes.age != [0.0; LANES] {
        let segments = bush_tooth::segments(body, turning, lanes);
        watched.record_segments(ContactGroup::Bushes, at, segments, own.as_ref());
    }
    watched.record(&ContactBlock { part: ContactGroup::Bushes, at, lanes }, own.as_ref());
}

/// Joints that stretch further than this are found torn soon [m].
const JOINT_STRETCH_M: f64 = 0.5e-3;

/// The bushes of the joints of block `at` as seen from the axis of a sprocket, which may move.
#[inline(always)]
fn load(from: &BushSources<'_>, at: usize, (axis, moves): (&FrameMotion, bool), lanes: &mut Lanes) {
    load_bushes(from, at, axis.origin, lanes);
    if moves {
        lanes.take_off(axis);
    }
}

/// The bushes of the joints of block `at`, their places from `origin`.
#[inline(always)]
pub(super) fn load_bushes(from: &BushSources<'_>, at: usize, origin: Vec2, lanes: &mut Lanes) {
    let owner = &from.on_front[at];
    let (mut x, mut y) = (select_owner(owner, from.x, at), select_owner(owner, from.y, at));
    (lanes.vx, lanes.vy) = (select_owner(owner, from.vx, at), select_owner(owner, from.vy, at));
    lanes.omega = select_owner(owner, from.omega, at);
    let (cos, sin, lever) = (select_owner(owner, from.cos, at), select_owner(owner, from.sin, at), from.lever[at]);
    let (mut ax, mut ay) = (select_owner(owner, from.ax, at), select_owner(owner, from.ay, at));
    let alpha = select_owner(owner, from.alpha, at);
    for i in 0..LANES {
        x[i] -= origin.x;
        y[i] -= origin.y;
        ax[i] -= alpha[i] * lever[i] * sin[i];
        ay[i] += alpha[i] * lever[i] * cos[i];
    }
    lanes.x = x;
    lanes.y = y;
    lanes.ax = ax;
    lanes.ay = ay;
    lanes.cos = cos;
    lanes.sin = sin;
    lanes.lever = lever;
    lanes.inverse_mass = from.inverse_mass[at];
    lanes.inverse_inertia = from.inverse_inertia[at];
}

/// Of the link before each joint where `owner` is one, of that behind it where it is zero.
#[inline(always)]
fn select_owner(owner: &LaneBlock, [front, rear]: [&[LaneBlock]; 2], at: usize) -> LaneBlock {
    // By value: of references one would be chosen lane by lane.
    let (front, rear): (LaneBlock, LaneBlock) = (front[at], rear[at]);
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = if owner[i] != 0.0 { front[i] } else { rear[i] };
    }
    out
}

/// Gives every lane of a block that has left its tooth gap the one it is in.
#[cold]
#[inline(never)]
fn reseat(model: &Model, seats: &mut SeatColumns<'_>, k: usize, turning: SprocketMotion, at: usize, lanes: &mut Lanes) {
    let body = &model.sprockets[k].body;
    *seats.reseats += 1;
    for i in 0..LANES {
        let seat = seat_of(model, k, turning.cos, turning.sin, lanes.x[i], lanes.y[i]);
        seats.cos[at][i] = body.seat_cos[seat];
        seats.sin[at][i] = body.seat_sin[seat];
        seats.out[at][i] = body.seat_out[seat];
        seats.left[at][i] = body.seat_left[seat];
        seats.index[at * LANES + i] = seat as u32;
    }
    lanes.seat_cos = seats.cos[at];
    lanes.seat_sin = seats.sin[at];
    lanes.seat_out = seats.out[at];
    lanes.seat_left = seats.left[at];
}

pub(super) fn seat_of(model: &Model, k: usize, cos: f64, sin: f64, x: f64, y: f64) -> usize {
    let in_frame = Vec2::new(cos * x + sin * y, cos * y - sin * x);
    model.sprockets[k].geometry.iso().map_or(0, |s| crate::pairs::bush_gap::seat_index(s, in_frame) as usize)
}
