//! The report of a comparison: one self-contained HTML file, curves as SVG.

use super::escape;
use crate::compare::{Claim, DriveSummary, Run};
use crate::engagement::{BINS_PER_PITCH, ContactKind, KINDS, Pass};
use crate::recording::palette::{CURVE_COLOURS, hex};
use std::fmt::Write;

/// Size of one diagram [px], and its margins.
const SIZE: (f64, f64) = (860.0, 230.0);
const MARGIN: (f64, f64) = (56.0, 34.0);
/// Displayed part of a pass [T].
const SHOWN: (f64, f64) = (-1.5, 11.5);

/// Colour of the curves of a kind of contact.
fn colour(kind: ContactKind) -> String {
    let [sky, orange, green, purple, _, vermilion, blue] = CURVE_COLOURS;
    hex(match kind {
        ContactKind::Guide => green,
        ContactKind::RingFront => blue,
        ContactKind::RingRear => purple,
        ContactKind::Bush | ContactKind::FlankTrailing => vermilion,
        ContactKind::FlankLeading => orange,
        ContactKind::InnerFlank => sky,
    })
}

/// Colour of the curves of a drive, by its place among those compared: the same as in the viewers.
fn drive_colour(place: usize) -> String {
    hex(CURVE_COLOURS[place % CURVE_COLOURS.len()])
}

