//! Text files from test benches, line by line: CSV with commas, semicolons or tabs, decimal points or commas, in UTF-8,
//! UTF-16 or a Western European code page, optionally packed with gzip, with or without a row of units, times as
//! numbers or as dates.
//!
//! Only the requested columns are kept. A line is at most [`LONGEST_LINE`] bytes. Rows with quotation marks are split
//! according to RFC 4180, so that a text may contain line breaks. A quotation mark that is never closed, as in broken
//! exports, would swallow the following rows: if the next line is a complete row, the quotation mark is treated as
//! stray, with a warning.

use super::{ColumnSelection, Columns, CsvError, CsvLineError, FileLayout, Memory};
use csv_core::{ReadRecordResult, Reader, ReaderBuilder, Terminator};
use encoding_rs::{Encoding, UTF_16BE, UTF_16LE, WINDOWS_1252};
use encoding_rs_io::DecodeReaderBytesBuilder;
use std::io::{BufRead, BufReader, Read};

/// Longest line [bytes].
const LONGEST_LINE: usize = 4 << 20;
/// Maximum number of lines of one row; text notes have a few.
const MAX_LINES_PER_ROW: usize = 100;
/// Maximum number of columns of a file.
const MAX_COLUMNS: usize = 50_000;
/// Lines are stored without line ends; this one is appended.
const LINE_END: Terminator = Terminator::Any(b'\n');
/// Bytes from which the encoding is detected.
const LOOKED_AT: u64 = 4096;

/// Columns of a text file. Errors begin with the line number if they concern a line.
pub fn parse_csv(
    input: impl Read,
    layout: FileLayout,
    wanted: ColumnSelection<'_>,
    memory: &mut Memory,
) -> Result<Columns, CsvError> {
    let (input, encoding) = decoded(input).map_err(CsvError::Unreadable)?;
    let mut lines = Lines { input: BufReader::with_capacity(1 << 16, input), line: Vec::new(), number: 0 };
    for _ in 0..layout.skip_lines {
        lines.next()?;
    }
    let mut table = CsvTable::new(layout, wanted);
    while lines.next()? {
        // Without an encoding mark, a line that is not valid UTF-8 is read as Windows-1252.
        let text = std::str::from_utf8(&lines.line).map_or_else(
            |_| {
                if encoding {
                    String::from_utf8_lossy(&lines.line)
                } else {
                    WINDOWS_1252.decode_without_bom_handling(&lines.line).0
                }
            },
            std::borrow::Cow::Borrowed,
        );
        table.line(&text, lines.number, memory)?;
    }
    table.finish(memory)
}

/// The input as UTF-8, detected from a byte order mark or from every second byte being zero. The flag tells whether it
/// was detected.
fn decoded(mut input: impl Read) -> std::io::Result<(impl Read, bool)> {
    let mut first = Vec::new();
    input.by_ref().take(LOOKED_AT).read_to_end(&mut first)?;
    let is_zero = |from: usize| first.iter().skip(from).step_by(2).filter(|b| **b == 0).count() * 4 > first.len();
    let encoding: Option<&'static Encoding> = match (is_zero(0), is_zero(1)) {
        (false, true) => Some(UTF_16LE),
        (true, false) => Some(UTF_16BE),
        _ => None,
    };
    let marked = Encoding::for_bom(&first).is_some() || encoding.is_some();
    let whole = std::io::Cursor::new(first).chain(input);
    let reader = DecodeReaderBytesBuilder::new().encoding(encoding).utf8_passthru(true).strip_bom(true).build(whole);
    Ok((reader, marked))
}

/// Lines without line ends.
struct Lines<R> {
    input: BufReader<R>,
    line: Vec<u8>,
    /// Counted from 1.
    number: usize,
}

impl<R: Read> Lines<R> {
    /// Reads the next line; false at the end.
    fn next(&mut self) -> Result<bool, CsvError> {
        self.line.clear();
        let most = LONGEST_LINE as u64 + 1;
        let read = self.input.by_ref().take(most).read_until(b'\n', &mut self.line);
        let read = read.map_err(|why| CsvError::Interrupted { line: self.number + 1, why })?;
        self.number += 1;
        if read > LONGEST_LINE {
            let what = CsvLineError::TooLong { limit_bytes: LONGEST_LINE };
            return Err(CsvError::AtLine { line: self.number, what });
        }
        while self.line.last().is_some_and(|b| matches!(b, b'\n' | b'\r')) {
            self.line.pop();
        }
        Ok(read > 0)
    }
}

