//! The ring of a second sprocket, conjugate to abutments that were designed for another number of teeth.
//!
//! A link has one contour, designed for the sprocket with z1 teeth, whose ring is a circle. On a sprocket with z2 > z1
//! teeth the chain follows that sprocket's own exact path if the ring that turns with it is the envelope of the contour
//! under that motion. The contact point is where the normal of the contour passes through the instant centre of link
//! and sprocket,
//!
//! ```text
//! I = O + perp(O') / (2 pi/z2 - turn_rate)      (link frame),      (I - K).t = 0
//! ```
//! The envelope begins ahead of the seat at the height of the guide's face, which is its lowest radius, rises towards
//! the seat and would end slightly behind it. The envelope of the rear abutments is its mirror image. Where both exist,
//! about the seat, the lower one is used, which leaves a crest there and a gap of a few micrometres under seated links.
//! Between the lobes, where the envelope ends, the valley has the height of the guide's face.
//!
//! Gap frame as in `sprocket`: origin on the axis, +y through the seat of a joint, counterclockwise, material on the
//! left.
//!
//! Source: general theory of gearing (envelope, instant centre); own derivation. Valid for z2 >= z1: below that the
//! envelope has a step at the seat.

use super::abutment::{Abutment, tolerance_m};
use super::contour::{AbutmentContour, ContourFoot};
use super::fit::{self, CurvePoint};
use super::path::{Transition, boundary};
use crate::geometry::profile::{Element, Profile, ProfileError};
use crate::geometry::{Vec2, cross, perp, rotated, unit};
use crate::units::{DEG, MM, atan2, wrap_angle};
use std::f64::consts::PI;

/// A ring of lobes, one per tooth; a circle of radius R - a if z2 = z1.
#[derive(Clone, Debug, PartialEq)]
pub struct LobedRing {
    pub transition: Transition,
    /// Lowest radius: the height of the guide's face over the axis. (Abutments with a hollow have no lobes.)
    pub valley_radius_m: f64,
    /// Radius at the seat, where the flanks meet.
    pub crest_radius_m: f64,
    /// Radius at the end of the envelope behind the seat, which is removed.
    pub envelope_end_radius_m: f64,
    /// Angle from the seat ahead to where the flank rises from the valley.
    pub flank_start_rad: f64,
    /// Angle from the seat back to the end of the envelope, which is removed.
    pub envelope_end_rad: f64,
    /// tau of the front joint up to which the ring guides the link exactly.
    pub exact_until: f64,
    /// Kink angle of the outline at the crest.
    pub crest_kink_rad: f64,
    /// Largest distance of the exact flank from the arcs.
    pub max_deviation_m: f64,
    /// Outline from the middle of one valley to the next about the seat, in the gap frame. Transitions are tangent
    /// except at the crest.
    pub tooth: Vec<Element>,
    /// Index of the element that ends at the crest.
    pub crest_arc: usize,
    /// The same for contact search.
    arcs: Vec<RingArc>,
    /// Inverse of the distance from the crest's ray beyond which an abutment can contact its own side only [1/m].
    crest_offsets_per_m: f64,
}

/// An element of the outline with its data for contact search.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RingArc {
    /// For a flat, a point on it.
    centre: Vec2,
    /// Positive convex, negative concave, infinite for a flat.
    radius_m: f64,
    start: Vec2,
    end: Vec2,
    normal_start: Vec2,
    normal_end: Vec2,
}

/// Contact of ring and abutment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RingContact {
    /// Gap [m], negative for penetration.
    pub gap_m: f64,
    /// On the abutment, in the link frame.
    pub point: Vec2,
    /// Out of the abutment, in the link frame.
    pub normal: Vec2,
    /// Radii of curvature of the abutment and of the ring, at the contact; zero at corners.
    pub abutment_radius_m: f64,
    pub ring_radius_m: f64,
    /// Index of the arc of the abutment; index of the element of the lobe, for its crest the number of elements.
    pub abutment_arc: usize,
    pub ring_element: usize,
}

