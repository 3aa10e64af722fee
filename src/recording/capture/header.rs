//! The header of a run: links, bodies and what is drawn of them.

use super::super::frame::{
    BodyInfo, BodyKind, BodyShift, Channel, FORMAT_VERSION, Header, LinkInfo, Outline, OutlineCircle, OutlineElement,
    RollerInfo, SensorInfo,
};
use super::{mechanism, valves};
use crate::assemble::AssemblyReport;
use crate::drive::Drive;
use crate::elements::body_frame::{BodyFrame, Shift};
use crate::geometry::Vec2;
use crate::geometry::profile::{Element, Profile};
use crate::model::Model;
use crate::pairs::contour_body::EndShape;

/// The header of a run.
pub fn header(drive: &Drive, model: &Model, report: &AssemblyReport, steps_per_frame: u64) -> Header {
    header_of(drive, model, report.static_mean_tension_n, report.lines(), steps_per_frame)
}

/// As [`header`], for a run that goes on from a recorded State.
pub fn header_of(
    drive: &Drive,
    model: &Model,
    static_tension_n: f64,
    assembly: Vec<String>,
    steps_per_frame: u64,
) -> Header {
    let mut header = Header {
        format_version: FORMAT_VERSION,
        program: concat!("pitchline ", env!("CARGO_PKG_VERSION")).to_string(),
        drive_name: drive.name.clone(),
        drive_text: drive.text.clone(),
        overrides: drive.overrides.clone(),
        step_s: model.step_s,
        steps_per_frame,
        links: model
            .chain
            .links()
            .map(|i| LinkInfo {
                outline: model.row_of(i) as u32,
                ahead: model.chain.number_of(model.chain.next(i)) as u32,
                pitch_m: 2.0 * model.chain.lever[i],
                mass_kg: model.chain.mass[i],
                inertia_kg_m2: model.chain.inertia[i],
            })
            .collect(),
        link_outlines: model
            .rows
            .iter()
            .enumerate()
            .map(|(k, r)| {
                // Of several chains each has rows of the same names.
                let chain = model.row_ranges.iter().position(|rows| rows.contains(&k)).unwrap_or(0);
                let own = drive.chain_names.get(chain).map_or(String::new(), |name| format!("{name} "));
                outline(&format!("{own}{}", r.name), &r.plate, &r.circles)
            })
            .collect(),
        bodies: bodies(drive, model),
        rollers: roller_infos(model),
        channels: crate::recording::frame::channels()
            .map(|c| Channel { name: c.channel.into(), unit: c.unit.into(), meaning: c.meaning.into() })
            .collect(),
        chain_speed_m_s: model.chain_speed_m_s(),
        static_tension_n,
        assembly,
        parent: None,
        ledger_origin: None,
        coordinates: model.coordinates[..model.n_turning()].iter().map(|c| c.path.clone()).collect(),
        sensors: drive
            .sensors
            .iter()
            .map(|s| SensorInfo { path: s.path.clone(), unit: s.reads.unit().to_string() })
            .collect(),
        ..Header::default()
    };
    mechanism::name_rows(model, &mut header);
    header
}

/// Rollers that are bodies of their own.
fn roller_infos(model: &Model) -> Vec<RollerInfo> {
    let c = &model.chain;
    let of = |lane: usize| {
        let shape = c.roller_shapes[c.loop_of(lane)]?;
        Some(RollerInfo {
            joint: c.number_of(c.joint_of(lane)) as u32,
            link: c.number_of(c.bush_carrier(lane).0) as u32,
            radius_m: shape.radius_m,
            bore_radius_m: shape.bush_radius_m + shape.clearance_m,
            mass_kg: c.mass[lane],
            inertia_kg_m2: c.inertia[lane],
        })
    };
    c.all_rollers().filter_map(of).collect()
}

