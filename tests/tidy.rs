//! Rules that keep the code readable.

use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn rust_files() -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![root().join("src"), root().join("tests"), root().join("benches"), root().join("examples")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

#[test]
fn files_open_with_what_they_are_and_leave_nothing_open() {
    for path in rust_files() {
        let text = std::fs::read_to_string(&path).expect("readable");
        let shown = path.strip_prefix(root()).unwrap_or(&path).display();
        assert!(text.starts_with("//!"), "{shown} does not say what it is");
        // Split, so that this file does not match itself.
        for word in ["todo", "unimplemented"]
            .map(|w| format!("{w}!("))
            .iter()
            .chain(&["TO".to_string() + "DO", "FIX".to_string() + "ME"])
        {
            assert!(!text.contains(word.as_str()), "{shown} has {word}");
        }
        if path.starts_with(root().join("src")) {
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            assert!(!code.contains(".unwrap()"), "{shown} unwraps");
            assert!(text.lines().count() <= 1000, "{shown} is longer than a sitting");
        }
    }
}

/// Name of the type that a line defines, if it defines one. Associated types of traits are no definitions of their own.
fn defined_type(line: &str) -> Option<&str> {
    let mut words =
        line.split_whitespace().skip_while(|word| word.starts_with("pub") || word.contains("::") || *word == "unsafe");
    let kind = words.next()?;
    let is_definition = matches!(kind, "struct" | "enum" | "trait" | "union");
    let is_alias = kind == "type" && !line.starts_with(' ');
    let name = words.next().filter(|_| is_definition || is_alias)?;
    name.split(|c: char| !c.is_alphanumeric() && c != '_').next()
}

#[test]
fn every_type_name_has_one_meaning() {
    let mut places: std::collections::BTreeMap<String, Vec<String>> = std::collections::BTreeMap::new();
    for path in rust_files().iter().filter(|p| p.starts_with(root().join("src"))) {
        let text = std::fs::read_to_string(path).expect("readable");
        let shown = path.strip_prefix(root()).unwrap_or(path).display();
        for (i, line) in text.lines().enumerate() {
            if let Some(name) = defined_type(line) {
                places.entry(name.to_string()).or_default().push(format!("{shown}:{}", i + 1));
            }
        }
    }
    assert!(places.len() > 500, "{} types", places.len());
    let repeated: Vec<_> = places.iter().filter(|(_, places)| places.len() > 1).collect();
    assert!(repeated.is_empty(), "type names that are defined more than once: {repeated:#?}");
}

#[test]
fn physics_takes_its_trigonometry_from_libm() {
    for path in rust_files().iter().filter(|p| p.starts_with(root().join("src"))) {
        let shown = path.strip_prefix(root()).unwrap_or(path);
        let drawing = ["src/recording/rerun", "src/recording/foxglove_scene.rs", "src/cli", "src/render.rs"];
        if drawing.iter().any(|d| shown.to_string_lossy().starts_with(d)) {
            continue;
        }
        let text = std::fs::read_to_string(path).expect("readable");
        for call in [".sin()", ".cos()", ".sin_cos()", ".atan2(", ".powf(", ".exp()", ".ln()", ".mul_add("] {
            let in_code = text.lines().any(|l| l.contains(call) && !l.trim_start().starts_with("//"));
            assert!(!in_code, "{} uses {call}: std's gives other bits on other CPUs", shown.display());
        }
    }
}

#[test]
fn architecture_names_files_that_exist_and_stays_short() {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md");
    assert!(text.lines().count() < 100);
    let mut named = 0;
    for word in text.split(|c: char| c.is_whitespace() || c == '`' || c == '(' || c == ')' || c == ',') {
        if (word.starts_with("src/") || word.starts_with("tests/") || word.starts_with("assets/"))
            && !word.contains('*')
        {
            assert!(root().join(word).exists(), "ARCHITECTURE.md names {word}");
            named += 1;
        }
    }
    assert!(named > 15, "{named} paths");
}

#[test]
fn links_of_the_documentation_lead_somewhere_and_every_chapter_is_in_the_summary() {
    let mut pages: Vec<PathBuf> = ["README", "ARCHITECTURE", "CHANGELOG", "CONTRIBUTING", "SECURITY"]
        .iter()
        .map(|name| root().join(format!("{name}.md")))
        .collect();
    let summary = std::fs::read_to_string(root().join("docs/SUMMARY.md")).expect("docs/SUMMARY.md");
    for path in std::fs::read_dir(root().join("docs")).expect("docs").flatten().map(|entry| entry.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.extension().is_some_and(|e| e == "md") {
            assert!(name == "SUMMARY.md" || summary.contains(&format!("({name})")), "docs/SUMMARY.md lacks {name}");
            pages.push(path);
        }
    }
    let mut links = 0;
    for page in pages {
        let text = std::fs::read_to_string(&page).expect("a page");
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let file = link.split('#').next().unwrap_or_default();
            let to = page.parent().expect("a folder").join(file);
            assert!(link.contains("://") || file.is_empty() || to.exists(), "{} links {link}", page.display());
            links += 1;
        }
    }
    assert!(links > 30, "{links} links");
}

