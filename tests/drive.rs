//! The 20/40 drive as a whole: ratio, tensions, approach speeds, energy, order of convergence.

mod common;

use common::{NO_FRICTION, assembled, drive, drive_without_guides, watch};
use pitchline::geometry::Vec2;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::Model;
use pitchline::recording::capture::{Camera, contacts_at};
use pitchline::recording::frame::{Energy, Segment};
use pitchline::state::State;
use std::f64::consts::PI;

/// Steps of `loops` turns of the chain round the loop.
fn loop_steps(model: &Model, loops: f64) -> u64 {
    (loops * model.chain.n_links as f64 * 8e-3 / model.chain_speed_m_s / model.step_s).round() as u64
}

#[test]
fn ratio_and_span_speed_hold_over_whole_loops_and_no_tooth_is_skipped() {
    let a = assembled(&drive(&[]));
    let model = a.model.clone();
    let mut state = a.state;
    let steps = loop_steps(&model, 2.0);
    let start = state.rotors.angle.clone();
    // After whole loops every link is back where it was, up to what the mean speed is off: its advance is a whole number of
    // loops of N nominal pitches, plus the displacement along the span it is in.
    let before = state.links.clone();
    watch(&a.model, &mut state, steps, |_, _| {});
    let l = &state.links;
    let advance: f64 = (0..state.n_links)
        .map(|i| (l.x[i] - before.x[i]) * before.cos[i] + (l.y[i] - before.y[i]) * before.sin[i])
        .sum::<f64>()
        / state.n_links as f64;
    let time = steps as f64 * model.step_s;
    let speed = (2.0 * 90.0 * 8e-3 + advance) / time;
    let turned = [state.rotors.angle[0] - start[0], state.rotors.angle[1] - start[1]];
    let ratio = turned[1] / turned[0];
    println!(
        "ratio {ratio:.8} (1/2), span speed {speed:.6} m/s in nominal pitches (z p n = {:.6} m/s)",
        model.chain_speed_m_s
    );
    // A skipped tooth in two loops (nine turns of the driver) would show as 1/180 in both.
    assert!((ratio / 0.5 - 1.0).abs() < 1e-4, "ratio {ratio}");
    assert!((speed / model.chain_speed_m_s - 1.0).abs() < 1e-4, "span speed {speed}");
}

#[test]
fn tight_minus_slack_is_the_load_over_the_rolling_radius_and_the_mean_stays_that_of_the_assembly() {
    let a = assembled(&drive(&NO_FRICTION));
    let model = a.model.clone();
    let mut state = a.state;
    let route = model.route.as_ref().expect("a route");
    let mut sums = [(0.0, 0.0); 2];
    let (mut mean, mut n) = (0.0, 0.0);
    watch(&a.model, &mut state, loop_steps(&model, 2.0), |state, scratch| {
        let l = &state.links;
        for j in 0..state.n_links {
            let (x, y, _) = scratch.joint_force(j);
            let p = Vec2::new(l.x[j] + model.chain.lever[j] * l.cos[j], l.y[j] + model.chain.lever[j] * l.sin[j]);
            mean += x.hypot(y);
            n += 1.0;
            for (k, span) in route.spans.iter().enumerate() {
                let d = p - span.start;
                let along = d.dot(&span.direction);
                if along > 20e-3 && along < span.length_m - 20e-3 && d.perp(&span.direction).abs() < 5e-3 {
                    sums[k].0 -= x * span.direction.x + y * span.direction.y;
                    sums[k].1 += 1.0;
                }
            }
        }
    });
    let [slack, tight] = sums.map(|(sum, count)| sum / count);
    let expected = 20.0 / model.sprockets[1].geometry.rolling_radius_m();
    let (mean, assembled_mean) = (mean / n, a.report.static_mean_tension_n);
    println!("tight {tight:.2} N - slack {slack:.2} N = {:.2} N, load / rolling radius {expected:.2} N", tight - slack);
    println!(
        "without friction: mean tension {mean:.2} N, static {assembled_mean:.2} N: transverse waves take up chain length"
    );
    assert!(((tight - slack) / expected - 1.0).abs() < 5e-3);
}

