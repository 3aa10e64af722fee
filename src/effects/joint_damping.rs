//! Damping of the joints along the chain beyond the declared one: oil that is pressed out of bushes, plates that rub on each other.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "joint_damping",
    title: "Damping of the joints",
    part: Part::Chain,
    on: On::Joints,
    equation: "c = c_declared + damping; not below 0",
    source: "A viscous damper beside the spring of every joint",
    order: "none: heights of modes",
    speed_law: "1",
    channels: "tension, speeds at high orders",
    parameters: &[Parameter::new("damping_n_s_per_m", 1.0, -1e5, 1e5, Kind::Amplitude).starts(Scale::One, &[50.0])],
    dissipative: true,
    physics: Physics::LinksOnly,
    links: Some(On::Joints),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
