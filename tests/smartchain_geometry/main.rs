//! The geometry of abutment chains compared with an independent computation.
//!
//! `golden` tables: Python 3 program of double precision, 2 sigma^3 - sigma^2 = kappa solved by bisection, contours as
//! envelopes of the ring circle, p = 8 mm, a = 4.5 mm, 3000 rpm at 20 teeth (T = 1 ms); approach frame, SI units.
//! Columns: pin path and velocity tau, x, y; contour tau, x, y, nx, ny with the origin in the REAR joint, +y away from
//! the sprocket and the normal into the link; link omega tau, rad/s (negative clockwise).

use pitchline::geometry::Vec2;
use pitchline::geometry::smartchain::{
    Abutment, AbutmentError, AbutmentSide, AbutmentSpec, Inclination, LobedRing, RingError, Transition,
    TransitionError, TwoLinks, centre_distance, fits_hollow,
};
use pitchline::units::{DEG, MM};

mod golden;
mod lanes;
mod rings;
#[path = "../common/transition.rs"]
mod transition;
mod two_links;

const PITCH_M: f64 = 8e-3;
const PERIOD_S: f64 = 1e-3;
/// Golden numbers have 17 digits from another implementation.
const GOLDEN_M: f64 = 1e-9;

/// Pseudorandom numbers that depend only on the seed (Steele and others 2014, SplitMix64).
struct Random(u64);

