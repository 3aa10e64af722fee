//! Acceptance of search results: the accepted set of effects, and the evidence for each effect.
//!
//! An effect is accepted when all of these hold: its score gain is large enough; the held-out error (that of its own
//! channel, for an effect on a sensor) significantly falls by a twentieth or loses half of its part above the noise; it
//! explains more than a sham; its size is three standard errors from zero and the same in all records; and its form lies inside the records
//! ([`super::plausible`]); and no force of another form fits better in its place. A set that leaves most of the error above the noise is only a lead and is not
//! reported as a finding.

use super::candidates::Hypothesis;
use super::crossed::{HeldOutComparison, compare_held_out};
use super::judge::{Residuals, deviance, effective as effective_samples, mean_error};
use super::model::{
    FIT_ITERATIONS, FittedModel, fitted_values, globals_of, promised_score, refitted, score, standard_error,
    without_effect,
};
use super::plausible::outside_the_records;
use super::problem::Problem;
use super::rivals::{Rival, rival_of, rivals};
use super::screen::{FitStart, LinearisedBase, screen};
use super::search::{Context, MIN_SCORE_GAIN, SearchResult, Trial};
use super::stats::Random;
use super::steady;
use super::structure::{Detectable, IndistinguishablePair};
use super::unnamed;
use crate::drive::sensors::is_signal;
use crate::measurement::segments::Data;
use crate::side_by_side::parallel;
use std::borrow::Cow;

/// Result of the acceptance.
pub struct AcceptedResult<'a> {
    pub declared: FittedModel<'a>,
    pub best: FittedModel<'a>,
    /// For every effect of the best model: the effects that the records cannot distinguish from it.
    pub rivals: Vec<Vec<Rival>>,
    pub trials: Vec<Trial>,
    pub reasons: Vec<(String, String)>,
    /// For every effect of the best model: the evidence on which it was accepted.
    pub evidence: Vec<Evidence>,
    pub detectable: Vec<Detectable>,
    pub alike: Vec<IndistinguishablePair>,
    pub cut_short: bool,
}

/// Evidence for an accepted effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    pub identity: String,
    /// Held-out error with the effect, relative to that without it, and its interval.
    pub judge_ratio: [f64; 3],
    /// Records that were left out of the fit in turn and used as held-out data, where the regular held-out data do not
    /// show the effect.
    pub left_out: Vec<String>,
    /// Remaining error with the effect.
    pub remaining: RemainingError,
    /// Score without the effect minus score with it.
    pub score: f64,
    /// Share of the cost that the effect removes; `sham` is the same for its shams.
    pub gain: f64,
    pub sham: f64,
}

/// Two sets are rivals if their scores differ by less than this: twice the natural logarithm of a likelihood ratio of
/// 150.
pub(super) const CLEAR_SCORE_GAP: f64 = 10.0;
/// An effect that leaves more than this fraction of the held-out error is not named: its contribution is less than a
/// third of the remaining error.
pub(super) const MAX_REMAINING_SHARE: f64 = 0.95;
/// A set that leaves more than this fraction of the squared error above the noise floor does not explain it: near the
/// floor, and far from it. In 230 blind cases whose cause is in the catalogue, the named effects left at most 48 % near
/// the floor and 10 % far from it; where the catalogue lacks the cause, 3 to 53 %. A stricter limit would reject
/// effects of machines with several causes.
const MAX_ABOVE_FLOOR: f64 = 2.0 / 3.0;
const MAX_ABOVE_FLOOR_FAR: f64 = 0.4;
/// Close to the noise floor an effect is also named if it removes half of the squared error above the floor, provided
/// that it lowers the error by a hundredth and that the squared error exceeds the floor by a hundredth.
const MAX_ABOVE_FLOOR_NEAR: f64 = 0.5;
const MIN_EXCESS: f64 = 0.01;
// Measured with twice and half of each of the following on the 16 cases of tests/blind_share.rs: `MAX_ABOVE_FLOOR_NEAR`, `MIN_EXCESS`, `SHAM_GAINS` and
// `SURE` each name a case more or less, never a false one; `SHAM_REMAINDER` changes no name.
/// An effect must explain so many times as much as a sham, or leave at most this fraction of what the sham leaves.
const SHAM_GAINS: f64 = 3.0;
const SHAM_REMAINDER: f64 = 0.8;
/// Standard errors by which the size of an effect must differ from nothing: 0.3 % by chance, were they normal.
pub(super) const SURE: f64 = 3.0;
/// Noise over the held-out error at least, where a channel states none: what is left is then all above the floor.
const LEAST_NOISE: f64 = 1e-6;
/// Number of shams with which each effect is compared.
const SHAM_COUNT: usize = 40;

