//! The same run gives the same bits: twice, with any sinks, on any vector unit, resumed, with any reporting interval.

mod common;

use common::{assembled, drive};
use pitchline::assemble::Assembly;
use pitchline::drive::{BUNDLED, Drive};
use pitchline::integrate::Isa;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::ChainModel;
use pitchline::recording::{ViewOptions, capture, create};
use pitchline::simulate::{RunLength, run};
use pitchline::state::State;
use std::sync::atomic::AtomicBool;

const STEPS: u64 = 20_000;

fn hash_after(a: &Assembly, state: &State, scratch: &mut Scratch, steps: u64) -> (u64, State) {
    let mut state = state.clone();
    for _ in 0..steps {
        explicit::step(&a.model, &mut state, scratch).expect("the run holds");
    }
    (state.hash(), state)
}

#[test]
fn every_vector_unit_and_every_look_interval_gives_the_same_bits() {
    let a = assembled(&drive(&[]));
    let reference = hash_after(&a, &a.state, &mut Scratch::with_isa(&a.model, Isa::Baseline), STEPS).0;
    for isa in Isa::available() {
        for refresh in [1, 7, 64] {
            let mut scratch = Scratch::with_isa(&a.model, isa);
            scratch.refresh_steps = refresh;
            assert_eq!(
                hash_after(&a, &a.state, &mut scratch, STEPS).0,
                reference,
                "{isa:?}, looking every {refresh} steps"
            );
        }
        println!("{isa:?}: {reference:016x}");
    }
}

/// Rails, blades, oil, several chains: what is looked at seldom, skipped in blocks or left to another body changes no bit.
#[test]
fn every_bundled_drive_has_the_same_bits_however_often_it_looks() {
    const FEW_STEPS: u64 = 1200;
    for (name, text) in BUNDLED {
        let a = assembled(&Drive::parse(name, text, &[]).unwrap_or_else(|e| panic!("{e}")));
        let reference = hash_after(&a, &a.state, &mut Scratch::with_isa(&a.model, Isa::Baseline), FEW_STEPS).0;
        for (isa, refresh) in Isa::available().into_iter().flat_map(|isa| [(isa, 1), (isa, 29)]) {
            let mut scratch = Scratch::with_isa(&a.model, isa);
            scratch.refresh_steps = refresh;
            let hash = hash_after(&a, &a.state, &mut scratch, FEW_STEPS).0;
            assert_eq!(hash, reference, "{name}, {isa:?}, looking every {refresh} steps");
        }
    }
}

#[test]
fn wider_padding_gives_the_same_bits() {
    for (name, text) in BUNDLED {
        let a = assembled(&Drive::parse(name, text, &[]).unwrap_or_else(|e| panic!("{e}")));
        let steps = if name == BUNDLED[0].0 { STEPS } else { STEPS / 4 };
        let reference = hash_after(&a, &a.state, &mut Scratch::new(&a.model), steps).0;
        // Several chains have separate blocks for any padding.
        let alone = a.model.chain.loops.len() == 1;
        for width in [16, 64].into_iter().filter(|_| alone) {
            let mut model = a.model.clone();
            model.chain = ChainModel::new(model.chain.n_links, &model.rows, model.chain.joints[0], width);
            let mut state = State::at_rest(&model.layout());
            state.restore(&a.state.keyframe()).expect("same columns");
            let padded = Assembly { model, state, report: a.report.clone() };
            let hash = hash_after(&padded, &padded.state, &mut Scratch::new(&padded.model), steps).0;
            assert_eq!(hash, reference, "{name}, padded to {width}");
        }
    }
}

#[test]
fn a_run_resumed_from_a_keyframe_ends_in_the_same_state() {
    let a = assembled(&drive(&[]));
    let (end, _) = hash_after(&a, &a.state, &mut Scratch::new(&a.model), STEPS);
    let (_, middle) = hash_after(&a, &a.state, &mut Scratch::new(&a.model), STEPS / 3);
    let keyframe = middle.keyframe();
    let mut resumed = a.state.clone();
    resumed.restore(&keyframe).expect("the keyframe fits");
    assert_eq!(resumed.hash(), middle.hash());
    assert_eq!(hash_after(&a, &resumed, &mut Scratch::new(&a.model), STEPS - STEPS / 3).0, end);
    let mut broken = keyframe.clone();
    broken.columns[0].values[3] += 1e-12;
    assert!(resumed.restore(&broken).expect_err("a changed value").to_string().contains("hashes"));
    broken.columns.remove(4);
    assert!(resumed.restore(&broken).is_err());
}

#[test]
fn assembling_twice_and_recording_into_none_one_or_two_sinks_gives_the_same_bits() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut hashes = Vec::new();
    let mut files = Vec::new();
    for (case, names) in [("none", vec![]), ("one", vec!["a.mcap"]), ("two", vec!["b.mcap", "c.mcap"])] {
        let drive = drive(&[]);
        let Assembly { model, mut state, report } = assembled(&drive);
        let every = if case == "one" { 50e-6 } else { 20e-6 };
        let span = RunLength::new(20e-3, every, model.step_s);
        let header = capture::header(&drive, &model, &report, span.steps_per_frame);
        let mut sinks: Vec<_> = names
            .iter()
            .map(|n| create(&folder.path().join(n), &header, ViewOptions::default()).expect("opens"))
            .collect();
        let mut scratch = Scratch::new(&model);
        let stop = AtomicBool::new(false);
        let summary = run(&model, &mut state, &mut scratch, &header, span, &mut sinks, &stop, |_| {}).expect("runs");
        for sink in &mut sinks {
            sink.finish().expect("finishes");
        }
        hashes.push(summary.state_hash);
        files.extend(names.iter().map(|n| std::fs::read(folder.path().join(n)).expect("readable")));
    }
    println!("{hashes:016x?}");
    assert!(hashes.iter().all(|h| *h == hashes[0]));
    assert!(files[1] == files[2], "two recordings of one run are equal byte for byte");
}
