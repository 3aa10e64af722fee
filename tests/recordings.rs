//! Recordings: the written data are read back, by this reader and by others; damage and full disks are reported.

mod common;
#[allow(dead_code)]
#[path = "common/readers.rs"]
mod readers;

use common::{assembled, drive};
use pitchline::assemble::Assembly;
use pitchline::drive::{BUNDLED, Drive};
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::recording::capture::{self, Camera};
use pitchline::recording::columns::{ColumnValues, Stored};
use pitchline::recording::frame::{Feature, Frame, Header, LinkInfo};
use pitchline::recording::{ViewOptions, create, mcap};
use pitchline::simulate::{RunLength, run};
use prost::Message;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;

/// Records `duration_s` of the bundled drive and returns the header and every tenth frame as it was taken.
fn record(paths: &[&Path], duration_s: f64) -> (Header, Vec<Frame>) {
    let drive = drive(&[]);
    let Assembly { model, mut state, report } = assembled(&drive);
    let span = RunLength::new(duration_s, 50e-6, model.step_s);
    let header = capture::header(&drive, &model, &report, span.steps_per_frame);
    let mut sinks: Vec<_> = paths.iter().map(|p| create(p, &header, ViewOptions::default()).expect("opens")).collect();
    // The same run again, with frames kept.
    let mut twin = state.clone();
    let mut scratch = Scratch::new(&model);
    run(&model, &mut state, &mut scratch, &header, span, &mut sinks, &AtomicBool::new(false), |_| {}).expect("runs");
    for sink in &mut sinks {
        sink.finish().expect("finishes");
    }
    let (mut camera, mut scratch, mut frames) = (Camera::default(), Scratch::new(&model), Vec::new());
    for step in 0..=span.steps {
        explicit::evaluate(&model, &twin, &mut scratch).expect("holds");
        if step % span.steps_per_frame == 0 || step == span.steps {
            frames.push(camera.take(&model, &twin, &scratch));
        }
        explicit::advance(&model, &mut twin, &mut scratch);
    }
    (header, frames)
}

#[test]
fn mcap_gives_back_every_value_to_the_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let (header, frames) = record(&[&path], 12e-3);
    let read = mcap::read(&path).expect("readable");
    assert!(read.complete);
    assert_eq!(read.header, header);
    assert!(read.frames == frames, "{} frames written, {} read", frames.len(), read.frames.len());
    assert!(!read.keyframes.is_empty() && !read.events.is_empty());
    let bytes = std::fs::metadata(&path).expect("there").len() as f64;
    let (n, last) = (frames.len() as f64, &frames[frames.len() - 1]);
    println!(
        "{:.0} bytes a frame: {} links x 9 + {} joints x 3 values, {} contacts; raw message {} bytes",
        bytes / n,
        last.links.x_m.len(),
        last.joints.force_x_n.len(),
        last.contacts.link.len(),
        last.encoded_len()
    );
    // measured: 1.25 times the values, with header, keyframes, scenes and transforms.
    assert!(bytes / n < 1.4 * last.encoded_len() as f64);
}

#[test]
fn a_recording_that_was_cut_off_opens_up_to_its_last_whole_chunk() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let (_, frames) = record(&[&path], 20e-3);
    let bytes = std::fs::read(&path).expect("readable");
    for share in [0.45, 0.7, 0.95] {
        let cut = folder.path().join("cut.mcap");
        std::fs::write(&cut, &bytes[..(bytes.len() as f64 * share) as usize]).expect("writable");
        let read = mcap::read(&cut).expect("opens");
        assert!(!read.complete);
        println!("cut at {share}: {} of {} frames", read.frames.len(), frames.len());
        assert!(read.frames.len() as f64 > share * frames.len() as f64 - 1.5 * mcap::FRAMES_PER_CHUNK as f64);
        assert!(frames.starts_with(&read.frames));
    }
    // Not a recording at all, and a flipped bit inside.
    let other = folder.path().join("other.mcap");
    std::fs::write(&other, b"no such thing").expect("writable");
    assert!(mcap::read(&other).expect_err("refused").to_string().contains("other.mcap"));
    let mut flipped = bytes.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0x40;
    std::fs::write(&other, &flipped).expect("writable");
    assert!(mcap::read(&other).is_err(), "a damaged chunk is no good data");
}

