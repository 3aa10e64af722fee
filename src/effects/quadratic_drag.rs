//! Drag proportional to the square of speed: a fan, a flywheel in air.

use super::{BodyAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "quadratic_drag",
    title: "Quadratic drag",
    part: Part::Load,
    on: On::Body,
    equation: "M = -k v |v|",
    source: "Newton; a fan's affinity laws",
    order: "none",
    speed_law: "2",
    channels: "mean torque over speed",
    parameters: &[Parameter::new("torque_nm_s2_per_rad2", 1.0, 0.0, 1e6, Kind::Amplitude)
        .sliding("force_n_s2_per_m2")
        .starts(Scale::ForcePerSpeed2, &[0.1])],
    dissipative: true,
    physics: Physics::BodyForce(force),
    links: Some(On::Body),
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("speed-dependent loss"), look: Some(Look::Friction), ..Kin::NONE },
};

fn force(p: &[f64], at: BodyAt) -> f64 {
    -p[0] * at.v * at.v.abs()
}
