//! Frames as bytes of their schema, one column at a time: the derived code would check the buffer before every value, which
//! takes twice the instructions, and floats are stored in parts ([`super::stored_floats`]).

use super::columns::{Column, ColumnValues, FINE_TAG, Stored, TableInfo};
use super::frame::Frame;
use super::stored_floats::{SplitColumn, join, round};
use crate::integrate::{Isa, vectorised};
use prost::DecodeError;
use prost::bytes::Buf;
use prost::encoding::{
    DecodeContext, WireType, bytes, double, encode_key, encode_varint, encoded_len_varint, fixed64, key_len, message,
    string, uint64,
};

/// Bytes of a column without those of [`fine_len`]; texts are not packed.
fn len(stored: Stored, values: &ColumnValues<'_>) -> usize {
    let of = |numbers: &mut dyn Iterator<Item = u64>| numbers.map(encoded_len_varint).sum();
    match (stored, values) {
        (Stored::derived, _) | (_, ColumnValues::Text(_)) => 0,
        (Stored::double, ColumnValues::F64(values)) => 8 * values.len(),
        (_, ColumnValues::F64(values)) => 4 * values.len(),
        // One byte each, as far as all are below 128.
        (_, ColumnValues::U32(values)) if values.iter().fold(0, |all, v| all | v) < 128 => values.len(),
        (_, ColumnValues::U32(values)) => of(&mut values.iter().map(|v| u64::from(*v))),
        (_, ColumnValues::U64(values)) => of(&mut values.iter().copied()),
        (_, ColumnValues::Bool(values)) => values.len(),
    }
}

/// Encoded size with tag and length; an empty column is omitted.
fn len_with_head(tag: u32, len: usize) -> usize {
    if len == 0 { 0 } else { key_len(tag) + encoded_len_varint(len as u64) + len }
}

fn column_len(column: &Column, values: &ColumnValues<'_>) -> usize {
    let Column { tag, stored, .. } = *column;
    match values {
        ColumnValues::Text(texts) => string::encoded_len_repeated(tag, texts),
        ColumnValues::F64(_) | ColumnValues::U32(_) | ColumnValues::U64(_) | ColumnValues::Bool(_) => {
            len_with_head(tag, len(stored, values)) + len_with_head(tag + FINE_TAG, stored.fine_bytes() * values.len())
        }
    }
}

