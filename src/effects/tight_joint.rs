//! One joint with additional friction torque; it dissipates energy only where the chain articulates.

use super::{ChainAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, soft_sign};

pub const ROW: Effect = Effect {
    name: "tight_joint",
    title: "One tight joint",
    part: Part::Chain,
    on: On::Chain,
    equation: "lumped: M = -T sign(v) on a sprocket while the joint enters or leaves it; links: M = -T sign(omega_rel) in the joint",
    source: "Coulomb friction in one joint",
    order: "z/N of the sprockets, two events a sprocket",
    speed_law: "0",
    channels: "torques, speeds; hardly tension before the bend",
    parameters: &[
        Parameter::new("joint", 1.0, 0.0, 100000.0, Kind::Index).starts(Scale::One, &[0.0]),
        Parameter::new("torque_nm", 1.0, 0.0, 1000.0, Kind::Amplitude).starts(Scale::Force, &[0.05]),
    ],
    dissipative: true,
    physics: Physics::ChainTorque(torque),
    links: Some(On::Chain),
    highest_order: HighestOrder::Teeth,
    kin: Kin { look: Some(Look::Chain), ..Kin::NONE },
};

fn torque(p: &[f64], at: ChainAt, v: f64) -> f64 {
    let place = |x: f64| x - libm::floor(x / at.links) * at.links;
    let here = place(p[0] - at.travel - at.from);
    let bend = |d: f64| {
        let d = d - libm::round(d / at.links) * at.links;
        if d * d < 1.0 { (1.0 - d * d) * (1.0 - d * d) } else { 0.0 }
    };
    -p[1] * (bend(here) + bend(here - place(at.to - at.from))) * soft_sign(v, 0.05)
}
