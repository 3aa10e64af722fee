//! What noise of a measured force may hide in a fitted number.
//!
//! A run takes measured forces as they are. Noise in them moves the model where the machine did not move; the fit then makes the machine heavier, so
//! that it moves less (errors in variables; Fuller 1987, Measurement Error Models). No residual at the fit shows it: it is orthogonal to
//! all numbers. To first order in the noise's power
//!
//! ```text
//! moved = -C (dQ/dx) / 2       Q = sum of squares of what the noise adds to the residuals, C covariance of the numbers x
//! ```
//! How Q changes with a number is found from two runs, with the measured forces and with white noise added to them. How large Q is: of a simulation,
//! whose errors add up, what of the residuals neighbouring samples share; of a prediction, what noise the forces themselves show beside
//! a smooth course, but no more than the force that nobody measured. Such a force leaves the same trace and moves no number, and no record
//! tells the two apart: so numbers are left where they are, and their standard errors are widened by how far they may have moved.

use super::fit::{parallel, project_out};
use super::model::{FittedModel, standard_error};
use super::predict::unmeasured;
use super::problem::Problem;
use super::screen::local_basis;
use super::stats;
use crate::machine::InputKind;
use crate::machine::simulate::Samples;
use crate::measurement::facts;
use crate::measurement::segments::Data;
use crate::random::{SplitMix, normal_quantile};
use nalgebra::DVector;

/// Noise that is added, over the root mean square of the force.
const ADDED: f64 = 1e-3;
/// Standard errors of a correlation that count as chance.
const CHANCE: f64 = 2.0;

/// How far noise of the measured forces may have moved each global, scaled. Nothing where no force is measured, or where nothing shows noise of it.
pub(super) fn moved_by_input_noise(model: &FittedModel, threads: usize) -> Vec<f64> {
    let problem = &model.problem;
    let n = problem.globals.len();
    let none = vec![0.0; n];
    let m = &problem.machine;
    let parts: Vec<usize> = (0..model.fit.residuals.len()).filter(|k| !model.fit.residuals[*k].is_empty()).collect();
    let is_force = |i: usize| matches!(m.inputs[i].kind, InputKind::Force(_));
    let is_timed = |k: &usize| matches!(problem.data.segments[*k].task.samples, Samples::Times { .. });
    let applies = m.period_pitches().is_none() && (0..m.inputs.len()).any(is_force);
    if !applies || !parts.iter().all(is_timed) || n == 0 || model.fit.covariance.nrows() != n {
        return none;
    }
    let predicts = problem.correction > 0.0;
    let shared = if predicts { f64::NAN } else { shared_by_neighbours(model, &parts) };
    if shared <= 0.0 || problem.ending.is_due() {
        return none;
    }
    let noise = |k: usize, input: usize| {
        let series = &problem.data.segments[k].task.inputs[input];
        if predicts { shown_noise(model, input, series) } else { ADDED * stats::rms(std::slice::from_ref(series)) }
    };
    let noisy = with_noise(problem.data, |k, input| if is_force(input) { noise(k, input) } else { 0.0 });
    let noisy = Problem { data: &noisy, ..problem.clone() };
    let bases = parallel(parts.len(), threads, |i| local_basis(problem, &model.fit.point, parts[i]));
    // Sum of squares of what the added noise does, with the globals at `x`.
    let added = |x: &[f64]| -> f64 {
        let of = |i: usize| {
            let (k, locals) = (parts[i], &model.fit.point.locals[parts[i]]);
            let (with, without) = (noisy.residuals(k, x, locals), problem.residuals(k, x, locals));
            let moved: Vec<f64> = with.iter().zip(&without).map(|(a, b)| a - b).collect();
            project_out(&moved, &bases[i]).iter().map(|d| d * d).sum::<f64>()
        };
        parallel(parts.len(), threads, of).iter().sum()
    };
    let here = &model.fit.point.globals;
    let whole = added(here);
    if whole <= 0.0 {
        return none;
    }
    let real = if predicts { 1.0 } else { shared / whole };
    let slope = |g: usize| {
        let step = standard_error(model, g);
        let mut x = here.clone();
        x[g] += step;
        if step > 0.0 { (added(&x) - whole) / step } else { 0.0 }
    };
    let slopes = DVector::from_iterator(n, (0..n).map(slope));
    let moved = &model.fit.covariance * slopes * (0.5 * real);
    moved.iter().map(|x| if x.is_finite() { x.abs() } else { 0.0 }).collect()
}

/// Sum of squares of the residuals' part that neighbouring samples share, beyond chance.
fn shared_by_neighbours(model: &FittedModel, parts: &[usize]) -> f64 {
    let channels = model.problem.channels.len().max(1);
    let of_channel = |c: usize| {
        let (mut product, mut square, mut count) = (0.0, 0.0, 0_usize);
        for k in parts {
            let all = &model.fit.residuals[*k];
            let own = all.len() / channels;
            let r = &all[c * own..(c + 1) * own];
            product += r.iter().zip(r.iter().skip(1)).map(|(a, b)| a * b).sum::<f64>();
            square += r.iter().map(|r| r * r).sum::<f64>();
            count += own;
        }
        (product - CHANCE * square / (count.max(1) as f64).sqrt()).max(0.0)
    };
    (0..channels).map(of_channel).sum()
}

/// Noise that a measured force shows beside a smooth course, of which no more acts on its body than the force that nobody measured.
fn shown_noise(model: &FittedModel, input: usize, series: &[f64]) -> f64 {
    let body = model.problem.machine.inputs[input].body;
    let name = &model.problem.machine.bodies[body].name;
    let unmeasured = unmeasured(model, model.problem.correction);
    let share = unmeasured.iter().find(|f| f.body == *name).map_or(0.0, |f| f.size / f.noise_of_inputs.max(1e-300));
    facts::noise_beside_smooth(series) * share.min(1.0)
}

/// The data with white noise on their inputs, the same in every run: `size` of it by segment and input.
fn with_noise(data: &Data, size: impl Fn(usize, usize) -> f64) -> Data {
    let mut noisy = data.clone();
    for (k, segment) in noisy.segments.iter_mut().enumerate() {
        for (i, series) in segment.task.inputs.iter_mut().enumerate() {
            let (mut random, size) = (SplitMix::of(&[k as u64, i as u64]), size(k, i));
            series.iter_mut().for_each(|u| *u += size * normal_quantile(random.uniform()));
        }
    }
    noisy
}
