//! Bushes against the teeth of a sprocket, many at a time.
//!
//! A bush (circle of radius r) is folded into its tooth gap: gap axis g in the world, q = (|lateral|, radial) from the
//! sprocket axis. There it faces one of four circles, seat (concave), flank, tip corner (radius 0) or tip land:
//! penetration = +-(|q - c| - b), normal = -+(q - c)/|q - c|. Which one follows from three cross products; the rules are those
//! of `contact::gap_contact`, and a test holds the two together. Normal force after [`contact_law`], friction after
//! [`friction`], both as means over the step. The force acts at the deepest point of the bush, on link and sprocket alike:
//! the pair of forces is without moment.
//!
//! Rates: closing speed v_n = -v_rel . n; tangent t = n turned by +90 degrees; inverse effective masses of the link's end
//! w_n = 1/m + (l d x n)^2 / J, w_t = 1/m + (l d . n - r)^2 / J, with d the heading and l the signed lever of the joint.
//!
//! Other contours of a link ([`super::end_contact`]) touch at q = joint - r n + s t, with r and s their own at every instant;
//! r is that of the bush above, and s adds its lever to the normal force: v_n loses (omega_link - omega_body) s, l d x n
//! becomes l d x n - s, and the moment about the joint gains -s F_n.

use super::arc_lanes::{Found, NOTHING_M};
use super::contact_law::{self, ContactLaw, PairRadii, StepInput};
use super::friction;
use crate::geometry::Vec2;
use crate::geometry::sprocket::Sprocket;
use crate::recording::frame::Segment;
use crate::units::sin_cos;

/// Lanes that are computed together: arrays of a fixed size, so that they live in vector registers.
pub const LANES: usize = 8;

/// One value per lane.
pub type Column = [f64; LANES];

/// A yes or a no per lane, as wide as a value, so that it lives in vector registers too: all bits or none.
pub type Mask = [u64; LANES];

/// One lane of a [`Mask`].
#[inline(always)]
pub fn mask(yes: bool) -> u64 {
    if yes { u64::MAX } else { 0 }
}

/// Whether any lane says yes.
#[inline(always)]
pub fn any(lanes: &Mask) -> bool {
    lanes.iter().fold(0, |any, lane| any | lane) != 0
}

/// One block of values from `at`.
#[inline(always)]
pub fn take(column: &[f64], at: usize) -> Column {
    let mut out = [0.0; LANES];
    out.copy_from_slice(&column[at..at + LANES]);
    out
}

/// The first blocks of a column: slices of one length, so that one bounds check does for a loop over many of them.
#[inline(always)]
pub fn blocks(column: &[f64], count: usize) -> &[Column] {
    &column.as_chunks::<LANES>().0[..count]
}

#[inline(always)]
pub fn blocks_mut(column: &mut [f64], count: usize) -> &mut [Column] {
    &mut column.as_chunks_mut::<LANES>().0[..count]
}

/// A sprocket as the contact sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct ToothedBody {
    pub centre: Vec2,
    pub bush_radius_m: f64,
    pub seat_centre_m: f64,
    pub seat_gap_m: f64,
    pub seat_radius_m: f64,
    pub flank_centre: Vec2,
    pub flank_radius_m: f64,
    pub corner: Vec2,
    pub tip_radius_m: f64,
    /// (sin, cos) of half the seat angle.
    pub seat_end_sin: f64,
    pub seat_end_cos: f64,
    /// tan(pi/z): a bush further to the side than this times its radial distance belongs to a neighbouring gap.
    pub half_gap_tan: f64,
    /// Directions of the gap axes in the sprocket's frame.
    pub seat_cos: Vec<f64>,
    pub seat_sin: Vec<f64>,
    /// How far each gap lies beside its place: outwards, counterclockwise [m]; the largest of all.
    pub seat_out: Vec<f64>,
    pub seat_left: Vec<f64>,
    pub most_shift_m: f64,
    pub law: ContactLaw,
    pub friction: f64,
    pub stick_speed_m_s: f64,
}

impl ToothedBody {
    /// A sprocket that seats no bushes.
    pub fn without_seats(centre: Vec2, law: ContactLaw, friction: f64, stick_speed_m_s: f64) -> Self {
        ToothedBody {
            centre,
            bush_radius_m: 0.0,
            seat_centre_m: 0.0,
            seat_gap_m: 0.0,
            seat_radius_m: 0.0,
            flank_centre: Vec2::zeros(),
            flank_radius_m: 0.0,
            corner: Vec2::zeros(),
            tip_radius_m: 0.0,
            seat_end_sin: 0.0,
            seat_end_cos: 1.0,
            half_gap_tan: 0.0,
            seat_cos: Vec::new(),
            seat_sin: Vec::new(),
            seat_out: Vec::new(),
            seat_left: Vec::new(),
            most_shift_m: 0.0,
            law,
            friction,
            stick_speed_m_s,
        }
    }

