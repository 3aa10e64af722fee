//! Running a lumped machine: classical fourth-order Runge-Kutta at a fixed step, with sensors read at every node.
//!
//! The step divides the time between two samples. It is the largest one that resolves the fastest oscillation by 30
//! steps and keeps every friction slope stable. It is determined from the machine's parameters before the run. Where friction alone is
//! stiff, every sample takes the steps that it needs by itself, or implicit ones ([`super::rosenbrock`]).

use super::correction::{Correction, Observed};
use super::forces::{PreparedMachine, SpringForces};
use super::near_rest::NearRest;
use super::pulses::{self, pulses};
use super::{Body, BodyMotion, Input, InputKind, Machine, PlacedEffect, Reads, Target};
use crate::effects::{BodyAt, OwnClockLaw, Physics, Trace};
use std::f64::consts::PI;

/// Requested output of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// Values at these times, which start at 0 and increase [s]; `step_s` is their (mean) spacing.
    Times { t_s: Vec<f64>, step_s: f64, even: bool },
    /// A number of intervals between pulses, from mark `first` on; shortest and longest measured interval [s].
    Pulses { intervals: usize, first: usize, interval_s: f64, longest_s: f64 },
}

/// One time range to be simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    pub samples: Samples,
    /// One series for every input of the machine, at the times of the samples.
    pub inputs: Vec<Vec<f64>>,
    /// Inputs stay constant until the next value; otherwise they are interpolated linearly.
    pub hold: bool,
    /// Time since the start of the record at the first sample [s].
    pub start_s: f64,
}

/// Why a run stopped.
#[derive(Clone, Debug, PartialEq)]
pub enum RunError {
    /// Values were not finite at this time [s].
    Diverged { t_s: f64 },
    /// The next pulse never came.
    NoPulse { t_s: f64, pulses: usize },
    /// Number of steps per sample that the run would need.
    Stiff { steps: f64 },
    /// Why a drive with link bodies is not run with these numbers, or where it broke down.
    Refused { why: String },
}

impl std::fmt::Display for RunError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RunError::Diverged { t_s } => write!(f, "the model diverges at {t_s:.4} s"),
            RunError::NoPulse { t_s, pulses } => {
                write!(f, "the model stands still after {pulses} pulses at {t_s:.4} s")
            }
            RunError::Stiff { steps } => {
                write!(
                    f,
                    "the model is so stiff that it needs {} steps for one sample",
                    if *steps < 1e9 { format!("{steps:.0}") } else { format!("{steps:.1e}") }
                )
            }
            RunError::Refused { why } => f.write_str(why),
        }
    }
}

impl std::error::Error for RunError {}

/// Maximum number of steps per sample, unless the caller sets a lower limit.
pub const MAX_STEPS: f64 = 300.0;

/// Initial state of a run: angle or position and speed of every body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InitialState {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    /// For a drive with link bodies: pitches since its period began.
    pub travel: f64,
}

/// Runs a machine and returns one series for every channel (index of a sensor), at the samples; for pulses, ln of the
/// intervals.
pub fn run(
    m: &Machine,
    values: &[f64],
    task: &Task,
    start: &InitialState,
    channels: &[usize],
    max_steps: f64,
    observed: Option<Observed>,
) -> Result<Vec<Vec<f64>>, RunError> {
    let ready = PreparedMachine::new(m, values, max_steps);
    match &task.samples {
        Samples::Pulses { intervals, first, interval_s, longest_s } => {
            pulses(&ready, (start, task.start_s), (*intervals, *first), (*interval_s, *longest_s), channels)
        }
        Samples::Times { t_s, step_s, even } => {
            let times = (t_s.as_slice(), *step_s, *even);
            // A recorder whose clock errs shows later moments than a sample is corrected by.
            match observed.filter(|_| *even && clock(m, values) == 0.0) {
                None => Ok(sampled(&ready, task, start, times, channels, None)?.read_out(&ready, times, true)),
                Some(observed) => predicted(&ready, task, start, times, channels, observed),
            }
        }
    }
}

