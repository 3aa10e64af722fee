//! The scheme of Moreau and Jean: bushes on teeth, and parts that touch each other, as rigid bodies with Coulomb friction.
//!
//! ```text
//! M (u+ - u-) = h f + W_N P_N + W_T P_T             of every contact whose gap is closed in the middle of the step:
//! 0 <= P_N,  g_N+ + e min(g_N-, 0) >= 0,  one zero  Newton's law of impact, g_N the speed at which the gap opens
//! |P_T| <= mu P_N,  P_T against g_T+                Coulomb's law, g_T the sliding speed
//! q(n+1) = q_n + h (u- + u+) / 2
//! ```
//! Gaps are looked at in the middle of a step, q_n + h u-/2, and so are the forces f of all else, which keeps its laws: with these middles as
//! nodes the scheme is the leapfrog, whose State and forces it takes. The impulses follow by projections, one contact after the other, until
//! no speed changes any more (Gauss and Seidel). Forces that are recorded are impulses over the step. What a contact takes is exact: its
//! impulse times the mean of its speeds before and after. Positions are not corrected: an overlap stays as deep as the step let it become, or as deep as
//! the stiff contacts of the run-in left it. What joints and guides see of a step's impulses in the next one is half of them once more, as of
//! any acceleration that goes on: largest forces of joints hold that too.
//! Sources: Moreau 1988; Jean 1999; for timing chains Fritz and Pfeiffer.

use super::StepError;
use super::explicit::{self, ContactGroup, Scratch};
use super::scheme::{SchemeSummary, unsolved};
use crate::elements::coordinate::CoordinateMotion;
use crate::geometry::{Vec2, cross, perp};
use crate::model::Model;
use crate::pairs::bush_gap;
use crate::state::State;

/// Change of a speed in a round at which impulses count as found [m/s].
const SOLVED_M_S: f64 = 1e-10;
/// Rounds at most.
const MOST_ROUNDS: usize = 20_000;

/// What a step keeps for the next, and what is told of a run.
pub(super) struct RigidContacts {
    contacts: Vec<RigidContact>,
    /// Impulses on coordinates, of one contact at a time.
    on_coordinates: Vec<f64>,
    pub(super) told: SchemeSummary,
}

impl Default for RigidContacts {
    fn default() -> RigidContacts {
        let told = SchemeSummary::Moreau { most_rounds: 0, residual_m_s: 0.0, deepest_m: 0.0 };
        RigidContacts { contacts: Vec::new(), on_coordinates: Vec::new(), told }
    }
}

/// A closed contact: how its speeds follow from those of bodies, and its impulses.
struct RigidContact {
    of: ContactPlace,
    link: Option<OnLink>,
    coordinates: Shares,
    /// Speed along normal and tangent by a unit impulse along it [1/kg].
    mobility: [f64; 2],
    friction: f64,
    /// Opening and sliding speed before the step [m/s].
    before: [f64; 2],
    /// Along normal and tangent [N s].
    impulse: [f64; 2],
    depth_m: f64,
}

/// Coordinates, with what an impulse along normal and tangent gives to each.
type Shares = Vec<(usize, [f64; 2])>;

/// Where a contact stands in the columns of Scratch.
#[derive(Clone, Copy)]
enum ContactPlace {
    Bush(usize),
    Touch(usize),
}

/// The link of a contact, and the directions of a unit impulse along normal and tangent, with their moments about its centre.
#[derive(Clone, Copy)]
struct OnLink {
    lane: usize,
    directions: [[f64; 3]; 2],
    inverse: [f64; 3],
}

impl RigidContacts {
    /// Adds what rigid contacts give to the forces and accelerations of a step that has been evaluated without them.
    pub(super) fn add(
        &mut self,
        model: &Model,
        restitution: f64,
        state: &State,
        scratch: &mut Scratch,
    ) -> Result<(), StepError> {
        let h = model.step_s;
        self.find(model, state, scratch);
        let (rounds, residual_m_s) = self.solve(model, restitution, state, scratch)?;
        if let SchemeSummary::Moreau { most_rounds, residual_m_s: most_left, deepest_m } = &mut self.told {
            *most_rounds = rounds.max(*most_rounds);
            *most_left = most_left.max(residual_m_s);
            *deepest_m = self.contacts.iter().fold(*deepest_m, |deepest, c| deepest.max(c.depth_m));
        }
        for contact in &self.contacts {
            contact.push_bodies(scratch, model, h);
        }
        for contact in &self.contacts {
            contact.book(state, scratch, h);
        }
        Ok(())
    }

