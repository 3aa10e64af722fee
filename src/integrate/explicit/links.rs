//! The part of a step that concerns links and their joints, in loops over blocks of links. One loop that keeps a block's values in
//! registers from its ends to its accelerations is 6 % slower: short loops overlap in the processor, and do not spill.

use super::ContactGroup;
use super::guides::BlockForces;
use super::scratch::{JointColumn, LinkConstants, LinkEnds, WrappedColumns};
use super::{RunIn, Scratch};
use crate::aligned::AlignedColumn;
use crate::elements::friction;
use crate::elements::link_joint::{self, JointEnds, LinkJoint};
use crate::lanes::{LANES, blocks, blocks_mut};
use crate::model::{ChainModel, Model};
use crate::state::{LinkState, State};

/// Accelerations by the joints at this node, and the predictions that contacts use: accelerations of a step ago with the change that the
/// joints have made since, and the velocities that come of it.
#[inline(always)]
pub(super) fn predict_from_joints(model: &Model, state: &State, scratch: &mut Scratch) {
    predict_joint_forces(model, state, scratch);
    let quarter = 0.25 * model.step_s;
    let (c, s) = (&model.chain, &state.links);
    let count = c.padded / LANES;
    let Scratch {
        front,
        rear,
        omega,
        wrapped,
        joint_x,
        joint_y,
        joint_torque,
        constants,
        joint_ax: now_x,
        joint_ay: now_y,
        joint_alpha: now_turn,
        ..
    } = scratch;
    let (fx0, fx1) = (blocks(joint_x.shifted(), count), blocks(joint_x.values(), count));
    let (fy0, fy1) = (blocks(joint_y.shifted(), count), blocks(joint_y.values(), count));
    let (fm0, fm1) = (blocks(joint_torque.shifted(), count), blocks(joint_torque.values(), count));
    let (cos, sin) = (blocks(&s.cos, count), blocks(&s.sin, count));
    let (ax, ay, alpha) = (blocks(&s.ax, count), blocks(&s.ay, count), blocks(&s.alpha, count));
    let (past_x, past_y) = (blocks(&s.joint_ax, count), blocks(&s.joint_ay, count));
    let past_turn = blocks(&s.joint_alpha, count);
    let (now_x, now_y) = (blocks_mut(now_x, count), blocks_mut(now_y, count));
    let now_turn = blocks_mut(now_turn, count);
    let (predicted_x, predicted_y) = (blocks_mut(&mut wrapped.ax, count), blocks_mut(&mut wrapped.ay, count));
    let predicted_turn = blocks_mut(&mut wrapped.alpha, count);
    let (front_vx, front_vy) = (blocks_mut(&mut front.vx, count), blocks_mut(&mut front.vy, count));
    let (rear_vx, rear_vy) = (blocks_mut(&mut rear.vx, count), blocks_mut(&mut rear.vy, count));
    let turning = blocks_mut(omega, count);
    for at in 0..count {
        let (fx0, fx1, fy0, fy1, fm0, fm1) = (fx0[at], fx1[at], fy0[at], fy1[at], fm0[at], fm1[at]);
        let (cos, sin, own) = (cos[at], sin[at], constants.block(at));
        let (lever, im, ij) = (own.lever, own.inverse_mass, own.inverse_inertia);
        let (past_x, past_y, past_turn) = (past_x[at], past_y[at], past_turn[at]);
        let (mut ax, mut ay, mut alpha) = (ax[at], ay[at], alpha[at]);
        let (mut a, mut b, mut e, mut f) = (front_vx[at], front_vy[at], rear_vx[at], rear_vy[at]);
        let mut w = turning[at];
        let zero = [0.0; LANES];
        let (mut x, mut y, mut turn) = (zero, zero, zero);
        for i in 0..LANES {
            let (sum_x, sum_y) = (fx0[i] + fx1[i], fy0[i] + fy1[i]);
            x[i] = (fx0[i] - fx1[i]) * im[i];
            y[i] = (fy0[i] - fy1[i]) * im[i];
            let moment = lever[i] * (sin[i] * sum_x - cos[i] * sum_y) + (fm0[i] - fm1[i]);
            turn[i] = moment * ij[i];
            let (dx, dy, dt) = (x[i] - past_x[i], y[i] - past_y[i], turn[i] - past_turn[i]);
            ax[i] += dx;
            ay[i] += dy;
            alpha[i] += dt;
            let (u, v, o) = (quarter * dx, quarter * dy, quarter * dt);
            let (os, oc) = (o * lever[i] * sin[i], o * lever[i] * cos[i]);
            a[i] += u - os;
            b[i] += v + oc;
            e[i] += u + os;
            f[i] += v - oc;
            w[i] += o;
        }
        (now_x[at], now_y[at], now_turn[at]) = (x, y, turn);
        (predicted_x[at], predicted_y[at], predicted_turn[at]) = (ax, ay, alpha);
        (front_vx[at], front_vy[at], rear_vx[at], rear_vy[at]) = (a, b, e, f);
        turning[at] = w;
    }
    let WrappedColumns { ax, ay, alpha, .. } = wrapped;
    wrap_loops([&mut rear.vx, &mut rear.vy, omega, ax, ay, alpha], c);
}

