//! Torsion of a uniform shaft that turns with a body at one end and is free at the other, by modes.
//!
//! ```text
//! J' th'' = G I_p d2th/dz2            J': inertia over length, z: distance from the body
//! th(z) = th_0 + sum of sin(b_i z) q_i,   b_i = (2 i - 1) pi / (2 l)        Ritz functions: the modes with the body held
//! ```
//! With u_i = th_0 + q_i / w_i', w_i' = 2 / (b_i l), the kinetic energy has no mixed terms: every mode is a disc of its own behind a spring,
//! ```text
//! J_i = 2 J / (b_i l)^2,   k_i = J_i b_i^2 G I_p / J'
//! th(z) = th_0 + sum of w_i(z) (u_i - th_0),   w_i(z) = 2 sin(b_i z) / (b_i l)
//! ```
//! and J - sum J_i turns with the body. A torque at z acts on the discs by w_i(z), on the body by what is left of 1. What the modes left out would yield to a
//! constant torque is missing: of the free end's twist a share of some 0.2 / n with n modes.
//! Source: Craig and Bampton 1968 (modes with the interface held); effective masses: Imbert 1979.

use std::f64::consts::PI;

/// Most modes of a shaft.
pub const MAX_TORSION_MODES: usize = 8;

/// A shaft alike all along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UniformShaft {
    /// [m].
    pub length_m: f64,
    /// Torsional stiffness of a length of one metre, G I_p [N m2/rad].
    pub stiffness_n_m2: f64,
    /// Moment of inertia of the whole shaft. It includes what is spread evenly along the shaft [kg m2].
    pub inertia_kg_m2: f64,
    /// Number of modes, at most [`MAX_TORSION_MODES`].
    pub modes: usize,
    /// Damping ratio of every mode with the body held.
    pub damping_ratio: f64,
}

/// A mode as a disc behind a spring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorsionMode {
    pub inertia_kg_m2: f64,
    pub stiffness_nm_per_rad: f64,
    pub damping_nm_s_per_rad: f64,
}

impl UniformShaft {
    /// b_i l of the mode with this number, from 0 on.
    fn wave(number: usize) -> f64 {
        (2 * number + 1) as f64 * 0.5 * PI
    }

    /// The modes, slowest first.
    pub fn discs(&self) -> impl Iterator<Item = TorsionMode> + '_ {
        (0..self.modes).map(|number| {
            let wave = UniformShaft::wave(number);
            let inertia_kg_m2 = 2.0 * self.inertia_kg_m2 / (wave * wave);
            let stiffness_nm_per_rad = 2.0 * self.stiffness_n_m2 / self.length_m;
            let damping_nm_s_per_rad = 2.0 * self.damping_ratio * libm::sqrt(stiffness_nm_per_rad * inertia_kg_m2);
            TorsionMode { inertia_kg_m2, stiffness_nm_per_rad, damping_nm_s_per_rad }
        })
    }

    /// What turns with the body [kg m2].
    pub fn rigid_inertia_kg_m2(&self) -> f64 {
        self.discs().fold(self.inertia_kg_m2, |left, disc| left - disc.inertia_kg_m2)
    }

    /// Share of every disc in the turn of the shaft at a distance from the body; the body has what is left of 1.
    pub fn shares_at(&self, along_m: f64) -> impl Iterator<Item = f64> + '_ {
        (0..self.modes).map(move |number| {
            let wave = UniformShaft::wave(number);
            2.0 * libm::sin(wave * along_m / self.length_m) / wave
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAFT: UniformShaft =
        UniformShaft { length_m: 0.41, stiffness_n_m2: 3480.0, inertia_kg_m2: 4.6e-4, modes: 8, damping_ratio: 0.01 };

    /// Rayleigh's quotient of the series against the closed form of a shaft with a disc: tan x = -(J_w / J) x.
    #[test]
    fn a_disc_on_the_shaft_has_the_frequency_of_the_closed_form() {
        let disc_kg_m2 = 1.1e-3;
        // The root between a quarter and half a wave.
        let (mut low, mut high) = (0.5 * PI + 1e-9, PI);
        for _ in 0..100 {
            let x = 0.5 * (low + high);
            let value = libm::sin(x) * SHAFT.inertia_kg_m2 + libm::cos(x) * disc_kg_m2 * x;
            if value > 0.0 { low = x } else { high = x }
        }
        let known = low * libm::sqrt(SHAFT.stiffness_n_m2 / (SHAFT.inertia_kg_m2 * SHAFT.length_m));
        let mut last = f64::INFINITY;
        for (modes, within) in [(1, 1e-3), (2, 1.5e-4), (3, 5e-5), (8, 3e-6)] {
            let shaft = UniformShaft { modes, ..SHAFT };
            // Free together: J_0 w^2 + sum of k_i w^2 / (w_i^2 - w^2) = 0, between the first disc's own frequency and the second's.
            let rigid = disc_kg_m2 + shaft.rigid_inertia_kg_m2();
            let dynamic = |w2: f64| {
                let of = |d: TorsionMode| {
                    let own2 = d.stiffness_nm_per_rad / d.inertia_kg_m2;
                    d.inertia_kg_m2 * own2 / (own2 - w2)
                };
                rigid + shaft.discs().map(of).sum::<f64>()
            };
            let own = |number: usize| {
                UniformShaft::wave(number) * libm::sqrt(SHAFT.stiffness_n_m2 / (SHAFT.inertia_kg_m2 * SHAFT.length_m))
            };
            let (mut low, mut high) = (own(0) * (1.0 + 1e-9), own(1) * (1.0 - 1e-9));
            for _ in 0..200 {
                let middle = 0.5 * (low + high);
                if dynamic(middle * middle) < 0.0 { low = middle } else { high = middle }
            }
            let error = (low / known - 1.0).abs();
            println!("{modes} modes: {error:.1e}");
            assert!(error < within && error < last, "{modes} modes: {low} of {known}, {error:.1e}");
            last = error;
        }
    }

    /// A constant torque at the free end twists it by T l / (G I_p), less what the modes left out would give.
    #[test]
    fn a_constant_torque_twists_the_end_by_the_shaft_s_compliance() {
        for modes in [1, 2, 4, 8] {
            let shaft = UniformShaft { modes, ..SHAFT };
            let twist: f64 = shaft
                .shares_at(shaft.length_m)
                .zip(shaft.discs())
                .map(|(share, disc)| share * share / disc.stiffness_nm_per_rad)
                .sum();
            let missing = 1.0 - twist * shaft.stiffness_n_m2 / shaft.length_m;
            assert!(missing > 0.0 && (missing * modes as f64 - 0.2).abs() < 0.015, "{modes} modes: {missing}");
        }
    }

    #[test]
    fn all_inertia_is_shared_out() {
        let rigid = SHAFT.rigid_inertia_kg_m2();
        let discs: f64 = SHAFT.discs().map(|d| d.inertia_kg_m2).sum();
        assert!((rigid + discs - SHAFT.inertia_kg_m2).abs() < 1e-18 && rigid > 0.0 && rigid < 0.03 * discs);
    }
}
