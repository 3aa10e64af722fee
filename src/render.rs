//! Drawings as SVG: exact contours, arcs as arcs.

pub mod silent;

use crate::geometry::profile::{Element, Profile};
use crate::geometry::sprocket::Sprocket;
use std::fmt::Write;

/// Path data of a profile in millimetres, y up.
fn path_data(profile: &Profile) -> String {
    let mut d = String::new();
    let mm = |v: f64| (v * 1e9).round() / 1e6;
    let start = profile.elements()[0].start();
    let _infallible = write!(d, "M{} {}", mm(start.x), mm(start.y));
    for element in profile.elements() {
        let end = element.end();
        let _infallible = match *element {
            Element::Line { .. } => write!(d, "L{} {}", mm(end.x), mm(end.y)),
            Element::Arc { radius_m, sweep_rad, .. } => write!(
                d,
                "A{r} {r} 0 {large} {sweep} {} {}",
                mm(end.x),
                mm(end.y),
                r = mm(radius_m),
                large = u8::from(sweep_rad.abs() > std::f64::consts::PI),
                sweep = u8::from(sweep_rad > 0.0)
            ),
        };
    }
    if profile.is_closed() {
        d.push('Z');
    }
    d
}

/// A sprocket with its pitch circle and one seated bush.
pub fn sprocket_svg(sprocket: &Sprocket, profile: &Profile) -> String {
    let edge = sprocket.tip_radius_m * 1e3 * 1.08;
    let pitch = sprocket.pitch_radius_m * 1e3;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{m} {m} {w} {w}\" width=\"800\" height=\"800\">\n\
         <g transform=\"scale(1 -1)\" fill=\"none\" stroke-width=\"{s}\">\n\
         <path d=\"{d}\" fill=\"#d8dce2\" stroke=\"#223\"/>\n\
         <circle r=\"{pitch}\" stroke=\"#a33\" stroke-dasharray=\"1 1\"/>\n\
         <circle cx=\"{pitch}\" r=\"{bush}\" stroke=\"#27c\"/>\n\
         <circle r=\"{bore}\" fill=\"#fff\" stroke=\"#223\"/>\n</g>\n\
         <text x=\"{tx}\" y=\"{ty}\" font-size=\"{fs}\" font-family=\"sans-serif\">z = {z}, p = {p} mm, d1 = {d1} mm, {form:?} gap form</text>\n</svg>\n",
        m = -edge,
        w = 2.0 * edge,
        s = edge / 400.0,
        d = path_data(profile),
        bush = sprocket.spec.roller_diameter_m * 500.0,
        bore = sprocket.root_radius_m * 1e3 * 0.4,
        tx = -edge * 0.98,
        ty = edge * 0.98,
        fs = edge / 22.0,
        z = sprocket.spec.teeth,
        p = sprocket.spec.pitch_m * 1e3,
        d1 = sprocket.spec.roller_diameter_m * 1e3,
        form = sprocket.spec.form,
    )
}
