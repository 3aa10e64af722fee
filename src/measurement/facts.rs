//! Facts about the samples of a record, computed before any model is used.
//!
//! Noise floor: the standard deviation of the part that is not a smooth signal, from fourth differences (x_i-2 - 4
//! x_i-1 + 6 x_i - 4 x_i+1 + x_i+2, variance 70 sigma^2 for white noise). It is a median over blocks, so that events
//! have no influence; it is taken from stretches at rest if there are any; it is never below the quantisation noise,
//! step / sqrt(12).

use serde::Serialize;

/// Facts of one channel in one record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Facts {
    /// Name of the record.
    pub record: String,
    /// Name of the channel.
    pub channel: String,
    /// Unit of the column, in which the numbers below are.
    pub unit: String,
    /// Number of samples.
    pub samples: usize,
    /// Number of samples that are empty or no number.
    pub missing: usize,
    /// Smallest value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
    /// Spacing of the grid on which all values lie; zero if there is none.
    pub quantisation: f64,
    /// Share of the samples at the lowest or highest value [percent].
    pub clipped_percent: f64,
    /// Samples at rest: a stretch in which only noise changes the value.
    pub rest_samples: usize,
    /// Mean of the samples at rest.
    pub rest_mean: Option<f64>,
    /// Standard deviation of the noise, declared or estimated, at least that of the quantisation.
    pub noise: f64,
    /// Some values are negative.
    pub below_zero: bool,
}

/// Facts about the sampling of a record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Clock {
    /// Name of the record.
    pub record: String,
    /// Number of samples.
    pub samples: usize,
    /// Samples per second, by the median spacing [1/s].
    pub rate_hz: f64,
    /// Standard deviation of the sample spacing relative to its mean [percent].
    pub jitter_percent: f64,
    /// Number of spacings of more than 1.5 times the median.
    pub gaps: usize,
    /// Time from the first sample to the last [s].
    pub length_s: f64,
}

/// Median; sorts the values.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let (lower, upper) = values.split_at(values.len() / 2);
    match (lower.last(), upper.first()) {
        (Some(below), Some(above)) if lower.len() == upper.len() => 0.5 * (below + above),
        (_, Some(middle)) => *middle,
        (_, None) => 0.0,
    }
}

/// Spacing of the grid on which all values lie, or zero.
pub fn quantisation(values: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    let [first, .., last] = sorted.as_slice() else { return 0.0 };
    let span = last - first;
    let step = sorted.array_windows().map(|[a, b]| b - a).filter(|d| *d > 1e-9 * span).fold(f64::MAX, f64::min);
    // Printed values are rounded, so that spacings are integer multiples only to a few percent of a step.
    let off = |v: f64| {
        let steps = (v - first) / step;
        (steps - libm::round(steps)).abs()
    };
    let on_grid = sorted.iter().filter(|v| off(**v) < 0.1).count();
    if on_grid as f64 > 0.98 * sorted.len() as f64 && span / step < 1e5 { step } else { 0.0 }
}

/// Standard deviation of normal values of mean zero from the median of their squares, which a few large ones do not move: the median of
/// the squares is 0.4549 times their mean.
pub fn deviation_by_median(squares: &mut [f64]) -> f64 {
    libm::sqrt(median(squares) / 0.4549)
}

/// Squares of the fourth differences, over the sum of their squared weights.
fn fourth_differences(values: &[f64]) -> Vec<f64> {
    values
        .array_windows()
        .map(|[a, b, c, d, e]| a - 4.0 * b + 6.0 * c - 4.0 * d + e)
        .filter(|d| d.is_finite())
        .map(|d| d * d / 70.0)
        .collect()
}

/// The correlation over four samples is at least this part of that over one, where what is beside the noise is smooth.
const STAYS: f64 = 0.8;
/// The correlation over one sample is at least this: with less, most of the series would be noise.
const SMOOTH: f64 = 0.5;