    pub fn new(
        s: &Sprocket,
        centre: Vec2,
        bush_radius_m: f64,
        law: ContactLaw,
        friction: f64,
        stick_speed_m_s: f64,
    ) -> Self {
        let (seat_end_sin, seat_end_cos) = sin_cos(0.5 * s.seat_angle_rad);
        let (sin_half, cos_half) = sin_cos(0.5 * s.pitch_angle_rad());
        let (seat_sin, seat_cos) = (0..s.spec.teeth).map(|k| sin_cos(f64::from(k) * s.pitch_angle_rad())).unzip();
        ToothedBody {
            centre,
            bush_radius_m,
            seat_centre_m: s.seat_centre_m,
            seat_gap_m: s.seat_radius_m - bush_radius_m,
            seat_radius_m: s.seat_radius_m,
            flank_centre: s.flank_centre,
            flank_radius_m: s.flank_radius_m,
            corner: s.tip_corner,
            tip_radius_m: s.tip_radius_m,
            seat_end_sin,
            seat_end_cos,
            half_gap_tan: sin_half / cos_half,
            seat_cos,
            seat_sin,
            seat_out: (0..s.spec.teeth).map(|k| s.gap_shift_m(k).x).collect(),
            seat_left: (0..s.spec.teeth).map(|k| s.gap_shift_m(k).y).collect(),
            most_shift_m: s.gap_shifts.iter().map(Vec2::norm).fold(0.0, f64::max),
            law,
            friction,
            stick_speed_m_s,
        }
    }
}

/// The sprocket's motion at a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turning {
    pub cos: f64,
    pub sin: f64,
    pub omega: f64,
}

/// Columns of [`LANES`] contact lanes. Inputs are filled by the caller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lanes {
    /// Joint centre from the sprocket axis [m], its velocity, and that of the link [m/s, rad/s].
    pub x: Column,
    pub y: Column,
    pub vx: Column,
    pub vy: Column,
    pub omega: Column,
    /// Acceleration of the joint centre one step back [m/s2].
    pub ax: Column,
    pub ay: Column,
    /// Heading of the link and signed lever of the joint.
    pub cos: Column,
    pub sin: Column,
    pub lever: Column,
    pub inverse_mass: Column,
    pub inverse_inertia: Column,
    /// Direction of the gap axis in the sprocket's frame.
    pub seat_cos: Column,
    pub seat_sin: Column,
    /// How far that gap lies beside its place: outwards, counterclockwise [m].
    pub seat_out: Column,
    pub seat_left: Column,
    /// Memory of the contact: mean forces of the last step, age, approach speed.
    pub normal_force: Column,
    pub tangential_force: Column,
    pub age: Column,
    pub approach: Column,
    /// Results.
    pub penetration: Column,
    pub normal_x: Column,
    pub normal_y: Column,
    pub free_rate: Column,
    pub free_acceleration: Column,
    pub mobility: Column,
    pub body_radius: Column,
    /// Of the joint's path while it slides along the element: inverse distance from the centre, positive on concave ones [1/m].
    pub curvature: Column,
    /// Closing speed at the node; sliding speed there, before the forces change it.
    pub rate: Column,
    pub slide: Column,
    pub lost_damping: Column,
    pub lost_friction: Column,
    /// Force on the link [N], moment about the joint centre [N m], torque on the sprocket [N m].
    pub force_x: Column,
    pub force_y: Column,
    pub moment: Column,
    pub torque: Column,
}

/// What lanes of other contours of a link have besides: the contact point seen from the joint, against the normal and along
/// the tangent [m]; the link's angular acceleration one step back.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OffJoint {
    pub radius: Column,
    pub offset: Column,
    pub alpha: Column,
    /// Radius of curvature of the link's contour at the contact point [m].
    pub link_radius: Column,
}

impl Lanes {
    /// No contact in any lane.
    #[inline(always)]
    pub fn let_go(&mut self) {
        let zero = [0.0; LANES];
        (self.normal_force, self.tangential_force, self.age, self.approach) = (zero, zero, zero, zero);
        (self.lost_damping, self.lost_friction) = (zero, zero);
        (self.force_x, self.force_y, self.moment, self.torque) = (zero, zero, zero, zero);
    }
}

/// Whether any of these points is inside the circle of radius `reach_m` about the sprocket's axis.
#[inline(always)]
pub fn any_inside(body: &ToothedBody, reach_m: f64, x: &Column, y: &Column) -> bool {
    let reach2 = reach_m * reach_m;
    let mut inside = 0_u64;
    for i in 0..LANES {
        let (dx, dy) = (x[i] - body.centre.x, y[i] - body.centre.y);
        inside |= u64::from(dx * dx + dy * dy < reach2);
    }
    inside != 0
}

/// Whether any lane penetrates or is nearer than `reach_m`.
#[inline(always)]
pub fn any_within(reach_m: f64, lanes: &Lanes) -> bool {
    let mut near = 0_u64;
    for i in 0..LANES {
        near |= u64::from(lanes.penetration[i] > -reach_m);
    }
    near != 0
}

