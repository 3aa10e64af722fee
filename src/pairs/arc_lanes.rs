//! Links' contours of arcs against bodies, [`LANES`] ends at a time, from what each end faced last.
//!
//! Every lane keeps the constants of the element that its end faced in the step before. Signs of linear functions tell whether it
//! still faces it; where they do, the contact follows in closed form, and where they do not, the search of
//! [`super::end_contact`] finds the element anew. What is kept changes no bit of a result: an element is kept only where the search
//! would have found the same one, and a contact is computed by one formula however its element was found.
//!
//! ```text
//! foot of O on arc (c, r)        (O - P_k).t_k > 0 and not (O - P_k+1).t_k+1 > 0;   n = (O - c)/|O - c|,  distance |O - c| - r
//! support of a direction u       u before the end normal of k, not before that of k - 1;   point c + r u
//! arc (c, r) on ring arc (Q, R)  n = +-(Q - c)/|Q - c| in the cone of (c, r), -n in the cone of (Q, R);   gap +-|Q - c| - R - r
//! ```
//! The sign is that of R; a crest is a ring arc with R = 0. An abutment that is more curved than the ring's hollows has one such pair.
//! Where it has arcs that are flatter, others may exist: [`arcs_with_one_contact`] tells from which arcs on a pair has no rival.

use super::contour_body::EndTouch;
use crate::geometry::smartchain::contour::{AbutmentContour, ContourArc};
use crate::geometry::smartchain::ring::{LobedRing, RingContact};
use crate::geometry::{Vec2, perp};
use crate::lanes::{LANES, LaneBlock};
use crate::recording::frame::Segment;

/// The deepest places of one end of a block of links on a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EndContactLanes {
    /// [m]; [`NOTHING_M`] where nothing touches, nor may within a step.
    pub penetration: LaneBlock,
    /// On the link's contour, from the body's origin, in the world.
    pub point_x: LaneBlock,
    pub point_y: LaneBlock,
    /// Out of the body.
    pub normal_x: LaneBlock,
    pub normal_y: LaneBlock,
    /// Radii of curvature there [m]: of the body, and of the link's contour as in [`super::contour_body::EndTouch`].
    pub body_radius: LaneBlock,
    pub link_radius: LaneBlock,
    /// Number of the tooth gap.
    pub tooth: LaneBlock,
    /// A [`Segment`] as a number.
    pub segment: LaneBlock,
}

/// Penetration of lanes that touch nothing [m]: further off than any speed brings them back; padding has a kilometre for an arm.
pub const NO_CONTACT_M: f64 = -1e9;

impl EndContactLanes {
    pub fn none() -> EndContactLanes {
        let zero = [0.0; LANES];
        EndContactLanes {
            penetration: [NO_CONTACT_M; LANES],
            point_x: zero,
            point_y: zero,
            normal_x: zero,
            normal_y: [1.0; LANES],
            body_radius: zero,
            link_radius: zero,
            tooth: zero,
            segment: [f64::from(Segment::Ring as u32); LANES],
        }
    }
}

impl EndContactLanes {
    /// One lane of them, where details were asked for.
    pub fn touch(&self, i: usize) -> EndTouch {
        EndTouch {
            penetration_m: self.penetration[i],
            point: Vec2::new(self.point_x[i], self.point_y[i]),
            normal: Vec2::new(self.normal_x[i], self.normal_y[i]),
            link_radius_m: self.link_radius[i],
            body_radius_m: self.body_radius[i],
            tooth: self.tooth[i] as u32,
            segment: Segment::ALL[self.segment[i] as usize],
        }
    }
}

