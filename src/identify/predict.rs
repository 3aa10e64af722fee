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

use super::accept::{self, AcceptedResult};
use super::candidates::{Hypothesis, Sizes};
use super::declared;
use super::fit::{FitOptions, fit};
use super::judge;
use super::model::{FIT_ITERATIONS, FittedModel, fit_model, refitted};
use super::problem::{Point, Problem};
use super::report::{self, ChannelError, IdentificationReport};
use super::resolved::resolve;
use super::search::{self, Context, SearchResult};
use super::stats;
use crate::effects::{Physics, sign_blind};
use crate::machine::correction::{SteadyFilter, speed_share};
use crate::machine::simulate::Samples;
use crate::machine::{BodyMotion, InputKind, Machine, Reads};
use crate::measurement::Measurement;
use crate::measurement::facts;
use crate::measurement::segments::{Data, MeasuredChannel};
use serde::Serialize;
use std::cell::OnceCell;

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
    /// Standard deviation of the noise that the measured inputs of the body show themselves, from sample to sample; 0 if there are none.
    pub noise_of_inputs: f64,
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
        && data.segments.iter().chain(&data.transfer).all(|s| even(&s.task.samples) && s.behind_s.is_empty())
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

/// The share at which the error of prediction, from the largest share down, is least for the first time; None: the simulation is as good.
fn share(best: &FittedModel, context: &Context) -> Option<f64> {
    if !is_possible(&best.problem) {
        return None;
    }
    context.report("prediction: choosing how much is corrected");
    let fitted = |share: f64, from: &Point| {
        let mut problem = Problem { correction: share, ..best.problem.clone() };
        // Errors are compared here, not numbers.
        problem.machine.refinement = 1;
        let found = fit(&problem, from, FitOptions { iterations: ITERATIONS, threads: context.threads });
        (judge::mean_error(&judge::fitted_residuals(&problem, &found.residuals)), found.point)
    };
    let error = |share: f64, from: &Point| fitted(share, from).0;
    let own = &best.fit.point;
    let simulated =
        if best.problem.correction > 0.0 { error(0.0, own) } else { judge::mean_error(&best.fit_residuals) };
    // From the largest, whose error has fewest minima, each from the numbers of the one before.
    let (mut least, mut chosen, mut from): (f64, Option<usize>, _) = (WORTH_IT * simulated, None, own.clone());
    for (i, share) in SHARES.into_iter().enumerate().rev() {
        let (error, point) = fitted(share, &from);
        if context.must_end() {
            return None;
        }
        if error < least {
            (least, chosen) = (error, Some(i));
        } else if chosen.is_some() {
            break;
        }
        from = point;
    }
    let at = chosen?;
    let neighbours = [at.checked_sub(1), Some(at + 1)].into_iter().flatten().filter_map(|i| SHARES.get(i));
    let mut share = SHARES[at];
    for between in neighbours.map(|other| libm::sqrt(other * SHARES[at])) {
        let own = error(between, &from);
        if own < least && !context.must_end() {
            (least, share) = (own, between);
        }
    }
    Some(share)
}

/// The records and their held-out segments, with the noise that predictions have at best: that of the channel and what is not known of the
/// state.
fn noisy_records(data: &Data, m: &Machine, share: f64) -> (Data, Data) {
    let mut noisy = data.clone();
    for (channel, noise) in noisy.channels.iter_mut().zip(noise_of_predictions(data, m, share)) {
        channel.noise = noise;
    }
    let held_out = judge::held_out_segments(&noisy);
    (noisy, held_out)
}

