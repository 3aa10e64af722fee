//! The part of a step that concerns links' own contours: abutments and toothed flanks. Many ends at a time; what is near which
//! body is looked up with the other windows.

use super::abutments::{self, Faced};
use super::flanks::{self, Flanked};
use super::guides::{add_guide_forces, load_ends};
use super::watch::Noted;
use super::{LANES, MemoryBlocks, Part, Scratch, WINDOW_MARGIN_M, Window, put, sum, take};
use crate::elements::arc_lanes::{Feet, Found, NOTHING_M};
use crate::elements::end_contact::{EndBody, LinkContour, LinkPose, Seats};
use crate::elements::tooth_contact::{self, Column, Lanes, Mask, OffJoint, any, mask};
use crate::geometry::Vec2;
use crate::model::Model;
use crate::state::{ContactMemory, State};

/// One end of a block of links and one of the bodies that it may touch.
pub(super) struct EndBlock {
    /// Lanes whose nearest body of its kind this is, and whether these are all that hold a link.
    pub(super) own: Mask,
    pub(super) all_own: bool,
    faces: Faces,
}

/// What a block of ends touches with.
enum Faces {
    Abutments(Box<Faced>),
    Flanks(Box<Flanked>),
}

impl EndBlock {
    /// Front and rear ends of every block of links, as the body `body` meets them.
    pub(super) fn all(model: &Model, body: &EndBody, count: usize) -> Vec<[EndBlock; 2]> {
        let faces = |block: usize, front: bool| match &model.contour {
            Some(LinkContour::Flanks(rows)) => Faces::Flanks(Box::new(Flanked::new(body, rows, block * LANES, front))),
            Some(LinkContour::Abutments { front: ahead, rear }) => {
                Faces::Abutments(Box::new(Faced::new(body, if front { ahead } else { rear })))
            }
            None => Faces::Abutments(Box::default()),
        };
        let end = |block, front| EndBlock { own: [0; LANES], all_own: false, faces: faces(block, front) };
        (0..count).map(|block| [end(block, true), end(block, false)]).collect()
    }
}

/// One end of a block of links, and the body that it may touch.
pub(super) struct Seen<'a> {
    pub(super) model: &'a Model,
    pub(super) state: &'a State,
    pub(super) body: &'a EndBody,
    pub(super) at: usize,
    pub(super) front: bool,
    /// Cosine and sine of the sprocket's angle.
    pub(super) rotor: (f64, f64),
    /// Gap beyond which nothing is of interest [m].
    pub(super) far_m: f64,
}

/// Centres of links from the body's origin, and their headings.
pub(super) struct Poses {
    pub(super) x: Column,
    pub(super) y: Column,
    pub(super) cos: Column,
    pub(super) sin: Column,
}

impl Poses {
    #[inline(always)]
    pub(super) fn of(seen: &Seen<'_>) -> Poses {
        let (l, at) = (&seen.state.links, seen.at);
        let (mut x, mut y) = (take(&l.x, at), take(&l.y, at));
        for i in 0..LANES {
            x[i] -= seen.body.origin.x;
            y[i] -= seen.body.origin.y;
        }
        Poses { x, y, cos: take(&l.cos, at), sin: take(&l.sin, at) }
    }

