//! Explains the state of a link at one instant: its free body, the history of its contacts, and the origin of an
//! approach speed.
//!
//! The instant is simulated again from the keyframe before it. Forces are those that the step uses (for contacts, means
//! over the step), so that their sum equals mass times the change of velocity over the step, except for rounding; the
//! remainder is printed. The moment is taken about the centre of mass.
//!
//! The closing speed of a bush at the node of its first contact, with n the outward normal of the tooth, is split
//! without remainder; the speed gained from that node to the contact is listed separately. Let a be the joint ahead of
//! the bush (already on the sprocket) and r the vector from a to the bush along the link between them, which turns at
//! w; the sprocket turns at W about its axis c:
//! ```text
//! v_close = - n . (v_bush - W x (p - c))
//!         = - n . (-W x r)                        articulation: a straight span onto a turning sprocket, p W sin(...)
//!           - n . (w x r)                         the arriving link turns already: the span moves sideways
//!           - n . (v_a - W x (a - c))             the joint ahead moves on the sprocket: it rocks in its seat or is pulled
//!           - n . (rest)                          the joint between link and bush stretches: a step in tension
//! ```
//! Flanks, abutments and plate ends are parts of their link: the joint ahead is its own front joint, r goes from there
//! to the contact point, and there is no rest term. Guides are at rest (W = 0).

use crate::drive::Scheme;
use crate::elements::contact_law::{ContactLaw, PeakMeter};
use crate::geometry::{Vec2, cross, perp};
use crate::impacts::{ImpactWatch, WATCHED_PERIODS};
use crate::integrate::explicit::{self, ContactGroup, Scratch};
use crate::integrate::scheme;
use crate::model::Model;
use crate::pairs::plate_rail::PlatePart;
use crate::recording::frame::{Feature, Segment};
use crate::replay::Replay;
use crate::state::State;
use anyhow::{Context, ensure};

/// One force on the link.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Force {
    /// `joint`, `pin friction`, `roller`, `contact normal`, `contact friction`.
    pub kind: &'static str,
    /// Source of the force, in words.
    pub cause: String,
    /// Point of action [m].
    pub x_m: f64,
    pub y_m: f64,
    pub fx_n: f64,
    pub fy_n: f64,
    /// About the centre of mass; of pin friction, the torque of the joint [N m].
    pub moment_nm: f64,
}

/// A contact of the link.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Contact {
    pub feature: &'static str,
    /// Number of the joint that a bush or roller sits at; None for other parts.
    pub joint: Option<usize>,
    pub body: String,
    pub tooth: Option<u32>,
    pub segment: &'static str,
    pub penetration_m: f64,
    pub normal_force_n: f64,
    pub tangential_force_n: f64,
    pub age_s: f64,
    pub approach_speed_m_s: f64,
    /// False: it was in contact before the keyframe from which the simulation was repeated.
    pub history_is_whole: bool,
    /// Peak of its impact, as `pitchline impacts` has it: the largest force within two tooth periods of its first contact,
    /// between nodes as well as at them; and the node at or before which it was [N, s].
    pub peak_force_n: f64,
    pub peak_t_s: f64,
    /// Since first contact: time [s], normal force [N], penetration [m].
    pub history: Vec<[f64; 3]>,
    pub approach: Option<Approach>,
}

/// Contributions to the closing speed at first contact [m/s].
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Approach {
    pub t_s: f64,
    /// Sum of the parts, with the velocities of that node.
    pub closing_speed_m_s: f64,
    pub parts: Vec<ApproachPart>,
    /// Tension of the link at that time, and its mean over the tooth period before [N].
    pub tension_n: f64,
    pub tension_before_n: f64,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ApproachPart {
    pub cause: &'static str,
    pub speed_m_s: f64,
}

/// All data of one link at one instant.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FreeBody {
    pub link: usize,
    pub step: u64,
    pub t_s: f64,
    pub mass_kg: f64,
    pub inertia_kg_m2: f64,
    pub x_m: f64,
    pub y_m: f64,
    pub angle_rad: f64,
    pub forces: Vec<Force>,
    pub sum_x_n: f64,
    pub sum_y_n: f64,
    pub sum_moment_nm: f64,
    /// Change of velocity over the step, divided by the step.
    pub acceleration_x_m_s2: f64,
    pub acceleration_y_m_s2: f64,
    pub angular_acceleration_rad_s2: f64,
    /// |sum of forces - m a|, and its ratio to the largest force.
    pub remainder_n: f64,
    pub remainder_share: f64,
    /// The same for moments, relative to the largest moment, or to the largest force times the lever of a joint.
    pub remainder_moment_share: f64,
    pub contacts: Vec<Contact>,
}

