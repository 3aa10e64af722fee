//! Contact laws: normal force from penetration d and its rate d'.
//!
//! Every law here has the form F = F_e(d) + G(d) d', clipped at zero (contacts do not pull), with the elastic part F_e
//! integrable to an energy:
//! ```text
//! linear                F_e = k d              G = c
//! Hertz line contact    F_e from d(F), below   G = c
//! Lankarani-Nikravesh   F_e = K d^n            G = lambda F_e / v_0,  lambda = 3 (1 - e^2) / 4
//! restitution           F_e = K d^n            G = lambda F_e / v_0,  lambda from  lambda (1 + e) = ln[(1 + lambda) / (1 - lambda e)]
//! ```
//! v_0 is the approach speed at first touch. The last line is exact: the law returns the coefficient of restitution e that
//! was asked for, whatever n, K and mass, while Lankarani-Nikravesh returns 0.8005 for 0.71 (Lankarani & Nikravesh 1990,
//! their approximation holds near e = 1).
//!
//! Hertz line contact (Johnson 1985, section 4.6 and eq. 5.57; two cylinders, load per length q = F / b):
//! d = q/pi * sum_i (1 - nu_i^2)/E_i [2 ln(4 R_i / a) - 1], a = sqrt(4 q R* / (pi E*)). That is d = q (alpha - beta ln q); F
//! follows by Newton's method. Holds while a << R and below the load where d(q) would turn; outside it is an error.
//!
//! # The mean force over a step
//! What sets the error of an explicit step is where inside it first touch falls: the damping force jumps there. So the
//! force that enters a step is its mean over [t_n - h/2, t_n + h/2] with the gap taken linear in time, in closed form for the
//! linear law and by quadrature for the others. With w, the inverse effective mass along the normal, contact and link end are
//! locally an oscillator d'' = a - w F, a from everything else. The velocity at t_n is solved for with the force since the
//! touch; while the contact stays closed the mean gains (h^2/24) F''; in the step of first touch the mean of the linear law is
//! the series of that oscillator from the touch on. Without the series, and with the own force reckoned over the whole half
//! step, a single impact at omega h = 0.5 has a peak 0.4 % and a rebound 0.6 % too high, averaged over all phases of the
//! touch; with them -0.2 % and -0.1 %.

use std::f64::consts::PI;

/// Normal force law of a contact pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ContactLaw {
    Linear {
        stiffness_n_per_m: f64,
        damping_n_s_per_m: f64,
    },
    HertzLine(HertzLine),
    /// `hysteresis` is lambda.
    Power {
        stiffness_n_per_m_n: f64,
        exponent: f64,
        hysteresis: f64,
    },
}

/// Two steel (or other) cylinders of length b.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HertzLine {
    pub length_m: f64,
    /// (1 - nu^2)/E of body and bush [1/Pa].
    pub compliance_body_per_pa: f64,
    pub compliance_bush_per_pa: f64,
    pub damping_n_s_per_m: f64,
}

/// Approach speeds below this are taken as this [m/s]: a contact that begins at rest must not divide by zero.
pub const SLOWEST_APPROACH_M_S: f64 = 1e-3;

/// Force and rate coefficient at one penetration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elastic {
    /// F_e [N].
    pub force_n: f64,
    /// dF_e/dd [N/m].
    pub stiffness_n_per_m: f64,
    /// Integral of F_e [J].
    pub energy_j: f64,
}

/// lambda of Lankarani and Nikravesh (1990) for restitution `e`.
pub fn lankarani_nikravesh_hysteresis(e: f64) -> f64 {
    0.75 * (1.0 - e * e)
}

