//! The hydraulic tensioner of a bundled drive: rest, ledger, oil, pumping of the check valve, going on from a keyframe.

mod common;

use pitchline::assemble::{Assembly, assemble, at_rest};
use pitchline::drive::Drive;
use pitchline::geometry::cross;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::pairs::part_part::TouchShape;
use pitchline::recording::capture::{Camera, header};
use pitchline::recording::columns::Rows;
use pitchline::recording::frame::{BodyInfo, Frame, Header};
use pitchline::statics::rail_touches;

fn drive(sets: &[&str]) -> Drive {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    Drive::parse("tensioner.toml", text, &sets).unwrap_or_else(|e| panic!("{e}"))
}

/// At rest the tip carries the moment of the chain on the arm, and spring and oil carry the tip along the slider.
#[test]
fn chain_tip_spring_and_oil_balance_at_rest() {
    for sets in [&[][..], &["chambers.high.pressure_bar=8"], &["sliders.plunger.direction_deg=95"]] {
        let (model, rest) = at_rest(&drive(sets)).unwrap_or_else(|e| panic!("{e}"));
        let q = &rest.configuration;
        let (rail, arm) = (&model.rails[0], &model.arms[0]);
        let chain: f64 = rail_touches(&model, q, rail)
            .iter()
            .map(|(_, _, t)| {
                let radii =
                    pitchline::elements::contact_law::PairRadii { bush_m: t.link_radius_m, body_m: t.body_radius_m };
                -cross(t.point, t.normal * rail.body.law.elastic(t.penetration_m, radii).force_n)
            })
            .sum();
        let tip = model.touches.iter().find(|t| matches!(t.shape, TouchShape::Tip { .. })).expect("a tip");
        let gap = tip.shape.gap(&q.coordinates);
        let force = tip.law.elastic(-gap.gap_m, tip.radii).force_n;
        // On the arm against the normal, in the point of contact.
        let moment = cross(gap.point - arm.pivot, -gap.normal * force);
        let slider = &model.coordinates[model.sliders[0].coordinate];
        let place = q.coordinates[model.sliders[0].coordinate];
        let bar = if sets.iter().any(|s| s.contains("pressure_bar=8")) { 8.0 } else { 3.0 };
        let area = 0.25 * std::f64::consts::PI * 11e-3_f64.powi(2) + 0.5 * std::f64::consts::PI * 11e-3 * 30e-6;
        let pushed = slider.spring.force(place) + bar * 1e5 * area;
        let along = force * gap.slope[0].abs();
        println!("{sets:?}: chain {chain:.6}, tip {moment:.6} N m; spring and oil {pushed:.6}, tip {along:.6} N");
        assert!((chain + moment).abs() < 1e-6 * moment.abs(), "{chain} {moment}");
        assert!((pushed - along).abs() < 1e-6 * along);
    }
}

/// What is seen of a run, at its nodes.
#[derive(Default)]
struct Seen {
    steps: u32,
    energy_error: f64,
    least_bar: f64,
    most_bar: f64,
    balance_nm: f64,
    open: u32,
}

fn run(assembly: &mut Assembly, time_s: f64) -> Seen {
    let (model, state) = (&assembly.model, &mut assembly.state);
    let (mut scratch, mut camera) = (Scratch::new(model), Camera::default());
    let mut seen = Seen { least_bar: f64::INFINITY, ..Seen::default() };
    let arm = model.arms[0].coordinate;
    let ball = model.coordinates.len() - 1;
    let until = state.step + (time_s / model.step_s) as u64;
    while state.step < until {
        explicit::evaluate(model, state, &mut scratch).unwrap_or_else(|e| panic!("{e}"));
        if state.step.is_multiple_of(50) || state.step + 1 == until {
            let frame = camera.take(model, state, &scratch);
            seen.energy_error = frame.energy.error_j / frame.energy.work_in_j.max(1e-9);
            let force = frame.rotors.chain_torque_nm[arm] + frame.rotors.outer_torque_nm[arm];
            let inertia = 1.0 / model.coordinates[arm].inverse_inertia();
            seen.balance_nm = seen.balance_nm.max((force - inertia * scratch.coordinate_alpha()[arm]).abs());
        }
        let bar = state.oil.pressure_pa[0] / 1e5;
        (seen.least_bar, seen.most_bar) = (seen.least_bar.min(bar), seen.most_bar.max(bar));
        seen.open += u32::from(state.coordinates.angle[ball] > 1e-6);
        seen.steps += 1;
        explicit::advance(model, state, &mut scratch);
    }
    seen
}