/// Selects the set to be examined: of every size the best set whose effects are all accepted; a larger set only if it
/// leaves clearly less error. With many samples even small differences are significant, but they do not justify a name.
fn smallest_confirmed_set<'a>(
    declared: &FittedModel<'a>,
    all: &[FittedModel<'a>],
    effective: &[f64],
    refused: &[Vec<String>],
    own: &'a Data,
    threads: usize,
) -> FittedModel<'a> {
    let mut best = Cow::Borrowed(declared);
    for size in 1..=declared.problem.machine.effort().effects {
        if best.is_exhausted() {
            break;
        }
        // In the order of their scores.
        let looked_at = |m: &&FittedModel| m.effects.len() == size && !refused.contains(&m.identity());
        let next = all.iter().filter(looked_at).find_map(|m| {
            if score(&best, effective) - promised_score(m, effective) < MIN_SCORE_GAIN {
                return None;
            }
            let m = m.finished();
            let is_new = |e: &usize| best.effects.iter().all(|o| o.identity() != m.effects[*e].identity());
            let new: Vec<usize> = (0..m.effects.len()).filter(is_new).collect();
            let gain = score(&best, effective) - score(&m, effective);
            let is_next =
                is_better(&m, &best, &new, gain, own, threads) && all_effects_improve(&m, all, effective, own, threads);
            is_next.then(|| m.into_owned())
        });
        best = next.map_or(best, Cow::Owned);
    }
    best.into_owned()
}

/// Whether the held-out data confirm that a set is better than the same set without some effects, whose score is worse
/// by `gain`.
fn is_better(
    with: &FittedModel,
    without: &FittedModel,
    effects: &[usize],
    gain: f64,
    own: &Data,
    threads: usize,
) -> bool {
    if gain < MIN_SCORE_GAIN {
        return false;
    }
    let judged = compare_held_out(with, without, effects, own, threads);
    // The held-out data do not determine the drive's parameters, so their likelihood counts in full, minus a penalty
    // for the parameters that belong to the held-out records and segments alone.
    let samples = effective_samples(&judged.with.judge);
    let price = held_out_parameters(with, effects, own) as f64 * libm::log(samples.iter().sum::<f64>().max(2.0));
    let predicted = deviance(&judged.without.judge, &samples) - deviance(&judged.with.judge, &samples) - price;
    let on_sensor = effects.iter().any(|e| is_signal(with.effects[*e].effect));
    let left = remaining_error(on_sensor, &with.problem, &judged);
    gain + predicted >= MIN_SCORE_GAIN && left.justifies_a_name() && judged.with.judge_ratio(&judged.without)[2] < 1.0
}

/// Number of these effects' parameters that held-out segments fit for themselves: phases, and states at their start.
fn held_out_parameters(model: &FittedModel, effects: &[usize], own: &Data) -> usize {
    let fits = |r: usize| model.problem.data.segments.iter().any(|s| s.record == r && s.judge_from > 0);
    let mut records: Vec<usize> = own.segments.iter().map(|s| s.record).filter(|r| !fits(*r)).collect();
    records.sort_unstable();
    records.dedup();
    let of = |e: &usize| {
        let h = &model.effects[*e];
        let phases = if h.phase().is_some() { records.len() } else { 0 };
        phases + h.own_locals * own.segments.len()
    };
    effects.iter().map(of).sum()
}

