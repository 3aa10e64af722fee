//! The lumped model and the catalogue of effects: closed forms, order of convergence, and the same rules for every row.

use pitchline::effects::{EFFECTS, Effect, Kind, On, Physics, named};
use pitchline::machine::correction::Observed;
use pitchline::machine::simulate::{InitialState, MAX_STEPS, Samples, Task, run};
use pitchline::machine::{Machine, Reads};

fn machine(text: &str) -> Machine {
    match Machine::parse("machine.toml", text, &[]) {
        Ok(m) => m,
        Err(report) => panic!("{report}"),
    }
}

/// A drive with all possible targets of effects.
const ALL: &str = r#"
title = "everything"
fidelity = "lumped"
[rotors.motor]
inertia_kg_m2 = 0.02
[rotors.crank]
inertia_kg_m2 = 0.01
teeth = 20
[rotors.cam]
inertia_kg_m2 = 0.03
teeth = 40
[rotors.shaft]
inertia_kg_m2 = 1.0
[speeds.constant.shaft]
speed_rpm = 300.0
[couplings.joint]
between = ["motor", "crank"]
stiffness_nm_per_rad = 200.0
damping_nm_s_per_rad = 0.1
[couplings.soft]
between = ["shaft", "cam"]
stiffness_nm_per_rad = 5.0
damping_nm_s_per_rad = 0.05
[spans.tight]
between = ["crank", "cam"]
from_radius_mm = 25.0
to_radius_mm = 50.0
stiffness_n_per_m = 50000.0
damping_n_s_per_m = 20.0
from_link = 0.0
to_link = 30.0
[chain]
links = 90
leader = "crank"
[loads.viscous.motor]
torque_nm_s_per_rad = 0.05
[inputs.torque.motor]
gain_nm_per_unit = 1.5
[sensors.tachometer.motor]
[sensors.tachometer.crank]
[sensors.encoder.crank_angle]
body = "crank"
[sensors.tachometer.cam]
[sensors.strain_gauge.tight]
"#;

const SAMPLES: usize = 400;
const STEP_S: f64 = 1e-3;

fn task() -> Task {
    let input = (0..SAMPLES).map(|i| 2.0 + 3.0 * ((i * i) as f64 * 1e-4).sin()).collect();
    Task {
        samples: Samples::Times { t_s: (0..SAMPLES).map(|i| i as f64 * STEP_S).collect(), step_s: STEP_S, even: true },
        inputs: vec![input],
        hold: false,
        start_s: 0.0,
    }
}

fn start(m: &Machine) -> InitialState {
    let mut start = InitialState { q: vec![0.3; m.bodies.len()], v: vec![60.0; m.bodies.len()], travel: 0.0 };
    if let Some(cam) = m.bodies.iter().position(|b| b.name == "cam") {
        start.v[cam] = 30.0;
    }
    start
}

fn channels(m: &Machine, values: &[f64]) -> Vec<Vec<f64>> {
    let all: Vec<usize> = (0..5).collect();
    match run(m, values, &task(), &start(m), &all, MAX_STEPS, None) {
        Ok(series) => series,
        Err(e) => panic!("{e}"),
    }
}

/// Parameter values of a row: off, or strong enough to be seen.
fn values(m: &Machine, effect: &'static Effect, target: pitchline::machine::Target, strong: bool) -> Vec<f64> {
    m.keys(effect, target)
        .iter()
        .map(|(_, p)| {
            let amplitude = matches!(p.kind, Kind::Amplitude | Kind::PerMark | Kind::Given) || p.key == "blind";
            let shape = match p.key {
                "frequency_hz" => 40.0,
                "period_ms" => 12.0,
                "damping_ratio" => 0.1,
                "stribeck_speed_rad_s" => 30.0,
                _ => 0.5,
            };
            let strong_value = match p.key {
                "limit" | "preload_n" => 2.0,
                "amplitude_um" | "outward_um" | "length_um" | "difference_um" | "gap_um" => 200.0,
                "ppm" => 500.0,
                "stiffness_n_per_m" => 5000.0,
                "stiffness_n_per_m2" => 1e7,
                "inertia_kg_m2" | "far_inertia_kg_m2" => 0.004,
                "delay_ms" | "time_ms" => 5.0,
                "blind" => 1.0,
                "width" => 0.5,
                "arm_um" => 2000.0,
                "order" => 2.0,
                _ => 0.5,
            };
            let value = match (strong, amplitude) {
                (true, true) => strong_value,
                (false, true) if p.key == "blind" => 0.0,
                (false, true) => p.off,
                _ if p.kind == Kind::Shape => shape,
                _ => p.default.unwrap_or(p.starts[0]),
            };
            value * p.unit
        })
        .collect()
}

