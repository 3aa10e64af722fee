//! The part of a step that concerns links' own contours: abutments and toothed flanks. Geometry link by link, forces many
//! at a time; what is near which body is looked up with the other windows.

use super::guides::{add_guide_forces, load_ends};
use super::watch::Noted;
use super::{LANES, Part, Scratch, WINDOW_MARGIN_M, Window, recall};
use crate::elements::end_contact::{EndBody, EndTouch, LinkPose};
use crate::elements::tooth_contact::{self, Lanes, OffJoint};
use crate::geometry::{Vec2, perp};
use crate::model::Model;
use crate::state::State;

/// Contacts of all bodies that ends of links touch.
#[inline(never)]
pub(super) fn contacts(model: &Model, state: &State, scratch: &mut Scratch) {
    let Some(contour) = &model.contour else { return };
    let reach_m = 2.0 * scratch.fastest_m_s * model.step_s;
    let mut own_lanes = scratch.lanes.take().unwrap_or_default();
    for k in 0..model.end_bodies.len() {
        let body = &model.end_bodies[k];
        let (rotor, omega) = turning(model, state, body);
        for w in 0..scratch.end_windows[k].len() {
            let Window { start, end, .. } = scratch.end_windows[k][w];
            for block in start / LANES..end / LANES {
                let at = block * LANES;
                for rear in 0..2 {
                    let sign = if rear == 0 { 1.0 } else { -1.0 };
                    let set = 2 * body.set + rear;
                    let mut touches: [Option<EndTouch>; LANES] = [None; LANES];
                    let mut near = false;
                    for (i, touch) in touches.iter_mut().enumerate() {
                        let link = at + i;
                        if link >= model.chain.n_links || scratch.nearest_end[body.set][link] != k {
                            continue;
                        }
                        *touch = body.touch(contour, &pose(model, state, body, link, rear == 0), rotor, reach_m);
                        near |= touch.is_some();
                        near |= state.contour_ends[set].age[link] != 0.0;
                    }
                    let lanes = &mut *own_lanes;
                    if near {
                        load_ends(model, scratch, at, sign, body.origin, lanes);
                        let mut off = OffJoint::default();
                        off.alpha.copy_from_slice(&scratch.wrapped.alpha[at..at + LANES]);
                        place(&touches, lanes, &mut off);
                        for (tooth, touch) in scratch.contour_tooth[set][at..].iter_mut().zip(&touches) {
                            *tooth = touch.map_or(*tooth, |t| t.tooth);
                        }
                        recall(&state.contour_ends[set], at, lanes);
                        let (mu, stick) = (body.friction, body.stick_speed_m_s);
                        tooth_contact::contour_forces(&body.law, mu, stick, model.step_s, omega, &off, lanes);
                        add_guide_forces(scratch, at, lanes);
                        watch(model, scratch, (k, set, at), &touches, (&off, lanes));
                        if let Some(rotor) = body.rotor {
                            scratch.chain_torque[rotor] += lanes.torque.iter().sum::<f64>();
                        }
                    } else {
                        lanes.let_go();
                    }
                    keep(model, state, scratch, k, set, at, lanes);
                }
            }
        }
    }
    scratch.lanes = Some(own_lanes);
}

/// Cosine and sine of the angle of a body, and its speed at the node.
pub(crate) fn turning(model: &Model, state: &State, body: &EndBody) -> ((f64, f64), f64) {
    match body.rotor {
        None => ((1.0, 0.0), 0.0),
        Some(r) => {
            let s = &state.rotors;
            ((s.cos[r], s.sin[r]), s.omega[r] + 0.5 * model.step_s * s.alpha[r])
        }
    }
}

/// Pose of a link's end for a body.
pub(crate) fn pose(model: &Model, state: &State, body: &EndBody, link: usize, front: bool) -> LinkPose {
    let l = &state.links;
    let lever = model.chain.lever[link];
    LinkPose {
        centre: Vec2::new(l.x[link], l.y[link]) - body.origin,
        cos: l.cos[link],
        sin: l.sin[link],
        lever: if front { lever } else { -lever },
        front,
        row: link % model.rows.len(),
    }
}

