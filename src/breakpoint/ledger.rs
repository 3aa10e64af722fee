//! The energy ledger of a step from its own columns, for breakpoints. It equals that of a frame, but is summed in
//! another order.

use crate::drive::Scheme;
use crate::elements::contact_law::ContactLaw;
use crate::elements::link_joint::LinkJoint;
use crate::integrate::explicit::{ContactGroup, Scratch, rollers, shafts, touches};
use crate::integrate::{VectorKernel, vectorised};
use crate::lanes::{LANES, LaneBlock, blocks, take};
use crate::model::Model;
use crate::recording::capture::kinetic_of_impacts;
use crate::recording::frame::Energy;
use crate::state::State;
use std::ops::Range;

/// Rounding of sums in another order, relative to what is summed.
const ROUNDING: f64 = 1e-10;

/// Steps after which running sums are computed anew, so that their rounding stays far below [`ROUNDING`].
const STEPS_PER_FULL_SUM: u64 = 256;

/// The energy ledger of a run that is examined at every step.
pub struct Ledger {
    /// Masses and inertias of the links that move.
    mass: Vec<f64>,
    inertia: Vec<f64>,
    /// For each block, 1 in lanes of links and 0 in lanes between and after them, which may hold a copy of a first
    /// link.
    own: Vec<LaneBlock>,
    /// With half the contact stiffness, if it is the same for all partners: squared depths times it give the energy
    /// [N/m].
    parts: Vec<(ContactGroup, Option<f64>)>,
    /// Losses in joints and contacts before the next step [J], the number of that step, and the step of the last
    /// complete summation.
    lost_j: f64,
    next: Option<u64>,
    summed: u64,
    /// What was lost and stored where the ledger was opened, which is the same in all steps of a run [J].
    origin_j: Option<[f64; 2]>,
    /// Result of the last evaluation.
    now: (Energy, f64),
}

/// Sums over all links, joints and contacts, lane by lane. In one loop with the final sum they would vectorise only in
/// pairs.
struct EnergySums {
    /// Twice the kinetic energy of the links [J].
    twice_kinetic_j: LaneBlock,
    /// In joints and contacts [J].
    elastic_j: LaneBlock,
    /// In joints and contacts over this step [J].
    lost_j: LaneBlock,
}

/// [`Ledger::sums`].
struct SumKernel<'a>(&'a Ledger, &'a Model, &'a State, &'a Scratch);

impl VectorKernel for SumKernel<'_> {
    type Output = Option<EnergySums>;

    #[inline(always)]
    fn run(self) -> Option<EnergySums> {
        self.0.sums(self.1, self.2, self.3)
    }
}

impl Ledger {
    pub fn new(model: &Model) -> Ledger {
        let c = &model.chain;
        // Fixed links have zero inverse mass.
        let moving = |of: &[f64]| (0..c.padded).map(|i| if c.inverse_mass[i] == 0.0 { 0.0 } else { of[i] }).collect();
        let stiffness = |part: ContactGroup| one_law(model, part)?.linear_stiffness_n_per_m();
        let with_stiffness = |part: ContactGroup| (part, stiffness(part).map(|k| 0.5 * k));
        Ledger {
            mass: moving(&c.mass),
            inertia: moving(&c.inertia),
            own: (0..c.padded / LANES)
                .map(|b| {
                    c.link_lanes(b * LANES).map_or([1.0; LANES], |links| links.map(|is| if is { 1.0 } else { 0.0 }))
                })
                .collect(),
            parts: ContactGroup::in_model(model).into_iter().map(with_stiffness).collect(),
            lost_j: 0.0,
            next: None,
            summed: 0,
            origin_j: None,
            now: (Energy::default(), 0.0),
        }
    }

