//! What a study found: distributions of the responses, shares that keep their bounds, sensitivities, the worst cases.

use super::bind::BoundStudy;
use super::design::StudyPlan;
use super::estimates::{
    IntervalEstimate, MorrisEffects, SobolIndices, morris_effects, quantile, rank_correlation, sobol_indices, wilson,
};
use super::factor::{FactorCell, FactorValue};
use super::run::CaseRow;

/// Cases listed as the worst.
pub const WORST: usize = 10;

/// All of a study.
#[derive(Clone, Debug, serde::Serialize)]
pub struct StudySummary {
    pub study: String,
    pub title: String,
    pub plan: &'static str,
    pub cases: usize,
    pub done: usize,
    pub drives: Vec<DriveResults>,
}

/// What the cases of one drive say.
#[derive(Clone, Debug, serde::Serialize)]
pub struct DriveResults {
    pub drive: String,
    /// Cases that are done.
    pub done: usize,
    /// Cases that broke down, and the reasons with their numbers, the most frequent first.
    pub errors: usize,
    pub reasons: Vec<(String, usize)>,
    /// Share of the cases that keep all bounds; those that broke down do not. None: no response has a bound.
    pub keeps_all: Option<IntervalEstimate>,
    pub responses: Vec<ResponseSummary>,
    /// By their smallest margins, or without bounds by the first response, the largest first.
    pub worst: Vec<WorstCase>,
}

/// How the values of one response are distributed, and what moves them.
#[derive(Clone, Debug, serde::Serialize)]
pub struct ResponseSummary {
    pub name: String,
    /// Cases in which it has a value.
    pub values: usize,
    pub mean: f64,
    pub sd: f64,
    pub min: f64,
    pub p05: f64,
    pub median: f64,
    pub p95: f64,
    pub max: f64,
    pub at_most: Option<f64>,
    pub at_least: Option<f64>,
    /// Share of the cases that do not keep its bounds.
    pub fails: Option<IntervalEstimate>,
    pub sensitivities: Vec<Sensitivity>,
    /// Rows or trajectories of the plan that were left out because a value is missing.
    pub left_out: usize,
}

/// What a factor does to a response.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Sensitivity {
    pub factor: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sobol: Option<SobolIndices>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub morris: Option<MorrisEffects>,
    /// None: its values have no order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rank_correlation: Option<IntervalEstimate>,
}

impl Sensitivity {
    /// By which factors are ordered.
    pub fn strength(&self) -> f64 {
        let by_rank = self.rank_correlation.map(|e| e.value.abs());
        let strength = self.sobol.map(|s| s.total.value).or(self.morris.map(|m| m.mu_star.value)).or(by_rank);
        strength.unwrap_or(f64::NEG_INFINITY)
    }
}

/// A case that is worse than others.
#[derive(Clone, Debug, serde::Serialize)]
pub struct WorstCase {
    pub case: usize,
    /// None: it broke down, or there are no bounds.
    pub worst_margin: Option<f64>,
    pub error: Option<String>,
    pub responses: Vec<Option<f64>>,
    /// Factors and their values.
    pub factors: Vec<(String, String)>,
}

/// Sums up the rows of a study, in the order of their cases.
pub fn summarise(bound: &BoundStudy, rows: &[&CaseRow]) -> StudySummary {
    let drive = |k: usize| {
        let own: Vec<&CaseRow> = rows.iter().copied().filter(|row| row.case.drive == k).collect();
        drive_results(bound, k, &own)
    };
    StudySummary {
        study: bound.study.name.clone(),
        title: bound.study.title.clone(),
        plan: if bound.study.goal.is_some() { "search" } else { bound.design.plan().name() },
        cases: bound.cases().max(rows.len()),
        done: rows.len(),
        drives: (0..bound.drives.len()).map(drive).collect(),
    }
}

