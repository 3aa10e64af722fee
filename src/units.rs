//! Conversions and constants. Inside pitchline everything is SI, f64 and radians; files and command lines carry the unit in
//! the name.
//!
//! The trigonometric functions here are those of the `libm` crate: std's call the C library, which picks other code, and
//! returns other bits, on other CPUs. Whatever reaches a State goes through these.

use std::f64::consts::PI;

/// 1 rpm in rad/s.
pub const RPM: f64 = PI / 30.0;
/// 1 degree in rad.
pub const DEG: f64 = PI / 180.0;
/// 1 mm in m.
pub const MM: f64 = 1e-3;
/// 1 um in m.
pub const UM: f64 = 1e-6;

/// sin and cos of `angle_rad`, the same bits on every CPU.
pub fn sin_cos(angle_rad: f64) -> (f64, f64) {
    libm::sincos(angle_rad)
}

/// Angle of (x, y) in (-pi, pi], the same bits on every CPU.
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// `angle_rad` folded into (-pi, pi].
pub fn wrap_angle(angle_rad: f64) -> f64 {
    let turns = libm::floor((angle_rad + PI) / (2.0 * PI));
    let folded = angle_rad - turns * 2.0 * PI;
    if folded <= -PI { folded + 2.0 * PI } else { folded }
}
