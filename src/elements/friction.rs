//! Regularised Coulomb friction.
//!
//! ```text
//! F_t = -mu N clamp(v_t / v_s, -1, 1)
//! ```
//! v_t sliding speed, v_s the speed below which the force falls linearly to zero (stick). Piecewise linear, so that the
//! velocity at the end of half a step can be solved for in closed form: with kappa = (h/2) w_t mu N, w_t the inverse
//! effective mass along the tangent and v* the velocity without this force, v_t = v* - (h/2) w_t |F_t| gives
//! F_t = -mu N clamp(v* / (v_s + kappa), -1, 1). A single force so solved never overshoots, whatever the step. But a link has
//! four of them (two joints, two bushes), each of which would stop it alone; together they would stop it four times over,
//! and at mu = 0.2 did: a stick oscillation that put 1 % of the work into the ledger's error. So kappa is taken four times.
//! Where sliding is faster than v_s + 4 kappa, and for small steps, nothing changes.
//! Source: regularised Coulomb law as in PHYSICS of multibody codes (e.g. Marques et al. 2016, section 2); the local
//! solution is derived here.

/// Friction forces that can hold one link at a time.
const FORCES_PER_LINK: f64 = 4.0;

/// Friction force on the link [N], opposite to `free_speed`.
///
/// `free_speed`: tangential speed without this force [m/s]; `half_step_mobility`: (h/2) w_t [s/kg].
#[inline(always)]
pub fn solved_force(coefficient: f64, normal_force: f64, free_speed: f64, stick_speed: f64, half_step_mobility: f64) -> f64 {
    let limit = coefficient * normal_force;
    let ratio = free_speed / (stick_speed + FORCES_PER_LINK * half_step_mobility * limit);
    let ratio = if ratio > 1.0 { 1.0 } else { ratio };
    let ratio = if ratio < -1.0 { -1.0 } else { ratio };
    0.0 - limit * ratio
}
