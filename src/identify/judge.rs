//! Residuals and scores of a fit on the data it was fitted to, and on held-out data.

use super::fit::{Fit, FitOptions, fit};
use super::problem::{Point, Problem};
use super::stats;
use crate::measurement::segments::{Data, RecordSegment};
use std::collections::BTreeSet;

/// Unweighted residuals in the unit in which channels are compared, channel by channel and segment by segment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Residuals {
    pub fit: Vec<Vec<Vec<f64>>>,
    pub judge: Vec<Vec<Vec<f64>>>,
    /// Record of every segment.
    pub fit_record: Vec<usize>,
    pub judge_record: Vec<usize>,
}

/// The held-out segments, marked as fitting data so that their local parameters can be fitted.
pub fn held_out_segments(data: &Data) -> Data {
    let mut own = data.clone();
    own.segments.retain(|s| s.judge_from == 0);
    for s in &mut own.segments {
        s.judge_from = s.len();
    }
    own
}

/// Fits the local parameters (initial states, phases of their records) of the held-out segments; the drive's parameters
/// are fixed.
pub fn fit_held_out<'a>(
    problem: &Problem<'a>,
    found: &Fit,
    own: &'a Data,
    threads: usize,
) -> Option<(Problem<'a>, Point)> {
    if own.segments.is_empty() {
        return None;
    }
    let mut held = problem.clone();
    held.data = own;
    let mut kept = Vec::new();
    let mut start = Vec::new();
    for (g, x) in problem.globals.iter().zip(&found.point.globals) {
        match g.record {
            Some(r) if own.segments.iter().any(|s| s.record == r) => {
                // A record that was also fitted has already determined its parameters.
                let fits = problem.data.segments.iter().any(|s| s.record == r && s.judge_from > 0);
                if fits {
                    held.fixed.push((Some(r), g.slot, g.law.value(*x)));
                } else {
                    kept.push(g.clone());
                    start.push(*x);
                }
            }
            Some(_) => {}
            None => held.fixed.push((None, g.slot, g.law.value(*x))),
        }
    }
    held.globals = kept;
    let phases: Vec<usize> = (0..held.globals.len()).filter(|g| is_phase(&held, *g)).collect();
    // Records that begin in one state have one phase.
    for g in &phases {
        let mean = mean_phase(problem, found, held.globals[*g].slot);
        start[*g] = mean.map_or(start[*g], |mean| held.globals[*g].law.scaled(mean));
    }
    let mut point = Point { globals: start, locals: held.start().locals };
    held.find_start_positions(&mut point, threads);
    held.reverse_better_starts(&mut point, threads);
    let options = FitOptions { iterations: 30, threads };
    let first = fit(&held, &point, options);
    if phases.is_empty() {
        return Some((held, first.point));
    }
    // A phase may have started on the wrong side of its circle. Nothing joins the records here, so that each takes its own best.
    let cost = |of: &Fit, record: usize| -> f64 {
        let segments = own.segments.iter().zip(&of.residuals).filter(|(s, _)| s.record == record);
        let left: f64 = segments.map(|(_, r)| r.iter().map(|r| r * r).sum::<f64>()).sum();
        let numbers = held.globals.iter().zip(&of.point.globals).filter(|(g, _)| g.record == Some(record));
        let away = numbers.filter_map(|(g, x)| g.prior.map(|(mean, spread)| (x - mean) / spread));
        left + away.map(|z| z * z).sum::<f64>()
    };
    let records: BTreeSet<usize> = own.segments.iter().map(|s| s.record).collect();
    let mut least: Vec<(usize, f64)> = records.iter().map(|r| (*r, cost(&first, *r))).collect();
    let mut best = first.point.clone();
    for turn in 1..4 {
        let mut turned = first.point.clone();
        for g in &phases {
            turned.globals[*g] += f64::from(turn) * std::f64::consts::FRAC_PI_2;
        }
        let other = fit(&held, &turned, options);
        for (record, least) in &mut least {
            let own_cost = cost(&other, *record);
            if own_cost < *least {
                *least = own_cost;
                for g in (0..held.globals.len()).filter(|g| held.globals[*g].record == Some(*record)) {
                    best.globals[g] = other.point.globals[g];
                }
                for (k, _) in own.segments.iter().enumerate().filter(|(_, s)| s.record == *record) {
                    best.locals[k].clone_from(&other.point.locals[k]);
                }
            }
        }
    }
    Some((held, best))
}