#[test]
fn every_row_says_what_it_is() {
    assert!(EFFECTS.len() >= 24, "{} effects", EFFECTS.len());
    for (i, e) in EFFECTS.iter().enumerate() {
        assert!(EFFECTS[..i].iter().all(|o| o.name != e.name), "two rows are called {}", e.name);
        for (what, text) in [
            ("title", e.title),
            ("equation", e.equation),
            ("source", e.source),
            ("order", e.order),
            ("speed law", e.speed_law),
            ("channels", e.channels),
        ] {
            assert!(!text.is_empty(), "{} has no {what}", e.name);
        }
        assert!(!e.parameters.is_empty(), "{} has no parameter", e.name);
        for p in e.parameters {
            assert!(p.low < p.high && p.unit > 0.0 && !p.starts.is_empty(), "{}.{}", e.name, p.key);
            assert!(
                (p.low..=p.high).contains(&p.off)
                    || matches!(p.kind, Kind::Shape | Kind::Whole | Kind::Index | Kind::Given),
                "{}.{} is off outside its range",
                e.name,
                p.key
            );
        }
    }
}

#[test]
fn every_row_changes_no_bit_where_it_is_off_and_moves_a_sensor_where_it_is_on() {
    let m = machine(ALL);
    let without = channels(&m, &m.values);
    let mut tested = 0;
    for e in EFFECTS {
        if matches!(e.physics, Physics::LinksOnly | Physics::Intake | Physics::Marks(_)) {
            continue;
        }
        let (name, target) = m
            .targets(e)
            .into_iter()
            .find(|(n, _)| n != "shaft" || e.on == On::Prescribed)
            .unwrap_or_else(|| panic!("nothing to put {} on", e.name));
        // A sensor's shape parameter (its period) has no off value.
        if e.name != "sensor_resonance" {
            let (off, _) = m.with_effect(e, &name, target, &values(&m, e, target, false));
            let same = channels(&off, &off.values);
            let bits = |s: &[Vec<f64>]| s.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert!(bits(&same) == bits(&without), "{} changes a bit where it is off", e.name);
        }
        let (on, _) = m.with_effect(e, &name, target, &values(&m, e, target, true));
        // A sign-blind sensor differs only in reverse motion.
        let mut numbers = on.values.clone();
        if e.name == "sign_blind" {
            let gain = on.slot("inputs.torque.motor.gain_nm_per_unit").expect("the gain");
            numbers[gain] *= -8.0;
        }
        let reference = if e.name == "sign_blind" { channels(&m, &numbers[..m.values.len()]) } else { without.clone() };
        let moved = channels(&on, &numbers);
        assert!(moved != reference, "{} moves no sensor", e.name);
        tested += 1;
    }
    assert!(tested >= 24, "{tested} rows");
}

#[test]
fn dissipative_rows_take_energy_and_never_give_any() {
    // A free two-mass oscillator: its energy may only decrease, and at the end it is lower than without the effect.
    let text = "fidelity = \"lumped\"\n[rotors.a]\ninertia_kg_m2 = 0.5\nteeth = 20\n[rotors.b]\ninertia_kg_m2 = 0.3\nteeth = 40\n[spans.s]\nbetween = [\"a\", \"b\"]\nfrom_radius_mm = 50.0\nto_radius_mm = 100.0\nstiffness_n_per_m = 20000.0\nfrom_link = 0.0\nto_link = 30.0\n[chain]\nlinks = 90\n[sensors.tachometer.ta]\nbody = \"a\"\n[sensors.tachometer.tb]\nbody = \"b\"\n[sensors.strain_gauge.s]\n";
    let m = machine(text);
    let task = Task {
        samples: Samples::Times { t_s: (0..2000).map(|i| f64::from(i) * 1e-3).collect(), step_s: 1e-3, even: true },
        inputs: vec![],
        hold: false,
        start_s: 0.0,
    };
    let start = InitialState { q: vec![0.0, 0.05], v: vec![8.0, 5.0], travel: 0.0 };
    let energy = |m: &Machine| -> Vec<f64> {
        let s = run(m, &m.values, &task, &start, &[0, 1, 2], MAX_STEPS, None).expect("the run holds");
        (0..2000)
            .map(|i| 0.25 * s[0][i] * s[0][i] + 0.15 * s[1][i] * s[1][i] + 0.5 * s[2][i] * s[2][i] / 20000.0)
            .collect()
    };
    let conserved = energy(&m);
    // Fourth order, a step of 1 ms: measured 2.4e-10 of the energy in 2 s.
    let drift = (conserved[1999] - conserved[0]).abs() / conserved[0];
    assert!(drift < 1e-8, "the oscillator itself drifts by {drift}");
    // What acts on inputs has a test of its own: nothing drives these bodies.
    let freely = |e: &&&'static Effect| e.dissipative && e.on != On::Input && !matches!(e.physics, Physics::LinksOnly);
    for e in EFFECTS.iter().filter(freely) {
        let Some((name, target)) = m.targets(e).into_iter().next() else { panic!("nothing to put {} on", e.name) };
        let mut numbers = values(&m, e, target, true);
        if e.name == "span_damping" {
            numbers[0] = 100.0;
        }
        let (with, _) = m.with_effect(e, &name, target, &numbers);
        // Damping forces of a span store no energy: only the tension of the declared spring does.
        let series = if matches!(e.physics, Physics::SpanForce(_)) {
            let s = run(&with, &with.values, &task, &start, &[0, 1], MAX_STEPS, None).expect("the run holds");
            (0..2000).map(|i| 0.25 * s[0][i] * s[0][i] + 0.15 * s[1][i] * s[1][i]).collect::<Vec<f64>>()
        } else {
            energy(&with)
        };
        assert!(
            series[1999] < 0.999 * conserved[1999],
            "{} takes nothing: {} of {}",
            e.name,
            series[1999],
            conserved[1999]
        );
        if !matches!(e.physics, Physics::SpanForce(_)) {
            let most = series.windows(2).map(|w| w[1] - w[0]).fold(f64::MIN, f64::max);
            assert!(most < 1e-5 * series[0], "{} gives {most} J in a sample", e.name);
        }
    }
}

