//! Takes a Frame: everything about the node of a State, computed from State and Scratch and changing neither.
//!
//! Forces, friction, slides and accelerations are copied: they are what the step works with, means over the step about the node, so that the
//! forces on a link add up to its mass times its acceleration. What the law gives at the instant stands beside. Where contacts touch is
//! found again, by the exact detection of [`crate::pairs::bush_gap`]. Velocities at the node are v(n-1/2) + h/2 a_n. The ledger is read at
//! the node as well: sums up to the step before, plus half of this step's.

mod mechanism;

use super::frame::{
    BodyInfo, BodyKind, BodyShift, Channel, Contacts, Energy, FORMAT_VERSION, Feature, Frame, Header, LinkInfo, Links,
    Outline, OutlineCircle, OutlineElement, RollerInfo, Rollers, Rotors, Segment, SensorInfo,
};
use crate::assemble::AssemblyReport;
use crate::drive::Drive;
use crate::elements::body_frame::{BodyFrame, Shift};
use crate::elements::contact_law::{ContactLaw, PairRadii};
use crate::elements::link_joint::LinkJoint;
use crate::geometry::profile::{Element, Profile};
use crate::geometry::{Vec2, perp};
use crate::integrate::explicit::{ContactGroup, Scratch, rollers, shafts, touches};
use crate::integrate::{VectorKernel, vectorised};
use crate::lanes::{LANES, LaneBlock, take};
use crate::model::{ChainModel, Model};
use crate::pairs::bush_gap;
use crate::pairs::contour_body::EndShape;
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

    /// The frame at `state`, after [`crate::integrate::explicit::evaluate`].
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
    crate::integrate::explicit::evaluate(model, state, &mut scratch)?;
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
        stored_j: pair.law.elastic(penetration, radii).energy_j,
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

/// Terms of a sum over the lanes of a loop.
trait LaneTerms {
    fn count(&self) -> usize;
    fn block(&self, at: usize) -> LaneBlock;
    fn one(&self, k: usize) -> f64;
}

/// Sum in eight parts: of one part, every term waits for the one before.
#[inline(always)]
fn sum_of(terms: &impl LaneTerms) -> f64 {
    let n = terms.count();
    let mut parts = [0.0; LANES];
    let whole = n - n % LANES;
    for at in (0..whole).step_by(LANES) {
        let block = terms.block(at);
        for i in 0..LANES {
            parts[i] += block[i];
        }
    }
    for i in whole..n {
        parts[i - whole] += terms.one(i);
    }
    parts.iter().sum()
}

/// Values of a column.
struct ColumnTerms<'a>(&'a [f64]);

impl LaneTerms for ColumnTerms<'_> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.0.len()
    }

    #[inline(always)]
    fn block(&self, at: usize) -> LaneBlock {
        take(self.0, at)
    }

    #[inline(always)]
    fn one(&self, k: usize) -> f64 {
        self.0[k]
    }
}

/// Kinetic energies of links: velocities, mass, inertia, inverse mass.
struct KineticTerms<'a>([&'a [f64]; 6]);

#[inline(always)]
fn kinetic(vx: f64, vy: f64, omega: f64, [mass, inertia, inverse_mass]: [f64; 3]) -> f64 {
    let energy_j = 0.5 * (mass * (vx * vx + vy * vy) + inertia * omega * omega);
    if inverse_mass == 0.0 { 0.0 } else { energy_j }
}

impl LaneTerms for KineticTerms<'_> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.0[0].len()
    }

    #[inline(always)]
    fn block(&self, at: usize) -> LaneBlock {
        let [vx, vy, omega, mass, inertia, inverse_mass] = self.0.map(|column| take(column, at));
        let mut block = [0.0; LANES];
        for i in 0..LANES {
            block[i] = kinetic(vx[i], vy[i], omega[i], [mass[i], inertia[i], inverse_mass[i]]);
        }
        block
    }

    #[inline(always)]
    fn one(&self, k: usize) -> f64 {
        let [vx, vy, omega, inertial @ ..] = self.0.map(|column| column[k]);
        kinetic(vx, vy, omega, inertial)
    }
}

