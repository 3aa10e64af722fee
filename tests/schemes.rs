//! Schemes beside the leapfrog: each exact to what its equations say on small cases, of its order on chains, and the same to the bit.

mod common;

use common::{assembled, bundled};
use pitchline::assemble::{assemble, assemble_with};
use pitchline::drive::{BUNDLED, Drive, Scheme};
use pitchline::elements::contact_law::{ContactLaw, PairRadii, restitution_hysteresis};
use pitchline::elements::coordinate::{Coordinate, CoordinateKind, CoordinateMotion, CoordinateSpring};
use pitchline::elements::link_joint::LinkJoint;
use pitchline::geometry::chain::bush::{BushChain, RowSpec};
use pitchline::geometry::{Vec2, unit};
use pitchline::integrate::explicit::{ContactGroup, Scratch};
use pitchline::integrate::{Isa, scheme};
use pitchline::model::Model;
use pitchline::pairs::part_part::{Pad, Touch, TouchShape};
use pitchline::recording::capture::Camera;
use pitchline::simulate::Simulation;
use pitchline::state::State;
use std::f64::consts::PI;

const PRECISE: Scheme = Scheme::PredictorCorrector { tolerance_m_s: 1e-7 };

/// A ring of four links that nothing moves, with one coordinate that slides beside it.
fn slider(scheme: Scheme, step_s: f64, mass_kg: f64, spring: CoordinateSpring) -> (Model, State) {
    let chain = BushChain {
        pitch_m: 8e-3,
        bush_diameter_m: 5e-3,
        pin_diameter_m: 3.3e-3,
        inner_width_m: 5e-3,
        plate_height_m: 7e-3,
        plate_thickness_m: 1.5e-3,
        density_kg_m3: 7850.0,
        is_cranked: false,
        rollers: None,
        inner: RowSpec::default(),
        outer: RowSpec::default(),
    };
    let joint = LinkJoint {
        stiffness_n_per_m: 1e7,
        damping_n_s_per_m: 0.0,
        clearance_m: 0.0,
        friction_arm_m: 0.0,
        stick_speed_rad_s: 10.0,
    };
    let mut model = Model::chain_only(4, chain.rows().expect("rows").to_vec(), joint, step_s);
    model.scheme = scheme;
    model.coordinates.push(Coordinate {
        path: "sliders.mass".into(),
        kind: CoordinateKind::Slides,
        motion: CoordinateMotion::Free { inertia: mass_kg, load: 0.0 },
        spring,
        nominal_speed_rad_s: 0.0,
        reach_m: 1.0,
        rest_load: 0.0,
        is_held_at_rest: false,
        is_run_in: false,
    });
    let mut state = State::at_rest(&model.layout());
    for i in 0..4 {
        let e = unit(0.5 * PI * i as f64);
        (state.links.x[i], state.links.y[i]) = (4e-3 * e.x, 4e-3 * e.y);
        (state.links.cos[i], state.links.sin[i]) = (-e.y, e.x);
    }
    (model, state)
}

/// Sets place, speed and acceleration of the slider at the node.
fn release(model: &Model, state: &mut State, [place, speed, acceleration]: [f64; 3]) {
    let q = &mut state.coordinates;
    (q.angle[0], q.omega[0], q.alpha[0]) = (place, speed - 0.5 * model.step_s * acceleration, acceleration);
}

/// Place and speed of the slider at the node.
fn motion(model: &Model, state: &State) -> [f64; 2] {
    let q = &state.coordinates;
    [q.angle[0], q.omega[0] + 0.5 * model.step_s * q.alpha[0]]
}

