//! Splits measured files into the record segments that a model simulates: rows, times, initial states, fitting and
//! judging samples.

use super::bind::{BoundColumns, bind};
use super::clocks::{self, OwnSamples};
use super::columns::{ColumnSelection, Columns, Memory, read};
use super::facts::{self, Clock, Facts};
use super::pulses::pulse_segments;
use super::units::{MeasuredQuantity, unit};
use super::wheels::{self, FEWEST_EDGES, WheelFacts};
use super::{ChannelSpec, Measurement, PulseValues, RecordSpec, Use};
use crate::diag::{Diag, nearest};
use crate::machine::simulate::{InitialState, Samples, Task};
use crate::machine::{InputKind, Machine, Reads};
use crate::units::DEG;
use std::path::Path;

/// A stretch of a record that is simulated in one run.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordSegment {
    /// Index of its record.
    pub record: usize,
    /// Inputs and sample times of the run.
    pub task: Task,
    /// One series for every channel, SI (or the sensor's own unit); pulses: ln of intervals. Missing: NaN.
    pub measured: Vec<Vec<f64>>,
    /// For every channel the time from each row to the sample that stands there [s]; empty: all stand at their rows, of all channels or of this one.
    pub behind_s: Vec<Vec<f64>>,
    /// Samples before this one fit, the others judge.
    pub judge_from: usize,
    /// An initial estimate of the start state.
    pub start: InitialState,
    /// Whether it starts at rest at zero, so that the initial state is not fitted.
    pub at_rest: bool,
}

impl RecordSegment {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.measured.first().map_or(0, Vec::len)
    }

    /// The task with only the fitting samples.
    pub fn fitting_task(&self) -> Task {
        let mut task = self.task.clone();
        if self.judge_from > 0 {
            match &mut task.samples {
                Samples::Times { t_s, .. } => t_s.truncate(self.judge_from),
                Samples::Pulses { intervals, .. } => *intervals = (*intervals).min(self.judge_from),
            }
        }
        task
    }

    /// Whether it has no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A channel, bound to a sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredChannel {
    /// Name in the measurement file.
    pub name: String,
    /// Path of the sensor in the drive file.
    pub sensor_path: String,
    /// Index of the sensor.
    pub sensor: usize,
    /// Unit of results: that of the column. Values times `shown` are in it.
    pub unit: String,
    /// Value in that unit per value in which the model is compared.
    pub shown: f64,
    /// Standard deviation of its noise in the form in which the model is compared (SI, or ln).
    pub noise: f64,
    /// The same of its sensor alone, where `noise` also holds what a prediction does not know of the state.
    pub sensor_noise: f64,
    /// Whether residuals are differences of logarithms, that is, relative errors.
    pub relative: bool,
    /// Spacing of the grid on which the values lie, in the same form as `noise`.
    pub quantisation: f64,
}

/// All data of the records.
#[derive(Clone, Debug, PartialEq)]
pub struct Data {
    /// Measured quantities, in the order of the measurement file.
    pub channels: Vec<MeasuredChannel>,
    /// Names of the records.
    pub records: Vec<String>,
    /// Segments of the records that fit or judge.
    pub segments: Vec<RecordSegment>,
    /// Segments of records that neither fit nor judge.
    pub transfer: Vec<RecordSegment>,
    /// Facts about every channel in every record.
    pub facts: Vec<Facts>,
    /// Facts about the sampling of every record.
    pub clocks: Vec<Clock>,
    /// What the edges of toothed wheels show in every record.
    pub wheels: Vec<WheelFacts>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// Expected content that the measured files lack.
    pub missing: Vec<String>,
    /// Operating points: for every record the slots it sets, SI.
    pub set: Vec<Vec<(usize, f64)>>,
}

/// Why data cannot be used.
#[derive(Clone, Debug, PartialEq)]
pub enum DataError {
    /// Errors in the measurement file.
    File(Box<crate::diag::Report>),
    /// Errors in the measured files.
    World(String),
}

