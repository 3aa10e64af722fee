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

use super::fit::project_out;
use super::model::{FittedModel, standard_error};
use super::predict::unmeasured;
use super::problem::{DIVERGED_RESIDUAL, Problem};
use super::screen::local_basis;
use super::stats;
use crate::machine::InputKind;
use crate::machine::simulate::Samples;
use crate::measurement::facts;
use crate::measurement::segments::Data;
use crate::random::{SplitMix, normal_quantile};
use crate::side_by_side::parallel;
use nalgebra::DVector;

/// Noise is added of so much of the root mean square of the force.
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
    let shares = if predicts { shares_of_shown_noise(model) } else { Vec::new() };
    let noise = |input: usize, series: &Vec<f64>| match (is_force(input), predicts) {
        (true, true) => facts::noise_beside_smooth(series) * shares[input],
        (true, false) => ADDED * stats::rms(std::slice::from_ref(series)),
        (false, _) => 0.0,
    };
    let noisy = with_noise(problem.data, noise);
    let noisy = Problem { data: &noisy, ..problem.clone() };
    let bases = parallel(parts.len(), threads, |i| local_basis(problem, &model.fit.point, parts[i]));
    // Sum of squares of what the added noise does, with the globals at `x`; None: a run failed there.
    let added = |x: &[f64]| -> Option<f64> {
        let of = |i: usize| {
            let (k, locals) = (parts[i], &model.fit.point.locals[parts[i]]);
            let (with, without) = (noisy.residuals(k, x, locals), problem.residuals(k, x, locals));
            let failed = |residuals: &[f64]| residuals.iter().any(|r| r.abs() >= DIVERGED_RESIDUAL);
            let moved: Vec<f64> = with.iter().zip(&without).map(|(a, b)| a - b).collect();
            let squares = project_out(&moved, &bases[i]).iter().map(|d| d * d).sum::<f64>();
            (!failed(&with) && !failed(&without)).then_some(squares)
        };
        parallel(parts.len(), threads, of).into_iter().sum()
    };
    let here = &model.fit.point.globals;
    let Some(whole) = added(here).filter(|whole| *whole > 0.0) else { return none };
    let real = if predicts { 1.0 } else { shared / whole };
    // A step of one standard error, away from a bound.
    let slope = |g: usize| -> Option<f64> {
        let step = standard_error(model, g);
        let (low, high) = problem.globals[g].law.bounds();
        let sides = [here[g] + step, here[g] - step].into_iter().filter(|x| x.is_finite() && (low..=high).contains(x));
        let of_side = |to: f64| {
            let mut x = here.clone();
            x[g] = to;
            Some((added(&x)? - whole) / (to - here[g])).filter(|slope| slope.is_finite())
        };
        if problem.ending.is_due() { None } else { sides.into_iter().find_map(of_side) }
    };
    let slope = |g: usize| slope(g).unwrap_or(0.0);
    let slopes = DVector::from_iterator(n, (0..n).map(slope));
    let moved = &model.fit.covariance * slopes * (0.5 * real);
    moved.iter().map(|x| if x.is_finite() { x.abs() } else { 0.0 }).collect()
}

/// Sum of squares of the residuals' part that neighbouring samples share, beyond chance. Missing samples are zeros, and count for nothing.
fn shared_by_neighbours(model: &FittedModel, parts: &[usize]) -> f64 {
    let channels = model.problem.channels.len().max(1);
    let of_channel = |c: usize| {
        let (mut product, mut square, mut pairs) = (0.0, 0.0, 0_usize);
        for k in parts {
            let all = &model.fit.residuals[*k];
            let own = all.len() / channels;
            for pair in all[c * own..(c + 1) * own].windows(2).filter(|pair| pair[0] != 0.0 && pair[1] != 0.0) {
                product += pair[0] * pair[1];
                square += pair[0] * pair[0];
                pairs += 1;
            }
        }
        (product - CHANCE * square / (pairs.max(1) as f64).sqrt()).max(0.0)
    };
    (0..channels).map(of_channel).sum()
}

/// A factor for every input, 1 at most: the force on its body that nobody measured, over the noise that the input shows. Noise beyond that force is
/// movement that a controller asked for.
fn shares_of_shown_noise(model: &FittedModel) -> Vec<f64> {
    let unmeasured = unmeasured(model, model.problem.correction);
    let m = &model.problem.machine;
    let share = |body: usize| {
        let own = unmeasured.iter().find(|f| f.body == m.bodies[body].name);
        own.map_or(0.0, |f| (f.size / f.noise_of_inputs.max(1e-300)).min(1.0))
    };
    m.inputs.iter().map(|input| share(input.body)).collect()
}

/// The data with white noise on their inputs, the same in every run: `size` of it by input and series.
fn with_noise(data: &Data, size: impl Fn(usize, &Vec<f64>) -> f64) -> Data {
    let mut noisy = data.clone();
    for (k, segment) in noisy.segments.iter_mut().enumerate() {
        for (i, series) in segment.task.inputs.iter_mut().enumerate() {
            let (mut random, size) = (SplitMix::of(&[k as u64, i as u64]), size(i, series));
            series.iter_mut().for_each(|u| *u += size * normal_quantile(random.uniform()));
        }
    }
    noisy
}
