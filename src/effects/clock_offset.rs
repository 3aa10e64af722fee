//! A channel in a file of its own whose clock was put forward by too little or too much.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "clock_offset",
    title: "Error of the declared offset of a file's clock",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "y(t) -> y(t + o), o: the true offset minus `offset_ms`",
    source: "Two recorders that were started by hand",
    order: "phase in proportion to frequency",
    speed_law: "none",
    channels: "this sensor only, where its record has several files",
    parameters: &[Parameter::new("offset_ms", 1e-3, -1e5, 1e5, Kind::Amplitude).starts(Scale::SampleTime, &[0.5])],
    dissipative: false,
    physics: Physics::OwnClock(ahead),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { look: Some(Look::Lag), ..Kin::NONE },
};

fn ahead(p: &[f64], _t_s: f64) -> f64 {
    p[0]
}
