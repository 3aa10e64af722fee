//! The command-line program: results, errors, exit codes.

#[path = "common/docs.rs"]
mod docs;

use docs::{pages, shell_words};
use pitchline::drive::BUNDLED;
use std::process::{Command, Output};

fn pitchline(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pitchline")).args(args).output().expect("the program starts")
}

fn stdout(out: &Output) -> String {
    String::from_utf8_lossy(&out.stdout).into_owned()
}

fn stderr(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

fn json(out: &Output) -> serde_json::Value {
    assert!(out.status.success(), "{}", stderr(out));
    serde_json::from_slice(&out.stdout).expect("stdout is one JSON document")
}

#[test]
fn run_prints_its_results_and_writes_its_recordings() {
    let folder = tempfile::tempdir().expect("a folder");
    let mcap = folder.path().join("a.mcap");
    let path = mcap.to_str().expect("text");
    let out = json(&pitchline(&["run", "bush-20-40", "--duration", "5ms", "-o", path, "--json"]));
    for key in ["drive", "simulated_s", "step_s", "steps", "frames", "wall_s", "state_hash", "outputs"] {
        assert!(!out[key].is_null(), "{key}");
    }
    for key in ["work_in_j", "work_out_j", "dissipated_j", "stored_change_j", "error_j", "error_fraction"] {
        assert!(out["energy"][key].is_number(), "energy.{key}");
    }
    assert!((out["simulated_s"].as_f64().expect("a number") - 5e-3).abs() < 5e-6);
    assert_eq!(out["outputs"][0]["path"], path);
    let again = json(&pitchline(&["run", "bush-20-40", "--duration", "5ms", "--no-output", "--json"]));
    assert_eq!(out["state_hash"], again["state_hash"]);
}

#[test]
fn run_counts_what_contacts_cost_by_pair_and_changes_no_bit() {
    let args = ["run", "smartchain-20-40", "--duration", "1ms", "--no-output", "--json"];
    let plain = json(&pitchline(&args));
    assert!(plain["contact_pairs"].is_null());
    let counted = json(&pitchline(&[&args[..], &["--stats"]].concat()));
    assert_eq!(plain["state_hash"], counted["state_hash"]);
    let pairs = counted["contact_pairs"].as_array().expect("pairs");
    let bodies: Vec<&str> = pairs.iter().map(|p| p["body"].as_str().expect("a name")).collect();
    for pair in pairs {
        let count = |key: &str| pair[key].as_u64().expect("a count");
        assert!(count("queries") >= count("solved") && 8 * count("solved") >= count("hits"), "{pair}");
        assert!(pair["share_of_time"].as_f64().is_some_and(|share| share > 0.0 && share < 1.0), "{pair}");
    }
    assert!(pairs.iter().any(|p| p["part"] == "abutment" && p["hits"].as_u64() > Some(0)), "{bodies:?}");
    let table = stdout(&pitchline(&[&args[..5], &["--stats"]].concat()));
    assert!(bodies.iter().all(|body| table.contains(body)) && table.contains("ns/query"), "{table}");
}

#[test]
fn geometry_prints_the_worked_numbers_and_draws() {
    let folder = tempfile::tempdir().expect("a folder");
    let svg = folder.path().join("s.svg");
    let args = [
        "geometry",
        "sprocket",
        "--teeth",
        "20",
        "--pitch-mm",
        "8",
        "--roller-mm",
        "5",
        "--form",
        "min",
        "--json",
        "-o",
    ];
    let mut all = args.to_vec();
    all.push(svg.to_str().expect("text"));
    let out = json(&pitchline(&all));
    let near = |key: &str, value: f64| {
        let found = out[key].as_f64().unwrap_or(f64::NAN);
        assert!((found - value).abs() < 5e-4, "{key} = {found}, expected {value}");
    };
    near("pitch_diameter_mm", 51.1396);
    near("root_diameter_mm", 46.1396);
    near("tip_diameter_min_mm", 53.4996);
    near("tip_diameter_max_mm", 56.1396);
    near("seat_radius_mm", 2.525);
    near("seat_angle_deg", 135.5);
    near("flank_radius_mm", 13.2);
    near("pointed_radius_mm", 28.494);
    assert!((out["flank_centre_mm"][0].as_f64().expect("x") - 14.55412).abs() < 1e-5);
    let drawing = std::fs::read_to_string(&svg).expect("drawn");
    assert!(drawing.contains("<svg") && drawing.matches('A').count() > 80, "arcs are arcs");
}

#[test]
fn geometry_of_silent_chain_prints_the_worked_numbers_and_draws() {
    let folder = tempfile::tempdir().expect("a folder");
    let svg = folder.path().join("s.svg");
    let path = svg.to_str().expect("text");
    let near = |out: &serde_json::Value, key: &str, value: f64| {
        let found = out[key].as_f64().unwrap_or(f64::NAN);
        assert!((found - value).abs() < 6e-7, "{key} = {found}, expected {value}");
    };
    let chain = ["geometry", "chain", "--type", "silent", "--pitch-mm", "8"];
    let link = json(&pitchline(&[&chain[..], &["--json", "-o", path]].concat()));
    #[rustfmt::skip]
    let known = [
        ("face_distance_mm", 3.0), ("inner_face_distance_mm", 2.5), ("toe_radius_mm", 0.8), ("crotch_radius_mm", 1.2),
        ("toe_offset_mm", 0.288675), ("toe_depth_mm", 3.9), ("outer_flank_length_mm", 3.233162),
        ("inner_flank_end_mm", 3.521837), ("inner_flank_start_mm", -1.591412), ("crotch_centre_mm", -0.471797),
        ("crotch_top_mm", 0.728203), ("toe_low_mm", -4.7),
    ];
    for (key, value) in known {
        near(&link, key, value);
    }
    assert!(std::fs::read_to_string(&svg).expect("drawn").contains("<svg"));
    let sprocket = ["geometry", "sprocket", "--teeth", "20", "--pitch-mm", "8", "--profile"];
    let arc = json(&pitchline(&[&sprocket[..], &["silent-arc", "--json", "-o", path]].concat()));
    for (key, value) in
        [("face_offset_mm", 6.163401), ("contact_distance_mm", 1.818321), ("half_tooth_angle_deg", 12.0)]
    {
        near(&arc, key, value);
    }
    assert!((arc["face_centre_mm"][0].as_f64().expect("x") + 4.585109).abs() < 6e-7);
    assert!(std::fs::read_to_string(&svg).expect("drawn").matches('A').count() > 120, "arcs are arcs");
    let line = json(&pitchline(&[&sprocket[..], &["silent-line", "--json"]].concat()));
    assert!(line["contact_distance_mm"].is_null() && line["root_arc_radius_mm"].is_number());
    assert!(stdout(&pitchline(&[&sprocket[..], &["silent-arc"]].concat())).contains("clearance of swinging toe"));
    // Errors of the user, each with a remedy.
    let refused = |args: &[&str], says: &str| {
        let out = pitchline(args);
        assert_eq!(out.status.code(), Some(2), "{args:?}");
        assert!(stderr(&out).contains(says), "{args:?}: {}", stderr(&out));
    };
    refused(&sprocket[..6], "--roller-mm");
    refused(&[&sprocket[..], &["silent-arc", "--roller-mm", "5"]].concat(), "no rollers");
    refused(&[&sprocket[..], &["iso606", "--roller-mm", "5", "--toe-radius-mm", "1"]].concat(), "--toe-radius-mm");
    refused(&[&sprocket[..], &["silent-arc", "--tip-mm", "51.4"]].concat(), "at most 50.9263 mm");
    refused(&["geometry", "sprocket", "--teeth", "12", "--pitch-mm", "8", "--profile", "silent-arc"], "13 ..= 150");
    refused(&[&chain[..], &["--toe-radius-mm", "2.7"]].concat(), "at most 2.6667 mm");
    refused(&[&chain[..], &["-o", "link.png"]].concat(), ".svg");
}

#[test]
fn compare_judges_and_records_the_three_chains() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_str().expect("text");
    let out = json(&pitchline(&["compare", "--duration", "24ms", "--recorded", "2ms", "-o", path, "--json"]));
    assert_eq!(out["drives"].as_array().map(Vec::len), Some(3));
    assert_eq!(out["impact_free"], true, "{:#}", out["claims"]);
    let of = |chain: usize, key: &str| out["drives"][chain][key].as_f64().unwrap_or_else(|| panic!("{key}"));
    for key in [
        "engagements",
        "approach_speed_p50_m_s",
        "approach_speed_max_m_s",
        "peak_force_p50_n",
        "peak_force_max_n",
        "steady_force_n",
        "peak_to_steady",
        "impulse_p50_n_s",
        "contact_sequence_share",
        "span_speed_ripple",
    ] {
        println!("{key}: {:.6} {:.6} {:.6}", of(0, key), of(1, key), of(2, key));
        assert!((0..3).all(|chain| of(chain, key) > 0.0), "{key}");
    }
    // Bushes that strike are loaded at once, abutments over half a tooth period.
    assert!(of(0, "rise_time_p50_s") < 2e-5 && of(2, "rise_time_p50_s") > 2e-4);
    assert!(of(0, "peak_to_steady") > 2.5 && of(2, "peak_to_steady") < 1.5 * of(1, "peak_to_steady"));
    assert!(out["drives"][0]["verdict"].as_str().is_some_and(|v| v.starts_with("strikes")));
    assert!(out["drives"][2]["verdict"].as_str().is_some_and(|v| v.starts_with("engages without impact")));
    let page = std::fs::read_to_string(folder.path().join("compare.html")).expect("a report");
    assert!(page.contains("<svg") && !page.contains("http"), "needs nothing else");
    let recording = pitchline::recording::mcap::read(&folder.path().join("compare.mcap")).expect("reads");
    assert!(recording.complete && recording.frames.len() > 30);
    assert_eq!(recording.header.links.len(), 270);
    assert_eq!(recording.header.bodies.iter().filter(|b| b.rotor).count(), 6);
    // Silent and abutment chain lie below the bush chain, and every contact names an existing body.
    let frame = &recording.frames[0];
    assert!(frame.links.y_m[100] < frame.links.y_m[10] && frame.links.y_m[200] < frame.links.y_m[100]);
    assert!(frame.contacts.body.iter().all(|b| (*b as usize) < recording.header.bodies.len()));
    let sweep = ["--speed-rpm", "3000,1500", "--load-nm", "18", "--duration", "90ms", "--recorded", "1ms"];
    let out =
        json(&pitchline(&[&["compare", "--drives", "bush-20-40", "-o", path, "--json"], sweep.as_slice()].concat()));
    let at = |k: usize, key: &str| out["sweep"][k]["drives"][0][key].as_f64().expect(key);
    assert_eq!(
        (out["sweep"][0]["speed_rpm"].as_f64(), out["sweep"][1]["speed_rpm"].as_f64()),
        (Some(1500.0), Some(3000.0))
    );
    assert!(at(1, "peak_force_max_n") > 1.3 * at(0, "peak_force_max_n"), "{}", out["sweep"]);
    assert!(at(1, "driven_speed_tooth_order") > 1e-4, "{}", out["sweep"]);
    // 18 N m on 50.9 mm are 353.4 N.
    assert!((at(1, "tight_tension_n") - 530.0).abs() < 15.0, "{}", out["sweep"]);
    let page = std::fs::read_to_string(folder.path().join("compare.html")).expect("a page");
    for wanted in ["What touches link", "Speed of the driven sprocket", "z = 20", "Over speed", "1500"] {
        assert!(page.contains(wanted), "no `{wanted}`");
    }
    for wrong in [["--speed-rpm", "0"], ["--speed-rpm", "fast"], ["--load-nm", "x"], ["--drives", "no-such-drive"]] {
        assert_eq!(
            pitchline(&[&["compare", "--no-output"], wrong.as_slice()].concat()).status.code(),
            Some(2),
            "{wrong:?}"
        );
    }
    let wrong = pitchline(&["compare", "--no-output", "--set", "bush:chain.joint.friction=0"]);
    assert_eq!(wrong.status.code(), Some(2), "{}", stderr(&wrong));
}

