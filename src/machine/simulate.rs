//! Running a lumped machine: classical Runge-Kutta of fourth order at a fixed step, sensors read at every node.
//!
//! The step divides the time between two samples; it is the largest that resolves the fastest oscillation by 30 steps and keeps
//! every friction slope stable, found from the machine's numbers before the run. Pulses are counted where the cubic between two
//! nodes (values and slopes) crosses a mark; its error is of the order of the scheme.

use super::{Body, InputKind, Machine, Motion, Placed, Reads, Target};
use crate::effects::{BodyAt, BodyLaw, ChainAt, ChainTorqueLaw, Kind, MarkLaw, MotionLaw, Physics, SpanAt, Trace};
use std::f64::consts::PI;

/// What is asked of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// Values at these times, which start at 0 and grow [s]; `step_s` is their (mean) distance.
    Times { t_s: Vec<f64>, step_s: f64, even: bool },
    /// So many intervals between pulses, from mark `first` on; the shortest and the longest that was measured [s].
    Pulses { intervals: usize, first: usize, interval_s: f64, longest_s: f64 },
}

/// One stretch of time to be run.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    pub samples: Samples,
    /// One series for every input of the machine, at the times of the samples.
    pub inputs: Vec<Vec<f64>>,
    /// Inputs stay at a value until the next one; else straight lines.
    pub hold: bool,
}

/// Why a run broke off.
#[derive(Clone, Debug, PartialEq)]
pub enum RunError {
    /// Not finite at this time [s].
    Diverged { t_s: f64 },
    /// The next pulse never came.
    NoPulse { t_s: f64, pulses: usize },
    /// It would take so many steps for one sample.
    Stiff { steps: f64 },
}

impl std::fmt::Display for RunError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RunError::Diverged { t_s } => write!(f, "the model diverges at {t_s:.4} s"),
            RunError::NoPulse { t_s, pulses } => {
                write!(f, "the model stands still after {pulses} pulses at {t_s:.4} s")
            }
            RunError::Stiff { steps } => {
                write!(f, "the model is so stiff that it needs {steps:.0} steps for one sample")
            }
        }
    }
}

/// Most steps for one sample, unless a caller wants fewer.
pub const MOST_STEPS: f64 = 300.0;

/// Start of a run: angle or position and speed of every body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Start {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
}

/// A machine with its numbers, made ready to run.
struct Ready<'a> {
    m: &'a Machine,
    values: &'a [f64],
    inertia: Vec<f64>,
    /// Stiffness and damping of every spring.
    springs: Vec<(f64, f64)>,
    /// Effects on bodies, springs: kept apart by what they act on.
    on_body: Vec<(usize, BodyLaw, Vec<f64>)>,
    on_spring: Vec<Vec<OnSpring>>,
    motion: Vec<(usize, MotionLaw, Vec<f64>)>,
    chain_torque: Vec<(ChainTorqueLaw, Vec<f64>)>,
    leader_teeth: f64,
    most_steps: f64,
    /// The body that stands for each: a second body of no inertia is the one it hangs on.
    stands_for: Vec<usize>,
}

enum OnSpring {
    Length { body: usize, teeth: u32, law: fn(&[f64], u32, f64) -> (f64, f64), p: Vec<f64> },
    Chain { law: fn(&[f64], ChainAt) -> (f64, f64), p: Vec<f64> },
    Force { law: fn(&[f64], SpanAt) -> f64, p: Vec<f64> },
    Loss { law: fn(&[f64], f64, f64) -> f64, p: Vec<f64> },
}

/// What acts at a node, filled by `Ready::forces`.
#[derive(Default)]
struct Acting {
    force: Vec<f64>,
    tension: Vec<f64>,
    slopes: Vec<(usize, f64)>,
}

