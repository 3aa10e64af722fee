//! The kernel with memory of the arcs that abutments faced, compared with the searches without memory.

use crate::{Random, abutment, smooth};
use pitchline::geometry::Vec2;
use pitchline::geometry::smartchain::contour::AbutmentContour;
use pitchline::geometry::smartchain::ring::RingContact;
use pitchline::geometry::smartchain::{AbutmentSide, LobedRing};
use pitchline::lanes::LANES;
use pitchline::pairs::arc_lanes::{
    FootLanes, FootPoint, PairLanes, PairSearchResult, SupportLanes, arcs_with_one_contact,
};

const POSES: usize = 100_000;

fn point(foot: &FootPoint) -> (Vec2, Vec2) {
    (Vec2::new(foot.point_x, foot.point_y), Vec2::new(foot.normal_x, foot.normal_y))
}

/// Front and rear contours of abutments for three numbers of teeth.
fn for_each_contour(mut look: impl FnMut(&AbutmentContour, &mut Random)) {
    let mut random = Random(17);
    for teeth in [15, 20, 40] {
        let abutment = abutment(teeth);
        for side in [AbutmentSide::Front, AbutmentSide::Rear] {
            look(abutment.contour(side), &mut random);
        }
    }
}

#[test]
fn feet_are_those_of_the_search_whatever_was_faced_before() {
    let mut moved = 0;
    for_each_contour(|contour, random| {
        let mut lanes = FootLanes::default();
        for _ in 0..POSES / 6 / LANES {
            let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                // Axes of sprockets, and points close to the contour, over and beyond its ends.
                let height = if i % 2 == 0 { 25e-3 + 50e-3 * random.unit() } else { 4e-3 + 3e-3 * random.unit() };
                (x[i], y[i]) = ((random.unit() - 0.5) * 0.3 * height, contour.start().y + height);
            }
            for i in 0..LANES {
                if !lanes.foot(i, x[i], y[i]).1 {
                    lanes.search(i, contour, Vec2::new(x[i], y[i]));
                    moved += 1;
                }
                let (kept, faced) = lanes.foot(i, x[i], y[i]);
                assert!(faced, "found where it is");
                let foot = contour.closest_to_point(Vec2::new(x[i], y[i]));
                assert_eq!(kept.distance, foot.distance_m, "{foot:?}");
                assert_eq!(lanes.radius[i], foot.radius_m);
                if foot.radius_m != 0.0 {
                    assert_eq!(point(&kept), (foot.point, foot.normal));
                }
            }
        }
    });
    assert!(moved > POSES / 4 && moved < POSES, "{moved} of {POSES}");
}

#[test]
fn supports_are_those_of_the_search_whatever_was_faced_before() {
    let mut kept = 0;
    for_each_contour(|contour, random| {
        let mut lanes = SupportLanes::default();
        for _ in 0..POSES / 6 / LANES {
            let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                let angle = (random.unit() - 0.5) * if i % 2 == 0 { 0.1 } else { 6.0 };
                (y[i], x[i]) = (libm::cos(angle), libm::sin(angle));
            }
            for i in 0..LANES {
                if lanes.point(i, x[i], y[i]).1 {
                    kept += 1;
                } else {
                    lanes.search(i, contour, Vec2::new(x[i], y[i]));
                }
                let (px, py) = lanes.point(i, x[i], y[i]).0;
                let support = contour.support(Vec2::new(x[i], y[i])).1;
                assert_eq!(Vec2::new(px, py), support, "towards {} {}", x[i], y[i]);
            }
        }
    });
    assert!(kept > POSES / 20, "{kept}");
}

/// Poses of links that arrive, hand over and wrap, displaced by micrometres and milliradians.
#[test]
fn contacts_with_lobes_are_those_of_the_search_whatever_was_faced_before() {
    let (mut kept, mut searched, mut alone, mut farthest_m) = (0, 0, 0, 0.0_f64);
    let mut random = Random(5);
    for (made_for, teeth) in [(20, 40), (20, 25), (15, 60)] {
        let abutment = abutment(made_for);
        let transition = smooth(teeth);
        let ring = LobedRing::new(&abutment, transition).expect("a ring");
        for side in [AbutmentSide::Front, AbutmentSide::Rear] {
            let contour = abutment.contour(side);
            let sure = arcs_with_one_contact(contour, &ring);
            let mut warm = PairLanes::default();
            for _ in 0..POSES / 6 {
                let tau = -0.3 + 2.6 * random.unit();
                let off = |random: &mut Random| 20e-6 * (random.unit() - 0.5);
                let axis = transition.link(tau).axis.position + Vec2::new(off(&mut random), off(&mut random));
                let at_front = ring.seat_turn_rad(tau) + 1e-3 * (random.unit() - 0.5);
                let turn = if side == AbutmentSide::Front { at_front } else { at_front - transition.seat_angle_rad() };
                let turn = Vec2::new(libm::cos(turn), libm::sin(turn));
                let near = contour.closest_to_point(axis);
                if near.distance_m > ring.crest_radius_m + 20e-6 {
                    continue;
                }
                let lean = ring.crest_offset_ratio(near.point - axis, turn);
                let of_lane = |lanes: &PairLanes, i| lanes.contact(i, (axis.x, axis.y), (turn.x, turn.y), lean);
                // Without memory, and with a wrong memory in every lane.
                let mut cold = PairLanes::default();
                let found = cold.search(0, (contour, &sure), &ring, axis, turn);
                for i in 0..LANES {
                    let (foot, holds) = of_lane(&warm, i);
                    if holds {
                        assert_eq!(found, PairSearchResult::Kept, "a pair that no search finds");
                        assert_eq!(foot.distance, of_lane(&cold, 0).0.distance, "another pair");
                        kept += 1;
                    } else {
                        searched += 1;
                    }
                }
                let exact: Option<RingContact> = ring.contact(contour, axis, libm::atan2(turn.y, turn.x));
                match (found, exact) {
                    (PairSearchResult::Kept, Some(exact)) => {
                        let kept = of_lane(&cold, 0).0;
                        let (_, normal) = point(&kept);
                        let off_m = (kept.distance - exact.gap_m).abs();
                        farthest_m = farthest_m.max(off_m);
                        assert!((normal - exact.normal).norm() < 1e-7, "{normal:?} {exact:?}");
                    }
                    (PairSearchResult::Alone(_), Some(_)) => alone += 1,
                    (PairSearchResult::Nothing, None) => {}
                    _ => panic!("{found:?} {exact:?}"),
                }
                let lane = (LANES as f64 * random.unit()) as usize;
                warm.search(lane, (contour, &sure), &ring, axis, turn);
            }
        }
    }
    println!("{kept} kept, {searched} searched, {alone} alone; {farthest_m:.1e} m from looking at all");
    assert!(kept > 5000 && searched > 5000);
    assert!(farthest_m < 2e-15, "{farthest_m:e} m");
}
