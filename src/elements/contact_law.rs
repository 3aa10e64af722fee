//! Contact laws: normal force from penetration d and its rate d'.
//!
//! Every law here has the form F = F_e(d) + G(d) d', clipped at zero (contacts do not pull), with the elastic part F_e
//! integrable to an energy:
//! ```text
//! linear                F_e = k d              G = c
//! Hertz line contact    F_e from d(F), below   G = c
//! Hunt-Crossley         F_e = K d^n            G = chi F_e
//! Winkler foundation    F_e from u(s), below   G = chi F_e
//! Lankarani-Nikravesh   F_e = K d^n            G = lambda F_e / v_0,  lambda = 3 (1 - e^2) / 4
//! restitution           F_e = K d^n            G = lambda F_e / v_0,  lambda from  lambda (1 + e) = ln[(1 + lambda) / (1 - lambda e)]
//! ```
//! v_0 is the approach speed at first touch. The last line is exact: the law returns the coefficient of restitution e that
//! was asked for, whatever n, K and mass, while Lankarani-Nikravesh returns 0.8005 for 0.71 (Lankarani & Nikravesh 1990,
//! their approximation holds near e = 1). chi = lambda / v_r of the Hunt-Crossley law (Hunt & Crossley 1975) follows from
//! the same line and is a constant: an impact at the speed v_r returns e exactly, a slower one more, as metals do; what rests is damped
//! by its load, and not by how it once came. Of the laws with G = c the force jumps to c v_0 at the touch, of the others it begins at zero.
//!
//! Hertz line contact (Johnson 1985, section 4.6 and eq. 5.57; two cylinders, load per length q = F / b):
//! d = q/pi * sum_i (1 - nu_i^2)/E_i [2 ln(4 R_i / a) - 1], a = sqrt(4 q R* / (pi E*)). That is d = q (alpha - beta ln q); F
//! follows by Newton's method. Holds while a << R and below the load where d(q) would turn; outside it is an error.
//!
//! Winkler foundation (Johnson 1985, section 4.3; Johnson's K/h is k here): a layer that gives way by u where the pressure is k u, k = E (1 - nu) / ((1 + nu) (1 - 2 nu) h), h its
//! thickness. Under a cylinder of the relative radius R, u = d - s^2/(2 R) over the half width a = sqrt(2 R d), and over a width b
//! F = b k (4/3) d a. It is no wider than the smaller radius r: beyond, F = 2 b k (r d - r^3/(6 R)), as where a bush lies in a seat of nearly its own radius; the pressure
//! counts along s there too, so that the force is 4/pi of that of pressures along the radius, pi/2 b k r d.
//!
//! # The mean force over a step
//! What sets the error of an explicit step is where inside it first touch falls: the damping force jumps there. Positions of a
//! leapfrog are those of the true motion where its acceleration is the true one's mean with weights that fall from 1/h at the node
//! to zero a step h before and after it: x(t + h) - 2 x(t) + x(t - h) is h^2 times that mean, and its velocities are means over the
//! steps. So that mean is what a contact gives. With w, the inverse effective mass along the normal, contact and link end are
//! locally an oscillator d'' = a - w F, a from everything else; of the linear and, for n = 1, the Hunt-Crossley law the mean is a series of
//! it in closed form, with F' = k d' + G d'' + k chi d'^2 and F'' = k d'' + G d''' + 3 k chi d' d'':
//! ```text
//! closed throughout     F + h^2/12 F''
//! touch within h ahead  q^2 (F_0/2 + q (F_0'/6 + q F_0''/24)) / h^2, F_0 ... at the touch, q the time left after it
//! touched within h      the first less the second with q the time before the touch, negative
//! parts within h        the first less q^3 (F_1'/6 + q F_1''/24) / h^2, F_1 ... where the force ends, q the time left after it
//! ```
//! The closing speed at the node is solved for with force, slope and bend since the touch. A single impact, averaged over all
//! phases of the touch, has its peak right to 0.03 % at omega h = 0.8 (scatter 0.05 %) and its rebound to 0.4 %
//! (scatter 0.06 %). Other laws: quadrature with the same weights, the gap linear in time.

use std::f64::consts::PI;

