//! Merges several recordings into one: the drives lie one above the other in one scene, frame by frame at the same
//! instant.
//!
//! Links, bodies and columns are concatenated and indices shifted accordingly. All runs have the same step and the same
//! frames, and their drivers the same speed, so that equal times mean equal crank angles.

use crate::recording::columns::{Column, ColumnKind, ValuesMut};
use crate::recording::frame::{Event, Frame, Header, Impact};
use crate::recording::view_geometry::scene_bounds;

/// Gap between two drives [m].
const ROOM_M: f64 = 30e-3;

/// Numbering of one run in the merged recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RunNumbering {
    name: String,
    first_link: u32,
    /// New index of each body.
    bodies: Vec<u32>,
    /// Downward shift [m].
    down_m: f64,
}

/// The merged header, and the numbering of each run in it.
pub fn headers(name: &str, runs: &[&Header]) -> (Header, Vec<RunNumbering>) {
    // Sensors appear only in the runs' own recordings.
    let mut merged = Header { drive_name: name.to_string(), sensors: Vec::new(), ..runs[0].clone() };
    (merged.links, merged.link_outlines, merged.bodies) = (Vec::new(), Vec::new(), Vec::new());
    (merged.overrides, merged.assembly, merged.rollers) = (Vec::new(), Vec::new(), Vec::new());
    merged.drive_text = String::new();
    let rotors: usize = runs.iter().map(|h| h.bodies.iter().filter(|b| b.rotor).count()).sum();
    let (mut next_rotor, mut next_other) = (0, rotors);
    for rows in [
        &mut merged.coordinates,
        &mut merged.sliders,
        &mut merged.touches,
        &mut merged.chambers,
        &mut merged.passages,
        &mut merged.spans,
    ] {
        rows.clear();
    }
    let mut bodies = vec![None; runs.iter().map(|h| h.bodies.len()).sum()];
    let mut parts = Vec::new();
    let mut bottom_m: Option<f64> = None;
    let first_word = |h: &Header| h.drive_name.split(['-', '.']).next().unwrap_or("drive").to_string();
    for (index, header) in runs.iter().enumerate() {
        // Drives with the same first word are distinguished by their number.
        let word = first_word(header);
        let alone = runs.iter().filter(|h| first_word(h) == word).count() == 1;
        let short = if alone { word } else { format!("{word} {}", index + 1) };
        let (low, high) = scene_bounds(header);
        let down_m = bottom_m.map_or(0.0, |bottom| high[1] + ROOM_M - bottom);
        bottom_m = Some(low[1] - down_m);
        let first_outline = merged.link_outlines.len() as u32;
        let first_link = merged.links.len() as u32;
        merged.links.extend(header.links.iter().map(|l| {
            let mut link = *l;
            link.outline += first_outline;
            link.ahead += first_link;
            link
        }));
        merged.rollers.extend(header.rollers.iter().map(|r| {
            let mut roller = *r;
            roller.joint += first_link;
            roller.link += first_link;
            roller
        }));
        merged.link_outlines.extend(header.link_outlines.iter().map(|o| {
            let mut outline = o.clone();
            outline.name = format!("{short} {}", o.name);
            outline
        }));
        let (first, first_slider) = (merged.coordinates.len() as u32, merged.sliders.len() as u32);
        for (rows, own) in [
            (&mut merged.coordinates, &header.coordinates),
            (&mut merged.sliders, &header.sliders),
            (&mut merged.touches, &header.touches),
            (&mut merged.chambers, &header.chambers),
            (&mut merged.passages, &header.passages),
            (&mut merged.spans, &header.spans),
        ] {
            rows.extend(own.iter().map(|path| format!("{short}.{path}")));
        }
        let mut numbers = Vec::new();
        for body in &header.bodies {
            let next = if body.rotor { &mut next_rotor } else { &mut next_other };
            let mut placed = body.clone();
            placed.path = format!("{short}.{}", body.path);
            placed.y_m -= down_m;
            placed.coordinate = body.coordinate.map(|q| first + q);
            placed.slider = body.slider.map(|q| first_slider + q);
            placed.shifts.iter_mut().for_each(|shift| shift.slider += first_slider);
            bodies[*next] = Some(placed);
            numbers.push(*next as u32);
            *next += 1;
        }
        parts.push(RunNumbering { name: short.clone(), first_link, bodies: numbers, down_m });
        merged.drive_text += &format!("# ---- {}\n{}\n", header.drive_name, header.drive_text);
        merged.overrides.extend(header.overrides.iter().map(|o| format!("{short}: {o}")));
        merged.assembly.extend(header.assembly.iter().map(|a| format!("{short}: {a}")));
    }
    merged.bodies = bodies.into_iter().flatten().collect();
    (merged, parts)
}

/// One frame of all runs.
pub fn frames(parts: &[RunNumbering], frames: &[&Frame]) -> Frame {
    let mut merged = Frame { step: frames[0].step, t_s: frames[0].t_s, ..Frame::default() };
    merged.crank_angle_rad = frames[0].crank_angle_rad;
    for (part, frame) in parts.iter().zip(frames) {
        merged.state_hash = merged.state_hash.rotate_left(1) ^ frame.state_hash;
        let mut placed = (*frame).clone();
        placed.each_table_mut(|table, columns| part.place(table.message.columns, columns));
        merged.append_rows(&placed);
        merged.energy.each_with(&frame.energy, |_, sum, value| sum + value);
    }
    merged
}

impl RunNumbering {
    /// Gives columns or fields of one run their numbers and places in the merged recording.
    fn place(&self, columns: &[Column], values: &mut [ValuesMut<'_>]) {
        for (column, values) in columns.iter().zip(values) {
            match column.kind {
                ColumnKind::Link => values.each_u32(|link| *link += self.first_link),
                ColumnKind::Body => {
                    values.each_u32(|body| *body = self.bodies.get(*body as usize).copied().unwrap_or(*body))
                }
                ColumnKind::Height => values.each_f64(|y_m| *y_m -= self.down_m),
                ColumnKind::Value | ColumnKind::Feature | ColumnKind::Segment => {}
                ColumnKind::Kinetic
                | ColumnKind::Elastic
                | ColumnKind::WorkIn
                | ColumnKind::WorkOut
                | ColumnKind::Lost
                | ColumnKind::Error => {}
            }
        }
    }
}

/// Converts an event of one run to the merged recording.
pub fn event(part: &RunNumbering, event: &Event) -> Event {
    let mut placed = event.clone();
    part.place(Event::MESSAGE.columns, &mut placed.values_mut());
    placed.text = format!("{}: {}", part.name, event.text);
    placed
}

/// Converts an impact of one run to the merged recording.
pub fn impact(part: &RunNumbering, impact: &Impact) -> Impact {
    let mut placed = *impact;
    part.place(Impact::MESSAGE.columns, &mut placed.values_mut());
    placed
}
