//! Plain bearing: a journal on a film of oil that shifts as a whole, without tilting. The short bearing (Ocvirk) with a film that bears
//! pressure and no tension, for any motion of the journal.
//!
//! ```text
//! v_s = v - (W/2) z x e                              speed of squeezing: e the way of the axis from the middle of the bore, W its speed
//! p   = 6 mu (v_s . n) (L^2/4 - z^2) / h^3           where v_s . n > 0, else zero; n the direction of a place, h = c - e . n
//! F   = -D v_s                                       on the journal; D = mu R L^3 integral over v_s . n > 0 of n n' / h^3
//! M   = -(e x F)/2 - 2 pi mu R^3 L W / (c sqrt(1 - (e/c)^2))      torque on the journal
//! lost = (-F . v - M W) dt                           = v_s D v_s + what Couette's flow takes: never negative
//! ```
//! D is symmetric and depends on the direction of v_s alone. In the frame of e the integrals over the half circle of pressure follow from
//! Sommerfeld's substitution 1 - k cos q = (1 - k^2) / (1 + k cos g), k = e/c:
//! cc: [(k^2 + 1/2) g + 2 k sin g + sin g cos g / 2] / s^5, sc: [sin^2 g / 2 - k cos g] / s^4, ss: [g - sin g cos g] / 2 / s^3, s^2 = 1 - k^2.
//! Source: Booker 1965 and Childs, Moes, van Leeuwen 1977 (impedance of the short bearing); DuBois and Ocvirk 1953 (its locus under a
//! constant load); the drag of the shear flow: Petroff, with the film all round.
//!
//! The film is stiff against speeds: D h / m may be ten and more. A step takes its mean over the step for a force that decays as
//! exp(-D t / m) while D stays: speed v+ = v- + h a with (m + b h D) a = F_others - D (v- - (W/2) z x e), b = 1/(1 - exp(-r)) - 1/r by every
//! eigenvalue r = D h / m. b is 1/2 where the step is small (second order), 1 where the film is stiff.

use crate::geometry::{Vec2, cross, perp, rotated};
use std::f64::consts::PI;

/// A plain bearing.
#[derive(Clone, Debug, PartialEq)]
pub struct PlainBearing {
    /// Radius of the journal, length of the bore, radial clearance [m].
    pub radius_m: f64,
    pub length_m: f64,
    pub clearance_m: f64,
    pub viscosity_pa_s: f64,
}

/// Share of the clearance at which integrals stop: films thinner than that are an error of the run.
const LARGEST_ECCENTRICITY: f64 = 1.0 - 1e-9;

/// Symmetric matrix in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmDamping {
    pub xx: f64,
    pub xy: f64,
    pub yy: f64,
}

/// What a journal of some mass does in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmStep {
    /// Mean force on the journal over the step [N], and torque on it [N m].
    pub force: Vec2,
    pub torque_nm: f64,
}

/// A journal at a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Journal {
    /// Mass that moves with its axis [kg].
    pub mass_kg: f64,
    /// Way of its axis from the middle of the bore [m].
    pub way: Vec2,
    /// Half a step before the node, and at the node as the step before has it [m/s].
    pub velocity_before: Vec2,
    pub velocity: Vec2,
    /// [rad/s].
    pub omega: f64,
    /// All other forces on it [N].
    pub others: Vec2,
}