/// Geometry of all lanes: penetration and normal. Returns false when a lane has left its tooth gap; the caller then gives
/// it its new one and calls again.
#[inline(always)]
pub fn penetrations(body: &ToothedBody, turning: Turning, lanes: &mut Lanes) -> bool {
    let b = body;
    let (tip_b, flank_b) = (b.tip_radius_m + b.bush_radius_m, b.flank_radius_m + b.bush_radius_m);
    let (corner_x, corner_y) = (b.corner.x - b.flank_centre.x, b.corner.y - b.flank_centre.y);
    let mut strayed = 0_u64;
    for i in 0..LANES {
        let gx = turning.cos * lanes.seat_cos[i] - turning.sin * lanes.seat_sin[i];
        let gy = turning.sin * lanes.seat_cos[i] + turning.cos * lanes.seat_sin[i];
        let along = lanes.x[i] * gx + lanes.y[i] * gy;
        let across = gx * lanes.y[i] - gy * lanes.x[i];
        strayed |= u64::from(across.abs() > b.half_gap_tan * along);
        let radial = along - lanes.seat_out[i];
        let lateral = across - lanes.seat_left[i];
        let side = if lateral < 0.0 { -1.0 } else { 1.0 };
        let u = lateral * side;
        let on_seat = u * b.seat_end_cos + (radial - b.seat_centre_m) * b.seat_end_sin <= 0.0;
        let (fu, fr) = (u - b.flank_centre.x, radial - b.flank_centre.y);
        let past_flank = corner_x * fr - corner_y * fu < 0.0;
        let past_corner = b.corner.x * radial - b.corner.y * u < 0.0;
        // Nested choices, inner first: tip land, corner, flank, seat.
        let (cx, cy, bb) = if past_corner { (0.0, 0.0, tip_b) } else { (b.corner.x, b.corner.y, b.bush_radius_m) };
        let (cx, cy, bb) = if past_flank { (cx, cy, bb) } else { (b.flank_centre.x, b.flank_centre.y, flank_b) };
        let (cx, cy, bb) = if on_seat { (0.0, b.seat_centre_m, b.seat_gap_m) } else { (cx, cy, bb) };
        let sense = if on_seat { 1.0 } else { -1.0 };
        let (ex, ey) = (u - cx, radial - cy);
        let d2 = ex * ex + ey * ey;
        let distance = if d2 > 1e-24 { d2 } else { 1e-24 }.sqrt();
        let curvature = sense / distance;
        let (nu, nr) = (-(ex * curvature) * side, -(ey * curvature));
        lanes.curvature[i] = curvature;
        lanes.penetration[i] = sense * (distance - bb);
        // Lateral direction in the world is the gap axis turned by +90 degrees.
        lanes.normal_x[i] = nr * gx - nu * gy;
        lanes.normal_y[i] = nr * gy + nu * gx;
        lanes.body_radius[i] = if on_seat { -b.seat_radius_m } else { bb - b.bush_radius_m };
    }
    strayed == 0
}

/// What of its gap every lane faces, after [`penetrations`]: a [`Segment`] as a number.
#[inline(always)]
pub fn segments(body: &ToothedBody, turning: Turning, lanes: &Lanes) -> Column {
    let number = |s: Segment| f64::from(s as u32);
    let (seat, corner, land) = (number(Segment::Seat), number(Segment::TipCorner), number(Segment::TipLand));
    let (clockwise, counter) = (number(Segment::FlankClockwise), number(Segment::FlankCounterclockwise));
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        let gx = turning.cos * lanes.seat_cos[i] - turning.sin * lanes.seat_sin[i];
        let gy = turning.sin * lanes.seat_cos[i] + turning.cos * lanes.seat_sin[i];
        let lateral = (gx * lanes.y[i] - gy * lanes.x[i]) - lanes.seat_left[i];
        let radius = lanes.body_radius[i];
        let flank = if lateral < 0.0 { clockwise } else { counter };
        let tip = if radius == 0.0 { corner } else { land };
        let convex = if radius == body.flank_radius_m + body.bush_radius_m - body.bush_radius_m { flank } else { tip };
        out[i] = if radius < 0.0 { seat } else { convex };
    }
    out
}

/// Rates and effective masses of all lanes.
#[inline(always)]
fn rates(step: f64, omega: f64, lanes: &mut Lanes) {
    let half_step = 0.5 * step;
    for i in 0..LANES {
        let (nx, ny) = (lanes.normal_x[i], lanes.normal_y[i]);
        let (vx, vy) = (lanes.vx[i] + omega * lanes.y[i], lanes.vy[i] - omega * lanes.x[i]);
        let lever_n = lanes.lever[i] * (lanes.cos[i] * ny - lanes.sin[i] * nx);
        let w_n = lanes.inverse_mass[i] + lanes.inverse_inertia[i] * lever_n * lever_n;
        let own = w_n * lanes.normal_force[i];
        lanes.mobility[i] = w_n;
        lanes.free_rate[i] = half_step * own - (vx * nx + vy * ny);
        // The normal turns with the body, and with the joint round the centre of the element's curvature.
        let turned = omega * ((lanes.vy[i] + vy) * nx - (lanes.vx[i] + vx) * ny);
        let along = vy * nx - vx * ny;
        lanes.free_acceleration[i] =
            own - (lanes.ax[i] * nx + lanes.ay[i] * ny) - turned + lanes.curvature[i] * along * along;
    }
}

