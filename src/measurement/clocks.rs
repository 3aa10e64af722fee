//! Records whose channels and inputs lie in several files, each by a clock of its own.
//!
//! ```text
//! t = (1 + drift) t_file + offset - t_first        t_first: time of the record's first row, in its own file
//! ```
//! The model runs at the rows of the record's own file. A value of another file is taken over at the row nearest to it in time, from the cubic
//! through the four values about that row; so each gives one value at most, and none is made up where that file is slower. An input is known
//! everywhere: it is taken at every row, on the straight line between its values, or the last of them where it holds.

use super::columns::Columns;
use super::segments::{check_values, column_of, rows_of, times_of};
use super::units::unit;
use super::{Measurement, RecordSpec};
use crate::diag::Diag;

/// Another file of a record, with a clock of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct BesideSpec {
    /// Last part of its path in the measurement file.
    pub name: String,
    /// Name of the file.
    pub file: String,
    /// Names of the channels and inputs that lie in it.
    pub holds: Vec<String>,
    /// Samples per second where no column gives the time [1/s].
    pub rate_hz: Option<f64>,
    /// Column and unit of the time.
    pub time: Option<(String, String)>,
    /// What its clock must be put forward by to show that of the record's own file [s].
    pub offset_s: f64,
    /// Share by which its clock runs slow.
    pub drift: f64,
}

/// A record in one table, as if all its columns lay in one file.
pub(super) struct JoinedRecord {
    pub(super) record: RecordSpec,
    pub(super) columns: Columns,
    /// Channels of other files, each with the samples of its file.
    pub(super) own: Vec<(String, Vec<f64>)>,
}

/// Joins the files of a record; None: `diags` say why not.
pub(super) fn joined(
    measurement: &Measurement,
    record: &RecordSpec,
    tables: &[(String, Columns)],
    diags: &mut Vec<Diag>,
) -> Option<JoinedRecord> {
    let table = |file: &str| tables.iter().find(|(name, _)| name == file).map(|(_, columns)| columns);
    let columns = table(&record.file)?;
    let (from, to) = rows_of(measurement, record, columns, diags)?;
    let t_s = times_of(measurement, record, columns, (from, to), diags)?;
    let begins_s = first_time_s(record, columns, from);
    let mut joined = JoinedRecord { record: record.clone(), columns: columns.clone(), own: Vec::new() };
    joined.record.beside.clear();
    for beside in &record.beside {
        // Errors name its tables in the measurement file.
        let sub = RecordSpec {
            name: format!("{}.beside.{}", record.name, beside.name),
            file: beside.file.clone(),
            rate_hz: beside.rate_hz,
            time: beside.time.clone(),
            from_row: 1,
            to_row: None,
            ..record.clone()
        };
        let own = table(&beside.file)?;
        let rows = rows_of(measurement, &sub, own, diags)?;
        let own_begins_s = first_time_s(&sub, own, 0);
        let own_t_s: Vec<f64> = times_of(measurement, &sub, own, rows, diags)?
            .into_iter()
            .map(|t| (1.0 + beside.drift) * (own_begins_s + t) + beside.offset_s - begins_s)
            .collect();
        for name in &beside.holds {
            let channel = measurement.channels.iter().find(|c| c.name == *name);
            let input = measurement.inputs.iter().find(|i| i.name == *name);
            let found = match (channel, input) {
                (Some(c), _) => {
                    let what = ("channels", c.name.as_str(), c.column.as_str());
                    let raw = column_of(measurement, &sub, own, rows, what, diags)?;
                    check_values(measurement, &sub, c, raw, diags);
                    joined.own.push((c.name.clone(), raw.to_vec()));
                    nearest_values(&t_s, &own_t_s, raw)
                }
                (None, Some(i)) => {
                    let what = ("inputs", i.name.as_str(), i.column.as_str());
                    let raw = column_of(measurement, &sub, own, rows, what, diags)?;
                    values_between(&t_s, &own_t_s, raw, i.hold)
                }
                (None, None) => continue,
            };
            let known = found.iter().filter(|v| v.is_finite()).count();
            let (needed, kind) =
                if channel.is_some() { (SHORTEST_SHARED, "channels") } else { (found.len(), "inputs") };
            if known < needed {
                let span = |t: &[f64]| (t.first().copied().unwrap_or(0.0), t.last().copied().unwrap_or(0.0));
                let ((_, last), (own_first, own_last)) = (span(&t_s), span(&own_t_s));
                let title = format!(
                    "file `{}` knows `{name}` at {known} of {} rows of record `{}`",
                    beside.file,
                    found.len(),
                    record.name
                );
                let help = format!(
                    "by `offset_ms` and `drift_percent` it goes from {own_first:.6} s to {own_last:.6} s of the record, which ends at {last:.6} s: cut the record, or set its clock"
                );
                diags.push(measurement.places.error(&format!("records.{}", sub.name), title, Some(help)));
                continue;
            }
            let mut values = vec![f64::NAN; joined.columns.rows];
            values.get_mut(from..to)?.copy_from_slice(&found);
            let column = format!("{} of {}", name, beside.name);
            joined.columns.names.push(column.clone());
            joined.columns.values.push(values);
            joined.columns.wrong.push(None);
            joined.columns.units.push(None);
            joined.record.columns.retain(|(known, _)| known != name);
            joined.record.columns.push((name.clone(), column));
        }
    }
    diags.is_empty().then_some(joined)
}

