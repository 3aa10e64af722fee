//! A fitted set of effects in a drive, with its residuals on fitted and on held-out data. The search compares these
//! models.

use super::candidates::{self, Hypothesis};
use super::fit::{Fit, FitOptions, fit, priors};
use super::judge::{self, Residuals};
use super::problem::{Point, Problem};
use super::screen::FitStart;
use super::stats;
use crate::effects::Kind;
use crate::measurement::facts;
use crate::measurement::segments::Data;
use std::sync::OnceLock;

/// A fitted set of effects.
#[derive(Clone, Debug)]
pub struct FittedModel<'a> {
    pub problem: Problem<'a>,
    pub fit: Fit,
    pub effects: Vec<Hypothesis>,
    /// Residuals on the fitted data, channel by channel and segment by segment.
    pub fit_residuals: Vec<Vec<Vec<f64>>>,
    /// Held-out segments. They are run on `threads` threads when their residuals are first needed.
    own: &'a Data,
    pub threads: usize,
    judged: OnceLock<Residuals>,
}

impl<'a> FittedModel<'a> {
    /// `own` are the held-out segments.
    pub fn new(
        problem: Problem<'a>,
        fit: Fit,
        effects: Vec<Hypothesis>,
        own: &'a Data,
        threads: usize,
    ) -> FittedModel<'a> {
        let left = judge::fitted_residuals(&problem, &fit);
        FittedModel { problem, fit, effects, fit_residuals: left, own, threads, judged: OnceLock::new() }
    }

    /// All residuals; those of held-out data are computed on first use.
    pub fn residuals(&self) -> &Residuals {
        self.judged.get_or_init(|| judge::residuals(&self.problem, &self.fit, self.own, self.threads))
    }

    /// Held-out error of the first channel, if it was computed.
    pub fn known_judge_error(&self) -> Option<f64> {
        self.judged.get().map(|r| r.rms(0).1)
    }

    /// Number of additional parameters of its effects, including those of every fitted record and segment.
    pub fn freedom(&self) -> usize {
        let fits: Vec<usize> =
            self.problem.data.segments.iter().filter(|s| s.judge_from > 0).map(|s| s.record).collect();
        let (parts, mut records) = (fits.len(), fits);
        records.sort_unstable();
        records.dedup();
        let records = records.len();
        self.effects.iter().map(|h| h.freedom(records, parts)).sum()
    }

    /// Root mean square of the coloured (not white) part of the residuals, for every channel.
    pub fn coloured_rms(&self) -> Vec<f64> {
        let of = |parts: &Vec<Vec<f64>>| {
            let mut noises: Vec<f64> = parts.iter().map(|p| facts::noise(p)).collect();
            let (rough, rms) = (facts::median(&mut noises), stats::rms(parts));
            libm::sqrt((rms * rms - rough * rough).max(0.0))
        };
        self.fit_residuals.iter().map(of).collect()
    }

    /// Whether it has at least one effect and its remaining error is no larger than the part that does not repeat itself.
    pub fn is_exhausted(&self) -> bool {
        if self.effects.is_empty() {
            return false;
        }
        let Some(unrepeated) = self.problem.unrepeated(&self.fit.point) else { return false };
        self.coloured_rms().iter().zip(&unrepeated).all(|(c, u)| *c <= u.size)
    }

    /// Whether the remaining error on fitted data is little more than noise.
    pub fn is_near_the_floor(&self) -> bool {
        let channels = self.problem.data.channels.iter().enumerate();
        channels
            .map(|(c, channel)| stats::rms(&self.fit_residuals[c]) / channel.noise.max(1e-300))
            .all(|times| times < NEAR_FLOOR)
    }

    /// Deviance on the fitted data, with priors. It compares fits of the same parameters, because their costs are not
    /// comparable: every fit weights channels by their own residuals.
    pub fn misfit(&self) -> f64 {
        let samples: Vec<f64> =
            self.fit_residuals.iter().map(|p| p.iter().map(Vec::len).sum::<usize>() as f64).collect();
        judge::deviance(&self.fit_residuals, &samples) + priors(&self.problem, &self.fit.point)
    }

    pub fn identity(&self) -> Vec<String> {
        let mut id: Vec<String> = self.effects.iter().map(Hypothesis::identity).collect();
        id.sort();
        id
    }
}

/// Up to this multiple of the noise a model counts as near the floor.
const NEAR_FLOOR: f64 = 1.5;

/// Maximum number of times that a fit of a motion with a period restarts from slightly shifted records.
const MAX_REALIGNMENTS: usize = 3;

/// Fits, weights the channels by their residuals, and fits again.
pub fn fit_model<'a>(
    mut problem: Problem<'a>,
    start: &Point,
    own: &'a Data,
    effects: Vec<Hypothesis>,
    threads: usize,
    iterations: usize,
) -> FittedModel<'a> {
    let options = FitOptions { iterations, threads };
    let mut found = fit(&problem, start, options);
    for _ in 0..MAX_REALIGNMENTS {
        let mut point = found.point.clone();
        if !problem.realign(&mut point, threads) {
            break;
        }
        found = fit(&problem, &point, options);
    }
    if problem.channels.len() > 1 {
        let left = judge::fitted_residuals(&problem, &found);
        for (c, w) in problem.weights.iter_mut().enumerate() {
            *w = stats::rms(&left[c]).max(problem.data.channels[c].noise).max(1e-12);
        }
        found = fit(&problem, &found.point, options);
    }
    FittedModel::new(problem, found, effects, own, threads)
}

