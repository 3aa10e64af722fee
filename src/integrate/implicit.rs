//! The implicit scheme of Hilber, Hughes and Taylor (HHT-alpha).
//!
//! ```text
//! M a(n+1) = (1 + alpha) f(n+1) - alpha f(n)              alpha in -1/3 .. 0
//! q(n+1)   = q_n + h v_n + h^2 [(1/2 - beta) a_n + beta a(n+1)]
//! v(n+1)   = v_n + h [(1 - gamma) a_n + gamma a(n+1)]     beta = (1 - alpha)^2 / 4, gamma = 1/2 - alpha
//! ```
//! Second order, stable for linear systems at any step; alpha = 0 is the trapezoidal rule, which damps nothing, alpha = -1/3 damps what has
//! few steps a period: a free oscillator falls to rho of its amplitude with every step, rho = 1/2 as omega h grows. What it takes is in no
//! account, so that the ledger's error shows it. Sources: Hilber, Hughes and Taylor 1977; Negrut et al. 2007 for bodies.
//!
//! a(n+1) is found by Newton's method, with a matrix from differences of forces: links a step of three apart do not feel each other, so that
//! all of one colour are moved at once. Rows of coordinates are the transposed columns, by masses. The matrix is
//! computed anew where it serves no more, and at the beginning of every step: a run goes on from any node to the same bits.

use super::StepError;
use super::cyclic_blocks::{CyclicBlocks, Eliminated};
use super::instant::InstantForces;
use super::predictor::largest;
use super::scheme::{SchemeSummary, unsolved};
use crate::model::Model;
use nalgebra::Vector3;

/// Correction of the speeds at which a step counts as solved [m/s]: a billionth of a chain's speed.
pub(super) const SOLVED_M_S: f64 = 1e-8;
/// Correction that is borne where more corrections do not help [m/s], and told: 1e-5 of a chain's speed. Forces change at once, by little,
/// where contacts begin, and then no speed between is right.
const BORNE_M_S: f64 = 1e-4;
const BORNE_AFTER: usize = 15;
/// Corrections of a step at most.
const MOST_CORRECTIONS: usize = 60;
/// Share of the last correction above which the matrix is computed anew.
const SLOW: f64 = 0.25;
/// Halvings of a correction that leaves more unbalanced than before, at most; beyond them it is taken as it is.
const MOST_HALVINGS: usize = 10;
/// Move by which differences of forces are taken [m]: small against penetrations, large against their rounding.
const DIFFERENCE_M: f64 = 1e-9;

/// A step of the scheme, with what it keeps from one to the next.
pub(super) struct ImplicitStep {
    step_s: f64,
    alpha: f64,
    beta: f64,
    gamma: f64,
    masses: Vec<f64>,
    arms_m: Vec<f64>,
    /// Number of links in every loop, and the links of every colour.
    loops: Vec<usize>,
    colours: Vec<Vec<usize>>,
    matrix: Option<Eliminated>,
    pub(super) told: SchemeSummary,
}

/// Links by colours: no two of one colour are neighbours or have one in common.
fn colours(loops: &[usize]) -> Vec<Vec<usize>> {
    let mut colours: Vec<Vec<usize>> = vec![Vec::new(); 5];
    let mut begin = 0;
    for count in loops {
        let whole = count - count % 3;
        for i in 0..*count {
            colours[if i < whole { i % 3 } else { 3 + i - whole }].push(begin + i);
        }
        begin += count;
    }
    colours.retain(|own| !own.is_empty());
    colours
}

impl ImplicitStep {
    pub(super) fn new(model: &Model, instant: &InstantForces, alpha: f64) -> ImplicitStep {
        let loops: Vec<usize> = model.chain.loops.iter().map(ExactSizeIterator::len).filter(|n| *n > 0).collect();
        ImplicitStep {
            step_s: model.step_s,
            alpha,
            beta: 0.25 * (1.0 - alpha) * (1.0 - alpha),
            gamma: 0.5 - alpha,
            masses: instant.freedoms.masses(model),
            arms_m: instant.freedoms.arms_m(model),
            colours: colours(&loops),
            loops,
            matrix: None,
            told: SchemeSummary::Hht { borne_steps: 0, left_m_s: 0.0 },
        }
    }

