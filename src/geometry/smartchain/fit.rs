//! Smooth curves as sequences of tangent arcs.
//!
//! A piece of curve between two points with their tangents becomes a biarc: two arcs with a common tangent, here with
//! tangent legs of equal length d at both ends,
//!
//! ```text
//! q d^2 + 2 (v.s) d - v^2 = 0,   v = P1 - P0,   s = t0 + t1,   q = |t1 - t0|^2,   joint = (P0 + d t0 + P1 - d t1) / 2
//! ```
//! Source: K. M. Bolton, "Biarc curves", Computer-Aided Design 7 (1975). The deviation from the curve decreases with
//! the third power of the piece's length; where the curve is convex both arcs are convex.

use crate::geometry::profile::Element;
use crate::geometry::{Vec2, cross, perp};
use crate::units::atan2;

/// Point and unit tangent of a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    pub point: Vec2,
    pub tangent: Vec2,
}

/// Ratio of radius to chord above which an arc becomes a line: it bulges by 1e-7 of the chord, and its remote centre
/// would lose digits.
const STRAIGHT_RATIO: f64 = 1e6;

/// Samples of the deviation inside one piece.
const SAMPLES: u32 = 16;

/// Bisection steps when the longest possible piece is searched.
const BISECTIONS: u32 = 20;

/// The two arcs from `a` to `b`. Empty pieces are omitted.
pub fn biarc(a: CurvePoint, b: CurvePoint) -> Vec<Element> {
    let v = b.point - a.point;
    let along = v.dot(&(a.tangent + b.tangent));
    let q = (b.tangent - a.tangent).norm_squared();
    let leg = v.norm_squared() / (along + libm::sqrt(along * along + q * v.norm_squared()));
    let (first, second) = (a.point + a.tangent * leg, b.point - b.tangent * leg);
    let joint = (first + second) * 0.5;
    let tangent = (second - first).normalize();
    // Signed radius, positive to the left, from the chord and the tangent at one of its ends.
    let from = joint - a.point;
    let to = joint - b.point;
    let radius_a = from.norm_squared() / (2.0 * from.dot(&perp(a.tangent)));
    let radius_b = to.norm_squared() / (2.0 * to.dot(&perp(b.tangent)));
    let arc = |start: Vec2, end: Vec2, centre: Vec2, signed_radius: f64, t0: Vec2, t1: Vec2| {
        if !signed_radius.is_finite() || signed_radius.abs() > STRAIGHT_RATIO * (end - start).norm() {
            return Element::Line { start, end };
        }
        let out = -perp(t0) * signed_radius.signum();
        Element::Arc {
            centre,
            radius_m: signed_radius.abs(),
            start_rad: atan2(out.y, out.x),
            sweep_rad: atan2(cross(t0, t1), t0.dot(&t1)),
        }
    };
    vec![
        arc(a.point, joint, a.point + perp(a.tangent) * radius_a, radius_a, a.tangent, tangent),
        arc(joint, b.point, b.point + perp(b.tangent) * radius_b, radius_b, tangent, b.tangent),
    ]
}

/// Largest distance of `curve` between `from` and `to` from the nearest of `elements`, at `samples` points [m].
pub fn deviation_m(curve: &dyn Fn(f64) -> CurvePoint, from: f64, to: f64, elements: &[Element], samples: u32) -> f64 {
    (0..samples)
        .map(|k| {
            let p = curve(from + (to - from) * (f64::from(k) + 0.5) / f64::from(samples)).point;
            elements.iter().map(|e| e.closest(p).distance_m.abs()).fold(f64::INFINITY, f64::min)
        })
        .fold(0.0, f64::max)
}

/// Approximates `curve` from parameter `from` to `to` by as few biarcs as possible with a deviation of at most
/// `tolerance_m`, which is distributed evenly over them.
pub fn fit(curve: &dyn Fn(f64) -> CurvePoint, from: f64, to: f64, tolerance_m: f64) -> Vec<Element> {
    let mut best = march(curve, from, to, tolerance_m, usize::MAX).unwrap_or_default();
    let (mut low, mut high) = (0.0, tolerance_m);
    for _ in 0..8 {
        let middle = 0.5 * (low + high);
        match march(curve, from, to, middle, best.len()) {
            Some(found) => (best, high) = (found, middle),
            None => low = middle,
        }
    }
    best
}

/// Minimum share of the parameter range of one piece.
const MIN_SHARE: f64 = 1.0 / 1024.0;

/// Longest possible pieces one after another; None if more than `most` elements are needed.
fn march(curve: &dyn Fn(f64) -> CurvePoint, from: f64, to: f64, tolerance_m: f64, most: usize) -> Option<Vec<Element>> {
    let mut elements = Vec::new();
    let mut start = from;
    loop {
        let piece = |end: f64| {
            let biarc = biarc(curve(start), curve(end));
            (deviation_m(curve, start, end, &biarc, SAMPLES) <= tolerance_m).then_some(biarc)
        };
        if elements.len() + 2 > most {
            return None;
        }
        if let Some(last) = piece(to) {
            elements.extend(last);
            return Some(elements);
        }
        let end = super::path::boundary_within(start, to, BISECTIONS, |end| piece(end).is_some());
        // A curve that is not smooth would be divided without end: pieces have a minimum length, and the resulting
        // deviation is measured.
        let end = end.max(start + (to - from) * MIN_SHARE).min(to);
        elements.extend(biarc(curve(start), curve(end)));
        start = end;
    }
}
