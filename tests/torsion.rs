//! Elastic shafts. Sources of truth: a chain of many discs and springs, the twist of a shaft by the torques of its cams, the energy ledger, another scheme.

mod common;

use common::{assembled, watch};
use pitchline::assemble::at_rest;
use pitchline::drive::{BUNDLED, Drive};
use pitchline::elements::coordinate::CoordinateMotion;
use pitchline::elements::torsion::UniformShaft;
use pitchline::integrate::explicit::Scratch;
use pitchline::integrate::scheme;
use pitchline::model::Model;
use pitchline::pairs::part_part::CamTouch;
use pitchline::recording::capture::Camera;
use pitchline::sensing;
use pitchline::statics::{Plungers, modes};
use std::f64::consts::PI;

/// A camshaft on the driven sprocket of the bush drive, with three cams along it.
const CAMSHAFT: &str = r#"
[elastic_shafts.rod]
body = "driven"
length_mm = 410
diameter_mm = 22
bore_mm = 8
modes = 4
added_inertia_kg_m2 = 2e-4

[sensors.twist.rod]

[valves.intake]
body = "rod"
along_mm = [80, 220, 400]
phases_deg = [55, 175, 295]
base_radius_mm = 18
mass_g = 180
spring_n_per_mm = 40
spring_n = 280

[valves.intake.lift.polynomial]
lift_mm = 8
half_angle_deg = 66
powers = [2, 6, 10]

[contact.cam]
friction = 0.08
stick_speed_m_s = 0.05

[contact.cam.linear]
stiffness_n_per_m = 4e7
damping_n_s_per_m = 500

[contact.seat]
friction = 0
stick_speed_m_s = 0.05

[contact.seat.linear]
stiffness_n_per_m = 6e7
damping_n_s_per_m = 1000
"#;

const ROD: &str = "\n[elastic_shafts.rod]\nbody = \"driven\"\nlength_mm = 410\ndiameter_mm = 22\nbore_mm = 8\nmodes = 8\n\
                   added_inertia_kg_m2 = 2e-4\n";

fn parsed(more: &str, sets: &[&str]) -> Result<Drive, String> {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    let (name, text) = BUNDLED[0];
    Drive::parse(name, &format!("{text}{more}"), &sets).map_err(|report| report.to_string())
}

fn drive(more: &str, sets: &[&str]) -> Drive {
    parsed(more, sets).unwrap_or_else(|e| panic!("{e}"))
}

fn shaft_of(drive: &Drive) -> UniformShaft {
    drive.elastic_shafts[0].shaft
}

/// Frequencies of the drive at rest below 6 kHz, its driver held [Hz].
fn frequencies(drive: &Drive) -> Vec<f64> {
    let (mut model, rest) = at_rest(drive).unwrap_or_else(|e| panic!("{e}"));
    let driver = model.sprockets[model.driver].coordinate;
    model.coordinates[driver].motion = CoordinateMotion::Prescribed { speed_rad_s: 0.0 };
    let all = modes(&model, &rest.configuration, Plungers::Oil).expect("modes");
    let mut found: Vec<f64> = all.iter().map(|m| m.frequency_hz()).filter(|f| *f < 6000.0).collect();
    found.sort_by(f64::total_cmp);
    found
}

/// The drive swings with the shaft's modes as it does with a shaft of 60 discs.
#[test]
fn modes_of_a_shaft_stand_for_many_discs() {
    let by_modes = drive(ROD, &[]);
    let shaft = shaft_of(&by_modes);
    // G I_p and J of the section, by hand.
    let polar = PI / 32.0 * (0.022_f64.powi(4) - 0.008_f64.powi(4));
    assert!((shaft.stiffness_n_m2 / (79.3e9 * polar) - 1.0).abs() < 1e-12);
    assert!((shaft.inertia_kg_m2 / (7850.0 * polar * 0.41 + 2e-4) - 1.0).abs() < 1e-12);
    let discs = 60;
    let (k, j) = (shaft.stiffness_n_m2 / (shaft.length_m / f64::from(discs)), shaft.inertia_kg_m2 / f64::from(discs));
    let mut text = String::new();
    for i in 1..=discs {
        // Discs stand at the ends of the springs; half of one stays on the sprocket.
        let own = if i == discs { 0.5 * j } else { j };
        let from = if i == 1 { "driven".to_string() } else { format!("d{}", i - 1) };
        text += &format!("\n[shafts.d{i}]\ninertia_kg_m2 = {own:e}\n");
        text += &format!("\n[couplings.c{i}]\nbetween = [\"{from}\", \"d{i}\"]\nstiffness_nm_per_rad = {k}\n");
    }
    let wheel = by_modes.text.lines().find(|l| l.starts_with("inertia_kg_m2")).expect("the driven sprocket's");
    let wheel: f64 = wheel.split(['=', '#']).nth(1).expect("a value").trim().parse().expect("a number");
    let by_discs = drive(&text, &[&format!("sprockets.driven.inertia_kg_m2={:e}", wheel + 0.5 * j)]);
    let (own, known) = (frequencies(&by_modes), frequencies(&by_discs));
    assert_eq!(own.len(), known.len());
    let none = frequencies(&drive("", &[]));
    let worst = own.iter().zip(&known).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
    println!("{} modes below 6 kHz ({} without the shaft), off by {worst:.1e} at most", own.len(), none.len());
    assert!(own.len() == none.len() + 3 && worst < 1e-3, "{worst}");
}

