//! `lap` on frames whose numbers over the way are known: the place itself, forces of spans that `audit` measures in another way, displacements
//! that are put in, and gaps that the recorded contacts state.

mod common;

use pitchline::analysis::audit::Topology;
use pitchline::analysis::audit::spans::spans_of;
use pitchline::analysis::lap::{Lap, LapError, LapRecorder, LapZone, PlaceStatistics};
use pitchline::assemble::compile;
use pitchline::model::Model;
use pitchline::recording::frame::{Frame, Header};
use pitchline::recording::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use pitchline::replay::drive_of;
use std::f64::consts::PI;
use std::path::Path;
use std::process::Command;

fn sample(name: &str) -> (Header, Vec<Frame>, Model) {
    recording(&Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("recordings/samples/{name}.mcap")))
}

/// A drive, recorded with these values.
fn recorded(drive: &str, duration: &str, set: &[&str]) -> (Header, Vec<Frame>, Model) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("it.mcap");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pitchline"));
    command.args(["run", drive, "--duration", duration, "--every", "50us", "-o"]).arg(&path);
    set.iter().for_each(|s| _ = command.args(["--set", s]));
    let out = command.output().expect("it starts");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    recording(&path)
}

fn recording(path: &Path) -> (Header, Vec<Frame>, Model) {
    let mut reader = Reader::open(path).expect("a sample");
    let header = reader.header().clone();
    let mut frames = Vec::new();
    let wanted = Wanted { frames: true, ..Wanted::default() };
    let taken = reader.each(wanted, WHOLE, |entry| {
        if let Entry::Frame(frame) = entry {
            frames.push(frame.clone());
        }
        Ok(Flow::On)
    });
    taken.expect("frames");
    let model = compile(&drive_of(path, &header, &[]).expect("its drive")).expect("it compiles").model;
    (header, frames, model)
}

fn lap(quantity: &str, (header, frames, model): (&Header, &[Frame], &Model), link: Option<usize>) -> Lap {
    let mut recorder = LapRecorder::new(quantity, header, 0, link, Some(model)).expect("it is known");
    frames.iter().for_each(|f| recorder.add(f, header));
    recorder.finish(header).expect("enough frames")
}

fn zone<'a>(lap: &'a Lap, name: &str) -> &'a LapZone {
    lap.zones.iter().find(|z| z.name == name).unwrap_or_else(|| panic!("no {name}"))
}

#[test]
fn a_chain_goes_round_its_zones_in_order_and_spans_have_the_tension_that_audit_measures() {
    let (header, frames, model) = sample("bush-20-40");
    let lap = lap("joint.force", (&header, &frames, &model), None);
    let names: Vec<&str> = lap.zones.iter().map(|z| z.name.as_str()).collect();
    let (there, over) = ("driver to driven", "driver to driven, over guides.fixed.slack");
    assert_eq!(names, ["on driver", there, over, there, "on driven", "driven to driver"]);
    // Wheels make the way through the centres shorter than 90 pitches by 0.9 mm, the forces of the spans make it longer by about as much.
    assert!((lap.length_m / (90.0 * 8e-3) - 1.0).abs() < 1e-3, "{}", lap.length_m);
    // 8 mm times 20 teeth times 50 turns a second.
    let expected = 8.0 * (frames[frames.len() - 1].t_s - frames[0].t_s) / lap.length_m;
    assert!((lap.laps / expected - 1.0).abs() < 3e-3, "{} for {expected}", lap.laps);
    // By audit: links between those that touch a sprocket, without the two at its ends.
    for (span, tension) in [("driver to driven", 163.4), ("driven to driver", 558.7)] {
        let own = lap.zones.iter().filter(|z| z.name.starts_with(span)).map(|z| &z.statistics);
        let (sum, n) = own.fold((0.0, 0), |(sum, n), s| (sum + s.mean * s.samples as f64, n + s.samples));
        let mean = sum / n as f64;
        assert!((mean / tension - 1.0).abs() < 0.01, "{mean} for {tension}");
    }
    let samples: usize = lap.places.iter().map(|p| p.samples).sum();
    assert_eq!(samples, 90 * frames.len());
}

