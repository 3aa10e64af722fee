//! Toothed wheels under a pickup: the edges of its signal become the angle of the wheel.
//!
//! A wheel has evenly spaced places, some of them without a tooth (36-2-1, 60-2). Between two edges lie whole places: the interval in
//! units of the usual one of its neighbours. The places without a tooth then tell which place is the first. WheelEdges that no tooth makes
//! are left out, teeth without an edge are counted through, and both are told.

use super::columns::Columns;
use super::facts::{deviation_by_median, median};
use super::units::unit;
use super::{Measurement, RecordSpec};
use crate::diag::Diag;
use crate::units::DEG;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::f64::consts::PI;

/// A toothed wheel, and the column with the signal of its pickup.
#[derive(Clone, Debug, PartialEq)]
pub struct WheelSpec {
    /// Last part of its path in the measurement file. Channels and inputs name it as the column `wheels.NAME`.
    pub name: String,
    /// Column with the level of the signal.
    pub column: String,
    /// Whether the signal rises where a tooth is counted.
    pub rising: bool,
    /// Places, with and without teeth.
    pub places: usize,
    /// Places without a tooth, counted from 1.
    pub missing: Vec<usize>,
}

impl WheelSpec {
    /// Whether most gaps between teeth are alike, so that the usual interval of a few neighbours is one gap.
    pub(super) fn has_usual_gap(&self) -> bool {
        let gaps = gaps(self);
        let usual = usual_places(self);
        3 * gaps.iter().filter(|g| **g == usual).count() >= 2 * gaps.len()
    }

    /// What channels and inputs write as their column.
    pub fn column_name(&self) -> String {
        format!("wheels.{}", self.name)
    }
}

/// What the edges of a wheel show.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WheelFacts {
    /// Name of the record.
    pub record: String,
    /// Name of the wheel.
    pub wheel: String,
    /// WheelEdges that teeth make.
    pub edges: usize,
    /// Times of edges that no tooth makes, from the beginning of the record [s].
    pub extra_s: Vec<f64>,
    /// Teeth that made no edge.
    pub missed: usize,
    /// Turns from the first edge to the last.
    pub turns: f64,
    /// Mean, and that of the slowest and of the fastest whole turn.
    pub speed_rpm: [f64; 3],
    /// Waves of the speed over the angle, the largest first.
    pub orders: Vec<SpeedOrder>,
    /// Where the edges stand on the wheel with most edges.
    pub stands_at: Option<StandsAt>,
    /// Standard deviation of a single edge by the wheel with most edges: what differs from turn to turn at the same tooth.
    pub noise_deg: Option<f64>,
}

/// A wave of a wheel's speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SpeedOrder {
    /// Waves per turn.
    pub order: f64,
    /// Amplitude over the mean speed.
    pub speed_percent: f64,
    /// Amplitude of the angle.
    pub angle_deg: f64,
}

/// Angle of a wheel's edges on another wheel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StandsAt {
    /// Name of the other wheel.
    pub wheel: String,
    /// Turns of the other wheel from one edge to the next.
    pub turns_between: f64,
    /// Mean angle after the other wheel's first place, of one of these turns: which one, two pickups do not tell.
    pub angle_deg: f64,
    /// Standard deviation of a single edge.
    pub scatter_deg: f64,
    /// Correlation of an edge's deviation with that of the edge before: 0 for noise, negative where edges go to and fro.
    pub neighbour_correlation: f64,
}

/// WheelEdges with the places of the teeth that made them.
#[derive(Clone, Debug, PartialEq)]
struct WheelEdges {
    t_s: Vec<f64>,
    /// Counted through all turns, from 0 for the first place of the turn in which the record begins.
    places: Vec<i64>,
    extra_s: Vec<f64>,
    missed: usize,
    /// Whether another place could be the first one just as well.
    is_open: bool,
}

/// An interval shorter than this share of the usual one is no interval between teeth.
const TOO_SHORT: f64 = 0.4;
/// An interval is a whole number of places if it differs by less than this share of one.
const WHOLE: f64 = 0.25;
/// Neighbours on each side that tell the usual interval.
const NEIGHBOURS: usize = 5;
/// WheelEdges at least.
pub(super) const FEWEST_EDGES: usize = 8;
/// A ratio of two wheels' turns differs from a multiple of a half by less than this share, or they do not turn together.
const SAME_RATIO: f64 = 0.03;
/// Teeth in a row that may make no edge.
const MOST_MISSED: usize = 6;
/// With more edges that fit no tooth, and teeth without an edge, than these, the wheel is not as the file says.
const MOST_ODD: usize = 4;
const MOST_ODD_PER_TURN: f64 = 0.5;
/// Places from which the speed within a turn is told (more than two for a wave), and orders that are looked at, by halves.
const FINE_WHEEL: usize = 18;
const HIGHEST_ORDER: usize = 8;
const TOLD_ORDERS: usize = 6;
/// An order of this amplitude at most is not told [percent of the mean speed].
const SMALL_PERCENT: f64 = 0.01;