    /// Energies at the node since `origin` and their uncertainty [J]. All losses are in one class, all elastic energy
    /// of joints and contacts in another. None if the energy of a contact law needs more than its depth.
    pub fn update(
        &mut self,
        (model, state, scratch): (&Model, &State, &Scratch),
        origin: &Energy,
    ) -> Option<&(Energy, f64)> {
        let sums = vectorised(scratch.isa, SumKernel(self, model, state, scratch))?;
        // Other schemes lose within a step what its node does not show.
        let is_leapfrog = model.scheme == Scheme::Leapfrog;
        if self.next != Some(state.step) || state.step >= self.summed + STEPS_PER_FULL_SUM || !is_leapfrog {
            self.lost_j = self.lost_before(model, state);
            self.summed = state.step;
        }
        let (elastic_j, step_j) = (total(&sums.elastic_j), total(&sums.lost_j));
        // At the node only half of the step's losses have occurred.
        let lost_j = self.lost_j + 0.5 * step_j;
        self.lost_j += step_j;
        self.next = Some(state.step + 1);
        let of_impacts_j = kinetic_of_impacts(model, scratch);
        let mut own = Energy { kinetic_j: 0.5 * total(&sums.twice_kinetic_j) + of_impacts_j, ..Energy::default() };
        shafts::add_energies(model, state, scratch, &mut own);
        let Energy { kinetic_j, work_out_j, mut work_in_j, .. } = own;
        let (mut spring_j, mut damper_j) = (
            own.elastic_spring_j + own.elastic_coupling_j + own.elastic_span_j,
            own.lost_spring_damping_j + own.lost_coupling_damping_j + own.lost_span_damping_j + own.lost_load_j,
        );
        if let Some(oil) = &model.oil {
            spring_j += oil.stored_j(&state.oil);
            damper_j += state.oil.lost_j.iter().sum::<f64>();
            work_in_j += state.oil.work_j.iter().sum::<f64>();
        }
        let mut touching = [0.0; 3];
        if !model.touches.is_empty() {
            touching = touches::energies(model, state, scratch);
        }
        if model.chain.has_rollers() {
            let of_rollers = rollers::energies(model, state, scratch);
            touching = std::array::from_fn(|i| touching[i] + of_rollers[i]);
        }
        let [touching_j, damping_j, friction_j] = touching;
        let (elastic_j, lost_j) = (elastic_j + spring_j + touching_j, lost_j + damper_j + damping_j + friction_j);
        let stored_j = kinetic_j + elastic_j;
        let (e, uncertainty_j) = &mut self.now;
        *uncertainty_j = ROUNDING * (stored_j + work_in_j.abs() + work_out_j.abs() + lost_j.abs());
        (e.kinetic_j, e.elastic_joint_j) = (kinetic_j, elastic_j);
        e.work_in_j = work_in_j - origin.put_in_j();
        e.work_out_j = work_out_j - origin.work_out_j;
        let [lost_then_j, stored_then_j] = *self.origin_j.get_or_insert_with(|| [origin.lost_j(), origin.stored_j()]);
        e.lost_pin_damping_j = lost_j - lost_then_j;
        e.error_j = e.work_in_j - e.work_out_j - e.lost_pin_damping_j - (stored_j - stored_then_j);
        Some(&self.now)
    }

    #[inline(always)]
    fn sums(&self, model: &Model, state: &State, scratch: &Scratch) -> Option<EnergySums> {
        let mut elastic = [0.0; LANES];
        let mut lost = [0.0; LANES];
        for (part, half_stiffness) in &self.parts {
            self.add_contacts((*part, *half_stiffness), (model, state, scratch), &mut elastic, &mut lost)?;
        }
        for (joint, own) in model.chain.joints.iter().zip(&model.chain.loops) {
            let (stretch2, power_w) = self.joints(joint, own.start / LANES..own.end.div_ceil(LANES), scratch);
            for i in 0..LANES {
                elastic[i] += 0.5 * joint.stiffness_n_per_m * stretch2[i];
                lost[i] += model.step_s * power_w[i];
            }
        }
        let twice_kinetic_j = self.links(0.5 * model.step_s, state, scratch);
        Some(EnergySums { twice_kinetic_j, elastic_j: elastic, lost_j: lost })
    }

    /// Twice the kinetic energy of the links, lane by lane [J].
    #[inline(always)]
    fn links(&self, half: f64, state: &State, scratch: &Scratch) -> LaneBlock {
        let (s, count) = (&state.links, self.mass.len() / LANES);
        let (ax, ay, alpha) = (blocks(&scratch.ax, count), blocks(&scratch.ay, count), blocks(&scratch.alpha, count));
        let (vx, vy, omega) = (blocks(&s.vx, count), blocks(&s.vy, count), blocks(&s.omega, count));
        let (mass, inertia) = (blocks(&self.mass, count), blocks(&self.inertia, count));
        let mut twice = [0.0; LANES];
        for b in 0..count {
            let (a, c, e) = (ax[b], ay[b], alpha[b]);
            let (u, v, w) = (vx[b], vy[b], omega[b]);
            let (m, j) = (mass[b], inertia[b]);
            for i in 0..LANES {
                let (u, v, w) = (u[i] + half * a[i], v[i] + half * c[i], w[i] + half * e[i]);
                twice[i] += m[i] * (u * u + v * v) + j[i] * (w * w);
            }
        }
        twice
    }

    /// Squared elongations of the joints of a loop, beyond the clearance if there is one [m2], and the power dissipated
    /// in them [W].
    #[inline(always)]
    fn joints(&self, joint: &LinkJoint, loop_blocks: Range<usize>, scratch: &Scratch) -> (LaneBlock, LaneBlock) {
        let count = self.mass.len() / LANES;
        let [(front_x, rear_x), (front_y, rear_y)] = scratch.joint_ends();
        let (damping, friction) = scratch.joint_powers();
        let (ax, ay) = (blocks(front_x, count), blocks(front_y, count));
        let (bx, by) = (blocks(rear_x, count), blocks(rear_y, count));
        let (damped, rubbed) = (blocks(damping, count), blocks(friction, count));
        let (mut stretch2, mut power_w) = ([0.0; LANES], [0.0; LANES]);
        if joint.clearance_m > 0.0 {
            for b in loop_blocks.clone() {
                let own = self.own[b];
                for i in 0..LANES {
                    let (x, y) = (ax[b][i] - bx[b][i], ay[b][i] - by[b][i]);
                    let beyond = (x * x + y * y).sqrt() - joint.clearance_m;
                    stretch2[i] += if beyond > 0.0 { own[i] * (beyond * beyond) } else { 0.0 };
                }
            }
        } else {
            for b in loop_blocks.clone() {
                let (x0, y0, x1, y1, own) = (ax[b], ay[b], bx[b], by[b], self.own[b]);
                for i in 0..LANES {
                    let (x, y) = (x0[i] - x1[i], y0[i] - y1[i]);
                    stretch2[i] += own[i] * (x * x + y * y);
                }
            }
        }
        for b in loop_blocks {
            let (damped, rubbed, own) = (damped[b], rubbed[b], self.own[b]);
            for i in 0..LANES {
                power_w[i] += own[i] * (damped[i] + rubbed[i]);
            }
        }
        (stretch2, power_w)
    }

