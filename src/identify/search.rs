//! The search: baseline, hypotheses, combinations of effects.
//!
//! A beam of effect sets grows by one effect per round. Greedy search is not enough: on the coupled drives three rivals
//! are within noise of each other in the first round, and only later rounds separate them. Fitted data select which
//! sets are examined, held-out data decide which are accepted.

use super::candidates::{self, Hypothesis, Sizes};
use super::declared::{self, DEVIANCE_TOLERANCE, set_step_limit, steps_needed_at};
use super::diagnosis::standing_orders;
use super::drifting;
use super::fit::{FitOptions, fit};
use super::inverse;
use super::judge;
use super::model::{FIT_ITERATIONS, FittedModel, fit_model, score, with_shapes_beyond, with_sharper_friction};
use super::plausible::{is_inside_the_records, outside_the_records};
use super::predict;
use super::problem::{FitEnding, Local, Point, Problem};
use super::race::race;
use super::screen::{LinearisedBase, ScreeningResult, screen};
use super::settled;
use super::softened::{apart, softened};
use super::stats;
use super::stretches::from_stretches;
use super::structure::{self, Detectable, IndistinguishablePair};
use crate::drive::sensors::is_signal;
use crate::effects::Physics;
use crate::measurement::segments::Data;
use crate::measurement::{CandidateSpec, Measurement};
use crate::side_by_side::parallel;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Limits of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Largest number of model runs; None: no limit. The same limit gives the same result.
    pub runs: Option<u64>,
    /// Longest time [s]; None: no limit. What a time limit cuts off depends on the machine.
    pub seconds: Option<f64>,
}

/// Reports progress, for a progress bar.
pub type Progress<'a> = &'a (dyn Fn(&str, u64) + Sync);

/// Everything that a search needs besides data and machine.
pub struct Context<'a> {
    /// Number of threads; they do not change the result unless the budget ends the search.
    pub threads: usize,
    /// When to end early.
    pub budget: Budget,
    /// Start of the time that the budget limits.
    pub started: Instant,
    /// Ends the search when another thread sets it.
    pub stop: &'a AtomicBool,
    /// Called at the start of every stage, and on the way, with the model runs so far.
    pub progress: Progress<'a>,
    /// Counts model runs.
    pub runs: &'a AtomicU64,
}

impl Context<'_> {
    /// Whether the search must end: interrupted, or out of budget.
    pub fn must_end(&self) -> bool {
        self.ending().is_due() || self.budget.runs.is_some_and(|n| self.runs.load(Ordering::Relaxed) >= n)
    }

    /// What ends a fit on its way.
    pub fn ending(&self) -> FitEnding<'_> {
        let length = self.budget.seconds.and_then(|s| Duration::try_from_secs_f64(s).ok());
        FitEnding { stop: self.stop, deadline: length.and_then(|length| self.started.checked_add(length)) }
    }

    /// Reports the beginning of a stage.
    pub fn report(&self, stage: &str) {
        (self.progress)(stage, self.runs.load(Ordering::Relaxed));
    }
}

/// Outcome of a hypothesis.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Trial {
    /// Path of the effect, with its order where it has one.
    pub identity: String,
    /// Effects that were already in the model.
    pub beside: Vec<String>,
    /// Share of the cost that screening predicted.
    pub promised: f64,
    /// Root mean square of its residuals on fitted samples, relative to the noise; None: it was not fitted.
    pub rms_fit: Option<f64>,
    /// Only for those that were compared on held-out data.
    pub rms_judge: Option<f64>,
    /// Score relative to the model without it; negative is better.
    pub score: Option<f64>,
    /// Why it was not taken, or that it was.
    pub why: String,
}

