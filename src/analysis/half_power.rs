//! Damping from the width of a resonance peak.
//!
//! ```text
//! zeta = (f2 - f1) / (2 f_n),   f1 and f2: where the amplitude beside its peak at f_n is 1/sqrt(2) of it
//! ```
//! The amplitude over the frequency comes from an order that a run-up takes through the resonance ([`super::order_tracks`]). The force of that order must
//! not change much in size meanwhile. Other excitation makes the curve rough. So f1 and f2 are those of the response of one swing, for which 1/A^2 is a
//! parabola of the frequency; the parabola is fitted to all windows down to half of the top. Windows widen the peak, and so does a fast run-up:
//! [`HalfPower::doubts`] tells either.

use super::order_tracks::{OrderTrack, OrderTracks};
use nalgebra::{Matrix3, Vector3};

/// A resonance by the width of its peak.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct HalfPower {
    pub frequency_hz: f64,
    pub amplitude: f64,
    /// f1 and f2.
    pub between_hz: [f64; 2],
    pub damping_ratio: f64,
    /// Standard error: what windows that differ from the peak of one swing leave open; no number where they are too few.
    pub damping_ratio_error: f64,
    /// Windows that lie between them.
    pub points: usize,
    /// Time that a window takes at the peak [s], and how fast the frequency changes there [Hz/s].
    pub window_s: f64,
    pub sweep_hz_per_s: f64,
}

/// Points of an amplitude over a frequency that changes with time.
#[derive(Clone, Copy, Debug)]
pub struct ResponsePoint {
    pub time_s: f64,
    pub hz: f64,
    pub amplitude: f64,
    pub window_s: f64,
}

/// The amplitude of an order over its frequency, window by window.
pub fn response(found: &OrderTracks, track: &OrderTrack) -> Vec<ResponsePoint> {
    let windows = found.times_s.iter().zip(&found.turns_per_s).zip(&track.amplitudes);
    let point = |((time_s, turns_per_s), amplitude): ((&f64, &f64), &f64)| ResponsePoint {
        time_s: *time_s,
        hz: track.order * turns_per_s,
        amplitude: *amplitude,
        window_s: found.window_turns / turns_per_s.max(1e-12),
    };
    windows.map(point).collect()
}

/// Why a peak has no width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoWidth {
    /// Points, and how many are needed.
    Few(usize),
    /// The amplitude is largest at the first or last point, at this frequency: the resonance is not passed.
    AtEnd(f64),
    /// On one side of the peak at this frequency it does not fall to 1/sqrt(2), or there is no single peak.
    Overlaps(f64),
}

/// Points of a peak reach down to this share of its top: where the square of one swing's response is a quarter of its largest.
const FLANK: f64 = 0.5;
/// Hann windows that overlap by half share a sixth of white noise, so that a mean over many varies by so much more than one of as many that share
/// nothing: 1 + 2/6 (Harris 1978).
const OVERLAP: f64 = 4.0 / 3.0;
/// Fewest points of a peak.
const FEWEST_POINTS: usize = 5;

/// 1/A^2 = least + bend (f - top)^2: the response of one swing near its resonance.
#[derive(Clone, Copy, Debug)]
struct Resonance {
    top_hz: f64,
    least: f64,
    bend: f64,
}

impl Resonance {
    /// From the coefficients of 1, x and x^2, x = f - `about_hz`.
    fn of(coefficients: &Vector3<f64>, about_hz: f64) -> Option<Resonance> {
        let [constant, slope, bend] = [coefficients[0], coefficients[1], coefficients[2]];
        let least = constant - 0.25 * slope * slope / bend;
        (bend > 0.0 && least > 0.0).then(|| Resonance { top_hz: about_hz - 0.5 * slope / bend, least, bend })
    }

    /// Half the distance of f1 and f2.
    fn half_width_hz(&self) -> f64 {
        libm::sqrt(self.least / self.bend)
    }

    /// Through points by least squares of the relative errors of A^2, with the covariance of the coefficients about `about_hz`.
    fn through(points: &[ResponsePoint], about_hz: f64) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let row = |p: &ResponsePoint| {
            let x = p.hz - about_hz;
            Vector3::new(1.0, x, x * x) * (p.amplitude * p.amplitude)
        };
        let squares: Matrix3<f64> = points.iter().map(|p| row(p) * row(p).transpose()).sum();
        let right: Vector3<f64> = points.iter().map(row).sum();
        // Columns of like size, whatever the units.
        let scale = Matrix3::from_diagonal(&squares.diagonal().map(|d| 1.0 / libm::sqrt(d.max(f64::MIN_POSITIVE))));
        let inverse = scale * (scale * squares * scale).try_inverse()? * scale;
        let coefficients = inverse * right;
        let left: f64 = points.iter().map(|p| (row(p).dot(&coefficients) - 1.0).powi(2)).sum();
        let free = points.len() as f64 - 3.0;
        let variance = if free > 0.0 { OVERLAP * left / free } else { f64::NAN };
        Some((coefficients, inverse * variance))
    }
}

