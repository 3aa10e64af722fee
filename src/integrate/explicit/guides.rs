//! The part of a step that concerns guides: plate ends on straight faces, many at a time.

use super::watch::Noted;
use super::{Part, Scratch, Window, keep, keep_own, put, recall, send_away, shift_and_lever, sum, take};
use crate::elements::guide_contact;
use crate::elements::tooth_contact::{self, LANES, Lanes};
use crate::geometry::Vec2;
use crate::model::Model;
use crate::state::State;

/// Contacts of both ends of all links near guide `k`.
#[inline(always)]
pub(super) fn contacts<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch, k: usize) {
    let body = &model.guides[k].body;
    let n = model.chain.padded;
    let reach_m = scratch.fastest_m_s * model.step_s;
    let mut own_lanes = scratch.lanes.take().unwrap_or_default();
    let lanes = &mut *own_lanes;
    for w in 0..scratch.guide_windows[k].len() {
        let Window { start, end, shared } = scratch.guide_windows[k][w];
        for block in start / LANES..end / LANES {
            let at = block * LANES;
            for rear in 0..2 {
                let sign = if rear == 0 { 1.0 } else { -1.0 };
                let set = 2 * body.side + rear;
                let ends = if rear == 0 { &scratch.front } else { &scratch.rear };
                let within = guide_contact::any_within(body, reach_m, take(&ends.x, at), take(&ends.y, at));
                if !shared && !within {
                    clear_block(state, scratch, set, at);
                    continue;
                }
                let held = take(&state.guide_ends[set].normal_force, at);
                let motion = [take(&ends.x, at), take(&ends.y, at), take(&ends.vx, at), take(&ends.vy, at)];
                if !shared && !guide_contact::any_near(body, reach_m, model.step_s, held, motion) {
                    clear_block(state, scratch, set, at);
                    continue;
                }
                load_ends(model, state, scratch, at, sign, body.origin, lanes);
                if shared {
                    send_away(&scratch.nearest_guide[body.side][at..at + LANES], k, lanes);
                }
                guide_contact::penetrations(body, lanes);
                recall(&state.guide_ends[set], at, lanes);
                let (mu, stick, radius) = (body.friction, body.stick_speed_m_s, body.plate_radius_m);
                tooth_contact::forces(&body.law, mu, stick, radius, model.step_s, 0.0, lanes);
                add_guide_forces(scratch, at, lanes);
                if WATCHED {
                    watch(model, scratch, k, (at, shared), set, lanes);
                }
                if shared {
                    let nearest = &scratch.nearest_guide[body.side][at..at + LANES];
                    for i in (0..LANES).filter(|i| nearest[*i] == k) {
                        scratch.guide_rate[set][at + i] = lanes.rate[i];
                        scratch.guide_depth[set][at + i] = lanes.penetration[i];
                    }
                    keep_own(nearest, k, lanes, &state.guide_ends[set], &mut scratch.guide_ends[set], at);
                } else {
                    put(&mut scratch.guide_rate[set], at, lanes.rate);
                    put(&mut scratch.guide_depth[set], at, lanes.penetration);
                    keep(lanes, &state.guide_ends[set], &mut scratch.guide_ends[set], n, at);
                }
                scratch.stale_blocks[set][at / LANES] = 2;
            }
        }
    }
    scratch.lanes = Some(own_lanes);
}

/// For those who look at every step.
#[inline(always)]
fn watch(model: &Model, scratch: &mut Scratch, k: usize, (at, shared): (usize, bool), set: usize, lanes: &Lanes) {
    let Some(watched) = &mut scratch.watched else { return };
    let (body, n) = (&model.guides[k].body, model.chain.n_links);
    let nearest = &scratch.nearest_guide[body.side];
    let own: Option<[bool; LANES]> =
        (shared || at + LANES > n).then(|| std::array::from_fn(|i| at + i < n && (!shared || nearest[at + i] == k)));
    let part = Part::Guides(set);
    if watched.wants_segments() {
        let along = |i: usize| lanes.x[i] * body.along.x + lanes.y[i] * body.along.y;
        let segment = |i: usize| f64::from(model.guides[k].segment(along(i)) as u32);
        watched.note_segments(part, at, std::array::from_fn(segment), own.as_ref());
    }
    let (law, mu, radius) = (&body.law, body.friction, body.plate_radius_m);
    watched.note(&Noted { part, at, law, mu, lanes, radius, off: None, rotor: None }, own.as_ref());
}

#[inline(always)]
pub(super) fn add_guide_forces(scratch: &mut Scratch, at: usize, lanes: &Lanes) {
    let mut arms = lanes.moment;
    for i in 0..LANES {
        arms[i] += lanes.lever[i] * (lanes.cos[i] * lanes.force_y[i] - lanes.sin[i] * lanes.force_x[i]);
    }
    for (column, values) in [
        (&mut scratch.guide_x, lanes.force_x),
        (&mut scratch.guide_y, lanes.force_y),
        (&mut scratch.guide_moment, arms),
    ] {
        let total = sum(take(column, at), values);
        put(column, at, total);
    }
    scratch.guide_blocks.push(at);
}

/// A block of guide ends that nothing touches: forgets old contacts in the memory of this step, once for each of the two
/// memories that change hands.
#[inline(always)]
fn clear_block(state: &State, scratch: &mut Scratch, set: usize, at: usize) {
    let stale = &mut scratch.stale_blocks[set][at / LANES];
    if *stale == 0 {
        return;
    }
    *stale -= 1;
    let (past, memory) = (&state.guide_ends[set], &mut scratch.guide_ends[set]);
    let nothing = [0.0; LANES];
    put(&mut memory.normal_force, at, nothing);
    put(&mut memory.tangential_force, at, nothing);
    put(&mut memory.age, at, nothing);
    put(&mut memory.approach, at, nothing);
    put(&mut memory.lost_damping, at, take(&past.lost_damping, at));
    put(&mut memory.lost_friction, at, take(&past.lost_friction, at));
}

/// One end of the links `at` .. `at + LANES`, relative to a guide's origin.
#[inline(always)]
pub(super) fn load_ends(
    model: &Model,
    state: &State,
    scratch: &Scratch,
    at: usize,
    sign: f64,
    origin: Vec2,
    lanes: &mut Lanes,
) {
    let c = &model.chain;
    let ends = if sign > 0.0 { &scratch.front } else { &scratch.rear };
    lanes.x = take(&ends.x, at);
    lanes.y = take(&ends.y, at);
    lanes.vx = take(&ends.vx, at);
    lanes.vy = take(&ends.vy, at);
    lanes.omega = take(&scratch.omega, at);
    lanes.cos = take(&scratch.wrapped.cos, at);
    lanes.sin = take(&scratch.wrapped.sin, at);
    lanes.ax = take(&state.links.ax, at);
    lanes.ay = take(&state.links.ay, at);
    lanes.lever = take(&c.lever, at);
    lanes.inverse_mass = take(&c.inverse_mass, at);
    lanes.inverse_inertia = take(&c.inverse_inertia, at);
    for lever in &mut lanes.lever {
        *lever *= sign;
    }
    let alpha = take(&state.links.alpha, at);
    shift_and_lever(lanes, &alpha, origin.x, origin.y);
}
