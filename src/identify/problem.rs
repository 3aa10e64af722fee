//! The fitting problem: a machine, the segments of the records, the free parameters, and the residuals.
//!
//! Free parameters are of two kinds. Global ones belong to the drive, for all records or one each (phases, and
//! parameters that a user declares `per = "record"`). Local ones belong to one segment of a record: its initial state,
//! and parameters `per = "part"`. Residuals are (model - measured) / weight of the channel. Segments do not share local
//! parameters, so that the fit eliminates them segment by segment.

use crate::effects::Physics;
use crate::machine::correction::Observed;
use crate::machine::fidelity::{RunRequest, UnrepeatedPart};
use crate::machine::simulate::{InitialState, RunError, Samples};
use crate::machine::{BodyMotion, Machine, Reads, Sensor, Slot, Target};
use crate::measurement::clocks::at_own_times;
use crate::measurement::segments::{Data, MeasuredChannel, RecordSegment};
use crate::side_by_side::parallel;
use crate::units::within;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

/// A parameter that is free for all records, or for one.
#[derive(Clone, Debug, PartialEq)]
pub struct Global {
    pub slot: usize,
    /// None: for all records.
    pub record: Option<usize>,
    pub law: Law,
    /// Nameplate value and standard deviation, in scaled form.
    pub prior: Option<(f64, f64)>,
}

/// A parameter that every segment has for itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    /// Position in the period of a motion that has one [pitches].
    Travel,
    /// Initial angle and speed; for a body that an effect adds, relative to its host.
    Angle {
        body: usize,
        scale: f64,
    },
    Speed {
        body: usize,
        scale: f64,
    },
    Slot {
        slot: usize,
        law: Law,
    },
}

/// Scaling of a parameter for the fit: x = value / scale, or ln(value / scale).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    pub scale: f64,
    pub logarithm: bool,
    /// Bounds of the value.
    pub low: f64,
    pub high: f64,
}

impl Law {
    pub fn scaled(&self, value: f64) -> f64 {
        if self.logarithm { libm::log((value / self.scale).max(1e-300)) } else { value / self.scale }
    }

    pub fn value(&self, x: f64) -> f64 {
        let value = if self.logarithm { self.scale * libm::exp(x.clamp(-600.0, 600.0)) } else { self.scale * x };
        within(value, self.low, self.high)
    }

    /// Bounds of x.
    pub fn bounds(&self) -> (f64, f64) {
        (self.scaled(self.low), self.scaled(self.high))
    }
}

/// A model with data, ready to be fitted.
#[derive(Clone, Debug)]
pub struct Problem<'a> {
    pub machine: Machine,
    pub data: &'a Data,
    pub channels: Vec<usize>,
    /// One for every channel; residuals are divided by it.
    pub weights: Vec<f64>,
    pub globals: Vec<Global>,
    pub locals: Vec<Local>,
    /// Fixed parameters: record (None: all), slot and value. They override values that records set.
    pub fixed: Vec<(Option<usize>, usize, f64)>,
    /// Average over all parts of a period that are alike, to find where in the period a record starts.
    pub folded: bool,
    /// Share of the difference between measured and predicted that the state takes at each sample; 0: a simulation.
    pub correction: f64,
    /// Steps per sample beyond which a model counts as too stiff.
    pub max_steps: f64,
    /// Model runs so far.
    pub runs: &'a AtomicU64,
    pub ending: FitEnding<'a>,
}

/// What ends a fit before it has converged. A limit of model runs does not: where it falls in a fit would depend on the threads.
#[derive(Clone, Copy, Debug)]
pub struct FitEnding<'a> {
    /// Another thread sets it.
    pub stop: &'a AtomicBool,
    pub deadline: Option<Instant>,
}

impl FitEnding<'_> {
    pub fn is_due(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.deadline.is_some_and(|end| Instant::now() >= end)
    }
}

/// Parameters of a fit: scaled globals, and the locals of every segment.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    pub globals: Vec<f64>,
    pub locals: Vec<Vec<f64>>,
}