/// Rows at which a channel of another file must be known.
const SHORTEST_SHARED: usize = 16;

/// Time of a row by the file's own clock [s].
fn first_time_s(record: &RecordSpec, columns: &Columns, row: usize) -> f64 {
    match (&record.time, record.rate_hz) {
        (Some((name, unit_name)), _) => {
            let values = columns.find(name).and_then(|i| columns.values.get(i));
            let value = values.and_then(|v| v.get(row)).copied().unwrap_or(0.0);
            value * unit(unit_name).map_or(1.0, |(_, factor)| factor)
        }
        (None, Some(rate_hz)) => row as f64 / rate_hz,
        (None, None) => 0.0,
    }
}

/// Known samples of a series.
fn known(own_t_s: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    own_t_s.iter().copied().zip(values.iter().copied()).filter(|(_, v)| v.is_finite()).collect()
}

/// Values at the times `t_s` that are nearest to some sample of the series; NaN at the others.
fn nearest_values(t_s: &[f64], own_t_s: &[f64], values: &[f64]) -> Vec<f64> {
    let own = known(own_t_s, values);
    let mut found = vec![f64::NAN; t_s.len()];
    for (t, _) in &own {
        let after = t_s.partition_point(|row| row < t);
        let before = after.saturating_sub(1);
        let off = |row: usize| t_s.get(row).map_or(f64::INFINITY, |at| (at - t).abs());
        let row = if off(before) <= off(after) { before } else { after };
        // Beyond the ends of the record a sample has no row: it must lie within half a step.
        let step = t_s.get(row + 1).zip(t_s.get(row)).or(t_s.get(row).zip(row.checked_sub(1).and_then(|b| t_s.get(b))));
        let is_inside = step.is_some_and(|(a, b)| off(row) <= 0.5 * (a - b).abs() * (1.0 + 1e-9));
        if let (Some(at), Some(slot), true) = (t_s.get(row), found.get_mut(row), is_inside) {
            *slot = cubic_at(&own, *at);
        }
    }
    found
}

/// The polynomial through the four samples about a time; of fewer where there are no more.
fn cubic_at(own: &[(f64, f64)], t: f64) -> f64 {
    let after = own.partition_point(|(at, _)| *at < t);
    let first = after.saturating_sub(2).min(own.len().saturating_sub(4));
    let four = own.get(first..(first + 4).min(own.len())).unwrap_or_default();
    let weight =
        |own: f64| -> f64 { four.iter().filter(|(at, _)| *at != own).map(|(at, _)| (t - at) / (own - at)).product() };
    four.iter().map(|(at, v)| v * weight(*at)).sum()
}

/// Values at all times `t_s`: on straight lines, or the last one; NaN where the series does not reach.
fn values_between(t_s: &[f64], own_t_s: &[f64], values: &[f64], holds: bool) -> Vec<f64> {
    let own = known(own_t_s, values);
    let at = |t: &f64| {
        let after = own.partition_point(|(at, _)| at <= t);
        let before = after.checked_sub(1).and_then(|k| own.get(k));
        match (before, own.get(after)) {
            (Some((_, v)), _) if holds => *v,
            (Some((a, v)), Some((b, w))) => v + (w - v) * (t - a) / (b - a),
            // The last sample itself.
            (Some((a, v)), None) if a == t => *v,
            (Some(_) | None, None) | (None, Some(_)) => f64::NAN,
        }
    };
    t_s.iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sample_gives_one_value_at_the_row_nearest_to_it() {
        let t: Vec<f64> = (0..10).map(f64::from).collect();
        let own: Vec<f64> = (0..5).map(|i| 0.3 + 2.0 * f64::from(i)).collect();
        let cube = |t: f64| 1.0 + t - 0.5 * t * t + 0.1 * t * t * t;
        let values: Vec<f64> = own.iter().map(|t| cube(*t)).collect();
        let found = nearest_values(&t, &own, &values);
        for (t, v) in t.iter().zip(&found) {
            let is_near = (t / 2.0).fract() == 0.0;
            assert_eq!(v.is_finite(), is_near, "{t}");
            assert!(!is_near || (v - cube(*t)).abs() < 1e-12, "{t}: {v}");
        }
        // A faster series has a value at every row that it reaches, and none beyond.
        let own: Vec<f64> = (0..12).map(|i| 2.1 + 0.4 * f64::from(i)).collect();
        let values: Vec<f64> = own.iter().map(|t| cube(*t)).collect();
        let found = nearest_values(&t, &own, &values);
        let reached: Vec<bool> = found.iter().map(|v| v.is_finite()).collect();
        assert_eq!(reached, [false, false, true, true, true, true, true, false, false, false]);
    }

    #[test]
    fn an_input_lies_on_lines_or_holds() {
        let t = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5];
        let (own, values) = ([0.0, 1.0, 2.0], [1.0, 3.0, 2.0]);
        let found = values_between(&t, &own, &values, false);
        assert_eq!(found[..5], [1.0, 2.0, 3.0, 2.5, 2.0]);
        assert!(found[5].is_nan());
        assert_eq!(values_between(&t, &own, &values, true), [1.0, 1.0, 3.0, 3.0, 2.0, 2.0]);
        assert!(values_between(&[-0.1], &own, &values, true)[0].is_nan());
    }
}