/// The element that the foot of a perpendicular lies on, in every lane. In the link frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FootLanes {
    centre_x: LaneBlock,
    centre_y: LaneBlock,
    /// Infinite for a flat, negative in a hollow, zero for an end of the contour.
    pub radius: LaneBlock,
    /// Where the element begins, its tangent there, and what the foot's side must exceed: zero, or less than any at an end.
    from_x: LaneBlock,
    from_y: LaneBlock,
    from_tx: LaneBlock,
    from_ty: LaneBlock,
    from_above: LaneBlock,
    /// Where it ends.
    to_x: LaneBlock,
    to_y: LaneBlock,
    to_tx: LaneBlock,
    to_ty: LaneBlock,
    /// Normal at the beginning, or at the end of the contour.
    out_x: LaneBlock,
    out_y: LaneBlock,
}

/// The foot of a perpendicular, or the place of a common normal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FootPoint {
    pub point_x: f64,
    pub point_y: f64,
    /// Out of the contour.
    pub normal_x: f64,
    pub normal_y: f64,
    pub distance: f64,
}

/// Lower than any side, for an element with no other before it; and higher, for a lane that knows nothing yet.
const OPEN: f64 = f64::NEG_INFINITY;
const UNKNOWN: f64 = f64::INFINITY;

impl Default for FootLanes {
    /// Lanes that know nothing yet.
    fn default() -> FootLanes {
        let zero = [0.0; LANES];
        FootLanes {
            centre_x: zero,
            centre_y: zero,
            radius: zero,
            from_x: zero,
            from_y: zero,
            from_tx: zero,
            from_ty: zero,
            from_above: [UNKNOWN; LANES],
            to_x: zero,
            to_y: zero,
            to_tx: zero,
            to_ty: zero,
            out_x: zero,
            out_y: zero,
        }
    }
}

impl FootLanes {
    /// Looks up what `o` faces.
    #[cold]
    #[inline(never)]
    pub fn search(&mut self, i: usize, contour: &AbutmentContour, o: Vec2) {
        let arcs = contour.arcs();
        let foot = contour.closest_to_point(o);
        let a = &arcs[foot.arc];
        let (begin, end) = (perp(a.normal_start), perp(a.normal_end));
        let at_start = foot.radius_m == 0.0 && foot.point == contour.start();
        let at_end = foot.radius_m == 0.0 && !at_start;
        let centre = if foot.radius_m == 0.0 { foot.point } else { a.centre };
        (self.centre_x[i], self.centre_y[i], self.radius[i]) = (centre.x, centre.y, foot.radius_m);
        // Where the element begins: where the one before it ends, by which the search goes.
        let (from, from_t) = match foot.arc {
            _ if at_end => (a.end, end),
            0 => (a.start, begin),
            k => (arcs[k - 1].end, perp(arcs[k - 1].normal_end)),
        };
        (self.from_x[i], self.from_y[i]) = (from.x, from.y);
        (self.from_tx[i], self.from_ty[i]) = if at_start { (0.0, 0.0) } else { (from_t.x, from_t.y) };
        self.from_above[i] = if at_start { OPEN } else { 0.0 };
        let out = if at_end { a.normal_end } else { a.normal_start };
        (self.out_x[i], self.out_y[i]) = (out.x, out.y);
        let (to, to_t) = if at_start { (a.start, begin) } else { (a.end, end) };
        (self.to_x[i], self.to_y[i]) = (to.x, to.y);
        (self.to_tx[i], self.to_ty[i]) = if at_end { (0.0, 0.0) } else { (to_t.x, to_t.y) };
    }

    /// Foot on the element of lane `i`, and whether the point faces that element, which signs tell of points outside of the contour.
    #[inline(always)]
    pub fn foot(&self, i: usize, x: f64, y: f64) -> (FootPoint, bool) {
        let from = (x - self.from_x[i]) * self.from_tx[i] + (y - self.from_y[i]) * self.from_ty[i];
        let to = (x - self.to_x[i]) * self.to_tx[i] + (y - self.to_y[i]) * self.to_ty[i];
        let faced = (from > self.from_above[i]) & (to <= 0.0);
        let (cx, cy, r) = (self.centre_x[i], self.centre_y[i], self.radius[i]);
        let (dx, dy) = (x - cx, y - cy);
        let length = (dx * dx + dy * dy).sqrt();
        let (fx, fy) = (self.out_x[i], self.out_y[i]);
        let height = dx * fx + dy * fy;
        let inside = (r < 0.0) | ((r == 0.0) & (height < 0.0));
        let signed = if inside { -length } else { length };
        let flat = r == f64::INFINITY;
        let (nx, ny) = (if flat { fx } else { dx / signed }, if flat { fy } else { dy / signed });
        let reach = if flat { 0.0 } else { r };
        let distance = if flat { height } else { signed - r };
        let point_x = if flat { x - nx * height } else { cx + nx * reach };
        let point_y = if flat { y - ny * height } else { cy + ny * reach };
        (FootPoint { point_x, point_y, normal_x: nx, normal_y: ny, distance }, faced)
    }
}