fn is_phase(problem: &Problem, global: usize) -> bool {
    problem.machine.slots[problem.globals[global].slot].path.ends_with("phase_deg")
}

/// Mean, on the circle, of a phase in the records to which it was fitted; None: there are none, or they lie all round.
fn mean_phase(problem: &Problem, found: &Fit, slot: usize) -> Option<f64> {
    let is_fitted = |record: usize| problem.data.segments.iter().any(|s| s.record == record && s.judge_from > 0);
    let globals = problem.globals.iter().zip(&found.point.globals);
    let fitted = globals.filter(|(g, _)| g.slot == slot && g.record.is_some_and(is_fitted));
    let (mut east, mut north, mut count) = (0.0, 0.0, 0.0);
    for (g, x) in fitted {
        let phase = g.law.value(*x);
        east += libm::cos(phase);
        north += libm::sin(phase);
        count += 1.0;
    }
    (count > 0.0 && libm::hypot(east, north) > 0.5 * count).then(|| libm::atan2(north, east))
}

/// Unweighted residuals of the fitted data, channel by channel and segment by segment, from those of a fit.
pub fn fitted_residuals(problem: &Problem, residuals: &[Vec<f64>]) -> Vec<Vec<Vec<f64>>> {
    let of = |c: usize| {
        let fits = problem.data.segments.iter().zip(residuals).filter(|(s, _)| s.judge_from > 0);
        let part = |(s, r): (&RecordSegment, &Vec<f64>)| {
            let known = (0..s.judge_from).filter(|i| s.measured[c][*i].is_finite());
            known.map(|i| r[c * s.judge_from + i] * problem.weights[c]).collect()
        };
        fits.map(part).collect()
    };
    (0..problem.channels.len()).map(of).collect()
}

/// Geometric mean over channels of the root mean square. Units cancel in ratios of it.
pub fn mean_error(channels: &[Vec<Vec<f64>>]) -> f64 {
    let sum: f64 = channels.iter().map(|parts| libm::log(stats::rms(parts).max(1e-300))).sum();
    libm::exp(sum / channels.len().max(1) as f64)
}

/// Effective number of samples of every channel.
pub fn effective(channels: &[Vec<Vec<f64>>]) -> Vec<f64> {
    channels.iter().map(|p| stats::effective(p)).collect()
}

/// Twice the negative log-likelihood of all channels, each with its own variance, for the given effective number of
/// samples.
pub fn deviance(channels: &[Vec<Vec<f64>>], effective: &[f64]) -> f64 {
    deviance_above(channels, effective, |_| 0.0)
}

/// The same, where errors below `least` of a channel count as much as that: they are those of the integration, and tell nothing.
pub fn deviance_above(channels: &[Vec<Vec<f64>>], effective: &[f64], least: impl Fn(usize) -> f64) -> f64 {
    let of = |(c, (parts, n)): (usize, (&Vec<Vec<f64>>, &f64))| {
        2.0 * n * libm::log(stats::rms(parts).max(least(c)).max(1e-300))
    };
    channels.iter().zip(effective).enumerate().map(of).sum()
}

