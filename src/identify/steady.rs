//! Whether an effect has the same size in all parts of the records (Green et al.: let a constant parameter differ from
//! window to window). A real cause has one size; a substitute for another cause takes a different size in each record.

use super::model::{FittedModel, globals_of, inflation};
use crate::effects::Kind;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// The size of an effect in half a record, relative to its overall size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Size {
    pub record: String,
    /// First or second half of the record.
    pub half: u32,
    pub relative: f64,
    pub standard_error: f64,
}

/// Sizes that spread by less than this are equal: a slightly wrong law has the same spread.
const EQUAL_SPREAD: f64 = 0.3;
/// Standard normal deviate of 99 %.
const DEVIATE_99: f64 = 2.326;

/// Whether sizes differ by more than their standard errors and by more than a slightly wrong law explains: chi-squared
/// of their spread is beyond its 99 % point (Wilson and Hilferty 1931), and their standard deviation exceeds 30 %. A
/// half that hardly determines the size has little weight in this deviation.
pub fn differ(sizes: &[Size]) -> bool {
    let free = sizes.len() as f64 - 1.0;
    if free < 1.0 || sizes.iter().any(|s| !s.relative.is_finite() || s.standard_error.is_nan()) {
        return false;
    }
    // Weighted sum of squares about the mean, and sum of weights, with `more` added to the variances.
    let about_mean = |more: f64| {
        let weight = |s: &Size| 1.0 / (s.standard_error * s.standard_error + more).max(1e-12);
        let weights: f64 = sizes.iter().map(weight).sum();
        let mean = sizes.iter().map(|s| weight(s) * s.relative).sum::<f64>() / weights;
        (sizes.iter().map(|s| weight(s) * (s.relative - mean) * (s.relative - mean)).sum::<f64>(), weights)
    };
    let chi2 = about_mean(0.0).0;
    let (squares, weights) = about_mean(EQUAL_SPREAD * EQUAL_SPREAD);
    let spread = squares / weights * (free + 1.0) / free;
    let narrow = 2.0 / (9.0 * free);
    let point = free * (1.0 - narrow + DEVIATE_99 * libm::sqrt(narrow)).powi(3);
    chi2 > point && spread > EQUAL_SPREAD * EQUAL_SPREAD
}

/// Records from which a course of sizes is told, and standard errors by which its ends must differ: one of 400 by chance.
const LEAST_RECORDS: usize = 3;
const ENDS_DIFFER: f64 = 3.0;

/// Sizes of the first and the last record, if sizes fall or rise from record to record by more than their errors.
pub fn course(sizes: &[Size]) -> Option<[f64; 2]> {
    if sizes.iter().any(|s| !s.relative.is_finite() || s.standard_error.is_nan()) {
        return None;
    }
    // Weighted mean of the halves of each record, and its variance.
    let of_record = |own: &[Size]| {
        let weight = |s: &Size| 1.0 / (s.standard_error * s.standard_error).max(1e-12);
        let weights: f64 = own.iter().map(weight).sum();
        (own.iter().map(|s| weight(s) * s.relative).sum::<f64>() / weights, 1.0 / weights)
    };
    let of: Vec<(f64, f64)> = sizes.chunk_by(|a, b| a.record == b.record).map(of_record).collect();
    let [first, .., last] = of.as_slice() else { return None };
    let one_way = of.windows(2).all(|w| w[1].0 > w[0].0) || of.windows(2).all(|w| w[1].0 < w[0].0);
    let is_sure = (last.0 - first.0).abs() > ENDS_DIFFER * libm::sqrt(first.1 + last.1);
    (of.len() >= LEAST_RECORDS && one_way && is_sure).then_some([first.0, last.0])
}

/// `0.98 1.02 in first, 1.00 0.99 in second`.
pub fn sizes_text(sizes: &[Size]) -> String {
    let mut text = String::new();
    for (i, s) in sizes.iter().enumerate() {
        text += &format!("{:.2}", s.relative);
        let last = sizes.get(i + 1).is_none_or(|next| next.record != s.record);
        text += &if last { format!(" in {}", s.record) } else { " ".into() };
        text += if last && i + 1 < sizes.len() { ", " } else { "" };
    }
    text
}

