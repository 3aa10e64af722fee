//! Commands of README.md and docs/ print what the pages show, and what they printed before (tests/golden/).

#![cfg(feature = "rerun")]

#[allow(dead_code)]
#[path = "common/docs.rs"]
mod docs;
#[path = "common/golden.rs"]
mod golden;

use docs::shell_words;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Commands that are not run, by a part of their text, and why.
const NOT_RUN: [(&str, &str); 12] = [
    ("view ", "opens a viewer"),
    ("--live ", "waits for a viewer"),
    ("completions ", "the script is clap's, not ours"),
    ("drives bush-20-40  ", "prints a file of assets/drives/, without change"),
    ("check my.toml --json", "lists every value of the drive"),
    ("-o a.mcap --set sprockets.driver.gap_form=min --json", "prints wall time and vector unit as numbers"),
    ("compare --speed-rpm ", "takes 5 s"),
    ("optimise ", "takes a minute"),
    ("reproduce ", "takes minutes; tests/reproduce.rs runs some claims"),
    ("study ", "takes minutes; tests/studies.rs runs shorter ones"),
    ("<<", "the shell adds what follows to the file"),
    ("--stats", "prints measured times"),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A folder with the files that the pages take for granted.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    for entry in std::fs::read_dir(root().join("tests/data/rig")).expect("the rig").flatten() {
        std::fs::copy(entry.path(), at(&entry.file_name().to_string_lossy())).expect("copied");
    }
    std::fs::copy(root().join("assets/drives/bush-20-40.toml"), at("my.toml")).expect("copied");
    // A recording whose program was killed has no table of contents.
    let sample = std::fs::read(root().join("recordings/samples/bush-20-40.mcap")).expect("the sample");
    std::fs::write(at("killed.mcap"), &sample[..sample.len() * 3 / 4]).expect("written");
    let samples = at("recordings/samples");
    std::fs::create_dir_all(&samples).expect("a folder");
    std::fs::write(samples.join("bush-20-40.mcap"), &sample).expect("written");
    folder
}

/// What a command of a page prints, with its exit code if that is not 0.
fn printed(line: &str, folder: &Path) -> String {
    let words = shell_words(line);
    let out =
        Command::new(env!("CARGO_BIN_EXE_pitchline")).current_dir(folder).args(&words).output().expect("it starts");
    let mut text = String::from_utf8_lossy(&out.stdout).into_owned();
    if let Some((_, to)) = line.split_once(" > ").filter(|_| !line.contains('\'')) {
        let to = shell_words(to);
        std::fs::write(folder.join(&to[0]), &out.stdout).expect("written");
        text.clear();
    }
    text += &String::from_utf8_lossy(&out.stderr);
    match out.status.code() {
        Some(0) => text,
        code => format!("{text}[exit code {}]\n", code.unwrap_or(-1)),
    }
}

/// Whether lines that a page shows are those that were printed; `...` stands for any number of lines.
fn fits(shown: &[&str], printed: &[&str]) -> bool {
    match shown.split_first() {
        None => printed.is_empty(),
        Some((first, rest)) if first.trim() == "..." => (0..=printed.len()).any(|from| fits(rest, &printed[from..])),
        Some((first, rest)) => {
            printed.split_first().is_some_and(|(line, after)| line.trim_end() == first.trim_end() && fits(rest, after))
        }
    }
}

/// Blocks of a page that are fenced and name no language.
fn blocks(text: &str) -> Vec<String> {
    let (mut found, mut open): (Vec<String>, Option<String>) = (Vec::new(), None);
    for line in text.lines() {
        match (line.strip_prefix("```"), &mut open) {
            (Some(_), Some(_)) => found.extend(open.take()),
            (Some(language), None) => open = Some(if language.is_empty() { String::new() } else { "//".into() }),
            (None, Some(block)) => *block += &format!("{line}\n"),
            (None, None) => {}
        }
    }
    found.retain(|block| !block.starts_with("//"));
    found
}

/// Runs all commands of a page in one folder, in the order of the page.
fn check(page: &str) {
    let text = std::fs::read_to_string(root().join(page)).expect("the page");
    let folder = folder();
    let mut transcript = String::new();
    for block in blocks(&text).iter().filter(|block| block.contains("$ pitchline ")) {
        for command in format!("\n{block}").split("\n$ ").skip(1) {
            let (line, shown) = command.split_once('\n').unwrap_or((command, ""));
            let Some(line) = line.strip_prefix("pitchline ") else { continue };
            let is_not_run = |part: &str| line.starts_with(part) || format!("{line}  ")[1..].contains(part);
            if NOT_RUN.iter().any(|(part, _)| is_not_run(part)) {
                continue;
            }
            let shown: Vec<&str> = shown.lines().collect();
            let said = golden::masked(&printed(line, folder.path()));
            // Outputs that are not shown may be long: a page that shows none has none.
            if !shown.is_empty() {
                let shown = golden::masked(&shown.join("\n"));
                let (shown, said): (Vec<&str>, Vec<&str>) = (shown.lines().collect(), said.lines().collect());
                assert!(
                    fits(&shown, &said),
                    "{page} shows of `{line}`:\n{}\nbut it prints:\n{}",
                    shown.join("\n"),
                    said.join("\n")
                );
            }
            let line = line.split("  #").next().unwrap_or(line).trim_end();
            transcript += &format!("$ pitchline {line}\n{said}\n");
        }
    }
    let name = page.trim_start_matches("docs/").trim_end_matches(".md");
    golden::check(name, &transcript);
}

#[test]
fn the_readme_shows_what_is_printed() {
    check("README.md");
}

#[test]
fn the_chapters_show_what_is_printed() {
    for page in ["debugger", "identify", "running", "recording-format", "vibration", "viewing"] {
        check(&format!("docs/{page}.md"));
    }
}

/// The mistake that README.md and the chapter on the drive file show.
#[test]
fn a_mistake_is_shown_as_it_is_printed() {
    let folder = folder();
    let path = folder.path().join("my.toml");
    let text = std::fs::read_to_string(&path).expect("the drive");
    std::fs::write(&path, text.replacen("teeth = 20", "teeth = 3 ", 1)).expect("written");
    let said = printed("check my.toml", folder.path());
    let said = said.strip_suffix("[exit code 2]\n").expect("refused");
    for page in ["README.md", "docs/drive-file.md"] {
        let text = std::fs::read_to_string(root().join(page)).expect("the page");
        assert!(text.contains(said.trim_end()), "{page} does not show:\n{said}");
    }
}

/// The files in tests/data/rig/ are those that the chapter on identification shows.
#[test]
fn the_rig_is_that_of_the_chapter() {
    let text = std::fs::read_to_string(root().join("docs/identify.md")).expect("the page");
    for (block, file) in text.split("```toml\n").skip(1).zip(["rig.toml", "rig-measured.toml"]) {
        let shown = block.split("```").next().unwrap_or_default();
        let path: PathBuf = root().join("tests/data/rig").join(file);
        assert_eq!(shown, std::fs::read_to_string(path).expect("the file"), "{file}");
    }
}
