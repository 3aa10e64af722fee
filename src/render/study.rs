//! The report of a study: one self-contained HTML file. Shares that keep their bounds, histograms, sensitivities with their intervals, responses
//! against factors, the worst cases with the commands that record them.

use super::escape;
use crate::random::SplitMix;
use crate::study::bind::BoundStudy;
use crate::study::estimates::IntervalEstimate;
use crate::study::factor::{FactorCell, FactorValue};
use crate::study::run::CaseRow;
use crate::study::summary::{DriveResults, ResponseSummary, Sensitivity, StudySummary};
use std::fmt::Write;

/// Widths and heights of diagrams [px].
const HISTOGRAM: (f64, f64) = (420.0, 170.0);
const SCATTER: (f64, f64) = (280.0, 200.0);
const BARS: f64 = 620.0;
const MARGIN: (f64, f64) = (48.0, 30.0);
/// Classes of a histogram.
const CLASSES: usize = 30;
/// Most points of a scatter diagram: more are sampled, and said so.
const POINTS: usize = 2000;
/// Factors drawn against a response, the strongest first.
const DRAWN: usize = 6;
const GOOD: &str = "#1c6dd0";
const BAD: &str = "#c92a2a";
const GREY: &str = "#868e96";

/// The whole page. `record`: the command that records a case, but for the case.
pub fn html(bound: &BoundStudy, rows: &[&CaseRow], summary: &StudySummary, record: &str) -> String {
    let title = if summary.title.is_empty() { &summary.study } else { &summary.title };
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{0}</title><style>\
         body{{font:15px/1.45 system-ui,sans-serif;max-width:960px;margin:2em auto;color:#222}}\
         table{{border-collapse:collapse;margin:1em 0}}td,th{{border:1px solid #ccc;padding:3px 9px;text-align:right}}\
         td:first-child,th:first-child{{text-align:left}}.no{{color:{BAD}}}svg{{background:#fff;margin:2px}}\
         pre,code{{background:#f6f7f8}}pre{{padding:1em;overflow-x:auto;font-size:12.5px}}</style><h1>{0}</h1>\n",
        escape(title)
    );
    let _infallible = writeln!(
        page,
        "<p>{} of {} cases are done; plan: {}. Intervals hold with 95 %.</p>",
        summary.done, summary.cases, summary.plan
    );
    for (k, drive) in summary.drives.iter().enumerate() {
        let own: Vec<&CaseRow> = rows.iter().copied().filter(|row| row.case.drive == k).collect();
        page += &drive_section(bound, drive, &own, record);
    }
    let _infallible = writeln!(page, "<h2>The study</h2><pre>{}</pre></html>", escape(&bound.study.text));
    page
}

fn drive_section(bound: &BoundStudy, drive: &DriveResults, rows: &[&CaseRow], record: &str) -> String {
    let mut page = format!("<h2>{}</h2>\n", escape(&drive.drive));
    if let Some(kept) = drive.keeps_all.filter(|_| drive.done > 0) {
        let _infallible =
            writeln!(page, "<p>All bounds are kept in <b>{}</b> of {} cases.</p>", percent(kept), drive.done);
    }
    if drive.errors > 0 {
        let _infallible = writeln!(page, "<p class=\"no\">Cases that broke down: {}</p><ul>", drive.errors);
        for (why, n) in drive.reasons.iter().take(10) {
            let _infallible = writeln!(page, "<li>{n} x {}</li>", escape(why));
        }
        page += "</ul>\n";
    }
    page += &table(drive);
    for (k, response) in drive.responses.iter().enumerate() {
        let _infallible = writeln!(page, "<h3>{}</h3>", escape(&response.name));
        page += &histogram(response, rows, k);
        page += &bars(response);
        page += &scatters(bound, response, rows, k);
    }
    page + &worst(bound, drive, record)
}

fn percent(share: IntervalEstimate) -> String {
    format!("{:.1} % ({:.1} to {:.1})", 100.0 * share.value, 100.0 * share.low, 100.0 * share.high)
}

fn table(drive: &DriveResults) -> String {
    let mut out = String::from(
        "<table><tr><th>response</th><th>min</th><th>5 %</th><th>median</th><th>95 %</th><th>max</th><th>mean</th><th>sd</th>\
         <th>bound</th><th>fails</th></tr>\n",
    );
    for r in &drive.responses {
        let numbers = [r.min, r.p05, r.median, r.p95, r.max, r.mean, r.sd].map(|x| format!("<td>{}</td>", number(x)));
        let bounds: Vec<String> = r
            .at_most
            .iter()
            .map(|b| format!("at most {}", number(*b)))
            .chain(r.at_least.iter().map(|b| format!("at least {}", number(*b))))
            .collect();
        let _infallible = writeln!(
            out,
            "<tr><td>{}</td>{}<td>{}</td><td>{}</td></tr>",
            escape(&r.name),
            numbers.concat(),
            bounds.join(", "),
            r.fails.map_or(String::new(), percent)
        );
    }
    out + "</table>\n"
}

/// Four digits.
fn number(x: f64) -> String {
    match x.abs() {
        _ if x.is_nan() => "-".into(),
        0.0 => "0".into(),
        1e-3..1e5 => {
            let above = [1e-2, 1e-1, 1.0, 10.0, 100.0, 1000.0].iter().filter(|power| x.abs() >= **power).count();
            format!("{x:.*}", 6 - above)
        }
        _ => format!("{x:.2e}"),
    }
}

/// Range of values, widened where it has no width.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let half = if high > low { 0.0 } else { (0.01 * high.abs()).max(1e-12) };
    (low <= high).then_some((low - half, high + half))
}

fn value_of(row: &CaseRow, k: usize) -> Option<f64> {
    row.responses.get(k).copied().flatten()
}

fn histogram(r: &ResponseSummary, rows: &[&CaseRow], k: usize) -> String {
    let values: Vec<f64> = rows.iter().filter_map(|row| value_of(row, k)).collect();
    let bounds = r.at_most.into_iter().chain(r.at_least);
    let Some((low, high)) = range(values.iter().copied().chain(bounds.clone())) else { return String::new() };
    let mut counts = [0_usize; CLASSES];
    for v in &values {
        counts[(((v - low) / (high - low) * CLASSES as f64) as usize).min(CLASSES - 1)] += 1;
    }
    let top = counts.iter().copied().max().unwrap_or(1).max(1) as f64;
    let (w, h) = HISTOGRAM;
    let (left, bottom) = MARGIN;
    let x = |v: f64| left + (v - low) / (high - low) * (w - left - 10.0);
    let mut svg = open(w, h);
    let step = (high - low) / CLASSES as f64;
    for (i, n) in counts.iter().enumerate() {
        let from = low + i as f64 * step;
        let middle = from + 0.5 * step;
        let is_bad = r.at_most.is_some_and(|b| middle > b) || r.at_least.is_some_and(|b| middle < b);
        let height = (h - bottom - 12.0) * *n as f64 / top;
        let _infallible = write!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height:.1}\" fill=\"{}\"><title>{n} cases from {} to {}</title></rect>",
            x(from),
            h - bottom - height,
            (x(from + step) - x(from) - 0.7).max(0.3),
            if is_bad { BAD } else { GOOD },
            number(from),
            number(from + step)
        );
    }
    for bound in bounds {
        let _infallible = write!(
            svg,
            "<line x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"4\" y2=\"{1:.1}\" stroke=\"{BAD}\" stroke-dasharray=\"4 3\"/>",
            x(bound),
            h - bottom
        );
    }
    svg += &axis((low, high), &x, h - bottom, &r.name);
    svg + "</svg>\n"
}

fn open(w: f64, h: f64) -> String {
    format!("<svg viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" font-size=\"11\">")
}

/// A horizontal axis with its ends, its middle and its name.
fn axis((low, high): (f64, f64), x: &dyn Fn(f64) -> f64, y: f64, name: &str) -> String {
    let mut svg =
        format!("<line x1=\"{:.1}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#222\"/>", x(low), x(high));
    for (v, anchor) in [(low, "start"), (0.5 * (low + high), "middle"), (high, "end")] {
        let _infallible =
            write!(svg, "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>", x(v), y + 13.0, number(v));
    }
    let _infallible = write!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"{GREY}\">{}</text>",
        x(0.5 * (low + high)),
        y + 26.0,
        escape(name)
    );
    svg
}

/// Bars of a sensitivity, and its interval.
struct SensitivityBars {
    heads: &'static [&'static str],
    of: fn(&Sensitivity) -> Vec<IntervalEstimate>,
}

fn bars(r: &ResponseSummary) -> String {
    let kind = |s: &Sensitivity| match (s.sobol, s.morris, s.rank_correlation) {
        (Some(_), _, _) => Some(SensitivityBars {
            heads: &["total index of Sobol'", "first order"],
            of: |s| s.sobol.map_or_else(Vec::new, |own| vec![own.total, own.first]),
        }),
        (None, Some(_), _) => Some(SensitivityBars {
            heads: &["mu* of Morris"],
            of: |s| s.morris.map_or_else(Vec::new, |own| vec![own.mu_star]),
        }),
        (None, None, Some(_)) => {
            Some(SensitivityBars { heads: &["rank correlation"], of: |s| s.rank_correlation.into_iter().collect() })
        }
        (None, None, None) => None,
    };
    let Some(bars) = r.sensitivities.iter().find_map(kind) else { return String::new() };
    let all: Vec<(&str, Vec<IntervalEstimate>)> =
        r.sensitivities.iter().map(|s| (s.factor.as_str(), (bars.of)(s))).filter(|(_, own)| !own.is_empty()).collect();
    let ends = all.iter().flat_map(|(_, own)| own).flat_map(|e| [e.low, e.high, e.value]).filter(|v| v.is_finite());
    let Some((low, high)) = range(ends.chain([0.0])) else { return String::new() };
    let (left, row) = (170.0, 15.0);
    let per = bars.heads.len() as f64;
    let h = all.len() as f64 * (per * row + 6.0) + 46.0;
    let x = |v: f64| left + (v - low) / (high - low) * (BARS - left - 12.0);
    let mut svg = open(BARS, h);
    let colours = [GOOD, "#74a9e6"];
    for (i, (factor, own)) in all.iter().enumerate() {
        let y = 6.0 + i as f64 * (per * row + 6.0);
        let _infallible = write!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            left - 6.0,
            y + 0.5 * per * row + 4.0,
            escape(factor)
        );
        for (j, e) in own.iter().enumerate() {
            let top = y + j as f64 * row;
            let (from, to) = (x(0.0_f64.min(e.value)), x(0.0_f64.max(e.value)));
            let _infallible = write!(
                svg,
                "<rect x=\"{from:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"><title>{} {}: {} ({} to {})</title></rect>\
                 <line x1=\"{:.1}\" x2=\"{:.1}\" y1=\"{m:.1}\" y2=\"{m:.1}\" stroke=\"#222\"/>",
                (to - from).max(0.5),
                row - 3.0,
                colours[j % 2],
                escape(factor),
                bars.heads[j % bars.heads.len()],
                number(e.value),
                number(e.low),
                number(e.high),
                x(e.low.clamp(low, high)),
                x(e.high.clamp(low, high)),
                m = top + 0.5 * (row - 3.0)
            );
        }
    }
    svg +=
        &axis((low, high), &x, h - 32.0, &bars.heads.join(" (dark), ").replace("first order", "first order (light)"));
    let left_out = match r.left_out {
        0 => String::new(),
        n => format!("<p class=\"no\">Rows of the plan that are left out, because a value is missing: {n}.</p>"),
    };
    format!("{svg}</svg>{left_out}\n")
}

/// The response against its strongest factors.
fn scatters(bound: &BoundStudy, r: &ResponseSummary, rows: &[&CaseRow], k: usize) -> String {
    let names: Vec<&str> = if r.sensitivities.is_empty() {
        bound.study.factors.iter().map(|f| f.name.as_str()).collect()
    } else {
        r.sensitivities.iter().map(|s| s.factor.as_str()).collect()
    };
    let mut page = String::new();
    let mut is_sampled = false;
    for name in names.into_iter().take(DRAWN) {
        let Some(f) = bound.study.factors.iter().position(|factor| factor.name == name) else { continue };
        let pair = |row: &&CaseRow| match row.case.cells.get(f)? {
            FactorCell::Value(FactorValue::Number(x)) => Some((*x, value_of(row, k)?)),
            FactorCell::Unset
            | FactorCell::Seed(_)
            | FactorCell::Value(FactorValue::Text(_) | FactorValue::Flag(_)) => None,
        };
        let mut points: Vec<(f64, f64)> = rows.iter().filter_map(pair).collect();
        if points.len() > POINTS {
            is_sampled = true;
            let mut random = SplitMix(1);
            points = (0..POINTS).map(|_| points[random.below(points.len())]).collect();
        }
        page += &scatter(name, r, &points);
    }
    if is_sampled {
        let _infallible = writeln!(page, "<p>{POINTS} of the cases are drawn.</p>");
    }
    page
}

fn scatter(name: &str, r: &ResponseSummary, points: &[(f64, f64)]) -> String {
    let bounds = || r.at_most.into_iter().chain(r.at_least);
    let (Some((low, high)), Some((bottom_v, top_v))) =
        (range(points.iter().map(|p| p.0)), range(points.iter().map(|p| p.1).chain(bounds())))
    else {
        return String::new();
    };
    let (w, h) = SCATTER;
    let (left, bottom) = MARGIN;
    let x = |v: f64| left + (v - low) / (high - low) * (w - left - 10.0);
    let y = |v: f64| h - bottom - (v - bottom_v) / (top_v - bottom_v) * (h - bottom - 10.0);
    let mut svg = open(w, h);
    for (a, b) in points {
        let is_bad = r.at_most.is_some_and(|bound| *b > bound) || r.at_least.is_some_and(|bound| *b < bound);
        let colour = if is_bad { BAD } else { GOOD };
        let _infallible = write!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.6\" fill=\"{colour}\" fill-opacity=\"0.55\"/>",
            x(*a),
            y(*b)
        );
    }
    for bound in bounds() {
        let _infallible = write!(
            svg,
            "<line x1=\"{left}\" x2=\"{0:.1}\" y1=\"{1:.1}\" y2=\"{1:.1}\" stroke=\"{BAD}\" stroke-dasharray=\"4 3\"/>",
            x(high),
            y(bound)
        );
    }
    let _infallible = write!(
        svg,
        "<line x1=\"{left}\" x2=\"{left}\" y1=\"10\" y2=\"{:.1}\" stroke=\"#222\"/>\
         <text x=\"{1:.1}\" y=\"{2:.1}\" text-anchor=\"end\">{3}</text><text x=\"{1:.1}\" y=\"16\" text-anchor=\"end\">{4}</text>",
        h - bottom,
        left - 3.0,
        h - bottom,
        number(bottom_v),
        number(top_v)
    );
    svg + &axis((low, high), &x, h - bottom, name) + "</svg>\n"
}