/// An element of a lobe, or its crest, in the gap frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LobeArc {
    pub centre: Vec2,
    /// Positive convex, negative hollow, zero for the crest, infinite for a flat.
    pub radius_m: f64,
    /// Outward normals at its ends, counterclockwise.
    pub first: Vec2,
    pub last: Vec2,
    /// 1: before the crest; -1: behind it; 0: the crest.
    pub side: f64,
}

/// Why there is no such ring.
#[derive(Clone, Debug, PartialEq)]
pub enum RingError {
    /// The contour is designed for more teeth than the sprocket has.
    FewerTeeth { ring: u32, contour: u32 },
    /// Pitches of chain and sprocket differ.
    Pitch { ring_m: f64, contour_m: f64 },
    /// The envelope is undercut here.
    Undercut { tau: f64 },
    /// Over two links lobes of neighbouring teeth would overlap.
    TwoLinks,
    /// The abutments are designed for a path with jumps in acceleration, at this inclination [rad].
    Jump { inclination_rad: f64 },
    /// The abutment's hollow is tighter than the ring [m].
    Hollow { hollow_m: f64, ring_m: f64 },
}

impl std::fmt::Display for RingError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            RingError::FewerTeeth { ring, contour } => write!(
                f,
                "abutments made for {contour} teeth have no ring on {ring}; make them for the smaller sprocket, \
                 with {ring} teeth"
            ),
            RingError::Pitch { ring_m, contour_m } => {
                write!(f, "the sprocket's pitch of {ring_m} m is not the chain's, {contour_m} m")
            }
            RingError::TwoLinks => write!(
                f,
                "over two links, lobes of neighbouring teeth would run into each other; sprockets of as many teeth as the \
                 abutments are made for have a round ring"
            ),
            RingError::Jump { inclination_rad } => write!(
                f,
                "abutments for an inclination of {:.4} deg, where the acceleration jumps, have no lobed ring; those for the \
                 inclination of continuous acceleration do, and sprockets of as many teeth have a round ring",
                inclination_rad / DEG
            ),
            RingError::Hollow { hollow_m, ring_m } => write!(
                f,
                "the abutments have a hollow of radius {:.3} mm, and the ring's is {:.3} mm: it would touch twice; a more \
                 inclined link has a wider hollow",
                hollow_m / MM,
                ring_m / MM
            ),
            RingError::Undercut { tau } => {
                write!(
                    f,
                    "the ring's lobe is undercut at {tau:.3} of the hand-over; abutments nearer to the joint work"
                )
            }
        }
    }
}

impl std::error::Error for RingError {}

/// Points at which the exact flank is checked and compared with the arcs.
const SAMPLES: u32 = 1000;

/// Distance below which the end of the envelope counts as being at the seat, in pitches: rounding at z2 = z1.
const AT_SEAT_PITCHES: f64 = 1e-9;

/// Minimum ratio of the radii of a hollow and the ring for a unique common normal.
const HOLLOW_ROOM: f64 = 1.05;

/// Checks that a ring of this radius has a unique foot on the abutments.
pub fn fits_hollow(abutment: &Abutment, ring_m: f64) -> Result<(), RingError> {
    let hollow_m = abutment.front.hollow_radius_m();
    if hollow_m > HOLLOW_ROOM * ring_m { Ok(()) } else { Err(RingError::Hollow { hollow_m, ring_m }) }
}

