//! Rollers on their bushes, many at a time: a circle in a larger one.
//!
//! d is the way from the bush's axis to the roller's, e = |d|, c the play (radius of the bore less that of the bush):
//! ```text
//! penetration = e - c      normal out of the bush, onto the roller: n = -d/e      tangent t = n turned by +90 degrees
//! point of contact: r_b n from the bush's axis, R n from the roller's, R = r_b + e
//! sliding speed = (v_r - v_b) . t + omega_r R - omega_b r_b
//! w_n = 1/m_r + 1/m_b + (l h x n)^2 / J_b      w_t = 1/m_r + R^2 / J_r + 1/m_b + (l h . n + r_b)^2 / J_b
//! ```
//! h is the heading of the link that carries the bush, l the signed lever of its joint. The laws are those of all contacts: means over the
//! step after [`super::contact_law`] and [`super::friction`]. The pair of forces acts at the point of contact and is without moment. The normal
//! turns as the roller rolls round its bush: that is the curvature 1/e of a contact in a concave seat whose centre moves.
//!
//! At rest a roller between a tooth and its bush is two springs in series, and all three centres lie on one normal: the bush then sees the tooth
//! as a roller would that is smaller by the play ([`Bore::at_rest`]).

use super::bush_tooth::{Lanes, ToothedBody, normal_forces, rates_of_seat};
use crate::elements::contact_law::{ContactLaw, Elastic, PairRadii};
use crate::elements::friction;
use crate::lanes::{LANES, LaneBlock};

/// How the rollers of a chain touch their bushes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bore {
    /// Outside radius of the bush [m].
    pub bush_radius_m: f64,
    /// Radius of the bore less that of the bush [m].
    pub clearance_m: f64,
    pub law: ContactLaw,
    pub friction: f64,
    pub stick_speed_m_s: f64,
}

/// What a block of rollers needs beside its [`Lanes`]: their spin [rad/s], inverse mass and inertia.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollerLanes {
    pub omega: LaneBlock,
    pub inverse_mass: LaneBlock,
    pub inverse_inertia: LaneBlock,
}

impl Bore {
    /// Radii for laws that depend on them.
    pub fn radii(&self) -> PairRadii {
        PairRadii { bush_m: self.bush_radius_m, body_m: -(self.bush_radius_m + self.clearance_m) }
    }

    /// Forces of all lanes on the rollers. Lanes come with the motion of the roller's axis less that of the bush's (x, y, vx, vy, ax, ay), the
    /// link that carries the bush (omega, heading, lever, inverse mass and inertia) and the memory of the contact. They leave with the force on
    /// the roller, its moment about the roller's axis in `moment`, in `torque` the moment of the opposite force about the bush's axis, and in
    /// `mobility` half a step's speed by a unit of friction.
    #[inline(always)]
    pub fn forces(&self, step: f64, roller: &RollerLanes, lanes: &mut Lanes) {
        let bush_m = self.bush_radius_m;
        let bore_m = -(bush_m + self.clearance_m);
        for i in 0..LANES {
            let d2 = lanes.x[i] * lanes.x[i] + lanes.y[i] * lanes.y[i];
            let distance = if d2 > SMALLEST_M2 { d2 } else { SMALLEST_M2 }.sqrt();
            lanes.curvature[i] = 1.0 / distance;
            lanes.penetration[i] = distance - self.clearance_m;
            (lanes.normal_x[i], lanes.normal_y[i]) = (-lanes.x[i] / distance, -lanes.y[i] / distance);
            lanes.body_radius[i] = bore_m;
            lanes.inverse_mass[i] += roller.inverse_mass[i];
        }
        rates_of_seat(step, lanes);
        normal_forces(&self.law, &[bush_m; LANES], step, lanes);
        let half = 0.5 * step;
        for i in 0..LANES {
            let (nx, ny) = (lanes.normal_x[i], lanes.normal_y[i]);
            let outside_m = bush_m + self.clearance_m + lanes.penetration[i];
            let passing = lanes.vy[i] * nx - lanes.vx[i] * ny;
            let slide = passing + roller.omega[i] * outside_m - lanes.omega[i] * bush_m;
            let lever = lanes.lever[i] * (lanes.cos[i] * nx + lanes.sin[i] * ny) + bush_m;
            let of_link = lanes.inverse_mass[i] + lanes.inverse_inertia[i] * lever * lever;
            let mobility = half * (of_link + roller.inverse_inertia[i] * outside_m * outside_m);
            let free = slide - mobility * lanes.tangential_force[i];
            let fn_ = lanes.normal_force[i];
            let ft = friction::solved_force(self.friction, fn_, free, self.stick_speed_m_s, mobility);
            let slid = free + mobility * ft;
            lanes.slide[i] = slid;
            lanes.tangential_force[i] = ft;
            lanes.lost_friction[i] = -ft * slid * step;
            (lanes.force_x[i], lanes.force_y[i]) = (fn_ * nx - ft * ny, fn_ * ny + ft * nx);
            lanes.moment[i] = outside_m * ft;
            lanes.torque[i] = -bush_m * ft;
            lanes.mobility[i] = mobility;
        }
    }