/// Error that remains with a set, relative to that of another set, on the held-out data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemainingError {
    /// Ratio of the errors: of all channels; for an effect on a sensor, which no other channel shows, of the channel
    /// that gains most.
    pub error: f64,
    /// Ratio of the squared errors above the noise floor, all channels scaled by their noise. None if that part is
    /// negligible, and where the floor contains more than noise.
    pub above_floor: Option<f64>,
}

impl RemainingError {
    fn justifies_a_name(self) -> bool {
        self.error <= MAX_REMAINING_SHARE
            || self.error <= 1.0 - MIN_EXCESS && self.above_floor.is_some_and(|a| a <= MAX_ABOVE_FLOOR_NEAR)
    }
}

fn remaining_error(on_sensor: bool, problem: &Problem, judged: &HeldOutComparison) -> RemainingError {
    let error = match on_sensor {
        true => judged.with.best_ratio(&judged.without),
        false => judged.with.judge_ratio(&judged.without)[0],
    };
    let held_out = |r: &Residuals, c: usize| r.rms(c).1;
    RemainingError { error, above_floor: left_above_floor(on_sensor, problem, judged, held_out) }
}

/// Squared error above the noise floor with effects over that without them, of the errors that `rms` gives for a channel.
fn left_above_floor(
    on_sensor: bool,
    problem: &Problem,
    judged: &HeldOutComparison,
    rms: impl Fn(&Residuals, usize) -> f64,
) -> Option<f64> {
    let (r, b) = (&judged.with, &judged.without);
    let best = (0..r.judge.len()).min_by(|x, y| {
        let gain = |c: usize| rms(r, c) / rms(b, c).max(1e-300);
        gain(*x).total_cmp(&gain(*y))
    });
    let above = |r: &Residuals| -> f64 {
        let of = |(c, channel): (usize, &crate::measurement::segments::MeasuredChannel)| {
            // The floor of a channel is at least a millionth of its remaining error.
            let noise = channel.noise.max(LEAST_NOISE * rms(b, c)).max(1e-300);
            ((rms(r, c) / noise).powi(2) - 1.0).max(0.0)
        };
        let channels = problem.data.channels.iter().enumerate();
        channels.filter(|(c, _)| !on_sensor || best == Some(*c)).map(of).sum()
    };
    let (now, then) = (above(r), above(b));
    (problem.machine.effort().noise_alone_is_left && then > MIN_EXCESS).then(|| now / then)
}

/// Whether every effect of a set improves on the set without it, if that smaller set was fitted.
fn all_effects_improve(
    model: &FittedModel,
    all: &[FittedModel],
    effective: &[f64],
    own: &Data,
    threads: usize,
) -> bool {
    (0..model.effects.len()).all(|e| {
        let mut rest: Vec<String> = model.identity();
        let id = model.effects[e].identity();
        rest.retain(|other| *other != id);
        let Some(less) = all.iter().find(|m| m.identity() == rest) else { return true };
        let less = less.finished();
        let gain = score(&less, effective) - score(model, effective);
        is_better(model, &less, &[e], gain, own, threads)
    })
}

