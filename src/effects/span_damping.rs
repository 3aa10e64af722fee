//! Damping of a span or coupling in addition to the declared one.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, SpanAt, Twin};

pub const ROW: Effect = Effect {
    name: "span_damping",
    title: "Span damping",
    part: Part::Chain,
    on: On::Span,
    equation: "force += dc stretch'",
    source: "Kelvin-Voigt",
    order: "none: width of the resonance",
    speed_law: "1",
    channels: "all, at the resonance",
    parameters: &[
        Parameter::new("damping_n_s_per_m", 1.0, 0.0, 1e9, Kind::Amplitude).starts(Scale::StiffnessTime, &[0.05])
    ],
    dissipative: true,
    physics: Physics::SpanForce(force),
    links: Some(On::Span),
    highest_order: HighestOrder::None,
    kin: Kin { twin: Some(Twin::SpanDamping), ..Kin::NONE },
};

fn force(p: &[f64], at: SpanAt) -> f64 {
    p[0] * at.rate
}
