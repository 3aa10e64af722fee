//! A recording in Foxglove's own messages: outlines attached to moving frames, forces as arrows, events as log.

use super::contact_labels::{ContactLabel, close_up_room_m, contact_labels, reference_force_n};
use super::frame::{Event, Frame, Header, Outline, OutlineCircle};
use super::palette::{FORCE, FRICTION};
use super::view_geometry::{DrawnForce, circle, drawn_forces, polyline, scene_bounds};
use foxglove::Encode;
use foxglove::messages::{
    ArrowPrimitive, Color, FrameTransform, FrameTransforms, LinePrimitive, Log, Point3, Pose, Quaternion, SceneEntity,
    SceneUpdate, TextPrimitive, Timestamp, Vector3, line_primitive,
};
use prost::Message;
use prost::encoding::{WireType, encode_key, encode_varint};
use std::borrow::Cow;

/// Name of the fixed frame.
const WORLD: &str = "world";
/// Length of an arrow for a force equal to the mean static tension, as a share of the drive's width; diameters of shaft and head as shares of that
/// length.
const ARROW: f64 = 0.05;
const SHAFT: f64 = 0.06;
const HEAD: f64 = 0.15;
/// Where the scale of forces stands under the drive: share of the drive's width, and lengths of its arrow down to it and on to its text.
const LEGEND: (f64, f64, f64) = (0.25, 1.0, 0.4);
/// Room of a label in a picture of the whole drive, across and upright, as shares of the drive's width. Measured in Lichtblick 1.28: labels take 150 pixels
/// of some 1000 that the drive takes.
const LABEL_ROOM: [f64; 2] = [0.15, 0.025];
/// Heights of arrows and labels over the chain: else its lines are drawn over them [m].
const ARROWS_UP_M: f64 = 5e-3;
const LABELS_UP_M: f64 = 10e-3;
/// Friction that is drawn, as a share of the mean static tension.
const SMALLEST_FRICTION: f64 = 0.02;
/// Size of labels [pixels].
const FONT_SIZE: f64 = 12.0;

/// Schema of one of Foxglove's messages that recordings use; None for any other name.
pub fn schema(name: &str) -> Option<Cow<'static, [u8]>> {
    let schema = match name {
        "foxglove.SceneUpdate" => SceneUpdate::get_schema(),
        "foxglove.FrameTransforms" => FrameTransforms::get_schema(),
        "foxglove.Log" => Log::get_schema(),
        _ => None,
    };
    schema.map(|s| s.data)
}

fn timestamp(t_ns: u64) -> Option<Timestamp> {
    let seconds = u32::try_from(t_ns / 1_000_000_000).ok()?;
    Some(Timestamp::new(seconds, (t_ns % 1_000_000_000) as u32))
}

/// All outlines, each attached to the frame of its body.
pub fn outlines(header: &Header) -> SceneUpdate {
    let mut entities = Vec::new();
    for (i, link) in header.links.iter().enumerate() {
        if let Some(outline) = header.link_outlines.get(link.outline as usize) {
            let color = if link.outline == 0 { rgb(0.35, 0.55, 0.85) } else { rgb(0.85, 0.55, 0.25) };
            entities.push(entity(&format!("link/{i}"), outline, color));
        }
    }
    for (i, roller) in header.rollers.iter().enumerate() {
        let circle = |radius_m: f64| OutlineCircle { x_m: 0.0, y_m: 0.0, radius_m };
        let circles = vec![circle(roller.radius_m), circle(roller.bore_radius_m)];
        let outline = Outline { circles, ..Outline::default() };
        entities.push(entity(&format!("roller/{i}"), &outline, rgb(0.8, 0.8, 0.5)));
    }
    for body in &header.bodies {
        if let Some(outline) = &body.outline {
            entities.push(entity(&body.path, outline, rgb(0.55, 0.55, 0.58)));
        }
    }
    entities.extend(ForceArrows::new(header).scale(header));
    SceneUpdate { deletions: Vec::new(), entities }
}

fn entity(frame_id: &str, outline: &Outline, color: Color) -> SceneEntity {
    // A ball is a circle alone.
    let contour = Some(polyline(outline)).filter(|points| !points.is_empty());
    let mut lines: Vec<LinePrimitive> = contour.iter().map(|points| line(points, outline.closed, color)).collect();
    lines.extend(outline.circles.iter().map(|c| line(&circle(c.x_m, c.y_m, c.radius_m), true, color)));
    SceneEntity {
        timestamp: timestamp(0),
        frame_id: frame_id.to_string(),
        id: format!("outline/{frame_id}"),
        frame_locked: true,
        lines,
        ..SceneEntity::default()
    }
}

