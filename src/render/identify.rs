//! The report of an identification: one self-contained HTML file. Whether to believe it, in words; measurement and model before and
//! after, with the residual below; the residual's spectrum before and after, by frequency and by order; its whiteness; the states that it
//! follows; the error budget; all of it in words.

use super::escape;
use crate::identify::diagnosis::{ChannelResiduals, OrderSpectrum};
use crate::identify::report::{Curve, IdentificationReport};
use crate::identify::text;
use std::f64::consts::PI;
use std::fmt::Write;

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 230.0;
/// Height of a strip of residuals.
const STRIP: f64 = 120.0;
const LEFT: f64 = 64.0;
const BOTTOM: f64 = 34.0;
/// Maximum number of points of a line.
const POINTS: usize = 900;
const COLOURS: [&str; 3] = ["#495057", "#c92a2a", "#1c6dd0"];

/// The whole page.
pub fn html(report: &IdentificationReport) -> String {
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{0}</title><style>\
         body{{font:15px/1.45 system-ui,sans-serif;max-width:900px;margin:2em auto;color:#222}}\
         pre{{background:#f6f7f8;padding:1em;overflow-x:auto;font-size:12.5px}}svg{{background:#fff}}\
         .m{{color:{1}}}.b{{color:{2}}}.a{{color:{3}}}</style><h1>{0}</h1>\n",
        escape(&report.title),
        COLOURS[0],
        COLOURS[1],
        COLOURS[2]
    );
    let words = text::text(report);
    // The first paragraph behind the title: the verdict, and what speaks against it.
    let (verdict, rest) = words.split_once("\n\n").map_or((words.as_str(), ""), |(_, more)| {
        let end = more.find("\n\n").unwrap_or(more.len());
        (&more[..end], more[end..].trim_start())
    });
    let _infallible = writeln!(page, "<pre style=\"white-space:pre-wrap;font-size:14px\">{}</pre>", lines(verdict));
    page += "<h2>Error budget</h2>\n";
    page += &budget(report);
    page += "<h2>Measured, <span class=\"b\">before</span>, <span class=\"a\">after</span>; below, what is left, with twice the noise floor</h2>\n";
    for c in &report.curves {
        let judged = if c.judge_from == 0 {
            "held out"
        } else if c.judge_from >= c.measured.len() {
            "fitted"
        } else {
            "held out from the dashed line on"
        };
        let _infallible = writeln!(page, "<h3>{}, {} ({judged})</h3>", escape(&c.record), escape(&c.channel));
        page += &series(c);
        let floor = report
            .noise_floor
            .iter()
            .find(|f| f.channel == c.channel && f.unit == c.unit)
            .map_or(0.0, |f| f.noise_floor);
        page += &residual(c, floor);
    }
    page += "<h2>Spectrum of the residual, <span class=\"b\">before</span> and <span class=\"a\">after</span></h2>\n";
    let mut drawn: Vec<&str> = Vec::new();
    for c in &report.curves {
        if !drawn.contains(&c.channel.as_str()) {
            drawn.push(&c.channel);
            page += &spectrum(report, c);
        }
    }
    page += "<h2>What is left, by itself</h2>\n";
    page += &residuals_section(report);
    let _infallible = writeln!(page, "<h2>In words</h2><pre>{}</pre></html>", lines(rest));
    page
}

/// Text of several lines, each escaped: `escape` makes a space of a line's end.
fn lines(text: &str) -> String {
    text.lines().map(escape).collect::<Vec<_>>().join("\n")
}

fn budget(report: &IdentificationReport) -> String {
    let mut svg = format!("<svg viewBox=\"0 0 {WIDTH} 64\" width=\"{WIDTH}\" height=\"64\" font-size=\"12\">");
    let palette = ["#1c6dd0", "#2b8a3e", "#e8890c", "#6f42c1"];
    let mut x = 0.0;
    for (i, s) in report.error_budget.iter().enumerate() {
        let width = WIDTH * (s.percent / 100.0).clamp(0.0, 1.0);
        let colour = match s.of.as_str() {
            "noise floor" => "#adb5bd",
            "not explained" => "#c92a2a",
            _ => palette[i % palette.len()],
        };
        let _infallible = write!(
            svg,
            "<rect x=\"{x:.1}\" y=\"4\" width=\"{width:.1}\" height=\"26\" fill=\"{colour}\"><title>{} {:.1} %</title></rect>",
            escape(&s.of),
            s.percent
        );
        if width > 60.0 {
            let _infallible = write!(
                svg,
                "<text x=\"{:.1}\" y=\"48\" fill=\"{colour}\">{} {:.0} %</text>",
                x,
                escape(&s.of),
                s.percent
            );
        }
        x += width;
    }
    svg + "</svg>\n"
}

/// Frame of a diagram, labelled with the ends of both axes.
fn frame(x: (f64, f64, &str), y: (f64, f64, &str)) -> String {
    frame_of(HEIGHT, x, y)
}

fn frame_of(height: f64, x: (f64, f64, &str), y: (f64, f64, &str)) -> String {
    let (w, h) = (WIDTH - LEFT - 8.0, height - BOTTOM - 8.0);
    let number =
        |v: f64| if v != 0.0 && !(1e-2..1e5).contains(&v.abs()) { format!("{v:.1e}") } else { format!("{v:.3}") };
    format!(
        "<svg viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" font-size=\"12\">\
         <rect x=\"{LEFT}\" y=\"8\" width=\"{w}\" height=\"{h}\" fill=\"none\" stroke=\"#ccc\"/>\
         <text x=\"{LEFT}\" y=\"{b}\">{}</text><text x=\"{r}\" y=\"{b}\" text-anchor=\"end\">{} {}</text>\
         <text x=\"4\" y=\"20\">{}</text><text x=\"4\" y=\"{base}\">{}</text><text x=\"4\" y=\"38\">{}</text>",
        number(x.0),
        number(x.1),
        escape(x.2),
        number(y.1),
        number(y.0),
        escape(y.2),
        b = height - 12.0,
        r = WIDTH - 8.0,
        base = height - BOTTOM,
    )
}

/// A line through points, thinned so that peaks remain: minimum and maximum of every bundle.
fn line(xs: &[f64], ys: &[f64], x: (f64, f64), y: (f64, f64), colour: &str, width: f64) -> String {
    line_of(HEIGHT, (xs, ys), x, y, (colour, width))
}

fn line_of(
    height: f64,
    (xs, ys): (&[f64], &[f64]),
    x: (f64, f64),
    y: (f64, f64),
    (colour, width): (&str, f64),
) -> String {
    let (w, h) = (WIDTH - LEFT - 8.0, height - BOTTOM - 8.0);
    let place = |i: usize| {
        let px = LEFT + w * (xs[i] - x.0) / (x.1 - x.0).max(1e-300);
        let py = 8.0 + h * (1.0 - ((ys[i] - y.0) / (y.1 - y.0).max(1e-300)).clamp(-0.02, 1.02));
        format!("{px:.1},{py:.1} ")
    };
    let bundle = (2 * xs.len() / POINTS).max(1);
    let mut points = String::new();
    for start in (0..xs.len()).step_by(bundle) {
        let all = || (start..(start + bundle).min(xs.len())).filter(|i| ys[*i].is_finite());
        let low = all().min_by(|a, b| ys[*a].total_cmp(&ys[*b]));
        let high = all().max_by(|a, b| ys[*a].total_cmp(&ys[*b]));
        if let (Some(a), Some(b)) = (low, high) {
            points += &place(a.min(b));
            if a != b {
                points += &place(a.max(b));
            }
        }
    }
    format!("<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" points=\"{points}\"/>")
}

fn range(of: &[&[f64]]) -> (f64, f64) {
    let all = || of.iter().flat_map(|s| s.iter()).filter(|v| v.is_finite());
    let (low, high) = (all().copied().fold(f64::MAX, f64::min), all().copied().fold(f64::MIN, f64::max));
    if low < high { (low, high) } else { (low - 1.0, low + 1.0) }
}

fn series(c: &Curve) -> String {
    let x = range(&[&c.t_s]);
    // The measured series sets the scale; a model that runs away leaves the diagram.
    let (low, high) = range(&[&c.measured]);
    let y = (low - 0.1 * (high - low), high + 0.1 * (high - low));
    let mut svg = frame((x.0, x.1, "s"), (y.0, y.1, &c.unit));
    svg += &line(&c.t_s, &c.measured, x, y, COLOURS[0], 1.6);
    svg += &line(&c.t_s, &c.before, x, y, COLOURS[1], 1.0);
    svg += &line(&c.t_s, &c.after, x, y, COLOURS[2], 1.0);
    if c.judge_from > 0 && c.judge_from < c.t_s.len() {
        let at = LEFT + (WIDTH - LEFT - 8.0) * (c.t_s[c.judge_from] - x.0) / (x.1 - x.0).max(1e-300);
        let _infallible = write!(
            svg,
            "<line x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"8\" y2=\"{}\" stroke=\"#666\" stroke-dasharray=\"5 4\"/>",
            HEIGHT - BOTTOM
        );
    }
    svg + "</svg>\n"
}

/// What is left of a channel before and after, with twice the noise floor. What is left after sets the scale; what was left before leaves the strip.
fn residual(c: &Curve, floor: f64) -> String {
    let left = |of: &[f64]| -> Vec<f64> { of.iter().zip(&c.measured).map(|(m, y)| y - m).collect() };
    let (before, after) = (left(&c.before), left(&c.after));
    let (low, high) = range(&[&after]);
    let most = 1.1 * low.abs().max(high.abs()).max(2.5 * floor);
    let (x, y) = (range(&[&c.t_s]), (-most, most));
    let mut svg = frame_of(STRIP, (x.0, x.1, "s"), (y.0, y.1, &c.unit));
    let (top, bottom) = (8.0, STRIP - BOTTOM);
    let at = |v: f64| top + (bottom - top) * (1.0 - (v - y.0) / (y.1 - y.0));
    let _infallible = write!(
        svg,
        "<rect x=\"{LEFT}\" y=\"{:.1}\" width=\"{}\" height=\"{:.1}\" fill=\"#e9ecef\"/>",
        at(2.0 * floor),
        WIDTH - LEFT - 8.0,
        at(-2.0 * floor) - at(2.0 * floor)
    );
    svg += &line_of(STRIP, (&c.t_s, &before), x, y, (COLOURS[1], 0.7));
    svg += &line_of(STRIP, (&c.t_s, &after), x, y, (COLOURS[2], 0.9));
    svg + "</svg>\n"
}

/// Amplitudes of the residual over cycles per hundred samples, mean over all plotted segments.
fn spectrum(report: &IdentificationReport, like: &Curve) -> String {
    const LINES: usize = 200;
    let amplitudes = |of: fn(&Curve) -> &Vec<f64>| -> Vec<f64> {
        let mut sum = vec![0.0; LINES];
        let curves: Vec<&Curve> = report.curves.iter().filter(|c| c.channel == like.channel).collect();
        for c in &curves {
            let r: Vec<f64> = of(c)
                .iter()
                .zip(&c.measured)
                .map(|(m, y)| m - y)
                .map(|r| if r.is_finite() { r } else { 0.0 })
                .collect();
            for (k, s) in sum.iter_mut().enumerate() {
                let w = PI * (k as f64 + 0.5) / LINES as f64;
                // Direct sums; they are few and computed once.
                let (mut re, mut im) = (0.0, 0.0);
                for (i, r) in r.iter().enumerate() {
                    let (sin, cos) = crate::units::sin_cos(w * i as f64);
                    re += r * cos;
                    im += r * sin;
                }
                *s += 2.0 * libm::sqrt(re * re + im * im) / r.len().max(1) as f64 / curves.len() as f64;
            }
        }
        sum
    };
    let (before, after) = (amplitudes(|c| &c.before), amplitudes(|c| &c.after));
    let xs: Vec<f64> = (0..LINES).map(|k| (k as f64 + 0.5) * 50.0 / LINES as f64).collect();
    let y = (0.0, range(&[&before, &after]).1);
    let mut svg = frame((0.0, 50.0, "cycles per 100 samples"), (y.0, y.1, &like.unit));
    svg += &line(&xs, &before, (0.0, 50.0), y, COLOURS[1], 1.2);
    svg += &line(&xs, &after, (0.0, 50.0), y, COLOURS[2], 1.2);
    format!("<h3>{}</h3>{svg}</svg>\n", escape(&like.channel))
}

/// For every channel: residual by order of every rotating body, the cumulated periodogram, and the forms that it
/// follows.
fn residuals_section(report: &IdentificationReport) -> String {
    let mut page = String::new();
    let after = report.diagnosis_after.as_ref();
    for (c, before) in report.diagnosis.channels.iter().enumerate() {
        let after = after.and_then(|d| d.channels.get(c));
        for (b, orders) in before.by_order.iter().enumerate() {
            let body = escape(&orders.body);
            let _infallible = writeln!(page, "<h3>{}, by order of {body}</h3>", escape(&before.channel));
            page += &by_order(orders, after.and_then(|a| a.by_order.get(b)), &before.unit);
        }
        if !before.periodogram.cumulated.is_empty() {
            let _infallible = writeln!(
                page,
                "<h3>{}, cumulated periodogram: white noise stays between the dashed lines</h3>",
                escape(&before.channel)
            );
            page += &cumulated(before, after);
        }
        for (left, colour) in [(Some(before), COLOURS[1]), (after, COLOURS[2])] {
            page += &left.map_or_else(String::new, |l| shares(l, colour));
        }
    }
    page
}

fn by_order(before: &OrderSpectrum, after: Option<&OrderSpectrum>, unit: &str) -> String {
    let last = before.orders.last().copied().unwrap_or(1.0);
    let y = (0.0, range(&[&before.amplitudes]).1);
    let mut svg = frame((0.0, last, "per revolution"), (y.0, y.1, unit));
    for (s, colour) in [(Some(before), COLOURS[1]), (after, COLOURS[2])] {
        if let Some(s) = s {
            svg += &line(&s.orders, &s.amplitudes, (0.0, last), y, colour, 1.2);
        }
    }
    svg + "</svg>\n"
}

fn cumulated(before: &ChannelResiduals, after: Option<&ChannelResiduals>) -> String {
    let x = (0.0, 50.0);
    let mut svg = frame((x.0, x.1, "cycles per 100 samples"), (0.0, 1.0, "of the power"));
    let band = before.periodogram.band;
    for side in [-band, band] {
        let (xs, ys) = ([x.0, x.1], [side, 1.0 + side]);
        svg +=
            &line(&xs, &ys, x, (0.0, 1.0), "#adb5bd", 1.0).replace("<polyline", "<polyline stroke-dasharray=\"5 4\"");
    }
    for (left, colour) in [(Some(before), COLOURS[1]), (after, COLOURS[2])] {
        let Some(left) = left else { continue };
        let all: Vec<f64> = std::iter::once(0.0).chain(left.periodogram.cumulated.iter().copied()).collect();
        let xs: Vec<f64> = (0..all.len()).map(|i| x.1 * i as f64 / (all.len() - 1) as f64).collect();
        svg += &line(&xs, &all, x, (0.0, 1.0), colour, 1.4);
    }
    svg + "</svg>\n"
}

/// Bars of the shares that simple forms would remove of a channel's squared error.
fn shares(left: &ChannelResiduals, colour: &str) -> String {
    let orders = left.orders.iter().map(|o| (o.name.clone(), o.share));
    let states = left.states.iter().map(|s| (format!("{} of {}", s.term, s.body), s.share));
    let all: Vec<(String, f64)> = orders.chain(states).collect();
    if all.is_empty() {
        return String::new();
    }
    let height = 20 * all.len();
    let mut svg =
        format!("<svg viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" font-size=\"12\">");
    for (i, (name, share)) in all.iter().enumerate() {
        let (y, width) = (20 * i + 3, 0.6 * WIDTH * share.clamp(0.0, 1.0));
        let _infallible = write!(
            svg,
            "<rect x=\"0\" y=\"{y}\" width=\"{width:.1}\" height=\"14\" fill=\"{colour}\"/>\
             <text x=\"{:.1}\" y=\"{}\">{} {:.0} %</text>",
            width + 6.0,
            y + 11,
            escape(name),
            100.0 * share
        );
    }
    svg + "</svg>\n"
}