/// Normal force law of a contact pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ContactLaw {
    Linear {
        stiffness_n_per_m: f64,
        damping_n_s_per_m: f64,
    },
    HertzLine(HertzLine),
    Winkler(WinklerFoundation),
    /// `damping_s_per_m` is chi.
    HuntCrossley {
        stiffness_n_per_m_n: f64,
        exponent: f64,
        damping_s_per_m: f64,
    },
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

/// An elastic layer on a rigid ground, between two cylinders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WinklerFoundation {
    /// Pressure over depth times the width of the contact [N/m2].
    pub stiffness_n_per_m2: f64,
    /// chi [s/m].
    pub damping_s_per_m: f64,
}

impl WinklerFoundation {
    /// Pressure over depth of a layer that is bonded to its ground and cannot spread [N/m3].
    pub fn modulus_n_per_m3(youngs_modulus_pa: f64, poisson_ratio: f64, thickness_m: f64) -> f64 {
        let nu = poisson_ratio;
        youngs_modulus_pa * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu) * thickness_m)
    }

    /// Relative radius, and the widest half width [m]. `body_m` negative: concave.
    fn shape(radii: PairRadii) -> (f64, f64) {
        // A corner has no radius: take the bush's own.
        let body_m = if radii.body_m == 0.0 { radii.bush_m } else { radii.body_m };
        let curvature = 1.0 / radii.bush_m + 1.0 / body_m;
        // A bush as wide as its seat lies in it all round.
        let relative_m = if curvature > 0.0 { 1.0 / curvature } else { f64::INFINITY };
        (relative_m, radii.bush_m.abs().min(body_m.abs()))
    }

    /// Elastic part at penetration `d` [m].
    pub fn elastic(&self, d: f64, radii: PairRadii) -> Elastic {
        if d <= 0.0 {
            return Elastic { force_n: 0.0, stiffness_n_per_m: 0.0, energy_j: 0.0 };
        }
        let (relative_m, widest_m) = WinklerFoundation::shape(radii);
        let (b, r) = (self.stiffness_n_per_m2, widest_m);
        let fills_at_m = 0.5 * r * r / relative_m;
        if d <= fills_at_m {
            let a = libm::sqrt(2.0 * relative_m * d);
            return Elastic {
                force_n: 4.0 / 3.0 * b * d * a,
                stiffness_n_per_m: 2.0 * b * a,
                energy_j: 8.0 / 15.0 * b * d * d * a,
            };
        }
        let at_full_j = 8.0 / 15.0 * b * fills_at_m * fills_at_m * r;
        let bend_m = r * r / (6.0 * relative_m);
        let more_m = d - fills_at_m;
        Elastic {
            force_n: 2.0 * b * r * (d - bend_m),
            stiffness_n_per_m: 2.0 * b * r,
            energy_j: at_full_j + b * r * more_m * (d + fills_at_m - 2.0 * bend_m),
        }
    }

    /// Depth under a force [m].
    fn depth_m(&self, force_n: f64, radii: PairRadii) -> f64 {
        let (relative_m, r) = WinklerFoundation::shape(radii);
        let b = self.stiffness_n_per_m2;
        let fills_at_m = 0.5 * r * r / relative_m;
        if force_n > 4.0 / 3.0 * b * fills_at_m * r {
            return 0.5 * force_n / (b * r) + r * r / (6.0 * relative_m);
        }
        libm::pow(force_n / (4.0 / 3.0 * b * libm::sqrt(2.0 * relative_m)), 2.0 / 3.0)
    }
}

/// Approach speeds below this are taken as this [m/s]: a contact that begins at rest must not divide by zero.
pub const SLOWEST_APPROACH_M_S: f64 = 1e-3;

