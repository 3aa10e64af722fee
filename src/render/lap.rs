//! A number over the way round a loop as SVG: above its mean and range at every place, and one link's own, below its means over place and time.

use super::escape;
use crate::analysis::lap::{Lap, LapZone, PlaceStatistics, ZoneKind};
use crate::recording::palette::{CURVE_COLOURS, hex};
use std::fmt::Write;

/// Page, and the two fields on it [user units]: left, top, width, height.
const PAGE: (f64, f64) = (1040.0, 860.0);
const CURVES: (f64, f64, f64, f64) = (88.0, 44.0, 820.0, 300.0);
const MAP: (f64, f64, f64, f64) = (88.0, 420.0, 820.0, 380.0);
/// Height of the strip that shows the zones, under the curves.
const STRIP: f64 = 14.0;
/// Colours of the map from its lowest mean to its highest: dark blue, white-grey, dark red, alike in lightness to both sides.
const LOW: [f64; 3] = [33.0, 102.0, 172.0];
const MIDDLE: [f64; 3] = [247.0, 247.0, 247.0];
const HIGH: [f64; 3] = [178.0, 24.0, 43.0];

/// The picture. `title`: recording and quantity; `unit`: in brackets.
pub fn svg(title: &str, unit: &str, lap: &Lap) -> String {
    let seen = |p: &&PlaceStatistics| p.samples > 0;
    let ends = lap.places.iter().filter(seen).flat_map(|p| [p.lowest, p.highest]);
    let (low, high) = ends.fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
    let (low, high) = if high > low { (low, high) } else { (low - 1.0, low + 1.0) };
    let x = |place_m: f64| CURVES.0 + CURVES.2 * place_m / lap.length_m;
    let y = |v: f64| CURVES.1 + CURVES.3 * (high - v) / (high - low);
    let mut s = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>\n<text x=\"{}\" y=\"24\" font-size=\"15\">{}</text>\n",
        CURVES.0,
        escape(title),
        w = PAGE.0,
        h = PAGE.1,
    );
    s += &curves(lap, &x, &y);
    s += &upright(CURVES, &format!("{} {unit}", lap.quantity), (low, high));
    s += &strip(&lap.zones, x);
    s += &map(lap, unit);
    for field in [CURVES, MAP] {
        let under = field.1 + field.3 + if field.1 == CURVES.1 { STRIP } else { 0.0 };
        for k in 0..=8 {
            let place_m = lap.length_m * f64::from(k) / 8.0;
            let _infallible = writeln!(
                s,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{:.0}</text>",
                x(place_m),
                under + 16.0,
                1e3 * place_m
            );
        }
        let _infallible = writeln!(
            s,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">place in the direction of travel [mm]</text>",
            field.0 + 0.5 * field.2,
            under + 34.0
        );
    }
    s + "</svg>\n"
}

/// Mean and range of every place, and the way of the link that is followed.
fn curves(lap: &Lap, x: &dyn Fn(f64) -> f64, y: &dyn Fn(f64) -> f64) -> String {
    let mut s = String::new();
    let seen = || lap.places.iter().filter(|p| p.samples > 0);
    for p in seen() {
        let (left, right) = (x(p.from_m), x(p.to_m));
        let _infallible = writeln!(
            s,
            "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#cdd7e6\"/>",
            y(p.highest),
            (right - left).max(0.6),
            (y(p.lowest) - y(p.highest)).max(0.6)
        );
    }
    let means: Vec<(f64, f64)> = seen().map(|p| (x(0.5 * (p.from_m + p.to_m)), y(p.mean))).collect();
    s += &line(&means, CURVE_COLOURS[0], 1.6);
    let mut key = |row: usize, colour: &str, word: &str| {
        let (left, top) = (CURVES.0 + CURVES.2 + 8.0, CURVES.1 + 14.0 + 15.0 * row as f64);
        let _infallible = writeln!(s, "<text x=\"{left:.1}\" y=\"{top:.1}\" fill=\"{colour}\">{word}</text>");
    };
    key(0, &hex(CURVE_COLOURS[0]), "mean");
    key(1, "#8796b0", "range");
    if let Some(link) = lap.link {
        key(2, &hex(CURVE_COLOURS[1]), &format!("link {link}"));
        let own: Vec<(f64, f64)> = lap.points.iter().map(|p| (x(p.place_m), y(p.value))).collect();
        s += &line(&own, CURVE_COLOURS[1], 0.8);
    }
    s
}

/// A line through points; it is not drawn back to the left, where a link begins its next lap.
fn line(points: &[(f64, f64)], colour: [u8; 3], width: f64) -> String {
    let mut d = String::new();
    let mut last = f64::MAX;
    for (x, y) in points {
        let command = if *x < last - 0.5 * CURVES.2 || d.is_empty() { 'M' } else { 'L' };
        let _infallible = write!(d, "{command}{x:.1} {y:.1}");
        last = *x;
    }
    format!("<path d=\"{d}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\"/>\n", hex(colour))
}

