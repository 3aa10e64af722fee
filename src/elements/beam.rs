//! Modes of a beam that bends, with pins, clamps and springs along it.
//!
//! ```text
//! EI d4w/dx4 + m d2w/dt2 = q      by cubic elements (Hermite) with deflection and slope at every node; frequencies err by less than 1e-5
//! ```
//! Source: Przemieniecki 1968, sections 5.6 and 11.5 (matrices of the element).

use nalgebra::{DMatrix, DVector};

/// Most modes of a beam.
pub const MAX_MODES: usize = 8;
/// Elements of a beam, besides those that supports add, and the share of one within which a support stands at the beam's end.
const ELEMENTS: usize = 40;
const SAME_NODE: f64 = 0.05;

/// A beam. Places are counted along it [m]: in a drive from where the chain arrives, in a [`crate::pairs::plate_blade::Blade`] from where the profile begins.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    /// Bending stiffness EI [N m2].
    pub stiffness_n_m2: f64,
    /// Mass over length [kg/m].
    pub mass_kg_per_m: f64,
    /// Curvature of every stretch without load, convex towards the chain positive [1/m]; None: all as drawn.
    pub free_curvatures_per_m: Option<Vec<f64>>,
    /// What holds it, and where.
    pub supports: Vec<(f64, Support)>,
    /// Damping ratio of every mode.
    pub damping_ratio: f64,
    /// Number of modes, at most [`MAX_MODES`].
    pub modes: usize,
}

/// What holds a beam at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Support {
    /// Holds the deflection.
    Pin,
    /// Holds deflection and slope.
    Clamp,
    /// Presses back [N/m].
    Spring(f64),
}

impl Support {
    /// Number of a beam's two rigid motions, shifting and turning, that it prevents alone.
    pub fn holds(&self) -> usize {
        match self {
            Support::Clamp => 2,
            Support::Pin | Support::Spring(_) => 1,
        }
    }
}

/// A mode, 1 where its deflection is largest.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamMode {
    pub stiffness_n_per_m: f64,
    pub mass_kg: f64,
    /// Deflection and slope [1/m] by node.
    pub value: Vec<f64>,
    pub slope: Vec<f64>,
}

impl Beam {
    /// The same beam with places counted from its other end.
    pub fn reversed(&self, length_m: f64) -> Beam {
        let mut other = self.clone();
        if let Some(free) = &mut other.free_curvatures_per_m {
            free.reverse();
        }
        other.supports.iter_mut().for_each(|(at, _)| *at = length_m - *at);
        other
    }

    /// Places of its nodes. Supports are nodes; a regular one that is nearer to them than half an element gives way, because short elements are
    /// stiff.
    pub fn nodes(&self, length_m: f64) -> Vec<f64> {
        let element_m = length_m / ELEMENTS as f64;
        let end = |at: f64| if length_m - at < SAME_NODE * element_m { length_m } else { at };
        let supports = self.supports.iter().map(|(at, _)| end(if *at < SAME_NODE * element_m { 0.0 } else { *at }));
        let mut nodes: Vec<f64> = supports.chain([0.0, length_m]).collect();
        nodes.sort_by(f64::total_cmp);
        nodes.dedup();
        let held = nodes.clone();
        let is_free = |at: &f64| held.iter().all(|h| (h - at).abs() > 0.5 * element_m);
        nodes.extend((1..ELEMENTS).map(|k| k as f64 * element_m).filter(is_free));
        nodes.sort_by(f64::total_cmp);
        nodes
    }