impl Random {
    /// From 0 to 1.
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn spec(distance_m: f64) -> AbutmentSpec {
    AbutmentSpec { distance_m, flat_m: None, end_angle_rad: None }
}

fn smooth(teeth: u32) -> Transition {
    Transition::smooth(teeth, PITCH_M).expect("a transition")
}

fn abutment(teeth: u32) -> Abutment {
    Abutment::new(smooth(teeth), spec(4.5e-3)).expect("an abutment")
}

/// Mirrors between the approach frame of the tables and the link frame of the library.
fn from_rear_joint(point: Vec2) -> Vec2 {
    Vec2::new(point.x + 0.5 * PITCH_M, -point.y)
}

/// An abutment for a member that is less inclined than the smooth one, at 20 teeth.
fn hollow(inclination_deg: f64) -> Abutment {
    let t = Transition::new(20, PITCH_M, Inclination::Given(inclination_deg * DEG)).expect("a member");
    Abutment::new(t, spec(4.5e-3)).expect("an abutment with a hollow")
}

/// Hand-over within two links, with the smallest peak of jerk.
fn over_two_links(teeth: u32) -> Abutment {
    let t = Transition::over_two_links(teeth, PITCH_M, TwoLinks::default()).expect("a path");
    Abutment::new(t, spec(4.5e-3)).expect("an abutment")
}

#[test]
fn velocities_are_derivatives_of_positions() {
    // Central differences of step 1e-5: error of order 1e-10 of the third derivative, some 1e-2 m; measured 2.3e-10 m,
    // the rounding of the dyad at 150 teeth.
    let step = 1e-5;
    for t in [smooth(9), smooth(20), smooth(150)] {
        for tau in [-0.3, 0.2, 0.5, 0.9, 1.4, 2.3] {
            let (before, here, after) = (t.link(tau - step), t.link(tau), t.link(tau + step));
            let velocity = (after.axis.position - before.axis.position) / (2.0 * step);
            let acceleration = (after.axis.velocity - before.axis.velocity) / (2.0 * step);
            let error = (velocity - here.axis.velocity).norm();
            assert!(error < 1e-9, "z {} tau {tau}: {error:e}", t.teeth);
            let error = (acceleration - here.axis.acceleration).norm();
            assert!(error < 1e-9, "z {} tau {tau}: {error:e}", t.teeth);
            assert!(((after.turn_rad - before.turn_rad) / (2.0 * step) - here.turn_rate).abs() < 1e-8);
            assert!(((after.turn_rate - before.turn_rate) / (2.0 * step) - here.turn_acceleration).abs() < 1e-8);
            let joint = (t.pin(tau + step).position - t.pin(tau - step).position) / (2.0 * step);
            assert!((joint - t.pin(tau).velocity).norm() < 1e-10, "tau {tau}");
        }
    }
}

#[test]
fn links_keep_their_length_and_acceleration_is_continuous() {
    for teeth in [9, 12, 20, 40, 97, 150] {
        let t = smooth(teeth);
        for k in -1000..=3000 {
            let tau = f64::from(k) * 1e-3;
            let (rear, front) = t.joints(tau);
            let error = (front.position - rear.position).norm() - PITCH_M;
            assert!(error.abs() < 1e-12, "z {teeth} tau {tau}: {error:e} m"); // measured 3e-17
        }
        let centripetal = t.seat_angle_rad().powi(2) * t.pitch_radius_m;
        for (tau, outside) in [(0.0, t.pin(0.0)), (1.0, t.pin(1.0))] {
            let inside = t.pin_in_transition(tau);
            assert!((inside.position - outside.position).norm() < 1e-15);
            assert!((inside.velocity - outside.velocity).norm() < 1e-12 * PITCH_M);
            let jump = (inside.acceleration - outside.acceleration).norm() / centripetal;
            assert!(jump < 1e-6, "z {teeth} tau {tau}: {jump:e}"); // measured 4e-10 at 150 teeth
        }
    }
}

#[test]
fn other_members_are_smooth_in_velocity_and_jump_in_acceleration() {
    // (phi [deg], h - R [mm], jumps at start and end [m/s2]) at 20 teeth, 3000 rpm: independent computation as above.
    let table = [
        (1.0, -0.014, 7782.0, 550.0),
        (2.0, 0.057, 3002.0, 417.0),
        (3.0, 0.104, 1258.0, 254.0),
        (4.0, 0.1256, 231.0, 60.0),
        (5.0, 0.119, 537.0, 168.0),
        (6.0, 0.084, 1191.0, 427.0),
        (8.0, -0.074, 2360.0, 1033.0),
    ];
    let best = smooth(20).line_height_m;
    for (phi, lift_mm, start, end) in table {
        let t = Transition::new(20, PITCH_M, Inclination::Given(phi * DEG)).expect("a member");
        assert!(!t.smooth_acceleration && t.line_height_m < best, "the smooth member lies highest");
        assert!(((t.line_height_m - t.pitch_radius_m) / MM - lift_mm).abs() < 6e-4, "phi {phi}");
        let jump = |tau: f64| {
            let (inside, outside) = (t.pin_in_transition(tau), t.pin(tau));
            assert!((inside.velocity - outside.velocity).norm() < 1e-12 * PITCH_M);
            (inside.acceleration - outside.acceleration).norm() / PERIOD_S.powi(2)
        };
        assert!((jump(0.0) - start).abs() < 1.0, "phi {phi}: {}", jump(0.0));
        assert!((jump(1.0) - end).abs() < 1.0, "phi {phi}: {}", jump(1.0));
    }
}

/// Gap between the ring and an abutment of the link whose front joint is at `tau` on its exact path [m].
fn ring_gap_m(abutment: &Abutment, side: AbutmentSide, tau: f64) -> f64 {
    let axis = abutment.transition.link(tau).axis.position;
    abutment.contour(side).closest_to_point(axis).distance_m - abutment.ring_radius_m
}

#[test]
fn ring_touches_the_front_abutment_for_two_periods_and_never_enters_the_rear() {
    let two_links = [9, 20, 40, 150].map(over_two_links);
    let members = [9, 20, 40, 150].map(abutment).into_iter().chain([3.0, 3.7].map(hollow)).chain(two_links);
    for abutment in members {
        let t = &abutment.transition;
        let of = format!("z {}, {} deg, {} links", t.teeth, t.inclination_rad / DEG, t.span());
        for k in -1000..=4000 {
            let tau = f64::from(k) * 1e-3;
            let (front, rear) =
                (ring_gap_m(&abutment, AbutmentSide::Front, tau), ring_gap_m(&abutment, AbutmentSide::Rear, tau));
            if (0.0..=t.span() + 1.0).contains(&tau) {
                assert!(front.abs() < 5e-9, "{of}, tau {tau}: {front:e} m"); // measured 4.5e-9, the arcs' deviation
            }
            assert!(front > -5e-9 && rear > -5e-9, "{of}, tau {tau}: {front:e} {rear:e} m");
        }
    }
    let rear = |tau: f64| ring_gap_m(&abutment(20), AbutmentSide::Rear, tau) / MM;
    // The rear gap is the lift of the rear joint off its seat, except for second-order terms: 312.5 um one period
    // before it seats.
    assert!((rear(1.0) - 0.3126).abs() < 1e-3, "{}", rear(1.0));
    assert!((rear(1.5) - 0.042).abs() < 5e-4, "{}", rear(1.5));
    assert!(rear(2.0).abs() < 1e-5);
}

#[test]
fn nothing_enters_the_guide() {
    for abutment in [abutment(20), over_two_links(20), hollow(3.7), hollow(3.0)] {
        outside_of_the_guide(&abutment);
    }
    // On the straight span the support along the normal of the guide is the flat; with a hollow, the part behind it.
    for (abutment, from_joint) in
        [(abutment(20), 3e-3..4e-3), (over_two_links(20), 5e-3..7e-3), (hollow(3.0), 0.0..3e-3)]
    {
        let (height, point) = abutment.front.support(Vec2::new(0.0, 1.0));
        assert!((height - abutment.guide_height_m).abs() < 1e-15, "{height} {}", abutment.guide_height_m);
        assert!(from_joint.contains(&(point.x - 4e-3)), "{point:?}");
    }
    // 7 um at 3 deg and less for more, by an independent computation for the path; the contour rises by 9.
    assert!((hollow(3.0).rise_m - 9.04e-6).abs() < 0.05e-6 && hollow(3.7).rise_m < hollow(3.0).rise_m);
    assert_eq!((abutment(20).rise_m, abutment(20).guide_overlap_m), (0.0, 0.0));
    assert!((hollow(3.0).guide_overlap_m - 2.05e-6).abs() < 0.04e-6, "{:e}", hollow(3.0).guide_overlap_m);
}

fn outside_of_the_guide(abutment: &Abutment) {
    let profiles = [&abutment.front, &abutment.rear].map(|c| c.profile().expect("a contour"));
    for k in -1500..=2000 {
        let link = abutment.transition.link(f64::from(k) * 1e-3);
        for profile in &profiles {
            for p in profile.elements().iter().flat_map(|e| [0.0, 0.25, 0.5, 0.75, 1.0].map(|s| e.point(s))) {
                let from_axis = pitchline::geometry::rotated(p - link.axis.position, link.turn_rad);
                // Below the line of joints the guide ends over the axis; its face is at the ring's top, and lower if
                // the contour rises behind a hollow.
                if from_axis.x <= 0.0 {
                    let face = abutment.transition.line_height_m - abutment.guide_height_m;
                    // Hollow ones penetrate slightly, by the stated overlap.
                    let gap_m = -from_axis.y - face;
                    assert!(gap_m > -5e-9 - abutment.guide_overlap_m, "tau {}: {gap_m:e}", f64::from(k) * 1e-3);
                }
            }
        }
    }
}

#[test]
fn joint_comes_to_its_seat_with_the_third_power() {
    // (tau, outwards, ahead) [mm]: independent computation as above.
    for (tau, radial, ahead) in
        [(-1.0, 2.409, 0.800), (0.0, 0.3125, 0.0559), (0.5, 0.0418, 0.0067), (0.75, 0.0056, 0.0009)]
    {
        let (r, f) = transition::approach_to_seat_m(&smooth(20), tau);
        assert!((r / MM - radial).abs() < 6e-4 && (f / MM - ahead).abs() < 6e-4, "tau {tau}: {r} {f}");
    }
    let ratio =
        transition::approach_to_seat_m(&smooth(20), 0.98).0 / transition::approach_to_seat_m(&smooth(20), 0.99).0;
    assert!((ratio - 8.0).abs() < 0.1, "{ratio}");
}

#[test]
fn quasi_static_forces() {
    // Ring [N] at 392.3 N in the span, tau = 0, 1/4 .. 1: independent computation as above.
    for (k, expected) in [21.2, 41.4, 64.9, 88.9, 108.0].into_iter().enumerate() {
        let (ring, guide) = smooth(20).quasi_static_forces_n(392.3, 0.25 * k as f64);
        assert!((ring - expected).abs() < 0.06, "{k}: {ring}");
        assert!((8.0..29.5).contains(&guide), "{k}: {guide}");
    }
    assert!((smooth(40).quasi_static_forces_n(392.3, 0.0).0 - 10.6).abs() < 0.06);
    assert!((smooth(40).quasi_static_forces_n(392.3, 1.0).0 - 53.9).abs() < 0.06);
}

#[test]
fn parameters_that_do_not_work_are_told_from_those_that_do() {
    let at = |phi: f64| Transition::new(20, PITCH_M, Inclination::Given(phi * DEG)).expect("a path");
    let made = |phi: f64| Abutment::new(at(phi), spec(4.5e-3));
    assert!(made(4.3).is_ok() && made(4.56).is_ok());
    let Err(AbutmentError::Undercut { to_rad, least_distance_m, .. }) = made(5.0) else { panic!("a cusp") };
    assert!((4.56..5.0).contains(&(to_rad / DEG)), "{}", to_rad / DEG);
    assert!(made(to_rad / DEG - 1e-6).is_ok() && made(to_rad / DEG + 1e-6).is_err());
    assert!(Abutment::new(at(5.0), spec(least_distance_m * 1.001)).is_ok(), "{least_distance_m}");
    // Below the smooth member there is a hollow, down to a limit without support.
    let free = [made(4.0), made(3.0), made(2.0)].map(|a| a.expect("a hollow").front.hollow_radius_m());
    assert!(free[0] > free[1] && free[1] > free[2], "{free:?}");
    // 55 mm at its start, by an independent computation; the first arc is the mean of a piece.
    assert!((55e-3..60e-3).contains(&free[1]), "{free:?}");
    assert_eq!(made(4.3).expect("convex").front.hollow_radius_m(), f64::INFINITY);
    // A larger second ring does not fit into it.
    let second = LobedRing::new(&made(2.0).expect("a hollow"), smooth(40));
    assert!(matches!(second, Err(RingError::Jump { .. })), "{second:?}");
    let two = made(2.0).expect("a hollow");
    assert!(matches!(fits_hollow(&two, 46e-3), Err(RingError::Hollow { .. })) && fits_hollow(&two, 21e-3).is_ok());
    assert!(matches!(Abutment::new(smooth(20), spec(26e-3)), Err(AbutmentError::Distance { .. })));
    assert!(matches!(Abutment::new(smooth(20), spec(20e-3)), Err(AbutmentError::Collision { .. })));
    assert!(matches!(Transition::smooth(8, PITCH_M), Err(TransitionError::Teeth(8))));
    assert!(matches!(Transition::smooth(20, f64::NAN), Err(TransitionError::Pitch(_))));
    let Err(TransitionError::Inclination { to_rad, .. }) = Transition::new(20, PITCH_M, Inclination::Given(9.0 * DEG))
    else {
        panic!("no path")
    };
    assert!(Transition::new(20, PITCH_M, Inclination::Given(to_rad)).is_ok() && to_rad > 8.0 * DEG);
    for (distance, teeth) in [(3.5e-3, 20), (6e-3, 20), (4.5e-3, 9), (4.5e-3, 33), (4.5e-3, 150)] {
        let made = Abutment::new(smooth(teeth), spec(distance)).expect("the smooth member always works");
        assert!(made.max_deviation_m < 5e-9);
    }
}

#[test]
fn rear_is_the_mirror_image_of_front() {
    let abutment = abutment(20);
    assert_eq!(abutment.front.mirrored(), abutment.rear);
    assert_eq!(abutment.rear.mirrored().arcs().len(), abutment.front.arcs().len());
    for arcs in [abutment.front.arcs(), abutment.rear.arcs()] {
        for pair in arcs.windows(2) {
            assert!((pair[0].end - pair[1].start).norm() < 1e-14, "joined {pair:?}");
            assert!((pair[0].normal_end - pair[1].normal_start).norm() < 1e-9, "tangent");
            assert!(pair[0].normal_end_rad <= pair[1].normal_end_rad + 1e-15, "in order");
        }
    }
    let t = abutment.transition;
    assert!((abutment.neighbour_overlap_m() - 2.0 * (-t.line_end_x_m + 0.6e-3)).abs() < 1e-12);
    assert!(abutment.own_gap_m() > 0.0);
}

#[test]
fn closest_point_and_support_agree_with_a_search_over_every_element() {
    for abutment in [abutment(20), hollow(3.0), over_two_links(20)] {
        search_agrees(&abutment);
    }
}

fn search_agrees(abutment: &Abutment) {
    for contour in [&abutment.front, &abutment.rear] {
        let profile = contour.profile().expect("a contour");
        for k in 0..400 {
            // A spiral of points on the outer side.
            // Close by, and as far away as the axis of a ring.
            let high = if k % 2 == 0 { 4.8e-3 } else { 20e-3 };
            let o = Vec2::new(-0.02 + 1e-4 * f64::from(k), high + 1e-5 * f64::from(k % 37));
            let (fast, slow) = (contour.closest_to_point(o), profile.closest(o));
            assert!((fast.distance_m - slow.distance_m).abs() < 1e-14, "{o:?}: {fast:?} {slow:?}");
            assert!((fast.point - slow.point).norm() < 1e-9);
            let direction = pitchline::geometry::unit((60.0 + 0.15 * f64::from(k)) * DEG);
            let highest = profile
                .elements()
                .iter()
                .flat_map(|e| (0..=200).map(|s| e.point(f64::from(s) / 200.0).dot(&direction)))
                .fold(f64::NEG_INFINITY, f64::max);
            let (height, point) = contour.support(direction);
            assert!(
                // The span over a hollow bulges by some 5 nm.
                (height - highest).abs() < if contour.hollow_radius_m().is_finite() { 6e-9 } else { 2e-9 }
                    && (point.dot(&direction) - height).abs() < 1e-15,
                "{k} {height} {highest}"
            );
        }
    }
}

#[test]
fn loops_close() {
    // Independent computation; by the standard formula for chains 17 um more.
    for (n_links, distance_mm) in [(80, 198.3477), (90, 238.6246), (100, 278.8210)] {
        let found = centre_distance((20, 40), PITCH_M, n_links).expect("sprockets").expect("a loop");
        assert!((found / MM - distance_mm).abs() < 5e-5, "{n_links}: {found}");
        let swapped = centre_distance((40, 20), PITCH_M, n_links).expect("sprockets").expect("a loop");
        assert!((found - swapped).abs() < 1e-15);
    }
    assert_eq!(centre_distance((20, 40), PITCH_M, 30).expect("sprockets"), None);
}

#[test]
fn command_prints_draws_and_refuses() {
    let run = |args: &[&str]| {
        std::process::Command::new(env!("CARGO_BIN_EXE_pitchline"))
            .args(["geometry", "smartchain", "--pitch-mm", "8", "--abutment-mm", "4.5"])
            .args(args)
            .output()
            .expect("the program starts")
    };
    let folder = tempfile::tempdir().expect("a folder");
    let svg = folder.path().join("links.svg");
    let drawing = svg.to_str().expect("text");
    let out = run(&["--teeth", "20", "--driven-teeth", "40", "--json", "-o", drawing]);
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).expect("one JSON document");
    let near = |value: &serde_json::Value, expected: f64| {
        assert!((value.as_f64().unwrap_or(f64::NAN) - expected).abs() < 1e-6, "{value} is not {expected}");
    };
    near(&json["pitch_radius_mm"], 25.569813);
    near(&json["rolling_radius_mm"], 25.464791);
    near(&json["sigma"], 0.611852);
    near(&json["inclination_deg"], 4.278781);
    near(&json["line_height_mm"], 25.696467);
    near(&json["handover_angle_deg"], 11.005069);
    near(&json["line_end_x_mm"], -3.096532);
    near(&json["circle_start_mm"][0], 4.881171);
    near(&json["circle_start_mm"][1], 25.099592);
    near(&json["ring_radius_mm"], 21.069813);
    near(&json["min_contour_radius_mm"], 4.5);
    near(&json["guide_height_mm"], 4.626654);
    near(&json["driven"]["valley_radius_mm"], 46.418889);
    assert_eq!(json["c2"], true);
    assert!(json["contour_arcs"].as_u64().is_some_and(|n| n <= 24));
    assert!(json["contour_deviation_nm"].as_f64().is_some_and(|d| d < 5.0));
    assert!(std::fs::read_to_string(&svg).expect("drawn").matches('A').count() > 1000, "arcs are arcs");
    assert!(String::from_utf8_lossy(&run(&["--teeth", "150"]).stdout).contains("ring radius"));
    let two = run(&["--teeth", "20", "--two-links", "--line-end-mm=-5", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&two.stdout).expect("JSON");
    assert_eq!((json["links"].as_u64(), json["planes"].as_u64()), (Some(2), Some(3)));
    assert_eq!((json["line_end_x_mm"].as_f64(), json["sigma"].as_f64()), (Some(-5.0), None));
    assert!(json["peak_jerk"].as_f64().is_some_and(|jerk| (2.71..2.73).contains(&jerk)), "{json}");
    let hollow = run(&["--teeth", "20", "--inclination-deg", "3.5"]);
    assert!(String::from_utf8_lossy(&hollow.stdout).contains("behind a hollow"));
    for (args, names) in [
        (&["--teeth", "8"][..], "9 ..= 150"),
        (&["--teeth", "20", "--inclination-deg", "5"], "up to 4.5916 deg"),
        (&["--teeth", "40", "--driven-teeth", "20"], "smaller sprocket"),
        (&["--teeth", "20", "-o", "links.png"], ".svg"),
        (&["--teeth", "20", "--line-end-mm=-5"], "--two-links"),
        (&["--teeth", "20", "--two-links", "--inclination-deg", "4"], "cannot be used"),
        (&["--teeth", "20", "--two-links", "--driven-teeth", "40"], "neighbouring teeth"),
        (&["--teeth", "20", "--two-links", "--handover-deg", "60"], "a hand-over at 60.0000 deg; 271"),
        (&["--teeth", "20", "--two-links", "--turn-deg=60,9"], "hollow"),
    ] {
        let out = run(args);
        assert_eq!(out.status.code(), Some(2), "{args:?}");
        assert!(String::from_utf8_lossy(&out.stderr).contains(names), "{args:?}: {out:?}");
    }
}
