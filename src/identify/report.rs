//! Final report: outcome, effects with their errors, the tried hypotheses and why they were rejected, errors before and
//! after.

use super::accept::AcceptedResult;
use super::basins::Basin;
use super::by_direction::{FrictionByDirection, friction_by_direction};
use super::declared::DEFAULT_SPREAD;
use super::diagnosis::Diagnosis;
use super::drifting::VaryingNumber;
use super::input_noise::moved_by_input_noise;
use super::inverse::InverseDynamics;
use super::judge::Residuals;
use super::model::{EXPLAINED, FittedModel, NOTHING_LEFT, placed_path, standard_error, standard_errors_off};
use super::predict::Prediction;
use super::problem::{Point, Problem};
use super::rivals::Rival;
use super::search::Trial;
use super::steady::{self, Size};
use super::structure::{self, Collision, Detectable, IndistinguishablePair};
use super::unnamed::Unnamed;
use super::waves::{self, WaveNumber};
use super::{candidates::Hypothesis, stats};
use crate::effects::{Effect, Kind};
use crate::measurement::Measurement;
use crate::measurement::facts::{Clock, Facts};
use crate::measurement::segments::Data;
use crate::measurement::wheels::WheelFacts;
use serde::Serialize;

/// Outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum IdentificationVerdict {
    /// These effects are accepted, and what they leave is noise.
    Named,
    /// These effects are accepted, and something beside noise is left: a cause that is not among them may share in what they take.
    Part,
    /// These effects stand, but with a number of the drive that no machine has or another doubt, or by a search that was cut short.
    Lead,
    /// One of several sets of effects, which these records cannot distinguish.
    Ambiguous,
    /// No effect of the catalogue is accepted.
    None,
}

/// A fitted parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FittedNumber {
    /// Path of the parameter in the drive file.
    pub path: String,
    /// Set if the value holds for one record only.
    pub record: Option<String>,
    /// In the unit of the key, the last part of the path.
    pub value: f64,
    /// One standard deviation, widened where residuals are correlated, in the same unit.
    pub standard_error: f64,
    /// Value in the drive file.
    pub nameplate: Option<f64>,
    /// Difference from the nameplate in standard deviations of the nameplate, where they are given.
    pub nameplate_z: Option<f64>,
    /// The fit ended at a limit of the range, so that the value is not determined.
    pub at_bound: bool,
    /// False: a phase that the fitted data do not determine; a held-out record fits its own.
    pub determined: bool,
    /// The best of a few values that were tried, not fitted.
    pub tried: bool,
}

/// An accepted effect.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NamedEffect {
    /// Name in the catalogue.
    pub name: String,
    /// Family in the catalogue, as printed beside the name.
    pub family: String,
    /// Path in the drive file: `effects.NAME.TARGET`.
    pub path: String,
    /// Path and value, in the unit of the path.
    pub parameters: Vec<FittedNumber>,
    /// Standard error of the first amplitude, in its unit.
    pub standard_error: f64,
    /// Effects that the records cannot distinguish from it.
    pub rivals: Vec<Rival>,
    /// All rivals are of the same family of effects at the same place.
    pub only_its_law_is_open: bool,
    /// Rivals by tooth and link counts: all their orders are also orders of this effect, whatever its shape over the
    /// loop suggests.
    pub by_order: Vec<String>,
    /// Held-out error with it over that without it, with its 95 % interval: value, low, high.
    pub judge_ratio: [f64; 3],
    /// Its size in the halves of every fitted record, relative to its overall size.
    pub sizes: Vec<Size>,
    /// Records that were left out of the fit in turn and used as held-out data, where the regular held-out data do not
    /// show this effect.
    pub judged_by_leaving_out: Vec<String>,
    /// Score without it minus score with it; positive is better.
    pub score: f64,
    /// Share of the squared error that it takes on the records that fit.
    pub gain: f64,
    /// Largest share that the same effect takes when it is shifted in time.
    pub sham_gain: f64,
}

