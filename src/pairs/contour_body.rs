//! Contacts of a link's own contour at one of its ends: abutments on rings and guide faces, toothed flanks on teeth.
//!
//! Geometry only, one end of one link and one body at a time, by a search that knows nothing of the step before: what tests hold the
//! kernels against. All else finds the same places many at a time ([`super::arc_lanes`], [`super::flank_lanes`]); forces as in
//! [`super::tooth_contact`]. Each pair of contours gives its deepest place:
//! ```text
//! abutment, circular ring   gap = |O - K| - rho, K the foot of the perpendicular from the axis O on the contour
//! abutment, lobed ring      the common normal of contour and lobe (geometry::smartchain)
//! abutment, guide face      gap = height of the contour's support point over the face; beyond its ends the face's corner
//! flank, tooth face         gap = (T - P).n - e     line of the flank (P, n), arc of the face (T, e)
//! toe, tooth face; toe, root; flank, tip corner; crotch, tip corner: arcs and lines alike
//! ```
//! A body's frame is its origin, turned with its sprocket where it has one. Links and bodies are rigid, so the rate of the
//! gap is the relative speed of the two contact points along the normal, whatever the curvatures.

use crate::elements::body_frame::BodyFrame;
use crate::elements::contact_law::ContactLaw;
use crate::geometry::chain::silent::{Flank, LinkEnd, SilentLinkContour};
use crate::geometry::profile::Element;
use crate::geometry::silent_sprocket::SilentSprocket;
use crate::geometry::smartchain::contour::AbutmentContour;
use crate::geometry::smartchain::ring::LobedRing;
use crate::geometry::{Vec2, cross, perp};
use crate::recording::frame::{Feature, Segment};
use crate::units::sin_cos;

/// What the ends of the links of a chain touch with, besides bushes and plate ends.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkContour {
    /// Contours in the link frame, convex but for a hollow.
    Abutments { front: AbutmentContour, rear: AbutmentContour },
    /// One contour for each row.
    Flanks(Vec<SilentLinkContour>),
}

/// The contour of a body, in its frame.
#[derive(Clone, Debug, PartialEq)]
pub enum EndShape {
    /// Turns with its sprocket, so that only its radius matters [m].
    Circle { radius_m: f64 },
    /// `turn`: cosine and sine of the angle of the lobes against the tooth gaps.
    Lobes { ring: Box<LobedRing>, seats: SeatDirections, turn: (f64, f64) },
    /// From the origin along `along`, the chain on its left.
    Face { along: Vec2, length_m: f64 },
    /// Outer flanks and toes against the outer sides of their gaps.
    OuterFlanks { tooth: SilentTooth, seats: SeatDirections },
    /// Inner flanks, crotch and toes against the tooth they straddle.
    InnerFlanks { tooth: SilentTooth, seats: SeatDirections },
}

impl LinkContour {
    /// Distance from the link's centre that no point of a contour exceeds [m].
    pub fn extent_m(&self) -> f64 {
        let furthest = |points: &mut dyn Iterator<Item = f64>| points.fold(0.0, f64::max);
        match self {
            // An arc of less than half a turn lies in the disc whose diameter is its chord.
            LinkContour::Abutments { front, rear } => furthest(
                &mut front
                    .arcs()
                    .iter()
                    .chain(rear.arcs())
                    .map(|a| a.start.norm().max(a.end.norm()) + 0.5 * (a.end - a.start).norm()),
            ),
            LinkContour::Flanks(rows) => furthest(&mut rows.iter().flat_map(|row| {
                let crotch = row.crotch.centre.norm() + row.crotch.radius_m;
                let of_end = |end: &LinkEnd| {
                    let flank = |f: &Flank| f.start.norm().max(f.end.norm());
                    let toe = end.toe.centre.norm() + end.toe.radius_m;
                    flank(&end.outer_flank).max(flank(&end.inner_flank)).max(toe)
                };
                [crotch, of_end(&row.front), of_end(&row.rear)]
            })),
        }
    }

    /// Longest lever of a normal force about the link's centre [m]; `lever_m`: that of a joint. Working flanks push nearly at
    /// the centre; their toes, which touch only in distress, at the joint's lever.
    pub fn longest_arm_m(&self, lever_m: f64) -> f64 {
        match self {
            LinkContour::Abutments { front, .. } => front
                .arcs()
                .iter()
                .flat_map(|a| [(a.start, a.normal_start), (a.end, a.normal_end)])
                .map(|(p, n)| crate::geometry::cross(p, n).abs())
                .fold(0.0, f64::max),
            LinkContour::Flanks(_) => lever_m,
        }
    }
}