impl std::fmt::Display for DataError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            DataError::File(report) => write!(f, "{report}"),
            DataError::World(text) => write!(f, "error: {text}"),
        }
    }
}

impl std::error::Error for DataError {}

/// Largest magnitude of a measured value, so that squares and their sums do not overflow a float.
const LARGEST_VALUE: f64 = 1e60;
/// Shortest record that is accepted [samples].
const SHORTEST: usize = 16;

/// Reads all files and binds columns to sensors and inputs. `folder` is that of the measurement file. Names and units
/// are checked before a file is opened.
///
/// # Errors
/// The measurement file names what the drive does not have, or a measured file cannot be read, has another form, or needs more memory
/// than `memory` leaves.
pub fn load(
    measurement: &Measurement,
    machine: &Machine,
    folder: &Path,
    memory: &mut Memory,
) -> Result<Data, DataError> {
    let bound = bind(measurement, machine)?;
    let mut tables: Vec<(String, Columns)> = Vec::new();
    for file in &measurement.files {
        let path = folder.join(&file.path);
        let wanted = needed_columns(measurement, &file.name);
        let columns = read(&path, file.layout, ColumnSelection::Named(&wanted), memory);
        let columns = columns.map_err(|e| DataError::World(e.to_string()))?;
        tables.push((file.name.clone(), columns));
    }
    split_into_segments(measurement, machine, bound, &tables)
}

/// Names of the columns that records need from a file.
fn needed_columns(measurement: &Measurement, file: &str) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    let is_beside = |r: &&RecordSpec| r.beside.iter().any(|b| b.file == file);
    let records = || measurement.records.iter().filter(|r| r.file == file || is_beside(r));
    let beside = measurement.records.iter().flat_map(|r| &r.beside).filter(|b| b.file == file);
    names.extend(beside.filter_map(|b| b.time.as_ref().map(|(column, _)| column.clone())));
    names.extend(records().flat_map(|r| r.columns.iter().map(|(_, column)| column.clone())));
    names.extend(records().filter_map(|r| r.time.as_ref().map(|(column, _)| column.clone())));
    names.extend(measurement.channels.iter().map(|c| c.column.clone()));
    names.extend(measurement.inputs.iter().map(|i| i.column.clone()));
    names.extend(measurement.wheels.iter().map(|w| w.column.clone()));
    names
}

/// Splits columns into segments.
fn split_into_segments(
    measurement: &Measurement,
    machine: &Machine,
    BoundColumns { channels, set }: BoundColumns,
    tables: &[(String, Columns)],
) -> Result<Data, DataError> {
    let mut diags = Vec::new();
    let mut data = Data {
        channels,
        records: measurement.records.iter().map(|r| r.name.clone()).collect(),
        segments: Vec::new(),
        transfer: Vec::new(),
        facts: Vec::new(),
        clocks: Vec::new(),
        wheels: Vec::new(),
        warnings: Vec::new(),
        missing: Vec::new(),
        set,
    };
    for (name, columns) in tables {
        data.missing.extend(columns.missing.iter().cloned());
        let said = columns.warnings.iter().chain(&columns.missing);
        data.warnings.extend(said.map(|w| format!("file `{name}`: {w}")));
    }
    let pulses = data.channels.iter().any(|c| c.relative);
    for (index, record) in measurement.records.iter().enumerate() {
        let Some((_, columns)) = tables.iter().find(|(n, _)| *n == record.file) else { continue };
        let used = wheels::used(measurement, record);
        if !record.beside.is_empty() {
            if pulses || !used.is_empty() {
                let title = format!("record `{}` has pulses or edges of wheels, and several files", record.name);
                let help = "such a record takes its columns from one file: leave `beside` out";
                diags.push(measurement.places.error(
                    &format!("records.{}.beside", record.name),
                    title,
                    Some(help.into()),
                ));
                continue;
            }
            if let Some(joined) = clocks::joined(measurement, record, tables, &mut diags) {
                let columns = (&joined.columns, &joined.own[..]);
                sampled_segment(measurement, machine, (index, &joined.record), columns, &mut data, &mut diags);
            }
            continue;
        }
        let with_wheels;
        let columns = if used.is_empty() {
            columns
        } else {
            let found = wheels::with_wheels(measurement, record, (columns, &used), &mut diags);
            let Some((edges, facts, warnings)) = found else { continue };
            data.wheels.extend(facts);
            data.warnings.extend(warnings);
            with_wheels = edges;
            &with_wheels
        };
        if pulses {
            pulse_segments(measurement, machine, (index, record), columns, &mut data, &mut diags);
        } else {
            sampled_segment(measurement, machine, (index, record), (columns, &[]), &mut data, &mut diags);
        }
    }
    let elsewhere = |s: &RecordSegment| measurement.records.get(s.record).is_some_and(|r| r.usage == Use::Transfer);
    (data.transfer, data.segments) = std::mem::take(&mut data.segments).into_iter().partition(elsewhere);
    if diags.is_empty() {
        assign_judging_samples(measurement, &mut data, &mut diags);
        check_parts(measurement, &data, &mut diags);
    }
    if !diags.is_empty() {
        return Err(DataError::File(Box::new(measurement.places.report(diags))));
    }
    set_noise(&mut data, measurement);
    data.channels.iter_mut().for_each(|channel| channel.sensor_noise = channel.noise);
    Ok(data)
}

