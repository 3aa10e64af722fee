//! Chains of any type among several: each has the bits that it has alone where nothing couples them; stages of two types turn at the product
//! of their ratios and keep their ledger; what the machine that runs them remembers changes no bit.

mod common;

use common::{assembled, bundled, two_stages};
use pitchline::assemble::Assembly;
use pitchline::drive::{Drive, OuterSpec};
use pitchline::integrate::Isa;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::Model;
use pitchline::pairs::contour_body::EndShape;
use pitchline::recording::capture::Camera;
use pitchline::recording::frame::Feature;
use pitchline::state::{RestoreError, State};
use std::ops::Range;

fn parsed(text: &str, sets: &[&str]) -> Drive {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    Drive::parse("several.toml", text, &sets).unwrap_or_else(|e| panic!("{e}"))
}

/// Columns of a State by name, with the lanes of one chain and its coordinates.
fn columns(state: &State, lanes: &Range<usize>, coordinates: &Range<usize>) -> Vec<(String, Vec<f64>)> {
    let mut all = Vec::new();
    state.for_each_column(|name, values| {
        let own = if name.set == "coordinates" { coordinates } else { lanes };
        all.push((name.to_string(), values.get(own.clone()).unwrap_or_default().to_vec()));
    });
    all
}

/// The State of drives side by side, out of their own.
fn side_by_side(model: &Model, parts: &[Assembly]) -> State {
    let mut state = State::at_rest(&model.layout());
    let mut joined = state.keyframe();
    for (k, part) in parts.iter().enumerate() {
        let own = columns(&part.state, &(0..part.model.chain.n_links), &(0..2));
        for (to, (name, from)) in joined.columns.iter_mut().zip(own) {
            assert_eq!(to.name, name);
            let at = if name.starts_with("coordinates.") { 2 * k } else { model.chain.loops[k].start };
            if !from.is_empty() {
                to.values[at..at + from.len()].copy_from_slice(&from);
            }
        }
    }
    // The hash of the joined State is found by restoring it once with a wrong one.
    let Err(RestoreError::OtherHash { found, .. }) = state.clone().restore(&joined) else { panic!("another hash") };
    joined.state_hash = found;
    state.restore(&joined).expect("the same columns");
    state
}

/// Chains without common parts, two identical ones and all types: every column of each chain is that of its drive alone.
#[test]
fn chains_that_share_nothing_have_their_own_bits() {
    for names in [
        &["silent-20-40", "silent-20-40"][..],
        &["bush-20-40", "silent-20-40", "smartchain-20-40"],
        &["smartchain-20-40", "smartchain-20-40", "silent-20-40"],
    ] {
        let drives: Vec<Drive> = names.iter().map(|name| bundled(name, &["run.step_us=3"])).collect();
        let parts: Vec<Assembly> = drives.iter().map(assembled).collect();
        let mut all = drives[0].clone();
        all.sprockets = drives.iter().flat_map(|d| d.sprockets.clone()).collect();
        let model = Model::join(&all, parts.iter().map(|p| p.model.clone()).collect());
        let mut state = side_by_side(&model, &parts);
        let mut scratch = Scratch::new(&model);
        let mut alone: Vec<(State, Scratch)> =
            parts.iter().map(|p| (p.state.clone(), Scratch::new(&p.model))).collect();
        let mut compared = 0;
        for step in 0..4000 {
            explicit::step(&model, &mut state, &mut scratch).expect("holds");
            for (part, (own, scratch)) in parts.iter().zip(&mut alone) {
                explicit::step(&part.model, own, scratch).expect("holds");
            }
            if step % 400 != 399 {
                continue;
            }
            for (k, (own, _)) in alone.iter().enumerate() {
                let here = columns(&state, &model.chain.loops[k], &(2 * k..2 * k + 2));
                for ((name, a), (_, b)) in here.iter().zip(columns(own, &(0..parts[k].model.chain.n_links), &(0..2))) {
                    // What a chain has not, it does not get from its neighbours either.
                    let expected = if b.is_empty() { vec![0.0; a.len()] } else { b };
                    assert!(*a == expected, "{names:?}, chain {k}, step {step}: {name}");
                    compared += usize::from(a.iter().any(|v| *v != 0.0));
                }
            }
        }
        assert!(compared > 400, "{compared}");
    }
}

