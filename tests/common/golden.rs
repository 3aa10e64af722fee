//! Golden outputs: what a command or program printed, kept in tests/golden/. What differs from run to run or from machine to
//! machine is masked before anything is compared.

use std::path::{Path, PathBuf};

/// Texts around a number that differs between runs or machines: wall times, rates, sizes of compressed files.
const MASKED: [(&str, &str); 8] = [
    (" frames, ", " s ("),
    (" s (", " s per simulated second)"),
    ("of each drive in ", " s\n"),
    (" (", " MB, "),
    (" MB, ", " bytes per frame)"),
    (" rows, ", " MB)"),
    (" (", " MB)"),
    (" ms, ", " bytes of an unfinished chunk"),
];

/// The text with `~` in place of every number that is masked.
pub fn masked(text: &str) -> String {
    let mut text = text.to_string();
    for (before, after) in MASKED {
        let mut from = 0;
        while let Some(start) = text[from..].find(before).map(|at| from + at + before.len()) {
            let number = |c: char| c.is_ascii_digit() || c == '.';
            let end = text[start..].find(|c| !number(c)).map_or(text.len(), |at| start + at);
            if end > start && text[end..].starts_with(after) {
                text.replace_range(start..end, "~");
            }
            from = start;
        }
    }
    text
}

fn place(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(format!("{name}.txt"))
}

/// Compares a text with the golden file of this name; prints the lines that differ and how to write the file anew.
pub fn check(name: &str, text: &str) {
    let (path, text) = (place(name), masked(text));
    if std::env::var_os("PITCHLINE_WRITE_GOLDEN").is_some() {
        std::fs::write(&path, &text).expect("tests/golden can be written");
        return;
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        kept == text,
        "the output differs from tests/golden/{name}.txt (-: kept, +: printed now):\n{}\
         where this is meant, run PITCHLINE_WRITE_GOLDEN=1 cargo test --release --test golden --test examples, look at the \
         change, and mend README.md and docs/ where they show it",
        difference(&kept, &text)
    );
}

/// Lines of two texts that are not in both, by their longest common subsequence.
fn difference(old: &str, new: &str) -> String {
    let (old, new): (Vec<&str>, Vec<&str>) = (old.lines().collect(), new.lines().collect());
    // Length of the common subsequence of what follows line i of one and line j of the other.
    let mut common = vec![vec![0_usize; new.len() + 1]; old.len() + 1];
    for i in (0..old.len()).rev() {
        for j in (0..new.len()).rev() {
            common[i][j] =
                if old[i] == new[j] { common[i + 1][j + 1] + 1 } else { common[i + 1][j].max(common[i][j + 1]) };
        }
    }
    let (mut i, mut j, mut told) = (0, 0, String::new());
    while i < old.len() || j < new.len() {
        if i < old.len() && j < new.len() && old[i] == new[j] {
            (i, j) = (i + 1, j + 1);
        } else if j == new.len() || i < old.len() && common[i + 1][j] >= common[i][j + 1] {
            told += &format!("- {}\n", old[i]);
            i += 1;
        } else {
            told += &format!("+ {}\n", new[j]);
            j += 1;
        }
    }
    told
}