/// How large forces are drawn.
pub struct ForceArrows {
    /// Length of the arrow of a force equal to the mean static tension [m].
    length_m: f64,
    m_per_n: f64,
    label_room_m: [f64; 2],
}

impl ForceArrows {
    pub fn new(header: &Header) -> ForceArrows {
        let (low, high) = scene_bounds(header);
        let width_m = (high[0] - low[0]).max(high[1] - low[1]).max(0.0);
        let close_m = close_up_room_m(header);
        let length_m = ARROW * width_m;
        ForceArrows {
            length_m,
            m_per_n: length_m / reference_force_n(header),
            label_room_m: [0, 1].map(|k| close_m[k].max(LABEL_ROOM[k] * width_m)),
        }
    }

    /// Lowest point of the scale of forces below a drive whose lowest point this is [m].
    pub fn legend_ends_at(&self, low_m: f64) -> f64 {
        low_m - (LEGEND.1 + 2.0 * LEGEND.2) * self.length_m
    }

    /// An arrow of a round force, below the drive.
    fn scale(&self, header: &Header) -> Option<SceneEntity> {
        let (low, high) = scene_bounds(header);
        let force_n = round_force(reference_force_n(header));
        let length_m = force_n * self.m_per_n;
        let [x, y] = [low[0] + LEGEND.0 * (high[0] - low[0]), low[1] - LEGEND.1 * self.length_m];
        let text = format!("contact force {force_n} N (blue: its friction)");
        (low[0] <= high[0]).then(|| SceneEntity {
            timestamp: timestamp(0),
            frame_id: WORLD.to_string(),
            id: "scale".to_string(),
            arrows: vec![self.arrow([x - 0.5 * length_m, y], [length_m, 0.0], FORCE)],
            texts: vec![words([x, y - LEGEND.2 * self.length_m], text)],
            ..SceneEntity::default()
        })
    }

    fn arrow(&self, [x, y]: [f64; 2], [ax, ay]: [f64; 2], colour: [u8; 3]) -> ArrowPrimitive {
        let [r, g, b] = colour.map(|part| f64::from(part) / 255.0);
        let length = (ax * ax + ay * ay).sqrt();
        let position = Vector3 { x, y, z: ARROWS_UP_M };
        ArrowPrimitive {
            pose: Some(Pose { position: Some(position), orientation: Some(along(ax, ay, length)) }),
            shaft_length: 0.7 * length,
            shaft_diameter: SHAFT * self.length_m,
            head_length: 0.3 * length,
            head_diameter: HEAD * self.length_m,
            color: Some(rgb(r, g, b)),
        }
    }

    /// Contact forces on the links, and forces of arms on sliders, as arrows, with labels where contacts are large or have just begun.
    pub fn of(&self, header: &Header, frame: &Frame, t_ns: u64) -> SceneUpdate {
        let scaled = |force_n: [f64; 2]| force_n.map(|n| n * self.m_per_n);
        let mut arrows = Vec::new();
        for DrawnForce { point_m, force_n, friction_n, .. } in drawn_forces(frame) {
            arrows.push(self.arrow(point_m, scaled(force_n), FORCE));
            if libm::hypot(friction_n[0], friction_n[1]) > SMALLEST_FRICTION * reference_force_n(header) {
                arrows.push(self.arrow(point_m, scaled(friction_n), FRICTION));
            }
        }
        let labels = contact_labels(frame, header, self.label_room_m).into_iter();
        let texts = labels.map(|ContactLabel { point_m, text }| words(point_m, text)).collect();
        let entity = SceneEntity {
            timestamp: timestamp(t_ns),
            frame_id: WORLD.to_string(),
            id: "contact_forces".to_string(),
            arrows,
            texts,
            ..SceneEntity::default()
        };
        SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
    }
}

/// The largest of 1, 2, 3 and 5 times a power of ten that a force reaches.
fn round_force(force_n: f64) -> f64 {
    let power = libm::pow(10.0, libm::floor(libm::log10(force_n)));
    let steps = [5.0, 3.0, 2.0].into_iter().find(|step| force_n >= step * power);
    steps.unwrap_or(1.0) * power
}

