//! Checks a file's footer and its page headers before the library decodes them. The library skips as many list elements
//! as the list claims, whether they exist or not: a list of 2^31 took it a minute. It also reads each field that it
//! knows as the type that the format gives it, whatever type the bytes state: bytes that claim to be text may hide such
//! a list. Here every element must take at least one byte, every field of the format must have the format's type, and
//! the footer must end where its length says.
//! Encoding: Thrift's compact protocol,
//! <https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md>; fields:
//! <https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift>.

use parquet::errors::ParquetError;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};

/// Maximum nesting of structures and lists; the format has eight.
const DEEPEST: u8 = 16;
/// Magic bytes at the end of a file, after the footer's length in four bytes.
const MAGIC: [u8; 4] = *b"PAR1";
/// Bytes of both.
const TAIL: u64 = 8;

/// Type of a field.
#[derive(Clone, Copy)]
enum Shape {
    Bool,
    Byte,
    /// An integer of 16, 32 or 64 bits: the encoding is the same for all three.
    Int,
    Double,
    Binary,
    Struct(Fields),
    List(&'static Shape),
}

/// Numbers and types of a structure's fields.
type Fields = &'static [(i64, Shape)];

use Shape::{Binary, Bool, Byte, Double, Int, List, Struct};

const STATISTICS: Shape =
    Struct(&[(1, Binary), (2, Binary), (3, Int), (4, Int), (5, Binary), (6, Binary), (7, Bool), (8, Bool), (9, Int)]);
const PAGE_HEADER: Fields = &[
    (1, Int),
    (UNCOMPRESSED_PAGE_SIZE, Int),
    (COMPRESSED_PAGE_SIZE, Int),
    (4, Int),
    (5, Struct(&[(1, Int), (2, Int), (3, Int), (4, Int), (5, STATISTICS)])),
    (6, Struct(&[])),
    (DICTIONARY, Struct(&[(VALUES, Int), (2, Int), (3, Bool)])),
    (8, Struct(&[(1, Int), (2, Int), (3, Int), (4, Int), (5, Int), (6, Int), (7, Bool), (8, STATISTICS)])),
];
/// Size of the unpacked page, and of the stored page after its header.
const UNCOMPRESSED_PAGE_SIZE: i64 = 2;
const COMPRESSED_PAGE_SIZE: i64 = 3;
/// The header of a dictionary page, and the number of values that it states.
const DICTIONARY: i64 = 7;
const VALUES: i64 = 1;
/// Minimum size of a dictionary value: a 32-bit number, or the length of a text.
const MIN_VALUE_BYTES: u64 = 4;

const NOTHING: Shape = Struct(&[]);
const TIME: Shape = Struct(&[(1, Bool), (2, Struct(&[(1, NOTHING), (2, NOTHING), (3, NOTHING)]))]);
const LOGICAL_TYPE: Shape = Struct(&[
    (1, NOTHING),
    (2, NOTHING),
    (3, NOTHING),
    (4, NOTHING),
    (5, Struct(&[(1, Int), (2, Int)])),
    (6, NOTHING),
    (7, TIME),
    (8, TIME),
    (10, Struct(&[(1, Byte), (2, Bool)])),
    (11, NOTHING),
    (12, NOTHING),
    (13, NOTHING),
    (14, NOTHING),
    (15, NOTHING),
    (16, Struct(&[(1, Byte)])),
    (17, Struct(&[(1, Binary)])),
    (18, Struct(&[(1, Binary), (2, Int)])),
    (19, NOTHING),
]);
const SCHEMA_ELEMENT: Shape = Struct(&[
    (1, Int),
    (2, Int),
    (3, Int),
    (4, Binary),
    (5, Int),
    (6, Int),
    (7, Int),
    (8, Int),
    (9, Int),
    (10, LOGICAL_TYPE),
]);
const KEY_VALUE: Shape = Struct(&[(1, Binary), (2, Binary)]);
const BOUNDING_BOX: Shape =
    Struct(&[(1, Double), (2, Double), (3, Double), (4, Double), (5, Double), (6, Double), (7, Double), (8, Double)]);
const COLUMN_META_DATA: Shape = Struct(&[
    (1, Int),
    (2, List(&Int)),
    (3, List(&Binary)),
    (4, Int),
    (5, Int),
    (6, Int),
    (7, Int),
    (8, List(&KEY_VALUE)),
    (9, Int),
    (10, Int),
    (11, Int),
    (12, STATISTICS),
    (13, List(&Struct(&[(1, Int), (2, Int), (3, Int)]))),
    (14, Int),
    (15, Int),
    (16, Struct(&[(1, Int), (2, List(&Int)), (3, List(&Int))])),
    (17, Struct(&[(1, BOUNDING_BOX), (2, List(&Int))])),
]);
const COLUMN_CHUNK: Shape = Struct(&[
    (1, Binary),
    (2, Int),
    (3, COLUMN_META_DATA),
    (4, Int),
    (5, Int),
    (6, Int),
    (7, Int),
    (8, Struct(&[(1, NOTHING), (2, Struct(&[(1, List(&Binary)), (2, Binary)]))])),
    (9, Binary),
]);
const ROW_GROUP: Shape = Struct(&[
    (1, List(&COLUMN_CHUNK)),
    (2, Int),
    (3, Int),
    (4, List(&Struct(&[(1, Int), (2, Bool), (3, Bool)]))),
    (5, Int),
    (6, Int),
    (7, Int),
]);
const ENCRYPTION: Shape = Struct(&[(1, Binary), (2, Binary), (3, Bool)]);
const FILE_META_DATA: Fields = &[
    (1, Int),
    (2, List(&SCHEMA_ELEMENT)),
    (3, Int),
    (4, List(&ROW_GROUP)),
    (5, List(&KEY_VALUE)),
    (6, Binary),
    (7, List(&Struct(&[(1, NOTHING), (2, NOTHING), (3, NOTHING)]))),
    (8, Struct(&[(1, ENCRYPTION), (2, ENCRYPTION)])),
    (9, Binary),
];

/// Checks the header of each page that begins in the `length` bytes from `start`. The library allocates what a header
/// states: it may state a page of at most `largest` bytes, and a dictionary that fits in its page.
pub(super) fn check_pages(file: &File, start: u64, length: u64, largest: u64) -> Result<(), ParquetError> {
    let end = start.saturating_add(length);
    let mut header = Thrift::new(file, start, end, "a page header");
    header.bytes.seek(SeekFrom::Start(start))?;
    while header.at < end {
        header.page = Page::default();
        header.structure(PAGE_HEADER, 0)?;
        let Page { uncompressed, compressed, dictionary } = header.page;
        let size = |stated: Option<i64>| stated.and_then(|s| i32::try_from(s).ok()).and_then(|s| u64::try_from(s).ok());
        let (Some(compressed), Some(uncompressed)) = (size(compressed), size(uncompressed)) else {
            return Err(header.format_error("states no size of its page"));
        };
        if uncompressed > largest {
            return Err(header.format_error(&format!("states a page of {uncompressed} bytes, more than {largest}")));
        }
        if u64::try_from(dictionary).is_ok_and(|count| count.saturating_mul(MIN_VALUE_BYTES) > uncompressed) {
            return Err(header.format_error("states more values of a dictionary than its page has room for"));
        }
        header.skip(compressed)?;
    }
    Ok(())
}

/// Checks the footer. A file without a Parquet ending is left to the library.
pub(super) fn check_footer(mut file: &File) -> Result<(), ParquetError> {
    let length = file.seek(SeekFrom::End(0))?;
    let Some(tail) = length.checked_sub(TAIL) else { return Ok(()) };
    file.seek(SeekFrom::Start(tail))?;
    let (mut size, mut magic) = ([0; 4], [0; 4]);
    file.read_exact(&mut size)?;
    file.read_exact(&mut magic)?;
    let Some(start) = tail.checked_sub(u64::from(u32::from_le_bytes(size))) else { return Ok(()) };
    if magic == MAGIC {
        let mut footer = Thrift::new(file, start, tail, "the footer");
        footer.bytes.seek(SeekFrom::Start(start))?;
        footer.structure(FILE_META_DATA, 0)?;
        if footer.at != tail {
            return Err(footer.format_error("ends before its length"));
        }
    }
    file.rewind()?;
    Ok(())
}

struct Thrift<'a> {
    bytes: BufReader<&'a File>,
    /// Position in the file, and end of the part that is read.
    at: u64,
    end: u64,
    /// Name of the part that is read.
    part: &'static str,
    page: Page,
    /// Current field of the outermost structure.
    member: i64,
}

