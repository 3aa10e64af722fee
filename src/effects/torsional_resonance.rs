//! A second inertia on a spring at a body, which the declared model lacks; sensors remain on the declared body.

use super::{Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale};

pub const ROW: Effect = Effect {
    name: "torsional_resonance",
    title: "Attached inertia",
    part: Part::Shaft,
    on: On::Body,
    equation: "J2 q2'' = -k (q2 - q) - c (q2' - q'), k = J2 w^2, c = 2 zeta J2 w",
    source: "Two-mass oscillator; Den Hartog, Mechanical Vibrations",
    order: "constant frequency, with an antiresonance",
    speed_law: "0",
    channels: "speeds; amplified where orders cross it",
    parameters: &[
        Parameter::new("inertia_kg_m2", 1.0, 0.0, 1e6, Kind::Amplitude)
            .sliding("mass_kg")
            .starts(Scale::Inertia, &[0.2]),
        Parameter::new("frequency_hz", 2.0 * std::f64::consts::PI, 1e-3, 1e6, Kind::Shape)
            .starts(Scale::Rate, &[0.03, 0.06, 0.1, 0.15, 0.22, 0.32, 0.46, 0.66, 0.9, 1.3]),
        Parameter::new("damping_ratio", 1.0, 1e-4, 10.0, Kind::Shape).starts(Scale::One, &[0.05]),
    ],
    dissipative: false,
    physics: Physics::SecondBody { sensors_move: false },
    links: None,
    highest_order: HighestOrder::None,
    kin: Kin { family: Some("second inertia"), ..Kin::NONE },
};