/// Longest stored history of a contact [values].
const LONGEST_HISTORY: usize = 400;

/// Contact partner of a part of a link at a node, also if a small gap remains.
struct TouchRow {
    body: usize,
    tooth: u32,
    segment: Segment,
    normal: Vec2,
    /// On the link [m].
    point: Vec2,
}

/// A contact lane of the link, and its recorded history.
struct Lane {
    part: ContactGroup,
    lane: usize,
    feature: Feature,
    history: Vec<[f64; 3]>,
    meter: PeakMeter,
    peak_force_n: f64,
    peak_t_s: f64,
    began: bool,
    approach: Option<Approach>,
}

/// The free body of `link` at `step`.
pub fn explain(replay: &mut Replay, link: usize, step: u64) -> anyhow::Result<FreeBody> {
    let model = replay.model.clone();
    ensure!(link < model.chain.n_links, "there is no link {link}");
    let link = model.chain.lane_of(link);
    let mut lanes = lanes_of(&model, link);
    let mut tensions: Vec<f64> = Vec::new();
    let visit = replay.visit(step, |state, scratch| watch(&model, state, scratch, link, &mut lanes, &mut tensions))?;
    let (mut state, mut scratch) = (visit.state, visit.scratch);
    scheme::evaluate(&model, &state, &mut scratch)?;
    watch(&model, &state, &scratch, link, &mut lanes, &mut tensions);
    let mut body = free_body(&model, &state, &scratch, link, lanes)?;
    let rate = if let Scheme::Leapfrog | Scheme::Moreau { .. } = model.scheme {
        let before = [state.links.vx[link], state.links.vy[link], state.links.omega[link]];
        scheme::advance(&model, &mut state, &mut scratch);
        let after = [state.links.vx[link], state.links.vy[link], state.links.omega[link]];
        std::array::from_fn(|k| (after[k] - before[k]) / model.step_s)
    } else {
        // Speeds half a step apart are not those of one node's forces.
        [scratch.ax[link], scratch.ay[link], scratch.alpha[link]]
    };
    [body.acceleration_x_m_s2, body.acceleration_y_m_s2, body.angular_acceleration_rad_s2] = rate;
    balance(&mut body, model.chain.lever[link]);
    Ok(body)
}

fn balance(body: &mut FreeBody, lever_m: f64) {
    let sum = |f: &dyn Fn(&Force) -> f64| body.forces.iter().map(f).sum::<f64>();
    (body.sum_x_n, body.sum_y_n, body.sum_moment_nm) = (sum(&|f| f.fx_n), sum(&|f| f.fy_n), sum(&|f| f.moment_nm));
    let largest = body.forces.iter().map(|f| libm::hypot(f.fx_n, f.fy_n)).fold(0.0, f64::max);
    let miss_x = body.sum_x_n - body.mass_kg * body.acceleration_x_m_s2;
    let miss_y = body.sum_y_n - body.mass_kg * body.acceleration_y_m_s2;
    let miss_moment = body.sum_moment_nm - body.inertia_kg_m2 * body.angular_acceleration_rad_s2;
    body.remainder_n = libm::hypot(miss_x, miss_y);
    body.remainder_share = body.remainder_n / largest.max(1e-12);
    let largest_moment = body.forces.iter().map(|f| f.moment_nm.abs()).fold(largest * lever_m, f64::max);
    body.remainder_moment_share = miss_moment.abs() / largest_moment.max(1e-15);
}

