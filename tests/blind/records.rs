//! Random records: inputs, speeds, lengths.

use super::machine::{Kind, Machine, Wish};
use super::numbers::{Random, mean, rms};
use std::f64::consts::PI;

/// A record without the machine.
#[derive(Clone, Debug)]
pub(super) struct Record {
    pub(super) judges: bool,
    /// Samples before it, and in it.
    pub(super) lead: usize,
    pub(super) n: usize,
    /// True time between samples: the recorder's clock has an error.
    pub(super) step_s: f64,
    /// The input at every sample from the start of the lead on: torque in its column's unit, or the driver's speed.
    pub(super) input: Vec<f64>,
    /// Initial angles for effects that are fixed in angle.
    pub(super) angle0: [f64; 2],
    pub(super) v0: [f64; 2],
    /// For causes outside the catalogue: a load, a switch, a position and its width.
    pub(super) walk: Vec<f64>,
    pub(super) gate: Vec<f64>,
    pub(super) bump: [f64; 2],
}

pub(super) fn records(m: &Machine, wish: Wish, random: &mut Random) -> Vec<Record> {
    let clock = random.between(-1e-4, 1e-4);
    let step_s = 1.0 / (m.rate_hz * (1.0 + clock));
    // Tooth frequencies relative to the sampling rate; the held-out records have another speed.
    let mut paces = [random.between(0.07, 0.1), random.between(0.13, 0.16), random.between(0.1, 0.13)];
    if random.chance(0.5) {
        paces.swap(0, 2);
    }
    let few = if wish.one_speed { 1 } else { 3 };
    (0..few)
        .map(|k| {
            let lead = 60 + random.below(120);
            let least = if m.kind == Kind::Chain { 900 } else { 600 };
            let n = if wish.one_speed { 1500 } else { least + random.below(1501 - least) };
            let count = lead + n + 1;
            let input = match m.kind {
                Kind::Chain => speeds(m, wish, paces[k] / 0.11 * m.speed, count, random),
                _ => torques(m, wish, count, random),
            };
            let v0 = match (m.kind, wish.one_way) {
                (Kind::Chain, _) => [input[0], input[0] * m.radius[0] / m.radius[1]],
                (_, true) => [m.speed; 2],
                _ => [0.3 * m.speed * random.between(-1.0, 1.0); 2],
            };
            let (walk, gate) = (random_walk(count, random), telegraph(count, random));
            let angle0 = [random.between(0.0, 2.0 * PI), random.between(0.0, 2.0 * PI)];
            Record { judges: k == 2, lead, n, step_s, input, angle0, v0, walk, gate, bump: [0.0, 1.0] }
        })
        .collect()
}

/// Steps of random height and length in both directions, and a swept sine.
fn torques(m: &Machine, wish: Wish, count: usize, random: &mut Random) -> Vec<f64> {
    let strength = m.torque / m.gain * random.between(0.7, 1.3);
    let bias = match (wish.one_way, wish.biased) {
        (true, _) => 1.3,
        (_, true) => random.between(0.4, 0.9),
        _ => 0.15 * random.between(-1.0, 1.0),
    };
    let height = if wish.one_way { 0.5 } else { 1.0 };
    let sweep = height * random.between(0.2, 0.5);
    let (mut level, mut left) = (0.0_f64, 0);
    let (mut phase, ratio) = (random.between(0.0, 2.0 * PI), count as f64 / 24.0);
    (0..count)
        .map(|i| {
            if left == 0 {
                // It usually reverses.
                let sign = if random.chance(0.7) { -level.signum() } else { level.signum() };
                level = sign * random.between(0.2, 1.0);
                left = 20 + random.below(130);
            }
            left -= 1;
            // From two periods in the record to a twelfth of the sampling rate.
            phase += 2.0 * PI * 2.0 / count as f64 * ratio.powf(i as f64 / count as f64);
            strength * (bias + height * level + sweep * phase.sin())
        })
        .collect()
}

/// A driver's speed that changes slowly, with a vibration from low to high frequency.
pub(super) fn speeds(m: &Machine, wish: Wish, middle: f64, count: usize, random: &mut Random) -> Vec<f64> {
    if wish.one_speed {
        return vec![middle; count];
    }
    let period = count as f64 * random.between(0.5, 1.3);
    let (start, swing) = (random.between(0.0, 2.0 * PI), random.between(0.08, 0.18));
    let (hum, mut phase) = (random.between(0.003, 0.01), 0.0_f64);
    // With little damping a smaller vibration shows the resonance.
    let hum = hum * (m.damping / m.stiffness * m.rate_hz).clamp(0.3, 1.0);
    (0..count)
        .map(|i| {
            let share = i as f64 / count as f64;
            phase += 2.0 * PI * 0.01 * 12.0_f64.powf(share);
            middle * (1.0 + swing * (2.0 * PI * i as f64 / period + start).sin() + hum * phase.sin())
        })
        .collect()
}

/// A random walk of mean square one over its length.
pub(super) fn random_walk(count: usize, random: &mut Random) -> Vec<f64> {
    let mut at = 0.0;
    let mut walk: Vec<f64> = (0..count)
        .map(|_| {
            at += random.normal();
            at
        })
        .collect();
    let middle = mean(&walk);
    walk.iter_mut().for_each(|w| *w -= middle);
    let size = rms(&walk).max(1e-12);
    walk.iter_mut().for_each(|w| *w /= size);
    walk
}

/// On and off for random times.
fn telegraph(count: usize, random: &mut Random) -> Vec<f64> {
    let (mut on, mut left) = (0.0, 0);
    (0..count)
        .map(|_| {
            if left == 0 {
                on = 1.0 - on;
                left = 15 + random.below(120);
            }
            left -= 1;
            on
        })
        .collect()
}
