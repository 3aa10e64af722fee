//! Reading a study file, table by table.

use super::case::CaseLength;
use super::design::{MOST_CASES, StudyPlan};
use super::factor::{Factor, FactorScale, FactorValue, Spread};
use super::formula::{FORMULA_WORDS, Formula};
use super::sobol::MOST_DIMENSIONS;
use super::{Goal, KeepSpec, PlanSpec, Response, ResponseSource, SignalMeasure, Study, WORST_MARGIN};
use crate::drive::document::DocumentValue;
use crate::drive::reader::{Places, TomlTable};

/// Largest magnitude of a number of a study.
const LARGEST: f64 = 1e300;
const ANY: std::ops::RangeInclusive<f64> = -LARGEST..=LARGEST;

pub(super) fn study(root: &TomlTable<'_>) -> Study {
    let title = root.text("title").unwrap_or_default();
    let drives = root.texts("drives").unwrap_or_default();
    if drives.is_empty() {
        let help = "add `drives = [\"bush-20-40\"]`: bundled drives, or files beside this one";
        root.error_at("drives", "`drives` names no drive".into(), Some(help.into()));
    }
    if let Some(twice) = drives.iter().find(|name| drives.iter().filter(|other| other == name).count() > 1) {
        root.error_at("drives", format!("`drives` names `{twice}` twice"), None);
    }
    let set = root.texts("set").unwrap_or_default();
    let length = CaseLength {
        duration_s: root.required("duration_ms", 1e-3, 1e-3..=1e6),
        every_s: root.number("every_us", 1e-6, 1e-3..=1e6).unwrap_or(50e-6),
    };
    let factors: Vec<Factor> = root.table("factors").tables().iter().map(|(name, t)| factor(name, t)).collect();
    let responses = responses(root, &factors);
    let mut columns: Vec<String> =
        factors.iter().map(|f| if f.each_link { format!("{}_seed", f.name) } else { f.name.clone() }).collect();
    columns.extend(responses.iter().map(|r| r.name.clone()));
    columns.iter_mut().for_each(|name| name.make_ascii_lowercase());
    columns.sort();
    if let Some(name) = columns.windows(2).find(|pair| pair.first() == pair.last()).and_then(|pair| pair.first()) {
        root.error_at(
            "responses",
            format!("two columns of the results are called `{name}`, but for large and small letters"),
            None,
        );
    }
    let goal = goal(root, &factors, &responses);
    let plan = plan(root, &factors, goal.is_some());
    let keep = keep(root, &factors, &responses);
    root.finish();
    let (name, text, places) = (String::new(), String::new(), Places::empty());
    Study { name, text, title, drives, set, length, factors, plan, responses, keep, goal, places }
}

/// Whether a name can stand in formulas and as a column.
fn check_name(name: &str, table: &TomlTable<'_>) {
    let starts = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    if !starts || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
        let help = "names of factors and responses have letters, digits and `_`: formulas use them".to_string();
        table.error(format!("`{name}` is no name"), Some(help));
    }
    if RESERVED.iter().chain(&FORMULA_WORDS).any(|word| word.eq_ignore_ascii_case(name)) {
        table.error(format!("`{name}` is the name of a column, a function or a number of formulas"), None);
    }
}

/// Names that columns and formulas have already.
const RESERVED: [&str; 5] = ["case", "drive", "state_hash", "error", WORST_MARGIN];

fn factor(name: &str, table: &TomlTable<'_>) -> Factor {
    check_name(name, table);
    let mut paths: Vec<String> = table.text("path").into_iter().collect();
    paths.extend(table.texts("paths").unwrap_or_default());
    if paths.is_empty() {
        let help = "add `path = \"loads.constant.driven.torque_nm\"`, as `--set` calls it".to_string();
        table.error(format!("factor `{name}` sets no value of the drive"), Some(help));
    }
    let each_link = table.choice("each", &[("link", true)]).unwrap_or(false);
    for path in &paths {
        if each_link != path.contains('*') {
            let help = "`each = \"link\"` and a `*` for its name belong together: `path = \"effects.pitch_error.*.length_um\"`";
            table.error_at(
                "path",
                format!("factor `{name}`: one value for every link, or for all?"),
                Some(help.into()),
            );
        }
    }
    let whole = table.flag("whole").unwrap_or(false);
    let (spread, scale) = spread(name, table);
    let own = match &spread {
        Spread::Values(values) => values.len(),
        Spread::Uniform { .. } | Spread::Normal { .. } => 3,
    };
    let levels = table.integer("levels", 2..=10_000).map_or(own, |n| n as usize);
    if table.has("levels") && matches!(spread, Spread::Values(_)) {
        table.error_at("levels", "`levels` needs a range: `values` says how many there are".into(), None);
    }
    table.finish();
    Factor { name: name.to_string(), paths, spread, scale, is_whole: whole, levels, each_link }
}