/// Step up to which forces are those of a moment [s]: shorter than any step of a run.
pub const MOMENT_S: f64 = 2e-10;

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
    /// The law of rigid contacts: another scheme finds their forces. It gives a force that is above zero, so that a touch is seen, and too small to count.
    pub const NONE: ContactLaw =
        ContactLaw::HuntCrossley { stiffness_n_per_m_n: 1e-12, exponent: 1.5, damping_s_per_m: 0.0 };

    /// Elastic part at penetration `d` [m].
    pub fn elastic(&self, d: f64, radii: PairRadii) -> Elastic {
        if d <= 0.0 {
            return Elastic { force_n: 0.0, stiffness_n_per_m: 0.0, energy_j: 0.0 };
        }
        match *self {
            ContactLaw::Linear { stiffness_n_per_m: k, .. } => {
                Elastic { force_n: k * d, stiffness_n_per_m: k, energy_j: 0.5 * k * d * d }
            }
            ContactLaw::HuntCrossley { stiffness_n_per_m_n: k, exponent: 1.0, .. } => {
                Elastic { force_n: k * d, stiffness_n_per_m: k, energy_j: 0.5 * k * d * d }
            }
            ContactLaw::HertzLine(hertz) => hertz.elastic(d, radii.bush_m, radii.body_m),
            ContactLaw::Winkler(layer) => layer.elastic(d, radii),
            ContactLaw::HuntCrossley { stiffness_n_per_m_n, exponent, .. }
            | ContactLaw::Power { stiffness_n_per_m_n, exponent, .. } => {
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
            ContactLaw::HuntCrossley { damping_s_per_m, .. }
            | ContactLaw::Winkler(WinklerFoundation { damping_s_per_m, .. }) => damping_s_per_m * elastic_force_n,
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
            ContactLaw::Winkler(layer) => layer.elastic(layer.depth_m(force_n, radii), radii).stiffness_n_per_m,
            ContactLaw::HuntCrossley { stiffness_n_per_m_n, exponent, .. }
            | ContactLaw::Power { stiffness_n_per_m_n, exponent, .. } => {
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
            ContactLaw::HuntCrossley { damping_s_per_m, .. }
            | ContactLaw::Winkler(WinklerFoundation { damping_s_per_m, .. }) => damping_s_per_m * force_n,
            // Peaks come from impacts of the order of 1 m/s.
            ContactLaw::Power { hysteresis, .. } => hysteresis * force_n,
        }
    }
}

/// The numbers of a law whose mean over a step has a closed form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClosedForm {
    /// k [N/m] and c [N s/m].
    Constant(f64, f64),
    /// k [N/m] and k chi [N s/m2]: c grows with the depth.
    Growing(f64, f64),
}

impl ContactLaw {
    /// None: the mean over a step is found by quadrature.
    #[inline(always)]
    pub fn closed_form(&self) -> Option<ClosedForm> {
        match *self {
            ContactLaw::Linear { stiffness_n_per_m: k, damping_n_s_per_m: c } => Some(ClosedForm::Constant(k, c)),
            ContactLaw::HuntCrossley { stiffness_n_per_m_n: k, exponent: 1.0, damping_s_per_m: chi } => {
                Some(ClosedForm::Growing(k, k * chi))
            }
            ContactLaw::HuntCrossley { .. }
            | ContactLaw::HertzLine(_)
            | ContactLaw::Winkler(_)
            | ContactLaw::Power { .. } => None,
        }
    }

    /// What the force is at the touch itself [N]: c v_0 where a constant damper stands beside the spring. How fast it rises then tells of the
    /// law, and nothing of the parts.
    pub fn touch_force_n(&self, approach_m_s: f64) -> f64 {
        match *self {
            ContactLaw::Linear { damping_n_s_per_m, .. } => damping_n_s_per_m * approach_m_s,
            ContactLaw::HertzLine(hertz) => hertz.damping_n_s_per_m * approach_m_s,
            ContactLaw::HuntCrossley { .. } | ContactLaw::Winkler(_) | ContactLaw::Power { .. } => 0.0,
        }
    }

    /// Whether its damping grows with the load.
    pub fn grows(&self) -> bool {
        match self {
            ContactLaw::Linear { .. } | ContactLaw::HertzLine(_) => false,
            ContactLaw::HuntCrossley { .. } | ContactLaw::Winkler(_) | ContactLaw::Power { .. } => true,
        }
    }

    /// k where F_e = k d [N/m].
    pub fn linear_stiffness_n_per_m(&self) -> Option<f64> {
        self.closed_form().map(|(ClosedForm::Constant(k, _) | ClosedForm::Growing(k, _))| k)
    }
}