fn drive_results(bound: &BoundStudy, drive: usize, rows: &[&CaseRow]) -> DriveResults {
    let has_bounds = bound.study.responses.iter().any(super::Response::has_bound);
    let kept = rows.iter().filter(|row| row.error.is_none() && bound.keeps_all(&row.responses)).count();
    let mut reasons: Vec<(String, usize)> = Vec::new();
    for why in rows.iter().filter_map(|row| row.error.as_deref()) {
        match reasons.iter_mut().find(|(known, _)| is_alike(known, why)) {
            Some((_, n)) => *n += 1,
            None => reasons.push((why.to_string(), 1)),
        }
    }
    reasons.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    DriveResults {
        drive: bound.drives.get(drive).map_or_else(String::new, |d| d.name.clone()),
        done: rows.len(),
        errors: rows.iter().filter(|row| row.error.is_some()).count(),
        reasons,
        keeps_all: has_bounds.then(|| wilson(kept, rows.len())),
        responses: (0..bound.study.responses.len()).map(|k| response_summary(bound, rows, k)).collect(),
        worst: worst(bound, rows, has_bounds),
    }
}

/// Two reasons that differ in their numbers alone.
fn is_alike(a: &str, b: &str) -> bool {
    let words =
        |text: &str| text.chars().filter(|c| !c.is_ascii_digit() && !matches!(c, '.' | '-' | 'e')).collect::<String>();
    words(a) == words(b)
}

fn value_of(row: &CaseRow, k: usize) -> Option<f64> {
    row.responses.get(k).copied().flatten()
}

fn response_summary(bound: &BoundStudy, rows: &[&CaseRow], k: usize) -> ResponseSummary {
    let response = bound.study.responses.get(k);
    let mut values: Vec<f64> = rows.iter().filter_map(|row| value_of(row, k)).collect();
    values.sort_by(f64::total_cmp);
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let sd = libm::sqrt(values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0).max(1.0));
    let fails = response.filter(|r| r.has_bound()).map(|r| {
        let failing = rows.iter().filter(|row| row.error.is_some() || !r.keeps(value_of(row, k))).count();
        wilson(failing, rows.len())
    });
    let (sensitivities, left_out) = sensitivities(bound, rows, k);
    ResponseSummary {
        name: response.map_or_else(String::new, |r| r.name.clone()),
        values: values.len(),
        mean,
        sd,
        min: quantile(&values, 0.0),
        p05: quantile(&values, 0.05),
        median: quantile(&values, 0.5),
        p95: quantile(&values, 0.95),
        max: quantile(&values, 1.0),
        at_most: response.and_then(|r| r.at_most),
        at_least: response.and_then(|r| r.at_least),
        fails,
        sensitivities,
        left_out,
    }
}

