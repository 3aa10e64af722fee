//! Takes a Frame: everything about the node of a State, computed from State and Scratch and changing neither.
//!
//! Forces, friction, slides and accelerations are copied: they are what the step works with, means over the step about the node, so that the
//! forces on a link add up to its mass times its acceleration. What the law gives at the instant stands beside. Where contacts touch is
//! found again, by the exact detection of [`crate::pairs::bush_gap`]. Velocities at the node are v(n-1/2) + h/2 a_n. The ledger is read at
//! the node as well: sums up to the step before, plus half of this step's.

mod header;
mod ledger;
mod mechanism;
mod valves;

use header::outline_element;
pub use header::{bodies, header, header_of};
pub(crate) use ledger::kinetic_of_impacts;
use ledger::{ledger, since};

use super::frame::{Contacts, Energy, Feature, Frame, Links, Rollers, Rotors, Segment};
use crate::elements::contact_law::{ContactLaw, PairRadii};
use crate::geometry::{Vec2, perp};
use crate::integrate::explicit::{ContactGroup, Scratch};
use crate::model::{ChainModel, Model};
use crate::pairs::bush_gap;
use crate::pairs::plate_rail::law_radius_m;
use crate::state::State;
use crate::units::direction;
use std::ops::Range;

/// Takes frames of one run; remembers where its ledger began.
#[derive(Clone, Debug, Default)]
pub struct Camera {
    origin: Option<Energy>,
    /// Frames that nobody needs any more: their memory is used again. Asking the system for 40 columns a frame took a tenth of a
    /// recorded run.
    spare: Vec<Frame>,
    rows: SortedContacts,
}

/// Contacts of a node, and the order in which they are recorded: by link, feature, body.
#[derive(Clone, Debug, Default)]
struct SortedContacts {
    rows: Vec<Row>,
    /// Sorted instead of the rows, which are long.
    order: Vec<((usize, Feature, usize), usize)>,
}

impl SortedContacts {
    fn find(&mut self, node: &Node<'_>) {
        self.rows.clear();
        sprocket_contacts(node, &mut self.rows);
        guide_contacts(node, &mut self.rows);
        rail_contacts(node, &mut self.rows);
        end_contacts(node, &mut self.rows);
        let keys = self.rows.iter().enumerate().map(|(i, r)| ((r.link, r.feature, r.body), i));
        fill(&mut self.order, keys);
        self.order.sort_unstable();
    }

    fn iter(&self) -> impl Iterator<Item = &Row> {
        self.order.iter().map(|(_, i)| &self.rows[*i])
    }
}

/// A State at its node, after its evaluation.
struct Node<'a> {
    model: &'a Model,
    state: &'a State,
    scratch: &'a Scratch,
    /// The lane of the one link whose contacts are asked for; None: all.
    only: Option<usize>,
}

impl Node<'_> {
    fn is_asked(&self, link: usize) -> bool {
        self.model.chain.is_link(link) && self.only.is_none_or(|only| only == link)
    }

    /// Of a coordinate, at the node [rad/s].
    fn speed(&self, coordinate: usize) -> f64 {
        self.state.coordinates.omega[coordinate] + 0.5 * self.model.step_s * self.scratch.coordinate_alpha[coordinate]
    }

    /// One end of link `i`.
    fn end(&self, i: usize, front: bool) -> Vec2 {
        let s = &self.state.links;
        let lever = self.model.chain.lever[i] * if front { 1.0 } else { -1.0 };
        Vec2::new(s.x[i] + s.cos[i] * lever, s.y[i] + s.sin[i] * lever)
    }
}

/// One contact before it is put into columns.
#[derive(Clone, Debug)]
struct Row {
    /// Its lane.
    link: usize,
    feature: Feature,
    body: usize,
    tooth: u32,
    segment: Segment,
    on_body: Vec2,
    on_link: Vec2,
    normal: Vec2,
    penetration: f64,
    approach: f64,
    normal_speed: f64,
    slide: f64,
    normal_force: f64,
    friction_force: f64,
    instant_force: f64,
    stick: bool,
    age_s: f64,
    stored_j: f64,
}

/// What touches: a part of a link with its radius of curvature there, and the law between it and the body.
struct Pair<'a> {
    link: usize,
    feature: Feature,
    body: usize,
    radius: f64,
    law: &'a ContactLaw,
    friction: f64,
    part: ContactGroup,
    lane: usize,
}

