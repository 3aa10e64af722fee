//! Blades: rails that bend. The flexible blade of a tensioner, as its lowest modes of bending about the shape in which it is drawn.
//!
//! ```text
//! w(s, t) = sum phi_k(s) q_k(t)                    along the contour's outward normal at the place s; phi_k: 1 where it is largest
//! m_k q_k'' = Q_chain - K_k q_k - c_k q_k' + P_k   K_k = m_k w_k^2, c_k = 2 z w_k m_k
//! P_k = EI integral (1/R - 1/R_free) phi_k'' ds    what bends the free blade into the drawn shape; R > 0 convex towards the chain
//! Q_chain = -sum (F . N) phi_k(s)                  F on the link, N the contour's normal at s
//! ```
//! A point X of the contour moves to B = X + w N. A straight edge of a plate touches the point B that lies highest towards it, a round end the point
//! that is nearest to its joint, each found by Newton's method on the whole bent contour. The gap's derivatives are thereby the normal, at the point
//! that touches, and phi_k N . n, without approximation: force times way is what link and modes receive.
//!
//! Modes are those of [`super::beam`]. The beam is not tensioned by the chain and does not stretch; supports slide along the contour.

use super::bush_tooth::Lanes;
use super::plate_rail::{PlatePart, PlateTouch, RailBody, RailContactLanes};
use crate::elements::beam::{Beam, BeamMode, MAX_MODES};
use crate::elements::body_frame::FrameMotion;
use crate::geometry::rail::Piece;
use crate::geometry::{Vec2, cross, perp};
use crate::lanes::{LANES, LaneBlock};

/// One mode.
#[derive(Clone, Debug, PartialEq)]
pub struct BladeMode {
    pub mass_kg: f64,
    pub stiffness_n_per_m: f64,
    pub damping_n_s_per_m: f64,
    /// Where the bending of the drawn shape alone would hold it [m].
    pub free_m: f64,
    /// For q = 1 m.
    nodes: Vec<BentNode>,
}

/// Deflection and slope [1/m] at a node, or one of their derivatives over time.
type BentNode = [f64; 2];

/// Modes of a blade along the contour of a rail.
#[derive(Clone, Debug, PartialEq)]
pub struct Blade {
    /// Places of the nodes along the contour [m].
    nodes: Vec<f64>,
    /// Elements between them per length [1/m].
    elements_per_m: f64,
    /// How far the drawn contour has turned from its beginning to a node [rad], and its curvature there [1/m].
    drawn_turns: Vec<(f64, f64)>,
    pub modes: Vec<BladeMode>,
    /// Mass of the whole blade [kg].
    pub mass_kg: f64,
    /// Per piece of the rail: where along the contour it begins, or lies.
    starts: Vec<f64>,
    /// Per element of the profile: where it ends, and its curvature, convex positive [1/m].
    bends: Vec<(f64, f64)>,
    /// Largest radius of its arcs, or its length if that is more [m].
    drawn_radius_m: f64,
}

/// A point of the contour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BladePoint {
    element: usize,
    /// Weights of deflection and slope at both nodes of its element: in the deflection, the slope, the curvature and its derivative there.
    value: [f64; 4],
    slope: [f64; 4],
    bend: [f64; 4],
    third: [f64; 4],
}

/// Deflection of a blade, or one of its derivatives over time, at all nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deflection {
    nodes: Vec<BentNode>,
}

/// A point of the drawn contour in the rail's frame: its place along it, the element of the profile, and the normal.
#[derive(Clone, Copy)]
struct DrawnPoint {
    place: f64,
    element: usize,
    at: Vec2,
    normal: Vec2,
}

/// A point of the bent contour in the rail's frame, its first three derivatives over the place, and where it lies.
#[derive(Clone, Copy)]
struct BentPoint {
    at: Vec2,
    first: Vec2,
    second: Vec2,
    third: Vec2,
    point: BladePoint,
    /// The point from which it is bent, in the direction of that point's normal.
    drawn: DrawnPoint,
}

