//! Silent chain: the closed forms of link and tooth, the motion to the seat, the forces of a lightly loaded wrap.

#[path = "common/silent_mesh.rs"]
mod silent_mesh;

use pitchline::drive::{BUNDLED, Drive};
use pitchline::geometry::Vec2;
use pitchline::geometry::chain::silent::{
    LinkPart, SilentChain, SilentLinkContour, SilentLinkError, SilentLinkForm, SilentRowSpec,
};
use pitchline::geometry::element_gap::element_gap_m;
use pitchline::geometry::profile::Profile;
use pitchline::geometry::silent_sprocket::{SilentSprocket, SilentSprocketError, SilentSprocketSpec, ToothFace};
use pitchline::model::{Model, Toothing, place};
use pitchline::pairs::contour_body::{LinkContour, LinkPose};
use silent_mesh::{
    EntryClearances, approach_speeds_m_s, entry_clearances, first_contact_on_contours_rad, first_contact_turn_rad,
    flank_gaps_m, pose_before_seat, stretched_approach_speed_m_s, working_flank_pitch_m, wrap_statics,
};
use std::f64::consts::PI;

/// Pitch [mm] and teeth of the cases with known numbers.
const CASES: [(f64, u32); 4] = [(8.0, 20), (8.0, 40), (9.525, 28), (9.525, 18)];
/// 3000 rpm [rad/s].
const SPEED_RAD_S: f64 = 100.0 * PI;

fn link(pitch_mm: f64) -> SilentLinkContour {
    let pitch_m = pitch_mm * 1e-3;
    SilentLinkContour::new(SilentLinkForm::standard(pitch_m), pitch_m, pitch_m).expect("a link")
}

/// A link with pins and contour of other pitches [mm].
fn link_with(pitch_mm: f64, pins_mm: f64, flanks_mm: f64) -> SilentLinkContour {
    let form = SilentLinkForm::standard(pitch_mm * 1e-3);
    SilentLinkContour::new(form, pins_mm * 1e-3, flanks_mm * 1e-3).expect("a link")
}

fn spec(pitch_mm: f64, teeth: u32, face: ToothFace) -> SilentSprocketSpec {
    SilentSprocketSpec::standard(teeth, pitch_mm * 1e-3, face)
}

fn sprocket(pitch_mm: f64, teeth: u32, face: ToothFace) -> SilentSprocket {
    SilentSprocket::new(spec(pitch_mm, teeth, face)).unwrap_or_else(|e| panic!("z = {teeth} {face:?}: {e}"))
}

fn near(name: &str, found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{name} = {found}, expected {expected} +- {tolerance}");
}

#[test]
fn links_have_the_worked_numbers() {
    // f, f_i, r_t, r_c, o_x, D, s_o, s_i, s_i0, y_c, crotch top, toe low [mm], computed independently of this code.
    #[rustfmt::skip]
    let rows = [
        (8.0, [3.0, 2.5, 0.8, 1.2, 0.288675, 3.9, 3.233162, 3.521837, -1.591412, -0.471797, 0.728203, -4.7]),
        (9.525, [3.571875, 2.9765625, 0.9525, 1.42875, 0.343704, 4.6434375, 3.849483, 4.193187, -1.894775, -0.561733,
            0.867017, -5.5959375]),
    ];
    for (pitch_mm, expected) in rows {
        let l = link(pitch_mm);
        let form = l.form;
        let found = [
            form.face_distance_m,
            form.inner_face_distance_m(),
            form.toe_radius_m,
            form.crotch_radius_m,
            form.toe_offset_m(),
            form.toe_depth_m(),
            l.outer_flank_length_m,
            l.inner_flank_end_m,
            l.inner_flank_start_m,
            l.crotch_centre_m,
            l.crotch_top_m(),
            l.toe_low_m(),
        ];
        for (i, (found_m, mm)) in found.iter().zip(expected).enumerate() {
            near(&format!("p = {pitch_mm}, quantity {i} [mm]"), found_m * 1e3, mm, 6e-7);
        }
    }
}