/// One contact over one step: what goes into [`closed_form_step`] and [`quadrature_step`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepInput {
    /// Penetration at the node [m], negative: gap.
    pub penetration: f64,
    /// Closing speed at the node if this contact had exerted no force since the middle of the last step [m/s].
    pub free_rate: f64,
    /// Acceleration of the penetration by everything else [m/s2].
    pub free_acceleration: f64,
    /// Inverse effective mass along the normal [1/kg].
    pub mobility: f64,
    /// Mean force of this contact a step ago [N].
    pub past_force: f64,
    /// Approach speed at first touch [m/s].
    pub approach: f64,
    /// Step h [s].
    pub step: f64,
}

/// What a contact does over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepForce {
    /// Mean force with weights that fall to zero a step before and after the node [N].
    pub mean_force: f64,
    /// Closing speed at the node [m/s].
    pub rate: f64,
    /// Closing speed at the touch, where it lies within a step ahead or behind [m/s]; else zero, as for laws without a closed form.
    pub touch_rate: f64,
    /// Energy lost to damping over the step [J].
    pub lost: f64,
}

/// Where the linear law stands at a node: closing speed [m/s], force [N], its slope [N/s] and bend [N/s2].
#[derive(Clone, Copy)]
struct NodeForce {
    rate: f64,
    force: f64,
    slope: f64,
    bend: f64,
}

/// Rate, force, slope and bend at the node for a contact that has been closed for `share` of the last step. With GROWS, here and below, `c` is
/// k chi of [`ClosedForm::Growing`].
#[inline(always)]
fn node_force<const GROWS: bool>(k: f64, c: f64, s: StepInput, closed: bool, share: f64) -> NodeForce {
    let (h, d, w, others) = (s.step, s.penetration, s.mobility, s.free_acceleration);
    let own = if GROWS { c * d } else { c };
    // Closing speed r: that of the last step, and what the force since the touch adds to its mean. Force, slope and bend at
    // the node are linear in r: k d + c r, p r + c e, and p' e - c w (k' + p) r; of its square one factor is as the last step tells it.
    let first = h * share * (1.0 - share * 0.5);
    let second = h * h * share * share * (0.5 - share * (1.0 / 3.0));
    let third = h * h * h * share * share * share * (1.0 / 6.0 - share * 0.125);
    let e = others - w * k * d;
    let growth = if GROWS { c * (s.free_rate - first * w * (k * d + own * s.free_rate)) } else { 0.0 };
    let (of_slope, of_bend) = if GROWS { (k + growth, k + 3.0 * growth) } else { (k, k) };
    let taken = own * own * w;
    let p = of_slope - taken;
    let fixed = first * k * d - second * own * e + third * (of_bend - taken) * e;
    let factor = first * own - second * p - third * own * w * (of_bend + p);
    let rate = if closed { (s.free_rate - w * fixed) / (1.0 + w * factor) } else { s.free_rate };
    let force = k * d + own * rate;
    let acceleration = others - w * force;
    let slope = k * rate + own * acceleration;
    let slope = if GROWS { slope + c * rate * rate } else { slope };
    let bend = k * acceleration - own * w * slope;
    let bend = if GROWS { bend + 3.0 * c * rate * acceleration } else { bend };
    NodeForce { rate, force, slope, bend }
}

/// How fast the gap has closed over the last step, without this contact's force since the node before; and the gap there.
#[inline(always)]
fn gap_one_step_back(s: StepInput) -> (f64, f64) {
    let mean_rate = s.free_rate - 0.5 * s.step * s.free_acceleration;
    (mean_rate, s.step * mean_rate - s.penetration)
}

/// Closing speed at a touch within the last step [m/s]. `free_before`: mean over that step without this contact's force.
#[inline(always)]
fn past_touch_speed(s: StepInput, free_before: f64, gap_before: f64) -> f64 {
    // Joints have answered this contact's force by now: so much of the acceleration, at most, was not there before the touch.
    let answered = s.mobility * s.past_force;
    let lowest = if s.free_acceleration > 0.0 - answered { s.free_acceleration } else { 0.0 - answered };
    let acceleration = s.free_acceleration - if lowest < answered { lowest } else { answered };
    let speed = free_before - 0.5 * s.step * acceleration;
    let reach = speed * speed + 2.0 * acceleration * gap_before;
    if reach > 0.0 { reach } else { 0.0 }.sqrt()
}

