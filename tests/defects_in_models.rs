//! Effects on the parts of drives with links, as they reach the model: what is displaced, what rubs, which ranges are taken.

mod common;
#[allow(dead_code)]
#[path = "common/contour.rs"]
mod contour;

/// Effects on all joints and on guides change the model as specified, and change nothing where they are zero.
#[test]
fn effects_on_joints_and_guides_reach_the_model() {
    let model = |sets: &[&str]| common::assembled(&common::drive(sets)).model;
    let plain = model(&[]);
    let off = model(&[
        "effects.wear_elongation.chain.length_um=0",
        "effects.pin_friction.chain.friction=0",
        "effects.guide_compliance.tight.compliance_um_per_kn=0",
    ]);
    assert!(off.mounts.is_empty() && off.coordinates.len() == plain.coordinates.len());
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
    // 100 um/kN is a spring of 1e7 N/m behind the contact, whose law stays; along the normal of the guide.
    let [mount] = guided.mounts[..] else { panic!("{:?}", guided.mounts) };
    assert!((guided.coordinates[mount].spring.stiffness - 1e7).abs() < 1e-2);
    assert_eq!(guided.guides[0].body.law, plain.guides[0].body.law);
    let [shift] = guided.guides[0].frame.shifts[..] else { panic!("{:?}", guided.guides[0].frame) };
    assert!(shift.coordinate == mount && shift.direction.dot(&guided.guides[0].body.along) == 0.0);
    assert!(guided.guides[1].frame.shifts.is_empty() && plain.mounts.is_empty());
    assert!((guided.guides[0].body.friction - plain.guides[0].body.friction - 0.05).abs() < 1e-15);
    assert!(guided.chain.joints[0].friction_arm_m > plain.chain.joints[0].friction_arm_m);
}

/// Effects on oil, joints and rails change the model as specified, and no bit where they are zero.
#[test]
fn effects_on_tensioners_and_joints_reach_the_model() {
    use pitchline::elements::passage::FlowLaw;
    let model = |sets: &[&str]| common::assembled(&common::bundled("ford-v6", sets));
    let plain = model(&[]);
    let off = model(&[
        "effects.leak_gap.plunger.gap_um=0",
        "effects.orifice_diameter.throttle.diameter_um=0",
        "effects.check_leak.ball.area_mm2=0",
        "effects.oil_air.oil.air_percent=0",
        "effects.oil_viscosity.oil.share_percent=0",
        "effects.joint_stiffness.chain.share_percent=0",
        "effects.joint_damping.chain.damping_n_s_per_m=0",
        "effects.guide_friction.slack.friction=0",
    ]);
    assert_eq!(plain.state.hash(), off.state.hash());
    let changed = model(&[
        "effects.leak_gap.plunger.gap_um=50",
        "effects.orifice_diameter.throttle.diameter_um=500",
        "effects.check_leak.ball.area_mm2=0.1",
        "effects.oil_air.oil.air_percent=4",
        "effects.oil_viscosity.oil.share_percent=100",
        "effects.joint_stiffness.chain.share_percent=-20",
        "effects.joint_damping.chain.damping_n_s_per_m=-1000",
        "effects.guide_friction.slack.friction=0.05",
    ]);
    let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
    let (before, after) = (plain.model.oil.as_ref().expect("oil"), changed.model.oil.as_ref().expect("oil"));
    close(after.oil.air_share, 0.05);
    close(after.oil.viscosity_pa_s, 0.02);
    // Declared: ball, throttle and leak in the order orifice, leak, check; the hole beside the ball is the last.
    let passage = |network: &pitchline::elements::hydraulics::Network, path: &str| {
        network.passages.iter().find(|p| p.path == path).unwrap_or_else(|| panic!("{path}")).law
    };
    let leak = |network| match passage(network, "passages.leak.plunger") {
        FlowLaw::Leak { conductance, .. } => conductance,
        other => panic!("{other:?}"),
    };
    // (100 / 50)^3, and twice the viscosity.
    close(leak(after), leak(before) * 8.0 / 2.0);
    let diameter_m = |path: &str| match passage(after, path) {
        FlowLaw::Orifice(o) => o.diameter_m,
        other => panic!("{other:?}"),
    };
    close(diameter_m("passages.orifice.throttle"), 3e-3);
    close(0.25 * std::f64::consts::PI * diameter_m("effects.check_leak.ball").powi(2), 0.1e-6);
    assert_eq!(after.passages.len(), before.passages.len() + 1);
    let ends = |network: &pitchline::elements::hydraulics::Network, path: &str| {
        network.passages.iter().find(|p| p.path == path).map(|p| format!("{:?}", p.ends))
    };
    assert_eq!(ends(after, "effects.check_leak.ball"), ends(after, "passages.check.ball"));
    let joint = |assembly: &pitchline::assemble::Assembly| assembly.model.chain.joints[0];
    close(joint(&changed).stiffness_n_per_m, 0.8 * joint(&plain).stiffness_n_per_m);
    assert_eq!(joint(&changed).damping_n_s_per_m, 0.0, "less than nothing counts as nothing");
    let slack = |assembly: &pitchline::assemble::Assembly| {
        let rail = assembly.model.rails.iter().find(|r| r.name == "slack").expect("the rail");
        rail.body.friction
    };
    close(slack(&changed), slack(&plain) + 0.05);
}