#[test]
fn sprockets_have_the_worked_numbers() {
    // R, d, r_v, beta [deg], e, r_b, s_c, r_a, r_f, r_r, K, T, half tip land [mm], computed independently of this code;
    // arc, then line.
    #[rustfmt::skip]
    let arcs = [
        [25.5698, 25.2550, 25.4648, 12.0, 6.163401, 22.053156, 1.818321, 25.2550, 20.1814, 1.8749, 0.1516, 24.8545,
            -4.585109, 21.571241, 0.154],
        [50.9820, 50.8248, 50.9296, 21.0, 18.948308, 44.106312, 1.909273, 50.8248, 45.5204, 1.2890, 0.2725, 50.4241,
            -15.806288, 41.176789, 0.275],
        [42.5358, 42.2684, 42.4466, 17.1429, 13.437857, 36.759854, 2.226866, 42.2684, 36.0648, 1.8589, 0.2819, 41.7912,
            -10.835157, 35.126717, 0.285],
        [27.4261, 27.0095, 27.2871, 10.0, 5.808419, 23.631335, 2.140811, 27.0095, 21.0365, 2.3614, 0.1155, 26.5330,
            -4.103538, 23.272322, 0.118],
    ];
    // Half a unit of the last given digit.
    #[rustfmt::skip]
    let tolerances = [5e-5, 5e-5, 5e-5, 5e-5, 5e-7, 5e-7, 5e-7, 5e-5, 5e-5, 5e-5, 5e-5, 5e-5, 5e-7, 5e-7, 5e-4];
    let lines =
        [[1.6660, 0.6107, 24.8475], [1.1391, 0.5127, 50.4222], [1.6400, 0.6748, 41.7867], [2.1072, 0.7377, 26.5230]];
    for (i, (pitch_mm, teeth)) in CASES.into_iter().enumerate() {
        let s = sprocket(pitch_mm, teeth, ToothFace::Arc);
        let centre = s.face_centre.expect("an arc");
        let found = [
            s.pitch_radius_m,
            s.chord_radius_m,
            s.rolling_radius_m,
            s.half_tooth_angle_rad.to_degrees() * 1e-3,
            s.face_offset_m,
            s.base_radius_m,
            s.contact_distance_m.expect("one place"),
            s.tip_radius_m,
            s.root_radius_m,
            s.root_arc_radius_m,
            s.corner_centre.x,
            s.corner_centre.y,
            centre.x,
            centre.y,
            0.5 * s.tip_land_m,
        ];
        for (k, found_m) in found.iter().enumerate() {
            near(&format!("z = {teeth}, quantity {k} [mm]"), found_m * 1e3, arcs[i][k], 1.02 * tolerances[k]);
        }
        near("rho [mm]", s.face_radius_m.expect("an arc") * 1e3, arcs[i][4], 5e-7);
        let l = sprocket(pitch_mm, teeth, ToothFace::Line);
        for (k, found_m) in [l.root_arc_radius_m, l.corner_centre.x, l.corner_centre.y].iter().enumerate() {
            near(&format!("z = {teeth} line, quantity {k} [mm]"), found_m * 1e3, lines[i][k], 5e-5);
        }
        near("face offset of a line [mm]", l.face_offset_m * 1e3, arcs[i][4], 5e-7);
        assert!(l.contact_distance_m.is_none() && l.face_centre.is_none() && l.face_radius_m.is_none());
    }
}

/// The standard tooth, or, with few teeth, one changed as the errors suggest.
fn made_as_errors_say(mut spec: SilentSprocketSpec) -> SilentSprocket {
    for _ in 0..3 {
        match SilentSprocket::new(spec) {
            Ok(s) => return s,
            Err(SilentSprocketError::Pointed { largest_tip_diameter_m }) if spec.teeth < 18 => {
                let chord_m = 0.5 * spec.pitch_m / (PI / f64::from(spec.teeth)).tan();
                spec.tip_offset_m = 0.5 * largest_tip_diameter_m - chord_m - 1e-5;
            }
            Err(SilentSprocketError::Toe { enough_clearance_m: Some(clearance_m), .. }) if spec.teeth < 18 => {
                spec.root_clearance_m = clearance_m;
            }
            Err(e) => panic!("z = {} {:?}: {e}", spec.teeth, spec.face),
        }
    }
    panic!("z = {} {:?}: the errors do not say what would do", spec.teeth, spec.face);
}

#[test]
fn contours_are_closed_smooth_and_counterclockwise() {
    // measured 5e-14 rad; 20x for other CPUs.
    const KINK_RAD: f64 = 1e-12;
    let smooth = |name: &str, profile: &Profile| {
        let worst = profile.kinks_rad().iter().fold(0.0_f64, |w, k| w.max(k.abs()));
        assert!(worst < KINK_RAD, "{name}: kink of {worst} rad");
        assert!(profile.area_properties().area_m2 > 0.0, "{name} runs clockwise");
    };
    for (pins_mm, flanks_mm) in [(8.0, 8.0), (8.02, 7.98)] {
        let l = link_with(8.0, pins_mm, flanks_mm);
        let profile = l.profile().expect("closed");
        smooth("link", &profile);
        // Teeth are to the left of the travel, at +y.
        let (low, high) = profile.bounds();
        near("back [m]", low.y, -l.form.face_distance_m, 1e-15);
        near("toe [m]", high.y, -l.toe_low_m(), 1e-15);
        assert_eq!(profile.elements().len(), SilentLinkContour::PARTS.len());
    }
    for teeth in 13..=150 {
        let crowned = ToothFace::Crowned { radius_m: 0.2, contact_distance_m: 2e-3 };
        for face in [ToothFace::Arc, ToothFace::Line, crowned].into_iter().take(if teeth % 9 == 0 { 3 } else { 2 }) {
            let s = made_as_errors_say(spec(8.0, teeth, face));
            let profile = s.profile().expect("connected");
            smooth(&format!("z = {teeth} {face:?}"), &profile);
            let (low, high) = (PI * s.root_radius_m.powi(2), PI * s.tip_radius_m.powi(2));
            let area = profile.area_properties().area_m2;
            assert!(low < area && area < high, "z = {teeth}: area {area} between {low} and {high}");
            assert!(s.tip_land_m > 0.0 && s.toe_clearance_m > -1e-15, "z = {teeth} {face:?}");
        }
    }
}

