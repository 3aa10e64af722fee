//! Oil with finely dispersed air.
//!
//! Volume of an amount of oil over its volume at ambient pressure, at the gauge pressure p:
//! ```text
//! phi(p) = (1 - a) exp(-p / B) + a (1 + p / p0)^(-1/k)
//! ```
//! a: share of air at ambient pressure, B: bulk modulus of the liquid, k: polytropic exponent of the air (1: bubbles keep their temperature,
//! 1.4: no heat passes). The effective bulk modulus is -phi/phi', which is (H6) in the literature on tensioners: Merritt, Hydraulic Control
//! Systems (1967), section 2.3; Yu, Chen & Lu, Proc. IMechE C 208 (1994), for the polytropic form. Air neither dissolves nor leaves solution.
//! Below ambient pressure the air expands; without air (a = 0) the liquid takes tension, which real oil does not.
//!
//! Energy of an amount of oil, per volume at ambient pressure: the work of compressing it, e = integral of p (-phi') dp; what flows in brings
//! h = e + p phi = integral of phi dp, its enthalpy. Both are zero at ambient pressure.

/// Standard atmosphere [Pa]. Source: ISO 2533.
pub const AMBIENT_PA: f64 = 101_325.0;

/// Properties of the oil in a drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oil {
    pub density_kg_m3: f64,
    /// Dynamic [Pa s].
    pub viscosity_pa_s: f64,
    /// Bulk modulus of the liquid without air.
    pub bulk_modulus_pa: f64,
    /// Volume of air over that of the mixture, at ambient pressure.
    pub air_share: f64,
    pub air_exponent: f64,
}

/// How thick an oil is over its temperature, from its kinematic viscosities at 40 and 100 degrees Celsius, as data sheets state them.
///
/// ```text
/// log log (nu + 0.7) = A - B log T,   nu in mm2/s, T in kelvin, logarithms to base 10
/// ```
/// Walther 1931, as ASTM D341 has it for viscosities above [`OilGrade::LEAST_MM2_S`]; below, its further terms are left out here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OilGrade {
    pub at_40_mm2_s: f64,
    pub at_100_mm2_s: f64,
}

impl OilGrade {
    /// Lowest viscosity that the equation holds for.
    pub const LEAST_MM2_S: f64 = 2.0;

    /// Kinematic viscosity [m2/s].
    pub fn kinematic_m2_s(&self, temperature_c: f64) -> f64 {
        let thickness = |mm2_s: f64| libm::log10(libm::log10(mm2_s + 0.7));
        let warmth = |celsius: f64| libm::log10(celsius + 273.15);
        let [cold, warm] = [self.at_40_mm2_s, self.at_100_mm2_s].map(thickness);
        let share = (warmth(temperature_c) - warmth(40.0)) / (warmth(100.0) - warmth(40.0));
        1e-6 * (libm::pow(10.0, libm::pow(10.0, cold + share * (warm - cold))) - 0.7)
    }
}

/// Where an amount of oil stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecificVolume {
    /// Volume over that at ambient pressure.
    pub volume: f64,
    /// Its derivative by the pressure [1/Pa], negative.
    pub slope_per_pa: f64,
}

/// Iterations of Newton's method for a pressure; some five are needed.
const MAX_ITERATIONS: usize = 200;
/// Largest fall of the absolute pressure in one of them, as a share of it.
const LARGEST_FALL: f64 = 0.9;
/// Change of the pressure at which it ends: what so many units in the last place of the volume stand for, or of the pressure if that is more. A smaller
/// change is rounding, and the iteration would wander in it.
const ROUNDING: f64 = 2.0 * f64::EPSILON;

impl Oil {
    /// At a gauge pressure above minus one atmosphere [Pa].
    #[inline]
    pub fn at(&self, pressure_pa: f64) -> SpecificVolume {
        let liquid = (1.0 - self.air_share) * libm::exp(-pressure_pa / self.bulk_modulus_pa);
        let absolute = 1.0 + pressure_pa / AMBIENT_PA;
        let air =
            if self.air_share > 0.0 { self.air_share * libm::pow(absolute, -1.0 / self.air_exponent) } else { 0.0 };
        SpecificVolume {
            volume: liquid + air,
            slope_per_pa: -liquid / self.bulk_modulus_pa - air / (self.air_exponent * absolute * AMBIENT_PA),
        }
    }

    /// Effective bulk modulus [Pa].
    pub fn bulk_modulus_pa(&self, pressure_pa: f64) -> f64 {
        let SpecificVolume { volume, slope_per_pa } = self.at(pressure_pa);
        -volume / slope_per_pa
    }

    /// Gauge pressure at which an amount of oil has `volume` times its volume at ambient pressure [Pa]. `near_pa`: where to look for it
    /// first. NaN where `volume` is not positive.
    pub fn pressure_pa(&self, volume: f64, near_pa: f64) -> f64 {
        if volume.is_nan() || volume <= 0.0 {
            return f64::NAN;
        }
        let mut p = near_pa;
        for _ in 0..MAX_ITERATIONS {
            let here = self.at(p);
            // The volume is convex in the pressure: from above Newton's method goes too far down once, then rises steadily.
            let next = p + (volume - here.volume) / here.slope_per_pa;
            let lowest = p - LARGEST_FALL * (p + AMBIENT_PA);
            let next = if self.air_share > 0.0 && next < lowest { lowest } else { next };
            let change = (next - p).abs();
            p = next;
            let of_volume = volume / here.slope_per_pa.abs();
            if change <= ROUNDING * (p.abs() + AMBIENT_PA).max(of_volume) {
                break;
            }
        }
        p
    }

