//! Inertia that varies over a revolution, or an eccentric mass: a torque proportional to the square of speed.

use super::{BodyAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};
use crate::units::DEG;

pub const ROW: Effect = Effect {
    name: "unbalance",
    title: "Unbalance",
    part: Part::Load,
    on: On::Body,
    equation: "M = m v^2 sin(q + phase)",
    source: "Inertia force of an eccentric mass",
    order: "1 of its shaft",
    speed_law: "2",
    channels: "torques and speeds; the same share at every speed",
    parameters: &[
        Parameter::new("inertia_kg_m2", 1.0, -1e6, 1e6, Kind::Amplitude)
            .sliding("mass_kg")
            .starts(Scale::ForcePerSpeed2, &[0.1]),
        Parameter::new("phase_deg", DEG, -3600.0, 3600.0, Kind::Phase).default(0.0),
    ],
    dissipative: false,
    physics: Physics::BodyForce(force),
    links: Some(On::Body),
    highest_order: HighestOrder::Once,
    kin: Kin { look: Some(Look::OncePerTurn), ..Kin::NONE },
};

fn force(p: &[f64], at: BodyAt) -> f64 {
    p[0] * at.v * at.v * libm::sin(at.q + p[1])
}