/// Times at which the signal crosses the middle between its lowest and its highest value. Where it has two values only, as from a logic
/// analyser, the row of a change has its time; between samples of a smooth signal the time lies on a straight line.
fn crossings(t_s: &[f64], level: &[f64], rising: bool) -> Vec<f64> {
    // Without the rows that have no level.
    let (t_s, level): (Vec<f64>, Vec<f64>) = t_s.iter().zip(level).filter(|(_, v)| v.is_finite()).unzip();
    let low = level.iter().copied().fold(f64::MAX, f64::min);
    let high = level.iter().copied().fold(f64::MIN, f64::max);
    let middle = 0.5 * (low + high);
    let is_logic = level.iter().all(|v| *v == low || *v == high);
    let rows = t_s.array_windows().zip(level.array_windows());
    rows.filter_map(|([before, now], [from, to])| {
        let crosses = if rising { *from <= middle && *to > middle } else { *from > middle && *to <= middle };
        let share = if is_logic { 1.0 } else { (middle - from) / (to - from) };
        crosses.then(|| before + share * (now - before))
    })
    .collect()
}

/// Usual interval round the interval `i`.
fn usual(intervals: &[f64], i: usize) -> f64 {
    let near = intervals.iter().enumerate().take(i + NEIGHBOURS + 1).skip(i.saturating_sub(NEIGHBOURS));
    median(&mut near.filter(|(k, _)| *k != i).map(|(_, dt)| *dt).collect::<Vec<f64>>())
}

/// Takes edges out that no tooth makes: those that come too soon, and those between two others that are whole places apart.
fn without_extra(t_s: &[f64], usual_places: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut kept, mut extra) = (Vec::with_capacity(t_s.len()), Vec::new());
    let intervals: Vec<f64> = t_s.array_windows().map(|[a, b]| b - a).collect();
    let is_whole = |places: f64| {
        let whole = libm::round(places);
        whole >= 1.0 && (places - whole).abs() < WHOLE
    };
    for (i, t) in t_s.iter().enumerate() {
        let usual = usual(&intervals, i.saturating_sub(1));
        let places = |dt: f64| usual_places * dt / usual;
        let before = kept.last().map(|last| t - last);
        let is_between = before.zip(intervals.get(i)).is_some_and(|(before, after)| {
            !is_whole(places(before)) && !is_whole(places(*after)) && is_whole(places(before + after))
        });
        match is_between || before.is_some_and(|before| places(before) < TOO_SHORT) {
            true => extra.push(*t),
            false => kept.push(*t),
        }
    }
    (kept, extra)
}

/// Places between neighbouring teeth over a turn of the wheel, the median.
fn usual_places(wheel: &WheelSpec) -> f64 {
    median(&mut gaps(wheel))
}

/// Places from each tooth to the next.
fn gaps(wheel: &WheelSpec) -> Vec<f64> {
    let teeth: Vec<usize> = (1..=wheel.places).filter(|p| !wheel.missing.contains(p)).collect();
    let (Some(first), Some(last)) = (teeth.first(), teeth.last()) else { return vec![1.0] };
    let over_the_end = (first + wheel.places - last) as f64;
    teeth.array_windows().map(|[a, b]| (b - a) as f64).chain([over_the_end]).collect()
}

