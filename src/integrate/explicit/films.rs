//! The part of a step that concerns films of plain bearings.

use super::Scratch;
use crate::elements::plain_bearing::Journal;
use crate::model::Model;
use crate::state::State;

/// Adds forces and torques of films to those of parts. Comes after the chain's forces, which the journals pass on.
pub(super) fn forces(model: &Model, state: &State, scratch: &mut Scratch) {
    let (q, h) = (&state.coordinates, model.step_s);
    for bearing in &model.bearings {
        let Some((film, turn)) = &bearing.film else { continue };
        let world = |column: &[f64]| bearing.to_world(bearing.ways.map(|k| column[k]));
        let [along, across] = bearing.ways;
        let others = bearing.to_world(bearing.ways.map(|k| scratch.chain_torque[k] + scratch.parts_force[k]));
        let before = world(&q.omega);
        let journal = Journal {
            mass_kg: 1.0 / model.coordinates[along].inverse_inertia(),
            way: world(&q.angle),
            velocity_before: before,
            velocity: before + world(&q.alpha) * (0.5 * h),
            omega: q.omega[*turn] + 0.5 * h * q.alpha[*turn],
            others,
        };
        let step = film.step(h, &journal);
        let (own, side) = (bearing.direction, crate::geometry::perp(bearing.direction));
        let forces = [(along, step.force.dot(&own)), (across, step.force.dot(&side)), (*turn, step.torque_nm)];
        for (k, force) in forces {
            scratch.parts_force[k] += force;
            scratch.losing_force[k] += force;
        }
    }
}
