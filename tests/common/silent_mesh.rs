//! Kinematics of a silent link that moves to its seat: gaps on the way, approach speeds, first contact, and the forces
//! of a lightly loaded wrap.
//!
//! The polygon path: joints of seated links lie on the pitch circle, the span is straight and keeps its direction, so
//! that in the frame of the sprocket a link turns about its front joint until its rear joint also reaches the pitch
//! circle (turn 0, the seat). With l = p sin alpha - s the lever of the trailing flank, s that of the leading one (to
//! the contact point of the face, from the foot of the joint's perpendicular), H = p cos alpha + f + rho and w the
//! speed of the sprocket:
//!
//! ```text
//! gap of the trailing flank    H (cos t - 1) + l sin t       t: remaining turn to the seat
//! approach at the seat         v_lead = w s      v_trail = w l
//! first contact early by t/w   H (cos t - 1) + l sin t = x cos alpha, x: how much further back the trailing flank lies
//! elongated by T/K             the same with x = T/K, approach w (l cos t - H sin t) there
//! ```
//! Wrap without friction, every link supported by its trailing flank alone, forces decreasing by the factor q per link:
//! with t = tau, sigma = s/p, A = cos alpha cos t - sigma sin t, B = cos alpha sin t + sigma cos t, k = sigma - sin
//! alpha,
//!
//! ```text
//! -sin t + B nu = k nu (cos t - A nu),  smaller positive root     nu = flank force / tension ahead
//! q = cos t - A nu                                                lean of the joint force = atan(k nu)
//! ```
//! T is the tension minus m v^2 / p. Source: derived here. Valid without friction, for rigid links and faces with a
//! contact point (arc, crowned).

use pitchline::geometry::chain::silent::{LinkPart, SilentLinkContour};
use pitchline::geometry::element_gap::{element_gap_m, least_distance_m};
use pitchline::geometry::profile::Element;
use pitchline::geometry::silent_sprocket::SilentSprocket;
use pitchline::geometry::{Vec2, unit};
use pitchline::units::{atan2, sin_cos};
use std::f64::consts::PI;

/// Smallest gap of a part of the link on its way to the seat, and its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmallestGap {
    /// Negative: overlap.
    pub gap_m: f64,
    /// Distance of the link from its seat, in pitches.
    pub pitches_before_seat: f64,
}

/// Smallest gaps between the parts of a link and all teeth, from three pitches before the seat to the seat. The exit is
/// the same in reverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EntryClearances {
    pub outer_flank: SmallestGap,
    pub toe: SmallestGap,
    pub inner_flank: SmallestGap,
    pub crotch: SmallestGap,
    pub eye: SmallestGap,
}

/// Pose of a link's frame in the frame of the sprocket, `pitches` before its seat in gap 0: angle and origin. The links
/// ahead of it, up to the one that seats, form a straight line.
pub fn pose_before_seat(sprocket: &SilentSprocket, pin_pitch_m: f64, pitches: f64) -> (f64, Vec2) {
    let tau = sprocket.pitch_angle_rad();
    // Whole links between this one and the pitch circle.
    let in_line = (libm::ceil(pitches) - 1.0).max(0.0);
    let angle_rad = 0.5 * PI - 0.5 * tau + pitches * tau;
    let carrier = unit(in_line * tau) * sprocket.pitch_radius_m;
    (angle_rad, carrier - unit(angle_rad) * (sprocket.spec.pitch_m * in_line + 0.5 * pin_pitch_m))
}

/// Follows a link from three pitches before its seat, in `steps_per_pitch` steps. `sprocket` need not be designed for
/// this link.
pub fn entry_clearances(link: &SilentLinkContour, sprocket: &SilentSprocket, steps_per_pitch: u32) -> EntryClearances {
    const PITCHES: u32 = 3;
    let none = SmallestGap { gap_m: f64::INFINITY, pitches_before_seat: 0.0 };
    let mut smallest = EntryClearances { outer_flank: none, toe: none, inner_flank: none, crotch: none, eye: none };
    let tooth: Vec<Element> = (-3..=PITCHES as i32 + 1).flat_map(|k| sprocket.gap(k)).collect();
    let outline = link.elements();
    let deepest_m = sprocket.deepest_overlap_m();
    for step in 0..=PITCHES * steps_per_pitch {
        let pitches_before_seat = f64::from(step) / f64::from(steps_per_pitch);
        let (angle_rad, origin) = pose_before_seat(sprocket, link.pin_pitch_m, pitches_before_seat);
        for (part, element) in SilentLinkContour::PARTS.iter().zip(&outline) {
            let nearest = match part {
                LinkPart::Back => continue,
                LinkPart::FrontEye | LinkPart::RearEye => &mut smallest.eye,
                LinkPart::FrontOuterFlank | LinkPart::RearOuterFlank => &mut smallest.outer_flank,
                LinkPart::FrontToe | LinkPart::RearToe => &mut smallest.toe,
                LinkPart::FrontInnerFlank | LinkPart::RearInnerFlank => &mut smallest.inner_flank,
                LinkPart::Crotch => &mut smallest.crotch,
            };
            let placed = element.moved(angle_rad, origin);
            for other in &tooth {
                // Elements that overlap by a depth are no further apart than that depth.
                if least_distance_m(&placed, other) >= nearest.gap_m.max(deepest_m) {
                    continue;
                }
                let gap_m = element_gap_m(&placed, other, deepest_m);
                if gap_m < nearest.gap_m {
                    *nearest = SmallestGap { gap_m, pitches_before_seat };
                }
            }
        }
    }
    smallest
}

