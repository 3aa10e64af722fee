//! Debugging functions: a repeated run equals its recording, hits equal those of a scan over every step, forces add up.

mod common;

use pitchline::analysis::explain::explain;
use pitchline::assemble::Assembly;
use pitchline::breakpoint::scratch::BreakWatch;
use pitchline::breakpoint::{Breakpoint, Names};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::impacts::ImpactWatch;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::recording::capture::{self, Camera, ledger_at};
use pitchline::recording::columns::Rows;
use pitchline::recording::frame::{Feature, Frame, Header};
use pitchline::recording::reader::Reader;
use pitchline::recording::{ViewOptions, create, mcap};
use pitchline::replay::{Replay, verify};
use pitchline::simulate::{Breaks, Job, RunLength, run_job};
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Assembles a bundled drive and records `steps` of it, a frame every `every` steps.
fn record(bundled: usize, overrides: &[&str], path: &Path, steps: u64, every: u64) -> Header {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_string()).collect();
    let (name, text) = BUNDLED[bundled];
    record_drive(&Drive::parse(name, text, &overrides).expect("a good drive"), path, steps, every)
}

fn record_drive(drive: &Drive, path: &Path, steps: u64, every: u64) -> Header {
    let Assembly { model, mut state, report } = common::assembled(drive);
    let mut header = capture::header(drive, &model, &report, every);
    header.ledger_origin = Some(ledger_at(&model, &state).expect("holds"));
    let mut sinks = vec![create(path, &header, ViewOptions::default()).expect("opens")];
    let job = Job {
        header: &header,
        span: RunLength { steps, steps_per_frame: every },
        breaks: None,
        impacts: ImpactWatch::new(&model),
        camera: Camera::since(header.ledger_origin),
    };
    let stop = AtomicBool::new(false);
    run_job(&model, &mut state, &mut Scratch::new(&model), job, &mut sinks, &stop, |_| ()).expect("runs");
    for sink in &mut sinks {
        sink.finish().expect("finishes");
    }
    header
}

/// The same numbers everywhere: a linear congruential generator.
struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % n
    }
}

/// Steps of each bundled drive, limited by test time.
const STEPS: [u64; BUNDLED.len()] = [4500, 1500, 1200, 1500, 800, 1200, 600, 500, 600, 500, 500, 300, 1500, 500, 500];

#[test]
fn random_windows_run_again_are_the_recording_to_the_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    for bundled in 0..BUNDLED.len() {
        let path = folder.path().join("a.mcap");
        record(bundled, &[], &path, STEPS[bundled], 1);
        let mut replay = Replay::open(&path).expect("opens");
        let hashes: Vec<u64> = replay.reader.heads().expect("heads").iter().map(|h| h.state_hash).collect();
        let recorded = mcap::read(&path).expect("readable").frames;
        let mut random = Random(7 + bundled as u64);
        for _ in 0..20 {
            let from = random.below(STEPS[bundled] - 40);
            let visit = replay.visit(from, |_, _| ()).expect("goes there");
            let (mut state, mut scratch) = (visit.state, visit.scratch);
            let mut camera = replay.camera();
            for step in from..from + 1 + random.below(40) {
                assert_eq!(state.hash(), hashes[step as usize], "{} at step {step}", BUNDLED[bundled].0);
                explicit::evaluate(&replay.model, &state, &mut scratch).expect("holds");
                let frame = camera.take(&replay.model, &state, &scratch);
                assert!(frame == recorded[step as usize], "{}: frame of step {step}", BUNDLED[bundled].0);
                explicit::advance(&replay.model, &mut state, &mut scratch);
            }
        }
        println!("{}: 20 windows equal", BUNDLED[bundled].0);
    }
}