/// The equations of Hilber, Hughes and Taylor for one mass on a spring, solved by hand for the new acceleration.
#[test]
fn a_mass_on_a_spring_moves_as_hht_says() {
    let (mass, k, x0) = (0.02, 5e5, 1e-3);
    for alpha in [0.0, -0.1, -1.0 / 3.0] {
        for step_s in [2e-5, 4e-4, 1e-2] {
            let spring = CoordinateSpring { stiffness: k, free: 0.0, damping: 0.0 };
            let (model, mut state) = slider(Scheme::Hht { alpha }, step_s, mass, spring);
            let mut scratch = Scratch::new(&model);
            release(&model, &mut state, [x0, 0.0, -k / mass * x0]);
            let (beta, gamma) = ((1.0 - alpha) * (1.0 - alpha) / 4.0, 0.5 - alpha);
            let (mut x, mut v, mut a) = (x0, 0.0, -k / mass * x0);
            let energy = |[x, v]: [f64; 2]| 0.5 * k * x * x + 0.5 * mass * v * v;
            let first = energy([x, v]);
            for _ in 0..200 {
                scheme::step(&model, &mut state, &mut scratch).expect("a solution");
                let known = x + step_s * v + step_s * step_s * (0.5 - beta) * a;
                let next =
                    (-(1.0 + alpha) * k * known + alpha * k * x) / (mass + (1.0 + alpha) * beta * step_s * step_s * k);
                let from = a;
                x = known + step_s * step_s * beta * next;
                v += step_s * ((1.0 - gamma) * from + gamma * next);
                a = next;
                let [found, speed] = motion(&model, &state);
                assert!((found - x).abs() < 1e-9 * x0, "alpha {alpha}, {step_s} s: {found} against {x}");
                assert!((speed - v).abs() < 1e-9 * x0 * (k / mass).sqrt(), "alpha {alpha}: {speed} against {v}");
            }
            let left = energy(motion(&model, &state)) / first;
            println!(
                "alpha {alpha:.3}, omega h {:.1}: {left:.3e} of the energy after 200 steps",
                step_s * (k / mass).sqrt()
            );
            match alpha {
                0.0 => assert!((left - 1.0).abs() < 1e-8, "the trapezoidal rule keeps it"),
                _ if step_s > 1e-4 => assert!(left < 0.2, "what has few steps a period is damped"),
                _ => assert!(left > 0.9, "and what has many is hardly"),
            }
        }
    }
}

/// A mass that flies against a stop on a spring comes back as fast as it came, after half a period; with the law that dissipates, with the
/// restitution that was asked for.
#[test]
fn a_mass_bounces_off_a_stop() {
    let (mass, k, v0) = (0.01, 1e7, 2.5);
    let e = 0.6_f64;
    let chi = restitution_hysteresis(e) / v0;
    for (law, comes_back) in [
        (ContactLaw::Linear { stiffness_n_per_m: k, damping_n_s_per_m: 0.0 }, 1.0),
        (ContactLaw::HuntCrossley { stiffness_n_per_m_n: k, exponent: 1.0, damping_s_per_m: chi }, e),
    ] {
        let run = |scheme: Scheme, step_s: f64, gap: f64| -> (f64, f64) {
            let (mut model, _) = slider(scheme, step_s, mass, CoordinateSpring::default());
            model.touches.push(Touch {
                path: "stop".into(),
                shape: TouchShape::Stop { coordinate: 0, limit: gap, sense: 1.0, lever_m: 1.0 },
                law,
                friction: 0.0,
                stick_speed_m_s: 1.0,
                radii: PairRadii { bush_m: 1e-3, body_m: f64::INFINITY },
            });
            let (_, links) = slider(scheme, step_s, mass, CoordinateSpring::default());
            let mut state = State::at_rest(&model.layout());
            state.links.clone_from(&links.links);
            let mut scratch = Scratch::new(&model);
            release(&model, &mut state, [0.0, v0, 0.0]);
            let steps = (1.5e-3 / step_s).round() as u64;
            for _ in 0..steps {
                scheme::step(&model, &mut state, &mut scratch).expect("a solution");
            }
            let [x, v] = motion(&model, &state);
            // Where it would have turned, had it turned at once: from the gap, out and back, less the time of contact.
            let t = steps as f64 * step_s;
            (v, t - gap / v0 + (gap - x) / v)
        };
        let contact_s = PI * (mass / k).sqrt();
        let mut worst = [0.0_f64; 3];
        for gap in [1.013e-3, 1.047e-3, 1.091e-3] {
            let (v, t) = run(PRECISE, 2e-5, gap);
            worst[0] = worst[0].max((-v / v0 - comes_back).abs());
            if comes_back == 1.0 {
                worst[1] = worst[1].max((t / contact_s - 1.0).abs());
            }
            for step_s in [2e-6, 1e-6] {
                let (v, _) = run(Scheme::Hht { alpha: 0.0 }, step_s, gap);
                worst[2] = worst[2].max((-v / v0 - comes_back).abs());
            }
        }
        println!(
            "restitution {comes_back}: predictor and corrector off by {:.1e}, time {:.1e}; HHT {:.1e}",
            worst[0], worst[1], worst[2]
        );
        assert!(worst[0] < 1e-5 && worst[1] < 1e-5, "{worst:?}");
        assert!(worst[2] < 2e-3, "{worst:?}");
    }
}

