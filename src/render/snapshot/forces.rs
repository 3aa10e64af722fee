//! Forces as arrows to scale, and their numbers.

use super::contours::link_pose;
use super::labels::{OccupiedPlaces, Rect, take_place_beside};
use super::{DrawingSheet, FORCE, JOINT_FORCE, NUMBERED_PITCH, Panel, pitch_m, push_number, round_below};
use crate::recording::frame::{Contacts, Frame, Impact};
use crate::recording::view_geometry::{DrawnForce, drawn_forces};
use std::fmt::Write;

/// Length of the largest contact force as a fraction of the panel's shorter side.
const LARGEST_CONTACT: f64 = 0.17;
/// Length of the largest joint force [pitches], so that arrows of neighbours do not overlap.
const LARGEST_JOINT: f64 = 0.8;
/// Length of the shortest arrow with numbers [user units]; below, a dot marks the contact.
const MIN_NUMBERED: f64 = 0.8;

/// Contact point on the body and force on the link of contact `i`: [m], [N].
fn contact(c: &Contacts, i: usize) -> ([f64; 2], [f64; 2]) {
    let (nx, ny) = (c.normal_x[i], c.normal_y[i]);
    let (n, t) = (c.normal_force_n[i], c.tangential_force_n[i]);
    ([c.point_body_x_m[i], c.point_body_y_m[i]], [n * nx - t * ny, n * ny + t * nx])
}

/// Position of joint `j`, and its force on link `j + 1`: [m], [N].
fn joint(sheet: &DrawingSheet, frame: &Frame, j: usize) -> ([f64; 2], [f64; 2]) {
    let at = link_pose(frame, j).apply([0.5 * sheet.header.links[j].pitch_m, 0.0]);
    (at, [frame.joints.force_x_n[j], frame.joints.force_y_n[j]])
}

/// Contact point of the largest contact force on body `k` [m]; None if it has no contact.
pub fn most_loaded_point_m(frame: &Frame, k: usize) -> Option<[f64; 2]> {
    let c = &frame.contacts;
    (0..c.body.len())
        .filter(|i| c.body[*i] as usize == k)
        .max_by(|a, b| c.normal_force_n[*a].total_cmp(&c.normal_force_n[*b]))
        .map(|i| contact(c, i).0)
}

/// User units per newton for contacts, from the largest force in any panel; None if all are zero.
pub fn contact_scale(sheet: &DrawingSheet, frames: &[&Frame], panels: &[Panel]) -> Option<f64> {
    let mut largest_n = 0.0_f64;
    for (frame, panel) in frames.iter().zip(panels) {
        for DrawnForce { point_m, force_n: force, .. } in drawn_forces(frame) {
            if panel.sees(point_m, 0.0) {
                largest_n = largest_n.max(libm::hypot(force[0], force[1]));
            }
        }
    }
    let side = panels[0].width.min(panels[0].height);
    // At most a pitch and a half in a close-up, at least a pitch in a full view.
    let length = (LARGEST_CONTACT * side).min(1.5 * sheet.pitch().max(30.0));
    (largest_n > 0.0).then(|| length / largest_n)
}

/// Round force above which contacts have their numbers [N]; None if no contact has.
pub fn least_numbered_n(sheet: &DrawingSheet) -> Option<f64> {
    let units_per_n = sheet.contact_units_per_n.filter(|_| sheet.pitch() >= NUMBERED_PITCH)?;
    Some(round_below(MIN_NUMBERED / units_per_n))
}

/// User units per newton for joints.
pub fn joint_scale(sheet: &DrawingSheet, frames: &[&Frame], panels: &[Panel]) -> Option<f64> {
    let mut largest_n = 0.0_f64;
    for (frame, panel) in frames.iter().zip(panels) {
        for j in 0..frame.joints.force_x_n.len() {
            let (at, force) = joint(sheet, frame, j);
            if panel.sees(at, pitch_m(sheet.header)) {
                largest_n = largest_n.max(libm::hypot(force[0], force[1]));
            }
        }
    }
    (largest_n > 0.0).then(|| LARGEST_JOINT * sheet.pitch() / largest_n)
}

/// Tail and tip of a force at a point of the world, on the page.
fn shaft(panel: &Panel, at: [f64; 2], force: [f64; 2], units_per_n: f64) -> [[f64; 2]; 2] {
    let tail = panel.on_page(at);
    [tail, [tail[0] + force[0] * units_per_n, tail[1] - force[1] * units_per_n]]
}

/// Forces in the visible joints.
pub fn push_joints(svg: &mut String, sheet: &DrawingSheet, frame: &Frame, panel: &Panel, taken: &mut OccupiedPlaces) {
    let Some(units_per_n) = sheet.joint_units_per_n else { return };
    for j in 0..frame.joints.force_x_n.len() {
        let (at, force) = joint(sheet, frame, j);
        if panel.sees(at, pitch_m(sheet.header)) {
            let line = shaft(panel, at, force, units_per_n);
            push_arrow(svg, "joint", line, JOINT_FORCE);
            taken.strokes.push(line);
        }
    }
}

