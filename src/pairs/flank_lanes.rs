//! Toothed flanks against the outer or inner sides of their gaps, [`LANES`] ends at a time.
//!
//! The pairs are those of [`super::end_contact`], each in closed form: line of the flank on face and tip corner, toe on face and tip
//! corner, toe in the root or crotch on the tip corner. All are computed for every lane, and the deepest of those that exist counts,
//! of two alike the first. In the gap frame: +y along the gap's axis, +x to its right.

use super::arc_lanes::{EndContactLanes, NO_CONTACT_M};
use super::contour_body::{Arc, Circle, NORMAL_ROUNDING, SilentTooth};
use crate::geometry::chain::silent::SilentLinkContour;
use crate::geometry::{Vec2, cross, perp};
use crate::lanes::{LANES, LaneBlock, LaneMask, any, mask};
use crate::recording::frame::Segment;

/// What touches of one side of an end of each link, in the link frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlankLanes {
    start: Points,
    normal: Points,
    /// From where to where the flank reaches from its start, along its normal turned by +90 degrees [m].
    from_m: LaneBlock,
    to_m: LaneBlock,
    toe: Points,
    toe_radius: LaneBlock,
    /// Normals between which the toe turns: of the outer and of the inner flank, times the sine of the angle from the first to the
    /// second.
    outer: Points,
    inner: Points,
    crotch: Points,
    crotch_radius: LaneBlock,
}

/// A point or a direction in every lane: x, y.
type Points = [LaneBlock; 2];

/// Where links are, from the body's origin.
pub struct LinksInBodyFrame<'a> {
    pub x: &'a LaneBlock,
    pub y: &'a LaneBlock,
    pub cos: &'a LaneBlock,
    pub sin: &'a LaneBlock,
    /// Directions of the axes of the tooth gaps, in the world.
    pub axis_x: &'a LaneBlock,
    pub axis_y: &'a LaneBlock,
}

/// A link in the gap frame: its centre and the direction of its x axis.
#[derive(Clone, Copy)]
struct LinkInGapFrame {
    x: f64,
    y: f64,
    cos: f64,
    sin: f64,
}

impl LinkInGapFrame {
    #[inline(always)]
    fn new(placed: &LinksInBodyFrame<'_>, i: usize) -> LinkInGapFrame {
        let (x, y, c, s) = (placed.x[i], placed.y[i], placed.cos[i], placed.sin[i]);
        let (ax, ay) = (placed.axis_x[i], placed.axis_y[i]);
        LinkInGapFrame { x: ay * x - ax * y, y: ax * x + ay * y, cos: ay * c - ax * s, sin: ax * c + ay * s }
    }

    #[inline(always)]
    fn direction_in_gap(self, v: &Points, i: usize) -> (f64, f64) {
        (self.cos * v[0][i] - self.sin * v[1][i], self.sin * v[0][i] + self.cos * v[1][i])
    }

    #[inline(always)]
    fn position_in_gap(self, p: &Points, i: usize) -> (f64, f64) {
        let (x, y) = self.direction_in_gap(p, i);
        (self.x + x, self.y + y)
    }
}

/// A flank on a convex arc of the body, in the gap frame.
#[derive(Clone, Copy)]
struct FlankLineContact {
    /// Lower than any where they do not face each other.
    penetration: f64,
    height: f64,
    circle: Circle,
    segment: f64,
}

/// Two arcs, in the gap frame.
#[derive(Clone, Copy)]
struct FlankArcContact {
    /// Lower than any where they do not face each other.
    penetration: f64,
    /// Out of the body, over its length [m].
    normal_x: f64,
    normal_y: f64,
    length: f64,
    body_radius: f64,
    segment: f64,
}

impl FlankLineContact {
    /// The deeper one; of two alike the first.
    #[inline(always)]
    fn deeper(self, new: FlankLineContact) -> FlankLineContact {
        let better = new.penetration > self.penetration;
        let pick = |new: f64, old: f64| if better { new } else { old };
        FlankLineContact {
            penetration: pick(new.penetration, self.penetration),
            height: pick(new.height, self.height),
            circle: Circle {
                centre: Vec2::new(
                    pick(new.circle.centre.x, self.circle.centre.x),
                    pick(new.circle.centre.y, self.circle.centre.y),
                ),
                radius_m: pick(new.circle.radius_m, self.circle.radius_m),
            },
            segment: pick(new.segment, self.segment),
        }
    }
}

