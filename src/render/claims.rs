//! The page of claims: one self-contained HTML file, with a picture where there is a curve.

use super::escape;
use crate::reproduce::{AnsweredClaim, ClaimVerdict, Paper, Plot};
use std::fmt::Write;

/// Size of a picture and its margins: left, below, above [px].
const SIZE: (f64, f64) = (560.0, 230.0);
const MARGINS: (f64, f64, f64) = (58.0, 38.0, 24.0);
const COLOURS: [&str; 6] = ["#1c6dd0", "#c92a2a", "#2b8a3e", "#e67700", "#862e9c", "#0b7285"];

fn colour(verdict: ClaimVerdict) -> &'static str {
    match verdict {
        ClaimVerdict::Reproduced => "#2b8a3e",
        ClaimVerdict::Trend => "#5c940d",
        ClaimVerdict::NotReproduced => "#c92a2a",
        ClaimVerdict::ContradictsItself => "#862e9c",
        ClaimVerdict::NotCheckable => "#868e96",
    }
}

/// The whole page. `pace`: how much was run, in words.
pub fn html(answers: &[AnsweredClaim], pace: &str) -> String {
    let title = "Claims of four papers on timing chains";
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{title}</title><style>\
         body{{font:15px/1.5 system-ui,sans-serif;max-width:980px;margin:2em auto;color:#222;padding:0 1em}}\
         article{{border-top:1px solid #ddd;padding:.6em 0}}h3{{margin:.2em 0}}.v{{color:#fff;border-radius:4px;padding:1px 8px;font-size:13px}}\
         table{{border-collapse:collapse;margin:1em 0}}td,th{{border:1px solid #ccc;padding:3px 10px;text-align:right}}td:first-child,th:first-child{{text-align:left}}\
         code{{background:#f6f7f8;font-size:12.5px}}.q{{color:#555}}svg{{background:#fff;display:block;margin:.6em 0}}</style><h1>{title}</h1>\n\
         <p>Drives like those of the papers were run ({pace}) and asked whether each claim holds. The papers' figures are lost and they print few numbers, so that the \
         drives hold many assumed ones, each marked in its file. \u{201c}Trend reproduced\u{201d} says that a drive like the paper's does so, not that the paper's size is met.</p>\n"
    );
    let _infallible =
        writeln!(page, "<p>{} of {} claims are answered.</p>", answers.len(), crate::reproduce::claims().len());
    page += &summary(answers);
    for paper in Paper::ALL {
        let own: Vec<&AnsweredClaim> = answers.iter().filter(|a| a.paper == paper).collect();
        if own.is_empty() {
            continue;
        }
        let _infallible = writeln!(page, "<h2>{}</h2>", escape(paper.title()));
        own.iter().for_each(|a| page += &article(a));
    }
    page + "</html>\n"
}

fn summary(answers: &[AnsweredClaim]) -> String {
    let mut table = String::from("<table><tr><th>paper</th>");
    ClaimVerdict::ALL.iter().for_each(|v| table += &format!("<th>{}</th>", v.name()));
    table += "<th>claims</th></tr>\n";
    let row = |name: &str, own: &[&AnsweredClaim]| {
        let mut row = format!("<tr><td>{name}</td>");
        for verdict in ClaimVerdict::ALL {
            row += &format!("<td>{}</td>", own.iter().filter(|a| a.answer.verdict == verdict).count());
        }
        row + &format!("<td>{}</td></tr>\n", own.len())
    };
    for paper in Paper::ALL {
        let own: Vec<&AnsweredClaim> = answers.iter().filter(|a| a.paper == paper).collect();
        table += &row(paper.name(), &own);
    }
    table + &row("all", &answers.iter().collect::<Vec<_>>()) + "</table>\n"
}

fn article(a: &AnsweredClaim) -> String {
    let mut html = format!(
        "<article id=\"{0}\"><h3>{0} <span class=\"v\" style=\"background:{1}\">{2}</span></h3><p class=\"q\">{3}</p><p><b>Measured:</b> {4}</p><p><b>Judged:</b> {5}</p>\n",
        a.id,
        colour(a.answer.verdict),
        a.answer.verdict.name(),
        escape(a.claim),
        escape(&a.answer.measured),
        escape(&a.answer.why)
    );
    if let Some(plot) = &a.answer.plot {
        html += &picture(plot);
    }
    for command in &a.ran {
        let _infallible = write!(html, "<code>pitchline {}</code><br>", escape(command));
    }
    if a.trials > a.ran.len() {
        let _infallible = write!(html, "and {} more", a.trials - a.ran.len());
    }
    html + "</article>\n"
}

/// Curves over one axis, as SVG.
pub fn picture(plot: &Plot) -> String {
    let points = || plot.curves.iter().flat_map(|c| &c.points).filter(|p| p.0.is_finite() && p.1.is_finite());
    let bounds = |f: fn(&(f64, f64)) -> f64| {
        points().map(f).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let ((x0, x1), (y0, y1)) = (bounds(|p| p.0), bounds(|p| p.1));
    if !(x1 > x0 && y0.is_finite()) {
        return String::new();
    }
    // From zero where that costs little.
    let y0 = if y0 > 0.0 && y0 < 0.6 * y1 { 0.0 } else { y0 };
    let y1 = if y1 > y0 { y1 } else { y0 + 1.0 };
    let (left, below, above) = MARGINS;
    let (w, h) = SIZE;
    let x = |v: f64| left + (v - x0) / (x1 - x0) * (w - left - 12.0);
    let y = |v: f64| h - below - (v - y0) / (y1 - y0) * (h - below - above);
    let mut svg = format!("<svg viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" font-size=\"11\">");
    for k in 0..=4 {
        let (vx, vy) = (x0 + 0.25 * f64::from(k) * (x1 - x0), y0 + 0.25 * f64::from(k) * (y1 - y0));
        let _infallible = write!(
            svg,
            "<line x1=\"{left}\" x2=\"{:.1}\" y1=\"{1:.1}\" y2=\"{1:.1}\" stroke=\"#e9ecef\"/><text x=\"{2:.1}\" y=\"{3:.1}\" text-anchor=\"end\">{4}</text><text x=\"{5:.1}\" y=\"{6:.1}\" text-anchor=\"middle\">{7}</text>",
            w - 12.0,
            y(vy),
            left - 5.0,
            y(vy) + 4.0,
            number(vy),
            x(vx),
            h - below + 14.0,
            number(vx)
        );
    }
    for (k, curve) in plot.curves.iter().enumerate() {
        let colour = COLOURS[k % COLOURS.len()];
        let path: Vec<String> = curve
            .points
            .iter()
            .filter(|p| p.0.is_finite() && p.1.is_finite())
            .map(|p| format!("{:.1},{:.1}", x(p.0), y(p.1)))
            .collect();
        let _infallible = write!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\"/>",
            path.join(" ")
        );
        if curve.points.len() <= 40 {
            for p in &path {
                let (px, py) = p.split_once(',').unwrap_or(("0", "0"));
                let _infallible = write!(svg, "<circle cx=\"{px}\" cy=\"{py}\" r=\"2.4\" fill=\"{colour}\"/>");
            }
        }
        let _infallible = write!(
            svg,
            "<text x=\"{:.1}\" y=\"14\" fill=\"{colour}\" text-anchor=\"end\">{}</text>",
            w - 12.0 - 110.0 * (plot.curves.len() - 1 - k) as f64,
            escape(&curve.name)
        );
    }
    let _infallible = writeln!(
        svg,
        "<text x=\"{left}\" y=\"14\" fill=\"#868e96\">{}</text><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#868e96\">{}</text></svg>",
        escape(&plot.y),
        0.5 * (left + w),
        h - 8.0,
        escape(&plot.x)
    );
    svg
}

/// Three digits.
fn number(x: f64) -> String {
    let size = x.abs();
    if size >= 1e5 || (size > 0.0 && size < 1e-3) {
        format!("{x:.1e}")
    } else if size >= 100.0 || size == 0.0 {
        format!("{x:.0}")
    } else if size >= 10.0 {
        format!("{x:.1}")
    } else {
        format!("{x:.3}")
    }
}
