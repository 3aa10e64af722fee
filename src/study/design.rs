//! Which points of the factors' unit cube a study runs: full grid, one at a time, Latin hypercube, Sobol' sequence, random points, trajectories
//! of Morris, matrices of Saltelli, or rows of a table.
//!
//! A coordinate is a share of its factor: 0 its lowest and 1 its highest value, or the share of its distribution below. NaN leaves the
//! drive's own value. The point of a case follows from its number alone, so that shards need not know of each other.
//!
//! * Latin hypercube: McKay, Beckman and Conover 1979; every factor has one value in each of n equal shares.
//! * Morris 1991: r trajectories of k + 1 points on a grid of p levels; each point moves one factor by Delta = p / (2 (p - 1)).
//! * Saltelli et al. 2010: matrices A and B of n rows from 2k dimensions of one Sobol' sequence, and k matrices A_B^i, A with column i of B.
//!   The cases of a row stand together: A, A_B^1 to A_B^k, B.

use super::sobol::SobolSequence;
use crate::random::SplitMix;

/// A plan as the study file has it.
#[derive(Clone, Debug, PartialEq)]
pub enum StudyPlan {
    /// Every combination of the factors' levels.
    FullGrid,
    /// The drive as it is, then the factors one by one at each of their levels.
    OneAtATime,
    LatinHypercube {
        cases: usize,
        seed: u64,
    },
    Sobol {
        cases: usize,
        seed: u64,
    },
    Random {
        cases: usize,
        seed: u64,
    },
    Morris {
        trajectories: usize,
        levels: usize,
        seed: u64,
    },
    Saltelli {
        base: usize,
        seed: u64,
    },
    /// Values of factors by rows; NaN: the drive's own.
    Rows(Vec<Vec<f64>>),
    /// Points are asked for by a search, one generation after the other.
    Search,
}

impl StudyPlan {
    /// As the study file calls it.
    pub fn name(&self) -> &'static str {
        match self {
            StudyPlan::FullGrid => "full_grid",
            StudyPlan::OneAtATime => "one_at_a_time",
            StudyPlan::LatinHypercube { .. } => "latin_hypercube",
            StudyPlan::Sobol { .. } => "sobol",
            StudyPlan::Random { .. } => "random",
            StudyPlan::Morris { .. } => "morris",
            StudyPlan::Saltelli { .. } => "saltelli",
            StudyPlan::Rows(_) => "rows",
            StudyPlan::Search => "search",
        }
    }

    /// Dimensions and seed of the Sobol' sequence that the plan takes for `k` factors; None: it takes no sequence.
    pub fn sequence_of(&self, k: usize) -> Option<(usize, u64)> {
        match *self {
            StudyPlan::Sobol { seed, .. } => Some((k, seed)),
            StudyPlan::Saltelli { seed, .. } => Some((2 * k, seed)),
            StudyPlan::FullGrid
            | StudyPlan::OneAtATime
            | StudyPlan::LatinHypercube { .. }
            | StudyPlan::Random { .. }
            | StudyPlan::Morris { .. }
            | StudyPlan::Rows(_)
            | StudyPlan::Search => None,
        }
    }
}

/// Most cases of a study: what a machine with 16 GB can collect, half a kilobyte each.
pub const MOST_CASES: usize = 20_000_000;

/// The points of a plan.
#[derive(Clone, Debug)]
pub struct Design {
    plan: StudyPlan,
    /// Levels of every factor in a grid.
    levels: Vec<usize>,
    points: usize,
    sequence: Option<SobolSequence>,
    /// For every factor the share in which each case lies.
    shares: Vec<Vec<u32>>,
}

