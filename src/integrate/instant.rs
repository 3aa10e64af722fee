//! Forces at an instant, for schemes that are not the leapfrog: of joints, contacts, shafts and oil, at positions and speeds that a scheme
//! tries.
//!
//! The kernels are those of the leapfrog. Their forces are means over a step, weighted by a hat; here they are compiled for a window in
//! place of the step, 2^-k of it, so that they are the forces at the node up to (window)^2 / 12 of their second derivative. A window that is
//! not too small keeps a force continuous that jumps where a contact begins: c v, as far as the window has passed the touch. Without that an
//! implicit scheme has steps without a solution.

use super::StepError;
use super::explicit::{self, ContactGroup, Scratch};
use crate::drive::Scheme;
use crate::elements::contact_law::PairRadii;
use crate::elements::coordinate::{CoordinateMotion, turned};
use crate::elements::hydraulics::CoordinateStep;
use crate::model::Model;
use crate::state::{ContactMemory, CoordinateState, OilState, State};

/// Lanes and coordinates that forces move, in the order of the vectors of a scheme: x, y and heading of every link and roller, then
/// coordinates.
#[derive(Clone, Debug)]
pub(super) struct Freedoms {
    pub(super) lanes: Vec<usize>,
    pub(super) coordinates: Vec<usize>,
    /// Coordinates whose motion is given.
    prescribed: Vec<usize>,
}

impl Freedoms {
    fn new(model: &Model) -> Freedoms {
        let own = |k: &usize| model.coordinates[*k].is_free();
        let (coordinates, prescribed) = (0..model.coordinates.len()).partition(own);
        let lanes = model.chain.links().chain(model.chain.all_rollers()).collect();
        Freedoms { lanes, coordinates, prescribed }
    }

    /// Mass or inertia of every freedom [kg, kg m2].
    pub(super) fn masses(&self, model: &Model) -> Vec<f64> {
        let c = &model.chain;
        let of_links = self.lanes.iter().flat_map(|i| [c.mass[*i], c.mass[*i], c.inertia[*i]]);
        of_links.chain(self.coordinates.iter().map(|k| 1.0 / model.coordinates[*k].inverse_inertia())).collect()
    }

    /// Distance at which every freedom moves what it carries [m]: 1 for what slides.
    pub(super) fn arms_m(&self, model: &Model) -> Vec<f64> {
        let of_links = self.lanes.iter().flat_map(|i| [1.0, 1.0, model.chain.lever[*i].max(LEAST_ARM_M)]);
        of_links.chain(self.coordinates.iter().map(|k| model.coordinates[*k].reach_m)).collect()
    }

    /// What a freedom belongs to.
    pub(super) fn name_of(&self, model: &Model, freedom: usize) -> String {
        match self.lanes.get(freedom / 3) {
            Some(lane) => format!("link {lane}"),
            None => {
                let own = self.coordinates.get(freedom - 3 * self.lanes.len());
                own.map_or_else(String::new, |k| model.coordinates[*k].path.clone())
            }
        }
    }

    /// A column of links and one of coordinates, as one vector.
    fn gathered(&self, [x, y, turn]: [&[f64]; 3], coordinates: &[f64]) -> Vec<f64> {
        let of_links = self.lanes.iter().flat_map(|i| [x[*i], y[*i], turn[*i]]);
        of_links.chain(self.coordinates.iter().map(|k| coordinates[*k])).collect()
    }
}

/// Arm of a roller, whose links have none [m]. Only scales what is small.
const LEAST_ARM_M: f64 = 1e-3;

/// What contacts remembered at the beginning of a step.
struct BegunContacts {
    contacts: Vec<ContactMemory>,
    touches: ContactMemory,
    bores: ContactMemory,
}

/// Evaluates forces where a scheme tries the motion to be.
pub(super) struct InstantForces {
    /// With the window as its step.
    model: Model,
    /// The step is so many windows, as a power of two.
    window_bits: u32,
    step_s: f64,
    pub(super) freedoms: Freedoms,
    /// Where the step begins: positions, speeds of the node, oil.
    from: State,
    /// What contacts remembered there.
    begun: BegunContacts,
    /// Where it is tried.
    trial: State,
    scratch: Scratch,
    /// The last moment whose contacts are kept: windows since the beginning of the step, the oil, where the coordinates stand.
    kept: (u64, OilState, Vec<f64>),
    places_between: Vec<f64>,
    works: CoordinateState,
}