/// Sprockets, guides, rails, then what no chain touches.
pub fn bodies(drive: &Drive, model: &Model) -> Vec<BodyInfo> {
    let mut bodies: Vec<BodyInfo> = model
        .sprockets
        .iter()
        .enumerate()
        .map(|(k, s)| BodyInfo {
            path: format!("sprockets.{}", s.name),
            rotor: true,
            coordinate: Some(s.coordinate as u32),
            x_m: s.frame.origin.x,
            y_m: s.frame.origin.y,
            shifts: shifts(model, &s.frame),
            angle_rad: 0.0,
            teeth: s.geometry.teeth(),
            kind: BodyKind::Sprocket as u32,
            outline: s.geometry.profile().map(|p| outline(&s.name, &p, &sprocket_circles(model, k))),
            ..BodyInfo::default()
        })
        .collect();
    bodies.extend(model.guides.iter().map(|g| BodyInfo {
        path: format!("guides.fixed.{}", g.name),
        kind: BodyKind::Guide as u32,
        x_m: g.geometry.origin.x,
        y_m: g.geometry.origin.y,
        angle_rad: g.geometry.angle_rad(),
        shifts: shifts(model, &g.frame),
        outline: g.geometry.profile().ok().map(|p| outline(&g.name, &p, &[])),
        ..BodyInfo::default()
    }));
    bodies.extend(model.rails.iter().map(|r| BodyInfo {
        path: format!("guides.rail.{}", r.name),
        kind: BodyKind::Rail as u32,
        coordinate: r.frame.turn.map(|q| q as u32),
        x_m: r.frame.origin.x,
        y_m: r.frame.origin.y,
        shifts: shifts(model, &r.frame),
        outline: Some(outline(&r.name, &r.rail.profile, &[])),
        ..BodyInfo::default()
    }));
    bodies.extend(mechanism::bodies(drive, model));
    bodies.extend(valves::bodies(drive, model));
    bodies.extend(mechanism::chains_of_spans(drive, model));
    bodies
}

/// What shifts a frame, by the rows of `Sliders`.
fn shifts(model: &Model, frame: &BodyFrame) -> Vec<BodyShift> {
    let of = |s: &Shift| BodyShift {
        slider: (s.coordinate - model.n_turning()) as u32,
        direction_x: s.direction.x,
        direction_y: s.direction.y,
    };
    frame.shifts.iter().map(of).collect()
}

/// Bore, and the ring of an abutment chain: the circle its lobes stand on, which rise from it by some 60 um.
fn sprocket_circles(model: &Model, k: usize) -> Vec<(Vec2, f64)> {
    let mut circles = vec![(Vec2::zeros(), 0.4 * model.sprockets[k].geometry.root_radius_m())];
    for body in model.end_bodies.iter().filter(|b| b.body == k) {
        match &body.shape {
            EndShape::Circle { radius_m } => circles.push((Vec2::zeros(), *radius_m)),
            EndShape::Lobes { ring, .. } => circles.push((Vec2::zeros(), ring.valley_radius_m)),
            EndShape::Face { .. } | EndShape::OuterFlanks { .. } | EndShape::InnerFlanks { .. } => {}
        }
    }
    circles
}

fn outline(name: &str, profile: &Profile, circles: &[(Vec2, f64)]) -> Outline {
    let elements = profile.elements().iter().map(outline_element).collect();
    Outline {
        name: name.to_string(),
        elements,
        closed: profile.is_closed(),
        circles: circles
            .iter()
            .map(|(c, radius_m)| OutlineCircle { x_m: c.x, y_m: c.y, radius_m: *radius_m })
            .collect(),
    }
}

pub(super) fn outline_element(e: &Element) -> OutlineElement {
    let (start, end) = (e.start(), e.end());
    let (centre, radius_m, sweep_rad) = match *e {
        Element::Line { .. } => (Vec2::zeros(), 0.0, 0.0),
        Element::Arc { centre, radius_m, sweep_rad, .. } => (centre, radius_m, sweep_rad),
    };
    OutlineElement {
        start_x_m: start.x,
        start_y_m: start.y,
        end_x_m: end.x,
        end_y_m: end.y,
        centre_x_m: centre.x,
        centre_y_m: centre.y,
        radius_m,
        sweep_rad,
    }
}
