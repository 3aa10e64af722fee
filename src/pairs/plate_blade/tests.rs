//! Blades against closed forms of beams, and touches on them against a search that knows nothing.

use super::*;
use crate::elements::beam::Support;
use crate::elements::contact_law::ContactLaw;
use crate::geometry::guide::GuideSide;
use crate::geometry::rail::{Rail, Stretch};
use std::f64::consts::PI;

const LENGTH_M: f64 = 0.09;
const EI: f64 = 0.4618;
const MASS: f64 = 0.238;

fn body(radius_m: Option<f64>) -> RailBody {
    let stretches = [Stretch { length_m: 0.04, radius_m }, Stretch { length_m: LENGTH_M - 0.04, radius_m }];
    let rail = Rail::new(GuideSide::Inside, Vec2::zeros(), 0.0, &stretches).expect("a rail");
    let law = ContactLaw::Linear { stiffness_n_per_m: 1e7, damping_n_s_per_m: 0.0 };
    RailBody::new(&rail, 3.5e-3, law, 0.0, 0.1)
}

fn beam(supports: Vec<(f64, Support)>, modes: usize) -> Beam {
    Beam { stiffness_n_m2: EI, mass_kg_per_m: MASS, free_curvatures_per_m: None, supports, damping_ratio: 0.0, modes }
}

/// Deflections at random: no point lies further outwards than the bound, and the bound is not far off.
#[test]
fn no_point_is_bent_further_outwards_than_the_bound() {
    let supports = vec![(0.0, Support::Pin), (LENGTH_M, Support::Pin)];
    let blade = Blade::new(&body(Some(0.1)), &beam(supports, 6)).expect("a blade");
    let mut random = crate::random::SplitMix::of(&[5]);
    let mut bent = Deflection::default();
    for _ in 0..200 {
        let q: Vec<f64> = blade.modes.iter().map(|_| 1e-3 * (random.uniform() - 0.5)).collect();
        blade.deflection(q.into_iter(), &mut bent);
        let at = |k: usize| bent.value_at(&blade.point(LENGTH_M * k as f64 / 1000.0));
        let most = (0..=1000).map(at).fold(0.0, f64::max);
        let bound = blade.most_outward_m(&bent);
        assert!(most <= bound && bound < most + 2e-4, "{most} {bound}");
    }
}

/// The point that touches against a search that knows nothing, over places 2 um apart: edges and round ends of links on blades of three pieces, where
/// they are bent round, and drawn links lie on an arc. Between two places a search misses 2e-11 m of an edge and 1.4e-10 m of an end.
#[test]
fn the_point_that_touches_is_the_highest_and_the_nearest() {
    touches_are_those_of_a_search(&[(0.0105, Some(0.03)), (0.0911, Some(0.172)), (0.0105, Some(0.03))], 2e-3);
    touches_are_those_of_a_search(&[(0.05, Some(0.1)), (0.0121, None), (0.05, Some(0.1))], 5e-3);
}

fn touches_are_those_of_a_search(stretches: &[(f64, Option<f64>)], most_m: f64) {
    let stretches = stretches.iter().map(|(length_m, radius_m)| Stretch { length_m: *length_m, radius_m: *radius_m });
    let rail = Rail::new(GuideSide::Inside, Vec2::zeros(), 0.4, &stretches.collect::<Vec<_>>()).expect("a rail");
    let law = ContactLaw::Linear { stiffness_n_per_m: 1e7, damping_n_s_per_m: 0.0 };
    let body = RailBody::new(&rail, 3.5e-3, law, 0.0, 0.1);
    let supports = vec![(0.0105, Support::Pin), (0.1016, Support::Pin)];
    let blade = Blade::new(&body, &beam(supports, 5)).expect("a blade");
    let lever_m = 4.76e-3;
    let mut random = crate::random::SplitMix::of(&[9]);
    let mut bent = Deflection::default();
    let (mut flat, mut round, mut worst) = (0, 0, 0.0_f64);
    for _ in 0..20 {
        let most = [most_m, 8e-4, 3e-4, 1e-4, 5e-5];
        let q: Vec<f64> = most.iter().map(|most| most * (2.0 * random.uniform() - 1.0)).collect();
        blade.deflection(q.into_iter(), &mut bent);
        let places = (0..=56_000).map(|k| 2e-6 * f64::from(k));
        let contour: Vec<Vec2> = places
            .map(|s| {
                let (drawn, point) = (blade.drawn_at(&body, s), blade.point(s));
                drawn.at + drawn.normal * bent.value_at(&point)
            })
            .collect();
        let is_round = |k: usize| {
            let s = 2e-6 * k as f64;
            let p = blade.bent_at(&bent, blade.drawn_at(&body, s), blade.beam_element(s));
            -p.second.dot(&p.drawn.normal) > 2.0
        };
        for _ in 0..12 {
            // A link whose middle lies over the bent contour, tilted by up to 2.6 degrees.
            let k = 9_000 + (38_000.0 * random.uniform()) as usize;
            if !(k - 6_000..k + 6_000).step_by(100).all(is_round) {
                continue;
            }
            let (from, to) = (contour[k - 100], contour[k + 100]);
            let heading = crate::units::atan2(to.y - from.y, to.x - from.x) + 0.09 * (random.uniform() - 0.5);
            let along = crate::geometry::unit(heading);
            let own = blade.drawn_at(&body, 2e-6 * k as f64).normal;
            let centre = contour[k] + own * (3.5e-3 - 2e-5);
            let Some(drawn) = body.touch_bent(PlatePart::Edge, (centre, along), lever_m, 4e-3) else { continue };
            if !matches!(body.pieces[drawn.piece], Piece::Arc { radius_m, .. } if radius_m > 0.0) {
                continue;
            }
            let (touch, _, _) = blade.bent_touch(&body, &bent, (centre, along, lever_m), drawn);
            let normal = if perp(along).dot(&own) < 0.0 { -perp(along) } else { perp(along) };
            let contour = &contour[k - 6_000..k + 6_000];
            let highest = contour.iter().max_by(|a, b| a.dot(&normal).total_cmp(&b.dot(&normal))).expect("one");
            let lies_m = (highest - centre).dot(&along);
            let expected = if lies_m.abs() <= lever_m {
                flat += 1;
                body.plate_radius_m - (centre - highest).dot(&normal)
            } else {
                round += 1;
                let joint = centre + along * lever_m.copysign(lies_m);
                let nearest = contour.iter().map(|p| (joint - p).norm()).fold(f64::INFINITY, f64::min);
                body.plate_radius_m - nearest
            };
            worst = worst.max((touch.penetration_m - expected).abs());
        }
    }
    println!("{flat} edges, {round} ends: depths off by {worst:.1e} m");
    assert!(flat > 40 && round > 10 && worst < 2e-10, "{flat} {round} {worst:e}");
}

