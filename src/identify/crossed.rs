//! Cross-validation for effects that the held-out data do not show, for example because nothing there reverses or
//! reaches a limit. Each record that was fitted is left out in turn and predicted from the others.

use super::fit::{FitOptions, fit};
use super::judge::{self, Residuals, fit_held_out};
use super::model::{FittedModel, globals_of, placed_path};
use super::problem::{Point, Problem};
use crate::measurement::segments::Data;

/// Held-out residuals with an effect and without it.
#[derive(Clone, Debug)]
pub struct HeldOutComparison {
    pub with: Residuals,
    pub without: Residuals,
    /// Records that were left out in turn, if the regular held-out data do not show the effect.
    pub left_out: Vec<usize>,
}

/// A difference below this fraction of a channel's noise counts as zero.
const INVISIBLE_SHARE: f64 = 0.01;
/// Held-out errors that differ by less than this fraction may belong to an effect that the held-out data do not show.
const SIMILAR_ERROR_SHARE: f64 = 0.05;

/// Held-out residuals of a model and of the same model without some of its effects, given by their indices.
pub fn compare_held_out(
    with: &FittedModel,
    without: &FittedModel,
    effects: &[usize],
    own: &Data,
    threads: usize,
) -> HeldOutComparison {
    let usual = HeldOutComparison {
        with: with.residuals().clone(),
        without: without.residuals().clone(),
        left_out: Vec::new(),
    };
    let ratio = judge::mean_error(&with.residuals().judge) / judge::mean_error(&without.residuals().judge).max(1e-300);
    if !with.problem.machine.effort().is_thorough || effects.is_empty() || (ratio - 1.0).abs() > SIMILAR_ERROR_SHARE {
        return usual;
    }
    let idle = effects.iter().map(|e| switched_off(with, *e)).collect::<Option<Vec<_>>>();
    let Some(idle) = idle.filter(|all| all.iter().all(|off| !judging_shows(with, off, own, threads))) else {
        return usual;
    };
    let data = with.problem.data;
    let mut fitting: Vec<usize> = data.segments.iter().filter(|s| s.judge_from > 0).map(|s| s.record).collect();
    fitting.dedup();
    let shown = |r: &usize| idle.iter().any(|off| fitting_shows(with, off, *r));
    let left_out: Vec<usize> = fitting.iter().copied().filter(shown).collect();
    // If only one record shows the effect, the other records cannot determine its size, provided that it has one.
    let sized = effects.iter().any(|e| !globals_of(with, *e).is_empty());
    if fitting.len() < 2 || left_out.len() < if sized { 2 } else { 1 } {
        return usual;
    }
    let empty = |r: &Residuals| {
        let channels = vec![Vec::new(); r.judge.len()];
        Residuals { judge: channels, judge_record: Vec::new(), ..r.clone() }
    };
    let mut crossed = HeldOutComparison { with: empty(&usual.with), without: empty(&usual.without), left_out };
    for r in &crossed.left_out {
        for (model, into) in [(with, &mut crossed.with), (without, &mut crossed.without)] {
            let parts = predicted(model, *r, threads);
            into.judge_record.extend(parts[0].iter().map(|_| *r));
            into.judge.iter_mut().zip(parts).for_each(|(all, parts)| all.extend(parts));
        }
    }
    crossed
}

/// The model without an effect, all parameters kept; None if no value of its own parameters switches it off.
fn switched_off<'a>(model: &FittedModel<'a>, effect: usize) -> Option<(Problem<'a>, Point)> {
    let path = placed_path(model, effect);
    let (mut problem, mut point) = (model.problem.clone(), model.fit.point.clone());
    let placed = problem.machine.placed.iter().find(|p| p.path == path)?;
    let keys = problem.machine.keys(placed.effect, placed.target);
    let slots: Vec<(usize, f64)> = keys
        .iter()
        .zip(&placed.slots)
        .filter(|((_, row), _)| row.kind.is_amplitude() || placed.effect.parameters.len() == 1)
        .map(|((_, row), slot)| (*slot, row.off * row.unit))
        .collect();
    for (slot, value) in &slots {
        problem.machine.values[*slot] = *value;
        for (g, x) in problem.globals.iter().zip(&mut point.globals).filter(|(g, _)| g.slot == *slot) {
            *x = g.law.scaled(*value);
            if (g.law.value(*x) - value).abs() > 1e-9 * value.abs() {
                return None;
            }
        }
    }
    (!slots.is_empty()).then_some((problem, point))
}

