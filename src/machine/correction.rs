//! How measured motions correct a run, so that it predicts: the gains of a steady Kalman filter for a force that nobody measures, constant
//! over a sample and independent from one to the next.
//!
//! ```text
//! x(i+1) = F x(i) + G a(i)        x = (angle, speed)   F = [1 h; 0 1]   G = (h^2 / 2, h)        x += K (y - x)
//! one sensor, of speed:           K = (h (1 - s / 2), s)
//! one sensor, of angle:           K = (s, (2 (2 - s) - 4 sqrt(1 - s)) / h)
//! both:                           P = F (P^-1 + R^-1)^-1 F' + G G' var(a)      K = P (P + R)^-1
//! ```
//! The share s is what the correction takes of a difference. Where both an angle and a speed are shown, it belongs to the speed alone, and sets
//! the force: var(a) h^2 = s^2 / (1 - s) r, r the variance of the speed's noise. Sources: Kalata, The Tracking Index, IEEE Trans.
//! Aerospace and Electronic Systems 20, 1984; the equation of P is solved by doubling: Chu, Fan, Lin and Wang, Structure-preserving algorithms for
//! periodic discrete-time algebraic Riccati equations, Int. J. Control 77, 2004.

use super::forces::PreparedMachine;
use super::{BodyMotion, Reads};

/// Measured series that correct a run at every sample. The run then predicts the next sample from those before it, and forgets what it did not
/// know: noise of a measured force, feedback, drift.
#[derive(Clone, Copy, Debug)]
pub struct Observed<'a> {
    /// Share of the difference between measured and predicted that the state takes at each sample.
    pub share: f64,
    /// Indices of the sensors that were measured.
    pub sensors: &'a [usize],
    /// Standard deviation of the noise of each of these sensors, in its readings.
    pub noise: &'a [f64],
    /// One series for each of these sensors, at the samples; missing: NaN.
    pub measured: &'a [Vec<f64>],
}

/// Share of a difference in angle that the speed takes over a sample, where the angle takes `share` (Kalata 1984).
pub fn speed_share(share: f64) -> f64 {
    2.0 * (2.0 - share) - 4.0 * libm::sqrt(1.0 - share)
}

/// A matrix of two rows.
type Square2 = [[f64; 2]; 2];

fn times(a: &Square2, b: &Square2) -> Square2 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
}

fn plus(a: &Square2, b: &Square2) -> Square2 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + b[i][j]))
}

fn transposed(a: &Square2) -> Square2 {
    [[a[0][0], a[1][0]], [a[0][1], a[1][1]]]
}

fn inverse(a: &Square2) -> Square2 {
    let by = 1.0 / (a[0][0] * a[1][1] - a[0][1] * a[1][0]);
    [[by * a[1][1], -by * a[0][1]], [-by * a[1][0], by * a[0][0]]]
}

/// The steady filter of a body whose angle and speed are both measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadyFilter {
    /// What angle and speed take of a difference in angle (first column) and in speed (second).
    pub gain: [[f64; 2]; 2],
    /// Variance of the predicted angle and speed about the true ones.
    pub variance: [f64; 2],
}

/// The error of an angle or a speed is at least this part of the other's over a sample: a channel without noise would make the equations
/// singular.
const LEAST_RATIO: f64 = 1e-6;
/// Doublings: the last stands for 2^40 samples.
const DOUBLINGS: usize = 40;
/// Change of the variance at which it is steady.
const STEADY: f64 = 1e-14;

impl SteadyFilter {
    /// For a share, the time of a sample [s], and the noise of both sensors.
    pub fn new(share: f64, step_s: f64, [angle, speed]: [f64; 2]) -> SteadyFilter {
        // The unit of time is a sample, and the unit of speed is the speed's noise.
        let turned = (step_s * speed).max(LEAST_RATIO * angle).max(1e-150);
        let of_angle = (angle / turned).max(LEAST_RATIO);
        let force = share * share / (1.0 - share);
        let information = [[1.0 / (of_angle * of_angle), 0.0], [0.0, 1.0]];
        let (mut a, mut g) = ([[1.0, 0.0], [1.0, 1.0]], information);
        let mut p = [[0.25 * force, 0.5 * force], [0.5 * force, force]];
        for _ in 0..DOUBLINGS {
            let within = inverse(&plus(&[[1.0, 0.0], [0.0, 1.0]], &times(&g, &p)));
            let (back, before) = (transposed(&a), p);
            p = plus(&p, &times(&times(&back, &times(&p, &within)), &a));
            g = plus(&g, &times(&times(&a, &times(&within, &g)), &back));
            a = times(&times(&a, &within), &a);
            if (p[1][1] - before[1][1]).abs() <= STEADY * p[1][1] && (p[0][0] - before[0][0]).abs() <= STEADY * p[0][0]
            {
                break;
            }
        }
        let noise = [[of_angle * of_angle, 0.0], [0.0, 1.0]];
        let k = times(&p, &inverse(&plus(&p, &noise)));
        SteadyFilter {
            gain: [[k[0][0], step_s * k[0][1]], [k[1][0] / step_s, k[1][1]]],
            variance: [p[0][0] * turned * turned, p[1][1] * (turned / step_s) * (turned / step_s)],
        }
    }