    /// Adds the elastic energy in a group of contacts and their losses over this step [J].
    #[inline(always)]
    fn add_contacts(
        &self,
        (part, half_stiffness): (ContactGroup, Option<f64>),
        (model, state, scratch): (&Model, &State, &Scratch),
        elastic: &mut LaneBlock,
        lost: &mut LaneBlock,
    ) -> Option<()> {
        if part != ContactGroup::Bushes && scratch.is_off_guides() {
            return Some(());
        }
        let (now, past, depths) = (scratch.memory(part), part.past_memory(state), scratch.depths(part));
        let (damping, friction) = (&now.lost_damping[..], &now.lost_friction[..]);
        let (past_damping, past_friction) = (&past.lost_damping[..], &past.lost_friction[..]);
        let (age, touching) = (&now.age[..], scratch.touching_blocks(part));
        let mut each_j = 0.0;
        for block in 0..model.chain.lanes.div_ceil(LANES) {
            if touching.get(block) == Some(&0) {
                continue;
            }
            let at = block * LANES;
            let own = self.own[block];
            let (age, depth) = (take(age, at), take(depths, at));
            let (damped, rubbed) = (take(damping, at), take(friction, at));
            let (damped_before, rubbed_before) = (take(past_damping, at), take(past_friction, at));
            let (mut depths, mut losses) = ([0.0; LANES], *lost);
            for i in 0..LANES {
                let d = if depth[i] > 0.0 { depth[i] } else { 0.0 };
                depths[i] = if age[i] > 0.0 { d * own[i] } else { 0.0 };
            }
            for i in 0..LANES {
                losses[i] += own[i] * ((damped[i] - damped_before[i]) + (rubbed[i] - rubbed_before[i]));
            }
            *lost = losses;
            let half = match half_stiffness {
                Some(half) => half,
                None => {
                    each_j += elastic_of_each(model, scratch, part, at, &depths)?;
                    0.0
                }
            };
            let mut energies = *elastic;
            for i in 0..LANES {
                energies[i] += half * depths[i] * depths[i];
            }
            *elastic = energies;
        }
        elastic[0] += each_j;
        Some(())
    }

    /// Losses in joints and contacts before this step [J].
    #[cold]
    #[inline(never)]
    fn lost_before(&self, model: &Model, state: &State) -> f64 {
        let own = |a: &[f64], b: &[f64]| model.chain.bodies().map(|i| a[i] + b[i]).sum::<f64>();
        let contacts = |(part, _): &(ContactGroup, Option<f64>)| {
            let memory = part.past_memory(state);
            own(&memory.lost_damping, &memory.lost_friction)
        };
        own(&state.lost_pin_damping, &state.lost_pin_friction) + self.parts.iter().map(contacts).sum::<f64>()
    }
}

/// Elastic energy if contact laws differ between bodies; None if one of them needs more than a depth.
#[cold]
#[inline(never)]
fn elastic_of_each(model: &Model, scratch: &Scratch, part: ContactGroup, at: usize, depths: &LaneBlock) -> Option<f64> {
    let mut sum_j = 0.0;
    for (i, depth) in depths.iter().enumerate().filter(|(_, d)| **d > 0.0) {
        sum_j += 0.5 * scratch.law(model, part, at + i)?.linear_stiffness_n_per_m()? * depth * depth;
    }
    Some(sum_j)
}

/// The contact law of a group, if all its possible partners have the same one; effects may give a guide a law of its
/// own.
fn one_law(model: &Model, part: ContactGroup) -> Option<ContactLaw> {
    let all: Vec<ContactLaw> = match part {
        ContactGroup::Bushes => model.sprockets.iter().map(|s| s.body.law).collect(),
        ContactGroup::Guides(_) => model.guides.iter().map(|g| g.body.law).collect(),
        ContactGroup::Rails(_) => model.rails.iter().map(|r| r.body.law).collect(),
        ContactGroup::Contours(_) => model.end_bodies.iter().filter(|b| part.is_set(b.set)).map(|b| b.law).collect(),
    };
    let first = *all.first()?;
    all.iter().all(|other| *other == first).then_some(first)
}

/// Sum in pairs.
fn total(s: &LaneBlock) -> f64 {
    ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))
}
