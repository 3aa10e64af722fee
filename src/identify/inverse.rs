//! Inverse dynamics: the measured motion is prescribed, and the force that this motion needs is held against the records.
//!
//! ```text
//! r = J a - F(q, v) - u        q, v, a from the smoothed measured motion; u and all other series smoothed alike
//! ```
//! F are the forces of the same machine with the same numbers and effects. r is linear in an inertia and in the size of most loads, so
//! that a fit has one minimum, wherever it starts; a simulation that runs away from a long record has many. Where the motion is
//! measured better than the force is known, the numbers are also better (errors in variables: the noise then is on the side that is
//! fitted). What rests is left out: the static friction of a body at rest is not determined by its motion.
//!
//! Accelerations are differences of the measured samples, and so means over the steps on either side of a sample; forces and speeds are taken as the
//! same means, so that what is linear in them keeps its relation. The smoother is three moving averages of equal length, one after the other, applied to every series, so that whatever is linear
//! keeps its relation. Its length is the one of [`HALVES`] with the least held-out error, relative to the force.

use super::candidates::{self, Hypothesis, Sizes};
use super::declared;
use super::judge;
use super::model::{FIT_ITERATIONS, FittedModel, fit_model, fitted_values, score, standard_error};
use super::problem::{Local, Point, Problem};
use super::screen::FitStart;
use super::search::{self, Context};
use super::stats;
use crate::effects::{EFFECTS, On, Physics};
use crate::machine::simulate::{Samples, Task};
use crate::machine::{Body, BodyMotion, Input, InputKind, Machine, PlacedEffect, Reads, Sensor, Slot, Target};
use crate::measurement::facts;
use crate::measurement::segments::{Data, MeasuredChannel, RecordSegment};
use crate::measurement::{CandidateSpec, Measurement};
use serde::Serialize;

/// A machine whose measured motions are prescribed, with the records for it.
struct InverseRecords {
    machine: Machine,
    data: Data,
    /// Length of the smoother, from its first to its last sample [s].
    width_s: f64,
}

// None of the following was varied; the sets that they gave were right on closed loops, servos near friction and sliders of a blind set.
/// Samples on either side in each of the three moving averages.
const HALVES: [usize; 7] = [0, 1, 3, 9, 27, 81, 243];
/// The smoother is no longer than this share of the shortest record.
const LONGEST_SHARE: f64 = 0.125;
/// Samples of a record that are left at least.
const LEAST_SAMPLES: usize = 24;
/// Below this share of the highest speed of its record a body counts as at rest.
const AT_REST: f64 = 0.01;
/// Samples of all records beyond which the shortest smoothers, which keep every sample, are not tried.
const MANY_SAMPLES: usize = 40_000;

/// A free body whose motion a channel shows.
struct TurnedBody {
    body: usize,
    /// Channel that gives the motion, and whether it is a speed.
    channel: usize,
    is_speed: bool,
}

/// The free bodies whose motions can be prescribed. Empty for pulses, for a clock that errs, and for drives with links.
fn turned_bodies(m: &Machine, data: &Data) -> Vec<TurnedBody> {
    let sampled = |s: &RecordSegment| matches!(s.task.samples, Samples::Times { .. });
    let clock = m.placed.iter().any(|p| matches!(p.effect.physics, Physics::Clock(_)));
    if m.period_pitches().is_some() || m.mean_speeds(&m.values).is_some() || clock || !data.segments.iter().all(sampled)
    {
        return Vec::new();
    }
    // A clock belongs to records of several files, which do not take part.
    let alters = |p: &PlacedEffect| !matches!(p.effect.physics, Physics::OwnClock(_));
    let plain = |sensor: usize| m.placed.iter().all(|p| p.target != Target::Sensor(sensor) || !alters(p));
    let of = |body: usize| {
        let shows =
            |reads: Reads| data.channels.iter().position(|c| m.sensors[c.sensor].reads == reads && plain(c.sensor));
        let speed = shows(Reads::Speed(body)).map(|channel| TurnedBody { body, channel, is_speed: true });
        speed.or_else(|| shows(Reads::Angle(body)).map(|channel| TurnedBody { body, channel, is_speed: false }))
    };
    (0..m.bodies.len()).filter(|b| m.bodies[*b].motion == BodyMotion::Free).filter_map(of).collect()
}

