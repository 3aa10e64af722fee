//! A span that cannot push: below zero tension it goes slack.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, SpanAt};

pub const ROW: Effect = Effect {
    name: "slack_span",
    title: "Slack span",
    part: Part::Chain,
    on: On::Span,
    equation: "force >= -preload",
    source: "Unilateral spring; the preload is what the span loses before it is slack",
    order: "multiples of what drives it, beyond a threshold",
    speed_law: "0, above a threshold",
    channels: "tension, speeds",
    parameters: &[Parameter::new("preload_n", 1.0, 0.0, 1e9, Kind::Amplitude).off(1e9).starts(Scale::Tension, &[0.5])],
    dissipative: false,
    physics: Physics::SpanForce(force),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn force(p: &[f64], at: SpanAt) -> f64 {
    if at.force < -p[0] { -p[0] - at.force } else { 0.0 }
}