/// State of a run of a bundled drive after a time, and the error of its ledger over what was put in, taken out and lost.
fn after(name: &str, time_s: f64, set: &[&str]) -> (Model, State, f64) {
    let a = assembled(&bundled(name, set));
    let (mut state, mut scratch) = (a.state, Scratch::new(&a.model));
    let mut camera = Camera::default();
    let steps = (time_s / a.model.step_s).round() as u64;
    for step in 0..=steps {
        scheme::evaluate(&a.model, &state, &mut scratch).unwrap_or_else(|e| panic!("{name}: {e}"));
        if step == steps {
            break;
        }
        if step == 0 {
            camera.take(&a.model, &state, &scratch);
        }
        scheme::advance(&a.model, &mut state, &mut scratch);
    }
    let energy = camera.take(&a.model, &state, &scratch).energy;
    let turned_over_j = energy.put_in_j().abs() + energy.work_out_j.abs() + energy.lost_j();
    (a.model, state, energy.error_j / turned_over_j)
}

/// Largest distance of links in two States [m].
fn apart_m(a: &State, b: &State, model: &Model) -> f64 {
    let of = |i: usize| (a.links.x[i] - b.links.x[i]).hypot(a.links.y[i] - b.links.y[i]);
    model.chain.links().map(of).fold(0.0, f64::max)
}

/// Three schemes go to one motion as their steps become short, each in its order.
#[test]
fn schemes_agree_on_a_chain() {
    let time_s = 0.4e-3;
    let set = |scheme: &str, more: &str| {
        let all = format!("run.scheme=\"{scheme}\" {more}");
        let all: Vec<String> = all.split_whitespace().map(str::to_string).collect();
        after("bush-20-40", time_s, &all.iter().map(String::as_str).collect::<Vec<_>>())
    };
    // Runs begin where the leapfrog has run the drive in, with its default step.
    let (model, exact, ledger) = set("predictor_corrector", "run.step_us=4 run.tolerance_um_s=0.1");
    println!("predictor and corrector at 0.1 um/s: ledger {ledger:.1e}");
    assert!(ledger.abs() < 1e-6);
    let mut before = f64::NAN;
    for tolerance in [100, 10, 1] {
        let (_, state, ledger) = set("predictor_corrector", &format!("run.step_us=4 run.tolerance_um_s={tolerance}"));
        let off = apart_m(&state, &exact, &model);
        println!("predictor and corrector at {tolerance} um/s: {:.3} nm, ledger {ledger:.1e}", off * 1e9);
        assert!(before.is_nan() || off < 0.7 * before, "it falls with the tolerance");
        before = off;
    }
    assert!(before < 5e-9, "{before}");
    let mut offs = Vec::new();
    for step_us in [2.0, 1.0, 0.5] {
        let (_, state, ledger) = set("hht", &format!("run.step_us={step_us} run.hht_alpha=-0.1"));
        let off = apart_m(&state, &exact, &model);
        println!("HHT at {step_us} us: {:.3} nm, ledger {ledger:.1e}", off * 1e9);
        offs.push(off);
        assert!(ledger.abs() < 2e-4);
    }
    // Where in a step a touch falls is not told to it: order two between touches, and by chance of their places.
    assert!(offs[2] < 0.1 * offs[0], "{offs:?}");
    let (_, leapfrog, _) = set("leapfrog", "");
    let off = apart_m(&leapfrog, &exact, &model);
    println!("leapfrog at 3.2 us: {:.3} nm", off * 1e9);
    assert!(off < 1e-6);
}

