//! Dry friction that first gives way like a spring: asperities bend before they slip.
//!
//! ```text
//! M = -T z      z' = (v - |v| z) / s
//! ```
//! z lies between -1 and 1. A small motion from rest is held by a spring of stiffness T / s, a long one slides with T.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, StateLaw};

pub const ROW: Effect = Effect {
    name: "presliding_friction",
    title: "Friction that bends before it slips",
    part: Part::Load,
    on: On::Body,
    equation: "M = -T z, z' = (v - |v| z) / s",
    source: "Dahl 1968; Canudas de Wit, Olsson, Astrom and Lischinsky 1995",
    order: "none: distance since the last reversal",
    speed_law: "0",
    channels: "mean torque; a loop over the angle at each reversal",
    parameters: &[
        Parameter::new("torque_nm", 1.0, 0.0, 1e6, Kind::Amplitude).sliding("force_n").starts(Scale::Force, &[0.1]),
        Parameter::new("slip_rad", 1.0, 1e-9, 1e4, Kind::Shape)
            .sliding("slip_m")
            .default(0.01)
            .starts(Scale::SampleTravel, &[3.0, 30.0, 300.0]),
        Parameter::new("start", 1.0, -1.0, 1.0, Kind::Start).default(0.0),
    ],
    dissipative: false,
    physics: Physics::StateForce(StateLaw { force, moved, start: 2, stiffness, fastest }),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("friction"), look: Some(Look::Friction), ..Kin::NONE },
};

fn force(p: &[f64], z: f64) -> f64 {
    -p[0] * z
}

/// Over a distance in one direction z runs to 1 or -1, whatever the speed.
fn moved(p: &[f64], z: f64, distance: f64) -> f64 {
    let end = 1.0_f64.copysign(distance);
    end + (z - end) * libm::exp(-distance.abs() / p[1])
}

fn stiffness(p: &[f64]) -> f64 {
    p[0] / p[1]
}

fn fastest(p: &[f64], v: f64) -> f64 {
    v.abs() / p[1]
}
