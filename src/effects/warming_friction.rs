//! Friction that fades within a record, as oil and bearings warm up, or grows.

use super::{BodyAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, soft_sign};

pub const ROW: Effect = Effect {
    name: "warming_friction",
    title: "Friction that fades within a record",
    part: Part::Load,
    on: On::Body,
    equation: "M = -T exp(-t / tau) v / sqrt(v^2 + v_s^2), t from the start of the record; T < 0 where friction grows",
    source: "Warming up with one time constant; Coulomb friction",
    order: "none: time since the start",
    speed_law: "0",
    channels: "mean torque, first more than last",
    parameters: &[
        Parameter::new("torque_nm", 1.0, -1e6, 1e6, Kind::Amplitude).sliding("force_n").starts(Scale::Force, &[0.1]),
        Parameter::new("time_s", 1.0, 1e-6, 1e7, Kind::Shape).starts(Scale::RecordTime, &[0.1, 0.5]),
        Parameter::new("stick_speed_rad_s", 1.0, 1e-6, 1e4, Kind::Shape)
            .sliding("stick_speed_m_s")
            .default(0.1)
            .default_of_slides(0.01)
            .starts(Scale::Speed, &[0.03]),
    ],
    dissipative: false,
    physics: Physics::TimedForce(force),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("friction"), look: Some(Look::Friction), ..Kin::NONE },
};

fn force(p: &[f64], at: BodyAt, t_s: f64) -> f64 {
    -p[0] * libm::exp(-t_s / p[1]) * soft_sign(at.v, p[2])
}