/// Two stages, each of a type.
const STAGES: [[&str; 2]; 5] = [
    ["silent-20-40", "silent-20-40"],
    ["silent-20-40", "bush-20-40"],
    ["bush-20-40", "silent-20-40"],
    ["smartchain-20-40", "bush-20-40"],
    ["silent-20-40", "smartchain-20-40"],
];

/// 20/40 twice: a quarter, without drift; 0.2 s with the ledger closed.
#[test]
fn stages_of_all_types_turn_at_the_product_of_their_ratios() {
    for [first, second] in STAGES {
        let Assembly { model, mut state, .. } = assembled(&parsed(&two_stages(first, second), &[]));
        let q = |k: usize| model.sprockets[k].coordinate;
        assert_eq!(q(1), q(2), "driven and pinion sit on one shaft");
        let (mut scratch, mut camera) = (Scratch::new(&model), Camera::default());
        let start = state.coordinates.angle.clone();
        // Whole turns of the output, so that the teeth are at their initial positions.
        let turn_s = 4.0 * std::f64::consts::TAU / model.sprockets[0].nominal_speed_rad_s;
        let (whole, last) = ((2.0 * turn_s / model.step_s) as u64, (0.2 / model.step_s) as u64);
        let mut energy_error = f64::NAN;
        for step in 0..=last {
            explicit::evaluate(&model, &state, &mut scratch).expect("holds");
            if step == 0 || step == last {
                let e = camera.take(&model, &state, &scratch).energy;
                energy_error = e.error_j / e.work_in_j.max(1e-9);
            }
            if step == whole {
                let turned = |k: usize| state.coordinates.angle[q(k)] - start[q(k)];
                let (middle, output) = (turned(1) - 0.5 * turned(0), turned(3) - 0.25 * turned(0));
                println!("{first}, {second}: off by {middle:.1e} and {output:.1e} rad after two turns");
                // A tooth is 0.16 rad; the rest is the oscillation of the shafts. measured at most 1.6e-5
                assert!(middle.abs() < 1e-4 && output.abs() < 1e-4, "{first}, {second}: {middle} {output}");
            }
            explicit::advance(&model, &mut state, &mut scratch);
        }
        println!("{first}, {second}: energy {energy_error:.1e} of the work put in");
        // measured at most 6.2e-5, of bushes on teeth
        assert!(energy_error.abs() < 1e-4, "{first}, {second}: {energy_error:e}");
    }
}

/// Vector units, looks for neighbours and what was faced before change no bit of chains of two types.
#[test]
fn every_vector_unit_and_every_look_interval_gives_the_same_bits() {
    let a = assembled(&parsed(&two_stages("silent-20-40", "smartchain-20-40"), &[]));
    let hash = |isa: Isa, looks: u64, kept_for: u64| {
        let (mut state, mut scratch) = (a.state.clone(), Scratch::with_isa(&a.model, isa));
        for step in 0..3000 {
            if step % kept_for == 0 {
                scratch = Scratch::with_isa(&a.model, isa);
            }
            scratch.refresh_steps = looks;
            explicit::step(&a.model, &mut state, &mut scratch).expect("the run holds");
        }
        state.hash()
    };
    let reference = hash(Isa::Baseline, 64, u64::MAX);
    for isa in Isa::available() {
        for (looks, kept_for) in [(1, u64::MAX), (7, u64::MAX), (64, u64::MAX), (64, 101)] {
            assert_eq!(
                hash(isa, looks, kept_for),
                reference,
                "{isa:?}, looking every {looks} steps, kept for {kept_for}"
            );
        }
    }
}

