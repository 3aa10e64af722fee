//! A file as it was parsed: its values, as numbers and texts, with their places. It is read as often as a fit wants, each time with
//! other numbers, and parsed once.

use std::collections::BTreeMap;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A value of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum DocumentValue {
    Text(String),
    /// A whole number as its digits; None: it does not fit 64 bits.
    Whole(Option<i64>, String),
    Number(f64),
    Flag(bool),
    Date,
    List(Vec<DocumentEntry>),
    Table(DocumentTable),
}

/// A value at its place, and the place of its key (of the value itself where it has none).
#[derive(Clone, Debug, PartialEq)]
pub struct DocumentEntry {
    pub key_span: Range<usize>,
    pub span: Range<usize>,
    pub value: DocumentValue,
}

/// Values by their keys.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DocumentTable(pub BTreeMap<String, DocumentEntry>);

/// Largest number that is written without a point, as [`DocumentValue::from_number`] has it.
const LARGEST_WHOLE: f64 = 1e9;

impl DocumentValue {
    /// A number as a file would write it: whole ones without a point, so that keys for whole numbers take them.
    pub fn from_number(x: f64) -> DocumentValue {
        if x == libm::trunc(x) && x.abs() < LARGEST_WHOLE {
            DocumentValue::Whole(Some(x as i64), format!("{}", x as i64))
        } else {
            DocumentValue::Number(x)
        }
    }

    /// What a TOML value says.
    pub fn from_toml(value: &DeValue<'_>) -> DocumentValue {
        match value {
            DeValue::String(s) => DocumentValue::Text(s.to_string()),
            DeValue::Integer(i) => {
                DocumentValue::Whole(i64::from_str_radix(i.as_str(), i.radix()).ok(), i.as_str().to_string())
            }
            DeValue::Float(f) => DocumentValue::Number(f.as_str().parse().unwrap_or(f64::NAN)),
            DeValue::Boolean(b) => DocumentValue::Flag(*b),
            DeValue::Datetime(_) => DocumentValue::Date,
            DeValue::Array(items) => {
                let entry = |v: &Spanned<DeValue<'_>>| DocumentEntry {
                    key_span: v.span(),
                    span: v.span(),
                    value: DocumentValue::from_toml(v.get_ref()),
                };
                DocumentValue::List(items.iter().map(entry).collect())
            }
            DeValue::Table(t) => DocumentValue::Table(DocumentTable::from_toml(t)),
        }
    }

    /// A number, whole or not; None: it is none, or too large a one.
    pub fn number(&self) -> Option<f64> {
        match self {
            DocumentValue::Number(x) => Some(*x),
            DocumentValue::Whole(n, _) => n.map(|n| n as f64),
            DocumentValue::Text(_)
            | DocumentValue::Flag(_)
            | DocumentValue::Date
            | DocumentValue::List(_)
            | DocumentValue::Table(_) => None,
        }
    }

    /// What it is, for messages.
    pub fn type_name(&self) -> &'static str {
        match self {
            DocumentValue::Text(_) => "a text",
            DocumentValue::Whole(..) => "a whole number",
            DocumentValue::Number(_) => "a number",
            DocumentValue::Flag(_) => "true or false",
            DocumentValue::Date => "a date",
            DocumentValue::List(_) => "a list",
            DocumentValue::Table(_) => "a table",
        }
    }
}

impl DocumentTable {
    pub fn from_toml(table: &DeTable<'_>) -> DocumentTable {
        let entries = table.iter().map(|(key, value)| {
            let own = DocumentValue::from_toml(value.get_ref());
            (key.get_ref().to_string(), DocumentEntry { key_span: key.span(), span: value.span(), value: own })
        });
        DocumentTable(entries.collect())
    }

    /// Keys in the order of the file.
    pub fn keys_in_order(&self) -> Vec<&str> {
        let mut keys: Vec<(&str, usize)> = self.0.iter().map(|(k, e)| (k.as_str(), e.key_span.start)).collect();
        keys.sort_by_key(|(_, start)| *start);
        keys.into_iter().map(|(key, _)| key).collect()
    }
}