#[doc(hidden)]
/// Result of a search.
pub struct SearchResult<'a> {
    pub declared: FittedModel<'a>,
    /// All fitted sets, the best score first.
    pub all: Vec<FittedModel<'a>>,
    /// Effective samples of every channel, the same for all sets.
    pub effective: Vec<f64>,
    pub trials: Vec<Trial>,
    /// Effects that were not examined, and why.
    pub reasons: Vec<(String, String)>,
    pub detectable: Vec<Detectable>,
    pub alike: Vec<IndistinguishablePair>,
    /// All hypotheses for the declared model, in every form.
    pub hypotheses: Vec<Hypothesis>,
    /// Whether the search began at a set from inverse dynamics, so that few hypotheses were fitted.
    pub is_settled: bool,
    /// Whether it ended before its last round, because a prediction may know a better start.
    pub is_lost: bool,
    /// Whether it ended because a number that follows the order of the records leaves noise alone.
    pub is_drifting: bool,
    pub cut_short: bool,
}

impl<'a> SearchResult<'a> {
    /// The search with the sets and trials of one that went before it.
    pub(super) fn after(mut self, before: SearchResult<'a>) -> SearchResult<'a> {
        let known: Vec<Vec<String>> = self.all.iter().map(FittedModel::identity).collect();
        self.all.extend(before.all.into_iter().filter(|m| !known.contains(&m.identity())));
        self.effective = sort_by_score(&mut self.all);
        let is_new = |t: &Trial| !self.trials.iter().any(|o| o.identity == t.identity && o.beside == t.beside);
        let earlier: Vec<Trial> = before.trials.into_iter().filter(is_new).collect();
        self.trials.extend(earlier);
        self
    }
}

/// A set whose score is worse than the best by more than this is dropped.
pub(super) const MAX_SCORE_GAP: f64 = 60.0;
/// Rounds after which a search that is still far from the noise is left to a prediction.
const LOST_AFTER: usize = 2;
/// An effect with a smaller score gain is not examined further: positive evidence after Kass and Raftery 1995, no more.
/// Held-out data, shams and standard errors are stricter conditions that it must also meet.
pub const MIN_SCORE_GAIN: f64 = 3.0;

/// Runs the whole search.
pub fn search<'a>(
    measurement: &Measurement,
    problem: Problem<'a>,
    own: &'a Data,
    context: &Context<'_>,
) -> SearchResult<'a> {
    let (declared, prepared) = first_models(measurement, problem, own, context);
    let settled = settled::settled_by_inverse_dynamics(measurement, &declared, &prepared, own, context);
    rounds(measurement, declared, (settled, prepared), own, context, true)
}

/// The search from a fitted model without effects, or from sets that are settled, the smallest first; other sets that inverse dynamics has
/// given take part.
pub fn search_from<'a>(
    measurement: &Measurement,
    declared: FittedModel<'a>,
    sets: (Vec<FittedModel<'a>>, Vec<FittedModel<'a>>),
    own: &'a Data,
    context: &Context<'_>,
) -> SearchResult<'a> {
    rounds(measurement, declared, sets, own, context, false)
}

/// What the rounds of a search share.
struct Rounds<'a, 'c> {
    measurement: &'c Measurement,
    declared: &'c FittedModel<'a>,
    own: &'a Data,
    context: &'c Context<'c>,
    /// Screening of the declared model.
    at_declared: ScreenedHypotheses,
    /// Numbers of the drive file.
    file: Point,
    /// Sets that were fitted: starting near the file's parameters, and far from them.
    seen: [Vec<Vec<String>>; 2],
    trials: Vec<Trial>,
    reasons: Vec<(String, String)>,
}