/// Noise of every channel of predictions: that of its sensor, and what the filter does not know of the state.
fn noise_of_predictions(data: &Data, m: &Machine, share: f64) -> Vec<f64> {
    let noise = |channel: &MeasuredChannel| {
        let (own, sensor) = (channel.sensor_noise, &m.sensors[channel.sensor]);
        if share == 0.0 || !corrects(m, channel.sensor) {
            return own;
        }
        // One sensor alone leaves s / (1 - s) of its variance.
        let alone = noise_of(data, m, sensor.reads).map_or(0.0, |noise| noise * noise * share / (1.0 - share));
        let variance = match sensor.reads {
            Reads::Angle(b) => filter_of(data, m, share, b).map_or(alone, |f| f.variance[0]),
            Reads::Speed(b) => filter_of(data, m, share, b).map_or(alone, |f| f.variance[1]),
            Reads::Acceleration(_) | Reads::Pulses { .. } | Reads::Tension(_) | Reads::Reaction(_) | Reads::Part(_) => {
                alone
            }
        };
        let gain = m.values[sensor.gain];
        libm::sqrt(own * own + gain * gain * variance)
    };
    data.channels.iter().map(noise).collect()
}

/// Noise of the mean of all sensors that show the same of a body; None: there are none.
fn noise_of(data: &Data, m: &Machine, reads: Reads) -> Option<f64> {
    let alike = || data.channels.iter().filter(|c| m.sensors[c.sensor].reads == reads);
    let own = |c: &MeasuredChannel| c.sensor_noise / m.values[m.sensors[c.sensor].gain];
    let squares: f64 = alike().map(own).map(|x| x * x).sum();
    let count = alike().count() as f64;
    (count > 0.0).then(|| libm::sqrt(squares) / count)
}

/// The filter of a body whose angle and speed are both measured.
fn filter_of(data: &Data, m: &Machine, share: f64, body: usize) -> Option<SteadyFilter> {
    let noise = [noise_of(data, m, Reads::Angle(body))?, noise_of(data, m, Reads::Speed(body))?];
    Some(SteadyFilter::new(share, step_of(data), noise))
}

/// The whole search once more, by prediction. The set that the simulation has found takes part.
fn search<'a>(
    measurement: &Measurement,
    (machine, data, own): (&Machine, &'a Data, &'a Data),
    simulated: &FittedModel<'a>,
    share: f64,
    context: &'a Context<'a>,
) -> SearchResult<'a> {
    context.report("prediction: fitting the declared model");
    let problem = Problem { correction: share, ..declared::problem(measurement, machine, data, context) };
    let mut declared = declared::fitted(problem, own, context);
    let mut start = declared.fit.point.clone();
    let numbers = start.globals.len();
    start.globals.copy_from_slice(&simulated.fit.point.globals[..numbers]);
    let other = fit_model(declared.problem.clone(), &start, own, Vec::new(), context.threads, FIT_ITERATIONS);
    if other.misfit() < declared.misfit() {
        declared = other;
    }
    declared::set_step_limit(&mut declared.problem, &declared.fit.point);
    let all: Vec<usize> = (0..simulated.effects.len()).collect();
    let mut prepared = Vec::new();
    if !all.is_empty() {
        prepared.push(refitted(&declared, simulated, &all, None, own, context.threads, FIT_ITERATIONS));
    }
    search::search_from(measurement, declared, (Vec::new(), prepared), own, context)
}

/// Error over the noise from which on a simulation may stand in a wrong minimum.
const LOST: f64 = 5.0;
/// Factor by which the share falls on the way from a prediction to a simulation, and the share from which the simulation is the next.
const SHARE_FALLS: f64 = 5.0;
const LEAST_SHARE: f64 = 0.002;
/// A smaller share tells more. It is kept if its error is at most this multiple of that of the last share that was kept.
const NO_WORSE: f64 = 1.02;
/// Up to this multiple of the noise of a prediction a model follows the records.
const FOLLOWS: f64 = 1.5;

/// Whether a simulation errs by so much that a prediction may know a better start for it.
pub(super) fn is_lost(model: &FittedModel) -> bool {
    model.problem.correction == 0.0 && is_possible(&model.problem) && errs_by_more_than(model, LOST)
}

