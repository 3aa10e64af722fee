//! Columns of numbers out of measured files: CSV, Parquet, ASAM MDF and our own recordings (MCAP), told apart by the file's
//! ending.

use crate::drive::Drive;
use crate::machine::Machine;
use crate::machine::simulate::through_sensor;
use crate::recording::reader::{Entry, Flow, Reader, Wanted};
use anyhow::{anyhow, ensure};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use std::path::Path;

/// Largest file that is read [bytes].
const LARGEST_FILE: u64 = 1 << 31;

/// A file's columns, each as long as the file has rows; what is empty or no number is NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct Columns {
    pub names: Vec<String>,
    pub values: Vec<Vec<f64>>,
    /// Of every column the first value that is no number, with its line: a mistake where somebody asks for the column.
    pub wrong: Vec<Option<String>>,
    /// Of every column the unit that the file gives it.
    pub units: Vec<Option<String>>,
    /// Line of the first row in a text file.
    pub first_line: usize,
}

/// How a CSV is laid out, and which group of an MDF file is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    pub header: bool,
    pub separator: u8,
    pub skip_lines: usize,
    /// From 0.
    pub group: Option<usize>,
}

impl Columns {
    /// Where all values are numbers.
    fn of_numbers(names: Vec<String>, values: Vec<Vec<f64>>) -> Columns {
        Columns { wrong: vec![None; names.len()], units: vec![None; names.len()], names, values, first_line: 1 }
    }

    /// Index of the column called `name`; without a header columns are called 1, 2 ...
    pub fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    pub fn rows(&self) -> usize {
        self.values.first().map_or(0, Vec::len)
    }
}

/// Reads a file. Errors name it, and the line and column of what cannot be read.
pub fn read(path: &Path, layout: Layout) -> Result<Columns, String> {
    let shown = path.display();
    let metadata = std::fs::metadata(path).map_err(|e| format!("cannot read `{shown}`: {e}"))?;
    if metadata.is_dir() {
        return Err(format!("`{shown}` is a directory"));
    }
    if metadata.len() > LARGEST_FILE {
        return Err(format!("`{shown}` has {} bytes; at most {LARGEST_FILE} are read", metadata.len()));
    }
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("parquet") => read_parquet(path),
        Some("mcap") => read_recording(path).map_err(|e| format!("{e:#}")),
        Some("mf4" | "mdf" | "dat") => {
            let bytes = std::fs::read(path).map_err(|e| format!("cannot read `{shown}`: {e}"))?;
            parse_mdf(bytes, layout.group).map_err(|e| format!("`{shown}` {e}"))
        }
        _ => {
            let bytes = std::fs::read(path).map_err(|e| format!("cannot read `{shown}`: {e}"))?;
            parse_csv(&bytes, layout).map_err(|e| format!("`{shown}`{e}"))
        }
    }
}

/// Columns of a CSV's bytes; an error says line and column.
pub fn parse_csv(bytes: &[u8], layout: Layout) -> Result<Columns, String> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut rest = bytes;
    for _ in 0..layout.skip_lines {
        rest = rest.iter().position(|b| *b == b'\n').map_or(&[][..], |at| &rest[at + 1..]);
    }
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .delimiter(layout.separator)
        .comment(Some(b'#'))
        .from_reader(rest);
    let mut names: Vec<String> = Vec::new();
    let mut values: Vec<Vec<f64>> = Vec::new();
    let mut wrong: Vec<Option<String>> = Vec::new();
    let mut first_line = 0;
    let mut record = csv::ByteRecord::new();
    let mut header = layout.header;
    loop {
        let more = reader.read_byte_record(&mut record).map_err(|e| format!(": {e}"))?;
        if !more {
            break;
        }
        let line = record.position().map_or(0, |p| p.line() as usize) + layout.skip_lines;
        // A comma at the end of every line makes no column.
        let mut width = record.len();
        while width > 0 && record.get(width - 1).is_some_and(<[u8]>::is_empty) {
            width -= 1;
        }
        if width == 0 {
            continue;
        }
        if header {
            header = false;
            names =
                (0..width).map(|i| String::from_utf8_lossy(record.get(i).unwrap_or_default()).into_owned()).collect();
            if names.iter().all(|n| n.parse::<f64>().is_ok()) {
                return Err(format!(
                    ":{line}: the first line holds numbers, not the names of columns\nhelp: write `header = false` for this file; its columns are then called 1, 2 ..."
                ));
            }
            values = vec![Vec::new(); width];
            continue;
        }
        if values.is_empty() {
            names = (1..=width).map(|i| i.to_string()).collect();
            values = vec![Vec::new(); width];
        }
        if first_line == 0 {
            first_line = line;
        }
        if width > names.len() {
            return Err(format!(":{line}: {width} values, where the file has {} columns", names.len()));
        }
        for (i, column) in values.iter_mut().enumerate() {
            let text = std::str::from_utf8(record.get(i).unwrap_or_default()).unwrap_or("?");
            let number = match text {
                "" | "nan" | "NaN" | "NAN" | "NA" => Ok(f64::NAN),
                text => text.parse::<f64>(),
            };
            match number {
                Ok(n) => column.push(n),
                Err(_) => {
                    column.push(f64::NAN);
                    wrong.resize(names.len(), None);
                    let text: String = text.chars().take(40).collect();
                    wrong[i]
                        .get_or_insert_with(|| format!("`{text}` in column `{}`, line {line}, is no number", names[i]));
                }
            }
        }
    }
    if values.iter().all(Vec::is_empty) {
        return Err(" holds no rows".to_string());
    }
    wrong.resize(names.len(), None);
    Ok(Columns { units: vec![None; names.len()], names, values, wrong, first_line })
}

