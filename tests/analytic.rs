//! Checks against closed forms: geometry, contact laws, polygon effect, rings, spans.

mod common;
#[path = "common/contour.rs"]
mod contour;

use common::{NO_FRICTION, assembled, drive, drive_without_guides, watch};
use pitchline::elements::contact_law::{ContactLaw, HertzLine, PairRadii, restitution_hysteresis};
use pitchline::elements::link_joint::LinkJoint;
use pitchline::geometry::chain::bush::{BushChain, RowSpec};
use pitchline::geometry::profile::{Element, Profile};
use pitchline::geometry::sprocket::{GapForm, Sprocket, SprocketError, SprocketSpec};
use pitchline::geometry::{Vec2, unit};
use pitchline::integrate::explicit;
use pitchline::model::Model;
use pitchline::pairs::bush_gap::gap_contact;
use pitchline::state::State;
use std::f64::consts::PI;

fn spec(teeth: u32, pitch_mm: f64, roller_mm: f64, form: GapForm) -> SprocketSpec {
    SprocketSpec { teeth, pitch_m: pitch_mm * 1e-3, roller_diameter_m: roller_mm * 1e-3, form, tip_diameter_m: None }
}

/// A small deterministic generator (xorshift64*), so that random poses are the same everywhere.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

#[test]
fn iso_606_teeth_have_the_worked_numbers() {
    // Computed by hand from ISO 606 for z = 20 and 40 (8 mm, 5 mm) and z = 28 (9.525 mm, 6.35 mm) [mm].
    let s = Sprocket::new(spec(20, 8.0, 5.0, GapForm::Min)).expect("a tooth");
    let near = |name: &str, value_m: f64, mm: f64, tolerance_mm: f64| {
        assert!((value_m * 1e3 - mm).abs() < tolerance_mm, "{name}: {} mm, expected {mm}", value_m * 1e3);
    };
    near("d", 2.0 * s.pitch_radius_m, 51.1396, 5e-5);
    near("d_f", 2.0 * s.root_radius_m, 46.1396, 5e-5);
    near("d_a,min", 2.0 * s.tip_radius_min_m, 53.4996, 5e-5);
    near("d_a,max", 2.0 * s.tip_radius_max_m, 56.1396, 5e-5);
    near("r_i", s.seat_radius_m, 2.525, 1e-9);
    near("r_e", s.flank_radius_m, 13.2, 1e-9);
    near("flank centre x", s.flank_centre.x, 14.55412, 5e-6);
    near("flank centre y", s.flank_centre.y, 19.64056, 5e-6);
    near("pointed", s.pointed_radius_m, 28.494, 5e-4);
    assert!((s.seat_angle_rad.to_degrees() - 135.5).abs() < 1e-9);
    let m = Sprocket::new(spec(20, 8.0, 5.0, GapForm::Max)).expect("a tooth");
    near("r_i max", m.seat_radius_m, 2.64299, 5e-6);
    near("r_e max", m.flank_radius_m, 23.2, 1e-9);
    near("flank centre x max", m.flank_centre.x, 21.85613, 5e-6);
    near("flank centre y max", m.flank_centre.y, 11.92261, 5e-6);
    near("pointed max", m.pointed_radius_m, 27.413, 5e-4);
    let f = Sprocket::new(spec(40, 8.0, 5.0, GapForm::Min)).expect("a tooth");
    near("d 40", 2.0 * f.pitch_radius_m, 101.9640, 5e-5);
    near("flank centre x 40", f.flank_centre.x, 25.86178, 5e-6);
    near("flank centre y 40", f.flank_centre.y, 41.01478, 5e-6);
    let t = Sprocket::new(spec(28, 9.525, 6.35, GapForm::Max)).expect("a tooth");
    near("d 28", 2.0 * t.pitch_radius_m, 85.0716, 5e-5);
    near("d_f 28", 2.0 * t.root_radius_m, 78.7216, 5e-5);
    near("d_a,min 28", 2.0 * t.tip_radius_min_m, 87.702, 5e-4);
    near("d_a,max 28", 2.0 * t.tip_radius_max_m, 90.628, 5e-4);
}