#[test]
fn a_full_disk_is_an_error_that_names_the_file() {
    if !Path::new("/dev/full").exists() {
        println!("skipped: this system has no /dev/full");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("full.mcap");
    std::os::unix::fs::symlink("/dev/full", &path).expect("a link");
    let drive = drive(&[]);
    let Assembly { model, report, .. } = assembled(&drive);
    let header = capture::header(&drive, &model, &report, 20);
    let error = create(&path, &header, ViewOptions::default()).err().expect("nothing can be written");
    assert!(format!("{error:#}").contains("full.mcap") && format!("{error:#}").contains("No space left"), "{error:#}");
}

#[test]
fn python_reads_every_value() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let (_, frames) = record(&[&path], 3e-3);
    let script = format!("{}/tests/read_mcap.py", env!("CARGO_MANIFEST_DIR"));
    let Some(python) = readers::python("mcap, mcap_protobuf") else { return };
    let expected = folder.path().join("expected.txt");
    // Every value as its bits, in the order of the schema.
    let mut lines = String::new();
    for frame in &frames {
        for value in values(frame) {
            lines.push_str(&format!("{:016x}\n", value.to_bits()));
        }
    }
    std::fs::write(&expected, lines).expect("writable");
    let out = Command::new(&python).arg(script).arg(&path).arg(&expected).output().expect("runs");
    println!("{}", String::from_utf8_lossy(&out.stdout));
    assert!(out.status.success(), "{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
}

/// With the reader that Foxglove itself uses, and by the schemas in the file.
#[test]
fn mcap_core_reads_every_frame() {
    let Ok(modules) = std::env::var("PITCHLINE_NODE_MODULES") else {
        println!("skipped: PITCHLINE_NODE_MODULES names no folder with @mcap/core, @mcap/support and protobufjs");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let (_, frames) = record(&[&path], 3e-3);
    let script = format!("{}/tests/read_mcap.mjs", env!("CARGO_MANIFEST_DIR"));
    let out = Command::new("node").arg(script).arg(&path).arg(modules).output().expect("node runs");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let read: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    println!("{}", read["topics"]);
    let found = read["frames"].as_array().expect("frames");
    assert_eq!(found.len(), frames.len());
    for (row, frame) in found.iter().zip(&frames) {
        // A float, and what is behind it in another field.
        let coarse = f64::from_bits(frame.links.x_m[0].to_bits() >> 29 << 29);
        let expected = [frame.step as f64, frame.t_s, coarse, frame.links.x_m.len() as f64];
        for (k, value) in expected.into_iter().enumerate() {
            let read = row[k].as_str().and_then(|text| text.parse::<f64>().ok());
            assert_eq!(read, Some(value), "step {}", frame.step);
        }
    }
}

#[test]
fn foxglove_schemas_are_those_of_foxglove() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    record(&[&path], 1e-3);
    let Some(python) = readers::python("mcap, foxglove_schemas_protobuf") else { return };
    let script = format!("{}/tests/check_foxglove.py", env!("CARGO_MANIFEST_DIR"));
    let out = Command::new(&python).arg(script).arg(&path).output().expect("runs");
    println!("{}", String::from_utf8_lossy(&out.stdout));
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
}

/// All numbers of a frame in the order of its schema.
fn values(f: &Frame) -> Vec<f64> {
    let numbers = |values: &ColumnValues<'_>| -> Vec<f64> {
        match *values {
            ColumnValues::F64(v) => v.to_vec(),
            ColumnValues::U32(v) => v.iter().map(|x| f64::from(*x)).collect(),
            ColumnValues::U64(v) => v.iter().map(|x| *x as f64).collect(),
            ColumnValues::Bool(v) => v.iter().map(|x| f64::from(u8::from(*x))).collect(),
            ColumnValues::Text(_) => Vec::new(),
        }
    };
    let mut all = vec![f.step as f64, f.t_s, f.crank_angle_rad];
    f.each_table(|table, columns| {
        let stored = table.message.columns.iter().zip(columns).filter(|(c, _)| c.stored != Stored::derived);
        all.extend(stored.flat_map(|(_, values)| numbers(values)));
    });
    let mut energy: Vec<_> = f.energy.accounts().collect();
    energy.sort_by_key(|(account, _)| account.tag);
    all.extend(energy.iter().map(|(_, value_j)| value_j));
    all
}