    /// What a bush at rest feels of a tooth through its roller: both springs give way by `d` together.
    pub fn at_rest(&self, d: f64, (tooth, radii): (&ContactLaw, PairRadii)) -> Elastic {
        if d <= 0.0 {
            return Elastic { force_n: 0.0, stiffness_n_per_m: 0.0, energy_j: 0.0 };
        }
        // The share of the tooth: where both forces are one. Bisection, because laws may begin without stiffness.
        let (mut low, mut high) = (0.0, d);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if tooth.elastic(middle, radii).force_n < self.law.elastic(d - middle, self.radii()).force_n {
                low = middle;
            } else {
                high = middle;
            }
        }
        let share = 0.5 * (low + high);
        let (first, second) = (tooth.elastic(share, radii), self.law.elastic(d - share, self.radii()));
        let softness = 1.0 / first.stiffness_n_per_m + 1.0 / second.stiffness_n_per_m;
        Elastic {
            force_n: second.force_n,
            stiffness_n_per_m: 1.0 / softness,
            energy_j: first.energy_j + second.energy_j,
        }
    }

    /// Penetration of the bore under a force [m].
    pub fn penetration_m(&self, force_n: f64) -> f64 {
        let (mut low, mut high) = (0.0, MOST_M);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.law.elastic(middle, self.radii()).force_n < force_n {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }
}

/// Friction of one of the two contacts of a roller, over a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollerFriction {
    pub mu: f64,
    pub stick_speed_m_s: f64,
    pub normal_n: f64,
    /// Half a step's sliding speed by a unit of this friction [m/(s N)].
    pub mobility: f64,
    /// Friction a step ago, and now [N].
    pub past_n: f64,
    pub force_n: f64,
    /// Sliding speed that this friction works with, the other's of a step ago [m/s].
    pub slide_m_s: f64,
}

impl RollerFriction {
    /// Its force where the other has changed the sliding speed by so much.
    #[inline(always)]
    fn solve(&mut self, without_m_s: f64, by_other_m_s: f64) {
        let free = without_m_s + by_other_m_s;
        self.force_n = friction::solved_force(self.mu, self.normal_n, free, self.stick_speed_m_s, self.mobility);
        self.slide_m_s = free + self.mobility * self.force_n;
    }
}

/// Friction of tooth and bush on one roller, solved together: each alone would stop the roller's spin, and two that see each other a step late
/// would stop it twice. `mixed`: half a step's sliding speed at one by a unit of friction at the other. Gauss-Seidel: its error falls to a
/// quarter or less with every sweep, because each force changes its own sliding speed at least as much as the other's, and the stick speed is
/// at least what its force does in half a step.
#[inline(always)]
pub fn solve_together(tooth: &mut RollerFriction, bush: &mut RollerFriction, mixed: f64) {
    let without = |f: &RollerFriction| f.slide_m_s - f.mobility * f.force_n;
    let (tooth_m_s, bush_m_s) = (without(tooth), without(bush));
    for _ in 0..SWEEPS {
        let before = [tooth.force_n, bush.force_n];
        tooth.solve(tooth_m_s, mixed * (bush.force_n - bush.past_n));
        bush.solve(bush_m_s, mixed * (tooth.force_n - tooth.past_n));
        if before == [tooth.force_n, bush.force_n] {
            break;
        }
    }
    tooth.slide_m_s = tooth_m_s + mixed * (bush.force_n - bush.past_n) + tooth.mobility * tooth.force_n;
}

