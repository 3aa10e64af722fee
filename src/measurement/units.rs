//! Units of measured columns.

use crate::machine::{Machine, PartQuantity, Reads};
use crate::units::{DEG, RPM};
use std::f64::consts::PI;

/// Quantity that a unit measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
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

impl Quantity {
    pub fn label(self) -> &'static str {
        match self {
            Quantity::Time => "a time",
            Quantity::Angle => "an angle",
            Quantity::Length => "a length",
            Quantity::AngularSpeed => "an angular speed",
            Quantity::Speed => "a speed",
            Quantity::AngularAcceleration => "an angular acceleration",
            Quantity::Acceleration => "an acceleration",
            Quantity::Force => "a force",
            Quantity::Torque => "a torque",
            Quantity::Pressure => "a pressure",
            Quantity::Flow => "a flow",
        }
    }
}

/// Every unit: name, quantity, size in SI.
pub const UNITS: [(&str, Quantity, f64); 45] = [
    ("Pa", Quantity::Pressure, 1.0),
    ("kPa", Quantity::Pressure, 1e3),
    ("MPa", Quantity::Pressure, 1e6),
    ("bar", Quantity::Pressure, 1e5),
    ("m^3/s", Quantity::Flow, 1.0),
    ("mm^3/s", Quantity::Flow, 1e-9),
    ("cm^3/s", Quantity::Flow, 1e-6),
    ("l/min", Quantity::Flow, 1e-3 / 60.0),
    ("s", Quantity::Time, 1.0),
    ("ms", Quantity::Time, 1e-3),
    ("us", Quantity::Time, 1e-6),
    ("ns", Quantity::Time, 1e-9),
    ("min", Quantity::Time, 60.0),
    ("rad", Quantity::Angle, 1.0),
    ("mrad", Quantity::Angle, 1e-3),
    ("deg", Quantity::Angle, DEG),
    ("rev", Quantity::Angle, 2.0 * PI),
    ("m", Quantity::Length, 1.0),
    ("cm", Quantity::Length, 1e-2),
    ("mm", Quantity::Length, 1e-3),
    ("um", Quantity::Length, 1e-6),
    ("rad/s", Quantity::AngularSpeed, 1.0),
    ("deg/s", Quantity::AngularSpeed, DEG),
    ("rpm", Quantity::AngularSpeed, RPM),
    ("1/min", Quantity::AngularSpeed, RPM),
    ("rev/s", Quantity::AngularSpeed, 2.0 * PI),
    ("m/s", Quantity::Speed, 1.0),
    ("cm/s", Quantity::Speed, 1e-2),
    ("mm/s", Quantity::Speed, 1e-3),
    ("m/min", Quantity::Speed, 1.0 / 60.0),
    ("km/h", Quantity::Speed, 1.0 / 3.6),
    ("rad/s^2", Quantity::AngularAcceleration, 1.0),
    ("deg/s^2", Quantity::AngularAcceleration, DEG),
    ("m/s^2", Quantity::Acceleration, 1.0),
    ("mm/s^2", Quantity::Acceleration, 1e-3),
    ("g", Quantity::Acceleration, 9.80665),
    ("N", Quantity::Force, 1.0),
    ("mN", Quantity::Force, 1e-3),
    ("kN", Quantity::Force, 1e3),
    ("N m", Quantity::Torque, 1.0),
    ("Nm", Quantity::Torque, 1.0),
    ("mN m", Quantity::Torque, 1e-3),
    ("mNm", Quantity::Torque, 1e-3),
    ("N mm", Quantity::Torque, 1e-3),
    ("kN m", Quantity::Torque, 1e3),
];

/// Quantity and size of a unit, if it is known.
pub fn unit(name: &str) -> Option<(Quantity, f64)> {
    let name = name.replace('²', "^2").replace("1/s", "rad/s").replace("s2", "s^2").replace('µ', "u");
    UNITS.iter().find(|(n, ..)| *n == name).map(|(_, q, f)| (*q, *f))
}

/// Quantity and unit of a sensor that has no unit of its own.
#[expect(
    clippy::indexing_slicing,
    reason = "callers name a sensor of this machine, and it reads a spring of this machine"
)]
pub fn shows(m: &Machine, sensor: usize) -> (Quantity, &'static str) {
    let slides = |b: usize| m.bodies.get(b).is_some_and(|b| b.slides);
    match m.sensors[sensor].reads {
        Reads::Angle(b) if slides(b) => (Quantity::Length, "m"),
        Reads::Angle(_) => (Quantity::Angle, "rad"),
        Reads::Speed(b) if slides(b) => (Quantity::Speed, "m/s"),
        Reads::Speed(_) => (Quantity::AngularSpeed, "rad/s"),
        Reads::Acceleration(b) if slides(b) => (Quantity::Acceleration, "m/s^2"),
        Reads::Acceleration(_) => (Quantity::AngularAcceleration, "rad/s^2"),
        Reads::Pulses { .. } => (Quantity::Time, "s"),
        Reads::Tension(s) => match m.springs[s].path.starts_with("spans.") {
            true => (Quantity::Force, "N"),
            false => {
                let turns = m.springs[s].ends.iter().any(|e| !slides(e.body));
                if turns { (Quantity::Torque, "N m") } else { (Quantity::Force, "N") }
            }
        },
        Reads::Span(_) | Reads::Link(_) | Reads::Guide(_) => (Quantity::Force, "N"),
        Reads::Part(PartQuantity::Displacement) => (Quantity::Length, "m"),
        Reads::Part(PartQuantity::Force) => (Quantity::Force, "N"),
        Reads::Part(PartQuantity::Pressure) => (Quantity::Pressure, "Pa"),
        Reads::Part(PartQuantity::Flow) => (Quantity::Flow, "m^3/s"),
        Reads::Reaction(b) if slides(b) => (Quantity::Force, "N"),
        Reads::Reaction(_) => (Quantity::Torque, "N m"),
    }
}