impl BentPoint {
    /// Goes on by a way of [`NEAR_HIGHEST_M`] at most along the drawn contour of this curvature, within one element of it and of the beam, by the Taylor
    /// series. The deflection is a cubic: it and its weights are exact. The fourth power of the way is left out of the point, the third out of its
    /// derivative, the fifth out of the normal. The drawn point stays behind.
    #[inline(always)]
    fn go(&mut self, way: f64, curvature: f64) {
        self.at += (self.first + (self.second + self.third * (way / 3.0)) * (0.5 * way)) * way;
        self.first += (self.second + self.third * (0.5 * way)) * way;
        let (turn, normal) = (curvature * way, self.drawn.normal);
        let squared = turn * turn;
        let (sin, fall) = (turn * (1.0 - squared / 6.0), squared * (0.5 - squared / 24.0));
        self.drawn.normal += perp(normal) * sin - normal * fall;
        self.drawn.place += way;
        let BladePoint { value, slope, bend, third, .. } = &mut self.point;
        for i in 0..4 {
            value[i] += way * (slope[i] + 0.5 * way * (bend[i] + way / 3.0 * third[i]));
            slope[i] += way * (bend[i] + 0.5 * way * third[i]);
            bend[i] += way * third[i];
        }
    }
}

impl Blade {
    /// Modes of a beam along the contour of a rail. None where the beam has none: without stiffness or mass.
    pub fn new(body: &RailBody, beam: &Beam) -> Option<Blade> {
        let (starts, length_m) = starts(body);
        let mut blade = Blade {
            nodes: beam.nodes(length_m),
            elements_per_m: 0.0,
            drawn_turns: Vec::new(),
            modes: Vec::new(),
            mass_kg: beam.mass_kg_per_m * length_m,
            starts,
            bends: Vec::new(),
            drawn_radius_m: length_m,
        };
        for (piece, start) in body.pieces.iter().zip(&blade.starts) {
            match *piece {
                Piece::Line { length_m, .. } => blade.bends.push((start + length_m, 0.0)),
                Piece::Arc { radius_m, from, to, .. } if radius_m != 0.0 => {
                    blade.bends.push((start + radius_m.abs() * angle(from, to), 1.0 / radius_m));
                    blade.drawn_radius_m = blade.drawn_radius_m.max(radius_m.abs());
                }
                Piece::Arc { .. } | Piece::EdgeSupport { .. } => {}
            }
        }
        blade.elements_per_m = (blade.nodes.len() - 1) as f64 / length_m;
        blade.drawn_turns = blade.nodes.iter().map(|at| blade.drawn_turn(*at)).collect();
        for BeamMode { stiffness_n_per_m, mass_kg, value, slope } in beam.modes_on(&blade.nodes)? {
            let damping_n_s_per_m = 2.0 * beam.damping_ratio * libm::sqrt(stiffness_n_per_m * mass_kg);
            let nodes = value.into_iter().zip(slope).map(|(value, slope)| [value, slope]).collect();
            blade.modes.push(BladeMode { mass_kg, stiffness_n_per_m, damping_n_s_per_m, free_m: 0.0, nodes });
        }
        for k in 0..blade.modes.len() {
            let (push_n, stiffness) = (blade.free_push_n(beam, k), blade.modes[k].stiffness_n_per_m);
            blade.modes[k].free_m = if stiffness > 0.0 { push_n / stiffness } else { 0.0 };
        }
        Some(blade)
    }

    /// P of the file's head.
    fn free_push_n(&self, beam: &Beam, mode: usize) -> f64 {
        let Some(free) = &beam.free_curvatures_per_m else { return 0.0 };
        let slope_at = |s: f64| self.slope_of(mode, &self.point(s));
        let (mut push_n, mut start) = (0.0, 0.0);
        for ((end, curvature), free) in self.bends.iter().zip(free) {
            push_n += beam.stiffness_n_m2 * (curvature - free) * (slope_at(*end) - slope_at(start));
            start = *end;
        }
        push_n
    }

    /// How far the drawn contour has turned from its beginning to a place [rad], and its curvature there [1/m].
    fn drawn_turn(&self, place: f64) -> (f64, f64) {
        let (mut turn, mut start) = (0.0, 0.0);
        for (end, curvature) in &self.bends {
            if place < *end {
                return (turn + curvature * (place - start), *curvature);
            }
            turn += curvature * (end - start);
            start = *end;
        }
        (turn, self.bends.last().map_or(0.0, |(_, curvature)| *curvature))
    }

