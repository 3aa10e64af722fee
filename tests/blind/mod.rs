//! Blind cases for `pitchline identify`: measured records of drives whose deviation from what is declared is known.
//!
//! This code is independent of pitchline. The equations are those of the catalogue's rows, implemented again with
//! another scheme: Heun's rule at 20 or 40 steps a sample where the product uses fourth-order Runge-Kutta, friction by
//! a sticking rule or by tanh, filters by their exact decay, delays as shifted series. Every record runs for a while
//! before it is recorded, so that filters, delays and hidden springs have a history that the file does not contain.
//!
//! ```text
//! one    J v' = g u - c v                                                    v measured; a rotor or a slider
//! two    J1 v1' = g u - F - c1 v1     J2 v2' = F - c2 v2                     v1, v2 measured
//!        F = k (q1 - q2) + d (v1 - v2)
//! chain  v1 measured as input         J2 v2' = r2 F - c2 v2 - T              v2, F measured
//!        F = k l + d l'   l = r1 q1 - r2 q2 + what runs out of true
//! ```
//! All values are SI inside. Effects that a case cannot distinguish are found independently: from the effect's
//! contribution with the directions of all free parameters and initial states projected out, and from other effects
//! with the same contribution.
#![allow(dead_code)] // each test uses its own part

mod cases;
mod effects;
mod files;
mod machine;
mod numbers;
mod records;
mod simulation;
mod weighing;

use cases::attempted;
use machine::Kind;
use numbers::Random;

/// Name under which the measurement file knows the drive.
pub const DRIVE_FILE: &str = "drive.toml";
/// Name for the measurement file.
pub const MEASUREMENT_FILE: &str = "measurement.toml";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// One effect of the catalogue.
    Single,
    /// None.
    Clean,
    /// A cause outside the catalogue.
    Outside,
    /// One effect, and at least one other that the records cannot distinguish from it.
    Confusable,
    /// Two effects of different parts.
    Double,
}

/// A deviation of the drive from its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// `effects.NAME.TARGET`; for class Outside `outside.NAME.TARGET`.
    pub path: String,
    /// Path and value of every parameter, in the unit of its key.
    pub sizes: Vec<(String, f64)>,
    /// Root mean square of its contribution to the channel that shows it best, over that channel's noise.
    pub over_floor: f64,
    /// The same on the fitting data, after the best change (linear) of all free parameters and initial states.
    pub after_fit: f64,
    /// Length of this contribution in standard deviations of noise, all channels and samples together: below 3 it
    /// cannot be found.
    pub sigmas: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    pub name: String,
    pub class: Class,
    pub drive_toml: String,
    pub measurement_toml: String,
    /// Name and content of every measured file.
    pub csvs: Vec<(String, String)>,
    pub truth: Vec<Truth>,
    /// Path and value of every free parameter: the result of a fit with the complete model.
    pub numbers: Vec<(String, f64)>,
    /// Paths that explain these records as well as the truth; only effects known to this file are considered.
    pub rivals: Vec<String>,
}

/// The case of this class and number, always the same.
pub fn case(class: Class, number: u64) -> Case {
    let mut random = Random::new(1 + class as u64, number);
    for attempt in 0..400 {
        if let Some(case) = attempted(class, number, attempt, &mut random) {
            return case;
        }
    }
    panic!("no case of {class:?} {number} in 400 attempts");
}

/// Steps per sample of the written records. Compared with four times as many, the records change by 0.03 of the noise
/// at most.
const FINE: usize = 20;
/// The same for a chain's machine, whose gauge shows the span's own oscillation.
const FINE_CHAIN: usize = 40;
/// Steps per sample when a case is only weighed.
const COARSE: usize = 3;
fn fine(kind: Kind) -> usize {
    if kind == Kind::Chain { FINE_CHAIN } else { FINE }
}

/// Smallest and largest contribution of an effect over the noise floor.
const MARK: (f64, f64) = (0.5, 20.0);