/// White noise of a series that is smooth beside it, as the torque of a controller is; 0 where it is not, as with a pseudorandom sequence.
pub fn noise_beside_smooth(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let together = |lag: usize| -> f64 {
        let pairs = values.iter().zip(values.iter().skip(lag)).map(|(a, b)| (a - mean) * (b - mean));
        pairs.filter(|x| x.is_finite()).sum()
    };
    let is_smooth = together(1) >= SMOOTH * together(0) && together(4) >= STAYS * together(1);
    if is_smooth { deviation_by_median(&mut fourth_differences(values)) } else { 0.0 }
}

/// Noise from fourth differences: median over blocks of their mean squares.
pub fn noise(values: &[f64]) -> f64 {
    let squares = fourth_differences(values);
    let block = (squares.len() / 20).clamp(1, 50);
    let mut means: Vec<f64> = squares.chunks(block).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect();
    libm::sqrt(median(&mut means))
}

/// The same of values at any times: fourth divided differences, each over the square root of the sum of its squared weights.
pub fn noise_at_times(points: &[(f64, f64)]) -> f64 {
    let of = |window: &[(f64, f64); 5]| {
        let weight = |own: f64| window.iter().filter(|(t, _)| *t != own).map(|(t, _)| 1.0 / (own - t)).product::<f64>();
        let (sum, squares) = window.iter().fold((0.0, 0.0), |(sum, squares), (t, v)| {
            let w = weight(*t);
            (sum + w * v, squares + w * w)
        });
        sum * sum / squares
    };
    let mut squares: Vec<f64> = points.array_windows().map(of).filter(|d| d.is_finite()).collect();
    deviation_by_median(&mut squares)
}

/// Initial stretch at rest, in which the value stays within a few steps: its length and mean.
fn rest(values: &[f64], band: f64) -> (usize, Option<f64>) {
    let Some(first) = values.iter().copied().find(|v| v.is_finite()) else { return (0, None) };
    let n = values.iter().take_while(|v| (**v - first).abs() <= band).count();
    if n < 8 {
        return (0, None);
    }
    (n, Some(values.iter().take(n).sum::<f64>() / n as f64))
}

/// Facts of one series.
pub fn from_values(record: &str, channel: &str, unit: &str, values: &[f64], declared_noise: Option<f64>) -> Facts {
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let low = finite.iter().copied().fold(f64::MAX, f64::min);
    let high = finite.iter().copied().fold(f64::MIN, f64::max);
    let step = quantisation(&finite);
    let edge = finite.iter().filter(|v| **v == low || **v == high).count();
    // A few values at each end are not clipping.
    let clipped = if edge > 4 + finite.len() / 200 { 100.0 * edge as f64 / finite.len() as f64 } else { 0.0 };
    let (rest_samples, rest_mean) = rest(values, (6.0 * step).max(1e-3 * (high - low)));
    let noise = noise(values).max(step / libm::sqrt(12.0));
    Facts {
        record: record.to_string(),
        channel: channel.to_string(),
        unit: unit.to_string(),
        samples: values.len(),
        missing: values.len() - finite.len(),
        low,
        high,
        quantisation: step,
        clipped_percent: clipped,
        rest_samples,
        rest_mean,
        noise: declared_noise.unwrap_or(noise),
        // Further below zero than a zero offset explains.
        below_zero: low < rest_mean.unwrap_or(0.0).min(0.0) - (6.0 * noise).max(0.02 * (high - low)),
    }
}

/// Facts about the times of samples [s].
pub fn clock(record: &str, t_s: &[f64]) -> Clock {
    let mut steps: Vec<f64> = t_s.array_windows().map(|[a, b]| b - a).collect();
    let n = steps.len().max(1) as f64;
    let mean = steps.iter().sum::<f64>() / n;
    let variance = steps.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / n;
    let middle = median(&mut steps);
    Clock {
        record: record.to_string(),
        samples: t_s.len(),
        rate_hz: if mean > 0.0 { 1.0 / mean } else { 0.0 },
        jitter_percent: if mean > 0.0 { 100.0 * libm::sqrt(variance) / mean } else { 0.0 },
        gaps: steps.iter().filter(|d| **d > 1.5 * middle).count(),
        length_s: t_s.last().copied().unwrap_or(0.0) - t_s.first().copied().unwrap_or(0.0),
    }
}
