//! Speed of the bundled drive, beside a fixed calibration loop timed in the same run. Prints CPU seconds of this process
//! (user and system, all threads) per simulated second: the lowest of several runs, since other work on the machine and pages
//! that the system hands out for the first time only add to them.
//!
//! cargo bench --bench speed

use pitchline::assemble::{Assembly, assemble};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::integrate::Isa;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::recording::{ViewOptions, capture, create};
use pitchline::simulate::{RunLength, run};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

/// Runs of each kind.
const RUNS: usize = 5;
/// Runs without and with recording, by turns.
const RUNS_BY_TURNS: usize = 9;

/// CPU time of this process so far [s]: all of it, and the system's part; by /proc (0 where there is none).
fn cpu_s() -> [f64; 2] {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after = stat.rsplit(')').next().unwrap_or_default();
    let ticks: Vec<f64> = after.split_whitespace().filter_map(|w| w.parse().ok()).collect();
    // utime and stime are fields 14 and 15; the state letter after the name is no number.
    let (user, system) = (ticks.get(10).unwrap_or(&0.0), ticks.get(11).unwrap_or(&0.0));
    [(user + system) / 100.0, system / 100.0]
}

/// CPU time of what `prepare` hands over [s]: the lowest of several runs, the system's part of it, and the highest.
fn lowest<P>(mut prepare: impl FnMut() -> P, work: impl Fn(P)) -> [f64; 3] {
    let mut runs: Vec<[f64; 2]> = (0..RUNS)
        .map(|_| {
            let prepared = prepare();
            let before = cpu_s();
            work(prepared);
            let after = cpu_s();
            [after[0] - before[0], after[1] - before[1]]
        })
        .collect();
    runs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    [runs[0][0], runs[0][1], runs[RUNS - 1][0]]
}

/// A chain of dependent multiplications, divisions and square roots: the same work on every machine.
fn calibration() -> [f64; 3] {
    lowest(
        || (),
        |()| {
            let mut x = 1.5_f64;
            for i in 0..60_000_000_u32 {
                x = (x * 1.000_000_1 + 1.0 / (1.0 + f64::from(i & 7))).sqrt();
            }
            std::hint::black_box(x);
        },
    )
}

fn drive(overrides: &[&str]) -> Drive {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_string()).collect();
    Drive::parse(BUNDLED[0].0, BUNDLED[0].1, &overrides).expect("the bundled drive")
}

/// Kinds of chains: the bundled drives, and other forms of what touches.
const KINDS: [(&str, &str, &[&str]); 6] = [
    ("bush-20-40", "bush-20-40", &[]),
    ("silent-20-40", "silent-20-40", &[]),
    ("smartchain-20-40", "smartchain-20-40", &[]),
    (
        "silent-20-40 with crowned teeth",
        "silent-20-40",
        &[
            "sprockets.driver.face=crowned",
            "sprockets.driver.face_radius_mm=10",
            "sprockets.driver.contact_distance_mm=1.5",
            "sprockets.driven.face=crowned",
            "sprockets.driven.face_radius_mm=20",
            "sprockets.driven.contact_distance_mm=1.5",
        ],
    ),
    (
        "abutments over two links, 20/20 teeth",
        "smartchain-20-40",
        &with(EQUAL_SPROCKETS, "chain.smartchain.handover=two_links"),
    ),
    (
        "hollow abutments, 20/20 teeth",
        "smartchain-20-40",
        &with(EQUAL_SPROCKETS, "chain.smartchain.inclination_deg=3.5"),
    ),
];

/// Both sprockets with 20 teeth: over two links and with hollow abutments rings are round.
const EQUAL_SPROCKETS: [&str; 5] = [
    "sprockets.driven.teeth=20",
    "sprockets.driven.x_mm=240",
    "sprockets.driven.root_relief_um=30",
    "chain.smartchain.links=80",
    "loads.constant.driven.torque_nm=10",
];

const fn with<'a>(all: [&'a str; 5], one: &'a str) -> [&'a str; 6] {
    let [a, b, c, d, e] = all;
    [a, b, c, d, e, one]
}

fn bundled(name: &str, sets: &[&str]) -> Drive {
    let (name, text) = BUNDLED.iter().find(|b| b.0 == name).expect("a bundled drive");
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    Drive::parse(name, text, &sets).unwrap_or_else(|e| panic!("{e}"))
}

fn assembled(drive: &Drive) -> Assembly {
    assemble(drive).unwrap_or_else(|e| panic!("{e}"))
}

