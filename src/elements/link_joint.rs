//! Pin joints: the elastic connection between two links.
//!
//! u = r_front(link j) - r_rear(link j + 1), the offset of pin and bush centre; the force on link j + 1 is
//! ```text
//! without clearance    F = k u + c u'                        (isotropic, plates and joint in series)
//! with clearance c_r   F = (k (|u| - c_r) + c |u|') u/|u|    where |u| > c_r and the bracket is positive, else 0
//! friction             M = -mu r_pin |F| clamp(w_rel / w_s, -1, 1)
//! ```
//! M acts on link j + 1, w_rel = omega(j + 1) - omega(j). Stored: k/2 u^2, or k/2 (|u| - c_r)^2. Lost: c u'^2 and M w_rel.
//! Source: joint force unit of Schaffner, Sopouch and Priebsch (section 3.1) and of Fritz et al. (fig. 2), linear here.
//! Damping and friction take the mean velocity about the node, which the step finds by evaluating the joints a second time; the damping bounds the step.

use super::friction;
use crate::lanes::{LANES, LaneBlock, blocks};

/// Constants of all joints of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkJoint {
    pub stiffness_n_per_m: f64,
    pub damping_n_s_per_m: f64,
    pub clearance_m: f64,
    /// mu r_pin [m]: friction torque per joint force.
    pub friction_arm_m: f64,
    /// Relative speed below which friction falls to zero [rad/s].
    pub stick_speed_rad_s: f64,
}

/// Force of one joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointForce {
    /// On link j + 1 [N].
    pub x: f64,
    pub y: f64,
    /// Energy stored [J].
    pub stored: f64,
}

impl LinkJoint {
    /// Force from the offset (ux, uy) [m] and its rate [m/s]; elastic part only when the rate is zero.
    pub fn force(&self, ux: f64, uy: f64, rate_x: f64, rate_y: f64) -> JointForce {
        let (k, c) = (self.stiffness_n_per_m, self.damping_n_s_per_m);
        if self.clearance_m == 0.0 {
            return JointForce {
                x: k * ux + c * rate_x,
                y: k * uy + c * rate_y,
                stored: 0.5 * k * (ux * ux + uy * uy),
            };
        }
        let distance = libm::sqrt(ux * ux + uy * uy);
        let stretch = distance - self.clearance_m;
        if stretch <= 0.0 {
            return JointForce::default();
        }
        let (nx, ny) = (ux / distance, uy / distance);
        let size = (k * stretch + c * (rate_x * nx + rate_y * ny)).max(0.0);
        JointForce { x: size * nx, y: size * ny, stored: 0.5 * k * stretch * stretch }
    }
}

/// Ends of the links as the joints see them; rear arrays hold one more value, the first link's again.
pub struct JointEnds<'a> {
    pub front_x: &'a [f64],
    pub front_y: &'a [f64],
    pub front_vx: &'a [f64],
    pub front_vy: &'a [f64],
    pub rear_x: &'a [f64],
    pub rear_y: &'a [f64],
    pub rear_vx: &'a [f64],
    pub rear_vy: &'a [f64],
}

/// Forces of a block of joints on the links behind them [N], and the power they lose to damping [W].
#[derive(Clone, Copy, Debug)]
pub struct JointBlock {
    pub x: LaneBlock,
    pub y: LaneBlock,
    pub lost: LaneBlock,
}

impl<'a> JointEnds<'a> {
    /// x, y, vx, vy of front ends, and of rear ends.
    pub fn new(front: [&'a [f64]; 4], rear: [&'a [f64]; 4]) -> Self {
        let ([front_x, front_y, front_vx, front_vy], [rear_x, rear_y, rear_vx, rear_vy]) = (front, rear);
        JointEnds { front_x, front_y, front_vx, front_vy, rear_x, rear_y, rear_vx, rear_vy }
    }

    /// Forces of the joints `at * LANES` and on. Vectorises when inlined.
    #[inline(always)]
    pub fn block(&self, joint: &LinkJoint, at: usize, count: usize) -> JointBlock {
        let own = |column: &[f64]| blocks(column, count)[at];
        let next = |column: &[f64]| blocks(&column[1..], count)[at];
        let (ax, ay, avx, avy) = (own(self.front_x), own(self.front_y), own(self.front_vx), own(self.front_vy));
        let (bx, by, bvx, bvy) = (next(self.rear_x), next(self.rear_y), next(self.rear_vx), next(self.rear_vy));
        let zero = [0.0; LANES];
        let (mut x, mut y, mut lost) = (zero, zero, zero);
        // One loop each: in one, both would be computed for every lane.
        if joint.clearance_m > 0.0 {
            for j in 0..LANES {
                let (rx, ry) = (avx[j] - bvx[j], avy[j] - bvy[j]);
                (x[j], y[j], lost[j]) = joint.beyond_clearance(ax[j] - bx[j], ay[j] - by[j], rx, ry);
            }
        } else {
            for j in 0..LANES {
                let (rx, ry) = (avx[j] - bvx[j], avy[j] - bvy[j]);
                (x[j], y[j], lost[j]) = joint.without_clearance(ax[j] - bx[j], ay[j] - by[j], rx, ry);
            }
        }
        JointBlock { x, y, lost }
    }
}

impl LinkJoint {
    /// Force [N] and power lost to damping [W] from offset and rate: k u + c u' and c u'^2, written as differences: of sums, the compiler swaps the terms of some lanes, and shuffles them back.
    #[inline(always)]
    fn without_clearance(&self, ux: f64, uy: f64, rx: f64, ry: f64) -> (f64, f64, f64) {
        let (k, c) = (self.stiffness_n_per_m, self.damping_n_s_per_m);
        let minus = 0.0 - c;
        (k * ux - minus * rx, k * uy - minus * ry, c * (rx * rx - ry * (0.0 - ry)))
    }

    #[inline(always)]
    fn beyond_clearance(&self, ux: f64, uy: f64, rx: f64, ry: f64) -> (f64, f64, f64) {
        let (k, c) = (self.stiffness_n_per_m, self.damping_n_s_per_m);
        let d2 = ux * ux + uy * uy;
        let distance = if d2 > 1e-30 { d2 } else { 1e-30 }.sqrt();
        let (nx, ny) = (ux / distance, uy / distance);
        let stretch = distance - self.clearance_m;
        let rate = rx * nx + ry * ny;
        let size = k * stretch + c * rate;
        let pulls = (stretch > 0.0) & (size > 0.0);
        let size = if pulls { size } else { 0.0 };
        (size * nx, size * ny, if pulls { (size - k * stretch) * rate } else { 0.0 })
    }
}

/// Friction of a joint that turns hard, whatever its force: M = -T clamp(w_rel / w_s, -1, 1), beside its other friction.
/// w_s is at least h T (1/J_j + 1/J_(j+1)), so that the explicit torque does not overshoot: 2.5 rad/s for 20 N mm, a step of 3.7 us
/// and 8 mm links, and as much more for a joint that is tighter.
#[inline(always)]
pub fn tightened(joint: &LinkJoint, torque_nm: f64, relative: f64, half_step_mobility: f64) -> f64 {
    friction::explicit_force(torque_nm, 1.0, relative, joint.stick_speed_rad_s, half_step_mobility)
}
