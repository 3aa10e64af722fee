//! Valve trains. Sources of truth: the lift law of a rigid follower and its spring, T = F ds/dtheta, the energy ledger, the frequencies of a chain of
//! masses and of a continuous spring, and the orders of the torque computed by hand.

mod common;

use common::{assembled, watch};
use pitchline::assemble::Assembly;
use pitchline::drive::{BUNDLED, Drive};
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::Model;
use pitchline::pairs::part_part::CamTouch;
use pitchline::recording::capture::Camera;
use pitchline::simulate::LiftOffWatch;
use pitchline::state::State;
use std::f64::consts::PI;

/// Three cylinders, whose two valves move as one, on the driven sprocket of the bush drive; laws without losses.
const VALVES: &str = r#"
[valves.intake]
body = "driven"
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
friction = 0
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

fn parsed(more: &str, sets: &[&str]) -> Result<Drive, String> {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    let (name, text) = BUNDLED[0];
    Drive::parse(name, &format!("{text}{more}"), &sets).map_err(|report| report.to_string())
}

fn drive(sets: &[&str]) -> Assembly {
    assembled(&parsed(VALVES, sets).unwrap_or_else(|e| panic!("{e}")))
}

fn cams(model: &Model) -> Vec<(usize, CamTouch)> {
    let place = |cam: &CamTouch| {
        model
            .touches
            .iter()
            .position(|t| t.shape.gap(&vec![0.0; model.coordinates.len()]).coordinates == [cam.follower, cam.shaft])
    };
    model.cams().map(|cam| (place(cam).expect("there"), cam.clone())).collect()
}

/// While a cam lifts, its follower is where the cam holds it, yielding by F/k, and the force is that of the spring and the inertia of a rigid part:
/// F = F0 + k s + m s'' w^2. On the base circle the valve rests on its seat.
#[test]
fn a_follower_goes_where_its_cam_lifts_it() {
    let a = drive(&["speeds.constant.driver.speed_rpm=1500"]);
    let model = &a.model;
    let own = cams(model);
    let (mut state, mut worst, mut largest) = (a.state.clone(), [0.0_f64; 3], 0.0_f64);
    watch(model, &mut state, 25_000, |state, scratch| {
        let q = &state.coordinates;
        for (touch, cam) in &own {
            let s = cam.lift(q.angle[cam.shaft]);
            let force = scratch.touches().normal_force[*touch];
            if s.lift_m == 0.0 {
                worst[0] = worst[0].max(q.angle[cam.follower].abs());
            } else if s.lift_m > 0.5e-3 {
                let w = q.omega[cam.shaft];
                let rigid = 280.0 + 4e4 * s.lift_m + 0.18 * s.bend_m * w * w;
                worst[1] = worst[1].max((q.angle[cam.follower] - s.lift_m + rigid / 4e7).abs());
                worst[2] = worst[2].max((force - rigid).abs());
                largest = largest.max(rigid);
            }
        }
    });
    println!(
        "off the seat {:.1e} m, off the cam {:.1e} m, off the rigid force {:.1} of {largest:.0} N",
        worst[0], worst[1], worst[2]
    );
    // The follower swings on its contact by what it was lifted with.
    assert!(worst[0] < 2e-6 && worst[1] < 2e-6 && worst[2] < 0.1 * largest);
}