impl Camera {
    /// Energies when the ledger was opened; None before the first frame.
    pub fn origin(&self) -> Option<&Energy> {
        self.origin.as_ref()
    }

    /// For frames whose ledger was opened with these energies.
    pub fn since(origin: Option<Energy>) -> Camera {
        Camera { origin, ..Camera::default() }
    }

    /// The frame at `state`, after [`crate::integrate::scheme::evaluate`].
    pub fn take(&mut self, model: &Model, state: &State, scratch: &Scratch) -> Frame {
        let mut frame = self.spare.pop().unwrap_or_default();
        fill_links(model, state, scratch, &mut frame.links);
        let (x, y, torque) = scratch.joint_columns();
        let chain = &model.chain;
        fill_lanes(&mut frame.joints.force_x_n, chain, |own| x[own.start + 1..own.end + 1].iter().copied());
        fill_lanes(&mut frame.joints.force_y_n, chain, |own| y[own.start + 1..own.end + 1].iter().copied());
        fill_lanes(&mut frame.joints.friction_torque_nm, chain, |own| {
            torque[own.start + 1..own.end + 1].iter().copied()
        });
        let node = Node { model, state, scratch, only: None };
        self.rows.find(&node);
        fill_rotors(&node, &mut frame.rotors);
        fill_rollers(model, state, scratch, &mut frame.rollers);
        mechanism::fill_sliders(model, state, scratch, &mut frame.sliders);
        mechanism::fill_touches(model, state, scratch, &mut frame.touches);
        mechanism::fill_oil(model, state, scratch, (&mut frame.chambers, &mut frame.passages));
        mechanism::fill_spans(model, state, &mut frame.spans);
        let total = ledger(&node, &frame.links, &self.rows);
        frame.energy = since(&total, self.origin.get_or_insert(total));
        fill_contacts(chain, &self.rows, &mut frame.contacts);
        frame.step = state.step;
        frame.t_s = state.step as f64 * model.step_s;
        frame.state_hash = state.hash();
        frame.crank_angle_rad = model.crank_angle_rad(state.step);
        fill(&mut frame.sensors, model.sensors.iter().map(|s| crate::sensing::read(model, state, scratch, *s)));
        frame.round_to_stored(scratch.isa);
        frame
    }

    /// Takes a frame back that is not needed any more.
    pub fn give_back(&mut self, frame: Frame) {
        self.spare.push(frame);
    }
}

/// New values for a column that keeps its memory.
fn fill<T>(column: &mut Vec<T>, values: impl Iterator<Item = T>) {
    column.clear();
    column.extend(values);
}

/// As [`fill`], from the lanes of one loop after the other.
fn fill_lanes<I: Iterator<Item = f64>>(column: &mut Vec<f64>, chain: &ChainModel, values: impl Fn(Range<usize>) -> I) {
    column.clear();
    for own in &chain.loops {
        column.extend(values(own.clone()));
    }
}

/// All energies at `state`: where a ledger begins that is opened there.
pub fn ledger_at(model: &Model, state: &State) -> Result<Energy, crate::integrate::StepError> {
    let mut scratch = Scratch::new(model);
    crate::integrate::scheme::evaluate(model, state, &mut scratch)?;
    let (mut links, mut rows) = (Links::default(), SortedContacts::default());
    fill_links(model, state, &scratch, &mut links);
    let node = Node { model, state, scratch: &scratch, only: None };
    rows.find(&node);
    Ok(ledger(&node, &links, &rows))
}

/// The contacts alone, for looking at every step; of one link where one is given.
pub fn contacts_of(model: &Model, state: &State, scratch: &Scratch, only: Option<usize>) -> Contacts {
    let (mut rows, mut contacts) = (SortedContacts::default(), Contacts::default());
    rows.find(&Node { model, state, scratch, only: only.map(|link| model.chain.lane_of(link)) });
    fill_contacts(&model.chain, &rows, &mut contacts);
    contacts
}

