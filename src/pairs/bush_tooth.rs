//! Bushes against the teeth of a sprocket, many at a time.
//!
//! A bush (circle of radius r) is folded into its tooth gap: gap axis g in the world, q = (|lateral|, radial) from the
//! sprocket axis. There it faces one of four circles, seat (concave), flank, tip corner (radius 0) or tip land:
//! penetration = +-(|q - c| - b), normal = -+(q - c)/|q - c|. Which one follows from three cross products; the rules are those
//! of `bush_gap::gap_contact`, and a test holds the two together. Normal force after [`contact_law`], friction after
//! [`friction`], both as means over the step. The force acts at the deepest point of the bush, on link and sprocket alike:
//! the pair of forces is without moment.
//!
//! Rates: closing speed v_n = -v_rel . n; tangent t = n turned by +90 degrees; inverse effective masses of the link's end
//! w_n = 1/m + (l d x n)^2 / J, w_t = 1/m + (l d . n - r)^2 / J, with d the heading and l the signed lever of the joint.

use crate::elements::body_frame::{BodyMobility, FrameMotion};
use crate::elements::contact_law::{self, ClosedForm, ContactLaw, PairRadii, StepInput};
use crate::elements::friction;
use crate::geometry::Vec2;
use crate::geometry::sprocket::Sprocket;
use crate::lanes::{LANES, LaneBlock};
use crate::recording::frame::Segment;
use crate::units::sin_cos;

