//! Friction that is higher near standstill than in motion.

use super::{BodyAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, soft_sign};

pub const ROW: Effect = Effect {
    name: "stribeck_friction",
    title: "Stribeck friction",
    part: Part::Load,
    on: On::Body,
    equation: "M = -T exp(-(v / v_s)^2) s(v / v_s), s(x) = x / sqrt(x^2 + 0.04)",
    source: "Armstrong-Helouvry, Dupont and Canudas de Wit 1994, equation 5",
    order: "none: low speeds",
    speed_law: "below 0",
    channels: "torque near standstill",
    parameters: &[
        Parameter::new("torque_nm", 1.0, 0.0, 1e6, Kind::Amplitude).sliding("force_n").starts(Scale::Force, &[0.1]),
        Parameter::new("stribeck_speed_rad_s", 1.0, 1e-6, 1e4, Kind::Shape)
            .sliding("stribeck_speed_m_s")
            .default(0.5)
            .starts(Scale::Speed, &[0.1, 0.5]),
    ],
    dissipative: true,
    physics: Physics::BodyForce(force),
    links: Some(On::Body),
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("friction"), look: Some(Look::Friction), ..Kin::NONE },
};

fn force(p: &[f64], at: BodyAt) -> f64 {
    let x = at.v / p[1];
    -p[0] * libm::exp(-x * x) * soft_sign(x, 0.2)
}
