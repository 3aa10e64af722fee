//! A load independent of speed and direction, such as a weight or an offset of the drive.

use super::{BodyAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "constant_torque",
    title: "Constant load",
    part: Part::Load,
    on: On::Body,
    equation: "M = -T",
    source: "Gravity, offset current",
    order: "none",
    speed_law: "0",
    channels: "mean torque, in both directions the same",
    parameters: &[Parameter::new("torque_nm", 1.0, -1e6, 1e6, Kind::Amplitude)
        .sliding("force_n")
        .starts(Scale::Force, &[0.1])],
    dissipative: false,
    physics: Physics::BodyForce(force),
    links: Some(On::Body),
    highest_order: HighestOrder::None,
    kin: Kin { look: Some(Look::Friction), ..Kin::NONE },
};

fn force(p: &[f64], _at: BodyAt) -> f64 {
    -p[0]
}