impl FlankArcContact {
    #[inline(always)]
    fn deeper(self, new: FlankArcContact) -> FlankArcContact {
        let better = new.penetration > self.penetration;
        let pick = |new: f64, old: f64| if better { new } else { old };
        FlankArcContact {
            penetration: pick(new.penetration, self.penetration),
            normal_x: pick(new.normal_x, self.normal_x),
            normal_y: pick(new.normal_y, self.normal_y),
            length: pick(new.length, self.length),
            body_radius: pick(new.body_radius, self.body_radius),
            segment: pick(new.segment, self.segment),
        }
    }
}

/// Penetration of what does not face each other [m].
const NOT_FACING_M: f64 = f64::NEG_INFINITY;

impl FlankLanes {
    /// `rows`: contours of the rows of the chain; `at`: the first link of the block.
    pub fn new(rows: &[SilentLinkContour], at: usize, front: bool, outer: bool) -> FlankLanes {
        let mut lanes = FlankLanes::default();
        for i in 0..LANES {
            let contour = &rows[(at + i) % rows.len()];
            let end = if front { &contour.front } else { &contour.rear };
            let flank = if outer { &end.outer_flank } else { &end.inner_flank };
            let length_m = (flank.end - flank.start).dot(&perp(flank.normal));
            (lanes.from_m[i], lanes.to_m[i]) = (length_m.min(0.0), length_m.max(0.0));
            let sense = cross(end.outer_flank.normal, end.inner_flank.normal);
            let mut put = |column: fn(&mut FlankLanes) -> &mut Points, v: Vec2| {
                let to = column(&mut lanes);
                (to[0][i], to[1][i]) = (v.x, v.y);
            };
            put(|l| &mut l.start, flank.start);
            put(|l| &mut l.normal, flank.normal);
            put(|l| &mut l.toe, end.toe.centre);
            put(|l| &mut l.outer, end.outer_flank.normal * sense);
            put(|l| &mut l.inner, end.inner_flank.normal * sense);
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
        placed: &LinksInBodyFrame<'_>,
        (own, far_m): (&LaneMask, f64),
        found: &mut EndContactLanes,
    ) -> bool {
        let (face, corner) = (tooth.face[side], tooth.corner[side]);
        let number = |s: Segment| f64::from(s as u32);
        let face_name = number(if side == 1 { Segment::FlankCounterclockwise } else { Segment::FlankClockwise });
        let (corner_name, root_name) = (number(Segment::TipCorner), number(Segment::Seat));
        let mut touches = [0; LANES];
        for i in 0..LANES {
            let link = LinkInGapFrame::new(placed, i);
            let (sx, sy) = link.position_in_gap(&self.start, i);
            let (nx, ny) = link.direction_in_gap(&self.normal, i);
            let line = |circle: Circle, faces: bool, segment: f64| {
                let (dx, dy) = (circle.centre.x - sx, circle.centre.y - sy);
                let (height, along) = (dx * nx + dy * ny, dy * nx - dx * ny);
                let exists = faces & (height > 0.0) & (along >= self.from_m[i]) & (along <= self.to_m[i]);
                let penetration = if exists { circle.radius_m - height } else { NOT_FACING_M };
                FlankLineContact { penetration, height, circle, segment }
            };
            let on_line = line(face.circle, arc_has_normal(&face, -nx, -ny, 1.0), face_name).deeper(line(
                corner,
                true,
                corner_name,
            ));

            let (tx, ty) = link.position_in_gap(&self.toe, i);
            let (ox, oy) = link.direction_in_gap(&self.outer, i);
            let (ix, iy) = link.direction_in_gap(&self.inner, i);
            // Whether the toe reaches there, to which its own normal is opposite.
            let on_toe = |nx: f64, ny: f64, length: f64| {
                let rounding = NORMAL_ROUNDING * length;
                (ox * ny - oy * nx <= rounding) & (nx * iy - ny * ix <= rounding)
            };
            let toe_radius = self.toe_radius[i];
            let arc = |circle: Circle, faces: fn(&Arc, f64, f64, f64) -> bool, segment: f64| {
                let (dx, dy) = (tx - circle.centre.x, ty - circle.centre.y);
                let length = (dx * dx + dy * dy).sqrt();
                let exists = faces(&face, dx, dy, length) & on_toe(dx, dy, length);
                let penetration = if exists { toe_radius + circle.radius_m - length } else { NOT_FACING_M };
                FlankArcContact {
                    penetration,
                    normal_x: dx,
                    normal_y: dy,
                    length,
                    body_radius: circle.radius_m,
                    segment,
                }
            };
            let on_toe_arcs =
                arc(face.circle, arc_has_normal, face_name).deeper(arc(corner, |_, _, _, _| true, corner_name));
            let (last, base_x, base_y, link_radius) = if OUTER {
                let root = &tooth.root;
                let (dx, dy) = (root.circle.centre.x - tx, root.circle.centre.y - ty);
                let length = (dx * dx + dy * dy).sqrt();
                let exists = (dy > 0.0) & arc_has_normal(root, dx, dy, length) & on_toe(dx, dy, length);
                let penetration = if exists { length + toe_radius - root.circle.radius_m } else { NOT_FACING_M };
                let body_radius = -root.circle.radius_m;
                let in_root = FlankArcContact {
                    penetration,
                    normal_x: dx,
                    normal_y: dy,
                    length,
                    body_radius,
                    segment: root_name,
                };
                (on_toe_arcs.deeper(in_root), tx, ty, toe_radius)
            } else {
                // The tip corner of the tooth in the crotch of the link that straddles it.
                let (cx, cy) = link.position_in_gap(&self.crotch, i);
                let (dx, dy) = (corner.centre.x - cx, corner.centre.y - cy);
                let length = (dx * dx + dy * dy).sqrt();
                // Out of the link's teeth: its y axis.
                let exists = (length != 0.0) & (dy * link.cos - dx * link.sin <= -0.5 * length);
                let depth = length + corner.radius_m - self.crotch_radius[i];
                let penetration = if exists { depth } else { NOT_FACING_M };
                let better = penetration > on_toe_arcs.penetration;
                let body_radius = corner.radius_m;
                let in_crotch = FlankArcContact {
                    penetration,
                    normal_x: dx,
                    normal_y: dy,
                    length,
                    body_radius,
                    segment: corner_name,
                };
                let pick = |new: f64, old: f64| if better { new } else { old };
                (on_toe_arcs.deeper(in_crotch), pick(cx, tx), pick(cy, ty), pick(-self.crotch_radius[i], toe_radius))
            };
            let arcs = last.penetration > on_line.penetration;
            let pick = |arc: f64, line: f64| if arcs { arc } else { line };
            let penetration = pick(last.penetration, on_line.penetration);
            touches[i] = own[i] & mask(penetration > -far_m);
            let length = pick(last.length, 1.0);
            let (mx, my) = (pick(last.normal_x, -nx) / length, pick(last.normal_y, -ny) / length);
            let radius = pick(link_radius, -on_line.height);
            let px = pick(base_x, on_line.circle.centre.x) - mx * radius;
            let py = pick(base_y, on_line.circle.centre.y) - my * radius;
            let (ax, ay) = (placed.axis_x[i], placed.axis_y[i]);
            found.penetration[i] = if touches[i] != 0 { penetration } else { NO_CONTACT_M };
            (found.point_x[i], found.point_y[i]) = (ay * px + ax * py, ay * py - ax * px);
            (found.normal_x[i], found.normal_y[i]) = (ay * mx + ax * my, ay * my - ax * mx);
            found.body_radius[i] = pick(last.body_radius, on_line.circle.radius_m);
            found.link_radius[i] = pick(link_radius, f64::INFINITY);
            found.segment[i] = pick(last.segment, on_line.segment);
        }
        any(&touches)
    }
}

impl FlankLanes {
    /// How far the ends are from the contour that they may touch, at least [m]: no point of a link, none farther than `extent_m` from its
    /// centre, can move less than this before they touch.
    #[inline(always)]
    pub fn clearances<const OUTER: bool>(
        &self,
        tooth: &SilentTooth,
        side: usize,
        placed: &LinksInBodyFrame<'_>,
        extent_m: f64,
    ) -> LaneBlock {
        let (face, corner) = (tooth.face[side], tooth.corner[side]);
        let (face_arc, root_arc) = (ArcEnds::new(&face, 1.0), ArcEnds::new(&tooth.root, -1.0));
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            let link = LinkInGapFrame::new(placed, i);
            let toe = link.position_in_gap(&self.toe, i);
            let flank = FlankLine {
                start: link.position_in_gap(&self.start, i),
                normal: link.direction_in_gap(&self.normal, i),
                from_m: self.from_m[i],
                to_m: self.to_m[i],
            };
            let corner_at = (corner.centre.x, corner.centre.y);
            let mut of_flank = smaller(flank.distance(corner_at) - corner.radius_m, flank.distance_to_arc(&face_arc));
            let mut of_toe = smaller(distance(toe, corner_at) - corner.radius_m, face_arc.distance(toe));
            if OUTER {
                of_toe = smaller(of_toe, root_arc.distance(toe));
            } else {
                let crotch = link.position_in_gap(&self.crotch, i);
                let (dx, dy) = (corner_at.0 - crotch.0, corner_at.1 - crotch.1);
                let length = (dx * dx + dy * dy).sqrt();
                // It touches only from within, and only where it looks up into the crotch from near its middle.
                let within = self.crotch_radius[i] - corner.radius_m - length;
                let (ox, oy) = (corner_at.0 - link.x, corner_at.1 - link.y);
                let arm = (ox * ox + oy * oy).sqrt() / extent_m;
                let below =
                    (dy * link.cos - dx * link.sin + 0.5 * length) * (1.0 / 1.5) / (if arm > 1.0 { arm } else { 1.0 });
                of_flank = smaller(of_flank, if within > below { within } else { below });
            }
            out[i] = smaller(of_flank, of_toe - self.toe_radius[i]);
        }
        out
    }
}

