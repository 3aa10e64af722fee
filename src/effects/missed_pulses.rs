//! Pulses that the recorder missed or counted twice: intervals of twice or half the length of their neighbours.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics};

pub const ROW: Effect = Effect {
    name: "missed_pulses",
    title: "Missed or double pulses",
    part: Part::Sensor,
    on: On::Pickup,
    equation: "dt_i = dt of two intervals, at random",
    source: "Recorder",
    order: "none: single outliers",
    speed_law: "none",
    channels: "this sensor only",
    parameters: &[Parameter::new("share_percent", 0.01, 0.0, 50.0, Kind::Given).default(0.0)],
    dissipative: false,
    physics: Physics::Intake,
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
