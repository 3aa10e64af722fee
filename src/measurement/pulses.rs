//! Records of a pulse pickup: missed pulses, stretches in which a body coasts, and the mark with which each begins.

use super::columns::Columns;
use super::facts;
use super::segments::{Data, RecordSegment, column_of, rows_of};
use super::units::unit;
use super::{Measurement, PulseValues, RecordSpec, Split, Use};
use crate::diag::Diag;
use crate::machine::simulate::{InitialState, Samples, Task};
use crate::machine::{Machine, Reads, Sensor};
use std::f64::consts::PI;

/// Maximum ratio of the usual interval to the shortest one, and of the longest one to the usual. The shortest sets the
/// step of the model, the longest how long it waits for a pulse.
const MAX_BELOW_USUAL: f64 = 1e5;
const MAX_ABOVE_USUAL: f64 = 1e8;

/// Inserts missed pulses as unknown intervals: ln of the interval, or NaN; times; and the number of missed pulses.
fn with_missed(intervals: &[f64]) -> (Vec<f64>, Vec<f64>, usize) {
    let mut values = Vec::with_capacity(intervals.len());
    let mut times = Vec::with_capacity(intervals.len());
    let mut missed = 0;
    let mut t = 0.0;
    for (i, dt) in intervals.iter().enumerate() {
        // Neighbours on both sides, most of which are not affected.
        let low = i.saturating_sub(3);
        let near = intervals.iter().enumerate().take(i + 4).skip(low);
        let mut near: Vec<f64> = near.filter(|(k, _)| *k != i).map(|(_, dt)| *dt).collect();
        let usual = facts::median(&mut near);
        let times_longer = dt / usual;
        let whole = libm::round(times_longer);
        // Next to a pause the neighbours are no reference.
        if (2.0..=4.0).contains(&whole) && (times_longer - whole).abs() < 0.15 * whole {
            #[expect(clippy::cast_possible_truncation, reason = "2, 3 or 4")]
            let parts = whole as usize;
            missed += parts - 1;
            for k in 0..parts {
                values.push(f64::NAN);
                times.push(t + dt * k as f64 / whole);
            }
        } else {
            values.push(libm::log(*dt));
            times.push(t);
        }
        t += dt;
    }
    (values, times, missed)
}

/// Stretches in which the flywheel slows down: the mean interval of the next two revolutions is longer than that of the
/// last two. Two revolutions at each end are left out, because they may overlap with driven motion.
fn coasting(ln_dt: &[f64], marks: usize, at_least: usize) -> Vec<(usize, usize)> {
    let turns = 2 * marks;
    let mean = |a: usize, b: usize| {
        let part = ln_dt.get(a..b)?;
        let known = || part.iter().filter(|v| v.is_finite());
        let n = known().count();
        // Half of the values are enough.
        if 2 * n >= part.len() { Some(known().sum::<f64>() / n as f64) } else { None }
    };
    let slows = |i: usize| {
        let (behind, ahead) = (mean(i - turns, i), mean(i, i + turns));
        // Within two revolutions the intervals never double by coasting: that is a pause.
        matches!((behind, ahead), (Some(a), Some(b)) if b > a && b < a + std::f64::consts::LN_2)
    };
    let mut parts = Vec::new();
    let mut from = None;
    for i in turns..=ln_dt.len() {
        let on = i + turns <= ln_dt.len() && slows(i);
        match (on, from) {
            (true, None) => from = Some(i),
            (false, Some(start)) => {
                let (a, b) = (start + turns, i.saturating_sub(turns));
                if b > a + at_least {
                    parts.push((a, b));
                }
                from = None;
            }
            _ => {}
        }
    }
    parts
}

