//! The work of a step, counted in instructions: repeatable on a noisy machine, so that a slow-down fails a test.

#[allow(dead_code)]
#[path = "common/readers.rs"]
mod readers;

use std::process::Command;

/// Instructions per link and step of the bundled drive, AVX2 path (valgrind does not support AVX-512), including
/// everything that grows with the number of steps; 287.2 with contacts whose damper is constant. If a change moves it, measure again, and explain it in the commit.
const INSTRUCTIONS_PER_LINK_STEP: f64 = 301.8;
/// Two measurements agree to 1e-4, for abutments to 1 %, since their assembly costs most and varies; the C library's
/// copies differ between systems.
const TOLERANCE: f64 = 0.05;

/// A drive, overrides, its number of links, instructions per link and step, and the durations between which they are
/// counted [ms].
type Counted = (&'static str, &'static [&'static str], f64, f64, [u32; 2]);

/// The same for drives whose links have contours of their own: silent, abutments on lobes and round rings, abutments
/// that hand over from link to link. 512.3, 762.0 and 786.9 with contacts whose damper is constant. Two builds of the
/// same loop differ by 1 %: the assembly before it, which both runs have, allocates differently.
const CONTOURS: [Counted; 3] = [
    ("silent-20-40", &[], 90.0, 535.9, [2, 4]),
    ("smartchain-20-40", &[], 90.0, 816.0, [2, 12]),
    (
        "smartchain-20-40",
        &[
            "sprockets.driven.teeth=20",
            "sprockets.driven.x_mm=240",
            "sprockets.driven.root_relief_um=30",
            "chain.smartchain.links=80",
            "loads.constant.driven.torque_nm=10",
            "chain.smartchain.handover=two_links",
        ],
        80.0,
        864.7,
        [2, 12],
    ),
];

/// Engines: rails on every span, blades, and for the whole V12 four chains and the oil of two tensioners. 3102.7 and 2422.4 before parts of plates without a
/// piece on a rail were left out, lanes of rails computed in vector registers and far lanes of blades left as they are drawn.
const ENGINES: [Counted; 2] = [("v12-primary", &[], 48.0, 1555.1, [6, 26]), ("v12", &[], 296.0, 1181.1, [4, 14])];

/// Instructions and steps of a run of the bush drive without recording, by callgrind.
fn count(duration_ms: u32, breaks: &[&str]) -> Option<(f64, f64)> {
    count_of("bush-20-40", &[], duration_ms, breaks)
}

fn count_of(drive: &str, sets: &[&str], duration_ms: u32, breaks: &[&str]) -> Option<(f64, f64)> {
    let folder = tempfile::tempdir().expect("a folder");
    let out = Command::new("valgrind")
        .arg("--tool=callgrind")
        .arg(format!("--callgrind-out-file={}", folder.path().join("out").display()))
        .arg(env!("CARGO_BIN_EXE_pitchline"))
        .args(["run", drive, "--no-output", "--json", "--every", "1s"])
        .args(["--set", "run.run_in_ms=0", "--set", "run.settle_ms=0"])
        .args(["--duration", &format!("{duration_ms}ms")])
        .args(sets.iter().flat_map(|set| ["--set", set]))
        .args(breaks)
        .output()
        .ok()?;
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    let collected = said.lines().find_map(|l| l.split_once("Collected : "))?.1.trim().parse().ok()?;
    let result: serde_json::Value = serde_json::from_slice(&out.stdout).ok()?;
    Some((collected, result["steps"].as_f64()?))
}

#[test]
fn a_step_takes_no_more_instructions_than_it_did() {
    let (Some((few, few_steps)), Some((many, many_steps))) = (count(5, &[]), count(15, &[])) else {
        readers::skip("no valgrind");
        return;
    };
    let per_link_step = (many - few) / (many_steps - few_steps) / 90.0;
    println!("{per_link_step:.1} instructions for each link and step, {INSTRUCTIONS_PER_LINK_STEP} when last measured");
    assert!(per_link_step < INSTRUCTIONS_PER_LINK_STEP * (1.0 + TOLERANCE), "slower");
    assert!(
        per_link_step > INSTRUCTIONS_PER_LINK_STEP * (1.0 - 2.0 * TOLERANCE),
        "faster: measure again and keep the gain"
    );
}

#[test]
fn a_step_of_silent_links_takes_no_more_instructions_than_it_did() {
    takes_no_more_than_it_did(&CONTOURS[0]);
}

#[test]
fn a_step_of_abutments_takes_no_more_instructions_than_it_did() {
    takes_no_more_than_it_did(&CONTOURS[1]);
}

#[test]
fn a_step_of_abutments_over_two_links_takes_no_more_instructions_than_it_did() {
    takes_no_more_than_it_did(&CONTOURS[2]);
}

#[test]
fn a_step_of_a_primary_drive_takes_no_more_instructions_than_it_did() {
    takes_no_more_than_it_did(&ENGINES[0]);
}

#[test]
fn a_step_of_a_v12_takes_no_more_instructions_than_it_did() {
    takes_no_more_than_it_did(&ENGINES[1]);
}

fn takes_no_more_than_it_did((drive, sets, links, measured, [few_ms, many_ms]): &Counted) {
    let (Some(few), Some(many)) = (count_of(drive, sets, *few_ms, &[]), count_of(drive, sets, *many_ms, &[])) else {
        readers::skip("no valgrind");
        return;
    };
    let per_link_step = (many.0 - few.0) / (many.1 - few.1) / links;
    println!("{drive} {sets:?}: {per_link_step:.1} instructions for each link and step, {measured} when last measured");
    assert!(
        (per_link_step / measured - 1.0).abs() < 0.1,
        "{drive}: slower, or faster: measure again and keep the gain"
    );
}

/// Expressions evaluated in every step, with their share of a step's instructions [%] on the AVX2 path. User time on
/// the wider path, alternated with runs without: mostly 0 to 5 %, some readings up to 8, energies 5 to 10 %; with
/// recording, none that can be measured. A frame in every step would cost as much as four steps.
const LOOKS: [(&str, f64); 13] = [
    ("energy.error > 10 %", 9.1),
    ("contact.penetration > 1 mm", 4.7),
    ("contact.normal_force > 10 kN", 4.7),
    ("contact.body == \"driver\" and contact.tooth == 70", 8.5),
    ("contact.segment == \"tip land\"", 11.4),
    ("contact.tangential_force > 10 kN", 4.7),
    ("contact.tangential_speed > 1000 m/s", 4.7),
    ("sprocket.driver.chain_torque > 1000 Nm", 0.9),
    ("link.tension > 10 kN", 4.4),
    ("link.speed > 1000 m/s", 3.9),
    ("abs(link.angle) > 4 rad", 3.9),
    ("joint.force > 10 kN", 3.5),
    ("joint.friction_torque > 10 Nm", 2.3),
];

#[test]
fn a_breakpoint_takes_few_instructions() {
    let share = |breaks: &[&str]| Some(count(9, breaks)?.0 - count(4, breaks)?.0);
    let Some(plain) = share(&[]) else {
        readers::skip("no valgrind");
        return;
    };
    for (expression, measured) in LOOKS {
        let share = 100.0 * (share(&["--break", expression]).expect("counted before") / plain - 1.0);
        println!("{expression}: {share:.1} % of a step's instructions, {measured} when last measured");
        assert!(share < measured + 1.0, "{expression}: {share:.1} %");
    }
}

/// Outputs of a run, how many times the instructions of a bare run it may take (AVX2 path) and took when last measured, and the
/// durations between which they are counted [ms]: the view is written in blocks of 1024 frames of 50 us.
type RecordedRun = (&'static [&'static str], f64, f64, [u32; 2]);

/// What recording may cost.
const RECORDED: [RecordedRun; 2] = [(&["a.mcap"], 1.6, 1.49, [10, 30]), (&["b.mcap", "b.rrd"], 2.5, 1.84, [52, 104])];

#[test]
fn recording_is_cheap() {
    let folder = tempfile::tempdir().expect("a folder");
    let per_ms = |outputs: &[String], [few, many]: [u32; 2]| {
        Some((count_recorded(many, outputs)? - count_recorded(few, outputs)?) / f64::from(many - few))
    };
    let Some(bare) = per_ms(&["--no-output".to_string()], [10, 30]) else {
        readers::skip("no valgrind");
        return;
    };
    for (names, limit, measured, durations) in RECORDED {
        if !names.iter().all(|n| pitchline::recording::extensions().iter().any(|e| n.ends_with(e))) {
            continue;
        }
        let path = |name: &&str| folder.path().join(name).display().to_string();
        let outputs: Vec<String> = names.iter().flat_map(|name| ["-o".to_string(), path(name)]).collect();
        let times = per_ms(&outputs, durations).expect("counted before") / bare;
        println!("{names:?}: {times:.2} times the instructions of a bare run, {measured} when last measured");
        assert!(times < limit && times < 1.1 * measured, "{names:?}: {times:.2}");
    }
}

/// Instructions of a run of the bush drive with these outputs, by callgrind.
fn count_recorded(duration_ms: u32, outputs: &[String]) -> Option<f64> {
    let folder = tempfile::tempdir().expect("a folder");
    let out = Command::new("valgrind")
        .arg("--tool=callgrind")
        .arg(format!("--callgrind-out-file={}", folder.path().join("out").display()))
        .arg(env!("CARGO_BIN_EXE_pitchline"))
        .args(["run", "bush-20-40", "--json", "--every", "50us", "--duration", &format!("{duration_ms}ms")])
        .args(["--set", "run.run_in_ms=0", "--set", "run.settle_ms=0"])
        .args(outputs)
        .output()
        .ok()?;
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{said}");
    said.lines().find_map(|l| l.split_once("Collected : "))?.1.trim().parse().ok()
}
