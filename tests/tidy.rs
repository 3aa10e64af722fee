//! Rules that keep the code readable.

use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn rust_files() -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![root().join("src"), root().join("tests"), root().join("benches")];
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
        "recording::columns",
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
