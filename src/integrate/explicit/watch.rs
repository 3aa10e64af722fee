//! What a step keeps beside its forces for those who look at every step: what touches where, torques, and the extremes of its
//! contacts. Nothing of it is kept unasked, and nothing of it enters a force.
//!
//! All of it is noted where a block of contacts has just been computed and its values are at hand: a second walk over
//! columns took as many instructions and more time (torques 20 % of a run and not 3, penetrations 9 and not 1). What is noted
//! there of speeds is what the step predicts; with [`Scratch::velocity_change`] it bounds what they are once the accelerations
//! are known. Sums are worked on as local values: a compiler cannot know that they do not overlap the lanes, and would add them
//! up one by one.

use super::parts::{PARTS, Part};
use super::{Scratch, WINDOW_MARGIN_M, put};
use crate::elements::contact_law::ContactLaw;
use crate::elements::contour_forces::{Lead, OffJoint};
use crate::elements::tooth_contact::{Column, LANES, Lanes, blocks};
use crate::model::Model;
use crate::state::State;

/// What is asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    /// [`Touches`].
    pub touches: bool,
    /// Segments of what lanes touch.
    pub segments: bool,
    /// [`TorqueSums`].
    pub torques: bool,
    pub extremes: Vec<Extreme>,
    /// Parts of which a number is asked that changes with the set of lanes that touch.
    pub sets: Vec<Parts>,
}

impl Wanted {
    /// All that this or another asks for.
    pub fn and(mut self, other: Wanted) -> Wanted {
        self.touches |= other.touches;
        self.segments |= other.segments;
        self.torques |= other.torques;
        for extreme in other.extremes {
            if !self.extremes.contains(&extreme) {
                self.extremes.push(extreme);
            }
        }
        for set in other.sets {
            if !self.sets.contains(&set) {
                self.sets.push(set);
            }
        }
        self
    }
}

/// A set of parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parts(u16);

impl Parts {
    pub fn has(self, part: Part) -> bool {
        self.0 & (1 << part.index()) != 0
    }
}

impl FromIterator<Part> for Parts {
    fn from_iter<I: IntoIterator<Item = Part>>(parts: I) -> Parts {
        Parts(parts.into_iter().fold(0, |all, part| all | (1 << part.index())))
    }
}

/// The largest of a value among all that touch: of `sign` times it, or times its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extreme {
    pub value: ContactValue,
    /// 1, or -1 where the smallest is meant.
    pub sign: f64,
    pub absolute: bool,
    pub parts: Parts,
}

/// A value that every contact has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactValue {
    /// [m]
    Penetration,
    /// [m/s]
    ApproachSpeed,
    /// Closing speed [m/s].
    NormalSpeed,
    /// In steps.
    Age,
    /// [N]
    NormalForce,
    /// What friction is at most [N].
    FrictionLimit,
    /// As the step predicts it: within [`Scratch::velocity_change`] of that of the node [m/s].
    TangentialSpeed,
}

/// More sprockets than this have their torques taken from frames.
pub const MOST_SPROCKETS: usize = 8;

/// Torques of the chain on the sprockets at the node.
#[derive(Clone, Debug)]
pub struct TorqueSums {
    /// Of the normal forces, lane by lane [N m].
    pub torque: [Column; MOST_SPROCKETS],
    /// What friction can add on all of them together [N m].
    pub friction: Column,
    /// False: a contact law has more than a stiffness and a damping, or there are too many sprockets.
    pub known: bool,
}

/// What lanes of a part touch, valid where their contacts have an age.
#[derive(Clone, Debug)]
pub struct Touches {
    /// Out of the body.
    pub normal_x: Vec<f64>,
    pub normal_y: Vec<f64>,
    /// Joint from the body's origin [m].
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    /// Contact point from the joint, against the normal and along the tangent [m]; of bushes and plate ends the same everywhere.
    pub radius: Vec<f64>,
    pub offset: Vec<f64>,
    /// Of the body there [m].
    pub body_radius: Vec<f64>,
    /// Sprocket the body turns with; -1: at rest.
    pub rotor: Vec<f64>,
}

