//! Parquet files: the requested columns, one after the other, a few thousand values at a time.

mod thrift;

use super::{ColumnSelection, Columns, ColumnsError, Memory, ParquetFileError};
use parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;
use std::path::Path;

/// Values per read.
const BATCH: usize = 1 << 14;

pub(super) fn read(path: &Path, wanted: ColumnSelection<'_>, memory: &mut Memory) -> Result<Columns, ColumnsError> {
    let cannot = |why| ColumnsError::Unreadable { path: path.to_path_buf(), why };
    let unfit = |what| ColumnsError::Parquet { path: path.to_path_buf(), what };
    let undecodable = |e: ParquetError| unfit(ParquetFileError::Undecodable(e));
    let file = crate::input::open(path).map_err(cannot)?;
    let pages = file.try_clone().map_err(cannot)?;
    thrift::check_footer(&file).map_err(undecodable)?;
    let reader = SerializedFileReader::new(file).map_err(undecodable)?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let names: Vec<String> = schema.columns().iter().map(|c| c.path().string()).collect();
    let rows = usize::try_from(reader.metadata().file_metadata().num_rows()).unwrap_or(0);
    if rows == 0 {
        return Err(unfit(ParquetFileError::NoRows));
    }
    let mut columns = Columns::from_numbers(names.clone(), vec![Vec::new(); names.len()]);
    columns.rows = rows;
    for (index, name) in names.iter().enumerate().filter(|(_, name)| wanted.selects(name)) {
        let about = schema.column(index);
        match unreadable(&about) {
            Some(why) => columns.mark_unusable(index, format!("column `{name}` {why}")),
            None => {
                let taken = memory.take(rows.saturating_mul(8));
                taken.map_err(|limit| unfit(ParquetFileError::Memory { rows, limit }))?;
                let is_time = ticks_per_second(&about).is_some();
                let mut values =
                    column(&reader, &pages, index, (rows, is_time), memory.bytes as u64).map_err(undecodable)?;
                in_units(&about, &mut values);
                columns.set_column(index, values, is_time.then(|| "s".to_string()));
            }
        }
    }
    columns.refuse_duplicate_names();
    Ok(columns)
}

/// Why a column does not contain numbers.
fn unreadable(about: &ColumnDescriptor) -> Option<&'static str> {
    if about.max_rep_level() > 0 || about.path().parts().len() > 1 {
        return Some("is nested: one value for each row is needed");
    }
    match about.physical_type() {
        Physical::BYTE_ARRAY | Physical::FIXED_LEN_BYTE_ARRAY => Some("holds texts, not numbers"),
        Physical::INT96 => Some("holds times of an old kind (INT96): write them anew as timestamps"),
        _ => None,
    }
}

/// The whole column as it is stored; missing values are NaN. Times are relative to the first one, because nanoseconds
/// since 1970 have more digits than a float.
fn column(
    reader: &SerializedFileReader<std::fs::File>,
    pages: &std::fs::File,
    index: usize,
    (rows, is_time): (usize, bool),
    largest_page: u64,
) -> Result<Vec<f64>, ParquetError> {
    // Further capacity grows with the data: the number of rows is only the file's claim.
    let mut values = Vec::with_capacity(rows.min(1 << 20));
    let mut first: Option<i64> = None;
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group)?;
        // The library does not check these.
        let about = group.metadata().columns().get(index);
        let placed = about.filter(|c| {
            let begins = c.dictionary_page_offset().is_none_or(|at| at >= 0) && c.data_page_offset() >= 0;
            begins && c.compressed_size() >= 0 && c.num_values() >= 0
        });
        let Some((start, length)) = placed.map(|c| c.byte_range()) else {
            return Err(ParquetError::General("a column that lies nowhere".into()));
        };
        thrift::check_pages(pages, start, length, largest_page)?;
        match group.get_column_reader(index)? {
            ColumnReader::BoolColumnReader(r) => take(r, rows, &mut values, |v| f64::from(u8::from(v)))?,
            ColumnReader::Int32ColumnReader(r) => take(r, rows, &mut values, f64::from)?,
            ColumnReader::Int64ColumnReader(r) if is_time => {
                take(r, rows, &mut values, |v| v.wrapping_sub(*first.get_or_insert(v)) as f64)?;
            }
            ColumnReader::Int64ColumnReader(r) => take(r, rows, &mut values, |v| v as f64)?,
            ColumnReader::FloatColumnReader(r) => take(r, rows, &mut values, f64::from)?,
            ColumnReader::DoubleColumnReader(r) => take(r, rows, &mut values, |v| v)?,
            _ => return Err(ParquetError::General("a column of texts where numbers were declared".into())),
        }
    }
    if values.len() != rows {
        return Err(ParquetError::General(format!("{} values in {rows} rows", values.len())));
    }
    Ok(values)
}

/// Reads one row group's part of a column.
fn take<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    most: usize,
    into: &mut Vec<f64>,
    mut number: impl FnMut(T::T) -> f64,
) -> Result<(), ParquetError> {
    let (mut values, mut levels) = (Vec::new(), Vec::new());
    loop {
        values.clear();
        levels.clear();
        let (records, _, _) = reader.read_records(BATCH, Some(&mut levels), None, &mut values)?;
        if records == 0 {
            return Ok(());
        }
        if into.len() + records > most {
            return Err(ParquetError::General(format!("more values than the {most} rows that it states")));
        }
        let mut present = values.drain(..);
        for row in 0..records {
            // Without definition levels every value is present.
            let is_there = levels.get(row).is_none_or(|level| *level > 0);
            into.push(if is_there { present.next().map_or(f64::NAN, &mut number) } else { f64::NAN });
        }
    }
}

/// Ticks per second of a column of times.
fn ticks_per_second(about: &ColumnDescriptor) -> Option<f64> {
    match (about.logical_type_ref(), about.converted_type()) {
        (Some(LogicalType::Timestamp(time)), _) => Some(match time.unit {
            TimeUnit::MILLIS => 1e3,
            TimeUnit::MICROS => 1e6,
            TimeUnit::NANOS => 1e9,
        }),
        (_, ConvertedType::TIMESTAMP_MILLIS) => Some(1e3),
        (_, ConvertedType::TIMESTAMP_MICROS) => Some(1e6),
        _ => None,
    }
}

/// Converts stored integers to the values that they represent.
fn in_units(about: &ColumnDescriptor, values: &mut [f64]) {
    let unsigned = matches!(about.logical_type_ref(), Some(LogicalType::Integer(i)) if !i.is_signed);
    let wrap = match about.physical_type() {
        Physical::INT32 if unsigned => 4_294_967_296.0,
        Physical::INT64 if unsigned => 18_446_744_073_709_551_616.0,
        _ => 0.0,
    };
    let scale = match (ticks_per_second(about), about.logical_type_ref()) {
        (Some(ticks), _) => 1.0 / ticks,
        (None, Some(LogicalType::Decimal(d))) => libm::pow(10.0, -f64::from(d.scale)),
        _ => 1.0,
    };
    for value in values {
        *value = (if *value < 0.0 { *value + wrap } else { *value }) * scale;
    }
}
