//! A drive that exerts a force at zero signal.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "input_offset",
    title: "Offset of the drive",
    part: Part::Input,
    on: On::Input,
    equation: "u -> u + u_0",
    source: "Amplifier offset",
    order: "none",
    speed_law: "0",
    channels: "all, in the mean",
    parameters: &[Parameter::new("offset", 1.0, -1e9, 1e9, Kind::Amplitude).starts(Scale::Input, &[0.05])],
    dissipative: false,
    physics: Physics::Input(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn pass(p: &[f64], u: &mut [f64], _step_s: f64, _held: bool) {
    u.iter_mut().for_each(|u| *u += p[0]);
}