/// Whether some channel errs by more than a multiple of its noise.
fn errs_by_more_than(model: &FittedModel, times: f64) -> bool {
    let mut channels = model.problem.data.channels.iter().zip(&model.fit_residuals);
    channels.any(|(c, left)| stats::rms(left) > times * c.noise)
}

/// The largest share with which a prediction ends a search: with more it may hide what the search would find.
const SMALL_SHARE: f64 = 0.15;

/// Whether a simulation errs by little more than noise, and a prediction with the same effects leaves noise alone: what is left is a small force
/// that nobody measures, such as the noise of a measured torque, and further effects would only follow its course.
pub(super) fn explains_the_rest(simulated: &FittedModel, context: &Context) -> bool {
    let is_near = simulated.problem.correction == 0.0 && !is_lost(simulated) && !simulated.is_noise_alone();
    if !is_near || context.must_end() {
        return false;
    }
    let Some(share) = share(simulated, context).filter(|share| *share <= SMALL_SHARE) else { return false };
    let (noisy, held_out) = noisy_records(simulated.problem.data, &simulated.problem.machine, share);
    let mut problem = Problem { data: &noisy, correction: share, ..simulated.problem.clone() };
    problem.weights = noisy.channels.iter().map(|c| c.noise.max(1e-12)).collect();
    let (start, effects) = (&simulated.fit.point, simulated.effects.clone());
    let predicted = fit_model(problem, start, &held_out, effects, context.threads, FIT_ITERATIONS);
    predicted.is_noise_alone() && is_small(&predicted, &unmeasured(&predicted, share))
}

/// A search by prediction that was made where the simulation is lost.
pub(super) struct BegunPrediction<'a> {
    /// Share of the differences that the state takes.
    pub share: f64,
    /// Whether this is the least share with which predictions err little, so that no other need be chosen.
    pub is_final: bool,
    pub searched: SearchResult<'a>,
}

/// The search by simulation, from what predictions give where it is lost; and the search by prediction, where the simulation follows the records
/// no better from there.
pub(super) fn from_short_memory<'a>(
    measurement: &Measurement,
    (machine, own): (&Machine, &'a Data),
    searched: SearchResult<'a>,
    records: &'a [OnceCell<(Data, Data)>; 2],
    context: &'a Context<'a>,
) -> (SearchResult<'a>, Option<BegunPrediction<'a>>) {
    if searched.is_drifting {
        return (searched, None);
    }
    let begun = match start(measurement, (machine, own), &searched, records, context) {
        None => None,
        Some(PredictedStart::Simulation(simulated)) => return (simulated.after(searched), None),
        Some(PredictedStart::Prediction(begun)) => Some(begun),
    };
    let explains = |begun: &BegunPrediction| {
        let best = begun.searched.all.first();
        best.is_some_and(|m| m.is_noise_alone() && is_small(m, &unmeasured(m, begun.share)))
    };
    if !searched.is_lost || begun.as_ref().is_some_and(explains) || context.must_end() {
        return (searched, begun);
    }
    // Prediction knows no better: the rounds that were left out.
    let set = searched.all.first().filter(|m| !m.effects.is_empty()).cloned().into_iter().collect();
    let further = search::search_from(measurement, searched.declared.clone(), (set, Vec::new()), own, context);
    (further.after(searched), begun)
}

