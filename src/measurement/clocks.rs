//! Records whose channels and inputs lie in several files, each by a clock of its own.
//!
//! ```text
//! t = (1 + drift) t_file + offset - t_first        t_first: time of the record's first row, in its own file
//! ```
//! The model runs at the rows of the record's own file. A sample of a channel of another file stands at the row nearest to it, one at most, and the
//! model is read between its rows for it, at the sample's own time: what is measured stays as it is, noise included. An input is taken at every row,
//! on the straight line between its values, or the last of them where it holds.

use super::columns::Columns;
use super::facts::median;
use super::segments::{check_values, column_of, rows_of, times_of};
use super::units::unit;
use super::{ChannelSpec, InputSpec, Measurement, RecordSpec};
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
    /// Share by which its clock runs slow, about time zero of that clock.
    pub drift: f64,
}

/// A channel of another file.
pub(super) struct OwnSamples {
    pub(super) channel: String,
    /// Samples of its file during the record.
    pub(super) values: Vec<f64>,
    /// Time from each row of the record to the sample that stands there [s].
    pub(super) behind_s: Vec<f64>,
}

/// A record in one table, as if all its columns lay in one file.
pub(super) struct JoinedRecord {
    pub(super) record: RecordSpec,
    pub(super) columns: Columns,
    pub(super) own: Vec<OwnSamples>,
}

/// Another file of a record while it is joined.
struct OtherFile<'a> {
    beside: &'a BesideSpec,
    /// The record in that file; errors name its table in the measurement file.
    record: RecordSpec,
    columns: &'a Columns,
    rows: (usize, usize),
    /// Times of its rows from the record's first row on [s].
    t_s: Vec<f64>,
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
        let own = table(&beside.file)?;
        let Some(other) = other_file(measurement, record, (beside, own), begins_s, diags) else { continue };
        for name in &beside.holds {
            let channel = measurement.channels.iter().find(|c| c.name == *name);
            let input = measurement.inputs.iter().find(|i| i.name == *name);
            let taken = channel.map(|c| {
                let own = channel_at_rows(measurement, c, &other, &t_s, diags)?;
                joined.own.push(own.0);
                Some(own.1)
            });
            let taken = taken.or_else(|| input.map(|i| input_at_rows(measurement, i, &other, &t_s, diags)));
            let Some(found) = taken.flatten() else { continue };
            let mut values = vec![f64::NAN; joined.columns.rows];
            values.get_mut(from..to)?.copy_from_slice(&found);
            // No column of a file has a line end in its name.
            let column = format!("{name}\n{}", beside.name);
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

/// The rows of another file, with their times in the record.
fn other_file<'a>(
    measurement: &Measurement,
    record: &RecordSpec,
    (beside, columns): (&'a BesideSpec, &'a Columns),
    begins_s: f64,
    diags: &mut Vec<Diag>,
) -> Option<OtherFile<'a>> {
    let own = RecordSpec {
        name: format!("{}.beside.{}", record.name, beside.name),
        file: beside.file.clone(),
        rate_hz: beside.rate_hz,
        time: beside.time.clone(),
        from_row: 1,
        to_row: None,
        ..record.clone()
    };
    let rows = rows_of(measurement, &own, columns, diags)?;
    let times = times_of(measurement, &own, columns, rows, diags)?;
    // The large numbers are added up once, so that equal clocks stay equal.
    let scale = 1.0 + beside.drift;
    let first_s = scale * first_time_s(&own, columns, 0) + beside.offset_s - begins_s;
    let t_s = times.into_iter().map(|t| first_s + scale * t).collect();
    Some(OtherFile { beside, record: own, columns, rows, t_s })
}

/// The samples of a channel, and their values at the rows of the record nearest to them.
fn channel_at_rows(
    measurement: &Measurement,
    channel: &ChannelSpec,
    other: &OtherFile<'_>,
    t_s: &[f64],
    diags: &mut Vec<Diag>,
) -> Option<(OwnSamples, Vec<f64>)> {
    let what = ("channels", channel.name.as_str(), channel.column.as_str());
    let raw = column_of(measurement, &other.record, other.columns, other.rows, what, diags)?;
    let is_during = |t: &f64| t_s.first().is_some_and(|first| first <= t) && t_s.last().is_some_and(|last| t <= last);
    let during = other.t_s.iter().zip(raw).filter(|(t, _)| is_during(t));
    let values: Vec<f64> = during.map(|(_, v)| *v).collect();
    let (found, behind_s) = nearest_samples(t_s, &other.t_s, raw);
    if found.iter().filter(|v| v.is_finite()).count() < FEWEST {
        refuse(measurement, other, &channel.name, (&found, t_s), diags);
        return None;
    }
    check_values(measurement, &other.record, channel, &values, diags);
    Some((OwnSamples { channel: channel.name.clone(), values, behind_s }, found))
}

