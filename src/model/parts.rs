//! Parts of a drive as the steps need them: coordinates of sprockets, guides, rails, bodies that contours touch. Bodies that stand in each
//! other's way are mistakes of the drive.

use super::place::{PlacedDrive, gap_shifts};
use super::{ArmModel, GuideModel, Model, RailModel, SprocketModel, Toothing};
use crate::diag::Diag;
use crate::drive::{ChainSpec, Drive, OuterSpec, RailSpec, SprocketDrive};
use crate::elements::body_frame::BodyFrame;
use crate::elements::coordinate::{Coordinate, CoordinateKind, CoordinateMotion, CoordinateSpring};
use crate::geometry::chain::LinkShape;
use crate::geometry::guide::{GuideSide, StraightGuide};
use crate::geometry::rail::Rail;
use crate::geometry::route::Route;
use crate::geometry::sprocket::Sprocket;
use crate::geometry::{Vec2, cross};
use crate::pairs::contour_body::{EndBody, EndShape, SeatDirections, SilentTooth};
use crate::pairs::plate_guide::GuideBody;
use crate::pairs::plate_rail::RailBody;
use crate::pairs::roller_bush::Bore;
use parry2d_f64::math::{Pose, Vector};
use parry2d_f64::query;
use parry2d_f64::shape::{Ball, Polyline};

/// The bodies that contours touch, of all chains: their numbers and coordinates are those of the joined model, whose sprockets are there already.
pub(super) fn join_end_bodies(joined: &Model, alone: &[Model]) -> Vec<EndBody> {
    let n_sprockets = joined.sprockets.len();
    let (mut first_sprocket, mut first_guide) = (0, 0);
    let mut bodies = Vec::new();
    for (chain, model) in alone.iter().enumerate() {
        let of = |b: &EndBody| {
            let sprocket = (b.body < model.sprockets.len()).then(|| first_sprocket + b.body);
            let body = sprocket.unwrap_or_else(|| n_sprockets + first_guide + b.body - model.sprockets.len());
            let frame = BodyFrame { turn: sprocket.map(|k| joined.sprockets[k].coordinate), ..b.frame.clone() };
            EndBody { chain, body, frame, ..b.clone() }
        };
        bodies.extend(model.end_bodies.iter().map(of));
        (first_sprocket, first_guide) = (first_sprocket + model.sprockets.len(), first_guide + model.guides.len());
    }
    bodies
}

/// What sprockets turn by: one coordinate each, in their order.
pub(super) fn build_coordinates(drive: &Drive, sprockets: &[SprocketModel], sense: f64) -> Vec<Coordinate> {
    let of = |(spec, s): (&SprocketDrive, &SprocketModel)| Coordinate {
        path: format!("sprockets.{}", s.name),
        kind: CoordinateKind::Turns,
        motion: match spec.outer {
            OuterSpec::Speed { .. } => CoordinateMotion::Prescribed { speed_rad_s: s.nominal_speed_rad_s },
            OuterSpec::Load { inertia_kg_m2, torque_nm } => {
                CoordinateMotion::Free { inertia: inertia_kg_m2, load: -torque_nm * sense * spec.wrap.sign() }
            }
        },
        spring: CoordinateSpring::default(),
        nominal_speed_rad_s: s.nominal_speed_rad_s,
        reach_m: s.geometry.pitch_radius_m(),
        rest_load: 0.0,
        is_held_at_rest: false,
        is_run_in: true,
    };
    drive.sprockets.iter().zip(sprockets).map(of).collect()
}

/// How separate rollers touch their bushes.
pub(super) fn build_bore(drive: &Drive, rows: &[LinkShape]) -> Option<Bore> {
    let shape = rows.iter().find_map(|r| r.roller)?;
    let spec = drive.roller_contact?;
    Some(Bore {
        bush_radius_m: shape.bush_radius_m,
        clearance_m: shape.clearance_m,
        law: spec.law,
        friction: spec.friction,
        stick_speed_m_s: spec.stick_speed_m_s,
    })
}