#[test]
fn seated_links_touch_with_both_outer_flanks_for_any_form() {
    // measured 1.4e-17; far below the 1e-9 m that would matter, and far above rounding.
    const SEAT_M: f64 = 1e-15;
    for (pitch_mm, teeth) in CASES {
        for angle_deg in [22.0_f64, 27.5, 30.0, 33.0] {
            for face in [ToothFace::Arc, ToothFace::Line] {
                let mut spec = spec(pitch_mm, teeth, face);
                spec.link.flank_angle_rad = angle_deg.to_radians();
                spec.link.face_distance_m *= 0.97;
                spec.tip_offset_m = -0.03 * spec.pitch_m;
                // Steep flanks are long: a small toe would interfere with the face.
                if angle_deg < 25.0 {
                    spec.link.toe_radius_m = 0.19 * spec.pitch_m;
                }
                let s =
                    SilentSprocket::new(spec).unwrap_or_else(|e| panic!("z = {teeth} {angle_deg} deg {face:?}: {e}"));
                let l = SilentLinkContour::new(spec.link, spec.pitch_m, spec.pitch_m).expect("a link");
                let joint = Vec2::new(s.pitch_radius_m, 0.0);
                for gap_m in flank_gaps_m(&l, &s, joint, 0.0) {
                    assert!(gap_m.abs() < SEAT_M, "z = {teeth} {angle_deg} deg {face:?}: {gap_m} m");
                }
                // A joint off the pitch circle leaves the seat open by sin alpha per unit.
                let lifted = flank_gaps_m(&l, &s, joint * (1.0 + 1e-4), 0.0);
                assert!(lifted[0] > 1e-7 && lifted[1] > 1e-7, "{lifted:?}");
            }
        }
    }
}

/// Number of poses per pitch at which clearances are evaluated: a minimum between two poses is lower by less than 0.1
/// um.
const STEPS: u32 = 180;
/// Known to whole micrometres, found with a sampled contour [m].
const CLEARANCE_M: f64 = 2e-6;

fn assert_um(name: &str, found_m: f64, um: f64) {
    near(&format!("{name} [um]"), found_m * 1e6, um, CLEARANCE_M * 1e6);
}

#[test]
fn entering_links_clear_the_teeth_by_the_known_amounts() {
    // Arc: toe against root and face, eye against the tip. Line: inner flank, crotch [um].
    let known = [
        (118.0, 179.0, 239.0, 286.0),
        (46.0, 83.0, 321.0, 348.0),
        (92.0, 145.0, 328.0, 372.0),
        (159.0, 241.0, 276.0, 335.0),
    ];
    for ((pitch_mm, teeth), (toe_um, eye_um, inner_um, crotch_um)) in CASES.into_iter().zip(known) {
        let l = link(pitch_mm);
        let arc: EntryClearances = entry_clearances(&l, &sprocket(pitch_mm, teeth, ToothFace::Arc), STEPS);
        assert_um(&format!("z = {teeth} toe"), arc.toe.gap_m, toe_um);
        assert_um(&format!("z = {teeth} eye"), arc.eye.gap_m, eye_um);
        assert!(arc.inner_flank.gap_m > 400e-6 && arc.crotch.gap_m > 400e-6, "z = {teeth}: {arc:?}");
        // The outer flanks make contact at the seat and nowhere before.
        assert!(arc.outer_flank.gap_m.abs() < 1e-15 && arc.outer_flank.pitches_before_seat == 0.0, "{arc:?}");
        // The check of the sprocket's constructor uses the same gap.
        near("toe clearance [m]", sprocket(pitch_mm, teeth, ToothFace::Arc).toe_clearance_m, arc.toe.gap_m, 1e-7);
        let line = entry_clearances(&l, &sprocket(pitch_mm, teeth, ToothFace::Line), STEPS);
        assert_um(&format!("z = {teeth} inner flank"), line.inner_flank.gap_m, inner_um);
        assert_um(&format!("z = {teeth} crotch"), line.crotch.gap_m, crotch_um);
    }
}

