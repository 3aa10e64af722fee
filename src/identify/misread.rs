//! Whether records are what their files say: channels that contradict each other, records of noise, inputs that never move, labels that are
//! swapped, units that are off. The report tells it before all else: what is found from such records is no better than they are.

use super::problem::{Point, Problem};
use super::search::Context;
use super::stats;
use crate::machine::{Input, InputKind, Machine, Reads, Sensor, Target};
use crate::measurement::facts;
use crate::measurement::segments::{Data, RecordSegment};

/// A channel contradicts another of the same quantity where it is so many times the other, or less than its inverse; where a mean
/// differs by this share of the signal; or where both have less than this correlation.
const CONTRADICTS: f64 = 1.25;
const MEAN_DIFFERS: f64 = 0.25;
const LEAST_CORRELATION: f64 = 0.7;
/// A series holds noise alone where its standard deviation is at most so many times its noise by fourth differences, about a mean of at most so many of it.
const NOISE_ALONE: f64 = 1.2;
const ABOUT_ZERO: f64 = 3.0;
/// Share of a motion that a channel shows at least, with so many standard errors for chance.
const LEAST_SHOWN: f64 = 0.5;
const CHANCE: f64 = 3.0;
/// Share of a variance that is not noise, where a channel shows a motion; and noises by which means may differ.
const LEAST_SIGNAL: f64 = 0.3;
const NOISE_OF_MEAN: f64 = 1.0;
/// Samples that tell noise from a signal.
const FEWEST_SAMPLES: usize = 50;
/// Labels are swapped where what another record sets leaves less than this share of the error, in both records, and the error is at least this share of
/// the signal.
const SWAPPED: f64 = 0.5;
const LEAST_ERROR: f64 = 0.05;
/// Records that are compared in pairs, at most.
const MOST_RECORDS: usize = 12;
/// Share by which a ratio may differ from the factor between two units: numbers of drawings are known to some 10 %.
const NEAR_FACTOR: f64 = 0.12;

/// Factors between units that are taken for each other.
const FACTORS: [(f64, &str); 8] = [
    (10.0, "10, as between bar and MPa"),
    (100.0, "100, as between cm and m or percent and shares"),
    (1e3, "1000, as between mm and m"),
    (1e6, "a million, as between g mm2 and kg m2 over 1000"),
    (1e9, "1e9, as between g mm2 and kg m2"),
    (std::f64::consts::PI / 30.0, "2 pi / 60, as between 1/min and rad/s"),
    (std::f64::consts::PI / 180.0, "pi / 180, as between degrees and radians"),
    (2.0 * std::f64::consts::PI, "2 pi, as between turns and radians"),
];

/// The factors between units that a number lies near, which the fit has moved by `times`; empty: none.
pub fn unit_factors(times: f64) -> Vec<&'static str> {
    let off = |factor: f64| (libm::log(times.abs()).abs() - libm::log(factor).abs()).abs();
    FACTORS.iter().filter(|(factor, _)| off(*factor) < NEAR_FACTOR).map(|(_, words)| *words).collect()
}

/// What speaks against the records.
pub struct Misread {
    /// What makes a lead of a name.
    pub doubts: Vec<String>,
    /// What is to be known first.
    pub notes: Vec<String>,
}

/// What the records show before any fit; the numbers of `start` are those of the drive file.
pub fn misread(problem: &Problem, start: &Point, context: &Context) -> Misread {
    let (machine, data) = (&problem.machine, problem.data);
    let mut doubts = contradictions(problem);
    doubts.extend(swapped_records(problem, start, context));
    let mut notes = records_of_noise(data);
    notes.extend(idle_inputs(machine, data));
    Misread { doubts, notes }
}

/// Pairs of channels that read one quantity and differ by more than sensors do. Sensors with effects in the drive file, with gains that are fitted or
/// differ by record, and samples of other files are not compared.
fn contradictions(problem: &Problem) -> Vec<String> {
    let (machine, data) = (&problem.machine, problem.data);
    let is_plain = |c: usize, sensor: &Sensor| {
        let has_effect = machine.placed.iter().any(|p| p.target == Target::Sensor(data.channels[c].sensor));
        let is_fitted = problem.globals.iter().any(|g| g.slot == sensor.gain);
        let is_set = data.set.iter().flatten().any(|(slot, _)| *slot == sensor.gain);
        let is_elsewhere = data.segments.iter().any(|s| s.behind_s.get(c).is_some_and(|b| !b.is_empty()));
        !has_effect && !is_fitted && !is_set && !is_elsewhere
    };
    let is_same = |a: &Sensor, b: &Sensor| match a.reads {
        Reads::Angle(_) | Reads::Speed(_) | Reads::Acceleration(_) | Reads::Tension(_) | Reads::Reaction(_) => {
            a.reads == b.reads
        }
        // Wheels have marks of their own, and parts that are no bodies are not told apart here.
        Reads::Pulses { .. } | Reads::Part(_) => false,
    };
    let mut all = Vec::new();
    for (b, second) in data.channels.iter().enumerate() {
        for (a, first) in data.channels.iter().enumerate().take(b) {
            let (one, other) = (&machine.sensors[first.sensor], &machine.sensors[second.sensor]);
            if !is_same(one, other) || !is_plain(a, one) || !is_plain(b, other) {
                continue;
            }
            let gains = [one, other].map(|s| machine.values[s.gain]);
            let of = |s: &RecordSegment| -> Vec<[f64; 2]> {
                s.measured[a].iter().zip(&s.measured[b]).map(|(x, y)| [x / gains[0], y / gains[1]]).collect()
            };
            let pairs: Vec<[f64; 2]> = data.segments.iter().flat_map(of).filter(|[x, y]| (x + y).is_finite()).collect();
            let noise = [first.sensor_noise / gains[0], second.sensor_noise / gains[1]];
            if let Some(how) = contradiction(&pairs, noise) {
                all.push(format!(
                    "channels `{}` and `{}` read the same quantity and contradict each other: `{}` {how}; correct its column, its unit or its gain, or take one of them away",
                    first.name, second.name, second.name
                ));
            }
        }
    }
    all
}

