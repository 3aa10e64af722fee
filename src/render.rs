//! Drawings as SVG: exact contours, arcs as arcs.

pub mod claims;
pub mod compare;
pub mod free_body;
pub mod identify;
pub mod lap;
pub mod orders;
pub mod png;
pub mod silent;
pub mod snapshot;
pub mod spectrum;
pub mod study;

use crate::geometry::profile::{Element, Profile, ProfileError};
use crate::geometry::smartchain::{Abutment, LobedRing};
use crate::geometry::sprocket::Sprocket;
use std::fmt::Write;

/// Text as XML holds it, control characters as spaces.
fn escape(text: &str) -> String {
    let shown: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    shown.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

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

/// A sprocket's ring with its pitch circle, the guide, the path of a joint, and links at every pitch with their
/// abutments; beside it a second sprocket's lobed ring. Approach frame: the chain arrives along +x on top.
pub fn smartchain_svg(abutment: &Abutment, ring: Option<&LobedRing>) -> Result<String, ProfileError> {
    let t = &abutment.transition;
    let (front, rear) = (path_data(&abutment.front.profile()?), path_data(&abutment.rear.profile()?));
    let mm = 1e3;
    let joint = t.pitch_m * mm * 0.08;
    let mut links = String::new();
    for k in -2..=3 {
        let (a, b) = t.joints(f64::from(k) + 0.5);
        let middle = (a.position + b.position) * (0.5 * mm);
        // Link frame to drawing: the sprocket lies at +y of the link.
        let _infallible = write!(
            links,
            "<g transform=\"translate({} {}) rotate({}) scale(1 -1)\"><path d=\"{front}\" stroke=\"#c30\"/>\
             <path d=\"{rear}\" stroke=\"#960\"/><path d=\"M{} 0L{} 0\" stroke=\"#27c\"/></g>\n\
             <circle cx=\"{}\" cy=\"{}\" r=\"{joint}\" stroke=\"#27c\"/>\n",
            middle.x,
            middle.y,
            -t.link(f64::from(k) + 0.5).turn_rad / crate::units::DEG,
            -0.5 * t.pitch_m * mm,
            0.5 * t.pitch_m * mm,
            b.position.x * mm,
            b.position.y * mm,
        );
    }
    let steps = 300;
    let path: Vec<String> = (0..=steps)
        .map(|k| t.pin(-3.0 + 7.0 * f64::from(k) / f64::from(steps)).position * mm)
        .map(|p| format!("{:.6},{:.6}", p.x, p.y))
        .collect();
    let reach = (t.pitch_radius_m + t.pitch_m) * mm * 1.15;
    let (lobes, width) = match ring {
        None => (String::new(), 2.0 * reach),
        Some(ring) => {
            let second = ring.transition.pitch_radius_m * mm * 1.1;
            let data = path_data(&ring.profile()?);
            let lobes = format!(
                "<g transform=\"translate({} 0)\"><path d=\"{data}\" fill=\"#d8dce2\" stroke=\"#223\"/>\
                 <circle r=\"{}\" stroke=\"#a33\" stroke-dasharray=\"1 1\"/></g>\n",
                reach + second,
                ring.transition.pitch_radius_m * mm
            );
            (lobes, 2.0 * (reach + second))
        }
    };
    let height = 2.0 * reach.max(0.5 * width - reach);
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{left} {top} {width} {height}\" width=\"1000\">\n\
         <g transform=\"scale(1 -1)\" fill=\"none\" stroke-width=\"{stroke}\">\n\
         <circle r=\"{rho}\" fill=\"#d8dce2\" stroke=\"#223\"/>\n\
         <circle r=\"{pitch}\" stroke=\"#a33\" stroke-dasharray=\"1 1\"/>\n\
         <path d=\"M{left} {face}L0 {face}\" stroke=\"#083\"/>\n\
         <polyline points=\"{points}\" stroke=\"#a3a\"/>\n{links}{lobes}</g>\n\
         <text x=\"{tx}\" y=\"{ty}\" font-size=\"{fs}\" font-family=\"sans-serif\">z = {z}, p = {p} mm, a = {a} mm</text>\n</svg>\n",
        left = -reach,
        top = -0.5 * height,
        stroke = reach / 500.0,
        rho = abutment.ring_radius_m * mm,
        face = (t.line_height_m - abutment.guide_height_m) * mm,
        pitch = t.pitch_radius_m * mm,
        points = path.join(" "),
        tx = -reach * 0.98,
        ty = 0.49 * height,
        fs = reach / 22.0,
        z = t.teeth,
        p = t.pitch_m * mm,
        a = abutment.distance_m() * mm,
    ))
}
