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
    // In a macro the name is a variable.
    name.split(|c: char| !c.is_alphanumeric() && c != '_').next().filter(|name| !name.is_empty())
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
        for call in [".sin()", ".cos()", ".sin_cos()", ".atan2(", ".powf(", ".exp()", ".ln()", ".mul_add(", ".hypot("] {
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

/// Each bundled drive has its row in the chapter of drive files, and its picture.
#[test]
fn every_bundled_drive_is_described_and_shown() {
    let page = |name: &str| std::fs::read_to_string(root().join("docs").join(name)).expect("a page");
    let (rows, pictures) = (page("drive-file.md"), page("drives.md"));
    for (name, _) in pitchline::drive::BUNDLED {
        assert!(rows.contains(&format!("\n| `{name}` | ")), "docs/drive-file.md lacks {name}");
        assert!(pictures.contains(&format!("(../assets/pictures/drives/{name}.png)")), "docs/drives.md lacks {name}");
    }
}

#[test]
fn modules_use_only_what_stands_above_them() {
    // The order of reading; a module may only use modules before it.
    let order = [
        "units",
        "diag",
        "statistics",
        "random",
        "products",
        "geometry",
        "recording::columns",
        "recording::frame",
        "lanes",
        "side_by_side",
        "pairs::contact_group",
        "state",
        "effects",
        "elements",
        "pairs",
        "drive",
        "model",
        "integrate",
        "statics",
        "engagement",
        "assemble",
        "sensing",
        "machine",
        "lumping",
        "recording",
        "measurement",
        "impacts",
        "breakpoint",
        "simulate",
        "replay",
        "analysis",
        "compare",
        "study",
        "reproduce",
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

/// Matches on our own enums that end in `_ =>`, and why: file, what is matched, reason.
const CATCH_ALLS: &[(&str, &str, &str)] = &[
    ("src/breakpoint/columns.rs", "(quantity.scope, quantity.what)", "pairs: all but one"),
    ("src/breakpoint/extremes.rs", "(left, right)", "pairs: all but two"),
    ("src/pairs/contour_body.rs", "(&self.shape, contour)", "pairs: the rest do not meet"),
    ("src/integrate/explicit/ends/query.rs", "(self, contour)", "pairs: the rest do not meet"),
    ("src/machine/forces.rs", "(p.effect.physics, p.target)", "pairs: the rest is placed nowhere"),
    ("src/recording/table/file.rs", "(self, values)", "pairs: of two kinds is a mistake of ours, which panics"),
];

/// Enums that may be matched so: each function is about the few quantities of break expressions that its scope has.
const MANY: [&str; 1] = ["What"];

/// A new variant of an enum has to be thought of wherever the enum is matched: no arm of a match may stand for whatever else there is.
#[test]
fn matches_on_our_own_enums_name_every_variant() {
    let files: Vec<(String, String)> = rust_files()
        .iter()
        .filter(|p| p.starts_with(root().join("src")))
        .map(|path| {
            let text = std::fs::read_to_string(path).expect("readable");
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            (path.strip_prefix(root()).unwrap_or(path).display().to_string(), plain(code))
        })
        .collect();
    let name = |rest: &str| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let enums: Vec<String> = files.iter().flat_map(|(_, t)| t.split("enum ").skip(1).map(name)).collect();
    assert!(enums.len() > 80, "{} enums", enums.len());
    let mut unused: Vec<_> = CATCH_ALLS.iter().collect();
    let mut found = Vec::new();
    for (file, text) in &files {
        for (at, _) in text.match_indices("match ") {
            let Some((head, body)) = match_at(&text[at + "match ".len()..]) else { continue };
            let patterns = patterns(body);
            let is_catch_all = |p: &str| p == "_" || p.starts_with("_ if ");
            let is_ours = |p: &str| {
                p.split("::").any(|before| {
                    let word = before.rsplit(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default();
                    p.contains(&format!("{word}::"))
                        && !MANY.contains(&word)
                        && (word == "Self" || enums.iter().any(|e| e == word))
                })
            };
            if !patterns.iter().any(|p| is_catch_all(p)) || !patterns.iter().any(|p| is_ours(p)) {
                continue;
            }
            let head = head.trim();
            match unused.iter().position(|(f, h, _)| f == file && *h == head) {
                Some(known) => drop(unused.remove(known)),
                None => found.push(format!("{file}: match {head}")),
            }
        }
    }
    assert!(found.is_empty(), "an arm `_` beside variants of our own enums; write them out:\n{}", found.join("\n"));
    assert!(unused.is_empty(), "no such match any more: {unused:?}");
}

/// Rust code without what stands in comments and quotes.
fn plain(code: &str) -> String {
    let (mut out, mut quoted) = (String::new(), false);
    for line in code.lines() {
        let line = line.replace("'\"'", "' '").replace("'{'", "' '").replace("'}'", "' '").replace("\\\"", "");
        for (i, c) in line.char_indices() {
            if !quoted && line[i..].starts_with("//") {
                break;
            }
            quoted ^= c == '"';
            out.push(if quoted { 'x' } else { c });
        }
        out.push('\n');
    }
    out
}

/// What is matched, and the arms, of the text behind a `match`.
fn match_at(text: &str) -> Option<(&str, &str)> {
    let mut depth = 0;
    let open = text.char_indices().find_map(|(i, c)| {
        depth += i32::from("([".contains(c)) - i32::from(")]".contains(c));
        (depth == 0 && "{;".contains(c)).then_some((i, c))
    });
    let (open, '{') = open? else { return None };
    let mut depth = 0;
    let close = text[open..].char_indices().find_map(|(i, c)| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        (depth == 0).then_some(open + i)
    })?;
    Some((&text[..open], &text[open + 1..close]))
}

/// Patterns of a match's arms.
fn patterns(body: &str) -> Vec<&str> {
    let (mut found, mut start, mut depth, mut in_pattern) = (Vec::new(), 0, 0, true);
    for (i, c) in body.char_indices() {
        depth += i32::from("([{".contains(c)) - i32::from(")]}".contains(c));
        if in_pattern && depth == 0 && body[i..].starts_with("=>") {
            found.push(body[start..i].trim());
            in_pattern = false;
        }
        // An arm ends with a comma, or with the brace of its block unless its expression goes on.
        let goes_on = || {
            body[i + 1..].trim_start().starts_with(['.', '?', ',']) || body[i + 1..].trim_start().starts_with("else")
        };
        if !in_pattern && depth == 0 && (c == ',' || (c == '}' && !goes_on())) {
            (start, in_pattern) = (i + 1, true);
        }
    }
    found
}