/// How the second of each pair contradicts the first.
fn contradiction(pairs: &[[f64; 2]], noise: [f64; 2]) -> Option<String> {
    let n = pairs.len() as f64;
    if pairs.len() < FEWEST_SAMPLES {
        return None;
    }
    let mean = |i: usize| pairs.iter().map(|p| p[i]).sum::<f64>() / n;
    let means = [mean(0), mean(1)];
    let product = |i: usize, j: usize| pairs.iter().map(|p| (p[i] - means[i]) * (p[j] - means[j])).sum::<f64>() / n;
    let [first, second, both] = [product(0, 0), product(1, 1), product(0, 1)];
    // What is left of the variances without noise, and whether that is a motion.
    let own = [first - noise[0] * noise[0], second - noise[1] * noise[1]];
    let moves = |i: usize, all: f64| own[i] > LEAST_SIGNAL * all && own[i] > (MEAN_DIFFERS * means[i]).powi(2);
    let signal = libm::sqrt(first + means[0] * means[0]);
    let off = (means[1] - means[0]).abs();
    // How much of the motion of one the other shows, at most: noise of the other does not change it.
    let shown = |of: usize, other: f64| (both + CHANCE * libm::sqrt(own[of] * other / n)) / own[of];
    match (moves(0, first), moves(1, second)) {
        (true, true) => {
            let correlation = both / libm::sqrt(own[0] * own[1]);
            // By which factor the second follows the first, seen from either.
            let times = [both / own[0], own[1] / both];
            if correlation < -LEAST_CORRELATION {
                return Some("has the opposite sign".into());
            }
            if correlation < LEAST_CORRELATION {
                return Some(format!("follows it with a correlation of {correlation:.2}"));
            }
            if times.iter().all(|t| *t > CONTRADICTS) || times.iter().all(|t| *t < 1.0 / CONTRADICTS) {
                return Some(format!("is {:.3} times the other", libm::sqrt(times[0] * times[1])));
            }
        }
        (true, false) if shown(0, second) < LEAST_SHOWN => return Some("does not move where the other does".into()),
        (false, true) if shown(1, first) < LEAST_SHOWN => return Some("moves where the other does not".into()),
        (true | false, _) => {}
    }
    (off > MEAN_DIFFERS * signal && off > NOISE_OF_MEAN * (noise[0] + noise[1]))
        .then(|| format!("has a mean that differs by {:.0} % of the signal", 100.0 * off / signal))
}

/// Records in which every sampled channel holds white noise about zero.
fn records_of_noise(data: &Data) -> Vec<String> {
    let is_noise = |series: &Vec<f64>| {
        let known: Vec<f64> = series.iter().copied().filter(|v| v.is_finite()).collect();
        let n = known.len() as f64;
        let mean = known.iter().sum::<f64>() / n.max(1.0);
        let about: Vec<f64> = known.iter().map(|v| v - mean).collect();
        let deviation = libm::sqrt(about.iter().map(|v| v * v).sum::<f64>() / n.max(1.0));
        let is_small = deviation <= NOISE_ALONE * facts::noise(&known) && mean.abs() <= ABOUT_ZERO * deviation;
        known.len() >= FEWEST_SAMPLES && is_small && stats::white(&[about])
    };
    let holds_noise = |record: usize| {
        let mut own = data.segments.iter().filter(|s| s.record == record).peekable();
        own.peek().is_some() && own.all(|s| !s.measured.is_empty() && s.measured.iter().all(is_noise))
    };
    if data.channels.iter().any(|c| c.relative) {
        return Vec::new();
    }
    let noisy = data.records.iter().enumerate().filter(|(record, _)| holds_noise(*record));
    noisy
        .map(|(_, name)| format!("record `{name}` holds noise alone: no channel of it moves by more than its noise"))
        .collect()
}

