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

fn pass(p: &[f64], u: &mut [f64], step_s: f64, held: bool) {
    let steps = p[0] / step_s;
    super::latency::shifted(u, steps, 0.0);
    // Before the record begins, the input is its first value plus the start parameter: in part of the step in which the first value arrives.
    let late = u.len().min(libm::ceil(steps) as usize);
    for (i, u) in u[..late].iter_mut().enumerate() {
        *u += p[1] * if held { (steps - i as f64).min(1.0) } else { 1.0 };
    }
}

#[cfg(test)]
mod tests {
    /// Stairs that come 2.25 steps late, from 5 before the record: their mean over each step.
    #[test]
    fn stairs_that_come_late_keep_their_means() {
        let mut u = [1.0, 3.0, 4.0, 2.0, 6.0];
        super::pass(&[0.225, 4.0], &mut u, 0.1, true);
        let expected = [5.0, 5.0, 0.25 * 5.0 + 0.75 * 1.0, 0.25 * 1.0 + 0.75 * 3.0, 0.25 * 3.0 + 0.75 * 4.0];
        assert!(u.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{u:?}");
    }
}