fn lanes_of(model: &Model, link: usize) -> Vec<Lane> {
    let mut lanes = Vec::new();
    for part in ContactGroup::in_model(model) {
        let candidates = match part {
            ContactGroup::Bushes => [model.chain.previous(link), link].map(|j| model.chain.bush_lane(j)).to_vec(),
            ContactGroup::Guides(_) | ContactGroup::Rails(_) | ContactGroup::Contours(_) => vec![link],
        };
        for lane in candidates {
            let (owner, feature) = part.feature(model, lane);
            if owner == link {
                lanes.push(Lane {
                    part,
                    lane,
                    feature,
                    history: Vec::new(),
                    meter: PeakMeter::default(),
                    peak_force_n: 0.0,
                    peak_t_s: 0.0,
                    began: false,
                    approach: None,
                });
            }
        }
    }
    lanes
}

/// Records a step that has just been evaluated.
fn watch(model: &Model, state: &State, scratch: &Scratch, link: usize, lanes: &mut [Lane], tensions: &mut Vec<f64>) {
    let tension = tension_n(model, state, scratch, link);
    let t_s = state.step as f64 * model.step_s;
    for lane in lanes {
        let memory = scratch.memory(lane.part);
        let age = memory.age[lane.lane];
        if age == 0.0 {
            (lane.began, lane.approach) = (false, None);
            lane.forget();
            continue;
        }
        if age == 1.0 {
            lane.began = true;
            lane.forget();
            let before = mean_of_period(model, tensions);
            lane.approach = approach(model, state, scratch, lane).map(|(closing_speed_m_s, parts)| Approach {
                t_s,
                closing_speed_m_s,
                parts,
                tension_n: tension,
                tension_before_n: before,
            });
        }
        // The value is a prediction until the two overlap at a node; then it is replaced by the measured one.
        if lane.history.iter().all(|[_, _, depth_m]| *depth_m <= 0.0)
            && let Some(Approach { closing_speed_m_s, parts, .. }) = &mut lane.approach
            && let Some(gained) = parts.last_mut()
        {
            let measured_m_s = memory.approach[lane.lane];
            gained.speed_m_s += measured_m_s - *closing_speed_m_s;
            *closing_speed_m_s = measured_m_s;
        }
        let mean_n = memory.normal_force[lane.lane];
        lane.history.push([t_s, mean_n, scratch.depth(lane.part, lane.lane)]);
        if age <= WATCHED_PERIODS * ImpactWatch::period_steps_of(model) {
            let of = (scratch.touch(lane.part, lane.lane), memory.approach[lane.lane]);
            lane.follow_peak(scratch.law(model, lane.part, lane.lane), of, mean_n, (t_s, model.step_s));
        }
    }
    tensions.push(tension);
}

impl Lane {
    fn forget(&mut self) {
        self.history.clear();
        (self.meter, self.peak_force_n, self.peak_t_s) = (PeakMeter::default(), 0.0, 0.0);
    }

    /// As the watch over all impacts follows it ([`ImpactWatch`]).
    fn follow_peak(
        &mut self,
        law: Option<&ContactLaw>,
        (touch, approach_m_s): (Option<(f64, f64)>, f64),
        mean_n: f64,
        (t_s, step_s): (f64, f64),
    ) {
        let Some(law) = law else {
            self.meter = PeakMeter::default();
            return;
        };
        let top = self.meter.peak_since(law, touch, approach_m_s, step_s, self.peak_force_n);
        let top_n = top.unwrap_or(mean_n);
        if top_n > self.peak_force_n {
            (self.peak_force_n, self.peak_t_s) = (top_n, t_s);
        }
    }
}

/// Mean over the preceding tooth period.
fn mean_of_period(model: &Model, tensions: &[f64]) -> f64 {
    let period_s = 2.0 * model.chain.lever[0] / model.chain_speed_m_s().abs().max(1e-12);
    let steps = ((period_s / model.step_s) as usize).clamp(1, tensions.len().max(1));
    let last = &tensions[tensions.len().saturating_sub(steps)..];
    if last.is_empty() { f64::NAN } else { last.iter().sum::<f64>() / last.len() as f64 }
}

