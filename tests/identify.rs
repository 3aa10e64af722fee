//! Identification: measured machines, planted effects, effects that records cannot distinguish, and errors in files.

#[path = "common/identified.rs"]
mod identified;

use identified::{ALL, identified, paths};
use pitchline::identify::declared;
use pitchline::identify::report::{IdentificationReport, IdentificationVerdict};
use pitchline::identify::search::{Budget, Context};
use pitchline::machine::Machine;
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::Memory;
use pitchline::measurement::segments::load;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64};

/// A bundled measurement next to its data, or None if the data are not available.
fn measured(name: &str, data: &[&str]) -> Option<(tempfile::TempDir, PathBuf)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().expect("a folder");
    for file in [format!("{name}.toml"), format!("{name}-drive.toml")] {
        std::fs::copy(root.join("assets/measurements").join(&file), folder.path().join(&file)).expect("copied");
    }
    for file in data {
        let from = root.join("../shared/data").join(file);
        if !from.exists() {
            println!("skipped: no {}", from.display());
            return None;
        }
        let to = Path::new(file).file_name().expect("a name");
        std::fs::copy(&from, folder.path().join(to)).expect("copied");
    }
    let path = folder.path().join(format!("{name}.toml"));
    Some((folder, path))
}

/// Uneven marks of a pulse pickup, and not runout of a shaft: published as a cyclic error of this machine's magnets.
#[test]
fn the_rowing_flywheel_has_uneven_marks() {
    let Some((_folder, path)) = measured("rowerg", &["rowing_flywheel/Concept2_RowErg_Session_2000meters.csv"]) else {
        return;
    };
    let r = identified(&path, 2, ALL).expect("identified");
    // The flywheel's speed is left: what is left is not white.
    assert_eq!(r.outcome, IdentificationVerdict::Part, "{:?}", paths(&r));
    assert_eq!(paths(&r), ["effects.mark_spacing.flywheel"]);
    let (before, after) = (r.error_before[0].held_out.expect("held out"), r.error_after[0].held_out.expect("held out"));
    // Found before by other means: 0.948 % to 0.125 %. Measured here: 0.948 to 0.125.
    assert!((0.93..0.97).contains(&before) && after < 0.13, "{before} % to {after} %");
}

/// An engine with a silent timing chain. The facts were found before by other means (numpy on the same edges): 1006 and 16 edges that teeth
/// make, 386.63 deg from the turn in which the record begins, 0.028 deg.
#[test]
fn the_edges_of_an_engine_give_its_speed_and_the_place_of_its_cam() {
    for (file, extra) in [("4b11-running.csv", 0), ("4b11-running-doubled-edge.csv", 1)] {
        let Some((folder, path)) = measured("engine-4b11", &[&format!("engine_4b11/{file}")]) else { return };
        std::fs::rename(folder.path().join(file), folder.path().join("data.csv")).expect("renamed");
        let text = std::fs::read_to_string(&path).expect("the measurement").replace("4b11-running.csv", "data.csv");
        std::fs::write(&path, text).expect("written");
        let r = identified(&path, 2, ALL).expect("identified");
        println!("{}", pitchline::identify::text::text(&r));
        let [crank, cam] = r.wheels.as_slice() else { panic!("{:?}", r.wheels) };
        assert_eq!((crank.edges, crank.missed, crank.extra_s.len()), (1006, 0, extra));
        assert_eq!((cam.edges, cam.missed, cam.extra_s.len()), (16, 0, 2));
        assert!((crank.speed_rpm[0] - 1419.3).abs() < 0.1, "{:?}", crank.speed_rpm);
        assert!(crank.orders[..2].iter().any(|o| o.order == 0.5 && (o.speed_percent - 0.657).abs() < 0.01), "{crank}");
        let at = cam.stands_at.as_ref().expect("a place on the crank");
        assert!((at.angle_deg - 26.636).abs() < 0.003 && (at.scatter_deg - 0.028).abs() < 0.001, "{at:?}");
        assert_eq!(r.outcome, IdentificationVerdict::None, "{:?}", paths(&r));
        assert!(!r.explained, "{:?}", r.noise_floor);
    }
}

/// The same maker's older machine has no such effect.
#[test]
fn the_older_flywheel_has_none() {
    let Some((_folder, path)) = measured("model-c", &["rowing_flywheel/Concept2_Model_C.csv"]) else { return };
    let r = identified(&path, 2, ALL).expect("identified");
    assert_eq!(r.outcome, IdentificationVerdict::None, "{:?}", paths(&r));
    assert!(r.warnings.iter().any(|w| w.contains("pulses were missed")));
}

#[test]
fn the_coupled_drives_have_a_sign_blind_sensor_a_lag_and_friction_and_more() {
    let data = ["coupled_electric_drives/DATAUNIF.csv", "coupled_electric_drives/DATAPRBS.csv"];
    let Some((_folder, path)) = measured("coupled-drives", &data) else { return };
    let r = identified(&path, 2, ALL).expect("identified");
    // Beside what is left, a drag that grows with the square of the speed is as good as a damper.
    assert_eq!(r.outcome, IdentificationVerdict::Ambiguous, "{:?}", paths(&r));
    // A free size for every half record gives nearly the same size.
    let sizes = r.effects.iter().flat_map(|e| &e.sizes).map(|s| s.relative);
    assert!(
        sizes.clone().count() >= 8 && sizes.clone().all(|s| (0.6..1.5).contains(&s)),
        "{:?}",
        sizes.collect::<Vec<_>>()
    );
    let families: Vec<&str> = r.effects.iter().map(|e| e.family.as_str()).collect();
    assert!(paths(&r).contains(&"effects.sign_blind.pulley"), "{families:?}");
    assert!(families.contains(&"friction") && families.iter().any(|f| f.starts_with("lag")), "{families:?}");
    assert!(!r.explained, "the residual is not white");
    let held_out = |name: &str| {
        let of = r.error_after.iter().find(|e| e.record.as_deref() == Some(name));
        of.and_then(|e| e.held_out).expect("held out")
    };
    // measured 0.0821 and 0.0706 ticks/s; declared 0.221 and 0.305
    assert!(held_out("first") <= 0.090 && held_out("second") <= 0.095, "{} {}", held_out("first"), held_out("second"));
    assert_eq!(r.transfer.len(), 3);
    assert!(r.transfer.iter().all(|t| t.refused), "{:?}", r.transfer);
}