#[test]
fn drives_check_and_completions_answer() {
    assert!(stdout(&pitchline(&["drives"])).contains("bush-20-40"));
    let text = stdout(&pitchline(&["drives", "bush-20-40"]));
    assert!(text.contains("[chain.bush]"));
    let check = json(&pitchline(&["check", "bush-20-40", "--json"]));
    assert_eq!(check["links"], 90);
    assert!(check["assembly"]["residual_n"].as_f64().expect("a number") < 1e-6);
    for shell in ["bash", "zsh", "fish"] {
        assert!(stdout(&pitchline(&["completions", shell])).contains("pitchline"));
    }
}

/// Bad input: arguments, exit code, required message.
#[test]
fn mistakes_are_said_at_the_right_place_with_the_right_exit_code() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = stdout(&pitchline(&["drives", "bush-20-40"]));
    let file = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).expect("writable");
        path.to_str().expect("text").to_string()
    };
    let changed = |name: &str, from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        file(name, text.replacen(from, to, 1).as_bytes())
    };
    let noise: Vec<u8> = (0..10_000_000_u64).map(|i| (i.wrapping_mul(6_364_136_223_846_793_005) >> 56) as u8).collect();
    let directory = folder.path().to_str().expect("text").to_string();
    let set = |drive: &str, value: &str| vec![drive.to_string(), "--set".into(), value.to_string()];
    let cases: Vec<(Vec<String>, i32, Vec<&str>)> = vec![
        (
            vec![changed("key.toml", "pitch_mm = 8.0", "pich_mm = 8.0")],
            2,
            vec!["unknown key `chain.bush.pich_mm`", "did you mean `pitch_mm`?", "key.toml:12:1", "^"],
        ),
        (vec![changed("unit.toml", "pitch_mm = 8.0", "pitch_in = 0.315")], 2, vec!["pitch_in", "write `pitch_mm`"]),
        (
            vec![changed("mass.toml", "density_kg_per_m3 = 7850", "density_kg_per_m3 = -7850")],
            2,
            vec!["density_kg_per_m3", "outside"],
        ),
        (vec![changed("nan.toml", "tension_n = 300", "tension_n = nan")], 2, vec!["preload.tension_n", "NaN"]),
        (
            vec![changed("teeth.toml", "teeth = 20", "teeth = 3")],
            2,
            vec!["sprockets.driver.teeth", "outside 9 ..= 150", "^"],
        ),
        (vec![changed("syntax.toml", "[chain.joint]", "[chain.joint")], 2, vec!["not valid TOML", "syntax.toml:"]),
        (
            vec![changed("text.toml", "teeth = 20", "teeth = \"many\"")],
            2,
            vec!["sprockets.driver.teeth", "a text", "whole number"],
        ),
        (
            vec!["bush-20-40".into(), "--set".into(), "sprockets.driver.tip_diameter_mm=55.5".into()],
            2,
            vec!["pointed", "54.8"],
        ),
        (vec!["bush-20-40".into(), "--set".into(), "chain.bush.links=30".into()], 2, vec!["links", "would fit"]),
        (vec!["bush-20-40".into(), "--set".into(), "chain.bush.links=91".into()], 2, vec!["odd"]),
        (
            vec!["bush-20-40".into(), "--set".into(), "guides.fixed.tight.end_mm=2".into()],
            2,
            vec!["guide `tight` runs through sprocket `driver`"],
        ),
        (vec!["bush-20-40".into(), "--set".into(), "run.step_us=20".into()], 2, vec!["too large", "would do"]),
        (
            vec!["bush-20-40".into(), "--set".into(), "sprockets.drver.teeth=21".into()],
            2,
            vec!["no value `sprockets.drver.teeth`", "`sprockets.driver.teeth`"],
        ),
        (vec!["bush-20-40".into(), "--set".into(), "nonsense".into()], 2, vec!["has no `=`"]),
        (vec!["no-such-drive.toml".into()], 2, vec!["cannot read drive", "bundled drives"]),
        (vec!["bush-20-4".into()], 2, vec!["did you mean the bundled drive `bush-20-40`"]),
        (vec![file("noise.toml", &noise)], 2, vec!["noise.toml", "at most"]),
        (vec![file("binary.toml", &noise[..1000])], 2, vec!["not UTF-8"]),
        (vec!["bush-20-40".into(), "-o".into(), directory.clone()], 2, vec!["is a directory"]),
        (vec!["bush-20-40".into(), "-o".into(), format!("{directory}/a.avi")], 2, vec!["recordings end in"]),
        (
            vec!["bush-20-40".into(), "-o".into(), format!("{directory}/missing/a.mcap")],
            1,
            vec!["cannot write", "a.mcap"],
        ),
        (vec!["bush-20-40".into(), "--duration".into(), "3".into()], 2, vec!["unit"]),
        (set("smartchain-20-40", "chain.smartchain.teeth=24"), 2, vec!["made for 24 teeth", "fewest teeth"]),
        (
            set("smartchain-20-40", "chain.smartchain.design_tension_n=1e6"),
            2,
            vec!["stretches a link", "2 % of the pitch"],
        ),
        (set("smartchain-20-40", "chain.smartchain.abutment_mm=-1"), 2, vec!["abutment_mm", "outside"]),
        (set("smartchain-20-40", "sprockets.driver.ring=round"), 2, vec!["sprockets.driver.ring", "conjugate"]),
        (set("smartchain-20-40", "guides.fixed.tight.side=outside"), 2, vec!["abutments lie inside the loop"]),
        (set("silent-20-40", "guides.fixed.tight.side=inside"), 2, vec!["teeth inside the loop"]),
        (set("silent-20-40", "sprockets.driver.teeth=11"), 2, vec!["13 ..= 150"]),
        (set("silent-20-40", "chain.silent.toe_radius_mm=3"), 2, vec!["at most 2.6667 mm", "--set:1:28"]),
        (
            set("silent-20-40", "chain.silent.flank_angle_deg=22"),
            2,
            vec!["root clearance may be at most", "sprockets.driver"],
        ),
        (set("silent-20-40", "sprockets.driver.tip_diameter_mm=60"), 2, vec!["pointed", "tip_diameter_mm=60"]),
        (set("silent-20-40", "sprockets.driver.face=crowned"), 2, vec!["face_radius_mm", "missing"]),
        (set("silent-20-40", "sprockets.driver.face_radius_mm=9"), 2, vec!["needs `face = \"crowned\"`"]),
        (set("smartchain-20-40", "chain.smartchain.inclination_deg=2"), 2, vec!["no lobed ring", "as many teeth"]),
        (set("silent-20-40", "chain.silent.inner.pin_pitch_mm=9"), 2, vec!["far from", "7.600 to 8.400 mm"]),
        (set("bush-20-40", "chain.bush.inner.pitch_mm=9"), 2, vec!["far from", "7.600 to 8.400 mm"]),
        (set("smartchain-20-40", "chain.smartchain.inclination_deg=5"), 2, vec!["(a cusp)", "up to 4.5916"]),
        (set("smartchain-20-40", "chain.smartchain.inclination_deg=9"), 2, vec!["no link leads"]),
        (set("smartchain-20-40", "chain.smartchain.handover=three_links"), 2, vec!["handover", "two_links"]),
        (
            set("smartchain-20-40", "chain.smartchain.rise_um=200"),
            2,
            vec!["`chain.smartchain.rise_um` needs `handover = \"two_links\"`"],
        ),
        (
            set("smartchain-20-40", "chain.smartchain.handover=two_links"),
            2,
            vec!["sprocket `driven`", "lobes of neighbouring teeth", "ring = \"plain\""],
        ),
        (
            vec![changed("two.toml", "[chain.joint]", "[chain.silent]\nlinks = 90\n\n[chain.joint]")],
            2,
            vec!["more than one type"],
        ),
    ];
    for (rest, code, messages) in cases {
        let mut args = vec!["run", "--duration", "1ms"];
        if rest.iter().any(|r| r == "--duration") {
            args.truncate(1);
        }
        if !rest.iter().any(|r| r == "-o") {
            args.push("--no-output");
        }
        args.extend(rest.iter().map(String::as_str));
        let out = pitchline(&args);
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(code), "{rest:?}: {said}");
        for message in messages {
            assert!(said.contains(message), "{rest:?} should say {message:?}:\n{said}");
        }
        assert!(out.stdout.is_empty() && !said.contains("panicked"), "{rest:?}");
    }
}