/// The end of a link at a node, and how it touches: one lane.
#[derive(Clone, Copy)]
struct EndLane {
    x: f64,
    y: f64,
    vx: f64,
    vy: f64,
    /// Acceleration of the joint in the step before [m/s2].
    ax: f64,
    ay: f64,
    cos: f64,
    sin: f64,
    /// Of the link.
    omega: f64,
    alpha: f64,
    lever: f64,
    inverse_mass: f64,
    inverse_inertia: f64,
    normal_x: f64,
    normal_y: f64,
    /// As in [`OffJoint`].
    radius: f64,
    offset: f64,
}

/// What the contact law is told of the motion along a normal.
#[derive(Clone, Copy)]
struct NormalMotion {
    mobility: f64,
    free_rate: f64,
    free_acceleration: f64,
}

/// What a contact gives to the link and takes from the body.
#[derive(Clone, Copy)]
struct Given {
    slide: f64,
    tangential_force: f64,
    lost_friction: f64,
    force_x: f64,
    force_y: f64,
    moment: f64,
    torque: f64,
}

impl EndLane {
    /// Along the normal, where the contact point may lie off the normal through the joint. `omega`: of the body.
    #[inline(always)]
    fn normal_motion(&self, step: f64, omega: f64, past_force: f64) -> NormalMotion {
        let e = self;
        let (nx, ny) = (e.normal_x, e.normal_y);
        let (vx, vy) = (e.vx + omega * e.y, e.vy - omega * e.x);
        let lever_n = e.lever * (e.cos * ny - e.sin * nx) - e.offset;
        let mobility = e.inverse_mass + e.inverse_inertia * lever_n * lever_n;
        let own = mobility * past_force;
        let turned = omega * ((e.vy + vy) * nx - (e.vx + vx) * ny);
        NormalMotion {
            mobility,
            free_rate: 0.5 * step * own - (vx * nx + vy * ny - (e.omega - omega) * e.offset),
            free_acceleration: own - (e.ax * nx + e.ay * ny - e.alpha * e.offset) - turned,
        }
    }

    /// Friction beside a normal force, and both about the joint and the body's origin.
    #[inline(always)]
    fn give(
        &self,
        (mu, stick_speed): (f64, f64),
        step: f64,
        omega: f64,
        normal_force: f64,
        past_friction: f64,
    ) -> Given {
        let e = self;
        let (nx, ny) = (e.normal_x, e.normal_y);
        let outward = e.x * nx + e.y * ny;
        let slide = e.vy * nx - e.vx * ny - e.omega * e.radius - omega * (outward - e.radius);
        let lever_t = e.lever * (e.cos * nx + e.sin * ny) - e.radius;
        let w_t = e.inverse_mass + e.inverse_inertia * lever_t * lever_t;
        let mobility = 0.5 * step * w_t;
        let free = slide - mobility * past_friction;
        let ft = friction::solved_force(mu, normal_force, free, stick_speed, mobility);
        let (fx, fy) = (normal_force * nx - ft * ny, normal_force * ny + ft * nx);
        let moment = -e.radius * ft - e.offset * normal_force;
        Given {
            slide,
            tangential_force: ft,
            lost_friction: -ft * (free + mobility * ft) * step,
            force_x: fx,
            force_y: fy,
            moment,
            torque: e.y * fx - e.x * fy - moment,
        }
    }
}

/// Ends of a block of links, and where they touch. Copies: behind references loops over them would not vectorise.
#[derive(Clone, Copy)]
pub struct EndColumns {
    /// Joints, in the world.
    pub x: Column,
    pub y: Column,
    pub vx: Column,
    pub vy: Column,
    /// Of the links, at their centres; accelerations one step back.
    pub omega: Column,
    pub ax: Column,
    pub ay: Column,
    pub alpha: Column,
    pub cos: Column,
    pub sin: Column,
    pub lever: Column,
    pub inverse_mass: Column,
    pub inverse_inertia: Column,
    /// How the joint lies from the link's centre: 1 ahead, -1 behind.
    pub sign: f64,
    /// The body's origin.
    pub origin: Vec2,
    /// Contact points from there; penetrations of [`super::arc_lanes::NOTHING_M`] touch nothing.
    pub penetration: Column,
    pub point_x: Column,
    pub point_y: Column,
    pub normal_x: Column,
    pub normal_y: Column,
}

impl EndColumns {
    #[inline(always)]
    fn lane(&self, i: usize) -> EndLane {
        let (x, y) = (self.x[i] - self.origin.x, self.y[i] - self.origin.y);
        let (cos, sin, alpha, lever) = (self.cos[i], self.sin[i], self.alpha[i], self.sign * self.lever[i]);
        let touches = self.penetration[i] != NOTHING_M;
        let (nx, ny) = (self.normal_x[i], self.normal_y[i]);
        let (dx, dy) = (self.point_x[i] - x, self.point_y[i] - y);
        EndLane {
            x,
            y,
            vx: self.vx[i],
            vy: self.vy[i],
            ax: self.ax[i] - alpha * lever * sin,
            ay: self.ay[i] + alpha * lever * cos,
            cos,
            sin,
            omega: self.omega[i],
            alpha,
            lever,
            inverse_mass: self.inverse_mass[i],
            inverse_inertia: self.inverse_inertia[i],
            normal_x: if touches { nx } else { 0.0 },
            normal_y: if touches { ny } else { 1.0 },
            radius: if touches { -(dx * nx + dy * ny) } else { 0.0 },
            offset: if touches { dx * -ny + dy * nx } else { 0.0 },
        }
    }

