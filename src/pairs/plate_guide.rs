//! Plate ends on fixed straight guides, many at a time.
//!
//! A plate is a stadium, so it lies on a straight face exactly where the circle of its end about a joint does: both ends of a
//! link are contacts. In the guide frame the face is y = 0, 0 <= x <= length, continued by relief arcs of radius rho whose
//! centres lie at (0, -rho) and (length, -rho). With the nearest centre of curvature c = (clamp(x, 0, length), -rho) the
//! penetration is rho + r - |p - c| and the normal (p - c)/|p - c| everywhere, on the face to rounding.
//! Forces as in [`super::tooth_contact`], the guide at rest.

use super::bush_tooth::Lanes;
use crate::elements::contact_law::ContactLaw;
use crate::geometry::Vec2;
use crate::lanes::{LANES, LaneBlock};

/// A guide as the contact sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct GuideBody {
    pub origin: Vec2,
    pub along: Vec2,
    pub length_m: f64,
    pub end_radius_m: f64,
    /// How far the relief arcs reach beyond the face [m].
    pub relief_m: f64,
    /// Radius of the plate ends [m].
    pub plate_radius_m: f64,
    /// 0: inside the loop, 1: outside.
    pub side: usize,
    /// False: abutments slide on it, see [`super::end_contact`].
    pub touches_plates: bool,
    pub law: ContactLaw,
    pub friction: f64,
    pub stick_speed_m_s: f64,
}

/// Whether any joint is within `reach_m` of touching, or touches: a first test of positions alone. With `reach_m` at least what
/// a joint moves in a step, whatever touched a step ago is found too.
#[inline(always)]
pub fn any_within(body: &GuideBody, reach_m: f64, x: LaneBlock, y: LaneBlock) -> bool {
    let (tx, ty) = (body.along.x, body.along.y);
    let base = body.origin.y * tx - body.origin.x * ty;
    // Over the relief arcs the gap is larger than over the face prolonged.
    let (low, high) = (base - body.plate_radius_m, base + body.plate_radius_m + reach_m);
    let mut near = 0_u64;
    for i in 0..LANES {
        let height = y[i] * tx - x[i] * ty;
        near |= u64::from((height > low) & (height < high));
    }
    near != 0
}

/// Whether any joint touches the guide, touched it (`past_force`: its force then), or may within a step. Errs on the safe
/// side: over the relief arcs `reach_m` is reckoned with, and accelerations whatever their sense. `motion`: x, y, vx, vy of the joints;
/// `push`: at most how fast each is accelerated [m/s2].
#[inline(always)]
pub fn any_near(
    body: &GuideBody,
    reach_m: f64,
    step_s: f64,
    past_force: LaneBlock,
    motion: [LaneBlock; 4],
    push: LaneBlock,
) -> bool {
    let (tx, ty) = (body.along.x, body.along.y);
    let base = body.origin.y * tx - body.origin.x * ty;
    let start = body.origin.x * tx + body.origin.y * ty;
    let total = body.end_radius_m + body.plate_radius_m;
    let [x, y, vx, vy] = motion;
    let mut near = 0_u64;
    for i in 0..LANES {
        let height = y[i] * tx - x[i] * ty - base;
        let along = x[i] * tx + y[i] * ty - start;
        let speed = vy[i] * tx - vx[i] * ty;
        let speed = if speed < 0.0 { -speed } else { speed };
        let foot = if along > body.length_m { body.length_m } else { along };
        let foot = if foot < 0.0 { 0.0 } else { foot };
        let (dx, dy) = (along - foot, height + body.end_radius_m);
        let way = if dx == 0.0 { 1.01 * step_s * speed } else { reach_m };
        let reach = total + way + 0.51 * step_s * step_s * push[i];
        let within = (dx * dx + dy * dy < reach * reach) & (height > -body.plate_radius_m);
        near |= u64::from(within | (past_force[i] != 0.0));
    }
    near != 0
}

/// Geometry of all lanes, coordinates relative to `origin` in the world's directions.
#[inline(always)]
pub fn penetrations(body: &GuideBody, lanes: &mut Lanes) {
    let (tx, ty) = (body.along.x, body.along.y);
    let total = body.end_radius_m + body.plate_radius_m;
    for i in 0..LANES {
        let along = lanes.x[i] * tx + lanes.y[i] * ty;
        let above = lanes.y[i] * tx - lanes.x[i] * ty;
        let foot = if along > body.length_m { body.length_m } else { along };
        let foot = if foot < 0.0 { 0.0 } else { foot };
        let (dx, dy) = (along - foot, above + body.end_radius_m);
        let d2 = dx * dx + dy * dy;
        let distance = if d2 > 1e-24 { d2 } else { 1e-24 }.sqrt();
        let inverse = 1.0 / distance;
        let (nx, ny) = (dx * inverse, dy * inverse);
        // A joint further behind the face than a plate's radius belongs to the other side of the loop.
        let beyond = (dx > body.relief_m) | (dx < -body.relief_m);
        let here = (above > -body.plate_radius_m) & !beyond;
        lanes.penetration[i] = if here { total - distance } else { -body.plate_radius_m };
        lanes.normal_x[i] = nx * tx - ny * ty;
        lanes.normal_y[i] = nx * ty + ny * tx;
        lanes.curvature[i] = if dx == 0.0 { 0.0 } else { 0.0 - inverse };
        lanes.body_radius[i] = body.end_radius_m;
    }
}
