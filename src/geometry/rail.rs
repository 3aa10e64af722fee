//! Rails: guides of arcs and lines, such as tensioner arms and guide rails of engines.
//!
//! A rail is specified in the direction in which the chain runs over it: a start, a heading, and consecutive stretches
//! without a kink, straight or of constant radius (positive: convex towards the chain). Its frame is that of the body
//! that carries it, or that of the drive if it is fixed. Each end is a corner of the contour.

use super::guide::GuideSide;
use super::profile::{Element, Profile, ProfileError};
use super::route::Wrap;
use super::{Vec2, perp, rotated, unit};
use crate::units::atan2;
use std::f64::consts::PI;

/// A stretch of a rail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    pub length_m: f64,
    /// None: straight; positive: convex towards the chain; negative: concave.
    pub radius_m: Option<f64>,
}

/// A part of a rail's contour with one contact rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Piece {
    /// From `start` along `along`. The outward normal is `along` turned by -90 degrees; the material lies on the other
    /// side.
    Line { start: Vec2, along: Vec2, length_m: f64 },
    /// Points are centre + radius x outward normal. The radius is zero (a corner) or positive for a convex piece,
    /// negative for a concave one. `from`, `to`: outward normals at its ends; on a convex piece they turn
    /// counterclockwise, by less than half a turn.
    Arc { centre: Vec2, radius_m: f64, from: Vec2, to: Vec2 },
    /// The point where a line ends and a convex arc or the end of the rail begins. It supports a straight edge that
    /// lies on the line and extends beyond it.
    EdgeSupport { point: Vec2, normal: Vec2 },
}

/// A rail's contour, the material on the left.
#[derive(Clone, Debug, PartialEq)]
pub struct Rail {
    pub side: GuideSide,
    pub profile: Profile,
    /// The corner at the beginning, then the profile's elements, the corner at the end, and the edge supports.
    pub pieces: Vec<Piece>,
    /// +1: the chain travels along the profile; -1: against it.
    pub travel: f64,
}

/// Centres and radii that differ by less are equal [m].
const SAME_CENTRE_M: f64 = 1e-9;

/// Ends that are closer coincide [m].
const SHORTEST_CHORD_M: f64 = 1e-6;

/// Arcs turn by less than this, so that one sector determines which directions belong to them.
pub const LARGEST_SWEEP_RAD: f64 = 0.9 * PI;

impl Rail {
    /// A rail of `stretches` from `start`, where the chain arrives with the heading `heading_rad`. Fails with the index
    /// of a stretch that has no length or turns too far.
    pub fn new(side: GuideSide, start: Vec2, heading_rad: f64, stretches: &[Stretch]) -> Result<Rail, RailError> {
        // Sense in which the chain turns around a convex arc.
        let sense = if side == GuideSide::Inside { 1.0 } else { -1.0 };
        let (mut at, mut heading) = (start, heading_rad);
        let mut elements = Vec::new();
        for (index, stretch) in stretches.iter().enumerate() {
            let Stretch { length_m, radius_m } = *stretch;
            let sweep = radius_m.map_or(0.0, |r| sense * length_m / r);
            if length_m.is_nan() || length_m <= 0.0 || sweep.is_nan() || sweep.abs() > LARGEST_SWEEP_RAD {
                return Err(RailError::Stretch(index));
            }
            let from = at;
            match radius_m {
                None => at += unit(heading) * length_m,
                Some(r) => {
                    let centre = at + perp(unit(heading)) * (sense * r);
                    at = centre + rotated(at - centre, sweep);
                    heading += sweep;
                    let out = (from - centre) / r.abs();
                    elements.push(Element::Arc {
                        centre,
                        radius_m: r.abs(),
                        start_rad: atan2(out.y, out.x),
                        sweep_rad: sweep,
                    });
                    continue;
                }
            }
            elements.push(Element::Line { start: from, end: at });
        }
        if side == GuideSide::Outside {
            elements = elements.iter().rev().map(reversed).collect();
        }
        let profile = Profile::new(elements, false).map_err(RailError::Profile)?;
        Ok(Rail { side, pieces: pieces(&profile), profile, travel: sense })
    }

    /// Convex arcs and the corners at both ends, in the direction of travel of the chain, which may bend around them:
    /// centre and radius [m].
    pub fn bends(&self) -> Vec<(Vec2, f64)> {
        let mut arcs: Vec<(Vec2, f64)> = self
            .pieces
            .iter()
            .filter_map(|p| match *p {
                Piece::Arc { centre, radius_m, .. } if radius_m >= 0.0 => Some((centre, radius_m)),
                Piece::Line { .. } | Piece::Arc { .. } | Piece::EdgeSupport { .. } => None,
            })
            .collect();
        // An arc that is split into several stretches counts once.
        arcs.dedup_by(|a, b| (a.0 - b.0).norm() < SAME_CENTRE_M && (a.1 - b.1).abs() < SAME_CENTRE_M);
        if self.travel < 0.0 {
            arcs.reverse();
        }
        arcs
    }

