//! Orders of a number while the speed changes: windows of whole turns of the driver, and the amplitude of every order in each.
//!
//! Without orders given, those are followed at which the mean of all windows has its largest peaks. A window is resampled over the angle as a
//! spectrum is ([`super::order_spectrum`]): an order stays where it is however the speed rises in the window.
//! Its amplitude at an order o is 2 |sum w v exp(-2 pi i o turn)| / sum w with a Hann window w: of a sine alone its own, two orders within
//! [`PERIODS`] over the turns of a window flow together. Windows overlap by half. Order tracking by resampling: Fyfe and Munck 1997.

use super::order_spectrum::{AngleRecord, AngleSpectrum, PERIODS, SpectrumError, even, remove_line};
use std::f64::consts::PI;

/// One order through all windows.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct OrderTrack {
    pub order: f64,
    pub names: Vec<String>,
    pub amplitudes: Vec<f64>,
}

impl OrderTrack {
    /// The window in which it is largest.
    pub fn largest(&self) -> usize {
        (0..self.amplitudes.len()).max_by(|a, b| self.amplitudes[*a].total_cmp(&self.amplitudes[*b])).unwrap_or(0)
    }
}

/// A number's orders over the windows of a record.
#[derive(Clone, Debug)]
pub struct OrderTracks {
    /// Turns of the driver in a window.
    pub window_turns: f64,
    /// Mean speed of the driver in every window [1/s], and its middle [s].
    pub turns_per_s: Vec<f64>,
    pub times_s: Vec<f64>,
    pub tracks: Vec<OrderTrack>,
    /// Amplitudes of every window over orders that are `step` apart, from zero.
    pub spectra: Vec<Vec<f64>>,
    pub step: f64,
    /// Mean of the number in every window.
    pub means: Vec<f64>,
}

/// Values of a spectrum for each resolution of a window.
const PER_RESOLUTION: f64 = 4.0;

/// Tracks of these orders, or where there are none of the `most` largest of the whole record up to `highest`.
///
/// # Errors
/// A window has too few values, or the driver stands still.
pub fn tracks(
    record: &AngleRecord,
    window_turns: f64,
    orders: &[f64],
    (most, highest): (usize, f64),
) -> Result<OrderTracks, SpectrumError> {
    let turns = &record.turns;
    if turns.len() < FEWEST_IN_WINDOW {
        return Err(SpectrumError::Few(turns.len(), FEWEST_IN_WINDOW));
    }
    let forwards = if turns[turns.len() - 1] < turns[0] { -1.0 } else { 1.0 };
    let place = |i: usize| forwards * (turns[i] - turns[0]);
    let long = place(turns.len() - 1);
    if long < 1e-6 {
        return Err(SpectrumError::Still);
    }
    if long < window_turns {
        let needed_s = (window_turns - long) / record.turns_per_s.max(1e-12) + record.interval_s * turns.len() as f64;
        return Err(SpectrumError::Short { turns: long, needed: window_turns, needed_s });
    }
    let step = 1.0 / (window_turns * PER_RESOLUTION);
    let mut found = OrderTracks {
        window_turns,
        turns_per_s: Vec::new(),
        times_s: Vec::new(),
        tracks: Vec::new(),
        spectra: Vec::new(),
        step,
        means: Vec::new(),
    };
    let mut prepared = Vec::new();
    let windows = ((long / window_turns - 1.0) / 0.5 + 1e-9) as usize + 1;
    for k in 0..windows {
        let (from, to) = (0.5 * window_turns * k as f64, 0.5 * window_turns * (k as f64 + 2.0));
        let first = (0..turns.len()).position(|i| place(i) >= from).unwrap_or(0);
        let last = (0..turns.len()).rposition(|i| place(i) <= to).unwrap_or(0);
        let n = (last + 1).saturating_sub(first);
        if n < FEWEST_IN_WINDOW {
            return Err(SpectrumError::Few(n, FEWEST_IN_WINDOW));
        }
        let own: Vec<f64> = (first..=last).map(place).collect();
        let mut values = even(&own, &record.values[first..=last]);
        let mean = remove_line(&mut values);
        let distance = (own[n - 1] - own[0]) / (n - 1) as f64;
        let sum: f64 = (0..n).map(|i| hann(i, n)).sum();
        values.iter_mut().enumerate().for_each(|(i, v)| *v *= 2.0 / sum * hann(i, n));
        let window = AngleWindow { weighted: values, distance };
        let top = highest.min(0.5 / distance);
        found.spectra.push((0..=(top / step) as usize).map(|i| window.amplitude(i as f64 * step)).collect());
        prepared.push(window);
        let time_s = record.times_s[last] - record.times_s[first];
        found.turns_per_s.push((own[n - 1] - own[0]) / time_s.max(1e-12));
        found.times_s.push(0.5 * (record.times_s[last] + record.times_s[first]));
        found.means.push(mean);
    }
    // Named with what a window tells apart.
    let naming = AngleSpectrum { turns: window_turns, ..AngleSpectrum::default() };
    let orders = if orders.is_empty() { found.largest_orders(most) } else { orders.to_vec() };
    let track = |order: f64| OrderTrack {
        order,
        names: naming.names_of(order, record),
        amplitudes: prepared.iter().map(|window| window.amplitude(order)).collect(),
    };
    found.tracks = orders.into_iter().map(track).collect();
    Ok(found)
}

