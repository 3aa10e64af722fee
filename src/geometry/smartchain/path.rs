//! The exact path of a chain joint from a straight span onto the pitch circle, within one link ("n = 1"); over two links
//! ("n = 2") see `two_link`.
//!
//! Approach frame: sprocket axis at the origin, +y up, the chain arrives along +x on top, the sprocket turns clockwise.
//! Time is measured in pitches: tau = t / T with T = 2 pi / (z w), so that the chain advances by p and the sprocket by
//! w T = 2 pi / z per unit of tau, and velocities and accelerations are per tau and tau^2 [m].
//!
//! ```text
//! line    tau <= 0       gamma = (L.x + p tau, h)
//! dyad    0 <= tau <= 1  gamma = apex over A = gamma(tau - 1) and C = gamma(tau + 1), both one pitch away
//! circle  tau >= 1       gamma = R (sin psi, cos psi),  psi = psi0 + (tau - 1) 2 pi / z
//! ```
//! The link at hand-over (tau = 1) is inclined by phi and must pass through the pitch point (0, r_v), like a rack on
//! its wheel: with R = p / (2 sin(pi/z)), r_v = z p / (2 pi)
//!
//! ```text
//! s = r_v sin phi + sqrt(R^2 - r_v^2 cos^2 phi)        pitch point to C, sigma = s / p
//! C = (0, r_v) + s (cos phi, -sin phi),   L = (0, r_v) - (p - s) (cos phi, -sin phi),   h = r_v + (p - s) sin phi
//! ```
//! makes the path C1 for any phi. The acceleration is also continuous where 2 sigma^3 - sigma^2 = 1/(4 sin^2(pi/z)) -
//! z^2/(4 pi^2), and then sin phi = (2 pi/z) sigma (1 - sigma). This member has the largest h. With a smaller phi the
//! path rises above the line, with a larger phi the acceleration jumps.
//!
//! Leaving the sprocket is the mirror image x -> -x with time reversed.
//!
//! Source: own derivation from the law of gearing (rack and wheel); it reproduces published data of abutment chains and
//! is not taken from a patent. Rigid links, no clearance.

use super::two_link::{LinkInclination, TwoLinks};
use crate::geometry::sprocket::TEETH_RANGE;
use crate::geometry::{Vec2, cross, perp, rotated};
use crate::units::{DEG, MM, UM, atan2, sin_cos};
use std::f64::consts::PI;

/// Position [m], velocity [m per tau] and acceleration [m per tau^2].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointMotion {
    pub position: Vec2,
    pub velocity: Vec2,
    pub acceleration: Vec2,
}

/// Pitches for which the arithmetic is accurate [m].
pub const PITCH_RANGE_M: std::ops::RangeInclusive<f64> = 1e-9..=1e4;

/// Member of the family of one-link transitions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inclination {
    /// The member with continuous acceleration.
    SmoothAcceleration,
    /// Inclination phi of the link at hand-over [rad]; the acceleration has jumps.
    Given(f64),
}

/// The transition of one sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition {
    pub teeth: u32,
    pub pitch_m: f64,
    /// R, of the circle of seated joints.
    pub pitch_radius_m: f64,
    /// r_v, at which the sprocket is as fast as the chain.
    pub rolling_radius_m: f64,
    /// Share of the link at hand-over beyond the pitch point; for a transition over one link.
    pub sigma: Option<f64>,
    /// phi, downwards in the direction of travel: inclination of the link whose front joint joins the circle.
    pub inclination_rad: f64,
    /// h, height of the straight line of joints above the sprocket axis.
    pub line_height_m: f64,
    /// psi0, from +y to C, clockwise.
    pub handover_angle_rad: f64,
    /// x of L, where a joint leaves the line; negative.
    pub line_end_x_m: f64,
    /// C, where a joint joins the circle.
    pub circle_start: Vec2,
    /// Acceleration is continuous at both ends.
    pub smooth_acceleration: bool,
    /// For a transition over two links: rotation of the first of them.
    pub turning: Option<LinkInclination>,
}