/// Type of the values of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ColumnType {
    /// No value so far.
    Unknown,
    Number,
    /// A date and a time; the column holds seconds since the first.
    Instant(i128),
}

/// A requested column.
struct CsvColumn {
    /// Index in the file.
    index: usize,
    kind: ColumnType,
    marks: DecimalMarks,
}

/// Decimal marks that have occurred.
#[derive(Clone, Copy, Debug, Default)]
struct DecimalMarks {
    point: bool,
    comma: bool,
}

struct CsvTable<'a> {
    layout: FileLayout,
    wanted: ColumnSelection<'a>,
    separator: u8,
    splitter: Reader,
    /// Concatenated fields of the row, and the end of each.
    fields: Vec<u8>,
    ends: Vec<usize>,
    columns: Columns,
    kept: Vec<CsvColumn>,
    has_names: bool,
    /// Lines of a row whose last quoted field is still open, and the number of the first.
    open: Option<(String, usize)>,
    /// Rows that contain only separators and may be followed by others.
    empty_rows: usize,
    /// Lines with a stray quotation mark.
    stray_quotes: usize,
}

impl<'a> CsvTable<'a> {
    fn new(layout: FileLayout, wanted: ColumnSelection<'a>) -> CsvTable<'a> {
        CsvTable {
            layout,
            wanted,
            separator: b',',
            splitter: Reader::new(),
            fields: Vec::new(),
            ends: Vec::new(),
            columns: Columns::from_numbers(Vec::new(), Vec::new()),
            kept: Vec::new(),
            has_names: false,
            open: None,
            empty_rows: 0,
            stray_quotes: 0,
        }
    }

    /// Processes the next line, which is a row or part of one.
    fn line(&mut self, line: &str, number: usize, memory: &mut Memory) -> Result<(), CsvError> {
        let Some((open, first)) = self.open.take() else {
            if line.trim().is_empty() || line.starts_with('#') {
                return Ok(());
            }
            if !self.has_names {
                self.separator = self.layout.separator.unwrap_or_else(|| separator_of(line, self.layout.header));
                self.splitter = ReaderBuilder::new().delimiter(self.separator).terminator(LINE_END).build();
            }
            if self.split(line, true) {
                return self.row(number, memory).map_err(|what| CsvError::AtLine { line: number, what });
            }
            self.open = Some((line.to_string(), number));
            return Ok(());
        };
        // A line that is a complete row cannot continue a quoted text.
        if self.has_names && self.split(line, true) && self.ends.len() == self.columns.names.len() {
            self.stray_quote(&open, first, memory)?;
            return self.line(line, number, memory);
        }
        let joined = format!("{open}\n{line}");
        if joined.len() > LONGEST_LINE || number - first > MAX_LINES_PER_ROW {
            let what = CsvLineError::QuoteNotClosed { limit_lines: MAX_LINES_PER_ROW };
            return Err(CsvError::AtLine { line: first, what });
        }
        if self.split(&joined, true) {
            return self.row(first, memory).map_err(|what| CsvError::AtLine { line: first, what });
        }
        self.open = Some((joined, first));
        Ok(())
    }

    /// Processes a line with a stray quotation mark.
    fn stray_quote(&mut self, line: &str, number: usize, memory: &mut Memory) -> Result<(), CsvError> {
        self.split(line, false);
        if line.contains('\n') || self.ends.len() != self.columns.names.len() {
            return Err(CsvError::AtLine { line: number, what: CsvLineError::StrayQuote });
        }
        self.stray_quotes += 1;
        if self.stray_quotes == 1 {
            let what = format!("line {number}: a quotation mark is not closed on its line; the line is taken as it is");
            self.columns.warnings.push(what);
        }
        self.row(number, memory).map_err(|what| CsvError::AtLine { line: number, what })
    }

    /// Processes the row that was split last.
    fn row(&mut self, number: usize, memory: &mut Memory) -> Result<(), CsvLineError> {
        let whole = self.ends.len();
        let mut width = whole;
        // A separator at the end of every line does not make a column.
        while width > 0 && self.field(width - 1).is_empty() {
            width -= 1;
        }
        if !self.has_names {
            // Without names the first row may have fewer fields than others.
            self.name_columns(if self.layout.header { width } else { whole })?;
            if self.layout.header {
                return Ok(());
            }
        }
        if width == 0 {
            // A lost sample, unless it is at the end.
            self.empty_rows += usize::from(self.columns.rows > 0);
            return Ok(());
        }
        let names = self.columns.names.len();
        if width > names {
            return Err(CsvLineError::TooManyValues { values: width, columns: names });
        }
        if self.columns.rows == 0 && self.is_row_of_units(width) {
            let texts = (0..width).map(|i| self.field(i).trim_matches(|c| "[]()".contains(c)).to_string());
            self.columns.units = texts.map(|unit| (!matches!(unit.as_str(), "" | "-")).then_some(unit)).collect();
            self.columns.units.resize(names, None);
            return Ok(());
        }
        if self.columns.rows == 0 {
            self.columns.first_line = number;
        }
        let lost = std::mem::take(&mut self.empty_rows);
        memory.take((lost + 1).saturating_mul(8 * self.kept.len()))?;
        self.columns.rows += lost;
        let Columns { names, values, wrong, .. } = &mut self.columns;
        for column in &mut self.kept {
            let all = (names.get(column.index), values.get_mut(column.index), wrong.get_mut(column.index));
            let (Some(name), Some(values), Some(wrong)) = all else { continue };
            values.resize(values.len() + lost, f64::NAN);
            // A row may have missing fields at its end.
            let text = if column.index < width { field(&self.fields, &self.ends, column.index) } else { "" };
            let value = column.number(text, self.separator).unwrap_or_else(|| {
                let text: String = text.chars().take(40).collect();
                let comma = text.contains(',') && self.separator == b',';
                let help = if comma { "; decimal commas need another separator" } else { "" };
                wrong.get_or_insert_with(|| format!("`{text}` in column `{name}`, line {number}, is no number{help}"));
                f64::NAN
            });
            values.push(value);
        }
        self.columns.rows += 1;
        Ok(())
    }

    /// Splits a line into fields; false if a quotation mark is not closed in it.
    fn split(&mut self, line: &str, quotes: bool) -> bool {
        let mut plain;
        let splitter = if quotes {
            self.splitter.reset();
            &mut self.splitter
        } else {
            plain = ReaderBuilder::new().delimiter(self.separator).terminator(LINE_END).quoting(false).build();
            &mut plain
        };
        self.fields.resize(line.len() + 1, 0);
        let most = line.bytes().filter(|b| *b == self.separator).count() + 2;
        self.ends.clear();
        self.ends.resize(most, 0);
        let (mut fields, mut ends) = (0, 0);
        // The line, then its end. Fields and ends have room for all of it.
        for input in [line.as_bytes(), b"\n"] {
            let (Some(own_fields), Some(own_ends)) = (self.fields.get_mut(fields..), self.ends.get_mut(ends..)) else {
                return false;
            };
            let (result, _, written, ended) = splitter.read_record(input, own_fields, own_ends);
            (fields, ends) = (fields + written, ends + ended);
            if matches!(result, ReadRecordResult::Record | ReadRecordResult::End) {
                self.ends.truncate(ends);
                return true;
            }
        }
        false
    }

    /// A field of the row, without surrounding blanks.
    fn field(&self, index: usize) -> &str {
        field(&self.fields, &self.ends, index)
    }

    fn name_columns(&mut self, width: usize) -> Result<(), CsvLineError> {
        self.has_names = true;
        if width > MAX_COLUMNS {
            return Err(CsvLineError::TooManyColumns { columns: width, limit: MAX_COLUMNS });
        }
        let header = self.layout.header;
        let name = |i: usize| if header { self.field(i).to_string() } else { (i + 1).to_string() };
        let names: Vec<String> = (0..width).map(name).collect();
        if header && names.iter().all(|n| n.parse::<f64>().is_ok()) {
            return Err(CsvLineError::NumbersAsNames);
        }
        let kept = names.iter().enumerate().filter(|(_, name)| self.wanted.selects(name));
        self.kept = kept
            .map(|(index, _)| CsvColumn { index, kind: ColumnType::Unknown, marks: DecimalMarks::default() })
            .collect();
        self.columns = Columns::from_numbers(names, vec![Vec::new(); width]);
        Ok(())
    }

    /// Whether this is a row of units: below the names, before any number, and without any number.
    fn is_row_of_units(&self, width: usize) -> bool {
        let texts = (0..width).map(|i| self.field(i)).filter(|t| !t.is_empty());
        let mut probe = CsvColumn { index: 0, kind: ColumnType::Unknown, marks: DecimalMarks::default() };
        let mut numbers = texts.clone().filter(|t| probe.number(t, self.separator).is_some());
        self.layout.header
            && self.columns.units.iter().all(Option::is_none)
            && texts.count() > 1
            && numbers.next().is_none()
    }

    fn finish(mut self, memory: &mut Memory) -> Result<Columns, CsvError> {
        if let Some((open, first)) = self.open.take() {
            self.stray_quote(&open, first, memory)?;
        }
        if self.columns.rows == 0 {
            return Err(CsvError::NoRows);
        }
        if self.stray_quotes > 1 {
            let more = self.stray_quotes - 1;
            self.columns.warnings.push(format!("{more} more lines with a quotation mark that is not closed"));
        }
        let Columns { names, wrong, units, .. } = &mut self.columns;
        for column in &self.kept {
            let all = (names.get(column.index), wrong.get_mut(column.index), units.get_mut(column.index));
            let (Some(name), Some(wrong), Some(unit)) = all else { continue };
            if column.marks.point && column.marks.comma {
                wrong.get_or_insert_with(|| {
                    format!("column `{name}` has decimal points in some rows and commas in others")
                });
            }
            if matches!(column.kind, ColumnType::Instant(_)) {
                *unit = Some("s".into());
            }
        }
        self.columns.refuse_duplicate_names();
        Ok(self.columns)
    }
}

impl CsvColumn {
    /// The number in a field: NaN if it is empty, None if it contains anything else.
    fn number(&mut self, text: &str, separator: u8) -> Option<f64> {
        if matches!(text, "" | "nan" | "NaN" | "NAN" | "NA") {
            return Some(f64::NAN);
        }
        let comma = separator != b',' && text.contains(',') && !text.contains('.');
        let number = if comma { text.replacen(',', ".", 1).parse::<f64>() } else { text.parse::<f64>() };
        match (number, self.kind) {
            (Ok(number), ColumnType::Unknown | ColumnType::Number) => {
                self.kind = ColumnType::Number;
                self.marks.point |= text.contains('.');
                self.marks.comma |= comma;
                Some(number)
            }
            (Err(_), ColumnType::Unknown | ColumnType::Instant(_)) => {
                let t_ns = instant_ns(text)?;
                let ColumnType::Instant(first_ns) = self.kind else {
                    self.kind = ColumnType::Instant(t_ns);
                    return Some(0.0);
                };
                Some((t_ns - first_ns) as f64 * 1e-9)
            }
            (Ok(_), ColumnType::Instant(_)) | (Err(_), ColumnType::Number) => None,
        }
    }
}

/// Field `index` of a row whose fields end at `ends`.
fn field<'a>(fields: &'a [u8], ends: &[usize], index: usize) -> &'a str {
    let begin = index.checked_sub(1).and_then(|before| ends.get(before)).copied().unwrap_or(0);
    let bytes = ends.get(index).and_then(|end| fields.get(begin..*end)).unwrap_or_default();
    std::str::from_utf8(bytes).unwrap_or_default().trim()
}

