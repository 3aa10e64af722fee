//! Outputs under every name: none of them is ever an input, and an existing file remains until its replacement is
//! complete.

use super::{PROGRAM, run, sample};
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Other names of a file, of every possible kind.
fn other_names(folder: &Path, name: &str) -> Vec<String> {
    let extension = Path::new(name).extension().expect("an ending").to_str().expect("text");
    let at = |name: &str| folder.join(name);
    let (hard, soft) = (format!("hard.{extension}"), format!("soft.{extension}"));
    std::fs::hard_link(at(name), at(&hard)).expect("linked");
    std::os::unix::fs::symlink(name, at(&soft)).expect("linked");
    if !at("here").exists() {
        std::os::unix::fs::symlink(".", at("here")).expect("linked");
    }
    vec![name.into(), format!("./{name}"), hard, soft, format!("here/{name}"), format!("sub/../{name}")]
}

#[test]
fn no_verb_writes_over_what_it_reads() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("sub")).expect("a folder");
    std::fs::copy(sample(), at("in.mcap")).expect("copied");
    std::fs::write(at("drive.toml"), pitchline::drive::BUNDLED[0].1).expect("written");
    let recording = std::fs::read(at("in.mcap")).expect("readable");
    let drive = std::fs::read(at("drive.toml")).expect("readable");
    let mut cases: Vec<Vec<String>> = Vec::new();
    let words = |line: &str, last: &str| line.split(' ').chain([last]).map(str::to_string).collect::<Vec<_>>();
    for name in other_names(folder.path(), "in.mcap") {
        cases.push(words("zoom in.mcap --from 0.1ms --to 0.2ms -o", &name));
        cases.push(words("replay --repair in.mcap -o", &name));
        cases.push(words("run --resume in.mcap --duration 1ms -o", &name));
        cases.push(
            words("run bush-20-40 --duration 1ms -o new.mcap -o", &name)
                .into_iter()
                .chain(["-o".into(), "./new.mcap".into()])
                .collect(),
        );
    }
    for name in other_names(folder.path(), "drive.toml") {
        cases.push(words("lump drive.toml -o", &name));
    }
    for (ending, line) in [
        ("svg", "snapshot in.mcap --at 0.1ms -o"),
        ("svg", "explain in.mcap --link 3 --at 0.2ms -o"),
        ("rrd", "view in.mcap -o"),
        ("csv", "export in.mcap --tables links -o"),
    ] {
        let name = format!("alias-{}.{ending}", cases.len());
        std::fs::hard_link(at("in.mcap"), at(&name)).expect("linked");
        cases.push(words(line, &name));
    }
    for args in &cases {
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let out = run(folder.path(), &args);
        let said = String::from_utf8_lossy(&out.stderr);
        let without_viewer = args[0] == "view" && said.contains("without the feature");
        assert_eq!(out.status.code(), Some(2), "{args:?}: {said}");
        let why = said.contains("not overwritten") || said.contains("are one file") || said.contains("given twice");
        assert!(why || without_viewer, "{args:?}: {said}");
        assert!(std::fs::read(at("in.mcap")).expect("there") == recording, "{args:?}");
        assert!(std::fs::read(at("drive.toml")).expect("there") == drive, "{args:?}");
    }
    println!("{} outputs refused", cases.len());
}

#[test]
fn an_existing_recording_is_replaced_only_by_a_run_that_ends_well() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    assert!(run(folder.path(), &["run", "bush-20-40", "--duration", "1ms", "-o", "a.mcap"]).status.success());
    let before = std::fs::read(at("a.mcap")).expect("recorded");
    for signal in ["-INT", "-TERM", "-KILL"] {
        let mut child = Command::new(PROGRAM)
            .args(["run", "bush-20-40", "--duration", "100s", "-o", "a.mcap"])
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        let started = Instant::now();
        while std::fs::metadata(at("a.unfinished.mcap")).map_or(0, |m| m.len()) < 200_000 {
            assert!(started.elapsed() < Duration::from_secs(60), "grows");
            std::thread::sleep(Duration::from_millis(5));
        }
        let told = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("told");
        assert!(told.success());
        let mut said = String::new();
        child.stderr.take().expect("piped").read_to_string(&mut said).expect("text");
        let code = child.wait().expect("ends").code();
        assert_eq!(code, if signal == "-KILL" { None } else { Some(130) }, "{said}");
        assert!(signal == "-KILL" || said.contains("a.unfinished.mcap"), "{said}");
        assert!(std::fs::read(at("a.mcap")).expect("there") == before, "{signal}");
        let opened = run(folder.path(), &["impacts", "a.unfinished.mcap", "--top", "1"]);
        assert_eq!(opened.status.code(), Some(if signal == "-KILL" { 3 } else { 0 }));
        std::fs::remove_file(at("a.unfinished.mcap")).expect("removed");
    }
    assert!(run(folder.path(), &["run", "bush-20-40", "--duration", "2ms", "-o", "a.mcap"]).status.success());
    assert!(std::fs::read(at("a.mcap")).expect("there") != before);
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1, "nothing is left beside it");
}

