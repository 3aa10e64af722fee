//! Studies: the same table however they are run, what loops share, sensitivities of a known function, bad input.

use pitchline::assemble::{SharedParts, assemble, assemble_sharing};
use pitchline::drive::{BUNDLED, Drive};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// A study of a short run: link scatter, load, friction; some cases break down, because no tooth gap takes the factor's largest roller.
const STUDY: &str = r#"
title = "A short study"
drives = ["bush-20-40"]
duration_ms = 12

[plan.latin_hypercube]
cases = 12
seed = 3

[factors.link_pitch]
path = "effects.pitch_error.*.length_um"
each = "link"
sd = 4

[factors.load]
path = "loads.constant.driven.torque_nm"
sd_percent = 10

[factors.friction]
path = "contact.sprocket.friction"
low = 0.05
high = 0.2

[factors.preload]
path = "preload.tension_n"
values = [300, 100000]

[responses.touches]
of = "impacts.count"

[responses.fastest_m_s]
of = "impacts.approach_speed_max_m_s"

[responses.tension_n]
signal = "span.driven.driver.tension"
value = "mean"

[responses.ratio]
formula = "fastest_m_s / 2.5 + 0 * load"
at_most = 1.0
"#;

fn folder_with(study: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("s.toml"), study).expect("written");
    folder
}

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pitchline"));
    command.current_dir(folder).args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn pitchline(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().expect("it starts")
}

fn said(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned() + &String::from_utf8_lossy(&out.stdout)
}

fn table(folder: &Path, study: &str) -> (Vec<u8>, Vec<u8>) {
    let at = |name: &str| std::fs::read(folder.join(study).join(name)).expect("a table");
    (at("results.parquet"), at("results.csv"))
}

/// One thread, two threads, seven shards, and a run that is killed again and again give the same bytes.
#[test]
fn the_table_is_the_same_however_the_study_is_run() {
    let folder = folder_with(STUDY);
    let at = folder.path();
    let one = pitchline(at, &["study", "s.toml", "-o", "one", "--threads", "1"]);
    assert_eq!(one.status.code(), Some(0), "{}", said(&one));
    let wanted = table(at, "one");
    let rows = String::from_utf8_lossy(&wanted.1).lines().count();
    assert_eq!(rows, 13);
    assert!(said(&one).contains("cases that broke down"), "{}", said(&one));
    assert_eq!(pitchline(at, &["study", "s.toml", "-o", "two", "--threads", "2"]).status.code(), Some(0));
    assert_eq!(table(at, "two"), wanted, "two threads");
    // All at once, into a folder that none of them finds.
    let shards: Vec<_> = [2, 3, 1, 7, 4, 6, 5]
        .map(|index| command(at, &["study", "s.toml", "-o", "seven", "--shard", &format!("{index}/7")]).spawn())
        .into_iter()
        .map(|child| child.expect("it starts"))
        .collect();
    for child in shards {
        let out = child.wait_with_output().expect("it ends");
        assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    }
    assert!((1..=7).all(|index| at.join(format!("seven/shard-{index}-of-7.parquet")).exists()));
    assert_eq!(pitchline(at, &["study", "s.toml", "-o", "seven", "--collect"]).status.code(), Some(0));
    assert_eq!(table(at, "seven"), wanted, "seven shards");
    for _ in 0..3 {
        let mut child =
            command(at, &["study", "s.toml", "-o", "killed", "--resume", "--threads", "1"]).spawn().expect("it starts");
        std::thread::sleep(Duration::from_millis(700));
        let _ended = child.kill();
        child.wait().expect("it ends");
    }
    // Half a line, as a kill in the middle of a write leaves it.
    let journal = at.join("killed/shard-1-of-1.rows");
    let mut text = std::fs::read(&journal).unwrap_or_default();
    text.extend_from_slice(b"{\"case\":99,\"resp");
    std::fs::write(&journal, &text).expect("written");
    let rest = pitchline(at, &["study", "s.toml", "-o", "killed", "--resume"]);
    assert_eq!(rest.status.code(), Some(0), "{}", said(&rest));
    assert_eq!(table(at, "killed"), wanted, "killed and resumed");
    // No case was run twice.
    let lines = std::fs::read_to_string(&journal).expect("text");
    assert_eq!(lines.lines().count(), 12);
}

