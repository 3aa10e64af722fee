//! What a table of cases says: sensitivities, shares, correlations, with 95 % intervals.
//!
//! * First order S_i and total index ST_i of Sobol': from matrices A, B, A_B^i by Saltelli et al. 2010, table 2 (b) and (f) (Jansen 1999):
//!   S_i = mean(f_B (f_Ai - f_A)) / V, ST_i = mean((f_A - f_Ai)^2) / (2 V), values taken about their mean. A group of numbers that has one
//!   coordinate, such as the links of a chain, has the index of the group.
//! * Elementary effects (Morris 1991): mean mu, mean of magnitudes mu* (Campolongo et al. 2007), standard deviation sigma, a range of the factor.
//! * Shares: Wilson 1927. Rank correlations: Spearman, interval by Fisher's z with the variance of Bonett and Wright 2000.
//! * Intervals of indices and effects: bootstrap over rows or trajectories, percentiles of 1000 samples with a fixed seed.

use crate::random::SplitMix;

/// A number with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct IntervalEstimate {
    pub value: f64,
    pub low: f64,
    pub high: f64,
}

/// Samples of a bootstrap.
const SAMPLES: usize = 1000;
const BOOTSTRAP_SEED: u64 = 1;
/// Quantile of a normal distribution for 95 %.
const Z: f64 = 1.959_963_984_540_054;

/// Sensitivities of a response to a factor by Sobol'.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SobolIndices {
    pub first: IntervalEstimate,
    pub total: IntervalEstimate,
}

/// Indices of every factor. Rows: values at A, at A_B^1 to A_B^k, and at B. None: fewer than two rows, or a response that never changes.
pub fn sobol_indices(rows: &[Vec<f64>], k: usize) -> Option<Vec<SobolIndices>> {
    let all: Vec<usize> = (0..rows.len()).collect();
    let values = indices_of(rows, k, &all)?;
    let mut sampled = vec![[Vec::with_capacity(SAMPLES), Vec::with_capacity(SAMPLES)]; k];
    each_bootstrap(rows.len(), |chosen| {
        for (own, found) in sampled.iter_mut().zip(indices_of(rows, k, chosen).into_iter().flatten()) {
            own[0].push(found.0);
            own[1].push(found.1);
        }
    });
    let of = |(i, (first, total)): (usize, (f64, f64))| SobolIndices {
        first: interval(first, &mut sampled[i][0].clone()),
        total: interval(total, &mut sampled[i][1].clone()),
    };
    Some(values.into_iter().enumerate().map(of).collect())
}

/// First and total index of every factor over chosen rows.
fn indices_of(rows: &[Vec<f64>], k: usize, chosen: &[usize]) -> Option<Vec<(f64, f64)>> {
    let n = chosen.len() as f64;
    if chosen.len() < 2 {
        return None;
    }
    let ends = |row: &usize| [rows[*row][0], rows[*row][k + 1]];
    let mean = chosen.iter().flat_map(ends).sum::<f64>() / (2.0 * n);
    let variance = chosen.iter().flat_map(ends).map(|v| (v - mean) * (v - mean)).sum::<f64>() / (2.0 * n);
    if variance.is_nan() || variance <= 0.0 {
        return None;
    }
    let of = |factor: usize| {
        let (mut first, mut total) = (0.0, 0.0);
        for row in chosen {
            let (a, exchanged, b) = (rows[*row][0], rows[*row][factor + 1], rows[*row][k + 1]);
            first += (b - mean) * (exchanged - a);
            total += (a - exchanged) * (a - exchanged);
        }
        (first / n / variance, 0.5 * total / n / variance)
    };
    Some((0..k).map(of).collect())
}

/// Elementary effects of a factor on a response.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct MorrisEffects {
    /// Mean.
    pub mu: f64,
    /// Mean of magnitudes.
    pub mu_star: IntervalEstimate,
    /// Standard deviation.
    pub sigma: f64,
}