/// Residuals of fitted and held-out data.
pub fn residuals(problem: &Problem, found: &Fit, own: &Data, threads: usize) -> Residuals {
    let n = problem.channels.len();
    let mut out = Residuals { fit: vec![Vec::new(); n], judge: vec![Vec::new(); n], ..Residuals::default() };
    let mut take = |record: usize, measured: &[Vec<f64>], model: &[Vec<f64>], judge_from: usize| {
        if judge_from > 0 {
            out.fit_record.push(record);
        }
        if measured.first().is_some_and(|m| judge_from < m.len()) {
            out.judge_record.push(record);
        }
        for c in 0..n {
            let all = |a: usize, b: usize| differences(&measured[c], model.get(c), a..b);
            if judge_from > 0 {
                out.fit[c].push(all(0, judge_from));
            }
            if judge_from < measured[c].len() {
                out.judge[c].push(all(judge_from, measured[c].len()));
            }
        }
    };
    for (k, s) in problem.data.segments.iter().enumerate().filter(|(_, s)| s.judge_from > 0) {
        let model = problem.model(k, &found.point.globals, &found.point.locals[k], false);
        let model = model.unwrap_or_else(|_| diverged_output(s.measured.len(), s.len()));
        take(s.record, &s.measured, &model, s.judge_from);
    }
    for (s, model) in own.segments.iter().zip(held_out_models(problem, found, own, threads)) {
        take(s.record, &s.measured, &model, 0);
    }
    out
}

/// Model output in the held-out segments, after a fit of their local parameters.
fn held_out_models(problem: &Problem, found: &Fit, own: &Data, threads: usize) -> Vec<Vec<Vec<f64>>> {
    let Some((held, point)) = fit_held_out(problem, found, own, threads) else { return Vec::new() };
    let model = |(k, s): (usize, &RecordSegment)| {
        let model = held.model(k, &point.globals, &point.locals[k], false);
        model.unwrap_or_else(|_| diverged_output(s.measured.len(), s.len()))
    };
    own.segments.iter().enumerate().map(model).collect()
}

/// Residuals of the held-out segments, channel by channel and segment by segment.
pub fn held_out_residuals(problem: &Problem, found: &Fit, own: &Data, threads: usize) -> Vec<Vec<Vec<f64>>> {
    let models = held_out_models(problem, found, own, threads);
    let parts = |c: usize| {
        let all = own.segments.iter().zip(&models);
        all.map(|(s, m)| differences(&s.measured[c], m.get(c), 0..s.len())).collect()
    };
    (0..problem.channels.len()).map(parts).collect()
}

/// Model minus measurement where both are known.
fn differences(measured: &[f64], model: Option<&Vec<f64>>, samples: std::ops::Range<usize>) -> Vec<f64> {
    let of = |i: usize| model.and_then(|m| m.get(i)).map_or(f64::NAN, |m| m - measured[i]);
    (samples.start..samples.end.min(measured.len())).map(of).filter(|r| r.is_finite()).collect()
}

/// Output of a model that ran away: large values, so that it explains nothing.
fn diverged_output(channels: usize, samples: usize) -> Vec<Vec<f64>> {
    vec![vec![1e6; samples]; channels]
}

impl Residuals {
    /// Root mean square of a channel on fitted data, and on held-out data.
    pub fn rms(&self, channel: usize) -> (f64, f64) {
        (stats::rms(&self.fit[channel]), stats::rms(&self.judge[channel]))
    }

    /// Ratio of the held-out errors for the channel that gains most. An effect that only one of many sensors shows thus
    /// counts as much as one that all show.
    pub fn best_ratio(&self, before: &Residuals) -> f64 {
        let of = |c: usize| stats::rms(&self.judge[c]) / stats::rms(&before.judge[c]).max(1e-300);
        let judged = (0..self.judge.len()).filter(|c| before.judge[*c].iter().any(|p| !p.is_empty()));
        let best = judged.map(of).fold(f64::INFINITY, f64::min);
        if best.is_finite() { best } else { 1.0 }
    }

    /// Ratio of the held-out errors of all channels together (each scaled by the other model's error), with its
    /// interval.
    pub fn judge_ratio(&self, before: &Residuals) -> [f64; 3] {
        let scaled = |r: &Residuals| -> Vec<Vec<f64>> {
            let mut all = Vec::new();
            for (c, parts) in r.judge.iter().enumerate() {
                let size = stats::rms(&before.judge[c]).max(1e-300);
                all.extend(parts.iter().map(|p| p.iter().map(|x| x / size).collect::<Vec<f64>>()));
            }
            all
        };
        stats::ratio(&scaled(self), &scaled(before))
    }
}