#[test]
fn a_flywheel_in_air_runs_down_as_the_closed_form_says() {
    // J w' = -k w^2: t(theta) = J / (k w0) (exp(k theta / J) - 1), so that intervals grow by exp(k dtheta / J) exactly.
    let m = machine(
        "fidelity = \"lumped\"\n[rotors.w]\ninertia_kg_m2 = 0.1\n[loads.quadratic.w]\ntorque_nm_s2_per_rad2 = 0.0002\n[sensors.pulse_pickup.w]\nmarks = 6\n",
    );
    let task = Task {
        samples: Samples::Pulses { intervals: 200, first: 2, interval_s: 0.01, longest_s: 0.1 },
        inputs: vec![],
        hold: false,
        start_s: 0.0,
    };
    let start = InitialState { q: vec![0.0], v: vec![100.0], travel: 0.0 };
    let ln_dt = &run(&m, &m.values, &task, &start, &[0], MAX_STEPS, None).expect("the run holds")[0];
    let (rate, gap) = (0.0002 / 0.1, std::f64::consts::PI / 3.0);
    let first = (1.0 / (rate * 100.0)) * (rate * gap).exp_m1();
    for (i, v) in ln_dt.iter().enumerate() {
        let exact = first.ln() + rate * gap * i as f64;
        // measured 5.0e-8, the cubic's error over one turn at this speed; a pickup's noise is 1e-3
        assert!((v - exact).abs() < 1e-7, "interval {i}: {v} for {exact}");
    }
}

#[test]
fn dry_friction_stops_at_a_constant_rate() {
    let m = machine(
        "fidelity = \"lumped\"\n[sliders.s]\nmass_kg = 4.0\n[loads.friction.s]\nforce_n = 6.0\nstick_speed_m_s = 0.0001\n[sensors.tachometer.s]\n[sensors.displacement.place]\nbody = \"s\"\n",
    );
    let task = Task {
        samples: Samples::Times { t_s: (0..200).map(|i| f64::from(i) * 1e-3).collect(), step_s: 1e-3, even: true },
        inputs: vec![],
        hold: false,
        start_s: 0.0,
    };
    let start = InitialState { q: vec![0.5], v: vec![1.0], travel: 0.0 };
    let s = run(&m, &m.values, &task, &start, &[0, 1], MAX_STEPS, None).expect("the run holds");
    // Sensors are in the order of the kinds: displacement first.
    let (position, speed) = if matches!(m.sensors[0].reads, Reads::Angle(_)) { (&s[0], &s[1]) } else { (&s[1], &s[0]) };
    for i in 0..200 {
        let t = i as f64 * 1e-3;
        assert!((speed[i] - (1.0 - 1.5 * t)).abs() < 1e-7, "{} at {t}", speed[i]);
        assert!((position[i] - (0.5 + t - 0.75 * t * t)).abs() < 1e-7, "{} at {t}", position[i]);
    }
}

