//! The kernel that remembers what abutments faced, against the searches that know nothing.

use crate::{Random, abutment, smooth};
use pitchline::elements::arc_lanes::{Feet, FootLanes, Pair, PairLanes, SupportLanes, sure_arcs};
use pitchline::elements::tooth_contact::LANES;
use pitchline::geometry::Vec2;
use pitchline::geometry::smartchain::contour::Contour;
use pitchline::geometry::smartchain::ring::RingContact;
use pitchline::geometry::smartchain::{LobedRing, Side};

const POSES: usize = 100_000;

fn point(feet: &Feet, i: usize) -> (Vec2, Vec2) {
    (Vec2::new(feet.point_x[i], feet.point_y[i]), Vec2::new(feet.normal_x[i], feet.normal_y[i]))
}

/// Front and rear contours of abutments for three numbers of teeth.
fn for_each_contour(mut look: impl FnMut(&Contour, &mut Random)) {
    let mut random = Random(17);
    for teeth in [15, 20, 40] {
        let abutment = abutment(teeth);
        for side in [Side::Front, Side::Rear] {
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
            let strayed = lanes.strayed(&x, &y);
            for i in (0..LANES).filter(|i| strayed[*i] != 0) {
                lanes.search(i, contour, Vec2::new(x[i], y[i]));
                moved += 1;
            }
            assert_eq!(lanes.strayed(&x, &y), [0; LANES], "found where it is");
            let feet = lanes.feet(&x, &y);
            for i in 0..LANES {
                let foot = contour.closest_to_point(Vec2::new(x[i], y[i]));
                assert_eq!(feet.distance[i], foot.distance_m, "{foot:?}");
                assert_eq!(lanes.radius[i], foot.radius_m);
                if foot.radius_m != 0.0 {
                    assert_eq!(point(&feet, i), (foot.point, foot.normal));
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
            let strayed = lanes.strayed(&x, &y);
            for i in 0..LANES {
                if strayed[i] != 0 {
                    lanes.search(i, contour, Vec2::new(x[i], y[i]));
                } else {
                    kept += 1;
                }
            }
            let (px, py) = lanes.points(&x, &y);
            for i in 0..LANES {
                let support = contour.support(Vec2::new(x[i], y[i])).1;
                assert_eq!(Vec2::new(px[i], py[i]), support, "towards {} {}", x[i], y[i]);
            }
        }
    });
    assert!(kept > POSES / 20, "{kept}");
}

/// Poses of links that come in, hand over and wrap, off by micrometres and milliradians.
#[test]
fn contacts_with_lobes_are_those_of_the_search_whatever_was_faced_before() {
    let (mut kept, mut searched, mut alone, mut farthest_m) = (0, 0, 0, 0.0_f64);
    let mut random = Random(5);
    for (made_for, teeth) in [(20, 40), (20, 25), (15, 60)] {
        let abutment = abutment(made_for);
        let transition = smooth(teeth);
        let ring = LobedRing::new(&abutment, transition).expect("a ring");
        for side in [Side::Front, Side::Rear] {
            let contour = abutment.contour(side);
            let sure = sure_arcs(contour, &ring);
            let mut warm = PairLanes::default();
            for _ in 0..POSES / 6 {
                let tau = -0.3 + 2.6 * random.unit();
                let off = |random: &mut Random| 20e-6 * (random.unit() - 0.5);
                let axis = transition.link(tau).axis.position + Vec2::new(off(&mut random), off(&mut random));
                let at_front = ring.seat_turn_rad(tau) + 1e-3 * (random.unit() - 0.5);
                let turn = if side == Side::Front { at_front } else { at_front - transition.seat_angle_rad() };
                let turn = Vec2::new(libm::cos(turn), libm::sin(turn));
                let near = contour.closest_to_point(axis);
                if near.distance_m > ring.crest_radius_m + 20e-6 {
                    continue;
                }
                let lean = ring.lean(near.point - axis, turn);
                let of_lanes = |warm: &PairLanes| {
                    let (x, y) = ([axis.x; LANES], [axis.y; LANES]);
                    warm.contacts([&x, &y], [&[turn.x; LANES], &[turn.y; LANES]], &[lean; LANES])
                };
                // From nothing, and from every lane that remembers something else.
                let mut cold = PairLanes::default();
                let found = cold.search(0, (contour, &sure), &ring, axis, turn);
                let (feet, strayed) = of_lanes(&warm);
                for i in 0..LANES {
                    if strayed[i] != 0 {
                        searched += 1;
                    } else {
                        assert_eq!(found, Pair::Kept, "a pair that no search finds");
                        assert_eq!(feet.distance[i], of_lanes(&cold).0.distance[0], "another pair");
                        kept += 1;
                    }
                }
                let exact: Option<RingContact> = ring.contact(contour, axis, libm::atan2(turn.y, turn.x));
                match (found, exact) {
                    (Pair::Kept, Some(exact)) => {
                        let (_, normal) = point(&of_lanes(&cold).0, 0);
                        let off_m = (of_lanes(&cold).0.distance[0] - exact.gap_m).abs();
                        farthest_m = farthest_m.max(off_m);
                        assert!((normal - exact.normal).norm() < 1e-7, "{normal:?} {exact:?}");
                    }
                    (Pair::Alone(_), Some(_)) => alone += 1,
                    (Pair::Nothing, None) => {}
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