/// lambda that returns exactly the restitution `e` in 0 < e <= 1: root of lambda (1 + e) = ln[(1 + lambda)/(1 - lambda e)].
pub fn restitution_hysteresis(e: f64) -> f64 {
    if e >= 1.0 {
        return 0.0;
    }
    let residual = |l: f64| libm::log((1.0 + l) / (1.0 - l * e)) - l * (1.0 + e);
    // The trivial root is 0; the wanted one lies between 0 and 1/e, where the residual goes to +infinity.
    let (mut low, mut high) = (1e-9, (1.0 - 1e-15) / e);
    // Below the root the residual is negative, for e < 1.
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if residual(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

impl HertzLine {
    /// (alpha, beta) of d = q (alpha - beta ln q). `body_radius_m` negative: concave.
    fn coefficients(&self, bush_radius_m: f64, body_radius_m: f64) -> (f64, f64) {
        let compliance = self.compliance_body_per_pa + self.compliance_bush_per_pa;
        let relative_radius = 1.0 / (1.0 / bush_radius_m + 1.0 / body_radius_m);
        // a^2 = q width2
        let width2 = 4.0 * relative_radius * compliance / PI;
        let term = |c: f64, r: f64| c * (2.0 * libm::log(4.0 * r) - libm::log(width2) - 1.0);
        let alpha = (term(self.compliance_bush_per_pa, bush_radius_m)
            + term(self.compliance_body_per_pa, body_radius_m.abs()))
            / PI;
        (alpha, compliance / PI)
    }

    /// Elastic part at penetration `d` [m].
    pub fn elastic(&self, d: f64, bush_radius_m: f64, body_radius_m: f64) -> Elastic {
        if d <= 0.0 {
            return Elastic { force_n: 0.0, stiffness_n_per_m: 0.0, energy_j: 0.0 };
        }
        // A corner has no radius: take the bush's own, the sharpest that the formula bears.
        let body_radius_m = if body_radius_m == 0.0 { bush_radius_m } else { body_radius_m };
        let (alpha, beta) = self.coefficients(bush_radius_m, body_radius_m);
        // d(q) is concave and rises up to ln q = alpha/beta - 1: Newton from below converges monotonically.
        let turning = libm::exp(alpha / beta - 1.0);
        let mut q = (d / alpha.max(beta)).min(0.5 * turning);
        for _ in 0..60 {
            let value = q * (alpha - beta * libm::log(q)) - d;
            let slope = alpha - beta - beta * libm::log(q);
            let next = (q - value / slope).clamp(1e-3 * q, turning);
            if (next - q).abs() <= 1e-15 * q {
                break;
            }
            q = next;
        }
        let slope = alpha - beta - beta * libm::log(q);
        // Energy per length = q d - integral of d(q) dq.
        let integral = 0.5 * q * q * (alpha - beta * libm::log(q)) + 0.25 * beta * q * q;
        Elastic {
            force_n: self.length_m * q,
            stiffness_n_per_m: self.length_m / slope,
            energy_j: self.length_m * (q * d - integral),
        }
    }
}

/// Shape of the pair, for laws that depend on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairRadii {
    pub bush_m: f64,
    /// Negative concave, zero at a corner, infinite on a line.
    pub body_m: f64,
}

impl ContactLaw {
    /// Elastic part at penetration `d` [m].
    pub fn elastic(&self, d: f64, radii: PairRadii) -> Elastic {
        if d <= 0.0 {
            return Elastic { force_n: 0.0, stiffness_n_per_m: 0.0, energy_j: 0.0 };
        }
        match *self {
            ContactLaw::Linear { stiffness_n_per_m: k, .. } => {
                Elastic { force_n: k * d, stiffness_n_per_m: k, energy_j: 0.5 * k * d * d }
            }
            ContactLaw::HertzLine(hertz) => hertz.elastic(d, radii.bush_m, radii.body_m),
            ContactLaw::Power { stiffness_n_per_m_n, exponent, .. } => {
                let force_n = stiffness_n_per_m_n * libm::pow(d, exponent);
                Elastic { force_n, stiffness_n_per_m: exponent * force_n / d, energy_j: force_n * d / (exponent + 1.0) }
            }
        }
    }

    /// G of F = F_e + G d' [N s/m].
    pub fn rate_coefficient(&self, elastic_force_n: f64, approach_m_s: f64) -> f64 {
        match *self {
            ContactLaw::Linear { damping_n_s_per_m, .. } => damping_n_s_per_m,
            ContactLaw::HertzLine(hertz) => hertz.damping_n_s_per_m,
            ContactLaw::Power { hysteresis, .. } => {
                hysteresis * elastic_force_n / approach_m_s.max(SLOWEST_APPROACH_M_S)
            }
        }
    }

    /// Force at one instant [N]: zero when open or when damping would pull.
    pub fn force(&self, d: f64, rate_m_s: f64, approach_m_s: f64, radii: PairRadii) -> f64 {
        if d <= 0.0 {
            return 0.0;
        }
        let elastic = self.elastic(d, radii).force_n;
        (elastic + self.rate_coefficient(elastic, approach_m_s) * rate_m_s).max(0.0)
    }

    /// Largest stiffness up to `force_n` [N/m], for the bound on the step.
    pub fn stiffness_at(&self, force_n: f64, radii: PairRadii) -> f64 {
        match *self {
            ContactLaw::Linear { stiffness_n_per_m, .. } => stiffness_n_per_m,
            ContactLaw::HertzLine(hertz) => {
                let mut d = 1e-6;
                while hertz.elastic(d, radii.bush_m, radii.body_m).force_n < force_n && d < 1e-3 {
                    d *= 1.1;
                }
                hertz.elastic(d, radii.bush_m, radii.body_m).stiffness_n_per_m
            }
            ContactLaw::Power { stiffness_n_per_m_n, exponent, .. } => {
                let d = libm::pow(force_n / stiffness_n_per_m_n, 1.0 / exponent);
                exponent * force_n / d
            }
        }
    }

    /// Largest rate coefficient up to `force_n` [N s/m], for the bound on the step.
    pub fn damping_at(&self, force_n: f64) -> f64 {
        match *self {
            ContactLaw::Linear { damping_n_s_per_m, .. } => damping_n_s_per_m,
            ContactLaw::HertzLine(hertz) => hertz.damping_n_s_per_m,
            // Peaks come from impacts of the order of 1 m/s.
            ContactLaw::Power { hysteresis, .. } => hysteresis * force_n,
        }
    }
}

/// One contact over one step: what goes into [`linear_step`] and [`power_step`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepInput {
    /// Penetration at the node [m], negative: gap.
    pub penetration: f64,
    /// Closing speed at the node if this contact had exerted no force since half a step before [m/s].
    pub free_rate: f64,
    /// Acceleration of the penetration by everything else [m/s2].
    pub free_acceleration: f64,
    /// Inverse effective mass along the normal [1/kg].
    pub mobility: f64,
    /// Approach speed at first touch [m/s].
    pub approach: f64,
    /// Step h [s].
    pub step: f64,
}

