//! A blade that bends more easily than declared, or less: warm or aged plastic, another leaf spring.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "blade_stiffness",
    title: "Bending stiffness of a blade",
    part: Part::Tensioner,
    on: On::Blade,
    equation: "EI = EI_declared (1 + share); the curvatures without load stay",
    source: "Beam theory; plastics soften as they warm and take up water",
    order: "none: tension of the slack span, frequencies of the blade",
    speed_law: "0",
    channels: "tension of the slack span, speeds",
    parameters: &[Parameter::new("share_percent", 1e-2, -90.0, 900.0, Kind::Amplitude).starts(Scale::One, &[-0.2, 0.2])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Blade),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
