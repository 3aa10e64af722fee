//! Effects that need explicit steps beside friction that is too sharp for them.
//!
//! Friction alone is crossed by implicit steps, however sharp it is at rest. An added body, bristles or a clock that errs need explicit steps,
//! which sharp friction makes many. They are looked for beside the same model with friction as soft as such steps bear.

use super::declared::{MAX_STIFFNESS, bears_sharp_friction_everywhere, steps_needed_at};
use super::model::{FIT_ITERATIONS, FittedModel, fit_model};
use super::search::Context;
use crate::effects::{EFFECTS, Effect, Physics};
use crate::measurement::CandidateSpec;
use crate::measurement::segments::Data;

/// Factor of the range of a stick speed above the one that explicit steps bear.
const SOFTEST: f64 = 1000.0;

/// Whether a run with this effect takes explicit steps.
fn needs_explicit_steps(effect: &Effect) -> bool {
    matches!(effect.physics, Physics::SecondBody { .. } | Physics::StateForce(_) | Physics::Clock(_))
}

/// The model fitted with softer friction. None where its friction is soft, or not free, or where only noise is left to explain.
pub(super) fn softened<'a>(model: &FittedModel<'a>, own: &'a Data, context: &Context<'_>) -> Option<FittedModel<'a>> {
    let needed = steps_needed_at(&model.problem, &model.fit.point)?;
    let is_sharp = needed > MAX_STIFFNESS && bears_sharp_friction_everywhere(model);
    if !is_sharp || model.is_noise_alone() || context.must_end() {
        return None;
    }
    let (mut problem, mut start) = (model.problem.clone(), model.fit.point.clone());
    let mut is_softer = false;
    for (global, x) in problem.globals.iter_mut().zip(&mut start.globals) {
        let key = problem.machine.slots[global.slot].path.rsplit('.').next().unwrap_or_default();
        if key.starts_with("stick_speed") {
            // Steps go with the slope at rest.
            let value = global.law.value(*x) * needed / MAX_STIFFNESS;
            (global.law.scale, global.law.low, global.law.high) = (value, value, SOFTEST * value);
            *x = global.law.scaled(value);
            is_softer = true;
        }
    }
    problem.max_steps = problem.max_steps.max(1.2 * MAX_STIFFNESS);
    is_softer.then(|| fit_model(problem, &start, own, model.effects.clone(), context.threads, FIT_ITERATIONS))
}

/// The candidates that need explicit steps, and the others.
pub(super) fn apart(spec: &CandidateSpec) -> (CandidateSpec, CandidateSpec) {
    let is_wanted = |e: &&&Effect| spec.only.is_empty() || spec.only.iter().any(|name| name == e.name);
    let explicit = EFFECTS.iter().filter(|e| needs_explicit_steps(e));
    let names: Vec<String> = explicit.clone().map(|e| e.name.to_string()).collect();
    let only = explicit.filter(is_wanted).map(|e| e.name.to_string()).collect();
    let without = spec.without.iter().cloned().chain(names).collect();
    (CandidateSpec { only, without: spec.without.clone() }, CandidateSpec { only: spec.only.clone(), without })
}
