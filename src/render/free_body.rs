//! A free-body diagram: one link, and every force on it as an arrow at its point of action, with its magnitude.

use super::escape;
use super::snapshot::contours::{Pose, circle_data, mm, path_data};
use crate::analysis::explain::{Force, FreeBody};
use crate::recording::frame::Header;
use std::fmt::Write;

/// Page [user units].
const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 560.0;
/// Longest arrow [user units].
const LONGEST_ARROW: f64 = 150.0;
/// Forces smaller than this fraction of the largest have no arrow.
const SMALLEST_SHARE: f64 = 0.004;

/// The diagram as SVG.
pub fn svg(header: &Header, body: &FreeBody) -> String {
    let outline = header.links.get(body.link).and_then(|l| header.link_outlines.get(l.outline as usize));
    let pitch_mm = header.links.get(body.link).map_or(8.0, |l| l.pitch_m * 1e3);
    let units_per_mm = 0.22 * WIDTH / pitch_mm;
    let pose = Pose { x_m: 0.0, y_m: 0.0, angle_rad: body.angle_rad };
    let largest = body.forces.iter().map(size).fold(0.0, f64::max).max(1e-9);
    let units_per_n = LONGEST_ARROW / largest;
    let mut s = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n"
    );
    let centre = [0.33 * WIDTH, 0.5 * HEIGHT];
    let page = |x_mm: f64, y_mm: f64| [centre[0] + x_mm * units_per_mm, centre[1] - y_mm * units_per_mm];
    if let Some(outline) = outline {
        let _infallible = write!(
            s,
            "<g transform=\"translate({} {}) scale({units_per_mm} {})\" fill=\"#dfe6f0\" stroke=\"#345\" stroke-width=\"{}\">\n\
             <path d=\"{}\"/>",
            centre[0],
            centre[1],
            -units_per_mm,
            1.2 / units_per_mm,
            path_data(outline, pose, units_per_mm * 1e3)
        );
        for circle in &outline.circles {
            let _infallible =
                write!(s, "<path d=\"{}\" fill=\"#fff\"/>", circle_data(circle, pose, units_per_mm * 1e3));
        }
        s.push_str("</g>\n");
    }
    for (number, force) in body.forces.iter().enumerate().filter(|(_, f)| size(f) > SMALLEST_SHARE * largest) {
        let at = page(mm(force.x_m - body.x_m), mm(force.y_m - body.y_m));
        let tip = [at[0] + force.fx_n * units_per_n, at[1] - force.fy_n * units_per_n];
        super::snapshot::push_arrow(&mut s, force.kind, [at, tip], colour(force));
        let away = [tip[0] - at[0], tip[1] - at[1]];
        let length = away[0].hypot(away[1]).max(1.0);
        let label = [tip[0] + 12.0 * away[0] / length, tip[1] + 12.0 * away[1] / length + 4.0];
        let _infallible = writeln!(
            s,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"{}\">{}</text>",
            label[0],
            label[1],
            colour(force),
            number + 1
        );
    }
    s.push_str(&table(header, body));
    s.push_str("</svg>\n");
    s
}

fn size(f: &Force) -> f64 {
    f.fx_n.hypot(f.fy_n)
}

fn colour(f: &Force) -> &'static str {
    match f.kind {
        "joint" => "#1f5fa8",
        "contact normal" => "#c0261c",
        _ => "#b06a00",
    }
}

/// Table of the forces, their sum, and mass times acceleration.
fn table(header: &Header, b: &FreeBody) -> String {
    let (left, top, line) = (0.68 * WIDTH, 40.0, 17.0);
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
    put(&format!("sum  {:.2} N, {:.3} mN m", b.sum_x_n.hypot(b.sum_y_n), b.sum_moment_nm * 1e3), "#000");
    let inertia = b.mass_kg * b.acceleration_x_m_s2.hypot(b.acceleration_y_m_s2);
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
