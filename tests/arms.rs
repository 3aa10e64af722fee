//! Rails and arms against closed forms: statics of an arm, belt friction on a curved guide, an arm's own oscillation, a
//! straight rail compared with a straight guide, and contacts that move from arcs to lines.

mod common;

use common::bundled;
use pitchline::assemble::{at_rest, resting_state};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::elements::contact_law::PairRadii;
use pitchline::geometry::{Vec2, cross, unit};
use pitchline::integrate::explicit::{self, ContactGroup, Scratch};
use pitchline::model::Model;
use pitchline::recording::capture::Camera;
use pitchline::statics::{Configuration, rail_touches};
use std::fmt::Write as _;

fn drive(text: &str, sets: &[&str]) -> Drive {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    Drive::parse("test.toml", text, &sets).unwrap_or_else(|e| panic!("{e}"))
}

/// Force on the link ahead of joint `j`, and its point of action, at rest.
fn joint_at_rest(model: &Model, q: &Configuration, j: usize) -> (Vec2, Vec2) {
    let k = (j + 1) % model.chain.n_links;
    let end = |link: usize, sign: f64| q.links[link].0 + unit(q.links[link].1) * (sign * model.chain.lever[link]);
    let (front, rear) = (end(j, 1.0), end(k, -1.0));
    let f = model.chain.joint(j).force(front.x - rear.x, front.y - rear.y, 0.0, 0.0);
    (Vec2::new(f.x, f.y), rear)
}

/// At rest the spring balances the moment of the chain, computed from the contacts and from the two spans that leave
/// the rail.
#[test]
fn an_arm_rests_where_spring_and_chain_balance() {
    for sets in [
        &[][..],
        &["arms.tensioner.spring_torque_nm=9", "loads.constant.driven.torque_nm=5"],
        &["guides.rail.slack.radii_mm=[60, 0, 60]", "guides.rail.slack.lengths_mm=[40, 60, 40]"],
        &["arms.tensioner.pivot_x_mm=190", "arms.tensioner.spring_torque_nm=-6", "arms.tensioner.spring_nm_per_rad=20"],
    ] {
        let drive = drive(BUNDLED[3].1, sets);
        let (model, rest) = at_rest(&drive).unwrap_or_else(|e| panic!("{e}"));
        let (arm, rail, q) = (&model.arms[0], &model.rails[0], &rest.configuration);
        let spring = model.coordinates[arm.coordinate].spring.force(q.coordinates[arm.coordinate]);
        let touches = rail_touches(&model, q, rail);
        let mut of_contacts = 0.0;
        for (_, _, t) in &touches {
            let radii = PairRadii { bush_m: t.link_radius_m, body_m: t.body_radius_m };
            of_contacts -= cross(t.point, t.normal * rail.body.law.elastic(t.penetration_m, radii).force_n);
        }
        let first = touches.iter().map(|t| t.0).min().expect("touches");
        let last = touches.iter().map(|t| t.0).max().expect("touches");
        let n = model.chain.n_links;
        let ((pull_rear, at_rear), (pull_front, at_front)) =
            (joint_at_rest(&model, q, (first + n - 1) % n), joint_at_rest(&model, q, last));
        // The links are at rest, so that the rail carries the forces of the joints at its ends.
        let of_spans = cross(at_rear - arm.pivot, pull_rear) - cross(at_front - arm.pivot, pull_front);
        println!(
            "{sets:?}: {} contacts, spring {spring:.6} N m, contacts {of_contacts:.9}, spans {of_spans:.9}, residual {:.1e} N",
            touches.len(),
            rest.residual_n
        );
        assert!(touches.len() > 2);
        assert!((of_contacts + spring).abs() < 1e-6 * spring.abs());
        assert!((of_spans + spring).abs() < 1e-6 * spring.abs());
    }
}