/// Keys, one of which says how a factor is spread.
const SPREADS: [&str; 6] = ["values", "low", "plus_minus", "plus_minus_percent", "sd", "sd_percent"];

fn spread(name: &str, table: &TomlTable<'_>) -> (Spread, FactorScale) {
    let given: Vec<&str> = SPREADS.into_iter().filter(|key| table.has(key)).collect();
    let help = "one of `values = [...]`; `low`, `high`; `plus_minus` or `plus_minus_percent` about the drive's value; `sd` or `sd_percent`";
    let fallback = (Spread::Uniform { low: 0.0, high: 1.0, by_logarithm: false }, FactorScale::Absolute);
    let &[key] = given.as_slice() else {
        let said = if given.is_empty() { "no spread".to_string() } else { format!("{} spreads", given.len()) };
        table.error(format!("factor `{name}` has {said}"), Some(help.into()));
        // They are no unknown keys.
        for key in ["high", "mean", "logarithmic"] {
            let _asked = table.has(key);
        }
        return fallback;
    };
    table.only_with(if key == "low" { &[] } else { &["high", "logarithmic"] }, "low");
    table.only_with(if key == "sd" { &[] } else { &["mean"] }, "sd");
    let even = |half: f64| Spread::Uniform { low: -half, high: half, by_logarithm: false };
    match key {
        "values" => (Spread::Values(values(table)), FactorScale::Absolute),
        "low" => (range(name, table), FactorScale::Absolute),
        "plus_minus" => (even(table.required(key, 1.0, 0.0..=LARGEST)), FactorScale::Added),
        "plus_minus_percent" => (even(table.required(key, 1.0, 0.0..=1e6)), FactorScale::Percent),
        "sd_percent" => (Spread::Normal { mean: 0.0, sd: table.required(key, 1.0, 0.0..=1e6) }, FactorScale::Percent),
        _ => {
            let sd = table.required("sd", 1.0, 0.0..=LARGEST);
            match table.number("mean", 1.0, ANY) {
                Some(mean) => (Spread::Normal { mean, sd }, FactorScale::Absolute),
                None => (Spread::Normal { mean: 0.0, sd }, FactorScale::Added),
            }
        }
    }
}

fn range(name: &str, table: &TomlTable<'_>) -> Spread {
    let (low, high) = (table.required("low", 1.0, ANY), table.required("high", 1.0, ANY));
    let by_logarithm = table.flag("logarithmic").unwrap_or(false);
    if low >= high {
        table.error_at("high", format!("factor `{name}` goes from {low} to {high}: `high` must be larger"), None);
    }
    if by_logarithm && low <= 0.0 {
        table.error_at("low", format!("factor `{name}` begins at {low}, which has no logarithm"), None);
    }
    Spread::Uniform { low, high, by_logarithm }
}

/// A list of numbers, texts or flags.
fn values(table: &TomlTable<'_>) -> Vec<FactorValue> {
    let one = |value: DocumentValue| match value {
        DocumentValue::Text(text) => FactorValue::Text(text),
        DocumentValue::Flag(flag) => FactorValue::Flag(flag),
        DocumentValue::Number(_)
        | DocumentValue::Whole(..)
        | DocumentValue::Date
        | DocumentValue::List(_)
        | DocumentValue::Table(_) => FactorValue::Number(value.number().unwrap_or(f64::NAN)),
    };
    // One value at least, so that whoever reads on has one.
    let Some(values) = table.scalars("values") else { return vec![FactorValue::Number(0.0)] };
    if values.is_empty() {
        table.error_at("values", "`values` is empty".into(), None);
        return vec![FactorValue::Number(0.0)];
    }
    values.into_iter().map(one).collect()
}

fn responses(root: &TomlTable<'_>, factors: &[Factor]) -> Vec<Response> {
    let mut all: Vec<Response> = Vec::new();
    for (name, table) in root.table("responses").tables() {
        check_name(&name, &table);
        if factors.iter().any(|f| f.name == name) {
            table.error(format!("`{name}` is the name of a factor too"), None);
        }
        let source = source(&name, &table, factors, &all);
        let (at_most, at_least) = (table.number("at_most", 1.0, ANY), table.number("at_least", 1.0, ANY));
        table.finish();
        all.push(Response { name, source, at_most, at_least });
    }
    if all.is_empty() {
        let help = "add `[responses.touch]` with `of = \"compare.approach_speed_max_m_s\"`".to_string();
        root.error_at("responses", "the study asks for no response".into(), Some(help));
    }
    all
}