impl<'a> Rounds<'a, '_> {
    /// The sets of a model's effects and one more, fitted. `first`: a screening of this model that is known.
    fn extended(&mut self, model: &FittedModel<'a>, first: Option<ScreenedHypotheses>) -> Vec<FittedModel<'a>> {
        let (own, context) = (self.own, self.context);
        let softer = softened(model, own, context);
        let (explicit, others) = apart(&self.measurement.candidates);
        let spec = if softer.is_some() { &others } else { &self.measurement.candidates };
        let screened_now = first.unwrap_or_else(|| {
            let base = LinearisedBase::new(&model.problem, &model.fit);
            screened_again(spec, model, &base, Some(&self.at_declared), context)
        });
        let seen = &mut self.seen[usize::from(is_far(&self.declared.problem, &self.file, &model.fit.point))];
        let mut next =
            extend_by_one_effect(screened_now, model, own, context, seen, &mut self.trials, &mut self.reasons);
        if let Some(softer) = softer.filter(|_| !explicit.only.is_empty()) {
            let base = LinearisedBase::new(&softer.problem, &softer.fit);
            let screened_now = screened(&explicit, &softer, &base, context);
            let (trials, reasons) = (&mut self.trials, &mut self.reasons);
            next.extend(extend_by_one_effect(screened_now, &softer, own, context, seen, trials, reasons));
        }
        next
    }

    /// Sets of one effect from other starts than the fitted declared model: the file's own numbers, and short stretches of the records where
    /// `next` holds none that is near the noise.
    fn add_other_starts(&mut self, next: &mut Vec<FittedModel<'a>>) {
        let (own, context) = (self.own, self.context);
        if let Some(near) = near_the_file(self.declared, own, context) {
            context.report("round 1: searching again from the drive's own parameters");
            let base = LinearisedBase::new(&near.problem, &near.fit);
            let screened_now = screened(&self.measurement.candidates, &near, &base, context);
            let (seen, trials, reasons) = (&mut self.seen[0], &mut self.trials, &mut self.reasons);
            next.extend(extend_by_one_effect(screened_now, &near, own, context, seen, trials, reasons));
        }
        if !next.iter().any(FittedModel::is_near_the_floor) && !context.must_end() {
            context.report("round 1: searching again in short stretches");
            let found = from_stretches(self.measurement, self.declared, own, context);
            for m in &found {
                record_trial(&mut self.trials, m.effects[0].identity(), &[], None, stats::rms(&m.fit_residuals[0]));
            }
            next.extend(found);
        }
    }
}

/// The best sets of a round, each once, at most so many.
fn leading<'a>(mut next: Vec<FittedModel<'a>>, effective: &[f64], most: usize) -> Vec<FittedModel<'a>> {
    next.sort_by(|a, b| score(a, effective).total_cmp(&score(b, effective)));
    let mut kept: Vec<Vec<String>> = Vec::new();
    next.retain(|m| {
        let id = m.identity();
        let new = !kept.contains(&id);
        kept.push(id);
        new
    });
    next.truncate(most);
    let lead = next.first().map_or(f64::MAX, |m| score(m, effective));
    next.retain(|m| score(m, effective) <= lead + MAX_SCORE_GAP);
    next.into_iter().map(|m| m.finished().into_owned()).collect()
}