#[test]
fn inner_flanks_too_close_to_the_outer_ones_cut_a_straight_tooth_and_clear_an_arc() {
    // Projection of the corner of a straight tooth beyond the plane of the inner flank at the seat [um], computed by
    // hand. The plane is longer than the flank: there the corner overlaps the crotch arc, even deeper.
    for ((pitch_mm, teeth), plane_um) in CASES.into_iter().zip([161.0, 79.0, 148.0, 200.0]) {
        let mut spec = spec(pitch_mm, teeth, ToothFace::Line);
        spec.link.inside_projection_m = -0.0125 * spec.pitch_m;
        let l = SilentLinkContour::new(spec.link, spec.pitch_m, spec.pitch_m).expect("a link");
        for face in [ToothFace::Line, ToothFace::Arc] {
            let s = SilentSprocket::new(SilentSprocketSpec { face, ..spec }).expect("a tooth");
            let corner = Vec2::new(s.corner_centre.x, s.chord_radius_m - s.corner_centre.y);
            let found = entry_clearances(&l, &s, STEPS);
            let crotch_m = spec.link.crotch_radius_m - (corner - l.crotch.centre).norm() - spec.corner_radius_m;
            println!("z = {teeth} {face:?}: inner {} m, crotch {} m", found.inner_flank.gap_m, found.crotch.gap_m);
            if face == ToothFace::Line {
                let flank = l.front.inner_flank;
                let plane_m = flank.normal.dot(&(corner - flank.start)) - spec.corner_radius_m;
                assert_um(&format!("z = {teeth} plane"), plane_m, -plane_um);
                assert!(found.inner_flank.gap_m < -1e-6, "z = {teeth}: {found:?}");
                near("crotch [m]", found.crotch.gap_m, crotch_m, 1e-12);
            } else {
                assert!(found.inner_flank.gap_m > 90e-6, "z = {teeth}: {found:?}");
            }
        }
    }
    // With the face in contact with the link ahead, the inner flank of the next one is set back by -lambda, exactly.
    let mut spec = spec(8.0, 20, ToothFace::Arc);
    spec.link.inside_projection_m = -1e-4;
    let l = SilentLinkContour::new(spec.link, spec.pitch_m, spec.pitch_m).expect("a link");
    let inner = entry_clearances(&l, &SilentSprocket::new(spec).expect("a tooth"), STEPS).inner_flank;
    near("inner gap [m]", inner.gap_m, 1e-4, 1e-14);
    near("pitches before the seat", inner.pitches_before_seat, 1.0, 1e-12);
}

#[test]
fn element_gaps_agree_with_sampled_contours() {
    // Independent of the pair formulas: points along the link, each with the nearest point of the whole sprocket.
    const SAMPLES: usize = 150;
    for face in [ToothFace::Arc, ToothFace::Line] {
        let s = sprocket(8.0, 20, face);
        let l = link(8.0);
        let profile = s.profile().expect("closed");
        for pitches in [0.05, 0.18, 0.62, 1.0, 1.3] {
            let (angle_rad, origin) = pose_before_seat(&s, l.pin_pitch_m, pitches);
            for (part, element) in SilentLinkContour::PARTS.iter().zip(l.elements()) {
                if *part == LinkPart::Back {
                    continue;
                }
                let placed = element.moved(angle_rad, origin);
                let exact_m = profile
                    .elements()
                    .iter()
                    .map(|tooth| element_gap_m(&placed, tooth, 2.4e-4))
                    .fold(f64::INFINITY, f64::min);
                let sampled_m = (0..=SAMPLES)
                    .map(|k| profile.closest(placed.point(k as f64 / SAMPLES as f64)).distance_m)
                    .fold(f64::INFINITY, f64::min);
                // A sample is at most half a step from the nearest point; the gap grows with its square over the
                // curvature.
                let step_m = placed.length_m() / SAMPLES as f64;
                let tolerance_m = step_m * step_m / 1e-3 + 1e-12;
                assert!(
                    (-1e-12..tolerance_m).contains(&(sampled_m - exact_m)),
                    "{face:?} {pitches} {part:?}: {exact_m} m, sampled {sampled_m} m"
                );
            }
        }
    }
}

#[test]
fn approach_speeds_are_those_of_the_levers() {
    // v_lead, v_trail [m/s] at 3000 rpm, computed independently of this code.
    let known = [(0.571242, 0.685395), (0.599816, 0.656821), (0.699591, 0.796593), (0.672556, 0.823628)];
    // measured 1.5e-9 relative: central difference of exact gaps.
    const RELATIVE: f64 = 1e-6;
    for ((pitch_mm, teeth), (lead, trail)) in CASES.into_iter().zip(known) {
        let s = sprocket(pitch_mm, teeth, ToothFace::Arc);
        let closed = approach_speeds_m_s(&s, SPEED_RAD_S).expect("one place");
        near("v_lead [m/s]", closed[0], lead, 5.1e-7);
        near("v_trail [m/s]", closed[1], trail, 5.1e-7);
        let l = link(pitch_mm);
        let joint = Vec2::new(s.pitch_radius_m, 0.0);
        let step_rad = 1e-6;
        let (before, after) = (flank_gaps_m(&l, &s, joint, step_rad), flank_gaps_m(&l, &s, joint, -step_rad));
        for side in 0..2 {
            let measured = (before[side] - after[side]) / (2.0 * step_rad) * SPEED_RAD_S;
            near(&format!("z = {teeth} side {side} [m/s]"), measured, closed[side], RELATIVE * closed[side]);
        }
    }
    // A straight face has no single speed; a crown with the same contact point has the same speed.
    assert!(approach_speeds_m_s(&sprocket(8.0, 20, ToothFace::Line), SPEED_RAD_S).is_none());
    let crowned = ToothFace::Crowned { radius_m: 0.2, contact_distance_m: 1.818321e-3 };
    let speeds = approach_speeds_m_s(&sprocket(8.0, 20, crowned), SPEED_RAD_S).expect("one place");
    near("crowned v_trail [m/s]", speeds[1], 0.685395, 1e-6);
}