/// Joint law of every loop, and its blocks. By value: what is read through a reference is read anew for every block.
#[inline(always)]
fn joint_laws(chain: &ChainModel) -> impl Iterator<Item = (LinkJoint, std::ops::Range<usize>)> {
    let blocks = chain.loops.iter().map(|l| l.start / LANES..l.end.div_ceil(LANES));
    chain.joints.iter().copied().zip(blocks)
}

/// Behind the last link of every loop its first again.
#[inline(always)]
fn wrap_loops<const N: usize>(mut columns: [&mut AlignedColumn; N], chain: &ChainModel) {
    for l in &chain.loops {
        let (start, end) = (l.start, l.end);
        for column in &mut columns {
            column[end] = column[start];
        }
    }
}

/// Forces of the joints at the node, with the friction that their forces of a step ago allow: that saves a root.
#[inline(always)]
fn predict_joint_forces(model: &Model, state: &State, scratch: &mut Scratch) {
    let c = &model.chain;
    let count = c.padded / LANES;
    let Scratch { front, rear, omega, joint_x, joint_y, joint_torque, constants, .. } = scratch;
    let ends = JointEnds::new([&front.x, &front.y, &front.vx, &front.vy], [&rear.x, &rear.y, &rear.vx, &rear.vy]);
    let limit = blocks(&state.joint_limit, count);
    let (w0, w1) = (blocks(omega, count), blocks(&omega[1..], count));
    {
        let (fx, fy) = (blocks_mut(joint_x.values_mut(), count), blocks_mut(joint_y.values_mut(), count));
        let fm = blocks_mut(joint_torque.values_mut(), count);
        for (joint, own) in joint_laws(c) {
            let per_speed = 1.0 / joint.stick_speed_rad_s;
            for at in own.start..own.end.min(count) {
                let force = ends.block(&joint, at, count);
                let (limit, slope, w0, w1) = (limit[at], constants.block(at).friction_slope, w0[at], w1[at]);
                let mut torque = [0.0; LANES];
                for i in 0..LANES {
                    torque[i] =
                        friction::force_with_slope_limit(limit[i], w1[i] - w0[i], limit[i] * per_speed, slope[i]);
                }
                (fx[at], fy[at], fm[at]) = (force.x, force.y, torque);
            }
        }
    }
    JointColumn::wrap_loops([joint_x, joint_y, joint_torque], c);
}

