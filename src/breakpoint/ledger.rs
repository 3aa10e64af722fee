//! The energy ledger of a step from its own columns, for breakpoints: the sums of a frame's ledger in another order.

use crate::elements::contact_law::ContactLaw;
use crate::elements::rotor::Rotor;
use crate::elements::tooth_contact::LANES;
use crate::integrate::explicit::{Part, Scratch};
use crate::model::Model;
use crate::recording::frame::Energy;
use crate::state::{ContactMemory, State};

/// Rounding of sums in another order, as a share of what is summed.
const ROUNDING: f64 = 1e-10;

/// What the contacts had lost a step ago: most of what has to be summed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LostBefore {
    step: u64,
    lost_j: Option<f64>,
}

/// Energies of the node since `origin`, losses in one of their classes, and how uncertain they are [J]; None where a contact law
/// needs more than a depth.
#[inline(always)]
pub fn ledger(
    (model, state, scratch): (&Model, &State, &Scratch),
    parts: &[Part],
    origin: &Energy,
    before: &mut LostBefore,
) -> Option<(Energy, f64)> {
    let mut e = Energy { kinetic_j: kinetic(model, state, scratch), ..Energy::default() };
    e.elastic_joint_j = elastic_joints(model, scratch);
    let (mut lost_now, mut lost_past) = (0.0, before.lost_j.filter(|_| before.step + 1 == state.step));
    for part in parts {
        e.elastic_contact_j += elastic_contacts(model, scratch, *part)?;
        lost_now += lost(scratch.memory(*part), model.chain.n_links);
    }
    if lost_past.is_none() {
        let past = |part: &Part| match *part {
            Part::Bushes => &state.bushes,
            Part::Guides(set) => &state.guide_ends[set],
            Part::Contours(set) => &state.contour_ends[set],
        };
        lost_past = Some(parts.iter().map(|p| lost(past(p), model.chain.n_links)).sum());
    }
    *before = LostBefore { step: state.step, lost_j: Some(lost_now) };
    let h = model.step_s;
    for (k, sprocket) in model.sprockets.iter().enumerate() {
        let speed = state.rotors.omega[k] + 0.5 * h * scratch.rotor_alpha[k];
        e.work_in_j += state.rotors.work_in[k];
        e.work_out_j += state.rotors.work_out[k];
        match sprocket.rotor {
            Rotor::Driven { .. } => e.work_in_j -= scratch.chain_torque[k] * 0.5 * h * speed,
            Rotor::Free { inertia_kg_m2, torque_nm } => {
                e.kinetic_j += 0.5 * inertia_kg_m2 * speed * speed;
                e.work_out_j -= torque_nm * 0.5 * h * speed;
            }
        }
    }
    let n = model.chain.n_links;
    let (damping_w, friction_w) = scratch.joint_power_columns();
    let (damping_w, friction_w) = (sum(damping_w), sum(friction_w));
    let pins =
        sum(&state.lost_pin_damping[..n]) + sum(&state.lost_pin_friction[..n]) + 0.5 * h * (damping_w + friction_w);
    e.lost_pin_damping_j = pins + 0.5 * (lost_now + lost_past.unwrap_or(0.0));
    let scale_j = e.stored_j() + e.work_in_j.abs() + e.work_out_j.abs() + e.lost_j().abs();
    e.work_in_j -= origin.work_in_j;
    e.work_out_j -= origin.work_out_j;
    e.lost_pin_damping_j -= origin.lost_j();
    e.error_j = e.work_in_j - e.work_out_j - e.lost_j() - (e.stored_j() - origin.stored_j());
    Some((e, ROUNDING * scale_j))
}