/// Steps that a sample of this task, or the shortest interval between pulses, needs with these values.
pub fn steps_needed(m: &Machine, values: &[f64], task: &Task, start: &InitialState) -> f64 {
    let ready = PreparedMachine::new(m, values, MAX_STEPS);
    match &task.samples {
        Samples::Times { step_s, .. } => steps(&ready, *step_s, &top_speeds(m, task, start), &top_loads(&ready, task)),
        Samples::Pulses { interval_s, .. } => {
            let marks = m.sensors.iter().find_map(|s| match s.reads {
                Reads::Pulses { marks, .. } => Some(marks),
                Reads::Angle(_)
                | Reads::Speed(_)
                | Reads::Acceleration(_)
                | Reads::Tension(_)
                | Reads::Reaction(_)
                | Reads::Part(_) => None,
            });
            interval_s / pulses::step_s(&ready, start, *interval_s, marks.unwrap_or(1))
        }
    }
}

/// Whether runs of this task take implicit steps near rest, so that friction may be as sharp as it likes.
pub fn bears_sharp_friction(m: &Machine, values: &[f64], task: &Task) -> bool {
    let ready = PreparedMachine::new(m, values, MAX_STEPS);
    let is_even = matches!(task.samples, Samples::Times { even: true, .. });
    is_sparse(&ready, is_even, &[], f64::INFINITY) && !ready.has_states()
}

/// Largest speeds that are known before a run: initial speeds, and prescribed ones.
fn top_speeds(m: &Machine, task: &Task, start: &InitialState) -> Vec<f64> {
    let mut top: Vec<f64> = start.v.iter().map(|v| v.abs().max(1e-3)).collect();
    for (input, series) in m.inputs.iter().zip(&task.inputs).filter(|(i, _)| i.kind == InputKind::Speed) {
        top[input.body] = series.iter().fold(top[input.body], |t, v| t.max(v.abs()));
    }
    top
}

/// Largest force of each input [N, N m].
pub(super) fn top_loads(ready: &PreparedMachine, task: &Task) -> Vec<f64> {
    let of = |(input, series): (&Input, &Vec<f64>)| match input.kind {
        InputKind::Force(gain) => series.iter().fold(0.0_f64, |most, u| most.max((ready.values[gain] * u).abs())),
        InputKind::Speed | InputKind::Angle | InputKind::Acceleration => 0.0,
    };
    ready.m.inputs.iter().zip(&task.inputs).map(of).collect()
}

/// Steps per sample: 30 for the fastest oscillation, a stable number for friction, ten for a wave of the highest order.
fn steps(ready: &PreparedMachine, step_s: f64, top: &[f64], loads: &[f64]) -> f64 {
    let (omega, rate) = ready.rates(top, loads, false);
    let fastest = top.iter().copied().fold(0.0, f64::max);
    let waves = ready.highest_order().map_or(0.0, |order| order * fastest / (2.0 * PI));
    (step_s * omega / 0.2).max(step_s * rate / 2.0).max(10.0 * step_s * waves).max(1.0)
}

/// Sets prescribed speeds and input forces at a share of the way (Runge and Kutta's stages: 0, 1/2, 1), for the given coordinates.
pub(super) type Stage<'a> = &'a mut dyn FnMut(f64, &[f64], &mut [f64], &mut [f64]);

/// Forces of inputs and of all else on every body at the beginning of a step, where they are known.
pub(super) type AtBegin<'a> = Option<[&'a [f64]; 2]>;

/// One step of the classical scheme; `at` gives input forces and prescribed speeds at a stage (0, 1/2, 1).
pub(super) fn rk4(
    ready: &PreparedMachine,
    moving: (&mut [f64], &mut [f64], &mut [f64]),
    step: (f64, f64),
    work: &mut Rk4Buffers,
    (at, begin): (Stage, AtBegin),
) {
    // Most machines have few bodies: a known number of them takes half of the instructions.
    match moving.0.len() {
        1 => rk4_of::<1>(ready, moving, step, work, (at, begin)),
        2 => rk4_of::<2>(ready, moving, step, work, (at, begin)),
        3 => rk4_of::<3>(ready, moving, step, work, (at, begin)),
        _ => {
            let mut stage = std::mem::take(&mut work.stage);
            let [q, v, dq, dv, input, force] = &mut stage;
            rk4_body(ready, moving, step, work, [q, v, dq, dv, input, force], (at, begin));
            work.stage = stage;
        }
    }
}

