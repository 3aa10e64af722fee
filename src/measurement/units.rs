//! Units of measured columns.

use crate::machine::{Machine, Reads};
use crate::units::{DEG, RPM};
use std::f64::consts::PI;

/// Quantity that a unit measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeasuredQuantity {
    Time,
    Angle,
    Length,
    AngularSpeed,
    Speed,
    AngularAcceleration,
    Acceleration,
    Force,
    Torque,
    Pressure,
    Flow,
}

impl MeasuredQuantity {
    pub fn label(self) -> &'static str {
        match self {
            MeasuredQuantity::Time => "a time",
            MeasuredQuantity::Angle => "an angle",
            MeasuredQuantity::Length => "a length",
            MeasuredQuantity::AngularSpeed => "an angular speed",
            MeasuredQuantity::Speed => "a speed",
            MeasuredQuantity::AngularAcceleration => "an angular acceleration",
            MeasuredQuantity::Acceleration => "an acceleration",
            MeasuredQuantity::Force => "a force",
            MeasuredQuantity::Torque => "a torque",
            MeasuredQuantity::Pressure => "a pressure",
            MeasuredQuantity::Flow => "a flow",
        }
    }
}

/// Every unit: name, quantity, size in SI.
pub const UNITS: [(&str, MeasuredQuantity, f64); 45] = [
    ("Pa", MeasuredQuantity::Pressure, 1.0),
    ("kPa", MeasuredQuantity::Pressure, 1e3),
    ("MPa", MeasuredQuantity::Pressure, 1e6),
    ("bar", MeasuredQuantity::Pressure, 1e5),
    ("m^3/s", MeasuredQuantity::Flow, 1.0),
    ("mm^3/s", MeasuredQuantity::Flow, 1e-9),
    ("cm^3/s", MeasuredQuantity::Flow, 1e-6),
    ("l/min", MeasuredQuantity::Flow, 1e-3 / 60.0),
    ("s", MeasuredQuantity::Time, 1.0),
    ("ms", MeasuredQuantity::Time, 1e-3),
    ("us", MeasuredQuantity::Time, 1e-6),
    ("ns", MeasuredQuantity::Time, 1e-9),
    ("min", MeasuredQuantity::Time, 60.0),
    ("rad", MeasuredQuantity::Angle, 1.0),
    ("mrad", MeasuredQuantity::Angle, 1e-3),
    ("deg", MeasuredQuantity::Angle, DEG),
    ("rev", MeasuredQuantity::Angle, 2.0 * PI),
    ("m", MeasuredQuantity::Length, 1.0),
    ("cm", MeasuredQuantity::Length, 1e-2),
    ("mm", MeasuredQuantity::Length, 1e-3),
    ("um", MeasuredQuantity::Length, 1e-6),
    ("rad/s", MeasuredQuantity::AngularSpeed, 1.0),
    ("deg/s", MeasuredQuantity::AngularSpeed, DEG),
    ("rpm", MeasuredQuantity::AngularSpeed, RPM),
    ("1/min", MeasuredQuantity::AngularSpeed, RPM),
    ("rev/s", MeasuredQuantity::AngularSpeed, 2.0 * PI),
    ("m/s", MeasuredQuantity::Speed, 1.0),
    ("cm/s", MeasuredQuantity::Speed, 1e-2),
    ("mm/s", MeasuredQuantity::Speed, 1e-3),
    ("m/min", MeasuredQuantity::Speed, 1.0 / 60.0),
    ("km/h", MeasuredQuantity::Speed, 1.0 / 3.6),
    ("rad/s^2", MeasuredQuantity::AngularAcceleration, 1.0),
    ("deg/s^2", MeasuredQuantity::AngularAcceleration, DEG),
    ("m/s^2", MeasuredQuantity::Acceleration, 1.0),
    ("mm/s^2", MeasuredQuantity::Acceleration, 1e-3),
    ("g", MeasuredQuantity::Acceleration, 9.80665),
    ("N", MeasuredQuantity::Force, 1.0),
    ("mN", MeasuredQuantity::Force, 1e-3),
    ("kN", MeasuredQuantity::Force, 1e3),
    ("N m", MeasuredQuantity::Torque, 1.0),
    ("Nm", MeasuredQuantity::Torque, 1.0),
    ("mN m", MeasuredQuantity::Torque, 1e-3),
    ("mNm", MeasuredQuantity::Torque, 1e-3),
    ("N mm", MeasuredQuantity::Torque, 1e-3),
    ("kN m", MeasuredQuantity::Torque, 1e3),
];

/// Quantity and size of a unit, if it is known.
pub fn unit(name: &str) -> Option<(MeasuredQuantity, f64)> {
    let name = name.replace('²', "^2").replace("1/s", "rad/s").replace("s2", "s^2").replace('µ', "u");
    UNITS.iter().find(|(n, ..)| *n == name).map(|(_, q, f)| (*q, *f))
}

/// Quantity and unit of a sensor that has no unit of its own.
#[expect(
    clippy::indexing_slicing,
    reason = "callers name a sensor of this machine, and it reads a spring of this machine"
)]
pub fn shows(m: &Machine, sensor: usize) -> (MeasuredQuantity, &'static str) {
    let slides = |b: usize| m.bodies.get(b).is_some_and(|b| b.slides);
    match m.sensors[sensor].reads {
        Reads::Angle(b) if slides(b) => (MeasuredQuantity::Length, "m"),
        Reads::Angle(_) => (MeasuredQuantity::Angle, "rad"),
        Reads::Speed(b) if slides(b) => (MeasuredQuantity::Speed, "m/s"),
        Reads::Speed(_) => (MeasuredQuantity::AngularSpeed, "rad/s"),
        Reads::Acceleration(b) if slides(b) => (MeasuredQuantity::Acceleration, "m/s^2"),
        Reads::Acceleration(_) => (MeasuredQuantity::AngularAcceleration, "rad/s^2"),
        Reads::Pulses { .. } => (MeasuredQuantity::Time, "s"),
        Reads::Tension(s) => match m.springs[s].path.starts_with("spans.") {
            true => (MeasuredQuantity::Force, "N"),
            false => {
                let turns = m.springs[s].ends.iter().any(|e| !slides(e.body));
                if turns { (MeasuredQuantity::Torque, "N m") } else { (MeasuredQuantity::Force, "N") }
            }
        },
        Reads::Part(unit) => {
            let known = UNITS.iter().find(|(name, ..)| *name == unit);
            (known.map_or(MeasuredQuantity::Force, |(_, quantity, _)| *quantity), unit)
        }
        Reads::Reaction(b) if slides(b) => (MeasuredQuantity::Force, "N"),
        Reads::Reaction(_) => (MeasuredQuantity::Torque, "N m"),
    }
}
