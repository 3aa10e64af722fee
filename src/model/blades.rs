//! Blades: rails that bend, and the coordinates of their modes.

use super::{Model, RailModel};
use crate::drive::Drive;
use crate::effects::blade_stiffness;
use crate::elements::coordinate::{Coordinate, CoordinateKind, CoordinateMotion, CoordinateSpring};
use crate::geometry::Vec2;
use crate::pairs::plate_blade::{Blade, BladePoint, Deflection};
use crate::pairs::plate_rail::{PlatePart, PlateTouch};

/// The blade of a rail.
#[derive(Clone, Debug, PartialEq)]
pub struct BladeModel {
    /// Its modes along the contour.
    pub shape: Blade,
    /// The coordinate of its first mode: index into [`Model::coordinates`]; the others follow.
    pub first: usize,
}

impl BladeModel {
    /// Coordinates of its modes.
    pub fn modes(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.shape.modes.len()
    }
}

impl RailModel {
    /// How far it is bent with the coordinates at these values; None: it is rigid.
    pub fn bent(&self, at: &[f64]) -> Option<Deflection> {
        let blade = self.blade.as_ref()?;
        let mut bent = Deflection::default();
        blade.shape.deflection(blade.modes().map(|k| at[k]), &mut bent);
        Some(bent)
    }

    /// No point of it lies further than this from where it is drawn [m].
    pub fn most_bent_m(&self, at: &[f64]) -> f64 {
        self.blade.as_ref().map_or(0.0, |blade| blade.modes().map(|k| at[k].abs()).sum())
    }

    /// Where a part of a plate touches it, bent as [`RailModel::bent`] says: in its frame, with the point of the contour and the contour's normal
    /// there where it bends.
    pub fn touch(
        &self,
        bent: Option<&Deflection>,
        part: PlatePart,
        (centre, along): (Vec2, Vec2),
        lever_m: f64,
    ) -> Option<(PlateTouch, Option<(BladePoint, Vec2)>)> {
        let Some((blade, bent)) = self.blade.as_ref().zip(bent) else {
            return Some((self.body.touch(part, centre, along, lever_m)?, None));
        };
        let touch = self.body.touch_bent(part, (centre, along), lever_m, bent.most_m())?;
        let (touch, point, normal) = blade.shape.bent_touch(&self.body, bent, (centre, along, lever_m), touch);
        Some((touch, Some((point, normal))))
    }
}

impl Model {
    /// Puts in the blades of a drive. Comes last, as bearings do.
    pub fn add_blades(&mut self, drive: &Drive) {
        for spec in &drive.rails {
            let Some(bending) = &spec.bending else { continue };
            let Some(k) = self.rails.iter().position(|r| r.name == spec.name) else { continue };
            let rail = &self.rails[k];
            let length_m: f64 = spec.stretches.iter().map(|s| s.length_m).sum();
            // The profile may run against the chain.
            let mut beam = if rail.rail.travel < 0.0 { bending.reversed(length_m) } else { bending.clone() };
            beam.stiffness_n_m2 *= 1.0 + drive.effects.of_part(&blade_stiffness::ROW, &spec.name);
            // Stiffness and mass are positive, so that there are modes.
            let Some(shape) = Blade::new(&rail.body, &beam) else { continue };
            let first = self.coordinates.len();
            for (number, mode) in shape.modes.iter().enumerate() {
                self.coordinates.push(Coordinate {
                    path: format!("guides.rail.{}.bending.{}", spec.name, number + 1),
                    kind: CoordinateKind::Slides,
                    motion: CoordinateMotion::Free { inertia: mode.mass_kg, load: 0.0 },
                    spring: CoordinateSpring {
                        stiffness: mode.stiffness_n_per_m,
                        free: mode.free_m,
                        damping: mode.damping_n_s_per_m,
                    },
                    nominal_speed_rad_s: 0.0,
                    reach_m: 1.0,
                    rest_load: 0.0,
                    is_held_at_rest: false,
                    is_run_in: true,
                });
            }
            self.rails[k].blade = Some(BladeModel { shape, first });
        }
    }
}
