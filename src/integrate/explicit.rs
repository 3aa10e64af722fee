//! The explicit scheme: a leapfrog whose forces are means over two steps, weighted by a hat about the node.
//!
//! ```text
//! x(n+1) - 2 x_n + x(n-1) = h^2 a_n      positions are those of the nodes where a_n is the acceleration's mean with the weights
//! v(n+1/2) = v(n-1/2) + h a_n            (1 - |t|/h)/h; v(n+1/2), the mean velocity of a step; headings by Taylor composition
//!
//! 1 joints at x_n, v(n-1/2) + h/2 a(n-1)                   J_n, what they give
//! 2 contacts, with a(n-1) + J_n - J(n-1) from everything   mean over the hat: elements::contact_law
//!   else, and speeds v(n-1/2) + h/2 a(n-1) + h/4 (J_n - J(n-1)); of abutments one after the other: elements::contour_forces
//! 3 joints again at x_n + h^2/12 a and v(n-1/2) + h/4 (a + a(n-1)), a from 1 and 2: their mean over the hat
//! a_n = 2 + 3
//! ```
//! The shift by h^2/12 a is that of Numerov, and of Takahashi and Imada (1984) among the leapfrogs: it takes away what a leapfrog does to
//! frequencies in h^2, and lifts its limit from omega h = 2 to 3.46. That contacts see what the joints do now is worth the most: a
//! step late, peaks at 3.2 us are 4 % high. v + h/4 (a + a(n-1)) errs by h^2/12 a' from the mean velocity and was better than
//! what is exact for smooth motion, by 1 % of a peak at 3.2 us: it leaves less of a touch's jump one step early. Second order with
//! contact as without; the errors of peaks: tests/convergence.rs. [`evaluate`] computes
//! a_n and changes nothing but Scratch, so that a frame can be taken between it and [`advance`]; a step is one after the other.
//! Sums run in chain order or in fixed partial sums, so that no vector width, window or reporting interval changes a bit.

mod abutments;
mod counts;
pub(crate) mod ends;
mod films;
mod flanks;
mod guides;
mod links;
mod pairs;
mod parts;
pub(crate) mod rails;
pub(crate) mod rollers;
mod scratch;
pub(crate) mod shafts;
mod teeth;
pub(crate) mod touches;
pub(crate) mod watch;
mod windows;

pub use counts::{CountedPair, PairCounts};
pub use parts::ContactGroup;
pub use scratch::Scratch;
pub(crate) use scratch::WINDOW_MARGIN_M;
pub use watch::{ContactGroups, ContactValue, Extreme, RequiredData};

use super::{Isa, StepError, StepErrorKind};
use crate::elements::body_frame::{BodyFrame, CoordinateColumns};
use crate::elements::coordinate::{Coordinate, CoordinateMotion, turned};
use crate::geometry::Vec2;
use crate::lanes::{LANES, LaneBlock, blocks, blocks_mut, take};
use crate::model::Model;
use crate::pairs::bush_tooth::Lanes;
use crate::pairs::contour_forces::{BlockStep, PastContacts};
use crate::state::{ContactMemory, CoordinateState, LinkState, State};

/// Extra damping while a drive is run in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunIn {
    /// Rate at which links are drawn to the chain speed along their heading [1/s].
    pub link_rate_per_s: f64,
    /// Rate at which free sprockets are drawn to their nominal speed [1/s].
    pub rotor_rate_per_s: f64,
    /// Steps from the beginning of the run-in to that of the recording.
    pub steps_before: u64,
}

impl RunIn {
    pub const OFF: RunIn = RunIn { link_rate_per_s: 0.0, rotor_rate_per_s: 0.0, steps_before: 0 };
}

/// A run of joints or links near a body, aligned to [`LANES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Window {
    start: usize,
    end: usize,
    /// Another body of the same kind has a window over the same lanes: each lane then counts for its nearest body only.
    shared: bool,
}

