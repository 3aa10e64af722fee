//! Short stretches of the records, each with an initial state of its own (multiple shooting, Bock 1981). A model that
//! lacks an effect may run away from a long record, for example into another gap of a cogging torque. Stretches too
//! short for that still show the effect. Their initial angles are the integrated measured speeds, so that effects that
//! follow angles keep their phase from stretch to stretch.

use super::problem::{Local, Point, Problem};
use crate::machine::simulate::Samples;
use crate::machine::{BodyMotion, InputKind, Machine, Reads};
use crate::measurement::segments::{Data, RecordSegment, first_guess};

/// Stretches per segment, provided that each has at least `SHORTEST` samples.
const STRETCHES: usize = 16;
const SHORTEST: usize = 24;

/// Start of a stretch: segment and sample.
pub type Begin = (usize, usize);

/// Splits the fitted segments into stretches of `together` shortest ones, and returns where each begins. None if the
/// channels do not determine the motion of all bodies.
pub fn split(problem: &Problem, together: usize) -> Option<(Data, Vec<Begin>)> {
    let (m, data) = (&problem.machine, problem.data);
    if problem.locals.iter().any(|l| matches!(l, Local::Slot { .. } | Local::Travel)) {
        return None;
    }
    let (mut stretches, mut begins) = (Vec::new(), Vec::new());
    for (k, s) in data.segments.iter().enumerate().filter(|(_, s)| s.judge_from > 0) {
        let Samples::Times { t_s, step_s, even } = &s.task.samples else { return None };
        let values = parameter_values(problem, k);
        let angles = angles((m, &values), data, s, t_s)?;
        let length = together * (s.judge_from / STRETCHES).max(SHORTEST);
        for i in 0..(s.judge_from / length).max(1) {
            let from = i * length;
            let to = if from + 2 * length > s.judge_from { s.judge_from } else { from + length };
            let mut part = s.clone();
            let own = |all: &Vec<f64>| all[from..to].to_vec();
            part.measured = s.measured.iter().map(own).collect();
            part.behind_s = s.behind_s.iter().map(|all| if all.is_empty() { Vec::new() } else { own(all) }).collect();
            part.task.inputs = s.task.inputs.iter().map(own).collect();
            part.task.start_s += t_s[from];
            let t_s = t_s[from..to].iter().map(|t| t - t_s[from]).collect();
            part.task.samples = Samples::Times { t_s, step_s: *step_s, even: *even };
            part.judge_from = to - from;
            part.at_rest = s.at_rest && i == 0;
            part.start = first_guess(m, &data.channels, &part.measured, *step_s, part.at_rest);
            if !part.at_rest {
                part.start.q = angles.iter().map(|q| q[from]).collect();
            }
            stretches.push(part);
            begins.push((k, from));
        }
    }
    Some((Data { segments: stretches, ..data.clone() }, begins))
}

/// The problem on stretches. In a group of bodies joined by springs without a fixed body or a measured angle, the first
/// body with a measured speed keeps its integrated angle; the angles of the others are free.
pub fn problem<'a>(whole: &Problem<'a>, data: &'a Data) -> Problem<'a> {
    let m = &whole.machine;
    let reads = |what: Reads| whole.channels.iter().any(|c| m.sensors[*c].reads == what);
    let mut group: Vec<usize> = (0..m.bodies.len()).collect();
    for s in &m.springs {
        let ends: Vec<usize> = s.ends.iter().map(|e| group[e.body]).collect();
        let first = ends.iter().copied().min().unwrap_or(0);
        group.iter_mut().filter(|g| ends.contains(g)).for_each(|g| *g = first);
    }
    let grounded = |g: usize| m.springs.iter().any(|s| matches!(s.ends.as_slice(), [end] if group[end.body] == g));
    let anchored = |g: usize| {
        let own = (0..m.bodies.len()).filter(|b| group[*b] == g);
        own.into_iter().any(|b| m.bodies[b].motion != BodyMotion::Free || reads(Reads::Angle(b))) || grounded(g)
    };
    let keeps = |b: usize| {
        let first = (0..m.bodies.len()).find(|o| group[*o] == group[b] && reads(Reads::Speed(*o)));
        !anchored(group[b]) && first == Some(b)
    };
    let mut problem = whole.clone();
    problem.data = data;
    problem.locals.retain(|l| !matches!(l, Local::Angle { body, .. } if keeps(*body)));
    problem
}