/// Sensitivities as the plan allows them, the strongest factor first, and what was left out.
fn sensitivities(bound: &BoundStudy, rows: &[&CaseRow], response: usize) -> (Vec<Sensitivity>, usize) {
    let factors = &bound.study.factors;
    let k = factors.len();
    let none = |name: &str| Sensitivity { factor: name.to_string(), sobol: None, morris: None, rank_correlation: None };
    let points = bound.design.points().max(1);
    // Rows of a matrix or a trajectory that are whole; the others are counted.
    let groups = |size: usize| {
        let mut whole: Vec<Vec<&CaseRow>> = Vec::new();
        let mut at = 0;
        while let Some(first) = rows.get(at) {
            let number = first.case.number % points / size;
            let own: Vec<&CaseRow> =
                rows.iter().skip(at).copied().take_while(|row| row.case.number % points / size == number).collect();
            at += own.len();
            whole.push(own);
        }
        let before = whole.len();
        whole.retain(|own| own.len() == size && own.iter().all(|row| value_of(row, response).is_some()));
        let left_out = before - whole.len();
        (whole, left_out)
    };
    let value = |row: &CaseRow| value_of(row, response).unwrap_or(f64::NAN);
    let (mut all, left_out): (Vec<Sensitivity>, usize) = match bound.design.plan() {
        StudyPlan::Saltelli { .. } => {
            let (whole, left_out) = groups(k + 2);
            let matrix: Vec<Vec<f64>> = whole.iter().map(|own| own.iter().map(|row| value(row)).collect()).collect();
            let found = sobol_indices(&matrix, k).into_iter().flatten();
            (
                factors.iter().zip(found).map(|(f, own)| Sensitivity { sobol: Some(own), ..none(&f.name) }).collect(),
                left_out,
            )
        }
        StudyPlan::Morris { .. } => {
            let (whole, left_out) = groups(k + 1);
            let trajectories: Vec<Vec<(Vec<f64>, f64)>> =
                whole.iter().map(|own| own.iter().map(|row| (row.case.point.clone(), value(row))).collect()).collect();
            let found = morris_effects(&trajectories, k).into_iter().flatten();
            (
                factors.iter().zip(found).map(|(f, own)| Sensitivity { morris: Some(own), ..none(&f.name) }).collect(),
                left_out,
            )
        }
        StudyPlan::FullGrid
        | StudyPlan::OneAtATime
        | StudyPlan::LatinHypercube { .. }
        | StudyPlan::Sobol { .. }
        | StudyPlan::Random { .. }
        | StudyPlan::Rows(_)
        | StudyPlan::Search => {
            let correlation = |f: usize| {
                let pair = |row: &&CaseRow| match row.case.cells.get(f)? {
                    FactorCell::Value(FactorValue::Number(x)) => Some((*x, value_of(row, response)?)),
                    FactorCell::Unset
                    | FactorCell::Seed(_)
                    | FactorCell::Value(FactorValue::Text(_) | FactorValue::Flag(_)) => None,
                };
                let (x, y): (Vec<f64>, Vec<f64>) = rows.iter().filter_map(pair).unzip();
                rank_correlation(&x, &y)
            };
            let of = |(k, f): (usize, &super::factor::Factor)| Sensitivity {
                rank_correlation: correlation(k),
                ..none(&f.name)
            };
            (factors.iter().enumerate().map(of).collect(), 0)
        }
    };
    all.sort_by(|a, b| b.strength().total_cmp(&a.strength()));
    (all, left_out)
}

fn worst(bound: &BoundStudy, rows: &[&CaseRow], has_bounds: bool) -> Vec<WorstCase> {
    let badness = |row: &CaseRow| match (row.error.is_some(), has_bounds) {
        (true, _) => f64::INFINITY,
        (false, true) => -bound.worst_margin(&row.responses),
        (false, false) => value_of(row, 0).unwrap_or(f64::NEG_INFINITY),
    };
    let mut order: Vec<&CaseRow> = rows.to_vec();
    order.sort_by(|a, b| badness(b).total_cmp(&badness(a)).then_with(|| a.case.number.cmp(&b.case.number)));
    let own = |row: &&CaseRow| WorstCase {
        case: row.case.number,
        worst_margin: (has_bounds && row.error.is_none())
            .then(|| bound.worst_margin(&row.responses))
            .filter(|m| m.is_finite()),
        error: row.error.clone(),
        responses: row.responses.clone(),
        factors: bound
            .study
            .factors
            .iter()
            .zip(&row.case.cells)
            .map(|(f, cell)| (f.name.clone(), shown(cell)))
            .collect(),
    };
    order.iter().take(WORST).map(own).collect()
}

/// A cell as a reader sees it.
pub fn shown(cell: &FactorCell) -> String {
    match cell {
        FactorCell::Unset => "the drive's".into(),
        FactorCell::Seed(seed) => format!("links {seed}"),
        FactorCell::Value(FactorValue::Number(x)) => format!("{}", (x * 1e6).round() / 1e6),
        FactorCell::Value(value) => value.shown(),
    }
}