/// All rounds, or as many as are needed to see that the simulation is lost, where it `may_be_lost`.
fn rounds<'a>(
    measurement: &Measurement,
    declared: FittedModel<'a>,
    (settled, prepared): (Vec<FittedModel<'a>>, Vec<FittedModel<'a>>),
    own: &'a Data,
    context: &Context<'_>,
    may_be_lost: bool,
) -> SearchResult<'a> {
    // Detectable sizes and indistinguishable pairs are those at the declared model, where the search also begins.
    let base = LinearisedBase::new(&declared.problem, &declared.fit);
    let first = screened(&measurement.candidates, &declared, &base, context);
    let detectable = structure::detectable(&declared.problem.machine, &base, &first.hypotheses, &first.screenings);
    let alike = structure::indistinguishable_pairs(&first.hypotheses, &first.screenings);
    let hypotheses = first.hypotheses.clone();
    let mut search = Rounds {
        measurement,
        declared: &declared,
        own,
        context,
        at_declared: first.clone(),
        file: declared.problem.start(),
        seen: [vec![Vec::new()], vec![Vec::new()]],
        trials: Vec::new(),
        reasons: Vec::new(),
    };
    for m in &prepared {
        let beside: Vec<String> = m.effects[1..].iter().map(Hypothesis::identity).collect();
        record_trial(&mut search.trials, m.effects[0].identity(), &beside, None, stats::rms(&m.fit_residuals[0]));
    }
    // The search goes on from what inverse dynamics has settled. The first screening is that of the declared model.
    let is_settled = !settled.is_empty();
    let mut first = (!is_settled).then_some(first);
    let mut beam: Vec<FittedModel<'a>> = vec![settled.first().unwrap_or(&declared).clone()];
    if is_settled {
        beam.extend(settled::nearly_as_good(&beam[0], &prepared));
    }
    let mut all: Vec<FittedModel<'a>> = std::iter::once(declared.clone()).chain(settled).collect();
    let first_round = beam[0].effects.len() + 1;
    let (mut cut_short, mut is_lost) = (false, false);
    let effort = declared.problem.machine.effort();
    let mut is_drifting = may_be_lost && is_settled && drift_explains(&all[1..], context);
    let is_disturbed = || may_be_lost && is_settled && predict::explains_the_rest(&beam[0], context);
    let ends = is_drifting || is_settled && beam[0].is_noise_alone() || is_disturbed();
    let last_round = if ends { 0 } else { effort.effects };
    for round in first_round..=last_round {
        let mut next: Vec<FittedModel<'a>> = Vec::new();
        for model in beam.iter().filter(|m| !m.is_exhausted()) {
            if context.must_end() {
                cut_short = true;
                break;
            }
            context.report(&format!("round {round}: screening hypotheses"));
            next.extend(search.extended(model, first.take()));
        }
        if round == 1 {
            search.add_other_starts(&mut next);
        }
        next.extend(prepared.iter().filter(|m| m.effects.len() == round).cloned());
        next.retain(|m| takes_part(m, &mut search.trials));
        if next.is_empty() {
            break;
        }
        // Effective samples from the model with the smallest error, the same for all.
        all.extend(next.iter().cloned());
        let effective = best_effective(&all);
        let next = leading(next, &effective, effort.beam[(round - 1).min(effort.beam.len() - 1)]);
        let before = beam.iter().map(|m| score(m, &effective)).fold(f64::MAX, f64::min);
        let after = next.first().map_or(f64::MAX, |m| score(m, &effective));
        if after > before - MIN_SCORE_GAIN {
            break;
        }
        beam = next;
        if cut_short || beam[0].is_noise_alone() {
            break;
        }
        is_lost = may_be_lost && round >= LOST_AFTER && !is_settled && predict::is_lost(&beam[0]);
        is_drifting = may_be_lost && drift_explains(&beam, context);
        let is_disturbed = || may_be_lost && round >= LOST_AFTER && predict::explains_the_rest(&beam[0], context);
        if is_lost || is_drifting || is_disturbed() {
            break;
        }
    }
    let Rounds { trials, reasons, .. } = search;
    // A set may explain what none of its parts does alone, so that the rounds ended before it.
    let known: Vec<Vec<String>> = all.iter().map(FittedModel::identity).collect();
    all.extend(prepared.into_iter().filter(|m| is_inside_the_records(m) && !known.contains(&m.identity())));
    sort_by_score(&mut all);
    let again: Vec<_> =
        all.iter().take(REFITTED_SETS).filter_map(|m| from_the_file(&declared, m, own, context)).collect();
    all.extend(again);
    let effective = sort_by_score(&mut all);
    SearchResult {
        declared,
        all,
        effective,
        trials,
        reasons,
        detectable,
        alike,
        hypotheses,
        is_settled,
        is_lost,
        is_drifting,
        cut_short,
    }
}