/// A date and a time according to ISO 8601, with or without a time zone, in nanoseconds.
fn instant_ns(text: &str) -> Option<i128> {
    // Cheaper than the parser for other texts.
    if !text.starts_with(|c: char| c.is_ascii_digit()) || !text.contains(':') {
        return None;
    }
    if let Ok(instant) = text.parse::<jiff::Timestamp>() {
        return Some(instant.as_nanosecond());
    }
    let local = text.parse::<jiff::civil::DateTime>().ok()?;
    Some(local.to_zoned(jiff::tz::TimeZone::UTC).ok()?.timestamp().as_nanosecond())
}

/// The separator of the first line, outside of quotation marks. For names it is the most frequent one. For numbers a
/// comma is used only if there is no other separator, because it may be the decimal mark.
fn separator_of(line: &str, names: bool) -> u8 {
    let mut counts = [(b',', 0), (b';', 0), (b'\t', 0)];
    let mut quoted = false;
    for byte in line.bytes() {
        quoted ^= byte == b'"';
        if !quoted && let Some((_, n)) = counts.iter_mut().find(|(b, _)| *b == byte) {
            *n += 1;
        }
    }
    if !names && let Some((b, _)) = counts.iter().rev().find(|(_, n)| *n > 0) {
        return *b;
    }
    // In a tie the comma loses, because a name may contain one.
    counts.iter().max_by_key(|(_, n)| *n).filter(|(_, n)| *n > 0).map_or(b',', |(b, _)| *b)
}