fn source(name: &str, table: &TomlTable<'_>, factors: &[Factor], above: &[Response]) -> ResponseSource {
    let given: Vec<&str> = ["of", "signal", "formula"].into_iter().filter(|key| table.has(key)).collect();
    if given.len() != 1 {
        let help = "one of `of = \"compare.approach_speed_max_m_s\"`, `signal = \"sprocket.driven.speed\"`, `formula = \"a / b\"`";
        table.error(format!("response `{name}` needs one source, and has {}", given.len()), Some(help.into()));
        for key in ["value", "order"] {
            let _asked = table.has(key);
        }
        return ResponseSource::Path(String::new());
    }
    if !table.has("signal") {
        table.only_with(&["value", "order"], "signal");
    }
    if let Some(text) = table.text("formula") {
        let known = |n: &str| above.iter().any(|r| r.name == n) || is_number_of(factors, n);
        return formula(table, "formula", &text, known)
            .map_or(ResponseSource::Path(String::new()), ResponseSource::Formula);
    }
    if let Some(signal) = table.text("signal") {
        return ResponseSource::Signal(signal, measure(name, table));
    }
    ResponseSource::Path(table.text("of").unwrap_or_default())
}

fn measure(name: &str, table: &TomlTable<'_>) -> SignalMeasure {
    let measures = [
        ("mean", SignalMeasure::Mean),
        ("min", SignalMeasure::Min),
        ("max", SignalMeasure::Max),
        ("peak_to_peak", SignalMeasure::PeakToPeak),
        ("sd", SignalMeasure::StandardDeviation),
        ("rms", SignalMeasure::Rms),
        ("last", SignalMeasure::Last),
    ];
    let order = table.number("order", 1.0, 1e-6..=1e6).map(SignalMeasure::Order);
    let value = if table.has("value") { table.choice("value", &measures) } else { None };
    if order.is_some() == table.has("value") {
        let help =
            "add `value = \"max\"` (mean, min, max, peak_to_peak, sd, rms, last), or `order = 20` for an amplitude";
        table.error(format!("response `{name}` says not what is taken from its signal"), Some(help.into()));
    }
    order.or(value).unwrap_or(SignalMeasure::Mean)
}

fn is_number_of(factors: &[Factor], name: &str) -> bool {
    factors.iter().any(|f| f.name == name && f.is_numeric() && !f.each_link)
}

/// A formula whose names are known.
fn formula(table: &TomlTable<'_>, key: &str, text: &str, known: impl Fn(&str) -> bool) -> Option<Formula> {
    let parsed = match Formula::parse(text) {
        Ok(parsed) => parsed,
        Err(why) => {
            let help = "operators: + - * / ^, < <= > >= == !=, && ||, min(a, b), max(a, b), abs, sqrt, exp, log, log10"
                .to_string();
            table.error_at(key, why, Some(help));
            return None;
        }
    };
    if let Some(unknown) = parsed.names().find(|n| !known(n)) {
        let help = "a formula knows the responses above it, and factors that are one number".to_string();
        table.error_at(key, format!("`{unknown}` is no response above, and no factor of numbers"), Some(help));
        return None;
    }
    Some(parsed)
}

fn keep(root: &TomlTable<'_>, factors: &[Factor], responses: &[Response]) -> KeepSpec {
    let table = root.table("keep");
    let known = |n: &str| n == WORST_MARGIN || responses.iter().any(|r| r.name == n) || is_number_of(factors, n);
    let wanted = table.text("recordings_where").and_then(|text| formula(&table, "recordings_where", &text, known));
    let everything = table.flag("recordings").unwrap_or(false);
    table.finish();
    match (wanted, everything) {
        (Some(formula), _) => KeepSpec::Where(formula),
        (None, true) => KeepSpec::Everything,
        (None, false) => KeepSpec::Nothing,
    }
}