/// Gives every edge its place.
///
/// # Errors
/// What is wrong with the edges: there are too few, or they pause.
fn edges(wheel: &WheelSpec, t_s: &[f64], level: &[f64]) -> Result<WheelEdges, String> {
    let too_few = || format!("fewer than {FEWEST_EDGES} edges: is it the column of the level, and the right `edge`?");
    let usual_places = usual_places(wheel);
    let (t_s, extra_s) = without_extra(&crossings(t_s, level, wheel.rising), usual_places);
    if t_s.len() < FEWEST_EDGES {
        return Err(too_few());
    }
    let longest = (wheel.missing.len() + 1 + MOST_MISSED) as f64;
    let intervals: Vec<f64> = t_s.array_windows().map(|[a, b]| b - a).collect();
    let mut at = 0_i64;
    let mut places = vec![0];
    for (i, dt) in intervals.iter().enumerate() {
        #[expect(clippy::cast_possible_truncation, reason = "a float that is too large becomes the largest integer")]
        let step = libm::round(usual_places * dt / usual(&intervals, i)) as i64;
        // A wheel that stops turns by no known angle.
        if step as f64 > longest {
            let from = t_s.get(i).copied().unwrap_or(0.0);
            return Err(format!("no edges from {from:.6} to {:.6} s after its begin: cut the record there", from + dt));
        }
        at = at.saturating_add(step.max(1));
        places.push(at);
    }
    let n = i64::try_from(wheel.places).unwrap_or(1);
    let on_wheel = |place: i64| usize::try_from(place.rem_euclid(n)).unwrap_or(0);
    let mut has_tooth = vec![true; wheel.places];
    let mut edges_at = vec![0_usize; wheel.places];
    for missing in &wheel.missing {
        has_tooth.get_mut(missing - 1).into_iter().for_each(|has| *has = false);
    }
    for place in &places {
        edges_at.get_mut(on_wheel(*place)).into_iter().for_each(|count| *count += 1);
    }
    let tooth = |place: i64| has_tooth.get(on_wheel(place)).copied().unwrap_or(true);
    // WheelEdges on places without a tooth, if the first edge stood this many places after the first place.
    let place_of = |missing: &usize| i64::try_from(missing - 1).unwrap_or(0);
    let at = |missing: &usize, turned: i64| edges_at.get(on_wheel(place_of(missing) - turned)).copied().unwrap_or(0);
    let misplaced = |turned: i64| wheel.missing.iter().map(|m| at(m, turned)).sum::<usize>();
    let counts: Vec<usize> = (0..n).map(misplaced).collect();
    let least = counts.iter().copied().min().unwrap_or(0);
    let turned = counts.iter().position(|c| *c == least).and_then(|k| i64::try_from(k).ok()).unwrap_or(0);
    let is_open = !wheel.missing.is_empty() && counts.iter().filter(|c| **c == least).count() > 1;
    let (mut kept, mut extra_s) =
        (WheelEdges { t_s: Vec::new(), places: Vec::new(), extra_s: Vec::new(), missed: 0, is_open }, extra_s);
    for (t, p) in t_s.into_iter().zip(&places) {
        let place = p.saturating_add(turned);
        if tooth(place) {
            kept.t_s.push(t);
            kept.places.push(place);
        } else {
            extra_s.push(t);
        }
    }
    extra_s.sort_by(f64::total_cmp);
    let (Some(&first), Some(&last)) = (kept.places.first(), kept.places.last()) else { return Err(too_few()) };
    // A gap as long as the whole record is no row of teeth to walk along.
    let turns = (last - first) / n;
    let whole = turns.saturating_mul(n - i64::try_from(wheel.missing.len()).unwrap_or(0));
    let rest = (first + turns * n..=last).filter(|p| tooth(*p)).count();
    let expected = usize::try_from(whole).unwrap_or(0).saturating_add(rest);
    kept.missed = expected.saturating_sub(kept.t_s.len());
    kept.extra_s = extra_s;
    if kept.t_s.len() < FEWEST_EDGES { Err(too_few()) } else { Ok(kept) }
}

impl WheelEdges {
    /// Angles at the edges [rad].
    fn angles(&self, wheel: &WheelSpec) -> Vec<f64> {
        self.places.iter().map(|p| *p as f64 * 2.0 * PI / wheel.places as f64).collect()
    }
}

/// Whole turns by which the driving wheel must be counted on, so that a wheel that turns more slowly stands at the same angle to it in
/// every record: a crank makes two turns for one of a cam, and its own wheel does not tell which of them it is in.
fn turns_ahead((driving, on): &(&WheelSpec, WheelEdges), (compared, edges): &(&WheelSpec, WheelEdges)) -> i64 {
    let (angles, others) = (edges.angles(compared), on.angles(driving));
    let pairs = edges.t_s.iter().zip(&angles);
    let both: Vec<(f64, f64)> = pairs.filter_map(|(t, a)| Some((*a, interpolated(&on.t_s, &others, *t)?))).collect();
    let (Some(first), Some(last)) = (both.first(), both.last()) else { return 0 };
    let measured = (last.1 - first.1) / (last.0 - first.0);
    let ratio = 0.5 * libm::round(2.0 * measured);
    if !(0.5..=100.0).contains(&ratio) || (measured - ratio).abs() > SAME_RATIO * ratio {
        return 0;
    }
    // Its angle to the driving wheel in turns of that, which counting on lowers by whole turns: between -0.25 and 0.75.
    let ahead = (first.0 * ratio - first.1) / (2.0 * PI);
    #[expect(clippy::cast_possible_truncation, reason = "a float that is too large becomes the largest integer")]
    let turns = libm::floor(ahead + 0.25) as i64;
    turns
}

