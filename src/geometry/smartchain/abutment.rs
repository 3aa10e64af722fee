//! The contour of the abutments of a link.
//!
//! In the frame of the lever (the link whose front joint is in transition) the sprocket axis describes a curve O(tau),
//! and a ring of radius rho about it envelopes
//!
//! ```text
//! K(tau) = O(tau) + rho perp(u),   u = O' / |O'|,   radius of curvature  1/kappa - rho,   kappa = (O' x O'') / |O'|^3
//! ```
//! with rho = R - a, so that the contour ends in an arc of radius a about the front joint, on which the ring stays
//! while the link is seated. It begins parallel to the link at the depth of the guide's face, h - rho under the joints,
//! and is extended there by a flat. The path with continuous acceleration starts with kappa = 0, and its contour is
//! convex; a lower inclination starts concave, a higher one is undercut (kappa rho >= 1) from some inclination on, the
//! sooner the smaller a. The rear abutment is the mirror image x -> -x.
//!
//! Link frame as in [`super::path::LinkMotion`]: the sprocket lies at +y, the contour too, outward normals point to +y;
//! run with the material on its left it leads from the front end (large x) to the rear, first the flat, then K, then
//! the arc.
//!
//! Source: envelope of a circle; own derivation, see `path`.

use super::convex::ConvexContour;
use super::fit::{self, CurvePoint};
use super::path::{Inclination, Transition, boundary};
use crate::geometry::profile::Element;
use crate::geometry::{Vec2, cross, perp, unit};
use crate::units::{DEG, MM, atan2, sin_cos};
use std::f64::consts::PI;

/// What an abutment is made from, besides the transition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AbutmentSpec {
    /// a, from the joint to the end arc [m].
    pub distance_m: f64,
    /// Length of the flat ahead of the contour [m]; None takes [`FLAT_PITCHES`].
    pub flat_m: Option<f64>,
    /// Angle of the normal at the end of the end arc, to the normal of the link [rad]; None takes the seated link's
    /// angle to the ring with [`END_RESERVE_RAD`] to spare, or [`END_ANGLE_RAD`] if that is more.
    pub end_angle_rad: Option<f64>,
}

/// Length of the flat, in pitches: 0.6 mm at 8 mm. assumed: bridges a gap between the guide's end and the ring's top.
pub const FLAT_PITCHES: f64 = 0.075;

/// Least angle to which the end arc reaches. assumed: 4 degrees more than a seated link needs at 20 teeth.
pub const END_ANGLE_RAD: f64 = 13.0 * DEG;

/// Reserve beyond the angle pi/z at which the ring touches a seated link. assumed: as above.
pub const END_RESERVE_RAD: f64 = 4.0 * DEG;

/// Which of the two abutments of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    Front,
    Rear,
}

/// A point of the exact contour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContourPoint {
    pub point: Vec2,
    /// Outward.
    pub normal: Vec2,
    /// Signed radius of curvature, positive convex, infinite on the flat.
    pub radius_m: f64,
}

/// The abutments of a link, made for one sprocket.
#[derive(Clone, Debug, PartialEq)]
pub struct Abutment {
    pub transition: Transition,
    pub spec: AbutmentSpec,
    pub flat_m: f64,
    pub end_angle_rad: f64,
    /// rho = R - a.
    pub ring_radius_m: f64,
    /// h - rho: from the line of joints to the face of the guide, which is tangent to the ring at its top.
    pub guide_height_m: f64,
    /// Angle of the outward normal, to that of the link, where the lever phase ends: psi0 - phi.
    pub lever_end_rad: f64,
    /// Smallest radius of curvature.
    pub min_radius_m: f64,
    /// Largest distance of the exact contour from the arcs.
    pub max_deviation_m: f64,
    pub front: ConvexContour,
    pub rear: ConvexContour,
}

