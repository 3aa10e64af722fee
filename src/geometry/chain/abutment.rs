//! Abutment chain: bush-chain links whose plates carry two abutments on the side of the sprockets, one near each joint.
//!
//! Rings that turn with the sprockets and fixed guides support the abutments (see [`crate::geometry::smartchain`]).
//! Every link carries a bush at its front joint, so that all links are equal; with `alternate` every other link carries
//! two bushes as in a bush chain. The pitch is nominal at the design tension: unloaded links are shorter by their
//! elongation.

use super::super::Vec2;
use super::super::profile::{Element, Profile, ProfileError};
use super::super::smartchain::{AbutmentContour, AbutmentSpec, Inclination, Transition, TransitionError, TwoLinks};
use super::LinkShape;
use std::f64::consts::PI;

/// Dimensions of an abutment chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AbutmentChain {
    /// Nominal pitch, that of links under the design tension [m].
    pub pitch_m: f64,
    pub bush_diameter_m: f64,
    pub pin_diameter_m: f64,
    pub plate_height_m: f64,
    pub mass_kg: f64,
    pub inertia_kg_m2: f64,
    /// a, from the joint to the end arc of its abutment [m].
    pub abutment_distance_m: f64,
    /// Teeth of the sprocket whose ring is a circle.
    pub teeth: u32,
    /// Kind of the transition onto that sprocket.
    pub handover: Handover,
    /// T*: tension at which the pitch is nominal [N].
    pub design_tension_n: f64,
    /// Bushes on every other link only.
    pub alternate: bool,
    /// Unloaded pitches that differ from the design: even and odd links [m].
    pub pitches_m: [Option<f64>; 2],
}

/// Path of a joint from the line to the circle, over one link or two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Handover {
    OneLink(Inclination),
    TwoLinks(TwoLinks),
}

impl Handover {
    /// The smoothest transition over the same number of links.
    pub fn smoothest(self) -> Handover {
        match self {
            Handover::OneLink(_) => Handover::OneLink(Inclination::SmoothAcceleration),
            Handover::TwoLinks(_) => Handover::TwoLinks(TwoLinks::default()),
        }
    }

    /// The transition onto a sprocket with this number of teeth.
    pub fn transition(self, teeth: u32, pitch_m: f64) -> Result<Transition, TransitionError> {
        match self {
            Handover::OneLink(inclination) => Transition::new(teeth, pitch_m, inclination),
            Handover::TwoLinks(form) => Transition::over_two_links(teeth, pitch_m, form),
        }
    }
}

impl AbutmentChain {
    /// Dimensions of its abutments.
    pub fn abutment_spec(&self) -> AbutmentSpec {
        AbutmentSpec { distance_m: self.abutment_distance_m, flat_m: None, end_angle_rad: None }
    }

    /// The transition onto a sprocket: the specified one for `self.teeth`, the smoothest for other numbers of teeth.
    pub fn transition(&self, teeth: u32) -> Result<Transition, TransitionError> {
        let handover = if teeth == self.teeth { self.handover } else { self.handover.smoothest() };
        handover.transition(teeth, self.pitch_m)
    }

    /// The two rows, equal unless alternating. `stiffness_n_per_m` is that of a joint.
    pub fn rows(
        &self,
        stiffness_n_per_m: f64,
        front: &AbutmentContour,
        rear: &AbutmentContour,
    ) -> Result<[LinkShape; 2], ProfileError> {
        let unloaded_m = self.pitch_m - self.design_tension_n / stiffness_n_per_m;
        let row = |index: usize| -> Result<LinkShape, ProfileError> {
            let bush = !self.alternate || index == 0;
            let circle_radius = 0.5 * if bush { self.bush_diameter_m } else { self.pin_diameter_m };
            let pitch_m = self.pitches_m[index].unwrap_or(unloaded_m);
            Ok(LinkShape {
                name: if index == 0 { "inner" } else { "outer" },
                pitch_m,
                plate: plate(self.pitch_m, 0.5 * self.plate_height_m, front, rear)?,
                plate_end_radius_m: 0.5 * self.plate_height_m,
                bush_radius_m: bush.then_some(0.5 * self.bush_diameter_m),
                roller: None,
                circles: [-0.5, 0.5].map(|x| (Vec2::new(x * pitch_m, 0.0), circle_radius)).to_vec(),
                mass_kg: self.mass_kg,
                inertia_kg_m2: self.inertia_kg_m2,
            })
        };
        Ok([row(0)?, row(1)?])
    }
}

/// Outline: exact abutments; the plate between and below them is only for drawing. Counterclockwise.
fn plate(
    pitch_m: f64,
    end_radius_m: f64,
    front: &AbutmentContour,
    rear: &AbutmentContour,
) -> Result<Profile, ProfileError> {
    let (h, r) = (0.5 * pitch_m, end_radius_m);
    let line = |start: Vec2, end: Vec2| Element::Line { start, end };
    let quarter = |x: f64, start_rad: f64| Element::Arc {
        centre: Vec2::new(x, 0.0),
        radius_m: r,
        start_rad,
        sweep_rad: 0.5 * PI,
    };
    let mut elements = front.profile()?.elements().to_vec();
    elements.push(line(front.end(), rear.start()));
    elements.extend_from_slice(rear.profile()?.elements());
    elements.push(line(rear.end(), Vec2::new(-h - r, 0.0)));
    elements.push(quarter(-h, PI));
    elements.push(line(Vec2::new(-h, -r), Vec2::new(h, -r)));
    elements.push(quarter(h, -0.5 * PI));
    elements.push(line(Vec2::new(h + r, 0.0), front.start()));
    Profile::new(elements, true)
}
