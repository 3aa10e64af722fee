//! Convex contours as arcs in the order of their normals.
//!
//! The contour is open, runs with the material on its left, and turns only to the left, so that the angle of the
//! outward normal rises along it. Because it is convex the foot of the perpendicular from a point outside is unique,
//! the sign of (O - P_j).t_j at a junction P_j with tangent t_j says on which side of the junction the foot lies, and
//! that sign changes once along the contour: a binary search over the junctions finds the arc, and the foot on an arc
//! is exact. Nothing here calls a trigonometric function; the cost is a few dozen multiplications and one square root.

use crate::geometry::profile::{Element, Profile, ProfileError};
use crate::geometry::{Vec2, perp};
use crate::units::{atan2, wrap_angle};
use std::f64::consts::PI;

/// A convex arc, or a flat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConvexArc {
    /// For a flat, a point on it.
    pub centre: Vec2,
    /// Infinite for a flat.
    pub radius_m: f64,
    pub start: Vec2,
    pub end: Vec2,
    /// Outward unit normals (cos, sin of the angles below) at both ends.
    pub normal_start: Vec2,
    pub normal_end: Vec2,
    /// Angle of the outward normal from +x [rad], rising along the contour.
    pub normal_start_rad: f64,
    pub normal_end_rad: f64,
}

/// A convex contour in the link frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexContour {
    arcs: Vec<ConvexArc>,
    /// (x, y) of the end normals, for searching, and for equal steps of x of a direction from `table_from` on, the first arc
    /// that may face it: normals look to +y, so x falls along the contour.
    ends: Vec<(f64, f64)>,
    table: Vec<u16>,
    table_from: f64,
    table_steps_per_x: f64,
}

/// Steps of the search table.
const TABLE_STEPS: usize = 256;

/// The point of a convex contour nearest to a point outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConvexFoot {
    /// Index of the arc.
    pub arc: usize,
    pub point: Vec2,
    /// Unit vector out of the contour at the foot; at the ends of the contour, towards the query point.
    pub normal: Vec2,
    /// Signed distance along the normal [m], negative in the material.
    pub distance_m: f64,
    /// Infinite on a flat, zero at the contour's ends.
    pub radius_m: f64,
}

impl ConvexArc {
    fn new(element: &Element) -> ConvexArc {
        let (normal_start, normal_end) = (element.normal(0.0), element.normal(1.0));
        let (centre, radius_m) = match *element {
            Element::Line { start, .. } => (start, f64::INFINITY),
            Element::Arc { centre, radius_m, .. } => (centre, radius_m),
        };
        let angle = |n: Vec2| {
            // Contours look towards +y: measured from there no angle wraps.
            0.5 * PI + wrap_angle(atan2(n.y, n.x) - 0.5 * PI)
        };
        ConvexArc {
            centre,
            radius_m,
            start: element.start(),
            end: element.end(),
            normal_start,
            normal_end,
            normal_start_rad: angle(normal_start),
            normal_end_rad: angle(normal_end),
        }
    }

    /// Foot of the perpendicular from `o`, which faces this arc.
    fn foot(&self, arc: usize, o: Vec2) -> ConvexFoot {
        if self.radius_m.is_infinite() {
            let distance_m = (o - self.centre).dot(&self.normal_start);
            let normal = self.normal_start;
            return ConvexFoot { arc, point: o - normal * distance_m, normal, distance_m, radius_m: self.radius_m };
        }
        let from_centre = o - self.centre;
        let length = from_centre.norm();
        let normal = from_centre / length;
        ConvexFoot {
            arc,
            point: self.centre + normal * self.radius_m,
            normal,
            distance_m: length - self.radius_m,
            radius_m: self.radius_m,
        }
    }

    fn mirrored(&self) -> ConvexArc {
        let mirror = |v: Vec2| Vec2::new(-v.x, v.y);
        ConvexArc {
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
        Element::Arc {
            centre: self.centre,
            radius_m: self.radius_m,
            start_rad: self.normal_start_rad,
            sweep_rad: self.normal_end_rad - self.normal_start_rad,
        }
    }
}

impl ConvexContour {
    /// From elements that turn to the left only and join with common tangents. `Err` has the index of the one that does
    /// not.
    pub fn new(elements: &[Element]) -> Result<ConvexContour, usize> {
        assert!(!elements.is_empty(), "a contour has elements");
        if let Some(concave) = elements.iter().position(|e| e.curvature_per_m() < 0.0) {
            return Err(concave);
        }
        Ok(ConvexContour::from_arcs(elements.iter().map(ConvexArc::new).collect()))
    }