#[test]
fn every_sprocket_from_9_to_150_teeth_is_closed_smooth_and_inside_its_tip_circle_or_refused_with_a_number() {
    for teeth in 9..=150 {
        for form in [GapForm::Min, GapForm::Max] {
            let s = Sprocket::new(spec(teeth, 8.0, 5.0, form)).unwrap_or_else(|e| panic!("z = {teeth} {form:?}: {e}"));
            let profile = s.profile().expect("connected");
            for (i, kink) in profile.kinks_rad().iter().enumerate() {
                // Corners only between flank and tip land: elements 0 and 3 of each gap.
                let corner = i % 5 == 0 || i % 5 == 3;
                assert!(corner || kink.abs() < 1e-9, "z = {teeth}: kink {kink} rad at element {i}");
            }
            let area = profile.area_properties().area_m2;
            let (low, high) = (PI * s.root_radius_m.powi(2), PI * s.tip_radius_m.powi(2));
            assert!(low < area && area < high, "z = {teeth}: area {area} between {low} and {high}");
        }
    }
    let pointed = SprocketSpec { tip_diameter_m: Some(55.2e-3), ..spec(20, 8.0, 5.0, GapForm::Max) };
    assert!(
        matches!(Sprocket::new(pointed), Err(SprocketError::Pointed { largest_tip_diameter_m }) if largest_tip_diameter_m < 54.83e-3)
    );
    assert!(matches!(Sprocket::new(spec(3, 8.0, 5.0, GapForm::Max)), Err(SprocketError::Teeth(3))));
}

#[test]
fn area_properties_of_a_ring_segment_and_a_rectangle_are_exact() {
    let (a, b) = (3e-3, 5e-3);
    let corner = |x: f64, y: f64| Vec2::new(x, y);
    let points = [corner(0.0, 0.0), corner(a, 0.0), corner(a, b), corner(0.0, b)];
    let lines = (0..4).map(|i| Element::Line { start: points[i], end: points[(i + 1) % 4] }).collect();
    let p = Profile::new(lines, true).expect("closed").area_properties();
    assert!((p.area_m2 / (a * b) - 1.0).abs() < 1e-13);
    assert!((p.polar_moment_m4 / (a * b * (a * a + b * b) / 12.0) - 1.0).abs() < 1e-12);
    let circle = Profile::new(
        vec![Element::Arc { centre: Vec2::new(1e-3, 2e-3), radius_m: a, start_rad: 0.3, sweep_rad: 2.0 * PI }],
        true,
    );
    let p = circle.expect("closed").area_properties();
    assert!((p.area_m2 / (PI * a * a) - 1.0).abs() < 1e-12);
    assert!((p.centroid - Vec2::new(1e-3, 2e-3)).norm() < 1e-15);
    assert!((p.polar_moment_m4 / (0.5 * PI * a.powi(4)) - 1.0).abs() < 1e-11);
}

#[test]
fn closest_point_and_offset_agree_along_a_tooth() {
    let s = Sprocket::new(spec(20, 8.0, 5.0, GapForm::Max)).expect("a tooth");
    let profile = s.profile().expect("closed");
    let mut random = Random(7);
    for _ in 0..2000 {
        let i = random.between(0.0, profile.elements().len() as f64) as usize;
        // Away from the corners, where feet are not unique.
        let along = random.between(0.05, 0.95);
        let e = profile.elements()[i];
        let d = random.between(-8e-6, 8e-6);
        let foot = profile.closest(e.point(along) + e.normal(along) * d);
        assert!((foot.distance_m - d).abs() < 1e-12, "element {i}: {} for {d}", foot.distance_m);
        assert!((foot.normal - e.normal(along)).norm() < 1e-9);
        let offset = e.offset(d).expect("small offset");
        assert!((offset.point(along) - e.point(along) - e.normal(along) * d).norm() < 1e-15);
    }
}

#[test]
fn contacts_by_seat_index_equal_brute_force_on_100_000_random_poses() {
    let mut touching = 0;
    for (teeth, form, seed) in [(20, GapForm::Max, 11), (40, GapForm::Min, 12)] {
        let s = Sprocket::new(spec(teeth, 8.0, 5.0, form)).expect("a tooth");
        let profile = s.profile().expect("closed");
        let r = 2.5e-3;
        let mut random = Random(seed);
        for _ in 0..50_000 {
            let radius = random.between(s.root_radius_m + 2.3e-3, s.tip_radius_m + 2.6e-3);
            let centre = unit(random.between(-PI, PI)) * radius;
            let all = contour::touches(&profile, centre, r);
            let local = gap_contact(&s, centre, r);
            // A bush in a gap contacts at most one element; deep inside a tooth it may overlap several, and the local
            // search returns one of them.
            match all.as_slice() {
                [] => assert!(local.touch.penetration_m <= 1e-12, "local search alone touches at {centre}: {local:?}"),
                several => {
                    touching += 1;
                    let same = several.iter().any(|t| {
                        (t.penetration_m - local.touch.penetration_m).abs() < 1e-12
                            && (t.normal - local.touch.normal).norm() < 1e-6
                    });
                    assert!(same, "{several:?} against {local:?} at {centre}");
                }
            }
        }
    }
    println!("{touching} of 100000 poses touch");
    assert!(touching > 20_000);
}

