//! Which scheme a run takes: the leapfrog, or another one that steps from node to node.
//!
//! ```text
//! leapfrog              explicit, contacts as means over a step                      super::explicit
//! hht                   implicit, damps what its step does not resolve               super::implicit
//! predictor_corrector   explicit, steps of its own by their error, ends at touches   super::predictor
//! moreau                bushes and teeth, and parts that touch, as rigid bodies      super::rigid
//! ```
//! All leave a State of the same form, so that frames, ledger, impacts, break expressions and keyframes are one for all: positions of the
//! node, speeds v - h/2 a, and accelerations: a step back for the leapfrog and for Moreau's scheme, of the node itself for the two others. These
//! evaluate the node and solve the step that follows in [`evaluate`], where it may fail; [`advance`] commits it.

use super::explicit::{self, Scratch};
use super::implicit::ImplicitStep;
use super::instant::{
    InstantForces, ages_of_told, clear_losses, clear_losses_of, evaluate_at_node, renew_told, swap_contacts,
};
use super::predictor::PredictorStep;
use super::rigid::RigidContacts;
use super::{Isa, StepError, StepErrorKind};
use crate::drive::Scheme;
use crate::model::Model;
use crate::state::{ContactMemory, LinkState, State};

/// How a scheme has done in a run.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case", tag = "name")]
pub enum SchemeSummary {
    /// The implicit scheme of Hilber, Hughes and Taylor.
    Hht {
        /// Steps that were solved less closely than others, because forces change at once where contacts begin.
        borne_steps: u64,
        /// Correction of a speed that was left in the worst of all steps [m/s].
        left_m_s: f64,
    },
    /// The scheme of predictor and corrector.
    PredictorCorrector {
        /// Steps of its own.
        own_steps: u64,
        /// Changes of the contacts that it stepped over.
        changes: u64,
    },
    /// The scheme of Moreau and Jean.
    Moreau {
        /// Rounds of the step that took most.
        most_rounds: usize,
        /// Change of a speed in the last round, the largest of all steps [m/s].
        residual_m_s: f64,
        /// Deepest overlap of rigid bodies [m].
        deepest_m: f64,
    },
}

impl SchemeSummary {
    /// The summary in one line.
    pub fn text(&self) -> String {
        match *self {
            SchemeSummary::Hht { borne_steps, left_m_s } => format!(
                "hht, speeds solved to {:.2e} m/s; in {borne_steps} steps no closer than {:.0e} m/s",
                left_m_s,
                super::implicit::SOLVED_M_S
            ),
            SchemeSummary::PredictorCorrector { own_steps, changes } => {
                format!("predictor and corrector, {own_steps} steps of its own, {changes} over changes of contacts")
            }
            SchemeSummary::Moreau { most_rounds, residual_m_s, deepest_m } => format!(
                "moreau, rigid contacts solved to {residual_m_s:.1e} m/s in at most {most_rounds} rounds; deepest overlap {:.2} um",
                deepest_m * 1e6
            ),
        }
    }
}

/// One whole step.
pub fn step(model: &Model, state: &mut State, scratch: &mut Scratch) -> Result<(), StepError> {
    evaluate(model, state, scratch)?;
    advance(model, state, scratch);
    Ok(())
}

/// Forces and accelerations at the node of `state`, into Scratch.
///
/// # Errors
/// The chain has come apart, a value is no number, or a step has no solution.
#[inline(always)]
pub fn evaluate(model: &Model, state: &State, scratch: &mut Scratch) -> Result<(), StepError> {
    match model.scheme {
        Scheme::Leapfrog => explicit::evaluate(model, state, scratch),
        Scheme::Moreau { restitution } => evaluate_rigid(model, restitution, state, scratch),
        Scheme::Hht { .. } | Scheme::PredictorCorrector { .. } => evaluate_node(model, state, scratch),
    }
}

/// Moves the State forward by one step, with what [`evaluate`] has found.
#[inline(always)]
pub fn advance(model: &Model, state: &mut State, scratch: &mut Scratch) {
    match model.scheme {
        Scheme::Leapfrog | Scheme::Moreau { .. } => explicit::advance(model, state, scratch),
        Scheme::Hht { .. } | Scheme::PredictorCorrector { .. } => advance_node(model, state, scratch),
    }
}