/// The element of the convex hull that a plane rests on, in every lane. In the link frame.
#[derive(Clone, Debug, PartialEq)]
pub struct SupportLanes {
    centre_x: LaneBlock,
    centre_y: LaneBlock,
    /// Zero where the plane rests on a point: an end, or the beginning of a flat.
    radius: LaneBlock,
    start_x: LaneBlock,
    start_y: LaneBlock,
    start_tx: LaneBlock,
    start_ty: LaneBlock,
    /// Normals at the end of the element before, and of this one; zero at the ends of the contour.
    before_x: LaneBlock,
    before_y: LaneBlock,
    before_above: LaneBlock,
    end_x: LaneBlock,
    end_y: LaneBlock,
}

impl Default for SupportLanes {
    /// Lanes that know nothing yet.
    fn default() -> SupportLanes {
        let zero = [0.0; LANES];
        SupportLanes {
            centre_x: zero,
            centre_y: zero,
            radius: zero,
            start_x: zero,
            start_y: zero,
            start_tx: zero,
            start_ty: zero,
            before_x: zero,
            before_y: zero,
            before_above: [UNKNOWN; LANES],
            end_x: zero,
            end_y: zero,
        }
    }
}

impl SupportLanes {
    #[cold]
    #[inline(never)]
    pub fn search(&mut self, i: usize, contour: &AbutmentContour, direction: Vec2) {
        let (hull, arc) = contour.hull_facing(direction);
        let before = arc.checked_sub(1).and_then(|k| hull.get(k));
        let normal = before.map_or(Vec2::zeros(), |a| a.normal_end);
        (self.before_x[i], self.before_y[i]) = (normal.x, normal.y);
        self.before_above[i] = if before.is_some() { 0.0 } else { OPEN };
        let point = |p: Vec2| (p, 0.0, p, Vec2::zeros(), Vec2::zeros());
        let (centre, radius, start, tangent, end) = match hull.get(arc) {
            None => point(contour.end()),
            Some(a) if a.radius_m.is_infinite() => (a.start, 0.0, a.start, Vec2::zeros(), a.normal_end),
            Some(a) => (a.centre, a.radius_m, a.start, perp(a.normal_start), a.normal_end),
        };
        (self.centre_x[i], self.centre_y[i], self.radius[i]) = (centre.x, centre.y, radius);
        (self.start_x[i], self.start_y[i]) = (start.x, start.y);
        (self.start_tx[i], self.start_ty[i]) = (tangent.x, tangent.y);
        (self.end_x[i], self.end_y[i]) = (end.x, end.y);
    }

    /// Radius of curvature where [`SupportLanes::point`] is: zero at corners and on flats [m].
    #[inline(always)]
    pub fn radius(&self, i: usize, x: f64, y: f64) -> f64 {
        if x * self.start_tx[i] + y * self.start_ty[i] < 0.0 { 0.0 } else { self.radius[i] }
    }

