//! A drive that responds only above a threshold.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};
use crate::units::within;

pub const ROW: Effect = Effect {
    name: "input_dead_zone",
    title: "Dead zone of the drive",
    part: Part::Input,
    on: On::Input,
    equation: "u -> u - clamp(u, -d, d)",
    source: "Brush voltage, valve overlap",
    order: "odd multiples of the input's frequency",
    speed_law: "0",
    channels: "all, at small inputs",
    parameters: &[Parameter::new("width", 1.0, 0.0, 1e9, Kind::Amplitude).starts(Scale::Input, &[0.1])],
    dissipative: false,
    physics: Physics::Input(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn pass(p: &[f64], u: &mut [f64], _step_s: f64, _held: bool) {
    u.iter_mut().for_each(|u| *u -= within(*u, -p[0], p[0]));
}