/// Why there is no such abutment, each with what works.
#[derive(Clone, Debug, PartialEq)]
pub enum AbutmentError {
    /// Distance a not positive, or not below the pitch radius [m].
    Distance {
        distance_m: f64,
        below_m: f64,
    },
    /// Flat or end angle not a number that makes sense; the end angle must be at least this [rad].
    Flat(f64),
    EndAngle {
        end_angle_rad: f64,
        least_rad: f64,
    },
    /// The contour starts concave.
    Concave {
        inclination_rad: f64,
        from_rad: f64,
        to_rad: f64,
    },
    /// The contour has a cusp.
    Undercut {
        inclination_rad: f64,
        from_rad: f64,
        to_rad: f64,
        least_distance_m: f64,
    },
    /// Front and rear abutment of one link run into each other.
    Collision {
        largest_distance_m: f64,
    },
    /// An arc came out concave by rounding.
    Degenerate,
}

impl std::fmt::Display for AbutmentError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            AbutmentError::Distance { distance_m, below_m } => write!(
                f,
                "an abutment {} mm from its joint leaves no ring; it must be more than 0 and less than {:.4} mm",
                distance_m / MM,
                below_m / MM
            ),
            AbutmentError::Flat(flat_m) => write!(f, "a flat of {} mm must be a positive number", flat_m / MM),
            AbutmentError::EndAngle { end_angle_rad, least_rad } => write!(
                f,
                "an end angle of {:.4} deg is before the end of the hand-over; {:.4} to 90 deg work",
                end_angle_rad / DEG,
                least_rad / DEG
            ),
            AbutmentError::Concave { inclination_rad, from_rad, to_rad } => write!(
                f,
                "at an inclination of {:.4} deg the abutment starts concave; {:.4} to {:.4} deg work",
                inclination_rad / DEG,
                from_rad / DEG,
                to_rad / DEG
            ),
            AbutmentError::Undercut { inclination_rad, from_rad, to_rad, least_distance_m } => write!(
                f,
                "at an inclination of {:.4} deg the ring undercuts the abutment (a cusp); {:.4} to {:.4} deg work, \
                 or an abutment more than {:.4} mm from its joint",
                inclination_rad / DEG,
                from_rad / DEG,
                to_rad / DEG,
                least_distance_m / MM
            ),
            AbutmentError::Collision { largest_distance_m } => write!(
                f,
                "front and rear abutment of a link run into each other; less than {:.4} mm from the joint works",
                largest_distance_m / MM
            ),
            AbutmentError::Degenerate => {
                write!(f, "at this pitch rounding hides the shape of the contour; 0.01 mm to 1000 mm work")
            }
        }
    }
}

impl std::error::Error for AbutmentError {}

/// Largest deviation of the arcs that is aimed at [m], and its share of the pitch for chains below 8 mm.
const TOLERANCE_M: f64 = 4.5e-9;
const TOLERANCE_PITCHES: f64 = TOLERANCE_M / 8e-3;

/// Least deviation worth aiming at, in pitches: rounding of points on a sprocket of 150 teeth, with room.
const ROUNDING_PITCHES: f64 = 1e-9;

/// Places where the exact contour is compared with the arcs.
const DEVIATION_SAMPLES: u32 = 2000;

/// Places where curvature is looked at.
const CURVATURE_SAMPLES: u32 = 200;

/// Curvature that still counts as none, times the pitch radius: rounding.
const CURVATURE_ROUNDING: f64 = 1e-6;

/// Tolerance of fitted arcs for a pitch [m].
pub(super) fn tolerance_m(pitch_m: f64) -> f64 {
    TOLERANCE_M.min(TOLERANCE_PITCHES * pitch_m).max(ROUNDING_PITCHES * pitch_m)
}

/// Smallest and largest curvature of the way of the axis in the lever's frame [1/m].
fn curvature_range(transition: &Transition) -> (f64, f64) {
    (0..=CURVATURE_SAMPLES)
        .map(|k| axis_curvature(transition, f64::from(k) / f64::from(CURVATURE_SAMPLES)))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(c), high.max(c)))
}

