//! Orders over a run-up as SVG: above every window's spectrum over speed and frequency (Campbell), below the tracked orders over the speed.

use super::escape;
use crate::analysis::order_tracks::OrderTracks;
use crate::recording::palette::{CURVE_COLOURS, hex};
use std::fmt::Write;

/// Page, and the two fields on it [user units]: left, top, width, height.
const PAGE: (f64, f64) = (960.0, 860.0);
const CAMPBELL: (f64, f64, f64, f64) = (84.0, 44.0, 760.0, 420.0);
const TRACKS: (f64, f64, f64, f64) = (84.0, 520.0, 760.0, 280.0);
/// Decades of amplitude from white to black.
const DECADES: f64 = 2.5;
/// Most cells of a window: more would be finer than the picture.
const CELLS: usize = 240;

/// What the axis of both fields is.
struct SpeedAxis {
    words: &'static str,
    values: Vec<f64>,
}

/// The picture. `title`: recording and quantity; `unit` of the amplitudes; `highest`: order up to which spectra go.
pub fn svg(title: &str, unit: &str, driver: &str, found: &OrderTracks, highest: f64) -> String {
    let axis = axis_of(found);
    let (low, high) = axis.values.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    let range = if high > low { high - low } else { 1.0 };
    let x = |field: (f64, f64, f64, f64), v: f64| field.0 + field.2 * (v - low) / range;
    let mut s = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>\n<text x=\"{}\" y=\"24\" font-size=\"15\">{}</text>\n",
        CAMPBELL.0,
        escape(title),
        w = PAGE.0,
        h = PAGE.1,
    );
    let top_hz = found.turns_per_s.iter().fold(0.0, |most: f64, v| most.max(*v)) * highest;
    let y_hz = |hz: f64| CAMPBELL.1 + CAMPBELL.3 * (1.0 - hz / top_hz);
    s += &cells(found, &axis, (&|v| x(CAMPBELL, v), &y_hz), top_hz);
    s += &lines(found, &axis, (&|v| x(CAMPBELL, v), &y_hz), top_hz);
    s += &frame(CAMPBELL, "frequency [Hz]", 0.0, top_hz);
    let largest =
        found.tracks.iter().flat_map(|t| t.amplitudes.iter()).fold(0.0, |most: f64, a| most.max(*a)).max(1e-300);
    let y = |a: f64| TRACKS.1 + TRACKS.3 * (1.0 - a / (1.05 * largest));
    for (k, track) in found.tracks.iter().enumerate() {
        let mut d = String::new();
        for (v, a) in axis.values.iter().zip(&track.amplitudes) {
            let command = if d.is_empty() { 'M' } else { 'L' };
            let _infallible = write!(d, "{command}{:.1} {:.1}", x(TRACKS, *v), y(*a));
        }
        let colour = hex(CURVE_COLOURS[k % CURVE_COLOURS.len()]);
        let _infallible = writeln!(
            s,
            "<path d=\"{d}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\"/><text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\">{:.4}</text>",
            TRACKS.0 + TRACKS.2 + 8.0,
            TRACKS.1 + 14.0 + 15.0 * k as f64,
            track.order
        );
    }
    s += &frame(TRACKS, &format!("amplitude {unit}"), 0.0, 1.05 * largest);
    for field in [CAMPBELL, TRACKS] {
        for k in 0..=8 {
            let v = low + range * f64::from(k) / 8.0;
            let _infallible = writeln!(
                s,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                x(field, v),
                field.1 + field.3 + 16.0,
                short(v)
            );
        }
        let _infallible = writeln!(
            s,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}, `{}`</text>",
            field.0 + 0.5 * field.2,
            field.1 + field.3 + 34.0,
            axis.words,
            escape(driver)
        );
    }
    s + "</svg>\n"
}

/// Speeds, or times where the speed hardly changes.
fn axis_of(found: &OrderTracks) -> SpeedAxis {
    let (low, high) = found.turns_per_s.iter().fold((f64::MAX, 0.0_f64), |(a, b), v| (a.min(*v), b.max(*v)));
    if high > 1.05 * low {
        SpeedAxis { words: "speed [1/min]", values: found.turns_per_s.iter().map(|v| 60.0 * v).collect() }
    } else {
        SpeedAxis { words: "time [s]", values: found.times_s.clone() }
    }
}

type AxisScale<'a> = &'a dyn Fn(f64) -> f64;

