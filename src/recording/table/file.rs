//! A table's file, Parquet or CSV, which gets its name when it is complete (see [`crate::output`]).
//!
//! Rows are collected in groups of at most [`ROWS_PER_GROUP`], as columns in memory, and then written. Memory does not
//! grow with the recording, except for some kilobytes of Parquet's own index per group.

use super::Values::{self, Bool, Count, EveryF64, EveryU32, EveryU64, F64, Text, U32, U64};
use super::{Block, ColumnInfo, Moment, Source, Table};
use crate::output::OutputFile;
use crate::recording::Output;
use crate::recording::frame::{Event, Header, Impact};
use parquet::basic::{Compression, Encoding, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int32Type, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::{ColumnPath, Type};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rows of a Parquet row group, and maximum number of rows in memory: 5 MB of links.
pub const ROWS_PER_GROUP: usize = 1 << 16;

/// Compression level of Parquet's columns. Measured on 4142 frames of `bush-20-40`, 42 MB of messages and 75 MB of
/// plain columns, CPU time without reading: floats with byte stream split and level 1 33 MB in 0.15 s, level -7 34 MB
/// in 0.14 s; floats uncompressed 42 MB in 0.11 s; snappy 35 MB in 0.16 s. Dictionaries and delta encoding of repeating
/// values gained nothing.
const ZSTD_LEVEL: i32 = 1;

/// Values that Parquet's encoders take at once: with 1024, their default, an export took 5 to 8 % longer.
const VALUES_PER_BATCH: usize = 1 << 14;

/// Values of one column that wait to be written.
#[derive(Clone, Debug)]
pub(super) enum Store {
    F64(Vec<f64>),
    U32(Vec<u32>),
    U64(Vec<u64>),
    Bool(Vec<bool>),
    /// Concatenated texts, and the end of each.
    Text(Vec<u8>, Vec<usize>),
}

impl Store {
    pub(super) fn of(values: &Values<'_>) -> Store {
        match values {
            F64(_) | EveryF64(_) => Store::F64(Vec::new()),
            U32(_) | EveryU32(_) | Count => Store::U32(Vec::new()),
            U64(_) | EveryU64(_) => Store::U64(Vec::new()),
            Bool(_) => Store::Bool(Vec::new()),
            Text(_) => Store::Text(Vec::new(), Vec::new()),
        }
    }

    /// Appends `n` rows; the error is the number of given values, if that differs.
    fn push(&mut self, values: &Values<'_>, n: usize) -> Result<(), usize> {
        let given = match values {
            F64(v) => v.len(),
            U32(v) => v.len(),
            U64(v) => v.len(),
            Bool(v) => v.len(),
            Text(v) => v.len(),
            EveryF64(_) | EveryU32(_) | EveryU64(_) | Count => n,
        };
        if given != n {
            return Err(given);
        }
        match (self, values) {
            (Store::F64(to), F64(v)) => to.extend_from_slice(v),
            (Store::F64(to), EveryF64(v)) => to.resize(to.len() + n, *v),
            (Store::U32(to), U32(v)) => to.extend_from_slice(v),
            (Store::U32(to), EveryU32(v)) => to.resize(to.len() + n, *v),
            (Store::U32(to), Count) => to.extend(0..n as u32),
            (Store::U64(to), U64(v)) => to.extend_from_slice(v),
            (Store::U64(to), EveryU64(v)) => to.resize(to.len() + n, *v),
            (Store::Bool(to), Bool(v)) => to.extend_from_slice(v),
            (Store::Text(bytes, ends), Text(v)) => {
                for text in v {
                    bytes.extend_from_slice(text.as_bytes());
                    ends.push(bytes.len());
                }
            }
            _ => unreachable!("a column's kind is the same in all rows"),
        }
        Ok(())
    }

    fn clear(&mut self) {
        match self {
            Store::F64(v) => v.clear(),
            Store::U32(v) => v.clear(),
            Store::U64(v) => v.clear(),
            Store::Bool(v) => v.clear(),
            Store::Text(bytes, ends) => {
                bytes.clear();
                ends.clear();
            }
        }
    }
}

/// Format of a table's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Parquet,
    Csv,
}

