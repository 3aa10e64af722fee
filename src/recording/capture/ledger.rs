//! The ledger of energies at a node.

use super::super::frame::{Energy, Links};
use super::{Node, SortedContacts};
use crate::drive::Scheme;
use crate::elements::coordinate::{Coordinate, CoordinateMotion};
use crate::elements::link_joint::LinkJoint;
use crate::integrate::explicit::{ContactGroup, Scratch, rollers, shafts, touches};
use crate::integrate::{VectorKernel, vectorised};
use crate::lanes::{LANES, LaneBlock, take};
use crate::model::{ChainModel, Model};
use crate::state::State;

/// Terms of a sum over the lanes of a loop.
trait LaneTerms {
    fn count(&self) -> usize;
    fn block(&self, at: usize) -> LaneBlock;
    fn one(&self, k: usize) -> f64;
}

/// Sum in eight parts: of one part, every term waits for the one before.
#[inline(always)]
fn sum_of(terms: &impl LaneTerms) -> f64 {
    let n = terms.count();
    let mut parts = [0.0; LANES];
    let whole = n - n % LANES;
    for at in (0..whole).step_by(LANES) {
        let block = terms.block(at);
        for i in 0..LANES {
            parts[i] += block[i];
        }
    }
    for i in whole..n {
        parts[i - whole] += terms.one(i);
    }
    parts.iter().sum()
}

/// Values of a column.
struct ColumnTerms<'a>(&'a [f64]);

impl LaneTerms for ColumnTerms<'_> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.0.len()
    }

    #[inline(always)]
    fn block(&self, at: usize) -> LaneBlock {
        take(self.0, at)
    }

    #[inline(always)]
    fn one(&self, k: usize) -> f64 {
        self.0[k]
    }
}

/// Kinetic energies of links: velocities, mass, inertia, inverse mass.
struct KineticTerms<'a>([&'a [f64]; 6]);

#[inline(always)]
fn kinetic(vx: f64, vy: f64, omega: f64, [mass, inertia, inverse_mass]: [f64; 3]) -> f64 {
    let energy_j = 0.5 * (mass * (vx * vx + vy * vy) + inertia * omega * omega);
    if inverse_mass == 0.0 { 0.0 } else { energy_j }
}

impl LaneTerms for KineticTerms<'_> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.0[0].len()
    }

    #[inline(always)]
    fn block(&self, at: usize) -> LaneBlock {
        let [vx, vy, omega, mass, inertia, inverse_mass] = self.0.map(|column| take(column, at));
        let mut block = [0.0; LANES];
        for i in 0..LANES {
            block[i] = kinetic(vx[i], vy[i], omega[i], [mass[i], inertia[i], inverse_mass[i]]);
        }
        block
    }

    #[inline(always)]
    fn one(&self, k: usize) -> f64 {
        let [vx, vy, omega, inertial @ ..] = self.0.map(|column| column[k]);
        kinetic(vx, vy, omega, inertial)
    }
}

/// Elastic energies of joints, whose ends are at x, x, y, y.
struct StretchTerms<'a>(&'a LinkJoint, [&'a [f64]; 4]);

impl LaneTerms for StretchTerms<'_> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.1[0].len()
    }

    #[inline(always)]
    fn block(&self, at: usize) -> LaneBlock {
        let mut block = [0.0; LANES];
        for i in 0..LANES {
            block[i] = self.one(at + i);
        }
        block
    }

    #[inline(always)]
    fn one(&self, k: usize) -> f64 {
        let [front_x, rear_x, front_y, rear_y] = self.1.map(|column| column[k]);
        self.0.force(front_x - rear_x, front_y - rear_y, 0.0, 0.0).stored
    }
}

/// Sum over links and rollers of a column that all lanes have; zero of one that is not kept.
#[inline(always)]
fn sum_own(chain: &ChainModel, column: &[f64]) -> f64 {
    let mut sum = 0.0;
    let own = chain.loops.iter().chain(chain.rollers.iter().filter(|r| !r.is_empty()));
    for own in own.filter(|_| !column.is_empty()) {
        sum += sum_of(&ColumnTerms(&column[own.clone()]));
    }
    sum
}

/// Kinetic energy of rollers that are bodies of their own [J].
fn kinetic_of_rollers(model: &Model, state: &State, scratch: &Scratch) -> f64 {
    let (c, s, half) = (&model.chain, &state.links, 0.5 * model.step_s);
    let of = |i: usize| {
        let at_node = |v: &[f64], a: &[f64]| v[i] + half * a[i];
        let (vx, vy) = (at_node(&s.vx, &scratch.ax), at_node(&s.vy, &scratch.ay));
        kinetic(vx, vy, at_node(&s.omega, &scratch.alpha), [c.mass[i], c.inertia[i], c.inverse_mass[i]])
    };
    c.all_rollers().map(of).sum()
}

