//! The explicit scheme: a leapfrog whose contact forces are means over the step.
//!
//! ```text
//! v_n     ~ v(n-1/2) + h/2 a(n-1)            velocity at the node, for damping and friction
//! a_n     = (joints + contacts + guides) / m   contact forces: mean over [t_n - h/2, t_n + h/2], see elements::contact_law;
//!                                            joints a second time, with v_n from the first a_n
//! v(n+1/2) = v(n-1/2) + h a_n
//! x_(n+1)  = x_n + h v(n+1/2)                 headings by Taylor composition, see elements::rotor
//! ```
//! The second look at the joints is worth its tenth of the time: without it their damping lags by half a step behind an
//! impact, and the engagement peaks at 2.2 us are 2.7 % low instead of 0.9 %. Second order without contact. With contact the
//! error is set by where in a step first touch falls; the mean force makes it small (tests/convergence.rs). [`evaluate`] computes
//! a_n and changes nothing but Scratch, so that a frame can be taken between it and [`advance`]; a step is one after the other.
//! Sums run in chain order or in fixed partial sums, so that no vector width, window or reporting interval changes a bit.

pub(crate) mod ends;
mod guides;
mod parts;
mod scratch;
mod teeth;
pub(crate) mod watch;
mod windows;

pub use parts::Part;
pub use scratch::Scratch;
use scratch::{Ends, WINDOW_MARGIN_M, Wrapped};
pub use watch::{ContactValue, Extreme, MOST_SPROCKETS, Parts, TorqueSums, Touches, Wanted, linear_force};

use super::{Isa, StepError, StepErrorKind};
use crate::elements::link_joint::{self, JointEnds};
use crate::elements::rotor::{Rotor, turned};
use crate::elements::tooth_contact::{Column, LANES, Lanes, blocks, blocks_mut, take};
use crate::model::Model;
use crate::state::{ContactMemory, LinkState, State};

/// Extra damping while a drive is run in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunIn {
    /// Rate at which links are drawn to the chain speed along their heading [1/s].
    pub link_rate_per_s: f64,
    /// Rate at which free sprockets are drawn to their nominal speed [1/s].
    pub rotor_rate_per_s: f64,
}

impl RunIn {
    pub const OFF: RunIn = RunIn { link_rate_per_s: 0.0, rotor_rate_per_s: 0.0 };
}

/// A run of joints or links near a body, aligned to [`LANES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Window {
    start: usize,
    end: usize,
    /// Another body of the same kind has a window over the same lanes: each lane then counts for its nearest body only.
    shared: bool,
}

/// One whole step.
pub fn step(model: &Model, state: &mut State, scratch: &mut Scratch) -> Result<(), StepError> {
    evaluate(model, state, scratch)?;
    advance(model, state, scratch);
    Ok(())
}

/// Forces and accelerations at the node of `state`, into Scratch.
pub fn evaluate(model: &Model, state: &State, scratch: &mut Scratch) -> Result<(), StepError> {
    if state.step >= scratch.next_refresh || scratch.next_refresh == 0 {
        link_ends(model, state, scratch);
        let fastest_m_s = check(model, state, scratch)?;
        scratch.fastest_m_s = fastest_m_s;
        windows::refresh(model, state, scratch);
        let bearable = (0.4 * WINDOW_MARGIN_M / (fastest_m_s * model.step_s).max(1e-300)) as u64;
        scratch.next_refresh = state.step + scratch.refresh_steps.min(bearable).max(1);
    }
    // What is kept for others would cost the steps of those who ask for nothing 2 % if it were not compiled apart.
    if scratch.watched.is_some() {
        evaluate_for::<true>(model, state, scratch);
    } else {
        evaluate_for::<false>(model, state, scratch);
    }
    Ok(())
}

