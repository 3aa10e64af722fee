//! Texts by people, and tables by machines, with errors of every kind.

use super::{Random, root};
use pitchline::breakpoint::{Breakpoint, Names};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::machine::Machine;
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::{ColumnSelection, FileLayout, Memory, read};
use pitchline::recording::columns::Rows;

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
    let names = Names {
        bodies: vec!["sprockets.driver".into(), "guides.fixed.tight".into()],
        turning: vec![("sprockets.driver".into(), 0)],
        rows: vec![(Rows::Touch, vec!["sliders.plunger.tip".into()])],
        chains: vec![90],
    };
    let words = [
        "contact.normal_force",
        "link.speed",
        "touch.plunger.tip.gap",
        "touch.plunger",
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
        match read(&path, FileLayout::default(), ColumnSelection::All, &mut Memory::for_program(100_000_000)) {
            Ok(columns) => {
                let fits = |(v, w): (&Vec<f64>, &Option<String>)| v.len() == columns.rows() || w.is_some();
                assert!(columns.values.iter().zip(&columns.wrong).all(fits), "case {case}");
                fine += 1;
            }
            Err(e) => {
                assert!(!e.to_string().is_empty());
                refused += 1;
            }
        }
    }
    println!("{fine} read, {refused} refused");
    assert!(fine > 50 && refused > 50);
}

/// Records of a disc that a motor drives, each with one property that no test bench would produce.
#[test]
fn records_far_from_any_machine_end_in_an_answer_or_a_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write(
        "rig.toml",
        "fidelity = \"lumped\"\n[rotors.disc]\ninertia_kg_m2 = 0.055\n[loads.viscous.disc]\ntorque_nm_s_per_rad = 0.1\n\
         [inputs.torque.disc]\n[sensors.tachometer.disc]\n",
    );
    let measurement = |drive: &str| {
        format!(
            "title = \"rig\"\ndrive = \"{drive}\"\n[files.a]\npath = \"a.csv\"\n[channels.speed]\n\
             sensor = \"sensors.tachometer.disc\"\ncolumn = \"speed_rpm\"\nunit = \"rpm\"\n[inputs.torque]\n\
             input = \"inputs.torque.disc\"\ncolumn = \"torque\"\nunit = \"N m\"\n[records.a]\nfile = \"a\"\n\
             time_column = \"t\"\ntime_unit = \"s\"\n[fit.\"rotors.disc.inertia_kg_m2\"]\nspread_percent = 20\n"
        )
    };
    let records = |time: &dyn Fn(f64) -> f64, spike: f64, at: usize| {
        let mut random = Random(70_000);
        let mut speed = 0.0;
        let mut text = "t,speed_rpm,torque\n".to_string();
        for i in 0..400 {
            let torque = if i % 100 < 50 { 3.0 } else { 1.0 };
            speed += (torque - 0.1 * speed) / 0.05 * 5e-3;
            let shown = if i == at { spike } else { speed * 9.549 + random.below(100) as f64 * 1e-2 };
            text += &format!("{:e},{shown:e},{torque}\n", time(i as f64));
        }
        text
    };
    let usual = |i: f64| 5e-3 * i;
    for (what, csv) in [
        ("usual", records(&usual, 0.0, usize::MAX)),
        ("a picosecond apart", records(&|i| 1e-12 * i, 0.0, usize::MAX)),
        ("years apart", records(&|i| 1e9 * i, 0.0, usize::MAX)),
        ("smallest floats", records(&|i| (i + if i > 20.0 { 3.0 } else { 0.0 }) * 5e-324, 0.0, usize::MAX)),
        ("largest floats", records(&|i| (i - 200.0) * 8e305, 0.0, usize::MAX)),
        ("a spike", records(&usual, 1e9, 150)),
        ("a spike at the start", records(&usual, 1e12, 0)),
        ("a spike that no float squares", records(&usual, 1e300, 150)),
    ] {
        write("a.csv", &csv);
        write("m.toml", &measurement("rig.toml"));
        let started = std::time::Instant::now();
        let out = super::run(folder.path(), &["identify", "m.toml", "--budget", "300"]);
        println!("{what}: {:?} after {:?}", out.status.code(), started.elapsed());
        assert!(started.elapsed() < 2 * super::LONGEST, "{what}");
    }
    for drive in ["/dev/zero", ".", "missing.toml", "m.toml"] {
        write("m.toml", &measurement(drive));
        let out = super::run(folder.path(), &["identify", "m.toml"]);
        assert_eq!(out.status.code(), Some(2), "{drive}");
    }
    assert_eq!(super::run(folder.path(), &["check", "/dev/zero"]).status.code(), Some(2));
}