/// Accelerations by contacts; ends and speeds as the mean over the step that joints take, with these and
/// with the predicted accelerations by the joints.
#[inline(always)]
pub(super) fn apply_contacts(model: &Model, state: &State, scratch: &mut Scratch) {
    let (quarter, shift) = (0.25 * model.step_s, model.step_s * model.step_s / 12.0);
    let c = &model.chain;
    let s = &state.links;
    let n = c.padded;
    let count = n / LANES;
    let (cos, sin) = (blocks(&s.cos, count), blocks(&s.sin, count));
    {
        let Scratch { bush_x, bush_y, bush_moment, ax, ay, alpha, groups, end_forces, constants, .. } = &mut *scratch;
        let (bx0, bx1) = (blocks(bush_x.shifted(), count), blocks(bush_x.values(), count));
        let (by0, by1) = (blocks(bush_y.shifted(), count), blocks(bush_y.values(), count));
        let (bm0, bm1) = (blocks(bush_moment.shifted(), count), blocks(bush_moment.values(), count));
        let (on0, on1) = (blocks(&c.bush_on_front, count), blocks(&c.bush_on_front[1..], count));
        let (ax, ay, al) = (blocks_mut(ax, count), blocks_mut(ay, count), blocks_mut(alpha, count));
        let (stale, pushed) = (&groups[ContactGroup::Bushes.index()].stale[..count], &end_forces[..count]);
        // Where no bush and no guide end touches, nothing is given. Before the first link of a loop stands its last joint.
        let mut before = 0;
        let with_links = c.loops.iter().filter(|l| !l.is_empty());
        let mut ahead = with_links.map(|l| (l.start / LANES, (l.end - 1) / LANES));
        let mut next_loop = ahead.next();
        for at in 0..count {
            if let Some((first, last)) = next_loop
                && first == at
            {
                (before, next_loop) = (stale[last], ahead.next());
            }
            let idle = stale[at] | before == 0;
            before = stale[at];
            let zero = [0.0; LANES];
            if idle && !pushed[at].used {
                (ax[at], ay[at], al[at]) = (zero, zero, zero);
                continue;
            }
            let (on0, on1, own) = (on0[at], on1[at], constants.block(at));
            let (lever, im, ij) = (own.lever, own.inverse_mass, own.inverse_inertia);
            let (bx0, bx1, by0, by1, bm0, bm1) = (bx0[at], bx1[at], by0[at], by1[at], bm0[at], bm1[at]);
            let BlockForces { x: gx, y: gy, moment: gm, .. } = pushed[at];
            let (cos, sin) = (cos[at], sin[at]);
            let (mut x, mut y, mut turn) = (zero, zero, zero);
            for i in 0..LANES {
                let rear_owns = 1.0 - on0[i];
                let (fx, fy) = (on1[i] * bx1[i], on1[i] * by1[i]);
                let (rx, ry) = (rear_owns * bx0[i], rear_owns * by0[i]);
                let moment = on1[i] * bm1[i] + rear_owns * bm0[i] + gm[i];
                x[i] = (fx + rx + gx[i]) * im[i];
                y[i] = (fy + ry + gy[i]) * im[i];
                turn[i] = (lever[i] * (cos[i] * (fy - ry) - sin[i] * (fx - rx)) + moment) * ij[i];
            }
            (ax[at], ay[at], al[at]) = (x, y, turn);
        }
    }
    if scratch.run_in != RunIn::OFF {
        let rate = scratch.run_in.link_rate_per_s;
        let (ax, ay) = (&mut scratch.ax[..n], &mut scratch.ay[..n]);
        for (own, speed) in c.loops.iter().zip(&model.chain_speeds_m_s) {
            for i in own.clone() {
                ax[i] -= rate * (s.vx[i] - speed * s.cos[i]);
                ay[i] -= rate * (s.vy[i] - speed * s.sin[i]);
            }
        }
    }
    let Scratch {
        mean_front, mean_rear, mean_omega, ax, ay, alpha, joint_ax, joint_ay, joint_alpha, constants, ..
    } = scratch;
    let (cx, cy, ct) = (blocks(ax, count), blocks(ay, count), blocks(alpha, count));
    let (jx, jy, jt) = (blocks(joint_ax, count), blocks(joint_ay, count), blocks(joint_alpha, count));
    let (px, py, pt) = (blocks(&s.ax, count), blocks(&s.ay, count), blocks(&s.alpha, count));
    let (vx, vy, w) = (blocks(&s.vx, count), blocks(&s.vy, count), blocks(&s.omega, count));
    let (mid_x, mid_y) = (blocks(&s.x, count), blocks(&s.y, count));
    let (mean_fx, mean_fy) = (blocks_mut(&mut mean_front.x, count), blocks_mut(&mut mean_front.y, count));
    let (mean_fvx, mean_fvy) = (blocks_mut(&mut mean_front.vx, count), blocks_mut(&mut mean_front.vy, count));
    let (mean_rx, mean_ry) = (blocks_mut(&mut mean_rear.x, count), blocks_mut(&mut mean_rear.y, count));
    let (mean_rvx, mean_rvy) = (blocks_mut(&mut mean_rear.vx, count), blocks_mut(&mut mean_rear.vy, count));
    let turning = blocks_mut(mean_omega, count);
    for at in 0..count {
        let (l, c, sn) = (constants.block(at).lever, cos[at], sin[at]);
        let (cx, cy, ct) = (cx[at], cy[at], ct[at]);
        let (jx, jy, jt) = (jx[at], jy[at], jt[at]);
        let (px, py, pt) = (px[at], py[at], pt[at]);
        let (mut u, mut v, mut o) = (vx[at], vy[at], w[at]);
        let (mid_x, mid_y) = (mid_x[at], mid_y[at]);
        let zero = [0.0; LANES];
        let (mut ax, mut ay, mut bx, mut by) = (zero, zero, zero, zero);
        let (mut avx, mut avy, mut bvx, mut bvy) = (zero, zero, zero, zero);
        for i in 0..LANES {
            let (x, y, t) = (cx[i] + jx[i], cy[i] + jy[i], ct[i] + jt[i]);
            u[i] += quarter * (x + px[i]);
            v[i] += quarter * (y + py[i]);
            o[i] += quarter * (t + pt[i]);
            let (lc, ls) = (l[i] * c[i], l[i] * sn[i]);
            let (oc, os) = (o[i] * lc, o[i] * ls);
            (avx[i], avy[i]) = (u[i] - os, v[i] + oc);
            (bvx[i], bvy[i]) = (u[i] + os, v[i] - oc);
            let (x, y, ts, tc) = (shift * x, shift * y, shift * t * ls, shift * t * lc);
            (ax[i], ay[i]) = ((mid_x[i] + lc) + (x - ts), (mid_y[i] + ls) + (y + tc));
            (bx[i], by[i]) = ((mid_x[i] - lc) + (x + ts), (mid_y[i] - ls) + (y - tc));
        }
        (mean_fx[at], mean_fy[at], mean_rx[at], mean_ry[at]) = (ax, ay, bx, by);
        (mean_fvx[at], mean_fvy[at], mean_rvx[at], mean_rvy[at]) = (avx, avy, bvx, bvy);
        turning[at] = o;
    }
    let LinkEnds { x, y, vx, vy } = mean_rear;
    wrap_loops([x, y, vx, vy, mean_omega], &model.chain);
}

