//! Encodes a [`Frame`] as its derived `prost::Message` does, but one column at a time. The derived code checks the
//! buffer before every value, which takes twice the instructions.

use super::frame::{Contacts, Frame, Joints, Links};
use prost::encoding::{
    WireType, double, encode_key, encode_varint, encoded_len_varint, fixed64, key_len, message, uint64,
};

/// A packed column.
enum PackedColumn<'a> {
    Doubles(&'a [f64]),
    Numbers(&'a [u32]),
    Flags(&'a [bool]),
}

use PackedColumn::{Doubles, Flags, Numbers};

impl PackedColumn<'_> {
    /// Bytes of its values.
    fn len(&self) -> usize {
        match self {
            Doubles(values) => 8 * values.len(),
            Numbers(values) => values.iter().map(|v| encoded_len_varint(u64::from(*v))).sum(),
            Flags(values) => values.len(),
        }
    }

    /// Encoded size with tag and length; an empty column is omitted.
    fn len_with_head(&self, tag: u32) -> usize {
        match self.len() {
            0 => 0,
            len => key_len(tag) + encoded_len_varint(len as u64) + len,
        }
    }

    fn put(&self, tag: u32, out: &mut Vec<u8>) {
        let len = self.len();
        if len == 0 {
            return;
        }
        encode_key(tag, WireType::LengthDelimited, out);
        encode_varint(len as u64, out);
        let start = out.len();
        match self {
            Doubles(values) => {
                out.resize(start + len, 0);
                for (to, from) in out[start..].as_chunks_mut::<8>().0.iter_mut().zip(*values) {
                    *to = from.to_le_bytes();
                }
            }
            // Usually all values are below 128 and take one byte each.
            Numbers(values) if len == values.len() => out.extend(values.iter().map(|v| *v as u8)),
            Numbers(values) => values.iter().for_each(|v| encode_varint(u64::from(*v), out)),
            Flags(values) => out.extend(values.iter().map(|v| u8::from(*v))),
        }
    }
}

/// Encodes a message of columns, whose tags count from one.
fn put_columns(tag: u32, columns: &[PackedColumn<'_>], out: &mut Vec<u8>) {
    let tagged = || (1..).zip(columns);
    encode_key(tag, WireType::LengthDelimited, out);
    encode_varint(tagged().map(|(tag, c)| c.len_with_head(tag) as u64).sum(), out);
    tagged().for_each(|(tag, column)| column.put(tag, out));
}

impl Frame {
    /// Appends what `prost::Message::encode_raw` would.
    pub fn put_bytes(&self, out: &mut Vec<u8>) {
        let Frame { step, t_s, state_hash, crank_angle_rad, links, joints, contacts, rotors, energy, sensors } = self;
        if *step != 0 {
            uint64::encode(1, step, out);
        }
        if *t_s != 0.0 {
            double::encode(2, t_s, out);
        }
        if *state_hash != 0 {
            fixed64::encode(3, state_hash, out);
        }
        if *crank_angle_rad != 0.0 {
            double::encode(4, crank_angle_rad, out);
        }
        put_columns(5, &of_links(links), out);
        put_columns(6, &of_joints(joints), out);
        put_columns(7, &of_contacts(contacts), out);
        message::encode(8, rotors, out);
        message::encode(9, energy, out);
        Doubles(sensors).put(10, out);
    }
}

fn of_links(l: &Links) -> [PackedColumn<'_>; 9] {
    let Links { x_m, y_m, angle_rad, vx_m_s, vy_m_s, omega_rad_s, ax_m_s2, ay_m_s2, alpha_rad_s2 } = l;
    [x_m, y_m, angle_rad, vx_m_s, vy_m_s, omega_rad_s, ax_m_s2, ay_m_s2, alpha_rad_s2].map(|column| Doubles(column))
}

fn of_joints(j: &Joints) -> [PackedColumn<'_>; 3] {
    let Joints { force_x_n, force_y_n, friction_torque_nm } = j;
    [force_x_n, force_y_n, friction_torque_nm].map(|column| Doubles(column))
}

fn of_contacts(c: &Contacts) -> [PackedColumn<'_>; 20] {
    let Contacts {
        link,
        feature,
        body,
        tooth,
        segment,
        point_body_x_m,
        point_body_y_m,
        point_link_x_m,
        point_link_y_m,
        normal_x,
        normal_y,
        penetration_m,
        approach_speed_m_s,
        normal_speed_m_s,
        tangential_speed_m_s,
        normal_force_n,
        tangential_force_n,
        stick,
        age_s,
        instant_force_n,
    } = c;
    [
        Numbers(link),
        Numbers(feature),
        Numbers(body),
        Numbers(tooth),
        Numbers(segment),
        Doubles(point_body_x_m),
        Doubles(point_body_y_m),
        Doubles(point_link_x_m),
        Doubles(point_link_y_m),
        Doubles(normal_x),
        Doubles(normal_y),
        Doubles(penetration_m),
        Doubles(approach_speed_m_s),
        Doubles(normal_speed_m_s),
        Doubles(tangential_speed_m_s),
        Doubles(normal_force_n),
        Doubles(tangential_force_n),
        Flags(stick),
        Doubles(age_s),
        Doubles(instant_force_n),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::frame::{Energy, Rotors};
    use super::*;
    use prost::Message;

    #[test]
    fn bytes_are_those_of_the_derived_message() {
        for n in [0_usize, 1, 7, 90, 300] {
            let column = |k: usize| (0..n).map(|i| (i * 31 + k) as f64 * -0.37 + 5.0).collect::<Vec<_>>();
            let numbers = |most: u32| (0..n as u32).map(|i| i * 37 % most).collect::<Vec<_>>();
            let frame = Frame {
                step: n as u64 * 1_000_003,
                t_s: n as f64 * 1e-3,
                state_hash: (n as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15),
                crank_angle_rad: n as f64,
                links: Links {
                    x_m: column(1),
                    y_m: column(2),
                    angle_rad: column(3),
                    vx_m_s: column(4),
                    vy_m_s: column(5),
                    omega_rad_s: column(6),
                    ax_m_s2: column(28),
                    ay_m_s2: column(29),
                    alpha_rad_s2: column(30),
                },
                joints: Joints { force_x_n: column(7), force_y_n: column(8), friction_torque_nm: column(9) },
                contacts: Contacts {
                    link: numbers(1000),
                    feature: numbers(5),
                    body: numbers(4),
                    tooth: numbers(128),
                    segment: numbers(129),
                    point_body_x_m: column(10),
                    point_body_y_m: column(11),
                    point_link_x_m: column(12),
                    point_link_y_m: column(13),
                    normal_x: column(14),
                    normal_y: column(15),
                    penetration_m: column(16),
                    approach_speed_m_s: column(17),
                    normal_speed_m_s: column(18),
                    tangential_speed_m_s: column(19),
                    normal_force_n: column(20),
                    tangential_force_n: column(21),
                    stick: (0..n).map(|i| i % 3 == 0).collect(),
                    age_s: column(22),
                    instant_force_n: column(31),
                },
                rotors: Rotors {
                    angle_rad: column(23),
                    speed_rad_s: column(24),
                    chain_torque_nm: column(25),
                    outer_torque_nm: column(26),
                },
                energy: Energy { kinetic_j: n as f64, error_j: -0.5, ..Energy::default() },
                sensors: column(27),
            };
            let mut bytes = vec![1, 2, 3];
            frame.put_bytes(&mut bytes);
            assert_eq!(bytes[3..], frame.encode_to_vec(), "{n} values a column");
        }
    }
}