/// Why there is no such transition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TransitionError {
    Teeth(u32),
    /// Outside [`PITCH_RANGE_M`].
    Pitch(f64),
    /// No path with this inclination; the possible range [rad].
    Inclination {
        inclination_rad: f64,
        from_rad: f64,
        to_rad: f64,
    },
    /// No path over two links with the given values; a line above the pitch circle [m], hand-over angle [rad] and end
    /// of the line [m] that work, if any.
    TwoLinks {
        given: TwoLinks,
        works: Option<[f64; 3]>,
    },
}

impl std::fmt::Display for TransitionError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            TransitionError::Teeth(z) => {
                write!(f, "{z} teeth are outside {} ..= {}", TEETH_RANGE.start(), TEETH_RANGE.end())
            }
            TransitionError::Pitch(pitch_m) => write!(
                f,
                "a pitch of {:e} mm is not possible; {:e} to {:e} mm work",
                pitch_m / MM,
                PITCH_RANGE_M.start() / MM,
                PITCH_RANGE_M.end() / MM
            ),
            TransitionError::Inclination { inclination_rad, from_rad, to_rad } => write!(
                f,
                "no link leads from the line to the circle at an inclination of {:.4} deg; more than {:.4} and less than {:.4} deg has one",
                inclination_rad / DEG,
                from_rad / DEG,
                to_rad / DEG
            ),
            TransitionError::TwoLinks { given, works } => {
                write!(f, "two links do not lead smoothly from line to circle")?;
                for (name, value, unit, per) in [
                    ("a line above the pitch circle by", given.rise_m, "um", UM),
                    ("a hand-over at", given.handover_rad, "deg", DEG),
                    ("a line that ends at", given.line_end_m, "mm", MM),
                ] {
                    value.map_or(Ok(()), |v| write!(f, ", with {name} {:.4} {unit}", v / per))?;
                }
                if given.free_rad != [0.0; 3] {
                    write!(f, ", with the free part that is given")?;
                }
                works.map_or(Ok(()), |works| write!(f, "; {} do", parameters_text(works)))
            }
        }
    }
}

/// The three parameters of a path over two links, as text.
pub(super) fn parameters_text(n: [f64; 3]) -> String {
    format!("{:.1} um above the circle, {:.4} deg and an end at {:.4} mm", n[0] / UM, n[1] / DEG, n[2] / MM)
}

impl std::error::Error for TransitionError {}

/// Position and motion of the sprocket as seen from the link whose front joint is at tau.
///
/// Link frame: origin midway between the joints, +x from the rear joint to the front joint, +y to the left of a chain
/// that runs counterclockwise, where the sprocket lies. (The approach frame has the sprocket on the right: y is
/// mirrored.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkMotion {
    /// Sprocket axis in the link frame.
    pub axis: PointMotion,
    /// Rotation of the link, with the sprocket, since it was on the line [rad], and its rates per tau and tau^2.
    pub turn_rad: f64,
    pub turn_rate: f64,
    pub turn_acceleration: f64,
}

/// Samples that decide whether the dyad exists over the whole transition.
const DYAD_SAMPLES: u32 = 64;

impl Transition {
    /// The transition for `teeth` and `pitch_m`.
    pub fn new(teeth: u32, pitch_m: f64, inclination: Inclination) -> Result<Transition, TransitionError> {
        if !TEETH_RANGE.contains(&teeth) {
            return Err(TransitionError::Teeth(teeth));
        }
        if !PITCH_RANGE_M.contains(&pitch_m) {
            return Err(TransitionError::Pitch(pitch_m));
        }
        let smooth = smooth_member(teeth);
        match inclination {
            Inclination::SmoothAcceleration => Ok(Transition::member(teeth, pitch_m, smooth)),
            Inclination::Given(phi) => {
                if is_member(teeth, phi) {
                    return Ok(Transition::member(teeth, pitch_m, phi));
                }
                let edge = |outside: f64| boundary(smooth, outside, |x| is_member(teeth, x));
                Err(TransitionError::Inclination { inclination_rad: phi, from_rad: edge(0.0), to_rad: edge(0.5 * PI) })
            }
        }
    }

