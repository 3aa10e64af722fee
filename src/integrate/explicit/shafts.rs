//! The part of a step that concerns shafts: loads, couplings, and the motion of the driver.

use super::Scratch;
use crate::elements::coordinate::CoordinateMotion;
use crate::elements::driver_motion::sum_of_cosines;
use crate::elements::span::ChainSpan;
use crate::model::Model;
use crate::pairs::part_part::TouchShape;
use crate::recording::frame::Energy;
use crate::state::State;

/// Time of the node since the recording began; negative while a drive is run in [s].
#[inline(always)]
fn time_s(model: &Model, state: &State, scratch: &Scratch) -> f64 {
    (state.step as f64 - scratch.run_in.steps_before as f64) * model.step_s
}

/// Adds loads and couplings to the forces of parts, apart by what they do to energy.
pub(super) fn forces(model: &Model, state: &State, scratch: &mut Scratch) {
    if !model.has_shaft_forces() {
        return;
    }
    let q = &state.coordinates;
    let half = 0.5 * model.step_s;
    let speed = |k: usize| q.omega[k] + half * q.alpha[k];
    scratch.losing_force.fill(0.0);
    scratch.working_force.fill(0.0);
    scratch.losing_parts.iter_mut().for_each(|part| part.fill(0.0));
    for load in &model.loads {
        let k = load.coordinate;
        let force = load.force(q.angle[k], speed(k));
        let column = if load.is_dissipative { &mut scratch.losing_force } else { &mut scratch.working_force };
        column[k] += force;
        scratch.losing_parts[0][k] += if load.is_dissipative { force } else { 0.0 };
    }
    if let Some(motion) = &model.driver_motion {
        let turn_rad = motion.turn_rad(time_s(model, state, scratch));
        for load in &model.order_loads {
            scratch.working_force[load.coordinate] -= load.sense * sum_of_cosines(&load.harmonics, turn_rad);
        }
    }
    for gas in &model.gas_loads {
        if let TouchShape::Cam(cam) = &model.touches[gas.cam].shape {
            scratch.working_force[cam.valve] -= gas.area_m2 * gas.pressures.at(cam.angle_rad(cam.turn(&q.angle)));
        }
    }
    for coupling in &model.couplings {
        let [a, b] = coupling.ends;
        let (spring, damper) = coupling.torques_nm([q.angle[a], q.angle[b]], [speed(a), speed(b)]);
        scratch.parts_force[a] += spring;
        scratch.parts_force[b] -= spring;
        scratch.losing_force[a] += damper;
        scratch.losing_force[b] -= damper;
        scratch.losing_parts[1][a] += damper;
        scratch.losing_parts[1][b] -= damper;
    }
    for ((sum, losing), working) in
        scratch.parts_force.iter_mut().zip(&scratch.losing_force).zip(&scratch.working_force)
    {
        *sum += losing + working;
    }
    // What spans pull with is torque of a chain; only their dampers' share of it is a loss.
    for span in &model.spans {
        let elongation_m = span.elongation(span.ends.map(|k| q.angle[k]));
        let (spring_n, damper_n) = span.forces_n(elongation_m, span.elongation(span.ends.map(speed)));
        for (k, lever_m) in span.ends.into_iter().zip(span.levers_m()) {
            scratch.chain_torque[k] += lever_m * (spring_n + damper_n);
            scratch.losing_force[k] += lever_m * damper_n;
            scratch.losing_parts[2][k] += lever_m * damper_n;
        }
    }
}

/// Elongation, its rate, and force of spring and damper of a span at the node, as [`forces`] has them.
pub(crate) fn span_at(model: &Model, state: &State, span: &ChainSpan) -> SpanNow {
    let q = &state.coordinates;
    let half = 0.5 * model.step_s;
    let elongation_m = span.elongation(span.ends.map(|k| q.angle[k]));
    let rate_m_s = span.elongation(span.ends.map(|k| q.omega[k] + half * q.alpha[k]));
    let (spring_n, damper_n) = span.forces_n(elongation_m, rate_m_s);
    let tension_n = spring_n + damper_n;
    let [from, to] = [0, 1].map(|i| span.radii_m[i] * (q.omega[span.ends[i]] + half * q.alpha[span.ends[i]]));
    SpanNow { elongation_m, tension_n, power_w: (span.preload_n - tension_n) * 0.5 * (from + to) }
}

/// What a span does at a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SpanNow {
    pub(crate) elongation_m: f64,
    pub(crate) tension_n: f64,
    /// From its first sprocket to its second: that of what the tension is below the preload, at the mean speed of both ends.
    pub(crate) power_w: f64,
}

/// Speed of the driver in the middle of the coming step [rad/s]; None where it is constant, and of what is held.
#[inline(always)]
pub(super) fn driver_speed(model: &Model, state: &State, scratch: &Scratch, k: usize) -> Option<f64> {
    let motion = model.driver_motion.as_ref()?;
    if model.coordinates[k].motion == CoordinateMotion::Held {
        return None;
    }
    let half = 0.5 * model.step_s;
    let q = &state.coordinates;
    // The angle in the middle of the step, as the speed of the step before has it.
    Some(motion.speed_rad_s(time_s(model, state, scratch) + half, q.angle[k] + half * q.omega[k]))
}

/// Adds what coordinates and couplings hold, lose and take at the node to the accounts: sums up to the step before, and half of this step's.
#[inline(always)]
pub(crate) fn add_energies(model: &Model, state: &State, scratch: &Scratch, e: &mut Energy) {
    let r = &state.coordinates;
    let h = model.step_s;
    for (k, coordinate) in model.coordinates.iter().enumerate() {
        let speed = r.omega[k] + 0.5 * h * scratch.coordinate_alpha[k];
        let half_step_turn = 0.5 * h * speed;
        e.work_in_j += r.work_in[k];
        e.work_out_j += r.work_out[k];
        match coordinate.motion {
            CoordinateMotion::Prescribed { .. } => {
                e.work_in_j -= (scratch.chain_torque[k] + scratch.parts_force[k]) * half_step_turn;
            }
            CoordinateMotion::Held => {}
            CoordinateMotion::Free { inertia, load } => {
                e.kinetic_j += 0.5 * inertia * speed.powi(2);
                e.work_out_j -= (load + scratch.working_force[k]) * half_step_turn;
            }
        }
        e.elastic_spring_j += coordinate.spring.energy_j(r.angle[k]);
        let Some(lost) = r.lost.get(k) else { continue };
        let lost = lost + (coordinate.spring.damping * speed - scratch.losing_force[k]) * half_step_turn;
        let of_part = |past: &[f64], force: &[f64]| past.get(k).map_or(0.0, |lost| lost - force[k] * half_step_turn);
        let [by_loads, by_couplings, by_spans] = &scratch.losing_parts;
        let (load, coupling) = (of_part(&r.lost_load, by_loads), of_part(&r.lost_coupling, by_couplings));
        e.lost_load_j += load;
        e.lost_coupling_damping_j += coupling;
        let span = of_part(&r.lost_span, by_spans);
        e.lost_span_damping_j += span;
        if coordinate.spring.damping > 0.0 || model.is_on_film(k) {
            e.lost_spring_damping_j += lost - load - coupling - span;
        }
    }
    for coupling in &model.couplings {
        e.elastic_coupling_j += coupling.energy_j(coupling.ends.map(|k| r.angle[k]));
    }
    for span in &model.spans {
        e.elastic_span_j += span.energy_j(span.elongation(span.ends.map(|k| r.angle[k])));
    }
}