/// Most sweeps of [`solve_together`]: the error left is below 4^-16 = 2e-10 of the first one. Where forces stop changing it ends before.
const SWEEPS: u32 = 16;

/// What a gap holds at rest: a bush, or a roller with its bush on it.
#[derive(Clone, Copy, Debug)]
pub struct RestingBush<'a> {
    /// Radius that the tooth seems to have met [m]: of bush or roller, less the play of the roller.
    pub radius_m: f64,
    tooth: &'a ToothedBody,
    bore: Option<&'a Bore>,
}

impl<'a> RestingBush<'a> {
    /// On a sprocket, with the play of its chain's rollers.
    pub fn new(tooth: &'a ToothedBody, bore: Option<&'a Bore>) -> RestingBush<'a> {
        RestingBush { radius_m: tooth.bush_radius_m - bore.map_or(0.0, |b| b.clearance_m), tooth, bore }
    }

    /// Force, stiffness and energy where the bush is pressed `d` into a contour of this radius of curvature [m].
    pub fn elastic(&self, d: f64, body_radius_m: f64) -> Elastic {
        let radii = PairRadii { bush_m: self.tooth.bush_radius_m, body_m: body_radius_m };
        match self.bore {
            None => self.tooth.law.elastic(d, radii),
            Some(bore) => bore.at_rest(d, (&self.tooth.law, radii)),
        }
    }

    /// Damping under a load: of the tooth, and of the bore one behind the other [N s/m].
    pub fn damping_n_s_per_m(&self, force_n: f64) -> f64 {
        let of_tooth = self.tooth.law.damping_at(force_n);
        let Some(bore) = self.bore else { return of_tooth };
        let of_bore = bore.law.damping_at(force_n);
        if of_tooth + of_bore > 0.0 { of_tooth * of_bore / (of_tooth + of_bore) } else { 0.0 }
    }
}

