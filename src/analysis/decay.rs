//! Decaying swings of a number over time: their frequencies and damping.
//!
//! ```text
//! v(t) = c + sum a_k exp(-d_k t) cos(w_k t + b_k),   zeta = d / sqrt(d^2 + w^2),   log decrement = 2 pi d / w
//! ```
//! The matrix pencil finds the swings of evenly spaced values: the singular values of their Hankel matrix say how many there are, and the
//! eigenvalues of the shift between its singular vectors say which ones (Hua and Sarkar, IEEE Trans. ASSP 38 (1990), 814). Steps of Gauss and Newton
//! then lower the sum of squares that is left, and their Jacobian gives standard errors: those of white noise. Long records are
//! thinned: a low-pass filter runs over them, and every m-th value of its output is taken. A filter of finite length changes the size of an exponential and
//! nothing else; the size is corrected afterwards.

use super::order_spectrum::even;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// Most values of which the matrix is made. assumed: the time of its singular values grows with the cube of their number.
const LARGEST: usize = 600;
/// Fewest values.
const FEWEST: usize = 24;
/// Largest number of swings that is looked for: twice as many are never of use in a table. assumed.
const MOST_SWINGS: usize = 12;
/// Singular values of white noise lie below this multiple of their median, for a matrix twice as high as wide: Gavish and Donoho, IEEE
/// Trans. Information Theory 60 (2014), 5040, table IV at beta = 0.5.
const NOISE_MEDIANS: f64 = 2.17;
/// Singular values below this share of the largest are rounding.
const ROUNDING: f64 = 1e-11;
/// Swings with less than this share of the square of what moves are left out. assumed: they are not seen in a picture.
const LEAST_SHARE: f64 = 1e-4;
/// Sum of the shares of swings from which on they cancel each other. assumed: swings that decay are nearly orthogonal unless they are near.
const CANCELLING: f64 = 1.1;
/// What creeps by less than this, in exponents over all values, is not told from a constant. assumed.
const STILL: f64 = 1e-3;
/// Steps of Gauss and Newton: five are enough where they converge at all.
const STEPS: usize = 8;
/// Share of the square of what moves that may be left of swings: above, the number does not decay as swings do. assumed.
pub const UNEXPLAINED: f64 = 0.1;

/// A swing that dies away, grows or stays.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct DecayingSwing {
    /// w / (2 pi); zero of what creeps to rest without swinging.
    pub frequency_hz: f64,
    pub frequency_error_hz: f64,
    /// d [1/s]; below zero it grows.
    pub decay_rate_per_s: f64,
    pub decay_rate_error_per_s: f64,
    /// zeta; 1 of what does not swing.
    pub damping_ratio: f64,
    pub damping_ratio_error: f64,
    /// Natural logarithm of the ratio of two tops that follow each other; none of what does not swing.
    pub log_decrement: Option<f64>,
    /// At the first value, in its unit.
    pub amplitude: f64,
    /// Its own square over that of all that moves; the shares of swings that are not orthogonal do not sum to one.
    pub share: f64,
}

/// All swings of a stretch of values.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Decay {
    pub swings: Vec<DecayingSwing>,
    /// c.
    pub rest: f64,
    /// Root mean square of what moves: the values less c.
    pub moves_rms: f64,
    /// Share of its square that is left of all swings.
    pub left: f64,
    /// Every m-th value is taken: this is m.
    pub every: usize,
    /// Highest frequency of swings that are shown [Hz].
    pub highest_hz: f64,
    pub values: usize,
    pub from_s: f64,
    pub to_s: f64,
}

/// Why there is no damping.
#[derive(Clone, Debug, PartialEq)]
pub enum DampingError {
    /// Values, and how many are needed.
    Few(usize, usize),
    /// All values are the same.
    Constant,
    /// No swing stands out of noise.
    Noise,
}