/// Effects on numbers of parts change them by their share, and no bit where they are zero.
#[test]
fn effects_on_numbers_of_parts_reach_the_model() {
    use pitchline::model::Model;
    // Modes of a blade come out of an eigenvalue problem.
    let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
    let all = |drive: &str, path: &str, unit: &str, size: f64| {
        let model = |size: f64| {
            let set = format!("effects.{path}.{unit}={size}");
            common::assembled(&common::bundled(drive, &[&set]))
        };
        let (plain, off) = (common::assembled(&common::bundled(drive, &[])), model(0.0));
        assert_eq!(plain.state.hash(), off.state.hash(), "{path}");
        (plain.model, model(size).model)
    };
    let spring = |m: &Model, path: &str| {
        m.coordinates.iter().find(|c| c.path == path).unwrap_or_else(|| panic!("{path}")).spring
    };
    let (before, after) = all("v12-primary", "blade_stiffness.slack", "share_percent", -20.0);
    let mode = "guides.rail.slack.bending.1";
    close(spring(&after, mode).stiffness, 0.8 * spring(&before, mode).stiffness);
    let (before, after) = all("bmw318-camshaft", "bearing_clearance.cam", "clearance_um", 15.0);
    let clearance_m = |m: &Model| m.bearings.iter().find_map(|b| b.film.as_ref()).expect("a film").0.clearance_m;
    assert!((clearance_m(&after) - clearance_m(&before) - 15e-6).abs() < 1e-15);
    assert!((clearance_m(&before) - CLEARANCE_UM * 1e-6).abs() < 1e-15);
    let (before, after) = all("gasoline-3cyl-bush", "valve_spring.intake", "share_percent", -10.0);
    for (lift_m, valve) in [0.0, 5e-3].into_iter().flat_map(|lift| ["intake", "exhaust"].map(|valve| (lift, valve))) {
        let of = |m: &Model| {
            let path = format!("valves.{valve}.1");
            let k = m.coordinates.iter().position(|c| c.path == path).unwrap_or_else(|| panic!("{path}"));
            m.valve_spring_n(k, lift_m)
        };
        close(of(&after), of(&before) * if valve == "intake" { 0.9 } else { 1.0 });
    }
    // What the springs can hold on its cam grows with the square of the speed.
    let halved = common::bundled("gasoline-3cyl-bush", &["effects.valve_spring.intake.share_percent=-50"]);
    let intake = halved.valves.iter().find(|v| v.name == "intake").expect("they are there");
    close(intake.with_effects(&halved.effects).floats_at_rad_s(), intake.floats_at_rad_s() * 0.5_f64.sqrt());
    let (before, after) = all("gasoline-3cyl-bush", "coupling_stiffness.transducer", "share_percent", 50.0);
    let coupling =
        |m: &Model| m.couplings.iter().find(|c| c.path == "couplings.transducer").expect("it").stiffness_nm_per_rad;
    close(coupling(&after), 1.5 * coupling(&before));
    let (before, after) = all("tensioner-20-40", "joint_clearance.chain", "clearance_um", 8.0);
    assert!((after.chain.joints[0].clearance_m - before.chain.joints[0].clearance_m - 8e-6).abs() < 1e-15);
    let refused = |drive: &str, set: &str| {
        let (_, text) = pitchline::drive::BUNDLED.iter().find(|(name, _)| *name == drive).expect("it is bundled");
        pitchline::drive::Drive::parse(drive, text, &[set.to_string()]).expect_err(set).to_string()
    };
    let other = refused("v12-primary", "effects.blade_stiffness.tight.share_percent=5");
    assert!(other.contains("`tight` is not a rail that bends") && other.contains("there are: slack"), "{other}");
    let none = refused("bush-20-40", "effects.valve_spring.intake.share_percent=5");
    assert!(none.contains("`intake` is not the valves of a camshaft") && none.contains("there is none"), "{none}");
}

