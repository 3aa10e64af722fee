//! The headers of a column's pages, looked at before the library decodes them. The library skips a list as often as the list
//! states, whether its elements are there or not: a list of 2^31 took it a minute. No header of the format holds a list.
//! Encoding: Thrift's compact protocol, <https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md>.

use parquet::errors::ParquetError;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};

/// Structures within structures; the format has three.
const DEEPEST: u8 = 8;
/// Fields of a page header that are 32-bit numbers: its kind, sizes of the page, its checksum.
const NUMBERS: std::ops::RangeInclusive<i64> = 1..=4;
/// Which of them is the bytes of the page that follows it.
const COMPRESSED_PAGE_SIZE: i64 = 3;

/// Looks at the header of each page that begins in the `length` bytes from `start`.
pub(super) fn check(file: &File, start: u64, length: u64) -> Result<(), ParquetError> {
    let mut header = Header { bytes: BufReader::new(file), at: start };
    header.bytes.seek(SeekFrom::Start(start))?;
    let end = start.saturating_add(length);
    while header.at < end {
        let size = header.structure(0)?.and_then(|size| i32::try_from(size).ok());
        let Some(page) = size.and_then(|size| u64::try_from(size).ok()) else {
            return Err(wrong("states no size of its page"));
        };
        header.skip(page)?;
    }
    Ok(())
}

fn wrong(what: &str) -> ParquetError {
    ParquetError::General(format!("a page header {what}"))
}

struct Header<'a> {
    bytes: BufReader<&'a File>,
    /// Place in the file.
    at: u64,
}

impl Header<'_> {
    /// Reads a structure up to its end and returns its field `COMPRESSED_PAGE_SIZE`.
    fn structure(&mut self, depth: u8) -> Result<Option<i64>, ParquetError> {
        if depth > DEEPEST {
            return Err(wrong("is nested too deeply"));
        }
        let (mut field, mut size) = (0_i64, None);
        loop {
            let begin = self.byte()?;
            if begin == 0 {
                return Ok(size);
            }
            field = match begin >> 4 {
                0 => self.zigzag()?,
                delta => field.wrapping_add(i64::from(delta)),
            };
            // The library reads these as whole numbers whatever they are said to be.
            if depth == 0 && NUMBERS.contains(&field) && begin & 0xf != 5 {
                return Err(wrong("holds a number of another kind than the format's"));
            }
            match begin & 0xf {
                // Booleans: the kind is the value.
                1 | 2 => {}
                3 => self.skip(1)?,
                4..=6 => {
                    let value = self.zigzag()?;
                    if field == COMPRESSED_PAGE_SIZE {
                        size = Some(value);
                    }
                }
                7 => self.skip(8)?,
                8 => {
                    let length = self.varint()?;
                    self.skip(length)?;
                }
                12 => {
                    self.structure(depth + 1)?;
                }
                _ => return Err(wrong("holds a list, or something unknown")),
            }
        }
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
        Err(wrong("holds a number of more than 64 bits"))
    }

    fn zigzag(&mut self) -> Result<i64, ParquetError> {
        let value = self.varint()?;
        Ok((value >> 1).cast_signed() ^ -((value & 1).cast_signed()))
    }

    fn skip(&mut self, bytes: u64) -> Result<(), ParquetError> {
        let far = i64::try_from(bytes).map_err(|_| wrong("leads out of the file"))?;
        self.bytes.seek_relative(far)?;
        self.at = self.at.saturating_add(bytes);
        Ok(())
    }
}