fn fill_links(model: &Model, state: &State, scratch: &Scratch, links: &mut Links) {
    let (chain, half) = (&model.chain, 0.5 * model.step_s);
    let s = &state.links;
    let at_node = |column: &mut Vec<f64>, v: &[f64], a: &[f64]| {
        fill_lanes(column, chain, |own| v[own.clone()].iter().zip(&a[own]).map(|(v, a)| v + half * a));
    };
    let as_is = |column: &mut Vec<f64>, v: &[f64]| fill_lanes(column, chain, |own| v[own].iter().copied());
    as_is(&mut links.x_m, &s.x);
    as_is(&mut links.y_m, &s.y);
    fill_lanes(&mut links.angle_rad, chain, |own| {
        s.sin[own.clone()].iter().zip(&s.cos[own]).map(|(sin, cos)| direction(*sin, *cos))
    });
    at_node(&mut links.vx_m_s, &s.vx, &scratch.ax);
    at_node(&mut links.vy_m_s, &s.vy, &scratch.ay);
    at_node(&mut links.omega_rad_s, &s.omega, &scratch.alpha);
    as_is(&mut links.ax_m_s2, &scratch.ax);
    as_is(&mut links.ay_m_s2, &scratch.ay);
    as_is(&mut links.alpha_rad_s2, &scratch.alpha);
}

fn fill_rollers(model: &Model, state: &State, scratch: &Scratch, rollers: &mut Rollers) {
    let (half, s) = (0.5 * model.step_s, &state.links);
    let lanes = || model.chain.all_rollers();
    let as_is = |column: &mut Vec<f64>, v: &[f64]| fill(column, lanes().map(|i| v[i]));
    let at_node = |column: &mut Vec<f64>, v: &[f64], a: &[f64]| fill(column, lanes().map(|i| v[i] + half * a[i]));
    as_is(&mut rollers.x_m, &s.x);
    as_is(&mut rollers.y_m, &s.y);
    at_node(&mut rollers.vx_m_s, &s.vx, &scratch.ax);
    at_node(&mut rollers.vy_m_s, &s.vy, &scratch.ay);
    at_node(&mut rollers.omega_rad_s, &s.omega, &scratch.alpha);
    as_is(&mut rollers.ax_m_s2, &scratch.ax);
    as_is(&mut rollers.ay_m_s2, &scratch.ay);
    as_is(&mut rollers.alpha_rad_s2, &scratch.alpha);
    let bores = &scratch.bores;
    as_is(&mut rollers.force_x_n, &bores.force_x);
    as_is(&mut rollers.force_y_n, &bores.force_y);
    as_is(&mut rollers.moment_nm, &bores.moment);
    as_is(&mut rollers.bush_moment_nm, &bores.bush_moment);
    as_is(&mut rollers.penetration_m, &bores.depth);
    as_is(&mut rollers.slide_m_s, &bores.slide);
}

fn sprocket_contacts(node: &Node<'_>, rows: &mut Vec<Row>) {
    let Node { model, state, scratch, .. } = *node;
    let memory = scratch.memory(ContactGroup::Bushes);
    for (k, sprocket) in model.sprockets.iter().enumerate() {
        let q = sprocket.coordinate;
        let (cos, sin) = (state.coordinates.cos[q], state.coordinates.sin[q]);
        let origin = sprocket.frame.origin_at(&state.coordinates.angle);
        let to_world = |v: Vec2| Vec2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y);
        let Some(teeth) = sprocket.geometry.iso() else { continue };
        for (j, tooth) in scratch.joints_near(k).filter(|(j, _)| memory.age[*j] != 0.0) {
            if !model.chain.is_body(j) || !scratch.is_contact(ContactGroup::Bushes, j) {
                continue;
            }
            let (link, front) = model.chain.bush_carrier(j);
            if !node.is_asked(link) {
                continue;
            }
            let is_roller = model.chain.is_roller(j);
            let p = if is_roller { Vec2::new(state.links.x[j], state.links.y[j]) } else { node.end(link, front) };
            let d = p - origin;
            let in_frame = Vec2::new(cos * d.x + sin * d.y, cos * d.y - sin * d.x);
            let axis = Vec2::new(sprocket.body.seat_cos[tooth as usize], sprocket.body.seat_sin[tooth as usize]);
            let hit = bush_gap::contact_in_gap(teeth, (tooth, axis), in_frame, sprocket.body.bush_radius_m);
            let pair = Pair {
                link,
                feature: Feature::at_teeth(front, is_roller),
                body: k,
                radius: sprocket.body.bush_radius_m,
                law: &sprocket.body.law,
                friction: sprocket.body.friction,
                part: ContactGroup::Bushes,
                lane: j,
            };
            let on_body = to_world(hit.touch.on_body) + origin;
            let normal = to_world(hit.touch.normal);
            let shape = (hit.tooth, hit.segment, hit.body_radius_m);
            let points = (on_body, p - normal * pair.radius);
            rows.push(row(node, &pair, shape, points, normal));
        }
    }
}