impl InstantForces {
    /// For a model, with a window of 2^-`window_bits` of its step.
    pub(super) fn new(model: &Model, state: &State, window_bits: u32, scratch: &Scratch) -> InstantForces {
        let window_s = model.step_s / (1_u64 << window_bits) as f64;
        let windowed = model.stepped_by(Scheme::Leapfrog, window_s);
        InstantForces {
            scratch: Scratch::with_isa(&windowed, scratch.isa),
            model: windowed,
            window_bits,
            step_s: model.step_s,
            freedoms: Freedoms::new(model),
            from: state.clone(),
            begun: BegunContacts {
                contacts: state.contacts.clone(),
                touches: state.touches.clone(),
                bores: state.bores.clone(),
            },
            trial: state.clone(),
            kept: (0, state.oil.clone(), state.coordinates.angle.clone()),
            places_between: vec![0.0; model.coordinates.len()],
            works: state.coordinates.clone(),
        }
    }

    /// Length of the window [s].
    pub(super) fn window_s(&self) -> f64 {
        self.model.step_s
    }

    /// Windows in a step.
    pub(super) fn ticks(&self) -> u64 {
        1 << self.window_bits
    }

    /// Begins a step at a State that holds speeds half a step back and accelerations of its node: speeds and accelerations there.
    /// Contacts remember what `scratch` has found at that node.
    pub(super) fn begin(&mut self, state: &State, scratch: &Scratch) -> (Vec<f64>, Vec<f64>) {
        self.from.clone_from(state);
        self.trial.clone_from(state);
        self.trial.contacts.clone_from(&scratch.contacts);
        self.trial.touches.clone_from(&scratch.touches);
        self.trial.bores.clone_from(&scratch.bores.memory);
        self.begun.contacts.clone_from(&scratch.contacts);
        self.begun.touches.clone_from(&scratch.touches);
        self.begun.bores.clone_from(&scratch.bores.memory);
        clear_losses(&mut self.trial);
        self.scratch.forget_contacts();
        self.kept.0 = 0;
        self.kept.1.clone_from(&state.oil);
        self.kept.2.clone_from(&state.coordinates.angle);
        let half = 0.5 * self.step_s;
        let (l, q) = (&state.links, &state.coordinates);
        let accelerations = self.freedoms.gathered([&l.ax, &l.ay, &l.alpha], &q.alpha);
        let mut speeds = self.freedoms.gathered([&l.vx, &l.vy, &l.omega], &q.omega);
        for (v, a) in speeds.iter_mut().zip(&accelerations) {
            *v += half * a;
        }
        (speeds, accelerations)
    }

    /// Accelerations by the forces `ticks` windows after the beginning of the step, where the motion is tried with these displacements since
    /// then, speeds and accelerations.
    pub(super) fn accelerations(
        &mut self,
        ticks: u64,
        [displacements, speeds, accelerations]: [&[f64]; 3],
    ) -> Result<Vec<f64>, StepError> {
        self.place(ticks, [displacements, speeds, accelerations]);
        self.move_oil(ticks);
        let InstantForces { model, trial, scratch, .. } = self;
        evaluate_at_node(model, trial, scratch)?;
        Ok(self.gathered(&self.scratch))
    }

    /// Accelerations that a Scratch holds.
    pub(super) fn gathered(&self, s: &Scratch) -> Vec<f64> {
        self.freedoms.gathered([&s.ax, &s.ay, &s.alpha], &s.coordinate_alpha)
    }

    /// What a freedom belongs to, for errors.
    pub(super) fn name_of(&self, freedom: usize) -> String {
        self.freedoms.name_of(&self.model, freedom)
    }

    /// Time at which the step begins [s].
    pub(super) fn time_s(&self) -> f64 {
        self.from.step as f64 * self.step_s
    }