/// The rows `from..to` of a column for a channel, an input or the time of a record.
pub(super) fn column_of<'a>(
    measurement: &Measurement,
    record: &RecordSpec,
    columns: &'a Columns,
    (from, to): (usize, usize),
    (kind, name, column): (&str, &str, &str),
    diags: &mut Vec<Diag>,
) -> Option<&'a [f64]> {
    let own = record.columns.iter().find(|(n, _)| n == name).map(|(_, c)| c.as_str());
    let wanted = own.unwrap_or(column);
    let at = match own {
        Some(_) => format!("records.{}.columns.{name}", record.name),
        None => format!("{kind}.{name}.column"),
    };
    let mut mistake = |at: &str, title: String, help: Option<String>| {
        let diag = measurement.places.error(at, title, help);
        if !diags.contains(&diag) {
            diags.push(diag);
        }
    };
    let Some(index) = columns.find(wanted) else {
        let help = match nearest(wanted, columns.names.iter().map(String::as_str)) {
            Some(near) => format!("did you mean \"{near}\"?"),
            None => {
                let shown: Vec<&str> = columns.names.iter().take(12).map(String::as_str).collect();
                format!("columns there: {}", shown.join(", "))
            }
        };
        mistake(&at, format!("file `{}` has no column \"{wanted}\"", record.file), Some(help));
        return None;
    };
    if let Some(wrong) = columns.wrong.get(index).and_then(Option::as_ref) {
        mistake(&at, format!("file `{}`: {wrong}", record.file), None);
        return None;
    }
    let declared = match kind {
        "channels" => measurement.channels.iter().find(|c| c.name == name).map(|c| c.unit.as_str()),
        "inputs" => measurement.inputs.iter().find(|i| i.name == name).map(|i| i.unit.as_str()),
        _ => record.time.as_ref().map(|(_, unit)| unit.as_str()),
    };
    let own_unit = columns.units.get(index).and_then(Option::as_deref);
    // These units are ambiguous: `1/s` stands for revolutions and radians, `g` for grams and gravity.
    let own_unit = own_unit.filter(|u| !matches!(*u, "1/s" | "g"));
    if let (Some(declared), Some(own_unit)) = (declared, own_unit) {
        // Unknown units are assumed to be as declared.
        if let (Some((q, size)), Some((own_q, own_size))) = (unit(declared), unit(own_unit))
            && (q != own_q || (size - own_size).abs() > 1e-9 * size)
        {
            let title = format!("`{wanted}` is in {own_unit} by file `{}`, not in {declared}", record.file);
            let (at, help) = match kind {
                "records" => (format!("records.{}.time_unit", record.name), None),
                _ => (format!("{kind}.{name}.unit"), Some(format!("write `unit = \"{own_unit}\"`"))),
            };
            mistake(&at, title, help);
            return None;
        }
    }
    let values = columns.values.get(index).map_or(&[][..], Vec::as_slice);
    let part = values.get(from..to);
    if part.is_none() {
        let title = format!("column \"{wanted}\" of file `{}` ends after {} values", record.file, values.len());
        mistake(&at, title, Some(format!("record `{}` reaches to row {to}", record.name)));
    }
    part
}