/// The value at `t` of the cubic through two known values with the slopes of parabolas through three; None outside of them.
fn interpolated(x: &[f64], y: &[f64], t: f64) -> Option<f64> {
    let i = x.partition_point(|x| *x <= t).min(x.len().saturating_sub(1)).checked_sub(1)?;
    let at = |k: usize| Some((*x.get(k)?, *y.get(k)?));
    let ((xa, ya), (xb, yb)) = (at(i)?, at(i + 1)?);
    if t > xb {
        return None;
    }
    let rise = (yb - ya) / (xb - xa);
    let beside = |other: Option<(f64, f64)>, own: (f64, f64)| {
        let Some(other) = other else { return rise };
        let (far, near) = ((own.1 - other.1) / (own.0 - other.0), xb - xa);
        let length = (own.0 - other.0).abs();
        (rise * length + far * near) / (length + near)
    };
    let (ma, mb) = (beside(i.checked_sub(1).and_then(at), (xa, ya)), beside(at(i + 2), (xb, yb)));
    let (h, s) = (xb - xa, (t - xa) / (xb - xa));
    let bend = s * (1.0 - s) * h;
    Some(ya + s * (yb - ya) + bend * ((ma - rise) * (1.0 - s) - (mb - rise) * s))
}

/// The wheel that a channel or an input names as its column in a record.
pub(super) fn wheel_of<'a>(
    measurement: &'a Measurement,
    record: &RecordSpec,
    (name, column): (&str, &str),
) -> Option<&'a WheelSpec> {
    let own = record.columns.iter().find(|(n, _)| n == name).map(|(_, c)| c.as_str());
    measurement.wheels.iter().find(|w| own.unwrap_or(column) == w.column_name())
}

/// Whether a wheel drives the model in a record.
fn drives(measurement: &Measurement, record: &RecordSpec, wheel: &WheelSpec) -> bool {
    let mut of_inputs = measurement.inputs.iter().map(|i| wheel_of(measurement, record, (&i.name, &i.column)));
    of_inputs.any(|w| w == Some(wheel))
}

/// Wheels that a record needs.
pub(super) fn used<'a>(measurement: &'a Measurement, record: &RecordSpec) -> Vec<&'a WheelSpec> {
    let mut of_channels = measurement.channels.iter().map(|c| wheel_of(measurement, record, (&c.name, &c.column)));
    let compared: Vec<&WheelSpec> = of_channels.by_ref().flatten().collect();
    measurement.wheels.iter().filter(|w| compared.contains(w) || drives(measurement, record, w)).collect()
}

/// Replaces the rows of a file by the edges of the wheels that the measurement uses, with a column for the angle of each [deg]. A wheel
/// that drives the model has a value at every edge of every wheel, on cubics between its own; one that is compared has a value at its own
/// edges only.
pub(super) fn with_wheels(
    measurement: &Measurement,
    record: &RecordSpec,
    (columns, used): (&Columns, &[&WheelSpec]),
    diags: &mut Vec<Diag>,
) -> Option<(Columns, Vec<WheelFacts>, Vec<String>)> {
    let mut refuse =
        |at: String, title: String, help: &str| diags.push(measurement.places.error(&at, title, Some(help.into())));
    let Some((time_name, time_unit)) = &record.time else {
        let title = format!("the edges of record `{}` have no times", record.name);
        refuse(format!("records.{}", record.name), title, "write `time_column` and `time_unit`");
        return None;
    };
    let factor = unit(time_unit).map_or(1.0, |(_, f)| f);
    let time_index = columns.find(time_name);
    let Some(time) = time_index.and_then(|i| columns.values.get(i)) else {
        let title = format!("file `{}` has no column \"{time_name}\"", record.file);
        refuse(format!("records.{}.time_column", record.name), title, "it names the column with the times");
        return None;
    };
    let begins = time.first().copied().unwrap_or(0.0);
    let t_s: Vec<f64> = time.iter().map(|t| (t - begins) * factor).collect();
    if let Some(row) = t_s.array_windows().position(|[a, b]| b < a || b.is_nan()) {
        let line = columns.first_line + row + 1;
        let title = format!("time does not grow: column \"{time_name}\" of file `{}` at line {line}", record.file);
        refuse(format!("records.{}.time_column", record.name), title, "every row is later than the one before it");
        return None;
    }
    let mut found = edges_of_all(measurement, record, (columns, used), &t_s, diags);
    if found.is_empty() || !diags.is_empty() {
        return None;
    }
    let warnings = found.iter().flat_map(|(w, e)| said(&record.name, w, e)).collect();
    let facts = facts(record, &found);
    count_from_one_angle(measurement, record, &mut found);
    let (names, values) = rows_of_edges(measurement, record, &found);
    let mut replaced = Columns::from_numbers(
        [vec![time_name.clone()], names].concat(),
        values
            .into_iter()
            .enumerate()
            .map(|(i, v)| if i == 0 { v.iter().map(|t| t / factor).collect() } else { v })
            .collect(),
    );
    replaced.units = replaced.names.iter().map(|n| n.starts_with("wheels.").then(|| "deg".to_string())).collect();
    Some((replaced, facts, warnings))
}