/// Decides which of the search results to accept. Where these are predictions, `simulated` is the set that the simulation has accepted.
pub fn accept<'a>(
    searched: SearchResult<'a>,
    simulated: Option<&FittedModel<'a>>,
    own: &'a Data,
    context: &Context<'_>,
) -> AcceptedResult<'a> {
    context.report("comparing the found effects with held-out data");
    let SearchResult {
        declared,
        mut all,
        effective,
        mut trials,
        reasons,
        detectable,
        alike,
        hypotheses,
        is_settled,
        is_lost: _,
        is_drifting: _,
        cut_short,
    } = searched;
    let known = (&hypotheses[..], &alike[..], is_settled);
    // What a pass says of the trials holds for the set that it has accepted.
    let untold = trials.clone();
    let (mut best, mut evidence) = accepted(&declared, &all, simulated, &effective, own, context, &mut trials);
    let mut taken_up = 0;
    let rivals = loop {
        let (rivals, better) = rivals(&declared, &best, &all, known, &effective, own, context, &mut trials);
        let Some(mut better) = better.filter(|_| taken_up < TAKEN_UP && !context.must_end()) else { break rivals };
        taken_up += 1;
        better.threads = context.threads;
        all.push(better);
        all.sort_by(|a, b| score(a, &effective).total_cmp(&score(b, &effective)));
        let mut told = untold.clone();
        let (next, its_evidence) = accepted(&declared, &all, simulated, &effective, own, context, &mut told);
        // A pass that the end of the time has cut short may have lost effects.
        let is_better = score(&next, &effective) < score(&best, &effective);
        if next.identity() == best.identity() || !is_better || context.must_end() {
            break rivals;
        }
        (best, evidence, trials) = (next, its_evidence, told);
    };
    record_outcomes(&best, &all, &effective, &mut trials);
    AcceptedResult { declared, best, rivals, trials, reasons, evidence, detectable, alike, cut_short }
}

/// Rivals that take the place of an accepted set, one after the other, at most.
const TAKEN_UP: usize = 2;

/// The first of all sets that its tests confirm, with what a simulation has accepted.
fn accepted<'a>(
    declared: &FittedModel<'a>,
    all: &[FittedModel<'a>],
    simulated: Option<&FittedModel<'a>>,
    effective: &[f64],
    own: &'a Data,
    context: &Context<'_>,
    trials: &mut [Trial],
) -> (FittedModel<'a>, Vec<Evidence>) {
    let (mut best, mut evidence) = first_confirmed_set(declared, all, effective, own, context, trials);
    if context.must_end() {
        return (best, evidence);
    }
    context.report("looking whether loads follow other laws");
    (best, evidence) = with_known_laws(declared, (best, evidence), effective, own, context, trials);
    context.report("comparing the found effects with held-out data");
    if context.must_end() {
        return (best, evidence);
    }
    if let Some(simulated) = simulated {
        (best, evidence) = with_confirmed_effects(declared, (best, evidence), simulated, effective, own, context);
    }
    if let Some(why) = reason_why_unexplained(declared, &best, own, context.threads) {
        for e in &best.effects {
            let own = |t: &&mut Trial| t.identity == e.identity() && t.rms_fit.is_some() && t.why.is_empty();
            trials.iter_mut().filter(own).for_each(|t| t.why.clone_from(&why));
        }
        (best, evidence) = (declared.clone(), Vec::new());
    }
    (best, evidence)
}

/// Adds what a simulation has accepted and a prediction confirms. Over a few samples even a large load moves a prediction by little, so that
/// it is not worth a name there by its error; but what is left is white, and tells whether the load is there at all.
fn with_confirmed_effects<'a>(
    declared: &FittedModel<'a>,
    (mut best, mut evidence): (FittedModel<'a>, Vec<Evidence>),
    simulated: &FittedModel<'a>,
    effective: &[f64],
    own: &'a Data,
    context: &Context<'_>,
) -> (FittedModel<'a>, Vec<Evidence>) {
    let starts = fitted_values(simulated);
    let before = best.effects.len();
    loop {
        let size = best.effects.len();
        for (h, start) in simulated.effects.iter().zip(&starts) {
            if best.effects.iter().any(|e| e.identity() == h.identity()) || context.must_end() {
                continue;
            }
            let all: Vec<usize> = (0..best.effects.len()).collect();
            let with = refitted(declared, &best, &all, Some((h, start)), own, context.threads, FIT_ITERATIONS);
            let own_evidence = evidence_for(&with, &best, all.len(), effective, own, context.threads);
            if is_confirmed(&with, all.len(), &own_evidence) {
                best = with;
            }
        }
        if best.effects.len() == size {
            break;
        }
    }
    while best.effects.len() > before {
        // An effect that was accepted before may have stood in for one that was added. It then fails now.
        let all: Vec<(FittedModel, Evidence)> = (0..best.effects.len())
            .map(|which| {
                let less = without_effect(declared, &best, which, own, context.threads);
                let of = evidence_for(&best, &less, which, effective, own, context.threads);
                (less, of)
            })
            .collect();
        let fails = |i: &usize| !is_confirmed(&best, *i, &all[*i].1);
        let weakest = (0..all.len()).filter(fails).min_by(|a, b| all[*a].1.score.total_cmp(&all[*b].1.score));
        let Some(weakest) = weakest else {
            return (best, all.into_iter().map(|(_, evidence)| evidence).collect());
        };
        best = all.into_iter().nth(weakest).map_or(best, |(less, _)| less);
        evidence.clear();
    }
    if evidence.len() != best.effects.len() {
        let of = |which: usize| {
            let less = without_effect(declared, &best, which, own, context.threads);
            evidence_for(&best, &less, which, effective, own, context.threads)
        };
        evidence = (0..best.effects.len()).map(of).collect();
    }
    (best, evidence)
}

