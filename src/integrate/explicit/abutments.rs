//! Abutments on rings, lobes and guide faces: a block of ends at a time, from what they faced in the step before.

use super::LANES;
use super::ends::{EndBlock, Found, pose};
use crate::elements::arc_lanes::{Feet, FootLanes, Pair, PairLanes, SupportLanes, sure_arcs};
use crate::elements::end_contact::{EndBody, EndShape, LinkContour, Seats};
use crate::elements::tooth_contact::{Column, take};
use crate::geometry::smartchain::contour::Contour;
use crate::geometry::smartchain::ring::LobedRing;
use crate::geometry::{Vec2, perp};
use crate::model::Model;
use crate::recording::frame::Segment;
use crate::state::State;
use std::sync::Arc;

/// What a block of ends faced last. Changes no bit: see [`crate::elements::arc_lanes`].
#[derive(Clone, Debug, Default)]
pub(super) struct Faced {
    feet: FootLanes,
    support: SupportLanes,
    pairs: PairLanes,
    /// Tooth gaps of the joints: number, direction of the axis in the sprocket's frame, and how far off it is surely the nearest.
    seat: [usize; LANES],
    seat_cos: Column,
    seat_sin: Column,
    seat_tan: f64,
    /// Arcs of the abutment that touch a lobe in one place only.
    sure: Arc<[bool]>,
}

impl Faced {
    pub(super) fn new(body: &EndBody, abutment: &Contour) -> Faced {
        let EndShape::Lobes { ring, seats, .. } = &body.shape else { return Faced::default() };
        let seat_tan = seats.sure_tan();
        Faced { seat_tan, sure: sure_arcs(abutment, ring).into(), ..Faced::default() }
    }
}

/// One end of a block of links, and the body that it may touch.
pub(super) struct Seen<'a> {
    pub(super) model: &'a Model,
    pub(super) state: &'a State,
    pub(super) body: &'a EndBody,
    pub(super) contour: &'a LinkContour,
    pub(super) abutment: &'a Contour,
    pub(super) at: usize,
    pub(super) front: bool,
    /// Cosine and sine of the sprocket's angle.
    pub(super) rotor: (f64, f64),
    /// Gap beyond which nothing is of interest [m].
    pub(super) far_m: f64,
}

/// Centres of links from the body's origin, and their headings.
struct Poses {
    x: Column,
    y: Column,
    cos: Column,
    sin: Column,
}

impl Poses {
    #[inline(always)]
    fn of(seen: &Seen<'_>) -> Poses {
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
    fn into_link(&self, x: &Column, y: &Column) -> (Column, Column) {
        let mut out = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            out.0[i] = self.cos[i] * x[i] + self.sin[i] * y[i];
            out.1[i] = self.cos[i] * y[i] - self.sin[i] * x[i];
        }
        out
    }

    #[inline(always)]
    fn into_world(&self, x: &Column, y: &Column) -> (Column, Column) {
        let mut out = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            out.0[i] = self.cos[i] * x[i] - self.sin[i] * y[i];
            out.1[i] = self.sin[i] * x[i] + self.cos[i] * y[i];
        }
        out
    }

    /// The body's origin in the frames of the links.
    #[inline(always)]
    fn origin(&self) -> (Column, Column) {
        let (mut x, mut y) = (self.x, self.y);
        for i in 0..LANES {
            (x[i], y[i]) = (-x[i], -y[i]);
        }
        self.into_link(&x, &y)
    }

    /// Points and normals of the links in the world, for the lanes that `touches` names.
    #[inline(always)]
    fn put(&self, touches: &[bool; LANES], point: [&Column; 2], normal: [&Column; 2], found: &mut Found) {
        let (px, py) = self.into_world(point[0], point[1]);
        let (nx, ny) = self.into_world(normal[0], normal[1]);
        for i in (0..LANES).filter(|i| touches[*i]) {
            (found.point_x[i], found.point_y[i]) = (self.x[i] + px[i], self.y[i] + py[i]);
            (found.normal_x[i], found.normal_y[i]) = (-nx[i], -ny[i]);
        }
    }
}

#[inline(always)]
fn any(lanes: &[bool; LANES]) -> bool {
    lanes.iter().fold(false, |any, lane| any | *lane)
}

#[inline(always)]
fn both(a: &[bool; LANES], b: &[bool; LANES]) -> [bool; LANES] {
    std::array::from_fn(|i| a[i] & b[i])
}

