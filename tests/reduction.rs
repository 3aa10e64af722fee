//! Several chains in one drive: chains without common parts have the same bits as each chain alone; two stages on a
//! common shaft turn the output at the product of their ratios, transmit torque through it, and excite it with both
//! meshing frequencies.

mod common;

use common::assembled;
use pitchline::assemble::Assembly;
use pitchline::drive::{BUNDLED, Drive};
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::Model;
use pitchline::recording::capture::Camera;
use pitchline::state::{RestoreError, State};

fn reduction(sets: &[&str]) -> Drive {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    let (name, text) = BUNDLED[4];
    Drive::parse(name, text, &sets).unwrap_or_else(|e| panic!("{e}"))
}

/// Columns of a State by name, with the lanes of one chain.
fn columns(
    state: &State,
    lanes: std::ops::Range<usize>,
    coordinates: std::ops::Range<usize>,
) -> Vec<(String, Vec<f64>)> {
    let mut all = Vec::new();
    state.for_each_column(|name, values| {
        let own = if name.set == "coordinates" { &coordinates } else { &lanes };
        let values = if values.is_empty() { Vec::new() } else { values[own.clone()].to_vec() };
        all.push((name.to_string(), values));
    });
    all
}

/// Two chains with separate links, joints and loads, side by side in one model.
#[test]
fn chains_that_share_nothing_have_their_own_bits() {
    let first = common::drive(&[]);
    let second = common::drive(&["chain.bush.links=94", "preload.tension_n=250", "loads.constant.driven.torque_nm=12"]);
    let parts: [Assembly; 2] = [&first, &second].map(assembled);
    assert_eq!(parts[0].model.step_s, parts[1].model.step_s);
    let mut both = first.clone();
    both.sprockets.extend(second.sprockets.clone());
    let model = Model::join(&both, parts.iter().map(|p| p.model.clone()).collect());
    let loops = model.chain.loops.clone();
    assert_eq!((loops[0].len(), loops[1].len(), model.chain.n_links), (90, 94, 184));
    // Their States combined.
    let mut state = State::at_rest(&model.layout());
    let mut joined = state.keyframe();
    for (k, part) in parts.iter().enumerate() {
        let n = part.model.chain.n_links;
        for (to, (_, from)) in joined.columns.iter_mut().zip(columns(&part.state, 0..n, 0..2)) {
            let at = if to.name.starts_with("coordinates.") { 2 * k } else { loops[k].start };
            if !from.is_empty() {
                to.values[at..at + from.len()].copy_from_slice(&from);
            }
        }
    }
    // The hash of the combined State is found by restoring it once with a wrong one.
    let Err(RestoreError::OtherHash { found, .. }) = state.clone().restore(&joined) else { panic!("another hash") };
    joined.state_hash = found;
    state.restore(&joined).expect("the same columns");
    let mut scratch = Scratch::new(&model);
    let mut alone: Vec<(State, Scratch)> = parts.iter().map(|p| (p.state.clone(), Scratch::new(&p.model))).collect();
    for step in 0..6000 {
        explicit::step(&model, &mut state, &mut scratch).expect("holds");
        for (part, (own, scratch)) in parts.iter().zip(&mut alone) {
            explicit::step(&part.model, own, scratch).expect("holds");
        }
        if step % 500 == 0 {
            for (k, (own, _)) in alone.iter().enumerate() {
                let n = parts[k].model.chain.n_links;
                let here = columns(&state, loops[k].clone(), 2 * k..2 * k + 2);
                for (a, b) in here.iter().zip(columns(own, 0..n, 0..2)) {
                    assert!(*a == b, "chain {k}, step {step}: {}", a.0);
                }
            }
        }
    }
}