/// Sizes of an effect in the halves of the fitted records, estimated together with all other parameters from the
/// Jacobian at the fit. Empty if the effect has no size, or one that is searched by its logarithm.
pub fn sizes(model: &FittedModel, which: usize) -> Vec<Size> {
    let (problem, fit) = (&model.problem, &model.fit);
    let n = problem.globals.len();
    let keys = problem.machine.keys(model.effects[which].effect, model.effects[which].target);
    let is_size = |g: &usize| {
        let key = problem.machine.slots[problem.globals[*g].slot].path.rsplit('.').next();
        keys.iter().any(|(k, row)| Some(k.as_str()) == key && row.kind == Kind::Amplitude)
            && !problem.globals[*g].law.logarithm
    };
    let own: Vec<usize> = globals_of(model, which).into_iter().filter(is_size).collect();
    let [size] = *own else { return Vec::new() };
    let whole = fit.point.globals[size];
    let parts: Vec<usize> = (0..problem.data.segments.len()).filter(|k| fit.jacobians[*k].nrows() > 0).collect();
    // Groups of rows: record and half.
    let mut groups: Vec<(usize, u32)> = Vec::new();
    for k in &parts {
        for half in [1, 2] {
            let group = (problem.data.segments[*k].record, half);
            if !groups.contains(&group) {
                groups.push(group);
            }
        }
    }
    let m = n + groups.len() - 1;
    let (mut a, mut b) = (DMatrix::<f64>::zeros(m, m), DVector::<f64>::zeros(m));
    let channels = problem.channels.len().max(1);
    for k in &parts {
        let (j, r) = (&fit.jacobians[*k], &fit.residuals[*k]);
        let samples = r.len() / channels;
        let record = problem.data.segments[*k].record;
        for (i, residual) in r.iter().enumerate() {
            let half = 1 + u32::from(i % samples.max(1) >= samples / 2);
            let group = groups.iter().position(|g| *g == (record, half)).unwrap_or(0);
            // The columns of the size in each group follow the other columns.
            let column = |c: usize| if c < size { c } else { c - 1 };
            let mut row: Vec<(usize, f64)> = (0..n).filter(|c| *c != size).map(|c| (column(c), j[(i, c)])).collect();
            row.push((n - 1 + group, j[(i, size)]));
            for (c, x) in &row {
                b[*c] -= x * residual;
                for (d, y) in &row {
                    a[(*c, *d)] += x * y;
                }
            }
        }
    }
    for (g, global) in problem.globals.iter().enumerate().filter(|(g, _)| *g != size) {
        let at = if g < size { g } else { g - 1 };
        if let Some((mean, s)) = global.prior {
            a[(at, at)] += 1.0 / (s * s);
            b[at] -= (fit.point.globals[g] - mean) / (s * s);
        }
    }
    for i in 0..m {
        a[(i, i)] += 1e-9 * a[(i, i)] + 1e-300;
    }
    let Some(inverse) = a.try_inverse() else { return Vec::new() };
    let step = &inverse * b;
    let inflation = inflation(model);
    let size = |(g, (record, half)): (usize, &(usize, u32))| Size {
        record: problem.data.records[*record].clone(),
        half: *half,
        relative: 1.0 + step[n - 1 + g] / whole,
        standard_error: libm::sqrt((inverse[(n - 1 + g, n - 1 + g)] * inflation).max(0.0)) / whole.abs(),
    };
    groups.iter().enumerate().map(size).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sizes_of(all: &[(f64, f64)]) -> Vec<Size> {
        let size = |(i, s): (usize, &(f64, f64))| Size {
            record: if i < 2 { "first".into() } else { "second".into() },
            half: 1 + i as u32 % 2,
            relative: s.0,
            standard_error: s.1,
        };
        all.iter().enumerate().map(size).collect()
    }

    #[test]
    fn sizes_have_a_course_if_they_go_one_way_by_more_than_their_errors() {
        let has_course = |of: &[(&str, f64, f64)]| {
            let size = |(i, s): (usize, &(&str, f64, f64))| Size {
                record: s.0.into(),
                half: 1 + i as u32 % 2,
                relative: s.1,
                standard_error: s.2,
            };
            course(&of.iter().enumerate().map(size).collect::<Vec<_>>()).is_some()
        };
        let falls = [("a", 1.2, 0.05), ("a", 1.1, 0.05), ("b", 1.0, 0.05), ("b", 1.0, 0.05), ("c", 0.8, 0.05)];
        assert!(has_course(&falls));
        assert!(!has_course(&falls.map(|(record, size, _)| (record, size, 0.2))), "by less than their errors");
        assert!(!has_course(&falls[..4]), "two records are always in an order");
        assert!(!has_course(&[("a", 1.2, 0.05), ("b", 0.7, 0.05), ("c", 0.8, 0.05)]), "down and up");
        assert!(!has_course(&[]));
    }

    #[test]
    fn sizes_differ_beyond_their_errors_and_beyond_a_law_that_is_a_little_off() {
        assert!(differ(&sizes_of(&[(0.51, 0.14), (1.14, 0.04), (0.63, 0.10), (1.06, 0.03)])));
        assert!(
            !differ(&sizes_of(&[(0.91, 0.001), (1.10, 0.001), (0.95, 0.001), (1.05, 0.001)])),
            "small, however sure"
        );
        assert!(!differ(&sizes_of(&[(0.5, 0.4), (1.5, 0.4), (0.6, 0.4), (1.4, 0.4)])), "large, but not sure");
        assert!(
            !differ(&sizes_of(&[(0.95, 0.005), (1.05, 0.005), (1.00, 0.005), (2.0, 1.0)])),
            "one half tells nothing"
        );
        assert!(!differ(&sizes_of(&[(1.0, 0.1)])));
        assert_eq!(sizes_text(&sizes_of(&[(1.0, 0.1), (0.9, 0.1), (1.1, 0.1)])), "1.00 0.90 in first, 1.10 in second");
    }
}