/// Every bundled drive runs under both schemes, and its joules add up.
#[test]
fn every_bundled_drive_runs_under_other_schemes() {
    for (name, _) in BUNDLED {
        for scheme in ["hht", "predictor_corrector"] {
            let scheme_set = format!("run.scheme=\"{scheme}\"");
            // The implicit scheme is for rollers that are parts of links.
            let in_links = (name == "roller-20-40" && scheme == "hht").then_some("chain.bush.rollers.body=\"link\"");
            let set: Vec<&str> = std::iter::once(&scheme_set[..]).chain(in_links).collect();
            let (_, _, ledger) = after(name, 0.5e-3, &set);
            println!("{name}, {scheme}: ledger {ledger:.1e}");
            let most = if scheme == "hht" { 2e-4 } else { 1e-5 };
            assert!(ledger.abs() < most, "{name}, {scheme}: {ledger}");
        }
    }
}

/// Any vector unit, and a run that goes on from a keyframe, give the same bits.
#[test]
fn schemes_give_the_same_bits() {
    for (scheme, step) in [("hht", "10"), ("predictor_corrector", "10"), ("moreau", "2")] {
        let drive = bundled("bush-20-40", &[&format!("run.scheme=\"{scheme}\""), &format!("run.step_us={step}")]);
        let step = |model: &Model, state: &mut State, scratch: &mut Scratch, steps: u32| {
            for _ in 0..steps {
                scheme::step(model, state, scratch).expect("the run holds");
            }
        };
        let mut hashes = Vec::new();
        for isa in Isa::available() {
            let a = assemble_with(&drive, isa).expect("it is assembled");
            let mut state = a.state.clone();
            step(&a.model, &mut state, &mut Scratch::with_isa(&a.model, isa), 60);
            hashes.push(state.hash());
            let mut first = a.state.clone();
            step(&a.model, &mut first, &mut Scratch::with_isa(&a.model, isa), 23);
            let mut resumed = a.state.clone();
            resumed.restore(&first.keyframe()).expect("the keyframe fits");
            step(&a.model, &mut resumed, &mut Scratch::with_isa(&a.model, isa), 37);
            hashes.push(resumed.hash());
        }
        assert!(hashes.iter().all(|h| *h == hashes[0]), "{scheme}: {hashes:x?}");
        assert_ne!(hashes[0], assemble(&drive).expect("it is assembled").state.hash());
    }
}

/// What a scheme cannot do is refused with its place in the file.
#[test]
fn what_schemes_cannot_do_is_refused() {
    let text = BUNDLED.iter().find(|b| b.0 == "roller-20-40").expect("a bundled drive").1;
    let refused = |text: &str, set: &[&str], what: &str| {
        let set: Vec<String> = set.iter().map(|s| (*s).to_string()).collect();
        let said = match Drive::parse("x.toml", text, &set) {
            Err(report) => report.to_string(),
            Ok(drive) => assemble(&drive).err().map_or_else(String::new, |e| e.to_string()),
        };
        assert!(said.contains(what), "{what}: {said}");
    };
    refused(text, &["run.scheme=\"hht\""], "rollers that are bodies");
    let text = BUNDLED.iter().find(|b| b.0 == "bmw318").expect("a bundled drive").1;
    refused(text, &["run.scheme=\"hht\"", "run.step_us=900"], "moves too far");
    refused(text, &["run.scheme=\"hht\"", "run.hht_alpha=-0.5"], "hht_alpha");
    refused(text, &["run.hht_alpha=-0.1"], "hht_alpha");
    refused(text, &["run.scheme=\"predictor_corrector\"", "run.tolerance_um_s=0"], "tolerance_um_s");
    refused(text, &["run.scheme=\"euler\""], "none of \"leapfrog\"");
}

