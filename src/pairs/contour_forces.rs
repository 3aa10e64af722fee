//! Forces of the contours of a link's ends ([`super::end_contact`]), many at a time.
//!
//! They touch at q = joint - r n + s t, with r and s their own at every instant, where a bush has its radius and none
//! ([`super::tooth_contact`], which tells the rest): s adds its lever to the normal force, so that v_n loses
//! (omega_link - omega_body) s, l d x n becomes l d x n - s, and the moment about the joint gains -s F_n.
//!
//! Several contacts of one link, with a ring and a guide or at both its ends, share its inertia. They are solved for one after the
//! other, as Gauss and Seidel do: each takes into account by how much those before it have changed in this step ([`AccelerationChange`]),
//! and those behind it as they were a step ago. If all were taken as they were a step ago, abutments on a guide would chatter from
//! omega h = 1.3 on, or from less where contacts are damped much: `integrate::step_bound`.

use super::arc_lanes::{EndContactLanes, NO_CONTACT_M};
use super::bush_tooth::{Lanes, contact_update, normal_forces};
use crate::elements::contact_law::{self, ContactLaw, StepInput};
use crate::elements::friction;
use crate::geometry::Vec2;
use crate::lanes::{LANES, LaneBlock, LaneMask, any, mask};

/// What lanes of other contours of a link have besides: the contact point seen from the joint, against the normal and along
/// the tangent [m]; the link's angular acceleration one step back.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OffJoint {
    pub radius: LaneBlock,
    pub offset: LaneBlock,
    pub alpha: LaneBlock,
    /// Radius of curvature of the link's contour at the contact point [m].
    pub link_radius: LaneBlock,
}

/// The end of a link at a node, and how it touches: one lane.
#[derive(Clone, Copy)]
struct EndLane {
    x: f64,
    y: f64,
    vx: f64,
    vy: f64,
    /// Acceleration of the joint in the step before [m/s2].
    ax: f64,
    ay: f64,
    cos: f64,
    sin: f64,
    /// Angular speed of the link; its angular acceleration in the step before [rad/s, rad/s2].
    omega: f64,
    alpha: f64,
    lever: f64,
    inverse_mass: f64,
    inverse_inertia: f64,
    normal_x: f64,
    normal_y: f64,
    /// As in [`OffJoint`].
    radius: f64,
    offset: f64,
}

/// Motion along a normal, as the contact law takes it.
#[derive(Clone, Copy)]
struct NormalMotion {
    mobility: f64,
    free_rate: f64,
    free_acceleration: f64,
}

/// What a contact gives to the link and takes from the body.
#[derive(Clone, Copy)]
struct ContactReaction {
    slide: f64,
    tangential_force: f64,
    lost_friction: f64,
    force_x: f64,
    force_y: f64,
    moment: f64,
    torque: f64,
}

impl EndLane {
    /// Along the normal, where the contact point may lie off the normal through the joint. `omega`: of the body.
    #[inline(always)]
    fn normal_motion(&self, step: f64, omega: f64, past_force: f64) -> NormalMotion {
        let e = self;
        let (nx, ny) = (e.normal_x, e.normal_y);
        let (vx, vy) = (e.vx + omega * e.y, e.vy - omega * e.x);
        let lever_n = e.lever * (e.cos * ny - e.sin * nx) - e.offset;
        let mobility = e.inverse_mass + e.inverse_inertia * lever_n * lever_n;
        let own = mobility * past_force;
        let turned = omega * ((e.vy + vy) * nx - (e.vx + vx) * ny);
        NormalMotion {
            mobility,
            free_rate: 0.5 * step * own - (vx * nx + vy * ny - (e.omega - omega) * e.offset),
            free_acceleration: own - (e.ax * nx + e.ay * ny - e.alpha * e.offset) - turned,
        }
    }

    /// Accelerations of the link by a normal and a tangential force.
    #[inline(always)]
    fn link_accelerations(&self, normal: f64, friction: f64) -> (f64, f64, f64) {
        let (nx, ny) = (self.normal_x, self.normal_y);
        let (fx, fy) = (normal * nx - friction * ny, normal * ny + friction * nx);
        let moment = self.lever * (self.cos * fy - self.sin * fx) - (self.radius * friction + self.offset * normal);
        (fx * self.inverse_mass, fy * self.inverse_mass, moment * self.inverse_inertia)
    }

