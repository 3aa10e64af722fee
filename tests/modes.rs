//! Modes of drives, at rest and running: swinging by itself the drive has their frequencies and damping; closed forms; plungers; what is printed and recorded.

mod common;

use common::{NO_FRICTION, bundled, without_guides};
use pitchline::analysis::mode_shapes::LinkPlaces;
use pitchline::analysis::running_modes::{KickPlan, RunningModes, RunningModesError, running_modes};
use pitchline::assemble::{assemble, at_rest, resting_state};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::elements::coordinate::CoordinateMotion;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::Model;
use pitchline::recording::capture::contacts_of;
use pitchline::recording::frame::Feature;
use pitchline::statics::{Equilibrium, Mode, Plungers, modes};
use std::f64::consts::PI;

/// The drive at rest, its driver held.
fn held(drive: &Drive) -> (Model, Equilibrium) {
    let (mut model, rest) = at_rest(drive).unwrap_or_else(|e| panic!("{e}"));
    let driver = model.sprockets[model.driver].coordinate;
    model.coordinates[driver].motion = CoordinateMotion::Prescribed { speed_rad_s: 0.0 };
    (model, rest)
}

/// Displaced by a little of a mode and let go, the drive swings in this mode alone: its frequency [Hz] and damping ratio, by explicit steps.
fn swings(model: &Model, rest: &Equilibrium, mode: &Mode, amplitude_m: f64) -> (f64, f64) {
    let q = &rest.configuration;
    let lanes: Vec<usize> = model.chain.links().collect();
    let longest = lanes.iter().map(|i| mode.links[*i].x.hypot(mode.links[*i].y)).fold(0.0, f64::max);
    let scale = amplitude_m / longest;
    let mut displaced = q.clone();
    for i in &lanes {
        let d = mode.links[*i] * scale;
        displaced.links[*i].0.x += d.x;
        displaced.links[*i].0.y += d.y;
        displaced.links[*i].1 += d.z;
    }
    for (angle, moved) in displaced.coordinates.iter_mut().zip(&mode.coordinates) {
        *angle += scale * moved;
    }
    let mut state = resting_state(model, &displaced);
    let mut scratch = Scratch::new(model);
    let c = &model.chain;
    // The mode's own coordinate: x M d.
    let now = |state: &pitchline::state::State| {
        let of_links = lanes.iter().map(|i| {
            let x = mode.links[*i];
            let (dx, dy) = (state.links.x[*i] - q.links[*i].0.x, state.links.y[*i] - q.links[*i].0.y);
            let turned = state.links.sin[*i].atan2(state.links.cos[*i]) - q.links[*i].1;
            let turned = turned - 2.0 * PI * (turned / (2.0 * PI)).round();
            c.mass[*i] * (x.x * dx + x.y * dy) + c.inertia[*i] * x.z * turned
        });
        let of_coordinates = model.coordinates.iter().enumerate().filter(|(k, _)| mode.coordinates[*k] != 0.0);
        let of_coordinates = of_coordinates.map(|(k, own)| {
            let moved = state.coordinates.angle[k] - q.coordinates[k];
            let moved = moved - 2.0 * PI * (moved / (2.0 * PI)).round();
            mode.coordinates[k] * moved / own.inverse_inertia()
        });
        of_links.sum::<f64>() + of_coordinates.sum::<f64>()
    };
    let steps_per_period = 1.0 / (mode.frequency_hz() * model.step_s);
    let periods = 6;
    let (mut crossings, mut peaks) = (Vec::new(), Vec::new());
    let (mut before, mut largest) = (now(&state), 0.0_f64);
    for step in 1..=(f64::from(periods) * steps_per_period) as usize {
        explicit::step(model, &mut state, &mut scratch).expect("holds");
        let a = now(&state);
        if before * a < 0.0 {
            crossings.push(step as f64 - a / (a - before));
            peaks.push(largest);
            largest = 0.0;
        }
        largest = largest.max(a.abs());
        before = a;
    }
    let halves = (crossings.len() - 1) as f64;
    let period_steps = 2.0 * (crossings[crossings.len() - 1] - crossings[0]) / halves;
    // From one half period to the next by exp(-pi zeta); the first one is a quarter.
    let decay = (peaks[1] / peaks[peaks.len() - 1]).ln() / (peaks.len() - 2) as f64 / PI;
    (1.0 / (period_steps * model.step_s), decay)
}

