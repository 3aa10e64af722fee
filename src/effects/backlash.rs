//! Play: the span or coupling carries no force within a gap.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, SpanAt};
use crate::units::UM;

pub const ROW: Effect = Effect {
    name: "backlash",
    title: "Backlash",
    part: Part::Shaft,
    on: On::Span,
    equation: "force = k (stretch -+ gap/2) + c rate beyond the gap, 0 within",
    source: "Dead zone with the damper behind it (Nordin & Gutman 2002)",
    order: "2, 3 ... times what drives it, at reversals",
    speed_law: "0, with a threshold",
    channels: "speeds at torque reversal",
    parameters: &[Parameter::new("gap_um", UM, 0.0, 1e7, Kind::Amplitude).starts(Scale::Stretch, &[0.2, 1.0])],
    dissipative: false,
    physics: Physics::SpanForce(force),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin::NONE,
};

fn force(p: &[f64], at: SpanAt) -> f64 {
    let half = 0.5 * p[0];
    if at.stretch.abs() < half { -at.force } else { -at.stiffness * half.copysign(at.stretch) }
}
