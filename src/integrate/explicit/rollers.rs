//! The part of a step that concerns rollers which are bodies of their own: on their bushes. At the teeth they are what bushes are to other
//! chains, in lanes of their own (`super::teeth`).

use super::teeth::{BushSources, load_bushes};
use super::{ContactMemory, MemoryBlocks, Scratch, write_block};
use crate::aligned::AlignedColumn;
use crate::elements::body_frame::BodyMobility;
use crate::geometry::Vec2;
use crate::lanes::{LANES, LaneBlock, take};
use crate::model::Model;
use crate::pairs::bush_tooth::{FrictionInput, Lanes};
use crate::pairs::roller_bush::{Bore, RollerFriction, RollerLanes, solve_together};
use crate::state::State;

/// What a step knows of rollers on their bushes, by the lanes of rollers. Empty where a drive has none.
pub(crate) struct BoreColumns {
    /// After the step.
    pub(crate) memory: ContactMemory,
    /// Force on the roller [N], its moment about the roller's axis, and that of the opposite force about the axis of the bush [N m].
    pub(crate) force_x: AlignedColumn,
    pub(crate) force_y: AlignedColumn,
    pub(crate) moment: AlignedColumn,
    pub(crate) bush_moment: AlignedColumn,
    /// Penetration at the node [m], and the sliding speed that friction works with [m/s].
    pub(crate) depth: AlignedColumn,
    pub(crate) slide: AlignedColumn,
    /// Normal onto the roller, and half a step's sliding speed by a unit of friction [m/(s N)].
    normal_x: AlignedColumn,
    normal_y: AlignedColumn,
    mobility: AlignedColumn,
    /// Always 2: all blocks are looked at in every step.
    stale: Vec<u8>,
}

impl BoreColumns {
    pub(super) fn new(model: &Model) -> BoreColumns {
        let n = if model.chain.has_rollers() { model.chain.padded } else { 0 };
        let column = || AlignedColumn::zeros(n);
        BoreColumns {
            memory: ContactMemory::new(n),
            force_x: column(),
            force_y: column(),
            moment: column(),
            bush_moment: column(),
            depth: column(),
            slide: column(),
            normal_x: column(),
            normal_y: column(),
            mobility: column(),
            stale: vec![2; n / LANES],
        }
    }
}

/// Contacts of all rollers with their bushes; friction as if the teeth did what they did a step ago, until [`couple`] has looked at both.
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
    let Scratch { front, rear, omega, wrapped, bores, lanes, .. } = scratch;
    let sources = BushSources::new(c, (front, rear), omega, wrapped);
    let lanes: &mut Lanes = lanes.get_or_insert_default();
    let BoreColumns { memory, stale, .. } = bores;
    let mut memory = MemoryBlocks::new(&state.bores, memory, stale, c.padded / LANES);
    for first in (0..rollers.len()).step_by(LANES) {
        let (joint, roller) = (joints.start + first, rollers.start + first);
        load_bushes(&sources, joint / LANES, Vec2::zeros(), lanes);
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
        release_from((rollers.len() - first).min(LANES), lanes);
        memory.store(roller / LANES, lanes);
        for (column, values) in [
            (&mut bores.force_x, &lanes.force_x),
            (&mut bores.force_y, &lanes.force_y),
            (&mut bores.moment, &lanes.moment),
            (&mut bores.bush_moment, &lanes.torque),
            (&mut bores.depth, &lanes.penetration),
            (&mut bores.slide, &lanes.slide),
            (&mut bores.normal_x, &lanes.normal_x),
            (&mut bores.normal_y, &lanes.normal_y),
            (&mut bores.mobility, &lanes.mobility),
        ] {
            write_block(column, roller, *values);
        }
    }
}