fn frequencies(blade: &Blade) -> Vec<f64> {
    let of = |m: &BladeMode| (m.stiffness_n_per_m / m.mass_kg).sqrt() / (2.0 * PI);
    blade.modes.iter().map(of).collect()
}

/// Deflection at `at` under a force at `at`: sum of phi^2 F / K.
fn deflection(blade: &Blade, at: f64, force: f64) -> f64 {
    let point = blade.point(at);
    let of = |k: usize| blade.value_of(k, &point).powi(2) * force / blade.modes[k].stiffness_n_per_m;
    (0..blade.modes.len()).map(of).sum()
}

/// F L^3 / 3 EI within 1 % by three modes, and 3.516 / (2 pi L^2) sqrt(EI/m).
#[test]
fn a_cantilever_bends_and_rings_as_the_closed_form_says() {
    let exact_m = 10.0 * LENGTH_M.powi(3) / (3.0 * EI);
    for (modes, bound) in [(1, 0.031), (3, 0.003), (8, 3e-4)] {
        let blade = Blade::new(&body(None), &beam(vec![(0.0, Support::Clamp)], modes)).expect("modes");
        let off = deflection(&blade, LENGTH_M, 10.0) / exact_m - 1.0;
        println!("{modes} modes: tip off by {off:.2e}");
        assert!(off.abs() < bound && off < 0.0, "{modes}: {off}");
        let roots: [f64; 3] = [1.875_104_068_7, 4.694_091_133, 7.854_757_438];
        for (f, root) in frequencies(&blade).iter().zip(roots) {
            let exact = (root / LENGTH_M).powi(2) * (EI / MASS).sqrt() / (2.0 * PI);
            assert!((f / exact - 1.0).abs() < 1e-5, "{f} {exact}");
        }
    }
}

/// Pins at both ends, a clamp at the other end, a spring in the middle.
#[test]
fn supports_hold_what_they_say() {
    let pinned = Blade::new(&body(None), &beam(vec![(0.0, Support::Pin), (LENGTH_M, Support::Pin)], 4)).expect("modes");
    for (k, f) in frequencies(&pinned).iter().enumerate() {
        let exact = PI * (k as f64 + 1.0).powi(2) / (2.0 * LENGTH_M.powi(2)) * (EI / MASS).sqrt();
        assert!((f / exact - 1.0).abs() < 1e-5, "{k}: {f} {exact}");
    }
    // A spring as stiff as the middle of the beam halves what a force there bends.
    let stiffness = 48.0 * EI / LENGTH_M.powi(3);
    let supports = vec![(0.0, Support::Pin), (LENGTH_M, Support::Pin), (0.5 * LENGTH_M, Support::Spring(stiffness))];
    let sprung = Blade::new(&body(None), &beam(supports, 8)).expect("modes");
    let off = deflection(&sprung, 0.5 * LENGTH_M, 10.0) / (10.0 / (2.0 * stiffness)) - 1.0;
    assert!(off.abs() < 5e-3, "{off}");
    // A support near a node, or near the end, is as one there.
    for eps in [1e-3, 1e-5, 1e-7] {
        let supports = vec![(eps * LENGTH_M, Support::Pin), ((1.0 - eps) * LENGTH_M, Support::Pin)];
        let near = Blade::new(&body(None), &beam(supports, 3)).expect("modes");
        for (f, exact) in frequencies(&near).iter().zip(frequencies(&pinned)) {
            assert!((f / exact - 1.0).abs() < 5.0 * eps + 1e-6, "{eps}: {f} {exact}");
        }
    }
    // Without supports a blade floats: two modes without stiffness.
    let floating = Blade::new(&body(None), &beam(Vec::new(), 3)).expect("modes");
    assert_eq!(floating.modes[1].stiffness_n_per_m, 0.0);
    assert!(floating.modes[2].stiffness_n_per_m > 0.0);
}