/// Directions of the tooth gaps in the frame of the sprocket.
#[derive(Clone, Debug, PartialEq)]
pub struct SeatDirections {
    cos: Vec<f64>,
    sin: Vec<f64>,
    /// Where gaps lie beside their places: outwards, and counterclockwise, in the frame of each [m]; empty if none does.
    shifts: Vec<Vec2>,
}

/// Arcs of one gap in the gap frame (+y = gap axis); -x is ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentTooth {
    pub(super) face: [Arc; 2],
    pub(super) corner: [Circle; 2],
    pub(super) root: Arc,
}

/// A face or a root: its circle, and its outward normals at both ends, counterclockwise. Beyond them other arcs go on, and the
/// circle is nothing. (A corner's lies in the tooth all round.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Arc {
    pub(super) circle: Circle,
    pub(super) from: Vec2,
    pub(super) to: Vec2,
}

/// Centre and radius [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Circle {
    pub(super) centre: Vec2,
    pub(super) radius_m: f64,
}

/// A body that ends of links touch.
#[derive(Clone, Debug, PartialEq)]
pub struct EndBody {
    pub name: String,
    /// Index of the chain whose links touch it.
    pub chain: usize,
    /// Index among the bodies of a recording.
    pub body: usize,
    /// Contacts of bodies with the same set never overlap: a link's end has one of them at a time.
    pub set: usize,
    /// Its frame: the axis of its sprocket, or where its face begins.
    pub frame: BodyFrame,
    pub shape: EndShape,
    pub law: ContactLaw,
    pub friction: f64,
    pub stick_speed_m_s: f64,
}

/// Sets of [`EndBody::set`]: ring or outer flanks, inner flanks, guide faces. Each has memories for front and rear ends.
pub const SETS: usize = 3;

/// The deepest place of one end on one body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EndTouch {
    /// Penetration [m], negative: gap.
    pub penetration_m: f64,
    /// On the link's contour, from the body's origin, in the world's directions [m].
    pub point: Vec2,
    /// Out of the body, towards the link.
    pub normal: Vec2,
    /// Of the link's contour and of the body's there [m]; infinite: straight; zero: corner; negative: hollow.
    pub link_radius_m: f64,
    pub body_radius_m: f64,
    pub tooth: u32,
    pub segment: Segment,
}

/// Pose of a link: centre from the body's origin, heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkPose {
    pub centre: Vec2,
    pub cos: f64,
    pub sin: f64,
    /// Signed distance of the end's joint from the centre.
    pub lever: f64,
    pub front: bool,
    pub row: usize,
}

impl LinkPose {
    pub fn joint(&self) -> Vec2 {
        self.centre + Vec2::new(self.cos, self.sin) * self.lever
    }

    fn into_link(self, v: Vec2) -> Vec2 {
        Vec2::new(self.cos * v.x + self.sin * v.y, self.cos * v.y - self.sin * v.x)
    }

    fn into_world(self, v: Vec2) -> Vec2 {
        Vec2::new(self.cos * v.x - self.sin * v.y, self.sin * v.x + self.cos * v.y)
    }
}

impl SeatDirections {
    pub fn new(teeth: u32) -> SeatDirections {
        let angle = |k: u32| 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(teeth);
        let (sin, cos) = (0..teeth).map(|k| sin_cos(angle(k))).unzip();
        SeatDirections { cos, sin, shifts: Vec::new() }
    }

    /// With gaps that lie beside their places.
    pub fn shifted(self, shifts: Vec<Vec2>) -> SeatDirections {
        SeatDirections { shifts, ..self }
    }

    pub fn is_shifted(&self) -> bool {
        !self.shifts.is_empty()
    }

    /// By how much gap `k` lies beside its place; `axis`: direction of its axis, in whose frame the answer is.
    pub fn shift(&self, k: usize, axis: Vec2) -> Vec2 {
        self.shifts.get(k).map_or(Vec2::zeros(), |shift| axis * shift.x + perp(axis) * shift.y)
    }

    /// The most that any gap does [m].
    pub fn most_shift_m(&self) -> f64 {
        self.shifts.iter().map(Vec2::norm).fold(0.0, f64::max)
    }

    /// Direction of the axis of gap `k`: cosine, sine.
    pub fn direction(&self, k: usize) -> (f64, f64) {
        (self.cos[k], self.sin[k])
    }