/// Edges of the wheels that a record needs; what is wrong with them goes to `diags`.
fn edges_of_all<'a>(
    measurement: &Measurement,
    record: &RecordSpec,
    (columns, used): (&Columns, &[&'a WheelSpec]),
    t_s: &[f64],
    diags: &mut Vec<Diag>,
) -> Vec<(&'a WheelSpec, WheelEdges)> {
    let mut refuse =
        |at: String, title: String, help: &str| diags.push(measurement.places.error(&at, title, Some(help.into())));
    let mut found: Vec<(&WheelSpec, WheelEdges)> = Vec::new();
    for wheel in used.iter().copied() {
        let at = format!("wheels.{}.column", wheel.name);
        let Some(level) =
            columns.find(&wheel.column).and_then(|i| columns.values.get(i)).filter(|v| v.len() == t_s.len())
        else {
            let shown: Vec<&str> = columns.names.iter().take(12).map(String::as_str).collect();
            let title = format!("file `{}` has no column \"{}\"", record.file, wheel.column);
            refuse(at, title, &format!("columns there: {}", shown.join(", ")));
            continue;
        };
        match edges(wheel, t_s, level) {
            Ok(edges) => found.push((wheel, edges)),
            Err(why) => {
                refuse(
                    at,
                    format!("wheel `{}` in record `{}`: {why}", wheel.name, record.name),
                    "`pitchline identify --facts` shows what is read",
                );
            }
        }
    }
    found
}

/// Counts driving wheels on by whole turns, so that others stand at the same angle to them in every record.
fn count_from_one_angle(measurement: &Measurement, record: &RecordSpec, found: &mut [(&WheelSpec, WheelEdges)]) {
    let is_driving = |w: &WheelSpec| drives(measurement, record, w);
    let driving = found.iter().find(|(w, _)| is_driving(w));
    let turned = driving.zip(found.iter().find(|(w, _)| !is_driving(w)));
    let turned = turned.map_or(0, |(driving, compared)| turns_ahead(driving, compared));
    for (wheel, edges) in found.iter_mut().filter(|(w, _)| is_driving(w)) {
        let places = i64::try_from(wheel.places).unwrap_or(1).saturating_mul(turned);
        edges.places.iter_mut().for_each(|p| *p = p.saturating_add(places));
    }
}

/// The times of all edges [s], and the angle of every wheel at them [deg]; names of the angles.
fn rows_of_edges(
    measurement: &Measurement,
    record: &RecordSpec,
    found: &[(&WheelSpec, WheelEdges)],
) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut rows: Vec<f64> = found.iter().flat_map(|(_, e)| e.t_s.iter().copied()).collect();
    rows.sort_by(f64::total_cmp);
    rows.dedup();
    // The model needs what drives it from the first row to the last.
    let driving = || found.iter().filter(|(w, _)| drives(measurement, record, w));
    let from = driving().filter_map(|(_, e)| e.t_s.first().copied()).fold(f64::MIN, f64::max);
    let to = driving().filter_map(|(_, e)| e.t_s.last().copied()).fold(f64::MAX, f64::min);
    rows.retain(|t| (from..=to).contains(t));
    let angles_of = |(wheel, edges): &(&WheelSpec, WheelEdges)| -> Vec<f64> {
        let angles: Vec<f64> = edges.angles(wheel).iter().map(|a| a / DEG).collect();
        let is_driving = drives(measurement, record, wheel);
        let own = |t: &f64| edges.t_s.binary_search_by(|x| x.total_cmp(t)).ok().and_then(|k| angles.get(k).copied());
        let between = |t: &f64| interpolated(&edges.t_s, &angles, *t).filter(|_| is_driving);
        rows.iter().map(|t| own(t).or_else(|| between(t)).unwrap_or(f64::NAN)).collect()
    };
    let angles: Vec<Vec<f64>> = found.iter().map(angles_of).collect();
    (found.iter().map(|(w, _)| w.column_name()).collect(), [vec![rows.clone()], angles].concat())
}

/// What a user must know of the edges of a wheel.
fn said(record: &str, wheel: &WheelSpec, edges: &WheelEdges) -> Vec<String> {
    let mut all = Vec::new();
    let mut say = |text: String| all.push(format!("record `{record}`, wheel `{}`: {text}", wheel.name));
    if !edges.extra_s.is_empty() {
        let some: Vec<String> = edges.extra_s.iter().take(4).map(|t| format!("{t:.6}")).collect();
        let more = if edges.extra_s.len() > some.len() { ", ..." } else { "" };
        say(format!("{} edges that no tooth makes were left out, at {} s{more}", edges.extra_s.len(), some.join(", ")));
    }
    if edges.missed > 0 {
        say(format!("{} teeth made no edge; places are counted through them", edges.missed));
    }
    let turns = edges.t_s.len() as f64 / (wheel.places - wheel.missing.len()) as f64;
    let odd = edges.extra_s.len() + edges.missed;
    if odd > MOST_ODD && odd as f64 > MOST_ODD_PER_TURN * turns {
        say(format!(
            "{:.1} such edges a turn: are `teeth`, `missing` and `edge` those of this wheel?",
            odd as f64 / turns
        ));
    }
    if edges.is_open {
        say("more than one place could be the first: its angle is known but for whole places".into());
    }
    all
}

