//! Plates on rails, many at a time.
//!
//! A plate is a stadium: circles of radius r about both joints, and straight edges at the distance r from the axis between them. On
//! straight and on concave parts of a rail it lies with the circles of its ends; a convex arc it touches at one point of the whole stadium,
//! most often of its edge. So a plate has three contacts with a rail:
//! ```text
//! front, rear end on a line          gap = height of the joint over the line - r
//!                 on a concave arc   gap = R - |p - c| - r
//! edge            on a convex arc    gap = |q - c| - R - r,   q the point of the axis, ends included, that is nearest to the centre c
//!                 at an edge support gap = |q - b| - r,       where the flat edge reaches over the end b of a line
//! ```
//! A flat edge on a line is carried at both ends of what they share: ends of the plate, or edge supports. The edge's contact point moves along
//! the plate while it rolls and slides over an arc; where a joint passes an edge support, the contact of the end becomes that of the edge or the
//! other way round: gap and normal are continuous there, and the contact is one and the same (the step transfers its memory).
//!
//! Second derivative of the gap of an edge that turns with the link (omega), on a rail that turns about the origin (W), s the place of q
//! on the axis, u the speed of q along the axis against the centre c, rho = |q - c|:
//! ```text
//! gap'' = n.(a_q - a_c) + 2 omega u - omega^2 rho,   a_q = a + alpha s perp(e),   a_c = W' perp(c) - W^2 c
//! ```
//! Forces as in [`super::tooth_contact`], with the rail's inertia in the effective mass where a coordinate carries it.

use super::bush_tooth::Lanes;
use crate::elements::body_frame::FrameMotion;
use crate::elements::contact_law::ContactLaw;
use crate::geometry::rail::{Piece, Rail};
use crate::geometry::{Vec2, cross, perp};
use crate::lanes::{LANES, LaneBlock, LaneMask, mask};

/// A rail as the contact sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct RailBody {
    pub pieces: Vec<Piece>,
    /// Radius of the plate ends [m].
    pub plate_radius_m: f64,
    /// 0: inside the loop, 1: outside.
    pub side: usize,
    pub law: ContactLaw,
    pub friction: f64,
    pub stick_speed_m_s: f64,
    /// Whether there are pieces that a part of a plate can touch, in the order of [`PlatePart::ALL`].
    pub touches: [bool; 3],
}

/// Which of a plate's three contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlatePart {
    Front,
    Rear,
    Edge,
}

impl PlatePart {
    pub const ALL: [PlatePart; 3] = [PlatePart::Front, PlatePart::Rear, PlatePart::Edge];

    /// Where an end lies on the axis of its link: 1 in front, -1 behind.
    #[inline(always)]
    fn end(self) -> f64 {
        match self {
            PlatePart::Front => 1.0,
            PlatePart::Rear => -1.0,
            PlatePart::Edge => 0.0,
        }
    }

    /// Whether a piece is one of its kind.
    #[inline(always)]
    fn touches(self, piece: &Piece) -> bool {
        match *piece {
            Piece::Line { .. } => self != PlatePart::Edge,
            Piece::EdgeSupport { .. } => self == PlatePart::Edge,
            Piece::Arc { radius_m, .. } => (radius_m < 0.0) != (self == PlatePart::Edge),
        }
    }
}

/// Where a part of a plate touches a rail, in the rail's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateTouch {
    /// Index into [`RailBody::pieces`].
    pub piece: usize,
    /// Negative: gap [m].
    pub penetration_m: f64,
    /// Out of the rail.
    pub normal: Vec2,
    /// Where on the axis of the link, from its centre towards the front joint [m].
    pub along_m: f64,
    /// Radius of curvature of the rail there [m]: infinite on a line, negative where it is concave, zero at a point.
    pub body_radius_m: f64,
    /// Whether the plate is straight there.
    pub is_flat: bool,
}

impl RailBody {
    pub fn new(rail: &Rail, plate_radius_m: f64, law: ContactLaw, friction: f64, stick: f64) -> RailBody {
        RailBody {
            pieces: rail.pieces.clone(),
            plate_radius_m,
            side: usize::from(rail.travel < 0.0),
            law,
            friction,
            stick_speed_m_s: stick,
            touches: PlatePart::ALL.map(|part| rail.pieces.iter().any(|piece| part.touches(piece))),
        }
    }