#[test]
fn all_mistakes_of_a_file_come_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = stdout(&pitchline(&["drives", "bush-20-40"]));
    let broken = text.replacen("teeth = 20", "teeth = 2", 1).replacen("friction = 0.1", "fricton = 0.1", 1).replacen(
        "tension_n = 300",
        "tension_n = \"x\"",
        1,
    );
    let path = folder.path().join("three.toml");
    std::fs::write(&path, broken).expect("writable");
    let said = stderr(&pitchline(&["check", path.to_str().expect("text")]));
    assert_eq!(said.matches("error: ").count(), 3, "{said}");
}

#[test]
fn a_full_disk_ends_with_one_and_names_the_file() {
    if !std::path::Path::new("/dev/full").exists() {
        println!("skipped: this system has no /dev/full");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("full.mcap");
    std::os::unix::fs::symlink("/dev/full", &path).expect("a link");
    let out = pitchline(&["run", "bush-20-40", "--duration", "5ms", "-o", path.to_str().expect("text")]);
    assert_eq!(out.status.code(), Some(1));
    assert!(stderr(&out).contains("full.mcap") && stderr(&out).contains("No space left"), "{}", stderr(&out));
}

/// The commands of README.md and of all chapters of docs/ are run with all their flags: an unknown flag or an invalid
/// value is an error before `--help` at the end.
#[test]
fn the_commands_of_the_readme_exist() {
    assert_eq!(shell_words("run 'a b' -o x.mcap  # so"), ["run", "a b", "-o", "x.mcap"]);
    let flags = pitchline(&["run", "bush-20-40", "--no-such-flag", "--help"]);
    assert_eq!(flags.status.code(), Some(2));
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut seen = 0;
    for page in std::iter::once(root.join("README.md")).chain(pages(&root.join("docs"))) {
        let text = std::fs::read_to_string(&page).expect("a page");
        for line in text.lines().filter_map(|l| l.trim().strip_prefix("$ pitchline ")) {
            let words = shell_words(line);
            let args: Vec<&str> = words.iter().map(String::as_str).chain(["--help"]).collect();
            let out = pitchline(&args);
            assert!(out.status.success(), "{}: {line}: {}", page.display(), stderr(&out));
            seen += 1;
        }
    }
    // 63 when this was written, 16 of them in README.md.
    assert!(seen >= 60, "{seen} commands");
}

/// Bad input is refused with a message.
fn refused(args: &[&str], wanted: &str) {
    let out = pitchline(args);
    assert_eq!(out.status.code(), Some(2), "{args:?}: {}", stderr(&out));
    assert!(stderr(&out).contains(wanted), "{args:?}: {}", stderr(&out));
}

#[test]
fn the_debugger_answers_on_the_command_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str| folder.path().join(name).to_str().expect("text").to_string();
    let (a, b, c, z) = (file("a.mcap"), file("b.mcap"), file("c.mcap"), file("z.mcap"));
    let run = json(&pitchline(&["run", "bush-20-40", "--duration", "12ms", "-o", &a, "--json"]));
    assert_eq!(run["stopped_at_break"], false);
    // Continues from the middle: the same States on the same grid.
    let resumed = json(&pitchline(&["run", "--resume", &a, "--at", "6ms", "--duration", "6ms", "-o", &b, "--json"]));
    assert!(resumed["from_s"].as_f64().is_some_and(|t| (t - 6e-3).abs() < 2e-6));
    let out = pitchline(&["diff", &a, &b, "--json"]);
    assert_eq!(out.status.code(), Some(1), "one has more frames");
    let difference: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    assert_eq!(difference["first"], serde_json::Value::Null, "{difference:#}");
    assert!(difference["frames_compared"].as_u64().is_some_and(|n| n > 100), "{difference:#}");
    assert_eq!(pitchline(&["diff", &a, &a]).status.code(), Some(0));
    assert_eq!(pitchline(&["replay", &a, "--verify"]).status.code(), Some(0));
    assert_eq!(pitchline(&["replay", &b, "--verify"]).status.code(), Some(0));
    // A branch differs from where it begins.
    let changed = ["--set", "loads.constant.driven.torque_nm=25"];
    let branch =
        [&["run", "--resume", &a, "--at", "6ms", "--duration", "3ms", "-o", &c, "--json"], &changed[..]].concat();
    json(&pitchline(&branch));
    let out = pitchline(&["diff", &a, &c, "--json"]);
    let difference: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    assert!(difference["first"]["t_s"].as_f64().is_some_and(|t| (5.9e-3..6.3e-3).contains(&t)), "{difference:#}");
    // Impacts, and a closer look at one.
    let impacts = json(&pitchline(&["impacts", &a, "--sort", "peak", "--sprocket", "driver", "--top", "3", "--json"]));
    let list = impacts["impacts"].as_array().expect("a list");
    assert_eq!(list.len(), 3);
    assert!(list.windows(2).all(|w| w[0]["peak_force_n"].as_f64() >= w[1]["peak_force_n"].as_f64()));
    assert!(list.iter().all(|i| i["body"] == "sprockets.driver" && i["approach_speed_m_s"].as_f64() > Some(0.0)));
    let number = list[0]["number"].as_u64().expect("a number").to_string();
    let zoom = json(&pitchline(&["zoom", &a, "--impact", &number, "--around", "0.1ms", "-o", &z, "--json"]));
    let steps = zoom["to_step"].as_u64().expect("a step") - zoom["from_step"].as_u64().expect("a step");
    assert_eq!(zoom["frames"].as_u64(), Some(steps + 1), "every step");
    let why = json(&pitchline(&["explain", &a, "--impact", &number, "-o", &file("why.svg"), "--json"]));
    assert_eq!(why["link"], list[0]["link"]);
    assert!(why["remainder_share"].as_f64().is_some_and(|r| r < 1e-9));
    let drawing = std::fs::read_to_string(file("why.svg")).expect("a drawing");
    assert!(drawing.starts_with("<svg") && drawing.contains("remainder"));
    // Breakpoints: stop, and record densely around.
    let stopped =
        json(&pitchline(&["run", "bush-20-40", "--no-output", "--break", "contact.normal_force > 580 N", "--json"]));
    assert_eq!((&stopped["stopped_at_break"], stopped["hits"].as_array().map(Vec::len)), (&true.into(), Some(1)));
    let around =
        ["run", "bush-20-40", "--duration", "6ms", "--break", "impact.peak_force > 580 N", "--around", "0.2ms"];
    let around = json(&pitchline(&[&around[..], &["--hits", "1", "-o", &c, "--json"]].concat()));
    assert!(around["frames"].as_u64() > Some(120), "{around:#}");
    assert_eq!(pitchline(&["replay", &c, "--verify"]).status.code(), Some(0), "dense frames are the same steps");
    let recording = pitchline::recording::mcap::read(std::path::Path::new(&c)).expect("reads");
    assert!(recording.frames.windows(2).all(|w| w[0].step < w[1].step), "in order of time, none twice");
    let hit = around["hits"][0]["step"].as_u64().expect("a step");
    // 0.1 ms to either side, at 3.7 us a step.
    assert!((hit - 26..hit + 26).all(|step| recording.frames.iter().any(|f| f.step == step)), "every step round {hit}");
    // Bad input.
    refused(&["zoom", &a, "--from", "11ms", "--to", "13ms"], "does not lie inside the recording");
    refused(&["explain", &a, "--link", "90", "--at", "1ms"], "numbered 0 to 89");
    refused(&["explain", &a, "--link", "9", "--at", "99ms"], "outside the recording");
    refused(&["impacts", &a, "--sprocket", "drivr"], "did you mean `driver`");
    refused(&["zoom", &a, "--impact", "9999"], "there is no impact 9999");
    refused(&["run", "bush-20-40", "--break", "contact.penetraton > 8 um"], "did you mean `contact.penetration`");
    refused(&["run", "--resume", &a, "-o", &a], "not overwritten");
    refused(&["run", "--resume", &a, "--no-output", "--set", "chain.bush.links=92"], "cannot go on from it");
    refused(&["diff", &a, "Cargo.toml"], "is no MCAP file");
    refused(&["run", "bush-20-40", "--hits", "3"], "--break");
    refused(&["run", "bush-20-40", "--no-output", "--at", "5ms"], "--at");
    refused(&["replay", &a, "--verify", "-o", &c], "--verify");
    refused(&["run", "bush-20-40", "--break", "time > 1 s", "--around", "1e30s"], "at most 100 ms");
    for geometry in ["preload.moves=driver", "sprockets.driven.teeth=41", "sprockets.driver.x_mm=1"] {
        refused(&["run", "--resume", &a, "--no-output", "--set", geometry], "cannot go on from there");
    }
    // A late impact does not shorten the dense window of a later hit.
    let expressions = ["--break", "time > 3.9 ms", "--break", "impact.link == 48 and impact.peak_force > 600 N"];
    let around = [&["run", "bush-20-40", "--duration", "6ms", "--around", "1ms", "-o", &c, "--json"], &expressions[..]];
    json(&pitchline(&around.concat()));
    let recording = pitchline::recording::mcap::read(std::path::Path::new(&c)).expect("reads");
    let dense = recording.frames.iter().filter(|f| (3.98e-3..4.88e-3).contains(&f.t_s)).count();
    // 0.9 ms at 3.7 us a step.
    assert!(dense > 235, "{dense} frames");
    // Continues where it has stopped.
    json(&pitchline(&["run", "bush-20-40", "--break", "contact.normal_force > 580 N", "-o", &b, "--json"]));
    let on = ["run", "--resume", &b, "--break", "contact.normal_force > 580 N", "--no-output", "--json"];
    assert!(json(&pitchline(&on))["steps"].as_u64() > Some(100), "not the same hit again");
}

