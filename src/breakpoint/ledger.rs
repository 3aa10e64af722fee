//! The energy ledger of a step from its own columns, for breakpoints: the sums of a frame's ledger in another order.

use crate::elements::contact_law::ContactLaw;
use crate::elements::rotor::Rotor;
use crate::elements::tooth_contact::{Column, LANES};
use crate::integrate::explicit::{Part, Scratch};
use crate::integrate::{Look, vectorised};
use crate::model::Model;
use crate::recording::frame::Energy;
use crate::state::{ContactMemory, State};
use std::ops::Range;

/// Rounding of sums in another order, as a share of what is summed.
const ROUNDING: f64 = 1e-10;

/// Steps after which running sums are made anew: their rounding stays far below [`ROUNDING`].
const FRESH_STEPS: u64 = 256;

/// The ledger of a run that is looked at step by step. What a step leaves alone (masses, losses where nothing touches) is summed
/// once.
pub struct Ledger {
    /// Masses and inertias of the links in blocks of lanes, zero where a link is held, and how many of the first blocks are
    /// like the first.
    mass: Vec<Column>,
    inertia: Vec<Column>,
    alike: usize,
    /// 1 in lanes of links, 0 in those behind the last.
    real: Vec<Column>,
    parts: Vec<PartLosses>,
    /// The step looked at last, and what the contacts had lost after it [J].
    step: u64,
    contacts_j: Option<f64>,
    /// Lost in the joints before the step to be looked at next [J], and when it was last summed whole.
    pins_j: f64,
    summed: u64,
}

/// Sums over columns at a node, lane by lane: stored as they are, they stay in vector registers until then.
struct Sums {
    /// Twice the energy of movement [J].
    kinetic: Column,
    /// Squares of the joints' stretch [m2], or what is elastic in joints with clearance [J].
    stretch: Column,
    elastic_contact: Column,
    /// Lost in contacts where something touches [J], and in all blocks where nothing does.
    touching_lost: Column,
    idle_j: f64,
    /// Lost in the joints now [W].
    pins_w: Column,
}

/// Losses of one kind of part.
struct PartLosses {
    part: Part,
    /// Of a linear law.
    stiffness_n_per_m: Option<f64>,
    /// Where something touched a step ago, as the step notes it; those blocks of lanes, and what all others have lost [J].
    n_links: usize,
    touching: Vec<u8>,
    busy: Vec<usize>,
    idle_j: f64,
}

impl Ledger {
    pub fn new(model: &Model) -> Ledger {
        let c = &model.chain;
        let free = |column: &[f64]| {
            // Held links have no inverse mass.
            let free = |i: usize| if c.inverse_mass[i] == 0.0 { 0.0 } else { column[i] };
            let blocks = (0..c.padded).step_by(LANES);
            blocks.map(|at| std::array::from_fn(|k| free(at + k))).collect::<Vec<Column>>()
        };
        let (mass, inertia) = (free(&c.mass), free(&c.inertia));
        let like_first = |b: &usize| mass[*b] == mass[0] && inertia[*b] == inertia[0];
        let alike = (0..mass.len()).take_while(like_first).count();
        let part = |part| {
            let law = match part {
                Part::Bushes => model.sprockets.first().map(|s| &s.body.law),
                Part::Guides(_) => model.guides.first().map(|g| &g.body.law),
                Part::Contours(set) => model.end_bodies.iter().find(|b| b.set == set / 2).map(|b| &b.law),
            };
            let stiffness_n_per_m = match law {
                Some(ContactLaw::Linear { stiffness_n_per_m, .. }) => Some(*stiffness_n_per_m),
                _ => None,
            };
            PartLosses {
                part,
                stiffness_n_per_m,
                n_links: c.n_links,
                touching: Vec::new(),
                busy: (0..c.padded / LANES).collect(),
                idle_j: 0.0,
            }
        };
        Ledger {
            mass,
            inertia,
            alike,
            real: (0..c.padded / LANES)
                .map(|b| std::array::from_fn(|k| if b * LANES + k < c.n_links { 1.0 } else { 0.0 }))
                .collect(),
            parts: Part::of(model).into_iter().map(part).collect(),
            step: 0,
            contacts_j: None,
            pins_j: 0.0,
            summed: 0,
        }
    }

