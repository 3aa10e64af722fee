//! The declared model: its free numbers with their ranges and priors, its fit, and how stiff a model may become.

use super::model::{FittedModel, fit_model};
use super::problem::{Global, Law, Local, Point, Problem};
use super::search::Context;
use super::stats::Random;
use crate::machine::Machine;
use crate::machine::simulate::{MAX_STEPS, bears_sharp_friction};
use crate::measurement::segments::{Data, RecordSegment};
use crate::measurement::{FitScope, Measurement};
use crate::units::within;

/// The declared model with its free numbers.
pub fn problem<'a>(
    measurement: &Measurement,
    machine: &Machine,
    data: &'a Data,
    context: &'a Context<'a>,
) -> Problem<'a> {
    let mut globals = Vec::new();
    let mut locals = Problem::default_locals(machine, data);
    for spec in &measurement.fit {
        let Some(slot) = machine.slot(&spec.path) else { continue };
        let (value, s) = (machine.values[slot], &machine.slots[slot]);
        let low = spec.low.unwrap_or(s.low).max(s.low) * s.unit;
        let high = spec.high.unwrap_or(s.high).min(s.high) * s.unit;
        let logarithm = value > 0.0 && low >= 0.0;
        let range = |given: Option<f64>, far: f64, bound: f64| if given.is_none() && logarithm { far } else { bound };
        let low = range(spec.low, value / SEARCH_FACTOR, low).max(low);
        let high = range(spec.high, value * SEARCH_FACTOR, high).min(high);
        let law = Law {
            scale: if value == 0.0 { scale_of_zero(low, high) } else { value.abs() },
            logarithm,
            low: if logarithm { low.max(value * 1e-9) } else { low },
            high,
        };
        // A load of the file may be taken over by an effect, which is then as good a place for it.
        let is_load = spec.path.starts_with("loads.");
        let is_open = logarithm && !is_load && spec.low.is_none() && spec.high.is_none();
        let spread = spec.spread.or(is_open.then_some(DEFAULT_SPREAD));
        let known_to = |value: f64| spread.map(|spread| (law.scaled(value), spread));
        let prior = known_to(value);
        match spec.scope {
            FitScope::All => globals.push(Global { slot, record: None, law, prior }),
            FitScope::Record => {
                let all = 0..data.records.len();
                let set = |r: usize| data.set[r].iter().find(|(of, _)| *of == slot).map_or(value, |(_, value)| *value);
                globals.extend(all.map(|r| Global { slot, record: Some(r), law, prior: known_to(set(r)) }));
            }
            FitScope::Part => locals.push(Local::Slot { slot, law }),
        }
    }
    let mut problem = Problem {
        machine: machine.clone(),
        fixed: Vec::new(),
        folded: false,
        correction: 0.0,
        data,
        channels: data.channels.iter().map(|c| c.sensor).collect(),
        weights: data.channels.iter().map(|c| c.noise.max(1e-12)).collect(),
        globals,
        locals,
        max_steps: MAX_STEPS,
        runs: context.runs,
        ending: context.ending(),
    };
    let start = problem.start();
    if let Some(needed) = steps_needed_at(&problem, &start) {
        // Ranges from the measurement may be used to their ends.
        let mut most = FILE_STIFFNESS_FACTOR * needed;
        for spec in &measurement.fit {
            let own = (0..problem.globals.len()).filter(|g| machine.slots[problem.globals[*g].slot].path == spec.path);
            for g in own {
                let unit = machine.slots[problem.globals[g].slot].unit;
                for bound in [spec.low, spec.high].into_iter().flatten().filter(|x| x.is_finite() && *x != 0.0) {
                    let mut at = start.clone();
                    at.globals[g] = problem.globals[g].law.scaled(bound * unit);
                    most = steps_needed_at(&problem, &at).map_or(most, |needed| most.max(needed));
                }
            }
        }
        problem.max_steps = within(most, MAX_STIFFNESS, MAX_STEPS);
    }
    problem
}

/// Standard deviation of the logarithm of a positive number of which the measurement file says neither how well it is known nor where it
/// lies: a factor of 2, about what an estimate by hand is worth.
pub(super) const DEFAULT_SPREAD: f64 = std::f64::consts::LN_2;