/// A flank in the gap frame, as in [`FlankLanes`].
struct FlankLine {
    start: (f64, f64),
    normal: (f64, f64),
    from_m: f64,
    to_m: f64,
}

impl FlankLine {
    #[inline(always)]
    fn distance(&self, (x, y): (f64, f64)) -> f64 {
        let (dx, dy) = (x - self.start.0, y - self.start.1);
        let (nx, ny) = self.normal;
        let (height, along) = (dx * nx + dy * ny, dy * nx - dx * ny);
        let low = if along < self.from_m { self.from_m } else { along };
        let past = along - if low > self.to_m { self.to_m } else { low };
        (height * height + past * past).sqrt()
    }

    /// Returns the distance from the flank to an arc that it does not cut [m]. The nearest points are an end of one of them, or lie on
    /// a common normal.
    #[inline(always)]
    fn distance_to_arc(&self, arc: &ArcEnds) -> f64 {
        let (nx, ny) = self.normal;
        let end = |along: f64| (self.start.0 - ny * along, self.start.1 + nx * along);
        let of_ends = smaller(arc.distance(end(self.from_m)), arc.distance(end(self.to_m)));
        let to_ends = smaller(self.distance(arc.ends[0]), self.distance(arc.ends[1]));
        let (dx, dy) = (arc.centre.0 - self.start.0, arc.centre.1 - self.start.1);
        let (height, along) = (dx * nx + dy * ny, dy * nx - dx * ny);
        let faces =
            (along >= self.from_m) & (along <= self.to_m) & (height > 0.0) & arc_has_normal(&arc.arc, -nx, -ny, 1.0);
        let between = if faces { height - arc.arc.circle.radius_m } else { f64::INFINITY };
        smaller(smaller(of_ends, to_ends), between)
    }
}