/// Whether a prediction confirms an effect: clearly better, in held-out records too, and with a size.
fn is_confirmed(with: &FittedModel, which: usize, evidence: &Evidence) -> bool {
    evidence.score >= CLEAR_SCORE_GAP
        && evidence.judge_ratio[2] < 1.0
        && size_in_standard_errors(with, which) >= SURE
        && outside_the_records(with, which).is_none()
        && at_bound(with, which).is_none()
}

/// Removes loads for which an unnamed form fits clearly better in their place: the true load follows another law.
fn with_known_laws<'a>(
    declared: &FittedModel<'a>,
    (best, evidence): (FittedModel<'a>, Vec<Evidence>),
    effective: &[f64],
    own: &'a Data,
    context: &Context<'_>,
    trials: &mut [Trial],
) -> (FittedModel<'a>, Vec<Evidence>) {
    for which in 0..best.effects.len() {
        if context.must_end() {
            break;
        }
        let form = better_form(declared, &best, which, effective, own, context);
        if let Some(form) = form {
            let id = best.effects[which].identity();
            for t in trials.iter_mut().filter(|t| t.identity == id && t.rms_fit.is_some()) {
                t.why = format!("not its law: a force of the form {form} in its place leaves clearly less");
            }
            let less = without_effect(declared, &best, which, own, context.threads);
            let left = without_rejected_effects(declared, less, effective, own, context, trials);
            return with_known_laws(declared, left, effective, own, context, trials);
        }
    }
    (best, evidence)
}

/// The form that leaves clearly less error than the set when it replaces the set's load.
fn better_form<'a>(
    declared: &FittedModel<'a>,
    best: &FittedModel<'a>,
    which: usize,
    effective: &[f64],
    own: &'a Data,
    context: &Context<'_>,
) -> Option<&'static str> {
    let records = declared.problem.data.records.len();
    let kept: Vec<usize> = (0..best.effects.len()).filter(|i| *i != which).collect();
    let forms = unnamed::in_place_of(best, which);
    let own_score = score(best, effective);
    let models = parallel(forms.len(), context.threads, |i| {
        let fit_start = FitStart { values: forms[i].values.clone(), phases: vec![0.0; records], travels: Vec::new() };
        if context.must_end() { None } else { rival_of(declared, best, &kept, (&forms[i], &fit_start), own) }
    });
    let fitted = models.iter().zip(&forms).filter_map(|(m, form)| Some((m.as_ref()?, form)));
    let clear = fitted.filter(|(m, _)| {
        let is_better = score(m, effective) < own_score - CLEAR_SCORE_GAP;
        is_better && m.residuals().judge_ratio(best.residuals())[2] < 1.0
    });
    let best_form = clear.min_by(|a, b| score(a.0, effective).total_cmp(&score(b.0, effective)));
    best_form.map(|(_, form)| form.effect.equation)
}

