//! The part of a step that concerns rollers which are bodies of their own: on their bushes. At the teeth they are what bushes are to other
//! chains, in lanes of their own (`super::teeth`).

use super::teeth::{BushSources, load_bushes};
use super::{ContactMemory, MemoryBlocks, Scratch};
use crate::elements::roller_bore::{Bore, RollerLanes};
use crate::elements::tooth_contact::{LANES, Lanes, take};
use crate::model::Model;
use crate::state::State;

/// What a step knows of rollers on their bushes, by the lanes of rollers. Empty where a drive has none.
pub(crate) struct BoreColumns {
    /// After the step.
    pub(crate) memory: ContactMemory,
    /// Force on the roller [N], its moment about the roller's axis, and that of the opposite force about the axis of the bush [N m].
    pub(crate) force_x: Vec<f64>,
    pub(crate) force_y: Vec<f64>,
    pub(crate) moment: Vec<f64>,
    pub(crate) bush_moment: Vec<f64>,
    /// Penetration at the node [m], and the sliding speed that friction works with [m/s].
    pub(crate) depth: Vec<f64>,
    pub(crate) slide: Vec<f64>,
    /// Always 2: all blocks are looked at in every step.
    stale: Vec<u8>,
}

impl BoreColumns {
    pub(super) fn new(model: &Model) -> BoreColumns {
        let n = if model.chain.has_rollers() { model.chain.padded } else { 0 };
        let column = || vec![0.0; n];
        BoreColumns {
            memory: ContactMemory::new(n),
            force_x: column(),
            force_y: column(),
            moment: column(),
            bush_moment: column(),
            depth: column(),
            slide: column(),
            stale: vec![2; n / LANES],
        }
    }
}

/// Contacts of all rollers with their bushes. Forces go to the centres of links and rollers, as those of guides do.
#[inline(always)]
pub(super) fn contacts(model: &Model, state: &State, scratch: &mut Scratch) {
    for (chain, bore) in model.bores.iter().enumerate() {
        if let Some(bore) = bore {
            contacts_of_chain(model, state, scratch, (chain, bore));
        }
    }
}

#[inline(always)]
fn contacts_of_chain(model: &Model, state: &State, scratch: &mut Scratch, (chain, bore): (usize, &Bore)) {
    let c = &model.chain;
    let (joints, rollers) = (c.loops[chain].clone(), c.rollers[chain].clone());
    let Scratch { front, rear, omega, wrapped, bores, lanes, end_forces, .. } = scratch;
    let sources = BushSources::new(c, (front, rear), omega, wrapped);
    let lanes: &mut Lanes = lanes.get_or_insert_default();
    let BoreColumns { memory, force_x, force_y, moment, bush_moment, depth, slide, stale } = bores;
    let mut memory = MemoryBlocks::new(&state.bores, memory, stale, c.padded / LANES);
    for first in (0..rollers.len()).step_by(LANES) {
        let (joint, roller) = (joints.start + first, rollers.start + first);
        load_bushes(&sources, joint / LANES, lanes);
        let spin = RollerLanes {
            omega: take(omega, roller),
            inverse_mass: take(&c.inverse_mass, roller),
            inverse_inertia: take(&c.inverse_inertia, roller),
        };
        let [x, y] = [&front.x, &front.y].map(|column| take(column, roller));
        let [vx, vy] = [&front.vx, &front.vy].map(|column| take(column, roller));
        let [ax, ay] = [&wrapped.ax, &wrapped.ay].map(|column| take(column, roller));
        for i in 0..LANES {
            (lanes.x[i], lanes.y[i]) = (x[i] - lanes.x[i], y[i] - lanes.y[i]);
            (lanes.vx[i], lanes.vy[i]) = (vx[i] - lanes.vx[i], vy[i] - lanes.vy[i]);
            (lanes.ax[i], lanes.ay[i]) = (ax[i] - lanes.ax[i], ay[i] - lanes.ay[i]);
        }
        memory.load_past(roller / LANES, lanes);
        bore.forces(model.step_s, &spin, lanes);
        let held = (rollers.len() - first).min(LANES);
        release_from(held, lanes);
        memory.store(roller / LANES, lanes);
        let on_roller = &mut end_forces[roller / LANES];
        on_roller.used = true;
        for i in 0..LANES {
            on_roller.x[i] += lanes.force_x[i];
            on_roller.y[i] += lanes.force_y[i];
            on_roller.moment[i] += lanes.moment[i];
        }
        for i in 0..held {
            let link = if c.bush_on_front[joint + i + 1] != 0.0 { joint + i } else { c.next(joint + i) };
            let (x, y) = (-lanes.force_x[i], -lanes.force_y[i]);
            let on_link = &mut end_forces[link / LANES];
            on_link.used = true;
            on_link.x[link % LANES] += x;
            on_link.y[link % LANES] += y;
            on_link.moment[link % LANES] +=
                lanes.lever[i] * (lanes.cos[i] * y - lanes.sin[i] * x) + lanes.torque[i];
        }
        let into = roller..roller + LANES;
        force_x[into.clone()].copy_from_slice(&lanes.force_x);
        force_y[into.clone()].copy_from_slice(&lanes.force_y);
        moment[into.clone()].copy_from_slice(&lanes.moment);
        bush_moment[into.clone()].copy_from_slice(&lanes.torque);
        depth[into.clone()].copy_from_slice(&lanes.penetration);
        slide[into].copy_from_slice(&lanes.slide);
    }
}

/// No contact in the lanes behind the last roller.
#[inline(always)]
fn release_from(held: usize, lanes: &mut Lanes) {
    for i in held..LANES {
        (lanes.normal_force[i], lanes.tangential_force[i], lanes.age[i], lanes.approach[i]) = (0.0, 0.0, 0.0, 0.0);
        (lanes.lost_damping[i], lanes.lost_friction[i]) = (0.0, 0.0);
        (lanes.force_x[i], lanes.force_y[i], lanes.moment[i], lanes.torque[i]) = (0.0, 0.0, 0.0, 0.0);
    }
}

/// Energy stored in the bores at the node, and what they have lost by damping and by friction [J].
pub(crate) fn energies(model: &Model, state: &State, scratch: &Scratch) -> [f64; 3] {
    let mut sums = [0.0; 3];
    let (past, now) = (&state.bores, &scratch.bores.memory);
    for (bore, rollers) in model.bores.iter().zip(&model.chain.rollers) {
        let Some(bore) = bore else { continue };
        for lane in rollers.clone() {
            sums[0] += bore.law.elastic(scratch.bores.depth[lane], bore.radii()).energy_j;
            sums[1] += 0.5 * (past.lost_damping[lane] + now.lost_damping[lane]);
            sums[2] += 0.5 * (past.lost_friction[lane] + now.lost_friction[lane]);
        }
    }
    sums
}
