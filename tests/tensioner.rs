//! The hydraulic tensioner of a bundled drive: rest, ledger, oil, pumping of the check valve, going on from a keyframe.

use pitchline::assemble::{Assembly, assemble, at_rest};
use pitchline::drive::Drive;
use pitchline::elements::touch::TouchShape;
use pitchline::geometry::cross;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::recording::capture::Camera;
use pitchline::statics::rail_touches;

fn drive(sets: &[&str]) -> Drive {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    Drive::parse("tensioner.toml", text, &sets).unwrap_or_else(|e| panic!("{e}"))
}

/// At rest the tip carries the moment of the chain on the arm, and spring and oil carry the tip along the slider.
#[test]
fn chain_tip_spring_and_oil_balance_at_rest() {
    for sets in [&[][..], &["chambers.high.pressure_bar=8"], &["sliders.plunger.direction_deg=95"]] {
        let (model, rest) = at_rest(&drive(sets)).unwrap_or_else(|e| panic!("{e}"));
        let q = &rest.configuration;
        let (rail, arm) = (&model.rails[0], &model.arms[0]);
        let chain: f64 = rail_touches(&model, q, rail)
            .iter()
            .map(|(_, _, t)| {
                let radii =
                    pitchline::elements::contact_law::PairRadii { bush_m: t.link_radius_m, body_m: t.body_radius_m };
                -cross(t.point, t.normal * rail.body.law.elastic(t.penetration_m, radii).force_n)
            })
            .sum();
        let tip = model.touches.iter().find(|t| matches!(t.shape, TouchShape::Tip { .. })).expect("a tip");
        let gap = tip.shape.gap(&q.coordinates);
        let force = tip.law.elastic(-gap.gap_m, tip.radii).force_n;
        // On the arm against the normal, in the point of contact.
        let moment = cross(gap.point - arm.pivot, -gap.normal * force);
        let slider = &model.coordinates[model.sliders[0].coordinate];
        let place = q.coordinates[model.sliders[0].coordinate];
        let bar = if sets.iter().any(|s| s.contains("pressure_bar=8")) { 8.0 } else { 3.0 };
        let area = 0.25 * std::f64::consts::PI * 11e-3_f64.powi(2) + 0.5 * std::f64::consts::PI * 11e-3 * 30e-6;
        let pushed = slider.spring.force(place) + bar * 1e5 * area;
        let along = force * gap.slope[0].abs();
        println!("{sets:?}: chain {chain:.6}, tip {moment:.6} N m; spring and oil {pushed:.6}, tip {along:.6} N");
        assert!((chain + moment).abs() < 1e-6 * moment.abs(), "{chain} {moment}");
        assert!((pushed - along).abs() < 1e-6 * along);
    }
}

/// What is seen of a run, at its nodes.
#[derive(Default)]
struct Seen {
    steps: u32,
    energy_error: f64,
    least_bar: f64,
    most_bar: f64,
    balance_nm: f64,
    open: u32,
}

fn run(assembly: &mut Assembly, time_s: f64) -> Seen {
    let (model, state) = (&assembly.model, &mut assembly.state);
    let (mut scratch, mut camera) = (Scratch::new(model), Camera::default());
    let mut seen = Seen { least_bar: f64::INFINITY, ..Seen::default() };
    let arm = model.arms[0].coordinate;
    let ball = model.coordinates.len() - 1;
    let until = state.step + (time_s / model.step_s) as u64;
    while state.step < until {
        explicit::evaluate(model, state, &mut scratch).unwrap_or_else(|e| panic!("{e}"));
        if state.step.is_multiple_of(50) || state.step + 1 == until {
            let frame = camera.take(model, state, &scratch);
            seen.energy_error = frame.energy.error_j / frame.energy.work_in_j.max(1e-9);
            let force = frame.rotors.chain_torque_nm[arm] + frame.rotors.outer_torque_nm[arm];
            let inertia = 1.0 / model.coordinates[arm].inverse_inertia();
            seen.balance_nm = seen.balance_nm.max((force - inertia * scratch.coordinate_alpha()[arm]).abs());
        }
        let bar = state.oil.pressure_pa[0] / 1e5;
        (seen.least_bar, seen.most_bar) = (seen.least_bar.min(bar), seen.most_bar.max(bar));
        seen.open += u32::from(state.coordinates.angle[ball] > 1e-6);
        seen.steps += 1;
        explicit::advance(model, state, &mut scratch);
    }
    seen
}