/// Whether of one free body both the motion and a force that acts on it are measured.
fn is_possible(m: &Machine, data: &Data) -> bool {
    let turned = turned_bodies(m, data);
    // Samples that stand beside their rows would have to be smoothed by their own times.
    data.segments.iter().all(|s| s.behind_s.is_empty()) && turned.iter().any(|t| forces_on(m, t.body).next().is_some())
}

/// Bodies whose motions are inputs of the machine itself: body, input, and whether it is a speed.
fn driven_bodies(m: &Machine) -> impl Iterator<Item = (usize, usize, bool)> + '_ {
    m.bodies.iter().enumerate().filter_map(|(body, b)| match b.motion {
        BodyMotion::Measured(k) => Some((body, k, m.inputs[k].kind == InputKind::Speed)),
        BodyMotion::Free | BodyMotion::Constant(_) => None,
    })
}

/// Inputs that are forces on a body.
fn forces_on(m: &Machine, body: usize) -> impl Iterator<Item = (usize, usize)> {
    m.inputs.iter().enumerate().filter_map(move |(k, i)| match i.kind {
        InputKind::Force(gain) if i.body == body => Some((k, gain)),
        InputKind::Force(_) | InputKind::Speed | InputKind::Angle | InputKind::Acceleration => None,
    })
}

/// The machine and its records with measured motions prescribed, smoothed over `half` samples on either side. None if nothing can be
/// turned round, or a record is too short.
fn inverse_records(m: &Machine, data: &Data, half: usize) -> Option<InverseRecords> {
    let turned = turned_bodies(m, data);
    let mut machine = m.clone();
    let gain = machine.values.len();
    machine.values.push(1.0);
    machine.slots.push(Slot { path: "force of the motion".into(), unit: 1.0, low: 1.0, high: 1.0 });
    let is_motion = |c: &MeasuredChannel| {
        let reads = m.sensors[c.sensor].reads;
        turned.iter().any(|t| matches!(reads, Reads::Angle(b) | Reads::Speed(b) if b == t.body))
    };
    let kept: Vec<usize> = (0..data.channels.len()).filter(|c| !is_motion(&data.channels[*c])).collect();
    let mut channels: Vec<MeasuredChannel> = kept.iter().map(|c| data.channels[*c].clone()).collect();
    for t in &turned {
        let Body { name, slides, .. } = m.bodies[t.body].clone();
        let unit = if slides { "N" } else { "N m" };
        machine.bodies[t.body].motion = BodyMotion::Measured(machine.inputs.len());
        for (kind, what) in [(InputKind::Speed, "speed"), (InputKind::Acceleration, "acceleration")] {
            let path = format!("inputs.{what}.{name}");
            machine.inputs.push(Input { name: name.clone(), path, body: t.body, kind });
        }
        let path = format!("force that the motion of {name} lacks");
        channels.push(MeasuredChannel {
            name: path.clone(),
            sensor_path: path.clone(),
            sensor: machine.sensors.len(),
            unit: unit.into(),
            shown: 1.0,
            noise: 0.0,
            sensor_noise: 0.0,
            relative: false,
            quantisation: 0.0,
        });
        let reads = Reads::Reaction(t.body);
        machine.sensors.push(Sensor { name: path.clone(), path, reads, gain, unit: Some(unit.into()) });
    }
    for (body, _, _) in driven_bodies(m) {
        let name = m.bodies[body].name.clone();
        let path = format!("inputs.acceleration.{name}");
        machine.inputs.push(Input { name, path, body, kind: InputKind::Acceleration });
    }
    let segments: Option<Vec<RecordSegment>> =
        data.segments.iter().map(|s| turned_segment(m, data, s, &turned, &kept, half)).collect();
    let step_s = data.segments.iter().map(step_of).fold(0.0, f64::max);
    let input_noise = |k: usize| {
        let of = |s: &RecordSegment| facts::noise(s.task.inputs.get(k).map_or(&[], Vec::as_slice));
        facts::median(&mut data.segments.iter().map(of).collect::<Vec<f64>>())
    };
    for channel in &mut channels {
        let Reads::Reaction(body) = machine.sensors[channel.sensor].reads else {
            channel.noise = noise_left(channel.noise, 0.0, (0.0, true), half, step_s);
            continue;
        };
        let inertia = m.bodies[body].inertia.map_or(0.0, |slot| m.values[slot]);
        let force: f64 = forces_on(m, body).map(|(k, gain)| (m.values[gain] * input_noise(k)).powi(2)).sum();
        let motion = match (turned.iter().find(|t| t.body == body), m.bodies[body].motion) {
            (Some(t), _) => {
                let shown = &data.channels[t.channel];
                (shown.noise / m.values[m.sensors[shown.sensor].gain].abs().max(1e-300), t.is_speed)
            }
            (None, BodyMotion::Measured(k)) => (input_noise(k), m.inputs[k].kind == InputKind::Speed),
            (None, BodyMotion::Free | BodyMotion::Constant(_)) => (0.0, true),
        };
        channel.noise = noise_left(libm::sqrt(channel.noise * channel.noise + force), inertia, motion, half, step_s);
    }
    let data = Data { channels, segments: segments?, transfer: Vec::new(), ..data.clone() };
    Some(InverseRecords { machine, data, width_s: (6 * half + 1) as f64 * step_s })
}

