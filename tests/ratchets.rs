//! Ratchets of plungers: the pawl clicks on with the plunger, and holds it by the backlash; with every scheme, and from a keyframe.

mod common;

use pitchline::assemble::{Assembly, assemble};
use pitchline::drive::Drive;
use pitchline::integrate::explicit::Scratch;
use pitchline::integrate::scheme;
use pitchline::pairs::part_part::TouchShape;
use pitchline::recording::capture::Camera;
use pitchline::recording::columns::Rows;

/// The bundled tensioner with a ratchet of this pitch and backlash [mm].
fn with_ratchet(pitch_mm: f64, backlash_mm: f64, sets: &[&str]) -> Drive {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    Drive::parse("ratchet.toml", &text_with_ratchet(pitch_mm, backlash_mm), &sets).unwrap_or_else(|e| panic!("{e}"))
}

fn text_with_ratchet(pitch_mm: f64, backlash_mm: f64) -> String {
    include_str!("../assets/drives/tensioner-20-40.toml").replace(
        "tip_radius_mm = 8",
        &format!("ratchet_pitch_mm = {pitch_mm}\nratchet_backlash_mm = {backlash_mm}\ntip_radius_mm = 8"),
    )
}

/// Where plunger and pawl stand [m], the ratchet's force [N], the ledger's error over the work put in, and how often the pawl has moved.
struct Seen {
    plunger_m: f64,
    pawl_m: f64,
    force_n: f64,
    ledger: f64,
    clicks: u32,
}

fn run(assembly: &mut Assembly, time_s: f64) -> Seen {
    let (model, state) = (&assembly.model, &mut assembly.state);
    let (mut scratch, mut camera) = (Scratch::new(model), Camera::default());
    let ratchet = model.ratchets[0];
    let touch = model.touches.iter().position(|t| matches!(t.shape, TouchShape::Between { .. })).expect("a pawl");
    let until = state.step + (time_s / model.step_s) as u64;
    let mut seen =
        Seen { plunger_m: 0.0, pawl_m: state.coordinates.angle[ratchet.pawl], force_n: 0.0, ledger: 0.0, clicks: 0 };
    while state.step < until {
        scheme::evaluate(model, state, &mut scratch).unwrap_or_else(|e| panic!("{e}"));
        if state.step.is_multiple_of(50) || state.step + 1 == until {
            let frame = camera.take(model, state, &scratch);
            seen.ledger = frame.energy.error_j / frame.energy.work_in_j.max(1e-9);
            seen.force_n = frame.touches.normal_force_n[touch];
        }
        scheme::advance(model, state, &mut scratch);
        let q = &state.coordinates.angle;
        seen.clicks += u32::from(q[ratchet.pawl] != seen.pawl_m);
        (seen.plunger_m, seen.pawl_m) = (q[ratchet.slider], q[ratchet.pawl]);
        // Never a tooth beyond its pawl.
        assert!(q[ratchet.slider] - q[ratchet.pawl] < ratchet.pitch_m);
    }
    seen
}

/// A tensioner that loses its oil goes back until the pawl holds it, and no further; without a ratchet it goes on to its stop.
#[test]
fn a_pawl_holds_a_plunger_without_oil() {
    let empty = [
        "reservoirs.gallery.pressure_bar=0",
        "passages.leak.plunger.gap_um=200",
        "sliders.plunger.spring_n=1",
        "sliders.plunger.spring_n_per_mm=0.1",
    ];
    let mut assembly = assemble(&with_ratchet(1.0, 0.5, &empty)).unwrap_or_else(|e| panic!("{e}"));
    let at_rest = assembly.state.coordinates.angle[assembly.model.ratchets[0].slider];
    let seen = run(&mut assembly, 0.1);
    println!(
        "from {:.4} mm to {:.4} mm, pawl at {:.4} mm, {} clicks, {:.2} N; ledger {:.1e}",
        at_rest * 1e3,
        seen.plunger_m * 1e3,
        seen.pawl_m * 1e3,
        seen.clicks,
        seen.force_n,
        seen.ledger
    );
    // The pawl is a tooth: a whole number of pitches from the place where the plunger is drawn.
    assert!((seen.pawl_m / 1e-3 - (seen.pawl_m / 1e-3).round()).abs() < 1e-9);
    // It bears its share of what the chain presses with, and gives way by that over its stiffness.
    assert!(seen.force_n > 5.0, "{}", seen.force_n);
    let behind_m = seen.pawl_m - 0.5e-3 - seen.plunger_m;
    assert!((0.0..2.0 * seen.force_n / 1e7 + 1e-6).contains(&behind_m), "{behind_m:e}");
    assert!(seen.ledger.abs() < 1e-4);
    let held_m = seen.plunger_m;
    let mut without = assemble(&with_ratchet(1.0, 50.0, &empty)).unwrap_or_else(|e| panic!("{e}"));
    let seen = run(&mut without, 0.1);
    println!("without: {:.4} mm, {:.2} N", seen.plunger_m * 1e3, seen.force_n);
    assert!(seen.force_n == 0.0 && seen.plunger_m < held_m - 1e-3);
}

