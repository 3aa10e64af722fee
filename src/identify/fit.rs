//! Bounded least squares for many segments with local parameters: Levenberg-Marquardt on the Schur complement.
//!
//! ```text
//! minimise sum over segments |r_k(g, l_k)|^2 + sum over priors ((g - g_0) / s)^2
//! ```
//! The Jacobian of every segment comes from forward differences, with columns for globals and locals. Locals are
//! eliminated segment by segment, so that a thousand segments cost a thousand small systems. A parameter at a bound
//! that would leave its range is fixed for the step. Damping after Nielsen (1999). The order of all sums is fixed, so
//! that any number of threads gives the same bits.

use super::problem::{Local, Point, Problem};
use crate::products::product;
use crate::side_by_side::parallel;
use crate::units::within;
use nalgebra::{DMatrix, DVector};

/// Result of a fit.
#[derive(Clone, Debug)]
pub struct Fit {
    pub point: Point,
    /// Sum of squares including priors.
    pub cost: f64,
    pub converged: bool,
    /// Covariance of the scaled globals, for unit variance of the residuals.
    pub covariance: DMatrix<f64>,
    /// Final residuals of every segment.
    pub residuals: Vec<Vec<f64>>,
    /// Derivatives of a segment's residuals with respect to the globals, with the locals projected out.
    pub jacobians: Vec<DMatrix<f64>>,
}

/// After a step that lowers the cost by more than this fraction of the predicted decrease, the Jacobian gets a rank-one
/// update (Broyden 1965) instead of new differences, at most so many times in a row. This costs one run instead of one
/// for every parameter.
const GOOD_GAIN: f64 = 0.3;
const MAX_UPDATES: usize = 4;
/// Factor on the iteration limit while the cost still falls.
const STILL_FALLING: usize = 3;
/// At the iteration limit a fit has also converged if the last two iterations lowered its cost by no more than this
/// fraction.
const STALLED_DECREASE: f64 = 1e-4;

/// Residuals and derivatives of one segment.
struct SegmentJacobian {
    residuals: Vec<f64>,
    /// Columns: the globals that affect the segment, then its locals.
    columns: Vec<Vec<f64>>,
}

/// Damping of the first step, as a share of the diagonal: little more than none.
const FIRST_LAMBDA: f64 = 1e-3;

/// Settings of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    pub iterations: usize,
    pub threads: usize,
}

/// Whether the last five iterations lowered the cost by a tenth or more.
fn falls(costs: &[f64]) -> bool {
    costs.len() > 5 && costs[costs.len() - 1] < 0.9 * costs[costs.len() - 6]
}

/// Fits all parameters, starting from `start`.
pub fn fit(problem: &Problem, start: &Point, options: FitOptions) -> Fit {
    let mut fitting = Fitting::begin(problem, start, options.threads);
    fitting.go_to_the_end(problem, options);
    fitting.finish(problem, options)
}

/// A fit on its way, which may stop after some iterations and go on later as if it had not.
pub struct Fitting {
    /// Fitted segments.
    parts: Vec<usize>,
    point: Point,
    cost: f64,
    jacobian: Vec<SegmentJacobian>,
    /// Rank-one updates since the Jacobian was last differenced.
    updates: usize,
    /// Damping of the next step, and the factor by which a rejected one raises it.
    lambda: f64,
    grow: f64,
    /// Iterations so far, and the costs before them.
    taken: usize,
    costs: Vec<f64>,
    /// Whether it has ended by itself, and whether it has converged then.
    ended: bool,
    converged: bool,
}

impl Fitting {
    /// The fit before its first step.
    pub fn begin(problem: &Problem, start: &Point, threads: usize) -> Fitting {
        let options = FitOptions { iterations: 0, threads };
        let segments = &problem.data.segments;
        let parts: Vec<usize> = (0..segments.len()).filter(|k| segments[*k].judge_from > 0).collect();
        let mut point = start.clone();
        keep_inside(problem, &mut point);
        let residuals = all_residuals(problem, &point, &parts, options);
        let cost = total(problem, &point, &residuals);
        let jacobian = linearised(problem, &point, &parts, residuals, options);
        Fitting {
            parts,
            point,
            cost,
            jacobian,
            updates: 0,
            lambda: FIRST_LAMBDA,
            grow: 2.0,
            taken: 0,
            costs: vec![cost],
            ended: false,
            converged: false,
        }
    }

