//! Contact of a circle with a contour by a search over all its elements, which knows nothing of tooth gaps or spans: what the
//! searches of the program are held against.
//!
//! A pair touches where its gap has a local minimum. A contact is counted for the element whose interior holds the
//! perpendicular foot, or for the convex corner where none does; joints that are C1 are owned by the element that begins
//! there, so that no contact is counted twice.

use pitchline::geometry::Vec2;
use pitchline::geometry::cross;
use pitchline::geometry::profile::{Element, Profile};
use pitchline::pairs::bush_gap::ContourTouch;
use pitchline::units::{atan2, wrap_angle};

/// Circle against an element: the touch whose foot lies in the element's interior, if there is one.
///
/// A circle inside a concave arc touches it on the far side from the arc's centre; outside a convex arc on the near side.
fn circle_element(centre: Vec2, radius_m: f64, index: usize, element: &Element) -> Option<ContourTouch> {
    let (on_body, normal, distance_m) = match *element {
        Element::Line { start, end } => {
            let along = element.foot_along(centre);
            if !(0.0..1.0).contains(&along) {
                return None;
            }
            let foot = start + (end - start) * along;
            let normal = element.normal(0.0);
            (foot, normal, (centre - foot).dot(&normal))
        }
        Element::Arc { centre: c, radius_m: r, start_rad, sweep_rad } => {
            let d = centre - c;
            let distance = d.norm();
            if distance == 0.0 {
                return None;
            }
            let middle = start_rad + 0.5 * sweep_rad;
            let along = 0.5 + wrap_angle(atan2(d.y, d.x) - middle) / sweep_rad;
            if !(0.0..1.0).contains(&along) {
                return None;
            }
            let outward = d / distance;
            if sweep_rad > 0.0 {
                (c + outward * r, outward, distance - r)
            } else {
                (c + outward * r, -outward, r - distance)
            }
        }
    };
    Some(ContourTouch {
        element: index,
        corner: false,
        on_body,
        on_other: centre - normal * radius_m,
        normal,
        penetration_m: radius_m - distance_m,
    })
}

/// Circle against the corner where `before` ends and `after` begins: a touch when the corner is convex and the circle's
/// centre faces neither element squarely.
fn circle_corner(centre: Vec2, radius_m: f64, index: usize, before: &Element, after: &Element) -> Option<ContourTouch> {
    let point = before.end();
    let d = centre - point;
    let (t0, t1) = (before.tangent(1.0), after.tangent(0.0));
    // Convex: the contour turns left. The normal cone of the corner lies ahead of `before` and behind `after`.
    if cross(t0, t1) <= CORNER_KINK || d.dot(&t0) < 0.0 || d.dot(&t1) >= 0.0 {
        return None;
    }
    let distance = d.norm();
    if distance == 0.0 {
        return None;
    }
    let normal = d / distance;
    Some(ContourTouch {
        element: index,
        corner: true,
        on_body: point,
        on_other: centre - normal * radius_m,
        normal,
        penetration_m: radius_m - distance,
    })
}

/// Sine of the smallest kink that counts as a corner: rounding of C1 joints stays far below.
const CORNER_KINK: f64 = 1e-9;

/// Every overlap of a circle with a contour, in the order of elements. `centre` in the body's frame.
pub fn touches(profile: &Profile, centre: Vec2, radius_m: f64) -> Vec<ContourTouch> {
    let elements = profile.elements();
    let mut found = Vec::new();
    for (i, element) in elements.iter().enumerate() {
        found.extend(circle_element(centre, radius_m, i, element));
        let next = if profile.is_closed() { Some(&elements[(i + 1) % elements.len()]) } else { elements.get(i + 1) };
        found.extend(next.and_then(|after| circle_corner(centre, radius_m, i, element, after)));
    }
    // Deeper than its diameter the circle lies behind the contour.
    found.retain(|t| t.penetration_m > 0.0 && t.penetration_m < 2.0 * radius_m);
    found
}
