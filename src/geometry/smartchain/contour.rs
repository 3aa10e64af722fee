//! Contours of abutments as arcs: convex, except for a hollow near one end that some of them have.
//!
//! The contour is open and runs with the material on its left. Along it (O - P).t decreases at the rate 1 + d / r, at
//! the distance d of O and the signed radius of curvature r (negative in a hollow). As long as O is nearer than the
//! radius of the hollow, the foot of its perpendicular is unique. The sign of (O - P_j).t_j at a junction P_j with
//! tangent t_j tells on which side of the junction the foot lies, and it changes once along the contour. A binary
//! search over the junctions finds the arc, and the foot on an arc is exact. Planes rest on the convex hull, whose
//! normals turn monotonically. No trigonometric function is called; the cost is a few dozen multiplications and one
//! square root.

use crate::geometry::profile::{Element, Profile, ProfileError};
use crate::geometry::{Vec2, cross, perp};
use crate::units::{atan2, wrap_angle};
use std::f64::consts::PI;

/// An arc, or a flat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContourArc {
    /// For a flat, a point on it.
    pub centre: Vec2,
    /// Infinite for a flat, negative in a hollow.
    pub radius_m: f64,
    pub start: Vec2,
    pub end: Vec2,
    /// Outward unit normals (cos, sin of the angles below) at both ends.
    pub normal_start: Vec2,
    pub normal_end: Vec2,
    /// Angle of the outward normal from +x [rad], increasing along the contour except in a hollow.
    pub normal_start_rad: f64,
    pub normal_end_rad: f64,
}

/// The contour of an abutment in the link frame.
#[derive(Clone, Debug, PartialEq)]
pub struct AbutmentContour {
    arcs: Vec<ContourArc>,
    /// The convex hull; the contour itself if it is convex.
    hull: Vec<ContourArc>,
    /// The search reads three tables of the hull. `ends` holds (x, y) of the normals at the ends of its arcs; `table` holds the
    /// first arc that may face a direction, for equal steps of the direction's x, which start at `table_from`. Normals point to +y, so that their x decreases along the contour.
    ends: Vec<(f64, f64)>,
    table: Vec<u16>,
    table_from: f64,
    table_steps_per_x: f64,
}

/// Steps of the search table.
const TABLE_STEPS: usize = 256;

/// The point of a contour nearest to a point outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContourFoot {
    /// Index of the arc.
    pub arc: usize,
    pub point: Vec2,
    /// Unit vector out of the contour at the foot; at the ends of the contour, towards the query point.
    pub normal: Vec2,
    /// Signed distance along the normal [m], negative in the material.
    pub distance_m: f64,
    /// Infinite on a flat, negative in a hollow, zero at the contour's ends.
    pub radius_m: f64,
}

/// Why elements are no contour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContourError {
    /// Hollow at both ends, not convex after a hollow, or projecting beyond the plane that spans the hollow; the index
    /// of an element.
    Concave(usize),
}

impl ContourArc {
    fn new(element: &Element) -> ContourArc {
        let (normal_start, normal_end) = (element.normal(0.0), element.normal(1.0));
        let (centre, radius_m) = match *element {
            Element::Line { start, .. } => (start, f64::INFINITY),
            Element::Arc { centre, radius_m, sweep_rad, .. } => (centre, radius_m * sweep_rad.signum()),
        };
        ContourArc {
            centre,
            radius_m,
            start: element.start(),
            end: element.end(),
            normal_start,
            normal_end,
            normal_start_rad: normal_angle(normal_start),
            normal_end_rad: normal_angle(normal_end),
        }
    }

    /// Foot of the perpendicular from `o`, which faces this arc.
    fn foot(&self, arc: usize, o: Vec2) -> ContourFoot {
        if self.radius_m.is_infinite() {
            let distance_m = (o - self.centre).dot(&self.normal_start);
            let normal = self.normal_start;
            return ContourFoot { arc, point: o - normal * distance_m, normal, distance_m, radius_m: self.radius_m };
        }
        let from_centre = o - self.centre;
        // In a hollow the centre lies outside, and o between it and the contour.
        let length = if self.radius_m < 0.0 { -from_centre.norm() } else { from_centre.norm() };
        let normal = from_centre / length;
        ContourFoot {
            arc,
            point: self.centre + normal * self.radius_m,
            normal,
            distance_m: length - self.radius_m,
            radius_m: self.radius_m,
        }
    }

    /// The part that begins where the normal is `from`.
    fn after(&self, from: Vec2) -> ContourArc {
        ContourArc {
            start: self.centre + from * self.radius_m,
            normal_start: from,
            normal_start_rad: normal_angle(from),
            ..*self
        }
    }