    /// The point of lane `i` that reaches furthest in a direction, and whether the direction faces the element that is remembered.
    #[inline(always)]
    pub fn point(&self, i: usize, x: f64, y: f64) -> ((f64, f64), bool) {
        let before = y * self.before_x[i] - x * self.before_y[i];
        let end = y * self.end_x[i] - x * self.end_y[i];
        // Normals look to +y: only of such a direction do signs tell all.
        let faced = (before > self.before_above[i]) & (y > 0.0) & (end <= 0.0);
        let on_start = x * self.start_tx[i] + y * self.start_ty[i] < 0.0;
        let (px, py) = (self.centre_x[i] + x * self.radius[i], self.centre_y[i] + y * self.radius[i]);
        ((if on_start { self.start_x[i] } else { px }, if on_start { self.start_y[i] } else { py }), faced)
    }
}

/// An arc of an abutment and one of a lobe that face each other, in every lane. Abutments in the link frame, lobes in that of their
/// gap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PairLanes {
    /// The arc of the abutment, and the tangents at its ends.
    centre_x: LaneBlock,
    centre_y: LaneBlock,
    pub radius: LaneBlock,
    from_tx: LaneBlock,
    from_ty: LaneBlock,
    to_tx: LaneBlock,
    to_ty: LaneBlock,
    /// The arc of the lobe: centre, signed radius, and the outward normals at its ends, counterclockwise.
    ring_x: LaneBlock,
    ring_y: LaneBlock,
    pub ring_radius: LaneBlock,
    first_x: LaneBlock,
    first_y: LaneBlock,
    last_x: LaneBlock,
    last_y: LaneBlock,
    /// 1: before the crest; -1: behind it; 0: the crest.
    side: LaneBlock,
    /// 1 where the pair may be kept; else it is looked for in every step.
    known: LaneBlock,
}

/// What a search for a common normal found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PairSearchResult {
    /// A pair that is kept.
    Kept,
    /// A contact that may have rivals, or is none of two arcs.
    Alone(RingContact),
    Nothing,
}

/// Nearer than this to the end of an arc [rad] its pair is looked for anew. There the search may name either neighbour: it counts
/// directions within 1e-9 rad of an arc's end as on it, and in hollows it stops when a step turns by less than 3e-7 rad, which leaves
/// at most three times as much at the ratio of radii that [`CURVATURE_MARGIN`] allows.
const PAIR_MARGIN_RAD: f64 = 1e-6;

impl PairLanes {
    /// Looks up which pair of arcs faces each other. `sure`: as [`arcs_with_one_contact`] tells; `axis` and `turn` as in
    /// [`PairLanes::contact`].
    #[cold]
    #[inline(never)]
    pub fn search(
        &mut self,
        i: usize,
        (abutment, sure): (&AbutmentContour, &[bool]),
        ring: &LobedRing,
        axis: Vec2,
        turn: Vec2,
    ) -> PairSearchResult {
        self.known[i] = 0.0;
        let Some(contact) = ring.contact_at(abutment, axis, turn) else { return PairSearchResult::Nothing };
        let arcs = contact.abutment_radius_m > 0.0 && contact.ring_radius_m.is_finite();
        if !arcs || !sure[contact.abutment_arc] {
            return PairSearchResult::Alone(contact);
        }
        let arc = &abutment.arcs()[contact.abutment_arc];
        self.keep(i, arc, ring, contact.ring_element);
        PairSearchResult::Kept
    }

    fn keep(&mut self, i: usize, arc: &ContourArc, ring: &LobedRing, element: usize) {
        let on_ring = ring.lobe_arc(element);
        let (begin, end) = (perp(arc.normal_start), perp(arc.normal_end));
        (self.centre_x[i], self.centre_y[i], self.radius[i]) = (arc.centre.x, arc.centre.y, arc.radius_m);
        (self.from_tx[i], self.from_ty[i], self.to_tx[i], self.to_ty[i]) = (begin.x, begin.y, end.x, end.y);
        (self.ring_x[i], self.ring_y[i], self.ring_radius[i]) = (on_ring.centre.x, on_ring.centre.y, on_ring.radius_m);
        (self.first_x[i], self.first_y[i]) = (on_ring.first.x, on_ring.first.y);
        (self.last_x[i], self.last_y[i]) = (on_ring.last.x, on_ring.last.y);
        self.side[i] = on_ring.side;
        self.known[i] = 1.0;
    }

