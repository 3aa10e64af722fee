//! Frames of bodies in the plane: what coordinates carry.
//!
//! ```text
//! origin = o + sum d_k q_k        angle = q_turn, or zero
//! ```
//! The map is linear and constant, so a force F at a point p of the body goes back to the coordinates by its transpose:
//! Q_k = F . d_k, Q_turn = (p - origin) x F, and the power at the body is the power at its coordinates. What the body adds to the inverse
//! effective mass of a contact with normal n at p is sum (n . d_k)^2 / m_k + ((p - origin) x n)^2 / I.

use super::coordinate::Coordinate;
use crate::geometry::Vec2;

/// A coordinate that shifts the frame: every metre of it moves the origin by `direction`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// Index into the coordinates of the model.
    pub coordinate: usize,
    /// Unit vector in the world.
    pub direction: Vec2,
}

/// Frame of a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyFrame {
    /// Where its origin is while all coordinates that shift it are zero [m].
    pub origin: Vec2,
    /// The coordinate that it turns by; None: its angle is zero.
    pub turn: Option<usize>,
    /// What shifts its origin.
    pub shifts: Vec<Shift>,
}

/// Columns of all coordinates of a State, as a frame reads them.
#[derive(Clone, Copy)]
pub struct CoordinateColumns<'a> {
    /// Angles and ways at the node [rad, m], cosines and sines of the angles.
    pub at: &'a [f64],
    pub cos: &'a [f64],
    pub sin: &'a [f64],
    /// Half a step before the node [rad/s, m/s]; one step before it [rad/s2, m/s2].
    pub speed: &'a [f64],
    pub acceleration: &'a [f64],
    pub step_s: f64,
}

/// Where a frame stands at a node, and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameMotion {
    /// [m], [m/s], and one step before [m/s2].
    pub origin: Vec2,
    pub velocity: Vec2,
    pub acceleration: Vec2,
    /// Cosine and sine of its angle.
    pub cos: f64,
    pub sin: f64,
    /// [rad/s], and one step before [rad/s2].
    pub omega: f64,
    pub alpha: f64,
}

/// How a body gives way to a force.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyMobility {
    /// Inverse inertia of what it turns by [1/(kg m2)].
    pub inverse_inertia: f64,
    /// Inverse mass of what shifts it, as a symmetric matrix: xx, xy, yy [1/kg].
    pub inverse_mass: [f64; 3],
}

impl BodyFrame {
    /// A frame that turns about a fixed point.
    pub fn turning(origin: Vec2, coordinate: usize) -> BodyFrame {
        BodyFrame { origin, turn: Some(coordinate), shifts: Vec::new() }
    }

    /// Its origin with the coordinates at these values [m].
    pub fn origin_at(&self, at: &[f64]) -> Vec2 {
        self.shifts.iter().fold(self.origin, |origin, s| origin + s.direction * at[s.coordinate])
    }

    /// Its angle with the coordinates at these values [rad].
    pub fn angle_at(&self, at: &[f64]) -> f64 {
        self.turn.map_or(0.0, |k| at[k])
    }

    /// Its motion at the node.
    #[inline(always)]
    pub fn motion(&self, c: &CoordinateColumns<'_>) -> FrameMotion {
        let half_step = 0.5 * c.step_s;
        let speed = |k: usize| c.speed[k] + half_step * c.acceleration[k];
        let (cos, sin, omega, alpha) =
            self.turn.map_or((1.0, 0.0, 0.0, 0.0), |k| (c.cos[k], c.sin[k], speed(k), c.acceleration[k]));
        let mut motion = FrameMotion::turning(self.origin, (cos, sin), omega, alpha);
        for s in &self.shifts {
            motion.origin += s.direction * c.at[s.coordinate];
            motion.velocity += s.direction * speed(s.coordinate);
            motion.acceleration += s.direction * c.acceleration[s.coordinate];
        }
        motion
    }

    /// How it gives way.
    pub fn mobility(&self, coordinates: &[Coordinate]) -> BodyMobility {
        let mut mobility = BodyMobility {
            inverse_inertia: self.turn.map_or(0.0, |k| coordinates[k].inverse_inertia()),
            inverse_mass: [0.0; 3],
        };
        for s in &self.shifts {
            let (d, w) = (s.direction, coordinates[s.coordinate].inverse_inertia());
            for (sum, share) in mobility.inverse_mass.iter_mut().zip([d.x * d.x, d.x * d.y, d.y * d.y]) {
                *sum += w * share;
            }
        }
        mobility
    }