/// Rows of a record: first, and one after the last, counted from 0.
pub(super) fn rows_of(
    measurement: &Measurement,
    record: &RecordSpec,
    columns: &Columns,
    diags: &mut Vec<Diag>,
) -> Option<(usize, usize)> {
    let to = record.to_row.unwrap_or(columns.rows());
    if to > columns.rows() || record.from_row > columns.rows() {
        let title = format!(
            "record `{}` reaches to row {}, and the file has {} rows",
            record.name,
            to.max(record.from_row),
            columns.rows()
        );
        diags.push(measurement.places.error(&format!("records.{}.to_row", record.name), title, None));
        return None;
    }
    if to - (record.from_row - 1) < SHORTEST {
        let title = format!("record `{}` has {} samples", record.name, to + 1 - record.from_row);
        let help = format!("at least {SHORTEST} are needed");
        diags.push(measurement.places.error(&format!("records.{}", record.name), title, Some(help)));
        return None;
    }
    Some((record.from_row - 1, to))
}

/// Times of a record from 0, or an error.
pub(super) fn times_of(
    measurement: &Measurement,
    record: &RecordSpec,
    columns: &Columns,
    (from, to): (usize, usize),
    diags: &mut Vec<Diag>,
) -> Option<Vec<f64>> {
    let at = format!("records.{}", record.name);
    match (&record.time, record.rate_hz) {
        (None, Some(rate)) => Some((0..to - from).map(|i| i as f64 / rate).collect()),
        (Some((name, unit_name)), None) => {
            let what = ("records", record.name.as_str(), name.as_str());
            let values = column_of(measurement, record, columns, (from, to), what, diags)?;
            let Some((MeasuredQuantity::Time, factor)) = unit(unit_name) else {
                let title = format!("`{unit_name}` is no unit of time");
                diags.push(measurement.places.error(&format!("{at}.time_unit"), title, Some("s, ms, us".into())));
                return None;
            };
            let first = values.first().copied().unwrap_or(0.0);
            let mut before = f64::NAN;
            for (i, value) in values.iter().enumerate() {
                if value.is_finite() && (i == 0 || *value > before) {
                    before = *value;
                    continue;
                }
                let title = format!(
                    "time does not grow: column \"{name}\" of file `{}` has {value} after {before} at line {}",
                    record.file,
                    columns.first_line + from + i
                );
                diags.push(measurement.places.error(&format!("{at}.time_column"), title, None));
                return None;
            }
            let times: Vec<f64> = values.iter().map(|v| (v - first) * factor).collect();
            // The following steps divide by the step and count steps.
            let step_s = times.last().map_or(0.0, |last| last / times.len() as f64);
            if !step_s.is_normal() {
                let title = format!(
                    "column \"{name}\" of file `{}` goes from {first:e} to {before:e} {unit_name}: no time that can be run",
                    record.file
                );
                diags.push(measurement.places.error(&format!("{at}.time_column"), title, None));
                return None;
            }
            Some(times)
        }
        _ => {
            let title = format!("the times of record `{}` are not stated in one way", record.name);
            let help = "write `rate_hz`, or `time_column` with `time_unit`";
            diags.push(measurement.places.error(&at, title, Some(help.into())));
            None
        }
    }
}