#[test]
fn verify_says_which_frame_is_not_reproduced() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, changed) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    for bundled in 0..BUNDLED.len() {
        record(bundled, &[], &path, STEPS[bundled], 10);
        let stop = AtomicBool::new(false);
        let verdict = verify(&mut Replay::open(&path).expect("opens"), &stop, |_| ()).expect("runs").expect("ends");
        assert_eq!((verdict.mismatches, verdict.assembled), (0, true), "{:?}", verdict.first);
    }
    record(0, &[], &path, 2000, 10);
    let whole = mcap::read(&path).expect("readable");
    let write = |header: &Header, change: &dyn Fn(usize, &mut Frame), change_keyframe: bool| {
        let mut sink = create(&changed, header, ViewOptions::default()).expect("opens");
        for (i, frame) in whole.frames.iter().enumerate() {
            let mut frame = frame.clone();
            change(i, &mut frame);
            sink.frame(&frame).expect("writes");
            for keyframe in whole.keyframes.iter().filter(|k| k.step == frame.step) {
                let mut keyframe = keyframe.clone();
                if change_keyframe {
                    let v = &mut keyframe.columns[2].values[5];
                    *v = f64::from_bits(v.to_bits() ^ 1);
                }
                sink.keyframe(&keyframe).expect("writes");
            }
        }
        sink.finish().expect("finishes");
        let stop = AtomicBool::new(false);
        verify(&mut Replay::open(&changed).expect("opens"), &stop, |_| ()).expect("runs").expect("ends")
    };
    // One bit of one position: the last one that is stored.
    let flip = |i: usize, f: &mut Frame| {
        if i == 77 {
            f.links.x_m[12] = f64::from_bits(f.links.x_m[12].to_bits() ^ (1 << 13));
        }
    };
    let verdict = write(&whole.header, &flip, false);
    let first = verdict.first.expect("a mismatch");
    assert_eq!((verdict.mismatches, first.frame), (1, 77));
    assert!(first.what.contains("links.x_m[12]"), "{}", first.what);
    // One bit of the hash.
    let verdict = write(&whole.header, &|i, f| f.state_hash ^= u64::from(i == 3), false);
    assert_eq!((verdict.mismatches, verdict.first.map(|f| f.frame)), (1, Some(3)));
    // A keyframe.
    let verdict = write(&whole.header, &|_, _| (), true);
    assert_eq!(verdict.first.map(|f| f.frame), Some(0));
    // One digit of the drive.
    let mut header = whole.header.clone();
    header.drive_text = header.drive_text.replace("torque_nm = 20 ", "torque_nm = 21 ");
    assert_ne!(header.drive_text, whole.header.drive_text);
    let verdict = write(&header, &|_, _| (), false);
    assert_eq!(verdict.first.map(|f| f.frame), Some(0));
    assert!(verdict.mismatches > whole.frames.len() as u64 / 2);
}

/// Links of every chain: the last of each is followed by its first.
fn chains(header: &Header) -> Vec<usize> {
    let ends: Vec<usize> = (0..header.links.len()).filter(|i| header.links[*i].ahead as usize <= *i).collect();
    ends.iter().map(|end| end + 1 - header.links[*end].ahead as usize).collect()
}

/// Rotating bodies and coordinates, with their rows.
fn turning(header: &Header) -> Vec<(String, usize)> {
    let bodies = header.bodies.iter().filter_map(|b| Some((b.path.clone(), b.coordinate? as usize)));
    bodies.chain(header.coordinates.iter().cloned().enumerate().map(|(row, path)| (path, row))).collect()
}

fn names(header: &Header) -> Names {
    Names {
        bodies: header.bodies.iter().map(|b| b.path.clone()).collect(),
        turning: turning(header),
        rows: [Rows::Slider, Rows::Touch, Rows::Chamber, Rows::Passage]
            .map(|rows| (rows, header.row_paths(rows).expect("named").to_vec()))
            .to_vec(),
        chains: chains(header),
    }
}

/// Returns the numbers of hits.
fn hits_are_those_of_a_scan(
    path: &Path,
    recording: &mcap::Recording,
    header: &Header,
    expressions: &[&str],
) -> Vec<usize> {
    let mut counts = Vec::new();
    for expression in expressions {
        // Engines call their sprockets otherwise.
        let name = |k: usize| header.bodies[k].path.trim_start_matches("sprockets.");
        let (driver, driven) = (name(0), name(1));
        let expression = &expression.replace("driver", driver).replace("driven", driven);
        let breakpoint = Breakpoint::parse(expression, &names(header)).expect("a good expression");
        // From the recording: everything that fulfils it in a frame and not in the one before.
        let mut expected = Vec::new();
        let mut before = Vec::new();
        for frame in &recording.frames {
            let now = breakpoint.holding(frame);
            expected.extend(now.iter().filter(|s| !before.contains(*s)).map(|s| (frame.step, *s)));
            before = now;
        }
        assert_eq!(hits(path, breakpoint, None), expected, "{}: {expression}", header.drive_name);
        println!("{}: {} hits of {expression}", header.drive_name, expected.len());
        counts.push(expected.len());
    }
    counts
}

