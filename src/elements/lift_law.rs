//! Lift laws of cams: how far a cam holds its follower out, over its own angle.
//!
//! ```text
//! u = |a| / a_h                    a: angle from full lift, a_h: half of the angle over which the cam lifts
//! harmonic    s = L (1 + cos pi u) / 2
//! polynomial  s = L (1 + sum C_i u^i),   C_i = -prod_{j != i} j / (j - i)
//! table       s through given points, a cubic spline that begins and ends at rest
//! ramp        r (10 w^3 - 15 w^4 + 6 w^5) from u = 1 outwards, w from 1 down to 0 over the angle of the ramp; r beneath all of the lift
//! ```
//! With n powers i the polynomial and its first n - 1 derivatives end at zero: the powers 2, 8, 14, 20 are a usual set. Source: Stoddart 1953,
//! "Polydyne cam design". A harmonic law ends with a jump of its acceleration, as the eccentric that it is. Ramps take up lash at a small speed.
//! Slope s' and bend s'' are derivatives by the angle; the torque of a force F on the follower is F s'.

use crate::units::wrap_angle;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// How the lift goes up and down.
#[derive(Clone, Debug, PartialEq)]
pub enum LiftShape {
    Harmonic,
    /// Powers, and their coefficients.
    Polynomial(Vec<(u32, f64)>),
    Table(LiftTable),
}

/// Lift over the angle of a cam.
#[derive(Clone, Debug, PartialEq)]
pub struct LiftLaw {
    shape: LiftShape,
    /// Full lift above the ramps [m].
    lift_m: f64,
    /// Half of the angle over which it lifts [rad].
    half_rad: f64,
    /// Height and angle of the ramps before and after.
    ramp_m: f64,
    ramp_rad: f64,
}

/// Lift at one angle, with its derivatives by the angle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lift {
    pub lift_m: f64,
    /// [m/rad].
    pub slope_m: f64,
    /// [m/rad2].
    pub bend_m: f64,
}

/// Points of a measured or drawn cam, and the spline through them.
#[derive(Clone, Debug, PartialEq)]
pub struct LiftTable {
    /// From full lift, rising [rad].
    angles: Vec<f64>,
    lifts: Vec<f64>,
    /// Second derivative in every point.
    bends: Vec<f64>,
}

impl LiftTable {
    /// None: fewer than four points, or angles that do not rise.
    pub fn new(angles: Vec<f64>, lifts: Vec<f64>) -> Option<LiftTable> {
        let n = angles.len();
        if n < 4 || n != lifts.len() || angles.windows(2).any(|w| w[1] <= w[0]) {
            return None;
        }
        let width = |i: usize| angles[i + 1] - angles[i];
        let rise = |i: usize| (lifts[i + 1] - lifts[i]) / width(i);
        let (mut a, mut b) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
        for i in 0..n {
            if i > 0 {
                a[(i, i - 1)] = width(i - 1);
                a[(i, i)] += 2.0 * width(i - 1);
                b[i] -= 6.0 * rise(i - 1);
            }
            if i + 1 < n {
                a[(i, i + 1)] = width(i);
                a[(i, i)] += 2.0 * width(i);
                b[i] += 6.0 * rise(i);
            }
        }
        // Slopes of zero at both ends: nothing stands in place of the rise outside.
        let bends = a.lu().solve(&b)?;
        Some(LiftTable { angles, lifts, bends: bends.iter().copied().collect() })
    }

    fn at(&self, angle: f64) -> Lift {
        let n = self.angles.len();
        if angle <= self.angles[0] || angle >= self.angles[n - 1] {
            let end = if angle <= self.angles[0] { 0 } else { n - 1 };
            return Lift { lift_m: self.lifts[end], ..Lift::default() };
        }
        let i = self.angles.partition_point(|a| *a <= angle) - 1;
        let width = self.angles[i + 1] - self.angles[i];
        let (left, right) = ((self.angles[i + 1] - angle) / width, (angle - self.angles[i]) / width);
        let (c, d) = (self.bends[i] * width * width / 6.0, self.bends[i + 1] * width * width / 6.0);
        let cubic = |x: f64| x * x * x - x;
        Lift {
            lift_m: left * self.lifts[i] + right * self.lifts[i + 1] + c * cubic(left) + d * cubic(right),
            slope_m: (self.lifts[i + 1] - self.lifts[i] - c * (3.0 * left * left - 1.0)
                + d * (3.0 * right * right - 1.0))
                / width,
            bend_m: left * self.bends[i] + right * self.bends[i + 1],
        }
    }
}

/// Coefficients C_i of the polynomial law.
pub fn polynomial(powers: &[u32]) -> LiftShape {
    let of = |i: u32| {
        let others = powers.iter().filter(|j| **j != i).map(|j| f64::from(*j));
        -others.map(|j| j / (j - f64::from(i))).product::<f64>()
    };
    LiftShape::Polynomial(powers.iter().map(|i| (*i, of(*i))).collect())
}

impl LiftLaw {
    /// `ramp`: height [m] and angle [rad] of the ramps; zeros for none.
    pub fn new(shape: LiftShape, lift_m: f64, half_rad: f64, ramp: (f64, f64)) -> LiftLaw {
        LiftLaw { shape, lift_m, half_rad, ramp_m: ramp.0, ramp_rad: ramp.1 }
    }

    /// By a table, which holds its ramps.
    pub fn of_table(table: LiftTable) -> LiftLaw {
        let lift_m = table.lifts.iter().copied().fold(0.0, f64::max);
        let half_rad = table.angles.iter().map(|a| a.abs()).fold(0.0, f64::max);
        LiftLaw { shape: LiftShape::Table(table), lift_m, half_rad, ramp_m: 0.0, ramp_rad: 0.0 }
    }