/// Turns a State of one model into one of another that is stepped otherwise, at the same node, which counts steps of the other's length.
///
/// # Errors
/// As of [`evaluate`].
pub fn convert(from: &Model, to: &Model, state: &mut State, isa: Isa) -> Result<(), StepError> {
    #[expect(clippy::cast_possible_truncation, reason = "a number of steps, rounded")]
    let renumbered = (state.step as f64 * from.step_s / to.step_s).round() as u64;
    if from.scheme == to.scheme {
        if from.step_s != to.step_s {
            state.restep(from.step_s, to.step_s);
            state.step = renumbered;
        }
        return Ok(());
    }
    let mut scratch = Scratch::with_isa(from, isa);
    evaluate(from, state, &mut scratch)?;
    if from.step_s != to.step_s {
        state.step = renumbered;
    }
    for (memory, now) in state
        .contacts
        .iter_mut()
        .chain([&mut state.touches, &mut state.bores])
        .zip(scratch.contacts.iter().chain([&scratch.touches, &scratch.bores.memory]))
    {
        memory.normal_force.clone_from(&now.normal_force);
        memory.tangential_force.clone_from(&now.tangential_force);
    }
    // Speeds of the node, and accelerations there by its forces.
    let half = 0.5 * from.step_s;
    shift_speeds(state, half, [&scratch.ax, &scratch.ay, &scratch.alpha], &scratch.coordinate_alpha);
    match to.scheme {
        Scheme::Leapfrog | Scheme::Moreau { .. } => {
            take_accelerations(state, &scratch);
            let q = &mut state.coordinates;
            q.alpha.clone_from(&scratch.coordinate_alpha);
            q.omega.iter_mut().zip(&q.alpha).for_each(|(v, a)| *v -= 0.5 * to.step_s * a);
        }
        Scheme::Hht { .. } | Scheme::PredictorCorrector { .. } => {
            let links = &mut state.links;
            [&mut links.ax, &mut links.ay, &mut links.alpha].into_iter().for_each(|a| a.fill(0.0));
            // What is prescribed goes on as it does; what is free is at the node until its accelerations are known.
            let free = |k: usize| to.coordinates[k].is_free();
            let alpha = &mut state.coordinates.alpha;
            for k in 0..alpha.len() {
                alpha[k] = if free(k) { 0.0 } else { scratch.coordinate_alpha[k] };
                state.coordinates.omega[k] -= 0.5 * to.step_s * alpha[k];
            }
            // What is prescribed is half a step back already.
            let mut own = Scratch::with_isa(to, isa);
            SchemeWork::new(to, state, &own).evaluate(to, state, &mut own)?;
            take_accelerations(state, &own);
            for k in (0..state.coordinates.alpha.len()).filter(|k| free(*k)) {
                state.coordinates.alpha[k] = own.coordinate_alpha[k];
                state.coordinates.omega[k] -= 0.5 * to.step_s * own.coordinate_alpha[k];
            }
        }
    }
    let LinkState { vx, vy, omega, ax, ay, alpha, .. } = &mut state.links;
    for (speeds, accelerations) in [(vx, &*ax), (vy, &*ay), (omega, &*alpha)] {
        speeds.iter_mut().zip(accelerations.iter()).for_each(|(v, a)| *v -= 0.5 * to.step_s * a);
    }
    Ok(())
}

/// Accelerations of links as a Scratch has found them, and those by the joints alone.
fn take_accelerations(state: &mut State, s: &Scratch) {
    let l = &mut state.links;
    for (column, now) in [(&mut l.ax, &s.ax), (&mut l.ay, &s.ay), (&mut l.alpha, &s.alpha)] {
        column.copy_from_slice(now);
    }
    for (column, now) in
        [(&mut l.joint_ax, &s.joint_ax), (&mut l.joint_ay, &s.joint_ay), (&mut l.joint_alpha, &s.joint_alpha)]
    {
        column.copy_from_slice(now);
    }
}

/// Adds `time_s` times accelerations to the speeds of links and coordinates.
fn shift_speeds(state: &mut State, time_s: f64, links: [&[f64]; 3], coordinates: &[f64]) {
    let l = &mut state.links;
    for (speeds, accelerations) in [&mut l.vx, &mut l.vy, &mut l.omega].into_iter().zip(links) {
        for (v, a) in speeds.iter_mut().zip(accelerations) {
            *v += time_s * a;
        }
    }
    for (v, a) in state.coordinates.omega.iter_mut().zip(coordinates) {
        *v += time_s * a;
    }
}