    /// Puts all of it into columns.
    #[inline(always)]
    pub fn load(&self, found: &Found, lanes: &mut Lanes, off: &mut OffJoint) {
        for i in 0..LANES {
            let e = self.lane(i);
            (lanes.x[i], lanes.y[i], lanes.vx[i], lanes.vy[i]) = (e.x, e.y, e.vx, e.vy);
            (lanes.ax[i], lanes.ay[i], lanes.cos[i], lanes.sin[i]) = (e.ax, e.ay, e.cos, e.sin);
            (lanes.omega[i], lanes.lever[i], off.alpha[i]) = (e.omega, e.lever, e.alpha);
            (lanes.inverse_mass[i], lanes.inverse_inertia[i]) = (e.inverse_mass, e.inverse_inertia);
            (lanes.normal_x[i], lanes.normal_y[i]) = (e.normal_x, e.normal_y);
            (off.radius[i], off.offset[i]) = (e.radius, e.offset);
            lanes.penetration[i] = self.penetration[i];
            let touches = self.penetration[i] != NOTHING_M;
            lanes.body_radius[i] = if touches { found.body_radius[i] } else { 0.0 };
            off.link_radius[i] = if touches { found.link_radius[i] } else { 0.0 };
        }
    }

    /// Whether any of the lanes of `own`, none of which has touched in the step before, may touch in this one: by its speed along the
    /// normal and the accelerations one step back. `turned_m`: how far the turning of normals may move it along one [m].
    #[inline(always)]
    pub fn may_touch(&self, step: f64, omega: f64, turned_m: f64, own: &Mask) -> bool {
        let mut may = [0; LANES];
        for i in 0..LANES {
            let e = self.lane(i);
            let (vx, vy) = (e.vx + omega * e.y, e.vy - omega * e.x);
            let closing = (e.omega - omega) * e.offset - (vx * e.normal_x + vy * e.normal_y);
            let closing = if closing > 0.0 { closing } else { 0.0 };
            let push = e.ax.abs() + e.ay.abs() + (e.alpha * e.offset).abs();
            let way_m = 1.01 * step * closing + 0.51 * step * step * push + turned_m;
            may[i] = own[i] & !mask(self.penetration[i] + way_m < 0.0);
        }
        any(&may)
    }
}

/// How far the turning of normals moves an end along one in a step, beyond what speeds say [m].
pub fn turned_m(step: f64, omega: f64, fastest_m_s: f64) -> f64 {
    4.0 * step * step * omega.abs() * fastest_m_s
}

/// What a contact of a block of ends remembers from step to step, in that order: normal and tangential force, age, approach speed.
pub type Remembered = [Column; 4];

/// A block of contacts after a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockStep {
    pub normal_force: Column,
    pub tangential_force: Column,
    pub age: Column,
    pub approach: Column,
    pub rate: Column,
    pub lost_damping: Column,
    pub lost_friction: Column,
    /// On the link at its centre, with the moment about it.
    pub force_x: Column,
    pub force_y: Column,
    pub moment: Column,
    pub torque: Column,
}

/// As [`contour_forces`] with the linear law, to the bit, in one loop that keeps its values in registers; None where a contact begins
/// or ends within the step, which takes the long way.
#[inline(always)]
pub fn plain_contour_step(
    (k, c): (f64, f64),
    friction: (f64, f64),
    (step, omega): (f64, f64),
    ends: EndColumns,
    past: Remembered,
) -> Option<BlockStep> {
    let mut out = BlockStep::default();
    let mut special = [0; LANES];
    for i in 0..LANES {
        let e = ends.lane(i);
        let (penetration, past_force) = (ends.penetration[i], past[0][i]);
        let motion = e.normal_motion(step, omega, past_force);
        let input = StepInput {
            penetration,
            free_rate: motion.free_rate,
            free_acceleration: motion.free_acceleration,
            mobility: motion.mobility,
            past_force,
            approach: past[3][i],
            step,
        };
        let (age, approach) = (past[2][i], past[3][i]);
        let (law, plain) = contact_law::plain_step(k, c, input, age > 0.0);
        special[i] = !mask(plain);
        let kept = remembered(penetration, motion.free_rate, law, step, (age, approach));
        let given = e.give(friction, step, omega, law.mean_force, past[1][i]);
        let arm = e.lever * (e.cos * given.force_y - e.sin * given.force_x);
        (out.normal_force[i], out.tangential_force[i]) = (law.mean_force, given.tangential_force);
        (out.age[i], out.approach[i], out.rate[i]) = (kept.age, kept.approach, law.rate);
        (out.lost_damping[i], out.lost_friction[i]) = (kept.lost, given.lost_friction);
        (out.force_x[i], out.force_y[i]) = (given.force_x, given.force_y);
        (out.moment[i], out.torque[i]) = (given.moment + arm, given.torque);
    }
    (!any(&special)).then_some(out)
}

