//! Merges several recordings into one: the drives lie one above the other in one scene, frame by frame at the same
//! instant.
//!
//! Links, bodies and columns are concatenated and indices shifted accordingly. All runs have the same step and the same
//! frames, and their drivers the same speed, so that equal times mean equal crank angles.

use crate::recording::frame::{Event, Frame, Header, Impact};
use crate::recording::view_geometry::scene_bounds;

/// Gap between two drives [m].
const ROOM_M: f64 = 30e-3;

/// Numbering of one run in the merged recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RunNumbering {
    name: String,
    first_link: u32,
    /// New index of each body, and of each coordinate.
    bodies: Vec<u32>,
    coordinates: Vec<usize>,
    /// Downward shift [m].
    down_m: f64,
}

/// The merged header, and the numbering of each run in it.
pub fn headers(name: &str, runs: &[&Header]) -> (Header, Vec<RunNumbering>) {
    // Sensors appear only in the runs' own recordings.
    let mut merged = Header { drive_name: name.to_string(), sensors: Vec::new(), ..runs[0].clone() };
    (merged.links, merged.link_outlines, merged.bodies) = (Vec::new(), Vec::new(), Vec::new());
    (merged.overrides, merged.assembly) = (Vec::new(), Vec::new());
    merged.drive_text = String::new();
    let rotors: usize = runs.iter().map(|h| h.bodies.iter().filter(|b| b.rotor).count()).sum();
    let (mut next_rotor, mut next_other) = (0, rotors);
    merged.coordinates.clear();
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
        merged.link_outlines.extend(header.link_outlines.iter().map(|o| {
            let mut outline = o.clone();
            outline.name = format!("{short} {}", o.name);
            outline
        }));
        let first = merged.coordinates.len();
        let coordinates: Vec<usize> = (first..first + header.coordinates.len()).collect();
        merged.coordinates.extend(header.coordinates.iter().map(|path| format!("{short}.{path}")));
        let mut numbers = Vec::new();
        for body in &header.bodies {
            let next = if body.rotor { &mut next_rotor } else { &mut next_other };
            let mut placed = body.clone();
            placed.path = format!("{short}.{}", body.path);
            placed.y_m -= down_m;
            placed.coordinate = body.coordinate.map(|q| coordinates[q as usize] as u32);
            bodies[*next] = Some(placed);
            numbers.push(*next as u32);
            *next += 1;
        }
        parts.push(RunNumbering { name: short.clone(), first_link, bodies: numbers, coordinates, down_m });
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
    let total: usize = frames.iter().map(|f| f.rotors.angle_rad.len()).sum();
    let r = &mut merged.rotors;
    for column in [&mut r.angle_rad, &mut r.speed_rad_s, &mut r.chain_torque_nm, &mut r.outer_torque_nm] {
        column.resize(total, 0.0);
    }
    for (part, frame) in parts.iter().zip(frames) {
        merged.state_hash = merged.state_hash.rotate_left(1) ^ frame.state_hash;
        let l = &frame.links;
        merged.links.x_m.extend_from_slice(&l.x_m);
        merged.links.y_m.extend(l.y_m.iter().map(|y| y - part.down_m));
        merged.links.angle_rad.extend_from_slice(&l.angle_rad);
        merged.links.vx_m_s.extend_from_slice(&l.vx_m_s);
        merged.links.vy_m_s.extend_from_slice(&l.vy_m_s);
        merged.links.omega_rad_s.extend_from_slice(&l.omega_rad_s);
        merged.links.ax_m_s2.extend_from_slice(&l.ax_m_s2);
        merged.links.ay_m_s2.extend_from_slice(&l.ay_m_s2);
        merged.links.alpha_rad_s2.extend_from_slice(&l.alpha_rad_s2);
        merged.joints.force_x_n.extend_from_slice(&frame.joints.force_x_n);
        merged.joints.force_y_n.extend_from_slice(&frame.joints.force_y_n);
        merged.joints.friction_torque_nm.extend_from_slice(&frame.joints.friction_torque_nm);
        for k in 0..frame.rotors.angle_rad.len() {
            let to = part.coordinates[k];
            merged.rotors.angle_rad[to] = frame.rotors.angle_rad[k];
            merged.rotors.speed_rad_s[to] = frame.rotors.speed_rad_s[k];
            merged.rotors.chain_torque_nm[to] = frame.rotors.chain_torque_nm[k];
            merged.rotors.outer_torque_nm[to] = frame.rotors.outer_torque_nm[k];
        }
        add_contacts(&mut merged, part, frame);
        add_energy(&mut merged, frame);
    }
    merged
}