    /// The point at a place along the contour [m].
    pub fn point(&self, s: f64) -> BladePoint {
        self.point_in(self.beam_element(s), s)
    }

    /// Index of the beam's element at a place.
    #[inline(always)]
    fn beam_element(&self, s: f64) -> usize {
        // Nodes are almost evenly spaced.
        let last = self.nodes.len() - 2;
        let even = s * self.elements_per_m;
        self.beam_element_from(s, if even > 0.0 { (even as usize).min(last) } else { 0 })
    }

    /// As [`Blade::beam_element`], from one that is near it.
    #[inline(always)]
    fn beam_element_from(&self, s: f64, mut element: usize) -> usize {
        while element > 0 && s < self.nodes[element] {
            element -= 1;
        }
        while element + 2 < self.nodes.len() && self.nodes[element + 1] <= s {
            element += 1;
        }
        element
    }

    #[inline(always)]
    fn point_in(&self, element: usize, s: f64) -> BladePoint {
        let (from, to) = (self.nodes[element], self.nodes[element + 1]);
        let l = to - from;
        let inverse = 1.0 / l;
        let x = (s - from) * inverse;
        let x = if x < 0.0 { 0.0 } else { x };
        let x = if x > 1.0 { 1.0 } else { x };
        let (x2, inverse2) = (x * x, inverse * inverse);
        let (x3, six, twelve) = (x2 * x, 6.0 * inverse2, 12.0 * inverse2 * inverse);
        let (rises, falls) = (3.0 * x2 - 2.0 * x3, 6.0 * (x2 - x) * inverse);
        let bend = (12.0 * x - 6.0) * inverse2;
        BladePoint {
            element,
            value: [1.0 - rises, l * (x - 2.0 * x2 + x3), rises, l * (x3 - x2)],
            slope: [falls, 1.0 - 4.0 * x + 3.0 * x2, 0.0 - falls, 3.0 * x2 - 2.0 * x],
            bend: [bend, (6.0 * x - 4.0) * inverse, 0.0 - bend, (6.0 * x - 2.0) * inverse],
            third: [twelve, six, 0.0 - twelve, six],
        }
    }

    /// Deflection of a mode at a point, for q = 1 m.
    #[inline(always)]
    pub fn value_of(&self, mode: usize, at: &BladePoint) -> f64 {
        weighted(&at.value, &self.modes[mode].nodes, at.element)
    }

    /// Slope of a mode at a point [1/m].
    #[inline(always)]
    pub fn slope_of(&self, mode: usize, at: &BladePoint) -> f64 {
        weighted(&at.slope, &self.modes[mode].nodes, at.element)
    }

    /// Deflection of all nodes by the coordinates of the modes, or its rate by their speeds.
    #[inline(always)]
    pub fn deflection(&self, q: impl Iterator<Item = f64>, out: &mut Deflection) {
        out.nodes.clear();
        out.nodes.resize(self.nodes.len(), [0.0; 2]);
        for (mode, q) in self.modes.iter().zip(q) {
            for (sum, of_mode) in out.nodes.as_flattened_mut().iter_mut().zip(mode.nodes.as_flattened()) {
                *sum += of_mode * q;
            }
        }
    }

    /// No point of the contour is bent further outwards than that [m]. Between two nodes a cubic lies above both by no more than 4/27 of the length times
    /// the slopes at them.
    #[inline(always)]
    pub fn most_outward_m(&self, bent: &Deflection) -> f64 {
        let mut most = 0.0;
        for (ends, nodes) in bent.nodes.windows(2).zip(self.nodes.windows(2)) {
            let ([here, slope], [next, slope_next]) = (ends[0], ends[1]);
            let node = if here > next { here } else { next };
            let bound = node + (4.0 / 27.0) * (nodes[1] - nodes[0]) * (slope.abs() + slope_next.abs());
            most = if bound > most { bound } else { most };
        }
        most
    }