/// The window of the implicit scheme is 2^-6 of its step, so that the force of a touch begins within what Newton's method can follow; that
/// of the other one is as short as a moment can be told, because its steps end at touches.
const IMPLICIT_WINDOW_BITS: u32 = 6;
const PREDICTOR_WINDOW_BITS: u32 = 20;

/// What a scheme keeps in Scratch.
struct SchemeWork {
    instant: InstantForces,
    /// The node with the window as its step.
    windowed: Model,
    node: State,
    method: Method,
    told_touches: Vec<(usize, usize)>,
    /// Accelerations by the forces of the node.
    by_forces: Vec<f64>,
    /// Speeds and accelerations at the end of the step.
    end: [Vec<f64>; 2],
}

enum Method {
    /// The leapfrog keeps nothing.
    None,
    Implicit(Box<ImplicitStep>),
    Predictor(Box<PredictorStep>),
}

impl SchemeWork {
    fn new(model: &Model, state: &State, scratch: &Scratch) -> SchemeWork {
        let window_bits = match model.scheme {
            Scheme::Hht { .. } => IMPLICIT_WINDOW_BITS,
            Scheme::Leapfrog | Scheme::Moreau { .. } | Scheme::PredictorCorrector { .. } => PREDICTOR_WINDOW_BITS,
        };
        let instant = InstantForces::new(model, state, window_bits, scratch);
        let method = match model.scheme {
            Scheme::Hht { alpha } => Method::Implicit(Box::new(ImplicitStep::new(model, &instant, alpha))),
            Scheme::PredictorCorrector { tolerance_m_s } => {
                Method::Predictor(Box::new(PredictorStep::new(model, &instant, tolerance_m_s)))
            }
            Scheme::Leapfrog | Scheme::Moreau { .. } => Method::None,
        };
        let windowed = model.stepped_by(Scheme::Leapfrog, instant.window_s());
        SchemeWork {
            instant,
            windowed,
            node: state.clone(),
            method,
            told_touches: Vec::new(),
            by_forces: Vec::new(),
            end: Default::default(),
        }
    }

    /// Forces at the node, into Scratch, with its own accelerations.
    fn evaluate(&mut self, model: &Model, state: &State, scratch: &mut Scratch) -> Result<(), StepError> {
        let (h, window_s) = (model.step_s, self.instant.window_s());
        let node = &mut self.node;
        node.clone_from(state);
        clear_losses(node);
        node.step = state.step * self.instant.ticks();
        let links = &state.links;
        shift_speeds(node, 0.5 * (h - window_s), [&links.ax, &links.ay, &links.alpha], &state.coordinates.alpha);
        for k in (0..model.coordinates.len()).filter(|k| !model.coordinates[*k].is_free()) {
            let next = explicit::next_driver_speed(model, state, scratch, k);
            scratch.coordinate_alpha[k] = (next - state.coordinates.omega[k]) / h;
            node.coordinates.omega[k] = 0.5 * (next + state.coordinates.omega[k]);
            node.coordinates.alpha[k] = 0.0;
        }
        scratch.forget_contacts();
        clear_losses_of(scratch);
        let prescribed: Vec<f64> = scratch.coordinate_alpha.clone();
        ages_of_told(node, &mut self.told_touches);
        evaluate_at_node(&self.windowed, node, scratch)?;
        renew_told(scratch, &self.told_touches);
        self.by_forces = self.instant.gathered(scratch);
        let windows = self.instant.ticks() as f64;
        for (now, past) in scratch.contacts.iter_mut().zip(&state.contacts) {
            over_the_step(now, past, windows);
        }
        over_the_step(&mut scratch.touches, &state.touches, windows);
        over_the_step(&mut scratch.bores.memory, &state.bores, windows);
        for k in (0..model.coordinates.len()).filter(|k| !model.coordinates[*k].is_free()) {
            scratch.coordinate_alpha[k] = prescribed[k];
        }
        Ok(())
    }
}