/// A plunger that an eccentric sprocket works takes its pawl along, tooth by tooth, and is held behind the furthest one.
#[test]
fn a_pawl_clicks_on_with_its_plunger() {
    let sets = ["passages.leak.plunger.gap_um=100", "effects.sprocket_runout.driver.amplitude_um=400"];
    let mut assembly = assemble(&with_ratchet(0.05, 0.02, &sets)).unwrap_or_else(|e| panic!("{e}"));
    let ratchet = assembly.model.ratchets[0];
    let from_m = assembly.state.coordinates.angle[ratchet.pawl];
    let seen = run(&mut assembly, 0.05);
    let teeth = (seen.pawl_m - from_m) / ratchet.pitch_m;
    println!("{} clicks, {teeth:.6} teeth; ledger {:.1e}", seen.clicks, seen.ledger);
    assert!(seen.clicks >= 3 && (teeth - teeth.round()).abs() < 1e-6 && teeth.round() >= f64::from(seen.clicks));
    println!("plunger {:.4} mm, pawl {:.4} mm, {:.1} N", seen.plunger_m * 1e3, seen.pawl_m * 1e3, seen.force_n);
    assert!(seen.plunger_m > seen.pawl_m - 0.02e-3 - 2.0 * seen.force_n / 1e7);
    assert!(seen.ledger.abs() < 1e-4);
    // The same bits from a keyframe.
    let mut again = common::from_keyframe(&assembly);
    run(&mut assembly, 2e-3);
    run(&mut again, 2e-3);
    assert_eq!(assembly.state.hash(), again.state.hash());
}

/// Every scheme that bears such a tensioner ends where the leapfrog does.
#[test]
fn all_schemes_hold_alike() {
    let sets = |scheme: &str| {
        let own = format!("run.scheme=\"{scheme}\"");
        let all = [own.as_str(), "passages.leak.plunger.gap_um=100", "effects.sprocket_runout.driver.amplitude_um=400"];
        run(&mut assemble(&with_ratchet(0.05, 0.02, &all)).unwrap_or_else(|e| panic!("{e}")), 0.01)
    };
    let known = sets("leapfrog");
    assert!(known.clicks > 0 && known.force_n > 0.0, "{} clicks, {} N", known.clicks, known.force_n);
    for scheme in ["hht", "predictor_corrector"] {
        let seen = sets(scheme);
        println!(
            "{scheme}: plunger {:.6} mm, leapfrog {:.6}; pawl {:.6} and {:.6}",
            seen.plunger_m * 1e3,
            known.plunger_m * 1e3,
            seen.pawl_m * 1e3,
            known.pawl_m * 1e3
        );
        assert!((seen.plunger_m - known.plunger_m).abs() < 2e-6 && (seen.pawl_m - known.pawl_m).abs() < 1e-9);
    }
}

/// Rows of pawls and their contacts have the names of the recording; break expressions know them; a branch with another rack is refused.
#[test]
fn pawls_have_names() {
    let drive = with_ratchet(1.0, 0.5, &[]);
    let Assembly { model, report, .. } = assemble(&drive).unwrap_or_else(|e| panic!("{e}"));
    let header = pitchline::recording::capture::header(&drive, &model, &report, 1);
    for rows in [Rows::Slider, Rows::Touch] {
        assert_eq!(header.row_paths(rows).expect("named"), drive.row_paths(rows));
    }
    assert!(drive.row_paths(Rows::Slider).contains(&"sliders.plunger_pawl".to_string()));
    // The drawn pawl stands before a drawn tooth by the gap that the contact has.
    let body =
        |path: &str| header.bodies.iter().find(|b| b.path == path).and_then(|b| b.outline.as_ref()).expect("drawn");
    let pawl = &body("housings.plunger_housing").circles[0];
    let ratchet = model.ratchets[0];
    let q = &assemble(&drive).unwrap_or_else(|e| panic!("{e}")).state.coordinates.angle;
    let gap_m = q[ratchet.slider] - q[ratchet.pawl] + ratchet.backlash_m;
    let faces = body("sliders.plunger")
        .elements
        .iter()
        .filter(|e| (e.start_x_m - e.end_x_m).abs() < 1e-12)
        .map(|e| e.start_x_m);
    let before_m: Vec<f64> = faces.map(|x| x + q[ratchet.slider] - (pawl.x_m + pawl.radius_m)).collect();
    println!("gap {gap_m:e}, faces {before_m:?}");
    assert!(before_m.len() > 10 && before_m.iter().any(|b| (b - gap_m).abs() < 1e-9));
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("r.toml"), text_with_ratchet(0.05, 0.02)).expect("a drive");
    let pitchline = |line: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_pitchline"));
        let out = command.args(line.split_whitespace()).current_dir(folder.path()).output().expect("it starts");
        (out.status.code(), format!("{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr)))
    };
    let (code, told) = pitchline("run r.toml --duration 1ms --break slider.plunger_pawl.position>1m -o a.mcap");
    assert_eq!(code, Some(0), "{told}");
    let (code, told) = pitchline("run --resume a.mcap --set sliders.plunger.ratchet_pitch_mm=0.07 -o b.mcap");
    assert!(code == Some(2) && told.contains("ratchet"), "{code:?} {told}");
}

#[test]
fn half_a_ratchet_is_refused() {
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    for (keys, says) in [
        ("ratchet_pitch_mm = 1", "go together"),
        ("ratchet_backlash_mm = 1", "go together"),
        ("ratchet_pitch_mm = 0\nratchet_backlash_mm = 1", "is outside"),
        ("ratchet_pitch_mm = 1\nratchet_backlash_mm = -1", "is outside"),
    ] {
        let text = text.replace("tip_radius_mm = 8", &format!("{keys}\ntip_radius_mm = 8"));
        let report = match Drive::parse("ratchet.toml", &text, &[]) {
            Err(report) => report.to_string(),
            Ok(_) => "no error".to_string(),
        };
        assert!(report.contains(says) && report.contains("-->"), "{keys}: {report}");
    }
}