/// Text of a fixed size that faces the camera.
fn words([x, y]: [f64; 2], text: String) -> TextPrimitive {
    TextPrimitive {
        pose: Some(Pose { position: Some(Vector3 { x, y, z: LABELS_UP_M }), orientation: Some(about_z(0.0)) }),
        billboard: true,
        font_size: FONT_SIZE,
        scale_invariant: true,
        color: Some(rgb(1.0, 1.0, 1.0)),
        text,
    }
}

fn line(points: &[[f64; 2]], closed: bool, color: Color) -> LinePrimitive {
    let kind = if closed { line_primitive::Type::LineLoop } else { line_primitive::Type::LineStrip };
    LinePrimitive {
        r#type: kind as i32,
        pose: Some(pose(0.0, 0.0, 0.0)),
        thickness: 1.5,
        scale_invariant: true,
        points: points.iter().map(|[x, y]| Point3 { x: *x, y: *y, z: 0.0 }).collect(),
        color: Some(color),
        ..LinePrimitive::default()
    }
}

fn rgb(r: f64, g: f64, b: f64) -> Color {
    Color { r, g, b, a: 1.0 }
}

fn pose(x: f64, y: f64, angle_rad: f64) -> Pose {
    Pose { position: Some(Vector3 { x, y, z: 0.0 }), orientation: Some(about_z(angle_rad)) }
}

fn about_z(angle_rad: f64) -> Quaternion {
    let (z, w) = libm::sincos(0.5 * angle_rad);
    Quaternion { x: 0.0, y: 0.0, z, w }
}

/// Rotation about z from the x-axis to (x, y) of the given `length`, by half-angle formulas without computing the
/// angle.
fn along(x: f64, y: f64, length: f64) -> Quaternion {
    let (cos, sin) = if length > 0.0 { (x / length, y / length) } else { (1.0, 0.0) };
    // The larger of the two roots; the other follows from sin = 2 z w.
    let larger = (0.5 * (1.0 + cos.abs())).sqrt();
    let other = 0.5 * sin / larger;
    let (z, w) = if cos >= 0.0 { (other, larger) } else { (larger.copysign(sin), other.abs()) };
    Quaternion { x: 0.0, y: 0.0, z, w }
}

/// Poses of every link, sprocket and guide as bytes of `foxglove.FrameTransforms`; names are encoded once.
pub struct Transforms {
    names: Vec<Vec<u8>>,
}

impl Transforms {
    pub fn new(header: &Header) -> Transforms {
        let links = (0..header.links.len()).map(|i| format!("link/{i}"));
        let rollers = (0..header.rollers.len()).map(|i| format!("roller/{i}"));
        let bodies = header.bodies.iter().map(|b| b.path.clone());
        let named = |child_frame_id| FrameTransform {
            parent_frame_id: WORLD.to_string(),
            child_frame_id,
            ..FrameTransform::default()
        };
        Transforms { names: links.chain(rollers).chain(bodies).map(|child| named(child).encode_to_vec()).collect() }
    }

    /// Appends the transforms of `frame`.
    pub fn put_bytes(&self, header: &Header, frame: &Frame, t_ns: u64, out: &mut Vec<u8>) {
        let stamp = FrameTransform { timestamp: timestamp(t_ns), ..FrameTransform::default() }.encode_to_vec();
        for (name, (x, y, angle_rad)) in self.names.iter().zip(poses(header, frame)) {
            let Quaternion { z, w, .. } = about_z(angle_rad);
            let len = stamp.len() + name.len() + pair_len(x, y) + pair_len(z, w);
            encode_key(1, WireType::LengthDelimited, out);
            encode_varint(len as u64, out);
            out.extend_from_slice(&stamp);
            out.extend_from_slice(name);
            put_pair(4, [(1, x), (2, y)], out);
            put_pair(5, [(3, z), (4, w)], out);
        }
    }
}