/// What a set of contacts loses in a step of so many windows, on what it has lost before.
fn over_the_step(now: &mut ContactMemory, past: &ContactMemory, windows: f64) {
    for (lost, before) in now.lost_damping.iter_mut().zip(&past.lost_damping) {
        *lost = before + windows * *lost;
    }
    for (lost, before) in now.lost_friction.iter_mut().zip(&past.lost_friction) {
        *lost = before + windows * *lost;
    }
}

/// Evaluates the node as the leapfrog does, and adds the forces of rigid contacts.
#[cold]
fn evaluate_rigid(model: &Model, restitution: f64, state: &State, scratch: &mut Scratch) -> Result<(), StepError> {
    explicit::evaluate(model, state, scratch)?;
    let kept = scratch.of_scheme.take().and_then(|work| work.downcast::<RigidContacts>().ok());
    let mut work = kept.unwrap_or_default();
    let found = work.add(model, restitution, state, scratch);
    scratch.adds_forces = true;
    scratch.of_scheme = Some(work);
    found
}

/// How a scheme that is not the leapfrog has done since `scratch` was made; None: it is the leapfrog.
pub fn summary(scratch: &Scratch) -> Option<SchemeSummary> {
    let work = scratch.of_scheme.as_ref()?;
    if let Some(rigid) = work.downcast_ref::<RigidContacts>() {
        return Some(rigid.told);
    }
    match &work.downcast_ref::<SchemeWork>()?.method {
        Method::Implicit(step) => Some(step.told),
        Method::Predictor(step) => Some(step.told),
        Method::None => None,
    }
}

/// Evaluates the node, and solves the step that follows it.
#[cold]
fn evaluate_node(model: &Model, state: &State, scratch: &mut Scratch) -> Result<(), StepError> {
    let kept = scratch.of_scheme.take().and_then(|work| work.downcast::<SchemeWork>().ok());
    let mut work = kept.unwrap_or_else(|| Box::new(SchemeWork::new(model, state, scratch)));
    let found = work.evaluate(model, state, scratch).and_then(|()| {
        let SchemeWork { instant, method, by_forces, end, .. } = &mut *work;
        let (speeds, accelerations) = instant.begin(state, scratch);
        *end = match method {
            Method::Implicit(step) => step.solve(instant, by_forces, [&speeds, &accelerations])?,
            Method::Predictor(step) => step.solve(instant, [&speeds, &accelerations])?,
            Method::None => [speeds, accelerations],
        };
        Ok(())
    });
    // Speeds at the node are those of the State: v - h/2 a, and a.
    let links = &state.links;
    for (column, own) in
        [(&mut scratch.ax, &links.ax), (&mut scratch.ay, &links.ay), (&mut scratch.alpha, &links.alpha)]
    {
        column.copy_from_slice(own);
    }
    for k in (0..model.coordinates.len()).filter(|k| model.coordinates[*k].is_free()) {
        scratch.coordinate_alpha[k] = state.coordinates.alpha[k];
    }
    scratch.of_scheme = Some(work);
    found
}

#[cold]
fn advance_node(model: &Model, state: &mut State, scratch: &mut Scratch) {
    let Some(work) = scratch.of_scheme.take() else { return };
    let Ok(work) = work.downcast::<SchemeWork>() else { return };
    let h = model.step_s;
    swap_contacts(state, scratch);
    let (damping, friction) = scratch.joint_powers();
    for (lost, power) in state.lost_pin_damping.iter_mut().zip(damping) {
        *lost += h * power;
    }
    for (lost, power) in state.lost_pin_friction.iter_mut().zip(friction) {
        *lost += h * power;
    }
    let q = &state.coordinates;
    let speeds: Vec<f64> = q.omega.iter().zip(&scratch.coordinate_alpha).map(|(v, a)| v + 0.5 * h * a).collect();
    explicit::add_work(model, &mut state.coordinates, scratch, (h, |k: usize| speeds[k]));
    if let Method::Predictor(step) = &work.method {
        InstantForces::add_to_accounts(step.losses(), state);
        work.instant.tell_touches(state);
    }
    work.instant.finish(&work.end, state);
    model.click(&mut state.coordinates.angle);
    scratch.of_scheme = Some(work);
}

/// A step of a scheme that has no solution.
pub(super) fn unsolved(t_s: f64, element: String, residual_m_s: f64) -> StepError {
    StepError { t_s, element, kind: StepErrorKind::Unsolved { residual_m_s } }
}
