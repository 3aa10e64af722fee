//! Fits of many hypotheses as a race: after some iterations those go on that may still come near the best of them. A fit that creeps along a
//! valley far above the others would take as many iterations as all of them.

use super::candidates::Hypothesis;
use super::fit::{FitOptions, Fitting, parallel};
use super::judge;
use super::model::{Begin, FIT_ITERATIONS, FittedModel, completed, score, score_of};
use super::problem::Problem;
use super::search::{Context, MAX_SCORE_GAP};
use crate::measurement::segments::Data;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Iterations after which the fits are compared. Not varied.
const HEATS: [usize; 2] = [8, 16];

/// A fit that takes part.
struct Runner<'a> {
    problem: Problem<'a>,
    effects: Vec<Hypothesis>,
    fitting: Fitting,
    is_given_up: bool,
}

impl<'a> Runner<'a> {
    fn new((problem, start, effects): Begin<'a>) -> Runner<'a> {
        let fitting = Fitting::begin(&problem, &start, 1);
        Runner { problem, effects, fitting, is_given_up: false }
    }

    fn go_on(&mut self, iterations: usize) {
        if !self.is_given_up {
            self.fitting.go_on(&self.problem, FitOptions { iterations, threads: 1 });
        }
    }

    fn finish(self, own: &'a Data) -> FittedModel<'a> {
        let Runner { problem, effects, fitting, is_given_up } = self;
        let found = fitting.finish(&problem, FitOptions { iterations: FIT_ITERATIONS, threads: 1 });
        match is_given_up {
            true => FittedModel::new(problem, found, effects, own, 1),
            false => completed(problem, found, own, effects, 1, FIT_ITERATIONS),
        }
    }

    /// What it leaves of the fitted data, channel by channel and segment by segment.
    fn left(&self) -> Vec<Vec<Vec<f64>>> {
        judge::fitted_residuals(&self.problem, &self.fitting.residuals(&self.problem))
    }

    /// Its score, and the one that it may still come to: without what the linear model takes off the squared error.
    fn scores(&self, left: &[Vec<Vec<f64>>], effective: &[f64]) -> (f64, f64) {
        let now = score_of(left, (self.problem.data, &self.effects), effective);
        let samples: f64 = effective.iter().sum();
        (now, now + samples * libm::log(self.fitting.promised_share(&self.problem).max(1e-300)))
    }
}

/// Fits so many sets of effects, each on one thread; None: the search had to end before. Those that are given up stay where they were then.
pub(super) fn race<'a>(
    fits: usize,
    begin: impl Fn(usize) -> Begin<'a> + Sync,
    own: &'a Data,
    context: &Context<'_>,
) -> Vec<Option<FittedModel<'a>>> {
    let begun = parallel(fits, context.threads, |fit| {
        context.report("fitting hypotheses");
        if context.must_end() {
            return None;
        }
        Some(Mutex::new(Runner::new(begin(fit))))
    });
    let runners: Vec<&Mutex<Runner>> = begun.iter().flatten().collect();
    for iterations in HEATS {
        parallel(runners.len(), context.threads, |i| lock(runners[i]).go_on(iterations));
        give_up_the_hopeless(&runners);
    }
    parallel(runners.len(), context.threads, |i| {
        lock(runners[i]).go_on(FIT_ITERATIONS);
        context.report("fitting hypotheses");
    });
    let runners: Vec<Mutex<Option<Runner>>> = begun
        .into_iter()
        .map(|r| Mutex::new(r.map(|r| r.into_inner().unwrap_or_else(PoisonError::into_inner))))
        .collect();
    parallel(fits, context.threads, |fit| {
        let runner = lock(&runners[fit]).take()?;
        Some(runner.finish(own))
    })
}

/// Fits a set of effects against a model that stands; None: it is given up. `is_behind` says whether it is, by the score that it promises beyond
/// that of the model and by the squared error that it promises over that of the model.
pub(super) fn fit_against<'a>(
    begin: Begin<'a>,
    best: &FittedModel<'a>,
    is_behind: impl Fn(f64, f64) -> bool,
    own: &'a Data,
) -> Option<FittedModel<'a>> {
    let effective = judge::effective(&best.fit_residuals);
    let (stands, error) = (score(best, &effective), judge::mean_error(&best.fit_residuals));
    let mut runner = Runner::new(begin);
    for iterations in HEATS {
        runner.go_on(iterations);
        let left = runner.left();
        let (_, promised) = runner.scores(&left, &effective);
        let ratio = judge::mean_error(&left) / error.max(1e-300);
        let share = ratio * ratio * runner.fitting.promised_share(&runner.problem);
        if is_behind(promised - stands, share) {
            return None;
        }
    }
    runner.go_on(FIT_ITERATIONS);
    Some(runner.finish(own))
}

/// Marks those that promise to stay behind the leader by more than a set of the next round may.
fn give_up_the_hopeless(runners: &[&Mutex<Runner>]) {
    let left: Vec<Vec<Vec<Vec<f64>>>> = runners.iter().map(|r| lock(r).left()).collect();
    let best = left.iter().min_by(|a, b| judge::mean_error(a).total_cmp(&judge::mean_error(b)));
    let Some(best) = best else { return };
    let effective = judge::effective(best);
    let scores: Vec<(f64, f64)> = runners.iter().zip(&left).map(|(r, left)| lock(r).scores(left, &effective)).collect();
    let lead = scores.iter().map(|(now, _)| *now).fold(f64::MAX, f64::min);
    for (runner, (_, promised)) in runners.iter().zip(scores) {
        let mut runner = lock(runner);
        runner.is_given_up |= runner.problem.machine.effort().is_thorough && promised > lead + MAX_SCORE_GAP;
    }
}

/// The value of a lock that no thread holds for longer than its own work.
fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}
