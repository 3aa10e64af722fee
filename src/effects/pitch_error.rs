//! One link that is longer or shorter than the others; the span that contains it changes by the same length.

use super::{ChainAt, Effect, HighestOrder, Kin, Kind, Look, On, Parameter, Part, Physics, Scale};
use crate::units::UM;

pub const ROW: Effect = Effect {
    name: "pitch_error",
    title: "One elongated link",
    part: Part::Chain,
    on: On::Chain,
    equation: "stretch -= length while the link lies in the span, over one link at its ends",
    source: "Geometry of the loop",
    order: "z/N of the sprockets and its multiples",
    speed_law: "0 (quasi-static)",
    channels: "tension; speeds with the delay of the link's way",
    parameters: &[
        Parameter::new("link", 1.0, 0.0, 100000.0, Kind::Index).starts(Scale::One, &[0.0]),
        Parameter::new("length_um", UM, -500.0, 500.0, Kind::Amplitude).starts(Scale::Micrometre10, &[1.0]),
    ],
    dissipative: false,
    physics: Physics::ChainLength(length),
    links: Some(On::Chain),
    highest_order: HighestOrder::Teeth,
    kin: Kin { look: Some(Look::Chain), ..Kin::NONE },
};

fn length(p: &[f64], at: ChainAt) -> (f64, f64) {
    let place = |x: f64| x - libm::floor(x / at.links) * at.links;
    let here = place(p[0] - at.travel - at.from);
    let width = place(at.to - at.from);
    let (inside, slope) = smooth_box(here, width, at.links);
    (-p[1] * inside, p[1] * slope)
}

/// 1 from 0 to `width`, 0 outside, smoothed over one link at both ends; and its slope.
pub fn smooth_box(x: f64, width: f64, links: f64) -> (f64, f64) {
    let edge = |d: f64| match d {
        d if d <= -0.5 => (0.0, 0.0),
        d if d >= 0.5 => (1.0, 0.0),
        d => (0.5 + d * (1.5 - 2.0 * d * d), 1.5 - 6.0 * d * d),
    };
    // The start may lie across the seam of the loop.
    let from_start = if x > 0.5 * (links + width) { x - links } else { x };
    let ((a, da), (b, db)) = (edge(from_start), edge(from_start - width));
    (a - b, da - db)
}
