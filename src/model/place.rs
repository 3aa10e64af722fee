//! Placing: the profiles of all bodies of one chain, and the position of the tightening sprocket or arm at which its loop closes.

use super::{Profiles, Toothing};
use crate::diag::{Diag, Report};
use crate::drive::{Drive, PreloadSpec, SprocketDrive};
use crate::geometry::chain::LinkShape;
use crate::geometry::rail::Rail;
use crate::geometry::route::{Pulley, Route, RouteError, close_loop};
use crate::geometry::smartchain::{Abutment, LobedRing};
use crate::geometry::{Vec2, rotated};
use crate::pairs::contour_body::LinkContour;

#[doc(hidden)]
/// Geometry of a drive: sprockets, links, and the position at which the loop closes.
#[derive(Clone, Debug)]
pub struct PlacedDrive {
    pub sprockets: Vec<Toothing>,
    pub rows: Vec<LinkShape>,
    pub contour: Option<LinkContour>,
    /// Of an abutment chain.
    pub abutment: Option<Abutment>,
    /// Per sprocket of an abutment chain; None: a circle.
    pub rings: Vec<Option<LobedRing>>,
    /// See [`Model::line_end_m`].
    pub line_end_m: Vec<f64>,
    /// Pitch circles with the tightening sprocket where `links` loaded pitches close.
    pub pulleys: Vec<Pulley>,
    /// Direction in which it moves; zero where an arm tightens the loop.
    pub direction: Vec2,
    /// In the frames of their bodies.
    pub rails: Vec<Rail>,
    /// Angle of the tightening arm at which the loop closes [rad].
    pub turn_rad: f64,
}

impl PlacedDrive {
    /// All that the chain may bend round in the order of travel, the tightening sprocket moved on by `shift_m`.
    pub fn loop_pulleys(&self, drive: &Drive, shift_m: f64) -> Vec<Pulley> {
        let mut pulleys = self.pulleys.clone();
        if let PreloadSpec::Sprocket { moves, .. } = drive.preload {
            pulleys[moves].centre += self.direction * shift_m;
        }
        with_rails(drive, &self.rails, &pulleys, self.turn_rad)
    }
}

/// Pitch circles of sprockets, and between them what the chain may bend round of the rails, the tightening arm turned by `turn_rad`.
fn with_rails(drive: &Drive, rails: &[Rail], sprockets: &[Pulley], turn_rad: f64) -> Vec<Pulley> {
    // Plates bend round an arc as a polygon about its circle; the joints run on the circle through its corners.
    let height_m = drive.chain.plate_end_radius_m();
    let pitch_radius = |radius_m: f64| libm::hypot(radius_m + height_m, 0.5 * drive.chain.pitch_m());
    let mut all = Vec::new();
    for (k, sprocket) in sprockets.iter().enumerate() {
        all.push(*sprocket);
        for r in rails_of(drive, k) {
            let (spec, rail) = (&drive.rails[r], &rails[r]);
            let turn = spec.arm.filter(|a| drive.preload == PreloadSpec::Arm(*a)).map_or(0.0, |_| turn_rad);
            let pivot = spec.arm.map_or(Vec2::zeros(), |a| drive.arms[a].pivot);
            all.extend(rail.bends().into_iter().map(|(centre, radius_m)| Pulley {
                centre: pivot + rotated(centre, turn),
                pitch_radius_m: pitch_radius(radius_m),
                wrap: rail.wrap(),
                is_optional: true,
            }));
        }
    }
    all
}

/// Rails on the way from sprocket `k` to the next, in the order in which the chain meets them.
fn rails_of(drive: &Drive, k: usize) -> Vec<usize> {
    let at = |k: usize| Vec2::new(drive.sprockets[k].x_m, drive.sprockets[k].y_m);
    let ahead = at((k + 1) % drive.sprockets.len()) - at(k);
    let mut here: Vec<usize> = (0..drive.rails.len()).filter(|r| drive.rails[*r].span == k).collect();
    here.sort_by(|a, b| drive.rails[*a].start.dot(&ahead).total_cmp(&drive.rails[*b].start.dot(&ahead)));
    here
}

/// Computes all profiles and closes the loop.
pub fn place(drive: &Drive) -> Result<PlacedDrive, Report> {
    close(drive, Profiles::new(drive)?)
}