fn rk4_of<const N: usize>(
    ready: &PreparedMachine,
    (q, v, z): (&mut [f64], &mut [f64], &mut [f64]),
    step: (f64, f64),
    work: &mut Rk4Buffers,
    forces: (Stage, AtBegin),
) {
    let (Some(q), Some(v)) = (q.first_chunk_mut::<N>(), v.first_chunk_mut::<N>()) else { return };
    let [mut a, mut b, mut c, mut d, mut e, mut f] = [[0.0; N]; 6];
    rk4_body(ready, (q, v, z), step, work, [&mut a, &mut b, &mut c, &mut d, &mut e, &mut f], forces);
}

/// `stage`: places, speeds, sums of their derivatives, input forces and forces.
#[inline(always)]
fn rk4_body(
    ready: &PreparedMachine,
    (q, v, z): (&mut [f64], &mut [f64], &mut [f64]),
    (t_s, h): (f64, f64),
    work: &mut Rk4Buffers,
    stage: [&mut [f64]; 6],
    (at, begin): (Stage, AtBegin),
) {
    let n = q.len();
    let [qs, vs, dq, dv, input, force] = stage;
    let free = &work.free[..n];
    qs.copy_from_slice(q);
    vs.copy_from_slice(v);
    dq.fill(0.0);
    dv.fill(0.0);
    for (stage, (from, weight)) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)].into_iter().enumerate() {
        match begin.filter(|_| stage == 0) {
            Some([inputs, others]) => {
                input.copy_from_slice(inputs);
                force.copy_from_slice(others);
            }
            None => {
                input.fill(0.0);
                at(from, qs, vs, input);
                ready.states_after(z, |b| qs[b] - q[b], &mut work.z);
                ready.forces_into((qs, vs, &work.z), t_s + from * h, force, &mut work.springs);
            }
        }
        if stage == 0 {
            for i in 0..n {
                work.at_node[i] = force[i] + input[i];
                work.v_at_node[i] = vs[i];
            }
            work.tension_at_node.clone_from(&work.springs.tension);
        }
        let next = [0.5, 0.5, 1.0, 0.0][stage];
        for i in 0..n {
            let a = if free[i] { (force[i] + input[i]) / ready.inertia[i] } else { 0.0 };
            let speed = vs[i];
            dq[i] += weight * speed;
            dv[i] += weight * a;
            qs[i] = q[i] + next * h * speed;
            if free[i] {
                vs[i] = v[i] + next * h * a;
            }
        }
    }
    if !z.is_empty() {
        ready.states_after(z, |b| h / 6.0 * dq[b], &mut work.z);
        z.copy_from_slice(&work.z);
    }
    for i in 0..n {
        q[i] += h / 6.0 * dq[i];
        if free[i] {
            v[i] += h / 6.0 * dv[i];
        }
    }
}

pub(super) struct Rk4Buffers {
    pub(super) free: Vec<bool>,
    /// What a stage works with where bodies are many.
    stage: [Vec<f64>; 6],
    /// Inner states at a stage.
    z: Vec<f64>,
    pub(super) springs: SpringForces,
    /// At the start of the step: force on each body, tension of each spring, speed.
    at_node: Vec<f64>,
    tension_at_node: Vec<f64>,
    v_at_node: Vec<f64>,
}

impl Rk4Buffers {
    pub(super) fn new(m: &Machine, states: usize) -> Rk4Buffers {
        let n = m.bodies.len();
        let zero = || vec![0.0; n];
        Rk4Buffers {
            free: m.bodies.iter().map(|b| b.motion == BodyMotion::Free).collect(),
            stage: std::array::from_fn(|_| zero()),
            z: vec![0.0; states],
            springs: SpringForces::default(),
            at_node: zero(),
            tension_at_node: Vec::new(),
            v_at_node: zero(),
        }
    }
}