impl<'a> Ready<'a> {
    fn new(m: &'a Machine, values: &'a [f64]) -> Ready<'a> {
        let of = |p: &Placed| p.slots.iter().map(|s| values[*s]).collect::<Vec<f64>>();
        let mut ready = Ready {
            m,
            values,
            inertia: m.bodies.iter().map(|b| inertia(b, values)).collect(),
            springs: m.springs.iter().map(|s| m.spring_numbers(values, s)).collect(),
            on_body: Vec::new(),
            on_spring: m.springs.iter().map(|_| Vec::new()).collect(),
            motion: Vec::new(),
            chain_torque: Vec::new(),
            leader_teeth: m.chain.as_ref().and_then(|c| m.bodies[c.leader].teeth).map_or(0.0, f64::from),
            most_steps: MOST_STEPS,
            stands_for: (0..m.bodies.len()).collect(),
        };
        for spring in m.springs.iter().filter(|s| s.tuned.is_some_and(|slot| values[slot] == 0.0)) {
            if let [near, far] = spring.ends.as_slice() {
                ready.stands_for[far.body] = near.body;
            }
        }
        for p in &m.placed {
            match (p.effect.physics, p.target) {
                (Physics::BodyForce(law), Target::Body(b)) => ready.on_body.push((b, law, of(p))),
                (Physics::Motion(law), Target::Body(b)) => ready.motion.push((b, law, of(p))),
                (Physics::SpanForce(law), Target::Spring(s)) => {
                    ready.on_spring[s].push(OnSpring::Force { law, p: of(p) });
                }
                (Physics::SpanLength(law), Target::Body(body)) => {
                    let teeth = m.bodies[body].teeth.unwrap_or(1);
                    for (s, spring) in m.springs.iter().enumerate() {
                        if spring.ends.iter().any(|e| e.body == body) {
                            ready.on_spring[s].push(OnSpring::Length { body, teeth, law, p: of(p) });
                        }
                    }
                }
                (Physics::ChainLength(law), Target::Chain) => {
                    for (s, _) in m.springs.iter().enumerate().filter(|(_, s)| s.links.is_some()) {
                        ready.on_spring[s].push(OnSpring::Chain { law, p: of(p) });
                    }
                }
                (Physics::SpanLoss(law), Target::Chain) => {
                    for on in &mut ready.on_spring {
                        on.push(OnSpring::Loss { law, p: of(p) });
                    }
                }
                (Physics::ChainTorque(law), Target::Chain) => ready.chain_torque.push((law, of(p))),
                _ => {}
            }
        }
        ready
    }

    fn chain_at(&self, spring: usize, q: &[f64]) -> ChainAt {
        let (from, to) = self.m.springs[spring].links.unwrap_or((0.0, 0.0));
        let (links, leader) = self.m.chain.as_ref().map_or((1.0, 0), |c| (f64::from(c.links), c.leader));
        ChainAt { travel: q[leader] * self.leader_teeth / (2.0 * PI), links, from, to }
    }

    /// Forces on all bodies from everything but inputs.
    fn forces(&self, q: &[f64], v: &[f64], out: &mut Acting) {
        out.force.clear();
        out.force.resize(q.len(), 0.0);
        out.tension.clear();
        let force = &mut out.force;
        for (body, law, p) in &self.on_body {
            force[*body] += law(p, BodyAt { q: q[*body], v: v[*body] });
        }
        for (s, spring) in self.m.springs.iter().enumerate() {
            let (mut stretch, mut rate) = (0.0, 0.0);
            // Slopes of the length by the bodies' coordinates, beyond the gains.
            out.slopes.clear();
            for e in &spring.ends {
                let gain = f64::from(e.sign) * self.values[e.gain];
                stretch += gain * q[e.body];
                rate += gain * v[e.body];
            }
            for on in &self.on_spring[s] {
                let (body, (length, slope)) = match on {
                    OnSpring::Length { body, teeth, law, p } => (*body, law(p, *teeth, q[*body])),
                    OnSpring::Chain { law, p } => {
                        let leader = self.m.chain.as_ref().map_or(0, |c| c.leader);
                        let (length, slope) = law(p, self.chain_at(s, q));
                        (leader, (length, slope * self.leader_teeth / (2.0 * PI)))
                    }
                    _ => continue,
                };
                stretch += length;
                rate += slope * v[body];
                out.slopes.push((body, slope));
            }
            let (k, c) = self.springs[s];
            let declared = k * stretch + c * rate;
            let mut tension = declared;
            for on in &self.on_spring[s] {
                if let OnSpring::Force { law, p } = on {
                    tension += law(p, SpanAt { stretch, rate, stiffness: k, force: tension });
                }
            }
            for e in &spring.ends {
                force[e.body] -= f64::from(e.sign) * self.values[e.gain] * tension;
            }
            for (body, slope) in &out.slopes {
                force[*body] -= slope * tension;
            }
            for on in &self.on_spring[s] {
                if let OnSpring::Loss { law, p } = on {
                    for e in &spring.ends {
                        force[e.body] += law(p, tension, v[e.body]);
                    }
                }
            }
            for (law, p) in &self.chain_torque {
                if spring.links.is_some() {
                    let at = self.chain_at(s, q);
                    for e in &spring.ends {
                        // Both ends feel the joint bend; each half of it here.
                        force[e.body] += 0.5 * law(p, at, v[e.body]);
                    }
                }
            }
            out.tension.push(tension);
        }
    }

    /// Highest order at which an effect comes back by angle.
    fn highest_order(&self) -> Option<f64> {
        let mut highest: Option<f64> = None;
        // What is off needs no steps.
        let on = |p: &Placed| {
            let rows = p.effect.parameters.iter().zip(&p.slots);
            rows.into_iter().any(|(r, s)| r.kind == Kind::Amplitude && self.values[*s] != r.off * r.unit)
        };
        for p in self.m.placed.iter().filter(|p| on(p)) {
            let order = match p.effect.physics {
                Physics::SpanLength(_) if p.effect.name == "sprocket_runout" => 1.0,
                Physics::SpanLength(_) if p.effect.name == "tooth_pitch_error" => {
                    p.slots.get(2).map_or(1.0, |s| self.values[*s])
                }
                Physics::SpanLength(_) | Physics::ChainLength(_) | Physics::ChainTorque(_) => {
                    self.m.bodies.iter().filter_map(|b| b.teeth).max().map_or(1.0, f64::from)
                }
                Physics::BodyForce(_) if matches!(p.effect.name, "torque_ripple" | "unbalance") => {
                    p.slots.get(2).map_or(1.0, |s| self.values[*s])
                }
                _ => continue,
            };
            highest = Some(highest.map_or(order, |h: f64| h.max(order)));
        }
        highest
    }

    /// Fastest angular frequency, and the largest slope of a force over speed by inertia [rad/s, 1/s].
    fn rates(&self, speed: &[f64], turns: bool) -> (f64, f64) {
        let mut omega2 = vec![0.0_f64; self.m.bodies.len()];
        let mut rate = vec![0.0_f64; self.m.bodies.len()];
        for (s, spring) in self.m.springs.iter().enumerate() {
            let (mut k, mut c) = self.springs[s];
            for on in &self.on_spring[s] {
                if let OnSpring::Force { law, p } = on {
                    let at = |stretch, rate| SpanAt { stretch, rate, stiffness: 0.0, force: 0.0 };
                    k += law(p, at(1e-6, 0.0)).abs() / 1e-6;
                    c += law(p, at(0.0, 1e-6)).abs() / 1e-6;
                }
            }
            for e in &spring.ends {
                let g2 = self.values[e.gain] * self.values[e.gain];
                omega2[e.body] += g2 * k / self.inertia[e.body];
                rate[e.body] += g2 * c / self.inertia[e.body];
            }
        }
        for (body, law, p) in &self.on_body {
            let top = speed[*body].abs().max(1e-9);
            let d = 1e-6 * top;
            let slope =
                |v: f64| (law(p, BodyAt { q: 0.0, v: v + d }) - law(p, BodyAt { q: 0.0, v: v - d })).abs() / (2.0 * d);
            // What turns past marks never comes to rest.
            let least = if turns { 0.3 * top } else { 0.0 };
            rate[*body] +=
                [least, 0.5 * (least + top), top].map(slope).into_iter().fold(0.0, f64::max) / self.inertia[*body];
        }
        let free = |i: usize| self.m.bodies[i].motion == Motion::Free;
        let most = |of: &[f64]| (0..of.len()).filter(|i| free(*i)).map(|i| of[i]).fold(0.0, f64::max);
        // Two bodies on one spring swing by at most the sum of both squares.
        (libm::sqrt(2.0 * most(&omega2)), 2.0 * most(&rate))
    }
}

