//! Limits of a header, checked before it is decoded and again on its content: a few bytes of a file must not cause
//! gigabytes of allocation, and code that draws or counts teeth relies on its numbers.

#![warn(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::cast_possible_truncation)]

use super::frame::Header;
use anyhow::{Context, ensure};
use prost::Message;

/// Maximum number of rows of each kind. The longest engine chains have some 300 links; no drive file makes a tenth of
/// these.
const MOST_ROWS: usize = 20_000;
/// Maximum number of elements and circles of all outlines together.
const MOST_ELEMENTS: usize = 500_000;
/// Maximum number of teeth of a sprocket: drive files allow fewer.
const MOST_TEETH: u32 = 10_000;

/// Repeated fields of [`Header`] by tag, and for those that contain an outline its tag.
const REPEATED: [(u64, &str); 14] = [
    (5, "overrides"),
    (8, "links"),
    (9, "outlines"),
    (10, "bodies"),
    (11, "channels"),
    (14, "lines of assembly"),
    (17, "sensors"),
    (18, "coordinates"),
    (19, "sliders"),
    (20, "touches"),
    (21, "chambers"),
    (22, "passages"),
    (23, "rollers"),
    (24, "spans"),
];
const LINK_OUTLINES: u64 = 9;
const BODIES: u64 = 10;
const OUTLINE_OF_BODY: u64 = 7;
const ELEMENTS: u64 = 2;
const CIRCLES: u64 = 4;

/// Decodes a header. Errors name the exceeded limit or invalid value.
pub fn decode(bytes: &[u8]) -> anyhow::Result<Header> {
    count(bytes)?;
    let header = Header::decode(bytes).context("its header cannot be read")?;
    check(&header)?;
    Ok(header)
}

/// Counts rows without allocating them.
fn count(bytes: &[u8]) -> anyhow::Result<()> {
    let mut rows = [0_usize; REPEATED.len()];
    let mut elements = 0_usize;
    each_field(bytes, |tag, content| {
        for (rows, (_, name)) in rows.iter_mut().zip(REPEATED).filter(|(_, (t, _))| *t == tag) {
            *rows += 1;
            ensure!(*rows <= MOST_ROWS, "its header holds more than {MOST_ROWS} {name}");
        }
        let mut outline = |outline: &[u8]| {
            each_field(outline, |tag, _| {
                elements += usize::from(tag == ELEMENTS || tag == CIRCLES);
                ensure!(elements <= MOST_ELEMENTS, "its header draws more than {MOST_ELEMENTS} lines and arcs");
                Ok(())
            })
        };
        match tag {
            LINK_OUTLINES => outline(content),
            BODIES => {
                each_field(content, |tag, content| if tag == OUTLINE_OF_BODY { outline(content) } else { Ok(()) })
            }
            _ => Ok(()),
        }
    })
}

/// Calls `f` with tag and content of every length-delimited field of a protobuf message; other fields are skipped.
fn each_field(mut bytes: &[u8], mut f: impl FnMut(u64, &[u8]) -> anyhow::Result<()>) -> anyhow::Result<()> {
    let cut = "its header is cut off";
    while !bytes.is_empty() {
        let key = varint(&mut bytes).context(cut)?;
        let length = match key & 7 {
            0 => {
                varint(&mut bytes).context(cut)?;
                continue;
            }
            1 => 8,
            2 => usize::try_from(varint(&mut bytes).context(cut)?).context(cut)?,
            5 => 4,
            kind => anyhow::bail!("its header holds a field of kind {kind}"),
        };
        let (content, rest) = bytes.split_at_checked(length).context(cut)?;
        bytes = rest;
        if key & 7 == 2 {
            f(key >> 3, content)?;
        }
    }
    Ok(())
}

fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0_u64;
    for shift in (0..64).step_by(7) {
        let (first, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u64::from(first & 0x7f) << shift;
        if first & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

/// Checks numbers that readers rely on.
fn check(header: &Header) -> anyhow::Result<()> {
    ensure!(!header.links.is_empty(), "its chain has no links");
    ensure!(header.step_s.is_finite() && header.step_s > 0.0, "its header states a step of {} s", header.step_s);
    let outlines = header.link_outlines.len();
    for (i, link) in header.links.iter().enumerate() {
        ensure!((link.outline as usize) < outlines, "link {i} has outline {} of {outlines}", link.outline);
        ensure!((link.ahead as usize) < header.links.len(), "link {i} is followed by link {}", link.ahead);
    }
    for roller in &header.rollers {
        let place = roller.joint.max(roller.link) as usize;
        ensure!(place < header.links.len(), "its header has a roller on joint {}", roller.joint);
        let drawn = [roller.radius_m, roller.bore_radius_m].iter().all(|r| r.is_finite());
        ensure!(drawn, "its header gives the roller of joint {} no radius", roller.joint);
    }
    let mut rotors_end = false;
    for body in &header.bodies {
        ensure!(body.teeth <= MOST_TEETH, "its header gives {} {} teeth", body.path, body.teeth);
        let limits = body.low_stop.iter().chain(&body.high_stop);
        let placed = [body.x_m, body.y_m, body.angle_rad].iter().chain(limits).all(|v| v.is_finite());
        ensure!(placed, "its header gives {} no place", body.path);
        ensure!(!(body.rotor && rotors_end), "its header has a sprocket, {}, behind a guide", body.path);
        rotors_end |= !body.rotor;
        let known = body.coordinate.is_none_or(|q| (q as usize) < header.coordinates.len());
        ensure!(known, "its header lets {} turn by a coordinate that there is not", body.path);
        let mut rows = body.slider.into_iter().chain(body.shifts.iter().map(|s| s.slider));
        let known = rows.all(|q| (q as usize) < header.sliders.len());
        ensure!(known, "its header lets {} slide by a coordinate that there is not", body.path);
    }
    let outlines = || header.link_outlines.iter().chain(header.bodies.iter().filter_map(|b| b.outline.as_ref()));
    let drawn = outlines().all(|o| {
        let elements = o.elements.iter().all(|e| {
            let e =
                [e.start_x_m, e.start_y_m, e.end_x_m, e.end_y_m, e.centre_x_m, e.centre_y_m, e.radius_m, e.sweep_rad];
            e.iter().all(|v| v.is_finite())
        });
        elements && o.circles.iter().all(|c| [c.x_m, c.y_m, c.radius_m].iter().all(|v| v.is_finite()))
    });
    ensure!(drawn, "its header has an outline with invalid numbers");
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;
    use crate::recording::frame::{BodyInfo, LinkInfo, Outline, OutlineElement};

    fn header() -> Header {
        Header {
            step_s: 1e-6,
            links: vec![LinkInfo::default()],
            link_outlines: vec![Outline::default()],
            ..Header::default()
        }
    }

    #[test]
    fn what_is_in_bounds_comes_back() {
        let mut header = header();
        let outline = Outline { elements: vec![OutlineElement::default(); 7], ..Outline::default() };
        header.bodies.push(BodyInfo { rotor: true, teeth: 20, outline: Some(outline), ..BodyInfo::default() });
        assert_eq!(decode(&header.encode_to_vec()).unwrap(), header);
    }

    #[test]
    fn a_few_bytes_become_no_gigabytes() {
        let refused = |header: Header| format!("{:#}", decode(&header.encode_to_vec()).unwrap_err());
        let many = Header { bodies: vec![BodyInfo::default(); MOST_ROWS + 1], ..header() };
        assert!(refused(many).contains("more than 20000 bodies"));
        let outline = Outline { elements: vec![OutlineElement::default(); MOST_ELEMENTS + 1], ..Outline::default() };
        assert!(refused(Header { link_outlines: vec![outline], ..header() }).contains("lines and arcs"));
        let teeth = BodyInfo { path: "sprockets.a".into(), teeth: u32::MAX, ..BodyInfo::default() };
        assert!(refused(Header { bodies: vec![teeth], ..header() }).contains("4294967295 teeth"));
        let outline = LinkInfo { outline: 1, ..LinkInfo::default() };
        assert!(refused(Header { links: vec![outline], ..header() }).contains("outline 1 of 1"));
        assert!(decode(&[0x42, 0xff, 0xff, 0xff, 0xff, 0x0f]).is_err());
    }
}
