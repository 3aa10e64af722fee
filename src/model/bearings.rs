//! Bearings: coordinates that shift sprockets, shafts and rails, and the films between journals and bores.

use super::Model;
use crate::drive::Drive;
use crate::drive::bearings::{BearingLaw, Carried};
use crate::elements::body_frame::Shift;
use crate::elements::coordinate::{Coordinate, CoordinateKind, CoordinateMotion, CoordinateSpring};
use crate::elements::plain_bearing::PlainBearing;
use crate::geometry::{Vec2, perp, unit};

/// A bearing of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct BearingModel {
    /// Path in the drive file.
    pub path: String,
    /// The coordinates along its direction and across it: indices into [`Model::coordinates`].
    pub ways: [usize; 2],
    /// Its direction in the world.
    pub direction: Vec2,
    /// The film of a plain bearing, and the coordinate that its journal turns by.
    pub film: Option<(PlainBearing, usize)>,
}

impl BearingModel {
    /// A vector of the world out of values along the bearing's direction and across it.
    #[inline(always)]
    pub fn to_world(&self, values: [f64; 2]) -> Vec2 {
        self.direction * values[0] + perp(self.direction) * values[1]
    }
}

impl Model {
    /// Puts in the bearings of a drive, and the mounts of its guides. Comes last: their coordinates stand behind all others.
    pub fn add_bearings(&mut self, drive: &Drive) {
        for spec in &drive.bearings {
            let (direction_rad, stiffness, damping, film) = match &spec.law {
                BearingLaw::Elastic { direction_rad, stiffness_n_per_m, damping_n_s_per_m } => {
                    (*direction_rad, *stiffness_n_per_m, *damping_n_s_per_m, None)
                }
                BearingLaw::Plain(_) => (0.0, [0.0; 2], [0.0; 2], spec.film(&drive.effects)),
            };
            let direction = unit(direction_rad);
            let first = self.coordinates.len();
            for (k, side) in ["along", "across"].into_iter().enumerate() {
                self.coordinates.push(Coordinate {
                    path: format!("{}.{side}", spec.path),
                    kind: CoordinateKind::Slides,
                    motion: CoordinateMotion::Free { inertia: spec.mass_kg, load: 0.0 },
                    spring: CoordinateSpring { stiffness: stiffness[k], free: 0.0, damping: damping[k] },
                    nominal_speed_rad_s: 0.0,
                    reach_m: 1.0,
                    rest_load: 0.0,
                    // A film bears nothing while nothing turns: where it stands is found apart.
                    is_held_at_rest: film.is_some(),
                    is_run_in: true,
                });
            }
            let shifts =
                [Shift { coordinate: first, direction }, Shift { coordinate: first + 1, direction: perp(direction) }];
            let mut turn = 0;
            for (k, sprocket) in self.sprockets.iter_mut().enumerate() {
                if drive.is_on_bearing(spec, k) {
                    sprocket.frame.shifts.extend(shifts);
                    turn = sprocket.coordinate;
                }
            }
            // Contours of links meet the same bodies: sprockets first, then guides.
            let n_sprockets = self.sprockets.len();
            for end in &mut self.end_bodies {
                let guide = end.body.checked_sub(n_sprockets).map(|k| &self.guides[k].name);
                let carried = match (guide, spec.on) {
                    (None, _) => drive.is_on_bearing(spec, end.body),
                    (Some(guide), Carried::Guide(k)) => *guide == drive.guides[k].name,
                    (Some(_), Carried::Sprocket(_) | Carried::Shaft(_) | Carried::Rail(_)) => false,
                };
                if carried {
                    end.frame.shifts.extend(shifts);
                }
            }
            let guides = self.guides.iter_mut().map(|g| (&g.name, &mut g.frame));
            let bodies = guides.chain(self.rails.iter_mut().map(|r| (&r.name, &mut r.frame)));
            let held = match spec.on {
                Carried::Guide(k) => Some(&drive.guides[k].name),
                Carried::Rail(k) => Some(&drive.rails[k].name),
                Carried::Sprocket(_) | Carried::Shaft(_) => None,
            };
            bodies.filter(|(name, _)| Some(*name) == held).for_each(|(_, frame)| frame.shifts.extend(shifts));
            self.bearings.push(BearingModel {
                path: spec.path.clone(),
                ways: [first, first + 1],
                direction,
                film: film.map(|bearing| (bearing.clone(), turn)),
            });
        }
        self.add_mounts(drive);
    }

    /// Guides and rails on mounts move along their normal, towards the chain.
    fn add_mounts(&mut self, drive: &Drive) {
        for (name, mount) in drive.effects.mounts() {
            let guide = self.guides.iter().position(|g| g.name == name);
            let rail = self.rails.iter().position(|r| r.name == name);
            let direction = match (guide, rail) {
                (Some(k), _) => perp(self.guides[k].body.along),
                (None, Some(k)) => self.rails[k].rail.towards_chain(),
                (None, None) => continue,
            };
            let shift = Shift { coordinate: self.coordinates.len(), direction };
            self.coordinates.push(Coordinate {
                path: mount.path.clone(),
                kind: CoordinateKind::Slides,
                motion: CoordinateMotion::Free { inertia: mount.mass_kg, load: 0.0 },
                spring: CoordinateSpring {
                    stiffness: mount.stiffness_n_per_m(),
                    free: 0.0,
                    damping: mount.damping_n_s_per_m(),
                },
                nominal_speed_rad_s: 0.0,
                reach_m: 1.0,
                rest_load: 0.0,
                is_held_at_rest: false,
                is_run_in: true,
            });
            self.mounts.push(shift.coordinate);
            if let (None, Some(k)) = (guide, rail) {
                self.rails[k].frame.shifts.push(shift);
            }
            let Some(k) = guide else { continue };
            self.guides[k].frame.shifts.push(shift);
            let body = self.sprockets.len() + k;
            self.end_bodies.iter_mut().filter(|e| e.body == body).for_each(|e| e.frame.shifts.push(shift));
        }
    }

    /// Whether a film acts on a coordinate.
    pub fn is_on_film(&self, coordinate: usize) -> bool {
        let acts = |b: &BearingModel| {
            b.film.as_ref().is_some_and(|(_, turn)| *turn == coordinate || b.ways.contains(&coordinate))
        };
        self.bearings.iter().any(acts)
    }

    /// Whether a bearing has a film.
    pub fn has_films(&self) -> bool {
        self.bearings.iter().any(|b| b.film.is_some())
    }
}
