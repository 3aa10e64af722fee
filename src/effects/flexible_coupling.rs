//! A body split in two: a part of its inertia, with the sensors, sits behind a spring.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "flexible_coupling",
    title: "Flexible coupling between drive and sensor",
    part: Part::Shaft,
    on: On::Body,
    equation: "far part f J behind k, c: (1-f) J q'' = M + k (q2 - q) + c (q2' - q'), f J q2'' = -k (q2 - q) - c (q2' - q'), k = f J w^2, c = 2 zeta f J w",
    source: "Two-mass oscillator, not collocated; Den Hartog, Mechanical Vibrations",
    order: "constant frequency, phase falls by 180 degrees beyond it",
    speed_law: "0",
    channels: "speeds of this body",
    parameters: &[
        Parameter::new("far_inertia_kg_m2", 1.0, 0.0, 1e6, Kind::Amplitude)
            .sliding("far_mass_kg")
            .starts(Scale::Inertia, &[0.5]),
        Parameter::new("frequency_hz", 2.0 * std::f64::consts::PI, 1e-3, 1e6, Kind::Shape)
            .starts(Scale::Rate, &[0.06, 0.12, 0.22, 0.4, 0.7, 1.2]),
        Parameter::new("damping_ratio", 1.0, 1e-4, 10.0, Kind::Shape).starts(Scale::One, &[0.05]),
    ],
    dissipative: false,
    physics: Physics::SecondBody { sensors_move: true },
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("second inertia"), ..Kin::NONE },
};