#[test]
fn a_lumped_drive_is_told_from_one_with_links_and_effects_are_listed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("rig.toml");
    std::fs::write(&path, "fidelity = \"lumped\"\n").expect("written");
    let shown = path.to_str().expect("text");
    refused(&["run", shown], "is a lumped drive");
    refused(&["check", shown], "a machine needs a body");
    // What `lump` writes, `check` reads; both say what it is.
    let lumped = pitchline(&["lump", "bush-20-40", "-o", shown]);
    assert!(String::from_utf8_lossy(&lumped.stdout).contains("a lumped drive of 2 bodies"), "{}", stderr(&lumped));
    let checked = json(&pitchline(&["check", shown, "--json"]));
    assert_eq!((&checked["fidelity"], &checked["bodies"][1]["name"]), (&"lumped".into(), &"driven".into()));
    refused(&["identify", "nothing.toml"], "cannot read measurement file");
    refused(&["effects", "sproket_runout"], "did you mean `sprocket_runout`");
    let effects = json(&pitchline(&["effects", "--json"]));
    let list = effects["effects"].as_array().expect("a list");
    assert!(list.len() >= 24);
    assert!(list.iter().all(|e| e["equation"].as_str().is_some_and(|t| !t.is_empty())));
    assert!(json(&pitchline(&["sensors", "--json"]))["sensors"].as_array().is_some_and(|s| s.len() == 11));
}