/// Tension of the link, mean of both joints [N].
fn tension_n(model: &Model, state: &State, scratch: &Scratch, link: usize) -> f64 {
    let (front, rear) = (scratch.joint_force(link), scratch.joint_force(model.chain.previous(link)));
    let l = &state.links;
    -0.5 * ((front.0 + rear.0) * l.cos[link] + (front.1 + rear.1) * l.sin[link])
}

/// Position and velocity of an end of a link, at the node.
fn end_at(model: &Model, state: &State, scratch: &Scratch, link: usize, front: bool) -> (Vec2, Vec2) {
    let l = &state.links;
    let lever = model.chain.lever[link] * if front { 1.0 } else { -1.0 };
    let arm = Vec2::new(l.cos[link], l.sin[link]) * lever;
    let (v, omega) = velocity_at(model, state, scratch, link);
    (Vec2::new(l.x[link], l.y[link]) + arm, v + perp(arm) * omega)
}

/// Velocity and angular velocity of a link as the contacts of a step use them: with the accelerations of the previous
/// step and the change of the joint accelerations since.
fn velocity_at(model: &Model, state: &State, scratch: &Scratch, link: usize) -> (Vec2, f64) {
    let (l, half, quarter) = (&state.links, 0.5 * model.step_s, 0.25 * model.step_s);
    let change = |now: &[f64], past: &[f64]| quarter * (now[link] - past[link]);
    let v = Vec2::new(
        l.vx[link] + half * l.ax[link] + change(&scratch.joint_ax, &l.joint_ax),
        l.vy[link] + half * l.ay[link] + change(&scratch.joint_ay, &l.joint_ay),
    );
    (v, l.omega[link] + half * l.alpha[link] + change(&scratch.joint_alpha, &l.joint_alpha))
}

/// Closing speed and its parts, at the first contact of a lane.
fn approach(model: &Model, state: &State, scratch: &Scratch, lane: &Lane) -> Option<(f64, Vec<ApproachPart>)> {
    let touch = touch_at(model, state, scratch, lane.part, lane.lane)?;
    let n = touch.normal;
    let part = |cause: &'static str, v: Vec2| ApproachPart { cause, speed_m_s: -n.dot(&v) };
    let (link, front) = match lane.part {
        ContactGroup::Bushes => model.chain.bush_carrier(lane.lane),
        ContactGroup::Guides(set) | ContactGroup::Contours(set) => (lane.lane, set % 2 == 0),
        ContactGroup::Rails(set) => (lane.lane, set % 3 == 0),
    };
    let rotor = model.moving_frame(touch.body).map(|f| f.motion(&explicit::coordinate_columns(model, state)));
    let spin = rotor.map_or(0.0, |m| m.omega);
    let surface = |p: Vec2| rotor.map_or(Vec2::zeros(), |m| m.velocity + perp(p - m.origin) * spin);
    let mut parts = if lane.part == ContactGroup::Bushes {
        // The link ahead of the bush's joint, in the direction of travel.
        let forwards = model.chain_speed_m_s() >= 0.0;
        let joint = model.chain.joint_of(lane.lane);
        let ahead = if forwards { model.chain.next(joint) } else { joint };
        let (p, v) = end_at(model, state, scratch, link, front);
        let (here, v_here) = end_at(model, state, scratch, ahead, !forwards);
        let (seat, v_seat) = end_at(model, state, scratch, ahead, forwards);
        let (r, w) = (here - seat, velocity_at(model, state, scratch, ahead).1);
        vec![
            part("articulation: a straight span onto the turning sprocket", -perp(r) * spin),
            part("the arriving link turns already (sideways motion of the span)", perp(r) * w),
            part("the joint ahead moves on the sprocket", v_seat - surface(seat)),
            part("the joint stretches (step in tension)", v - v_here - surface(p) + surface(here)),
        ]
    } else {
        // A flank, an abutment or a plate end rotates about the joint ahead of its link.
        let (joint, v_joint) = end_at(model, state, scratch, link, model.chain_speed_m_s() >= 0.0);
        let (r, w) = (touch.point - joint, velocity_at(model, state, scratch, link).1);
        let turns = part("the arriving link turns already (sideways motion of the span)", perp(r) * w);
        if rotor.is_some() {
            vec![
                part("articulation: a straight span onto the turning sprocket", -perp(r) * spin),
                turns,
                part("the joint ahead moves on the sprocket", v_joint - surface(joint)),
            ]
        } else {
            vec![turns, part("the joint ahead moves towards the guide", v_joint)]
        }
    };
    let node_m_s: f64 = parts.iter().map(|p| p.speed_m_s).sum();
    let closing_m_s = scratch.memory(lane.part).approach[lane.lane];
    parts.push(ApproachPart { cause: "gained from this step until the touch", speed_m_s: closing_m_s - node_m_s });
    Some((closing_m_s, parts))
}