    /// Tangent of an angle to the axis of a gap below which [`SeatDirections::nearest`] is sure to name that gap.
    pub fn sure_tan(&self) -> f64 {
        let (sin, cos) = sin_cos(std::f64::consts::PI / self.cos.len() as f64 - ROUGH_ANGLE_RAD - 1e-6);
        sin / cos
    }

    /// The gap whose axis is nearest to the direction of `p`, and the direction of that axis, in the frame of `p`.
    pub fn nearest(&self, p: Vec2, rotor: (f64, f64)) -> (usize, Vec2) {
        let (c, s) = rotor;
        let (x, y) = (c * p.x + s * p.y, c * p.y - s * p.x);
        let z = self.cos.len();
        let estimate = rough_angle(x, y) * (z as f64 / (2.0 * std::f64::consts::PI));
        let k = (libm::floor(estimate + 0.5) as i64).rem_euclid(z as i64) as usize;
        (k, Vec2::new(c * self.cos[k] - s * self.sin[k], s * self.cos[k] + c * self.sin[k]))
    }
}

/// More than the largest error of [`rough_angle`], which it has on the diagonals: 2.03e-4 rad.
const ROUGH_ANGLE_RAD: f64 = 2.1e-4;

/// atan2(y, x) to 2.1e-4 rad (minimax polynomial of degree 7 on an octant): enough to tell in which gap a joint is, a quarter
/// of the cost.
fn rough_angle(x: f64, y: f64) -> f64 {
    let (a, b) = (x.abs(), y.abs());
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    let t = low / high.max(1e-300);
    let s = t * t;
    let octant = t + t * s * ((-0.046_496_474_9 * s + 0.159_314_22) * s - 0.327_622_764);
    let quadrant = if b > a { 0.5 * std::f64::consts::PI - octant } else { octant };
    let half = if x < 0.0 { std::f64::consts::PI - quadrant } else { quadrant };
    if y < 0.0 { 0.0 - half } else { half }
}

impl Arc {
    /// Whether one of its points has this normal; at its ends its neighbours touch alike.
    fn has(&self, normal: Vec2) -> bool {
        cross(self.from, normal) >= -NORMAL_ROUNDING && cross(normal, self.to) >= -NORMAL_ROUNDING
    }
}

/// Normals within this of an arc's end count as on it: rounding.
pub(super) const NORMAL_ROUNDING: f64 = 1e-12;

impl SilentTooth {
    /// Distance from the axis within which the joint of an end must be to touch [m].
    pub fn reach_m(&self, lever_m: f64) -> f64 {
        self.corner[0].centre.norm() + self.corner[0].radius_m + 2.0 * lever_m
    }

    /// None where the face is a line.
    pub fn new(sprocket: &SilentSprocket) -> Option<SilentTooth> {
        let gap = sprocket.gap_elements();
        let circle = |e: &Element| match *e {
            Element::Arc { centre, radius_m, .. } => Some(Circle { centre, radius_m }),
            Element::Line { .. } => None,
        };
        let arc = |e: &Element| {
            let (start, end) = (e.normal(0.0), e.normal(1.0));
            let (from, to) = if cross(start, end) < 0.0 { (end, start) } else { (start, end) };
            Some(Arc { circle: circle(e)?, from, to })
        };
        Some(SilentTooth {
            // Behind (+x) and ahead (-x).
            face: [arc(&gap[2])?, arc(&gap[4])?],
            corner: [circle(&gap[1])?, circle(&gap[5])?],
            root: arc(&gap[3])?,
        })
    }
}

/// Gap beyond which an end's contour is of no interest to a search for equilibrium [m].
pub const FAR_M: f64 = 0.3e-3;

impl EndBody {
    /// Distance from the origin (of a face: from its line) within which a link's centre must be to touch [m].
    pub fn reach_m(&self, lever_m: f64) -> f64 {
        match &self.shape {
            EndShape::Circle { radius_m } => radius_m + 3.0 * lever_m,
            EndShape::Lobes { ring, .. } => ring.crest_radius_m + 3.0 * lever_m,
            EndShape::Face { .. } => 3.0 * lever_m,
            EndShape::OuterFlanks { tooth, seats } | EndShape::InnerFlanks { tooth, seats } => {
                tooth.corner[0].centre.norm() + tooth.corner[0].radius_m + 3.0 * lever_m + seats.most_shift_m()
            }
        }
    }

    /// Whether a link whose centre lies at `centre` from the origin may touch.
    pub fn within_reach(&self, centre: Vec2, lever_m: f64) -> bool {
        self.distance_m(centre) < self.reach_m(lever_m)
    }