/// Elastic energies of joints, whose ends are at x, x, y, y.
struct StretchTerms<'a>(&'a LinkJoint, [&'a [f64]; 4]);

impl LaneTerms for StretchTerms<'_> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.1[0].len()
    }

    #[inline(always)]
    fn block(&self, at: usize) -> LaneBlock {
        let mut block = [0.0; LANES];
        for i in 0..LANES {
            block[i] = self.one(at + i);
        }
        block
    }

    #[inline(always)]
    fn one(&self, k: usize) -> f64 {
        let [front_x, rear_x, front_y, rear_y] = self.1.map(|column| column[k]);
        self.0.force(front_x - rear_x, front_y - rear_y, 0.0, 0.0).stored
    }
}

/// Sum over links and rollers of a column that all lanes have; zero of one that is not kept.
#[inline(always)]
fn sum_own(chain: &ChainModel, column: &[f64]) -> f64 {
    let mut sum = 0.0;
    let own = chain.loops.iter().chain(chain.rollers.iter().filter(|r| !r.is_empty()));
    for own in own.filter(|_| !column.is_empty()) {
        sum += sum_of(&ColumnTerms(&column[own.clone()]));
    }
    sum
}

/// Kinetic energy of rollers that are bodies of their own [J].
fn kinetic_of_rollers(model: &Model, state: &State, scratch: &Scratch) -> f64 {
    let (c, s, half) = (&model.chain, &state.links, 0.5 * model.step_s);
    let of = |i: usize| {
        let at_node = |v: &[f64], a: &[f64]| v[i] + half * a[i];
        let (vx, vy) = (at_node(&s.vx, &scratch.ax), at_node(&s.vy, &scratch.ay));
        kinetic(vx, vy, at_node(&s.omega, &scratch.alpha), [c.mass[i], c.inertia[i], c.inverse_mass[i]])
    };
    c.all_rollers().map(of).sum()
}

/// All energies at the node; losses and work since the State's ledger was opened.
fn ledger(node: &Node<'_>, links: &Links, rows: &SortedContacts) -> Energy {
    vectorised(node.scratch.isa, LedgerKernel { node, links, rows })
}

struct LedgerKernel<'a> {
    node: &'a Node<'a>,
    links: &'a Links,
    rows: &'a SortedContacts,
}

impl VectorKernel for LedgerKernel<'_> {
    type Output = Energy;

    #[inline(always)]
    fn run(self) -> Energy {
        let LedgerKernel { node, links, rows } = self;
        let Node { model, state, scratch, .. } = *node;
        let (c, h) = (&model.chain, model.step_s);
        let [(front_x, rear_x), (front_y, rear_y)] = scratch.joint_ends();
        let (mut kinetic_j, mut elastic_joint_j, mut first) = (0.0, 0.0, 0);
        for own in &c.loops {
            let n = own.len();
            let [vx, vy, omega] = [&links.vx_m_s, &links.vy_m_s, &links.omega_rad_s].map(|v| &v[first..first + n]);
            let [mass, inertia, inverse_mass] = [&c.mass, &c.inertia, &c.inverse_mass].map(|v| &v[own.clone()]);
            kinetic_j += sum_of(&KineticTerms([vx, vy, omega, mass, inertia, inverse_mass]));
            let ends = [front_x, rear_x, front_y, rear_y].map(|v| &v[own.clone()]);
            elastic_joint_j += sum_of(&StretchTerms(c.joint(own.start), ends));
            first += n;
        }
        let mut e = Energy { kinetic_j, elastic_joint_j, ..Energy::default() };
        shafts::add_energies(model, state, scratch, &mut e);
        let [stored_j, damping_j, friction_j] = touches::energies(model, state, scratch);
        if let Some(oil) = &model.oil {
            e.elastic_oil_j = oil.stored_j(&state.oil);
            e.lost_oil_j = state.oil.lost_j.iter().sum();
            e.work_oil_j = state.oil.work_j.iter().sum();
        }
        e.elastic_contact_j = rows.iter().map(|r| r.stored_j).sum::<f64>() + stored_j;
        (e.lost_contact_damping_j, e.lost_contact_friction_j) = (damping_j, friction_j);
        if c.has_rollers() {
            let [stored_j, damping_j, friction_j] = rollers::energies(model, state, scratch);
            e.kinetic_j += kinetic_of_rollers(model, state, scratch);
            e.elastic_contact_j += stored_j;
            e.lost_contact_damping_j += damping_j;
            e.lost_contact_friction_j += friction_j;
        }
        let (pin_damping, pin_friction) = scratch.joint_powers();
        e.lost_pin_damping_j = sum_own(c, &state.lost_pin_damping) + 0.5 * h * sum_own(c, pin_damping);
        e.lost_pin_friction_j = sum_own(c, &state.lost_pin_friction) + 0.5 * h * sum_own(c, pin_friction);
        // Totals before and after this step: at the node in its middle, their mean.
        // Behind the last link of a loop stands a ghost of its first: what that loses is nobody's.
        for part in ContactGroup::in_model(model) {
            let (past, now) = (part.past_memory(state), scratch.memory(part));
            let damping = 0.5 * (sum_own(c, &past.lost_damping) + sum_own(c, &now.lost_damping));
            let friction = 0.5 * (sum_own(c, &past.lost_friction) + sum_own(c, &now.lost_friction));
            if part.is_on_guides() {
                e.lost_guide_damping_j += damping;
                e.lost_guide_friction_j += friction;
            } else {
                e.lost_contact_damping_j += damping;
                e.lost_contact_friction_j += friction;
            }
        }
        e
    }
}