    /// Radius of curvature of a piece [m]: infinite on a line, negative where it is concave, zero at a point.
    pub fn radius_at(&self, piece: usize) -> f64 {
        match self.pieces.get(piece) {
            Some(Piece::Arc { radius_m, .. }) => *radius_m,
            Some(Piece::EdgeSupport { .. }) => 0.0,
            Some(Piece::Line { .. }) | None => f64::INFINITY,
        }
    }

    /// Where a part of a plate is nearest to the rail; None where it is not over any piece of its kind, or deeper than a plate's radius: on
    /// the other side of the loop. `centre`, `heading`: of the link, in the rail's frame; `lever_m`: from there to its joints.
    pub fn touch(&self, part: PlatePart, centre: Vec2, heading: Vec2, lever_m: f64) -> Option<PlateTouch> {
        self.touch_bent(part, (centre, heading), lever_m, 0.0)
    }

    /// As [`RailBody::touch`], of a rail that may be bent back by `bent_m`.
    pub fn touch_bent(
        &self,
        part: PlatePart,
        (centre, heading): (Vec2, Vec2),
        lever_m: f64,
        bent_m: f64,
    ) -> Option<PlateTouch> {
        let r = self.plate_radius_m;
        let touch = |(piece, p): (usize, &Piece)| -> Option<PlateTouch> {
            let end = |sign: f64| (sign * lever_m, centre + heading * (sign * lever_m));
            let (along_m, q) = match part {
                PlatePart::Front => end(1.0),
                PlatePart::Rear => end(-1.0),
                PlatePart::Edge => {
                    let (Piece::Arc { centre: c, .. } | Piece::EdgeSupport { point: c, .. }) = *p else { return None };
                    let along = (c - centre).dot(&heading).clamp(-lever_m, lever_m);
                    (along, centre + heading * along)
                }
            };
            let is_flat = part == PlatePart::Edge && along_m.abs() < lever_m;
            match *p {
                Piece::Line { start, along, length_m } if part != PlatePart::Edge => {
                    let d = q - start;
                    let foot = d.dot(&along);
                    let normal = -perp(along);
                    let inside = foot >= 0.0 && foot < length_m;
                    inside.then_some(PlateTouch {
                        piece,
                        penetration_m: r - d.dot(&normal),
                        normal,
                        along_m,
                        body_radius_m: f64::INFINITY,
                        is_flat,
                    })
                }
                Piece::EdgeSupport { point, normal: up } if is_flat => {
                    let d = q - point;
                    let distance = d.norm();
                    (d.dot(&up) > 0.0).then(|| PlateTouch {
                        piece,
                        penetration_m: r - distance,
                        normal: d / distance,
                        along_m,
                        body_radius_m: self.radius_at(piece),
                        is_flat,
                    })
                }
                Piece::Arc { centre: c, radius_m, from, to } if (radius_m < 0.0) != (part == PlatePart::Edge) => {
                    let d = q - c;
                    let distance = d.norm();
                    let sense = if radius_m < 0.0 { -1.0 } else { 1.0 };
                    let normal = d * (sense / distance);
                    let inside = sense * cross(from, normal) >= 0.0 && sense * cross(normal, to) > 0.0;
                    (inside && distance > 0.0).then_some(PlateTouch {
                        piece,
                        penetration_m: radius_m + r - sense * distance,
                        normal,
                        along_m,
                        body_radius_m: self.radius_at(piece),
                        is_flat,
                    })
                }
                Piece::Line { .. } | Piece::Arc { .. } | Piece::EdgeSupport { .. } => None,
            }
        };
        let deep = |t: &PlateTouch| t.penetration_m < r + bent_m;
        // The nearest surface: of two that a part is over, the one that it is less far above.
        self.pieces
            .iter()
            .enumerate()
            .filter_map(touch)
            .filter(deep)
            .reduce(|best, t| if t.penetration_m > best.penetration_m { t } else { best })
    }
}

/// Radius that contact laws take for a part of a rail [m]. assumed: edges are broken; only laws with radii see it.
#[inline(always)]
pub fn law_radius_m(radius_m: f64) -> f64 {
    const BROKEN_EDGE_M: f64 = 1e-3;
    if radius_m == 0.0 { BROKEN_EDGE_M } else { radius_m }
}

/// Penetration of a part that no piece of the rail faces [m]: nothing can touch from there within a step.
const NO_FACING_PIECE_M: f64 = -1.0;

