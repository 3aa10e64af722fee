//! The search: baseline, hypotheses, pairs, acceptance, rivals.
//!
//! A beam of sets of effects grows by one effect a round. Greedy search is not enough: on the coupled drives three rivals are
//! within noise of each other in the first round, and only what follows tells them apart. What fits decides who is looked at,
//! what judges decides who is believed.

use super::candidates::{self, Hypothesis, Sizes};
use super::fit::{Fit, Options, fit, parallel};
use super::judge::{self, Residuals};
use super::problem::{Global, Law, Point, Problem};
use super::screen::{Base, Promise, promise};
use super::stats::{self, Random};
use super::structure::{self, Alike, Detectable};
use crate::machine::Machine;
use crate::machine::simulate::{MOST_STEPS, steps_needed};
use crate::measurement::segments::Data;
use crate::measurement::{Measurement, Scope};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

/// How much a search may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    pub runs: Option<u64>,
    pub seconds: Option<f64>,
}

/// What goes on, for a progress bar.
pub type Progress<'a> = &'a (dyn Fn(&str, u64) + Sync);

/// Everything a search needs beside data and machine.
pub struct Context<'a> {
    pub threads: usize,
    pub budget: Budget,
    pub started: Instant,
    pub stop: &'a AtomicBool,
    pub progress: Progress<'a>,
    pub runs: &'a AtomicU64,
}

impl Context<'_> {
    /// Interrupted, or out of budget.
    pub fn ends(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
            || self.budget.runs.is_some_and(|n| self.runs.load(Ordering::Relaxed) >= n)
            || self.budget.seconds.is_some_and(|s| self.started.elapsed().as_secs_f64() >= s)
    }

    pub fn say(&self, stage: &str) {
        (self.progress)(stage, self.runs.load(Ordering::Relaxed));
    }
}

/// A set of effects, fitted.
#[derive(Clone, Debug)]
pub struct Model<'a> {
    pub problem: Problem<'a>,
    pub fit: Fit,
    pub residuals: Residuals,
    pub effects: Vec<Hypothesis>,
}

impl Model<'_> {
    pub fn freedom(&self, records: usize) -> usize {
        self.effects.iter().map(|h| h.freedom(records)).sum()
    }

    fn identity(&self) -> Vec<String> {
        let mut id: Vec<String> = self.effects.iter().map(Hypothesis::identity).collect();
        id.sort();
        id
    }
}

/// What became of a hypothesis.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Trial {
    pub identity: String,
    /// Effects that were in the model already.
    pub beside: Vec<String>,
    /// Share of the cost that screening promised.
    pub promised: f64,
    pub rms_fit: Option<f64>,
    pub rms_judge: Option<f64>,
    /// Score beyond the model without it; negative is better.
    pub score: Option<f64>,
    pub why: String,
}

/// What a search found.
pub struct Found<'a> {
    pub declared: Model<'a>,
    pub best: Model<'a>,
    /// For every effect of the best model: what cannot be told from it.
    pub rivals: Vec<Vec<Rival>>,
    pub trials: Vec<Trial>,
    pub reasons: Vec<(String, String)>,
    /// For every effect of the best model: what made it accepted.
    pub grounds: Vec<Ground>,
    pub detectable: Vec<Detectable>,
    pub alike: Vec<Alike>,
    pub cut_short: bool,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Rival {
    pub identity: String,
    pub path: String,
    pub score: f64,
    pub judge_ratio: [f64; 3],
}

/// Why an effect was accepted.
#[derive(Clone, Debug, PartialEq)]
pub struct Ground {
    pub identity: String,
    /// Error on what judges with it to that without it.
    pub judge_ratio: [f64; 3],
    /// Score without it minus score with it.
    pub score: f64,
    /// Share of the cost taken, and the same of the median and best sham.
    pub gain: f64,
    pub sham: f64,
}

