//! The table of results: a row a case, in their order, as Parquet and as CSV.
//!
//! Columns: `case`, `drive`, factors, responses, `state_hash`, `error`; nothing of when or where a case ran, so that the bytes are the same
//! however the study was run. A missing value is null in Parquet and empty in CSV. What is known of the running stands in a table of its own:
//! `timing`.

use super::bind::BoundStudy;
use super::factor::{FactorCell, FactorValue};
use super::run::CaseRow;
use crate::output::OutputFile;
use anyhow::Context;
use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::path::Path;
use std::sync::Arc;

/// Rows of a Parquet row group.
const ROWS_PER_GROUP: usize = 1 << 16;
const ZSTD_LEVEL: i32 = 3;

/// A column.
struct ResultColumn {
    name: String,
    cells: ResultCells,
}

/// Its values; None: missing.
enum ResultCells {
    Whole(Vec<Option<u64>>),
    Number(Vec<Option<f64>>),
    Text(Vec<Option<String>>),
}

/// Name of the column of a factor.
pub fn factor_column(bound: &BoundStudy, k: usize) -> String {
    bound
        .study
        .factors
        .get(k)
        .map_or_else(String::new, |f| if f.each_link { format!("{}_seed", f.name) } else { f.name.clone() })
}

/// Columns of results, for some rows in order.
fn results(bound: &BoundStudy, rows: &[&CaseRow]) -> Vec<ResultColumn> {
    let column = |name: &str, cells| ResultColumn { name: name.to_string(), cells };
    let drive = |row: &&CaseRow| bound.drives.get(row.case.drive).map(|d| d.name.clone());
    let mut all = vec![
        column("case", ResultCells::Whole(rows.iter().map(|r| Some(r.case.number as u64)).collect())),
        column("drive", ResultCells::Text(rows.iter().map(drive).collect())),
    ];
    for (k, factor) in bound.study.factors.iter().enumerate() {
        let cells = || rows.iter().map(|r| r.case.cells.get(k).unwrap_or(&FactorCell::Unset));
        let cells = if factor.each_link {
            let seed = |cell: &FactorCell| match cell {
                FactorCell::Seed(seed) => Some(*seed),
                FactorCell::Unset | FactorCell::Value(_) => None,
            };
            ResultCells::Whole(cells().map(seed).collect())
        } else if factor.is_numeric() {
            let number = |cell: &FactorCell| match cell {
                FactorCell::Value(FactorValue::Number(x)) => Some(*x),
                FactorCell::Unset
                | FactorCell::Seed(_)
                | FactorCell::Value(FactorValue::Text(_) | FactorValue::Flag(_)) => None,
            };
            ResultCells::Number(cells().map(number).collect())
        } else {
            let text = |cell: &FactorCell| match cell {
                FactorCell::Value(value) => Some(value.shown()),
                FactorCell::Unset | FactorCell::Seed(_) => None,
            };
            ResultCells::Text(cells().map(text).collect())
        };
        all.push(ResultColumn { name: factor_column(bound, k), cells });
    }
    for (k, response) in bound.study.responses.iter().enumerate() {
        let cells = rows.iter().map(|r| r.responses.get(k).copied().flatten()).collect();
        all.push(column(&response.name, ResultCells::Number(cells)));
    }
    let hash = |row: &&CaseRow| row.state_hash.map(|h| format!("{h:016x}"));
    all.push(column("state_hash", ResultCells::Text(rows.iter().map(hash).collect())));
    all.push(column("error", ResultCells::Text(rows.iter().map(|r| r.error.clone()).collect())));
    all
}

/// Columns of how cases were run.
fn timing(_: &BoundStudy, rows: &[&CaseRow]) -> Vec<ResultColumn> {
    let column = |name: &str, cells| ResultColumn { name: name.to_string(), cells };
    vec![
        column("case", ResultCells::Whole(rows.iter().map(|r| Some(r.case.number as u64)).collect())),
        column("wall_s", ResultCells::Number(rows.iter().map(|r| Some(r.wall_s)).collect())),
        column("shard", ResultCells::Text(rows.iter().map(|r| Some(r.shard.clone())).collect())),
    ]
}

/// Which table is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResultTable {
    Results,
    Timing,
}

