//! Loads of shafts, arms and sliders: laws of the catalogue over their own place and speed, and harmonics over the driver's turn.
//!
//! ```text
//! law         Q = f(q, q')                                   f: `effects`, friction, drag, ripple, unbalance
//! orders      Q = -s sum of M_k cos(k phi + p_k)             phi: the driver's turn (`super::driver_motion`), s: sense of the shaft
//! ```
//! q of a sprocket is the angle of its first gap's axis from +x. A load by orders points against the motion where the sum is positive, as
//! constant loads do. Laws see the speed at the node that follows from the step before, v(n-1/2) + h/2 a(n-1); the ledger takes the power of
//! the very force with the mean speed of the two half steps: what a dissipative law takes is lost, all else is work at the load.

use super::driver_motion::Harmonic;
use crate::effects::{BodyAt, BodyLaw};

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