    /// All closed contacts, with the impulses of the step before.
    fn find(&mut self, model: &Model, state: &State, scratch: &Scratch) {
        self.contacts.clear();
        let mut unit = std::mem::take(&mut self.on_coordinates);
        unit.resize(model.coordinates.len(), 0.0);
        self.find_bushes(model, state, scratch, &mut unit);
        for (i, touch) in model.touches.iter().enumerate() {
            let gap = touch.shape.gap(&state.coordinates.angle);
            if gap.gap_m > 0.0 {
                continue;
            }
            let mut coordinates: Shares = Vec::new();
            for side in [0, 1] {
                for (k, weight) in touch.shape.parts_of(&gap, side) {
                    let own = [weight * gap.slope[side], weight * gap.slide[side]];
                    match coordinates.iter_mut().find(|(known, _)| *known == k) {
                        Some((_, shares)) => shares.iter_mut().zip(own).for_each(|(sum, more)| *sum += more),
                        None => coordinates.push((k, own)),
                    }
                }
            }
            let past = [state.touches.normal_force[i], state.touches.tangential_force[i]];
            self.push(model, state, (ContactPlace::Touch(i), None, coordinates), (touch.friction, past, -gap.gap_m));
        }
        self.on_coordinates = unit;
    }

    fn find_bushes(&mut self, model: &Model, state: &State, scratch: &Scratch, unit: &mut [f64]) {
        let columns = explicit::coordinate_columns(model, state);
        let memory = &state.contacts[ContactGroup::Bushes.index()];
        for (k, sprocket) in model.sprockets.iter().enumerate() {
            let Some(teeth) = sprocket.geometry.iso() else { continue };
            let motion = sprocket.frame.motion(&columns);
            let (cos, sin) = (motion.cos, motion.sin);
            for (j, tooth) in scratch.joints_near(k).filter(|(j, _)| model.chain.is_body(*j)) {
                let (link, front) = model.chain.bush_carrier(j);
                let lever = model.chain.lever[link] * if front { 1.0 } else { -1.0 };
                let l = &state.links;
                let along = Vec2::new(l.cos[link], l.sin[link]) * lever;
                let centre = Vec2::new(l.x[link], l.y[link]) + along;
                let d = centre - motion.origin;
                let in_frame = Vec2::new(cos * d.x + sin * d.y, cos * d.y - sin * d.x);
                let axis = Vec2::new(sprocket.body.seat_cos[tooth as usize], sprocket.body.seat_sin[tooth as usize]);
                let radius_m = sprocket.body.bush_radius_m;
                let hit = bush_gap::contact_in_gap(teeth, (tooth, axis), in_frame, radius_m);
                if hit.touch.penetration_m < 0.0 {
                    continue;
                }
                let n = hit.touch.normal;
                let normal = Vec2::new(cos * n.x - sin * n.y, sin * n.x + cos * n.y);
                let point = centre - normal * radius_m;
                let from_link = point - (centre - along);
                let mut coordinates: Shares = Vec::new();
                let mut directions = [[0.0; 3]; 2];
                for (side, direction) in [normal, perp(normal)].into_iter().enumerate() {
                    directions[side] = [direction.x, direction.y, cross(from_link, direction)];
                    unit.fill(0.0);
                    let torque = -cross(point - motion.origin, direction);
                    sprocket.frame.give_back(-direction, torque, unit);
                    for (k, share) in unit.iter().enumerate().filter(|(_, share)| **share != 0.0) {
                        match coordinates.iter_mut().find(|(own, _)| *own == k) {
                            Some((_, shares)) => shares[side] = *share,
                            None => {
                                let mut shares = [0.0; 2];
                                shares[side] = *share;
                                coordinates.push((k, shares));
                            }
                        }
                    }
                }
                let c = &model.chain;
                let inverse = [c.inverse_mass[link], c.inverse_mass[link], c.inverse_inertia[link]];
                let on_link = OnLink { lane: link, directions, inverse };
                let past = [memory.normal_force[j], memory.tangential_force[j]];
                let of = (ContactPlace::Bush(j), Some(on_link), coordinates);
                self.push(model, state, of, (sprocket.body.friction, past, hit.touch.penetration_m));
            }
        }
    }