/// Whether two series of channel readings differ by more than the channel resolves.
fn differ(problem: &Problem, a: &[Vec<f64>], b: &[Vec<f64>]) -> bool {
    let noises = problem.data.channels.iter().map(|c| INVISIBLE_SHARE * c.noise.max(1e-300));
    a.iter().zip(b).zip(noises).any(|((a, b), least)| a.iter().zip(b).any(|(a, b)| (a - b).abs() > least))
}

/// Whether a segment's readings change when an effect is removed, from the same initial state.
fn shows(model: (&Problem, &Point), off: (&Problem, &Point), part: usize, fitting: bool) -> bool {
    let of = |(problem, point): (&Problem, &Point)| problem.model(part, &point.globals, &point.locals[part], fitting);
    match (of(model), of(off)) {
        (Ok(a), Ok(b)) => differ(model.0, &a, &b),
        _ => true,
    }
}

/// The same for held-out data: ends of fitted segments, and separate segments, from the initial states found with the
/// effect.
fn judging_shows(model: &FittedModel, (problem, point): &(Problem, Point), own: &Data, threads: usize) -> bool {
    let segments = &model.problem.data.segments;
    let mut tails = (0..segments.len()).filter(|k| (1..segments[*k].len()).contains(&segments[*k].judge_from));
    if tails.any(|k| shows((&model.problem, &model.fit.point), (problem, point), k, false)) {
        return true;
    }
    let Some((held, at)) = fit_held_out(&model.problem, &model.fit, own, threads) else { return false };
    // The same initial states and record parameters, and the machine without the effect.
    let mut without = held.clone();
    for placed in &problem.machine.placed {
        for slot in &placed.slots {
            let mut numbers = problem.globals.iter().zip(&point.globals).filter(|(g, _)| g.slot == *slot);
            match numbers.next() {
                Some((g, _)) if g.record.is_some() => {}
                Some((g, x)) => without.fixed.push((None, *slot, g.law.value(*x))),
                None => without.fixed.push((None, *slot, problem.machine.values[*slot])),
            }
        }
    }
    (0..own.segments.len()).any(|k| shows((&held, &at), (&without, &at), k, false))
}

fn fitting_shows(model: &FittedModel, (problem, point): &(Problem, Point), record: usize) -> bool {
    let segments = &model.problem.data.segments;
    let mut own = (0..segments.len()).filter(|k| segments[*k].record == record && segments[*k].judge_from > 0);
    own.any(|k| shows((&model.problem, &model.fit.point), (problem, point), k, true))
}

/// Residuals of a record's segments, channel by channel, after a fit to the other records.
fn predicted(model: &FittedModel, record: usize, threads: usize) -> Vec<Vec<Vec<f64>>> {
    let data = model.problem.data;
    let kept: Vec<usize> = (0..data.segments.len()).filter(|k| data.segments[*k].record != record).collect();
    let mut others = data.clone();
    others.segments = kept.iter().map(|k| data.segments[*k].clone()).collect();
    let mut own = data.clone();
    own.segments.retain(|s| s.record == record && s.judge_from > 0);
    for s in &mut own.segments {
        let n = s.judge_from;
        s.task = s.fitting_task();
        s.measured.iter_mut().for_each(|m| m.truncate(n));
    }
    let mut problem: Problem = model.problem.clone();
    problem.data = &others;
    let locals = kept.iter().map(|k| model.fit.point.locals[*k].clone()).collect();
    let start = Point { globals: model.fit.point.globals.clone(), locals };
    let found = fit(&problem, &start, FitOptions { iterations: 40, threads });
    judge::held_out_residuals(&problem, &found, &own, threads)
}
