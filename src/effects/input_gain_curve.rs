//! A drive whose gain increases or decreases with its signal.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "input_gain_curve",
    title: "Gain curve of the drive",
    part: Part::Input,
    on: On::Input,
    equation: "u -> u (1 + b |u|)",
    source: "First even term of a gain over its signal",
    order: "none: size of the input",
    speed_law: "0",
    channels: "all, by the input's size",
    parameters: &[Parameter::new("per_unit", 1.0, -1e6, 1e6, Kind::Amplitude).starts(Scale::PerInput, &[0.1])],
    dissipative: false,
    physics: Physics::Input(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("non-linear gain of the drive"), ..Kin::NONE },
};

fn pass(p: &[f64], u: &mut [f64], _step_s: f64, _held: bool) {
    u.iter_mut().for_each(|u| *u *= 1.0 + p[0] * u.abs());
}