    /// The member with continuous acceleration.
    pub fn smooth(teeth: u32, pitch_m: f64) -> Result<Transition, TransitionError> {
        Transition::new(teeth, pitch_m, Inclination::SmoothAcceleration)
    }

    /// The member of inclination `phi`, unchecked.
    fn member(teeth: u32, pitch_m: f64, phi: f64) -> Transition {
        let z = f64::from(teeth);
        let pitch_radius_m = pitch_m / (2.0 * sin_cos(PI / z).0);
        let rolling_radius_m = z * pitch_m / (2.0 * PI);
        let (sin, cos) = sin_cos(phi);
        let s = rolling_radius_m * sin + libm::sqrt(pitch_radius_m.powi(2) - (rolling_radius_m * cos).powi(2));
        let circle_start = Vec2::new(s * cos, rolling_radius_m - s * sin);
        Transition {
            teeth,
            pitch_m,
            pitch_radius_m,
            rolling_radius_m,
            sigma: Some(s / pitch_m),
            inclination_rad: phi,
            line_height_m: rolling_radius_m + (pitch_m - s) * sin,
            handover_angle_rad: atan2(circle_start.x, circle_start.y),
            line_end_x_m: -(pitch_m - s) * cos,
            circle_start,
            smooth_acceleration: (phi - smooth_member(teeth)).abs() < SMOOTH_WITHIN_RAD,
            turning: None,
        }
    }

    /// Number n of links, and of units of tau, from the line to the circle.
    pub fn span(&self) -> f64 {
        if self.turning.is_some() { 2.0 } else { 1.0 }
    }

    /// Angle between seats, by which the sprocket turns per tau [rad].
    pub fn seat_angle_rad(&self) -> f64 {
        2.0 * PI / f64::from(self.teeth)
    }

    /// Motion of the joint at `tau` on its way in. Where two pieces meet, the straight line and the circle take
    /// precedence.
    pub fn pin(&self, tau: f64) -> PointMotion {
        if tau <= 0.0 {
            self.pin_on_line(tau)
        } else if tau >= self.span() {
            self.pin_on_circle(tau)
        } else {
            self.pin_in_transition(tau)
        }
    }

    pub(super) fn pin_on_line(&self, tau: f64) -> PointMotion {
        PointMotion {
            position: Vec2::new(self.line_end_x_m + self.pitch_m * tau, self.line_height_m),
            velocity: Vec2::new(self.pitch_m, 0.0),
            acceleration: Vec2::zeros(),
        }
    }

    pub(super) fn pin_on_circle(&self, tau: f64) -> PointMotion {
        let w = self.seat_angle_rad();
        circle_motion(self.pitch_radius_m, self.seat_angle_at_rad(tau), w)
    }

    /// Angle of the joint's seat at `tau`, from +y, clockwise [rad].
    pub fn seat_angle_at_rad(&self, tau: f64) -> f64 {
        self.handover_angle_rad + (tau - self.span()) * self.seat_angle_rad()
    }

    /// Motion between line and circle, for tau in 0 ..= n: limits from within at both ends.
    pub fn pin_in_transition(&self, tau: f64) -> PointMotion {
        match &self.turning {
            None => apex(&self.pin_on_line(tau - 1.0), &self.pin_on_circle(tau + 1.0), self.pitch_m),
            Some(turning) if tau <= 1.0 => turning.front_joint_motion(&self.pin_on_line(tau - 1.0), tau, self.pitch_m),
            Some(_) => apex(&self.pin_in_transition(tau - 1.0), &self.pin_on_circle(tau + 1.0), self.pitch_m),
        }
    }

