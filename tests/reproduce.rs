//! Claims of the papers: answered from their trials alone, going on from a journal, and honest about what breaks down.

use pitchline::reproduce::laboratory::{ClaimTrial, Laboratory, WorkPace};
use pitchline::reproduce::{ClaimVerdict, claims};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;

fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("pitchline-reproduce-{name}-{}", std::process::id()));
    let _absent = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).expect("a folder");
    path
}

fn answered(ids: &[&str], journal: &Path, threads: usize) -> (Vec<(String, ClaimVerdict, String)>, usize) {
    let mut lab = Laboratory::open(WorkPace::Quick, journal).expect("a laboratory");
    let mut done = 0;
    loop {
        let all: Vec<_> = claims().into_iter().filter(|c| ids.contains(&c.id)).collect();
        let answers: Vec<_> = all.iter().map(|c| c.answer(&lab)).collect();
        let wanted = lab.take_wanted();
        if wanted.is_empty() {
            let told = answers.into_iter().flatten().map(|a| (a.id.to_string(), a.answer.verdict, a.answer.measured));
            return (told.collect(), done);
        }
        done += wanted.len();
        lab.work(&wanted, threads, &AtomicBool::new(false), |_, _| ()).expect("a journal");
    }
}

/// The abutment chain's claims, the closed forms and the bookkeeping stand; the same answers come from the journal without a trial, and from one
/// whose last line was cut off with the trials of that line alone.
#[test]
fn claims_are_answered_and_kept() {
    let ids = ["S03", "S21", "S22", "S23", "S24", "S25", "C02", "C10", "C12", "F01", "L04", "C03", "C06", "C16"];
    let path = folder("kept");
    let journal = path.join("trials.jsonl");
    let (first, trials) = answered(&ids, &journal, 2);
    assert_eq!(first.len(), ids.len());
    for (id, verdict, measured) in &first {
        println!("{id}: {} ({measured})", verdict.name());
        let expected = match id.as_str() {
            "C03" | "C06" => ClaimVerdict::ContradictsItself,
            "C16" => ClaimVerdict::NotCheckable,
            "S24" | "S25" => ClaimVerdict::Trend,
            // The order of touches holds, the force on the teeth does not fall all along the wrap.
            "S23" => ClaimVerdict::NotReproduced,
            _ => ClaimVerdict::Reproduced,
        };
        assert_eq!(*verdict, expected, "{id}: {measured}");
    }
    assert!(trials > 5);
    assert_eq!(answered(&ids, &journal, 1), (first.clone(), 0));
    let bytes = std::fs::read(&journal).expect("a journal");
    std::fs::write(&journal, &bytes[..bytes.len() - 40]).expect("cut off");
    assert_eq!(answered(&ids, &journal, 1), (first, 1));
    std::fs::remove_dir_all(path).expect("removed");
}

/// A drive that cannot be read or assembled is told with its command, and no claim is called reproduced on it.
#[test]
fn what_breaks_down_is_told() {
    let path = folder("broken");
    let mut lab = Laboratory::open(WorkPace::Quick, &path.join("trials.jsonl")).expect("a laboratory");
    let broken = [
        ClaimTrial::rest("no-such-drive"),
        ClaimTrial::run("bush-20-40", 0.0, 1e-3).set("chain.bush.pitch_mm=-8"),
        ClaimTrial::run("bush-20-40", 0.0, 1e-3).signals(&["sprocket.nobody.speed"]),
    ];
    let mut told = Vec::new();
    lab.work(&broken, 1, &AtomicBool::new(false), |trial, facts| {
        told.push((trial.command(), facts.error.clone().unwrap_or_default()));
    })
    .expect("a journal");
    assert_eq!(told.len(), 3);
    for (command, why) in &told {
        println!("{command}: {why}");
        assert!(!why.is_empty() && !why.contains("mistake of pitchline"), "{command}: {why}");
    }
    assert!(lab.all(&broken).is_err());
    std::fs::remove_dir_all(path).expect("removed");
}

/// The command: a page with a picture, bad input, a folder that is in use.
#[test]
fn the_command_writes_its_page() {
    let path = folder("command");
    let run = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pitchline"));
        let out = command.arg("reproduce").args(args).arg("-o").arg(&path).output().expect("runs");
        (
            out.status.code(),
            String::from_utf8_lossy(&out.stdout).into_owned(),
            String::from_utf8_lossy(&out.stderr).into_owned(),
        )
    };
    let (code, out, _) = run(&["S22", "c16", "F03", "--quick"]);
    assert_eq!(code, Some(0), "{out}");
    assert!(out.contains("3 of 3 claims answered"), "{out}");
    let page = std::fs::read_to_string(path.join("claims.html")).expect("a page");
    assert!(page.contains("<svg") && page.contains("id=\"S22\"") && !page.contains("NaN"), "{page}");
    let (code, _, err) = run(&["S99"]);
    assert!(code == Some(2) && err.contains("no claim `S99`") && err.contains("--list"), "{err}");
    let (code, _, err) = run(&["S22", "--paper", "lin"]);
    assert!(code == Some(2) && err.contains("none of these claims"), "{err}");
    let held = std::fs::File::options().append(true).open(path.join("trials.jsonl")).expect("a journal");
    held.try_lock().expect("a lock");
    let (code, _, err) = run(&["S22", "--quick"]);
    assert!(code != Some(0) && err.contains("another run"), "{err}");
    std::fs::remove_dir_all(path).expect("removed");
}
