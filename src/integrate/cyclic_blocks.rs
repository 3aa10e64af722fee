//! Linear systems of closed chains: blocks of three by three on a cyclic tridiagonal, one cycle a chain, with a border of coordinates.
//!
//! The last link of every chain joins the border, which leaves plain tridiagonal systems. They are eliminated from front to back; what they
//! do to the border is a small dense system. A solution takes a time that is proportional to the number of links.

use nalgebra::{DMatrix, DVector, Dyn, LU, Matrix3, Matrix3xX, Vector3};

/// A system, not yet eliminated. Rows and columns: three a link, loop after loop, then coordinates.
pub(super) struct CyclicBlocks {
    /// Number of links in every loop.
    pub(super) loops: Vec<usize>,
    /// The blocks in the row of every link: with the link before it in its loop, with itself, with the next link.
    pub(super) rows: Vec<[Matrix3<f64>; 3]>,
    /// The column of every coordinate, by links.
    pub(super) columns: Vec<Vec<Vector3<f64>>>,
    /// The row of every coordinate, by links.
    pub(super) border_rows: Vec<Vec<Vector3<f64>>>,
    /// The block of the coordinates with each other.
    pub(super) corner: DMatrix<f64>,
}

/// A system that is eliminated.
pub(super) struct Eliminated {
    loops: Vec<usize>,
    n_coordinates: usize,
    /// The inverse of a link's own block, once the links before it are eliminated. The last link of a loop has none.
    pivots: Vec<Matrix3<f64>>,
    /// The blocks of a link with the link before it and with the next one.
    before: Vec<Matrix3<f64>>,
    next: Vec<Matrix3<f64>>,
    /// The columns of the border, after the elimination.
    columns: Vec<Matrix3xX<f64>>,
    /// Rows of the border over the links.
    border: Vec<Matrix3xX<f64>>,
    dense: LU<f64, Dyn, Dyn>,
}

impl CyclicBlocks {
    /// A system whose blocks are all zero.
    pub(super) fn new(loops: Vec<usize>, n_coordinates: usize) -> CyclicBlocks {
        let n: usize = loops.iter().sum();
        CyclicBlocks {
            loops,
            rows: vec![[Matrix3::zeros(); 3]; n],
            columns: vec![vec![Vector3::zeros(); n]; n_coordinates],
            border_rows: vec![vec![Vector3::zeros(); n]; n_coordinates],
            corner: DMatrix::zeros(n_coordinates, n_coordinates),
        }
    }

    /// Eliminates all links but the last of each loop; None: it is singular.
    pub(super) fn eliminated(&self) -> Option<Eliminated> {
        let (n, n_loops, m) = (self.rows.len(), self.loops.len(), self.columns.len());
        let width = 3 * n_loops + m;
        let mut dense = DMatrix::zeros(width, width);
        dense.view_mut((3 * n_loops, 3 * n_loops), (m, m)).copy_from(&self.corner);
        // Column block of the border at a link, and the border's rows there, transposed.
        let mut columns = vec![Matrix3xX::zeros(width); n];
        let mut border = vec![Matrix3xX::zeros(width); n];
        let mut begin = 0;
        for (own, count) in self.loops.iter().enumerate() {
            let last = begin + count - 1;
            for i in begin..last {
                for c in 0..m {
                    columns[i].set_column(3 * n_loops + c, &self.columns[c][i]);
                    border[i].set_column(3 * n_loops + c, &self.border_rows[c][i]);
                }
            }
            let mut add_column = |i: usize, block: &Matrix3<f64>| {
                let mut view = columns[i].fixed_columns_mut::<3>(3 * own);
                view += block;
            };
            add_column(begin, &self.rows[begin][0]);
            add_column(last - 1, &self.rows[last - 1][2]);
            let mut add_row = |i: usize, block: &Matrix3<f64>| {
                let mut view = border[i].fixed_columns_mut::<3>(3 * own);
                view += block.transpose();
            };
            add_row(last - 1, &self.rows[last][0]);
            add_row(begin, &self.rows[last][2]);
            dense.fixed_view_mut::<3, 3>(3 * own, 3 * own).copy_from(&self.rows[last][1]);
            for c in 0..m {
                let at = 3 * n_loops + c;
                dense.fixed_view_mut::<3, 1>(3 * own, at).copy_from(&self.columns[c][last]);
                dense.fixed_view_mut::<1, 3>(at, 3 * own).copy_from(&self.border_rows[c][last].transpose());
            }
            begin += count;
        }
        let mut pivots = vec![Matrix3::zeros(); n];
        let before: Vec<_> = self.rows.iter().map(|r| r[0]).collect();
        let next: Vec<_> = self.rows.iter().map(|r| r[2]).collect();
        for range in inner(&self.loops) {
            for i in range.clone() {
                let mut pivot = self.rows[i][1];
                if i > range.start {
                    pivot -= before[i] * pivots[i - 1] * next[i - 1];
                }
                pivots[i] = pivot.try_inverse()?;
            }
        }
        let mut system = Eliminated {
            loops: self.loops.clone(),
            n_coordinates: m,
            pivots,
            before,
            next,
            columns,
            border,
            dense: dense.clone().lu(),
        };
        let mut solved = std::mem::take(&mut system.columns);
        system.solve_links(&mut solved);
        for (row, column) in system.border.iter().zip(&solved) {
            dense -= row.transpose() * column;
        }
        system.columns = solved;
        system.dense = dense.lu();
        system.dense.is_invertible().then_some(system)
    }
}

