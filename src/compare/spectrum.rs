//! Order spectrum of a sprocket's speed: amplitudes over multiples of the driver's rotation frequency.

use std::f64::consts::PI;

/// Number of means per revolution of the driver.
const PER_TURN: usize = 512;

/// Distance of two orders.
const STEP: f64 = 0.25;

/// Speeds averaged over equal parts of the driver's revolutions.
#[derive(Clone, Debug, Default)]
pub struct SpeedLog {
    means: Vec<f64>,
    sum: f64,
    n: f64,
    part: i64,
}

/// Amplitudes of a speed, relative to its mean.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Spectrum {
    /// Orders of the driver.
    pub orders: Vec<f64>,
    pub shares: Vec<f64>,
}

impl SpeedLog {
    /// Adds a speed [rad/s] at an angle of the driver [rad].
    pub fn add(&mut self, driver_rad: f64, speed_rad_s: f64) {
        let part = (driver_rad / (2.0 * PI) * PER_TURN as f64).floor() as i64;
        if part != self.part {
            if self.n > 0.0 {
                self.means.push(self.sum / self.n);
            }
            (self.sum, self.n, self.part) = (0.0, 0.0, part);
        }
        self.sum += speed_rad_s;
        self.n += 1.0;
    }

    /// Spectrum up to order `highest`, over whole revolutions with a Hann window; None for less than two revolutions.
    pub fn spectrum(&self, highest: f64) -> Option<Spectrum> {
        // The first part is incomplete.
        let means = self.means.get(1..)?;
        let turns = means.len() / PER_TURN;
        if turns < 2 {
            return None;
        }
        let means = &means[..turns * PER_TURN];
        let window = |i: usize| 1.0 - libm::cos(2.0 * PI * (i as f64 + 0.5) / means.len() as f64);
        let mean = means.iter().sum::<f64>() / means.len() as f64;
        let orders: Vec<f64> = (2..).map(|k| f64::from(k) * STEP).take_while(|o| *o <= highest).collect();
        let amplitude = |order: &f64| {
            let mut sum = (0.0, 0.0);
            for (i, v) in means.iter().enumerate() {
                let (s, c) = libm::sincos(2.0 * PI * order * (i as f64 + 0.5) / PER_TURN as f64);
                let weighted = window(i) * (v - mean);
                sum = (sum.0 + weighted * c, sum.1 + weighted * s);
            }
            // Averaging over a part of a revolution reduces high orders slightly; this corrects it.
            let half_part = PI * order / PER_TURN as f64;
            2.0 / means.len() as f64 * libm::hypot(sum.0, sum.1) * half_part / libm::sin(half_part)
        };
        let shares = orders.iter().map(|o| amplitude(o) / mean.abs()).collect();
        Some(Spectrum { orders, shares })
    }
}

impl Spectrum {
    /// Share at the nearest order.
    pub fn at(&self, order: f64) -> Option<f64> {
        let i = self.orders.iter().position(|o| (o - order).abs() <= 0.5 * STEP)?;
        Some(self.shares[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_keeps_its_order_and_amplitude() {
        let mut log = SpeedLog::default();
        for i in 0..60_000 {
            let turn = 2.0 * PI * f64::from(i) / 10_000.0;
            log.add(0.3 + turn, 100.0 + 0.5 * libm::sin(20.0 * turn) + 0.01 * libm::cos(40.0 * turn));
        }
        let s = log.spectrum(65.0).expect("five turns");
        assert!((s.at(20.0).expect("there") / 5e-3 - 1.0).abs() < 1e-3, "{:?}", s.at(20.0));
        assert!((s.at(40.0).expect("there") / 1e-4 - 1.0).abs() < 1e-2, "{:?}", s.at(40.0));
        assert!(s.at(10.0).expect("there") < 1e-6);
        assert!(SpeedLog::default().spectrum(10.0).is_none());
    }
}