/// Whether every sample takes the steps that it needs by itself: where friction is stiff near rest alone. Effects of inputs and sensors then
/// act at the samples, as they do where one step crosses a sample. Such an effect that is added changes nothing else of a run, so that a
/// small size of it shows.
fn is_sparse(ready: &PreparedMachine, even: bool, channels: &[usize], wanted: f64) -> bool {
    let m = ready.m;
    // The force at a prescribed motion takes differences between nodes.
    let is_reaction = |c: &usize| matches!(m.sensors[*c].reads, Reads::Reaction(_));
    let moves = m.inputs.iter().any(|i| !matches!(i.kind, InputKind::Force(_)));
    // With springs, the number of steps would change results in digits that the fit sees.
    let is_plain = m.springs.is_empty() && !moves && even && clock(m, ready.values) == 0.0;
    wanted >= LEAST_SPARSE && is_plain && !channels.iter().any(is_reaction)
}

/// Steps per sample from which samples take their own number.
const LEAST_SPARSE: f64 = 2.0;
/// Share by which a signal is made larger to see what the effects of its sensor let through, and what they let through at least.
const SMALL_SHARE: f64 = 1e-3;
const LEAST_SLOPE: f64 = 0.05;

/// A run that measured series correct. What the effects of a sensor do to its signal, found by a first run, is taken off what it measured.
fn predicted(
    ready: &PreparedMachine,
    task: &Task,
    start: &InitialState,
    times: (&[f64], f64, bool),
    channels: &[usize],
    observed: Observed,
) -> Result<Vec<Vec<f64>>, RunError> {
    let m = ready.m;
    let by_sensor = |p: &PlacedEffect| matches!(p.target, Target::Sensor(s) if observed.sensors.contains(&s));
    if !m.placed.iter().any(by_sensor) {
        return Ok(sampled(ready, task, start, times, channels, Some(observed))?.read_out(ready, times, true));
    }
    let first = sampled(ready, task, start, times, observed.sensors, Some(observed))?;
    let (plain, shown) = (first.read_out(ready, times, false), first.read_out(ready, times, true));
    let larger = first.scaled(1.0 + SMALL_SHARE).read_out(ready, times, true);
    let of = |(i, measured): (usize, &Vec<f64>)| -> Vec<f64> {
        let (plain, shown) = (&plain[i], &shown[i]);
        // The effects pass on a larger signal `slope` times as much larger. One step of Newton's method with it gives the signal that the effects
        // would show as the measured one.
        let grown: f64 =
            plain.iter().zip(shown.iter().zip(&larger[i])).map(|(p, (a, b))| p * (b - a) / SMALL_SHARE).sum();
        let whole: f64 = plain.iter().map(|p| p * p).sum();
        let slope = if grown > LEAST_SLOPE * whole { grown / whole } else { 1.0 };
        measured.iter().zip(plain.iter().zip(shown)).map(|(y, (plain, shown))| plain + (y - shown) / slope).collect()
    };
    let measured: Vec<Vec<f64>> = observed.measured.iter().enumerate().map(of).collect();
    let observed = Observed { measured: &measured, ..observed };
    Ok(sampled(ready, task, start, times, channels, Some(observed))?.read_out(ready, times, true))
}

/// What the channels read at the nodes of a run.
struct NodeReadings<'a> {
    channels: &'a [usize],
    traces: Vec<Vec<f64>>,
    angles: Vec<Vec<f64>>,
    /// Number of nodes that `traces` has for each sample, and the time between two nodes [s].
    parts: usize,
    h: f64,
    /// Time since the record began, at the first sample [s].
    start_s: f64,
}