/// Encoded size of a table, without its own head.
pub fn columns_len(columns: &[Column], values: &[ColumnValues<'_>]) -> usize {
    columns.iter().zip(values).map(|(column, values)| column_len(column, values)).sum()
}

/// Appends a field of `len` bytes, and returns its content to be written.
fn field(tag: u32, len: usize, out: &mut Vec<u8>) -> &mut [u8] {
    encode_key(tag, WireType::LengthDelimited, out);
    encode_varint(len as u64, out);
    let start = out.len();
    out.resize(start + len, 0);
    &mut out[start..]
}

/// Writes floats, and the bits behind them.
fn put_in_parts<const BITS: u32, const BYTES: usize>(isa: Isa, tag: u32, values: &[f64], out: &mut Vec<u8>) {
    let n = values.len();
    field(tag, 4 * n, out);
    let coarse_at = out.len() - 4 * n;
    field(tag + FINE_TAG, BYTES * n, out);
    let fine_at = out.len() - BYTES * n;
    let (before, fine) = out.split_at_mut(fine_at);
    let coarse = before[coarse_at..][..4 * n].as_chunks_mut::<4>().0;
    vectorised(isa, SplitColumn::<BITS, BYTES> { values, coarse, fine: fine.as_chunks_mut::<BYTES>().0 });
}

fn put(isa: Isa, column: &Column, values: &ColumnValues<'_>, out: &mut Vec<u8>) {
    let Column { tag, stored, .. } = *column;
    let len = len(stored, values);
    match values {
        ColumnValues::Text(texts) => string::encode_repeated(tag, texts, out),
        ColumnValues::F64(_) | ColumnValues::U32(_) | ColumnValues::U64(_) | ColumnValues::Bool(_) if len == 0 => {}
        ColumnValues::F64(values) => match stored {
            Stored::double48 => put_in_parts::<16, 2>(isa, tag, values, out),
            Stored::double40 => put_in_parts::<8, 1>(isa, tag, values, out),
            Stored::float => {
                for (to, from) in field(tag, len, out).as_chunks_mut::<4>().0.iter_mut().zip(*values) {
                    *to = (*from as f32).to_le_bytes();
                }
            }
            Stored::double | Stored::derived | Stored::uint32 | Stored::uint64 | Stored::bool | Stored::string => {
                put_doubles(tag, values, out)
            }
        },
        // Usually all values are below 128 and take one byte each.
        ColumnValues::U32(values) if len == values.len() => {
            field(tag, len, out).iter_mut().zip(*values).for_each(|(to, from)| *to = *from as u8);
        }
        ColumnValues::U32(values) => {
            encode_key(tag, WireType::LengthDelimited, out);
            encode_varint(len as u64, out);
            values.iter().for_each(|v| encode_varint(u64::from(*v), out));
        }
        ColumnValues::U64(values) => {
            encode_key(tag, WireType::LengthDelimited, out);
            encode_varint(len as u64, out);
            values.iter().for_each(|v| encode_varint(*v, out));
        }
        ColumnValues::Bool(values) => {
            field(tag, len, out).iter_mut().zip(*values).for_each(|(to, from)| *to = u8::from(*from));
        }
    }
}

fn put_doubles(tag: u32, values: &[f64], out: &mut Vec<u8>) {
    for (to, from) in field(tag, 8 * values.len(), out).as_chunks_mut::<8>().0.iter_mut().zip(values) {
        *to = from.to_le_bytes();
    }
}

/// Appends the columns of a table, which stand in the order of their tags.
fn put_columns(isa: Isa, columns: &[Column], values: &[ColumnValues<'_>], out: &mut Vec<u8>) {
    columns.iter().zip(values).for_each(|(column, values)| put(isa, column, values, out));
}

/// The same without a choice of vector unit.
pub fn put_table(columns: &[Column], values: &[ColumnValues<'_>], out: &mut Vec<u8>) {
    put_columns(Isa::Baseline, columns, values, out);
}

impl Frame {
    /// Rounds every column to what it stores, and computes those that are not stored. A taken frame thereby has the bits of
    /// the frame that is read.
    pub fn round_to_stored(&mut self, isa: Isa) {
        self.each_table_mut(|table, columns| {
            for (column, values) in table.message.columns.iter().zip(columns) {
                values.all_f64(|values| round(isa, column.stored, values));
            }
        });
        self.derive();
    }

    /// Appends what `prost::Message::encode_raw` would. Of values that are not rounded ([`Frame::round_to_stored`]) the digits
    /// behind are cut off.
    pub fn put_bytes(&self, isa: Isa, out: &mut Vec<u8>) {
        if self.step != 0 {
            uint64::encode(1, &self.step, out);
        }
        if self.t_s != 0.0 {
            double::encode(2, &self.t_s, out);
        }
        if self.state_hash != 0 {
            fixed64::encode(3, &self.state_hash, out);
        }
        if self.crank_angle_rad != 0.0 {
            double::encode(4, &self.crank_angle_rad, out);
        }
        // In the order of their numbers: what came later stands behind the ledger and the sensors.
        let put_one = |table: &TableInfo, values: &[ColumnValues<'_>], out: &mut Vec<u8>| {
            encode_key(table.tag, WireType::LengthDelimited, out);
            encode_varint(columns_len(table.message.columns, values) as u64, out);
            put_columns(isa, table.message.columns, values, out);
        };
        self.each_table(|table, values| {
            if table.tag < 9 {
                put_one(table, values, out);
            }
        });
        message::encode(9, &self.energy, out);
        if !self.sensors.is_empty() {
            put_doubles(10, &self.sensors, out);
        }
        self.each_table(|table, values| {
            if table.tag > 10 {
                put_one(table, values, out);
            }
        });
    }
}

/// What a field of a table holds.
#[derive(Clone, Copy)]
pub struct ColumnPart {
    pub stored: Stored,
    /// The fine bytes of a column.
    pub is_fine: bool,
    pub wire_type: WireType,
}

/// Takes a column out of a message.
pub trait MergeColumn {
    fn merge(&mut self, part: ColumnPart, from: &mut impl Buf, context: DecodeContext) -> Result<(), DecodeError>;
}

/// Adds fine parts to floats. Where one of both has more values than the other, the column becomes one that is as long as the
/// fine part, which the check of lengths finds.
fn add_fine<const BITS: u32>(column: &mut Vec<f64>, n: usize, parts: impl Iterator<Item = u32>) {
    column.resize(n, f64::NAN);
    for (value, fine) in column.iter_mut().zip(parts) {
        *value = join::<BITS>(*value as f32, fine);
    }
}

impl MergeColumn for Vec<f64> {
    fn merge(&mut self, part: ColumnPart, from: &mut impl Buf, context: DecodeContext) -> Result<(), DecodeError> {
        let ColumnPart { stored, is_fine, wire_type } = part;
        if stored == Stored::double && !is_fine {
            return double::merge_repeated(wire_type, self, from, context);
        }
        let mut raw: Vec<u8> = Vec::new();
        bytes::merge(wire_type, &mut raw, from, context)?;
        match (stored, is_fine) {
            (Stored::double48, true) => {
                let parts = raw.as_chunks::<2>().0;
                add_fine::<16>(self, parts.len(), parts.iter().map(|b| u32::from(u16::from_le_bytes(*b))));
            }
            (Stored::double40, true) => {
                add_fine::<8>(self, raw.len(), raw.iter().map(|b| u32::from(*b)));
            }
            (Stored::double48 | Stored::double40 | Stored::float, false) => {
                self.extend(raw.as_chunks::<4>().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))));
            }
            // Fields that no column has.
            (
                Stored::double
                | Stored::float
                | Stored::derived
                | Stored::uint32
                | Stored::uint64
                | Stored::bool
                | Stored::string,
                _,
            ) => {}
        }
        Ok(())
    }
}

