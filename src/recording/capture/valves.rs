//! Cams and valves in headers: what is drawn of them. The file gives the lift, the base circle and the roller; stem and head are a picture's.

use super::outline_element;
use crate::drive::Drive;
use crate::drive::lifters::LifterSpec;
use crate::drive::valves::ValveSpec;
use crate::geometry::profile::Element;
use crate::geometry::{Vec2, perp, rotated, unit};
use crate::model::Model;
use crate::pairs::part_part::CamTouch;
use crate::recording::frame::{BodyInfo, BodyKind, Outline, OutlineCircle};
use std::f64::consts::PI;

/// Corners of a cam's contour as it is drawn.
const CORNERS: u32 = 180;
/// Length of a stem and half the width of a head, in base radii. assumed
const STEM: f64 = 4.0;
const HEAD: f64 = 1.0;
/// Half the width of a stem, in base radii.
const THIN: f64 = 0.15;

/// A cam and its valve for every one that a drive has.
pub(super) fn bodies(drive: &Drive, model: &Model) -> Vec<BodyInfo> {
    let specs = drive.valves.iter().flat_map(|spec| (0..spec.phases_rad.len()).map(move |n| (spec, n)));
    specs
        .zip(model.cams())
        .flat_map(|((spec, number), cam)| {
            let lifter = spec.lifter.as_ref().map(|lifter| lifter_body(spec, (lifter, number), (model, cam)));
            [cam_body(spec, number, cam), valve_body(spec, number, (model, cam))].into_iter().chain(lifter)
        })
        .collect()
}

fn cam_body(spec: &ValveSpec, number: usize, cam: &CamTouch) -> BodyInfo {
    // Where follower and cam touch, carried back to where the coordinate is zero.
    let corner = |i: u32| {
        let turn_rad = 2.0 * PI * f64::from(i % CORNERS) / f64::from(CORNERS);
        rotated(cam.gap(0.0, turn_rad).point - cam.axis, -turn_rad)
    };
    let side = |i: u32| outline_element(&Element::Line { start: corner(i), end: corner(i + 1) });
    let path = spec.path(number);
    BodyInfo {
        // Not below its valve: viewers move what lies below a body with it.
        path: path.replacen("valves.", "cams.", 1),
        coordinate: Some(cam.shaft as u32),
        x_m: cam.axis.x,
        y_m: cam.axis.y,
        kind: BodyKind::Cam as u32,
        outline: Some(Outline {
            name: format!("cam of {path}"),
            elements: (0..CORNERS).map(side).collect(),
            closed: true,
            ..Outline::default()
        }),
        ..BodyInfo::default()
    }
}

/// Half the width of a follower: a flat one is as wide as the way of its touch [m].
fn follower_half_m(spec: &ValveSpec) -> f64 {
    let thin_m = THIN * spec.base_m;
    if spec.roller_m.is_some() {
        return thin_m;
    }
    spec.law.sweep(200).map(|a| spec.law.at(a).slope_m.abs()).fold(thin_m, f64::max) + thin_m
}

/// Where the follower begins while the valve is closed: the origin of valves and lifters.
fn place(spec: &ValveSpec, cam: &CamTouch) -> Vec2 {
    cam.axis + unit(spec.direction_rad) * (spec.base_m + spec.lash_m)
}

/// Where a lifter ends and the stem of its valve begins, in that frame [m].
fn lifter_end_m(spec: &ValveSpec, lifter: &LifterSpec) -> f64 {
    spec.roller_m.unwrap_or(0.0) + THIN * spec.base_m + 0.5 * lifter.bore_m
}

fn closed_outline(name: String, corners: &[Vec2], roller_m: Option<f64>) -> Outline {
    let next = |i: usize| corners[(i + 1) % corners.len()];
    let side = |(i, start): (usize, &Vec2)| outline_element(&Element::Line { start: *start, end: next(i) });
    Outline {
        name,
        elements: corners.iter().enumerate().map(side).collect(),
        circles: roller_m.map(|r| OutlineCircle { x_m: r, y_m: 0.0, radius_m: r }).into_iter().collect(),
        closed: true,
    }
}

/// A cup that is open towards the valve.
fn lifter_body(
    spec: &ValveSpec,
    (lifter, number): (&LifterSpec, usize),
    (model, cam): (&Model, &CamTouch),
) -> BodyInfo {
    let thin_m = THIN * spec.base_m;
    let (start, end) = (spec.roller_m.unwrap_or(0.0), lifter_end_m(spec, lifter));
    let (bore_half_m, half_m) = (0.5 * lifter.bore_m, follower_half_m(spec).max(0.5 * lifter.bore_m + thin_m));
    let corners = [
        Vec2::new(start, half_m),
        Vec2::new(start, -half_m),
        Vec2::new(end, -half_m),
        Vec2::new(end, -bore_half_m),
        Vec2::new(start + thin_m, -bore_half_m),
        Vec2::new(start + thin_m, bore_half_m),
        Vec2::new(end, bore_half_m),
        Vec2::new(end, half_m),
    ];
    let (at, path) = (place(spec, cam), format!("{}.lifter", spec.path(number)));
    BodyInfo {
        slider: Some((cam.follower - model.n_turning()) as u32),
        x_m: at.x,
        y_m: at.y,
        angle_rad: spec.direction_rad,
        kind: BodyKind::Valve as u32,
        outline: Some(closed_outline(path.clone(), &corners, spec.roller_m)),
        // Not below its valve: viewers move what lies below a body with it.
        path: path.replacen("valves.", "lifters.", 1),
        ..BodyInfo::default()
    }
}

/// Its frame has its origin where the closed valve's follower begins, and its x-axis along the lift.
fn valve_body(spec: &ValveSpec, number: usize, (model, cam): (&Model, &CamTouch)) -> BodyInfo {
    let (stem_m, head_m, thin_m) = (STEM * spec.base_m, HEAD * spec.base_m, THIN * spec.base_m);
    let (start, half_m) = match &spec.lifter {
        None => (spec.roller_m.unwrap_or(0.0), follower_half_m(spec)),
        // A plunger in the lifter.
        Some(lifter) => (lifter_end_m(spec, lifter) - 0.25 * lifter.bore_m, 0.5 * lifter.bore_m),
    };
    let across = perp(Vec2::new(1.0, 0.0));
    let at = |along: f64, aside: f64| Vec2::new(along, 0.0) + across * aside;
    let corners = [
        at(start, half_m),
        at(start, -half_m),
        at(start + thin_m, -half_m),
        at(start + thin_m, -thin_m),
        at(stem_m - thin_m, -thin_m),
        at(stem_m, -head_m),
        at(stem_m, head_m),
        at(stem_m - thin_m, thin_m),
        at(start + thin_m, thin_m),
        at(start + thin_m, half_m),
    ];
    let (at, path) = (place(spec, cam), spec.path(number));
    let roller_m = spec.roller_m.filter(|_| spec.lifter.is_none());
    BodyInfo {
        slider: Some((cam.valve - model.n_turning()) as u32),
        x_m: at.x,
        y_m: at.y,
        angle_rad: spec.direction_rad,
        kind: BodyKind::Valve as u32,
        low_stop: Some(0.0),
        outline: Some(closed_outline(path.clone(), &corners, roller_m)),
        path,
        ..BodyInfo::default()
    }
}
