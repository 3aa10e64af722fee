//! A fitted set of effects in a drive, with its residuals on fitted and on held-out data. The search compares these
//! models.

use super::candidates::{self, Hypothesis};
use super::fit::{Fit, FitOptions, fit, priors};
use super::judge::{self, Residuals};
use super::problem::{Law, Point, Problem};
use super::screen::FitStart;
use super::stats;
use crate::effects::{Effect, Kind, Look, Parameter};
use crate::measurement::facts;
use crate::measurement::segments::Data;
use crate::side_by_side::parallel;
use std::borrow::Cow;
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
    pub(super) own: &'a Data,
    pub threads: usize,
    /// The share of the squared error that the linear model would leave where the fit was given up. None: it was fitted to the end.
    pub(super) given_up: Option<f64>,
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
        let left = judge::fitted_residuals(&problem, &fit.residuals);
        FittedModel {
            problem,
            fit,
            effects,
            fit_residuals: left,
            own,
            threads,
            given_up: None,
            judged: OnceLock::new(),
        }
    }

    /// The model itself, or fitted to the end if it was given up.
    pub(super) fn finished(&self) -> Cow<'_, FittedModel<'a>> {
        if self.given_up.is_none() {
            return Cow::Borrowed(self);
        }
        let (problem, effects) = (self.problem.clone(), self.effects.clone());
        Cow::Owned(fit_model(problem, &self.fit.point, self.own, effects, self.threads, FIT_ITERATIONS))
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
        freedom(self.problem.data, &self.effects)
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

    /// Whether white noise of the known size, or far less than it, is all that is left of every channel: a further effect would be lost in it.
    pub fn is_noise_alone(&self) -> bool {
        let is_noise = |left: &[Vec<f64>], noise: f64| {
            let samples = left.iter().map(Vec::len).sum::<usize>() as f64;
            let is_chance = stats::neighbour_correlation(left).abs() * libm::sqrt(samples) < CHANCE;
            let rms = stats::rms(left);
            rms <= NOTHING_LEFT * noise || is_chance && rms <= NOISE_ALONE * noise && stats::white(left)
        };
        let mut channels = self.problem.data.channels.iter().zip(&self.fit_residuals);
        self.problem.machine.effort().noise_alone_is_left && channels.all(|(c, left)| is_noise(left, c.noise))
    }

    /// Whether white residuals near the noise floor are all that is left of every channel, held-out records included.
    pub fn is_explained(&self) -> bool {
        let residuals = self.residuals();
        self.problem.data.channels.iter().enumerate().all(|(c, channel)| {
            let (fit, held_out) = residuals.rms(c);
            let rms = if residuals.judge[c].is_empty() { fit } else { held_out };
            let is_white = stats::white(&residuals.judge[c]) && stats::white(&residuals.fit[c]);
            rms <= NOTHING_LEFT * channel.noise || rms <= EXPLAINED * channel.noise && is_white
        })
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

/// Number of additional parameters of effects, including those of every fitted record and segment.
fn freedom(data: &Data, effects: &[Hypothesis]) -> usize {
    let fits: Vec<usize> = data.segments.iter().filter(|s| s.judge_from > 0).map(|s| s.record).collect();
    let (parts, mut records) = (fits.len(), fits);
    records.sort_unstable();
    records.dedup();
    effects.iter().map(|h| h.freedom(records.len(), parts)).sum()
}

/// Within this multiple of the floor, and white, the error counts as explained.
pub const EXPLAINED: f64 = 1.5;
/// Up to this multiple of the floor nothing is left, whatever its form: records without noise leave the error of the integration.
pub const NOTHING_LEFT: f64 = 0.1;

/// Up to this multiple of the noise a model counts as near the floor.
const NEAR_FLOOR: f64 = 1.5;

/// Up to this multiple of the noise white residuals are noise alone: the noise is known to a few percent. Not varied.
const NOISE_ALONE: f64 = 1.05;
/// Standard deviations of the correlation of neighbours that chance reaches once in a thousand times.
const CHANCE: f64 = 3.3;

/// Maximum number of times that a fit of a motion with a period restarts from slightly shifted records.
const MAX_REALIGNMENTS: usize = 3;

/// Iterations of the fit of a set of effects.
pub const FIT_ITERATIONS: usize = 40;

/// Deviance that a wider range of a shape must take off: two standard errors; and how often it is made wider.
const WORTH_WIDENING: f64 = 4.0;
const MAX_WIDENINGS: usize = 4;

/// The model with shapes that ended at the edge of their range fitted beyond it, if that is better. A start that does not come from the
/// effect's own starting values may lie a decade off.
pub fn with_shapes_beyond<'a>(mut model: FittedModel<'a>, own: &'a Data) -> FittedModel<'a> {
    for _ in 0..MAX_WIDENINGS {
        let Some((wider, start)) = with_wider_shapes(&model.problem, &model.fit.point, &model.effects) else { break };
        let other = fit_model(wider, &start, own, model.effects.clone(), model.threads, FIT_ITERATIONS);
        let is_better = other.misfit() < model.misfit() - WORTH_WIDENING;
        if !is_better {
            break;
        }
        model = other;
    }
    model
}

/// The problem with new ranges round the shapes of effects that ended at the edge of theirs; None: none did.
fn with_wider_shapes<'a>(problem: &Problem<'a>, point: &Point, effects: &[Hypothesis]) -> Option<(Problem<'a>, Point)> {
    let (mut wider, mut start) = (problem.clone(), point.clone());
    let mut is_wider = false;
    for (_, row, g) in globals_by_row(problem, effects) {
        let x = point.globals[g];
        let law = problem.globals[g].law;
        let (low, high) = law.bounds();
        if row.kind != Kind::Shape || x > low && x < high {
            continue;
        }
        let moved = law_round(problem, g, law.value(x));
        if moved.low < law.low * (1.0 - 1e-9) || moved.high > law.high * (1.0 + 1e-9) {
            wider.globals[g].law = moved;
            start.globals[g] = 0.0;
            is_wider = true;
        }
    }
    is_wider.then_some((wider, start))
}

/// Range of a shape round another value of it.
fn law_round(problem: &Problem, global: usize, value: f64) -> Law {
    let slot = &problem.machine.slots[problem.globals[global].slot];
    candidates::law_of_shape(value, (slot.low * slot.unit, slot.high * slot.unit))
}

/// How much sharper a kink of friction may be than inverse dynamics shows it, whose smoother and noise of speeds make it wider. A servo's
/// angle over 20 s: from 0.66 rad/s a simulation stays at ten times the noise, from 0.02 it comes to it.
const SHARPER: f64 = 30.0;

/// A model that inverse dynamics has given, or the one to which a fit comes from friction that is sharper at rest, if that is better and the
/// first still errs by more than noise.
pub fn with_sharper_friction<'a>(model: FittedModel<'a>, own: &'a Data) -> FittedModel<'a> {
    if model.is_near_the_floor() {
        return model;
    }
    let (mut problem, mut start) = (model.problem.clone(), model.fit.point.clone());
    let mut sharper = Vec::new();
    for (effect, row, g) in globals_by_row(&problem, &model.effects) {
        let is_kink = row.key.starts_with("stick_speed") || row.key.starts_with("slip");
        if row.kind == Kind::Shape && is_kink && effect.kin.look == Some(Look::Friction) {
            let law = problem.globals[g].law;
            let value = law.value(start.globals[g]) / SHARPER;
            problem.globals[g].law = law_round(&problem, g, value);
            start.globals[g] = problem.globals[g].law.scaled(value);
            sharper.push((g, value));
        }
    }
    if sharper.is_empty() {
        return model;
    }
    // The other numbers first: what they were fitted to is the wider kink.
    let mut held = problem.clone();
    for (g, value) in sharper.iter().rev() {
        let global = held.globals.remove(*g);
        held.fixed.push((global.record, global.slot, *value));
    }
    let is_held = |g: usize| sharper.iter().any(|(held, _)| *held == g);
    let others: Vec<usize> = (0..start.globals.len()).filter(|g| !is_held(*g)).collect();
    let point = Point { globals: others.iter().map(|g| start.globals[*g]).collect(), locals: start.locals };
    let found = fit(&held, &point, FitOptions { iterations: FIT_ITERATIONS, threads: model.threads }).point;
    others.iter().zip(&found.globals).for_each(|(g, x)| start.globals[*g] = *x);
    start.locals = found.locals;
    let other = fit_model(problem, &start, own, model.effects.clone(), model.threads, FIT_ITERATIONS);
    if other.misfit() < model.misfit() - WORTH_WIDENING { with_shapes_beyond(other, own) } else { model }
}

/// Every free number of the effects of a model with its effect and row, in the order of its globals. They come last.
fn globals_by_row(problem: &Problem, effects: &[Hypothesis]) -> Vec<(&'static Effect, &'static Parameter, usize)> {
    let records = problem.data.records.len();
    let of = |row: &'static Parameter| match row.kind {
        Kind::Amplitude | Kind::Shape | Kind::PerMark => 1,
        Kind::Phase => records,
        Kind::Whole | Kind::Index | Kind::Start | Kind::Given | Kind::Tried => 0,
    };
    let rows = effects.iter().flat_map(|h| h.rows.iter().map(|row| (h.effect, *row)));
    let rows: Vec<(&'static Effect, &'static Parameter)> =
        rows.flat_map(|(effect, row)| std::iter::repeat_n((effect, row), of(row))).collect();
    let first = problem.globals.len() - rows.len();
    rows.into_iter().enumerate().map(|(i, (effect, row))| (effect, row, first + i)).collect()
}