/// Torque that steps from 0 to 3 N m every second sample and back, through a lag, on a free rotor: its impulse up to a
/// sample in closed form, for lags far below a sample, of a sample, and of many.
#[test]
fn a_lag_of_a_held_input_gives_its_impulse_however_short_it_is() {
    let step_s = 2e-3;
    let t_s: Vec<f64> = (0..40).map(|i| f64::from(i) * step_s).collect();
    let input: Vec<f64> = (0..40).map(|i| if i / 2 % 2 == 1 { 3.0 } else { 0.0 }).collect();
    for time_s in [1e-7, 1e-5, 4e-4, 2e-3, 2e-2] {
        let m = machine(&format!(
            "fidelity = \"lumped\"\n[rotors.disc]\ninertia_kg_m2 = 0.01\n[inputs.torque.disc]\n[sensors.tachometer.disc]\n\
             [effects.input_lag.disc]\ntime_ms = {}\n",
            time_s * 1e3
        ));
        let samples = Samples::Times { t_s: t_s.clone(), step_s, even: true };
        let task = Task { samples, inputs: vec![input.clone()], hold: true, start_s: 0.0 };
        let start = InitialState { q: vec![0.0], v: vec![0.0], travel: 0.0 };
        let speeds = &run(&m, &m.values, &task, &start, &[0], MAX_STEPS, None).expect("the run holds")[0];
        let (mut y, mut impulse) = (0.0, 0.0);
        for (i, v) in speeds.iter().enumerate() {
            assert!((v - impulse / 0.01).abs() < 1e-9, "{time_s} s, sample {i}: {v} against {}", impulse / 0.01);
            let x = step_s / time_s;
            impulse += input[i] * step_s + (y - input[i]) * time_s * -libm::expm1(-x);
            y = input[i] + (y - input[i]) * libm::exp(-x);
        }
    }
}

#[test]
fn a_free_oscillator_converges_with_the_fourth_order() {
    let text = "fidelity = \"lumped\"\n[sliders.s]\nmass_kg = 1.0\n[grounds.g]\nbody = \"s\"\nstiffness_n_per_m = 400.0\n[sensors.displacement.s]\n";
    let m = machine(text);
    // The step is at most a tenth of a radian; with closer samples it is the samples' own.
    let error = |step_s: f64| {
        let n = (1.0 / step_s).round() as usize;
        let task = Task {
            samples: Samples::Times { t_s: (0..=n).map(|i| i as f64 * step_s).collect(), step_s, even: true },
            inputs: vec![],
            hold: false,
            start_s: 0.0,
        };
        let start = InitialState { q: vec![0.01], v: vec![0.0], travel: 0.0 };
        let s = run(&m, &m.values, &task, &start, &[0], MAX_STEPS, None).expect("the run holds");
        (s[0][n] - 0.01 * 20.0_f64.cos()).abs()
    };
    let (coarse, fine) = (error(0.004), error(0.002));
    let order = (coarse / fine).log2();
    // measured 3.98
    assert!((3.7..4.3).contains(&order), "order {order}: {coarse} and {fine}");
}

#[test]
fn filters_and_delays_do_to_a_ramp_what_they_should() {
    // A slider pushed by a constant force has a linearly increasing speed.
    let text = "fidelity = \"lumped\"\n[sliders.s]\nmass_kg = 2.0\n[loads.constant.s]\nforce_n = -4.0\n[sensors.tachometer.s]\n";
    let m = machine(text);
    let task = Task {
        samples: Samples::Times { t_s: (0..500).map(|i| f64::from(i) * 1e-3).collect(), step_s: 1e-3, even: true },
        inputs: vec![],
        hold: false,
        start_s: 0.0,
    };
    let start = InitialState { q: vec![0.0], v: vec![0.0], travel: 0.0 };
    let show = |name: &str, value: f64| -> Vec<f64> {
        let e = named(name).expect("a row");
        let (place, target) = m.targets(e).into_iter().next().expect("a sensor");
        // An effect with a lag has a start parameter besides its time.
        let values = [value, 0.0];
        let (with, _) = m.with_effect(e, &place, target, &values[..e.parameters.len()]);
        run(&with, &with.values, &task, &start, &[0], MAX_STEPS, None).expect("the run holds").remove(0)
    };
    let (lagging, late) = (show("low_pass", 0.02), show("latency", 0.0125));
    let ringing = show("sensor_resonance", 0.03);
    for i in 200..500 {
        let t = i as f64 * 1e-3;
        // T y' + y = 2 t: y = 2 (t - T + T exp(-t / T))
        let exact = 2.0 * (t - 0.02 + 0.02 * (-t / 0.02).exp());
        assert!((lagging[i] - exact).abs() < 1e-10, "{} for {exact} at {t}", lagging[i]);
        assert!((late[i] - 2.0 * (t - 0.0125)).abs() < 1e-10, "{} at {t}", late[i]);
        // A second-order sensor follows a ramp with a delay of 2 zeta / w after its ringing has decayed.
        let late_s = 2.0 * 0.1 * 0.03 / (2.0 * std::f64::consts::PI);
        let rings = 2.0 * 0.03 / (2.0 * std::f64::consts::PI) * (-0.1 * 2.0 * std::f64::consts::PI / 0.03 * t).exp();
        assert!((ringing[i] - 2.0 * (t - late_s)).abs() < 1.1 * rings + 1e-6, "{} at {t}", ringing[i]);
    }
    // A record that begins in the middle of the motion: the initial output of a sensor continues the ramp from before.
    let start = InitialState { q: vec![0.0], v: vec![5.0], travel: 0.0 };
    for (name, late_s) in [("low_pass", 0.02), ("latency", 0.0125)] {
        let e = named(name).expect("a row");
        let (place, target) = m.targets(e).into_iter().next().expect("a sensor");
        for beyond in [0.0, 0.7] {
            let (with, _) = m.with_effect(e, &place, target, &[late_s, beyond]);
            let shown =
                run(&with, &with.values, &task, &start, &[0], MAX_STEPS, None).expect("the run holds").remove(0);
            for (i, shown) in shown.iter().enumerate() {
                let t = i as f64 * 1e-3;
                // An additional initial offset decays, or ends after the delay.
                let memory = match name {
                    "low_pass" => (-t / late_s).exp(),
                    _ => (1.0 - t / late_s).max(0.0),
                };
                let exact = 5.0 + 2.0 * (t - late_s) + beyond * memory;
                assert!((shown - exact).abs() < 1e-9, "{name}: {shown} for {exact} at {i} ms");
            }
        }
    }
}