#[test]
fn mean_tension_stays_that_of_the_static_assembly() {
    let a = assembled(&drive(&[]));
    let model = a.model.clone();
    let mut state = a.state;
    let (mut sum, mut n) = (0.0, 0.0);
    watch(&a.model, &mut state, loop_steps(&model, 2.0), |state, scratch| {
        for j in 0..state.n_links {
            let (x, y, _) = scratch.joint_force(j);
            sum += x.hypot(y);
            n += 1.0;
        }
    });
    let (mean, at_rest) = (sum / n, a.report.static_mean_tension_n);
    println!("mean tension {mean:.2} N, static assembly {at_rest:.2} N ({:+.2} %)", 100.0 * (mean / at_rest - 1.0));
    assert!((mean / at_rest - 1.0).abs() < 0.03);
}

/// First touches on the driver over one loop.
#[derive(Default)]
struct FirstTouches {
    /// Recorded approach speed [m/s].
    approach: Vec<f64>,
    /// That over |v_rel . n|, the joint's velocity against the sprocket along the actual normal.
    along_normal: Vec<f64>,
    /// |v_rel| over p |omega - w|, w the rate at which the link ahead turns already; and over p omega.
    relative: Vec<f64>,
    relative_to_p_omega: Vec<f64>,
    segments: Vec<u32>,
}

fn first_touches(form: &str, pitch_mm: f64) -> FirstTouches {
    let overrides = [
        format!("sprockets.driver.gap_form={form}"),
        format!("sprockets.driven.gap_form={form}"),
        format!("chain.bush.inner.pitch_mm={pitch_mm}"),
        format!("chain.bush.outer.pitch_mm={pitch_mm}"),
    ];
    let overrides: Vec<&str> = overrides.iter().map(String::as_str).collect();
    let a = assembled(&drive(&overrides));
    let model = a.model.clone();
    let mut state = a.state;
    let (driver, omega) = (&model.sprockets[0], model.sprockets[0].nominal_speed_rad_s);
    let mut touches = FirstTouches::default();
    let mut last_seen = vec![f64::NEG_INFINITY; 90];
    watch(&a.model, &mut state, loop_steps(&model, 1.0), |state, scratch| {
        let c = contacts_at(&model, state, scratch);
        let t = state.step as f64 * model.step_s;
        for i in 0..c.link.len() {
            if c.body[i] != 0 || c.feature[i] > 1 {
                continue;
            }
            let (link, front) = (c.link[i] as usize, c.feature[i] == 1);
            let joint = if front { link } else { (link + 89) % 90 };
            // New when the bush was off this sprocket for two tooth periods.
            let fresh = t - last_seen[joint] > 2e-3;
            last_seen[joint] = t;
            if !fresh || t < 3e-3 || c.approach_speed_m_s[i] < 0.3 {
                continue;
            }
            let l = &state.links;
            let arm = Vec2::new(l.cos[link], l.sin[link]) * (model.chain.lever[link] * if front { 1.0 } else { -1.0 });
            let d = Vec2::new(l.x[link], l.y[link]) + arm - driver.body.centre;
            let turn = |v: Vec2| Vec2::new(-v.y, v.x);
            // Velocities of half a step before, when the touch was felt.
            let v = Vec2::new(l.vx[link], l.vy[link]) + turn(arm) * l.omega[link] - turn(d) * omega;
            let ahead = l.omega[(joint + 1) % 90];
            touches.approach.push(c.approach_speed_m_s[i]);
            touches.along_normal.push(c.approach_speed_m_s[i] / (v.x * c.normal_x[i] + v.y * c.normal_y[i]).abs());
            touches.relative.push(v.norm() / (8e-3 * (omega - ahead).abs()));
            touches.relative_to_p_omega.push(v.norm() / (8e-3 * omega));
            touches.segments.push(c.segment[i]);
        }
    });
    touches
}

