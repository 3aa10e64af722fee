//! Fixed straight guides along a span.
//!
//! Guide frame: origin at the start of the face, +y out of the face towards the chain, the face along +x. Both ends are
//! relieved by an arc (C1), so that a link runs on and off without an edge. On the inner side of a counterclockwise
//! loop +x points against the travel of the chain, on the outer side along it.

use super::profile::{Element, Profile, ProfileError};
use super::route::Span;
use super::{Vec2, perp};
use crate::units::{atan2, sin_cos};
use std::f64::consts::PI;

/// Side of the chain on which a guide lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum GuideSide {
    /// Left of the travelling chain: inside the loop.
    Inside,
    /// Right of it.
    Outside,
}

/// A straight guide at its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StraightGuide {
    /// Start of the face.
    pub origin: Vec2,
    /// Unit vector along the face; +90 degrees from it is the normal towards the chain.
    pub along: Vec2,
    pub length_m: f64,
    /// Radius of the relief arcs at both ends [m].
    pub end_radius_m: f64,
    /// +1: the chain travels along +x of the guide frame; -1: against it.
    pub travel: f64,
}

impl StraightGuide {
    /// Guide along `span` from `start_m` to `end_m` after its beginning. `standoff_m` is the distance of the face from
    /// the line through the joints, on the guide's side.
    pub fn along_span(
        span: &Span,
        side: GuideSide,
        start_m: f64,
        end_m: f64,
        standoff_m: f64,
        end_radius_m: f64,
    ) -> StraightGuide {
        let left = perp(span.direction);
        let (towards_guide, along, first, travel) = match side {
            GuideSide::Inside => (left, -span.direction, end_m, -1.0),
            GuideSide::Outside => (-left, span.direction, start_m, 1.0),
        };
        StraightGuide {
            origin: span.start + span.direction * first + towards_guide * standoff_m,
            along,
            length_m: end_m - start_m,
            end_radius_m,
            travel,
        }
    }

    /// Unit normal out of the face.
    pub fn normal(&self) -> Vec2 {
        perp(self.along)
    }

    /// The guide with its end in the direction of travel moved towards the chain by `lift_m`.
    pub fn lifted(mut self, lift_m: f64) -> StraightGuide {
        let lift = self.normal() * lift_m;
        let far = self.origin + self.along * self.length_m;
        let (start, end) = if self.travel > 0.0 { (self.origin, far + lift) } else { (self.origin + lift, far) };
        (self.origin, self.length_m) = (start, (end - start).norm());
        self.along = (end - start) / self.length_m;
        self
    }

    /// Extension of the relief arcs beyond the face, along it [m].
    pub fn relief_m(&self) -> f64 {
        self.end_radius_m * sin_cos(END_SWEEP_RAD).0
    }

    /// Angle of the guide frame [rad].
    pub fn angle_rad(&self) -> f64 {
        atan2(self.along.y, self.along.x)
    }

    /// Contour in the guide frame, from x = length to x = 0 (material on the left, below the face): relief arc, face,
    /// relief arc.
    pub fn profile(&self) -> Result<Profile, ProfileError> {
        let r = self.end_radius_m;
        let (l, below) = (self.length_m, -r);
        Profile::new(
            vec![
                Element::Arc {
                    centre: Vec2::new(l, below),
                    radius_m: r,
                    start_rad: 0.5 * PI - END_SWEEP_RAD,
                    sweep_rad: END_SWEEP_RAD,
                },
                Element::Line { start: Vec2::new(l, 0.0), end: Vec2::zeros() },
                Element::Arc {
                    centre: Vec2::new(0.0, below),
                    radius_m: r,
                    start_rad: 0.5 * PI,
                    sweep_rad: END_SWEEP_RAD,
                },
            ],
            false,
        )
    }
}

/// Angle over which the ends are rounded [rad]. assumed: far beyond any inclination of a running link.
pub const END_SWEEP_RAD: f64 = 0.5;