impl HalfPower {
    /// The largest peak of a response.
    ///
    /// # Errors
    /// There is no peak, or it is not alone.
    pub fn of(points: &[ResponsePoint]) -> Result<HalfPower, NoWidth> {
        if points.len() < FEWEST_POINTS {
            return Err(NoWidth::Few(points.len()));
        }
        let by_size = |a: &usize, b: &usize| points[*a].amplitude.total_cmp(&points[*b].amplitude);
        let top = (0..points.len()).max_by(by_size).unwrap_or(0);
        if top == 0 || top + 1 == points.len() {
            return Err(NoWidth::AtEnd(points[top].hz));
        }
        let about_hz = points[top].hz;
        // As far as it does not fall below its flank for two points on end.
        let is_low = |k: usize| points[k].amplitude < FLANK * points[top].amplitude;
        let from = (1..top).rev().find(|k| is_low(*k) && is_low(k - 1)).map_or(0, |k| k + 1);
        let to = (top + 1..points.len() - 1).find(|k| is_low(*k) && is_low(k + 1)).unwrap_or(points.len());
        let mut chosen = points[from..to].to_vec();
        let mut found = None;
        for _ in 0..4 {
            let Some((coefficients, covariance)) = Resonance::through(&chosen, about_hz) else { break };
            let Some(resonance) = Resonance::of(&coefficients, about_hz) else { break };
            found = Some((resonance, coefficients, covariance));
            let reach_hz = resonance.half_width_hz() * libm::sqrt(1.0 / (FLANK * FLANK) - 1.0);
            let near = |p: &&ResponsePoint| (p.hz - resonance.top_hz).abs() <= reach_hz;
            let next: Vec<ResponsePoint> = points.iter().filter(near).copied().collect();
            if next.len() < FEWEST_POINTS || next.len() == chosen.len() {
                break;
            }
            chosen = next;
        }
        let Some((resonance, coefficients, covariance)) = found else { return Err(NoWidth::Overlaps(about_hz)) };
        let (top_hz, half_hz) = (resonance.top_hz, resonance.half_width_hz());
        let between_hz = [top_hz - half_hz, top_hz + half_hz];
        let lies_outside = |hz: f64| points.iter().all(|p| p.hz > hz) || points.iter().all(|p| p.hz < hz);
        if lies_outside(top_hz) {
            return Err(NoWidth::AtEnd(about_hz));
        }
        if between_hz.iter().any(|hz| lies_outside(*hz)) {
            return Err(NoWidth::Overlaps(top_hz));
        }
        // How the ratio changes with the coefficients, by differences.
        let ratio = |c: &Vector3<f64>| Resonance::of(c, about_hz).map_or(f64::NAN, |r| r.half_width_hz() / r.top_hz);
        let slope = Vector3::from_fn(|i, _| {
            let error = libm::sqrt(covariance[(i, i)]);
            let step = 1e-5 * if error.is_nan() { coefficients[i].abs() } else { coefficients[i].abs().max(error) };
            let mut moved = coefficients;
            moved[i] += step;
            (ratio(&moved) - ratio(&coefficients)) / step
        });
        let time_s = points[top + 1].time_s - points[top - 1].time_s;
        Ok(HalfPower {
            frequency_hz: top_hz,
            amplitude: libm::sqrt(1.0 / resonance.least),
            between_hz,
            damping_ratio: half_hz / top_hz,
            damping_ratio_error: libm::sqrt(slope.dot(&(covariance * slope))),
            points: points.iter().filter(|p| (between_hz[0]..=between_hz[1]).contains(&p.hz)).count(),
            window_s: points[top].window_s,
            sweep_hz_per_s: (points[top + 1].hz - points[top - 1].hz).abs() / time_s.max(1e-12),
        })
    }

    /// Why the ratio may be too large or too small, a sentence each.
    pub fn doubts(&self) -> Vec<String> {
        let width_hz = self.between_hz[1] - self.between_hz[0];
        let mut doubts = Vec::new();
        let slowest_hz_s = SWEEP_LIMIT * width_hz * width_hz;
        if self.sweep_hz_per_s > slowest_hz_s {
            doubts.push(format!(
                "the run-up takes the order through its peak at {:.1} Hz/s: a peak {width_hz:.2} Hz wide needs {slowest_hz_s:.1} Hz/s or slower",
                self.sweep_hz_per_s
            ));
        }
        let swept_hz = self.sweep_hz_per_s * self.window_s;
        if swept_hz > SWEPT_SHARE * width_hz {
            doubts.push(format!(
                "within a window the frequency changes by {swept_hz:.2} Hz, and the peak is {width_hz:.2} Hz wide: take a shorter window or a slower run-up"
            ));
        }
        if self.points < 3 {
            doubts.push(format!("{} windows lie within the width: take a slower run-up", self.points));
        }
        doubts
    }
}