/// Age and approach speed of a contact after a step, and what it lost.
#[derive(Clone, Copy)]
struct Kept {
    age: f64,
    approach: f64,
    lost: f64,
}

#[inline(always)]
fn remembered(
    penetration: f64,
    free_rate: f64,
    law: contact_law::StepForce,
    step: f64,
    (age, approach): (f64, f64),
) -> Kept {
    // What has just parted belongs to its contact as long as it gives force.
    let then = penetration + step * free_rate;
    let near = if penetration > then { penetration } else { then };
    let touching = if near > law.mean_force { near } else { law.mean_force };
    // A contact that is slowed down before it touches comes with the speed that it has now.
    let free = if free_rate > 0.0 { free_rate } else { 0.0 };
    let touch = if law.touch_rate > 0.0 { law.touch_rate } else { free };
    let first = if age == 0.0 { touch } else { approach };
    Kept {
        age: if touching > 0.0 { age + 1.0 } else { 0.0 },
        approach: if touching > 0.0 { first } else { 0.0 },
        lost: if law.mean_force > 0.0 { law.lost } else { 0.0 },
    }
}

/// Forces of all lanes, after [`penetrations`]. `omega`: of the body about the origin of the lanes' coordinates.
#[inline(always)]
pub fn forces(law: &ContactLaw, mu: f64, stick_speed: f64, radius: f64, step: f64, omega: f64, lanes: &mut Lanes) {
    rates(step, omega, lanes);
    normal_forces(law, &[radius; LANES], step, lanes);
    let half = 0.5 * step;
    for i in 0..LANES {
        let (nx, ny) = (lanes.normal_x[i], lanes.normal_y[i]);
        let (vx, vy) = (lanes.vx[i], lanes.vy[i]);
        let outward = lanes.x[i] * nx + lanes.y[i] * ny;
        let slide = vy * nx - vx * ny - lanes.omega[i] * radius - omega * (outward - radius);
        lanes.slide[i] = slide;
        let lever_t = lanes.lever[i] * (lanes.cos[i] * nx + lanes.sin[i] * ny) - radius;
        let w_t = lanes.inverse_mass[i] + lanes.inverse_inertia[i] * lever_t * lever_t;
        let mobility = half * w_t;
        let free = slide - mobility * lanes.tangential_force[i];
        let fn_ = lanes.normal_force[i];
        let ft = friction::solved_force(mu, fn_, free, stick_speed, mobility);
        lanes.tangential_force[i] = ft;
        lanes.lost_friction[i] = -ft * (free + mobility * ft) * step;
        let fx = fn_ * nx - ft * ny;
        let fy = fn_ * ny + ft * nx;
        lanes.force_x[i] = fx;
        lanes.force_y[i] = fy;
        let moment = -radius * ft;
        lanes.moment[i] = moment;
        lanes.torque[i] = lanes.y[i] * fx - lanes.x[i] * fy - moment;
    }
}

/// As [`forces`], for contours with their own radius and offset in every lane.
#[inline(always)]
pub fn contour_forces(
    law: &ContactLaw,
    friction: (f64, f64),
    (step, omega): (f64, f64),
    off: &OffJoint,
    lanes: &mut Lanes,
) {
    for i in 0..LANES {
        let motion = lanes.end(off, i).normal_motion(step, omega, lanes.normal_force[i]);
        lanes.mobility[i] = motion.mobility;
        (lanes.free_rate[i], lanes.free_acceleration[i]) = (motion.free_rate, motion.free_acceleration);
    }
    normal_forces(law, &off.link_radius, step, lanes);
    for i in 0..LANES {
        let given = lanes.end(off, i).give(friction, step, omega, lanes.normal_force[i], lanes.tangential_force[i]);
        (lanes.slide[i], lanes.tangential_force[i]) = (given.slide, given.tangential_force);
        lanes.lost_friction[i] = given.lost_friction;
        (lanes.force_x[i], lanes.force_y[i]) = (given.force_x, given.force_y);
        (lanes.moment[i], lanes.torque[i]) = (given.moment, given.torque);
    }
}

impl Lanes {
    #[inline(always)]
    fn end(&self, off: &OffJoint, i: usize) -> EndLane {
        EndLane {
            x: self.x[i],
            y: self.y[i],
            vx: self.vx[i],
            vy: self.vy[i],
            ax: self.ax[i],
            ay: self.ay[i],
            cos: self.cos[i],
            sin: self.sin[i],
            omega: self.omega[i],
            alpha: off.alpha[i],
            lever: self.lever[i],
            inverse_mass: self.inverse_mass[i],
            inverse_inertia: self.inverse_inertia[i],
            normal_x: self.normal_x[i],
            normal_y: self.normal_y[i],
            radius: off.radius[i],
            offset: off.offset[i],
        }
    }
}

