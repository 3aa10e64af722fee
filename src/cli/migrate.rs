//! `pitchline check --migrate`: the text of a drive file of an earlier version as this version reads it, comments and layout kept.
//!
//! A change that earlier files notice is a row of [`CHANGES`]. Keys and tables have had their names since the first version; what was refused
//! since then and cannot be put right without another drive is told by the reader, with the range that it allows.

use super::Failure;
use crate::assemble::{AssemblyError, compile};
use crate::diag::Report;
use crate::drive::Drive;
use crate::drive::shafts::ORDERS_WITHOUT_PHASES;
use crate::machine::{Machine, is_lumped};
use crate::model::runs_through;
use toml_edit::{DocumentMut, Item, Value, value};

/// A change of what drive files may say.
struct Change {
    /// What is refused since then.
    refused: &'static str,
    /// Puts it right in a text that this version refuses so; returns what it has changed. There is no drive where the text is not read.
    apply: fn(&mut DocumentMut, Option<&Drive>, &Report) -> Vec<String>,
}

/// All of them.
const CHANGES: [Change; 2] = [
    Change {
        refused: "since 2026-11-21 guides end clear of the sprockets' teeth, with their lead-in and lead-out",
        apply: shorten_guides,
    },
    Change {
        refused: "since 2026-11-30 orders say their phases, which were 0 where none were given",
        apply: add_phases,
    },
];

/// Most rounds of changes: a guide gives way by this many times [`SHORTER_MM`].
const MOST_ROUNDS: usize = 400;
/// By how much a guide is made shorter at a time.
const SHORTER_MM: f64 = 0.5;
/// Radius of a guide's ends before it is made shorter: larger ones reach far round the sprocket. Those of the bundled drives.
const END_RADIUS_MM: f64 = 15.0;

/// A text that this version reads, and what was changed for it. A file that is read as it is comes back as it is.
pub(super) fn migrated(name: &str, text: &str) -> Result<(String, Vec<String>), Failure> {
    if is_lumped(text) {
        Machine::parse(name, text, &[]).map_err(|report| Failure::Input(report.to_string()))?;
        return Ok((text.to_string(), Vec::new()));
    }
    let mut changed = Vec::new();
    let mut now = text.to_string();
    for _ in 0..MOST_ROUNDS {
        let (drive, report) = match Drive::parse(name, &now, &[]) {
            Ok(drive) => match compile(&drive) {
                Ok(_) => return Ok((now, told(changed))),
                Err(AssemblyError::Input(report)) => (Some(drive), report),
                Err(other) => return Err(super::assembly_failure(other)),
            },
            Err(report) => (None, report),
        };
        let mut document: DocumentMut = now.parse().map_err(|e| Failure::Input(format!("{name}: {e}")))?;
        let before = changed.len();
        for change in &CHANGES {
            let done = (change.apply)(&mut document, drive.as_ref(), &report);
            changed.extend(done.into_iter().map(|what| (what, change.refused)));
        }
        if changed.len() == before {
            return Err(Failure::Input(report.to_string()));
        }
        now = document.to_string();
    }
    Err(Failure::Input(format!("`{name}` is still refused after {MOST_ROUNDS} changes; `pitchline check` says why")))
}

/// Each kind of change once, with its reason, the last state of every value.
fn told(changes: Vec<(String, &'static str)>) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for (what, reason) in changes {
        let line = format!("{what}: {reason}");
        let path = |line: &str| line.split(" = ").next().unwrap_or_default().to_string();
        lines.retain(|other| path(other) != path(&line));
        lines.push(line);
    }
    lines
}

/// Guides that run through a sprocket at an end of their span get narrower ends, and then end a little earlier there.
fn shorten_guides(document: &mut DocumentMut, drive: Option<&Drive>, report: &Report) -> Vec<String> {
    let mut changed = Vec::new();
    let Some(drive) = drive else { return changed };
    'guides: for guide in &drive.guides {
        let chain = drive.sprockets.get(guide.span).map_or(0, |s| s.chain);
        let own = drive.sprockets_of(chain);
        let next = if guide.span + 1 < own.end { guide.span + 1 } else { own.start };
        for (key, sprocket) in [("start_mm", guide.span), ("end_mm", next)] {
            let Some(sprocket) = drive.sprockets.get(sprocket) else { continue };
            let title = runs_through(&guide.name, &sprocket.name);
            if report.diags.iter().all(|d| d.title != title) {
                continue;
            }
            let at = ["guides", "fixed", guide.name.as_str()];
            let Some(table) = table_at(document, &at) else { continue };
            if number(table.get("end_radius_mm")).is_some_and(|mm| mm > END_RADIUS_MM) {
                put(table, "end_radius_mm", END_RADIUS_MM);
                changed.push(format!("guides.fixed.{}.end_radius_mm = {END_RADIUS_MM}", guide.name));
                continue 'guides;
            }
            let mm = number(table.get(key)).unwrap_or(0.0) + SHORTER_MM;
            put(table, key, mm);
            changed.push(format!("guides.fixed.{}.{key} = {mm}", guide.name));
        }
    }
    changed
}

/// Orders without phases get those that they had: zeros.
fn add_phases(document: &mut DocumentMut, _: Option<&Drive>, report: &Report) -> Vec<String> {
    if report.diags.iter().all(|d| d.title != ORDERS_WITHOUT_PHASES) {
        return Vec::new();
    }
    let mut changed = Vec::new();
    for [group, kind] in [["speeds", "constant"], ["speeds", "table"], ["loads", "orders"]] {
        let names: Vec<String> = table_at(document, &[group, kind])
            .map(|tables| tables.iter().map(|(name, _)| name.to_string()).collect())
            .unwrap_or_default();
        for name in names {
            let Some(table) = table_at(document, &[group, kind, &name]) else { continue };
            let Some(orders) = table.get("orders").and_then(Item::as_array).map(toml_edit::Array::len) else {
                continue;
            };
            if table.get("phases_deg").is_none() {
                let zeros: toml_edit::Array = std::iter::repeat_n(0, orders).collect();
                changed.push(format!("{group}.{kind}.{name}.phases_deg = {zeros}"));
                table.insert("phases_deg", value(zeros));
            }
        }
    }
    changed
}

fn table_at<'a>(document: &'a mut DocumentMut, path: &[&str]) -> Option<&'a mut dyn toml_edit::TableLike> {
    let mut item: &mut Item = document.as_item_mut();
    for key in path {
        item = item.as_table_like_mut()?.get_mut(key)?;
    }
    item.as_table_like_mut()
}

fn number(item: Option<&Item>) -> Option<f64> {
    let item = item?;
    item.as_float().or_else(|| item.as_integer().map(|i| i as f64))
}

/// Puts a number in place of one, with the spaces and the comment beside it.
fn put(table: &mut dyn toml_edit::TableLike, key: &str, number: f64) {
    // As it is written: a whole number has no point.
    let Ok(mut new) = format!("{number}").parse::<Value>() else { return };
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(old) => {
            *new.decor_mut() = old.decor().clone();
            *old = new;
        }
        None => {
            table.insert(key, value(new));
        }
    }
}
