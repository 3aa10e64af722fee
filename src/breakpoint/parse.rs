//! Parser of break expressions.
//!
//! ```text
//! or  = and { ("or" | "||") and }        and = not { ("and" | "&&") not }        not = ["not" | "!"] ("(" or ")" | comparison)
//! comparison = side (">" | ">=" | "<" | "<=" | "==" | "!=") side
//! side = number [unit] | "name" | quantity | abs(quantity)
//! quantity = contact.X | impact.X | link.X | link[12].X | joint[3].X | sprocket.NAME.X (or another scope with a name) |
//!            touch.NAME.PART.X | energy.X | time | step | crank_angle
//! ```

use super::quantities::{Dimension, QUANTITIES, Quantity, Scope, UNITS, What};
use super::{Compare, Expr, Names, Number, Operator};
use crate::diag::{Diag, Place, Report, SourceText, nearest};
use crate::recording::columns::Rows;
use crate::recording::frame::{Feature, Segment};
use std::ops::Range;

/// Longest expression [bytes], and deepest nesting of parentheses.
const MAX_LENGTH: usize = 4096;
const MAX_DEPTH: usize = 64;

/// One side of a comparison, before the other side is known.
enum ComparisonSide {
    /// Value in SI; None: written without a unit.
    Literal(f64, Option<Dimension>),
    Name(String),
    Quantity(Number, &'static Quantity),
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
    names: &'a Names,
}

type Parsed<T> = Result<T, Diag>;

pub fn parse(text: &str, names: &Names) -> Result<Expr, Report> {
    let mut parser = Parser { text, at: 0, depth: 0, names };
    let parsed = if text.len() > MAX_LENGTH {
        Err(parser.error(0..0, format!("a break expression has at most {MAX_LENGTH} characters"), None))
    } else {
        parser.expression()
    };
    parsed.map_err(|diag| {
        // The caret needs a character to point at.
        Report::new(vec![SourceText { name: "--break".into(), text: format!("{text} ") }], vec![diag])
    })
}

/// One quantity, as an expression names it, and nothing else.
pub fn quantity(text: &str, names: &Names) -> Result<(Number, &'static Quantity), Report> {
    let mut parser = Parser { text, at: 0, depth: 0, names };
    let parsed = if text.len() > MAX_LENGTH {
        Err(parser.error(0..0, format!("a quantity has at most {MAX_LENGTH} characters"), None))
    } else {
        parser.quantity().and_then(|found| {
            parser.space();
            let word = parser.word_here();
            if parser.at < text.len() {
                Err(parser.error(word, "the quantity should end here".into(), None))
            } else {
                Ok(found)
            }
        })
    };
    parsed
        .map_err(|diag| Report::new(vec![SourceText { name: "quantity".into(), text: format!("{text} ") }], vec![diag]))
}

/// An error of the expression as a whole.
pub fn refused(text: &str, title: &str, help: &str) -> Report {
    let place = Place { source: 0, span: 0..text.len() };
    let diag = Diag { title: title.to_string(), place, help: Some(help.to_string()) };
    Report::new(vec![SourceText { name: "--break".into(), text: text.to_string() }], vec![diag])
}

impl Parser<'_> {
    fn expression(&mut self) -> Parsed<Expr> {
        let expr = self.any()?;
        self.space();
        if self.at < self.text.len() {
            let word = self.word_here();
            return Err(self.error(word, "the expression should end here, or go on with `and` or `or`".into(), None));
        }
        Ok(expr)
    }

    fn any(&mut self) -> Parsed<Expr> {
        let mut parts = vec![self.all()?];
        while self.takes_word("or") || self.takes("||") {
            parts.push(self.all()?);
        }
        Ok(if parts.len() == 1 { parts.remove(0) } else { Expr::Any(parts) })
    }

    fn all(&mut self) -> Parsed<Expr> {
        let mut parts = vec![self.not()?];
        while self.takes_word("and") || self.takes("&&") {
            parts.push(self.not()?);
        }
        Ok(if parts.len() == 1 { parts.remove(0) } else { Expr::All(parts) })
    }