impl Design {
    /// Levels: of every factor, as a grid takes them. None: more than [`MOST_CASES`].
    pub fn new(plan: StudyPlan, levels: &[usize]) -> Option<Design> {
        let k = levels.len();
        let points = match &plan {
            StudyPlan::FullGrid => levels.iter().try_fold(1_usize, |n, l| n.checked_mul(*l)),
            StudyPlan::OneAtATime => Some(1 + levels.iter().sum::<usize>()),
            StudyPlan::LatinHypercube { cases, .. }
            | StudyPlan::Sobol { cases, .. }
            | StudyPlan::Random { cases, .. } => Some(*cases),
            StudyPlan::Morris { trajectories, .. } => trajectories.checked_mul(k + 1),
            StudyPlan::Saltelli { base, .. } => base.checked_mul(k + 2),
            StudyPlan::Rows(rows) => Some(rows.len()),
            StudyPlan::Search => Some(0),
        };
        let points = points.filter(|n| *n <= MOST_CASES)?;
        let sequence = plan.sequence_of(k).map(|(dimensions, seed)| SobolSequence::new(dimensions, Some(seed)));
        let shares = match plan {
            StudyPlan::LatinHypercube { cases, seed } => (0..k).map(|factor| shuffled(cases, seed, factor)).collect(),
            StudyPlan::FullGrid
            | StudyPlan::OneAtATime
            | StudyPlan::Sobol { .. }
            | StudyPlan::Random { .. }
            | StudyPlan::Morris { .. }
            | StudyPlan::Saltelli { .. }
            | StudyPlan::Rows(_)
            | StudyPlan::Search => Vec::new(),
        };
        Some(Design { plan, levels: levels.to_vec(), points, sequence, shares })
    }

    pub fn plan(&self) -> &StudyPlan {
        &self.plan
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.points
    }

    /// Coordinates of point `i` below [`Design::points`].
    pub fn point(&self, i: usize) -> Vec<f64> {
        let k = self.levels.len();
        match &self.plan {
            StudyPlan::FullGrid => self.grid_point(i),
            StudyPlan::OneAtATime => self.single_change(i),
            StudyPlan::LatinHypercube { cases, seed } => {
                let place = |factor: usize| {
                    let within = SplitMix::of(&[*seed, i as u64, factor as u64]).uniform();
                    (f64::from(self.shares[factor][i]) + within) / *cases as f64
                };
                (0..k).map(place).collect()
            }
            StudyPlan::Sobol { .. } => self.sequence_point(i),
            StudyPlan::Random { seed, .. } => {
                (0..k).map(|factor| SplitMix::of(&[*seed, i as u64, factor as u64]).uniform()).collect()
            }
            StudyPlan::Morris { levels, seed, .. } => trajectory_point(k, *levels, *seed, i / (k + 1), i % (k + 1)),
            StudyPlan::Saltelli { .. } => {
                let (row, which) = (i / (k + 2), i % (k + 2));
                let both = self.sequence_point(row);
                let from_b = |factor: usize| which == k + 1 || which == factor + 1;
                (0..k).map(|factor| if from_b(factor) { both[k + factor] } else { both[factor] }).collect()
            }
            StudyPlan::Rows(rows) => rows[i].clone(),
            StudyPlan::Search => Vec::new(),
        }
    }

    fn sequence_point(&self, i: usize) -> Vec<f64> {
        self.sequence.as_ref().map_or_else(Vec::new, |s| s.point(i as u32))
    }

    /// The last factor changes from case to case.
    fn grid_point(&self, i: usize) -> Vec<f64> {
        let mut left = i;
        let mut point: Vec<f64> = self
            .levels
            .iter()
            .rev()
            .map(|n| {
                let level = left % n;
                left /= n;
                level_share(level, *n)
            })
            .collect();
        point.reverse();
        point
    }

    fn single_change(&self, i: usize) -> Vec<f64> {
        let mut point = vec![f64::NAN; self.levels.len()];
        let Some(mut left) = i.checked_sub(1) else { return point };
        for (factor, n) in self.levels.iter().enumerate() {
            if left < *n {
                point[factor] = level_share(left, *n);
                break;
            }
            left -= n;
        }
        point
    }
}

/// Coordinate of a level of `n`: from 0 to 1; a single one lies in the middle.
fn level_share(level: usize, n: usize) -> f64 {
    if n > 1 { level as f64 / (n - 1) as f64 } else { 0.5 }
}

