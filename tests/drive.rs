//! The 20/40 drive as a whole: ratio, tensions, approach speeds, energy, order of convergence.

mod common;
#[path = "common/contour.rs"]
mod contour;

use common::{NO_FRICTION, assembled, drive, drive_without_guides, watch};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::geometry::Vec2;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::Model;
use pitchline::recording::capture::{Camera, contacts_of};
use pitchline::recording::frame::{Energy, Segment};
use pitchline::state::State;
use std::f64::consts::PI;

/// Steps for this number of loops of the chain.
fn loop_steps(model: &Model, loops: f64) -> u64 {
    (loops * model.chain.n_links as f64 * 8e-3 / model.chain_speed_m_s() / model.step_s).round() as u64
}

/// A drive without guides needs no law for what touches them; one with guides does.
#[test]
fn the_contact_of_guides_is_asked_for_where_there_are_guides() {
    let bundled = BUNDLED.iter().find(|(name, _)| *name == "bush-20-40").expect("bundled").1;
    let without = |tables: &[&str]| {
        let mut keeps = true;
        let kept = bundled.lines().filter(|line| {
            if line.starts_with('[') {
                keeps = !tables.iter().any(|t| line.starts_with(t));
            }
            keeps
        });
        kept.collect::<Vec<_>>().join("\n")
    };
    Drive::parse("bare.toml", &without(&["[guides", "[contact.guide"]), &[]).expect("no guides, no law");
    let report = Drive::parse("lawless.toml", &without(&["[contact.guide"]), &[]).expect_err("guides without a law");
    assert!(report.to_string().contains("`contact.guide` has 0 contact laws"), "{report}");
}

#[test]
fn ratio_and_span_speed_hold_over_whole_loops_and_no_tooth_is_skipped() {
    let a = assembled(&drive(&[]));
    let model = a.model.clone();
    let mut state = a.state;
    let steps = loop_steps(&model, 2.0);
    let start = state.coordinates.angle.clone();
    // After whole loops every link is back at its position, except for the deviation of the mean speed: its advance is
    // a whole number of loops of N nominal pitches, plus the displacement along its span.
    let before = state.links.clone();
    watch(&a.model, &mut state, steps, |_, _| {});
    let l = &state.links;
    let advance: f64 = (0..state.lanes)
        .map(|i| (l.x[i] - before.x[i]) * before.cos[i] + (l.y[i] - before.y[i]) * before.sin[i])
        .sum::<f64>()
        / state.lanes as f64;
    let time = steps as f64 * model.step_s;
    let speed = (2.0 * 90.0 * 8e-3 + advance) / time;
    let turned = [state.coordinates.angle[0] - start[0], state.coordinates.angle[1] - start[1]];
    let ratio = turned[1] / turned[0];
    println!(
        "ratio {ratio:.8} (1/2), span speed {speed:.6} m/s in nominal pitches (z p n = {:.6} m/s)",
        model.chain_speed_m_s()
    );
    // A skipped tooth in two loops (nine turns of the driver) would appear as 1/180 in both.
    assert!((ratio / 0.5 - 1.0).abs() < 1e-4, "ratio {ratio}");
    assert!((speed / model.chain_speed_m_s() - 1.0).abs() < 1e-4, "span speed {speed}");
}

#[test]
fn tight_minus_slack_is_the_load_over_the_rolling_radius_and_the_mean_stays_that_of_the_assembly() {
    // Without any friction bending waves stay in the spans and shorten the chain: the mean tension rises. A little
    // friction in the joints damps them; without contact friction the difference stays unchanged.
    let damped = [NO_FRICTION[0], NO_FRICTION[1], "chain.joint.friction=0.02"];
    for (overrides, mean_bound) in [(NO_FRICTION, f64::INFINITY), (damped, 0.03)] {
        let (difference, expected, mean, at_rest) = tensions(&overrides);
        let (off, rise) = (difference / expected - 1.0, mean / at_rest - 1.0);
        println!(
            "{}: tight - slack {difference:.2} N, load / rolling radius {expected:.2} N ({:+.2} %); mean tension {mean:.2} N, static \
             assembly {at_rest:.2} N ({:+.1} %)",
            overrides[2],
            100.0 * off,
            100.0 * rise
        );
        assert!(off.abs() < 5e-3, "{off}");
        assert!(rise.abs() < mean_bound, "{rise}");
    }
}