    /// Energies of the node since `origin`, losses in one of their classes, and how uncertain they are [J]; None where a contact
    /// law needs more than a depth.
    pub fn look(
        &mut self,
        (model, state, scratch): (&Model, &State, &Scratch),
        origin: &Energy,
    ) -> Option<(Energy, f64)> {
        let sums = vectorised(scratch.isa, Summing { ledger: self, model, state, scratch })?;
        let h = model.step_s;
        let follows = self.contacts_j.is_some() && self.step + 1 == state.step;
        let mut e = Energy {
            kinetic_j: 0.5 * total(&sums.kinetic),
            elastic_joint_j: total(&sums.stretch) * stretch_to_j(model),
            elastic_contact_j: total(&sums.elastic_contact),
            ..Energy::default()
        };
        let past_j = self.contacts_j.filter(|_| follows).unwrap_or_else(|| {
            let past = |losses: &PartLosses| match losses.part {
                Part::Bushes => &state.bushes,
                Part::Guides(set) => &state.guide_ends[set],
                Part::Contours(set) => &state.contour_ends[set],
            };
            self.parts.iter().map(|p| lost(past(p), 0..model.chain.n_links)).sum()
        });
        if !follows || state.step >= self.summed + FRESH_STEPS {
            self.pins_j = total(&sum_of_both(&state.lost_pin_damping, &state.lost_pin_friction));
            self.summed = state.step;
        }
        let contacts_j = sums.idle_j + total(&sums.touching_lost);
        let step_j = h * total(&sums.pins_w);
        e.lost_pin_damping_j = self.pins_j + 0.5 * step_j + 0.5 * (contacts_j + past_j);
        (self.step, self.contacts_j) = (state.step, Some(contacts_j));
        self.pins_j += step_j;
        for (k, sprocket) in model.sprockets.iter().enumerate() {
            let speed = state.rotors.omega[k] + 0.5 * h * scratch.rotor_alpha[k];
            e.work_in_j += state.rotors.work_in[k];
            e.work_out_j += state.rotors.work_out[k];
            match sprocket.rotor {
                Rotor::Driven { .. } => e.work_in_j -= scratch.chain_torque[k] * (0.5 * h * speed),
                Rotor::Free { inertia_kg_m2, torque_nm } => {
                    e.kinetic_j += 0.5 * inertia_kg_m2 * speed * speed;
                    e.work_out_j -= torque_nm * (0.5 * h * speed);
                }
            }
        }
        let scale_j = e.stored_j() + e.work_in_j.abs() + e.work_out_j.abs() + e.lost_j().abs();
        e.work_in_j -= origin.work_in_j;
        e.work_out_j -= origin.work_out_j;
        e.lost_pin_damping_j -= origin.lost_j();
        e.error_j = e.work_in_j - e.work_out_j - e.lost_j() - (e.stored_j() - origin.stored_j());
        Some((e, ROUNDING * scale_j))
    }

    #[inline(always)]
    fn kinetic(&self, model: &Model, state: &State, scratch: &Scratch) -> Column {
        let (l, half) = (&state.links, 0.5 * model.step_s);
        let blocks = self.mass.len();
        let (vx, vy, w) = (blocks_of(&l.vx, blocks), blocks_of(&l.vy, blocks), blocks_of(&l.omega, blocks));
        let (ax, ay) = (blocks_of(&scratch.ax, blocks), blocks_of(&scratch.ay, blocks));
        let alpha = blocks_of(&scratch.alpha, blocks);
        let (mass, inertia) = (&self.mass[..blocks], &self.inertia[..blocks]);
        let mut sums = [0.0; LANES];
        let (mut squares, mut turning) = ([0.0; LANES], [0.0; LANES]);
        for b in 0..self.alike {
            for k in 0..LANES {
                let (u, v, o) = (vx[b][k] + half * ax[b][k], vy[b][k] + half * ay[b][k], w[b][k] + half * alpha[b][k]);
                squares[k] += u * u + v * v;
                turning[k] += o * o;
            }
        }
        for k in 0..LANES {
            sums[k] = mass[0][k] * squares[k] + inertia[0][k] * turning[k];
        }
        for b in self.alike..blocks {
            for k in 0..LANES {
                let (u, v, o) = (vx[b][k] + half * ax[b][k], vy[b][k] + half * ay[b][k], w[b][k] + half * alpha[b][k]);
                sums[k] += mass[b][k] * (u * u + v * v) + inertia[b][k] * o * o;
            }
        }
        sums
    }
}

/// Everything that has to be added up at a node.
struct Summing<'a> {
    ledger: &'a mut Ledger,
    model: &'a Model,
    state: &'a State,
    scratch: &'a Scratch,
}

impl Look for Summing<'_> {
    /// None: a contact law needs more than a depth.
    type Seen = Option<Sums>;

    #[inline(always)]
    fn look(self) -> Option<Sums> {
        let Summing { ledger, model, state, scratch } = self;
        let (damping_w, friction_w) = scratch.joint_power_columns();
        let mut sums = Sums {
            kinetic: ledger.kinetic(model, state, scratch),
            stretch: stretch(model, scratch),
            elastic_contact: [0.0; LANES],
            touching_lost: [0.0; LANES],
            idle_j: 0.0,
            pins_w: sum_of_both(damping_w, friction_w),
        };
        for part in &mut ledger.parts {
            part.add(scratch, &ledger.real, &mut sums)?;
        }
        Some(sums)
    }
}