/// Reason why an accepted set is only a lead: most of the error remains, so that another cause is likely, of which the
/// set may be a side effect.
fn reason_why_unexplained(declared: &FittedModel, best: &FittedModel, own: &Data, threads: usize) -> Option<String> {
    // If all effects are on sensors, one channel may be explained and others not.
    let effects: Vec<usize> = (0..best.effects.len()).collect();
    let left = left_unexplained(best, &compare_held_out(best, declared, &effects, own, threads))?;
    (!best.effects.is_empty()).then(|| {
        let stays = 100.0 * left;
        format!("a lead, no name: it stands, but {stays:.0} % of the squared error above the noise floor stays with all that does")
    })
}

/// Share of the squared error above the noise floor that a set leaves, where that is too much for a name.
pub(super) fn left_unexplained(best: &FittedModel, judged: &HeldOutComparison) -> Option<f64> {
    // If all effects are on sensors, one channel may be explained and others not.
    let on_sensors = best.effects.iter().all(|e| is_signal(e.effect));
    let parts: [fn(&Residuals, usize) -> f64; 2] = [|r, c| r.rms(c).0, |r, c| r.rms(c).1];
    // A set that explains the held-out records alone has the form of neither.
    let left = parts.into_iter().filter_map(|part| left_above_floor(on_sensors, &best.problem, judged, part));
    let most = if best.is_near_the_floor() { MAX_ABOVE_FLOOR } else { MAX_ABOVE_FLOOR_FAR };
    left.reduce(f64::max).filter(|left| *left > most)
}

/// Number of sets that are examined closely, one after the other, until one is accepted unchanged.
const MAX_EXAMINED_SETS: usize = 4;

/// The first accepted set that loses no effect in a close examination; if there is none, what remains of the first set.
fn first_confirmed_set<'a>(
    declared: &FittedModel<'a>,
    all: &[FittedModel<'a>],
    effective: &[f64],
    own: &'a Data,
    context: &Context<'_>,
    trials: &mut [Trial],
) -> (FittedModel<'a>, Vec<Evidence>) {
    let set = |refused: &[Vec<String>]| smallest_confirmed_set(declared, all, effective, refused, own, context.threads);
    let first = set(&[]);
    let mut refused = vec![first.identity()];
    let left = without_rejected_effects(declared, first, effective, own, context, trials);
    if left.0.identity() == refused[0] {
        return left;
    }
    while refused.len() < MAX_EXAMINED_SETS && !context.must_end() {
        let next = set(&refused);
        if next.effects.len() <= left.0.effects.len() {
            break;
        }
        let mut all_evidence = Vec::new();
        let holds = (0..next.effects.len()).all(|which| {
            let less = without_effect(declared, &next, which, own, context.threads);
            let evidence = evidence_for(&next, &less, which, effective, own, context.threads);
            let reason = rejection_reason(&next, which, &evidence);
            all_evidence.push(evidence);
            reason.is_none()
        });
        if holds {
            return (next, all_evidence);
        }
        refused.push(next.identity());
    }
    left
}