/// Error of a channel in one record or in all records.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelError {
    /// Name of the channel.
    pub channel: String,
    /// Unit of the errors.
    pub unit: String,
    /// None: all records together.
    pub record: Option<String>,
    /// Root mean square, with its 95 % interval by block bootstrap.
    pub fit: Option<f64>,
    /// 95 % interval of `fit`.
    pub fit_interval: Option<[f64; 2]>,
    /// Root mean square over held-out samples; None: the record has none.
    pub held_out: Option<f64>,
    /// 95 % interval of `held_out`.
    pub held_out_interval: Option<[f64; 2]>,
}

/// Noise floor of a channel, and whether the best model reaches it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Floor {
    /// Name of the channel.
    pub channel: String,
    /// Unit of the floor.
    pub unit: String,
    /// Root mean square that the model cannot go below: noise, quantisation, and what does not repeat.
    pub noise_floor: f64,
    /// With link bodies: non-repeating part of the drive's motion (root mean square); part of the floor.
    pub unrepeated: f64,
    /// Held-out error over the floor.
    pub times_floor: f64,
    /// Neighbouring residuals are not correlated.
    pub white: bool,
    /// Correlation of neighbouring residuals.
    pub lag1: f64,
    /// The error is within the limit for the floor, and the residuals are white, or their coloured part is within the
    /// non-repeating part.
    pub reached: bool,
}

/// Error of the fitted model on a record that was neither fitted nor held out for judging.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Transfer {
    /// Name of the record.
    pub record: String,
    /// Name of the channel.
    pub channel: String,
    /// Unit of the errors.
    pub unit: String,
    /// Root mean square of the residuals of the fitted model.
    pub error: f64,
    /// Error of the declared model.
    pub error_before: f64,
    /// Standard deviation of the measurement in this record.
    pub signal: f64,
    /// More than twice the held-out error: another machine, or another state of it.
    pub refused: bool,
}

/// An item of the error budget.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Share {
    /// Path of an effect, `noise floor`, or `not explained`.
    pub of: String,
    /// Share of the declared model's squared error on fitted data, all channels weighted equally [percent].
    pub percent: f64,
}

/// Time series of a record segment for a plot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Name of the record.
    pub record: String,
    /// Name of the channel.
    pub channel: String,
    /// Unit of the values.
    pub unit: String,
    /// Time in the record [s].
    pub t_s: Vec<f64>,
    /// Measured values.
    pub measured: Vec<f64>,
    /// Output of the declared model after its numbers were fitted.
    pub before: Vec<f64>,
    /// Output of the model with the accepted effects.
    pub after: Vec<f64>,
    /// First held-out index.
    pub judge_from: usize,
}

/// Two numbers of which a fit knows one combination far better than each.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Correlation {
    /// Paths in the drive file.
    pub of: [String; 2],
    /// Correlation coefficient of their errors.
    pub coefficient: f64,
}

/// From here on a correlation is told: with one number known, the error of the other would be a fifth.
const CORRELATED: f64 = 0.98;

