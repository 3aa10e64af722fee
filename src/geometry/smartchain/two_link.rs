//! The path of a joint from a straight span onto the pitch circle within two links ("n = 2").
//!
//! With two joints in transition the height of the line, the hand-over angle and the end of the line are free, and so
//! is the inclination alpha(tau) of the first link, as long as it meets both neighbours; here it is the quintic that
//! does. Approach frame and time as in `path`:
//!
//! ```text
//! line    tau <= 0       gamma = (L.x + p tau, h)
//! quintic 0 <= tau <= 1  gamma = gamma(tau - 1) + p (cos alpha, -sin alpha),   alpha = tau^3 (c3 + c4 tau + c5 tau^2)
//! dyad    1 <= tau <= 2  gamma = apex over gamma(tau - 1) and gamma(tau + 1)
//! circle  tau >= 2       gamma = R (sin psi, cos psi),   psi = psi0 + (tau - 2) 2 pi / z
//! ```
//! alpha, alpha' and alpha'' at tau = 1 are those of the dyad L, M, C, so that the path is C2 there, and with it at tau
//! = 2.
//!
//! Source: own derivation. Which three numbers are good is not decided here.

use super::path::{Motion, apex, circle_motion};
use crate::geometry::{Vec2, cross};
use crate::units::{atan2, sin_cos};
use std::f64::consts::PI;

/// A transition over two links.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoLinkTransition {
    pub teeth: u32,
    pub pitch_m: f64,
    pub pitch_radius_m: f64,
    /// h, of the line of joints above the axis.
    pub line_height_m: f64,
    /// psi0, from +y to where a joint joins the circle, clockwise.
    pub handover_angle_rad: f64,
    /// x of L, where a joint leaves the line.
    pub line_end_x_m: f64,
    /// c3, c4, c5 of the inclination [rad].
    pub inclination: [f64; 3],
}

impl TwoLinkTransition {
    /// The path through the three numbers; None if the two links do not reach from line to circle.
    pub fn new(
        teeth: u32,
        pitch_m: f64,
        line_height_m: f64,
        handover_angle_rad: f64,
        line_end_x_m: f64,
    ) -> Option<TwoLinkTransition> {
        let pitch_radius_m = pitch_m / (2.0 * sin_cos(PI / f64::from(teeth)).0);
        let mut t = TwoLinkTransition {
            teeth,
            pitch_m,
            pitch_radius_m,
            line_height_m,
            handover_angle_rad,
            line_end_x_m,
            inclination: [0.0; 3],
        };
        let (line, circle) = (t.on_line(0.0), t.on_circle(2.0));
        let m = apex(&line, &circle, pitch_m);
        let along = (m.position - line.position) / pitch_m;
        let alpha = -atan2(along.y, along.x);
        let rate = -cross(along, (m.velocity - line.velocity) / pitch_m);
        let acceleration = -cross(along, (m.acceleration - line.acceleration) / pitch_m);
        // The quintic with three zeros at 0 and these values at 1.
        t.inclination = [
            10.0 * alpha - 4.0 * rate + 0.5 * acceleration,
            -15.0 * alpha + 7.0 * rate - acceleration,
            6.0 * alpha - 3.0 * rate + 0.5 * acceleration,
        ];
        let exists = (0..=SAMPLES).all(|k| {
            let p = t.pin(2.0 * f64::from(k) / f64::from(SAMPLES));
            p.acceleration.norm().is_finite()
        });
        exists.then_some(t)
    }

    /// The joint at `tau`.
    pub fn pin(&self, tau: f64) -> Motion {
        if tau <= 0.0 {
            self.on_line(tau)
        } else if tau <= 1.0 {
            self.on_quintic(tau)
        } else if tau <= 2.0 {
            self.in_dyad(tau)
        } else {
            self.on_circle(tau)
        }
    }

    /// The dyad's apex, tau in 1 ..= 2: limits from within at both ends.
    pub fn in_dyad(&self, tau: f64) -> Motion {
        apex(&self.on_quintic(tau - 1.0), &self.on_circle(tau + 1.0), self.pitch_m)
    }

    /// The joint on the pitch circle.
    pub fn on_circle(&self, tau: f64) -> Motion {
        let w = 2.0 * PI / f64::from(self.teeth);
        circle_motion(self.pitch_radius_m, self.handover_angle_rad + (tau - 2.0) * w, w)
    }

    fn on_line(&self, tau: f64) -> Motion {
        Motion {
            position: Vec2::new(self.line_end_x_m + self.pitch_m * tau, self.line_height_m),
            velocity: Vec2::new(self.pitch_m, 0.0),
            acceleration: Vec2::zeros(),
        }
    }

    /// The front joint of the first link, tau in 0 ..= 1: limits from within at both ends.
    pub fn on_quintic(&self, tau: f64) -> Motion {
        let [c3, c4, c5] = self.inclination;
        let alpha = tau.powi(3) * (c3 + tau * (c4 + tau * c5));
        let rate = tau.powi(2) * (3.0 * c3 + tau * (4.0 * c4 + tau * 5.0 * c5));
        let acceleration = tau * (6.0 * c3 + tau * (12.0 * c4 + tau * 20.0 * c5));
        let (sin, cos) = sin_cos(alpha);
        let (along, down) = (Vec2::new(cos, -sin), Vec2::new(-sin, -cos));
        let rear = self.on_line(tau - 1.0);
        Motion {
            position: rear.position + along * self.pitch_m,
            velocity: rear.velocity + down * (self.pitch_m * rate),
            acceleration: (down * acceleration - along * rate.powi(2)) * self.pitch_m,
        }
    }
}

/// Places where the path is looked for.
const SAMPLES: u32 = 128;