#[test]
fn hits_are_those_of_a_scan_over_every_step() {
    let folder = tempfile::tempdir().expect("a folder");
    let expressions = [
        "contact.penetration > 5 um",
        "contact.normal_force > 500 N or contact.normal_force < 2 N",
        "contact.body == \"driver\" and contact.tooth == 7",
        "contact.feature == 'rear plate end' and contact.normal_speed > 0.1 m/s",
        "contact.tangential_speed > 0.2 m/s and not contact.stick == 1",
        "contact.segment != 'seat' && contact.penetration >= 0.5um",
        "link[12].tension < 300 N",
        "link.tension < 150 N",
        "abs(link.omega) > 400 rad/s",
        "joint.force > 590 N",
        "sprocket.driven.speed < 1499.6 rpm",
        "energy.error > 0.01 %",
        "energy.error_j > 0.0001 J or energy.kinetic > 21.342 J",
        "energy.elastic < 0.2 J and energy.lost > 1 mJ",
        "contact.normal_force > 400 N and link.tension > 560 N",
        "time > 3 ms and crank_angle < 60 deg",
        "sprocket.driver.chain_torque < -10.2 Nm or sprocket.driven.chain_torque > 20.5 Nm",
        "sprocket.driver.outer_torque > 10 Nm and contact.body == 'driver' and contact.stick == 1",
        "abs(contact.tangential_force) > 12 N",
        "0 N > contact.tangential_force and contact.tangential_speed <= 0.5 m/s",
        "contact.segment == 'seat' or contact.segment == 'counterclockwise flank'",
        "contact.segment == 'ring' and contact.normal_force > 20 N",
        "link.speed > 8.2 m/s or link.angle > 170 deg",
        "abs(link.angle) < 2 deg",
        "link.x > 30 mm and link.y < 0 mm and link.vx >= 0 m/s",
        "joint.friction_torque > 0.3 N m",
        // Ages in frames have 7 digits: a limit that none of them meets.
        "contact.age > 3.0005 ms and contact.penetration < 1 um",
        "contact.normal_force > 300 N and joint.force > 595 N",
    ];
    for bundled in 0..BUNDLED.len() {
        let path = folder.path().join("a.mcap");
        let header = record(bundled, &[], &path, STEPS[bundled], 1);
        let recording = mcap::read(&path).expect("readable");
        hits_are_those_of_a_scan(&path, &recording, &header, &expressions);
        if BUNDLED[bundled].0 == "arm-20-40" {
            let of_arms = [
                "arm.tensioner.speed > 0.5 rad/s or arm.tensioner.angle < 1.9 deg",
                "arm.tensioner.chain_torque < -3.9 Nm and contact.feature == 'plate edge'",
                "arm.tensioner.outer_torque > 3.9 Nm or contact.segment == 'rail arc' and contact.normal_force > 12 N",
                "contact.body == \"slack\" and contact.penetration > 1 um",
            ];
            hits_are_those_of_a_scan(&path, &recording, &header, &of_arms);
        }
        if BUNDLED[bundled].0 == "tensioner-20-40" {
            let of_parts = [
                "slider.plunger.position > -0.6 um",
                "abs(slider.plunger.speed) > 2 mm/s and slider.plunger.spring_force < 30 N",
                "slider.plunger.oil_force > 28.5 N or slider.plunger.touch_force < -49 N",
                "ball.feed.position > 0 um or ball.feed.touch_force > 0.02 N",
                "ball.feed.speed > 0 m/s and ball.feed.oil_force < 0.1 N and ball.feed.spring_force < 0 N",
                "touch.plunger.tip.normal_force > 50 N and touch.plunger.tip.gap < -4 um",
                "touch.plunger.tip.tangential_force > 0 N or touch.feed.seat.age > 1 ms",
                "touch.plunger.tip.approach_speed > 0 m/s and link.tension > 550 N",
                "chamber.high.pressure > 2.98 bar and chamber.high.volume < 2000 mm3",
                "chamber.high.inflow < -1 mm3/s or reservoir.sump.inflow > 900 mm3/s",
                "passage.plunger.flow > 0.9 cm3/s or passage.feed.pressure_drop > 0 Pa",
                "reservoir.gallery.pressure > 2.9 bar and contact.normal_force > 120 N",
                "energy.work_in > 2 mJ and arm.tensioner.outer_torque > 3.9 Nm",
            ];
            let found = hits_are_those_of_a_scan(&path, &recording, &header, &of_parts);
            // Not all of them may be true always or never.
            assert!(found.iter().filter(|n| **n > 1).count() >= 6, "{found:?}");
        }
        if BUNDLED[bundled].0 == "gasoline-3cyl-bush" {
            let of_shafts = [
                "shaft.transducer.speed > 1000 rpm and shaft.transducer.angle > 10 deg",
                "shaft.transducer.outer_torque > 0.1 Nm or abs(shaft.transducer.chain_torque) > 0 Nm",
                "passage.throttle.flow > 10 mm3/s or slider.plunger.speed > 1 mm/s",
            ];
            hits_are_those_of_a_scan(&path, &recording, &header, &of_shafts);
        }
        // Impacts: those of the recording.
        let breakpoint = Breakpoint::parse("impact.approach_speed > 0.1 m/s", &names(&header)).expect("good");
        let mut expected: Vec<u64> =
            recording.impacts.iter().filter(|i| i.approach_speed_m_s > 0.1).map(|i| i.step).collect();
        expected.sort_unstable();
        let mut found: Vec<u64> = hits(&path, breakpoint, None).iter().map(|h| h.0).collect();
        found.sort_unstable();
        assert_eq!(found, expected);
    }
}