    fn push(
        &mut self,
        model: &Model,
        state: &State,
        (of, link, coordinates): (ContactPlace, Option<OnLink>, Shares),
        (friction, past_n, depth_m): (f64, [f64; 2], f64),
    ) {
        let mut mobility = [0.0; 2];
        for (side, sum) in mobility.iter_mut().enumerate() {
            if let Some(link) = &link {
                *sum += (0..3).map(|i| link.directions[side][i].powi(2) * link.inverse[i]).sum::<f64>();
            }
            *sum += coordinates.iter().map(|(k, share)| share[side].powi(2) * inverse_inertia(model, *k)).sum::<f64>();
        }
        let impulse = past_n.map(|force| force * model.step_s);
        let mut contact =
            RigidContact { of, link, coordinates, mobility, friction, before: [0.0; 2], impulse, depth_m };
        let l = &state.links;
        contact.before = contact.speeds([&l.vx, &l.vy, &l.omega], &state.coordinates.omega);
        self.contacts.push(contact);
    }

    /// Impulses of all contacts; the number of rounds, and the change of a speed in the last one.
    fn solve(
        &mut self,
        model: &Model,
        restitution: f64,
        state: &State,
        scratch: &Scratch,
    ) -> Result<(usize, f64), StepError> {
        let h = model.step_s;
        let l = &state.links;
        let end = |v: &[f64], a: &[f64]| -> Vec<f64> { v.iter().zip(a).map(|(v, a)| v + h * a).collect() };
        let mut links = [end(&l.vx, &scratch.ax), end(&l.vy, &scratch.ay), end(&l.omega, &scratch.alpha)];
        let mut coordinates = end(&state.coordinates.omega, &scratch.coordinate_alpha);
        for contact in &self.contacts {
            contact.give(model, contact.impulse, &mut links, &mut coordinates);
        }
        let mut residual_m_s = 0.0;
        for round in 0..MOST_ROUNDS {
            residual_m_s = 0.0_f64;
            for contact in &mut self.contacts {
                let [opening, _] = contact.speeds([&links[0], &links[1], &links[2]], &coordinates);
                let wanted = opening + restitution * contact.before[0].min(0.0);
                let normal = (contact.impulse[0] - wanted / contact.mobility[0]).max(0.0);
                let change = normal - contact.impulse[0];
                contact.give(model, [change, 0.0], &mut links, &mut coordinates);
                contact.impulse[0] = normal;
                residual_m_s = residual_m_s.max(change.abs() * contact.mobility[0]);
                let [_, sliding] = contact.speeds([&links[0], &links[1], &links[2]], &coordinates);
                let limit = contact.friction * normal;
                if contact.mobility[1] == 0.0 {
                    // Nothing that it slides on gives way: friction does work on what is prescribed, or none at all.
                    contact.impulse[1] = if sliding == 0.0 { 0.0 } else { -limit.copysign(sliding) };
                    continue;
                }
                let friction = (contact.impulse[1] - sliding / contact.mobility[1]).clamp(-limit, limit);
                let change = friction - contact.impulse[1];
                contact.give(model, [0.0, change], &mut links, &mut coordinates);
                contact.impulse[1] = friction;
                residual_m_s = residual_m_s.max(change.abs() * contact.mobility[1]);
            }
            if residual_m_s <= SOLVED_M_S {
                return Ok((round + 1, residual_m_s));
            }
        }
        Err(unsolved(state.step as f64 * h, "its rigid contacts".into(), residual_m_s))
    }
}

/// Inverse inertia of a coordinate in a step, whose damper sees the mean of the speeds before and after [1/kg, 1/(kg m2)].
fn inverse_inertia(model: &Model, k: usize) -> f64 {
    match model.coordinates[k].motion {
        CoordinateMotion::Prescribed { .. } | CoordinateMotion::Held => 0.0,
        CoordinateMotion::Free { inertia, .. } => {
            1.0 / (inertia + 0.5 * model.step_s * model.coordinates[k].spring.damping)
        }
    }
}

