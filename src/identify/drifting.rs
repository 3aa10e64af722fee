//! Numbers that differ from record to record: a machine that warms up, wears, or is set up anew between two records.
//!
//! A number of the final model gets a value for each record that is fitted. Held-out records take values on straight lines between
//! those of their neighbours in the order of the records, so that a trend is tested on records that had no part in it. A number whose
//! values have no order can only be told by what the fit gains.

use super::fit::{Fit, FitOptions, fit};
use super::model::{FittedModel, inflation};
use super::problem::{Global, Problem};
use super::search::Context;
use super::stats;
use crate::effects::{Kind, parameter_at};
use serde::Serialize;

/// A number with a value for each record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VaryingNumber {
    pub path: String,
    /// Effects of the model; those that are not named do not stand with one size.
    pub beside: Vec<String>,
    pub course: Course,
    /// Records in their order, with the number's value and its standard error, in the key's unit.
    pub values: Vec<RecordValue>,
    /// Error of the fitted records with a value for each over that with one for all.
    pub fitted_ratio: f64,
    /// The same of the held-out records, with values between those of their neighbours, and its interval of 95 %.
    pub held_out_ratio: Option<[f64; 3]>,
}

impl VaryingNumber {
    /// What would tell more.
    pub fn experiment(&self) -> String {
        format!(
            "`{}` {}: if the machine warms up, runs in or wears, records of one state; or a value for each record (`[fit.\"{}\"]` with `per = \"record\"`)",
            self.path,
            self.course.label(),
            self.path
        )
    }
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordValue {
    pub record: String,
    pub value: f64,
    pub standard_error: f64,
}

/// How a number goes in the order of the records.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Course {
    Falls,
    Rises,
    /// Up and down, but held-out records lie between their neighbours.
    Wanders,
    /// Held-out records do not lie between their neighbours, or there are none.
    NoOrder,
}

impl Course {
    pub fn label(self) -> &'static str {
        match self {
            Course::Falls => "falls in the order of the records",
            Course::Rises => "rises in the order of the records",
            Course::Wanders => "goes up and down with the records",
            Course::NoOrder => "differs from record to record, without order",
        }
    }
}

/// Numbers that are tried with a value for each record: those that promise most.
const TRIED: usize = 3;
/// Numbers that are told at most.
const TOLD: usize = 3;
/// Share of the fitted squared error above the noise floor that values for each record must take, by their slopes and then by a fit.
// Not varied. Coulomb friction that falls by a quarter or a half over six records takes 83 to 99 % in three cases of a blind set.
const LEAST_SHARE: f64 = 0.5;
/// The held-out error must fall to this at most.
const MOST_HELD_OUT: f64 = 0.95;
const ITERATIONS: usize = 20;

/// Numbers of the final model that differ from record to record, the one that explains most first; then those of other sets of effects
/// that held-out records confirm: a set whose size differs from record to record is refused as it stands. Empty where what is left is noise.
pub fn varying_numbers(best: &FittedModel, others: &[FittedModel], context: &Context) -> Vec<VaryingNumber> {
    let mut found = of_model(best, context);
    let others: Vec<_> = others.iter().flat_map(|m| of_model(m, context)).collect();
    found.extend(others.into_iter().filter(|(v, _)| v.course != Course::NoOrder));
    let is_unordered = |v: &VaryingNumber| v.course == Course::NoOrder;
    found.sort_by(|a, b| is_unordered(&a.0).cmp(&is_unordered(&b.0)).then(a.1.total_cmp(&b.1)));
    found.truncate(TOLD);
    found.into_iter().map(|(v, _)| v).collect()
}

/// Numbers of a model that differ from record to record, each with the fitted squared error that is then above the floor.
fn of_model(model: &FittedModel, context: &Context) -> Vec<(VaryingNumber, f64)> {
    let records = fitted_records(&model.problem);
    let effort = model.problem.machine.effort();
    if records.len() < 2 || !effort.noise_alone_is_left || above_floor(model) <= 0.0 {
        return Vec::new();
    }
    let mut order: Vec<(usize, f64)> = (0..model.problem.globals.len())
        .filter(|g| is_size(&model.problem, *g))
        .map(|g| (g, promised(model, g)))
        .filter(|(_, share)| *share >= LEAST_SHARE)
        .collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    order.truncate(TRIED);
    order
        .into_iter()
        .take_while(|_| !context.must_end())
        .filter_map(|(g, _)| with_a_value_for_each(model, g, &records))
        .collect()
}

