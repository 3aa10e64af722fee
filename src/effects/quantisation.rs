//! A channel with finite resolution.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Trace};

pub const ROW: Effect = Effect {
    name: "quantisation",
    title: "Quantisation",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "y -> round(y / s) s",
    source: "Analogue-digital converter, pulse counting",
    order: "a grid of values",
    speed_law: "1 for pulse counts",
    channels: "this sensor only",
    parameters: &[Parameter::new("step", 1.0, 0.0, 1e9, Kind::Given)],
    dissipative: false,
    physics: Physics::Signal(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn pass(p: &[f64], trace: &mut Trace) {
    if p[0] > 0.0 {
        trace.values.iter_mut().for_each(|v| *v = libm::round(*v / p[0]) * p[0]);
    }
}
