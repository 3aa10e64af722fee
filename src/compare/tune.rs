//! Optimises an abutment chain's free parameters. The distribution of the load at entry, along the wrap and at exit
//! depends on the design tension T*, the root relief and the preload together, and the bounds of impact-free engagement
//! are met only in a corner of that space. Pattern search on the worst margin: every parameter is moved up and down by
//! its step and the best trial is kept; the steps are halved when no trial is better. Deterministic.

use super::{CompareError, DriveSummary, Plan, run};
use crate::drive::{ChainSpec, Drive};
use crate::engagement::ContactKind;
use std::sync::atomic::AtomicBool;

/// A free parameter: path in the drive file with its unit, value and step.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Free {
    pub path: String,
    pub value: f64,
    pub step: f64,
}

/// Margin to a bound: 1 - value / bound, negative if violated.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Margin {
    pub name: &'static str,
    pub value: f64,
    pub bound: f64,
    pub unit: &'static str,
    pub margin: f64,
}

/// Result of a search.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Tuned {
    pub start: Vec<Margin>,
    pub best: Vec<Margin>,
    pub values: Vec<Free>,
    pub runs: usize,
}

/// Passes in one trial.
const PASSES: f64 = 12.0;
/// Maximum number of rounds.
const MAX_ROUNDS: usize = 5;

/// The bounds of impact-free engagement and the measured values.
pub fn margins(s: &DriveSummary) -> Vec<Margin> {
    let (window, lap) = s.largest_n();
    let pressing = s.tight_tension_n - s.centrifugal_tension_n;
    let ring = s.kind(ContactKind::RingFront).map_or(f64::INFINITY, |k| k.peak_window_n);
    let rise = s.tooth().map_or(0.0, |k| k.rise_t);
    let below = |name, value: f64, bound: f64, unit| Margin { name, value, bound, unit, margin: 1.0 - value / bound };
    vec![
        below("fastest first touch", s.fastest_touch_m_s(), 0.03 * s.turning_speed_m_s, "m/s"),
        below("largest force, engaging", window, 130.0, "N"),
        below("largest force, lap", lap, 150.0, "N"),
        below("ring force", ring, 0.30 * pressing, "N"),
        below("speed ripple", 100.0 * s.speed_ripple, 0.15, "%"),
        // Ten times as slow as a silent chain of the same drive, 0.045 T.
        Margin { name: "rise of the tooth force", value: rise, bound: 0.45, unit: "T", margin: rise / 0.45 - 1.0 },
        Margin {
            name: "sequence in order",
            value: s.sequence.unwrap_or(0.0),
            bound: 0.99,
            unit: "",
            // Met or violated; exceeding the bound has no benefit.
            margin: if s.sequence.unwrap_or(0.0) >= 0.99 { 1.0 } else { -1.0 },
        },
    ]
}

/// The smallest margin.
pub fn smallest_margin(margins: &[Margin]) -> f64 {
    // A value that could not be measured counts as violated.
    let known = |m: &Margin| if m.margin.is_nan() { f64::NEG_INFINITY } else { m.margin };
    margins.iter().map(known).fold(f64::INFINITY, f64::min)
}

/// Searches from the drive's own values. None for a drive without abutments.
pub fn tune(drive: &Drive, stop: &AtomicBool, mut told: impl FnMut(usize, f64)) -> Result<Option<Tuned>, CompareError> {
    let ChainSpec::Abutment(chain) = drive.chain else { return Ok(None) };
    let mut values = vec![
        Free { path: "chain.smartchain.design_tension_n".into(), value: chain.design_tension_n, step: 20.0 },
        Free { path: "preload.tension_n".into(), value: drive.preload.tension_n(), step: 15.0 },
    ];
    for s in &drive.sprockets {
        let path = format!("sprockets.{}.root_relief_um", s.name);
        values.push(Free { path, value: s.root_relief_m * 1e6, step: 8.0 });
    }
    let trial = |values: &[Free]| -> Result<Vec<Margin>, CompareError> {
        let mut overrides = drive.overrides.clone();
        overrides.extend(values.iter().map(|f| format!("{}={}", f.path, f.value)));
        let changed = Drive::parse(&drive.name, &drive.text, &overrides).map_err(CompareError::Drive)?;
        let period_s = (changed.chain.pitch_m() / changed.chain_speed_m_s()).abs();
        // A pass takes half a revolution and some pitches.
        let teeth = changed.sprockets.get(changed.driver()).map_or(0.0, |s| f64::from(s.teeth));
        let periods = 2.0 * libm::ceil(0.5 * (0.5 * teeth + 6.0 + PASSES));
        let plan = Plan { duration_s: periods * period_s, recorded_s: 0.0, every_s: 1e-3 };
        Ok(margins(&run(std::slice::from_ref(&changed), plan, stop)?[0].summary))
    };
    let start = trial(&values)?;
    let mut best = start.clone();
    let mut runs = 1;
    told(runs, smallest_margin(&best));
    for _ in 0..MAX_ROUNDS {
        let mut moves = Vec::new();
        for i in 0..values.len() {
            for sign in [1.0, -1.0] {
                let mut moved = values.clone();
                moved[i].value = (moved[i].value + sign * moved[i].step).max(0.0);
                moves.push(moved);
            }
        }
        runs += moves.len();
        // A set that cannot be assembled or breaks down is skipped; only an interruption ends the search.
        let tried = super::in_parallel(moves, |moved: Vec<Free>| match trial(&moved) {
            Ok(margins) => Ok(Some((moved, margins))),
            Err(CompareError::Interrupted) => Err(CompareError::Interrupted),
            Err(_) => Ok(None),
        })?;
        let winner = tried.into_iter().flatten().max_by(|a, b| smallest_margin(&a.1).total_cmp(&smallest_margin(&b.1)));
        match winner {
            Some((moved, margins)) if smallest_margin(&margins) > smallest_margin(&best) => {
                (values, best) = (moved, margins)
            }
            _ => values.iter_mut().for_each(|f| f.step *= 0.5),
        }
        told(runs, smallest_margin(&best));
    }
    Ok(Some(Tuned { start, best, values, runs }))
}
