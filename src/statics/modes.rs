//! Modes of a drive at rest under its load: M x'' + C x' + K x = 0 about the equilibrium.
//!
//! K is the Hessian of the potential energy (joints, closed contacts, tension of the links, springs, couplings), C that of the dampers,
//! M the inertia of links, rollers and free coordinates. The driver is held, films of bearings and check balls too; friction is left out.
//! ```text
//! K x = w^2 M x,  x M x = 1         all modes, by the symmetric eigenproblem of L^-1 K L^-T with M = L L^T
//! zeta = x C x / (2 w)              damping ratio of a mode that no other is near, small ratios (Rayleigh)
//! ```
//! Source: Meirovitch, Fundamentals of Vibrations (2001), sections 7.4 and 7.15. What the running chain adds is not in it: its links travel through the
//! spans, which lowers the frequencies of transverse waves by a factor 1 - (v/c)^2.

use super::terms::{StaticProblem, SystemOf};
use super::{Configuration, System, free_coordinates};
use crate::geometry::{Vec2, perp, unit};
use crate::model::Model;
use nalgebra::{DMatrix, Matrix3, SymmetricEigen, Vector3};

/// What plungers of tensioners do in a mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plungers {
    /// They stand on their oil, all chambers closed: right where a period is short against the flow.
    Oil,
    /// They stand still.
    Locked,
    /// They have their springs alone: oil flows without resistance.
    Open,
}

/// A mode of a drive at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// w^2 [1/s2]; below zero: the equilibrium is none that stays.
    pub eigenvalue: f64,
    /// Share of critical damping; NaN where the eigenvalue is not above zero.
    pub damping_ratio: f64,
    /// Displacements (x, y, heading) of every link, by lane, with x M x = 1 [m, rad per sqrt(kg m2)].
    pub links: Vec<Vector3<f64>>,
    /// The same of all coordinates; zero of those that are held.
    pub coordinates: Vec<f64>,
}

impl Mode {
    /// w / (2 pi) [Hz]; negative where the eigenvalue is.
    pub fn frequency_hz(&self) -> f64 {
        let w = libm::sqrt(self.eigenvalue.abs());
        w.copysign(self.eigenvalue) / (2.0 * std::f64::consts::PI)
    }
}

/// Why there are no modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModesError {
    /// Nothing of the drive is free to move.
    NothingMoves,
    /// A part has no inertia, or numbers that are none.
    NoInertia,
}

impl std::fmt::Display for ModesError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            ModesError::NothingMoves => "nothing of the drive is free to move",
            ModesError::NoInertia => "a part that moves has no inertia, or a number that is none",
        })
    }
}

impl std::error::Error for ModesError {}

/// All modes at an equilibrium, the lowest first.
///
/// # Errors
/// See [`ModesError`].
pub fn modes(model: &Model, at: &Configuration, plungers: Plungers) -> Result<Vec<Mode>, ModesError> {
    let mut free = free_coordinates(model);
    if plungers == Plungers::Locked {
        free.retain(|k| model.sliders.iter().all(|s| s.coordinate != *k));
    }
    let lanes: Vec<usize> = model.chain.links().collect();
    if lanes.is_empty() && free.is_empty() {
        return Err(ModesError::NothingMoves);
    }
    let mut stiffness = StaticProblem::new(model, free.clone(), 1.0).system(at);
    if plungers == Plungers::Oil
        && let Some(oil) = &model.oil
    {
        for slider in &model.sliders {
            if let Some(c) = free.iter().position(|k| *k == slider.coordinate) {
                stiffness.rotors[(c, c)] += oil.stiffness_n_per_m(slider.coordinate, &at.coordinates);
            }
        }
    }
    let damping = StaticProblem::of_dampers(model, free.clone()).system(at);
    debug_assert!(damping.of == SystemOf::Dampers);
    let (k, c, m) = (stiffness.dense(&lanes), damping.dense(&lanes), mass(model, at, &lanes, &free));
    // Rows scaled to like sizes; a value that is no number has no factors.
    let l = m.cholesky().ok_or(ModesError::NoInertia)?.l();
    let half = l.solve_lower_triangular(&k).ok_or(ModesError::NoInertia)?;
    let whole = l.solve_lower_triangular(&half.transpose()).ok_or(ModesError::NoInertia)?;
    if whole.iter().any(|v| !v.is_finite()) {
        return Err(ModesError::NoInertia);
    }
    let eigen = SymmetricEigen::new(0.5 * (&whole + whole.transpose()));
    let shapes = l.tr_solve_lower_triangular(&eigen.eigenvectors).ok_or(ModesError::NoInertia)?;
    let lost = &c * &shapes;
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let mode = |i: usize| {
        let (shape, eigenvalue) = (shapes.column(i), eigen.eigenvalues[i]);
        let mut links = vec![Vector3::zeros(); model.chain.lanes];
        for (row, lane) in lanes.iter().enumerate() {
            links[*lane] = Vector3::new(shape[3 * row], shape[3 * row + 1], shape[3 * row + 2]);
        }
        let mut coordinates = vec![0.0; model.coordinates.len()];
        for (row, coordinate) in free.iter().enumerate() {
            coordinates[*coordinate] = shape[3 * lanes.len() + row];
        }
        let damping_ratio =
            if eigenvalue > 0.0 { shape.dot(&lost.column(i)) / (2.0 * libm::sqrt(eigenvalue)) } else { f64::NAN };
        Mode { eigenvalue, damping_ratio, links, coordinates }
    };
    Ok(order.into_iter().map(mode).collect())
}

