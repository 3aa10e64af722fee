//! Encodes a [`Frame`] as its derived `prost::Message` does, but one column at a time. The derived code checks the
//! buffer before every value, which takes twice the instructions.

use super::columns::{Column, ColumnValues};
use super::frame::Frame;
use prost::encoding::{
    WireType, double, encode_key, encode_varint, encoded_len_varint, fixed64, key_len, message, string, uint64,
};

/// Bytes of a packed column.
fn len(values: &ColumnValues<'_>) -> usize {
    let of = |numbers: &mut dyn Iterator<Item = u64>| numbers.map(encoded_len_varint).sum();
    match values {
        ColumnValues::F64(values) => 8 * values.len(),
        ColumnValues::U32(values) => of(&mut values.iter().map(|v| u64::from(*v))),
        ColumnValues::U64(values) => of(&mut values.iter().copied()),
        ColumnValues::Bool(values) => values.len(),
        // Texts are not packed.
        ColumnValues::Text(_) => 0,
    }
}

/// Encoded size with tag and length; an empty column is omitted.
fn len_with_head(tag: u32, values: &ColumnValues<'_>) -> usize {
    match (values, len(values)) {
        (ColumnValues::Text(texts), _) => string::encoded_len_repeated(tag, texts),
        (_, 0) => 0,
        (_, len) => key_len(tag) + encoded_len_varint(len as u64) + len,
    }
}

fn put(tag: u32, values: &ColumnValues<'_>, out: &mut Vec<u8>) {
    if let ColumnValues::Text(texts) = values {
        string::encode_repeated(tag, texts, out);
    }
    let len = len(values);
    if len == 0 {
        return;
    }
    encode_key(tag, WireType::LengthDelimited, out);
    encode_varint(len as u64, out);
    let start = out.len();
    match values {
        ColumnValues::F64(values) => {
            out.resize(start + len, 0);
            for (to, from) in out[start..].as_chunks_mut::<8>().0.iter_mut().zip(*values) {
                *to = from.to_le_bytes();
            }
        }
        // Usually all values are below 128 and take one byte each.
        ColumnValues::U32(values) if len == values.len() => out.extend(values.iter().map(|v| *v as u8)),
        ColumnValues::U32(values) => values.iter().for_each(|v| encode_varint(u64::from(*v), out)),
        ColumnValues::U64(values) => values.iter().for_each(|v| encode_varint(*v, out)),
        ColumnValues::Bool(values) => out.extend(values.iter().map(|v| u8::from(*v))),
        ColumnValues::Text(_) => {}
    }
}

/// Encodes a table, whose columns stand in the order of their tags.
fn put_table(tag: u32, columns: &[Column], values: &[ColumnValues<'_>], out: &mut Vec<u8>) {
    let tagged = || columns.iter().map(|c| c.tag).zip(values);
    encode_key(tag, WireType::LengthDelimited, out);
    encode_varint(tagged().map(|(tag, values)| len_with_head(tag, values) as u64).sum(), out);
    tagged().for_each(|(tag, values)| put(tag, values, out));
}

impl Frame {
    /// Appends what `prost::Message::encode_raw` would.
    pub fn put_bytes(&self, out: &mut Vec<u8>) {
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
        self.each_table(|table, values| {
            if table.tag < 9 {
                put_table(table.tag, table.message.columns, values, out);
            }
        });
        message::encode(9, &self.energy, out);
        put(10, &ColumnValues::F64(&self.sensors), out);
        self.each_table(|table, values| {
            if table.tag > 10 {
                put_table(table.tag, table.message.columns, values, out);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::columns::ValuesMut;
    use super::super::frame::Energy;
    use super::*;
    use prost::Message;

    #[test]
    fn bytes_are_those_of_the_derived_message() {
        for n in [0_usize, 1, 7, 90, 300] {
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
            let mut bytes = vec![1, 2, 3];
            frame.put_bytes(&mut bytes);
            assert_eq!(bytes[3..], frame.encode_to_vec(), "{n} values a column");
        }
    }
}
