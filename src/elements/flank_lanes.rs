//! Toothed flanks against the outer or inner sides of their gaps, [`LANES`] ends at a time.
//!
//! The pairs are those of [`super::end_contact`], each in closed form: line of the flank on face and tip corner, toe on face and tip
//! corner, toe in the root or crotch on the tip corner. All are computed for every lane, and the deepest of those that exist counts,
//! of two alike the first. In the gap frame: +y along the gap's axis, +x to its right.

use super::arc_lanes::{Found, NOTHING_M};
use super::end_contact::{Arc, Circle, NORMAL_ROUNDING, SilentTooth};
use super::tooth_contact::{Column, LANES, Mask, any, mask};
use crate::geometry::chain::silent::SilentLinkContour;
use crate::geometry::{Vec2, cross};
use crate::recording::frame::Segment;

/// What touches of one side of an end of each link, in the link frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlankLanes {
    start: [Column; 2],
    end: [Column; 2],
    normal: [Column; 2],
    toe: [Column; 2],
    toe_radius: Column,
    /// Normals between which the toe turns: of the outer and of the inner flank.
    outer: [Column; 2],
    inner: [Column; 2],
    crotch: [Column; 2],
    crotch_radius: Column,
}

/// Where links are, from the body's origin.
pub struct Placed<'a> {
    pub x: &'a Column,
    pub y: &'a Column,
    pub cos: &'a Column,
    pub sin: &'a Column,
    /// Directions of the axes of the tooth gaps, in the world.
    pub axis_x: &'a Column,
    pub axis_y: &'a Column,
}

impl Placed<'_> {
    /// A direction of lane `i` from the link into the gap frame.
    #[inline(always)]
    fn turned(&self, i: usize, v: Vec2) -> Vec2 {
        let (c, s) = (self.cos[i], self.sin[i]);
        self.gap_frame(i, Vec2::new(c * v.x - s * v.y, s * v.x + c * v.y))
    }

    #[inline(always)]
    fn placed(&self, i: usize, p: Vec2) -> Vec2 {
        let (c, s) = (self.cos[i], self.sin[i]);
        self.gap_frame(i, Vec2::new(self.x[i] + (c * p.x - s * p.y), self.y[i] + (s * p.x + c * p.y)))
    }

    #[inline(always)]
    fn gap_frame(&self, i: usize, v: Vec2) -> Vec2 {
        let (ax, ay) = (self.axis_x[i], self.axis_y[i]);
        Vec2::new(ay * v.x - ax * v.y, ax * v.x + ay * v.y)
    }
}

/// A candidate for the deepest place of a lane.
#[derive(Clone, Copy)]
struct Candidate {
    exists: bool,
    penetration: f64,
    point: Vec2,
    normal: Vec2,
    body_radius: f64,
    segment: f64,
}

impl FlankLanes {
    /// `rows`: contours of the rows of the chain; `at`: the first link of the block.
    pub fn new(rows: &[SilentLinkContour], at: usize, front: bool, outer: bool) -> FlankLanes {
        let mut lanes = FlankLanes::default();
        for i in 0..LANES {
            let contour = &rows[(at + i) % rows.len()];
            let end = if front { &contour.front } else { &contour.rear };
            let flank = if outer { &end.outer_flank } else { &end.inner_flank };
            let mut put = |column: fn(&mut FlankLanes) -> &mut [Column; 2], v: Vec2| {
                let to = column(&mut lanes);
                (to[0][i], to[1][i]) = (v.x, v.y);
            };
            put(|l| &mut l.start, flank.start);
            put(|l| &mut l.end, flank.end);
            put(|l| &mut l.normal, flank.normal);
            put(|l| &mut l.toe, end.toe.centre);
            put(|l| &mut l.outer, end.outer_flank.normal);
            put(|l| &mut l.inner, end.inner_flank.normal);
            put(|l| &mut l.crotch, contour.crotch.centre);
            lanes.toe_radius[i] = end.toe.radius_m;
            lanes.crotch_radius[i] = contour.crotch.radius_m;
        }
        lanes
    }