/// A pinned blade of free radius 130 mm, drawn with 190 mm, comes back by the sagittas' difference.
#[test]
fn a_blade_that_is_let_go_takes_its_free_shape() {
    let (drawn, free) = (0.19, 0.13);
    let supports = vec![(0.0, Support::Pin), (LENGTH_M, Support::Pin)];
    let beam = Beam { free_curvatures_per_m: Some(vec![1.0 / free; 2]), ..beam(supports, 7) };
    let blade = Blade::new(&body(Some(drawn)), &beam).expect("modes");
    let middle = blade.point(0.5 * LENGTH_M);
    let rises: f64 = (0..7).map(|k| blade.modes[k].free_m * blade.value_of(k, &middle)).sum();
    let exact = LENGTH_M * LENGTH_M / 8.0 * (1.0 / free - 1.0 / drawn);
    println!("rises by {:.4} mm, {:.4} mm by both curvatures", rises * 1e3, exact * 1e3);
    assert!((rises / exact - 1.0).abs() < 5e-3, "{rises} {exact}");
}

/// Normal, place and depth of a bent touch are the gradient of its depth: moving the link, turning it and bending the blade by small
/// amounts changes the depth by what they say.
#[test]
fn a_bent_touch_is_the_gradient_of_its_depth() {
    let mut worst = 0.0_f64;
    for radius_m in [None, Some(0.19), Some(-0.4)] {
        let body = body(radius_m);
        let supports = vec![(0.0, Support::Pin), (LENGTH_M, Support::Pin)];
        let blade = Blade::new(&body, &beam(supports, 4)).expect("modes");
        let at_rest = [4e-4, -2e-4, 1e-4, 5e-5];
        for step in 0..12 {
            let (x, turn) = (0.01 + 0.006 * f64::from(step), 0.02 - 0.004 * f64::from(step));
            let r = radius_m.unwrap_or(f64::INFINITY);
            let (height, lies) = if r.is_finite() { (x * x / (2.0 * r), x / r) } else { (0.0, 0.0) };
            for part in PlatePart::ALL {
                let depth = |dx: f64, dy: f64, dturn: f64, q: [f64; 4]| {
                    let centre = Vec2::new(x + dx, -(3.5e-3 - 2e-5) + height + dy);
                    let along = crate::geometry::unit(lies + turn + dturn);
                    let touch = body.touch(part, centre, along, 4e-3)?;
                    let mut bent = Deflection::default();
                    blade.deflection(q.into_iter(), &mut bent);
                    Some((blade.bent_touch(&body, &bent, (centre, along, 4e-3), touch), along))
                };
                let Some(((touch, point, own), along)) = depth(0.0, 0.0, 0.0, at_rest) else { continue };
                let by = |dx: f64, dy: f64, dturn: f64, dq: f64| {
                    let mut q = at_rest;
                    q[1] += dq;
                    depth(dx, dy, dturn, q).map(|((t, _, _), _)| (t.penetration_m, t.piece))
                };
                let slope = |e: f64, d: [f64; 4]| -> Option<f64> {
                    let (a, b) =
                        (by(e * d[0], e * d[1], e * d[2], e * d[3])?, by(-e * d[0], -e * d[1], -e * d[2], -e * d[3])?);
                    (a.1 == b.1).then_some((a.0 - b.0) / (2.0 * e))
                };
                let arm = along * touch.along_m;
                let expected = [
                    -touch.normal.x,
                    -touch.normal.y,
                    -cross(arm, touch.normal),
                    blade.value_of(1, &point) * own.dot(&touch.normal),
                ];
                for (k, (expected, e)) in expected.into_iter().zip([1e-7, 1e-7, 1e-6, 1e-7]).enumerate() {
                    let mut d = [0.0; 4];
                    d[k] = 1.0;
                    let Some(found) = slope(e, d) else { continue };
                    let scale = if k == 2 { 4e-3 } else { 1.0 };
                    worst = worst.max((found - expected).abs() / scale);
                    assert!(
                        (found - expected).abs() < 1e-6 * scale,
                        "{radius_m:?} {part:?} {step} {k}: {found} {expected}"
                    );
                }
            }
        }
    }
    // measured 7e-9
    println!("gradients off by {worst:.1e}");
}
