//! Fits of many hypotheses as a race: after some iterations those go on that may still come near the best of them. A fit that creeps along a
//! valley far above the others would take as many iterations as all of them.

use super::candidates::Hypothesis;
use super::fit::{FitOptions, Fitting};
use super::judge::{self, mean_error};
use super::model::{FIT_ITERATIONS, FitBegin, FittedModel, completed, fit_model, score, score_of};
use super::plausible::is_inside_the_records;
use super::problem::Problem;
use super::search::{Context, MAX_SCORE_GAP};
use crate::measurement::segments::Data;
use crate::side_by_side::parallel;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Iterations after which the fits are compared. Not varied.
const HEATS: [usize; 2] = [8, 16];

/// A fit that takes part.
struct Runner<'a> {
    problem: Problem<'a>,
    effects: Vec<Hypothesis>,
    fitting: Fitting,
    /// The share of the squared error that its linear model would leave, if it was given up.
    given_up: Option<f64>,
}

/// Residuals of fitted data, channel by channel and segment by segment.
type Left = Vec<Vec<Vec<f64>>>;

/// What a fit leaves after a heat, and what its linear model promises to leave.
struct Standing {
    now: Left,
    promised: Left,
}

impl Standing {
    fn promised_share(&self) -> f64 {
        let ratio = mean_error(&self.promised) / mean_error(&self.now).max(1e-300);
        ratio * ratio
    }
}

impl<'a> Runner<'a> {
    fn new((problem, start, effects): FitBegin<'a>) -> Runner<'a> {
        let fitting = Fitting::begin(&problem, &start, 1);
        Runner { problem, effects, fitting, given_up: None }
    }

    fn go_on(&mut self, iterations: usize) {
        self.fitting.go_on(&self.problem, FitOptions { iterations, threads: 1 });
    }

    fn standing(&self) -> Standing {
        let left = |residuals: &[Vec<f64>]| judge::fitted_residuals(&self.problem, residuals);
        let now = left(&self.fitting.as_it_stands(&self.problem).residuals);
        Standing { now, promised: left(&self.fitting.promised_residuals(&self.problem)) }
    }

    fn score(&self, left: &Left, effective: &[f64]) -> f64 {
        score_of(left, (&self.problem, &self.effects), effective)
    }

    /// Whether its form lies inside the records where it stands: no other one keeps its place.
    fn is_inside(&self, own: &'a Data) -> bool {
        let found = self.fitting.as_it_stands(&self.problem);
        is_inside_the_records(&FittedModel::new(self.problem.clone(), found, self.effects.clone(), own, 1))
    }

    /// Score beyond the leader's up to which it stays in the race. Several channels are weighted anew where a fit ends.
    fn margin(&self) -> f64 {
        MAX_SCORE_GAP * self.problem.channels.len() as f64
    }

    /// The model where the fit ends, or where it was given up.
    fn finish(mut self, own: &'a Data) -> FittedModel<'a> {
        let options = FitOptions { iterations: FIT_ITERATIONS, threads: 1 };
        if self.given_up.is_none() {
            self.fitting.go_to_the_end(&self.problem, options);
        }
        let Runner { problem, effects, fitting, given_up } = self;
        let found = fitting.finish(&problem, options);
        if given_up.is_none() {
            return completed(problem, found, own, effects, 1, FIT_ITERATIONS);
        }
        let mut model = FittedModel::new(problem, found, effects, own, 1);
        model.given_up = given_up;
        model
    }
}

/// Fits so many sets of effects, each on one thread; None: the search had to end before it was fitted. Those that are given up say so. Where a
/// run takes long, none is: a budget shall leave whole fits.
pub(super) fn race<'a>(
    (fits, is_raced): (usize, bool),
    begin: impl Fn(usize) -> FitBegin<'a> + Sync,
    own: &'a Data,
    context: &Context<'_>,
) -> Vec<Option<FittedModel<'a>>> {
    let go_on = |runner: &mut Option<Runner<'a>>, iterations: usize| {
        context.report("fitting hypotheses");
        if context.must_end() && !runner.as_ref().is_some_and(|r| r.fitting.has_converged()) {
            *runner = None;
        }
        let runner = runner.as_mut().filter(|r| r.given_up.is_none())?;
        runner.go_on(iterations);
        Some(runner.standing())
    };
    if !is_raced {
        return parallel(fits, context.threads, |fit| {
            context.report("fitting hypotheses");
            (!context.must_end()).then(|| Runner::new(begin(fit)).finish(own))
        });
    }
    let begun = parallel(fits, context.threads, |fit| {
        let runner = if context.must_end() { None } else { Some(Runner::new(begin(fit))) };
        Mutex::new(runner)
    });
    for iterations in HEATS {
        let standings = parallel(fits, context.threads, |fit| go_on(&mut lock(&begun[fit]), iterations));
        give_up_the_hopeless(&begun, &standings, own);
    }
    parallel(fits, context.threads, |fit| {
        go_on(&mut lock(&begun[fit]), 0);
        let runner = lock(&begun[fit]).take();
        runner.map(|runner| runner.finish(own))
    })
}

/// Marks those that promise to stay behind the leader by more than a set of the next round may.
fn give_up_the_hopeless<'a>(runners: &[Mutex<Option<Runner<'a>>>], standings: &[Option<Standing>], own: &'a Data) {
    let best = standings.iter().flatten().min_by(|a, b| mean_error(&a.now).total_cmp(&mean_error(&b.now)));
    let Some(best) = best else { return };
    let effective = judge::effective(&best.now);
    let mut lead = f64::MAX;
    for (runner, standing) in runners.iter().zip(standings) {
        if let (Some(runner), Some(standing)) = (lock(runner).as_ref(), standing) {
            let score = runner.score(&standing.now, &effective);
            lead = if score < lead && runner.is_inside(own) { score } else { lead };
        }
    }
    for (runner, standing) in runners.iter().zip(standings) {
        if let (Some(runner), Some(standing)) = (lock(runner).as_mut(), standing) {
            let is_behind = runner.score(&standing.promised, &effective) > lead + runner.margin();
            if is_behind && !runner.fitting.is_falling() {
                runner.given_up = Some(standing.promised_share());
            }
        }
    }
}

/// Fits a set of effects against a model that stands; None: it is given up. `is_behind` says whether it is, by the score that it promises beyond
/// that of the model and by the squared error that it promises over that of the model.
pub(super) fn fit_against<'a>(
    begin: FitBegin<'a>,
    best: &FittedModel<'a>,
    is_behind: impl Fn(f64, f64) -> bool,
    own: &'a Data,
) -> Option<FittedModel<'a>> {
    let effective = judge::effective(&best.fit_residuals);
    let (stands, error) = (score(best, &effective), mean_error(&best.fit_residuals));
    let mut runner = Runner::new(begin);
    for iterations in HEATS {
        runner.go_on(iterations);
        let promised = runner.standing().promised;
        let beyond = runner.score(&promised, &effective) - stands - (runner.margin() - MAX_SCORE_GAP);
        let ratio = mean_error(&promised) / error.max(1e-300);
        if !runner.fitting.is_falling() && is_behind(beyond, ratio * ratio) {
            return None;
        }
    }
    // A fresh beginning reaches minima that a fit with its damping of before does not.
    let Runner { problem, effects, fitting, .. } = runner;
    let stands = fitting.as_it_stands(&problem).point;
    Some(fit_model(problem, &stands, own, effects, 1, FIT_ITERATIONS))
}

/// The value of a lock that no thread holds for longer than its own work.
fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}