#[test]
fn a_stretched_joint_lowers_the_approach_speed() {
    let s = sprocket(8.0, 20, ToothFace::Arc);
    for (stretch_m, speed) in [(0.0, 0.685395), (59e-6, 0.554), (16e-6, 0.652)] {
        let found = stretched_approach_speed_m_s(&s, SPEED_RAD_S, stretch_m).expect("touches");
        near(&format!("stretch {stretch_m} m: v [m/s]"), found, speed, 6e-4);
    }
    assert!(stretched_approach_speed_m_s(&s, SPEED_RAD_S, 1e-3).is_none(), "a millimetre leaves nothing to touch");
}

#[test]
fn a_wrap_carried_by_trailing_flanks_falls_off_geometrically() {
    // nu, q, lean [deg], both-flank limit, symmetric seat.
    let known = [
        (0.4794, 0.5899, -7.45, 0.5695, 0.3129),
        (0.2741, 0.7635, -4.10, 0.7601, 0.1569),
        (0.3695, 0.6822, -5.62, 0.6734, 0.2239),
        (0.5173, 0.5584, -8.10, 0.5321, 0.3473),
    ];
    for ((pitch_mm, teeth), (nu, q, lean_deg, both, symmetric)) in CASES.into_iter().zip(known) {
        let s = sprocket(pitch_mm, teeth, ToothFace::Arc);
        let w = wrap_statics(&s).expect("one place");
        near("nu", w.flank_force_ratio, nu, 5.1e-5);
        near("q", w.tension_ratio, q, 5.1e-5);
        near("lean [deg]", w.lean_rad.to_degrees(), lean_deg, 5.1e-3);
        near("both flanks", w.both_flanks_tension_ratio, both, 5.1e-5);
        near("symmetric", w.symmetric_flank_force_ratio, symmetric, 5.1e-5);
    }
    assert!(wrap_statics(&sprocket(8.0, 20, ToothFace::Line)).is_none());
}

#[test]
fn longer_rows_touch_earlier_and_shorter_ones_later() {
    // Pitch, teeth, speed [rad/s]; row error [um], shift [us] of the first contact, plus earlier.
    let rows = [
        (8.0, 20, SPEED_RAD_S, [(10.0, 12.83), (-10.0, -12.46), (20.0, 26.06), (-20.0, -24.57)], 0.005),
        (8.0, 40, 0.5 * SPEED_RAD_S, [(10.0, 27.2), (-10.0, -25.7), (20.0, 56.2), (-20.0, -50.0)], 0.05),
        (9.525, 28, SPEED_RAD_S, [(10.0, 11.06), (-10.0, -10.69), (20.0, 22.5), (-20.0, -21.1)], 0.05),
    ];
    for (pitch_mm, teeth, speed_rad_s, shifts, tolerance_us) in rows {
        let s = sprocket(pitch_mm, teeth, ToothFace::Arc);
        for (error_um, shift_us) in shifts {
            let name = format!("z = {teeth}, {error_um} um");
            let turn_rad = first_contact_turn_rad(&s, error_um * 1e-6).expect("touches");
            near(&format!("{name} closed form [us]"), turn_rad / speed_rad_s * 1e6, shift_us, 1.02 * tolerance_us);
            // Pins and contour of the row longer, those of the other row shorter.
            let [long_mm, short_mm] = [1.0, -1.0].map(|sign| pitch_mm + sign * error_um * 1e-3);
            let (ahead, row) = (link_with(pitch_mm, short_mm, short_mm), link_with(pitch_mm, long_mm, long_mm));
            let exact_rad = first_contact_on_contours_rad(&ahead, &row, &s).expect("touches");
            near(&format!("{name} on contours [rad]"), exact_rad, turn_rad, 1e-12);
        }
    }
}