/// The swings of values at increasing times; slower ones than `highest_hz` alone where that is given.
///
/// # Errors
/// The values are few, do not change, or are noise.
pub fn decay(times_s: &[f64], values: &[f64], highest_hz: Option<f64>) -> Result<Decay, DampingError> {
    let n = values.len();
    if n < FEWEST {
        return Err(DampingError::Few(n, FEWEST));
    }
    let interval_s = (times_s[n - 1] - times_s[0]) / (n - 1) as f64;
    let evenly = even(times_s, values);
    let asked = highest_hz.map_or(1.0, |hz| PASSED / (hz * interval_s));
    let every = n.div_ceil(LARGEST + FILTER).max(asked as usize).clamp(1, (n / (FEWEST + FILTER + 1)).max(1));
    let filter = LowPass::new(every, interval_s);
    let thinned = filter.thinned(&evenly);
    let mean = thinned.iter().sum::<f64>() / thinned.len() as f64;
    let spread = thinned.iter().fold(0.0, |most: f64, v| most.max((v - mean).abs()));
    if spread <= 1e-13 * mean.abs() {
        return Err(DampingError::Constant);
    }
    let moving: Vec<f64> = thinned.iter().map(|v| v - mean).collect();
    let step_s = interval_s * every as f64;
    let Some(mut fit) = best_fit(DVector::from_vec(moving), step_s) else { return Err(DampingError::Noise) };
    fit.improve();
    let mut found = fit.report(&filter, mean);
    found.highest_hz = highest_hz.map_or(found.highest_hz, |hz| found.highest_hz.min(hz));
    found.swings.retain(|s| s.frequency_hz <= found.highest_hz);
    found.values = n;
    (found.from_s, found.to_s) = (times_s[0], times_s[n - 1]);
    Ok(found)
}

/// Length of the filter over the distance of the values that are taken, and the frequency up to which it passes them unchanged, times that distance: a
/// sinc of a cutoff at 0.8 of half a sample's rate under a Hann window falls by 44 dB from 0.6 to 1.0 of it.
const FILTER: usize = 16;
const CUTOFF: f64 = 0.4;
pub(super) const PASSED: f64 = 0.3;

/// A low-pass filter of finite length; every m-th value of its output is taken, m = `every`.
pub(super) struct LowPass {
    taps: Vec<f64>,
    pub every: usize,
    interval_s: f64,
}

impl LowPass {
    pub fn new(every: usize, interval_s: f64) -> LowPass {
        if every == 1 {
            return LowPass { taps: vec![1.0], every, interval_s };
        }
        let half = (FILTER * every / 2) as f64;
        let tap = |j: usize| {
            let x = j as f64 - half;
            let turn = 2.0 * PI * CUTOFF * x / every as f64;
            let sinc = if turn == 0.0 { 1.0 } else { libm::sin(turn) / turn };
            sinc * 0.5 * (1.0 + libm::cos(PI * x / (half + 1.0)))
        };
        let taps: Vec<f64> = (0..=FILTER * every).map(tap).collect();
        let sum: f64 = taps.iter().sum();
        LowPass { taps: taps.into_iter().map(|t| t / sum).collect(), every, interval_s }
    }

    /// Number of values that make one behind it.
    pub fn len(&self) -> usize {
        self.taps.len()
    }

    pub fn thinned(&self, values: &[f64]) -> Vec<f64> {
        let sum = |part: &[f64]| part.iter().zip(&self.taps).map(|(v, tap)| v * tap).sum();
        values.windows(self.taps.len()).step_by(self.every).map(sum).collect()
    }

    /// Highest frequency of swings that are shown [Hz].
    fn highest_hz(&self) -> f64 {
        if self.every == 1 { 0.5 / self.interval_s } else { PASSED / (self.interval_s * self.every as f64) }
    }

    /// What it leaves of the size of an exponential, at the first of the values that make a value behind it.
    fn factor(&self, pole: Pole) -> f64 {
        let (mut re, mut im) = (0.0, 0.0);
        for (j, tap) in self.taps.iter().enumerate() {
            let t = self.interval_s * j as f64;
            let size = tap * libm::exp(-pole.decay_per_s * t);
            let (s, c) = libm::sincos(pole.rad_s * t);
            (re, im) = (re + size * c, im + size * s);
        }
        libm::hypot(re, im).max(f64::MIN_POSITIVE)
    }
}

/// A pole s = -d + i w, w >= 0.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pole {
    decay_per_s: f64,
    rad_s: f64,
}

/// The fit with as many poles as pay for themselves (Schwarz's criterion, four numbers a swing). None where none stands out of noise.
fn best_fit(values: DVector<f64>, step_s: f64) -> Option<SwingFit> {
    let n = values.len() as f64;
    let mut fit = SwingFit { poles: Vec::new(), step_s, values };
    let mut best: Option<(f64, Vec<Pole>)> = None;
    for poles in pencils(fit.values.as_slice(), step_s) {
        let numbers: usize = poles.iter().map(|p| 2 * width_of(p)).sum();
        fit.poles = poles;
        let Some(solution) = fit.solve() else { continue };
        let left = solution.left.norm_squared().max(f64::MIN_POSITIVE);
        let cost = n * libm::log(left) + numbers as f64 * libm::log(n);
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, std::mem::take(&mut fit.poles)));
        }
    }
    let (_, poles) = best?;
    Some(SwingFit { poles, ..fit })
}

