//! Records that are not what their files say: a unit that is off, channels that contradict each other, noise, swapped labels, an input that never
//! moves. The report says so before all else, and names nothing from them. The records are those of tests/data/rig, changed here.

#[path = "common/identified.rs"]
mod identified;

use identified::{ALL, identified, paths};
use pitchline::identify::misread::unit_factors;
use pitchline::identify::report::{IdentificationReport, IdentificationVerdict};
use pitchline::identify::stats::Random;
use std::path::Path;

/// A row of a record: time [ms], torque [N m], speed [1/min].
type Row = [f64; 3];

/// What the second tachometer shows, from what the first one shows.
type Second<'a> = &'a dyn Fn(f64) -> f64;

/// The records of the rig.
fn rig() -> [Vec<Row>; 3] {
    ["a", "b", "c"].map(|name| {
        let path = Path::new("tests/data/rig").join(format!("{name}.csv"));
        let text = std::fs::read_to_string(path).expect("a record");
        let row = |line: &str| {
            let mut numbers = line.split(',').map(|n| n.parse::<f64>().expect("a number"));
            std::array::from_fn(|_| numbers.next().expect("a column"))
        };
        text.lines().skip(1).map(row).collect()
    })
}

/// Identifies records of the rig with a second tachometer.
fn report_of(records: &[Vec<Row>; 3], second: Second, is_second_used: bool) -> IdentificationReport {
    let folder = tempfile::tempdir().expect("a folder");
    let source = Path::new("tests/data/rig");
    let copy = |name: &str| std::fs::read_to_string(source.join(name)).expect("a file of the rig");
    let channel = "[channels.second]\nsensor = \"sensors.tachometer.second\"\ncolumn = \"second\"\nunit = \"rpm\"\n";
    let (more, body) = match is_second_used {
        true => (channel, "\n[sensors.tachometer.second]\nbody = \"disc\"\n"),
        false => ("", ""),
    };
    std::fs::write(folder.path().join("rig.toml"), copy("rig.toml") + body).expect("written");
    let measured = copy("rig-measured.toml").replace("[inputs.torque]", &format!("{more}[inputs.torque]"));
    std::fs::write(folder.path().join("rig-measured.toml"), measured).expect("written");
    for (name, rows) in ["a", "b", "c"].into_iter().zip(records) {
        let mut text = String::from("time_ms,torque,speed_rpm,second\n");
        for [t, torque, speed] in rows {
            text += &format!("{t},{torque},{speed},{}\n", second(*speed));
        }
        std::fs::write(folder.path().join(format!("{name}.csv")), text).expect("written");
    }
    identified(&folder.path().join("rig-measured.toml"), 1, ALL).unwrap_or_else(|e| panic!("{e}"))
}

/// What the report says first; an outcome that is a name fails.
fn told_first(what: &str, r: &IdentificationReport) -> String {
    let text = pitchline::identify::text::text(r);
    println!("== {what}\n{}", text.lines().take(12).collect::<Vec<_>>().join("\n"));
    let (first, table) = (text.find("LOOK FIRST").unwrap_or(usize::MAX), text.find("record a").expect("the records"));
    assert!(first < table, "{what} is told before the records");
    assert!(r.outcome != IdentificationVerdict::Named, "{what}: {:?} is named", paths(r));
    r.look_first.join("\n")
}

#[test]
fn a_unit_that_is_off_is_told_by_the_ratio_of_numbers() {
    let rows = rig();
    for (what, factor, says) in [("torque", 10.0, "near a factor of 10"), ("torque", 1e3, "near a factor of 1000")] {
        let off = rows.clone().map(|r| r.into_iter().map(|[t, u, v]| [t, factor * u, v]).collect());
        let told = told_first(what, &report_of(&off, &|_| 0.0, false));
        assert!(told.contains("inertia_kg_m2") && told.contains(says), "{told}");
    }
    let off = rows.map(|r| r.into_iter().map(|[t, u, v]| [t, u, v * 30.0 / std::f64::consts::PI]).collect());
    let told = told_first("speed", &report_of(&off, &|_| 0.0, false));
    assert!(told.contains("2 pi / 60"), "{told}");
}