/// Positions and predicted velocities of both ends of every link at the node, and headings, with the first link again after the
/// last, where joint n - 1 closes the loop.
#[inline(always)]
pub(super) fn end_motion(model: &Model, state: &State, scratch: &mut Scratch) {
    let Scratch { front, rear, omega, wrapped, constants, .. } = scratch;
    end_motion_kernel(
        0.5 * model.step_s,
        constants,
        &state.links,
        front,
        rear,
        omega,
        wrapped,
        model.chain.padded / LANES,
    );
    let WrappedColumns { cos, sin, .. } = wrapped;
    let LinkEnds { x, y, vx, vy } = rear;
    wrap_loops([x, y, vx, vy, omega, cos, sin], &model.chain);
}

#[inline(always)]
fn end_motion_kernel(
    half: f64,
    constants: &LinkConstants,
    s: &LinkState,
    front: &mut LinkEnds,
    rear: &mut LinkEnds,
    omega: &mut [f64],
    wrapped: &mut WrappedColumns,
    count: usize,
) {
    let (x, y) = (blocks(&s.x, count), blocks(&s.y, count));
    let (cos, sin) = (blocks(&s.cos, count), blocks(&s.sin, count));
    let (vx, vy, w) = (blocks(&s.vx, count), blocks(&s.vy, count), blocks(&s.omega, count));
    let (ax, ay, alpha) = (blocks(&s.ax, count), blocks(&s.ay, count), blocks(&s.alpha, count));
    let (fx, fy) = (blocks_mut(&mut front.x, count), blocks_mut(&mut front.y, count));
    let (fvx, fvy) = (blocks_mut(&mut front.vx, count), blocks_mut(&mut front.vy, count));
    let (rx, ry) = (blocks_mut(&mut rear.x, count), blocks_mut(&mut rear.y, count));
    let (rvx, rvy) = (blocks_mut(&mut rear.vx, count), blocks_mut(&mut rear.vy, count));
    let omega = blocks_mut(omega, count);
    let (wrapped_cos, wrapped_sin) = (blocks_mut(&mut wrapped.cos, count), blocks_mut(&mut wrapped.sin, count));
    for at in 0..count {
        let (l, c, s) = (constants.block(at).lever, cos[at], sin[at]);
        let (a, b, e) = (ax[at], ay[at], alpha[at]);
        let (px, py) = (x[at], y[at]);
        let (mut u, mut v, mut o) = (vx[at], vy[at], w[at]);
        let zero = [0.0; LANES];
        let (mut ax, mut ay, mut avx, mut avy) = (zero, zero, zero, zero);
        let (mut bx, mut by, mut bvx, mut bvy) = (zero, zero, zero, zero);
        for i in 0..LANES {
            u[i] += half * a[i];
            v[i] += half * b[i];
            o[i] += half * e[i];
            let (lc, ls) = (l[i] * c[i], l[i] * s[i]);
            let (oc, os) = (o[i] * lc, o[i] * ls);
            (ax[i], ay[i]) = (px[i] + lc, py[i] + ls);
            (bx[i], by[i]) = (px[i] - lc, py[i] - ls);
            (avx[i], avy[i]) = (u[i] - os, v[i] + oc);
            (bvx[i], bvy[i]) = (u[i] + os, v[i] - oc);
        }
        (fx[at], fy[at], fvx[at], fvy[at]) = (ax, ay, avx, avy);
        (rx[at], ry[at], rvx[at], rvy[at]) = (bx, by, bvx, bvy);
        omega[at] = o;
        (wrapped_cos[at], wrapped_sin[at]) = (c, s);
    }
}