/// Poles of evenly spaced values by the matrix pencil, of one singular vector, of two, and so on up to those of noise.
fn pencils(values: &[f64], step_s: f64) -> Vec<Vec<Pole>> {
    let n = values.len();
    let width = n / 3;
    let hankel = DMatrix::from_fn(n - width, width + 1, |i, j| values[i + j]);
    let svd = hankel.svd(false, true);
    let Some(v_t) = svd.v_t else { return Vec::new() };
    let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    let singular = |k: usize| svd.singular_values[order[k]];
    let least = (NOISE_MEDIANS * singular(order.len() / 2)).max(ROUNDING * singular(0));
    let most = (0..order.len()).take(2 * MOST_SWINGS).take_while(|k| singular(*k) > least).count();
    let of = |count: usize| {
        let v = DMatrix::from_fn(width + 1, count, |i, k| v_t[(order[k], i)]);
        let (early, late) = (v.rows(0, width).into_owned(), v.rows(1, width).into_owned());
        // As in fits: products whose sums have one order on every CPU.
        let shift = early.tr_mul(&early).lu().solve(&early.tr_mul(&late))?;
        let poles: Vec<Pole> =
            shift.complex_eigenvalues().iter().filter_map(|z| pole_of(z.re, z.im, (n, step_s))).collect();
        (!poles.is_empty()).then_some(poles)
    };
    (1..=most).filter_map(of).collect()
}

/// The pole whose exponential changes by this complex factor from one value to the next. None: the mirror of another pole, the constant, or a swing
/// too fast for the distance of the values.
fn pole_of(re: f64, im: f64, (n, step_s): (usize, f64)) -> Option<Pole> {
    let (size, turned) = (libm::hypot(re, im), libm::atan2(im, re));
    // A factor below zero swings from value to value; a pole below the axis is the mirror of one above.
    if size < 1e-6 || !(0.0..=0.98 * PI).contains(&turned) {
        return None;
    }
    // What hardly changes over all values is the constant, which stands beside.
    let decay = -libm::log(size);
    let is_constant = turned == 0.0 && decay.abs() * n as f64 <= STILL;
    (!is_constant).then(|| Pole { decay_per_s: decay / step_s, rad_s: turned / step_s })
}

/// Swings of given poles under values.
struct SwingFit {
    poles: Vec<Pole>,
    step_s: f64,
    values: DVector<f64>,
}

/// What a set of poles makes of the values.
struct SwingSolution {
    /// The constant, then cosine and sine of every pole; the sine of one that does not swing is none.
    amplitudes: Vec<[f64; 2]>,
    rest: f64,
    /// Contribution of every pole to every value.
    parts: Vec<DVector<f64>>,
    left: DVector<f64>,
}

impl SwingFit {
    /// exp(-d t) cos(w t) and exp(-d t) sin(w t) of a pole at value k. A growing swing is scaled to 1 at the last value, so that its numbers stay small.
    fn basis(&self, pole: Pole, k: usize) -> [f64; 2] {
        let t = self.step_s * k as f64;
        let from = if pole.decay_per_s < 0.0 { t - self.step_s * (self.values.len() - 1) as f64 } else { t };
        let size = libm::exp(-pole.decay_per_s * from);
        let (s, c) = libm::sincos(pole.rad_s * t);
        [size * c, size * s]
    }

    fn solve(&self) -> Option<SwingSolution> {
        let n = self.values.len();
        let columns: Vec<(usize, usize)> =
            self.poles.iter().enumerate().flat_map(|(p, pole)| (0..width_of(pole)).map(move |c| (p, c))).collect();
        let mut matrix = DMatrix::from_element(n, 1 + columns.len(), 1.0);
        for (j, (p, c)) in columns.iter().enumerate() {
            for k in 0..n {
                matrix[(k, 1 + j)] = self.basis(self.poles[*p], k)[*c];
            }
        }
        let solution = matrix.clone().svd(true, true).solve(&self.values, 1e-13).ok()?;
        let mut amplitudes = vec![[0.0; 2]; self.poles.len()];
        let mut parts = vec![DVector::zeros(n); self.poles.len()];
        for (j, (p, c)) in columns.iter().enumerate() {
            amplitudes[*p][*c] = solution[1 + j];
            parts[*p] += matrix.column(1 + j) * solution[1 + j];
        }
        let left = &self.values - &matrix * &solution;
        Some(SwingSolution { amplitudes, rest: solution[0], parts, left })
    }

