//! Cumulative pitch error of a sprocket: tooth gaps displaced along the pitch circle by e sin(n theta + phase).

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};
use crate::units::{DEG, UM};

pub const ROW: Effect = Effect {
    name: "tooth_pitch_error",
    title: "Cumulative tooth pitch error",
    part: Part::Sprocket,
    on: On::Sprocket,
    equation: "lumped: stretch += e sin(n theta + phase), n = 2 to 5; links: gap k lies further on by e sin(n 2 pi k / z + phase)",
    source: "Total cumulative pitch deviation as for gears, ISO 1328-1",
    order: "2 to 5 of its shaft",
    speed_law: "0 (quasi-static)",
    channels: "transmission error, tension",
    parameters: &[
        Parameter::new("amplitude_um", UM, -500.0, 500.0, Kind::Amplitude).starts(Scale::Micrometre10, &[1.0]),
        Parameter::new("phase_deg", DEG, -3600.0, 3600.0, Kind::Phase).default(0.0),
        Parameter::new("order", 1.0, 2.0, 5.0, Kind::Whole).default(2.0).starts(Scale::One, &[2.0, 3.0, 4.0]),
    ],
    dissipative: false,
    physics: Physics::SpanLength(length),
    links: Some(On::Sprocket),
    highest_order: HighestOrder::Parameter(2),
    kin: Kin { look: Some(Look::OncePerTurn), ..Kin::NONE },
};

fn length(p: &[f64], _teeth: u32, angle: f64) -> (f64, f64) {
    let (s, c) = crate::units::sin_cos(p[2] * angle + p[1]);
    (p[0] * s, p[0] * p[2] * c)
}
