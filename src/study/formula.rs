//! Formulas over responses and factors, such as `touch / turning < 0.03`.
//!
//! Parsed by the crate exmex; its operators are given here: their functions come from libm, which has the same bits on every CPU. A comparison
//! gives 1 or 0, and a number other than 0 counts as true; what is compared with a missing value is missing.

use exmex::{BinOp, Express, FlatEx, MakeOperators, MatchLiteral, Operator, literal_matcher_from_pattern};

/// The operators of formulas.
#[derive(Clone, Debug)]
struct FormulaOperators;

impl MakeOperators<f64> for FormulaOperators {
    fn make<'a>() -> Vec<Operator<'a, f64>> {
        let two = |repr, prio, is_commutative, apply| Operator::make_bin(repr, BinOp { apply, prio, is_commutative });
        let mut all = vec![
            two("||", 0, true, |a, b| known(a, b, a != 0.0 || b != 0.0)),
            two("&&", 1, true, |a, b| known(a, b, a != 0.0 && b != 0.0)),
            two("==", 2, true, |a, b| known(a, b, a == b)),
            two("!=", 2, true, |a, b| known(a, b, a != b)),
            two("<", 2, false, |a, b| known(a, b, a < b)),
            two("<=", 2, false, |a, b| known(a, b, a <= b)),
            two(">", 2, false, |a, b| known(a, b, a > b)),
            two(">=", 2, false, |a, b| known(a, b, a >= b)),
            two("*", 4, true, |a, b| a * b),
            two("/", 5, false, |a, b| a / b),
            two("^", 6, false, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { libm::pow(a, b) }),
            two("min", 7, true, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.min(b) }),
            two("max", 7, true, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }),
        ];
        all.push(Operator::make_bin_unary("+", BinOp { apply: |a, b| a + b, prio: 3, is_commutative: true }, |a| a));
        all.push(Operator::make_bin_unary("-", BinOp { apply: |a, b| a - b, prio: 3, is_commutative: false }, |a| -a));
        all.push(Operator::make_unary("abs", f64::abs));
        all.push(Operator::make_unary("sqrt", libm::sqrt));
        all.push(Operator::make_unary("exp", libm::exp));
        all.push(Operator::make_unary("log", libm::log));
        all.push(Operator::make_unary("log10", libm::log10));
        all.push(Operator::make_constant("pi", std::f64::consts::PI));
        all
    }
}

// Numbers as a study file writes them, with an exponent if wanted.
literal_matcher_from_pattern!(FormulaNumbers, r"^([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?");

/// 1 or 0; missing where an operand is.
fn known(a: f64, b: f64, is: bool) -> f64 {
    match (a.is_nan() || b.is_nan(), is) {
        (true, _) => f64::NAN,
        (false, true) => 1.0,
        (false, false) => 0.0,
    }
}

/// Functions and numbers that have names.
pub const FORMULA_WORDS: [&str; 8] = ["min", "max", "abs", "sqrt", "exp", "log", "log10", "pi"];

/// Names in braces, as exmex takes any text: otherwise it reads `max_force` as `max` of `_force`.
fn with_names_marked(text: &str) -> String {
    let (mut out, mut rest) = (String::new(), text);
    while let Some(c) = rest.chars().next() {
        let is_word = c.is_alphabetic() || c == '_';
        let is_number = c.is_ascii_digit() || c == '.';
        let ends = |(i, c): &(usize, char)| {
            let before = rest.get(..*i).unwrap_or_default();
            let is_sign_of_exponent = matches!(c, '+' | '-') && is_number && before.ends_with(['e', 'E']);
            !(c.is_alphanumeric() || *c == '_' || is_number && *c == '.' || is_sign_of_exponent)
        };
        let end = match is_word || is_number {
            true => rest.char_indices().find(ends).map_or(rest.len(), |(i, _)| i),
            false => c.len_utf8(),
        };
        let (word, after) = rest.split_at(end);
        let is_name = is_word && !FORMULA_WORDS.contains(&word);
        out += &if is_name { format!("{{{word}}}") } else { word.to_string() };
        rest = after;
    }
    out
}

/// A formula that was parsed.
#[derive(Clone)]
pub struct Formula {
    pub text: String,
    /// 19 KB by itself.
    parsed: Box<FlatEx<f64, FormulaOperators, FormulaNumbers>>,
}

impl std::fmt::Debug for Formula {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

impl PartialEq for Formula {
    fn eq(&self, other: &Formula) -> bool {
        self.text == other.text
    }
}

impl Formula {
    /// # Errors
    /// It is no formula: why, in a sentence.
    pub fn parse(text: &str) -> Result<Formula, String> {
        // exmex speaks of its own parts; what a user can see is where the formula does not go on.
        match FlatEx::parse(&with_names_marked(text)) {
            Ok(parsed) if !text.contains(['{', '}']) => {
                Ok(Formula { text: text.to_string(), parsed: Box::new(parsed) })
            }
            Ok(_) | Err(_) => {
                Err(format!("`{text}` is no formula: an operand, an operator or a bracket is missing or too much"))
            }
        }
    }

    /// Names that it asks for.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.parsed.var_names().iter().map(String::as_str)
    }

    /// Its value, given that of every name; NaN where one is missing.
    pub fn value(&self, value_of: impl Fn(&str) -> f64) -> f64 {
        let values: Vec<f64> = self.names().map(value_of).collect();
        self.parsed.eval(&values).unwrap_or(f64::NAN)
    }

    /// Whether it is fulfilled: a missing value is not.
    pub fn holds(&self, value_of: impl Fn(&str) -> f64) -> bool {
        let value = self.value(value_of);
        !value.is_nan() && value != 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> f64 {
        let value = |name: &str| match name {
            "a" => 3.0,
            "b" => -2.0,
            "max_force" => 5.0,
            "log10_of" => 7.0,
            _ => f64::NAN,
        };
        Formula::parse(text).expect("a formula").value(value)
    }

    #[test]
    fn operators_bind_as_usual() {
        for (text, value) in [
            ("a + 2 * b", -1.0),
            ("-a ^ 2 + 1 / 4", 9.25),
            ("(a + b) * 2 - 1", 1.0),
            ("8 / 2 / 2 * 3", 6.0),
            ("8 - 2 - 3", 3.0),
            ("max(a, b) + min(a, b) * 2", -1.0),
            ("abs(b) + sqrt(4)", 4.0),
            ("a > 2 && b > 0 || a == 3", 1.0),
            ("a < 2 && b < 0", 0.0),
            ("1 + 1 < 3 && 2 * 2 >= 4", 1.0),
            ("1e3 * 2.5E-3", 2.5),
            ("2.*.5-1", 0.0),
            ("max_force + max(log10_of, 1e-1) * 2", 19.0),
        ] {
            assert_eq!(of(text), value, "{text}");
        }
        assert!(of("c > 1").is_nan() && of("max(c, 1)").is_nan() && of("c ^ 0").is_nan());
        assert!(Formula::parse("a +* ").is_err() && Formula::parse("(a").is_err());
    }
}
