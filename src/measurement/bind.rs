//! Binds the names in a measurement file to a drive: sensors, units, inputs, parameters. Returns all errors at once.

use super::segments::{DataError, MeasuredChannel};
use super::units::{MeasuredQuantity, UNITS, shows, unit};
use super::{FitScope, Measurement, RecordSpec};
use crate::diag::{Diag, nearest};
use crate::machine::{InputKind, Machine, Reads};

/// Result of the binding.
pub(super) struct BoundColumns {
    pub(super) channels: Vec<MeasuredChannel>,
    /// For every record the slots it sets, SI.
    pub(super) set: Vec<Vec<(usize, f64)>>,
}

/// Binds everything, or returns all errors.
pub(super) fn bind(measurement: &Measurement, machine: &Machine) -> Result<BoundColumns, DataError> {
    let mut diags = Vec::new();
    let channels = bind_channels(measurement, machine, &mut diags);
    check_inputs(measurement, machine, &mut diags);
    let set = bind_set(measurement, machine, &mut diags);
    if diags.is_empty() {
        Ok(BoundColumns { channels, set })
    } else {
        Err(DataError::File(Box::new(measurement.places.report(diags))))
    }
}

fn bind_channels(measurement: &Measurement, machine: &Machine, diags: &mut Vec<Diag>) -> Vec<MeasuredChannel> {
    let mut all = Vec::new();
    for c in &measurement.channels {
        let at = |key: &str| format!("channels.{}.{key}", c.name);
        let mut error = |key: &str, title: String, help: String| {
            diags.push(measurement.places.error(&at(key), title, Some(help)));
        };
        let Some((sensor, bound)) = machine.sensors.iter().enumerate().find(|(_, s)| s.path == c.sensor) else {
            let known: Vec<&str> = machine.sensors.iter().map(|s| s.path.as_str()).collect();
            let help = match nearest(&c.sensor, known.iter().copied()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("sensors of the drive: {}", known.join(", ")),
            };
            error("sensor", format!("the drive has no sensor `{}`", c.sensor), help);
            continue;
        };
        let (quantity, si) = shows(machine, sensor);
        let factor = match (&bound.unit, unit(&c.unit)) {
            (Some(own), _) if *own == c.unit => 1.0,
            (None, Some((q, factor))) if q == quantity => factor,
            (Some(own), _) => {
                error(
                    "unit",
                    format!("`{}` shows {own}, not {}", c.sensor, c.unit),
                    format!("write `unit = \"{own}\"`"),
                );
                continue;
            }
            (None, Some((q, _))) => {
                let title = format!("`{}` is {}, and `{}` shows {}", c.unit, q.label(), c.sensor, quantity.label());
                error("unit", title, format!("its SI unit is {si}"));
                continue;
            }
            (None, None) => {
                let title = format!("the unit `{}` is not known", c.unit);
                let units: Vec<&str> = UNITS.iter().filter(|(_, q, _)| *q == quantity).map(|(n, ..)| *n).collect();
                let help = format!(
                    "units of {}: {}; a unit of its own is given with the sensor (`unit = \"{}\"`, `gain`)",
                    quantity.label(),
                    units.join(", "),
                    c.unit
                );
                error("unit", title, help);
                continue;
            }
        };
        let relative = matches!(bound.reads, Reads::Pulses { .. });
        all.push(MeasuredChannel {
            name: c.name.clone(),
            sensor_path: c.sensor.clone(),
            sensor,
            unit: if relative { "%".into() } else { c.unit.clone() },
            shown: if relative { 100.0 } else { 1.0 / factor },
            noise: 0.0,
            sensor_noise: 0.0,
            relative,
            quantisation: 0.0,
        });
    }
    let pulses = all.iter().filter(|c| c.relative).count();
    if pulses > 0 && all.len() > 1 {
        let title = "a pulse pickup and another channel in one measurement".to_string();
        let help = "pulses have times of their own: write one measurement file for each";
        diags.push(measurement.places.error("channels", title, Some(help.into())));
    }
    all
}