/// Share of the room around a body that a joint may cross between two looks: less than half, because body and joint may both
/// move. Twice the share or half of it changes no bit of the bundled drives.
const MOVED_SHARE: f64 = 0.4;
/// Stretch of a joint over half a pitch at which the chain counts as torn. assumed: with their play, joints of the bundled drives
/// stretch by less than a thirtieth of it.
const TORN_SHARE: f64 = 0.2;

/// Share of a plain bearing's clearance beyond which its film is taken for broken. assumed: surfaces are rougher than what is left.
const THINNEST_FILM: f64 = 0.999;

/// One whole step.
pub fn step(model: &Model, state: &mut State, scratch: &mut Scratch) -> Result<(), StepError> {
    evaluate(model, state, scratch)?;
    advance(model, state, scratch);
    Ok(())
}

/// Forces and accelerations at the node of `state`, into Scratch.
pub fn evaluate(model: &Model, state: &State, scratch: &mut Scratch) -> Result<(), StepError> {
    if state.step >= scratch.next_refresh || scratch.next_refresh == 0 {
        scratch.constants.read(model);
        links::end_motion(model, state, scratch);
        // Rails on arms come towards the chain with a speed of their own.
        let columns = coordinate_columns(model, state);
        let of_rails = model.rails.iter().enumerate().map(|(k, r)| {
            let motion = r.frame.motion(&columns);
            motion.omega.abs() * r.reach_m + motion.velocity.norm() + rails::bending_m_s(model, state, k)
        });
        let frames = model.sprockets.iter().map(|s| &s.frame).chain(model.guides.iter().map(|g| &g.frame));
        let of_axes = frames.map(|f| f.motion(&columns).velocity.norm());
        let fastest_m_s = check_joints(model, state, scratch)? + of_rails.chain(of_axes).fold(0.0, f64::max);
        scratch.fastest_m_s = fastest_m_s;
        windows::refresh(model, state, scratch);
        let bearable = (MOVED_SHARE * WINDOW_MARGIN_M / (fastest_m_s * model.step_s).max(1e-300)) as u64;
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
    links::end_motion(model, state, scratch);
    links::predict_from_joints(model, state, scratch);
    if WATCHED && let Some(watched) = &mut scratch.watched {
        watched.clear();
    }
    pairs::contacts::<WATCHED>(model, state, scratch);
    links::apply_contacts(model, state, scratch);
    links::apply_joints(model, state, scratch);
    touches::forces(model, state, scratch);
    coordinate_accelerations(model, state, scratch);
}

/// Lanes that hold links and are nearest to body `k`; None: all of them.
#[inline(always)]
fn owned_lanes(links: Option<[bool; LANES]>, nearest: Option<&[usize]>, k: usize) -> Option<[bool; LANES]> {
    if links.is_none() && nearest.is_none() {
        return None;
    }
    let links = links.unwrap_or([true; LANES]);
    Some(std::array::from_fn(|i| links[i] && nearest.is_none_or(|nearest| nearest[i] == k)))
}

/// Puts lanes that are nearer to another body out of reach.
#[cold]
fn move_out_of_reach(nearest: &[usize], own: usize, lanes: &mut Lanes) {
    for (i, body) in nearest.iter().take(LANES).enumerate() {
        if *body != own {
            lanes.x[i] = crate::state::FAR_AWAY_M;
        }
    }
}

#[inline(always)]
fn write_block(column: &mut [f64], at: usize, values: LaneBlock) {
    column[at..at + LANES].copy_from_slice(&values);
}

/// Forces of a body's contacts, lane by lane: those on the links, which only a body that shifts needs, and torques on the body.
#[derive(Default)]
struct BodyReaction {
    x: LaneBlock,
    y: LaneBlock,
    torque: LaneBlock,
}

impl BodyReaction {
    #[inline(always)]
    fn add(&mut self, shifts: bool, [x, y, torque]: [&LaneBlock; 3]) {
        for i in 0..LANES {
            self.torque[i] += torque[i];
        }
        if shifts {
            for i in 0..LANES {
                self.x[i] += x[i];
                self.y[i] += y[i];
            }
        }
    }

    /// Gives the opposite of the forces on the links, and the torque, to the coordinates of the body.
    #[inline(always)]
    fn give_back(&self, frame: &BodyFrame, forces: &mut [f64]) {
        let sum = |lanes: &LaneBlock| lanes.iter().sum::<f64>();
        frame.give_back(Vec2::new(-sum(&self.x), -sum(&self.y)), sum(&self.torque), forces);
    }
}

/// Contact memory of one kind of part, a block of lanes at a time: what a step finds, and what it leaves.
struct MemoryBlocks<'a> {
    past: MemoryColumns<&'a [LaneBlock]>,
    now: MemoryColumns<&'a mut [LaneBlock]>,
    /// Per block: how many of the two memories that change hands still hold an old contact.
    stale: &'a mut [u8],
}

