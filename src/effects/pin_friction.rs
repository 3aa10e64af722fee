//! Friction of the pins in their bushes as the chain articulates onto and off a sprocket.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, soft_sign};
use crate::units::UM;

pub const ROW: Effect = Effect {
    name: "pin_friction",
    title: "Articulation friction",
    part: Part::Chain,
    on: On::Joints,
    equation: "M = -mu r_pin F_joint sign(omega_rel); lumped: -arm |tension| sign(v) at both ends of each span",
    source: "Coulomb friction in pins; Stamboulides et al. 2012 on chain losses",
    order: "z of the sprockets; mean torque goes with tension",
    speed_law: "0",
    channels: "torques; mean loss goes with tension",
    parameters: &[
        Parameter::new("friction", 1.0, 0.0, 2.0, Kind::Amplitude).default(0.0).starts(Scale::One, &[0.1]),
        Parameter::new("arm_um", UM, 0.0, 50000.0, Kind::Amplitude)
            .lumped_only()
            .default(0.0)
            .starts(Scale::Micrometre10, &[10.0]),
    ],
    dissipative: true,
    physics: Physics::SpanLoss(torque),
    links: Some(On::Joints),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn torque(p: &[f64], tension: f64, v: f64) -> f64 {
    -p[1] * tension.abs() * soft_sign(v, 0.05)
}
