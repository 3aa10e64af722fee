//! Friction of the chain on a guide in addition to the declared friction.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "guide_friction",
    title: "Guide friction",
    part: Part::Guide,
    on: On::Guide,
    equation: "F_t = -(mu + dmu) F_n sign(v)",
    source: "Coulomb friction",
    order: "none: mean torque goes with guide force",
    speed_law: "0",
    channels: "torques; tension along the guide",
    parameters: &[Parameter::new("friction", 1.0, -1.0, 2.0, Kind::Amplitude).starts(Scale::One, &[0.05])],
    dissipative: true,
    physics: Physics::LinksOnly,
    links: Some(On::Guide),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
