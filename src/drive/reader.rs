//! Reads typed values out of a TOML document and remembers where each stood.

use super::document::{DocumentTable, DocumentValue};
use crate::diag::{Diag, Place, Report, SourceText, nearest};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use toml::de::{DeTable, DeValue};

/// An override: from the command line, or a number of a fit.
struct Override {
    path: String,
    value: DocumentValue,
    place: Place,
    used: Cell<bool>,
}

/// A number of a file as its reader takes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FileNumber {
    /// In SI.
    pub value: f64,
    /// SI value of the key's unit.
    pub unit: f64,
    /// Range, in the key's unit.
    pub low: f64,
    pub high: f64,
}

/// A document being read: values, mistakes and places.
pub struct DriveReader {
    sources: Vec<SourceText>,
    overrides: Vec<Override>,
    diags: RefCell<Vec<Diag>>,
    places: RefCell<BTreeMap<String, Place>>,
    numbers: RefCell<BTreeMap<String, FileNumber>>,
    /// Every path that some reader asked for.
    asked: RefCell<BTreeSet<String>>,
}

/// A table of the document, or one that is absent.
#[derive(Clone)]
pub struct TomlTable<'a> {
    reader: &'a DriveReader,
    path: String,
    table: Option<&'a DocumentTable>,
    place: Place,
}

impl DriveReader {
    /// Takes the texts; overrides that are no `path=value` are mistakes at once.
    pub fn new(name: &str, text: &str, overrides: &[String]) -> DriveReader {
        let mut sources = vec![SourceText { name: name.to_string(), text: text.to_string() }];
        let mut parsed = Vec::new();
        let mut diags = Vec::new();
        for given in overrides {
            let source = sources.len();
            sources.push(SourceText { name: "--set".to_string(), text: given.clone() });
            match parse_override(given) {
                Ok((path, value, start)) => parsed.push(Override {
                    path,
                    value,
                    place: Place { source, span: start..given.len() },
                    used: Cell::new(false),
                }),
                Err(e) => diags.push(Diag {
                    title: e.to_string(),
                    place: Place { source, span: 0..given.len() },
                    help: Some(
                        "write --set path=value, e.g. --set sprockets.driver.teeth=21 or --set 'title=\"x\"'".into(),
                    ),
                }),
            }
        }
        DriveReader {
            sources,
            overrides: parsed,
            diags: RefCell::new(diags),
            places: RefCell::default(),
            numbers: RefCell::default(),
            asked: RefCell::default(),
        }
    }

    /// Takes numbers too, by path, in the units of their keys: they replace what the text and the overrides say.
    pub fn with_numbers(mut self, numbers: &[(String, f64)]) -> DriveReader {
        let number = |(path, x): &(String, f64)| Override {
            path: path.clone(),
            value: DocumentValue::from_number(*x),
            place: Place { source: 0, span: 0..0 },
            used: Cell::new(false),
        };
        self.overrides.extend(numbers.iter().map(number));
        self
    }

    /// Parses the document; syntax errors end the reading, since what follows them cannot be trusted.
    pub fn parse(&self, text: &str) -> Result<DocumentTable, Report> {
        let (root, errors) = DeTable::parse_recoverable(text);
        if errors.is_empty() {
            return Ok(DocumentTable::from_toml(root.get_ref()));
        }
        let diags = errors
            .iter()
            .map(|e| Diag {
                title: format!("not valid TOML: {}", e.message()),
                place: Place { source: 0, span: e.span().unwrap_or(0..0) },
                help: None,
            })
            .collect();
        Err(Report::new(self.sources.clone(), diags))
    }

    pub fn root<'a>(&'a self, root: &'a DocumentTable) -> TomlTable<'a> {
        TomlTable { reader: self, path: String::new(), table: Some(root), place: Place { source: 0, span: 0..0 } }
    }

    /// Ends the reading: unused overrides are mistakes; with any mistake there is no result.
    pub fn finish(self) -> Result<Places, Report> {
        let asked = self.asked.borrow();
        for o in self.overrides.iter().filter(|o| !o.used.get()) {
            let near = nearest(&o.path, asked.iter().map(String::as_str));
            self.diags.borrow_mut().push(Diag {
                title: format!("this drive has no value `{}`", o.path),
                place: Place { source: o.place.source, span: 0..o.path.len() },
                help: Some(match near {
                    Some(near) => format!("the nearest one is `{near}`"),
                    None => "`pitchline check DRIVE --json` lists all values".into(),
                }),
            });
        }
        drop(asked);
        let diags = self.diags.into_inner();
        if diags.is_empty() {
            let (places, numbers) = (self.places.into_inner(), self.numbers.into_inner());
            Ok(Places { sources: self.sources, places, numbers, within: String::new() })
        } else {
            Err(Report::new(self.sources, diags))
        }
    }

