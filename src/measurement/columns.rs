//! Columns of numbers out of measured files: CSV and Parquet, told apart by the file's ending.

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use std::path::Path;

/// Largest file that is read [bytes].
const LARGEST_FILE: u64 = 1 << 31;

/// A file's columns, each as long as the file has rows; what is empty is NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct Columns {
    pub names: Vec<String>,
    pub values: Vec<Vec<f64>>,
    /// Line of the first row in a text file.
    pub first_line: usize,
}

/// How a CSV is laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    pub header: bool,
    pub separator: u8,
    pub skip_lines: usize,
}

impl Columns {
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
        Some("mf4" | "mdf" | "dat") => Err(format!(
            "`{shown}` is an ASAM MDF file, which is not read\nhelp: turn it into CSV or Parquet, for example with the Python package asammdf: `MDF(\"x.mf4\").export(\"csv\")`"
        )),
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
                    let text: String = text.chars().take(40).collect();
                    let help = if layout.separator == b';' || !text.contains(',') {
                        ""
                    } else {
                        "\nhelp: is the decimal point a comma? only points are read"
                    };
                    return Err(format!(":{line}: `{text}` in column `{}` is no number{help}", names[i]));
                }
            }
        }
    }
    if values.iter().all(Vec::is_empty) {
        return Err(" holds no rows".to_string());
    }
    Ok(Columns { names, values, first_line })
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
    Ok(Columns { names, values, first_line: 1 })
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
