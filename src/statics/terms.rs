//! What adds to the potential energy at rest: each adds its energy, its gradient and its curvature to the system.

use super::{Configuration, System, joint_offset};
use crate::elements::body_frame::BodyFrame;
use crate::elements::contact_law::{ContactLaw, Elastic, PairRadii};
use crate::elements::coordinate::CoordinateKind;
use crate::elements::coupling::Coupling;
use crate::elements::span::ChainSpan;
use crate::geometry::{Vec2, perp, rotated, unit};
use crate::integrate::explicit::ends::{EndFinder, LinkPoses};
use crate::model::{BladeModel, GuideModel, Model, RailModel};
use crate::pairs::bush_gap;
use crate::pairs::contour_body::{EndTouch, FAR_M};
use crate::pairs::part_part::{Touch, TouchShape};
use crate::pairs::plate_blade::BladePoint;
use crate::pairs::plate_rail::{PlatePart, law_radius_m};
use crate::pairs::roller_bush::RestingBush;
use crate::units::sin_cos;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// What is to stand still: a model under some of its load, and the sprockets that are free to turn.
pub(super) struct StaticProblem<'a> {
    pub(super) model: &'a Model,
    pub(super) free: Vec<usize>,
    load_factor: f64,
    of: SystemOf,
    finder: EndFinder,
}

/// What a system is the matrix of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SystemOf {
    /// The potential energy: forces, stiffness. Contacts count with this share, 1 for those that the drive has.
    Potential { contacts: f64 },
    /// The dampers, each where its spring stands: damping in place of stiffness, and no forces.
    Dampers,
}

impl SystemOf {
    /// What a contact gives that rests with this force and stiffness.
    fn contact(self, elastic: Elastic, law: &ContactLaw) -> Elastic {
        match self {
            SystemOf::Potential { contacts } => scaled(elastic, contacts),
            SystemOf::Dampers => damper(law.damping_at(elastic.force_n)),
        }
    }

    fn pick(self, stiffness: f64, damping: f64) -> f64 {
        match self {
            SystemOf::Potential { .. } => stiffness,
            SystemOf::Dampers => damping,
        }
    }
}

fn scaled(e: Elastic, share: f64) -> Elastic {
    Elastic { force_n: e.force_n * share, stiffness_n_per_m: e.stiffness_n_per_m * share, energy_j: e.energy_j * share }
}

fn damper(damping: f64) -> Elastic {
    Elastic { force_n: 0.0, stiffness_n_per_m: damping, energy_j: 0.0 }
}

impl<'a> StaticProblem<'a> {
    pub(super) fn new(model: &'a Model, free: Vec<usize>, load_factor: f64) -> StaticProblem<'a> {
        StaticProblem::of_contacts(model, free, load_factor, 1.0)
    }

    /// The same with contacts of this share of their stiffness.
    pub(super) fn of_contacts(
        model: &'a Model,
        free: Vec<usize>,
        load_factor: f64,
        contacts: f64,
    ) -> StaticProblem<'a> {
        StaticProblem { model, free, load_factor, of: SystemOf::Potential { contacts }, finder: EndFinder::new(model) }
    }