/// Contact points as the forces need them.
fn place(touches: &[Option<EndTouch>; LANES], lanes: &mut Lanes, off: &mut OffJoint) {
    for (i, touch) in touches.iter().enumerate() {
        let Some(t) = touch else {
            // Further off than any speed brings it back: padding has a kilometre for an arm.
            (lanes.penetration[i], lanes.normal_x[i], lanes.normal_y[i]) = (-1e9, 0.0, 1.0);
            (off.radius[i], off.offset[i], lanes.body_radius[i]) = (0.0, 0.0, 0.0);
            continue;
        };
        let from_joint = t.point - Vec2::new(lanes.x[i], lanes.y[i]);
        lanes.penetration[i] = t.penetration_m;
        (lanes.normal_x[i], lanes.normal_y[i]) = (t.normal.x, t.normal.y);
        off.radius[i] = -from_joint.dot(&t.normal);
        off.offset[i] = from_joint.dot(&perp(t.normal));
        lanes.body_radius[i] = t.body_radius_m;
    }
}

/// For those who look at every step.
fn watch(
    model: &Model,
    scratch: &mut Scratch,
    (k, set, at): (usize, usize, usize),
    touches: &[Option<EndTouch>; LANES],
    (off, lanes): (&OffJoint, &Lanes),
) {
    let Some(watched) = &mut scratch.watched else { return };
    let (body, n) = (&model.end_bodies[k], model.chain.n_links);
    let nearest = &scratch.nearest_end[body.set];
    let own = std::array::from_fn(|i| at + i < n && nearest[at + i] == k);
    let part = Part::Contours(set);
    if watched.wants_segments() {
        let segments = touches.map(|touch| touch.map_or(0.0, |t| f64::from(t.segment as u32)));
        watched.note_segments(part, at, segments, Some(&own));
    }
    let (law, mu, off) = (&body.law, body.friction, Some(off));
    watched.note(&Noted { part, at, law, mu, lanes, radius: 0.0, off, rotor: body.rotor }, Some(&own));
}

/// Gives memory back to its columns, for the lanes that are this body's.
fn keep(model: &Model, state: &State, scratch: &mut Scratch, k: usize, set: usize, at: usize, lanes: &Lanes) {
    let (past, memory) = (&state.contour_ends[set], &mut scratch.contour_ends[set]);
    for i in 0..LANES {
        let link = at + i;
        if link < model.chain.n_links && scratch.nearest_end[set / 2][link] == k {
            memory.normal_force[link] = lanes.normal_force[i];
            memory.tangential_force[link] = lanes.tangential_force[i];
            memory.age[link] = lanes.age[i];
            memory.approach[link] = lanes.approach[i];
            memory.lost_damping[link] = past.lost_damping[link] + lanes.lost_damping[i];
            memory.lost_friction[link] = past.lost_friction[link] + lanes.lost_friction[i];
            scratch.contour_rate[set][link] = lanes.rate[i];
            scratch.contour_depth[set][link] = lanes.penetration[i];
        }
    }
}

/// Links near each body, and for every set the nearest body of each link.
pub(super) fn refresh(model: &Model, state: &State, scratch: &mut Scratch) {
    scratch.contour_ends.clone_from(&state.contour_ends);
    let n = model.chain.n_links;
    let distance = |body: &EndBody, link: usize| {
        body.distance_m(Vec2::new(state.links.x[link], state.links.y[link]) - body.origin)
    };
    for (k, body) in model.end_bodies.iter().enumerate() {
        let reach = body.reach_m(model.chain.lever[0]) + WINDOW_MARGIN_M;
        let near = |link: usize| distance(body, link) < reach;
        scratch.end_windows[k] = super::windows::aligned_windows(n, model.chain.padded, near);
    }
    for set in 0..scratch.nearest_end.len() {
        for link in 0..n {
            let gap = |k: &usize| {
                let body = &model.end_bodies[*k];
                distance(body, link) - body.reach_m(model.chain.lever[0])
            };
            let of_set = (0..model.end_bodies.len()).filter(|k| model.end_bodies[*k].set == set);
            scratch.nearest_end[set][link] = of_set.min_by(|a, b| gap(a).total_cmp(&gap(b))).unwrap_or(usize::MAX);
        }
    }
}