impl PlainBearing {
    /// Film damping D where the axis has moved by `way` and squeezes in the direction of `squeeze` [N s/m].
    pub fn damping(&self, way: Vec2, squeeze: Vec2) -> FilmDamping {
        let distance_m = way.norm();
        let radial = if distance_m > 0.0 { way / distance_m } else { Vec2::new(1.0, 0.0) };
        let k = (distance_m / self.clearance_m).min(LARGEST_ECCENTRICITY);
        let s2 = 1.0 - k * k;
        let s = s2.sqrt();
        let speed = squeeze.norm();
        let towards = if speed > 0.0 { squeeze / speed } else { radial };
        // The half circle of pressure begins a right angle before the direction of squeezing, in the frame of `way`.
        let (c, n) = (towards.dot(&radial), cross(radial, towards));
        let substituted = |cos: f64, sin: f64| {
            let h = 1.0 - k * cos;
            ((cos - k) / h, s * sin / h)
        };
        let (c1, n1) = substituted(n, -c);
        let (c2, n2) = substituted(-n, c);
        let turned = crate::units::atan2(n2 * c1 - c2 * n1, c2 * c1 + n2 * n1);
        let g = if turned < 0.0 { turned + 2.0 * PI } else { turned };
        let products = n2 * c2 - n1 * c1;
        let cc = ((k * k + 0.5) * g + 2.0 * k * (n2 - n1) + 0.5 * products) / (s2 * s2 * s);
        let sc = (0.5 * (n2 * n2 - n1 * n1) - k * (c2 - c1)) / (s2 * s2);
        let ss = 0.5 * (g - products) / (s2 * s);
        let scale = self.viscosity_pa_s * self.radius_m * (self.length_m / self.clearance_m).powi(3);
        let (x, y) = (radial.x, radial.y);
        FilmDamping {
            xx: scale * (cc * x * x - 2.0 * sc * x * y + ss * y * y),
            xy: scale * ((cc - ss) * x * y + sc * (x * x - y * y)),
            yy: scale * (cc * y * y + 2.0 * sc * x * y + ss * x * x),
        }
    }

    /// Force of the film on the journal [N] at a way [m], a velocity [m/s] and a speed of turning [rad/s].
    pub fn force(&self, way: Vec2, velocity: Vec2, omega: f64) -> Vec2 {
        let squeeze = velocity - perp(way) * (0.5 * omega);
        -(self.damping(way, squeeze) * squeeze)
    }

    /// Torque of the film on the journal [N m] beside a force of the film.
    pub fn torque_nm(&self, way: Vec2, force: Vec2, omega: f64) -> f64 {
        let k = (way.norm() / self.clearance_m).min(LARGEST_ECCENTRICITY);
        -0.5 * cross(way, force) - self.drag_nm_s(k) * omega
    }

    /// Drag of the shear flow over the speed at an eccentricity e/c [N m s/rad].
    pub fn drag_nm_s(&self, eccentricity: f64) -> f64 {
        2.0 * PI * self.viscosity_pa_s * self.radius_m.powi(3) * self.length_m
            / (self.clearance_m * (1.0 - eccentricity * eccentricity).sqrt())
    }

    /// What a step does to a journal.
    pub fn step(&self, step_s: f64, j: &Journal) -> FilmStep {
        let drift = perp(j.way) * (0.5 * j.omega);
        let d = self.damping(j.way, j.velocity - drift);
        let pull = j.others - d * (j.velocity_before - drift);
        // By the eigenvectors of D: (cos, sin) and the one across.
        let (middle, half_gap) = (0.5 * (d.xx + d.yy), 0.5 * (d.xx - d.yy));
        let spread = libm::hypot(half_gap, d.xy);
        let first = if spread > 0.0 && half_gap >= 0.0 {
            Vec2::new(half_gap + spread, d.xy).normalize()
        } else if spread > 0.0 {
            Vec2::new(d.xy, spread - half_gap).normalize()
        } else {
            Vec2::new(1.0, 0.0)
        };
        let mut acceleration = Vec2::zeros();
        for (axis, value) in [(first, middle + spread), (perp(first), middle - spread)] {
            let share = implicit_share(value.max(0.0) * step_s / j.mass_kg);
            acceleration += axis * (axis.dot(&pull) / (j.mass_kg + share * step_s * value.max(0.0)));
        }
        let force = acceleration * j.mass_kg - j.others;
        FilmStep { force, torque_nm: self.torque_nm(j.way, force, j.omega) }
    }