/// Fits, weights the channels by their residuals, and fits again.
pub fn fit_model<'a>(
    problem: Problem<'a>,
    start: &Point,
    own: &'a Data,
    effects: Vec<Hypothesis>,
    threads: usize,
    iterations: usize,
) -> FittedModel<'a> {
    let found = fit(&problem, start, FitOptions { iterations, threads });
    completed(problem, found, own, effects, threads, iterations)
}

/// The model of a first fit: weights the channels by its residuals, and fits again.
pub(super) fn completed<'a>(
    mut problem: Problem<'a>,
    mut found: Fit,
    own: &'a Data,
    effects: Vec<Hypothesis>,
    threads: usize,
    iterations: usize,
) -> FittedModel<'a> {
    let options = FitOptions { iterations, threads };
    for _ in 0..MAX_REALIGNMENTS {
        let mut point = found.point.clone();
        if !problem.realign(&mut point, threads) {
            break;
        }
        found = fit(&problem, &point, options);
    }
    if problem.channels.len() > 1 {
        let left = judge::fitted_residuals(&problem, &found.residuals);
        for (c, w) in problem.weights.iter_mut().enumerate() {
            *w = stats::rms(&left[c]).max(problem.data.channels[c].noise).max(1e-12);
        }
        found = fit(&problem, &found.point, options);
    }
    FittedModel::new(problem, found, effects, own, threads)
}