#[test]
fn pins_alone_leave_the_working_flanks_where_they_are() {
    let s = sprocket(8.0, 20, ToothFace::Arc);
    let (nominal, long, short) = (8.0, 8.01, 7.99);
    // Pins and contour, pins alone, contour alone: gain from the pitch of the working flanks [um].
    let rows = [
        ((short, short), (long, long), 10.0),
        ((short, nominal), (long, nominal), 0.0),
        ((nominal, short), (nominal, long), 10.0),
    ];
    let shifts = rows.map(|((ahead_pins, ahead_flanks), (pins, flanks), gain_um)| {
        let (ahead, row) = (link_with(nominal, ahead_pins, ahead_flanks), link_with(nominal, pins, flanks));
        near("working flank pitch [um]", (working_flank_pitch_m(&ahead, &row) - 8e-3) * 1e6, gain_um, 1e-9);
        near("and of the other pair", (working_flank_pitch_m(&row, &ahead) - 8e-3) * 1e6, -gain_um, 1e-9);
        first_contact_on_contours_rad(&ahead, &row, &s).expect("touches") / SPEED_RAD_S * 1e6
    });
    // The bend at the joint leaves a remainder of x sin(pi/z) sin(alpha + pi/z), with the opposite sign for the contour
    // alone.
    let half_pitch_rad = PI / 20.0;
    let rest_us = 10.0 * half_pitch_rad.sin() * (PI / 6.0 + half_pitch_rad).sin() / 0.685395;
    near("pins and contour [us]", shifts[0], 12.83, 0.005);
    near("pins alone [us]", shifts[1], rest_us, 5e-3);
    near("contour alone [us]", shifts[2], 12.83 - rest_us, 0.05);
    assert!(shifts[1].abs() < 0.12 * shifts[0], "pins alone shift the first contact by {} us", shifts[1]);
}

#[test]
fn links_that_cannot_be_are_refused_with_what_would_do() {
    let standard = SilentLinkForm::standard(8e-3);
    let refused = |form: SilentLinkForm| SilentLinkContour::new(form, 8e-3, 8e-3).expect_err("refused");
    let made = |form: SilentLinkForm| SilentLinkContour::new(form, 8e-3, 8e-3).expect("made as the error says");

    let SilentLinkError::ToeRadius { largest_m } = refused(SilentLinkForm { toe_radius_m: 2.7e-3, ..standard }) else {
        panic!("toe")
    };
    made(SilentLinkForm { toe_radius_m: 0.999 * largest_m, ..standard });
    assert!(matches!(
        refused(SilentLinkForm { toe_radius_m: 1.001 * largest_m, ..standard }),
        SilentLinkError::ToeRadius { .. }
    ));
    let SilentLinkError::CrotchLarge { largest_m } = refused(SilentLinkForm { crotch_radius_m: 9e-3, ..standard })
    else {
        panic!("large crotch")
    };
    made(SilentLinkForm { crotch_radius_m: 0.999 * largest_m, ..standard });
    let deep = SilentLinkForm { face_distance_m: 2e-3, ..standard };
    let SilentLinkError::CrotchDeep { least_m } = refused(deep) else { panic!("deep crotch") };
    made(SilentLinkForm { crotch_radius_m: 1.001 * least_m, ..deep });
    for projection_m in [-1.1e-3, 0.2e-3] {
        let form = SilentLinkForm { inside_projection_m: projection_m, ..standard };
        assert!(matches!(refused(form), SilentLinkError::Projection { .. }), "{projection_m}");
    }
    for angle_rad in [0.0, 1.0, f64::NAN] {
        let form = SilentLinkForm { flank_angle_rad: angle_rad, ..standard };
        assert!(matches!(refused(form), SilentLinkError::FlankAngle { .. }), "{angle_rad}");
    }
    let hollow = SilentLinkForm { toe_radius_m: -1.0, ..standard };
    assert!(matches!(refused(hollow), SilentLinkError::Dimension { name: "the toe radius", .. }));
    // Flank pitch and pin pitch of a row must not differ much.
    let torn = SilentLinkContour::new(standard, 8e-3, 8.5e-3).expect_err("refused");
    assert!(matches!(torn, SilentLinkError::FlankPitch { .. }) && torn.to_string().contains("8.1600 mm"), "{torn}");
}