/// One impact, one peak: the recording, `explain` and the strip have the same number.
#[test]
fn explain_and_the_strip_have_the_peak_of_the_impact() {
    use pitchline::render::snapshot::{SnapshotOptions, ViewCentre, draw};
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let mut shown = 0;
    for bundled in [0, 1, 2] {
        record(bundled, &[], &path, 30_000, 100);
        let recording = mcap::read(&path).expect("readable");
        let mut replay = Replay::open(&path).expect("opens");
        let mut hard: Vec<_> = recording.impacts.iter().filter(|i| i.t_s > 1e-3 && i.watched_s > 1.9e-3).collect();
        hard.sort_by(|a, b| b.peak_force_n.total_cmp(&a.peak_force_n));
        assert!(hard.len() > 4, "{}", hard.len());
        for impact in hard.into_iter().take(4) {
            let step = replay.step_at(impact.t_s + impact.peak_after_s);
            let body = explain(&mut replay, impact.link as usize, step).expect("explained");
            let part = Feature::name(impact.feature);
            let path = &recording.header.bodies[impact.body as usize].path;
            let contact = body.contacts.iter().find(|c| c.feature == part && c.body == *path).expect("the contact");
            println!("{} {part}: {} N, {} N", recording.header.drive_name, impact.peak_force_n, contact.peak_force_n);
            assert_eq!(contact.peak_force_n.to_bits(), impact.peak_force_n.to_bits());
            assert!(contact.normal_force_n <= contact.peak_force_n);
            let visit = replay.visit(step, |_, _| ()).expect("goes there");
            let (state, mut scratch) = (visit.state, visit.scratch);
            explicit::evaluate(&replay.model, &state, &mut scratch).expect("holds");
            let frame = replay.camera().take(&replay.model, &state, &scratch);
            let around = ViewCentre::Link(impact.link as usize);
            let impacts = &recording.impacts;
            let options = SnapshotOptions { around, width_mm: Some(14.0), joints: false, impacts };
            let svg = draw(&recording.header, &[&frame], options).svg;
            // Every peak in the strip is that of an impact; without room beside its arrow one is left out.
            let told: Vec<&str> = svg.split("peak ").skip(1).filter_map(|rest| rest.split(" N<").next()).collect();
            let known: Vec<String> = impacts.iter().map(|i| format!("{:.0}", i.peak_force_n)).collect();
            let own = format!("{:.0}", impact.peak_force_n);
            shown += usize::from(told.contains(&own.as_str()));
            let large = told.iter().filter(|t| !t.contains('.') && t.len() < 5);
            large.for_each(|t| assert!(known.iter().any(|k| k == t), "peak {t} N"));
        }
    }
    assert!(shown >= 8, "{shown} of 12 peaks are shown");
}