/// Mean force of a contact that is closed throughout [N].
#[inline(always)]
fn mean_when_closed(node: NodeForce, h: f64) -> f64 {
    let square = h * h;
    (square * (node.force + square * (1.0 / 12.0) * node.bend)) * (1.0 / square)
}

/// Mean force of the linear law over the step, of a contact that stays closed, and may pull: what stability is judged by [N].
pub fn closed_step(k: f64, c: f64, s: StepInput) -> f64 {
    mean_when_closed(node_force::<false>(k, c, s, true, 1.0), s.step)
}

/// As [`closed_form_step`] to the bit, where the second value is true: for a contact that was closed at the node before (as far as
/// these numbers tell) and stays closed until the next one, or is open throughout. Nearly all are: what takes the long way
/// costs 0.15 % of a run.
/// `old`: the contact has touched within the step before.
#[inline(always)]
pub fn fast_step<const GROWS: bool>(k: f64, c: f64, s: StepInput, old: bool) -> (StepForce, bool) {
    let h = s.step;
    let closed = s.penetration > 0.0;
    let (_, gap_before) = gap_one_step_back(s);
    let node = node_force::<GROWS>(k, c, s, closed, 1.0);
    let NodeForce { rate, force, slope, bend } = node;
    let square = h * h;
    let mean = mean_when_closed(node, h);
    let mean = if mean > 0.0 { mean } else { 0.0 };
    // Forces a step ahead of the node or behind it: by their slope, and with their bend. The margin is far above rounding.
    let sense = if closed { h } else { 0.0 - h };
    let straight = force + sense * slope;
    let bent = straight + 0.5 * square * bend;
    let nearer = if straight < bent { straight } else { bent };
    let further = if straight > bent { straight } else { bent };
    let margin = 1e-9 * if force < 0.0 { 0.0 - force } else { force };
    let stays = old & (gap_before <= 0.0) & (force > 0.0) & (nearer > margin);
    let speed = if s.free_rate > 0.0 { s.free_rate } else { 0.0 };
    let pushed = if s.free_acceleration > 0.0 { s.free_acceleration } else { 0.0 };
    let out_of_reach = s.penetration + 1.001 * (h * speed + 0.5 * square * pushed) < 0.0;
    let gone = (s.free_rate > 0.0) | (further < 0.0 - margin) | !old;
    let plain = if closed { stays } else { out_of_reach & gone };
    let lost = if GROWS {
        c * rate * rate * (square * s.penetration) * (1.0 / h)
    } else {
        c * rate * rate * (2.0 * square) * (0.5 * (1.0 / h))
    };
    let given = if closed { mean } else { 0.0 };
    (StepForce { mean_force: given, rate, touch_rate: 0.0, lost: if closed { lost } else { 0.0 } }, plain)
}