#[test]
fn factors_between_units_are_those_within_an_eighth() {
    assert_eq!(unit_factors(0.0998).len(), 2, "a power of ten, and 1/min for rad/s");
    assert_eq!(unit_factors(57.0).len(), 1);
    assert!(unit_factors(5.0).is_empty() && unit_factors(80.0).is_empty());
}

#[test]
fn channels_that_contradict_each_other_are_told() {
    let rows = rig();
    let mut random = Random::new(3);
    let mut noise = || (random.below(2001) as f64 / 1000.0 - 1.0) * 30.0;
    let noises: Vec<f64> = (0..4000).map(|_| noise()).collect();
    let next = std::cell::Cell::new(0);
    let cases: [(&str, Second, &str); 4] = [
        ("twice", &|v| 2.0 * v, "times the other"),
        ("sign", &|v| -v, "has the opposite sign"),
        ("mean", &|v| v + 60.0, "has a mean that differs"),
        (
            "noise",
            &|_| {
                next.set(next.get() + 1);
                noises[next.get() % noises.len()]
            },
            "does not move where the other does",
        ),
    ];
    for (what, second, says) in cases {
        let told = told_first(what, &report_of(&rows, second, true));
        assert!(told.contains("`speed` and `second`") && told.contains(says), "{told}");
    }
    // Two tachometers at a steady speed, each with a noise of its own: their ripple says nothing, and 6 % is a gain error.
    let mut noises = Random::new(5);
    let mut noise = || (noises.below(2001) as f64 / 1000.0 - 1.0) * 2.0;
    let steady = rig().map(|r| r.into_iter().map(|[t, _, _]| [t, 0.1 + 1e-3 * noise(), 1500.0 + noise()]).collect());
    let mut others = Random::new(6);
    let others: Vec<f64> = (0..4000).map(|_| (others.below(2001) as f64 / 1000.0 - 1.0) * 2.0).collect();
    let next = std::cell::Cell::new(0);
    let other = |_: f64| {
        next.set(next.get() + 1);
        1590.0 + others[next.get() % others.len()]
    };
    let told = report_of(&steady, &other, true).look_first;
    assert!(told.iter().all(|t| !t.contains("contradict")), "{told:?}");
    let same = report_of(&rows, &|v| 1.02 * v, true);
    assert!(same.look_first.is_empty(), "a gain that is off by 2 % is an effect: {:?}", same.look_first);
}

#[test]
fn noise_swapped_labels_and_idle_inputs_are_told() {
    let rows = rig();
    let mut random = Random::new(7);
    let mut gauss = || (0..12).map(|_| random.below(1_000_001) as f64 / 1e6).sum::<f64>() - 6.0;
    let noise = rows.clone().map(|r| r.into_iter().map(|[t, u, _]| [t, u, 20.0 * gauss()]).collect());
    let told = told_first("noise", &report_of(&noise, &|_| 0.0, false));
    assert!(told.contains("record `a` holds noise alone") && told.contains("record `c`"), "{told}");

    let still = rows.clone().map(|r| r.into_iter().map(|[t, _, v]| [t, 1.0, v]).collect());
    let told = told_first("still", &report_of(&still, &|_| 0.0, false));
    assert!(told.contains("input `inputs.torque.disc` never moves: it is 1 in every record"), "{told}");

    let [a, b, c] = rows;
    let with_speed_of = |own: &[Row], other: &[Row]| -> Vec<Row> {
        own.iter().zip(other).map(|([t, u, _], [_, _, v])| [*t, *u, *v]).collect()
    };
    let swapped = [with_speed_of(&a, &b), with_speed_of(&b, &a), c];
    let told = told_first("swapped", &report_of(&swapped, &|_| 0.0, false));
    assert!(told.contains("the labels of records `a` and `b` may be swapped"), "{told}");
}
