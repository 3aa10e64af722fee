//! One tooth gap that lies further out than the others of its sprocket, or is worn deeper.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};
use crate::units::UM;

pub const ROW: Effect = Effect {
    name: "gap_error",
    title: "One damaged tooth",
    part: Part::Sprocket,
    on: On::Sprocket,
    equation: "links: this gap, seat and flanks or the two faces of a silent sprocket, lies further out; lumped: stretch += e exp(-(theta_gap / (pi / z))^2)",
    source: "Form deviation of a single tooth gap, ISO 606",
    order: "all of its shaft, sidebands of z",
    speed_law: "0 (quasi-static)",
    channels: "tension, contact forces",
    parameters: &[
        Parameter::new("gap", 1.0, 0.0, 1000.0, Kind::Index).starts(Scale::One, &[0.0]),
        Parameter::new("outward_um", UM, -500.0, 500.0, Kind::Amplitude).starts(Scale::Micrometre10, &[1.0]),
    ],
    dissipative: false,
    physics: Physics::SpanLength(length),
    links: Some(On::Sprocket),
    highest_order: HighestOrder::Teeth,
    kin: Kin { look: Some(Look::OncePerTurn), ..Kin::NONE },
};

fn length(p: &[f64], teeth: u32, angle: f64) -> (f64, f64) {
    let gap = 2.0 * std::f64::consts::PI / f64::from(teeth);
    let away = crate::units::wrap_angle(angle - p[0] * gap) / (0.5 * gap);
    let size = p[1] * libm::exp(-away * away);
    (size, -2.0 * away / (0.5 * gap) * size)
}