    /// Rear and front joint of the link whose front joint is at `tau`.
    pub fn joints(&self, tau: f64) -> (PointMotion, PointMotion) {
        (self.pin(tau - 1.0), self.pin(tau))
    }

    /// The sprocket as seen from the link whose front joint is at `tau`.
    pub fn link(&self, tau: f64) -> LinkMotion {
        let (rear, front) = self.joints(tau);
        self.link_between(rear, front)
    }

    /// The same for the lever, the link guided by its front abutment: tau in 0 ..= n, limits from within at both ends.
    pub fn lever(&self, tau: f64) -> LinkMotion {
        let rear = if tau <= 1.0 { self.pin_on_line(tau - 1.0) } else { self.pin_in_transition(tau - 1.0) };
        self.link_between(rear, self.pin_in_transition(tau))
    }

    fn link_between(&self, rear: PointMotion, front: PointMotion) -> LinkMotion {
        // Mirrored, so that the sprocket lies on the left of the chain.
        let mirror = |v: Vec2| Vec2::new(v.x, -v.y);
        let along = mirror(front.position - rear.position) / self.pitch_m;
        let along1 = mirror(front.velocity - rear.velocity) / self.pitch_m;
        let along2 = mirror(front.acceleration - rear.acceleration) / self.pitch_m;
        let turn_rate = cross(along, along1);
        let turn_acceleration = cross(along, along2);
        let into = |v: Vec2| Vec2::new(along.dot(&v), cross(along, v));
        let middle = into(mirror(rear.position + front.position) * 0.5);
        let middle1 = into(mirror(rear.velocity + front.velocity) * 0.5);
        let middle2 = into(mirror(rear.acceleration + front.acceleration) * 0.5);
        let position = -middle;
        let velocity = -middle1 - perp(position) * turn_rate;
        let acceleration = -middle2 - perp(position) * turn_acceleration - perp(velocity) * (2.0 * turn_rate)
            + position * turn_rate.powi(2);
        LinkMotion {
            axis: PointMotion { position, velocity, acceleration },
            turn_rad: atan2(along.y, along.x),
            turn_rate,
            turn_acceleration,
        }
    }

    /// Curvature of the path of the sprocket's axis in the frame of the lever [1/m]: 1 / (rho + radius of the
    /// abutment).
    pub fn axis_curvature_per_m(&self, tau: f64) -> f64 {
        let axis = self.lever(tau).axis;
        cross(axis.velocity, axis.acceleration) / axis.velocity.norm().powi(3)
    }

