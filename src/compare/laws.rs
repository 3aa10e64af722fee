//! The comparison under other contact laws: whether what it says is a property of the chains, or of the law.
//!
//! Three laws, each for three restitutions:
//! ```text
//! linear         F = k d + c d'                c = 2 zeta sqrt(k m),  e = exp(-tan(alpha) (pi - 2 alpha)),  zeta = sin(alpha)
//! Hunt-Crossley  F = k d (1 + lambda d'/v_r)   v_r = p omega
//! Hertz's power  F = K d^1.5 (1 + lambda d'/v_r)
//! ```
//! The first relation is exact for a mass that leaves where the force has fallen to zero (Schwager & Poeschel 2007); m is that of the end of
//! a link, 1/m = 1/m_link + l^2/J. lambda: [`crate::elements::contact_law`]. k is the drive's own; K gives the same force at the same depth at
//! [`MATCHED_N`]. Damping over v_0, the speed of the own touch, was tried and left: what touches slowly and then bears the chain is damped
//! so much that no step of a microsecond bears it.

use super::{CompareError, DriveSummary, Plan, run, verdict};
use crate::assemble::compile;
use crate::drive::{ContactSpec, Drive};
use crate::elements::contact_law::{ContactLaw, PairRadii, restitution_hysteresis};
use std::sync::atomic::AtomicBool;

/// Force at which all laws have the depth of the drive's own [N]: abutments and guides bear as much, bushes some times more.
pub const MATCHED_N: f64 = 100.0;
pub const RESTITUTIONS: [f64; 3] = [0.3, 0.5, 0.7];
/// Share of p omega below which a touch is no impact, and above which it is one.
const NO_IMPACT_SHARE: f64 = 0.03;
const IMPACT_SHARE: f64 = 0.1;

/// A law of all contacts of links with sprockets, rings and guides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LawKind {
    Linear,
    HuntCrossley,
    Hertz,
}

pub const LAWS: [LawKind; 3] = [LawKind::Linear, LawKind::HuntCrossley, LawKind::Hertz];

impl LawKind {
    pub fn words(self) -> &'static str {
        match self {
            LawKind::Linear => "linear spring and damper",
            LawKind::HuntCrossley => "Hunt-Crossley, exponent 1",
            LawKind::Hertz => "Hunt-Crossley, exponent 1.5",
        }
    }
}

/// One drive under one law.
#[derive(Clone, Debug, serde::Serialize)]
pub struct LawResult {
    pub drive: String,
    /// Whether it is an abutment chain: that is the one that must engage without impact.
    pub abutments: bool,
    /// Approach speed of the fastest first touch of an abutment chain, of the median seating in the teeth of another, over p omega.
    pub touch_share: f64,
    /// Largest force while engaging [N].
    pub peak_n: f64,
    /// Whether it does what the comparison claims of it.
    pub holds: bool,
}

/// All drives under one law with one restitution.
#[derive(Clone, Debug, serde::Serialize)]
pub struct LawRow {
    pub law: LawKind,
    pub restitution: f64,
    pub drives: Vec<LawResult>,
    /// Claims of the comparison that fail under this law.
    pub failing: Vec<String>,
}

impl LawRow {
    /// Whether abutment chains engage without impact, and the others do not.
    pub fn holds(&self) -> bool {
        self.drives.iter().all(|d| d.holds)
    }
}

/// Damping ratio of a linear spring and damper with this restitution.
fn damping_ratio(e: f64) -> f64 {
    let restitution = |alpha: f64| libm::exp(-libm::tan(alpha) * (std::f64::consts::PI - 2.0 * alpha));
    // Falls from 1 to e^-2 at critical damping.
    let (mut low, mut high) = (0.0, 0.5 * std::f64::consts::PI - 1e-9);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if restitution(middle) > e {
            low = middle;
        } else {
            high = middle;
        }
    }
    libm::sin(low)
}