fn step_of(s: &RecordSegment) -> f64 {
    match s.task.samples {
        Samples::Times { step_s, .. } => step_s,
        Samples::Pulses { interval_s, .. } => interval_s,
    }
}

/// A segment with its motions as inputs, all series smoothed, and as many samples as the smoother leaves independent.
fn turned_segment(
    m: &Machine,
    data: &Data,
    s: &RecordSegment,
    turned: &[TurnedBody],
    kept: &[usize],
    half: usize,
) -> Option<RecordSegment> {
    let Samples::Times { t_s, step_s, even } = &s.task.samples else { return None };
    let (h, n) = (*step_s, t_s.len());
    let margin = 3 * half + 1;
    if n < 2 * margin + LEAST_SAMPLES || (6 * half) as f64 > LONGEST_SHARE * n as f64 {
        return None;
    }
    let on_grid = |series: &[f64]| if *even { series.to_vec() } else { interpolated(series, t_s, h) };
    let every = ((2 * half + 1) / 4).max(1);
    let taken = |series: &[f64]| -> Vec<f64> { series.iter().step_by(every).copied().collect() };
    // Series begin one sample later than the record and end one earlier, as central differences do.
    let smooth = |series: &[f64]| smoothed(&series[1..series.len() - 1], half);
    let mut inputs = Vec::new();
    for (input, series) in m.inputs.iter().zip(&s.task.inputs) {
        let own = on_grid(series);
        let own = match (input.kind, turned.iter().find(|t| t.body == input.body)) {
            (InputKind::Force(_), Some(t)) => force_about(&own, s.task.hold, t.is_speed),
            (InputKind::Force(_), None) => force_about(&own, s.task.hold, true),
            (InputKind::Speed | InputKind::Angle | InputKind::Acceleration, _) => own,
        };
        inputs.push(taken(&smooth(&own)));
    }
    let mut measured: Vec<Vec<f64>> = kept.iter().map(|c| taken(&smooth(&on_grid(&s.measured[*c])))).collect();
    let mut start = s.start.clone();
    for t in turned {
        let gain = m.values[m.sensors[data.channels[t.channel].sensor].gain];
        let own: Vec<f64> = on_grid(&without_gaps(&s.measured[t.channel])?).iter().map(|x| x / gain).collect();
        let v = smooth(&speed_about(&own, t.is_speed, h));
        let a = taken(&smooth(&acceleration(&own, t.is_speed, h)));
        if t.is_speed {
            start.q[t.body] = s.start.q[t.body] + h * own[..margin].iter().sum::<f64>();
        } else {
            start.q[t.body] = smooth(&own).first().copied()?;
        }
        start.v[t.body] = v.first().copied()?;
        let highest = v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let v = taken(&v);
        measured.push(v.iter().map(|v| if v.abs() < AT_REST * highest { f64::NAN } else { 0.0 }).collect());
        inputs.push(v);
        inputs.push(a);
    }
    for (_, input, is_speed) in driven_bodies(m) {
        inputs.push(taken(&smooth(&acceleration(&on_grid(s.task.inputs.get(input)?), is_speed, h))));
    }
    let left = measured.first().map_or(0, Vec::len);
    let fits = (0..left).filter(|i| margin + i * every < s.judge_from).count();
    let step_s = h * every as f64;
    let t_s = (0..left).map(|i| i as f64 * step_s).collect();
    Some(RecordSegment {
        task: Task {
            samples: Samples::Times { t_s, step_s, even: true },
            inputs,
            hold: false,
            start_s: s.task.start_s + margin as f64 * h,
        },
        measured,
        judge_from: fits,
        start,
        at_rest: false,
        ..s.clone()
    })
}