/// `own`: channels that lie in other files.
fn sampled_segment(
    measurement: &Measurement,
    machine: &Machine,
    (index, record): (usize, &RecordSpec),
    (columns, own): (&Columns, &[OwnSamples]),
    data: &mut Data,
    diags: &mut Vec<Diag>,
) {
    let Some((from, to)) = rows_of(measurement, record, columns, diags) else { return };
    let times = times_of(measurement, record, columns, (from, to), diags);
    let mut measured = Vec::new();
    for (c, channel) in measurement.channels.iter().zip(data.channels.clone()) {
        let what = ("channels", c.name.as_str(), c.column.as_str());
        let Some(raw) = column_of(measurement, record, columns, (from, to), what, diags) else { continue };
        let of_file = own.iter().find(|o| o.channel == c.name).map(|o| o.values.as_slice());
        if of_file.is_none() {
            check_values(measurement, record, c, raw, diags);
        }
        let mut facts = facts::from_values(&record.name, &c.name, &c.unit, of_file.unwrap_or(raw), c.noise);
        if let Some(wheel) = wheels::wheel_of(measurement, record, (&c.name, &c.column)) {
            // Teeth stand on a grid, and not at equal times.
            let points = times.iter().flatten().copied().zip(raw.iter().copied()).filter(|(_, v)| v.is_finite());
            facts.quantisation = 0.0;
            facts.missing = 0;
            let seen = data.wheels.iter().find(|w| w.record == record.name && w.wheel == wheel.name);
            let seen = seen.and_then(|w| w.noise_deg).map(|deg| deg * DEG / unit(&c.unit).map_or(DEG, |(_, f)| f));
            let noise = c.noise.or(seen);
            facts.noise = noise.unwrap_or_else(|| facts::noise_at_times(&points.collect::<Vec<_>>()));
        }
        data.facts.push(facts);
        measured.push(raw.iter().map(|v| v / channel.shown).collect::<Vec<f64>>());
    }
    let mut inputs = Vec::new();
    let mut hold = false;
    for input in &machine.inputs {
        let Some(spec) = measurement.inputs.iter().find(|i| i.input == input.path) else { continue };
        let what = ("inputs", spec.name.as_str(), spec.column.as_str());
        let Some(raw) = column_of(measurement, record, columns, (from, to), what, diags) else { continue };
        if let Some(k) = raw.iter().position(|v| !v.is_finite()) {
            let line = columns.first_line + from + k;
            let title = format!("input `{}` has no value at line {line} of file `{}`", spec.name, record.file);
            let help = "an input must be known at every instant: cut the record there";
            diags.push(measurement.places.error(&format!("inputs.{}", spec.name), title, Some(help.into())));
        }
        let factor = match input.kind {
            InputKind::Force(_) | InputKind::Acceleration => 1.0,
            InputKind::Speed | InputKind::Angle => unit(&spec.unit).map_or(1.0, |(_, f)| f),
        };
        hold |= spec.hold;
        inputs.push(raw.iter().map(|v| v * factor).collect::<Vec<f64>>());
    }
    let Some(t_s) = times else { return };
    if measured.len() < measurement.channels.len() || inputs.len() < machine.inputs.len() {
        return;
    }
    let clock = facts::clock(&record.name, &t_s);
    let even = clock.jitter_percent < 0.01 && clock.gaps == 0;
    // Edges of wheels come as their teeth do.
    if clock.gaps > 0 && wheels::used(measurement, record).is_empty() {
        data.warnings.push(format!(
            "record `{}` has {} gaps in its times; the model runs through them",
            record.name, clock.gaps
        ));
    }
    let step_s = if clock.rate_hz > 0.0 { 1.0 / clock.rate_hz } else { 1.0 };
    let guess = first_guess(machine, &data.channels, &measured, step_s, record.at_rest);
    let start = start_of_wheels(measurement, machine, record, (&t_s, &inputs), &guess);
    if record.judge_from_row.is_some_and(|row| row > to) {
        let title = format!("record `{}` has no row beyond {to}", record.name);
        let help = "`judge_from_row` is the first row that judges";
        diags.push(measurement.places.error(
            &format!("records.{}.judge_from_row", record.name),
            title,
            Some(help.into()),
        ));
        return;
    }
    let judge_from = match (record.usage, record.judge_from_row) {
        (Use::Judge | Use::Transfer, _) => 0,
        (Use::Fit, Some(row)) => row - 1 - from,
        (Use::Fit, None) => to - from,
    };
    let behind = |c: &ChannelSpec| {
        let of_file = own.iter().find(|o| o.channel == c.name);
        of_file.map_or_else(Vec::new, |o| o.behind_s.clone())
    };
    let behind_s = if own.is_empty() { Vec::new() } else { measurement.channels.iter().map(behind).collect() };
    data.clocks.push(clock);
    data.segments.push(RecordSegment {
        record: index,
        task: Task { samples: Samples::Times { t_s, step_s, even }, inputs, hold, start_s: 0.0 },
        measured,
        behind_s,
        judge_from,
        start,
        at_rest: record.at_rest,
    });
}