/// Score of a model: deviance on the fitted data plus a penalty for each parameter. Smaller is better.
pub fn score(model: &FittedModel, effective: &[f64]) -> f64 {
    score_of(&model.fit_residuals, (&model.problem, &model.effects), effective)
}

/// Score that a model may still come to, where its fit was given up; the same as its score elsewhere.
pub(super) fn promised_score(model: &FittedModel, effective: &[f64]) -> f64 {
    let samples: f64 = effective.iter().sum();
    score(model, effective) + model.given_up.map_or(0.0, |share| samples * libm::log(share.max(1e-300)))
}

/// Score of what a set of effects leaves of the fitted data.
pub(super) fn score_of(
    left: &[Vec<Vec<f64>>],
    (problem, effects): (&Problem, &[Hypothesis]),
    effective: &[f64],
) -> f64 {
    let n: f64 = effective.iter().sum();
    // Records without noise leave the error of the integration, which no effect explains.
    let is_told = problem.machine.effort().noise_alone_is_left;
    let least = |c: usize| if is_told { NOTHING_LEFT * problem.data.channels[c].noise } else { 0.0 };
    let misfit = judge::deviance_above(left, effective, least);
    misfit + freedom(problem.data, effects) as f64 * libm::log(n.max(2.0))
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
    fit_model(problem, &start, own, effects, threads, FIT_ITERATIONS)
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
    refitted(declared, model, &rest, None, own, threads, FIT_ITERATIONS)
}