/// Tight minus slack tension, load over rolling radius, mean of the loop, mean at rest under load [N], over two loops.
fn tensions(overrides: &[&str]) -> (f64, f64, f64, f64) {
    let a = assembled(&drive(overrides));
    let model = a.model.clone();
    let mut state = a.state;
    let route = model.routes.first().expect("a route");
    let mut sums = [(0.0, 0.0); 2];
    let (mut mean, mut n) = (0.0, 0.0);
    watch(&a.model, &mut state, loop_steps(&model, 2.0), |state, scratch| {
        let l = &state.links;
        for j in 0..state.lanes {
            let (x, y, _) = scratch.joint_force(j);
            let p = Vec2::new(l.x[j] + model.chain.lever[j] * l.cos[j], l.y[j] + model.chain.lever[j] * l.sin[j]);
            mean += x.hypot(y);
            n += 1.0;
            for (k, span) in (0..route.sprockets()).map(|k| (k, route.span_after(k))) {
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
    (tight - slack, expected, mean / n, a.report.static_mean_tension_n)
}

#[test]
fn mean_tension_stays_that_of_the_static_assembly() {
    let a = assembled(&drive(&[]));
    let model = a.model.clone();
    let mut state = a.state;
    let (mut sum, mut n) = (0.0, 0.0);
    watch(&a.model, &mut state, loop_steps(&model, 2.0), |state, scratch| {
        for j in 0..state.lanes {
            let (x, y, _) = scratch.joint_force(j);
            sum += x.hypot(y);
            n += 1.0;
        }
    });
    let (mean, at_rest) = (sum / n, a.report.static_mean_tension_n);
    println!("mean tension {mean:.2} N, static assembly {at_rest:.2} N ({:+.2} %)", 100.0 * (mean / at_rest - 1.0));
    assert!((mean / at_rest - 1.0).abs() < 0.03);
}

/// First contacts on the driver over one loop.
#[derive(Default)]
struct FirstTouches {
    /// Recorded approach speed [m/s].
    approach: Vec<f64>,
    /// Ratio to |v_rel . n|, the joint's velocity relative to the sprocket along the actual normal.
    along_normal: Vec<f64>,
    /// |v_rel| over p |omega - w|, w the rate at which the link ahead already turns; and over p omega.
    relative: Vec<f64>,
    relative_to_p_omega: Vec<f64>,
    segments: Vec<u32>,
    /// Speed and mass per length of the chain [m/s, kg/m], and tension of its tight span [N].
    speed_m_s: f64,
    kg_per_m: f64,
    tension_n: f64,
}

fn first_touches(overrides: &[String]) -> FirstTouches {
    let overrides: Vec<&str> = overrides.iter().map(String::as_str).collect();
    let a = assembled(&drive(&overrides));
    let model = a.model.clone();
    let mut state = a.state;
    let (driver, omega) = (&model.sprockets[0], model.sprockets[0].nominal_speed_rad_s);
    let tooth_s = 2.0 * PI / (20.0 * omega);
    let mut touches = FirstTouches { speed_m_s: 8e-3 * 20.0 * omega / (2.0 * PI), ..FirstTouches::default() };
    touches.kg_per_m = model.chain.mass[..90].iter().sum::<f64>() / (90.0 * 8e-3);
    let span = model.routes.first().expect("a route").span_after(1);
    let (mut pull, mut pulls) = (0.0, 0.0);
    let mut last_seen = vec![f64::NEG_INFINITY; 90];
    let mut free = state.links.clone();
    watch(&a.model, &mut state, loop_steps(&model, 1.0), |state, scratch| {
        let before = std::mem::replace(&mut free, state.links.clone());
        let c = contacts_of(&model, state, scratch, None);
        let t = state.step as f64 * model.step_s;
        for j in 0..state.lanes {
            let l = &state.links;
            let along = (Vec2::new(l.x[j], l.y[j]) - span.start).dot(&span.direction);
            let off = (Vec2::new(l.x[j], l.y[j]) - span.start).perp(&span.direction).abs();
            if along > 20e-3 && along < span.length_m - 20e-3 && off < 5e-3 {
                let (x, y, _) = scratch.joint_force(j);
                pull += x.hypot(y);
                pulls += 1.0;
            }
        }
        for i in 0..c.link.len() {
            if c.body[i] != 0 || c.feature[i] > 1 {
                continue;
            }
            let (link, front) = (c.link[i] as usize, c.feature[i] == 1);
            let joint = if front { link } else { (link + 89) % 90 };
            // A first contact if the bush was off this sprocket for two tooth periods.
            let fresh = t - last_seen[joint] > 2.0 * tooth_s;
            last_seen[joint] = t;
            if !fresh || t < 3.0 * tooth_s || c.approach_speed_m_s[i] < 0.12 * 8e-3 * omega {
                continue;
            }
            let l = &state.links;
            let arm = Vec2::new(l.cos[link], l.sin[link]) * (model.chain.lever[link] * if front { 1.0 } else { -1.0 });
            let d = Vec2::new(l.x[link], l.y[link]) + arm - driver.frame.origin;
            let turn = |v: Vec2| Vec2::new(-v.y, v.x);
            // Velocities before the step of first contact.
            let v = Vec2::new(before.vx[link], before.vy[link]) + turn(arm) * before.omega[link] - turn(d) * omega;
            let ahead = before.omega[(joint + 1) % 90];
            touches.approach.push(c.approach_speed_m_s[i]);
            touches.along_normal.push(c.approach_speed_m_s[i] / (v.x * c.normal_x[i] + v.y * c.normal_y[i]).abs());
            touches.relative.push(v.norm() / (8e-3 * (omega - ahead).abs()));
            touches.relative_to_p_omega.push(v.norm() / (8e-3 * omega));
            touches.segments.push(c.segment[i]);
        }
    });
    touches.tension_n = pull / pulls;
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
    // Closed forms for a span that does not turn before it seats: |v_rel| = p omega, and along the normal p omega sin(2
    // pi/z + gamma) on the flank (max gap 1.657, min gap 1.304 m/s), p omega cos(pi/z) in the root (2.482 m/s). Here
    // the link ahead already turns when the bush arrives (the next test gives its rate), and |v_rel| is p (omega - w).
    for (form, pitch_mm) in [("max", 8.0), ("max", 7.98), ("min", 8.0), ("min", 7.98)] {
        let t = first_touches(&[
            format!("sprockets.driver.gap_form={form}"),
            format!("sprockets.driven.gap_form={form}"),
            format!("chain.bush.inner.pitch_mm={pitch_mm}"),
            format!("chain.bush.outer.pitch_mm={pitch_mm}"),
        ]);
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
        assert!(
            form == "min" || (1.2..2.6).contains(&median(&t.approach)),
            "{form} {pitch_mm}: {:?}",
            median(&t.approach)
        );
        assert!((relative - 1.0).abs() < 0.05, "{form} {pitch_mm}: {relative}");
    }
}

/// The sprocket emits a transverse wave into the span, of speed c = sqrt(T / rho), T the tension of the tight span: the
/// joint on the pitch circle accelerates laterally with omega v, so that the link behind it turns at w = omega v / c,
/// and its bush arrives with p omega (1 - v / c), not p omega. At 3000 rpm v is 8 m/s and c 38 m/s.
#[test]
fn the_span_is_a_string_and_takes_its_share_of_the_seating_speed() {
    let cases =
        [(300, 300, 0.1), (1000, 300, 0.1), (3000, 300, 0.01), (3000, 300, 0.3), (3000, 1200, 0.1), (4500, 600, 0.1)];
    for (rpm, preload, friction) in cases {
        let t = first_touches(&[
            format!("speeds.constant.driver.speed_rpm={rpm}"),
            format!("preload.tension_n={preload}"),
            format!("chain.joint.friction={friction}"),
        ]);
        let wave_m_s = (t.tension_n / t.kg_per_m).sqrt();
        let (ratio, expected) = (median(&t.relative_to_p_omega), 1.0 - t.speed_m_s / wave_m_s);
        println!(
            "{rpm} rpm, tight span {:.0} N, joint friction {friction}: |v_rel| / p omega {ratio:.3}, 1 - v/c {expected:.3}; v {:.2}, c \
             {wave_m_s:.1} m/s",
            t.tension_n, t.speed_m_s
        );
        assert!(t.approach.len() > 60, "{} engagements", t.approach.len());
        // measured: +1 % at 300 rpm, -3 to -5 % above.
        assert!((ratio / expected - 1.0).abs() < 0.06, "{ratio} {expected}");
        // At speeds low against the wave speed only p omega remains.
        assert!(rpm > 300 || (ratio - 1.0).abs() < 0.05, "{ratio}");
    }
}

/// Energy ledger at the end of 0.2 s with a step.
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
    // Second order: a quarter, with a margin for the random part of the impacts.
    assert!(fraction(&fine) < 0.5 * fraction(&coarse));
    for lost in
        [fine.lost_pin_damping_j, fine.lost_pin_friction_j, fine.lost_contact_damping_j, fine.lost_contact_friction_j]
    {
        assert!(lost > 0.0, "{fine:?}");
    }
}

#[test]
fn positions_without_contact_converge_with_the_second_order() {
    // A loop of chain that turns and oscillates: joints only, with damping.
    let model_at = |h: f64| {
        let a = assembled(&drive_without_guides(&[]));
        let mut joint = a.model.chain.joints[0];
        joint.friction_arm_m = 0.0;
        Model::chain_only(24, a.model.rows.clone(), joint, h)
    };
    let run = |h: f64| -> State {
        let model = model_at(h);
        let n = 24;
        let mut state = State::at_rest(&model.layout());
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
        // v(-h/2) = v_0 - h/2 a_0: the start of the leapfrog scheme.
        let mut scratch = Scratch::new(&model);
        // The damping depends on the velocity: iterates a_0.
        for _ in 0..3 {
            explicit::evaluate(&model, &state, &mut scratch).expect("holds");
            state.links.ax.clone_from(&scratch.ax);
            state.links.ay.clone_from(&scratch.ay);
            state.links.alpha.clone_from(&scratch.alpha);
            state.links.joint_ax.clone_from(&scratch.joint_ax);
            state.links.joint_ay.clone_from(&scratch.joint_ay);
            state.links.joint_alpha.clone_from(&scratch.joint_alpha);
            state.joint_limit.clone_from(&scratch.joint_limit);
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

/// Frames only examine pairs that the step's windows and blocks mark as possible contacts, and only the gap that the
/// kernel assigns to a bush. An exhaustive search of every bush in every gap and every plate end on every guide finds
/// the same contacts.
#[test]
fn frames_hold_every_contact_that_a_look_at_everything_finds() {
    let (teeth, guides) = contacts_hold(common::drive(&[]), 12_000);
    assert!(teeth > 20_000 && guides > 40, "{teeth} {guides}");
    let displaced = [
        "effects.tooth_pitch_error.driven.amplitude_um=40",
        "effects.tooth_pitch_error.driven.order=3",
        "effects.gap_error.driven.gap=5",
        "effects.gap_error.driven.outward_um=-30",
    ];
    assert!(contacts_hold(common::drive(&displaced), 1500).0 > 3000);
    assert!(contacts_hold(beside_an_idler(), 3000).0 > 6000);
}

/// Near the driver, a third sprocket bends the slack span from outside, tips 5 mm apart: bushes move from one to the
/// other in windows of both.
fn beside_an_idler() -> pitchline::drive::Drive {
    let (text, _) = pitchline::drive::BUNDLED[0].1.split_once("[guides.fixed.tight]").expect("guides at the end");
    let idler = "[sprockets.idler]\nteeth = 20\nwrap = \"outside\"\nx_mm = 45\ny_mm = -39\ninertia_kg_m2 = 1e-4\n";
    let text = text.replace("[\"driver\", \"driven\"]", "[\"driver\", \"idler\", \"driven\"]") + idler;
    pitchline::drive::Drive::parse("idler.toml", &text, &[]).unwrap_or_else(|e| panic!("{e}"))
}

/// Compares frames with an exhaustive search, at every tenth node; returns the numbers of contacts with teeth and with
/// guides.
fn contacts_hold(drive: pitchline::drive::Drive, steps: usize) -> (usize, usize) {
    use pitchline::pairs::bush_gap::gap_contact;
    use pitchline::recording::frame::Feature;
    let assembly = common::assembled(&drive);
    let (model, mut state) = (assembly.model, assembly.state);
    let profile = |g: &pitchline::model::GuideModel| g.geometry.profile().expect("a contour");
    let guides: Vec<_> = model.guides.iter().map(profile).collect();
    let turned = |(cos, sin): (f64, f64), v: Vec2| Vec2::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x);
    let (mut scratch, mut seen) = (Scratch::new(&model), [0, 0]);
    for step in 0..steps {
        explicit::evaluate(&model, &state, &mut scratch).expect("the run holds");
        if step % 10 == 0 {
            let l = &state.links;
            let end = |i: usize, front: bool| {
                let lever = model.chain.lever[i] * if front { 1.0 } else { -1.0 };
                Vec2::new(l.x[i] + lever * l.cos[i], l.y[i] + lever * l.sin[i])
            };
            let mut all = Vec::new();
            for (k, sprocket) in model.sprockets.iter().enumerate() {
                let axes = (state.coordinates.cos[k], state.coordinates.sin[k]);
                for j in 0..model.chain.n_links {
                    let (link, front) = model.chain.bush_carrier(j);
                    let d = turned(axes, end(link, front) - sprocket.frame.origin);
                    let hit = gap_contact(sprocket.geometry.iso().expect("teeth"), d, sprocket.body.bush_radius_m);
                    // A point nearer to the axis than the root is in no gap.
                    if hit.touch.penetration_m > 0.0 && d.norm() > 0.9 * sprocket.geometry.root_radius_m() {
                        let feature = if front { Feature::FrontBush } else { Feature::RearBush };
                        all.push((link as u32, feature as u32, k as u32, hit.tooth, hit.touch.penetration_m));
                        seen[0] += 1;
                    }
                }
            }
            for (k, guide) in model.guides.iter().enumerate() {
                let axes = (guide.body.along.x, guide.body.along.y);
                for (link, front) in (0..model.chain.n_links).flat_map(|i| [(i, true), (i, false)]) {
                    let d = turned(axes, end(link, front) - guide.geometry.origin);
                    let touches = contour::touches(&guides[k], d, guide.body.plate_radius_m);
                    let Some(deepest) = touches.iter().map(|t| t.penetration_m).max_by(f64::total_cmp) else {
                        continue;
                    };
                    let feature = if front { Feature::FrontPlateEnd } else { Feature::RearPlateEnd };
                    all.push((link as u32, feature as u32, (model.sprockets.len() + k) as u32, 0, deepest));
                    seen[1] += 1;
                }
            }
            all.sort_by_key(|r| (r.0, r.1, r.2));
            let c = contacts_of(&model, &state, &scratch, None);
            // A contact without overlap exerts force within the step.
            assert!((0..c.link.len()).all(|i| c.penetration_m[i] > 0.0 || c.normal_force_n[i] > 0.0));
            let found: Vec<_> = (0..c.link.len())
                .filter(|i| c.penetration_m[*i] > 0.0)
                .map(|i| (c.link[i], c.feature[i], c.body[i], c.tooth[i], c.penetration_m[i]))
                .collect();
            let keys =
                |rows: &[(u32, u32, u32, u32, f64)]| rows.iter().map(|r| (r.0, r.1, r.2, r.3)).collect::<Vec<_>>();
            assert_eq!(keys(&found), keys(&all), "step {step}");
            let off = found.iter().zip(&all).map(|(a, b)| (a.4 - b.4).abs()).fold(0.0, f64::max);
            assert!(off < 1e-15, "step {step}: {off:e} m apart");
        }
        explicit::advance(&model, &mut state, &mut scratch);
    }
    println!("{}: {} contacts with teeth, {} with guides", drive.name, seen[0], seen[1]);
    seen.into()
}

/// Sensors on a drive with link bodies: shaft speeds follow the teeth, tensions the load, torque the power.
#[test]
fn sensors_read_what_the_drive_does() {
    let sensors = "[sensors.tachometer.driven]\n[sensors.torque.driver]\n[sensors.encoder.angle]\nbody = \"driven\"\n[sensors.strain_gauge.tight]\nspan = [\"driven\", \"driver\"]\n[sensors.strain_gauge.slack]\nspan = [\"driver\", \"driven\"]\n[sensors.strain_gauge.link]\nlink = 12\n";
    let text = format!("{}\n{sensors}", pitchline::drive::BUNDLED[0].1);
    let set = ["speeds.constant.driver.speed_rpm=1000".to_string()];
    let drive = pitchline::drive::Drive::parse("with-sensors.toml", &text, &set).unwrap_or_else(|e| panic!("{e}"));
    let mut tracer = pitchline::sensing::Tracer::new(&drive, 2e-5).expect("assembled");
    tracer.run_for(0.05).expect("runs");
    tracer.clear_readings();
    // One loop of the chain.
    tracer.run_until(0.27).expect("runs");
    let series = |path: &str| tracer.readings(drive.sensors.iter().position(|s| s.path == path).expect("a sensor"));
    let mean = |path: &str| series(path).iter().sum::<f64>() / series(path).len() as f64;
    let speed = 1000.0 / 60.0 * std::f64::consts::PI;
    assert!((mean("sensors.tachometer.driven") / speed - 1.0).abs() < 1e-4, "{}", mean("sensors.tachometer.driven"));
    let angle = series("sensors.encoder.angle");
    let turned = (angle[angle.len() - 1] - angle[0]) / ((angle.len() - 1) as f64 * tracer.step_s());
    assert!((turned / speed - 1.0).abs() < 1e-3, "{turned}");
    // 20 N m at the driven shaft are 10 at the driver, plus friction losses.
    let torque = mean("sensors.torque.driver");
    assert!(torque > 10.0 && torque < 10.6, "{torque}");
    let (tight, slack) = (mean("sensors.strain_gauge.tight"), mean("sensors.strain_gauge.slack"));
    let load = 20.0 / (40.0 * 8e-3 / (2.0 * std::f64::consts::PI));
    assert!(((tight - slack) / load - 1.0).abs() < 0.02, "{tight} - {slack}, load {load}");
    let link = series("sensors.strain_gauge.link");
    let (low, high) = link.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    assert!(low > 0.0 && low < slack && high > tight, "round the loop it meets both: {low} to {high}");
}

/// The lumped form has the torsional mode of the drive's linearisation within 3 %, and the output of `pitchline lump`
/// is a valid machine.
#[test]
fn a_lumped_drive_has_the_mode_of_its_links() {
    use pitchline::lumping::{lumped_text, lumping};
    for sets in [
        &[][..],
        &["loads.constant.driven.torque_nm=5"],
        &["chain.joint.stiffness_n_per_m=1e7"],
        &["sprockets.driven.inertia_kg_m2=5e-4"],
    ] {
        let drive = common::drive(sets);
        let (l, model, at) = lumping(&drive).unwrap_or_else(|e| panic!("{e:?}"));
        let r = l.radius_m[1];
        let stiffness: f64 = l.spans.iter().map(|s| s.stiffness_n_per_m * r * r).sum();
        let omega = (stiffness / l.inertia_kg_m2[1]).sqrt();
        // Transverse modes of the spans are nearby: the shaft mode is the one with the largest sprocket motion.
        let near = (-20..=20).filter_map(|i| {
            pitchline::statics::mode_near(&model, &at.configuration, omega * (1.0 + 0.01 * f64::from(i)))
        });
        let (mode, share) = near.max_by(|a, b| a.1.total_cmp(&b.1)).expect("a mode");
        println!(
            "{sets:?}: lumped {:.1} Hz, links {:.1} Hz, {:.0} % in the sprocket",
            omega / 2.0 / PI,
            mode / 2.0 / PI,
            100.0 * share
        );
        assert!(share > 0.5, "a mode of the shaft, not of a span");
        assert!((omega / mode - 1.0).abs() < 0.03, "{omega} against {mode}");
        let text = lumped_text(&drive, &l);
        let machine =
            pitchline::machine::Machine::parse("lumped.toml", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert_eq!((machine.springs.len(), machine.bodies.len()), (2, 2));
    }
}

/// Every kind of sensor that drives with links have is read of a bundled drive, and has the unit of its row; the others are refused.
#[test]
fn every_kind_of_sensor_is_a_row_that_is_read() {
    use pitchline::drive::sensors::SENSORS;
    let (_, text) = BUNDLED.iter().find(|(name, _)| *name == "tensioner-20-40").expect("bundled");
    let keys = [
        ("encoder", "body = \"driven\""),
        ("tachometer", "body = \"tensioner\""),
        ("accelerometer", "body = \"driven\""),
        ("torque", "body = \"driver\""),
        ("strain_gauge", "link = 3"),
        ("force", "guide = \"tight\""),
        ("displacement", "body = \"plunger\""),
        ("twist", "shaft = \"rod\""),
        ("pressure", "chamber = \"high\""),
        ("flow", "passage = \"feed\""),
    ];
    for kind in &SENSORS {
        assert!(kind.lumped.is_some() || kind.links.is_some(), "{} is on nothing", kind.name);
        assert_eq!(SENSORS.iter().filter(|k| k.name == kind.name).count(), 1);
        let key = keys.iter().find(|(name, _)| *name == kind.name).map_or("", |(_, key)| key);
        let rod = "[elastic_shafts.rod]\nbody = \"driven\"\nlength_mm = 100\ndiameter_mm = 20\n";
        let with = format!("{text}\n{rod}\n[sensors.{}.probe]\n{key}\n", kind.name);
        let read = Drive::parse("t.toml", &with, &[]);
        match (kind.links, read) {
            (Some(_), Ok(drive)) => {
                let sensor = drive.sensors.iter().find(|s| s.name == "probe").expect("read");
                assert_eq!(sensor.kind, kind);
                let units: Vec<&str> = kind.unit.split(" or ").collect();
                assert!(units.contains(&sensor.reads.unit()), "{}: {} of {units:?}", kind.name, sensor.reads.unit());
            }
            (None, Err(report)) => assert!(report.to_string().contains("has no sensor of the kind"), "{report}"),
            (Some(_), Err(report)) => panic!("{}: {report}", kind.name),
            (None, Ok(_)) => panic!("{} is read of links", kind.name),
        }
    }
}

/// A fit sets numbers, a user writes texts: every number of a drive means the same both ways, inside its range and outside.
#[test]
fn numbers_are_read_as_texts_are() {
    use pitchline::drive::{BUNDLED, Drive};
    let titles = |r: &pitchline::diag::Report| {
        r.to_string().lines().filter(|l| l.starts_with("error")).map(str::to_string).collect::<Vec<_>>()
    };
    let (mut read, mut refused) = (0, 0);
    for name in ["bush-20-40", "silent-20-40", "tensioner-20-40"] {
        let text = BUNDLED.iter().find(|(bundled, _)| *bundled == name).expect("bundled").1;
        let drive = Drive::parse(name, text, &[]).expect("a drive");
        for (path, n) in drive.places.numbers() {
            for x in [n.value / n.unit, 1.001 * n.value / n.unit, n.low - 1.0, n.high + 1.0, 0.5] {
                let shown = if x == x.trunc() && x.abs() < 1e9 { format!("{x:.0}") } else { format!("{x:?}") };
                let set = Drive::parse(name, text, &[format!("{path}={shown}")]);
                match (drive.with_numbers(&[(path.to_string(), x)]), set) {
                    (Ok(mut number), Ok(set)) => {
                        (number.overrides, number.places) = (set.overrides.clone(), set.places.clone());
                        assert_eq!(format!("{number:?}"), format!("{set:?}"), "{name} {path} = {x}");
                        read += 1;
                    }
                    (Err(number), Err(set)) => {
                        assert_eq!(titles(&number), titles(&set), "{name} {path} = {x}");
                        assert!(!titles(&number).is_empty(), "{number}");
                        refused += 1;
                    }
                    (number, set) => panic!("{name} {path} = {x}: {:?}, {:?}", number.err(), set.err()),
                }
            }
        }
    }
    assert!(read > 200 && refused > 100, "{read} read, {refused} refused");
}

/// Records are compared over periods: orders that come back within a few turns have one, other motions are refused where they stand.
#[test]
fn a_motion_without_a_period_is_refused_with_its_place() {
    use pitchline::machine::Machine;
    let text = pitchline::drive::BUNDLED[0].1;
    let with = |more: &str| Machine::of_file("bush.toml", &text.replace("speed_rpm = 3000", more)).map(|_| ());
    for orders in ["[1, 2]", "[1.5]", "[0.3333333333333333, 2]", "[0.25]"] {
        with(&format!("speed_rpm = 3000\norders = {orders}\namplitudes_deg = {orders}\nphases_deg = {orders}"))
            .expect("a period");
    }
    let odd = with("speed_rpm = 3000\norders = [1.41421356]\namplitudes_deg = [0.1]\nphases_deg = [0]")
        .expect_err("no period")
        .to_string();
    assert!(odd.contains("order 1.41421356 does not come back within 12 turns"), "{odd}");
    assert!(odd.contains("orders = [1.41421356]"), "{odd}");
    let table = text
        .replace("[speeds.constant.driver]", "[speeds.table.driver]")
        .replace("speed_rpm = 3000", "times_s = [0, 1]\nspeeds_rpm = [1000, 3000]");
    let told = Machine::of_file("bush.toml", &table).expect_err("no period").to_string();
    assert!(told.contains("the speed of `driver` changes with time"), "{told}");
    assert!(told.contains("[speeds.constant.driver]"), "{told}");
}