/// Touches of a block. Returns whether there is any.
#[inline(always)]
pub(super) fn touches(seen: &Seen<'_>, end: &mut EndBlock, found: &mut Found) -> bool {
    let own = end.own;
    let Some(faced) = &mut end.faced else { return false };
    match &seen.body.shape {
        EndShape::Circle { radius_m } => circle(seen, *radius_m, &own, faced, found),
        EndShape::Lobes { ring, seats, turn } => lobes(seen, (ring, seats, *turn), &own, faced, found),
        EndShape::Face { along, length_m } => face(seen, *along, *length_m, &own, faced, found),
        EndShape::OuterFlanks { .. } | EndShape::InnerFlanks { .. } => false,
    }
}

/// Feet of the perpendiculars from the body's origin; what each lane faces is looked up where it has changed.
#[inline(always)]
fn feet(seen: &Seen<'_>, own: &[bool; LANES], (x, y): (&Column, &Column), lanes: &mut FootLanes) -> Feet {
    let (feet, mut strayed) = (lanes.feet(x, y), lanes.strayed(x, y));
    for i in 0..LANES {
        // Inside of a contour signs do not tell all.
        strayed[i] = own[i] & (strayed[i] | !(feet.distance[i] > 0.0));
    }
    if !any(&strayed) {
        return feet;
    }
    for i in (0..LANES).filter(|i| strayed[*i]) {
        lanes.search(i, seen.abutment, Vec2::new(x[i], y[i]));
    }
    lanes.feet(x, y)
}

#[inline(always)]
fn circle(seen: &Seen<'_>, radius_m: f64, own: &[bool; LANES], faced: &mut Faced, found: &mut Found) -> bool {
    let poses = Poses::of(seen);
    let (x, y) = poses.origin();
    let feet = feet(seen, own, (&x, &y), &mut faced.feet);
    let mut near = [false; LANES];
    for i in 0..LANES {
        let penetration = radius_m - feet.distance[i];
        near[i] = own[i] & (penetration > -seen.far_m);
        found.penetration[i] = if near[i] { penetration } else { found.penetration[i] };
    }
    if !any(&near) {
        return false;
    }
    poses.put(&near, [&feet.point_x, &feet.point_y], [&feet.normal_x, &feet.normal_y], found);
    found.body_radius = [radius_m; LANES];
    for i in (0..LANES).filter(|i| near[*i] & (faced.feet.radius[*i] == 0.0)) {
        search(seen, i, found);
    }
    true
}

/// By the search that knows nothing: of what is rare.
#[cold]
#[inline(never)]
fn search(seen: &Seen<'_>, i: usize, found: &mut Found) {
    let pose = pose(seen.model, seen.state, seen.body, seen.at + i, seen.front);
    found.put(i, seen.body.touch(seen.contour, &pose, seen.rotor, seen.far_m));
}

#[inline(always)]
fn face(
    seen: &Seen<'_>,
    along: Vec2,
    length_m: f64,
    own: &[bool; LANES],
    faced: &mut Faced,
    found: &mut Found,
) -> bool {
    let poses = Poses::of(seen);
    let up = perp(along);
    // Down into the face, as the links see it.
    let (x, y) = poses.into_link(&[-up.x; LANES], &[-up.y; LANES]);
    let strayed = both(own, &faced.support.strayed(&x, &y));
    if any(&strayed) {
        for i in (0..LANES).filter(|i| strayed[*i]) {
            faced.support.search(i, seen.abutment, Vec2::new(x[i], y[i]));
        }
    }
    let (px, py) = faced.support.points(&x, &y);
    let (wx, wy) = poses.into_world(&px, &py);
    let (mut near, mut beyond) = ([false; LANES], [false; LANES]);
    for i in 0..LANES {
        let height = px[i] * x[i] + py[i] * y[i];
        let penetration = height - (poses.x[i] * up.x + poses.y[i] * up.y);
        near[i] = own[i] & !(penetration < -seen.far_m);
        found.penetration[i] = if near[i] { penetration } else { found.penetration[i] };
        let (qx, qy) = (poses.x[i] + wx[i], poses.y[i] + wy[i]);
        let at = qx * along.x + qy * along.y;
        beyond[i] = near[i] & !((at >= 0.0) & (at <= length_m));
        (found.point_x[i], found.point_y[i]) = (qx, qy);
    }
    (found.normal_x, found.normal_y) = ([up.x; LANES], [up.y; LANES]);
    found.body_radius = [f64::INFINITY; LANES];
    found.segment = [Segment::GuideFace; LANES];
    if any(&beyond) {
        // Past an end the face's corner touches the contour.
        for i in (0..LANES).filter(|i| beyond[*i]) {
            search(seen, i, found);
            near[i] = found.touches(i);
        }
    }
    any(&near)
}