/// Every bundled drive as a former version had it is read, or `check --migrate` makes of it a text that is: with every comment and every other line
/// as it was. The first version let guides run into sprockets.
#[test]
fn drives_of_former_versions_are_read_or_migrated() {
    let folder = tempfile::tempdir().expect("a folder");
    let old = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/old_drives");
    let mut refused = Vec::new();
    for entry in std::fs::read_dir(&old).expect("drives") {
        let path = entry.expect("an entry").path();
        let (shown, name) = (path.to_str().expect("text"), path.file_name().expect("a name").to_owned());
        let name = name.into_string().expect("text");
        let new = folder.path().join(&name);
        let new_path = new.to_str().expect("text");
        let migrated = pitchline(&["check", shown, "--migrate", "-o", new_path]);
        assert!(migrated.status.success(), "{name}: {}", stderr(&migrated));
        let (before, after) =
            (std::fs::read_to_string(&path).expect("a text"), std::fs::read_to_string(&new).expect("a text"));
        let accepted = pitchline(&["check", shown]).status.success();
        assert!(accepted == (before == after), "{name}: what is read stays as it is");
        assert!(pitchline(&["check", new_path]).status.success(), "{name} is still refused");
        if !accepted {
            let changed: Vec<(&str, &str)> = before.lines().zip(after.lines()).filter(|(a, b)| a != b).collect();
            assert_eq!(before.lines().count(), after.lines().count(), "{name}");
            for (a, b) in &changed {
                let keys = ["start_mm", "end_mm", "end_radius_mm"];
                assert!(keys.iter().any(|key| a.starts_with(key)), "{a} became {b}");
                let comment = |line: &str| line.find('#').map(|at| line[at..].to_string());
                assert_eq!(comment(a), comment(b));
            }
            for line in changed.iter().map(|(_, b)| b.split('#').next().unwrap_or_default().trim()) {
                assert!(stderr(&migrated).contains(line), "{line} is told: {}", stderr(&migrated));
            }
            refused.push((name, changed.len()));
        }
        // Printed, it is the same.
        let printed = pitchline(&["check", shown, "--migrate"]);
        assert_eq!(stdout(&printed), after);
    }
    assert_eq!(refused, [("2026-11-21-bush-20-40.toml".to_string(), 6)]);
    // What no migration knows is told as ever, and no file is written.
    let wrong = folder.path().join("wrong.toml");
    let text = std::fs::read_to_string(old.join("2026-11-21-bush-20-40.toml")).expect("a text");
    std::fs::write(&wrong, text.replace("teeth = 20", "tooths = 20")).expect("written");
    let out = folder.path().join("never.toml");
    let paths = (wrong.to_str().expect("text"), out.to_str().expect("text"));
    let told = pitchline(&["check", paths.0, "--migrate", "-o", paths.1]);
    assert_eq!(told.status.code(), Some(2));
    assert!(stderr(&told).contains("unknown key `sprockets.driver.tooths`") || stderr(&told).contains("tooths"));
    assert!(!out.exists());
    refused_by_itself(paths.0);
}