/// Every force of a step against the matrices of statics: what swings, and what damps it.
#[test]
fn a_drive_let_go_swings_in_its_mode() {
    let free: Vec<String> = NO_FRICTION.iter().map(|s| (*s).to_string()).collect();
    let more = ["chain.joint.damping_n_s_per_m=400".to_string()];
    let sets: Vec<&str> = free.iter().chain(&more).map(String::as_str).collect();
    let (model, rest) = held(&without_guides(BUNDLED[0].1, &sets));
    let all = modes(&model, &rest.configuration, Plungers::Oil).expect("modes");
    let places = LinkPlaces::new(&model, &rest.configuration);
    let of = |part: &str| {
        let share = |m: &Mode| {
            let parts = places.parts(&model, &rest.configuration, m);
            parts.iter().find(|p| p.part == part).map_or(0.0, |p| p.share)
        };
        let tried = all.iter().take(40);
        tried.max_by(|a, b| share(a).total_cmp(&share(b))).expect("a mode")
    };
    let kinds = [("sprockets.driven", of("sprockets.driven")), ("the first", &all[0]), ("the ninth", &all[8])];
    for (name, mode) in kinds {
        let (hz, zeta) = swings(&model, &rest, mode, 2e-7);
        println!(
            "{name}: {:.3} Hz, by itself {hz:.3}; damping {:.4} %, by itself {:.4} %",
            mode.frequency_hz(),
            100.0 * mode.damping_ratio,
            100.0 * zeta
        );
        assert!((hz / mode.frequency_hz() - 1.0).abs() < 2e-3, "{name}");
        assert!((zeta - mode.damping_ratio).abs() < 0.03 * mode.damping_ratio + 2e-5, "{name}");
    }
}

/// Waves across a span between fixed ends: masses m at distances p under T, w = 2 sqrt(T/(m p)) sin(k pi/(2 (n + 1))), n the joints that no tooth
/// holds. Links are as long as that and no points, which changes the lowest ones by some 0.4 %.
#[test]
fn spans_swing_across_like_strings() {
    let sets = [&NO_FRICTION[..], &["loads.constant.driven.torque_nm=0", "sprockets.driven.inertia_kg_m2=1"]].concat();
    let (model, rest) = held(&without_guides(BUNDLED[0].1, &sets));
    let all = modes(&model, &rest.configuration, Plungers::Oil).expect("modes");
    let places = LinkPlaces::new(&model, &rest.configuration);
    let lane = model.chain.links().next().expect("a link");
    let pitch_m = 2.0 * model.chain.lever[lane];
    let mass = model.chain.mass.iter().sum::<f64>() / model.chain.n_links as f64;
    // Joints whose bushes lie in gaps.
    let state = resting_state(&model, &rest.configuration);
    let mut scratch = Scratch::new(&model);
    explicit::evaluate(&model, &state, &mut scratch).expect("holds");
    let contacts = contacts_of(&model, &state, &scratch, None);
    let n = model.chain.n_links;
    let mut is_held = vec![false; n];
    for (link, feature) in contacts.link.iter().zip(&contacts.feature) {
        let is_front = *feature == Feature::FrontBush as u32;
        is_held[if is_front { *link as usize } else { (*link as usize + n - 1) % n }] = true;
    }
    let starts = (0..n).filter(|j| is_held[*j] && !is_held[(j + 1) % n]);
    let free: Vec<usize> =
        starts.map(|j| (1..n).take_while(|d| !is_held[(j + d) % n]).count()).filter(|free| *free > 5).collect();
    println!("free joints {free:?}");
    assert_eq!(free.len(), 2);
    // On the wraps it is less: teeth bear a part.
    let of_spans: Vec<f64> = (0..n).filter(|j| !is_held[*j]).map(|j| rest.tensions_n[j]).collect();
    let tension_n = of_spans.iter().sum::<f64>() / of_spans.len() as f64;
    let across = |m: &&Mode| {
        let parts = places.parts(&model, &rest.configuration, m);
        parts.iter().filter(|p| p.part.ends_with("across")).map(|p| p.share).sum::<f64>() > 0.8
    };
    let found: Vec<f64> = all.iter().filter(across).map(Mode::frequency_hz).collect();
    for k in 1..=3_u32 {
        let angle = f64::from(k) * PI / (2.0 * (free[0] + 1) as f64);
        let expected = 2.0 * (tension_n / (mass * pitch_m)).sqrt() * angle.sin() / (2.0 * PI);
        // Both spans have each frequency.
        let near = found.iter().filter(|hz| (**hz / expected - 1.0).abs() < STRING).count();
        println!("{k}: string {expected:.2} Hz, found {:.2?}", &found[..8.min(found.len())]);
        assert_eq!(near, 2, "{k}: {expected} Hz");
    }
}