    fn not(&mut self) -> Parsed<Expr> {
        if self.takes_word("not") || (!self.next_is("!=") && self.takes("!")) {
            self.deeper()?;
            let inner = self.not()?;
            self.depth -= 1;
            return Ok(Expr::Not(Box::new(inner)));
        }
        if self.takes("(") {
            self.deeper()?;
            let inner = self.any()?;
            self.depth -= 1;
            if !self.takes(")") {
                return Err(self.error(
                    self.word_here(),
                    "a bracket is not closed here".into(),
                    Some("add `)`".into()),
                ));
            }
            return Ok(inner);
        }
        self.comparison()
    }

    fn deeper(&mut self) -> Parsed<()> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(self.error(self.word_here(), format!("more than {MAX_DEPTH} brackets deep"), None));
        }
        Ok(())
    }

    fn comparison(&mut self) -> Parsed<Expr> {
        self.space();
        let start = self.at;
        let left = self.side()?;
        let left_place = start..self.at;
        self.space();
        let signs = [
            (">=", Operator::AtLeast),
            ("<=", Operator::AtMost),
            ("==", Operator::Equal),
            ("!=", Operator::Unequal),
            (">", Operator::Above),
            ("<", Operator::Below),
        ];
        let Some((_, operator)) = signs.into_iter().find(|(sign, _)| self.takes(sign)) else {
            let help = if self.next_is("=") { "equality is written `==`" } else { "one of > >= < <= == !=" };
            return Err(self.error(self.word_here(), "a comparison is expected here".into(), Some(help.into())));
        };
        self.space();
        let start = self.at;
        let right = self.side()?;
        let right_place = start..self.at;
        self.join((left, left_place), operator, (right, right_place))
    }

    /// Checks the dimensions of both sides.
    fn join(
        &self,
        (left, left_place): (ComparisonSide, Range<usize>),
        operator: Operator,
        (right, right_place): (ComparisonSide, Range<usize>),
    ) -> Parsed<Expr> {
        match (left, right) {
            (ComparisonSide::Quantity(number, quantity), ComparisonSide::Name(name)) => {
                self.name(number, quantity, operator, &name, right_place)
            }
            (ComparisonSide::Name(name), ComparisonSide::Quantity(number, quantity)) => {
                self.name(number, quantity, operator, &name, left_place)
            }
            (ComparisonSide::Quantity(left, a), ComparisonSide::Quantity(right, b)) => {
                if a.dimension != b.dimension || a.dimension == Dimension::Name {
                    let title = format!("{} cannot be compared with {}", a.dimension.name(), b.dimension.name());
                    return Err(self.error(right_place, title, None));
                }
                Ok(Expr::Compare(Compare::Numbers { left, operator, right }))
            }
            (ComparisonSide::Quantity(left, quantity), ComparisonSide::Literal(value, unit)) => {
                self.check_unit(quantity, unit, right_place)?;
                Ok(Expr::Compare(Compare::Numbers { left, operator, right: Number::Constant(value) }))
            }
            (ComparisonSide::Literal(value, unit), ComparisonSide::Quantity(right, quantity)) => {
                self.check_unit(quantity, unit, left_place)?;
                Ok(Expr::Compare(Compare::Numbers { left: Number::Constant(value), operator, right }))
            }
            (
                ComparisonSide::Literal(..) | ComparisonSide::Name(_),
                ComparisonSide::Literal(..) | ComparisonSide::Name(_),
            ) => {
                let help = "compare a quantity, e.g. `contact.normal_force > 500 N`";
                Err(self.error(left_place.start..right_place.end, "this never changes".into(), Some(help.into())))
            }
        }
    }

    fn check_unit(&self, quantity: &Quantity, unit: Option<Dimension>, place: Range<usize>) -> Parsed<()> {
        let wanted = quantity.dimension;
        let name = shown(quantity);
        if wanted == Dimension::Name {
            return Err(self.error(place, format!("`{name}` is compared with a name in quotes"), None));
        }
        match unit {
            Some(given) if given == wanted => Ok(()),
            None if wanted == Dimension::Number => Ok(()),
            None => {
                let help = format!("write its unit: {}", wanted.units());
                Err(self.error(place, format!("`{name}` is {}, and this has no unit", wanted.name()), Some(help)))
            }
            Some(given) => {
                let help = match wanted.units() {
                    units if units.is_empty() => "write a plain number".to_string(),
                    units => format!("units for it: {units}"),
                };
                let title = format!("`{name}` is {}, and this is {}", wanted.name(), given.name());
                Err(self.error(place, title, Some(help)))
            }
        }
    }

    /// A comparison with the name of a body, a feature or a segment.
    fn name(
        &self,
        number: Number,
        quantity: &Quantity,
        operator: Operator,
        name: &str,
        place: Range<usize>,
    ) -> Parsed<Expr> {
        let known: Vec<String> = match quantity.what {
            What::Body => self.names.bodies.clone(),
            What::Feature => Feature::NAMES.map(str::to_string).to_vec(),
            What::Segment => Segment::NAMES.map(str::to_string).to_vec(),
            _ => {
                let title = format!("`{}` is {}, and this is a name", shown(quantity), quantity.dimension.name());
                return Err(self.error(place, title, None));
            }
        };
        let wanted = name.replace('_', " ");
        let fits = |known: &String| {
            let last = crate::diag::last_name(known);
            *known == name || last == name || known.replace('_', " ") == wanted
        };
        let set: Vec<u32> = (0..known.len()).filter(|i| fits(&known[*i])).map(|i| i as u32).collect();
        if set.is_empty() {
            let lasts = known.iter().map(|k| crate::diag::last_name(k));
            let help = match nearest(name, lasts.chain(known.iter().map(String::as_str))) {
                Some(near) => format!("did you mean \"{near}\"?"),
                None => format!("there are: {}", known.join(", ")),
            };
            return Err(self.error(place, format!("no {} is called \"{name}\"", quantity.name), Some(help)));
        }
        let member = match operator {
            Operator::Equal => true,
            Operator::Unequal => false,
            Operator::Above | Operator::AtLeast | Operator::Below | Operator::AtMost => {
                return Err(self.error(place, "names are equal (`==`) or not (`!=`)".into(), None));
            }
        };
        let Number::Quantity { quantity, .. } = number else {
            return Err(self.error(place, "a name has no absolute value".into(), None));
        };
        Ok(Expr::Compare(Compare::Name { quantity, set, member }))
    }

    fn side(&mut self) -> Parsed<ComparisonSide> {
        self.space();
        let rest = &self.text[self.at..];
        let first = rest.chars().next();
        match first {
            Some('"' | '\'') => self.quoted(),
            Some(c) if c.is_ascii_digit() || matches!(c, '-' | '+' | '.') => self.literal(),
            Some(c) if c.is_ascii_alphabetic() => {
                if self.takes("abs(") {
                    let inner = self.quantity()?;
                    if !self.takes(")") {
                        return Err(self.error(self.word_here(), "`abs(` is not closed here".into(), None));
                    }
                    return Ok(match inner {
                        (Number::Quantity { quantity, index, .. }, row) if row.dimension != Dimension::Name => {
                            ComparisonSide::Quantity(Number::Quantity { quantity, index, absolute: true }, row)
                        }
                        (number, row) => ComparisonSide::Quantity(number, row),
                    });
                }
                let (number, quantity) = self.quantity()?;
                Ok(ComparisonSide::Quantity(number, quantity))
            }
            _ => Err(self.error(
                self.word_here(),
                "a quantity, a number or a name is expected here".into(),
                Some("e.g. `contact.penetration > 8 um`".into()),
            )),
        }
    }

    fn quoted(&mut self) -> Parsed<ComparisonSide> {
        let rest = &self.text[self.at..];
        let quote = &rest[..1];
        match rest[1..].find(quote) {
            Some(end) => {
                let name = rest[1..1 + end].to_string();
                self.at += end + 2;
                Ok(ComparisonSide::Name(name))
            }
            None => Err(self.error(self.at..self.text.len(), "this name does not end".into(), None)),
        }
    }

    fn literal(&mut self) -> Parsed<ComparisonSide> {
        let rest = &self.text[self.at..];
        let bytes = rest.as_bytes();
        let mut end = 0;
        while end < bytes.len() {
            let exponent = end > 0 && matches!(bytes[end - 1], b'e' | b'E');
            let sign = matches!(bytes[end], b'-' | b'+') && (end == 0 || exponent);
            // An `e` belongs to the number if digits follow.
            let power = matches!(bytes[end], b'e' | b'E')
                && bytes.get(end + 1).is_some_and(|b| b.is_ascii_digit() || matches!(b, b'-' | b'+'));
            if !(bytes[end].is_ascii_digit() || bytes[end] == b'.' || sign || power) {
                break;
            }
            end += 1;
        }
        let start = self.at;
        let value = rest[..end].parse::<f64>().ok().filter(|v| v.is_finite());
        let Some(value) = value else {
            return Err(self.error(start..start + end.max(1), "this is no number".into(), None));
        };
        self.at += end;
        let before_unit = self.at;
        self.space();
        let rest = &self.text[self.at..];
        let ends = |after: &str| !after.starts_with(|c: char| c.is_alphanumeric() || c == '/' || c == '_');
        let unit = UNITS.iter().find(|(name, ..)| rest.strip_prefix(name).is_some_and(ends));
        if let Some((name, dimension, factor)) = unit {
            self.at += name.len();
            return Ok(ComparisonSide::Literal(value * factor, Some(*dimension)));
        }
        let word = self.word_here();
        let next = self.text.get(word.clone()).unwrap_or_default().to_string();
        // A word followed by a dot or a bracket is another quantity.
        let is_quantity = self.text.get(word.end..).is_some_and(|rest| rest.starts_with(['.', '[']));
        if next.starts_with(|c: char| c.is_alphabetic()) && !["and", "or"].contains(&next.as_str()) && !is_quantity {
            let help = nearest(&next, UNITS.iter().map(|(name, ..)| *name)).map(|u| format!("did you mean `{u}`?"));
            let all = || UNITS.iter().map(|u| u.0).filter(|u| u.is_ascii()).collect::<Vec<_>>().join(", ");
            let help = help.unwrap_or_else(|| format!("known units: {}", all()));
            return Err(self.error(word, format!("unknown unit `{next}`"), Some(help)));
        }
        self.at = before_unit;
        Ok(ComparisonSide::Literal(value, None))
    }

    fn quantity(&mut self) -> Parsed<(Number, &'static Quantity)> {
        self.space();
        let start = self.at;
        let word = self.identifier();
        let scope = Scope::ALL.into_iter().find(|s| s.name() == word);
        let Some(scope) = scope else {
            return match row(Scope::Run, &word) {
                Some(quantity) => Ok((number(quantity, None), quantity)),
                None => Err(self.unknown(start..self.at, &word)),
            };
        };
        let index = self.index(scope)?;
        if !self.takes(".") {
            let help = format!("e.g. `{}`", QUANTITIES.iter().find(|q| q.scope == scope).map_or(String::new(), shown));
            return Err(self.error(self.word_here(), format!("`{word}` needs a quantity"), Some(help)));
        }
        let name_at = self.at;
        let name = self.identifier();
        match row(scope, &name) {
            Some(quantity) => Ok((number(quantity, index), quantity)),
            None => {
                let known = QUANTITIES.iter().filter(|q| q.scope == scope).map(|q| q.name);
                let help = match nearest(&name, known.clone()) {
                    Some(near) => format!("did you mean `{word}.{near}`?"),
                    None => format!("a {word} has: {}", known.collect::<Vec<_>>().join(", ")),
                };
                Err(self.error(
                    name_at..self.at.max(name_at + 1),
                    format!("{} {word} has no `{name}`", if word == "arm" { "an" } else { "a" }),
                    Some(help),
                ))
            }
        }
    }

    /// `[12]` of a link or joint, `.NAME` of what the drive file names.
    fn index(&mut self, scope: Scope) -> Parsed<Option<usize>> {
        if let Some((rows, _)) = scope.named_rows() {
            let kind = scope.name();
            let start = self.at;
            let named = self.takes(".");
            let name_at = self.at;
            let mut name = if named { self.identifier() } else { String::new() };
            // A part, and what of it touches.
            if rows == Rows::Touch && self.takes(".") {
                name = format!("{name}.{}", self.identifier());
            }
            let all = self.names.named(scope);
            if let Some((_, row)) = all.iter().find(|(own, _)| *own == name) {
                return Ok(Some(*row));
            }
            let known: Vec<String> = all.into_iter().map(|(own, _)| own).collect();
            let help = match nearest(&name, known.iter().map(String::as_str)) {
                Some(near) => format!("did you mean `{kind}.{near}`?"),
                None if known.is_empty() => {
                    format!("this drive has no {kind}{}", if rows == Rows::Touch { "es" } else { "s" })
                }
                None => format!("there are: {}", known.join(", ")),
            };
            let place = if named { name_at..self.at.max(name_at + 1) } else { start..start + 1 };
            return Err(self.error(place, format!("no {kind} is called `{name}`"), Some(help)));
        }
        if !matches!(scope, Scope::Link | Scope::Joint) || !self.takes("[") {
            return Ok(None);
        }
        let start = self.at;
        let digits = self.text[self.at..].bytes().take_while(u8::is_ascii_digit).count();
        self.at += digits;
        let index = self.text[start..self.at].parse::<usize>().ok();
        let closed = self.takes("]");
        match index {
            Some(i) if i < self.names.links() && closed => Ok(Some(i)),
            Some(i) if closed => {
                let title = format!("there is no {} {i}", scope.name());
                let help = format!("they are numbered 0 to {}", self.names.links().saturating_sub(1));
                Err(self.error(start..start + digits, title, Some(help)))
            }
            _ => Err(self.error(start..start + digits.max(1), "write an index, e.g. `link[12]`".into(), None)),
        }
    }

    fn unknown(&self, place: Range<usize>, word: &str) -> Diag {
        let all: Vec<String> = QUANTITIES.iter().map(shown).collect();
        let near = nearest(word, all.iter().map(String::as_str)).or_else(|| {
            let last = QUANTITIES.iter().find(|q| q.name == word).map(shown);
            last.and_then(|l| all.iter().find(|a| **a == l)).map(String::as_str)
        });
        let help = match near {
            Some(near) => format!("did you mean `{near}`?"),
            None => {
                let begin: Vec<&str> = Scope::ALL.iter().map(|s| s.name()).collect();
                format!("quantities begin with {}, or are time, step, crank_angle", begin.join(", "))
            }
        };
        self.error(place, format!("unknown quantity `{word}`"), Some(help))
    }

    fn identifier(&mut self) -> String {
        let rest = &self.text[self.at..];
        let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == '-')).unwrap_or(rest.len());
        self.at += end;
        rest[..end].to_string()
    }

    fn space(&mut self) {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
    }

    fn next_is(&mut self, sign: &str) -> bool {
        self.space();
        self.text[self.at..].starts_with(sign)
    }

    fn takes(&mut self, sign: &str) -> bool {
        let found = self.next_is(sign);
        if found {
            self.at += sign.len();
        }
        found
    }

    fn takes_word(&mut self, word: &str) -> bool {
        let rest = if self.next_is(word) { &self.text[self.at + word.len()..] } else { return false };
        let whole = !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_' || c == '.' || c == '[');
        if whole {
            self.at += word.len();
        }
        whole
    }

    /// The word or sign at this position, or the end.
    fn word_here(&self) -> Range<usize> {
        let rest = &self.text[self.at..];
        let skipped = rest.len() - rest.trim_start().len();
        let start = self.at + skipped;
        let rest = &self.text[start..];
        let word = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
        let one = rest.chars().next().map_or(1, char::len_utf8);
        start..start + word.max(one)
    }

    fn error(&self, span: Range<usize>, title: String, help: Option<String>) -> Diag {
        Diag { title, place: Place { source: 0, span }, help }
    }
}

fn row(scope: Scope, name: &str) -> Option<&'static Quantity> {
    QUANTITIES.iter().find(|q| q.scope == scope && q.name == name)
}

fn number(quantity: &'static Quantity, index: Option<usize>) -> Number {
    Number::Quantity { quantity, index, absolute: false }
}

fn shown(quantity: &Quantity) -> String {
    match quantity.scope {
        Scope::Run => quantity.name.to_string(),
        scope => match scope.named_rows() {
            Some((Rows::Touch, _)) => format!("{}.NAME.PART.{}", scope.name(), quantity.name),
            Some(_) => format!("{}.NAME.{}", scope.name(), quantity.name),
            None => format!("{}.{}", scope.name(), quantity.name),
        },
    }
}