/// Records with fitted samples, in their order.
fn fitted_records(problem: &Problem) -> Vec<usize> {
    let mut all: Vec<usize> = problem.data.segments.iter().filter(|s| s.judge_from > 0).map(|s| s.record).collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// Whether a global is one number for all records, and the size of something rather than its shape.
fn is_size(problem: &Problem, global: usize) -> bool {
    let g = &problem.globals[global];
    let path = &problem.machine.slots[g.slot].path;
    g.record.is_none() && parameter_at(path).is_none_or(|p| p.kind == Kind::Amplitude)
}

/// Squared error of the fitted records above the noise floor, in the unit of the weighted residuals.
fn above_floor(model: &FittedModel) -> f64 {
    let (problem, left) = (&model.problem, &model.fit_residuals);
    let of = |c: usize| {
        let n: usize = left[c].iter().map(Vec::len).sum();
        let excess = stats::rms(&left[c]).powi(2) - problem.data.channels[c].noise.powi(2);
        n as f64 * excess.max(0.0) / problem.weights[c].powi(2)
    };
    (0..problem.channels.len()).map(of).sum()
}

/// Share of the squared error above the floor that a value for each record would take, were residuals linear in it.
fn promised(model: &FittedModel, global: usize) -> f64 {
    let problem = &model.problem;
    let of = |record: usize| {
        let (mut slope, mut square) = (0.0, 0.0);
        for (k, s) in problem.data.segments.iter().enumerate() {
            let (j, r) = (&model.fit.jacobians[k], &model.fit.residuals[k]);
            if s.record == record && j.nrows() == r.len() && !r.is_empty() {
                slope += j.column(global).iter().zip(r).map(|(j, r)| j * r).sum::<f64>();
                square += j.column(global).norm_squared();
            }
        }
        if square > 0.0 { slope * slope / square } else { 0.0 }
    };
    fitted_records(problem).into_iter().map(of).sum::<f64>() / above_floor(model)
}

/// The number with a value for each record, if that takes most of what is left.
fn with_a_value_for_each(model: &FittedModel, global: usize, records: &[usize]) -> Option<(VaryingNumber, f64)> {
    let mut problem = model.problem.clone();
    let mut point = model.fit.point.clone();
    let (number, x) = (problem.globals.remove(global), point.globals.remove(global));
    let first = problem.globals.len();
    for r in records {
        problem.globals.push(Global { record: Some(*r), prior: None, ..number.clone() });
        point.globals.push(x);
    }
    let found = fit(&problem, &point, FitOptions { iterations: ITERATIONS, threads: model.threads });
    let values: Vec<f64> = found.point.globals[first..].to_vec();
    for r in 0..problem.data.records.len() {
        if !records.contains(&r) {
            problem.fixed.push((Some(r), number.slot, number.law.value(between_neighbours(records, &values, r))));
        }
    }
    let other = FittedModel::new(problem, found, model.effects.clone(), model.own, model.threads);
    let fitted_ratio = mean_ratio(&other, model);
    let left = above_floor(&other);
    if left > (1.0 - LEAST_SHARE) * above_floor(model) {
        return None;
    }
    let is_judged = !model.own.segments.is_empty();
    let held_out_ratio = is_judged.then(|| other.residuals().judge_ratio(model.residuals()));
    let is_predicted = held_out_ratio.is_some_and(|[ratio, _, high]| ratio < MOST_HELD_OUT && high < 1.0);
    let course = match () {
        () if !is_predicted => Course::NoOrder,
        () if values.windows(2).all(|w| w[1] < w[0]) => Course::Falls,
        () if values.windows(2).all(|w| w[1] > w[0]) => Course::Rises,
        () => Course::Wanders,
    };
    let slot = &model.problem.machine.slots[number.slot];
    let per_unit = |x: f64| if number.law.logarithm { number.law.value(x) } else { number.law.scale } / slot.unit;
    let value = |(i, r): (usize, &usize)| RecordValue {
        record: model.problem.data.records[*r].clone(),
        value: number.law.value(values[i]) / slot.unit,
        standard_error: standard_error_in(&other.fit, first + i, inflation(&other)) * per_unit(values[i]).abs(),
    };
    let path = slot.path.clone();
    let values = records.iter().enumerate().map(value).collect();
    let beside = model.effects.iter().map(super::candidates::Hypothesis::identity).collect();
    Some((VaryingNumber { path, beside, course, values, fitted_ratio, held_out_ratio }, left))
}

fn standard_error_in(fit: &Fit, global: usize, variance: f64) -> f64 {
    libm::sqrt((fit.covariance[(global, global)] * variance).max(0.0))
}

/// Value at a record, on straight lines between records that have one; beyond them the nearest.
fn between_neighbours(records: &[usize], values: &[f64], at: usize) -> f64 {
    let after = records.iter().position(|r| *r >= at);
    match after {
        None => values[values.len() - 1],
        Some(0) => values[0],
        Some(i) => {
            let (a, b) = (records[i - 1], records[i]);
            values[i - 1] + (values[i] - values[i - 1]) * (at - a) as f64 / (b - a) as f64
        }
    }
}

/// Mean over the channels of the fitted error over that of another model.
fn mean_ratio(a: &FittedModel, b: &FittedModel) -> f64 {
    let of = |c: usize| stats::rms(&a.fit_residuals[c]) / stats::rms(&b.fit_residuals[c]).max(1e-300);
    let channels = a.fit_residuals.len();
    (0..channels).map(of).sum::<f64>() / channels.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::between_neighbours;

    #[test]
    fn a_record_lies_between_its_neighbours() {
        let at = |r: usize| between_neighbours(&[1, 3, 7], &[10.0, 6.0, 2.0], r);
        assert_eq!([at(0), at(1), at(2), at(4), at(7), at(9)], [10.0, 10.0, 8.0, 5.0, 2.0, 2.0]);
    }
}
