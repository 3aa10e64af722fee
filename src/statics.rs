//! Static equilibrium of all chains: the minimum of the potential energy.
//!
//! Unknowns are the pose of every link and every free coordinate. The energy is that of joints, contacts (without friction), springs of
//! arms and the loads. Newton's method with line search; the Hessian, curvature of contacts and
//! rotation of links included, is block-tridiagonal with a border (the link that closes each loop, and the coordinates), so an
//! iteration costs a time proportional to the number of links. It ends on the residual force, never on a count of steps.

use crate::elements::body_frame::BodyFrame;
use crate::elements::contact_law::{Elastic, PairRadii};
use crate::elements::coordinate::CoordinateKind;
use crate::elements::coupling::Coupling;
use crate::elements::span::ChainSpan;
use crate::geometry::{Vec2, perp, rotated, unit};
use crate::integrate::explicit::ends::{EndFinder, LinkPoses};
use crate::model::{BladeModel, GuideModel, Model, RailModel};
use crate::pairs::bush_gap;
use crate::pairs::contour_body::{EndTouch, FAR_M};
use crate::pairs::part_part::Touch;
use crate::pairs::plate_blade::BladePoint;
use crate::pairs::plate_rail::{PlatePart, law_radius_m};
use crate::pairs::roller_bush::RestingBush;
use crate::units::sin_cos;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix3xX, Vector3};
use std::ops::Range;

/// Poses of links (centre, heading), by lane, and angles of all coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration {
    pub links: Vec<(Vec2, f64)>,
    pub coordinates: Vec<f64>,
}

/// What stands still, and how well.
#[derive(Clone, Debug, PartialEq)]
pub struct Equilibrium {
    pub configuration: Configuration,
    /// Largest unbalanced force, moments divided by their lever [N].
    pub residual_n: f64,
    pub iterations: usize,
    /// Tension of every joint [N].
    pub tensions_n: Vec<f64>,
}

/// Why no equilibrium was found.
#[derive(Clone, Debug, PartialEq)]
pub struct NotConverged {
    pub residual_n: f64,
    pub iterations: usize,
}

/// Residual at which the search ends [N]: rounding of positions times the contact stiffness is some 1e-8 N.
pub const RESIDUAL_N: f64 = 1e-6;
const MAX_ITERATIONS: usize = 400;
/// Residual that is borne after this many iterations, or where no step helps any more [N]; and at their end, of the stillest
/// state, over its largest tension: without friction a chain may slide round plain rings with hardly any force, and that last
/// one is not worth the search.
const SOFT_RESIDUAL_N: f64 = 1e-2;
const SLIDING_SHARE: f64 = 2e-3;
/// Shift of the Hessian beyond which no step changes anything [N/m].
const MAX_SHIFT: f64 = 1e13;
/// First shift of the Hessian where its direction lowers nothing, ten times larger at every further failure [N/m]; below
/// `LEAST_SHIFT` it is dropped. Twice or half of these two, of the arms below, or of the longest move takes 15 to 25 iterations where
/// the abutment chain takes 21, at most 3 more for the other bundled drives, and ends below the same residual.
const FIRST_SHIFT: f64 = 1e4;
const LEAST_SHIFT: f64 = 1e2;
/// Arm at which turning of a link counts like displacement [m]: half an 8 mm pitch. Of free coordinates, squared [m2]: the radius of
/// a sprocket with 25 such teeth.
const LINK_ARM_M: f64 = 4e-3;
const COORDINATE_ARM_M2: f64 = 1e-3;
/// Longest displacement in an iteration [m]: contacts are found within one tooth gap.
const LONGEST_MOVE_M: f64 = 5e-4;
/// Share of the fall that the slope promises which is enough. Source: Nocedal and Wright 2006, section 3.1.
const SUFFICIENT_FALL: f64 = 1e-4;
/// Residual over that before, where the residual judges.
const SUFFICIENT_STILLING: f64 = 0.9;
const MAX_HALVINGS: usize = 30;
const SOFT_AFTER: usize = 100;
/// Residual below which the residual alone may judge a step [N].
const NEAR_SOLUTION_N: f64 = 1.0;