/// Integrates m d'' = -F(d, d') from first contact at `speed` by fine Runge-Kutta steps; returns (rebound speed, depth,
/// duration).
fn impact(law: &ContactLaw, mass: f64, speed: f64, steps_in_contact: f64) -> (f64, f64, f64) {
    let radii = PairRadii { bush_m: 2.5e-3, body_m: 13.2e-3 };
    let force = |d: f64, v: f64| law.force(d.max(0.0), v, speed, radii);
    let guess = PI * (mass * 1e-5 / law.elastic(1e-5, radii).force_n.max(1e-9)).sqrt();
    let h = guess / steps_in_contact;
    let (mut d, mut v, mut t, mut deepest) = (0.0_f64, speed, 0.0, 0.0_f64);
    let a = |d: f64, v: f64| -force(d, v) / mass;
    loop {
        let (k1v, k1d) = (a(d, v), v);
        let (k2v, k2d) = (a(d + 0.5 * h * k1d, v + 0.5 * h * k1v), v + 0.5 * h * k1v);
        let (k3v, k3d) = (a(d + 0.5 * h * k2d, v + 0.5 * h * k2v), v + 0.5 * h * k2v);
        let (k4v, k4d) = (a(d + h * k3d, v + h * k3v), v + h * k3v);
        let (next_d, next_v) =
            (d + h / 6.0 * (k1d + 2.0 * k2d + 2.0 * k3d + k4d), v + h / 6.0 * (k1v + 2.0 * k2v + 2.0 * k3v + k4v));
        if v > 0.0 && next_v <= 0.0 {
            // Deepest point: d + v^2 / (2 |a|) from the step's start, with constant curvature over a fraction of a
            // step.
            deepest = d - v * v / (2.0 * a(d, 0.5 * v));
        }
        if next_d <= 0.0 {
            let share = d / (d - next_d);
            return (-(v + share * (next_v - v)), deepest, t + share * h);
        }
        (d, v, t) = (next_d, next_v, t + h);
    }
}

#[test]
fn restitution_law_returns_what_is_asked_for_and_lankarani_nikravesh_what_it_returns() {
    for e in [0.3, 0.5, 0.71, 0.9, 0.99] {
        let law = ContactLaw::Power { stiffness_n_per_m_n: 1e9, exponent: 1.5, hysteresis: restitution_hysteresis(e) };
        let out = impact(&law, 0.01, 1.0, 20_000.0).0;
        println!("restitution asked {e}, returned {out:.6}");
        assert!((out - e).abs() < 1e-4, "asked {e}, got {out}");
    }
    // Exact oracle lambda (1 + e) = ln[(1 + lambda)/(1 - lambda e)] solved for e at lambda = 0.75 (1 - e_in^2).
    for (asked, returned) in [(0.99, 0.9901), (0.9, 0.9132), (0.71, 0.8005), (0.5, 0.7253), (0.3, 0.6842)] {
        let hysteresis = pitchline::elements::contact_law::lankarani_nikravesh_hysteresis(asked);
        let law = ContactLaw::Power { stiffness_n_per_m_n: 3e8, exponent: 1.1, hysteresis };
        let out = impact(&law, 0.002, 2.0, 20_000.0).0 / 2.0;
        println!("Lankarani-Nikravesh asked {asked}, returned {out:.5}");
        assert!((out - returned).abs() < 1e-4, "asked {asked}, oracle {returned}, got {out}");
    }
}