impl LobedRing {
    /// The ring of the sprocket of `transition` for the abutments of `abutment`.
    pub fn new(abutment: &Abutment, transition: Transition) -> Result<LobedRing, RingError> {
        let (ring, contour) = (transition.teeth, abutment.transition.teeth);
        if ring < contour {
            return Err(RingError::FewerTeeth { ring, contour });
        }
        let pitch = transition.pitch_m;
        if pitch != abutment.transition.pitch_m {
            return Err(RingError::Pitch { ring_m: pitch, contour_m: abutment.transition.pitch_m });
        }
        if abutment.transition.turning.is_some() || transition.turning.is_some() {
            return Err(RingError::TwoLinks);
        }
        if !abutment.transition.smooth_acceleration {
            return Err(RingError::Jump { inclination_rad: abutment.transition.inclination_rad });
        }
        let flank = |tau: f64| envelope(abutment, &transition, tau);
        check_envelope(&flank)?;
        let end = flank(1.0).point;
        let exact_until =
            if end.x <= AT_SEAT_PITCHES * pitch { 1.0 } else { boundary(0.0, 1.0, |tau| flank(tau).point.x < 0.0) };
        let crest = Vec2::new(0.0, flank(exact_until).point.y);
        // From the crest ahead and down to the valley, counterclockwise: tau decreases.
        let curve = |tau: f64| {
            let p = flank(-tau);
            if -tau == exact_until { CurvePoint { point: crest, ..p } } else { p }
        };
        let ahead = fit::fit(&curve, -exact_until, 0.0, tolerance_m(pitch));
        let max_deviation_m = fit::deviation_m(&curve, -exact_until, 0.0, &ahead, SAMPLES);
        let foot = flank(0.0).point;
        let valley_radius_m = foot.norm();
        let flank_start_rad = wrap_angle(atan2(foot.y, foot.x) - 0.5 * PI);
        let half_rad = PI / f64::from(ring);
        let valley = Element::Arc {
            centre: Vec2::zeros(),
            radius_m: valley_radius_m,
            start_rad: 0.5 * PI + flank_start_rad,
            sweep_rad: half_rad - flank_start_rad,
        };
        let mut half = ahead;
        half.push(valley);
        let crest_arc = half.len() - 1;
        let crest_normal = half[0].normal(0.0);
        let tooth: Vec<Element> = half.iter().rev().map(mirrored).chain(half.iter().copied()).collect();
        Ok(LobedRing {
            transition,
            valley_radius_m,
            crest_radius_m: crest.y,
            crest_offsets_per_m: 1.0 / (FAR_SIDE * crest.y),
            envelope_end_radius_m: end.norm(),
            flank_start_rad,
            envelope_end_rad: -wrap_angle(atan2(end.y, end.x) - 0.5 * PI),
            exact_until,
            crest_kink_rad: 2.0 * wrap_angle(atan2(crest_normal.y, crest_normal.x) - 0.5 * PI),
            max_deviation_m,
            arcs: tooth.iter().map(RingArc::new).collect(),
            tooth,
            crest_arc,
        })
    }

    /// The whole outline, tooth 0 about +y.
    pub fn profile(&self) -> Result<Profile, ProfileError> {
        let seat = self.transition.seat_angle_rad();
        let elements = (0..self.transition.teeth)
            .flat_map(|k| self.tooth.iter().map(move |e| e.moved(f64::from(k) * seat, Vec2::zeros())))
            .collect();
        Profile::new(elements, true)
    }

    /// Contact of one lobe with an abutment: the smallest gap at which normals are opposite. `axis` is the sprocket's
    /// axis in the link frame and `turn_rad` the angle of the lobe's gap frame to the link frame. `None` if this lobe
    /// has no common normal with it. Exact for convex arcs, flats and the crest; to rounding for concave arcs.
    pub fn contact(&self, abutment: &AbutmentContour, axis: Vec2, turn_rad: f64) -> Option<RingContact> {
        let turn = unit(turn_rad);
        let on = |k: usize| self.element_contact(k, abutment, axis, turn);
        let arcs = (0..self.arcs.len()).filter_map(on);
        arcs.chain(self.crest_contact(abutment, axis, turn)).reduce(nearer)
    }

    fn element_contact(&self, k: usize, abutment: &AbutmentContour, axis: Vec2, turn: Vec2) -> Option<RingContact> {
        let contact = self.arcs[k].placed(axis, turn).contact(abutment)?;
        Some(RingContact { ring_element: k, ..contact })
    }

