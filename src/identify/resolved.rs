//! Numbers that do not hang on the step of the runs.
//!
//! A run takes steps that resolve its fastest swing and keep its friction stable; what that leaves wrong is small, but records may be more exact
//! still. So the set that is reported is run once more with steps a quarter as long. Let d be by how much its residuals differ, and J their
//! derivatives: a fit at the finer step would move the numbers by C J'd, C their covariance. Where that is too much of a standard error for any of them, the set is
//! fitted again at the finer step, and looked at again. Names stand: they were found at the coarser one.

use super::fit::parallel;
use super::model::{FIT_ITERATIONS, FittedModel, fit_model, standard_error};
use super::problem::Problem;
use super::search::Context;
use crate::measurement::segments::Data;
use nalgebra::DVector;

/// How many times as many steps are tried, and the most that are taken: errors fall with the fourth power of the step where motions are smooth, and
/// with the second where they are not.
const FINER: usize = 4;
const FINEST: usize = 16;
/// Standard errors by which the step may move a number: an interval of 95 % then still holds 94.5 %.
const HARMLESS: f64 = 0.2;

/// The model fitted at a step that its numbers do not see.
pub(super) fn resolved<'a>(mut model: FittedModel<'a>, own: &'a Data, context: &Context<'_>) -> FittedModel<'a> {
    if !model.problem.machine.effort().has_steps {
        return model;
    }
    while model.problem.machine.refinement < FINEST && !context.must_end() {
        let mut finer = model.problem.clone();
        finer.machine.refinement *= FINER;
        if errors_moved(&model, &finer, context.threads) <= HARMLESS {
            break;
        }
        let start = model.fit.point.clone();
        let refitted = fit_model(finer, &start, own, model.effects.clone(), context.threads, FIT_ITERATIONS);
        // A fit that was cut off is none.
        if context.must_end() {
            break;
        }
        model = refitted;
    }
    model
}

/// By how many of their standard errors the numbers would move, those of most.
fn errors_moved(model: &FittedModel, finer: &Problem, threads: usize) -> f64 {
    let (fit, point) = (&model.fit, &model.fit.point);
    let parts: Vec<usize> = (0..fit.residuals.len()).filter(|k| !fit.residuals[*k].is_empty()).collect();
    let there = parallel(parts.len(), threads, |i| finer.residuals(parts[i], &point.globals, &point.locals[parts[i]]));
    let mut slope = DVector::zeros(point.globals.len());
    for (k, there) in parts.iter().zip(there) {
        let moved = DVector::from_iterator(there.len(), there.iter().zip(&fit.residuals[*k]).map(|(a, b)| a - b));
        slope += fit.jacobians[*k].tr_mul(&moved);
    }
    let moved = &fit.covariance * slope;
    let errors = |i: usize| moved[i].abs() / standard_error(model, i);
    // A number without an error hangs on nothing that was measured.
    (0..moved.len()).map(errors).filter(|e| e.is_finite()).fold(0.0, f64::max)
}