/// The bush chain with finer links, around a fixed rail that bends the tight span: every link length in the drive is
/// divided by `finer`. The only friction is that of the rail.
fn capstan(finer: u32, friction: f64) -> Drive {
    let f = f64::from(finer);
    let (radius_mm, half_rad) = (90.0_f64, 0.7_f64);
    // Around a rail inside the loop, over the middle of the upper span, which runs from the driven sprocket to the
    // driver.
    let (top, x) = (95.0, 119.0);
    let start = (x + radius_mm * half_rad.sin(), top - radius_mm + radius_mm * half_rad.cos());
    let heading = 180.0 - half_rad.to_degrees();
    let mut text = BUNDLED[0].1.split_once("# Straight guides").expect("there").0.to_string();
    write!(
        text,
        "[guides.rail.bend]\nspan = [\"driven\", \"driver\"]\nside = \"inside\"\nstart_x_mm = {}\nstart_y_mm = {}\n\
         heading_deg = {heading}\nlengths_mm = [{}]\nradii_mm = [{radius_mm}]\n",
        start.0,
        start.1,
        2.0 * half_rad * radius_mm
    )
    .expect("memory");
    let links = 2 * (54 * finer as usize);
    let sets = [
        format!("chain.bush.pitch_mm={}", 8.0 / f),
        format!("chain.bush.bush_diameter_mm={}", 5.0 / f),
        format!("chain.bush.pin_diameter_mm={}", 3.3 / f),
        format!("chain.bush.plate_height_mm={}", 7.1 / f),
        format!("chain.bush.links={links}"),
        format!("sprockets.driver.teeth={}", 20 * finer),
        format!("sprockets.driven.teeth={}", 40 * finer),
        format!("contact.guide.friction={friction}"),
        "speeds.constant.driver.speed_rpm=600".into(),
        "chain.joint.friction=0".into(),
        "contact.sprocket.friction=0".into(),
        "contact.guide.stick_speed_m_s=0.01".into(),
        "preload.tension_n=400".into(),
    ];
    Drive::parse("capstan.toml", &text, &sets).unwrap_or_else(|e| panic!("{e}"))
}

/// Ratio of the tensions after and before the rail, of the moving chain without its centrifugal part, and the angle
/// between the spans.
fn tensions_about_rail(drive: &Drive) -> (f64, f64) {
    let assembly = common::assembled(drive);
    let (model, mut state) = (assembly.model, assembly.state);
    let mut scratch = Scratch::new(&model);
    let rail = &model.rails[0];
    let (n, lever) = (model.chain.n_links, model.chain.lever[0]);
    let period = (2.0 * lever / model.chain_speed_m_s().abs() / model.step_s).round() as usize;
    let mass_per_m =
        (model.chain.mass[0] + model.chain.mass[1]) / (2.0 * (model.chain.lever[0] + model.chain.lever[1]));
    let centrifugal = mass_per_m * model.chain_speed_m_s().powi(2);
    let (mut before, mut after, mut turn, mut looks) = (0.0, 0.0, 0.0, 0.0);
    let centre = rail.rail.bends()[0].0;
    for step in 0..2 * period * 10 {
        explicit::evaluate(&model, &state, &mut scratch).expect("holds");
        if step % 7 == 0 {
            let touching = |i: usize| (0..3).any(|set| scratch.memory(ContactGroup::Rails(set)).normal_force[i] > 0.0);
            let on: Vec<usize> = (0..n).filter(|i| touching(*i)).collect();
            // The chain runs over the rail from right to left, with its links in the order of their numbers.
            let along = |i: &&usize| state.links.x[**i] - centre.x;
            let first = *on.iter().max_by(|a, b| along(a).total_cmp(&along(b))).expect("touches");
            let last = *on.iter().min_by(|a, b| along(a).total_cmp(&along(b))).expect("touches");
            let (a, b) = ((first + n - 3) % n, (last + 3) % n);
            let tension = |j: usize| scratch.joint_force(j).0.hypot(scratch.joint_force(j).1) - centrifugal;
            before += tension(a);
            after += tension(b);
            let heading = |i: usize| Vec2::new(state.links.cos[i], state.links.sin[i]);
            turn += cross(heading(a), heading(b)).asin();
            looks += 1.0;
        }
        explicit::advance(&model, &mut state, &mut scratch);
    }
    (after / before, turn / looks)
}

/// Eytelwein: T2/T1 = e^(mu theta). A chain's tension acts on the radius R + r of its joints' axis and friction acts on
/// R, so that its exponent is mu theta R/(R + r); with finer links r tends to zero.
#[test]
fn friction_on_a_curved_guide_is_that_of_a_belt() {
    let friction = 0.3;
    let mut errors = Vec::new();
    for finer in [1, 2] {
        let drive = capstan(finer, friction);
        let (ratio, theta) = tensions_about_rail(&drive);
        let (belt, height) = (friction * theta, drive.chain.plate_end_radius_m());
        let of_chain = belt * 90e-3 / (90e-3 + height);
        println!(
            "pitch {} mm: theta {:.2} deg, ratio {ratio:.5}, belt {:.5}, chain {:.5}",
            8.0 / f64::from(finer),
            theta.to_degrees(),
            belt.exp(),
            of_chain.exp()
        );
        assert!(theta > 0.8);
        assert!((ratio / of_chain.exp() - 1.0).abs() < 5e-3, "{ratio} against {}", of_chain.exp());
        errors.push(ratio / belt.exp() - 1.0);
    }
    // Linear extrapolation from both to links of zero height.
    let limit = 2.0 * errors[1] - errors[0];
    println!("against a belt {errors:?}, in the limit {limit:e}");
    assert!(limit.abs() < 1e-2 && errors[1].abs() < errors[0].abs());
    let (ratio, _) = tensions_about_rail(&capstan(1, 0.0));
    println!("without friction {ratio:.6}");
    assert!((ratio - 1.0).abs() < 2e-3);
}