/// A link that weighs twice as much: its forces add up to that mass times its acceleration, at the seam of the columns too, and pin friction
/// has rows of its own.
#[test]
fn a_heavier_link_obeys_newton_with_its_own_mass() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    for (bundled, link) in [(0, 0), (0, 37), (1, 89), (2, 36), (12, 5)] {
        let effect = "effects.link_mass.odd";
        let set = [
            format!("{effect}.link={link}"),
            format!("{effect}.mass_percent=100"),
            format!("{effect}.inertia_percent=150"),
        ];
        record(bundled, &set.each_ref().map(String::as_str), &path, 3000, 100);
        let mut replay = Replay::open(&path).expect("opens");
        let plain = explain(&mut replay, link + 2 - 4 * (link / 88), 2500).expect("explained");
        let heavy = explain(&mut replay, link, 2500).expect("explained");
        println!("{}: link {link} {} g, {}", BUNDLED[bundled].0, heavy.mass_kg * 1e3, heavy.remainder_share);
        assert!((heavy.mass_kg / plain.mass_kg - 2.0).abs() < 1e-12);
        assert!((heavy.inertia_kg_m2 / plain.inertia_kg_m2 - 2.5).abs() < 1e-12);
        // Rounding, as for every other link.
        assert!(heavy.remainder_share < 1e-9 && heavy.remainder_moment_share < 1e-9, "{heavy:?}");
        let rubs = heavy.forces.iter().filter(|f| f.kind == "pin friction").count();
        assert_eq!(rubs, 2);
        let (a, m) = (libm::hypot(heavy.acceleration_x_m_s2, heavy.acceleration_y_m_s2), heavy.mass_kg);
        assert!(m * a > 1e-3, "{} N", m * a);
    }
}

/// Other contact laws, clearance in the joints, unequal links: these change the composition of a step's columns.
#[test]
fn hits_of_other_drives_are_those_of_a_scan_too() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let (name, text) = BUNDLED[0];
    let law = text.find("[contact.sprocket.hunt_crossley]").expect("there");
    let after = law + text[law..].find("[contact.guide]").expect("there");
    let hertz = "[contact.sprocket.hertz_line]\nbody_youngs_modulus_gpa = 206\nchain_youngs_modulus_gpa = 206\nlength_mm = 5\n\
                 damping_n_s_per_m = 200\n\n";
    let hertz = format!("{}{hertz}{}", &text[..law], &text[after..]);
    let odd =
        ["effects.pitch_error.long.link=7", "effects.pitch_error.long.length_um=20", "chain.joint.clearance_um=2"];
    let guides =
        ["effects.guide_friction.slack.friction=0.3", "effects.guide_compliance.tight.compliance_um_per_kn=300"];
    let tight = ["chain.joint.friction=0", "effects.tight_joint.a.joint=5", "effects.tight_joint.a.torque_nm=0.02"];
    let tight =
        [&tight as &[&str], &["effects.tight_joint.b.joint=5", "effects.tight_joint.b.torque_nm=0.02"]].concat();
    let smart = ("smartchain-20-40", BUNDLED[2].1, &["effects.guide_friction.slack.friction=0.3"] as &[&str]);
    let bush =
        [(name, hertz.as_str(), &[] as &[&str]), (name, text, &odd), (name, text, &guides), (name, text, &tight)];
    for (name, text, overrides) in bush.into_iter().chain([smart]) {
        let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_string()).collect();
        let drive = Drive::parse(name, text, &overrides).unwrap_or_else(|e| panic!("{e}"));
        let header = record_drive(&drive, &path, 150, 1);
        let expressions = [
            "energy.error_j > 1e-6 J or energy.elastic > 0.21 J",
            "energy.lost > 0.1 mJ and energy.kinetic > 1 J",
            "contact.normal_force > 300 N",
            "abs(contact.tangential_force) > 12 N",
            "contact.body == 'slack' and abs(contact.tangential_force) > 0.5 N",
            "contact.body == 'slack' and contact.normal_force > 3 N",
            "contact.body == 'tight' and contact.normal_force > 3 N",
            "contact.stick == 1 and contact.segment == 'seat'",
            "contact.segment == 'clockwise flank'",
            "sprocket.driver.chain_torque < -10 Nm",
            "joint.force > 550 N",
            "link.tension < 200 N",
            "link.tension <= 0 N",
        ];
        hits_are_those_of_a_scan(&path, &mcap::read(&path).expect("readable"), &header, &expressions);
    }
}