pub(super) fn pulse_segments(
    measurement: &Measurement,
    machine: &Machine,
    (index, record): (usize, &RecordSpec),
    columns: &Columns,
    data: &mut Data,
    diags: &mut Vec<Diag>,
) {
    let Some((from, to)) = rows_of(measurement, record, columns, diags) else { return };
    let (Some(spec), Some(channel)) = (measurement.channels.first(), data.channels.first()) else { return };
    let Some(&Sensor { reads: Reads::Pulses { body, marks }, .. }) = machine.sensors.get(channel.sensor) else {
        return;
    };
    let what = ("channels", spec.name.as_str(), spec.column.as_str());
    let Some(column) = column_of(measurement, record, columns, (from, to), what, diags) else { return };
    let factor = unit(&spec.unit).map_or(1.0, |(_, f)| f);
    let raw: Vec<f64> = column.iter().map(|v| v * factor).collect();
    let intervals: Vec<f64> = match spec.values {
        PulseValues::Intervals => raw,
        PulseValues::Times => raw.array_windows().map(|[a, b]| b - a).collect(),
    };
    if let Some((k, dt)) = intervals.iter().enumerate().find(|(_, dt)| !(dt.is_finite() && **dt > 0.0)) {
        let title = format!(
            "pulse {} at line {} of file `{}` comes {dt} s after the one before it",
            k + 1,
            columns.first_line + from + k,
            record.file
        );
        let help = match spec.values {
            PulseValues::Intervals => "are these times of pulses? Then write `values = \"times\"`",
            PulseValues::Times => "times must grow; are these intervals? Then leave `values` out",
        };
        diags.push(measurement.places.error(&format!("channels.{}.column", spec.name), title, Some(help.into())));
        return;
    }
    let mut facts = facts::from_values(&record.name, &spec.name, "s", &intervals, spec.noise.map(|n| n * factor));
    facts.rest_samples = 0;
    facts.rest_mean = None;
    data.facts.push(facts);
    let (ln_dt, times, missed) = with_missed(&intervals);
    let mut starts: Vec<f64> = times.clone();
    starts.push(times.last().copied().unwrap_or(0.0) + intervals.last().copied().unwrap_or(0.0));
    data.clocks.push(facts::clock(&record.name, &starts));
    if missed > 0 {
        data.warnings.push(format!(
            "record `{}`: {missed} pulses were missed; marks are counted through them, and their intervals not compared",
            record.name
        ));
    }
    let parts = match record.split {
        Split::Whole => vec![(0, ln_dt.len())],
        Split::Coasting { at_least } => coasting(&ln_dt, marks, at_least),
    };
    if parts.is_empty() {
        let title = format!("record `{}` never runs down freely", record.name);
        let help = "lower `at_least_pulses`, or leave `split` out";
        diags.push(measurement.places.error(&format!("records.{}", record.name), title, Some(help.into())));
        return;
    }
    let gap = 2.0 * PI / marks as f64;
    let n_parts = parts.len();
    #[expect(clippy::cast_possible_truncation, reason = "at most the number of parts, of which a share is taken")]
    let judged = record.judge_share.map_or(0, |share| libm::round(share * n_parts as f64) as usize);
    for (k, (a, b)) in parts.into_iter().enumerate() {
        // Initial speed and slowest step from the known intervals of the stretch.
        let (Some(part), Some(start_s)) = (ln_dt.get(a..b), times.get(a)) else { continue };
        let known: Vec<f64> = part.iter().copied().filter(|v| v.is_finite()).collect();
        let Some(first) = known.first() else { continue };
        let mean = known.iter().take(marks).sum::<f64>() / known.len().min(marks) as f64;
        let shortest = known.iter().copied().fold(f64::MAX, f64::min);
        let longest = known.iter().copied().fold(f64::MIN, f64::max);
        let usual = facts::median(&mut known.clone());
        if usual - shortest > libm::log(MAX_BELOW_USUAL) || longest - usual > libm::log(MAX_ABOVE_USUAL) {
            let title = format!(
                "pulses of record `{}` come {:.3e} to {:.3e} s after one another, most {:.3e} s: no one step suits all",
                record.name,
                libm::exp(shortest),
                libm::exp(longest),
                libm::exp(usual)
            );
            let help = "cut the record there (`from_row`, `to_row`)";
            diags.push(measurement.places.error(&format!("records.{}", record.name), title, Some(help.into())));
            return;
        }
        let mut start =
            InitialState { travel: 0.0, q: vec![0.0; machine.bodies.len()], v: vec![0.0; machine.bodies.len()] };
        if let Some(speed) = start.v.get_mut(body) {
            *speed = gap / libm::exp(mean.min(first + 1.0));
        }
        let n = part.len();
        let judge_from = match record.usage {
            Use::Judge | Use::Transfer => 0,
            Use::Fit if k >= n_parts - judged => 0,
            Use::Fit => n,
        };
        data.segments.push(RecordSegment {
            behind_s: Vec::new(),
            record: index,
            task: Task {
                samples: Samples::Pulses {
                    intervals: n,
                    first: a % marks,
                    interval_s: libm::exp(shortest),
                    longest_s: libm::exp(longest),
                },
                inputs: Vec::new(),
                hold: false,
                start_s: *start_s,
            },
            measured: vec![part.to_vec()],
            judge_from,
            start,
            at_rest: false,
        });
    }
}