impl NodeReadings<'_> {
    /// The same with larger readings.
    fn scaled(&self, by: f64) -> Self {
        let traces = self.traces.iter().map(|t| t.iter().map(|x| by * x).collect()).collect();
        NodeReadings { traces, angles: self.angles.clone(), ..*self }
    }

    /// Readings at the samples, after the effects of sensors and recorder or without them.
    fn read_out(&self, ready: &PreparedMachine, (t_s, _, even): (&[f64], f64, bool), sensed: bool) -> Vec<Vec<f64>> {
        let m = ready.m;
        let clock = if sensed { clock(m, ready.values) } else { 0.0 };
        let of = |(c, channel): (usize, &usize)| {
            let trace = match sensed {
                true => {
                    let (trace, times) = (self.traces[c].clone(), (Some(self.start_s), self.h));
                    through_sensor(m, ready.values, *channel, trace, &self.angles[c], times)
                }
                false => self.traces[c].clone(),
            };
            if even && clock == 0.0 {
                (0..t_s.len()).map(|i| trace[i * self.parts]).collect()
            } else {
                t_s.iter().map(|t| between(&trace, t / (1.0 + clock) / self.h)).collect()
            }
        };
        self.channels.iter().enumerate().map(of).collect()
    }
}

/// A run with samples at given times, which measured series may correct.
fn sampled<'a>(
    ready: &PreparedMachine,
    task: &Task,
    start: &InitialState,
    (t_s, step_s, even): (&[f64], f64, bool),
    channels: &'a [usize],
    observed: Option<Observed>,
) -> Result<NodeReadings<'a>, RunError> {
    let m = ready.m;
    let wanted = libm::ceil(steps(ready, step_s, &top_speeds(m, task, start), &top_loads(ready, task)));
    let sparse = is_sparse(ready, even, channels, wanted);
    let bears_all = sparse && !ready.has_states();
    if !(wanted.is_finite() && (bears_all || wanted <= ready.max_steps)) {
        return Err(RunError::Stiff { steps: wanted });
    }
    // Nodes between two samples, where inputs and sensors are looked at.
    let parts = m.refinement * if sparse { 1 } else { wanted as usize };
    let h = step_s / parts as f64;
    let span = t_s.last().copied().unwrap_or(0.0);
    let n_steps = if even { (t_s.len() - 1) * parts } else { libm::ceil(span / h - 1e-9) as usize };
    let inputs = inputs_at_nodes(ready, task, (t_s, even, parts), h, n_steps);
    let smooth = |k: usize| !task.hold || !matches!(m.inputs[k].kind, InputKind::Force(_));
    let smooth: Vec<bool> = (0..m.inputs.len()).map(smooth).collect();
    let slopes: Vec<Vec<f64>> = m
        .inputs
        .iter()
        .zip(&inputs)
        .map(|(i, u)| if i.kind == InputKind::Angle { derivative(u, h) } else { Vec::new() })
        .collect();
    let (mut q, mut v, mut z) = (start.q.clone(), start.v.clone(), ready.states());
    let mut q_before = q.clone();
    let mut work = Rk4Buffers::new(m, z.len());
    let [mut input_now, mut input_end, mut force_now] = [(); 3].map(|()| vec![0.0; q.len()]);
    let constant = |(i, b): (usize, &Body)| match b.motion {
        BodyMotion::Constant(slot) => Some((i, ready.values[slot])),
        BodyMotion::Free | BodyMotion::Measured(_) => None,
    };
    let constant: Vec<(usize, f64)> = m.bodies.iter().enumerate().filter_map(constant).collect();
    let prescribes = m.inputs.iter().any(|i| matches!(i.kind, InputKind::Speed | InputKind::Angle));
    let mut traces: Vec<Vec<f64>> = channels.iter().map(|_| Vec::with_capacity(n_steps + 1)).collect();
    let mut angles: Vec<Vec<f64>> = channels.iter().map(|_| Vec::with_capacity(n_steps + 1)).collect();
    let mut speeds: Vec<Vec<f64>> = channels.iter().map(|_| Vec::new()).collect();
    let mut correction = observed.map(|observed| Correction::new(ready, step_s, observed));
    let most = (!bears_all).then_some(wanted as usize);
    let mut near_rest = sparse.then(|| NearRest::new(ready, task, h, smooth.iter().any(|s| *s), most));
    // Begin and length of the present step, as shares of the way between two nodes.
    let share = std::cell::Cell::new((0.0, 1.0));
    for step in 0..=n_steps {
        let is_sample = step % parts == 0;
        let t = task.start_s + step as f64 * h;
        if let Some(correction) = correction.as_mut().filter(|_| is_sample) {
            correction.apply(ready, step / parts, step_s, &mut q, &mut v);
        }
        q_before.copy_from_slice(&q);
        let at_step = step.min(n_steps.saturating_sub(1));
        let is_end = step == n_steps && n_steps > 0;
        let input_at = |k: usize, stage: f64| {
            let series = if m.inputs[k].kind == InputKind::Angle { &slopes[k] } else { &inputs[k] };
            let last = series.len().saturating_sub(1);
            let a = series.get(at_step.min(last)).copied().unwrap_or(0.0);
            let b = series.get((at_step + 1).min(last)).copied().unwrap_or(a);
            let (begin, length) = share.get();
            if smooth[k] {
                a + (b - a) * if is_end { 1.0 + stage } else { begin + stage * length }
            } else if is_end {
                b
            } else {
                a
            }
        };
        let load = |k: usize| match m.inputs[k].kind {
            InputKind::Force(gain) => {
                let [begin, end] = [0.0, 1.0].map(|x| ready.values[gain] * input_at(k, x));
                if end.abs() > begin.abs() { end } else { begin }
            }
            InputKind::Speed | InputKind::Angle | InputKind::Acceleration => 0.0,
        };
        let mut at = |stage: f64, q: &[f64], v: &mut [f64], force: &mut [f64]| {
            if prescribes {
                for (k, input) in m.inputs.iter().enumerate() {
                    if let InputKind::Speed | InputKind::Angle = input.kind {
                        v[input.body] = input_at(k, stage);
                    }
                }
            }
            for (i, speed) in &constant {
                v[*i] = *speed;
            }
            for (body, law, p) in &ready.motion {
                v[*body] *= 1.0 + law(p, q[*body]);
            }
            for (k, input) in m.inputs.iter().enumerate() {
                if let InputKind::Force(gain) = input.kind {
                    let at = BodyAt { q: q[input.body], v: v[input.body] };
                    force[input.body] += ready.input_force(k, ready.values[gain] * input_at(k, stage), at);
                }
            }
        };
        share.set((0.0, 1.0));
        let mut steps_here = 1;
        if let Some(near_rest) = near_rest.as_mut().filter(|_| step < n_steps) {
            for (x, input) in [(0.0, &mut input_now), (1.0, &mut input_end)] {
                input.fill(0.0);
                at(x, &q, &mut v, input);
            }
            let forces = (force_now.as_mut_slice(), near_rest.rate.as_mut_slice(), &mut work.springs);
            let inputs = ([input_now.as_slice(), input_end.as_slice()], &load);
            let needed = ready.steps_of_sample((&q, &v, &z), (t, h), inputs, near_rest.order, forces);
            let reach = |i: usize| h * (force_now[i] + input_now[i]).abs() / ready.inertia[i];
            steps_here = near_rest.steps(needed, &v, reach);
        }
        if steps_here == 0 {
            for i in 0..q.len() {
                work.at_node[i] = force_now[i] + input_now[i];
                work.v_at_node[i] = v[i];
            }
        } else {
            share.set((0.0, 1.0 / steps_here as f64));
            let begin = near_rest.is_some().then_some([input_now.as_slice(), force_now.as_slice()]);
            let begin = begin.filter(|_| step < n_steps);
            rk4(ready, (&mut q, &mut v, &mut z), (t, h / steps_here as f64), &mut work, (&mut at, begin));
        }
        // Sensors show the state before its correction.
        let moved = |b: usize| {
            let of = correction.as_ref().filter(|_| is_sample);
            of.map_or((0.0, 0.0), |c| (c.moved.0[b], c.moved.1[b]))
        };
        for (c, channel) in channels.iter().enumerate() {
            let sensor = &m.sensors[*channel];
            let gain = ready.values[sensor.gain];
            let (value, body) = match sensor.reads {
                Reads::Angle(b) => {
                    let b = ready.stands_for[b];
                    (q_before[b] - moved(b).0, b)
                }
                Reads::Speed(b) => {
                    let b = ready.stands_for[b];
                    (work.v_at_node[b] - moved(b).1, b)
                }
                Reads::Acceleration(b) => {
                    let b = ready.stands_for[b];
                    (work.at_node[b] / ready.inertia[b], b)
                }
                Reads::Tension(s) => (work.tension_at_node[s], 0),
                Reads::Reaction(b) => (work.at_node[b], b),
                Reads::Pulses { body, .. } => (0.0, body),
                // Only for drives with link bodies.
                Reads::Part(_) => (f64::NAN, 0),
            };
            traces[c].push(gain * value);
            angles[c].push(q_before[body] - moved(body).0);
            if matches!(sensor.reads, Reads::Reaction(_)) {
                speeds[c].push(work.v_at_node[body]);
            }
        }
        for i in 1..steps_here {
            let length = 1.0 / steps_here as f64;
            share.set((i as f64 * length, length));
            rk4(ready, (&mut q, &mut v, &mut z), (t + i as f64 * h * length, h * length), &mut work, (&mut at, None));
        }
        if let Some(near_rest) = near_rest.as_mut().filter(|_| steps_here == 0) {
            let state = (q.as_mut_slice(), v.as_mut_slice(), z.as_mut_slice());
            near_rest
                .cross(ready, state, (t, h, &share), &mut work, (&mut at, &load), step)
                .map_err(|steps| RunError::Stiff { steps: (steps * parts) as f64 })?;
        }
        if !q.iter().chain(v.iter()).all(|x| x.is_finite() && x.abs() < 1e12) {
            return Err(RunError::Diverged { t_s: step as f64 * h });
        }
    }
    for (c, channel) in channels.iter().enumerate() {
        if let Reads::Reaction(b) = m.sensors[*channel].reads {
            let gain = ready.values[m.sensors[*channel].gain];
            let is_moved = ready.motion.iter().any(|(body, _, _)| *body == b);
            let given = m.inputs.iter().position(|i| i.body == b && i.kind == InputKind::Acceleration);
            let acceleration = match given.filter(|_| !is_moved) {
                Some(k) => inputs[k].clone(),
                None => derivative(&speeds[c], h),
            };
            for (value, a) in traces[c].iter_mut().zip(acceleration) {
                *value = gain * ready.inertia[b] * a - *value;
            }
        }
    }
    Ok(NodeReadings { channels, traces, angles, parts, h, start_s: task.start_s })
}

