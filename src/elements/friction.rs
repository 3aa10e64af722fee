//! Regularised Coulomb friction.
//!
//! ```text
//! F_t = -mu N clamp(v_t / v_s, -1, 1)
//! ```
//! v_t sliding speed, v_s the speed below which the force falls linearly to zero (stick). Piecewise linear, so that the
//! velocity at the end of half a step can be solved for in closed form: with kappa = (h/2) w_t mu N, w_t the inverse
//! effective mass along the tangent and v* the velocity without this force, v_t = v* - (h/2) w_t |F_t| gives
//! F_t = -mu N clamp(v* / (v_s + kappa), -1, 1). A single force so solved never overshoots, whatever the step. But a link has
//! four of them (two joints, two bushes), each of which would stop it alone, and each sees the others one step late: v_s is at
//! least kappa. That was stable up to mu = 0.3 at the largest step; at 3 kappa losses and the silent chain's
//! asymmetry depend on the step (0.2063 at 2.5 us, 0.2104 at 4.9 us with one kappa and at 0.5 us).
//! Source: regularised Coulomb law of multibody dynamics (e.g. Marques et al. 2016, section 2); the local
//! solution is derived here.

/// Least ratio of stick speed to kappa.
const STICK_PER_KAPPA: f64 = 1.0;

/// Friction force on the link [N], opposite to `free_speed`.
///
/// `free_speed`: tangential speed without this force [m/s]; `half_step_mobility`: (h/2) w_t [s/kg].
#[inline(always)]
pub fn solved_force(
    coefficient: f64,
    normal_force: f64,
    free_speed: f64,
    stick_speed: f64,
    half_step_mobility: f64,
) -> f64 {
    let limit = coefficient * normal_force;
    let kappa = half_step_mobility * limit;
    let least = STICK_PER_KAPPA * kappa;
    let stick_speed = if stick_speed > least { stick_speed } else { least };
    let ratio = free_speed / (stick_speed + kappa);
    let ratio = if ratio > 1.0 { 1.0 } else { ratio };
    let ratio = if ratio < -1.0 { -1.0 } else { ratio };
    0.0 - limit * ratio
}

/// Friction force on the link [N] from the speed at the node, this force included: for forces that keep no memory. The stick
/// speed is at least two kappa, which keeps the explicit force from overshooting.
#[inline(always)]
pub fn explicit_force(
    coefficient: f64,
    normal_force: f64,
    speed: f64,
    stick_speed: f64,
    half_step_mobility: f64,
) -> f64 {
    let limit = coefficient * normal_force;
    let least = (STICK_PER_KAPPA + 1.0) * half_step_mobility * limit;
    let stick_speed = if stick_speed > least { stick_speed } else { least };
    let ratio = speed / stick_speed;
    let ratio = if ratio > 1.0 { 1.0 } else { ratio };
    let ratio = if ratio < -1.0 { -1.0 } else { ratio };
    0.0 - limit * ratio
}

/// As [`explicit_force`], without a division: `per_speed` is the limit over the stick speed, `largest_slope` what [`largest_stable_slope`] gives.
#[inline(always)]
pub fn force_with_slope_limit(limit: f64, speed: f64, per_speed: f64, largest_slope: f64) -> f64 {
    let slope = if per_speed < largest_slope { per_speed } else { largest_slope };
    let force = slope * speed;
    let force = if force > limit { limit } else { force };
    let force = if force < 0.0 - limit { 0.0 - limit } else { force };
    0.0 - force
}

/// Largest force per speed that does not overshoot [N s/m].
#[inline(always)]
pub fn largest_stable_slope(half_step_mobility: f64) -> f64 {
    1.0 / ((STICK_PER_KAPPA + 1.0) * half_step_mobility)
}