    /// Directions into the frames of the links.
    #[inline(always)]
    pub(super) fn link_frame(&self, x: &Column, y: &Column) -> (Column, Column) {
        let mut out = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            out.0[i] = self.cos[i] * x[i] + self.sin[i] * y[i];
            out.1[i] = self.cos[i] * y[i] - self.sin[i] * x[i];
        }
        out
    }

    #[inline(always)]
    pub(super) fn world_frame(&self, x: &Column, y: &Column) -> (Column, Column) {
        let mut out = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            out.0[i] = self.cos[i] * x[i] - self.sin[i] * y[i];
            out.1[i] = self.sin[i] * x[i] + self.cos[i] * y[i];
        }
        out
    }

    /// The body's origin in the frames of the links.
    #[inline(always)]
    pub(super) fn origin(&self) -> (Column, Column) {
        let (mut x, mut y) = (self.x, self.y);
        for i in 0..LANES {
            (x[i], y[i]) = (-x[i], -y[i]);
        }
        self.link_frame(&x, &y)
    }

    /// Points and normals of the links in the world.
    #[inline(always)]
    pub(super) fn put(&self, feet: &Feet, found: &mut Found) {
        let (px, py) = self.world_frame(&feet.point_x, &feet.point_y);
        let (nx, ny) = self.world_frame(&feet.normal_x, &feet.normal_y);
        for i in 0..LANES {
            (found.point_x[i], found.point_y[i]) = (self.x[i] + px[i], self.y[i] + py[i]);
            (found.normal_x[i], found.normal_y[i]) = (-nx[i], -ny[i]);
        }
    }

    /// The joints at the ends.
    #[inline(always)]
    pub(super) fn joints(&self, seen: &Seen<'_>) -> (Column, Column) {
        let lever = take(&seen.model.chain.lever, seen.at);
        let mut out = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let lever = if seen.front { lever[i] } else { -lever[i] };
            (out.0[i], out.1[i]) = (self.x[i] + self.cos[i] * lever, self.y[i] + self.sin[i] * lever);
        }
        out
    }
}

/// The tooth gaps that joints are in: number, and direction of the axis in the sprocket's frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Seated {
    pub(super) seat: [u32; LANES],
    cos: Column,
    sin: Column,
    /// Tangent of how far off an axis it is surely the nearest.
    sure_tan: f64,
}

impl Seated {
    pub(super) fn new(seats: &Seats) -> Seated {
        Seated { sure_tan: seats.sure_tan(), ..Seated::default() }
    }

    /// Directions of the axes in the world.
    #[inline(always)]
    pub(super) fn axes(&self, (c, s): (f64, f64)) -> (Column, Column) {
        let mut out = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            out.0[i] = c * self.cos[i] - s * self.sin[i];
            out.1[i] = s * self.cos[i] + c * self.sin[i];
        }
        out
    }

    /// Looks up the gaps of the lanes of `near` that have left theirs.
    #[inline(always)]
    pub(super) fn settle(&mut self, seats: &Seats, rotor: (f64, f64), near: &Mask, (x, y): (&Column, &Column)) {
        let (gx, gy) = self.axes(rotor);
        let mut strayed = [0; LANES];
        for i in 0..LANES {
            let (along, across) = (x[i] * gx[i] + y[i] * gy[i], gx[i] * y[i] - gy[i] * x[i]);
            strayed[i] = near[i] & !mask(across.abs() < self.sure_tan * along);
        }
        if any(&strayed) {
            for i in (0..LANES).filter(|i| strayed[*i] != 0) {
                let seat = seats.nearest(Vec2::new(x[i], y[i]), rotor).0;
                (self.cos[i], self.sin[i]) = seats.direction(seat);
                self.seat[i] = seat as u32;
            }
        }
    }
}

