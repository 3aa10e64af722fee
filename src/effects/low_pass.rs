//! A sensor that follows with a first-order lag, such as an analogue filter.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, Trace};

pub const ROW: Effect = Effect {
    name: "low_pass",
    title: "Low-pass filter of the sensor",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "T y_1' = y - y_1",
    source: "First-order lag",
    order: "roll-off and phase by frequency, the same for all orders",
    speed_law: "none",
    channels: "this sensor only",
    parameters: &[
        Parameter::new("time_ms", 1e-3, 0.0, 1e6, Kind::Amplitude).starts(Scale::SampleTime, &[1.0, 5.0]),
        START,
    ],
    dissipative: false,
    physics: Physics::Signal(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("lag of the sensor"), look: Some(Look::Lag), ..Kin::NONE },
};

/// Initial output of a lag minus its input, SI.
pub const START: Parameter = Parameter::new("start", 1.0, -1e12, 1e12, Kind::Start).default(0.0);

fn pass(p: &[f64], trace: &mut Trace) {
    let slope = super::latency::past_slope(trace, p[0] / trace.step_s) / trace.step_s;
    filtered(trace.values, p[0], trace.step_s, p[1] - p[0] * slope);
}

/// First-order lag T y' + y = u, exact for u linear between its values. Initially y is u plus `beyond`.
pub fn filtered(series: &mut [f64], time_s: f64, step_s: f64, beyond: f64) {
    if time_s <= 0.0 || series.is_empty() {
        return;
    }
    let x = step_s / time_s;
    let decay = libm::exp(-x);
    let mean = -libm::expm1(-x) / x;
    let (mut before, mut y) = (series[0], series[0] + beyond);
    series[0] = y;
    for value in &mut series[1..] {
        let now = *value;
        // y(h) of T y' + y = u with u from `before` to `now`.
        y = decay * y + (mean - decay) * before + (1.0 - mean) * now;
        before = now;
        *value = y;
    }
}