    /// Contact of the crest's corner, if the abutment's normal lies between those of its two sides.
    fn crest_contact(&self, abutment: &AbutmentContour, axis: Vec2, turn: Vec2) -> Option<RingContact> {
        let before = self.arcs[self.crest_arc].placed(axis, turn);
        let after = self.arcs[self.crest_arc + 1].placed(axis, turn);
        let foot = abutment.closest_to_point(before.end);
        within(before.normal_end, after.normal_start, -foot.normal)
            .then(|| RingContact { ring_element: self.arcs.len(), ..RingContact::at(&foot, foot.distance_m, 0.0) })
    }

    /// As [`LobedRing::contact`], but faster; `turn` is the unit vector at `turn_rad`. A binary search over the
    /// elements on either side of the crest; the abutment is more curved than the hollow parts of the ring.
    pub fn contact_at(&self, abutment: &AbutmentContour, axis: Vec2, turn: Vec2) -> Option<RingContact> {
        let turned = |v: Vec2| Vec2::new(turn.x * v.x - turn.y * v.y, turn.y * v.x + turn.x * v.y);
        // Offset of the abutment's nearest point to the axis from the crest's ray, to the left, over the distance.
        let at = abutment.closest_to_point(axis).point - axis;
        let offset_ratio = self.crest_offset_ratio(at, turn);
        let mut least: Option<RingContact> = None;
        // The outline is smooth on either side of the crest: each side has at most one common normal nearby.
        for side in [0..=self.crest_arc, self.crest_arc + 1..=self.arcs.len() - 1] {
            let (first, last) = (*side.start(), *side.end());
            // Far on the other side of the crest this side has no contact.
            if (first == 0) == (offset_ratio > 0.0) && offset_ratio.abs() > 1.0 {
                continue;
            }
            // At the end of an element, the point of the abutment that faces it lies ahead as long as the contact does.
            let ahead = |a: &RingArc| {
                let normal = turned(a.normal_end);
                let facing = abutment.support(-normal).1;
                (facing - (axis + turned(a.end))).dot(&perp(normal)) > 0.0
            };
            let here = (first + self.arcs[first..last].partition_point(ahead)).min(last);
            let neighbours = [here, here.saturating_sub(1).max(first), (here + 1).min(last)];
            let found = neighbours.into_iter().find_map(|k| self.element_contact(k, abutment, axis, turn));
            least = least.into_iter().chain(found).reduce(nearer);
        }
        least.into_iter().chain(self.crest_contact(abutment, axis, turn)).reduce(nearer)
    }

    /// Element `k` of a lobe; its crest for the number of elements.
    pub fn lobe_arc(&self, k: usize) -> LobeArc {
        let crest = &self.arcs[self.crest_arc];
        let Some(a) = self.arcs.get(k) else {
            let last = self.arcs[self.crest_arc + 1].normal_start;
            return LobeArc { centre: crest.end, radius_m: 0.0, first: crest.normal_end, last, side: 0.0 };
        };
        let (first, last) =
            if a.radius_m < 0.0 { (a.normal_end, a.normal_start) } else { (a.normal_start, a.normal_end) };
        let side = if k <= self.crest_arc { 1.0 } else { -1.0 };
        LobeArc { centre: a.centre, radius_m: a.radius_m, first, last, side }
    }

    /// Radius of the tightest hollow of the lobes [m]; infinite if there is none.
    pub fn tightest_hollow_m(&self) -> f64 {
        self.arcs.iter().filter(|a| a.radius_m < 0.0).map(|a| -a.radius_m).fold(f64::INFINITY, f64::min)
    }

    /// Offset of the point `at` of an abutment, relative to the axis, to the left of the crest's ray, over the offset
    /// beyond which it contacts its own side only. `turn`: as in [`LobedRing::contact_at`].
    #[inline(always)]
    pub fn crest_offset_ratio(&self, at: Vec2, turn: Vec2) -> f64 {
        0.0 - (turn.x * at.x + turn.y * at.y) * self.crest_offsets_per_m
    }

    /// Angle of the gap frame of the front joint's seat to the link frame, when that joint is at `tau` [rad].
    pub fn seat_turn_rad(&self, tau: f64) -> f64 {
        seat_turn_rad(&self.transition, tau)
    }
}