/// Gaps of the leading and the trailing outer flank to the faces on which they will seat, for a link with its front
/// joint at `front_joint` (frame of the sprocket; seated in gap 0: (R, 0)) and turned by `turn_rad` out of the seat
/// [m]. Negative: overlap.
pub fn flank_gaps_m(link: &SilentLinkContour, sprocket: &SilentSprocket, front_joint: Vec2, turn_rad: f64) -> [f64; 2] {
    let (angle_rad, seated) = sprocket.pose_at_seat(link.pin_pitch_m, turn_rad);
    let origin = seated + front_joint - Vec2::new(sprocket.pitch_radius_m, 0.0);
    // The leading flank contacts the face that ends its own gap ahead, the trailing flank the one that ends gap -1
    // behind.
    let (ahead, behind) = (sprocket.gap(0)[4], sprocket.gap(-1)[2]);
    let deepest_m = sprocket.deepest_overlap_m();
    [(link.front.outer_flank, ahead), (link.rear.outer_flank, behind)]
        .map(|(flank, face)| element_gap_m(&flank.element().moved(angle_rad, origin), &face, deepest_m))
}

/// Lever of the trailing flank about the front joint [m]; None for a straight face.
pub fn trailing_lever_m(sprocket: &SilentSprocket) -> Option<f64> {
    let sin_alpha = sin_cos(sprocket.spec.link.flank_angle_rad).0;
    sprocket.contact_distance_m.map(|s_m| sprocket.spec.pitch_m * sin_alpha - s_m)
}

/// Approach speeds of leading and trailing flank at the seat on the polygon path [m/s]; None for a straight face, which
/// has no single contact point.
pub fn approach_speeds_m_s(sprocket: &SilentSprocket, speed_rad_s: f64) -> Option<[f64; 2]> {
    let leading_m = sprocket.contact_distance_m?;
    let trailing_m = trailing_lever_m(sprocket)?;
    Some([speed_rad_s * leading_m, speed_rad_s * trailing_m])
}

/// Turn before the seat at which the trailing flank makes contact if it lies `further_back_m` behind its nominal
/// position [rad]: the smaller root of H (cos t - 1) + l sin t = x cos alpha. None for a straight face, or without
/// contact.
pub fn first_contact_turn_rad(sprocket: &SilentSprocket, further_back_m: f64) -> Option<f64> {
    let (lever_m, height_m) = (trailing_lever_m(sprocket)?, contact_height_m(sprocket)?);
    let needed_m = further_back_m * sin_cos(sprocket.spec.link.flank_angle_rad).1 + height_m;
    // H cos t + l sin t = hypot(H, l) cos(t - t0).
    let hypot_m = libm::hypot(height_m, lever_m);
    let ratio = needed_m / hypot_m;
    (ratio <= 1.0).then(|| atan2(lever_m, height_m) - libm::acos(ratio))
}

/// Approach speed of the trailing flank if the joint ahead is elongated by `stretch_m` = T / K [m/s].
pub fn stretched_approach_speed_m_s(sprocket: &SilentSprocket, speed_rad_s: f64, stretch_m: f64) -> Option<f64> {
    let turn_rad = first_contact_turn_rad(sprocket, stretch_m)?;
    let (sin_turn, cos_turn) = sin_cos(turn_rad);
    Some(speed_rad_s * (trailing_lever_m(sprocket)? * cos_turn - contact_height_m(sprocket)? * sin_turn))
}

/// H = p cos alpha + f + rho [m].
fn contact_height_m(sprocket: &SilentSprocket) -> Option<f64> {
    let link = &sprocket.spec.link;
    let cos_alpha = sin_cos(link.flank_angle_rad).1;
    sprocket.face_radius_m.map(|rho_m| sprocket.spec.pitch_m * cos_alpha + link.face_distance_m + rho_m)
}