/// Visible contacts and tips of sliders: a dot at the contact point, and the force on the link or the slider from there.
pub fn push_contacts(svg: &mut String, sheet: &DrawingSheet, frame: &Frame, panel: &Panel, taken: &mut OccupiedPlaces) {
    let dot = (0.03 * sheet.pitch()).clamp(1.2, 2.6);
    for DrawnForce { point_m: foot, force_n: force, .. } in drawn_forces(frame) {
        if !panel.sees(foot, pitch_m(sheet.header)) {
            continue;
        }
        let line = shaft(panel, foot, force, sheet.contact_units_per_n.unwrap_or(0.0));
        let [x, y] = line[0];
        let _infallible = writeln!(svg, "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{dot:.2}\" fill=\"{FORCE}\"/>");
        push_arrow(svg, "contact", line, FORCE);
        taken.strokes.push(line);
    }
}

/// Link, force and penetration beside every arrow, the largest first; without room the small ones are left out.
pub fn push_contact_numbers(
    svg: &mut String,
    sheet: &DrawingSheet,
    frame: &Frame,
    panel: &Panel,
    taken: &mut OccupiedPlaces,
) {
    let Some(least_n) = least_numbered_n(sheet) else { return };
    let c = &frame.contacts;
    let size = 0.88 * sheet.font;
    let mut order: Vec<usize> = (0..c.link.len()).filter(|i| panel.sees(contact(c, *i).0, 0.0)).collect();
    order.sort_by(|a, b| c.normal_force_n[*b].total_cmp(&c.normal_force_n[*a]));
    for i in order {
        let (foot, force) = contact(c, i);
        let force_n = libm::hypot(force[0], force[1]);
        if force_n < least_n {
            continue;
        }
        let line = shaft(panel, foot, force, sheet.contact_units_per_n.unwrap_or(0.0));
        let mut lines = vec![format!("{}: {} N", c.link[i], digits(force_n)), depth_text(c.penetration_m[i])];
        lines.extend(impact_of(sheet, frame, i).map(|impact| format!("peak {} N", digits(impact.peak_force_n))));
        if let Some(place) = take_place_beside(taken, Rect::around_text(&lines, size, line[1]), line) {
            push_leader(svg, line[1], &place);
            push_number(svg, &place, size, FORCE, &lines);
        }
    }
}

/// The impact that is still observed in contact `i`.
fn impact_of<'a>(sheet: &DrawingSheet<'a>, frame: &Frame, i: usize) -> Option<&'a Impact> {
    let c = &frame.contacts;
    sheet.options.impacts.iter().find(|impact| {
        let part = (impact.link, impact.feature, impact.body) == (c.link[i], c.feature[i], c.body[i]);
        part && (impact.step..).contains(&frame.step) && frame.t_s <= impact.t_s + impact.watched_s
    })
}

/// A thin line to a number that is away from its arrow.
fn push_leader(svg: &mut String, tip: [f64; 2], place: &Rect) {
    let edge = [0, 1].map(|k| tip[k].clamp(place.centre[k] - place.half[k], place.centre[k] + place.half[k]));
    if libm::hypot(edge[0] - tip[0], edge[1] - tip[1]) > 8.0 {
        let _infallible = writeln!(
            svg,
            "<path d=\"M{:.2} {:.2}L{:.2} {:.2}\" stroke=\"{FORCE}\" stroke-width=\"0.6\" stroke-opacity=\"0.7\"/>",
            tip[0], tip[1], edge[0], edge[1]
        );
    }
}

/// An arrow from tail to tip. The fourth point of its outline is the tip; its tail lies between the first and the last.
pub fn push_arrow(svg: &mut String, class: &str, [tail, tip]: [[f64; 2]; 2], colour: &str) {
    let run = [tip[0] - tail[0], tip[1] - tail[1]];
    let length = libm::hypot(run[0], run[1]);
    // Shorter than its line width: the dot at the contact point represents it.
    if length < 0.5 {
        return;
    }
    let along = [run[0] / length, run[1] / length];
    let head = (0.55 * length).min(9.0);
    let (half_shaft, half_head) = (0.085 * head, 0.36 * head);
    let mut data = String::new();
    for (k, (forward, left)) in [
        (0.0, half_shaft),
        (length - head, half_shaft),
        (length - head, half_head),
        (length, 0.0),
        (length - head, -half_head),
        (length - head, -half_shaft),
        (0.0, -half_shaft),
    ]
    .into_iter()
    .enumerate()
    {
        let x = tail[0] + forward * along[0] - left * along[1];
        let y = tail[1] + forward * along[1] + left * along[0];
        let _infallible = write!(data, "{}{x:.3} {y:.3}", if k == 0 { 'M' } else { 'L' });
    }
    let _infallible = writeln!(svg, "<path class=\"{class}\" d=\"{data}Z\" fill=\"{colour}\"/>");
}

/// Two or three significant digits, no exponent.
fn digits(v: f64) -> String {
    match v.abs() {
        a if a >= 99.95 => format!("{v:.0}"),
        a if a >= 9.995 => format!("{v:.1}"),
        a if a >= 0.0995 => format!("{v:.2}"),
        a if a >= 0.0005 => format!("{v:.3}"),
        _ => "< 0.001".to_string(),
    }
}

/// Overlap of two contours, or their gap: a contact may exert force shortly before or after the drawn instant.
fn depth_text(penetration_m: f64) -> String {
    let apart = if penetration_m > 0.0 { "" } else { " apart" };
    format!("{} \u{b5}m{apart}", digits(penetration_m.abs() * 1e6))
}