/// Puts the best model first; returns the effective samples by which it is.
fn sort_by_score(all: &mut [FittedModel<'_>]) -> Vec<f64> {
    let effective = best_effective(all);
    all.sort_by(|a, b| score(a, &effective).total_cmp(&score(b, &effective)));
    effective
}

/// Whether a set takes part in the search: what cannot be named would keep places from what can, since a law whose form lies outside the records takes
/// another form inside. Where it does not, its trial says why.
fn takes_part(set: &FittedModel, trials: &mut [Trial]) -> bool {
    let outside = |which: usize| Some((which, outside_the_records(set, which)?));
    let Some((which, why)) = (0..set.effects.len()).find_map(outside) else { return true };
    let path = set.effects[which].path();
    for t in trials.iter_mut().filter(|t| t.is_of(set) && t.why.is_empty()) {
        t.why = format!("{OUTSIDE} `{path}` has {why}");
    }
    false
}

/// How the reason begins why a set does not take part.
const OUTSIDE: &str = "not accepted: with it";

impl Trial {
    /// Whether it was a fit of the effects of this set.
    fn is_of(&self, set: &FittedModel) -> bool {
        let mut own = self.beside.clone();
        own.push(self.identity.clone());
        own.sort();
        own == set.identity()
    }
}

/// Sets of a round whose numbers are tried with a value for each record.
const TRIED_BY_RECORD: usize = 3;

/// Whether what the best sets leave is a number of theirs that follows the order of the records.
fn drift_explains(sets: &[FittedModel], context: &Context) -> bool {
    sets.iter().take(TRIED_BY_RECORD).any(|m| drifting::explains_the_rest(m, context))
}

/// The declared model, and the sets that inverse dynamics gives, all fitted as simulations.
fn first_models<'a>(
    measurement: &Measurement,
    problem: Problem<'a>,
    own: &'a Data,
    context: &Context<'_>,
) -> (FittedModel<'a>, Vec<FittedModel<'a>>) {
    let starts = inverse::starts(measurement, &problem, context);
    context.report("fitting the declared model");
    let mut declared = declared::fitted(problem, own, context);
    let (sets, numbers): (Vec<_>, Vec<_>) = starts.into_iter().partition(|(.., effects)| !effects.is_empty());
    for (problem, start, effects) in numbers {
        let model = fit_model(problem, &start, own, effects, context.threads, FIT_ITERATIONS);
        if model.misfit() < declared.misfit() - DEVIANCE_TOLERANCE {
            declared = model;
        }
    }
    set_step_limit(&mut declared.problem, &declared.fit.point);
    let mut prepared: Vec<FittedModel<'a>> = Vec::new();
    for (mut problem, start, effects) in sets {
        // Where a part of the set leaves little more than noise, the rounds find what is missing beside it.
        let is_part = |m: &FittedModel| {
            let has = |own: &Hypothesis| effects.iter().any(|h| h.identity() == own.identity());
            m.effects.len() < effects.len() && m.effects.iter().all(has)
        };
        let is_found = prepared.iter().any(|m| is_part(m) && m.is_near_the_floor());
        if is_found {
            continue;
        }
        if context.must_end() {
            break;
        }
        // Without springs, small steps are taken near rest alone. With them a start may take more steps than the declared model may, but its
        // fit no more than that: with the full limit the blind set of machines with springs takes three times as long.
        if !problem.machine.springs.is_empty() {
            let needed = steps_needed_at(&problem, &start).unwrap_or(1.0);
            problem.max_steps = declared.problem.max_steps.max(needed).min(problem.max_steps);
        }
        let model = fit_model(problem, &start, own, effects, context.threads, FIT_ITERATIONS);
        prepared.push(with_sharper_friction(with_shapes_beyond(model, own), own));
    }
    (declared, prepared)
}

/// A free parameter that moved by e to this power from its file value may hide a missing effect.
const FAR_FROM_FILE: f64 = 0.7;

/// Whether a free parameter of the declared model is far from its value in the file.
fn is_far(declared: &Problem, file: &Point, at: &Point) -> bool {
    let logarithms = (0..file.globals.len()).filter(|g| declared.globals[*g].law.logarithm);
    let far = logarithms.map(|g| (file.globals[g] - at.globals[g]).abs()).fold(0.0, f64::max);
    declared.machine.effort().restarts > 0 && far >= FAR_FROM_FILE
}

/// Number of best sets that are fitted again from the file's parameters.
const REFITTED_SETS: usize = 2;

/// Fits a set of effects again from the file's parameters, if it is far from them: the effects that were missing when
/// the parameters moved away are now in the set.
fn from_the_file<'a>(
    declared: &FittedModel<'a>,
    model: &FittedModel<'a>,
    own: &'a Data,
    context: &Context,
) -> Option<FittedModel<'a>> {
    let file = declared.problem.start();
    if !is_far(&declared.problem, &file, &model.fit.point) || context.must_end() {
        return None;
    }
    let mut start = model.fit.point.clone();
    start.globals[..file.globals.len()].copy_from_slice(&file.globals);
    Some(fit_model(model.problem.clone(), &start, own, model.effects.clone(), context.threads, 40))
}

