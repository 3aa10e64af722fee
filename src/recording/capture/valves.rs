//! Cams and valves in headers: what is drawn of them. The file gives the lift, the base circle and the roller; stem and head are a picture's.

use super::outline_element;
use crate::drive::Drive;
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
        .flat_map(|((spec, number), cam)| [cam_body(spec, number, cam), valve_body(spec, number, (model, cam))])
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

/// Its frame has its origin where the closed valve's follower begins, and its x-axis along the lift.
fn valve_body(spec: &ValveSpec, number: usize, (model, cam): (&Model, &CamTouch)) -> BodyInfo {
    let direction = unit(spec.direction_rad);
    let (stem_m, head_m, thin_m) = (STEM * spec.base_m, HEAD * spec.base_m, THIN * spec.base_m);
    // A flat follower is as wide as the way of its touch.
    let widest = spec.law.sweep(200).map(|a| spec.law.at(a).slope_m.abs()).fold(thin_m, f64::max) + thin_m;
    let (start, half_m) = match spec.roller_m {
        None => (0.0, widest),
        Some(r) => (r, thin_m),
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
    let next = |i: usize| corners[(i + 1) % corners.len()];
    let side = |(i, start): (usize, &Vec2)| outline_element(&Element::Line { start: *start, end: next(i) });
    let place = cam.axis + direction * (spec.base_m + spec.lash_m);
    let path = spec.path(number);
    BodyInfo {
        slider: Some((cam.follower - model.n_turning()) as u32),
        x_m: place.x,
        y_m: place.y,
        angle_rad: spec.direction_rad,
        kind: BodyKind::Valve as u32,
        low_stop: Some(0.0),
        outline: Some(Outline {
            name: path.clone(),
            elements: corners.iter().enumerate().map(side).collect(),
            circles: spec.roller_m.map(|r| OutlineCircle { x_m: r, y_m: 0.0, radius_m: r }).into_iter().collect(),
            closed: true,
        }),
        path,
        ..BodyInfo::default()
    }
}
