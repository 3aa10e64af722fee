//! A channel in a file of its own whose clock runs slow or fast beside that of the record.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "clock_drift",
    title: "Error of the declared drift of a file's clock",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "y(t) -> y(t + e t), t since the record began, e: the true drift minus `drift_percent`",
    source: "Quartz: 10 to 100 ppm; loops of programs: percents",
    order: "all orders shifted by the same ratio",
    speed_law: "none",
    channels: "this sensor only, where its record has several files",
    parameters: &[Parameter::new("percent", 1e-2, -10.0, 10.0, Kind::Amplitude).starts(Scale::One, &[1e-3])],
    dissipative: false,
    physics: Physics::OwnClock(ahead),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { look: Some(Look::Lag), ..Kin::NONE },
};

fn ahead(p: &[f64], t_s: f64) -> f64 {
    p[0] * t_s
}