/// Contact partner of a lane: bushes and plate ends by exact detection, contours as the step found them.
fn touch_at(model: &Model, state: &State, scratch: &Scratch, part: ContactGroup, lane: usize) -> Option<TouchRow> {
    let (body, tooth) = scratch.partner(model, part, lane)?;
    let l = &state.links;
    let joint = |link: usize, front: bool| {
        let lever = model.chain.lever[link] * if front { 1.0 } else { -1.0 };
        Vec2::new(l.x[link] + lever * l.cos[link], l.y[link] + lever * l.sin[link])
    };
    match part {
        ContactGroup::Bushes => {
            let sprocket = &model.sprockets[body];
            let (link, front) = model.chain.bush_carrier(lane);
            let is_roller = model.chain.is_roller(lane);
            let p = if is_roller { Vec2::new(l.x[lane], l.y[lane]) } else { joint(link, front) };
            let (cos, sin) = (state.coordinates.cos[sprocket.coordinate], state.coordinates.sin[sprocket.coordinate]);
            let d = p - sprocket.frame.origin_at(&state.coordinates.angle);
            let in_frame = Vec2::new(cos * d.x + sin * d.y, cos * d.y - sin * d.x);
            let radius_m = sprocket.body.bush_radius_m;
            let hit = crate::pairs::bush_gap::gap_contact(sprocket.geometry.iso()?, in_frame, radius_m);
            let n = hit.touch.normal;
            let normal = Vec2::new(cos * n.x - sin * n.y, sin * n.x + cos * n.y);
            Some(TouchRow { body, tooth: hit.tooth, segment: hit.segment, normal, point: p - normal * radius_m })
        }
        ContactGroup::Guides(set) => {
            let guide = model.guides.get(body.checked_sub(model.sprockets.len())?)?;
            let (b, origin) = (&guide.body, guide.frame.origin_at(&state.coordinates.angle));
            let p = joint(lane, set % 2 == 0);
            let (d, up) = (p - origin, perp(b.along));
            let (along, above) = (d.dot(&b.along), d.dot(&up));
            let from = Vec2::new(along - along.clamp(0.0, b.length_m), above + b.end_radius_m);
            let normal = (b.along * from.x + up * from.y) / from.norm();
            let segment = model.guides[body - model.sprockets.len()].segment(along);
            Some(TouchRow { body, tooth, segment, normal, point: p - normal * b.plate_radius_m })
        }
        ContactGroup::Rails(set) => {
            let rail = model.rails.get(body.checked_sub(model.first_rail())?)?;
            let swing = rail.frame.motion(&explicit::coordinate_columns(model, state));
            let into = |v: Vec2| Vec2::new(swing.cos * v.x + swing.sin * v.y, swing.cos * v.y - swing.sin * v.x);
            let (centre, heading) = (Vec2::new(l.x[lane], l.y[lane]), Vec2::new(l.cos[lane], l.sin[lane]));
            let plate = PlatePart::ALL[set % 3];
            let bent = rail.bent(&state.coordinates.angle);
            let link = (into(centre - swing.origin), into(heading));
            let (t, _) = rail.touch(bent.as_ref(), plate, link, model.chain.lever[lane])?;
            let normal = Vec2::new(
                swing.cos * t.normal.x - swing.sin * t.normal.y,
                swing.sin * t.normal.x + swing.cos * t.normal.y,
            );
            let point = centre + heading * t.along_m - normal * rail.body.plate_radius_m;
            Some(TouchRow { body, tooth, segment: rail.segment(t.piece), normal, point })
        }
        ContactGroup::Contours(set) => {
            let k = model.end_bodies.iter().position(|b| b.set == set / 2 && b.body == body)?;
            let mut found = None;
            scratch.end_touches(model, state, k, Some(lane), |link, front, t| {
                if link == lane && front == (set % 2 == 0) {
                    found = Some(t);
                }
            });
            let (t, origin) = (found?, model.end_bodies[k].frame.origin_at(&state.coordinates.angle));
            Some(TouchRow { body, tooth: t.tooth, segment: t.segment, normal: t.normal, point: t.point + origin })
        }
    }
}

