//! The route of a closed chain around its sprockets and over the rails between them.
//!
//! The loop is traversed counterclockwise: sprockets with [`Wrap::Inside`] lie inside the loop (on the left of the
//! chain) and turn counterclockwise, those with [`Wrap::Outside`] lie outside and turn clockwise. The path is that of
//! the joint centres: arcs on the pitch circles and common tangents between them. Joints are placed on the path by
//! chords of one pitch, so that on a pitch circle they advance by exactly 2 pi / z. A convex arc of a rail is an
//! optional circle: it belongs to the route only if the taut chain bends around it.

use super::{Vec2, cross, perp};
use crate::units::{atan2, wrap_angle};
use std::f64::consts::PI;

/// Side of the chain on which a sprocket lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Wrap {
    Inside,
    Outside,
}

impl Wrap {
    /// +1 turns counterclockwise, -1 clockwise, when the chain moves forwards.
    pub fn sign(self) -> f64 {
        match self {
            Wrap::Inside => 1.0,
            Wrap::Outside => -1.0,
        }
    }
}

/// A pitch circle that the chain wraps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulley {
    pub centre: Vec2,
    pub pitch_radius_m: f64,
    pub wrap: Wrap,
    /// An arc of a rail: the chain wraps it only if it must bend there.
    pub is_optional: bool,
}

/// A straight stretch between two sprockets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    pub start: Vec2,
    /// Unit vector of travel.
    pub direction: Vec2,
    pub length_m: f64,
}

/// The chain on one sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrapArc {
    pub centre: Vec2,
    pub radius_m: f64,
    pub start_rad: f64,
    /// Signed by the sense of rotation.
    pub sweep_rad: f64,
}

/// Why no route exists.
#[derive(Clone, Debug, PartialEq)]
pub enum RouteError {
    /// Pulleys `first` and `second` overlap so that no common tangent exists; distance needed [m]. Indices into all
    /// pulleys.
    Overlap { first: usize, second: usize, needed_m: f64 },
    /// The chain would not touch this pulley, or would have to cross itself. Index into all pulleys.
    Unwrapped { pulley: usize },
    /// No position closes this number of links.
    Open { links: usize, fits: Vec<usize>, longer_m: f64 },
}

impl std::fmt::Display for RouteError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RouteError::Overlap { first, second, needed_m } => write!(
                f,
                "sprockets {first} and {second} of the route stand too close; their axes must be more than {:.3} mm apart",
                needed_m * 1e3
            ),
            RouteError::Unwrapped { pulley } => {
                write!(f, "the chain does not wrap sprocket {pulley} of the route from this side")
            }
            RouteError::Open { links, fits, .. } => {
                write!(f, "a loop of {links} links does not close")?;
                if !fits.is_empty() {
                    write!(f, "; possible here: {fits:?}")?;
                }
                Ok(())
            }
        }
    }
}

impl std::error::Error for RouteError {}

/// The closed path: pulley 0, span 0 (from pulley 0 to 1), pulley 1, span 1, ...
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    wraps: Vec<WrapArc>,
    spans: Vec<Span>,
    /// Index into `wraps` of every sprocket.
    stops: Vec<usize>,
    /// Index of the pulley of each wrap.
    pulleys: Vec<usize>,
    /// Path length at the start of each piece, alternating wrap and span, and the total at the end [m].
    starts_m: Vec<f64>,
}

impl Route {
    /// The path around `pulleys` in the order of travel, without optional ones around which it does not bend.
    pub fn new(pulleys: &[Pulley]) -> Result<Route, RouteError> {
        let kept = taut_pulleys(pulleys);
        let chosen: Vec<Pulley> = kept.iter().map(|i| pulleys[*i]).collect();
        let mut route = Route::round(&chosen).map_err(|e| match e {
            RouteError::Overlap { first, second, needed_m } => {
                RouteError::Overlap { first: kept[first], second: kept[second], needed_m }
            }
            RouteError::Unwrapped { pulley } => RouteError::Unwrapped { pulley: kept[pulley] },
            RouteError::Open { links, fits, longer_m } => RouteError::Open { links, fits, longer_m },
        })?;
        route.stops = (0..kept.len()).filter(|i| !chosen[*i].is_optional).collect();
        route.pulleys = kept;
        Ok(route)
    }

