//! What is fitted: a machine, the parts of the records, the numbers that are free, and the residuals.
//!
//! Free numbers are of two kinds. Global ones belong to the drive, to all records or to one each (phases, numbers that a user
//! declares `per = "record"`). Local ones belong to one part of a record: where it starts, and numbers `per = "part"`.
//! Residuals are (model - measured) / weight of the channel; those of different parts do not share local numbers, so that the
//! fit solves for them part by part.

use crate::machine::simulate::{RunError, Samples, Start, run};
use crate::machine::{Machine, Motion, Reads};
use crate::measurement::segments::{Data, Segment};
use std::sync::atomic::{AtomicU64, Ordering};

/// A number that is free for all records, or for one.
#[derive(Clone, Debug, PartialEq)]
pub struct Global {
    pub slot: usize,
    /// None: for all records.
    pub record: Option<usize>,
    pub law: Law,
    /// Value and standard deviation from the nameplate, as the fit sees the number.
    pub prior: Option<(f64, f64)>,
}

/// A number that every part has for itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    Angle { body: usize, scale: f64 },
    Speed { body: usize, scale: f64 },
    Slot { slot: usize, law: Law },
}

/// How a number is seen by the fit: x = value / scale, or ln(value / scale).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    pub scale: f64,
    pub logarithm: bool,
    /// Bounds of the value.
    pub low: f64,
    pub high: f64,
}

impl Law {
    pub fn seen(&self, value: f64) -> f64 {
        if self.logarithm { libm::log((value / self.scale).max(1e-300)) } else { value / self.scale }
    }

    pub fn value(&self, x: f64) -> f64 {
        let value = if self.logarithm { self.scale * libm::exp(x.clamp(-600.0, 600.0)) } else { self.scale * x };
        value.clamp(self.low, self.high)
    }

    /// Bounds of x.
    pub fn bounds(&self) -> (f64, f64) {
        (self.seen(self.low), self.seen(self.high))
    }
}

/// A model with data, ready to be fitted.
#[derive(Clone, Debug)]
pub struct Problem<'a> {
    pub machine: Machine,
    pub data: &'a Data,
    pub channels: Vec<usize>,
    /// One for every channel: residuals are divided by it.
    pub weights: Vec<f64>,
    pub globals: Vec<Global>,
    pub locals: Vec<Local>,
    /// Steps for one sample beyond which a model counts as too stiff.
    pub most_steps: f64,
    /// Model runs so far.
    pub runs: &'a AtomicU64,
}

/// Where a fit stands: what it sees of the globals, and of every part's locals.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    pub globals: Vec<f64>,
    pub locals: Vec<Vec<f64>>,
}

/// Residual of a sample that a model did not reach.
const LOST: f64 = 1e6;

impl<'a> Problem<'a> {
    /// The start of all free numbers: the drive's own.
    pub fn start(&self) -> Point {
        Point {
            globals: self.globals.iter().map(|g| g.law.seen(self.machine.values[g.slot])).collect(),
            locals: self.data.segments.iter().map(|s| self.local_start(s)).collect(),
        }
    }

    fn local_start(&self, s: &Segment) -> Vec<f64> {
        self.locals
            .iter()
            .map(|l| match *l {
                Local::Angle { body, scale } => s.start.q[body] / scale,
                Local::Speed { body, scale } => s.start.v[body] / scale,
                Local::Slot { slot, law } => law.seen(self.machine.values[slot]),
            })
            .collect()
    }

    /// Globals that move this part.
    pub fn concerns(&self, global: usize, segment: usize) -> bool {
        self.globals[global].record.is_none_or(|r| r == self.data.segments[segment].record)
    }

    /// The machine's numbers, and the start, for a part.
    fn numbers(&self, segment: usize, globals: &[f64], locals: &[f64]) -> (Vec<f64>, Start) {
        let s = &self.data.segments[segment];
        let mut values = self.machine.values.clone();
        for (slot, value) in &self.data.set[s.record] {
            values[*slot] = *value;
        }
        for (g, x) in self.globals.iter().zip(globals) {
            if g.record.is_none_or(|r| r == s.record) {
                values[g.slot] = g.law.value(*x);
            }
        }
        // Bodies that effects add start with the body they hang on: they stand after the declared ones.
        let mut start = s.start.clone();
        for (l, x) in self.locals.iter().zip(locals) {
            match *l {
                Local::Angle { .. } | Local::Speed { .. } if s.at_rest => {}
                Local::Angle { body, scale } => start.q[body] = x * scale,
                Local::Speed { body, scale } => start.v[body] = x * scale,
                Local::Slot { slot, law } => values[slot] = law.value(*x),
            }
        }
        for spring in &self.machine.springs {
            if let [near, far] = spring.ends.as_slice()
                && far.body >= start.q.len()
            {
                let (q, v) = (start.q[near.body], start.v[near.body]);
                start.q.push(q);
                start.v.push(v);
            }
        }
        (values, start)
    }