    /// Where along the contour a corner or an edge support lies [m], and the normal in which it is bent.
    fn corner(&self, body: &RailBody, piece: usize, normal: Vec2) -> (f64, Vec2) {
        let start = self.starts[piece];
        match body.pieces[piece] {
            Piece::Arc { from, to, .. } => (start, if start == 0.0 { to } else { from }),
            Piece::EdgeSupport { normal, .. } => (start, normal),
            Piece::Line { .. } => (start, normal),
        }
    }

    /// The point of the drawn contour that a touch says, of a line or an arc.
    #[inline(always)]
    fn drawn_touch(&self, body: &RailBody, piece: usize, foot: Vec2, normal: Vec2) -> DrawnPoint {
        let (start, element) = (self.starts[piece], piece - 1);
        match body.pieces[piece] {
            Piece::Line { start: from, along, .. } => {
                let way = (foot - from).dot(&along);
                DrawnPoint { place: start + way, element, at: from + along * way, normal }
            }
            Piece::Arc { centre, radius_m, from, .. } => {
                let turn = crate::units::direction(cross(from, normal).abs(), from.dot(&normal));
                DrawnPoint { place: start + radius_m.abs() * turn, element, at: centre + normal * radius_m, normal }
            }
            Piece::EdgeSupport { point, normal } => DrawnPoint { place: start, element, at: point, normal },
        }
    }

    /// The point of the drawn contour at a place. The elements of the profile stand behind the corner at its beginning.
    #[inline(always)]
    fn drawn_at(&self, body: &RailBody, place: f64) -> DrawnPoint {
        let element = self.bend_at(place);
        let way = place - self.starts[element + 1];
        let (at, normal) = match body.pieces[element + 1] {
            Piece::Line { start, along, .. } => (start + along * way, -perp(along)),
            Piece::Arc { centre, radius_m, from, .. } => {
                let (sin, cos) = crate::units::sin_cos(way * self.bends[element].1);
                let normal = Vec2::new(cos * from.x - sin * from.y, sin * from.x + cos * from.y);
                (centre + normal * radius_m, normal)
            }
            Piece::EdgeSupport { point, normal } => (point, normal),
        };
        DrawnPoint { place, element, at, normal }
    }