/// A mass that strikes a rigid stop comes back as Newton's law of impact says, and the ledger holds what is gone.
#[test]
fn rigid_parts_part_as_newton_says() {
    for restitution in [0.0, 0.4, 1.0] {
        let step_s = 1e-6;
        let spring = CoordinateSpring::default();
        let (mut model, links) = slider(Scheme::Moreau { restitution }, step_s, 0.03, spring);
        let light = Coordinate {
            path: "sliders.light".into(),
            motion: CoordinateMotion::Free { inertia: 0.01, load: 0.0 },
            ..model.coordinates[0].clone()
        };
        model.coordinates.push(light);
        let stop = Touch {
            path: "stop".into(),
            shape: TouchShape::Stop { coordinate: 1, limit: 2e-3, sense: 1.0, lever_m: 1.0 },
            law: ContactLaw::NONE,
            friction: 0.0,
            stick_speed_m_s: 1.0,
            radii: PairRadii { bush_m: 1e-3, body_m: f64::INFINITY },
        };
        model.touches.push(stop);
        let mut state = State::at_rest(&model.layout());
        state.links.clone_from(&links.links);
        let mut scratch = Scratch::new(&model);
        let v0 = 2.5;
        state.coordinates.omega = vec![0.0, v0];
        let energy = |omega: &[f64]| 0.5 * 0.03 * omega[0] * omega[0] + 0.5 * 0.01 * omega[1] * omega[1];
        for _ in 0..1500 {
            scheme::step(&model, &mut state, &mut scratch).expect("a solution");
        }
        let v = state.coordinates.omega[1];
        assert!((v + restitution * v0).abs() < 1e-9, "e = {restitution}: {v}");
        let lost = state.touches.lost_damping[0];
        let gone = energy(&[0.0, v0]) - energy(&state.coordinates.omega);
        assert!((lost - gone).abs() < 1e-12, "e = {restitution}: lost {lost}, gone {gone}");
        println!("e = {restitution}: {v:.9} m/s, {lost:.3e} J lost");
    }
}

/// The chain on rigid teeth: contacts keep Coulomb's cone and do not pull, bodies overlap by no more than a step's way, and every joule is
/// accounted for. Its tensions are those of the chain on stiff teeth.
#[test]
fn a_chain_runs_on_rigid_teeth() {
    let tension = |scheme: &str, steps: u32| {
        let step = format!("run.step_us={}", 1e4 / f64::from(steps));
        let a = assembled(&bundled("bush-20-40", &[&format!("run.scheme=\"{scheme}\""), &step]));
        let (mut state, mut scratch, mut camera) = (a.state, Scratch::new(&a.model), Camera::default());
        let (mut sum, mut count, mut error, mut contacts) = (0.0, 0.0, 0.0, 0);
        for step in 0..steps {
            scheme::evaluate(&a.model, &state, &mut scratch).expect("a solution");
            if step % 25 == 0 {
                let frame = camera.take(&a.model, &state, &scratch);
                sum +=
                    frame.joints.force_x_n.iter().zip(&frame.joints.force_y_n).map(|(x, y)| x.hypot(*y)).sum::<f64>();
                count += frame.joints.force_x_n.len() as f64;
                error = frame.energy.error_j / frame.energy.put_in_j().max(1e-3);
                let c = &frame.contacts;
                for k in (0..c.link.len()).filter(|k| c.body[*k] < 2) {
                    assert!(c.normal_force_n[k] >= 0.0);
                    assert!(c.tangential_force_n[k].abs() <= 0.1 * c.normal_force_n[k] + 1e-6);
                    contacts += 1;
                }
            }
            scheme::advance(&a.model, &mut state, &mut scratch);
        }
        (sum / count, error, contacts, scheme::summary(&scratch))
    };
    let (elastic, _, _, _) = tension("leapfrog", 5000);
    let (rigid, error, contacts, told) = tension("moreau", 5000);
    let (_, finer, _, _) = tension("moreau", 10_000);
    println!(
        "mean tension {rigid:.1} N on rigid teeth, {elastic:.1} N on stiff ones; ledger {error:.1e}, {finer:.1e} with half the step; {told:?}"
    );
    assert!((rigid / elastic - 1.0).abs() < 0.05 && contacts > 1000);
    // Joints see a step's impulses one step late.
    assert!(error.abs() < 2e-3 && finer.abs() < 0.5 * error.abs());
}