/// The shell's limit on the size of files, in blocks of 1024 bytes.
#[test]
fn a_file_that_may_not_grow_is_an_error_and_opens() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = Command::new("bash")
        .args(["-c", "ulimit -f 600; exec \"$0\" run bush-20-40 --duration 50ms -o a.mcap", PROGRAM])
        .current_dir(folder.path())
        .output()
        .expect("runs");
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("cannot write a.mcap") && said.contains("is kept in a.mcap"), "{said}");
    let opened = run(folder.path(), &["impacts", "a.mcap"]);
    assert_eq!(opened.status.code(), Some(3), "{}", String::from_utf8_lossy(&opened.stderr));
    // A drawing is complete, or does not exist.
    std::fs::copy(sample(), folder.path().join("in.mcap")).expect("copied");
    let out = Command::new("bash")
        .args(["-c", "ulimit -f 8; exec \"$0\" snapshot in.mcap --at 0.1ms -o s.svg", PROGRAM])
        .current_dir(folder.path())
        .output()
        .expect("runs");
    assert_eq!(out.status.code(), Some(1), "{}", String::from_utf8_lossy(&out.stderr));
    let left: Vec<_> =
        std::fs::read_dir(folder.path()).expect("a folder").map(|f| f.expect("a file").file_name()).collect();
    assert_eq!(left.len(), 2, "{left:?}");
}

#[test]
fn a_run_whose_result_nobody_reads_ends_and_its_recording_is_whole() {
    let folder = tempfile::tempdir().expect("a folder");
    let started = Instant::now();
    let mut child = Command::new(PROGRAM)
        .args(["run", "bush-20-40", "--duration", "100s", "-o", "a.mcap"])
        .current_dir(folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    while !folder.path().join("a.mcap").exists() {
        assert!(started.elapsed() < Duration::from_secs(60), "begins");
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_millis(100));
    drop(child.stdout.take());
    let mut said = String::new();
    child.stderr.take().expect("piped").read_to_string(&mut said).expect("text");
    assert_eq!(child.wait().expect("ends").code(), Some(130), "{said}");
    assert!(said.contains("nobody reads the result any more"), "{said}");
    assert_eq!(run(folder.path(), &["impacts", "a.mcap", "--top", "1"]).status.code(), Some(0));
}

#[test]
fn a_pipe_that_nobody_reads_is_given_up() {
    let folder = tempfile::tempdir().expect("a folder");
    assert!(Command::new("mkfifo").arg(folder.path().join("p.mcap")).status().expect("made").success());
    let out = run(folder.path(), &["run", "bush-20-40", "--duration", "1ms", "-o", "p.mcap"]);
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("waiting for") && said.contains("nobody reads this pipe"), "{said}");
    // A pipe with a reader receives everything.
    let (from, to) = (folder.path().join("p.mcap"), folder.path().join("q.mcap"));
    let reader = std::thread::spawn(move || std::fs::write(to, std::fs::read(from).expect("read")).expect("written"));
    assert!(run(folder.path(), &["run", "bush-20-40", "--duration", "1ms", "-o", "p.mcap"]).status.success());
    reader.join().expect("read");
    assert_eq!(run(folder.path(), &["impacts", "q.mcap"]).status.code(), Some(0));
}

#[test]
fn wild_command_lines_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let verbs = [
        "run", "impacts", "explain", "diff", "zoom", "replay", "snapshot", "check", "export", "identify", "lump",
        "effects",
    ];
    let values = [
        "",
        "-0",
        "1e300s",
        "1e300",
        "nan",
        "/dev/null",
        ".",
        "missing.mcap",
        "bush-20-40",
        "x=y",
        "0us",
        "--",
        "\u{1f517}",
    ];
    let flags = [
        "--at",
        "--from",
        "--to",
        "--every",
        "--duration",
        "--set",
        "--link",
        "-o",
        "--impact",
        "--break",
        "--live-wait",
        "--top",
    ];
    let mut random = super::Random(60_000);
    for _ in 0..120 {
        let mut args = vec![random.of(&verbs)];
        for _ in 0..random.below(5) {
            args.push(random.of(&flags));
            args.push(random.of(&values));
        }
        args.push(random.of(&values));
        // A run, if the case contains one, is short.
        if args[0] == "run" {
            args.extend(["--duration", "0.1ms", "--no-output"]);
        }
        run(folder.path(), &args);
    }
    let wait = run(folder.path(), &["run", "bush-20-40", "--live", "foxglove=0", "--live-wait", "1e300s"]);
    assert_eq!(wait.status.code(), Some(2));
}

#[test]
fn a_recording_that_is_a_pipe_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    assert!(Command::new("mkfifo").arg(folder.path().join("p.mcap")).status().expect("made").success());
    for args in [
        &["impacts", "p.mcap"][..],
        &["replay", "--verify", "p.mcap"],
        &["view", "p.mcap"],
        &["run", "--resume", "p.mcap"],
    ] {
        assert_eq!(run(folder.path(), args).status.code(), Some(2), "{args:?}");
    }
}
