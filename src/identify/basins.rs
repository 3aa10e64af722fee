//! Where fits of the reported set end that start elsewhere: a set may have several basins, and only the best of them gives its numbers.
//!
//! The search has had starts of its own (the drive file, inverse dynamics, short stretches of records). What it came to is fitted once more from the
//! file's numbers, and from numbers twice and half as large with effects half and one and a half times as large. Fits that end at the same numbers share a basin.

use super::accept::CLEAR_SCORE_GAP;
use super::fit::{FitOptions, fit};
use super::model::{FittedModel, globals_of, standard_error};
use super::problem::Point;
use super::search::Context;
use crate::effects::Kind;
use serde::Serialize;

/// Iterations of each fit.
const ITERATIONS: usize = 25;
/// Numbers are the same where they differ by less than so many of their standard errors, or by this share.
const SAME_ERRORS: f64 = 3.0;
const SAME_SHARE: f64 = 1e-3;
/// A basin is better where its misfit (twice the logarithm of a likelihood) is less by more than this.
const BETTER: f64 = 1.0;
/// Numbers of another basin that are told, at most: those that differ most.
const TOLD: usize = 3;

/// Where fits from these starts ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Basin {
    /// Starts that led there.
    pub starts: Vec<String>,
    /// Misfit above that of the reported fit: twice the logarithm of the ratio of likelihoods. Negative: it fits better.
    pub above: f64,
    /// Numbers that differ from the reported ones, those that differ most first: path, value there, reported value, in the key's unit.
    pub numbers: Vec<(String, f64, f64)>,
}

impl Basin {
    /// What makes a lead of a name: this basin fits as well as the reported one with other numbers, or better.
    pub fn doubt(&self) -> Option<String> {
        let shown =
            |(path, there, reported): &(String, f64, f64)| format!("`{path}` = {there:.4e}, not {reported:.4e}");
        let numbers: Vec<String> = self.numbers.iter().map(shown).collect();
        let (starts, numbers) = (self.starts.join(" and "), numbers.join("; "));
        if self.numbers.is_empty() || self.above > CLEAR_SCORE_GAP {
            None
        } else if self.above < -BETTER {
            Some(format!("a fit from {starts} ends in a better basin: {numbers}"))
        } else {
            Some(format!("a fit from {starts} ends in another basin that fits as well: {numbers}"))
        }
    }
}

/// The basins of the reported set, its own first. Empty where runs are too costly, or the time has ended.
pub(super) fn basins(best: &FittedModel, context: &Context) -> Vec<Basin> {
    if best.problem.machine.period_pitches().is_some() || best.problem.globals.is_empty() {
        return Vec::new();
    }
    let mut all = vec![Basin { starts: vec!["the search".into()], above: 0.0, numbers: Vec::new() }];
    let options = FitOptions { iterations: ITERATIONS, threads: context.threads };
    for (name, point) in starts(best) {
        if context.must_end() {
            return Vec::new();
        }
        let found = fit(&best.problem, &point, options);
        // A fit that has not come to its end is in no basin yet.
        if context.must_end() || !found.converged {
            continue;
        }
        let model = FittedModel::new(best.problem.clone(), found, best.effects.clone(), best.own, best.threads);
        let above = model.misfit() - best.misfit();
        let numbers = differing(best, &model.fit.point);
        let same = |b: &&mut Basin| match (b.numbers.is_empty(), numbers.is_empty()) {
            (true, true) => true,
            (false, false) => (b.above - above).abs() < BETTER,
            (true, false) | (false, true) => false,
        };
        match all.iter_mut().find(same) {
            Some(basin) => basin.starts.push(name.into()),
            None => all.push(Basin { starts: vec![name.into()], above, numbers }),
        }
    }
    all
}

/// Starts with their names. Initial states and phases are those of the search.
fn starts(best: &FittedModel) -> [(&'static str, Point); 3] {
    let (problem, found) = (&best.problem, &best.fit.point);
    let file = problem.start();
    let of_effects: Vec<usize> = (0..best.effects.len()).flat_map(|which| globals_of(best, which)).collect();
    let is_amplitude = |g: usize| {
        let path = &problem.machine.slots[problem.globals[g].slot].path;
        crate::effects::parameter_at(path).is_some_and(|p| p.kind == Kind::Amplitude)
    };
    let with = |own: &dyn Fn(usize) -> f64, of_effect: &dyn Fn(usize) -> f64| {
        let of = |g: usize| {
            let (low, high) = problem.globals[g].law.bounds();
            let value = if of_effects.contains(&g) { of_effect(g) } else { own(g) };
            value.clamp(low, high)
        };
        Point { globals: (0..found.globals.len()).map(of).collect(), locals: found.locals.clone() }
    };
    // By this factor, of the number itself where it is searched by its logarithm.
    let times = |factor: f64| {
        move |g: usize| match problem.globals[g].law.logarithm {
            true => found.globals[g] + libm::log(factor),
            false => found.globals[g] * factor,
        }
    };
    let amplitudes = |factor: f64| move |g: usize| if is_amplitude(g) { times(factor)(g) } else { found.globals[g] };
    [
        ("the file's numbers", with(&|g| file.globals[g], &|g| found.globals[g])),
        ("numbers twice as large", with(&times(2.0), &amplitudes(0.5))),
        ("numbers half as large", with(&times(0.5), &amplitudes(1.5))),
    ]
}

/// Numbers that hold for all records and differ from those of the reported fit.
fn differing(best: &FittedModel, there: &Point) -> Vec<(String, f64, f64)> {
    let problem = &best.problem;
    let of = |g: usize| {
        let global = &problem.globals[g];
        let (own, other) = (best.fit.point.globals[g], there.globals[g]);
        let errors = (other - own).abs() / standard_error(best, g).max(1e-300);
        let slot = &problem.machine.slots[global.slot];
        let (value, reported) = (global.law.value(other), global.law.value(own));
        let differs = errors > SAME_ERRORS && (value - reported).abs() > SAME_SHARE * reported.abs();
        (differs && global.record.is_none() && !slot.path.ends_with("phase_deg"))
            .then(|| (errors, (slot.path.clone(), value / slot.unit, reported / slot.unit)))
    };
    let mut all: Vec<(f64, (String, f64, f64))> = (0..problem.globals.len()).filter_map(of).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.truncate(TOLD);
    all.into_iter().map(|(_, number)| number).collect()
}