/// An arm without contact to the chain, its spring with this damping, and more tables behind it.
fn free_arm_with(step_us: f64, more: &str, damping: f64) -> Model {
    let text = format!(
        "{}\n[arms.idle]\npivot_x_mm = 60\npivot_y_mm = -150\ninertia_kg_m2 = 1e-4\nspring_nm_per_rad = 300\n\
         spring_torque_nm = 3\ndamping_nm_s_per_rad = {damping}\n\n[guides.rail.idle]\nspan = [\"driver\", \"driven\"]\n\
         side = \"outside\"\narm = \"idle\"\nstart_x_mm = 60\nstart_y_mm = -120\nheading_deg = 0\nlengths_mm = [60]\nradii_mm = [0]\n{more}",
        BUNDLED[0].1
    );
    let (mut model, _) = at_rest(&drive(&text, &[])).unwrap_or_else(|e| panic!("{e}"));
    model.step_s = step_us * 1e-6;
    model
}

/// q'' + 2 delta q' + omega0^2 (q - q_free) = 0 from rest: closed form, second order in the step, with a complete
/// energy balance.
#[test]
fn an_arm_swings_as_its_spring_and_damper_say() {
    let (inertia, stiffness, damping, free, start) = (1e-4_f64, 300.0_f64, 0.02_f64, 0.01, 0.06_f64);
    let (delta, omega0) = (0.5 * damping / inertia, (stiffness / inertia).sqrt());
    let omega = (omega0 * omega0 - delta * delta).sqrt();
    let exact =
        |t: f64| free + (start - free) * (-delta * t).exp() * ((omega * t).cos() + delta / omega * (omega * t).sin());
    let mut errors = Vec::new();
    for step_us in [4.0, 2.0, 1.0] {
        let model = free_arm_with(step_us, "", 0.02);
        let arm = model.arms[0].coordinate;
        // A chain at rest: the driver is prescribed, so that its speed is set to zero too.
        let mut still = model.clone();
        still.coordinates[0].motion =
            pitchline::elements::coordinate::CoordinateMotion::Prescribed { speed_rad_s: 0.0 };
        let (_, rest) = at_rest(&bundled("bush-20-40", &[])).unwrap_or_else(|e| panic!("{e}"));
        let mut q = rest.configuration;
        q.coordinates.push(start);
        let mut state = resting_state(&still, &q);
        let h = still.step_s;
        // Half a step before the start its speed is that of the exact motion.
        let acceleration = -omega0 * omega0 * (start - free);
        state.coordinates.omega[arm] = -0.5 * h * acceleration;
        state.coordinates.alpha[arm] = acceleration;
        let mut scratch = Scratch::new(&still);
        let mut camera = Camera::default();
        let (mut worst, steps) = (0.0_f64, (12e-3 / h) as usize);
        let (mut error_j, mut lost_j) = (0.0, 0.0);
        for step in 0..=steps {
            explicit::evaluate(&still, &state, &mut scratch).expect("holds");
            let t = step as f64 * h;
            worst = worst.max((state.coordinates.angle[arm] - exact(t)).abs());
            if step == 0 || step == steps {
                let frame = camera.take(&still, &state, &scratch);
                (error_j, lost_j) = (frame.energy.error_j, frame.energy.lost_spring_damping_j);
            }
            explicit::advance(&still, &mut state, &mut scratch);
        }
        println!("step {step_us} us: {worst:.2e} rad off, lost {lost_j:.6} J, ledger {error_j:.1e} J");
        // The chain at rest under its preload stays at rest; all losses are the arm's.
        assert!(error_j.abs() < 1e-4 * lost_j, "{error_j:e} of {lost_j}");
        errors.push(worst);
    }
    assert!(errors[0] < 1e-3 * start, "{errors:?}");
    for pair in errors.windows(2) {
        assert!((3.6..4.4).contains(&(pair[0] / pair[1])), "{errors:?}");
    }
}