    /// The smallest and the largest of these curvatures, at `places` points per link.
    pub fn curvature_range(&self, places: u32) -> (f64, f64) {
        let last = places * self.span() as u32;
        (0..=last)
            .map(|k| self.axis_curvature_per_m(f64::from(k) / f64::from(places)))
            // NaN makes the range infinite in both directions.
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| {
                if c.is_nan() { (f64::NEG_INFINITY, f64::INFINITY) } else { (low.min(c), high.max(c)) }
            })
    }

    /// Contact force of the ring on the lever whose front joint is at tau, in 0 ..= n [N], and force of the guide on
    /// the rear joint of the lever that ends on the line [N], for `tension_n` in the straight span and massless links
    /// without friction.
    ///
    /// The seated link ahead takes only a force along itself, because its own ring contact force points at its seated
    /// joint. Moment balances about the joint between two links then give the forces one after another. The radius
    /// cancels, because forces of the ring point away from the axis.
    pub fn quasi_static_forces_n(&self, tension_n: f64, tau: f64) -> (f64, f64) {
        // tau of the front joint of the lever that ends on the line.
        let first_tau = if tau <= 1.0 { tau } else { tau - 1.0 };
        let rear = self.pin_on_line(first_tau - 1.0).position;
        let joint = self.pin_in_transition(first_tau).position;
        let out = self.push(first_tau);
        // Per newton of tension in the seated link: its force, and the ring's force on a second lever.
        let (ahead, second, second_share) = if self.turning.is_none() {
            ((self.pin_on_circle(first_tau + 1.0).position - joint) / self.pitch_m, Vec2::zeros(), 0.0)
        } else {
            let front = self.pin_in_transition(first_tau + 1.0).position;
            let along = (self.pin_on_circle(first_tau + 2.0).position - front) / self.pitch_m;
            let out = self.push(first_tau + 1.0);
            // Moments about the joint between the levers: cross(front - joint, along) + ring cross(-joint, out) = 0.
            let share = cross(front - joint, along) / cross(joint, out);
            (along, out * share, share)
        };
        // -tension + ring out.x + pull (ahead + second).x = 0, and moments about the rear joint of the first lever.
        let taken = ahead + second;
        let (pull_arm, ring_arm) = (cross(joint - rear, taken), cross(-rear, out));
        let ring_n = tension_n * pull_arm / (pull_arm * out.x - ring_arm * taken.x);
        let pull_n = (tension_n - ring_n * out.x) / taken.x;
        let guide_n = -(pull_n * taken.y + ring_n * out.y);
        (if tau <= 1.0 { ring_n } else { pull_n * second_share }, guide_n)
    }

    /// Direction of the ring's force on the lever whose front joint is at tau.
    fn push(&self, tau: f64) -> Vec2 {
        let lever = self.lever(tau);
        // From the ring into the link, normal to the path of the axis in the link frame; then transformed to the
        // approach frame.
        let push = rotated(perp(lever.axis.velocity.normalize()), lever.turn_rad);
        Vec2::new(push.x, -push.y)
    }
}

/// The joint one pitch away from both `a` and `c`, above them.
pub(super) fn apex(a: &PointMotion, c: &PointMotion, pitch_m: f64) -> PointMotion {
    // gamma = (A + C)/2 + g perp(D), D = C - A, g^2 = p^2/|D|^2 - 1/4.
    let (d, d1, d2) = (c.position - a.position, c.velocity - a.velocity, c.acceleration - a.acceleration);
    let square = d.norm_squared();
    let square1 = 2.0 * d.dot(&d1);
    let square2 = 2.0 * (d1.norm_squared() + d.dot(&d2));
    let pitch2 = pitch_m.powi(2);
    let q1 = -pitch2 * square1 / square.powi(2);
    let q2 = pitch2 * (2.0 * square1.powi(2) / square - square2) / square.powi(2);
    let g = libm::sqrt(pitch2 / square - 0.25);
    let g1 = q1 / (2.0 * g);
    let g2 = q2 / (2.0 * g) - q1.powi(2) / (4.0 * g.powi(3));
    PointMotion {
        position: (a.position + c.position) * 0.5 + perp(d) * g,
        velocity: (a.velocity + c.velocity) * 0.5 + perp(d) * g1 + perp(d1) * g,
        acceleration: (a.acceleration + c.acceleration) * 0.5 + perp(d) * g2 + perp(d1) * (2.0 * g1) + perp(d2) * g,
    }
}

/// A joint on a pitch circle, clockwise, at `angle_rad` from +y, moving at `rate` [rad per tau].
pub(super) fn circle_motion(radius_m: f64, angle_rad: f64, rate: f64) -> PointMotion {
    let (sin, cos) = sin_cos(angle_rad);
    let position = Vec2::new(sin, cos) * radius_m;
    PointMotion { position, velocity: -perp(position) * rate, acceleration: -position * (rate * rate) }
}

/// Tolerance within which an inclination counts as that of the member with continuous acceleration [rad]: rounding of
/// input.
const SMOOTH_WITHIN_RAD: f64 = 1e-9;