#[inline(always)]
fn kinetic(model: &Model, state: &State, scratch: &Scratch) -> f64 {
    let (c, l, half) = (&model.chain, &state.links, 0.5 * model.step_s);
    let n = c.padded;
    let (vx, vy, w) = (&l.vx[..n], &l.vy[..n], &l.omega[..n]);
    let (ax, ay, alpha) = (&scratch.ax[..n], &scratch.ay[..n], &scratch.alpha[..n]);
    let (mass, inertia, inverse) = (&c.mass[..n], &c.inertia[..n], &c.inverse_mass[..n]);
    let mut sums = [0.0; LANES];
    for at in (0..n).step_by(LANES) {
        let [vx, vy, w, ax, ay, alpha, mass, inertia, inverse] = [vx, vy, w, ax, ay, alpha, mass, inertia, inverse]
            .map(|c| c[at..].first_chunk::<LANES>().copied().unwrap_or_default());
        for k in 0..LANES {
            let (u, v, o) = (vx[k] + half * ax[k], vy[k] + half * ay[k], w[k] + half * alpha[k]);
            let energy = mass[k] * (u * u + v * v) + inertia[k] * o * o;
            // Held links have no inverse mass.
            sums[k] += if inverse[k] == 0.0 { 0.0 } else { energy };
        }
    }
    0.5 * sum(&sums)
}

#[inline(always)]
fn elastic_joints(model: &Model, scratch: &Scratch) -> f64 {
    let joint = &model.chain.joint;
    let n = model.chain.n_links;
    let [(fx, rx), (fy, ry)] = scratch.joint_ends();
    let (fx, rx, fy, ry) = (&fx[..n], &rx[..n], &fy[..n], &ry[..n]);
    let mut total = 0.0;
    if joint.clearance_m == 0.0 {
        let mut sums = [0.0; LANES];
        let columns = [fx, rx, fy, ry].map(|c| c.as_chunks::<LANES>());
        let [a, b, c, d] = columns.map(|(whole, _)| whole);
        for (((a, b), c), d) in a.iter().zip(b).zip(c).zip(d) {
            for i in 0..LANES {
                let (dx, dy) = (a[i] - b[i], c[i] - d[i]);
                sums[i] += dx * dx + dy * dy;
            }
        }
        let rest: f64 = (n / LANES * LANES..n).map(|j| (fx[j] - rx[j]).powi(2) + (fy[j] - ry[j]).powi(2)).sum();
        return 0.5 * joint.stiffness_n_per_m * (sum(&sums) + rest);
    }
    for j in 0..n {
        total += joint.force(fx[j] - rx[j], fy[j] - ry[j], 0.0, 0.0).stored;
    }
    total
}

/// Linear laws only.
#[inline(always)]
fn elastic_contacts(model: &Model, scratch: &Scratch, part: Part) -> Option<f64> {
    let law = match part {
        Part::Bushes => model.sprockets.first().map(|s| &s.body.law),
        Part::Guides(_) => model.guides.first().map(|g| &g.body.law),
        Part::Contours(set) => model.end_bodies.iter().find(|b| b.set == set / 2).map(|b| &b.law),
    }?;
    let ContactLaw::Linear { stiffness_n_per_m, .. } = *law else { return None };
    let (age, depth) = (&scratch.memory(part).age, scratch.depths(part));
    let mut sums = [0.0; LANES];
    let blocks = age.as_chunks::<LANES>().0.iter().zip(depth.as_chunks::<LANES>().0);
    for (_, (age, depth)) in blocks.enumerate().filter(|(block, _)| !scratch.is_idle(part, *block)) {
        for i in 0..LANES {
            let d = if depth[i] > 0.0 { depth[i] } else { 0.0 };
            sums[i] += if age[i] > 0.0 { d * d } else { 0.0 };
        }
    }
    Some(0.5 * stiffness_n_per_m * sum(&sums))
}

/// Damping and friction of the first `n` lanes [J].
#[inline(always)]
fn lost(memory: &ContactMemory, n: usize) -> f64 {
    sum(&memory.lost_damping[..n]) + sum(&memory.lost_friction[..n])
}

/// In partial sums.
#[inline(always)]
fn sum(values: &[f64]) -> f64 {
    let (whole, rest) = values.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for block in whole {
        for i in 0..LANES {
            sums[i] += block[i];
        }
    }
    sums.iter().sum::<f64>() + rest.iter().sum::<f64>()
}