pub(super) fn build_rails(drive: &Drive, placed: &PlacedDrive, arms: &[ArmModel]) -> Vec<RailModel> {
    let contact = &drive.guide_contact;
    let of = |(spec, rail): (&RailSpec, &Rail)| {
        let arm = spec.arm.map(|a| &arms[a]);
        let origin = arm.map_or(Vec2::zeros(), |a| a.pivot);
        let radius_m = drive.chain.plate_end_radius_m();
        let (low, high) = rail.bounds();
        RailModel {
            name: spec.name.clone(),
            chain: 0,
            body: RailBody::new(rail, radius_m, contact.law, friction(drive, &spec.name), contact.stick_speed_m_s),
            frame: BodyFrame { origin, turn: arm.map(|a| a.coordinate), shifts: Vec::new() },
            blade: None,
            reach_m: rail.reach_m(),
            low,
            high,
            rail: rail.clone(),
        }
    };
    drive.rails.iter().zip(&placed.rails).map(of).collect()
}

/// Rings and faces of an abutment chain, teeth of a silent chain.
pub(super) fn build_end_bodies(
    drive: &Drive,
    placed: &PlacedDrive,
    sprockets: &[SprocketModel],
    guides: &[GuideModel],
    sense: f64,
) -> Vec<EndBody> {
    let mut bodies = Vec::new();
    for (k, s) in sprockets.iter().enumerate() {
        let spec = match drive.chain {
            ChainSpec::Abutment(_) => &drive.ring_contact,
            ChainSpec::Bush(_) | ChainSpec::Silent(_) => &drive.tooth_contact,
        };
        let body = |set: usize, shape: EndShape| EndBody {
            name: format!("sprockets.{}", s.name),
            chain: s.chain,
            body: k,
            set,
            frame: s.frame.clone(),
            shape,
            law: spec.law,
            friction: spec.friction,
            stick_speed_m_s: spec.stick_speed_m_s,
        };
        let seats = || SeatDirections::new(s.geometry.teeth());
        // Rings are round whatever the gaps are.
        let gaps = || seats().shifted(gap_shifts(drive, &drive.sprockets[k]));
        match (&s.geometry, &placed.abutment, &placed.rings[k]) {
            (Toothing::Silent(sprocket), _, _) => {
                let Some(tooth) = SilentTooth::new(sprocket) else { continue };
                bodies.push(body(0, EndShape::OuterFlanks { tooth, seats: gaps() }));
                bodies.push(body(1, EndShape::InnerFlanks { tooth, seats: gaps() }));
            }
            (Toothing::Iso(sprocket), Some(_), Some(ring)) => {
                // Bushes lie ahead of the gap's axis on a sprocket that the chain drives, behind it on one that drives.
                let load_nm: f64 = match drive.sprockets[k].outer {
                    OuterSpec::Load { torque_nm, .. } => torque_nm + drive.sprockets[k].passes_on_nm,
                    OuterSpec::Speed { .. } => -total_load_nm(drive),
                };
                let ahead = if load_nm < 0.0 { -sense } else { sense };
                let (sin, cos) = crate::units::sin_cos(ahead * working_angle_rad(sprocket));
                let ring = Box::new(ring.clone());
                bodies.push(body(0, EndShape::Lobes { ring, seats: seats(), turn: (cos, sin) }));
            }
            (Toothing::Iso(_), Some(abutment), None) => {
                let radius_m = s.geometry.pitch_radius_m() - abutment.spec.distance_m;
                bodies.push(body(0, EndShape::Circle { radius_m }));
            }
            (Toothing::Iso(_), None, _) => {}
        }
    }
    for (k, g) in guides.iter().enumerate().filter(|(_, g)| !g.body.touches_plates) {
        bodies.push(EndBody {
            name: format!("guides.fixed.{}", g.name),
            chain: g.chain,
            body: sprockets.len() + k,
            set: 2,
            frame: g.frame.clone(),
            shape: EndShape::Face { along: g.body.along, length_m: g.body.length_m },
            law: g.body.law,
            friction: g.body.friction,
            stick_speed_m_s: g.body.stick_speed_m_s,
        });
    }
    bodies
}

/// What all loads together take [N m].
fn total_load_nm(drive: &Drive) -> f64 {
    let load = |s: &SprocketDrive| match s.outer {
        OuterSpec::Load { torque_nm, .. } => torque_nm + s.passes_on_nm,
        OuterSpec::Speed { .. } => 0.0,
    };
    drive.sprockets.iter().map(load).sum()
}