impl Format {
    pub const ALL: [Format; 2] = [Format::Parquet, Format::Csv];

    /// Also the file's extension.
    pub fn name(self) -> &'static str {
        match self {
            Format::Parquet => "parquet",
            Format::Csv => "csv",
        }
    }
}

/// An open file of either format.
enum Sheet {
    Parquet(Box<SerializedFileWriter<File>>),
    Csv(Box<csv::Writer<File>>),
}

impl Sheet {
    fn create(file: File, format: Format, table: &Table, header: &Header) -> anyhow::Result<Sheet> {
        let columns = table.columns();
        match format {
            Format::Parquet => {
                let schema = Arc::new(parquet_schema(table, &columns)?);
                let properties = Arc::new(parquet_properties(table, &columns, header)?);
                Ok(Sheet::Parquet(Box::new(SerializedFileWriter::new(file, schema, properties)?)))
            }
            Format::Csv => {
                // Line ends according to RFC 4180.
                let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::CRLF).from_writer(file);
                writer.write_record(columns.iter().map(|c| c.name))?;
                Ok(Sheet::Csv(Box::new(writer)))
            }
        }
    }

    fn write(&mut self, stores: &[Store], n: usize) -> anyhow::Result<()> {
        match self {
            Sheet::Parquet(writer) => {
                let mut group = writer.next_row_group()?;
                for store in stores {
                    let Some(mut column) = group.next_column()? else { break };
                    write_parquet(&mut column, store)?;
                    column.close()?;
                }
                group.close()?;
            }
            Sheet::Csv(writer) => write_csv(writer, stores, n)?,
        }
        Ok(())
    }

    /// Writes buffered data to the disk; returns the size of the file [bytes].
    fn finish(self) -> anyhow::Result<u64> {
        let file = match self {
            Sheet::Parquet(writer) => writer.into_inner()?,
            Sheet::Csv(writer) => writer.into_inner().map_err(csv::IntoInnerError::into_error)?,
        };
        file.sync_all()?;
        Ok(file.metadata()?.len())
    }
}

fn parquet_schema(table: &Table, columns: &[ColumnInfo]) -> parquet::errors::Result<Type> {
    let mut fields = Vec::new();
    for column in columns {
        let (physical, logical) = match column.store {
            Store::F64(_) => (Physical::DOUBLE, None),
            Store::U32(_) => (Physical::INT32, Some(LogicalType::integer(32, false))),
            Store::U64(_) => (Physical::INT64, Some(LogicalType::integer(64, false))),
            Store::Bool(_) => (Physical::BOOLEAN, None),
            Store::Text(..) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let field = Type::primitive_type_builder(column.name, physical)
            .with_repetition(Repetition::REQUIRED)
            .with_logical_type(logical);
        fields.push(Arc::new(field.build()?));
    }
    Type::group_type_builder(table.name).with_fields(fields).build()
}

fn parquet_properties(table: &Table, columns: &[ColumnInfo], header: &Header) -> anyhow::Result<WriterProperties> {
    let notes: serde_json::Map<String, serde_json::Value> = columns
        .iter()
        .map(|c| (c.name.to_string(), serde_json::json!({ "unit": c.unit, "meaning": c.meaning })))
        .collect();
    let metadata = [
        ("table", table.name.to_string()),
        ("columns", serde_json::Value::Object(notes).to_string()),
        ("drive", header.drive_name.clone()),
        ("program", header.program.clone()),
        ("step_s", format!("{:e}", header.step_s)),
        ("steps_per_frame", header.steps_per_frame.to_string()),
    ];
    let metadata = metadata.map(|(key, value)| KeyValue::new(format!("pitchline.{key}"), value));
    let zstd = Compression::ZSTD(ZstdLevel::try_new(ZSTD_LEVEL)?);
    let mut properties = WriterProperties::builder()
        .set_key_value_metadata(Some(metadata.to_vec()))
        .set_dictionary_enabled(false)
        .set_write_batch_size(VALUES_PER_BATCH)
        .set_compression(zstd);
    for column in columns {
        let path = ColumnPath::from(column.name);
        match column.store {
            Store::F64(_) if !column.repeats => {
                properties = properties.set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT);
            }
            Store::Text(..) => properties = properties.set_column_dictionary_enabled(path, true),
            Store::F64(_) | Store::U32(_) | Store::U64(_) | Store::Bool(_) => {}
        }
    }
    Ok(properties.build())
}