/// 0 .. `n` in random order (Fisher and Yates).
fn shuffled(n: usize, seed: u64, stream: usize) -> Vec<u32> {
    let mut random = SplitMix::of(&[seed, u64::MAX, stream as u64]);
    let mut order: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        order.swap(i, random.below(i + 1));
    }
    order
}

/// A point of a trajectory of Morris.
fn trajectory_point(k: usize, levels: usize, seed: u64, trajectory: usize, step: usize) -> Vec<f64> {
    let mut random = SplitMix::of(&[seed, trajectory as u64]);
    let delta = levels as f64 / (2.0 * (levels - 1) as f64);
    let lower = levels / 2;
    // Every factor begins on the lower half and goes up by Delta, or comes from there.
    let begin: Vec<(f64, bool)> =
        (0..k).map(|_| (random.below(lower) as f64 / (levels - 1) as f64, random.below(2) == 1)).collect();
    let mut order: Vec<usize> = (0..k).collect();
    for i in (1..k).rev() {
        order.swap(i, random.below(i + 1));
    }
    let has_moved = |factor: usize| order.iter().position(|f| *f == factor).is_some_and(|at| at < step);
    begin
        .iter()
        .enumerate()
        .map(|(factor, (low, comes_down))| if has_moved(factor) != *comes_down { low + delta } else { *low })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(plan: StudyPlan, levels: &[usize]) -> Vec<Vec<f64>> {
        let design = Design::new(plan, levels).expect("few cases");
        (0..design.points()).map(|i| design.point(i)).collect()
    }

    #[test]
    fn grids_have_every_combination_and_single_changes_one_factor_each() {
        let grid = all(StudyPlan::FullGrid, &[2, 3]);
        assert_eq!(grid.len(), 6);
        assert_eq!((grid[0].as_slice(), grid[5].as_slice()), ([0.0, 0.0].as_slice(), [1.0, 1.0].as_slice()));
        let single = all(StudyPlan::OneAtATime, &[2, 3]);
        assert_eq!(single.len(), 6);
        assert!(single[0].iter().all(|x| x.is_nan()));
        assert!(single[1..].iter().all(|p| p.iter().filter(|x| !x.is_nan()).count() == 1));
        assert!(Design::new(StudyPlan::FullGrid, &[1 << 20, 1 << 20]).is_none());
    }

    #[test]
    fn a_latin_hypercube_has_one_case_in_every_share_of_every_factor() {
        let points = all(StudyPlan::LatinHypercube { cases: 50, seed: 3 }, &[5; 4]);
        for factor in 0..4 {
            let mut shares: Vec<usize> = points.iter().map(|p| (p[factor] * 50.0) as usize).collect();
            shares.sort_unstable();
            assert_eq!(shares, (0..50).collect::<Vec<_>>());
        }
    }

    #[test]
    fn each_step_of_a_trajectory_moves_one_factor_by_delta_and_every_factor_once() {
        let (k, levels) = (5, 4);
        let points = all(StudyPlan::Morris { trajectories: 30, levels, seed: 9 }, &[4; 5]);
        for trajectory in points.chunks(k + 1) {
            let mut moved = Vec::new();
            for pair in trajectory.windows(2) {
                let changed: Vec<usize> = (0..k).filter(|f| pair[0][*f] != pair[1][*f]).collect();
                assert_eq!(changed.len(), 1);
                assert!(((pair[1][changed[0]] - pair[0][changed[0]]).abs() - 2.0 / 3.0).abs() < 1e-15);
                moved.push(changed[0]);
            }
            moved.sort_unstable();
            assert_eq!(moved, (0..k).collect::<Vec<_>>());
            assert!(trajectory.iter().flatten().all(|x| (-1e-15..=1.0 + 1e-15).contains(x)));
        }
    }

    #[test]
    fn matrices_of_saltelli_exchange_one_column_each() {
        let k = 3;
        let points = all(StudyPlan::Saltelli { base: 8, seed: 1 }, &[2; 3]);
        for row in points.chunks(k + 2) {
            for factor in 0..k {
                for other in 0..k {
                    let from = if other == factor { &row[k + 1] } else { &row[0] };
                    assert_eq!(row[factor + 1][other], from[other]);
                }
            }
        }
    }
}