/// Contacts of all bodies that ends of links touch.
#[inline(always)]
pub(super) fn contacts<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch) {
    let Some(contour) = &model.contour else { return };
    let reach_m = 2.0 * scratch.fastest_m_s * model.step_s;
    let count = model.chain.padded / LANES;
    let mut own_lanes = scratch.lanes.take().unwrap_or_default();
    let lanes = &mut *own_lanes;
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
                    let end = &mut scratch.end_blocks[k][block][rear];
                    let (own, all_own, front) = (end.own, end.all_own, rear == 0);
                    if !any(&own) {
                        continue;
                    }
                    let mut found = Found::nothing();
                    let seen = Seen { model, state, body, at, front, rotor, far_m: reach_m };
                    let near = match (&mut end.faces, contour) {
                        (Faces::Abutments(faced), LinkContour::Abutments { front: ahead, rear: behind }) => {
                            let abutment = if front { ahead } else { behind };
                            abutments::touches(&seen, abutment, &own, faced, &mut found)
                        }
                        (Faces::Flanks(flanked), _) => flanks::touches(&seen, &own, flanked, &mut found),
                        _ => false,
                    };
                    let ages = take(&state.contour_ends[set].age, at);
                    let held = any(&std::array::from_fn(|i| own[i] & mask(ages[i] != 0.0)));
                    if !near && !held && all_own {
                        forget(&state.contour_ends[set], scratch, set, block);
                        continue;
                    }
                    if near || held {
                        load_ends(model, scratch, at, sign, body.origin, lanes);
                        recall(&state.contour_ends[set], at, lanes);
                        act::<WATCHED>(model, scratch, (k, set, at), omega, &found, lanes);
                    } else {
                        lanes.let_go();
                    }
                    if all_own {
                        keep(&state.contour_ends[set], scratch, set, block, lanes);
                        put(&mut scratch.contour_rate[set], at, lanes.rate);
                        put(&mut scratch.contour_depth[set], at, lanes.penetration);
                    } else {
                        let nearest = &scratch.nearest_end[body.set][at..at + LANES];
                        for i in (0..LANES).filter(|i| own[*i] != 0) {
                            scratch.contour_rate[set][at + i] = lanes.rate[i];
                            scratch.contour_depth[set][at + i] = lanes.penetration[i];
                        }
                        let (now, stale) = (&mut scratch.contour_ends[set], &mut scratch.stale_ends[set]);
                        MemoryBlocks::new(&state.contour_ends[set], now, stale, count)
                            .keep_own(nearest, k, block, lanes);
                    }
                }
            }
        }
    }
    scratch.lanes = Some(own_lanes);
}

/// Forces of a block of ends on body `k`, from where they touch it.
#[inline(always)]
fn act<const WATCHED: bool>(
    model: &Model,
    scratch: &mut Scratch,
    (k, set, at): (usize, usize, usize),
    omega: f64,
    found: &Found,
    lanes: &mut Lanes,
) {
    let body = &model.end_bodies[k];
    let mut off = OffJoint { alpha: take(&scratch.wrapped.alpha, at), ..OffJoint::default() };
    place(found, lanes, &mut off);
    let teeth = &mut scratch.contour_tooth[set].as_chunks_mut::<LANES>().0[at / LANES];
    for i in 0..LANES {
        teeth[i] = if found.penetration[i] != NOTHING_M { found.tooth[i] } else { teeth[i] };
    }
    let (mu, stick) = (body.friction, body.stick_speed_m_s);
    tooth_contact::contour_forces(&body.law, mu, stick, model.step_s, omega, &off, lanes);
    add_guide_forces(scratch, at, lanes);
    if WATCHED {
        watch(model, scratch, (k, set, at), found, (&off, lanes));
    }
    if let Some(rotor) = body.rotor {
        scratch.chain_torque[rotor] += lanes.torque.iter().sum::<f64>();
    }
}

#[inline(always)]
fn recall(past: &ContactMemory, at: usize, lanes: &mut Lanes) {
    lanes.normal_force = take(&past.normal_force, at);
    lanes.tangential_force = take(&past.tangential_force, at);
    lanes.age = take(&past.age, at);
    lanes.approach = take(&past.approach, at);
}