/// Everything that an identification found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IdentificationReport {
    /// Title of the measurement file.
    pub title: String,
    /// Whether effects were named.
    pub outcome: IdentificationVerdict,
    /// The accepted effects; where the outcome is ambiguous, the best set.
    pub effects: Vec<NamedEffect>,
    /// Pairs of them that are one friction with a size for each direction as well.
    pub by_direction: Vec<FrictionByDirection>,
    /// Every set of effects that was fitted, and why it was not taken.
    pub candidates: Vec<Trial>,
    /// Effects that were not examined, and why.
    pub left_out: Vec<(String, String)>,
    /// Errors of the declared model, its numbers fitted, by channel and record.
    pub error_before: Vec<ChannelError>,
    /// Errors of the model with the accepted effects, by channel and record.
    pub error_after: Vec<ChannelError>,
    /// What the error cannot go below, by channel.
    pub noise_floor: Vec<Floor>,
    /// What is left is white and at the noise floor in every channel.
    pub explained: bool,
    /// Experiments that would decide what these records leave open.
    pub next_experiment: Vec<String>,
    /// A formula without a physical name that holds out of sample, where no effect was named.
    pub unnamed: Option<Unnamed>,
    /// Residuals of the declared model, and of the model with the effects.
    pub diagnosis: Diagnosis,
    /// The same of the model with the accepted effects; None: there are none.
    pub diagnosis_after: Option<Diagnosis>,
    /// Numbers of the declared model, fitted without any effect.
    pub numbers_before: Vec<FittedNumber>,
    /// Numbers of the drive, fitted together with the accepted effects.
    pub numbers_after: Vec<FittedNumber>,
    /// Numbers by inverse dynamics, beside those of the simulation; None where motion and force are not both measured.
    pub inverse_dynamics: Option<InverseDynamics>,
    /// Where prediction decided and not simulation: how much is corrected, and what the simulation said. All errors are then those of prediction.
    pub prediction: Option<Prediction>,
    /// Numbers that differ from record to record, where something is left or a size goes one way with the records; the one that explains most first.
    pub varying: Vec<VaryingNumber>,
    /// What the user should look at before all else: records that contradict each other or the drive file.
    pub look_first: Vec<String>,
    /// Some of that makes a lead of a name.
    pub is_misread: bool,
    /// What speaks against the accepted effects; each makes a LEAD of what would be NAMED.
    pub doubts: Vec<String>,
    /// Where fits of the reported set end that start elsewhere, the reported basin first; empty where none was fitted.
    pub basins: Vec<Basin>,
    /// Numbers, of the drive and of effects, that the records hardly tell apart.
    pub correlations: Vec<Correlation>,
    /// Shares of the declared model's squared error: effects, noise floor, rest.
    pub error_budget: Vec<Share>,
    /// Errors on records that neither fit nor judge.
    pub transfer: Vec<Transfer>,
    /// Effects that cannot be told apart, because tooth and link counts share factors.
    pub collisions: Vec<Collision>,
    /// Smallest size of every effect that these records would show.
    pub detectable: Vec<Detectable>,
    /// Effects whose signals are nearly the same in these records.
    pub alike: Vec<IndistinguishablePair>,
    /// Facts about the samples of every channel and record.
    pub facts: Vec<Facts>,
    /// Facts about the sampling of every record.
    pub clocks: Vec<Clock>,
    /// What the edges of toothed wheels show in every record.
    pub wheels: Vec<WheelFacts>,
    /// What the user should look at before believing the result.
    pub warnings: Vec<String>,
    /// The final fit ended at a minimum.
    pub converged: bool,
    /// The search was stopped from outside; the results so far are reported.
    pub interrupted: bool,
    /// The budget ended before the search was complete.
    pub budget_spent: bool,
    /// Number of simulations that the search took.
    pub model_runs: u64,
    /// XXH3 of the held-out samples, and of the drive.
    pub held_out_hash: String,
    /// XXH3 of the drive file.
    pub drive_hash: String,
    /// Measured and computed series of every segment, for plots.
    #[serde(skip)]
    pub curves: Vec<Curve>,
}

/// Two ways give the same number where they differ by this share at most.
const SAME_NUMBER: f64 = 0.3;

impl IdentificationReport {
    /// Adds what prediction and simulation say of each other. What stands by one of them alone is no name where something is left.
    pub(super) fn predicted(&mut self, both: Prediction) {
        let alone = [(&both.by_prediction_alone, "prediction"), (&both.by_simulation_alone, "simulation")];
        for (paths, way) in alone.into_iter().filter(|_| !self.explained) {
            let own = self.effects.iter().filter(|e| paths.contains(&e.path));
            self.doubts.extend(own.map(|e| format!("`{}` stands by {way} alone, and something is left", e.path)));
        }
        let is_at_the_floor = self.noise_floor.iter().all(|f| f.reached);
        if !self.explained && is_at_the_floor && !self.effects.is_empty() {
            let hides = "predictions leave noise alone, but take up a force that nobody measures and that is too large for noise: other effects may hide in it";
            self.doubts.push(hides.into());
        }
        self.prediction = Some(both);
    }