/// Forces of the joints from the mean ends and speeds, and the accelerations that these add to those from contacts.
#[inline(always)]
pub(super) fn apply_joints(model: &Model, state: &State, scratch: &mut Scratch) {
    joint_forces(model, scratch);
    let (s, count) = (&state.links, model.chain.padded / LANES);
    let Scratch { joint_x, joint_y, joint_torque, ax, ay, alpha, constants, .. } = &mut *scratch;
    let (fx0, fx1) = (blocks(joint_x.shifted(), count), blocks(joint_x.values(), count));
    let (fy0, fy1) = (blocks(joint_y.shifted(), count), blocks(joint_y.values(), count));
    let (fm0, fm1) = (blocks(joint_torque.shifted(), count), blocks(joint_torque.values(), count));
    let (cos, sin) = (blocks(&s.cos, count), blocks(&s.sin, count));
    let (ax, ay, alpha) = (blocks_mut(ax, count), blocks_mut(ay, count), blocks_mut(alpha, count));
    for at in 0..count {
        let (fx0, fx1, fy0, fy1, fm0, fm1) = (fx0[at], fx1[at], fy0[at], fy1[at], fm0[at], fm1[at]);
        let (cos, sin, own) = (cos[at], sin[at], constants.block(at));
        let (lever, im, ij) = (own.lever, own.inverse_mass, own.inverse_inertia);
        let (mut a, mut b, mut e) = (ax[at], ay[at], alpha[at]);
        for i in 0..LANES {
            let (sum_x, sum_y) = (fx0[i] + fx1[i], fy0[i] + fy1[i]);
            a[i] += (fx0[i] - fx1[i]) * im[i];
            b[i] += (fy0[i] - fy1[i]) * im[i];
            e[i] += (lever[i] * (sin[i] * sum_x - cos[i] * sum_y) + (fm0[i] - fm1[i])) * ij[i];
        }
        (ax[at], ay[at], alpha[at]) = (a, b, e);
    }
    tight_joints(model, scratch);
}