#[test]
fn the_abscissa_over_the_way_is_that_of_the_way() {
    let (header, frames, model) = sample("bush-20-40");
    let lap = lap("links.x_m", (&header, &frames, &model), Some(7));
    // The centre of the driver is at 0: the chain runs on and off it on both sides of its wheel, and the driven wheel is far from it.
    let driven = header.bodies.iter().find(|b| b.path.ends_with("driven")).expect("it is there");
    let on = &zone(&lap, "on driven").statistics;
    assert!((on.highest - driven.x_m).abs() < 0.06 && on.lowest > 0.5 * driven.x_m, "{on:?}");
    for p in lap.places.iter().filter(|p| p.samples > 0) {
        assert!(p.highest - p.lowest <= 1.01 * (p.to_m - p.from_m), "{p:?}");
    }
    // One link's own way is the same curve.
    assert_eq!(lap.points.len(), frames.len());
    for point in &lap.points {
        let p = lap.places.iter().find(|p| (p.from_m..=p.to_m).contains(&point.place_m)).expect("a place");
        assert!(p.lowest <= point.value && point.value <= p.highest);
    }
}

#[test]
fn a_wave_across_a_span_is_lateral() {
    let (header, mut frames, model) = sample("bush-20-40");
    let before = lap("lateral", (&header, &frames, &model), None);
    // In turn up and down, by 1 mm across the spans, which are nearly straight.
    for (k, f) in frames.iter_mut().enumerate().skip(1) {
        let sign = if k % 2 == 0 { 1e-3 } else { -1e-3 };
        f.links.y_m.iter_mut().for_each(|y| *y += sign);
    }
    let after = lap("lateral", (&header, &frames, &model), None);
    for name in ["driver to driven", "driven to driver"] {
        let own = |z: &&LapZone| z.name.starts_with(name);
        let s = before.zones.iter().find(own).map(|z| z.statistics).expect("a span");
        let end = before.zones.iter().rev().find(own).map(|z| z.statistics.to_m).expect("a span");
        let s = PlaceStatistics { to_m: end, ..s };
        assert!(s.scatter < 1e-4, "{s:?}");
        let (from, to) = (s.from_m + 0.02, s.to_m - 0.02);
        let inner: Vec<_> = after.places.iter().filter(|p| p.from_m > from && p.to_m < to && p.samples > 4).collect();
        assert!(inner.len() > 40, "{}", inner.len());
        // The spans of 20 and 40 teeth lean by 0.107 rad: cos is 0.994. The chain's own waves are below 0.1 mm.
        for p in inner {
            assert!((p.highest - p.lowest - 2e-3 * 0.994).abs() < 2e-4, "{p:?}");
        }
    }
}

#[test]
fn gaps_of_plates_are_those_of_recorded_contacts() {
    let (header, frames, model) = sample("gasoline-3cyl-bush");
    let found = lap("gap", (&header, &frames, &model), None);
    let zone = |name: &str| found.zones.iter().find(|z| z.name.ends_with(name)).map(|z| z.statistics.mean);
    assert!(zone("guides.rail.slack").is_some_and(|g| g.abs() < 3e-6) && zone("guides.rail.tight").is_some());
    // The deepest contact of each link with a rail, in each frame, against the least gap of that link there.
    let mut compared = 0;
    for f in &frames {
        let one = [f.clone(), f.clone()];
        for link in (0..header.links.len()).step_by(9) {
            let c = &f.contacts;
            let on_rail = |row: &usize| {
                c.link[*row] as usize == link && header.bodies[c.body[*row] as usize].path.starts_with("guides.rail")
            };
            let deepest = (0..c.link.len()).filter(on_rail).map(|row| c.penetration_m[row]).reduce(f64::max);
            let Some(depth_m) = deepest else { continue };
            let own = lap("gap", (&header, &one, &model), Some(link));
            let gap_m = own.points[0].value;
            assert!((gap_m + depth_m).abs() < 2e-9, "link {link} at {}: {gap_m:e} for {:e}", f.t_s, -depth_m);
            compared += 1;
        }
    }
    assert!(compared > 40, "{compared}");
}