/// Position and heading of every link, then of every roller, which shows no heading, then of every body.
fn poses(header: &Header, frame: &Frame) -> impl Iterator<Item = (f64, f64, f64)> {
    let l = &frame.links;
    let links = l.x_m.iter().zip(&l.y_m).zip(&l.angle_rad).map(|((x, y), angle)| (*x, *y, *angle));
    let bodies = header.bodies.iter().map(|body| {
        let ([x_m, y_m], angle_rad) = body.pose(frame);
        (x_m, y_m, angle_rad)
    });
    let r = &frame.rollers;
    let rollers = r.x_m.iter().zip(&r.y_m).map(|(x, y)| (*x, *y, 0.0));
    links.chain(rollers).chain(bodies)
}

/// Encoded size of a message of two doubles, including its head; zeros are omitted.
fn pair_len(a: f64, b: f64) -> usize {
    2 + 9 * (usize::from(a != 0.0) + usize::from(b != 0.0))
}

/// Encodes such a message; its own tag and those of its values are below 16.
fn put_pair(tag: u8, values: [(u8, f64); 2], out: &mut Vec<u8>) {
    let [(_, a), (_, b)] = values;
    let (mut bytes, len) = ([0; 20], pair_len(a, b));
    bytes[..2].copy_from_slice(&[(tag << 3) | WireType::LengthDelimited as u8, (len - 2) as u8]);
    let mut at = 2;
    for (tag, value) in values.into_iter().filter(|(_, value)| *value != 0.0) {
        bytes[at] = (tag << 3) | WireType::SixtyFourBit as u8;
        bytes[at + 1..at + 9].copy_from_slice(&value.to_le_bytes());
        at += 9;
    }
    out.extend_from_slice(&bytes[..len]);
}

/// An event as a log line, its time first: the panel shows no more of it than milliseconds.
pub fn log(event: &Event, t_ns: u64) -> Log {
    let what = event.text.rsplit_once(", t = ").map_or(event.text.as_str(), |(what, _)| what);
    Log {
        timestamp: timestamp(t_ns),
        level: foxglove::messages::log::Level::Info as i32,
        message: format!("{:.4} ms: {what}", event.t_s * 1e3),
        name: event.kind.clone(),
        ..Log::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::frame::{BodyInfo, LinkInfo, Links, Rotors};

    #[test]
    fn bytes_of_transforms_are_those_of_the_message() {
        let body =
            |path: &str, rotor, x_m| BodyInfo { path: path.into(), rotor, x_m, angle_rad: 0.3, ..BodyInfo::default() };
        let long = "guides.fixed.".repeat(12);
        let header = Header {
            links: vec![LinkInfo::default(); 3],
            bodies: vec![body("sprockets.driver", true, 0.0), body(&long, false, 0.1)],
            ..Header::default()
        };
        let frame = Frame {
            links: Links {
                x_m: vec![0.0, 1.5, -2.0],
                y_m: vec![0.5, 0.0, 0.1],
                angle_rad: vec![0.0, 3.0, -1.0],
                ..Links::default()
            },
            rotors: Rotors { angle_rad: vec![700.0], ..Rotors::default() },
            ..Frame::default()
        };
        for t_ns in [0, 1, 3_000_000_123] {
            let mut bytes = vec![7];
            Transforms::new(&header).put_bytes(&header, &frame, t_ns, &mut bytes);
            let names = ["link/0", "link/1", "link/2", "sprockets.driver", &long];
            let transforms =
                names.into_iter().zip(poses(&header, &frame)).map(|(name, (x, y, angle_rad))| FrameTransform {
                    timestamp: timestamp(t_ns),
                    parent_frame_id: "world".into(),
                    child_frame_id: name.into(),
                    translation: Some(Vector3 { x, y, z: 0.0 }),
                    rotation: Some(about_z(angle_rad)),
                });
            let message = FrameTransforms { transforms: transforms.collect() };
            assert_eq!(bytes[1..], message.encode_to_vec(), "{t_ns} ns");
        }
    }

    #[test]
    fn arrows_point_along_their_forces() {
        for k in -8..=8 {
            let angle = f64::from(k) * std::f64::consts::PI / 8.0;
            let (sin, cos) = angle.sin_cos();
            let (q, expected) = (along(3.0 * cos, 3.0 * sin, 3.0), about_z(angle));
            // q and -q are the same rotation.
            let same = q.z * expected.z + q.w * expected.w;
            assert!((same.abs() - 1.0).abs() < 1e-15 && q.w >= 0.0, "{angle}: {q:?}, not {expected:?}");
        }
        assert_eq!(along(0.0, 0.0, 0.0), about_z(0.0));
    }
}
