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
//! Damping and friction take the velocity at the node that the step corrects once; the damping bounds the step.

use super::friction;
use super::tooth_contact::{LANES, blocks, blocks_mut};

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
    pub omega: &'a [f64],
    pub inverse_inertia: &'a [f64],
}

/// Forces of joints 0 .. len into `force_*[1 ..]`, power lost into `power_*` [W]. Vectorises when inlined.
#[inline(always)]
pub fn forces(
    joint: &LinkJoint,
    half_step: f64,
    ends: &JointEnds,
    force_x: &mut [f64],
    force_y: &mut [f64],
    torque: &mut [f64],
    power_damping: &mut [f64],
    power_friction: &mut [f64],
) {
    let n = power_damping.len();
    let count = n / LANES;
    let (k, c) = (joint.stiffness_n_per_m, joint.damping_n_s_per_m);
    let with_clearance = joint.clearance_m > 0.0;
    {
        let (ax, ay) = (blocks(ends.front_x, count), blocks(ends.front_y, count));
        let (avx, avy) = (blocks(ends.front_vx, count), blocks(ends.front_vy, count));
        let (bx, by) = (blocks(&ends.rear_x[1..], count), blocks(&ends.rear_y[1..], count));
        let (bvx, bvy) = (blocks(&ends.rear_vx[1..], count), blocks(&ends.rear_vy[1..], count));
        let (fx, fy) = (blocks_mut(&mut force_x[1..], count), blocks_mut(&mut force_y[1..], count));
        let pd = blocks_mut(power_damping, count);
        for b in 0..count {
            // All is read before anything is written: columns may not overlap, but a compiler cannot know.
            let (ax, ay, avx, avy) = (ax[b], ay[b], avx[b], avy[b]);
            let (bx, by, bvx, bvy) = (bx[b], by[b], bvx[b], bvy[b]);
            let zero = [0.0; LANES];
            let (mut x, mut y, mut lost) = (zero, zero, zero);
            for j in 0..LANES {
                let (ux, uy) = (ax[j] - bx[j], ay[j] - by[j]);
                let (rx, ry) = (avx[j] - bvx[j], avy[j] - bvy[j]);
                if with_clearance {
                    let d2 = ux * ux + uy * uy;
                    let distance = if d2 > 1e-30 { d2 } else { 1e-30 }.sqrt();
                    let (nx, ny) = (ux / distance, uy / distance);
                    let stretch = distance - joint.clearance_m;
                    let rate = rx * nx + ry * ny;
                    let size = k * stretch + c * rate;
                    let pulls = (stretch > 0.0) & (size > 0.0);
                    let size = if pulls { size } else { 0.0 };
                    (x[j], y[j]) = (size * nx, size * ny);
                    lost[j] = if pulls { (size - k * stretch) * rate } else { 0.0 };
                } else {
                    (x[j], y[j]) = (k * ux + c * rx, k * uy + c * ry);
                    lost[j] = c * (rx * rx + ry * ry);
                }
            }
            (fx[b], fy[b], pd[b]) = (x, y, lost);
        }
    }
    if joint.friction_arm_m == 0.0 {
        return;
    }
    let (fx, fy) = (&force_x[1..n + 1], &force_y[1..n + 1]);
    let (m, pf) = (&mut torque[1..n + 1], &mut power_friction[..n]);
    let (w0, w1) = (&ends.omega[..n], &ends.omega[1..n + 1]);
    let (j0, j1) = (&ends.inverse_inertia[..n], &ends.inverse_inertia[1..n + 1]);
    for j in 0..n {
        let size = (fx[j] * fx[j] + fy[j] * fy[j]).sqrt();
        let relative = w1[j] - w0[j];
        let mobility = half_step * (j0[j] + j1[j]);
        m[j] = friction::explicit_force(joint.friction_arm_m, size, relative, joint.stick_speed_rad_s, mobility);
        pf[j] = -m[j] * relative;
    }
}

/// Friction of a joint `j` that turns hard, whatever its force: M = -T clamp(w_rel / w_s, -1, 1), beside that of [`forces`].
/// w_s is at least 2 h T (1/J_j + 1/J_(j+1)), so that the explicit torque does not overshoot: 12 rad/s for 20 N mm, a step of 2.3 us
/// and 8 mm links, and as much more for a joint that is tighter.
pub fn tighten(
    (joint, torque_nm): (&LinkJoint, f64),
    (j, half_step): (usize, f64),
    ends: &JointEnds,
    torque: &mut [f64],
    power_friction: &mut [f64],
) {
    let relative = ends.omega[j + 1] - ends.omega[j];
    let mobility = half_step * (ends.inverse_inertia[j] + ends.inverse_inertia[j + 1]);
    let own = friction::explicit_force(torque_nm, 1.0, relative, joint.stick_speed_rad_s, mobility);
    // Without friction in all joints their column is not written.
    let (m, pf) = if joint.friction_arm_m == 0.0 { (0.0, 0.0) } else { (torque[j + 1], power_friction[j]) };
    torque[j + 1] = m + own;
    power_friction[j] = pf - own * relative;
}