    /// Sense in which the chain wraps its convex arcs.
    pub fn wrap(&self) -> Wrap {
        match self.side {
            GuideSide::Inside => Wrap::Inside,
            GuideSide::Outside => Wrap::Outside,
        }
    }

    /// Direction towards the chain: the normal of the straight line from its beginning to its end; where these coincide, that of its contour at the
    /// beginning.
    pub fn towards_chain(&self) -> Vec2 {
        let ends = self.profile.elements().first().zip(self.profile.elements().last());
        let along = ends.map_or(Vec2::x(), |(first, last)| {
            let chord = last.end() - first.start();
            if chord.norm() > SHORTEST_CHORD_M { chord.normalize() } else { first.tangent(0.0) }
        });
        -perp(along)
    }

    /// Axis-aligned bounding box: (lower, upper).
    pub fn bounds(&self) -> (Vec2, Vec2) {
        let boxes = || self.profile.elements().iter().map(|e| e.bounds());
        let low = boxes().map(|b| b.0).fold(Vec2::repeat(f64::INFINITY), |a, b| a.inf(&b));
        (low, boxes().map(|b| b.1).fold(Vec2::repeat(f64::NEG_INFINITY), |a, b| a.sup(&b)))
    }

    /// Upper bound of the distance of its points from the origin of its frame [m].
    pub fn reach_m(&self) -> f64 {
        let (low, high) = self.bounds();
        low.abs().sup(&high.abs()).norm()
    }
}

/// Why there is no rail.
#[derive(Clone, Debug, PartialEq)]
pub enum RailError {
    /// This stretch has no length or turns too far.
    Stretch(usize),
    Profile(ProfileError),
}

impl std::fmt::Display for RailError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RailError::Stretch(index) => {
                let most = LARGEST_SWEEP_RAD.to_degrees();
                write!(f, "its stretch number {} turns by more than {most:.0} degrees", index + 1)
            }
            RailError::Profile(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for RailError {}

/// The same element traversed backwards. Material that was on its right is then on its left.
fn reversed(element: &Element) -> Element {
    match *element {
        Element::Line { start, end } => Element::Line { start: end, end: start },
        Element::Arc { centre, radius_m, start_rad, sweep_rad } => {
            Element::Arc { centre, radius_m, start_rad: start_rad + sweep_rad, sweep_rad: -sweep_rad }
        }
    }
}

fn pieces(profile: &Profile) -> Vec<Piece> {
    let elements = profile.elements();
    let (first, last) = (&elements[0], &elements[elements.len() - 1]);
    // The normals of a corner range from the normal of the contour to the direction in which the contour ends.
    let corner = |centre: Vec2, from: Vec2, to: Vec2| Piece::Arc { centre, radius_m: 0.0, from, to };
    let mut pieces = vec![corner(first.start(), -first.tangent(0.0), first.normal(0.0))];
    pieces.extend(elements.iter().map(|e| match *e {
        Element::Line { start, end } => {
            Piece::Line { start, along: (end - start).normalize(), length_m: (end - start).norm() }
        }
        Element::Arc { centre, radius_m, sweep_rad, .. } => {
            Piece::Arc { centre, radius_m: radius_m * sweep_rad.signum(), from: e.normal(0.0), to: e.normal(1.0) }
        }
    }));
    pieces.push(corner(last.end(), last.normal(1.0), last.tangent(1.0)));
    let is_line = |p: &Piece| matches!(p, Piece::Line { .. });
    let is_convex = |p: &Piece| matches!(p, Piece::Arc { radius_m, .. } if *radius_m >= 0.0);
    let supports = pieces.windows(2).filter_map(|pair| {
        let (line, begins) = match (&pair[0], &pair[1]) {
            (line, next) if is_line(line) && is_convex(next) => (line, false),
            (next, line) if is_line(line) && is_convex(next) => (line, true),
            _ => return None,
        };
        let Piece::Line { start, along, length_m } = *line else { return None };
        Some(Piece::EdgeSupport { point: if begins { start } else { start + along * length_m }, normal: -perp(along) })
    });
    let supports: Vec<Piece> = supports.collect();
    pieces.extend(supports);
    pieces
}