/// An input at all rows of the record.
fn input_at_rows(
    measurement: &Measurement,
    input: &InputSpec,
    other: &OtherFile<'_>,
    t_s: &[f64],
    diags: &mut Vec<Diag>,
) -> Option<Vec<f64>> {
    let what = ("inputs", input.name.as_str(), input.column.as_str());
    let raw = column_of(measurement, &other.record, other.columns, other.rows, what, diags)?;
    let found = values_between(t_s, &other.t_s, raw, input.hold);
    if found.iter().any(|v| !v.is_finite()) {
        refuse(measurement, other, &input.name, (&found, t_s), diags);
        return None;
    }
    Some(found)
}

/// Samples that a channel must have in a record, and in each part of it that fits or judges.
pub(super) const FEWEST: usize = 8;

/// Says how much of a record another file knows.
fn refuse(
    measurement: &Measurement,
    other: &OtherFile<'_>,
    name: &str,
    (found, t_s): (&[f64], &[f64]),
    diags: &mut Vec<Diag>,
) {
    let known = found.iter().filter(|v| v.is_finite()).count();
    let ends = |t: &[f64]| (t.first().copied().unwrap_or(0.0), t.last().copied().unwrap_or(0.0));
    let ((_, last), (own_first, own_last)) = (ends(t_s), ends(&other.t_s));
    let title = format!("file `{}` knows `{name}` at {known} of the record's {} rows", other.beside.file, found.len());
    let help = format!(
        "by `offset_ms` and `drift_percent` it goes from {own_first:.6} s to {own_last:.6} s of the record, which ends at {last:.6} s: cut the record, or set this clock; an input must be known everywhere"
    );
    diags.push(measurement.places.error(&format!("records.{}", other.record.name), title, Some(help)));
}

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

/// The usual time between two rows [s].
fn usual_step_s(t_s: &[f64]) -> f64 {
    median(&mut t_s.array_windows().map(|[a, b]| b - a).collect::<Vec<_>>())
}

/// At each of the times `t_s` the known sample that is nearest to it and to no other of these times, NaN where there is none; and the time from there to
/// the sample [s].
fn nearest_samples(t_s: &[f64], own_t_s: &[f64], values: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut found, mut behind_s) = (vec![f64::NAN; t_s.len()], vec![0.0; t_s.len()]);
    let (Some(first), Some(last)) = (t_s.first(), t_s.last()) else { return (found, behind_s) };
    let own = own_t_s.iter().zip(values).filter(|(t, v)| v.is_finite() && first <= *t && *t <= last);
    for (t, v) in own {
        let after = t_s.partition_point(|row| row < t);
        let before = after.saturating_sub(1);
        let off = |row: usize| t_s.get(row).map_or(f64::INFINITY, |at| (at - t).abs());
        let row = if off(before) <= off(after) { before } else { after };
        if let (Some(at), Some(slot), Some(behind)) = (t_s.get(row), found.get_mut(row), behind_s.get_mut(row))
            && (!slot.is_finite() || (t - at).abs() < behind.abs())
        {
            (*slot, *behind) = (*v, t - at);
        }
    }
    (found, behind_s)
}

/// Values at all times `t_s`: on straight lines, or the last one; NaN where the series does not reach, or has a hole.
fn values_between(t_s: &[f64], own_t_s: &[f64], values: &[f64], holds: bool) -> Vec<f64> {
    let own: Vec<(f64, f64)> = own_t_s.iter().copied().zip(values.iter().copied()).collect();
    let step_s = usual_step_s(own_t_s);
    // Times are sums: what was written as one time may differ in its last digits.
    let same_s = 1e-6 * step_s;
    let at = |t: &f64| {
        let after = own.partition_point(|(at, _)| *at <= t + same_s);
        let before = after.checked_sub(1).and_then(|k| own.get(k));
        match (before, own.get(after)) {
            (Some((a, v)), next) if holds => {
                if next.is_some() || t - a < step_s + same_s {
                    *v
                } else {
                    f64::NAN
                }
            }
            (Some((a, v)), _) if (t - a).abs() <= same_s => *v,
            (Some((a, v)), Some((b, w))) => v + (w - v) * (t - a) / (b - a),
            (Some(_) | None, None) | (None, Some(_)) => f64::NAN,
        }
    };
    t_s.iter().map(at).collect()
}