#[test]
fn undamped_impacts_have_the_closed_form_depth_and_duration() {
    // d_max = [(n+1) m v^2 / (2 K)]^(1/(n+1)); t_c = 2 (d_max/v) sqrt(pi) Gamma(1 + 1/(n+1)) / Gamma(1/2 + 1/(n+1)).
    for (n, k, m, v) in [(1.0, 1e8, 1.4e-3, 2.4), (1.5, 1e9, 0.01, 1.0)] {
        let law = ContactLaw::Power { stiffness_n_per_m_n: k, exponent: n, hysteresis: 0.0 };
        let depth = libm::pow((n + 1.0) * m * v * v / (2.0 * k), 1.0 / (n + 1.0));
        let q = 1.0 / (n + 1.0);
        let duration = 2.0 * depth / v * PI.sqrt() * libm::tgamma(1.0 + q) / libm::tgamma(0.5 + q);
        let (rebound, d, t) = impact(&law, m, v, 20_000.0);
        println!(
            "n = {n}: depth {:.4e} (error {:.1e}), duration {:.4e} (error {:.1e})",
            depth,
            d / depth - 1.0,
            duration,
            t / duration - 1.0
        );
        assert!(
            (d / depth - 1.0).abs() < 1e-6 && (t / duration - 1.0).abs() < 1e-6 && (rebound / v - 1.0).abs() < 1e-6
        );
    }
}

#[test]
fn hertz_line_contact_inverts_its_approach_and_its_energy_is_the_integral_of_its_force() {
    let c = (1.0 - 0.09) / 2.07e11;
    let hertz =
        HertzLine { length_m: 5e-3, compliance_body_per_pa: c, compliance_bush_per_pa: c, damping_n_s_per_m: 0.0 };
    let (r1, r2) = (2.5e-3, 13.2e-3);
    let mut last = 0.0;
    for i in 1..=400 {
        let d = f64::from(i) * 0.05e-6;
        let e = hertz.elastic(d, r1, r2);
        assert!(e.force_n > last, "monotone");
        last = e.force_n;
        // Johnson's approach at this force.
        let q = e.force_n / 5e-3;
        let relative = 1.0 / (1.0 / r1 + 1.0 / r2);
        let a = (4.0 * q * relative * (2.0 * c) / PI).sqrt();
        let approach = q / PI * (c * (2.0 * (4.0 * r1 / a).ln() - 1.0) + c * (2.0 * (4.0 * r2 / a).ln() - 1.0));
        assert!((approach / d - 1.0).abs() < 1e-9, "{approach} for {d}");
        let h = 1e-3 * d;
        let (up, down) = (hertz.elastic(d + h, r1, r2), hertz.elastic(d - h, r1, r2));
        assert!(((up.energy_j - down.energy_j) / (2.0 * h) / e.force_n - 1.0).abs() < 1e-5);
        assert!(((up.force_n - down.force_n) / (2.0 * h) / e.stiffness_n_per_m - 1.0).abs() < 1e-5);
    }
    println!("secant stiffness at {last:.0} N: {:.3e} N/m", last / 20e-6);
}