/// Friction of rollers that touch a tooth and their bush, both at once. `lanes`: rollers against a sprocket that gives way so much, after its
/// forces. Apart from the kernel of the teeth, which without rollers must not pay for it.
#[cold]
#[inline(never)]
pub(super) fn couple(
    model: &Model,
    state: &State,
    bores: &mut BoreColumns,
    (bore, at): (&Bore, usize),
    (friction, past): (FrictionInput, &LaneBlock),
    yields: BodyMobility,
    lanes: &mut Lanes,
) {
    let (step, c) = (model.step_s, &model.chain);
    let half = 0.5 * step;
    for i in (0..LANES).filter(|i| lanes.normal_force[*i] > 0.0) {
        let lane = at + i;
        let normal_n = bores.memory.normal_force[lane];
        if normal_n <= 0.0 {
            continue;
        }
        let (inverse_mass, inverse_inertia) = (c.inverse_mass[lane], c.inverse_inertia[lane]);
        let (nx, ny) = (lanes.normal_x[i], lanes.normal_y[i]);
        let inside_m = bore.bush_radius_m + bore.clearance_m + bores.depth[lane];
        let of_roller = inverse_mass + friction.radius * friction.radius * inverse_inertia;
        let arm = lanes.x[i] * nx + lanes.y[i] * ny - friction.radius;
        let of_body = yields.inverse_inertia * arm * arm + yields.along(-ny, nx);
        let mut tooth = RollerFriction {
            mu: friction.mu,
            stick_speed_m_s: friction.stick_speed,
            normal_n: lanes.normal_force[i],
            mobility: half * (of_roller + of_body),
            past_n: past[i],
            force_n: lanes.tangential_force[i],
            slide_m_s: lanes.slide[i],
        };
        let mut bush = RollerFriction {
            mu: bore.friction,
            stick_speed_m_s: bore.stick_speed_m_s,
            normal_n,
            mobility: bores.mobility[lane],
            past_n: state.bores.tangential_force[lane],
            force_n: bores.memory.tangential_force[lane],
            slide_m_s: bores.slide[lane],
        };
        let (bx, by) = (bores.normal_x[lane], bores.normal_y[lane]);
        let mixed = half * ((nx * bx + ny * by) * inverse_mass - friction.radius * inside_m * inverse_inertia);
        solve_together(&mut tooth, &mut bush, mixed);
        let force = tooth.force_n;
        (lanes.tangential_force[i], lanes.slide[i]) = (force, tooth.slide_m_s);
        lanes.lost_friction[i] = -force * tooth.slide_m_s * step;
        let (fx, fy) = (tooth.normal_n * nx - force * ny, tooth.normal_n * ny + force * nx);
        (lanes.force_x[i], lanes.force_y[i]) = (fx, fy);
        lanes.moment[i] = -friction.radius * force;
        lanes.torque[i] = lanes.y[i] * fx - lanes.x[i] * fy - lanes.moment[i];
        let force = bush.force_n;
        (bores.memory.tangential_force[lane], bores.slide[lane]) = (force, bush.slide_m_s);
        bores.memory.lost_friction[lane] = state.bores.lost_friction[lane] - force * bush.slide_m_s * step;
        bores.force_x[lane] = normal_n * bx - force * by;
        bores.force_y[lane] = normal_n * by + force * bx;
        bores.moment[lane] = inside_m * force;
        bores.bush_moment[lane] = -bore.bush_radius_m * force;
    }
}

/// Gives the forces of bores to the centres of links and rollers, as those of guides are given.
#[inline(never)]
pub(super) fn give(model: &Model, scratch: &mut Scratch) {
    let c = &model.chain;
    let Scratch { bores, end_forces, wrapped, .. } = scratch;
    for (own, rollers) in c.loops.iter().zip(&c.rollers) {
        for (joint, lane) in own.clone().zip(rollers.clone()) {
            let (x, y) = (bores.force_x[lane], bores.force_y[lane]);
            let on_roller = &mut end_forces[lane / LANES];
            on_roller.used = true;
            on_roller.x[lane % LANES] += x;
            on_roller.y[lane % LANES] += y;
            on_roller.moment[lane % LANES] += bores.moment[lane];
            let next = if joint + 1 == own.end { own.start } else { joint + 1 };
            let link = if c.bush_on_front[joint + 1] != 0.0 { joint } else { next };
            let (lever, cos, sin) = (c.bush_lever[joint], wrapped.cos[link], wrapped.sin[link]);
            let on_link = &mut end_forces[link / LANES];
            on_link.used = true;
            on_link.x[link % LANES] -= x;
            on_link.y[link % LANES] -= y;
            on_link.moment[link % LANES] += lever * (sin * x - cos * y) + bores.bush_moment[lane];
        }
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