impl MergeColumn for Vec<u32> {
    fn merge(&mut self, part: ColumnPart, from: &mut impl Buf, context: DecodeContext) -> Result<(), DecodeError> {
        prost::encoding::uint32::merge_repeated(part.wire_type, self, from, context)
    }
}

impl MergeColumn for Vec<bool> {
    fn merge(&mut self, part: ColumnPart, from: &mut impl Buf, context: DecodeContext) -> Result<(), DecodeError> {
        prost::encoding::bool::merge_repeated(part.wire_type, self, from, context)
    }
}

#[cfg(test)]
mod tests {
    use super::super::columns::ValuesMut;
    use super::super::frame::Energy;
    use super::*;
    use prost::Message;

    fn frame(n: usize) -> Frame {
        let mut frame = Frame {
            step: n as u64 * 1_000_003,
            t_s: n as f64 * 1e-3,
            state_hash: (n as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15),
            crank_angle_rad: n as f64,
            energy: Energy { kinetic_j: n as f64, error_j: -0.5, ..Energy::default() },
            sensors: (0..n).map(|i| i as f64 * -0.37 + 5.0).collect(),
            ..Frame::default()
        };
        frame.resize_tables(n);
        let mut k = 0;
        frame.each_table_mut(|_, columns| {
            for column in columns {
                k += 1;
                // Numbers of one byte each, and of one and two.
                let most = [4, 128, 129, 1000][k % 4];
                match column {
                    ValuesMut::F64(v) => (0..n).for_each(|i| v[i] = (i * 31 + k) as f64 * -0.37 + 5.0),
                    ValuesMut::U32(v) => (0..n).for_each(|i| v[i] = i as u32 * 37 % most),
                    ValuesMut::U64(v) => (0..n).for_each(|i| v[i] = i as u64 * 37 % u64::from(most)),
                    ValuesMut::Bool(v) => (0..n).for_each(|i| v[i] = i % 3 == 0),
                    ValuesMut::Text(v) => (0..n).for_each(|i| v[i] = format!("{i}")),
                }
            }
        });
        frame
    }

    #[test]
    fn bytes_are_those_of_the_derived_message() {
        for n in [0_usize, 1, 7, 90, 300] {
            let frame = frame(n);
            let mut bytes = Vec::new();
            for isa in Isa::available() {
                bytes = vec![1, 2, 3];
                frame.put_bytes(isa, &mut bytes);
                assert_eq!(bytes[3..], frame.encode_to_vec(), "{n} values a column, {isa:?}");
            }
            assert_eq!(bytes.len() - 3, frame.encoded_len(), "{n} values a column");
        }
    }

    #[test]
    fn what_is_rounded_comes_back_to_the_bit() {
        for n in [0_usize, 1, 7, 90, 300] {
            let mut frame = frame(n);
            frame.round_to_stored(Isa::detect());
            let mut read = Frame::decode(frame.encode_to_vec().as_slice()).unwrap();
            read.derive();
            assert!(read == frame, "{n} values a column");
        }
    }

    #[test]
    fn parts_of_different_lengths_give_a_column_of_another_length() {
        let whole = {
            let mut frame = frame(3);
            frame.round_to_stored(Isa::detect());
            frame
        };
        // The last field of the message of joints is the fine part of their torques.
        let bytes = whole.joints.encode_to_vec();
        let mut cut = bytes[..bytes.len() - 1].to_vec();
        let at = cut.len() - 3;
        assert_eq!(cut[at], 3);
        cut[at] = 2;
        let joints = super::super::frame::Joints::decode(cut.as_slice()).unwrap();
        assert_eq!(joints.friction_torque_nm.len(), 2);
        assert_eq!(joints.force_x_n, whole.joints.force_x_n);
    }
}