    /// Writes a tried motion into the trial State.
    fn place(&mut self, ticks: u64, [displacements, speeds, accelerations]: [&[f64]; 3]) {
        let back_s = 0.5 * self.model.step_s;
        let (from, to) = (&self.from, &mut self.trial);
        to.step = (from.step << self.window_bits) + ticks;
        let n = 3 * self.freedoms.lanes.len();
        let rows = |of: &[f64], at: usize| [of[at], of[at + 1], of[at + 2]];
        for (k, i) in self.freedoms.lanes.iter().enumerate() {
            let [dx, dy, turn] = rows(displacements, 3 * k);
            let ([vx, vy, omega], [ax, ay, alpha]) = (rows(speeds, 3 * k), rows(accelerations, 3 * k));
            let (l, begin) = (&mut to.links, &from.links);
            (l.x[*i], l.y[*i]) = (begin.x[*i] + dx, begin.y[*i] + dy);
            (l.cos[*i], l.sin[*i]) = turned(begin.cos[*i], begin.sin[*i], turn);
            (l.vx[*i], l.vy[*i], l.omega[*i]) = (vx - back_s * ax, vy - back_s * ay, omega - back_s * alpha);
            (l.ax[*i], l.ay[*i], l.alpha[*i]) = (ax, ay, alpha);
        }
        let (q, begin) = (&mut to.coordinates, &from.coordinates);
        for (at, k) in self.freedoms.coordinates.iter().enumerate() {
            let (way, speed, acceleration) = (displacements[n + at], speeds[n + at], accelerations[n + at]);
            q.angle[*k] = begin.angle[*k] + way;
            (q.cos[*k], q.sin[*k]) = turned_far(begin.cos[*k], begin.sin[*k], way);
            (q.omega[*k], q.alpha[*k]) = (speed - back_s * acceleration, acceleration);
        }
        for k in &self.freedoms.prescribed {
            let (way, speed) = prescribed(&self.model, from, self.step_s, ticks as f64 * self.model.step_s, *k);
            q.angle[*k] = begin.angle[*k] + way;
            (q.cos[*k], q.sin[*k]) = turned_far(begin.cos[*k], begin.sin[*k], way);
            (q.omega[*k], q.alpha[*k]) = (speed, 0.0);
        }
    }

    /// Moves the oil from the moment that was kept last to the trial.
    fn move_oil(&mut self, ticks: u64) {
        let Some(oil) = &self.model.oil else { return };
        let (since, kept_oil, from) = &self.kept;
        self.trial.oil.clone_from(kept_oil);
        if ticks == *since {
            return;
        }
        let passed_s = (ticks - since) as f64 * self.model.step_s;
        let to = &self.trial.coordinates.angle;
        for ((middle, a), b) in self.places_between.iter_mut().zip(from).zip(to) {
            *middle = 0.5 * (a + b);
        }
        let speed: Vec<f64> = from.iter().zip(to).map(|(a, b)| (b - a) / passed_s).collect();
        let way = CoordinateStep { from, to, middle: &self.places_between, speed: &speed };
        oil.advance(passed_s, way, &mut self.trial.oil);
    }

    /// The trial, `ticks` windows after the beginning of the step, is where the next ones begin: with what its contacts remember, and its
    /// oil.
    pub(super) fn keep(&mut self, ticks: u64) {
        let InstantForces { trial, scratch, kept, .. } = self;
        kept.0 = ticks;
        kept.1.clone_from(&trial.oil);
        kept.2.clone_from(&trial.coordinates.angle);
        swap_contacts(trial, scratch);
        clear_losses(trial);
        scratch.forget_contacts();
    }

    /// Which contacts carry a force at the trial: bits that differ where a contact begins or ends.
    pub(super) fn touching(&self, into: &mut Vec<bool>) {
        into.clear();
        let scratch = &self.scratch;
        let memories = scratch.contacts.iter().chain([&scratch.touches, &scratch.bores.memory]);
        into.extend(memories.flat_map(|m| m.normal_force.iter().map(|force| *force > 0.0)));
    }