/// A rotor under a torque that steps up and down: its speed, with friction that the declared model lacks. The data are
/// generated here by an Euler scheme at a fiftieth of the sample step with friction as an inequality, independent of
/// the model's own scheme.
fn rotor_with_friction(folder: &Path, friction_nm: f64, noise: f64) -> PathBuf {
    rotor_records(folder, &[("a", 600, friction_nm), ("b", 600, friction_nm), ("c", 500, friction_nm)], &["c"], noise)
}

/// Records of a disc, each with its number of samples and its friction [N m]; those that judge are named.
fn rotor_records(folder: &Path, records: &[(&str, usize, f64)], judge: &[&str], noise: f64) -> PathBuf {
    let mut seed = 88_172_645_463_325_252_u64;
    let mut random = move || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    let (mut files, mut all) = (String::new(), String::new());
    for (name, samples, friction_nm) in records {
        let mut text = String::from("time_ms,torque,speed_rpm\n");
        let (mut v, mut torque) = (2.0 * random(), 0.0);
        for i in 0..*samples {
            if i % 40 == 0 {
                torque = 4.0 * (random() - 0.5);
            }
            let gauss = (0..12).map(|_| random()).sum::<f64>() - 6.0;
            text += &format!("{},{torque},{}\n", i * 5, (v + noise * gauss) * 30.0 / PI);
            for _ in 0..50 {
                let h = 0.005 / 50.0;
                let free: f64 = v + h * (torque - 0.08 * v) / 0.05;
                let stop = h * friction_nm / 0.05;
                v = if free.abs() <= stop { 0.0 } else { free - stop * free.signum() };
            }
        }
        std::fs::write(folder.join(format!("{name}.csv")), text).expect("written");
        files += &format!("[files.{name}]\npath = \"{name}.csv\"\n");
        let usage = if judge.contains(name) { "judge" } else { "fit" };
        all += &format!(
            "[records.{name}]\nfile = \"{name}\"\nuse = \"{usage}\"\ntime_column = \"time_ms\"\ntime_unit = \"ms\"\n"
        );
    }
    let drive = "# a test rig\nfidelity = \"lumped\"\n\n[rotors.disc]\ninertia_kg_m2 = 0.055 # from the drawing\n\n[loads.viscous.disc]\ntorque_nm_s_per_rad = 0.1\n\n[inputs.torque.disc]\n\n[sensors.tachometer.disc]\n";
    std::fs::write(folder.join("rig.toml"), drive).expect("written");
    let text = format!(
        "title = \"rig\"\ndrive = \"rig.toml\"\n{files}\
         [channels.speed]\nsensor = \"sensors.tachometer.disc\"\ncolumn = \"speed_rpm\"\nunit = \"rpm\"\n\
         [inputs.torque]\ninput = \"inputs.torque.disc\"\ncolumn = \"torque\"\nunit = \"N m\"\nhold = true\n{all}\
         [fit.\"rotors.disc.inertia_kg_m2\"]\nspread_percent = 20\n[fit.\"loads.viscous.disc.torque_nm_s_per_rad\"]\n"
    );
    let path = folder.join("rig-measured.toml");
    std::fs::write(&path, text).expect("written");
    path
}

/// A machine that warms up: the friction falls from record to record, and the records between them follow. With one size for all
/// records it does not stand.
#[test]
fn friction_that_falls_from_record_to_record_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let planted = [("a", 600, 0.6), ("b", 600, 0.5), ("c", 600, 0.43), ("d", 600, 0.38), ("e", 600, 0.35)];
    let path = rotor_records(folder.path(), &planted, &["b", "d"], 0.05);
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    let varying = r.varying.first().expect("a number that differs");
    assert_eq!(varying.path, "effects.coulomb_friction.disc.torque_nm");
    assert_eq!(varying.course, pitchline::identify::drifting::Course::Falls);
    for (value, (name, _, truth)) in varying.values.iter().zip([planted[0], planted[2], planted[4]]) {
        assert_eq!(value.record, name);
        assert!((value.value / truth - 1.0).abs() < 0.03, "{value:?}, planted {truth}");
    }
    let [ratio, _, high] = varying.held_out_ratio.expect("held-out records");
    assert!(ratio < 0.7 && high < 0.8, "{varying:?}");
    assert_eq!(r.outcome, IdentificationVerdict::Named, "{:?}", paths(&r));
    assert_eq!(paths(&r), ["effects.coulomb_friction.disc"]);
    assert!(r.explained, "{:?}", r.noise_floor);
    let text = pitchline::identify::text::text(&r);
    assert!(text.contains("NAMED: effects.coulomb_friction.disc, which falls in the order of the records"), "{text}");
    // The drive file gets the state of the machine at the end.
    let drive = std::fs::read_to_string(folder.path().join("rig.toml")).expect("the drive");
    let machine = Machine::parse("rig.toml", &drive, &[]).expect("a machine");
    let updated = pitchline::identify::updated::updated(&machine, &r).expect("written");
    let again = Machine::parse("updated.toml", &updated, &[]).expect("it reads back");
    let slot = again.slot("effects.coulomb_friction.disc.torque_nm").expect("the number");
    assert!((again.values[slot] / 0.35 - 1.0).abs() < 0.03, "{updated}");
}

/// The reported set is fitted from other starts too; with good records all end at the same numbers.
#[test]
fn fits_from_other_starts_end_in_one_basin() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.4, 0.15);
    let r = identified(&path, 2, ALL).expect("identified");
    let [basin] = r.basins.as_slice() else { panic!("{:?}", r.basins) };
    assert_eq!(basin.starts, ["the search", "the file's numbers", "numbers twice as large", "numbers half as large"]);
    assert!(basin.above == 0.0 && basin.numbers.is_empty() && basin.doubt().is_none());
    let text = pitchline::identify::text::text(&r);
    assert!(text.contains("fits from the search, the file's numbers, numbers twice as large"), "{text}");
}

/// What another basin makes of a name: nothing where it fits worse, or where no number differs.
#[test]
fn another_basin_is_a_doubt_where_it_fits_as_well() {
    let basin = |above: f64, numbers: &[(&str, f64, f64)]| pitchline::identify::basins::Basin {
        starts: vec!["the file's numbers".into()],
        above,
        numbers: numbers.iter().map(|(path, there, reported)| ((*path).to_string(), *there, *reported)).collect(),
    };
    let inertia = [("rotors.disc.inertia_kg_m2", 0.1, 0.05)];
    assert!(basin(3.0, &inertia).doubt().is_some_and(|d| d.contains("fits as well") && d.contains("inertia")));
    assert!(basin(-20.0, &inertia).doubt().is_some_and(|d| d.contains("better basin")));
    assert!(basin(100.0, &inertia).doubt().is_none() && basin(0.2, &[]).doubt().is_none());
}