    /// Its matrices of stiffness and mass: deflection and slope of one node after the other.
    fn matrices(&self, nodes: &[f64]) -> (DMatrix<f64>, DMatrix<f64>) {
        let n = 2 * nodes.len();
        let (mut stiffness, mut mass) = (DMatrix::<f64>::zeros(n, n), DMatrix::<f64>::zeros(n, n));
        for (k, pair) in nodes.windows(2).enumerate() {
            let l = pair[1] - pair[0];
            let bending = [
                [12.0, 6.0 * l, -12.0, 6.0 * l],
                [6.0 * l, 4.0 * l * l, -6.0 * l, 2.0 * l * l],
                [-12.0, -6.0 * l, 12.0, -6.0 * l],
                [6.0 * l, 2.0 * l * l, -6.0 * l, 4.0 * l * l],
            ];
            let inertia = [
                [156.0, 22.0 * l, 54.0, -13.0 * l],
                [22.0 * l, 4.0 * l * l, 13.0 * l, -3.0 * l * l],
                [54.0, 13.0 * l, 156.0, -22.0 * l],
                [-13.0 * l, -3.0 * l * l, -22.0 * l, 4.0 * l * l],
            ];
            for i in 0..4 {
                for j in 0..4 {
                    stiffness[(2 * k + i, 2 * k + j)] += self.stiffness_n_m2 / (l * l * l) * bending[i][j];
                    mass[(2 * k + i, 2 * k + j)] += self.mass_kg_per_m * l / 420.0 * inertia[i][j];
                }
            }
        }
        (stiffness, mass)
    }

    /// Its lowest modes on these nodes; None: there are none, without stiffness or mass.
    pub fn modes_on(&self, nodes: &[f64]) -> Option<Vec<BeamMode>> {
        let (mut stiffness, mass) = self.matrices(nodes);
        let n = 2 * nodes.len();
        let mut held = vec![false; n];
        for (at, support) in &self.supports {
            let off = |k: &usize| (nodes[*k] - at).abs();
            let node = (0..nodes.len()).min_by(|a, b| off(a).total_cmp(&off(b)))?;
            match support {
                Support::Pin => held[2 * node] = true,
                Support::Clamp => (held[2 * node], held[2 * node + 1]) = (true, true),
                Support::Spring(n_per_m) => stiffness[(2 * node, 2 * node)] += n_per_m,
            }
        }
        let free: Vec<usize> = (0..n).filter(|i| !held[*i]).collect();
        let kept = |m: &DMatrix<f64>| DMatrix::from_fn(free.len(), free.len(), |i, j| m[(free[i], free[j])]);
        let (k, m) = (kept(&stiffness), kept(&mass));
        // K x = w^2 M x with M = L L': (L^-1 K L^-T) y = w^2 y, x = L^-T y.
        let lower = m.cholesky()?.unpack();
        let half = lower.solve_lower_triangular(&k)?;
        let mut whole = lower.solve_lower_triangular(&half.transpose())?;
        whole = DMatrix::from_fn(free.len(), free.len(), |i, j| 0.5 * (whole[(i, j)] + whole[(j, i)]));
        let eigen = whole.symmetric_eigen();
        let mut order: Vec<usize> = (0..free.len()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        // What no support holds moves as a whole.
        let rigid = 2_usize.saturating_sub(self.supports.iter().map(|(_, support)| support.holds()).sum());
        let mut modes = Vec::new();
        for i in order.into_iter().take(self.modes.min(MAX_MODES)) {
            let x = lower.tr_solve_lower_triangular(&eigen.eigenvectors.column(i).into_owned())?;
            let mut shape = DVector::zeros(n);
            for (to, value) in free.iter().zip(x.iter()) {
                shape[*to] = *value;
            }
            let largest = shape.iter().step_by(2).copied().reduce(|a, b| if b.abs() > a.abs() { b } else { a })?;
            shape /= largest;
            // y has the length 1, so the mass is that of the scale.
            let mass_kg = 1.0 / (largest * largest);
            let is_rigid = modes.len() < rigid;
            modes.push(BeamMode {
                stiffness_n_per_m: if is_rigid { 0.0 } else { eigen.eigenvalues[i].max(0.0) * mass_kg },
                mass_kg,
                value: shape.iter().step_by(2).copied().collect(),
                slope: shape.iter().skip(1).step_by(2).copied().collect(),
            });
        }
        Some(modes)
    }
}