/// Everything that is kept.
pub(super) struct Watched {
    touches: Option<[Touches; PARTS]>,
    /// A [`Segment`](crate::recording::frame::Segment) as a number.
    segments: Option<[Vec<f64>; PARTS]>,
    torques: Option<TorqueSums>,
    extremes: Vec<(Extreme, Column)>,
    sets: Vec<(Parts, Column)>,
    /// A number for every lane of every part.
    keys: Vec<f64>,
    padded: usize,
    /// A force is asked for that the law of a contact does not tell from a depth and a closing speed.
    forces_known: bool,
    /// Longest arms of contact points on a link, and on a sprocket [m].
    arms_m: (f64, f64),
    velocity_change: f64,
}

/// A block of contacts that has just been computed.
pub(super) struct Noted<'a> {
    pub(super) part: Part,
    pub(super) at: usize,
    pub(super) law: &'a ContactLaw,
    pub(super) mu: f64,
    pub(super) lanes: &'a Lanes,
    /// Of bushes and plate ends.
    pub(super) radius: f64,
    /// Of other contours.
    pub(super) off: Option<&'a OffJoint>,
    /// Sprocket the body turns with.
    pub(super) rotor: Option<usize>,
}

impl TorqueSums {
    const NONE: TorqueSums = TorqueSums { torque: [[0.0; LANES]; MOST_SPROCKETS], friction: [0.0; LANES], known: true };

    #[inline(always)]
    fn note(&mut self, b: &Noted, own: impl Fn(usize) -> bool) {
        let Some(k) = b.rotor else { return };
        let Some(sum) = self.torque.get_mut(k) else {
            self.known = false;
            return;
        };
        let ContactLaw::Linear { stiffness_n_per_m: k, damping_n_s_per_m: c } = *b.law else {
            self.known &= (0..LANES).all(|i| b.lanes.age[i] == 0.0 || !own(i));
            return;
        };
        let l = b.lanes;
        let (radius, offset) = b.off.map_or(([b.radius; LANES], [0.0; LANES]), |o| (o.radius, o.offset));
        let (mut torque, mut friction) = (*sum, self.friction);
        for i in 0..LANES {
            // Choices one in another, not conditions joined: those would be made lane by lane.
            let force = linear_force(k, c, l.penetration[i], l.rate[i]);
            let force = if l.age[i] > 0.0 { force } else { 0.0 };
            let force = if own(i) { force } else { 0.0 };
            let (nx, ny) = (l.normal_x[i], l.normal_y[i]);
            torque[i] += force * (l.y[i] * nx - l.x[i] * ny + offset[i]);
            friction[i] += force * (b.mu * (radius[i] - l.x[i] * nx - l.y[i] * ny).abs() + 1e-9);
        }
        (*sum, self.friction) = (torque, friction);
    }
}

/// Of the linear law at a node [N]: where it only pulls a contact shows no force.
#[inline(always)]
pub fn linear_force(stiffness: f64, damping: f64, depth: f64, rate: f64) -> f64 {
    let force = stiffness * depth + damping * rate;
    let force = if depth > 0.0 { force } else { 0.0 };
    if force > 0.0 { force } else { 0.0 }
}

impl Touches {
    fn new(model: &Model, part: Part) -> Touches {
        let lanes = model.chain.padded;
        let column = || vec![0.0; lanes];
        let (radius_m, rotor) = match part {
            Part::Bushes => (model.sprockets.first().map(|s| s.body.bush_radius_m), 0.0),
            Part::Guides(_) => (model.guides.first().map(|g| g.body.plate_radius_m), -1.0),
            Part::Contours(_) => (None, -1.0),
        };
        Touches {
            normal_x: column(),
            normal_y: column(),
            x: column(),
            y: column(),
            radius: vec![radius_m.unwrap_or(0.0); lanes],
            offset: column(),
            body_radius: column(),
            rotor: vec![rotor; lanes],
        }
    }

