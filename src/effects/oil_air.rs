//! Oil that carries more, or less, free air than declared: its bulk modulus falls, at low pressure most.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "oil_air",
    title: "Air in the oil",
    part: Part::Tensioner,
    on: On::Oil,
    equation: "share of free air by volume at ambient pressure = declared + air; between 0 and 50 %",
    source: "Oil with bubbles of ideal gas: src/elements/oil.rs",
    order: "none: stiffness of chambers",
    speed_law: "0",
    channels: "travel of the plunger, pressure, the more the lower it is",
    parameters: &[Parameter::new("air_percent", 1e-2, -50.0, 50.0, Kind::Amplitude).starts(Scale::One, &[0.01])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Oil),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
