//! The path of a joint from a straight span onto the pitch circle over two links ("n = 2").
//!
//! With two joints in transition the height of the line, the hand-over angle and the end of the line are free. So is
//! the inclination alpha(tau) of the first link, provided that it matches both neighbours; here it is the quintic that
//! does, plus a free part that vanishes with two derivatives at both ends. Approach frame and time as in `path`:
//!
//! ```text
//! line    tau <= 0       gamma = (L.x + p tau, h)
//! led     0 <= tau <= 1  gamma = gamma(tau - 1) + p (cos alpha, -sin alpha)
//! dyad    1 <= tau <= 2  gamma = apex over gamma(tau - 1) and gamma(tau + 1)
//! circle  tau >= 2       gamma = R (sin psi, cos psi),   psi = psi0 + (tau - 2) 2 pi / z
//!
//! alpha = tau^3 (c3 + c4 tau + c5 tau^2) + tau^3 (1 - tau)^3 (b0 + b1 tau + b2 tau^2)
//! ```
//! alpha, alpha' and alpha'' at tau = 1 are those of the dyad L, M, C, so that the path is C2 there, and with it at tau
//! = 2. Of the three parameters those that are not given are chosen for the smallest peak of jerk among the paths with
//! convex abutments. At 20 teeth that peak is a fifth of the one over one link; the line then ends three quarters of a
//! pitch before the axis, and abutments of links two apart pass each other.
//!
//! Source: own derivation; the search is that of J. A. Nelder and R. Mead, "A simplex method for function minimization",
//! Computer Journal 7 (1965).

use super::path::{PITCH_RANGE_M, PointMotion, Transition, TransitionError, apex};
use crate::geometry::sprocket::TEETH_RANGE;
use crate::geometry::{Vec2, cross};
use crate::units::{DEG, atan2, sin_cos};
use std::f64::consts::PI;

/// Inclination of the first link: alpha = tau^3 times a polynomial with these coefficients [rad].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkInclination([f64; 6]);

/// Free parameters of a transition over two links; those that are not given are optimised.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwoLinks {
    /// Height of the line of joints above the pitch circle, h - R [m].
    pub rise_m: Option<f64>,
    /// psi0, at which a joint joins the circle, from +y [rad].
    pub handover_rad: Option<f64>,
    /// x of the end of the line, negative [m].
    pub line_end_m: Option<f64>,
    /// b0, b1, b2 of the free part of the inclination [rad].
    pub free_rad: [f64; 3],
}

impl LinkInclination {
    /// The inclination that reaches the given value and first two derivatives at tau = 1, plus the free part.
    fn new([alpha, rate, acceleration]: [f64; 3], [b0, b1, b2]: [f64; 3]) -> LinkInclination {
        LinkInclination([
            10.0 * alpha - 4.0 * rate + 0.5 * acceleration + b0,
            -15.0 * alpha + 7.0 * rate - acceleration + b1 - 3.0 * b0,
            6.0 * alpha - 3.0 * rate + 0.5 * acceleration + b2 - 3.0 * b1 + 3.0 * b0,
            -3.0 * b2 + 3.0 * b1 - b0,
            3.0 * b2 - b1,
            -b2,
        ])
    }

    /// Inclination and its first two derivatives.
    fn at(&self, tau: f64) -> [f64; 3] {
        let (mut alpha, mut rate, mut acceleration) = (0.0, 0.0, 0.0);
        for (k, c) in self.0.iter().enumerate().rev() {
            let n = k as f64 + 3.0;
            alpha = alpha * tau + c;
            rate = rate * tau + n * c;
            acceleration = acceleration * tau + n * (n - 1.0) * c;
        }
        [alpha * tau.powi(3), rate * tau.powi(2), acceleration * tau]
    }

    /// The front joint of the first link, whose rear joint is `rear`.
    pub(super) fn front_joint_motion(&self, rear: &PointMotion, tau: f64, pitch_m: f64) -> PointMotion {
        let [alpha, rate, acceleration] = self.at(tau);
        let (sin, cos) = sin_cos(alpha);
        let (along, down) = (Vec2::new(cos, -sin), Vec2::new(-sin, -cos));
        PointMotion {
            position: rear.position + along * pitch_m,
            velocity: rear.velocity + down * (pitch_m * rate),
            acceleration: rear.acceleration + (down * acceleration - along * rate.powi(2)) * pitch_m,
        }
    }
}

impl Transition {
    /// The transition over two links for `teeth` and `pitch_m`.
    pub fn over_two_links(teeth: u32, pitch_m: f64, form: TwoLinks) -> Result<Transition, TransitionError> {
        if !TEETH_RANGE.contains(&teeth) {
            return Err(TransitionError::Teeth(teeth));
        }
        if !PITCH_RANGE_M.contains(&pitch_m) {
            return Err(TransitionError::Pitch(pitch_m));
        }
        let given = [form.rise_m.map(|m| m / pitch_m), form.handover_rad, form.line_end_m.map(|m| m / pitch_m)];
        let numbers = minimum_jerk(teeth, given, form.free_rad);
        let scaled = [numbers[0] * pitch_m, numbers[1], numbers[2] * pitch_m];
        match two_links(teeth, pitch_m, scaled, form.free_rad) {
            Some(t) => Ok(t),
            None => {
                let works = smoothest(teeth, pitch_m).filter(|_| form != TwoLinks::default());
                Err(TransitionError::TwoLinks { given: form, works })
            }
        }
    }