/// Lanes of a part that no piece of a rail is for: they stand still, far from anything.
#[inline(always)]
pub fn face_nothing(lanes: &mut Lanes) -> RailContactLanes {
    let zero = [0.0; LANES];
    lanes.release();
    (lanes.x, lanes.y, lanes.vx, lanes.vy, lanes.ax, lanes.ay) = (zero, zero, zero, zero, zero, zero);
    (lanes.omega, lanes.lever, lanes.curvature) = (zero, zero, zero);
    (lanes.normal_x, lanes.normal_y) = (zero, [1.0; LANES]);
    (lanes.penetration, lanes.body_radius) = ([NO_FACING_PIECE_M; LANES], [f64::INFINITY; LANES]);
    RailContactLanes::default()
}

/// What [`find_contacts`] finds beside what it puts into the lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct RailContactLanes {
    /// Whether the part faces a piece of the rail: elsewhere the lane stands still, far from anything.
    pub here: [bool; LANES],
    /// Index of the piece, as a number.
    pub piece: LaneBlock,
    /// Radius of curvature of the plate there [m]: infinite on its straight edge.
    pub link_radius: LaneBlock,
}

/// Geometry and kinematics of one part of the plates of a block of links. The lanes hold the links' centres from the rail's origin, their
/// velocities and accelerations there, headings, and half pitches as levers; the point of contact's take their place. `bent_m`: how far behind
/// where it is drawn the rail may lie. `far_m`: where all lanes are further from touching than that, they get their penetration, and the rest of them must not be used.
#[inline(always)]
pub fn find_contacts(
    (body, bent_m, far_m): (&RailBody, f64, f64),
    part: PlatePart,
    swing: FrameMotion,
    link_alpha: &LaneBlock,
    lanes: &mut Lanes,
) -> RailContactLanes {
    let mut nearest = NearestPieces::new((body.plate_radius_m, body.plate_radius_m + bent_m), swing, lanes);
    for (index, piece) in body.pieces.iter().enumerate().filter(|(_, piece)| part.touches(piece)) {
        match *piece {
            Piece::Line { start, along, length_m } => nearest.line(index, part, (start, along, length_m)),
            Piece::EdgeSupport { point, normal } => nearest.edge_support(index, point, normal),
            Piece::Arc { centre, radius_m, from, to } => nearest.arc(index, part, (centre, radius_m, from, to)),
        }
    }
    if nearest.depth.iter().all(|depth| *depth < -far_m) {
        lanes.penetration = nearest.depth;
        return nearest.found();
    }
    nearest.move_lanes_to_contacts(part, swing, link_alpha, lanes)
}

/// The nearest piece of every lane so far, in the rail's frame. Every lane computes everything and keeps what holds for it, so that lanes live in vector
/// registers.
struct NearestPieces {
    plate_radius_m: f64,
    deepest_m: f64,
    /// Centre and heading of the link, and half its pitch.
    x: LaneBlock,
    y: LaneBlock,
    heading_x: LaneBlock,
    heading_y: LaneBlock,
    lever: LaneBlock,
    /// What is found: see [`PlateTouch`]; `bend`: of the joint's path along the piece, as [`Lanes::curvature`].
    here: LaneMask,
    depth: LaneBlock,
    place: LaneBlock,
    normal_x: LaneBlock,
    normal_y: LaneBlock,
    bend: LaneBlock,
    radius: LaneBlock,
    piece: LaneBlock,
}

/// What a piece is to a lane, where `faces` says that the lane faces it: where on the axis, penetration, normal and bend.
struct PieceLane {
    faces: u64,
    place: f64,
    depth: f64,
    normal_x: f64,
    normal_y: f64,
    bend: f64,
}

/// One lane of two blocks by a mask.
#[inline(always)]
fn select(yes: u64, a: f64, b: f64) -> f64 {
    if yes != 0 { a } else { b }
}

impl NearestPieces {
    #[inline(always)]
    fn new((plate_radius_m, deepest_m): (f64, f64), swing: FrameMotion, lanes: &Lanes) -> NearestPieces {
        let FrameMotion { cos: c, sin: s, .. } = swing;
        let zero = [0.0; LANES];
        let (mut x, mut y, mut heading_x, mut heading_y) = (zero, zero, zero, zero);
        for i in 0..LANES {
            x[i] = c * lanes.x[i] + s * lanes.y[i];
            y[i] = c * lanes.y[i] - s * lanes.x[i];
            heading_x[i] = c * lanes.cos[i] + s * lanes.sin[i];
            heading_y[i] = c * lanes.sin[i] - s * lanes.cos[i];
        }
        NearestPieces {
            plate_radius_m,
            deepest_m,
            x,
            y,
            heading_x,
            heading_y,
            lever: lanes.lever,
            here: [0; LANES],
            depth: [NO_FACING_PIECE_M; LANES],
            place: zero,
            normal_x: zero,
            normal_y: [1.0; LANES],
            bend: zero,
            radius: [f64::INFINITY; LANES],
            piece: zero,
        }
    }

