//! A study bound to its drives: every path found, every factor's values known, every case ready to run.

use super::case::{CaseError, CaseFacts, CaseNeeds, is_known, number_at, paths};
use super::design::{Design, StudyPlan};
use super::factor::{Factor, FactorCell, FactorScale};
use super::{Response, ResponseSource, SignalMeasure, Study, WORST_MARGIN};
use crate::analysis::order_spectrum::{AngleRecord, SpectrumError, spectrum};
use crate::compare::has_links_on_its_driver;
use crate::diag::{Diag, Report, nearest};
use crate::drive::Drive;
use crate::drive::document::{DocumentTable, DocumentValue};
use serde_json::Value;

/// A drive of a study.
pub struct StudyDrive {
    /// As the study file has it.
    pub name: String,
    /// With what all cases set.
    pub nominal: Drive,
    /// The drive's values of every factor's paths, in the units of their keys; NaN where nobody asks for them.
    pub bases: Vec<Vec<f64>>,
}

/// A study and what it runs.
pub struct BoundStudy {
    pub study: Study,
    pub drives: Vec<StudyDrive>,
    pub design: Design,
    pub needs: CaseNeeds,
    /// Hash of everything that the results depend on, except the program itself.
    pub fingerprint: u64,
}

/// One case, ready to run.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseSpec {
    pub number: usize,
    /// Index of its drive.
    pub drive: usize,
    /// Coordinates, a factor each; what they were made from where a table gives values.
    pub point: Vec<f64>,
    pub cells: Vec<FactorCell>,
}

impl BoundStudy {
    /// `texts`: name and text of every drive. `rows`: for a plan from a file, values of the factors row by row.
    ///
    /// # Errors
    /// A path or a quantity that a drive does not have, at its place in the study file.
    pub fn bind(study: Study, texts: &[(String, String)], rows: Option<Vec<Vec<f64>>>) -> Result<BoundStudy, Report> {
        let mut drives = Vec::new();
        let mut diags = Vec::new();
        for (name, (file, text)) in study.drives.iter().zip(texts) {
            let nominal = match Drive::parse(file, text, &study.set) {
                Ok(nominal) => nominal,
                Err(_) if study.set.is_empty() || Drive::parse(file, text, &[]).is_err() => {
                    return Err(Drive::parse(file, text, &[]).err().unwrap_or_else(|| study.places.report(Vec::new())));
                }
                Err(report) => {
                    let told = |d: Diag| {
                        study.places.error("set", format!("`set` does not fit `{name}`: {}", d.title), d.help)
                    };
                    return Err(study.places.report(report.diags.into_iter().map(told).collect()));
                }
            };
            let bases: Vec<Vec<f64>> = study
                .factors
                .iter()
                .map(|f| f.paths.iter().map(|path| base(&nominal, &study.set, path)).collect())
                .collect();
            drives.push(StudyDrive { name: name.clone(), nominal, bases });
        }
        let needs = study.needs();
        for drive in &drives {
            check_factors(&study, drive, &mut diags);
            if needs.compare && !has_links_on_its_driver(&drive.nominal) {
                let at = study
                    .responses
                    .iter()
                    .find(|r| matches!(&r.source, ResponseSource::Path(p) if p.starts_with("compare.")));
                let path = at.map_or_else(|| "responses".to_string(), |r| format!("responses.{}.of", r.name));
                let title =
                    format!("`{}` has spans in place of links on its driver, and `compare` watches links", drive.name);
                diags.push(study.places.error(&path, title, None));
            }
        }
        let plan = match (&study.plan, rows) {
            (super::PlanSpec::Design(plan), _) => plan.clone(),
            (super::PlanSpec::File(_), rows) => StudyPlan::Rows(rows.unwrap_or_default()),
        };
        let levels: Vec<usize> = study.factors.iter().map(|f| f.levels).collect();
        let design = Design::new(plan, &levels)
            .filter(|d| d.points().checked_mul(drives.len()).is_some_and(|n| n <= super::design::MOST_CASES));
        if design.is_none() {
            diags.push(study.places.error(
                "plan",
                format!("this plan has more than {} cases", super::design::MOST_CASES),
                Some("split it into several studies".into()),
            ));
        }
        let Some(design) = design.filter(|_| diags.is_empty()) else {
            return Err(study.places.report(diags));
        };
        let fingerprint = fingerprint(&study, &drives, &design);
        Ok(BoundStudy { study, drives, design, needs, fingerprint })
    }

    /// Number of cases; of a search, none before it asks.
    pub fn cases(&self) -> usize {
        self.design.points() * self.drives.len()
    }

    /// A case of the plan.
    pub fn case(&self, number: usize) -> CaseSpec {
        let points = self.design.points().max(1);
        self.case_at(number, number / points, self.design.point(number % points))
    }

