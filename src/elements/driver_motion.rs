//! How the driver turns: a speed that is constant or given over time, with harmonics of the engine on it.
//!
//! ```text
//! phi(t)   = integral of n(t)                       n: straight lines between given speeds, constant outside of them
//! angle    = phi + sum of A_k sin(k phi + p_k)      orders k of the driver's own turn, amplitudes A_k as angles
//! speed    = n (1 + sum of A_k k cos(k phi + p_k)) prod of (1 + f(angle))
//! ```
//! phi is zero where the recording begins; a drive is run in before that, at negative times and the first speed. f: the effect
//! `speed_fluctuation`, over the angle of the shaft itself. Steps take the speed in their middle: second order. Harmonics of measured
//! engines: angle-domain Fourier series, for example of Cali and Fritz 2012 (order 2.9985, 0.191 degrees).

use crate::effects::{MotionLaw, speed_fluctuation};

/// One harmonic over the driver's turn; its amplitude is an angle [rad] or a torque [N m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Harmonic {
    /// Per turn of the driver.
    pub order: f64,
    pub amplitude: f64,
    pub phase_rad: f64,
}

/// Motion of the driver in the sense in which the chain moves forwards.
#[derive(Clone, Debug)]
pub struct DriverMotion {
    times_s: Vec<f64>,
    speeds_rad_s: Vec<f64>,
    /// phi at these times [rad].
    turns_rad: Vec<f64>,
    harmonics: Vec<Harmonic>,
    fluctuations: Vec<(MotionLaw, Vec<f64>)>,
    /// Sense of the sprocket's turning where the chain moves forwards: 1 or -1.
    sense: f64,
}

impl DriverMotion {
    /// `speeds`: time [s] and speed [rad/s], at least one, the times rising. `fluctuations`: laws of effects with their values.
    pub fn new(
        speeds: &[(f64, f64)],
        harmonics: Vec<Harmonic>,
        fluctuations: Vec<(MotionLaw, Vec<f64>)>,
        sense: f64,
    ) -> DriverMotion {
        let mut turns_rad = vec![0.0; speeds.len()];
        for i in 1..speeds.len() {
            let ((t0, n0), (t1, n1)) = (speeds[i - 1], speeds[i]);
            turns_rad[i] = turns_rad[i - 1] + 0.5 * (n0 + n1) * (t1 - t0);
        }
        let (times_s, speeds_rad_s) = speeds.iter().copied().unzip();
        let mut motion = DriverMotion { times_s, speeds_rad_s, turns_rad, harmonics, fluctuations, sense };
        let at_start = motion.turn_rad(0.0);
        motion.turns_rad.iter_mut().for_each(|turn| *turn -= at_start);
        motion
    }

    /// Mean speed n and its integral phi at `t_s` [rad/s, rad].
    fn mean(&self, t_s: f64) -> (f64, f64) {
        let next = self.times_s.partition_point(|t| *t <= t_s);
        let Some(at) = next.checked_sub(1) else {
            return (self.speeds_rad_s[0], self.turns_rad[0] + self.speeds_rad_s[0] * (t_s - self.times_s[0]));
        };
        let (t0, n0) = (self.times_s[at], self.speeds_rad_s[at]);
        let slope = match self.times_s.get(next) {
            Some(t1) => (self.speeds_rad_s[next] - n0) / (t1 - t0),
            None => 0.0,
        };
        let passed_s = t_s - t0;
        (n0 + slope * passed_s, self.turns_rad[at] + (n0 + 0.5 * slope * passed_s) * passed_s)
    }

    /// Highest speed, harmonics included and fluctuations of effects not [rad/s].
    pub fn highest_speed_rad_s(&self) -> f64 {
        let waves: f64 = self.harmonics.iter().map(|h| (h.amplitude * h.order).abs()).sum();
        let mean = self.speeds_rad_s.iter().fold(0.0, |most: f64, n| most.max(n.abs()));
        mean * (1.0 + waves)
    }