/// Channels of one group of an ASAM MDF file, converted to their units; what is marked invalid or is no number is NaN. Where more
/// than one group holds samples, `group` says which: groups have clocks of their own.
pub fn parse_mdf(bytes: Vec<u8>, group: Option<usize>) -> Result<Columns, String> {
    let wrong = |e: falcon_mdf::Mf4Error| format!("is no MDF file that can be read: {e}");
    let file = falcon_mdf::Mf4File::from_bytes(bytes).map_err(wrong)?;
    let groups: Vec<_> = file.data_groups().iter().flat_map(|g| &g.channel_groups).collect();
    let holds = |g: &usize| groups[*g].sample_count > 0 && !groups[*g].is_vlsd() && !groups[*g].channels.is_empty();
    let full: Vec<usize> = (0..groups.len()).filter(holds).collect();
    let list = || {
        let one = |g: &usize| {
            let names: Vec<&str> = groups[*g].channels.iter().take(6).map(|c| c.name.as_str()).collect();
            format!("{g} ({} samples: {})", groups[*g].sample_count, names.join(", "))
        };
        full.iter().take(12).map(one).collect::<Vec<_>>().join("; ")
    };
    let chosen = match (group, full.as_slice()) {
        (_, []) => return Err("holds no samples".into()),
        (None, [only]) => *only,
        (None, _) => {
            return Err(format!(
                "holds {} groups of channels\nhelp: write `group = {}` with the file; groups there: {}",
                full.len(),
                full[0],
                list()
            ));
        }
        (Some(g), _) if full.contains(&g) => g,
        (Some(g), _) => return Err(format!("has no group {g} with samples\nhelp: groups there: {}", list())),
    };
    let mut columns = Columns::of_numbers(Vec::new(), Vec::new());
    for channel in &groups[chosen].channels {
        let read = file.signal(channel).and_then(|signal| {
            let mut values = signal.values_f64()?;
            for (value, valid) in values.iter_mut().zip(signal.validity().unwrap_or_default()) {
                if !valid {
                    *value = f64::NAN;
                }
            }
            Ok((values, signal.unit().trim().to_string()))
        });
        // A channel that cannot be read is a mistake where somebody asks for it.
        let (values, unit, wrong) = match read {
            Ok((values, unit)) if values.len() as u64 == groups[chosen].sample_count => (values, unit, None),
            Ok((values, _)) => {
                let samples = groups[chosen].sample_count;
                let why = format!("`{}` has {} values in {samples} samples", channel.name, values.len());
                (Vec::new(), String::new(), Some(why))
            }
            Err(e) => (Vec::new(), String::new(), Some(format!("`{}` cannot be read: {e}", channel.name))),
        };
        columns.names.push(channel.name.clone());
        columns.values.push(values);
        columns.wrong.push(wrong);
        columns.units.push((!unit.is_empty()).then_some(unit));
    }
    let rows = columns.values.iter().map(Vec::len).max().unwrap_or(0);
    if rows == 0 {
        return Err(columns.wrong.into_iter().flatten().next().unwrap_or_else(|| "holds no samples".into()));
    }
    columns.values.iter_mut().for_each(|values| values.resize(rows, f64::NAN));
    Ok(columns)
}