/// Bodies that contours touch turn with their shafts, and stand where their sprockets do.
#[test]
fn bodies_of_contours_are_those_of_their_chains() {
    let a = assembled(&parsed(&two_stages("smartchain-20-40", "silent-20-40"), &[]));
    let (model, n) = (&a.model, a.model.sprockets.len());
    let guides = model.guides.iter().filter(|g| !g.body.touches_plates).count();
    // Two rings, two faces; outer and inner flanks of two sprockets.
    assert_eq!((guides, model.end_bodies.len()), (2, 2 + 2 + 4));
    for b in &model.end_bodies {
        match model.sprockets.get(b.body) {
            Some(s) => {
                assert_eq!((b.chain, b.frame.turn, b.frame.origin), (s.chain, Some(s.coordinate), s.frame.origin));
                assert_eq!(b.name, format!("sprockets.{}", s.name));
            }
            None => {
                let g = &model.guides[b.body - n];
                assert_eq!((b.chain, b.frame.turn, b.frame.origin), (g.chain, None, g.body.origin));
            }
        }
    }
}

/// Lobes of a ring stand as the working flanks do, on the side of the load: also where the load comes from a chain behind.
#[test]
fn lobes_of_a_driver_stand_by_the_load_that_other_chains_take() {
    // The driver has the lobes: abutments are made for 20 teeth.
    let lobed =
        |model: &Model, body: usize| match &model.end_bodies.iter().find(|b| b.body == body).expect("a ring").shape {
            EndShape::Lobes { turn, .. } => *turn,
            other => panic!("{other:?}"),
        };
    let swap = ["sprockets.driver.teeth=40", "sprockets.driven.teeth=20"];
    let single = assembled(&bundled("smartchain-20-40", &swap));
    let stages = assembled(&parsed(&two_stages("smartchain-20-40", "bush-20-40"), &swap));
    let unloaded = assembled(&parsed(
        &two_stages("smartchain-20-40", "bush-20-40"),
        &[&swap[..], &["loads.constant.output.torque_nm=-20"]].concat(),
    ));
    let turns = [&single, &stages, &unloaded].map(|a| lobed(&a.model, 0));
    println!(
        "turn of the lobes: alone {:?}, before a loaded stage {:?}, before one that drives {:?}",
        turns[0], turns[1], turns[2]
    );
    // The root relief differs by 32 um, not the sign.
    assert!(turns[0].1 * turns[1].1 > 0.0 && turns[1].1 * turns[2].1 < 0.0, "{turns:?}");
    // The middle shaft takes twice the load of 20 N m at half the speed: nothing of its own.
    let drive = parsed(&two_stages("smartchain-20-40", "bush-20-40"), &[]);
    let alone = drive.single_chain(0);
    assert_eq!(alone.sprockets[1].passes_on_nm, 10.0);
    assert!(matches!(alone.sprockets[1].outer, OuterSpec::Load { torque_nm: 0.0, .. }));
}