/// Reports values that no series may have.
pub(super) fn check_values(
    measurement: &Measurement,
    record: &RecordSpec,
    channel: &ChannelSpec,
    raw: &[f64],
    diags: &mut Vec<Diag>,
) {
    let at = format!("channels.{}", channel.name);
    let known: Vec<f64> = raw.iter().copied().filter(|v| v.is_finite()).collect();
    let missing = raw.len() - known.len();
    if let Some(far) = known.iter().find(|v| v.abs() > LARGEST_VALUE) {
        let title = format!("channel `{}` has the value {far:e} in record `{}`", channel.name, record.name);
        let help = "no sensor reads that: leave the field empty where a sample is lost";
        diags.push(measurement.places.error(&at, title, Some(help.into())));
    }
    let of_wheel = wheels::wheel_of(measurement, record, (&channel.name, &channel.column)).is_some();
    if of_wheel && known.len() < FEWEST_EDGES {
        let title = format!("channel `{}` has {} edges in record `{}`", channel.name, known.len(), record.name);
        diags.push(measurement.places.error(&at, title, Some(format!("at least {FEWEST_EDGES} are needed"))));
    }
    if 5 * missing > raw.len() && !of_wheel {
        let title =
            format!("channel `{}` lacks {missing} of {} values in record `{}`", channel.name, raw.len(), record.name);
        let help = "a fifth may be missing at most: cut the record, or take the channel away";
        diags.push(measurement.places.error(&at, title, Some(help.into())));
    } else if known.iter().all(|v| Some(v) == known.first()) {
        let title = format!("channel `{}` is constant in record `{}`", channel.name, record.name);
        diags.push(measurement.places.error(&at, title, Some("it contains no information: remove it".into())));
    }
}

/// Initial speeds and positions, as far as the channels determine them.
#[expect(
    clippy::indexing_slicing,
    reason = "channels are bound to sensors of this machine, whose bodies and numbers are places in its own lists"
)]
pub fn first_guess(
    machine: &Machine,
    channels: &[MeasuredChannel],
    measured: &[Vec<f64>],
    step_s: f64,
    at_rest: bool,
) -> InitialState {
    let n = machine.bodies.len();
    let mut start = InitialState { q: vec![0.0; n], v: vec![0.0; n], travel: 0.0 };
    if at_rest {
        return start;
    }
    let mut known = vec![false; n];
    for (channel, series) in channels.iter().zip(measured) {
        let first = series.iter().copied().find(|v| v.is_finite()).unwrap_or(0.0);
        let sensor = &machine.sensors[channel.sensor];
        let gain = machine.values[sensor.gain];
        match sensor.reads {
            Reads::Speed(b) => {
                start.v[b] = first / gain;
                known[b] = true;
            }
            Reads::Angle(b) => {
                start.q[b] = first / gain;
                // Those of the first samples that are known, or the first two of a series that has few.
                let mut some = series.iter().enumerate().filter(|(_, v)| v.is_finite());
                let from = some.next().map_or(0, |(i, _)| i);
                let second = some.next();
                let last = some.take_while(|(i, _)| *i < 6).last().or(second);
                if let (Some((to, last)), false) = (last, known[b]) {
                    start.v[b] = (last - first) / gain / (step_s * (to - from) as f64);
                    known[b] = true;
                }
            }
            Reads::Acceleration(_) | Reads::Pulses { .. } | Reads::Tension(_) | Reads::Reaction(_) | Reads::Part(_) => {
            }
        }
    }
    tie_others(machine, &mut start, &mut known);
    start
}