/// A budget and Ctrl-C end after the running cases; a second collector, another study and a changed one are refused.
#[test]
fn folders_are_kept_from_others() {
    let folder = folder_with(STUDY);
    let at = folder.path();
    let short = pitchline(at, &["study", "s.toml", "-o", "out", "--budget", "0.2s", "--threads", "1"]);
    assert_eq!(short.status.code(), Some(3), "{}", said(&short));
    let status = pitchline(at, &["study", "s.toml", "-o", "out", "--status", "--json"]);
    let value: serde_json::Value = serde_json::from_slice(&status.stdout).expect("JSON");
    assert!(value["done"].as_u64() < value["cases"].as_u64(), "{value}");
    let again = pitchline(at, &["study", "s.toml", "-o", "out"]);
    assert!(again.status.code() == Some(2) && said(&again).contains("--resume"), "{}", said(&again));
    std::fs::write(at.join("t.toml"), STUDY.replace("sd = 4", "sd = 5")).expect("written");
    let other = pitchline(at, &["study", "t.toml", "-o", "out", "--resume"]);
    assert!(other.status.code() == Some(2) && said(&other).contains("belongs to the study `s`"), "{}", said(&other));
    // Bounds and what is kept change no result.
    std::fs::write(at.join("s.toml"), STUDY.replace("at_most = 1.0", "at_most = 0.5")).expect("written");
    let held = std::fs::File::options().write(true).create(true).truncate(false).open(at.join("out/collect.lock"));
    let held = held.expect("a lock");
    held.lock().expect("locked");
    let busy = pitchline(at, &["study", "s.toml", "-o", "out", "--collect"]);
    assert!(busy.status.code() == Some(1) && said(&busy).contains("another process collects"), "{}", said(&busy));
    drop(held);
    assert_eq!(pitchline(at, &["study", "s.toml", "-o", "out", "--resume"]).status.code(), Some(0));
    // A journal of another study is left out, and a folder whose mark is gone is nobody's.
    std::fs::write(at.join("u.toml"), STUDY.replace("seed = 3", "seed = 4")).expect("written");
    std::fs::create_dir(at.join("foreign")).expect("a folder");
    let part = pitchline(at, &["study", "u.toml", "-o", "foreign", "--shard", "1/12"]);
    assert_eq!(part.status.code(), Some(0), "{}", said(&part));
    std::fs::copy(at.join("out/shard-1-of-1.rows"), at.join("foreign/shard-1-of-1.rows")).expect("copied");
    let status = pitchline(at, &["study", "u.toml", "-o", "foreign", "--status"]);
    assert!(
        said(&status).contains("1 of 12 cases done") && said(&status).contains("of another study"),
        "{}",
        said(&status)
    );
    std::fs::remove_file(at.join("foreign/study.json")).expect("removed");
    assert_eq!(pitchline(at, &["study", "u.toml", "-o", "foreign", "--resume"]).status.code(), Some(2));
    std::fs::create_dir(at.join("mine")).expect("a folder");
    std::fs::write(at.join("mine/letter.txt"), "").expect("written");
    let mine = pitchline(at, &["study", "s.toml", "-o", "mine"]);
    assert!(mine.status.code() == Some(2) && said(&mine).contains("none says that it is a study's"), "{}", said(&mine));
}