fn inertia(body: &Body, values: &[f64]) -> f64 {
    let whole = values[body.inertia];
    match body.minus {
        // What is left of a body that was split: never nothing.
        Some(far) => (whole - values[far]).max(1e-3 * whole),
        // A second body of no inertia feels no force; it must not divide by zero.
        None => whole.max(1e-300),
    }
}

/// Runs a machine and returns one series for every channel (index of a sensor), at the samples; pulses: ln of the intervals.
pub fn run(
    m: &Machine,
    values: &[f64],
    task: &Task,
    start: &Start,
    channels: &[usize],
    most_steps: f64,
) -> Result<Vec<Vec<f64>>, RunError> {
    let ready = Ready { most_steps, ..Ready::new(m, values) };
    match &task.samples {
        Samples::Pulses { intervals, first, interval_s, longest_s } => {
            pulses(&ready, start, (*intervals, *first), (*interval_s, *longest_s), channels)
        }
        Samples::Times { t_s, step_s, even } => sampled(&ready, task, start, (t_s, *step_s, *even), channels),
    }
}

/// Steps that a sample of this task needs with these numbers.
pub fn steps_needed(m: &Machine, values: &[f64], task: &Task, start: &Start) -> f64 {
    match &task.samples {
        Samples::Times { step_s, .. } => {
            let (omega, rate) = Ready::new(m, values).rates(&start.v, false);
            (step_s * omega / 0.2).max(step_s * rate / 2.0).max(1.0)
        }
        Samples::Pulses { .. } => 1.0,
    }
}

