//! A search over the factors of a study: points from [`super::evolution`], values from its responses, every case in the study's journal.
//!
//! Case 0 is the drive as it is (of several drives, one each); then come generations. The value of a point is the goal's formula, of several
//! drives that of the worst; a case that broke down has none. Because points follow from the values before them, a search that goes on asks
//! for the same points again and takes their values from the journal.

use super::Goal;
use super::bind::{BoundStudy, CaseSpec};
use super::evolution::{Evolution, default_population};
use super::factor::Spread;
use super::run::CaseRow;
use std::collections::BTreeMap;

/// Spread at which a search ends, as a share of the factors' ranges. assumed: a thousandth is finer than a drawing.
const SMALLEST_SPREAD: f64 = 1e-3;

/// A search that has been run as far as its cases are known.
pub struct Search<'a> {
    bound: &'a BoundStudy,
    goal: &'a Goal,
    evolution: Evolution,
    /// Cases that were asked for, in order.
    pub rows: Vec<CaseRow>,
    /// Points of the generation that is open.
    asked: Vec<Vec<f64>>,
    /// Best point so far: its first case, and its value.
    pub best: Option<(usize, f64)>,
}

impl<'a> Search<'a> {
    pub fn new(bound: &'a BoundStudy, goal: &'a Goal) -> Search<'a> {
        let start: Vec<f64> = bound.study.factors.iter().enumerate().map(|(k, _)| start(bound, k)).collect();
        let population = goal.population.unwrap_or_else(|| default_population(start.len()));
        let evolution = Evolution::new(&start, goal.first_sd, population, goal.seed);
        Search { bound, goal, evolution, rows: Vec::new(), asked: Vec::new(), best: None }
    }

    /// The next cases; empty: the search is over.
    pub fn ask(&mut self) -> Vec<CaseSpec> {
        let n = self.bound.drives.len();
        let first = self.rows.len();
        if first == 0 {
            self.asked = vec![vec![f64::NAN; self.bound.study.factors.len()]];
        } else if self.is_over() {
            return Vec::new();
        } else {
            self.asked = self.evolution.ask();
        }
        let case = |number: usize, point: &Vec<f64>| self.bound.case_at(number, number % n.max(1), point.clone());
        self.asked
            .iter()
            .enumerate()
            .flat_map(|(i, point)| (0..n).map(move |d| case(first + i * n + d, point)))
            .collect()
    }

    /// Whether nothing more is worth asking.
    pub fn is_over(&self) -> bool {
        self.evolution.generation() >= self.goal.generations || self.evolution.spread() < SMALLEST_SPREAD
    }

    /// Generations that are done, of those at most.
    pub fn generations(&self) -> (usize, usize) {
        (self.evolution.generation(), self.goal.generations)
    }

    /// Cases of a generation.
    pub fn population(&self) -> usize {
        self.evolution.population() * self.bound.drives.len()
    }

    /// Takes the rows of the cases that were asked for, in their order.
    pub fn tell(&mut self, rows: Vec<CaseRow>) {
        let is_first = self.rows.is_empty();
        let n = self.bound.drives.len().max(1);
        let first = self.rows.len();
        let values: Vec<f64> = rows.chunks(n).map(|own| self.value(own)).collect();
        for (i, value) in values.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
            if self.best.is_none_or(|(_, best)| *value < best) {
                self.best = Some((first + i * n, *value));
            }
        }
        self.rows.extend(rows);
        if !is_first {
            self.evolution.tell(&values);
        }
    }

    /// What is made small, over the drives the largest; NaN where a case has none.
    pub fn value(&self, rows: &[CaseRow]) -> f64 {
        let own = |row: &CaseRow| {
            let value = self.goal.formula.value(|name| self.bound.named(name, &row.case, &row.responses));
            match (row.error.is_some() || !value.is_finite(), self.goal.is_maximised) {
                (true, _) => f64::NAN,
                (false, true) => -value,
                (false, false) => value,
            }
        };
        rows.iter()
            .map(own)
            .fold(f64::NEG_INFINITY, |worst, v| if v.is_nan() || worst.is_nan() { f64::NAN } else { worst.max(v) })
    }

    /// Goes over what a journal has, as far as it has whole generations of this search; returns the known rows of the generation that is open.
    ///
    /// # Errors
    /// The journal has another point under the number of a case: its number.
    pub fn replay(&mut self, known: &BTreeMap<usize, CaseRow>) -> Result<Vec<CaseSpec>, usize> {
        loop {
            let cases = self.ask();
            if let Some(other) =
                cases.iter().find(|c| known.get(&c.number).is_some_and(|row| !is_same_point(&row.case, c)))
            {
                return Err(other.number);
            }
            let rows: Vec<CaseRow> = cases.iter().filter_map(|c| known.get(&c.number).cloned()).collect();
            if cases.is_empty() || rows.len() < cases.len() {
                return Ok(cases);
            }
            self.tell(rows);
        }
    }
}

fn is_same_point(a: &CaseSpec, b: &CaseSpec) -> bool {
    a.point.iter().map(|x| x.to_bits()).eq(b.point.iter().map(|x| x.to_bits()))
}

/// Coordinate of the drive's own value, kept off the ends of the range; the middle where it lies outside.
fn start(bound: &BoundStudy, k: usize) -> f64 {
    let base = bound.drives.first().and_then(|d| d.bases.get(k)?.first().copied()).unwrap_or(f64::NAN);
    let Some(factor) = bound.study.factors.get(k) else { return 0.5 };
    let place = match &factor.spread {
        Spread::Uniform { low, high, by_logarithm } => match (factor.scale, by_logarithm) {
            (super::factor::FactorScale::Absolute, false) => (base - low) / (high - low),
            (super::factor::FactorScale::Absolute, true) => libm::log(base / low) / libm::log(high / low),
            (super::factor::FactorScale::Added | super::factor::FactorScale::Percent, _) => 0.5,
        },
        Spread::Values(_) | Spread::Normal { .. } => 0.5,
    };
    if (0.0..=1.0).contains(&place) { place.clamp(0.02, 0.98) } else { 0.5 }
}
