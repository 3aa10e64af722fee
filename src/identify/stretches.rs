//! Effects found in short stretches of the records: over a short time a wrong model cannot drift far, so that its error has fewer minima.

use super::candidates;
use super::fit::{Fit, FitOptions, fit};
use super::model::{FittedModel, fit_model};
use super::problem::Problem;
use super::screen::LinearisedBase;
use super::search::{Context, ScreenedHypotheses, screened};
use super::windows;
use crate::measurement::Measurement;
use crate::measurement::segments::Data;
use crate::side_by_side::parallel;
use std::sync::atomic::{AtomicU64, Ordering};

/// Number of shortest stretches that are joined, per level; the last level is whole records.
const JOINED_STRETCHES: [usize; 2] = [1, 4];
/// Hypotheses that are fitted to short stretches, and how many of them are then fitted to whole records.
const SHORT_FITTED: usize = 6;
const SHORT_KEPT: usize = 3;

/// Models with one effect that was found in short stretches of the records and then fitted to whole records.
pub(super) fn from_stretches<'a>(
    measurement: &Measurement,
    declared: &FittedModel<'a>,
    own: &'a Data,
    context: &Context<'_>,
) -> Vec<FittedModel<'a>> {
    let whole = &declared.problem;
    let levels: Option<Vec<_>> = JOINED_STRETCHES.iter().map(|together| windows::split(whole, *together)).collect();
    let Some(levels) = levels else { return Vec::new() };
    let weights: Vec<f64> = whole.data.channels.iter().map(|c| c.noise.max(1e-12)).collect();
    let runs = AtomicU64::new(0);
    let shorter: Vec<Problem> = levels
        .iter()
        .map(|(data, _)| Problem { weights: weights.clone(), runs: &runs, ..windows::problem(whole, data) })
        .collect();
    let options = FitOptions { iterations: 30, threads: context.threads };
    let found = fit(&shorter[0], &shorter[0].start(), options);
    let base = LinearisedBase::new(&shorter[0], &found);
    let short = FittedModel::new(shorter[0].clone(), found, Vec::new(), own, context.threads);
    if context.must_end() {
        return Vec::new();
    }
    let ScreenedHypotheses { hypotheses, screenings, .. } = screened(&measurement.candidates, &short, &base, context);
    let mut order: Vec<usize> = (0..hypotheses.len()).filter(|i| !screenings[*i].columns.is_empty()).collect();
    order.sort_by(|a, b| screenings[*b].gain.total_cmp(&screenings[*a].gain).then(a.cmp(b)));
    let mut chosen: Vec<usize> = Vec::new();
    for i in order {
        let known = chosen.iter().any(|c| hypotheses[*c].identity() == hypotheses[i].identity());
        if !known && chosen.len() < SHORT_FITTED {
            chosen.push(i);
        }
    }
    let mut fits: Vec<(usize, Problem, Fit)> = parallel(chosen.len(), context.threads, |at| {
        let i = chosen[at];
        let (problem, start) =
            candidates::with_hypothesis(&short.problem, &short.fit.point, &hypotheses[i], &screenings[i].fit_start);
        let found = fit(&problem, &start, FitOptions { threads: 1, ..options });
        (i, problem, found)
    });
    fits.sort_by(|a, b| a.2.cost.total_cmp(&b.2.cost).then(a.0.cmp(&b.0)));
    fits.truncate(SHORT_KEPT);
    // Number of shortest stretches per segment.
    let per_part = (levels[0].0.segments.len() / whole.data.segments.len().max(1)).max(1) as u64;
    context.runs.fetch_add(runs.load(Ordering::Relaxed) / per_part, Ordering::Relaxed);
    let begins: Vec<windows::Begin> = (0..whole.data.segments.len()).map(|k| (k, 0)).collect();
    parallel(fits.len(), context.threads, |at| {
        let (i, problem, found) = &fits[at];
        let (h, fit_start) = (&hypotheses[*i], &screenings[*i].fit_start);
        // The declared parameters come first, then those of the effect.
        let mut short = (problem.clone(), found.point.clone(), &levels[0].1);
        for (problem, (_, own)) in shorter.iter().zip(&levels).skip(1) {
            let (with, mut start) = candidates::with_hypothesis(problem, &problem.start(), h, fit_start);
            start.locals = windows::joined((&with, &start, own), (&short.0, &short.1, short.2));
            start.globals = short.1.globals;
            let found = fit(&with, &start, FitOptions { threads: 1, ..options }).point;
            short = (with, found, own);
        }
        let (problem, mut start) = candidates::with_hypothesis(whole, &declared.fit.point, h, fit_start);
        start.locals = windows::joined((&problem, &start, &begins), (&short.0, &short.1, short.2));
        start.globals = short.1.globals;
        fit_model(problem, &start, own, vec![h.clone()], 1, 40)
    })
}