    /// Goes on until it ends by itself or has taken so many iterations in all.
    pub fn go_on(&mut self, problem: &Problem, options: FitOptions) {
        let most = options.iterations.min(problem.machine.effort().iterations);
        while !self.ended && self.taken < most {
            self.step_if_not_due(problem, options);
        }
    }

    /// Goes on until it ends by itself or has taken so many iterations in all, and beyond them while its cost falls.
    pub fn go_to_the_end(&mut self, problem: &Problem, options: FitOptions) {
        self.go_on(problem, options);
        let most = options.iterations.min(problem.machine.effort().iterations);
        while !self.ended && (self.taken < most || self.taken < STILL_FALLING * most && self.is_falling()) {
            self.step_if_not_due(problem, options);
        }
    }

    /// Whether the last five iterations lowered the cost by a tenth or more.
    pub fn is_falling(&self) -> bool {
        falls(&self.costs)
    }

    fn step_if_not_due(&mut self, problem: &Problem, options: FitOptions) {
        match problem.ending.is_due() {
            true => self.ended = true,
            false => self.step(problem, options),
        }
    }

    /// One iteration of Levenberg and Marquardt's method.
    fn step(&mut self, problem: &Problem, options: FitOptions) {
        let converges = problem.machine.effort().converged_share;
        self.taken += 1;
        self.costs.push(self.cost);
        let Some(step) = solve(problem, &self.point, &self.parts, &self.jacobian, self.lambda) else {
            self.lambda *= 10.0;
            self.ended = self.lambda > 1e12;
            return;
        };
        let mut trial = self.point.clone();
        for (x, d) in trial.globals.iter_mut().zip(step.globals.iter()) {
            *x += d;
        }
        for (k, d) in self.parts.iter().zip(&step.locals) {
            for (x, d) in trial.locals[*k].iter_mut().zip(d.iter()) {
                *x += d;
            }
        }
        keep_inside(problem, &mut trial);
        let residuals = all_residuals(problem, &trial, &self.parts, options);
        let new_cost = total(problem, &trial, &residuals);
        let gain = (self.cost - new_cost) / step.predicted.max(1e-300);
        if new_cost < self.cost {
            let small = (self.cost - new_cost) < converges * self.cost;
            let good = self.updates < MAX_UPDATES && gain > GOOD_GAIN && !small;
            if good {
                update(problem, &self.parts, &mut self.jacobian, residuals, &self.point, &trial);
                self.updates += 1;
            } else {
                self.jacobian = linearised(problem, &trial, &self.parts, residuals, options);
            }
            self.point = trial;
            self.cost = new_cost;
            let x = 2.0 * gain - 1.0;
            self.lambda = (self.lambda * (1.0 - x * x * x).max(1.0 / 3.0)).max(1e-12);
            self.grow = 2.0;
            if !good {
                // A small step with an updated Jacobian does not end the fit: a freshly differenced one is tried first.
                self.converged = small && self.updates == 0;
                self.ended = self.converged;
                if !self.ended {
                    self.updates = 0;
                }
            }
        } else if self.updates > 0 {
            self.linearise(problem, options);
            // A step rejected because of an updated Jacobian does not count.
            self.taken -= 1;
        } else if step.predicted < converges * self.cost {
            (self.ended, self.converged) = (true, true);
        } else {
            self.lambda *= self.grow;
            self.grow *= 2.0;
            if self.lambda > 1e12 {
                (self.ended, self.converged) = (true, step.predicted < 1e-3 * self.cost);
            }
        }
    }

    /// Differences the Jacobian anew where the fit stands.
    fn linearise(&mut self, problem: &Problem, options: FitOptions) {
        let residuals = std::mem::take(&mut self.jacobian).into_iter().map(|p| p.residuals).collect();
        self.jacobian = linearised(problem, &self.point, &self.parts, residuals, options);
        self.updates = 0;
    }

    pub fn has_converged(&self) -> bool {
        self.converged
    }

