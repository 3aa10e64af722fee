//! Joints that give way more, or less, than declared: worn or badly oiled bushes, bent pins, bending plates in series with them.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "joint_stiffness",
    title: "Stiffness of the joints",
    part: Part::Chain,
    on: On::Joints,
    equation: "k = k_declared (1 + share)",
    source: "Springs in series: plates, pins and bushes; measured links of 8 to 9.5 mm pitch have 1e7 to 5e7 N/m",
    order: "none: frequencies of sprockets on spans, mean travel of a tensioner",
    speed_law: "0",
    channels: "speeds, tension, travel of the tensioner, near modes above all",
    parameters: &[Parameter::new("share_percent", 1e-2, -90.0, 900.0, Kind::Amplitude).starts(Scale::One, &[0.1])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Joints),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
