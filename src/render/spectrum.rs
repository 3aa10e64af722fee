//! A spectrum as SVG: amplitudes over orders on a logarithmic scale, the largest peaks with their names; a second curve in grey.

use super::escape;
use crate::analysis::order_spectrum::AngleSpectrum;
use std::fmt::Write;

/// Page, and the diagram on it [user units]: left, top, width, height.
const PAGE: (f64, f64) = (960.0, 440.0);
const FIELD: (f64, f64, f64, f64) = (78.0, 44.0, 860.0, 340.0);
/// Decades that are drawn below the largest amplitude.
const DECADES: f64 = 4.0;
/// Peaks that have their names drawn, and their least distance.
const NAMED: usize = 12;
const APART: f64 = 13.0;

/// The picture. `title`: recording and quantity; `unit` of the amplitudes; `highest`: order at the right edge.
pub fn svg(title: &str, unit: &str, driver: &str, curves: &[(&str, &AngleSpectrum)], highest: f64) -> String {
    let (left, top, width, height) = FIELD;
    let largest = curves.iter().flat_map(|(_, s)| s.peaks.iter().map(|p| p.amplitude)).fold(0.0, f64::max).max(1e-300);
    let upper = libm::ceil(libm::log10(largest) + 0.3);
    let x = |order: f64| left + width * order / highest;
    let y = |amplitude: f64| {
        let decades = (upper - libm::log10(amplitude.max(1e-300))).clamp(0.0, DECADES);
        top + height * decades / DECADES
    };
    let mut s = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>\n<text x=\"{left}\" y=\"24\" font-size=\"15\">{}</text>\n",
        escape(title),
        w = PAGE.0,
        h = PAGE.1,
    );
    s += &grid(upper, highest, (unit, driver));
    // The first curve on top.
    for (k, (name, spectrum)) in curves.iter().enumerate().rev() {
        let colour = if k == 0 { "#1c6dd0" } else { "#999" };
        let _infallible = writeln!(
            s,
            "<path d=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.2\"/><text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\" \
             text-anchor=\"end\">{}</text>",
            curve(spectrum, highest, &x, &y),
            left + width - 8.0,
            top + 16.0 + 15.0 * k as f64,
            escape(name)
        );
    }
    let mut named: Vec<f64> = Vec::new();
    for peak in curves.first().iter().flat_map(|(_, s)| s.peaks.iter().filter(|p| p.order <= highest)) {
        let Some(text) = peak.names.first() else { continue };
        if named.len() >= NAMED || named.iter().any(|at| (at - x(peak.order)).abs() < APART) {
            continue;
        }
        named.push(x(peak.order));
        let _infallible = writeln!(
            s,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"11\" transform=\"rotate(-55 {x:.1} {y:.1})\">{}</text>",
            escape(text),
            x = x(peak.order) + 3.0,
            y = (y(peak.amplitude) - 4.0).max(top + 8.0)
        );
    }
    s + "</svg>\n"
}

/// Lines of decades and orders with their numbers, and what the axes are.
fn grid(upper: f64, highest: f64, (unit, driver): (&str, &str)) -> String {
    let (left, top, width, height) = FIELD;
    let x = |order: f64| left + width * order / highest;
    let mut s = String::new();
    for decade in 0..=DECADES as i32 {
        let at = upper as i32 - decade;
        let y = top + height * f64::from(decade) / DECADES;
        let _infallible = writeln!(
            s,
            "<path d=\"M{left} {y:.1}h{width}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">1e{at}</text>",
            left - 6.0,
            y + 4.0
        );
    }
    let distance = tick(highest);
    let mut order = 0.0;
    while order <= highest * 1.0001 {
        let _infallible = writeln!(
            s,
            "<path d=\"M{x:.1} {top}v{height}\" stroke=\"#eee\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{order}</text>",
            top + height + 16.0,
            x = x(order)
        );
        order += distance;
    }
    let _infallible = writeln!(
        s,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">order: times per turn of `{}`</text><text x=\"14\" y=\"{:.1}\" \
         transform=\"rotate(-90 14 {:.1})\" text-anchor=\"middle\">amplitude {}</text>",
        left + 0.5 * width,
        top + height + 36.0,
        escape(driver),
        top + 0.5 * height,
        top + 0.5 * height,
        escape(unit)
    );
    s
}

/// The largest amplitude of every half user unit.
fn curve(spectrum: &AngleSpectrum, highest: f64, x: &impl Fn(f64) -> f64, y: &impl Fn(f64) -> f64) -> String {
    let mut d = String::new();
    let per_column = (highest / spectrum.step / (2.0 * FIELD.2)).max(1.0);
    let mut from = 0.0;
    while from * spectrum.step <= highest && (from as usize) < spectrum.amplitudes.len() {
        let to = ((from + per_column) as usize).clamp(from as usize + 1, spectrum.amplitudes.len());
        let values = spectrum.amplitudes.get(from as usize..to).unwrap_or_default();
        let amplitude = values.iter().copied().fold(0.0, f64::max);
        let command = if d.is_empty() { 'M' } else { 'L' };
        let _infallible = write!(d, "{command}{:.2} {:.2}", x(from * spectrum.step), y(amplitude));
        from += per_column;
    }
    d
}

/// Distance of marks on the axis of orders.
fn tick(highest: f64) -> f64 {
    let rough = highest / 10.0;
    let power = libm::pow(10.0, libm::floor(libm::log10(rough.max(1e-9))));
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|f| f * power).find(|t| *t >= rough).unwrap_or(10.0 * power)
}