    /// Friction beside a normal force, and both about the joint and the body's origin.
    #[inline(always)]
    fn reaction(
        &self,
        (mu, stick_speed): (f64, f64),
        step: f64,
        omega: f64,
        normal_force: f64,
        past_friction: f64,
    ) -> ContactReaction {
        let e = self;
        let (nx, ny) = (e.normal_x, e.normal_y);
        let outward = e.x * nx + e.y * ny;
        let slide = e.vy * nx - e.vx * ny - e.omega * e.radius - omega * (outward - e.radius);
        let lever_t = e.lever * (e.cos * nx + e.sin * ny) - e.radius;
        let w_t = e.inverse_mass + e.inverse_inertia * lever_t * lever_t;
        let mobility = 0.5 * step * w_t;
        let free = slide - mobility * past_friction;
        let ft = friction::solved_force(mu, normal_force, free, stick_speed, mobility);
        let slide = free + mobility * ft;
        let (fx, fy) = (normal_force * nx - ft * ny, normal_force * ny + ft * nx);
        let moment = -e.radius * ft - e.offset * normal_force;
        ContactReaction {
            slide,
            tangential_force: ft,
            lost_friction: -ft * slide * step,
            force_x: fx,
            force_y: fy,
            moment,
            torque: e.y * fx - e.x * fy - moment,
        }
    }
}

/// Ends of a block of links, and where they touch. Copies: behind references loops over them would not vectorise.
#[derive(Clone, Copy)]
pub struct EndColumns {
    /// Joints, in the world.
    pub x: LaneBlock,
    pub y: LaneBlock,
    pub vx: LaneBlock,
    pub vy: LaneBlock,
    /// Angular speeds of the links; accelerations of their centres, linear and angular, in the step before.
    pub omega: LaneBlock,
    pub ax: LaneBlock,
    pub ay: LaneBlock,
    pub alpha: LaneBlock,
    pub cos: LaneBlock,
    pub sin: LaneBlock,
    pub lever: LaneBlock,
    pub inverse_mass: LaneBlock,
    pub inverse_inertia: LaneBlock,
    /// How the joint lies from the link's centre: 1 ahead, -1 behind.
    pub sign: f64,
    /// The body's origin.
    pub origin: Vec2,
    /// Contact points from there; penetrations of [`super::arc_lanes::NOTHING_M`] touch nothing.
    pub penetration: LaneBlock,
    pub point_x: LaneBlock,
    pub point_y: LaneBlock,
    pub normal_x: LaneBlock,
    pub normal_y: LaneBlock,
    /// What contacts before this one have changed, read where UPDATED is true: accelerations as in [`AccelerationChange`].
    pub change_ax: LaneBlock,
    pub change_ay: LaneBlock,
    pub change_alpha: LaneBlock,
    /// The share of these that speeds at the node have taken: the mean over the step takes a quarter of it, as for joints
    /// (`integrate::explicit`) [s].
    pub quarter_step: f64,
}

impl EndColumns {
    #[inline(always)]
    fn lane<const UPDATED: bool>(&self, i: usize) -> EndLane {
        let (x, y) = (self.x[i] - self.origin.x, self.y[i] - self.origin.y);
        let (cos, sin, lever) = (self.cos[i], self.sin[i], self.sign * self.lever[i]);
        let touches = self.penetration[i] != NO_CONTACT_M;
        let (nx, ny) = (self.normal_x[i], self.normal_y[i]);
        let (dx, dy) = (self.point_x[i] - x, self.point_y[i] - y);
        let (ax, ay, alpha) = (self.ax[i], self.ay[i], self.alpha[i]);
        let mut lane = EndLane {
            x,
            y,
            vx: self.vx[i],
            vy: self.vy[i],
            ax: ax - alpha * lever * sin,
            ay: ay + alpha * lever * cos,
            cos,
            sin,
            omega: self.omega[i],
            alpha,
            lever,
            inverse_mass: self.inverse_mass[i],
            inverse_inertia: self.inverse_inertia[i],
            normal_x: if touches { nx } else { 0.0 },
            normal_y: if touches { ny } else { 1.0 },
            radius: if touches { -(dx * nx + dy * ny) } else { 0.0 },
            offset: if touches { dx * -ny + dy * nx } else { 0.0 },
        };
        if UPDATED {
            let (alpha, quarter) = (self.change_alpha[i], self.quarter_step);
            let (ax, ay) = (self.change_ax[i] - alpha * lever * sin, self.change_ay[i] + alpha * lever * cos);
            (lane.ax, lane.ay, lane.alpha) = (lane.ax + ax, lane.ay + ay, lane.alpha + alpha);
            (lane.vx, lane.vy) = (lane.vx + quarter * ax, lane.vy + quarter * ay);
            lane.omega += quarter * alpha;
        }
        lane
    }