/// A value of each sample and its two neighbours; 0 at the ends.
fn of_neighbours(series: &[f64], of: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let mut all = vec![0.0];
    all.extend(series.windows(3).map(of));
    all.push(0.0);
    all
}

fn slope(series: &[f64], h: f64) -> Vec<f64> {
    of_neighbours(series, |w| (w[2] - w[0]) / (2.0 * h))
}

/// Mean acceleration about each sample: over the steps on either side of it from speeds, weighted by a hat over them from angles.
fn acceleration(series: &[f64], is_speed: bool, h: f64) -> Vec<f64> {
    if is_speed { slope(series, h) } else { of_neighbours(series, |w| (w[0] - 2.0 * w[1] + w[2]) / (h * h)) }
}

/// The same mean of the speed. From angles that of a parabola through three of them on either side.
fn speed_about(series: &[f64], is_speed: bool, h: f64) -> Vec<f64> {
    if is_speed {
        return of_neighbours(series, |w| 0.25 * w[0] + 0.5 * w[1] + 0.25 * w[2]);
    }
    let mut about = slope(series, h);
    let inner = about[1..about.len() - 1].to_vec();
    let bends = of_neighbours(&inner, |w| w[0] - 2.0 * w[1] + w[2]);
    about[1..].iter_mut().zip(bends).for_each(|(v, bend)| *v -= bend / 12.0);
    about
}

/// The same mean of a force: one that holds from each sample to the next, or one on straight lines between them.
fn force_about(series: &[f64], hold: bool, is_speed: bool) -> Vec<f64> {
    let weights = match (hold, is_speed) {
        (true, _) => [0.5, 0.5, 0.0],
        (false, true) => [0.25, 0.5, 0.25],
        (false, false) => [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0],
    };
    of_neighbours(series, |w| w.iter().zip(weights).map(|(u, weight)| weight * u).sum())
}

/// A series of uneven times on an even grid of the same length, on straight lines.
fn interpolated(series: &[f64], t_s: &[f64], h: f64) -> Vec<f64> {
    let mut at = 0;
    (0..t_s.len())
        .map(|i| {
            let t = i as f64 * h;
            while at + 2 < t_s.len() && t_s[at + 1] <= t {
                at += 1;
            }
            let share = ((t - t_s[at]) / (t_s[at + 1] - t_s[at]).max(1e-300)).clamp(0.0, 1.0);
            series[at] + (series[at + 1] - series[at]) * share
        })
        .collect()
}

/// A series whose missing values lie on the straight line between their neighbours. None if all are missing.
fn without_gaps(series: &[f64]) -> Option<Vec<f64>> {
    let known: Vec<usize> = (0..series.len()).filter(|i| series[*i].is_finite()).collect();
    let (first, last) = (*known.first()?, *known.last()?);
    let mut next = 0;
    let of = |i: usize| {
        while next + 1 < known.len() && known[next] < i {
            next += 1;
        }
        let (b, a) = (known[next], known[next.saturating_sub(1)]);
        match i {
            i if i <= first => series[first],
            i if i >= last => series[last],
            i if b == i => series[i],
            i => series[a] + (series[b] - series[a]) * (i - a) as f64 / (b - a).max(1) as f64,
        }
    };
    Some((0..series.len()).map(of).collect())
}

/// Three moving averages over 2 `half` + 1 samples, where they are whole: 6 `half` samples fewer.
fn smoothed(series: &[f64], half: usize) -> Vec<f64> {
    let mut now = series.to_vec();
    for _ in 0..if half > 0 { 3 } else { 0 } {
        now = now.windows(2 * half + 1).map(|w| w.iter().sum::<f64>() / w.len() as f64).collect();
    }
    now
}

/// Standard deviation of a channel after smoothing: of its own noise, and of the noise of the motion as a force of inertia.
fn noise_left(own: f64, inertia: f64, motion: (f64, bool), half: usize, step_s: f64) -> f64 {
    let mut pulse = vec![0.0; 12 * half + 11];
    let middle = pulse.len() / 2;
    pulse[middle] = 1.0;
    let kernel = smoothed(&pulse, half);
    let size = |series: &[f64]| libm::sqrt(series.iter().map(|x| x * x).sum::<f64>());
    let (noise, is_speed) = motion;
    let of_inertia = inertia * noise * size(&acceleration(&kernel, is_speed, step_s));
    libm::sqrt((own * size(&kernel)).powi(2) + of_inertia * of_inertia)
}