    /// Distance from the origin, of a face from its line [m].
    pub fn distance_m(&self, p: Vec2) -> f64 {
        match self.shape {
            EndShape::Face { along, length_m } => (p - along * p.dot(&along).clamp(0.0, length_m)).norm(),
            EndShape::Circle { .. }
            | EndShape::Lobes { .. }
            | EndShape::OuterFlanks { .. }
            | EndShape::InnerFlanks { .. } => p.norm(),
        }
    }

    /// Deepest place of an end, None when its gap is `far_m` or more. `rotor`: cosine and sine of the sprocket's angle.
    pub fn touch(&self, contour: &LinkContour, pose: &LinkPose, rotor: (f64, f64), far_m: f64) -> Option<EndTouch> {
        match (&self.shape, contour) {
            (EndShape::Circle { radius_m }, LinkContour::Abutments { front, rear }) => {
                let abutment = if pose.front { front } else { rear };
                let foot = abutment.closest_to_point(pose.into_link(-pose.centre));
                let penetration_m = radius_m - foot.distance_m;
                (penetration_m > -far_m).then(|| EndTouch {
                    penetration_m,
                    point: pose.centre + pose.into_world(foot.point),
                    normal: -pose.into_world(foot.normal),
                    link_radius_m: foot.radius_m,
                    body_radius_m: *radius_m,
                    tooth: 0,
                    segment: Segment::Ring,
                })
            }
            (EndShape::Lobes { ring, seats, turn }, LinkContour::Abutments { front, rear }) => {
                let abutment = if pose.front { front } else { rear };
                lobe_touch(ring, seats, *turn, abutment, pose, rotor, far_m)
            }
            (EndShape::Face { along, length_m }, LinkContour::Abutments { front, rear }) => {
                face_touch(*along, *length_m, if pose.front { front } else { rear }, pose, far_m)
            }
            (EndShape::OuterFlanks { tooth, seats }, LinkContour::Flanks(rows)) => {
                flank_touch(tooth, seats, &rows[pose.row], pose, rotor, true, far_m)
            }
            (EndShape::InnerFlanks { tooth, seats }, LinkContour::Flanks(rows)) => {
                flank_touch(tooth, seats, &rows[pose.row], pose, rotor, false, far_m)
            }
            _ => None,
        }
    }

    /// No link that may touch has its centre farther from the origin than this [m].
    pub fn distance_bound_m(&self, lever_m: f64) -> f64 {
        match self.shape {
            EndShape::Face { length_m, .. } => length_m + self.reach_m(lever_m),
            EndShape::Circle { .. }
            | EndShape::Lobes { .. }
            | EndShape::OuterFlanks { .. }
            | EndShape::InnerFlanks { .. } => self.reach_m(lever_m),
        }
    }

    /// Whether its contacts are in tooth gaps.
    pub fn has_teeth(&self) -> bool {
        match self.shape {
            EndShape::Lobes { .. } | EndShape::OuterFlanks { .. } | EndShape::InnerFlanks { .. } => true,
            EndShape::Circle { .. } | EndShape::Face { .. } => false,
        }
    }

    /// Returns the direction of a guide's face as a unit vector; None for bodies that are no guide.
    pub fn face_direction(&self) -> Option<Vec2> {
        match self.shape {
            EndShape::Face { along, .. } => Some(along),
            EndShape::Circle { .. }
            | EndShape::Lobes { .. }
            | EndShape::OuterFlanks { .. }
            | EndShape::InnerFlanks { .. } => None,
        }
    }

    /// Returns the name of the part of a link that touches this body.
    pub fn part_name(&self) -> &'static str {
        match &self.shape {
            EndShape::OuterFlanks { .. } => "outer flank",
            EndShape::InnerFlanks { .. } => "inner flank",
            EndShape::Circle { .. } | EndShape::Lobes { .. } | EndShape::Face { .. } => "abutment",
        }
    }

    /// What a recording calls this end.
    pub fn feature(&self, front: bool) -> Feature {
        match (&self.shape, front) {
            (EndShape::OuterFlanks { .. }, true) => Feature::FrontOuterFlank,
            (EndShape::OuterFlanks { .. }, false) => Feature::RearOuterFlank,
            (EndShape::InnerFlanks { .. }, true) => Feature::FrontInnerFlank,
            (EndShape::InnerFlanks { .. }, false) => Feature::RearInnerFlank,
            (_, true) => Feature::FrontAbutment,
            (_, false) => Feature::RearAbutment,
        }
    }
}

