//! Reads columns of numbers from measured files: CSV, Parquet, ASAM MDF and recordings of this program (MCAP),
//! distinguished by the file extension. Only requested columns are read, within a memory limit ([`Memory`]) that does
//! not depend on what a file claims.

mod csv;
mod error;
mod parquet;

#[doc(hidden)]
pub use self::csv::parse_csv;
pub use self::error::{ColumnsError, CsvError, CsvLineError, MdfError, MdfGroup, MemoryExceeded, ParquetFileError};

use self::error::MdfChannelError;
use super::contained::contained;
use crate::drive::Drive;
use crate::machine::Machine;
use crate::machine::simulate::through_sensor;
use crate::recording::reader::{Entry, Flow, Reader};
use anyhow::{Context, anyhow, ensure};
use std::path::Path;

/// A file's columns; empty and non-numeric values are NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct Columns {
    /// Names of all columns in file order; the lists below have an entry for each.
    pub names: Vec<String>,
    /// One value per row for requested columns, empty for others.
    pub values: Vec<Vec<f64>>,
    /// Number of rows.
    pub rows: usize,
    /// Why a column cannot be used, e.g. its first non-numeric value with its line. This is an error only if the
    /// measurement requests that column.
    pub wrong: Vec<Option<String>>,
    /// The unit that the file gives a column.
    pub units: Vec<Option<String>>,
    /// Line of the first row in a text file.
    pub first_line: usize,
    /// Irregularities in the file and how they were handled.
    pub warnings: Vec<String>,
    /// Expected content that the file lacks.
    pub missing: Vec<String>,
}

/// FileLayout of a text file, and the group to be read from an MDF file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileLayout {
    /// The first line names the columns.
    pub header: bool,
    /// None: comma, semicolon or tab, by the first line.
    pub separator: Option<u8>,
    /// Lines before the names, or before the first row without them.
    pub skip_lines: usize,
    /// Counted from 0.
    pub group: Option<usize>,
}

impl Default for FileLayout {
    fn default() -> FileLayout {
        FileLayout { header: true, separator: None, skip_lines: 0, group: None }
    }
}

/// Requested columns.
#[derive(Clone, Copy, Debug)]
pub enum ColumnSelection<'a> {
    /// Every column.
    All,
    /// Columns with these names.
    Named(&'a [String]),
}

impl ColumnSelection<'_> {
    fn selects(&self, name: &str) -> bool {
        match self {
            ColumnSelection::All => true,
            ColumnSelection::Named(names) => names.iter().any(|n| n == name),
        }
    }
}

/// Memory that measured values may take.
#[derive(Clone, Copy, Debug)]
pub struct Memory {
    bytes: usize,
    left: usize,
}

/// Number of copies of a value during identification: as read, in segments, and as output of several models.
const COPIES: usize = 10;

impl Memory {
    /// The limit for a program that may use this many bytes in total.
    pub fn for_program(bytes: usize) -> Memory {
        Memory { bytes: bytes / COPIES, left: bytes / COPIES }
    }

    fn take(&mut self, bytes: usize) -> Result<(), MemoryExceeded> {
        match self.left.checked_sub(bytes) {
            Some(left) => {
                self.left = left;
                Ok(())
            }
            None => Err(MemoryExceeded { limit_bytes: self.bytes }),
        }
    }
}

impl Columns {
    /// Columns in which all values are numbers.
    pub(super) fn from_numbers(names: Vec<String>, values: Vec<Vec<f64>>) -> Columns {
        Columns {
            wrong: vec![None; names.len()],
            units: vec![None; names.len()],
            rows: values.first().map_or(0, Vec::len),
            names,
            values,
            first_line: 1,
            warnings: Vec::new(),
            missing: Vec::new(),
        }
    }