    /// Puts all of it into columns.
    #[inline(always)]
    pub fn load<const UPDATED: bool>(&self, found: &EndContactLanes, lanes: &mut Lanes, off: &mut OffJoint) {
        for i in 0..LANES {
            let e = self.lane::<UPDATED>(i);
            (lanes.x[i], lanes.y[i], lanes.vx[i], lanes.vy[i]) = (e.x, e.y, e.vx, e.vy);
            (lanes.ax[i], lanes.ay[i], lanes.cos[i], lanes.sin[i]) = (e.ax, e.ay, e.cos, e.sin);
            (lanes.omega[i], lanes.lever[i], off.alpha[i]) = (e.omega, e.lever, e.alpha);
            (lanes.inverse_mass[i], lanes.inverse_inertia[i]) = (e.inverse_mass, e.inverse_inertia);
            (lanes.normal_x[i], lanes.normal_y[i]) = (e.normal_x, e.normal_y);
            (off.radius[i], off.offset[i]) = (e.radius, e.offset);
            lanes.penetration[i] = self.penetration[i];
            let touches = self.penetration[i] != NO_CONTACT_M;
            lanes.body_radius[i] = if touches { found.body_radius[i] } else { 0.0 };
            off.link_radius[i] = if touches { found.link_radius[i] } else { 0.0 };
        }
    }

    /// Whether any of the lanes of `own`, none of which has touched in the step before, may touch in this one: by its speed along the
    /// normal and the accelerations one step back. `turned_m`: how far the turning of normals may move it along one [m].
    #[inline(always)]
    pub fn may_touch<const UPDATED: bool>(&self, step: f64, omega: f64, turned_m: f64, own: &LaneMask) -> bool {
        let mut may = [0; LANES];
        for i in 0..LANES {
            let e = self.lane::<UPDATED>(i);
            let (vx, vy) = (e.vx + omega * e.y, e.vy - omega * e.x);
            let closing = (e.omega - omega) * e.offset - (vx * e.normal_x + vy * e.normal_y);
            let closing = if closing > 0.0 { closing } else { 0.0 };
            let push = e.ax.abs() + e.ay.abs() + (e.alpha * e.offset).abs();
            let way_m = 1.01 * step * closing + 0.51 * step * step * push + turned_m;
            may[i] = own[i] & !mask(self.penetration[i] + way_m < 0.0);
        }
        any(&may)
    }
}

/// By how much contacts of this step have changed the accelerations of a block of links, against those of the step before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(64))]
pub struct AccelerationChange {
    pub ax: LaneBlock,
    pub ay: LaneBlock,
    pub alpha: LaneBlock,
    /// Whether any is not zero.
    pub used: bool,
}

impl AccelerationChange {
    /// Takes what one block of contacts has changed.
    #[inline(always)]
    pub fn add(&mut self, step: &BlockStep) {
        for i in 0..LANES {
            self.ax[i] += step.change_ax[i];
            self.ay[i] += step.change_ay[i];
            self.alpha[i] += step.change_alpha[i];
        }
        self.used = true;
    }

    /// The same of lanes that are `own` only, whose normal and tangential forces have changed from `past` to those in `lanes`.
    pub fn add_lanes(&mut self, ends: &EndColumns, lanes: &Lanes, past: [&LaneBlock; 2], own: &LaneMask) {
        for i in (0..LANES).filter(|i| own[*i] != 0) {
            let (normal, friction) = (lanes.normal_force[i] - past[0][i], lanes.tangential_force[i] - past[1][i]);
            let (ax, ay, alpha) = ends.lane::<false>(i).link_accelerations(normal, friction);
            self.ax[i] += ax;
            self.ay[i] += ay;
            self.alpha[i] += alpha;
        }
        self.used = true;
    }
}