    /// Powers at the trial that are lost or done, in the order of [`InstantForces::add_to_accounts`] [W].
    pub(super) fn powers(&mut self, into: &mut Vec<f64>) {
        into.clear();
        let (scratch, per_s) = (&self.scratch, 1.0 / self.model.step_s);
        let memories = scratch.contacts.iter().chain([&scratch.touches, &scratch.bores.memory]);
        for lost in memories.flat_map(|m| [&m.lost_damping, &m.lost_friction]) {
            into.extend(lost.iter().map(|lost| per_s * lost));
        }
        let (damping, friction) = scratch.joint_powers();
        into.extend_from_slice(damping);
        into.extend_from_slice(friction);
        let half = 0.5 * self.model.step_s;
        let (q, works) = (&self.trial.coordinates, &mut self.works);
        columns_of_work(works).into_iter().for_each(|column| column.fill(0.0));
        explicit::add_work(&self.model, works, scratch, (1.0, |k: usize| q.omega[k] + half * q.alpha[k]));
        columns_of_work(works).into_iter().for_each(|column| into.extend_from_slice(column));
    }

    /// Adds what the springs of contacts still held that carried a force before and do not now: a damper that would pull has ended it. In the
    /// order of [`InstantForces::touching`] and [`InstantForces::powers`].
    pub(super) fn add_parted(&self, [before, now]: [&[bool]; 2], losses: &mut [f64]) {
        let (model, scratch) = (&self.model, &self.scratch);
        let (mut lane_at, mut loss_at) = (0, 0);
        let has_parted = |at: usize| before[at] && !now[at];
        for (memory, part) in scratch.contacts.iter().zip(ContactGroup::ALL) {
            let len = memory.normal_force.len();
            for lane in (0..len).filter(|lane| has_parted(lane_at + lane)) {
                // The laws of which this is lost know a penetration alone.
                let radii = PairRadii { bush_m: f64::NAN, body_m: f64::NAN };
                let law = scratch.law(model, part, lane).filter(|law| law.linear_stiffness_n_per_m().is_some());
                let depth_m = scratch.depth(part, lane);
                losses[loss_at + lane] += law.map_or(0.0, |law| law.elastic(depth_m, radii).energy_j);
            }
            (lane_at, loss_at) = (lane_at + len, loss_at + 2 * len);
        }
        for (i, touch) in model.touches.iter().enumerate().filter(|(i, _)| has_parted(lane_at + i)) {
            let gap_m = touch.shape.gap(&self.trial.coordinates.angle).gap_m;
            losses[loss_at + i] += touch.law.elastic(-gap_m, touch.radii).energy_j;
        }
    }

    /// Adds what was lost and done to the accounts of a State.
    pub(super) fn add_to_accounts(amounts: &[f64], state: &mut State) {
        let State { contacts, touches, bores, lost_pin_damping, lost_pin_friction, coordinates, .. } = state;
        let memories = contacts.iter_mut().chain([touches, bores]);
        let lost = memories.flat_map(|m| [&mut m.lost_damping[..], &mut m.lost_friction[..]]);
        let of_pins = [&mut lost_pin_damping[..], &mut lost_pin_friction[..]];
        let of_work = columns_of_work(coordinates).map(|column| &mut column[..]);
        let mut amounts = amounts.iter();
        for column in lost.chain(of_pins).chain(of_work) {
            for (sum, amount) in column.iter_mut().zip(amounts.by_ref()) {
                *sum += amount;
            }
        }
    }

    /// What contacts that have begun within the step know of their touch, for the State at its end: a speed of approach, and no age yet.
    pub(super) fn tell_touches(&self, state: &mut State) {
        let of_trial = self.trial.contacts.iter().chain([&self.trial.touches, &self.trial.bores]);
        let of_begin = self.begun.contacts.iter().chain([&self.begun.touches, &self.begun.bores]);
        let State { contacts, touches, bores, .. } = state;
        for ((own, now), begun) in contacts.iter_mut().chain([touches, bores]).zip(of_trial).zip(of_begin) {
            for (lane, age) in now.age.iter().enumerate() {
                // A contact that was there before has grown older with every moment that was kept.
                if *age > 0.0 && (*age <= begun.age[lane] || begun.age[lane] == 0.0) {
                    (own.age[lane], own.approach[lane]) = (0.0, now.approach[lane]);
                }
            }
        }
    }