#[test]
fn polygon_effect_of_twenty_teeth_has_its_closed_form() {
    // At low speed, stiff, frictionless: joints on the wrap at constant omega; the span's speed is w R cos(theta).
    let mut overrides = vec![
        "speeds.constant.driver.speed_rpm=15",
        "loads.constant.driven.torque_nm=5",
        "chain.joint.stiffness_n_per_m=3e8",
        "run.run_in_ms=40",
        "sprockets.driven.teeth=40",
        // The polygon effect cannot move a driven inertia this large, so that the chain follows the driver's polygon.
        "sprockets.driven.inertia_kg_m2=1e-4",
    ];
    overrides.extend(NO_FRICTION);
    let a = assembled(&drive_without_guides(&overrides));
    let s = &a.model.sprockets[0];
    let (radius, omega) = (s.geometry.pitch_radius_m(), s.nominal_speed_rad_s);
    let tooth_period = 2.0 * PI / (omega * 20.0);
    let model = a.model.clone();
    let mut state = a.state.clone();
    // Height of the joint that runs on, and speed along the tight span of the last joint before contact.
    let (mut speeds, mut heights) = (Vec::new(), Vec::new());
    let direction = model.routes.first().expect("a route").span_after(1).direction;
    let normal = Vec2::new(direction.y, -direction.x);
    watch(&a.model, &mut state, (3.0 * tooth_period / model.step_s) as u64, |state, _| {
        // Mean over the links of the tight span without tooth contact.
        let l = &state.links;
        let span = model.routes.first().expect("a route").span_after(1);
        let along = |i: usize| (Vec2::new(l.x[i], l.y[i]) - span.start).dot(&span.direction);
        let across = |i: usize| (Vec2::new(l.x[i], l.y[i]) - span.start).dot(&normal).abs();
        let inside: Vec<usize> = (0..state.lanes)
            .filter(|i| across(*i) < 5e-3 && along(*i) > 16e-3 && along(*i) < span.length_m - 16e-3)
            .collect();
        speeds.push(
            inside.iter().map(|i| l.vx[*i] * direction.x + l.vy[*i] * direction.y).sum::<f64>() / inside.len() as f64,
        );
        // Joints on the wrap near the run-on point: the highest one.
        let highest = (0..state.lanes)
            .map(|i| {
                Vec2::new(l.x[i] + model.chain.lever[i] * l.cos[i], l.y[i] + model.chain.lever[i] * l.sin[i])
                    - s.frame.origin
            })
            .filter(|p| p.norm() < radius * 1.02)
            .map(|p| p.dot(&normal))
            .fold(0.0, f64::max);
        heights.push(highest);
    });
    // Box means over a hundredth of a tooth period remove the ringing of the seating impacts (the speed of an impact, p
    // omega, is a third of the chain's at any speed), and shorten the cusp of |cos| by less than 1 %.
    let window = (tooth_period / 100.0 / model.step_s) as usize;
    let smooth: Vec<f64> = speeds.chunks_exact(window).map(|c| c.iter().sum::<f64>() / window as f64).collect();
    let (low, high) = smooth.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
    let ripple = (high - low) / high;
    let rise = heights.iter().fold(f64::MIN, |m, v| m.max(*v)) - heights.iter().fold(f64::MAX, |m, v| m.min(*v));
    let closed = (1.0 - (PI / 20.0).cos(), radius * (1.0 - (PI / 20.0).cos()));
    println!(
        "span speed ripple {:.4} % (closed form {:.4} %), joint rise {:.4} mm (closed form {:.4} mm)",
        ripple * 100.0,
        closed.0 * 100.0,
        rise * 1e3,
        closed.1 * 1e3
    );
    assert!((ripple / closed.0 - 1.0).abs() < 0.02, "ripple");
    assert!((rise / closed.1 - 1.0).abs() < 0.02, "rise");
}

/// A chain of 8 mm pitch with both rows as given.
fn bush_chain(row: RowSpec) -> BushChain {
    BushChain {
        pitch_m: 8e-3,
        bush_diameter_m: 5e-3,
        pin_diameter_m: 3.3e-3,
        inner_width_m: 5e-3,
        plate_height_m: 7.1e-3,
        plate_thickness_m: 1.5e-3,
        density_kg_m3: 7850.0,
        is_cranked: false,
        rollers: None,
        inner: row,
        outer: row,
    }
}

/// Links of one kind, 8 mm, with given mass and inertia.
fn uniform_rows(mass_kg: f64, inertia_kg_m2: f64) -> Vec<pitchline::geometry::chain::LinkShape> {
    let row = RowSpec { pitch_m: None, mass_kg: Some(mass_kg), inertia_kg_m2: Some(inertia_kg_m2) };
    bush_chain(row).rows().expect("rows").to_vec()
}

#[test]
fn cranked_links_are_equal_and_as_heavy_as_the_two_rows_are_on_average() {
    let chain = bush_chain(RowSpec::default());
    let [inner, outer] = chain.rows().expect("rows");
    let [a, b] = BushChain { is_cranked: true, ..chain }.rows().expect("rows");
    println!(
        "inner {:.3} g, outer {:.3} g, cranked {:.3} g",
        1e3 * inner.mass_kg,
        1e3 * outer.mass_kg,
        1e3 * a.mass_kg
    );
    assert_eq!((a.mass_kg, a.inertia_kg_m2, &a.circles), (b.mass_kg, b.inertia_kg_m2, &b.circles));
    assert_eq!((a.bush_radius_m, b.bush_radius_m), (Some(2.5e-3), Some(2.5e-3)));
    assert!((a.mass_kg - 0.5 * (inner.mass_kg + outer.mass_kg)).abs() < 1e-15);
    assert!((a.inertia_kg_m2 - 0.5 * (inner.inertia_kg_m2 + outer.inertia_kg_m2)).abs() < 1e-18);
}

