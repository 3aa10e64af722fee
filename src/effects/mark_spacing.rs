//! Unevenly spaced marks of a pulse pickup: every interval has a relative error that is the same at every speed.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "mark_spacing",
    title: "Mark spacing of the pickup",
    part: Part::Sensor,
    on: On::Pickup,
    equation: "mark m at 2 pi (m + s_m) / n, s_0 = 0",
    source: "Resor, Trethewey and Maynard 2005; Leclere and Hamzaoui 2014 on encoder geometry",
    order: "1, 2 ... of its shaft, fixed in angle",
    speed_law: "interval ratio constant over speed",
    channels: "this sensor only",
    parameters: &[Parameter::new("mark_#_percent", 0.01, -90.0, 90.0, Kind::PerMark)
        .default(0.0)
        .starts(Scale::One, &[0.001])],
    dissipative: false,
    physics: Physics::Marks(place),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("marks of the pickup"), look: Some(Look::Marks), ..Kin::NONE },
};

fn place(p: &[f64], mark: usize) -> (f64, f64) {
    (if mark == 0 { 0.0 } else { p.get(mark - 1).copied().unwrap_or(0.0) }, 0.0)
}