/// Difference step of a scaled parameter.
const DIFFERENCE: f64 = 1e-6;
/// Step in the search for a record's position [pitches].
pub const FINE_PITCHES: f64 = 0.005;
const FINEST_PITCHES: f64 = 0.1 * FINE_PITCHES;
/// Residual of a sample that a model did not reach.
pub(super) const DIVERGED_RESIDUAL: f64 = 1e6;

impl<'a> Problem<'a> {
    /// Start values of all free parameters: the drive's own.
    pub fn start(&self) -> Point {
        Point {
            globals: self.globals.iter().map(|g| g.law.scaled(self.file_value(g))).collect(),
            locals: self.data.segments.iter().map(|s| self.local_start(s)).collect(),
        }
    }

    /// Start value of a free parameter: from its record, or else from the machine.
    fn file_value(&self, g: &Global) -> f64 {
        let set = g.record.and_then(|r| self.data.set[r].iter().find(|(slot, _)| *slot == g.slot));
        set.map_or(self.machine.values[g.slot], |(_, value)| *value)
    }

    fn local_start(&self, s: &RecordSegment) -> Vec<f64> {
        self.locals
            .iter()
            .map(|l| match *l {
                Local::Travel => s.start.travel,
                Local::Angle { body, scale } => s.start.q.get(body).map_or(0.0, |q| q / scale),
                Local::Speed { body, scale } => s.start.v.get(body).map_or(0.0, |v| v / scale),
                Local::Slot { slot, law } => law.scaled(self.machine.values[slot]),
            })
            .collect()
    }

    /// Whether a global affects this segment.
    pub fn concerns(&self, global: usize, segment: usize) -> bool {
        self.globals[global].record.is_none_or(|r| r == self.data.segments[segment].record)
    }

    /// Parameter values and initial state for a segment.
    pub(super) fn numbers(&self, segment: usize, globals: &[f64], locals: &[f64]) -> (Vec<f64>, InitialState) {
        let s = &self.data.segments[segment];
        let mut values = self.machine.values.clone();
        for (slot, value) in &self.data.set[s.record] {
            values[*slot] = *value;
        }
        for (_, slot, value) in self.fixed.iter().filter(|(r, ..)| r.is_none_or(|r| r == s.record)) {
            values[*slot] = *value;
        }
        for (g, x) in self.globals.iter().zip(globals) {
            if g.record.is_none_or(|r| r == s.record) {
                values[g.slot] = g.law.value(*x);
            }
        }
        // Bodies that effects add follow the declared ones. They start in the state of their host plus their own
        // offset.
        let mut start = s.start.clone();
        let declared = start.q.len();
        let (mut turned, mut moving) = (Vec::new(), Vec::new());
        for (l, x) in self.locals.iter().zip(locals) {
            match *l {
                Local::Travel => start.travel = *x,
                Local::Angle { .. } | Local::Speed { .. } if s.at_rest => {}
                Local::Angle { body, scale } if body >= declared => turned.push((body, x * scale)),
                Local::Speed { body, scale } if body >= declared => moving.push((body, x * scale)),
                Local::Angle { body, scale } => start.q[body] = x * scale,
                Local::Speed { body, scale } => start.v[body] = x * scale,
                Local::Slot { slot, law } => values[slot] = law.value(*x),
            }
        }
        // A clock that errs belongs to the channels that have one of their own in this record.
        for p in self.machine.placed.iter().filter(|p| matches!(p.effect.physics, Physics::OwnClock(_))) {
            let of = |c: &MeasuredChannel| p.target == Target::Sensor(c.sensor);
            let channel = self.data.channels.iter().position(of);
            if channel.and_then(|c| s.behind_s.get(c)).is_none_or(Vec::is_empty) {
                p.slots.iter().for_each(|slot| values[*slot] = 0.0);
            }
        }
        let beyond = |of: &[(usize, f64)], body: usize| of.iter().filter(|o| o.0 == body).map(|o| o.1).sum::<f64>();
        for spring in &self.machine.springs {
            if let [near, far] = spring.ends.as_slice()
                && far.body >= start.q.len()
            {
                let (q, v) = (start.q[near.body], start.v[near.body]);
                start.q.push(q + beyond(&turned, start.q.len()));
                start.v.push(v + beyond(&moving, start.v.len()));
            }
        }
        (values, start)
    }