#[test]
fn modules_use_only_what_stands_above_them() {
    // The order of reading; a module may only use modules before it.
    let order = [
        "units",
        "diag",
        "geometry",
        "recording::frame",
        "state",
        "contact",
        "effects",
        "elements",
        "drive",
        "machine",
        "model",
        "integrate",
        "statics",
        "engagement",
        "assemble",
        "sensing",
        "lumping",
        "recording",
        "measurement",
        "impacts",
        "breakpoint",
        "simulate",
        "replay",
        "analysis",
        "compare",
        "identify",
        "render",
        "cli",
    ];
    // The most specific matching entry.
    let place = |module: &str| {
        let fits = |m: &str| module == m || module.starts_with(&format!("{m}::"));
        (0..order.len()).filter(|i| fits(order[*i])).max_by_key(|i| order[*i].len())
    };
    for path in rust_files().iter().filter(|p| p.starts_with(root().join("src"))) {
        let shown = path
            .strip_prefix(root().join("src"))
            .unwrap_or(path)
            .to_string_lossy()
            .replace(".rs", "")
            .replace('/', "::");
        let own = shown.trim_end_matches("::mod").to_string();
        let Some(here) = place(&own) else { continue };
        let text = std::fs::read_to_string(path).expect("readable");
        for line in text
            .lines()
            .take_while(|l| !l.contains("#[cfg(test)]"))
            .filter_map(|l| l.trim().strip_prefix("use crate::"))
        {
            let used = line.split([';', '{', ' ']).next().unwrap_or("").trim_end_matches("::");
            if let Some(there) = place(used) {
                assert!(there <= here, "{own} uses {used}, which stands below it");
            }
        }
    }
}

