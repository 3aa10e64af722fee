//! Static equilibrium of all chains: the minimum of the potential energy.
//!
//! Unknowns are the pose of every link and every free coordinate. The energy is that of joints, contacts (without friction), springs of
//! arms and the loads. Newton's method with line search; the Hessian, curvature of contacts and
//! rotation of links included, is block-tridiagonal with a border (the link that closes each loop, and the coordinates), so an
//! iteration costs a time proportional to the number of links. It ends on the residual force, never on a count of steps.

mod modes;
mod terms;

pub use modes::{Mode, ModesError, Plungers, modes};
pub use terms::{GuideTouch, guide_touches, rail_touches};
use terms::{StaticProblem, SystemOf};

use crate::geometry::{Vec2, perp, unit};
use crate::model::Model;
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
/// Shares of the stiffness of contacts from which the search begins where it failed with the whole of it.
const SOFTER_CONTACTS: [f64; 4] = [1e-4, 1e-3, 1e-2, 1e-1];
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
    of: SystemOf,
}

/// Indices of the coordinates that are free.
fn free_coordinates(model: &Model) -> Vec<usize> {
    (0..model.coordinates.len())
        .filter(|k| model.coordinates[*k].is_free() && !model.coordinates[*k].is_held_at_rest)
        .collect()
}

/// Finds the equilibrium near `start`, loads scaled by `load_factor`. Contacts that are nearly rigid stop every step of Newton at the
/// next one that closes; where that does not end, contacts begin soft, and each equilibrium is the start of a stiffer one.
pub fn equilibrium(model: &Model, start: Configuration, load_factor: f64) -> Result<Equilibrium, NotConverged> {
    let first = match descend(model, start.clone(), load_factor, 1.0) {
        Ok(found) => return Ok(found),
        Err(first) => first,
    };
    let mut q = start;
    let mut spent = first.iterations;
    for share in SOFTER_CONTACTS {
        let Ok(softer) = descend(model, q, load_factor, share) else { return Err(first) };
        spent += softer.iterations;
        q = softer.configuration;
    }
    let found = descend(model, q, load_factor, 1.0).map_err(|_| first)?;
    Ok(Equilibrium { iterations: spent + found.iterations, ..found })
}

/// Newton with line search, contacts of this share of their stiffness.
fn descend(model: &Model, start: Configuration, load_factor: f64, contacts: f64) -> Result<Equilibrium, NotConverged> {
    let mut problem = StaticProblem::of_contacts(model, free_coordinates(model), load_factor, contacts);
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
    let longest = dq.iter().map(|d| libm::hypot(d.x, d.y).max(d.z.abs() * LINK_ARM_M)).fold(0.0, f64::max);
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
        libm::hypot(f.x, f.y)
    };
    model.chain.links().map(tension).collect()
}

fn joint_offset(model: &Model, q: &Configuration, j: usize) -> Vec2 {
    let k = model.chain.next(j);
    let ((pa, fa), (pb, fb)) = (q.links[j], q.links[k]);
    pa + unit(fa) * model.chain.lever[j] - pb + unit(fb) * model.chain.lever[k]
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
