//! A torsion spring between two shafts that is softer or stiffer than declared.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "coupling_stiffness",
    title: "Stiffness of a coupling",
    part: Part::Shaft,
    on: On::Coupling,
    equation: "k = k_declared (1 + share)",
    source: "Torsion springs between shafts: joints, keys and slender shafts give way beside what is declared",
    order: "none: torsional frequencies",
    speed_law: "0",
    channels: "speeds on both sides, near the mode above all",
    parameters: &[Parameter::new("share_percent", 1e-2, -90.0, 900.0, Kind::Amplitude).starts(Scale::One, &[-0.1])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Coupling),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
