//! Mass, moment of inertia and pitch of every link, from the balance of forces and moments on it.
//!
//! ```text
//! m a = sum F
//! J alpha = a_front (-F_front x e) + a_rear (F_rear x -e) + friction of both joints + moments of contacts and rollers
//! ```
//! with e the heading, x the plane cross product e x F. m, J and the two arms are the unknowns; the pitch is a_front + a_rear: the distance
//! of the lines along which the joints' forces act. Forces and accelerations of a frame are means over the same step, so that what is left
//! is rounding. A share of the forces has to be across the link: on its way over a sprocket, or by its own swing.
//!
//! The same arms give the stretch of every joint, u = front end of link j - rear end of the link ahead, and with it
//! ```text
//! u . n = |F| / k + c_r - (c / k) (u' . n),  n = F / |F|      stiffness k, clearance c_r, damping c
//! -M sign(w_rel) = mu r |F| + T                               friction arm mu r and torque T, while the joint turns fast
//! ```

use super::least_squares::NormalEquations;
use super::{Estimate, Topology};
use crate::recording::frame::{Feature, Frame};
use crate::statistics::median;

/// A joint pulls by more than this share of its largest force where its stretch is read: below, damping decides.
const PULLED: f64 = 0.02;
/// A joint turns fast where its relative speed exceeds this share of the fastest sprocket's speed, with which joints bend onto it: its friction
/// has its full size there. assumed: joints bend within a third of a pitch. Where nothing turns but links, of what most joints reach.
const TURNING: f64 = 0.3;

/// Sums over the balance of one link.
#[derive(Clone, Copy, Debug, Default)]
struct LinkBalance {
    mass: NormalEquations<1>,
    turning: NormalEquations<3>,
}

/// What the balance of a link gives; None where its frames do not tell.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkFit {
    pub mass_kg: Option<Estimate>,
    pub inertia_kg_m2: Option<Estimate>,
    pub front_arm_m: Option<Estimate>,
    pub rear_arm_m: Option<Estimate>,
}

impl LinkFit {
    pub fn pitch_m(&self) -> Option<Estimate> {
        let (front, rear) = (self.front_arm_m?, self.rear_arm_m?);
        Some(Estimate { value: front.value + rear.value, error: front.error + rear.error, samples: front.samples })
    }
}

/// Sums over the balance of all links, and the largest force and relative speed of joints.
#[derive(Clone, Debug)]
pub struct LinkSums {
    links: Vec<LinkBalance>,
    pub largest_force_n: f64,
    /// Fastest relative turning of each joint [rad/s].
    fastest_rad_s: Vec<f64>,
    /// Fastest turning of a shaft or sprocket [rad/s].
    rotor_rad_s: f64,
    moments: Vec<f64>,
    forces: Vec<[f64; 2]>,
    /// Forces of rollers on each link, at its front joint and at its rear one [N].
    at_joints: Vec<[[f64; 2]; 2]>,
}

impl LinkSums {
    pub fn new(links: usize) -> LinkSums {
        LinkSums {
            links: vec![LinkBalance::default(); links],
            largest_force_n: 0.0,
            fastest_rad_s: vec![0.0; links],
            rotor_rad_s: 0.0,
            moments: Vec::new(),
            forces: Vec::new(),
            at_joints: Vec::new(),
        }
    }

