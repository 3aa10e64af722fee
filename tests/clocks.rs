//! Records of several files, each by a clock of its own.

#[path = "common/identified.rs"]
mod identified;

use identified::{ALL, identified, paths};
use pitchline::identify::report::{IdentificationReport, IdentificationVerdict};
use std::path::PathBuf;

const FRICTION_NM: f64 = 0.4;

/// A disc under steps of torque, integrated in steps of 20 us with friction as an inequality. The drive writes its torque every 4 ms by its own
/// clock; an instrument writes the speed every `step_ms` by a clock that begins elsewhere and errs.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// `zero_s`: time of the drive's clock at time zero of the instrument's; `drift`: share by which that runs slow.
    fn new(zero_s: f64, drift: f64, step_ms: f64) -> Bench {
        let bench = Bench { folder: tempfile::tempdir().expect("a folder") };
        let mut seed = 88_172_645_463_325_252_u64;
        let mut random = move || {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            (seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        for name in ["a", "b", "c"] {
            let (mut servo, mut instrument) = (String::from("t_ms,torque\n"), String::from("clock_s,speed\n"));
            let mut both = String::from("t_ms,torque,speed\n");
            let (mut v, mut torque, mut next_s) = (0.0_f64, 0.0, 0.0013);
            let fine_s = 2e-5;
            for step in 0..120_000 {
                let t = f64::from(step) * fine_s;
                if step % 200 == 0 {
                    if step % 6000 == 0 {
                        torque = 4.0 * (random() - 0.5);
                    }
                    servo += &format!("{},{torque}\n", step / 50);
                    both += &format!("{},{torque},{v:.2}\n", step / 50);
                }
                if t >= next_s {
                    let gauss = (0..12).map(|_| random()).sum::<f64>() - 6.0;
                    instrument += &format!("{:.9},{:.6}\n", (t - zero_s) / (1.0 + drift), v + 0.02 * gauss);
                    next_s += step_ms * 1e-3;
                }
                let free: f64 = v + fine_s * (torque - 0.08 * v) / 0.05;
                let stop = fine_s * FRICTION_NM / 0.05;
                v = if free.abs() <= stop { 0.0 } else { free - stop * free.signum() };
            }
            bench.write(&format!("{name}-servo.csv"), &servo);
            bench.write(&format!("{name}-both.csv"), &both);
            bench.write(&format!("{name}-speed.csv"), &instrument);
        }
        bench.write(
            "rig.toml",
            "fidelity = \"lumped\"\n[rotors.disc]\ninertia_kg_m2 = 0.055\n[loads.viscous.disc]\ntorque_nm_s_per_rad = 0.1\n\
             [inputs.torque.disc]\n[sensors.tachometer.disc]\n",
        );
        bench
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.folder.path().join(name), text).expect("written");
    }

    /// The measurement file; `clock` is added to what stands beside each record.
    fn measurement(&self, clock: &str, only: &str) -> PathBuf {
        let mut text = String::from(
            "title = \"rig\"\ndrive = \"rig.toml\"\n\
             [channels.speed]\nsensor = \"sensors.tachometer.disc\"\ncolumn = \"speed\"\nunit = \"rad/s\"\n\
             [inputs.torque]\ninput = \"inputs.torque.disc\"\ncolumn = \"torque\"\nunit = \"N m\"\nhold = true\n\
             [fit.\"rotors.disc.inertia_kg_m2\"]\nspread_percent = 20\n[fit.\"loads.viscous.disc.torque_nm_s_per_rad\"]\n",
        );
        text += &format!("[candidates]\nonly = {only}\n");
        for name in ["a", "b", "c"] {
            let usage = if name == "c" { "judge" } else { "fit" };
            text += &format!(
                "[files.{name}-servo]\npath = \"{name}-servo.csv\"\n[files.{name}-speed]\npath = \"{name}-speed.csv\"\n\
                 [records.{name}]\nfile = \"{name}-servo\"\nuse = \"{usage}\"\ntime_column = \"t_ms\"\ntime_unit = \"ms\"\nstart = \"rest\"\n\
                 [records.{name}.beside.instrument]\nfile = \"{name}-speed\"\nholds = [\"speed\"]\ntime_column = \"clock_s\"\n{clock}\n"
            );
        }
        let path = self.folder.path().join("measured.toml");
        std::fs::write(&path, text).expect("written");
        path
    }
}

