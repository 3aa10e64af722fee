//! Measured records: the measurement file, the columns it names, and the data derived from them.
//!
//! MEASUREMENT.toml names a drive, the files with their columns, the records in them with their operating points, their
//! use for fitting or judging, and the parameters of the drive that may be fitted. Everything is checked before a model
//! is run.

// These modules read untrusted files, so that every index is checked.
#![warn(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::cast_possible_truncation)]

mod bind;
pub mod columns;
pub mod contained;
pub mod facts;
mod pulses;
mod read;
pub mod segments;
pub mod units;

use crate::diag::Report;
use crate::drive::reader::{DriveReader, Places};

/// A checked measurement file.
#[derive(Clone, Debug)]
pub struct Measurement {
    pub name: String,
    pub text: String,
    pub title: String,
    /// As written: a file next to this one, or a bundled drive.
    pub drive: String,
    pub files: Vec<FileSpec>,
    pub channels: Vec<ChannelSpec>,
    pub inputs: Vec<InputSpec>,
    pub records: Vec<RecordSpec>,
    pub fit: Vec<FitSpec>,
    pub candidates: CandidateSpec,
    pub places: Places,
}

#[derive(Clone, Debug, PartialEq)]
pub struct FileSpec {
    pub name: String,
    pub path: String,
    pub layout: columns::FileLayout,
}

/// A measured quantity with which the model is compared.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelSpec {
    pub name: String,
    /// Path of the sensor in the drive.
    pub sensor: String,
    pub column: String,
    pub unit: String,
    /// Standard deviation of its noise if it is known, in its unit.
    pub noise: Option<f64>,
    pub values: PulseValues,
}

/// Contents of a pulse pickup's column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PulseValues {
    Intervals,
    Times,
}

/// A measured quantity that drives the model.
#[derive(Clone, Debug, PartialEq)]
pub struct InputSpec {
    pub name: String,
    /// Path of the input in the drive.
    pub input: String,
    pub column: String,
    pub unit: String,
    /// Each value holds until the next one.
    pub hold: bool,
}

/// Use of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    Fit,
    Judge,
    /// Neither: the fitted model is also tested on this record, and the result is reported separately.
    Transfer,
}

/// How a record is split into segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Split {
    Whole,
    /// Pulses: stretches in which a body coasts, so that intervals grow from revolution to revolution.
    Coasting {
        at_least: usize,
    },
}

#[derive(Clone, Debug, PartialEq)]
pub struct RecordSpec {
    pub name: String,
    pub file: String,
    pub usage: Use,
    /// First and last row, counted from 1.
    pub from_row: usize,
    pub to_row: Option<usize>,
    /// Rows from here on judge, earlier rows fit.
    pub judge_from_row: Option<usize>,
    /// The last share of the segments judges.
    pub judge_share: Option<f64>,
    pub rate_hz: Option<f64>,
    pub time: Option<(String, String)>,
    pub split: Split,
    /// Whether it starts at rest at zero; otherwise the initial state is fitted.
    pub at_rest: bool,
    /// Other columns for channels and inputs in this record.
    pub columns: Vec<(String, String)>,
    /// Operating point: path and value in the unit of its name.
    pub set: Vec<(String, f64)>,
}

/// A parameter of the drive that may be fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct FitSpec {
    pub path: String,
    /// Uncertainty of the drive's value: standard deviation relative to it.
    pub spread: Option<f64>,
    pub low: Option<f64>,
    pub high: Option<f64>,
    /// Whether every record or every segment has its own value.
    pub scope: FitScope,
}

/// Scope of a fitted parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FitScope {
    All,
    Record,
    Part,
}

/// Effects that are searched for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CandidateSpec {
    pub only: Vec<String>,
    pub without: Vec<String>,
}

impl Measurement {
    /// Reads and checks a measurement file. Returns all errors at once.
    pub fn parse(name: &str, text: &str) -> Result<Measurement, Report> {
        let reader = DriveReader::new(name, text, &[]);
        let root = reader.parse(text)?;
        let measurement = read::measurement(&reader.root(&root));
        drop(root);
        let places = reader.finish()?;
        let stem = std::path::Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or(name);
        let measurement = Measurement { name: stem.to_string(), text: text.to_string(), places, ..measurement };
        Ok(measurement)
    }
}
