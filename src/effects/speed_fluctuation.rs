//! A prescribed speed that fluctuates once or n times a revolution, by firing orders or a universal joint.
//!
//! ```text
//! v = v_0 (1 + a sin(n q + phase)) / sqrt(1 - a^2)
//! ```
//! A turn takes the integral of dq / v, which the root makes 2 pi / v_0: v_0 is the mean speed over time, as counters of turns read it.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};
use crate::units::DEG;

pub const ROW: Effect = Effect {
    name: "speed_fluctuation",
    title: "Speed fluctuation of the driver",
    part: Part::Input,
    on: On::Prescribed,
    equation: "v = v_0 (1 + a sin(n q + phase)) / sqrt(1 - a^2), v_0 the mean over time",
    source: "Engine orders; Cardan joint for n = 2",
    order: "n of its shaft",
    speed_law: "0 in ratio",
    channels: "all, with the model's gain",
    parameters: &[
        Parameter::new("amplitude_percent", 0.01, -90.0, 90.0, Kind::Amplitude).starts(Scale::One, &[0.01]),
        Parameter::new("phase_deg", DEG, -3600.0, 3600.0, Kind::Phase).default(0.0),
        Parameter::new("order", 1.0, 0.5, 200.0, Kind::Whole).default(1.0).starts(Scale::One, &[1.0, 2.0]),
    ],
    dissipative: false,
    physics: Physics::Motion(factor),
    links: Some(On::Prescribed),
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn factor(p: &[f64], angle: f64) -> f64 {
    (1.0 + p[0] * libm::sin(p[2] * angle + p[1])) / libm::sqrt(1.0 - p[0] * p[0]) - 1.0
}