/// Runs the recorded drive with a breakpoint, without recording.
fn hits(path: &Path, breakpoint: Breakpoint, most: Option<usize>) -> Vec<(u64, pitchline::breakpoint::Subject)> {
    let mut replay = Replay::open(path).expect("opens");
    let last = replay.reader.heads().expect("heads").last().expect("frames").step;
    let visit = replay.visit(0, |_, _| ()).expect("starts");
    let (mut state, mut scratch) = (visit.state, visit.scratch);
    let watch = BreakWatch::new(breakpoint, &replay.model);
    let header = replay.header().clone();
    let job = Job {
        header: &header,
        span: RunLength { steps: last, steps_per_frame: last },
        breaks: Some(Breaks { watches: vec![watch], hits: most, around: None }),
        impacts: ImpactWatch::new(&replay.model),
        camera: replay.camera(),
    };
    let stop = AtomicBool::new(false);
    let summary = run_job(&replay.model, &mut state, &mut scratch, job, &mut [], &stop, |_| ()).expect("runs");
    summary.hits.iter().map(|h| (h.step, h.subject)).collect()
}

#[test]
fn expressions_that_make_no_sense_are_refused_with_a_caret() {
    let names = Names {
        bodies: vec!["sprockets.driver".into(), "guides.fixed.tight".into()],
        turning: vec![("sprockets.driver".into(), 0)],
        rows: vec![
            (Rows::Slider, vec!["sliders.plunger".into()]),
            (Rows::Touch, vec!["sliders.plunger.tip".into(), "passages.check.feed.seat".into()]),
        ],
        chains: vec![90],
    };
    for (text, wanted) in [
        ("contact.penetraton > 8 um", "did you mean `contact.penetration`"),
        ("contact.penetration > 8", "write its unit: nm, um, mm, m"),
        ("contact.penetration > 8 N", "is a length, and this is a force"),
        ("contact.penetration > 8 umm", "did you mean `"),
        ("contact.body == \"drivr\"", "did you mean \"driver\""),
        ("contact.body > \"driver\"", "names are equal"),
        ("link[90].tension < 0 N", "there is no link 90"),
        ("link[x].tension < 0 N", "write an index"),
        ("contact.tooth = 7", "equality is written `==`"),
        ("(contact.tooth == 7", "a bracket is not closed"),
        ("contact.tooth == 7 contact.link == 3", "go on with `and` or `or`"),
        ("3 N > 2 N", "this never changes"),
        ("penetration > 3 um", "did you mean"),
        ("sprocket.drivr.speed > 1 rpm", "did you mean `sprocket.driver`"),
        ("slider.plungr.speed > 1 m/s", "did you mean `slider.plunger`"),
        ("slider.plunger.speed > 1 rpm", "is a speed, and this is an angular speed"),
        ("touch.plunger.top.gap < 0 um", "did you mean `touch.plunger.tip`"),
        ("touch.plunger.gap < 0 um", "no touch is called `plunger.gap`"),
        ("ball.feed.position > 0 um", "this drive has no balls"),
        ("chamber.high.pressure > 3 bar", "this drive has no chambers"),
        ("contact", "needs a quantity"),
        ("", "is expected here"),
        ("contact.tooth == 'seven", "does not end"),
        ("contact.tooth == 1e999", "no number"),
        ("contact.normal_force > 1 N and impact.approach_speed > 1 m/s", "not about both"),
        ("\u{fc}\u{fc} > 3", "is expected here"),
    ] {
        let report = Breakpoint::parse(text, &names).expect_err(text).to_string();
        assert!(report.contains(wanted) && report.contains("--break:1:"), "{text}: {report}");
    }
    let deep = format!("{}contact.tooth == 1{}", "(".repeat(5000), ")".repeat(5000));
    assert!(Breakpoint::parse(&deep, &names).is_err());
    assert!(Breakpoint::parse(&"!".repeat(4000), &names).is_err());
}

/// Allowed remainder relative to the largest force. Measured 2.1e-14; more for other CPUs and links.
const REMAINDER: f64 = 1e-9;