/// Removes effects that fail, one at a time, the weakest first. Returns the remaining set with the evidence for each
/// effect.
fn without_rejected_effects<'a>(
    declared: &FittedModel<'a>,
    mut best: FittedModel<'a>,
    effective: &[f64],
    own: &'a Data,
    context: &Context<'_>,
    trials: &mut [Trial],
) -> (FittedModel<'a>, Vec<Evidence>) {
    loop {
        if best.effects.is_empty() {
            // A fit that went on from the one with the effect may be better; one that the end of the time has cut short is not.
            let is_better = best.misfit() < declared.misfit();
            return (if is_better { best } else { declared.clone() }, Vec::new());
        }
        let mut weakest: Option<(f64, FittedModel<'a>, usize, String)> = None;
        let mut all_evidence = Vec::new();
        for which in 0..best.effects.len() {
            let less = without_effect(declared, &best, which, own, context.threads);
            let evidence = evidence_for(&best, &less, which, effective, own, context.threads);
            let why = rejection_reason(&best, which, &evidence);
            if let Some(why) = why
                && weakest.as_ref().is_none_or(|(w, ..)| evidence.score < *w)
            {
                weakest = Some((evidence.score, less, which, why));
            }
            all_evidence.push(evidence);
        }
        if context.must_end() {
            // Fits that the end of the time has cut short are no evidence, neither for an effect nor against it.
            return (best, Vec::new());
        }
        let Some((_, less, which, why)) = weakest else { return (best, all_evidence) };
        let id = best.effects[which].identity();
        for t in trials.iter_mut().filter(|t| t.identity == id && t.rms_fit.is_some() && t.why.is_empty()) {
            t.why = format!("not accepted: {why}");
        }
        best = less;
    }
}

/// Evidence for one effect: the set with it compared with the set without it.
fn evidence_for(
    best: &FittedModel,
    less: &FittedModel,
    which: usize,
    effective: &[f64],
    own: &Data,
    threads: usize,
) -> Evidence {
    evidence_from(best, less, which, effective, &compare_held_out(best, less, &[which], own, threads), threads)
}

pub(super) fn evidence_from(
    best: &FittedModel,
    less: &FittedModel,
    which: usize,
    effective: &[f64],
    judged: &HeldOutComparison,
    threads: usize,
) -> Evidence {
    let (gain, sham) = sham_gain(best, less, which, threads);
    let name = |r: &usize| best.problem.data.records[*r].clone();
    Evidence {
        identity: best.effects[which].identity(),
        judge_ratio: judged.with.judge_ratio(&judged.without),
        remaining: remaining_error(is_signal(best.effects[which].effect), &best.problem, judged),
        left_out: judged.left_out.iter().map(name).collect(),
        score: score(less, effective) - score(best, effective),
        gain,
        sham,
    }
}

/// Reason against an effect, if there is one.
pub(super) fn rejection_reason(best: &FittedModel, which: usize, evidence: &Evidence) -> Option<String> {
    let [ratio, low, high] = evidence.judge_ratio;
    let (gain, sham) = (evidence.gain, evidence.sham);
    let sure = size_in_standard_errors(best, which);
    if evidence.score < MIN_SCORE_GAIN {
        Some(format!("worth {:.1}, less than {MIN_SCORE_GAIN}", evidence.score))
    } else if !evidence.remaining.justifies_a_name() || high >= 1.0 {
        Some(format!("the held-out error is {ratio:.3} times that without it [{low:.3}, {high:.3}]"))
    } else if gain < SHAM_GAINS * sham && 1.0 - gain > SHAM_REMAINDER * (1.0 - sham) {
        Some(format!("explains {:.1} %, a sham {:.1} %", 100.0 * gain, 100.0 * sham))
    } else if let Some(outside) = outside_the_records(best, which) {
        Some(outside)
    } else if sure < SURE {
        Some(format!("its size is {sure:.1} standard errors from nothing"))
    } else if let sizes = steady::sizes(best, which)
        && steady::differ(&sizes)
    {
        Some(format!("it has no one size: {} (halves of records)", steady::sizes_text(&sizes)))
    } else {
        at_bound(best, which)
    }
}

/// Records the final outcome of every trial.
fn record_outcomes(best: &FittedModel, all: &[FittedModel], effective: &[f64], trials: &mut [Trial]) {
    let best_score = score(best, effective);
    let accepted: Vec<String> = best.effects.iter().map(Hypothesis::identity).collect();
    for t in trials {
        let mut id = t.beside.clone();
        id.push(t.identity.clone());
        id.sort();
        let Some(m) = all.iter().find(|m| m.identity() == id) else { continue };
        // An accepted effect overrides whatever was recorded for it in combination with others.
        if accepted.contains(&t.identity) && t.beside.iter().all(|b| accepted.contains(b)) {
            t.why = "accepted".into();
        }
        t.score = Some(score(m, effective) - best_score);
        t.rms_judge = m.known_judge_error();
        if t.why.is_empty() {
            let times = mean_error(&m.fit_residuals) / mean_error(&best.fit_residuals);
            t.why = if accepted.contains(&t.identity) {
                "accepted".into()
            } else if times > 1.0 {
                let end = if m.given_up.is_some() { "; its fit was given up" } else { "" };
                format!("leaves {times:.3} times the error of the accepted set{end}")
            } else if let [ratio, _, f64::INFINITY] = m.residuals().judge_ratio(best.residuals()) {
                format!(
                    "it leaves {times:.3} times the fitted error and {ratio:.3} times the held-out error, by too few samples to tell"
                )
            } else {
                let [ratio, low, high] = m.residuals().judge_ratio(best.residuals());
                let beside = if accepted.is_empty() { "" } else { "with the accepted set " };
                format!(
                    "{beside}it leaves {times:.3} times the fitted error and {ratio:.3} [{low:.3}, {high:.3}] times the held-out error: too little to be named"
                )
            };
        }
    }
}

/// Gain of an effect over the model without it, from screening, and the median gain of its shams.
fn sham_gain(best: &FittedModel, less: &FittedModel, which: usize, threads: usize) -> (f64, f64) {
    let h = &best.effects[which];
    let base = LinearisedBase::new(&less.problem, &less.fit);
    // Squares of all channels, weighted as in the smaller model, so that units cancel.
    let squares = |m: &FittedModel| -> f64 {
        let of = m.fit_residuals.iter().zip(&less.problem.weights);
        of.map(|(parts, w)| parts.iter().flatten().map(|x| x * x / (w * w)).sum::<f64>()).sum()
    };
    let gain = 1.0 - squares(best) / squares(less).max(1e-300);
    if h.phase().is_some() {
        // A wave with a free phase explains as much when it is shifted, so that it has no sham.
        return (gain, 0.0);
    }
    let p = screen(&less.problem, &base, &less.fit, h);
    if p.columns.is_empty() {
        return (gain, 0.0);
    }
    let mut random = Random::new(3);
    let shifts: Vec<usize> = (0..SHAM_COUNT).map(|_| 100 + random.below(800)).collect();
    let mut gains = parallel(SHAM_COUNT, threads, |i| base.gain(&base.shifted(&p.columns, shifts[i])));
    (gain, crate::measurement::facts::median(&mut gains))
}

/// Largest distance of an effect's amplitudes from zero, in standard errors; infinite if the effect has no amplitude.
pub(super) fn size_in_standard_errors(model: &FittedModel, which: usize) -> f64 {
    let amplitude = |g: &usize| {
        let key = model.problem.machine.slots[model.problem.globals[*g].slot].path.rsplit('.').next();
        let keys = model.problem.machine.keys(model.effects[which].effect, model.effects[which].target);
        keys.iter().any(|(k, row)| Some(k.as_str()) == key && row.kind.is_amplitude() && row.off == 0.0)
    };
    let globals: Vec<usize> = globals_of(model, which).into_iter().filter(amplitude).collect();
    let size = |g: &usize| model.fit.point.globals[*g].abs() / standard_error(model, *g).max(1e-300);
    if globals.is_empty() { f64::INFINITY } else { globals.iter().map(size).fold(0.0, f64::max) }
}

/// Message for an amplitude that lies at a bound of its range.
fn at_bound(model: &FittedModel, which: usize) -> Option<String> {
    for g in globals_of(model, which) {
        let global = &model.problem.globals[g];
        let (low, high) = global.law.bounds();
        let x = model.fit.point.globals[g];
        let slot = &model.problem.machine.slots[global.slot];
        if !global.law.logarithm && (x <= low || x >= high) && !slot.path.ends_with("phase_deg") {
            return Some(format!("`{}` stands at its bound", slot.path));
        }
    }
    None
}