/// Three records are enough for a course where the one in the middle is held out.
#[test]
fn friction_that_falls_over_three_records_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let planted = [("a", 600, 0.6), ("b", 600, 0.49), ("c", 600, 0.38)];
    let path = rotor_records(folder.path(), &planted, &["b"], 0.05);
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    let varying = r.varying.first().expect("a number that differs");
    assert_eq!(varying.path, "effects.coulomb_friction.disc.torque_nm");
    assert_eq!(varying.course, pitchline::identify::drifting::Course::Falls);
    for (value, truth) in varying.values.iter().zip([0.6, 0.38]) {
        assert!((value.value / truth - 1.0).abs() < 0.03, "{value:?}, planted {truth}");
    }
    assert_eq!((r.outcome, paths(&r)), (IdentificationVerdict::Named, vec!["effects.coulomb_friction.disc"]));
    // Numbers of the machine are those beside the friction of each record.
    let inertia = r.numbers_after.iter().find(|n| n.path == "rotors.disc.inertia_kg_m2").expect("the inertia");
    assert!((inertia.value / 0.05 - 1.0).abs() < 0.03, "{inertia:?}");
}

/// Where all three are fitted and the end of each judges, no record confirms a course: the effect is a lead, with how its size goes.
#[test]
fn the_course_of_three_fitted_records_is_a_doubt() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_records(folder.path(), &[("a", 600, 0.6), ("b", 600, 0.48), ("c", 600, 0.38)], &[], 0.05);
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    assert_eq!((r.outcome, paths(&r)), (IdentificationVerdict::Lead, vec!["effects.coulomb_friction.disc"]));
    assert!(r.doubts.iter().any(|d| d.contains("in the first record to")), "{:?}", r.doubts);
}

/// Rows of a logic analyser: time and levels of two wheels whose teeth end at the times given for each.
fn analyser(teeth: [&[f64]; 2]) -> String {
    let mut changes: Vec<(f64, usize, u8)> = Vec::new();
    for (wheel, times) in teeth.iter().enumerate() {
        changes.extend(times.iter().flat_map(|t| [(t - 2e-4, wheel, 1), (*t, wheel, 0)]));
    }
    changes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut level = [0, 0];
    let mut text = String::from("Time[s], crank, cam\n");
    for (t, wheel, to) in changes {
        level[wheel] = to;
        text += &format!("{t:.9}, {}, {}\n", level[0], level[1]);
    }
    text
}

/// A crank of changing speed, and a camshaft at half of it whose wheel of twelve places sits 0.3 deg out of its middle.
#[test]
fn an_eccentric_wheel_on_a_camshaft_is_named_from_the_edges_of_two_pickups() {
    use std::f64::consts::PI;
    let folder = tempfile::tempdir().expect("a folder");
    let (mut places, mut random) = (Vec::new(), 1_u64);
    // The records begin at different places of both wheels.
    for (name, rpm, begins) in [("a", 1500.0, 5), ("b", 1900.0, 20), ("c", 1700.0, 60)] {
        // Time at which the crank has turned by an angle.
        let time = |angle: f64| (angle + 0.01 * f64::sin(2.0 * angle)) / (rpm * PI / 30.0);
        let tooth = |k: usize, places: usize, missing: &[usize]| !missing.contains(&(k % places + 1));
        let crank: Vec<f64> =
            (begins..36 * 26).filter(|k| tooth(*k, 36, &[14, 15, 33])).map(|k| time(k as f64 * PI / 18.0)).collect();
        let mut noise = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        // What the pickup reads is the angle of the shaft and 0.3 deg sin(angle + 1).
        let at = |read: f64| (0..20).fold(read, |a, _| read - 0.3_f64.to_radians() * f64::sin(a + 1.0));
        let cam: Vec<f64> = (begins / 5..12 * 12)
            .filter(|k| tooth(*k, 12, &[12]))
            .map(|k| time(2.0 * (at(k as f64 * PI / 6.0) + 0.02_f64.to_radians() * noise())))
            .collect();
        places.push(cam.len());
        std::fs::write(folder.path().join(format!("{name}.csv")), analyser([&crank, &cam])).expect("written");
    }
    let drive = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/measurements/engine-4b11-drive.toml");
    let drive = std::fs::read_to_string(drive).expect("the drive");
    // The camshaft of these records is rigid.
    let stiff = drive.replace("per_rad = 1500.0", "per_rad = 6000.0");
    assert_ne!(stiff, drive);
    std::fs::write(folder.path().join("drive.toml"), stiff).expect("written");
    let mut text = String::from("drive = \"drive.toml\"\n");
    for name in ["a", "b", "c"] {
        text += &format!(
            "[files.{name}]\npath = \"{name}.csv\"\n[records.{name}]\nfile = \"{name}\"\ntime_column = \"Time[s]\"\ntime_unit = \"s\"\n"
        );
        text += if name == "c" { "use = \"judge\"\n" } else { "" };
    }
    text += "[wheels.crank]\ncolumn = \"crank\"\nedge = \"falling\"\nteeth = 36\nmissing = [14, 15, 33]\n";
    text += "[wheels.cam]\ncolumn = \"cam\"\nedge = \"falling\"\nteeth = 12\nmissing = [12]\n";
    text += "[inputs.crank]\ninput = \"inputs.angle.crank\"\ncolumn = \"wheels.crank\"\nunit = \"deg\"\n";
    text += "[channels.cam]\nsensor = \"sensors.encoder.cam\"\ncolumn = \"wheels.cam\"\nunit = \"deg\"\n";
    text += "[fit.\"effects.offset.cam.offset\"]\nlow = -7.0\nhigh = 7.0\n";
    text += "[candidates]\nonly = [\"encoder_error\", \"latency\", \"coulomb_friction\", \"gain_error\"]\n";
    let path = folder.path().join("measured.toml");
    std::fs::write(&path, text).expect("written");
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    let of = |wheel: &str| r.wheels.iter().find(|w| w.record == "a" && w.wheel == wheel).expect("the wheel");
    assert_eq!((of("crank").missed, of("crank").extra_s.len(), of("cam").edges), (0, 0, places[0]));
    // Both wheels are counted from the same angle of the camshaft in all records, whatever turn the crank is in.
    let offset = r.numbers_after[0].value.to_degrees();
    assert!(offset.abs() < 0.05, "{offset} deg");
    let phases = r.effects[0].parameters.iter().filter(|p| p.path.ends_with("phase_deg"));
    assert!(phases.clone().count() == 2 && phases.clone().all(|p| (p.value - 57.3).abs() < 1.0), "{:?}", r.effects[0]);
    let order = of("crank").orders[0];
    assert!(order.order == 2.0 && (order.speed_percent - 2.0).abs() < 0.02, "{order:?}");
    assert_eq!(paths(&r), ["effects.encoder_error.cam"]);
    // Even noise of 0.02 deg from end to end.
    let floor = r.noise_floor[0].noise_floor;
    assert!((floor / (0.02 / f64::sqrt(12.0)) - 1.0).abs() < 0.25, "{floor} deg");
    let size = r.effects[0].parameters[0].value;
    assert!((size - 0.3).abs() < 0.006, "{size}");
}