/// The contact with the smaller gap; the first of two equal ones.
fn nearer(a: RingContact, b: RingContact) -> RingContact {
    if b.gap_m < a.gap_m { b } else { a }
}

impl RingContact {
    fn at(foot: &ContourFoot, gap_m: f64, ring_radius_m: f64) -> RingContact {
        RingContact {
            gap_m,
            point: foot.point,
            normal: foot.normal,
            abutment_radius_m: foot.radius_m,
            ring_radius_m,
            abutment_arc: foot.arc,
            ring_element: 0,
        }
    }
}

/// Distance from the crest, over the radius, beyond which an abutment contacts its own side only: at 40 teeth flanks
/// extend over 0.06, and the side behind the crest over 0.006.
const FAR_SIDE: f64 = 0.02;

/// Maximum number of steps to the point of an abutment that is furthest from the centre of a concave arc. The error
/// falls in each step by the ratio of the two radii, some 1:40, so that a few steps suffice; abutments nearly as flat
/// as the hollow need many.
const FURTHEST_STEPS: u32 = 100;

impl RingArc {
    fn new(element: &Element) -> RingArc {
        let (centre, radius_m) = match *element {
            Element::Line { start, .. } => (start, f64::INFINITY),
            Element::Arc { centre, radius_m, sweep_rad, .. } => (centre, radius_m * sweep_rad.signum()),
        };
        RingArc {
            centre,
            radius_m,
            start: element.start(),
            end: element.end(),
            normal_start: element.normal(0.0),
            normal_end: element.normal(1.0),
        }
    }

    /// The element in the link frame, for the axis there and the direction of the gap frame.
    fn placed(&self, axis: Vec2, turn: Vec2) -> RingArc {
        let turned = |v: Vec2| Vec2::new(turn.x * v.x - turn.y * v.y, turn.y * v.x + turn.x * v.y);
        RingArc {
            centre: axis + turned(self.centre),
            radius_m: self.radius_m,
            start: axis + turned(self.start),
            end: axis + turned(self.end),
            normal_start: turned(self.normal_start),
            normal_end: turned(self.normal_end),
        }
    }

    /// Contact where the normals of arc and abutment are opposite, if on this arc. In the link frame.
    fn contact(&self, abutment: &AbutmentContour) -> Option<RingContact> {
        if self.radius_m.is_infinite() {
            let (_, point) = abutment.support(-self.normal_start);
            let along = (point - self.start).dot(&(self.end - self.start));
            let on = (0.0..=(self.end - self.start).norm_squared()).contains(&along);
            // A point further out along the normal has the same foot.
            let foot = abutment.closest_to_point(point - self.normal_start * (self.end - self.start).norm());
            return on.then(|| RingContact::at(&foot, (point - self.start).dot(&self.normal_start), self.radius_m));
        }
        if self.radius_m > 0.0 {
            let foot = abutment.closest_to_point(self.centre);
            return within(self.normal_start, self.normal_end, -foot.normal)
                .then(|| RingContact::at(&foot, foot.distance_m - self.radius_m, self.radius_m));
        }
        // The centre lies beyond the abutment: the nearest point to the ring is the one furthest from the centre.
        let mut outward = -(self.normal_start + self.normal_end).normalize();
        let mut point = abutment.support(outward).1;
        for _ in 0..FURTHEST_STEPS {
            let before = outward;
            outward = (point - self.centre).normalize();
            point = abutment.support(outward).1;
            // The error of the gap is quadratic in that of the direction.
            if (outward - before).norm_squared() < 1e-13 {
                break;
            }
        }
        if !within(self.normal_end, self.normal_start, -outward) {
            return None;
        }
        let gap_m = -self.radius_m - (point - self.centre).norm();
        // A point further out along the normal has the same foot.
        let foot = abutment.closest_to_point(point + outward * -self.radius_m);
        Some(RingContact::at(&foot, gap_m, self.radius_m))
    }
}