/// Where the mean passes a value on a zone, between the middles of two places [m].
fn crossing_m(lap: &Lap, zone: &LapZone, value: f64) -> f64 {
    let s = &zone.statistics;
    let own: Vec<_> = lap.places.iter().filter(|p| p.from_m >= s.from_m && p.to_m <= s.to_m && p.samples > 0).collect();
    let pair = own.windows(2).find(|w| (w[0].mean - value) * (w[1].mean - value) <= 0.0).expect("it passes");
    let [a, b] = [0, 1].map(|k| (0.5 * (pair[k].from_m + pair[k].to_m), pair[k].mean));
    a.0 + (b.0 - a.0) * (value - a.1) / (b.1 - a.1)
}

/// Turned backwards, a drive that is its own mirror image has the same forces at the same places of the way: joints stand at joints.
#[test]
fn a_chain_that_runs_backwards_has_the_same_lap() {
    let forth = recorded("bush-20-40", "10ms", &[]);
    let back = recorded("bush-20-40", "10ms", &["speeds.constant.driver.speed_rpm=-3000"]);
    let [forth, back] =
        [&forth, &back].map(|(header, frames, model)| lap("joint.force", (header, frames, model), None));
    assert!(forth.laps > 0.0 && (back.laps / forth.laps - 1.0).abs() < 1e-3);
    for name in ["on driver", "on driven"] {
        let [a, b] = [&forth, &back].map(|l| crossing_m(l, zone(l, name), 360.0));
        // Ways begin at whole places, of 2 mm; with joints at the centres of links these were 10 mm apart. Measured: 2.3 mm.
        assert!((a - b).abs() < 4e-3, "{name}: {a} and {b}");
    }
}

/// The second chain of a reduction goes the way of its own sprockets.
#[test]
fn every_chain_goes_its_own_way() {
    let (header, frames, _) = sample("reduction-20-40-20-40");
    for chain in 0..2 {
        let mut recorder = LapRecorder::new("link.speed", &header, chain, None, None).expect("known");
        frames.iter().for_each(|f| recorder.add(f, &header));
        let lap = recorder.finish(&header).expect("frames");
        assert!(lap.laps > 0.0 && lap.zones.len() >= 4, "{chain}: {}", lap.laps);
        let bodies: Vec<&str> = lap.zones.iter().filter_map(|z| z.name.strip_prefix("on ")).collect();
        for zone in &lap.zones {
            if let Some((from, to)) = zone.name.split(',').next().and_then(|n| n.split_once(" to ")) {
                assert!(bodies.contains(&from) && bodies.contains(&to) && from != to, "{}", zone.name);
            }
        }
    }
}

/// On a wheel links go round a circle: what is lateral there is what teeth and joints give way, some micrometres.
#[test]
fn a_circle_is_not_lateral() {
    let (header, mut frames, model) = sample("bush-20-40");
    let first = frames[0].clone();
    // The whole chain turns about the driver's axis, its links in a circle of a bush chain of 90 links.
    let (radius_m, step) = (8e-3 / (2.0 * (PI / 90.0).sin()), 2.0 * PI / 90.0);
    for (k, f) in frames.iter_mut().enumerate() {
        *f = Frame { t_s: f.t_s, ..first.clone() };
        for i in 0..90 {
            let angle = step * (i as f64 + 0.13 * k as f64);
            (f.links.x_m[i], f.links.y_m[i]) = (radius_m * angle.cos(), radius_m * angle.sin());
            f.links.angle_rad[i] = angle + 0.5 * PI;
            (f.links.vx_m_s[i], f.links.vy_m_s[i]) = (-angle.sin(), angle.cos());
        }
    }
    let found = lap("lateral", (&header, &frames, &model), None);
    assert!((found.length_m / (2.0 * PI * radius_m) - 1.0).abs() < 1e-5, "{}", found.length_m);
    for p in &found.places {
        assert!(p.samples == 0 || p.highest - p.lowest < 1e-6, "{p:?}");
    }
}