#[cfg(feature = "rerun")]
#[test]
fn rerun_verifies_the_view() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.rrd");
    record(&[&path], 3e-3);
    let Some(program) = readers::rerun() else { return };
    let out = Command::new(&program).args(["rrd", "verify"]).arg(&path).output().expect("ran before");
    println!("{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    assert!(out.status.success());
    let out = Command::new(&program).args(["rrd", "stats"]).arg(&path).output().expect("ran before");
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    println!("{said}{}", String::from_utf8_lossy(&out.stderr));
    assert!(out.status.success() && said.contains("chunk"), "{said}");
}

/// A drive with sensors is recorded. Its frames, read as a measured file, are columns by the sensors' paths, as
/// displayed; tables of the same recording as CSV and Parquet contain the same numbers.
#[test]
fn recordings_and_tables_are_measured_files() {
    use pitchline::measurement::columns::{ColumnSelection, Columns, FileLayout, Memory, read};
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let text = format!(
        "{}\n[sensors.tachometer.driven]\ngain = 2.0\n[sensors.torque.driver]\n[effects.offset.driver]\noffset = 0.5\n",
        pitchline::drive::BUNDLED[0].1
    );
    std::fs::write(at("drive.toml"), text).expect("written");
    let pitchline = |args: &[&str]| {
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_pitchline"))
            .current_dir(folder.path())
            .args(args)
            .output()
            .expect("starts");
        assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    };
    pitchline(&["run", "drive.toml", "--duration", "4ms", "--every", "50us", "-o", "a.mcap"]);
    for format in ["csv", "parquet"] {
        pitchline(&["export", "a.mcap", "-o", &format!("rotors.{format}"), "--tables", "rotors"]);
    }
    let memory = || Memory::for_program(1_000_000_000);
    let columns = |name: &str| {
        read(&at(name), FileLayout::default(), ColumnSelection::All, &mut memory()).unwrap_or_else(|e| panic!("{e}"))
    };
    let column =
        |c: &Columns, name: &str| c.values[c.find(name).unwrap_or_else(|| panic!("{name} in {:?}", c.names))].clone();
    let whole = columns("a.mcap");
    assert!(whole.rows() > 80, "{} frames", whole.rows());
    let speed = column(&whole, "rotors.driven.speed_rad_s");
    let shown: Vec<f64> = speed.iter().map(|v| 2.0 * v).collect();
    assert_eq!(column(&whole, "sensors.tachometer.driven"), shown, "with its gain");
    let torque = column(&whole, "rotors.driver.outer_torque_nm");
    // Frames show forces at the instant, the step uses means over two steps: they differ strongly only at a frame next
    // to a first contact.
    let read_by_sensor = column(&whole, "sensors.torque.driver");
    let mut apart: Vec<f64> = read_by_sensor.iter().zip(&torque).map(|(a, b)| (a - b - 0.5).abs()).collect();
    apart.sort_by(f64::total_cmp);
    let (most, largest) = (apart[apart.len() * 9 / 10], apart[apart.len() - 1]);
    // measured: 0.01 and 2.2 N m
    assert!(most < 0.1 && largest < 5.0, "with its offset: {most}, {largest}");
    // Tables of sensors contain true values, before gain and errors.
    pitchline(&["export", "a.mcap", "-o", "sensors.parquet", "--tables", "sensors"]);
    let readings = column(&columns("sensors.parquet"), "reading");
    let driven: Vec<f64> = readings.chunks(2).map(|of| of[0]).collect();
    assert_eq!(driven, speed);
    // One row for every sprocket and frame.
    let (csv, parquet) = (columns("rotors.csv"), columns("rotors.parquet"));
    for name in ["t_s", "speed_rad_s", "chain_torque_nm"] {
        assert_eq!(column(&csv, name), column(&parquet, name), "{name}");
    }
    let driven: Vec<f64> = column(&parquet, "speed_rad_s").chunks(2).map(|of| of[1]).collect();
    assert_eq!(driven, speed);
}