fn lobe_touch(
    ring: &LobedRing,
    seats: &SeatDirections,
    (c, s): (f64, f64),
    abutment: &AbutmentContour,
    pose: &LinkPose,
    rotor: (f64, f64),
    far_m: f64,
) -> Option<EndTouch> {
    let axis = pose.into_link(-pose.centre);
    // The lowest and the highest circle first: most links are beyond both.
    let near = abutment.closest_to_point(axis);
    if ring.crest_radius_m - near.distance_m < -far_m {
        return None;
    }
    let (tooth, seat) = seats.nearest(pose.joint(), rotor);
    let turned = Vec2::new(c * seat.x - s * seat.y, s * seat.x + c * seat.y);
    // +y of the gap frame points along the seat.
    let gap_axis = pose.into_link(turned);
    let contact = ring.contact_at(abutment, axis, Vec2::new(gap_axis.y, 0.0 - gap_axis.x))?;
    Some(EndTouch {
        penetration_m: 0.0 - contact.gap_m,
        point: pose.centre + pose.into_world(contact.point),
        normal: -pose.into_world(contact.normal),
        link_radius_m: contact.abutment_radius_m,
        body_radius_m: contact.ring_radius_m,
        tooth: tooth as u32,
        segment: Segment::Ring,
    })
}

fn face_touch(along: Vec2, length_m: f64, abutment: &AbutmentContour, pose: &LinkPose, far_m: f64) -> Option<EndTouch> {
    let up = perp(along);
    // Down into the face, as the link sees it.
    let (height, point, link_radius_m) = abutment.support_with_radius(pose.into_link(-up));
    let world = pose.centre + pose.into_world(point);
    let penetration_m = height - pose.centre.dot(&up);
    if penetration_m < -far_m {
        return None;
    }
    let at = world.dot(&along);
    if (0.0..=length_m).contains(&at) {
        return Some(EndTouch {
            penetration_m,
            point: world,
            normal: up,
            link_radius_m,
            body_radius_m: f64::INFINITY,
            tooth: 0,
            segment: Segment::GuideFace,
        });
    }
    // Past an end: the face's corner against the contour.
    let (corner, segment) =
        if at < 0.0 { (Vec2::zeros(), Segment::GuideLeadIn) } else { (along * length_m, Segment::GuideLeadOut) };
    let foot = abutment.closest_to_point(pose.into_link(corner - pose.centre));
    if foot.radius_m == 0.0 {
        return None;
    }
    (foot.distance_m < far_m).then(|| EndTouch {
        penetration_m: 0.0 - foot.distance_m,
        point: pose.centre + pose.into_world(foot.point),
        normal: -pose.into_world(foot.normal),
        link_radius_m: foot.radius_m,
        body_radius_m: 0.0,
        tooth: 0,
        segment,
    })
}