    #[inline(always)]
    fn note(&mut self, b: &Noted, masked: bool, own: impl Fn(usize) -> bool) {
        let (at, l) = (b.at, b.lanes);
        let rotor = b.rotor.map_or(-1.0, |k| k as f64);
        if masked || b.off.is_some() {
            for i in (0..LANES).filter(|i| own(*i)) {
                (self.normal_x[at + i], self.normal_y[at + i]) = (l.normal_x[i], l.normal_y[i]);
                (self.x[at + i], self.y[at + i]) = (l.x[i], l.y[i]);
                (self.body_radius[at + i], self.rotor[at + i]) = (l.body_radius[i], rotor);
                if let Some(off) = b.off {
                    (self.radius[at + i], self.offset[at + i]) = (off.radius[i], off.offset[i]);
                }
            }
            return;
        }
        put(&mut self.normal_x, at, l.normal_x);
        put(&mut self.normal_y, at, l.normal_y);
        put(&mut self.x, at, l.x);
        put(&mut self.y, at, l.y);
        put(&mut self.body_radius, at, l.body_radius);
        if b.rotor.is_some() {
            put(&mut self.rotor, at, [rotor; LANES]);
        }
    }
}

impl Extreme {
    #[inline(always)]
    fn note(&self, most: &mut Column, b: &Noted, own: impl Fn(usize) -> bool) -> bool {
        let l = b.lanes;
        let mut forces = [0.0; LANES];
        let values = match self.value {
            ContactValue::Penetration => &l.penetration,
            ContactValue::ApproachSpeed => &l.approach,
            ContactValue::NormalSpeed => &l.rate,
            ContactValue::Age => &l.age,
            ContactValue::TangentialSpeed => &l.slide,
            ContactValue::NormalForce | ContactValue::FrictionLimit => {
                let ContactLaw::Linear { stiffness_n_per_m: k, damping_n_s_per_m: c } = *b.law else {
                    return (0..LANES).all(|i| l.age[i] == 0.0 || !own(i));
                };
                let share = if self.value == ContactValue::FrictionLimit { b.mu } else { 1.0 };
                for i in 0..LANES {
                    forces[i] = share * linear_force(k, c, l.penetration[i], l.rate[i]);
                }
                &forces
            }
        };
        let bits = if self.absolute { u64::MAX >> 1 } else { u64::MAX };
        let mut now = *most;
        for i in 0..LANES {
            let value = self.sign * f64::from_bits(values[i].to_bits() & bits);
            let value = if l.age[i] > 0.0 { value } else { f64::NEG_INFINITY };
            let value = if own(i) { value } else { f64::NEG_INFINITY };
            now[i] = if value > now[i] { value } else { now[i] };
        }
        *most = now;
        true
    }
}

impl Watched {
    fn new(model: &Model, wanted: &Wanted) -> Watched {
        let padded = model.chain.padded;
        let asks_slide = |e: &Extreme| e.value == ContactValue::TangentialSpeed;
        // Distinct whole numbers below 2^40: their sums are exact, and those of sets that follow each other practically never
        // equal.
        let key = |i: usize| ((i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 24) as f64;
        let keys = if wanted.sets.is_empty() { 0 } else { PARTS * padded };
        Watched {
            touches: wanted.touches.then(|| Part::ALL.map(|part| Touches::new(model, part))),
            segments: wanted.segments.then(|| std::array::from_fn(|_| vec![0.0; padded])),
            torques: wanted.torques.then_some(TorqueSums::NONE),
            extremes: wanted.extremes.iter().map(|e| (*e, [f64::NEG_INFINITY; LANES])).collect(),
            sets: wanted.sets.iter().map(|s| (*s, [0.0; LANES])).collect(),
            keys: (0..keys).map(key).collect(),
            padded,
            forces_known: true,
            arms_m: if wanted.extremes.iter().any(asks_slide) { arms_m(model) } else { (0.0, 0.0) },
            velocity_change: 0.0,
        }
    }

    /// Before a step.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        let zero = [0.0; LANES];
        if let Some(torques) = &mut self.torques {
            *torques = TorqueSums::NONE;
        }
        for (_, most) in &mut self.extremes {
            *most = [f64::NEG_INFINITY; LANES];
        }
        for (_, sum) in &mut self.sets {
            *sum = zero;
        }
        self.forces_known = true;
    }