fn write_parquet(column: &mut SerializedColumnWriter<'_>, store: &Store) -> parquet::errors::Result<()> {
    match store {
        Store::F64(v) => column.typed::<DoubleType>().write_batch(v, None, None)?,
        // Parquet stores unsigned numbers as signed ones with the same bits.
        Store::U32(v) => column.typed::<Int32Type>().write_batch(bytemuck::cast_slice(v), None, None)?,
        Store::U64(v) => column.typed::<Int64Type>().write_batch(bytemuck::cast_slice(v), None, None)?,
        Store::Bool(v) => column.typed::<BoolType>().write_batch(v, None, None)?,
        Store::Text(bytes, ends) => {
            // One shared copy, of which each text is a slice.
            let all = ByteArray::from(bytes.clone());
            let window = |row: usize| all.slice(text_start(ends, row), ends[row] - text_start(ends, row));
            let texts: Vec<ByteArray> = (0..ends.len()).map(window).collect();
            column.typed::<ByteArrayType>().write_batch(&texts, None, None)?
        }
    };
    Ok(())
}

/// Start of the text of a row in the concatenated bytes.
fn text_start(ends: &[usize], row: usize) -> usize {
    if row == 0 { 0 } else { ends[row - 1] }
}

/// Row by row; floats with the fewest digits that read back to the same bits.
fn write_csv(writer: &mut csv::Writer<File>, stores: &[Store], n: usize) -> csv::Result<()> {
    let (mut float, mut whole) = (ryu::Buffer::new(), itoa::Buffer::new());
    for row in 0..n {
        for store in stores {
            match store {
                Store::F64(v) => writer.write_field(float.format(v[row]))?,
                Store::U32(v) => writer.write_field(whole.format(v[row]))?,
                Store::U64(v) => writer.write_field(whole.format(v[row]))?,
                Store::Bool(v) => writer.write_field(if v[row] { "true" } else { "false" })?,
                Store::Text(bytes, ends) => writer.write_field(&bytes[text_start(ends, row)..ends[row]])?,
            }
        }
        writer.write_record(None::<&[u8]>)?;
    }
    Ok(())
}

/// The error, with the name of the file.
fn cannot_write(path: &Path, error: impl Into<anyhow::Error>) -> anyhow::Error {
    let error = match error.into().downcast::<ParquetError>() {
        // Its text contains the cause and then names it as its cause again.
        Ok(ParquetError::External(cause)) => anyhow::anyhow!("{cause}"),
        Ok(other) => other.into(),
        Err(other) => other,
    };
    error.context(format!("cannot write {}", path.display()))
}

/// Writes a table to its file. Dropped without [`TableWriter::publish`], it leaves nothing behind.
pub struct TableWriter {
    table: Table,
    path: PathBuf,
    /// None before it is open and after it is finished.
    sheet: Option<Sheet>,
    stores: Vec<Store>,
    /// Rows in `stores`, and of the whole table.
    waiting: usize,
    rows: u64,
    /// Size of the finished file.
    bytes: u64,
    /// Last field, because a file is closed before it is removed.
    output: OutputFile,
}