impl ResultTable {
    fn columns(self, bound: &BoundStudy, rows: &[&CaseRow]) -> Vec<ResultColumn> {
        match self {
            ResultTable::Results => results(bound, rows),
            ResultTable::Timing => timing(bound, rows),
        }
    }
}

/// Writes a table, Parquet or CSV by the file's ending, whole or not at all. Rows are in the order of their cases.
///
/// # Errors
/// The file cannot be written.
pub fn write_table(path: &Path, table: ResultTable, bound: &BoundStudy, rows: &[&CaseRow]) -> anyhow::Result<()> {
    let (mut output, file) = OutputFile::create(path)?;
    let written = if path.extension().is_some_and(|e| e == "csv") {
        write_csv(file, table, bound, rows)
    } else {
        write_parquet(file, table, bound, rows)
    };
    written.with_context(|| format!("cannot write {}", path.display()))?;
    output.publish()
}

fn write_csv(file: std::fs::File, table: ResultTable, bound: &BoundStudy, rows: &[&CaseRow]) -> anyhow::Result<()> {
    let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::CRLF).from_writer(file);
    let columns = table.columns(bound, rows);
    writer.write_record(columns.iter().map(|c| c.name.as_str()))?;
    let mut float = ryu::Buffer::new();
    for row in 0..rows.len() {
        for column in &columns {
            match &column.cells {
                ResultCells::Whole(v) => {
                    writer.write_field(v.get(row).copied().flatten().map_or_else(String::new, |x| x.to_string()))?;
                }
                ResultCells::Number(v) => match v.get(row).copied().flatten() {
                    Some(x) => writer.write_field(float.format(x))?,
                    None => writer.write_field("")?,
                },
                ResultCells::Text(v) => {
                    writer.write_field(v.get(row).and_then(Option::as_deref).unwrap_or_default())?
                }
            }
        }
        writer.write_record(None::<&[u8]>)?;
    }
    writer.into_inner().map_err(csv::IntoInnerError::into_error)?.sync_all()?;
    Ok(())
}

fn write_parquet(file: std::fs::File, table: ResultTable, bound: &BoundStudy, rows: &[&CaseRow]) -> anyhow::Result<()> {
    let fields = table.columns(bound, &[]).into_iter().map(|column| {
        let (physical, logical) = match column.cells {
            ResultCells::Whole(_) => (Physical::INT64, Some(LogicalType::integer(64, false))),
            ResultCells::Number(_) => (Physical::DOUBLE, None),
            ResultCells::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let field = Type::primitive_type_builder(&column.name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical);
        Ok(Arc::new(field.build()?))
    });
    let fields = fields.collect::<anyhow::Result<Vec<_>>>()?;
    let schema = Arc::new(Type::group_type_builder("results").with_fields(fields).build()?);
    let notes = [
        ("study", bound.study.name.clone()),
        ("title", bound.study.title.clone()),
        ("fingerprint", format!("{:016x}", bound.fingerprint)),
    ];
    let notes = notes.map(|(key, value)| KeyValue::new(format!("pitchline.{key}"), value));
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(ZSTD_LEVEL)?))
        .set_key_value_metadata(Some(notes.to_vec()))
        .build();
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
    for own in rows.chunks(ROWS_PER_GROUP) {
        let mut group = writer.next_row_group()?;
        for column in table.columns(bound, own) {
            let Some(mut to) = group.next_column()? else { break };
            match column.cells {
                ResultCells::Whole(v) => {
                    let (levels, values) = split(v, |x| x.cast_signed());
                    to.typed::<Int64Type>().write_batch(&values, Some(&levels), None)?;
                }
                ResultCells::Number(v) => {
                    let (levels, values) = split(v, |x| x);
                    to.typed::<DoubleType>().write_batch(&values, Some(&levels), None)?;
                }
                ResultCells::Text(v) => {
                    let (levels, values) = split(v, |text| ByteArray::from(text.as_str()));
                    to.typed::<ByteArrayType>().write_batch(&values, Some(&levels), None)?;
                }
            }
            to.close()?;
        }
        group.close()?;
    }
    writer.into_inner()?.sync_all()?;
    Ok(())
}

/// Whether each value is there, and those that are.
fn split<T, U>(values: Vec<Option<T>>, stored: impl Fn(T) -> U) -> (Vec<i16>, Vec<U>) {
    let levels = values.iter().map(|v| i16::from(v.is_some())).collect();
    (levels, values.into_iter().flatten().map(stored).collect())
}
