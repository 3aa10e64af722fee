//! Chordal action that the declared model lacks: the pitch line rises and falls once per tooth.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};
use crate::units::{DEG, UM};

pub const ROW: Effect = Effect {
    name: "polygon",
    title: "Polygon effect of a sprocket",
    part: Part::Sprocket,
    on: On::Sprocket,
    equation: "stretch += a sin(z theta + phase), a about p / (8 z^2) or less",
    source: "Binder 1956, after Mahalingam 1958",
    order: "z of its shaft",
    speed_law: "0, transverse 2",
    channels: "tension, speeds",
    parameters: &[
        Parameter::new("amplitude_um", UM, -5000.0, 5000.0, Kind::Amplitude).starts(Scale::Micrometre10, &[0.1]),
        Parameter::new("phase_deg", DEG, -3600.0, 3600.0, Kind::Phase).default(0.0),
    ],
    dissipative: false,
    physics: Physics::SpanLength(length),
    links: None,
    highest_order: HighestOrder::Teeth,
    kin: Kin { look: Some(Look::OncePerTurn), ..Kin::NONE },
};

fn length(p: &[f64], teeth: u32, angle: f64) -> (f64, f64) {
    let z = f64::from(teeth);
    let (s, c) = crate::units::sin_cos(z * angle + p[1]);
    (p[0] * s, p[0] * z * c)
}
