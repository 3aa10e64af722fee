//! Friction that grows with the force of the drive: a gear, a screw or a belt between motor and load.

use super::{BodyAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, soft_sign};

pub const ROW: Effect = Effect {
    name: "load_friction",
    title: "Friction that grows with the drive's force",
    part: Part::Load,
    on: On::Input,
    equation: "M = -a |F| v / sqrt(v^2 + v_s^2), F the force of the input on its body",
    source: "Efficiency of a transmission: 1 - a driving, 1 + a driven; the sign smoothed",
    order: "none: size of the input, sign of the speed",
    speed_law: "0",
    channels: "all, by the input's size; kink at reversal of the speed",
    parameters: &[
        Parameter::new("loss_percent", 0.01, 0.0, 100.0, Kind::Amplitude).starts(Scale::One, &[0.1]),
        Parameter::new("stick_speed_rad_s", 1.0, 1e-6, 1e4, Kind::Shape)
            .sliding("stick_speed_m_s")
            .default(0.1)
            .default_of_slides(0.01)
            .starts(Scale::Speed, &[0.03, 0.3]),
    ],
    dissipative: true,
    physics: Physics::LoadedForce(force),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("friction"), look: Some(Look::Friction), ..Kin::NONE },
};

fn force(p: &[f64], at: BodyAt, load: f64) -> f64 {
    -p[0] * load.abs() * soft_sign(at.v, p[1])
}