    /// Numbers by inverse dynamics, those of waves in the form in which their effects are reported.
    pub(super) fn set_inverse_dynamics(&mut self, mut voice: Option<InverseDynamics>) {
        let reported = |path: &str| {
            let mut own = self.effects.iter().flat_map(|e| &e.parameters).filter(|p| p.record.is_none());
            own.find(|p| p.path == path).map(|p| p.value)
        };
        for n in voice.iter_mut().flat_map(|v| &mut v.numbers) {
            let Some(value) = reported(&n.path).filter(|value| *value != n.simulated) else { continue };
            // An amplitude has changed its sign, a phase has turned.
            if value == -n.simulated {
                n.inverse = -n.inverse;
            } else if n.path.ends_with("phase_deg") {
                n.inverse += value - n.simulated;
            }
            n.simulated = value;
        }
        self.inverse_dynamics = voice;
    }

    /// Whether inverse dynamics gives the same number as the simulation.
    pub(super) fn is_confirmed(&self, path: &str) -> bool {
        let numbers = self.inverse_dynamics.iter().flat_map(|i| &i.numbers);
        numbers
            .into_iter()
            .any(|n| n.path == path && (n.inverse - n.simulated).abs() <= SAME_NUMBER * n.simulated.abs())
    }
}

fn numbers(
    model: &FittedModel,
    data: &Data,
    globals: impl Iterator<Item = usize>,
    nameplates: &[f64],
    moved: &[f64],
) -> Vec<FittedNumber> {
    globals
        .map(|g| {
            let global = &model.problem.globals[g];
            let slot = &model.problem.machine.slots[global.slot];
            let x = model.fit.point.globals[g];
            let value = global.law.value(x);
            let se = standard_errors_off(model, g) * standard_error(model, g);
            let se = libm::hypot(se, moved.get(g).copied().unwrap_or(0.0));
            let se = se * if global.law.logarithm { value.abs() } else { global.law.scale };
            // What the records say nothing of has no bound.
            let se = if se.is_nan() { f64::INFINITY } else { se };
            let nameplate = nameplates.get(global.slot).copied();
            let (low, high) = global.law.bounds();
            FittedNumber {
                path: slot.path.clone(),
                record: global.record.map(|r| data.records[r].clone()),
                value: value / slot.unit,
                standard_error: se / slot.unit,
                nameplate: nameplate.map(|n| n / slot.unit),
                nameplate_z: global.prior.filter(|(_, s)| *s != DEFAULT_SPREAD).map(|(mean, s)| (x - mean) / s),
                at_bound: (x <= low || x >= high) && !slot.path.ends_with("phase_deg"),
                determined: !slot.path.ends_with("phase_deg") || se / slot.unit < 180.0,
                tried: false,
            }
        })
        .collect()
}

/// Pairs of numbers whose errors go together, the closest first. A number that holds for one record only has no place here.
fn correlations(model: &FittedModel) -> Vec<Correlation> {
    let covariance = &model.fit.covariance;
    let globals: Vec<usize> =
        (0..model.problem.globals.len()).filter(|g| model.problem.globals[*g].record.is_none()).collect();
    let path = |g: usize| model.problem.machine.slots[model.problem.globals[g].slot].path.clone();
    let mut found = Vec::new();
    for (i, a) in globals.iter().copied().enumerate() {
        for b in globals.iter().copied().skip(i + 1) {
            let coefficient = covariance[(a, b)] / (covariance[(a, a)] * covariance[(b, b)]).sqrt();
            if coefficient.abs() >= CORRELATED {
                found.push(Correlation { of: [path(a), path(b)], coefficient });
            }
        }
    }
    found.sort_by(|p, q| q.coefficient.abs().total_cmp(&p.coefficient.abs()));
    found
}

