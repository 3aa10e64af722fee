//! Spans of a chain without link bodies: a spring and a damper between two neighbouring sprockets of its route.
//!
//! ```text
//! e = s_b r_b q_b - s_a r_a q_a          the arc that b takes up less the arc that a pays out; s: 1 inside, -1 outside of the loop
//! F = max(0, T0 + k e)                   of the spring: a span never pushes
//! T = max(0, F + c e') where F > 0       tension; s_a r_a T on a, -s_b r_b T on b; stored = F^2 / (2 k), lost = (T - F) e' dt
//! k = k_joint / n, c = c_joint / n       n = length / pitch + 1 joints in series: those of the span, and half a link on each sprocket
//! ```
//! The radii are z p / (2 pi), so that the mean ratio of two sprockets is that of their teeth. T is the whole tension of the links: its part
//! m' v^2 presses on no sprocket, is the same in all spans, and turns nothing.

/// A spring and a damper between two coordinates that turn.
#[derive(Clone, Debug, PartialEq)]
pub struct ChainSpan {
    /// `chains.NAME.spans.FROM-TO`.
    pub path: String,
    /// Index of its chain, and of the sprockets that it leaves and reaches.
    pub chain: usize,
    pub sprockets: [usize; 2],
    /// Their coordinates.
    pub ends: [usize; 2],
    /// Rolling radii, negative of sprockets outside of the loop [m].
    pub radii_m: [f64; 2],
    pub length_m: f64,
    /// Stiffness of the links that it stands for, whatever the drive gives it.
    pub of_links_n_per_m: f64,
    /// Stiffness and damping that the drive gives it, or that of the links that it stands for, without the effects on it.
    pub own_n_per_m: f64,
    pub own_n_s_per_m: f64,
    pub stiffness_n_per_m: f64,
    pub damping_n_s_per_m: f64,
    /// Tension T0 without elongation [N].
    pub preload_n: f64,
}

impl ChainSpan {
    /// Elongation, or its rate, from angles or speeds of its two ends.
    #[inline(always)]
    pub fn elongation(&self, turned: [f64; 2]) -> f64 {
        self.radii_m[1] * turned[1] - self.radii_m[0] * turned[0]
    }

    /// Force of its spring [N].
    #[inline(always)]
    pub fn spring_n(&self, elongation_m: f64) -> f64 {
        (self.preload_n + self.stiffness_n_per_m * elongation_m).max(0.0)
    }

    /// Force of the spring, and what the damper adds to it [N].
    #[inline(always)]
    pub fn forces_n(&self, elongation_m: f64, rate_m_s: f64) -> (f64, f64) {
        let spring_n = self.spring_n(elongation_m);
        let damper_n = if spring_n > 0.0 { (self.damping_n_s_per_m * rate_m_s).max(-spring_n) } else { 0.0 };
        (spring_n, damper_n)
    }

    /// Energy stored at this elongation [J].
    pub fn energy_j(&self, elongation_m: f64) -> f64 {
        let spring_n = self.spring_n(elongation_m);
        0.5 * spring_n * spring_n / self.stiffness_n_per_m
    }

    /// What a tension of 1 N turns its two ends with [N m].
    pub fn levers_m(&self) -> [f64; 2] {
        [self.radii_m[0], -self.radii_m[1]]
    }
}
