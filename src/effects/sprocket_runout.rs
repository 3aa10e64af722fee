//! A sprocket with radial runout e (`amplitude`) of its pitch circle: every span at it is longer by e sin(theta +
//! phase).

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};
use crate::units::{DEG, UM};

pub const ROW: Effect = Effect {
    name: "sprocket_runout",
    title: "Eccentric sprocket",
    part: Part::Sprocket,
    on: On::Sprocket,
    equation: "lumped: stretch += e sin(theta + phase); links: all gaps lie beside their places by e, towards the angle `phase`",
    source: "Rigid displacement of the pitch circle; Fyfe and Munk 1997 on what is fixed in angle",
    order: "1 of its shaft",
    speed_law: "0 (quasi-static)",
    channels: "tension, speeds and torques of all bodies at the chain",
    parameters: &[
        Parameter::new("amplitude_um", UM, -500.0, 500.0, Kind::Amplitude).starts(Scale::Micrometre10, &[1.0]),
        Parameter::new("phase_deg", DEG, -3600.0, 3600.0, Kind::Phase).default(0.0),
    ],
    dissipative: false,
    physics: Physics::SpanLength(length),
    links: Some(On::Sprocket),
    highest_order: HighestOrder::Once,
    kin: Kin { look: Some(Look::OncePerTurn), ..Kin::NONE },
};

fn length(p: &[f64], _teeth: u32, angle: f64) -> (f64, f64) {
    let (s, c) = crate::units::sin_cos(angle + p[1]);
    (p[0] * s, p[0] * c)
}