    /// phi at `t_s`, without harmonics [rad].
    pub fn turn_rad(&self, t_s: f64) -> f64 {
        self.mean(t_s).1
    }

    /// Speed of the sprocket's coordinate at `t_s`, where its angle is `angle_rad` [rad/s].
    pub fn speed_rad_s(&self, t_s: f64, angle_rad: f64) -> f64 {
        let (mean, turn) = self.mean(t_s);
        let mut factor = 1.0;
        for h in &self.harmonics {
            factor += h.amplitude * h.order * libm::cos(h.order * turn + h.phase_rad);
        }
        for (law, values) in &self.fluctuations {
            factor *= 1.0 + law(values, angle_rad);
        }
        self.sense * mean * factor
    }

    /// Turn of the sprocket since the recording began, harmonics included and fluctuations of effects not [rad].
    pub fn angle_rad(&self, t_s: f64) -> f64 {
        let turn = self.turn_rad(t_s);
        let wave = |h: &Harmonic| h.amplitude * libm::sin(h.order * turn + h.phase_rad);
        self.sense * (turn + self.harmonics.iter().map(wave).sum::<f64>())
    }
}

impl DriverMotion {
    /// [`DriverMotion::mean_lead_rad`] as a time at the first speed, whose sign says which way is ahead [s].
    pub fn mean_lead_s(&self, angle_rad: f64, before_s: f64, period_s: f64) -> f64 {
        let lead = self.mean_lead_rad(angle_rad, before_s, period_s);
        if lead == 0.0 { 0.0 } else { lead / self.speeds_rad_s[0] }
    }

    /// How far the mean of the angle over `period_s` stands ahead of where it would stand without fluctuations of effects [rad], where the angle
    /// is `angle_rad` at time zero and the motion began `before_s` earlier. A wave pushes the shaft ahead or back by up to its own
    /// amplitude as an angle, as its phase is where the motion begins.
    pub fn mean_lead_rad(&self, angle_rad: f64, before_s: f64, period_s: f64) -> f64 {
        if self.fluctuations.is_empty() {
            return 0.0;
        }
        let steady = |t: f64, q: f64| self.sense * q - self.turn_rad(t);
        let begins = self.solved(angle_rad, -before_s, |_| ());
        let waves = self.sense * self.angle_rad(-before_s) - self.turn_rad(-before_s);
        let (mut sum, mut nodes) = (0.0, 0.0);
        self.solved(angle_rad, period_s, |(t, q)| {
            sum += steady(t, q);
            nodes += 1.0;
        });
        sum / nodes - (steady(-before_s, begins) - waves)
    }

    /// The angle at `end_s`, from that at time zero, by Runge and Kutta's method; `each` gets the nodes but the last.
    fn solved(&self, angle_rad: f64, end_s: f64, mut each: impl FnMut((f64, f64))) -> f64 {
        let fastest = self.speeds_rad_s.iter().fold(0.0, |most: f64, n| most.max(n.abs()));
        let order = self.harmonics.iter().map(|h| h.order).chain(self.fluctuations.iter().map(|f| order_of(&f.1)));
        let waves = fastest * end_s.abs() * order.fold(1.0, f64::max) / (2.0 * std::f64::consts::PI);
        let nodes = libm::ceil(NODES_OF_WAVE * waves).clamp(1.0, MOST_NODES);
        let h = end_s / nodes;
        let mut q = angle_rad;
        for i in 0..nodes as u64 {
            let t = i as f64 * h;
            each((t, q));
            let a = self.speed_rad_s(t, q);
            let b = self.speed_rad_s(t + 0.5 * h, q + 0.5 * h * a);
            let c = self.speed_rad_s(t + 0.5 * h, q + 0.5 * h * b);
            let d = self.speed_rad_s(t + h, q + h * c);
            q += h * (a + 2.0 * b + 2.0 * c + d) / 6.0;
        }
        q
    }

    /// Whether waves come back only after several turns of the shaft.
    pub fn counts_turns(&self) -> bool {
        self.fluctuations.iter().map(|f| order_of(&f.1)).any(|order| order != libm::trunc(order))
    }
}

