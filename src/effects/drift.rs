//! A channel whose zero drifts with time.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, Trace};

pub const ROW: Effect = Effect {
    name: "drift",
    title: "Drift of the channel",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "y -> y + d t",
    source: "Temperature of an amplifier",
    order: "none: slow",
    speed_law: "none",
    channels: "this sensor only",
    parameters: &[Parameter::new("per_s", 1.0, -1e9, 1e9, Kind::Amplitude).starts(Scale::SignalPerTime, &[0.1])],
    dissipative: false,
    physics: Physics::Signal(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn pass(p: &[f64], trace: &mut Trace) {
    let step_s = trace.step_s;
    trace.values.iter_mut().enumerate().for_each(|(i, v)| *v += p[0] * i as f64 * step_s);
}