/// How far the turning of normals moves an end along one in a step, beyond what speeds say [m].
pub fn turned_m(step: f64, omega: f64, fastest_m_s: f64) -> f64 {
    4.0 * step * step * omega.abs() * fastest_m_s
}

/// What a contact of a block of ends remembers from step to step, in that order: normal and tangential force, age, approach speed.
pub type PastContacts = [LaneBlock; 4];

/// A block of contacts after a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockStep {
    pub normal_force: LaneBlock,
    pub tangential_force: LaneBlock,
    pub age: LaneBlock,
    pub approach: LaneBlock,
    pub rate: LaneBlock,
    pub slide: LaneBlock,
    pub lost_damping: LaneBlock,
    pub lost_friction: LaneBlock,
    /// On the link at its centre, with the moment about it.
    pub force_x: LaneBlock,
    pub force_y: LaneBlock,
    pub moment: LaneBlock,
    pub torque: LaneBlock,
    /// By how much the link's accelerations have changed with these forces, where UPDATED was true.
    pub change_ax: LaneBlock,
    pub change_ay: LaneBlock,
    pub change_alpha: LaneBlock,
}

/// As [`contour_forces`] with a law of a closed form, to the bit, in one loop that keeps its values in registers; None where a contact begins
/// or ends within the step, which takes the long way.
#[inline(always)]
pub fn fast_contour_step<const UPDATED: bool, const GROWS: bool>(
    (k, c): (f64, f64),
    friction: (f64, f64),
    (step, omega): (f64, f64),
    ends: EndColumns,
    past: PastContacts,
) -> Option<BlockStep> {
    let mut out = BlockStep::default();
    let mut special = [0; LANES];
    for i in 0..LANES {
        let e = ends.lane::<UPDATED>(i);
        let (penetration, past_force) = (ends.penetration[i], past[0][i]);
        let motion = e.normal_motion(step, omega, past_force);
        let input = StepInput {
            penetration,
            free_rate: motion.free_rate,
            free_acceleration: motion.free_acceleration,
            mobility: motion.mobility,
            past_force,
            approach: past[3][i],
            step,
        };
        let (age, approach) = (past[2][i], past[3][i]);
        let (law, plain) = contact_law::fast_step::<GROWS>(k, c, input, age > 0.0);
        special[i] = !mask(plain);
        let kept = contact_update(penetration, motion.free_rate, law, step, (age, approach));
        let given = e.reaction(friction, step, omega, law.mean_force, past[1][i]);
        let arm = e.lever * (e.cos * given.force_y - e.sin * given.force_x);
        (out.normal_force[i], out.tangential_force[i]) = (law.mean_force, given.tangential_force);
        (out.age[i], out.approach[i], out.rate[i]) = (kept.age, kept.approach, law.rate);
        out.slide[i] = given.slide;
        (out.lost_damping[i], out.lost_friction[i]) = (kept.lost, given.lost_friction);
        (out.force_x[i], out.force_y[i]) = (given.force_x, given.force_y);
        (out.moment[i], out.torque[i]) = (given.moment + arm, given.torque);
        if UPDATED {
            let (normal, friction) = (law.mean_force - past_force, given.tangential_force - past[1][i]);
            (out.change_ax[i], out.change_ay[i], out.change_alpha[i]) = e.link_accelerations(normal, friction);
        }
    }
    (!any(&special)).then_some(out)
}

/// As [`forces`], for contours with their own radius and offset in every lane.
#[inline(always)]
pub fn contour_forces(
    law: &ContactLaw,
    friction: (f64, f64),
    (step, omega): (f64, f64),
    off: &OffJoint,
    lanes: &mut Lanes,
) {
    for i in 0..LANES {
        let motion = lanes.end(off, i).normal_motion(step, omega, lanes.normal_force[i]);
        lanes.mobility[i] = motion.mobility;
        (lanes.free_rate[i], lanes.free_acceleration[i]) = (motion.free_rate, motion.free_acceleration);
    }
    normal_forces(law, &off.link_radius, step, lanes);
    for i in 0..LANES {
        let given = lanes.end(off, i).reaction(friction, step, omega, lanes.normal_force[i], lanes.tangential_force[i]);
        (lanes.slide[i], lanes.tangential_force[i]) = (given.slide, given.tangential_force);
        lanes.lost_friction[i] = given.lost_friction;
        (lanes.force_x[i], lanes.force_y[i]) = (given.force_x, given.force_y);
        (lanes.moment[i], lanes.torque[i]) = (given.moment, given.torque);
    }
}

