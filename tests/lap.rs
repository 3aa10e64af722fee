//! `lap` on frames whose numbers over the way are known: the place itself, forces of spans that `audit` measures in another way, displacements
//! that are put in, and gaps that the recorded contacts state.

use pitchline::analysis::lap::{Lap, LapError, LapRecorder};
use pitchline::assemble::compile;
use pitchline::model::Model;
use pitchline::recording::frame::{Frame, Header};
use pitchline::recording::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use pitchline::replay::drive_of;
use std::path::Path;
use std::process::Command;

fn sample(name: &str) -> (Header, Vec<Frame>, Model) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("recordings/samples/{name}.mcap"));
    let mut reader = Reader::open(&path).expect("a sample");
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
    let model = compile(&drive_of(&path, &header, &[]).expect("its drive")).expect("it compiles").model;
    (header, frames, model)
}

fn lap(quantity: &str, (header, frames, model): (&Header, &[Frame], &Model), link: Option<usize>) -> Lap {
    let mut recorder = LapRecorder::new(quantity, header, 0, link, Some(model)).expect("it is known");
    frames.iter().for_each(|f| recorder.add(f, header));
    recorder.finish(header).expect("enough frames")
}

#[test]
fn a_chain_goes_round_its_zones_in_order_and_spans_have_the_tension_that_audit_measures() {
    let (header, frames, model) = sample("bush-20-40");
    let lap = lap("joint.force", (&header, &frames, &model), None);
    let names: Vec<&str> = lap.zones.iter().map(|z| z.name.as_str()).collect();
    assert_eq!(names, ["on driver", "driver to driven", "on driven", "driven to driver"]);
    // The line through the centres of links is shorter than the chain of 90 pitches, where it bends round sprockets.
    assert!((0.998..1.0).contains(&(lap.length_m / (90.0 * 8e-3))), "{}", lap.length_m);
    // 8 mm times 20 teeth times 50 turns a second.
    let expected = 8.0 * (frames[frames.len() - 1].t_s - frames[0].t_s) / lap.length_m;
    assert!((lap.laps / expected - 1.0).abs() < 3e-3, "{} for {expected}", lap.laps);
    // By audit: links between those that touch a sprocket, without the two at its ends.
    for (zone, tension) in [(1, 163.4), (3, 558.7)] {
        let mean = lap.zones[zone].statistics.mean;
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
    let on = &lap.zones[2].statistics;
    assert!((on.highest - driven.x_m).abs() < 0.06 && on.lowest > 0.5 * driven.x_m, "{on:?}");
    for p in lap.places.iter().filter(|p| p.samples > 0) {
        assert!(p.highest - p.lowest <= 1.01 * (p.to_m - p.from_m), "{p:?}");
    }
    // One link's own way is the same curve.
    assert_eq!(lap.link.len(), frames.len());
    for (place_m, x_m) in &lap.link {
        let p = lap.places.iter().find(|p| (p.from_m..p.to_m).contains(place_m)).expect("a place");
        assert!(p.lowest <= *x_m && *x_m <= p.highest);
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
    for zone in [1, 3] {
        let s = &before.zones[zone].statistics;
        assert!(s.scatter < 1e-4, "{s:?}");
        let (from, to) = (s.from_m + 0.02, s.to_m - 0.02);
        let inner = after.places.iter().filter(|p| p.from_m > from && p.to_m < to && p.samples > 4);
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
            let gap_m = own.link[0].1;
            assert!((gap_m + depth_m).abs() < 2e-9, "link {link} at {}: {gap_m:e} for {:e}", f.t_s, -depth_m);
            compared += 1;
        }
    }
    assert!(compared > 40, "{compared}");
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
    assert!(why("joint.forse", None).contains("joint"));
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
    assert!(code == Some(0) && text.contains("not measured: `slack`: it bends"), "{text}");
    let (code, csv) = pitchline(&[sample, "contact_force", "--csv"]);
    assert!(code == Some(0) && csv.lines().count() > 100 && !csv.contains("NaN"));
    for (args, words) in [
        (vec![sample, "--chain", "7"], "chains 0 to 3"),
        (vec![sample, "--link", "100"], "has links 0 to"),
        (vec![sample, "-o", "lap.pdf"], ".svg or .png"),
    ] {
        let (code, text) = pitchline(&args);
        assert!(code == Some(2) && text.contains(words), "{args:?}: {text}");
    }
}