fn main() {
    let [calibration_s, _, slowest_s] = calibration();
    println!(
        "calibration loop: {calibration_s:.2} CPU s (lowest of {RUNS} runs here and below; the highest {slowest_s:.2})"
    );
    let duration = 1.0;
    let a = assembled(&drive(&[]));
    let steps = (duration / a.model.step_s) as u64;
    for isa in Isa::available() {
        let [cpu, _, most] = stepped(&a, isa, steps);
        println!(
            "{isa:?}: {cpu:.2} CPU s per simulated s, {:.1} ns per link and step, {:.2} calibrations; the highest {most:.2}",
            cpu / 90.0 / steps as f64 * 1e9,
            cpu / calibration_s
        );
    }
    let folder = tempfile::tempdir().expect("a folder");
    recorded_beside_bare(&drive(&[]), &a, duration, folder.path());
    // All kinds of chains, each beside the bush chain's in the same run.
    for isa in Isa::available().into_iter().filter(|isa| *isa != Isa::Baseline) {
        let mut bush_s = None;
        for (kind, name, sets) in KINDS {
            let a = assembled(&bundled(name, sets));
            // The clock ticks every 10 ms: a run takes at least 40 of them.
            let simulated_s = 1.0;
            let [cpu, ..] = stepped(&a, isa, (simulated_s / a.model.step_s) as u64);
            let per_s = cpu / simulated_s;
            let times = per_s / *bush_s.get_or_insert(per_s);
            println!("{isa:?}, {kind}: {per_s:.2} CPU s per simulated s, {times:.2} times the first");
        }
    }
    let mut bush_s = None;
    for (name, _) in BUNDLED {
        let drive = bundled(name, &[]);
        let a = assembled(&drive);
        let simulated_s = 0.5;
        let [cpu, ..] = recorded(&drive, &a, simulated_s, &[folder.path().join("c.mcap")]);
        let times = cpu / *bush_s.get_or_insert(cpu);
        println!("{name} with the archive: {:.2} CPU s per simulated s, {times:.2} times the first", cpu / simulated_s);
    }
    // Longer chains: what an added link costs.
    let mut last: Option<(f64, f64)> = None;
    for links in [90, 180, 360, 720] {
        let set = [
            format!("chain.bush.links={links}"),
            format!("sprockets.driven.x_mm={}", 238.6 + 4.0 * f64::from(links - 90)),
        ];
        let a = assembled(&drive(&set.iter().map(String::as_str).collect::<Vec<_>>()));
        let steps = (duration / a.model.step_s) as u64;
        let [cpu, ..] = stepped(&a, Isa::detect(), steps);
        let step_ns = cpu / steps as f64 * 1e9;
        let added = last.map_or(String::new(), |(n, ns)| {
            format!(", {:.1} ns a step for every added link", (step_ns - ns) / (f64::from(links) - n))
        });
        println!("{links} links: {step_ns:.0} ns a step{added}");
        last = Some((f64::from(links), step_ns));
    }
}

/// What recording costs: runs without and with outputs by turns, so that all meet the same load of the machine; medians. User
/// time is the program's own work, the system's is the copying of bytes into files.
fn recorded_beside_bare(drive: &Drive, a: &Assembly, duration_s: f64, folder: &std::path::Path) {
    let written = |name: &str| pitchline::recording::extensions().iter().any(|e| name.ends_with(e));
    let kinds: Vec<Vec<&str>> = [vec![], vec!["a.mcap"], vec!["b.mcap", "b.rrd"]]
        .into_iter()
        .filter(|k| k.iter().all(|n| written(n)))
        .collect();
    let mut times: Vec<Vec<[f64; 2]>> = vec![Vec::new(); kinds.len()];
    for _ in 0..RUNS_BY_TURNS {
        for (names, times) in kinds.iter().zip(&mut times) {
            let paths: Vec<_> = names.iter().map(|n| folder.join(n)).collect();
            times.push(recorded_once(drive, a, duration_s, &paths));
        }
    }
    let middle = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    // User and system, and user alone.
    let medians = |times: &[[f64; 2]]| {
        [
            middle(times.iter().map(|[whole, _]| *whole).collect()),
            middle(times.iter().map(|[whole, system]| whole - system).collect()),
        ]
    };
    let bare = medians(&times[0]);
    for (names, times) in kinds.iter().zip(&times) {
        let [cpu, user] = medians(times);
        println!(
            "with {}: {:.2} CPU s per simulated s, {:.2} times the run without; user time {:.2} s, {:.2} times",
            if names.is_empty() { "nothing recorded".to_string() } else { names.join(" and ") },
            cpu / duration_s,
            cpu / bare[0],
            user / duration_s,
            user / bare[1],
        );
    }
}

/// CPU time of a run with a frame every 50 us in each of these files: the lowest of several runs, as [`lowest`].
fn recorded(drive: &Drive, a: &Assembly, duration_s: f64, paths: &[PathBuf]) -> [f64; 3] {
    let mut runs: Vec<[f64; 2]> = (0..RUNS).map(|_| recorded_once(drive, a, duration_s, paths)).collect();
    runs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    [runs[0][0], runs[0][1], runs[RUNS - 1][0]]
}

/// CPU time of one such run, and the system's part of it [s].
fn recorded_once(drive: &Drive, a: &Assembly, duration_s: f64, paths: &[PathBuf]) -> [f64; 2] {
    let span = RunLength::new(duration_s, 50e-6, a.model.step_s);
    let header = capture::header(drive, &a.model, &a.report, span.steps_per_frame);
    paths.iter().for_each(|p| _ = std::fs::remove_file(p));
    let mut state = a.state.clone();
    let before = cpu_s();
    let mut sinks: Vec<_> = paths.iter().map(|p| create(p, &header, ViewOptions::default()).expect("opens")).collect();
    let mut scratch = Scratch::new(&a.model);
    let stop = AtomicBool::new(false);
    run(&a.model, &mut state, &mut scratch, &header, span, &mut sinks, &stop, |_| {}).expect("runs");
    for sink in &mut sinks {
        sink.finish().expect("finishes");
    }
    let after = cpu_s();
    [after[0] - before[0], after[1] - before[1]]
}

/// CPU time of so many steps, without recording.
fn stepped(a: &Assembly, isa: Isa, steps: u64) -> [f64; 3] {
    lowest(
        || (a.state.clone(), Scratch::with_isa(&a.model, isa)),
        |(mut state, mut scratch)| {
            for _ in 0..steps {
                explicit::step(&a.model, &mut state, &mut scratch).expect("holds");
            }
        },
    )
}