    fn error(&self, title: String, place: Place, help: Option<String>) {
        self.diags.borrow_mut().push(Diag { title, place, help });
    }
}

/// Where every value of a document stood, for checks that come later.
#[derive(Clone, Debug, PartialEq)]
pub struct Places {
    pub sources: Vec<SourceText>,
    places: BTreeMap<String, Place>,
    numbers: BTreeMap<String, FileNumber>,
    /// Path of the table whose values are looked for before those of the document.
    within: String,
}

impl Places {
    pub fn empty() -> Places {
        Places { sources: Vec::new(), places: BTreeMap::new(), numbers: BTreeMap::new(), within: String::new() }
    }

    /// The same where values of one chain of several stand in a table of its own.
    pub fn within(&self, table: &str) -> Places {
        Places { within: format!("{table}."), ..self.clone() }
    }

    /// A mistake at the value `path`, or at the nearest table above it.
    pub fn error(&self, path: &str, title: impl Into<String>, help: Option<String>) -> Diag {
        let inner = format!("{}{path}", self.within);
        let first = path.split('.').next().unwrap_or(path);
        let mut at =
            if self.places.keys().any(|p| p.starts_with(&format!("{}{first}", self.within))) { &inner } else { path };
        loop {
            if let Some(place) = self.places.get(at) {
                return Diag { title: title.into(), place: place.clone(), help };
            }
            match at.rfind('.') {
                Some(dot) => at = &at[..dot],
                None => return Diag { title: title.into(), place: Place { source: 0, span: 0..0 }, help },
            }
        }
    }

    /// Where the value `path` stands in the document itself.
    pub fn span(&self, path: &str) -> Option<std::ops::Range<usize>> {
        self.places.get(path).filter(|p| p.source == 0).map(|p| p.span.clone())
    }

    pub fn report(&self, diags: Vec<Diag>) -> Report {
        Report::new(self.sources.clone(), diags)
    }

    /// Every number that was given, by its path.
    pub fn numbers(&self) -> impl Iterator<Item = (&str, FileNumber)> {
        self.numbers.iter().map(|(path, number)| (path.as_str(), *number))
    }

    /// All paths that stand in the document.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.places.keys().map(String::as_str)
    }
}

/// Why a text is no override.
#[derive(Clone, Debug, PartialEq, Eq)]
enum OverrideError {
    NoEqualSign {
        given: String,
    },
    /// Nothing stands on one side of the equal sign.
    Incomplete {
        given: String,
    },
    NoTomlValue {
        value: String,
        why: String,
    },
}

impl std::fmt::Display for OverrideError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            OverrideError::NoEqualSign { given } => write!(f, "`{given}` has no `=`"),
            OverrideError::Incomplete { given } => write!(f, "`{given}` lacks a path or a value"),
            OverrideError::NoTomlValue { value, why } => write!(f, "`{value}` is no TOML value: {why}"),
        }
    }
}

impl std::error::Error for OverrideError {}

/// Path and value of an override, and where its value begins.
fn parse_override(given: &str) -> Result<(String, DocumentValue, usize), OverrideError> {
    let Some((path, value)) = given.split_once('=') else {
        return Err(OverrideError::NoEqualSign { given: given.to_string() });
    };
    let start = path.len() + 1;
    let (path, value) = (path.trim(), value.trim());
    if path.is_empty() || value.is_empty() {
        return Err(OverrideError::Incomplete { given: given.to_string() });
    }
    let parsed = match DeValue::parse(value) {
        Ok(v) => DocumentValue::from_toml(v.get_ref()),
        // A bare word is text.
        Err(_) if value.chars().all(|c| c.is_alphanumeric() || c == '_' || c == '-') => {
            DocumentValue::Text(value.to_string())
        }
        Err(e) => {
            return Err(OverrideError::NoTomlValue { value: value.to_string(), why: e.message().to_string() });
        }
    };
    Ok((path.to_string(), parsed, start))
}

impl<'a> TomlTable<'a> {
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Whether the file or an override has it.
    pub fn is_present(&self) -> bool {
        let holds = |path: &str| path.strip_prefix(self.path.as_str()).is_some_and(|rest| rest.starts_with('.'));
        self.table.is_some() || self.reader.overrides.iter().any(|o| holds(&o.path))
    }