/// With a rocker arm the valve goes further than its cam lifts, and presses on it with as much more: i (F0 + k i s + (m + J/l^2) i s'' w^2 + A p).
#[test]
fn rocker_arms_and_gas_load_their_cams() {
    let more = "\n[valves.intake.rocker]\nratio = 1.5\ninertia_kg_m2 = 4e-4\narm_mm = 30\n\n[valves.intake.gas]\nhead_mm = 30\n\
                angles_deg = [-180, -40, 0, 90]\npressures_bar = [0, 0, 6, 1]\n";
    let spec = parsed(&format!("{VALVES}{more}"), &["speeds.constant.driver.speed_rpm=1500"]);
    let a = assembled(&spec.unwrap_or_else(|e| panic!("{e}")));
    let (model, own) = (&a.model, cams(&a.model));
    let mass = 0.18 + 4e-4 / (0.03 * 0.03);
    let (mut state, mut worst, mut largest, mut gas_most) = (a.state.clone(), [0.0_f64; 2], 0.0_f64, 0.0_f64);
    let (mut camera, mut first, mut last, mut put_in) = (Camera::default(), None, 0.0, 0.0);
    let mut moved = [0.0; 2];
    watch(model, &mut state, 25_000, |state, scratch| {
        let q = &state.coordinates;
        for (touch, cam) in &own {
            let s = cam.lift(q.angle[cam.shaft]);
            if s.lift_m > 0.5e-3 {
                let angle = (cam.sense * q.angle[cam.shaft] + cam.offset_rad).to_degrees().rem_euclid(360.0);
                let angle = if angle > 180.0 { angle - 360.0 } else { angle };
                let bar = match angle {
                    a if a < -40.0 => 0.0,
                    a if a < 0.0 => 6.0 * (a + 40.0) / 40.0,
                    a => 6.0 - 5.0 * a / 90.0,
                };
                let gas = bar * 1e5 * 0.25 * PI * 0.03 * 0.03;
                let w = q.omega[cam.shaft];
                let on_cam = 1.5 * (280.0 + 4e4 * 1.5 * s.lift_m + mass * 1.5 * s.bend_m * w * w + gas);
                let force = scratch.touches().normal_force[*touch];
                worst[0] = worst[0].max((q.angle[cam.valve] - 1.5 * (s.lift_m - on_cam / 4e7)).abs());
                worst[1] = worst[1].max((force - on_cam).abs());
                let x = 1.5 * s.bend_m * w * w;
                let y = force / 1.5 - 280.0 - 4e4 * q.angle[cam.valve] - gas;
                moved = [moved[0] + x * x, moved[1] + x * y];
                (largest, gas_most) = (largest.max(on_cam), gas_most.max(gas));
            }
        }
        if state.step.is_multiple_of(1000) {
            let frame = camera.take(model, state, scratch);
            (last, put_in) = (frame.energy.error_j, frame.energy.put_in_j());
            first.get_or_insert(last);
            camera.give_back(frame);
        }
    });
    let error = (last - first.expect("frames")) / put_in;
    println!(
        "off the cam {:.1e} m, off the rigid force {:.1} of {largest:.0} N, gas up to {gas_most:.0} N; energy error {error:.1e}",
        worst[0], worst[1]
    );
    // The heavy rocker swings on the cam; the slope of the force over the acceleration is its mass all the same.
    let mass_found = moved[1] / moved[0];
    println!("{mass_found:.4} kg on the cam, {mass:.4} by the file");
    assert!((mass_found / mass - 1.0).abs() < 0.03);
    assert!(worst[0] < 12e-6 && worst[1] < 0.2 * largest && gas_most > 400.0 && error.abs() < 1e-4);
}

