//! Rings of second sprockets.

use super::*;

#[test]
fn lobes_of_the_second_ring() {
    let chain = abutment(20);
    let ring = LobedRing::new(&chain, smooth(40)).expect("a ring");
    // Independent computation: 46.4189 mm (the face of the guide) to 46.4905 mm, +3.497 to -0.325 deg, exact up to
    // 0.80.
    assert!((ring.valley_radius_m / MM - 46.41889).abs() < 5e-6);
    assert!((ring.valley_radius_m - (ring.transition.line_height_m - chain.guide_height_m)).abs() < 1e-15);
    assert!((ring.envelope_end_radius_m / MM - 46.4905).abs() < 5e-5);
    assert!(((ring.envelope_end_radius_m - ring.valley_radius_m) * 1e6 - 71.6).abs() < 0.05);
    assert!((ring.flank_start_rad / DEG - 3.497).abs() < 5e-4);
    assert!((ring.envelope_end_rad / DEG - 0.325).abs() < 5e-4);
    assert!((ring.exact_until - 0.80).abs() < 5e-3);
    assert!(((ring.envelope_end_radius_m - ring.crest_radius_m) * 1e6 - 15.15).abs() < 0.05, "what is relieved");
    assert!(ring.max_deviation_m < 20e-9); // measured 4.5e-9
    let profile = ring.profile().expect("closed");
    let corners = profile.kinks_rad().iter().filter(|k| k.abs() > 1e-6).count();
    assert_eq!(corners, 40, "one crest per tooth");
    let lowest = profile.polyline(1e-9).iter().map(|p| p.norm()).fold(f64::INFINITY, f64::min);
    assert!((lowest - ring.valley_radius_m).abs() < 1e-9);
    let plain = LobedRing::new(&chain, smooth(20)).expect("its own ring");
    assert!(plain.tooth.iter().all(|e| ((1.0 / e.curvature_per_m()) - chain.ring_radius_m).abs() < 1e-7));
    assert!(matches!(LobedRing::new(&abutment(40), smooth(20)), Err(RingError::FewerTeeth { .. })));
}

#[test]
fn lobed_ring_leads_the_links_on_their_exact_path() {
    for (made_for, teeth) in [(20, 40), (9, 10), (17, 60)] {
        let chain = abutment(made_for);
        let ring = LobedRing::new(&chain, smooth(teeth)).expect("a ring");
        let seat = ring.transition.seat_angle_rad();
        for k in -100..=300 {
            let tau = f64::from(k) * 0.01;
            let axis = ring.transition.link(tau).axis.position;
            let turn = ring.seat_turn_rad(tau);
            let gap = |side: AbutmentSide, lobe: f64| {
                ring.contact(chain.contour(side), axis, turn + lobe * seat).map(|c| c.gap_m)
            };
            for side in [AbutmentSide::Front, AbutmentSide::Rear] {
                for lobe in [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0] {
                    // Deviations of both contours add up; measured -7e-9.
                    assert!(
                        gap(side, lobe).is_none_or(|g| g > -10e-9),
                        "tau {tau} {side:?} {lobe}: {:?}",
                        gap(side, lobe)
                    );
                }
            }
            if tau < 0.0 {
                continue;
            }
            let front = gap(AbutmentSide::Front, 0.0).expect("over its lobe");
            if (0.0..=ring.exact_until - 0.01).contains(&tau) {
                assert!(front.abs() < 10e-9, "tau {tau}: {front:e}");
            }
            if (made_for, teeth, k) == (20, 40, 90) {
                assert!((front * 1e6 - 0.57).abs() < 0.01, "{front:e}");
            }
            if (made_for, teeth, k) == (20, 40, 250) {
                let rear = gap(AbutmentSide::Rear, -1.0).expect("over its lobe");
                assert!((front * 1e6 - 4.68).abs() < 0.01 && (rear - front).abs() < 1e-12, "{front:e} {rear:e}");
            }
        }
    }
}

#[test]
fn plain_ring_shows_what_the_lobes_are_for() {
    let chain = abutment(20);
    let t = smooth(40);
    let link = t.link(0.0);
    // The lowest radius is 63 um below the plain ring's: it lifts the link by this at the start of the hand-over.
    let gap = chain.front.closest_to_point(link.axis.position).distance_m - (t.pitch_radius_m - 4.5e-3);
    assert!((gap * 1e6 + 63.1).abs() < 0.1, "{gap:e}");
}

#[test]
fn the_quick_search_for_a_lobe_finds_what_looking_at_every_element_finds() {
    let spec = AbutmentSpec { distance_m: 4.5e-3, flat_m: None, end_angle_rad: None };
    let abutment = Abutment::new(Transition::smooth(20, 8e-3).expect("20"), spec).expect("abutments");
    let transition = Transition::smooth(40, 8e-3).expect("40");
    let ring = LobedRing::new(&abutment, transition).expect("a ring");
    let mut touching = 0;
    for k in 0..4000_u32 {
        // Approach, transition and wrap, displaced by a few micrometres and milliradians.
        let tau = -0.3 + 3.0 * f64::from(k) / 4000.0;
        let off = f64::from(k % 7) - 3.0;
        let axis = transition.link(tau).axis.position + Vec2::new(2e-6 * off, -1.5e-6 * f64::from(k % 5));
        let turn = ring.seat_turn_rad(tau) + 1e-4 * f64::from(k % 3);
        for (side, turn) in [(AbutmentSide::Front, turn), (AbutmentSide::Rear, turn - transition.seat_angle_rad())] {
            let contour = abutment.contour(side);
            let near = contour.closest_to_point(axis);
            if near.distance_m > ring.crest_radius_m + 20e-6 {
                continue;
            }
            let whole = ring.contact(contour, axis, turn);
            let quick = ring.contact_at(contour, axis, Vec2::new(turn.cos(), turn.sin()));
            let (Some(whole), Some(quick)) = (whole, quick) else {
                assert_eq!(whole.is_some(), quick.is_some(), "tau {tau}, {side:?}: {whole:?} {quick:?}");
                continue;
            };
            touching += 1;
            assert!((whole.gap_m - quick.gap_m).abs() < 1e-12, "tau {tau}, {side:?}: {whole:?} {quick:?}");
        }
    }
    assert!(touching > 2000, "{touching}");
}