/// A quarter: 20/40 twice. Over many turns the error of the output is its oscillation, without any drift.
#[test]
fn the_output_turns_at_the_product_of_the_ratios() {
    let a = assembled(&reduction(&[]));
    let (model, mut state) = (a.model, a.state);
    let q = |k: usize| model.sprockets[k].coordinate;
    assert_eq!(q(1), q(2), "driven and pinion sit on one shaft");
    let mut scratch = Scratch::new(&model);
    let start = state.coordinates.angle.clone();
    // Whole turns of the output, so that the teeth are at their initial positions.
    let turn_s = 4.0 * 2.0 * std::f64::consts::PI / model.sprockets[0].nominal_speed_rad_s;
    let mut misses = Vec::new();
    for turn in 1..=3 {
        while (state.step as f64) * model.step_s < f64::from(turn) * turn_s {
            explicit::step(&model, &mut state, &mut scratch).expect("holds");
        }
        let turned = |k: usize| state.coordinates.angle[q(k)] - start[q(k)];
        let (driver, middle, output) = (turned(0), turned(1), turned(3));
        println!("after {turn} turns: middle / driver {:.9}, output / driver {:.9}", middle / driver, output / driver);
        misses.push([(middle - 0.5 * driver).abs(), (output - 0.25 * driver).abs()]);
    }
    // A tooth is 0.16 rad; the remainder after any number of turns is the oscillation.
    for [middle, output] in misses {
        assert!(middle < 2e-3 && output < 2e-3, "{middle} {output}");
    }
}

/// Inertia of the shaft times its acceleration equals the torques of both chains, and the energies add up.
#[test]
fn a_shaft_carries_the_torques_of_both_chains() {
    let a = assembled(&reduction(&[]));
    let (model, mut state) = (a.model, a.state);
    let (mut scratch, mut camera) = (Scratch::new(&model), Camera::default());
    let shaft = model.sprockets[1].coordinate;
    let mut worst = 0.0_f64;
    let mut means = [0.0; 2];
    let mut last = None;
    for step in 0..27_000 {
        explicit::evaluate(&model, &state, &mut scratch).expect("holds");
        if step % 50 == 0 {
            let frame = camera.take(&model, &state, &scratch);
            let c = &frame.contacts;
            let mut of_chain = [0.0; 2];
            for i in 0..c.link.len() {
                let body = c.body[i] as usize;
                if !(1..3).contains(&body) {
                    continue;
                }
                let centre = model.sprockets[body].frame.origin;
                let (nx, ny, n, t) = (c.normal_x[i], c.normal_y[i], c.normal_force_n[i], c.tangential_force_n[i]);
                let (x, y) = (c.point_link_x_m[i] - centre.x, c.point_link_y_m[i] - centre.y);
                of_chain[body - 1] += y * (n * nx - t * ny) - x * (n * ny + t * nx);
            }
            let alpha = scratch.coordinate_alpha()[shaft];
            let inertia = 1.0 / model.coordinates[shaft].inverse_inertia();
            worst = worst.max((of_chain[0] + of_chain[1] - inertia * alpha).abs());
            means = [means[0] + of_chain[0], means[1] + of_chain[1]];
            last = Some(frame.energy);
        }
        explicit::advance(&model, &mut state, &mut scratch);
    }
    let [first, second] = means.map(|m| m / 540.0);
    let e = last.expect("frames");
    println!(
        "torques on the shaft {first:.3} and {second:.3} N m, sum against J alpha within {worst:.1e}; error {:.1e}",
        e.error_j / e.work_in_j
    );
    assert!(worst < 1e-9);
    // 20 N m at the output are 10 at the pinion.
    assert!((second + 10.0).abs() < 0.3 && (first + second).abs() < 0.3);
    assert!((e.error_j / e.work_in_j).abs() < 2e-4);
}