fn cams(model: &Model) -> Vec<CamTouch> {
    model.cams().cloned().collect()
}

/// Turned slowly, the free end is twisted by the torque F ds/da of every cam times the compliance of the shaft from its root to the cam.
#[test]
fn cams_twist_their_shaft_by_its_compliance() {
    let drive = drive(
        CAMSHAFT,
        &["speeds.constant.driver.speed_rpm=200", "contact.cam.friction=0", "elastic_shafts.rod.modes=8"],
    );
    let a = assembled(&drive);
    let (model, own, shaft) = (&a.model, cams(&a.model), shaft_of(&drive));
    let sensor = drive.sensors.iter().find(|s| s.name == "rod").expect("there").reads;
    let (mut state, mut worst, mut largest) = (a.state.clone(), 0.0_f64, 0.0_f64);
    watch(model, &mut state, 60_000, |state, scratch| {
        if !state.step.is_multiple_of(50) {
            return;
        }
        let q = &state.coordinates;
        let twist = sensing::read(model, state, scratch, sensor);
        let mut known = 0.0;
        for (cam, along_m) in own.iter().zip([0.08, 0.22, 0.40]) {
            let s = cam.lift(cam.turn(&q.angle));
            if s.lift_m > 0.0 {
                let torque = -(280.0 + 4e4 * s.lift_m) * s.slope_m * cam.sense;
                known += torque * along_m / shaft.stiffness_n_m2;
            }
        }
        worst = worst.max((twist - known).abs());
        largest = largest.max(known.abs());
    });
    println!("twist up to {:.3} mrad, off by {:.4} mrad at most", largest * 1e3, worst * 1e3);
    // The cam next to the end is missing 0.2/8 of its twist; followers swing on their contacts.
    assert!(largest > 5e-4 && worst < 0.05 * largest);
}

/// The joules add up, in the scheme of the program and in another, which twists the shaft as far; and the same bits come again.
#[test]
fn the_ledger_closes_and_schemes_agree() {
    // A second shaft, on the driver, whose speed is given.
    let more = format!("{CAMSHAFT}\n[elastic_shafts.other]\nbody = \"driver\"\nlength_mm = 200\ndiameter_mm = 15\n");
    let run = |sets: &[&str]| {
        let set: Vec<&str> = [&["speeds.constant.driver.speed_rpm=4000"], sets].concat();
        let drive = drive(&more, &set);
        let a = assembled(&drive);
        let sensor = drive.sensors.iter().find(|s| s.name == "rod").expect("there").reads;
        let (mut state, mut camera, mut scratch) = (a.state.clone(), Camera::default(), Scratch::new(&a.model));
        let (mut first, mut last, mut put_in, mut squares, mut count) = (None, 0.0, 0.0, 0.0, 0.0);
        let steps = (0.03 / a.model.step_s) as u64;
        for step in 0..steps {
            scheme::evaluate(&a.model, &state, &mut scratch).expect("the run holds");
            squares += sensing::read(&a.model, &state, &scratch, sensor).powi(2);
            count += 1.0;
            if step % (steps / 20) == 0 {
                let frame = camera.take(&a.model, &state, &scratch);
                (last, put_in) = (frame.energy.error_j, frame.energy.put_in_j());
                first.get_or_insert(last);
                camera.give_back(frame);
            }
            scheme::advance(&a.model, &mut state, &mut scratch);
        }
        let error: f64 = (last - first.expect("frames")) / put_in;
        println!(
            "{sets:?}: energy error {error:.1e} of {put_in:.1} J, twist {:.4} mrad rms",
            1e3 * libm::sqrt(squares / count)
        );
        assert!(error.abs() < 1e-4, "{error}");
        (libm::sqrt(squares / count), state.hash())
    };
    let (twist, hash) = run(&[]);
    assert_eq!(run(&[]).1, hash);
    // The other way round.
    run(&["speeds.constant.driver.speed_rpm=-4000"]);
    let (other, _) = run(&["run.scheme=\"predictor_corrector\""]);
    assert!((other / twist - 1.0).abs() < 0.02, "{other} {twist}");
}