/// Locals of longer stretches or whole segments, taken from the short stretches that begin at the same sample.
pub fn joined(
    longer: (&Problem, &Point, &[Begin]),
    (short, found, begins): (&Problem, &Point, &[Begin]),
) -> Vec<Vec<f64>> {
    let (longer, point, own_begins) = longer;
    let mut locals = point.locals.clone();
    for (own, begin) in locals.iter_mut().zip(own_begins) {
        let Some(first) = begins.iter().position(|other| other == begin) else { continue };
        for (l, x) in longer.locals.iter().zip(own) {
            match (short.locals.iter().position(|other| other == l), l) {
                (Some(at), _) => *x = found.locals[first][at],
                (None, Local::Angle { body, scale }) => {
                    let q = &short.data.segments[first].start.q;
                    *x = q.get(*body).map_or(*x, |q| q / scale);
                }
                (None, _) => {}
            }
        }
    }
    locals
}

/// The machine's parameter values in a segment, with those of its record.
fn parameter_values(problem: &Problem, k: usize) -> Vec<f64> {
    let start = problem.start();
    problem.numbers(k, &start.globals, &start.locals[k]).0
}

/// Angle or position of every body at the samples of a segment, from measurements; None if one cannot be determined.
fn angles((m, values): (&Machine, &[f64]), data: &Data, s: &RecordSegment, t_s: &[f64]) -> Option<Vec<Vec<f64>>> {
    let mut known: Vec<Option<Vec<f64>>> = vec![None; m.bodies.len()];
    let summed = |speed: &mut dyn FnMut(usize) -> f64| -> Vec<f64> {
        let (mut q, mut before) = (0.0, speed(0));
        let step = |i: usize| {
            if i > 0 {
                let now = speed(i);
                q += 0.5 * (before + now) * (t_s[i] - t_s[i - 1]);
                before = now;
            }
            q
        };
        (0..t_s.len()).map(step).collect()
    };
    // Missing readings repeat the previous one.
    let filled = |c: usize, gain: f64| {
        let mut last = s.measured[c].iter().copied().find(|x| x.is_finite()).unwrap_or(0.0);
        let fill = |x: &f64| {
            last = if x.is_finite() { *x } else { last };
            last / gain
        };
        s.measured[c].iter().map(fill).collect::<Vec<f64>>()
    };
    for (c, channel) in data.channels.iter().enumerate() {
        let sensor = &m.sensors[channel.sensor];
        match sensor.reads {
            Reads::Angle(b) => known[b] = Some(filled(c, values[sensor.gain])),
            Reads::Speed(b) if known[b].is_none() => {
                let speeds = filled(c, values[sensor.gain]);
                known[b] = Some(summed(&mut |i| speeds[i]));
            }
            Reads::Speed(_)
            | Reads::Acceleration(_)
            | Reads::Pulses { .. }
            | Reads::Tension(_)
            | Reads::Reaction(_)
            | Reads::Part(_) => {}
        }
    }
    for (input, series) in m.inputs.iter().zip(&s.task.inputs) {
        match input.kind {
            InputKind::Speed => known[input.body] = Some(summed(&mut |i| series[i])),
            InputKind::Angle => known[input.body] = Some(series.clone()),
            InputKind::Force(_) | InputKind::Acceleration => {}
        }
    }
    for (b, body) in m.bodies.iter().enumerate() {
        if let BodyMotion::Constant(slot) = body.motion {
            known[b] = Some(t_s.iter().map(|t| values[slot] * (t - t_s[0])).collect());
        }
    }
    for _ in 0..m.bodies.len() {
        for spring in &m.springs {
            let [a, b] = spring.ends.as_slice() else { continue };
            for (from, to) in [(a, b), (b, a)] {
                if let (Some(q), None) = (&known[from.body], &known[to.body]) {
                    let ratio = values[from.gain] / values[to.gain];
                    known[to.body] = Some(q.iter().map(|q| q * ratio).collect());
                }
            }
        }
    }
    known.into_iter().collect()
}