    /// Index of the column called `name`; without a header columns are called 1, 2 ...
    pub fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Sets the values of a column, and their unit if the file gives it.
    fn set_column(&mut self, index: usize, values: Vec<f64>, unit: Option<String>) {
        if let (Some(place), Some(units)) = (self.values.get_mut(index), self.units.get_mut(index)) {
            (*place, *units) = (values, unit);
        }
    }

    /// Records why a column cannot be used.
    fn mark_unusable(&mut self, index: usize, why: String) {
        if let Some(wrong) = self.wrong.get_mut(index) {
            *wrong = Some(why);
        }
    }

    /// Refuses columns that share a name, because a request for it would be ambiguous.
    fn refuse_duplicate_names(&mut self) {
        let mut firsts: std::collections::HashMap<&str, usize> = std::collections::HashMap::new();
        let mut twins = Vec::new();
        for (index, name) in self.names.iter().enumerate() {
            let first = *firsts.entry(name.as_str()).or_insert(index);
            if first != index {
                let why = format!("columns {} and {} are both called `{name}`: rename one", first + 1, index + 1);
                twins.push((first, why));
            }
        }
        for (first, why) in twins {
            self.mark_unusable(first, why);
        }
    }
}

#[doc(hidden)]
/// Reads the wanted columns of a file. Errors name the file, and line and column of the unreadable value.
pub fn read(
    path: &Path,
    layout: FileLayout,
    wanted: ColumnSelection<'_>,
    memory: &mut Memory,
) -> Result<Columns, ColumnsError> {
    let cannot = |why| ColumnsError::Unreadable { path: path.to_path_buf(), why };
    let metadata = std::fs::metadata(path).map_err(cannot)?;
    if metadata.is_dir() {
        return Err(ColumnsError::Directory(path.to_path_buf()));
    }
    // A pipe may never end, and a device never does.
    if !metadata.is_file() {
        return Err(ColumnsError::NoFile(path.to_path_buf()));
    }
    let extension = |path: &Path| path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension(path).as_deref() {
        Some("parquet") => contained(path, || parquet::read(path, wanted, memory)),
        Some("mcap") => read_recording(path, wanted, memory).map_err(ColumnsError::Recording),
        Some("mf4" | "mdf" | "dat") => contained(path, || read_mdf(path, layout, wanted, memory)),
        ending => {
            let file = crate::input::open(path).map_err(cannot)?;
            let parsed = if ending == Some("gz") {
                parse_csv(flate2::read::MultiGzDecoder::new(file), layout, wanted, memory)
            } else {
                parse_csv(file, layout, wanted, memory)
            };
            parsed.map_err(|what| ColumnsError::Csv { path: path.to_path_buf(), what })
        }
    }
}

/// Largest block of an MDF file that is allocated before its bytes are read.
const LARGEST_BLOCK: usize = 64 << 20;

fn read_mdf(
    path: &Path,
    layout: FileLayout,
    wanted: ColumnSelection<'_>,
    memory: &mut Memory,
) -> Result<Columns, ColumnsError> {
    let path_buf = || path.to_path_buf();
    let options = falcon_mdf::OpenOptions { max_alloc: LARGEST_BLOCK, ..Default::default() };
    let source = crate::input::open(path).map_err(|why| ColumnsError::Unreadable { path: path_buf(), why })?;
    let source = falcon_mdf::io::range::read_seek_source(source);
    let source = source.map_err(|why| ColumnsError::MdfSource { path: path_buf(), why })?;
    let file = falcon_mdf::Mf4File::from_source_with_options(std::sync::Arc::new(source), options);
    let file = file.map_err(|why| ColumnsError::NoMdf { path: path_buf(), why })?;
    parse_mdf(&file, layout.group, wanted, memory).map_err(|what| ColumnsError::Mdf { path: path_buf(), what })
}