/// Sets that a round goes on with.
const BEAM: usize = 6;
/// A set whose score is worse than the best by more is not gone on with.
const HOPE: f64 = 60.0;
/// Hypotheses that are fitted in a round for each set.
const FITTED: usize = 6;
/// Most effects.
pub const MOST_EFFECTS: usize = 4;
/// An effect whose score is worth less is not looked at further: positive evidence after Kass and Raftery 1995, no more. What
/// judges, shams and standard errors have to believe it as well, and they are stricter.
const WORTH: f64 = 3.0;
/// Two sets whose scores differ by less are rivals; twice the natural logarithm of a likelihood ratio of 150.
const CLEAR: f64 = 10.0;
/// An effect that leaves more than this of the error on what judges is not named: it is smaller than a third of what is left.
const WORTH_A_NAME: f64 = 0.95;
/// An effect explains three times as much as a sham, or leaves at most this share of what a sham leaves.
const SHAM: f64 = 0.8;
/// Shams an accepted effect is held against.
const SHAMS: usize = 40;

/// The declared model with its free numbers.
pub fn declared<'a>(
    measurement: &Measurement,
    machine: &Machine,
    data: &'a Data,
    context: &'a Context<'a>,
) -> Problem<'a> {
    let mut globals = Vec::new();
    let mut locals = Problem::default_locals(machine, data);
    for spec in &measurement.fit {
        let Some(slot) = machine.slot(&spec.path) else { continue };
        let (value, s) = (machine.values[slot], &machine.slots[slot]);
        let low = spec.low.unwrap_or(s.low).max(s.low) * s.unit;
        let high = spec.high.unwrap_or(s.high).min(s.high) * s.unit;
        let logarithm = value > 0.0 && low >= 0.0;
        let law = Law {
            scale: if value == 0.0 { scale_of_zero(low, high) } else { value.abs() },
            logarithm,
            low: if logarithm { low.max(value * 1e-9) } else { low },
            high,
        };
        let prior = spec.spread.map(|spread| (law.seen(value), spread));
        match spec.scope {
            Scope::All => globals.push(Global { slot, record: None, law, prior }),
            Scope::Record => {
                let all = 0..data.records.len();
                globals.extend(all.map(|r| Global { slot, record: Some(r), law, prior }));
            }
            Scope::Part => locals.push(super::problem::Local::Slot { slot, law }),
        }
    }
    Problem {
        machine: machine.clone(),
        data,
        channels: data.channels.iter().map(|c| c.sensor).collect(),
        weights: data.channels.iter().map(|c| c.noise.max(1e-12)).collect(),
        globals,
        locals,
        most_steps: MOST_STEPS,
        runs: context.runs,
    }
}

/// A step for a number that is zero so far, inside its bounds.
fn scale_of_zero(low: f64, high: f64) -> f64 {
    let width = (high - low).abs();
    if width < 1e3 { (0.01 * width).max(1e-9) } else { 1.0 }
}

/// Fits, weighs channels by what is left of them, and fits again.
fn fitted<'a>(
    mut problem: Problem<'a>,
    start: &Point,
    own: &Data,
    effects: Vec<Hypothesis>,
    threads: usize,
    iterations: usize,
) -> Model<'a> {
    let options = Options { iterations, threads };
    let found = fit(&problem, start, options);
    if problem.channels.len() > 1 {
        let residuals = judge::residuals(&problem, &found, own, threads);
        for (c, w) in problem.weights.iter_mut().enumerate() {
            *w = stats::rms(&residuals.fit[c]).max(problem.data.channels[c].noise).max(1e-12);
        }
        let found = fit(&problem, &found.point, options);
        let residuals = judge::residuals(&problem, &found, own, threads);
        return Model { problem, fit: found, residuals, effects };
    }
    let residuals = judge::residuals(&problem, &found, own, threads);
    Model { problem, fit: found, residuals, effects }
}

