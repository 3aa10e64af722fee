//! Smallest distance between two contour elements, exact for arcs and lines.
//!
//! The nearest points of two smooth contours have a common normal. For two elements they are either on the common
//! normal of two arcs or of an arc and a line, or an end of one element and its foot on the other one:
//!
//! ```text
//! convex, convex     |C1 C2| - r1 - r2           convex in concave     r2 - |C1 C2| - r1   (r1 < r2)
//! convex, line       n . (C1 - P) - r1
//! ```
//! The gap is negative where the bodies overlap. Valid for overlaps that are shallow compared with the thickness of the
//! bodies: an element that lies deeper in the other body than `deepest_m` is assumed to be on its far side, and has no
//! gap there.

use super::Vec2;
use super::profile::Element;

/// Signed gap of two elements of two bodies [m]; infinite if they do not face each other. `deepest_m` is the largest
/// overlap that is distinguished from being on the far side.
pub fn element_gap_m(a: &Element, b: &Element, deepest_m: f64) -> f64 {
    let square = common_normal_gap_m(a, b).or_else(|| common_normal_gap_m(b, a)).unwrap_or(f64::INFINITY);
    let square = if square > -deepest_m { square } else { f64::INFINITY };
    square.min(ends_gap_m(a, b, deepest_m)).min(ends_gap_m(b, a, deepest_m))
}

/// Lower bound of the distance of two elements [m]: cheap, without trigonometric functions. No point of an element is
/// further than half its length from its middle.
pub fn least_distance_m(a: &Element, b: &Element) -> f64 {
    (a.point(0.5) - b.point(0.5)).norm() - 0.5 * (a.length_m() + b.length_m())
}

/// Gap along the common normal of a convex arc `a` and the element `b`, if that normal meets both elements.
fn common_normal_gap_m(a: &Element, b: &Element) -> Option<f64> {
    let Element::Arc { centre, radius_m, sweep_rad, .. } = *a else { return None };
    if sweep_rad < 0.0 {
        return None;
    }
    let met = |element: &Element, point: Vec2| (0.0..=1.0).contains(&element.foot_along(point));
    match *b {
        Element::Line { start, .. } => {
            let normal = b.normal(0.0);
            let met_both = met(b, centre) && met(a, centre - normal * radius_m);
            met_both.then(|| normal.dot(&(centre - start)) - radius_m)
        }
        Element::Arc { centre: other, radius_m: other_radius_m, sweep_rad: other_sweep_rad, .. } => {
            let between = other - centre;
            let distance_m = between.norm();
            if distance_m == 0.0 {
                return None;
            }
            if other_sweep_rad > 0.0 {
                let met_both = met(a, centre + between) && met(b, other - between);
                met_both.then_some(distance_m - radius_m - other_radius_m)
            } else {
                // Inside a concave arc the nearest points lie beyond the centre of the smaller arc.
                let met_both = radius_m < other_radius_m && met(a, centre - between) && met(b, other - between);
                met_both.then_some(other_radius_m - distance_m - radius_m)
            }
        }
    }
}

/// Smallest gap between the ends of `a` and the element `b`.
fn ends_gap_m(a: &Element, b: &Element, deepest_m: f64) -> f64 {
    let mut smallest = f64::INFINITY;
    for along in [0.0, 1.0] {
        let point = a.point(along);
        let foot = b.closest(point);
        let inside = foot.along > 0.0 && foot.along < 1.0;
        let gap_m = if foot.distance_m >= 0.0 || !inside {
            foot.distance_m.abs()
        } else if a.normal(along).dot(&foot.normal) < 0.0 && foot.distance_m > -deepest_m {
            foot.distance_m
        } else {
            continue;
        };
        smallest = smallest.min(gap_m);
    }
    smallest
}