    /// Speeds and accelerations at the end of a step, from those at its beginning and the accelerations by the forces there.
    pub(super) fn solve(
        &mut self,
        instant: &mut InstantForces,
        by_forces: &[f64],
        begin: [&[f64]; 2],
    ) -> Result<[Vec<f64>; 2], StepError> {
        let h = self.step_s;
        self.matrix = None;
        let mut a = begin[1].to_vec();
        let mut first = self.residual(instant, by_forces, begin, &a);
        if first.is_err() {
            // A chain that comes apart with the accelerations of the beginning may hold without them.
            a.fill(0.0);
            first = self.residual(instant, by_forces, begin, &a);
        }
        let (mut residual, mut forces) = first?;
        let mut unbalanced = self.unbalanced(&residual);
        let mut last = f64::INFINITY;
        let mut is_fresh = false;
        for corrections in 0..MOST_CORRECTIONS {
            if self.matrix.is_none() {
                self.matrix = self.matrix_at(instant, begin, &a, &forces)?.eliminated();
                is_fresh = true;
            }
            let correction = self.matrix.as_ref().and_then(|m| m.solve(&residual));
            let Some(correction) = correction else {
                return Err(unsolved(instant.time_s(), "the matrix of a step".into(), f64::NAN));
            };
            let moved_m_s = self.gamma * h * self.largest(&correction);
            if moved_m_s <= if corrections < BORNE_AFTER { SOLVED_M_S } else { BORNE_M_S } {
                a.iter_mut().zip(&correction).for_each(|(a, d)| *a -= d);
                if let SchemeSummary::Hht { borne_steps, left_m_s } = &mut self.told {
                    *borne_steps += u64::from(moved_m_s > SOLVED_M_S);
                    *left_m_s = left_m_s.max(moved_m_s);
                }
                let end = self.motion(begin, &a);
                // Where the step ends is where the oil and all bodies are taken from.
                instant.accelerations(instant.ticks(), [&end[0], &end[1], &a])?;
                return Ok([end[1].clone(), a]);
            }
            if !is_fresh && moved_m_s > SLOW * last {
                self.matrix = None;
                continue;
            }
            last = moved_m_s;
            let mut share = 1.0;
            for halving in 0..=MOST_HALVINGS {
                let tried: Vec<f64> = a.iter().zip(&correction).map(|(a, d)| a - share * d).collect();
                let next = self.residual(instant, by_forces, begin, &tried);
                let left = next.as_ref().map_or(f64::INFINITY, |(next, _)| self.unbalanced(next));
                let is_last = halving == MOST_HALVINGS;
                if left < (1.0 - 0.1 * share) * unbalanced || is_last && left.is_finite() {
                    (residual, forces) = next?;
                    (a, unbalanced) = (tried, left);
                    break;
                }
                if is_last {
                    next?;
                    return Err(unsolved(instant.time_s(), "its forces".into(), f64::NAN));
                }
                share *= 0.5;
            }
            if share < 1.0 {
                (self.matrix, last) = (None, f64::INFINITY);
            }
            is_fresh = false;
        }
        let worst = self.worst(&residual);
        let left_m_s = self.gamma
            * h
            * residual.get(worst).map_or(0.0, |r| r.abs())
            * self.arms_m.get(worst).copied().unwrap_or(1.0);
        Err(unsolved(instant.time_s(), instant.name_of(worst), left_m_s))
    }

    /// Displacements and speeds at the end of a step with these accelerations there.
    fn motion(&self, [speeds, from]: [&[f64]; 2], a: &[f64]) -> [Vec<f64>; 2] {
        let h = self.step_s;
        let (old, new) = (h * h * (0.5 - self.beta), h * h * self.beta);
        let moved = (0..a.len()).map(|i| h * speeds[i] + old * from[i] + new * a[i]).collect();
        let (old, new) = (h * (1.0 - self.gamma), h * self.gamma);
        [moved, (0..a.len()).map(|i| speeds[i] + old * from[i] + new * a[i]).collect()]
    }

    /// What accelerations at the end leave unbalanced, and those by the forces there.
    fn residual(
        &self,
        instant: &mut InstantForces,
        by_forces: &[f64],
        begin: [&[f64]; 2],
        a: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), StepError> {
        let [moved, speeds] = self.motion(begin, a);
        let forces = instant.accelerations(instant.ticks(), [&moved, &speeds, a])?;
        let left = (0..a.len()).map(|i| a[i] - (1.0 + self.alpha) * forces[i] + self.alpha * by_forces[i]).collect();
        Ok((left, forces))
    }