#[doc(hidden)]
/// Channels of one group of an ASAM MDF file, converted to their units; invalid and non-numeric values are NaN. If more
/// than one group contains samples, `group` selects one, because groups have separate clocks.
pub fn parse_mdf(
    file: &falcon_mdf::Mf4File,
    group: Option<usize>,
    wanted: ColumnSelection<'_>,
    memory: &mut Memory,
) -> Result<Columns, MdfError> {
    let groups = file.data_groups().iter().flat_map(|g| &g.channel_groups).enumerate();
    let mut full: Vec<_> =
        groups.filter(|(_, g)| g.sample_count > 0 && !g.is_vlsd() && !g.channels.is_empty()).collect();
    let Some((first, samples)) = full.first().map(|(number, g)| (*number, g.sample_count)) else {
        return Err(MdfError::NoSamples);
    };
    // Column-oriented storage (MDF 4.2) has a group for each channel, and one clock for all.
    let by_columns = full.iter().all(|(_, g)| g.channels.len() == 1 && g.sample_count == samples);
    let there = |full: &[(usize, &falcon_mdf::ChannelGroup)]| {
        let shown = full.iter().take(12).map(|(number, g)| MdfGroup {
            number: *number,
            samples: g.sample_count,
            channels: g.channels.iter().take(6).map(|c| c.name.clone()).collect(),
        });
        shown.collect()
    };
    match group {
        Some(group) if full.iter().any(|(number, _)| *number == group) => {
            full.retain(|(number, _)| *number == group);
        }
        Some(group) => return Err(MdfError::NoGroup { group, there: there(&full) }),
        None if full.len() == 1 || by_columns => {}
        None => return Err(MdfError::SeveralGroups { count: full.len(), first, there: there(&full) }),
    }
    let samples = full.first().map_or(0, |(_, g)| g.sample_count);
    let rows = usize::try_from(samples).map_err(|_| MdfError::TooManySamples(samples))?;
    let channels: Vec<&falcon_mdf::Channel> = full.iter().flat_map(|(_, g)| &g.channels).collect();
    let names: Vec<String> = channels.iter().map(|c| c.name.clone()).collect();
    let mut columns = Columns::from_numbers(names, vec![Vec::new(); channels.len()]);
    columns.rows = rows;
    for (index, channel) in channels.into_iter().enumerate().filter(|(_, c)| wanted.selects(&c.name)) {
        memory.take(rows.saturating_mul(8)).map_err(|limit| MdfError::Memory { rows, limit })?;
        // An unreadable channel is an error only if it is requested.
        match mdf_channel(file, channel, rows) {
            Ok((values, unit)) => columns.set_column(index, values, (!unit.is_empty()).then_some(unit)),
            Err(why) => columns.mark_unusable(index, format!("`{}` {why}", channel.name)),
        }
    }
    columns.refuse_duplicate_names();
    Ok(columns)
}

/// All values of a channel and its unit.
fn mdf_channel(
    file: &falcon_mdf::Mf4File,
    channel: &falcon_mdf::Channel,
    rows: usize,
) -> Result<(Vec<f64>, String), MdfChannelError> {
    // Texts and bytes. The library allocates what their offsets claim before it checks that the data exist.
    if channel.channel_type == falcon_mdf::blocks::channel::ChannelType::VariableLength {
        return Err(MdfChannelError::VariableLength);
    }
    let cannot = MdfChannelError::Undecodable;
    let (mut values, mut unit) = (Vec::new(), String::new());
    let mut add = |signal: &falcon_mdf::Signal, values: &mut Vec<f64>| -> Result<(), falcon_mdf::Mf4Error> {
        let mut own = signal.values_f64()?;
        for (value, valid) in own.iter_mut().zip(signal.validity().unwrap_or_default()) {
            if !valid {
                *value = f64::NAN;
            }
        }
        values.append(&mut own);
        unit = signal.unit().trim().to_string();
        Ok(())
    };
    match file.signal_chunks(channel) {
        Ok(chunks) => {
            for chunk in chunks {
                add(&chunk.map_err(cannot)?, &mut values).map_err(cannot)?;
                if values.len() > rows {
                    return Err(MdfChannelError::TooManyValues { rows });
                }
            }
        }
        // Column-oriented storage is read as a whole.
        Err(_) => add(&file.signal(channel).map_err(cannot)?, &mut values).map_err(cannot)?,
    }
    if values.len() != rows {
        return Err(MdfChannelError::TooFewValues { values: values.len(), rows });
    }
    Ok((values, unit))
}