    /// Residuals of every segment that the linear model where it stands promises, by a step that is hardly damped.
    pub fn promised_residuals(&self, problem: &Problem) -> Vec<Vec<f64>> {
        let mut all = self.residuals(problem);
        // A Jacobian that the end of the budget has cut off promises nothing.
        let concerned = |k: usize| (0..problem.globals.len()).filter(move |g| problem.concerns(*g, k));
        let is_whole =
            |(part, k): (&SegmentJacobian, &usize)| part.columns.len() == concerned(*k).count() + problem.locals.len();
        if self.converged || !self.jacobian.iter().zip(&self.parts).all(is_whole) {
            return all;
        }
        let step = solve(problem, &self.point, &self.parts, &self.jacobian, FIRST_LAMBDA);
        let Some(FitStep { globals, locals, .. }) = step else { return all };
        for ((part, k), locals) in self.jacobian.iter().zip(&self.parts).zip(&locals) {
            let steps = concerned(*k).map(|g| globals[g]).chain(locals.iter().copied());
            for (column, step) in part.columns.iter().zip(steps) {
                all[*k].iter_mut().zip(column).for_each(|(r, c)| *r += c * step);
            }
        }
        all
    }

    /// Where it stands, without what an end costs: neither covariance nor Jacobians.
    pub fn as_it_stands(&self, problem: &Problem) -> Fit {
        Fit {
            point: self.point.clone(),
            cost: self.cost,
            converged: self.converged,
            covariance: DMatrix::zeros(0, 0),
            residuals: self.residuals(problem),
            jacobians: Vec::new(),
        }
    }

    /// Residuals of every segment where it stands; none of those that are not fitted.
    fn residuals(&self, problem: &Problem) -> Vec<Vec<f64>> {
        let mut all = vec![Vec::new(); problem.data.segments.len()];
        for (k, part) in self.parts.iter().zip(&self.jacobian) {
            all[*k].clone_from(&part.residuals);
        }
        all
    }

    /// The fit where it stands, after so many iterations at most.
    pub fn finish(mut self, problem: &Problem, options: FitOptions) -> Fit {
        let most = options.iterations.min(problem.machine.effort().iterations);
        // Poorly determined parameters may drift on although the cost no longer changes.
        let stands = |two_ago: &f64| two_ago - self.cost < STALLED_DECREASE * self.cost;
        self.converged |= self.taken >= most && self.taken > 2 && self.costs.iter().nth_back(1).is_some_and(stands);
        if self.updates > 0 && !problem.ending.is_due() {
            self.linearise(problem, options);
        }
        finish(problem, self.point, self.cost, self.converged, &self.parts, self.jacobian)
    }
}

/// Clamps all parameters to their bounds.
fn keep_inside(problem: &Problem, point: &mut Point) {
    for (x, g) in point.globals.iter_mut().zip(&problem.globals) {
        let (low, high) = g.law.bounds();
        *x = within(*x, low, high);
    }
    for locals in &mut point.locals {
        for (x, l) in locals.iter_mut().zip(&problem.locals) {
            if let Local::Slot { law, .. } = l {
                let (low, high) = law.bounds();
                *x = within(*x, low, high);
            }
        }
    }
}

pub(super) fn priors(problem: &Problem, point: &Point) -> f64 {
    let of = problem.globals.iter().zip(&point.globals);
    of.filter_map(|(g, x)| g.prior.map(|(mean, s)| ((x - mean) / s) * ((x - mean) / s))).sum()
}

/// Residuals of all segments.
fn all_residuals(problem: &Problem, point: &Point, parts: &[usize], options: FitOptions) -> Vec<Vec<f64>> {
    parallel(parts.len(), options.threads, |i| problem.residuals(parts[i], &point.globals, &point.locals[parts[i]]))
}

/// Cost at the start of a fit from this point.
pub fn cost_at(problem: &Problem, point: &Point, threads: usize) -> f64 {
    let segments = &problem.data.segments;
    let parts: Vec<usize> = (0..segments.len()).filter(|k| segments[*k].judge_from > 0).collect();
    let mut point = point.clone();
    keep_inside(problem, &mut point);
    total(problem, &point, &all_residuals(problem, &point, &parts, FitOptions { iterations: 0, threads }))
}

fn total(problem: &Problem, point: &Point, residuals: &[Vec<f64>]) -> f64 {
    residuals.iter().map(|r| dot(r, r)).sum::<f64>() + priors(problem, point)
}