/// Gradient and Hessian over link blocks, by lane, and free coordinates.
struct System {
    /// Lanes of every chain with links.
    loops: Vec<Range<usize>>,
    gradient: Vec<Vector3<f64>>,
    diagonal: Vec<Matrix3<f64>>,
    /// Block (i, i + 1), cyclic.
    next: Vec<Matrix3<f64>>,
    /// Per free sprocket: its column over the links.
    columns: Vec<Vec<Vector3<f64>>>,
    rotor_gradient: DVector<f64>,
    /// Block of the free coordinates.
    rotors: DMatrix<f64>,
    energy: f64,
}

/// Indices of the coordinates that are free.
fn free_coordinates(model: &Model) -> Vec<usize> {
    (0..model.coordinates.len())
        .filter(|k| model.coordinates[*k].is_free() && !model.coordinates[*k].is_held_at_rest)
        .collect()
}

/// Finds the equilibrium near `start`, loads scaled by `load_factor`.
pub fn equilibrium(model: &Model, start: Configuration, load_factor: f64) -> Result<Equilibrium, NotConverged> {
    let mut problem = StaticProblem::new(model, free_coordinates(model), load_factor);
    let mut q = start;
    let mut system = problem.system(&q);
    let mut shift = 0.0_f64;
    let mut stillest: Option<(f64, Configuration)> = None;
    for iterations in 0..MAX_ITERATIONS {
        let residual_n = system.residual(model);
        let enough = if iterations < SOFT_AFTER { RESIDUAL_N } else { SOFT_RESIDUAL_N };
        if residual_n < enough || (shift > MAX_SHIFT && residual_n < SOFT_RESIDUAL_N) {
            let tensions_n = tensions(model, &q);
            return Ok(Equilibrium { configuration: q, residual_n, iterations, tensions_n });
        }
        if iterations >= SOFT_AFTER && stillest.as_ref().is_none_or(|s| residual_n < s.0) {
            stillest = Some((residual_n, q.clone()));
        }
        if residual_n.is_nan() {
            return Err(NotConverged { residual_n, iterations });
        }
        let negative: Vec<Vector3<f64>> = system.gradient.iter().map(|g| -g).collect();
        let direction = system.solve(&negative, &(-&system.rotor_gradient), shift);
        let accepted = direction.and_then(|(dq, dr)| line_search(&mut problem, &q, &system, &dq, &dr));
        match accepted {
            Some((next, next_system, full)) => {
                (q, system) = (next, next_system);
                shift = if full { shift * 0.1 } else { shift };
                if shift < LEAST_SHIFT {
                    shift = 0.0;
                }
            }
            None if shift > MAX_SHIFT => return Err(NotConverged { residual_n, iterations }),
            None => shift = (10.0 * shift).max(FIRST_SHIFT),
        }
    }
    let iterations = MAX_ITERATIONS;
    if let Some((residual_n, configuration)) = stillest {
        let tensions_n = tensions(model, &configuration);
        if residual_n < SLIDING_SHARE * tensions_n.iter().copied().fold(0.0, f64::max) {
            return Ok(Equilibrium { configuration, residual_n, iterations, tensions_n });
        }
    }
    Err(NotConverged { residual_n: system.residual(model), iterations })
}

type LineSearchStep = (Configuration, System, bool);

/// Halves the step until energy or residual falls; None where nothing does.
fn line_search(
    problem: &mut StaticProblem<'_>,
    q: &Configuration,
    system: &System,
    dq: &[Vector3<f64>],
    dr: &DVector<f64>,
) -> Option<LineSearchStep> {
    let slope: f64 = system.gradient.iter().zip(dq).map(|(g, d)| g.dot(d)).sum::<f64>() + system.rotor_gradient.dot(dr);
    let residual = system.residual(problem.model);
    let longest = dq.iter().map(|d| d.x.hypot(d.y).max(d.z.abs() * LINK_ARM_M)).fold(0.0, f64::max);
    // Nor may a sprocket that nothing holds yet turn its teeth past the chain.
    let model = problem.model;
    let rims = problem.free.iter().zip(dr.iter()).map(|(k, d)| d.abs() * model.coordinates[*k].reach_m);
    let longest = rims.fold(longest, f64::max);
    let mut factor = if longest > LONGEST_MOVE_M { LONGEST_MOVE_M / longest } else { 1.0 };
    let full = factor == 1.0;
    for halving in 0..MAX_HALVINGS {
        let next = moved(q, &problem.free, dq, dr, factor);
        let next_system = problem.system(&next);
        // Strictly: far down the halvings a step that changes nothing is none.
        let lower = slope < 0.0
            && next_system.energy < system.energy
            && next_system.energy <= system.energy + SUFFICIENT_FALL * factor * slope;
        // Near the end the energy falls by less than its rounding, and the residual says more. Far from it a residual that
        // falls while the energy climbs would undo the step before, for ever.
        if lower || (residual < NEAR_SOLUTION_N && next_system.residual(model) < SUFFICIENT_STILLING * residual) {
            return Some((next, next_system, full && halving == 0));
        }
        factor *= 0.5;
    }
    None
}