    fn mirrored(&self) -> ContourArc {
        let mirror = |v: Vec2| Vec2::new(-v.x, v.y);
        ContourArc {
            centre: mirror(self.centre),
            radius_m: self.radius_m,
            start: mirror(self.end),
            end: mirror(self.start),
            normal_start: mirror(self.normal_end),
            normal_end: mirror(self.normal_start),
            normal_start_rad: PI - self.normal_end_rad,
            normal_end_rad: PI - self.normal_start_rad,
        }
    }

    fn element(&self) -> Element {
        if self.radius_m.is_infinite() {
            return Element::Line { start: self.start, end: self.end };
        }
        // From the centre of a hollow the contour lies opposite to its normal.
        let turned = if self.radius_m < 0.0 { PI } else { 0.0 };
        Element::Arc {
            centre: self.centre,
            radius_m: self.radius_m.abs(),
            start_rad: self.normal_start_rad + turned,
            sweep_rad: self.normal_end_rad - self.normal_start_rad,
        }
    }
}

/// Angle of a normal. Contours face +y: measured from there no angle wraps.
fn normal_angle(n: Vec2) -> f64 {
    0.5 * PI + wrap_angle(atan2(n.y, n.x) - 0.5 * PI)
}

impl AbutmentContour {
    /// A contour of elements with common tangents that are convex, except for a hollow after the first of them.
    pub fn new(elements: &[Element]) -> Result<AbutmentContour, ContourError> {
        assert!(!elements.is_empty(), "a contour has elements");
        let arcs: Vec<ContourArc> = elements.iter().map(ContourArc::new).collect();
        let hull = hull(&arcs)?;
        Ok(AbutmentContour::from_arcs(arcs, hull))
    }

    fn from_arcs(arcs: Vec<ContourArc>, hull: Vec<ContourArc>) -> AbutmentContour {
        let ends: Vec<(f64, f64)> = hull.iter().map(|a| (a.normal_end.x, a.normal_end.y)).collect();
        let (high, low) = (hull[0].normal_start.x, hull[hull.len() - 1].normal_end.x);
        let table_steps_per_x = TABLE_STEPS as f64 / (high - low).max(1e-9);
        // The first arc whose end normal is not before the largest x of a step; the search continues from there.
        let first = |step: usize| {
            let x = low + (step + 1) as f64 / table_steps_per_x + 1e-9;
            ends.iter().position(|e| e.0 <= x).unwrap_or(ends.len()) as u16
        };
        let looks_up = hull.iter().all(|a| a.normal_start.y > 0.0 && a.normal_end.y > 0.0);
        let table = if looks_up { (0..TABLE_STEPS).map(first).collect() } else { vec![0; TABLE_STEPS] };
        AbutmentContour { arcs, hull, ends, table, table_from: low, table_steps_per_x }
    }

    /// The first arc whose end normal is not before `direction`, a unit vector; the number of arcs if there is none.
    #[inline]
    fn facing(&self, direction: Vec2) -> usize {
        let step = (direction.x - self.table_from) * self.table_steps_per_x;
        let step = if step > 0.0 { step as usize } else { 0 };
        // The table covers only these directions.
        let mut arc = if step < TABLE_STEPS && direction.y > 0.0 { self.table[step] as usize } else { 0 };
        // direction . perp(normal) > 0: the normal has not reached it.
        while arc < self.ends.len() && direction.y * self.ends[arc].0 - direction.x * self.ends[arc].1 > 0.0 {
            arc += 1;
        }
        arc
    }

    /// The convex hull, and the index of its arc that supports a plane with the outward normal `direction`; the number
    /// of arcs if the plane rests on the end.
    pub fn hull_facing(&self, direction: Vec2) -> (&[ContourArc], usize) {
        (&self.hull, self.facing(direction))
    }

    /// The arcs in order.
    pub fn arcs(&self) -> &[ContourArc] {
        &self.arcs
    }

    pub fn start(&self) -> Vec2 {
        self.arcs[0].start
    }

    pub fn end(&self) -> Vec2 {
        self.arcs[self.arcs.len() - 1].end
    }

    /// Radius of the tightest hollow; infinite if there is none [m].
    pub fn hollow_radius_m(&self) -> f64 {
        self.arcs.iter().filter(|a| a.radius_m < 0.0).map(|a| -a.radius_m).fold(f64::INFINITY, f64::min)
    }

    /// Mirror image x -> -x.
    pub fn mirrored(&self) -> AbutmentContour {
        let mirrored = |arcs: &[ContourArc]| arcs.iter().rev().map(ContourArc::mirrored).collect();
        AbutmentContour::from_arcs(mirrored(&self.arcs), mirrored(&self.hull))
    }

    /// The open contour, for drawing.
    pub fn profile(&self) -> Result<Profile, ProfileError> {
        Profile::new(self.arcs.iter().map(ContourArc::element).collect(), false)
    }

