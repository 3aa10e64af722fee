//! Studies: one drive or several, run for many values of their numbers.
//!
//! STUDY.toml names drives, factors (values that differ), a plan (which points), responses (numbers that a case gives) and their bounds. A case
//! follows from the study file and its number alone, and the table of results from its cases: whatever the order, threads, shards or machines,
//! it has the same bits.

// These modules read untrusted files, so that every index is checked.
#![cfg_attr(not(test), warn(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used))]

pub mod bind;
pub mod case;
#[allow(clippy::indexing_slicing, reason = "loops over factors by index read like their formula")]
pub mod design;
pub mod engine;
#[allow(clippy::indexing_slicing, reason = "loops over factors by index read like their formula")]
pub mod estimates;
pub mod evolution;
#[allow(clippy::indexing_slicing, reason = "a coordinate's place in a list that is not empty")]
pub mod factor;
pub mod folder;
pub mod formula;
pub mod optimise;
mod read;
#[cfg(feature = "s3")]
pub mod remote;
pub mod run;
#[allow(clippy::indexing_slicing, reason = "bits of a table of our own")]
pub mod sobol;
pub mod summary;
pub mod table;

use crate::diag::Report;
use crate::drive::reader::{DriveReader, Places};
use case::CaseLength;
use design::StudyPlan;
use factor::Factor;
use formula::Formula;

/// Studies that the program carries: names and files.
pub const BUNDLED_STUDIES: [(&str, &str); 3] = [
    ("smartchain-margins", include_str!("../../assets/studies/smartchain-margins.toml")),
    ("smartchain-tolerances", include_str!("../../assets/studies/smartchain-tolerances.toml")),
    ("smartchain-tolerances-99", include_str!("../../assets/studies/smartchain-tolerances-99.toml")),
];

/// A checked study file.
#[derive(Clone, Debug)]
pub struct Study {
    /// Name of the file without its extension.
    pub name: String,
    /// The study file, unchanged.
    pub text: String,
    pub title: String,
    /// As written: files next to this one, or bundled drives.
    pub drives: Vec<String>,
    /// `path=value` that all cases have.
    pub set: Vec<String>,
    pub length: CaseLength,
    pub factors: Vec<Factor>,
    pub plan: PlanSpec,
    pub responses: Vec<Response>,
    pub keep: KeepSpec,
    pub goal: Option<Goal>,
    /// Where every value stands in the file, for errors.
    pub places: Places,
}

/// A plan, or where its rows stand.
#[derive(Clone, Debug, PartialEq)]
pub enum PlanSpec {
    Design(StudyPlan),
    /// A file whose columns are factors, beside the study file.
    File(String),
}

/// A number that every case gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    pub name: String,
    pub source: ResponseSource,
    /// A case fails that is above.
    pub at_most: Option<f64>,
    /// A case fails that is below.
    pub at_least: Option<f64>,
}

/// Where a response comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum ResponseSource {
    /// A number of a run by its path: see [`case`].
    Path(String),
    /// A number over a signal, by the signal's place in [`case::CaseNeeds::signals`].
    Signal(String, SignalMeasure),
    /// Over responses above it, and factors.
    Formula(Formula),
}

/// What is taken from a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SignalMeasure {
    Mean,
    Min,
    Max,
    PeakToPeak,
    /// About its mean.
    StandardDeviation,
    /// About zero.
    Rms,
    Last,
    /// Amplitude of an order of the driver.
    Order(f64),
}

impl Response {
    /// Whether a value keeps the bounds; a missing one does not.
    pub fn keeps(&self, value: Option<f64>) -> bool {
        let Some(value) = value.filter(|v| !v.is_nan()) else { return false };
        self.at_most.is_none_or(|bound| value <= bound) && self.at_least.is_none_or(|bound| value >= bound)
    }

    pub fn has_bound(&self) -> bool {
        self.at_most.is_some() || self.at_least.is_some()
    }

    /// Smallest relative distance to a bound, negative beyond it; infinite without bounds, minus infinite where the value is missing.
    pub fn margin(&self, value: Option<f64>) -> f64 {
        if !self.has_bound() {
            return f64::INFINITY;
        }
        let Some(value) = value.filter(|v| !v.is_nan()) else { return f64::NEG_INFINITY };
        let scaled = |distance: f64, bound: f64| if bound == 0.0 { distance } else { distance / bound.abs() };
        let below = self.at_most.map_or(f64::INFINITY, |bound| scaled(bound - value, bound));
        let above = self.at_least.map_or(f64::INFINITY, |bound| scaled(value - bound, bound));
        below.min(above)
    }
}

/// Which cases are recorded.
#[derive(Clone, Debug, PartialEq)]
pub enum KeepSpec {
    Nothing,
    Everything,
    /// Cases that fulfil this.
    Where(Formula),
}

/// What a search looks for.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    /// To be made small; a goal to be made large has its sign turned.
    pub formula: Formula,
    pub is_maximised: bool,
    /// Cases of a generation; None: by the number of factors.
    pub population: Option<usize>,
    pub generations: usize,
    /// Standard deviation of the first generation, as a share of the factors' ranges.
    pub first_sd: f64,
    pub seed: u64,
}

/// Name by which formulas call the smallest margin of all responses with bounds.
pub const WORST_MARGIN: &str = "worst_margin";

impl Study {
    /// Reads and checks a study file. `name` is what errors call the text.
    ///
    /// # Errors
    /// All mistakes, with their places.
    pub fn parse(name: &str, text: &str) -> Result<Study, Report> {
        let reader = DriveReader::new(name, text, &[]);
        let document = reader.parse(text)?;
        let study = read::study(&reader.root(&document));
        let places = reader.finish()?;
        let stem = std::path::Path::new(name).file_stem().map_or(name.into(), |s| s.to_string_lossy());
        Ok(Study { name: stem.to_string(), text: text.to_string(), places, ..study })
    }

    /// What the responses ask a run for.
    pub fn needs(&self) -> case::CaseNeeds {
        let mut needs = case::CaseNeeds::default();
        for response in &self.responses {
            match &response.source {
                ResponseSource::Path(path) if path.starts_with("compare.") => needs.compare = true,
                ResponseSource::Path(path) if path.starts_with("impacts.") => needs.impacts = true,
                ResponseSource::Signal(name, _) if !needs.signals.contains(name) => needs.signals.push(name.clone()),
                ResponseSource::Path(_) | ResponseSource::Signal(..) | ResponseSource::Formula(_) => {}
            }
        }
        needs
    }
}