/// Closes the loop of a drive whose profiles are known already.
pub fn close(drive: &Drive, profiles: Profiles) -> Result<PlacedDrive, Report> {
    let Profiles { mut sprockets, rows, contour, abutment, rings, line_end_m, line_radii_m } = profiles;
    for (sprocket, s) in sprockets.iter_mut().zip(&drive.sprockets) {
        if let Toothing::Iso(own) = sprocket {
            own.gap_shifts = gap_shifts(drive, s);
        }
    }
    let mut pulleys: Vec<Pulley> = drive
        .sprockets
        .iter()
        .zip(&line_radii_m)
        .map(|(s, r)| Pulley { centre: Vec2::new(s.x_m, s.y_m), pitch_radius_m: *r, wrap: s.wrap, is_optional: false })
        .collect();
    let mut rails = Vec::new();
    for r in &drive.rails {
        let pivot = r.arm.map_or(Vec2::zeros(), |a| drive.arms[a].pivot);
        rails.push(Rail::new(r.side, r.start - pivot, r.heading_rad, &r.stretches).map_err(|e| {
            let path = format!("guides.rail.{}", r.name);
            drive.places.report(vec![drive.places.error(&path, format!("rail `{}` cannot be made: {e}", r.name), None)])
        })?);
    }
    let pitch = rows.iter().map(|r| r.pitch_m).sum::<f64>() / rows.len() as f64;
    let loaded = pitch + drive.preload.tension_n() / drive.joint.stiffness_n_per_m + 2.0 * drive.joint.clearance_m;
    let failed = |e: RouteError| drive.places.report(vec![route_diag(drive, &e)]);
    let (mut direction, mut turn_rad) = (Vec2::zeros(), 0.0);
    match drive.preload {
        PreloadSpec::Sprocket { moves, direction_rad, .. } => {
            let before = (moves + pulleys.len() - 1) % pulleys.len();
            direction = match direction_rad {
                Some(angle) => crate::geometry::unit(angle),
                None => {
                    let d = pulleys[moves].centre - pulleys[before].centre;
                    if d.norm() > 0.0 { d / d.norm() } else { Vec2::new(1.0, 0.0) }
                }
            };
            let moved = |shift: f64| {
                let mut pulleys = pulleys.clone();
                pulleys[moves].centre += direction * shift;
                with_rails(drive, &rails, &pulleys, 0.0)
            };
            let (shift, _) = close_loop(moved, PATH_PER_SHIFT, drive.links, loaded).map_err(failed)?;
            pulleys[moves].centre += direction * shift;
        }
        PreloadSpec::Arm(_) => {
            let turned = |turn: f64| with_rails(drive, &rails, &pulleys, turn);
            let length = |turn: f64| Route::new(&turned(turn)).map(|r| r.length_m());
            let slope = (length(ARM_PROBE_RAD).map_err(&failed)? - length(0.0).map_err(&failed)?) / ARM_PROBE_RAD;
            if slope.abs() < MIN_PATH_PER_RAD {
                return Err(drive.places.report(vec![drive.places.error(
                    "preload.moves",
                    "turning this arm does not make the chain's path longer or shorter".to_string(),
                    Some("its rail must press into the chain in the position in which it is drawn".into()),
                )]));
            }
            let longer = slope.signum();
            let (turn, _) =
                close_loop(|turn| turned(longer * turn), slope.abs(), drive.links, loaded).map_err(&failed)?;
            turn_rad = longer * turn;
        }
        // The loop closes as it is drawn, but for what the blade gives way.
        PreloadSpec::Blade => {
            let length_m = Route::new(&with_rails(drive, &rails, &pulleys, 0.0)).map_err(&failed)?.length_m();
            let long_m = length_m - drive.links as f64 * loaded;
            if long_m.abs() > MOST_FOR_BLADE_M {
                return Err(drive.places.report(vec![drive.places.error(
                    "preload.moves",
                    format!("the path round the drawn blade is {:.3} mm longer than the chain", long_m * 1e3),
                    Some("draw the blade, or place a sprocket, so that both agree within 3 mm".into()),
                )]));
            }
        }
    }
    Ok(PlacedDrive { sprockets, rows, contour, abutment, rings, line_end_m, pulleys, direction, rails, turn_rad })
}

