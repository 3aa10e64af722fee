//! Which scheme a run takes: the leapfrog, or another one that steps from node to node.
//!
//! ```text
//! leapfrog              explicit, contacts as means over a step                      super::explicit
//! hht                   implicit, damps what its step does not resolve               super::implicit
//! predictor_corrector   explicit, steps of its own by their error, ends at touches   super::predictor
//! ```
//! All leave a State of the same form, so that frames, ledger, impacts, break expressions and keyframes are one for all: positions of the
//! node, speeds v - h/2 a, and accelerations, a step back for the leapfrog and of the node itself for the others. These evaluate the node
//! and solve the step that follows in [`evaluate`], where it may fail; [`advance`] commits it.

use super::explicit::{self, Scratch};
use super::implicit::ImplicitStep;
use super::instant::{InstantForces, clear_losses, evaluate_at_node, swap_contacts};
use super::predictor::PredictorStep;
use super::{StepError, StepErrorKind};
use crate::drive::Scheme;
use crate::model::Model;
use crate::state::{ContactMemory, State};

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
        Scheme::Hht { .. } | Scheme::PredictorCorrector { .. } => evaluate_node(model, state, scratch),
    }
}

/// Forward by one step, with what [`evaluate`] has found.
#[inline(always)]
pub fn advance(model: &Model, state: &mut State, scratch: &mut Scratch) {
    match model.scheme {
        Scheme::Leapfrog => explicit::advance(model, state, scratch),
        Scheme::Hht { .. } | Scheme::PredictorCorrector { .. } => advance_node(model, state, scratch),
    }
}

/// Turns a State of the leapfrog, with the step of `leapfrog`, into one of the scheme of `model`, at the same node.
///
/// # Errors
/// As of [`evaluate`].
pub fn begin(leapfrog: &Model, model: &Model, state: &mut State, scratch: &mut Scratch) -> Result<(), StepError> {
    if model.scheme == Scheme::Leapfrog {
        return Ok(());
    }
    explicit::evaluate(leapfrog, state, scratch)?;
    let (half, to_half) = (0.5 * leapfrog.step_s, 0.5 * model.step_s);
    // Speeds of the node; accelerations by its forces follow.
    shift_speeds(state, half, [&scratch.ax, &scratch.ay, &scratch.alpha], &scratch.coordinate_alpha);
    let links = &mut state.links;
    [&mut links.ax, &mut links.ay, &mut links.alpha].into_iter().for_each(|a| a.fill(0.0));
    state.coordinates.alpha.fill(0.0);
    let mut own = Scratch::with_isa(model, scratch.isa);
    let mut work = SchemeWork::new(model, state, &own);
    work.evaluate(model, state, &mut own)?;
    let (links, s) = (&mut state.links, &own);
    for (column, now) in [(&mut links.ax, &s.ax), (&mut links.ay, &s.ay), (&mut links.alpha, &s.alpha)] {
        column.copy_from_slice(now);
    }
    for (k, coordinate) in model.coordinates.iter().enumerate() {
        state.coordinates.alpha[k] = if coordinate.is_free() { s.coordinate_alpha[k] } else { 0.0 };
    }
    let links = state.links.clone();
    let alpha = state.coordinates.alpha.clone();
    shift_speeds(state, -to_half, [&links.ax, &links.ay, &links.alpha], &alpha);
    Ok(())
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
            Scheme::Leapfrog | Scheme::PredictorCorrector { .. } => PREDICTOR_WINDOW_BITS,
        };
        let instant = InstantForces::new(model, state, window_bits, scratch);
        let method = match model.scheme {
            Scheme::Hht { alpha } => Method::Implicit(Box::new(ImplicitStep::new(model, &instant, alpha))),
            Scheme::PredictorCorrector { tolerance_m_s } => {
                Method::Predictor(Box::new(PredictorStep::new(model, &instant, tolerance_m_s)))
            }
            Scheme::Leapfrog => Method::None,
        };
        let windowed = model.stepped_by(Scheme::Leapfrog, instant.window_s());
        SchemeWork { instant, windowed, node: state.clone(), method, by_forces: Vec::new(), end: Default::default() }
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
        let prescribed: Vec<f64> = scratch.coordinate_alpha.clone();
        evaluate_at_node(&self.windowed, node, scratch)?;
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

/// The node, and the step that follows it.
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
    }
    work.instant.finish(&work.end, state);
    scratch.of_scheme = Some(work);
}

/// A step of a scheme that has no solution.
pub(super) fn unsolved(t_s: f64, element: String, residual_m_s: f64) -> StepError {
    StepError { t_s, element, kind: StepErrorKind::Unsolved { residual_m_s } }
}
