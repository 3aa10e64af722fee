//! The contour of the abutments of a link.
//!
//! In the frame of the lever (the link whose front joint is in transition) the sprocket axis describes a curve O(tau),
//! and a ring of radius rho about it has the envelope
//!
//! ```text
//! K(tau) = O(tau) + rho perp(u),   u = O' / |O'|,   radius of curvature  1/kappa - rho,   kappa = (O' x O'') / |O'|^3
//! ```
//! with rho = R - a, so that the contour ends in an arc of radius a about the front joint, which rests on the ring
//! while the link is seated. The contour begins parallel to the link at the depth h - rho under the joints, and is
//! extended there by a flat. The path with continuous acceleration starts with kappa = 0, and its contour is convex. A
//! lower inclination starts with a hollow. A higher inclination is undercut (kappa rho >= 1) above a limit that is
//! lower for smaller a. Behind a hollow the contour rises over the flat. It rests on the guide with this part, and the
//! guide's face is lower than the ring's top by this rise. The joint then first rises over the line, and the link,
//! which turns about its rear joint, presses its rear abutment into the guide: 2 um at 3 deg and 20 teeth. The rear
//! abutment is the mirror image x -> -x.
//!
//! Link frame as in [`super::path::LinkMotion`]: the sprocket lies at +y, and the outward normals of the contour point
//! to +y. Traversed with the material on its left, the contour leads from the front end (large x) to the rear: first
//! the flat, then K, then the arc.
//!
//! Source: envelope of a circle; own derivation, see `path`.

use super::contour::AbutmentContour;
use super::fit::{self, CurvePoint};
use super::path::{Inclination, Transition, boundary};
use crate::geometry::profile::Element;
use crate::geometry::{Vec2, cross, perp, rotated, unit};
use crate::units::{DEG, MM, atan2, sin_cos};
use std::f64::consts::PI;

/// Dimensions of an abutment besides the transition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AbutmentSpec {
    /// a, from the joint to the end arc [m].
    pub distance_m: f64,
    /// Length of the flat ahead of the contour [m]; None takes [`FLAT_PITCHES`].
    pub flat_m: Option<f64>,
    /// Angle of the normal at the end of the end arc, to the normal of the link [rad]; None takes the seated link's
    /// angle to the ring plus [`END_RESERVE_RAD`], but at least [`END_ANGLE_RAD`].
    pub end_angle_rad: Option<f64>,
}

/// Length of the flat, in pitches: 0.6 mm at 8 mm. assumed: bridges a gap between the guide's end and the ring's top.
pub const FLAT_PITCHES: f64 = 0.075;

/// Minimum angle at the end of the end arc. assumed: 4 degrees more than a seated link needs at 20 teeth.
pub const END_ANGLE_RAD: f64 = 13.0 * DEG;

/// Reserve beyond the angle pi/z at which the ring contacts a seated link. assumed: as above.
pub const END_RESERVE_RAD: f64 = 4.0 * DEG;

/// One of the two abutments of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AbutmentSide {
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

/// The abutments of a link, designed for one sprocket.
#[derive(Clone, Debug, PartialEq)]
pub struct Abutment {
    pub transition: Transition,
    pub spec: AbutmentSpec,
    pub flat_m: f64,
    pub end_angle_rad: f64,
    /// rho = R - a.
    pub ring_radius_m: f64,
    /// From the line of joints to the face of the guide: h - rho plus the rise. Without a rise the face is tangent to
    /// the ring at its top.
    pub guide_height_m: f64,
    /// Rise of the contour over its flat if it starts with a hollow; otherwise zero.
    pub rise_m: f64,
    /// Depth by which such a link, whose front joint rises over the line, presses its rear abutment into the guide.
    pub guide_overlap_m: f64,
    /// Angle of the outward normal to that of the link at the end of the lever phase: psi0 - phi.
    pub lever_end_rad: f64,
    /// Smallest radius of curvature.
    pub min_radius_m: f64,
    /// Largest distance of the exact contour from the arcs.
    pub max_deviation_m: f64,
    pub front: AbutmentContour,
    pub rear: AbutmentContour,
}