    pub fn take(&mut self, frame: &Frame, topology: &Topology) {
        let (l, j, c) = (&frame.links, &frame.joints, &frame.contacts);
        let n = self.links.len();
        self.moments.clear();
        self.moments.resize(n, 0.0);
        self.forces.clear();
        self.forces.resize(n, [0.0; 2]);
        // Rollers push the link at its joints, as their neighbours do.
        self.at_joints.clear();
        self.at_joints.resize(n, [[0.0; 2]; 2]);
        let r = &frame.rollers;
        for (k, (link, front)) in topology.rollers.iter().enumerate().take(r.force_x_n.len()) {
            let at = &mut self.at_joints[*link][usize::from(!front)];
            *at = [at[0] - r.force_x_n[k], at[1] - r.force_y_n[k]];
            self.moments[*link] += r.bush_moment_nm[k];
        }
        for row in (0..c.link.len()).filter(|row| !Feature::is_roller(c.feature[*row])) {
            let i = c.link[row] as usize;
            let (normal, friction) = (c.normal_force_n[row], c.tangential_force_n[row]);
            let force = [
                normal * c.normal_x[row] - friction * c.normal_y[row],
                normal * c.normal_y[row] + friction * c.normal_x[row],
            ];
            let arm = [c.point_link_x_m[row] - l.x_m[i], c.point_link_y_m[row] - l.y_m[i]];
            self.moments[i] += arm[0] * force[1] - arm[1] * force[0];
            self.forces[i] = [self.forces[i][0] + force[0], self.forces[i][1] + force[1]];
        }
        self.rotor_rad_s = frame.rotors.speed_rad_s.iter().fold(self.rotor_rad_s, |most, w| most.max(w.abs()));
        for i in 0..n {
            let rear = topology.behind[i];
            let (sin, cos) = crate::units::sin_cos(l.angle_rad[i]);
            let [at_front, at_rear] = self.at_joints[i];
            let (front_x, front_y) = (at_front[0] - j.force_x_n[i], at_front[1] - j.force_y_n[i]);
            let (rear_x, rear_y) = (at_rear[0] + j.force_x_n[rear], at_rear[1] + j.force_y_n[rear]);
            let sums = &mut self.links[i];
            sums.mass.add([l.ax_m_s2[i]], front_x + rear_x + self.forces[i][0]);
            sums.mass.add([l.ay_m_s2[i]], front_y + rear_y + self.forces[i][1]);
            let known = self.moments[i] + j.friction_torque_nm[rear] - j.friction_torque_nm[i];
            let (front, back) = (cos * front_y - sin * front_x, cos * rear_y - sin * rear_x);
            sums.turning.add([l.alpha_rad_s2[i], -front, back], known);
            self.largest_force_n = self.largest_force_n.max(libm::hypot(front_x, front_y));
            let relative = l.omega_rad_s[topology.ahead[i]] - l.omega_rad_s[i];
            self.fastest_rad_s[i] = self.fastest_rad_s[i].max(relative.abs());
        }
    }

    pub fn fits(&self) -> Vec<LinkFit> {
        let of = |sums: &LinkBalance| {
            let mass = sums.mass.solve(0.0);
            let turning = sums.turning.solve(0.0);
            let estimate = |i: usize| turning.map(|t| Estimate::of(&t, i, sums.turning.samples));
            LinkFit {
                mass_kg: mass.map(|m| Estimate::of(&m, 0, sums.mass.samples / 2)),
                inertia_kg_m2: estimate(0),
                front_arm_m: estimate(1),
                rear_arm_m: estimate(2),
            }
        };
        self.links.iter().map(of).collect()
    }

    /// Relative speed above which a joint counts as turning [rad/s].
    fn turning_rad_s(&self) -> f64 {
        let usual = || median(self.fastest_rad_s.iter().copied());
        TURNING * if self.rotor_rad_s > 0.0 { self.rotor_rad_s } else { usual() }
    }
}

/// Sums over one joint.
#[derive(Clone, Copy, Debug, Default)]
struct JointSums {
    stretch: NormalEquations<3>,
    friction: NormalEquations<2>,
}

/// What the frames tell of a joint.
#[derive(Clone, Copy, Debug, Default)]
pub struct JointFit {
    pub stiffness_n_per_m: Option<Estimate>,
    pub clearance_m: Option<Estimate>,
    pub damping_n_s_per_m: Option<Estimate>,
    pub friction_arm_m: Option<Estimate>,
    pub tight_torque_nm: Option<Estimate>,
    /// Frames in which it turned fast.
    pub turning_samples: usize,
}

/// The second pass over the frames: joints, by the arms that the first one found.
#[derive(Clone, Debug)]
pub struct JointPass {
    joints: Vec<JointSums>,
    /// Front and rear arm of every link [m].
    arms: Vec<[f64; 2]>,
    least_force_n: f64,
    turning_rad_s: f64,
}

