//! A torque that repeats every revolution, or n times in it: cam lobes, cogging, an eccentric weight.

use super::{BodyAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};
use crate::units::DEG;

pub const ROW: Effect = Effect {
    name: "torque_ripple",
    title: "Torque harmonic of a shaft",
    part: Part::Load,
    on: On::Body,
    equation: "M = T sin(n q + phase)",
    source: "Fourier series over the shaft's angle",
    order: "n of its shaft",
    speed_law: "0",
    channels: "torques and speeds; falls with speed in the speed",
    parameters: &[
        Parameter::new("torque_nm", 1.0, -1e6, 1e6, Kind::Amplitude).sliding("force_n").starts(Scale::Force, &[0.1]),
        Parameter::new("phase_deg", DEG, -3600.0, 3600.0, Kind::Phase).default(0.0),
        Parameter::new("order", 1.0, 0.5, 200.0, Kind::Whole)
            .default(1.0)
            .starts(Scale::One, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0]),
    ],
    dissipative: false,
    physics: Physics::BodyForce(force),
    links: Some(On::Body),
    highest_order: HighestOrder::Parameter(2),
    kin: Kin { look: Some(Look::OncePerTurn), ..Kin::NONE },
};

fn force(p: &[f64], at: BodyAt) -> f64 {
    p[0] * libm::sin(p[2] * at.q + p[1])
}