fn check_inputs(measurement: &Measurement, machine: &Machine, diags: &mut Vec<Diag>) {
    for i in &measurement.inputs {
        if machine.inputs.iter().all(|m| m.path != i.input) {
            let known: Vec<&str> = machine.inputs.iter().map(|m| m.path.as_str()).collect();
            let help = match known.is_empty() {
                true => "the drive has no inputs: add `[inputs.torque.BODY]` to it".to_string(),
                false => format!("inputs of the drive: {}", known.join(", ")),
            };
            let title = format!("the drive has no input `{}`", i.input);
            diags.push(measurement.places.error(&format!("inputs.{}.input", i.name), title, Some(help)));
        }
    }
    for m in &machine.inputs {
        if measurement.inputs.iter().all(|i| i.input != m.path) {
            let title = format!("nothing is measured for the drive's input `{}`", m.path);
            let help = format!("add `[inputs.NAME]` with `input = \"{}\"` and `column`", m.path);
            diags.push(measurement.places.error("inputs", title, Some(help)));
        }
    }
    for i in &measurement.inputs {
        let Some(m) = machine.inputs.iter().find(|m| m.path == i.input) else { continue };
        let slides = machine.bodies.get(m.body).is_some_and(|b| b.slides);
        let wanted = match (m.kind, slides) {
            (InputKind::Force(_) | InputKind::Acceleration, _) => continue,
            (InputKind::Speed, false) => MeasuredQuantity::AngularSpeed,
            (InputKind::Speed, true) => MeasuredQuantity::Speed,
            (InputKind::Angle, false) => MeasuredQuantity::Angle,
            (InputKind::Angle, true) => MeasuredQuantity::Length,
        };
        if unit(&i.unit).is_none_or(|(q, _)| q != wanted) {
            let title = format!("`{}` is no unit of {}", i.unit, wanted.label());
            let of = UNITS.iter().filter(|(_, q, _)| *q == wanted).map(|(n, ..)| *n);
            let help = format!("units of {}: {}", wanted.label(), of.collect::<Vec<_>>().join(", "));
            diags.push(measurement.places.error(&format!("inputs.{}.unit", i.name), title, Some(help)));
        }
    }
}

#[expect(clippy::indexing_slicing, reason = "`Machine::slot` gives places in its own slots and values")]
fn bind_set(measurement: &Measurement, machine: &Machine, diags: &mut Vec<Diag>) -> Vec<Vec<(usize, f64)>> {
    let mut all = Vec::new();
    for r in &measurement.records {
        let mut slots = Vec::new();
        for (path, value) in &r.set {
            match machine.slot(path) {
                Some(slot) => {
                    let own = &machine.slots[slot];
                    if !(own.low..=own.high).contains(value) {
                        let title = format!("`{path}` = {value} is outside {}", range_text(own.low, own.high));
                        diags.push(measurement.places.error(&format!("records.{}.set", r.name), title, None));
                    }
                    slots.push((slot, value * own.unit));
                }
                None => diags.push(no_such_path(measurement, machine, &format!("records.{}.set", r.name), path)),
            }
        }
        all.push(slots);
    }
    for f in &measurement.fit {
        let Some(slot) = machine.slot(&f.path) else {
            diags.push(no_such_path(measurement, machine, &format!("fit.{}", f.path), &f.path));
            continue;
        };
        let value = machine.shown(slot, machine.values[slot]);
        let (low, high) = (f.low.unwrap_or(f64::MIN), f.high.unwrap_or(f64::MAX));
        if low >= high || value < low || value > high {
            let bounds = range_text(low, high);
            let title = format!("the drive's {value} lies outside the bounds {bounds} of `{}`", f.path);
            diags.push(measurement.places.error(&format!("fit.{}", f.path), title, Some("widen them".into())));
        }
        let fits = |r: &&RecordSpec| r.set.iter().any(|(path, _)| *path == f.path);
        if let Some(r) = measurement.records.iter().find(fits).filter(|_| f.scope == FitScope::All) {
            let title = format!("`{}` is fitted, and record `{}` sets it", f.path, r.name);
            let help = "one number for all records cannot be set by one: fit it `per = \"record\"`, or leave one of the two out";
            diags.push(measurement.places.error(&format!("fit.{}", f.path), title, Some(help.into())));
        }
        if f.spread.is_some() && value == 0.0 {
            let title = format!("`spread_percent` of `{}`, which is zero", f.path);
            let help = "a share of zero is zero: leave it out, or give the drive a value";
            diags.push(measurement.places.error(&format!("fit.{}", f.path), title, Some(help.into())));
        }
    }
    all
}

/// A range, of which an end may be open.
fn range_text(low: f64, high: f64) -> String {
    let end = |x: f64, none: &str| if x.abs() == f64::MAX { none.to_string() } else { x.to_string() };
    format!("{} .. {}", end(low, "-inf"), end(high, "inf"))
}

fn no_such_path(measurement: &Measurement, machine: &Machine, at: &str, path: &str) -> Diag {
    let near = nearest(path, machine.slots.iter().map(|s| s.path.as_str()));
    let help = near.map(|n| format!("did you mean `{n}`?"));
    measurement.places.error(at, format!("the drive has no number `{path}`"), help)
}