    pub(super) fn wants_segments(&self) -> bool {
        self.segments.is_some()
    }

    /// Segments of a block, before it is noted.
    #[inline(always)]
    pub(super) fn note_segments(&mut self, part: Part, at: usize, segments: Column, own: Option<&[bool; LANES]>) {
        let Some(all) = &mut self.segments else { return };
        let column = &mut all[part.index()];
        match own {
            None => put(column, at, segments),
            Some(own) => {
                for i in (0..LANES).filter(|i| own[*i]) {
                    column[at + i] = segments[i];
                }
            }
        }
    }

    /// A block of contacts; of some of its lanes only, where it is another body's too or ends behind the last link.
    #[inline(always)]
    pub(super) fn note(&mut self, b: &Noted, own: Option<&[bool; LANES]>) {
        match own {
            None => self.note_where(b, false, |_| true),
            Some(own) => self.note_where(b, true, |i| own[i]),
        }
    }

    #[inline(always)]
    fn note_where(&mut self, b: &Noted, masked: bool, own: impl Fn(usize) -> bool + Copy) {
        if let Some(touches) = &mut self.touches {
            touches[b.part.index()].note(b, masked, own);
        }
        if let Some(torques) = &mut self.torques {
            torques.note(b, own);
        }
        for (extreme, most) in &mut self.extremes {
            if extreme.parts.has(b.part) {
                self.forces_known &= extreme.note(most, b, own);
            }
        }
        let first = b.part.index() * self.padded + b.at;
        for (parts, sum) in &mut self.sets {
            if !parts.has(b.part) {
                continue;
            }
            let (age, depth, mut now, mut keys) = (b.lanes.age, b.lanes.penetration, *sum, [0.0; LANES]);
            keys.copy_from_slice(&self.keys[first..first + LANES]);
            if let Some(segments) = &self.segments {
                let segments = &segments[b.part.index()][b.at..b.at + LANES];
                for i in 0..LANES {
                    keys[i] *= 1.0 + segments[i];
                }
            }
            for i in 0..LANES {
                // A contact may begin and end up to a step away from a node; frames show what overlaps at the node.
                keys[i] = if age[i] > 0.0 { keys[i] } else { 0.0 };
                keys[i] = if own(i) { keys[i] } else { 0.0 };
            }
            for i in 0..LANES {
                now[i] += if depth[i] > 0.0 { keys[i] } else { 0.0 };
            }
            *sum = now;
        }
    }
}

/// Of contact points from a link's centre and from a sprocket's axis, at most [m].
fn arms_m(model: &Model) -> (f64, f64) {
    let lever_m = model.chain.lever.iter().chain(&model.chain.bush_lever).fold(0.0, |most: f64, l| most.max(l.abs()));
    let mut arms = (lever_m, 0.0_f64);
    for s in &model.sprockets {
        arms.0 = arms.0.max(lever_m + s.body.bush_radius_m);
        arms.1 = arms.1.max(s.body.tip_radius_m + s.body.bush_radius_m + s.body.most_shift_m + WINDOW_MARGIN_M);
    }
    for g in &model.guides {
        arms.0 = arms.0.max(lever_m + g.body.plate_radius_m);
    }
    for b in &model.end_bodies {
        let reach_m = b.reach_m(lever_m) + lever_m + WINDOW_MARGIN_M;
        arms = (arms.0.max(reach_m), arms.1.max(reach_m));
    }
    arms
}

