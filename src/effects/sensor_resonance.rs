//! A sensor with a resonance: its own mass on its mounting.

use super::{Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale, Trace};

pub const ROW: Effect = Effect {
    name: "sensor_resonance",
    title: "Resonance of the sensor",
    part: Part::Sensor,
    on: On::Sensor,
    equation: "y_1'' + 2 zeta w y_1' + w^2 y_1 = w^2 y, zeta = 0.1",
    source: "Seismic pickup; Den Hartog, Mechanical Vibrations",
    order: "constant frequency, in one channel",
    speed_law: "none",
    channels: "this sensor only",
    parameters: &[Parameter::new("period_ms", 1e-3, 0.0, 1e6, Kind::Shape).starts(Scale::SampleTime, &[4.0, 15.0])],
    dissipative: false,
    physics: Physics::Signal(pass),
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { look: Some(Look::Lag), ..Kin::NONE },
};

fn pass(p: &[f64], trace: &mut Trace) {
    if p[0] <= 0.0 || trace.values.is_empty() {
        return;
    }
    let omega = 2.0 * std::f64::consts::PI / p[0];
    let zeta = 0.1;
    if omega * trace.step_s > 20.0 {
        // Far above the sampled range: the effect vanishes.
        return;
    }
    let parts = libm::ceil(trace.step_s * omega / 0.5).max(1.0);
    let h = trace.step_s / parts;
    let (mut y, mut rate) = (trace.values[0], 0.0);
    let mut before = trace.values[0];
    for value in trace.values.iter_mut() {
        let now = *value;
        for k in 0..parts as usize {
            let u = before + (now - before) * (k as f64 + 0.5) / parts;
            // Trapezoidal rule: second order, never unstable.
            let (a, b) = (0.25 * h * h * omega * omega, zeta * omega * h);
            let next = (rate * (1.0 - a - b) + h * omega * omega * (u - y)) / (1.0 + a + b);
            y += 0.5 * h * (rate + next);
            rate = next;
        }
        before = now;
        *value = y;
    }
}