/// Relative error of the recorder's clock.
pub fn clock(m: &Machine, values: &[f64]) -> f64 {
    let mut clock = 0.0;
    for p in &m.placed {
        if let Physics::Clock(law) = p.effect.physics {
            clock += law(&p.slots.iter().map(|s| values[*s]).collect::<Vec<f64>>());
        }
    }
    clock
}

/// Laws of the clock by which a sensor is read, with their numbers.
pub(super) fn own_clocks(m: &Machine, numbers: &[f64], sensor: usize) -> Vec<(OwnClockLaw, Vec<f64>)> {
    let of = |p: &PlacedEffect| match (p.effect.physics, p.target == Target::Sensor(sensor)) {
        (Physics::OwnClock(law), true) => Some((law, p.slots.iter().map(|s| numbers[*s]).collect())),
        (_, _) => None,
    };
    m.placed.iter().filter_map(of).collect()
}

/// The signal after all effects of its sensor. The times are those of its first value, since the record began, and between two values [s]; without the
/// first, what reads the channel at the times of another clock is left out.
pub fn through_sensor(
    m: &Machine,
    numbers: &[f64],
    sensor: usize,
    mut values: Vec<f64>,
    angles: &[f64],
    (start_s, h): (Option<f64>, f64),
) -> Vec<f64> {
    let derivative = match m.sensors[sensor].reads {
        Reads::Angle(_) => 0,
        Reads::Speed(_)
        | Reads::Acceleration(_)
        | Reads::Pulses { .. }
        | Reads::Tension(_)
        | Reads::Reaction(_)
        | Reads::Part(_) => 1,
    };
    for p in m.placed.iter().filter(|p| p.target == Target::Sensor(sensor)) {
        if let Physics::Signal(law) = p.effect.physics {
            let numbers: Vec<f64> = p.slots.iter().map(|s| numbers[*s]).collect();
            law(&numbers, &mut Trace { step_s: h, values: &mut values, angles, derivative });
        }
    }
    let clocks = own_clocks(m, numbers, sensor);
    if let Some(start_s) = start_s.filter(|_| !clocks.is_empty()) {
        let ahead_s = |t_s: f64| clocks.iter().map(|(law, p)| law(p, t_s)).sum::<f64>();
        let at = |i: usize| i as f64 + ahead_s(start_s + i as f64 * h) / h;
        values = (0..values.len()).map(|i| read_at(&values, at(i))).collect();
    }
    values
}