/// Why there is no such abutment, each with a value that works.
#[derive(Clone, Debug, PartialEq)]
pub enum AbutmentError {
    /// Distance a not positive, or not below the pitch radius [m].
    Distance {
        distance_m: f64,
        below_m: f64,
    },
    /// Invalid flat or end angle; the end angle must be at least this [rad].
    Flat(f64),
    EndAngle {
        end_angle_rad: f64,
        least_rad: f64,
    },
    /// The contour of a transition over one link has a cusp.
    Undercut {
        inclination_rad: f64,
        to_rad: f64,
        least_distance_m: f64,
    },
    /// The contour of a transition over two links has a cusp or a hollow.
    TwoLinks {
        /// Smallest and largest curvature of the path of the ring's axis, over that of the pitch circle; 0 to R / rho
        /// work.
        curvature: (f64, f64),
        most: f64,
        /// Line above the pitch circle [m], hand-over angle [rad] and end of the line [m] that work.
        works: Option<[f64; 3]>,
    },
    /// Front and rear abutment of one link overlap.
    Collision {
        largest_distance_m: f64,
    },
    /// An arc became concave by rounding.
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
            AbutmentError::TwoLinks { curvature: (low, high), most, works } => {
                write!(
                    f,
                    "the way of the ring has curvatures of {low:.2e} to {high:.2e} times that of the pitch circle: an abutment \
                     is hollow below 0 and pointed from {most:.3} on"
                )?;
                works.map_or(Ok(()), |works| write!(f, "; {} work", super::path::parameters_text(works)))
            }
            AbutmentError::Undercut { inclination_rad, to_rad, least_distance_m } => write!(
                f,
                "at an inclination of {:.4} deg the ring undercuts the abutment (a cusp); up to {:.4} deg work, or an \
                 abutment more than {:.4} mm from its joint",
                inclination_rad / DEG,
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

/// Desired maximum deviation of the arcs [m], and its ratio to the pitch for chains below 8 mm.
const TOLERANCE_M: f64 = 4.5e-9;
const TOLERANCE_PITCHES: f64 = TOLERANCE_M / 8e-3;

/// Smallest useful tolerance, in pitches: rounding of points on a sprocket of 150 teeth, with a margin.
const ROUNDING_PITCHES: f64 = 1e-9;

/// Points at which the exact contour is compared with the arcs.
const DEVIATION_SAMPLES: u32 = 2000;

/// Points per link at which the curvature is evaluated.
const CURVATURE_SAMPLES: u32 = 200;

/// Curvature that still counts as zero, times the pitch radius: rounding.
const CURVATURE_ROUNDING: f64 = 1e-6;

/// Tolerance of fitted arcs for a pitch [m].
pub(super) fn tolerance_m(pitch_m: f64) -> f64 {
    TOLERANCE_M.min(TOLERANCE_PITCHES * pitch_m).max(ROUNDING_PITCHES * pitch_m)
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
    /// Computes contour, arcs and limits.
    pub fn new(transition: Transition, spec: AbutmentSpec) -> Result<Abutment, AbutmentError> {
        let a = spec.distance_m;
        let (pitch, reach) = (transition.pitch_m, transition.pitch_radius_m);
        if !(a > 0.0 && a < reach) {
            return Err(AbutmentError::Distance { distance_m: a, below_m: reach });
        }
        let ring_radius_m = reach - a;
        let curvature = transition.curvature_range(CURVATURE_SAMPLES);
        check_curvature(&transition, curvature, ring_radius_m)?;
        let span = transition.span();
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
        let fitted = fit::fit(&curve, 0.0, span, tolerance_m(pitch));
        let max_deviation_m = fit::deviation_m(&curve, 0.0, span, &fitted, DEVIATION_SAMPLES);
        let start = curve(0.0);
        let normal = lever_point(&transition, ring_radius_m, span).normal;
        let mut elements = vec![Element::Line { start: start.point - start.tangent * flat_m, end: start.point }];
        elements.extend(fitted);
        elements.push(Element::Arc {
            centre: Vec2::new(0.5 * pitch, 0.0),
            radius_m: a,
            start_rad: atan2(normal.y, normal.x),
            sweep_rad: end_angle_rad - lever_end_rad,
        });
        let front = AbutmentContour::new(&elements).map_err(|_error| AbutmentError::Degenerate)?;
        let rear = front.mirrored();
        let mut guide_height_m = transition.line_height_m - ring_radius_m;
        let (mut rise_m, mut guide_overlap_m) = (0.0, 0.0);
        if curvature.0 * reach < -CURVATURE_ROUNDING {
            // Over the flat, whose normal is +y.
            rise_m = (front.support(Vec2::new(0.0, 1.0)).0 - front.start().y).max(0.0);
            guide_height_m += rise_m;
            guide_overlap_m = overlap_with_guide_m(&transition, &rear, guide_height_m);
        }
        let min_radius_m = (0..=CURVATURE_SAMPLES)
            .map(|k| span * f64::from(k) / f64::from(CURVATURE_SAMPLES))
            .map(|tau| lever_point(&transition, ring_radius_m, tau).radius_m.abs())
            .fold(a, f64::min);
        Ok(Abutment {
            transition,
            spec,
            flat_m,
            end_angle_rad,
            ring_radius_m,
            guide_height_m,
            rise_m,
            guide_overlap_m,
            lever_end_rad,
            min_radius_m,
            max_deviation_m,
            rear,
            front,
        })
    }

    /// a, from the joint to the end arc [m].
    pub fn distance_m(&self) -> f64 {
        self.spec.distance_m
    }

    pub fn contour(&self, side: AbutmentSide) -> &AbutmentContour {
        match side {
            AbutmentSide::Front => &self.front,
            AbutmentSide::Rear => &self.rear,
        }
    }

    /// The exact front contour: `phase` in 0 ..= n is tau of the lever; below 0 the flat continues with one pitch per
    /// unit, above n the end arc with one radian per unit.
    pub fn exact(&self, phase: f64) -> ContourPoint {
        let at = |tau: f64| lever_point(&self.transition, self.ring_radius_m, tau);
        if phase < 0.0 {
            let start = at(0.0);
            let point = start.point + perp(start.normal) * (phase * self.transition.pitch_m);
            ContourPoint { point, normal: start.normal, radius_m: f64::INFINITY }
        } else if phase <= self.transition.span() {
            at(phase)
        } else {
            let normal = unit(0.5 * PI + self.lever_end_rad + (phase - self.transition.span()));
            let joint = Vec2::new(0.5 * self.transition.pitch_m, 0.0);
            ContourPoint { point: joint + normal * self.distance_m(), normal, radius_m: self.distance_m() }
        }
    }

    /// Length along the chain over which abutments of neighbouring links overlap about their common joint [m]: they
    /// must lie in different planes, like inner and outer links.
    pub fn neighbour_overlap_m(&self) -> f64 {
        2.0 * (self.front.start().x - 0.5 * self.transition.pitch_m)
    }

    /// Number of planes across the width that the abutments need, so that those of consecutive links do not collide.
    pub fn planes(&self) -> u32 {
        // Link k behind the one at 0: its front abutment ends `reach` beyond its front joint, and so does the rear one.
        let reach = self.front.start().x - 0.5 * self.transition.pitch_m;
        libm::ceil(1.0 + 2.0 * reach / self.transition.pitch_m) as u32
    }

    /// Length along the link between its own two abutments [m].
    pub fn own_gap_m(&self) -> f64 {
        2.0 * self.front.end().x
    }
}

/// Checks that the contour has no cusp, and over two links no hollow; the error names values that work. `curvature` is
/// the transition's range.
fn check_curvature(transition: &Transition, curvature: (f64, f64), ring_radius_m: f64) -> Result<(), AbutmentError> {
    let (teeth, pitch_m, reach) = (transition.teeth, transition.pitch_m, transition.pitch_radius_m);
    let (low, high) = curvature;
    let (hollow, pointed) = (low * reach < -CURVATURE_ROUNDING, high * ring_radius_m >= 1.0);
    if transition.turning.is_some() && (hollow || pointed) {
        return Err(AbutmentError::TwoLinks {
            curvature: (low * reach, high * reach),
            most: reach / ring_radius_m,
            works: super::two_link::smoothest(teeth, pitch_m),
        });
    }
    if !pointed {
        return Ok(());
    }
    let works = |phi: f64| {
        Transition::new(teeth, pitch_m, Inclination::Given(phi))
            .is_ok_and(|t| t.curvature_range(CURVATURE_SAMPLES).1 * ring_radius_m < 1.0)
    };
    let smooth_rad = Transition::smooth(teeth, pitch_m).map_or(transition.inclination_rad, |t| t.inclination_rad);
    Err(AbutmentError::Undercut {
        inclination_rad: transition.inclination_rad,
        to_rad: boundary(smooth_rad, 0.5 * PI, works),
        least_distance_m: reach - 1.0 / high,
    })
}

/// Depth by which the rear abutment enters the guide while the front joint rises.
fn overlap_with_guide_m(transition: &Transition, rear: &AbutmentContour, guide_height_m: f64) -> f64 {
    let face_m = transition.line_height_m - guide_height_m;
    (0..=CURVATURE_SAMPLES)
        .map(|k| transition.lever(f64::from(k) / f64::from(CURVATURE_SAMPLES)))
        .map(|link| {
            let across = rotated(Vec2::new(0.0, 1.0), -link.turn_rad);
            rear.support(across).0 + face_m - link.axis.position.dot(&across)
        })
        .fold(0.0, f64::max)
}
