//! The part of a step that concerns parts which touch each other and no chain, and oil: stops, tips of sliders, balls, chambers.

use super::Scratch;
use crate::elements::hydraulics::CoordinateStep;
use crate::model::Model;
use crate::pairs::part_part::{CoordinateRates, Gap, PastTouch};
use crate::state::State;

/// Forces of loads, couplings, films, oil and of all touches on the coordinates, one touch after the other: each takes those before it into account as
/// they are, those behind it as they were a step ago.
pub(super) fn forces(model: &Model, state: &State, scratch: &mut Scratch) {
    if model.touches.is_empty() && model.oil.is_none() && !model.has_shaft_forces() {
        return;
    }
    scratch.parts_force.fill(0.0);
    super::shafts::forces(model, state, scratch);
    super::films::forces(model, state, scratch);
    let q = &state.coordinates;
    if let Some(oil) = &model.oil {
        oil.add_forces(&q.angle, &state.oil, &mut scratch.parts_force);
    }
    // Those behind are taken as they were a step ago: a valve on its seat and its cam press on one mass.
    let mut behind = std::mem::take(&mut scratch.touches_behind);
    behind.fill(0.0);
    for (i, touch) in model.touches.iter().enumerate().filter(|(i, _)| state.touches.normal_force[*i] > 0.0) {
        let gap = touch.shape.gap(&q.angle);
        for (side, force) in past_forces(state, i, &gap).into_iter().enumerate() {
            touch.shape.parts_of(&gap, side).for_each(|(k, weight)| behind[k] += weight * force);
        }
    }
    for (i, touch) in model.touches.iter().enumerate() {
        let gap = touch.shape.gap(&q.angle);
        if state.touches.normal_force[i] > 0.0 {
            for (side, force) in past_forces(state, i, &gap).into_iter().enumerate() {
                touch.shape.parts_of(&gap, side).for_each(|(k, weight)| behind[k] -= weight * force);
            }
        }
        let parts = |side: usize| touch.shape.parts_of(&gap, side);
        let inverse = |k: usize| model.coordinates[k].inverse_inertia();
        let acceleration = |(k, weight): (usize, f64)| {
            weight * (super::coordinate_acceleration(model, state, scratch, k) + behind[k] * inverse(k))
        };
        let moving = CoordinateRates {
            speed: [0, 1].map(|side| parts(side).map(|(k, weight)| weight * q.omega[k]).sum()),
            acceleration: [0, 1].map(|side| parts(side).map(acceleration).sum()),
            inverse_inertia: [0, 1].map(|side| parts(side).map(|(k, weight)| weight * weight * inverse(k)).sum()),
        };
        let before = &state.touches;
        let past = PastTouch { normal_force: before.normal_force[i], age: before.age[i], approach: before.approach[i] };
        let step = touch.step(model.step_s, &gap, &moving, past);
        for (side, force) in step.forces.into_iter().enumerate() {
            touch.shape.parts_of(&gap, side).for_each(|(k, weight)| scratch.parts_force[k] += weight * force);
        }
        let now = &mut scratch.touches;
        (now.normal_force[i], now.tangential_force[i]) = (step.normal_force, step.tangential_force);
        (now.age[i], now.approach[i]) = (step.age, step.approach);
        now.lost_damping[i] = before.lost_damping[i] + step.lost_damping;
        now.lost_friction[i] = before.lost_friction[i] + step.lost_friction;
    }
    scratch.touches_behind = behind;
}

/// What a touch gave a step ago, on the two coordinates of its gap; the force of its normal alone.
fn past_forces(state: &State, touch: usize, gap: &Gap) -> [f64; 2] {
    gap.slope.map(|slope| state.touches.normal_force[touch] * slope)
}

/// Moves the oil on, after the coordinates have moved from where `scratch` has kept them.
pub(super) fn advance_oil(model: &Model, state: &mut State, scratch: &mut Scratch) {
    let Some(oil) = &model.oil else { return };
    let (from, q) = (&scratch.places_before, &state.coordinates);
    for ((middle, a), b) in scratch.places_between.iter_mut().zip(from).zip(&q.angle) {
        *middle = 0.5 * (a + b);
    }
    let way = CoordinateStep { from, to: &q.angle, middle: &scratch.places_between, speed: &q.omega };
    oil.advance(model.step_s, way, &mut state.oil);
}

/// Forces along the way of what slides [N], outwards positive; their sum is its mass times its acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SlidingForces {
    /// What its springs, dampers, film and loads give.
    pub(crate) spring_n: f64,
    pub(crate) oil_n: f64,
    /// What all that it touches gives.
    pub(crate) touch_n: f64,
}

/// Forces on a coordinate that slides, as the step works with them.
pub(crate) fn sliding_forces(model: &Model, state: &State, scratch: &Scratch, k: usize) -> SlidingForces {
    let (q, coordinate) = (&state.coordinates, &model.coordinates[k]);
    let speed = q.omega[k] + 0.5 * model.step_s * scratch.coordinate_alpha[k];
    let mut spring = coordinate.spring.force(q.angle[k]) - coordinate.spring.damping * speed;
    for coupling in model.couplings.iter().filter(|c| c.ends.contains(&k)) {
        let (force, _) = coupling.torques_nm(coupling.ends.map(|end| q.angle[end]), [0.0; 2]);
        spring += if coupling.ends[0] == k { force } else { -force };
    }
    let mut touch_n = 0.0;
    for (i, touch) in model.touches.iter().enumerate() {
        if scratch.touches.normal_force[i] == 0.0 {
            continue;
        }
        let gap = touch.shape.gap(&q.angle);
        for (own, (slope, slide)) in gap.coordinates.into_iter().zip(gap.slope.into_iter().zip(gap.slide)) {
            if own == k {
                let now = &scratch.touches;
                touch_n += now.normal_force[i] * slope + now.tangential_force[i] * slide;
            }
        }
    }
    SlidingForces {
        spring_n: coordinate.load() + spring + scratch.losing_force[k] + scratch.working_force[k],
        oil_n: model.oil.as_ref().map_or(0.0, |oil| oil.force_on(k, &q.angle, &state.oil)),
        touch_n,
    }
}

/// Force of a touch on its parts along the normal [N].
pub(crate) fn normal_force(scratch: &Scratch, touch: usize) -> f64 {
    scratch.touches.normal_force[touch]
}

/// Energies of the touches at the node: stored, lost to damping, lost to friction [J].
pub(crate) fn energies(model: &Model, state: &State, scratch: &Scratch) -> [f64; 3] {
    let mut sums = [0.0; 3];
    let (past, now) = (&state.touches, &scratch.touches);
    for (i, touch) in model.touches.iter().enumerate() {
        let gap_m = touch.shape.gap(&state.coordinates.angle).gap_m;
        // Where a damper would pull, the overlap that is left holds nothing.
        if now.normal_force[i] > 0.0 {
            sums[0] += touch.law.elastic(-gap_m, touch.radii).energy_j;
        }
        // Totals before and after this step: at the node in its middle, their mean.
        sums[1] += 0.5 * (past.lost_damping[i] + now.lost_damping[i]);
        sums[2] += 0.5 * (past.lost_friction[i] + now.lost_friction[i]);
    }
    sums
}
