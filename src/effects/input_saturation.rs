//! A drive with limited output.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "input_saturation",
    title: "Saturation of the drive",
    part: Part::Input,
    on: On::Input,
    equation: "u -> s tanh(u / s)",
    source: "Amplifier limit, smooth",
    order: "odd multiples of the input's frequency",
    speed_law: "0",
    channels: "all, at large inputs",
    parameters: &[Parameter::new("limit", 1.0, 0.0, 1e9, Kind::Amplitude).off(1e9).starts(Scale::Input, &[2.0])],
    dissipative: false,
    physics: Physics::Input(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("non-linear gain of the drive"), ..Kin::NONE },
};

fn pass(p: &[f64], u: &mut [f64], _step_s: f64, _held: bool) {
    // Above 1e8 no sampled value comes near the limit.
    if p[0] < 1e8 {
        u.iter_mut().for_each(|u| *u = p[0] * libm::tanh(*u / p[0]));
    }
}
