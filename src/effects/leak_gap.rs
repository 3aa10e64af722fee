//! A plunger that is looser, or tighter, in its bore than declared: what leaks past it goes with the cube of the gap.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};
use crate::units::UM;

pub const ROW: Effect = Effect {
    name: "leak_gap",
    title: "Leak gap of a plunger",
    part: Part::Tensioner,
    on: On::Leak,
    equation: "g = g_declared + gap; Q = pi d g^3 (1 + 3/2 e^2) p / (12 mu l). A gap below 0.1 um counts as 0.1 um",
    source: "Flow through an annular gap; Merritt 1967, section 2.5",
    order: "none: travel, its order of the excitation, mean pressure",
    speed_law: "0",
    channels: "travel of the plunger, pressure, leakage, slack span",
    parameters: &[Parameter::new("gap_um", UM, -500.0, 500.0, Kind::Amplitude).starts(Scale::One, &[4e-6])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Leak),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