#[test]
fn sprockets_that_cannot_be_are_refused_with_what_would_do() {
    let standard = spec(8.0, 20, ToothFace::Arc);
    let refused = |spec: SilentSprocketSpec| SilentSprocket::new(spec).expect_err("refused");

    // z > 360 deg / alpha.
    for (teeth, angle_deg, least) in [(12, 30.0_f64, 13), (16, 22.0, 17), (151, 30.0, 13)] {
        let mut few = SilentSprocketSpec { teeth, ..standard };
        few.link.flank_angle_rad = angle_deg.to_radians();
        assert_eq!(refused(few), SilentSprocketError::Teeth { teeth, least });
    }
    let high = SilentSprocketSpec { tip_offset_m: 0.4e-3, ..standard };
    let SilentSprocketError::Pointed { largest_tip_diameter_m } = refused(high) else { panic!("pointed") };
    near("largest tip diameter [m]", largest_tip_diameter_m, 2.0 * 25.463171e-3, 1e-8);
    let low = SilentSprocketSpec { tip_offset_m: -4e-3, ..standard };
    let SilentSprocketError::LowTip { smallest_tip_diameter_m } = refused(low) else { panic!("low tip") };
    let tip_offset_m = 0.5 * smallest_tip_diameter_m + 1e-6 - 25.25500605870017e-3;
    SilentSprocket::new(SilentSprocketSpec { tip_offset_m, ..standard }).expect("made as the error says");
    let SilentSprocketError::DeepRoot { largest_clearance_m } =
        refused(SilentSprocketSpec { root_clearance_m: 9e-3, ..standard })
    else {
        panic!("deep root")
    };
    let deep = SilentSprocketSpec { root_clearance_m: 0.99 * largest_clearance_m, ..standard };
    SilentSprocket::new(deep).expect("made as the error says");

    // 0.0625 p of root clearance is too little for the straight face.
    for (pitch_mm, teeth, strikes_um) in [(8.0, 20, 18.0), (9.525, 18, 41.0)] {
        let shallow =
            SilentSprocketSpec { root_clearance_m: 0.0625e-3 * pitch_mm, ..spec(pitch_mm, teeth, ToothFace::Line) };
        let SilentSprocketError::Toe { interference_m, enough_clearance_m } = refused(shallow) else { panic!("toe") };
        assert_um(&format!("z = {teeth} toe"), -interference_m, -strikes_um);
        let root_clearance_m = enough_clearance_m.expect("some root helps");
        SilentSprocket::new(SilentSprocketSpec { root_clearance_m, ..shallow }).expect("made as the error says");
        assert!(root_clearance_m <= 0.1001e-3 * pitch_mm, "the standard clearance is enough: {root_clearance_m} m");
    }
    let broken = SilentSprocketSpec { corner_radius_m: f64::NAN, ..standard };
    assert!(matches!(refused(broken), SilentSprocketError::Dimension { name: "the corner radius", .. }));
    let mut steep = spec(9.525, 28, ToothFace::Line);
    steep.link.flank_angle_rad = 22.0_f64.to_radians();
    let SilentSprocketError::Toe { enough_clearance_m: None, .. } = refused(steep) else { panic!("steep") };
    steep.link.toe_radius_m = 1.8e-3;
    SilentSprocket::new(steep).expect("made as the error says");
    let blunt = SilentSprocketSpec { corner_radius_m: 7e-3, ..standard };
    assert!(matches!(refused(blunt), SilentSprocketError::Face { .. }));
}

#[test]
fn rows_have_masses_of_plates_and_pins_or_those_given() {
    let chain = SilentChain {
        pitch_m: 8e-3,
        form: SilentLinkForm::standard(8e-3),
        pin_diameter_m: 2.4e-3,
        pin_length_m: 24e-3,
        pack_thickness_m: 7e-3,
        density_kg_m3: 7850.0,
        even: SilentRowSpec { pin_pitch_m: Some(8.01e-3), flank_pitch_m: Some(8.02e-3), ..SilentRowSpec::default() },
        odd: SilentRowSpec { mass_kg: Some(7.3e-3), inertia_kg_m2: Some(7e-8), ..SilentRowSpec::default() },
    };
    let [even, odd] = chain.rows().expect("two rows");
    assert_eq!((even.shape.name, odd.shape.name), ("even", "odd"));
    assert_eq!((even.shape.pitch_m, even.contour.flank_pitch_m), (8.01e-3, 8.02e-3));
    assert_eq!((odd.shape.pitch_m, odd.contour.flank_pitch_m), (8e-3, 8e-3));
    assert_eq!((odd.shape.mass_kg, odd.shape.inertia_kg_m2), (7.3e-3, 7e-8));
    assert_eq!(even.shape.bush_radius_m, None);
    let joints = [-4.005e-3, 4.005e-3].map(|x| (Vec2::new(x, 0.0), 1.2e-3));
    for ((found, radius_m), (joint, pin_radius_m)) in even.shape.circles.iter().zip(joints) {
        assert!((found - joint).norm() < 1e-15 && *radius_m == pin_radius_m, "{found} {radius_m}");
    }
    // By sampling the plate on a grid; pins by hand: half of each belongs to this link.
    let step_m = 2e-5;
    let (low, high) = even.shape.plate.bounds();
    let (mut mass, mut first, mut polar) = (0.0, 0.0, 0.0);
    let (columns, lines) = (((high.x - low.x) / step_m) as i32, ((high.y - low.y) / step_m) as i32);
    for (i, j) in (0..=columns).flat_map(|i| (0..=lines).map(move |j| (i, j))).filter(|(i, j)| (i + j) % 16 == 0) {
        let p = low + Vec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5) * step_m;
        if even.shape.plate.closest(p).distance_m < 0.0 {
            let share = 16.0 * step_m * step_m * 7e-3 * 7850.0;
            mass += share;
            first += share * p.y;
            polar += share * p.norm_squared();
        }
    }
    let pin_m2 = PI * 1.2e-3 * 1.2e-3;
    let pins = pin_m2 * (24e-3 - 14e-3) * 7850.0;
    mass += pins;
    polar += pins * (0.5 * 1.2e-3 * 1.2e-3 + 4.005e-3 * 4.005e-3);
    let centre_m = first / mass;
    // The grid is accurate to 0.5 %.
    near("mass [kg]", even.shape.mass_kg, mass, 5e-3 * mass);
    near("centre of mass [m]", even.centre_of_mass_m, centre_m, 5e-3 * 1e-3);
    let inertia = polar - mass * centre_m * centre_m;
    near("inertia [kg m2]", even.shape.inertia_kg_m2, inertia, 1e-2 * inertia);
    println!("{} kg, {} kg m2, {} m", even.shape.mass_kg, even.shape.inertia_kg_m2, even.centre_of_mass_m);
    let thick = SilentChain { pin_diameter_m: 5.5e-3, ..chain };
    assert!(matches!(thick.rows(), Err(SilentLinkError::PinHole { largest_diameter_m }) if largest_diameter_m < 5e-3));
}