/// At rest the back of a compliant arm stands against its rails by the torque that passes between them, times the compliance; the rails of a stiff
/// one stand where those of a rigid one do.
#[test]
fn the_back_of_a_compliant_arm_is_turned_by_its_torque() {
    let at = |sets: &[&str]| at_rest(&drive(BUNDLED[3].1, sets)).unwrap_or_else(|e| panic!("{e}"));
    let (rigid, rigid_rest) = at(&["effects.arm_compliance.tensioner.compliance_urad_per_nm=0"]);
    assert_eq!((rigid.coordinates.len(), rigid.couplings.len()), (at(&[]).0.coordinates.len(), 0));
    for compliance in [0.01_f64, 30.0, 3000.0] {
        let (model, rest) = at(&[&format!("effects.arm_compliance.tensioner.compliance_urad_per_nm={compliance}")]);
        let arm = &model.arms[0];
        let q = &rest.configuration.coordinates;
        let (rails, back) = (q[arm.coordinate], q[arm.back]);
        let torque = model.coordinates[arm.back].spring.force(back);
        let twist = compliance * 1e-6 * torque;
        println!("{compliance} urad/(N m): {:.3e} rad of {twist:.3e}, rails at {rails:.6}", back - rails);
        // The rails give the chain what the spring gives the back.
        assert!((rails - back + twist).abs() < 1e-6 * twist.abs() && twist != 0.0);
        let inertia = |k: usize| 1.0 / model.coordinates[k].inverse_inertia();
        let whole = 1.0 / rigid.coordinates[rigid.arms[0].coordinate].inverse_inertia();
        assert!(
            (inertia(arm.back) - 0.3 * whole).abs() < 1e-15 && (inertia(arm.coordinate) - 0.7 * whole).abs() < 1e-15
        );
        if compliance < 1.0 {
            assert!((rails - rigid_rest.configuration.coordinates[rigid.arms[0].coordinate]).abs() < 1e-7);
        }
    }
    for (set, says) in [
        ("effects.arm_compliance.nobody.compliance_urad_per_nm=3", "no arm is called `nobody`"),
        ("effects.arm_compliance.tensioner.back_percent=40", "compliance_urad_per_nm"),
        ("effects.arm_compliance.tensioner.compliance_urad_per_nm=-1", "is outside"),
    ] {
        let refused = Drive::parse("arm.toml", BUNDLED[3].1, &[set.to_string()]).expect_err("a mistake").to_string();
        assert!(refused.contains(says) && refused.contains("-->"), "{set}: {refused}");
    }
}

/// The tip of a plunger presses on the back, which the coupling alone holds: their torques balance at rest, and what frames call the back is there.
#[test]
fn a_plunger_presses_on_the_back_of_its_arm() {
    let text = BUNDLED.iter().find(|b| b.0 == "tensioner-20-40").expect("a bundled drive").1;
    let drive = drive(text, &["effects.arm_compliance.tensioner.compliance_urad_per_nm=50"]);
    let (model, rest) = at_rest(&drive).unwrap_or_else(|e| panic!("{e}"));
    let (arm, q) = (&model.arms[0], &rest.configuration.coordinates);
    let paths: Vec<String> = model.coordinates[..model.n_turning()].iter().map(|c| c.path.clone()).collect();
    assert_eq!(
        (paths.clone(), paths[arm.back].as_str()),
        (drive.coordinate_paths(), "effects.arm_compliance.tensioner")
    );
    let tip = model.touches.iter().find(|t| t.path.ends_with(".tip")).expect("a tip");
    let gap = tip.shape.gap(q);
    let of = |k: usize| (0..2).map(|side| tip.shape.parts_of(&gap, side).filter(|p| p.0 == k).count()).sum::<usize>();
    assert_eq!((of(arm.back), of(arm.coordinate)), (1, 0));
    let [coupling] = &model.couplings[..] else { panic!("{:?}", model.couplings) };
    let (torque, _) = coupling.torques_nm(coupling.ends.map(|k| q[k]), [0.0; 2]);
    // What the rails get from the back is what their chain gives them: the same as without compliance, but for where the plunger then stands.
    let (rigid, rigid_rest) = at_rest(&common::bundled("tensioner-20-40", &[])).unwrap_or_else(|e| panic!("{e}"));
    let angle = |m: &Model, q: &Configuration| q.coordinates[m.arms[0].coordinate];
    let moved = angle(&model, &rest.configuration) - angle(&rigid, &rigid_rest.configuration);
    println!(
        "coupling {torque:.4} N m, rails moved by {moved:.2e} rad, back before rails by {:.3e}",
        q[arm.back] - q[arm.coordinate]
    );
    assert!(torque.abs() > 0.1 && ((q[arm.back] - q[arm.coordinate]) / (50e-6 * torque) - 1.0).abs() < 1e-9);
    assert!(moved.abs() < (q[arm.back] - q[arm.coordinate]).abs());
}