/// Mean force of the linear or the Hunt-Crossley law over the step, in closed form. Branch-free, so that lanes of contacts vectorise.
/// `old`: the contact has touched within the step before; one that is open and has not has nothing left to give.
#[inline(always)]
pub fn closed_form_step<const GROWS: bool>(k: f64, c: f64, s: StepInput, old: bool) -> StepForce {
    let (h, d, w, others) = (s.step, s.penetration, s.mobility, s.free_acceleration);
    let (per_step, square) = (1.0 / h, h * h);
    let closed = d > 0.0;
    let (mean_rate, gap_before) = gap_one_step_back(s);
    let free_before = mean_rate + w * h * s.past_force;
    let fresh = closed & (gap_before > 0.0);
    // From the node before to the touch; where the gap is open, from this node to the touch: at constant acceleration.
    let (way, speed) = if closed { (gap_before, free_before - 0.5 * h * others) } else { (0.0 - d, s.free_rate) };
    let reach = speed * speed + 2.0 * others * way;
    let reached = reach > 0.0;
    let touch_rate = if reached { reach } else { 0.0 }.sqrt();
    let sum = speed + touch_rate;
    let until = 2.0 * way / if reached & (sum > 1e-12) { sum } else { 1e-12 };
    let until = if until > h { h } else { until };
    let until = if until < 0.0 { 0.0 } else { until };
    // The oscillator at the touch: force, its slope and bend. From there its part inside the window of weights, where the touch
    // lies ahead; the part before the touch, which is no force, where it lies behind.
    let force = if GROWS { 0.0 } else { c * touch_rate };
    let acceleration = others - w * force;
    let slope = k * touch_rate + c * if GROWS { touch_rate * touch_rate } else { acceleration };
    let bend = if GROWS { (k + 3.0 * c * touch_rate) * acceleration } else { k * acceleration - c * w * slope };
    let q = if closed { 0.0 - until } else { h - until };
    let part = q * q * (0.5 * force + q * (slope * (1.0 / 6.0) + q * (bend * (1.0 / 24.0))));
    let share = if fresh { 1.0 - until * per_step } else { 1.0 };
    let NodeForce { rate, force, slope, bend } = node_force::<GROWS>(k, c, s, closed, share);
    // Where the force ends, ahead of the node or behind it.
    let parting = slope < 0.0;
    let safe_slope = if parting { slope } else { -1e-12 };
    let end = (0.0 - force) / safe_slope;
    let end = if end > h { h } else { end };
    let end = if end < 0.0 - h { 0.0 - h } else { end };
    // Newton's second step, on force, slope and bend.
    let slope_there = slope + bend * end;
    let falling = parting & (slope_there < 0.0);
    let beyond = (force + end * (slope + 0.5 * bend * end)) / if falling { slope_there } else { -1.0 };
    let end = if falling { end - beyond } else { end };
    let end = if end > h { h } else { end };
    let end = if end < 0.0 - h { 0.0 - h } else { end };
    let (rest, sense) = if end > 0.0 { (h - end, -1.0) } else { (h + end, 1.0) };
    let slope_there = if falling { slope + bend * end } else { slope };
    let bend_there = if falling { sense * bend } else { 0.0 };
    let tail = rest * rest * rest * (bend_there * rest * (1.0 / 24.0) - slope_there * (1.0 / 6.0));
    let tail = if parting & (closed | old) { tail } else { 0.0 };
    let touching = closed & (force > 0.0);
    let coming = !closed & (s.free_rate > 0.0);
    let missed = if fresh { part } else { 0.0 };
    let whole = square * (force + square * (1.0 / 12.0) * bend) - missed + tail;
    let sum = if coming { part } else { tail };
    let sum = if touching { whole } else { sum };
    let mean = sum * (1.0 / square);
    let mean = if mean > 0.0 { mean } else { 0.0 };
    // Time that the weights give to the closed part, twice.
    let gone = if parting { rest * rest } else { 0.0 };
    let lacking = if fresh { until * until } else { 0.0 } + gone;
    let time = if coming { q * q } else { gone };
    let time = if touching { 2.0 * square - lacking } else { time };
    let behind = if fresh { past_touch_speed(s, free_before, gap_before) } else { 0.0 };
    let lost = if GROWS {
        // As above, of the depth: beyond touch and end it would be negative. Bends of the power between them sum up to h^2/12 times its slopes
        // at both, which are taken off there.
        let cube = 0.5 * h * square;
        let ends = parting & (rest > 0.0);
        let parted = rest * rest * rest - if touching { cube } else { 0.0 };
        let parted = if ends { (0.0 - rate) * parted } else { 0.0 };
        let before = if fresh { touch_rate * (until * until * until - cube) } else { 0.0 };
        let beside = if coming { touch_rate * q * q * q } else { parted } + before;
        let depth = if touching { square * d } else { 0.0 } + beside * (1.0 / 6.0);
        c * rate * rate * if depth > 0.0 { depth } else { 0.0 } * per_step
    } else {
        // A damper that would pull ends the force before the overlap does: what the spring still holds then, k d^2/2 with k d = -c d', is lost
        // with it. Seen from the nodes before and after, by their weights there.
        // In a moment that is no step this is not told apart from a power: whoever looks at moments books it by himself.
        let share = if parting & (closed | old) & !coming & (h > MOMENT_S) { rest * per_step } else { 0.0 };
        let kept_force = if force > 0.0 { force } else { 0.0 };
        let end_rate = rate + end * (others - 0.5 * w * kept_force);
        c * rate * rate * time * (0.5 * per_step) + share * (0.5 * c * c / k) * (end_rate * end_rate)
    };
    let touch_rate = if closed { behind } else { touch_rate };
    StepForce { mean_force: mean, rate, touch_rate, lost }
}