/// Effects of every factor. Trajectories: points and the response there. None: no whole trajectory.
pub fn morris_effects(trajectories: &[Vec<(Vec<f64>, f64)>], k: usize) -> Option<Vec<MorrisEffects>> {
    if trajectories.is_empty() {
        return None;
    }
    // Effects by trajectory and factor.
    let effects: Vec<Vec<f64>> = trajectories
        .iter()
        .map(|points| {
            let mut own = vec![f64::NAN; k];
            for pair in points.windows(2) {
                if let Some(i) = (0..k).find(|i| pair[0].0[*i] != pair[1].0[*i]) {
                    own[i] = (pair[1].1 - pair[0].1) / (pair[1].0[i] - pair[0].0[i]);
                }
            }
            own
        })
        .collect();
    let n = effects.len();
    let star = |i: usize, chosen: &[usize]| chosen.iter().map(|t| effects[*t][i].abs()).sum::<f64>() / n as f64;
    let all: Vec<usize> = (0..n).collect();
    let mut sampled = vec![Vec::with_capacity(SAMPLES); k];
    each_bootstrap(n, |chosen| {
        for (i, own) in sampled.iter_mut().enumerate() {
            own.push(star(i, chosen));
        }
    });
    let of = |i: usize| {
        let mu = effects.iter().map(|e| e[i]).sum::<f64>() / n as f64;
        let squares = effects.iter().map(|e| (e[i] - mu) * (e[i] - mu)).sum::<f64>();
        let sigma = if n > 1 { libm::sqrt(squares / (n - 1) as f64) } else { 0.0 };
        MorrisEffects { mu, mu_star: interval(star(i, &all), &mut sampled[i].clone()), sigma }
    };
    Some((0..k).map(of).collect())
}

/// Calls with the rows of every bootstrap sample.
fn each_bootstrap(n: usize, mut with: impl FnMut(&[usize])) {
    let mut random = SplitMix(BOOTSTRAP_SEED);
    let mut chosen = vec![0; n];
    for _ in 0..SAMPLES {
        chosen.fill_with(|| random.below(n));
        with(&chosen);
    }
}

/// Percentiles of samples about a value.
fn interval(value: f64, samples: &mut [f64]) -> IntervalEstimate {
    samples.sort_by(f64::total_cmp);
    IntervalEstimate { value, low: quantile(samples, 0.025), high: quantile(samples, 0.975) }
}

/// Quantile of sorted values, between two linearly; NaN of none.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = share * last as f64;
    let below = (place as usize).min(last);
    let above = (below + 1).min(last);
    sorted[below] + (place - below as f64) * (sorted[above] - sorted[below])
}

/// Share of `hits` among `n`, with Wilson's interval.
pub fn wilson(hits: usize, n: usize) -> IntervalEstimate {
    if n == 0 {
        return IntervalEstimate { value: f64::NAN, low: 0.0, high: 1.0 };
    }
    let (share, n) = (hits as f64 / n as f64, n as f64);
    let centre = (share + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
    let half = Z / (1.0 + Z * Z / n) * libm::sqrt(share * (1.0 - share) / n + Z * Z / (4.0 * n * n));
    IntervalEstimate { value: share, low: (centre - half).max(0.0), high: (centre + half).min(1.0) }
}

/// Rank correlation of pairs; None: fewer than five, or one of both never changes.
pub fn rank_correlation(x: &[f64], y: &[f64]) -> Option<IntervalEstimate> {
    let n = x.len();
    if n < 5 || n != y.len() {
        return None;
    }
    let (a, b) = (ranks(x), ranks(y));
    let mean = (n as f64 - 1.0) / 2.0;
    let product = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(u, v)| (u - mean) * (v - mean)).sum::<f64>();
    let scale = libm::sqrt(product(&a, &a) * product(&b, &b));
    if scale <= 0.0 {
        return None;
    }
    let value = product(&a, &b) / scale;
    let half = Z * libm::sqrt((1.0 + 0.5 * value * value) / (n as f64 - 3.0));
    let z = libm::atanh(value.clamp(-1.0 + 1e-15, 1.0 - 1e-15));
    Some(IntervalEstimate { value, low: libm::tanh(z - half), high: libm::tanh(z + half) })
}