/// Radial clearance of the bearing of `bmw318-camshaft` [um].
const CLEARANCE_UM: f64 = 35.0;

/// What no such effect can act on is an error that names it.
#[test]
fn effects_on_tensioners_name_what_they_cannot_act_on() {
    use pitchline::drive::{BUNDLED, Drive};
    let refused = |bundled: &str, set: &str| {
        let (_, text) = BUNDLED.iter().find(|(name, _)| *name == bundled).expect("it is bundled");
        Drive::parse(bundled, text, &[set.to_string()]).expect_err(set).to_string()
    };
    let hole = refused("ford-v6", "effects.leak_gap.throttle.gap_um=5");
    assert!(hole.contains("`throttle` is not a leak gap of oil") && hole.contains("there are: plunger"), "{hole}");
    let dry = refused("bush-20-40", "effects.oil_air.oil.air_percent=5");
    assert!(dry.contains("the drive has no oil"), "{dry}");
    let none = refused("tensioner-20-40", "effects.orifice_diameter.feed.diameter_um=5");
    assert!(none.contains("`feed` is not an orifice of oil") && none.contains("there is none"), "{none}");
    let wide = refused("ford-v6", "effects.leak_gap.plunger.gap_um=5000");
    assert!(wide.contains("-500") && wide.contains("500"), "{wide}");
    let rail = refused("ford-v6", "effects.guide_compliance.slack.compliance_um_per_kn=5");
    assert!(rail.contains("rail `slack` turns with an arm"), "{rail}");
    let blade = refused("v12-primary", "effects.guide_compliance.slack.compliance_um_per_kn=5");
    assert!(blade.contains("rail `slack` bends"), "{blade}");
    let none = refused("ford-v6", "effects.guide_compliance.slak.compliance_um_per_kn=5");
    assert!(none.contains("no guide is called `slak`") && none.contains("slack, tight"), "{none}");
}

/// A drive on which an effect can act, as it is called, its text, and the values that make it so. Spans have effects on chains of
/// spans alone, oil where there is some.
fn host(effect: &pitchline::effects::Effect) -> (&'static str, &'static str, Vec<String>) {
    use pitchline::effects::{On, Part};
    let (name, sets) = match (effect.links, effect.part) {
        (Some(On::Span), _) => ("reduction-20-40-20-40", vec!["chains.second.fidelity=spans".to_string()]),
        (Some(On::Blade), _) => ("v12-primary", Vec::new()),
        (Some(On::Bearing), _) => ("bmw318-camshaft", Vec::new()),
        (Some(On::Valve | On::Coupling), _) => ("gasoline-3cyl-bush", Vec::new()),
        (_, Part::Tensioner) => ("ford-v6", Vec::new()),
        _ => ("bush-20-40", Vec::new()),
    };
    let (_, text) = pitchline::drive::BUNDLED.iter().find(|(bundled, _)| *bundled == name).expect("it is bundled");
    (name, text, sets)
}

