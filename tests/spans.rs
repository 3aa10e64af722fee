//! Chains of spans: closed forms of frequency and tension, energy, the same drive with links, bits, slack, and what is refused.

mod common;

use common::assembled;
use pitchline::assemble::{Assembly, at_rest, resting_state};
use pitchline::drive::sensors::SensorReads;
use pitchline::drive::{BUNDLED, Drive, OuterSpec};
use pitchline::elements::coordinate::CoordinateMotion;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::Model;
use pitchline::recording::capture::Camera;
use pitchline::state::State;
use std::f64::consts::PI;

/// The reduction with other values, and with more tables behind its text.
fn parsed(sets: &[&str], more: &str) -> Result<Drive, String> {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    let (name, text) = BUNDLED[4];
    Drive::parse(name, &format!("{text}{more}"), &sets).map_err(|e| e.to_string())
}

fn drive(sets: &[&str]) -> Drive {
    parsed(sets, "").unwrap_or_else(|e| panic!("{e}"))
}

const SPANS: &str = "chains.second.fidelity=spans";

/// Energy error of a run over the work put in; the tensions of all spans, step by step, go to `each`.
fn run(model: &Model, state: &mut State, duration_s: f64, mut each: impl FnMut(&State, &Scratch)) -> f64 {
    let (mut scratch, mut camera) = (Scratch::new(model), Camera::default());
    let steps = (duration_s / model.step_s) as u64;
    let (mut worst_j, mut work_j) = (0.0_f64, 0.0_f64);
    for step in 0..=steps {
        explicit::evaluate(model, state, &mut scratch).expect("holds");
        if step % 200 == 0 {
            let e = camera.take(model, state, &scratch).energy;
            worst_j = worst_j.max(e.error_j.abs());
            work_j = e.work_in_j;
        }
        each(state, &scratch);
        explicit::advance(model, state, &mut scratch);
    }
    worst_j / work_j.abs()
}

fn tensions(model: &Model, angles: &[f64]) -> Vec<f64> {
    model.spans.iter().map(|s| s.spring_n(s.elongation(s.ends.map(|k| angles[k])))).collect()
}

/// f = sqrt(k (r1^2 / J1 + r2^2 / J2)), k of both spans.
#[test]
fn two_inertias_swing_at_the_closed_form() {
    const J1: f64 = 1.3e-3;
    /// Relative; of the scheme alone (h omega)^2 / 24, some 1e-7.
    const TOLERANCE: f64 = 1e-4;
    let mut drive =
        drive(&[SPANS, "chains.second.chain.joint.damping_n_s_per_m=0", "loads.constant.output.torque_nm=0"]);
    // Off the shaft: nothing turns the second chain any more.
    drive.sprockets[2].shaft = None;
    drive.sprockets[2].outer = OuterSpec::Load { inertia_kg_m2: J1, torque_nm: 0.0 };
    let (mut model, rest) = at_rest(&drive).expect("stands");
    let [a, b] = model.spans[0].ends;
    model.coordinates[a].motion = CoordinateMotion::Free { inertia: J1, load: 0.0 };
    let driver = model.sprockets[model.driver].coordinate;
    model.coordinates[driver].motion = CoordinateMotion::Prescribed { speed_rad_s: 0.0 };
    let mut state = resting_state(&model, &rest.configuration);
    state.coordinates.angle[b] += 1e-4;
    let k: f64 = model.spans.iter().map(|s| s.stiffness_n_per_m).sum();
    let mobility =
        |i: usize| model.spans[0].radii_m[i].powi(2) * model.coordinates[model.spans[0].ends[i]].inverse_inertia();
    let expected_hz = (k * (mobility(0) + mobility(1))).sqrt() / (2.0 * PI);
    let mut scratch = Scratch::new(&model);
    let (mut crossings, mut before) = (Vec::new(), 1.0_f64);
    while crossings.len() < 21 {
        explicit::step(&model, &mut state, &mut scratch).expect("holds");
        let now = model.spans[0].elongation([a, b].map(|k| state.coordinates.angle[k]));
        if before < 0.0 && now >= 0.0 {
            crossings.push((state.step as f64 - now / (now - before)) * model.step_s);
        }
        before = now;
    }
    let hz = 20.0 / (crossings[20] - crossings[0]);
    println!("{hz:.6} Hz, closed form {expected_hz:.6} Hz: {:.1e}", hz / expected_hz - 1.0);
    assert!((hz / expected_hz - 1.0).abs() < TOLERANCE);
}