/// Sizes that a page header states.
#[derive(Clone, Copy, Default)]
struct Page {
    uncompressed: Option<i64>,
    compressed: Option<i64>,
    /// Number of dictionary values.
    dictionary: i64,
}

impl<'a> Thrift<'a> {
    fn new(file: &'a File, at: u64, end: u64, part: &'static str) -> Thrift<'a> {
        Thrift { bytes: BufReader::new(file), at, end, part, page: Page::default(), member: 0 }
    }
    fn format_error(&self, what: &str) -> ParquetError {
        ParquetError::General(format!("{} {what}", self.part))
    }

    /// Reads a structure up to its end.
    fn structure(&mut self, fields: Fields, depth: u8) -> Result<(), ParquetError> {
        if depth > DEEPEST {
            return Err(self.format_error("is nested too deeply"));
        }
        let mut field = 0_i64;
        loop {
            let begin = self.byte()?;
            if begin == 0 {
                return Ok(());
            }
            field = match begin >> 4 {
                0 => self.zigzag()?,
                delta => field + i64::from(delta),
            };
            // The library keeps the low 16 bits, which might be those of a field that it knows.
            if i16::try_from(field).is_err() {
                return Err(self.format_error("numbers a field beyond the format's"));
            }
            if depth == 0 {
                self.member = field;
            }
            let shape = fields.iter().find(|(number, _)| *number == field).map(|(_, shape)| *shape);
            match (shape, begin & 0xf) {
                // Booleans: the type contains the value.
                (None | Some(Bool), 1 | 2) => {}
                (Some(Int), 4..=6) => {
                    let value = self.zigzag()?;
                    match (depth, self.member, field) {
                        (0, _, UNCOMPRESSED_PAGE_SIZE) => self.page.uncompressed = Some(value),
                        (0, _, COMPRESSED_PAGE_SIZE) => self.page.compressed = Some(value),
                        // The last one counts, as in the library.
                        (1, DICTIONARY, VALUES) => self.page.dictionary = value,
                        _ => {}
                    }
                }
                (shape, kind) => self.value(shape, kind, depth)?,
            }
        }
    }

    /// Reads a value whose type must match its shape, if a shape is given. Booleans are refused here: in a structure
    /// they have no bytes, and in a list the library does not read them.
    fn value(&mut self, shape: Option<Shape>, kind: u8, depth: u8) -> Result<(), ParquetError> {
        match (kind, shape) {
            (3, None | Some(Byte)) => self.skip(1),
            (4..=6, None | Some(Int)) => self.zigzag().map(drop),
            (7, None | Some(Double)) => self.skip(8),
            (8, None | Some(Binary)) => {
                let length = self.varint()?;
                self.skip(length)
            }
            (9 | 10, None) => self.list(None, depth + 1),
            (9 | 10, Some(List(shape))) => self.list(Some(*shape), depth + 1),
            (12, None) => self.structure(&[], depth + 1),
            (12, Some(Struct(fields))) => self.structure(fields, depth + 1),
            (1..=12, Some(_)) => Err(self.format_error("contains a value of another type than the format's")),
            _ => Err(self.format_error("holds something unknown")),
        }
    }

    fn list(&mut self, shape: Option<Shape>, depth: u8) -> Result<(), ParquetError> {
        if depth > DEEPEST {
            return Err(self.format_error("is nested too deeply"));
        }
        let begin = self.byte()?;
        let count = match begin >> 4 {
            15 => self.varint()?,
            few => u64::from(few),
        };
        if count > self.end.saturating_sub(self.at) {
            return Err(self.format_error("states a list of more elements than it has bytes"));
        }
        for _ in 0..count {
            self.value(shape, begin & 0xf, depth)?;
        }
        Ok(())
    }

    fn byte(&mut self) -> Result<u8, ParquetError> {
        let mut byte = [0];
        self.bytes.read_exact(&mut byte)?;
        self.at += 1;
        Ok(byte[0])
    }

    fn varint(&mut self) -> Result<u64, ParquetError> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(self.format_error("holds a number of more than 64 bits"))
    }

    fn zigzag(&mut self) -> Result<i64, ParquetError> {
        let value = self.varint()?;
        Ok((value >> 1).cast_signed() ^ -((value & 1).cast_signed()))
    }

    fn skip(&mut self, bytes: u64) -> Result<(), ParquetError> {
        let far = i64::try_from(bytes).map_err(|_| self.format_error("leads out of the file"))?;
        self.bytes.seek_relative(far)?;
        self.at = self.at.saturating_add(bytes);
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::expect_used, reason = "tests end where what they need is not there")]
mod tests {
    use super::*;
    use std::io::Write;