#[test]
fn planted_friction_is_named_with_its_size_and_written_into_the_drive() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.4, 0.15);
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    assert_eq!(r.outcome, IdentificationVerdict::Named, "{:?}", paths(&r));
    assert_eq!(paths(&r), ["effects.coulomb_friction.disc"]);
    let torque = &r.effects[0].parameters[0];
    assert!((torque.value - 0.4).abs() < 4.0 * torque.standard_error + 0.01, "{torque:?}");
    assert!(r.explained, "{:?}", r.noise_floor);
    assert!(r.varying.is_empty(), "{:?}", r.varying);
    // The residual before looks like friction, and the residual after has no structure.
    let force = &r.diagnosis.forces[0];
    assert!(force.term.starts_with("sign(v)") && force.body == "rotors.disc" && force.share > 0.8, "{force:?}");
    let after = r.diagnosis_after.as_ref().expect("there is an effect");
    assert!(after.channels[0].white && after.channels[0].above_floor < 0.05, "{after:?}");
    let inertia = &r.numbers_after[0];
    assert!((inertia.value - 0.05).abs() < 0.001, "{inertia:?}");
    let drive = std::fs::read_to_string(folder.path().join("rig.toml")).expect("the drive");
    let machine = Machine::parse("rig.toml", &drive, &[]).expect("a machine");
    let updated = pitchline::identify::updated::updated(&machine, &r).expect("written");
    assert!(updated.contains("# from the drawing") && updated.contains("[effects.coulomb_friction.disc]"), "{updated}");
    let again = Machine::parse("updated.toml", &updated, &[]).expect("it reads back");
    // A file with line ends of Windows keeps them.
    let windows = Machine::parse("rig.toml", &machine.text.replace('\n', "\r\n"), &[]).expect("it is read");
    let written = pitchline::identify::updated::updated(&windows, &r).expect("written");
    assert_eq!(written.replace("\r\n", "\n"), updated);
    assert!(!written.replace("\r\n", "").contains(['\r', '\n']), "{written:?}");
    let slot = again.slot("effects.coulomb_friction.disc.torque_nm").expect("the number");
    assert_eq!(again.values[slot], torque.value);
}

/// A damper that is missing, and friction alone to explain it: friction that bends at a speed which the disc does not reach is a damper, and no friction.
#[test]
fn friction_that_bends_beyond_the_speeds_of_the_records_is_not_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.0, 0.05);
    let change = |file: &str, from: &str, to: &str| {
        let text = std::fs::read_to_string(folder.path().join(file)).expect("a file");
        assert!(text.contains(from), "{text}");
        std::fs::write(folder.path().join(file), text.replace(from, to)).expect("written");
    };
    change("rig.toml", "rad = 0.1", "rad = 0.02");
    change(
        "rig-measured.toml",
        "[fit.\"loads.viscous.disc.torque_nm_s_per_rad\"]\n",
        "[candidates]\nonly = [\"coulomb_friction\"]\n",
    );
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    assert_eq!(r.outcome, IdentificationVerdict::None, "{:?}", paths(&r));
    // The search fits friction in two forms. It drops the form that bends beyond the records, and finds that a damper fits better than the other form.
    let why = |c: &pitchline::identify::search::Trial| {
        c.why.contains("a force of the form v in its place leaves clearly less")
    };
    assert!(r.candidates.iter().any(why), "{:#?}", r.candidates);
}

/// A controller moves the disc of [`rotor_with_friction`] to and fro; friction of 0.4 N m and a constant of 0.1 N m are missing in the
/// drive file, whose inertia is ten times too large. A simulation from the recorded torque leaves such records at once.
#[test]
fn friction_in_a_closed_loop_is_named_although_the_inertia_is_wrong() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.0, 0.1);
    let mut random = pitchline::identify::stats::Random::new(5);
    for (k, file) in ["a.csv", "b.csv", "c.csv"].into_iter().enumerate() {
        let mut text = String::from("time_ms,torque,speed_rpm\n");
        let (mut v, mut past) = (0.0_f64, 0.0_f64);
        for i in 0..600 {
            let t = f64::from(i) * 0.005;
            let wanted = 6.0 * libm::sin((2.0 + k as f64) * t) + 3.0 * libm::sin(7.0 * t + k as f64);
            let noise = (random.below(2001) as f64 / 1000.0 - 1.0) * 0.02;
            let error = wanted - (v + noise);
            past += 0.005 * error;
            let torque = 0.8 * error + 4.0 * past;
            text += &format!("{},{torque},{}\n", i * 5, (v + noise) * 30.0 / PI);
            for _ in 0..50 {
                let h = 0.005 / 50.0;
                let free = v + h * (torque - 0.1 - 0.08 * v) / 0.05;
                let stop = h * 0.4 / 0.05;
                v = if free.abs() <= stop { 0.0 } else { free - stop * free.signum() };
            }
        }
        std::fs::write(folder.path().join(file), text).expect("written");
    }
    let change = |file: &str, from: &str, to: &str| {
        let text = std::fs::read_to_string(folder.path().join(file)).expect("a file");
        assert!(text.contains(from), "{text}");
        std::fs::write(folder.path().join(file), text.replace(from, to)).expect("written");
    };
    change("rig.toml", "inertia_kg_m2 = 0.055", "inertia_kg_m2 = 0.5");
    change("rig-measured.toml", "spread_percent = 20\n", "");
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    let found = paths(&r);
    assert!(found.contains(&"effects.coulomb_friction.disc"), "{found:?}");
    let constants = ["effects.constant_torque.disc", "effects.input_offset.disc"];
    assert!(found.len() == 2 && found.iter().any(|p| constants.contains(p)), "{found:?}");
    assert!(r.doubts.is_empty() && r.look_first.iter().any(|t| t.contains("inertia_kg_m2")), "{:?}", r.look_first);
    let inertia = &r.numbers_after[0];
    assert!((inertia.value / 0.05 - 1.0).abs() < 0.1, "{inertia:?}");
    let inverse = r.inverse_dynamics.as_ref().expect("motion and torque are measured");
    let by_path = |path: &str| inverse.numbers.iter().find(|n| n.path == path).expect("a number").inverse;
    assert!((by_path("rotors.disc.inertia_kg_m2") / 0.05 - 1.0).abs() < 0.1, "{inverse:?}");
    assert!((by_path("effects.coulomb_friction.disc.torque_nm") / 0.4 - 1.0).abs() < 0.1, "{inverse:?}");
}