/// Inputs at the integration nodes, after their effects.
fn inputs_at_nodes(
    ready: &PreparedMachine,
    task: &Task,
    (t_s, even, parts): (&[f64], bool, usize),
    h: f64,
    n_steps: usize,
) -> Vec<Vec<f64>> {
    let m = ready.m;
    let mut all = Vec::new();
    for (k, series) in task.inputs.iter().enumerate() {
        let hold = task.hold && matches!(m.inputs[k].kind, InputKind::Force(_));
        let mut cursor = 0;
        let mut nodes: Vec<f64> = (0..=n_steps)
            .map(|i| {
                if even {
                    let at = (i / parts).min(series.len() - 1);
                    let next = (at + 1).min(series.len() - 1);
                    let x = (i % parts) as f64 / parts as f64;
                    if hold { series[at] } else { series[at] + (series[next] - series[at]) * x }
                } else {
                    let t = i as f64 * h;
                    while cursor + 1 < t_s.len() && t_s[cursor + 1] <= t {
                        cursor += 1;
                    }
                    let next = (cursor + 1).min(t_s.len() - 1);
                    let width = (t_s[next] - t_s[cursor]).max(1e-300);
                    let x = ((t - t_s[cursor]) / width).clamp(0.0, 1.0);
                    if hold { series[cursor] } else { series[cursor] + (series[next] - series[cursor]) * x }
                }
            })
            .collect();
        for p in m.placed.iter().filter(|p| p.target == Target::Input(k)) {
            if let Physics::Input(law) = p.effect.physics {
                let numbers: Vec<f64> = p.slots.iter().map(|s| ready.values[*s]).collect();
                law(&numbers, &mut nodes, h, hold);
            }
        }
        all.push(nodes);
    }
    all
}