/// The declared model with the parameters of its file, if the fit has moved one far away. The search for effects is
/// repeated from there.
fn near_the_file<'a>(declared: &FittedModel<'a>, own: &'a Data, context: &Context) -> Option<FittedModel<'a>> {
    let start = declared.problem.start();
    if !is_far(&declared.problem, &start, &declared.fit.point) || context.must_end() {
        return None;
    }
    // With the parameters fixed at the file's values, only the initial states of the segments are fitted.
    let mut held = declared.problem.clone();
    held.globals.clear();
    let options = FitOptions { iterations: 20, threads: context.threads };
    let locals = fit(&held, &Point { globals: Vec::new(), locals: start.locals }, options).point.locals;
    let point = Point { globals: start.globals, locals };
    let found = fit(&declared.problem, &point, FitOptions { iterations: 0, ..options });
    Some(FittedModel::new(declared.problem.clone(), found, Vec::new(), own, context.threads))
}

/// Hypotheses for a model, with their screening results.
#[derive(Clone)]
pub(super) struct ScreenedHypotheses {
    pub hypotheses: Vec<Hypothesis>,
    pub screenings: Vec<ScreeningResult>,
    /// Where every segment of the model began [pitches]; none where motions have no period.
    travels: Vec<f64>,
    /// Effects that were left out, and why.
    left_out: Vec<(String, String)>,
}

pub(super) fn screened(
    spec: &CandidateSpec,
    model: &FittedModel,
    base: &LinearisedBase,
    context: &Context,
) -> ScreenedHypotheses {
    screened_again(spec, model, base, None, context)
}

/// Hypotheses whose screening takes runs of its own, that are screened again beside an accepted effect: those that promise most by what they did
/// before. Not varied.
const RESCREENED: usize = 8;

/// As [`screened`], where an earlier screening of the declared model is known. Where a column takes a run of links, those that promise little by
/// their earlier columns keep them.
fn screened_again(
    spec: &CandidateSpec,
    model: &FittedModel,
    base: &LinearisedBase,
    earlier: Option<&ScreenedHypotheses>,
    context: &Context,
) -> ScreenedHypotheses {
    let mut sizes = Sizes::new(&model.problem, &model.fit.point);
    sizes.orders = standing_orders(model, context.threads);
    let slots: Vec<usize> = model.problem.globals.iter().map(|g| g.slot).collect();
    let (m, data) = (&model.problem.machine, model.problem.data);
    let mut left_out = Vec::new();
    let mut hypotheses = candidates::all(m, data, &sizes, spec, &slots, &mut left_out);
    // A clock that errs is looked for by simulation alone.
    let predicts = model.problem.correction > 0.0;
    hypotheses.retain(|h| !(predicts && matches!(h.effect.physics, Physics::Clock(_))));
    let known = |h: &Hypothesis| {
        let earlier = earlier.filter(|_| m.shows_at_start_alone(h.effect))?;
        let at = earlier.hypotheses.iter().position(|e| e.identity() == h.identity() && e.values == h.values)?;
        Some(&earlier.screenings[at]).filter(|p| p.idle || p.columns.len() == 1)
    };
    let travels = travels_of(model);
    let earlier_travels = earlier.map_or(&[][..], |e| &e.travels);
    let moved: Vec<[f64; 2]> = earlier_travels.iter().zip(&travels).map(|(was, now)| [*was, *now]).collect();
    let alike = m.period_pitches().map_or(1.0, |p| f64::from(p.alike));
    let again = |h: &Hypothesis| {
        let row = h.amplitudes().first().map(|i| h.rows[*i]).filter(|row| row.off == 0.0)?;
        Some(base.reused(known(h)?, h, (&moved, alike), m.size_range(h.effect, h.target, row)))
    };
    let mut reused: Vec<Option<ScreeningResult>> = hypotheses.iter().map(again).collect();
    let mut order: Vec<usize> = (0..reused.len()).filter(|i| reused[*i].as_ref().is_some_and(|p| !p.idle)).collect();
    let gain = |i: &usize| reused[*i].as_ref().map_or(0.0, |p| p.gain);
    order.sort_by(|a, b| gain(b).total_cmp(&gain(a)).then(a.cmp(b)));
    order.truncate(RESCREENED);
    order.into_iter().for_each(|i| reused[i] = None);
    let screened = |i: usize| match &reused[i] {
        Some(known) => known.clone(),
        None if context.must_end() => ScreeningResult::unseen(&hypotheses[i], data.records.len()),
        None => screen(&model.problem, base, &model.fit, &hypotheses[i]),
    };
    let screenings = parallel(hypotheses.len(), context.threads, screened);
    ScreenedHypotheses { hypotheses, screenings, travels, left_out }
}