fn errors(r: &Residuals, data: &Data) -> Vec<ChannelError> {
    let mut all = Vec::new();
    for (c, channel) in data.channels.iter().enumerate() {
        let of = |record: Option<usize>| {
            let pick = |parts: &[Vec<f64>], records: &[usize]| -> Vec<Vec<f64>> {
                let chosen = parts.iter().zip(records).filter(|(_, r)| record.is_none_or(|x| x == **r));
                chosen.map(|(p, _)| p.iter().map(|v| v * channel.shown).collect()).collect()
            };
            let (fit, judge) = (pick(&r.fit[c], &r.fit_record), pick(&r.judge[c], &r.judge_record));
            let one = |parts: &[Vec<f64>]| {
                (parts.iter().map(Vec::len).sum::<usize>() > 0).then(|| stats::rms_interval(parts))
            };
            let (fit, judge) = (one(&fit), one(&judge));
            ChannelError {
                channel: channel.name.clone(),
                unit: channel.unit.clone(),
                record: record.map(|r| data.records[r].clone()),
                fit: fit.map(|x| x[0]),
                fit_interval: fit.map(|x| [x[1], x[2]]),
                held_out: judge.map(|x| x[0]),
                held_out_interval: judge.map(|x| [x[1], x[2]]),
            }
        };
        all.push(of(None));
        if data.records.len() > 1 {
            let own = (0..data.records.len()).map(|k| of(Some(k)));
            all.extend(own.filter(|e| e.fit.is_some() || e.held_out.is_some()));
        }
    }
    all
}

fn floors(best: &FittedModel, data: &Data) -> Vec<Floor> {
    let unrepeated = best.problem.unrepeated(&best.fit.point);
    let unrepeated: Vec<f64> =
        unrepeated.map_or_else(|| vec![0.0; data.channels.len()], |all| all.iter().map(|u| u.size).collect());
    let coloured = best.coloured_rms();
    data.channels
        .iter()
        .enumerate()
        .map(|(c, channel)| {
            let (_, held_out) = best.residuals().rms(c);
            let (fit, _) = best.residuals().rms(c);
            let rms = if best.residuals().judge[c].is_empty() { fit } else { held_out };
            let floor = libm::sqrt(channel.noise * channel.noise + unrepeated[c] * unrepeated[c]).max(1e-300);
            let white = stats::white(&best.residuals().judge[c]) && stats::white(&best.residuals().fit[c]);
            Floor {
                channel: channel.name.clone(),
                unit: channel.unit.clone(),
                noise_floor: channel.noise * channel.shown,
                unrepeated: unrepeated[c] * channel.shown,
                times_floor: rms / floor,
                white,
                reached: rms <= NOTHING_LEFT * floor
                    || rms <= EXPLAINED * floor && (white || coloured[c] <= unrepeated[c]),
                lag1: stats::neighbour_correlation(&best.residuals().fit[c]),
            }
        })
        .collect()
}

/// Amplitudes and phases in the form that tables give them.
fn to_usual_form(effect: &Effect, parameters: &mut [FittedNumber]) {
    let of = |n: &FittedNumber| {
        let key = n.path.rsplit('.').next().unwrap_or_default();
        let row = effect.parameters.iter().find(|p| p.key == key || p.sliding_key == key)?;
        Some(WaveNumber { kind: row.kind, record: n.record.clone(), value: n.value })
    };
    let Some(mut wave) = parameters.iter().map(of).collect::<Option<Vec<WaveNumber>>>() else { return };
    waves::to_usual_form(&mut wave);
    parameters.iter_mut().zip(wave).for_each(|(n, usual)| n.value = usual.value);
}