    /// Time after which a difference has fallen to about a third, by the slower pole of F (1 - K) [s].
    pub fn memory_s(&self, step_s: f64) -> f64 {
        let k = self.gain;
        let kept = [[1.0 - k[0][0], -k[0][1]], [-k[1][0], 1.0 - k[1][1]]];
        let a = times(&[[1.0, step_s], [0.0, 1.0]], &kept);
        let (half, product) = (0.5 * (a[0][0] + a[1][1]), a[0][0] * a[1][1] - a[0][1] * a[1][0]);
        let beyond = half * half - product;
        let pole = if beyond >= 0.0 { half.abs() + libm::sqrt(beyond) } else { libm::sqrt(product) };
        step_s / (1.0 - pole).max(f64::EPSILON)
    }
}

/// What a sensor shows of a free body.
struct CorrectingSensor {
    /// Its index among those observed.
    sensor: usize,
    body: usize,
    is_speed: bool,
    /// So that two sensors of one speed count as much as one.
    weight: f64,
}

/// What a state takes of measured values.
pub(super) struct Correction<'a> {
    observed: Observed<'a>,
    /// The sensors that correct.
    from: Vec<CorrectingSensor>,
    /// For each body, whether a correction of its speed corrects its angle too. It does where no sensor shows the angle and no spring ends at the body.
    is_carried: Vec<bool>,
    /// For each body whose angle and speed are both shown, its filter.
    filters: Vec<Option<SteadyFilter>>,
    /// By how much angles and speeds were moved at the last sample.
    pub(super) moved: (Vec<f64>, Vec<f64>),
}