#[test]
fn uneven_marks_move_intervals_by_their_own_share_at_every_speed() {
    let text = "fidelity = \"lumped\"\n[rotors.w]\ninertia_kg_m2 = 0.1\n[sensors.pulse_pickup.w]\nmarks = 4\n";
    let m = machine(text);
    let e = named("mark_spacing").expect("a row");
    let (name, target) = m.targets(e).remove(0);
    let (with, _) = m.with_effect(e, &name, target, &[0.01, 0.0, -0.02]);
    for speed in [10.0, 200.0] {
        let gap = std::f64::consts::FRAC_PI_2 / speed;
        let task = Task {
            samples: Samples::Pulses { intervals: 8, first: 0, interval_s: gap, longest_s: gap },
            inputs: vec![],
            hold: false,
            start_s: 0.0,
        };
        let start = InitialState { q: vec![0.0], v: vec![speed], travel: 0.0 };
        let s = run(&with, &with.values, &task, &start, &[0], MAX_STEPS, None).expect("the run holds");
        // s_m+1 - s_m with s = 0, 0.01, 0, -0.02
        let shares = [1.01, 0.99, 0.98, 1.02, 1.01, 0.99, 0.98, 1.02];
        for (v, share) in s[0].iter().zip(shares) {
            assert!((v.exp() / gap - share).abs() < 1e-10, "{} for {share}", v.exp() / gap);
        }
    }
}

#[test]
fn mistakes_in_a_machine_are_all_told_at_once() {
    let text = "fidelity = \"lumped\"\n[rotors.a]\ninertia = 1.0\n[couplings.c]\nbetween = [\"a\", \"nobody\"]\nstiffness_nm_per_rad = 1.0\n[sensors.tachometer.b]\n[effects.coulomb_friction.c]\ntorque_nm = 1.0\n";
    let report = Machine::parse("m.toml", text, &[]).expect_err("mistakes").to_string();
    for part in [
        "write `inertia_kg_m2`",
        "no body is called `nobody`",
        "no body is called `b`",
        "goes on a free body: a",
        "m.toml:3",
    ] {
        assert!(report.contains(part), "no `{part}` in\n{report}");
    }
}

/// A disc runs down under dry friction: v = v0 - T t / J until it rests. Samples take small steps near rest alone.
#[test]
fn dry_friction_stops_a_disc_when_its_closed_form_says() {
    let stick = 1e-3;
    let text = format!(
        "fidelity = \"lumped\"\n[rotors.disc]\ninertia_kg_m2 = 0.05\n[loads.friction.disc]\ntorque_nm = 0.4\nstick_speed_rad_s = {stick}\n\
         [inputs.torque.disc]\n[sensors.tachometer.disc]\n[sensors.encoder.angle]\nbody = \"disc\"\n"
    );
    let m = machine(&text);
    let t_s: Vec<f64> = (0..200).map(|i| 0.01 * f64::from(i)).collect();
    let task = Task {
        samples: Samples::Times { t_s: t_s.clone(), step_s: 0.01, even: true },
        inputs: vec![vec![0.0; 200]],
        hold: true,
        start_s: 0.0,
    };
    let start = InitialState { q: vec![0.0], v: vec![10.0], travel: 0.0 };
    let by = |reads| m.sensors.iter().position(|s| s.reads == reads).expect("a sensor");
    let channels = [by(Reads::Speed(0)), by(Reads::Angle(0))];
    let out = run(&m, &m.values, &task, &start, &channels, 1e5, None).expect("a run");
    for (i, t) in t_s.iter().enumerate() {
        let stops = 10.0 * 0.05 / 0.4;
        let (t, slope) = (t.min(stops), 0.4 / 0.05);
        let (v, q) = (10.0 - slope * t, 10.0 * t - 0.5 * slope * t * t);
        // The law rounds the corner off over its stick speed.
        assert!((out[0][i] - v).abs() < 2.0 * stick, "{i}: {} {v}", out[0][i]);
        assert!((out[1][i] - q).abs() < 1e-3, "{i}: {} {q}", out[1][i]);
        if v > 0.5 {
            // The law's sign is v / sqrt(v^2 + stick^2), so that friction falls short of T by stick^2 / 2 v^2.
            let v = v + 0.5 * stick * stick * (1.0 / v - 1.0 / 10.0);
            assert!((out[0][i] - v).abs() < 1e-9, "{i}: {} {v}", out[0][i]);
        }
    }
}