/// Amplitude of the output's speed at a frequency, over a whole number of its periods [rad/s].
fn amplitude(speed: &[f64], step_s: f64, hz: f64) -> f64 {
    let n = ((speed.len() as f64 * step_s * hz).floor() / hz / step_s) as usize;
    let mean = speed[..n].iter().sum::<f64>() / n as f64;
    let (mut re, mut im) = (0.0, 0.0);
    for (i, v) in speed[..n].iter().enumerate() {
        let hann = 1.0 - (2.0 * std::f64::consts::PI * i as f64 / n as f64).cos();
        let (s, c) = (2.0 * std::f64::consts::PI * hz * step_s * i as f64).sin_cos();
        (re, im) = (re + hann * (v - mean) * c, im + hann * (v - mean) * s);
    }
    2.0 * re.hypot(im) / n as f64
}

/// With 19 teeth on the pinion the meshing frequencies of the chains are unrelated; the output shows both.
#[test]
fn the_last_shaft_shows_the_teeth_of_both_chains() {
    let a = assembled(&reduction(&["sprockets.pinion.teeth=19"]));
    let (model, mut state) = (a.model, a.state);
    let mut scratch = Scratch::new(&model);
    let output = model.sprockets[3].coordinate;
    let mut speed = Vec::new();
    for _ in 0..54_000 {
        explicit::step(&model, &mut state, &mut scratch).expect("holds");
        speed.push(state.coordinates.omega[output]);
    }
    let (first_hz, second_hz) = (20.0 * 50.0, 19.0 * 25.0);
    let line = |hz: f64| amplitude(&speed, model.step_s, hz);
    // Away from the lines of both chains, their shaft orders and their sums.
    let floor = [437.3, 561.7, 873.9, 1091.3].map(line).into_iter().fold(0.0, f64::max);
    println!("first {:.2e}, second {:.2e}, floor {floor:.2e} rad/s", line(first_hz), line(second_hz));
    assert!(line(first_hz) > 10.0 * floor && line(second_hz) > 100.0 * floor);
}

#[test]
fn drives_of_several_chains_say_what_is_wrong() {
    let (name, text) = BUNDLED[4];
    for (from, to, says) in [
        ("shaft = \"middle\"\nteeth = 20", "inertia_kg_m2 = 1e-3\nteeth = 20", "nothing turns chain `second`"),
        ("moves = \"output\"", "moves = \"pinion\"", "shares its shaft"),
        (
            "[sprockets.pinion]\nshaft = \"middle\"\nteeth = 20\nx_mm = 0",
            "[sprockets.pinion]\nshaft = \"middle\"\nteeth = 20\nx_mm = 1",
            "not at one place",
        ),
        ("shaft = \"middle\"\nteeth = 40", "shaft = \"midle\"\nteeth = 40", "no shaft is called `midle`"),
        (
            "[chains.second.chain.bush]\nlinks = 90",
            "[chains.second.chain.bush]\nlinks = 91",
            "`chain.bush.links` = 91 is odd",
        ),
        ("route = [\"pinion\", \"output\"]", "route = [\"pinion\"]", "at least two sprockets"),
    ] {
        assert!(text.contains(from), "{from}");
        let report = Drive::parse(name, &text.replace(from, to), &[]).expect_err(says).to_string();
        assert!(report.contains(says) && report.contains("-->"), "{says}: {report}");
    }
    // Links are numbered through all chains, 0 to 179.
    let last = ["effects.pitch_error.a.link=179".to_string(), "effects.pitch_error.a.length_um=5".to_string()];
    assert!(Drive::parse(name, text, &last).is_ok());
    for (set, says) in
        [("effects.pitch_error.a.link=180", "no link 180"), ("effects.tight_joint.a.joint=200", "no joint 200")]
    {
        let sets =
            [set.to_string(), "effects.pitch_error.a.length_um=5".into(), "effects.tight_joint.a.torque_nm=0.1".into()];
        let own: Vec<String> =
            sets.into_iter().filter(|s| s.contains(set.split('.').nth(1).expect("an effect"))).collect();
        let report = Drive::parse(name, text, &own).expect_err(says).to_string();
        assert!(report.contains(says), "{says}: {report}");
    }
}
