//! A check valve that does not close: dirt or a worn seat leaves a hole beside the ball. The oil goes back through it, and the tensioner
//! is soft.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "check_leak",
    title: "Check valve that leaks",
    part: Part::Tensioner,
    on: On::Check,
    equation: "Q = Q_ball + C A sqrt(2 p / rho): an orifice between the same two, with the discharge coefficient of the ball's edge. \
               A sensor of the ball's flow does not show it",
    source: "Flow through a sharp-edged orifice; Merritt 1967, section 3.4",
    order: "none: travel, its order of the excitation, mean pressure",
    speed_law: "0",
    channels: "travel of the plunger, pressure",
    parameters: &[Parameter::new("area_mm2", 1e-6, 0.0, 20.0, Kind::Amplitude).starts(Scale::One, &[5e-8])],
    dissipative: false,
    physics: Physics::LinksOnly,
    links: Some(On::Check),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};