fn read_parquet(path: &Path) -> Result<Columns, String> {
    let shown = path.display();
    let wrong = |e: &dyn std::fmt::Display| format!("`{shown}` is no Parquet file that can be read: {e}");
    let file = std::fs::File::open(path).map_err(|e| format!("cannot read `{shown}`: {e}"))?;
    let reader = SerializedFileReader::new(file).map_err(|e| wrong(&e))?;
    let schema = reader.metadata().file_metadata().schema_descr();
    let names: Vec<String> = schema.columns().iter().map(|c| c.path().string()).collect();
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    for row in reader.get_row_iter(None).map_err(|e| wrong(&e))? {
        let row = row.map_err(|e| wrong(&e))?;
        for (i, (_, field)) in row.get_column_iter().enumerate() {
            if let Some(column) = values.get_mut(i) {
                column.push(number(field));
            }
        }
    }
    if values.iter().all(Vec::is_empty) {
        return Err(format!("`{shown}` holds no rows"));
    }
    Ok(Columns::of_numbers(names, values))
}

/// A recording's frames: `t_s`; angle, speed and torques of every sprocket (`rotors.NAME.speed_rad_s`); every sensor of its drive
/// by its path, as it shows, with its gain and what its drive file says that it gets wrong.
fn read_recording(path: &Path) -> anyhow::Result<Columns> {
    let mut reader = Reader::open(path)?;
    let header = reader.header().clone();
    let drive = Drive::parse(&header.drive_name, &header.drive_text, &header.overrides).map_err(|e| anyhow!("{e}"))?;
    let rotors: Vec<&str> =
        header.bodies.iter().filter(|b| b.rotor).map(|b| b.path.trim_start_matches("sprockets.")).collect();
    let mut names = vec!["t_s".to_string()];
    for of in ["angle_rad", "speed_rad_s", "chain_torque_nm", "outer_torque_nm"] {
        names.extend(rotors.iter().map(|r| format!("rotors.{r}.{of}")));
    }
    let first_sensor = names.len();
    names.extend(header.sensors.iter().map(|s| s.path.clone()));
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    reader.each(Wanted { frames: true, ..Wanted::default() }, (f64::MIN, f64::MAX), |entry| {
        if let Entry::Frame(f) = entry {
            let r = &f.rotors;
            let all = [&[f.t_s][..], &r.angle_rad, &r.speed_rad_s, &r.chain_torque_nm, &r.outer_torque_nm, &f.sensors];
            for (column, value) in values.iter_mut().zip(all.concat()) {
                column.push(value);
            }
        }
        Ok(Flow::On)
    })?;
    let rows = values[0].len();
    ensure!(rows > 1, "{} holds no frames", path.display());
    ensure!(values.iter().all(|c| c.len() == rows), "{}: frames with and without sensors", path.display());
    let m = Machine::of_links(&drive);
    let own = |i: usize| m.sensors.get(i).is_some_and(|s| s.path == header.sensors[i].path);
    let known = (0..header.sensors.len()).all(own) && rotors.len() >= m.bodies.len();
    ensure!(known, "{}: its header and its drive do not hold the same sensors", path.display());
    let step_s = (values[0][rows - 1] - values[0][0]) / (rows - 1) as f64;
    for sensor in 0..header.sensors.len() {
        let angles = m.body_of(sensor).map_or_else(|| vec![0.0; rows], |b| values[1 + b].clone());
        let gain = m.values[m.sensors[sensor].gain];
        let shown = values[first_sensor + sensor].iter().map(|v| gain * v).collect();
        values[first_sensor + sensor] = through_sensor(&m, &m.values, sensor, shown, &angles, step_s);
    }
    Ok(Columns::of_numbers(names, values))
}

/// The number in a field; what is none is NaN.
fn number(field: &Field) -> f64 {
    match field {
        Field::Bool(b) => f64::from(u8::from(*b)),
        Field::Byte(n) => f64::from(*n),
        Field::Short(n) => f64::from(*n),
        Field::Int(n) => f64::from(*n),
        Field::Long(n) => *n as f64,
        Field::UByte(n) => f64::from(*n),
        Field::UShort(n) => f64::from(*n),
        Field::UInt(n) => f64::from(*n),
        Field::ULong(n) => *n as f64,
        Field::Float(n) => f64::from(*n),
        Field::Double(n) => *n,
        Field::TimestampMillis(n) => *n as f64 * 1e-3,
        Field::TimestampMicros(n) => *n as f64 * 1e-6,
        _ => f64::NAN,
    }
}