/// With an eccentric sprocket the plunger works: the check valve fills the chamber, the gap empties it, no oil is lost, the ledger holds, and the
/// forces on the arm are its inertia times its acceleration.
#[test]
fn a_working_tensioner_keeps_its_oil_and_its_books() {
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    let text = format!("{text}\n[effects.sprocket_runout.driver]\namplitude_um = 150\n");
    let drive = Drive::parse("t.toml", &text, &[]).unwrap_or_else(|e| panic!("{e}"));
    let mut assembly = assemble(&drive).unwrap_or_else(|e| panic!("{e}"));
    let before: f64 = assembly.state.oil.oil_m3.iter().chain(&assembly.state.oil.inflow_m3).sum();
    let seen = run(&mut assembly, 0.2);
    let oil = &assembly.state.oil;
    let after: f64 = oil.oil_m3.iter().chain(&oil.inflow_m3).sum();
    // The first reservoir is the gallery, which gives; the second the sump, which takes.
    let (fed, leaked) = (-oil.inflow_m3[0], oil.inflow_m3[1]);
    println!(
        "{:.2} to {:.2} bar, ball open in {} of {} steps; fed {:.3e}, leaked {:.3e} m3; oil error {:.1e}; energy {:.1e}; arm {:.1e} N m",
        seen.least_bar,
        seen.most_bar,
        seen.open,
        seen.steps,
        fed,
        leaked,
        after / before - 1.0,
        seen.energy_error,
        seen.balance_nm
    );
    // measured: 1.4e-14, -3.7e-5, 9e-16 N m; 2.75 to 12.3 bar.
    assert!((after / before - 1.0).abs() < 1e-12);
    assert!(seen.energy_error.abs() < 1e-4);
    assert!(seen.balance_nm < 1e-12);
    assert!(seen.open > 0 && seen.open < seen.steps && fed > 0.0 && leaked > 0.0);
    assert!(seen.most_bar > 4.0 && seen.least_bar < 3.0);
}

/// A chamber between two pipes of one bore has the pressure that their lengths share out, and the oil through both is Hagen and Poiseuille's; oil and
/// books are kept.
#[test]
fn oil_goes_through_pipes() {
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    let pipes = "[chambers.line]\nvolume_mm3 = 100\n[passages.pipe.from_gallery]\nbetween = [\"gallery\", \"line\"]\ndiameter_mm = 1.2\nlength_mm = 300\n\
                 [passages.pipe.to_sump]\nbetween = [\"line\", \"sump\"]\ndiameter_mm = 1.2\nlength_mm = 100\n";
    let drive = Drive::parse("t.toml", &format!("{text}\n{pipes}"), &[]).unwrap_or_else(|e| panic!("{e}"));
    let mut assembly = assemble(&drive).unwrap_or_else(|e| panic!("{e}"));
    let before: f64 = assembly.state.oil.oil_m3.iter().chain(&assembly.state.oil.inflow_m3).sum();
    let seen = run(&mut assembly, 0.02);
    let (oil, network) = (&assembly.state.oil, assembly.model.oil.as_ref().expect("oil"));
    let after: f64 = oil.oil_m3.iter().chain(&oil.inflow_m3).sum();
    let line = network.chambers.iter().position(|c| c.name == "line").expect("a line");
    let flow_of = |name: &str| {
        let e = network.passages.iter().position(|p| p.path.ends_with(name)).expect("a pipe");
        network.flow_m3_s(e, &assembly.state.coordinates.angle, &|_| 0.0, oil)
    };
    let known = std::f64::consts::PI * 1.2e-3_f64.powi(4) * 3e5 / (128.0 * 9e-3 * 0.4);
    println!(
        "{:.6} bar; {:.6e} and {:.6e} m3/s, known {known:.6e}; oil {:.1e}, energy {:.1e}",
        oil.pressure_pa[line] / 1e5,
        flow_of("from_gallery"),
        flow_of("to_sump"),
        after / before - 1.0,
        seen.energy_error
    );
    assert!((oil.pressure_pa[line] / 0.75e5 - 1.0).abs() < 1e-6);
    assert!((flow_of("from_gallery") / known - 1.0).abs() < 1e-6 && (flow_of("to_sump") / known - 1.0).abs() < 1e-6);
    assert!((after / before - 1.0).abs() < 1e-12 && seen.energy_error.abs() < 1e-4);
}