/// A Rust file without its tests and its comments.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).expect("readable");
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    code.lines().map(|l| l.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Public functions that tests alone use, and why they are in src/.
const FOR_TESTS: [(&str, &str); 5] = [
    ("chain_only", "a Model without a drive, for closed forms of rings and spans"),
    ("ends_near", "looks into what a step computes, which is private"),
    ("fix_link", "holds a link of such a Model"),
    ("mode_near", "modes from the matrices of the static solution, which are private"),
    ("quasi_static_forces_n", "closed form of the ring's forces, from the path's private parts"),
];

#[test]
fn public_functions_are_used_by_the_program() {
    let (mut defined, mut seen): (Vec<String>, std::collections::BTreeMap<String, i64>) = Default::default();
    let mut files = rust_files();
    files.extend(std::fs::read_dir(root().join("fuzz/fuzz_targets")).expect("fuzzers").flatten().map(|e| e.path()));
    for path in files.iter().filter(|p| !p.starts_with(root().join("tests"))) {
        let text = code(path);
        let words: Vec<&str> = text.split(|c| !is_word(c)).filter(|w| !w.is_empty()).collect();
        for (k, word) in words.iter().enumerate() {
            // A definition is no use.
            let is_defined = k > 0 && words[k - 1] == "fn";
            *seen.entry((*word).to_string()).or_default() += i64::from(!is_defined);
            let is_public =
                k > 1 && (words[k - 2] == "pub" || k > 2 && words[k - 3] == "pub" && words[k - 2] == "const");
            if is_defined && is_public && path.starts_with(root().join("src")) {
                defined.push((*word).to_string());
            }
        }
    }
    let mut unused: Vec<&str> = defined.iter().map(String::as_str).filter(|name| seen[*name] == 0).collect();
    unused.sort_unstable();
    let expected: Vec<&str> = FOR_TESTS.iter().map(|(name, _)| *name).collect();
    assert_eq!(unused, expected, "left: unused in src/, benches/, examples/ and fuzz/; right: the list of exceptions");
    assert!(defined.len() > 500, "{} public functions", defined.len());
}

/// A function should fit a screen.
const LONGEST_FUNCTION: usize = 70;

/// Functions that do not, with their lengths. A function leaves this list when it fits; none may join it or grow.
#[rustfmt::skip]
const LONG_FUNCTIONS: [(&str, &str, usize); 41] = [
    ("src/analysis/explain.rs", "free_body", 91),
    ("src/cli/check.rs", "run", 85),
    ("src/cli/compare.rs", "run", 90),
    ("src/cli/zoom.rs", "run", 78),
    ("src/drive/read.rs", "drive", 92),
    ("src/drive/read.rs", "read_sprockets", 82),
    ("src/drive/sensors.rs", "sensors", 75),
    ("src/elements/flank_lanes.rs", "deepest", 112),
    ("src/geometry/silent_sprocket.rs", "shaped", 73),
    ("src/geometry/sprocket.rs", "new", 88),
    ("src/identify/candidates.rs", "all", 143),
    ("src/identify/diagnosis.rs", "channel", 72),
    ("src/identify/fit.rs", "fit", 93),
    ("src/identify/screen.rs", "promise", 83),
    ("src/identify/screen.rs", "promise_of_links", 95),
    ("src/identify/search.rs", "grow", 107),
    ("src/identify/search.rs", "search", 99),
    ("src/integrate/explicit/abutments.rs", "lobes", 74),
    ("src/integrate/explicit/ends.rs", "contacts_of", 75),
    ("src/integrate/explicit/guides.rs", "contacts", 71),
    ("src/integrate/explicit/links.rs", "apply_contacts", 104),
    ("src/integrate/explicit/scratch.rs", "with_isa", 92),
    ("src/integrate/explicit/teeth.rs", "contacts", 119),
    ("src/integrate/explicit/windows.rs", "refresh", 76),
    ("src/integrate/step_bound.rs", "step_bound", 96),
    ("src/lumping.rs", "lumped_text", 79),
    ("src/machine/links.rs", "of_links", 92),
    ("src/machine/pulses.rs", "pulses", 74),
    ("src/machine/simulate.rs", "sampled", 110),
    ("src/measurement/pulses.rs", "pulse_segments", 114),
    ("src/measurement/segments.rs", "sampled_segment", 77),
    ("src/model.rs", "build", 97),
    ("src/model.rs", "join", 73),
    ("src/model/place.rs", "place", 124),
    ("src/recording/capture.rs", "header_of", 99),
    ("src/replay.rs", "each_column", 72),
    ("src/replay.rs", "verify", 86),
    ("src/simulate.rs", "run_job", 122),
    ("src/state.rs", "for_each_column", 101),
    ("src/statics.rs", "solve", 92),
    ("src/statics.rs", "system", 78),
];

/// Names and lengths of the functions of a file: from `fn` to the brace at the same depth.
fn functions(path: &Path) -> Vec<(String, usize)> {
    let text = std::fs::read_to_string(path).expect("readable");
    let lines: Vec<&str> = text.split("#[cfg(test)]").next().unwrap_or_default().lines().collect();
    let mut found = Vec::new();
    for (start, line) in lines.iter().enumerate() {
        let inner = line.trim_start();
        let (indent, mut words) = (line.len() - inner.len(), inner.split(' '));
        let of_function = |w: &&str| !(w.starts_with("pub") || ["const", "async", "unsafe"].contains(w));
        if words.find(of_function) != Some("fn") {
            continue;
        }
        let name: String = words.next().unwrap_or_default().chars().take_while(|c| is_word(*c)).collect();
        let closes = |l: &&str| l.len() - l.trim_start().len() == indent && l.trim_start().starts_with('}');
        let is_whole = line.trim_end().ends_with(['}', ';']);
        let length = if is_whole { 1 } else { 1 + lines[start..].iter().position(closes).unwrap_or(0) };
        found.push((name, length));
    }
    found
}

#[test]
fn functions_fit_a_screen_or_are_on_a_list_that_shrinks() {
    let mut long: Vec<(String, String, usize)> = Vec::new();
    for path in rust_files().iter().filter(|p| p.starts_with(root().join("src"))) {
        let shown = path.strip_prefix(root()).unwrap_or(path).to_string_lossy().into_owned();
        for (name, length) in functions(path).into_iter().filter(|(_, length)| *length > LONGEST_FUNCTION) {
            // Of several of one name in a file, the longest.
            match long.iter_mut().find(|(p, n, _)| *p == shown && *n == name) {
                Some((_, _, old)) => *old = length.max(*old),
                None => long.push((shown.clone(), name, length)),
            }
        }
    }
    long.sort();
    let mut wrong = Vec::new();
    for (path, name, length) in &long {
        match LONG_FUNCTIONS.iter().find(|(p, n, _)| p == path && n == name) {
            None => wrong.push(format!("{path}: {name} has {length} lines, more than {LONGEST_FUNCTION}")),
            Some((_, _, known)) if length > known => {
                wrong.push(format!("{path}: {name} has grown from {known} to {length} lines"));
            }
            Some(_) => {}
        }
    }
    for (path, name, _) in LONG_FUNCTIONS {
        if !long.iter().any(|(p, n, _)| p == path && n == name) {
            wrong.push(format!("{path}: {name} fits a screen now, or is gone: take it off the list"));
        }
    }
    let now: Vec<String> = long.iter().map(|(path, name, n)| format!("    (\"{path}\", \"{name}\", {n}),")).collect();
    assert!(wrong.is_empty(), "{}\nall that are long now:\n{}", wrong.join("\n"), now.join("\n"));
}