#[inline(always)]
fn lobes(
    seen: &Seen<'_>,
    (ring, seats, turn): (&LobedRing, &Seats, (f64, f64)),
    own: &[bool; LANES],
    faced: &mut Faced,
    found: &mut Found,
) -> bool {
    let poses = Poses::of(seen);
    let (x, y) = poses.origin();
    let feet = feet(seen, own, (&x, &y), &mut faced.feet);
    // The highest circle first: most links are beyond it.
    let mut near = [false; LANES];
    for i in 0..LANES {
        near[i] = own[i] & !(ring.crest_radius_m - feet.distance[i] < -seen.far_m);
    }
    if !any(&near) {
        return false;
    }
    settle_seats(seen, &poses, seats, &near, faced);
    let (turn_x, turn_y) = turns(&poses, seen.rotor, turn, faced);
    let mut lean = [0.0; LANES];
    for i in 0..LANES {
        let at = Vec2::new(feet.point_x[i] - x[i], feet.point_y[i] - y[i]);
        lean[i] = ring.lean(at, Vec2::new(turn_x[i], turn_y[i]));
    }
    let (mut contacts, strayed) = faced.pairs.contacts([&x, &y], [&turn_x, &turn_y], &lean);
    let strayed = both(&near, &strayed);
    let mut alone = [None; LANES];
    if any(&strayed) {
        for i in (0..LANES).filter(|i| strayed[*i]) {
            let (axis, turn) = (Vec2::new(x[i], y[i]), Vec2::new(turn_x[i], turn_y[i]));
            match faced.pairs.search(i, (seen.abutment, &faced.sure), ring, axis, turn) {
                Pair::Kept => {}
                Pair::Alone(contact) => alone[i] = Some(contact),
                Pair::Nothing => near[i] = false,
            }
        }
        contacts = faced.pairs.contacts([&x, &y], [&turn_x, &turn_y], &lean).0;
        for i in 0..LANES {
            let Some(c) = alone[i] else { continue };
            (contacts.point_x[i], contacts.point_y[i]) = (c.point.x, c.point.y);
            (contacts.normal_x[i], contacts.normal_y[i], contacts.distance[i]) = (c.normal.x, c.normal.y, c.gap_m);
        }
    }
    for i in 0..LANES {
        let penetration = -contacts.distance[i];
        near[i] &= penetration > -seen.far_m;
        found.penetration[i] = if near[i] { penetration } else { found.penetration[i] };
        found.body_radius[i] = alone[i].map_or(faced.pairs.ring_radius[i], |c| c.ring_radius_m);
        found.tooth[i] = faced.seat[i] as u32;
    }
    poses.put(&near, [&contacts.point_x, &contacts.point_y], [&contacts.normal_x, &contacts.normal_y], found);
    any(&near)
}

/// The tooth gap that each joint is in, looked up where it has changed.
#[inline(always)]
fn settle_seats(seen: &Seen<'_>, poses: &Poses, seats: &Seats, near: &[bool; LANES], faced: &mut Faced) {
    let (c, s) = seen.rotor;
    let lever = take(&seen.model.chain.lever, seen.at);
    let (mut jx, mut jy, mut strayed) = ([0.0; LANES], [0.0; LANES], [false; LANES]);
    for i in 0..LANES {
        let lever = if seen.front { lever[i] } else { -lever[i] };
        (jx[i], jy[i]) = (poses.x[i] + poses.cos[i] * lever, poses.y[i] + poses.sin[i] * lever);
        let (gx, gy) = (c * faced.seat_cos[i] - s * faced.seat_sin[i], s * faced.seat_cos[i] + c * faced.seat_sin[i]);
        let (along, across) = (jx[i] * gx + jy[i] * gy, gx * jy[i] - gy * jx[i]);
        strayed[i] = near[i] & !(across.abs() < faced.seat_tan * along);
    }
    if any(&strayed) {
        for i in (0..LANES).filter(|i| strayed[*i]) {
            faced.seat[i] = seats.nearest(Vec2::new(jx[i], jy[i]), seen.rotor).0;
            (faced.seat_cos[i], faced.seat_sin[i]) = seats.direction(faced.seat[i]);
        }
    }
}

/// Directions of the gap frames' +x in the frames of the links.
#[inline(always)]
fn turns(poses: &Poses, (c, s): (f64, f64), (lobe_c, lobe_s): (f64, f64), faced: &Faced) -> (Column, Column) {
    let (mut ax, mut ay) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let (gx, gy) = (c * faced.seat_cos[i] - s * faced.seat_sin[i], s * faced.seat_cos[i] + c * faced.seat_sin[i]);
        (ax[i], ay[i]) = (lobe_c * gx - lobe_s * gy, lobe_s * gx + lobe_c * gy);
    }
    // +y of the gap frame points along the seat.
    let (x, y) = poses.into_link(&ax, &ay);
    (y, x.map(|x| 0.0 - x))
}