/// Written by the Python package asammdf 8.8 (MDF 4.10, transposed and deflated): 40 samples of `speed` [rpm], `torque`
/// [N m], `raw` [V] (16 bits, 0.01 x - 5, sample 3 invalid), and a second group with 8 samples of `pressure` [bar].
const BENCH: &[u8] = include_bytes!("data/bench.mf4");

#[test]
fn asam_mdf_is_a_measured_file_and_damage_is_an_error() {
    use pitchline::measurement::columns::{ColumnSelection, Columns, Memory};
    let parse_mdf = |bytes: Vec<u8>, group: Option<usize>| -> Result<Columns, String> {
        let file = falcon_mdf::Mf4File::from_bytes(bytes).map_err(|e| e.to_string())?;
        let mut memory = Memory::for_program(1_000_000_000);
        pitchline::measurement::columns::parse_mdf(&file, group, ColumnSelection::All, &mut memory)
            .map_err(|e| e.to_string())
    };
    let error = parse_mdf(BENCH.to_vec(), None).expect_err("two groups");
    assert!(error.contains("2 groups") && error.contains("group = 0") && error.contains("pressure"), "{error}");
    let error = parse_mdf(BENCH.to_vec(), Some(2)).expect_err("no such group");
    assert!(error.contains("no group 2"), "{error}");
    let c = parse_mdf(BENCH.to_vec(), Some(0)).expect("readable");
    let column = |name: &str| {
        let i = c.find(name).unwrap_or_else(|| panic!("{name} in {:?}", c.names));
        (c.values[i].clone(), c.units[i].clone())
    };
    assert_eq!(column("speed"), ((0..40).map(|i| 1000.0 + 0.5 * f64::from(i)).collect(), Some("rpm".into())));
    assert_eq!(column("torque").0, (0..40).map(|i| f64::from(i % 7)).collect::<Vec<_>>());
    for (i, raw) in column("raw").0.iter().enumerate() {
        assert!(if i == 3 { raw.is_nan() } else { (raw - (0.01 * i as f64 - 5.0)).abs() < 1e-12 }, "{i}: {raw}");
    }
    for (i, t) in column("time").0.iter().enumerate() {
        assert!((t - 1e-3 * i as f64).abs() < 1e-15, "{t}");
    }
    assert_eq!(parse_mdf(BENCH.to_vec(), Some(1)).expect("readable").rows(), 8);
    // Truncated anywhere, and with bytes changed anywhere: columns or an error.
    let mut errors = 0;
    for cut in 0..BENCH.len() {
        errors += u32::from(parse_mdf(BENCH[..cut].to_vec(), Some(0)).is_err());
        let mut flipped = BENCH.to_vec();
        flipped[cut] ^= 1 << (cut % 8);
        flipped[(cut * 7 + 64) % BENCH.len()] = 0xff;
        let _ = parse_mdf(flipped, Some(0));
    }
    assert!(errors as usize > BENCH.len() / 2, "{errors} of {} cuts are errors", BENCH.len());
}