fn size(r: &IdentificationReport, key: &str) -> f64 {
    let all = r.effects.iter().flat_map(|e| &e.parameters).chain(&r.numbers_after);
    all.into_iter().find(|p| p.path.ends_with(key)).unwrap_or_else(|| panic!("no {key}")).value
}

/// The speed in another file, by a clock that began 87 ms later and runs 0.2 % slow: with both declared the friction is as well known as in one file.
#[test]
fn a_channel_in_another_file_counts_by_its_own_clock() {
    // A faster instrument, one of the same rate, and a slower one.
    for step_ms in [3.1, 4.0, 11.0] {
        let bench = Bench::new(0.087, 0.002, step_ms);
        let clock = "offset_ms = 87\ndrift_percent = 0.2";
        let only = "[\"coulomb_friction\", \"quadratic_drag\", \"latency\"]";
        let r = identified(&bench.measurement(clock, only), 2, ALL).expect("identified");
        println!("{}", pitchline::identify::text::text(&r));
        assert_eq!((r.outcome, paths(&r)), (IdentificationVerdict::Named, vec!["effects.coulomb_friction.disc"]));
        let (friction, inertia) = (size(&r, "coulomb_friction.disc.torque_nm"), size(&r, "inertia_kg_m2"));
        assert!((friction / FRICTION_NM - 1.0).abs() < 0.03, "{friction}");
        assert!((inertia / 0.05 - 1.0).abs() < 0.01, "{inertia}");
        // Samples during the record count, whose last row is at 2396 ms.
        let facts = r.facts.iter().find(|f| f.record == "a").expect("facts");
        assert_eq!(facts.samples as f64, ((2396.0 - 1.3) / step_ms).floor() + 1.0);
    }
}

