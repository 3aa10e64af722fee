//! Numbers that differ from record to record: a machine that warms up, wears, or is set up anew between two records.
//!
//! A number of the final model gets a value for each record that is fitted. Held-out records take values on a smooth curve through
//! those of their neighbours in the order of the records, so that a trend is tested on records that had no part in it. A number whose
//! values have no order can only be told by what the fit gains.

use super::candidates::law_of_shape;
use super::fit::{Fit, FitOptions, fit};
use super::model::{FittedModel, placed_path, standard_error};
use super::problem::{Global, Point, Problem};
use super::search::Context;
use super::stats;
use crate::effects::{Kind, parameter_at};
use crate::measurement::segments::RecordSegment;
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

/// A number that differs from record to record, with the model in which it has a value for each.
pub struct DriftingNumber<'a> {
    pub number: VaryingNumber,
    pub model: FittedModel<'a>,
    /// Whether records that had no part in the fit lie on its course.
    pub is_confirmed: bool,
    /// Squared error of the fitted records that is then above the floor.
    left: f64,
}

/// Numbers that are tried with a value for each record: those that promise most.
const TRIED: usize = 3;
/// Numbers that are told at most.
pub(super) const TOLD: usize = 3;
/// Records from which a course is told: two are always in an order.
const LEAST_RECORDS: usize = 3;
/// Share of the fitted squared error above the noise floor that values for each record must promise by their slopes, which know no other number's change.
const PROMISED_SHARE: f64 = 0.3;
/// Share of it that they must take by a fit.
// Not varied. Coulomb friction that falls by a quarter or a half over six records takes 83 to 99 % in three cases of a blind set.
const LEAST_SHARE: f64 = 0.5;
/// Standard errors of a step from record to record of values that go one way.
const ONE_WAY: f64 = 2.0;
/// The held-out error must fall to this at most.
const MOST_HELD_OUT: f64 = 0.95;
const ITERATIONS: usize = 20;
/// Factor by which friction of a second start is sharper at rest.
const SHARPER: f64 = 30.0;

/// Numbers of the final model that differ from record to record, the one that explains most first; then those of other sets of effects
/// that held-out records confirm: a set whose size differs from record to record is refused as it stands. Empty where what is left is noise.
pub fn varying_numbers<'a>(
    best: &FittedModel<'a>,
    others: &[FittedModel<'a>],
    context: &Context,
) -> Vec<DriftingNumber<'a>> {
    let is_unordered = |d: &DriftingNumber| d.number.course == Course::NoOrder;
    let mut found = of_model(best, context);
    let others = others.iter().filter(|m| m.identity() != best.identity());
    let others: Vec<_> = others.flat_map(|m| of_model(m, context)).collect();
    found.extend(others.into_iter().filter(|d| !is_unordered(d)));
    found.sort_by(|a, b| is_unordered(a).cmp(&is_unordered(b)).then(a.left.total_cmp(&b.left)));
    found
}

/// Whether what a model leaves is noise alone once one of its numbers follows the order of the records: further effects would only follow that
/// course. Where loads or motions go one way with the records, the number may follow them instead, and another effect may be missing.
pub(super) fn explains_the_rest(model: &FittedModel, context: &Context) -> bool {
    if model.is_noise_alone() || is_ordered_by_load(&model.problem) || is_ordered_by_motion(&model.problem) {
        return false;
    }
    let explains = |d: &DriftingNumber| d.is_confirmed && d.model.is_noise_alone();
    of_model(model, context).iter().any(explains)
}

/// Records whose inputs or motions grow or fall in their order by this factor may differ by them, and not by their order.
const LOAD_CHANGES: f64 = 1.2;

/// Whether an input grows or falls in the order of the fitted records: what seems to follow their order may follow the load.
pub(super) fn is_ordered_by_load(problem: &Problem) -> bool {
    goes_one_way(problem, |s| &s.task.inputs)
}

/// Whether a measured series grows or falls in the order of the fitted records: what seems to follow their order may follow the motion.
fn is_ordered_by_motion(problem: &Problem) -> bool {
    goes_one_way(problem, |s| &s.measured)
}

/// Whether the size of some series goes one way in the order of the fitted records, by more than a little.
fn goes_one_way(problem: &Problem, series: impl Fn(&RecordSegment) -> &Vec<Vec<f64>>) -> bool {
    let size = |own: &Vec<f64>| stats::rms(&[own.iter().copied().filter(|x| x.is_finite()).collect()]);
    let fitted = problem.data.segments.iter().filter(|s| s.judge_from > 0);
    let sizes: Vec<Vec<f64>> = fitted.map(|s| series(s).iter().map(size).collect()).collect();
    let count = sizes.iter().map(Vec::len).min().unwrap_or(0);
    (0..count).any(|i| {
        let of: Vec<f64> = sizes.iter().map(|own| own[i]).collect();
        let (first, last) = (of[0], of[of.len() - 1]);
        let one_way = of.windows(2).all(|w| w[1] > w[0]) || of.windows(2).all(|w| w[1] < w[0]);
        one_way && first.max(last) > LOAD_CHANGES * first.min(last)
    })
}