/// Steps that a sample needs.
fn steps_per_sample(ready: &Ready, step_s: f64, speed: &[f64]) -> Result<usize, RunError> {
    let (omega, rate) = ready.rates(speed, false);
    // Ten steps for a wave of the highest order at the highest speed that is known.
    let top = speed.iter().fold(0.0_f64, |top, v| top.max(v.abs()));
    let waves = ready.highest_order().map_or(0.0, |order| order * top / (2.0 * PI));
    let steps = libm::ceil((step_s * omega / 0.2).max(step_s * rate / 2.0).max(10.0 * step_s * waves)).max(1.0);
    if steps.is_finite() && steps <= ready.most_steps { Ok(steps as usize) } else { Err(RunError::Stiff { steps }) }
}

/// Sets prescribed speeds and forces of inputs at a stage (0, 1/2, 1), the coordinates given.
type Stage<'a> = &'a mut dyn FnMut(f64, &[f64], &mut [f64], &mut [f64]);

/// One step of the classical scheme; `at` gives forces of inputs and prescribed speeds at a stage (0, 1/2, 1).
fn rk4(ready: &Ready, q: &mut [f64], v: &mut [f64], h: f64, work: &mut Work, at: Stage) {
    let n = q.len();
    let free = &work.free;
    work.q.copy_from_slice(q);
    work.v.copy_from_slice(v);
    work.dq.fill(0.0);
    work.dv.fill(0.0);
    for (stage, (from, weight)) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)].into_iter().enumerate() {
        work.input.fill(0.0);
        at(from, &work.q, &mut work.v, &mut work.input);
        ready.forces(&work.q, &work.v, &mut work.acting);
        if stage == 0 {
            work.at_node.clear();
            work.at_node.extend_from_slice(&work.acting.force);
            work.at_node.iter_mut().zip(&work.input).for_each(|(f, u)| *f += u);
            work.tension_at_node.clear();
            work.tension_at_node.extend_from_slice(&work.acting.tension);
            work.v_at_node.copy_from_slice(&work.v);
        }
        let next = [0.5, 0.5, 1.0, 0.0][stage];
        for i in 0..n {
            let a = if free[i] { (work.acting.force[i] + work.input[i]) / ready.inertia[i] } else { 0.0 };
            let speed = work.v[i];
            work.dq[i] += weight * speed;
            work.dv[i] += weight * a;
            work.q[i] = q[i] + next * h * speed;
            if free[i] {
                work.v[i] = v[i] + next * h * a;
            }
        }
    }
    for i in 0..n {
        q[i] += h / 6.0 * work.dq[i];
        if free[i] {
            v[i] += h / 6.0 * work.dv[i];
        }
    }
}