    /// Load that the film bears at an eccentricity e/c while the journal turns with `omega` about an axis that stands still [N].
    pub fn load_n(&self, eccentricity: f64, omega: f64) -> f64 {
        let (k, s2) = (eccentricity, 1.0 - eccentricity * eccentricity);
        let scale = self.viscosity_pa_s * omega.abs() * self.radius_m * self.length_m.powi(3);
        scale * k * (16.0 * k * k + PI * PI * s2).sqrt() / (4.0 * self.clearance_m * self.clearance_m * s2 * s2)
    }

    /// Where the axis stands still under a constant load [m]; None where the film cannot bear it.
    pub fn locus(&self, load: Vec2, omega: f64) -> Option<Vec2> {
        let size = load.norm();
        if size == 0.0 {
            return Some(Vec2::zeros());
        }
        if omega == 0.0 || self.load_n(LARGEST_BEARING, omega) < size {
            return None;
        }
        let (mut low, mut high) = (0.0, LARGEST_BEARING);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            *(if self.load_n(middle, omega) < size { &mut low } else { &mut high }) = middle;
        }
        let k = 0.5 * (low + high);
        let attitude_rad = crate::units::atan2(PI * (1.0 - k * k).sqrt(), 4.0 * k);
        Some(rotated(load / size, attitude_rad * omega.signum()) * (k * self.clearance_m))
    }
}

/// Largest share of the clearance at which a drive is assembled. assumed: surfaces are rougher than what is left.
const LARGEST_BEARING: f64 = 0.99;
/// The last halves the clearance to less than a rounding.
const BISECTIONS: u32 = 60;

impl std::ops::Mul<Vec2> for FilmDamping {
    type Output = Vec2;

    fn mul(self, v: Vec2) -> Vec2 {
        Vec2::new(self.xx * v.x + self.xy * v.y, self.xy * v.x + self.yy * v.y)
    }
}