    fn join(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_string() } else { format!("{}.{key}", self.path) }
    }

    /// A mistake about this table as a whole.
    pub fn error(&self, title: String, help: Option<String>) {
        self.reader.error(title, self.place.clone(), help);
    }

    /// Value and place of `key`: the override, else what the file says.
    fn value(&self, key: &str) -> Option<(&'a DocumentValue, Place)> {
        let path = self.join(key);
        self.reader.asked.borrow_mut().insert(path.clone());
        let in_file = self.table.and_then(|t| t.0.get(key));
        let found = if let Some(o) = self.reader.overrides.iter().rev().find(|o| o.path == path) {
            for o in self.reader.overrides.iter().filter(|o| o.path == path) {
                o.used.set(true);
            }
            // A number of a fit stands where the file has it.
            let span = in_file.filter(|_| o.place.source == 0).map(|v| v.span.clone());
            Some((&o.value, span.map_or_else(|| o.place.clone(), |span| Place { source: 0, span })))
        } else {
            in_file.map(|v| (&v.value, Place { source: 0, span: v.span.clone() }))
        };
        if let Some((_, place)) = &found {
            self.reader.places.borrow_mut().insert(path, place.clone());
        }
        found
    }

    /// Values of this table that mean something only with `wanted`: those that are given are mistakes.
    pub fn only_with(&self, keys: &[&str], wanted: &str) {
        for key in keys {
            if self.value(key).is_some() {
                self.error_at(key, format!("`{}` needs `{wanted}`", self.join(key)), None);
            }
        }
    }

    fn wrong_type(&self, key: &str, found: &DocumentValue, wanted: &str, place: Place) {
        let title = format!("`{}` is {}, expected {wanted}", self.join(key), found.type_name());
        self.reader.error(title, place, None);
    }

    fn missing(&self, key: &str, wanted: &str) {
        let path = self.join(key);
        let title = if self.is_present() {
            format!("`{path}` is missing")
        } else {
            format!("table `{}` is missing", self.path)
        };
        self.reader.error(title, self.place.clone(), Some(format!("add `{key} = ...` ({wanted})")));
    }

    /// A number in the unit of its name, times `unit`; inside `range` (in the unit of its name).
    pub fn number(&self, key: &str, unit: f64, range: RangeInclusive<f64>) -> Option<f64> {
        let (value, place) = self.value(key)?;
        if !matches!(value, DocumentValue::Number(_) | DocumentValue::Whole(..)) {
            self.wrong_type(key, value, "a number", place);
            return None;
        }
        let number = value.number();
        match number {
            Some(n) if range.contains(&n) => Some(self.keep_number(key, n, unit, (*range.start(), *range.end()))),
            _ => {
                let shown = number.map_or_else(|| "too large a number".to_string(), |n| n.to_string());
                let title = format!("`{}` = {shown} is outside {} ..= {}", self.join(key), range.start(), range.end());
                self.reader.error(title, place, None);
                None
            }
        }
    }

    /// Keeps a number, given in the unit of its key, for those who ask for all numbers; returns it in SI.
    fn keep_number(&self, key: &str, given: f64, unit: f64, (low, high): (f64, f64)) -> f64 {
        let value = given * unit;
        self.reader.numbers.borrow_mut().insert(self.join(key), FileNumber { value, unit, low, high });
        value
    }

    /// As [`TomlTable::number`]; absence is a mistake and gives NaN.
    pub fn required(&self, key: &str, unit: f64, range: RangeInclusive<f64>) -> f64 {
        let known = self.reader.diags.borrow().len();
        match self.number(key, unit, range.clone()) {
            Some(n) => n,
            None => {
                if self.reader.diags.borrow().len() == known {
                    self.missing(key, &format!("{} ..= {}", range.start(), range.end()));
                }
                f64::NAN
            }
        }
    }

    /// A whole number inside `range`.
    pub fn integer(&self, key: &str, range: RangeInclusive<i64>) -> Option<i64> {
        let (value, place) = self.value(key)?;
        let DocumentValue::Whole(number, digits) = value else {
            self.wrong_type(key, value, "a whole number", place);
            return None;
        };
        match number {
            Some(n) if range.contains(n) => {
                self.keep_number(key, *n as f64, 1.0, (*range.start() as f64, *range.end() as f64));
                Some(*n)
            }
            _ => {
                let title = format!("`{}` = {digits} is outside {} ..= {}", self.join(key), range.start(), range.end());
                self.reader.error(title, place, None);
                None
            }
        }
    }

    pub fn required_integer(&self, key: &str, range: RangeInclusive<i64>) -> i64 {
        let known = self.reader.diags.borrow().len();
        self.integer(key, range.clone()).unwrap_or_else(|| {
            if self.reader.diags.borrow().len() == known {
                self.missing(key, &format!("{} ..= {}", range.start(), range.end()));
            }
            *range.start()
        })
    }

    pub fn text(&self, key: &str) -> Option<String> {
        let (value, place) = self.value(key)?;
        match value {
            DocumentValue::Text(s) => Some(s.clone()),
            other => {
                self.wrong_type(key, other, "a text in quotes", place);
                None
            }
        }
    }

    /// One of `names`.
    pub fn choice<T: Copy>(&self, key: &str, names: &[(&str, T)]) -> Option<T> {
        let text = self.text(key)?;
        if let Some((_, value)) = names.iter().find(|(name, _)| *name == text) {
            return Some(*value);
        }
        let place = self.value(key).map_or_else(|| self.place.clone(), |(_, place)| place);
        let all = names.iter().map(|(n, _)| format!("\"{n}\"")).collect::<Vec<_>>().join(", ");
        let help = nearest(&text, names.iter().map(|(n, _)| *n)).map(|n| format!("did you mean \"{n}\"?"));
        self.reader.error(format!("`{}` = \"{text}\" is none of {all}", self.join(key)), place, help);
        None
    }

    /// Whether `key` is given.
    pub fn has(&self, key: &str) -> bool {
        self.value(key).is_some()
    }

    /// A list of numbers, each as [`TomlTable::number`] takes it.
    pub fn list(&self, key: &str, unit: f64, range: RangeInclusive<f64>) -> Option<Vec<f64>> {
        let (value, place) = self.value(key)?;
        let DocumentValue::List(items) = value else {
            self.wrong_type(key, value, "a list of numbers", place);
            return None;
        };
        let mut out = Vec::new();
        for item in items {
            match item.value.number().filter(|n| range.contains(n)) {
                Some(n) => out.push(n * unit),
                None => {
                    // What stands in an override is the whole of its value.
                    let place = if place.source == 0 { Place { source: 0, span: item.span.clone() } } else { place };
                    let (low, high) = (range.start(), range.end());
                    let title = format!("`{}` holds something that is no number in {low} ..= {high}", self.join(key));
                    self.reader.error(title, place, None);
                    return None;
                }
            }
        }
        Some(out)
    }

    /// A list of texts.
    pub fn texts(&self, key: &str) -> Option<Vec<String>> {
        let (value, place) = self.value(key)?;
        let DocumentValue::List(array) = value else {
            self.wrong_type(key, value, "a list", place);
            return None;
        };
        let mut texts = Vec::new();
        for item in array.iter() {
            match &item.value {
                DocumentValue::Text(s) => texts.push(s.clone()),
                other => {
                    let place = Place { source: place.source, span: item.span.clone() };
                    self.wrong_type(key, other, "a list of texts", place);
                }
            }
        }
        Some(texts)
    }

    /// A list of numbers, texts, and true or false.
    pub fn scalars(&self, key: &str) -> Option<Vec<DocumentValue>> {
        let (value, place) = self.value(key)?;
        let DocumentValue::List(items) = value else {
            self.wrong_type(key, value, "a list", place);
            return None;
        };
        let is_scalar = |v: &DocumentValue| {
            v.number().is_some_and(f64::is_finite) || matches!(v, DocumentValue::Text(_) | DocumentValue::Flag(_))
        };
        if let Some(wrong) = items.iter().find(|item| !is_scalar(&item.value)) {
            let place = Place { source: place.source, span: wrong.span.clone() };
            self.wrong_type(key, &wrong.value, "a list of numbers, texts, true or false", place);
            return None;
        }
        Some(items.iter().map(|item| item.value.clone()).collect())
    }

    /// The table `key`, present or not.
    pub fn table(&self, key: &str) -> TomlTable<'a> {
        let path = self.join(key);
        let absent = TomlTable { reader: self.reader, path: path.clone(), table: None, place: self.place.clone() };
        let Some(entry) = self.table.and_then(|t| t.0.get(key)) else {
            // Values below it may still come from overrides.
            self.reader.asked.borrow_mut().insert(path);
            return absent;
        };
        let place = Place { source: 0, span: entry.span.clone() };
        self.reader.asked.borrow_mut().insert(path.clone());
        self.reader.places.borrow_mut().insert(path, place.clone());
        match &entry.value {
            DocumentValue::Table(t) => TomlTable { table: Some(t), place, ..absent },
            other => {
                self.wrong_type(key, other, "a table", place);
                absent
            }
        }
    }

    /// The tables inside this one, in the order of the file.
    pub fn tables(&self) -> Vec<(String, TomlTable<'a>)> {
        let Some(table) = self.table else { return Vec::new() };
        table.keys_in_order().into_iter().map(|key| (key.to_string(), self.table(key))).collect()
    }

    /// As [`TomlTable::tables`], and those that only overrides name: effects are added to a drive that way.
    pub fn tables_or_set(&self) -> Vec<(String, TomlTable<'a>)> {
        let mut all = self.tables();
        let prefix = format!("{}.", self.path);
        for o in &self.reader.overrides {
            let name = o.path.strip_prefix(&prefix).and_then(|rest| rest.split_once('.')).map(|(name, _)| name);
            if let Some(name) = name.filter(|name| all.iter().all(|(known, _)| known != name)) {
                all.push((name.to_string(), TomlTable { place: o.place.clone(), ..self.table(name) }));
            }
        }
        all
    }

    /// Every key of this table with its number, in the order of the file; what is no number is a mistake.
    pub fn numbers(&self) -> Vec<(String, f64)> {
        let Some(table) = self.table else { return Vec::new() };
        let read = |key: &str| self.number(key, 1.0, -1e300..=1e300).map(|n| (key.to_string(), n));
        table.keys_in_order().into_iter().filter_map(read).collect()
    }

    /// A mistake at the value `key`.
    pub fn error_at(&self, key: &str, title: String, help: Option<String>) {
        let place = self.value(key).map_or_else(|| self.place.clone(), |(_, place)| place);
        self.reader.error(title, place, help);
    }

    /// True or false.
    pub fn flag(&self, key: &str) -> Option<bool> {
        let (value, place) = self.value(key)?;
        match value {
            DocumentValue::Flag(b) => Some(*b),
            other => {
                self.wrong_type(key, other, "true or false", place);
                None
            }
        }
    }

    /// Ends the reading of this table: keys that nobody asked for are mistakes.
    pub fn finish(&self) {
        let Some(table) = self.table else { return };
        let asked = self.reader.asked.borrow();
        let prefix = if self.path.is_empty() { String::new() } else { format!("{}.", self.path) };
        let known: Vec<&str> = asked
            .iter()
            .filter_map(|p| p.strip_prefix(prefix.as_str()))
            .filter(|rest| !rest.is_empty() && !rest.contains('.'))
            .collect();
        for (name, entry) in &table.0 {
            let name = name.as_str();
            // A quoted key may hold dots.
            if known.contains(&name) || asked.contains(&self.join(name)) {
                continue;
            }
            let title = format!("unknown key `{}`", self.join(name));
            let place = Place { source: 0, span: entry.key_span.clone() };
            self.reader.diags.borrow_mut().push(Diag { title, place, help: Some(suggestion(name, &known)) });
        }
    }
}

/// What to write instead of the unknown key `name`.
fn suggestion(name: &str, known: &[&str]) -> String {
    let stem =
        |s: &str| UNIT_SUFFIXES.iter().find_map(|u| s.strip_suffix(u).map(str::to_string)).unwrap_or(s.to_string());
    if let Some(same) = known.iter().find(|k| stem(k) == stem(name) && !stem(name).is_empty()) {
        return format!("the unit is part of the name: write `{same}`");
    }
    match nearest(name, known.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("known here: {}", known.join(", ")),
    }
}

/// Endings that carry a unit, longest first.
const UNIT_SUFFIXES: [&str; 30] = [
    "_n_s_per_m",
    "_n_per_m_n",
    "_n_per_mm",
    "_n_per_um",
    "_n_per_m",
    "_kg_per_m3",
    "_kg_mm2",
    "_kg_m2",
    "_g_mm2",
    "_rad_s",
    "_m_s",
    "_gpa",
    "_rpm",
    "_deg",
    "_rad",
    "_kg",
    "_nm",
    "_mm",
    "_um",
    "_us",
    "_ms",
    "_hz",
    "_in",
    "_cm",
    "_kn",
    "_g",
    "_n",
    "_m",
    "_s",
    "_pa",
];
