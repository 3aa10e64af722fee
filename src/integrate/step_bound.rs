//! The largest step that the explicit scheme bears.
//!
//! ```text
//! contact           h <= 0.95 / sqrt(k w)      accuracy: three steps in half a period of the contact oscillator
//! contact damping   h <= 0.75 / (c w)          accuracy: the series of the mean force takes c w h as small
//! pin damping       h <= 1.00 / (c_j 4 w_j)    accuracy: peaks are right to 0.8 % there
//! pin stiffness     h <= 1.00 / sqrt(k_j 4 w_j)  the joints' second look lifts stability to 3.46
//! ```
//! w = 1/m + l^2/J, the inverse effective mass of a link's end; w_j = max(1/m, l^2/J) of the lightest link. The constants of
//! the first two lines are measured: see tests/convergence.rs, which holds the errors they stand for.

use crate::elements::contact_law::{ContactLaw, PairRadii};
use crate::model::{Model, flank_radii};

/// One bound and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct StepBound {
    pub step_s: f64,
    pub cause: String,
}

/// Force up to which nonlinear laws are kept accurate [N]: peaks of the bush chain are some 1000 N.
const PEAK_FORCE_N: f64 = 1000.0;

const CONTACT: f64 = 0.95;
const CONTACT_DAMPING: f64 = 0.75;
const PIN_DAMPING: f64 = 1.0;
const PIN_STIFFNESS: f64 = 1.0;

/// The smallest of all bounds.
pub fn step_bound(model: &Model) -> StepBound {
    let chain = &model.chain;
    let n = chain.n_links;
    let largest = |f: &dyn Fn(usize) -> f64| (0..n).map(f).fold(0.0_f64, f64::max);
    let bush_mobility =
        largest(&|j| chain.bush_inverse_mass[j] + chain.bush_lever[j].powi(2) * chain.bush_inverse_inertia[j]);
    let end_mobility = largest(&|i| chain.inverse_mass[i] + chain.lever[i].powi(2) * chain.inverse_inertia[i]);
    let joint_mobility = largest(&|i| chain.inverse_mass[i].max(chain.lever[i].powi(2) * chain.inverse_inertia[i]));
    let mut bounds = Vec::new();
    for s in model.sprockets.iter().filter(|s| s.geometry.iso().is_some()) {
        bounds.extend(contact_bounds(&format!("sprockets.{}", s.name), &s.body.law, flank_radii(s), bush_mobility));
    }
    if let Some(contour) = &model.contour {
        let arm = contour.longest_arm_m(chain.lever[0]);
        let contour_mobility = largest(&|i| chain.inverse_mass[i] + arm * arm * chain.inverse_inertia[i]);
        for b in &model.end_bodies {
            let radii = PairRadii { bush_m: arm, body_m: f64::INFINITY };
            bounds.extend(contact_bounds(&b.name, &b.law, radii, contour_mobility));
        }
    }
    for g in model.guides.iter().filter(|g| g.body.touches_plates) {
        let radii = PairRadii { bush_m: g.body.plate_radius_m, body_m: f64::INFINITY };
        bounds.extend(contact_bounds(&format!("guides.fixed.{}", g.name), &g.body.law, radii, end_mobility));
    }
    let joint = &chain.joint;
    if joint.damping_n_s_per_m > 0.0 {
        bounds.push(StepBound {
            step_s: PIN_DAMPING / (joint.damping_n_s_per_m * 4.0 * joint_mobility),
            cause: "damping of the joints (chain.joint)".into(),
        });
    }
    bounds.push(StepBound {
        step_s: PIN_STIFFNESS / libm::sqrt(joint.stiffness_n_per_m * 4.0 * joint_mobility),
        cause: "stiffness of the joints (chain.joint)".into(),
    });
    bounds.into_iter().min_by(|a, b| a.step_s.total_cmp(&b.step_s)).expect("the joints always give a bound")
}

fn contact_bounds(name: &str, law: &ContactLaw, radii: PairRadii, mobility: f64) -> [StepBound; 2] {
    let stiffness = law.stiffness_at(PEAK_FORCE_N, radii);
    let damping = law.damping_at(PEAK_FORCE_N).max(1e-9);
    [
        StepBound { step_s: CONTACT / libm::sqrt(stiffness * mobility), cause: format!("contact stiffness at {name}") },
        StepBound { step_s: CONTACT_DAMPING / (damping * mobility), cause: format!("contact damping at {name}") },
    ]
}

/// The bound rounded down to two digits: the step that is taken when none is asked for.
pub fn default_step(bound: &StepBound) -> f64 {
    let decade = libm::pow(10.0, libm::floor(libm::log10(bound.step_s)) - 1.0);
    libm::floor(bound.step_s / decade * (1.0 + 1e-12)) * decade
}