/// Ranks from 0 on; equal values have the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    let mut from = 0;
    while from < order.len() {
        let alike = order[from..].iter().take_while(|i| values[**i] == values[order[from]]).count().max(1);
        for i in &order[from..from + alike] {
            ranks[*i] = from as f64 + 0.5 * (alike - 1) as f64;
        }
        from += alike;
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::design::{Design, StudyPlan};
    use std::f64::consts::PI;

    fn rows_of(base: usize, k: usize, f: impl Fn(&[f64]) -> f64) -> Vec<Vec<f64>> {
        let design = Design::new(StudyPlan::Saltelli { base, seed: 5 }, &vec![3; k]).expect("few cases");
        let values: Vec<f64> = (0..design.points()).map(|i| f(&design.point(i))).collect();
        values.chunks(k + 2).map(<[f64]>::to_vec).collect()
    }

    /// Ishigami and Homma 1990 with a = 7, b = 0.1: exact indices from Saltelli et al. 2008, section 4.
    #[test]
    fn indices_of_the_ishigami_function_are_the_exact_ones() {
        let f = |u: &[f64]| {
            let [x, y, z] = [0, 1, 2].map(|i| PI * (2.0 * u[i] - 1.0));
            libm::sin(x) + 7.0 * libm::pow(libm::sin(y), 2.0) + 0.1 * libm::pow(z, 4.0) * libm::sin(x)
        };
        let found = sobol_indices(&rows_of(4096, 3, f), 3).expect("indices");
        let exact = [(0.313_9, 0.557_6), (0.442_4, 0.442_4), (0.0, 0.243_7)];
        for (own, (first, total)) in found.iter().zip(exact) {
            // measured: 0.004 and 0.003 at 4096 rows
            assert!((own.first.value - first).abs() < 0.01, "{own:?} {first}");
            assert!((own.total.value - total).abs() < 0.01, "{own:?} {total}");
            assert!(own.first.low <= first && first <= own.first.high, "{own:?} {first}");
            assert!(own.total.low <= total && total <= own.total.high, "{own:?} {total}");
        }
    }

    /// The g-function of Sobol' with a = 0, 1, 4.5, 9, 99: V_i = 1 / (3 (1 + a_i)^2), total V = prod (1 + V_i) - 1.
    #[test]
    fn indices_of_the_g_function_are_the_exact_ones() {
        let a = [0.0, 1.0, 4.5, 9.0, 99.0];
        let f = |u: &[f64]| u.iter().zip(a).map(|(x, a)| ((4.0 * x - 2.0).abs() + a) / (1.0 + a)).product::<f64>();
        let found = sobol_indices(&rows_of(4096, 5, f), 5).expect("indices");
        let v = a.map(|a| 1.0 / (3.0 * (1.0 + a) * (1.0 + a)));
        let all = v.iter().map(|v| 1.0 + v).product::<f64>();
        for (i, own) in found.iter().enumerate() {
            let (first, total) = (v[i] / (all - 1.0), v[i] * (all / (1.0 + v[i])) / (all - 1.0));
            // measured: 0.006 at 4096 rows
            assert!((own.first.value - first).abs() < 0.015, "{i}: {own:?} {first}");
            assert!((own.total.value - total).abs() < 0.015, "{i}: {own:?} {total}");
        }
        assert!(sobol_indices(&vec![vec![1.0; 7]; 8], 5).is_none(), "a response that never changes");
    }

    /// A linear function: every elementary effect is its coefficient; with a product the effects scatter.
    #[test]
    fn elementary_effects_are_the_slopes() {
        let k = 3;
        let design = Design::new(StudyPlan::Morris { trajectories: 40, levels: 4, seed: 2 }, &[4; 3]).expect("few");
        let of = |f: &dyn Fn(&[f64]) -> f64| {
            let all: Vec<(Vec<f64>, f64)> =
                (0..design.points()).map(|i| (design.point(i), f(&design.point(i)))).collect();
            morris_effects(&all.chunks(k + 1).map(<[_]>::to_vec).collect::<Vec<_>>(), k).expect("effects")
        };
        let linear = of(&|u| 3.0 * u[0] - 2.0 * u[1]);
        assert!((linear[0].mu - 3.0).abs() < 1e-12 && (linear[1].mu_star.value - 2.0).abs() < 1e-12);
        assert!(linear[1].mu < 0.0 && linear[2].mu_star.value == 0.0 && linear[0].sigma < 1e-12);
        let product = of(&|u| u[0] * u[1]);
        assert!(product[0].sigma > 0.2 && (product[0].mu - 0.5).abs() < 0.15, "{product:?}");
    }

    /// Newcombe 1998, table I: 81 of 263, and 0 of 20.
    #[test]
    fn shares_have_the_published_intervals() {
        let found = wilson(81, 263);
        assert!((found.low - 0.2553).abs() < 5e-5 && (found.high - 0.3662).abs() < 5e-5, "{found:?}");
        let none = wilson(0, 20);
        assert!(none.low == 0.0 && (none.high - 0.1611).abs() < 5e-5, "{none:?}");
    }

    #[test]
    fn ranks_know_ties_and_correlations_their_sign() {
        assert_eq!(ranks(&[3.0, 1.0, 3.0, 2.0]), [2.5, 0.0, 2.5, 1.0]);
        let x: Vec<f64> = (0..40).map(f64::from).collect();
        let falling: Vec<f64> = x.iter().map(|x| libm::exp(-x)).collect();
        let found = rank_correlation(&x, &falling).expect("a correlation");
        assert!((found.value + 1.0).abs() < 1e-12 && found.high < -0.9);
        assert!(rank_correlation(&x, &vec![1.0; 40]).is_none());
    }
}