#[inline(always)]
fn evaluate_for<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch) {
    match scratch.isa {
        Isa::Baseline => evaluate_body::<WATCHED>(model, state, scratch),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the variants other than Baseline are only made where the machine has the features (Isa::available).
        Isa::Avx2 => unsafe { evaluate_avx2::<WATCHED>(model, state, scratch) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        Isa::Avx512 => unsafe { evaluate_avx512::<WATCHED>(model, state, scratch) },
        #[cfg(not(target_arch = "x86_64"))]
        _ => evaluate_body::<WATCHED>(model, state, scratch),
    }
}

/// Velocities, positions, memory and ledger forward by one step, with the accelerations of [`evaluate`].
pub fn advance(model: &Model, state: &mut State, scratch: &mut Scratch) {
    match scratch.isa {
        Isa::Baseline => advance_body(model, state, scratch),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as in `evaluate`.
        Isa::Avx2 => unsafe { advance_avx2(model, state, scratch) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as in `evaluate`.
        Isa::Avx512 => unsafe { advance_avx512(model, state, scratch) },
        #[cfg(not(target_arch = "x86_64"))]
        _ => advance_body(model, state, scratch),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn evaluate_avx2<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch) {
    evaluate_body::<WATCHED>(model, state, scratch);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq")]
fn evaluate_avx512<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch) {
    evaluate_body::<WATCHED>(model, state, scratch);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn advance_avx2(model: &Model, state: &mut State, scratch: &mut Scratch) {
    advance_body(model, state, scratch);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq")]
fn advance_avx512(model: &Model, state: &mut State, scratch: &mut Scratch) {
    advance_body(model, state, scratch);
}

#[inline(always)]
fn evaluate_body<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch) {
    link_ends(model, state, scratch);
    joints(model, scratch);
    if WATCHED && let Some(watched) = &mut scratch.watched {
        watched.clear();
    }
    for windows in &scratch.tooth_windows {
        for w in windows.iter().filter(|w| w.shared) {
            scratch.bush_x[w.start + 1..w.end + 1].fill(0.0);
            scratch.bush_y[w.start + 1..w.end + 1].fill(0.0);
            scratch.bush_moment[w.start + 1..w.end + 1].fill(0.0);
        }
    }
    for k in 0..model.sprockets.len() {
        teeth::contacts::<WATCHED>(model, state, scratch, k);
    }
    close_loop(model.chain.n_links, [&mut scratch.bush_x, &mut scratch.bush_y, &mut scratch.bush_moment]);
    while let Some(at) = scratch.guide_blocks.pop() {
        put(&mut scratch.guide_x, at, [0.0; LANES]);
        put(&mut scratch.guide_y, at, [0.0; LANES]);
        put(&mut scratch.guide_moment, at, [0.0; LANES]);
    }
    for k in (0..model.guides.len()).filter(|k| model.guides[*k].body.touches_plates) {
        guides::contacts::<WATCHED>(model, state, scratch, k);
    }
    if model.contour.is_some() {
        ends::contacts(model, state, scratch);
    }
    accelerations(model, state, scratch);
    // Joints once more, with the velocities that these accelerations give at the node.
    corrected_speeds(model, state, scratch);
    joints(model, scratch);
    accelerations(model, state, scratch);
    if WATCHED {
        watch::note_node(model, state, scratch);
    }
}

/// Velocities of the link ends at the node with the accelerations of this node.
#[inline(always)]
fn corrected_speeds(model: &Model, state: &State, scratch: &mut Scratch) {
    let half = 0.5 * model.step_s;
    let s = &state.links;
    let count = model.chain.padded / LANES;
    let Scratch { front, rear, omega, ax, ay, alpha, .. } = scratch;
    let (lever, cos, sin) = (blocks(&model.chain.lever, count), blocks(&s.cos, count), blocks(&s.sin, count));
    let (a, b, e) = (blocks(ax, count), blocks(ay, count), blocks(alpha, count));
    let (u, v, w) = (blocks(&s.vx, count), blocks(&s.vy, count), blocks(&s.omega, count));
    let (fvx, fvy) = (blocks_mut(&mut front.vx, count), blocks_mut(&mut front.vy, count));
    let (rvx, rvy) = (blocks_mut(&mut rear.vx, count), blocks_mut(&mut rear.vy, count));
    let turning = blocks_mut(omega, count);
    for at in 0..count {
        let (l, c, sn) = (lever[at], cos[at], sin[at]);
        let (a, b, e) = (a[at], b[at], e[at]);
        let (mut u, mut v, mut o) = (u[at], v[at], w[at]);
        let zero = [0.0; LANES];
        let (mut front_x, mut front_y, mut rear_x, mut rear_y) = (zero, zero, zero, zero);
        for i in 0..LANES {
            u[i] += half * a[i];
            v[i] += half * b[i];
            o[i] += half * e[i];
            let (oc, os) = (o[i] * l[i] * c[i], o[i] * l[i] * sn[i]);
            (front_x[i], front_y[i]) = (u[i] - os, v[i] + oc);
            (rear_x[i], rear_y[i]) = (u[i] + os, v[i] - oc);
        }
        (fvx[at], fvy[at], rvx[at], rvy[at], turning[at]) = (front_x, front_y, rear_x, rear_y, o);
    }
    let last = model.chain.n_links;
    for column in [&mut rear.vx, &mut rear.vy, omega] {
        column[last] = column[0];
    }
}

/// Positions and predicted velocities of both ends of every link at the node; headings and accelerations with the first
/// link again after the last, where joint n - 1 closes the loop.
#[inline(always)]
fn link_ends(model: &Model, state: &State, scratch: &mut Scratch) {
    let Scratch { front, rear, omega, wrapped, .. } = scratch;
    ends_kernel(0.5 * model.step_s, &model.chain.lever, &state.links, front, rear, omega, wrapped);
    let last = model.chain.n_links;
    let Wrapped { cos, sin, ax, ay, alpha } = wrapped;
    let Ends { x, y, vx, vy } = rear;
    for column in [x, y, vx, vy, omega, cos, sin, ax, ay, alpha] {
        column[last] = column[0];
    }
}

#[inline(always)]
fn ends_kernel(
    half: f64,
    lever: &[f64],
    s: &LinkState,
    front: &mut Ends,
    rear: &mut Ends,
    omega: &mut [f64],
    wrapped: &mut Wrapped,
) {
    let count = lever.len() / LANES;
    let (lever, x, y) = (blocks(lever, count), blocks(&s.x, count), blocks(&s.y, count));
    let (cos, sin) = (blocks(&s.cos, count), blocks(&s.sin, count));
    let (vx, vy, w) = (blocks(&s.vx, count), blocks(&s.vy, count), blocks(&s.omega, count));
    let (ax, ay, alpha) = (blocks(&s.ax, count), blocks(&s.ay, count), blocks(&s.alpha, count));
    let (fx, fy) = (blocks_mut(&mut front.x, count), blocks_mut(&mut front.y, count));
    let (fvx, fvy) = (blocks_mut(&mut front.vx, count), blocks_mut(&mut front.vy, count));
    let (rx, ry) = (blocks_mut(&mut rear.x, count), blocks_mut(&mut rear.y, count));
    let (rvx, rvy) = (blocks_mut(&mut rear.vx, count), blocks_mut(&mut rear.vy, count));
    let omega = blocks_mut(omega, count);
    let (wrapped_cos, wrapped_sin) = (blocks_mut(&mut wrapped.cos, count), blocks_mut(&mut wrapped.sin, count));
    let (wrapped_ax, wrapped_ay) = (blocks_mut(&mut wrapped.ax, count), blocks_mut(&mut wrapped.ay, count));
    let wrapped_alpha = blocks_mut(&mut wrapped.alpha, count);
    for at in 0..count {
        let (l, c, s) = (lever[at], cos[at], sin[at]);
        let (a, b, e) = (ax[at], ay[at], alpha[at]);
        let (px, py) = (x[at], y[at]);
        let (mut u, mut v, mut o) = (vx[at], vy[at], w[at]);
        let zero = [0.0; LANES];
        let (mut ax, mut ay, mut avx, mut avy) = (zero, zero, zero, zero);
        let (mut bx, mut by, mut bvx, mut bvy) = (zero, zero, zero, zero);
        for i in 0..LANES {
            u[i] += half * a[i];
            v[i] += half * b[i];
            o[i] += half * e[i];
            let (lc, ls) = (l[i] * c[i], l[i] * s[i]);
            let (oc, os) = (o[i] * lc, o[i] * ls);
            (ax[i], ay[i]) = (px[i] + lc, py[i] + ls);
            (bx[i], by[i]) = (px[i] - lc, py[i] - ls);
            (avx[i], avy[i]) = (u[i] - os, v[i] + oc);
            (bvx[i], bvy[i]) = (u[i] + os, v[i] - oc);
        }
        (fx[at], fy[at], fvx[at], fvy[at]) = (ax, ay, avx, avy);
        (rx[at], ry[at], rvx[at], rvy[at]) = (bx, by, bvx, bvy);
        omega[at] = o;
        (wrapped_cos[at], wrapped_sin[at]) = (c, s);
        (wrapped_ax[at], wrapped_ay[at], wrapped_alpha[at]) = (a, b, e);
    }
}

#[inline(always)]
fn joints(model: &Model, scratch: &mut Scratch) {
    let ends = JointEnds {
        front_x: &scratch.front.x,
        front_y: &scratch.front.y,
        front_vx: &scratch.front.vx,
        front_vy: &scratch.front.vy,
        rear_x: &scratch.rear.x,
        rear_y: &scratch.rear.y,
        rear_vx: &scratch.rear.vx,
        rear_vy: &scratch.rear.vy,
        omega: &scratch.omega,
        inverse_inertia: &model.chain.inverse_inertia,
    };
    link_joint::forces(
        &model.chain.joint,
        0.5 * model.step_s,
        &ends,
        &mut scratch.joint_x,
        &mut scratch.joint_y,
        &mut scratch.joint_torque,
        &mut scratch.joint_power_damping,
        &mut scratch.joint_power_friction,
    );
    for (j, torque_nm) in &model.chain.tight {
        link_joint::tighten(
            (&model.chain.joint, *torque_nm),
            (*j, 0.5 * model.step_s),
            &ends,
            &mut scratch.joint_torque,
            &mut scratch.joint_power_friction,
        );
    }
    close_loop(model.chain.n_links, [&mut scratch.joint_x, &mut scratch.joint_y, &mut scratch.joint_torque]);
}

/// Columns shifted by one: the last joint stands before the first.
#[inline(always)]
fn close_loop(n_links: usize, columns: [&mut Vec<f64>; 3]) {
    for column in columns {
        column[0] = column[n_links];
    }
}

/// Puts lanes that are nearer to another body out of reach.
#[cold]
fn send_away(nearest: &[usize], own: usize, lanes: &mut Lanes) {
    for (i, body) in nearest.iter().enumerate() {
        if *body != own {
            lanes.x[i] = crate::state::FAR_AWAY_M;
        }
    }
}

/// As [`keep`], for the lanes that are nearest to this body.
#[cold]
fn keep_own(nearest: &[usize], own: usize, lanes: &Lanes, past: &ContactMemory, memory: &mut ContactMemory, at: usize) {
    for (i, body) in nearest.iter().enumerate() {
        if *body == own {
            memory.normal_force[at + i] = lanes.normal_force[i];
            memory.tangential_force[at + i] = lanes.tangential_force[i];
            memory.age[at + i] = lanes.age[i];
            memory.approach[at + i] = lanes.approach[i];
            memory.lost_damping[at + i] = past.lost_damping[at + i] + lanes.lost_damping[i];
            memory.lost_friction[at + i] = past.lost_friction[at + i] + lanes.lost_friction[i];
        }
    }
}

#[inline(always)]
fn put(column: &mut [f64], at: usize, values: Column) {
    column[at..at + LANES].copy_from_slice(&values);
}

/// Gives the contact memory of a block back to its columns.
#[inline(always)]
fn keep(lanes: &Lanes, past: &ContactMemory, memory: &mut ContactMemory, n: usize, at: usize) {
    put(&mut memory.normal_force[..n], at, lanes.normal_force);
    put(&mut memory.tangential_force[..n], at, lanes.tangential_force);
    put(&mut memory.age[..n], at, lanes.age);
    put(&mut memory.approach[..n], at, lanes.approach);
    put(&mut memory.lost_damping[..n], at, sum(take(&past.lost_damping[..n], at), lanes.lost_damping));
    put(&mut memory.lost_friction[..n], at, sum(take(&past.lost_friction[..n], at), lanes.lost_friction));
}

#[inline(always)]
fn sum(a: Column, b: Column) -> Column {
    let mut out = a;
    for i in 0..LANES {
        out[i] += b[i];
    }
    out
}

#[inline(always)]
fn recall(memory: &ContactMemory, at: usize, lanes: &mut Lanes) {
    lanes.normal_force = take(&memory.normal_force, at);
    lanes.tangential_force = take(&memory.tangential_force, at);
    lanes.age = take(&memory.age, at);
    lanes.approach = take(&memory.approach, at);
}

/// Coordinates from the body's origin; acceleration of the end from that of the link.
#[inline(always)]
fn shift_and_lever(lanes: &mut Lanes, alpha: &Column, origin_x: f64, origin_y: f64) {
    for i in 0..LANES {
        lanes.x[i] -= origin_x;
        lanes.y[i] -= origin_y;
        lanes.ax[i] -= alpha[i] * lanes.lever[i] * lanes.sin[i];
        lanes.ay[i] += alpha[i] * lanes.lever[i] * lanes.cos[i];
    }
}

/// Accelerations from all forces.
#[inline(always)]
fn accelerations(model: &Model, state: &State, scratch: &mut Scratch) {
    let c = &model.chain;
    let n = c.padded;
    let (cos, sin) = (&state.links.cos[..n], &state.links.sin[..n]);
    let (jx0, jx1) = (&scratch.joint_x[..n], &scratch.joint_x[1..n + 1]);
    let (jy0, jy1) = (&scratch.joint_y[..n], &scratch.joint_y[1..n + 1]);
    let (jm0, jm1) = (&scratch.joint_torque[..n], &scratch.joint_torque[1..n + 1]);
    let (bx0, bx1) = (&scratch.bush_x[..n], &scratch.bush_x[1..n + 1]);
    let (by0, by1) = (&scratch.bush_y[..n], &scratch.bush_y[1..n + 1]);
    let (bm0, bm1) = (&scratch.bush_moment[..n], &scratch.bush_moment[1..n + 1]);
    let (on0, on1) = (&c.bush_on_front[..n], &c.bush_on_front[1..n + 1]);
    let (gx, gy, gm) = (&scratch.guide_x[..n], &scratch.guide_y[..n], &scratch.guide_moment[..n]);
    let (lever, im, ij) = (&c.lever[..n], &c.inverse_mass[..n], &c.inverse_inertia[..n]);
    let (ax, ay, al) = (&mut scratch.ax[..n], &mut scratch.ay[..n], &mut scratch.alpha[..n]);
    for i in 0..n {
        let rear_owns = 1.0 - on0[i];
        let (fx, fy) = (on1[i] * bx1[i] - jx1[i], on1[i] * by1[i] - jy1[i]);
        let (rx, ry) = (rear_owns * bx0[i] + jx0[i], rear_owns * by0[i] + jy0[i]);
        let moment = on1[i] * bm1[i] + rear_owns * bm0[i] + (jm0[i] - jm1[i]) + gm[i];
        ax[i] = (fx + rx + gx[i]) * im[i];
        ay[i] = (fy + ry + gy[i]) * im[i];
        al[i] = (lever[i] * (cos[i] * (fy - ry) - sin[i] * (fx - rx)) + moment) * ij[i];
    }
    if scratch.run_in != RunIn::OFF {
        let rate = scratch.run_in.link_rate_per_s;
        let (vx, vy) = (&state.links.vx[..n], &state.links.vy[..n]);
        for i in 0..c.n_links {
            ax[i] -= rate * (vx[i] - model.chain_speed_m_s * cos[i]);
            ay[i] -= rate * (vy[i] - model.chain_speed_m_s * sin[i]);
        }
    }
    for (k, sprocket) in model.sprockets.iter().enumerate() {
        let rotor = &sprocket.rotor;
        let pull = scratch.run_in.rotor_rate_per_s * (state.rotors.omega[k] - sprocket.nominal_speed_rad_s);
        scratch.rotor_alpha[k] = match rotor {
            Rotor::Driven { .. } => 0.0,
            Rotor::Free { .. } => (scratch.chain_torque[k] + rotor.outer_torque_nm()) * rotor.inverse_inertia() - pull,
        };
    }
}

#[inline(always)]
fn advance_body(model: &Model, state: &mut State, scratch: &mut Scratch) {
    let (n, h) = (model.chain.padded, model.step_s);
    let s = &mut state.links;
    advance_kernel(h, s, &scratch.ax[..n], &scratch.ay[..n], &scratch.alpha[..n]);
    std::mem::swap(&mut s.ax, &mut scratch.ax);
    std::mem::swap(&mut s.ay, &mut scratch.ay);
    std::mem::swap(&mut s.alpha, &mut scratch.alpha);
    let (ld, lf) = (&mut state.lost_pin_damping[..n], &mut state.lost_pin_friction[..n]);
    let (pd, pf) = (&scratch.joint_power_damping[..n], &scratch.joint_power_friction[..n]);
    for j in 0..n {
        ld[j] += h * pd[j];
        lf[j] += h * pf[j];
    }
    std::mem::swap(&mut state.bushes, &mut scratch.bushes);
    std::mem::swap(&mut state.guide_ends, &mut scratch.guide_ends);
    std::mem::swap(&mut state.contour_ends, &mut scratch.contour_ends);
    rotors(model, state, scratch);
    state.step += 1;
}

#[inline(always)]
fn advance_kernel(h: f64, s: &mut LinkState, ax: &[f64], ay: &[f64], alpha: &[f64]) {
    let count = ax.len() / LANES;
    let (ax, ay, alpha) = (blocks(ax, count), blocks(ay, count), blocks(alpha, count));
    let (x, y) = (blocks_mut(&mut s.x, count), blocks_mut(&mut s.y, count));
    let (cos, sin) = (blocks_mut(&mut s.cos, count), blocks_mut(&mut s.sin, count));
    let (vx, vy, omega) = (blocks_mut(&mut s.vx, count), blocks_mut(&mut s.vy, count), blocks_mut(&mut s.omega, count));
    for at in 0..count {
        let (a, b, e) = (ax[at], ay[at], alpha[at]);
        let (mut px, mut py, mut c, mut n) = (x[at], y[at], cos[at], sin[at]);
        let (mut u, mut v, mut o) = (vx[at], vy[at], omega[at]);
        for i in 0..LANES {
            u[i] += h * a[i];
            v[i] += h * b[i];
            o[i] += h * e[i];
            px[i] += h * u[i];
            py[i] += h * v[i];
            (c[i], n[i]) = turned(c[i], n[i], h * o[i]);
        }
        (x[at], y[at], cos[at], sin[at]) = (px, py, c, n);
        (vx[at], vy[at], omega[at]) = (u, v, o);
    }
}

fn rotors(model: &Model, state: &mut State, scratch: &Scratch) {
    let h = model.step_s;
    let r = &mut state.rotors;
    for (k, sprocket) in model.sprockets.iter().enumerate() {
        let before = r.omega[k];
        let after = match sprocket.rotor {
            Rotor::Driven { speed_rad_s } => speed_rad_s,
            Rotor::Free { .. } => before + h * scratch.rotor_alpha[k],
        };
        // Power at the node with the mean of the two half-step speeds: exactly what the kinetic energy gains.
        let mean = 0.5 * (before + after);
        match sprocket.rotor {
            Rotor::Driven { .. } => r.work_in[k] -= scratch.chain_torque[k] * mean * h,
            Rotor::Free { .. } => r.work_out[k] -= sprocket.rotor.outer_torque_nm() * mean * h,
        }
        r.omega[k] = after;
        r.alpha[k] = scratch.rotor_alpha[k];
        r.angle[k] += h * after;
        (r.cos[k], r.sin[k]) = turned(r.cos[k], r.sin[k], h * after);
    }
}

/// Looks whether the chain still holds together; returns the speed of its fastest joint [m/s].
fn check(model: &Model, state: &State, scratch: &Scratch) -> Result<f64, StepError> {
    let t_s = state.step as f64 * model.step_s;
    let mut fastest2 = 0.0_f64;
    for j in 0..model.chain.n_links {
        let (vx, vy) = (scratch.front.vx[j], scratch.front.vy[j]);
        fastest2 = fastest2.max(vx * vx + vy * vy);
        let (dx, dy) = (scratch.front.x[j] - scratch.rear.x[j + 1], scratch.front.y[j] - scratch.rear.y[j + 1]);
        let stretch_m = libm::sqrt(dx * dx + dy * dy);
        if !stretch_m.is_finite() {
            return Err(StepError { t_s, element: format!("joint {j}"), kind: StepErrorKind::NotFinite });
        }
        if stretch_m > 0.2 * model.chain.lever[j] {
            return Err(StepError { t_s, element: format!("joint {j}"), kind: StepErrorKind::Torn { stretch_m } });
        }
    }
    match state.first_not_finite() {
        Some(element) => Err(StepError { t_s, element, kind: StepErrorKind::NotFinite }),
        None => Ok(libm::sqrt(fastest2)),
    }
}