impl TableWriter {
    /// Opens a temporary file next to `path`, and writes the rows that come from the header.
    pub fn create(table: Table, path: &Path, format: Format, header: &Header) -> anyhow::Result<TableWriter> {
        let (output, file) = OutputFile::create(path)?;
        let stores = table.columns().into_iter().map(|c| c.store).collect();
        let mut writer =
            TableWriter { table, output, path: path.to_path_buf(), sheet: None, stores, waiting: 0, rows: 0, bytes: 0 };
        writer.sheet = Some(Sheet::create(file, format, &table, header).map_err(|e| cannot_write(path, e))?);
        match table.source {
            Source::Table(_) | Source::Frame(_) | Source::Event | Source::Impact => {}
            Source::Body => {
                for (i, body) in header.bodies.iter().enumerate() {
                    writer.push(&super::body(i as u32, body))?;
                }
            }
            Source::Link => {
                for (i, link) in header.links.iter().enumerate() {
                    writer.push(&super::link_info(header, i as u32, link))?;
                }
            }
            Source::Roller => {
                for (i, roller) in header.rollers.iter().enumerate() {
                    writer.push(&super::roller_info(header, i as u32, roller))?;
                }
            }
        }
        Ok(writer)
    }

    /// Adds the frame's rows, if this table has any.
    pub fn frame(&mut self, at: &Moment<'_>) -> anyhow::Result<()> {
        match self.table.source {
            Source::Table(table) => self.push(&super::table(at, table)),
            Source::Frame(rows) => self.push(&rows(at)),
            Source::Event | Source::Impact | Source::Body | Source::Link | Source::Roller => Ok(()),
        }
    }

    /// Adds the event's row, if this table has any.
    pub fn event(&mut self, header: &Header, event: &Event) -> anyhow::Result<()> {
        if matches!(self.table.source, Source::Event) { self.push(&super::event(header, event)) } else { Ok(()) }
    }

    /// Adds the impact's row, if this table has any.
    pub fn impact(&mut self, header: &Header, impact: &Impact) -> anyhow::Result<()> {
        if matches!(self.table.source, Source::Impact) { self.push(&super::impact(header, impact)) } else { Ok(()) }
    }

    fn push(&mut self, rows: &Block<'_>) -> anyhow::Result<()> {
        if self.waiting + rows.n > ROWS_PER_GROUP {
            self.write_group()?;
        }
        for (store, column) in self.stores.iter_mut().zip(&rows.columns) {
            if let Err(given) = store.push(&column.values, rows.n) {
                let (table, name) = (self.table.name, column.name);
                anyhow::bail!("{table}.{name} has {given} values in a frame of {}: the recording is damaged", rows.n);
            }
        }
        self.waiting += rows.n;
        self.rows += rows.n as u64;
        Ok(())
    }

    fn write_group(&mut self) -> anyhow::Result<()> {
        if let Some(sheet) = &mut self.sheet
            && self.waiting > 0
        {
            sheet.write(&self.stores, self.waiting).map_err(|e| cannot_write(&self.path, e))?;
        }
        self.stores.iter_mut().for_each(Store::clear);
        self.waiting = 0;
        Ok(())
    }

    pub fn table(&self) -> Table {
        self.table
    }

    /// Writes the rest; the file is then complete under its temporary name.
    pub fn finish(&mut self) -> anyhow::Result<()> {
        self.write_group()?;
        if let Some(sheet) = self.sheet.take() {
            self.bytes = sheet.finish().map_err(|e| cannot_write(&self.path, e))?;
        }
        Ok(())
    }

    /// Renames the finished file to its final name, replacing an existing file.
    pub fn publish(mut self) -> anyhow::Result<(Output, u64)> {
        self.output.publish()?;
        Ok((Output { path: self.path.clone(), bytes: self.bytes }, self.rows))
    }
}