/// What predictions give where the simulation is lost.
enum PredictedStart<'a> {
    /// A simulation that follows the records.
    Simulation(SearchResult<'a>),
    Prediction(BegunPrediction<'a>),
}

/// Searches by prediction where the simulation is lost. A prediction forgets where it came from, so that its error has fewer minima: it is to a
/// simulation what short stretches of the records are to long ones. The share that errs least while effects are missing hides them, so that it
/// then falls step by step, and what it has hidden is searched wherever the records are no longer followed. It ends at a simulation, if that follows the records; or before, where
/// a motion is too sensitive to its start, or where a force acts that nobody measures.
fn start<'a>(
    measurement: &Measurement,
    (machine, own): (&Machine, &'a Data),
    searched: &SearchResult<'a>,
    [first_records, last_records]: &'a [OnceCell<(Data, Data)>; 2],
    context: &'a Context<'a>,
) -> Option<PredictedStart<'a>> {
    let best = searched.all.first()?;
    if !is_lost(best) || context.must_end() {
        return None;
    }
    let share = share(best, context)?;
    let data = best.problem.data;
    let by_prediction = |records: &'a OnceCell<(Data, Data)>, set: &FittedModel<'a>, share: f64| {
        let (noisy, held_out) = records.get_or_init(|| noisy_records(data, machine, share));
        search(measurement, (machine, noisy, held_out), set, share, context)
    };
    let predicted = by_prediction(first_records, best, share);
    let mut begun = BegunPrediction { share, is_final: false, searched: predicted };
    let set = begun.searched.all.first()?;
    let mut problem = Problem { data, ..set.problem.clone() };
    problem.weights = data.channels.iter().map(|c| c.noise.max(1e-12)).collect();
    let fitted = |problem: Problem<'a>, point: &Point, effects: &[Hypothesis]| {
        fit_model(problem, point, own, effects.to_vec(), context.threads, FIT_ITERATIONS)
    };
    let error = |m: &FittedModel| judge::mean_error(&m.fit_residuals);
    let mut model = fitted(problem, &set.fit.point, &set.effects);
    let follows = |m: &FittedModel| {
        let noise = noise_of_predictions(data, &m.problem.machine, m.problem.correction);
        noise.iter().zip(&m.fit_residuals).all(|(noise, left)| stats::rms(left) <= FOLLOWS * noise)
    };
    let mut least = follows(&model).then(|| model.clone());
    while model.problem.correction > 0.0 && !context.must_end() {
        context.report("prediction: on the way to a simulation");
        let share = if model.problem.correction > LEAST_SHARE { model.problem.correction / SHARE_FALLS } else { 0.0 };
        model = fitted(Problem { correction: share, ..model.problem.clone() }, &model.fit.point, &model.effects);
        if !follows(&model) && share > 0.0 {
            let searched = search(measurement, (machine, data, own), &model, share, context);
            model = searched.all.into_iter().next()?;
        }
        if !follows(&model) {
            break;
        }
        // A simulation adds up what is still missing, and the search goes on from it.
        if share == 0.0 || least.as_ref().is_none_or(|least| error(&model) < NO_WORSE * error(least)) {
            least = Some(model.clone());
        }
    }
    let Some(model) = least.filter(|_| !context.must_end()) else { return Some(PredictedStart::Prediction(begun)) };
    let last = model.problem.correction;
    if last == 0.0 {
        let from = |declared, set| search::search_from(measurement, declared, (set, Vec::new()), own, context);
        return Some(PredictedStart::Simulation(match model.effects.is_empty() {
            true => from(model, Vec::new()),
            false => {
                let mut numbers = searched.declared.fit.point.clone();
                let declared = numbers.globals.len();
                numbers.globals.copy_from_slice(&model.fit.point.globals[..declared]);
                let other = fitted(searched.declared.problem.clone(), &numbers, &[]);
                let is_better = other.misfit() < searched.declared.misfit();
                from(if is_better { other } else { searched.declared.clone() }, vec![model])
            }
        }));
    }
    if last < share {
        begun = BegunPrediction { share: last, is_final: true, searched: by_prediction(last_records, &model, last) };
    }
    Some(PredictedStart::Prediction(begun))
}

/// The second share counts as another one where it is below this part of the first. Not varied.
const SAME_SHARE: f64 = 0.8;

/// What a prediction is held against.
pub(super) struct PredictedRecords<'a> {
    pub data: &'a Data,
    pub machine: &'a Machine,
    /// The machine that knows the noise of its channels.
    pub named: &'a Machine,
    /// The records with the noise of predictions, for the first share and the second.
    pub noisy: &'a [OnceCell<(Data, Data)>; 2],
}