    /// The path around all of `pulleys`.
    fn round(pulleys: &[Pulley]) -> Result<Route, RouteError> {
        let n = pulleys.len();
        assert!(n >= 2, "a route needs two sprockets, got {n}");
        let mut spans = Vec::with_capacity(n);
        for i in 0..n {
            let (a, b) = (&pulleys[i], &pulleys[(i + 1) % n]);
            let needed_m = (b.wrap.sign() * b.pitch_radius_m - a.wrap.sign() * a.pitch_radius_m).abs();
            let overlap = RouteError::Overlap { first: i, second: (i + 1) % n, needed_m };
            spans.push(common_tangent(a, b).ok_or(overlap)?);
        }
        let mut wraps = Vec::with_capacity(n);
        for i in 0..n {
            let p = pulleys[i];
            let arrive = spans[(i + n - 1) % n].direction;
            let leave = spans[i].direction;
            let turn = atan2(cross(arrive, leave), arrive.dot(&leave)) * p.wrap.sign();
            let sweep = if turn < 0.0 { turn + 2.0 * PI } else { turn };
            if sweep <= 1e-9 || sweep >= 2.0 * PI - 1e-9 {
                return Err(RouteError::Unwrapped { pulley: i });
            }
            let radial = -perp(arrive) * p.wrap.sign();
            wraps.push(WrapArc {
                centre: p.centre,
                radius_m: p.pitch_radius_m,
                start_rad: atan2(radial.y, radial.x),
                sweep_rad: sweep * p.wrap.sign(),
            });
        }
        // A simple closed loop turns by 2 pi in all.
        let total: f64 = wraps.iter().map(|w| w.sweep_rad).sum();
        if (total - 2.0 * PI).abs() > 1e-6 {
            let pulley = (0..n).max_by(|a, b| wraps[*a].sweep_rad.abs().total_cmp(&wraps[*b].sweep_rad.abs()));
            return Err(RouteError::Unwrapped { pulley: pulley.unwrap_or(0) });
        }
        let mut starts_m = vec![0.0];
        for (wrap, span) in wraps.iter().zip(&spans) {
            let end = starts_m[starts_m.len() - 1];
            starts_m.push(end + wrap.radius_m * wrap.sweep_rad.abs());
            starts_m.push(starts_m[starts_m.len() - 1] + span.length_m);
        }
        Ok(Route { wraps, spans, stops: (0..n).collect(), pulleys: (0..n).collect(), starts_m })
    }

    /// Length of the path [m].
    pub fn length_m(&self) -> f64 {
        self.starts_m[self.starts_m.len() - 1]
    }

    /// Number of sprockets, that is, of pulleys that are not optional.
    pub fn sprockets(&self) -> usize {
        self.stops.len()
    }

    /// The straight stretch that leaves sprocket `k`: to the next one, or to the first arc around which the chain bends
    /// before it.
    pub fn span_after(&self, k: usize) -> &Span {
        &self.spans[self.stops[k]]
    }

    /// The straight stretch that arrives at sprocket `k`.
    pub fn span_before(&self, k: usize) -> &Span {
        let n = self.spans.len();
        &self.spans[(self.stops[k] + n - 1) % n]
    }

    /// The chain on sprocket `k`.
    pub fn wrap(&self, k: usize) -> &WrapArc {
        &self.wraps[self.stops[k]]
    }

    /// The chain on every pulley of the route, with the pulley's index, in the order of travel.
    pub fn wraps(&self) -> impl Iterator<Item = (usize, &WrapArc)> {
        self.pulleys.iter().copied().zip(&self.wraps)
    }