/// An `offset_ms` that is 15 ms too large shows as the latency of what it stamps.
#[test]
fn a_clock_that_is_not_declared_is_found_as_latency() {
    let bench = Bench::new(0.087, 0.0, 4.0);
    let only = "[\"coulomb_friction\", \"latency\", \"low_pass\"]";
    let r = identified(&bench.measurement("offset_ms = 102", only), 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    let mut names = paths(&r);
    names.sort_unstable();
    assert_eq!(names, ["effects.coulomb_friction.disc", "effects.latency.disc"]);
    let delay = size(&r, "delay_ms");
    assert!((delay - 15.0).abs() < 0.5, "{delay}");
}

/// An `offset_ms` that is 15 ms too small, which no latency can be, and a drift that is not declared: each is found with its size.
#[test]
fn what_is_not_declared_of_a_clock_is_found() {
    // The clock of the last one begins with the record, about whose beginning the effect drifts.
    let cases = [
        (0.087, 0.0, "offset_ms = 72", "latency\", \"clock_offset", "clock_offset.disc.offset_ms", 15.0, 0.5),
        (
            0.087,
            0.002,
            "offset_ms = 87",
            "latency\", \"time_base\", \"clock_drift",
            "clock_drift.disc.percent",
            0.2,
            0.02,
        ),
        (0.0, -0.004, "", "clock_drift", "clock_drift.disc.percent", -0.4, 0.01),
    ];
    for (zero_s, drift, clock, effects, key, size_true, tolerance) in cases {
        let bench = Bench::new(zero_s, drift, 4.0);
        let only = format!("[\"coulomb_friction\", \"low_pass\", \"{effects}\"]");
        let r = identified(&bench.measurement(clock, &only), 2, ALL).expect("identified");
        println!("{}", pitchline::identify::text::text(&r));
        let mut names = paths(&r);
        names.sort_unstable();
        let named = format!("effects.{}.disc", key.split('.').next().expect("a name"));
        assert_eq!(
            (r.outcome, names),
            (IdentificationVerdict::Named, vec![named.as_str(), "effects.coulomb_friction.disc"])
        );
        assert!((size(&r, key) - size_true).abs() < tolerance, "{key}: {} instead of {size_true}", size(&r, key));
        let friction = size(&r, "coulomb_friction.disc.torque_nm");
        assert!((friction / FRICTION_NM - 1.0).abs() < 0.03, "{friction}");
    }
}

/// A clock belongs to the records that have a file of their own: another record, in one file, stays as it is.
#[test]
fn a_clock_of_one_record_moves_no_other() {
    let bench = Bench::new(0.087, 0.0, 4.0);
    let path = bench.measurement("offset_ms = 72", "[\"coulomb_friction\", \"clock_offset\", \"low_pass\"]");
    let text = std::fs::read_to_string(&path).expect("the measurement");
    let from = text.find("[records.b.beside").expect("a file beside record b");
    let to = text.find("[files.c-servo]").expect("what follows");
    let text = (text[..from].to_owned() + &text[to..]).replace("b-servo.csv", "b-both.csv");
    std::fs::write(&path, text).expect("written");
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    let offset = size(&r, "clock_offset.disc.offset_ms");
    assert!((offset - 15.0).abs() < 0.5, "{offset}");
    let friction = size(&r, "coulomb_friction.disc.torque_nm");
    assert!((friction / FRICTION_NM - 1.0).abs() < 0.03, "{friction}");
}

/// Where a channel has no clock of its own, none is looked for.
#[test]
fn a_clock_of_its_own_takes_a_file_of_its_own() {
    let bench = Bench::new(0.0, 0.0, 4.0);
    let path = bench.measurement("", "[\"coulomb_friction\", \"clock_drift\", \"clock_offset\"]");
    let text = std::fs::read_to_string(&path).expect("the measurement");
    let joined = text
        .replace("-servo\"\nuse", "-speed\"\nuse")
        .replace("\"t_ms\"\ntime_unit = \"ms\"", "\"clock_s\"\ntime_unit = \"s\"");
    let held = joined.replace(
        "-speed\"\nholds = [\"speed\"]\ntime_column = \"clock_s\"",
        "-servo\"\nholds = [\"torque\"]\ntime_column = \"t_ms\"\ntime_unit = \"ms\"",
    );
    assert_ne!(held, joined);
    std::fs::write(&path, held).expect("written");
    let r = identified(&path, 2, ALL).expect("identified");
    assert!(r.candidates.iter().all(|t| !t.identity.contains("clock_")), "{:?}", r.candidates);
}

/// What is wrong is said at its place in the measurement file.
#[test]
fn mistakes_are_told_with_their_place() {
    let bench = Bench::new(0.087, 0.0, 4.0);
    let refused = |clock: &str| {
        let path = bench.measurement(clock, "[\"coulomb_friction\"]");
        identified(&path, 1, ALL).expect_err("refused")
    };
    let wrong = refused("offset_ms = 5000");
    assert!(wrong.contains("knows `speed` at 0 of the record's 600 rows") && wrong.contains("4.914300 s"), "{wrong}");
    assert!(wrong.contains("[records.a.beside.instrument]"), "{wrong}");
    let edited = |from: &str, to: &str| {
        let path = bench.measurement("", "[\"coulomb_friction\"]");
        let text = std::fs::read_to_string(&path).expect("the measurement");
        assert!(text.contains(from));
        std::fs::write(&path, text.replacen(from, to, 1)).expect("written");
        identified(&path, 1, ALL).expect_err("refused")
    };
    let wrong = edited("holds = [\"speed\"]", "holds = [\"sped\"]");
    assert!(
        wrong.contains("no channel or input is called `sped`") && wrong.contains("did you mean \"speed\"?"),
        "{wrong}"
    );
    let wrong = edited("holds = [\"speed\"]\n", "");
    assert!(wrong.contains("nothing of file `a-speed` is used"), "{wrong}");
    let wrong = edited("file = \"a-speed\"", "file = \"a-sped\"");
    assert!(wrong.contains("no file is called `a-sped`"), "{wrong}");
    let wrong = edited("time_column = \"clock_s\"", "time_column = \"clock\"");
    assert!(wrong.contains("has no column \"clock\"") && wrong.contains("clock_s"), "{wrong}");
    let wrong = edited("time_column = \"clock_s\"\n", "");
    assert!(wrong.contains("the times of record `a.beside.instrument` are not stated in one way"), "{wrong}");
    // An input must be known over the whole record.
    let wrong = edited("holds = [\"speed\"]", "holds = [\"speed\", \"torque\"]");
    assert!(wrong.contains("file `a-speed` has no column \"torque\""), "{wrong}");
}
