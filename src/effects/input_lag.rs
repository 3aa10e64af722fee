//! A drive that follows its signal with a first-order lag, such as a motor current or a valve.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "input_lag",
    title: "Lag of the drive",
    part: Part::Input,
    on: On::Input,
    equation: "T u_1' = u - u_1",
    source: "First-order lag; electrical time constant",
    order: "roll-off of the response",
    speed_law: "none",
    channels: "all, beyond 1/T",
    parameters: &[
        Parameter::new("time_ms", 1e-3, 0.0, 1e6, Kind::Amplitude).starts(Scale::SampleTime, &[1.0, 5.0]),
        super::low_pass::START,
    ],
    dissipative: false,
    physics: Physics::Input(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("lag of the drive"), look: Some(Look::Lag), ..Kin::NONE },
};

fn pass(p: &[f64], u: &mut [f64], step_s: f64, held: bool) {
    if held { means(u, p[0], step_s, p[1]) } else { super::low_pass::filtered(u, p[0], step_s, p[1]) }
}

/// Mean of the lagged input over every step, for an input that is constant during a step: a lag that is short against
/// the step acts only through its impulse. The lag starts at the first value plus `beyond`.
fn means(u: &mut [f64], time_s: f64, step_s: f64, beyond: f64) {
    if time_s <= 0.0 || u.is_empty() {
        return;
    }
    let x = step_s / time_s;
    let (decay, mean) = (libm::exp(-x), -libm::expm1(-x) / x);
    let mut y = u[0] + beyond;
    for value in u.iter_mut() {
        let now = *value;
        *value = now + (y - now) * mean;
        y = now + (y - now) * decay;
    }
}