/// A sprocket as the contact sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct ToothedBody {
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
    pub fn without_seats(law: ContactLaw, friction: f64, stick_speed_m_s: f64) -> Self {
        ToothedBody {
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

    pub fn new(s: &Sprocket, bush_radius_m: f64, law: ContactLaw, friction: f64, stick_speed_m_s: f64) -> Self {
        let (seat_end_sin, seat_end_cos) = sin_cos(0.5 * s.seat_angle_rad);
        let (sin_half, cos_half) = sin_cos(0.5 * s.pitch_angle_rad());
        let (seat_sin, seat_cos) = (0..s.spec.teeth).map(|k| sin_cos(f64::from(k) * s.pitch_angle_rad())).unzip();
        ToothedBody {
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
pub struct SprocketMotion {
    pub cos: f64,
    pub sin: f64,
    pub omega: f64,
}

/// Columns of [`LANES`] contact lanes. Inputs are filled by the caller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lanes {
    /// Joint centre from the sprocket axis [m], its velocity, and that of the link [m/s, rad/s].
    pub x: LaneBlock,
    pub y: LaneBlock,
    pub vx: LaneBlock,
    pub vy: LaneBlock,
    pub omega: LaneBlock,
    /// Acceleration of the joint centre one step back [m/s2].
    pub ax: LaneBlock,
    pub ay: LaneBlock,
    /// Heading of the link and signed lever of the joint.
    pub cos: LaneBlock,
    pub sin: LaneBlock,
    pub lever: LaneBlock,
    pub inverse_mass: LaneBlock,
    pub inverse_inertia: LaneBlock,
    /// Direction of the gap axis in the sprocket's frame.
    pub seat_cos: LaneBlock,
    pub seat_sin: LaneBlock,
    /// How far that gap lies beside its place: outwards, counterclockwise [m].
    pub seat_out: LaneBlock,
    pub seat_left: LaneBlock,
    /// Memory of the contact: mean forces of the last step, age, approach speed.
    pub normal_force: LaneBlock,
    pub tangential_force: LaneBlock,
    pub age: LaneBlock,
    pub approach: LaneBlock,
    /// Results.
    pub penetration: LaneBlock,
    pub normal_x: LaneBlock,
    pub normal_y: LaneBlock,
    pub free_rate: LaneBlock,
    pub free_acceleration: LaneBlock,
    pub mobility: LaneBlock,
    pub body_radius: LaneBlock,
    /// Of the joint's path while it slides along the element: inverse distance from the centre, positive on concave ones [1/m].
    pub curvature: LaneBlock,
    /// Closing speed at the node; sliding speed that friction works with, which its own force has changed already.
    pub rate: LaneBlock,
    pub slide: LaneBlock,
    pub lost_damping: LaneBlock,
    pub lost_friction: LaneBlock,
    /// Force on the link [N], moment about the joint centre [N m], torque on the sprocket [N m].
    pub force_x: LaneBlock,
    pub force_y: LaneBlock,
    pub moment: LaneBlock,
    pub torque: LaneBlock,
}

impl Lanes {
    /// Takes the motion of a body's origin off the velocities and accelerations.
    #[inline(always)]
    pub fn take_off(&mut self, body: &FrameMotion) {
        for i in 0..LANES {
            self.vx[i] -= body.velocity.x;
            self.vy[i] -= body.velocity.y;
            self.ax[i] -= body.acceleration.x;
            self.ay[i] -= body.acceleration.y;
        }
    }

    /// No contact in any lane.
    #[inline(always)]
    pub fn release(&mut self) {
        let zero = [0.0; LANES];
        (self.normal_force, self.tangential_force, self.age, self.approach) = (zero, zero, zero, zero);
        (self.lost_damping, self.lost_friction) = (zero, zero);
        (self.force_x, self.force_y, self.moment, self.torque) = (zero, zero, zero, zero);
    }
}

/// Whether any of these points is inside the circle of radius `reach_m` about `centre`.
#[inline(always)]
pub fn any_inside(centre: Vec2, reach_m: f64, x: &LaneBlock, y: &LaneBlock) -> bool {
    let reach2 = reach_m * reach_m;
    let mut inside = 0_u64;
    for i in 0..LANES {
        let (dx, dy) = (x[i] - centre.x, y[i] - centre.y);
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
pub fn penetrations(body: &ToothedBody, turning: SprocketMotion, lanes: &mut Lanes) -> bool {
    let b = body;
    let (tip_b, flank_b) = (b.tip_radius_m + b.bush_radius_m, b.flank_radius_m + b.bush_radius_m);
    let (corner_x, corner_y) = (b.corner.x - b.flank_centre.x, b.corner.y - b.flank_centre.y);
    let mut outdated = 0_u64;
    for i in 0..LANES {
        let gx = turning.cos * lanes.seat_cos[i] - turning.sin * lanes.seat_sin[i];
        let gy = turning.sin * lanes.seat_cos[i] + turning.cos * lanes.seat_sin[i];
        let along = lanes.x[i] * gx + lanes.y[i] * gy;
        let across = gx * lanes.y[i] - gy * lanes.x[i];
        outdated |= u64::from(across.abs() > b.half_gap_tan * along);
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
    outdated == 0
}

/// What of its gap every lane faces, after [`penetrations`]: a [`Segment`] as a number.
#[inline(always)]
pub fn segments(body: &ToothedBody, turning: SprocketMotion, lanes: &Lanes) -> LaneBlock {
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

/// How a body gives way to its contacts: what is not there is compiled apart, and costs nothing.
const STANDS: u8 = 0;
const TURNS: u8 = 1;
const TURNS_AND_SHIFTS: u8 = 2;

/// Rates and effective masses of all lanes. YIELDS: how the body gives way.
#[inline(always)]
fn rates<const YIELDS: u8>(step: f64, (omega, mobility): (f64, BodyMobility), lanes: &mut Lanes) {
    let half_step = 0.5 * step;
    for i in 0..LANES {
        let (nx, ny) = (lanes.normal_x[i], lanes.normal_y[i]);
        let (vx, vy) = (lanes.vx[i] + omega * lanes.y[i], lanes.vy[i] - omega * lanes.x[i]);
        let lever_n = lanes.lever[i] * (lanes.cos[i] * ny - lanes.sin[i] * nx);
        let mut w_n = lanes.inverse_mass[i] + lanes.inverse_inertia[i] * lever_n * lever_n;
        if YIELDS >= TURNS {
            let arm = lanes.x[i] * ny - lanes.y[i] * nx;
            w_n += mobility.inverse_inertia * arm * arm;
        }
        if YIELDS == TURNS_AND_SHIFTS {
            w_n += mobility.along(nx, ny);
        }
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

/// Rates and effective masses of contacts in seats that do not turn, whose motion has been taken off.
#[inline(always)]
pub(super) fn rates_of_seat(step: f64, lanes: &mut Lanes) {
    rates::<STANDS>(step, (0.0, BodyMobility::default()), lanes);
}

/// Age and approach speed of a contact after a step, and what it lost.
#[derive(Clone, Copy)]
pub(crate) struct ContactUpdate {
    pub(crate) age: f64,
    pub(crate) approach: f64,
    pub(crate) lost: f64,
}

/// Age up to which a touch may only have been foreseen [steps]. measured: with 2, touches of the abutment chain's guide keep a wrong speed.
const FORESEEN_STEPS: f64 = 8.0;

#[inline(always)]
pub(crate) fn contact_update(
    penetration: f64,
    free_rate: f64,
    law: contact_law::StepForce,
    step: f64,
    (age, approach): (f64, f64),
) -> ContactUpdate {
    // What has just parted belongs to its contact as long as it gives force.
    let then = penetration + step * free_rate;
    let near = if penetration > then { penetration } else { then };
    let touching = if near > law.mean_force { near } else { law.mean_force };
    // A contact that is slowed down before it touches comes with the speed that it has now.
    let free = if free_rate > 0.0 { free_rate } else { 0.0 };
    let touch = if law.touch_rate > 0.0 { law.touch_rate } else { free };
    // Once a touch lies behind, its speed follows from the gaps at both nodes about it. Ahead of it, the forces that change within the
    // step are missing, and a slow touch is found up to a half too slow or too fast. Slow touches are foreseen some steps before; what
    // touches again later is not the first.
    let behind = (penetration > 0.0) & (law.touch_rate > 0.0) & (age <= FORESEEN_STEPS);
    let first = if (age == 0.0) | behind { touch } else { approach };
    ContactUpdate {
        age: if touching > 0.0 { age + 1.0 } else { 0.0 },
        approach: if touching > 0.0 { first } else { 0.0 },
        lost: if law.mean_force > 0.0 { law.lost } else { 0.0 },
    }
}

/// Forces of all lanes, after [`penetrations`]. `omega`: of the body about the origin of the lanes' coordinates.
#[inline(always)]
pub fn forces(law: &ContactLaw, mu: f64, stick_speed: f64, radius: f64, step: f64, omega: f64, lanes: &mut Lanes) {
    let friction = FrictionInput { mu, stick_speed, radius };
    forces_of::<STANDS>(law, friction, &[radius; LANES], step, (omega, BodyMobility::default()), lanes);
}

/// As [`forces`], of a body that turns with this speed about the origin of the lanes' coordinates and gives way, on parts of links with
/// these radii of curvature.
#[inline(always)]
pub fn forces_on_body(
    law: &ContactLaw,
    friction: FrictionInput,
    link_radius: &LaneBlock,
    step: f64,
    body: (f64, BodyMobility),
    lanes: &mut Lanes,
) {
    if body.1.inverse_mass == [0.0; 3] {
        forces_of::<TURNS>(law, friction, link_radius, step, body, lanes);
    } else {
        forces_of::<TURNS_AND_SHIFTS>(law, friction, link_radius, step, body, lanes);
    }
}

/// What friction works with: its coefficient, its stick speed [m/s], and how far the surface lies from the joint's axis [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionInput {
    pub mu: f64,
    pub stick_speed: f64,
    pub radius: f64,
}

#[inline(always)]
fn forces_of<const YIELDS: u8>(
    law: &ContactLaw,
    FrictionInput { mu, stick_speed, radius }: FrictionInput,
    link_radius: &LaneBlock,
    step: f64,
    (omega, body): (f64, BodyMobility),
    lanes: &mut Lanes,
) {
    rates::<YIELDS>(step, (omega, body), lanes);
    normal_forces(law, link_radius, step, lanes);
    let half = 0.5 * step;
    for i in 0..LANES {
        let (nx, ny) = (lanes.normal_x[i], lanes.normal_y[i]);
        let (vx, vy) = (lanes.vx[i], lanes.vy[i]);
        let outward = lanes.x[i] * nx + lanes.y[i] * ny;
        let slide = vy * nx - vx * ny - lanes.omega[i] * radius - omega * (outward - radius);
        let lever_t = lanes.lever[i] * (lanes.cos[i] * nx + lanes.sin[i] * ny) - radius;
        let mut w_t = lanes.inverse_mass[i] + lanes.inverse_inertia[i] * lever_t * lever_t;
        if YIELDS >= TURNS {
            w_t += body.inverse_inertia * (outward - radius) * (outward - radius);
        }
        if YIELDS == TURNS_AND_SHIFTS {
            w_t += body.along(-ny, nx);
        }
        let mobility = half * w_t;
        let free = slide - mobility * lanes.tangential_force[i];
        let fn_ = lanes.normal_force[i];
        let ft = friction::solved_force(mu, fn_, free, stick_speed, mobility);
        let slid = free + mobility * ft;
        lanes.slide[i] = slid;
        lanes.tangential_force[i] = ft;
        lanes.lost_friction[i] = -ft * slid * step;
        let fx = fn_ * nx - ft * ny;
        let fy = fn_ * ny + ft * nx;
        lanes.force_x[i] = fx;
        lanes.force_y[i] = fy;
        let moment = -radius * ft;
        lanes.moment[i] = moment;
        lanes.torque[i] = lanes.y[i] * fx - lanes.x[i] * fy - moment;
    }
}

/// Normal forces, and what contacts remember of themselves.
#[inline(always)]
pub(super) fn normal_forces(law: &ContactLaw, link_radius: &LaneBlock, step: f64, lanes: &mut Lanes) {
    match law.closed_form() {
        Some(ClosedForm::Constant(k, c)) => closed_form_forces::<false>((k, c), step, lanes),
        Some(ClosedForm::Growing(k, c)) => closed_form_forces::<true>((k, c), step, lanes),
        None => quadrature(law, link_radius, step, lanes),
    }
}

/// Normal forces of the laws that have a closed form.
#[inline(always)]
fn closed_form_forces<const GROWS: bool>((k, c): (f64, f64), step: f64, lanes: &mut Lanes) {
    let [mut force, mut rate, mut touch_rate, mut lost] = [[0.0; LANES]; 4];
    let mut special = 0_u64;
    for i in 0..LANES {
        let (out, plain) = contact_law::fast_step::<GROWS>(k, c, step_input(lanes, i, step), lanes.age[i] > 0.0);
        (force[i], rate[i], lost[i]) = (out.mean_force, out.rate, out.lost);
        special |= u64::from(!plain);
    }
    if special != 0 {
        for i in 0..LANES {
            let input = step_input(lanes, i, step);
            let out = contact_law::closed_form_step::<GROWS>(k, c, input, lanes.age[i] > 0.0);
            (force[i], rate[i], touch_rate[i], lost[i]) = (out.mean_force, out.rate, out.touch_rate, out.lost);
        }
    }
    let (mut age, mut approach) = (lanes.age, lanes.approach);
    for i in 0..LANES {
        let law =
            contact_law::StepForce { mean_force: force[i], rate: rate[i], touch_rate: touch_rate[i], lost: lost[i] };
        let kept = contact_update(lanes.penetration[i], lanes.free_rate[i], law, step, (age[i], approach[i]));
        (age[i], approach[i], lost[i]) = (kept.age, kept.approach, kept.lost);
    }
    (lanes.age, lanes.approach, lanes.lost_damping) = (age, approach, lost);
    // The old mean normal force has done its work: from here the column holds the new one.
    (lanes.normal_force, lanes.rate) = (force, rate);
}

/// Normal forces of the laws that have no closed form, lane by lane.
#[inline(never)]
fn quadrature(law: &ContactLaw, link_radius: &LaneBlock, step: f64, lanes: &mut Lanes) {
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
