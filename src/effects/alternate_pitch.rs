//! Inner and outer links of different pitch: over each pair of links the chain length varies by half of the difference.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};
use crate::units::{DEG, UM};

pub const ROW: Effect = Effect {
    name: "alternate_pitch",
    title: "Alternate pitch of inner and outer links",
    part: Part::Chain,
    on: On::Sprocket,
    equation: "lumped: stretch += d/4 sin(z theta / 2 + phase); links: inner links d/2 longer, outer ones d/2 shorter",
    source: "Inner and outer plates are cut and worn apart; ISO 606, length tolerance",
    order: "z/2 of the sprockets",
    speed_law: "0 (quasi-static)",
    channels: "tension, speeds, contact forces",
    parameters: &[
        Parameter::new("difference_um", UM, -500.0, 500.0, Kind::Amplitude).starts(Scale::Micrometre10, &[1.0]),
        Parameter::new("phase_deg", DEG, -3600.0, 3600.0, Kind::Phase).default(0.0).lumped_only(),
    ],
    dissipative: false,
    physics: Physics::SpanLength(length),
    links: Some(On::Joints),
    highest_order: HighestOrder::Teeth,
    kin: Kin { look: Some(Look::Chain), ..Kin::NONE },
};

fn length(p: &[f64], teeth: u32, angle: f64) -> (f64, f64) {
    let half = 0.5 * f64::from(teeth);
    let (s, c) = crate::units::sin_cos(half * angle + p[1]);
    (0.25 * p[0] * s, 0.25 * p[0] * half * c)
}
