//! A plain bearing that is wider than declared by wear, or tighter. Radial.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "bearing_clearance",
    title: "Clearance of a plain bearing",
    part: Part::Shaft,
    on: On::Bearing,
    equation: "c = c_declared + clearance, radial; forces of the film go as c^-2 to c^-3; below 0.1 um counts as 0.1 um",
    source: "Worn or tight bearings; short bearing of Ocvirk 1952",
    order: "none: the journal stands and moves further from the middle",
    speed_law: "falls with speed",
    channels: "tension, speeds; the place of the journal",
    parameters: &[Parameter::new("clearance_um", 1e-6, -1000.0, 1000.0, Kind::Amplitude).starts(Scale::One, &[1e-5])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Bearing),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
