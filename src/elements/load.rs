//! Loads of shafts, arms and sliders: laws of the catalogue over their own place and speed, harmonics over the driver's turn, and gas on valves.
//!
//! ```text
//! law         Q = f(q, q')                                   f: `effects`, friction, drag, ripple, unbalance
//! orders      Q = -s sum of M_k cos(k phi + p_k)             phi: the driver's turn (`super::driver_motion`), s: sense of the shaft
//! gas         Q = -A p(a)                                    a: angle of the valve's cam from full lift, p: above what presses on its back
//! ```
//! q of a sprocket is the angle of its first gap's axis from +x. A load by orders points against the motion where the sum is positive, as
//! constant loads do. Laws see the speed at the node that follows from the step before, v(n-1/2) + h/2 a(n-1); the ledger takes the power of
//! the very force with the mean speed of the two half steps: what a dissipative law takes is lost, all else is work at the load.

use super::driver_motion::Harmonic;
use crate::effects::{BodyAt, BodyLaw};
use crate::units::wrap_angle;
use std::f64::consts::TAU;

/// A load by a law of the catalogue.
#[derive(Clone, Debug)]
pub struct Load {
    /// In the drive file.
    pub path: String,
    pub coordinate: usize,
    pub law: BodyLaw,
    /// Values of the law's parameters, SI.
    pub values: Vec<f64>,
    pub is_dissipative: bool,
}

impl Load {
    /// Force at a place and a speed [N m, N].
    #[inline(always)]
    pub fn force(&self, q: f64, v: f64) -> f64 {
        (self.law)(&self.values, BodyAt { q, v })
    }

    /// Mean over a turn at a speed: what a drive at rest is given in place of it [N m, N].
    pub fn mean_force(&self, v: f64) -> f64 {
        const PLACES: u32 = 64;
        let at = |i: u32| f64::from(i) * (std::f64::consts::TAU / f64::from(PLACES));
        (0..PLACES).map(|i| self.force(at(i), v)).sum::<f64>() / f64::from(PLACES)
    }

    /// How much less the mean over a turn is for each unit of speed more, about a speed [N m s/rad, N s/m].
    pub fn mean_damping(&self, v: f64) -> f64 {
        let d = 1e-4 * v.abs().max(SLOWEST);
        (self.mean_force(v - d) - self.mean_force(v + d)) / (2.0 * d)
    }

    /// Largest slope of the force over the speed between standstill and `v` [N m s/rad, N s/m].
    pub fn steepest(&self, v: f64) -> f64 {
        let top = v.abs().max(SLOWEST);
        let slope = |v: f64| {
            let d = 1e-6 * top;
            ((self.force(0.0, v + d) - self.force(0.0, v - d)) / (2.0 * d)).abs()
        };
        (0..=32).map(|i| slope(top * f64::from(i) / 32.0)).fold(0.0, f64::max)
    }
}

/// Speed within which the slope of a load is looked for where the coordinate has no nominal one [rad/s, m/s]. assumed.
const SLOWEST: f64 = 1.0;

/// A load by orders of the driver.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderLoad {
    /// In the drive file.
    pub path: String,
    pub coordinate: usize,
    /// Sense in which the coordinate turns: 1 or -1.
    pub sense: f64,
    /// Amplitudes as torques [N m].
    pub harmonics: Vec<Harmonic>,
}

/// The gas that presses on the head of a valve.
#[derive(Clone, Debug, PartialEq)]
pub struct GasLoad {
    /// In the drive file.
    pub path: String,
    /// Number of the touch of its cam among those of the model.
    pub cam: usize,
    /// Area of the head [m2].
    pub area_m2: f64,
    pub pressures: PressureTable,
}

/// Pressure over a turn of a cam, on straight lines between points, and from the last to the first.
#[derive(Clone, Debug, PartialEq)]
pub struct PressureTable {
    /// Rising, from -pi to pi [rad].
    angles_rad: Vec<f64>,
    pressures_pa: Vec<f64>,
}

impl PressureTable {
    /// None: not two points or more, or angles that do not rise within a turn.
    pub fn new(angles_rad: Vec<f64>, pressures_pa: Vec<f64>) -> Option<PressureTable> {
        let (first, last) = (angles_rad.first()?, angles_rad.last()?);
        let rises = angles_rad.windows(2).all(|w| w[1] > w[0]);
        let fits = angles_rad.len() == pressures_pa.len() && angles_rad.len() > 1 && last - first <= TAU;
        (rises && fits).then_some(PressureTable { angles_rad, pressures_pa })
    }

    /// Pressure at an angle [Pa].
    pub fn at(&self, angle_rad: f64) -> f64 {
        let (angles, n) = (&self.angles_rad, self.angles_rad.len());
        let angle = wrap_angle(angle_rad);
        let next = angles.partition_point(|a| *a <= angle);
        let (from, to) = ((next + n - 1) % n, next % n);
        // Around the end of the turn.
        let before = if next == 0 { angles[from] - TAU } else { angles[from] };
        let after = if next == n { angles[to] + TAU } else { angles[to] };
        let share = if after > before { (angle - before) / (after - before) } else { 0.0 };
        self.pressures_pa[from] + (self.pressures_pa[to] - self.pressures_pa[from]) * share
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::PressureTable;
    use std::f64::consts::PI;

    #[test]
    fn pressures_lie_on_straight_lines_round_the_turn() {
        let table = PressureTable::new(vec![-0.5 * PI, 0.0, 0.5 * PI], vec![1e5, 3e5, 2e5]).expect("points");
        // From 2 bar at a quarter turn to 1 bar at three quarters.
        for (angle, known) in [(0.0, 3e5), (-0.25 * PI, 2e5), (PI, 1.5e5), (-0.75 * PI, 1.25e5), (2.25 * PI, 2.5e5)] {
            assert!((table.at(angle) - known).abs() < 1e-6, "{angle}: {}", table.at(angle));
        }
        assert!(PressureTable::new(vec![0.0, 0.0], vec![1.0, 1.0]).is_none());
        assert!(PressureTable::new(vec![-4.0, 4.0], vec![1.0, 1.0]).is_none());
        assert!(PressureTable::new(vec![0.0], vec![1.0]).is_none());
    }
}