struct Work {
    free: Vec<bool>,
    q: Vec<f64>,
    v: Vec<f64>,
    dq: Vec<f64>,
    dv: Vec<f64>,
    input: Vec<f64>,
    acting: Acting,
    /// At the start of the step: force of each body, tension of each spring, speed.
    at_node: Vec<f64>,
    tension_at_node: Vec<f64>,
    v_at_node: Vec<f64>,
}

impl Work {
    fn new(m: &Machine) -> Work {
        let n = m.bodies.len();
        let zero = || vec![0.0; n];
        Work {
            free: m.bodies.iter().map(|b| b.motion == Motion::Free).collect(),
            q: zero(),
            v: zero(),
            dq: zero(),
            dv: zero(),
            input: zero(),
            acting: Acting::default(),
            at_node: zero(),
            tension_at_node: Vec::new(),
            v_at_node: zero(),
        }
    }
}

/// A run with samples at given times.
fn sampled(
    ready: &Ready,
    task: &Task,
    start: &Start,
    (t_s, step_s, even): (&[f64], f64, bool),
    channels: &[usize],
) -> Result<Vec<Vec<f64>>, RunError> {
    let m = ready.m;
    let mut top: Vec<f64> = start.v.iter().map(|v| v.abs().max(1e-3)).collect();
    for (input, series) in m.inputs.iter().zip(&task.inputs).filter(|(i, _)| i.kind == InputKind::Speed) {
        top[input.body] = series.iter().fold(top[input.body], |t, v| t.max(v.abs()));
    }
    let parts = steps_per_sample(ready, step_s, &top)?;
    let h = step_s / parts as f64;
    let span = t_s.last().copied().unwrap_or(0.0);
    let n_steps = if even { (t_s.len() - 1) * parts } else { libm::ceil(span / h - 1e-9) as usize };
    let inputs = inputs_at_nodes(ready, task, (t_s, even, parts), h, n_steps);
    let smooth = |k: usize| {
        !task.hold
            || m.placed.iter().any(|p| p.target == Target::Input(k) && p.effect.name == "input_lag")
            || !matches!(m.inputs[k].kind, InputKind::Force(_))
    };
    let smooth: Vec<bool> = (0..m.inputs.len()).map(smooth).collect();
    let slopes: Vec<Vec<f64>> = m
        .inputs
        .iter()
        .zip(&inputs)
        .map(|(i, u)| if i.kind == InputKind::Angle { derivative(u, h) } else { Vec::new() })
        .collect();
    let (mut q, mut v) = (start.q.clone(), start.v.clone());
    let mut work = Work::new(m);
    let mut traces: Vec<Vec<f64>> = channels.iter().map(|_| Vec::with_capacity(n_steps + 1)).collect();
    let mut angles: Vec<Vec<f64>> = channels.iter().map(|_| Vec::with_capacity(n_steps + 1)).collect();
    let mut speeds: Vec<Vec<f64>> = channels.iter().map(|_| Vec::new()).collect();
    for step in 0..=n_steps {
        let q_before = q.clone();
        let at_step = step.min(n_steps.saturating_sub(1));
        let late = if step == n_steps && n_steps > 0 { 1.0 } else { 0.0 };
        let mut at = |stage: f64, q: &[f64], v: &mut [f64], force: &mut [f64]| {
            let x = stage + late;
            for (k, input) in m.inputs.iter().enumerate() {
                let series = if input.kind == InputKind::Angle { &slopes[k] } else { &inputs[k] };
                let last = series.len().saturating_sub(1);
                let a = series.get(at_step.min(last)).copied().unwrap_or(0.0);
                let b = series.get((at_step + 1).min(last)).copied().unwrap_or(a);
                let u = if smooth[k] {
                    a + (b - a) * x
                } else if x > 1.0 {
                    b
                } else {
                    a
                };
                match input.kind {
                    InputKind::Force(gain) => force[input.body] += ready.values[gain] * u,
                    InputKind::Speed | InputKind::Angle => v[input.body] = u,
                }
            }
            for (i, body) in m.bodies.iter().enumerate() {
                if let Motion::Constant(slot) = body.motion {
                    v[i] = ready.values[slot];
                }
            }
            for (body, law, p) in &ready.motion {
                v[*body] *= 1.0 + law(p, q[*body]);
            }
        };
        rk4(ready, &mut q, &mut v, h, &mut work, &mut at);
        for (c, channel) in channels.iter().enumerate() {
            let sensor = &m.sensors[*channel];
            let gain = ready.values[sensor.gain];
            let (value, body) = match sensor.reads {
                Reads::Angle(b) => (q_before[ready.stands_for[b]], ready.stands_for[b]),
                Reads::Speed(b) => (work.v_at_node[ready.stands_for[b]], ready.stands_for[b]),
                Reads::Acceleration(b) => {
                    let b = ready.stands_for[b];
                    (work.at_node[b] / ready.inertia[b], b)
                }
                Reads::Tension(s) => (work.tension_at_node[s], 0),
                Reads::Reaction(b) => (work.at_node[b], b),
                Reads::Pulses { body, .. } => (0.0, body),
            };
            traces[c].push(gain * value);
            angles[c].push(q_before[body]);
            if matches!(sensor.reads, Reads::Reaction(_)) {
                speeds[c].push(work.v_at_node[body]);
            }
        }
        if !q.iter().chain(v.iter()).all(|x| x.is_finite() && x.abs() < 1e12) {
            return Err(RunError::Diverged { t_s: step as f64 * h });
        }
    }
    let clock = clock(ready);
    Ok(channels
        .iter()
        .enumerate()
        .map(|(c, channel)| {
            if let Reads::Reaction(b) = m.sensors[*channel].reads {
                let gain = ready.values[m.sensors[*channel].gain];
                let acceleration = derivative(&speeds[c], h);
                for (value, a) in traces[c].iter_mut().zip(acceleration) {
                    *value = gain * ready.inertia[b] * a - *value;
                }
            }
            let trace = through_sensor(ready, *channel, std::mem::take(&mut traces[c]), &angles[c], h);
            if even && clock == 0.0 {
                (0..t_s.len()).map(|i| trace[i * parts]).collect()
            } else {
                t_s.iter().map(|t| between(&trace, t / (1.0 + clock) / h)).collect()
            }
        })
        .collect())
}