/// A series of a model, known at the times `t_s`, at the times that lie `behind_s` later: cubics through four neighbours.
pub fn at_own_times(series: &[f64], t_s: &[f64], behind_s: &[f64]) -> Vec<f64> {
    let at = |(i, behind): (usize, &f64)| {
        let here = series.get(i).copied().unwrap_or(f64::NAN);
        if *behind == 0.0 {
            return here;
        }
        let first = (i + usize::from(*behind > 0.0)).saturating_sub(2).min(series.len().saturating_sub(4));
        let four: Vec<(f64, f64)> = t_s.iter().copied().zip(series.iter().copied()).skip(first).take(4).collect();
        let t = t_s.get(i).copied().unwrap_or(f64::NAN) + behind;
        let weight = |own: f64| -> f64 {
            four.iter().filter(|(at, _)| *at != own).map(|(at, _)| (t - at) / (own - at)).product()
        };
        four.iter().map(|(at, v)| v * weight(*at)).sum()
    };
    behind_s.iter().take(series.len()).enumerate().map(at).collect()
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test that reads beyond a list shall fail")]
mod tests {
    use super::*;

    #[test]
    fn each_sample_stands_at_the_row_nearest_to_it() {
        let t: Vec<f64> = (0..10).map(f64::from).collect();
        let own: Vec<f64> = (0..5).map(|i| 0.3 + 2.0 * f64::from(i)).collect();
        let (found, behind) = nearest_samples(&t, &own, &[1.0, 2.0, f64::NAN, 4.0, 5.0]);
        let known: Vec<(usize, f64, f64)> =
            (0..10).filter(|i| found[*i].is_finite()).map(|i| (i, found[i], behind[i])).collect();
        assert_eq!(known.iter().map(|k| (k.0, k.1)).collect::<Vec<_>>(), [(0, 1.0), (2, 2.0), (6, 4.0), (8, 5.0)]);
        assert!(known.iter().all(|k| (k.2 - 0.3).abs() < 1e-12), "{known:?}");
        // A series that is faster than the rows gives each row its nearest sample, and gives none to rows beyond its ends.
        let own: Vec<f64> = (0..12).map(|i| 2.1 + 0.4 * f64::from(i)).collect();
        let values: Vec<f64> = own.clone();
        let (found, behind) = nearest_samples(&t, &own, &values);
        let reached: Vec<usize> = (0..10).filter(|i| found[*i].is_finite()).collect();
        assert_eq!(reached, [2, 3, 4, 5, 6]);
        assert!(
            reached.iter().all(|i| (t[*i] + behind[*i] - found[*i]).abs() < 1e-12 && behind[*i].abs() <= 0.2 + 1e-12)
        );
    }

    #[test]
    fn an_input_lies_on_lines_or_holds() {
        let t = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.5];
        let (own, values) = ([0.0, 1.0 + 1e-9, 2.0], [1.0, 3.0, 2.0]);
        let found = values_between(&t, &own, &values, false);
        let near = |found: &[f64], known: &[f64]| found.iter().zip(known).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near(&found[..5], &[1.0, 2.0, 3.0, 2.5, 2.0]) && found[5].is_nan(), "{found:?}");
        let held = values_between(&t, &own, &values, true);
        assert!(near(&held[..6], &[1.0, 1.0, 3.0, 3.0, 2.0, 2.0]) && held[6].is_nan(), "{held:?}");
        assert!(values_between(&[-0.1], &own, &values, true)[0].is_nan());
        assert!(values_between(&[0.5], &own, &[1.0, f64::NAN, 2.0], false)[0].is_nan());
    }

    #[test]
    fn a_model_is_read_between_its_rows() {
        let t: Vec<f64> = (0..8).map(|i| 0.1 * f64::from(i)).collect();
        let cube = |t: f64| 1.0 + t - 5.0 * t * t + 10.0 * t * t * t;
        let series: Vec<f64> = t.iter().map(|t| cube(*t)).collect();
        let behind = [0.04, -0.03, 0.0, 0.05, -0.05, 0.02, 0.01, -0.04];
        let found = at_own_times(&series, &t, &behind);
        for ((t, behind), v) in t.iter().zip(behind).zip(found) {
            assert!((v - cube(t + behind)).abs() < 1e-12, "{t} {behind} {v}");
        }
    }
}