fn effect(found: &AcceptedResult, which: usize, data: &Data, moved: &[f64]) -> NamedEffect {
    let best = &found.best;
    let h: &Hypothesis = &best.effects[which];
    let path = placed_path(best, which);
    let prefix = format!("{path}.");
    let globals = (0..best.problem.globals.len())
        .filter(|g| best.problem.machine.slots[best.problem.globals[*g].slot].path.starts_with(&prefix));
    // A record that takes no part in the fit has a phase of its own, which is no result.
    let fits = |r: usize| best.problem.data.segments.iter().any(|s| s.record == r && s.judge_from > 0);
    let globals = globals.filter(|g| best.problem.globals[*g].record.is_none_or(fits));
    let mut parameters = numbers(best, data, globals, &[], moved);
    to_usual_form(h.effect, &mut parameters);
    let standard_error = parameters.first().map_or(0.0, |p| p.standard_error);
    // Integers and tried shapes belong to the hypothesis, and to the drive file.
    let keys = best.problem.machine.keys(h.effect, h.target);
    for ((key, row), value) in keys.iter().zip(&h.values) {
        if row.kind.is_whole() || row.kind == Kind::Tried {
            parameters.push(FittedNumber {
                path: format!("{path}.{key}"),
                record: None,
                value: value / row.unit,
                standard_error: 0.0,
                nameplate: None,
                nameplate_z: None,
                at_bound: false,
                determined: true,
                tried: row.kind == Kind::Tried,
            });
        }
    }
    let mut rivals = found.rivals.get(which).cloned().unwrap_or_default();
    let locked = structure::locked_orders(&best.problem.machine, h.effect, h.target);
    let mut by_order: Vec<String> = Vec::new();
    for other in locked.into_iter().filter(|p| best.effects.iter().all(|e| e.path() != *p)) {
        if rivals.iter().all(|r| r.path != other) {
            let tried = found.trials.iter().find(|t| t.identity.starts_with(&other)).and_then(|t| t.score);
            let score = tried.unwrap_or(f64::NAN);
            rivals.push(Rival { identity: other.clone(), path: other.clone(), score, judge_ratio: [f64::NAN; 3] });
        }
        by_order.push(other);
    }
    let kind = |path: &str| {
        let mut words = path.split('.').skip(1);
        let effect = words.next().and_then(crate::effects::named);
        (effect.map(crate::effects::Effect::family), words.collect::<Vec<_>>().join("."))
    };
    let only_its_law_is_open = rivals.iter().all(|r| kind(&r.path) == kind(&h.path()));
    let evidence = found.evidence.get(which);
    NamedEffect {
        name: h.effect.name.to_string(),
        family: h.effect.family().to_string(),
        path,
        parameters,
        standard_error,
        rivals,
        only_its_law_is_open,
        by_order,
        judge_ratio: evidence.map_or([1.0; 3], |g| g.judge_ratio),
        sizes: steady::sizes(best, which),
        judged_by_leaving_out: evidence.map_or_else(Vec::new, |g| g.left_out.clone()),
        score: evidence.map_or(0.0, |g| g.score),
        gain: evidence.map_or(0.0, |g| g.gain),
        sham_gain: evidence.map_or(0.0, |g| g.sham),
    }
}