/// Central differences, one-sided at the ends.
fn derivative(series: &[f64], h: f64) -> Vec<f64> {
    let n = series.len();
    (0..n)
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n.saturating_sub(1)));
            if a == b { 0.0 } else { (series[b] - series[a]) / ((b - a) as f64 * h) }
        })
        .collect()
}

/// A series between its values. Beyond its last one it goes on for one value on the straight line through the last two, and then stays.
fn read_at(series: &[f64], at: f64) -> f64 {
    let beyond = (at - series.len().saturating_sub(1) as f64).min(1.0);
    match series {
        [.., before, last] if beyond > 0.0 => last + (last - before) * beyond,
        _ => between(series, at),
    }
}

/// Interpolates the series between its values: cubic through four of them.
pub fn between(series: &[f64], at: f64) -> f64 {
    let n = series.len();
    let last = n.saturating_sub(1) as f64;
    let at = at.clamp(0.0, last);
    let low = (libm::floor(at) as usize).min(n.saturating_sub(2));
    let x = at - low as f64;
    let value = |k: isize| series[(low as isize + k).clamp(0, n as isize - 1) as usize];
    if low == 0 || low + 2 >= n {
        return value(0) + (value(1) - value(0)) * x;
    }
    let (a, b, c, d) = (value(-1), value(0), value(1), value(2));
    cubic([a, b, c, d], x)
}

/// The cubic through values at -1, 0, 1 and 2, at x.
pub fn cubic([a, b, c, d]: [f64; 4], x: f64) -> f64 {
    -x * (x - 1.0) * (x - 2.0) / 6.0 * a + (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0 * b
        - (x + 1.0) * x * (x - 2.0) / 2.0 * c
        + (x + 1.0) * x * (x - 1.0) / 6.0 * d
}