    /// Path length from the end of the wrap on sprocket `k` to the start of the wrap on the next one [m].
    pub fn path_to_next_sprocket_m(&self, k: usize) -> f64 {
        if self.stops.len() == self.wraps.len() {
            return self.spans[k].length_m;
        }
        let next = self.wrap_start_m((k + 1) % self.stops.len());
        (next - self.span_start_m(k)).rem_euclid(self.length_m())
    }

    /// Path length at which the span that leaves sprocket `k` begins [m].
    pub fn span_start_m(&self, k: usize) -> f64 {
        self.starts_m[2 * self.stops[k] + 1]
    }

    /// Path length at which the wrap on sprocket `k` begins [m].
    pub fn wrap_start_m(&self, k: usize) -> f64 {
        self.starts_m[2 * self.stops[k]]
    }

    /// Point and unit tangent at path length `s_m`, which is periodic in the loop length.
    pub fn at(&self, s_m: f64) -> (Vec2, Vec2) {
        let total = self.length_m();
        let s = s_m - libm::floor(s_m / total) * total;
        let piece = match self.starts_m.binary_search_by(|x| x.total_cmp(&s)) {
            Ok(i) => i,
            Err(i) => i - 1,
        }
        .min(self.starts_m.len() - 2);
        let local = s - self.starts_m[piece];
        if piece % 2 == 0 {
            let w = self.wraps[piece / 2];
            let sense = w.sweep_rad.signum();
            let e = super::unit(w.start_rad + sense * local / w.radius_m);
            (w.centre + e * w.radius_m, perp(e) * sense)
        } else {
            let span = self.spans[piece / 2];
            (span.start + span.direction * local, span.direction)
        }
    }

    /// Path length of the next joint, one chord of `pitch_m` ahead of `s_m`.
    pub fn next_joint_m(&self, s_m: f64, pitch_m: f64) -> f64 {
        let (from, _) = self.at(s_m);
        // Newton on |P(s) - P0| = pitch; the chord grows monotonically with s as long as pitch < 2 R.
        let mut s = s_m + pitch_m;
        for _ in 0..50 {
            let (p, tangent) = self.at(s);
            let d = p - from;
            let chord = d.norm();
            let slope = (d.dot(&tangent) / chord).max(0.1);
            let step = (pitch_m - chord) / slope;
            s += step;
            if step.abs() < 1e-17 + 1e-16 * s.abs() {
                break;
            }
        }
        s
    }

    /// Number of links that fit on the path, in general not an integer: chords of `pitch_m` from [`Route::anchor_m`].
    pub fn links_that_fit(&self, pitch_m: f64) -> f64 {
        let total = self.length_m();
        let start = self.anchor_m();
        let (mut s, mut n) = (start, 0.0);
        loop {
            let next = self.next_joint_m(s, pitch_m);
            if next.is_nan() || next <= s || next >= start + total {
                return n + (start + total - s) / (next - s);
            }
            s = next;
            n += 1.0;
        }
    }

    /// Path length of joint 0: the middle of the wrap on pulley 0 [m].
    pub fn anchor_m(&self) -> f64 {
        0.5 * (self.starts_m[0] + self.starts_m[1])
    }

    /// Path lengths of `links` joints at chords of `pitch_m`, joint 0 at [`Route::anchor_m`]. The second value is the
    /// distance by which the joint after the last one overshoots joint 0 [m] (zero if the loop closes).
    pub fn joints_m(&self, links: usize, pitch_m: f64) -> (Vec<f64>, f64) {
        let mut joints = Vec::with_capacity(links);
        let mut s = self.anchor_m();
        for _ in 0..links {
            joints.push(s);
            s = self.next_joint_m(s, pitch_m);
        }
        (joints, s - self.anchor_m() - self.length_m())
    }

    /// Angle (from +x) at the centre of sprocket `k` of a joint at path length `s_m`.
    pub fn angle_about(&self, k: usize, s_m: f64) -> f64 {
        let d = self.at(s_m).0 - self.wrap(k).centre;
        wrap_angle(atan2(d.y, d.x))
    }
}