fn median(v: &[f64]) -> f64 {
    let mut sorted = v.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

#[test]
fn bushes_strike_with_the_seating_speed_along_the_actual_normal() {
    let p_omega = 8e-3 * 3000.0 * PI / 30.0;
    // Closed forms for a span that does not turn before it seats: |v_rel| = p omega, and along the normal p omega
    // sin(2 pi/z + gamma) on the flank (max gap 1.657, min gap 1.304 m/s), p omega cos(pi/z) in the root (2.482 m/s). Here the
    // span's inertia keeps it straight, so that the link ahead turns already when the bush arrives, and |v_rel| is
    // p (omega - w).
    for (form, pitch_mm) in [("max", 8.0), ("max", 7.98), ("min", 8.0), ("min", 7.98)] {
        let t = first_touches(form, pitch_mm);
        let count = |s: Segment| t.segments.iter().filter(|x| **x == s as u32).count();
        let (along, relative) = (median(&t.along_normal), median(&t.relative));
        println!(
            "{form}-gap, links {pitch_mm} mm: median approach {:.3} m/s of p omega = {p_omega:.3} m/s; over |v_rel . n| {along:.3}; \
             |v_rel| / p(omega - w) {relative:.3}, / p omega {:.3}; first touches: seat {}, flanks {}, tip {}",
            median(&t.approach),
            median(&t.relative_to_p_omega),
            count(Segment::Seat),
            count(Segment::FlankClockwise) + count(Segment::FlankCounterclockwise),
            count(Segment::TipCorner) + count(Segment::TipLand)
        );
        assert!(t.approach.len() > 60, "{} engagements", t.approach.len());
        assert!((along - 1.0).abs() < 0.05, "{form} {pitch_mm}: {along}");
        assert!((relative - 1.0).abs() < 0.05, "{form} {pitch_mm}: {relative}");
    }
}

/// Ledger at the end of 0.2 s with a step.
fn energy_after(step_us: Option<f64>) -> (f64, Energy) {
    let set = step_us.map(|s| format!("run.step_us={s}"));
    let overrides: Vec<&str> = set.iter().map(String::as_str).collect();
    let a = assembled(&drive(&overrides));
    let mut camera = Camera::default();
    let mut state = a.state;
    let mut scratch = Scratch::new(&a.model);
    let steps = (0.2 / a.model.step_s) as u64;
    for step in 0..=steps {
        explicit::evaluate(&a.model, &state, &mut scratch).expect("holds");
        if step == 0 || step == steps {
            let frame = camera.take(&a.model, &state, &scratch);
            if step == steps {
                return (a.model.step_s, frame.energy);
            }
        }
        explicit::advance(&a.model, &mut state, &mut scratch);
    }
    unreachable!("the last step returns")
}

#[test]
fn joules_add_up_and_the_error_falls_with_the_step() {
    let (h, coarse) = energy_after(None);
    let fraction = |e: &Energy| (e.error_j / e.work_in_j).abs();
    let (half, fine) = energy_after(Some(h * 0.5e6));
    println!(
        "energy error {:.2e} of the work at {:.2} us ({:.2e} of the losses), {:.2e} at {:.2} us",
        fraction(&coarse),
        h * 1e6,
        (coarse.error_j / coarse.lost_j()).abs(),
        fraction(&fine),
        half * 1e6
    );
    assert!(fraction(&coarse) < 1e-4);
    // Second order: a quarter, with room for the impacts' random part.
    assert!(fraction(&fine) < 0.5 * fraction(&coarse));
    for lost in
        [fine.lost_pin_damping_j, fine.lost_pin_friction_j, fine.lost_contact_damping_j, fine.lost_contact_friction_j]
    {
        assert!(lost > 0.0, "{fine:?}");
    }
}

#[test]
fn positions_without_contact_converge_with_the_second_order() {
    // A ring of chain that turns and wobbles: joints only, with damping.
    let model_at = |h: f64| {
        let a = assembled(&drive_without_guides(&[]));
        let mut joint = a.model.chain.joint;
        joint.friction_arm_m = 0.0;
        Model::chain_only(24, a.model.rows.clone(), joint, h)
    };
    let run = |h: f64| -> State {
        let model = model_at(h);
        let n = 24;
        let mut state = State::at_rest(n, model.chain.padded, 0, [false, false], [false; 3]);
        let half = PI / n as f64;
        let r = 4e-3 / half.tan() * 1.0002;
        let mut place = |i: usize| {
            let e = pitchline::geometry::unit(2.0 * half * i as f64);
            let l = &mut state.links;
            (l.x[i], l.y[i], l.cos[i], l.sin[i]) = (r * e.x, r * e.y, -e.y, e.x);
            let wobble = 0.3 * (3.0 * 2.0 * half * i as f64).cos();
            (l.vx[i], l.vy[i]) = (-150.0 * r * e.y + wobble * e.x, 150.0 * r * e.x + wobble * e.y);
            l.omega[i] = 150.0;
        };
        (0..n).for_each(&mut place);
        // v(-h/2) = v_0 - h/2 a_0: the leapfrog's own start.
        let mut scratch = Scratch::new(&model);
        // The damping feels the velocity: with a_0 known, a_0 once more.
        for _ in 0..3 {
            explicit::evaluate(&model, &state, &mut scratch).expect("holds");
            state.links.ax.clone_from(&scratch.ax);
            state.links.ay.clone_from(&scratch.ay);
            state.links.alpha.clone_from(&scratch.alpha);
        }
        for i in 0..n {
            state.links.vx[i] -= 0.5 * h * state.links.ax[i];
            state.links.vy[i] -= 0.5 * h * state.links.ay[i];
            state.links.omega[i] -= 0.5 * h * state.links.alpha[i];
        }
        watch(&model, &mut state, (2e-4 / h).round() as u64, |_, _| {});
        state
    };
    let reference = run(0.0625e-6);
    let error = |h: f64| {
        let s = run(h);
        (0..24)
            .map(|i| (s.links.x[i] - reference.links.x[i]).hypot(s.links.y[i] - reference.links.y[i]))
            .fold(0.0, f64::max)
    };
    let (e2, e1) = (error(1e-6), error(0.5e-6));
    let order = (e2 / e1).log2();
    println!("position error {e2:.2e} m at 1 us, {e1:.2e} m at 0.5 us: order {order:.2}");
    assert!(order > 1.8 && order < 2.4, "order {order}");
}

/// Effects on all joints and on guides change what they say, and nothing where they are zero.
#[test]
fn effects_on_joints_and_guides_reach_the_model() {
    let model = |sets: &[&str]| common::assembled(&common::drive(sets)).model;
    let plain = model(&[]);
    let off = model(&["effects.wear_elongation.chain.length_um=0", "effects.pin_friction.chain.friction=0"]);
    assert_eq!(plain.chain.lever, off.chain.lever);
    let worn = model(&["effects.wear_elongation.chain.length_um=4"]);
    for (a, b) in plain.chain.lever.iter().zip(&worn.chain.lever).take(90) {
        assert!((b - a - 2e-6).abs() < 1e-15, "half of it on either side");
    }
    let name = plain.guides[0].name.clone();
    let guided = model(&[
        &format!("effects.guide_friction.{name}.friction=0.05"),
        &format!("effects.guide_compliance.{name}.compliance_um_per_kn=100"),
        "effects.pin_friction.chain.friction=0.02",
    ]);
    let stiffness = |m: &pitchline::model::Model, k: usize| match m.guides[k].body.law {
        pitchline::elements::contact_law::ContactLaw::Linear { stiffness_n_per_m, .. } => stiffness_n_per_m,
        _ => f64::NAN,
    };
    // 100 um/kN is 1e7 N/m, in series.
    let series = 1.0 / (1.0 / stiffness(&plain, 0) + 1e-7);
    assert!((stiffness(&guided, 0) / series - 1.0).abs() < 1e-12);
    assert_eq!(stiffness(&guided, 1), stiffness(&plain, 1));
    assert!((guided.guides[0].body.friction - plain.guides[0].body.friction - 0.05).abs() < 1e-15);
    assert!(guided.chain.joint.friction_arm_m > plain.chain.joint.friction_arm_m);
}

/// What the catalogue says that drives with links take, they take.
#[test]
fn drives_with_links_take_the_effects_that_say_so() {
    use pitchline::effects::{EFFECTS, On};
    let mut taken = 0;
    for e in EFFECTS {
        let target = match e.on {
            On::Guide => "tight",
            On::Sprocket => "driver",
            On::Chain => "odd",
            _ => "chain",
        };
        let keys = e.parameters.iter().filter(|p| p.key != "arm_um");
        let sets: Vec<String> = keys.map(|p| format!("effects.{}.{target}.{}=1", e.name, p.key)).collect();
        let result = pitchline::drive::Drive::parse("bush-20-40", pitchline::drive::BUNDLED[0].1, &sets);
        assert_eq!(result.is_ok(), e.links, "{}: {sets:?}", e.name);
        taken += usize::from(e.links);
    }
    assert_eq!(taken, 6);
}
