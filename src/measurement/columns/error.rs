//! Why columns of a measured file cannot be read.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

/// Why a measured file cannot be read.
#[derive(Debug)]
pub enum ColumnsError {
    /// The file cannot be opened.
    Unreadable {
        /// Where the file was looked for.
        path: PathBuf,
        /// What the system says.
        why: std::io::Error,
    },
    /// The path leads to a directory.
    Directory(PathBuf),
    /// The path leads to a pipe or a device.
    NoFile(PathBuf),
    /// A text file is no table of numbers.
    Csv {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: CsvError,
    },
    /// A Parquet file.
    Parquet {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: ParquetFileError,
    },
    /// The reader of MDF files cannot take the file in.
    MdfSource {
        /// The file.
        path: PathBuf,
        /// What the reader says.
        why: falcon_mdf::Mf4Error,
    },
    /// The file does not begin as an MDF file does, or its blocks are damaged.
    NoMdf {
        /// The file.
        path: PathBuf,
        /// What the reader says.
        why: falcon_mdf::Mf4Error,
    },
    /// The groups of an MDF file do not fit what was asked for.
    Mdf {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: MdfError,
    },
    /// A recording of this program; the text names the file.
    Recording(anyhow::Error),
    /// The library that reads the file panicked.
    Damaged {
        /// The file.
        path: PathBuf,
        /// Text of the panic, if it has one.
        said: Option<String>,
    },
}

impl Display for ColumnsError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            ColumnsError::Unreadable { path, why } => write!(f, "cannot read `{}`: {why}", path.display()),
            ColumnsError::Directory(path) => write!(f, "`{}` is a directory", path.display()),
            ColumnsError::NoFile(path) => write!(f, "`{}` is no file", path.display()),
            ColumnsError::Csv { path, what } => write!(f, "`{}`{what}", path.display()),
            ColumnsError::Parquet { path, what } => write!(f, "`{}`{what}", path.display()),
            ColumnsError::MdfSource { path, why } => write!(f, "cannot read `{}`: {why}", path.display()),
            ColumnsError::NoMdf { path, why } => {
                write!(f, "`{}` is no MDF file that can be read: {why}", path.display())
            }
            ColumnsError::Mdf { path, what } => write!(f, "`{}` {what}", path.display()),
            ColumnsError::Recording(e) => write!(f, "{e:#}"),
            ColumnsError::Damaged { path, said } => write!(
                f,
                "`{}` is damaged: its reader gave up ({})",
                path.display(),
                said.as_deref().unwrap_or("no message")
            ),
        }
    }
}

impl std::error::Error for ColumnsError {}

/// The columns need more memory than they may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryExceeded {
    /// What all columns together may take [bytes].
    pub limit_bytes: usize,
}

impl Display for MemoryExceeded {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the measured columns hold more than the {:.0} MB that they may take, a tenth of the memory\nhelp: cut the files to what is needed, or give more: `--memory 4GB`",
            self.limit_bytes as f64 / 1e6
        )
    }
}

impl std::error::Error for MemoryExceeded {}

/// Why a text file is no table of numbers. Its text follows the name of the file.
#[derive(Debug)]
pub enum CsvError {
    /// Not even the beginning can be read.
    Unreadable(std::io::Error),
    /// Reading stops at this line, counted from 1.
    Interrupted {
        /// The line.
        line: usize,
        /// What the system or the decoder says.
        why: std::io::Error,
    },
    /// A line has a mistake.
    AtLine {
        /// The line, counted from 1; the first one of a row that goes over several.
        line: usize,
        /// The mistake.
        what: CsvLineError,
    },
    /// Nothing stands below the names.
    NoRows,
}

impl Display for CsvError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            CsvError::Unreadable(why) => write!(f, " cannot be read: {why}"),
            CsvError::Interrupted { line, why } => write!(f, ": line {line}: {why}"),
            CsvError::AtLine { line, what } => write!(f, ":{line}: {what}"),
            CsvError::NoRows => f.write_str(" holds no rows"),
        }
    }
}

impl std::error::Error for CsvError {}

/// What is wrong with a line of a text file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CsvLineError {
    /// The line is longer than this many bytes.
    TooLong {
        /// The longest line that is read.
        limit_bytes: usize,
    },
    /// A quotation mark is still open after this many lines.
    QuoteNotClosed {
        /// Most lines of a row.
        limit_lines: usize,
    },
    /// A quotation mark is not closed, and without it the line is no row either.
    StrayQuote,
    /// The row has more values than there are columns.
    TooManyValues {
        /// Values in the row.
        values: usize,
        /// Columns of the file.
        columns: usize,
    },
    /// The file has more columns than are read.
    TooManyColumns {
        /// Columns of the file.
        columns: usize,
        /// Most columns that are read.
        limit: usize,
    },
    /// Numbers stand where the names of the columns are expected.
    NumbersAsNames,
    /// No memory is left for the row.
    Memory(MemoryExceeded),
}