/// Root mean square of the force that a channel is held against.
fn force_scale(inverse: &InverseRecords, channel: usize) -> f64 {
    let (m, data) = (&inverse.machine, &inverse.data);
    let of_inputs = |s: &RecordSegment| -> Vec<f64> {
        let Reads::Reaction(body) = m.sensors[data.channels[channel].sensor].reads else { return Vec::new() };
        let mut sum = vec![0.0; s.len()];
        for (k, gain) in forces_on(m, body) {
            sum.iter_mut().zip(&s.task.inputs[k]).for_each(|(sum, u)| *sum += m.values[gain] * u);
        }
        sum
    };
    let forces: Vec<Vec<f64>> = data.segments.iter().map(of_inputs).collect();
    let own = |s: &RecordSegment| s.measured[channel].iter().copied().filter(|x| x.is_finite()).collect();
    let measured: Vec<Vec<f64>> = data.segments.iter().map(own).collect();
    stats::rms(&forces).max(stats::rms(&measured)).max(1e-300)
}

/// The problem of inverse dynamics with the free numbers of `forward`.
fn problem<'a>(forward: &Problem<'a>, inverse: &'a InverseRecords) -> Problem<'a> {
    let (m, data) = (&inverse.machine, &inverse.data);
    let weight = |(c, channel): (usize, &MeasuredChannel)| channel.noise.max(LEAST_WEIGHT * force_scale(inverse, c));
    let moves = |body: usize| m.bodies[body].motion == BodyMotion::Free;
    let stays = |l: &&Local| match **l {
        Local::Angle { body, .. } | Local::Speed { body, .. } => moves(body),
        Local::Slot { .. } => true,
        Local::Travel => false,
    };
    let locals = forward.locals.iter().filter(stays).copied().collect();
    let mut problem = Problem {
        machine: m.clone(),
        data,
        channels: data.channels.iter().map(|c| c.sensor).collect(),
        weights: data.channels.iter().enumerate().map(weight).collect(),
        globals: forward.globals.clone(),
        locals,
        fixed: forward.fixed.clone(),
        folded: false,
        correction: 0.0,
        max_steps: forward.max_steps,
        runs: forward.runs,
        ending: forward.ending,
    };
    // What the declared machine needs, and more.
    let needed = declared::steps_needed_at(&problem, &problem.start()).unwrap_or(1.0);
    problem.max_steps = problem.max_steps.min(STEPS_OF_A_SWING.max(2.0 * needed));
    problem
}

/// Steps for a sample at most: those for a swing of an added body. Samples show no swing that is faster than half of that.
const STEPS_OF_A_SWING: f64 = 32.0;

/// Weight of a channel over its force at least, so that no residual reaches the size at which a run counts as run away.
const LEAST_WEIGHT: f64 = 1e-4;

/// Loads that a machine may have, which together decide how long the smoother is.
const USUAL_LOADS: [&str; 4] = ["constant_torque", "viscous_friction", "coulomb_friction", "quadratic_drag"];

/// Held-out error relative to the force, with the loads that machines usually have on every body.
fn error_with_usual_loads(forward: &Problem, inverse: &InverseRecords, context: &Context) -> f64 {
    let own = judge::held_out_segments(&inverse.data);
    let problem = problem(forward, inverse);
    let mut with = (problem.clone(), problem.start());
    let spec = CandidateSpec { only: USUAL_LOADS.map(String::from).to_vec(), without: Vec::new() };
    let slots: Vec<usize> = problem.globals.iter().map(|g| g.slot).collect();
    let sizes = Sizes::new(&problem, &with.1);
    let all = candidates::all(&problem.machine, &inverse.data, &sizes, &spec, &slots, &mut Vec::new());
    let mut taken: Vec<String> = Vec::new();
    for h in &all {
        if !taken.contains(&h.identity()) {
            taken.push(h.identity());
            let phases = vec![0.0; inverse.data.records.len()];
            let start = FitStart { values: h.values.clone(), phases, travels: Vec::new() };
            with = candidates::with_hypothesis(&with.0, &with.1, h, &start);
        }
    }
    let model = fit_model(with.0, &with.1, &own, Vec::new(), context.threads, 15);
    error_share(&model, inverse)
}