/// Every window's amplitudes, as dark as they are large.
fn cells(found: &OrderTracks, axis: &SpeedAxis, (x, y): (AxisScale<'_>, AxisScale<'_>), top_hz: f64) -> String {
    let mut s = String::new();
    let largest =
        found.spectra.iter().flat_map(|w| w.iter().skip(8)).fold(0.0, |most: f64, a| most.max(*a)).max(1e-300);
    let n = axis.values.len();
    for (k, window) in found.spectra.iter().enumerate() {
        let at = |i: usize| axis.values[i.min(n - 1)];
        // From half-way to the window before to half-way to the next.
        let before = if k == 0 { at(0) } else { 0.5 * (at(k - 1) + at(k)) };
        let (left, right) = (x(before), x(0.5 * (at(k) + at(k + 1))));
        let (left, width) = (left.min(right), (left - right).abs().max(0.6));
        let each = window.len().div_ceil(CELLS).max(1);
        for (c, part) in window.chunks(each).enumerate().skip(1) {
            let amplitude = part.iter().copied().fold(0.0, f64::max);
            let share = 1.0 + libm::log10(amplitude.max(1e-300) / largest) / DECADES;
            let order = (c * each) as f64 * found.step;
            let (low_hz, high_hz) = (order, order + each as f64 * found.step);
            let [low_hz, high_hz] = [low_hz, high_hz].map(|o| o * found.turns_per_s[k]);
            if share <= 0.05 || high_hz > top_hz {
                continue;
            }
            let grey = (255.0 * (1.0 - share.min(1.0))) as u8;
            let _infallible = writeln!(
                s,
                "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"{width:.1}\" height=\"{:.1}\" fill=\"#{grey:02x}{grey:02x}{grey:02x}\"/>",
                y(high_hz),
                (y(low_hz) - y(high_hz)).max(0.6)
            );
        }
    }
    s
}

/// A line for each tracked order, with its name at its end.
fn lines(found: &OrderTracks, axis: &SpeedAxis, (x, y): (AxisScale<'_>, AxisScale<'_>), top_hz: f64) -> String {
    let mut s = String::new();
    for (k, track) in found.tracks.iter().enumerate() {
        let mut d = String::new();
        let mut last = None;
        for (v, turns_per_s) in axis.values.iter().zip(&found.turns_per_s) {
            let hz = track.order * turns_per_s;
            if hz <= top_hz {
                let command = if d.is_empty() { 'M' } else { 'L' };
                let _infallible = write!(d, "{command}{:.1} {:.1}", x(*v), y(hz));
                last = Some((x(*v), y(hz)));
            }
        }
        let Some((right, height)) = last else { continue };
        let colour = hex(CURVE_COLOURS[k % CURVE_COLOURS.len()]);
        let name = track.names.first().map_or(String::new(), |name| format!(" {name}"));
        let _infallible = writeln!(
            s,
            "<path d=\"{d}\" fill=\"none\" stroke=\"{colour}\" stroke-dasharray=\"5 4\"/><text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\">{:.3}{}</text>",
            right + 4.0,
            height + 4.0,
            track.order,
            escape(&name)
        );
    }
    s
}

/// The border of a field, its upright axis and what that is.
fn frame((left, top, width, height): (f64, f64, f64, f64), words: &str, low: f64, high: f64) -> String {
    let mut s = format!(
        "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#99a\"/>\n"
    );
    for k in 0..=5 {
        let v = low + (high - low) * f64::from(k) / 5.0;
        let y = top + height * (1.0 - f64::from(k) / 5.0);
        let _infallible =
            writeln!(s, "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>", left - 6.0, y + 4.0, short(v));
    }
    let middle = top + 0.5 * height;
    let _infallible = writeln!(
        s,
        "<text x=\"16\" y=\"{middle:.1}\" transform=\"rotate(-90 16 {middle:.1})\" text-anchor=\"middle\">{}</text>",
        escape(words)
    );
    s
}

/// Three digits.
fn short(v: f64) -> String {
    if v == 0.0 || (0.01..10_000.0).contains(&v.abs()) {
        let digits = if v.abs() >= 100.0 || v == 0.0 {
            0
        } else if v.abs() >= 10.0 {
            1
        } else {
            3
        };
        format!("{v:.digits$}")
    } else {
        format!("{v:.2e}")
    }
}
