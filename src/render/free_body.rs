//! A free-body diagram: one link, and every force on it as an arrow at its point of action, with its magnitude.

use super::escape;
use super::snapshot::contours::{Pose, body_pose, circle_data, mm, path_data};
use super::snapshot::{push_arrow, round_below};
use crate::analysis::explain::{Force, FreeBody};
use crate::recording::frame::{Frame, Header};
use std::fmt::Write;

/// Page [user units].
const WIDTH: f64 = 940.0;
const HEIGHT: f64 = 600.0;
/// Where the link is drawn: left, top, width, height [user units]; its scales are below, the table is beside.
const FIELD: [f64; 4] = [16.0, 56.0, 590.0, 480.0];
const TABLE_LEFT: f64 = 624.0;
/// Share of the field's width that a pitch takes.
const PITCH_SHARE: f64 = 0.39;
/// Longest arrow [user units].
const LONGEST_ARROW: f64 = 150.0;
/// Forces smaller than this fraction of the largest have no arrow.
const SMALLEST_SHARE: f64 = 0.004;
/// Colour of mass times acceleration.
const INERTIA: &str = "#0a7a5c";

/// The diagram as SVG; `frame` tells where the bodies stand that touch the link.
pub fn svg(header: &Header, body: &FreeBody, frame: &Frame) -> String {
    let [left, top, width, height] = FIELD;
    let pitch_mm = header.links.get(body.link).map_or(8.0, |l| l.pitch_m * 1e3);
    let units_per_mm = PITCH_SHARE * width / pitch_mm;
    let largest = body.forces.iter().map(size).fold(0.0, f64::max).max(1e-9);
    let units_per_n = LONGEST_ARROW / largest;
    let centre = [left + 0.5 * width, top + 0.5 * height];
    let page = |x_m: f64, y_m: f64| {
        [centre[0] + mm(x_m - body.x_m) * units_per_mm, centre[1] - mm(y_m - body.y_m) * units_per_mm]
    };
    let mut s = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n\
         <clipPath id=\"field\"><rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\"/></clipPath>\n\
         <g clip-path=\"url(#field)\">\n"
    );
    s.push_str(&contours(header, body, frame, (centre, units_per_mm)));
    for (number, force) in body.forces.iter().enumerate().filter(|(_, f)| size(f) > SMALLEST_SHARE * largest) {
        let at = page(force.x_m, force.y_m);
        let tip = [at[0] + force.fx_n * units_per_n, at[1] - force.fy_n * units_per_n];
        push_arrow(&mut s, force.kind, [at, tip], colour(force));
        push_label(&mut s, [at, tip], &(number + 1).to_string(), colour(force));
    }
    let inertia_n = [body.mass_kg * body.acceleration_x_m_s2, body.mass_kg * body.acceleration_y_m_s2];
    let tip = [centre[0] + inertia_n[0] * units_per_n, centre[1] - inertia_n[1] * units_per_n];
    push_arrow(&mut s, "inertia", [centre, tip], INERTIA);
    push_label(&mut s, [centre, tip], "m a", INERTIA);
    let _infallible = writeln!(
        s,
        "</g>\n<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#aab\" stroke-width=\"0.8\"/>"
    );
    s.push_str(&scales(units_per_mm, units_per_n));
    s.push_str(&table(header, body));
    s.push_str("</svg>\n");
    s
}

/// The bodies that touch the link, and the link over them, y up.
fn contours(header: &Header, body: &FreeBody, frame: &Frame, (centre, units_per_mm): ([f64; 2], f64)) -> String {
    let mut s = format!(
        "<g transform=\"translate({} {}) scale({units_per_mm} {})\" stroke-width=\"{}\">\n",
        centre[0],
        centre[1],
        -units_per_mm,
        1.2 / units_per_mm
    );
    let pixels_per_m = units_per_mm * 1e3;
    let touched = |path: &str| body.contacts.iter().any(|c| c.body == path);
    for (k, info) in header.bodies.iter().enumerate().filter(|(_, info)| touched(&info.path)) {
        let Some(outline) = &info.outline else { continue };
        let stands = body_pose(header, frame, k);
        let pose = Pose { x_m: stands.x_m - body.x_m, y_m: stands.y_m - body.y_m, ..stands };
        let data = path_data(outline, pose, pixels_per_m);
        let _infallible = writeln!(s, "<path d=\"{data}\" fill=\"#e4e5e8\" stroke=\"#555\"/>");
    }
    let own = header.links.get(body.link).and_then(|l| header.link_outlines.get(l.outline as usize));
    if let Some(outline) = own {
        let pose = Pose { x_m: 0.0, y_m: 0.0, angle_rad: body.angle_rad };
        let data = path_data(outline, pose, pixels_per_m);
        let _infallible =
            writeln!(s, "<g fill=\"#dfe6f0\" fill-opacity=\"0.55\" stroke=\"#345\">\n<path d=\"{data}\"/>");
        for circle in &outline.circles {
            let data = circle_data(circle, pose, pixels_per_m);
            let _infallible = writeln!(s, "<path d=\"{data}\" fill=\"#fff\" fill-opacity=\"0.4\"/>");
        }
        s.push_str("</g>\n");
    }
    s + "</g>\n"
}