    /// The point of the drawn contour at a place, from one that is near it: on the same element of the profile the normal turns by a short series.
    #[inline(always)]
    fn drawn_from(&self, body: &RailBody, from: DrawnPoint, place: f64) -> DrawnPoint {
        let way = place - from.place;
        let turn = way * self.bends[from.element].1;
        if turn.abs() > SHORT_TURN || self.bend_at(place) != from.element {
            return self.drawn_at(body, place);
        }
        let x = turn * turn;
        let sin = turn * (1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0))));
        let fall = 0.5 * x * (1.0 - x / 12.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0 * (1.0 - x / 90.0))));
        let normal = from.normal + perp(from.normal) * sin - from.normal * fall;
        let at = match body.pieces[from.element + 1] {
            Piece::Line { start, along, .. } => start + along * (place - self.starts[from.element + 1]),
            Piece::Arc { centre, radius_m, .. } => centre + normal * radius_m,
            Piece::EdgeSupport { point, .. } => point,
        };
        DrawnPoint { place, at, normal, ..from }
    }

    /// Whether a place lies on this element of the beam.
    #[inline(always)]
    fn is_on_element(&self, s: f64, element: usize) -> bool {
        self.nodes[element] <= s && s <= self.nodes[element + 1]
    }

    /// Index of the element of the profile at a place.
    #[inline(always)]
    fn bend_at(&self, s: f64) -> usize {
        self.bends.partition_point(|(end, _)| *end <= s).min(self.bends.len() - 1)
    }

    /// The bent contour at a point of the drawn one.
    #[inline(always)]
    fn bent_at(&self, bent: &Deflection, drawn: DrawnPoint, element: usize) -> BentPoint {
        let (curvature, normal) = (self.bends[drawn.element].1, drawn.normal);
        let (point, along) = (self.point_in(element, drawn.place), perp(normal));
        let ends = [bent.nodes[element], bent.nodes[element + 1]];
        let [w, slope, bend, third] =
            [&point.value, &point.slope, &point.bend, &point.third].map(|weights| weighted(weights, &ends, 0));
        let stretched = 1.0 + curvature * w;
        let turned = curvature * stretched;
        BentPoint {
            at: drawn.at + normal * w,
            first: along * stretched + normal * slope,
            second: along * (2.0 * curvature * slope) + normal * (bend - turned),
            third: along * (curvature * (3.0 * bend - turned)) + normal * (third - 3.0 * curvature * curvature * slope),
            point,
            drawn,
        }
    }

    /// How far the bent contour's direction has turned at a node, from the drawn contour's at its beginning [rad], to the third power of its slope.
    #[inline(always)]
    fn turn_at(&self, bent: &Deflection, node: usize) -> f64 {
        let ((turn, curvature), [w, slope]) = (self.drawn_turns[node], bent.nodes[node]);
        let slope = slope / (1.0 + curvature * w);
        turn - slope * (1.0 - slope * slope / 3.0)
    }

    /// About where the bent contour has the direction that the drawn one has at a place, turned on by a small angle: looked for from node to node as far
    /// as the drawn contour is convex, and between two of them by the line through both.
    /// With the element of the beam.
    #[inline(always)]
    fn same_direction(&self, bent: &Deflection, drawn: DrawnPoint, turned_on: f64) -> (f64, usize) {
        let mut node = self.beam_element(drawn.place);
        let (turn, curvature) = self.drawn_turns[node];
        // Where the profile goes over into another element in between, the node's curvature is not that of the place.
        let turn = if self.bend_at(self.nodes[node]) == drawn.element {
            turn + curvature * (drawn.place - self.nodes[node])
        } else {
            self.drawn_turn(drawn.place).0
        };
        let sought = turn + turned_on;
        let (mut from, mut to) = (self.turn_at(bent, node), self.turn_at(bent, node + 1));
        while to < sought && node + 2 < self.nodes.len() && self.drawn_turns[node + 1].1 > 0.0 {
            node += 1;
            (from, to) = (to, self.turn_at(bent, node + 1));
        }
        while from > sought && node > 0 && self.drawn_turns[node - 1].1 > 0.0 {
            node -= 1;
            (from, to) = (self.turn_at(bent, node), from);
        }
        let part = if to > from { (sought - from) / (to - from) } else { 0.5 };
        let part = if part < 0.0 { 0.0 } else { part };
        let part = if part > 1.0 { 1.0 } else { part };
        (self.nodes[node] + part * (self.nodes[node + 1] - self.nodes[node]), node)
    }

    /// The point of the bent contour that lies highest in a direction, from a touch of the drawn one.
    #[inline(always)]
    fn highest(&self, body: &RailBody, bent: &Deflection, direction: Vec2, drawn: DrawnPoint) -> BentPoint {
        let least = MOST_FLATTENED / self.drawn_radius_m;
        let (near, element) = self.same_direction(bent, drawn, cross(drawn.normal, direction));
        self.newton(body, bent, (drawn, near, element), NEAR_HIGHEST_M, |p| {
            let falls = -p.second.dot(&direction);
            p.first.dot(&direction) / if falls > least { falls } else { least }
        })
    }

    /// The point of the bent contour that is nearest to a joint, from a point of the drawn one and a place near it.
    #[inline(always)]
    fn nearest(&self, body: &RailBody, bent: &Deflection, joint: Vec2, near: (DrawnPoint, f64)) -> BentPoint {
        self.newton(body, bent, (near.0, near.1, self.beam_element(near.1)), NEAR_JOINT_M, |p| {
            let (from, least) = (joint - p.at, MOST_FLATTENED * p.first.norm_squared());
            let rises = p.first.norm_squared() - from.dot(&p.second);
            from.dot(&p.first) / if rises > least { rises } else { least }
        })
    }

    #[inline(always)]
    fn newton(
        &self,
        body: &RailBody,
        bent: &Deflection,
        (drawn, near, element): (DrawnPoint, f64, usize),
        near_m: f64,
        step: impl Fn(&BentPoint) -> f64,
    ) -> BentPoint {
        let length_m = self.bends[self.bends.len() - 1].0;
        let inside = |s: f64| {
            if s < 0.0 {
                0.0
            } else if s > length_m {
                length_m
            } else {
                s
            }
        };
        let at = |from: DrawnPoint, s: f64, element: usize| {
            self.bent_at(bent, self.drawn_from(body, from, s), self.beam_element_from(s, element))
        };
        let mut p = at(drawn, inside(near), element);
        for _ in 0..NEWTON_STEPS {
            let by = step(&p);
            let by = if by > LONGEST_WAY_M { LONGEST_WAY_M } else { by };
            let by = if by < 0.0 - LONGEST_WAY_M { 0.0 - LONGEST_WAY_M } else { by };
            let (from, next) = (p.drawn, inside(p.drawn.place + by));
            let way = next - from.place;
            if way.abs() < near_m && self.bend_at(next) == from.element && self.is_on_element(next, p.point.element) {
                p.go(way, self.bends[from.element].1);
                break;
            }
            p = at(from, next, p.point.element);
        }
        p
    }

    /// A touch of the drawn contour as it is on the bent one, with its point and the direction in which that point is bent. `centre`, `along`: of the
    /// link, in the rail's frame.
    pub fn bent_touch(
        &self,
        body: &RailBody,
        bent: &Deflection,
        (centre, along, lever_m): (Vec2, Vec2, f64),
        touch: PlateTouch,
    ) -> (PlateTouch, BladePoint, Vec2) {
        if let Piece::Arc { radius_m: 0.0, .. } | Piece::EdgeSupport { .. } = body.pieces[touch.piece] {
            return self.point_touch(body, bent, (centre, along), touch);
        }
        let drawn = self.drawn_touch(body, touch.piece, centre + along * touch.along_m, touch.normal);
        let (mut along_m, mut near) = (touch.along_m, (drawn, drawn.place));
        if self.bends[drawn.element].1 > 0.0 {
            // An edge that bends round: flat in between the joints, or at one of them.
            let side = perp(along);
            let normal = if side.dot(&touch.normal) < 0.0 { -side } else { side };
            let p = self.highest(body, bent, normal, drawn);
            along_m = (p.at - centre).dot(&along);
            if along_m.abs() <= lever_m {
                let penetration_m = body.plate_radius_m - (centre - p.at).dot(&normal);
                let body_radius_m = self.bent_radius_m(bent, &p);
                let touch = PlateTouch { penetration_m, normal, along_m, body_radius_m, is_flat: true, ..touch };
                return (touch, p.point, p.drawn.normal);
            }
            let joint_m = if along_m > 0.0 { lever_m } else { 0.0 - lever_m };
            let way = p.first.dot(&along) * (joint_m - along_m);
            near = (p.drawn, p.drawn.place + way);
            along_m = joint_m;
        }
        let joint = centre + along * along_m;
        let p = self.nearest(body, bent, joint, near);
        let from = joint - p.at;
        let distance_m = from.norm();
        // A joint behind the contour is deeper than a plate's radius.
        let sense = if from.dot(&p.drawn.normal) < 0.0 { -1.0 } else { 1.0 };
        let touch = PlateTouch {
            penetration_m: body.plate_radius_m - sense * distance_m,
            normal: from * (sense / distance_m),
            along_m,
            body_radius_m: self.bent_radius_m(bent, &p),
            is_flat: false,
            ..touch
        };
        (touch, p.point, p.drawn.normal)
    }

    /// A point of the contour, its end or an edge support, which moves with the bending.
    fn point_touch(
        &self,
        body: &RailBody,
        bent: &Deflection,
        (centre, along): (Vec2, Vec2),
        touch: PlateTouch,
    ) -> (PlateTouch, BladePoint, Vec2) {
        let (at, place, own) = match body.pieces[touch.piece] {
            Piece::EdgeSupport { point, normal } => (point, self.starts[touch.piece], normal),
            Piece::Arc { centre, .. } | Piece::Line { start: centre, .. } => {
                let (place, own) = self.corner(body, touch.piece, touch.normal);
                (centre, place, own)
            }
        };
        let point = self.point(place);
        let moved = at + own * bent.value_at(&point);
        let along_m = if touch.is_flat { (moved - centre).dot(&along) } else { touch.along_m };
        let from = centre + along * along_m - moved;
        let distance_m = from.norm();
        let penetration_m = body.plate_radius_m - distance_m;
        (PlateTouch { penetration_m, normal: from / distance_m, along_m, ..touch }, point, own)
    }

    /// Radius of curvature of the bent contour at a point [m], as [`PlateTouch::body_radius_m`].
    fn bent_radius_m(&self, bent: &Deflection, p: &BentPoint) -> f64 {
        let curvature = self.bends[p.drawn.element].1 - weighted(&p.point.bend, &bent.nodes, p.point.element);
        if curvature.abs() < STRAIGHT_PER_M { f64::INFINITY } else { 1.0 / curvature }
    }

    /// As [`Blade::bent_touch`], for a block of lanes that have been moved to their contacts on the drawn contour: puts in what bending changes, the
    /// blade's own motion and what it gives way. `far_m`: how far a lane is from the drawn contour that touches nothing within the step.
    #[inline(always)]
    pub fn bend_lanes(
        &self,
        body: &RailBody,
        (part, levers): (PlatePart, &LaneBlock),
        far_m: f64,
        motion: &FrameMotion,
        bent: &BladeMotion,
        (found, lanes): (&mut RailContactLanes, &mut Lanes),
        out: &mut BladeLanes,
    ) {
        let (c, s) = (motion.cos, motion.sin);
        let into = |x: f64, y: f64| Vec2::new(c * x + s * y, c * y - s * x);
        let back = |v: Vec2| Vec2::new(c * v.x - s * v.y, s * v.x + c * v.y);
        for i in 0..LANES {
            // Bending moves no point further towards the chain: the lane is at least as far from touching as that.
            if !found.here[i] || lanes.penetration[i] < -far_m {
                continue;
            }
            let (e, at) = (into(lanes.cos[i], lanes.sin[i]), lanes.lever[i]);
            let piece = found.piece[i] as usize;
            let drawn = PlateTouch {
                piece,
                penetration_m: lanes.penetration[i],
                normal: into(lanes.normal_x[i], lanes.normal_y[i]),
                along_m: at,
                body_radius_m: match body.pieces[piece] {
                    Piece::Arc { radius_m, .. } => radius_m,
                    Piece::Line { .. } => f64::INFINITY,
                    Piece::EdgeSupport { .. } => 0.0,
                },
                is_flat: part == PlatePart::Edge && found.link_radius[i].is_infinite(),
            };
            let centre = into(lanes.x[i], lanes.y[i]) - e * at;
            let (touch, point, own) = self.bent_touch(body, &bent.way, (centre, e, levers[i]), drawn);
            let (n, own, by) = (back(touch.normal), back(own), touch.along_m - at);
            let along = perp(n);
            lanes.penetration[i] = touch.penetration_m;
            (lanes.normal_x[i], lanes.normal_y[i]) = (n.x, n.y);
            lanes.lever[i] = touch.along_m;
            lanes.x[i] += by * lanes.cos[i];
            lanes.y[i] += by * lanes.sin[i];
            lanes.vx[i] -= lanes.omega[i] * by * lanes.sin[i];
            lanes.vy[i] += lanes.omega[i] * by * lanes.cos[i];
            found.link_radius[i] = if touch.is_flat { f64::INFINITY } else { body.plate_radius_m };
            found.piece[i] = touch.piece as f64;
            // The joint's path over the bent contour turns about the contour's centre of curvature.
            let reach_m = touch.body_radius_m + body.plate_radius_m - touch.penetration_m;
            lanes.curvature[i] = if touch.is_flat || reach_m.is_infinite() { 0.0 } else { 0.0 - 1.0 / reach_m };
            let slide = (lanes.vx[i] * along.x + lanes.vy[i] * along.y)
                + motion.omega * (lanes.y[i] * along.x - lanes.x[i] * along.y);
            let speed = bent.speed.value_at(&point);
            let push = bent.acceleration.value_at(&point) + 2.0 * bent.speed.slope_at(&point) * slide;
            lanes.vx[i] -= speed * own.x;
            lanes.vy[i] -= speed * own.y;
            lanes.ax[i] -= push * own.x;
            lanes.ay[i] -= push * own.y;
            for (k, mode) in self.modes.iter().enumerate() {
                let phi = self.value_of(k, &point);
                lanes.inverse_mass[i] += phi * phi / mode.mass_kg;
            }
            out.points[i] = point;
            (out.normal_x[i], out.normal_y[i]) = (own.x, own.y);
        }
    }

    /// Adds what a block of contacts gives to the modes.
    #[inline(always)]
    pub fn give_back(&self, lanes: &Lanes, own: &BladeLanes, forces: &mut [f64; MAX_MODES]) {
        for i in 0..LANES {
            let push = lanes.force_x[i] * own.normal_x[i] + lanes.force_y[i] * own.normal_y[i];
            if push == 0.0 {
                continue;
            }
            for (k, sum) in forces.iter_mut().enumerate().take(self.modes.len()) {
                *sum -= push * self.value_of(k, &own.points[i]);
            }
        }
    }
}