fn guide_contacts(node: &Node<'_>, rows: &mut Vec<Row>) {
    let Node { model, state, scratch, .. } = *node;
    for (k, guide) in model.guides.iter().enumerate().filter(|(_, g)| g.body.touches_plates) {
        let b = &guide.body;
        let (up, origin) = (perp(b.along), guide.frame.origin_at(&state.coordinates.angle));
        for front in [false, true] {
            let part = ContactGroup::Guides(2 * b.side + usize::from(!front));
            // Most links near a guide do not touch it.
            let ages = &scratch.memory(part).age;
            for link in scratch.links_near(model, k).filter(|link| ages[*link] != 0.0) {
                if !node.is_asked(link) || !scratch.is_contact(part, link) {
                    continue;
                }
                let p = node.end(link, front);
                let d = p - origin;
                let (along, above) = (d.dot(&b.along), d.dot(&up));
                let foot = along.clamp(0.0, b.length_m);
                let from = Vec2::new(along - foot, above + b.end_radius_m);
                let distance = from.norm();
                let normal = (b.along * from.x + up * from.y) / distance;
                let pair = Pair {
                    link,
                    feature: if front { Feature::FrontPlateEnd } else { Feature::RearPlateEnd },
                    body: model.sprockets.len() + k,
                    radius: b.plate_radius_m,
                    law: &b.law,
                    friction: b.friction,
                    part,
                    lane: link,
                };
                let on_body = p - normal * (distance - b.end_radius_m);
                let segment = guide.segment(along);
                let shape = (0, segment, b.end_radius_m);
                let points = (on_body, p - normal * pair.radius);
                rows.push(row(node, &pair, shape, points, normal));
            }
        }
    }
}

/// Plates on rails: where they touch is what the step has found.
fn rail_contacts(node: &Node<'_>, rows: &mut Vec<Row>) {
    let Node { model, state, scratch, .. } = *node;
    for (k, rail) in model.rails.iter().enumerate() {
        for link in scratch.links_near_rail(model, k).filter(|i| node.is_asked(*i)) {
            for part_index in [1, 0, 2] {
                let set = 3 * rail.body.side + part_index;
                let part = ContactGroup::Rails(set);
                if scratch.memory(part).age[link] == 0.0 || !scratch.is_contact(part, link) {
                    continue;
                }
                let (l, b) = (&state.links, &rail.body);
                let (along_m, piece, normal) = scratch.on_rail(set, link);
                let heading = Vec2::new(l.cos[link], l.sin[link]);
                let on_axis = Vec2::new(l.x[link], l.y[link]) + heading * along_m;
                let penetration_m = scratch.depth(part, link);
                let is_flat = part_index == 2 && along_m.abs() < model.chain.lever[link];
                let pair = Pair {
                    link,
                    feature: part.feature(model, link).1,
                    body: model.first_rail() + k,
                    radius: if is_flat { f64::INFINITY } else { b.plate_radius_m },
                    law: &b.law,
                    friction: b.friction,
                    part,
                    lane: link,
                };
                let on_link = on_axis - normal * b.plate_radius_m;
                let points = (on_link + normal * penetration_m, on_link);
                rows.push(row(node, &pair, (0, rail.segment(piece), law_radius_m(b.radius_at(piece))), points, normal));
            }
        }
    }
}

/// Links' own contours: abutments and toothed flanks.
fn end_contacts(node: &Node<'_>, rows: &mut Vec<Row>) {
    let Node { model, state, scratch, .. } = *node;
    for (k, body) in model.end_bodies.iter().enumerate() {
        scratch.end_touches(model, state, k, node.only, |link, front, t| {
            let part = ContactGroup::Contours(2 * body.set + usize::from(!front));
            if node.is_asked(link) && scratch.is_contact(part, link) {
                let point = t.point + body.frame.origin_at(&state.coordinates.angle);
                let pair = Pair {
                    link,
                    feature: body.feature(front),
                    body: body.body,
                    radius: t.link_radius_m,
                    law: &body.law,
                    friction: body.friction,
                    part,
                    lane: link,
                };
                let shape = (t.tooth, t.segment, t.body_radius_m);
                let on_body = point + t.normal * t.penetration_m;
                rows.push(row(node, &pair, shape, (on_body, point), t.normal));
            }
        });
    }
}