/// A second harmonic of an effect that the drive file already contains is added with its own parameters, and written to
/// the file.
#[test]
fn a_second_harmonic_is_found_beside_the_one_that_is_declared() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.0, 0.1);
    let mut noise = pitchline::identify::stats::Random::new(11);
    for (file, torque) in [("a.csv", 1.2), ("b.csv", 0.8), ("c.csv", 1.0)] {
        let mut text = String::from("time_ms,torque,speed_rpm\n");
        let (mut q, mut v) = (0.0_f64, torque / 0.08);
        for i in 0..500 {
            let uniform = noise.below(2001) as f64 / 1000.0 - 1.0;
            text += &format!("{},{torque},{}\n", i * 5, (v + 0.05 * uniform) * 30.0 / PI);
            for _ in 0..50 {
                let ripple = 0.3 * q.cos() + 0.25 * (2.0 * q + 1.0).cos();
                v += 0.005 / 50.0 * (torque + ripple - 0.08 * v) / 0.05;
                q += 0.005 / 50.0 * v;
            }
        }
        std::fs::write(folder.path().join(file), text).expect("written");
    }
    let drive = std::fs::read_to_string(folder.path().join("rig.toml")).expect("the drive");
    let drive = drive + "\n[effects.torque_ripple.disc]\ntorque_nm = 0.3\norder = 1\nphase_deg = 90.0\n";
    std::fs::write(folder.path().join("rig.toml"), &drive).expect("written");
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    assert_eq!(paths(&r), ["effects.torque_ripple.disc+"]);
    let numbers = &r.effects[0].parameters;
    let of = |key: &str| numbers.iter().find(|n| n.path.ends_with(key)).map_or(f64::NAN, |n| n.value);
    assert_eq!(of(".order"), 2.0);
    assert!((of(".torque_nm").abs() - 0.25).abs() < 0.02, "{numbers:?}");
    assert!(r.effects[0].sizes.len() == 4, "{:?}", r.effects[0].sizes);
    let machine = Machine::parse("rig.toml", &drive, &[]).expect("a machine");
    let updated = pitchline::identify::updated::updated(&machine, &r).expect("written");
    let again = Machine::parse("updated.toml", &updated, &[]).unwrap_or_else(|e| panic!("{e}\n{updated}"));
    assert_eq!(again.placed.iter().filter(|p| p.effect.name == "torque_ripple").count(), 2);
}

/// Two records of a disc that coasts, each with its own drag: held-out segments are run with the parameters of their
/// own record.
#[test]
fn parts_that_judge_have_the_numbers_of_their_own_record() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut noise = pitchline::identify::stats::Random::new(5);
    for (file, drag) in [("a.csv", 1.2e-4), ("b.csv", 2.0e-4)] {
        let mut text = String::new();
        for _ in 0..8 {
            let mut v = 60.0_f64;
            while v > 30.0 {
                // In closed form: v decreases by exp(-k/J dq) from mark to mark.
                let (turn, rate) = (std::f64::consts::TAU / 6.0, drag / 0.02);
                let interval_s = ((rate * turn).exp() - 1.0) / (rate * v);
                v *= (-rate * turn).exp();
                let uniform = noise.below(2001) as f64 / 1000.0 - 1.0;
                text += &format!("{:.9}\n", interval_s * (1.0 + 1e-3 * uniform));
            }
            for i in 0..12 {
                text += &format!("{:.9}\n", std::f64::consts::TAU / 6.0 / (30.0 + 2.5 * f64::from(i)));
            }
        }
        std::fs::write(folder.path().join(file), text).expect("written");
    }
    let drive = "fidelity = \"lumped\"\n[rotors.disc]\ninertia_kg_m2 = 0.02\n[loads.quadratic.disc]\n\
         torque_nm_s2_per_rad2 = 1.5e-4\n[sensors.pulse_pickup.disc]\nmarks = 6\n";
    std::fs::write(folder.path().join("disc.toml"), drive).expect("written");
    let record = |n: &str| format!("[records.{n}]\nfile = \"{n}\"\nsplit = \"coasting\"\njudge_share = 0.5\n");
    let text = format!(
        "title = \"disc\"\ndrive = \"disc.toml\"\n[files.a]\npath = \"a.csv\"\nheader = false\n[files.b]\npath = \"b.csv\"\nheader = false\n\
         [channels.pickup]\nsensor = \"sensors.pulse_pickup.disc\"\ncolumn = \"1\"\nunit = \"s\"\n{}{}\
         [fit.\"loads.quadratic.disc.torque_nm_s2_per_rad2\"]\nper = \"record\"\n",
        record("a"),
        record("b")
    );
    let path = folder.path().join("disc-measured.toml");
    std::fs::write(&path, text).expect("written");
    let r = identified(&path, 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    assert_eq!(r.outcome, IdentificationVerdict::None, "{:?}", paths(&r));
    for e in &r.error_before {
        let (fit, held_out) = (e.fit.expect("fits"), e.held_out.expect("judges"));
        assert!((held_out / fit - 1.0).abs() < 0.1, "{e:?}");
    }
}