/// Largest frequency between 100 and 500 Hz in the speed of the output, after it was 2 rad/s off for a moment.
fn swing_hz(sets: &[&str]) -> f64 {
    let sets = [sets, &["shafts.middle.inertia_kg_m2=1", "sprockets.output.inertia_kg_m2=1e-3"]].concat();
    let Assembly { model, mut state, .. } = assembled(&drive(&sets));
    let output = model.sprockets[3].coordinate;
    state.coordinates.omega[output] += 2.0;
    let mut speeds = Vec::new();
    run(&model, &mut state, 60e-3, |state, _| speeds.push(state.coordinates.omega[output]));
    let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
    let amplitude = |hz: f64| {
        let (mut re, mut im) = (0.0, 0.0);
        for (i, speed) in speeds.iter().enumerate() {
            let (turn, window) = (i as f64 * model.step_s * hz, i as f64 / speeds.len() as f64);
            let (sin, cos) = (2.0 * PI * turn).sin_cos();
            let hann = (PI * window).sin().powi(2) * (speed - mean);
            (re, im) = (re + hann * cos, im + hann * sin);
        }
        re.hypot(im)
    };
    (100..500).map(f64::from).max_by(|a, b| amplitude(*a).total_cmp(&amplitude(*b))).expect("some")
}

/// Spans are as stiff as the links that they stand for, wraps and teeth included: the output swings against the shaft as with links.
#[test]
fn the_output_swings_as_with_links() {
    /// Relative, measured 0.4 %.
    const TOLERANCE: f64 = 0.015;
    let (links, spans) = (swing_hz(&[]), swing_hz(&[SPANS]));
    println!("{links} Hz with links, {spans} Hz with spans");
    assert!((spans / links - 1.0).abs() < TOLERANCE);
}

/// Two equal spans share the load: T0 -+ M / (2 r).
#[test]
fn spans_share_a_torque() {
    /// Relative.
    const TOLERANCE: f64 = 1e-9;
    let (model, rest) = at_rest(&drive(&[SPANS])).expect("stands");
    let (t, r) = (tensions(&model, &rest.configuration.coordinates), model.spans[0].radii_m[1]);
    let half = 20.0 / (2.0 * r);
    let preload = model.spans[0].preload_n;
    println!("tight {:.9} N, slack {:.9} N, expected {:.9}, {:.9}", t[1], t[0], preload + half, preload - half);
    // The preload is the mean of all joints at rest; under load spans bear more, and wraps less.
    assert!((320.0..370.0).contains(&preload), "{preload}");
    // The span from pinion to output is the one that the pinion pays out.
    assert!(
        (t[0] - (preload - half)).abs() < TOLERANCE * preload && (t[1] - (preload + half)).abs() < TOLERANCE * preload
    );
}

/// At a constant speed the chain that turns with the sprockets has the energy of all its links on the pitch line.
#[test]
fn the_mass_of_the_chain_turns_with_the_sprockets() {
    let with_links = at_rest(&drive(&[])).expect("stands").0;
    let with_spans = at_rest(&drive(&[SPANS])).expect("stands").0;
    let mass_kg: f64 = with_links.chain.mass[with_links.chain.loops[1].clone()].iter().sum();
    let turning: f64 =
        with_spans.sprockets.iter().map(|s| s.chain_inertia_kg_m2 / s.geometry.rolling_radius_m().powi(2)).sum();
    println!("{mass_kg} kg, {turning} kg");
    assert!((turning / mass_kg - 1.0).abs() < 1e-12);
}