#[test]
fn mistakes_are_shown_at_their_places() {
    let folder = folder_with(STUDY);
    let at = folder.path();
    for (from, to, wanted) in [
        ("loads.constant.driven.torque_nm", "loads.constant.drivn.torque_nm", "this drive has no value"),
        ("sd_percent = 10", "sd_percent = 10\nlow = 3", "2 spreads"),
        ("sd_percent = 10", "spread = 10", "no spread"),
        ("impacts.count", "impacts.number", "a run gives no number `impacts.number`"),
        ("span.driven.driver.tension", "span.driven.drivr.tension", "has no quantity"),
        ("fastest_m_s / 2.5", "fastest / 2.5", "`fastest` is no response above"),
        ("fastest_m_s / 2.5", "fastest_m_s / / 2.5", "is no formula"),
        ("latin_hypercube", "latin_square", "is no plan"),
        ("cases = 12", "cases = 0", "outside 1"),
        ("each = \"link\"\n", "", "one value for every link, or for all?"),
        ("bush-20-40", "bush-20-4", "did you mean the bundled drive"),
        ("values = [300, 100000]", "values = [300, \"x\"]", "expected a number"),
        ("duration_ms = 12", "set = [\"preload.tensio_n=3\"]\nduration_ms = 12", "`set` does not fit"),
        ("[responses.touches]", "[responses.max]", "a function or a number of formulas"),
        ("low = 0.05", "low = 0.5", "`high` must be larger"),
        ("[responses.ratio]", "[responses.load]", "is the name of a factor too"),
        ("duration_ms = 12", "duration_ms = \"12\"", "a number"),
    ] {
        assert!(STUDY.contains(from), "{from}");
        std::fs::write(at.join("s.toml"), STUDY.replace(from, to)).expect("written");
        let out = pitchline(at, &["study", "s.toml", "-o", "out"]);
        assert!(out.status.code() == Some(2) && said(&out).contains(wanted), "{to}: {}", said(&out));
    }
    assert!(!at.join("out").join("shard-1-of-1.rows").exists());
}

/// Rows of a table: the factors that a file gives, empty cells leave the drive's own value.
#[test]
fn a_table_of_cases_is_run_row_by_row_and_one_case_is_recorded() {
    let study = r#"
drives = ["bush-20-40"]
duration_ms = 2
[plan.rows]
file = "cases.csv"
[factors.load]
path = "loads.constant.driven.torque_nm"
low = 0
high = 1
[factors.rpm]
path = "speeds.constant.driver.speed_rpm"
low = 0
high = 1
[responses.speed]
signal = "sprocket.driver.speed"
value = "mean"
"#;
    let folder = folder_with(study);
    let at = folder.path();
    std::fs::write(at.join("cases.csv"), "rpm,note,load\n1500,a,10\n2000,b,\n").expect("written");
    let out = pitchline(at, &["study", "s.toml", "-o", "out"]);
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let text = std::fs::read_to_string(at.join("out/results.csv")).expect("a table");
    let rows: Vec<Vec<&str>> = text.lines().skip(1).map(|line| line.split(',').collect()).collect();
    assert_eq!((rows[0][2], rows[0][3], rows[1][2], rows[1][3]), ("10.0", "1500.0", "", "2000.0"), "{text}");
    let speed: f64 = rows[1][4].parse().expect("a number");
    assert!((speed / (2000.0 / 60.0 * 2.0 * std::f64::consts::PI) - 1.0).abs() < 1e-9, "{speed}");
    std::fs::write(at.join("cases.csv"), "rpm,note,load\n1500,a,ten\n").expect("written");
    let wrong = pitchline(at, &["study", "s.toml", "-o", "wrong"]);
    assert!(wrong.status.code() == Some(2) && said(&wrong).contains("ten"), "{}", said(&wrong));
    std::fs::write(at.join("cases.csv"), "rpm,note,load\n1500,a,10\n2000,b,\n").expect("written");
    let recorded = pitchline(at, &["study", "s.toml", "-o", "out", "--record", "1"]);
    assert_eq!(recorded.status.code(), Some(0), "{}", said(&recorded));
    assert!(at.join("out/recordings/case-000001.mcap").exists());
    let run = pitchline(
        at,
        &[
            "run",
            "bush-20-40",
            "--set",
            "speeds.constant.driver.speed_rpm=2000",
            "--duration",
            "2ms",
            "--no-output",
            "--json",
        ],
    );
    let value: serde_json::Value = serde_json::from_slice(&run.stdout).expect("JSON");
    assert_eq!(value["state_hash"].as_str(), Some(rows[1][5]), "a case is the run that `run` makes, to the bit");
}