/// An output is never the input.
fn refused_by_itself(path: &str) {
    let out = pitchline(&["check", path, "--migrate", "-o", path]);
    assert_eq!(out.status.code(), Some(2), "{}", stderr(&out));
}

/// Overrides alone make a table that the file lacks: the law of stops, and the stops.
#[test]
fn overrides_make_tables_that_a_file_lacks() {
    let given = ["arms.tensioner.high_deg=10", "contact.stop.linear.stiffness_n_per_m=1e7"];
    let set = |all: &[&'static str]| {
        let mut args = vec!["check", "arm-20-40", "--json"];
        args.extend(all.iter().flat_map(|s| ["--set", s]));
        pitchline(&args)
    };
    let whole = [&given[..], &["contact.stop.linear.damping_n_s_per_m=50"]].concat();
    let out = json(&set(&whole));
    let values = out["values"].as_array().expect("paths");
    assert!(values.iter().any(|v| v == "contact.stop.linear.stiffness_n_per_m"), "{values:?}");
    // Without the law there is none.
    let told = set(&given[..1]);
    assert!(stderr(&told).contains("nothing says how hard they are"), "{}", stderr(&told));
}

/// A run of several chains tells the preload of each.
#[test]
fn every_chain_has_its_preload_in_the_report() {
    let out = stdout(&pitchline(&["check", "reduction-20-40-20-40"]));
    let lines: Vec<&str> = out.lines().filter(|line| line.contains("preload of chain")).collect();
    assert_eq!(lines.len(), 2, "{out}");
    assert!(!stdout(&pitchline(&["check", "bush-20-40"])).contains("of chain"));
}