/// Largest speed of a sweep, by the square of the width of the peak, and largest share of the width that a window may sweep: within both, the
/// test below finds the ratio of one swing 4 % off at most.
const SWEEP_LIMIT: f64 = 0.2;
const SWEPT_SHARE: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::order_spectrum::AngleRecord;
    use crate::analysis::order_tracks::tracks;
    use std::f64::consts::PI;

    /// One swing of 130 Hz driven by order 3 of a run-up: the half power finds its ratio where nothing is in doubt.
    #[test]
    fn half_power_of_a_run_up() {
        for (zeta, hz_per_s, bound) in [(0.05, 20.0, 0.03), (0.025, 8.0, 0.03), (0.05, 33.0, 0.04)] {
            let record = run_up(130.0, zeta, hz_per_s);
            let found = tracks(&record, 3.0, &[3.0], (1, 20.0)).unwrap();
            let points: Vec<ResponsePoint> = response(&found, &found.tracks[0]);
            let half = HalfPower::of(&points).unwrap();
            println!("zeta {zeta}, {hz_per_s} Hz/s: {half:?} {:?}", half.doubts());
            assert!(half.doubts().is_empty());
            assert!((half.damping_ratio / zeta - 1.0).abs() < bound, "{half:?}");
            assert!((half.frequency_hz / 130.0 - 1.0).abs() < 0.01);
        }
        // Faster it is in doubt, and wrong.
        for (zeta, hz_per_s, least) in [(0.05, 60.0, 0.0515), (0.01, 200.0, 0.02)] {
            let record = run_up(130.0, zeta, hz_per_s);
            let found = tracks(&record, 3.0, &[3.0], (1, 20.0)).unwrap();
            let half = HalfPower::of(&response(&found, &found.tracks[0])).unwrap();
            println!("{half:?} {:?}", half.doubts());
            assert!(!half.doubts().is_empty() && half.damping_ratio > least);
        }
    }

    /// x'' + 2 zeta w x' + w^2 x = w^2 sin(2 pi order turns) from 90 to 170 Hz of order 3, by Verlet's scheme at 20 steps a value.
    fn run_up(hz: f64, zeta: f64, hz_per_s: f64) -> AngleRecord {
        let (w, step_s) = (2.0 * PI * hz, 2e-4);
        let mut record = AngleRecord { interval_s: step_s, ..AngleRecord::default() };
        let (mut x, mut v, mut t) = (0.0_f64, 0.0_f64, 0.0_f64);
        let parts = 20;
        let turns_at = |t: f64| (90.0 * t + 0.5 * hz_per_s * t * t) / 3.0;
        while 90.0 + hz_per_s * t < 170.0 {
            record.turns.push(turns_at(t));
            record.times_s.push(t);
            record.values.push(x);
            for k in 0..parts {
                let h = step_s / f64::from(parts);
                let force = w * w * libm::sin(2.0 * PI * 3.0 * turns_at(t + (f64::from(k) + 0.5) * h));
                let half = v + 0.5 * h * (force - w * w * x - 2.0 * zeta * w * v);
                x += h * half;
                v = (half + 0.5 * h * (force - w * w * x)) / (1.0 + h * zeta * w);
            }
            t += step_s;
        }
        record.turns_per_s = 130.0 / 3.0;
        record
    }

    #[test]
    fn a_resonance_that_is_not_passed_has_no_width() {
        let of = |peak: f64| -> Vec<ResponsePoint> {
            let point = |k: u32| {
                let hz = f64::from(k);
                ResponsePoint {
                    time_s: hz,
                    hz,
                    amplitude: 1.0 / (1.0 + (hz - peak).powi(2) / 9.0).sqrt(),
                    window_s: 0.1,
                }
            };
            (0..50).map(point).collect()
        };
        assert_eq!(HalfPower::of(&of(60.0)), Err(NoWidth::AtEnd(49.0)));
        assert!(matches!(HalfPower::of(&of(48.4)), Err(NoWidth::Overlaps(_) | NoWidth::AtEnd(_))));
        assert_eq!(HalfPower::of(&of(60.0)[..3]), Err(NoWidth::Few(3)));
        let half = HalfPower::of(&of(25.0)).unwrap();
        assert!((half.damping_ratio - 0.12).abs() < 1e-9, "{half:?}");
    }
}