/// A positive parameter is searched within this factor of the file's value, unless the measurement gives a range.
/// Without a limit, a poorly determined damping grows until every run takes hundreds of steps a sample.
const SEARCH_FACTOR: f64 = 1000.0;

/// Scale of a parameter whose value is zero, from its bounds.
fn scale_of_zero(low: f64, high: f64) -> f64 {
    let width = (high - low).abs();
    if width < 1e3 { (0.01 * width).max(1e-9) } else { 1.0 }
}

/// Fits whose deviances differ by less are equal.
pub(super) const DEVIANCE_TOLERANCE: f64 = 1e-3;

/// The baseline fit: started from the drive's own parameters and from values around them, so that it does not miss a
/// better minimum.
pub fn fitted<'a>(problem: Problem<'a>, own: &'a Data, context: &Context) -> FittedModel<'a> {
    let mut start = problem.start();
    problem.find_start_positions(&mut start, context.threads);
    problem.reverse_better_starts(&mut start, context.threads);
    let mut best = fit_model(problem.clone(), &start, own, Vec::new(), context.threads, 60);
    let mut random = Random::new(7);
    for _ in 0..problem.machine.effort().restarts {
        if context.must_end() || problem.globals.is_empty() {
            break;
        }
        let mut other = start.clone();
        for (x, g) in other.globals.iter_mut().zip(&problem.globals) {
            let stated = g.prior.filter(|(_, s)| *s != DEFAULT_SPREAD);
            let d = (random.below(2001) as f64 / 1000.0 - 1.0) * stated.map_or(1.0, |(_, s)| s.min(1.0));
            *x += d;
        }
        let model = fit_model(problem.clone(), &other, own, Vec::new(), context.threads, 40);
        if model.misfit() < best.misfit() - DEVIANCE_TOLERANCE {
            best = model;
        }
    }
    best
}

/// Limits of stiffness in steps per sample. At the first value a spring oscillates faster than the samples resolve, and
/// a damper settles between two samples. Stiffer models are searched only up to this multiple of the steps that the
/// file's parameters need.
pub(super) const MAX_STIFFNESS: f64 = 40.0;
const FILE_STIFFNESS_FACTOR: f64 = 16.0;
/// An added effect may need this multiple of the steps of the fitted model.
const ADDED_STIFFNESS_FACTOR: f64 = 4.0;

/// Steps per sample that a run needs with these parameters, at least one; None: the step does not depend on them.
pub(super) fn steps_needed_at(problem: &Problem, point: &Point) -> Option<f64> {
    let of = |(k, s): (usize, &RecordSegment)| {
        let (values, start) = problem.numbers(k, &point.globals, &point.locals[k]);
        problem.machine.steps_needed(&values, &s.task, &start)
    };
    problem.data.segments.iter().enumerate().filter_map(of).reduce(f64::max).map(|steps| steps.max(1.0))
}

/// Whether a fit is near the limit of steps per sample.
pub fn is_at_step_limit(declared: &FittedModel) -> bool {
    let needed = steps_needed_at(&declared.problem, &declared.fit.point);
    needed.is_some_and(|steps| steps > 0.9 * declared.problem.max_steps) && !bears_sharp_friction_everywhere(declared)
}

/// Whether all runs of a model take implicit steps near rest.
pub(super) fn bears_sharp_friction_everywhere(model: &FittedModel) -> bool {
    let (problem, at) = (&model.problem, &model.fit.point);
    problem.data.segments.iter().enumerate().all(|(k, s)| {
        let (values, _) = problem.numbers(k, &at.globals, &at.locals[k]);
        bears_sharp_friction(&problem.machine, &values, &s.task)
    })
}

/// Added effects may be stiffer than the declared model, but only up to a limit that keeps the search time acceptable.
pub(super) fn set_step_limit(problem: &mut Problem, fitted: &Point) {
    let file = problem.start();
    let needed = [&file, fitted].into_iter().filter_map(|at| steps_needed_at(problem, at)).reduce(f64::max);
    if let Some(needed) = needed {
        problem.max_steps = within(ADDED_STIFFNESS_FACTOR * needed, 16.0, problem.max_steps);
    }
}