impl Display for CsvLineError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            CsvLineError::TooLong { limit_bytes } => {
                write!(f, "a line of more than {limit_bytes} bytes: this is not a table of numbers")
            }
            CsvLineError::QuoteNotClosed { limit_lines } => {
                write!(f, "a quotation mark is not closed within {limit_lines} lines")
            }
            CsvLineError::StrayQuote => f.write_str(
                "a quotation mark is not closed, and the line has not all columns\nhelp: close it, or take that column out of the file",
            ),
            CsvLineError::TooManyValues { values, columns } => {
                write!(f, "{values} values, where the file has {columns} columns")
            }
            CsvLineError::TooManyColumns { columns, limit } => write!(f, "{columns} columns; at most {limit} are read"),
            CsvLineError::NumbersAsNames => f.write_str(
                "the first line holds numbers, not the names of columns\nhelp: write `header = false` for this file; its columns are then called 1, 2 ...",
            ),
            CsvLineError::Memory(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for CsvLineError {}

impl From<MemoryExceeded> for CsvLineError {
    fn from(e: MemoryExceeded) -> CsvLineError {
        CsvLineError::Memory(e)
    }
}

/// What is wrong with a Parquet file. Its text follows the name of the file.
#[derive(Debug)]
pub enum ParquetFileError {
    /// The file has columns and no values.
    NoRows,
    /// No memory is left for a column.
    Memory {
        /// Rows that the file states.
        rows: usize,
        /// The limit.
        limit: MemoryExceeded,
    },
    /// The bytes cannot be decoded.
    Undecodable(parquet::errors::ParquetError),
}

impl Display for ParquetFileError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            ParquetFileError::NoRows => f.write_str(" holds no rows"),
            ParquetFileError::Memory { rows, limit } => write!(f, ": {rows} rows: {limit}"),
            ParquetFileError::Undecodable(e) => write!(
                f,
                " is no Parquet file that can be read: {e}\nhelp: write it anew in Python: pandas.read_parquet(\"FILE\").to_parquet(\"NEW\", compression=\"snappy\")"
            ),
        }
    }
}

impl std::error::Error for ParquetFileError {}

/// A group of an MDF file that holds samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MdfGroup {
    /// Counted from 0.
    pub number: usize,
    /// Samples of each of its channels.
    pub samples: u64,
    /// Names of its first channels.
    pub channels: Vec<String>,
}

/// What is wrong with an MDF file. Its text follows the name of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MdfError {
    /// No group holds samples.
    NoSamples,
    /// The requested group does not exist, or holds no samples.
    NoGroup {
        /// The requested one.
        group: usize,
        /// The first groups that hold samples.
        there: Vec<MdfGroup>,
    },
    /// Several groups hold samples, and none is requested.
    SeveralGroups {
        /// Number of groups that hold samples.
        count: usize,
        /// The number of the first.
        first: usize,
        /// The first of these groups.
        there: Vec<MdfGroup>,
    },
    /// More samples than a computer can address.
    TooManySamples(u64),
    /// No memory is left for a channel.
    Memory {
        /// Samples that the file states.
        rows: usize,
        /// The limit.
        limit: MemoryExceeded,
    },
}

impl Display for MdfError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let list = |f: &mut Formatter<'_>, there: &[MdfGroup]| {
            let group = |g: &MdfGroup| format!("{} ({} samples: {})", g.number, g.samples, g.channels.join(", "));
            write!(f, "groups there: {}", there.iter().map(group).collect::<Vec<_>>().join("; "))
        };
        match self {
            MdfError::NoSamples => f.write_str("holds no samples"),
            MdfError::NoGroup { group, there } => {
                write!(f, "has no group {group} with samples\nhelp: ")?;
                list(f, there)
            }
            MdfError::SeveralGroups { count, first, there } => {
                write!(f, "holds {count} groups of channels\nhelp: write `group = {first}` with the file; ")?;
                list(f, there)
            }
            MdfError::TooManySamples(samples) => write!(f, "holds {samples} samples"),
            MdfError::Memory { rows, limit } => write!(f, "holds {rows} samples: {limit}"),
        }
    }
}

impl std::error::Error for MdfError {}

/// Why a channel of an MDF file is no column. Its text follows the name of the channel.
#[derive(Debug)]
pub(super) enum MdfChannelError {
    /// Texts or bytes.
    VariableLength,
    Undecodable(falcon_mdf::Mf4Error),
    TooManyValues {
        rows: usize,
    },
    TooFewValues {
        values: usize,
        rows: usize,
    },
}

impl Display for MdfChannelError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            MdfChannelError::VariableLength => f.write_str("has values of variable length, no numbers"),
            MdfChannelError::Undecodable(e) => write!(f, "cannot be read: {e}"),
            MdfChannelError::TooManyValues { rows } => write!(f, "has more than {rows} values"),
            MdfChannelError::TooFewValues { values, rows } => write!(f, "has {values} values in {rows} samples"),
        }
    }
}

impl std::error::Error for MdfChannelError {}