impl<'a> Correction<'a> {
    pub(super) fn new(ready: &PreparedMachine, step_s: f64, observed: Observed<'a>) -> Correction<'a> {
        let m = ready.m;
        let of = |(i, sensor): (usize, &usize)| match m.sensors[*sensor].reads {
            Reads::Angle(b) => Some((i, ready.stands_for[b], false)),
            Reads::Speed(b) => Some((i, ready.stands_for[b], true)),
            Reads::Acceleration(_) | Reads::Pulses { .. } | Reads::Tension(_) | Reads::Reaction(_) | Reads::Part(_) => {
                None
            }
        };
        let free = |(_, b, _): &(usize, usize, bool)| m.bodies[*b].motion == BodyMotion::Free;
        let all: Vec<(usize, usize, bool)> = observed.sensors.iter().enumerate().filter_map(of).filter(free).collect();
        let alike = |b: usize, is_speed: bool| all.iter().filter(|(_, o, s)| (*o, *s) == (b, is_speed)).count() as f64;
        let shown = |(sensor, body, is_speed): &(usize, usize, bool)| {
            let weight = 1.0 / alike(*body, *is_speed);
            CorrectingSensor { sensor: *sensor, body: *body, is_speed: *is_speed, weight }
        };
        let from: Vec<CorrectingSensor> = all.iter().map(shown).collect();
        let told = |b: usize| {
            let by_spring = m.springs.iter().any(|s| s.ends.iter().any(|e| e.body == b));
            by_spring || all.iter().any(|(_, o, is_speed)| *o == b && !is_speed)
        };
        let noise_of = |b: usize, is_speed: bool| {
            let mean = |s: &CorrectingSensor| {
                let own = observed.noise[s.sensor] / ready.values[m.sensors[observed.sensors[s.sensor]].gain];
                s.weight * own * s.weight * own
            };
            let own: Vec<f64> = from.iter().filter(|s| s.body == b && s.is_speed == is_speed).map(mean).collect();
            (!own.is_empty()).then(|| libm::sqrt(own.iter().sum()))
        };
        let filter = |b: usize| {
            let noise = [noise_of(b, false)?, noise_of(b, true)?];
            Some(SteadyFilter::new(observed.share, step_s, noise))
        };
        let n = m.bodies.len();
        let (is_carried, filters) = ((0..n).map(|b| !told(b)).collect(), (0..n).map(filter).collect());
        Correction { observed, is_carried, filters, from, moved: (vec![0.0; n], vec![0.0; n]) }
    }

    /// Moves the state at a sample.
    pub(super) fn apply(&mut self, ready: &PreparedMachine, sample: usize, step_s: f64, q: &mut [f64], v: &mut [f64]) {
        let (dq, dv) = (&mut self.moved.0, &mut self.moved.1);
        dq.fill(0.0);
        dv.fill(0.0);
        let share = self.observed.share;
        for CorrectingSensor { sensor, body, is_speed, weight } in &self.from {
            let measured = self.observed.measured[*sensor].get(sample).copied().unwrap_or(f64::NAN);
            if !measured.is_finite() {
                continue;
            }
            let value = measured / ready.values[ready.m.sensors[self.observed.sensors[*sensor]].gain];
            let off = weight * (value - if *is_speed { v[*body] } else { q[*body] });
            let [to_angle, to_speed] = match (&self.filters[*body], is_speed) {
                (Some(filter), _) => filter.gain.map(|row| row[usize::from(*is_speed)]),
                // The gain of a force that is constant in a sample and differs from one to the next: the mean of the speeds that it has missed.
                (None, true) if self.is_carried[*body] => [(1.0 - 0.5 * share) * step_s, share],
                (None, true) => [0.0, share],
                (None, false) => [share, speed_share(share) / step_s],
            };
            dq[*body] += to_angle * off;
            dv[*body] += to_speed * off;
        }
        q.iter_mut().zip(dq).for_each(|(q, d)| *q += *d);
        v.iter_mut().zip(dv).for_each(|(v, d)| *v += *d);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The variance follows from its own equation, and without information from one sensor the gains are those of the other alone.
    #[test]
    fn gains_of_two_sensors_are_steady_and_end_at_those_of_one() {
        let (h, share) = (1e-3, 0.05);
        for noise in [[1e-3, 0.5], [0.14, 0.86], [1e-5, 3.0], [0.1, 1e-2]] {
            let filter = SteadyFilter::new(share, h, noise);
            // One step of the filter from its own covariance, found by many steps from nothing.
            let a2 = share * share / (1.0 - share) * noise[1] * noise[1] / (h * h);
            let q = [[0.25 * h.powi(4) * a2, 0.5 * h.powi(3) * a2], [0.5 * h.powi(3) * a2, h * h * a2]];
            let (f, r) = ([[1.0, h], [0.0, 1.0]], [[noise[0] * noise[0], 0.0], [0.0, noise[1] * noise[1]]]);
            let (mut p, mut k) = (q, [[0.0; 2]; 2]);
            for _ in 0..200_000 {
                k = times(&p, &inverse(&plus(&p, &r)));
                let kept = plus(&[[1.0, 0.0], [0.0, 1.0]], &k.map(|row| row.map(|x| -x)));
                p = plus(&times(&times(&f, &times(&kept, &p)), &transposed(&f)), &q);
            }
            for i in 0..2 {
                assert!((filter.variance[i] / p[i][i] - 1.0).abs() < 1e-6, "{noise:?} {filter:?} {p:?}");
                for j in 0..2 {
                    assert!((filter.gain[i][j] / k[i][j] - 1.0).abs() < 1e-6, "{noise:?} {filter:?} {k:?}");
                }
            }
        }
        // An angle so noisy that it tells nothing; the angle is then carried by the speed's correction.
        let blind = SteadyFilter::new(share, h, [1e4, 0.5]);
        assert!((blind.gain[1][1] - share).abs() < 1e-4 * share, "{blind:?}");
        assert!((blind.gain[0][1] / (h * (1.0 - 0.5 * share)) - 1.0).abs() < 1e-3, "{blind:?}");
        // An exact angle beside a noisy speed: the filter forgets sooner than h / s, the memory of the speed alone.
        let both = SteadyFilter::new(share, h, [1e-4, 3.0]);
        assert!(both.memory_s(h) < 0.2 * h / share, "{}", both.memory_s(h));
        // A speed so noisy that it tells nothing: the gains of Kalata.
        let noise: [f64; 2] = [1e-3, 1e3];
        let blind = SteadyFilter::new(1e-4, h, noise);
        let share = blind.gain[0][0];
        assert!((blind.gain[1][0] * h / speed_share(share) - 1.0).abs() < 1e-3, "{blind:?}");
    }
}
