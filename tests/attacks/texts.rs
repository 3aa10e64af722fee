//! Texts that people write, and tables that machines write, with mistakes of every kind.

use super::{Random, root};
use pitchline::breakpoint::{Breakpoint, Names};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::machine::Machine;
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::{Layout, Memory, Wanted, read};

const PIECES: [&str; 24] = [
    "",
    "0",
    "-1",
    "1e308",
    "-1e-308",
    "nan",
    "inf",
    "99999999999999999999",
    "\"",
    "'''",
    "[",
    "]]",
    "{",
    "=",
    "\n",
    "\\",
    "true",
    "\u{0}",
    "\u{202e}",
    "\u{1f517}",
    "[[a]]",
    "a.b.c = 1\n",
    "#",
    "1979-05-27T07:32:00Z",
];

/// A text with one to four changes.
fn changed(text: &str, random: &mut Random) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_string).collect();
    for _ in 0..=random.below(4) {
        let at = random.below(lines.len());
        match random.below(8) {
            0 => drop(lines.remove(at)),
            1 => lines.insert(at, lines[random.below(lines.len())].clone()),
            2 => lines.truncate(at.max(1)),
            3 => {
                let other = random.below(lines.len());
                lines.swap(at, other);
            }
            4 => {
                // Another value.
                let piece = random.of(&PIECES);
                if let Some((key, _)) = lines[at].clone().split_once('=') {
                    lines[at] = format!("{key}= {piece}");
                }
            }
            _ => {
                let characters: Vec<char> = lines[at].chars().collect();
                let from = random.below(characters.len() + 1);
                let to = (from + random.below(4)).min(characters.len());
                let piece = random.of(&PIECES);
                lines[at] = characters[..from]
                    .iter()
                    .chain(&piece.chars().collect::<Vec<_>>())
                    .chain(&characters[to..])
                    .collect();
            }
        }
        if lines.is_empty() {
            lines.push(String::new());
        }
    }
    lines.join("\n")
}

#[test]
fn drives_are_read_or_refused_with_a_reason() {
    let (mut read, mut refused) = (0, 0);
    for case in 0..600 {
        let mut random = Random(case);
        let (name, text) = BUNDLED[random.below(BUNDLED.len())];
        match Drive::parse(name, &changed(text, &mut random), &[]) {
            Ok(_) => read += 1,
            Err(report) => {
                assert!(!report.to_string().is_empty(), "case {case}");
                refused += 1;
            }
        }
    }
    println!("{read} read, {refused} refused");
    assert!(read > 20 && refused > 100);
}

#[test]
fn lumped_drives_and_measurements_are_read_or_refused_with_a_reason() {
    let folder = root().join("assets/measurements");
    let texts: Vec<(bool, String)> = std::fs::read_dir(folder)
        .expect("the measurements")
        .map(|f| f.expect("a file").path())
        .filter(|p| p.extension().is_some_and(|e| e == "toml"))
        .map(|p| (p.to_string_lossy().contains("-drive"), std::fs::read_to_string(p).expect("text")))
        .collect();
    let mut refused = 0;
    for case in 0..500 {
        let mut random = Random(10_000 + case);
        let (is_drive, text) = &texts[random.below(texts.len())];
        let text = changed(text, &mut random);
        let report = if *is_drive {
            Machine::parse("drive.toml", &text, &[]).err().map(|r| r.to_string())
        } else {
            Measurement::parse("measurement.toml", &text).err().map(|r| r.to_string())
        };
        refused += u32::from(report.is_some_and(|r| !r.is_empty()));
    }
    assert!(refused > 100, "{refused}");
}

#[test]
fn break_expressions_are_read_or_refused_with_a_reason() {
    let names = Names { bodies: vec!["sprockets.driver".into(), "guides.fixed.tight".into()], sprockets: 1, links: 90 };
    let words = [
        "contact.normal_force",
        "link.speed",
        ">",
        "<",
        "and",
        "or",
        "not",
        "(",
        ")",
        "500 N",
        "1e999",
        "\"driver\"",
        "==",
        "time",
        "3 ms",
        "m/s",
        "-",
        "\u{1f517}",
        "impact.peak_force",
        "joint",
        "..",
        "'",
        "0",
        "energy.error",
    ];
    for case in 0..300 {
        let mut random = Random(20_000 + case);
        let words: Vec<&str> = (0..random.below(12)).map(|_| random.of(&words)).collect();
        if let Err(report) = Breakpoint::parse(&words.join(" "), &names) {
            assert!(!report.to_string().is_empty());
        }
    }
}

#[test]
fn measured_files_are_read_or_refused_within_their_memory() {
    let folder = tempfile::tempdir().expect("a folder");
    let fixtures: Vec<_> = std::fs::read_dir(root().join("tests/data/strangers"))
        .expect("fixtures")
        .map(|f| f.expect("a file").path())
        .filter(|p| p.extension().is_some_and(|e| ["csv", "txt", "gz", "parquet", "mf4"].iter().any(|k| e == *k)))
        .collect();
    let (mut fine, mut refused) = (0, 0);
    for case in 0..600 {
        let mut random = Random(30_000 + case);
        let fixture = &fixtures[random.below(fixtures.len())];
        let mut bytes = std::fs::read(fixture).expect("readable");
        match random.below(3) {
            0 => bytes.truncate(random.below(bytes.len())),
            _ => {
                for _ in 0..=random.below(8) {
                    let at = random.below(bytes.len());
                    bytes[at] =
                        if random.below(2) == 0 { random.below(256) as u8 } else { bytes[at] ^ (1 << random.below(8)) };
                }
            }
        }
        let path = folder.path().join(fixture.file_name().expect("a name"));
        std::fs::write(&path, bytes).expect("written");
        match read(&path, Layout::default(), Wanted::All, &mut Memory::of_program(100_000_000)) {
            Ok(columns) => {
                let fits = |(v, w): (&Vec<f64>, &Option<String>)| v.len() == columns.rows() || w.is_some();
                assert!(columns.values.iter().zip(&columns.wrong).all(fits), "case {case}");
                fine += 1;
            }
            Err(e) => {
                assert!(!e.is_empty());
                refused += 1;
            }
        }
    }
    println!("{fine} read, {refused} refused");
    assert!(fine > 50 && refused > 50);
}