/// Normals at tangent transitions agree to this [rad]; a contact there belongs to both arcs, and the error of its gap
/// is quadratic.
const NORMAL_ROUNDING_RAD: f64 = 1e-9;

/// Whether `direction` lies between `first` and `last` counterclockwise; all within half a turn.
fn within(first: Vec2, last: Vec2, direction: Vec2) -> bool {
    cross(first, direction) >= -NORMAL_ROUNDING_RAD && cross(direction, last) >= -NORMAL_ROUNDING_RAD
}

/// Mirror image x -> -x, traversed in the same sense.
fn mirrored(element: &Element) -> Element {
    let mirror = |v: Vec2| Vec2::new(-v.x, v.y);
    match *element {
        Element::Line { start, end } => Element::Line { start: mirror(end), end: mirror(start) },
        Element::Arc { centre, radius_m, start_rad, sweep_rad } => {
            Element::Arc { centre: mirror(centre), radius_m, start_rad: PI - start_rad - sweep_rad, sweep_rad }
        }
    }
}

/// See [`LobedRing::seat_turn_rad`].
fn seat_turn_rad(transition: &Transition, tau: f64) -> f64 {
    let seat = transition.seat_angle_at_rad(tau);
    // In the mirrored approach frame the seat is at seat - 90 deg from +x; +y of the gap frame points there.
    seat - PI - transition.link(tau).turn_rad
}

/// Contact point of the ring and the lever when its front joint is at `tau`, in the gap frame of that joint's seat,
/// with the ring's tangent.
fn envelope(abutment: &Abutment, transition: &Transition, tau: f64) -> CurvePoint {
    let lever = transition.lever(tau);
    let spin = transition.seat_angle_rad() - lever.turn_rate;
    let instant_centre = lever.axis.position + perp(lever.axis.velocity) / spin;
    let contact = foot_on_contour(abutment, instant_centre);
    let back = -(transition.seat_angle_at_rad(tau) - PI - lever.turn_rad);
    CurvePoint {
        point: rotated(contact.point - lever.axis.position, back),
        tangent: rotated(-perp(contact.normal), back),
    }
}

/// The point of the exact contour whose normal passes through `centre`: regula falsi (Illinois) over the phase.
fn foot_on_contour(abutment: &Abutment, centre: Vec2) -> super::abutment::ContourPoint {
    let ahead = |phase: f64| {
        let p = abutment.exact(phase);
        (centre - p.point).dot(&perp(p.normal)) / abutment.transition.pitch_m
    };
    let (mut low, mut high) = (-1.0, 1.0);
    let (mut f_low, mut f_high) = (ahead(low), ahead(high));
    if f_high >= 0.0 {
        return abutment.exact(high);
    }
    let mut kept_low = None;
    for _ in 0..100 {
        let middle = high - f_high * (high - low) / (f_high - f_low);
        let f = ahead(middle);
        if f.abs() < 1e-16 || high - low < 1e-15 {
            return abutment.exact(middle);
        }
        // The value of an end that is kept twice in a row is halved, so that the other end moves too.
        if f < 0.0 {
            (high, f_high) = (middle, f);
            f_low *= if kept_low == Some(true) { 0.5 } else { 1.0 };
            kept_low = Some(true);
        } else {
            (low, f_low) = (middle, f);
            f_high *= if kept_low == Some(false) { 0.5 } else { 1.0 };
            kept_low = Some(false);
        }
    }
    abutment.exact(0.5 * (low + high))
}

/// Checks that the envelope is traversed in one direction and turns in one direction.
fn check_envelope(flank: &dyn Fn(f64) -> CurvePoint) -> Result<(), RingError> {
    let mut before = flank(0.0);
    for k in 1..=SAMPLES {
        let tau = f64::from(k) / f64::from(SAMPLES);
        let here = flank(tau);
        let step = here.point - before.point;
        let across = cross(here.tangent, step).abs();
        if step.dot(&here.tangent) > 0.0 || across > 0.02 * step.norm() + 1e-6 * before.point.norm() {
            return Err(RingError::Undercut { tau });
        }
        before = here;
    }
    Ok(())
}