#[test]
fn forces_on_a_link_add_up_to_its_acceleration() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut worst = 0.0_f64;
    // The three chain types closely, the others in fewer samples; on a long chain most links of a sample touch nothing.
    let samples_of = |bundled: usize| [800, 150, 60].get(bundled).copied().unwrap_or(40);
    for (bundled, samples) in (0..BUNDLED.len()).map(|bundled| (bundled, samples_of(bundled))) {
        let path = folder.path().join("a.mcap");
        let header = record(bundled, &[], &path, STEPS[bundled], 2);
        let mut replay = Replay::open(&path).expect("opens");
        let mut random = Random(3);
        let mut contacts = 0;
        for _ in 0..samples {
            let (link, step) = (random.below(header.links.len() as u64) as usize, random.below(STEPS[bundled]));
            let body = explain(&mut replay, link, step).expect("explains");
            let worse = body.remainder_share.max(body.remainder_moment_share);
            assert!(worse < REMAINDER, "{} link {link} step {step}: {worse:e}", BUNDLED[bundled].0);
            worst = worst.max(worse);
            contacts += body.contacts.len();
            for a in body.contacts.iter().filter_map(|c| c.approach.as_ref()) {
                let sum: f64 = a.parts.iter().map(|p| p.speed_m_s).sum();
                assert!((sum - a.closing_speed_m_s).abs() < 1e-12);
            }
        }
        assert!(contacts > if bundled < 3 { samples / 5 } else { 0 }, "{contacts} contacts in {samples} samples");
    }
    println!("largest remainder {worst:.1e} of the largest force");
}

/// Silent links, abutments and bushes among several chains: replayed to the bit, found by expressions, explained.
#[test]
fn chains_of_several_types_are_reproduced_and_explained() {
    let folder = tempfile::tempdir().expect("a folder");
    for (first, second, feature) in
        [("silent-20-40", "bush-20-40", "trailing flank"), ("bush-20-40", "smartchain-20-40", "front abutment")]
    {
        let path = folder.path().join("a.mcap");
        let drive = Drive::parse("two.toml", &common::two_stages(first, second), &[]).unwrap_or_else(|e| panic!("{e}"));
        let header = record_drive(&drive, &path, 600, 1);
        let stop = AtomicBool::new(false);
        let verdict = verify(&mut Replay::open(&path).expect("opens"), &stop, |_| ()).expect("runs").expect("ends");
        assert_eq!((verdict.mismatches, verdict.assembled), (0, true), "{:?}", verdict.first);
        let recording = mcap::read(&path).expect("readable");
        let own = [
            format!("contact.feature == '{feature}' and contact.normal_force > 20 N"),
            "contact.feature == 'front bush' and contact.normal_force > 100 N".to_string(),
            "energy.error_j > 0.001 J or link.tension > 550 N".to_string(),
        ];
        hits_are_those_of_a_scan(&path, &recording, &header, &own.each_ref().map(String::as_str));
        let mut replay = Replay::open(&path).expect("opens");
        let mut random = Random(11);
        let (mut worst, mut parts) = (0.0_f64, [0; 2]);
        for _ in 0..80 {
            let (link, step) = (random.below(header.links.len() as u64) as usize, random.below(600));
            let body = explain(&mut replay, link, step).expect("explains");
            worst = worst.max(body.remainder_share.max(body.remainder_moment_share));
            parts[usize::from(link >= 90)] += body.contacts.len();
        }
        println!("{first}, {second}: largest remainder {worst:.1e}, contacts explained {parts:?}");
        // measured 2e-14
        assert!(worst < REMAINDER, "{worst:e}");
        assert!(parts.iter().all(|n| *n > 5), "{parts:?}");
    }
}

/// Allowed difference between the sum of the parts and the speed stored in the contact memory [m/s]. Measured 2.4e-14.
const SPEED_OFF_M_S: f64 = 1e-12;

/// A roller that arrives is explained as a bush is, on every link: 88 links fill their blocks, and no lane stands behind the last roller.
#[test]
fn approach_speeds_of_rollers_are_explained_by_their_parts() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let roller = BUNDLED.iter().position(|(name, _)| *name == "roller-20-40").expect("bundled");
    record(roller, &["chain.bush.links=88", "sprockets.driven.x_mm=230.6"], &path, 51_000, 50);
    let mut replay = Replay::open(&path).expect("opens");
    let impacts = mcap::read(&path).expect("readable").impacts;
    let (mut seen, mut links) = (0, std::collections::BTreeSet::new());
    for impact in impacts.iter().filter(|i| i.body == 0) {
        let body = explain(&mut replay, impact.link as usize, impact.step + 3).expect("explains");
        let Some(contact) = body.contacts.iter().find(|c| c.tooth == Some(impact.tooth)) else { continue };
        let Some(approach) = &contact.approach else { continue };
        links.insert(impact.link);
        // Articulation leads, as with bushes; a roller hangs in its play beside that.
        assert!(approach.parts[0].speed_m_s > 1.0, "{impact:?} {approach:?}");
        let sum: f64 = approach.parts.iter().map(|p| p.speed_m_s).sum();
        assert!((sum - approach.closing_speed_m_s).abs() < SPEED_OFF_M_S, "{approach:?}");
        seen += 1;
    }
    println!("{seen} impacts of {} links", links.len());
    assert!(seen > 20 && links.iter().any(|l| *l < 2), "{seen} {links:?}");
}