    /// Height of the line of joints above the pitch circle [m].
    pub fn rise_m(&self) -> f64 {
        self.line_height_m - self.pitch_radius_m
    }

    /// Largest jerk over that of the pitch circle, w^3 R, inside the pieces of the path, at 60 points per link.
    pub fn peak_jerk(&self) -> f64 {
        let unit = self.pitch_radius_m * self.seat_angle_rad().powi(3);
        let samples = (JERK_SAMPLES as f64 * self.span()) as u32;
        (0..samples)
            .map(|k| (f64::from(k) + 0.5) / JERK_SAMPLES as f64)
            .map(|tau| {
                self.pin_in_transition(tau + JERK_STEP).acceleration
                    - self.pin_in_transition(tau - JERK_STEP).acceleration
            })
            .map(|difference| difference.norm() / (2.0 * JERK_STEP * unit))
            // Skips NaN.
            .fold(0.0, |most: f64, jerk| if most.is_nan() || jerk <= most { most } else { jerk })
    }
}

/// Line above the pitch circle [m], hand-over angle [rad] and end of the line [m] with the smallest peak of jerk.
pub(super) fn smoothest(teeth: u32, pitch_m: f64) -> Option<[f64; 3]> {
    let [rise, angle, line_end] = minimum_jerk(teeth, [None; 3], [0.0; 3]);
    let numbers = [rise * pitch_m, angle, line_end * pitch_m];
    two_links(teeth, pitch_m, numbers, [0.0; 3]).map(|_| numbers)
}

/// Points per link at which the jerk is evaluated, and half the step of its difference.
const JERK_SAMPLES: usize = 60;
const JERK_STEP: f64 = 1e-4;

/// The path for the three parameters; None if the two links do not reach from line to circle.
fn two_links(teeth: u32, pitch_m: f64, numbers: [f64; 3], free: [f64; 3]) -> Option<Transition> {
    let [rise_m, handover_angle_rad, line_end_x_m] = numbers;
    let pitch_radius_m = pitch_m / (2.0 * sin_cos(PI / f64::from(teeth)).0);
    let (sin, cos) = sin_cos(handover_angle_rad);
    let mut t = Transition {
        teeth,
        pitch_m,
        pitch_radius_m,
        rolling_radius_m: f64::from(teeth) * pitch_m / (2.0 * PI),
        sigma: None,
        inclination_rad: 0.0,
        line_height_m: pitch_radius_m + rise_m,
        handover_angle_rad,
        line_end_x_m,
        circle_start: Vec2::new(sin, cos) * pitch_radius_m,
        smooth_acceleration: true,
        turning: Some(LinkInclination([0.0; 6])),
    };
    let (line, circle) = (t.pin_on_line(0.0), t.pin_on_circle(2.0));
    let middle = apex(&line, &circle, pitch_m);
    let along = (middle.position - line.position) / pitch_m;
    let rate = -cross(along, (middle.velocity - line.velocity) / pitch_m);
    let acceleration = -cross(along, (middle.acceleration - line.acceleration) / pitch_m);
    t.turning = Some(LinkInclination::new([-atan2(along.y, along.x), rate, acceleration], free));
    let ahead = circle.position - middle.position;
    t.inclination_rad = -atan2(ahead.y, ahead.x);
    let exists = (0..=SAMPLES)
        .all(|k| t.pin_in_transition(2.0 * f64::from(k) / f64::from(SAMPLES)).acceleration.norm().is_finite());
    exists.then_some(t)
}

/// Points at which the path is checked.
const SAMPLES: u32 = 128;

/// Start of the search: rise in pitches, hand-over angle, inclination of the first link at tau = 1, each times the
/// number of teeth; near the optimum for 9 to 150.
const START: [f64; 3] = [0.68, 454.0 * DEG, 43.0 * DEG];

/// Steps from the free optimum to the given values.
const WAY: u32 = 8;

/// Rise in pitches, angle and end of the line in pitches: the given ones, and the best values of the others.
fn minimum_jerk(teeth: u32, given: [Option<f64>; 3], free: [f64; 3]) -> [f64; 3] {
    if let [Some(rise), Some(angle), Some(line_end)] = given {
        return [rise, angle, line_end];
    }
    let mut x = search(teeth, [None; 3], [0.0; 3], START.map(|x| x / f64::from(teeth)));
    if given == [None; 3] && free == [0.0; 3] {
        return numbers(teeth, given, x);
    }
    let best = numbers(teeth, [None; 3], x);
    for k in 1..=WAY {
        let share = f64::from(k) / f64::from(WAY);
        let towards = [0, 1, 2].map(|i| given[i].map(|g| best[i] + share * (g - best[i])));
        x = search(teeth, towards, free.map(|b| share * b), x);
    }
    numbers(teeth, given, x)
}

