//! A hole that is wider, or narrower, than declared: worn, or clogged with dirt.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};
use crate::units::UM;

pub const ROW: Effect = Effect {
    name: "orifice_diameter",
    title: "Diameter of an orifice",
    part: Part::Tensioner,
    on: On::Orifice,
    equation: "d = d_declared + diameter; Q = C pi d^2/4 sqrt(2 p / rho). A hole below 1 um counts as 1 um",
    source: "Flow through a sharp-edged orifice; Merritt 1967, section 3.4",
    order: "none: travel, its order of the excitation, mean pressure",
    speed_law: "0",
    channels: "travel of the plunger, pressure, flow",
    parameters: &[Parameter::new("diameter_um", UM, -5000.0, 5000.0, Kind::Amplitude).starts(Scale::One, &[1e-4])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Orifice),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