/// A keyframe holds oil and touches: what goes on from it has the bits of the run.
#[test]
fn a_run_goes_on_from_a_keyframe_to_the_bit() {
    let mut assembly = assemble(&drive(&[])).unwrap_or_else(|e| panic!("{e}"));
    run(&mut assembly, 2e-3);
    let keyframe = assembly.state.keyframe();
    let mut again = common::from_keyframe(&assembly);
    run(&mut assembly, 2e-3);
    run(&mut again, 2e-3);
    assert_eq!(assembly.state.hash(), again.state.hash());
    assert!(keyframe.columns.iter().any(|c| c.name == "oil.pressure"));
}

#[test]
fn tensioners_that_make_no_sense_are_refused_where_they_stand() {
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    for (from, to, says) in [
        ("presses = \"tensioner\"", "presses = \"nobody\"", "no arm is called `nobody`"),
        ("[\"gallery\", \"high\"]", "[\"gallery\", \"low\"]", "does not say between what it lies"),
        ("ball_mm = 4 ", "ball_mm = 2 ", "falls through its seat"),
        ("high_mm = 10", "high_mm = -5", "no way between its stops"),
        ("bore_mm = 11 ", "#", "has a slider and no bore"),
        ("pressure_bar = 3                # assumed", "pressure_bar = -1", "is outside"),
        ("tip = \"plunger\"", "tip = \"piston\"", "no slider is called `piston`"),
        ("volume_mm3 = 2000 ", "volume_mm3 = 200 ", "leaves no room in chamber `high`"),
        ("gap_um = 30 ", "gap_um = 1200 ", "too wide"),
        (
            "[passages.check.feed]",
            "[passages.pipe.feed]\ndiameter_mm = 4\nlength_mm = 300\nroughness_um = 50",
            "rougher",
        ),
        ("[passages.check.feed]", "[passages.pipe.feed]\ndiameter_mm = 4\nlength_mm = 30", "too short"),
        ("[reservoirs.sump]", "[reservoirs.high]", "a chamber and a reservoir are called `high`"),
        ("[contact.tip.hunt_crossley]", "[contact.tip.soft]", "contact laws"),
        (
            "[passages.check.feed]",
            "[chambers.far]\nvolume_mm3 = 100\n[passages.check.feed]",
            "chamber `far` has no way in",
        ),
    ] {
        assert!(text.contains(from), "{from}");
        let report = match Drive::parse("tensioner.toml", &text.replacen(from, to, 1), &[]) {
            Err(report) => report.to_string(),
            Ok(_) => "no error".to_string(),
        };
        assert!(report.contains(says) && report.contains("-->"), "{from}: {report}");
    }
}

/// Oil of a grade has the viscosity of its temperature; what does not go together is refused.
#[test]
fn oil_thins_with_its_temperature() {
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    let start = text.find("viscosity_mpa_s").expect("it is there");
    let line = text[start..].lines().next().expect("a line");
    let graded = |lines: &str, sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
        Drive::parse("graded.toml", &text.replacen(line, lines, 1), &sets)
    };
    let grade = "viscosity_40_mm2_s = 404\nviscosity_100_mm2_s = 28\ntemperature_c = 60";
    let oil = |sets: &[&str]| graded(grade, sets).unwrap_or_else(|e| panic!("{e}")).oil.expect("oil").oil;
    let warm = oil(&[]);
    // olezol.com prints 132.126 mm2/s for this oil at 60 degrees.
    assert!((warm.viscosity_pa_s / (132.126e-6 * warm.density_kg_m3) - 1.0).abs() < 1e-4, "{warm:?}");
    let at_100 = oil(&["oil.temperature_c=100"]).viscosity_pa_s;
    assert!((at_100 / (28e-6 * warm.density_kg_m3) - 1.0).abs() < 1e-12);
    for (lines, says) in [
        ("viscosity_40_mm2_s = 404\ntemperature_c = 60", "go together"),
        ("viscosity_40_mm2_s = 404\nviscosity_100_mm2_s = 28", "`temperature_c` is missing"),
        ("viscosity_40_mm2_s = 28\nviscosity_100_mm2_s = 404\ntemperature_c = 60", "as thick at 100 degrees"),
        ("viscosity_40_mm2_s = 10\nviscosity_100_mm2_s = 2.2\ntemperature_c = 200", "thinner than 2 mm2/s"),
        ("viscosity_40_mm2_s = 404\nviscosity_100_mm2_s = 28\ntemperature_c = -60", "thicker than 100 Pa s"),
        ("viscosity_mpa_s = 9\nviscosity_40_mm2_s = 9\nviscosity_100_mm2_s = 3\ntemperature_c = 60", "given twice"),
        ("#", "viscosity_mpa_s"),
    ] {
        let report = match graded(lines, &[]) {
            Err(report) => report.to_string(),
            Ok(_) => "no error".to_string(),
        };
        assert!(report.contains(says) && report.contains("-->"), "{lines}: {report}");
    }
}