/// What a group of contacts remembers, for the kernels of guides and rails.
#[inline(always)]
fn memory_of<'a>(state: &'a State, scratch: &'a mut Scratch, group: usize, count: usize) -> MemoryBlocks<'a> {
    MemoryBlocks::new(&state.contacts[group], &mut scratch.contacts[group], &mut scratch.groups[group].stale, count)
}

/// The columns of a [`ContactMemory`].
struct MemoryColumns<T> {
    normal_force: T,
    tangential_force: T,
    age: T,
    approach: T,
    lost_damping: T,
    lost_friction: T,
}

impl<'a> MemoryBlocks<'a> {
    #[inline(always)]
    fn new(past: &'a ContactMemory, now: &'a mut ContactMemory, stale: &'a mut [u8], count: usize) -> Self {
        MemoryBlocks {
            past: MemoryColumns {
                normal_force: blocks(&past.normal_force, count),
                tangential_force: blocks(&past.tangential_force, count),
                age: blocks(&past.age, count),
                approach: blocks(&past.approach, count),
                lost_damping: blocks(&past.lost_damping, count),
                lost_friction: blocks(&past.lost_friction, count),
            },
            now: MemoryColumns {
                normal_force: blocks_mut(&mut now.normal_force, count),
                tangential_force: blocks_mut(&mut now.tangential_force, count),
                age: blocks_mut(&mut now.age, count),
                approach: blocks_mut(&mut now.approach, count),
                lost_damping: blocks_mut(&mut now.lost_damping, count),
                lost_friction: blocks_mut(&mut now.lost_friction, count),
            },
            stale: &mut stale[..count],
        }
    }

    #[inline(always)]
    fn load_past(&self, at: usize, lanes: &mut Lanes) {
        lanes.normal_force = self.past.normal_force[at];
        lanes.tangential_force = self.past.tangential_force[at];
        lanes.age = self.past.age[at];
        lanes.approach = self.past.approach[at];
    }

    #[inline(always)]
    fn past_contacts(&self, at: usize) -> PastContacts {
        let past = &self.past;
        [past.normal_force[at], past.tangential_force[at], past.age[at], past.approach[at]]
    }

    /// As [`MemoryBlocks::keep`].
    #[inline(always)]
    fn store_step(&mut self, at: usize, step: &BlockStep) {
        let (past, now) = (&self.past, &mut self.now);
        now.normal_force[at] = step.normal_force;
        now.tangential_force[at] = step.tangential_force;
        now.age[at] = step.age;
        now.approach[at] = step.approach;
        now.lost_damping[at] = add(past.lost_damping[at], step.lost_damping);
        now.lost_friction[at] = add(past.lost_friction[at], step.lost_friction);
        self.stale[at] = 2;
    }