    /// Writes the end of a step into the State it began at: speeds half a step back, accelerations of its node.
    pub(super) fn finish(&self, [speeds, accelerations]: &[Vec<f64>; 2], state: &mut State) {
        let half = 0.5 * self.step_s;
        let n = 3 * self.freedoms.lanes.len();
        let (l, end) = (&mut state.links, &self.trial.links);
        for (k, i) in self.freedoms.lanes.iter().enumerate() {
            let at = 3 * k;
            (l.x[*i], l.y[*i]) = (end.x[*i], end.y[*i]);
            (l.cos[*i], l.sin[*i]) = (end.cos[*i], end.sin[*i]);
            l.vx[*i] = speeds[at] - half * accelerations[at];
            l.vy[*i] = speeds[at + 1] - half * accelerations[at + 1];
            l.omega[*i] = speeds[at + 2] - half * accelerations[at + 2];
            (l.ax[*i], l.ay[*i], l.alpha[*i]) = (accelerations[at], accelerations[at + 1], accelerations[at + 2]);
        }
        let (q, end) = (&mut state.coordinates, &self.trial.coordinates);
        for (at, k) in self.freedoms.coordinates.iter().enumerate() {
            (q.omega[*k], q.alpha[*k]) = (speeds[n + at] - half * accelerations[n + at], accelerations[n + at]);
        }
        for k in &self.freedoms.prescribed {
            // The speed of the step's middle, as the leapfrog has it, and how it goes on from there.
            let middle = (end.angle[*k] - q.angle[*k]) / self.step_s;
            (q.omega[*k], q.alpha[*k]) = (middle, (end.omega[*k] - middle) / half);
        }
        l.joint_ax.clone_from(&self.trial.links.joint_ax);
        l.joint_ay.clone_from(&self.trial.links.joint_ay);
        l.joint_alpha.clone_from(&self.trial.links.joint_alpha);
        q.angle.clone_from(&end.angle);
        q.cos.clone_from(&end.cos);
        q.sin.clone_from(&end.sin);
        state.oil.clone_from(&self.trial.oil);
        state.step += 1;
    }
}

/// Evaluates a State that holds speeds and accelerations of its own node: what the joints do there is known before contacts look at it.
pub(super) fn evaluate_at_node(model: &Model, state: &mut State, scratch: &mut Scratch) -> Result<(), StepError> {
    explicit::joint_accelerations(model, state, scratch);
    for (column, now) in [
        (&mut state.links.joint_ax, &scratch.joint_ax),
        (&mut state.links.joint_ay, &scratch.joint_ay),
        (&mut state.links.joint_alpha, &scratch.joint_alpha),
    ] {
        column.copy_from_slice(now);
    }
    explicit::evaluate(model, state, scratch)?;
    if forget_far(model, state, scratch) {
        explicit::evaluate(model, state, scratch)?;
    }
    Ok(())
}

/// Distance from a contact, over the way that 10 m/s make in a window, beyond which what remembers it has parted long before. assumed.
const FAR_WAYS: f64 = 30.0;
const FAST_M_S: f64 = 10.0;

/// Takes the memory of contacts that are open, far off and pushed all the same: what the means of a step make of a contact that has just
/// parted has no meaning where it parted many windows ago. Returns whether there were any.
fn forget_far(model: &Model, state: &mut State, scratch: &Scratch) -> bool {
    let far_m = -FAR_WAYS * FAST_M_S * model.step_s;
    let mut found = false;
    for ((past, now), group) in state.contacts.iter_mut().zip(&scratch.contacts).zip(&scratch.groups) {
        for lane in 0..now.normal_force.len() {
            if now.normal_force[lane] > 0.0 && group.depth[lane] < far_m {
                forget(past, lane);
                found = true;
            }
        }
    }
    for (i, touch) in model.touches.iter().enumerate() {
        let is_pushed = scratch.touches.normal_force[i] > 0.0;
        if is_pushed && -touch.shape.gap(&state.coordinates.angle).gap_m < far_m {
            forget(&mut state.touches, i);
            found = true;
        }
    }
    found
}