    /// Derivatives of the values by constant, amplitudes, and by decay and frequency of every pole.
    fn jacobian(&self, solution: &SwingSolution) -> DMatrix<f64> {
        let n = self.values.len();
        let widths: usize = self.poles.iter().map(|p| 2 * width_of(p)).sum();
        let mut jacobian = DMatrix::from_element(n, 1 + widths, 1.0);
        let mut at = 1;
        for (pole, [a, b]) in self.poles.iter().zip(&solution.amplitudes) {
            for k in 0..n {
                let [c, s] = self.basis(*pole, k);
                let t = self.step_s * k as f64;
                let row = [-t * (a * c + b * s), t * (b * c - a * s), c, s];
                let kept = if width_of(pole) == 1 { vec![row[0], row[2]] } else { row.to_vec() };
                for (j, v) in kept.into_iter().enumerate() {
                    jacobian[(k, at + j)] = v;
                }
            }
            at += 2 * width_of(pole);
        }
        jacobian
    }

    /// Steps of Gauss and Newton in decays and frequencies, taken as long as they lower what is left.
    fn improve(&mut self) {
        for _ in 0..STEPS {
            let Some(now) = self.solve() else { return };
            let Ok(step) = self.jacobian(&now).svd(true, true).solve(&now.left, 1e-12) else { return };
            let mut tried = self.poles.clone();
            let mut at = 1;
            for pole in &mut tried {
                pole.decay_per_s += step[at];
                if width_of(pole) == 2 {
                    pole.rad_s = (pole.rad_s + step[at + 1]).abs();
                }
                at += 2 * width_of(pole);
            }
            let before = std::mem::replace(&mut self.poles, tried);
            let is_better = self.solve().is_some_and(|s| s.left.norm_squared() < now.left.norm_squared());
            if !is_better {
                self.poles = before;
                return;
            }
        }
    }

    /// Swings with their errors, the largest share first.
    fn report(mut self, filter: &LowPass, mean: f64) -> Decay {
        let n = self.values.len();
        let squares = |of: &SwingFit, rest: f64| of.values.iter().map(|v| (v - rest) * (v - rest)).sum::<f64>();
        let mut solution = self.solve();
        // Two swings cannot be told apart where their frequencies differ by less than one over the recorded time. If they also cancel each other,
        // the smaller one is removed.
        while let Some(s) = &solution {
            let all = squares(&self, s.rest).max(f64::MIN_POSITIVE);
            let Some(drop) = self.cancelling(&s.parts, all) else { break };
            self.poles.remove(drop);
            self.improve();
            solution = self.solve();
        }
        if let Some(s) = &solution {
            let all = squares(&self, s.rest).max(f64::MIN_POSITIVE);
            let kept = self.poles.iter().zip(&s.parts).filter(|(_, part)| part.norm_squared() >= LEAST_SHARE * all);
            let kept: Vec<Pole> = kept.map(|(pole, _)| *pole).collect();
            if kept.len() < self.poles.len() {
                self.poles = kept;
                solution = self.solve();
            }
        }
        let mut found = Decay {
            swings: Vec::new(),
            rest: mean,
            moves_rms: 0.0,
            left: 1.0,
            every: filter.every,
            highest_hz: filter.highest_hz(),
            values: 0,
            from_s: 0.0,
            to_s: 0.0,
        };
        let Some(solution) = solution else { return found };
        let jacobian = self.jacobian(&solution);
        let free = n.saturating_sub(jacobian.ncols()).max(1);
        let variance = solution.left.norm_squared() / free as f64;
        let covariance = jacobian.tr_mul(&jacobian).try_inverse();
        let error = |at: usize| covariance.as_ref().map_or(f64::NAN, |c| libm::sqrt((variance * c[(at, at)]).max(0.0)));
        let all = squares(&self, solution.rest).max(f64::MIN_POSITIVE);
        found.rest = mean + solution.rest;
        found.moves_rms = libm::sqrt(all / n as f64);
        found.left = solution.left.norm_squared() / all;
        let mut at = 1;
        for ((pole, [a, b]), part) in self.poles.iter().zip(&solution.amplitudes).zip(&solution.parts) {
            let is_swing = width_of(pole) == 2;
            let (d, w) = (pole.decay_per_s, pole.rad_s);
            let size = libm::hypot(d, w).max(f64::MIN_POSITIVE);
            let (d_error, w_error) = (error(at), if is_swing { error(at + 1) } else { 0.0 });
            // zeta = d / sqrt(d^2 + w^2): by d it changes as w^2, by w as -d w over the cube of the root.
            let cube = size * size * size;
            found.swings.push(DecayingSwing {
                frequency_hz: w / (2.0 * PI),
                frequency_error_hz: w_error / (2.0 * PI),
                decay_rate_per_s: d,
                decay_rate_error_per_s: d_error,
                damping_ratio: d / size,
                damping_ratio_error: libm::hypot(w * w * d_error, d * w * w_error) / cube,
                log_decrement: is_swing.then(|| 2.0 * PI * d / w),
                amplitude: libm::hypot(*a, *b) / filter.factor(*pole) * self.at_first(*pole),
                share: part.norm_squared() / all,
            });
            at += 2 * width_of(pole);
        }
        found.swings.sort_by(|x, y| y.share.total_cmp(&x.share));
        found
    }