/// A disc with a measured torque, a tachometer and an encoder, and what one more table says.
fn disc(table: &str) -> Machine {
    machine(&format!(
        "fidelity = \"lumped\"\n[rotors.disc]\ninertia_kg_m2 = 0.01\n[inputs.torque.disc]\ngain_nm_per_unit = 0.5\n\
         [sensors.tachometer.disc]\n[sensors.encoder.angle]\nbody = \"disc\"\n{table}"
    ))
}

/// Speed and angle of [`disc`] at samples 1 ms apart.
fn motion(m: &Machine, torque: Vec<f64>, v: f64, start_s: f64) -> (Vec<f64>, Vec<f64>) {
    let t_s = (0..torque.len()).map(|i| f64::from(i as u32) * 1e-3).collect();
    let samples = Samples::Times { t_s, step_s: 1e-3, even: true };
    let task = Task { samples, inputs: vec![torque], hold: true, start_s };
    let start = InitialState { q: vec![0.0], v: vec![v], travel: 0.0 };
    let by = |reads| m.sensors.iter().position(|s| s.reads == reads).expect("a sensor");
    let channels = [by(Reads::Speed(0)), by(Reads::Angle(0))];
    let mut out = run(m, &m.values, &task, &start, &channels, 1e4, None).expect("a run");
    let angle = out.pop().expect("an angle");
    (out.pop().expect("a speed"), angle)
}

/// A torque that rises past friction, falls back, and turns round: the disc sticks, slides, stops and slides back as Coulomb's law says. Its
/// friction is so sharp that explicit steps would need half a million for a sample.
#[test]
fn a_disc_sticks_and_slides_both_ways_as_coulomb_says() {
    let m = disc("[loads.friction.disc]\ntorque_nm = 0.1\nstick_speed_rad_s = 1e-5\n");
    // The gain is 0.5 N m per unit, the inertia 0.01 kg m^2.
    let command: Vec<f64> = (0..400).map(|i| [0.16, 0.3, 0.0, -0.19, -0.4][(i / 80) as usize]).collect();
    let (speed, angle) = motion(&m, command.clone(), 0.0, 0.0);
    let (mut v, mut q) = (0.0_f64, 0.0_f64);
    for (i, command) in command.iter().enumerate() {
        assert!((speed[i] - v).abs() < 5e-5 && (angle[i] - q).abs() < 1e-5, "{i}: {} {v}, {} {q}", speed[i], angle[i]);
        let torque = 0.5 * command;
        let way = if v == 0.0 { if torque.abs() > 0.1 { torque.signum() } else { 0.0 } } else { v.signum() };
        if way == 0.0 {
            continue;
        }
        let rate = (torque - 0.1 * way) / 0.01;
        let stops = if v * rate < 0.0 { (-v / rate).min(1e-3) } else { 1e-3 };
        q += v * stops + 0.5 * rate * stops * stops;
        v = if stops < 1e-3 { 0.0 } else { v + rate * 1e-3 };
    }
}

/// An effect that is placed and switched off changes no bit of a run whose samples take their own numbers of steps, and a small one of a
/// sensor changes it in proportion.
#[test]
fn effects_of_sensors_and_inputs_leave_the_steps_near_rest_as_they_are() {
    let stiff = "[loads.friction.disc]\ntorque_nm = 0.1\nstick_speed_rad_s = 1e-3\n";
    let command: Vec<f64> = (0..500).map(|i| 0.5 * (0.03 * f64::from(i)).sin()).collect();
    let of = |table: &str| motion(&disc(&format!("{stiff}{table}")), command.clone(), 0.0, 0.0).0;
    let plain = of("");
    for off in [
        "[effects.latency.disc]\ndelay_ms = 0.0\n",
        "[effects.input_lag.disc]\ntime_ms = 0.0\n",
        "[effects.load_friction.disc]\nloss_percent = 0.0\n",
        "[effects.offset.disc]\noffset = 0.0\n",
    ] {
        assert!(of(off) == plain, "{off}");
    }
    let change = |size: f64| -> Vec<f64> {
        let late = of(&format!("[effects.latency.disc]\ndelay_ms = {size}\n"));
        late.iter().zip(&plain).map(|(a, b)| (a - b) / size).collect()
    };
    let (small, large) = (change(1e-6), change(1e-2));
    let size = large.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert!(small.iter().zip(&large).all(|(a, b)| (a - b).abs() < 1e-3 * size), "{size}");
}