fn plain_joint(stiffness_n_per_m: f64) -> LinkJoint {
    LinkJoint {
        stiffness_n_per_m,
        damping_n_s_per_m: 0.0,
        clearance_m: 0.0,
        friction_arm_m: 0.0,
        stick_speed_rad_s: 10.0,
    }
}

#[test]
fn rotating_ring_of_chain_carries_the_centrifugal_tension_of_its_discrete_form() {
    // N rigid links tangent to a circle: each turns about the axis at the distance r of its middle, so that m r w^2 = 2
    // T sin(pi/N).
    let (n, m, stiffness) = (40, 3.2e-3, 3e8);
    let model = Model::chain_only(n, uniform_rows(m, 4e-8), plain_joint(stiffness), 0.5e-6);
    let omega = 200.0;
    let half = PI / n as f64;
    // Polygon of links: middle radius r0 unloaded; the joint elongation u increases it by u / (2 tan half).
    let mut r = 4e-3 / half.tan();
    let mut tension = 0.0;
    for _ in 0..50 {
        tension = m * r * omega * omega / (2.0 * half.sin());
        // Two ends pull apart along the bisector's tangent by u = T / k: side length grows by u cos(half).
        r = (4e-3 + 0.5 * tension / stiffness / half.cos()) / half.tan();
    }
    let mut state = State::at_rest(&model.layout());
    for i in 0..n {
        let angle = 2.0 * half * i as f64;
        let e = unit(angle);
        (state.links.x[i], state.links.y[i]) = (r * e.x, r * e.y);
        (state.links.cos[i], state.links.sin[i]) = (-e.y, e.x);
        (state.links.vx[i], state.links.vy[i]) = (-omega * r * e.y, omega * r * e.x);
        state.links.omega[i] = omega;
    }
    let (mut sum, mut count) = (0.0, 0.0);
    let revolution = (2.0 * PI / omega / model.step_s) as u64;
    watch(&model, &mut state, revolution, |_, scratch| {
        for j in 0..n {
            let (x, y, _) = scratch.joint_force(j);
            sum += x.hypot(y);
            count += 1.0;
        }
    });
    let mean = sum / count;
    println!("ring: tension {mean:.5} N, discrete closed form {tension:.5} N ({:+.2e})", mean / tension - 1.0);
    assert!((mean / tension - 1.0).abs() < 1e-3);
}

#[test]
fn held_span_of_rigid_links_swings_at_the_discrete_closed_form_frequencies() {
    // w^2 = 4 T sin^2(q/2) / (p [m cos^2(q/2) + (4 J/p^2) sin^2(q/2)]), q = mode pi / N.
    let (span, m, inertia, tension, p) = (12_usize, 3.2e-3, 4e-8, 300.0, 8e-3);
    let stiffness = 1e9;
    // A closed loop: `span` free links, the others fixed in a line that leads back.
    let n = 2 * span;
    let mut model = Model::chain_only(n, uniform_rows(m, inertia), plain_joint(stiffness), 0.2e-6);
    for i in span..n {
        model.chain.fix_link(i);
    }
    let stretch = tension / stiffness;
    for mode in [1, 2, 5] {
        let q = f64::from(mode) * PI / span as f64;
        let (s2, c2) = ((0.5 * q).sin().powi(2), (0.5 * q).cos().powi(2));
        let expected = (4.0 * tension * s2 / (p * (m * c2 + 4.0 * inertia / (p * p) * s2))).sqrt();
        let mut state = State::at_rest(&model.layout());
        let pitch = p + stretch;
        let amplitude = 2e-6;
        let shape = |joint: usize| amplitude * (q * joint as f64).sin();
        for i in 0..span {
            let (a, b) = (shape(i), shape(i + 1));
            state.links.x[i] = (i as f64 + 0.5) * pitch;
            state.links.y[i] = 0.5 * (a + b);
            let angle = (b - a) / p;
            (state.links.sin[i], state.links.cos[i]) = angle.sin_cos();
        }
        // The fixed links lead straight back, so that every joint of the loop is closed.
        let (first, last) = (span as f64 * pitch + 0.5 * stretch - 0.5 * p, 0.5 * p - 0.5 * stretch);
        for i in span..n {
            let share = (i - span) as f64 / (span - 1) as f64;
            state.links.x[i] = first + (last - first) * share;
            (state.links.cos[i], state.links.sin[i]) = (-1.0, 0.0);
        }
        let mut crossings: Vec<f64> = Vec::new();
        let watched = (span as f64 / f64::from(mode) / 2.0) as usize;
        let mut before = f64::NAN;
        let h = model.step_s;
        let steps = (4.2 * 2.0 * PI / expected / h) as u64;
        watch(&model, &mut state, steps, |state, _| {
            let y = state.links.y[watched];
            if before > 0.0 && y <= 0.0 {
                crossings.push((state.step as f64 - y / (y - before)) * h);
            }
            before = y;
        });
        let periods = crossings.len() - 1;
        let measured = 2.0 * PI * periods as f64 / (crossings[periods] - crossings[0]);
        println!(
            "mode {mode}: {:.3} Hz, closed form {:.3} Hz ({:+.2e})",
            measured / (2.0 * PI),
            expected / (2.0 * PI),
            measured / expected - 1.0
        );
        assert!((measured / expected - 1.0).abs() < 1e-3, "mode {mode}");
    }
}