/// A link at a node, and what the step worked with there.
#[derive(Clone, Copy)]
struct ExplainedLink<'a> {
    model: &'a Model,
    state: &'a State,
    scratch: &'a Scratch,
    link: usize,
}

impl ExplainedLink<'_> {
    fn centre(&self) -> Vec2 {
        Vec2::new(self.state.links.x[self.link], self.state.links.y[self.link])
    }

    fn force(&self, kind: &'static str, cause: String, at: Vec2, f: Vec2, torque: f64) -> Force {
        let moment_nm = cross(at - self.centre(), f) + torque;
        Force { kind, cause, x_m: at.x, y_m: at.y, fx_n: f.x, fy_n: f.y, moment_nm }
    }

    /// Place of an end of the link.
    fn end(&self, front: bool) -> Vec2 {
        end_at(self.model, self.state, self.scratch, self.link, front).0
    }

    /// Forces and pin friction of both joints.
    fn joint_forces(&self) -> Vec<Force> {
        let c = &self.model.chain;
        let (ahead, behind) = (c.next(self.link), c.previous(self.link));
        let of_joint = |(joint, front, neighbour): (usize, bool, usize)| {
            let (x, y, torque) = self.scratch.joint_force(joint);
            let sign = if front { -1.0 } else { 1.0 };
            let (at, end) = (self.end(front), if front { "front" } else { "rear" });
            let cause = format!("{end} joint {}, to link {}", c.number_of(joint), c.number_of(neighbour));
            let rubbing = format!("{cause}: pin friction");
            [
                self.force("joint", cause, at, Vec2::new(x, y) * sign, 0.0),
                self.force("pin friction", rubbing, at, Vec2::zeros(), torque * sign),
            ]
        };
        [(self.link, true, ahead), (behind, false, behind)].into_iter().flat_map(of_joint).collect()
    }

    /// What rollers give to the bushes of the link.
    fn roller_forces(&self) -> Vec<Force> {
        let (c, bores) = (&self.model.chain, &self.scratch.bores);
        let of_roller = |roller: usize| {
            let (owner, front) = c.bush_carrier(roller);
            if !c.is_roller(roller) || owner != self.link || bores.memory.normal_force[roller] == 0.0 {
                return None;
            }
            // Where the force acts does not matter beside its moment about the axis of the bush.
            let f = -Vec2::new(bores.force_x[roller], bores.force_y[roller]);
            let cause = format!("{} roller on its bush", if front { "front" } else { "rear" });
            Some(self.force("roller", cause, self.end(front), f, bores.bush_moment[roller]))
        };
        [c.previous(self.link), self.link].map(|joint| c.bush_lane(joint)).into_iter().filter_map(of_roller).collect()
    }

    /// The contact of a lane that touches, and its forces on the link.
    fn contact(&self, lane: Lane) -> anyhow::Result<Option<(Contact, Vec<Force>)>> {
        let ExplainedLink { model, state, scratch, .. } = *self;
        let memory = scratch.memory(lane.part);
        let (normal_n, friction_n) = (memory.normal_force[lane.lane], memory.tangential_force[lane.lane]);
        if memory.age[lane.lane] == 0.0 || !scratch.is_contact(lane.part, lane.lane) {
            return Ok(None);
        }
        let touch = touch_at(model, state, scratch, lane.part, lane.lane)
            .with_context(|| format!("the contact of {} cannot be found again", Feature::name(lane.feature as u32)))?;
        let rotor = touch.body < model.sprockets.len();
        let body = model.body_path(touch.body);
        let (feature, segment) = (Feature::name(lane.feature as u32), Segment::name(touch.segment as u32));
        let joint = match lane.part {
            ContactGroup::Bushes => Some(model.chain.number_of(model.chain.joint_of(lane.lane))),
            ContactGroup::Guides(_) | ContactGroup::Rails(_) | ContactGroup::Contours(_) => None,
        };
        let place =
            if rotor { format!("{body}, tooth gap {}, {segment}", touch.tooth) } else { format!("{body}, {segment}") };
        let mut forces = Vec::new();
        // What a tooth does to a roller the link feels through its bush.
        if !model.chain.is_roller(lane.lane) {
            let on = format!("{} on {place}", of_joint(feature, joint));
            let rubbing = format!("{on}: friction");
            forces.push(self.force("contact normal", on, touch.point, touch.normal * normal_n, 0.0));
            forces.push(self.force("contact friction", rubbing, touch.point, perp(touch.normal) * friction_n, 0.0));
        }
        let contact = Contact {
            feature,
            joint,
            body,
            tooth: rotor.then_some(touch.tooth),
            segment,
            penetration_m: scratch.depth(lane.part, lane.lane),
            normal_force_n: normal_n,
            tangential_force_n: friction_n,
            age_s: memory.age[lane.lane] * model.step_s,
            approach_speed_m_s: memory.approach[lane.lane],
            history_is_whole: lane.began,
            peak_force_n: lane.peak_force_n,
            peak_t_s: lane.peak_t_s,
            history: thinned(lane.history),
            approach: lane.approach,
        };
        Ok(Some((contact, forces)))
    }
}