#[test]
fn links_touch_teeth_where_a_search_over_every_element_finds_it() {
    let (_, text) = BUNDLED.iter().find(|b| b.0 == "silent-20-40").expect("a bundled drive");
    let crown = |radius_mm: f64, at_mm: f64| {
        vec![
            "sprockets.driver.face=crowned".to_string(),
            format!("sprockets.driver.face_radius_mm={radius_mm}"),
            format!("sprockets.driver.contact_distance_mm={at_mm}"),
        ]
    };
    let angle = |deg: f64| vec![format!("chain.silent.flank_angle_deg={deg}")];
    let shallow = |deg: f64| [angle(deg), vec!["sprockets.driver.root_clearance_mm=0.46".to_string()]].concat();
    let cases = [vec![], angle(25.0), angle(32.0), angle(34.0), shallow(30.0), crown(10.0, 1.5), crown(20.0, 1.8)];
    let mut segments = std::collections::BTreeSet::new();
    for sets in cases {
        let drive = Drive::parse("silent-20-40", text, &sets).unwrap_or_else(|e| panic!("{e}"));
        let placed = place(&drive).unwrap_or_else(|e| panic!("{e}"));
        let model = Model::build(&drive, &placed, 0.0).unwrap_or_else(|e| panic!("{e}"));
        let Toothing::Silent(sprocket) = &model.sprockets[0].geometry else { panic!("teeth of a silent chain") };
        let Some(LinkContour::Flanks(rows)) = &model.contours[0] else { panic!("flanks") };
        let tau = sprocket.pitch_angle_rad();
        let (mut compared, mut worst) = (0, 0.0_f64);
        // A lattice that matches no symmetry of the teeth.
        for k in 0..40_000_u32 {
            let share = |step: f64| (f64::from(k) * step).fract();
            let (angle_rad, seated) = sprocket.pose_at_seat(8e-3, tau * (1.1 * share(0.618_034) - 0.05));
            let origin = seated + Vec2::new(0.28e-3 * share(0.754_878) - 0.04e-3, 0.3e-3 * (share(0.569_840) - 0.5));
            for (front, outer) in [(true, true), (true, false), (false, true), (false, false)] {
                let end = if front { &rows[0].front } else { &rows[0].rear };
                let set = usize::from(!outer);
                let body = model.end_bodies.iter().find(|b| b.frame.turn == Some(0) && b.set == set).expect("a body");
                let pose = LinkPose {
                    centre: origin,
                    cos: angle_rad.cos(),
                    sin: angle_rad.sin(),
                    lever: if front { 4e-3 } else { -4e-3 },
                    front,
                    row: 0,
                };
                let Some(touch) = body.touch(model.contours[0].as_ref().expect("flanks"), &pose, (1.0, 0.0), 0.2e-3)
                else {
                    continue;
                };
                let side = if front == outer { [4, 5] } else { [2, 1] };
                let gap = sprocket.gap(touch.tooth as i32);
                let [face, corner, root] = [gap[side[0]], gap[side[1]], gap[3]];
                let flank = if outer { &end.outer_flank } else { &end.inner_flank };
                let (flank, toe, crotch) = (flank.element(), end.toe.element(), rows[0].crotch.element());
                let last = if outer { (toe, root) } else { (crotch, corner) };
                let least = [(flank, face), (flank, corner), (toe, face), (toe, corner), last]
                    .iter()
                    .map(|(e, t)| element_gap_m(&e.moved(angle_rad, origin), t, 2.4e-4))
                    .fold(f64::INFINITY, f64::min);
                if least < -1e-4 {
                    continue; // Deeper than any contact: sides are mixed up.
                }
                compared += 1;
                segments.insert(format!("{:?}", touch.segment));
                if (least + touch.penetration_m).abs() > 1e-12 && worst < 1e-12 {
                    println!("{sets:?} front {front} outer {outer}: {least:e} {touch:?}");
                }
                worst = worst.max((least + touch.penetration_m).abs());
            }
        }
        println!("{sets:?}: {compared} contacts, worst {worst:e}; so far {segments:?}");
        assert!(compared > 15_000 && worst < 1e-12, "{compared} {worst:e}");
    }
    assert_eq!(segments.len(), 4, "{segments:?}");
}