/// Angle by which a nominal bush on the pitch circle stands off its gap's axis when it just touches the flank [rad].
fn working_angle_rad(sprocket: &Sprocket) -> f64 {
    let bush_radius_m = 0.5 * sprocket.spec.roller_diameter_m;
    let touches = |angle: f64| {
        let centre = crate::geometry::unit(angle) * sprocket.pitch_radius_m;
        crate::pairs::bush_gap::gap_contact(sprocket, centre, bush_radius_m).touch.penetration_m > 0.0
    };
    let (mut low, mut high) = (0.0, 0.49 * sprocket.pitch_angle_rad());
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if touches(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    0.5 * (low + high)
}

pub(super) fn build_guides(drive: &Drive, route: &Route, placed: &PlacedDrive) -> Vec<GuideModel> {
    let contact = &drive.guide_contact;
    drive
        .guides
        .iter()
        .map(|g| {
            // What slides on it: plate ends, or abutments, which lie inside the loop.
            let abutment = placed.abutment.as_ref().filter(|_| g.side == GuideSide::Inside);
            let plate_radius_m = abutment.map_or(drive.chain.plate_end_radius_m(), |a| a.guide_height_m);
            let span = route.span_after(g.span);
            let geometry = StraightGuide::along_span(
                span,
                g.side,
                g.start_m,
                span.length_m - g.end_m,
                plate_radius_m + g.clearance_m,
                g.end_radius_m,
            );
            let geometry = if g.end_lift_m == 0.0 { geometry } else { geometry.lifted(g.end_lift_m) };
            let body = GuideBody {
                origin: geometry.origin,
                along: geometry.along,
                length_m: geometry.length_m,
                end_radius_m: geometry.end_radius_m,
                relief_m: geometry.relief_m(),
                plate_radius_m,
                side: if g.side == GuideSide::Inside { 0 } else { 1 },
                touches_plates: abutment.is_none(),
                law: contact.law,
                friction: friction(drive, &g.name),
                stick_speed_m_s: contact.stick_speed_m_s,
            };
            let frame = BodyFrame { origin: geometry.origin, ..BodyFrame::default() };
            GuideModel { name: g.name.clone(), chain: 0, geometry, frame, body }
        })
        .collect()
}

/// Coulomb coefficient of a guide or rail with what its effects change. Its mount is a coordinate, see [`super::Model::add_bearings`].
fn friction(drive: &Drive, name: &str) -> f64 {
    let effects = drive.effects.guides.iter().filter(|e| e.guide == name);
    effects.fold(drive.guide_contact.friction, |all, e| (all + e.friction).max(0.0))
}

/// What is said of a guide that a sprocket's teeth would strike.
pub fn runs_through(guide: &str, sprocket: &str) -> String {
    format!("guide `{guide}` runs through sprocket `{sprocket}`")
}

/// Bodies that stand in each other's way, by parry's shape queries (in mm: its tolerances are absolute).
pub(super) fn check_clearances(
    drive: &Drive,
    sprockets: &[SprocketModel],
    (guides, rails, arms): (&[GuideModel], &[RailModel], &[ArmModel]),
    diags: &mut Vec<Diag>,
) {
    let mm = |v: Vec2| Vector::new(v.x * 1e3, v.y * 1e3);
    let at = |v: Vec2| Pose::new(mm(v), 0.0);
    let ball = |s: &SprocketModel| Ball::new(s.geometry.tip_radius_m() * 1e3);
    for (i, a) in sprockets.iter().enumerate() {
        for b in &sprockets[i + 1..] {
            let needed = 2.0 * drive.chain.plate_end_radius_m().min(0.3 * drive.chain.pitch_m()) * 1e3;
            if let Ok(gap) = query::distance(&at(a.frame.origin), &ball(a), &at(b.frame.origin), &ball(b))
                && gap.distance < needed
            {
                diags.push(drive.places.error(
                    &format!("sprockets.{}", b.name),
                    format!("sprockets `{}` and `{}` are {:.3} mm apart at their tips", a.name, b.name, gap.distance),
                    Some(format!("a bush must pass between them: at least {needed:.3} mm")),
                ));
            }
        }
    }
    let mut contours: Vec<Contour> = Vec::new();
    for g in guides {
        let path = format!("guides.fixed.{}", g.name);
        // Faces for abutments lie beside the teeth and reach to the rings.
        if g.geometry.length_m <= 0.0 || g.geometry.length_m.is_nan() {
            diags.push(drive.places.error(
                &path,
                format!("guide `{}` has no length left on its span", g.name),
                Some("make `start_mm` and `end_mm` smaller".into()),
            ));
            continue;
        }
        let Ok(profile) = g.geometry.profile() else { continue };
        if g.body.touches_plates {
            let placed = profile.moved(g.geometry.angle_rad(), g.geometry.origin);
            let help = "make it shorter at that end (`start_mm`, `end_mm`) or move it away (`clearance_um`)";
            contours.push(Contour { name: &g.name, path, points: placed.polyline(CONTOUR_TOLERANCE_M), help });
        }
    }
    for r in rails {
        let arm = arms.iter().find(|a| r.frame.turn == Some(a.coordinate));
        let (origin, angle) = arm.map_or((r.frame.origin, 0.0), |a| (a.pivot, a.start_rad));
        contours.push(Contour {
            name: &r.name,
            path: format!("guides.rail.{}", r.name),
            points: r.rail.profile.moved(angle, origin).polyline(CONTOUR_TOLERANCE_M),
            help: "make it shorter at that end, or move it away",
        });
    }
    for (k, contour) in contours.iter().enumerate() {
        let line = Polyline::new(contour.points.iter().copied().map(mm).collect(), None);
        for s in sprockets {
            if let Ok(gap) = query::distance(&Pose::IDENTITY, &line, &at(s.frame.origin), &ball(s))
                && gap.distance <= 0.0
            {
                let title = runs_through(contour.name, &s.name);
                diags.push(drive.places.error(&contour.path, title, Some(contour.help.into())));
            }
        }
        if let Some(other) = contours[..k].iter().find(|other| cross_each_other(&contour.points, &other.points)) {
            let title = format!("guides `{}` and `{}` cross each other", other.name, contour.name);
            diags.push(drive.places.error(&contour.path, title, Some("make one of them shorter, or move it".into())));
        }
    }
}

/// What the chain runs on of a guide or rail, as it stands where the loop closes.
struct Contour<'a> {
    name: &'a str,
    path: String,
    points: Vec<Vec2>,
    help: &'static str,
}

