//! Marks of different strength: each pulse is delayed by its own time, the same at every speed.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "mark_strength",
    title: "Mark strength of the pickup",
    part: Part::Sensor,
    on: On::Pickup,
    equation: "pulse of mark m delayed by t_m, t_0 = 0",
    source: "Threshold on a pulse with a rise time of its own",
    order: "1, 2 ... of its shaft, fixed in angle",
    speed_law: "interval error constant in time: ratio grows with speed",
    channels: "this sensor only",
    parameters: &[Parameter::new("mark_#_us", 1e-6, -1e6, 1e6, Kind::PerMark)
        .default(0.0)
        .starts(Scale::SampleTime, &[0.001])],
    dissipative: false,
    physics: Physics::Marks(place),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("marks of the pickup"), look: Some(Look::Marks), ..Kin::NONE },
};

fn place(p: &[f64], mark: usize) -> (f64, f64) {
    (0.0, if mark == 0 { 0.0 } else { p.get(mark - 1).copied().unwrap_or(0.0) })
}
