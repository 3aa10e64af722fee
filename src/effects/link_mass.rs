//! One link that is heavier or lighter than those of its row: a sensor clipped to it, a plate of another thickness.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

/// One hundredth.
const PERCENT: f64 = 0.01;

pub const ROW: Effect = Effect {
    name: "link_mass",
    title: "One heavier link",
    part: Part::Chain,
    on: On::Chain,
    equation: "m = m_row (1 + mass), J = J_row (1 + inertia) about the same centre",
    source: "Newton and Euler for a rigid body",
    order: "z/N of the sprockets and its multiples",
    speed_law: "2 (inertia forces)",
    channels: "tension, contact forces of one link",
    parameters: &[
        Parameter::new("link", 1.0, 0.0, 100000.0, Kind::Index).starts(Scale::One, &[0.0]),
        Parameter::new("mass_percent", PERCENT, -90.0, 1000.0, Kind::Given).default(0.0),
        Parameter::new("inertia_percent", PERCENT, -90.0, 1000.0, Kind::Given).default(0.0),
    ],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Chain),
    highest_order: HighestOrder::Teeth,
    kin: Kin::NONE,
};
