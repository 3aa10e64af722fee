//! A drive that responds with a pure delay.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "input_delay",
    title: "Delay of the drive",
    part: Part::Input,
    on: On::Input,
    equation: "u(t) -> u(t - T)",
    source: "Sampled control, transport",
    order: "phase in proportion to frequency",
    speed_law: "none",
    channels: "all, in phase",
    parameters: &[
        Parameter::new("delay_ms", 1e-3, 0.0, 1e5, Kind::Amplitude).starts(Scale::SampleTime, &[0.5]),
        super::low_pass::START,
    ],
    dissipative: false,
    physics: Physics::Input(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("lag of the drive"), look: Some(Look::Lag), ..Kin::NONE },
};

fn pass(p: &[f64], u: &mut [f64], step_s: f64, _held: bool) {
    let steps = p[0] / step_s;
    super::latency::shifted(u, steps, 0.0);
    // Before the record begins, the input is its first value plus the start parameter.
    let late = u.len().min(libm::ceil(steps) as usize);
    u[..late].iter_mut().for_each(|u| *u += p[1]);
}