/// Rails and back of an arm that no chain touches swing as two inertias on two springs: closed form, second order in the step, and without dampers
/// no energy is lost.
#[test]
fn rails_and_back_swing_as_two_inertias_on_two_springs() {
    let (inertia, share, ground, compliance) = (1e-4_f64, 0.3_f64, 300.0_f64, 400e-6_f64);
    let (rails, back, between) = ((1.0 - share) * inertia, share * inertia, 1.0 / compliance);
    // (between - w2 rails)(between + ground - w2 back) = between^2
    let half = 0.5 * (between / rails + (between + ground) / back);
    let product = between * ground / (rails * back);
    let root = (half * half - product).sqrt();
    let w2 = [product / (half + root), half + root];
    // In each mode the back moves by so much for a unit of the rails.
    let shape = w2.map(|w2| (between - w2 * rails) / between);
    // From rest, the rails turned by `start` from where the spring is free, the back not.
    let start = 0.02;
    let first = start * shape[1] / (shape[1] - shape[0]);
    let exact = |t: f64| first * (w2[0].sqrt() * t).cos() + (start - first) * (w2[1].sqrt() * t).cos();
    let mut errors = Vec::new();
    for (step_us, damping_ratio) in [(2.0_f64, 0.0), (1.0, 0.0), (0.5, 0.0), (1.0, 0.1)] {
        let effect =
            format!("[effects.arm_compliance.idle]\ncompliance_urad_per_nm = 400\ndamping_ratio = {damping_ratio}\n");
        let mut model = free_arm_with(step_us, &effect, 0.0);
        let arm = model.arms[0].clone();
        model.coordinates[0].motion =
            pitchline::elements::coordinate::CoordinateMotion::Prescribed { speed_rad_s: 0.0 };
        let (_, rest) = at_rest(&bundled("bush-20-40", &[])).unwrap_or_else(|e| panic!("{e}"));
        let mut q = rest.configuration;
        let free = 0.01;
        q.coordinates.extend([free + start, free]);
        let mut state = resting_state(&model, &q);
        let h = model.step_s;
        // Half a step before the start the speeds are those of the exact motion.
        for (k, alpha) in [(arm.coordinate, -between * start / rails), (arm.back, between * start / back)] {
            state.coordinates.omega[k] = -0.5 * h * alpha;
            state.coordinates.alpha[k] = alpha;
        }
        let (mut scratch, mut camera) = (Scratch::new(&model), Camera::default());
        let (mut worst, steps) = (0.0_f64, (8e-3 / h) as usize);
        let (mut error_j, mut lost_j) = (0.0, 0.0);
        for step in 0..=steps {
            explicit::evaluate(&model, &state, &mut scratch).expect("holds");
            worst = worst.max((state.coordinates.angle[arm.coordinate] - free - exact(step as f64 * h)).abs());
            if step == 0 || step == steps {
                let frame = camera.take(&model, &state, &scratch);
                (error_j, lost_j) = (frame.energy.error_j, frame.energy.lost_coupling_damping_j);
            }
            explicit::advance(&model, &mut state, &mut scratch);
        }
        let stored_j = 0.5 * between * start * start;
        println!("step {step_us} us: {worst:.2e} rad off, lost {lost_j:.3e}, ledger {error_j:.1e} of {stored_j:.3e} J");
        // Measured 1.05e-4 of it at 2 us; it falls with the square of the step.
        assert!(error_j.abs() < 1.2e-4 * (0.5 * step_us).powi(2) * stored_j, "{error_j:e} of {stored_j:e} J");
        if damping_ratio > 0.0 {
            assert!(lost_j > 0.5 * stored_j, "{lost_j:e} of {stored_j:e} J");
        } else {
            assert_eq!(lost_j, 0.0);
            errors.push(worst);
        }
    }
    assert!(errors[0] < 2e-2 * start, "{errors:?}");
    for pair in errors.windows(2) {
        assert!((3.6..4.4).contains(&(pair[0] / pair[1])), "{errors:?}");
    }
}

/// Text of a rail equal to the straight guide `k` of a model: its face, and its relief arcs.
fn rail_like_guide(model: &Model, k: usize) -> String {
    let g = &model.guides[k].geometry;
    let sweep = pitchline::geometry::guide::END_SWEEP_RAD;
    // The chain travels along +x of the guide's frame or against it.
    let forwards = g.along * g.travel;
    let first = if g.travel > 0.0 { g.origin } else { g.origin + g.along * g.length_m };
    let normal = g.normal();
    let from = first - normal * g.end_radius_m;
    // Back along the relief arc where the chain arrives.
    let start = from + (normal * sweep.cos() - forwards * sweep.sin()) * g.end_radius_m;
    let heading = forwards * sweep.cos() + normal * sweep.sin();
    let arc = g.end_radius_m * sweep * 1e3;
    format!(
        "start_x_mm = {:.12}\nstart_y_mm = {:.12}\nheading_deg = {:.12}\nlengths_mm = [{arc}, {}, {arc}]\nradii_mm = [{r}, 0, {r}]\n",
        start.x * 1e3,
        start.y * 1e3,
        heading.y.atan2(heading.x).to_degrees(),
        g.length_m * 1e3,
        r = g.end_radius_m * 1e3
    )
}