    /// What the model shows in a part, channel by channel. With `fitting`, only as far as the part fits.
    pub fn model(
        &self,
        segment: usize,
        globals: &[f64],
        locals: &[f64],
        fitting: bool,
    ) -> Result<Vec<Vec<f64>>, RunError> {
        let s = &self.data.segments[segment];
        let (values, start) = self.numbers(segment, globals, locals);
        self.runs.fetch_add(1, Ordering::Relaxed);
        if fitting && s.judge_from < s.len() && s.judge_from > 0 {
            let mut task = s.task.clone();
            match &mut task.samples {
                Samples::Times { t_s, .. } => t_s.truncate(s.judge_from),
                Samples::Pulses { intervals, .. } => *intervals = s.judge_from,
            }
            return run(&self.machine, &values, &task, &start, &self.channels, self.most_steps);
        }
        run(&self.machine, &values, &s.task, &start, &self.channels, self.most_steps)
    }

    /// Residuals of what fits of a part, the channels one after the other; what is missing is zero.
    pub fn residuals(&self, segment: usize, globals: &[f64], locals: &[f64]) -> Vec<f64> {
        let s = &self.data.segments[segment];
        let n = s.judge_from;
        let model = self.model(segment, globals, locals, true);
        let mut out = Vec::with_capacity(n * self.channels.len());
        match model {
            Ok(model) => {
                for (c, series) in model.iter().enumerate() {
                    for i in 0..n {
                        let r = (series[i] - s.measured[c][i]) / self.weights[c];
                        out.push(if r.is_finite() { r.clamp(-LOST, LOST) } else { 0.0 });
                    }
                }
            }
            Err(_) => out.resize(n * self.channels.len(), LOST),
        }
        out
    }

    /// Local numbers of parts: starts of the bodies that move freely, as far as something tells them.
    pub fn default_locals(machine: &Machine, data: &Data) -> Vec<Local> {
        let mut locals = Vec::new();
        let sensed = |b: usize| {
            machine
                .sensors
                .iter()
                .enumerate()
                .any(|(i, s)| data.channels.iter().any(|c| c.sensor == i) && s.reads == Reads::Angle(b))
        };
        let pulses = data.channels.iter().any(|c| c.relative);
        for (b, body) in machine.bodies.iter().enumerate() {
            let most =
                |of: fn(&Start) -> &Vec<f64>| data.segments.iter().map(|s| of(&s.start)[b].abs()).fold(0.0, f64::max);
            let speed = channel_scale(machine, data, b, true).max(most(|s| &s.v)).max(1e-6);
            if body.motion == Motion::Free {
                locals.push(Local::Speed { body: b, scale: speed });
            }
            let sprung = machine.springs.iter().any(|s| s.ends.iter().any(|e| e.body == b));
            if (sprung || sensed(b)) && !(pulses && sensed(b)) {
                let free = body.motion == Motion::Free || sensed(b);
                if free {
                    locals.push(Local::Angle { body: b, scale: channel_scale(machine, data, b, false).max(1e-6) });
                }
            }
        }
        locals
    }
}

/// How large speed or angle of a body are, as far as its channels show; 1 where they do not.
fn channel_scale(machine: &Machine, data: &Data, body: usize, speed: bool) -> f64 {
    let mut scale: f64 = 0.0;
    for (c, channel) in data.channels.iter().enumerate() {
        let fits = match machine.sensors[channel.sensor].reads {
            Reads::Speed(b) => b == body && speed,
            Reads::Angle(b) => b == body && !speed,
            _ => false,
        };
        if fits {
            let gain = machine.values[machine.sensors[channel.sensor].gain];
            scale = scale.max(spread(data, c) / gain.abs().max(1e-300));
        }
    }
    if scale > 0.0 { scale } else { 1.0 }
}

/// Standard deviation of a channel over all parts.
pub fn spread(data: &Data, channel: usize) -> f64 {
    let values = || data.segments.iter().flat_map(|s| s.measured[channel].iter()).filter(|v| v.is_finite());
    let n = values().count().max(1) as f64;
    let mean = values().sum::<f64>() / n;
    libm::sqrt(values().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n)
}