/// A node that is evaluated twice, or looked at more or less often, is the same node.
#[test]
fn looking_twice_changes_nothing() {
    for scheme in ["hht", "predictor_corrector", "moreau"] {
        let a = assembled(&bundled("tensioner-20-40", &[&format!("run.scheme=\"{scheme}\"")]));
        let run = |looks: u32, refresh: u64| {
            let (mut state, mut scratch) = (a.state.clone(), Scratch::new(&a.model));
            scratch.refresh_steps = refresh;
            for _ in 0..40 {
                for _ in 0..looks {
                    scheme::evaluate(&a.model, &state, &mut scratch).expect("a solution");
                }
                scheme::advance(&a.model, &mut state, &mut scratch);
            }
            state.hash()
        };
        let once = run(1, 64);
        assert_eq!(once, run(2, 64), "{scheme}, evaluated twice");
        assert_eq!(once, run(1, 1), "{scheme}, looked at in every step");
        assert_eq!(once, run(1, 1000), "{scheme}, looked at seldom");
    }
}

/// All laws of contact, with steps that are short and long against the impact: each mass comes back as its law says, and the ledger closes.
#[test]
fn every_law_holds_under_every_scheme() {
    let (mass, k, v0) = (0.01, 1e7, 2.5);
    let e = 0.6_f64;
    let power = |hysteresis: f64| ContactLaw::Power { stiffness_n_per_m_n: k, exponent: 1.0, hysteresis };
    for (name, law, comes_back) in [
        ("restitution", power(restitution_hysteresis(e)), Some(e)),
        ("linear with a damper", ContactLaw::Linear { stiffness_n_per_m: k, damping_n_s_per_m: 100.0 }, None),
    ] {
        let run = |scheme: Scheme, step_s: f64, gap: f64| -> (f64, f64, f64) {
            let (mut model, links) = slider(scheme, step_s, mass, CoordinateSpring::default());
            model.touches.push(Touch {
                path: "stop".into(),
                shape: TouchShape::Stop { coordinate: 0, limit: gap, sense: 1.0, lever_m: 1.0 },
                law,
                friction: 0.0,
                stick_speed_m_s: 1.0,
                radii: PairRadii { bush_m: 1e-3, body_m: f64::INFINITY },
            });
            let mut state = State::at_rest(&model.layout());
            state.links.clone_from(&links.links);
            let mut scratch = Scratch::new(&model);
            release(&model, &mut state, [0.0, v0, 0.0]);
            let mut approach = 0.0;
            for _ in 0..(1.5e-3 / step_s).round() as u64 {
                scheme::step(&model, &mut state, &mut scratch).expect("a solution");
                approach = f64::max(approach, state.touches.approach[0]);
            }
            let [_, v] = motion(&model, &state);
            let gone = 0.5 * mass * (v0 * v0 - v * v);
            (-v / v0, state.touches.lost_damping[0] / gone - 1.0, approach / v0 - 1.0)
        };
        // The damper's law in closed form: a half wave that is damped, ended where its force is zero.
        let c = 100.0_f64;
        let zeta = c / (2.0 * (k * mass).sqrt());
        let turn = (1.0 - zeta * zeta).sqrt();
        let expected = comes_back.unwrap_or_else(|| {
            let phase = (2.0 * zeta * turn).atan2(1.0 - 2.0 * zeta * zeta);
            (-zeta / turn * (PI - phase)).exp()
        });
        for (scheme, step_s, off, ledger, touch) in [
            (PRECISE, 1e-6, 1e-4, 1e-4, 1e-3),
            (PRECISE, 2e-5, 1e-4, 1e-4, 1e-3),
            (Scheme::Hht { alpha: 0.0 }, 1e-6, 0.02, 0.1, 0.05),
        ] {
            let mut worst = [0.0_f64; 3];
            for gap in [1.013e-3, 1.047e-3, 1.091e-3] {
                let (back, lost, approach) = run(scheme, step_s, gap);
                for (worst, off) in worst.iter_mut().zip([back / expected - 1.0, lost, approach]) {
                    *worst = worst.max(off.abs());
                }
            }
            println!(
                "{name}, {scheme:?}, {step_s} s: comes back off by {:.1e}, ledger {:.1e}, approach {:.1e}",
                worst[0], worst[1], worst[2]
            );
            assert!(worst[0] < off && worst[1] < ledger && worst[2] < touch, "{worst:?}");
        }
    }
}

