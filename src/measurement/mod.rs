//! Measured records: the measurement file, the columns it names, and the data derived from them.
//!
//! MEASUREMENT.toml names a drive, the files with their columns, the records in them with their operating points, their
//! use for fitting or judging, and the parameters of the drive that may be fitted. Everything is checked before a model
//! is run.

// These modules read untrusted files, so that every index is checked.
#![warn(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::cast_possible_truncation)]

mod bind;
#[doc(hidden)]
pub mod clocks;
pub mod columns;
#[doc(hidden)]
pub mod contained;
pub mod facts;
mod pulses;
mod read;
pub mod segments;
#[doc(hidden)]
pub mod units;
pub mod wheels;

use crate::diag::Report;
use crate::drive::reader::{DriveReader, Places};

/// A checked measurement file.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Name of the file without its extension.
    pub name: String,
    /// The measurement file, unchanged.
    pub text: String,
    /// Title in the file.
    pub title: String,
    /// As written: a file next to this one, or a bundled drive.
    pub drive: String,
    /// Files with measured columns.
    pub files: Vec<FileSpec>,
    /// Toothed wheels whose angles are columns of the files.
    pub wheels: Vec<wheels::WheelSpec>,
    /// Quantities that the model must reproduce.
    pub channels: Vec<ChannelSpec>,
    /// Quantities that drive the model.
    pub inputs: Vec<InputSpec>,
    /// Stretches of the files, with their use.
    pub records: Vec<RecordSpec>,
    /// Numbers of the drive that may be fitted.
    pub fit: Vec<FitSpec>,
    /// Effects that are searched for.
    pub candidates: CandidateSpec,
    /// Where every value stands in the file, for errors.
    pub places: Places,
}

/// A file with measured columns.
#[derive(Clone, Debug, PartialEq)]
pub struct FileSpec {
    /// Last part of its path in the measurement file; records refer to it.
    pub name: String,
    /// Its path, from the folder of the measurement file.
    pub path: String,
    /// How a text file is laid out, and which group of an MDF file is read.
    pub layout: columns::FileLayout,
}

/// A measured quantity with which the model is compared.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelSpec {
    /// Last part of its path in the measurement file.
    pub name: String,
    /// Path of the sensor in the drive.
    pub sensor: String,
    /// Name of the column.
    pub column: String,
    /// Unit of the column.
    pub unit: String,
    /// Standard deviation of its noise if it is known, in its unit.
    pub noise: Option<f64>,
    /// What the column of a pulse pickup holds.
    pub values: PulseValues,
}

/// Contents of a pulse pickup's column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PulseValues {
    /// Time from one pulse to the next.
    Intervals,
    /// Time of every pulse.
    Times,
}

/// A measured quantity that drives the model.
#[derive(Clone, Debug, PartialEq)]
pub struct InputSpec {
    /// Last part of its path in the measurement file.
    pub name: String,
    /// Path of the input in the drive.
    pub input: String,
    /// Name of the column.
    pub column: String,
    /// Unit of the column.
    pub unit: String,
    /// Each value holds until the next one.
    pub hold: bool,
}

/// Use of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Numbers and effects are fitted to it.
    Fit,
    /// It is held out: it decides whether an effect is accepted.
    Judge,
    /// Neither: the fitted model is also tested on this record, and the result is reported separately.
    Transfer,
}

/// How a record is split into segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Split {
    /// One segment from the first row to the last.
    Whole,
    /// Pulses: stretches in which a body coasts, so that intervals grow from revolution to revolution.
    Coasting {
        /// Shortest stretch that is taken [intervals].
        at_least: usize,
    },
}

/// A stretch of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordSpec {
    /// Last part of its path in the measurement file.
    pub name: String,
    /// Name of the file.
    pub file: String,
    /// Whether it fits, judges, or neither.
    pub usage: Use,
    /// First and last row, counted from 1.
    pub from_row: usize,
    /// Last row; None: to the end.
    pub to_row: Option<usize>,
    /// Rows from here on judge, earlier rows fit.
    pub judge_from_row: Option<usize>,
    /// The last share of the segments judges.
    pub judge_share: Option<f64>,
    /// Samples per second where no column gives the time [1/s].
    pub rate_hz: Option<f64>,
    /// Column and unit of the time.
    pub time: Option<(String, String)>,
    /// How it is split into segments.
    pub split: Split,
    /// Whether it starts at rest at zero; otherwise the initial state is fitted.
    pub at_rest: bool,
    /// Other columns for channels and inputs in this record.
    pub columns: Vec<(String, String)>,
    /// Operating point: path and value in the unit of its name.
    pub set: Vec<(String, f64)>,
    /// Other files with channels and inputs of this record.
    pub beside: Vec<clocks::BesideSpec>,
}

/// A parameter of the drive that may be fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct FitSpec {
    /// Path of the number in the drive file.
    pub path: String,
    /// Uncertainty of the drive's value: standard deviation relative to it.
    pub spread: Option<f64>,
    /// Lower limit, in the unit of the path; None: a thousandth of the drive's value.
    pub low: Option<f64>,
    /// Upper limit, in the unit of the path; None: a thousand times the drive's value.
    pub high: Option<f64>,
    /// Whether every record or every segment has its own value.
    pub scope: FitScope,
}

/// FitScope of a fitted parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FitScope {
    /// One value for all records.
    All,
    /// A value for every record.
    Record,
    /// A value for every segment.
    Part,
}

/// Effects that are searched for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CandidateSpec {
    /// Names of effects; empty: the whole catalogue.
    pub only: Vec<String>,
    /// Names of effects that are left out.
    pub without: Vec<String>,
}

impl Measurement {
    /// Reads and checks a measurement file. `name` is what errors call the text.
    ///
    /// # Errors
    /// All mistakes at once, each with its place in the text.
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