/// The baseline: from the drive's own numbers, and from some around them, so that no far minimum is missed.
pub fn baseline<'a>(problem: Problem<'a>, own: &Data, context: &Context) -> Model<'a> {
    let start = problem.start();
    let mut best = fitted(problem.clone(), &start, own, Vec::new(), context.threads, 60);
    let mut random = Random::new(7);
    for _ in 0..4 {
        if context.ends() || problem.globals.is_empty() {
            break;
        }
        let mut other = start.clone();
        for (x, g) in other.globals.iter_mut().zip(&problem.globals) {
            let d = (random.below(2001) as f64 / 1000.0 - 1.0) * g.prior.map_or(1.0, |(_, s)| s.min(1.0));
            *x += d;
        }
        let model = fitted(problem.clone(), &other, own, Vec::new(), context.threads, 40);
        if model.fit.cost < best.fit.cost * (1.0 - 1e-6) {
            best = model;
        }
    }
    best
}

/// Score of a model: deviance on what fits and what each number costs. Smaller is better.
fn score(model: &Model, effective: &[f64], records: usize) -> f64 {
    let n: f64 = effective.iter().sum();
    model.residuals.deviance(effective) + model.freedom(records) as f64 * libm::log(n.max(2.0))
}

/// The whole search.
pub fn search<'a>(measurement: &Measurement, problem: Problem<'a>, own: &Data, context: &Context<'_>) -> Found<'a> {
    let records = problem.data.records.len();
    context.say("fitting the declared model");
    let mut declared = baseline(problem, own, context);
    // What is added may be stiffer than what was declared, but not by so much that a search takes days.
    let needed = declared
        .problem
        .data
        .segments
        .iter()
        .map(|s| steps_needed(&declared.problem.machine, &declared.problem.machine.values, &s.task, &s.start));
    declared.problem.most_steps = (4.0 * needed.fold(1.0, f64::max)).clamp(16.0, MOST_STEPS);
    let (detectable, alike) = first_look(measurement, &declared, context);
    let mut reasons = Vec::new();
    let mut trials: Vec<Trial> = Vec::new();
    let mut beam: Vec<Model<'a>> = vec![declared.clone()];
    let mut seen: Vec<Vec<String>> = vec![Vec::new()];
    let mut all: Vec<Model<'a>> = vec![declared.clone()];
    let mut cut_short = false;
    for round in 1..=MOST_EFFECTS {
        let mut next: Vec<Model<'a>> = Vec::new();
        for model in &beam {
            if context.ends() {
                cut_short = true;
                break;
            }
            context.say(&format!("round {round}: looking at hypotheses"));
            let grown = grow(measurement, model, own, context, &mut seen, &mut trials, &mut reasons);
            next.extend(grown);
        }
        if next.is_empty() {
            break;
        }
        // Effective samples by the best of them, the same for all.
        all.extend(next.iter().cloned());
        let effective = best_effective(&all);
        next.sort_by(|a, b| score(a, &effective, records).total_cmp(&score(b, &effective, records)));
        next.truncate(BEAM);
        let lead = next.first().map_or(f64::MAX, |m| score(m, &effective, records));
        next.retain(|m| score(m, &effective, records) <= lead + HOPE);
        let before = beam.iter().map(|m| score(m, &effective, records)).fold(f64::MAX, f64::min);
        let after = next.first().map_or(f64::MAX, |m| score(m, &effective, records));
        if after > before - WORTH {
            break;
        }
        beam = next;
        if cut_short {
            break;
        }
    }
    let effective = best_effective(&all);
    all.sort_by(|a, b| score(a, &effective, records).total_cmp(&score(b, &effective, records)));
    context.say("holding what was found against what it has not seen");
    let found = finish(declared, all, &effective, own, context, trials, reasons, cut_short);
    Found { detectable, alike, ..found }
}