/// Broyden's rank-one update of every segment's Jacobian after a step from `before` to `after`, with the new residuals.
fn update(
    problem: &Problem,
    parts: &[usize],
    jacobian: &mut [SegmentJacobian],
    residuals: Vec<Vec<f64>>,
    before: &Point,
    after: &Point,
) {
    for ((part, k), now) in jacobian.iter_mut().zip(parts).zip(residuals) {
        let globals = (0..problem.globals.len()).filter(|g| problem.concerns(*g, *k));
        let mut step: Vec<f64> = globals.map(|g| after.globals[g] - before.globals[g]).collect();
        step.extend(after.locals[*k].iter().zip(&before.locals[*k]).map(|(a, b)| a - b));
        // Scales the parameters so that every column changes the residuals equally.
        let sizes: Vec<f64> = part.columns.iter().map(|c| dot(c, c)).collect();
        let length: f64 = step.iter().zip(&sizes).map(|(s, size)| s * s * size).sum();
        if length > 0.0 {
            let mut missed: Vec<f64> = now.iter().zip(&part.residuals).map(|(a, b)| a - b).collect();
            for (column, s) in part.columns.iter().zip(&step) {
                missed.iter_mut().zip(column).for_each(|(m, c)| *m -= c * s);
            }
            for ((column, s), size) in part.columns.iter_mut().zip(&step).zip(&sizes) {
                let share = s * size / length;
                column.iter_mut().zip(&missed).for_each(|(c, m)| *c += share * m);
            }
        }
        part.residuals = now;
    }
}

/// Residuals with their derivatives by forward differences; if the fit must end meanwhile, not all of them.
fn linearised(
    problem: &Problem,
    point: &Point,
    parts: &[usize],
    residuals: Vec<Vec<f64>>,
    options: FitOptions,
) -> Vec<SegmentJacobian> {
    // Segments and columns form one list of jobs, so that a few long segments use all cores as well as many short ones.
    let mut jobs: Vec<(usize, usize)> = Vec::new();
    for (i, k) in parts.iter().enumerate() {
        let concerned = (0..problem.globals.len()).filter(|g| problem.concerns(*g, *k)).count();
        jobs.extend((1..=concerned + problem.locals.len()).map(|c| (i, c)));
    }
    let columns = parallel(jobs.len(), options.threads, |job| {
        if problem.ending.is_due() {
            return None;
        }
        let (i, column) = jobs[job];
        let k = parts[i];
        let concerned: Vec<usize> = (0..problem.globals.len()).filter(|g| problem.concerns(*g, k)).collect();
        let (mut globals, mut locals) = (point.globals.clone(), point.locals[k].clone());
        // Steps towards the interior of the bounds.
        let nudged = |x: f64, d: f64, bounds: (f64, f64)| {
            if x + d > bounds.1 { x - d } else { x + d }
        };
        let width;
        if column <= concerned.len() {
            let g = concerned[column - 1];
            let x = nudged(globals[g], problem.difference(g, globals[g]), problem.globals[g].law.bounds());
            width = x - globals[g];
            globals[g] = x;
        } else {
            let l = column - 1 - concerned.len();
            let bounds = match problem.locals[l] {
                Local::Slot { law, .. } => law.bounds(),
                Local::Travel | Local::Angle { .. } | Local::Speed { .. } => (f64::MIN, f64::MAX),
            };
            let x = nudged(locals[l], problem.local_difference(l, locals[l]), bounds);
            width = x - locals[l];
            locals[l] = x;
        }
        Some((width, problem.residuals(k, &globals, &locals)))
    });
    let mut all: Vec<SegmentJacobian> =
        residuals.into_iter().map(|residuals| SegmentJacobian { residuals, columns: Vec::new() }).collect();
    for ((i, _), column) in jobs.iter().zip(columns) {
        let Some((width, values)) = column else { break };
        let part = &mut all[*i];
        let slope = values.iter().zip(&part.residuals).map(|(a, b)| (a - b) / width).collect();
        part.columns.push(slope);
    }
    all
}

