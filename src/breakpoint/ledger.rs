//! The energy ledger of a step from its own sums, for breakpoints: those of a frame's ledger in another order.

use crate::elements::rotor::Rotor;
use crate::elements::tooth_contact::{Column, LANES};
use crate::integrate::explicit::{Part, Scratch};
use crate::model::Model;
use crate::recording::frame::Energy;
use crate::state::State;

/// Rounding of sums in another order, as a share of what is summed.
const ROUNDING: f64 = 1e-10;

/// Steps after which running sums are made anew: their rounding stays far below [`ROUNDING`].
const FRESH_STEPS: u64 = 256;

/// The ledger of a run that is looked at step by step, from the sums that a step keeps on the way ([`Scratch::watch`]).
pub struct Ledger {
    /// Energy of what the joints' stretch is squared in [N/m].
    half_stiffness: f64,
    parts: Vec<Part>,
    /// Lost in joints and contacts before the step to be looked at next [J]; which that is, and when it was last summed whole.
    lost_j: f64,
    next: Option<u64>,
    summed: u64,
    /// What the last look found.
    now: (Energy, f64),
}

impl Ledger {
    pub fn new(model: &Model) -> Ledger {
        Ledger {
            half_stiffness: 0.5 * model.chain.joint.stiffness_n_per_m,
            parts: Part::of(model),
            lost_j: 0.0,
            next: None,
            summed: 0,
            now: (Energy::default(), 0.0),
        }
    }

    /// Energies of the node since `origin`, losses in one of their classes, what is elastic in joints and contacts in another, and
    /// how uncertain they are [J]; None where the step has kept no sums, or a contact law needs more than a depth.
    pub fn look(
        &mut self,
        (model, state, scratch): (&Model, &State, &Scratch),
        origin: &Energy,
    ) -> Option<&(Energy, f64)> {
        let sums = scratch.sums().filter(|s| s.linear)?;
        let h = model.step_s;
        if self.next != Some(state.step) || state.step >= self.summed + FRESH_STEPS {
            self.lost_j = self.lost_before(model, state);
            self.summed = state.step;
        }
        let (mut elastic, mut lost) = (sums.elastic_j, sums.lost_j);
        for k in 0..LANES {
            elastic[k] += self.half_stiffness * sums.stretch2[k];
            lost[k] += h * sums.pins_w[k];
        }
        let (mut kinetic_j, elastic_j, step_j) = (0.5 * total(&sums.twice_kinetic_j), total(&elastic), total(&lost));
        // At the node half of the step's losses are still to come.
        let lost_j = self.lost_j + 0.5 * step_j;
        self.lost_j += step_j;
        self.next = Some(state.step + 1);
        let (mut work_in_j, mut work_out_j) = (0.0, 0.0);
        for (k, sprocket) in model.sprockets.iter().enumerate() {
            let speed = state.rotors.omega[k] + 0.5 * h * scratch.rotor_alpha[k];
            work_in_j += state.rotors.work_in[k];
            work_out_j += state.rotors.work_out[k];
            match sprocket.rotor {
                Rotor::Driven { .. } => work_in_j -= scratch.chain_torque[k] * (0.5 * h * speed),
                Rotor::Free { inertia_kg_m2, torque_nm } => {
                    kinetic_j += 0.5 * inertia_kg_m2 * speed * speed;
                    work_out_j -= torque_nm * (0.5 * h * speed);
                }
            }
        }
        let stored_j = kinetic_j + elastic_j;
        let (e, blur_j) = &mut self.now;
        *blur_j = ROUNDING * (stored_j + work_in_j.abs() + work_out_j.abs() + lost_j.abs());
        (e.kinetic_j, e.elastic_joint_j) = (kinetic_j, elastic_j);
        e.work_in_j = work_in_j - origin.work_in_j;
        e.work_out_j = work_out_j - origin.work_out_j;
        e.lost_pin_damping_j = lost_j - origin.lost_j();
        e.error_j = e.work_in_j - e.work_out_j - e.lost_pin_damping_j - (stored_j - origin.stored_j());
        Some(&self.now)
    }

    /// Lost in joints and contacts before this step [J].
    #[cold]
    #[inline(never)]
    fn lost_before(&self, model: &Model, state: &State) -> f64 {
        let n = model.chain.n_links;
        let own = |a: &[f64], b: &[f64]| a[..n].iter().zip(&b[..n]).map(|(a, b)| a + b).sum::<f64>();
        let contacts = |part: &Part| {
            let memory = match *part {
                Part::Bushes => &state.bushes,
                Part::Guides(set) => &state.guide_ends[set],
                Part::Contours(set) => &state.contour_ends[set],
            };
            own(&memory.lost_damping, &memory.lost_friction)
        };
        own(&state.lost_pin_damping, &state.lost_pin_friction) + self.parts.iter().map(contacts).sum::<f64>()
    }
}

/// In pairs.
fn total(s: &Column) -> f64 {
    ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))
}