/// Nearly normal numbers, the same in every run.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// A fan that coasts, measured by the time between pulses. Quadratic drag and a constant load are both missing, and
/// without one of them the other makes the model stop long before the record does. As it never reverses, the load may
/// be friction.
#[test]
fn a_fan_that_runs_down_has_drag_and_a_load_that_may_be_friction() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    let mut random = Noise(88_172_645_463_325_252);
    let mut files = String::new();
    for (name, start, usage) in [("a", 160.0, "fit"), ("c", 140.0, "fit"), ("b", 120.0, "judge")] {
        let (h, mut t, mut angle, mut speed): (f64, f64, f64, f64) = (1e-4, 0.0, 0.0, start);
        let (mut text, mut last) = (String::from("interval_us\n"), f64::NAN);
        while speed > 8.0 {
            let slows = |v: f64| -(1.1e-3 * v + 2.4e-5 * v * v + 0.02) / 0.05;
            let middle = slows(speed + 0.5 * h * slows(speed));
            let turned = h * speed + 0.5 * h * h * middle;
            if angle + turned >= 2.0 * PI {
                let pulse = t + h * (2.0 * PI - angle) / turned;
                if last.is_finite() {
                    text += &format!("{:.0}\n", 1e6 * (pulse - last) + 2.0 * random.next());
                }
                last = pulse;
                angle -= 2.0 * PI;
            }
            (angle, speed, t) = (angle + turned, speed + h * middle, t + h);
        }
        write(&format!("{name}.csv"), &text);
        files +=
            &format!("[files.{name}]\npath = \"{name}.csv\"\n[records.{name}]\nfile = \"{name}\"\nuse = \"{usage}\"\n");
    }
    write(
        "fan.toml",
        "title = \"fan\"\nfidelity = \"lumped\"\n[rotors.fan]\ninertia_kg_m2 = 0.05\n[loads.viscous.fan]\ntorque_nm_s_per_rad = 0.002\n[sensors.pulse_pickup.fan]\nmarks = 1\n",
    );
    let measurement = format!(
        "title = \"fan\"\ndrive = \"fan.toml\"\n{files}[channels.pulses]\nsensor = \"sensors.pulse_pickup.fan\"\ncolumn = \"interval_us\"\nunit = \"us\"\n[fit.\"loads.viscous.fan.torque_nm_s_per_rad\"]\n"
    );
    write("fan-measured.toml", &measurement);
    // What the file states of the noise counts.
    let drive = std::fs::read_to_string(folder.path().join("fan.toml")).expect("the drive");
    let machine = Machine::parse("fan.toml", &drive, &[]).expect("a machine");
    let noise = |stated: &str| {
        let text = measurement.replace("unit = \"us\"\n", &format!("unit = \"us\"\n{stated}"));
        let measurement = Measurement::parse("fan-measured.toml", &text).expect("a measurement");
        let memory = &mut Memory::for_program(1_000_000_000);
        load(&measurement, &machine, folder.path(), memory).expect("data").channels[0].noise
    };
    let (shown, stated, doubled) = (noise(""), noise("noise = 20\n"), noise("noise = 40\n"));
    assert!((doubled / stated - 2.0).abs() < 1e-12 && stated > 2.0 * shown, "{shown} {stated} {doubled}");
    let r = identified(&folder.path().join("fan-measured.toml"), 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    assert_eq!(r.outcome, IdentificationVerdict::Ambiguous, "{:?}", paths(&r));
    let mut names = paths(&r);
    names.sort_unstable();
    assert_eq!(names, ["effects.constant_torque.fan", "effects.quadratic_drag.fan"]);
    assert!(r.explained && r.converged);
    for (path, truth) in [("effects.constant_torque.fan", 0.02), ("effects.quadratic_drag.fan", 2.4e-5)] {
        let e = r.effects.iter().find(|e| e.path == path).expect("named");
        let size = e.parameters[0].value;
        assert!((size / truth - 1.0).abs() < 2e-3, "{path}: {size}, planted {truth}");
        let rivals: Vec<&str> = e.rivals.iter().map(|r| r.identity.as_str()).collect();
        assert_eq!(rivals.contains(&"effects.coulomb_friction.fan"), path.contains("constant"), "{path}: {rivals:?}");
    }
}

/// A motor and its load on a shaft that is declared rigid, with friction: the alternative that replaces friction when
/// its law is tested must not be the same friction with another smoothing.
#[test]
fn friction_beside_a_flexible_shaft_keeps_its_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    let mut random = Noise(88_172_645_463_325_252);
    let mut files = String::new();
    for (name, usage) in [("a", "fit"), ("b", "fit"), ("c", "judge")] {
        let mut text = String::from("t,torque,speed\n");
        let (mut torque, mut until) = (0.0, 0.0);
        let [mut q, mut p, mut v, mut w] = [0.0_f64; 4];
        for n in 0..2500 {
            let t = f64::from(n) * 2e-3;
            if t >= until {
                (torque, until) = (random.next(), t + 0.02 + 0.1 * random.next().abs());
            }
            text += &format!("{t:.3},{torque},{}\n", v + 0.05 * random.next());
            for _ in 0..100 {
                let shaft = 60.0 * (q - p) + 0.02 * (v - w);
                v += 2e-5 * (torque - shaft - 0.01 * v - 0.08 * (v / 0.05).tanh()) / 2e-3;
                w += 2e-5 * (shaft - 0.004 * w) / 3e-3;
                (q, p) = (q + 2e-5 * v, p + 2e-5 * w);
            }
        }
        write(&format!("{name}.csv"), &text);
        files += &format!(
            "[files.{name}]\npath = \"{name}.csv\"\n[records.{name}]\nfile = \"{name}\"\nuse = \"{usage}\"\ntime_column = \"t\"\ntime_unit = \"s\"\n"
        );
    }
    write(
        "shaft.toml",
        "title = \"shaft\"\nfidelity = \"lumped\"\n[rotors.shaft]\ninertia_kg_m2 = 5e-3\n[loads.viscous.shaft]\ntorque_nm_s_per_rad = 0.01\n[inputs.torque.shaft]\n[sensors.tachometer.shaft]\n",
    );
    let measurement = format!(
        "title = \"shaft\"\ndrive = \"shaft.toml\"\n{files}[channels.speed]\nsensor = \"sensors.tachometer.shaft\"\ncolumn = \"speed\"\nunit = \"rad/s\"\n[inputs.motor]\ninput = \"inputs.torque.shaft\"\ncolumn = \"torque\"\nunit = \"N m\"\nhold = true\n[fit.\"rotors.shaft.inertia_kg_m2\"]\nspread_percent = 10\n[fit.\"loads.viscous.shaft.torque_nm_s_per_rad\"]\n[candidates]\nonly = [\"coulomb_friction\", \"torsional_resonance\"]\n"
    );
    write("measured.toml", &measurement);
    let r = identified(&folder.path().join("measured.toml"), 2, ALL).expect("identified");
    let mut names = paths(&r);
    names.sort_unstable();
    assert_eq!(names, ["effects.coulomb_friction.shaft", "effects.torsional_resonance.shaft"]);
    // The damper of the other end is not among the effects.
    assert_eq!(r.outcome, IdentificationVerdict::Part);
    let value = |path: &str, key: &str| {
        let e = r.effects.iter().find(|e| e.path == path).expect("named");
        e.parameters.iter().find(|p| p.path.ends_with(key)).expect("a number").value
    };
    let friction = value("effects.coulomb_friction.shaft", "torque_nm");
    let inertia = value("effects.torsional_resonance.shaft", "inertia_kg_m2");
    assert!(
        (friction / 0.08 - 1.0).abs() < 0.05 && (inertia / 3e-3 - 1.0).abs() < 0.02,
        "{friction} N m, {inertia} kg m2"
    );
}