/// What could be seen, and what could not be told apart, at the declared model.
fn first_look(measurement: &Measurement, model: &Model, context: &Context) -> (Vec<Detectable>, Vec<Alike>) {
    let sizes = Sizes::of(&model.problem, &model.fit.point);
    let slots: Vec<usize> = model.problem.globals.iter().map(|g| g.slot).collect();
    let m = &model.problem.machine;
    let all = candidates::all(m, model.problem.data, &sizes, &measurement.candidates, &slots, &mut Vec::new());
    let base = Base::new(&model.problem, &model.fit);
    let promises = parallel(all.len(), context.threads, |i| promise(&model.problem, &base, &model.fit, &all[i]));
    (structure::detectable(m, &base, &all, &promises), structure::alike(&all, &promises))
}

/// Effective samples of every channel, from the residuals of the model with the smallest error.
fn best_effective(models: &[Model]) -> Vec<f64> {
    let error = |m: &Model| -> f64 { m.residuals.fit.iter().map(|p| libm::log(stats::rms(p).max(1e-300))).sum() };
    models.iter().min_by(|a, b| error(a).total_cmp(&error(b))).map_or_else(Vec::new, |m| m.residuals.effective())
}

/// A model with one effect more, in every way that is worth a fit.
fn grow<'a>(
    measurement: &Measurement,
    model: &Model<'a>,
    own: &Data,
    context: &Context<'_>,
    seen: &mut Vec<Vec<String>>,
    trials: &mut Vec<Trial>,
    reasons: &mut Vec<(String, String)>,
) -> Vec<Model<'a>> {
    let data = model.problem.data;
    let sizes = Sizes::of(&model.problem, &model.fit.point);
    let slots: Vec<usize> = model.problem.globals.iter().map(|g| g.slot).collect();
    let mut left_out = Vec::new();
    let hypotheses =
        candidates::all(&model.problem.machine, data, &sizes, &measurement.candidates, &slots, &mut left_out);
    for r in left_out {
        if !reasons.contains(&r) {
            reasons.push(r);
        }
    }
    let base = Base::new(&model.problem, &model.fit);
    let promises: Vec<Promise> =
        parallel(hypotheses.len(), context.threads, |i| promise(&model.problem, &base, &model.fit, &hypotheses[i]));
    // The best form of every identity; those that cannot be screened are always fitted.
    let mut order: Vec<usize> = (0..hypotheses.len()).collect();
    order.sort_by(|a, b| promises[*b].gain.total_cmp(&promises[*a].gain).then(a.cmp(b)));
    let most = promises.iter().map(|p| p.gain).fold(0.0, f64::max);
    let mut chosen: Vec<usize> = Vec::new();
    let mut linear = 0;
    for i in order {
        let unscreened = promises[i].columns.is_empty();
        let id = hypotheses[i].identity();
        let others = chosen.iter().filter(|c| hypotheses[**c].identity() == id).count();
        let useful = unscreened || promises[i].gain > (0.1 * most).max(1e-4);
        if !useful || others > usize::from(hypotheses[i].rows.len() > 1) {
            continue;
        }
        if !unscreened {
            if others == 0 {
                linear += 1;
            }
            if linear > FITTED {
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
                promised: promises[i].gain,
                rms_fit: None,
                rms_judge: None,
                score: None,
                why: "screening: explains less than others".into(),
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
    context.say("fitting hypotheses");
    let fits = parallel(jobs.len(), context.threads, |job| {
        if context.ends() {
            return None;
        }
        let h = &hypotheses[jobs[job]];
        let p = &promises[jobs[job]];
        let (problem, start) = candidates::with(&model.problem, &model.fit.point, h, &p.values, &p.phases);
        let effects = model.effects.iter().cloned().chain([h.clone()]).collect();
        let model = fitted(problem, &start, own, effects, 1, 40);
        context.say("fitting hypotheses");
        Some(model)
    });
    let mut models: Vec<Model<'a>> = Vec::new();
    for (i, m) in jobs.iter().zip(fits) {
        let Some(m) = m else { continue };
        let id = m.identity();
        let c = 0;
        let (rms_fit, rms_judge) = m.residuals.rms(c);
        trials.push(Trial {
            identity: hypotheses[*i].identity(),
            beside: beside.clone(),
            promised: promises[*i].gain,
            rms_fit: Some(rms_fit),
            rms_judge: Some(rms_judge),
            score: None,
            why: String::new(),
        });
        match models.iter_mut().find(|o| o.identity() == id) {
            Some(o) if o.fit.cost > m.fit.cost => *o = m,
            Some(_) => {}
            None => models.push(m),
        }
    }
    for m in &models {
        seen.push(m.identity());
    }
    models
}

/// A model with one hypothesis more, fitted.
pub fn refit_with<'a>(
    model: &Model<'a>,
    h: &Hypothesis,
    values: &[f64],
    phases: &[f64],
    own: &Data,
    threads: usize,
) -> Model<'a> {
    let (problem, start) = candidates::with(&model.problem, &model.fit.point, h, values, phases);
    let effects = model.effects.iter().cloned().chain([h.clone()]).collect();
    fitted(problem, &start, own, effects, threads, 40)
}