/// T = F ds/dtheta: what the cams turn their shaft with, by the lever of every force; and over whole turns springs give back what they take: what
/// the shaft puts in is lost in the contacts.
#[test]
fn springs_of_valves_do_no_net_work() {
    let a = drive(&["speeds.constant.driver.speed_rpm=1500"]);
    let (model, own) = (&a.model, cams(&a.model));
    let shaft = own[0].1.shaft;
    let mut state = a.state.clone();
    let turn = 2.0 * PI / model.coordinates[shaft].nominal_speed_rad_s.abs();
    let steps = (turn / model.step_s).round() as u64;
    let (mut work, mut swing, mut worst, mut before, mut after) = (0.0, 0.0_f64, 0.0_f64, None, None);
    watch(model, &mut state, 2 * steps + 1, |state, scratch| {
        let q = &state.coordinates;
        let lost: f64 = state.touches.lost_damping.iter().sum();
        if state.step == steps {
            before = Some(lost);
        } else if state.step == 2 * steps {
            after = Some(lost);
        }
        if state.step < steps || state.step >= 2 * steps {
            return;
        }
        let by_levers: f64 = own
            .iter()
            .map(|(touch, cam)| {
                let point = cam_point(model, *touch, q) - cam.axis;
                let force = -cam.direction * scratch.touches().normal_force[*touch];
                point.x * force.y - point.y * force.x
            })
            .sum();
        let torque = scratch.parts_force()[shaft];
        (worst, swing) = (worst.max((torque - by_levers).abs()), swing.max(torque.abs()));
        work -= torque * (q.omega[shaft] + 0.5 * model.step_s * scratch.coordinate_alpha()[shaft]) * model.step_s;
    });
    let lost = after.expect("taken") - before.expect("taken");
    println!(
        "torque up to {swing:.2} N m, off its levers {worst:.1e}; a turn takes {:.3} mJ, contacts lose {:.3} mJ",
        work * 1e3,
        lost * 1e3
    );
    assert!(worst < 1e-12 * swing);
    // The springs take and give back 12 J a turn; what is measured differs by 0.3 mJ, the stored energy at both ends of the turn.
    assert!((work - lost).abs() < 2e-4 * 12.0, "{work} {lost}");
}

fn cam_point(model: &Model, touch: usize, q: &pitchline::state::CoordinateState) -> pitchline::geometry::Vec2 {
    model.touches[touch].shape.gap(&q.angle).point
}

/// Energy with valves that float, surge and strike their seats; the same bits from a keyframe.
#[test]
fn the_ledger_closes_with_springs_that_surge() {
    let sets = [
        "valves.intake.spring_mass_g=100",
        "valves.intake.lash_um=150",
        "contact.cam.friction=0.08",
        "speeds.constant.driver.speed_rpm=9000",
    ];
    let a = drive(&sets);
    let model = &a.model;
    let (mut state, mut camera, mut lifted) = (a.state.clone(), Camera::default(), LiftOffWatch::new(model));
    let (mut first, mut last, mut put_in) = (None, 0.0, 0.0);
    watch(model, &mut state, 20_000, |state, scratch| {
        lifted.observe(model, state, scratch);
        if state.step.is_multiple_of(1000) {
            let frame = camera.take(model, state, scratch);
            (last, put_in) = (frame.energy.error_j, frame.energy.put_in_j());
            first.get_or_insert(last);
            camera.give_back(frame);
        }
    });
    let error = (last - first.expect("frames")) / put_in;
    let found = lifted.into_found();
    println!("energy error {error:.1e} of {put_in:.1} J; {}", found.first().map_or(String::new(), |l| l.text()));
    assert!(error.abs() < 1e-4 && found.len() == 3 && found[0].valve == "valves.intake.1");
    let keyframe = state.keyframe();
    let mut resumed = a.state.clone();
    resumed.restore(&keyframe).expect("the same drive");
    for state in [&mut state, &mut resumed] {
        watch(model, state, 500, |_, _| {});
    }
    assert_eq!(state.hash(), resumed.hash());
}