/// What the effect acts on there.
fn target_of(on: Option<pitchline::effects::On>) -> &'static str {
    use pitchline::effects::On;
    match on {
        Some(On::Guide) => "tight",
        Some(On::Sprocket | On::Prescribed) => "driver",
        Some(On::Chain) => "odd",
        Some(On::Body) | None => "driven",
        Some(On::Span) => "output-pinion",
        Some(On::Blade) => "slack",
        Some(On::Bearing) => "cam",
        Some(On::Valve) => "intake",
        Some(On::Coupling) => "transducer",
        Some(On::Arm) => "arm",
        Some(On::Leak) => "plunger",
        Some(On::Orifice) => "throttle",
        Some(On::Check) => "ball",
        Some(On::Oil) => "oil",
        Some(On::Joints | On::Input | On::Sensor | On::AngleSensor | On::Pickup) => "chain",
    }
}

/// Drives with link bodies accept the effects that the catalogue assigns to them.
#[test]
fn drives_with_links_take_the_effects_that_say_so() {
    use pitchline::effects::EFFECTS;
    let mut taken = 0;
    for e in EFFECTS {
        let target = target_of(Some(e.links.unwrap_or(e.on)));
        let keys = e.parameters.iter().filter(|p| !p.lumped_only);
        let (name, text, mut sets) = host(e);
        sets.extend(keys.map(|p| format!("effects.{}.{target}.{}={}", e.name, p.key, p.low.max(1.0))));
        let result = pitchline::drive::Drive::parse(name, text, &sets);
        assert_eq!(result.is_ok(), e.links.is_some(), "{}: {sets:?}", e.name);
        taken += usize::from(e.links.is_some());
    }
    assert_eq!(taken, 34);
}

/// A drive with links takes each parameter of an effect in the whole range of its row, and nothing outside; a fit of it has the same
/// bounds, whether the file declares the effect or a search places it.
#[test]
fn readers_and_fits_have_the_ranges_of_the_catalogue() {
    use pitchline::drive::{Drive, sensors::is_signal};
    use pitchline::effects::{EFFECTS, Effect, Kind, Parameter};
    use pitchline::machine::Machine;
    // Those that a search places have less: a gap of 50 um, a hole of 2500 um and oil with 1 % of air lose no more than they have; half of the oil at most is air.
    let range = |e: &Effect, p: &Parameter| match e.name {
        "leak_gap" => (0.1 - 50.0, p.high),
        "orifice_diameter" => ((1.0 - 2500.0_f64).max(p.low), p.high),
        "oil_air" => (-1.0, 49.0),
        "bearing_clearance" => (0.1 - CLEARANCE_UM, p.high),
        _ => (p.low, p.high),
    };
    let mut tried = 0;
    for e in EFFECTS.into_iter().filter(|e| e.links.is_some() || is_signal(e)) {
        let (drive, text, sets) = host(e);
        let has_driven = drive == "bush-20-40";
        let text = if has_driven { format!("{text}\n[sensors.encoder.driven]\n") } else { text.to_string() };
        let plain = Machine::of_links(&Drive::parse(drive, &text, &sets).expect("a drive"));
        let target = target_of(e.links);
        let rows: Vec<_> = e.parameters.iter().filter(|p| !p.lumped_only).collect();
        // The range of an index ends with the chain before the row's does.
        for p in rows.iter().filter(|p| p.kind != Kind::Index) {
            let keys = |value: f64| {
                let of = |o: &&Parameter| if o.key == p.key { value } else { o.default.unwrap_or(o.low.max(1.0)) };
                rows.iter().map(|o| format!("{} = {}\n", o.key, of(o))).collect::<String>()
            };
            let path = e.path(target, p.key);
            let parse = |value: f64| {
                let file = format!("{text}\n[effects.{}.{target}]\n{}", e.name, keys(value));
                Drive::parse(drive, &file, &sets)
            };
            let beyond = 1.0 + 1e-3 * (p.high - p.low);
            assert!(parse(p.low - beyond).is_err() && parse(p.high + beyond).is_err(), "{path} beyond its range");
            for end in [p.low, p.high] {
                let m = Machine::of_links(&parse(end).unwrap_or_else(|e| panic!("{path} = {end}: {e}")));
                let slot = &m.slots[m.slot(&path).expect("a slot")];
                assert_eq!((slot.low, slot.high), (p.low, p.high), "{path}");
                tried += 1;
            }
        }
        let (name, at) = plain.targets(e).into_iter().next().expect("a target");
        let values: Vec<f64> = plain.keys(e, at).iter().map(|(_, p)| p.low * p.unit).collect();
        let (placed, slots) = plain.with_effect(e, &name, at, &values);
        for ((_, p), slot) in plain.keys(e, at).iter().zip(slots) {
            let own = &placed.slots[slot];
            let (low, high) = range(e, p);
            assert!((own.low - low).abs() + (own.high - high).abs() < 1e-6, "{}.{}: {own:?}", e.name, p.key);
        }
    }
    assert!(tried >= 40, "{tried} ends of ranges");
}