/// Bodies on the same springs move along with bodies whose motion is known.
#[expect(
    clippy::indexing_slicing,
    reason = "springs join bodies of this machine, whose numbers are places in its own list"
)]
fn tie_others(machine: &Machine, start: &mut InitialState, known: &mut [bool]) {
    for _ in 0..known.len() {
        for s in &machine.springs {
            let [a, b] = s.ends.as_slice() else { continue };
            for (from, to) in [(a, b), (b, a)] {
                if known[from.body] && !known[to.body] {
                    start.v[to.body] = start.v[from.body] * machine.values[from.gain] / machine.values[to.gain];
                    start.q[to.body] = start.q[from.body] * machine.values[from.gain] / machine.values[to.gain];
                    known[to.body] = true;
                }
            }
        }
    }
}

/// A start in which bodies stand where toothed wheels that drive the model say, and all others on their springs with them.
fn start_of_wheels(
    measurement: &Measurement,
    machine: &Machine,
    record: &RecordSpec,
    (t_s, inputs): (&[f64], &[Vec<f64>]),
    guess: &InitialState,
) -> InitialState {
    let mut start = InitialState { q: vec![0.0; guess.q.len()], v: vec![0.0; guess.v.len()], travel: guess.travel };
    let mut known = vec![false; guess.q.len()];
    for (input, series) in machine.inputs.iter().zip(inputs) {
        let spec = measurement.inputs.iter().find(|i| i.input == input.path);
        let is_wheel = spec.is_some_and(|i| wheels::wheel_of(measurement, record, (&i.name, &i.column)).is_some());
        if let ([first, second, ..], [from, to, ..], true) = (series.as_slice(), t_s, is_wheel)
            && let (Some(q), Some(v), Some(known)) =
                (start.q.get_mut(input.body), start.v.get_mut(input.body), known.get_mut(input.body))
        {
            (*q, *v, *known) = (*first, (second - first) / (to - from), true);
        }
    }
    tie_others(machine, &mut start, &mut known);
    for body in known.iter().enumerate().filter(|(_, known)| !**known).map(|(body, _)| body) {
        if let (Some(q), Some(v)) = (start.q.get_mut(body), start.v.get_mut(body)) {
            (*q, *v) = (guess.q.get(body).copied().unwrap_or(0.0), guess.v.get(body).copied().unwrap_or(0.0));
        }
    }
    start
}

/// If no record judges, the last 30 % of the segments, or of the samples of every segment, are used for judging.
fn assign_judging_samples(measurement: &Measurement, data: &mut Data, diags: &mut Vec<Diag>) {
    let Some(first) = data.segments.first().map(|s| s.record) else {
        let title = "no record fits".to_string();
        diags.push(measurement.places.error("records", title, Some("give one of them `use = \"fit\"`".into())));
        return;
    };
    let judges = data.segments.iter().any(|s| s.judge_from < s.len());
    if !judges {
        data.warnings.push(
            "no record judges: the last 30 % of every record is held out; a separate record (`use = \"judge\"`) would be a stronger test"
                .to_string(),
        );
        let n = data.segments.len();
        let parts = data.segments.iter().filter(|s| s.record == first).count();
        for (k, s) in data.segments.iter_mut().enumerate() {
            let len = s.len();
            s.judge_from = if parts > 3 { if 10 * k >= 7 * n { 0 } else { len } } else { 7 * len / 10 };
        }
    }
    if data.segments.iter().all(|s| s.judge_from == 0) {
        let title = "every record judges, none fits".to_string();
        diags.push(measurement.places.error("records", title, Some("give one of them `use = \"fit\"`".into())));
    }
    let samples: usize = data.segments.iter().map(|s| s.judge_from * s.measured.len()).sum();
    let wanted = measurement.fit.len() * 4;
    if samples < wanted.max(SHORTEST) {
        let title = format!("{samples} samples fit {} numbers", measurement.fit.len());
        let help = format!("at least {} are needed", wanted.max(SHORTEST));
        diags.push(measurement.places.error("records", title, Some(help)));
    }
}

