//! Prediction beside simulation: the measured motion corrects the model at every sample, so that noise of a measured force, feedback and drift are
//! forgotten after a while, where a simulation adds them up from its start to its end.
//!
//! ```text
//! x(i | i) = x(i | i-1) + K (y(i) - y(i | i-1))        compared: y(i | i-1) with y(i)
//! ```
//! K is that of a steady Kalman filter for a force that nobody measures and that differs from sample to sample. One number, the share of a
//! difference that the state takes, is chosen by the least error of prediction; with none the prediction is the simulation. What a model leaves
//! then is white if it lacks nothing but such a force. The prediction decides where the simulation ends above the noise, or with a rest that is
//! not white, and where it errs clearly less. What stands by one of both ways alone is told.

use super::accept::{AcceptedResult, accept};
use super::candidates::Sizes;
use super::fit::{FitOptions, fit};
use super::judge;
use super::model::{FIT_ITERATIONS, FittedModel, fit_model, refitted};
use super::problem::Problem;
use super::report::ChannelError;
use super::search::{self, Context};
use super::stats;
use crate::effects::{Physics, sign_blind};
use crate::machine::simulate::{Samples, speed_share};
use crate::machine::{BodyMotion, InputKind, Machine, Reads};
use crate::measurement::Measurement;
use crate::measurement::segments::{Data, MeasuredChannel};
use serde::Serialize;

/// Shares that are tried, and then those halfway to the neighbours of the best. Beyond the last the model would hardly be held against more than
/// the sample before.
const SHARES: [f64; 10] = [0.002, 0.005, 0.012, 0.03, 0.06, 0.12, 0.2, 0.3, 0.45, 0.6];
/// Error of prediction over that of simulation from which on the prediction decides. Not varied.
const WORTH_IT: f64 = 0.97;
/// Iterations of a fit that only chooses the share.
const ITERATIONS: usize = 8;

/// How the accepted set was found where the prediction decided, and what the simulation said.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// Share of the difference between measured and predicted that the state takes at each sample.
    pub share: f64,
    /// Time after which a difference has fallen to a third [s].
    pub memory_s: f64,
    /// Standard deviation of the force that nobody measures, from sample to sample, on each body whose motion is measured.
    pub unmeasured: Vec<UnmeasuredForce>,
    /// Errors of the set that the simulation found, simulated.
    pub simulated: Vec<ChannelError>,
    /// Effects that stand by prediction alone.
    pub by_prediction_alone: Vec<String>,
    /// Effects that stand by simulation alone.
    pub by_simulation_alone: Vec<String>,
}

/// A force that differs from sample to sample, as the prediction takes it to be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UnmeasuredForce {
    /// Name of the body.
    pub body: String,
    /// Standard deviation.
    pub size: f64,
    /// Its unit.
    pub unit: String,
}

/// Whether the records hold motions of free bodies alone, at even times. Forces and accelerations would show what corrects them.
fn is_possible(problem: &Problem) -> bool {
    let (m, data) = (&problem.machine, problem.data);
    // Where a sensor hides the direction, what it shows does not tell where to correct to.
    let hides = m.placed.iter().any(|p| *p.effect == sign_blind::ROW);
    let even = |samples: &Samples| matches!(samples, Samples::Times { even: true, .. });
    let errs = m.placed.iter().any(|p| matches!(p.effect.physics, Physics::Clock(_)));
    m.period_pitches().is_none()
        && !hides
        && !errs
        && data.segments.iter().chain(&data.transfer).all(|s| even(&s.task.samples))
        && data.channels.iter().all(|c| corrects(m, c.sensor))
}

/// Whether a sensor shows the motion of a free body, which a prediction then corrects.
fn corrects(m: &Machine, sensor: usize) -> bool {
    match m.sensors[sensor].reads {
        Reads::Angle(b) | Reads::Speed(b) => m.bodies[b].motion == BodyMotion::Free,
        Reads::Acceleration(_) | Reads::Pulses { .. } | Reads::Tension(_) | Reads::Reaction(_) | Reads::Part(_) => {
            false
        }
    }
}