    /// Gives the contact memory of a block back to its columns.
    #[inline(always)]
    fn store(&mut self, at: usize, lanes: &Lanes) {
        let (past, now) = (&self.past, &mut self.now);
        now.normal_force[at] = lanes.normal_force;
        now.tangential_force[at] = lanes.tangential_force;
        now.age[at] = lanes.age;
        now.approach[at] = lanes.approach;
        now.lost_damping[at] = add(past.lost_damping[at], lanes.lost_damping);
        now.lost_friction[at] = add(past.lost_friction[at], lanes.lost_friction);
        self.stale[at] = 2;
    }

    /// As [`MemoryBlocks::keep`], for the lanes that are the body's own.
    #[cold]
    fn store_lanes(&mut self, own: impl Fn(usize) -> bool, at: usize, lanes: &Lanes) {
        let (past, now) = (&self.past, &mut self.now);
        for i in (0..LANES).filter(|i| own(*i)) {
            now.normal_force[at][i] = lanes.normal_force[i];
            now.tangential_force[at][i] = lanes.tangential_force[i];
            now.age[at][i] = lanes.age[i];
            now.approach[at][i] = lanes.approach[i];
            now.lost_damping[at][i] = past.lost_damping[at][i] + lanes.lost_damping[i];
            now.lost_friction[at][i] = past.lost_friction[at][i] + lanes.lost_friction[i];
        }
        self.stale[at] = 2;
    }

    /// Of a block that nothing touches: forgets old contacts, once for each of the two memories. Returns whether it held any.
    #[inline(always)]
    fn clear_block(&mut self, at: usize) -> bool {
        if self.stale[at] == 0 {
            return false;
        }
        self.stale[at] -= 1;
        let (past, now) = (&self.past, &mut self.now);
        let nothing = [0.0; LANES];
        now.normal_force[at] = nothing;
        now.tangential_force[at] = nothing;
        now.age[at] = nothing;
        now.approach[at] = nothing;
        now.lost_damping[at] = past.lost_damping[at];
        now.lost_friction[at] = past.lost_friction[at];
        true
    }
}

#[inline(always)]
fn add(a: LaneBlock, b: LaneBlock) -> LaneBlock {
    let mut out = a;
    for i in 0..LANES {
        out[i] += b[i];
    }
    out
}

/// Rotation and acceleration of the links `at` .. `at + LANES`, half their pitches and what moves them.
#[inline(always)]
fn load_links(model: &Model, scratch: &Scratch, at: usize, lanes: &mut Lanes) {
    let (c, w) = (&model.chain, &scratch.wrapped);
    lanes.omega = take(&scratch.omega, at);
    (lanes.cos, lanes.sin) = (take(&w.cos, at), take(&w.sin, at));
    (lanes.ax, lanes.ay) = (take(&w.ax, at), take(&w.ay, at));
    lanes.lever = take(&c.lever, at);
    (lanes.inverse_mass, lanes.inverse_inertia) = (take(&c.inverse_mass, at), take(&c.inverse_inertia, at));
}

/// Coordinates from the body's origin; acceleration of the end from that of the link.
#[inline(always)]
fn shift_and_lever(lanes: &mut Lanes, alpha: &LaneBlock, origin_x: f64, origin_y: f64) {
    for i in 0..LANES {
        lanes.x[i] -= origin_x;
        lanes.y[i] -= origin_y;
        lanes.ax[i] -= alpha[i] * lanes.lever[i] * lanes.sin[i];
        lanes.ay[i] += alpha[i] * lanes.lever[i] * lanes.cos[i];
    }
}

/// The columns of all coordinates, as frames of bodies read them.
#[inline(always)]
pub(crate) fn coordinate_columns<'a>(model: &Model, state: &'a State) -> CoordinateColumns<'a> {
    let q = &state.coordinates;
    let (at, cos, sin) = (&q.angle[..], &q.cos[..], &q.sin[..]);
    CoordinateColumns { at, cos, sin, speed: &q.omega, acceleration: &q.alpha, step_s: model.step_s }
}

#[inline(always)]
fn coordinate_accelerations(model: &Model, state: &State, scratch: &mut Scratch) {
    for k in 0..model.coordinates.len() {
        scratch.coordinate_alpha[k] = coordinate_acceleration(model, state, scratch, k);
    }
}