    /// Model output in a segment, channel by channel. With `fitting`, only over its fitting samples.
    pub fn model(
        &self,
        segment: usize,
        globals: &[f64],
        locals: &[f64],
        fitting: bool,
    ) -> Result<Vec<Vec<f64>>, RunError> {
        let s = &self.data.segments[segment];
        let (values, start) = self.numbers(segment, globals, locals);
        let shorter = (fitting && s.judge_from < s.len() && s.judge_from > 0).then(|| s.fitting_task());
        let sensors: Vec<usize> = self.data.channels.iter().map(|c| c.sensor).collect();
        let noise: Vec<f64> = self.data.channels.iter().map(|c| c.sensor_noise).collect();
        let observed = Observed { share: self.correction, sensors: &sensors, noise: &noise, measured: &s.measured };
        let mut shown = self.machine.run(&RunRequest {
            observed: (self.correction > 0.0).then_some(observed),
            values: &values,
            corners: &self.corners(segment, globals, &values),
            folded: self.folded,
            task: shorter.as_ref().unwrap_or(&s.task),
            start: &start,
            channels: &self.channels,
            max_steps: self.max_steps,
            runs: self.runs,
        })?;
        // Other sensors than those of the channels are read at the rows.
        if let Samples::Times { t_s, .. } = &s.task.samples
            && self.channels == sensors
        {
            for (series, behind_s) in shown.iter_mut().zip(&s.behind_s).filter(|(_, behind_s)| !behind_s.is_empty()) {
                *series = at_own_times(series, t_s, behind_s);
            }
        }
        Ok(shown)
    }

    /// Samples of a segment's channels that fit and are known.
    pub fn known_samples(&self, segment: usize) -> usize {
        let s = &self.data.segments[segment];
        s.measured.iter().map(|m| m.iter().take(s.judge_from).filter(|v| v.is_finite()).count()).sum()
    }