/// The share with the least error of prediction; None: the simulation is as good.
pub(super) fn share(best: &FittedModel, context: &Context) -> Option<f64> {
    if !is_possible(&best.problem) {
        return None;
    }
    context.report("prediction: choosing how much is corrected");
    let error = |share: f64| {
        let problem = Problem { correction: share, ..best.problem.clone() };
        let found = fit(&problem, &best.fit.point, FitOptions { iterations: ITERATIONS, threads: context.threads });
        judge::mean_error(&judge::fitted_residuals(&problem, &found))
    };
    let mut least =
        WORTH_IT * if best.problem.correction > 0.0 { error(0.0) } else { judge::mean_error(&best.fit_residuals) };
    let mut chosen: Option<usize> = None;
    for (i, share) in SHARES.into_iter().enumerate() {
        let own = error(share);
        if context.must_end() {
            return None;
        }
        if own < least {
            (least, chosen) = (own, Some(i));
        } else if chosen.is_some() {
            break;
        }
    }
    let at = chosen?;
    let neighbours = [at.checked_sub(1), Some(at + 1)].into_iter().flatten().filter_map(|i| SHARES.get(i));
    let mut share = SHARES[at];
    for between in neighbours.map(|other| libm::sqrt(other * SHARES[at])) {
        let own = error(between);
        if own < least && !context.must_end() {
            (least, share) = (own, between);
        }
    }
    Some(share)
}

/// The records, with the noise that predictions have at best: that of the channel and what is not known of the state.
pub(super) fn records(data: &Data, m: &Machine, share: f64) -> Data {
    let mut noisy = data.clone();
    for channel in noisy.channels.iter_mut().filter(|c| corrects(m, c.sensor)) {
        channel.noise /= libm::sqrt(1.0 - share);
    }
    noisy
}

/// The whole search once more, by prediction. The set that the simulation has found takes part.
pub(super) fn search<'a>(
    measurement: &Measurement,
    (machine, data, own): (&Machine, &'a Data, &'a Data),
    simulated: &FittedModel<'a>,
    share: f64,
    context: &'a Context<'a>,
) -> AcceptedResult<'a> {
    context.report("prediction: fitting the declared model");
    let problem = Problem { correction: share, ..search::declared(measurement, machine, data, context) };
    let mut declared = search::baseline(problem, own, context);
    let mut start = declared.fit.point.clone();
    let numbers = start.globals.len();
    start.globals.copy_from_slice(&simulated.fit.point.globals[..numbers]);
    let other = fit_model(declared.problem.clone(), &start, own, Vec::new(), context.threads, FIT_ITERATIONS);
    if other.misfit() < declared.misfit() {
        declared = other;
    }
    search::set_step_limit(&mut declared.problem, &declared.fit.point);
    let all: Vec<usize> = (0..simulated.effects.len()).collect();
    let mut prepared = Vec::new();
    if !all.is_empty() {
        prepared.push(refitted(&declared, simulated, &all, None, own, context.threads, FIT_ITERATIONS));
    }
    let searched = search::search_from(measurement, declared, (Vec::new(), prepared), own, context);
    accept(searched, Some(simulated), own, context)
}

/// Paths of the accepted effects, each with those that cannot be told from it.
fn names(found: &AcceptedResult) -> Vec<Vec<String>> {
    let with_rivals = |(i, h): (usize, &super::candidates::Hypothesis)| {
        let rivals = found.rivals.get(i).into_iter().flatten().map(|r| r.path.clone());
        std::iter::once(h.path()).chain(rivals).collect()
    };
    found.best.effects.iter().enumerate().map(with_rivals).collect()
}