/// Inclination of the member with continuous acceleration [rad].
fn smooth_member(teeth: u32) -> f64 {
    let z = f64::from(teeth);
    let kappa = 0.25 / sin_cos(PI / z).0.powi(2) - (0.5 * z / PI).powi(2);
    // Newton from above the root, where the cubic increases and is convex.
    let mut sigma = 1.0;
    for _ in 0..50 {
        let step = (2.0 * sigma * sigma * sigma - sigma * sigma - kappa) / (6.0 * sigma * sigma - 2.0 * sigma);
        sigma -= step;
        if step.abs() < 1e-16 {
            break;
        }
    }
    libm::asin(2.0 * PI / z * sigma * (1.0 - sigma))
}

/// Whether the path exists: the pitch point lies within the link, and the dyad closes over the whole transition.
fn is_member(teeth: u32, phi: f64) -> bool {
    if !(phi > 0.0 && phi < 0.5 * PI) {
        return false;
    }
    let t = Transition::member(teeth, 1.0, phi);
    t.sigma.is_some_and(|sigma| sigma < 1.0)
        && (0..=DYAD_SAMPLES).all(|k| {
            let tau = f64::from(k) / f64::from(DYAD_SAMPLES);
            (t.pin_on_circle(tau + 1.0).position - t.pin_on_line(tau - 1.0).position).norm() < 2.0
        })
}

/// The last value that `works` between one that works and one that does not.
pub(super) fn boundary(inside: f64, outside: f64, works: impl Fn(f64) -> bool) -> f64 {
    boundary_within(inside, outside, 60, works)
}

/// The same with a given number of bisections.
pub(super) fn boundary_within(inside: f64, outside: f64, bisections: u32, works: impl Fn(f64) -> bool) -> f64 {
    let (mut good, mut bad) = (inside, outside);
    for _ in 0..bisections {
        let middle = 0.5 * (good + bad);
        if works(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    good
}

/// Distance of the axes of two sprockets at which `n_links` close the loop without slack [m].
///
/// ```text
/// N = 2 [S + L1.x + L2.x]/p + sum_j (Theta_j - 2 psi0_j) z_j / (2 pi) + 2 (n1 + n2),   S^2 = c^2 - (h2 - h1)^2,
/// Theta = pi -+ 2 asin((h2 - h1)/c)
/// ```
/// None if the loop is too short for any distance.
pub fn centre_distance_m(first: &Transition, second: &Transition, n_links: u32) -> Option<f64> {
    let pitch = first.pitch_m;
    let height_m = second.line_height_m - first.line_height_m;
    let seats = |t: &Transition, wrap_rad: f64| (wrap_rad - 2.0 * t.handover_angle_rad) / t.seat_angle_rad();
    let links = |c: f64| {
        let span = libm::sqrt((c * c - height_m * height_m).max(0.0)) + first.line_end_x_m + second.line_end_x_m;
        let turn = 2.0 * libm::asin(height_m / c);
        2.0 * span / pitch + seats(first, PI - turn) + seats(second, PI + turn) + 2.0 * (first.span() + second.span())
    };
    let wanted = f64::from(n_links);
    // The straight part must not be negative; a larger distance always takes more links.
    let free = (first.line_end_x_m + second.line_end_x_m).abs();
    let (mut low, mut high) = (libm::sqrt(free * free + height_m * height_m), pitch * wanted);
    if links(low) > wanted || links(high) < wanted {
        return None;
    }
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if links(middle) < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high))
}

/// [`centre_distance_m`] of two sprockets with continuous acceleration.
pub fn centre_distance(teeth: (u32, u32), pitch_m: f64, n_links: u32) -> Result<Option<f64>, TransitionError> {
    let (first, second) = (Transition::smooth(teeth.0, pitch_m)?, Transition::smooth(teeth.1, pitch_m)?);
    Ok(centre_distance_m(&first, &second, n_links))
}