/// What a blade may take up from the shape in which it is drawn [m]. assumed: the sag of tensioner blades gives 1 to 2 mm.
const MOST_FOR_BLADE_M: f64 = 3e-3;
/// How much longer the path becomes where a sprocket moves out, an estimate [m/m].
const PATH_PER_SHIFT: f64 = 1.9;
/// Turn by which it is found how an arm changes the path [rad], and the least change that tightens a chain [m/rad].
const ARM_PROBE_RAD: f64 = 1e-3;
const MIN_PATH_PER_RAD: f64 = 1e-3;

/// Where the gaps of a sprocket lie beside their places; empty if none does.
pub(super) fn gap_shifts(drive: &Drive, s: &SprocketDrive) -> Vec<Vec2> {
    let own = |sprocket: usize| drive.sprockets[sprocket].name == s.name;
    let errors: Vec<_> = drive.effects.gap_errors.iter().filter(|e| own(e.sprocket)).collect();
    let waves: Vec<_> = drive.effects.gap_waves.iter().filter(|w| own(w.sprocket) && w.amplitude_m != 0.0).collect();
    if errors.is_empty() && waves.is_empty() {
        return Vec::new();
    }
    let shift = |gap: u32| {
        let out: f64 = errors.iter().filter(|e| e.gap == gap).map(|e| e.outward_m).sum();
        let angle = 2.0 * std::f64::consts::PI * f64::from(gap) / f64::from(s.teeth);
        waves.iter().fold(Vec2::new(out, 0.0), |sum, w| {
            sum + match w.order {
                // A displaced toothing: its direction as this gap sees it.
                None => crate::geometry::unit(w.phase_rad - angle) * w.amplitude_m,
                Some(n) => Vec2::new(0.0, w.amplitude_m * crate::units::sin_cos(f64::from(n) * angle + w.phase_rad).0),
            }
        })
    };
    (0..s.teeth).map(shift).collect()
}

/// Paths of what [`with_rails`] gives, in its order.
fn loop_paths(drive: &Drive) -> Vec<String> {
    let mut paths = Vec::new();
    for (k, s) in drive.sprockets.iter().enumerate() {
        paths.push(format!("sprockets.{}", s.name));
        for r in rails_of(drive, k) {
            let spec = &drive.rails[r];
            let bends = Rail::new(spec.side, spec.start, spec.heading_rad, &spec.stretches)
                .map_or(0, |rail| rail.bends().len());
            paths.extend((0..bends).map(|_| format!("guides.rail.{}", spec.name)));
        }
    }
    paths
}

pub(super) fn route_diag(drive: &Drive, e: &RouteError) -> Diag {
    let paths = loop_paths(drive);
    let path = |i: usize| paths.get(i).cloned().unwrap_or_default();
    let name = |i: usize| crate::diag::last_name(&path(i)).to_string();
    match e {
        RouteError::Overlap { first, second, .. }
            if [first, second].iter().any(|i| path(**i).starts_with("guides")) =>
        {
            drive.places.error(
                &path(*second),
                format!("`{}` and `{}` leave the chain no way between them", name(*first), name(*second)),
                Some("move the rail, or turn its radius or its side".into()),
            )
        }
        RouteError::Overlap { first, second, needed_m } => drive.places.error(
            &format!("sprockets.{}.x_mm", name(*second)),
            format!("sprockets `{}` and `{}` overlap", name(*first), name(*second)),
            Some(format!("their axes must be more than {:.3} mm apart", needed_m * 1e3)),
        ),
        RouteError::Unwrapped { pulley } => drive.places.error(
            &format!("sprockets.{}", name(*pulley)),
            format!("the chain does not wrap sprocket `{}`", name(*pulley)),
            Some(
                "check `route` (counterclockwise order), its position, and `wrap` (inside or outside the loop)".into(),
            ),
        ),
        RouteError::Open { links, fits, longer_m } => drive.places.error(
            &format!("{}.links", drive.chain.path()),
            format!(
                "a loop of {links} links does not close round these sprockets: it is {:.3} mm {} than its path as drawn",
                longer_m.abs() * 1e3,
                if *longer_m > 0.0 { "longer" } else { "shorter" }
            ),
            Some(match fits.as_slice() {
                [] => "change the number of links or the positions".into(),
                fits => format!("near the positions given, {fits:?} links would fit"),
            }),
        ),
    }
}