/// Assembles the report. The caller adds how the search ended.
pub fn report(measurement: &Measurement, data: &Data, found: &AcceptedResult) -> IdentificationReport {
    let best = &found.best;
    let moved = moved_by_input_noise(best, best.threads);
    let effects: Vec<NamedEffect> = (0..best.effects.len()).map(|i| effect(found, i, data, &moved)).collect();
    let noise_floor = floors(best, data);
    let explained = noise_floor.iter().all(|f| f.reached);
    let collisions = structure::collisions_of(&found.declared.problem.machine);
    let outcome = if effects.is_empty() {
        IdentificationVerdict::None
    } else if effects.iter().all(|e| e.only_its_law_is_open) {
        IdentificationVerdict::Named
    } else {
        IdentificationVerdict::Ambiguous
    };
    let mut next_experiment: Vec<String> = Vec::new();
    for e in &effects {
        for r in &e.rivals {
            let text = structure::experiment(&e.path, &r.path);
            if !next_experiment.contains(&text) {
                next_experiment.push(text);
            }
        }
    }
    if !explained && next_experiment.is_empty() {
        next_experiment.push(
            "a channel nearer to the source of the residual, or the same run at another speed and load: the residual does not have the form of any effect in the catalogue".into(),
        );
    }
    let machine = &found.declared.problem.machine;
    let n_declared = found.declared.problem.globals.len();
    IdentificationReport {
        title: measurement.title.clone(),
        outcome,
        error_before: errors(found.declared.residuals(), data),
        error_after: errors(best.residuals(), data),
        numbers_before: numbers(&found.declared, data, 0..n_declared, &machine.values, &[]),
        numbers_after: numbers(best, data, 0..n_declared, &machine.values, &moved),
        correlations: correlations(best),
        error_budget: budget(found),
        transfer: transfer(found, data),
        by_direction: friction_by_direction(&effects, machine),
        effects,
        candidates: found.trials.clone(),
        left_out: found.reasons.clone(),
        noise_floor,
        explained,
        next_experiment,
        unnamed: None,
        diagnosis: Diagnosis::default(),
        diagnosis_after: None,
        collisions,
        detectable: found.detectable.clone(),
        alike: found.alike.clone(),
        facts: data.facts.clone(),
        clocks: data.clocks.clone(),
        wheels: data.wheels.clone(),
        inverse_dynamics: None,
        prediction: None,
        varying: Vec::new(),
        look_first: Vec::new(),
        is_misread: false,
        basins: Vec::new(),
        doubts: Vec::new(),
        warnings: data.warnings.clone(),
        converged: found.declared.fit.converged && best.fit.converged,
        interrupted: false,
        budget_spent: false,
        model_runs: 0,
        held_out_hash: held_out_hash(data),
        drive_hash: format!("{:016x}", twox_hash::XxHash3_64::oneshot(machine.text.as_bytes())),
        curves: curves(found, data),
    }
}

/// Hash of the held-out samples.
fn held_out_hash(data: &Data) -> String {
    let mut all: Vec<f64> = Vec::new();
    for s in &data.segments {
        for m in &s.measured {
            all.extend(&m[s.judge_from.min(m.len())..]);
        }
    }
    format!("{:016x}", twox_hash::XxHash3_64::oneshot(bytemuck::cast_slice(&all)))
}

/// Error on records that were neither fitted nor held out for judging; only their initial states are fitted.
fn transfer(found: &AcceptedResult, data: &Data) -> Vec<Transfer> {
    if data.transfer.is_empty() {
        return Vec::new();
    }
    let mut elsewhere = data.clone();
    elsewhere.segments.clone_from(&data.transfer);
    let own = super::judge::held_out_segments(&elsewhere);
    let residuals = |m: &FittedModel| {
        let mut problem = m.problem.clone();
        problem.data = &elsewhere;
        super::judge::residuals(&problem, &m.fit, &own, 1)
    };
    let (before, after) = (residuals(&found.declared), residuals(&found.best));
    let mut all = Vec::new();
    for (c, channel) in data.channels.iter().enumerate() {
        let (_, judged) = found.best.residuals().rms(c);
        for (k, s) in elsewhere.segments.iter().enumerate() {
            let values: Vec<f64> = s.measured[c].iter().copied().filter(|v| v.is_finite()).collect();
            let n = values.len().max(1) as f64;
            let mean = values.iter().sum::<f64>() / n;
            let signal = libm::sqrt(values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n);
            let rms = |r: &Residuals| stats::rms(&r.judge[c][k..=k]);
            all.push(Transfer {
                record: data.records[s.record].clone(),
                channel: channel.name.clone(),
                unit: channel.unit.clone(),
                error: rms(&after) * channel.shown,
                error_before: rms(&before) * channel.shown,
                signal: signal * channel.shown,
                refused: rms(&after) > 2.0 * judged,
            });
        }
    }
    all
}

