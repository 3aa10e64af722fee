//! Dry friction of a bearing or slide.

use super::{BodyAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, soft_sign};

const STICK_SPEED: Parameter = Parameter::new("stick_speed_rad_s", 1.0, 1e-6, 1e4, Kind::Shape)
    .sliding("stick_speed_m_s")
    .default(0.1)
    .default_of_slides(0.01)
    .starts(Scale::Speed, &[0.03, 0.3]);
/// What a plunger does hardly depends on it, and its fit took most runs.
const STICK_SPEED_ON_LINKS: Parameter = Parameter { kind: Kind::Tried, ..STICK_SPEED };

pub const ROW: Effect = Effect {
    name: "coulomb_friction",
    title: "Coulomb friction",
    part: Part::Load,
    on: On::Body,
    equation: "M = -T v / sqrt(v^2 + v_s^2)",
    source: "Coulomb; the sign smoothed",
    order: "none: sign of the speed",
    speed_law: "0",
    channels: "mean torque; kink at reversal",
    parameters: &[
        Parameter::new("torque_nm", 1.0, 0.0, 1e6, Kind::Amplitude).sliding("force_n").starts(Scale::Force, &[0.1]),
        STICK_SPEED.on_links(&STICK_SPEED_ON_LINKS),
    ],
    dissipative: true,
    physics: Physics::BodyForce(force),
    links: Some(On::Body),
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("friction"), look: Some(Look::Friction), ..Kin::NONE },
};

fn force(p: &[f64], at: BodyAt) -> f64 {
    -p[0] * soft_sign(at.v, p[1])
}
