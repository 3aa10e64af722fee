//! The programs in examples/ run, and print what they printed before.

#[path = "common/golden.rs"]
mod golden;
#[allow(dead_code)]
#[path = "../examples/identify_friction.rs"]
mod identify_friction;
#[allow(dead_code)]
#[path = "../examples/read_recording.rs"]
mod read_recording;
#[allow(dead_code)]
#[path = "../examples/run_drive.rs"]
mod run_drive;
#[allow(dead_code)]
#[path = "../examples/stop_at_impact.rs"]
mod stop_at_impact;

use std::path::Path;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn a_bundled_drive_runs_from_code() {
    golden::check("example-run_drive", &run_drive::report().expect("runs"));
}

#[test]
fn a_recording_tells_the_largest_force_on_every_sprocket() {
    let sample = root().join("recordings/samples/bush-20-40.mcap");
    golden::check("example-read_recording", &read_recording::report(&sample).expect("reads"));
}

#[test]
fn a_run_stops_at_an_impact() {
    golden::check("example-stop_at_impact", &stop_at_impact::report().expect("runs"));
}

#[test]
fn friction_is_found_in_measured_records() {
    let measurement = root().join("tests/data/rig/rig-measured.toml");
    golden::check("example-identify_friction", &identify_friction::report(&measurement).expect("identifies"));
}

/// A run in two pieces ends in the State of a run in one piece, and its recordings can be replayed.
#[test]
fn a_run_goes_on_where_it_ended() {
    use pitchline::drive::Drive;
    use pitchline::simulate::Simulation;
    let drive = Drive::bundled("bush-20-40").expect("bundled");
    let folder = tempfile::tempdir().expect("a folder");
    let (first, second) = (folder.path().join("first.mcap"), folder.path().join("second.mcap"));
    let mut whole = Simulation::new(&drive).expect("assembles");
    let at_once = whole.run(4e-3, 50e-6, &[]).expect("runs");
    let mut parts = Simulation::new(&drive).expect("assembles");
    let half = at_once.steps / 2;
    let step_s = parts.model().step_s;
    let before = parts.run(half as f64 * step_s, 50e-6, &[&first]).expect("runs");
    let after = parts.run((at_once.steps - half) as f64 * step_s, 50e-6, &[&second]).expect("runs");
    assert_eq!(before.steps + after.steps, at_once.steps);
    assert_eq!(after.state_hash, at_once.state_hash);
    let out = std::process::Command::new(env!("CARGO_BIN_EXE_pitchline"))
        .args(["replay", "--verify"])
        .arg(&first)
        .output()
        .expect("runs");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
}