fn axis_curvature(transition: &Transition, tau: f64) -> f64 {
    let axis = transition.lever(tau).axis;
    cross(axis.velocity, axis.acceleration) / axis.velocity.norm().powi(3)
}

/// A point of the lever phase of the exact contour.
fn lever_point(transition: &Transition, ring_radius_m: f64, tau: f64) -> ContourPoint {
    let axis = transition.lever(tau).axis;
    let speed = axis.velocity.norm();
    let across = perp(axis.velocity / speed);
    ContourPoint {
        point: axis.position + across * ring_radius_m,
        normal: -across,
        radius_m: speed.powi(3) / cross(axis.velocity, axis.acceleration) - ring_radius_m,
    }
}

impl Abutment {
    /// Contour, arcs and limits.
    pub fn new(transition: Transition, spec: AbutmentSpec) -> Result<Abutment, AbutmentError> {
        let a = spec.distance_m;
        let (pitch, reach) = (transition.pitch_m, transition.pitch_radius_m);
        if !(a > 0.0 && a < reach) {
            return Err(AbutmentError::Distance { distance_m: a, below_m: reach });
        }
        let ring_radius_m = reach - a;
        check_curvature(&transition, ring_radius_m)?;
        let flat_m = spec.flat_m.unwrap_or(FLAT_PITCHES * pitch);
        if !(flat_m.is_finite() && flat_m > 0.0) {
            return Err(AbutmentError::Flat(flat_m));
        }
        let lever_end_rad = transition.handover_angle_rad - transition.inclination_rad;
        let seated_rad = PI / f64::from(transition.teeth);
        let end_angle_rad = spec.end_angle_rad.unwrap_or(END_ANGLE_RAD.max(seated_rad + END_RESERVE_RAD));
        if !(end_angle_rad > lever_end_rad && end_angle_rad <= 0.5 * PI) {
            return Err(AbutmentError::EndAngle { end_angle_rad, least_rad: lever_end_rad });
        }
        let largest = 0.5 * pitch / sin_cos(end_angle_rad).0;
        if a >= largest {
            return Err(AbutmentError::Collision { largest_distance_m: largest });
        }
        let curve = |tau: f64| {
            let p = lever_point(&transition, ring_radius_m, tau);
            CurvePoint { point: p.point, tangent: perp(p.normal) }
        };
        let fitted = fit::fit(&curve, 0.0, 1.0, tolerance_m(pitch));
        let max_deviation_m = fit::deviation_m(&curve, 0.0, 1.0, &fitted, DEVIATION_SAMPLES);
        let start = curve(0.0);
        let normal = lever_point(&transition, ring_radius_m, 1.0).normal;
        let mut elements = vec![Element::Line { start: start.point - start.tangent * flat_m, end: start.point }];
        elements.extend(fitted);
        elements.push(Element::Arc {
            centre: Vec2::new(0.5 * pitch, 0.0),
            radius_m: a,
            start_rad: atan2(normal.y, normal.x),
            sweep_rad: end_angle_rad - lever_end_rad,
        });
        let front = ConvexContour::new(&elements).map_err(|_concave| AbutmentError::Degenerate)?;
        let min_radius_m = (0..=CURVATURE_SAMPLES)
            .map(|k| f64::from(k) / f64::from(CURVATURE_SAMPLES))
            .map(|tau| lever_point(&transition, ring_radius_m, tau).radius_m.abs())
            .fold(a, f64::min);
        Ok(Abutment {
            transition,
            spec,
            flat_m,
            end_angle_rad,
            ring_radius_m,
            guide_height_m: transition.line_height_m - ring_radius_m,
            lever_end_rad,
            min_radius_m,
            max_deviation_m,
            rear: front.mirrored(),
            front,
        })
    }

    /// a, from the joint to the end arc [m].
    pub fn distance_m(&self) -> f64 {
        self.spec.distance_m
    }