#[test]
fn a_clean_record_is_explained_without_a_name_and_the_same_input_gives_the_same_report() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.0, 0.15);
    let one = identified(&path, 1, ALL).expect("identified");
    let two = identified(&path, 2, ALL).expect("identified");
    let text = |r: &IdentificationReport| serde_json::to_string(r).expect("JSON");
    assert_eq!(one.outcome, IdentificationVerdict::None, "{:?}", paths(&one));
    assert!(one.explained, "{:?}", one.noise_floor);
    assert_eq!(text(&one), text(&two));
    assert_eq!(pitchline::render::identify::html(&one), pitchline::render::identify::html(&two));
}

/// A wave twice per revolution whose amplitude grows with the square of speed is detected before anything is named.
#[test]
fn what_is_left_is_told_by_order_and_speed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.0, 0.1);
    for (file, speed) in [("a.csv", 20.0_f64), ("b.csv", 40.0), ("c.csv", 30.0)] {
        let mut text = String::from("time_ms,torque,speed_rpm\n");
        for i in 0..600 {
            let wave = 0.5 * (speed / 20.0).powi(2) * libm::sin(2.0 * speed * 0.005 * f64::from(i) + 0.7);
            text += &format!("{},{},{}\n", i * 5, 0.08 * speed, (speed + wave) * 30.0 / PI);
        }
        std::fs::write(folder.path().join(file), text).expect("written");
    }
    let r = identified(&path, 1, Budget { runs: Some(60), seconds: None }).expect("identified");
    let line = &r.diagnosis.channels[0].orders[0];
    assert!(line.name == "order 2 of disc" && line.share > 0.9, "{line:?}");
    let exponent = line.speed_exponent.expect("two speeds");
    assert!((exponent - 2.0).abs() < 0.1, "{exponent}");
    assert!(pitchline::identify::text::text(&r).contains("order 2 of disc"));
}

#[test]
fn a_budget_ends_the_search_and_what_was_found_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.4, 0.15);
    let whole = identified(&path, 1, ALL).expect("identified");
    let mut ended_early = 0;
    for runs in [60, 300, 1000, 3000, 10_000] {
        let r = identified(&path, 1, Budget { runs: Some(runs), seconds: None }).expect("identified");
        println!("{runs}: {} runs, {:?}", r.model_runs, r.outcome);
        // A fit that runs is no longer than some hundred runs.
        assert!(r.model_runs <= runs + 600, "{} of {runs}", r.model_runs);
        if r.model_runs < whole.model_runs {
            assert!(r.budget_spent && pitchline::identify::text::text(&r).contains("PARTIAL"), "{runs}");
            ended_early += 1;
        } else {
            assert_eq!((r.budget_spent, r.outcome), (false, whole.outcome));
        }
    }
    assert!(ended_early >= 3, "{} runs are all", whole.model_runs);
}

#[test]
fn records_that_start_at_rest_have_no_start_to_find() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.0, 0.1);
    let text = std::fs::read_to_string(&path).expect("text");
    let machine = std::fs::read_to_string(folder.path().join("rig.toml")).expect("the drive");
    let machine = Machine::parse("rig.toml", &machine, &[]).expect("a machine");
    for (start, moves) in [("free", true), ("rest", false)] {
        let text = text.replace("time_unit = \"ms\"", &format!("time_unit = \"ms\"\nstart = \"{start}\""));
        let measurement = Measurement::parse("m.toml", &text).expect("a measurement");
        let data = load(&measurement, &machine, folder.path(), &mut Memory::for_program(1_000_000_000)).expect("data");
        let (stop, runs) = (AtomicBool::new(false), AtomicU64::new(0));
        let quiet = |_: &str, _: u64| {};
        let started = std::time::Instant::now();
        let context = Context { threads: 1, budget: ALL, started, stop: &stop, progress: &quiet, runs: &runs };
        let problem = declared::problem(&measurement, &machine, &data, &context);
        let point = problem.start();
        for part in 0..2 {
            let shifted: Vec<f64> = point.locals[part].iter().map(|x| x + 0.5).collect();
            let (a, b) = (&point.locals[part], &shifted);
            let same = problem.residuals(part, &point.globals, a) == problem.residuals(part, &point.globals, b);
            assert_eq!(same, !moves, "{start}, part {part}");
        }
    }
}