/// With an eccentric sprocket the plunger works: the check valve fills the chamber, the gap empties it, no oil is lost, the ledger holds, and the
/// forces on the arm are its inertia times its acceleration.
#[test]
fn a_working_tensioner_keeps_its_oil_and_its_books() {
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    let text = format!("{text}\n[effects.sprocket_runout.driver]\namplitude_um = 150\n");
    let drive = Drive::parse("t.toml", &text, &[]).unwrap_or_else(|e| panic!("{e}"));
    let mut assembly = assemble(&drive).unwrap_or_else(|e| panic!("{e}"));
    let before: f64 = assembly.state.oil.oil_m3.iter().chain(&assembly.state.oil.inflow_m3).sum();
    let seen = run(&mut assembly, 0.2);
    let oil = &assembly.state.oil;
    let after: f64 = oil.oil_m3.iter().chain(&oil.inflow_m3).sum();
    // The first reservoir is the gallery, which gives; the second the sump, which takes.
    let (fed, leaked) = (-oil.inflow_m3[0], oil.inflow_m3[1]);
    println!(
        "{:.2} to {:.2} bar, ball open in {} of {} steps; fed {:.3e}, leaked {:.3e} m3; oil error {:.1e}; energy {:.1e}; arm {:.1e} N m",
        seen.least_bar,
        seen.most_bar,
        seen.open,
        seen.steps,
        fed,
        leaked,
        after / before - 1.0,
        seen.energy_error,
        seen.balance_nm
    );
    // measured: 1.4e-14, -3.7e-5, 9e-16 N m; 2.75 to 12.3 bar.
    assert!((after / before - 1.0).abs() < 1e-12);
    assert!(seen.energy_error.abs() < 1e-4);
    assert!(seen.balance_nm < 1e-12);
    assert!(seen.open > 0 && seen.open < seen.steps && fed > 0.0 && leaked > 0.0);
    assert!(seen.most_bar > 4.0 && seen.least_bar < 3.0);
}

/// A keyframe holds oil and touches: what goes on from it has the bits of the run.
#[test]
fn a_run_goes_on_from_a_keyframe_to_the_bit() {
    let mut assembly = assemble(&drive(&[])).unwrap_or_else(|e| panic!("{e}"));
    run(&mut assembly, 2e-3);
    let keyframe = assembly.state.keyframe();
    let mut again = Assembly {
        model: assembly.model.clone(),
        state: pitchline::state::State::at_rest(&assembly.model.layout()),
        report: assembly.report.clone(),
    };
    again.state.restore(&keyframe).unwrap_or_else(|e| panic!("{e}"));
    run(&mut assembly, 2e-3);
    run(&mut again, 2e-3);
    assert_eq!(assembly.state.hash(), again.state.hash());
    assert!(keyframe.columns.iter().any(|c| c.name == "oil.pressure"));
}

#[test]
fn tensioners_that_make_no_sense_are_refused_where_they_stand() {
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    for (from, to, says) in [
        ("presses = \"tensioner\"", "presses = \"nobody\"", "no arm is called `nobody`"),
        ("[\"gallery\", \"high\"]", "[\"gallery\", \"low\"]", "does not say between what it lies"),
        ("ball_mm = 4 ", "ball_mm = 2 ", "falls through its seat"),
        ("high_mm = 10", "high_mm = -5", "no way between its stops"),
        ("bore_mm = 11 ", "#", "has a slider and no bore"),
        ("pressure_bar = 3                # assumed", "pressure_bar = -1", "is outside"),
        ("tip = \"plunger\"", "tip = \"piston\"", "no slider is called `piston`"),
        ("volume_mm3 = 2000 ", "volume_mm3 = 200 ", "leaves no room in chamber `high`"),
        ("gap_um = 30 ", "gap_um = 1200 ", "too wide"),
        ("[reservoirs.sump]", "[reservoirs.high]", "a chamber and a reservoir are called `high`"),
        ("[contact.tip.linear]", "[contact.tip.soft]", "contact laws"),
    ] {
        assert!(text.contains(from), "{from}");
        let report = match Drive::parse("tensioner.toml", &text.replacen(from, to, 1), &[]) {
            Err(report) => report.to_string(),
            Ok(_) => "no error".to_string(),
        };
        assert!(report.contains(says) && report.contains("-->"), "{from}: {report}");
    }
}