    pub fn contour(&self, side: Side) -> &ConvexContour {
        match side {
            Side::Front => &self.front,
            Side::Rear => &self.rear,
        }
    }

    /// The exact front contour: `phase` in 0 ..= 1 is tau of the lever, below 0 the flat runs on with one pitch per
    /// unit, above 1 the end arc with one radian per unit.
    pub fn exact(&self, phase: f64) -> ContourPoint {
        let at = |tau: f64| lever_point(&self.transition, self.ring_radius_m, tau);
        if phase < 0.0 {
            let start = at(0.0);
            let point = start.point + perp(start.normal) * (phase * self.transition.pitch_m);
            ContourPoint { point, normal: start.normal, radius_m: f64::INFINITY }
        } else if phase <= 1.0 {
            at(phase)
        } else {
            let normal = unit(0.5 * PI + self.lever_end_rad + (phase - 1.0));
            let joint = Vec2::new(0.5 * self.transition.pitch_m, 0.0);
            ContourPoint { point: joint + normal * self.distance_m(), normal, radius_m: self.distance_m() }
        }
    }

    /// Gap between the ring and an abutment of the link whose front joint is at `tau` on its exact path [m].
    pub fn ring_gap_m(&self, side: Side, tau: f64) -> f64 {
        let axis = self.transition.link(tau).axis.position;
        self.contour(side).closest_to_point(axis).distance_m - self.ring_radius_m
    }

    /// Length along the chain over which abutments of neighbouring links overlap about their common joint [m]: they
    /// must lie in different planes, as inner and outer links do.
    pub fn neighbour_overlap_m(&self) -> f64 {
        2.0 * (self.front.start().x - 0.5 * self.transition.pitch_m)
    }

    /// Length along the link between its own two abutments [m].
    pub fn own_gap_m(&self) -> f64 {
        2.0 * self.front.end().x
    }

    /// Room between a bush about the joint and the abutments of its own and the neighbouring link, straight or bent
    /// [m].
    pub fn bush_clearance_m(&self, bush_radius_m: f64) -> f64 {
        self.min_joint_distance_m() - bush_radius_m
    }

    /// Smallest distance of the contour from the joint it belongs to.
    fn min_joint_distance_m(&self) -> f64 {
        // The contour lies outside the circle of radius a about its joint but for rounding of the arcs.
        let joint = Vec2::new(0.5 * self.transition.pitch_m, 0.0);
        self.front
            .arcs()
            .iter()
            .flat_map(|arc| [arc.start, arc.end])
            .map(|p| (p - joint).norm())
            .fold(self.distance_m(), f64::min)
    }
}

/// The contour is convex and has no cusp; otherwise what works.
fn check_curvature(transition: &Transition, ring_radius_m: f64) -> Result<(), AbutmentError> {
    let flat = -CURVATURE_ROUNDING / transition.pitch_radius_m;
    let works = |t: &Transition| {
        let (low, high) = curvature_range(t);
        low >= flat && high * ring_radius_m < 1.0
    };
    if works(transition) {
        return Ok(());
    }
    let (teeth, pitch_m, phi) = (transition.teeth, transition.pitch_m, transition.inclination_rad);
    let given = |phi: f64| Transition::new(teeth, pitch_m, Inclination::Given(phi));
    let from_rad = Transition::smooth(teeth, pitch_m).map_or(phi, |t| t.inclination_rad);
    let to_rad = boundary(from_rad, 0.5 * PI, |x| given(x).is_ok_and(|t| works(&t)));
    let (low, high) = curvature_range(transition);
    if low < flat {
        return Err(AbutmentError::Concave { inclination_rad: phi, from_rad, to_rad });
    }
    Err(AbutmentError::Undercut {
        inclination_rad: phi,
        from_rad,
        to_rad,
        least_distance_m: transition.pitch_radius_m - 1.0 / high,
    })
}