    /// The problem with additional sensors of unit gain, which become its only channels.
    pub fn with_sensors(&self, reads: &[Reads]) -> Problem<'a> {
        let mut shown = self.clone();
        let gain = shown.machine.values.len();
        shown.machine.values.push(1.0);
        shown.machine.slots.push(Slot { path: "looked at".into(), unit: 1.0, low: 1.0, high: 1.0 });
        let first = shown.machine.sensors.len();
        for reads in reads {
            let (name, path, reads) = (String::new(), String::new(), *reads);
            shown.machine.sensors.push(Sensor { name, path, reads, gain, unit: None });
        }
        shown.channels = (first..shown.machine.sensors.len()).collect();
        shown
    }

    /// Minimum and maximum speed of a body in all fitted segments; for pulse data, of their initial speeds.
    pub fn speeds_of(&self, point: &Point, body: usize) -> (f64, f64) {
        let shown = self.with_sensors(&[Reads::Speed(body)]);
        let fits = |k: &usize| self.data.segments[*k].judge_from > 0;
        let of = |k: usize| {
            let s = &self.data.segments[k];
            let seen = match s.task.samples {
                Samples::Times { .. } => shown.model(k, &point.globals, &point.locals[k], true).unwrap_or_default(),
                Samples::Pulses { .. } => Vec::new(),
            };
            let started = vec![self.numbers(k, &point.globals, &point.locals[k]).1.v[body]];
            seen.into_iter().next().unwrap_or(started)
        };
        let all = (0..self.data.segments.len()).filter(fits).flat_map(of);
        all.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)))
    }

    /// For every channel, the part that does not repeat itself (root mean square over fitted data), which no model can predict;
    /// None: all repeats itself.
    pub fn unrepeated(&self, point: &Point) -> Option<Vec<UnrepeatedPart>> {
        let mut squares: Option<Vec<UnrepeatedPart>> = None;
        let parts: Vec<usize> =
            (0..self.data.segments.len()).filter(|k| self.data.segments[*k].judge_from > 0).collect();
        for k in &parts {
            let (values, _) = self.numbers(*k, &point.globals, &point.locals[*k]);
            let Some((_, corner)) = self.corners(*k, &point.globals, &values).into_iter().next() else { continue };
            let Some(unrepeated) = self.machine.unrepeated(&corner, self.runs) else { continue };
            let squares = squares.get_or_insert_with(|| vec![UnrepeatedPart::default(); self.channels.len()]);
            for (square, sensor) in squares.iter_mut().zip(&self.channels) {
                let gain = values[self.machine.sensors[*sensor].gain];
                let (size, in_mean) = (unrepeated[*sensor].size * gain, unrepeated[*sensor].in_mean * gain);
                square.size += size * size / parts.len() as f64;
                square.in_mean += in_mean * in_mean / parts.len() as f64;
            }
        }
        let root = |s: UnrepeatedPart| UnrepeatedPart { size: libm::sqrt(s.size), in_mean: libm::sqrt(s.in_mean) };
        squares.map(|all| all.into_iter().map(root).collect())
    }

    /// Residuals of a segment's fitting samples, channel after channel; missing samples give zero.
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
                        out.push(if r.is_finite() { r.clamp(-DIVERGED_RESIDUAL, DIVERGED_RESIDUAL) } else { 0.0 });
                    }
                }
            }
            Err(_) => out.resize(n * self.channels.len(), DIVERGED_RESIDUAL),
        }
        out
    }

    /// Difference step of a scaled global: large where runs lie on a grid.
    pub fn difference(&self, global: usize, x: f64) -> f64 {
        match self.spacing(global) {
            // Within a grid cell the model is linear.
            Some(spacing) => 0.01 * spacing,
            None => DIFFERENCE * x.abs().max(1.0),
        }
    }

    /// Whether runs for this scaled global lie on a grid.
    pub fn is_on_grid(&self, global: usize) -> bool {
        self.spacing(global).is_some()
    }

    /// Grid spacing of runs for this scaled global; None: every value is run.
    fn spacing(&self, global: usize) -> Option<f64> {
        let g = &self.globals[global];
        self.machine.grid(g.slot, g.law.logarithm)
    }

    /// Parameter sets that are run, with weights that add up to one: a corner of the grid cell that contains `globals`, and its
    /// neighbours. The model interpolates linearly between them. A fit is then smooth although the part that does not repeat itself
    /// differs in every run, and few runs are needed. Without a grid: `values` alone.
    fn corners(&self, segment: usize, globals: &[f64], values: &[f64]) -> Vec<(f64, Vec<f64>)> {
        let mut corner = values.to_vec();
        let mut steps = Vec::new();
        for (i, (g, x)) in self.globals.iter().zip(globals).enumerate() {
            let Some(spacing) = self.spacing(i).filter(|_| self.concerns(i, segment)) else { continue };
            let cell = libm::floor(x / spacing);
            corner[g.slot] = g.law.value(cell * spacing);
            let share = x / spacing - cell;
            if share > 1e-9 {
                steps.push((share, g.slot, g.law.value((cell + 1.0) * spacing)));
            }
        }
        let rest = 1.0 - steps.iter().map(|s| s.0).sum::<f64>();
        let mut all = vec![(rest, corner.clone())];
        for (share, slot, value) in steps {
            let mut next = corner.clone();
            next[slot] = value;
            all.push((share, next));
        }
        all
    }

    /// The globals rounded to their grids, so that one run serves.
    pub fn snapped(&self, globals: &[f64]) -> Vec<f64> {
        let snap = |(i, x): (usize, &f64)| self.spacing(i).map_or(*x, |s| libm::round(x / s) * s);
        globals.iter().enumerate().map(snap).collect()
    }

    /// Difference step of a local parameter.
    pub fn local_difference(&self, local: usize, x: f64) -> f64 {
        match self.locals[local] {
            Local::Travel => 2e-3,
            Local::Angle { .. } | Local::Speed { .. } | Local::Slot { .. } => DIFFERENCE * x.abs().max(1.0),
        }
    }

    /// Finds the position in the period, and the angles, at which every segment of a motion with a period starts: first within the period of alike links
    /// and teeth, from the mean over all of these, in steps fine enough for tooth impacts; then which of them, and the exact position.
    pub fn find_start_positions(&self, point: &mut Point, threads: usize) {
        let Some(period) = self.machine.period_pitches() else { return };
        let alike = f64::from(period.alike);
        let folded = Problem { folded: true, ..self.clone() };
        point.locals = parallel(self.data.segments.len(), threads, |k| {
            let best =
                |of: &Problem, from: &[f64], step: f64, places| of.best_place(k, &point.globals, from, step, places).1;
            let within = best(&folded, &point.locals[k], FINE_PITCHES, 0..=(alike / FINE_PITCHES) as i32 - 1);
            let within = best(&folded, &within, FINEST_PITCHES, -10..=10);
            let place = best(self, &within, alike, 0..=period.places() as i32 - 1);
            best(self, &place, FINEST_PITCHES, -10..=10)
        });
    }

    /// The best of several positions of a segment, `step` pitches apart: its cost, and the locals there with their
    /// angles.
    fn best_place(
        &self,
        part: usize,
        globals: &[f64],
        from: &[f64],
        step: f64,
        places: std::ops::RangeInclusive<i32>,
    ) -> (f64, Vec<f64>) {
        let mut best = (f64::INFINITY, from.to_vec());
        for place in places {
            let mut locals = from.to_vec();
            for (l, x) in self.locals.iter().zip(&mut locals) {
                if *l == Local::Travel {
                    *x += step * f64::from(place);
                }
            }
            let cost = self.cost_with_angles(part, globals, &mut locals);
            if cost < best.0 {
                best = (cost, locals);
            }
        }
        best
    }

    /// Tries every other pair of links at which a segment may start, and positions slightly ahead and behind, further
    /// than a gradient reaches where impacts are sharp. Returns whether a better position was found.
    pub fn realign(&self, point: &mut Point, threads: usize) -> bool {
        let Some(period) = self.machine.period_pitches() else { return false };
        let (alike, places) = (f64::from(period.alike), period.places() as i32);
        let found = parallel(self.data.segments.len(), threads, |k| {
            let (before, mut at) = self.best_place(k, &point.globals, &point.locals[k], 0.0, 0..=0);
            let mut cost = before;
            for (step, places) in [(alike, 0..=places - 1), (FINE_PITCHES, -30..=30), (FINEST_PITCHES, -10..=10)] {
                (cost, at) = self.best_place(k, &point.globals, &at, step, places);
            }
            (cost < before * (1.0 - 1e-3)).then_some(at)
        });
        let better = found.iter().any(Option::is_some);
        for (own, found) in point.locals.iter_mut().zip(found) {
            if let Some(found) = found {
                *own = found;
            }
        }
        better
    }

    /// The locals of a segment with all motion reversed, for sensors that do not show the direction: from the given
    /// locals, or from the records. None if nothing is free to reverse.
    pub fn reversed_locals(&self, segment: usize, locals: &[f64], as_shown: bool) -> Option<Vec<f64>> {
        let s = &self.data.segments[segment];
        let moves = |l: &Local| matches!(l, Local::Speed { .. } | Local::Angle { .. });
        if s.at_rest || !self.locals.iter().any(|l| matches!(l, Local::Speed { .. })) {
            return None;
        }
        let shown = if as_shown { self.local_start(s) } else { locals.to_vec() };
        let own = self.locals.iter().zip(locals).zip(shown);
        Some(own.map(|((l, x), shown)| if moves(l) { -shown } else { *x }).collect())
    }

    /// Reverses the initial motion of all segments that fit better that way.
    pub fn reverse_better_starts(&self, point: &mut Point, threads: usize) {
        let cost =
            |k: usize, locals: &[f64]| -> f64 { self.residuals(k, &point.globals, locals).iter().map(|r| r * r).sum() };
        let turned = parallel(self.data.segments.len(), threads, |k| {
            let own = &point.locals[k];
            if self.data.segments[k].judge_from == 0 {
                return None;
            }
            let tries = [false, true].into_iter().filter_map(|as_shown| self.reversed_locals(k, own, as_shown));
            let best = tries.map(|t| (cost(k, &t), t)).min_by(|a, b| a.0.total_cmp(&b.0))?;
            (best.0 < cost(k, own)).then_some(best.1)
        });
        for (own, turned) in point.locals.iter_mut().zip(turned) {
            if let Some(turned) = turned {
                *own = turned;
            }
        }
    }

    /// Cost of a segment after its angles were corrected by the means of their residuals.
    pub fn cost_with_angles(&self, segment: usize, globals: &[f64], locals: &mut [f64]) -> f64 {
        let mut residuals = self.residuals(segment, globals, locals);
        let n = residuals.len() / self.channels.len().max(1);
        for (c, sensor) in self.channels.iter().enumerate() {
            let Reads::Angle(b) = self.machine.sensors[*sensor].reads else { continue };
            let own = &mut residuals[c * n..(c + 1) * n];
            let mean = own.iter().sum::<f64>() / n.max(1) as f64;
            own.iter_mut().for_each(|r| *r -= mean);
            let gain = self.machine.values[self.machine.sensors[*sensor].gain];
            for (l, x) in self.locals.iter().zip(locals.iter_mut()) {
                if let Local::Angle { body, scale } = l
                    && *body == b
                {
                    *x -= mean * self.weights[c] / gain / scale;
                }
            }
        }
        residuals.iter().map(|r| r * r).sum()
    }

    /// Local parameters of segments: initial states of freely moving bodies, as far as the data determine them.
    pub fn default_locals(machine: &Machine, data: &Data) -> Vec<Local> {
        let mut locals = Vec::new();
        if machine.period_pitches().is_some() {
            locals.push(Local::Travel);
            let read = |b: usize| data.channels.iter().any(|c| machine.sensors[c.sensor].reads == Reads::Angle(b));
            locals.extend((0..machine.bodies.len()).filter(|b| read(*b)).map(|body| Local::Angle { body, scale: 1.0 }));
            return locals;
        }
        let sensed = |b: usize| {
            machine
                .sensors
                .iter()
                .enumerate()
                .any(|(i, s)| data.channels.iter().any(|c| c.sensor == i) && s.reads == Reads::Angle(b))
        };
        let pulses = data.channels.iter().any(|c| c.relative);
        for (b, body) in machine.bodies.iter().enumerate() {
            let most = |of: fn(&InitialState) -> &Vec<f64>| {
                data.segments.iter().map(|s| of(&s.start)[b].abs()).fold(0.0, f64::max)
            };
            let speed = channel_scale(machine, data, b, true).max(most(|s| &s.v)).max(1e-6);
            if body.motion == BodyMotion::Free {
                locals.push(Local::Speed { body: b, scale: speed });
            }
            let sprung = machine.springs.iter().any(|s| s.ends.iter().any(|e| e.body == b));
            if (sprung || sensed(b)) && !(pulses && sensed(b)) {
                let free = body.motion == BodyMotion::Free || sensed(b);
                if free {
                    locals.push(Local::Angle { body: b, scale: channel_scale(machine, data, b, false).max(1e-6) });
                }
            }
        }
        locals
    }
}

/// Typical speed or angle of a body in its channels; 1 if no channel shows it.
fn channel_scale(machine: &Machine, data: &Data, body: usize, speed: bool) -> f64 {
    let mut scale: f64 = 0.0;
    for (c, channel) in data.channels.iter().enumerate() {
        let fits = match machine.sensors[channel.sensor].reads {
            Reads::Speed(b) => b == body && speed,
            Reads::Angle(b) => b == body && !speed,
            Reads::Acceleration(_) | Reads::Pulses { .. } | Reads::Tension(_) | Reads::Reaction(_) | Reads::Part(_) => {
                false
            }
        };
        if fits {
            let gain = machine.values[machine.sensors[channel.sensor].gain];
            scale = scale.max(spread(data, c) / gain.abs().max(1e-300));
        }
    }
    if scale > 0.0 { scale } else { 1.0 }
}

/// Standard deviation of a channel over all segments.
pub fn spread(data: &Data, channel: usize) -> f64 {
    let values = || data.segments.iter().flat_map(|s| s.measured[channel].iter()).filter(|v| v.is_finite());
    let n = values().count().max(1) as f64;
    let mean = values().sum::<f64>() / n;
    libm::sqrt(values().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n)
}