/// Where every segment of a model begins in its period [pitches].
fn travels_of(model: &FittedModel) -> Vec<f64> {
    let travel = model.problem.locals.iter().position(|l| *l == Local::Travel);
    travel.map_or(Vec::new(), |at| model.fit.point.locals.iter().map(|own| own[at]).collect())
}

/// The model with one more effect of those of `spec`, in every form that justifies a fit.
pub(super) fn grown<'a>(
    spec: &CandidateSpec,
    model: &FittedModel<'a>,
    own: &'a Data,
    context: &Context<'_>,
    seen: &mut Vec<Vec<String>>,
) -> Vec<FittedModel<'a>> {
    let screened_now = screened(spec, model, &LinearisedBase::new(&model.problem, &model.fit), context);
    extend_by_one_effect(screened_now, model, own, context, seen, &mut Vec::new(), &mut Vec::new())
}

/// Effective samples of every channel, from the residuals of the model with the smallest error.
pub(super) fn best_effective(models: &[FittedModel]) -> Vec<f64> {
    let error = |m: &FittedModel| judge::mean_error(&m.fit_residuals);
    models
        .iter()
        .min_by(|a, b| error(a).total_cmp(&error(b)))
        .map_or_else(Vec::new, |m| judge::effective(&m.fit_residuals))
}

/// Records a fit. Of several fits with the same effects, only the best is kept.
fn record_trial(trials: &mut Vec<Trial>, identity: String, beside: &[String], promised: Option<f64>, rms_fit: f64) {
    let old = trials.iter_mut().find(|t| t.identity == identity && t.beside == beside);
    let before = old.as_ref().and_then(|t| t.rms_fit);
    if before.is_some_and(|rms| rms <= rms_fit) {
        return;
    }
    let promised = promised.or(old.as_ref().map(|t| t.promised)).unwrap_or(0.0);
    let (rms_fit, beside) = (Some(rms_fit), beside.to_vec());
    let trial = Trial { identity, beside, promised, rms_fit, rms_judge: None, score: None, why: String::new() };
    match old {
        Some(old) => *old = trial,
        None => trials.push(trial),
    }
}

/// So many orders of one effect on one body are fitted at most, those that promise most.
const ORDERS_FITTED: usize = 3;

/// Why there is no fit of an effect that the end of the budget has left out.
const NOT_LOOKED_AT: &str = "not looked at: the budget was spent";

