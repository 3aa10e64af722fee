//! A sensor that does not show the direction of motion, such as a pulse counter.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, Trace};

pub const ROW: Effect = Effect {
    name: "sign_blind",
    title: "Sign-blind sensor",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "y -> |y|",
    source: "Pulse counters count; Wigren and Schoukens 2017 for the coupled drives",
    order: "kinks at zero, never below",
    speed_law: "none",
    channels: "this sensor only",
    parameters: &[Parameter::new("blind", 1.0, 0.0, 1.0, Kind::Whole).default(1.0).starts(Scale::One, &[1.0])],
    dissipative: false,
    physics: Physics::Signal(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn pass(p: &[f64], trace: &mut Trace) {
    if p[0] > 0.5 {
        trace.values.iter_mut().for_each(|v| *v = v.abs());
    }
}
