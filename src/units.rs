//! Conversions and constants. Internally all quantities are SI, f64 and radians; files and command lines carry the unit
//! in the name.
//!
//! The trigonometric functions here are those of the `libm` crate: std's call the C library, which uses different code
//! on different CPUs and returns different bits. Everything that reaches a State uses these.

use std::f64::consts::PI;

/// 1 rpm in rad/s.
pub const RPM: f64 = PI / 30.0;
/// 1 degree in rad.
pub const DEG: f64 = PI / 180.0;
/// 1 mm in m.
pub const MM: f64 = 1e-3;
/// 1 um in m.
pub const UM: f64 = 1e-6;

/// `value` limited to its bounds. If measured data make the bounds invalid (reversed or NaN), the lower bound is
/// returned, where std's `clamp` panics; if that is NaN, the value itself.
pub fn within(value: f64, low: f64, high: f64) -> f64 {
    if low <= high {
        value.clamp(low, high)
    } else if low.is_nan() {
        value
    } else {
        low
    }
}

/// sin and cos of `angle_rad`, the same bits on every CPU.
pub fn sin_cos(angle_rad: f64) -> (f64, f64) {
    libm::sincos(angle_rad)
}

/// Angle of (x, y) in [-pi, pi], the same bits on every CPU.
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// Angle of the unit vector (cos, sin) in [-pi, pi], within 9e-16 of [`atan2`]. It has no branches, so that a loop over
/// a column vectorises. The quotient is reduced below tan(pi / 8); the odd polynomial is that of FreeBSD's `s_atan.c`.
#[inline(always)]
pub fn direction(sin: f64, cos: f64) -> f64 {
    const A: [f64; 11] = [
        3.333_333_333_333_293e-1,
        -1.999_999_999_987_648_3e-1,
        1.428_571_427_250_346_6e-1,
        -1.111_111_040_546_235_6e-1,
        9.090_887_133_436_507e-2,
        -7.691_876_205_044_83e-2,
        6.661_073_137_387_531e-2,
        -5.833_570_133_790_573_5e-2,
        4.976_877_994_615_932_4e-2,
        -3.653_157_274_421_691_6e-2,
        1.628_582_011_536_578_2e-2,
    ];
    const TAN_PI_8: f64 = 0.414_213_562_373_095_1;
    let (a, b) = (cos.abs(), sin.abs());
    let (least, most) = if b > a { (a, b) } else { (b, a) };
    let steep = least > TAN_PI_8 * most;
    let (y, x) = if steep { (least - most, least + most) } else { (least, most) };
    let t = y / x;
    let z = t * t;
    let mut sum = 0.0;
    for coefficient in A.iter().rev() {
        sum = sum * z + coefficient;
    }
    let small = t - t * z * sum;
    let octant = if steep { 0.25 * PI + small } else { small };
    let quadrant = if b > a { 0.5 * PI - octant } else { octant };
    let half = if cos < 0.0 { PI - quadrant } else { quadrant };
    half.copysign(sin)
}

/// `angle_rad` wrapped into (-pi, pi].
pub fn wrap_angle(angle_rad: f64) -> f64 {
    let turns = libm::floor((angle_rad + PI) / (2.0 * PI));
    let folded = angle_rad - turns * 2.0 * PI;
    if folded <= -PI { folded + 2.0 * PI } else { folded }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_those_of_atan2() {
        let mut largest = 0.0_f64;
        let turns = (-200_000..=200_000).map(|i| f64::from(i) * (PI / 200_000.0));
        let octants = (-8..=8).flat_map(|i| [-1e-15, 0.0, 1e-15].map(|off| f64::from(i) * 0.125 * PI + off));
        for angle in turns.chain(octants).chain([1e-300, -1e-18, 1e-9]) {
            let (sin, cos) = sin_cos(angle);
            largest = largest.max((direction(sin, cos) - atan2(sin, cos)).abs());
        }
        println!("{largest:e} rad");
        assert!(largest < 9e-16, "{largest:e}");
        for (sin, cos) in [(0.0, 1.0), (-0.0, 1.0), (0.0, -1.0), (-0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)] {
            assert_eq!(direction(sin, cos).to_bits(), atan2(sin, cos).to_bits(), "{sin} {cos}");
        }
    }
}