/// Distance of the trailing flanks of two successive links, `ahead` first, along the straight chain [m], from errors of
/// pins and contours. A row with longer pins only changes nothing, because the gain of one link is the loss of the link
/// behind. Where the chain bends by tau at the joint between the two, a remainder is left, which
/// [`first_contact_on_contours_rad`] includes: pins longer by x in one row and shorter in the other move the trailing
/// flank towards its face by x sin(pi/z) sin(alpha + pi/z).
pub fn working_flank_pitch_m(ahead: &SilentLinkContour, link: &SilentLinkContour) -> f64 {
    let joint_behind_eye_m = 0.5 * (ahead.pin_pitch_m - ahead.flank_pitch_m);
    joint_behind_eye_m + 0.5 * (link.pin_pitch_m + link.flank_pitch_m)
}

/// Turn before the seat at which the trailing flank of `link` makes contact, on the exact contours, if the link ahead
/// is seated with its rear virtual eye at its nominal position [rad]. None if the flanks do not meet within a tenth of
/// the pitch angle of the seat.
pub fn first_contact_on_contours_rad(
    ahead: &SilentLinkContour,
    link: &SilentLinkContour,
    sprocket: &SilentSprocket,
) -> Option<f64> {
    let tau = sprocket.pitch_angle_rad();
    let along_ahead = unit(0.5 * PI + 0.5 * tau);
    let joint_behind_eye_m = 0.5 * (ahead.pin_pitch_m - ahead.flank_pitch_m);
    let joint = Vec2::new(sprocket.pitch_radius_m, 0.0) - along_ahead * joint_behind_eye_m;
    let gap_m = |turn_rad: f64| flank_gaps_m(link, sprocket, joint, turn_rad)[1];
    // Bisection; the gap decreases towards the seat within this range.
    let (mut open_rad, mut closed_rad) = (FIRST_CONTACT_RANGE * tau, -FIRST_CONTACT_RANGE * tau);
    if !(gap_m(open_rad) > 0.0 && gap_m(closed_rad) < 0.0) {
        return None;
    }
    for _ in 0..60 {
        let middle_rad = 0.5 * (open_rad + closed_rad);
        if gap_m(middle_rad) > 0.0 {
            open_rad = middle_rad;
        } else {
            closed_rad = middle_rad;
        }
    }
    Some(0.5 * (open_rad + closed_rad))
}

/// Range around the seat in which a first contact is searched, in pitch angles. assumed: beyond it pitch errors are not
/// small.
const FIRST_CONTACT_RANGE: f64 = 0.1;

/// Forces of a wrap that is supported by one flank per link, and the limits of this state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrapStatics {
    /// nu: axial part of the force on the first flank, over the tension of the span.
    pub flank_force_ratio: f64,
    /// q: tension behind a link over the tension ahead of it.
    pub tension_ratio: f64,
    /// Angle between the joint force and the pin line [rad].
    pub lean_rad: f64,
    /// Both flanks of a link carry load only if its tension ratio T2 / T1 is at least this: (1 - x)/(1 + x), x =
    /// tan(pi/z)/tan alpha.
    pub both_flanks_tension_ratio: f64,
    /// Force per flank over the tension if both flanks carry the same load: sin(pi/z) / sin alpha.
    pub symmetric_flank_force_ratio: f64,
}

/// Solves the wrap; None for a straight face.
pub fn wrap_statics(sprocket: &SilentSprocket) -> Option<WrapStatics> {
    let tau = sprocket.pitch_angle_rad();
    let (sin_t, cos_t) = sin_cos(tau);
    let (sin_half, cos_half) = sin_cos(0.5 * tau);
    let (sin_alpha, cos_alpha) = sin_cos(sprocket.spec.link.flank_angle_rad);
    let sigma = sprocket.contact_distance_m? / sprocket.spec.pitch_m;
    let a = cos_alpha * cos_t - sigma * sin_t;
    let b = cos_alpha * sin_t + sigma * cos_t;
    let k = sigma - sin_alpha;
    // k A nu^2 + (B - k cos t) nu - sin t = 0 with k < 0: the smaller root, in the form without cancellation.
    let linear = b - k * cos_t;
    let discriminant = linear * linear + 4.0 * k * a * sin_t;
    if discriminant < 0.0 {
        return None;
    }
    let nu = 2.0 * sin_t / (linear + libm::sqrt(discriminant));
    let x = sin_half / cos_half * cos_alpha / sin_alpha;
    Some(WrapStatics {
        flank_force_ratio: nu,
        tension_ratio: cos_t - a * nu,
        lean_rad: atan2(k * nu, 1.0),
        both_flanks_tension_ratio: (1.0 - x) / (1.0 + x),
        symmetric_flank_force_ratio: sin_half / sin_alpha,
    })
}
