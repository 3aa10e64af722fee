//! Contacts of links' own contours in a run: the step, which uses its memory, is compared with the search without
//! memory.

mod common;

use common::assembled;
use pitchline::assemble::Assembly;
use pitchline::drive::{BUNDLED, Drive};
use pitchline::geometry::Vec2;
use pitchline::integrate::Isa;
use pitchline::integrate::explicit::{self, ContactGroup, Scratch};
use pitchline::pairs::contour_body::LinkPose;

/// Bundled drives, and one with chains of both kinds behind each other.
const CONTOURS: [&str; 4] = ["silent-20-40", "smartchain-20-40", "both", "silent, gaps beside their places"];

/// Gaps of silent sprockets beside their places.
const BESIDE: [&str; 6] = [
    "effects.sprocket_runout.driven.amplitude_um=50",
    "effects.tooth_pitch_error.driver.amplitude_um=20",
    "effects.tooth_pitch_error.driver.order=3",
    "effects.gap_error.driver.gap=7",
    "effects.gap_error.driver.outward_um=-30",
    "effects.sprocket_runout.driven.phase_deg=40",
];

fn bundled(name: &str) -> Assembly {
    let both = common::two_stages("silent-20-40", "smartchain-20-40");
    if name.starts_with("silent, ") {
        return assembled(&common::bundled("silent-20-40", &BESIDE));
    }
    let text = BUNDLED.iter().find(|b| b.0 == name).map_or(both.as_str(), |b| b.1);
    assembled(&Drive::parse(name, text, &[]).unwrap_or_else(|e| panic!("{e}")))
}

/// Every step of 20 ms.
#[test]
fn every_step_finds_the_contacts_of_the_search_no_more_and_no_less() {
    for name in CONTOURS {
        let a = bundled(name);
        let model = &a.model;
        let mut state = a.state.clone();
        let mut scratch = Scratch::new(model);
        let steps = (20e-3 / model.step_s) as u64;
        let (mut touches, mut farthest_m) = (0_u64, 0.0_f64);
        for _ in 0..steps {
            explicit::evaluate(model, &state, &mut scratch).expect("the run holds");
            for (k, body) in model.end_bodies.iter().enumerate() {
                let contour = model.contours[body.chain].as_ref().expect("a contour");
                let rotor =
                    body.frame.turn.map_or((1.0, 0.0), |r| (state.coordinates.cos[r], state.coordinates.sin[r]));
                for link in scratch.ends_near(model, k) {
                    for front in [true, false] {
                        let lever = model.chain.lever[link];
                        let pose = LinkPose {
                            centre: Vec2::new(state.links.x[link], state.links.y[link]) - body.frame.origin,
                            cos: state.links.cos[link],
                            sin: state.links.sin[link],
                            lever: if front { lever } else { -lever },
                            front,
                            row: model.row_of(link) - model.row_ranges[body.chain].start,
                        };
                        let touch = body.touch(contour, &pose, rotor, 0.0);
                        let searched = touch.map_or(0.0, |t| t.penetration_m);
                        // In hollows of lobes the search stops when it turns by less than 3e-7 rad, and arcs there have
                        // up to 3.4 m: measured 1.6e-15 m.
                        let hollow = touch.is_some_and(|t| t.body_radius_m < 0.0);
                        let bound_m = if hollow { 3e-15 } else { 1e-15 };
                        let part = ContactGroup::Contours(2 * body.set + usize::from(!front));
                        let found = scratch.touch(part, link).map_or(0.0, |(depth, _)| depth);
                        let off_m = (found - searched.max(0.0)).abs();
                        assert!(off_m < bound_m, "{name}, {}, link {link}: {found:e}, {searched:e}", body.name);
                        farthest_m = farthest_m.max(off_m);
                        touches += u64::from(found > 0.0);
                    }
                }
            }
            explicit::advance(model, &mut state, &mut scratch);
        }
        println!("{name}: {touches} contacts in {steps} steps, none off by more than {farthest_m:.1e} m");
        assert!(touches > 10 * steps);
    }
}