/// The fitted numbers of every effect of a model, as a start for another fit.
pub fn fitted_values(model: &FittedModel) -> Vec<FitStart> {
    let records = model.problem.data.records.len();
    let numbers = globals_by_row(&model.problem, &model.effects).len();
    let mut at = model.problem.globals.len() - numbers;
    let mut next = || {
        at += 1;
        model.problem.globals[at - 1].law.value(model.fit.point.globals[at - 1])
    };
    let mut all = Vec::new();
    for h in &model.effects {
        let mut start = FitStart { values: h.values.clone(), phases: vec![0.0; records], travels: Vec::new() };
        for (value, row) in start.values.iter_mut().zip(&h.rows) {
            match row.kind {
                Kind::Amplitude | Kind::Shape | Kind::PerMark => *value = next(),
                Kind::Phase => start.phases.iter_mut().for_each(|phase| *phase = next()),
                Kind::Whole | Kind::Index | Kind::Start | Kind::Given | Kind::Tried => {}
            }
        }
        all.push(start);
    }
    all
}

/// A model with some of another's effects, and optionally one more, fitted from their parameters.
pub fn refitted<'a>(
    declared: &FittedModel<'a>,
    model: &FittedModel<'a>,
    kept: &[usize],
    more: Option<(&Hypothesis, &FitStart)>,
    own: &'a Data,
    threads: usize,
    iterations: usize,
) -> FittedModel<'a> {
    let (problem, start, effects) = begin_again(declared, model, kept, more, threads);
    fit_model(problem, &start, own, effects, threads, iterations)
}

/// What a fit begins with.
pub(super) type FitBegin<'a> = (Problem<'a>, Point, Vec<Hypothesis>);