/// Nodes of a wave at which it is solved, evenly over time: over two turns 3e-9 of the amplitude of a wave of a tenth of the speed are left, 4e-6 of one
/// of nine tenths. No more than so many nodes in all: a run-in of more than 5200 waves is solved less well.
const NODES_OF_WAVE: f64 = 192.0;
const MOST_NODES: f64 = 1e6;

/// The order among the values of a `speed_fluctuation`.
fn order_of(values: &[f64]) -> f64 {
    speed_fluctuation::ROW.order_in(values).unwrap_or(1.0)
}

/// Sum of M_k cos(k phi + p_k).
pub fn sum_of_cosines(harmonics: &[Harmonic], turn_rad: f64) -> f64 {
    harmonics.iter().map(|h| h.amplitude * libm::cos(h.order * turn_rad + h.phase_rad)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Physics;

    /// A wave of a tenth of the speed over an angle, order 1.5: the mean speed is the declared one, and the mean angle leads by what the wave
    /// has where the motion begins, A cos(k q + p) with A = 0.1/1.5, up to terms of the second order in it.
    #[test]
    fn a_fluctuation_keeps_the_mean_speed_and_leads_by_its_phase() {
        let Physics::Motion(law) = speed_fluctuation::ROW.physics else { panic!("a motion") };
        for phase in [0.3, 1.7, 3.0] {
            let values = vec![0.1, phase, 1.5];
            let motion = DriverMotion::new(&[(0.0, 200.0)], Vec::new(), vec![(law, values)], -1.0);
            // Ten periods of two turns, backwards as the shaft turns.
            let period_s = 4.0 * std::f64::consts::PI / 200.0;
            let end = motion.solved(0.4, 10.0 * period_s, |_| ());
            // measured 1.7e-9 of 126 rad
            assert!((0.4 - end - 200.0 * 10.0 * period_s).abs() < 1e-8, "{end}");
            let before_s = 0.37 * period_s;
            let begins = motion.solved(0.4, -before_s, |_| ());
            let lead = motion.mean_lead_rad(0.4, before_s, period_s);
            // The coordinate falls as the shaft turns: the wave over the turn -q has the phase -p, and its sine the other sign.
            let first = -(0.1 / 1.5) * libm::cos(1.5 * begins + phase);
            assert!((lead - first).abs() < 0.1 * 0.1 / 1.5, "{lead} {first}");
            // Run backwards from the same angle, the same way ahead is one behind in time.
            let back = DriverMotion::new(&[(0.0, -200.0)], Vec::new(), motion.fluctuations.clone(), -1.0);
            let late_s = back.mean_lead_s(0.4, before_s, period_s);
            assert!(late_s * back.mean_lead_rad(0.4, before_s, period_s) < 0.0, "{late_s}");
        }
    }

    /// The angle by a table is that of the integral of the speed, at every time, and zero at time zero.
    #[test]
    fn angle_is_the_integral_of_the_speed() {
        let table = [(-0.5, 100.0), (0.25, 400.0), (1.0, 400.0), (1.4, 50.0)];
        let harmonics = vec![
            Harmonic { order: 1.5, amplitude: 3e-3, phase_rad: 0.3 },
            Harmonic { order: 3.0, amplitude: -1e-3, phase_rad: -2.0 },
        ];
        let motion = DriverMotion::new(&table, harmonics, Vec::new(), -1.0);
        assert!(motion.turn_rad(0.0).abs() < 1e-12);
        let (h, mut angle) = (1e-5, motion.angle_rad(-0.7));
        for i in 0..230_000 {
            let t = -0.7 + (f64::from(i) + 0.5) * h;
            angle += h * motion.speed_rad_s(t, 0.0);
        }
        let end = motion.angle_rad(1.6);
        // measured 1.1e-6 of 452 rad: the midpoint rule at the corners of the table
        assert!((angle - end).abs() < 5e-6, "{angle} {end}");
    }
}
