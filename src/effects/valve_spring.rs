//! Valve springs that are weaker or stronger than declared: springs that have set, other springs.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "valve_spring",
    title: "Springs of valves",
    part: Part::Load,
    on: On::Valve,
    equation: "force = force_declared (1 + share): preload and rate alike",
    source: "Springs that have set, or other ones than in the drawing: torque on the cam in proportion",
    order: "orders of the cams",
    speed_law: "0, beside the inertia of valves",
    channels: "speed of the camshaft, tension",
    parameters: &[Parameter::new("share_percent", 1e-2, -90.0, 900.0, Kind::Amplitude).starts(Scale::One, &[-0.1])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Valve),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