/// The deepest of the pairs of one side of a link's end; outer or inner. In the gap frame, mirrored for rear ends so that
/// the outer flank always faces the circle of index `side`.
fn flank_touch(
    tooth: &SilentTooth,
    seats: &SeatDirections,
    contour: &SilentLinkContour,
    pose: &LinkPose,
    rotor: (f64, f64),
    outer: bool,
    far_m: f64,
) -> Option<EndTouch> {
    let joint = pose.joint();
    let limit = tooth.reach_m(pose.lever.abs()) + seats.most_shift_m();
    if joint.norm_squared() > limit * limit {
        return None;
    }
    let (gap, axis) = seats.nearest(joint, rotor);
    let end = if pose.front { &contour.front } else { &contour.rear };
    let flank = if outer { &end.outer_flank } else { &end.inner_flank };
    // Ahead of a front end for the outer flank, behind it for the inner one.
    let side = usize::from(pose.front == outer);
    // Gap frame: +y along the axis, +x to its right.
    let into_gap = |v: Vec2| Vec2::new(axis.y * v.x - axis.x * v.y, axis.dot(&v));
    let out_of_gap = |v: Vec2| Vec2::new(axis.y * v.x + axis.x * v.y, axis.y * v.y - axis.x * v.x);
    let shift = seats.shift(gap, axis);
    let placed = |p: Vec2| into_gap(pose.centre + pose.into_world(p) - shift);
    let turned = |v: Vec2| into_gap(pose.into_world(v));
    let (start, stop, normal) = (placed(flank.start), placed(flank.end), turned(flank.normal));
    let toe = Circle { centre: placed(end.toe.centre), radius_m: end.toe.radius_m };
    let mut best: Option<EndTouch> = None;
    let mut offer = |found: Option<EndTouch>| {
        if let Some(new) = found.filter(|new| new.penetration_m > -far_m)
            && best.is_none_or(|old| new.penetration_m > old.penetration_m)
        {
            best = Some(new);
        }
    };
    let face_name = if side == 1 { Segment::FlankCounterclockwise } else { Segment::FlankClockwise };
    let face = &tooth.face[side];
    offer(line_arc(start, stop, normal, &face.circle, face_name).filter(|t| face.has(t.normal)));
    offer(line_arc(start, stop, normal, &tooth.corner[side], Segment::TipCorner));
    // The toe reaches from one flank to the other.
    let ends = [turned(end.outer_flank.normal), turned(end.inner_flank.normal)];
    let sense = cross(ends[0], ends[1]);
    let on_toe =
        |out: Vec2| cross(ends[0], out) * sense >= -NORMAL_ROUNDING && cross(out, ends[1]) * sense >= -NORMAL_ROUNDING;
    offer(Some(arc_arc(&toe, &face.circle, face_name)).filter(|t| face.has(t.normal) && on_toe(-t.normal)));
    offer(Some(arc_arc(&toe, &tooth.corner[side], Segment::TipCorner)).filter(|t| on_toe(-t.normal)));
    if outer {
        offer(arc_in_hollow(&toe, &tooth.root.circle).filter(|t| tooth.root.has(t.normal) && on_toe(-t.normal)));
    } else {
        let crotch = Circle { centre: placed(contour.crotch.centre), radius_m: contour.crotch.radius_m };
        offer(corner_in_crotch(&tooth.corner[side], &crotch, turned(Vec2::new(0.0, 1.0))));
    }
    best.map(|t| EndTouch { point: out_of_gap(t.point) + shift, normal: out_of_gap(t.normal), tooth: gap as u32, ..t })
}

/// A link's flank on a convex arc of the body; `normal` out of the link.
fn line_arc(start: Vec2, end: Vec2, normal: Vec2, arc: &Circle, segment: Segment) -> Option<EndTouch> {
    let height = (arc.centre - start).dot(&normal);
    let point = arc.centre - normal * height;
    let d = end - start;
    let along = (point - start).dot(&d);
    (height > 0.0 && along >= 0.0 && along <= d.norm_squared()).then_some(EndTouch {
        penetration_m: arc.radius_m - height,
        point,
        normal: -normal,
        link_radius_m: f64::INFINITY,
        body_radius_m: arc.radius_m,
        tooth: 0,
        segment,
    })
}

/// A link's toe on a convex arc of the body.
fn arc_arc(toe: &Circle, arc: &Circle, segment: Segment) -> EndTouch {
    let d = toe.centre - arc.centre;
    let distance = d.norm();
    let normal = d / distance;
    EndTouch {
        penetration_m: toe.radius_m + arc.radius_m - distance,
        point: toe.centre - normal * toe.radius_m,
        normal,
        link_radius_m: toe.radius_m,
        body_radius_m: arc.radius_m,
        tooth: 0,
        segment,
    }
}

/// A link's toe in the root.
fn arc_in_hollow(toe: &Circle, root: &Circle) -> Option<EndTouch> {
    let d = toe.centre - root.centre;
    let distance = d.norm();
    (d.y < 0.0).then(|| {
        let outward = d / distance;
        EndTouch {
            penetration_m: distance + toe.radius_m - root.radius_m,
            point: toe.centre + outward * toe.radius_m,
            normal: -outward,
            link_radius_m: toe.radius_m,
            body_radius_m: -root.radius_m,
            tooth: 0,
            segment: Segment::Seat,
        }
    })
}

/// The tip corner of a tooth in the crotch of the link that straddles it. `inward`: out of the link's teeth.
fn corner_in_crotch(corner: &Circle, crotch: &Circle, inward: Vec2) -> Option<EndTouch> {
    let d = corner.centre - crotch.centre;
    let distance = d.norm();
    if distance == 0.0 || d.dot(&inward) > -0.5 * distance {
        return None;
    }
    let outward = d / distance;
    Some(EndTouch {
        penetration_m: distance + corner.radius_m - crotch.radius_m,
        point: crotch.centre + outward * crotch.radius_m,
        normal: outward,
        link_radius_m: -crotch.radius_m,
        body_radius_m: corner.radius_m,
        tooth: 0,
        segment: Segment::TipCorner,
    })
}