/// Without an input, a constant torque alone lets the disc creep, or slide from rest. A torque that is interpolated and falls from what just
/// holds the disc to the other way within one sample turns it round.
#[test]
fn sharp_friction_needs_no_input_and_follows_one_that_changes_within_a_sample() {
    let stick = 1e-5;
    for torque in [0.05, 0.3] {
        let m = disc(&format!(
            "[loads.friction.disc]\ntorque_nm = 0.1\nstick_speed_rad_s = {stick}\n[loads.constant.disc]\ntorque_nm = {torque}\n"
        ));
        let (speed, _) = motion(&m, vec![0.0; 100], 0.0, 0.0);
        let expected = |t: f64| if torque < 0.1 { stick * 0.5 / 0.75_f64.sqrt() } else { (torque - 0.1) / 0.01 * t };
        // A constant load acts against the positive direction. The first moments slide on the rounded corner of the law.
        assert!((1..100).all(|i| (-speed[i] - expected(i as f64 * 1e-3)).abs() < 2.0 * stick), "{torque}: {speed:?}");
    }
    let m = disc(&format!("[loads.friction.disc]\ntorque_nm = 0.1\nstick_speed_rad_s = {stick}\n"));
    let samples = Samples::Times { t_s: vec![0.0, 1e-3, 2e-3], step_s: 1e-3, even: true };
    // The gain is 0.5 N m per unit.
    let task = Task { samples, inputs: vec![vec![0.2, -1.2, -1.2]], hold: false, start_s: 0.0 };
    let start = InitialState { q: vec![0.0], v: vec![0.002], travel: 0.0 };
    let by = |reads| m.sensors.iter().position(|s| s.reads == reads).expect("a sensor");
    let out = run(&m, &m.values, &task, &start, &[by(Reads::Speed(0))], 1e4, None).expect("a run");
    // Sliding on: 0.002 - 35000 t^2 until it stands; at rest until the torque is -0.1; then back, with friction the other way.
    let turns = 0.2 / 0.7 * 1e-3;
    let back = |t: f64| -0.5 * 0.7 / 1e-3 / 0.01 * (t - turns) * (t - turns);
    assert!((out[0][1] - back(1e-3)).abs() < 5.0 * stick, "{} {}", out[0][1], back(1e-3));
}

/// A push far below the slip is answered by a spring of stiffness T / s; a fast disc loses T x - T s (1 - exp(-x / s)) over a way x.
#[test]
fn friction_that_bends_is_a_spring_at_first_and_then_slides() {
    let m = disc("[effects.presliding_friction.disc]\ntorque_nm = 0.4\nslip_rad = 0.01\n");
    let omega = (0.4_f64 / (0.01 * 0.01)).sqrt();
    let size = 1e-7;
    let (_, angle) = motion(&m, vec![0.0; 200], size * omega, 0.0);
    for (i, q) in angle.iter().enumerate() {
        let exact = size * (omega * i as f64 * 1e-3).sin();
        // The loop of the hysteresis takes a share of the order of size / s.
        assert!((q - exact).abs() < 1e-4 * size, "{i}: {q} {exact}");
    }
    let (speed, angle) = motion(&m, vec![0.0; 200], 10.0, 0.0);
    for (v, x) in speed.iter().zip(&angle) {
        let lost = 0.4 * (x + 0.01 * (-x / 0.01_f64).exp_m1());
        let energy = 0.5 * 0.01 * (100.0 - v * v);
        assert!((energy - lost).abs() < 1e-6 * 0.5, "{x}: {energy} {lost}");
    }
    // The bristles may be bent when a record begins: they then pull all the way.
    let bent = disc("[effects.presliding_friction.disc]\ntorque_nm = 0.4\nslip_rad = 0.01\nstart = 1.0\n");
    let (speed, _) = motion(&bent, vec![0.0; 100], 10.0, 0.0);
    assert!((speed[99] - (10.0 - 40.0 * 0.099)).abs() < 1e-9, "{}", speed[99]);
}