impl Lanes {
    #[inline(always)]
    fn end(&self, off: &OffJoint, i: usize) -> EndLane {
        EndLane {
            x: self.x[i],
            y: self.y[i],
            vx: self.vx[i],
            vy: self.vy[i],
            ax: self.ax[i],
            ay: self.ay[i],
            cos: self.cos[i],
            sin: self.sin[i],
            omega: self.omega[i],
            alpha: off.alpha[i],
            lever: self.lever[i],
            inverse_mass: self.inverse_mass[i],
            inverse_inertia: self.inverse_inertia[i],
            normal_x: self.normal_x[i],
            normal_y: self.normal_y[i],
            radius: off.radius[i],
            offset: off.offset[i],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::sin_cos;

    /// Columns of random ends that touch a body at random places, and the speed of the fastest of their points.
    struct Scene {
        columns: [LaneBlock; 13],
        change: [LaneBlock; 3],
        found: EndContactLanes,
        past: [LaneBlock; 4],
        own: LaneMask,
        omega: f64,
        step: f64,
        fastest_m_s: f64,
    }

    impl Scene {
        fn random(random: &mut impl FnMut(f64, f64) -> f64) -> Scene {
            let (step, omega, lever) = (random(1e-7, 1e-5), random(-700.0, 700.0), random(-10e-3, 10e-3));
            let (sin, cos) = sin_cos(random(-4.0, 4.0));
            let speed = 40.0 * random(0.0, 1.0).powi(6);
            let mut columns = [[0.0; LANES]; 13];
            let (mut found, mut fastest_m_s) = (EndContactLanes::none(), 0.0_f64);
            let change = [1e4, 1e4, 1e6].map(|most| std::array::from_fn(|_| random(-most, most)));
            for i in 0..LANES {
                let (x, y) = (random(-0.05, 0.05), random(-0.05, 0.05));
                let (vx, vy) = (random(-speed, speed) - omega * y, random(-speed, speed) + omega * x);
                let turning = omega + random(-speed, speed) / 5e-3;
                let accelerations = [random(-1e5, 1e5), random(-1e5, 1e5), random(-1e7, 1e7)];
                let inverse = [random(50.0, 200.0), random(1e6, 1e7)];
                let [ax, ay, alpha] = accelerations;
                let values = [x, y, vx, vy, turning, ax, ay, alpha, cos, sin, lever, inverse[0], inverse[1]];
                for (column, value) in columns.iter_mut().zip(values) {
                    column[i] = value;
                }
                let (ny, nx) = sin_cos(random(-4.0, 4.0));
                let (radius, offset) = (random(0.0, 5e-3), random(-5e-3, 5e-3));
                (found.normal_x[i], found.normal_y[i]) = (nx, ny);
                (found.point_x[i], found.point_y[i]) = (x - radius * nx - offset * ny, y - radius * ny + offset * nx);
                found.penetration[i] = -random(0.0, 1.0).powi(3) * 1e-4;
                fastest_m_s = fastest_m_s.max(libm::hypot(vx, vy)).max(omega.abs() * libm::hypot(x, y));
            }
            Scene { columns, change, found, past: [[0.0; LANES]; 4], own: [!0; LANES], omega, step, fastest_m_s }
        }

        fn ends(&self) -> EndColumns {
            let [x, y, vx, vy, omega, ax, ay, alpha, cos, sin, lever, inverse_mass, inverse_inertia] = self.columns;
            let EndContactLanes { penetration, point_x, point_y, normal_x, normal_y, .. } = self.found;
            let (sign, origin) = (1.0, Vec2::zeros());
            EndColumns {
                x,
                y,
                vx,
                vy,
                omega,
                ax,
                ay,
                alpha,
                cos,
                sin,
                lever,
                inverse_mass,
                inverse_inertia,
                sign,
                origin,
                penetration,
                point_x,
                point_y,
                normal_x,
                normal_y,
                change_ax: self.change[0],
                change_ay: self.change[1],
                change_alpha: self.change[2],
                quarter_step: 0.25 * self.step,
            }
        }

        /// The long way.
        fn forces(&self, law: &ContactLaw, friction: (f64, f64)) -> Lanes {
            let (mut lanes, mut off) = (Lanes::default(), OffJoint::default());
            self.ends().load::<true>(&self.found, &mut lanes, &mut off);
            [lanes.normal_force, lanes.tangential_force, lanes.age, lanes.approach] = self.past;
            contour_forces(law, friction, (self.step, self.omega), &off, &mut lanes);
            lanes
        }
    }

    fn generator() -> impl FnMut(f64, f64) -> f64 {
        let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
        move |low, high| {
            seed ^= seed >> 12;
            seed ^= seed << 25;
            seed ^= seed >> 27;
            low + (high - low) * (seed.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
        }
    }

    /// What is left out would have had no force and no memory; and much is left out.
    #[test]
    fn what_may_not_touch_has_no_force() {
        let mut random = generator();
        let (mut left_out, mut touched) = (0, 0);
        for _ in 0..200_000 {
            let scene = Scene::random(&mut random);
            let (stiffness_n_per_m, damping_n_s_per_m) = (random(1e7, 2e8), random(0.0, 600.0));
            let law = ContactLaw::Linear { stiffness_n_per_m, damping_n_s_per_m };
            let turned_m = turned_m(scene.step, scene.omega, scene.fastest_m_s);
            let may = scene.ends().may_touch::<true>(scene.step, scene.omega, turned_m, &scene.own);
            let lanes = scene.forces(&law, (0.1, 1e-3));
            let touches = lanes.age.iter().chain(&lanes.normal_force).any(|v| *v != 0.0);
            assert!(may || !touches, "{lanes:?}");
            left_out += u64::from(!may);
            touched += u64::from(touches);
        }
        println!("{left_out} of 200000 blocks left out, {touched} touched");
        assert!(left_out > 10_000 && touched > 10_000);
    }

    /// The short way gives the bits of the long one, or nothing.
    #[test]
    fn one_loop_gives_the_bits_of_many() {
        let mut random = generator();
        let mut compared = 0;
        for _ in 0..100_000 {
            let mut scene = Scene::random(&mut random);
            let closed = random(0.0, 1.0) < 0.5;
            for i in 0..LANES {
                scene.found.penetration[i] = if closed { random(1e-6, 1e-4) } else { -random(0.0, 1e-3) };
                let held = if closed { 1.0 } else { 0.0 };
                let past = [random(0.0, 1e3), random(-1e2, 1e2), random(1.0, 9.0), random(0.0, 5.0)];
                for (column, value) in scene.past.iter_mut().zip(past) {
                    column[i] = held * value;
                }
            }
            let (k, c, friction) = (random(1e7, 2e8), random(0.0, 600.0), (0.1, 1e-3));
            let motion = (scene.step, scene.omega);
            let (law, short) = if random(0.0, 1.0) < 0.5 {
                let law = ContactLaw::Linear { stiffness_n_per_m: k, damping_n_s_per_m: c };
                (law, fast_contour_step::<true, false>((k, c), friction, motion, scene.ends(), scene.past))
            } else {
                let chi = c / 300.0;
                let law = ContactLaw::HuntCrossley { stiffness_n_per_m_n: k, exponent: 1.0, damping_s_per_m: chi };
                (law, fast_contour_step::<true, true>((k, k * chi), friction, motion, scene.ends(), scene.past))
            };
            let Some(short) = short else { continue };
            let long = scene.forces(&law, friction);
            let mut arms = long.moment;
            for i in 0..LANES {
                arms[i] += long.lever[i] * (long.cos[i] * long.force_y[i] - long.sin[i] * long.force_x[i]);
            }
            let expected = BlockStep {
                normal_force: long.normal_force,
                tangential_force: long.tangential_force,
                age: long.age,
                approach: long.approach,
                rate: long.rate,
                slide: long.slide,
                lost_damping: long.lost_damping,
                lost_friction: long.lost_friction,
                force_x: long.force_x,
                force_y: long.force_y,
                moment: arms,
                torque: long.torque,
                ..short
            };
            assert_eq!(short, expected);
            let (mut one, mut other) = (AccelerationChange::default(), AccelerationChange::default());
            one.add(&short);
            other.add_lanes(&scene.ends(), &long, [&scene.past[0], &scene.past[1]], &scene.own);
            assert_eq!([one.ax, one.ay, one.alpha], [other.ax, other.ay, other.alpha]);
            compared += 1;
        }
        println!("{compared} blocks of 100000 took the short way");
        assert!(compared > 10_000);
    }
}