/// The records with the smoother that leaves the least held-out error, and for each length tried its error [s, share of the force].
fn smoothed_records(forward: &Problem, context: &Context) -> Option<(InverseRecords, Vec<[f64; 2]>)> {
    let (machine, data) = (&forward.machine, forward.data);
    let samples: usize = data.segments.iter().map(RecordSegment::len).sum();
    let mut best: Option<(InverseRecords, f64)> = None;
    let mut tried = Vec::new();
    for half in HALVES.into_iter().filter(|half| *half > 1 || samples < MANY_SAMPLES) {
        if context.must_end() {
            break;
        }
        let Some(records) = inverse_records(machine, data, half) else { continue };
        let error = error_with_usual_loads(forward, &records, context);
        tried.push([records.width_s, error]);
        if best.as_ref().is_none_or(|(_, least)| error < *least) {
            best = Some((records, error));
        }
    }
    best.map(|(records, _)| (records, tried))
}

/// Largest number of effects in a set, and how many sets of a size go on: of those with loads alone, and of those with a body that the drive
/// does not have. Such a body has a speed of its own at the start of every record, and behind a damper does what drag and a constant torque
/// do together: alone it beats either of them.
const ROUNDS: usize = 2;
const BEAM: usize = 2;
/// Sets of a size and of either kind with which the simulation is fitted.
const STARTS: usize = 2;

/// Numbers of a model by inverse dynamics, beside those of the simulation: a second voice, whose errors are others.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InverseDynamics {
    /// Length of the smoother [s].
    pub smoother_s: f64,
    /// For each length that was tried: held-out error over the force, with the loads that machines usually have.
    pub tried: Vec<[f64; 2]>,
    /// Held-out error of the force with the numbers below, over the force.
    pub error_share: f64,
    /// Numbers that hold for all records.
    pub numbers: Vec<NumberByTwoWays>,
}

/// A number by the simulation and by inverse dynamics.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NumberByTwoWays {
    /// Its path in the drive file, or that of an effect.
    pub path: String,
    /// In the unit of its name.
    pub simulated: f64,
    /// In the unit of its name.
    pub inverse: f64,
    /// Standard error of the latter.
    pub standard_error: f64,
}

/// The numbers of a fitted model by inverse dynamics; None where the records do not allow it.
pub fn second_voice(model: &FittedModel, context: &Context) -> Option<InverseDynamics> {
    let forward = &model.problem;
    if !is_turnable(forward) {
        return None;
    }
    // The effects of the model may ask for another smoother than the declared drive does.
    let (records, tried) = smoothed_records(forward, context)?;
    let own = judge::held_out_segments(&records.data);
    let inverse = problem(forward, &records);
    let start = Point { globals: model.fit.point.globals.clone(), locals: inverse.start().locals };
    let found = fit_model(inverse, &start, &own, Vec::new(), context.threads, FIT_ITERATIONS);
    // The gain of a sensor whose motion is prescribed does not show.
    let shows = |g: usize| found.fit.jacobians.iter().any(|j| j.nrows() > 0 && j.column(g).amax() > 0.0);
    let common = |g: &usize| found.problem.globals[*g].record.is_none() && shows(*g);
    let numbers = (0..found.problem.globals.len()).filter(common).map(|g| {
        let global = &found.problem.globals[g];
        let slot = &found.problem.machine.slots[global.slot];
        let value = global.law.value(found.fit.point.globals[g]);
        let unit = if global.law.logarithm { value.abs() } else { global.law.scale };
        NumberByTwoWays {
            path: slot.path.clone(),
            simulated: global.law.value(model.fit.point.globals[g]) / slot.unit,
            inverse: value / slot.unit,
            standard_error: standard_error(&found, g) * unit / slot.unit,
        }
    });
    let (smoother_s, error_share) = (records.width_s, error_share(&found, &records));
    let numbers: Vec<NumberByTwoWays> = numbers.collect();
    (!numbers.is_empty()).then_some(InverseDynamics { smoother_s, tried, error_share, numbers })
}

/// Held-out error over the force, the mean over the channels.
fn error_share(model: &FittedModel, inverse: &InverseRecords) -> f64 {
    let judged = &model.residuals().judge;
    let of = |c: usize| {
        let held_out = judged[c].iter().any(|p| !p.is_empty());
        stats::rms(if held_out { &judged[c] } else { &model.fit_residuals[c] }) / force_scale(inverse, c)
    };
    let channels = inverse.data.channels.len();
    (0..channels).map(of).sum::<f64>() / channels.max(1) as f64
}

/// Whether motion and force are both measured, and the gain of the force is known: with a free one no force at all would fit best.
fn is_turnable(forward: &Problem) -> bool {
    let m = &forward.machine;
    let gains = m.inputs.iter().filter_map(|i| if let InputKind::Force(gain) = i.kind { Some(gain) } else { None });
    let free_gain = gains.into_iter().any(|gain| forward.globals.iter().any(|g| g.slot == gain));
    !free_gain && is_possible(m, forward.data)
}

