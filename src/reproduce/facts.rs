//! What is kept of a signal: its size, its orders with their surroundings, phases of the low ones, the largest peaks.

use crate::analysis::order_spectrum::{AngleRecord, spectrum};
use crate::statistics::median;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Highest order that is kept; half orders are too.
pub const HIGHEST_ORDER: usize = 60;
/// Phases are kept up to this order.
const PHASES_TO: usize = 12;
/// Peaks that are kept.
const PEAKS: usize = 30;

/// Facts of a signal.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SignalFacts {
    pub n: usize,
    pub mean: f64,
    /// About the mean.
    pub rms: f64,
    pub low: f64,
    pub high: f64,
    /// Amplitudes at orders 0, 0.5, 1, ...
    pub orders: Vec<f64>,
    /// Medians of the amplitudes within one order of each.
    pub floors: Vec<f64>,
    /// Phases of cosines at orders 0, 0.5, ... over the angle of the driver [rad].
    pub phases: Vec<f64>,
    /// Largest peaks: frequency at the mean speed [Hz], amplitude.
    pub peaks: Vec<(f64, f64)>,
}

impl SignalFacts {
    /// Computes them from a signal over the angle of the driver.
    pub fn of(record: &AngleRecord) -> SignalFacts {
        let values = &record.values;
        let n = values.len();
        let mean = values.iter().sum::<f64>() / n.max(1) as f64;
        let rms = libm::sqrt(values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n.max(1) as f64);
        let mut facts = SignalFacts {
            n,
            mean,
            rms,
            low: finite(values.iter().copied().fold(f64::INFINITY, f64::min)),
            high: finite(values.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
            ..SignalFacts::default()
        };
        let Ok(found) = spectrum(record) else { return facts };
        for half in 0..=2 * HIGHEST_ORDER {
            let order = 0.5 * half as f64;
            facts.orders.push(found.near(order));
            let index = |o: f64| (o.max(0.0) / found.step) as usize;
            let around = found.amplitudes.get(index(order - 1.0)..(index(order + 1.0) + 1).min(found.amplitudes.len()));
            facts.floors.push(finite(median(around.unwrap_or_default().iter().copied())));
        }
        facts.phases = (0..=2 * PHASES_TO).map(|half| phase(record, 0.5 * half as f64, mean)).collect();
        facts.peaks = found.peaks.iter().take(PEAKS).map(|p| (p.frequency_hz, p.amplitude)).collect();
        facts
    }

    fn at(list: &[f64], order: f64) -> f64 {
        list.get((2.0 * order).round() as usize).copied().unwrap_or(f64::NAN)
    }

    /// Amplitude of a whole or half order.
    pub fn order(&self, order: f64) -> f64 {
        SignalFacts::at(&self.orders, order)
    }

    /// How far an order stands over what is around it [dB].
    pub fn over_floor_db(&self, order: f64) -> f64 {
        20.0 * libm::log10(self.order(order) / SignalFacts::at(&self.floors, order))
    }

    /// Phase of an order [rad].
    pub fn phase(&self, order: f64) -> f64 {
        SignalFacts::at(&self.phases, order)
    }

    pub fn peak_to_peak(&self) -> f64 {
        self.high - self.low
    }
}

/// A number that can be written as JSON: 0 for what is none.
fn finite(x: f64) -> f64 {
    if x.is_finite() { x } else { 0.0 }
}

/// Phase of a cosine of this order over the angle of the driver, with a Hann window.
fn phase(record: &AngleRecord, order: f64, mean: f64) -> f64 {
    let n = record.values.len();
    let (mut re, mut im) = (0.0, 0.0);
    for (i, (turn, value)) in record.turns.iter().zip(&record.values).enumerate() {
        let window = 0.5 * (1.0 - libm::cos(2.0 * PI * (i as f64 + 0.5) / n as f64));
        let (s, c) = libm::sincos(2.0 * PI * order * turn);
        re += window * (value - mean) * c;
        im -= window * (value - mean) * s;
    }
    libm::atan2(im, re)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cosine of a known order beside an offset: its mean, its amplitude and its phase.
    #[test]
    fn facts_of_a_sine_are_its_own() {
        let mut record = AngleRecord::default();
        for i in 0..40_000 {
            let t = 1e-4 * f64::from(i);
            let turns = 50.0 * t;
            record.times_s.push(t);
            record.turns.push(turns);
            record.values.push(3.0 + 0.7 * libm::cos(2.0 * PI * 1.5 * turns + 0.4));
        }
        record.turns_per_s = 50.0;
        let facts = SignalFacts::of(&record);
        assert!((facts.mean - 3.0).abs() < 1e-3 && (facts.order(1.5) - 0.7).abs() < 1e-3, "{facts:?}");
        assert!((facts.phase(1.5) - 0.4).abs() < 1e-3 && facts.over_floor_db(1.5) > 40.0);
    }
}