/// What a contact does over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepForce {
    /// Mean force over [t_n - h/2, t_n + h/2] [N].
    pub mean_force: f64,
    /// Closing speed at the node [m/s].
    pub rate: f64,
    /// Energy lost to damping over the step [J].
    pub lost: f64,
}

/// Mean force of the linear law over the step, in closed form. Branch-free, so that lanes of contacts vectorise.
#[inline(always)]
pub fn linear_step(k: f64, c: f64, s: StepInput) -> StepForce {
    let half = 0.5 * s.step;
    let d = s.penetration;
    // Velocity at the node with this contact's own force over the closed part of the half step before it.
    let closed = d > 0.0;
    let since_touch = if closed & (s.free_rate * half > d) { d / s.free_rate } else { half };
    let node_force = (k * d + c * s.free_rate) / (1.0 + c * s.mobility * since_touch);
    let own = if closed & (node_force > 0.0) { since_touch * s.mobility * node_force } else { 0.0 };
    let rate = s.free_rate - own;
    // F(tau) = a + b tau on the part of [-half, half] where the gap is closed and the force does not pull.
    let a = k * d + c * rate;
    let b = k * rate;
    let safe_rate = if rate.abs() < 1e-12 { 1e-12 } else { rate };
    let closing = safe_rate > 0.0;
    let root_numerator = if closing { d } else { a / k };
    let root = -root_numerator / safe_rate;
    let root = if root > half { half } else { root };
    let root = if root < -half { -half } else { root };
    let low = if closing { root } else { -half };
    let high = if closing { half } else { root };
    let span = high - low;
    let mean = (a * span + 0.5 * b * (high - low) * (high + low)) / s.step;
    // While closed throughout: curvature of the force from the local oscillator, (h^2/24) F''.
    let w = s.mobility;
    let acceleration = s.free_acceleration - w * a;
    let slope = k * rate + c * acceleration;
    let bend = k * acceleration - c * w * slope;
    let full = span >= s.step;
    let through = mean + s.step * s.step * bend / 24.0;
    // Touched within this step: series of the same oscillator from the touch, where d = 0 and the rate is still free.
    let force0 = c * s.free_rate;
    let acceleration0 = s.free_acceleration - w * force0;
    let slope0 = k * s.free_rate + c * acceleration0;
    let bend0 = k * acceleration0 - c * w * slope0;
    let entry = span * (force0 + span * (0.5 * slope0 + span * (bend0 / 6.0))) / s.step;
    let mean = if closing & (span > 0.0) { entry } else { mean };
    let mean = if full { through } else { mean };
    let mean = if mean > 0.0 { mean } else { 0.0 };
    StepForce { mean_force: mean, rate, lost: c * rate * rate * span }
}