/// Zones as a strip under the curves: sprockets dark, guides grey, spans light.
fn strip(zones: &[LapZone], x: impl Fn(f64) -> f64) -> String {
    let mut s = String::new();
    for zone in zones {
        let (left, right) = (x(zone.statistics.from_m), x(zone.statistics.to_m));
        let (fill, ink) = match zone.kind {
            ZoneKind::Sprocket => ("#44546a", "#fff"),
            ZoneKind::Guide => ("#a9b4c4", "#222"),
            ZoneKind::Span => ("#e8ecf2", "#222"),
        };
        let _infallible = writeln!(
            s,
            "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{STRIP}\" fill=\"{fill}\"><title>{}</title></rect>",
            CURVES.1 + CURVES.3,
            right - left,
            escape(&zone.name)
        );
        // So many user units a letter has.
        if right - left > 7.0 * zone.short.len() as f64 {
            let _infallible = writeln!(
                s,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"10\" fill=\"{ink}\">{}</text>",
                0.5 * (left + right),
                CURVES.1 + CURVES.3 + 10.5,
                escape(&zone.short)
            );
        }
    }
    s
}

/// Means over place and time, time downwards, with its scale.
fn map(lap: &Lap, unit: &str) -> String {
    let cells = || lap.map.means.iter().flatten().flatten();
    let (low, high) = cells().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    let range = if high > low { high - low } else { 1.0 };
    let (from_s, to_s) = (lap.from_s, lap.to_s);
    let y = |t_s: f64| MAP.1 + MAP.3 * (t_s - from_s) / (to_s - from_s).max(1e-300);
    let mut s = String::new();
    for (row, times) in lap.map.means.iter().zip(lap.map.times_s.windows(2)) {
        let width = MAP.2 / row.len() as f64;
        for (k, mean) in row.iter().enumerate() {
            let Some(mean) = mean else { continue };
            let _infallible = writeln!(
                s,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"/>",
                MAP.0 + width * k as f64,
                y(times[0]),
                width + 0.3,
                (y(times[1]) - y(times[0])).max(0.6) + 0.3,
                shade((mean - low) / range)
            );
        }
    }
    s += &upright(MAP, "time [ms], downwards", (1e3 * to_s, 1e3 * from_s));
    let left = MAP.0 + MAP.2 + 14.0;
    let _infallible = writeln!(s, "<text x=\"{left}\" y=\"{:.1}\">mean {}</text>", MAP.1 - 8.0, escape(unit));
    for k in 0..40 {
        let share = f64::from(k) / 39.0;
        let _infallible = writeln!(
            s,
            "<rect x=\"{left}\" y=\"{:.1}\" width=\"16\" height=\"{:.1}\" fill=\"{}\"/>",
            MAP.1 + 200.0 * (1.0 - share),
            200.0 / 39.0 + 0.3,
            shade(share)
        );
    }
    for (v, share) in [(low, 0.0), (low + 0.5 * range, 0.5), (low + range, 1.0)] {
        let _infallible = writeln!(
            s,
            "<text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            left + 22.0,
            MAP.1 + 200.0 * (1.0 - share) + 6.0,
            short(v)
        );
    }
    s
}

fn shade(share: f64) -> String {
    let (from, to, part) = if share < 0.5 { (LOW, MIDDLE, 2.0 * share) } else { (MIDDLE, HIGH, 2.0 * share - 1.0) };
    let mixed = |k: usize| (from[k] + (to[k] - from[k]) * part.clamp(0.0, 1.0)).round() as u8;
    hex([mixed(0), mixed(1), mixed(2)])
}

/// The border of a field, and its upright axis.
fn upright((left, top, width, height): (f64, f64, f64, f64), words: &str, (low, high): (f64, f64)) -> String {
    let mut s = format!(
        "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#99a\"/>\n"
    );
    for k in 0..=5 {
        let share = f64::from(k) / 5.0;
        let _infallible = writeln!(
            s,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            left - 6.0,
            top + height * (1.0 - share) + 4.0,
            short(low + (high - low) * share)
        );
    }
    let middle = top + 0.5 * height;
    let _infallible = writeln!(
        s,
        "<text x=\"16\" y=\"{middle:.1}\" transform=\"rotate(-90 16 {middle:.1})\" text-anchor=\"middle\">{}</text>",
        escape(words)
    );
    s
}

/// Three digits or so.
fn short(v: f64) -> String {
    match v.abs() {
        0.0 => "0".to_string(),
        size if (100.0..100_000.0).contains(&size) => format!("{v:.0}"),
        size if (1.0..100.0).contains(&size) => format!("{v:.1}"),
        size if (0.01..1.0).contains(&size) => format!("{v:.3}"),
        _ => format!("{v:.2e}"),
    }
}
