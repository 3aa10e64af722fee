//! A recorder whose clock runs fast or slow.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "time_base",
    title: "Time base",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "t -> t (1 + c)",
    source: "Quartz: 10 to 100 ppm",
    order: "all orders shifted by the same ratio",
    speed_law: "none",
    channels: "this sensor only",
    parameters: &[Parameter::new("ppm", 1e-6, -1e5, 1e5, Kind::Amplitude).starts(Scale::One, &[1e-4])],
    dissipative: false,
    physics: Physics::Clock(clock),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { look: Some(Look::Lag), ..Kin::NONE },
};

fn clock(p: &[f64]) -> f64 {
    p[0]
}