    /// The dampers of the same in place of its springs.
    pub(super) fn of_dampers(model: &'a Model, free: Vec<usize>) -> StaticProblem<'a> {
        StaticProblem { of: SystemOf::Dampers, ..StaticProblem::new(model, free, 1.0) }
    }

    pub(super) fn system(&mut self, q: &Configuration) -> System {
        let StaticProblem { model, free, load_factor, of, finder } = self;
        let (model, load_factor, of) = (*model, *load_factor, *of);
        let n = model.chain.lanes;
        let mut s = System {
            loops: model.chain.loops.iter().filter(|l| !l.is_empty()).cloned().collect(),
            gradient: vec![Vector3::zeros(); n],
            diagonal: vec![Matrix3::zeros(); n],
            next: vec![Matrix3::zeros(); n],
            columns: vec![vec![Vector3::zeros(); n]; free.len()],
            rotor_gradient: DVector::zeros(free.len()),
            rotors: DMatrix::zeros(free.len(), free.len()),
            energy: 0.0,
            of,
        };
        for j in model.chain.links() {
            add_joint(model, q, j, &mut s);
        }
        for (c, index) in free.iter().enumerate() {
            let coordinate = &model.coordinates[*index];
            if of == SystemOf::Dampers {
                s.rotors[(c, c)] += coordinate.spring.damping + model.load_damping(*index);
                continue;
            }
            // The constant springs of sliders are no loads.
            let share = if coordinate.kind == CoordinateKind::Turns { load_factor } else { 1.0 };
            let load = coordinate.load() + model.mean_load(*index);
            let (torque, angle) = (load * share + coordinate.rest_load, q.coordinates[*index]);
            s.energy += coordinate.spring.energy_j(angle) - torque * angle;
            s.rotor_gradient[c] -= torque + coordinate.spring.force(angle);
            s.rotors[(c, c)] += coordinate.spring.stiffness;
        }
        for coupling in &model.couplings {
            add_coupling(coupling, q, free, &mut s);
        }
        for span in &model.spans {
            add_span(span, q, free, &mut s);
        }
        for sprocket in &model.sprockets {
            let columns = FrameColumns::new(&sprocket.frame, free);
            let Some(teeth) = sprocket.geometry.iso() else { continue };
            let bush = RestingBush::new(&sprocket.body, model.bores[sprocket.chain].as_ref());
            let reach = teeth.tip_radius_m + bush.radius_m;
            let origin = sprocket.frame.origin_at(&q.coordinates);
            for j in model.chain.loops[sprocket.chain].clone() {
                let (link, front) = model.chain.bush_carrier(j);
                let lever = model.chain.lever[link] * if front { 1.0 } else { -1.0 };
                let (p, heading) = q.links[link];
                let offset = p + unit(heading) * lever - origin;
                if offset.norm() > reach {
                    continue;
                }
                let angle = q.coordinates[sprocket.coordinate];
                let hit = bush_gap::gap_contact(teeth, rotated(offset, -angle), bush.radius_m);
                let elastic = bush.elastic(hit.touch.penetration_m, hit.body_radius_m);
                if elastic.force_n > 0.0 {
                    let elastic = match of {
                        SystemOf::Potential { contacts } => scaled(elastic, contacts),
                        SystemOf::Dampers => damper(bush.damping_n_s_per_m(elastic.force_n)),
                    };
                    let normal = rotated(hit.touch.normal, angle);
                    // Distance to the centre of curvature decides how the normal turns: convex bodies weaken, concave stiffen.
                    let bend = if hit.body_radius_m < 0.0 {
                        1.0 / (-hit.body_radius_m - bush.radius_m + hit.touch.penetration_m)
                    } else {
                        -1.0 / (hit.body_radius_m + bush.radius_m - hit.touch.penetration_m)
                    };
                    let (arm, turn) = (unit(heading) * lever, columns.turn.map(|c| (c, offset)));
                    columns.add(&mut s, link, |s| add_contact(s, link, arm, normal, elastic, bend, turn));
                }
            }
        }
        for guide in model.guides.iter().filter(|g| g.body.touches_plates) {
            add_guide(model, q, guide, free, &mut s);
        }
        for rail in &model.rails {
            add_rail(model, q, rail, free, &mut s);
        }
        // Pawls find their teeth when the drive has its place, and lifters stand still.
        for touch in model.touches.iter().filter(|t| !matches!(t.shape, TouchShape::Between { .. })) {
            add_touch(touch, q, free, &mut s);
        }
        add_end_contacts(model, q, (free, finder), &mut s);
        s
    }
}

/// The free coordinates of a body's frame, as columns of a [`System`].
struct FrameColumns {
    turn: Option<usize>,
    /// With the direction in which each shifts the body.
    shifts: Vec<(usize, Vec2)>,
}

impl FrameColumns {
    fn new(frame: &BodyFrame, free: &[usize]) -> FrameColumns {
        let column = |k: usize| free.iter().position(|f| *f == k);
        FrameColumns {
            turn: frame.turn.and_then(column),
            shifts: frame.shifts.iter().filter_map(|s| Some((column(s.coordinate)?, s.direction))).collect(),
        }
    }