/// A word beyond the tip of an arrow.
fn push_label(s: &mut String, [at, tip]: [[f64; 2]; 2], text: &str, colour: &str) {
    let away = [tip[0] - at[0], tip[1] - at[1]];
    let length = libm::hypot(away[0], away[1]).max(1.0);
    let place = [tip[0] + 12.0 * away[0] / length, tip[1] + 12.0 * away[1] / length + 4.0];
    let _infallible = writeln!(
        s,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"{colour}\" stroke=\"#fff\" stroke-width=\"3\" \
         paint-order=\"stroke\">{text}</text>",
        place[0], place[1]
    );
}

/// How long a millimetre and a newton are drawn, and what the colours are.
fn scales(units_per_mm: f64, units_per_n: f64) -> String {
    let (left, y) = (FIELD[0], FIELD[1] + FIELD[3] + 24.0);
    let bar_mm = round_below(110.0 / units_per_mm);
    let bar = bar_mm * units_per_mm;
    let shown_n = round_below(110.0 / units_per_n);
    let mut s = format!(
        "<path class=\"length\" d=\"M{left} {y}h{bar:.2}m0 -4v8m{:.2} -8v8\" stroke=\"#223\" fill=\"none\"/>\
         <text x=\"{:.1}\" y=\"{:.1}\">{bar_mm} mm</text>\n",
        -bar,
        left + bar + 8.0,
        y + 4.0
    );
    let mut x = left + bar + 80.0;
    let kinds = [("joint", "joints"), ("contact normal", "contacts"), ("friction", "friction")];
    for (kind, words) in
        kinds.map(|(kind, words)| (colour_of(kind), words)).into_iter().chain([(INERTIA, "mass times acceleration")])
    {
        let is_first = x < left + bar + 81.0;
        let length = if is_first { shown_n * units_per_n } else { 26.0 };
        push_arrow(&mut s, "scale", [[x, y], [x + length, y]], kind);
        let words = if is_first { format!("{shown_n} N; {words}") } else { words.to_string() };
        let _infallible = writeln!(s, "<text x=\"{:.1}\" y=\"{:.1}\">{words}</text>", x + length + 6.0, y + 4.0);
        x += length + 24.0 + 7.0 * words.len() as f64;
    }
    s
}

fn size(f: &Force) -> f64 {
    libm::hypot(f.fx_n, f.fy_n)
}

fn colour(f: &Force) -> &'static str {
    colour_of(f.kind)
}

fn colour_of(kind: &str) -> &'static str {
    match kind {
        "joint" => "#1f5fa8",
        "contact normal" => "#c0261c",
        _ => "#b06a00",
    }
}

/// Table of the forces, their sum, and mass times acceleration.
fn table(header: &Header, b: &FreeBody) -> String {
    let (left, top, line) = (TABLE_LEFT, 40.0, 17.0);
    let mut s = format!(
        "<text x=\"20\" y=\"{top}\" font-size=\"16\">{}: link {} at {:.6} ms</text>\n",
        escape(&header.drive_name),
        b.link,
        b.t_s * 1e3
    );
    let mut y = top;
    let mut put = |text: &str, colour: &str| {
        let _infallible = writeln!(s, "<text x=\"{left}\" y=\"{y}\" fill=\"{colour}\">{}</text>", escape(text));
        y += line;
    };
    for (number, f) in b.forces.iter().enumerate() {
        let size = if f.kind == "pin friction" {
            format!("{:.1} mN m", f.moment_nm * 1e3)
        } else {
            format!("{:.1} N", size(f))
        };
        put(&format!("{}  {size}", number + 1), colour(f));
        for piece in broken(&f.cause) {
            put(&piece, "#555");
        }
    }
    put("", "#000");
    put(&format!("sum  {:.2} N, {:.3} mN m", libm::hypot(b.sum_x_n, b.sum_y_n), b.sum_moment_nm * 1e3), "#000");
    let inertia = b.mass_kg * libm::hypot(b.acceleration_x_m_s2, b.acceleration_y_m_s2);
    let turning = b.inertia_kg_m2 * b.angular_acceleration_rad_s2;
    put(&format!("m a  {inertia:.2} N, {:.3} mN m", turning * 1e3), "#000");
    put(&format!("remainder {:.0e} of the largest force", b.remainder_share), "#000");
    s
}

/// Breaks text into lines of some forty letters.
fn broken(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let last = lines.last_mut().filter(|l| l.len() + word.len() < 38);
        match last {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) => {
                line.push(' ');
                line.push_str(word);
            }
            None => lines.push(word.to_string()),
        }
    }
    lines.iter().map(|l| format!("    {l}")).collect()
}