    /// Support function: height of the contour over the origin along the unit vector `direction`, and the point that
    /// reaches it, where a plane with that normal rests. The ends of the contour support directions beyond their
    /// normals.
    pub fn support(&self, direction: Vec2) -> (f64, Vec2) {
        // The normal passes `direction` at the first arc whose end normal is not before it.
        let arc = self.facing(direction);
        let point = match self.hull.get(arc) {
            None => self.end(),
            Some(a) if a.radius_m.is_infinite() || direction.dot(&perp(a.normal_start)) < 0.0 => a.start,
            Some(a) => a.centre + direction * a.radius_m,
        };
        (point.dot(&direction), point)
    }

    /// As [`AbutmentContour::support`], with the radius of curvature there: zero at the contour's ends, and on a flat, where
    /// the plane rests on its first point.
    pub fn support_with_radius(&self, direction: Vec2) -> (f64, Vec2, f64) {
        let (height, point) = self.support(direction);
        let arc = self.facing(direction);
        let radius_m = match self.hull.get(arc) {
            Some(a) if a.radius_m.is_finite() && direction.dot(&perp(a.normal_start)) >= 0.0 => a.radius_m,
            _ => 0.0,
        };
        (height, point, radius_m)
    }

    /// Foot of the perpendicular from `o`, a point outside and nearer than [`AbutmentContour::hollow_radius_m`], or inside and
    /// no deeper than the radii of curvature.
    pub fn closest_to_point(&self, o: Vec2) -> ContourFoot {
        let last = self.arcs.len() - 1;
        let past = |p: Vec2, normal: Vec2| (o - p).dot(&perp(normal)) > 0.0;
        let arc = self.arcs.partition_point(|a| past(a.end, a.normal_end));
        if arc > last {
            return end_foot(last, self.end(), self.arcs[last].normal_end, o);
        }
        if arc == 0 && !past(self.start(), self.arcs[0].normal_start) {
            return end_foot(0, self.start(), self.arcs[0].normal_start, o);
        }
        self.arcs[arc].foot(arc, o)
    }
}

/// The convex hull of arcs with a hollow after the first of them: an arc that spans the hollow, from the start of the
/// contour to the arc at which it is tangent, and the following arcs. The span bulges by [`BULGE_RAD`], so that the
/// contact point of a plane across the hollow moves with its inclination and does not jump from one side to the other.
fn hull(arcs: &[ContourArc]) -> Result<Vec<ContourArc>, ContourError> {
    let Some(last) = arcs.iter().rposition(|a| a.radius_m < 0.0) else { return Ok(arcs.to_vec()) };
    let from = arcs[0].start;
    let touches = |a: &ContourArc| {
        // The normal n of the tangent from `from`: n . (from - centre) = radius, on the side of the contour.
        let away = from - a.centre;
        let share = a.radius_m / away.norm();
        let along = away / away.norm();
        let tangent = along * share + perp(along) * libm::sqrt(1.0 - share * share);
        let n = (tangent + perp(tangent) * BULGE_RAD).normalize();
        (cross(a.normal_start, n) >= 0.0 && cross(n, a.normal_end) >= 0.0).then_some(n)
    };
    let mut convex = arcs.iter().enumerate().skip(last + 1).filter(|(_, a)| a.radius_m.is_finite());
    let (at, normal) = convex.find_map(|(k, a)| touches(a).map(|n| (k, n))).ok_or(ContourError::Concave(last))?;
    let rest = arcs[at].after(normal);
    // The arc through `from` that is tangent at the end: |from - end + n radius| = radius.
    let back = from - rest.start;
    let radius_m = -back.norm_squared() / (2.0 * back.dot(&normal));
    let centre = rest.start - normal * radius_m;
    let normal_start = (from - centre) / radius_m;
    // No point may project beyond it.
    let outside = |p: Vec2| (p - centre).norm() > radius_m + OUTSIDE * back.norm();
    if let Some(k) = arcs[..at].iter().position(|a| outside(a.end)) {
        return Err(ContourError::Concave(k));
    }
    let across = ContourArc {
        centre,
        radius_m,
        start: from,
        end: rest.start,
        normal_start,
        normal_end: normal,
        normal_start_rad: normal_angle(normal_start),
        normal_end_rad: normal_angle(normal),
    };
    Ok([across, rest].into_iter().chain(arcs[at + 1..].iter().copied()).collect())
}

/// Angle between the span over a hollow and the arc at its end [rad]: over 2 mm it bulges by some 5 nm.
const BULGE_RAD: f64 = 1e-5;

/// Tolerance for points outside of a line, relative to its length: rounding.
const OUTSIDE: f64 = 1e-12;

/// The end of a contour as the nearest point.
fn end_foot(arc: usize, point: Vec2, outward: Vec2, o: Vec2) -> ContourFoot {
    let d = o - point;
    let length = d.norm();
    let side = if d.dot(&outward) < 0.0 { -1.0 } else { 1.0 };
    let normal = if length == 0.0 { outward } else { d * (side / length) };
    ContourFoot { arc, point, normal, distance_m: side * length, radius_m: 0.0 }
}