/// Numbers of a model that differ from record to record.
fn of_model<'a>(model: &FittedModel<'a>, context: &Context) -> Vec<DriftingNumber<'a>> {
    let records = fitted_records(&model.problem);
    let effort = model.problem.machine.effort();
    if records.len() < 2 || !effort.noise_alone_is_left || above_floor(model) <= 0.0 {
        return Vec::new();
    }
    let mut order: Vec<(usize, f64)> = (0..model.problem.globals.len())
        .filter(|g| is_size(&model.problem, *g))
        .map(|g| (g, promised(model, g)))
        .filter(|(_, share)| *share >= PROMISED_SHARE)
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
fn with_a_value_for_each<'a>(model: &FittedModel<'a>, global: usize, records: &[usize]) -> Option<DriftingNumber<'a>> {
    let mut problem = model.problem.clone();
    let mut point = model.fit.point.clone();
    let (number, x) = (problem.globals[global].clone(), point.globals[global]);
    let own = |r: &usize| Global { record: Some(*r), prior: None, ..number.clone() };
    problem.globals.splice(global..=global, records.iter().map(own));
    point.globals.splice(global..=global, records.iter().map(|_| x));
    let effects: Vec<String> = (0..model.effects.len()).map(|which| placed_path(model, which) + ".").collect();
    let (mut problem, found) = fit_from_sharper_friction_too(problem, &effects, &point, model.threads);
    let values: Vec<f64> = found.point.globals[global..global + records.len()].to_vec();
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
    let is_between = |r: &usize| records.iter().any(|own| own < r) && records.iter().any(|own| own > r);
    let judges = model.own.segments.iter().map(|s| s.record).filter(|r| !records.contains(r));
    let mut between: Vec<usize> = judges.filter(is_between).collect();
    between.dedup();
    let is_tested = !between.is_empty() && records.len() + between.len() >= LEAST_RECORDS;
    let falls_enough = |[ratio, _, high]: [f64; 3]| ratio < MOST_HELD_OUT && high < 1.0;
    let slot = &model.problem.machine.slots[number.slot];
    let per_unit = |x: f64| if number.law.logarithm { number.law.value(x) } else { number.law.scale } / slot.unit;
    let value = |(i, r): (usize, &usize)| RecordValue {
        record: model.problem.data.records[*r].clone(),
        value: number.law.value(values[i]) / slot.unit,
        standard_error: standard_error(&other, global + i) * per_unit(values[i]).abs(),
    };
    let path = slot.path.clone();
    let shown: Vec<RecordValue> = records.iter().enumerate().map(value).collect();
    let is_confirmed = is_tested && held_out_ratio.is_some_and(falls_enough);
    let is_told = is_confirmed || !is_tested && records.len() >= LEAST_RECORDS && go_one_way(&shown);
    let course = match () {
        () if !is_told => Course::NoOrder,
        () if values.windows(2).all(|w| w[1] < w[0]) => Course::Falls,
        () if values.windows(2).all(|w| w[1] > w[0]) => Course::Rises,
        () => Course::Wanders,
    };
    let beside = model.effects.iter().map(super::candidates::Hypothesis::identity).collect();
    let number = VaryingNumber { path, beside, course, values: shown, fitted_ratio, held_out_ratio };
    Some(DriftingNumber { number, model: other, is_confirmed, left })
}

/// The better of two fits: one starts as it is told to, the other with friction that is sharper at rest, in a range about that. One size for all
/// records makes friction soft, where sizes differ.
/// `effects`: paths of the effects whose friction it is; a number of the drive file keeps its range.
fn fit_from_sharper_friction_too<'a>(
    problem: Problem<'a>,
    effects: &[String],
    start: &Point,
    threads: usize,
) -> (Problem<'a>, Fit) {
    let options = FitOptions { iterations: ITERATIONS, threads };
    let found = fit(&problem, start, options);
    let (mut sharper, mut begin) = (problem.clone(), found.point.clone());
    let mut is_sharper = false;
    for (g, x) in begin.globals.iter_mut().enumerate() {
        let Global { slot, law, .. } = &problem.globals[g];
        let slot = &problem.machine.slots[*slot];
        let is_own = effects.iter().any(|effect| slot.path.starts_with(effect.as_str()));
        if is_own && law.logarithm && slot.path.rsplit('.').next().is_some_and(|key| key.starts_with("stick_speed")) {
            let value = law.value(*x) / SHARPER;
            sharper.globals[g].law = law_of_shape(value, (slot.low * slot.unit, slot.high * slot.unit));
            *x = sharper.globals[g].law.scaled(value);
            is_sharper = true;
        }
    }
    if !is_sharper {
        return (problem, found);
    }
    let other = fit(&sharper, &begin, options);
    if other.cost < found.cost { (sharper, other) } else { (problem, found) }
}