/// The first surge of a spring held at both ends: of n parts 2 sqrt(k_e/m_e) sin(pi/2n), and close to that of a wire, sqrt(k/m)/2 turns a second.
#[test]
fn a_spring_surges_at_its_frequency() {
    let a = drive(&[
        "valves.intake.spring_mass_g=100",
        "valves.intake.spring_parts=8",
        "valves.intake.spring_damping_percent=1",
        "contact.seat.linear.stiffness_n_per_m=6e9",
    ]);
    let (model, cam) = (&a.model, &cams(&a.model)[0].1);
    let masses = model.spring_masses(cam.follower);
    assert_eq!(masses.len(), 7);
    // While its valve rests on its seat.
    let mut state = a.state.clone();
    let mut scratch = Scratch::new(model);
    let is_closed = |state: &State| {
        (0..40).all(|i| {
            let ahead = f64::from(i) * 0.25e-3 * state.coordinates.omega[cam.shaft];
            cam.lift(state.coordinates.angle[cam.shaft] + ahead).lift_m == 0.0
        })
    };
    while !is_closed(&state) {
        explicit::step(model, &mut state, &mut scratch).expect("holds");
    }
    for (n, k) in masses.clone().enumerate() {
        state.coordinates.angle[k] = 1e-3 * f64::sin(PI * (n + 1) as f64 / 8.0);
        state.coordinates.omega[k] = 0.0;
    }
    let middle = masses.start + 3;
    let mut scratch = Scratch::new(model);
    let (mut crossings, mut before) = (Vec::new(), state.coordinates.angle[middle]);
    for _ in 0..2500 {
        explicit::step(model, &mut state, &mut scratch).expect("holds");
        let now = state.coordinates.angle[middle];
        if before > 0.0 && now <= 0.0 {
            crossings.push(state.step as f64 - now / (now - before));
        }
        before = now;
    }
    let period_s = (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64 * model.step_s;
    let (k, m) = (4e4_f64, 0.1_f64);
    let parts = 8.0 * f64::sqrt(k / m) * f64::sin(PI / 16.0) / PI * f64::sqrt(1.0 - 0.01 * 0.01);
    let wire = 0.5 * f64::sqrt(k / m);
    println!("surge {:.3} Hz; of parts {parts:.3} Hz, of a wire {wire:.3} Hz", 1.0 / period_s);
    assert!((1.0 / period_s / parts - 1.0).abs() < 1e-4 && (1.0 / period_s / wire - 1.0).abs() < 0.01);
}

/// Below the speed at which the spring can hold a rigid follower it stays on its cam, above it flies.
#[test]
fn followers_leave_their_cams_above_the_speed_of_their_springs() {
    let spec = parsed(VALVES, &[]).expect("a drive").valves.remove(0);
    // s'' is most negative at full lift: s'' = -2 L C2/a^2, C2 = 1.875.
    let half = 66.0_f64.to_radians();
    let known = f64::sqrt((280.0 + 4e4 * 8e-3) / (0.18 * 8e-3 * 2.0 * 1.875 / (half * half)));
    let floats = spec.floats_at_rad_s();
    println!("floats at {:.1} 1/min; at full lift {:.1} 1/min", floats * 30.0 / PI, known * 30.0 / PI);
    assert!(floats <= known && floats > 0.8 * known);
    let off = |share: f64| {
        let rpm = 2.0 * share * floats * 30.0 / PI;
        let a = drive(&[&format!("speeds.constant.driver.speed_rpm={rpm}"), "loads.constant.driven.torque_nm=5"]);
        let (mut state, mut seen) = (a.state.clone(), LiftOffWatch::new(&a.model));
        watch(&a.model, &mut state, 15_000, |state, scratch| drop(seen.observe(&a.model, state, scratch)));
        seen.into_found().iter().map(|l| l.widest_m).fold(0.0, f64::max)
    };
    let [below, above] = [off(0.85), off(1.15)];
    println!("flies by {:.1} um below, {:.1} um above", below * 1e6, above * 1e6);
    assert!(below == 0.0 && above > 20e-6);
}

/// Cams stay on their shafts where a run goes on with another speed or step; on a shaft that turns clockwise they count in its own sense.
#[test]
fn branches_keep_their_cams() {
    let a = drive(&[]);
    let faster = parsed(VALVES, &["speeds.constant.driver.speed_rpm=3500", "run.step_us=2"]).expect("a drive");
    let branch = pitchline::assemble::compile_in_place(&faster, &a.model).expect("compiles");
    let offsets = |model: &Model| model.cams().map(|cam| (cam.sense, cam.offset_rad)).collect::<Vec<_>>();
    assert_eq!(offsets(&a.model), offsets(&branch));
    let back = drive(&["speeds.constant.driver.speed_rpm=-3000"]);
    assert!(offsets(&back.model).iter().all(|(sense, _)| *sense == -1.0));
    let cam = cams(&back.model).remove(0).1;
    // From the start of the recording on in its own sense, 55 degrees to full lift.
    let turn = 55.0_f64.to_radians();
    let stretch = 1.5_f64.to_radians();
    let full = cam.lift(back.state.coordinates.angle[cam.shaft] - turn).lift_m;
    let beside = cam.law.at(stretch).lift_m;
    println!("full lift {:.4} mm, {beside:.2e} m a degree and a half beside it", full * 1e3);
    assert!(full >= beside, "{full}");
}

/// Viewers move what lies below a body with it: no body that moves has another below its path. Cams and valves are drawn, all of them.
#[test]
fn no_body_lies_below_another() {
    for name in ["gasoline-3cyl-bush", "tensioner-20-40", "v12"] {
        let drive = common::bundled(name, &[]);
        let model = pitchline::assemble::compile(&drive).unwrap_or_else(|e| panic!("{e}")).model;
        let paths: Vec<String> =
            pitchline::recording::capture::bodies(&drive, &model).into_iter().map(|b| b.path).collect();
        let below = |a: &String, b: &String| a.strip_prefix(b.as_str()).is_some_and(|rest| rest.starts_with('.'));
        let found: Vec<&String> = paths.iter().filter(|a| paths.iter().any(|b| below(a, b))).collect();
        assert!(found.is_empty(), "{name}: {found:?}");
        let drawn = |of: &str| paths.iter().filter(|p| p.starts_with(of)).count();
        assert!(name != "gasoline-3cyl-bush" || (drawn("valves."), drawn("cams.")) == (6, 6));
    }
}

#[test]
fn what_cannot_be_is_refused_at_its_place() {
    let refused = |sets: &[&str]| parsed(VALVES, sets).map(|d| d.name).expect_err("accepted");
    for (sets, words) in [
        (vec!["valves.intake.body=\"drivn\""], "no cam can turn with `drivn`"),
        (vec!["valves.intake.base_radius_mm=5"], "would cut itself"),
        (vec!["valves.intake.roller_radius_mm=300", "valves.intake.base_radius_mm=10"], "roller is too large"),
        (vec!["valves.intake.lift.polynomial.powers=[2, 2, 6]"], "different whole numbers"),
        (vec!["valves.intake.lift.polynomial.ramp_um=100"], "add `ramp_deg`"),
        (vec!["valves.intake.phases_deg=[]"], "one phase for each valve"),
        (vec!["valves.intake.spring_parts=4"], "without mass has no surge"),
        (vec!["valves.intake.lift_mm=3"], "lift_mm"),
        (vec!["valves.intake.rocker.ratio=1.5", "valves.intake.rocker.inertia_kg_m2=1e-5"], "add `arm_mm`"),
        (vec!["valves.intake.gas.head_mm=30", "valves.intake.gas.angles_deg=[0, 0]"], "not a table"),
    ] {
        let report = refused(&sets);
        assert!(report.contains(words) && report.contains("valves.intake"), "{sets:?}: {report}");
    }
    let without = VALVES.replace(
        "[contact.seat]\nfriction = 0\nstick_speed_m_s = 0.05\n\n[contact.seat.linear]",
        "[contact.sprocket.extra]",
    );
    assert!(parsed(&without, &[]).expect_err("no seat").contains("`[contact.seat]`, which is missing"));
    let table = VALVES.replace(
        "[valves.intake.lift.polynomial]\nlift_mm = 8\nhalf_angle_deg = 66\npowers = [2, 6, 10]",
        "[valves.intake.lift.table]\nangles_deg = [-60, 0, -20, 60]\nlifts_mm = [0, 8, 8, 0]",
    );
    assert!(parsed(&table, &[]).expect_err("falls").contains("rising"));
    let bearing =
        format!("{VALVES}\n[bearings.elastic.driven]\nbody = \"driven\"\nmass_kg = 0.5\nstiffness_n_per_m = 1e8\n");
    assert!(parsed(&bearing, &[]).expect_err("moves").contains("has a bearing"));
    let contact = "\n[contact.cam]\nfriction = 0\nstick_speed_m_s = 0.05\n\n[contact.cam.linear]\nstiffness_n_per_m = 4e7\ndamping_n_s_per_m = 1\n";
    assert!(parsed(contact, &[]).expect_err("none").contains("there is no valve"));
}

/// Orders of the crank in the torque of three cylinders' valves at 3400 1/min, computed by hand from lift, springs, masses and friction: size [N m]
/// and phase [deg] of M cos(order phi + phase), phi the turn of the crank; the mean is that of friction.
#[test]
fn torques_of_an_engine_have_the_orders_computed_by_hand() {
    let (name, text) = BUNDLED.iter().find(|b| b.0 == "gasoline-3cyl-bush").expect("bundled");
    // A crank that turns evenly, as in that computation, and a chain and an arm whose modes lie away from the torque's orders.
    let even: Vec<String> = ["orders", "amplitudes_deg", "phases_deg"]
        .iter()
        .map(|key| format!("speeds.constant.crank.{key}=[]"))
        .chain(["chain.joint.stiffness_n_per_m=3e7", "arms.arm.inertia_kg_m2=1.1e-3"].map(String::from))
        .collect();
    let a = assembled(&Drive::parse(name, text, &even).unwrap_or_else(|e| panic!("{e}")));
    let model = &a.model;
    let crank_rad_s = model.sprockets[model.driver].nominal_speed_rad_s.abs();
    let steps = (4.0 * PI / crank_rad_s / model.step_s).round() as u64;
    for (sprocket, phases) in [
        ("intake", [-75.0, -52.0, -35.0, -14.0, 11.0, 34.0]),
        ("exhaust", [-105.0, -112.0, -125.0, -134.0, -139.0, -146.0]),
    ] {
        let shaft = model.sprockets.iter().find(|s| s.name == sprocket).expect("there").coordinate;
        let touches: Vec<(usize, CamTouch)> = cams(model).into_iter().filter(|(_, cam)| cam.shaft == shaft).collect();
        let (mut sums, mut rubbing) = ([[0.0; 2]; 7], 0.0);
        let mut state = a.state.clone();
        watch(model, &mut state, 2 * steps, |state, scratch| {
            let phi = crank_rad_s * state.step as f64 * model.step_s;
            let torque: f64 = touches
                .iter()
                .map(|(touch, cam)| {
                    let gap = model.touches[*touch].shape.gap(&state.coordinates.angle);
                    debug_assert_eq!(gap.coordinates[1], cam.shaft);
                    let now = scratch.touches();
                    rubbing -= now.tangential_force[*touch] * gap.slide[1];
                    -(now.normal_force[*touch] * gap.slope[1] + now.tangential_force[*touch] * gap.slide[1])
                })
                .sum();
            for (sum, order) in sums.iter_mut().zip([0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 9.0]) {
                let (sin, cos) = f64::sin_cos(order * phi);
                *sum = [sum[0] + torque * cos, sum[1] - torque * sin];
            }
        });
        let n = (2 * steps) as f64;
        println!("{sprocket}: mean {:.3} N m, {:.3} of it friction", sums[0][0] / n, rubbing / n);
        assert!((sums[0][0] / n / 0.87 - 1.0).abs() < 0.05);
        // The cam lags behind its crank by a degree, as far as the chain stretches, and swings: of the largest order 0.25 N m, or 5 %.
        for (sum, (known, phase)) in sums[1..].iter().zip([4.90, 1.26, 0.64, 0.32, 0.17, 0.11].into_iter().zip(phases))
        {
            let (sin, cos) = f64::sin_cos(f64::to_radians(phase));
            let [x, y] = [2.0 / n * sum[0], 2.0 / n * sum[1]];
            println!("  {:.3} N m at {:.1} deg; by hand {known} at {phase}", x.hypot(y), y.atan2(x).to_degrees());
            assert!((x - known * cos).hypot(y - known * sin) < 0.35, "{sprocket}: {x} {y}");
            assert!((x.hypot(y) - known).abs() < 0.06, "{sprocket}: {x} {y}");
        }
    }
}