/// Largest remainder on any link of a frame, relative to the largest force, and to the largest moment.
fn imbalance(header: &Header, f: &Frame) -> [f64; 2] {
    let (l, n) = (&f.links, f.links.x_m.len());
    let mut left: Vec<[f64; 3]> = (0..n)
        .map(|i| {
            let LinkInfo { mass_kg, inertia_kg_m2, .. } = header.links[i];
            [-mass_kg * l.ax_m_s2[i], -mass_kg * l.ay_m_s2[i], -inertia_kg_m2 * l.alpha_rad_s2[i]]
        })
        .collect();
    let mut largest = [0.0_f64; 2];
    let mut push = |link: usize, (x, y): (f64, f64), (fx, fy): (f64, f64), torque: f64| {
        let moment = (x - l.x_m[link]) * fy - (y - l.y_m[link]) * fx + torque;
        for (sum, value) in left[link].iter_mut().zip([fx, fy, moment]) {
            *sum += value;
        }
        largest = [largest[0].max(fx.hypot(fy)), largest[1].max(moment.abs())];
    };
    for j in 0..n {
        let force = (f.joints.force_x_n[j], f.joints.force_y_n[j]);
        for (link, side, sign) in [(j, 0.5, -1.0), (header.links[j].ahead as usize, -0.5, 1.0)] {
            let (arm, angle) = (side * header.links[link].pitch_m, l.angle_rad[link]);
            let at = (l.x_m[link] + arm * angle.cos(), l.y_m[link] + arm * angle.sin());
            push(link, at, (sign * force.0, sign * force.1), sign * f.joints.friction_torque_nm[j]);
        }
    }
    // Rollers push their links at the joints that they sit on.
    let r = &f.rollers;
    for (i, info) in header.rollers.iter().enumerate() {
        let (link, side) = (info.link as usize, if info.link == info.joint { 0.5 } else { -0.5 });
        let (arm, angle) = (side * header.links[link].pitch_m, l.angle_rad[link]);
        let at = (l.x_m[link] + arm * angle.cos(), l.y_m[link] + arm * angle.sin());
        push(link, at, (-r.force_x_n[i], -r.force_y_n[i]), r.bush_moment_nm[i]);
    }
    let c = &f.contacts;
    for i in (0..c.link.len()).filter(|i| !Feature::is_roller(c.feature[*i])) {
        let (nx, ny, normal, friction) = (c.normal_x[i], c.normal_y[i], c.normal_force_n[i], c.tangential_force_n[i]);
        let force = (normal * nx - friction * ny, normal * ny + friction * nx);
        push(c.link[i] as usize, (c.point_link_x_m[i], c.point_link_y_m[i]), force, 0.0);
    }
    // Torques of the chain on sprockets and arms.
    for (k, torque_nm) in f.rotors.chain_torque_nm.iter().enumerate() {
        let carried = |i: &usize| header.bodies[c.body[*i] as usize].coordinate == Some(k as u32);
        let own = (0..c.link.len()).filter(carried).map(|i| {
            let (nx, ny, normal, friction) =
                (c.normal_x[i], c.normal_y[i], c.normal_force_n[i], c.tangential_force_n[i]);
            // Where its bearing has shifted it to.
            let (origin, _) = header.bodies[c.body[i] as usize].pose(f);
            let (x, y) = (c.point_link_x_m[i] - origin[0], c.point_link_y_m[i] - origin[1]);
            y * (normal * nx - friction * ny) - x * (normal * ny + friction * nx)
        });
        let off_nm = (own.sum::<f64>() - torque_nm).abs();
        assert!(off_nm < 1e-9 * torque_nm.abs().max(1.0), "{}: {off_nm:e} N m", header.coordinates[k]);
    }
    let most = |of: &dyn Fn(&[f64; 3]) -> f64| left.iter().map(of).fold(0.0, f64::max);
    [most(&|f| f[0].hypot(f[1])) / largest[0], most(&|f| f[2].abs()) / largest[1]]
}

