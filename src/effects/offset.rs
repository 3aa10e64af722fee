//! A channel with a zero offset.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, Trace};

pub const ROW: Effect = Effect {
    name: "offset",
    title: "Offset of the channel",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "y -> y + y_0",
    source: "Calibration",
    order: "none: constant",
    speed_law: "none",
    channels: "this sensor only",
    parameters: &[Parameter::new("offset", 1.0, -1e9, 1e9, Kind::Amplitude).starts(Scale::Signal, &[0.05])],
    dissipative: false,
    physics: Physics::Signal(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn pass(p: &[f64], trace: &mut Trace) {
    trace.values.iter_mut().for_each(|v| *v += p[0]);
}
