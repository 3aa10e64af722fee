//! A channel with a wrong gain.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, Trace, Twin};

pub const ROW: Effect = Effect {
    name: "gain_error",
    title: "Gain error of the channel",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "y -> (1 + g) y",
    source: "Calibration",
    order: "in proportion to the signal",
    speed_law: "none",
    channels: "this sensor only",
    parameters: &[Parameter::new("gain_percent", 0.01, -99.0, 1000.0, Kind::Amplitude).starts(Scale::One, &[0.02])],
    dissipative: false,
    physics: Physics::Signal(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { twin: Some(Twin::SensorGain), ..Kin::NONE },
};

fn pass(p: &[f64], trace: &mut Trace) {
    trace.values.iter_mut().for_each(|v| *v *= 1.0 + p[0]);
}