fn facts(record: &RecordSpec, found: &[(&WheelSpec, WheelEdges)]) -> Vec<WheelFacts> {
    let reference = found.iter().max_by_key(|(_, e)| e.t_s.len());
    let of = |(wheel, edges): &(&WheelSpec, WheelEdges)| {
        let angles = edges.angles(wheel);
        let ends = |v: &[f64]| v.last().copied().unwrap_or(0.0) - v.first().copied().unwrap_or(0.0);
        let (turns, length_s) = (ends(&angles) / (2.0 * PI), ends(&edges.t_s));
        let mut speeds = vec![turns / length_s];
        let mut turn = angles.first().copied().unwrap_or(0.0) + 2.0 * PI;
        let mut before = edges.t_s.first().copied().unwrap_or(0.0);
        for _ in 0..edges.t_s.len() {
            let Some(t) = interpolated(&angles, &edges.t_s, turn) else { break };
            speeds.push(1.0 / (t - before));
            (before, turn) = (t, turn + 2.0 * PI);
        }
        let whole = speeds.get(1..).filter(|s| !s.is_empty()).unwrap_or(&speeds);
        let rpm = |v: f64| 60.0 * v;
        let ends = [whole.iter().copied().fold(f64::MAX, f64::min), whole.iter().copied().fold(f64::MIN, f64::max)];
        let other = reference.filter(|(w, _)| w.name != wheel.name);
        WheelFacts {
            record: record.name.clone(),
            wheel: wheel.name.clone(),
            edges: edges.t_s.len(),
            extra_s: edges.extra_s.clone(),
            missed: edges.missed,
            turns,
            speed_rpm: [rpm(turns / length_s), rpm(ends[0]), rpm(ends[1])],
            orders: if wheel.places >= FINE_WHEEL { speed_orders(&edges.t_s, &angles) } else { Vec::new() },
            stands_at: other.and_then(|(w, e)| stands_at(&edges.t_s, w, e)),
            noise_deg: other.and_then(|(w, e)| noise((wheel, edges), (w, e))).map(|noise| noise / DEG),
        }
    };
    found.iter().map(of).collect()
}

/// Waves of the speed over the angle: least squares of the mean speeds between edges, beside a slow change of third degree.
fn speed_orders(t_s: &[f64], angles: &[f64]) -> Vec<SpeedOrder> {
    let intervals = || t_s.array_windows().zip(angles.array_windows());
    let speeds: Vec<f64> = intervals().map(|([ta, tb], [a, b])| (b - a) / (tb - ta)).collect();
    let mean = speeds.iter().sum::<f64>() / speeds.len().max(1) as f64;
    let first = angles.first().copied().unwrap_or(0.0);
    let span = angles.last().copied().unwrap_or(1.0) - first;
    let columns = 4 + 4 * HIGHEST_ORDER;
    if speeds.len() < 2 * columns || span < 8.0 * PI {
        return Vec::new();
    }
    let row = |[a, b]: &[f64; 2]| {
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        let x = 2.0 * (middle - first) / span - 1.0;
        let mut row = vec![1.0, x, x * x, x * x * x];
        for n in 1..=2 * HIGHEST_ORDER {
            let order = 0.5 * n as f64;
            // Mean of a wave over the interval.
            let over = libm::sin(order * half) / (order * half);
            row.extend([over * libm::cos(order * middle), over * libm::sin(order * middle)]);
        }
        row
    };
    let rows: Vec<f64> = angles.array_windows().flat_map(row).collect();
    let matrix = DMatrix::from_row_slice(speeds.len(), columns, &rows);
    let right = DVector::from_iterator(speeds.len(), speeds.iter().map(|v| v / mean - 1.0));
    let (normal, right) = (matrix.tr_mul(&matrix), matrix.tr_mul(&right));
    let Some(x) = normal.cholesky().map(|c| c.solve(&right)) else { return Vec::new() };
    let x: Vec<f64> = x.iter().copied().collect();
    let waves = x.get(4..).unwrap_or_default().chunks_exact(2).enumerate();
    let mut all: Vec<SpeedOrder> = waves
        .map(|(n, pair)| {
            let amplitude = libm::sqrt(pair.iter().map(|p| p * p).sum::<f64>());
            let order = 0.5 * (n + 1) as f64;
            SpeedOrder { order, speed_percent: 100.0 * amplitude, angle_deg: amplitude / order / DEG }
        })
        .filter(|w| w.speed_percent > SMALL_PERCENT)
        .collect();
    all.sort_by(|a, b| b.speed_percent.total_cmp(&a.speed_percent));
    all.truncate(TOLD_ORDERS);
    all
}