/// The reduction with its second chain of spans: ratio, energy and tension as with links, and less to compute.
#[test]
fn the_reduction_runs_on_spans_as_on_links() {
    /// Over the work put in, measured 8e-5; of the difference of both tensions, measured 5e-3; of their mean, measured 1.1e-2.
    const ENERGY: f64 = 1e-4;
    const TENSION: f64 = 0.02;
    const MEAN: f64 = 0.02;
    let Assembly { model, mut state, report } = assembled(&drive(&[SPANS]));
    println!("{}", report.lines().join("\n"));
    assert_eq!((model.chain.n_links, model.spans.len()), (90, 2));
    let q = |k: usize| model.sprockets[k].coordinate;
    let start = state.coordinates.angle.clone();
    let (mut sum, mut both, mut count) = (0.0, 0.0, 0.0);
    let began = std::time::Instant::now();
    let error = run(&model, &mut state, 0.2, |state, _| {
        let t = tensions(&model, &state.coordinates.angle);
        sum += t[1] - t[0];
        both += 0.5 * (t[1] + t[0]);
        count += 1.0;
    });
    let spans_s = began.elapsed().as_secs_f64();
    let turned = |k: usize| state.coordinates.angle[q(k)] - start[q(k)];
    let miss_rad = (turned(3) - 0.25 * turned(0)).abs();
    let Assembly { model: linked, state: mut with_links, .. } = assembled(&drive(&[]));
    let (mut linked_sum, mut linked_both, mut linked_count) = (0.0, 0.0, 0.0);
    let began = std::time::Instant::now();
    let linked_error = run(&linked, &mut with_links, 0.2, |state, scratch| {
        // In the middle of both spans.
        let span = |k: usize| pitchline::sensing::read(&linked, state, scratch, SensorReads::Span(k));
        linked_sum += span(3) - span(2);
        linked_both += 0.5 * (span(3) + span(2));
        linked_count += 1.0;
    });
    let links_s = began.elapsed().as_secs_f64();
    let (mean_n, linked_n) = (sum / count, linked_sum / linked_count);
    let (both_n, linked_both_n) = (both / count, linked_both / linked_count);
    println!("energy error {error:.2e} of the work, with links {linked_error:.2e}; output off by {miss_rad:.2e} rad");
    println!(
        "difference of tensions {mean_n:.3} N, with links {linked_n:.3} N; their mean {both_n:.3} and {linked_both_n:.3} N; \
         {links_s:.2} s with links, {spans_s:.2} s with spans"
    );
    assert!(error < ENERGY, "{error}");
    // 2.5 turns of the output: what is left is the swing of both ends.
    assert!(miss_rad < 2e-3, "{miss_rad}");
    assert!((mean_n / linked_n - 1.0).abs() < TENSION, "{mean_n} {linked_n}");
    assert!((both_n / linked_both_n - 1.0).abs() < MEAN, "{both_n} {linked_both_n}");
}

/// Run twice, and from a keyframe: the same bits.
#[test]
fn runs_and_keyframes_give_the_same_bits() {
    let drive = drive(&[SPANS]);
    let [a, b] = [assembled(&drive), assembled(&drive)];
    assert_eq!(a.state.hash(), b.state.hash());
    let advance = |model: &Model, state: &mut State| {
        let mut scratch = Scratch::new(model);
        (0..3000).for_each(|_| explicit::step(model, state, &mut scratch).expect("holds"));
    };
    let mut whole = a.state.clone();
    advance(&a.model, &mut whole);
    let keyframe = whole.keyframe();
    advance(&a.model, &mut whole);
    let mut resumed = State::at_rest(&b.model.layout());
    resumed.restore(&keyframe).expect("the same columns");
    advance(&b.model, &mut resumed);
    assert_eq!(whole.hash(), resumed.hash());
}

/// A load that reverses takes all tension from a span now and then; nothing is gained or lost by that.
#[test]
fn a_span_goes_slack_and_the_energy_closes() {
    const ENERGY: f64 = 1e-4;
    let load = "\n[loads.orders.output]\norders = [1.5]\ntorques_nm = [30]\nphases_deg = [0]\n";
    let drive = parsed(&[SPANS, "chains.second.preload.tension_n=100"], load).expect("a drive");
    let Assembly { model, mut state, .. } = assembled(&drive);
    let (mut slack, mut steps) = ([0_u64; 2], 0_u64);
    let error = run(&model, &mut state, 0.2, |state, _| {
        for (count, tension_n) in slack.iter_mut().zip(tensions(&model, &state.coordinates.angle)) {
            *count += u64::from(tension_n == 0.0);
        }
        steps += 1;
    });
    println!("slack in {slack:?} of {steps} steps, energy error {error:.2e} of the work");
    assert!(slack.iter().any(|n| *n > 0), "no span was slack");
    assert!(error < ENERGY, "{error}");
}

/// The chain that the driver is on may be the one of spans.
#[test]
fn the_first_chain_may_be_the_one_of_spans() {
    let Assembly { model, mut state, .. } = assembled(&drive(&["chains.first.fidelity=spans"]));
    assert_eq!((model.chain.n_links, model.chain.loops[0].len()), (90, 0));
    let error = run(&model, &mut state, 0.05, |_, _| {});
    println!("energy error {error:.2e} of the work");
    assert!(error < 1e-4, "{error}");
}