/// A straight rail in place of a straight guide that presses into the span gives the same equilibrium.
#[test]
fn a_straight_rail_is_a_straight_guide() {
    let (head, _) = BUNDLED[0].1.split_once("[guides.fixed.tight]").expect("there");
    let guide = "[guides.fixed.tight]\nspan = [\"driven\", \"driver\"]\nside = \"inside\"\nstart_mm = 36\nend_mm = 28\n\
                 clearance_um = -200\nend_radius_mm = 15\n";
    let (with_guide, rest) = at_rest(&drive(&format!("{head}{guide}"), &[])).unwrap_or_else(|e| panic!("{e}"));
    let rail = format!(
        "[guides.rail.tight]\nspan = [\"driven\", \"driver\"]\nside = \"inside\"\n{}",
        rail_like_guide(&with_guide, 0)
    );
    let x = with_guide.sprockets[1].frame.origin.x * 1e3;
    let with_rail = drive(&format!("{head}{rail}"), &[&format!("sprockets.driven.x_mm={x:.12}")]);
    let (of_rail, resting) = at_rest(&with_rail).unwrap_or_else(|e| panic!("{e}"));
    let mean = |t: &[f64]| t.iter().sum::<f64>() / t.len() as f64;
    let (a, b) = (mean(&rest.tensions_n), mean(&resting.tensions_n));
    let touches = rail_touches(&of_rail, &resting.configuration, &of_rail.rails[0]);
    println!("mean tension {a:.6} N on the guide, {b:.6} N on the rail, {} contacts", touches.len());
    // A taut chain rests on the two ends of a face. There a rail contacts the edges of the plates, a guide only their
    // ends.
    assert!(touches.len() >= 2);
    assert!((a / b - 1.0).abs() < 1e-3);
    let worst = rest.tensions_n.iter().zip(&resting.tensions_n).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-2 * a, "{worst}");
}

/// A fast arm must not contact unused lanes, which are placed a kilometre away, for any number of links.
#[test]
fn fast_arms_touch_links_alone() {
    for links in [88, 90, 92, 96] {
        let x = 237.6 + 4.0 * (f64::from(links) - 90.0);
        let sets = [
            format!("chain.bush.links={links}"),
            format!("sprockets.driven.x_mm={x}"),
            "arms.tensioner.spring_torque_nm=60".into(),
            "run.run_in_ms=5".into(),
            "run.settle_ms=1".into(),
        ];
        let drive = drive(BUNDLED[3].1, &sets.each_ref().map(String::as_str));
        let assembly = common::assembled(&drive);
        let swing = assembly.state.coordinates.omega[2].abs();
        assert!(swing < 100.0, "{links} links: {swing} rad/s");
    }
}

/// One arc that is split into several stretches is one arc.
#[test]
fn arcs_in_several_stretches_are_one() {
    let angle = |sets: &[&str]| {
        let (model, rest) = at_rest(&drive(BUNDLED[3].1, sets)).unwrap_or_else(|e| panic!("{e}"));
        rest.configuration.coordinates[model.arms[0].coordinate]
    };
    let whole = angle(&[]);
    for (lengths, radii) in [
        ("[15, 50, 50, 15]", "[60, 250, 250, 60]"),
        ("[7, 8, 20, 30, 50, 15]", "[60, 60, 250, 250, 250, 60]"),
        ("[15, 100, 5, 5, 5]", "[60, 250, 60, 60, 60]"),
    ] {
        let parts = angle(&[
            &format!("guides.rail.slack.lengths_mm={lengths}"),
            &format!("guides.rail.slack.radii_mm={radii}"),
        ]);
        assert!((parts - whole).abs() < 1e-9, "{lengths}: {parts} against {whole}");
    }
}