/// Links of every loop but the last.
fn inner(loops: &[usize]) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
    loops.iter().scan(0, |begin, count| {
        let own = *begin..*begin + count - 1;
        *begin += count;
        Some(own)
    })
}

impl Eliminated {
    /// Solves the tridiagonal systems for several right sides in place.
    fn solve_links(&self, right: &mut [Matrix3xX<f64>]) {
        for range in inner(&self.loops) {
            for i in range.clone() {
                if i > range.start {
                    let carried = self.before[i] * (self.pivots[i - 1] * &right[i - 1]);
                    right[i] -= carried;
                }
            }
            for i in range.clone().rev() {
                if i + 1 < range.end {
                    let carried = self.next[i] * &right[i + 1];
                    right[i] -= carried;
                }
                right[i] = self.pivots[i] * &right[i];
            }
        }
    }

    /// Solution for a right side, in its order; None: the border is singular.
    pub(super) fn solve(&self, right: &[f64]) -> Option<Vec<f64>> {
        let n: usize = self.loops.iter().sum();
        let (links, coordinates) = right.split_at(3 * n);
        let mut own: Vec<Vector3<f64>> = links.chunks_exact(3).map(Vector3::from_column_slice).collect();
        let lasts: Vec<usize> = inner(&self.loops).map(|range| range.end).collect();
        let mut border = DVector::zeros(3 * lasts.len() + self.n_coordinates);
        for (at, last) in lasts.iter().enumerate() {
            border.fixed_rows_mut::<3>(3 * at).copy_from(&own[*last]);
        }
        border.rows_mut(3 * lasts.len(), self.n_coordinates).copy_from_slice(coordinates);
        for range in inner(&self.loops) {
            for i in range.clone().skip(1) {
                let carried = self.before[i] * (self.pivots[i - 1] * own[i - 1]);
                own[i] -= carried;
            }
            for i in range.clone().rev() {
                if i + 1 < range.end {
                    let carried = self.next[i] * own[i + 1];
                    own[i] -= carried;
                }
                own[i] = self.pivots[i] * own[i];
                border -= self.border[i].transpose() * own[i];
            }
        }
        let border = self.dense.solve(&border)?;
        for range in inner(&self.loops) {
            for i in range {
                own[i] -= &self.columns[i] * &border;
            }
        }
        for (at, last) in lasts.iter().enumerate() {
            own[*last] = border.fixed_rows::<3>(3 * at).into();
        }
        let mut solution: Vec<f64> = own.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
        solution.extend_from_slice(border.rows(3 * lasts.len(), self.n_coordinates).as_slice());
        Some(solution)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix;

    /// Against a dense solution, for one loop and for two, with and without coordinates, and for the shortest loops.
    #[test]
    fn solves_as_a_dense_matrix_does() {
        let mut random = SplitMix(11);
        let mut one = || 2.0 * random.uniform() - 1.0;
        for (loops, m) in [(vec![9], 2), (vec![3, 7], 3), (vec![4], 0), (vec![], 2)] {
            let n: usize = loops.iter().sum();
            let mut system = CyclicBlocks::new(loops.clone(), m);
            let mut dense = DMatrix::zeros(3 * n + m, 3 * n + m);
            let mut begin = 0;
            for count in &loops {
                for i in begin..begin + count {
                    let at = |k: usize| begin + (i - begin + k + count - 1) % count;
                    for (k, block) in system.rows[i].iter_mut().enumerate() {
                        *block = Matrix3::from_fn(|_, _| one());
                        if k == 1 {
                            *block += Matrix3::identity() * 5.0;
                        }
                        let mut view = dense.view_mut((3 * i, 3 * at(k)), (3, 3));
                        view += &*block;
                    }
                }
                begin += count;
            }
            for c in 0..m {
                for i in 0..n {
                    system.columns[c][i] = Vector3::from_fn(|_, _| one());
                    system.border_rows[c][i] = Vector3::from_fn(|_, _| one());
                    dense.view_mut((3 * i, 3 * n + c), (3, 1)).copy_from(&system.columns[c][i]);
                    dense.view_mut((3 * n + c, 3 * i), (1, 3)).copy_from(&system.border_rows[c][i].transpose());
                }
                for d in 0..m {
                    system.corner[(c, d)] = one() + if c == d { 5.0 } else { 0.0 };
                    dense[(3 * n + c, 3 * n + d)] = system.corner[(c, d)];
                }
            }
            let right = DVector::from_fn(3 * n + m, |_, _| one());
            let expected = dense.lu().solve(&right).expect("regular");
            let found = system.eliminated().expect("regular").solve(right.as_slice()).expect("regular");
            for (a, b) in found.iter().zip(expected.iter()) {
                assert!((a - b).abs() < 1e-12, "{loops:?}, {m}: {a} against {b}");
            }
        }
    }
}