/// Zones and places hold the same samples.
#[test]
fn zones_are_sums_of_their_places() {
    for name in ["bush-20-40", "silent-20-40", "gasoline-3cyl-bush", "v12-primary", "smartchain-20-40"] {
        let (header, frames, model) = sample(name);
        let found = lap("contact_force", (&header, &frames, &model), None);
        let mut places = 0.0;
        for zone in &found.zones {
            let s = &zone.statistics;
            let inside = |p: &&PlaceStatistics| {
                let middle = 0.5 * (p.from_m + p.to_m);
                s.from_m < middle && middle < s.to_m
            };
            let own: Vec<_> = found.places.iter().filter(inside).filter(|p| p.samples > 0).collect();
            assert_eq!(own.iter().map(|p| p.samples).sum::<usize>(), s.samples, "{name}: {}", zone.name);
            let sum: f64 = own.iter().map(|p| p.samples as f64 * p.mean).sum();
            assert!((sum / s.samples as f64 - s.mean).abs() < 1e-9 * s.highest.max(1.0), "{name}: {}", zone.name);
            places += sum;
        }
        // All forces of all contacts.
        let forces = frames.iter().flat_map(|f| &f.contacts.normal_force_n).sum::<f64>();
        assert!((places / forces - 1.0).abs() < 1e-9, "{name}: {places} of {forces}");
    }
}

/// A straight guide, on a mount that gives way, with its relief arcs.
#[test]
fn gaps_of_a_straight_guide_are_those_of_recorded_contacts() {
    let sets = [
        "guides.fixed.slack.clearance_um=-1000",
        "effects.guide_compliance.slack.compliance_um_per_kn=2000",
        "effects.guide_compliance.slack.mass_g=20",
    ];
    let (header, frames, model) = recorded("bush-20-40", "3ms", &sets);
    let mut compared = 0;
    for f in &frames {
        let one = [f.clone(), f.clone()];
        let c = &f.contacts;
        for link in 0..90 {
            let on_guide = |row: &usize| {
                let path = &header.bodies[c.body[*row] as usize].path;
                c.link[*row] as usize == link && path == "guides.fixed.slack"
            };
            let deepest = (0..c.link.len()).filter(on_guide).map(|row| c.penetration_m[row]).reduce(f64::max);
            let Some(depth_m) = deepest else { continue };
            let gap_m = lap("gap", (&header, &one, &model), Some(link)).points[0].value;
            assert!((gap_m + depth_m).abs() < 2e-9, "link {link} at {}: {gap_m:e} for {:e}", f.t_s, -depth_m);
            compared += 1;
        }
    }
    assert!(compared >= 20, "{compared}");
}

#[test]
fn what_cannot_be_asked_is_refused_with_a_reason() {
    let (header, frames, model) = sample("bush-20-40");
    let why = |name: &str, model| match LapRecorder::new(name, &header, 0, None, model) {
        Err(LapError::Unknown(why)) => why,
        _ => panic!("{name} is known"),
    };
    assert!(why("sprocket.driver.speed", None).contains("joint.force"));
    assert!(why("joints.force", None).contains("no column"));
    let near = why("joint.forse", None);
    assert!(near.contains("`joint.forse`") && near.contains("`joint.force`"), "{near}");
    assert!(why("links.x_m[3]", None).contains("all links"));
    assert!(why("gap", None).contains("drive"));
    let mut recorder = LapRecorder::new("lateral", &header, 0, None, Some(&model)).expect("known");
    recorder.add(&frames[0], &header);
    assert_eq!(recorder.finish(&header), Err(LapError::Short { frames: 1 }));
    let abutments = sample("smartchain-20-40");
    let none = LapRecorder::new("gap", &abutments.0, 0, None, Some(&abutments.2));
    assert!(matches!(none, Err(LapError::Unknown(why)) if why.contains("no plates")));
}