/// The pulleys around which a taut chain bends: without optional ones around which it would turn the wrong way.
fn taut_pulleys(pulleys: &[Pulley]) -> Vec<usize> {
    let mut kept: Vec<usize> = (0..pulleys.len()).collect();
    loop {
        let n = kept.len();
        let at = |i: usize| &pulleys[kept[i % n]];
        let span = |i: usize| common_tangent(at(i), at(i + 1)).map(|s| s.direction);
        // Sine of the bend angle around the pulley; without a tangent to a neighbour, one of the two lies inside the
        // other.
        let bend = |i: usize| match (span(i + n - 1), span(i)) {
            (Some(arrive), Some(leave)) => cross(arrive, leave) * at(i).wrap.sign(),
            _ => f64::NEG_INFINITY,
        };
        let loose = (0..n).filter(|i| at(*i).is_optional).map(|i| (i, bend(i))).filter(|(_, bend)| *bend <= MIN_BEND);
        match loose.min_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((i, _)) if n > 2 => kept.remove(i),
            _ => return kept,
        };
    }
}

/// The straight stretch from `a` to `b`; None if one lies inside the other. Touching arcs have a stretch of zero
/// length.
fn common_tangent(a: &Pulley, b: &Pulley) -> Option<Span> {
    let d = b.centre - a.centre;
    // Concentric circles have no tangent.
    if d.norm() < SAME_CENTRE_M {
        return None;
    }
    let offset_m = b.wrap.sign() * b.pitch_radius_m - a.wrap.sign() * a.pitch_radius_m;
    let length2 = d.norm_squared() - offset_m * offset_m;
    let touching = a.is_optional && b.is_optional && length2.abs() <= TOUCHING_TOLERANCE * d.norm_squared();
    if !touching && (length2.is_nan() || length2 <= 0.0) {
        return None;
    }
    let length_m = if touching { 0.0 } else { libm::sqrt(length2) };
    // The direction u with d.u = length and d.perp(u) = offset_m.
    let direction = (d * length_m - perp(d) * offset_m) / d.norm_squared();
    let start = a.centre - perp(direction) * (a.wrap.sign() * a.pitch_radius_m);
    Some(Span { start, direction, length_m })
}

/// Minimum sine of the angle by which a chain bends around an arc.
const MIN_BEND: f64 = 1e-8;
/// Centres that are nearer than this are equal [m].
const SAME_CENTRE_M: f64 = 1e-9;
/// Fraction of the squared distance of two centres below which the squared tangent length counts as zero.
const TOUCHING_TOLERANCE: f64 = 1e-9;

/// Finds a parameter, a shift [m] or an angle [rad], at which `links` chords of `pitch_m` close the loop. `placed`
/// gives the pulleys for a parameter value, `slope_m` an estimate of the derivative of the path length. Returns the
/// parameter and the route.
pub fn close_loop(
    placed: impl Fn(f64) -> Vec<Pulley>,
    slope_m: f64,
    links: usize,
    pitch_m: f64,
) -> Result<(f64, Route), RouteError> {
    let at = |shift: f64| -> Result<(f64, Route), RouteError> {
        let route = Route::new(&placed(shift))?;
        let overshoot = route.joints_m(links, pitch_m).1;
        Ok((overshoot, route))
    };
    let (mut excess, mut route) = at(0.0)?;
    let first_fit = route.links_that_fit(pitch_m);
    let longer_m = excess;
    let mut shift = 0.0;
    let mut slope = -slope_m;
    for _ in 0..60 {
        if excess.abs() < 1e-15 {
            return Ok((shift, route));
        }
        let next = shift - excess / slope;
        let Ok((next_excess, next_route)) = at(next) else { break };
        let measured = (next_excess - excess) / (next - shift);
        if measured < -0.025 * slope_m {
            slope = measured;
        }
        let done = (next - shift).abs() < 1e-16;
        (shift, excess, route) = (next, next_excess, next_route);
        if done || excess.abs() < 1e-14 {
            return Ok((shift, route));
        }
    }
    let even = 2 * (0.5 * first_fit).round() as usize;
    Err(RouteError::Open { links, fits: vec![even.saturating_sub(2), even, even + 2], longer_m })
}