fn moved(q: &Configuration, free: &[usize], dq: &[Vector3<f64>], dr: &DVector<f64>, factor: f64) -> Configuration {
    let links =
        q.links.iter().zip(dq).map(|((p, a), d)| (p + Vec2::new(d.x, d.y) * factor, a + d.z * factor)).collect();
    let mut coordinates = q.coordinates.clone();
    for (k, coordinate) in free.iter().enumerate() {
        coordinates[*coordinate] += dr[k] * factor;
    }
    Configuration { links, coordinates }
}

/// How the equilibrium moves when the driver turns: d(links)/d(angle), d(coordinates)/d(angle).
pub fn sensitivity_to_driver(model: &Model, at: &Configuration) -> Option<(Vec<Vector3<f64>>, Vec<f64>)> {
    const TURN_RAD: f64 = 1e-7;
    let (free, driver) = (free_coordinates(model), model.sprockets[model.driver].coordinate);
    let mut problem = StaticProblem::new(model, free.clone(), 1.0);
    let system = problem.system(at);
    let mut turned = |by: f64| {
        let mut q = at.clone();
        q.coordinates[driver] += by;
        problem.system(&q)
    };
    let (plus, minus) = (turned(TURN_RAD), turned(-TURN_RAD));
    let rhs: Vec<Vector3<f64>> =
        plus.gradient.iter().zip(&minus.gradient).map(|(a, b)| (b - a) / (2.0 * TURN_RAD)).collect();
    let rotor_rhs = (&minus.rotor_gradient - &plus.rotor_gradient) / (2.0 * TURN_RAD);
    let (links, free_rates) = system.solve(&rhs, &rotor_rhs, 0.0)?;
    let mut coordinates = vec![0.0; model.coordinates.len()];
    coordinates[driver] = 1.0;
    for (k, coordinate) in free.iter().enumerate() {
        coordinates[*coordinate] = free_rates[k];
    }
    Some((links, coordinates))
}

/// Force of the chain on coordinates [N m, N], with the others where they are.
pub fn forces_on(model: &Model, at: &Configuration, coordinates: Vec<usize>) -> Vec<f64> {
    let of_springs: Vec<f64> =
        coordinates.iter().map(|k| model.coordinates[*k].spring.force(at.coordinates[*k])).collect();
    let gradient = StaticProblem::new(model, coordinates, 0.0).system(at).rotor_gradient;
    gradient.iter().zip(of_springs).map(|(slope, own)| -slope - own).collect()
}

/// A loaded loop seen from its shafts: what turning every sprocket costs, and moves.
#[derive(Clone, Debug, PartialEq)]
pub struct CondensedModel {
    /// Torque on one sprocket by the angle of another, the links at rest [N m/rad].
    pub stiffness: DMatrix<f64>,
    /// Inertia of sprockets, and of the links that move with them as statics has it [kg m2].
    pub inertia: DMatrix<f64>,
}

/// Static condensation of the links (Guyan 1965), all sprockets kept. None where the links have no stiffness of their own.
pub fn condensed(model: &Model, at: &Configuration) -> Option<CondensedModel> {
    let n = model.coordinates.len();
    let all: Vec<usize> = (0..n).collect();
    let whole = StaticProblem::new(model, all, 1.0).system(at);
    let links = StaticProblem::new(model, Vec::new(), 1.0).system(at);
    let none = DVector::zeros(0);
    let mut shapes = Vec::new();
    for column in &whole.columns {
        let pull: Vec<Vector3<f64>> = column.iter().map(|c| -c).collect();
        shapes.push(links.solve(&pull, &none, 0.0)?.0);
    }
    let (mut stiffness, mut inertia) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
    for a in 0..n {
        for b in 0..n {
            let moved: f64 = whole.columns[a].iter().zip(&shapes[b]).map(|(c, x)| c.dot(x)).sum();
            stiffness[(a, b)] = moved + whole.rotors[(a, b)];
            inertia[(a, b)] = kinetic(model, at, &shapes[a], &shapes[b]);
        }

        let own = model.coordinates[a].inverse_inertia();
        inertia[(a, a)] += if own > 0.0 { 1.0 / own } else { 0.0 };
    }
    Some(CondensedModel { stiffness, inertia })
}

