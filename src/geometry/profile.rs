//! Profiles of arcs and lines.
//!
//! A profile is a sequence of elements with the material on the LEFT of the direction of travel: a closed outline runs
//! counterclockwise, the outward normal is the tangent turned by -90 degrees, a convex arc has a positive sweep, a
//! concave one a negative sweep, and the signed curvature (1/m) is positive where the body is convex. Transitions are
//! always C0, and C1 where the contour is smooth; transitions that are not C1 are corners.
//! where the contour is smooth; joints that are not C1 are corners.

use super::{Vec2, cross, perp, unit};
use crate::units::{atan2, wrap_angle};
use std::f64::consts::PI;

/// A straight line or a circular arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Element {
    Line {
        start: Vec2,
        end: Vec2,
    },
    /// `sweep_rad` > 0 counterclockwise (convex), < 0 clockwise (concave).
    Arc {
        centre: Vec2,
        radius_m: f64,
        start_rad: f64,
        sweep_rad: f64,
    },
}

/// The point of an element or profile that is nearest to a query point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foot {
    /// Index of the element.
    pub element: usize,
    /// Position along the element, 0 at its start to 1 at its end.
    pub along: f64,
    pub point: Vec2,
    /// Outward unit normal of the contour at the foot (towards the query point at a corner).
    pub normal: Vec2,
    /// Signed distance [m], negative in the material.
    pub distance_m: f64,
    /// Signed curvature [1/m], positive convex.
    pub curvature_per_m: f64,
}

/// Area and its moments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaProperties {
    pub area_m2: f64,
    pub centroid: Vec2,
    /// Polar second moment of area about the centroid [m4].
    pub polar_moment_m4: f64,
}

impl Element {
    pub fn start(&self) -> Vec2 {
        self.point(0.0)
    }

    pub fn end(&self) -> Vec2 {
        self.point(1.0)
    }

    /// Point at `along` in 0 ..= 1.
    pub fn point(&self, along: f64) -> Vec2 {
        match *self {
            Element::Line { start, end } => start + (end - start) * along,
            Element::Arc { centre, radius_m, start_rad, sweep_rad } => {
                centre + unit(start_rad + sweep_rad * along) * radius_m
            }
        }
    }

    /// Unit tangent at `along`.
    pub fn tangent(&self, along: f64) -> Vec2 {
        match *self {
            Element::Line { start, end } => (end - start).normalize(),
            Element::Arc { start_rad, sweep_rad, .. } => perp(unit(start_rad + sweep_rad * along)) * sweep_rad.signum(),
        }
    }

    /// Outward unit normal at `along`.
    pub fn normal(&self, along: f64) -> Vec2 {
        -perp(self.tangent(along))
    }

    /// Length [m].
    pub fn length_m(&self) -> f64 {
        match *self {
            Element::Line { start, end } => (end - start).norm(),
            Element::Arc { radius_m, sweep_rad, .. } => radius_m * sweep_rad.abs(),
        }
    }

    /// Signed curvature [1/m], positive convex.
    pub fn curvature_per_m(&self) -> f64 {
        match *self {
            Element::Line { .. } => 0.0,
            Element::Arc { radius_m, sweep_rad, .. } => sweep_rad.signum() / radius_m,
        }
    }

    /// Position along the element of the perpendicular foot of `p`, unbounded: inside the element when in 0 ..= 1.
    pub fn foot_along(&self, p: Vec2) -> f64 {
        match *self {
            Element::Line { start, end } => {
                let d = end - start;
                (p - start).dot(&d) / d.norm_squared()
            }
            Element::Arc { centre, start_rad, sweep_rad, .. } => {
                let d = p - centre;
                // Measured from the middle of the arc, so that the angle wraps symmetrically on the far side.
                let middle = start_rad + 0.5 * sweep_rad;
                0.5 + wrap_angle(atan2(d.y, d.x) - middle) / sweep_rad
            }
        }
    }

    /// Nearest point of the element to `p`. The sign of the distance tells on which side of the contour `p` lies.
    pub fn closest(&self, p: Vec2) -> Foot {
        let along = self.foot_along(p);
        let inside = (0.0..=1.0).contains(&along);
        let along = if inside {
            along
        } else if (p - self.start()).norm_squared() <= (p - self.end()).norm_squared() {
            0.0
        } else {
            1.0
        };
        let point = self.point(along);
        let outward = self.normal(along);
        let d = p - point;
        let side = if d.dot(&outward) < 0.0 { -1.0 } else { 1.0 };
        let distance = d.norm();
        let normal = if inside || distance == 0.0 { outward } else { d * (side / distance) };
        Foot { element: 0, along, point, normal, distance_m: side * distance, curvature_per_m: self.curvature_per_m() }
    }