/// The ledger since `origin`; stored energies stay absolute.
fn since(now: &Energy, origin: &Energy) -> Energy {
    let mut e = *now;
    e.each_with(origin, |account, now, before| if account.kind.is_stored() { now } else { now - before });
    e.error_j = e.put_in_j() - e.work_out_j - e.lost_j() - (e.stored_j() - origin.stored_j());
    e
}

/// The header of a run.
pub fn header(drive: &Drive, model: &Model, report: &AssemblyReport, steps_per_frame: u64) -> Header {
    header_of(drive, model, report.static_mean_tension_n, report.lines(), steps_per_frame)
}

/// As [`header`], for a run that goes on from a recorded State.
pub fn header_of(
    drive: &Drive,
    model: &Model,
    static_tension_n: f64,
    assembly: Vec<String>,
    steps_per_frame: u64,
) -> Header {
    let mut header = Header {
        format_version: FORMAT_VERSION,
        program: concat!("pitchline ", env!("CARGO_PKG_VERSION")).to_string(),
        drive_name: drive.name.clone(),
        drive_text: drive.text.clone(),
        overrides: drive.overrides.clone(),
        step_s: model.step_s,
        steps_per_frame,
        links: model
            .chain
            .links()
            .map(|i| LinkInfo {
                outline: model.row_of(i) as u32,
                ahead: model.chain.number_of(model.chain.next(i)) as u32,
                pitch_m: 2.0 * model.chain.lever[i],
                mass_kg: model.chain.mass[i],
                inertia_kg_m2: model.chain.inertia[i],
            })
            .collect(),
        link_outlines: model
            .rows
            .iter()
            .enumerate()
            .map(|(k, r)| {
                // Of several chains each has rows of the same names.
                let chain = model.row_ranges.iter().position(|rows| rows.contains(&k)).unwrap_or(0);
                let own = drive.chain_names.get(chain).map_or(String::new(), |name| format!("{name} "));
                outline(&format!("{own}{}", r.name), &r.plate, &r.circles)
            })
            .collect(),
        bodies: bodies(drive, model),
        rollers: roller_infos(model),
        channels: super::frame::channels()
            .map(|c| Channel { name: c.channel.into(), unit: c.unit.into(), meaning: c.meaning.into() })
            .collect(),
        chain_speed_m_s: model.chain_speed_m_s(),
        static_tension_n,
        assembly,
        parent: None,
        ledger_origin: None,
        coordinates: model.coordinates[..model.n_turning()].iter().map(|c| c.path.clone()).collect(),
        sensors: drive
            .sensors
            .iter()
            .map(|s| SensorInfo { path: s.path.clone(), unit: s.reads.unit().to_string() })
            .collect(),
        ..Header::default()
    };
    mechanism::name_rows(model, &mut header);
    header
}

/// Rollers that are bodies of their own.
fn roller_infos(model: &Model) -> Vec<RollerInfo> {
    let c = &model.chain;
    let of = |lane: usize| {
        let shape = c.roller_shapes[c.loop_of(lane)]?;
        Some(RollerInfo {
            joint: c.number_of(c.joint_of(lane)) as u32,
            link: c.number_of(c.bush_carrier(lane).0) as u32,
            radius_m: shape.radius_m,
            bore_radius_m: shape.bush_radius_m + shape.clearance_m,
            mass_kg: c.mass[lane],
            inertia_kg_m2: c.inertia[lane],
        })
    };
    c.all_rollers().filter_map(of).collect()
}