/// The verbs of the debugger on the committed recording of every bundled drive: its impacts, the forces on a link, a window run again, which
/// differs from itself in nothing and from the whole in its frames, and a stop where an expression becomes true.
#[test]
fn every_bundled_drive_is_debugged() {
    let folder = tempfile::tempdir().expect("a folder");
    let zoomed = folder.path().join("zoomed.mcap");
    let zoomed = zoomed.to_str().expect("text");
    for (name, _) in BUNDLED {
        let sample = format!("{}/recordings/samples/{name}.mcap", env!("CARGO_MANIFEST_DIR"));
        let impacts = json(&pitchline(&["impacts", &sample, "--json"]));
        assert!(impacts["impacts"].is_array() && impacts["drive"] == name, "{impacts}");
        for link in ["0", "7", "30"] {
            let body = json(&pitchline(&["explain", &sample, "--link", link, "--at", "1ms", "--json"]));
            let left = |key: &str| body[key].as_f64().expect("a number");
            assert!(left("remainder_share") < 1e-9 && left("remainder_moment_share") < 1e-9, "{name}: {body}");
        }
        let out = pitchline(&["zoom", &sample, "--from", "1ms", "--to", "1.05ms", "-o", zoomed]);
        assert!(out.status.success(), "{name}: {}", stderr(&out));
        let same = pitchline(&["diff", zoomed, zoomed]);
        assert!(same.status.success() && stdout(&same).contains("equal, to the bit"), "{name}: {}", stdout(&same));
        let stops =
            pitchline(&["run", name, "--duration", "1ms", "--no-output", "--break", "time > 0.05 ms", "--json"]);
        assert!(stops.status.success(), "{name}: {}", stderr(&stops));
        let at_s = json(&stops)["simulated_s"].as_f64().expect("a number");
        assert!((5e-5..7e-5).contains(&at_s), "{name}: stopped at {at_s} s");
    }
}

