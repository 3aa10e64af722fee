//! The part of a step that concerns teeth: bushes in their gaps, many at a time.

use super::watch::Noted;
use super::{Part, Scratch, Window, keep, keep_own, put, send_away, shift_and_lever, take};
use crate::elements::tooth_contact::{self, Column, LANES, Lanes, Turning};
use crate::geometry::Vec2;
use crate::model::Model;
use crate::state::State;

/// Everything that the bushes near a sprocket are loaded from and stored to; all slices of one length, so that one bounds
/// check does for a block. Rear columns and outputs begin at the next joint.
struct BushColumns<'a> {
    on_front: &'a [f64],
    front: [&'a [f64]; 10],
    rear: [&'a [f64]; 10],
    constants: [&'a [f64]; 7],
    memory: [&'a [f64]; 4],
}

/// Contacts of all bushes near sprocket `k`.
#[inline(always)]
pub(super) fn contacts<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch, k: usize) {
    let body = &model.sprockets[k].body;
    let n = model.chain.padded;
    let r = &state.rotors;
    let omega = r.omega[k] + 0.5 * model.step_s * r.alpha[k];
    let turning = Turning { cos: r.cos[k], sin: r.sin[k], omega };
    let reach_m = scratch.fastest_m_s * model.step_s;
    // Bushes sit at either end that meets in a joint: as far from the front end as the joint is stretched.
    let tip_reach_m = body.tip_radius_m
        + body.bush_radius_m
        + body.most_shift_m
        + reach_m
        + model.chain.joint.clearance_m
        + JOINT_STRETCH_M;
    let mut partial = [0.0; LANES];
    let mut own_lanes = scratch.lanes.take().unwrap_or_default();
    let lanes = &mut *own_lanes;
    for w in 0..scratch.tooth_windows[k].len() {
        let Window { start, end, shared } = scratch.tooth_windows[k][w];
        for block in start / LANES..end / LANES {
            let at = block * LANES;
            if !shared
                && !tooth_contact::any_inside(body, tip_reach_m, take(&scratch.front.x, at), take(&scratch.front.y, at))
            {
                clear_bushes(state, scratch, n, at);
                continue;
            }
            scratch.stale_bushes[at / LANES] = 2;
            load_bushes(&bush_columns(model, state, scratch, k), n, at, body.centre, lanes);
            if shared {
                send_away(&scratch.nearest_sprocket[at..at + LANES], k, lanes);
            }
            if !tooth_contact::penetrations(body, turning, lanes) {
                reseat(model, scratch, k, turning, at, lanes);
                tooth_contact::penetrations(body, turning, lanes);
            }
            if tooth_contact::any_within(reach_m, lanes) {
                let (mu, stick, radius) = (body.friction, body.stick_speed_m_s, body.bush_radius_m);
                tooth_contact::forces(&body.law, mu, stick, radius, model.step_s, omega, lanes);
                for (sum, torque) in partial.iter_mut().zip(lanes.torque) {
                    *sum += torque;
                }
            } else {
                lanes.let_go();
            }
            if WATCHED {
                watch(model, scratch, k, (at, shared), turning, lanes);
            }
            if shared {
                for i in (0..LANES).filter(|i| scratch.nearest_sprocket[at + i] == k) {
                    scratch.bush_rate[at + i] = lanes.rate[i];
                    scratch.bush_depth[at + i] = lanes.penetration[i];
                }
                keep_own(&scratch.nearest_sprocket[at..at + LANES], k, lanes, &state.bushes, &mut scratch.bushes, at);
                for i in 0..LANES {
                    scratch.bush_x[at + 1 + i] += lanes.force_x[i];
                    scratch.bush_y[at + 1 + i] += lanes.force_y[i];
                    scratch.bush_moment[at + 1 + i] += lanes.moment[i];
                }
            } else {
                put(&mut scratch.bush_rate, at, lanes.rate);
                put(&mut scratch.bush_depth, at, lanes.penetration);
                put(&mut scratch.bush_x[1..n + 1], at, lanes.force_x);
                put(&mut scratch.bush_y[1..n + 1], at, lanes.force_y);
                put(&mut scratch.bush_moment[1..n + 1], at, lanes.moment);
                keep(lanes, &state.bushes, &mut scratch.bushes, n, at);
            }
        }
    }
    scratch.lanes = Some(own_lanes);
    scratch.chain_torque[k] = partial.iter().sum();
}

/// For those who look at every step.
#[inline(always)]
fn watch(model: &Model, scratch: &mut Scratch, k: usize, (at, shared): (usize, bool), turning: Turning, lanes: &Lanes) {
    let Some(watched) = &mut scratch.watched else { return };
    let (body, n) = (&model.sprockets[k].body, model.chain.n_links);
    let own: Option<[bool; LANES]> = (shared || at + LANES > n)
        .then(|| std::array::from_fn(|i| at + i < n && (!shared || scratch.nearest_sprocket[at + i] == k)));
    if watched.wants_segments() && lanes.age != [0.0; LANES] {
        let segments = tooth_contact::segments(body, turning, lanes);
        watched.note_segments(Part::Bushes, at, segments, own.as_ref());
    }
    let (law, mu, radius) = (&body.law, body.friction, body.bush_radius_m);
    let noted = Noted { part: Part::Bushes, at, law, mu, lanes, radius, off: None, rotor: Some(k) };
    watched.note(&noted, own.as_ref());
}

#[inline(always)]
fn bush_columns<'a>(model: &'a Model, state: &'a State, scratch: &'a Scratch, k: usize) -> BushColumns<'a> {
    let n = model.chain.padded;
    let (c, s, m) = (&model.chain, scratch, &state.bushes);
    let (f, r) = (&s.front, &s.rear);
    let w = &s.wrapped;
    BushColumns {
        on_front: &c.bush_on_front[1..n + 1],
        front: [
            &f.x[..n],
            &f.y[..n],
            &f.vx[..n],
            &f.vy[..n],
            &s.omega[..n],
            &w.cos[..n],
            &w.sin[..n],
            &w.ax[..n],
            &w.ay[..n],
            &w.alpha[..n],
        ],
        rear: [
            &r.x[1..n + 1],
            &r.y[1..n + 1],
            &r.vx[1..n + 1],
            &r.vy[1..n + 1],
            &s.omega[1..n + 1],
            &w.cos[1..n + 1],
            &w.sin[1..n + 1],
            &w.ax[1..n + 1],
            &w.ay[1..n + 1],
            &w.alpha[1..n + 1],
        ],
        constants: [
            &c.bush_lever[..n],
            &c.bush_inverse_mass[..n],
            &c.bush_inverse_inertia[..n],
            &s.seat_cos[k][..n],
            &s.seat_sin[k][..n],
            &s.seat_out[k][..n],
            &s.seat_left[k][..n],
        ],
        memory: [&m.normal_force[..n], &m.tangential_force[..n], &m.age[..n], &m.approach[..n]],
    }
}