    /// Contact of the pair of lane `i`: point and normal on the abutment, and the gap. Axis of the sprocket in the link frame, direction of
    /// the gap frame's +x there, and how far the abutment lies to the left of the crest, over the width of a lobe's own side. With it,
    /// whether the pair holds.
    #[inline(always)]
    pub fn contact(&self, i: usize, axis: (f64, f64), (tx, ty): (f64, f64), offset_ratio: f64) -> (FootPoint, bool) {
        let qx = axis.0 + (tx * self.ring_x[i] - ty * self.ring_y[i]);
        let qy = axis.1 + (ty * self.ring_x[i] + tx * self.ring_y[i]);
        let (dx, dy) = (qx - self.centre_x[i], qy - self.centre_y[i]);
        let length = (dx * dx + dy * dy).sqrt();
        let signed = if self.ring_radius[i] < 0.0 { -length } else { length };
        let (nx, ny) = (dx / signed, dy / signed);
        let from = nx * self.from_tx[i] + ny * self.from_ty[i];
        let to = nx * self.to_tx[i] + ny * self.to_ty[i];
        // Out of the lobe, in its frame.
        let (ux, uy) = (0.0 - (tx * nx + ty * ny), ty * nx - tx * ny);
        let first = self.first_x[i] * uy - self.first_y[i] * ux;
        let last = ux * self.last_y[i] - uy * self.last_x[i];
        let margin = PAIR_MARGIN_RAD;
        let faced = (from > margin) & (to < 0.0 - margin) & (first > margin) & (last > margin);
        let behind = self.side[i] * offset_ratio > 1.0;
        let foot = FootPoint {
            point_x: self.centre_x[i] + nx * self.radius[i],
            point_y: self.centre_y[i] + ny * self.radius[i],
            normal_x: nx,
            normal_y: ny,
            distance: signed - self.ring_radius[i] - self.radius[i],
        };
        (foot, faced & !behind & (self.known[i] > 0.0))
    }
}

/// An arc that has no rival is tighter than the hollow by this factor. The ring's foot runs faster than the abutment's by the gap over
/// the radius, below a hundredth; and the search in a hollow gains at least this factor with every step.
const CURVATURE_MARGIN: f64 = 1.35;

/// For every arc of an abutment, whether a contact there with a lobe of `ring` is the only one of the whole abutment.
///
/// Along the abutment from a contact, its normal turns by the length over its own radius, and the hollow under it by no more than
/// that over the hollow's. As long as the first is ahead no other common normal can follow; where arcs are flatter than the
/// hollow the surplus falls again.
pub fn arcs_with_one_contact(abutment: &AbutmentContour, ring: &LobedRing) -> Vec<bool> {
    let hollow_per_m = CURVATURE_MARGIN / ring.tightest_hollow_m();
    let surplus = |a: &ContourArc| {
        let turned_rad = if a.radius_m.is_infinite() { 0.0 } else { a.normal_end_rad - a.normal_start_rad };
        let length_m = if a.radius_m.is_infinite() { (a.end - a.start).norm() } else { turned_rad * a.radius_m };
        turned_rad - length_m * hollow_per_m
    };
    let surpluses: Vec<f64> = abutment.arcs().iter().map(surplus).collect();
    let sure = |i: usize| {
        let arc = &abutment.arcs()[i];
        let tighter = arc.radius_m > 0.0 && arc.radius_m.is_finite() && surpluses[i] > 0.0;
        tighter
            && partial_sums_are_positive(surpluses[i + 1..].iter())
            && partial_sums_are_positive(surpluses[..i].iter().rev())
    };
    (0..surpluses.len()).map(sure).collect()
}

/// Whether all partial sums are positive.
fn partial_sums_are_positive<'a>(mut surpluses: impl Iterator<Item = &'a f64>) -> bool {
    let mut sum = 0.0;
    surpluses.all(|surplus| {
        sum += surplus;
        sum > 0.0
    })
}