    /// Full lift, with its ramps [m].
    pub fn full_m(&self) -> f64 {
        self.lift_m + self.ramp_m
    }

    /// Angle beyond which there is no lift, either way from full lift [rad].
    pub fn reach_rad(&self) -> f64 {
        self.half_rad + self.ramp_rad
    }

    /// Lift where the cam stands `angle` beyond full lift [rad]; any number of turns.
    pub fn at(&self, angle: f64) -> Lift {
        let angle = wrap_angle(angle);
        if let LiftShape::Table(table) = &self.shape {
            return table.at(angle);
        }
        let (side, away) = if angle < 0.0 { (-1.0, -angle) } else { (1.0, angle) };
        if away >= self.half_rad {
            return self.on_ramp(side, away - self.half_rad);
        }
        let u = away / self.half_rad;
        let (value, slope, bend) = match &self.shape {
            LiftShape::Harmonic => {
                let (s, c) = libm::sincos(PI * u);
                (0.5 * (1.0 + c), -0.5 * PI * s, -0.5 * PI * PI * c)
            }
            LiftShape::Polynomial(terms) => {
                let mut sums = (1.0, 0.0, 0.0);
                for (power, c) in terms {
                    let i = f64::from(*power);
                    // u^(i - 2), which is 1 for the power 2.
                    let low = libm::pow(u, i - 2.0);
                    sums.0 += c * low * u * u;
                    sums.1 += c * i * low * u;
                    sums.2 += c * i * (i - 1.0) * low;
                }
                sums
            }
            LiftShape::Table(_) => (0.0, 0.0, 0.0),
        };
        Lift {
            lift_m: self.ramp_m + self.lift_m * value,
            slope_m: side * self.lift_m * slope / self.half_rad,
            bend_m: self.lift_m * bend / (self.half_rad * self.half_rad),
        }
    }

    fn on_ramp(&self, side: f64, beyond: f64) -> Lift {
        if beyond >= self.ramp_rad {
            return Lift::default();
        }
        let w = 1.0 - beyond / self.ramp_rad;
        let (height, width) = (self.ramp_m, self.ramp_rad);
        Lift {
            lift_m: height * w * w * w * (10.0 - 15.0 * w + 6.0 * w * w),
            slope_m: -side * height * 30.0 * w * w * (1.0 - w) * (1.0 - w) / width,
            bend_m: height * 60.0 * w * (1.0 - w) * (1.0 - 2.0 * w) / (width * width),
        }
    }

    /// Angles from one end of the lift to the other, `n` of them.
    pub fn sweep(&self, n: usize) -> impl Iterator<Item = f64> {
        let reach = self.reach_rad();
        (0..n).map(move |i| reach * (2.0 * (i as f64 + 0.5) / n as f64 - 1.0))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;

    fn laws() -> Vec<LiftLaw> {
        let half = 1.1;
        let points: Vec<f64> = (0..41).map(|i| half * (f64::from(i) / 20.0 - 1.0)).collect();
        let smooth = LiftLaw::new(polynomial(&[2, 8, 14, 20]), 9e-3, half, (0.0, 0.0));
        let lifts = points.iter().map(|a| smooth.at(*a).lift_m).collect();
        vec![
            LiftLaw::new(LiftShape::Harmonic, 9e-3, half, (0.0, 0.0)),
            smooth,
            LiftLaw::new(polynomial(&[2, 4, 6, 8]), 9e-3, half, (0.2e-3, 0.3)),
            LiftLaw::of_table(LiftTable::new(points, lifts).expect("points")),
        ]
    }

    /// Slope and bend are the derivatives of the lift, and the lift is what was asked for.
    #[test]
    fn slopes_and_bends_are_derivatives() {
        for law in laws() {
            assert!((law.at(0.0).lift_m - law.full_m()).abs() < 1e-15 && law.at(3.0) == Lift::default());
            let d = 1e-5;
            for angle in law.sweep(400) {
                let (before, here, after) = (law.at(angle - d), law.at(angle), law.at(angle + d));
                let slope = (after.lift_m - before.lift_m) / (2.0 * d);
                assert!((slope - here.slope_m).abs() < 1e-9, "{angle}: {slope} {here:?}");
                let bend = (after.slope_m - before.slope_m) / (2.0 * d);
                let has_jump = (angle.abs() - law.half_rad).abs() < 2.0 * d;
                assert!(has_jump || (bend - here.bend_m).abs() < 1e-5, "{angle}: {bend} {here:?}");
            }
        }
    }

    /// The polynomial with the powers 2, 4, 6, 8 is (1 - u^2)^4, its closed form.
    #[test]
    fn coefficients_are_those_of_the_closed_form() {
        let law = LiftLaw::new(polynomial(&[2, 4, 6, 8]), 1.0, 1.0, (0.0, 0.0));
        for u in [0.0, 0.2, 0.5, 0.9, 0.999] {
            let known = f64::powi(1.0 - u * u, 4);
            assert!((law.at(u).lift_m - known).abs() < 1e-14, "{u}");
        }
    }

    /// A spline through 41 points of a smooth law is off by a ten-thousandth of the lift.
    #[test]
    fn a_table_follows_the_law_that_it_was_made_from() {
        let all = laws();
        let worst = all[1].sweep(1000).map(|a| (all[1].at(a).lift_m - all[3].at(a).lift_m).abs()).fold(0.0, f64::max);
        println!("{:.1e} of the lift", worst / 9e-3);
        assert!(worst < 2e-4 * 9e-3);
        assert!(LiftTable::new(vec![0.0, 1.0, 1.0, 2.0], vec![0.0; 4]).is_none());
    }
}