    fn from_arcs(arcs: Vec<ConvexArc>) -> ConvexContour {
        let ends: Vec<(f64, f64)> = arcs.iter().map(|a| (a.normal_end.x, a.normal_end.y)).collect();
        let (high, low) = (arcs[0].normal_start.x, arcs[arcs.len() - 1].normal_end.x);
        let table_steps_per_x = TABLE_STEPS as f64 / (high - low).max(1e-9);
        // The first arc whose end normal is not before the largest x of a step; the search goes on from there.
        let first = |step: usize| {
            let x = low + (step + 1) as f64 / table_steps_per_x + 1e-9;
            ends.iter().position(|e| e.0 <= x).unwrap_or(ends.len()) as u16
        };
        let looks_up = arcs.iter().all(|a| a.normal_start.y > 0.0 && a.normal_end.y > 0.0);
        let table = if looks_up { (0..TABLE_STEPS).map(first).collect() } else { vec![0; TABLE_STEPS] };
        ConvexContour { arcs, ends, table, table_from: low, table_steps_per_x }
    }

    /// The first arc whose end normal is not before `direction`, a unit vector; the number of arcs if there is none.
    #[inline]
    fn facing(&self, direction: Vec2) -> usize {
        let step = (direction.x - self.table_from) * self.table_steps_per_x;
        let step = if step > 0.0 { step as usize } else { 0 };
        // Beyond the table nothing is known.
        let mut arc = if step < TABLE_STEPS && direction.y > 0.0 { self.table[step] as usize } else { 0 };
        // direction . perp(normal) > 0: the normal has not reached it.
        while arc < self.ends.len() && direction.y * self.ends[arc].0 - direction.x * self.ends[arc].1 > 0.0 {
            arc += 1;
        }
        arc
    }

    /// The arcs in the order of their normals.
    pub fn arcs(&self) -> &[ConvexArc] {
        &self.arcs
    }

    pub fn start(&self) -> Vec2 {
        self.arcs[0].start
    }

    pub fn end(&self) -> Vec2 {
        self.arcs[self.arcs.len() - 1].end
    }

    /// Mirror image x -> -x.
    pub fn mirrored(&self) -> ConvexContour {
        ConvexContour::from_arcs(self.arcs.iter().rev().map(ConvexArc::mirrored).collect())
    }

    /// The open contour, for drawing.
    pub fn profile(&self) -> Result<Profile, ProfileError> {
        Profile::new(self.arcs.iter().map(ConvexArc::element).collect(), false)
    }

    /// Height of the contour over the origin along the unit vector `direction`, and the point that reaches it: where a
    /// plane with that normal rests. The ends of the contour support what points past their normals.
    pub fn support(&self, direction: Vec2) -> (f64, Vec2) {
        // The normal passes `direction` at the first arc whose end normal is not before it.
        let arc = self.facing(direction);
        let point = match self.arcs.get(arc) {
            None => self.end(),
            Some(a) if a.radius_m.is_infinite() || direction.dot(&perp(a.normal_start)) < 0.0 => a.start,
            Some(a) => a.centre + direction * a.radius_m,
        };
        (point.dot(&direction), point)
    }

    /// As [`ConvexContour::support`], with the radius of curvature there: zero at the contour's ends, and on a flat, where
    /// the plane rests on its first point.
    pub fn support_with_radius(&self, direction: Vec2) -> (f64, Vec2, f64) {
        let (height, point) = self.support(direction);
        let arc = self.facing(direction);
        let radius_m = match self.arcs.get(arc) {
            Some(a) if a.radius_m.is_finite() && direction.dot(&perp(a.normal_start)) >= 0.0 => a.radius_m,
            _ => 0.0,
        };
        (height, point, radius_m)
    }

    /// Foot of the perpendicular from `o`, a point outside, or no deeper than the radii of curvature.
    pub fn closest_to_point(&self, o: Vec2) -> ConvexFoot {
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

/// The end of a contour as the nearest point.
fn end_foot(arc: usize, point: Vec2, outward: Vec2, o: Vec2) -> ConvexFoot {
    let d = o - point;
    let length = d.norm();
    let side = if d.dot(&outward) < 0.0 { -1.0 } else { 1.0 };
    let normal = if length == 0.0 { outward } else { d * (side / length) };
    ConvexFoot { arc, point, normal, distance_m: side * length, radius_m: 0.0 }
}
