//! A sensor with a pure delay.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, Trace};

pub const ROW: Effect = Effect {
    name: "latency",
    title: "Latency of the sensor",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "y(t) -> y(t - T)",
    source: "Transport and computing time",
    order: "phase in proportion to frequency",
    speed_law: "none",
    channels: "this sensor only",
    parameters: &[
        Parameter::new("delay_ms", 1e-3, 0.0, 1e5, Kind::Amplitude).starts(Scale::SampleTime, &[0.5]),
        super::low_pass::START,
    ],
    dissipative: false,
    physics: Physics::Signal(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("lag of the sensor"), look: Some(Look::Lag), ..Kin::NONE },
};

fn pass(p: &[f64], trace: &mut Trace) {
    let steps = p[0] / trace.step_s;
    // The initial output differs by the start parameter from the extrapolation by slope.
    let slope = past_slope(trace, steps) - if steps > 0.0 { p[1] / steps } else { 0.0 };
    shifted(trace.values, steps, slope);
}

/// Change of a series per step in the `steps` before its start, assumed equal to its mean change in as many steps after
/// it. A speed that starts at zero is assumed to have been zero before.
pub fn past_slope(trace: &Trace, steps: f64) -> f64 {
    let series = &trace.values;
    let n = (libm::ceil(steps).max(1.0) as usize).min(series.len().saturating_sub(1));
    if n == 0 || trace.derivative > 0 && series[0] == 0.0 { 0.0 } else { (series[n] - series[0]) / n as f64 }
}

/// Delays a series by `steps` (not an integer): linear between its values; before its start it changes by `slope` a
/// step.
pub fn shifted(series: &mut [f64], steps: f64, slope: f64) {
    if steps == 0.0 {
        return;
    }
    for i in (0..series.len()).rev() {
        let at = i as f64 - steps;
        let low = libm::floor(at);
        let value = |k: f64| if k < 0.0 { series[0] + slope * k } else { series[(k as usize).min(series.len() - 1)] };
        let (a, b) = (value(low), value(low + 1.0));
        series[i] = a + (b - a) * (at - low);
    }
}