fn worst(bound: &BoundStudy, drive: &DriveResults, record: &str) -> String {
    let mut page =
        String::from("<h3>The worst cases</h3><div style=\"overflow-x:auto\"><table><tr><th>case</th><th>margin</th>");
    for r in &bound.study.responses {
        let _infallible = write!(page, "<th>{}</th>", escape(&r.name));
    }
    for f in &bound.study.factors {
        let _infallible = write!(page, "<th>{}</th>", escape(&f.name));
    }
    page += "<th>record it</th></tr>\n";
    for case in &drive.worst {
        let margin = case.worst_margin.map_or_else(|| "-".to_string(), |m| format!("{:+.1} %", 100.0 * m));
        let _infallible = write!(page, "<tr><td>{}</td><td>{margin}</td>", case.case);
        match &case.error {
            Some(why) => {
                let _infallible =
                    write!(page, "<td class=\"no\" colspan=\"{}\">{}</td>", bound.study.responses.len(), escape(why));
            }
            None => {
                for v in &case.responses {
                    let _infallible = write!(page, "<td>{}</td>", number(v.unwrap_or(f64::NAN)));
                }
            }
        }
        for (_, value) in &case.factors {
            let _infallible = write!(page, "<td>{}</td>", escape(value));
        }
        let _infallible = writeln!(page, "<td><code>{} {}</code></td></tr>", escape(record), case.case);
    }
    page + "</table></div>\n"
}
