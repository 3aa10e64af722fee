//! Numbers that do not hang on the step of the runs.
//!
//! A run takes steps that resolve its fastest swing and keep its friction stable; what that leaves wrong is small, but records may be more exact
//! still. So a set that may be reported is run once more with steps a quarter as long. Let d be by how much its residuals differ, and J their
//! derivatives: a fit at the finer step would move the numbers by C J'd, C their covariance. Where that is too much of a standard error for any of them, the set is
//! fitted again at the finer step, and looked at again. Names stand: they were found at the coarser one.

use super::model::{FIT_ITERATIONS, FittedModel, fit_model, standard_error, standard_errors_off};
use super::problem::Problem;
use super::search::Context;
use crate::measurement::segments::Data;
use crate::side_by_side::parallel;
use nalgebra::DVector;

/// How many times as many steps are tried, and the most that are taken: errors fall with the fourth power of the step where motions are smooth, and
/// with the second where they are not.
const FINER: usize = 4;
const FINEST: usize = 16;
/// Standard errors by which the step may move a number: an interval of 95 % then still holds 94.5 %.
const HARMLESS: f64 = 0.2;

/// Fits the model at a step that its numbers do not see. Returns a warning where there is none.
pub(super) fn resolve<'a>(model: &mut FittedModel<'a>, own: &'a Data, context: &Context<'_>) -> Option<String> {
    if !model.problem.machine.effort().has_steps {
        return None;
    }
    loop {
        if context.must_end() {
            return None;
        }
        let mut finer = model.problem.clone();
        finer.machine.refinement *= FINER;
        let (moved, which) = most_moved(model, &finer, context.threads);
        if moved <= HARMLESS {
            return None;
        }
        if finer.machine.refinement > FINEST {
            let global = &model.problem.globals[which];
            return Some(format!(
                "`{}` hangs on the step of the runs: {FINER} times as many steps would move it by {moved:.1} of its standard errors",
                model.problem.machine.slots[global.slot].path
            ));
        }
        let start = model.fit.point.clone();
        let refitted = fit_model(finer, &start, own, model.effects.clone(), context.threads, FIT_ITERATIONS);
        // A fit that was cut off is none.
        if context.must_end() {
            return None;
        }
        *model = refitted;
    }
}

/// By how many of its standard errors the number would move that moves most, and which one it is.
fn most_moved(model: &FittedModel, finer: &Problem, threads: usize) -> (f64, usize) {
    let (fit, point) = (&model.fit, &model.fit.point);
    let parts: Vec<usize> = (0..fit.residuals.len()).filter(|k| !fit.residuals[*k].is_empty()).collect();
    let there = parallel(parts.len(), threads, |i| finer.residuals(parts[i], &point.globals, &point.locals[parts[i]]));
    let mut slope = DVector::zeros(point.globals.len());
    for (k, there) in parts.iter().zip(there) {
        let moved = DVector::from_iterator(there.len(), there.iter().zip(&fit.residuals[*k]).map(|(a, b)| a - b));
        slope += fit.jacobians[*k].tr_mul(&moved);
    }
    let moved = &fit.covariance * slope;
    let mut most = (0.0, 0);
    for i in 0..moved.len() {
        let mut errors = moved[i].abs() / standard_error(model, i);
        // Where a body sticks and slips, a number is known less well than its slope says.
        if errors > HARMLESS {
            errors /= standard_errors_off(model, i);
        }
        // A number without an error hangs on nothing that was measured.
        if errors.is_finite() && errors > most.0 {
            most = (errors, i);
        }
    }
    most
}