#[test]
fn tension_falls_along_the_wrap_as_binder_says() {
    // Static, frictionless, at each seated joint: T_(k+1)/T_k = sin(gamma)/sin(gamma + 2 pi/z) with gamma the angle between
    // the tooth's normal and the link's chord (Binder 1956). At rest, no centrifugal tension.
    let mut overrides =
        vec!["preload.tension_n=600", "loads.constant.driven.torque_nm=40", "run.run_in_ms=0", "run.settle_ms=0"];
    overrides.extend(NO_FRICTION);
    overrides.push("speeds.constant.driver.speed_rpm=0.001");
    let mut a = assembled(&drive(&overrides));
    let mut scratch = explicit::Scratch::new(&a.model);
    // A State assembled at rest does not contain the joint and contact forces of a previous step.
    for _ in 0..200 {
        explicit::step(&a.model, &mut a.state, &mut scratch).expect("holds");
    }
    explicit::evaluate(&a.model, &a.state, &mut scratch).expect("holds");
    let contacts = pitchline::recording::capture::contacts_of(&a.model, &a.state, &scratch, None);
    let l = &a.state.links;
    let chord = |k: usize| Vec2::new(l.cos[k], l.sin[k]);
    let joint_force = |j: usize| Vec2::new(scratch.joint_force(j).0, scratch.joint_force(j).1);
    let mut worst = 0.0_f64;
    let mut gammas = Vec::new();
    for i in 0..contacts.link.len() {
        if contacts.body[i] != 0 || contacts.normal_force_n[i] < 5.0 {
            continue;
        }
        let link = contacts.link[i] as usize;
        let joint = if contacts.feature[i] == 1 { link } else { (link + 89) % 90 };
        let (ahead, behind) = ((joint + 1) % 90, joint);
        let n = Vec2::new(contacts.normal_x[i], contacts.normal_y[i]);
        let tooth = n * contacts.normal_force_n[i];
        // The joint force acts on the link ahead; the tooth acts on the inner one of the two links.
        let on_ahead = joint_force(joint) + if link == ahead { tooth } else { Vec2::zeros() };
        let on_behind = -joint_force(joint) + if link == behind { tooth } else { Vec2::zeros() };
        // Tensions: forces that pull each link's end outwards along its chord.
        let (t_ahead, t_behind) = (-on_ahead.dot(&chord(ahead)), on_behind.dot(&chord(behind)));
        // T_ahead t_ahead - T_behind t_behind + N n = 0, crossed with n: sin(gamma) over sin(gamma + 2 pi / z).
        let cross = pitchline::geometry::cross;
        let ratio = cross(chord(behind), n) / cross(chord(ahead), n);
        worst = worst.max(((t_ahead / t_behind) / ratio - 1.0).abs());
        let turn = cross(chord(behind), chord(ahead)).atan2(chord(behind).dot(&chord(ahead)));
        let (low, high) = (cross(chord(behind), n).asin().abs(), cross(chord(ahead), n).asin().abs());
        gammas.push((low.min(high).to_degrees(), turn.to_degrees(), t_ahead / t_behind));
    }
    for (gamma, turn, ratio) in &gammas {
        println!("gamma {gamma:.2} deg, articulation {turn:.2} deg, tension ratio {ratio:.4}");
    }
    println!("Binder: {} seated bushes, worst deviation of the tension ratio {worst:.2e}", gammas.len());
    assert!(gammas.len() >= 4 && worst < 0.05, "{} bushes, {worst}", gammas.len());
}