/// The best sets of effects by inverse dynamics, each a start for the simulation. Empty where the motion and a force are not both
/// measured, or the gain of the force is free, so that no force at all would be the best fit.
pub fn starts<'a>(
    measurement: &Measurement,
    forward: &Problem<'a>,
    context: &Context<'_>,
) -> Vec<(Problem<'a>, Point, Vec<Hypothesis>)> {
    if !is_turnable(forward) {
        return Vec::new();
    }
    context.report("inverse dynamics: choosing the smoother");
    let Some((records, _)) = smoothed_records(forward, context) else {
        return Vec::new();
    };
    let own = judge::held_out_segments(&records.data);
    let inverse = problem(forward, &records);
    let start = inverse.start();
    let mut beam = vec![fit_model(inverse, &start, &own, Vec::new(), context.threads, FIT_ITERATIONS)];
    let mut found = vec![forward_start(forward, &beam[0])];
    let only: Vec<String> = EFFECTS
        .iter()
        .filter(|e| matches!(e.on, On::Body | On::Span | On::Sprocket | On::Chain | On::Joints))
        .map(|e| e.name.to_string())
        .filter(|name| measurement.candidates.only.is_empty() || measurement.candidates.only.contains(name))
        .collect();
    if only.is_empty() {
        return found;
    }
    let spec = CandidateSpec { only, without: measurement.candidates.without.clone() };
    for round in 1..=ROUNDS {
        context.report("inverse dynamics: screening hypotheses");
        let mut next: Vec<FittedModel> = Vec::new();
        let mut seen = Vec::new();
        for model in &beam {
            if context.must_end() {
                return found;
            }
            next.extend(search::grown(&spec, model, &own, context, &mut seen));
        }
        let effective = search::best_effective(if next.is_empty() { &beam } else { &next });
        next.sort_by(|a, b| score(a, &effective).total_cmp(&score(b, &effective)));
        let added = |m: &FittedModel| m.effects.iter().any(|h| matches!(h.effect.physics, Physics::SecondBody { .. }));
        let (mut with_bodies, mut loads): (Vec<_>, Vec<_>) = next.into_iter().partition(added);
        let least = |all: &[FittedModel]| all.iter().map(|m| score(m, &effective)).fold(f64::MAX, f64::min);
        for kind in [&mut with_bodies, &mut loads] {
            kind.truncate(BEAM);
            found.extend(kind.iter().take(STARTS).map(|m| forward_start(forward, m)));
        }
        let next: Vec<FittedModel> = with_bodies.into_iter().chain(loads).collect();
        // A pair may explain what neither of its effects does alone.
        if next.is_empty() || round > 1 && least(&next) > least(&beam) - search::MIN_SCORE_GAIN {
            break;
        }
        beam = next;
    }
    found
}

/// The simulation with the numbers and effects of a model of inverse dynamics.
fn forward_start<'a>(forward: &Problem<'a>, model: &FittedModel) -> (Problem<'a>, Point, Vec<Hypothesis>) {
    let mut point = forward.start();
    let declared = point.globals.len();
    point.globals.copy_from_slice(&model.fit.point.globals[..declared]);
    let mut with = (forward.clone(), point);
    for (h, start) in model.effects.iter().zip(fitted_values(model)) {
        with = candidates::with_hypothesis(&with.0, &with.1, h, &start);
    }
    (with.0, with.1, model.effects.clone())
}

#[cfg(test)]
mod tests {
    use super::{acceleration, force_about, interpolated, noise_left, smoothed, speed_about, without_gaps};

    /// Closed forms: a difference over two steps, a second difference, and three averages over three samples (1 3 6 7 6 3 1) / 27.
    #[test]
    fn noise_of_forces_is_that_of_their_differences() {
        let h = 0.01;
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
        close(noise_left(0.3, 0.0, (1.0, true), 0, h), 0.3);
        close(noise_left(0.0, 2.0, (0.1, true), 0, h), 2.0 * 0.1 * 2.0_f64.sqrt() / (2.0 * h));
        close(noise_left(0.0, 2.0, (0.1, false), 0, h), 2.0 * 0.1 * 6.0_f64.sqrt() / (h * h));
        close(noise_left(0.3, 0.0, (1.0, true), 1, h), 0.3 * 141.0_f64.sqrt() / 27.0);
    }

