//! Blades: rails that bend under the chain. Sources of truth: the deflection of a beam on two pins under the forces of the plates, and the ledger.

mod common;

use common::assembled;
use pitchline::assemble::{Assembly, at_rest};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::elements::contact_law::PairRadii;
use pitchline::geometry::Vec2;
use pitchline::integrate::Isa;
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::RailModel;
use pitchline::pairs::plate_rail::law_radius_m;
use pitchline::recording::capture::Camera;
use pitchline::statics::rail_touches;

const EI: f64 = 4.0;
const LENGTH_M: f64 = 0.13;

/// arm-20-40 with a blade on two pins in place of its arm.
fn parse(more: &str) -> Result<Drive, String> {
    let text = BUNDLED.iter().find(|(name, _)| *name == "arm-20-40").map(|(_, text)| *text).unwrap_or_default();
    let arm = text.find("[arms.tensioner]").expect("the arm");
    let rail = text.find("[guides.rail.slack]").expect("its rail");
    let mut text = format!("{}{}", &text[..arm], &text[rail..]).replace("arm = \"tensioner\"\n", "");
    text = text.replace("moves = \"tensioner\"", "tension_n = 300\nmoves = \"driven\"");
    let blade = format!(
        "[guides.rail.slack.bending]\nstiffness_n_m2 = {EI}\nmass_kg_per_m = 0.3\npins_mm = [0, 130]\nmodes = 6\n{more}"
    );
    Drive::parse("t.toml", &format!("{text}\n{blade}"), &[]).map_err(|report| report.to_string())
}

fn drive(more: &str) -> Drive {
    parse(more).unwrap_or_else(|e| panic!("{e}"))
}

/// Deflection at `x` of a beam on two pins under a force at `a`.
fn pinned_beam(force: f64, a: f64, x: f64) -> f64 {
    let (a, x) = if x > a { (LENGTH_M - a, LENGTH_M - x) } else { (a, x) };
    let b = LENGTH_M - a;
    force * b * x * (LENGTH_M * LENGTH_M - b * b - x * x) / (6.0 * EI * LENGTH_M)
}

/// At rest the middle of the blade stands back as a beam on two pins does under the plates' forces, from its free shape on.
#[test]
fn a_blade_at_rest_bends_as_a_beam_under_its_plates() {
    // Curvature 1/150 - 1/250 over the middle 100 mm of 130: a rise of k (L^2 - (L - 100 mm)^2) / 8, here that of a beam that is bent between.
    let curvature = 1.0 / 0.15 - 1.0 / 0.25;
    let bent_m = curvature * (0.05 * LENGTH_M / 2.0 - 0.05 * 0.05 / 2.0);
    for (more, free_rise_m) in [("", 0.0), ("free_radii_mm = [60, 150, 60]\n", bent_m)] {
        let (model, rest) = at_rest(&drive(more)).unwrap_or_else(|e| panic!("{e}"));
        let rail = &model.rails[0];
        let blade = rail.blade.as_ref().expect("a blade");
        let q = &rest.configuration.coordinates;
        let middle = blade.shape.point(0.5 * LENGTH_M);
        let risen: f64 = blade.modes().enumerate().map(|(k, i)| blade.shape.value_of(k, &middle) * q[i]).sum();
        // What the bending of its drawn shape alone would do.
        let free: f64 = (0..6).map(|k| blade.shape.value_of(k, &middle) * blade.shape.modes[k].free_m).sum();
        let (mut pressed, mut force) = (0.0, 0.0);
        for (_, _, t) in rail_touches(&model, &rest.configuration, rail) {
            let radii = PairRadii { bush_m: t.link_radius_m, body_m: law_radius_m(t.body_radius_m) };
            let own = rail.body.law.elastic(t.penetration_m, radii).force_n;
            let place = along_contour(rail, t.point);
            pressed += pinned_beam(own, place, 0.5 * LENGTH_M);
            force += own;
        }
        println!(
            "{more:?}: {force:.2} N press it back by {:.4} mm, its middle rises by {:.4} mm, free {:.4} mm",
            pressed * 1e3,
            risen * 1e3,
            free * 1e3
        );
        assert!(force > 10.0 && (risen - (free - pressed)).abs() < 0.01 * pressed, "{risen} {free} {pressed}");
        assert!((free - free_rise_m).abs() <= 0.01 * free_rise_m, "{free} {free_rise_m}");
    }
}

/// Place of a point along the contour of a rail: by the nearest of many points of its profile.
fn along_contour(rail: &RailModel, p: Vec2) -> f64 {
    let (mut at, mut best, mut place) = (0.0, f64::INFINITY, 0.0);
    for e in rail.rail.profile.elements() {
        for k in 0..=2000 {
            let share = f64::from(k) / 2000.0;
            let distance = (e.point(share) - p).norm();
            if distance < best {
                (best, place) = (distance, at + share * e.length_m());
            }
        }
        at += e.length_m();
    }
    place
}

/// The joules add up while a blade rings under the chain, and every vector unit gives the same bits.
#[test]
fn joules_add_up_and_bits_are_the_same_on_every_vector_unit() {
    let Assembly { model, state, .. } = assembled(&drive("damping_ratio = 0.02\n"));
    let mut hashes = Vec::new();
    for isa in Isa::available() {
        let mut state = state.clone();
        let (mut scratch, mut camera) = (Scratch::with_isa(&model, isa), Camera::default());
        let steps = (0.05 / model.step_s) as u64;
        let mut energy = None;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let first = model.rails[0].blade.as_ref().expect("a blade").first;
        for step in 0..=steps {
            explicit::evaluate(&model, &state, &mut scratch).unwrap_or_else(|e| panic!("{e}"));
            if step % 1000 == 0 || step == steps {
                energy = Some(camera.take(&model, &state, &scratch).energy);
            }
            explicit::advance(&model, &mut state, &mut scratch);
            (low, high) = (low.min(state.coordinates.angle[first]), high.max(state.coordinates.angle[first]));
        }
        let e = energy.expect("frames");
        println!(
            "{isa:?}: first mode {:.1} to {:.1} um, energy {:.1e}",
            low * 1e6,
            high * 1e6,
            e.error_j / e.work_in_j
        );
        assert!(e.error_j.abs() < 1e-4 * e.work_in_j, "{e:?}");
        assert!(high - low > 1e-6, "the blade stands still");
        hashes.push(state.hash());
    }
    assert!(hashes.windows(2).all(|h| h[0] == h[1]), "{hashes:x?}");
}

#[test]
fn mistakes_in_blades_are_found_where_they_stand() {
    let cases = [
        ("pins_mm = [0, 130]", "pins_mm = [65]", "nothing holds the blade"),
        ("pins_mm = [0, 130]", "pins_mm = [0, 150]", "a rail 130.000 mm long"),
        ("pins_mm = [0, 130]", "pins_mm = [60, 60.01]", "two supports stand at one place"),
        ("modes = 6", "modes = 6\nfree_radii_mm = [60, 1e-4, 60]", "not bent so much"),
        ("pins_mm = [0, 130]", "pins_mm = [0, 130]\nsprings_mm = [60]", "1 springs_mm, 0 springs_n_per_mm"),
        ("stiffness_n_m2 = 4\n", "", "stiffness_n_m2"),
        ("modes = 6", "modes = 60", "modes"),
    ];
    for (from, to, wanted) in cases {
        let text = drive("").text.replace(from, to);
        let told = match Drive::parse("t.toml", &text, &[]) {
            Ok(_) => panic!("accepted: {to}"),
            Err(report) => report.to_string(),
        };
        assert!(told.contains(wanted), "{wanted}: {told}");
    }
}