    /// Deepest places of the lanes of `own`, none where the gap is `far_m` or more. `side`: index of the circles that the flank faces.
    /// Returns whether there is any.
    #[inline(always)]
    pub fn deepest<const OUTER: bool>(
        &self,
        tooth: &SilentTooth,
        side: usize,
        placed: &Placed<'_>,
        (own, far_m): (&Mask, f64),
        found: &mut Found,
    ) -> bool {
        let (face, corner) = (tooth.face[side], tooth.corner[side]);
        let number = |s: Segment| f64::from(s as u32);
        let face_name = number(if side == 1 { Segment::FlankCounterclockwise } else { Segment::FlankClockwise });
        let (corner_name, root_name) = (number(Segment::TipCorner), number(Segment::Seat));
        let mut touches = [0; LANES];
        for i in 0..LANES {
            let vector = |v: &[Column; 2]| Vec2::new(v[0][i], v[1][i]);
            let (start, stop) = (placed.placed(i, vector(&self.start)), placed.placed(i, vector(&self.end)));
            let normal = placed.turned(i, vector(&self.normal));
            let toe = Circle { centre: placed.placed(i, vector(&self.toe)), radius_m: self.toe_radius[i] };
            let ends = [placed.turned(i, vector(&self.outer)), placed.turned(i, vector(&self.inner))];
            let sense = cross(ends[0], ends[1]);
            let on_toe = |out: Vec2| {
                (cross(ends[0], out) * sense >= -NORMAL_ROUNDING) & (cross(out, ends[1]) * sense >= -NORMAL_ROUNDING)
            };
            let mut best = Candidate {
                exists: false,
                penetration: -far_m,
                point: Vec2::zeros(),
                normal: Vec2::zeros(),
                body_radius: 0.0,
                segment: 0.0,
            };
            let mut offer = |new: Candidate| {
                let better = new.exists & (new.penetration > best.penetration);
                let pick = |new: f64, old: f64| if better { new } else { old };
                best = Candidate {
                    exists: better | best.exists,
                    penetration: pick(new.penetration, best.penetration),
                    point: Vec2::new(pick(new.point.x, best.point.x), pick(new.point.y, best.point.y)),
                    normal: Vec2::new(pick(new.normal.x, best.normal.x), pick(new.normal.y, best.normal.y)),
                    body_radius: pick(new.body_radius, best.body_radius),
                    segment: pick(new.segment, best.segment),
                };
            };
            let on_face = line_arc(start, stop, normal, &face.circle, face_name);
            offer(Candidate { exists: on_face.exists & has(&face, on_face.normal), ..on_face });
            offer(line_arc(start, stop, normal, &corner, corner_name));
            let toe_on_face = arc_arc(&toe, &face.circle, face_name);
            let exists = has(&face, toe_on_face.normal) & on_toe(-toe_on_face.normal);
            offer(Candidate { exists, ..toe_on_face });
            let toe_on_corner = arc_arc(&toe, &corner, corner_name);
            offer(Candidate { exists: on_toe(-toe_on_corner.normal), ..toe_on_corner });
            if OUTER {
                let in_root = arc_in_hollow(&toe, &tooth.root.circle, root_name);
                let exists = in_root.exists & has(&tooth.root, in_root.normal) & on_toe(-in_root.normal);
                offer(Candidate { exists, ..in_root });
            } else {
                let crotch = Circle { centre: placed.placed(i, vector(&self.crotch)), radius_m: self.crotch_radius[i] };
                let inward = placed.turned(i, Vec2::new(0.0, 1.0));
                offer(corner_in_crotch(&corner, &crotch, inward, corner_name));
            }
            touches[i] = own[i] & mask(best.exists);
            let (ax, ay) = (placed.axis_x[i], placed.axis_y[i]);
            let out_of_gap = |v: Vec2| (ay * v.x + ax * v.y, ay * v.y - ax * v.x);
            found.penetration[i] = if touches[i] != 0 { best.penetration } else { NOTHING_M };
            (found.point_x[i], found.point_y[i]) = out_of_gap(best.point);
            (found.normal_x[i], found.normal_y[i]) = out_of_gap(best.normal);
            (found.body_radius[i], found.segment[i]) = (best.body_radius, best.segment);
        }
        any(&touches)
    }
}

#[inline(always)]
fn has(arc: &Arc, normal: Vec2) -> bool {
    (cross(arc.from, normal) >= -NORMAL_ROUNDING) & (cross(normal, arc.to) >= -NORMAL_ROUNDING)
}

/// A link's flank on a convex arc of the body; `normal` out of the link.
#[inline(always)]
fn line_arc(start: Vec2, end: Vec2, normal: Vec2, arc: &Circle, segment: f64) -> Candidate {
    let height = (arc.centre - start).dot(&normal);
    let point = arc.centre - normal * height;
    let d = end - start;
    let along = (point - start).dot(&d);
    Candidate {
        exists: (height > 0.0) & (along >= 0.0) & (along <= d.norm_squared()),
        penetration: arc.radius_m - height,
        point,
        normal: -normal,
        body_radius: arc.radius_m,
        segment,
    }
}

/// A link's toe on a convex arc of the body.
#[inline(always)]
fn arc_arc(toe: &Circle, arc: &Circle, segment: f64) -> Candidate {
    let d = toe.centre - arc.centre;
    let distance = d.norm();
    let normal = d / distance;
    Candidate {
        exists: true,
        penetration: toe.radius_m + arc.radius_m - distance,
        point: toe.centre - normal * toe.radius_m,
        normal,
        body_radius: arc.radius_m,
        segment,
    }
}

/// A link's toe in the root.
#[inline(always)]
fn arc_in_hollow(toe: &Circle, root: &Circle, segment: f64) -> Candidate {
    let d = toe.centre - root.centre;
    let distance = d.norm();
    let outward = d / distance;
    Candidate {
        exists: d.y < 0.0,
        penetration: distance + toe.radius_m - root.radius_m,
        point: toe.centre + outward * toe.radius_m,
        normal: -outward,
        body_radius: -root.radius_m,
        segment,
    }
}

/// The tip corner of a tooth in the crotch of the link that straddles it. `inward`: out of the link's teeth.
#[inline(always)]
fn corner_in_crotch(corner: &Circle, crotch: &Circle, inward: Vec2, segment: f64) -> Candidate {
    let d = corner.centre - crotch.centre;
    let distance = d.norm();
    let outward = d / distance;
    Candidate {
        exists: (distance != 0.0) & (d.dot(&inward) <= -0.5 * distance),
        penetration: distance + corner.radius_m - crotch.radius_m,
        point: crotch.centre + outward * crotch.radius_m,
        normal: outward,
        body_radius: corner.radius_m,
        segment,
    }
}