    /// The drives as they are, before anything is varied.
    pub fn nominal_case(&self, drive: usize) -> CaseSpec {
        self.case_at(0, drive, vec![f64::NAN; self.study.factors.len()])
    }

    /// A case at any point.
    pub fn case_at(&self, number: usize, drive: usize, point: Vec<f64>) -> CaseSpec {
        let own = self.drives.get(drive).map_or([].as_slice(), |own| own.bases.as_slice());
        let cells =
            self.study.factors.iter().zip(own).zip(&point).map(|((factor, bases), u)| match self.gives_values() {
                true => factor.cell_of_value(*u),
                false => factor.cell(self.coordinate(factor, *u), bases.first().copied().unwrap_or(f64::NAN)),
            });
        let cells = cells.collect();
        CaseSpec { number, drive, point, cells }
    }

    /// `path=value` of a case, beside those of all cases.
    pub fn overrides(&self, case: &CaseSpec) -> Vec<String> {
        let Some(own) = self.drives.get(case.drive) else { return Vec::new() };
        let links = own.nominal.links;
        let of = |((factor, bases), u): ((&Factor, &Vec<f64>), &f64)| match self.gives_values() {
            true => factor.overrides_of_value(*u, bases, links),
            false => factor.overrides(self.coordinate(factor, *u), bases, links),
        };
        self.study.factors.iter().zip(&own.bases).zip(&case.point).flat_map(of).collect()
    }

    /// Whether points are values of the factors, not coordinates.
    fn gives_values(&self) -> bool {
        matches!(self.study.plan, super::PlanSpec::File(_))
    }

    /// The coordinate at which a factor is taken: levels of a grid keep off the ends of a normal distribution.
    fn coordinate(&self, factor: &Factor, u: f64) -> f64 {
        match self.design.plan() {
            StudyPlan::FullGrid | StudyPlan::OneAtATime => factor.grid_coordinate(u, factor.levels),
            StudyPlan::Morris { levels, .. } => factor.grid_coordinate(u, *levels),
            StudyPlan::LatinHypercube { .. }
            | StudyPlan::Sobol { .. }
            | StudyPlan::Random { .. }
            | StudyPlan::Saltelli { .. }
            | StudyPlan::Rows(_)
            | StudyPlan::Search => u,
        }
    }

    /// The drive of a case.
    ///
    /// # Errors
    /// Its values are none that the drive can have.
    pub fn drive_of(&self, case: &CaseSpec) -> Result<Drive, CaseError> {
        let Some(own) = self.drives.get(case.drive) else { return Err(CaseError("no such drive".into())) };
        let set: Vec<String> = self.study.set.iter().cloned().chain(self.overrides(case)).collect();
        Drive::parse(&own.nominal.name, &own.nominal.text, &set).map_err(|report| CaseError::from(&report))
    }

    /// Responses of a case from what its run gave; None where there is no finite value.
    pub fn responses(&self, case: &CaseSpec, facts: &CaseFacts) -> Vec<Option<f64>> {
        let mut values: Vec<Option<f64>> = Vec::new();
        for response in &self.study.responses {
            let value = match &response.source {
                ResponseSource::Path(path) => number_at(&facts.tree, path),
                ResponseSource::Signal(name, measure) => {
                    let at = self.needs.signals.iter().position(|s| s == name);
                    at.and_then(|k| facts.signals.get(k)).and_then(|record| measured(record, *measure))
                }
                ResponseSource::Formula(formula) => Some(formula.value(|name| self.named(name, case, &values))),
            };
            values.push(value.filter(|v| v.is_finite()));
        }
        values
    }

    /// A response, a factor or the smallest margin by its name; NaN where it is missing.
    pub fn named(&self, name: &str, case: &CaseSpec, values: &[Option<f64>]) -> f64 {
        if name == WORST_MARGIN {
            return self.worst_margin(values);
        }
        if let Some(k) = self.study.responses.iter().position(|r| r.name == name) {
            return values.get(k).copied().flatten().unwrap_or(f64::NAN);
        }
        let Some(k) = self.study.factors.iter().position(|f| f.name == name) else { return f64::NAN };
        match case.cells.get(k) {
            Some(FactorCell::Value(super::factor::FactorValue::Number(x))) => *x,
            // The drive's own.
            Some(FactorCell::Unset) => {
                self.drives.get(case.drive).and_then(|d| d.bases.get(k)?.first().copied()).unwrap_or(f64::NAN)
            }
            Some(
                FactorCell::Value(super::factor::FactorValue::Text(_) | super::factor::FactorValue::Flag(_))
                | FactorCell::Seed(_),
            )
            | None => f64::NAN,
        }
    }