/// Normal forces, and what contacts remember of themselves.
#[inline(always)]
fn normal_forces(law: &ContactLaw, link_radius: &Column, step: f64, lanes: &mut Lanes) {
    // The old mean normal force has done its work: from here the column holds the new one.
    if let ContactLaw::Linear { stiffness_n_per_m, damping_n_s_per_m } = *law {
        let (k, c) = (stiffness_n_per_m, damping_n_s_per_m);
        let [mut force, mut rate, mut touch_rate, mut lost] = [[0.0; LANES]; 4];
        let mut special = 0_u64;
        for i in 0..LANES {
            let (out, plain) = contact_law::plain_step(k, c, step_input(lanes, i, step), lanes.age[i] > 0.0);
            (force[i], rate[i], lost[i]) = (out.mean_force, out.rate, out.lost);
            special |= u64::from(!plain);
        }
        if special != 0 {
            for i in 0..LANES {
                let out = contact_law::linear_step(k, c, step_input(lanes, i, step), lanes.age[i] > 0.0);
                (force[i], rate[i], touch_rate[i], lost[i]) = (out.mean_force, out.rate, out.touch_rate, out.lost);
            }
        }
        let (mut age, mut approach) = (lanes.age, lanes.approach);
        for i in 0..LANES {
            let law = contact_law::StepForce {
                mean_force: force[i],
                rate: rate[i],
                touch_rate: touch_rate[i],
                lost: lost[i],
            };
            let kept = remembered(lanes.penetration[i], lanes.free_rate[i], law, step, (age[i], approach[i]));
            (age[i], approach[i], lost[i]) = (kept.age, kept.approach, kept.lost);
        }
        (lanes.age, lanes.approach, lanes.lost_damping) = (age, approach, lost);
        (lanes.normal_force, lanes.rate) = (force, rate);
    } else {
        quadrature(law, link_radius, step, lanes);
    }
}

/// Normal forces of the laws that have no closed form, lane by lane.
#[inline(never)]
fn quadrature(law: &ContactLaw, link_radius: &Column, step: f64, lanes: &mut Lanes) {
    for i in 0..LANES {
        let touching = lanes.penetration[i] > 0.0 || lanes.penetration[i] + step * lanes.free_rate[i] > 0.0;
        let approach = if lanes.age[i] == 0.0 { lanes.free_rate[i] } else { lanes.approach[i] };
        lanes.approach[i] = if touching { approach } else { 0.0 };
        lanes.age[i] = if touching { lanes.age[i] + 1.0 } else { 0.0 };
        let radii = PairRadii { bush_m: link_radius[i], body_m: lanes.body_radius[i] };
        let out = (lanes.age[i] != 0.0).then(|| contact_law::quadrature_step(law, radii, step_input(lanes, i, step)));
        lanes.normal_force[i] = out.map_or(0.0, |o| o.mean_force);
        lanes.rate[i] = out.map_or(lanes.free_rate[i], |o| o.rate);
        lanes.lost_damping[i] = out.map_or(0.0, |o| o.lost);
    }
}