/// A straight rail that deflects the chain: the taut chain bends around the corners at its ends, and no plate
/// penetrates it.
#[test]
fn a_chain_bends_round_the_corners_of_a_rail() {
    let (head, _) = BUNDLED[0].1.split_once("[guides.fixed.tight]").expect("there");
    for high_mm in [2.0, 5.0, 9.0] {
        // Below the upper span, which runs from the driven sprocket to the driver at some 25 to 51 mm.
        let y = 25.6 + 25.4 * 0.5 - 3.55 + high_mm;
        let text = format!(
            "{head}[guides.rail.flat]\nspan = [\"driven\", \"driver\"]\nside = \"inside\"\nstart_x_mm = 149\nstart_y_mm = {}\n\
             heading_deg = 186.1\nlengths_mm = [60]\nradii_mm = [0]\n",
            y + 3.2
        );
        let (model, rest) = at_rest(&drive(&text, &[])).unwrap_or_else(|e| panic!("{e}"));
        let touches = rail_touches(&model, &rest.configuration, &model.rails[0]);
        let deepest = touches.iter().map(|t| t.2.penetration_m).fold(0.0, f64::max);
        println!("{high_mm} mm: {} contacts, {:.2} um deep", touches.len(), deepest * 1e6);
        assert!(touches.len() >= 2 && deepest < 50e-6);
    }
}

/// With its stop 1 degree before the place where spring and chain balance, an arm rests on it: spring, chain and stop balance, and go on to do
/// so in every step of a run; what the stop stores and takes is in the ledger.
#[test]
fn an_arm_rests_on_its_stop() {
    let text = BUNDLED[3].1;
    let (free_model, free) = at_rest(&drive(text, &[])).unwrap_or_else(|e| panic!("{e}"));
    let free_rad = free.configuration.coordinates[free_model.arms[0].coordinate];
    let limit_deg = (free_rad - 0.01_f64).to_degrees();
    let sets = [
        &format!("arms.tensioner.high_deg={limit_deg}")[..],
        "arms.tensioner.low_deg=-20", // not reached
        "arms.tensioner.stop_radius_mm=25",
    ];
    let stops = "[contact.stop.linear]\nstiffness_n_per_m = 1e7\ndamping_n_s_per_m = 50\n";
    let drive = drive(&format!("{text}\n{stops}"), &sets);
    let (model, rest) = at_rest(&drive).unwrap_or_else(|e| panic!("{e}"));
    let (q, arm) = (&rest.configuration, model.arms[0].coordinate);
    let spring = model.coordinates[arm].spring.force(q.coordinates[arm]);
    let rail = &model.rails[0];
    let chain: f64 = rail_touches(&model, q, rail)
        .iter()
        .map(|(_, _, t)| {
            let radii = PairRadii { bush_m: t.link_radius_m, body_m: t.body_radius_m };
            -cross(t.point, t.normal * rail.body.law.elastic(t.penetration_m, radii).force_n)
        })
        .sum();
    let depth_m = 25e-3 * (q.coordinates[arm] - limit_deg.to_radians());
    let stop = -1e7 * depth_m * 25e-3;
    println!("spring {spring:.6}, chain {chain:.6}, stop {stop:.6} N m");
    assert!(stop < -0.1 && (spring + chain + stop).abs() < 1e-6 * spring.abs());

    let mut assembly = pitchline::assemble::assemble(&drive).unwrap_or_else(|e| panic!("{e}"));
    let (model, state) = (&assembly.model, &mut assembly.state);
    let mut scratch = Scratch::new(model);
    let mut camera = Camera::default();
    let (mut most, mut touching, mut steps) = (0.0_f64, 0, 0);
    let mut energy = None;
    while (state.step as f64) * model.step_s < 20e-3 {
        explicit::evaluate(model, state, &mut scratch).unwrap_or_else(|e| panic!("{e}"));
        let frame = camera.take(model, state, &scratch);
        let force = frame.rotors.chain_torque_nm[arm] + frame.rotors.outer_torque_nm[arm];
        let inertia = 1.0 / model.coordinates[arm].inverse_inertia();
        most = most.max((force - inertia * scratch.coordinate_alpha()[arm]).abs());
        touching += u32::from(scratch.parts_force()[arm] < 0.0);
        steps += 1;
        energy = Some(frame.energy);
        explicit::advance(model, state, &mut scratch);
    }
    let energy = energy.expect("a frame");
    println!(
        "forces against J alpha {most:.1e} N m; on the stop in {touching} of {steps} steps; energy error {:.1e} of {:.1} J",
        energy.error_j, energy.work_in_j
    );
    assert!(most < 1e-12 && touching > steps / 2);
    assert!(energy.error_j.abs() < 1e-4 * energy.work_in_j);
}