/// A model without one of its effects, fitted again from the others' numbers.
fn without_effect<'a>(declared: &Model<'a>, model: &Model<'a>, which: usize, own: &Data, threads: usize) -> Model<'a> {
    let rest: Vec<usize> = (0..model.effects.len()).filter(|i| *i != which).collect();
    rebuilt(declared, model, &rest, None, own, threads)
}

/// A model with some of another's effects, and perhaps one more, fitted from their numbers.
fn rebuilt<'a>(
    declared: &Model<'a>,
    model: &Model<'a>,
    kept: &[usize],
    more: Option<(&Hypothesis, &[f64], &[f64])>,
    own: &Data,
    threads: usize,
) -> Model<'a> {
    let n_declared = declared.problem.globals.len();
    let mut problem = declared.problem.clone();
    problem.weights.clone_from(&model.problem.weights);
    let mut point = declared.fit.point.clone();
    point.globals.clone_from_slice(&model.fit.point.globals[..n_declared]);
    point.locals.clone_from(&model.fit.point.locals);
    let records = problem.data.records.len();
    let mut effects = Vec::new();
    let mut at = n_declared;
    for (i, h) in model.effects.iter().enumerate() {
        let mut values = h.values.clone();
        let mut phases = vec![0.0; records];
        for (k, row) in h.rows.iter().enumerate() {
            use crate::effects::Kind;
            match row.kind {
                Kind::Amplitude | Kind::Shape | Kind::PerMark => {
                    values[k] = model.problem.globals[at].law.value(model.fit.point.globals[at]);
                    at += 1;
                }
                Kind::Phase => {
                    for phase in &mut phases {
                        *phase = model.problem.globals[at].law.value(model.fit.point.globals[at]);
                        at += 1;
                    }
                }
                Kind::Whole | Kind::Given => {}
            }
        }
        if kept.contains(&i) {
            (problem, point) = candidates::with(&problem, &point, h, &values, &phases);
            effects.push(Hypothesis { values, ..h.clone() });
        }
    }
    if let Some((h, values, phases)) = more {
        (problem, point) = candidates::with(&problem, &point, h, values, phases);
        effects.push(h.clone());
    }
    fitted(problem, &point, own, effects, threads, 40)
}