    /// A sum of squares of unbalanced forces, each over the root of its mass.
    fn unbalanced(&self, residual: &[f64]) -> f64 {
        residual.iter().zip(&self.masses).map(|(r, m)| m * r * r).sum::<f64>().sqrt()
    }

    /// Largest acceleration, of what turns at its arm [m/s2].
    fn largest(&self, a: &[f64]) -> f64 {
        a.iter().zip(&self.arms_m).map(|(a, arm)| (a * arm).abs()).fold(0.0, largest)
    }

    fn worst(&self, residual: &[f64]) -> usize {
        let size = |i: &usize| (residual[*i] * self.arms_m[*i]).abs();
        (0..residual.len()).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(0)
    }

    /// Derivatives of the residual by the accelerations at the end of the step.
    fn matrix_at(
        &self,
        instant: &mut InstantForces,
        begin: [&[f64]; 2],
        a: &[f64],
        forces: &[f64],
    ) -> Result<CyclicBlocks, StepError> {
        let h2 = self.beta * self.step_s * self.step_s;
        let n: usize = self.loops.iter().sum();
        let m = a.len() - 3 * n;
        let mut system = CyclicBlocks::new(self.loops.clone(), m);
        let neighbours = self.neighbours();
        let mut tried = a.to_vec();
        let moved_by = |i: usize| DIFFERENCE_M / (self.arms_m[i] * h2);
        let mut change = |tried: &[f64]| -> Result<Vec<f64>, StepError> {
            let [moved, speeds] = self.motion(begin, tried);
            let now = instant.accelerations(instant.ticks(), [&moved, &speeds, tried])?;
            Ok(now.iter().zip(forces).map(|(now, before)| -(1.0 + self.alpha) * (now - before)).collect())
        };
        for colour in &self.colours {
            for axis in 0..3 {
                colour.iter().for_each(|i| tried[3 * i + axis] += moved_by(3 * i + axis));
                let change = change(&tried)?;
                for i in colour {
                    tried[3 * i + axis] = a[3 * i + axis];
                    let by = moved_by(3 * i + axis);
                    let [before, next] = neighbours[*i];
                    for (row, place) in [(before, 2), (*i, 1), (next, 0)] {
                        let column = Vector3::from_column_slice(&change[3 * row..3 * row + 3]) / by;
                        let mut block = system.rows[row][place].column_mut(axis);
                        block += column;
                    }
                    system.rows[*i][1][(axis, axis)] += 1.0;
                }
            }
        }
        for c in 0..m {
            let at = 3 * n + c;
            tried[at] += moved_by(at);
            let change = change(&tried)?;
            tried[at] = a[at];
            for i in 0..n {
                let column = Vector3::from_column_slice(&change[3 * i..3 * i + 3]) / moved_by(at);
                system.columns[c][i] = column;
                let by_mass = Vector3::from_column_slice(&self.masses[3 * i..3 * i + 3]) / self.masses[at];
                system.border_rows[c][i] = column.component_mul(&by_mass);
            }
            for d in 0..m {
                system.corner[(d, c)] = change[3 * n + d] / moved_by(at) + if d == c { 1.0 } else { 0.0 };
            }
        }
        Ok(system)
    }

    /// The links before and behind every link.
    fn neighbours(&self) -> Vec<[usize; 2]> {
        let mut begin = 0;
        let mut all = Vec::new();
        for count in &self.loops {
            all.extend((0..*count).map(|i| [begin + (i + count - 1) % count, begin + (i + 1) % count]));
            begin += count;
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Links of one colour are at least three apart, round the loop too, and every link has one.
    #[test]
    fn colours_keep_links_apart() {
        for loops in [vec![48], vec![3, 49], vec![50], vec![5]] {
            let all = colours(&loops);
            let mut seen: Vec<usize> = all.concat();
            seen.sort_unstable();
            assert!(seen.iter().copied().eq(0..loops.iter().sum()), "{loops:?}");
            let (told, mut begin) = (format!("{loops:?}"), 0);
            for count in loops {
                for colour in &all {
                    let own: Vec<usize> =
                        colour.iter().copied().filter(|i| (begin..begin + count).contains(i)).collect();
                    for (a, b) in own.iter().flat_map(|a| own.iter().map(move |b| (*a, *b))).filter(|(a, b)| a < b) {
                        let apart = (b - a).min(count + a - b);
                        assert!(apart >= 3, "{told}: {a} and {b}");
                    }
                }
                begin += count;
            }
        }
    }
}