/// b of the file's head, by r = D h / m.
fn implicit_share(r: f64) -> f64 {
    if r < 1e-3 {
        return 0.5 + r * (1.0 / 12.0);
    }
    let decayed = -libm::expm1(-r);
    1.0 / decayed - 1.0 / r
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEARING: PlainBearing =
        PlainBearing { radius_m: 0.015, length_m: 0.02, clearance_m: 35e-6, viscosity_pa_s: 0.01 };

    /// Integrals of the half circle of pressure by the midpoint rule, for eccentricities 0.1 to 0.9 and squeezing in all directions.
    #[test]
    fn impedance_is_the_integral_of_the_pressure() {
        let b = &BEARING;
        for k in [0.0, 0.1, 0.3, 0.5, 0.7, 0.9] {
            for direction in 0..12 {
                let way = rotated(Vec2::new(k * b.clearance_m, 0.0), 0.7);
                let v = rotated(Vec2::new(0.02, 0.0), 0.1 + f64::from(direction) * PI / 6.0);
                let force = b.force(way, v, 0.0);
                let n = 400_000;
                let mut sum = Vec2::zeros();
                for i in 0..n {
                    let at = crate::geometry::unit((i as f64 + 0.5) * 2.0 * PI / n as f64);
                    let h = b.clearance_m - way.dot(&at);
                    sum -= at * (v.dot(&at).max(0.0) / h.powi(3) * 2.0 * PI / n as f64);
                }
                sum *= b.viscosity_pa_s * b.radius_m * b.length_m.powi(3);
                assert!((force - sum).norm() < 1e-8 * sum.norm(), "{k} {direction}: {force} {sum}");
            }
        }
    }

    /// Ocvirk's closed form of an axis that stands still, and the locus back from its load.
    #[test]
    fn an_axis_at_rest_lies_on_ocvirks_locus() {
        let b = &BEARING;
        for omega in [300.0, -80.0] {
            for k in [0.05, 0.2, 0.5, 0.8, 0.95] {
                let way = rotated(Vec2::new(k * b.clearance_m, 0.0), -2.0);
                let force = b.force(way, Vec2::zeros(), omega);
                let radial = way.normalize();
                let s2: f64 = 1.0 - k * k;
                let scale = b.viscosity_pa_s * omega.abs() * b.radius_m * b.length_m.powi(3) / b.clearance_m.powi(2);
                let inwards = scale * k * k / (s2 * s2);
                let across = scale * PI * k / (4.0 * (s2 * s2.sqrt())) * omega.signum();
                let expected = perp(radial) * across - radial * inwards;
                assert!((force - expected).norm() < 1e-12 * expected.norm(), "{k} {omega}: {force} {expected}");
                let back = b.locus(-force, omega).expect("the film bears it");
                assert!((back - way).norm() < 1e-12 * way.norm(), "{k} {omega}: {back} {way}");
            }
        }
        assert!(b.locus(Vec2::new(1e9, 0.0), 300.0).is_none());
        assert!(b.locus(Vec2::new(1.0, 0.0), 0.0).is_none());
    }

    /// The film loses energy whatever the journal does.
    #[test]
    fn what_is_lost_is_what_the_squeeze_and_the_shear_take() {
        let b = &BEARING;
        for i in 0..200 {
            let at = |k: u32| rotated(Vec2::new(1.0, 0.0), f64::from(i * k) * 0.37);
            let way = at(1) * (b.clearance_m * f64::from(i % 10) * 0.099);
            let (v, omega) = (at(5) * 0.05, f64::from(i % 7) * 100.0 - 300.0);
            let force = b.force(way, v, omega);
            let lost = -force.dot(&v) - b.torque_nm(way, force, omega) * omega;
            let squeeze = v - perp(way) * (0.5 * omega);
            let couette = -b.torque_nm(way, Vec2::zeros(), omega) * omega;
            let expected = squeeze.dot(&(b.damping(way, squeeze) * squeeze)) + couette;
            assert!((lost - expected).abs() < 1e-9 * expected && lost >= 0.0, "{i}: {lost} {expected}");
        }
    }

    /// A journal under a rotating force: halving the step divides the error by four, and a step ten times the film's time constant does not ring.
    #[test]
    fn steps_are_of_second_order_and_bear_a_stiff_film() {
        let b = &BEARING;
        // From rest at the middle: the way after 2 ms.
        let run = |mass_kg: f64, step_s: f64| {
            let (mut way, mut v, mut a) = (Vec2::zeros(), Vec2::zeros(), Vec2::zeros());
            let mut ringing = 0.0_f64;
            for n in 0..(2e-3 / step_s).round() as usize {
                let others = Vec2::new(300.0, 0.0) + rotated(Vec2::new(100.0, 0.0), 800.0 * n as f64 * step_s);
                // The half step behind the start is one too.
                if n == 0 {
                    a = others / mass_kg;
                    v = -a * (0.5 * step_s);
                }
                let journal = Journal {
                    mass_kg,
                    way,
                    velocity_before: v,
                    velocity: v + a * (0.5 * step_s),
                    omega: 300.0,
                    others,
                };
                let force = b.step(step_s, &journal).force;
                let next = (others + force) / mass_kg;
                if n > 20 {
                    ringing = ringing.max((next - a).norm() * step_s);
                }
                a = next;
                v += a * step_s;
                way += v * step_s;
            }
            (way, ringing)
        };
        let ways: Vec<Vec2> = [4e-6, 2e-6, 1e-6, 0.5e-6].map(|h| run(0.5, h).0).to_vec();
        let errors: Vec<f64> = ways.windows(2).map(|w| (w[0] - w[1]).norm()).collect();
        println!("a journal's way, differences of halved steps: {errors:?} m");
        assert!(errors.windows(2).all(|e| e[1] < 0.35 * e[0]), "{errors:?}");
        // 20 g on a film of some 1e5 N s/m: the time constant is a twentieth of the step.
        let (way, ringing) = run(0.02, 4e-6);
        println!("light journal: way off by {:e} m, speed rings by {ringing:e} m/s", (way - ways[3]).norm());
        assert!((way - ways[3]).norm() < 0.02 * way.norm() && ringing < 1e-4, "{way} {ringing}");
    }
}
