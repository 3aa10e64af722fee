//! Floats as frames store them: a 32-bit float, which anybody's reader shows, and beside it the one or two bytes of the mantissa
//! that follow.
//!
//! ```text
//! value = coarse + sign(coarse) fine ulp(coarse) / 2^(8 bytes),    0 <= fine < 2^(8 bytes)
//! ```
//! `coarse` is cut off, not rounded; ulp(x) is the distance of the float x to the next larger one of its size (numpy:
//! `spacing(abs(x))`). With two bytes a value keeps 40 bits (relative error 2^-40, 9e-13), with one byte 32 bits (2^-32, 2.3e-10),
//! alone 24 (rounded; 2^-24, 6e-8). Rounding a rounded value changes nothing, so that a frame has the same bits before it is
//! written and after it is read. What is smaller than the smallest float of full length, 1.2e-38, is zero.

use super::columns::Stored;
use crate::integrate::{Isa, VectorKernel, vectorised};

/// Bits of the mantissa of an f64 behind those of a float.
const BEHIND_FLOAT: u32 = 29;

/// The nearest number of `BITS` more bits than a float has.
#[inline(always)]
fn rounded<const BITS: u32>(value: f64) -> f64 {
    let dropped = BEHIND_FLOAT - BITS;
    // A carry goes through the mantissa into the exponent, as it should.
    let nearest = f64::from_bits(value.to_bits().wrapping_add(1 << (dropped - 1)) & !((1 << dropped) - 1));
    let fits = if nearest.abs() > f64::from(f32::MAX) { f64::INFINITY.copysign(value) } else { nearest };
    let fits = if value.is_nan() { f64::NAN } else { fits };
    if value.abs() < f64::from(f32::MIN_POSITIVE) { 0.0 } else { fits }
}

/// A float, and the bits behind it, of a number that is rounded to both.
#[inline(always)]
fn split<const BITS: u32>(value: f64) -> (f32, u32) {
    let bits = value.to_bits();
    let coarse = f64::from_bits(bits & !((1 << BEHIND_FLOAT) - 1)) as f32;
    (coarse, (bits >> (BEHIND_FLOAT - BITS)) as u32)
}

/// The number of both.
#[inline(always)]
pub fn join<const BITS: u32>(coarse: f32, fine: u32) -> f64 {
    f64::from_bits(f64::from(coarse).to_bits() | (u64::from(fine) << (BEHIND_FLOAT - BITS)))
}

/// Rounds a column.
struct RoundColumn<'a, const BITS: u32>(&'a mut [f64]);

impl<const BITS: u32> VectorKernel for RoundColumn<'_, BITS> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for value in self.0 {
            *value = rounded::<BITS>(*value);
        }
    }
}

/// Rounds values to what a column stores.
pub fn round(isa: Isa, stored: Stored, values: &mut [f64]) {
    match stored {
        Stored::double48 => vectorised(isa, RoundColumn::<16>(values)),
        Stored::double40 => vectorised(isa, RoundColumn::<8>(values)),
        Stored::float => vectorised(isa, RoundColumn::<0>(values)),
        Stored::double | Stored::derived | Stored::uint32 | Stored::uint64 | Stored::bool | Stored::string => {}
    }
}

/// Writes a column of rounded numbers as bytes: floats, and what is behind them.
pub struct SplitColumn<'a, const BITS: u32, const BYTES: usize> {
    pub values: &'a [f64],
    pub coarse: &'a mut [[u8; 4]],
    pub fine: &'a mut [[u8; BYTES]],
}

impl<const BITS: u32, const BYTES: usize> VectorKernel for SplitColumn<'_, BITS, BYTES> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for ((value, coarse), fine) in self.values.iter().zip(self.coarse).zip(self.fine) {
            let (float, behind) = split::<BITS>(*value);
            *coarse = float.to_le_bytes();
            fine.copy_from_slice(&behind.to_le_bytes()[..BYTES]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of all sizes, and those beside powers of two and between two floats.
    fn numbers() -> Vec<f64> {
        let mut numbers = vec![0.0, -0.0, 1e-300, f64::from(f32::MIN_POSITIVE), 3e38, 0.1, 1.0];
        let mut x = 0.731_f64;
        for k in 0..20_000_i32 {
            x = (3.99 * x * (1.0 - x)).clamp(1e-6, 1.0);
            numbers.push(x * 2.0_f64.powi(k % 90 - 45));
            let float = f64::from(x as f32);
            let ulp = f64::from((x as f32).next_up()) - float;
            numbers.extend([0.25, 0.5, 0.499_999, 0.500_001, -0.5].map(|share| float + share * ulp));
            let two = 2.0_f64.powi(k % 60 - 30);
            numbers.extend([two, two.next_up(), two.next_down(), two * (1.0 - 2.0_f64.powi(-26))]);
        }
        numbers.iter().flat_map(|v| [*v, -*v]).collect()
    }

    /// Largest relative error.
    fn error_of<const BITS: u32>() -> f64 {
        let mut worst = 0.0_f64;
        for value in numbers() {
            let kept = rounded::<BITS>(value);
            let (coarse, behind) = split::<BITS>(kept);
            let fine = behind & ((1 << BITS) - 1);
            let joined = join::<BITS>(coarse, fine);
            assert_eq!(joined, kept, "{value:e}");
            // As a stranger computes it.
            let ulp = f64::from(coarse.abs().next_up()) - f64::from(coarse.abs());
            let part = f64::from(fine) * ulp / f64::from(1_u32 << BITS);
            assert_eq!(joined, f64::from(coarse) + part.copysign(f64::from(coarse)), "{value:e}");
            assert_eq!(rounded::<BITS>(kept).to_bits(), kept.to_bits(), "{value:e} rounded twice");
            if value.abs() >= f64::from(f32::MIN_POSITIVE) {
                worst = worst.max(((kept - value) / value).abs());
            } else {
                assert_eq!(kept, 0.0);
            }
        }
        worst
    }

    #[test]
    fn floats_keep_as_many_bits_as_is_said() {
        let errors = [error_of::<16>(), error_of::<8>(), error_of::<0>()];
        println!("two bytes {:e}, one byte {:e}, none {:e}", errors[0], errors[1], errors[2]);
        for (error, bits) in errors.into_iter().zip([40, 32, 24]) {
            assert!(error <= 2.0_f64.powi(-bits) && error > 2.0_f64.powi(-bits - 1), "{bits} bits: {error:e}");
        }
    }

    #[test]
    fn every_vector_unit_gives_the_same_bits() {
        for stored in [Stored::double48, Stored::double40, Stored::float] {
            let bits = |isa: Isa| {
                let mut values = numbers();
                values.extend([f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 1e39, -1e300]);
                round(isa, stored, &mut values);
                values.iter().map(|v| v.to_bits()).collect::<Vec<u64>>()
            };
            for isa in Isa::available() {
                assert!(bits(isa) == bits(Isa::Baseline), "{isa:?}");
            }
        }
    }

    #[test]
    fn what_no_float_holds_becomes_infinite_or_no_number() {
        for value in [f64::INFINITY, f64::NEG_INFINITY, 1e39, -1e300, f64::from(f32::MAX) * 1.000_001] {
            let kept = rounded::<16>(value);
            let (coarse, behind) = split::<16>(kept);
            assert_eq!(join::<16>(coarse, behind & 0xffff), f64::INFINITY.copysign(value), "{value:e}");
        }
        let (coarse, behind) = split::<8>(rounded::<8>(f64::NAN));
        assert!(join::<8>(coarse, behind & 0xff).is_nan());
    }
}