/// What the fit of [`refitted`] begins with.
pub(super) fn begin_again<'a>(
    declared: &FittedModel<'a>,
    model: &FittedModel<'a>,
    kept: &[usize],
    more: Option<(&Hypothesis, &FitStart)>,
    threads: usize,
) -> FitBegin<'a> {
    let n_declared = declared.problem.globals.len();
    let mut problem = declared.problem.clone();
    problem.weights.clone_from(&model.problem.weights);
    let mut point = declared.fit.point.clone();
    let fitted = problem.globals.iter().zip(&model.fit.point.globals[..n_declared]);
    for (x, (global, fitted)) in point.globals.iter_mut().zip(fitted) {
        let (low, high) = global.law.bounds();
        // A load that the model's effects have replaced lies where no fit moves it: it starts from the declared model's fit.
        if low < *fitted && *fitted < high {
            *x = *fitted;
        }
    }
    // Locals of the declared model come first, then those of every effect.
    let mut at_local = problem.locals.len();
    for (own, from) in point.locals.iter_mut().zip(&model.fit.point.locals) {
        own.clone_from_slice(&from[..at_local]);
    }
    let mut effects = Vec::new();
    for ((i, h), fit_start) in model.effects.iter().enumerate().zip(fitted_values(model)) {
        let locals = at_local..at_local + h.own_locals;
        at_local = locals.end;
        if kept.contains(&i) {
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
    (problem, point, effects)
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
    // Missing samples are zeros among the residuals.
    let known: usize = (0..model.problem.data.segments.len()).map(|k| model.problem.known_samples(k)).sum();
    let variance = parts.iter().flatten().map(|r| r * r).sum::<f64>() / known.saturating_sub(free).max(1) as f64;
    variance * n as f64 / stats::effective(&parts)
}

/// Standard error of a scaled global: the larger of that of coloured noise of one variance, and that of blocks of the records, which
/// holds where the rest is neither white nor alike everywhere. Infinite where the records say nothing of it.
pub fn standard_error(model: &FittedModel, global: usize) -> f64 {
    let variance = model.fit.covariance[(global, global)] * inflation(model);
    if variance.is_nan() {
        return f64::INFINITY;
    }
    libm::sqrt(variance.max(0.0).max(block_variance(model, global).unwrap_or(0.0)))
}

/// Squared error, over its variance, by which a number that is one standard error off must raise it at least (it is 1 where residuals are
/// linear in the number), and share of the number beyond which no standard error is doubted.
const LEAST_RISE: f64 = 0.5;
const COARSE: f64 = 0.1;

/// How many standard errors a number can really be off: 1 where residuals are smooth in it. A body that sticks and slips jumps with a
/// number, and the slope over one jump says nothing of the places beside it: Coulomb friction of 13 N mm was told to 8e-11 N m.
pub fn standard_errors_off(model: &FittedModel, global: usize) -> f64 {
    let (problem, at) = (&model.problem, &model.fit.point);
    let concerned = |k: &usize| !model.fit.residuals[*k].is_empty() && problem.concerns(global, *k);
    let parts: Vec<usize> = (0..problem.data.segments.len()).filter(concerned).collect();
    let information: f64 = parts.iter().map(|k| model.fit.jacobians[*k].column(global).norm_squared()).sum();
    let variance = inflation(model);
    // Runs on a grid are linear between its points; where nothing is left, no number has an error.
    if problem.is_on_grid(global) || information <= 0.0 || variance <= 0.0 {
        return 1.0;
    }
    let square = |r: &[f64]| r.iter().map(|r| r * r).sum::<f64>();
    let here: f64 = parts.iter().map(|k| square(&model.fit.residuals[*k])).sum();
    let rise = |x: f64| {
        let mut globals = at.globals.clone();
        globals[global] = x;
        let of = |i: usize| square(&problem.residuals(parts[i], &globals, &at.locals[parts[i]]));
        (parallel(parts.len(), model.threads, of).iter().sum::<f64>() - here) / variance
    };
    let (low, high) = problem.globals[global].law.bounds();
    let (x, one) = (at.globals[global], libm::sqrt(variance / information));
    let most = COARSE * if problem.globals[global].law.logarithm { 1.0 } else { x.abs() };
    let mut times = 1.0;
    while times * one < most {
        let sides = [x - times * one, x + times * one];
        let inside: Vec<f64> = sides.into_iter().filter(|x| (low..=high).contains(x)).collect();
        let n = inside.len() as f64;
        if inside.into_iter().map(rise).sum::<f64>() >= LEAST_RISE * n {
            break;
        }
        times *= 2.0;
    }
    times
}

/// Blocks of a segment, and blocks at least for a variance.
const BLOCKS: usize = 8;
const LEAST_BLOCKS: usize = 6;

/// Variance of a scaled global from blocks of an eighth of every segment, each of which is taken as one draw (sandwich, White 1980, Newey
/// and West 1987): H (sum of g g') H with H the covariance and g the gradient of a block.
fn block_variance(model: &FittedModel, global: usize) -> Option<f64> {
    let row = model.fit.covariance.column(global);
    let channels = model.problem.channels.len().max(1);
    let (mut sum, mut blocks) = (0.0, 0_usize);
    for (residuals, jacobian) in model.fit.residuals.iter().zip(&model.fit.jacobians) {
        if residuals.is_empty() || jacobian.nrows() != residuals.len() {
            continue;
        }
        let along = |i: usize| (0..row.len()).map(|g| jacobian[(i, g)] * row[g]).sum::<f64>();
        let own: Vec<f64> = (0..residuals.len()).map(along).collect();
        if own.iter().all(|x| *x == 0.0) {
            continue;
        }
        let n = residuals.len() / channels;
        for b in 0..BLOCKS.min(n) {
            let samples = b * n / BLOCKS.min(n)..(b + 1) * n / BLOCKS.min(n);
            let of = |c: usize| samples.clone().map(|i| own[c * n + i] * residuals[c * n + i]).sum::<f64>();
            let gradient: f64 = (0..channels).map(of).sum();
            sum += gradient * gradient;
            blocks += 1;
        }
    }
    let free = model.problem.globals.len().min(blocks / 2);
    let variance = sum * blocks as f64 / (blocks - free).max(1) as f64;
    (blocks >= LEAST_BLOCKS && variance.is_finite()).then_some(variance)
}