    fn footer(bytes: &[u8]) -> Result<(), ParquetError> {
        let mut file = tempfile::tempfile().expect("a file");
        file.write_all(bytes).expect("written");
        file.write_all(&u32::try_from(bytes.len()).expect("short").to_le_bytes()).expect("written");
        file.write_all(&MAGIC).expect("written");
        check_footer(&file)
    }

    #[test]
    fn lists_are_as_long_as_they_say() {
        // Field 20 is unknown to the format: a list of two or of 2^31 numbers, or of booleans, which take the library
        // no byte.
        let list = |kind: u8, count: &[u8]| [&[0x09, 40, 0xf0 | kind][..], count, &[2, 2, 0]].concat();
        let many = [0x80, 0x80, 0x80, 0x80, 0x08];
        assert!(footer(&list(5, &[2])).is_ok());
        for (kind, count) in [(5, &many[..]), (1, &many), (1, &[2]), (9, &many)] {
            let e = footer(&list(kind, count)).expect_err("refused");
            assert!(e.to_string().contains("the footer"), "{e}");
        }
    }

    #[test]
    fn nothing_hides_behind_another_kind() {
        // Field 1 is a number. As text of six bytes it would hide a list, because the library reads the 6 as the number
        // and continues.
        assert!(footer(&[0x15, 4, 0]).is_ok());
        assert!(footer(&[0x18, 6, 0x29, 0xf1, 0xff, 0xff, 0xff, 0x07, 0]).is_err());
        // A union of the format whose member is stated as a boolean, which takes no byte; and bytes after the end.
        assert!(footer(&[0x79, 0x1c, 0x31, 0x00, 0x00]).is_err());
        assert!(footer(&[0x15, 4, 0, 0]).is_err());
        // Field 65537 is 1 in 16 bits.
        assert!(footer(&[0x08, 0x82, 0x80, 0x08, 6, 1, 1, 1, 1, 1, 1, 0]).is_err());
    }
}