    /// From a point of the rail to the point `at` of a link's axis.
    #[inline(always)]
    fn vector_from(&self, i: usize, point: Vec2, at: f64) -> (f64, f64) {
        (self.x[i] + self.heading_x[i] * at - point.x, self.y[i] + self.heading_y[i] * at - point.y)
    }

    /// Where on the axis of a link a point of the rail has its foot.
    #[inline(always)]
    fn foot_on_axis(&self, i: usize, point: Vec2) -> f64 {
        (point.x - self.x[i]) * self.heading_x[i] + (point.y - self.y[i]) * self.heading_y[i]
    }

    /// Takes a piece in a lane that faces it and is nearer to it than to what there is.
    #[inline(always)]
    fn keep_if_nearer(&mut self, i: usize, index: usize, radius_m: f64, own: PieceLane) {
        let p = own.depth;
        let nearer = own.faces & mask(p < self.deepest_m) & (!self.here[i] | mask(p > self.depth[i]));
        self.depth[i] = select(nearer, p, self.depth[i]);
        self.place[i] = select(nearer, own.place, self.place[i]);
        self.normal_x[i] = select(nearer, own.normal_x, self.normal_x[i]);
        self.normal_y[i] = select(nearer, own.normal_y, self.normal_y[i]);
        self.bend[i] = select(nearer, own.bend, self.bend[i]);
        self.radius[i] = select(nearer, radius_m, self.radius[i]);
        self.piece[i] = select(nearer, index as f64, self.piece[i]);
        self.here[i] |= nearer;
    }

    /// What is found, as a round end of the plate touches it.
    #[inline(always)]
    fn found(&self) -> RailContactLanes {
        RailContactLanes {
            here: std::array::from_fn(|i| self.here[i] != 0),
            piece: self.piece,
            link_radius: [self.plate_radius_m; LANES],
        }
    }

    #[inline(always)]
    fn line(&mut self, index: usize, part: PlatePart, (start, along, length_m): (Vec2, Vec2, f64)) {
        for i in 0..LANES {
            let place = part.end() * self.lever[i];
            let (dx, dy) = self.vector_from(i, start, place);
            let foot = dx * along.x + dy * along.y;
            let own = PieceLane {
                faces: mask(foot >= 0.0) & mask(foot < length_m),
                place,
                depth: self.plate_radius_m - (dx * along.y - dy * along.x),
                normal_x: along.y,
                normal_y: -along.x,
                bend: 0.0,
            };
            self.keep_if_nearer(i, index, f64::INFINITY, own);
        }
    }

    #[inline(always)]
    fn edge_support(&mut self, index: usize, point: Vec2, normal: Vec2) {
        for i in 0..LANES {
            let place = self.foot_on_axis(i, point);
            let (dx, dy) = self.vector_from(i, point, place);
            let distance = length(dx, dy);
            let scale = 1.0 / distance;
            let is_above = mask(dx * normal.x + dy * normal.y > 0.0);
            let own = PieceLane {
                faces: mask(place < self.lever[i]) & mask(place > -self.lever[i]) & is_above,
                place,
                depth: self.plate_radius_m - distance,
                normal_x: dx * scale,
                normal_y: dy * scale,
                bend: 0.0 - scale,
            };
            self.keep_if_nearer(i, index, 0.0, own);
        }
    }

    #[inline(always)]
    fn arc(&mut self, index: usize, part: PlatePart, (centre, radius_m, from, to): (Vec2, f64, Vec2, Vec2)) {
        let sense = if radius_m < 0.0 { -1.0 } else { 1.0 };
        let zero = [0.0; LANES];
        let (mut places, mut dx, mut dy, mut faces) = (zero, zero, zero, [0; LANES]);
        for i in 0..LANES {
            let lever = self.lever[i];
            let place = match part {
                PlatePart::Edge => {
                    let foot = self.foot_on_axis(i, centre);
                    let foot = if foot < -lever { -lever } else { foot };
                    if foot > lever { lever } else { foot }
                }
                PlatePart::Front | PlatePart::Rear => part.end() * lever,
            };
            (dx[i], dy[i]) = self.vector_from(i, centre, place);
            faces[i] = mask(from.x * dy[i] - from.y * dx[i] >= 0.0) & mask(dx[i] * to.y - dy[i] * to.x > 0.0);
            places[i] = place;
        }
        // Most blocks of links are beside an arc.
        if faces.iter().fold(0, |any, own| any | own) == 0 {
            return;
        }
        for i in 0..LANES {
            let distance = length(dx[i], dy[i]);
            let scale = sense / distance;
            let own = PieceLane {
                faces: faces[i],
                place: places[i],
                depth: radius_m + self.plate_radius_m - sense * distance,
                normal_x: dx[i] * scale,
                normal_y: dy[i] * scale,
                bend: 0.0 - scale,
            };
            self.keep_if_nearer(i, index, radius_m, own);
        }
    }