#[test]
fn approach_speed_is_explained_by_its_parts() {
    // At contact the parts add up to the closing speed stored in the contact memory.
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    record(0, &[], &path, 4500, 10);
    let mut replay = Replay::open(&path).expect("opens");
    let impacts = mcap::read(&path).expect("readable").impacts;
    let (mut seen, mut worst) = (0, 0.0_f64);
    for impact in impacts.iter().filter(|i| i.body == 0) {
        let body = explain(&mut replay, impact.link as usize, impact.step + 3).expect("explains");
        let contact = body.contacts.iter().find(|c| c.tooth == Some(impact.tooth)).expect("still touching");
        let approach = contact.approach.as_ref().expect("its first touch was seen");
        let off = (approach.closing_speed_m_s - impact.approach_speed_m_s).abs();
        worst = worst.max(off);
        assert!(off < SPEED_OFF_M_S, "{approach:?}");
        assert!(approach.parts[0].speed_m_s > 1.0, "articulation leads: {approach:?}");
        seen += 1;
    }
    println!("{seen} impacts, at most {worst:.1e} m/s between the parts and the approach speed");
    assert!(seen > 5, "{seen} impacts");
    // Flanks of a silent chain, abutments on rings and guides.
    for drive in [1, 2] {
        record(drive, &[], &path, 6000, 20);
        let mut replay = Replay::open(&path).expect("opens");
        let impacts = mcap::read(&path).expect("readable").impacts;
        let (mut seen, mut on_guides, mut worst) = (0, 0, 0.0_f64);
        for impact in impacts.iter().step_by(6) {
            let body = explain(&mut replay, impact.link as usize, impact.step + 3).expect("explains");
            let Some(approach) = body.contacts.iter().find_map(|c| {
                let approach = c.approach.as_ref()?;
                ((approach.closing_speed_m_s - impact.approach_speed_m_s).abs() < 1e-3).then_some(approach)
            }) else {
                continue;
            };
            let sum: f64 = approach.parts.iter().map(|p| p.speed_m_s).sum();
            worst = worst.max((sum - approach.closing_speed_m_s).abs());
            let on_rotor = approach.parts[0].cause.starts_with("articulation");
            let on_bush = [Feature::FrontBush as u32, Feature::RearBush as u32].contains(&impact.feature);
            // One of them is the speed gained until contact.
            let parts = if on_bush {
                5
            } else if on_rotor {
                4
            } else {
                3
            };
            assert_eq!(approach.parts.len(), parts, "{approach:?}");
            // The speeds come from millimetres on a turning sprocket, not from metres per second of travel.
            assert!(approach.parts.iter().all(|p| p.speed_m_s.abs() < 3.0), "{approach:?}");
            (seen, on_guides) = (seen + 1, on_guides + usize::from(!on_rotor));
        }
        println!(
            "{}: {seen} of {} impacts, {on_guides} of them on guides, {worst:.1e} m/s",
            BUNDLED[drive].0,
            impacts.len()
        );
        assert!(seen > 5 && worst < SPEED_OFF_M_S, "{seen} {worst}");
    }
}

#[test]
fn recordings_without_impacts_and_of_other_versions_say_what_to_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let mut header = record(0, &[], &path, 20, 10);
    header.format_version += 1;
    create(&path, &header, ViewOptions::default()).expect("opens").finish().expect("finishes");
    let error = Reader::open(&path).err().expect("refused").to_string();
    assert!(error.contains("use a newer one"), "{error}");
}

#[test]
fn committed_recordings_are_reproduced_to_the_bit() {
    for (name, _) in BUNDLED {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("recordings/samples/{name}.mcap"));
        let stop = AtomicBool::new(false);
        let verdict = verify(&mut Replay::open(&path).expect("opens"), &stop, |_| ()).expect("runs").expect("ends");
        // If this fails, the results of the drive have changed: record the samples again, and explain it in the
        // changelog.
        assert_eq!((verdict.mismatches, verdict.assembled), (0, true), "{name}: {:?}", verdict.first);
        println!("{name}: {} frames, {}", verdict.frames, verdict.state_hash);
    }
}
