//! Legend of lengths, arrows and colours, below the panels of a drawing.

use super::{DrawingSheet, FORCE, INK, JOINT_FORCE, MARGIN, ROW_COLOURS, forces, push_text, round_below};
use std::fmt::Write;

/// Height of a line, and total margin [user units].
const LINE: f64 = 24.0;
const SPACING: f64 = 28.0;

/// Symbol before a text of the legend.
enum Mark {
    /// Length [user units].
    Bar(f64),
    Arrow {
        length: f64,
        class: &'static str,
        colour: &'static str,
    },
    Row(&'static str),
    Nothing,
}

/// An entry of the legend, its position in it and its text [user units].
pub struct LegendEntry {
    at: [f64; 2],
    mark: Mark,
    text: String,
}

/// Scales and colours, in as many lines as they need; positions are relative to the legend's upper left corner.
pub fn entries(sheet: &DrawingSheet, width: f64) -> Vec<LegendEntry> {
    let per_mm = sheet.units_per_m * 1e-3;
    let bar_mm = round_below(110.0 / per_mm);
    let mut entries = vec![(Mark::Bar(bar_mm * per_mm), format!("{bar_mm} mm"))];
    let arrows = [
        (sheet.contact_units_per_n, FORCE, "legend", "contact force on the link"),
        (sheet.joint_units_per_n, JOINT_FORCE, "legend-joint", "joint force on the link ahead"),
    ];
    for (units_per_n, colour, class, meaning) in arrows {
        let Some(units_per_n) = units_per_n else { continue };
        let shown_n = round_below(90.0 / units_per_n);
        entries.push((Mark::Arrow { length: shown_n * units_per_n, class, colour }, format!("{shown_n} N, {meaning}")));
    }
    for (row, outline) in sheet.header.link_outlines.iter().enumerate() {
        let text = if outline.name.contains("link") { outline.name.clone() } else { format!("{} link", outline.name) };
        entries.push((Mark::Row(ROW_COLOURS[row % ROW_COLOURS.len()]), text));
    }
    if let Some(least_n) = forces::least_numbered_n(sheet) {
        entries.push((Mark::Nothing, {
            let peak = if sheet.options.impacts.is_empty() { "" } else { ", peak of its impact" };
            format!("numbers: link, mean force over the step, penetration{peak}; from {least_n} N on")
        }));
    }
    let mut at = [MARGIN, 0.0];
    let place = |(mark, text): (Mark, String)| {
        let before = match mark {
            Mark::Bar(length) | Mark::Arrow { length, .. } => length + 8.0,
            Mark::Row(_) => 26.0,
            Mark::Nothing => 0.0,
        };
        let taken = before + 6.4 * text.chars().count() as f64;
        if at[0] + taken > width - MARGIN && at[0] > MARGIN {
            at = [MARGIN, at[1] + LINE];
        }
        let entry = LegendEntry { at: [at[0] + before, at[1]], mark, text };
        at[0] += taken + 24.0;
        entry
    };
    entries.into_iter().map(place).collect()
}

/// Height of the legend below the panels [user units].
pub fn height(entries: &[LegendEntry]) -> f64 {
    SPACING + LINE + entries.last().map_or(0.0, |e| e.at[1])
}

/// Draws the legend below `bottom`, the lower edge of the panels.
pub fn push(svg: &mut String, entries: &[LegendEntry], bottom: f64) {
    let top = bottom + 0.5 * (SPACING + LINE);
    for LegendEntry { at: [x, y], mark, text } in entries {
        let y = y + top;
        match mark {
            Mark::Bar(length) => {
                let (start, end, upper, lower) = (x - 8.0 - length, x - 8.0, y - 4.0, y + 4.0);
                let _infallible = writeln!(
                    svg,
                    "<path class=\"length-scale\" d=\"M{start:.3} {upper:.2}V{lower:.2}M{start:.3} {y:.2}H{end:.3}\
                     M{end:.3} {upper:.2}V{lower:.2}\" stroke=\"{INK}\" stroke-width=\"1.4\" fill=\"none\"/>"
                );
            }
            Mark::Arrow { length, class, colour } => {
                forces::push_arrow(svg, class, [[x - 8.0 - length, y], [x - 8.0, y]], colour);
            }
            Mark::Row(colour) => {
                let _infallible = writeln!(
                    svg,
                    "<rect x=\"{:.2}\" y=\"{:.2}\" width=\"18\" height=\"10\" rx=\"5\" fill=\"{colour}\" \
                     fill-opacity=\"0.14\" stroke=\"{colour}\"/>",
                    x - 26.0,
                    y - 5.0
                );
            }
            Mark::Nothing => {}
        }
        push_text(svg, [*x, y], 12.0, "start", INK, text);
    }
}
