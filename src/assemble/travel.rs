//! Where arms and sliders stand at rest, and whether the loop closes within their way.

use super::MIN_TENSION_N;
use super::report::{AssemblyError, RestingArm, RestingSlider, RestingStop};
use crate::drive::{Drive, PreloadSpec};
use crate::model::{ArmModel, Model};
use crate::pairs::part_part::{Touch, TouchShape};
use crate::statics::{Configuration, Equilibrium, equilibrium};

/// Refuses a drive whose chain is slack, or finds no rest, because its tightening arm or a slider that presses on it stands at a stop, with how far
/// it would go beyond. `rest`: where the search for the equilibrium began, `found` what it found.
pub(super) fn check_travel(
    drive: &Drive,
    model: &Model,
    rest: Configuration,
    found: Result<Equilibrium, AssemblyError>,
) -> Result<Equilibrium, AssemblyError> {
    let is_tight = |e: &Equilibrium| e.tensions_n.iter().copied().fold(0.0, f64::max) >= MIN_TENSION_N;
    if found.as_ref().is_ok_and(is_tight) {
        return found;
    }
    let Some((touch, beyond_m)) = beyond_stops(drive, model, rest).filter(|(_, m)| *m > 0.0) else { return found };
    let name = |path: &str| crate::diag::last_name(path.rsplit_once('.').map_or("", |(own, _)| own)).to_string();
    let lever_m = match touch.shape {
        TouchShape::Stop { lever_m, .. } => lever_m,
        TouchShape::Between { .. } | TouchShape::Tip { .. } | TouchShape::Cam(_) => 1.0,
    };
    let title = if touch.path.starts_with("arms.") {
        let degrees = (beyond_m / lever_m).to_degrees();
        format!("the loop closes where arm `{}` stands {degrees:.3} deg beyond this stop", name(&touch.path))
    } else {
        let mm = beyond_m * 1e3;
        format!("the loop closes where slider `{}` stands {mm:.3} mm beyond this stop", name(&touch.path))
    };
    let help = "move the stop; or place a sprocket, the rail or the slider so that the loop closes between the stops";
    let diag = drive.places.error(&touch.path, title, Some(help.into()));
    Err(AssemblyError::Input(drive.places.report(vec![diag])))
}

/// The stop beyond which the tightening arm, or a slider that presses on it, would come to rest without stops, and how far [m].
fn beyond_stops<'a>(drive: &Drive, model: &'a Model, rest: Configuration) -> Option<(&'a Touch, f64)> {
    let PreloadSpec::Arm(tightening) = drive.preload else { return None };
    let arm = model.arms.get(tightening)?.back;
    let is_tip =
        |t: &Touch, k: usize| matches!(t.shape, TouchShape::Tip { slider, arm: on, .. } if slider == k && on == arm);
    let is_own = |t: &Touch| match t.shape {
        TouchShape::Stop { coordinate, .. } => coordinate == arm || model.touches.iter().any(|t| is_tip(t, coordinate)),
        TouchShape::Tip { .. } | TouchShape::Between { .. } | TouchShape::Cam(_) => false,
    };
    let mut free = model.clone();
    free.touches.retain(|t| !is_own(t));
    let q = equilibrium(&free, rest, 0.0).ok()?.configuration.coordinates;
    let own = model.touches.iter().filter(|t| is_own(t));
    own.map(|t| (t, -t.shape.gap(&q).gap_m)).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Arms at rest under load.
pub(super) fn resting_arms(model: &Model, q: &Configuration) -> Vec<RestingArm> {
    let of = |arm: &ArmModel| RestingArm {
        arm: arm.name.clone(),
        angle_rad: q.coordinates[arm.coordinate],
        spring_torque_nm: model.coordinates[arm.back].spring.force(q.coordinates[arm.back]),
        stop: stop_under(model, q, arm.back),
    };
    model.arms.iter().map(of).collect()
}

/// Sliders with their tips, at rest under load.
pub(super) fn resting_sliders(model: &Model, q: &Configuration) -> Vec<RestingSlider> {
    let tips = model.touches.iter().filter_map(|t| match t.shape {
        TouchShape::Tip { slider, .. } => Some((slider, t)),
        TouchShape::Stop { .. } | TouchShape::Between { .. } | TouchShape::Cam(_) => None,
    });
    let of = |(coordinate, touch): (usize, &Touch)| {
        let slider = model.sliders.iter().find(|s| s.coordinate == coordinate);
        RestingSlider {
            slider: slider.map_or_else(String::new, |s| s.name.clone()),
            position_m: q.coordinates[coordinate],
            tip_force_n: touch.law.elastic(-touch.shape.gap(&q.coordinates).gap_m, touch.radii).force_n,
            stop: stop_under(model, q, coordinate),
        }
    };
    tips.map(of).collect()
}

/// The stop that this coordinate rests on under load, and how far beyond it would come to rest without it.
fn stop_under(model: &Model, q: &Configuration, coordinate: usize) -> Option<RestingStop> {
    let is_own = |t: &Touch| matches!(t.shape, TouchShape::Stop { coordinate: own, .. } if own == coordinate);
    let force_of = |t: &Touch| t.law.elastic(-t.shape.gap(&q.coordinates).gap_m, t.radii).force_n;
    let touch = model.touches.iter().find(|t| is_own(t) && force_of(t) > 0.0)?;
    let mut free = model.clone();
    free.touches.retain(|t| !is_own(t));
    let beyond_m =
        equilibrium(&free, q.clone(), 1.0).ok().map(|e| -touch.shape.gap(&e.configuration.coordinates).gap_m);
    let key = touch.path.rsplit('.').next().unwrap_or_default().to_string();
    Some(RestingStop { key, force_n: force_of(touch), beyond_m })
}

/// Sliders where their tips just touch their arms.
pub(super) fn place_tips(model: &Model, coordinates: &mut [f64]) {
    for touch in &model.touches {
        if let TouchShape::Tip { slider, .. } = touch.shape {
            for _ in 0..TIP_ITERATIONS {
                let gap = touch.shape.gap(coordinates);
                coordinates[slider] -= gap.gap_m / gap.slope[0];
            }
        }
    }
}

/// Steps of Newton's method for the place of a tip; some five are needed.
const TIP_ITERATIONS: u32 = 20;