/// Share of the declared model's squared error that each effect removes, in the order of acceptance, and the remainder.
fn budget(found: &AcceptedResult) -> Vec<Share> {
    let channels = found.declared.problem.data.channels.len();
    let before = found.declared.residuals();
    // Mean over the channels of squares over those of the declared model.
    let mean = |of: &dyn Fn(usize) -> f64| {
        let share = |c: usize| {
            let ratio = of(c) / stats::rms(&before.fit[c]).max(1e-300);
            if ratio.is_finite() { ratio * ratio } else { 1.0 }
        };
        (0..channels).map(share).sum::<f64>() / channels.max(1) as f64
    };
    let after = found.best.residuals();
    let left = mean(&|c| stats::rms(&after.fit[c]));
    let weights: f64 = found.evidence.iter().map(|g| g.gain.max(0.0)).sum();
    let mut shares: Vec<Share> = found
        .evidence
        .iter()
        .map(|g| Share {
            of: g.identity.clone(),
            percent: 100.0 * (1.0 - left) * g.gain.max(0.0) / weights.max(1e-300),
        })
        .collect();
    if weights <= 0.0 && left < 1.0 {
        // The best start of the same model.
        let of = if found.best.effects.is_empty() { "numbers of the drive" } else { "all effects together" };
        shares.push(Share { of: of.into(), percent: 100.0 * (1.0 - left) });
    }
    let noise = mean(&|c| found.declared.problem.data.channels[c].noise).min(left);
    shares.push(Share { of: "noise floor".into(), percent: 100.0 * noise });
    shares.push(Share { of: "not explained".into(), percent: 100.0 * (left - noise) });
    shares
}

/// Maximum number of segments that are plotted.
const MAX_CURVES: usize = 40;

/// Measured curve, and model before and after, held-out segments first.
fn curves(found: &AcceptedResult, data: &Data) -> Vec<Curve> {
    let mut order: Vec<usize> = (0..data.segments.len()).collect();
    order.sort_by_key(|k| (data.segments[*k].judge_from == data.segments[*k].len(), *k));
    let own = super::judge::held_out_segments(data);
    fn refit<'a>(m: &'a FittedModel, own: &'a Data) -> Option<(Problem<'a>, Point)> {
        super::judge::fit_held_out(&m.problem, &m.fit, own, 1)
    }
    let (before, after) = (refit(&found.declared, &own), refit(&found.best, &own));
    let mut all = Vec::new();
    for k in order.into_iter().take(MAX_CURVES) {
        let s = &data.segments[k];
        let at = own.segments.iter().position(|o| o.record == s.record && o.task.start_s == s.task.start_s);
        let series = |m: &FittedModel, judged: &Option<(Problem, Point)>| -> Vec<Vec<f64>> {
            let model = match (judged, at) {
                (Some((held, point)), Some(at)) if s.judge_from == 0 => {
                    let p = Problem { data, ..held.clone() };
                    p.model(k, &point.globals, &point.locals[at], false)
                }
                _ => m.problem.model(k, &m.fit.point.globals, &m.fit.point.locals[k], false),
            };
            model.unwrap_or_else(|_| vec![vec![f64::NAN; s.len()]; data.channels.len()])
        };
        let (b, a) = (series(&found.declared, &before), series(&found.best, &after));
        let t_s: Vec<f64> = match &s.task.samples {
            crate::machine::simulate::Samples::Times { t_s, .. } => t_s.iter().map(|t| t + s.task.start_s).collect(),
            crate::machine::simulate::Samples::Pulses { .. } => {
                let mut t = s.task.start_s;
                s.measured[0]
                    .iter()
                    .map(|v| {
                        t += if v.is_finite() { libm::exp(*v) } else { 0.0 };
                        t
                    })
                    .collect()
            }
        };
        for (c, channel) in data.channels.iter().enumerate() {
            // Intervals are shown in ms, not as logarithms.
            let shown = |v: &f64| if channel.relative { 1e3 * libm::exp(*v) } else { v * channel.shown };
            all.push(Curve {
                record: data.records[s.record].clone(),
                channel: channel.name.clone(),
                unit: if channel.relative { "ms".into() } else { channel.unit.clone() },
                t_s: t_s.clone(),
                measured: s.measured[c].iter().map(shown).collect(),
                before: b[c].iter().map(shown).collect(),
                after: a[c].iter().map(shown).collect(),
                judge_from: s.judge_from,
            });
        }
    }
    all
}
