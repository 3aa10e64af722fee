//! Shafts without sprockets, couplings, loads, and how the driver turns.

use super::Model;
use crate::diag::last_name;
use crate::drive::shafts::Moving;
use crate::drive::torsion::ElasticShaftSpec;
use crate::drive::{Drive, OuterSpec};
use crate::effects::{Physics, coupling_stiffness};
use crate::elements::coordinate::{Coordinate, CoordinateKind, CoordinateMotion, CoordinateSpring};
use crate::elements::coupling::Coupling;
use crate::elements::driver_motion::DriverMotion;
use crate::elements::load::{Load, OrderLoad};
use crate::elements::torsion::TorsionMode;

impl Model {
    /// Puts in what turns without a sprocket, and what acts on shafts, arms and sliders. Comes before the oil: what turns stands before what
    /// slides.
    pub fn add_shafts(&mut self, drive: &Drive) {
        let on_sprockets = |shaft: usize| drive.sprockets.iter().position(|s| s.shaft == Some(shaft));
        let first = self.n_turning();
        let mut added = Vec::new();
        let mut of_shaft = vec![0; drive.shafts.len()];
        for (k, shaft) in drive.shafts.iter().enumerate() {
            of_shaft[k] = match on_sprockets(k) {
                Some(sprocket) => self.sprockets[sprocket].coordinate,
                None => {
                    added.push(free_shaft(format!("shafts.{}", shaft.name), shaft.outer));
                    first + added.len() - 1
                }
            };
        }
        let first_mode = first + added.len();
        let modes = |s: &'_ ElasticShaftSpec| -> Vec<Coordinate> {
            let inertia = |disc: TorsionMode| OuterSpec::Load { inertia_kg_m2: disc.inertia_kg_m2, torque_nm: 0.0 };
            s.mode_paths().zip(s.shaft.discs()).map(|(path, disc)| free_shaft(path, inertia(disc))).collect()
        };
        added.extend(drive.elastic_shafts.iter().flat_map(modes));
        let first_back = first + added.len();
        // Their inertia is a share of the arm's, see [`Model::split_arm`].
        let massless = OuterSpec::Load { inertia_kg_m2: 0.0, torque_nm: 0.0 };
        added.extend(drive.effects.arms.iter().map(|a| free_shaft(a.path.clone(), massless)));
        self.make_room(first, added.len());
        self.coordinates.splice(first..first, added);
        let coordinate = |m: Moving, model: &Model| match m {
            Moving::Sprocket(k) => model.sprockets[k].coordinate,
            Moving::Shaft(k) => of_shaft[k],
            // Several chains have their arms and sliders in another order than the file.
            Moving::Arm(k) => find(&model.arms, |a| a.name == drive.arms[k].name).coordinate,
            Moving::Slider(k) => find(&model.sliders, |s| s.name == drive.sliders[k].name).coordinate,
        };
        for c in &drive.train.couplings {
            let share = drive.effects.of_part(&coupling_stiffness::ROW, last_name(&c.path));
            self.couplings.push(Coupling {
                path: c.path.clone(),
                ends: c.between.map(|m| coordinate(m, self)),
                stiffness_nm_per_rad: c.stiffness_nm_per_rad * (1.0 + share),
                damping_nm_s_per_rad: c.damping_nm_s_per_rad,
            });
        }
        let mut disc = first_mode;
        for s in &drive.elastic_shafts {
            let body = coordinate(s.body, self);
            self.coordinates[body].add_inertia(s.shaft.rigid_inertia_kg_m2());
            let ends: Vec<(usize, f64)> = (disc..).zip(s.shaft.shares_at(s.shaft.length_m)).collect();
            let of_body = -ends.iter().map(|(_, share)| share).sum::<f64>();
            self.free_ends.push(ends.into_iter().chain([(body, of_body)]).collect());
            for (path, mode) in s.mode_paths().zip(s.shaft.discs()) {
                self.couplings.push(Coupling {
                    path,
                    ends: [body, disc],
                    stiffness_nm_per_rad: mode.stiffness_nm_per_rad,
                    damping_nm_s_per_rad: mode.damping_nm_s_per_rad,
                });
                disc += 1;
            }
        }
        for (back, spec) in (first_back..).zip(&drive.effects.arms) {
            self.split_arm(spec, back);
        }
        self.spread_nominal_speeds();
        for l in &drive.train.loads {
            let Physics::BodyForce(law) = l.effect.physics else { continue };
            let (coordinate, is_dissipative) = (coordinate(l.on, self), l.effect.dissipative);
            let (path, values) = (l.path.clone(), l.values.clone());
            if l.effect.order_in(&values).is_some_and(|order| order != libm::trunc(order)) {
                self.fractional_waves.push(coordinate);
            }
            self.loads.push(Load { path, coordinate, law, values, is_dissipative });
        }
        for l in &drive.train.order_loads {
            let coordinate = coordinate(l.on, self);
            let sense = if self.coordinates[coordinate].nominal_speed_rad_s < 0.0 { -1.0 } else { 1.0 };
            let (path, harmonics) = (l.path.clone(), l.harmonics.clone());
            self.order_loads.push(OrderLoad { path, coordinate, sense, harmonics });
        }
        self.turning_parts = of_shaft.into_iter().filter(|k| (first..).contains(k)).collect();
        self.turning_parts.extend(drive.arms.iter().map(|arm| find(&self.arms, |a| a.name == arm.name).coordinate));
        let motion = &drive.train.motion;
        if motion.varies() || !self.order_loads.is_empty() {
            let sense = drive.sprockets[drive.driver()].wrap.sign();
            let fluctuations = motion.fluctuations.clone();
            let own = DriverMotion::new(&motion.speeds, motion.harmonics.clone(), fluctuations, sense);
            if own.counts_turns() {
                self.fractional_waves.push(self.sprockets[self.driver].coordinate);
            }
            self.driver_motion = Some(own);
        }
    }

    /// Coordinates from `first` on move up by `count`.
    fn make_room(&mut self, first: usize, count: usize) {
        if count == 0 {
            return;
        }
        let moved = |q: usize| if q >= first { q + count } else { q };
        self.touches.iter_mut().for_each(|t| t.shape = t.shape.clone().renumbered(moved));
        self.sliders.iter_mut().for_each(|s| s.coordinate = moved(s.coordinate));
    }

    /// A shaft behind a coupling turns as fast as what turns it.
    fn spread_nominal_speeds(&mut self) {
        for _ in 0..self.couplings.len() {
            for c in &self.couplings {
                let [a, b] = c.ends;
                for (from, to) in [(a, b), (b, a)] {
                    let (speed, reach_m) = (self.coordinates[from].nominal_speed_rad_s, self.coordinates[from].reach_m);
                    let other = &mut self.coordinates[to];
                    if other.nominal_speed_rad_s == 0.0 && speed != 0.0 {
                        (other.nominal_speed_rad_s, other.reach_m) = (speed, reach_m);
                        if let CoordinateMotion::Free { load, .. } = &mut other.motion {
                            *load *= speed.signum();
                        }
                    }
                }
            }
        }
    }

    /// Whether there are forces on coordinates besides those of the chain, of touches and of oil.
    pub fn has_shaft_forces(&self) -> bool {
        let has_loads = !(self.loads.is_empty() && self.order_loads.is_empty() && self.gas_loads.is_empty());
        has_loads || !(self.couplings.is_empty() && self.spans.is_empty()) || self.has_films()
    }

    /// Whether something on coordinates loses energy.
    pub fn has_losses(&self) -> bool {
        self.coordinates.iter().any(|c| c.spring.damping > 0.0)
            || self.has_shaft_losses()
            || self.has_films()
            || self.has_span_losses()
    }

    /// Whether loads or couplings lose energy.
    pub fn has_shaft_losses(&self) -> bool {
        self.loads.iter().any(|l| l.is_dissipative) || self.couplings.iter().any(|c| c.damping_nm_s_per_rad > 0.0)
    }

    /// Mean of the loads by laws on a coordinate at its nominal speed [N m, N].
    pub fn mean_load(&self, coordinate: usize) -> f64 {
        let speed = self.coordinates[coordinate].nominal_speed_rad_s;
        self.loads.iter().filter(|l| l.coordinate == coordinate).map(|l| l.mean_force(speed)).sum()
    }

    /// What the loads by laws on a coordinate lose for each unit of speed about its nominal one [N m s/rad, N s/m].
    pub fn load_damping(&self, coordinate: usize) -> f64 {
        let speed = self.coordinates[coordinate].nominal_speed_rad_s;
        let loads = self.loads.iter().filter(|l| l.coordinate == coordinate);
        loads.map(|l| l.mean_damping(speed)).sum()
    }

    /// Turn of the driver since the recording began, harmonics included [rad].
    pub fn crank_angle_rad(&self, step: u64) -> f64 {
        match (&self.driver_motion, self.sprockets.get(self.driver)) {
            (Some(motion), _) => motion.angle_rad(step as f64 * self.step_s),
            (None, Some(driver)) => driver.nominal_speed_rad_s * step as f64 * self.step_s,
            (None, None) => 0.0,
        }
    }

    /// The coordinate of a sprocket, or behind all sprockets of a shaft without one, or of an arm, as sensors count them.
    pub fn turning_part(&self, index: usize) -> usize {
        match self.sprockets.get(index) {
            Some(sprocket) => sprocket.coordinate,
            None => self.turning_parts[index - self.sprockets.len()],
        }
    }

    /// The first of the coordinates that couplings join with this one.
    pub fn first_coupled(&self, coordinate: usize) -> usize {
        let mut first = coordinate;
        for _ in 0..self.couplings.len() {
            for [a, b] in self.couplings.iter().map(|c| c.ends) {
                if a == first || b == first {
                    first = a.min(b);
                }
            }
        }
        first
    }
}

/// The one of a list that is known to be there.
fn find<T>(all: &[T], is: impl Fn(&T) -> bool) -> &T {
    all.iter().find(|t| is(t)).expect("every part of the drive is in its model")
}

fn free_shaft(path: String, outer: OuterSpec) -> Coordinate {
    Coordinate {
        path,
        kind: CoordinateKind::Turns,
        motion: match outer {
            // Refused when the drive is read.
            OuterSpec::Speed { speed_rad_s } => CoordinateMotion::Prescribed { speed_rad_s },
            OuterSpec::Load { inertia_kg_m2, torque_nm } => {
                CoordinateMotion::Free { inertia: inertia_kg_m2, load: -torque_nm }
            }
        },
        spring: CoordinateSpring::default(),
        nominal_speed_rad_s: 0.0,
        reach_m: 0.0,
        rest_load: 0.0,
        is_held_at_rest: false,
        is_run_in: true,
    }
}