/// First touches of bushes and their speeds of approach are those of the leapfrog with a short step, also where nodes are far apart.
#[test]
fn touches_have_the_same_speeds() {
    let touches = |set: &[&str]| {
        let a = assembled(&bundled("bush-20-40", set));
        let (mut state, mut scratch) = (a.state, Scratch::new(&a.model));
        let mut found: Vec<(usize, f64)> = Vec::new();
        for _ in 0..(2e-3 / a.model.step_s).round() as u64 {
            scheme::evaluate(&a.model, &state, &mut scratch).expect("a solution");
            let memory = scratch.memory(ContactGroup::Bushes);
            for lane in (0..90).filter(|lane| memory.age[*lane] == 1.0 && memory.approach[*lane] > 0.4) {
                found.push((lane, memory.approach[lane]));
            }
            scheme::advance(&a.model, &mut state, &mut scratch);
        }
        // Two that touch at nearly the same time may change places.
        found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        found
    };
    let exact = touches(&["run.scheme=\"leapfrog\"", "run.step_us=0.25"]);
    for (scheme, step, share) in [("predictor_corrector", "5", 0.03), ("hht", "1", 0.1)] {
        let own = touches(&[&format!("run.scheme=\"{scheme}\""), &format!("run.step_us={step}")]);
        println!("{scheme}: {own:.3?}\nexact: {exact:.3?}");
        let same = exact.iter().zip(&own).filter(|((a, u), (b, v))| a == b && (u / v - 1.0).abs() < share).count();
        assert!(exact.len() >= 4 && own.len() == exact.len() && same == exact.len(), "{scheme}: {same}");
    }
}