impl PartLosses {
    /// Adds what is elastic and lost in contacts, of `real` lanes. None: the law needs more than a depth.
    #[inline(always)]
    fn add(&mut self, scratch: &Scratch, real: &[Column], sums: &mut Sums) -> Option<()> {
        let half_stiffness = 0.5 * self.stiffness_n_per_m?;
        let memory = scratch.memory(self.part);
        let blocks = memory.age.len() / LANES;
        let (age, depth) = (blocks_of(&memory.age, blocks), blocks_of(scratch.depths(self.part), blocks));
        let (damping, friction) = (blocks_of(&memory.lost_damping, blocks), blocks_of(&memory.lost_friction, blocks));
        if scratch.touching_blocks(self.part) != self.touching {
            self.note_busy(scratch);
        }
        for block in &self.busy {
            let (age, depth, damping, friction) = (age[*block], depth[*block], damping[*block], friction[*block]);
            let real = real[*block];
            for k in 0..LANES {
                let d = if depth[k] > 0.0 { depth[k] } else { 0.0 };
                let elastic = half_stiffness * d * d;
                sums.elastic_contact[k] += if age[k] > 0.0 { elastic } else { 0.0 };
            }
            for k in 0..LANES {
                // Lanes behind the last link book nothing that counts.
                let lost = damping[k] + friction[k];
                sums.touching_lost[k] += if real[k] > 0.0 { lost } else { 0.0 };
            }
        }
        sums.idle_j += self.idle_j;
        Some(())
    }

    #[cold]
    #[inline(never)]
    fn note_busy(&mut self, scratch: &Scratch) {
        self.touching = scratch.touching_blocks(self.part).to_vec();
        let idle: Vec<usize>;
        (idle, self.busy) = (0..self.touching.len()).partition(|b| scratch.is_idle(self.part, *b));
        let lanes = |b: usize| b * LANES..self.n_links.min((b + 1) * LANES);
        self.idle_j = idle.into_iter().map(|b| lost(scratch.memory(self.part), lanes(b))).sum();
    }
}

#[inline(always)]
fn stretch(model: &Model, scratch: &Scratch) -> Column {
    let joint = &model.chain.joint;
    let [(fx, rx), (fy, ry)] = scratch.joint_ends();
    let mut sums = [0.0; LANES];
    if joint.clearance_m != 0.0 {
        for j in 0..model.chain.n_links {
            sums[0] += joint.force(fx[j] - rx[j], fy[j] - ry[j], 0.0, 0.0).stored;
        }
        return sums;
    }
    let whole = model.chain.n_links / LANES;
    let (a, b, c, d) = (blocks_of(fx, whole), blocks_of(rx, whole), blocks_of(fy, whole), blocks_of(ry, whole));
    for i in 0..whole {
        for k in 0..LANES {
            let (dx, dy) = (a[i][k] - b[i][k], c[i][k] - d[i][k]);
            sums[k] += dx * dx + dy * dy;
        }
    }
    for j in whole * LANES..model.chain.n_links {
        let (dx, dy) = (fx[j] - rx[j], fy[j] - ry[j]);
        sums[0] += dx * dx + dy * dy;
    }
    sums
}

/// From what [`stretch`] returns to energy.
fn stretch_to_j(model: &Model) -> f64 {
    let joint = &model.chain.joint;
    if joint.clearance_m != 0.0 { 1.0 } else { 0.5 * joint.stiffness_n_per_m }
}

/// The first blocks of a column.
#[inline(always)]
pub(super) fn blocks_of(column: &[f64], blocks: usize) -> &[Column] {
    &column.as_chunks::<LANES>().0[..blocks]
}

/// Damping and friction of some lanes [J].
fn lost(memory: &ContactMemory, lanes: Range<usize>) -> f64 {
    lanes.map(|i| memory.lost_damping[i] + memory.lost_friction[i]).sum()
}

/// Of two columns; in the padding they are zero.
#[inline(always)]
fn sum_of_both(a: &[f64], b: &[f64]) -> Column {
    let blocks = a.len() / LANES;
    let (a, b) = (blocks_of(a, blocks), blocks_of(b, blocks));
    let mut sums = [0.0; LANES];
    for i in 0..blocks {
        for k in 0..LANES {
            sums[k] += a[i][k] + b[i][k];
        }
    }
    sums
}

/// In pairs.
fn total(s: &Column) -> f64 {
    ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))
}