fn goal(root: &TomlTable<'_>, factors: &[Factor], responses: &[Response]) -> Option<Goal> {
    let table = root.table("optimise");
    if !table.is_present() {
        return None;
    }
    let known = |n: &str| n == WORST_MARGIN || responses.iter().any(|r| r.name == n) || is_number_of(factors, n);
    let key = if table.has("maximise") { "maximise" } else { "minimise" };
    if table.has("maximise") == table.has("minimise") {
        let help = format!("one of `minimise = \"...\"` and `maximise = \"{WORST_MARGIN}\"`");
        table.error("`[optimise]` needs one goal".into(), Some(help));
    }
    let text = table.text(key).unwrap_or_else(|| "0".into());
    let formula = formula(&table, key, &text, known);
    let asks_margin = formula.as_ref().is_some_and(|f| f.names().any(|name| name == WORST_MARGIN));
    if asks_margin && !responses.iter().any(Response::has_bound) {
        table.error_at(key, format!("`{WORST_MARGIN}` needs a response with `at_most` or `at_least`"), None);
    }
    let goal = Goal {
        is_maximised: key == "maximise",
        population: table.integer("population", 4..=10_000).map(|n| n as usize),
        generations: table.integer("generations", 1..=100_000).unwrap_or(50) as usize,
        first_sd: table.number("first_sd", 1.0, 0.01..=1.0).unwrap_or(0.3),
        seed: seed(&table),
        formula: formula?,
    };
    for factor in factors {
        if factor.each_link || !matches!(factor.spread, Spread::Uniform { .. }) {
            let help = "give it `low` and `high`, or `plus_minus`".to_string();
            root.table("factors").error_at(
                &factor.name,
                format!("a search needs ranges: factor `{}` has none", factor.name),
                Some(help),
            );
        }
    }
    table.finish();
    Some(goal)
}

fn seed(table: &TomlTable<'_>) -> u64 {
    table.integer("seed", 0..=i64::MAX).unwrap_or(1) as u64
}

fn plan(root: &TomlTable<'_>, factors: &[Factor], is_search: bool) -> PlanSpec {
    let table = root.table("plan");
    let all = table.tables();
    let [(name, own)] = all.as_slice() else {
        if is_search && all.is_empty() {
            if factors.is_empty() {
                root.error_at("factors", "the search has no factor".into(), Some("add `[factors.load]`".into()));
            }
            return PlanSpec::Design(StudyPlan::Search);
        }
        let help = "one of `[plan.full_grid]`, `[plan.one_at_a_time]`, `[plan.latin_hypercube]`, `[plan.sobol]`, `[plan.random]`, `[plan.morris]`, \
                    `[plan.saltelli]`, `[plan.rows]`";
        table.error(format!("a study has one plan, and this one has {}", all.len()), Some(help.into()));
        return PlanSpec::Design(StudyPlan::FullGrid);
    };
    if is_search {
        table.error("a study with `[optimise]` has no plan: its search asks for the points".into(), None);
    }
    if factors.is_empty() {
        root.error_at("factors", "the study varies no factor".into(), Some("add `[factors.load]`".into()));
    }
    let count = |key: &str| own.required_integer(key, 1..=MOST_CASES as i64) as usize;
    let plan = match name.as_str() {
        "full_grid" => StudyPlan::FullGrid,
        "one_at_a_time" => StudyPlan::OneAtATime,
        "latin_hypercube" => StudyPlan::LatinHypercube { cases: count("cases"), seed: seed(own) },
        "sobol" => StudyPlan::Sobol { cases: count("cases"), seed: seed(own) },
        "random" => StudyPlan::Random { cases: count("cases"), seed: seed(own) },
        "morris" => {
            let levels = own.integer("levels", 2..=1000).unwrap_or(4) as usize;
            if !levels.is_multiple_of(2) {
                own.error_at(
                    "levels",
                    "`levels` must be even: every factor then reaches all of them alike".into(),
                    None,
                );
            }
            StudyPlan::Morris { trajectories: count("trajectories"), levels, seed: seed(own) }
        }
        "saltelli" => StudyPlan::Saltelli { base: count("base"), seed: seed(own) },
        "rows" => {
            let file = own.text("file").unwrap_or_else(|| {
                own.error(
                    "`file` is missing".into(),
                    Some("add `file = \"cases.csv\"`: a column for each factor".into()),
                );
                String::new()
            });
            own.finish();
            return PlanSpec::File(file);
        }
        other => {
            let known =
                ["full_grid", "one_at_a_time", "latin_hypercube", "sobol", "random", "morris", "saltelli", "rows"];
            let near = crate::diag::nearest(other, known);
            let help =
                near.map_or_else(|| format!("plans: {}", known.join(", ")), |near| format!("did you mean `{near}`?"));
            own.error(format!("`{other}` is no plan"), Some(help));
            return PlanSpec::Design(StudyPlan::FullGrid);
        }
    };
    let dimensions = plan.sequence_of(factors.len()).map_or(0, |(dimensions, _)| dimensions);
    if dimensions > MOST_DIMENSIONS {
        own.error(
            format!("this plan takes {dimensions} dimensions of a Sobol' sequence; there are {MOST_DIMENSIONS}"),
            None,
        );
    }
    own.finish();
    PlanSpec::Design(plan)
}