/// Way, speed and acceleration of all nodes of a blade at a node of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BladeMotion {
    pub way: Deflection,
    pub speed: Deflection,
    pub acceleration: Deflection,
}

/// Where the lanes of a block touch a blade.
#[derive(Clone, Copy, Debug, Default)]
pub struct BladeLanes {
    points: [BladePoint; LANES],
    /// The contour's normal there.
    normal_x: LaneBlock,
    normal_y: LaneBlock,
}

impl Deflection {
    /// Largest deflection of the nodes [m].
    pub fn most_m(&self) -> f64 {
        self.nodes.iter().fold(0.0, |most, [w, _]| f64::max(most, w.abs()))
    }

    #[inline(always)]
    pub fn value_at(&self, at: &BladePoint) -> f64 {
        weighted(&at.value, &self.nodes, at.element)
    }

    #[inline(always)]
    pub fn slope_at(&self, at: &BladePoint) -> f64 {
        weighted(&at.slope, &self.nodes, at.element)
    }
}

/// Sum over both nodes of an element.
#[inline(always)]
fn weighted(weights: &[f64; 4], nodes: &[BentNode], element: usize) -> f64 {
    let ([value, slope], [next, slope_next]) = (nodes[element], nodes[element + 1]);
    weights[0] * value + weights[1] * slope + weights[2] * next + weights[3] * slope_next
}