/// An arc and where it ends.
struct ArcEnds {
    arc: Arc,
    /// -1: hollow.
    sense: f64,
    centre: (f64, f64),
    ends: [(f64, f64); 2],
}

impl ArcEnds {
    #[inline(always)]
    fn new(arc: &Arc, sense: f64) -> ArcEnds {
        let (c, r) = (arc.circle.centre, sense * arc.circle.radius_m);
        let end = |normal: Vec2| (c.x + normal.x * r, c.y + normal.y * r);
        ArcEnds { arc: *arc, sense, centre: (c.x, c.y), ends: [end(arc.from), end(arc.to)] }
    }

    /// Returns the distance from a point to the arc [m]. It is negative where the point lies inside the body.
    #[inline(always)]
    fn distance(&self, (x, y): (f64, f64)) -> f64 {
        let (dx, dy) = (x - self.centre.0, y - self.centre.1);
        let length = (dx * dx + dy * dy).sqrt();
        let faces = arc_has_normal(&self.arc, self.sense * dx, self.sense * dy, length);
        let to_ends = smaller(distance((x, y), self.ends[0]), distance((x, y), self.ends[1]));
        if faces { self.sense * (length - self.arc.circle.radius_m) } else { to_ends }
    }
}

#[inline(always)]
fn distance(a: (f64, f64), b: (f64, f64)) -> f64 {
    let (dx, dy) = (a.0 - b.0, a.1 - b.1);
    (dx * dx + dy * dy).sqrt()
}

#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Whether a point of the arc has this normal; `length`: of the normal.
#[inline(always)]
fn arc_has_normal(arc: &Arc, x: f64, y: f64, length: f64) -> bool {
    let rounding = -NORMAL_ROUNDING * length;
    (arc.from.x * y - arc.from.y * x >= rounding) & (x * arc.to.y - y * arc.to.x >= rounding)
}
