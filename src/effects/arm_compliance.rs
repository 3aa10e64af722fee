//! A compliant arm: its rails stand on a spring and a damper before its back, which the tensioner presses. Rails and back turn about the pivot.
//!
//! ```text
//! (1 - b) I a''   = T_chain + k (a_back - a) + c (a_back' - a')          k = 1 / compliance
//! b I a_back''    = T_tips + T_stops + T_spring - k (a_back - a) - c (a_back' - a')
//! c = 2 zeta sqrt(k b (1 - b) I)
//! ```
//! I is the arm's inertia, b the share of its back, a the angle of its rails, which sensors of the arm read and loads on it act on. Where back and
//! rails are free they swing against each other with w^2 = k / (b (1 - b) I). It is the first bending mode of an arm between the pads of its tensioner
//! and its face, in the two numbers that a mode has. An arm that gives way by d under a force F whose line passes the pivot at a
//! distance L has a compliance of d / (F L^2).

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "arm_compliance",
    title: "Compliance of an arm",
    part: Part::Tensioner,
    on: On::Arm,
    equation: "rails: (1 - b) I a'' = T_chain + k (a_back - a) + c (a_back' - a'); back: b I a_back'' = T_tensioner - k (a_back - a) - c (a_back' - a'); k = 1/compliance",
    source: "Two inertias on a torsion spring (Den Hartog, Mechanical Vibrations); share of the back and damping are assumed: 30 %, loss factor 0.2 of polyamide",
    order: "none: a mode of the arm",
    speed_law: "0",
    channels: "acceleration of the arm, tension",
    parameters: &[
        Parameter::new("compliance_urad_per_nm", 1e-6, 0.0, 1e6, Kind::Amplitude).starts(Scale::One, &[1e-5, 1e-4]),
        Parameter::new("back_percent", 1e-2, 1.0, 99.0, Kind::Given).default(30.0),
        Parameter::new("damping_ratio", 1.0, 0.0, 10.0, Kind::Given).default(0.1),
    ],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Arm),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