/// J v' = -T exp(-t / tau), with t from the start of the record and not of the stretch that is run.
#[test]
fn friction_fades_from_the_start_of_its_record() {
    let m = disc("[effects.warming_friction.disc]\ntorque_nm = 0.1\ntime_s = 0.2\nstick_speed_rad_s = 1e-6\n");
    for start_s in [0.0, 0.3] {
        let (speed, _) = motion(&m, vec![0.0; 300], 50.0, start_s);
        for (i, v) in speed.iter().enumerate() {
            let (from, to) = ((-start_s / 0.2).exp(), (-(start_s + i as f64 * 1e-3) / 0.2).exp());
            let exact = 50.0 - 0.1 * 0.2 / 0.01 * (from - to);
            assert!((v - exact).abs() < 1e-9, "{start_s} {i}: {v} {exact}");
        }
    }
}

/// A torque that drives for 0.1 s, then brakes: a transmission takes a share of it both times; an amplifier gives more one way.
#[test]
fn a_share_of_the_drive_is_lost_or_given_by_its_sign() {
    let torque: Vec<f64> = (0..200).map(|i| if i < 100 { 2.0 } else { -1.0 }).collect();
    let rows = [
        ("[effects.load_friction.disc]\nloss_percent = 20.0\nstick_speed_rad_s = 1e-6\n", 0.8, -1.2),
        ("[effects.input_gain_by_sign.disc]\ndifference_percent = 10.0\n", 1.1, -0.9),
    ];
    for (table, forwards, backwards) in rows {
        let (speed, _) = motion(&disc(table), torque.clone(), 30.0, 0.0);
        for (i, v) in speed.iter().enumerate() {
            let t = i as f64 * 1e-3;
            let exact = 30.0 + 50.0 * (2.0 * forwards * t.min(0.1) + backwards * (t - 0.1).max(0.0));
            assert!((v - exact).abs() < 1e-9, "{table}{i}: {v} {exact}");
        }
    }
}

/// A free disc that turns at 5 rad/s, started at 6: each sample takes a share off the difference, so that predictions are off by (1 - share)^i.
/// An offset and a gain of the tachometer, known to the model, change nothing of it.
#[test]
fn a_prediction_forgets_a_wrong_start_at_its_rate() {
    let rows = [
        ("", 1.0, 0.0),
        ("[effects.offset.disc]\noffset = 3.0\n", 1.0, 3.0),
        ("[effects.gain_error.disc]\ngain_percent = 25.0\n", 1.25, 0.0),
    ];
    for (table, gain, offset) in rows {
        let m = disc(table);
        let sensor = m.sensors.iter().position(|s| s.reads == Reads::Speed(0)).expect("a tachometer");
        let t_s = (0..50).map(|i| f64::from(i) * 1e-3).collect();
        let samples = Samples::Times { t_s, step_s: 1e-3, even: true };
        let task = Task { samples, inputs: vec![vec![0.0; 50]], hold: true, start_s: 0.0 };
        let start = InitialState { q: vec![0.0], v: vec![6.0], travel: 0.0 };
        let observed =
            Observed { share: 0.1, sensors: &[sensor], noise: &[1e-3], measured: &[vec![gain * 5.0 + offset; 50]] };
        let out = run(&m, &m.values, &task, &start, &[sensor], MAX_STEPS, Some(observed)).expect("a run");
        for (i, v) in out[0].iter().enumerate() {
            let exact = gain * (5.0 + 0.9_f64.powi(i as i32)) + offset;
            // The slope that the sensor lets through is a difference quotient.
            assert!((v - exact).abs() < 1e-9, "{table}{i}: {v} {exact}");
        }
    }
}

/// An angle that is measured corrects the speed too: a constant speed that the start did not know is found.
#[test]
fn a_prediction_from_angles_finds_the_speed() {
    let m = disc("");
    let sensor = m.sensors.iter().position(|s| s.reads == Reads::Angle(0)).expect("an encoder");
    let t_s = (0..400).map(|i| f64::from(i) * 1e-3).collect();
    let samples = Samples::Times { t_s, step_s: 1e-3, even: true };
    let task = Task { samples, inputs: vec![vec![0.0; 400]], hold: true, start_s: 0.0 };
    let start = InitialState { q: vec![0.0], v: vec![0.0], travel: 0.0 };
    let measured: Vec<f64> = (0..400).map(|i| 5e-3 * f64::from(i)).collect();
    let observed =
        Observed { share: 0.1, sensors: &[sensor], noise: &[1e-3], measured: std::slice::from_ref(&measured) };
    let out = run(&m, &m.values, &task, &start, &[sensor], MAX_STEPS, Some(observed)).expect("a run");
    let off = |i: usize| (out[0][i] - measured[i]).abs();
    assert!(off(1) > 4e-3 && off(399) < 1e-9, "{} {}", off(1), off(399));
}
