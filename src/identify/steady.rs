//! Whether an effect has the same size wherever it is looked at (Green et al.: let a constant number differ from window to
//! window). A cause of its own has one size; what stands in for something else takes the size that each record wants of it.

use super::accept::{globals_of, inflation};
use super::search::Model;
use crate::effects::Kind;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// The size of an effect in a stretch of a record, over its size in all of them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Size {
    pub record: String,
    /// First or second half of the record.
    pub half: u32,
    pub relative: f64,
    pub standard_error: f64,
}

/// Sizes of an effect in the halves of the records that fit, all other numbers free with them, by the model's slopes where it was
/// fitted; empty where it has no size, or one that is looked for by its logarithm.
pub fn sizes(model: &Model, which: usize) -> Vec<Size> {
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
            // The size's own column stands where the last ones begin.
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