    /// A force of one value a step moves a body by its sums; what is left of J a - u, about each sample, is rounding, from speeds and from angles.
    #[test]
    fn a_force_that_holds_is_found_from_its_motion_without_error() {
        let (h, inertia) = (0.01, 3.0);
        let force: Vec<f64> = (0..60).map(|i| f64::from(i * i * 7 % 31) - 15.0).collect();
        let (mut q, mut v) = (vec![0.2], vec![1.0]);
        for (i, u) in force.iter().enumerate() {
            q.push(q[i] + h * v[i] + 0.5 * h * h * u / inertia);
            v.push(v[i] + h * u / inertia);
        }
        for (motion, is_speed) in [(&v[..60], true), (&q[..60], false)] {
            let about = force_about(&force, true, is_speed);
            let left =
                acceleration(motion, is_speed, h).iter().zip(&about).map(|(a, u)| inertia * a - u).collect::<Vec<_>>();
            assert!(left[1..59].iter().all(|x| x.abs() < 1e-7), "{left:?}");
        }
    }

    /// A disc with viscous friction under a force of ten values a period: inertia and friction come out of the means, from speeds and from angles.
    #[test]
    fn friction_is_found_beside_inertia() {
        let (h, inertia, drag) = (0.01, 1.0, 60.0);
        let force: Vec<f64> = (0..400).map(|i| libm::sin(f64::from(i) * std::f64::consts::TAU / 10.0)).collect();
        let (mut q, mut v) = (vec![0.0], vec![0.0]);
        let decay = libm::exp(-drag * h / inertia);
        for (i, u) in force.iter().enumerate() {
            // The closed form of J v' = u - d v with a u that holds.
            let end = u / drag;
            q.push(q[i] + end * h + (v[i] - end) * inertia / drag * (1.0 - decay));
            v.push(end + (v[i] - end) * decay);
        }
        for (motion, is_speed, off) in [(&v[..400], true, 0.04), (&q[..400], false, 0.015)] {
            let (a, w) = (acceleration(motion, is_speed, h), speed_about(motion, is_speed, h));
            let u = force_about(&force, true, is_speed);
            let sum = |x: &[f64], y: &[f64]| (2..398).map(|i| x[i] * y[i]).sum::<f64>();
            let (aa, aw, ww, au, wu) = (sum(&a, &a), sum(&a, &w), sum(&w, &w), sum(&a, &u), sum(&w, &u));
            let d = aa * ww - aw * aw;
            let [found, rubs] = [(au * ww - wu * aw) / d, (wu * aa - au * aw) / d];
            println!("{found:.4} kg m2, {rubs:.3} N m s");
            assert!((found / inertia - 1.0).abs() < off && (rubs / drag - 1.0).abs() < off, "{found} {rubs}");
        }
    }

    /// The triangle of one sample has half of its height as mean over two steps, and two thirds of it under a hat; a ramp keeps its values.
    #[test]
    fn forces_on_straight_lines_have_the_means_of_their_integrals() {
        let bent = [0.0, 1.0, 0.0];
        assert_eq!(force_about(&bent, false, true)[1], 0.5);
        assert!((force_about(&bent, false, false)[1] - 2.0 / 3.0).abs() < 1e-15);
        let ramp = [1.0, 2.0, 3.0];
        assert!([true, false].iter().all(|speed| (force_about(&ramp, false, *speed)[1] - 2.0).abs() < 1e-15));
    }

    /// Straight lines stay what they are, at their place.
    #[test]
    fn smoothing_keeps_lines_and_their_time() {
        let line: Vec<f64> = (0..40).map(|i| 3.0 + 0.5 * f64::from(i)).collect();
        let smooth = smoothed(&line, 2);
        assert_eq!(smooth.len(), 40 - 12);
        assert!(smooth.iter().zip(&line[6..]).all(|(a, b)| (a - b).abs() < 1e-12), "{smooth:?}");
    }

    #[test]
    fn missing_values_and_uneven_times_lie_on_straight_lines() {
        let nan = f64::NAN;
        assert_eq!(without_gaps(&[nan, 1.0, nan, nan, 4.0, nan]), Some(vec![1.0, 1.0, 2.0, 3.0, 4.0, 4.0]));
        assert_eq!(without_gaps(&[nan, nan]), None);
        assert_eq!(interpolated(&[0.0, 1.0, 4.0, 6.0], &[0.0, 0.5, 2.0, 3.0], 1.0), [0.0, 2.0, 4.0, 6.0]);
    }
}