/// Lifters stand on cams of an elastic shaft as on those of a rigid one, also where its sprocket gives way: the joules add up, and a stiff shaft lifts as a rigid one does.
#[test]
fn lifters_stand_on_an_elastic_shaft_whose_sprocket_gives_way() {
    let lifter = "[valves.intake.lifter]\nmass_g = 60\nbore_mm = 11\nvolume_mm3 = 300\nspring_n = 15\nspring_n_per_mm = 1\nin_mm = 1.2\nout_mm = 0.8\n\
                  supply = \"gallery\"\ndrain = \"sump\"\n[valves.intake.lifter.leak]\ngap_um = 6\nlength_mm = 8\n\
                  [valves.intake.lifter.ball]\nseat_mm = 2.5\nball_mm = 4\nlift_mm = 0.3\nspring_n = 0.5\n\
                  [oil]\ndensity_kg_per_m3 = 850\nviscosity_mpa_s = 10\nbulk_modulus_gpa = 1.4\n\
                  [reservoirs.gallery]\npressure_bar = 3\n[reservoirs.sump]\npressure_bar = 0\n";
    let bearing = "[bearings.elastic.driven]\nmass_kg = 1\nstiffness_n_per_m = 3e7\ndamping_n_s_per_m = 300\n";
    let elastic = format!("{CAMSHAFT}{lifter}{bearing}");
    let rigid =
        format!("{CAMSHAFT}{lifter}").replace("body = \"rod\"\nalong_mm = [80, 220, 400]\n", "body = \"driven\"\n");
    let run = |more: &str, sets: &[&str]| {
        let drive = drive(more, sets);
        let a = assembled(&drive);
        let valve = a.model.coordinates.iter().position(|c| c.path == "valves.intake.3").expect("a valve");
        let (mut state, mut camera, mut scratch) = (a.state.clone(), Camera::default(), Scratch::new(&a.model));
        let (mut first, mut last, mut put_in, mut most) = (None, 0.0, 0.0, 0.0_f64);
        let steps = (0.04 / a.model.step_s) as u64;
        for step in 0..=steps {
            scheme::evaluate(&a.model, &state, &mut scratch).expect("the run holds");
            most = most.max(state.coordinates.angle[valve]);
            if step % (steps / 4) == 0 {
                let frame = camera.take(&a.model, &state, &scratch);
                (last, put_in) = (frame.energy.error_j, frame.energy.put_in_j());
                first.get_or_insert(last);
                camera.give_back(frame);
            }
            scheme::advance(&a.model, &mut state, &mut scratch);
        }
        let error: f64 = (last - first.expect("frames")) / put_in;
        println!("energy error {error:.1e} of {put_in:.1} J, lift {:.4} mm", 1e3 * most);
        assert!(error.abs() < 1e-4, "{error}");
        most
    };
    run(&elastic, &[]);
    let stiff = run(
        &elastic,
        &[
            "elastic_shafts.rod.diameter_mm=60",
            "elastic_shafts.rod.modes=1",
            "elastic_shafts.rod.added_inertia_kg_m2=0",
        ],
    );
    let rigid = run(&rigid, &["sprockets.driven.inertia_kg_m2=5e-3"]);
    assert!(stiff > 6e-3 && (stiff / rigid - 1.0).abs() < 0.01, "{stiff} {rigid}");
}

/// What the shaft holds in a resting drive turns with its sprocket; cams at the root are those of a rigid shaft.
#[test]
fn cams_at_the_root_turn_with_the_sprocket() {
    let at_root = drive(CAMSHAFT, &["valves.intake.along_mm=[0, 0, 0]"]);
    let a = assembled(&at_root);
    for cam in a.model.cams() {
        assert_eq!(cam.turn(&a.state.coordinates.angle), a.state.coordinates.angle[cam.shaft]);
    }
    // Before it is twisted, a shaft turns as fast as its sprocket.
    let a = assembled(&drive(CAMSHAFT, &[]));
    for cam in a.model.cams() {
        let (own, sprocket) = (cam.turn(&a.state.coordinates.omega), a.state.coordinates.omega[cam.shaft]);
        assert!((own / sprocket - 1.0).abs() < 0.05, "{own} {sprocket}");
    }
}

#[test]
fn what_cannot_be_is_refused_at_its_place() {
    for (sets, words) in [
        (vec!["elastic_shafts.rod.bore_mm=22"], "the bore is as wide as the shaft"),
        (vec!["elastic_shafts.rod.body=\"drivn\""], "nothing that moves is called `drivn`"),
        (vec!["valves.intake.along_mm=[80, 220]"], "2 places along `rod` for 3 cams"),
        (vec!["valves.intake.along_mm=[80, 220, 411]"], "beyond the shaft's end at 410.0 mm"),
        (vec!["valves.intake.body=\"driven\""], "turn with their sprocket as one"),
        (vec!["elastic_shafts.rod.modes=9"], "modes"),
        (vec!["sensors.twist.rod.shaft=\"stick\""], "stick"),
        (vec!["valves.intake.along_mm=[80, 220, -1]"], "along_mm"),
    ] {
        let report = parsed(CAMSHAFT, &sets).map(|d| d.name).expect_err("accepted");
        assert!(report.contains(words), "{sets:?}: {report}");
    }
    let without = CAMSHAFT.replacen("body = \"driven\"\n", "", 1);
    assert!(parsed(&without, &[]).map(|d| d.name).expect_err("accepted").contains("nothing turns `rod`"));
    let taken =
        CAMSHAFT.replace("elastic_shafts.rod", "elastic_shafts.driven").replace("body = \"rod\"", "body = \"driven\"");
    let taken = taken.replace("[sensors.twist.rod]", "");
    assert!(parsed(&taken, &[]).map(|d| d.name).expect_err("accepted").contains("something else that moves is called"));
}