/// Runout is a rigid displacement of the toothing: each gap sees the bush as if the bush were displaced in the opposite
/// direction.
#[test]
fn runout_displaces_every_gap_alike() {
    use pitchline::geometry::unit;
    use pitchline::pairs::bush_gap::{gap_contact, seat_index};
    let (e_m, phase) = (80e-6, 0.7);
    let toothing = |sets: &[&str]| {
        let model = common::assembled(&common::drive(sets)).model;
        model.sprockets[0].geometry.iso().expect("seats").clone()
    };
    let plain = toothing(&[]);
    let off = toothing(&["effects.sprocket_runout.driver.amplitude_um=0"]);
    assert_eq!(plain, off);
    let eccentric = toothing(&[
        "effects.sprocket_runout.driver.amplitude_um=80",
        &format!("effects.sprocket_runout.driver.phase_deg={}", phase * 180.0 / std::f64::consts::PI),
    ]);
    let mut compared = 0;
    for i in 0..20_000 {
        let radius = plain.root_radius_m + 2.3e-3 + 1.5e-3 * f64::from(i % 97) / 97.0;
        let p = unit(f64::from(i) * 0.618) * radius;
        let moved = p - unit(phase) * e_m;
        if seat_index(&plain, p) != seat_index(&plain, moved) {
            continue;
        }
        let (a, b) = (gap_contact(&eccentric, p, 2.5e-3), gap_contact(&plain, moved, 2.5e-3));
        assert!((a.touch.penetration_m - b.touch.penetration_m).abs() < 1e-15, "{i}: {a:?} {b:?}");
        assert!((a.touch.normal - b.touch.normal).norm() < 1e-9);
        assert!((a.touch.on_body - b.touch.on_body - unit(phase) * e_m).norm() < 1e-12);
        compared += 1;
    }
    assert!(compared > 19_000, "{compared}");
}

/// The same of a silent sprocket, up to the half millimetre that a file may state: links touch it as they touch the centred one after they are
/// moved back.
#[test]
fn runout_displaces_a_silent_sprocket_as_a_whole() {
    use pitchline::geometry::{Vec2, unit};
    use pitchline::pairs::contour_body::LinkPose;
    let plain = common::assembled(&common::bundled("silent-20-40", &[]));
    let contour = plain.model.contours[0].as_ref().expect("flanks");
    for um in [50, 500] {
        let sets = [
            format!("effects.sprocket_runout.driver.amplitude_um={um}"),
            "effects.sprocket_runout.driver.phase_deg=40".into(),
        ];
        let eccentric = common::assembled(&common::bundled("silent-20-40", &sets.each_ref().map(String::as_str)));
        let (mut compared, mut other_gap) = (0, 0);
        for (body, off) in plain.model.end_bodies.iter().zip(&eccentric.model.end_bodies).filter(|(b, _)| b.body == 0) {
            let turn = body.frame.turn.expect("it turns");
            let angle = plain.state.coordinates.angle[turn];
            let rotor = (libm::cos(angle), libm::sin(angle));
            let shift = unit(angle + 40.0_f64.to_radians()) * (f64::from(um) * 1e-6);
            for (link, front) in plain.model.chain.links().flat_map(|link| [(link, true), (link, false)]) {
                let (links, lever) = (&plain.state.links, plain.model.chain.lever[link]);
                let at = |centre: Vec2| LinkPose {
                    centre,
                    cos: links.cos[link],
                    sin: links.sin[link],
                    lever: if front { lever } else { -lever },
                    front,
                    row: plain.model.row_of(link),
                };
                let centre = Vec2::new(links.x[link], links.y[link]) - body.frame.origin;
                let Some(a) = body.touch(contour, &at(centre), rotor, 0.2e-3) else { continue };
                let b = off.touch(contour, &at(centre + shift), rotor, 0.2e-3);
                let Some(b) = b.filter(|b| b.tooth == a.tooth) else {
                    other_gap += 1;
                    continue;
                };
                assert!((a.penetration_m - b.penetration_m).abs() < 1e-15, "{link}: {a:?} {b:?}");
                assert!((a.normal - b.normal).norm() < 1e-9 && (b.point - a.point - shift).norm() < 1e-14);
                compared += 1;
            }
        }
        println!("{um} um: {compared} touches alike, {other_gap} in another gap");
        assert!(compared >= 15 && other_gap < 5, "{compared} {other_gap}");
    }
}