/// Measured forces that have one value in all records.
fn idle_inputs(machine: &Machine, data: &Data) -> Vec<String> {
    let value_of = |k: usize| -> Option<f64> {
        let series = data.segments.iter().filter_map(|s| s.task.inputs.get(k));
        let mut values = series.flatten().copied().filter(|v| v.is_finite());
        let first = values.next()?;
        values.all(|v| v == first).then_some(first)
    };
    let idle: Vec<Option<f64>> = (0..machine.inputs.len()).map(value_of).collect();
    // With springs or declared loads, something else has a force that is known.
    let is_alone = idle.iter().all(Option::is_some) && machine.springs.is_empty() && machine.placed.is_empty();
    let say = |(input, value): (&Input, &Option<f64>)| match (input.kind, value) {
        (InputKind::Force(_), Some(0.0)) if is_alone => Some(format!(
            "input `{}` is zero in every record: of torques and inertias only their ratios can be known",
            input.path
        )),
        (InputKind::Force(_), Some(value)) => Some(format!(
            "input `{}` never moves: it is {value} in every record; is it the column of what drives the machine?",
            input.path
        )),
        (InputKind::Force(_), None) | (InputKind::Speed | InputKind::Angle | InputKind::Acceleration, _) => None,
    };
    machine.inputs.iter().zip(&idle).filter_map(say).collect()
}

/// Pairs of records of which each is followed far better with what the other one sets, or with its inputs: their labels may be swapped.
fn swapped_records(problem: &Problem, start: &Point, context: &Context) -> Vec<String> {
    let data = problem.data;
    let n = data.segments.len();
    let is_single = |k: usize| data.segments.iter().filter(|s| s.record == data.segments[k].record).count() == 1;
    if !(2..=MOST_RECORDS).contains(&n) || problem.machine.period_pitches().is_some() || !(0..n).all(is_single) {
        return Vec::new();
    }
    let set_of = |k: usize| data.set.get(data.segments[k].record);
    let sets_differ = (1..n).any(|k| set_of(k) != set_of(0));
    if !sets_differ && problem.machine.inputs.is_empty() {
        return Vec::new();
    }
    // The error of a segment over its signal, with what another segment has.
    let mut changed = data.clone();
    let mut error = |own: usize, other: usize| -> f64 {
        let (inputs, theirs) = (&data.segments[own].task.inputs, &data.segments[other].task.inputs);
        if context.must_end() {
            return f64::NAN;
        }
        if sets_differ {
            changed.set[data.segments[own].record].clone_from(&data.set[data.segments[other].record]);
        } else if inputs.iter().map(Vec::len).eq(theirs.iter().map(Vec::len)) {
            changed.segments[own].task.inputs.clone_from(theirs);
        } else {
            return f64::NAN;
        }
        let with = Problem { data: &changed, ..problem.clone() };
        let model = with.model(own, &start.globals, &start.locals[own], false);
        changed.set[data.segments[own].record].clone_from(&data.set[data.segments[own].record]);
        changed.segments[own].task.inputs.clone_from(inputs);
        let Ok(model) = model else { return f64::NAN };
        let of = |(measured, model): (&Vec<f64>, &Vec<f64>)| {
            let known = || measured.iter().zip(model).filter(|(y, _)| y.is_finite());
            let count = known().count().max(1) as f64;
            let mean = known().map(|(y, _)| y).sum::<f64>() / count;
            let signal: f64 = known().map(|(y, _)| (y - mean) * (y - mean)).sum();
            let left: f64 = known().map(|(y, m)| (y - m) * (y - m)).sum();
            // At a steady speed, a ripple is no signal that tells two records apart.
            left / (signal + count * (LEAST_ERROR * mean).powi(2)).max(1e-300)
        };
        let channels = model.len().max(1) as f64;
        libm::sqrt(data.segments[own].measured.iter().zip(&model).map(of).sum::<f64>() / channels)
    };
    let own: Vec<f64> = (0..n).map(|k| error(k, k)).collect();
    let mut all = Vec::new();
    for i in (0..n).filter(|k| own[*k] > LEAST_ERROR) {
        for j in (i + 1..n).filter(|k| own[*k] > LEAST_ERROR) {
            let crossed = [error(i, j), error(j, i)];
            if crossed[0] < SWAPPED * own[i] && crossed[1] < SWAPPED * own[j] {
                let name = |k: usize| &data.records[data.segments[k].record];
                let what = if sets_differ { "what the other one sets" } else { "the inputs of the other one" };
                all.push(format!(
                    "the labels of records `{}` and `{}` may be swapped: with {what}, the errors of the declared drive fall from {:.0} and {:.0} to {:.0} and {:.0} % of the signal",
                    name(i), name(j), 100.0 * own[i], 100.0 * own[j], 100.0 * crossed[0], 100.0 * crossed[1]
                ));
            }
        }
    }
    all
}