/// Below this squared distance a roller is as good as in the middle of its play [m2]: no direction is told any more.
const SMALLEST_M2: f64 = 1e-24;
/// Until an interval has no more floats in it.
const HALVINGS: u32 = 80;
/// More than any bore is pressed in [m].
const MOST_M: f64 = 1e-3;

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;

    /// Without friction a roller that circles a bush which stands still is a point mass on a circle: k (e - c) = m v^2 / e.
    #[test]
    fn a_roller_circles_its_bush() {
        let law = ContactLaw::Linear { stiffness_n_per_m: 1e6, damping_n_s_per_m: 0.0 };
        let bore = Bore { bush_radius_m: 2e-3, clearance_m: 1e-3, law, friction: 0.0, stick_speed_m_s: 0.1 };
        let (mass, e) = (1e-3, 1.05e-3);
        let speed = libm::sqrt(1e6 * (e - 1e-3) * e / mass);
        let turn_s = 2.0 * std::f64::consts::PI * e / speed;
        let errors = [200.0, 400.0, 800.0].map(|steps| {
            let h = turn_s / steps;
            // A leapfrog: the velocity is half a step behind.
            let a = speed * speed / e;
            let (mut x, mut y, mut vx, mut vy) = (e, 0.0, 0.5 * h * a, speed);
            let mut lanes = Lanes::default();
            let mut past = [-a, 0.0];
            lanes.normal_force = [mass * a; LANES];
            lanes.age = [1.0; LANES];
            let roller =
                RollerLanes { omega: [0.0; LANES], inverse_mass: [1.0 / mass; LANES], inverse_inertia: [0.0; LANES] };
            for _ in 0..steps as usize {
                (lanes.x, lanes.y) = ([x; LANES], [y; LANES]);
                (lanes.vx, lanes.vy) = ([vx + 0.5 * h * past[0]; LANES], [vy + 0.5 * h * past[1]; LANES]);
                (lanes.ax, lanes.ay) = ([past[0]; LANES], [past[1]; LANES]);
                lanes.inverse_mass = [0.0; LANES];
                bore.forces(h, &roller, &mut lanes);
                past = [lanes.force_x[0] / mass, lanes.force_y[0] / mass];
                (vx, vy) = (vx + h * past[0], vy + h * past[1]);
                (x, y) = (x + h * vx, y + h * vy);
            }
            libm::hypot(x - e, y) / e
        });
        println!("{errors:?}");
        // measured: see the factor of four.
        assert!(errors[0] < 2e-3 && errors[0] / errors[1] > 3.5 && errors[1] / errors[2] > 3.5, "{errors:?}");
    }

    /// Springs in series, whatever their laws.
    #[test]
    fn a_bush_at_rest_feels_both_springs() {
        let law = ContactLaw::Linear { stiffness_n_per_m: 1e8, damping_n_s_per_m: 50.0 };
        let bore = Bore { bush_radius_m: 1.8e-3, clearance_m: 4e-5, law, friction: 0.1, stick_speed_m_s: 0.05 };
        let radii = PairRadii { bush_m: 2.5e-3, body_m: -2.6e-3 };
        let tooth = ContactLaw::Linear { stiffness_n_per_m: 3e8, damping_n_s_per_m: 50.0 };
        let both = bore.at_rest(1e-6, (&tooth, radii));
        assert!((both.force_n / 75.0 - 1.0).abs() < 1e-9 && (both.stiffness_n_per_m / 0.75e8 - 1.0).abs() < 1e-9);
        assert!((both.energy_j / (0.5 * 75.0 * 1e-6) - 1.0).abs() < 1e-9);
        assert!((bore.penetration_m(75.0) / 0.75e-6 - 1.0).abs() < 1e-9);
        // A law that begins without stiffness.
        let tooth = ContactLaw::Power { stiffness_n_per_m_n: 1e10, exponent: 1.5, hysteresis: 0.0 };
        let both = bore.at_rest(1e-6, (&tooth, radii));
        let share = 1e-6 - both.force_n / 1e8;
        assert!((tooth.elastic(share, radii).force_n / both.force_n - 1.0).abs() < 1e-9);
        let slope = (bore.at_rest(1e-6 + 1e-10, (&tooth, radii)).force_n - both.force_n) / 1e-10;
        assert!((slope / both.stiffness_n_per_m - 1.0).abs() < 1e-3);
    }

    /// Two frictions on one roller, solved together, leave no more of either sliding speed than both can stop.
    #[test]
    fn frictions_solved_together_fit_each_other() {
        let one = |mu: f64, mobility: f64, slide: f64| RollerFriction {
            mu,
            stick_speed_m_s: 1e-3,
            normal_n: 100.0,
            mobility,
            past_n: 0.0,
            force_n: 0.0,
            slide_m_s: slide,
        };
        let (mut tooth, mut bush) = (one(0.1, 0.02, 0.3), one(0.1, 0.015, -0.2));
        let mixed = -0.016;
        solve_together(&mut tooth, &mut bush, mixed);
        for (own, other) in [(&tooth, &bush), (&bush, &tooth)] {
            let first = if std::ptr::eq(own, &tooth) { 0.3 } else { -0.2 };
            let slide = first + own.mobility * own.force_n + mixed * other.force_n;
            assert!((slide - own.slide_m_s).abs() < 1e-9, "{slide} {}", own.slide_m_s);
            let alone = friction::solved_force(
                own.mu,
                own.normal_n,
                slide - own.mobility * own.force_n,
                own.stick_speed_m_s,
                own.mobility,
            );
            assert!((alone - own.force_n).abs() < 1e-8, "{alone} {}", own.force_n);
        }
    }
}