    /// Smallest margin of the responses to their bounds.
    pub fn worst_margin(&self, values: &[Option<f64>]) -> f64 {
        self.study.responses.iter().zip(values).map(|(r, v)| r.margin(*v)).fold(f64::INFINITY, f64::min)
    }

    /// Whether the responses of a case keep all bounds.
    pub fn keeps_all(&self, values: &[Option<f64>]) -> bool {
        self.study
            .responses
            .iter()
            .enumerate()
            .all(|(k, r)| !r.has_bound() || r.keeps(values.get(k).copied().flatten()))
    }

    /// Checks that a run has what the responses ask for.
    ///
    /// # Errors
    /// Something that it does not have, at its place in the study file.
    pub fn check_responses(&self, facts: &CaseFacts) -> Result<(), Report> {
        let known = |r: &&Response| match &r.source {
            ResponseSource::Path(path) => !is_known(&facts.tree, path),
            ResponseSource::Signal(..) | ResponseSource::Formula(_) => false,
        };
        let wrong = |r: &Response| -> Diag {
            let path = match &r.source {
                ResponseSource::Path(path) => path.as_str(),
                ResponseSource::Signal(..) | ResponseSource::Formula(_) => "",
            };
            let all = paths(&facts.tree);
            let help = match nearest(path, all.iter().map(String::as_str)) {
                Some(near) => format!("did you mean `{near}`? {}", section_help(&facts.tree, path)),
                None => section_help(&facts.tree, path),
            };
            self.study.places.error(
                &format!("responses.{}.of", r.name),
                format!("a run gives no number `{path}`"),
                Some(help),
            )
        };
        let diags: Vec<Diag> = self.study.responses.iter().filter(known).map(wrong).collect();
        if diags.is_empty() { Ok(()) } else { Err(self.study.places.report(diags)) }
    }

    /// Responses that have no value here, each with the reason.
    pub fn missing(&self, case: &CaseSpec, facts: &CaseFacts) -> Vec<String> {
        let why = |response: &Response| match &response.source {
            ResponseSource::Path(path) => format!("`{path}` could not be measured"),
            ResponseSource::Formula(formula) => format!("`{}` has no finite value", formula.text),
            ResponseSource::Signal(name, measure) => {
                let at = self.needs.signals.iter().position(|s| s == name);
                match (at.and_then(|k| facts.signals.get(k)).map(spectrum), measure) {
                    (Some(Err(SpectrumError::Short { needed_s, .. })), SignalMeasure::Order(_)) => {
                        format!("its spectrum takes runs of {:.1} ms", needed_s * 1e3)
                    }
                    (Some(Err(SpectrumError::Still)), SignalMeasure::Order(_)) => "the driver stands still".into(),
                    (Some(Err(SpectrumError::Few(there, needed))), SignalMeasure::Order(_)) => {
                        format!("its spectrum takes {needed} values, and there are {there}: make `every_us` smaller")
                    }
                    (Some(Err(_) | Ok(_)) | None, _) => format!("`{name}` has no value"),
                }
            }
        };
        let values = self.responses(case, facts);
        let missing = self.study.responses.iter().zip(&values).filter(|(_, value)| value.is_none());
        missing.map(|(r, _)| format!("response `{}` is missing for the drive as it is: {}", r.name, why(r))).collect()
    }
}

/// What there is, by sections.
fn section_help(tree: &Value, path: &str) -> String {
    let section = path.split('.').next().unwrap_or_default();
    let own: Vec<String> = paths(tree).into_iter().filter(|p| p.split('.').next() == Some(section)).collect();
    match own.is_empty() {
        true => "sections: run, assembly, compare, impacts".into(),
        false => format!("`{section}` gives: {}", own.join(", ")),
    }
}

/// A number over a signal.
fn measured(record: &AngleRecord, measure: SignalMeasure) -> Option<f64> {
    let values = &record.values;
    let n = values.len() as f64;
    if values.is_empty() {
        return None;
    }
    let mean = values.iter().sum::<f64>() / n;
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    Some(match measure {
        SignalMeasure::Mean => mean,
        SignalMeasure::Min => low,
        SignalMeasure::Max => high,
        SignalMeasure::PeakToPeak => high - low,
        SignalMeasure::StandardDeviation => libm::sqrt(values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n),
        SignalMeasure::Rms => libm::sqrt(values.iter().map(|v| v * v).sum::<f64>() / n),
        SignalMeasure::Last => values.last().copied()?,
        SignalMeasure::Order(order) => spectrum(record).ok()?.near(order),
    })
}