/// Reports channels of other files that the part of a record that fits, or the one that judges, hardly has.
fn check_parts(measurement: &Measurement, data: &Data, diags: &mut Vec<Diag>) {
    for s in &data.segments {
        for (c, (channel, series)) in measurement.channels.iter().zip(&s.measured).enumerate() {
            if s.behind_s.get(c).is_none_or(Vec::is_empty) {
                continue;
            }
            let (fit, judge) = series.split_at(s.judge_from.min(series.len()));
            for (part, what) in [(fit, "fits"), (judge, "judges")] {
                let known = part.iter().filter(|v| v.is_finite()).count();
                if !part.is_empty() && known < clocks::FEWEST {
                    let record = data.records.get(s.record).map_or("", String::as_str);
                    let title =
                        format!("`{}` has {known} samples in the part of record `{record}` that {what}", channel.name);
                    let help = format!("at least {} are needed", clocks::FEWEST);
                    diags.push(measurement.places.error(&format!("records.{record}"), title, Some(help)));
                }
            }
        }
    }
}

/// Noise floors of the channels in the form in which they are compared: the median over records.
fn set_noise(data: &mut Data, measurement: &Measurement) {
    for (c, (spec, channel)) in measurement.channels.iter().zip(&mut data.channels).enumerate() {
        let elsewhere = |name: &str| measurement.records.iter().any(|r| r.name == name && r.usage == Use::Transfer);
        let of = data.facts.iter().filter(|f| f.channel == spec.name && !elsewhere(&f.record));
        let mut steps: Vec<f64> = of.clone().map(|f| f.quantisation).collect();
        let mut noises: Vec<f64> = of.map(|f| f.noise).collect();
        if !channel.relative {
            channel.noise = facts::median(&mut noises) / channel.shown;
            channel.quantisation = facts::median(&mut steps) / channel.shown;
            continue;
        }
        // Intervals one revolution apart differ by noise and a slow change: second differences over revolutions,
        // variance 6 sigma^2.
        let marks = 1 + data
            .segments
            .iter()
            .map(|s| match s.task.samples {
                Samples::Pulses { first, .. } => first,
                Samples::Times { .. } => 0,
            })
            .max()
            .unwrap_or(0);
        let series = || data.segments.iter().filter_map(|s| s.measured.get(c));
        let mut squares = Vec::new();
        for m in series() {
            let turns = m.iter().zip(m.iter().skip(marks)).zip(m.iter().skip(2 * marks));
            for ((before, middle), after) in turns {
                let d = after - 2.0 * middle + before;
                if d.is_finite() {
                    squares.push(d * d / 6.0);
                }
            }
        }
        channel.noise = facts::deviation_by_median(&mut squares);
        let mean_interval =
            series().flatten().filter(|v| v.is_finite()).fold((0.0, 0.0_f64), |(a, n), v| (a + libm::exp(*v), n + 1.0));
        let step = facts::median(&mut steps) / (mean_interval.0 / mean_interval.1.max(1.0));
        channel.quantisation = step;
        // What the file states counts in place of what the samples show: an interval is the difference of two times.
        if let Some(stated) = spec.noise {
            let of_interval = match spec.values {
                PulseValues::Intervals => 1.0,
                PulseValues::Times => std::f64::consts::SQRT_2,
            };
            let in_s = stated * unit(&spec.unit).map_or(1.0, |(_, f)| f);
            channel.noise = of_interval * in_s / (mean_interval.0 / mean_interval.1.max(1.0));
        }
        channel.noise = channel.noise.max(step / libm::sqrt(12.0));
    }
}
