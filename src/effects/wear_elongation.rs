//! Uniform elongation of all links by wear of pins and bushes.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};
use crate::units::UM;

pub const ROW: Effect = Effect {
    name: "wear_elongation",
    title: "Uniform wear elongation",
    part: Part::Chain,
    on: On::Joints,
    equation: "pitch += length for every link",
    source: "Wear in pin and bush, ISO 606 elongation limit",
    order: "none: phase between shafts, mean tension",
    speed_law: "0",
    channels: "transmission phase, mean tension",
    parameters: &[Parameter::new("length_um", UM, -200.0, 200.0, Kind::Amplitude).starts(Scale::Micrometre10, &[0.1])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Joints),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