/// x M y over the links.
fn kinetic(model: &Model, at: &Configuration, x: &[Vector3<f64>], y: &[Vector3<f64>]) -> f64 {
    let c = &model.chain;
    let of = |i: usize| c.mass[i] * (x[i].x * y[i].x + x[i].y * y[i].y) + c.inertia[i] * x[i].z * y[i].z;
    // Rollers go with their bushes.
    let of_roller = |roller: usize| {
        let (link, front) = c.bush_carrier(roller);
        let arm = unit(at.links[link].1) * (c.lever[link] * if front { 1.0 } else { -1.0 });
        let moved = |v: &Vector3<f64>| Vec2::new(v.x, v.y) + perp(arm) * v.z;
        c.mass[roller] * moved(&x[link]).dot(&moved(&y[link]))
    };
    c.links().map(of).sum::<f64>() + c.all_rollers().map(of_roller).sum::<f64>()
}

/// The mode of the linearised drive (links, joints, closed contacts; driver held) whose angular frequency is nearest to `near`
/// [rad/s]: its frequency [rad/s], and the share of the sprockets in its kinetic energy. Inverse iteration on K - near^2 M.
pub fn mode_near(model: &Model, at: &Configuration, near: f64) -> Option<(f64, f64)> {
    let free = free_coordinates(model);
    let mut problem = StaticProblem::new(model, free.clone(), 1.0);
    let (mut system, original) = (problem.system(at), problem.system(at));
    let shift = near * near;
    let c = &model.chain;
    for (i, d) in system.diagonal.iter_mut().enumerate() {
        *d -= Matrix3::from_diagonal(&Vector3::new(c.mass[i], c.mass[i], c.inertia[i])) * shift;
    }
    let rotor = |k: usize| 1.0 / model.coordinates[free[k]].inverse_inertia();
    for k in 0..free.len() {
        system.rotors[(k, k)] -= shift * rotor(k);
    }
    let mut links = vec![Vector3::zeros(); c.lanes];
    let mut rotors = DVector::from_element(free.len(), 1.0);
    let mut value = f64::NAN;
    for _ in 0..200 {
        let pull: Vec<Vector3<f64>> = (0..c.lanes)
            .map(|i| Vector3::new(c.mass[i] * links[i].x, c.mass[i] * links[i].y, c.inertia[i] * links[i].z))
            .collect();
        let rotor_pull = DVector::from_fn(free.len(), |k, _| rotor(k) * rotors[k]);
        (links, rotors) = system.solve(&pull, &rotor_pull, 0.0)?;
        let own: f64 = (0..free.len()).map(|k| rotor(k) * rotors[k] * rotors[k]).sum();
        let all = own + kinetic(model, at, &links, &links);
        let scale = 1.0 / libm::sqrt(all);
        links.iter_mut().for_each(|x| *x *= scale);
        rotors *= scale;
        let next = libm::sqrt(original.quadratic(&links, &rotors).max(0.0));
        if (next - value).abs() < 1e-9 * next {
            return Some((next, own / all));
        }
        value = next;
    }
    None
}

/// Tension of every joint [N].
pub fn tensions(model: &Model, q: &Configuration) -> Vec<f64> {
    let tension = |j: usize| {
        let u = joint_offset(model, q, j);
        let f = model.chain.joint(j).force(u.x, u.y, 0.0, 0.0);
        f.x.hypot(f.y)
    };
    model.chain.links().map(tension).collect()
}

fn joint_offset(model: &Model, q: &Configuration, j: usize) -> Vec2 {
    let k = model.chain.next(j);
    let ((pa, fa), (pb, fb)) = (q.links[j], q.links[k]);
    pa + unit(fa) * model.chain.lever[j] - pb + unit(fb) * model.chain.lever[k]
}

/// What is to stand still: a model under some of its load, and the sprockets that are free to turn.
struct StaticProblem<'a> {
    model: &'a Model,
    free: Vec<usize>,
    load_factor: f64,
    finder: EndFinder,
}