#[test]
fn arms_and_rails_that_make_no_sense_are_refused_where_they_stand() {
    let text = BUNDLED[3].1;
    for (set, says) in [
        ("arms.tensioner.spring_torque_nm=-4", "does not tighten the chain"),
        ("arms.tensioner.inertia_kg_m2=0", "is outside"),
        ("guides.rail.slack.arm=nobody", "no arm is called `nobody`"),
        ("guides.rail.slack.lengths_mm=[15, 0, 15]", "holds something that is no number"),
        ("guides.rail.slack.radii_mm=[60, 250]", "3 lengths, 2 radii"),
        ("guides.rail.slack.radii_mm=[60, 5, 60]", "turns by more than"),
        ("preload.tension_n=100", "the tensioner's spring sets the tension"),
        ("preload.moves=nobody", "is no sprocket and no arm"),
        ("arms.tensioner.high_deg=5", "nothing says how hard they are"),
    ] {
        let parsed = Drive::parse("arm.toml", text, &[set.to_string()]);
        let report = match parsed {
            Err(report) => report.to_string(),
            Ok(drive) => at_rest(&drive).err().map_or_else(|| "no error".to_string(), |e| e.to_string()),
        };
        assert!(report.contains(says) && report.contains("-->"), "{set}: {report}");
    }
}

/// Stops, rails and guides that leave the loop no place say how far it would have to go beyond them, and where they stand in the file.
#[test]
fn what_stands_in_the_way_of_the_loop_is_told_with_its_distance() {
    let stops = "\n[contact.stop.linear]\nstiffness_n_per_m = 1e7\n";
    let arm = format!("{}{stops}", BUNDLED[3].1);
    let ford = include_str!("../assets/drives/ford-v6.toml");
    let v12 = include_str!("../assets/drives/v12-primary.toml");
    for (text, set, says) in [
        (arm.as_str(), "arms.tensioner.high_deg=-5", "stands 6.5"),
        (arm.as_str(), "arms.tensioner.high_deg=0", "deg beyond this stop"),
        (ford, "sliders.plunger.high_mm=-6", "the loop closes where slider `plunger` stands 5.2"),
        (v12, "guides.rail.tight.start_x_mm=-30", "guide `tight` runs through sprocket `idler`"),
        (ford, "chain.silent.links=80", "shorter than its path as drawn"),
    ] {
        let report = match Drive::parse("way.toml", text, &[set.to_string()]) {
            Err(report) => report.to_string(),
            Ok(drive) => at_rest(&drive).err().map_or_else(|| "no error".to_string(), |e| e.to_string()),
        };
        println!("{set}\n{report}");
        assert!(report.contains(says) && report.contains("-->"), "{set}: {report}");
    }
    // A slider that a stop bears says with what force, and how far it would go. The preload without the stop is 254 N.
    let drive = drive(ford, &["sliders.plunger.low_mm=1"]);
    let assembly = pitchline::assemble::assemble(&drive).unwrap_or_else(|e| panic!("{e}"));
    let told = assembly.report.lines().join("\n");
    println!("{told}");
    assert!(told.contains("it rests on its stop `low_mm` with") && told.contains("would stand 1."), "{told}");
    assert!(assembly.report.preload_n > 350.0);
}

/// Rails that lie end to end touch and do not cross: the slack rail in two, the second where the first ends.
#[test]
fn rails_may_lie_end_to_end() {
    let text = BUNDLED[3].1;
    let (head, tail) = text.split_once("[guides.rail.slack]").expect("the rail");
    // The end of the rail's first stretch: an arc of 15 mm, convex towards the chain, which turns right round it.
    let (heading, start) = (19.643_f64.to_radians(), Vec2::new(51.301, -30.543));
    let centre = start + 60.0 * Vec2::new(heading.sin(), -heading.cos());
    let (sin, cos) = (-15.0_f64 / 60.0).sin_cos();
    let from = start - centre;
    let end = centre + Vec2::new(cos * from.x - sin * from.y, sin * from.x + cos * from.y);
    let second = format!(
        "[guides.rail.behind]\nspan = [\"driver\", \"driven\"]\nside = \"outside\"\narm = \"tensioner\"\n\
         start_x_mm = {}\nstart_y_mm = {}\nheading_deg = {}\nlengths_mm = [100, 15]\nradii_mm = [250, 60]\n\n",
        end.x,
        end.y,
        19.643 - (15.0_f64 / 60.0).to_degrees()
    );
    let first = tail.replacen("lengths_mm = [15, 100, 15]", "lengths_mm = [15]", 1).replacen(
        "radii_mm = [60, 250, 60]",
        "radii_mm = [60]",
        1,
    );
    let both = drive(&format!("{head}{second}[guides.rail.slack]{first}"), &[]);
    if let Err(e) = at_rest(&both) {
        panic!("{e}");
    }
}