struct FitStep {
    globals: DVector<f64>,
    locals: Vec<DVector<f64>>,
    /// Decrease of the cost that a linear model predicts.
    predicted: f64,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Blocks of the normal equations of one segment: locals by locals, locals by globals, and the gradient of the locals.
struct Blocks {
    ll: DMatrix<f64>,
    lg: DMatrix<f64>,
    l: DVector<f64>,
}

impl Blocks {
    /// Takes a local out of the step.
    fn hold(&mut self, local: usize) {
        self.ll.row_mut(local).fill(0.0);
        self.ll.column_mut(local).fill(0.0);
        self.lg.row_mut(local).fill(0.0);
        (self.ll[(local, local)], self.l[local]) = (1.0, 0.0);
    }
}

/// Whether a local stands at a bound and its gradient points outwards.
fn leaves_range(local: &Local, x: f64, gradient: f64) -> bool {
    match local {
        Local::Slot { law, .. } => {
            let (low, high) = law.bounds();
            (x <= low && gradient > 0.0) || (x >= high && gradient < 0.0)
        }
        Local::Travel | Local::Angle { .. } | Local::Speed { .. } => false,
    }
}

fn solve(
    problem: &Problem,
    point: &Point,
    parts: &[usize],
    jacobian: &[SegmentJacobian],
    lambda: f64,
) -> Option<FitStep> {
    let n = problem.globals.len();
    let n_local = problem.locals.len();
    let mut a = DMatrix::<f64>::zeros(n, n);
    let mut b = DVector::<f64>::zeros(n);
    let mut blocks = Vec::new();
    for (part, k) in jacobian.iter().zip(parts) {
        let concerned: Vec<usize> = (0..n).filter(|g| problem.concerns(*g, *k)).collect();
        let (global, local) = part.columns.split_at(concerned.len());
        let mut block =
            Blocks { ll: DMatrix::zeros(n_local, n_local), lg: DMatrix::zeros(n_local, n), l: DVector::zeros(n_local) };
        for i in 0..n_local {
            block.l[i] = dot(&local[i], &part.residuals);
            for j in 0..=i {
                let v = dot(&local[i], &local[j]);
                (block.ll[(i, j)], block.ll[(j, i)]) = (v, v);
            }
            for (j, g) in concerned.iter().enumerate() {
                block.lg[(i, *g)] = dot(&local[i], &global[j]);
            }
        }
        for (i, local) in problem.locals.iter().enumerate() {
            if leaves_range(local, point.locals[*k][i], block.l[i]) {
                block.hold(i);
            }
        }
        for (i, gi) in concerned.iter().enumerate() {
            b[*gi] += dot(&global[i], &part.residuals);
            for (j, gj) in concerned.iter().enumerate().take(i + 1) {
                let v = dot(&global[i], &global[j]);
                a[(*gi, *gj)] += v;
                if i != j {
                    a[(*gj, *gi)] += v;
                }
            }
        }
        blocks.push(block);
    }
    for (i, (g, x)) in problem.globals.iter().zip(&point.globals).enumerate().take(n) {
        if let Some((mean, s)) = g.prior {
            a[(i, i)] += 1.0 / (s * s);
            b[i] += (x - mean) / (s * s);
        }
    }
    // Fixed at a bound: the gradient points outwards.
    let mut held: Vec<bool> = (0..n)
        .map(|i| {
            let (low, high) = problem.globals[i].law.bounds();
            let x = point.globals[i];
            (x <= low && b[i] > 0.0) || (x >= high && b[i] < 0.0)
        })
        .collect();
    for _ in 0..=n {
        let step = solve_free(&a, &b, &blocks, lambda, &held)?;
        let mut again = false;
        for i in 0..n {
            let (low, high) = problem.globals[i].law.bounds();
            let x = point.globals[i];
            let leaves = (x <= low && step.globals[i] < 0.0) || (x >= high && step.globals[i] > 0.0);
            if !held[i] && leaves {
                held[i] = true;
                again = true;
            }
        }
        if !again {
            return Some(step);
        }
    }
    None
}

fn damped(m: &DMatrix<f64>, lambda: f64) -> DMatrix<f64> {
    let mut m = m.clone();
    for i in 0..m.nrows() {
        let d = m[(i, i)];
        m[(i, i)] = d + lambda * d.max(1e-12) + 1e-14;
    }
    m
}

fn solve_free(a: &DMatrix<f64>, b: &DVector<f64>, blocks: &[Blocks], lambda: f64, held: &[bool]) -> Option<FitStep> {
    let n = b.len();
    let mut schur = damped(a, lambda);
    let mut right = -b.clone();
    let mut inverses = Vec::new();
    for block in blocks {
        let inverse =
            if block.l.is_empty() { DMatrix::zeros(0, 0) } else { damped(&block.ll, lambda).try_inverse()? };
        if n > 0 && !block.l.is_empty() {
            let x = product(&inverse, &block.lg);
            schur -= block.lg.tr_mul(&x);
            right += x.tr_mul(&block.l);
        }
        inverses.push(inverse);
    }
    for i in (0..n).filter(|i| held[*i]) {
        for j in 0..n {
            schur[(i, j)] = 0.0;
            schur[(j, i)] = 0.0;
        }
        schur[(i, i)] = 1.0;
        right[i] = 0.0;
    }
    let globals = if n > 0 { schur.full_piv_lu().solve(&right)? } else { DVector::zeros(0) };
    let mut predicted = -2.0 * b.dot(&globals) - (a * &globals).dot(&globals);
    let mut locals = Vec::new();
    for (block, inverse) in blocks.iter().zip(&inverses) {
        let step = -(inverse * (&block.l + &block.lg * &globals));
        predicted -=
            2.0 * block.l.dot(&step) + (&block.ll * &step).dot(&step) + 2.0 * (&block.lg * &globals).dot(&step);
        locals.push(step);
    }
    if globals.iter().chain(locals.iter().flat_map(|l| l.iter())).all(|x| x.is_finite()) {
        Some(FitStep { globals, locals, predicted: predicted.max(0.0) })
    } else {
        None
    }
}

/// Computes the covariance, and the Jacobians of the globals with the locals projected out.
fn finish(
    problem: &Problem,
    point: Point,
    cost: f64,
    converged: bool,
    parts: &[usize],
    jacobian: Vec<SegmentJacobian>,
) -> Fit {
    let n = problem.globals.len();
    let mut information = DMatrix::<f64>::zeros(n, n);
    let mut residuals = vec![Vec::new(); problem.data.segments.len()];
    let mut jacobians = vec![DMatrix::zeros(0, n); problem.data.segments.len()];
    for (part, k) in jacobian.into_iter().zip(parts) {
        let concerned: Vec<usize> = (0..n).filter(|g| problem.concerns(*g, *k)).collect();
        if part.columns.len() == concerned.len() + problem.locals.len() {
            let (global, local) = part.columns.split_at(concerned.len());
            let basis = orthonormal(local);
            let mut j = DMatrix::zeros(part.residuals.len(), n);
            for (column, g) in global.iter().zip(&concerned) {
                j.set_column(*g, &DVector::from_vec(project_out(column, &basis)));
            }
            information += j.tr_mul(&j);
            jacobians[*k] = j;
        }
        residuals[*k] = part.residuals;
    }
    for (i, g) in problem.globals.iter().enumerate() {
        if let Some((_, s)) = g.prior {
            information[(i, i)] += 1.0 / (s * s);
        }
        information[(i, i)] += 1e-14;
    }
    let covariance = information.clone().try_inverse().unwrap_or_else(|| DMatrix::from_element(n, n, f64::INFINITY));
    Fit { point, cost, converged, covariance, residuals, jacobians }
}

/// Orthonormal columns that span the given ones (modified Gram-Schmidt; linearly dependent columns are left out).
pub fn orthonormal(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for column in columns {
        let before = libm::sqrt(dot(column, column));
        let mut rest = project_out(column, &basis);
        // Twice is enough: Kahan and Parlett.
        rest = project_out(&rest, &basis);
        let size = libm::sqrt(dot(&rest, &rest));
        if size > 1e-9 * before && size > 0.0 {
            rest.iter_mut().for_each(|x| *x /= size);
            basis.push(rest);
        }
    }
    basis
}

/// The column minus its projection onto the basis.
pub fn project_out(column: &[f64], basis: &[Vec<f64>]) -> Vec<f64> {
    let mut rest = column.to_vec();
    for b in basis {
        let along = dot(&rest, b);
        rest.iter_mut().zip(b).for_each(|(x, b)| *x -= along * b);
    }
    rest
}
