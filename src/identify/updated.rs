//! The drive file with what was identified written into it. Comments, layout and line ends stay as the user has them.

use super::report::{FittedNumber, IdentificationReport, NamedEffect};
use super::text::four_digits;
use crate::effects::Kind;
use crate::machine::Machine;
use toml_edit::{DocumentMut, Item, Table, TableLike, Value, value};

/// A fitted number has no place in the drive file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoTable {
    /// Path of the number, or of the effect.
    pub path: String,
}

impl std::fmt::Display for NoTable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "there is no table for `{}` in the drive file, and what stands in its place is none", self.path)
    }
}

impl std::error::Error for NoTable {}

/// The drive file with fitted parameters and effects written in; comments are kept.
///
/// # Errors
/// Something that is no table stands where one is needed.
pub fn updated(machine: &Machine, r: &IdentificationReport) -> Result<String, NoTable> {
    // The machine was read from this text.
    let no_table = |path: &str| NoTable { path: path.to_string() };
    let mut document: DocumentMut = machine.text.parse().map_err(|_| no_table("the file"))?;
    for n in r.numbers_after.iter().filter(|n| n.record.is_none()) {
        let (at, key) = n.path.rsplit_once('.').unwrap_or(("", &n.path));
        let table = table_of(document.as_table_mut(), at).ok_or_else(|| no_table(&n.path))?;
        put(table, key, number(n.value), None);
    }
    for e in &r.effects {
        write_effect(&mut document, e).ok_or_else(|| no_table(&e.path))?;
    }
    let mut text = document.to_string();
    if !text.ends_with('\n') {
        text.push('\n');
    }
    if machine.text.contains("\r\n") {
        text = text.replace("\r\n", "\n").replace('\n', "\r\n");
    }
    Ok(text)
}

/// The table at a path whose keys may contain points themselves; it is made where it does not exist.
fn table_of<'a>(table: &'a mut dyn TableLike, path: &str) -> Option<&'a mut dyn TableLike> {
    if path.is_empty() {
        return Some(table);
    }
    let ends = path.match_indices('.').map(|(at, _)| at).chain([path.len()]);
    let known = ends.clone().find(|end| table.contains_key(&path[..*end]));
    let end = known.or_else(|| ends.clone().next()).unwrap_or(path.len());
    let (key, rest) = (&path[..end], path.get(end + 1..).unwrap_or(""));
    if known.is_none() {
        let mut new = Table::new();
        // Its head is written where it has values.
        new.set_implicit(true);
        table.insert(key, Item::Table(new));
    }
    table_of(table.get_mut(key)?.as_table_like_mut()?, rest)
}

/// Puts a value in place of one, with the spaces and the comment beside it, unless it has a note of its own.
fn put(table: &mut dyn TableLike, key: &str, mut new: Value, note: Option<String>) {
    if let Some(note) = note {
        new.decor_mut().set_suffix(format!(" # {note}"));
    }
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(old) => {
            if new.decor().suffix().is_none() {
                *new.decor_mut() = old.decor().clone();
            }
            *old = new;
        }
        None => {
            table.insert(key, value(new));
        }
    }
}

/// A table `effects.NAME.TARGET` behind all others.
fn write_effect(document: &mut DocumentMut, e: &NamedEffect) -> Option<()> {
    let mut words = e.path.splitn(3, '.').skip(1);
    let (name, target) = (words.next()?, words.next()?);
    let of_name = table_of(document.as_table_mut(), &format!("effects.{name}"))?;
    if !of_name.contains_key(target) {
        let mut new = Table::new();
        let found = format!(" # found by identify; held-out error {:.3} times that without it", e.judge_ratio[0]);
        new.decor_mut().set_prefix("\n");
        new.decor_mut().set_suffix(found);
        of_name.insert(target, Item::Table(new));
    }
    let table = of_name.get_mut(target)?.as_table_like_mut()?;
    let mut written: Vec<&str> = Vec::new();
    for n in &e.parameters {
        let key = n.path.rsplit('.').next().unwrap_or_default();
        if written.contains(&key) {
            continue;
        }
        written.push(key);
        let row = crate::effects::named(name).and_then(|e| e.parameters.iter().find(|p| p.key == key));
        // A size that differs from record to record: that of the last fitted record.
        let is_phase = row.is_some_and(|p| p.kind == Kind::Phase);
        let n = e.parameters.iter().rfind(|m| m.path == n.path).filter(|_| !is_phase).unwrap_or(n);
        let is_whole = row.is_some_and(|p| p.kind.is_whole()) && n.value == libm::trunc(n.value);
        let value = if is_whole { Value::from(n.value as i64) } else { number(n.value) };
        put(table, key, value, note(n));
    }
    Some(())
}

/// What stands beside a number of an effect.
fn note(n: &FittedNumber) -> Option<String> {
    match (&n.record, n.standard_error > 0.0) {
        (Some(record), _) => Some(format!("in record {record}; other records have their own")),
        (None, true) => Some(format!("+- {}", four_digits(n.standard_error))),
        (None, false) => n.tried.then(|| "tried, not fitted".to_string()),
    }
}

/// A float that TOML reads back to the same bits.
fn number(x: f64) -> Value {
    let text = format!("{x}");
    let text = if text.contains(['.', 'e', 'i', 'N']) { text } else { format!("{text}.0") };
    text.parse().unwrap_or_else(|_| Value::from(x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_found_and_made_with_points_in_their_keys() {
        let mut document: DocumentMut = "[effects.offset.\"sensors.tachometer.disc\"]\noffset = 1.0 # ours\n\n[rotors]\ndisc = { inertia_kg_m2 = 1 }\n".parse().unwrap();
        let mut set =
            |path: &str, key: &str, x: f64| put(table_of(document.as_table_mut(), path).unwrap(), key, number(x), None);
        set("effects.offset.sensors.tachometer.disc", "offset", 2.0);
        set("rotors.disc", "inertia_kg_m2", 0.05);
        set("loads.viscous.disc", "torque_nm_s_per_rad", 3.0);
        let text = document.to_string();
        assert!(text.contains("offset = 2.0 # ours\n"), "{text}");
        assert!(text.contains("disc = { inertia_kg_m2 = 0.05 }"), "{text}");
        assert!(
            text.contains("[loads.viscous.disc]\ntorque_nm_s_per_rad = 3.0\n") && !text.contains("[loads]"),
            "{text}"
        );
        assert!(table_of(document.as_table_mut(), "rotors.disc.inertia_kg_m2.x").is_none());
    }
}