/// Steps towards a place of the bent contour, and the longest of them [m].
const NEWTON_STEPS: usize = 12;
const LONGEST_WAY_M: f64 = 5e-3;
/// Below which length the series takes a step, which is then the last [m]. The depth of the highest point hangs on its place by the square, the lever and
/// the weights by the way itself; of the point next to a joint the normal does too.
const NEAR_HIGHEST_M: f64 = 5e-5;
const NEAR_JOINT_M: f64 = 5e-6;
/// Up to where the series of sine and cosine end at the rounding [rad].
const SHORT_TURN: f64 = 0.12;
/// Curvature below which a contour counts as straight [1/m].
const STRAIGHT_PER_M: f64 = 1e-6;

/// Share of an arc's curvature that bending may leave, before a straight edge touches it at many points at once. assumed: blades of tensioners
/// keep a half of it and more.
const MOST_FLATTENED: f64 = 0.2;

/// Angle between two directions, never negative [rad].
fn angle(from: Vec2, to: Vec2) -> f64 {
    crate::units::atan2(cross(from, to).abs(), from.dot(&to))
}

/// Where along the contour every piece begins, and the contour's length.
fn starts(body: &RailBody) -> (Vec<f64>, f64) {
    let mut at = 0.0;
    let mut starts: Vec<f64> = Vec::new();
    for piece in &body.pieces {
        starts.push(at);
        match *piece {
            Piece::Line { length_m, .. } => at += length_m,
            Piece::Arc { radius_m, from, to, .. } => at += radius_m.abs() * angle(from, to),
            Piece::EdgeSupport { .. } => {}
        }
    }
    // Edge supports stand behind the corner of the end: each lies where its line begins or ends.
    for (k, piece) in body.pieces.iter().enumerate() {
        let Piece::EdgeSupport { point, .. } = *piece else { continue };
        for (j, line) in body.pieces.iter().enumerate() {
            let Piece::Line { start, along, length_m } = *line else { continue };
            let foot = (point - start).dot(&along);
            let is_end = foot.abs() < 1e-9 || (foot - length_m).abs() < 1e-9;
            if is_end && cross(along, point - start).abs() < 1e-9 {
                starts[k] = starts[j] + foot;
            }
        }
    }
    (starts, at)
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests;