fn add_contacts(merged: &mut Frame, part: &RunNumbering, frame: &Frame) {
    let (to, from) = (&mut merged.contacts, &frame.contacts);
    to.link.extend(from.link.iter().map(|l| l + part.first_link));
    to.body.extend(from.body.iter().map(|b| part.bodies[*b as usize]));
    to.feature.extend_from_slice(&from.feature);
    to.tooth.extend_from_slice(&from.tooth);
    to.segment.extend_from_slice(&from.segment);
    to.stick.extend_from_slice(&from.stick);
    for (to, from) in [(&mut to.point_body_y_m, &from.point_body_y_m), (&mut to.point_link_y_m, &from.point_link_y_m)] {
        to.extend(from.iter().map(|y| y - part.down_m));
    }
    for (to, from) in [
        (&mut to.point_body_x_m, &from.point_body_x_m),
        (&mut to.point_link_x_m, &from.point_link_x_m),
        (&mut to.normal_x, &from.normal_x),
        (&mut to.normal_y, &from.normal_y),
        (&mut to.penetration_m, &from.penetration_m),
        (&mut to.approach_speed_m_s, &from.approach_speed_m_s),
        (&mut to.normal_speed_m_s, &from.normal_speed_m_s),
        (&mut to.tangential_speed_m_s, &from.tangential_speed_m_s),
        (&mut to.normal_force_n, &from.normal_force_n),
        (&mut to.tangential_force_n, &from.tangential_force_n),
        (&mut to.age_s, &from.age_s),
        (&mut to.instant_force_n, &from.instant_force_n),
    ] {
        to.extend_from_slice(from);
    }
}

fn add_energy(merged: &mut Frame, frame: &Frame) {
    let (to, from) = (&mut merged.energy, &frame.energy);
    to.kinetic_j += from.kinetic_j;
    to.elastic_joint_j += from.elastic_joint_j;
    to.elastic_contact_j += from.elastic_contact_j;
    to.work_in_j += from.work_in_j;
    to.work_out_j += from.work_out_j;
    to.lost_pin_damping_j += from.lost_pin_damping_j;
    to.lost_pin_friction_j += from.lost_pin_friction_j;
    to.lost_contact_damping_j += from.lost_contact_damping_j;
    to.lost_contact_friction_j += from.lost_contact_friction_j;
    to.lost_guide_damping_j += from.lost_guide_damping_j;
    to.lost_guide_friction_j += from.lost_guide_friction_j;
    to.elastic_spring_j += from.elastic_spring_j;
    to.lost_spring_damping_j += from.lost_spring_damping_j;
    to.error_j += from.error_j;
}

/// Converts an event of one run to the merged recording.
pub fn event(part: &RunNumbering, event: &Event) -> Event {
    Event {
        link: event.link + part.first_link,
        body: part.bodies.get(event.body as usize).copied().unwrap_or(event.body),
        text: format!("{}: {}", part.name, event.text),
        ..event.clone()
    }
}

/// Converts an impact of one run to the merged recording.
pub fn impact(part: &RunNumbering, impact: &Impact) -> Impact {
    Impact {
        link: impact.link + part.first_link,
        body: part.bodies.get(impact.body as usize).copied().unwrap_or(impact.body),
        y_m: impact.y_m - part.down_m,
        ..*impact
    }
}
