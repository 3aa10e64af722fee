//! A span that is stiffer or softer than declared.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, SpanAt, Twin};

pub const ROW: Effect = Effect {
    name: "span_stiffness",
    title: "Span stiffness",
    part: Part::Chain,
    on: On::Span,
    equation: "force += dk stretch",
    source: "Linear spring",
    order: "none: torsional resonance shifts",
    speed_law: "0",
    channels: "all, at the resonance",
    parameters: &[
        Parameter::new("stiffness_n_per_m", 1.0, -1e12, 1e12, Kind::Amplitude).starts(Scale::Stiffness, &[-0.1])
    ],
    dissipative: false,
    physics: Physics::SpanForce(force),
    links: Some(On::Span),
    highest_order: HighestOrder::None,
    kin: Kin { twin: Some(Twin::SpanStiffness), ..Kin::NONE },
};

fn force(p: &[f64], at: SpanAt) -> f64 {
    p[0] * at.stretch
}