#[test]
fn the_verb_prints_draws_and_refuses() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/samples/v12.mcap");
    let pitchline = |args: &[&str]| {
        let out = Command::new(env!("CARGO_BIN_EXE_pitchline")).arg("lap").args(args).output().expect("it starts");
        (out.status.code(), String::from_utf8_lossy(&[out.stdout, out.stderr].concat()).into_owned())
    };
    let (code, text) = pitchline(&[sample, "link.tension", "--chain", "1", "-o", &at("lap.svg"), "--link", "100"]);
    assert!(code == Some(0) && text.contains("over guides.rail.tight_right"), "{text}");
    let svg = std::fs::read_to_string(at("lap.svg")).expect("a picture");
    assert!(svg.contains("link 100") && svg.contains("time [ms]") && !svg.contains("NaN"));
    let (code, json) = pitchline(&[sample, "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert!(code == Some(0) && json["zones"][0]["name"].as_str().is_some_and(|n| n.starts_with("on ")));
    let (code, text) = pitchline(&[sample, "gap"]);
    assert!(code == Some(0) && text.contains("no gap to `slack`: it bends"), "{text}");
    let (code, csv) = pitchline(&[sample, "contact_force", "--csv"]);
    assert!(code == Some(0) && csv.lines().count() > 100 && !csv.contains("NaN") && !csv.contains("-0e0"));
    let (code, csv) = pitchline(&[sample, "--csv", "--link", "7", "--from", "1ms"]);
    assert!(code == Some(0) && csv.starts_with("t_s,place_m,value\n0.001") && csv.lines().count() > 9, "{csv}");
    let (_, text) = pitchline(&[sample, "--link", "7"]);
    assert!(text.contains("link 7: lowest ") && text.contains("note: the chain moved by 0.60 links"), "{text}");
    for (args, words) in [
        (vec![sample, "--chain", "7"], "chains 0 to 3"),
        (vec![sample, "--link", "100"], "has links 0 to"),
        (vec![sample, "-o", "lap.pdf"], ".svg or .png"),
        (vec![sample, "--from", "5ms"], "0 frames"),
        (vec![sample, "--from", "2ms", "--to", "1ms"], "later than --to"),
    ] {
        let (code, text) = pitchline(&args);
        assert!(code == Some(2) && text.contains(words), "{args:?}: {text}");
    }
}

/// Two chains, of which the second is made to run the other way: its spans alone change their ends.
#[test]
fn spans_have_the_ends_of_their_own_chain() {
    let folder = tempfile::tempdir().expect("a folder");
    let drive = folder.path().join("two.toml");
    std::fs::write(&drive, common::two_stages("bush-20-40", "bush-20-40")).expect("a drive");
    let (header, frames, _) = recorded(drive.to_str().expect("text"), "1ms", &[]);
    let topology = Topology::of(&header);
    let mut frame = frames.last().expect("a frame").clone();
    let before = spans_of(&frame, &header, &topology);
    let second = header.chains()[1].clone();
    for i in second.clone() {
        (frame.links.vx_m_s[i], frame.links.vy_m_s[i]) = (-frame.links.vx_m_s[i], -frame.links.vy_m_s[i]);
    }
    let after = spans_of(&frame, &header, &topology);
    assert_eq!(before.len(), 4);
    let name = |body: usize| header.bodies[body].path.as_str();
    for ((a, force), (b, same)) in before.iter().zip(&after) {
        let is_second = ["sprockets.pinion", "sprockets.output"].contains(&name(a.0));
        println!("{} to {}: {force:.1} N, then {} to {}", name(a.0), name(a.1), name(b.0), name(b.1));
        assert_eq!(force, same);
        assert_eq!(*b, if is_second { (a.1, a.0) } else { *a });
    }
}