    /// Puts the points of contact in the place of the links: positions, velocities and accelerations against the rail, normals. A lane that faces no
    /// piece of the rail stands still, far from anything: its speed against a rail that turns says nothing, for a lane without a link is a kilometre away.
    #[inline(always)]
    fn move_lanes_to_contacts(
        &self,
        part: PlatePart,
        swing: FrameMotion,
        link_alpha: &LaneBlock,
        lanes: &mut Lanes,
    ) -> RailContactLanes {
        let FrameMotion { cos: c, sin: s, omega, alpha, .. } = swing;
        let mut found = self.found();
        for i in 0..LANES {
            let here = self.here[i];
            let (at, lever) = (self.place[i], self.lever[i]);
            let (e, f, turn) = (lanes.cos[i], lanes.sin[i], lanes.omega[i]);
            let (wx, wy) = (c * self.normal_x[i] - s * self.normal_y[i], s * self.normal_x[i] + c * self.normal_y[i]);
            let (px, py) = (lanes.x[i] + e * at, lanes.y[i] + f * at);
            let (vx, vy) = (lanes.vx[i] - turn * at * f, lanes.vy[i] + turn * at * e);
            // Acceleration against the points of the rail.
            let mut ax = lanes.ax[i] - link_alpha[i] * at * f + alpha * py;
            let mut ay = lanes.ay[i] + link_alpha[i] * at * e - alpha * px;
            let mut bend = self.bend[i];
            if part == PlatePart::Edge {
                let flat = mask(at < lever) & mask(at > -lever);
                // The normal of a flat edge turns with the link. `rates` assumes a normal that turns with the rail: the difference.
                let rho = self.radius[i] + self.plate_radius_m - self.depth[i];
                let (cx, cy) = (px - wx * rho, py - wy * rho);
                let u = wx * (vy - omega * cx) - wy * (vx + omega * cy);
                let with_rail = wx * (2.0 * vy - omega * px) - wy * (2.0 * vx + omega * py);
                let with_link = 2.0 * turn * u - turn * turn * rho;
                let extra = with_link + omega * omega * (cx * wx + cy * wy) - omega * with_rail;
                ax = select(flat, ax + wx * extra, ax);
                ay = select(flat, ay + wy * extra, ay);
                bend = select(flat, 0.0, bend);
                found.link_radius[i] = select(flat & here, f64::INFINITY, self.plate_radius_m);
            }
            lanes.x[i] = select(here, px, 0.0);
            lanes.y[i] = select(here, py, 0.0);
            lanes.vx[i] = select(here, vx, 0.0);
            lanes.vy[i] = select(here, vy, 0.0);
            lanes.ax[i] = select(here, ax, 0.0);
            lanes.ay[i] = select(here, ay, 0.0);
            lanes.omega[i] = select(here, turn, 0.0);
            lanes.lever[i] = select(here, at, 0.0);
            lanes.penetration[i] = select(here, self.depth[i], NO_FACING_PIECE_M);
            lanes.normal_x[i] = select(here, wx, 0.0);
            lanes.normal_y[i] = select(here, wy, 1.0);
            lanes.curvature[i] = select(here, bend, 0.0);
            lanes.body_radius[i] = select(here, law_radius_m(self.radius[i]), f64::INFINITY);
        }
        found
    }
}

