//! Least squares with few unknowns, summed up sample by sample; medians and their scatter.
//!
//! y = x . p + e; the sums of x x^T, x y and y^2 are enough for p, its standard errors and the residual. Columns are scaled to
//! length one before they are factorised (Cholesky), so that metres and newtons may stand side by side.

/// Share of a column that must be its own, beside what the columns before it explain: below, two unknowns cannot be told apart.
const SMALLEST_PIVOT: f64 = 1e-13;

/// Sums of the samples of N unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalEquations<const N: usize> {
    pub xx: [[f64; N]; N],
    pub xy: [f64; N],
    pub yy: f64,
    pub samples: usize,
}

impl<const N: usize> Default for NormalEquations<N> {
    fn default() -> Self {
        NormalEquations { xx: [[0.0; N]; N], xy: [0.0; N], yy: 0.0, samples: 0 }
    }
}

/// Unknowns with their standard errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution<const N: usize> {
    pub value: [f64; N],
    pub error: [f64; N],
    /// Root mean square of what is left.
    pub residual: f64,
}

impl<const N: usize> NormalEquations<N> {
    pub fn add(&mut self, x: [f64; N], y: f64) {
        for i in 0..N {
            for j in 0..N {
                self.xx[i][j] += x[i] * x[j];
            }
            self.xy[i] += x[i] * y;
        }
        self.yy += y * y;
        self.samples += 1;
    }

    /// Adds the samples of another sum.
    pub fn join(&mut self, other: &Self) {
        for i in 0..N {
            for j in 0..N {
                self.xx[i][j] += other.xx[i][j];
            }
            self.xy[i] += other.xy[i];
        }
        self.yy += other.yy;
        self.samples += other.samples;
    }

    /// The unknowns; None where the samples do not tell them apart. `ridge`: share of each column's square by which it is held
    /// at zero, 0 for plain least squares.
    pub fn solve(&self, ridge: f64) -> Option<Solution<N>> {
        let scale: [f64; N] = std::array::from_fn(|i| self.xx[i][i].sqrt());
        if self.samples < N || scale.iter().any(|s| *s <= 0.0 || !s.is_finite()) {
            return None;
        }
        let mut lower = [[0.0; N]; N];
        for i in 0..N {
            for j in 0..=i {
                let own = self.xx[i][j] / (scale[i] * scale[j]) + if i == j { ridge } else { 0.0 };
                let left = own - (0..j).map(|k| lower[i][k] * lower[j][k]).sum::<f64>();
                if i == j && left < SMALLEST_PIVOT {
                    return None;
                }
                lower[i][j] = if i == j { left.sqrt() } else { left / lower[j][j] };
            }
        }
        let scaled = |b: [f64; N]| {
            let mut x = b;
            for i in 0..N {
                x[i] = (x[i] - (0..i).map(|k| lower[i][k] * x[k]).sum::<f64>()) / lower[i][i];
            }
            for i in (0..N).rev() {
                x[i] = (x[i] - (i + 1..N).map(|k| lower[k][i] * x[k]).sum::<f64>()) / lower[i][i];
            }
            x
        };
        let solved = scaled(std::array::from_fn(|i| self.xy[i] / scale[i]));
        let value: [f64; N] = std::array::from_fn(|i| solved[i] / scale[i]);
        let left = (self.yy - (0..N).map(|i| value[i] * self.xy[i]).sum::<f64>()).max(0.0);
        let variance = left / self.samples.saturating_sub(N).max(1) as f64;
        let error = std::array::from_fn(|i| {
            let unit: [f64; N] = std::array::from_fn(|k| f64::from(u8::from(k == i)));
            (variance * scaled(unit)[i]).max(0.0).sqrt() / scale[i]
        });
        Some(Solution { value, error, residual: variance.sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_and_columns_that_are_one_are_refused() {
        let mut sums = NormalEquations::<2>::default();
        (0..20).for_each(|i| sums.add([1.0, 1e9 * f64::from(i)], 3.0 + 2e-6 * f64::from(i)));
        let line = sums.solve(0.0).expect("two unknowns");
        assert!((line.value[0] - 3.0).abs() < 1e-12 && (line.value[1] / 2e-15 - 1.0).abs() < 1e-9, "{line:?}");
        let mut same = NormalEquations::<2>::default();
        (0..20).for_each(|i| same.add([f64::from(i), 2.0 * f64::from(i)], 1.0));
        assert_eq!(same.solve(0.0), None);
    }
}