/// The set to be judged: of every size the best whose effects all stand, and a larger one only if it leaves clearly less of the
/// error. Many samples make small differences certain; they do not make them worth a name.
fn smallest_that_stands<'a>(declared: &Model<'a>, all: &[Model<'a>], effective: &[f64]) -> Model<'a> {
    let mut best = declared;
    let records = declared.problem.data.records.len();
    for size in 1..=MOST_EFFECTS {
        // In the order of their scores.
        let next = all.iter().filter(|m| m.effects.len() == size).find(|m| {
            let ratio = m.residuals.judge_ratio(&best.residuals);
            // What judges was not fitted to: its likelihood counts in full, without a price for numbers.
            let judged = m.residuals.judge_effective();
            let predicted = best.residuals.judge_deviance(&judged) - m.residuals.judge_deviance(&judged);
            let worth = score(best, effective, records) - score(m, effective, records) + predicted;
            worth >= WORTH && ratio[0] <= WORTH_A_NAME && ratio[2] < 1.0 && stands(m, all, effective)
        });
        best = next.unwrap_or(best);
    }
    best.clone()
}

/// Whether every effect of a set improves on the set without it, as far as that one was fitted.
fn stands(model: &Model, all: &[Model], effective: &[f64]) -> bool {
    let records = model.problem.data.records.len();
    model.effects.iter().all(|e| {
        let mut rest: Vec<String> = model.identity();
        let own = e.identity();
        rest.retain(|id| *id != own);
        let Some(less) = all.iter().find(|m| m.identity() == rest) else { return true };
        let ratio = model.residuals.judge_ratio(&less.residuals);
        let judged = model.residuals.judge_effective();
        let predicted = less.residuals.judge_deviance(&judged) - model.residuals.judge_deviance(&judged);
        let worth = score(less, effective, records) - score(model, effective, records) + predicted;
        worth >= WORTH && ratio[0] <= WORTH_A_NAME && ratio[2] < 1.0
    })
}

/// Prunes, asks every effect for its grounds, looks for rivals of those that stay.
fn finish<'a>(
    declared: Model<'a>,
    all: Vec<Model<'a>>,
    effective: &[f64],
    own: &Data,
    context: &Context<'_>,
    mut trials: Vec<Trial>,
    reasons: Vec<(String, String)>,
    cut_short: bool,
) -> Found<'a> {
    let records = declared.problem.data.records.len();
    let mut best = smallest_that_stands(&declared, &all, effective);
    let mut grounds: Vec<Ground> = Vec::new();
    // Take away what does not stand, one at a time, the weakest first.
    loop {
        let mut weakest: Option<(f64, Model<'a>, usize, String)> = None;
        grounds.clear();
        for which in 0..best.effects.len() {
            let less = without_effect(&declared, &best, which, own, context.threads);
            let worth = score(&less, effective, records) - score(&best, effective, records);
            let ratio = best.residuals.judge_ratio(&less.residuals);
            let (gain, sham) = shams(&best, &less, which, context.threads);
            let bound = at_bound(&best, which);
            let sure = sigmas(&best, which);
            let why = if worth < WORTH {
                Some(format!("worth {worth:.1}, less than {WORTH}"))
            } else if ratio[0] > WORTH_A_NAME || ratio[2] >= 1.0 {
                Some(format!(
                    "on what judges the error is {:.3} times that without it [{:.3}, {:.3}]",
                    ratio[0], ratio[1], ratio[2]
                ))
            } else if gain < 3.0 * sham && 1.0 - gain > SHAM * (1.0 - sham) {
                Some(format!("explains {:.1} %, a sham {:.1} %", 100.0 * gain, 100.0 * sham))
            } else if sure < 3.0 {
                Some(format!("its size is {sure:.1} standard errors from nothing"))
            } else {
                bound
            };
            if let Some(why) = why
                && weakest.as_ref().is_none_or(|(w, ..)| worth < *w)
            {
                weakest = Some((worth, less, which, why));
            }
            grounds.push(Ground {
                identity: best.effects[which].identity(),
                judge_ratio: ratio,
                score: worth,
                gain,
                sham,
            });
        }
        let Some((_, less, which, why)) = weakest else { break };
        let id = best.effects[which].identity();
        for t in trials.iter_mut().filter(|t| t.identity == id && t.rms_fit.is_some() && t.why.is_empty()) {
            t.why = format!("not accepted: {why}");
        }
        best = less;
    }
    let rivals = rivals(&declared, &best, &all, effective, own, context, &mut trials);
    let accepted: Vec<String> = best.effects.iter().map(Hypothesis::identity).collect();
    let best_score = score(&best, effective, records);
    for t in &mut trials {
        let model = all.iter().find(|m| {
            let mut id = t.beside.clone();
            id.push(t.identity.clone());
            id.sort();
            m.identity() == id
        });
        if let Some(m) = model {
            t.score = Some(score(m, effective, records) - best_score);
            if t.why.is_empty() {
                t.why = if accepted.contains(&t.identity) {
                    "accepted".into()
                } else {
                    let (rms, _) = m.residuals.rms(0);
                    let (best_rms, _) = best.residuals.rms(0);
                    if rms > best_rms {
                        format!("leaves {:.3} times the error of what was accepted", rms / best_rms)
                    } else {
                        format!(
                            "beside what was accepted it leaves {:.3} times the error: not worth a name",
                            rms / best_rms
                        )
                    }
                };
            }
        }
    }
    let (detectable, alike) = (Vec::new(), Vec::new());
    Found { declared, best, rivals, trials, reasons, grounds, detectable, alike, cut_short }
}