impl RigidContact {
    /// Opening and sliding speed.
    fn speeds(&self, links: [&[f64]; 3], coordinates: &[f64]) -> [f64; 2] {
        std::array::from_fn(|side| {
            let of_link = |link: &OnLink| (0..3).map(|i| link.directions[side][i] * links[i][link.lane]).sum::<f64>();
            let of_bodies = self.coordinates.iter().map(|(k, share)| share[side] * coordinates[*k]).sum::<f64>();
            self.link.as_ref().map_or(0.0, of_link) + of_bodies
        })
    }

    /// Changes the speeds by impulses along normal and tangent.
    fn give(&self, model: &Model, impulse: [f64; 2], links: &mut [Vec<f64>; 3], coordinates: &mut [f64]) {
        for (side, impulse) in impulse.into_iter().enumerate().filter(|(_, p)| *p != 0.0) {
            if let Some(link) = &self.link {
                for i in 0..3 {
                    links[i][link.lane] += link.inverse[i] * link.directions[side][i] * impulse;
                }
            }
            for (k, share) in &self.coordinates {
                coordinates[*k] += inverse_inertia(model, *k) * share[side] * impulse;
            }
        }
    }

    /// Adds its forces to accelerations and coordinates.
    fn push_bodies(&self, scratch: &mut Scratch, model: &Model, h: f64) {
        for (side, force) in self.impulse.map(|p| p / h).into_iter().enumerate() {
            if let Some(link) = &self.link {
                let at = link.lane;
                let by = |i: usize| link.inverse[i] * link.directions[side][i] * force;
                scratch.ax[at] += by(0);
                scratch.ay[at] += by(1);
                scratch.alpha[at] += by(2);
            }
            for (k, share) in &self.coordinates {
                scratch.coordinate_alpha[*k] += inverse_inertia(model, *k) * share[side] * force;
                match self.of {
                    ContactPlace::Bush(_) => scratch.chain_torque[*k] += share[side] * force,
                    ContactPlace::Touch(_) => scratch.add_part_force(*k, share[side] * force),
                }
            }
        }
    }

    /// Writes what is remembered of it, and what it has lost: its impulse times the mean of its speeds before and after, when all contacts
    /// have given their forces.
    fn book(&self, state: &State, scratch: &mut Scratch, h: f64) {
        let after = self.end_speeds(state, scratch, h);
        let mean = |side: usize| 0.5 * (self.before[side] + after[side]);
        let lost = |side: usize| -self.impulse[side] * mean(side);
        if let ContactPlace::Bush(j) = self.of {
            scratch.tell_speeds(ContactGroup::Bushes, j, [-mean(0), mean(1)]);
        }
        let (memory, past, at) = match self.of {
            ContactPlace::Bush(j) => {
                let group = ContactGroup::Bushes.index();
                (&mut scratch.contacts[group], &state.contacts[group], j)
            }
            ContactPlace::Touch(i) => (&mut scratch.touches, &state.touches, i),
        };
        (memory.normal_force[at], memory.tangential_force[at]) = (self.impulse[0] / h, self.impulse[1] / h);
        memory.lost_damping[at] = past.lost_damping[at] + lost(0);
        memory.lost_friction[at] = past.lost_friction[at] + lost(1);
    }

    fn end_speeds(&self, state: &State, scratch: &Scratch, h: f64) -> [f64; 2] {
        let l = &state.links;
        let q = &state.coordinates.omega;
        std::array::from_fn(|side| {
            let of_link = |link: &OnLink| {
                let i = link.lane;
                let v = [l.vx[i] + h * scratch.ax[i], l.vy[i] + h * scratch.ay[i], l.omega[i] + h * scratch.alpha[i]];
                (0..3).map(|i| link.directions[side][i] * v[i]).sum::<f64>()
            };
            let of_bodies =
                self.coordinates.iter().map(|(k, share)| share[side] * (q[*k] + h * scratch.coordinate_alpha[*k]));
            self.link.as_ref().map_or(0.0, of_link) + of_bodies.sum::<f64>()
        })
    }
}
