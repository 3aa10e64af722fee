//! A drive whose gain differs between positive and negative signals.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "input_gain_by_sign",
    title: "Gain of the drive that differs by sign",
    part: Part::Input,
    on: On::Input,
    equation: "u -> u + b |u|: gain 1 + b forwards, 1 - b backwards",
    source: "Amplifier with two half bridges; cylinder with a piston rod on one side",
    order: "none: sign of the input",
    speed_law: "0",
    channels: "all, by the input's sign",
    parameters: &[
        Parameter::new("difference_percent", 0.01, -100.0, 100.0, Kind::Amplitude).starts(Scale::One, &[0.05])
    ],
    dissipative: false,
    physics: Physics::Input(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("non-linear gain of the drive"), ..Kin::NONE },
};

fn pass(p: &[f64], u: &mut [f64], _step_s: f64, _held: bool) {
    u.iter_mut().for_each(|u| *u += p[0] * u.abs());
}