    /// What an amount of oil brings along with it, per volume at ambient pressure [J/m3].
    pub fn enthalpy(&self, pressure_pa: f64) -> f64 {
        let liquid = -(1.0 - self.air_share) * self.bulk_modulus_pa * libm::expm1(-pressure_pa / self.bulk_modulus_pa);
        if self.air_share == 0.0 {
            return liquid;
        }
        let power = 1.0 - 1.0 / self.air_exponent;
        let grown = libm::log1p(pressure_pa / AMBIENT_PA);
        let air = if power == 0.0 { grown } else { libm::expm1(power * grown) / power };
        liquid + self.air_share * AMBIENT_PA * air
    }

    /// Work of compressing it from ambient pressure, per volume at ambient pressure [J/m3].
    pub fn stored(&self, pressure_pa: f64) -> f64 {
        self.enthalpy(pressure_pa) - pressure_pa * self.at(pressure_pa).volume
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;

    fn oil(air_share: f64, air_exponent: f64) -> Oil {
        Oil { density_kg_m3: 850.0, viscosity_pa_s: 0.02, bulk_modulus_pa: 1.5e9, air_share, air_exponent }
    }

    /// Published examples of ASTM D341: a gear oil SAE 140 (olezol.com), an oil of ISO grade 32 (two digits printed).
    #[test]
    fn oils_thin_as_their_charts_say() {
        let gear = OilGrade { at_40_mm2_s: 404.0, at_100_mm2_s: 28.0 };
        assert!((1e6 * gear.kinematic_m2_s(60.0) / 132.126 - 1.0).abs() < 1e-4);
        let thin = OilGrade { at_40_mm2_s: 32.0, at_100_mm2_s: 5.4 };
        assert!((1e6 * thin.kinematic_m2_s(80.0) - 8.5).abs() < 0.05);
        for (celsius, mm2_s) in [(40.0, 32.0), (100.0, 5.4)] {
            assert!((1e6 * thin.kinematic_m2_s(celsius) / mm2_s - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn pressure_is_the_inverse_of_volume() {
        for (air, k) in [(0.0, 1.4), (1e-6, 1.4), (0.02, 1.0), (0.1, 1.3)] {
            let oil = oil(air, k);
            for p in [-0.9e5, -1e4, 0.0, 1.0, 3e5, 5e6, 1e8] {
                for near in [-0.5e5, 0.0, 1e6, 2e8] {
                    let found = oil.pressure_pa(oil.at(p).volume, near);
                    // The volume is known to a unit in its last place.
                    let blur = 4.0 * f64::EPSILON / oil.at(p).slope_per_pa.abs();
                    assert!((found - p).abs() <= blur + 1e-9, "{air} {k}: {p} from {near}: {found}");
                }
            }
            assert!(oil.pressure_pa(0.0, 0.0).is_nan() && oil.pressure_pa(f64::NAN, 0.0).is_nan());
        }
    }

    /// Derivatives against differences: phi' = d phi/dp, h' = phi, e' = -p phi'.
    #[test]
    fn energies_are_integrals() {
        for (air, k) in [(0.0, 1.4), (0.02, 1.0), (0.05, 1.4)] {
            let oil = oil(air, k);
            for p in [-0.5e5, 1e3, 4e5, 6e6] {
                let d = 1e-4 * (p + AMBIENT_PA);
                let slope = |f: &dyn Fn(f64) -> f64| (f(p + d) - f(p - d)) / (2.0 * d);
                let here = oil.at(p);
                let close =
                    |a: f64, b: f64, scale: f64| assert!((a - b).abs() < 1e-6 * scale, "{air} {k} {p}: {a} {b}");
                close(slope(&|p| oil.at(p).volume), here.slope_per_pa, here.slope_per_pa.abs());
                close(slope(&|p| oil.enthalpy(p)), here.volume, 1.0);
                close(slope(&|p| oil.stored(p)), -p * here.slope_per_pa, here.volume);
            }
            assert_eq!(oil.enthalpy(0.0), 0.0);
        }
    }

    /// (H6): 1/B_eff = (1/B + a p0^(1/k) / (k p^(1 + 1/k))) / (1 + a (p0/p)^(1/k)), p absolute, where the liquid's share is near one.
    #[test]
    fn effective_bulk_modulus_is_that_of_the_literature() {
        let oil = oil(0.01, 1.4);
        for gauge in [0.0, 2e5, 1e6, 1e7] {
            let p: f64 = gauge + AMBIENT_PA;
            let r = libm::pow(AMBIENT_PA / p, 1.0 / 1.4);
            let a = 0.01 / 0.99;
            let known = (1.0 / 1.5e9 + a * r / (1.4 * p)) / (1.0 + a * r);
            let got = 1.0 / oil.bulk_modulus_pa(gauge);
            assert!((got / known - 1.0).abs() < 1e-2, "{gauge}: {got:e} {known:e}");
        }
        // Ten times less than the liquid's at ambient pressure, the liquid's at a hundred bar.
        assert!(oil.bulk_modulus_pa(0.0) < 2e7 && oil.bulk_modulus_pa(1e7) > 1.4e9);
    }
}