/// Gain of an effect over the model without it, by screening, and the median gain of its shams.
fn shams(best: &Model, less: &Model, which: usize, threads: usize) -> (f64, f64) {
    let h = &best.effects[which];
    let base = Base::new(&less.problem, &less.fit);
    // Squares of all channels by the weights of the smaller model: units do not matter.
    let squares = |r: &Residuals| -> f64 {
        let of = r.fit.iter().zip(&less.problem.weights);
        of.map(|(parts, w)| parts.iter().flatten().map(|x| x * x / (w * w)).sum::<f64>()).sum()
    };
    let gain = 1.0 - squares(&best.residuals) / squares(&less.residuals).max(1e-300);
    if h.phase().is_some() {
        // A wave with a free phase explains as much when it is shifted: no sham.
        return (gain, 0.0);
    }
    let p = promise(&less.problem, &base, &less.fit, h);
    if p.columns.is_empty() {
        return (gain, 0.0);
    }
    let mut random = Random::new(3);
    let shifts: Vec<usize> = (0..SHAMS).map(|_| 100 + random.below(800)).collect();
    let mut gains = parallel(SHAMS, threads, |i| base.gain(&base.shifted(&p.columns, shifts[i])));
    (gain, crate::measurement::facts::median(&mut gains))
}

/// Indices of an effect's globals.
fn globals_of(model: &Model, which: usize) -> Vec<usize> {
    let path = format!("{}.", placed_path(model, which));
    (0..model.problem.globals.len())
        .filter(|g| model.problem.machine.slots[model.problem.globals[*g].slot].path.starts_with(&path))
        .collect()
}

/// Path under which an effect stands in the machine.
pub fn placed_path(model: &Model, which: usize) -> String {
    let h = &model.effects[which];
    let base = h.path();
    let same = model.effects[..which].iter().filter(|o| o.path() == base).count();
    format!("{base}{}", "+".repeat(same))
}

/// Variance of the residuals as they are weighted, and by how much correlation makes standard errors larger.
pub fn inflation(model: &Model) -> f64 {
    let parts: Vec<Vec<f64>> = model.fit.residuals.iter().filter(|r| !r.is_empty()).cloned().collect();
    let n: usize = parts.iter().map(Vec::len).sum();
    let free = model.problem.globals.len() + model.problem.locals.len() * parts.len();
    let variance = parts.iter().flatten().map(|r| r * r).sum::<f64>() / n.saturating_sub(free).max(1) as f64;
    variance * n as f64 / stats::effective(&parts)
}