    /// Adds a contact of `link` with the body, by a function that knows the link and the body's turning. A contact depends on the difference of
    /// link and body alone, so shifting the body is shifting the link the other way.
    fn add(&self, s: &mut System, link: usize, contact: impl FnOnce(&mut System)) {
        if self.shifts.is_empty() {
            contact(s);
            return;
        }
        let turned = |s: &System| self.turn.map_or(Vector3::zeros(), |c| s.columns[c][link]);
        let (gradient, diagonal, column) = (s.gradient[link], s.diagonal[link], turned(s));
        contact(s);
        let (gradient, diagonal) = (s.gradient[link] - gradient, s.diagonal[link] - diagonal);
        let column = turned(s) - column;
        let along = |d: &Vec2| Vector3::new(d.x, d.y, 0.0);
        for (c, d) in &self.shifts {
            s.rotor_gradient[*c] -= along(d).dot(&gradient);
            s.columns[*c][link] -= diagonal * along(d);
            for (other, e) in &self.shifts {
                s.rotors[(*c, *other)] += along(d).dot(&(diagonal * along(e)));
            }
            if let Some(turn) = self.turn {
                let mixed = along(d).dot(&column);
                s.rotors[(*c, turn)] -= mixed;
                s.rotors[(turn, *c)] -= mixed;
            }
        }
    }
}

fn add_coupling(coupling: &Coupling, q: &Configuration, free: &[usize], s: &mut System) {
    let [a, b] = coupling.ends;
    let at = [q.coordinates[a], q.coordinates[b]];
    let stiffness = s.of.pick(coupling.stiffness_nm_per_rad, coupling.damping_nm_s_per_rad);
    let has_force = s.of.pick(1.0, 0.0);
    s.energy += has_force * coupling.energy_j(at);
    let (torque, _) = coupling.torques_nm(at, [0.0; 2]);
    let columns = [a, b].map(|k| free.iter().position(|f| *f == k));
    for (row, sign) in [(columns[0], 1.0), (columns[1], -1.0)] {
        let Some(row) = row else { continue };
        s.rotor_gradient[row] -= has_force * sign * torque;
        for (column, other) in [(columns[0], 1.0), (columns[1], -1.0)] {
            let Some(column) = column else { continue };
            s.rotors[(row, column)] += sign * other * stiffness;
        }
    }
}

/// A span of a chain without links; one that is slack gives nothing.
fn add_span(span: &ChainSpan, q: &Configuration, free: &[usize], s: &mut System) {
    let elongation_m = span.elongation(span.ends.map(|k| q.coordinates[k]));
    let tension_n = span.spring_n(elongation_m);
    if tension_n <= 0.0 {
        return;
    }
    let stiffness = s.of.pick(span.stiffness_n_per_m, span.damping_n_s_per_m);
    let has_force = s.of.pick(1.0, 0.0);
    s.energy += has_force * span.energy_j(elongation_m);
    let columns = span.ends.map(|k| free.iter().position(|f| *f == k));
    let levers_m = span.levers_m();
    for (row, lever_m) in columns.into_iter().zip(levers_m) {
        let Some(row) = row else { continue };
        s.rotor_gradient[row] -= has_force * lever_m * tension_n;
        for (column, other_m) in columns.into_iter().zip(levers_m) {
            let Some(column) = column else { continue };
            s.rotors[(row, column)] += lever_m * other_m * stiffness;
        }
    }
}

/// Parts that touch each other: penetration = -gap.
fn add_touch(touch: &Touch, q: &Configuration, free: &[usize], s: &mut System) {
    // Followers are held at rest on their seats, where cams that lift would press: their touch is left out.
    if matches!(touch.shape, TouchShape::Cam(_)) {
        return;
    }
    let gap = touch.shape.gap(&q.coordinates);
    let elastic = touch.law.elastic(-gap.gap_m, touch.radii);
    if elastic.force_n <= 0.0 {
        return;
    }
    let elastic = s.of.contact(elastic, &touch.law);
    s.energy += elastic.energy_j;
    let columns = gap.coordinates.map(|k| free.iter().position(|f| *f == k));
    let [first, mixed, second] = gap.bend;
    let bend = [[first, mixed], [mixed, second]];
    for (i, row) in columns.iter().enumerate() {
        let Some(row) = *row else { continue };
        s.rotor_gradient[row] -= elastic.force_n * gap.slope[i];
        for (j, column) in columns.iter().enumerate() {
            let Some(column) = *column else { continue };
            s.rotors[(row, column)] +=
                elastic.stiffness_n_per_m * gap.slope[i] * gap.slope[j] - elastic.force_n * bend[i][j];
        }
    }
}

/// Links' own contours.
fn add_end_contacts(model: &Model, q: &Configuration, (free, finder): (&[usize], &mut EndFinder), s: &mut System) {
    if model.end_bodies.is_empty() {
        return;
    }
    let poses = LinkPoses::new(model.chain.lanes, |i| {
        let (centre, heading) = q.links[i];
        let (sin, cos) = sin_cos(heading);
        (centre, cos, sin)
    });
    let mut touches = Vec::new();
    for (k, body) in model.end_bodies.iter().enumerate() {
        let (columns, origin) = (FrameColumns::new(&body.frame, free), body.frame.origin_at(&q.coordinates));
        let (sin, cos) = sin_cos(body.frame.angle_at(&q.coordinates));
        touches.clear();
        finder.find(model, (k, origin, (cos, sin)), &poses, FAR_M, |link, front, touch| {
            touches.push((link, !front, touch))
        });
        // In chain order, so that the energy's rounding does not depend on the blocks.
        touches.sort_unstable_by_key(|(link, rear, _)| (*link, *rear));
        for (link, _, touch) in &touches {
            let radii = PairRadii { bush_m: touch.link_radius_m, body_m: touch.body_radius_m };
            let elastic = body.law.elastic(touch.penetration_m, radii);
            if elastic.force_n > 0.0 {
                let elastic = s.of.contact(elastic, &body.law);
                let centre = q.links[*link].0 - origin;
                columns.add(s, *link, |s| add_end_contact(s, *link, centre, touch, elastic, columns.turn));
            }
        }
    }
}

/// One of them: two circles of curvature, or a straight part of the link on a body's circle.
fn add_end_contact(
    s: &mut System,
    link: usize,
    centre: Vec2,
    touch: &EndTouch,
    elastic: Elastic,
    column: Option<usize>,
) {
    let (normal, body_radius_m) = (touch.normal, touch.body_radius_m);
    if touch.link_radius_m.is_finite() {
        let about = touch.point + normal * touch.link_radius_m;
        let between = touch.link_radius_m + body_radius_m - touch.penetration_m;
        let bend = if between.is_finite() { -1.0 / between } else { 0.0 };
        add_contact(s, link, about - centre, normal, elastic, bend, column.map(|c| (c, about)));
        return;
    }
    // The normal turns with the link alone: penetration = rho + n.(T - P), T the centre of the body's circle.
    let force = elastic.force_n;
    let rest = if body_radius_m.is_finite() { body_radius_m - touch.penetration_m } else { 0.0 };
    let about = touch.point - normal * rest;
    let rotor = column.map(|c| (c, about));
    add_contact(s, link, about - centre, normal, elastic, 0.0, rotor);
    let tangent = perp(normal);
    let arm = about - centre;
    // What `add_contact` put in for a normal that stays: taken out, and the turning one's put in.
    s.diagonal[link][(2, 2)] -= 2.0 * force * normal.dot(&arm);
    for (axis, t) in [(0, tangent.x), (1, tangent.y)] {
        s.diagonal[link][(axis, 2)] -= force * t;
        s.diagonal[link][(2, axis)] -= force * t;
    }
    let Some((column, offset)) = rotor else { return };
    s.rotors[(column, column)] -= 2.0 * force * normal.dot(&offset);
    let turn = Vec2::new(normal.y, -normal.x);
    let mixed = Vector3::new(turn.x, turn.y, turn.dot(&perp(arm)));
    s.columns[column][link] += force * (Vector3::new(0.0, 0.0, normal.dot(&offset)) - mixed);
}

fn add_joint(model: &Model, q: &Configuration, j: usize, s: &mut System) {
    let k = model.chain.next(j);
    let (la, lb) = (model.chain.lever[j], model.chain.lever[k]);
    let (ea, eb) = (unit(q.links[j].1), unit(q.links[k].1));
    let u = joint_offset(model, q, j);
    let joint = model.chain.joint(j);
    let force = joint.force(u.x, u.y, 0.0, 0.0);
    let has_force = s.of.pick(1.0, 0.0);
    s.energy += has_force * force.stored;
    let f = Vec2::new(force.x, force.y);
    let stiffness = s.of.pick(joint.stiffness_n_per_m, joint.damping_n_s_per_m);
    // Stiffness in the direction of u and across it.
    let (along, across, direction) = if joint.clearance_m == 0.0 {
        (stiffness, stiffness, Vec2::new(1.0, 0.0))
    } else if f.norm() > 0.0 {
        (stiffness, has_force * f.norm() / u.norm(), u.normalize())
    } else {
        return;
    };
    let f = f * has_force;
    let side = perp(direction);
    // Rows of du / d(x, y, heading) for both links, in the frame (direction, side).
    let (ta, tb) = (perp(ea) * la, perp(eb) * lb);
    let rows = |sign: f64, t: Vec2, v: Vec2| Vector3::new(sign * v.x, sign * v.y, t.dot(&v));
    let (a0, a1) = (rows(1.0, ta, direction), rows(1.0, ta, side));
    let (b0, b1) = (rows(-1.0, tb, direction), rows(-1.0, tb, side));
    s.gradient[j] += Vector3::new(f.x, f.y, ta.dot(&f));
    s.gradient[k] += Vector3::new(-f.x, -f.y, tb.dot(&f));
    s.diagonal[j] += along * a0 * a0.transpose() + across * a1 * a1.transpose();
    s.diagonal[k] += along * b0 * b0.transpose() + across * b1 * b1.transpose();
    s.diagonal[j][(2, 2)] -= la * ea.dot(&f);
    s.diagonal[k][(2, 2)] -= lb * eb.dot(&f);
    s.next[j] += along * a0 * b0.transpose() + across * a1 * b1.transpose();
}

fn add_contact(
    s: &mut System,
    link: usize,
    arm: Vec2,
    normal: Vec2,
    elastic: Elastic,
    bend_per_m: f64,
    rotor: Option<(usize, Vec2)>,
) {
    let (force, stiffness) = (elastic.force_n, elastic.stiffness_n_per_m);
    s.energy += elastic.energy_j;
    let (t, tangent) = (perp(arm), perp(normal));
    // d(penetration) and tangential displacement per (x, y, heading).
    let g = Vector3::new(-normal.x, -normal.y, -normal.dot(&t));
    let h = Vector3::new(tangent.x, tangent.y, tangent.dot(&t));
    s.gradient[link] += force * g;
    s.diagonal[link] += stiffness * g * g.transpose() + force * bend_per_m * h * h.transpose();
    s.diagonal[link][(2, 2)] += force * normal.dot(&arm);
    let Some((column, offset)) = rotor else { return };
    let swing = perp(offset);
    let (g_r, h_r) = (normal.dot(&swing), -tangent.dot(&swing));
    s.rotor_gradient[column] += force * g_r;
    s.rotors[(column, column)] += stiffness * g_r * g_r + force * (bend_per_m * h_r * h_r + normal.dot(&offset));
    let turn = Vec2::new(normal.y, -normal.x);
    let mixed = Vector3::new(turn.x, turn.y, turn.dot(&t));
    s.columns[column][link] += stiffness * g_r * g + force * (bend_per_m * h_r * h + mixed);
}

/// An end of a plate that a straight guide pushes.
pub struct GuideTouch {
    /// Lane of the link.
    pub link: usize,
    pub front: bool,
    pub elastic: Elastic,
    /// Out of the guide.
    pub normal: Vec2,
    /// How the normal turns over the way along the guide [1/m].
    bend_per_m: f64,
}

fn add_guide(model: &Model, q: &Configuration, guide: &GuideModel, free: &[usize], s: &mut System) {
    let columns = FrameColumns::new(&guide.frame, free);
    for t in guide_touches(model, q, guide) {
        let elastic = s.of.contact(t.elastic, &guide.body.law);
        let lever = if t.front { model.chain.lever[t.link] } else { -model.chain.lever[t.link] };
        let (_, heading) = q.links[t.link];
        let arm = unit(heading) * lever;
        columns.add(s, t.link, |s| add_contact(s, t.link, arm, t.normal, elastic, t.bend_per_m, None));
    }
}

/// All ends of plates that a straight guide pushes.
pub fn guide_touches(model: &Model, q: &Configuration, guide: &GuideModel) -> Vec<GuideTouch> {
    let (b, origin) = (&guide.body, guide.frame.origin_at(&q.coordinates));
    let mut all = Vec::new();
    let normal = perp(b.along);
    for link in model.chain.loops[guide.chain].clone() {
        for sign in [1.0, -1.0] {
            let lever = sign * model.chain.lever[link];
            let (p, heading) = q.links[link];
            let d = p + unit(heading) * lever - origin;
            let (along, above) = (d.dot(&b.along), d.dot(&normal));
            if above.abs() > b.plate_radius_m || along < -b.relief_m || along > b.length_m + b.relief_m {
                continue;
            }
            let foot = along.clamp(0.0, b.length_m);
            let from = Vec2::new(along - foot, above + b.end_radius_m);
            let distance = from.norm();
            let penetration = b.end_radius_m + b.plate_radius_m - distance;
            let radii = PairRadii { bush_m: b.plate_radius_m, body_m: b.end_radius_m };
            let elastic = b.law.elastic(penetration, radii);
            if elastic.force_n > 0.0 {
                let n = (b.along * from.x + normal * from.y) / distance;
                let bend_per_m = if foot == along { 0.0 } else { -1.0 / distance };
                all.push(GuideTouch { link, front: sign > 0.0, elastic, normal: n, bend_per_m });
            }
        }
    }
    all
}

/// Where the three parts of every plate touch a rail: link, part, touch in the world's directions from the rail's origin, penetration
/// above zero.
pub fn rail_touches(model: &Model, q: &Configuration, rail: &RailModel) -> Vec<(usize, PlatePart, EndTouch)> {
    blade_touches(model, q, rail).into_iter().map(|(link, part, touch, _)| (link, part, touch)).collect()
}

/// A touch with the point of the blade and the contour's normal in the world, where the rail bends.
type BladeTouch = (usize, PlatePart, EndTouch, Option<(BladePoint, Vec2)>);

/// As [`rail_touches`], with where on a blade they are.
fn blade_touches(model: &Model, q: &Configuration, rail: &RailModel) -> Vec<BladeTouch> {
    let (bent, bent_m) = (rail.bent(&q.coordinates), rail.most_bent_m(&q.coordinates));
    let (angle, origin) = (rail.frame.angle_at(&q.coordinates), rail.frame.origin_at(&q.coordinates));
    let mut all = Vec::new();
    for link in model.chain.loops[rail.chain].clone() {
        let (p, heading) = &q.links[link];
        let centre = rotated(p - origin, -angle);
        let lever_m = model.chain.lever[link];
        if rail.box_distance_m(centre) > lever_m + rail.body.plate_radius_m + bent_m {
            continue;
        }
        let along = unit(heading - angle);
        for part in PlatePart::ALL {
            let found = rail.touch(bent.as_ref(), part, (centre, along), lever_m);
            let Some((t, on_blade)) = found.filter(|(t, _)| t.penetration_m > 0.0) else { continue };
            let normal = rotated(t.normal, angle);
            let on_axis = p - origin + unit(*heading) * t.along_m;
            let touch = EndTouch {
                penetration_m: t.penetration_m,
                point: on_axis - normal * rail.body.plate_radius_m,
                normal,
                link_radius_m: if t.is_flat { f64::INFINITY } else { rail.body.plate_radius_m },
                body_radius_m: t.body_radius_m,
                tooth: 0,
                segment: rail.segment(t.piece),
            };
            all.push((link, part, touch, on_blade.map(|(point, own)| (point, rotated(own, angle)))));
        }
    }
    all
}

fn add_rail(model: &Model, q: &Configuration, rail: &RailModel, free: &[usize], s: &mut System) {
    let (columns, origin) = (FrameColumns::new(&rail.frame, free), rail.frame.origin_at(&q.coordinates));
    let of_blade = rail.blade.as_ref().map(|b| (b, b.modes().map(|k| free.iter().position(|f| *f == k)).collect()));
    for (link, _, touch, on_blade) in blade_touches(model, q, rail) {
        let radii = PairRadii { bush_m: touch.link_radius_m, body_m: law_radius_m(touch.body_radius_m) };
        let elastic = rail.body.law.elastic(touch.penetration_m, radii);
        if elastic.force_n > 0.0 {
            let elastic = s.of.contact(elastic, &rail.body.law);
            let centre = q.links[link].0 - origin;
            columns.add(s, link, |s| add_end_contact(s, link, centre, &touch, elastic, columns.turn));
            if let (Some((blade, modes)), Some(on)) = (&of_blade, on_blade) {
                add_modes(s, link, (blade, modes), (&touch, elastic), (on, centre));
            }
        }
    }
}

/// What a contact gives to the modes of a blade. `centre`: of the link, from the rail's origin.
fn add_modes(
    s: &mut System,
    link: usize,
    (blade, modes): (&BladeModel, &Vec<Option<usize>>),
    (touch, elastic): (&EndTouch, Elastic),
    ((point, own), centre): ((BladePoint, Vec2), Vec2),
) {
    let (normal, along) = (touch.normal, perp(touch.normal));
    let part = own.dot(&normal);
    let is_flat = touch.link_radius_m.is_infinite();
    let radius_m = if is_flat { 0.0 } else { touch.link_radius_m };
    let t = perp(touch.point + normal * radius_m - centre);
    // d(penetration) and d(place along the contour) per (x, y, heading) of the link.
    let g = Vector3::new(-normal.x, -normal.y, -normal.dot(&t));
    let of_place = match is_flat {
        // On an arc the place of a straight edge follows from its heading.
        true if touch.body_radius_m.is_finite() => Vector3::new(0.0, 0.0, touch.body_radius_m),
        true => Vector3::zeros(),
        false => Vector3::new(along.x, along.y, along.dot(&t)),
    };
    let shapes: Vec<(usize, f64, f64)> = modes
        .iter()
        .enumerate()
        .filter_map(|(k, c)| {
            Some((*c.as_ref()?, part * blade.shape.value_of(k, &point), blade.shape.slope_of(k, &point)))
        })
        .collect();
    for (c, value, slope) in &shapes {
        s.rotor_gradient[*c] += elastic.force_n * value;
        s.columns[*c][link] += g * (elastic.stiffness_n_per_m * value) + of_place * (elastic.force_n * slope);
        for (other, other_value, _) in &shapes {
            s.rotors[(*c, *other)] += elastic.stiffness_n_per_m * value * other_value;
        }
    }
}