/// Relative; measured 0.4 % and less.
const STRING: f64 = 0.01;

/// Plungers that stand still hold an arm and its span harder than their oil, and that harder than their springs.
#[test]
fn the_lowest_mode_of_the_arm_hangs_on_its_plunger() {
    let (model, rest) = held(&bundled("tensioner-20-40", &[]));
    let places = LinkPlaces::new(&model, &rest.configuration);
    let arm = |m: &Mode| {
        let parts = places.parts(&model, &rest.configuration, m);
        parts.iter().filter(|p| p.part == "arms.tensioner").map(|p| p.share).sum::<f64>()
    };
    let of = [Plungers::Open, Plungers::Oil, Plungers::Locked].map(|how| {
        let all = modes(&model, &rest.configuration, how).expect("modes");
        // The lowest frequency in which the arm has a part.
        let lowest = all.iter().find(|m| arm(m) > 0.02).expect("a mode");
        println!(
            "{how:?}: {:.1} Hz, {:.0} % in the arm, {} modes",
            lowest.frequency_hz(),
            100.0 * arm(lowest),
            all.len()
        );
        (lowest.frequency_hz(), all.len())
    });
    assert!(of[0].0 < 0.5 * of[1].0 && of[1].0 <= of[2].0, "{of:?}");
    assert_eq!(of.map(|o| o.1), [of[2].1 + 1, of[2].1 + 1, of[2].1], "one plunger");
}