/// Other contact laws, unequal links, joints with clearance or friction, separate guides, sensors: every source of
/// force is in the columns of a frame. measured: 8e-11 of the largest force, 2e-10 of the largest moment: accelerations are stored
/// with 32 bits.
#[test]
fn forces_of_a_frame_add_up_to_the_accelerations() {
    let hertz = "[contact.sprocket.hertz_line]\nbody_youngs_modulus_gpa = 206\nchain_youngs_modulus_gpa = 206\nlength_mm = 5\n\
                 damping_n_s_per_m = 200\n\n";
    let [bush, silent, smart, arm, reduction, tensioner, engines @ ..] = BUNDLED.map(|(_, text)| text.to_string());
    let (head, rest) = bush.split_once("[contact.sprocket.hunt_crossley]").expect("there");
    let with_hertz = format!("{head}{hertz}{}", &rest[rest.find("[contact.guide]").expect("there")..]);
    let sensors = "\n[sensors.torque.driver]\n[sensors.tachometer.driven]\n";
    let odd = [
        "effects.pitch_error.long.link=7",
        "effects.pitch_error.long.length_um=20",
        "chain.joint.clearance_um=2",
        "effects.tight_joint.a.joint=5",
        "effects.tight_joint.a.torque_nm=0.02",
        "effects.guide_friction.slack.friction=0.3",
        "effects.gap_error.driver.gap=5",
        "effects.gap_error.driver.outward_um=30",
    ];
    let cranked = ["chain.bush.bushes=every_link"];
    let engines = engines.into_iter().map(|text| (text, &[][..]));
    let others = [
        (bush.clone() + sensors, &[][..]),
        (bush.clone(), &odd[..]),
        (bush, &cranked[..]),
        (with_hertz, &[]),
        (silent, &[]),
        (smart.clone() + sensors, &[]),
        (smart, &odd[3..6]),
        (arm, &odd[..5]),
        (reduction, &[]),
        (tensioner, &[]),
        (common::two_stages("silent-20-40", "silent-20-40"), &[]),
        (common::two_stages("silent-20-40", "bush-20-40"), &[]),
        (common::two_stages("bush-20-40", "smartchain-20-40"), &[]),
        (common::abutments_on_a_rail(), &[]),
    ];
    for (text, sets) in others.into_iter().chain(engines) {
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
        let drive = Drive::parse("a.toml", &text, &sets).unwrap_or_else(|e| panic!("{e}"));
        let Assembly { model, mut state, report } = assembled(&drive);
        let header = capture::header(&drive, &model, &report, 1);
        let (mut camera, mut scratch) = (Camera::default(), Scratch::new(&model));
        let (mut worst, mut contacts, mut ahead) = ([0.0_f64; 2], 0, 0);
        for step in 0..2000 {
            explicit::evaluate(&model, &state, &mut scratch).expect("holds");
            if step % 7 == 0 {
                let frame = camera.take(&model, &state, &scratch);
                let left = imbalance(&header, &frame);
                worst = [worst[0].max(left[0]), worst[1].max(left[1])];
                contacts += frame.contacts.link.len();
                ahead += frame.contacts.penetration_m.iter().filter(|d| **d <= 0.0).count();
                // In the order of their kinds.
                if let [speed, torque] = frame.sensors[..] {
                    assert_eq!(torque, frame.rotors.outer_torque_nm[0], "the sensor is the rotor's torque");
                    assert_eq!(speed, frame.rotors.speed_rad_s[1]);
                }
            }
            explicit::advance(&model, &mut state, &mut scratch);
        }
        println!(
            "{sets:?}: {:.1e} of forces, {:.1e} of moments; {contacts} contacts, {ahead} apart",
            worst[0], worst[1]
        );
        assert!(worst[0] < 1e-9 && worst[1] < 1e-9, "{worst:?}");
        assert!(contacts > 1000);
    }
}