/// One gap of a silent sprocket lies further out: links in it touch as deep as that, in the other gaps as before. Gaps and links that do not
/// exist are refused with a caret.
#[test]
fn one_gap_of_a_silent_sprocket_lies_further_out() {
    use pitchline::geometry::Vec2;
    use pitchline::pairs::contour_body::LinkPose;
    let sets = ["effects.gap_error.driver.gap=7", "effects.gap_error.driver.outward_um=30"];
    let (plain, odd) = (
        common::assembled(&common::bundled("silent-20-40", &[])),
        common::assembled(&common::bundled("silent-20-40", &sets)),
    );
    let contour = plain.model.contours[0].as_ref().expect("flanks");
    let (links, mut moved, mut same) = (&plain.state.links, 0, 0);
    for (body, off) in plain.model.end_bodies.iter().zip(&odd.model.end_bodies).filter(|(b, _)| b.body == 0) {
        for (link, turned) in plain.model.chain.links().flat_map(|link| (0..20).map(move |turned| (link, turned))) {
            // Every link meets gap 7 in one of these positions of the sprocket.
            let turn = body.frame.turn.expect("it turns");
            let angle = plain.state.coordinates.angle[turn] + f64::from(turned) * std::f64::consts::TAU / 20.0;
            let rotor = (libm::cos(angle), libm::sin(angle));
            let gap = angle + 7.0 * std::f64::consts::TAU / 20.0;
            let shift = Vec2::new(libm::cos(gap), libm::sin(gap)) * 30e-6;
            let at = |centre: Vec2| LinkPose {
                centre,
                cos: links.cos[link],
                sin: links.sin[link],
                lever: plain.model.chain.lever[link],
                front: true,
                row: plain.model.row_of(link),
            };
            let centre = Vec2::new(links.x[link], links.y[link]) - body.frame.origin;
            let Some(a) = body.touch(contour, &at(centre), rotor, 0.1e-3) else { continue };
            if a.tooth == 7 {
                let b = off.touch(contour, &at(centre + shift), rotor, 0.1e-3).expect("touches");
                assert!((a.penetration_m - b.penetration_m).abs() < 1e-15, "{link}: {a:?} {b:?}");
                moved += 1;
            } else {
                assert_eq!(off.touch(contour, &at(centre), rotor, 0.1e-3), Some(a));
                same += 1;
            }
        }
    }
    println!("{moved} touches in the gap, {same} in others");
    assert!(moved > 5 && same > 100, "{moved} {same}");
    for (set, said) in [
        ("effects.gap_error.driver.gap=20", "sprocket `driver` has no gap 20"),
        ("effects.link_mass.odd.link=90", "the chain has no link 90"),
        ("effects.link_mass.odd.mass_percent=-95", "outside -90 ..= 1000"),
    ] {
        let more = if set.contains("gap") {
            "effects.gap_error.driver.outward_um=3"
        } else {
            "effects.link_mass.odd.inertia_percent=3"
        };
        let link = if set.contains("link=") || set.contains("gap") {
            vec![]
        } else {
            vec!["effects.link_mass.odd.link=3".to_string()]
        };
        let sets = [vec![set.to_string(), more.to_string()], link].concat();
        let text = pitchline::drive::BUNDLED.iter().find(|b| b.0 == "silent-20-40").expect("bundled").1;
        let report = pitchline::drive::Drive::parse("silent-20-40", text, &sets).expect_err(set).to_string();
        assert!(report.contains(said), "{set}: {report}");
    }
}