/// A search goes on from its journal to the same end as one that was not interrupted.
#[test]
fn a_search_that_goes_on_ends_where_it_would_have() {
    let study = r#"
drives = ["bush-20-40"]
duration_ms = 1
[optimise]
minimise = "(tension_n - 600) ^ 2"
generations = 10
population = 6
[factors.load]
path = "loads.constant.driven.torque_nm"
low = 5
high = 40
[factors.preload]
path = "preload.tension_n"
low = 200
high = 400
[responses.tension_n]
signal = "span.driven.driver.tension"
value = "mean"
"#;
    let folder = folder_with(study);
    let at = folder.path();
    let whole = pitchline(at, &["optimise", "s.toml", "-o", "whole", "--json"]);
    assert_eq!(whole.status.code(), Some(0), "{}", said(&whole));
    let value: serde_json::Value = serde_json::from_slice(&whole.stdout).expect("JSON");
    let tension = |which: &str| value["drives"][0][which]["responses"]["tension_n"].as_f64().expect("a number");
    assert!((tension("best") - 600.0).abs() < 0.2 * (tension("as_given") - 600.0).abs(), "{value}");
    let short = pitchline(at, &["optimise", "s.toml", "-o", "parts", "--budget", "0.5s", "--threads", "1"]);
    assert_eq!(short.status.code(), Some(3), "{}", said(&short));
    assert_eq!(pitchline(at, &["optimise", "s.toml", "-o", "parts", "--resume"]).status.code(), Some(0));
    assert_eq!(table(at, "parts"), table(at, "whole"));
}

/// A drive that takes profiles or its loop from others is assembled to the same bits as one that tightens its own.
#[test]
fn drives_that_share_parts_are_assembled_to_the_same_bits() {
    let changes = [
        vec!["chain.joint.friction=0.07"],
        vec!["contact.guide.friction=0.02", "contact.sprocket.friction=0.15"],
        vec!["loads.constant.driven.torque_nm=12.5"],
        vec!["speeds.constant.driver.speed_rpm=2200"],
        vec!["effects.pitch_error.a.link=3", "effects.pitch_error.a.length_um=20"],
        vec!["effects.gap_error.driver.gap=7", "effects.gap_error.driver.outward_um=30"],
        vec!["guides.fixed.tight.clearance_um=5"],
        vec!["sprockets.driven.teeth=39"],
        vec!["preload.tension_n=301"],
        vec!["loads.constant.driven.torque_nm=-5"],
    ];
    let mut shares = 0;
    for name in ["bush-20-40", "silent-20-40", "smartchain-20-40", "arm-20-40", "roller-20-40"] {
        let (_, text) = BUNDLED.iter().find(|b| b.0 == name).expect("bundled");
        let shared = SharedParts::default();
        for set in std::iter::once(Vec::new()).chain(changes.clone()) {
            let set: Vec<String> = set.iter().map(ToString::to_string).collect();
            let Ok(drive) = Drive::parse(name, text, &set) else { continue };
            let (Ok(own), Ok(from)) = (assemble(&drive), assemble_sharing(&drive, &shared)) else { continue };
            assert_eq!(own.state.hash(), from.state.hash(), "{name} {set:?}");
            shares += 1;
        }
    }
    assert!(shares > 25, "{shares} drives");
}

/// Parquet tables are read by DuckDB, where it is installed.
#[test]
fn duckdb_reads_the_results() {
    let Some(python) = std::env::var_os("PITCHLINE_PYTHON").map(PathBuf::from) else {
        assert!(std::env::var_os("PITCHLINE_NO_SKIP").is_none(), "PITCHLINE_PYTHON is not set");
        println!("skipped: PITCHLINE_PYTHON names no Python with duckdb");
        return;
    };
    let folder = folder_with(STUDY);
    let at = folder.path();
    assert_eq!(pitchline(at, &["study", "s.toml", "-o", "out"]).status.code(), Some(0));
    let script = "import duckdb\n\
        print(duckdb.sql(\"select count(*), count(error), count(tension_n), max(link_pitch_seed) > 0 from 'out/results.parquet'\").fetchall())\n\
        print(duckdb.sql(\"select count(*), min(wall_s) > 0 from 'out/timing.parquet'\").fetchall())\n";
    let out = Command::new(python).current_dir(at).args(["-c", script]).output().expect("it starts");
    let text = said(&out);
    assert!(text.contains("(12, 6, 6, True)") && text.contains("(12, True)"), "{text}");
}