    /// The element moved outwards by `distance_m`; None if an arc would vanish or invert.
    pub fn offset(&self, distance_m: f64) -> Option<Element> {
        match *self {
            Element::Line { start, end } => {
                let shift = self.normal(0.0) * distance_m;
                Some(Element::Line { start: start + shift, end: end + shift })
            }
            Element::Arc { centre, radius_m, start_rad, sweep_rad } => {
                let radius_m = radius_m + sweep_rad.signum() * distance_m;
                (radius_m > 0.0).then_some(Element::Arc { centre, radius_m, start_rad, sweep_rad })
            }
        }
    }

    /// The element rotated by `angle_rad` and then moved by `shift`.
    pub fn moved(&self, angle_rad: f64, shift: Vec2) -> Element {
        let place = |p: Vec2| super::rotated(p, angle_rad) + shift;
        match *self {
            Element::Line { start, end } => Element::Line { start: place(start), end: place(end) },
            Element::Arc { centre, radius_m, start_rad, sweep_rad } => {
                Element::Arc { centre: place(centre), radius_m, start_rad: start_rad + angle_rad, sweep_rad }
            }
        }
    }

    /// Axis-aligned bounding box: (lower, upper).
    pub fn bounds(&self) -> (Vec2, Vec2) {
        let (a, b) = (self.start(), self.end());
        let mut low = a.inf(&b);
        let mut high = a.sup(&b);
        if let Element::Arc { centre, radius_m, .. } = *self {
            for quarter in 0..4 {
                let p = centre + unit(f64::from(quarter) * 0.5 * PI) * radius_m;
                if (0.0..=1.0).contains(&self.foot_along(p)) {
                    low = low.inf(&p);
                    high = high.sup(&p);
                }
            }
        }
        (low, high)
    }
}

/// A connected sequence of elements.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    elements: Vec<Element>,
    closed: bool,
}

/// Why a list of elements is no profile.
#[derive(Clone, Debug, PartialEq)]
pub enum ProfileError {
    Empty,
    /// Element `after` does not start where its predecessor ends.
    Gap {
        after: usize,
        gap_m: f64,
    },
    /// Element has no length.
    Degenerate {
        element: usize,
    },
    /// A concave arc vanishes at this offset.
    Offset {
        element: usize,
    },
}

impl std::fmt::Display for ProfileError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ProfileError::Empty => write!(f, "the profile has no elements"),
            ProfileError::Gap { after, gap_m } => {
                write!(f, "element {after} ends {:.3e} m away from where the next one starts", gap_m)
            }
            ProfileError::Degenerate { element } => write!(f, "element {element} has no length"),
            ProfileError::Offset { element } => write!(f, "the concave arc {element} vanishes at this offset"),
        }
    }
}

impl std::error::Error for ProfileError {}

/// Largest gap between neighbouring elements [m]: rounding of coordinates of some 0.1 m, with a margin.
const JOINT_TOLERANCE_M: f64 = 1e-12;

impl Profile {
    /// Checks connectivity. `closed`: the last element ends where the first begins.
    pub fn new(elements: Vec<Element>, closed: bool) -> Result<Profile, ProfileError> {
        if elements.is_empty() {
            return Err(ProfileError::Empty);
        }
        for (i, element) in elements.iter().enumerate() {
            if element.length_m().is_nan() || element.length_m() <= 0.0 {
                return Err(ProfileError::Degenerate { element: i });
            }
            let next = match elements.get(i + 1) {
                Some(next) => next,
                None if closed => &elements[0],
                None => continue,
            };
            let gap_m = (next.start() - element.end()).norm();
            if gap_m.is_nan() || gap_m > JOINT_TOLERANCE_M {
                return Err(ProfileError::Gap { after: i, gap_m });
            }
        }
        Ok(Profile { elements, closed })
    }

    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// Kink angle [rad] at the end of each element: zero where the contour is C1, positive at a convex corner.
    pub fn kinks_rad(&self) -> Vec<f64> {
        let n = self.elements.len();
        (0..n)
            .map(|i| {
                if i + 1 == n && !self.closed {
                    return 0.0;
                }
                let t0 = self.elements[i].tangent(1.0);
                let t1 = self.elements[(i + 1) % n].tangent(0.0);
                atan2(cross(t0, t1), t0.dot(&t1))
            })
            .collect()
    }