#[inline(always)]
fn step_input(lanes: &Lanes, i: usize, step: f64) -> StepInput {
    StepInput {
        penetration: lanes.penetration[i],
        free_rate: lanes.free_rate[i],
        free_acceleration: lanes.free_acceleration[i],
        mobility: lanes.mobility[i],
        past_force: lanes.normal_force[i],
        approach: lanes.approach[i],
        step,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of random ends that touch a body at random places, and the speed of the fastest of their points.
    struct Scene {
        columns: [Column; 13],
        found: Found,
        past: [Column; 4],
        own: Mask,
        omega: f64,
        step: f64,
        fastest_m_s: f64,
    }

    impl Scene {
        fn random(random: &mut impl FnMut(f64, f64) -> f64) -> Scene {
            let (step, omega, lever) = (random(1e-7, 1e-5), random(-700.0, 700.0), random(-10e-3, 10e-3));
            let (sin, cos) = sin_cos(random(-4.0, 4.0));
            let speed = 40.0 * random(0.0, 1.0).powi(6);
            let mut columns = [[0.0; LANES]; 13];
            let (mut found, mut fastest_m_s) = (Found::nothing(), 0.0_f64);
            for i in 0..LANES {
                let (x, y) = (random(-0.05, 0.05), random(-0.05, 0.05));
                let (vx, vy) = (random(-speed, speed) - omega * y, random(-speed, speed) + omega * x);
                let turning = omega + random(-speed, speed) / 5e-3;
                let accelerations = [random(-1e5, 1e5), random(-1e5, 1e5), random(-1e7, 1e7)];
                let inverse = [random(50.0, 200.0), random(1e6, 1e7)];
                let [ax, ay, alpha] = accelerations;
                let values = [x, y, vx, vy, turning, ax, ay, alpha, cos, sin, lever, inverse[0], inverse[1]];
                for (column, value) in columns.iter_mut().zip(values) {
                    column[i] = value;
                }
                let (ny, nx) = sin_cos(random(-4.0, 4.0));
                let (radius, offset) = (random(0.0, 5e-3), random(-5e-3, 5e-3));
                (found.normal_x[i], found.normal_y[i]) = (nx, ny);
                (found.point_x[i], found.point_y[i]) = (x - radius * nx - offset * ny, y - radius * ny + offset * nx);
                found.penetration[i] = -random(0.0, 1.0).powi(3) * 1e-4;
                fastest_m_s = fastest_m_s.max(vx.hypot(vy)).max(omega.abs() * x.hypot(y));
            }
            Scene { columns, found, past: [[0.0; LANES]; 4], own: [!0; LANES], omega, step, fastest_m_s }
        }

        fn ends(&self) -> EndColumns {
            let [x, y, vx, vy, omega, ax, ay, alpha, cos, sin, lever, inverse_mass, inverse_inertia] = self.columns;
            let Found { penetration, point_x, point_y, normal_x, normal_y, .. } = self.found;
            let (sign, origin) = (1.0, Vec2::zeros());
            EndColumns {
                x,
                y,
                vx,
                vy,
                omega,
                ax,
                ay,
                alpha,
                cos,
                sin,
                lever,
                inverse_mass,
                inverse_inertia,
                sign,
                origin,
                penetration,
                point_x,
                point_y,
                normal_x,
                normal_y,
            }
        }

        /// The long way.
        fn forces(&self, law: &ContactLaw, friction: (f64, f64)) -> Lanes {
            let (mut lanes, mut off) = (Lanes::default(), OffJoint::default());
            self.ends().load(&self.found, &mut lanes, &mut off);
            [lanes.normal_force, lanes.tangential_force, lanes.age, lanes.approach] = self.past;
            contour_forces(law, friction, (self.step, self.omega), &off, &mut lanes);
            lanes
        }
    }

    fn generator() -> impl FnMut(f64, f64) -> f64 {
        let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
        move |low, high| {
            seed ^= seed >> 12;
            seed ^= seed << 25;
            seed ^= seed >> 27;
            low + (high - low) * (seed.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
        }
    }

    /// What is left out would have had no force and no memory; and much is left out.
    #[test]
    fn what_may_not_touch_has_no_force() {
        let mut random = generator();
        let (mut left_out, mut touched) = (0, 0);
        for _ in 0..200_000 {
            let scene = Scene::random(&mut random);
            let (stiffness_n_per_m, damping_n_s_per_m) = (random(1e7, 2e8), random(0.0, 600.0));
            let law = ContactLaw::Linear { stiffness_n_per_m, damping_n_s_per_m };
            let turned_m = turned_m(scene.step, scene.omega, scene.fastest_m_s);
            let may = scene.ends().may_touch(scene.step, scene.omega, turned_m, &scene.own);
            let lanes = scene.forces(&law, (0.1, 1e-3));
            let touches = lanes.age.iter().chain(&lanes.normal_force).any(|v| *v != 0.0);
            assert!(may || !touches, "{lanes:?}");
            left_out += u64::from(!may);
            touched += u64::from(touches);
        }
        println!("{left_out} of 200000 blocks left out, {touched} touched");
        assert!(left_out > 10_000 && touched > 10_000);
    }

    /// The short way gives the bits of the long one, or nothing.
    #[test]
    fn one_loop_gives_the_bits_of_many() {
        let mut random = generator();
        let mut compared = 0;
        for _ in 0..100_000 {
            let mut scene = Scene::random(&mut random);
            let closed = random(0.0, 1.0) < 0.5;
            for i in 0..LANES {
                scene.found.penetration[i] = if closed { random(1e-6, 1e-4) } else { -random(0.0, 1e-3) };
                let held = if closed { 1.0 } else { 0.0 };
                let past = [random(0.0, 1e3), random(-1e2, 1e2), random(1.0, 9.0), random(0.0, 5.0)];
                for (column, value) in scene.past.iter_mut().zip(past) {
                    column[i] = held * value;
                }
            }
            let (k, c, friction) = (random(1e7, 2e8), random(0.0, 600.0), (0.1, 1e-3));
            let law = ContactLaw::Linear { stiffness_n_per_m: k, damping_n_s_per_m: c };
            let motion = (scene.step, scene.omega);
            let Some(short) = plain_contour_step((k, c), friction, motion, scene.ends(), scene.past) else { continue };
            let long = scene.forces(&law, friction);
            let mut arms = long.moment;
            for i in 0..LANES {
                arms[i] += long.lever[i] * (long.cos[i] * long.force_y[i] - long.sin[i] * long.force_x[i]);
            }
            let expected = BlockStep {
                normal_force: long.normal_force,
                tangential_force: long.tangential_force,
                age: long.age,
                approach: long.approach,
                rate: long.rate,
                lost_damping: long.lost_damping,
                lost_friction: long.lost_friction,
                force_x: long.force_x,
                force_y: long.force_y,
                moment: arms,
                torque: long.torque,
            };
            assert_eq!(short, expected);
            compared += 1;
        }
        println!("{compared} blocks of 100000 took the short way");
        assert!(compared > 10_000);
    }
}