fn free_body(
    model: &Model,
    state: &State,
    scratch: &Scratch,
    link: usize,
    lanes: Vec<Lane>,
) -> anyhow::Result<FreeBody> {
    let at_node = ExplainedLink { model, state, scratch, link };
    let mut forces = at_node.joint_forces();
    forces.extend(at_node.roller_forces());
    let mut contacts = Vec::new();
    for lane in lanes {
        if let Some((contact, own)) = at_node.contact(lane)? {
            contacts.push(contact);
            forces.extend(own);
        }
    }
    let (l, centre) = (&state.links, at_node.centre());
    Ok(FreeBody {
        link: model.chain.number_of(link),
        step: state.step,
        t_s: state.step as f64 * model.step_s,
        mass_kg: model.chain.mass[link],
        inertia_kg_m2: model.chain.inertia[link],
        x_m: centre.x,
        y_m: centre.y,
        angle_rad: crate::units::direction(l.sin[link], l.cos[link]),
        forces,
        sum_x_n: 0.0,
        sum_y_n: 0.0,
        sum_moment_nm: 0.0,
        acceleration_x_m_s2: 0.0,
        acceleration_y_m_s2: 0.0,
        angular_acceleration_rad_s2: 0.0,
        remainder_n: 0.0,
        remainder_share: 0.0,
        remainder_moment_share: 0.0,
        contacts,
    })
}

/// A part in words, with the joint that it is at.
pub fn of_joint(feature: &str, joint: Option<usize>) -> String {
    joint.map_or(feature.to_string(), |j| format!("{feature} (joint {j})"))
}

/// At most [`LONGEST_HISTORY`] evenly spaced values, including the last.
fn thinned(history: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    let stride = history.len().div_ceil(LONGEST_HISTORY).max(1);
    let last = history.len().saturating_sub(1);
    history.into_iter().enumerate().filter(|(i, _)| (last - i).is_multiple_of(stride)).map(|(_, h)| h).collect()
}