impl<'a> StaticProblem<'a> {
    fn new(model: &'a Model, free: Vec<usize>, load_factor: f64) -> StaticProblem<'a> {
        StaticProblem { model, free, load_factor, finder: EndFinder::new(model) }
    }

    fn system(&mut self, q: &Configuration) -> System {
        let StaticProblem { model, free, load_factor, finder } = self;
        let (model, load_factor) = (*model, *load_factor);
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
        };
        for j in model.chain.links() {
            add_joint(model, q, j, &mut s);
        }
        for (c, index) in free.iter().enumerate() {
            let coordinate = &model.coordinates[*index];
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
        for touch in &model.touches {
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
    s.energy += coupling.energy_j(at);
    let (torque, _) = coupling.torques_nm(at, [0.0; 2]);
    let columns = [a, b].map(|k| free.iter().position(|f| *f == k));
    for (row, sign) in [(columns[0], 1.0), (columns[1], -1.0)] {
        let Some(row) = row else { continue };
        s.rotor_gradient[row] -= sign * torque;
        for (column, other) in [(columns[0], 1.0), (columns[1], -1.0)] {
            let Some(column) = column else { continue };
            s.rotors[(row, column)] += sign * other * coupling.stiffness_nm_per_rad;
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
    s.energy += span.energy_j(elongation_m);
    let columns = span.ends.map(|k| free.iter().position(|f| *f == k));
    let levers_m = span.levers_m();
    for (row, lever_m) in columns.into_iter().zip(levers_m) {
        let Some(row) = row else { continue };
        s.rotor_gradient[row] -= lever_m * tension_n;
        for (column, other_m) in columns.into_iter().zip(levers_m) {
            let Some(column) = column else { continue };
            s.rotors[(row, column)] += lever_m * other_m * span.stiffness_n_per_m;
        }
    }
}

/// Parts that touch each other: penetration = -gap.
fn add_touch(touch: &Touch, q: &Configuration, free: &[usize], s: &mut System) {
    let gap = touch.shape.gap(&q.coordinates);
    let elastic = touch.law.elastic(-gap.gap_m, touch.radii);
    if elastic.force_n <= 0.0 {
        return;
    }
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
    s.energy += force.stored;
    let f = Vec2::new(force.x, force.y);
    let stiffness = joint.stiffness_n_per_m;
    // Stiffness in the direction of u and across it.
    let (along, across, direction) = if joint.clearance_m == 0.0 {
        (stiffness, stiffness, Vec2::new(1.0, 0.0))
    } else if f.norm() > 0.0 {
        (stiffness, f.norm() / u.norm(), u.normalize())
    } else {
        return;
    };
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
    normal: Vec2,
    /// How the normal turns over the way along the guide [1/m].
    bend_per_m: f64,
}

fn add_guide(model: &Model, q: &Configuration, guide: &GuideModel, free: &[usize], s: &mut System) {
    let columns = FrameColumns::new(&guide.frame, free);
    for t in guide_touches(model, q, guide) {
        let lever = if t.front { model.chain.lever[t.link] } else { -model.chain.lever[t.link] };
        let (_, heading) = q.links[t.link];
        let arm = unit(heading) * lever;
        columns.add(s, t.link, |s| add_contact(s, t.link, arm, t.normal, t.elastic, t.bend_per_m, None));
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

impl System {
    /// x K x.
    fn quadratic(&self, links: &[Vector3<f64>], rotors: &DVector<f64>) -> f64 {
        let mut sum = 0.0;
        for l in &self.loops {
            for i in l.clone() {
                let next = if i + 1 == l.end { l.start } else { i + 1 };
                sum += links[i].dot(&(self.diagonal[i] * links[i]));
                sum += 2.0 * links[i].dot(&(self.next[i] * links[next]));
            }
        }
        for (k, column) in self.columns.iter().enumerate() {
            let along: f64 = column.iter().zip(links).map(|(c, x)| c.dot(x)).sum();
            sum += rotors[k] * (2.0 * along);
        }
        sum + rotors.dot(&(&self.rotors * rotors))
    }

    /// Largest unbalanced force [N].
    fn residual(&self, model: &Model) -> f64 {
        let mut largest = 0.0_f64;
        for i in model.chain.links() {
            let (g, lever) = (&self.gradient[i], model.chain.lever[i]);
            let here = g.x.abs().max(g.y.abs()).max(g.z.abs() / lever);
            largest = if here.is_nan() { f64::NAN } else { largest.max(here) };
            if largest.is_nan() {
                return largest;
            }
        }
        for (k, rotor) in free_coordinates(model).into_iter().enumerate() {
            largest = largest.max(self.rotor_gradient[k].abs() / model.coordinates[rotor].reach_m);
        }
        largest
    }

    /// Solves (H + shift) x = rhs. The last link of every loop and the free coordinates form the border. None when singular.
    fn solve(
        &self,
        rhs: &[Vector3<f64>],
        rotor_rhs: &DVector<f64>,
        shift: f64,
    ) -> Option<(Vec<Vector3<f64>>, DVector<f64>)> {
        let n = self.diagonal.len();
        let of_loops = 3 * self.loops.len();
        let border = of_loops + self.columns.len();
        // Links of every loop but the last.
        let inner: Vec<Range<usize>> = self.loops.iter().map(|l| l.start..l.end - 1).collect();
        let damp = Matrix3::from_diagonal(&Vector3::new(shift, shift, shift * (LINK_ARM_M * LINK_ARM_M)));
        // Right-hand sides of the chain part: border columns, then rhs.
        let mut sides: Vec<Matrix3xX<f64>> = vec![Matrix3xX::zeros(border + 1); n];
        let mut add = |i: usize, column: usize, block: &Matrix3<f64>| {
            for c in 0..3 {
                for r in 0..3 {
                    sides[i][(r, column + c)] += block[(r, c)];
                }
            }
        };
        for (k, l) in inner.iter().enumerate() {
            add(l.start, 3 * k, &self.next[l.end].transpose());
            add(l.end - 1, 3 * k, &self.next[l.end - 1]);
        }
        for (i, side) in sides.iter_mut().enumerate() {
            for (k, column) in self.columns.iter().enumerate() {
                side.column_mut(of_loops + k).copy_from(&column[i]);
            }
            side.column_mut(border).copy_from(&rhs[i]);
        }
        let coupling: Vec<Matrix3xX<f64>> = sides.iter().map(|s| s.columns(0, border).into_owned()).collect();
        // Block elimination.
        let mut inverses = vec![Matrix3::zeros(); n];
        for l in &inner {
            for i in l.clone() {
                let mut d = self.diagonal[i] + damp;
                if i > l.start {
                    let lower = self.next[i - 1].transpose() * inverses[i - 1];
                    d -= lower * self.next[i - 1];
                    let change = lower * &sides[i - 1];
                    sides[i] -= change;
                }
                inverses[i] = d.try_inverse()?;
            }
            for i in l.clone().rev() {
                if i + 1 < l.end {
                    let change = self.next[i] * &sides[i + 1];
                    sides[i] -= change;
                }
                sides[i] = inverses[i] * &sides[i];
            }
        }
        // Border.
        let mut small = DMatrix::zeros(border, border);
        let mut small_rhs = DVector::zeros(border);
        for (k, l) in inner.iter().enumerate() {
            let last = self.diagonal[l.end] + damp;
            small.view_mut((3 * k, 3 * k), (3, 3)).copy_from(&last);
            small_rhs.rows_mut(3 * k, 3).copy_from(&rhs[l.end]);
        }
        for (k, column) in self.columns.iter().enumerate() {
            let at = of_loops + k;
            for (own, l) in inner.iter().enumerate() {
                for r in 0..3 {
                    small[(3 * own + r, at)] = column[l.end][r];
                    small[(at, 3 * own + r)] = column[l.end][r];
                }
            }
            for other in 0..self.columns.len() {
                small[(at, of_loops + other)] = self.rotors[(k, other)];
            }
            small[(at, at)] += shift * COORDINATE_ARM_M2;
            small_rhs[at] = rotor_rhs[k];
        }
        for i in inner.iter().cloned().flatten() {
            small -= coupling[i].transpose() * sides[i].columns(0, border);
            small_rhs -= coupling[i].transpose() * sides[i].column(border);
        }
        let y = small.lu().solve(&small_rhs)?;
        let mut links: Vec<Vector3<f64>> = sides
            .iter()
            .map(|s| {
                let x = s.column(border) - s.columns(0, border) * &y;
                Vector3::new(x[0], x[1], x[2])
            })
            .collect();
        for (k, l) in inner.iter().enumerate() {
            links[l.end] = Vector3::new(y[3 * k], y[3 * k + 1], y[3 * k + 2]);
        }
        Some((links, y.rows(of_loops, border - of_loops).into_owned()))
    }
}
