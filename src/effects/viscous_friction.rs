//! Friction proportional to speed.

use super::{BodyAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "viscous_friction",
    title: "Viscous friction",
    part: Part::Load,
    on: On::Body,
    equation: "M = -c v",
    source: "Newton, Petroff",
    order: "none",
    speed_law: "1",
    channels: "mean torque over speed",
    parameters: &[Parameter::new("torque_nm_s_per_rad", 1.0, 0.0, 1e6, Kind::Amplitude)
        .sliding("force_n_s_per_m")
        .starts(Scale::ForcePerSpeed, &[0.1])],
    dissipative: true,
    physics: Physics::BodyForce(force),
    links: Some(On::Body),
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("speed-dependent loss"), look: Some(Look::Friction), ..Kin::NONE },
};

fn force(p: &[f64], at: BodyAt) -> f64 {
    -p[0] * at.v
}