/// Standard deviation of an edge [rad]: second differences over whole turns of its angle less that of another wheel, which turns with it.
/// They leave out what repeats with every turn.
fn noise((wheel, edges): (&WheelSpec, &WheelEdges), (other, on): (&WheelSpec, &WheelEdges)) -> Option<f64> {
    let (angles, others) = (edges.angles(wheel), on.angles(other));
    let pairs = edges.t_s.iter().zip(&angles).zip(&edges.places);
    let known: Vec<(i64, f64, f64)> =
        pairs.filter_map(|((t, a), place)| Some((*place, *a, interpolated(&on.t_s, &others, *t)?))).collect();
    let (first, last) = (known.first()?, known.last()?);
    let per_other = (last.1 - first.1) / (last.2 - first.2);
    let turn = i64::try_from(wheel.places).ok()?;
    let at = |place: i64| {
        let k = known.binary_search_by_key(&place, |(p, ..)| *p).ok()?;
        known.get(k).map(|(_, own, other)| (own - first.1) - per_other * (other - first.2))
    };
    let second = |(place, ..): &(i64, f64, f64)| {
        Some(at(*place)? - 2.0 * at(place.saturating_add(turn))? + at(place.saturating_add(2 * turn))?)
    };
    // A second difference of independent errors has six times the variance of one error.
    let mut squares: Vec<f64> = known.iter().filter_map(second).map(|d| d * d / 6.0).collect();
    (squares.len() >= FEWEST_EDGES).then(|| deviation_by_median(&mut squares))
}

/// Where edges stand on another wheel.
fn stands_at(t_s: &[f64], wheel: &WheelSpec, edges: &WheelEdges) -> Option<StandsAt> {
    let angles = edges.angles(wheel);
    let at: Vec<f64> = t_s.iter().filter_map(|t| interpolated(&edges.t_s, &angles, *t)).collect();
    let mut steps: Vec<f64> = at.array_windows().map(|[a, b]| b - a).collect();
    let turns_between = libm::round(median(&mut steps) / (2.0 * PI));
    if turns_between < 1.0 || at.len() < FEWEST_EDGES {
        return None;
    }
    let round = turns_between * 2.0 * PI;
    // Deviations from the first edge, so that no angle is cut at a whole turn.
    let first = *at.first()?;
    let off: Vec<f64> = at.iter().map(|a| a - first - round * libm::round((a - first) / round)).collect();
    let n = off.len() as f64;
    let mean = off.iter().sum::<f64>() / n;
    let squares = off.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>();
    let pairs = off.array_windows().map(|[a, b]| (a - mean) * (b - mean)).sum::<f64>();
    Some(StandsAt {
        wheel: wheel.name.clone(),
        turns_between,
        angle_deg: (first + mean).rem_euclid(2.0 * PI) / DEG,
        scatter_deg: libm::sqrt(squares / (n - 1.0)) / DEG,
        neighbour_correlation: pairs / squares.max(1e-300),
    })
}

impl std::fmt::Display for WheelFacts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [mean, slow, fast] = self.speed_rpm;
        write!(
            f,
            "wheel {} in {}: {} edges, {} extra, {} missed, {:.2} turns, {mean:.2} rpm (turns of {slow:.2} to {fast:.2})",
            self.wheel,
            self.record,
            self.edges,
            self.extra_s.len(),
            self.missed,
            self.turns
        )?;
        for w in &self.orders {
            write!(f, "\n    order {:<4} {:>7.3} % of the speed, {:.4} deg", w.order, w.speed_percent, w.angle_deg)?;
        }
        if self.orders.iter().any(|w| w.order == libm::round(w.order)) {
            write!(f, "\n    whole orders may also be teeth off their places: a run at another speed parts them")?;
        }
        if let Some(s) = &self.stands_at {
            write!(
                f,
                "\n    stands at {:.3} deg of {}, once in {} turns, scatter {:.4} deg, correlation of neighbours {:.2}",
                s.angle_deg, s.wheel, s.turns_between, s.scatter_deg, s.neighbour_correlation
            )?;
        }
        if let Some(noise) = self.noise_deg {
            write!(f, "\n    one edge differs from turn to turn by {noise:.4} deg (standard deviation)")?;
        }
        Ok(())
    }
}

#[cfg(test)]
#[expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "a test fails by them")]
mod tests {
    use super::*;

    fn wheel(places: usize, missing: &[usize]) -> WheelSpec {
        WheelSpec { name: "crank".into(), column: "level".into(), rising: false, places, missing: missing.to_vec() }
    }