/// What both ways say.
pub(super) fn compared(
    predicted: &AcceptedResult,
    simulated: &AcceptedResult,
    errors: Vec<ChannelError>,
    share: f64,
) -> Prediction {
    let (by_prediction, by_simulation) = (names(predicted), names(simulated));
    let alone = |own: &[Vec<String>], others: &[Vec<String>]| -> Vec<String> {
        let stands = |names: &&Vec<String>| names.iter().any(|n| others.iter().flatten().any(|o| o == n));
        own.iter().filter(|names| !stands(names)).map(|names| names[0].clone()).collect()
    };
    let problem = &predicted.best.problem;
    let step_s = problem.data.segments.iter().find_map(|s| match s.task.samples {
        Samples::Times { step_s, .. } => Some(step_s),
        Samples::Pulses { .. } => None,
    });
    let step_s = step_s.unwrap_or(0.0);
    // The poles of the filter lie at 1 - share for speeds, and at the root of it for angles.
    let is_speed = |c: &MeasuredChannel| matches!(problem.machine.sensors[c.sensor].reads, Reads::Speed(_));
    let by_angle = !problem.data.channels.iter().any(is_speed);
    Prediction {
        share,
        memory_s: if by_angle { 2.0 } else { 1.0 } * step_s / share,
        unmeasured: unmeasured(&predicted.best, share, step_s),
        simulated: errors,
        by_prediction_alone: alone(&by_prediction, &by_simulation),
        by_simulation_alone: alone(&by_simulation, &by_prediction),
    }
}

/// The force from sample to sample for which a filter takes this share. With predictions that err by s: J s share / h where the speed is
/// measured, J s speed_share / h^2 where the angle is.
fn unmeasured(best: &FittedModel, share: f64, step_s: f64) -> Vec<UnmeasuredForce> {
    let (problem, m) = (&best.problem, &best.problem.machine);
    let (values, _) = problem.numbers(0, &best.fit.point.globals, &best.fit.point.locals[0]);
    let of = |(b, body): (usize, &crate::machine::Body)| {
        let inertia = values[body.inertia?];
        // The noise of a channel is that of its predictions here.
        let shown = |reads: Reads| {
            let channel = problem.data.channels.iter().find(|c| m.sensors[c.sensor].reads == reads)?;
            Some(channel.noise / values[m.sensors[channel.sensor].gain].abs().max(1e-300))
        };
        let size = match (shown(Reads::Speed(b)), shown(Reads::Angle(b))) {
            (Some(speed), _) => inertia * speed * share / step_s,
            (None, Some(angle)) => inertia * angle * speed_share(share) / (step_s * step_s),
            (None, None) => return None,
        };
        let unit = if body.slides { "N" } else { "N m" };
        Some(UnmeasuredForce { body: body.name.clone(), size, unit: unit.into() })
    };
    let free = m.bodies.iter().enumerate().filter(|(_, b)| b.motion == BodyMotion::Free);
    free.filter_map(of).collect()
}

/// The unmeasured force counts as small up to this part of the forces that are measured or that accelerate the body (root mean square). Not varied.
const SMALL_FORCE: f64 = 0.3;

/// Whether the force that nobody measures is small beside the others, so that little is laid to it.
pub(super) fn is_small(best: &FittedModel, both: &Prediction) -> bool {
    let problem = &best.problem;
    let sizes = Sizes::new(problem, &best.fit.point);
    both.unmeasured.iter().all(|force| {
        let body = problem.machine.bodies.iter().position(|b| b.name == force.body);
        body.is_none_or(|b| {
            let driven = problem.machine.inputs.iter().enumerate().filter(|(_, i)| i.body == b);
            let inputs = driven.filter_map(|(k, i)| match i.kind {
                InputKind::Force(gain) => {
                    let series: Vec<Vec<f64>> =
                        problem.data.segments.iter().filter_map(|s| s.task.inputs.get(k).cloned()).collect();
                    Some(problem.machine.values[gain].abs() * stats::rms(&series))
                }
                InputKind::Speed | InputKind::Angle => None,
            });
            force.size <= SMALL_FORCE * inputs.fold(sizes.force(b), f64::max)
        })
    })
}