    /// Nearest point of the contour to `p`, by testing every element.
    pub fn closest(&self, p: Vec2) -> Foot {
        let mut best: Option<Foot> = None;
        for (i, element) in self.elements.iter().enumerate() {
            let foot = Foot { element: i, ..element.closest(p) };
            let nearer = match &best {
                None => true,
                Some(b) => {
                    let (new, old) = (foot.distance_m.abs(), b.distance_m.abs());
                    // Two elements that share a corner are equally near: the side is that of the element whose normal
                    // points more directly at `p`.
                    let tie = (new - old).abs() <= JOINT_TOLERANCE_M;
                    if tie {
                        foot_squareness(&foot, p, element) > foot_squareness(b, p, &self.elements[b.element])
                    } else {
                        new < old
                    }
                }
            };
            if nearer {
                best = Some(foot);
            }
        }
        best.expect("a profile has at least one element")
    }

    /// Contour moved outwards by `distance_m`. A C1 profile stays connected; corners open and are reported as a gap.
    pub fn offset(&self, distance_m: f64) -> Result<Profile, ProfileError> {
        let elements = self
            .elements
            .iter()
            .enumerate()
            .map(|(element, e)| e.offset(distance_m).ok_or(ProfileError::Offset { element }))
            .collect::<Result<Vec<_>, _>>()?;
        Profile::new(elements, self.closed)
    }

    /// The profile rotated by `angle_rad`, then moved by `shift`.
    pub fn moved(&self, angle_rad: f64, shift: Vec2) -> Profile {
        Profile { elements: self.elements.iter().map(|e| e.moved(angle_rad, shift)).collect(), closed: self.closed }
    }

    /// Axis-aligned bounding box.
    pub fn bounds(&self) -> (Vec2, Vec2) {
        self.elements
            .iter()
            .map(Element::bounds)
            .reduce(|(l, h), (l2, h2)| (l.inf(&l2), h.sup(&h2)))
            .expect("a profile has at least one element")
    }

    /// Area, centroid and polar moment of a closed profile, by Green's theorem; exact for lines, to rounding for arcs.
    pub fn area_properties(&self) -> AreaProperties {
        debug_assert!(self.closed, "an open profile has no area");
        let (mut area, mut first, mut polar) = (0.0, Vec2::zeros(), 0.0);
        for element in &self.elements {
            for_each_quadrature_point(element, |p, d| {
                area += 0.5 * (p.x * d.y - p.y * d.x);
                first += Vec2::new(0.5 * p.x * p.x * d.y, -0.5 * p.y * p.y * d.x);
                polar += (p.x.powi(3) * d.y - p.y.powi(3) * d.x) / 3.0;
            });
        }
        let centroid = first / area;
        AreaProperties { area_m2: area, centroid, polar_moment_m4: polar - area * centroid.norm_squared() }
    }

    /// Points on the contour for drawing: no chord is further than `tolerance_m` from its arc.
    pub fn polyline(&self, tolerance_m: f64) -> Vec<Vec2> {
        let mut points = vec![self.elements[0].start()];
        for element in &self.elements {
            let pieces = match *element {
                Element::Line { .. } => 1,
                Element::Arc { radius_m, sweep_rad, .. } => {
                    let ratio = (1.0 - tolerance_m / radius_m).clamp(-1.0, 1.0);
                    let piece_rad = (2.0 * libm::acos(ratio)).max(0.01);
                    (sweep_rad.abs() / piece_rad).ceil().max(1.0) as usize
                }
            };
            points.extend((1..=pieces).map(|k| element.point(k as f64 / pieces as f64)));
        }
        if self.closed {
            points.pop();
        }
        points
    }
}

/// |cos| of the angle between the direction to `p` and the normal at the foot.
fn foot_squareness(foot: &Foot, p: Vec2, element: &Element) -> f64 {
    let d = p - foot.point;
    let n = d.norm();
    if n == 0.0 { 1.0 } else { (d.dot(&element.normal(foot.along)) / n).abs() }
}

/// Calls `f(point, tangent x weight)` so that the sum over calls integrates along the element.
fn for_each_quadrature_point(element: &Element, mut f: impl FnMut(Vec2, Vec2)) {
    // Gauss-Legendre, 5 points (Abramowitz & Stegun 25.4.29): exact to degree 9, on pieces of at most 1/8 rad.
    const NODES: [(f64, f64); 5] = [
        (0.0, 0.568_888_888_888_888_9),
        (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
        (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
        (0.906_179_845_938_664, 0.236_926_885_056_189_08),
        (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    ];
    let pieces = match *element {
        Element::Line { .. } => 1.0,
        Element::Arc { sweep_rad, .. } => (sweep_rad.abs() * 8.0).ceil().max(1.0),
    };
    for piece in 0..pieces as usize {
        for (x, w) in NODES {
            let along = (piece as f64 + 0.5 * (x + 1.0)) / pieces;
            f(element.point(along), element.tangent(along) * (element.length_m() * 0.5 * w / pieces));
        }
    }
}