/// What is known of a span takes the place of what follows from its links; effects add to it. Another span keeps its numbers.
#[test]
fn numbers_of_a_span_are_given_and_altered() {
    let spans = |sets: &[&str]| {
        let model = at_rest(&drive(&[&[SPANS], sets].concat())).expect("stands").0;
        [0, 1].map(|k| (model.spans[k].stiffness_n_per_m, model.spans[k].damping_n_s_per_m))
    };
    let own = spans(&[]);
    let softer = spans(&["effects.span_stiffness.output-pinion.stiffness_n_per_m=-1e5"]);
    assert_eq!(softer, [own[0], (own[1].0 - 1e5, own[1].1)]);
    let damped = spans(&["effects.span_damping.pinion-output.damping_n_s_per_m=7"]);
    assert_eq!(damped, [(own[0].0, own[0].1 + 7.0), own[1]]);
    let given = spans(&["chains.second.spans.pinion-output.stiffness_n_per_m=3e6"]);
    // The damper goes with the stiffness unless it is given too.
    assert_eq!(given, [(3e6, 3e6 * 100.0 / 3e7), own[1]]);
    let both = [
        "chains.second.spans.pinion-output.damping_n_s_per_m=5",
        "effects.span_damping.pinion-output.damping_n_s_per_m=7",
    ];
    assert_eq!(spans(&both), [(own[0].0, 12.0), own[1]]);
    let refused = |sets: &[&str]| at_rest(&drive(sets)).expect_err("no stiffness left").to_string();
    let none = refused(&[SPANS, "effects.span_stiffness.output-pinion.stiffness_n_per_m=-1e7"]);
    assert!(none.contains("the stiffness of span `output-pinion` would be"), "{none}");
    for (set, says) in [
        ("effects.span_stiffness.driver-driven.stiffness_n_per_m=1", "spans: pinion-output, output-pinion"),
        ("chains.second.spans.output-driver.stiffness_n_per_m=1e6", "spans: pinion-output, output-pinion"),
        ("chains.first.spans.driver-driven.stiffness_n_per_m=1e6", "set `fidelity = \"spans\"` in its table"),
    ] {
        let error = parsed(&[SPANS, set], "").expect_err("refused");
        assert!(error.contains(says), "{set}: {error}");
    }
}

/// Every refusal says what and where.
#[test]
fn what_needs_links_is_refused_at_its_place() {
    let face = "side = \"outside\"\nstart_mm = 40\nend_mm = 40\nclearance_um = 0\n";
    let guide = format!("\n[guides.fixed.top]\nspan = [\"pinion\", \"output\"]\n{face}");
    let bearing = "\n[bearings.elastic.output]\nstiffness_n_per_m = 1e8\nmass_kg = 0.5\n";
    let cases: [(&[&str], &str, &str); 5] = [
        (&["chains.first.fidelity=spans"], "", "no chain of this drive has links"),
        (&[], &guide, "guide `top` guides links, and chain `second` has spans"),
        (&[], bearing, "this bearing yields to links"),
        (&["effects.pitch_error.e.link=120", "effects.pitch_error.e.length_um=10"], "", "the chains have no link 120"),
        (&["effects.gap_error.output.gap=3", "effects.gap_error.output.outward_um=5"], "", "gaps seat links"),
    ];
    let mut wrong = Vec::new();
    for (sets, more, wanted) in cases {
        let sets: Vec<&str> = [SPANS].into_iter().chain(sets.iter().copied()).collect();
        let text = parsed(&sets, more).expect_err(wanted);
        println!("{text}");
        if !text.contains(wanted) || !text.contains("-->") {
            wrong.push(text);
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
    let text = parsed(&["chains.second.fidelity=springs"], "").expect_err("no such fidelity");
    assert!(text.contains("springs"), "{text}");
}

/// Fits see the numbers that a span has without the effects on it, in the ranges of the drive file, and what one of its sprockets is called says which
/// shaft an effect is on.
#[test]
fn fits_see_a_spans_own_numbers_and_each_shaft_once() {
    use pitchline::effects::EFFECTS;
    use pitchline::machine::Machine;
    let sets = [
        SPANS,
        "chains.second.spans.pinion-output.stiffness_n_per_m=6e5",
        "effects.span_stiffness.pinion-output.stiffness_n_per_m=-1e5",
        "effects.span_damping.output-pinion.damping_n_s_per_m=7",
    ];
    let drive = drive(&sets);
    let m = Machine::of_links(&drive);
    let of = |path: &str| m.slot(&format!("chains.second.spans.{path}")).expect("a number");
    let given = of("pinion-output.stiffness_n_per_m");
    assert_eq!((m.values[given], m.slots[given].low, m.slots[given].high), (6e5, 1.0, 1e12));
    let damping = of("output-pinion.damping_n_s_per_m");
    assert_eq!((m.slots[damping].low, m.slots[damping].high), (0.0, 1e9));
    // As without the effect: 7 N s/m less than the model has.
    let compiled = at_rest(&drive).expect("stands").0;
    assert!((m.values[damping] - (compiled.spans[1].damping_n_s_per_m - 7.0)).abs() < 1e-9);
    // `driven` and `pinion` sit on one shaft.
    let friction = EFFECTS.into_iter().find(|e| e.name == "viscous_friction").expect("a row");
    let names: Vec<String> = m.targets(friction).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["driven", "output"]);
}