/// What is found and told where predictions err less than the simulation. The first share also corrects what the missing effects do: with the
/// effects that prediction has found, a second share is chosen.
pub(super) fn by_prediction<'a>(
    measurement: &Measurement,
    of: &PredictedRecords<'a>,
    begun: Option<BegunPrediction<'a>>,
    (mut found, mut report): (AcceptedResult<'a>, IdentificationReport),
    context: &'a Context<'a>,
) -> (AcceptedResult<'a>, IdentificationReport) {
    let is_final = begun.as_ref().is_some_and(|b| b.is_final);
    let mut begun = begun;
    for records in of.noisy {
        let last = report.prediction.as_ref().map(|p| p.share);
        let is_done = report.explained && last.is_none() || is_final && last.is_some();
        if context.must_end() || is_done {
            break;
        }
        let (share, searched) = match begun.take() {
            Some(begun) => (begun.share, begun.searched),
            None => {
                let Some(share) = share(&found.best, context) else { break };
                if last.is_some_and(|last| share > SAME_SHARE * last) {
                    break;
                }
                let (noisy, held_out) = records.get_or_init(|| noisy_records(of.data, of.machine, share));
                (share, search(measurement, (of.named, noisy, held_out), &found.best, share, context))
            }
        };
        let noisy = searched.declared.problem.data;
        let held_out = searched.declared.own;
        let mut predicted = accept::accept(searched, Some(&found.best), held_out, context);
        let unresolved = resolve(&mut predicted.best, held_out, context);
        if context.must_end() {
            let cut = "the search ended before all was predicted: names and errors are those of the way before";
            report.warnings.push(cut.into());
            break;
        }
        let simulated = report.prediction.take().map_or_else(|| report.error_after.clone(), |p| p.simulated);
        let both = compared(&predicted, &found, simulated, share);
        let mut second = report::report(measurement, noisy, &predicted);
        second.explained &= is_small(&predicted.best, &both.unmeasured);
        if second.effects.is_empty() && !second.explained && !report.effects.is_empty() {
            let alone = "prediction finds none of these effects, and leaves something too";
            report.doubts.push(alone.into());
            break;
        }
        second.warnings.extend(unresolved);
        if !second.explained {
            second.varying = report.varying;
        }
        report = second;
        report.predicted(both);
        found = predicted;
    }
    (found, report)
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
fn compared(
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
    let step_s = sample_step(problem);
    // The poles of the filter lie at 1 - share for speeds, and at the root of it for angles.
    let is_speed = |c: &MeasuredChannel| matches!(problem.machine.sensors[c.sensor].reads, Reads::Speed(_));
    let by_angle = !problem.data.channels.iter().any(is_speed);
    let by_one = if by_angle { 2.0 } else { 1.0 } * step_s / share;
    let filters = (0..problem.machine.bodies.len()).filter_map(|b| filter_of(problem.data, &problem.machine, share, b));
    let of_both = filters.map(|f| f.memory_s(step_s));
    Prediction {
        share,
        memory_s: of_both.reduce(f64::max).unwrap_or(by_one),
        unmeasured: unmeasured(&predicted.best, share),
        simulated: errors,
        by_prediction_alone: alone(&by_prediction, &by_simulation),
        by_simulation_alone: alone(&by_simulation, &by_prediction),
    }
}

/// Time between two samples [s].
fn sample_step(problem: &Problem) -> f64 {
    step_of(problem.data)
}

fn step_of(data: &Data) -> f64 {
    let step_s = data.segments.iter().find_map(|s| match s.task.samples {
        Samples::Times { step_s, .. } => Some(step_s),
        Samples::Pulses { .. } => None,
    });
    step_s.unwrap_or(0.0)
}

/// The force from sample to sample for which a filter takes this share. With predictions that err by s: J s share / h where the speed is
/// measured, J s speed_share / h^2 where the angle is.
pub(super) fn unmeasured(best: &FittedModel, share: f64) -> Vec<UnmeasuredForce> {
    let step_s = sample_step(&best.problem);
    let (problem, m) = (&best.problem, &best.problem.machine);
    let (values, _) = problem.numbers(0, &best.fit.point.globals, &best.fit.point.locals[0]);
    let of = |(b, body): (usize, &crate::machine::Body)| {
        let inertia = values[body.inertia?];
        // A prediction from this sensor alone errs by its noise over sqrt(1 - share).
        let shown = |reads: Reads| {
            let channel = problem.data.channels.iter().find(|c| m.sensors[c.sensor].reads == reads)?;
            Some(
                channel.sensor_noise
                    / libm::sqrt(1.0 - share)
                    / values[m.sensors[channel.sensor].gain].abs().max(1e-300),
            )
        };
        let size = match (shown(Reads::Speed(b)), shown(Reads::Angle(b))) {
            (Some(speed), _) => inertia * speed * share / step_s,
            (None, Some(angle)) => inertia * angle * speed_share(share) / (step_s * step_s),
            (None, None) => return None,
        };
        let unit = if body.slides { "N" } else { "N m" };
        let noise_of_inputs = noise_of_inputs(problem, b);
        Some(UnmeasuredForce { body: body.name.clone(), size, unit: unit.into(), noise_of_inputs })
    };
    let free = m.bodies.iter().enumerate().filter(|(_, b)| b.motion == BodyMotion::Free);
    free.filter_map(of).collect()
}

/// Noise that the measured forces on a body show, from sample to sample: a root mean square over the records.
fn noise_of_inputs(problem: &Problem, body: usize) -> f64 {
    let of = |(k, gain): (usize, f64)| {
        let noises: Vec<f64> = problem
            .data
            .segments
            .iter()
            .filter_map(|s| s.task.inputs.get(k).map(|own| gain * facts::noise_beside_smooth(own)))
            .collect();
        stats::rms(&[noises])
    };
    let own = forces_on(problem, body);
    libm::sqrt(own.into_iter().map(of).map(|noise| noise * noise).sum())
}

/// The inputs that are forces on a body: index and gain.
fn forces_on(problem: &Problem, body: usize) -> Vec<(usize, f64)> {
    let m = &problem.machine;
    let own = m.inputs.iter().enumerate().filter(|(_, i)| i.body == body);
    own.filter_map(|(k, i)| match i.kind {
        InputKind::Force(gain) => Some((k, m.values[gain].abs())),
        InputKind::Speed | InputKind::Angle | InputKind::Acceleration => None,
    })
    .collect()
}

/// The unmeasured force counts as small up to this part of the forces that are measured or that accelerate the body (root mean square). Not varied.
const SMALL_FORCE: f64 = 0.3;
/// It also counts as small up to this multiple of the noise that the measured forces show themselves, for that explains it; but not beyond this
/// part of the forces. Not varied.
const SHOWN_NOISE: f64 = 1.25;
const NO_LARGER: f64 = 0.6;

/// Whether the force that nobody measures is small beside the others, so that little is laid to it.
fn is_small(best: &FittedModel, unmeasured: &[UnmeasuredForce]) -> bool {
    let problem = &best.problem;
    let sizes = Sizes::new(problem, &best.fit.point);
    unmeasured.iter().all(|force| {
        let body = problem.machine.bodies.iter().position(|b| b.name == force.body);
        body.is_none_or(|b| {
            let inputs = forces_on(problem, b).into_iter().map(|(k, gain)| {
                let series: Vec<Vec<f64>> =
                    problem.data.segments.iter().filter_map(|s| s.task.inputs.get(k).cloned()).collect();
                gain * stats::rms(&series)
            });
            let largest = inputs.fold(sizes.force(b), f64::max);
            let is_seen = force.size <= SHOWN_NOISE * force.noise_of_inputs && force.size <= NO_LARGER * largest;
            force.size <= SMALL_FORCE * largest || is_seen
        })
    })
}