/// Inertia of links, with the rollers on their bushes, and of free coordinates.
fn mass(model: &Model, at: &Configuration, lanes: &[usize], free: &[usize]) -> DMatrix<f64> {
    let c = &model.chain;
    let mut blocks = vec![Matrix3::zeros(); c.lanes];
    for i in lanes {
        blocks[*i] = Matrix3::from_diagonal(&Vector3::new(c.mass[*i], c.mass[*i], c.inertia[*i]));
    }
    for roller in c.all_rollers() {
        let (link, front) = c.bush_carrier(roller);
        let t: Vec2 = perp(unit(at.links[link].1) * (c.lever[link] * if front { 1.0 } else { -1.0 }));
        let (x, y) = (Vector3::new(1.0, 0.0, t.x), Vector3::new(0.0, 1.0, t.y));
        blocks[link] += c.mass[roller] * (x * x.transpose() + y * y.transpose());
    }
    let n = 3 * lanes.len() + free.len();
    let mut m = DMatrix::zeros(n, n);
    for (row, lane) in lanes.iter().enumerate() {
        m.view_mut((3 * row, 3 * row), (3, 3)).copy_from(&blocks[*lane]);
    }
    for (row, coordinate) in free.iter().enumerate() {
        let inverse = model.coordinates[*coordinate].inverse_inertia();
        m[(3 * lanes.len() + row, 3 * lanes.len() + row)] = if inverse > 0.0 { 1.0 / inverse } else { 0.0 };
    }
    m
}

impl System {
    /// The whole matrix: links of these lanes, then free coordinates.
    fn dense(&self, lanes: &[usize]) -> DMatrix<f64> {
        let n = 3 * lanes.len() + self.columns.len();
        let mut row_of = vec![0; self.diagonal.len()];
        for (row, lane) in lanes.iter().enumerate() {
            row_of[*lane] = 3 * row;
        }
        let mut k = DMatrix::zeros(n, n);
        let mut add = |row: usize, column: usize, block: &Matrix3<f64>| {
            let mut view = k.view_mut((row, column), (3, 3));
            view += block;
        };
        for l in &self.loops {
            for i in l.clone() {
                let next = if i + 1 == l.end { l.start } else { i + 1 };
                add(row_of[i], row_of[i], &self.diagonal[i]);
                add(row_of[i], row_of[next], &self.next[i]);
                add(row_of[next], row_of[i], &self.next[i].transpose());
            }
        }
        let of_links = 3 * lanes.len();
        for (c, column) in self.columns.iter().enumerate() {
            for lane in lanes {
                for r in 0..3 {
                    k[(row_of[*lane] + r, of_links + c)] = column[*lane][r];
                    k[(of_links + c, row_of[*lane] + r)] = column[*lane][r];
                }
            }
        }
        k.view_mut((of_links, of_links), (self.columns.len(), self.columns.len())).copy_from(&self.rotors);
        k
    }
}