/// What the recorder's clock does to time.
fn clock(ready: &Ready) -> f64 {
    let mut clock = 0.0;
    for p in &ready.m.placed {
        if let Physics::Clock(law) = p.effect.physics {
            clock += law(&p.slots.iter().map(|s| ready.values[*s]).collect::<Vec<f64>>());
        }
    }
    clock
}

/// The signal after all effects of its sensor.
fn through_sensor(ready: &Ready, sensor: usize, mut values: Vec<f64>, angles: &[f64], h: f64) -> Vec<f64> {
    let derivative = match ready.m.sensors[sensor].reads {
        Reads::Angle(_) => 0,
        _ => 1,
    };
    for p in ready.m.placed.iter().filter(|p| p.target == Target::Sensor(sensor)) {
        if let Physics::Signal(law) = p.effect.physics {
            let numbers: Vec<f64> = p.slots.iter().map(|s| ready.values[*s]).collect();
            law(&numbers, &mut Trace { step_s: h, values: &mut values, angles, derivative });
        }
    }
    values
}

/// Inputs at the nodes of the integration, after their effects.
fn inputs_at_nodes(
    ready: &Ready,
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
                law(&numbers, &mut nodes, h);
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

/// The series at a place between its values: cubic through four of them.
fn between(series: &[f64], at: f64) -> f64 {
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
    -x * (x - 1.0) * (x - 2.0) / 6.0 * a + (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0 * b
        - (x + 1.0) * x * (x - 2.0) / 2.0 * c
        + (x + 1.0) * x * (x - 1.0) / 6.0 * d
}

/// A run that counts pulses; values are the natural logarithms of the intervals.
fn pulses(
    ready: &Ready,
    start: &Start,
    (intervals, first): (usize, usize),
    (interval_s, longest_s): (f64, f64),
    channels: &[usize],
) -> Result<Vec<Vec<f64>>, RunError> {
    let m = ready.m;
    let Some(sensor) = channels.first() else { return Ok(Vec::new()) };
    let Reads::Pulses { body, marks } = m.sensors[*sensor].reads else {
        return Ok(vec![vec![f64::NAN; intervals]]);
    };
    let body = ready.stands_for[body];
    let laws: Vec<(MarkLaw, Vec<f64>)> = m
        .placed
        .iter()
        .filter(|p| p.target == Target::Sensor(*sensor))
        .filter_map(|p| match p.effect.physics {
            Physics::Marks(law) => Some((law, p.slots.iter().map(|s| ready.values[*s]).collect())),
            _ => None,
        })
        .collect();
    // Place and delay of every mark.
    let table: Vec<(f64, f64)> = (0..marks)
        .map(|mark| laws.iter().map(|(law, p)| law(p, mark)).fold((0.0, 0.0), |(a, b), (c, d)| (a + c, b + d)))
        .collect();
    let gap = 2.0 * PI / marks as f64;
    let place = |k: usize| {
        let mark = (first + k) % marks;
        (gap * ((first + k) as f64 + table[mark].0), table[mark].1)
    };
    // As large as what the motion bears: a turn where nothing comes back by angle, else ten steps for a wave of the highest order.
    let turn_s = interval_s * marks as f64;
    let coarse = match ready.highest_order() {
        Some(order) => turn_s / (10.0 * order),
        None => turn_s,
    };
    let (omega, rate) = ready.rates(&start.v, true);
    let h = coarse.min(0.2 / omega.max(1e-300)).min(0.1 / rate.max(1e-300));
    if h < interval_s / ready.most_steps {
        return Err(RunError::Stiff { steps: interval_s / h });
    }
    let (mut q, mut v) = (start.q.clone(), start.v.clone());
    q[body] = place(0).0;
    let mut work = Work::new(m);
    let mut out = Vec::with_capacity(intervals);
    let clock = 1.0 + clock(ready);
    let (mut t, mut k) = (0.0_f64, 1);
    let mut before = place(0).1;
    let mut since = 0.0;
    let mut nothing = |_: f64, _: &[f64], v: &mut [f64], _: &mut [f64]| {
        for (i, b) in m.bodies.iter().enumerate() {
            if let Motion::Constant(slot) = b.motion {
                v[i] = ready.values[slot];
            }
        }
    };
    // Nearly at rest: the next pulse is far beyond any that was measured.
    let patience = 4.0 * longest_s.max(interval_s) + 2.0 * h;
    while out.len() < intervals {
        let (qa, va) = (q[body], v[body]);
        rk4(ready, &mut q, &mut v, h, &mut work, &mut nothing);
        let (qb, vb) = (q[body], v[body]);
        if !(qb.is_finite() && vb.is_finite()) {
            return Err(RunError::Diverged { t_s: t });
        }
        while out.len() < intervals && place(k).0 <= qb {
            let (target, delay) = place(k);
            let now = t + crossing(qa, va, qb, vb, h, target) + delay;
            out.push(libm::log(((now - before) * clock).max(1e-300)));
            before = now;
            k += 1;
            since = t;
        }
        t += h;
        if t - since > patience {
            return Err(RunError::NoPulse { t_s: t, pulses: out.len() });
        }
    }
    Ok(vec![out])
}

/// Time after a node at which the cubic through both nodes reaches `target` [s].
fn crossing(qa: f64, va: f64, qb: f64, vb: f64, h: f64, target: f64) -> f64 {
    let value = |x: f64| {
        let (x2, x3) = (x * x, x * x * x);
        qa * (2.0 * x3 - 3.0 * x2 + 1.0)
            + h * va * (x3 - 2.0 * x2 + x)
            + qb * (3.0 * x2 - 2.0 * x3)
            + h * vb * (x3 - x2)
    };
    let slope = |x: f64| {
        qa * (6.0 * x * x - 6.0 * x)
            + h * va * (3.0 * x * x - 4.0 * x + 1.0)
            + qb * (6.0 * x - 6.0 * x * x)
            + h * vb * (3.0 * x * x - 2.0 * x)
    };
    let (mut low, mut high) = (0.0, 1.0);
    let mut x = if qb > qa { ((target - qa) / (qb - qa)).clamp(0.0, 1.0) } else { 0.5 };
    // Newton within a bracket; quadratic, so few rounds end at rounding.
    for _ in 0..30 {
        let error = value(x) - target;
        if error > 0.0 {
            high = x;
        } else {
            low = x;
        }
        let newton = x - error / slope(x);
        if (newton - x).abs() < 1e-12 {
            return newton * h;
        }
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        x = next;
    }
    x * h
}
