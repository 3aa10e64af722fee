//! Measured records: what the measurement file says, the columns it names, and what follows from them.
//!
//! MEASUREMENT.toml names a drive, the files with their columns, the records in them with their operating points, which of
//! them fit and which judge, and the numbers of the drive that may be fitted. Everything is checked before a model is run.

// These rooms read what strangers write, so every index is looked at.
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
use crate::drive::reader::{Places, Reader};

/// A checked measurement file.
#[derive(Clone, Debug)]
pub struct Measurement {
    pub name: String,
    pub text: String,
    pub title: String,
    /// As written: a file beside this one, or a bundled drive.
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
    pub layout: columns::Layout,
}

/// A measured quantity that the model is held against.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelSpec {
    pub name: String,
    /// Path of the sensor in the drive.
    pub sensor: String,
    pub column: String,
    pub unit: String,
    /// Standard deviation of its noise where it is known, in its unit.
    pub noise: Option<f64>,
    pub values: PulseValues,
}

/// What the column of a pulse pickup holds.
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
    /// Stays at a value until the next one.
    pub hold: bool,
}

/// What a record is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    Fit,
    Judge,
    /// Neither: how well the numbers found elsewhere hold here is told apart.
    Transfer,
}

/// Where the parts of a record that are compared come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Split {
    Whole,
    /// Pulses: stretches in which a body runs down freely: intervals grow from turn to turn.
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
    /// Rows from here on judge, what is before fits.
    pub judge_from_row: Option<usize>,
    /// The last share of the parts judges.
    pub judge_share: Option<f64>,
    pub rate_hz: Option<f64>,
    pub time: Option<(String, String)>,
    pub split: Split,
    /// Starts at rest at zero, or as the fit finds.
    pub at_rest: bool,
    /// Other columns for channels and inputs in this record.
    pub columns: Vec<(String, String)>,
    /// Operating point: path and value in the unit of its name.
    pub set: Vec<(String, f64)>,
}

/// A number of the drive that may be fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct FitSpec {
    pub path: String,
    /// How well the drive's value is known: standard deviation as a share of it.
    pub spread: Option<f64>,
    pub low: Option<f64>,
    pub high: Option<f64>,
    /// Every record, or every part of one, has its own value.
    pub scope: Scope,
}

/// How far a fitted number reaches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    All,
    Record,
    Part,
}

/// Which effects are looked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CandidateSpec {
    pub only: Vec<String>,
    pub without: Vec<String>,
}

impl Measurement {
    /// Reads and checks a measurement file. All mistakes come back at once.
    pub fn parse(name: &str, text: &str) -> Result<Measurement, Report> {
        let reader = Reader::new(name, text, &[]);
        let root = reader.parse(text)?;
        let measurement = read::measurement(&reader.root(&root));
        drop(root);
        let places = reader.finish()?;
        let stem = std::path::Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or(name);
        let measurement = Measurement { name: stem.to_string(), text: text.to_string(), places, ..measurement };
        Ok(measurement)
    }
}