/// Mean force of any law over the step, by Gauss-Legendre quadrature on the closed part.
pub fn quadrature_step(law: &ContactLaw, radii: PairRadii, s: StepInput) -> StepForce {
    // 3 points (Abramowitz & Stegun 25.4.29).
    const NODES: [(f64, f64); 3] =
        [(-0.774_596_669_241_483_4, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.774_596_669_241_483_4, 5.0 / 18.0)];
    let reach = s.step;
    let d = s.penetration;
    let elastic = law.elastic(d, radii);
    let g = law.rate_coefficient(elastic.force_n, s.approach);
    let since_touch = if d > 0.0 && s.free_rate * s.step > d { d / s.free_rate } else { s.step };
    let effective_time = since_touch * (1.0 - since_touch / (2.0 * s.step));
    let node_force = (elastic.force_n + g * s.free_rate) / (1.0 + g * s.mobility * effective_time);
    let own = if d > 0.0 && node_force > 0.0 { effective_time * s.mobility * node_force } else { 0.0 };
    let rate = s.free_rate - own;
    let root = if rate.abs() < 1e-12 { if d > 0.0 { -reach } else { reach } } else { (-d / rate).clamp(-reach, reach) };
    let (low, high) = if rate >= 0.0 { (root, reach) } else { (-reach, root) };
    let span = high - low;
    if span <= 0.0 {
        return StepForce { mean_force: 0.0, rate, touch_rate: 0.0, lost: 0.0 };
    }
    let (mut mean, mut lost) = (0.0, 0.0);
    // Weights fall to both sides of the node: each side for itself.
    for (from, to) in [(low, high.min(0.0)), (low.max(0.0), high)] {
        let span = to - from;
        if span <= 0.0 {
            continue;
        }
        for (x, w) in NODES {
            let tau = from + 0.5 * span * (x + 1.0);
            let at = law.elastic(d + rate * tau, radii).force_n;
            let force = at + law.rate_coefficient(at, s.approach) * rate;
            let force = if force > 0.0 { force } else { 0.0 };
            let share = w * span * (1.0 - tau.abs() / s.step);
            mean += share * force / s.step;
            lost += share * (force - at) * rate;
        }
    }
    if span >= 2.0 * s.step {
        let acceleration = s.free_acceleration - s.mobility * node_force;
        let k = elastic.stiffness_n_per_m;
        let jerk_force = k * rate + g * acceleration;
        let second = k * acceleration - g * s.mobility * jerk_force;
        // Quadrature already holds the curvature that comes from the law's own shape; this is the gap's.
        mean = (mean + s.step * s.step * second / 12.0).max(0.0);
    }
    StepForce { mean_force: mean, rate, touch_rate: 0.0, lost }
}

/// The largest force of a contact between nodes, from what is known at them: penetration by Hermite's cubic through
/// penetrations and closing speeds, the law on it. At a twentieth of the contact's period a step, the largest value at nodes is up
/// to 1 % low, at a seventh 10 %; this is right to 0.3 % there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PeakMeter {
    /// Penetration [m] and closing speed [m/s] at the node before, where it touched.
    before: Option<(f64, f64)>,
}

impl PeakMeter {
    /// Points between two nodes, those included.
    const POINTS: u32 = 8;