/// Backs of abutment links run on a rail outside of the loop, their abutments on a face inside. The arm of the rail is in balance: in
/// the mean the chain holds it against its spring.
#[test]
fn backs_of_abutment_links_run_on_rails() {
    let Assembly { model, mut state, .. } = assembled(&parsed(&common::abutments_on_a_rail(), &[]));
    let (mut scratch, mut camera) = (Scratch::new(&model), Camera::default());
    let (rail, arm) = (model.first_rail() as u32, model.arms[0].coordinate);
    let steps = (50e-3 / model.step_s) as u64;
    let (mut on_rail, mut on_face) = (0, 0);
    let (mut spring_nm, mut chain_nm, mut energy_error) = (0.0, 0.0, f64::NAN);
    for step in 0..=steps {
        explicit::evaluate(&model, &state, &mut scratch).expect("holds");
        spring_nm += model.coordinates[arm].spring.force(state.coordinates.angle[arm]) / steps as f64;
        chain_nm += scratch.chain_torque()[arm] / steps as f64;
        if step % 20 == 0 || step == steps {
            let frame = camera.take(&model, &state, &scratch);
            let c = &frame.contacts;
            for i in 0..c.link.len() {
                let is_abutment =
                    [Feature::FrontAbutment, Feature::RearAbutment].iter().any(|f| *f as u32 == c.feature[i]);
                assert!(c.body[i] != rail || !is_abutment, "an abutment on a rail");
                on_rail += usize::from(c.body[i] == rail);
                // The slack face is the last guide, before the rail.
                on_face += usize::from(is_abutment && c.body[i] == rail - 1);
            }
            energy_error = frame.energy.error_j / frame.energy.work_in_j.max(1e-9);
        }
        explicit::advance(&model, &mut state, &mut scratch);
    }
    println!(
        "{on_rail} plates on the rail, {on_face} abutments on the face; spring {spring_nm:.5} N m, chain {chain_nm:.5} N m; energy \
         {energy_error:.1e}"
    );
    assert!(on_rail > 1000 && on_face > 1000);
    assert!(spring_nm > 0.05 && (spring_nm + chain_nm).abs() < 1e-3 * spring_nm, "{spring_nm} {chain_nm}");
    assert!(energy_error.abs() < 1e-4, "{energy_error:e}");
}

#[test]
fn abutments_need_a_face_where_their_backs_are_pressed() {
    let text = common::abutments_on_a_rail();
    let (head, tail) = text.split_once("[guides.fixed.slack]").expect("a guide");
    let (_, arm) = tail.split_once("[arms.press]").expect("an arm");
    let report = Drive::parse("t.toml", &format!("{head}[arms.press]{arm}"), &[]).expect_err("no face").to_string();
    assert!(report.contains("guide `back` outside") && report.contains("--> t.toml"), "{report}");
    let inside =
        Drive::parse("t.toml", &text.replace("side = \"outside\"", "side = \"inside\""), &[]).expect_err("inside");
    assert!(inside.to_string().contains("straight faces"), "{inside}");
}

#[test]
fn every_chain_has_its_own_keys_preload_and_spans() {
    let text = two_stages("silent-20-40", "bush-20-40");
    // Keys of gaps that seat bushes belong to sprockets of bush chains alone.
    let refused = |set: &str| Drive::parse("t.toml", &text, &[set.to_string()]).expect_err(set).to_string();
    assert!(refused("sprockets.driver.gap_form=max").contains("gap_form"));
    assert!(refused("sprockets.pinion.corner_radius_mm=0.4").contains("corner_radius_mm"));
    parsed(&text, &["sprockets.pinion.gap_form=min", "sprockets.driver.corner_radius_mm=0.4"]);
    // Spans are those of the chains.
    let gauges = |span: &str| format!("{text}\n[sensors.strain_gauge.gauge]\nspan = {span}\n");
    parsed(&gauges("[\"output\", \"pinion\"]"), &[]);
    let report = Drive::parse("t.toml", &gauges("[\"driven\", \"pinion\"]"), &[]).expect_err("no span").to_string();
    assert!(report.contains("[\"driven\", \"driver\"], [\"pinion\", \"output\"]"), "{report}");
    // Each chain is tightened to what it asks for.
    let a = assembled(&parsed(&text, &["chains.second.preload.tension_n=220"]));
    assert!((a.report.preload_n - 300.0).abs() < 0.1, "{}", a.report.preload_n);
    let second = &a.report.preloads[1];
    assert!(second.chain == "second" && (second.mean_n - 220.0).abs() < 0.1, "{second:?}");
    assert!(a.report.lines().iter().any(|l| l.starts_with("preload of chain second at rest = 220.0 N")));
}