    /// Rows of a logic analyser for a wheel whose tooth `p` ends at `angle(p)`; the signal is high for half a place before that.
    fn signal(wheel: &WheelSpec, turns: usize, time: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let (mut t, mut level) = (vec![0.0], vec![0.0]);
        for k in 0..wheel.places * turns {
            if !wheel.missing.contains(&(k % wheel.places + 1)) {
                let place = 2.0 * PI / wheel.places as f64;
                t.extend([time((k as f64 + 0.5) * place), time((k as f64 + 1.0) * place)]);
                level.extend([1.0, 0.0]);
            }
        }
        (t, level)
    }

    #[test]
    fn the_places_of_a_36_2_1_wheel_are_found_through_a_change_of_speed() {
        let wheel = wheel(36, &[14, 15, 33]);
        // From 1000 to 3000 rpm within six turns.
        let time = |angle: f64| libm::log(1.0 + 0.053 * angle) / (0.053 * 104.72);
        let (t, level) = signal(&wheel, 6, time);
        // The record begins in the middle of a turn.
        let found = edges(&wheel, &t[41..], &level[41..]).unwrap();
        assert_eq!((found.missed, found.extra_s.len(), found.is_open), (0, 0, false));
        assert!(found.places[0] > 15 && found.places[0] < 24, "{:?}", &found.places[..3]);
        for (t, p) in found.t_s.iter().zip(&found.places) {
            let truth = time((*p as f64 + 1.0) * PI / 18.0);
            assert!((t - truth).abs() < 1e-12, "place {p}: {t} s, not {truth} s");
        }
    }

    #[test]
    fn edges_that_no_tooth_makes_and_teeth_without_an_edge_are_told() {
        let wheel = wheel(60, &[59, 60]);
        let (mut t, mut level) = signal(&wheel, 4, |angle| angle / 100.0);
        // A tooth without an edge, a doubled edge, and one in the middle between two teeth.
        t.drain(101..103);
        level.drain(101..103);
        let at = t[60];
        t.splice(61..61, [at + 2e-5, at + 4e-5]);
        level.splice(61..61, [1.0 - level[60], level[60]]);
        let found = edges(&wheel, &t, &level).unwrap();
        assert_eq!((found.missed, found.extra_s.len()), (1, 1), "{:?}", found.extra_s);
        let last = found.places.len() - 1;
        assert_eq!(found.places[last] - found.places[0], 4 * 60 - 3);
        assert_eq!(said("a", &wheel, &found).len(), 2);
        // Another wheel than that which made the edges.
        let other = WheelSpec { missing: vec![30, 60], ..wheel };
        let found = edges(&other, &t, &level).unwrap();
        assert!(said("a", &other, &found).iter().any(|t| t.contains("are `teeth`, `missing`")), "{found:?}");
    }

    #[test]
    fn waves_of_the_speed_are_found_with_their_size() {
        let wheel = wheel(36, &[14, 15, 33]);
        // Angle a at t = (a + sum of (p/k) sin(k a)) / w: speed w (1 - p cos(k a)) to first order.
        let time = |a: f64| (a + 0.004 / 0.5 * libm::sin(0.5 * a) + 0.002 / 3.0 * libm::sin(3.0 * a)) / 150.0;
        let (t, level) = signal(&wheel, 30, time);
        let found = edges(&wheel, &t, &level).unwrap();
        let orders = speed_orders(&found.t_s, &found.angles(&wheel));
        assert_eq!((orders[0].order, orders[1].order), (0.5, 3.0));
        assert!((orders[0].speed_percent - 0.4).abs() < 0.004, "{:?}", orders[0]);
        assert!((orders[1].speed_percent - 0.2).abs() < 0.002, "{:?}", orders[1]);
    }

    #[test]
    fn a_cubic_is_interpolated_to_third_order() {
        // At 1.24, two fifths of the way between two known values.
        let error = |below: f64| {
            let h = 1.24 / (below + 0.4);
            let x: Vec<f64> = (0..40).map(|k| f64::from(k) * h).collect();
            let y: Vec<f64> = x.iter().map(|x| libm::sin(*x)).collect();
            (interpolated(&x, &y, 1.24).unwrap() - libm::sin(1.24)).abs()
        };
        let (ratio, cubed) = (error(12.0) / error(24.0), (24.4_f64 / 12.4).powi(3));
        assert!((0.8..1.3).contains(&(ratio / cubed)), "{ratio}, not {cubed}");
        assert_eq!(interpolated(&[0.0, 1.0, 3.0], &[0.0, 2.0, 6.0], 2.0), Some(4.0));
        assert_eq!(interpolated(&[0.0, 1.0], &[0.0, 2.0], 1.5), None);
    }
}