/// A contact.
fn row(
    node: &Node<'_>,
    pair: &Pair<'_>,
    (tooth, segment, body_radius): (u32, Segment, f64),
    (on_body, on_link): (Vec2, Vec2),
    normal: Vec2,
) -> Row {
    let (scratch, lane) = (node.scratch, pair.lane);
    let memory = scratch.memory(pair.part);
    let (penetration, rate) = (scratch.depth(pair.part, lane), scratch.closing_speed(pair.part, lane));
    let radii = PairRadii { bush_m: pair.radius, body_m: body_radius };
    let approach = memory.approach[lane];
    let (normal_force, friction_force) = (memory.normal_force[lane], memory.tangential_force[lane]);
    Row {
        link: pair.link,
        feature: pair.feature,
        body: pair.body,
        tooth,
        segment,
        on_body,
        on_link,
        normal,
        penetration,
        approach,
        normal_speed: rate,
        slide: scratch.sliding_speeds(pair.part)[lane],
        normal_force,
        friction_force,
        instant_force: pair.law.force(penetration, rate, approach, radii),
        stick: friction_force.abs() < pair.friction * normal_force,
        age_s: memory.age[lane] * node.model.step_s,
        // Where a damper would pull, the overlap that is left holds nothing.
        stored_j: if normal_force > 0.0 { pair.law.elastic(penetration, radii).energy_j } else { 0.0 },
    }
}

fn fill_contacts(chain: &ChainModel, rows: &SortedContacts, c: &mut Contacts) {
    fill(&mut c.link, rows.iter().map(|r| chain.number_of(r.link) as u32));
    fill(&mut c.feature, rows.iter().map(|r| r.feature as u32));
    fill(&mut c.body, rows.iter().map(|r| r.body as u32));
    fill(&mut c.tooth, rows.iter().map(|r| r.tooth));
    fill(&mut c.segment, rows.iter().map(|r| r.segment as u32));
    fill(&mut c.point_body_x_m, rows.iter().map(|r| r.on_body.x));
    fill(&mut c.point_body_y_m, rows.iter().map(|r| r.on_body.y));
    fill(&mut c.point_link_x_m, rows.iter().map(|r| r.on_link.x));
    fill(&mut c.point_link_y_m, rows.iter().map(|r| r.on_link.y));
    fill(&mut c.normal_x, rows.iter().map(|r| r.normal.x));
    fill(&mut c.normal_y, rows.iter().map(|r| r.normal.y));
    fill(&mut c.penetration_m, rows.iter().map(|r| r.penetration));
    fill(&mut c.approach_speed_m_s, rows.iter().map(|r| r.approach));
    fill(&mut c.normal_speed_m_s, rows.iter().map(|r| r.normal_speed));
    fill(&mut c.tangential_speed_m_s, rows.iter().map(|r| r.slide));
    fill(&mut c.normal_force_n, rows.iter().map(|r| r.normal_force));
    fill(&mut c.tangential_force_n, rows.iter().map(|r| r.friction_force));
    fill(&mut c.age_s, rows.iter().map(|r| r.age_s));
    fill(&mut c.stick, rows.iter().map(|r| r.stick));
    fill(&mut c.instant_force_n, rows.iter().map(|r| r.instant_force));
}

fn fill_rotors(node: &Node<'_>, rotors: &mut Rotors) {
    let Node { model, state, scratch, .. } = *node;
    // Sliders are no rotors: sensors read them.
    let n = model.n_turning();
    fill(&mut rotors.angle_rad, state.coordinates.angle[..n].iter().copied());
    fill(&mut rotors.speed_rad_s, (0..n).map(|k| node.speed(k)));
    fill(&mut rotors.chain_torque_nm, scratch.chain_torque[..n].iter().copied());
    let outer = model.coordinates[..n].iter().enumerate().map(|(k, coordinate)| {
        coordinate.outer_force(
            state.coordinates.angle[k],
            node.speed(k),
            scratch.chain_torque[k],
            scratch.parts_force()[k],
        )
    });
    fill(&mut rotors.outer_torque_nm, outer);
}