#[test]
fn what_was_faced_before_changes_no_bit() {
    for name in CONTOURS {
        let a = bundled(name);
        let hash = |isa: Isa, steps: u64, kept_for: u64, looks: u64| {
            let mut state = a.state.clone();
            let mut scratch = Scratch::with_isa(&a.model, isa);
            scratch.refresh_steps = looks;
            for step in 0..steps {
                if step % kept_for == kept_for - 1 {
                    scratch = Scratch::with_isa(&a.model, isa);
                    scratch.refresh_steps = looks;
                }
                explicit::step(&a.model, &mut state, &mut scratch).expect("the run holds");
            }
            state.hash()
        };
        let steps = 5_000;
        let reference = hash(Isa::Baseline, steps, u64::MAX, 64);
        for isa in Isa::available() {
            assert_eq!(hash(isa, steps, u64::MAX, 64), reference, "{name}, {isa:?}");
            assert_eq!(hash(isa, steps, 97, 7), reference, "{name}, {isa:?}, nothing kept after 97 steps");
        }
        let cold = hash(Isa::detect(), 300, 1, 1);
        assert_eq!(hash(Isa::detect(), 300, u64::MAX, 64), cold, "{name}, nothing kept at all");
    }
}

/// Variants of the contours and operating conditions, in addition to the bundled drives.
const FORMS: [(&str, &[&str]); 10] = [
    ("silent-20-40", &[]),
    ("silent-20-40", &BESIDE),
    ("silent-20-40", &["effects.sprocket_runout.driver.amplitude_um=500"]),
    ("silent-20-40", &["speeds.constant.driver.speed_rpm=10"]),
    ("silent-20-40", &["speeds.constant.driver.speed_rpm=6000", "chain.silent.inner.pin_pitch_mm=8.01"]),
    ("smartchain-20-40", &["speeds.constant.driver.speed_rpm=10"]),
    ("smartchain-20-40", &["speeds.constant.driver.speed_rpm=-3000"]),
    // Abutments pass the ends of these guides.
    (
        "smartchain-20-40",
        &["guides.fixed.tight.start_mm=40", "guides.fixed.tight.end_mm=40", "guides.fixed.slack.start_mm=30"],
    ),
    ("smartchain-20-40", &OVER_TWO_LINKS),
    ("smartchain-20-40", &HOLLOW),
];

const OVER_TWO_LINKS: [&str; 6] = [
    "chain.smartchain.handover=two_links",
    "sprockets.driven.teeth=20",
    "sprockets.driven.x_mm=240",
    "sprockets.driven.root_relief_um=30",
    "chain.smartchain.links=80",
    "loads.constant.driven.torque_nm=10",
];

const HOLLOW: [&str; 6] = [
    "chain.smartchain.inclination_deg=3.5",
    "sprockets.driven.teeth=20",
    "sprockets.driven.x_mm=240",
    "sprockets.driven.root_relief_um=30",
    "chain.smartchain.links=80",
    "loads.constant.driven.torque_nm=10",
];

/// If everything is evaluated in every step, no contact was skipped.
#[test]
fn blocks_that_are_skipped_touch_nothing() {
    let mut looked_at = 0;
    for (name, sets) in FORMS {
        let text = BUNDLED.iter().find(|b| b.0 == name).expect("a bundled drive").1;
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
        let Ok(drive) = Drive::parse(name, text, &sets) else { panic!("{name} {sets:?} is no drive") };
        let Ok(a) = pitchline::assemble::assemble(&drive) else {
            println!("{name} {sets:?} does not assemble");
            continue;
        };
        let run = |refresh_steps: u64| {
            let (mut state, mut scratch) = (a.state.clone(), Scratch::new(&a.model));
            scratch.refresh_steps = refresh_steps;
            scratch.count_pairs(&a.model);
            for _ in 0..6_000 {
                explicit::step(&a.model, &mut state, &mut scratch).unwrap_or_else(|e| panic!("{name} {sets:?}: {e}"));
            }
            let skipped: u64 = scratch.pair_counts(&a.model).iter().map(|pair| pair.counts.skipped).sum();
            (state.hash(), skipped)
        };
        let ((always, none), (seldom, some)) = (run(1), run(64));
        println!("{name} {sets:?}: {some} blocks skipped in 6000 steps");
        assert_eq!((always, none), (seldom, 0), "{name} {sets:?}");
        assert!(some > 6_000, "{name} {sets:?}: {some}");
        looked_at += 1;
    }
    assert!(looked_at >= 6, "{looked_at}");
}