/// Acceleration of a coordinate by the chain and by the parts that have been looked at so far.
#[inline(always)]
fn coordinate_acceleration(model: &Model, state: &State, scratch: &Scratch, k: usize) -> f64 {
    let (q, coordinate) = (&state.coordinates, &model.coordinates[k]);
    let force = scratch.chain_torque[k] + scratch.parts_force[k];
    let own = coordinate.acceleration(model.step_s, q.angle[k], q.omega[k], force);
    let off_nominal = q.omega[k] - coordinate.nominal_speed_rad_s;
    let pull = if coordinate.is_run_in { scratch.run_in.rotor_rate_per_s * off_nominal } else { 0.0 };
    if coordinate.is_free() {
        return own - pull;
    }
    shafts::driver_speed(model, state, scratch, k).map_or(0.0, |next| (next - q.omega[k]) / model.step_s)
}

#[inline(always)]
fn advance_body(model: &Model, state: &mut State, scratch: &mut Scratch) {
    let (n, h) = (model.chain.padded, model.step_s);
    std::mem::swap(&mut state.joint_limit, &mut scratch.joint_limit);
    let s = &mut state.links;
    advance_kernel(h, s, &scratch.ax[..n], &scratch.ay[..n], &scratch.alpha[..n]);
    std::mem::swap(&mut s.ax, &mut scratch.ax);
    std::mem::swap(&mut s.ay, &mut scratch.ay);
    std::mem::swap(&mut s.alpha, &mut scratch.alpha);
    std::mem::swap(&mut s.joint_ax, &mut scratch.joint_ax);
    std::mem::swap(&mut s.joint_ay, &mut scratch.joint_ay);
    std::mem::swap(&mut s.joint_alpha, &mut scratch.joint_alpha);
    let (ld, lf) = (&mut state.lost_pin_damping[..n], &mut state.lost_pin_friction[..n]);
    let (pd, pf) = (&scratch.joint_power_damping[..n], &scratch.joint_power_friction[..n]);
    for j in 0..n {
        ld[j] += h * pd[j];
        lf[j] += h * pf[j];
    }
    std::mem::swap(&mut state.contacts, &mut scratch.contacts);
    if !model.touches.is_empty() {
        std::mem::swap(&mut state.touches, &mut scratch.touches);
    }
    if model.chain.has_rollers() {
        std::mem::swap(&mut state.bores, &mut scratch.bores.memory);
    }
    if model.oil.is_some() {
        scratch.places_before.copy_from_slice(&state.coordinates.angle);
    }
    advance_coordinates(model, state, scratch);
    // What the run-in does to a plunger leaves no trace in its ratchet.
    if scratch.run_in == RunIn::OFF {
        model.click(&mut state.coordinates.angle);
    }
    touches::advance_oil(model, state, scratch);
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

/// Adds what forces on a coordinate do at this speed over a time to its accounts.
#[inline(always)]
fn add_work_of(
    coordinate: &Coordinate,
    r: &mut CoordinateState,
    scratch: &Scratch,
    (k, time_s, speed): (usize, f64, f64),
) {
    match coordinate.motion {
        CoordinateMotion::Prescribed { .. } => {
            r.work_in[k] -= (scratch.chain_torque[k] + scratch.parts_force[k]) * speed * time_s;
        }
        CoordinateMotion::Held => {}
        CoordinateMotion::Free { load, .. } => r.work_out[k] -= (load + scratch.working_force[k]) * speed * time_s,
    }
    if let Some(lost) = r.lost.get_mut(k) {
        *lost += (coordinate.spring.damping * speed - scratch.losing_force[k]) * speed * time_s;
    }
    let shares = [&mut r.lost_load, &mut r.lost_coupling, &mut r.lost_span];
    for (lost, force) in shares.into_iter().zip(&scratch.losing_parts) {
        if let Some(lost) = lost.get_mut(k) {
            *lost -= force[k] * speed * time_s;
        }
    }
}

/// As a step does for its own length: adds what the forces of a node do over a time at the speeds there to the accounts of all coordinates.
pub(super) fn add_work(
    model: &Model,
    accounts: &mut CoordinateState,
    scratch: &Scratch,
    (time_s, speed): (f64, impl Fn(usize) -> f64),
) {
    for (k, coordinate) in model.coordinates.iter().enumerate() {
        add_work_of(coordinate, accounts, scratch, (k, time_s, speed(k)));
    }
}

/// Accelerations by the joints at the node, without what contacts make of them.
pub(super) fn joint_accelerations(model: &Model, state: &State, scratch: &mut Scratch) {
    if scratch.next_refresh == 0 {
        scratch.constants.read(model);
    }
    links::end_motion(model, state, scratch);
    links::predict_from_joints(model, state, scratch);
}

/// Speed in the middle of the coming step of a coordinate whose motion is given [rad/s].
pub(super) fn next_driver_speed(model: &Model, state: &State, scratch: &Scratch, k: usize) -> f64 {
    shafts::driver_speed(model, state, scratch, k).unwrap_or(state.coordinates.omega[k])
}

fn advance_coordinates(model: &Model, state: &mut State, scratch: &Scratch) {
    let h = model.step_s;
    let r = &mut state.coordinates;
    for (k, coordinate) in model.coordinates.iter().enumerate() {
        let before = r.omega[k];
        let after = match coordinate.motion {
            CoordinateMotion::Held => 0.0,
            CoordinateMotion::Prescribed { speed_rad_s } if model.driver_motion.is_none() => speed_rad_s,
            CoordinateMotion::Prescribed { .. } | CoordinateMotion::Free { .. } => {
                before + h * scratch.coordinate_alpha[k]
            }
        };
        // Power at the node with the mean of the two half-step speeds: exactly what the kinetic energy gains.
        add_work_of(coordinate, r, scratch, (k, h, 0.5 * (before + after)));
        r.omega[k] = after;
        r.alpha[k] = scratch.coordinate_alpha[k];
        r.angle[k] += h * after;
        (r.cos[k], r.sin[k]) = turned(r.cos[k], r.sin[k], h * after);
    }
}

/// Looks whether the chain still holds together; returns the speed of its fastest joint [m/s].
fn check_joints(model: &Model, state: &State, scratch: &Scratch) -> Result<f64, StepError> {
    let t_s = state.step as f64 * model.step_s;
    let mut fastest2 = 0.0_f64;
    for j in model.chain.links() {
        let (vx, vy) = (scratch.front.vx[j], scratch.front.vy[j]);
        fastest2 = fastest2.max(vx * vx + vy * vy);
        let (dx, dy) = (scratch.front.x[j] - scratch.rear.x[j + 1], scratch.front.y[j] - scratch.rear.y[j + 1]);
        let stretch_m = libm::sqrt(dx * dx + dy * dy);
        if !stretch_m.is_finite() {
            return Err(StepError { t_s, element: format!("joint {j}"), kind: StepErrorKind::NotFinite });
        }
        if stretch_m > TORN_SHARE * model.chain.lever[j] {
            return Err(StepError { t_s, element: format!("joint {j}"), kind: StepErrorKind::Torn { stretch_m } });
        }
    }
    if let Some(element) = state.first_not_finite() {
        return Err(StepError { t_s, element, kind: StepErrorKind::NotFinite });
    }
    for bearing in &model.bearings {
        let Some((film, _)) = &bearing.film else { continue };
        let way_m = bearing.to_world(bearing.ways.map(|k| state.coordinates.angle[k])).norm();
        if way_m > THINNEST_FILM * film.clearance_m {
            let film_m = film.clearance_m - way_m;
            return Err(StepError { t_s, element: bearing.path.clone(), kind: StepErrorKind::FilmBroken { film_m } });
        }
    }
    Ok(libm::sqrt(fastest2))
}
