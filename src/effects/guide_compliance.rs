//! A compliant guide or fixed rail: behind its contact it stands on a spring and a damper of its own, and moves along its normal; a rail along
//! that of the line from its beginning to its end.
//!
//! ```text
//! m x'' = -(force of the chain along its way) - k x - c x'      k = 1 / compliance,  c = 2 zeta sqrt(k m)
//! ```
//! x is the way of the guide towards the chain. At rest it stands back by force times compliance. The contact keeps its own law, and sees the
//! guide's speed. The whole guide moves: 200 mm of a bar of polyamide, 8 x 11 mm at 1140 kg/m3, have 20 g. A lighter
//! one needs a smaller step, because the dampers of all plates on it act on its mass.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "guide_compliance",
    title: "Guide compliance",
    part: Part::Guide,
    on: On::Guide,
    equation: "m x'' + 2 zeta sqrt(k m) x' + k x = -F, F the force of the chain along its way; k = 1/compliance",
    source: "A mass on a spring and a damper behind the contact; mass and damping are assumed: 200 mm of a bar of polyamide, loss factor 0.2",
    order: "none: a mode of the guide",
    speed_law: "0",
    channels: "guide force, tension",
    parameters: &[
        Parameter::new("compliance_um_per_kn", 1e-9, 0.0, 1e6, Kind::Amplitude).starts(Scale::One, &[1e-7, 1e-6]),
        Parameter::new("mass_g", 1e-3, 0.1, 1e6, Kind::Given).default(20.0),
        Parameter::new("damping_ratio", 1.0, 0.0, 10.0, Kind::Given).default(0.1),
    ],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Guide),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