/// Depth at which a law bears [`MATCHED_N`] at rest [m].
fn matched_depth_m(law: &ContactLaw, radii: PairRadii) -> f64 {
    let (mut low, mut high) = (0.0, 1e-2);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if law.elastic(middle, radii).force_n < MATCHED_N {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// A law of this kind in place of another.
fn law_like(own: &ContactLaw, kind: LawKind, e: f64, radii: PairRadii, (mass_kg, speed_m_s): (f64, f64)) -> ContactLaw {
    let depth_m = matched_depth_m(own, radii);
    let (stiffness_n_per_m, damping_s_per_m) = (MATCHED_N / depth_m, restitution_hysteresis(e) / speed_m_s);
    match kind {
        LawKind::Linear => ContactLaw::Linear {
            stiffness_n_per_m,
            damping_n_s_per_m: 2.0 * damping_ratio(e) * libm::sqrt(stiffness_n_per_m * mass_kg),
        },
        LawKind::HuntCrossley => {
            ContactLaw::HuntCrossley { stiffness_n_per_m_n: stiffness_n_per_m, exponent: 1.0, damping_s_per_m }
        }
        LawKind::Hertz => {
            let stiffness_n_per_m_n = MATCHED_N / libm::pow(depth_m, 1.5);
            ContactLaw::HuntCrossley { stiffness_n_per_m_n, exponent: 1.5, damping_s_per_m }
        }
    }
}

/// A drive with other laws between links and sprockets, rings and guides. `mass_kg`: of the end of a link.
fn with_law(drive: &Drive, kind: LawKind, e: f64, mass_kg: f64) -> Drive {
    let mut drive = drive.clone();
    let speed_m_s =
        drive.chain_speed_m_s().abs() * 2.0 * std::f64::consts::PI / f64::from(drive.sprockets[drive.driver()].teeth);
    let change = |contacts: [&mut ContactSpec; 3], bush_m: f64| {
        let radii = PairRadii { bush_m, body_m: f64::INFINITY };
        for contact in contacts {
            contact.law = law_like(&contact.law, kind, e, radii, (mass_kg, speed_m_s));
        }
    };
    let radius_m = |bush_m: f64| if bush_m > 0.0 { 0.5 * bush_m } else { 1e-3 };
    let bush_m = radius_m(drive.chain.bush_diameter_m());
    change([&mut drive.tooth_contact, &mut drive.ring_contact, &mut drive.guide_contact], bush_m);
    for part in &mut drive.more {
        let bush_m = radius_m(part.chain.bush_diameter_m());
        change([&mut part.tooth_contact, &mut part.ring_contact, &mut part.guide_contact], bush_m);
    }
    drive
}

/// Mean over the links of the inverse of 1/m + l^2/J [kg].
fn end_mass_kg(drive: &Drive) -> Result<f64, CompareError> {
    let assembly = |error| CompareError::Assembly { drive: drive.name.clone(), error };
    let model = compile(drive).map_err(assembly)?.model;
    let c = &model.chain;
    let links: Vec<usize> = c.links().collect();
    let mass = |i: usize| 1.0 / (c.inverse_mass[i] + c.lever[i] * c.lever[i] * c.inverse_inertia[i]);
    Ok(links.iter().map(|i| mass(*i)).sum::<f64>() / links.len().max(1) as f64)
}

/// Runs all drives under all laws and restitutions; `told` is called with every row as it is done.
pub fn under_all_laws(
    drives: &[Drive],
    plan: Plan,
    stop: &AtomicBool,
    mut told: impl FnMut(&LawRow),
) -> Result<Vec<LawRow>, CompareError> {
    let masses = drives.iter().map(end_mass_kg).collect::<Result<Vec<_>, _>>()?;
    let mut rows = Vec::new();
    for law in LAWS {
        for restitution in RESTITUTIONS {
            let changed: Vec<Drive> =
                drives.iter().zip(&masses).map(|(d, mass_kg)| with_law(d, law, restitution, *mass_kg)).collect();
            let runs = run(&changed, plan, stop)?;
            let summaries: Vec<&DriveSummary> = runs.iter().map(|r| &r.summary).collect();
            let claims = verdict(&summaries).unwrap_or_default();
            let failing = claims.iter().filter(|c| !c.holds).map(|c| format!("{}: {}", c.claim, c.measured)).collect();
            let row = LawRow { law, restitution, drives: summaries.iter().map(|s| result_of(s)).collect(), failing };
            told(&row);
            rows.push(row);
        }
    }
    Ok(rows)
}

fn result_of(s: &DriveSummary) -> LawResult {
    let abutments = s.sequence.is_some();
    let seated = s.tooth().map_or(f64::NAN, |k| k.approach_median_m_s);
    let touch_share = if abutments { s.fastest_touch_m_s() } else { seated } / s.turning_speed_m_s;
    let holds = if abutments { touch_share <= NO_IMPACT_SHARE } else { touch_share > IMPACT_SHARE };
    LawResult { drive: s.drive.clone(), abutments, touch_share, peak_n: s.largest_n().0, holds }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mass on a linear spring and damper leaves with the restitution that was asked for, by fine steps.
    #[test]
    fn the_damping_ratio_gives_its_restitution() {
        for e in [0.2, 0.3, 0.5, 0.7, 0.95] {
            let (k, m) = (1e8, 1.2e-3);
            let c = 2.0 * damping_ratio(e) * f64::sqrt(k * m);
            let h = 1e-4 * f64::sqrt(m / k);
            let (mut d, mut v) = (0.0_f64, 1.0_f64);
            let a = |d: f64, v: f64| -(k * d + c * v) / m;
            loop {
                let (dm, vm) = (d + 0.5 * h * v, v + 0.5 * h * a(d, v));
                (d, v) = (d + h * vm, v + h * a(dm, vm));
                if k * d + c * v < 0.0 {
                    break;
                }
            }
            println!("restitution {e}: {:.6}", -v);
            // measured 2e-7 and less.
            assert!((-v - e).abs() < 1e-4, "{e} {v}");
        }
    }
}