/// Joints that stretch further than this are found torn soon [m].
const JOINT_STRETCH_M: f64 = 0.5e-3;

/// A block of bushes outside the tip circle: forgets old contacts, once for each of the two memories that change hands.
#[inline(always)]
fn clear_bushes(state: &State, scratch: &mut Scratch, n: usize, at: usize) {
    let stale = &mut scratch.stale_bushes[at / LANES];
    if *stale == 0 {
        return;
    }
    *stale -= 1;
    let nothing = [0.0; LANES];
    for column in [&mut scratch.bush_x, &mut scratch.bush_y, &mut scratch.bush_moment] {
        put(&mut column[1..n + 1], at, nothing);
    }
    let (past, memory) = (&state.bushes, &mut scratch.bushes);
    for column in [&mut memory.normal_force, &mut memory.tangential_force, &mut memory.age, &mut memory.approach] {
        put(column, at, nothing);
    }
    put(&mut memory.lost_damping, at, take(&past.lost_damping, at));
    put(&mut memory.lost_friction, at, take(&past.lost_friction, at));
}

/// The bushes of joints `at` .. `at + LANES` as seen from `centre`.
#[inline(always)]
fn load_bushes(c: &BushColumns<'_>, n: usize, at: usize, centre: Vec2, lanes: &mut Lanes) {
    assert!(at + LANES <= n, "block {at} of {n} lanes");
    let on_front = take(c.on_front, at);
    let pick = |i: usize| chosen(on_front, take(c.front[i], at), take(c.rear[i], at));
    lanes.x = pick(0);
    lanes.y = pick(1);
    lanes.vx = pick(2);
    lanes.vy = pick(3);
    lanes.omega = pick(4);
    lanes.cos = pick(5);
    lanes.sin = pick(6);
    lanes.ax = pick(7);
    lanes.ay = pick(8);
    let alpha = pick(9);
    lanes.lever = take(c.constants[0], at);
    lanes.inverse_mass = take(c.constants[1], at);
    lanes.inverse_inertia = take(c.constants[2], at);
    lanes.seat_cos = take(c.constants[3], at);
    lanes.seat_sin = take(c.constants[4], at);
    lanes.seat_out = take(c.constants[5], at);
    lanes.seat_left = take(c.constants[6], at);
    lanes.normal_force = take(c.memory[0], at);
    lanes.tangential_force = take(c.memory[1], at);
    lanes.age = take(c.memory[2], at);
    lanes.approach = take(c.memory[3], at);
    shift_and_lever(lanes, &alpha, centre.x, centre.y);
}

#[inline(always)]
fn chosen(on_front: Column, front: Column, rear: Column) -> Column {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = if on_front[i] != 0.0 { front[i] } else { rear[i] };
    }
    out
}

/// Gives every lane of a block that has left its tooth gap the one it is in.
#[cold]
#[inline(never)]
fn reseat(model: &Model, scratch: &mut Scratch, k: usize, turning: Turning, at: usize, lanes: &mut Lanes) {
    let body = &model.sprockets[k].body;
    scratch.reseats += 1;
    for i in 0..LANES {
        let j = at + i;
        let seat = seat_of(model, k, turning.cos, turning.sin, lanes.x[i], lanes.y[i]);
        scratch.seat_cos[k][j] = body.seat_cos[seat];
        scratch.seat_sin[k][j] = body.seat_sin[seat];
        scratch.seat_out[k][j] = body.seat_out[seat];
        scratch.seat_left[k][j] = body.seat_left[seat];
        scratch.seat_index[k][j] = seat as u32;
        lanes.seat_out[i] = scratch.seat_out[k][j];
        lanes.seat_left[i] = scratch.seat_left[k][j];
        lanes.seat_cos[i] = scratch.seat_cos[k][j];
        lanes.seat_sin[i] = scratch.seat_sin[k][j];
    }
}

pub(super) fn seat_of(model: &Model, k: usize, cos: f64, sin: f64, x: f64, y: f64) -> usize {
    let in_frame = Vec2::new(cos * x + sin * y, cos * y - sin * x);
    model.sprockets[k].geometry.iso().map_or(0, |s| crate::contact::seat_index(s, in_frame) as usize)
}