/// Of a vector, never zero.
#[inline(always)]
fn length(dx: f64, dy: f64) -> f64 {
    let d2 = dx * dx + dy * dy;
    if d2 > 1e-24 { d2 } else { 1e-24 }.sqrt()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;
    use crate::elements::body_frame::BodyMobility;
    use crate::geometry::guide::GuideSide;
    use crate::geometry::rail::Stretch;
    use crate::geometry::{rotated, unit};
    use crate::pairs::bush_tooth::{FrictionInput, forces_on_body};

    const PLATE_M: f64 = 3.55e-3;
    const LEVER_M: f64 = 4e-3;

    /// Numbers in -1 .. 1, the same everywhere.
    struct TestNumbers(u64);

    impl TestNumbers {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }
    }

    /// Lead-in, line, arc, hollow, arc, line.
    fn rail(side: GuideSide) -> Rail {
        let stretch = |length_mm: f64, radius_mm: Option<f64>| Stretch {
            length_m: length_mm * 1e-3,
            radius_m: radius_mm.map(|r| r * 1e-3),
        };
        let stretches = [
            stretch(12.0, Some(40.0)),
            stretch(25.0, None),
            stretch(40.0, Some(120.0)),
            stretch(20.0, Some(-90.0)),
            stretch(30.0, Some(60.0)),
            stretch(15.0, None),
        ];
        Rail::new(side, Vec2::new(0.02, 0.01), 0.3, &stretches).expect("a rail")
    }

    fn body(side: GuideSide) -> RailBody {
        let law = ContactLaw::Linear { stiffness_n_per_m: 1e7, damping_n_s_per_m: 100.0 };
        RailBody::new(&rail(side), PLATE_M, law, 0.08, 0.1)
    }

    /// A link whose nearest point lies `gap_m` over a point of the rail: centre and heading in the rail's frame.
    fn over(rail: &Rail, random: &mut TestNumbers, gap_m: f64) -> (Vec2, Vec2) {
        let elements = rail.profile.elements();
        let e = &elements[((random.next() + 1.0) * 0.5 * elements.len() as f64) as usize % elements.len()];
        let along = 0.5 + 0.5 * random.next();
        let heading = rotated(e.tangent(along), 0.08 * random.next()) * rail.travel;
        let over = e.point(along) + e.normal(along) * (PLATE_M + gap_m);
        (over - heading * (LEVER_M * random.next()), heading)
    }

    /// Smallest distance of a link's axis from the contour, by looking at many of its points.
    fn distance(rail: &Rail, centre: Vec2, heading: Vec2) -> f64 {
        let at = |s: f64| rail.profile.closest(centre + heading * s).distance_m;
        let steps = 400;
        let place = |i: usize| LEVER_M * (2.0 * i as f64 / steps as f64 - 1.0);
        let best = (0..=steps).min_by(|a, b| at(place(*a)).total_cmp(&at(place(*b)))).expect("some");
        let (mut low, mut high) = (place(best.saturating_sub(1)), place((best + 1).min(steps)));
        for _ in 0..80 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if at(a) < at(b) { high = b } else { low = a }
        }
        at(0.5 * (low + high))
    }

    /// The deepest of the three contacts of a plate is where the plate is nearest to the rail.
    #[test]
    fn plates_touch_where_they_are_nearest() {
        let mut random = TestNumbers(7);
        let mut looked_at = [0; 3];
        for side in [GuideSide::Inside, GuideSide::Outside] {
            let (rail, body) = (rail(side), body(side));
            for _ in 0..3000 {
                let gap_m = 0.2e-3 * random.next();
                let (centre, heading) = over(&rail, &mut random, gap_m);
                let touches = PlatePart::ALL.map(|part| body.touch(part, centre, heading, LEVER_M));
                let deepest =
                    (0..3).filter_map(|i| touches[i].map(|t| (i, t.penetration_m))).max_by(|a, b| a.1.total_cmp(&b.1));
                let exact = PLATE_M - distance(&rail, centre, heading);
                let (part, found) = deepest.expect("over the rail");
                assert!((found - exact).abs() < 1e-10, "{side:?} {centre:?}: {found:e} against {exact:e}");
                looked_at[part] += 1;
            }
        }
        assert!(looked_at.iter().all(|n| *n > 300), "{looked_at:?}");
    }

    /// The kernel finds what the search finds, for rails that have turned.
    #[test]
    fn the_kernel_is_the_search() {
        let mut random = TestNumbers(3);
        let mut touched = [0; 3];
        for side in [GuideSide::Inside, GuideSide::Outside] {
            let (rail, body) = (rail(side), body(side));
            for _ in 0..600 {
                let angle = random.next();
                let turn = unit(angle);
                let swing = FrameMotion::turning(Vec2::zeros(), (turn.x, turn.y), 0.0, 0.0);
                let links: [(Vec2, Vec2); LANES] = std::array::from_fn(|_| {
                    let gap_m = 0.3e-3 * random.next();
                    let (centre, heading) = over(&rail, &mut random, gap_m);
                    (rotated(centre, angle), rotated(heading, angle))
                });
                for (index, part) in PlatePart::ALL.into_iter().enumerate() {
                    let mut lanes = Lanes::default();
                    for (i, (centre, heading)) in links.iter().enumerate() {
                        (lanes.x[i], lanes.y[i]) = (centre.x, centre.y);
                        (lanes.cos[i], lanes.sin[i]) = (heading.x, heading.y);
                        lanes.lever[i] = LEVER_M;
                    }
                    let found = find_contacts((&body, 0.0, f64::INFINITY), part, swing, &[0.0; LANES], &mut lanes);
                    for (i, (centre, heading)) in links.iter().enumerate() {
                        let (c, h) = (rotated(*centre, -angle), rotated(*heading, -angle));
                        let t = body.touch(part, c, h, LEVER_M);
                        // At the end of a piece rounding decides whether there is a contact.
                        if t.is_some() != found.here[i] {
                            let moved = |by: f64| body.touch(part, c + h * by, h, LEVER_M).is_some();
                            assert!(moved(1e-12) != moved(-1e-12), "{part:?} {c:?}");
                            continue;
                        }
                        let Some(t) = t else { continue };
                        assert!((lanes.penetration[i] - t.penetration_m).abs() < 1e-15, "{part:?}");
                        let normal = rotated(t.normal, angle);
                        assert!((normal - Vec2::new(lanes.normal_x[i], lanes.normal_y[i])).norm() < 1e-12);
                        assert!((lanes.lever[i] - t.along_m).abs() < 1e-13);
                        assert_eq!(found.piece[i] as usize, t.piece);
                        touched[index] += 1;
                    }
                }
            }
        }
        assert!(touched.iter().all(|n| *n > 500), "{touched:?}");
    }

    /// Rate of the gap and its second derivative, against differences of the exact gap while link and rail move.
    #[test]
    fn rates_are_those_of_the_gap() {
        let mut random = TestNumbers(11);
        let (mut flat, mut ends) = (0, 0);
        for side in [GuideSide::Inside, GuideSide::Outside] {
            let (rail, body) = (rail(side), body(side));
            for _ in 0..400 {
                let gap_m = 0.05e-3 * random.next();
                let (centre, heading) = over(&rail, &mut random, gap_m);
                let velocity = Vec2::new(random.next(), random.next()) * 8.0;
                let pull = Vec2::new(random.next(), random.next()) * 1e4;
                let (omega, alpha) = (150.0 * random.next(), 1e5 * random.next());
                let (swing_omega, swing_alpha) = (20.0 * random.next(), 1e4 * random.next());
                for part in PlatePart::ALL {
                    let depth = |t: f64| {
                        let c = centre + velocity * t + pull * (0.5 * t * t);
                        let h = rotated(heading, omega * t + 0.5 * alpha * t * t);
                        let turned = swing_omega * t + 0.5 * swing_alpha * t * t;
                        body.touch(part, rotated(c, -turned), rotated(h, -turned), LEVER_M)
                    };
                    const STEP_S: f64 = 2e-6;
                    let (Some(before), Some(now), Some(after)) = (depth(-STEP_S), depth(0.0), depth(STEP_S)) else {
                        continue;
                    };
                    let same = |t: &PlateTouch| t.piece == now.piece && t.is_flat == now.is_flat;
                    if !same(&before) || !same(&after) {
                        continue;
                    }
                    let mut lanes = Lanes::default();
                    (lanes.x, lanes.y) = ([centre.x; LANES], [centre.y; LANES]);
                    (lanes.vx, lanes.vy) = ([velocity.x; LANES], [velocity.y; LANES]);
                    (lanes.ax, lanes.ay) = ([pull.x; LANES], [pull.y; LANES]);
                    (lanes.cos, lanes.sin) = ([heading.x; LANES], [heading.y; LANES]);
                    (lanes.omega, lanes.lever) = ([omega; LANES], [LEVER_M; LANES]);
                    (lanes.inverse_mass, lanes.inverse_inertia) = ([1.0 / 3e-3; LANES], [1.0 / 6e-8; LANES]);
                    let swing = FrameMotion::turning(Vec2::zeros(), (1.0, 0.0), swing_omega, swing_alpha);
                    let found = find_contacts((&body, 0.0, f64::INFINITY), part, swing, &[alpha; LANES], &mut lanes);
                    let sliding = FrictionInput { mu: 0.0, stick_speed: 0.1, radius: PLATE_M };
                    forces_on_body(
                        &body.law,
                        sliding,
                        &found.link_radius,
                        1e-6,
                        (swing_omega, BodyMobility::default()),
                        &mut lanes,
                    );
                    let rate = (after.penetration_m - before.penetration_m) / (2.0 * STEP_S);
                    let second =
                        (after.penetration_m - 2.0 * now.penetration_m + before.penetration_m) / (STEP_S * STEP_S);
                    assert!(
                        (lanes.free_rate[0] - rate).abs() < 1e-4,
                        "{part:?}: {} against {rate}",
                        lanes.free_rate[0]
                    );
                    // An end's acceleration towards its link's centre is left out, as at guides and teeth.
                    let left_out = if now.is_flat { 0.0 } else { omega * omega * LEVER_M };
                    let missing = (lanes.free_acceleration[0] - second).abs();
                    assert!(missing < 1e-4 * second.abs() + left_out + 1.0, "{part:?} {now:?}: {missing} of {second}");
                    *(if now.is_flat { &mut flat } else { &mut ends }) += 1;
                }
            }
        }
        assert!(flat > 50 && ends > 50, "{flat} {ends}");
    }

    /// A plate that strikes an arm over its middle: both give way, so the peak is v sqrt(k m), 1/m = 1/m_link + d^2/J. Second order in the
    /// step.
    #[test]
    fn a_struck_arm_gives_way() {
        let (mass, inertia, speed, stiffness) = (3e-3, 2e-6, 0.5, 1e7);
        let stretch = [Stretch { length_m: 0.04, radius_m: Some(0.2) }];
        // Its middle lies ahead of the pivot by `far`, and faces +y.
        let far = 0.05;
        let start = Vec2::new(far, 0.0) + rotated(Vec2::new(0.0, 0.2), 0.1) - Vec2::new(0.0, 0.2);
        let rail = Rail::new(GuideSide::Outside, start, 0.1, &stretch).expect("a rail");
        let law = ContactLaw::Linear { stiffness_n_per_m: stiffness, damping_n_s_per_m: 0.0 };
        let body = RailBody::new(&rail, PLATE_M, law, 0.0, 0.1);
        let peak = |h: f64| {
            let (mut y, mut v, mut a) = (PLATE_M + 1e-7, -speed, 0.0);
            let (mut angle, mut omega, mut alpha) = (0.0, 0.0, 0.0);
            let mut kept = Lanes::default();
            let mut peak = 0.0_f64;
            for _ in 0..(150e-6 / h) as usize {
                let mut lanes = kept;
                (lanes.x, lanes.y) = ([far; LANES], [y; LANES]);
                (lanes.vx, lanes.vy) = ([0.0; LANES], [v + 0.5 * h * a; LANES]);
                (lanes.ax, lanes.ay) = ([0.0; LANES], [a; LANES]);
                (lanes.cos, lanes.sin) = ([1.0; LANES], [0.0; LANES]);
                (lanes.omega, lanes.lever) = ([0.0; LANES], [LEVER_M; LANES]);
                (lanes.inverse_mass, lanes.inverse_inertia) = ([1.0 / mass; LANES], [1.0 / 6e-8; LANES]);
                let turn = unit(angle);
                let speed = omega + 0.5 * h * alpha;
                let swing = FrameMotion::turning(Vec2::zeros(), (turn.x, turn.y), speed, alpha);
                let found =
                    find_contacts((&body, 0.0, f64::INFINITY), PlatePart::Edge, swing, &[0.0; LANES], &mut lanes);
                let sliding = FrictionInput { mu: 0.0, stick_speed: 0.1, radius: PLATE_M };
                let mobility = BodyMobility { inverse_inertia: 1.0 / inertia, inverse_mass: [0.0; 3] };
                forces_on_body(&body.law, sliding, &found.link_radius, h, (speed, mobility), &mut lanes);
                (a, alpha) = (lanes.force_y[0] / mass, lanes.torque[0] / inertia);
                peak = peak.max(lanes.normal_force[0]);
                (v, omega) = (v + h * a, omega + h * alpha);
                (y, angle) = (y + h * v, angle + h * omega);
                kept = lanes;
            }
            peak
        };
        let reduced = 1.0 / (1.0 / mass + far * far / inertia);
        let exact = speed * f64::sqrt(stiffness * reduced);
        let errors = [1e-6, 0.5e-6, 0.25e-6].map(|h| (peak(h) / exact - 1.0).abs());
        println!("peak {exact:.3} N: errors {errors:?}");
        assert!(errors[0] < 5e-3 && errors[2] < 5e-4, "{errors:?}");
    }
}