impl JointPass {
    /// Links whose arms are unknown take the median of their row.
    pub fn new(sums: &LinkSums, fits: &[LinkFit], topology: &Topology) -> JointPass {
        let side = |i: usize, own: fn(&LinkFit) -> Option<Estimate>| {
            let like = || fits.iter().zip(&topology.row).filter(|(_, row)| **row == topology.row[i]);
            let known = own(&fits[i]).map(|e| e.value);
            known.unwrap_or_else(|| median(like().filter_map(|(f, _)| own(f)).map(|e| e.value)))
        };
        JointPass {
            joints: vec![JointSums::default(); fits.len()],
            arms: (0..fits.len()).map(|i| [side(i, |f| f.front_arm_m), side(i, |f| f.rear_arm_m)]).collect(),
            least_force_n: PULLED * sums.largest_force_n,
            turning_rad_s: sums.turning_rad_s(),
        }
    }

    /// Place of the front end of a link [m].
    pub fn front_end(&self, frame: &Frame, i: usize) -> [f64; 2] {
        let (sin, cos) = crate::units::sin_cos(frame.links.angle_rad[i]);
        let arm = self.arms[i][0];
        [frame.links.x_m[i] + arm * cos, frame.links.y_m[i] + arm * sin]
    }

    pub fn take(&mut self, frame: &Frame, topology: &Topology) {
        let (l, j) = (&frame.links, &frame.joints);
        for (i, sums) in self.joints.iter_mut().enumerate() {
            let ahead = topology.ahead[i];
            let force = libm::hypot(j.force_x_n[i], j.force_y_n[i]);
            let relative = l.omega_rad_s[ahead] - l.omega_rad_s[i];
            if relative.abs() > self.turning_rad_s {
                sums.friction.add([force, 1.0], -j.friction_torque_nm[i] * relative.signum());
            }
            if force <= self.least_force_n {
                continue;
            }
            let (sin, cos) = crate::units::sin_cos(l.angle_rad[i]);
            let (sin_ahead, cos_ahead) = crate::units::sin_cos(l.angle_rad[ahead]);
            let (front, rear) = (self.arms[i][0], self.arms[ahead][1]);
            let u = [
                l.x_m[i] + front * cos - (l.x_m[ahead] - rear * cos_ahead),
                l.y_m[i] + front * sin - (l.y_m[ahead] - rear * sin_ahead),
            ];
            let (turn, turn_ahead) = (front * l.omega_rad_s[i], rear * l.omega_rad_s[ahead]);
            let rate = [
                l.vx_m_s[i] - turn * sin - (l.vx_m_s[ahead] + turn_ahead * sin_ahead),
                l.vy_m_s[i] + turn * cos - (l.vy_m_s[ahead] - turn_ahead * cos_ahead),
            ];
            let n = [j.force_x_n[i] / force, j.force_y_n[i] / force];
            let along = |v: [f64; 2]| v[0] * n[0] + v[1] * n[1];
            sums.stretch.add([force, 1.0, -along(rate)], along(u));
        }
    }

    pub fn fits(&self) -> Vec<JointFit> {
        let of = |sums: &JointSums| {
            let samples = sums.stretch.samples;
            let stretch = sums.stretch.solve(0.0).filter(|s| s.value[0] > 0.0);
            let stiffness = stretch.map(|s| {
                let k = 1.0 / s.value[0];
                Estimate { value: k, error: k * k * s.error[0], samples }
            });
            let damping = stretch.map(|s| {
                let (k, tau) = (1.0 / s.value[0], s.value[2]);
                Estimate { value: k * tau, error: k * s.error[2] + k * k * tau.abs() * s.error[0], samples }
            });
            let friction = sums.friction.solve(0.0);
            let turned = sums.friction.samples;
            JointFit {
                stiffness_n_per_m: stiffness,
                clearance_m: stretch.map(|s| Estimate::of(&s, 1, samples)),
                damping_n_s_per_m: damping,
                friction_arm_m: friction.map(|f| Estimate::of(&f, 0, turned)),
                tight_torque_nm: friction.map(|f| Estimate::of(&f, 1, turned)),
                turning_samples: turned,
            }
        };
        self.joints.iter().map(of).collect()
    }
}