/// A fit that stops on its way goes on as if it had not, to the bit.
#[test]
fn a_fit_goes_on_where_it_stopped() {
    use pitchline::identify::fit::{FitOptions, Fitting, fit};
    let folder = tempfile::tempdir().expect("a folder");
    let path = rotor_with_friction(folder.path(), 0.4, 0.15);
    let text = std::fs::read_to_string(&path).expect("text");
    let machine = std::fs::read_to_string(folder.path().join("rig.toml")).expect("the drive");
    let machine = Machine::parse("rig.toml", &machine, &[]).expect("a machine");
    let measurement = Measurement::parse("m.toml", &text).expect("a measurement");
    let data = load(&measurement, &machine, folder.path(), &mut Memory::for_program(1_000_000_000)).expect("data");
    let (stop, runs) = (AtomicBool::new(false), AtomicU64::new(0));
    let quiet = |_: &str, _: u64| {};
    let started = std::time::Instant::now();
    let context = Context { threads: 1, budget: ALL, started, stop: &stop, progress: &quiet, runs: &runs };
    let problem = declared::problem(&measurement, &machine, &data, &context);
    let options = |iterations: usize| FitOptions { iterations, threads: 1 };
    let whole = fit(&problem, &problem.start(), options(40));
    let mut stopped = Fitting::begin(&problem, &problem.start(), 1);
    let squares = |all: &[Vec<f64>]| all.iter().flatten().map(|r| r * r).sum::<f64>();
    // Squares that are left and those that a linear model promises to leave.
    let left = [1, 2, 3, 40].map(|iterations| {
        stopped.go_on(&problem, options(iterations));
        let now = stopped.as_it_stands(&problem).residuals;
        (squares(&now), squares(&stopped.promised_residuals(&problem)))
    });
    stopped.go_to_the_end(&problem, options(40));
    let stopped = stopped.finish(&problem, options(40));
    assert_eq!((stopped.point, stopped.cost.to_bits()), (whole.point, whole.cost.to_bits()));
    assert_eq!((stopped.residuals, stopped.covariance), (whole.residuals, whole.covariance));
    assert_eq!((stopped.jacobians, stopped.converged), (whole.jacobians, true));
    // In the beginning a step promises much, and what it promises comes; at the end it promises nothing.
    assert!(left[0].1 < 0.9 * left[0].0 && left[3].1 == left[3].0, "{left:?}");
    assert!(left[3].0 < 1.05 * left[2].1, "{left:?}");
}

#[test]
fn teeth_that_divide_the_links_leave_open_what_they_leave_open() {
    use pitchline::identify::structure::collisions;
    let says = |z: u32, n: u32| {
        let all = collisions(&[("crank".to_string(), z)], Some(n));
        all.iter().any(|c| c.of == "chain loop" && c.says.contains("re-hung"))
    };
    assert!(says(20, 120), "harmonic 6 of the loop is the revolution");
    assert!(!says(21, 120) && !says(20, 127));
}

/// Errors in a file, and the required messages.
#[test]
fn mistakes_are_told_before_a_model_is_run() {
    let good = |folder: &Path| {
        let path = rotor_with_friction(folder, 0.0, 0.1);
        (std::fs::read_to_string(&path).expect("text"), path)
    };
    let cases: [(&str, &str, &str); 11] = [
        ("column = \"speed_rpm\"", "column = \"speed\"", "did you mean \"speed_rpm\"?"),
        ("unit = \"rpm\"", "unit = \"m/s\"", "is a speed, and `sensors.tachometer.disc` shows an angular speed"),
        ("unit = \"rpm\"", "unit = \"furlongs\"", "the unit `furlongs` is not known"),
        ("sensors.tachometer.disc", "sensors.tachometer.disk", "did you mean `sensors.tachometer.disc`?"),
        ("time_unit = \"ms\"", "time_unit = \"V\"", "no unit of time"),
        ("rotors.disc.inertia_kg_m2\"]", "rotors.disc.inertia\"]", "the drive has no number `rotors.disc.inertia`"),
        ("use = \"fit\"", "use = \"judge\"", "every record judges, none fits"),
        ("title = \"rig\"", "titel = \"rig\"", "did you mean `title`?"),
        ("path = \"a.csv\"", "path = \"x.csv\"", "cannot read"),
        ("use = \"fit\"", "use = \"fit\"\njudge_from_row = 4000", "record `a` has no row beyond 600"),
        (
            "[records.a]",
            "[records.a]\nset.\"rotors.disc.inertia_kg_m2\" = 0.06",
            "`rotors.disc.inertia_kg_m2` is fitted, and record `a` sets it",
        ),
    ];
    for (from, to, says) in cases {
        let folder = tempfile::tempdir().expect("a folder");
        let (text, path) = good(folder.path());
        assert!(text.contains(from), "{from}");
        std::fs::write(&path, text.replace(from, to)).expect("written");
        let error = identified(&path, 1, ALL).expect_err(to);
        assert!(error.contains(says), "{to}: no `{says}` in\n{error}");
    }
    // Units in a file are compared with the declared ones.
    let folder = tempfile::tempdir().expect("a folder");
    let (text, path) = good(folder.path());
    std::fs::write(folder.path().join("bench.mf4"), include_bytes!("data/bench.mf4")).expect("written");
    let text = text.replace("path = \"a.csv\"", "path = \"bench.mf4\"\ngroup = 0");
    let text = text.replace("column = \"speed_rpm\"\nunit = \"rpm\"", "column = \"speed\"\nunit = \"rad/s\"");
    std::fs::write(&path, text).expect("written");
    let error = identified(&path, 1, ALL).expect_err("another unit");
    assert!(error.contains("`speed` is in rpm by file `a`, not in rad/s"), "{error}");
    type Change = fn(&str) -> String;
    let data: [(Change, &str); 6] = [
        (|t| t.replacen("50,", "abc,", 1), "is no number"),
        (|t| t.lines().take(9).collect::<Vec<_>>().join("\n"), "record `a` has 8 samples"),
        (|t| t.replacen("\n250,", "\n25,", 1), "time does not grow"),
        (
            |t| {
                t.lines()
                    .map(|l| {
                        l.rsplit_once(',').map_or(l.to_string(), |(a, b)| {
                            if b == "speed_rpm" { l.to_string() } else { format!("{a},7.5") }
                        })
                    })
                    .collect::<Vec<_>>()
                    .join("\n")
            },
            "is constant",
        ),
        (
            |t| {
                t.lines()
                    .map(|l| {
                        l.rsplit_once(',').map_or(l.to_string(), |(a, b)| {
                            if b == "speed_rpm" { l.to_string() } else { format!("{a},nan") }
                        })
                    })
                    .collect::<Vec<_>>()
                    .join("\n")
            },
            "lacks 600 of 600 values",
        ),
        (|_| String::new(), "holds no rows"),
    ];
    for (change, says) in data {
        let folder = tempfile::tempdir().expect("a folder");
        let (_, path) = good(folder.path());
        let csv = std::fs::read_to_string(folder.path().join("a.csv")).expect("text");
        std::fs::write(folder.path().join("a.csv"), change(&csv)).expect("written");
        let error = identified(&path, 1, ALL).expect_err(says);
        assert!(error.contains(says), "no `{says}` in\n{error}");
    }
}
