//! Reading guides and rails: `[guides]`.

use super::reader::TomlTable;
use super::{ArmSpec, GuideSpec, RailSpec};
use crate::elements::beam::{Beam, MAX_MODES, Support};
use crate::geometry::Vec2;
use crate::geometry::guide::GuideSide;
use crate::geometry::rail::Stretch;
use crate::units::{DEG, MM, UM};

/// The sprocket that the way of `span = ["a", "b"]` leaves.
pub(super) fn read_span(t: &TomlTable<'_>, chains: &[Vec<String>]) -> usize {
    let span = t.texts("span").unwrap_or_default();
    let mut before = 0;
    let mut spans = Vec::new();
    for names in chains {
        let pairs = (0..names.len()).map(|i| (i, &names[i], &names[(i + 1) % names.len()]));
        for (i, from, to) in pairs {
            if let [a, b] = &span[..]
                && (a, b) == (from, to)
            {
                return before + i;
            }
            spans.push(format!("[\"{from}\", \"{to}\"]"));
        }
        before += names.len();
    }
    t.error(format!("`{}.span` is no span of the route", t.path()), Some(format!("spans here: {}", spans.join(", "))));
    0
}

const SIDES: [(&str, GuideSide); 2] = [("inside", GuideSide::Inside), ("outside", GuideSide::Outside)];

/// `all_names`: those of sprockets and fixed guides.
pub(super) fn read_rails(
    guides: &TomlTable<'_>,
    chains: &[Vec<String>],
    arms: &[ArmSpec],
    all_names: &[String],
) -> Vec<RailSpec> {
    let table = guides.table("rail");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        if all_names.contains(&name) {
            t.error(format!("a rail and another body are called `{name}`"), Some("give the rail another name".into()));
        }
        let known = || arms.iter().map(|a| a.name.as_str()).collect::<Vec<_>>().join(", ");
        let arm = t.text("arm").map(|arm| {
            arms.iter().position(|a| a.name == arm).unwrap_or_else(|| {
                t.error_at("arm", format!("no arm is called `{arm}`"), Some(format!("arms: {}", known())));
                0
            })
        });
        let lengths_m = t.list("lengths_mm", MM, 1e-3..=1e5);
        if !t.has("lengths_mm") {
            t.error(
                format!("`{}` has no stretches", t.path()),
                Some("add `lengths_mm = [...]`, and as many `radii_mm` (0: straight, negative: concave)".into()),
            );
        }
        let lengths_m = lengths_m.unwrap_or_default();
        let radii_m = t.list("radii_mm", MM, -1e6..=1e6).unwrap_or_else(|| vec![0.0; lengths_m.len()]);
        if radii_m.len() != lengths_m.len() && !lengths_m.is_empty() {
            t.error_at("radii_mm", format!("{} lengths, {} radii", lengths_m.len(), radii_m.len()), None);
        }
        let stretch =
            |(length_m, r): (&f64, &f64)| Stretch { length_m: *length_m, radius_m: (*r != 0.0).then_some(*r) };
        all.push(RailSpec {
            span: read_span(&t, chains),
            arm,
            side: t.choice("side", &SIDES).unwrap_or(GuideSide::Inside),
            start: Vec2::new(t.required("start_x_mm", MM, -1e5..=1e5), t.required("start_y_mm", MM, -1e5..=1e5)),
            heading_rad: t.required("heading_deg", DEG, -360.0..=360.0),
            stretches: lengths_m.iter().zip(&radii_m).map(stretch).collect(),
            bending: read_bending(&t.table("bending"), arm.is_some(), &lengths_m),
            name,
        });
        t.finish();
    }
    table.finish();
    all
}