/// What the kinetic energies before and after a step's impulses are in the mean above that of the mean speeds [J]: impacts of rigid bodies
/// change speeds within a node. Zero for other schemes than Moreau's.
pub(crate) fn kinetic_of_impacts(model: &Model, scratch: &Scratch) -> f64 {
    let Scheme::Moreau { .. } = model.scheme else { return 0.0 };
    let (c, half) = (&model.chain, 0.5 * model.step_s);
    let of = |i: usize| {
        let [x, y, turn] = [scratch.ax[i], scratch.ay[i], scratch.alpha[i]].map(|a| half * a);
        kinetic(x, y, turn, [c.mass[i], c.inertia[i], c.inverse_mass[i]])
    };
    let turned = |(k, coordinate): (usize, &Coordinate)| match coordinate.motion {
        CoordinateMotion::Free { inertia, .. } => 0.5 * inertia * (half * scratch.coordinate_alpha[k]).powi(2),
        CoordinateMotion::Prescribed { .. } | CoordinateMotion::Held => 0.0,
    };
    c.links().map(of).sum::<f64>() + model.coordinates.iter().enumerate().map(turned).sum::<f64>()
}

/// All energies at the node; losses and work since the State's ledger was opened.
pub(super) fn ledger(node: &Node<'_>, links: &Links, rows: &SortedContacts) -> Energy {
    vectorised(node.scratch.isa, LedgerKernel { node, links, rows })
}

struct LedgerKernel<'a> {
    node: &'a Node<'a>,
    links: &'a Links,
    rows: &'a SortedContacts,
}

impl VectorKernel for LedgerKernel<'_> {
    type Output = Energy;

    #[inline(always)]
    fn run(self) -> Energy {
        let LedgerKernel { node, links, rows } = self;
        let Node { model, state, scratch, .. } = *node;
        let (c, h) = (&model.chain, model.step_s);
        let [(front_x, rear_x), (front_y, rear_y)] = scratch.joint_ends();
        let (mut kinetic_j, mut elastic_joint_j, mut first) = (0.0, 0.0, 0);
        for own in &c.loops {
            let n = own.len();
            let [vx, vy, omega] = [&links.vx_m_s, &links.vy_m_s, &links.omega_rad_s].map(|v| &v[first..first + n]);
            let [mass, inertia, inverse_mass] = [&c.mass, &c.inertia, &c.inverse_mass].map(|v| &v[own.clone()]);
            kinetic_j += sum_of(&KineticTerms([vx, vy, omega, mass, inertia, inverse_mass]));
            let ends = [front_x, rear_x, front_y, rear_y].map(|v| &v[own.clone()]);
            elastic_joint_j += sum_of(&StretchTerms(c.joint(own.start), ends));
            first += n;
        }
        let mut e = Energy { kinetic_j, elastic_joint_j, ..Energy::default() };
        shafts::add_energies(model, state, scratch, &mut e);
        let [stored_j, damping_j, friction_j] = touches::energies(model, state, scratch);
        if let Some(oil) = &model.oil {
            e.elastic_oil_j = oil.stored_j(&state.oil);
            e.lost_oil_j = state.oil.lost_j.iter().sum();
            e.work_oil_j = state.oil.work_j.iter().sum();
        }
        e.kinetic_j += kinetic_of_impacts(model, scratch);
        e.elastic_contact_j = rows.iter().map(|r| r.stored_j).sum::<f64>() + stored_j;
        (e.lost_contact_damping_j, e.lost_contact_friction_j) = (damping_j, friction_j);
        if c.has_rollers() {
            let [stored_j, damping_j, friction_j] = rollers::energies(model, state, scratch);
            e.kinetic_j += kinetic_of_rollers(model, state, scratch);
            e.elastic_contact_j += stored_j;
            e.lost_contact_damping_j += damping_j;
            e.lost_contact_friction_j += friction_j;
        }
        let (pin_damping, pin_friction) = scratch.joint_powers();
        e.lost_pin_damping_j = sum_own(c, &state.lost_pin_damping) + 0.5 * h * sum_own(c, pin_damping);
        e.lost_pin_friction_j = sum_own(c, &state.lost_pin_friction) + 0.5 * h * sum_own(c, pin_friction);
        // Totals before and after this step: at the node in its middle, their mean.
        // Behind the last link of a loop stands a ghost of its first: what that loses is nobody's.
        for part in ContactGroup::in_model(model) {
            let (past, now) = (part.past_memory(state), scratch.memory(part));
            let damping = 0.5 * (sum_own(c, &past.lost_damping) + sum_own(c, &now.lost_damping));
            let friction = 0.5 * (sum_own(c, &past.lost_friction) + sum_own(c, &now.lost_friction));
            if part.is_on_guides() {
                e.lost_guide_damping_j += damping;
                e.lost_guide_friction_j += friction;
            } else {
                e.lost_contact_damping_j += damping;
                e.lost_contact_friction_j += friction;
            }
        }
        e
    }
}

/// The ledger since `origin`; stored energies stay absolute.
pub(super) fn since(now: &Energy, origin: &Energy) -> Energy {
    let mut e = *now;
    e.each_with(origin, |account, now, before| if account.kind.is_stored() { now } else { now - before });
    e.error_j = e.put_in_j() - e.work_out_j - e.lost_j() - (e.stored_j() - origin.stored_j());
    e
}