/// The step's kernel finds the depths of the exact detection for displaced gaps.
#[test]
fn kernel_and_exact_detection_agree_on_displaced_gaps() {
    use pitchline::integrate::explicit::{ContactGroup, Scratch, advance, evaluate};
    let assembly = common::assembled(&common::drive(&[
        "effects.sprocket_runout.driver.amplitude_um=60",
        "effects.tooth_pitch_error.driven.amplitude_um=40",
        "effects.tooth_pitch_error.driven.order=3",
        "effects.gap_error.driven.gap=5",
        "effects.gap_error.driven.outward_um=-30",
    ]));
    let (model, mut state) = (assembly.model, assembly.state);
    let mut scratch = Scratch::new(&model);
    let mut touching = 0;
    for step in 0..9000 {
        evaluate(&model, &state, &mut scratch).expect("steps");
        if step % 300 == 0 {
            let [(x, _), (y, _)] = scratch.joint_ends();
            for j in (0..model.chain.n_links).filter(|j| scratch.memory(ContactGroup::Bushes).age[*j] > 0.0) {
                let Some((k, tooth)) = scratch.partner(&model, ContactGroup::Bushes, j) else { continue };
                // The kernel assumes a front bush at the joint.
                if !model.chain.bush_carrier(j).1 {
                    continue;
                }
                let (c, s) = (state.coordinates.cos[k], state.coordinates.sin[k]);
                let d = pitchline::geometry::Vec2::new(x[j], y[j]) - model.sprockets[k].frame.origin;
                let d = pitchline::geometry::Vec2::new(c * d.x + s * d.y, c * d.y - s * d.x);
                let exact = pitchline::pairs::bush_gap::gap_contact(
                    model.sprockets[k].geometry.iso().expect("seats"),
                    d,
                    2.5e-3,
                );
                assert_eq!(exact.tooth, tooth);
                let depth = scratch.depth(ContactGroup::Bushes, j);
                assert!((depth - exact.touch.penetration_m).abs() < 1e-13, "joint {j}: {depth} {exact:?}");
                touching += 1;
            }
        }
        advance(&model, &mut state, &mut scratch);
    }
    assert!(touching > 300, "{touching}");
}

/// A tight joint dissipates its torque times its articulation angles: twice 2 pi / z on every sprocket.
#[test]
fn a_tight_joint_loses_its_torque_times_its_turns() {
    use pitchline::integrate::explicit::{Scratch, step};
    let sets = [
        "effects.tight_joint.rusty.joint=17",
        "effects.tight_joint.rusty.torque_nm=0.01",
        "chain.joint.friction=0",
        "chain.joint.stick_speed_rad_s=5",
        "speeds.constant.driver.speed_rpm=300",
    ];
    // Without friction links swing beside what they turn, the longer the less their contacts damp.
    let text = common::with_linear_laws(pitchline::drive::BUNDLED[0].1, 200.0);
    let drive = pitchline::drive::Drive::parse("bush-20-40", &text, &sets.map(str::to_string));
    let assembly = common::assembled(&drive.unwrap_or_else(|e| panic!("{e}")));
    let (model, mut state) = (assembly.model, assembly.state);
    let mut scratch = Scratch::new(&model);
    let loop_s = 90.0 / (20.0 * 5.0);
    for _ in 0..(loop_s / model.step_s).round() as u64 {
        step(&model, &mut state, &mut scratch).expect("steps");
    }
    let lost: Vec<f64> = state.lost_pin_friction[..90].to_vec();
    let turns = 2.0 * 2.0 * std::f64::consts::PI * (1.0 / 20.0 + 1.0 / 40.0);
    println!("lost {:.5} J, {:.5} J by its turns", lost[17], 0.01 * turns);
    assert!(lost.iter().enumerate().all(|(j, w)| j == 17 || *w == 0.0), "others have no friction");
    assert!((lost[17] / (0.01 * turns) - 1.0).abs() < 0.1, "{}", lost[17] / (0.01 * turns));
}