/// Score of a model: deviance on the fitted data plus a penalty for each parameter. Smaller is better.
pub fn score(model: &FittedModel, effective: &[f64]) -> f64 {
    let n: f64 = effective.iter().sum();
    judge::deviance(&model.fit_residuals, effective) + model.freedom() as f64 * libm::log(n.max(2.0))
}

/// The model with one more hypothesis, fitted.
pub fn refit_with<'a>(
    model: &FittedModel<'a>,
    h: &Hypothesis,
    fit_start: &FitStart,
    own: &'a Data,
    threads: usize,
) -> FittedModel<'a> {
    let (problem, start) = candidates::with_stable_start(&model.problem, &model.fit.point, h, fit_start, threads);
    let effects = model.effects.iter().cloned().chain([h.clone()]).collect();
    fit_model(problem, &start, own, effects, threads, 40)
}

/// The model without one of its effects, fitted again from the remaining parameters.
pub fn without_effect<'a>(
    declared: &FittedModel<'a>,
    model: &FittedModel<'a>,
    which: usize,
    own: &'a Data,
    threads: usize,
) -> FittedModel<'a> {
    let rest: Vec<usize> = (0..model.effects.len()).filter(|i| *i != which).collect();
    refitted(declared, model, &rest, None, own, threads)
}

/// A model with some of another's effects, and optionally one more, fitted from their parameters.
pub fn refitted<'a>(
    declared: &FittedModel<'a>,
    model: &FittedModel<'a>,
    kept: &[usize],
    more: Option<(&Hypothesis, &FitStart)>,
    own: &'a Data,
    threads: usize,
) -> FittedModel<'a> {
    let n_declared = declared.problem.globals.len();
    let mut problem = declared.problem.clone();
    problem.weights.clone_from(&model.problem.weights);
    let mut point = declared.fit.point.clone();
    point.globals.clone_from_slice(&model.fit.point.globals[..n_declared]);
    // Locals of the declared model come first, then those of every effect.
    let mut at_local = problem.locals.len();
    for (own, from) in point.locals.iter_mut().zip(&model.fit.point.locals) {
        own.clone_from_slice(&from[..at_local]);
    }
    let records = problem.data.records.len();
    let mut effects = Vec::new();
    let mut at = n_declared;
    for (i, h) in model.effects.iter().enumerate() {
        let mut values = h.values.clone();
        let mut phases = vec![0.0; records];
        for (k, row) in h.rows.iter().enumerate() {
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
                Kind::Whole | Kind::Index | Kind::Start | Kind::Given => {}
            }
        }
        let locals = at_local..at_local + h.own_locals;
        at_local = locals.end;
        if kept.contains(&i) {
            let fit_start = FitStart { values, phases, travels: Vec::new() };
            (problem, point) = candidates::with_hypothesis(&problem, &point, h, &fit_start);
            for (own, from) in point.locals.iter_mut().zip(&model.fit.point.locals) {
                let first = own.len() - locals.len();
                own[first..].clone_from_slice(&from[locals.clone()]);
            }
            effects.push(Hypothesis { values: fit_start.values, ..h.clone() });
        }
    }
    if let Some((h, fit_start)) = more {
        (problem, point) = candidates::with_stable_start(&problem, &point, h, fit_start, threads);
        effects.push(h.clone());
    }
    problem.reverse_better_starts(&mut point, threads);
    fit_model(problem, &point, own, effects, threads, 40)
}

/// Path of an effect in the machine. Declared effects of the same kind at the same place come first.
pub fn placed_path(model: &FittedModel, which: usize) -> String {
    let h = &model.effects[which];
    let base = h.path();
    let placed = &model.problem.machine.placed;
    let own: Vec<&str> = placed.iter().map(|p| p.path.as_str()).filter(|p| p.trim_end_matches('+') == base).collect();
    let alike = |effects: &[Hypothesis]| effects.iter().filter(|o| o.path() == base).count();
    let declared = own.len().saturating_sub(alike(&model.effects));
    own.get(declared + alike(&model.effects[..which])).map_or(base, |p| (*p).to_string())
}

/// Indices of an effect's globals.
pub fn globals_of(model: &FittedModel, which: usize) -> Vec<usize> {
    let path = format!("{}.", placed_path(model, which));
    (0..model.problem.globals.len())
        .filter(|g| model.problem.machine.slots[model.problem.globals[*g].slot].path.starts_with(&path))
        .collect()
}

/// Variance of the weighted residuals, times the factor by which correlation increases it.
pub fn inflation(model: &FittedModel) -> f64 {
    let parts: Vec<Vec<f64>> = model.fit.residuals.iter().filter(|r| !r.is_empty()).cloned().collect();
    let n: usize = parts.iter().map(Vec::len).sum();
    let free = model.problem.globals.len() + model.problem.locals.len() * parts.len();
    let variance = parts.iter().flatten().map(|r| r * r).sum::<f64>() / n.saturating_sub(free).max(1) as f64;
    variance * n as f64 / stats::effective(&parts)
}

/// Standard error of a scaled global.
pub fn standard_error(model: &FittedModel, global: usize) -> f64 {
    libm::sqrt((model.fit.covariance[(global, global)] * inflation(model)).max(0.0))
}