/// Position of a point of a body in a frame [m].
fn placed(body: &BodyInfo, frame: &Frame, [x, y]: [f64; 2]) -> [f64; 2] {
    let ([x0, y0], angle_rad) = body.pose(frame);
    let (sin, cos) = angle_rad.sin_cos();
    [x0 + cos * x - sin * y, y0 + sin * x + cos * y]
}

fn body<'a>(header: &'a Header, path: &str) -> &'a BodyInfo {
    header.bodies.iter().find(|b| b.path == path).unwrap_or_else(|| panic!("no {path}"))
}

/// Frames alone say where plunger and arm are, what pushes them and what flows: the forces on what slides are its mass times its acceleration,
/// the distance of the drawn tip from the drawn pad is the gap, volumes and flows are those of bore and way, sensors read the same.
#[test]
fn frames_say_what_slides_touches_and_flows() {
    let text = include_str!("../assets/drives/tensioner-20-40.toml");
    let text = format!("{text}\n[effects.sprocket_runout.driver]\namplitude_um = 150\n");
    let drive = Drive::parse("t.toml", &text, &[]).unwrap_or_else(|e| panic!("{e}"));
    let Assembly { model, mut state, report } = assemble(&drive).unwrap_or_else(|e| panic!("{e}"));
    let header = header(&drive, &model, &report, 1);
    assert_eq!(header.sliders, ["sliders.plunger", "passages.check.feed"]);
    assert_eq!(header.chambers, ["chambers.high", "reservoirs.gallery", "reservoirs.sump"]);
    assert_eq!(header.passages, ["passages.leak.plunger", "passages.check.feed"]);
    let (plunger, arm) = (body(&header, "sliders.plunger"), body(&header, "arms.tensioner"));
    let (housing, ball) = (body(&header, "housings.plunger_housing"), body(&header, "passages.check.feed"));
    assert!(!housing.moves() && ball.slider == Some(1) && ball.low_stop == Some(0.0));
    assert_eq!((plunger.low_stop, plunger.high_stop), (Some(-4e-3), Some(10e-3)));
    // The rod is as thick as the bore, and in the housing at both stops.
    let rod = plunger.outline.as_ref().expect("a rod");
    let half = rod.elements.iter().map(|e| e.start_y_m.abs()).fold(0.0, f64::max);
    assert!((half - 5.5e-3).abs() < 1e-15, "{half}");
    let ends = |o: &pitchline::recording::frame::Outline| {
        let x = o.elements.iter().map(|e| e.start_x_m);
        (x.clone().fold(f64::INFINITY, f64::min), x.fold(f64::NEG_INFINITY, f64::max))
    };
    let (rear, (bottom, mouth)) = (ends(rod).0, ends(housing.outline.as_ref().expect("a housing")));
    assert!(rear - 4e-3 > bottom && rear + 10e-3 < mouth, "{rear} in {bottom} to {mouth}");
    let tip = rod.elements.iter().find(|e| e.radius_m > 0.0).expect("a round tip");
    // The pad is the side of the arm that the tip is nearest to.
    let sides = &arm.outline.as_ref().expect("an arm").elements;
    let (mut scratch, mut camera) = (Scratch::new(&model), Camera::default());
    let (mut unbalanced, mut apart, mut mass) = (0.0_f64, 0.0_f64, [0.0_f64; 2]);
    let (mut open, mut slow, mut before): (u32, f64, Option<[f64; 4]>) = (0, 0.0, None);
    for step in 0..40_000 {
        explicit::evaluate(&model, &state, &mut scratch).unwrap_or_else(|e| panic!("{e}"));
        if step % 20 < 2 {
            let frame = camera.take(&model, &state, &scratch);
            let s = &frame.sliders;
            for (row, kilograms) in [(0, 20e-3), (1, 1.0 / model.coordinates[4].inverse_inertia())] {
                let pushed = s.spring_force_n[row] + s.oil_force_n[row] + s.touch_force_n[row];
                unbalanced = unbalanced.max((pushed - kilograms * s.acceleration_m_s2[row]).abs());
                mass[row] = mass[row].max(s.oil_force_n[row].abs());
            }
            open += u32::from(s.position_m[1] > 1e-6);
            let centre = placed(plunger, &frame, [tip.centre_x_m, tip.centre_y_m]);
            let distance = |e: &pitchline::recording::frame::OutlineElement| {
                let a = placed(arm, &frame, [e.start_x_m, e.start_y_m]);
                let b = placed(arm, &frame, [e.end_x_m, e.end_y_m]);
                let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
                let length = dx.hypot(dy);
                let along = ((centre[0] - a[0]) * dx + (centre[1] - a[1]) * dy) / length;
                let aside = ((centre[0] - a[0]) * dy - (centre[1] - a[1]) * dx).abs() / length;
                if (0.0..=length).contains(&along) { aside } else { f64::INFINITY }
            };
            let nearest = sides
                .iter()
                .map(distance)
                .fold(f64::INFINITY, |a, b| if (b - 8e-3).abs() < (a - 8e-3).abs() { b } else { a });
            apart = apart.max((nearest - tip.radius_m - frame.touches.gap_m[0]).abs());
            // Sensors: pressure, displacement, flow of the ball, force of the tip, in the order of the kinds.
            let by = |path: &str| frame.sensors[header.sensors.iter().position(|s| s.path == path).expect(path)];
            assert_eq!(by("sensors.pressure.high"), frame.chambers.pressure_pa[0]);
            assert_eq!(by("sensors.displacement.plunger"), s.position_m[0]);
            assert_eq!(by("sensors.flow.feed"), frame.passages.flow_m3_s[1]);
            assert_eq!(by("sensors.force.tip"), frame.touches.normal_force_n[0]);
            let flows = &frame.passages.flow_m3_s;
            assert_eq!(frame.chambers.inflow_m3_s, [flows[1] - flows[0], -flows[1], flows[0]]);
            // The volume grows by bore times speed.
            if let Some([volume, position, speed, t_s]) = before.filter(|_| step % 20 == 1) {
                let (grown, moved) = (frame.chambers.volume_m3[0] - volume, s.position_m[0] - position);
                let area = 0.25 * std::f64::consts::PI * 11e-3_f64.powi(2);
                assert!((grown - area * moved).abs() < 1e-20, "{grown:e} {moved:e}");
                let mean = 0.5 * (speed + s.speed_m_s[0]);
                slow = slow.max((moved / (frame.t_s - t_s) - mean).abs());
            }
            before = Some([frame.chambers.volume_m3[0], s.position_m[0], s.speed_m_s[0], frame.t_s]);
        }
        explicit::advance(&model, &mut state, &mut scratch);
    }
    println!(
        "m a {unbalanced:.1e} N of {mass:?}, drawn tip {apart:.1e} m off, speeds {slow:.1e} m/s, ball open in {open} frames"
    );
    // measured 1.6e-14 N, 2.1e-17 m
    assert!(unbalanced < 1e-9 && apart < 1e-12, "{unbalanced:e} {apart:e}");
    // Means of two nodes against the way between them; measured 2.0e-5 m/s.
    assert!(slow < 1e-3 && open > 0 && mass[1] > 0.0, "{slow:e}");
}

/// The rows that a drive names before it is compiled are those of its recordings, and what moves is drawn.
#[test]
fn rows_have_the_names_that_the_drive_gives_them() {
    for (name, text) in pitchline::drive::BUNDLED {
        let drive = Drive::parse(name, text, &[]).unwrap_or_else(|e| panic!("{e}"));
        let Assembly { model, report, .. } = assemble(&drive).unwrap_or_else(|e| panic!("{e}"));
        let header = header(&drive, &model, &report, 1);
        for rows in [Rows::Slider, Rows::Touch, Rows::Chamber, Rows::Passage] {
            assert_eq!(header.row_paths(rows).expect("named"), drive.row_paths(rows), "{name}");
        }
        // Ways of bearings and modes of blades move bodies of other names.
        let is_body = |path: &&String| !path.starts_with("bearings.") && !path.starts_with("guides.");
        for path in
            header.sliders.iter().filter(is_body).chain(header.coordinates.iter().filter(|c| c.starts_with("arms.")))
        {
            assert!(body(&header, path).outline.is_some(), "{name}: {path} is not drawn");
        }
    }
}