    /// Largest force since the node before [N]. `now`: penetration [m] and closing speed [m/s] where it touches; `approach_m_s` at first
    /// touch. `None` for a law that depends on what else is known of the pair (Hertz, Winkler). Less than `best`, the largest so far, is not
    /// found exactly: then the force at the node is good enough.
    pub fn peak_since(
        &mut self,
        law: &ContactLaw,
        now: Option<(f64, f64)>,
        approach_m_s: f64,
        step_s: f64,
        best: f64,
    ) -> Option<f64> {
        if *law == ContactLaw::NONE {
            return None;
        }
        if matches!(law, ContactLaw::HertzLine(_) | ContactLaw::Winkler(_)) {
            return None;
        }
        let before = std::mem::replace(&mut self.before, now.filter(|(d, _)| *d > 0.0));
        let Some((d1, r1)) = self.before else { return Some(0.0) };
        // Where it was open at the node before, from the touch on.
        let (h, (d0, r0)) = match before {
            Some(before) => (step_s, before),
            None => ((2.0 * d1 / (approach_m_s + r1).max(1e-9)).min(step_s), (0.0, approach_m_s)),
        };
        let radii = PairRadii { bush_m: 1.0, body_m: f64::INFINITY };
        // The cubic lies at most h/4 times the largest slope above its ends, and is at most three times as steep as its chord and ends.
        let fastest = r0.abs().max(r1.abs()).max((d1 - d0).abs() / h.max(1e-12));
        if law.force(d0.max(d1) + 0.25 * h * fastest, 3.0 * fastest, approach_m_s, radii) < best {
            return Some(law.force(d1, r1, approach_m_s, radii));
        }
        let mut largest = 0.0_f64;
        for i in 0..Self::POINTS {
            let u = f64::from(i) / f64::from(Self::POINTS - 1);
            let (u2, u3) = (u * u, u * u * u);
            let d = d0 * (2.0 * u3 - 3.0 * u2 + 1.0)
                + d1 * (3.0 * u2 - 2.0 * u3)
                + h * (r0 * (u3 - 2.0 * u2 + u) + r1 * (u3 - u2));
            let rate = (d1 - d0) * (6.0 * u - 6.0 * u2) / h.max(1e-12)
                + r0 * (3.0 * u2 - 4.0 * u + 1.0)
                + r1 * (3.0 * u2 - 2.0 * u);
            // At the touch itself the damping already acts.
            largest = largest.max(law.force(d.max(1e-15), rate, approach_m_s, radii));
        }
        Some(largest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the short way says that it holds, it gives the bits of the long one; and it does hold in contact and far from it.
    #[test]
    fn the_short_way_gives_the_bits_of_the_long_one() {
        let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
        let mut random = |low: f64, high: f64| {
            seed ^= seed >> 12;
            seed ^= seed << 25;
            seed ^= seed >> 27;
            low + (high - low) * (seed.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
        };
        let (mut plain_closed, mut plain_open, mut special) = (0, 0, 0);
        for _ in 0..1_000_000 {
            let (k, c) = (random(1e7, 2e8), random(0.0, 600.0));
            // From deep in the contact to far off, most of them near the touch.
            let near = random(-1.0, 1.0);
            let input = StepInput {
                penetration: 20e-6 * near * near * near,
                free_rate: random(-3.0, 3.0),
                free_acceleration: random(-3e5, 3e5),
                mobility: random(100.0, 1000.0),
                past_force: random(0.0, 1000.0),
                approach: 1.0,
                step: random(1e-6, 4e-6),
            };
            let old = random(0.0, 1.0) < 0.5;
            let ((short, holds), long) = if random(0.0, 1.0) < 0.5 {
                let c = k * random(0.0, 2.0);
                (fast_step::<true>(k, c, input, old), closed_form_step::<true>(k, c, input, old))
            } else {
                (fast_step::<false>(k, c, input, old), closed_form_step::<false>(k, c, input, old))
            };
            if !holds {
                special += 1;
                continue;
            }
            if input.penetration > 0.0 {
                plain_closed += 1
            } else {
                plain_open += 1
            }
            assert_eq!(short.mean_force.to_bits(), long.mean_force.to_bits(), "{input:?}");
            assert_eq!(short.rate.to_bits(), long.rate.to_bits(), "{input:?}");
            if short.mean_force > 0.0 {
                assert_eq!(short.lost.to_bits(), long.lost.to_bits(), "{input:?}");
            }
        }
        println!("{plain_closed} closed, {plain_open} open, {special} others");
        assert!(plain_closed > 50_000 && plain_open > 50_000 && special > 50_000);
    }
}