fn hann(i: usize, n: usize) -> f64 {
    0.5 * (1.0 - libm::cos(2.0 * PI * (i as f64 + 0.5) / n as f64))
}

/// A window of a record.
struct AngleWindow {
    /// Values at even angles times their weights; amplitudes are sums of them.
    weighted: Vec<f64>,
    /// Between two values [turns].
    distance: f64,
}

impl AngleWindow {
    /// One sine and cosine for each value: exact at any order.
    fn amplitude(&self, order: f64) -> f64 {
        let (mut re, mut im) = (0.0, 0.0);
        for (i, v) in self.weighted.iter().enumerate() {
            let (s, c) = libm::sincos(2.0 * PI * order * self.distance * i as f64);
            (re, im) = (re + v * c, im - v * s);
        }
        libm::hypot(re, im)
    }
}

impl OrderTracks {
    /// Orders at which the mean of all windows has its largest peaks, the smallest first.
    fn largest_orders(&self, most: usize) -> Vec<f64> {
        let n = self.spectra.iter().map(Vec::len).min().unwrap_or(0);
        let mean: Vec<f64> = (0..n).map(|i| self.spectra.iter().map(|s| s[i]).sum::<f64>()).collect();
        // What a window cannot tell from its mean is no order of it.
        let first = ((PERIODS * PER_RESOLUTION) as usize).max(1);
        let mut tops: Vec<usize> =
            (first..n.saturating_sub(1)).filter(|k| mean[*k] > mean[k - 1] && mean[*k] >= mean[k + 1]).collect();
        tops.sort_by(|a, b| mean[*b].total_cmp(&mean[*a]));
        tops.truncate(most);
        let place = |k: usize| {
            let [before, here, after] = [k - 1, k, k + 1].map(|k| libm::log(mean[k].max(1e-300)));
            let bend = before - 2.0 * here + after;
            let shift = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
            (k as f64 + shift) * self.step
        };
        let mut orders: Vec<f64> = tops.into_iter().map(place).collect();
        orders.sort_by(f64::total_cmp);
        orders
    }
}

/// Fewest values of a window.
const FEWEST_IN_WINDOW: usize = 32;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::order_spectrum::{OrderBase, OrderKind};

    /// A run up from 20 to 80 turns a second with order 3, whose size is that of a resonance at 150 Hz, and order 5.5 of a constant size.
    #[test]
    fn a_resonance_is_found_at_its_speed() {
        let (resonance_hz, zeta) = (150.0, 0.02);
        let response = |hz: f64| {
            let r = hz / resonance_hz;
            1.0 / libm::hypot(1.0 - r * r, 2.0 * zeta * r)
        };
        let mut record = AngleRecord { interval_s: 1e-4, ..AngleRecord::default() };
        for i in 0..40_000 {
            let t = f64::from(i) * 1e-4;
            let (turns, turns_per_s) = (20.0 * t + 0.5 * 15.0 * t * t, 20.0 + 15.0 * t);
            let three = response(3.0 * turns_per_s) * libm::sin(2.0 * PI * 3.0 * turns);
            let other = 0.5 * libm::sin(2.0 * PI * 5.5 * turns + 1.0);
            record.turns.push(turns);
            record.times_s.push(t);
            record.values.push(7.0 + three + other);
        }
        record.turns_per_s = 50.0;
        record.bases = vec![OrderBase { name: "crank".into(), order: 1.0, kind: OrderKind::Sprocket }];
        let found = tracks(&record, 4.0, &[3.0, 5.5], (8, 20.0)).unwrap();
        let [three, other] = &found.tracks[..] else { panic!("{:?}", found.tracks.len()) };
        let at = three.largest();
        let hz = 3.0 * found.turns_per_s[at];
        println!("largest {:.3} at {hz:.2} Hz of {} windows", three.amplitudes[at], found.turns_per_s.len());
        assert!((hz / resonance_hz - 1.0).abs() < 0.02, "{hz}");
        // Far from the resonance a window shows what the response is at its speed.
        for k in [2, found.turns_per_s.len() - 3] {
            let expected = response(3.0 * found.turns_per_s[k]);
            assert!((three.amplitudes[k] / expected - 1.0).abs() < 0.02, "{} {expected}", three.amplitudes[k]);
        }
        for (k, amplitude) in other.amplitudes.iter().enumerate() {
            assert!((amplitude / 0.5 - 1.0).abs() < 0.03, "window {k}: {amplitude}");
        }
        assert_eq!(three.names, ["3 x crank"]);
        // Without orders the largest ones are found.
        let found = tracks(&record, 4.0, &[], (2, 20.0)).unwrap();
        let orders: Vec<f64> = found.tracks.iter().map(|t| (t.order * 10.0).round() / 10.0).collect();
        assert_eq!(orders, [3.0, 5.5]);
    }

    #[test]
    fn too_short_a_record_says_how_long_it_must_be() {
        let n = 400;
        let of = |f: &dyn Fn(f64) -> f64| (0..n).map(|i| f(f64::from(i))).collect::<Vec<f64>>();
        let record = AngleRecord {
            turns: of(&|i| i * 0.005),
            times_s: of(&|i| i * 1e-4),
            values: of(&|i| i),
            turns_per_s: 50.0,
            interval_s: 1e-4,
            ..AngleRecord::default()
        };
        assert!(
            matches!(tracks(&record, 4.0, &[], (4, 10.0)), Err(SpectrumError::Short { needed, .. }) if needed == 4.0)
        );
    }
}