/// The drive's value at a path, in the unit of its key: as `set` or the file has it, else as its reader takes it.
fn base(drive: &Drive, set: &[String], path: &str) -> f64 {
    if path.contains('*') {
        return 0.0;
    }
    let given = set.iter().rev().filter_map(|s| s.split_once('=')).find(|(p, _)| p.trim() == path);
    let number = |text: &str| DocumentValue::from_toml(toml::de::DeValue::parse(text.trim()).ok()?.get_ref()).number();
    if let Some(value) = given.and_then(|(_, value)| number(value)) {
        return value;
    }
    if let Some(value) = in_document(&drive.document, path) {
        return value;
    }
    drive.places.numbers().find(|(p, _)| *p == path).map_or(f64::NAN, |(_, number)| number.value / number.unit)
}

fn in_document(table: &DocumentTable, path: &str) -> Option<f64> {
    match path.split_once('.') {
        None => table.0.get(path)?.value.number(),
        Some((first, rest)) => match &table.0.get(first)?.value {
            DocumentValue::Table(inner) => in_document(inner, rest),
            DocumentValue::Text(_)
            | DocumentValue::Whole(..)
            | DocumentValue::Number(_)
            | DocumentValue::Flag(_)
            | DocumentValue::Date
            | DocumentValue::List(_) => None,
        },
    }
}

/// Sets factors to their values, and tells what the drive says to that: a path that it does not have, a text in place of a number. Values
/// that it cannot have in some cases are no mistake of the study: they become rows.
fn check_factors(study: &Study, drive: &StudyDrive, diags: &mut Vec<Diag>) {
    let key =
        |factor: &Factor| format!("factors.{}.{}", factor.name, if factor.paths.len() > 1 { "paths" } else { "path" });
    let tried = |set: Vec<String>| -> Option<Diag> {
        let all: Vec<String> = study.set.iter().cloned().chain(set).collect();
        Drive::parse(&drive.nominal.name, &drive.nominal.text, &all).err()?.diags.into_iter().next()
    };
    let mut told = |factor: &Factor, why: String, help: Option<String>| {
        let title = format!("factor `{}` does not fit `{}`: {why}", factor.name, drive.name);
        diags.push(study.places.error(&key(factor), title, help));
    };
    let is_rows = matches!(study.plan, super::PlanSpec::File(_));
    let own = || study.factors.iter().zip(&drive.bases);
    let mut has_bases = true;
    for (factor, bases) in own() {
        let lacks = factor.paths.iter().zip(bases).find(|(_, base)| base.is_nan()).map(|(path, _)| path);
        if let Some(path) = lacks.filter(|_| factor.scale != FactorScale::Absolute || is_rows) {
            match tried(vec![format!("{path}=1")]).filter(|d| d.title.contains("no value")) {
                Some(first) => told(factor, first.title, first.help),
                None if factor.scale == FactorScale::Absolute => continue,
                None => {
                    let help = "give the factor `low` and `high`, or `mean` and `sd`".to_string();
                    told(factor, format!("it has no number `{path}` to vary about"), Some(help));
                }
            }
            has_bases = false;
        }
    }
    if is_rows || !has_bases {
        return;
    }
    // All together first: some belong to each other, such as a link's number and its length.
    let links = drive.nominal.links;
    let at = |chosen: &str, u: f64| {
        own()
            .flat_map(|(f, bases)| f.overrides(if f.name == chosen { u } else { 0.5 }, bases, links))
            .collect::<Vec<_>>()
    };
    if tried(at("", 0.5)).is_some() {
        for (factor, bases) in own() {
            if let Some(first) = tried(factor.overrides(0.5, bases, links)) {
                told(factor, first.title, first.help);
            }
        }
        return;
    }
    for (factor, _) in own() {
        for i in 0..factor.listed() {
            let u = (i as f64 + 0.5) / factor.listed() as f64;
            if let Some(first) =
                tried(at(&factor.name, u)).filter(|d| d.title.contains("expected") || d.title.contains("is none of"))
            {
                told(factor, first.title, first.help);
            }
        }
    }
}

/// XXH3-64 of what the results depend on.
fn fingerprint(study: &Study, drives: &[StudyDrive], design: &Design) -> u64 {
    let own = |d: &StudyDrive| format!("{}\n{}\n", d.name, d.nominal.text);
    let mut text: String = drives.iter().map(own).collect();
    // A search may go on for more generations; its bounds decide where it goes.
    let goal = study.goal.as_ref().map(|g| (&g.formula, g.is_maximised, g.population, g.first_sd.to_bits(), g.seed));
    text += &format!("{:?}\n{:?}\n{:?}\n{:?}\n{goal:?}\n", study.set, study.length, study.factors, design.plan());
    if goal.is_some() {
        text += &format!("{:?}\n", study.responses.iter().map(|r| (r.at_most, r.at_least)).collect::<Vec<_>>());
    }
    for r in &study.responses {
        text += &format!("{} {:?}\n", r.name, r.source);
    }
    twox_hash::XxHash3_64::oneshot(text.as_bytes())
}