/// Forces of the joints and the power they lose, from the mean ends and speeds.
#[inline(always)]
fn joint_forces(model: &Model, scratch: &mut Scratch) {
    let c = &model.chain;
    let count = c.padded / LANES;
    let Scratch {
        mean_front: front,
        mean_rear: rear,
        mean_omega: omega,
        joint_x,
        joint_y,
        joint_torque,
        joint_power_damping,
        joint_power_friction,
        joint_limit,
        constants,
        ..
    } = scratch;
    let ends = JointEnds::new([&front.x, &front.y, &front.vx, &front.vy], [&rear.x, &rear.y, &rear.vx, &rear.vy]);
    let (w0, w1) = (blocks(omega, count), blocks(&omega[1..], count));
    {
        let (fx, fy) = (blocks_mut(joint_x.values_mut(), count), blocks_mut(joint_y.values_mut(), count));
        let (fm, limits) = (blocks_mut(joint_torque.values_mut(), count), blocks_mut(joint_limit, count));
        let (pd, pf) = (blocks_mut(joint_power_damping, count), blocks_mut(joint_power_friction, count));
        for (joint, own) in joint_laws(c) {
            let (arm, per_speed) = (joint.friction_arm_m, 1.0 / joint.stick_speed_rad_s);
            for at in own.start..own.end.min(count) {
                let force = ends.block(&joint, at, count);
                let (mut torque, mut lost, mut limit) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
                if arm > 0.0 {
                    let (w0, w1, slope) = (w0[at], w1[at], constants.block(at).friction_slope);
                    for i in 0..LANES {
                        let relative = w1[i] - w0[i];
                        limit[i] = arm * (force.x[i] * force.x[i] + force.y[i] * force.y[i]).sqrt();
                        torque[i] =
                            friction::force_with_slope_limit(limit[i], relative, limit[i] * per_speed, slope[i]);
                        lost[i] = 0.0 - torque[i] * relative;
                    }
                }
                (fx[at], fy[at], fm[at], limits[at]) = (force.x, force.y, torque, limit);
                (pd[at], pf[at]) = (force.lost, lost);
            }
        }
    }
    JointColumn::wrap_loops([joint_x, joint_y, joint_torque], c);
}

/// Friction of the joints that turn hard, beside that of all.
#[inline(always)]
fn tight_joints(model: &Model, scratch: &mut Scratch) {
    let c = &model.chain;
    for (j, torque_nm) in &c.tight {
        let (j, next) = (*j, c.next(*j));
        let relative = scratch.mean_omega[j + 1] - scratch.mean_omega[j];
        let inverse = &c.inverse_inertia;
        let mobility = 0.5 * model.step_s * (inverse[j] + inverse[j + 1]);
        let own = link_joint::tightened(c.joint(j), *torque_nm, relative, mobility);
        scratch.joint_limit[j] += *torque_nm;
        scratch.joint_torque.values_mut()[j] += own;
        JointColumn::wrap_loops([&mut scratch.joint_torque], c);
        scratch.joint_power_friction[j] -= own * relative;
        scratch.alpha[j] -= own * inverse[j];
        scratch.alpha[next] += own * inverse[next];
    }
}