/// Standard error of a global as the fit sees it.
pub fn standard_error(model: &Model, global: usize) -> f64 {
    libm::sqrt((model.fit.covariance[(global, global)] * inflation(model)).max(0.0))
}

/// How many standard errors an effect's amplitude is from nothing: the largest of them.
fn sigmas(model: &Model, which: usize) -> f64 {
    use crate::effects::Kind;
    let h = &model.effects[which];
    let globals = globals_of(model, which);
    let mut most = f64::INFINITY;
    let mut at = 0;
    let mut any: Option<f64> = None;
    for row in &h.rows {
        match row.kind {
            Kind::Amplitude | Kind::PerMark => {
                let Some(g) = globals.get(at).copied() else { break };
                let global = &model.problem.globals[g];
                let off = global.law.seen(row.off * row.unit);
                if row.off == 0.0 {
                    let x = (model.fit.point.globals[g] - off).abs() / standard_error(model, g).max(1e-300);
                    any = Some(any.map_or(x, |a: f64| a.max(x)));
                }
                at += 1;
            }
            Kind::Shape => at += 1,
            Kind::Phase => at += model.problem.data.records.len(),
            Kind::Whole | Kind::Given => {}
        }
    }
    if let Some(x) = any {
        most = x;
    }
    most
}

/// An amplitude that stands at a bound of what it can be.
fn at_bound(model: &Model, which: usize) -> Option<String> {
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

/// Replaces every effect of the best model by every other one that was looked at beside the rest, and keeps what is as good.
fn rivals<'a>(
    declared: &Model<'a>,
    best: &Model<'a>,
    all: &[Model<'a>],
    effective: &[f64],
    own: &Data,
    context: &Context<'_>,
    trials: &mut [Trial],
) -> Vec<Vec<Rival>> {
    let records = declared.problem.data.records.len();
    let best_score = score(best, effective, records);
    let mut rivals = Vec::new();
    for which in 0..best.effects.len() {
        let id = best.effects[which].identity();
        let rest: Vec<usize> = (0..best.effects.len()).filter(|i| *i != which).collect();
        let mut mine: Vec<Rival> = Vec::new();
        context.say("looking for rivals");
        let less = without_effect(declared, best, which, own, context.threads);
        // Those that were fitted somewhere on the way.
        let mut tried: Vec<&Hypothesis> = Vec::new();
        for m in all {
            for h in &m.effects {
                let own_id = h.identity();
                let taken = best.effects.iter().any(|b| b.identity() == own_id);
                if !taken && own_id != id && tried.iter().all(|t| t.identity() != own_id) {
                    tried.push(h);
                }
            }
        }
        let base = Base::new(&less.problem, &less.fit);
        let own_gain = promise(&less.problem, &base, &less.fit, &best.effects[which]).gain;
        let models = parallel(tried.len(), context.threads, |i| {
            if context.ends() {
                return None;
            }
            let p = promise(&less.problem, &base, &less.fit, tried[i]);
            // What explains far less as a small addition is no rival.
            if !p.columns.is_empty() && p.gain < 0.25 * own_gain {
                return None;
            }
            Some(rebuilt(declared, best, &rest, Some((tried[i], &p.values, &p.phases)), own, 1))
        });
        for m in models.into_iter().flatten() {
            let worse = score(&m, effective, records) - best_score;
            let ratio = m.residuals.judge_ratio(&best.residuals);
            let Some(h) = m.effects.last() else { continue };
            let as_good = worse < CLEAR && ratio[1] < 1.02;
            if as_good {
                mine.push(Rival { identity: h.identity(), path: h.path(), score: worse, judge_ratio: ratio });
                for t in trials.iter_mut().filter(|t| t.identity == h.identity()) {
                    t.why = format!("cannot be told from {id}");
                }
            }
        }
        mine.sort_by(|a, b| a.score.total_cmp(&b.score));
        rivals.push(mine);
    }
    rivals
}
