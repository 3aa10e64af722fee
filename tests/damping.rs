//! `damping` on drives with links: what is let go swings and dies away as the modes of the drive say, and a run-up finds the same by its resonance.

mod common;

use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// The bundled bush chain without guides and friction, with these changes of its text.
fn write_drive(path: &Path, changes: &[(&str, &str)]) {
    let (_, text) = pitchline::drive::BUNDLED[0];
    let cut = text.find("# Straight guides").expect("the guides come last");
    let text = changes.iter().fold(text[..cut].to_string(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    });
    std::fs::write(path, text).expect("a drive");
}

fn pitchline(folder: &Path, line: &str) -> (bool, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_pitchline"))
        .args(line.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("it starts");
    let text = if out.status.success() { &out.stdout } else { &out.stderr };
    (out.status.success(), String::from_utf8_lossy(text).into_owned())
}

fn done(folder: &Path, line: &str) -> String {
    let (is_done, text) = pitchline(folder, line);
    assert!(is_done, "{line}: {text}");
    text
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("json")
}

/// Frequency [Hz] and damping ratio of the mode in which the driven sprocket moves most.
fn mode(folder: &Path, drive: &str, sets: &str) -> (f64, f64) {
    let found = json(&done(folder, &format!("modes {drive} {sets} --json")));
    let share = |m: &Value| {
        let parts = m["moves"].as_array().expect("parts");
        let own = parts.iter().find(|p| p["part"] == "sprockets.driven");
        own.map_or(0.0, |p| p["share"].as_f64().expect("a share"))
    };
    let modes = found["modes"].as_array().expect("modes");
    let most = modes.iter().max_by(|a, b| share(a).total_cmp(&share(b))).expect("a mode");
    (most["frequency_hz"].as_f64().expect("Hz"), most["damping_ratio"].as_f64().expect("a ratio"))
}

const FREE: &str = "--set contact.sprocket.friction=0 --set chain.joint.friction=0";

#[test]
fn what_is_let_go_dies_away_as_its_mode_says() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    write_drive(&folder.join("still.toml"), &[("speed_rpm = 3000", "speed_rpm = 0")]);
    let sets = format!("{FREE} --set chain.joint.damping_n_s_per_m=400");
    let (hz, ratio) = mode(folder, "still.toml", &sets);
    done(folder, &format!("run still.toml {sets} --duration 1ms -o rest.mcap"));
    // Half a per cent of the load falls away.
    done(
        folder,
        "run --resume rest.mcap --set loads.constant.driven.torque_nm=19.9 --duration 100ms --every 20us -o free.mcap",
    );
    let found = json(&done(folder, "damping free.mcap sprocket.driven.speed --from 1.2ms --json"));
    let swing = &found["decay"]["swings"][0];
    println!("modes: {hz} Hz, {ratio}; {found:#}");
    assert!((swing["frequency_hz"].as_f64().expect("Hz") / hz - 1.0).abs() < 5e-4);
    assert!((swing["damping_ratio"].as_f64().expect("a ratio") / ratio - 1.0).abs() < 1e-2);
    assert!(found["decay"]["left"].as_f64().expect("a share") < 1e-3);
    // In words, and of a part that is too short.
    let words = done(folder, "damping free.mcap sprocket.driven.speed --from 1.2ms");
    println!("{words}");
    assert!(words.contains("behind a low-pass filter") && words.contains("is left"));
    let (is_done, why) = pitchline(folder, "damping free.mcap sprocket.driven.speed --from 1.2ms --to 1.3ms");
    assert!(!is_done && why.contains("record it more often"), "{why}");
    let (is_done, why) = pitchline(folder, "damping free.mcap sprocket.driven.speed --order 3");
    assert!(!is_done && why.contains("stands still"), "{why}");
}

#[test]
fn a_run_up_shows_the_damping_of_its_resonance() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    write_drive(&folder.join("still.toml"), &[("speed_rpm = 3000", "speed_rpm = 0")]);
    let speeds = "times_s = [0, 0.6]\nspeeds_rpm = [2500, 3700]\n#";
    let load = "[loads.orders.driven]\norders = [5]\ntorques_nm = [0.5]\nphases_deg = [0]\n\n[preload]";
    let up = [("[speeds.constant.driver]", "[speeds.table.driver]"), ("speed_rpm = 3000", speeds), ("[preload]", load)];
    write_drive(&folder.join("up.toml"), &up);
    let sets = format!("{FREE} --set chain.joint.damping_n_s_per_m=3000");
    let (hz, ratio) = mode(folder, "still.toml", &sets);
    done(folder, &format!("run up.toml {sets} --duration 0.6s --every 200us -o up.mcap"));
    let found = json(&done(folder, "damping up.mcap sprocket.driven.speed --order 5 --window 2 --json"));
    let half = &found["half_power"];
    println!("modes: {hz} Hz, {ratio}; {half:#} {}", found["doubts"]);
    assert!((half["frequency_hz"].as_f64().expect("Hz") / hz - 1.0).abs() < 0.02);
    // What else excites the running chain is in the error that is stated.
    let error = half["damping_ratio_error"].as_f64().expect("an error");
    assert!((half["damping_ratio"].as_f64().expect("a ratio") - ratio).abs() < 2.0 * error && error < 0.2 * ratio);
    let (is_done, why) = pitchline(folder, "damping up.mcap sprocket.driven.speed --order 5 --window 0.4");
    assert!(!is_done && why.contains("--window 0.5"), "{why}");
}