/// Sprockets, guides, rails, then what no chain touches.
pub fn bodies(drive: &Drive, model: &Model) -> Vec<BodyInfo> {
    let mut bodies: Vec<BodyInfo> = model
        .sprockets
        .iter()
        .enumerate()
        .map(|(k, s)| BodyInfo {
            path: format!("sprockets.{}", s.name),
            rotor: true,
            coordinate: Some(s.coordinate as u32),
            x_m: s.frame.origin.x,
            y_m: s.frame.origin.y,
            shifts: shifts(model, &s.frame),
            angle_rad: 0.0,
            teeth: s.geometry.teeth(),
            kind: BodyKind::Sprocket as u32,
            outline: s.geometry.profile().map(|p| outline(&s.name, &p, &sprocket_circles(model, k))),
            ..BodyInfo::default()
        })
        .collect();
    bodies.extend(model.guides.iter().map(|g| BodyInfo {
        path: format!("guides.fixed.{}", g.name),
        kind: BodyKind::Guide as u32,
        x_m: g.geometry.origin.x,
        y_m: g.geometry.origin.y,
        angle_rad: g.geometry.angle_rad(),
        shifts: shifts(model, &g.frame),
        outline: g.geometry.profile().ok().map(|p| outline(&g.name, &p, &[])),
        ..BodyInfo::default()
    }));
    bodies.extend(model.rails.iter().map(|r| BodyInfo {
        path: format!("guides.rail.{}", r.name),
        kind: BodyKind::Rail as u32,
        coordinate: r.frame.turn.map(|q| q as u32),
        x_m: r.frame.origin.x,
        y_m: r.frame.origin.y,
        shifts: shifts(model, &r.frame),
        outline: Some(outline(&r.name, &r.rail.profile, &[])),
        ..BodyInfo::default()
    }));
    bodies.extend(mechanism::bodies(drive, model));
    bodies.extend(mechanism::chains_of_spans(drive, model));
    bodies
}

/// What shifts a frame, by the rows of `Sliders`.
fn shifts(model: &Model, frame: &BodyFrame) -> Vec<BodyShift> {
    let of = |s: &Shift| BodyShift {
        slider: (s.coordinate - model.n_turning()) as u32,
        direction_x: s.direction.x,
        direction_y: s.direction.y,
    };
    frame.shifts.iter().map(of).collect()
}

/// Bore, and the ring of an abutment chain: the circle its lobes stand on, which rise from it by some 60 um.
fn sprocket_circles(model: &Model, k: usize) -> Vec<(Vec2, f64)> {
    let mut circles = vec![(Vec2::zeros(), 0.4 * model.sprockets[k].geometry.root_radius_m())];
    for body in model.end_bodies.iter().filter(|b| b.body == k) {
        match &body.shape {
            EndShape::Circle { radius_m } => circles.push((Vec2::zeros(), *radius_m)),
            EndShape::Lobes { ring, .. } => circles.push((Vec2::zeros(), ring.valley_radius_m)),
            EndShape::Face { .. } | EndShape::OuterFlanks { .. } | EndShape::InnerFlanks { .. } => {}
        }
    }
    circles
}

fn outline(name: &str, profile: &Profile, circles: &[(Vec2, f64)]) -> Outline {
    let elements = profile.elements().iter().map(outline_element).collect();
    Outline {
        name: name.to_string(),
        elements,
        closed: profile.is_closed(),
        circles: circles
            .iter()
            .map(|(c, radius_m)| OutlineCircle { x_m: c.x, y_m: c.y, radius_m: *radius_m })
            .collect(),
    }
}

fn outline_element(e: &Element) -> OutlineElement {
    let (start, end) = (e.start(), e.end());
    let (centre, radius_m, sweep_rad) = match *e {
        Element::Line { .. } => (Vec2::zeros(), 0.0, 0.0),
        Element::Arc { centre, radius_m, sweep_rad, .. } => (centre, radius_m, sweep_rad),
    };
    OutlineElement {
        start_x_m: start.x,
        start_y_m: start.y,
        end_x_m: end.x,
        end_y_m: end.y,
        centre_x_m: centre.x,
        centre_y_m: centre.y,
        radius_m,
        sweep_rad,
    }
}