/// The given parameters, and the others from rise, angle and the inclination of the first link at tau = 1. Two links
/// are nearly straight, so that computing the end of the line from the other parameters is better conditioned than the
/// reverse.
fn numbers(teeth: u32, given: [Option<f64>; 3], x: [f64; 3]) -> [f64; 3] {
    let rise = given[0].unwrap_or(x[0]);
    let reach = 0.5 / sin_cos(PI / f64::from(teeth)).0;
    let (sin, cos) = sin_cos(x[2]);
    let middle_y = reach + rise - sin;
    let angle = match (given[1], given[2]) {
        (Some(angle), _) => angle,
        (None, None) => x[1],
        // Where the circle is one pitch away from the middle joint.
        (None, Some(line_end)) => {
            let (middle_x, far) = (line_end + cos, libm::hypot(line_end + cos, middle_y));
            atan2(middle_x, middle_y) + libm::acos((reach * reach + far * far - 1.0) / (2.0 * reach * far))
        }
    };
    let (circle_x, circle_y) = sin_cos(angle);
    let down = middle_y - reach * circle_y;
    let line_end = given[2].unwrap_or(reach * circle_x - libm::sqrt(1.0 - down * down) - cos);
    [rise, angle, line_end]
}

/// Rise, angle and inclination with the smallest peak of jerk, searched from `start`.
fn search(teeth: u32, given: [Option<f64>; 3], free: [f64; 3], start: [f64; 3]) -> [f64; 3] {
    let cost = |x: [f64; 3]| {
        let Some(t) = two_links(teeth, 1.0, numbers(teeth, given, x), free) else { return f64::INFINITY };
        let (low, high) = t.curvature_range(JERK_SAMPLES as u32);
        let out = (0.0 - low * t.pitch_radius_m).max(high * t.pitch_radius_m - 1.0).max(0.0);
        // Hollow or pointed abutments outweigh any jerk.
        if out > CURVATURE_ROOM { INFEASIBLE * (1.0 + out) } else { t.peak_jerk() }
    };
    let searched =
        [given[0].is_none(), given[1].is_none() && given[2].is_none(), given[1].is_none() || given[2].is_none()];
    let again =
        |from: [f64; 3]| simplex(from, [0, 1, 2].map(|k| if searched[k] { 0.02 * start[k] } else { 0.0 }), cost);
    // A second start, in case the simplex has collapsed at an edge of the feasible region.
    again(again(start))
}

/// Excess curvature of an abutment, over that of the pitch circle, that is still accepted; and the cost of a larger
/// one, far beyond any jerk.
const CURVATURE_ROOM: f64 = 1e-7;
const INFEASIBLE: f64 = 1e6;

/// Steps of the search; it has converged after some 150.
const STEPS: u32 = 250;

/// Minimum of `cost` from `start`. Not from a library: `argmin` 0.11 needs random and complex numbers for a plain
/// vector, and a change in its steps would change the bits of drives. Coordinates move by `step` at first; those with a
/// step of zero do not move.
fn simplex(start: [f64; 3], step: [f64; 3], cost: impl Fn([f64; 3]) -> f64) -> [f64; 3] {
    let valued = |x: [f64; 3]| (cost(x), x);
    let free: Vec<usize> = (0..3).filter(|k| step[*k] != 0.0).collect();
    let mut corners = vec![valued(start)];
    for k in &free {
        let mut x = start;
        x[*k] += step[*k];
        corners.push(valued(x));
    }
    let n = free.len();
    for _ in 0..if n == 0 { 0 } else { STEPS } {
        corners.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (best, worst) = (corners[0], corners[n]);
        let middle = [0, 1, 2].map(|k| corners[..n].iter().map(|c| c.1[k]).sum::<f64>() / n as f64);
        let towards = |share: f64| valued([0, 1, 2].map(|k| middle[k] + share * (worst.1[k] - middle[k])));
        let reflected = towards(-1.0);
        let next = if reflected.0 < best.0 {
            let expanded = towards(-2.0);
            Some(if expanded.0 < reflected.0 { expanded } else { reflected })
        } else if reflected.0 < corners[n - 1].0 {
            Some(reflected)
        } else {
            let contracted = if reflected.0 < worst.0 { towards(-0.5) } else { towards(0.5) };
            (contracted.0 < reflected.0.min(worst.0)).then_some(contracted)
        };
        match next {
            Some(corner) => corners[n] = corner,
            None => {
                for corner in &mut corners[1..] {
                    *corner = valued([0, 1, 2].map(|k| best.1[k] + 0.5 * (corner.1[k] - best.1[k])));
                }
            }
        }
    }
    corners.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or(start, |c| c.1)
}