    /// Gives a force on the body [N] and its torque about the origin [N m] to the coordinates.
    #[inline(always)]
    pub fn give_back(&self, force: Vec2, torque: f64, forces: &mut [f64]) {
        if let Some(k) = self.turn {
            forces[k] += torque;
        }
        for s in &self.shifts {
            forces[s.coordinate] += force.dot(&s.direction);
        }
    }
}

impl FrameMotion {
    /// Motion of a frame that turns about a fixed point.
    #[inline(always)]
    pub fn turning(origin: Vec2, (cos, sin): (f64, f64), omega: f64, alpha: f64) -> FrameMotion {
        FrameMotion { origin, velocity: Vec2::zeros(), acceleration: Vec2::zeros(), cos, sin, omega, alpha }
    }
}

impl BodyMobility {
    /// Share of the inverse effective mass along the unit vector `n` by shifting [1/kg].
    #[inline(always)]
    pub fn along(&self, nx: f64, ny: f64) -> f64 {
        let [xx, xy, yy] = self.inverse_mass;
        xx * nx * nx + 2.0 * xy * nx * ny + yy * ny * ny
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::coordinate::{CoordinateKind, CoordinateMotion, CoordinateSpring};

    /// The power of a force at a point of a frame that turns and slides in two oblique directions is that of its coordinates, and the
    /// acceleration of that point by a unit force is the inverse mass that the frame tells.
    #[test]
    fn power_and_inverse_mass_are_those_of_the_coordinates() {
        let free = |inertia: f64, kind| Coordinate {
            path: String::new(),
            kind,
            motion: CoordinateMotion::Free { inertia, load: 0.0 },
            spring: CoordinateSpring::default(),
            nominal_speed_rad_s: 0.0,
            reach_m: 1.0,
            rest_load: 0.0,
            is_held_at_rest: false,
            is_run_in: true,
        };
        let coordinates =
            [free(2e-3, CoordinateKind::Turns), free(0.7, CoordinateKind::Slides), free(1.9, CoordinateKind::Slides)];
        let (along, across) = (Vec2::new(0.6, 0.8), Vec2::new(0.28, -0.96));
        let frame = BodyFrame {
            origin: Vec2::new(0.1, -0.2),
            turn: Some(0),
            shifts: vec![Shift { coordinate: 1, direction: along }, Shift { coordinate: 2, direction: across }],
        };
        let (at, speed, acceleration) = ([0.4, 1e-3, -2e-3], [30.0, 0.5, -0.2], [100.0, 3.0, 5.0]);
        let turn = crate::geometry::unit(at[0]);
        let columns = CoordinateColumns {
            at: &at,
            cos: &[turn.x, 1.0, 1.0],
            sin: &[turn.y, 0.0, 0.0],
            speed: &speed,
            acceleration: &acceleration,
            step_s: 0.0,
        };
        let motion = frame.motion(&columns);
        assert!((motion.origin - frame.origin_at(&at)).norm() == 0.0 && frame.angle_at(&at) == 0.4);
        let (force, arm) = (Vec2::new(50.0, -20.0), Vec2::new(0.03, 0.05));
        let velocity = motion.velocity + Vec2::new(-arm.y, arm.x) * motion.omega;
        let mut back = [0.0; 3];
        frame.give_back(force, arm.x * force.y - arm.y * force.x, &mut back);
        let power: f64 = back.iter().zip(speed).map(|(q, v)| q * v).sum();
        assert!((power - force.dot(&velocity)).abs() < 1e-12 * power.abs(), "{power}");
        // Acceleration of the point along a unit force there.
        let n = force.normalize();
        let mut unit = [0.0; 3];
        let torque = arm.x * n.y - arm.y * n.x;
        frame.give_back(n, torque, &mut unit);
        let shift: Vec<f64> = unit.iter().zip(&coordinates).map(|(q, c)| q * c.inverse_inertia()).collect();
        let moved = along * shift[1] + across * shift[2] + Vec2::new(-arm.y, arm.x) * shift[0];
        let mobility = frame.mobility(&coordinates);
        let told = mobility.along(n.x, n.y) + mobility.inverse_inertia * torque * torque;
        assert!((moved.dot(&n) - told).abs() < 1e-12 * told, "{told}");
    }
}
