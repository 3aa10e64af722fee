//! A span or coupling whose stiffness increases or decreases with its stretch.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, SpanAt};

pub const ROW: Effect = Effect {
    name: "span_hardening",
    title: "Non-linear stiffness",
    part: Part::Chain,
    on: On::Span,
    equation: "force += k2 stretch |stretch|",
    source: "First odd term beyond Hooke's law with a kink-free slope",
    order: "none: resonance shifts with load",
    speed_law: "0",
    channels: "all, with load",
    parameters: &[Parameter::new("stiffness_n_per_m2", 1.0, -1e15, 1e15, Kind::Amplitude)
        .starts(Scale::StiffnessPerStretch, &[0.1])],
    dissipative: false,
    physics: Physics::SpanForce(force),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn force(p: &[f64], at: SpanAt) -> f64 {
    p[0] * at.stretch * at.stretch.abs()
}