/// The whole page. `sweep`: summaries over speeds [rpm], if there are several.
pub fn html(runs: &[Run], claims: &[Claim], sweep: &[(f64, Vec<DriveSummary>)], recordings: &[String]) -> String {
    let mut page = String::from(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Chain drives compared</title><style>\
         body{font:15px/1.45 system-ui,sans-serif;max-width:900px;margin:2em auto;color:#222}\
         table{border-collapse:collapse;margin:1em 0}td,th{border:1px solid #ccc;padding:3px 9px;text-align:right}\
         td:first-child,th:first-child{text-align:left}.yes{color:#2b8a3e}.no{color:#c92a2a}svg{background:#fff}\
         </style><h1>Chain drives compared</h1>\n",
    );
    page += "<p>Engagements on the driver. u counts tooth periods T since the link's front joint passed the end of the \
             straight span. Forces are means over a step of the scheme; lines are medians over all passes, bands reach \
             from the smallest to the largest pass.</p>\n";
    if !claims.is_empty() {
        page += "<h2>Verdict</h2><table><tr><th>claim</th><th>measured</th><th></th></tr>\n";
        for c in claims {
            let (class, word) = if c.holds { ("yes", "holds") } else { ("no", "does not hold") };
            let _infallible = writeln!(
                page,
                "<tr><td>{}</td><td>{}</td><td class=\"{class}\">{word}</td></tr>",
                escape(&c.claim),
                escape(&c.measured)
            );
        }
        page += "</table>\n";
    }
    page += &table(runs);
    let top = runs.iter().flat_map(|r| r.summary.kinds.iter()).map(|k| k.peak_lap_n).fold(1.0, f64::max);
    for run in runs {
        let _infallible = writeln!(page, "<h2>{}</h2><p>{}</p>", escape(&run.name), escape(&run.title));
        page += &diagram(run, 1.05 * top);
        page += &touches(run);
    }
    page += &everywhere(runs);
    page += &spectra(runs);
    page += &over_speed(sweep);
    page += "<h2>Recordings</h2><p>";
    page += &recordings.iter().map(|r| format!("<code>{}</code>", escape(r))).collect::<Vec<_>>().join(", ");
    page += "</p><h2>Drives</h2>\n";
    for run in runs {
        let _infallible = writeln!(
            page,
            "<details><summary>{}</summary><p>overrides: {}</p><pre>{}</pre></details>",
            escape(&run.name),
            if run.header.overrides.is_empty() { "none".into() } else { escape(&run.header.overrides.join(", ")) },
            escape(&run.header.drive_text)
        );
    }
    page + "</html>\n"
}

fn table(runs: &[Run]) -> String {
    let mut text = String::from(
        "<h2>Numbers</h2><table><tr><th>contact</th><th>passes</th><th>first touch<br>u [T]</th>\
         <th>approach<br>median [m/s]</th><th>max</th><th>peak [N]<br>engaging</th><th>lap</th>\
         <th>pitch 2<br>mean [N]</th><th>rise [T]</th></tr>\n",
    );
    for run in runs {
        let _infallible = writeln!(text, "<tr><th colspan=\"9\">{}</th></tr>", escape(&run.name));
        for k in &run.summary.kinds {
            let _infallible = writeln!(
                text,
                "<tr><td>{}</td><td>{}</td><td>{:.3}</td><td>{:.4}</td><td>{:.4}</td><td>{:.1}</td><td>{:.1}</td>\
                 <td>{:.1}</td><td>{}</td></tr>",
                k.kind.words(),
                k.passes,
                k.first_touch_t,
                k.approach_median_m_s,
                k.approach_max_m_s,
                k.peak_window_n,
                k.peak_lap_n,
                k.second_pitch_n,
                if k.rise_t.is_nan() { "-".to_string() } else { format!("{:.3}", k.rise_t) }
            );
        }
    }
    text + "</table>\n<p>First touch: in tooth periods T since the front joint of the link passed the end of the straight span. Approach: closing \
            speed at the first touch. Peak: largest force while the link engages, and over its whole way round the driver. Pitch 2: mean force \
            over the second tooth period. Rise: from a tenth to nine tenths of the first peak.</p>\n"
}

/// A vertical grid line of a diagram at `x`, with the label below it.
fn upright(x: f64, text: &str) -> String {
    let foot = SIZE.1 - MARGIN.1;
    format!(
        "<line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"10\" y2=\"{foot:.1}\" stroke=\"#ddd\"/>\
         <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{text}</text>\n",
        foot + 15.0
    )
}

/// A horizontal grid line at `y`, with the label before it.
fn level(y: f64, text: &str) -> String {
    let left = MARGIN.0;
    format!(
        "<line x1=\"{left}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#eee\"/>\
         <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>\n",
        SIZE.0 - 10.0,
        left - 6.0,
        y + 4.0
    )
}

/// Round numbers from zero to `top`, at most seven.
fn marks(top: f64) -> impl Iterator<Item = f64> {
    let step = [20.0, 50.0, 100.0, 200.0, 500.0, 1000.0].into_iter().find(|s| top / s <= 6.0).unwrap_or(5000.0);
    (0..=(top / step) as i32).map(move |k| f64::from(k) * step)
}

fn diagram(run: &Run, top_n: f64) -> String {
    let (w, h) = SIZE;
    let (left, bottom) = MARGIN;
    let x = |u: f64| left + (u - SHOWN.0) / (SHOWN.1 - SHOWN.0) * (w - left - 10.0);
    let y = |f: f64| h - bottom - f / top_n * (h - bottom - 10.0);
    let mut svg = format!("<svg viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" font-size=\"12\">\n");
    for u in SHOWN.0.ceil() as i32..=SHOWN.1.floor() as i32 {
        svg += &upright(x(f64::from(u)), &u.to_string());
    }
    for force in marks(top_n) {
        svg += &level(y(force), &format!("{force:.0} N"));
    }
    let mut key = left + 8.0;
    for kind in KINDS {
        let Some(curves) = PassCurves::from_passes(&run.passes, kind) else { continue };
        let band: String = curves
            .high
            .iter()
            .map(|(u, f)| (u, f))
            .chain(curves.low.iter().rev().map(|(u, f)| (u, f)))
            .map(|(u, f)| format!("{:.1},{:.1} ", x(*u), y(*f)))
            .collect();
        let line: String = curves.middle.iter().map(|(u, f)| format!("{:.1},{:.1} ", x(*u), y(*f))).collect();
        let c = colour(kind);
        let _infallible = writeln!(
            svg,
            "<polygon points=\"{band}\" fill=\"{c}\" opacity=\"0.22\"/>\
             <polyline points=\"{line}\" fill=\"none\" stroke=\"{c}\" stroke-width=\"1.6\"/>\
             <text x=\"{key:.0}\" y=\"{:.0}\" fill=\"{c}\">{}</text>",
            h - 4.0,
            kind.words()
        );
        key += 10.0 + 7.0 * kind.words().len() as f64;
    }
    let _infallible =
        writeln!(svg, "<text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"end\">u [T]</text>", w - 10.0, h - 4.0);
    svg + "</svg>\n"
}

/// Impacts on every body, over the whole loop.
fn everywhere(runs: &[Run]) -> String {
    let mut text = String::from(
        "<h2>The whole way round</h2><p>Touches after two tooth periods without any, on every body: what leaves a sprocket and lands \
         again, and the guides, too.</p><table><tr><th>body</th><th>touches</th><th>approach<br>median [m/s]</th><th>fastest</th>\
         <th>of what</th><th>its peak [N]</th></tr>\n",
    );
    for run in runs {
        let _infallible = writeln!(text, "<tr><th colspan=\"6\">{}</th></tr>", escape(&run.name));
        for t in &run.summary.touches {
            let _infallible = writeln!(
                text,
                "<tr><td>{}</td><td>{}</td><td>{:.4}</td><td>{:.4}</td><td>{}</td><td>{:.1}</td></tr>",
                escape(&t.body),
                t.touches,
                t.approach_p50_m_s,
                t.approach_max_m_s,
                t.part,
                t.peak_there_n
            );
        }
    }
    text + "</table>\n"
}

/// Contacts of one link over time, on its way over the driver.
fn touches(run: &Run) -> String {
    let Some(pass) = run.passes.get(run.passes.len() / 2) else { return String::new() };
    let (w, _) = SIZE;
    let left = MARGIN.0;
    let x = |u: f64| left + (u - SHOWN.0) / (SHOWN.1 - SHOWN.0) * (w - left - 10.0);
    let mut rows = String::new();
    let mut at = 4.0;
    for kind in KINDS {
        // Ranges of bins with a force; a gap of one bin is ignored.
        let mut bars: Vec<(f64, f64)> = Vec::new();
        let half = 0.5 / BINS_PER_PITCH as f64;
        for (bin, _) in pass.force_n.iter().enumerate().filter(|(_, f)| f[kind as usize] > 0.0) {
            let u = Pass::u_of(bin);
            match bars.last_mut() {
                Some(last) if u - half - last.1 < 2.5 * half => last.1 = u + half,
                _ => bars.push((u - half, u + half)),
            }
        }
        if bars.is_empty() {
            continue;
        }
        let c = colour(kind);
        for (from, to) in bars.iter().map(|(a, b)| (a.max(SHOWN.0), b.min(SHOWN.1))).filter(|(a, b)| a < b) {
            let _infallible = write!(
                rows,
                "<rect x=\"{:.2}\" y=\"{at:.0}\" width=\"{:.2}\" height=\"11\" fill=\"{c}\"/>",
                x(from),
                x(to) - x(from)
            );
        }
        let _infallible =
            writeln!(rows, "<text x=\"4\" y=\"{:.0}\" font-size=\"9\" fill=\"{c}\">{}</text>", at + 9.0, short(kind));
        at += 14.0;
    }
    format!(
        "<p>What touches link {} when, from {:.2} ms on:</p>\n<svg viewBox=\"0 0 {w} {at}\" width=\"{w}\" height=\"{at}\">\n{rows}</svg>\n",
        pass.link,
        1e3 * pass.start_s
    )
}

/// Short name, to fit beside a row.
fn short(kind: ContactKind) -> &'static str {
    match kind {
        ContactKind::Guide => "guide",
        ContactKind::RingFront => "ring front",
        ContactKind::RingRear => "ring rear",
        ContactKind::Bush => "bush",
        ContactKind::FlankLeading => "leading",
        ContactKind::FlankTrailing => "trailing",
        ContactKind::InnerFlank => "inner",
    }
}

/// Line chart whose vertical axis is logarithmic or starts at zero.
struct Chart<'a> {
    x: (f64, f64, &'a str),
    y: (f64, f64),
    log: bool,
    unit: &'a str,
}

impl Chart<'_> {
    fn draw(&self, ticks: &[(f64, String)], lines: &[(String, Vec<(f64, f64)>)]) -> String {
        let (w, h) = SIZE;
        let (left, bottom) = MARGIN;
        let scale = |v: f64| if self.log { libm::log10(v.max(self.y.0)) } else { v };
        let (low, high) = (scale(self.y.0), scale(self.y.1));
        let x = |v: f64| left + (v - self.x.0) / (self.x.1 - self.x.0) * (w - left - 10.0);
        let y = |v: f64| h - bottom - (scale(v) - low) / (high - low) * (h - bottom - 10.0);
        let mut svg = format!("<svg viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" font-size=\"12\">\n");
        for (v, text) in ticks {
            svg += &upright(x(*v), text);
        }
        if self.log {
            for p in low.ceil() as i32..=high.floor() as i32 {
                svg += &level(y(libm::pow(10.0, f64::from(p))), &format!("1e{p}{}", self.unit));
            }
        } else {
            for v in marks(high) {
                svg += &level(y(v), &format!("{v:.0}{}", self.unit));
            }
        }
        let mut key = left + 8.0;
        for (i, (name, points)) in lines.iter().enumerate() {
            let c = drive_colour(i);
            let line: String = points.iter().map(|(a, b)| format!("{:.1},{:.1} ", x(*a), y(*b))).collect();
            let _infallible = writeln!(
                svg,
                "<polyline points=\"{line}\" fill=\"none\" stroke=\"{c}\" stroke-width=\"1.4\"/>\
                 <text x=\"{key:.0}\" y=\"{:.0}\" fill=\"{c}\">{}</text>",
                h - 4.0,
                escape(name)
            );
            key += 14.0 + 7.0 * name.len() as f64;
        }
        let _infallible =
            writeln!(svg, "<text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"end\">{}</text>", w - 10.0, h - 4.0, self.x.2);
        svg + "</svg>\n"
    }
}

/// Order spectra of the driven sprockets' speeds.
fn spectra(runs: &[Run]) -> String {
    let lines: Vec<(String, Vec<(f64, f64)>)> = runs
        .iter()
        .filter_map(|r| {
            let s = r.spectrum.as_ref()?;
            Some((r.name.clone(), s.orders.iter().copied().zip(s.shares.iter().map(|v| 100.0 * v)).collect()))
        })
        .collect();
    let points = || lines.iter().flat_map(|l| &l.1);
    let most = points().map(|p| p.1).fold(0.0, f64::max);
    if most <= 0.0 {
        return String::new();
    }
    let last = points().map(|p| p.0).fold(0.0, f64::max);
    // The highest order drawn is 3.25 tooth orders.
    let z = last / 3.25;
    let ticks: Vec<(f64, String)> = [(0.5, "z/2"), (1.0, "z"), (1.5, "3z/2"), (2.0, "2z"), (2.5, "5z/2"), (3.0, "3z")]
        .into_iter()
        .map(|(k, text)| (k * z, format!("{text} = {:.0}", k * z)))
        .collect();
    let chart = Chart { x: (0.0, last, "order of the driver"), y: (1e-5 * most, 1.5 * most), log: true, unit: " %" };
    "<h2>Speed of the driven sprocket</h2><p>Amplitudes over its mean, by order of the driver (Hann window over whole turns).</p>\n"
        .to_string()
        + &chart.draw(&ticks, &lines)
}

/// Largest forces over the speed.
fn over_speed(sweep: &[(f64, Vec<DriveSummary>)]) -> String {
    let (Some(first), Some(last)) = (sweep.first(), sweep.last()) else { return String::new() };
    let lines: Vec<(String, Vec<(f64, f64)>)> = (0..first.1.len())
        .map(|k| (first.1[k].drive.clone(), sweep.iter().map(|(rpm, of)| (*rpm, of[k].largest_n().0)).collect()))
        .collect();
    let most = lines.iter().flat_map(|l| &l.1).map(|p| p.1).fold(1.0, f64::max);
    let ticks: Vec<(f64, String)> = sweep.iter().map(|(rpm, _)| (*rpm, format!("{rpm:.0}"))).collect();
    let chart =
        Chart { x: (0.0, 1.05 * last.0, "speed of the driver [rpm]"), y: (0.0, 1.05 * most), log: false, unit: " N" };
    "<h2>Over speed</h2><p>Largest contact force of an engagement.</p>\n".to_string() + &chart.draw(&ticks, &lines)
}

/// Force over u: minimum, median and maximum of the passes.
struct PassCurves {
    low: Vec<(f64, f64)>,
    middle: Vec<(f64, f64)>,
    high: Vec<(f64, f64)>,
}

impl PassCurves {
    /// None for a kind without contact.
    fn from_passes(passes: &[Pass], kind: ContactKind) -> Option<PassCurves> {
        let touching = passes.iter().any(|p| p.first_touch[kind as usize].is_some());
        let bins = passes.iter().map(|p| p.force_n.len()).min()?;
        if !touching {
            return None;
        }
        let mut curves = PassCurves { low: Vec::new(), middle: Vec::new(), high: Vec::new() };
        // Every bin around the first contact, every fourth elsewhere.
        for bin in 0..bins {
            let u = Pass::u_of(bin);
            if u < SHOWN.0 || u > SHOWN.1 || (u > 3.0 && !bin.is_multiple_of(BINS_PER_PITCH / 50)) {
                continue;
            }
            let mut forces: Vec<f64> = passes.iter().map(|p| p.force_n[bin][kind as usize]).collect();
            forces.sort_by(f64::total_cmp);
            let peak = passes.iter().map(|p| p.peak_n[bin][kind as usize]).fold(0.0, f64::max);
            curves.low.push((u, forces[0]));
            curves.middle.push((u, forces[forces.len() / 2]));
            curves.high.push((u, peak));
        }
        Some(curves)
    }
}