/// Whether values go one way from record to record by more than their errors. No record is held out between them: such a course is told, and names nothing.
fn go_one_way(values: &[RecordValue]) -> bool {
    let steps = values.windows(2).map(|w| {
        let error = libm::hypot(w[0].standard_error, w[1].standard_error);
        (w[1].value - w[0].value) / error.max(1e-300)
    });
    let (falls, rises) = steps.fold((true, true), |(f, r), by| (f && by < -ONE_WAY, r && by > ONE_WAY));
    falls || rises
}

/// Value at a record, on a curve through the records that have one, which turns nowhere between two of them (monotone cubic, Fritsch and
/// Butland 1984); beyond them the nearest.
fn between_neighbours(records: &[usize], values: &[f64], at: usize) -> f64 {
    let last = values.len() - 1;
    let length = |i: usize| (records[i + 1] - records[i]) as f64;
    let rise = |i: usize| (values[i + 1] - values[i]) / length(i);
    // Slope at an inner record: the harmonic mean of those beside it, zero where the curve turns.
    let inner = |i: usize| {
        let (a, b) = (rise(i - 1), rise(i));
        let (near, far) = (length(i - 1) + 2.0 * length(i), 2.0 * length(i - 1) + length(i));
        if a * b > 0.0 { (near + far) / (near / a + far / b) } else { 0.0 }
    };
    // At an end, of the parabola through three records; never away from the neighbour, never steeper than three times the straight line.
    let end = |own: usize, next: usize| {
        let (h, k) = (length(own), length(next));
        let slope = ((2.0 * h + k) * rise(own) - h * rise(next)) / (h + k);
        let most = 3.0 * rise(own);
        if slope * rise(own) <= 0.0 {
            0.0
        } else if slope.abs() > most.abs() {
            most
        } else {
            slope
        }
    };
    let slope = |i: usize| match i {
        _ if last == 1 => rise(0),
        0 => end(0, 1),
        i if i == last => end(last - 1, last - 2),
        i => inner(i),
    };
    match records.iter().position(|r| *r >= at) {
        None => values[last],
        Some(0) => values[0],
        Some(i) => {
            let (h, a) = (length(i - 1), i - 1);
            let x = (at - records[a]) as f64 / h;
            let (from, to) = (values[a] + x * h * slope(a), values[i] - (1.0 - x) * h * slope(i));
            let (start, finish) = ((1.0 - x) * (1.0 - x) * (1.0 + 2.0 * x), x * x * (3.0 - 2.0 * x));
            // Hermite's cubic as a blend of the two tangents and what is left of the bend between them.
            values[a] * start
                + values[i] * finish
                + (from - values[a]) * (1.0 - x) * (1.0 - x)
                + (to - values[i]) * x * x
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
        let line = |r: usize| between_neighbours(&[1, 3, 7], &[10.0, 8.0, 4.0], r);
        assert_eq!([line(0), line(1), line(2), line(4), line(7), line(9)], [10.0, 10.0, 9.0, 7.0, 4.0, 4.0]);
        assert_eq!(between_neighbours(&[2, 6], &[1.0, 3.0], 3), 1.5);
        assert_eq!(between_neighbours(&[4], &[1.0], 9), 1.0);
        // A machine that warms up: an exponential, which straight lines miss by 4.8 % at record 1.
        let warm = |r: usize| 0.3 + 0.3 * libm::exp(-0.5 * r as f64);
        let records = [0, 2, 4, 6];
        let values = records.map(warm);
        for r in [1, 3, 5] {
            let error = between_neighbours(&records, &values, r) / warm(r) - 1.0;
            assert!(error.abs() < 0.01, "record {r}: {error}");
        }
        // Between records at uneven places too: an end of one, a gap of four.
        let uneven = [0, 1, 5, 6];
        let error = between_neighbours(&uneven, &uneven.map(warm), 3) / warm(3) - 1.0;
        assert!(error.abs() < 0.03, "{error}");
        // Nothing overshoots where values turn.
        let bent = [1.0, 3.0, 3.0, 0.0];
        assert_eq!(between_neighbours(&records, &bent, 3), 3.0);
        assert!((1.0..3.0).contains(&between_neighbours(&records, &bent, 1)));
    }
}
