//! Regularised Coulomb friction.
//!
//! ```text
//! F_t = -mu N clamp(v_t / v_s, -1, 1)
//! ```
//! v_t sliding speed, v_s the speed below which the force falls linearly to zero (stick). Piecewise linear, so that the
//! velocity at the end of half a step can be solved for in closed form: with kappa = (h/2) w_t mu N, w_t the inverse
//! effective mass along the tangent and v* the velocity without this force, v_t = v* - (h/2) w_t |F_t| gives
//! F_t = -mu N clamp(v* / (v_s + kappa), -1, 1). The solved force never overshoots, whatever the step.
//! Source: regularised Coulomb law as in PHYSICS of multibody codes (e.g. Marques et al. 2016, section 2); the local
//! solution is derived here.

/// Friction force on the link [N], opposite to `free_speed`.
///
/// `free_speed`: tangential speed without this force [m/s]; `half_step_mobility`: (h/2) w_t [s/kg].
#[inline(always)]
pub fn solved_force(coefficient: f64, normal_force: f64, free_speed: f64, stick_speed: f64, half_step_mobility: f64) -> f64 {
    let limit = coefficient * normal_force;
    let ratio = free_speed / (stick_speed + half_step_mobility * limit);
    let ratio = if ratio > 1.0 { 1.0 } else { ratio };
    let ratio = if ratio < -1.0 { -1.0 } else { ratio };
    0.0 - limit * ratio
}