/// Largest distance of a contour from the lines between its points [m].
const CONTOUR_TOLERANCE_M: f64 = 10e-6;

/// Whether two open polylines cross, by more than their tolerance. Those that only touch, as guides that lie end to end, do not.
fn cross_each_other(one: &[Vec2], other: &[Vec2]) -> bool {
    // How far the point `p` lies from the line from `a` to `b`, to the left of it positive.
    let side = |a: Vec2, b: Vec2, p: Vec2| cross(b - a, p - a) / (b - a).norm().max(f64::MIN_POSITIVE);
    let parted = |(a, b): (Vec2, Vec2), (c, d): (Vec2, Vec2)| {
        let (c, d) = (side(a, b, c), side(a, b, d));
        c * d < 0.0 && c.abs().min(d.abs()) > 2.0 * CONTOUR_TOLERANCE_M
    };
    let lines = |points: &[Vec2]| points.iter().copied().zip(points.iter().copied().skip(1)).collect::<Vec<_>>();
    let others = lines(other);
    lines(one).into_iter().any(|a| others.iter().any(|b| parted(a, *b) && parted(*b, a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_only_touch_do_not_cross() {
        let line = |points: &[[f64; 2]]| points.iter().map(|p| Vec2::new(p[0], p[1])).collect::<Vec<_>>();
        let bent = line(&[[0.0, 0.0], [0.1, 0.0], [0.2, -0.05]]);
        let crosses =
            |other: &[[f64; 2]]| cross_each_other(&bent, &line(other)) && cross_each_other(&line(other), &bent);
        assert!(crosses(&[[0.05, -0.01], [0.05, 0.01]]));
        assert!(crosses(&[[0.15, -0.1], [0.16, 0.1]]), "the second stretch");
        assert!(!crosses(&[[0.05, 0.001], [0.05, 0.01]]), "beside it");
        assert!(!crosses(&[[0.2, -0.05], [0.3, -0.2]]), "end to end");
        assert!(!crosses(&[[0.2 - 1e-6, -0.05 + 1e-6], [0.3, -0.1]]), "end to end but for a micrometre");
        assert!(!crosses(&[[0.02, 0.0], [0.08, 0.0]]), "on it");
    }
}