/// By how much speeds at contacts may differ from those that the step has predicted [m/s].
#[inline(always)]
fn velocity_change(half: f64, (on_link, on_sprocket): (f64, f64), state: &State, scratch: &Scratch) -> f64 {
    let (s, count) = (&state.links, scratch.ax.len() / LANES);
    let (ax, ay, alpha) = (blocks(&scratch.ax, count), blocks(&scratch.ay, count), blocks(&scratch.alpha, count));
    let (ax0, ay0, alpha0) = (blocks(&s.ax, count), blocks(&s.ay, count), blocks(&s.alpha, count));
    // Contacts are given speeds that know already half of what the joints change, and half of what contacts before them in the step
    // have changed: v + h/2 a(n-1) + h/4 (J_n - J(n-1)) + h/4 lead.
    let no_leads = Lead::default();
    let (jx, jy) = (blocks(&scratch.joint_ax, count), blocks(&scratch.joint_ay, count));
    let (jx0, jy0) = (blocks(&s.joint_ax, count), blocks(&s.joint_ay, count));
    let (jt, jt0) = (blocks(&scratch.joint_alpha, count), blocks(&s.joint_alpha, count));
    let mut most = [0.0; LANES];
    for b in 0..count {
        let lead = scratch.end_leads.get(b).unwrap_or(&no_leads);
        for i in 0..LANES {
            let x = ax[b][i] - ax0[b][i] - 0.5 * (jx[b][i] - jx0[b][i]);
            let y = ay[b][i] - ay0[b][i] - 0.5 * (jy[b][i] - jy0[b][i]);
            let turn = alpha[b][i] - alpha0[b][i] - 0.5 * (jt[b][i] - jt0[b][i]);
            let led = 0.5 * (lead.changes[i] + on_link * lead.turning_changes[i]);
            let change = x.abs() + y.abs() + on_link * turn.abs() + led;
            most[i] = if change > most[i] { change } else { most[i] };
        }
    }
    let links = most.iter().fold(0.0, |most, v| if *v > most { *v } else { most });
    let turned = scratch.rotor_alpha.iter().zip(&state.rotors.alpha).map(|(a, b)| (a - b).abs());
    // Rounding of sums in another order.
    half * (links + on_sprocket * turned.fold(0.0, f64::max)) * (1.0 + 1e-9) + 1e-9
}

/// After the accelerations are known.
#[inline(always)]
pub(super) fn note_node(model: &Model, state: &State, scratch: &mut Scratch) {
    let Some(arms_m) = scratch.watched.as_ref().map(|w| w.arms_m).filter(|arms| arms.0 > 0.0) else { return };
    let change = velocity_change(0.5 * model.step_s, arms_m, state, scratch);
    if let Some(watched) = &mut scratch.watched {
        watched.velocity_change = change;
    }
}

impl Scratch {
    /// From the next evaluation on, keeps what is wanted.
    pub fn watch(&mut self, model: &Model, wanted: &Wanted) {
        self.watched = (*wanted != Wanted::default()).then(|| Box::new(Watched::new(model, wanted)));
    }

    /// What a part touches, where that is asked for.
    pub fn touches(&self, part: Part) -> Option<&Touches> {
        Some(&self.watched.as_deref()?.touches.as_ref()?[part.index()])
    }

    /// Segments of what a part touches, where they are asked for.
    pub fn segments(&self, part: Part) -> Option<&[f64]> {
        Some(&self.watched.as_deref()?.segments.as_ref()?[part.index()])
    }

    /// Torques, where they are asked for and known.
    pub fn torques(&self) -> Option<&TorqueSums> {
        self.watched.as_deref()?.torques.as_ref().filter(|t| t.known)
    }

    /// An extreme, where it is asked for and known.
    pub fn extreme(&self, of: &Extreme) -> Option<f64> {
        let watched = self.watched.as_deref()?;
        let forces = matches!(of.value, ContactValue::NormalForce | ContactValue::FrictionLimit);
        let known = watched.forces_known || !forces;
        let (_, most) = watched.extremes.iter().find(|(e, _)| e == of).filter(|_| known)?;
        Some(most.iter().fold(f64::NEG_INFINITY, |most, v| if *v > most { *v } else { most }))
    }

    /// By how much a [`ContactValue::TangentialSpeed`] may be off, where one is asked for [m/s].
    pub fn velocity_change(&self) -> f64 {
        self.watched.as_deref().map_or(f64::INFINITY, |w| w.velocity_change)
    }

    /// A number that changes with the set of lanes of these parts that touch, and with the segments where those are asked for.
    pub fn set(&self, of: Parts) -> Option<f64> {
        let (_, sum) = self.watched.as_deref()?.sets.iter().find(|(parts, _)| *parts == of)?;
        Some(sum.iter().sum())
    }
}