/// Gives the contact memory of a block back to its columns. Column by column: views of all of them, as bushes have, cost more than
/// the few blocks of ends give back.
#[inline(always)]
fn keep(past: &ContactMemory, scratch: &mut Scratch, set: usize, block: usize, lanes: &Lanes) {
    let (now, at) = (&mut scratch.contour_ends[set], block * LANES);
    put(&mut now.normal_force, at, lanes.normal_force);
    put(&mut now.tangential_force, at, lanes.tangential_force);
    put(&mut now.age, at, lanes.age);
    put(&mut now.approach, at, lanes.approach);
    put(&mut now.lost_damping, at, sum(take(&past.lost_damping, at), lanes.lost_damping));
    put(&mut now.lost_friction, at, sum(take(&past.lost_friction, at), lanes.lost_friction));
    scratch.stale_ends[set][block] = 2;
}

/// Forgets the old contacts of a block that nothing touches. State and Scratch swap their memories at every step: each is cleared once.
#[inline(always)]
fn forget(past: &ContactMemory, scratch: &mut Scratch, set: usize, block: usize) {
    let stale = &mut scratch.stale_ends[set][block];
    if *stale == 0 {
        return;
    }
    *stale -= 1;
    let (now, at, nothing) = (&mut scratch.contour_ends[set], block * LANES, [0.0; LANES]);
    put(&mut now.normal_force, at, nothing);
    put(&mut now.tangential_force, at, nothing);
    put(&mut now.age, at, nothing);
    put(&mut now.approach, at, nothing);
    put(&mut now.lost_damping, at, take(&past.lost_damping, at));
    put(&mut now.lost_friction, at, take(&past.lost_friction, at));
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
#[inline(always)]
fn place(found: &Found, lanes: &mut Lanes, off: &mut OffJoint) {
    for i in 0..LANES {
        let touches = found.penetration[i] != NOTHING_M;
        let (nx, ny) = (found.normal_x[i], found.normal_y[i]);
        let (dx, dy) = (found.point_x[i] - lanes.x[i], found.point_y[i] - lanes.y[i]);
        off.radius[i] = if touches { -(dx * nx + dy * ny) } else { 0.0 };
        off.offset[i] = if touches { dx * -ny + dy * nx } else { 0.0 };
        lanes.penetration[i] = found.penetration[i];
        lanes.normal_x[i] = if touches { nx } else { 0.0 };
        lanes.normal_y[i] = if touches { ny } else { 1.0 };
        lanes.body_radius[i] = if touches { found.body_radius[i] } else { 0.0 };
    }
}

/// For those who look at every step.
fn watch(
    model: &Model,
    scratch: &mut Scratch,
    (k, set, at): (usize, usize, usize),
    found: &Found,
    (off, lanes): (&OffJoint, &Lanes),
) {
    let Some(watched) = &mut scratch.watched else { return };
    let (body, n) = (&model.end_bodies[k], model.chain.n_links);
    let nearest = &scratch.nearest_end[body.set];
    let own = std::array::from_fn(|i| at + i < n && nearest[at + i] == k);
    let part = Part::Contours(set);
    if watched.wants_segments() {
        let segment = |i: usize| {
            if found.penetration[i] == NOTHING_M { 0.0 } else { found.segment[i] }
        };
        watched.note_segments(part, at, std::array::from_fn(segment), Some(&own));
    }
    let (law, mu, off) = (&body.law, body.friction, Some(off));
    watched.note(&Noted { part, at, law, mu, lanes, radius: 0.0, off, rotor: body.rotor }, Some(&own));
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
    for (k, body) in model.end_bodies.iter().enumerate() {
        let nearest = &scratch.nearest_end[body.set];
        for block in scratch.end_windows[k].iter().flat_map(|w| w.start / LANES..w.end / LANES) {
            let own: Mask = std::array::from_fn(|i| mask(nearest[block * LANES + i] == k));
            let all_own = (0..LANES).all(|i| own[i] != 0 || block * LANES + i >= n);
            for end in &mut scratch.end_blocks[k][block] {
                (end.own, end.all_own) = (own, all_own);
            }
        }
    }
    for (memory, blocks) in state.contour_ends.iter().zip(&mut scratch.stale_ends) {
        super::windows::stale(memory, blocks);
    }
}