/// Modes on the command line: numbers as JSON, a motion as a recording that reads; what makes no sense is refused.
#[test]
fn modes_are_printed_and_recorded() {
    let pitchline = |args: &[&str]| {
        std::process::Command::new(env!("CARGO_BIN_EXE_pitchline")).arg("modes").args(args).output().expect("it starts")
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mode.mcap");
    let out = pitchline(&["bush-20-40", "--json", "--mode", "9", "-o", path.to_str().expect("a path")]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let told: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    let mode = &told["modes"][9];
    assert_eq!((mode["number"].as_u64(), mode["moves"][0]["part"].as_str()), (Some(9), Some("sprockets.driven")));
    let mut reader = pitchline::recording::reader::Reader::open(&path).expect("readable");
    let (first, last) = reader.ends().expect("frames").expect("frames");
    let period_s = 1.0 / mode["frequency_hz"].as_f64().expect("a number");
    assert!((last.t_s - first.t_s - 4.0 * period_s).abs() < 1e-6 * period_s, "{} {period_s}", last.t_s);
    for (args, says) in [
        (&["bush-20-40", "--mode", "9999", "-o", "a.mcap"][..], "has no mode 9999"),
        (&["bush-20-40", "--below=-3"], "there are no modes below it"),
        (&["bush-20-40", "--mode", "3"], "--output"),
    ] {
        let out = pitchline(args);
        let error = String::from_utf8_lossy(&out.stderr);
        assert!(!out.status.success() && error.contains(says), "{args:?}: {error}");
    }
}

/// Kicks as the command line gives them.
fn kicked(drive: &Drive, listen_s: f64, instants: usize) -> RunningModes {
    let assembly = assemble(drive).unwrap_or_else(|e| panic!("{e}"));
    let plan = KickPlan { settle_s: 0.2, listen_s, instants, highest_hz: 300.0, threads: 2 };
    running_modes(&assembly.model, assembly.state, &plan).unwrap_or_else(|e| panic!("{e}"))
}

/// A drive that stands still without friction: kicked copies swing in the modes of the linearised drive.
#[test]
fn kicked_at_rest_a_drive_has_the_modes_of_its_rest() {
    let mut overrides = NO_FRICTION.to_vec();
    overrides.extend(["speeds.constant.driver.speed_rpm=0", "chain.joint.damping_n_s_per_m=400"]);
    let drive = bundled("bush-20-40", &overrides);
    let (model, rest) = held(&drive);
    let exact = modes(&model, &rest.configuration, Plungers::Oil).expect("modes");
    let found = kicked(&drive, 0.3, 4);
    assert_eq!(found.instants, 1);
    assert!(found.left < 1e-3 && found.nonlinear < 1e-3 && found.varies == 0.0, "{found:?}");
    let mut met: Vec<f64> = Vec::new();
    for mode in &found.modes {
        let nearest = exact
            .iter()
            .min_by(|a, b| {
                (a.frequency_hz() - mode.frequency_hz).abs().total_cmp(&(b.frequency_hz() - mode.frequency_hz).abs())
            })
            .expect("modes");
        assert!(!met.contains(&nearest.frequency_hz()), "twice: {mode:?}");
        met.push(nearest.frequency_hz());
        let off = mode.frequency_hz / nearest.frequency_hz() - 1.0;
        assert!(off.abs() < 1e-4, "{:.3} Hz against {:.3} Hz", mode.frequency_hz, nearest.frequency_hz());
        assert!(
            (mode.damping_ratio - nearest.damping_ratio).abs() < 1e-4,
            "{:.3} Hz: {} against {}",
            mode.frequency_hz,
            mode.damping_ratio,
            nearest.damping_ratio
        );
    }
    let below = exact.iter().map(|m| m.frequency_hz()).filter(|hz| *hz < 300.0);
    println!("{met:.2?} Hz of {:.2?}", below.collect::<Vec<f64>>());
    assert!(met.len() >= 8, "{met:?}");
    let driven =
        found.modes.iter().find(|m| m.moves[0].part == "sprockets.driven").expect("the driven sprocket swings");
    assert!((driven.damping_ratio / 0.00788 - 1.0).abs() < 0.02, "{driven:?}");
}

/// Across a span that runs the first mode is that of a string that moves: f = (c^2 - v^2) / (2 L c), c^2 = T / m', T with its share by centrifugal forces
/// (Archibald and Emslie, Journal of Applied Mechanics 25 (1958), 347).
#[test]
fn a_running_span_swings_like_a_moving_string() {
    for (rpm, slower) in [(1500.0, 0.0), (3000.0, 0.1)] {
        let overrides = [format!("speeds.constant.driver.speed_rpm={rpm}")];
        let overrides: Vec<&str> = overrides.iter().map(String::as_str).collect();
        let drive = without_guides(include_str!("../assets/drives/bush-20-40.toml"), &overrides);
        let found = kicked(&drive, 0.15, 4);
        let first = &found.modes[0];
        assert_eq!(first.moves[0].part, "span driver-driven across", "{found:?}");
        // Mean tension where the slack span is in its middle, over a lap.
        let mut simulation = pitchline::simulate::Simulation::new(&drive).expect("it assembles");
        simulation.run(0.2, 0.1, &[]).expect("it runs");
        let model = simulation.model().clone();
        let [driver, driven] = [0, 1].map(|k| &model.sprockets[k]);
        let at = |s: &pitchline::model::SprocketModel| s.frame.origin_at(&[0.0; 8]);
        let (from, to) = (at(driver), at(driven));
        let radii = [driver, driven].map(|s| s.geometry.rolling_radius_m());
        let length_m = ((to - from).norm_squared() - (radii[1] - radii[0]).powi(2)).sqrt();
        let (mut sum, mut count) = (0.0, 0);
        for _ in 0..400 {
            simulation.run(2e-4, 1.0, &[]).expect("it runs");
            let frame = simulation.frame().expect("a frame");
            for (i, (x, y)) in frame.links.x_m.iter().zip(&frame.links.y_m).enumerate() {
                let share = (x - from.x) / (to.x - from.x);
                // The slack span lies on the side to which the driver gives its links.
                let gives = if driver.nominal_speed_rad_s > 0.0 { 1.0 } else { -1.0 };
                let is_slack = (y - from.y) * gives < 0.0;
                if (0.35..0.65).contains(&share) && is_slack {
                    sum += frame.joints.force_x_n[i].hypot(frame.joints.force_y_n[i]);
                    count += 1;
                }
            }
        }
        let tension_n = sum / f64::from(count);
        let v = model.chain_speeds_m_s[0];
        let lanes: Vec<usize> = model.chain.links().collect();
        let mass: f64 = lanes.iter().map(|i| model.chain.mass[*i] / (2.0 * model.chain.lever[*i])).sum();
        let c = (tension_n / (mass / lanes.len() as f64)).sqrt();
        let exact = (c * c - v * v) / (2.0 * length_m * c);
        println!(
            "{rpm} 1/min: {tension_n:.1} N, {length_m:.4} m, c {c:.2} m/s, {exact:.2} Hz, found {:.2} Hz",
            first.frequency_hz
        );
        assert!((first.frequency_hz / exact - 1.0).abs() < 0.02, "{} against {exact}", first.frequency_hz);
        // Without the terms of the moving string it would be another number.
        let still = c / (2.0 * length_m);
        assert!(first.frequency_hz < (1.0 - slower) * still, "{} {still}", first.frequency_hz);
        assert!(found.nonlinear < 0.1 && found.left < 0.02, "{found:?}");
    }
}

/// What cannot be: short responses are told how long they must be; options of the one kind do not go with the other.
#[test]
fn kicks_that_tell_nothing_are_refused() {
    let drive = bundled("bush-20-40", &[]);
    let assembly = assemble(&drive).expect("it assembles");
    let plan = KickPlan { settle_s: 0.0, listen_s: 1e-3, instants: 2, highest_hz: 300.0, threads: 1 };
    let error = running_modes(&assembly.model, assembly.state, &plan).expect_err("one millisecond");
    let RunningModesError::Short(need_s) = error else { panic!("{error}") };
    let plan = KickPlan { listen_s: need_s * 1.001, settle_s: 1e-3, ..plan };
    let assembly = assemble(&drive).expect("it assembles");
    assert!(running_modes(&assembly.model, assembly.state, &plan).is_ok(), "{need_s} s are enough");
    for args in [
        &["modes", "bush-20-40", "--running", "--plungers", "open"][..],
        &["modes", "bush-20-40", "--running", "--mode", "1", "-o", "a.mcap"],
        &["modes", "bush-20-40", "--running", "--kicks", "0"],
    ] {
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_pitchline")).args(args).output().expect("it starts");
        assert_eq!(out.status.code(), Some(2), "{args:?}");
    }
}
