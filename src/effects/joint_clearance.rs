//! Play of every pin in its bush beyond the declared one, as wear leaves it. The chain becomes longer under load, and bears nothing within the play.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "joint_clearance",
    title: "Clearance of the joints",
    part: Part::Chain,
    on: On::Joints,
    equation: "no force within c = c_declared + clearance; beyond it F = k (|u| - c) + c |u|'",
    source: "Worn bushes and pins: radial play; the laws of the joint itself",
    order: "none: a slack span hangs without force, a tight one is longer by the clearance a link",
    speed_law: "0",
    channels: "tension of the slack span, travel of the tensioner",
    parameters: &[Parameter::new("clearance_um", 1e-6, 0.0, 200.0, Kind::Amplitude).starts(Scale::One, &[5e-6])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Joints),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
