//! An eccentric encoder scale: its angle error repeats once, or n times, per revolution.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, Trace};
use crate::units::DEG;

pub const ROW: Effect = Effect {
    name: "encoder_error",
    title: "Encoder error once per revolution",
    part: Part::Sensor,
    on: On::AngleSensor,
    equation: "angle += e sin(n q + phase); speed += e n v cos(n q + phase)",
    source: "Resor, Trethewey and Maynard 2005",
    order: "n of its shaft, fixed in angle",
    speed_law: "speed ratio constant; taken as a force: 2",
    channels: "this sensor only",
    parameters: &[
        Parameter::new("amplitude_deg", DEG, -90.0, 90.0, Kind::Amplitude).starts(Scale::One, &[0.001]),
        Parameter::new("phase_deg", DEG, -3600.0, 3600.0, Kind::Phase).default(0.0),
        Parameter::new("order", 1.0, 0.5, 200.0, Kind::Whole).default(1.0).starts(Scale::One, &[1.0, 2.0]),
    ],
    dissipative: false,
    physics: Physics::Signal(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { look: Some(Look::Marks), ..Kin::NONE },
};

fn pass(p: &[f64], trace: &mut Trace) {
    if p[0] == 0.0 {
        return;
    }
    for (value, angle) in trace.values.iter_mut().zip(trace.angles) {
        let (s, c) = crate::units::sin_cos(p[2] * angle + p[1]);
        match trace.derivative {
            0 => *value += p[0] * s,
            _ => *value *= 1.0 + p[0] * p[2] * c,
        }
    }
}