fn forget(memory: &mut ContactMemory, lane: usize) {
    (memory.age[lane], memory.approach[lane]) = (0.0, 0.0);
    (memory.normal_force[lane], memory.tangential_force[lane]) = (0.0, 0.0);
}

/// Cosine and sine of a direction that turns, by any angle: coordinates count their turns beside them.
fn turned_far(cos: f64, sin: f64, turn: f64) -> (f64, f64) {
    let (s, c) = libm::sincos(turn);
    (cos * c - sin * s, sin * c + cos * s)
}

/// Way and speed of a coordinate whose motion is given, `passed_s` after the State `from`, whose steps take `step_s`.
fn prescribed(model: &Model, from: &State, step_s: f64, passed_s: f64, k: usize) -> (f64, f64) {
    let CoordinateMotion::Prescribed { speed_rad_s } = model.coordinates[k].motion else { return (0.0, 0.0) };
    let Some(motion) = &model.driver_motion else { return (passed_s * speed_rad_s, speed_rad_s) };
    let (begin_s, angle) = (from.step as f64 * step_s, from.coordinates.angle[k]);
    let first = motion.speed_rad_s(begin_s, angle);
    let half = 0.5 * passed_s;
    let way = passed_s * motion.speed_rad_s(begin_s + half, angle + half * first);
    (way, motion.speed_rad_s(begin_s + passed_s, angle + way))
}

/// The accounts of coordinates.
fn columns_of_work(q: &mut CoordinateState) -> [&mut Vec<f64>; 6] {
    [&mut q.work_in, &mut q.work_out, &mut q.lost, &mut q.lost_load, &mut q.lost_coupling, &mut q.lost_span]
}

/// Gives an age to contacts that know their speed of approach and have none, and lists them in `told`. The forces then take that speed. Afterwards
/// [`renew_told`] makes these contacts new again.
pub(super) fn ages_of_told(state: &mut State, told: &mut Vec<(usize, usize)>) {
    told.clear();
    let State { contacts, touches, bores, .. } = state;
    for (set, memory) in contacts.iter_mut().chain([touches, bores]).enumerate() {
        for lane in 0..memory.age.len() {
            if memory.age[lane] == 0.0 && memory.approach[lane] > 0.0 {
                memory.age[lane] = 1.0;
                told.push((set, lane));
            }
        }
    }
}

/// Makes the contacts of [`ages_of_told`] that still touch new again.
pub(super) fn renew_told(scratch: &mut Scratch, told: &[(usize, usize)]) {
    let n = scratch.contacts.len();
    for (set, lane) in told {
        let memory = match set.checked_sub(n) {
            None => &mut scratch.contacts[*set],
            Some(0) => &mut scratch.touches,
            Some(_) => &mut scratch.bores.memory,
        };
        memory.age[*lane] = memory.age[*lane].min(1.0);
    }
}

/// Sets what contacts have lost to zero, so that a window's own loss can be read.
pub(super) fn clear_losses(state: &mut State) {
    let State { contacts, touches, bores, .. } = state;
    contacts.iter_mut().chain([touches, bores]).for_each(clear_lost);
}

fn clear_lost(memory: &mut ContactMemory) {
    memory.lost_damping.fill(0.0);
    memory.lost_friction.fill(0.0);
}

/// Sets what the contacts of a Scratch have lost to zero. Blocks that no kernel looks at would keep the losses of an earlier step.
pub(super) fn clear_losses_of(scratch: &mut Scratch) {
    scratch.contacts.iter_mut().chain([&mut scratch.touches, &mut scratch.bores.memory]).for_each(clear_lost);
}

/// Gives what contacts remember from a Scratch to a State, and the State's to the Scratch.
pub(super) fn swap_contacts(state: &mut State, scratch: &mut Scratch) {
    std::mem::swap(&mut state.contacts, &mut scratch.contacts);
    std::mem::swap(&mut state.touches, &mut scratch.touches);
    std::mem::swap(&mut state.bores, &mut scratch.bores.memory);
    std::mem::swap(&mut state.joint_limit, &mut scratch.joint_limit);
}
