//! Oil that is thicker, or thinner, than declared: colder, warmer, or another one. Where all oil leaks through one gap, a wider gap does the same.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "oil_viscosity",
    title: "Viscosity of the oil",
    part: Part::Tensioner,
    on: On::Oil,
    equation: "mu = mu_declared (1 + share)",
    source: "Engine oils halve their viscosity over some 20 degrees; ASTM D341",
    order: "none: what leaks, drag of plungers",
    speed_law: "1",
    channels: "travel of the plunger, pressure, leakage",
    parameters: &[Parameter::new("share_percent", 1e-2, -90.0, 900.0, Kind::Amplitude).starts(Scale::One, &[0.2])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Oil),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