/// A recording's frames: `t_s`; angle, speed and torques of every sprocket (`rotors.NAME.speed_rad_s`); every sensor of
/// its drive by its path, as displayed, with its gain and the errors that its drive file declares.
fn read_recording(path: &Path, wanted: ColumnSelection<'_>, memory: &mut Memory) -> anyhow::Result<Columns> {
    let mut reader = Reader::open(path)?;
    let header = reader.header().clone();
    let drive = Drive::parse(&header.drive_name, &header.drive_text, &header.overrides).map_err(|e| anyhow!("{e}"))?;
    let rotors: Vec<&str> = header.coordinates.iter().map(|path| path.trim_start_matches("sprockets.")).collect();
    let mut names = vec!["t_s".to_string()];
    for of in ["angle_rad", "speed_rad_s", "chain_torque_nm", "outer_torque_nm"] {
        names.extend(rotors.iter().map(|r| format!("rotors.{r}.{of}")));
    }
    let first_sensor = names.len();
    names.extend(header.sensors.iter().map(|s| s.path.clone()));
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    let frames = crate::recording::reader::Wanted { frames: true, ..Default::default() };
    reader.each(frames, (f64::MIN, f64::MAX), |entry| {
        if let Entry::Frame(f) = entry {
            memory.take(8 * names.len()).map_err(|e| anyhow!("{}: {e}", path.display()))?;
            let r = &f.rotors;
            let all = [&[f.t_s][..], &r.angle_rad, &r.speed_rad_s, &r.chain_torque_nm, &r.outer_torque_nm, &f.sensors];
            for (column, value) in values.iter_mut().zip(all.concat()) {
                column.push(value);
            }
        }
        Ok(Flow::On)
    })?;
    let ends = values.first().and_then(|t_s| Some((t_s.len(), *t_s.first()?, *t_s.last()?)));
    let (rows, first_s, last_s) =
        ends.filter(|(rows, ..)| *rows > 1).with_context(|| format!("{} holds no frames", path.display()))?;
    ensure!(values.iter().all(|c| c.len() == rows), "{}: frames with and without sensors", path.display());
    let m = Machine::of_links(&drive);
    let known = header.sensors.iter().zip(&m.sensors).all(|(theirs, ours)| theirs.path == ours.path);
    ensure!(
        known && header.sensors.len() <= m.sensors.len() && rotors.len() >= m.bodies.len(),
        "{}: its header and its drive do not hold the same sensors",
        path.display()
    );
    let step_s = (last_s - first_s) / (rows - 1) as f64;
    let (states, readings) = values.split_at_mut(first_sensor);
    for (sensor, reading) in readings.iter_mut().enumerate() {
        let angles = m.body_of(sensor).and_then(|b| states.get(1 + b)).cloned().unwrap_or_else(|| vec![0.0; rows]);
        let gain = m.sensors.get(sensor).and_then(|s| m.values.get(s.gain)).copied().unwrap_or(1.0);
        let shown = reading.iter().map(|v| gain * v).collect();
        *reading = through_sensor(&m, &m.values, sensor, shown, &angles, (None, step_s));
    }
    let mut columns = Columns::from_numbers(names, values);
    columns.missing = reader.missing().to_vec();
    // Sensors with declared errors are computed from other columns, so that all are read.
    for (name, values) in columns.names.iter().zip(&mut columns.values).filter(|(name, _)| !wanted.selects(name)) {
        let _unused = (name, std::mem::take(values));
    }
    Ok(columns)
}