/// The list of bundled drives says where their numbers come from.
#[test]
fn every_bundled_drive_names_its_source() {
    let listed = json(&pitchline(&["drives", "--json"]));
    let drives = listed["drives"].as_array().expect("drives");
    assert_eq!(drives.len(), BUNDLED.len());
    for drive in drives {
        let source = drive["source"].as_str().expect("a source");
        assert!(["Schaffner", "Fritz", "Lin,", "Calì", "assumed"].iter().any(|s| source.starts_with(s)), "{drive}");
    }
    assert!(stdout(&pitchline(&["drives"])).contains("Fritz, Kell, Pfeiffer"));
}

/// Orders had a phase of zero where none was given: now they say it, and files of former versions get it.
#[test]
fn orders_of_former_versions_get_their_phases() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = stdout(&pitchline(&["drives", "ford-v6"]));
    let former: String =
        text.lines().filter(|l| !l.starts_with("phases_deg = [0, 0, 0]")).map(|l| format!("{l}\n")).collect();
    assert_ne!(text, former);
    let path = folder.path().join("former.toml");
    std::fs::write(&path, &former).expect("written");
    let path = path.to_str().expect("text");
    let refused = pitchline(&["check", path]);
    assert!(stderr(&refused).contains("orders without phases") && stderr(&refused).contains("phases_deg = [0, 0, 0]"));
    let migrated = pitchline(&["check", path, "--migrate"]);
    assert!(migrated.status.success(), "{}", stderr(&migrated));
    assert!(stdout(&migrated).contains("phases_deg = [0, 0, 0]"), "{}", stdout(&migrated));
    assert!(stderr(&migrated).contains("speeds.constant.crank.phases_deg"), "{}", stderr(&migrated));
}