/// A slider's tip strikes the pad of an arm: both are rigid and free. They part with the restitution of their closing speed, and what one
/// loses of its impulse the other gains, each by its lever; with friction as well, which turns against the sliding and stays within its cone.
#[test]
fn a_rigid_tip_strikes_an_arm() {
    for (restitution, friction) in [(0.0, 0.0), (0.5, 0.2), (1.0, 0.0)] {
        let step_s = 1e-6;
        let (mass, inertia) = (0.02, 3e-5);
        let (mut model, links) = slider(Scheme::Moreau { restitution }, step_s, mass, CoordinateSpring::default());
        let arm = Coordinate {
            path: "arms.arm".into(),
            kind: CoordinateKind::Turns,
            motion: CoordinateMotion::Free { inertia, load: 0.0 },
            ..model.coordinates[0].clone()
        };
        model.coordinates.push(arm);
        model.touches.push(Touch {
            path: "tip".into(),
            shape: TouchShape::Tip {
                slider: 0,
                centre: Vec2::new(0.04, -3e-3),
                direction: Vec2::new(0.0, 1.0),
                radius_m: 2e-3,
                arm: 1,
                pivot: Vec2::zeros(),
                pad: Pad::Flat { normal: unit(-0.5 * PI + 0.3), offset_m: -0.012 },
            },
            law: ContactLaw::NONE,
            friction,
            stick_speed_m_s: 1.0,
            radii: PairRadii { bush_m: 2e-3, body_m: f64::INFINITY },
        });
        let mut state = State::at_rest(&model.layout());
        state.links.clone_from(&links.links);
        let mut scratch = Scratch::new(&model);
        let gap = |state: &State| model.touches[0].shape.gap(&state.coordinates.angle);
        let begin = gap(&state);
        assert!(begin.gap_m > 0.0, "they are apart: {}", begin.gap_m);
        let before = [1.5, 0.0];
        state.coordinates.omega = before.to_vec();
        let mut struck = None;
        for _ in 0..20_000 {
            let at = gap(&state);
            scheme::step(&model, &mut state, &mut scratch).expect("a solution");
            if state.touches.normal_force[0] > 1.0 {
                struck = Some(at);
                break;
            }
        }
        let at = struck.expect("the tip strikes the arm");
        let after = &state.coordinates.omega;
        let speed = |by: [f64; 2], v: &[f64]| by[0] * v[0] + by[1] * v[1];
        let (closing, opening) = (speed(at.slope, &before), speed(at.slope, after));
        assert!(closing < -0.1, "{closing}");
        assert!((opening + restitution * closing).abs() < 1e-9, "e = {restitution}: {closing} to {opening}");
        // Two impulses, normal and tangential, give both changes.
        let changes = [mass * (after[0] - before[0]), inertia * (after[1] - before[1])];
        let det = at.slope[0] * at.slide[1] - at.slope[1] * at.slide[0];
        let normal = (changes[0] * at.slide[1] - changes[1] * at.slide[0]) / det;
        let tangential = (at.slope[0] * changes[1] - at.slope[1] * changes[0]) / det;
        let sliding = speed(at.slide, after);
        println!(
            "e = {restitution}, mu = {friction}: normal {normal:.6} N s, tangential {tangential:.6} N s, slides {sliding:.3} m/s"
        );
        assert!(normal > 0.0 && tangential.abs() <= friction * normal + 1e-12);
        if friction > 0.0 {
            assert!(sliding.abs() < 1e-9 || (tangential + sliding.signum() * friction * normal).abs() < 1e-9);
        }
        let energy = |v: &[f64]| 0.5 * mass * v[0] * v[0] + 0.5 * inertia * v[1] * v[1];
        let lost = state.touches.lost_damping[0] + state.touches.lost_friction[0];
        assert!((energy(&before) - energy(after) - lost).abs() < 1e-12);
    }
}

/// A break on the force of a rigid contact is hit where a frame holds that force.
#[test]
fn breaks_see_rigid_contacts() {
    let drive = bundled("bush-20-40", &["run.scheme=\"moreau\"", "run.step_us=2"]);
    let mut simulation = Simulation::new(&drive).expect("it is assembled");
    simulation.stop_at("contact.normal_force > 400 N").expect("an expression");
    let summary = simulation.run(5e-3, 1e-4, &[]).expect("it runs");
    let hit = summary.hits.first().expect("a hit");
    let frame = simulation.frame().expect("a frame");
    let most = frame.contacts.normal_force_n.iter().copied().fold(0.0, f64::max);
    println!("hit at {:.4} ms: {most:.1} N", hit.t_s * 1e3);
    assert!(most > 400.0);
}