/// `[guides.rail.NAME.bending]`; None where there is none.
fn read_bending(t: &TomlTable<'_>, on_arm: bool, lengths_m: &[f64]) -> Option<Beam> {
    if !t.is_present() {
        return None;
    }
    if on_arm {
        t.error("a rail on an arm is rigid yet".into(), Some("hold the blade by pins, clamps or springs".into()));
    }
    let places = |key: &str| t.list(key, MM, 0.0..=1e5).unwrap_or_default();
    let (pins, clamps, springs) = (places("pins_mm"), places("clamps_mm"), places("springs_mm"));
    let stiffnesses = t.list("springs_n_per_mm", 1e3, 1e-3..=1e6).unwrap_or_default();
    if stiffnesses.len() != springs.len() {
        let counts = format!("{} springs_mm, {} springs_n_per_mm", springs.len(), stiffnesses.len());
        t.error(counts, Some("give as many of each".into()));
    }
    let mut supports: Vec<(f64, Support)> = pins.into_iter().map(|at| (at, Support::Pin)).collect();
    supports.extend(clamps.into_iter().map(|at| (at, Support::Clamp)));
    supports.extend(springs.into_iter().zip(stiffnesses).map(|(at, k)| (at, Support::Spring(k))));
    let length_m: f64 = lengths_m.iter().sum();
    if let Some((at, _)) = supports.iter().find(|(at, _)| *at > length_m * (1.0 + 1e-9)) {
        t.error(format!("a support at {:.3} mm of a rail {:.3} mm long", at / MM, length_m / MM), None);
    }
    supports.sort_by(|a, b| a.0.total_cmp(&b.0));
    if supports.windows(2).any(|s| s[1].0 - s[0].0 < CLOSEST_SUPPORTS * length_m) {
        t.error("two supports stand at one place".into(), Some("keep one of them".into()));
    }
    if supports.iter().map(|(_, s)| s.holds()).sum::<usize>() < 2 {
        t.error("nothing holds the blade".into(), Some("give two `pins_mm`, or one of `clamps_mm`".into()));
    }
    let free_radii_m = t.list("free_radii_mm", MM, -1e6..=1e6);
    if let Some(all) = &free_radii_m {
        if all.iter().any(|r| *r != 0.0 && r.abs() < SMALLEST_FREE_RADIUS_M) {
            let help = format!("0 is straight; else at least {} mm", SMALLEST_FREE_RADIUS_M / MM);
            t.error_at("free_radii_mm", "a blade is not bent so much".into(), Some(help));
        }
        if all.len() != lengths_m.len() {
            let title = format!("a rail of {} stretches", lengths_m.len());
            t.error_at("free_radii_mm", title, Some("give as many".into()));
        }
    }
    let curvature = |r: f64| if r == 0.0 { 0.0 } else { 1.0 / r };
    let bending = Beam {
        stiffness_n_m2: t.required("stiffness_n_m2", 1.0, 1e-6..=1e6),
        mass_kg_per_m: t.required("mass_kg_per_m", 1.0, 1e-4..=1e3),
        free_curvatures_per_m: free_radii_m.map(|all| all.into_iter().map(curvature).collect()),
        supports,
        damping_ratio: t.number("damping_ratio", 1.0, 0.0..=1.0).unwrap_or(DEFAULT_BLADE_DAMPING),
        modes: t.integer("modes", 1..=MAX_MODES as i64).unwrap_or(DEFAULT_MODES) as usize,
    };
    t.finish();
    Some(bending)
}

/// Least distance of two supports, as a share of the blade's length.
const CLOSEST_SUPPORTS: f64 = 1e-3;
/// Least radius of a blade without load [m].
const SMALLEST_FREE_RADIUS_M: f64 = 1e-3;
/// Damping ratio of a blade where none is given. assumed: PA66 at 100 degrees Celsius has a loss factor of 0.05 to 0.1.
const DEFAULT_BLADE_DAMPING: f64 = 0.03;
/// Modes of a blade where no number is given: with four, a cantilever's tip is soft to 0.1 %.
const DEFAULT_MODES: i64 = 4;

pub(super) fn read_guides(guides: &TomlTable<'_>, chains: &[Vec<String>]) -> Vec<GuideSpec> {
    let fixed = guides.table("fixed");
    let mut all = Vec::new();
    for (name, t) in fixed.tables() {
        all.push(GuideSpec {
            span: read_span(&t, chains),
            side: t.choice("side", &SIDES).unwrap_or(GuideSide::Inside),
            start_m: t.required("start_mm", MM, -1000.0..=1e5),
            end_m: t.required("end_mm", MM, -1000.0..=1e5),
            clearance_m: t.number("clearance_um", UM, -1e5..=1e6).unwrap_or(0.0),
            end_lift_m: t.number("end_lift_um", UM, -5000.0..=5000.0).unwrap_or(0.0),
            end_radius_m: t.number("end_radius_mm", MM, 0.1..=1e4).unwrap_or(20.0 * MM),
            name,
        });
        t.finish();
    }
    fixed.finish();
    all
}