/// Mean force of any law over the step, by Gauss-Legendre quadrature on the closed part.
pub fn quadrature_step(law: &ContactLaw, radii: PairRadii, s: StepInput) -> StepForce {
    // 3 points (Abramowitz & Stegun 25.4.29).
    const NODES: [(f64, f64); 3] =
        [(-0.774_596_669_241_483_4, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.774_596_669_241_483_4, 5.0 / 18.0)];
    let half = 0.5 * s.step;
    let d = s.penetration;
    let elastic = law.elastic(d, radii);
    let g = law.rate_coefficient(elastic.force_n, s.approach);
    let since_touch = if d > 0.0 && s.free_rate * half > d { d / s.free_rate } else { half };
    let node_force = (elastic.force_n + g * s.free_rate) / (1.0 + g * s.mobility * since_touch);
    let own = if d > 0.0 && node_force > 0.0 { since_touch * s.mobility * node_force } else { 0.0 };
    let rate = s.free_rate - own;
    let root = if rate.abs() < 1e-12 { if d > 0.0 { -half } else { half } } else { (-d / rate).clamp(-half, half) };
    let (low, high) = if rate >= 0.0 { (root, half) } else { (-half, root) };
    let span = high - low;
    if span <= 0.0 {
        return StepForce { mean_force: 0.0, rate, lost: 0.0 };
    }
    let (mut mean, mut lost) = (0.0, 0.0);
    for (x, w) in NODES {
        let tau = low + 0.5 * span * (x + 1.0);
        let at = law.elastic(d + rate * tau, radii).force_n;
        let force = at + law.rate_coefficient(at, s.approach) * rate;
        let force = if force > 0.0 { force } else { 0.0 };
        mean += w * force * span / s.step;
        lost += w * (force - at) * rate * span;
    }
    if span >= s.step {
        let acceleration = s.free_acceleration - s.mobility * node_force;
        let k = elastic.stiffness_n_per_m;
        let jerk_force = k * rate + g * acceleration;
        let second = k * acceleration - g * s.mobility * jerk_force;
        // Quadrature already holds the curvature that comes from the law's own shape; this is the gap's.
        mean = (mean + s.step * s.step * second / 24.0).max(0.0);
    }
    StepForce { mean_force: mean, rate, lost }
}