/// The model with one more effect, in every form that justifies a fit.
fn extend_by_one_effect<'a>(
    screened: ScreenedHypotheses,
    model: &FittedModel<'a>,
    own: &'a Data,
    context: &Context<'_>,
    seen: &mut Vec<Vec<String>>,
    trials: &mut Vec<Trial>,
    reasons: &mut Vec<(String, String)>,
) -> Vec<FittedModel<'a>> {
    let ScreenedHypotheses { hypotheses, screenings, travels: _, left_out } = screened;
    for r in left_out {
        if !reasons.contains(&r) {
            reasons.push(r);
        }
    }
    let unseen = |i: usize| screenings[i].columns.is_empty() && !screenings[i].idle;
    // The best form of every identity; hypotheses that cannot be screened are always fitted.
    let mut order: Vec<usize> = (0..hypotheses.len()).collect();
    order.sort_by(|a, b| screenings[*b].gain.total_cmp(&screenings[*a].gain).then(a.cmp(b)));
    let most = screenings.iter().map(|p| p.gain).fold(0.0, f64::max);
    let mut chosen: Vec<usize> = Vec::new();
    let mut linear = 0;
    for i in order {
        let unscreened = unseen(i);
        let id = hypotheses[i].identity();
        let others = chosen.iter().filter(|c| hypotheses[**c].identity() == id).count();
        let useful = unscreened || screenings[i].gain > (0.1 * most).max(1e-4);
        if !useful || others > usize::from(hypotheses[i].rows.len() > 1) {
            continue;
        }
        let orders = chosen.iter().map(|c| &hypotheses[*c]).filter(|h| h.path() == hypotheses[i].path());
        if orders.map(Hypothesis::identity).filter(|other| *other != id).collect::<BTreeSet<_>>().len() >= ORDERS_FITTED
        {
            continue;
        }
        if !unscreened {
            if others == 0 {
                linear += 1;
            }
            if linear > model.problem.machine.effort().fitted {
                continue;
            }
        }
        chosen.push(i);
    }
    let beside: Vec<String> = model.effects.iter().map(Hypothesis::identity).collect();
    for i in 0..hypotheses.len() {
        let id = hypotheses[i].identity();
        let fitted = chosen.iter().any(|c| hypotheses[*c].identity() == id);
        let known = trials.iter().any(|t| t.identity == id && t.beside == beside);
        if !fitted && !known {
            trials.push(Trial {
                identity: id,
                beside: beside.clone(),
                promised: screenings[i].gain,
                rms_fit: None,
                rms_judge: None,
                score: None,
                why: match (screenings[i].idle, unseen(i) && context.must_end()) {
                    (true, _) => "changes nothing in these records".into(),
                    (false, true) => NOT_LOOKED_AT.into(),
                    (false, false) => "screening: explains less than others".into(),
                },
            });
        }
    }
    let jobs: Vec<usize> = chosen
        .into_iter()
        .filter(|i| {
            let mut id = beside.clone();
            id.push(hypotheses[*i].identity());
            id.sort();
            !seen.contains(&id)
        })
        .collect();
    let begin = |job: usize| {
        let (h, p) = (&hypotheses[jobs[job]], &screenings[jobs[job]]);
        // Without a screening result the fit starts from the hypothesis' own values.
        let (base, point) = (&model.problem, &model.fit.point);
        let (problem, mut start) = match p.columns.is_empty() {
            true => candidates::with_hypothesis(base, point, h, &p.fit_start),
            false => candidates::with_stable_start(base, point, h, &p.fit_start, 1),
        };
        if p.columns.is_empty() && is_signal(h.effect) {
            problem.reverse_better_starts(&mut start, 1);
        }
        (problem, start, model.effects.iter().cloned().chain([h.clone()]).collect())
    };
    let fits = race((jobs.len(), model.problem.machine.effort().is_thorough), begin, own, context);
    let mut models: Vec<FittedModel<'a>> = Vec::new();
    for (i, m) in jobs.iter().zip(fits) {
        let Some(mut m) = m else {
            let identity = hypotheses[*i].identity();
            if trials.iter().all(|t| t.identity != identity || t.beside != beside) {
                let (promised, beside, why) = (screenings[*i].gain, beside.clone(), NOT_LOOKED_AT.into());
                trials.push(Trial { identity, beside, promised, rms_fit: None, rms_judge: None, score: None, why });
            }
            continue;
        };
        m.threads = context.threads;
        let id = m.identity();
        let rms_fit = stats::rms(&m.fit_residuals[0]);
        record_trial(trials, hypotheses[*i].identity(), &beside, Some(screenings[*i].gain), rms_fit);
        // A form outside the records is dropped here, before two forms of one effect are compared. Its set is not marked as seen: another fit may lie inside.
        if !takes_part(&m, trials) {
            continue;
        }
        match models.iter_mut().find(|o| o.identity() == id) {
            Some(o) if o.misfit() > m.misfit() => *o = m,
            Some(_) => {}
            None => models.push(m),
        }
    }
    for m in &models {
        // Another fit of a set that was given up may begin at a better place.
        if m.given_up.is_none() {
            seen.push(m.identity());
        }
        // Another form of the same effect lay outside the records.
        trials.iter_mut().filter(|t| t.is_of(m) && t.why.starts_with(OUTSIDE)).for_each(|t| t.why.clear());
    }
    models
}