    /// The swing to remove: where the shares of all sum to far more than one, swings cancel each other. It is the smaller one of the nearest pair, if that pair is
    /// nearer than one over the recorded time.
    fn cancelling(&self, parts: &[DVector<f64>], all: f64) -> Option<usize> {
        let shares: Vec<f64> = parts.iter().map(|p| p.norm_squared() / all).collect();
        if shares.iter().sum::<f64>() < CANCELLING {
            return None;
        }
        let apart = |i: usize, j: usize| {
            let (a, b) = (self.poles[i], self.poles[j]);
            libm::hypot(a.decay_per_s - b.decay_per_s, a.rad_s - b.rad_s)
        };
        let pairs = (0..parts.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
        let (i, j) = pairs.min_by(|a, b| apart(a.0, a.1).total_cmp(&apart(b.0, b.1)))?;
        let resolved = 2.0 * PI / (self.step_s * self.values.len() as f64);
        (apart(i, j) < resolved).then_some(if shares[i] < shares[j] { i } else { j })
    }

    /// Size at the first value of a swing whose basis is one where it is largest.
    fn at_first(&self, pole: Pole) -> f64 {
        let [c, s] = self.basis(pole, 0);
        libm::hypot(c, s)
    }
}

/// Numbers of amplitude of a pole: cosine and sine, or one alone where it does not swing.
fn width_of(pole: &Pole) -> usize {
    if pole.rad_s > 0.0 { 2 } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{SplitMix, normal_quantile};

    /// Two swings, a creep and a rest value.
    fn sum(t: f64) -> f64 {
        let swing = |a: f64, hz: f64, zeta: f64, phase: f64| {
            let w = 2.0 * PI * hz;
            let d = zeta * w / (1.0 - zeta * zeta).sqrt();
            a * libm::exp(-d * t) * libm::cos(w * t + phase)
        };
        4.0 + swing(1.0, 130.0, 0.05, 0.3) + swing(0.4, 410.0, 0.012, -1.0) + 0.7 * libm::exp(-t / 0.03)
    }

    #[test]
    fn swings_of_a_sum_are_found_exactly() {
        let times: Vec<f64> = (0..500).map(|k| f64::from(k) * 1e-4).collect();
        let values: Vec<f64> = times.iter().map(|t| sum(*t)).collect();
        let found = decay(&times, &values, None).unwrap();
        println!("{found:#?}");
        assert_eq!(found.swings.len(), 3);
        assert!((found.rest - 4.0).abs() < 1e-6 && found.left < 1e-12);
        let at = |hz: f64| found.swings.iter().find(|s| (s.frequency_hz - hz).abs() < 1.0).unwrap();
        for (hz, zeta, amplitude) in [(130.0, 0.05, 1.0), (410.0, 0.012, 0.4)] {
            let s = at(hz);
            assert!((s.frequency_hz / hz - 1.0).abs() < 1e-6, "{s:?}");
            assert!(
                (s.damping_ratio / zeta - 1.0).abs() < 1e-5 && (s.amplitude / amplitude - 1.0).abs() < 1e-5,
                "{s:?}"
            );
        }
        let creep = at(0.0);
        assert!((creep.decay_rate_per_s * 0.03 - 1.0).abs() < 1e-4 && creep.damping_ratio == 1.0, "{creep:?}");
    }

    /// Twenty times as many values, with times that are not quite even, and a swing that is too fast for those that are taken: the same.
    #[test]
    fn thinning_loses_nothing_but_what_is_fast() {
        let times: Vec<f64> =
            (0..10_000).map(|k| (f64::from(k) + 0.2 * libm::sin(f64::from(k) * 0.1)) * 5e-6).collect();
        let fast = |t: f64| 0.5 * libm::exp(-20.0 * t) * libm::cos(2.0 * PI * 7000.0 * t);
        let values: Vec<f64> = times.iter().map(|t| sum(*t) + fast(*t)).collect();
        let found = decay(&times, &values, None).unwrap();
        println!("every {}: {:#?}", found.every, found.swings);
        let s = found.swings.iter().find(|s| (s.frequency_hz - 130.0).abs() < 1.0).unwrap();
        assert!(found.every == 17 && (s.frequency_hz / 130.0 - 1.0).abs() < 1e-4);
        assert!((s.damping_ratio / 0.05 - 1.0).abs() < 1e-3 && (s.amplitude - 1.0).abs() < 1e-3, "{s:?}");
        // Every 17th value alone would show the fast swing at 11765 - 7000 Hz.
        assert!(found.swings.iter().all(|s| s.frequency_hz < 1000.0));
        // Slower ones alone.
        let slow = decay(&times, &values, Some(300.0)).unwrap();
        println!("every {}: {:#?}", slow.every, slow.swings);
        assert!(slow.highest_hz == 300.0 && slow.every > 17 && slow.swings.iter().all(|s| s.frequency_hz < 200.0));
        let s = slow.swings.iter().find(|s| (s.frequency_hz - 130.0).abs() < 1.0).unwrap();
        assert!((s.damping_ratio / 0.05 - 1.0).abs() < 0.01, "{s:?}");
    }

    /// With white noise of 2 % errors are as large as stated: the mean square of 40 errors over those stated is about one.
    #[test]
    fn stated_errors_hold_under_noise() {
        let mut squares = 0.0;
        for seed in 0..40 {
            let mut random = SplitMix::of(&[seed]);
            let times: Vec<f64> = (0..400).map(|k| f64::from(k) * 2e-4).collect();
            let w = 2.0 * PI * 130.0;
            let values: Vec<f64> = times
                .iter()
                .map(|t| libm::exp(-0.05 * w * t) * libm::sin(w * t) + 0.02 * normal_quantile(random.uniform()))
                .collect();
            let found = decay(&times, &values, None).unwrap();
            let s = &found.swings[0];
            let zeta = 0.05 / (1.0_f64 + 0.05 * 0.05).sqrt();
            assert!((s.damping_ratio / zeta - 1.0).abs() < 0.2, "{s:?}");
            squares += ((s.damping_ratio - zeta) / s.damping_ratio_error).powi(2) / 40.0;
        }
        println!("mean square {squares}");
        assert!((0.5..1.7).contains(&squares), "{squares}");
    }

    #[test]
    fn a_swing_that_grows_is_told() {
        let times: Vec<f64> = (0..200).map(|k| f64::from(k) * 1e-3).collect();
        let values: Vec<f64> = times.iter().map(|t| libm::exp(3.0 * t) * libm::sin(2.0 * PI * 40.0 * t)).collect();
        let found = decay(&times, &values, None).unwrap();
        let s = &found.swings[0];
        assert!((s.decay_rate_per_s + 3.0).abs() < 1e-6 && (s.amplitude - 1.0).abs() < 1e-6, "{s:?}");
    }

    #[test]
    fn what_has_no_damping_is_refused() {
        let times: Vec<f64> = (0..100).map(f64::from).collect();
        assert_eq!(decay(&times, &[3.0; 100], None), Err(DampingError::Constant));
        assert_eq!(decay(&times[..9], &[3.0; 9], None), Err(DampingError::Few(9, FEWEST)));
        let mut random = SplitMix::of(&[3]);
        let noise: Vec<f64> = (0..600).map(|_| normal_quantile(random.uniform())).collect();
        let times: Vec<f64> = (0..600).map(f64::from).collect();
        // The swings that are found explain hardly any of the noise.
        let left = decay(&times, &noise, None).map_or(1.0, |d| d.left);
        println!("noise: {left}");
        assert!(left > 0.8, "{left}");
    }
}
