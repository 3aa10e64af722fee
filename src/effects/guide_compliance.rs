//! A compliant guide: its contact acts in series with its mounting.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "guide_compliance",
    title: "Guide compliance",
    part: Part::Guide,
    on: On::Guide,
    equation: "1/k = 1/k_contact + 1/k_guide",
    source: "Springs in series; the guide without mass",
    order: "none: a mode of the guide",
    speed_law: "0",
    channels: "guide force, tension",
    parameters: &[
        Parameter::new("compliance_um_per_kn", 1e-9, 0.0, 1e6, Kind::Amplitude).starts(Scale::One, &[1e-7, 1e-6])
    ],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Guide),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
