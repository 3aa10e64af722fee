//! Valves: what slides, what it touches, and the masses of its spring.

use super::Model;
use crate::drive::Drive;
use crate::drive::lifters::LifterSpec;
use crate::drive::mechanism::PassageLaw;
use crate::drive::valves::{CamPlaces, ValveSpec};
use crate::elements::contact_law::{ContactLaw, PairRadii};
use crate::elements::coordinate::{Coordinate, CoordinateKind, CoordinateMotion, CoordinateSpring};
use crate::elements::coupling::Coupling;
use crate::elements::hydraulics::Chamber;
use crate::elements::load::GasLoad;
use crate::geometry::unit;
use crate::pairs::part_part::{CamTouch, Touch, TouchShape};
use std::f64::consts::PI;

impl Model {
    /// Puts the valves of a drive in. Comes after the shafts: what turns stands before what slides. Where their cams stand is said later, by
    /// [`Model::set_cams`].
    pub fn add_valves(&mut self, drive: &Drive) {
        for spec in &drive.valves {
            let spec = spec.with_effects(&drive.effects);
            for number in 0..spec.phases_rad.len() {
                self.add_valve(drive, &spec, number);
            }
        }
    }

    fn add_valve(&mut self, drive: &Drive, spec: &ValveSpec, number: usize) {
        let Some([cam, seat]) = &drive.valve_contacts else { return };
        let (path, valve) = (spec.path(number), self.coordinates.len());
        // A spring in parts presses on the valve with its preload, and with what its last part is shortened by.
        let is_whole = spec.spring_parts == 1;
        let spring = CoordinateSpring {
            stiffness: if is_whole { spec.spring_n_per_m } else { 0.0 },
            free: if is_whole { -spec.spring_n / spec.spring_n_per_m } else { 0.0 },
            damping: spec.damping_n_s_per_m,
        };
        let lifter_n = spec.lifter.as_ref().map_or(0.0, |l| l.spring_n);
        let preload_n = if is_whole { lifter_n } else { lifter_n - spec.spring_n };
        self.coordinates.push(slides(path.clone(), spec.moved_kg(), preload_n, spring));
        if !is_whole {
            self.add_spring_masses(spec, &path, valve);
        }
        let rocker_kg = spec.rocker.map_or(0.0, |r| r.moved_kg());
        let follower = match &spec.lifter {
            None => valve,
            Some(lifter) => self.add_lifter((drive, lifter, rocker_kg), &path, valve),
        };
        let ratio = spec.rocker.map_or(1.0, |r| r.ratio);
        let lifter_start_n = spec.lifter.as_ref().map_or(0.0, LifterSpec::start_n);
        let on_cam = PairRadii { bush_m: spec.base_m, body_m: spec.roller_m.unwrap_or(f64::INFINITY) };
        let pressed_m = if spec.lifter.is_some() { at_rest_m(cam.law, on_cam, ratio * lifter_start_n) } else { 0.0 };
        let sprocket = &self.sprockets[spec.sprocket];
        let shape = TouchShape::Cam(CamTouch {
            follower,
            valve,
            shaft: sprocket.coordinate,
            turns_by: spec.along.as_ref().map_or_else(Vec::new, |cams| self.turns_by(drive, cams, number)),
            axis: sprocket.frame.origin,
            direction: unit(spec.direction_rad),
            law: spec.law.clone(),
            sense: 1.0,
            offset_rad: 0.0,
            base_m: spec.base_m,
            roller_m: spec.roller_m,
            lash_m: spec.lash_m - pressed_m,
            ratio,
        });
        let touch = |what: &str,
                     shape: TouchShape,
                     contact: &crate::drive::ContactSpec,
                     friction: f64,
                     bush_m: f64,
                     body_m: f64| Touch {
            path: format!("{path}.{what}"),
            shape,
            law: contact.law,
            friction,
            stick_speed_m_s: contact.stick_speed_m_s,
            radii: PairRadii { bush_m, body_m },
        };
        let on_the_cam = touch("cam", shape, cam, cam.friction, spec.base_m, spec.roller_m.unwrap_or(f64::INFINITY));
        let stop = TouchShape::Stop {
            coordinate: valve,
            limit: at_rest_m(seat.law, SEAT_RADII, spec.spring_n - lifter_start_n),
            sense: -1.0,
            lever_m: 1.0,
        };
        let on_seat = touch("seat", stop, seat, 0.0, SEAT_RADIUS_M, f64::INFINITY);
        let gas = spec.gas.as_ref().map(|gas| GasLoad {
            path: format!("{path}.gas"),
            cam: self.touches.len(),
            area_m2: 0.25 * PI * gas.head_m * gas.head_m,
            pressures: gas.pressures.clone(),
        });
        self.gas_loads.extend(gas);
        self.touches.extend([on_the_cam, on_seat]);
        if let Some(lifter) = &spec.lifter {
            let end = |limit_m: f64, sense: f64| TouchShape::Between { front: valve, back: follower, limit_m, sense };
            let on_end = |what: &str, shape: TouchShape| touch(what, shape, seat, 0.0, SEAT_RADIUS_M, f64::INFINITY);
            let inner = on_end("lifter.in_mm", end(-lifter.in_m, -1.0));
            let outer = lifter.out_m.map(|out_m| on_end("lifter.out_mm", end(out_m, 1.0)));
            self.touches.push(inner);
            self.touches.extend(outer);
        }
    }

    /// Coordinates, with weights, that the cam with this number turns by on its elastic shaft.
    fn turns_by(&self, drive: &Drive, cams: &CamPlaces, number: usize) -> Vec<(usize, f64)> {
        let spec = &drive.elastic_shafts[cams.shaft];
        let coordinate = |path: String| self.coordinates.iter().position(|c| c.path == path);
        let discs = spec.mode_paths().filter_map(coordinate).zip(spec.shaft.shares_at(cams.along_m[number]));
        let discs: Vec<(usize, f64)> = discs.collect();
        let body = spec.sprocket.map(|k| self.sprockets[k].coordinate);
        let left = 1.0 - discs.iter().map(|(_, share)| share).sum::<f64>();
        body.into_iter().map(|k| (k, left)).chain(discs).collect()
    }

    /// Puts the masses of a valve's spring in, from the head to the valve, and the parts of the spring between them.
    fn add_spring_masses(&mut self, spec: &ValveSpec, path: &str, valve: usize) {
        let parts = spec.spring_parts as f64;
        let (k, m) = (parts * spec.spring_n_per_m, spec.spring_mass_kg / parts);
        // A spring that surges is held at both ends; its dampers are in proportion to its springs.
        let first_rad_s = 2.0 * libm::sqrt(k / m) * libm::sin(0.5 * PI / parts);
        let c = 2.0 * spec.spring_damping * k / first_rad_s;
        let first = self.coordinates.len();
        for i in 1..spec.spring_parts {
            // The far end of the spring stands in the head.
            let ground = if i == 1 {
                CoordinateSpring { stiffness: k, free: 0.0, damping: c }
            } else {
                CoordinateSpring::default()
            };
            self.coordinates.push(slides(format!("{path}.spring.{i}"), m, 0.0, ground));
        }
        for i in 1..spec.spring_parts {
            let own = first + i - 1;
            let next = if i + 1 < spec.spring_parts { own + 1 } else { valve };
            let path = format!("{path}.spring.{i}");
            self.couplings.push(Coupling { path, ends: [own, next], stiffness_nm_per_rad: k, damping_nm_s_per_rad: c });
        }
    }

    /// Puts the lifter of a valve in; returns its coordinate, the way of what moves with the cam. Its oil is put in by [`Model::add_oil`].
    fn add_lifter(
        &mut self,
        (drive, lifter, rocker_kg): (&Drive, &LifterSpec, f64),
        valve: &str,
        plunger: usize,
    ) -> usize {
        let (path, follower) = (format!("{valve}.lifter"), self.coordinates.len());
        let mass_kg = lifter.mass_kg + rocker_kg;
        self.coordinates.push(slides(path.clone(), mass_kg, -lifter.spring_n, CoordinateSpring::default()));
        // The oil in the gap shears.
        let shear = drive.oil_with_effects().and_then(|oil| {
            let (_, [_, leak]) = lifter.oil_parts(valve);
            let PassageLaw::Leak { gap, .. } = oil.passages.iter().find(|p| p.path == leak.path)?.law else {
                return None;
            };
            Some(gap.damping_n_s_per_m(oil.oil.viscosity_pa_s))
        });
        self.couplings.push(Coupling {
            path,
            ends: [follower, plunger],
            stiffness_nm_per_rad: lifter.spring_n_per_m,
            damping_nm_s_per_rad: shear.unwrap_or(0.0),
        });
        follower
    }

    /// Turns the cams so that they give full lift at their phases after the start of the recording, `run_in_s` after the shafts stand as in
    /// `coordinates`, at nominal speeds.
    pub fn set_cams(&mut self, drive: &Drive, coordinates: &[f64], run_in_s: f64) {
        let phases: Vec<f64> = drive.valves.iter().flat_map(|v| v.phases_rad.iter().copied()).collect();
        // The driver may speed up while the drive is run in.
        let driver_rad_s = self.sprockets[self.driver].nominal_speed_rad_s;
        let turned_rad = self
            .driver_motion
            .as_ref()
            .map_or(driver_rad_s.abs() * run_in_s, |motion| motion.turn_rad(0.0) - motion.turn_rad(-run_in_s));
        for (cam, phase) in cams_mut(&mut self.touches).zip(phases) {
            let speed = self.coordinates[cam.shaft].nominal_speed_rad_s;
            cam.sense = if speed < 0.0 { -1.0 } else { 1.0 };
            let shaft_rad = turned_rad.abs() * (speed / driver_rad_s).abs();
            cam.offset_rad = -(cam.sense * cam.turn(coordinates) + shaft_rad + phase);
        }
    }

    /// Turns the cams as those of another model of the same drive.
    pub fn take_cams(&mut self, other: &Model) {
        let theirs: Vec<(f64, f64)> = other.cams().map(|cam| (cam.sense, cam.offset_rad)).collect();
        for (cam, (sense, offset_rad)) in cams_mut(&mut self.touches).zip(theirs) {
            (cam.sense, cam.offset_rad) = (sense, offset_rad);
        }
    }

    /// Coordinates of the masses of a valve's spring, from the head on.
    pub fn spring_masses(&self, valve: usize) -> std::ops::Range<usize> {
        let first = valve + 1;
        let count = self.coordinates[first..]
            .iter()
            .take_while(|c| c.path.starts_with(&format!("{}.spring.", self.coordinates[valve].path)));
        first..first + count.count()
    }

    /// Force of a valve's spring, less that of its lifter's, towards its seat where it has been lifted slowly [N].
    pub fn valve_spring_n(&self, valve: usize, lift_m: f64) -> f64 {
        let (own, masses) = (&self.coordinates[valve], self.spring_masses(valve));
        if masses.is_empty() {
            return -own.spring.force(lift_m) - own.load();
        }
        let stiffness = self.coordinates[masses.start].spring.stiffness / (masses.len() + 1) as f64;
        stiffness * lift_m - own.load()
    }

    /// Force of the gas towards the seat of the valve whose cam touches it there, where the cam has turned by `turn_rad` [N].
    pub fn gas_n(&self, cam_touch: usize, turn_rad: f64) -> f64 {
        let TouchShape::Cam(cam) = &self.touches[cam_touch].shape else { return 0.0 };
        let own = self.gas_loads.iter().filter(|gas| gas.cam == cam_touch);
        own.map(|gas| gas.area_m2 * gas.pressures.at(cam.angle_rad(turn_rad))).sum()
    }

    /// Force of a lifter's spring while the valve is closed and the cam does not lift [N].
    pub fn lifter_preload_n(&self, cam: &CamTouch) -> f64 {
        -self.coordinates[cam.follower].load()
    }

    /// Where a valve on a lifter stands whose follower is lifted by `lift_m`, with the oil that it holds while the valve is closed: on its seat until the
    /// lifter pushes with `holds_n`, what holds it where it stands. Second: the force of the lifter on it above its preload [m, N].
    pub fn on_lifter(&self, cam: &CamTouch, lift_m: f64, holds_n: impl Fn(f64) -> f64) -> (f64, f64) {
        let in_m = self.touches.iter().find_map(|t| match t.shape {
            TouchShape::Between { back, limit_m, sense: -1.0, .. } if back == cam.follower => Some(-limit_m),
            TouchShape::Between { .. } | TouchShape::Stop { .. } | TouchShape::Tip { .. } | TouchShape::Cam(_) => None,
        });
        let most_m = in_m.unwrap_or(f64::INFINITY);
        let area_m2 = |c: &Chamber| c.pistons.iter().find(|(k, _)| *k == cam.valve).map(|(_, area)| *area);
        let oil = self
            .oil
            .as_ref()
            .and_then(|oil| Some((oil.oil, oil.chambers.iter().find_map(|c| Some((c, area_m2(c)?)))?)));
        let Some((oil, (chamber, area_m2))) = oil else { return (lift_m, holds_n(lift_m)) };
        let spring = self.couplings.iter().find(|c| c.ends == [cam.follower, cam.valve]);
        let stiffness = spring.map_or(0.0, |c| c.stiffness_nm_per_rad);
        let held = chamber.volume_m3 / oil.at(chamber.start_pa).volume;
        let pushes_n = |shorter_m: f64| {
            let pressure = oil.pressure_pa((chamber.volume_m3 - area_m2 * shorter_m) / held, chamber.start_pa);
            area_m2 * pressure + stiffness * shorter_m
        };
        if lift_m <= most_m && pushes_n(lift_m) <= holds_n(0.0) {
            return (0.0, pushes_n(lift_m));
        }
        // The force grows with what it is shorter by.
        let (mut low, mut high) = (0.0, lift_m.min(most_m));
        for _ in 0..LIFTER_HALVINGS {
            let middle = 0.5 * (low + high);
            if pushes_n(middle) < holds_n(lift_m - middle) { low = middle } else { high = middle }
        }
        let valve_m = lift_m - high;
        (valve_m, holds_n(valve_m).max(0.0))
    }

    /// The cam of every valve.
    pub fn cams(&self) -> impl Iterator<Item = &CamTouch> {
        self.touches.iter().filter_map(|t| match &t.shape {
            TouchShape::Cam(cam) => Some(cam),
            TouchShape::Stop { .. } | TouchShape::Between { .. } | TouchShape::Tip { .. } => None,
        })
    }
}

/// To the last digit of the way.
const LIFTER_HALVINGS: usize = 60;

/// Radius of curvature of a valve's seat, for laws that depend on it [m]. assumed.
const SEAT_RADIUS_M: f64 = 5e-3;
const SEAT_RADII: PairRadii = PairRadii { bush_m: SEAT_RADIUS_M, body_m: f64::INFINITY };

/// Depth of a contact under this force [m]: a seat lies so much higher, so that the resting valve has no lift and the lash is the gap; a cam under a
/// lifter likewise.
fn at_rest_m(law: ContactLaw, radii: PairRadii, force_n: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1e-6);
    while law.elastic(high, radii).force_n < force_n && high < 1.0 {
        high *= 2.0;
    }
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if law.elastic(middle, radii).force_n < force_n { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

fn cams_mut(touches: &mut [Touch]) -> impl Iterator<Item = &mut CamTouch> {
    touches.iter_mut().filter_map(|t| match &mut t.shape {
        TouchShape::Cam(cam) => Some(cam),
        TouchShape::Stop { .. } | TouchShape::Between { .. } | TouchShape::Tip { .. } => None,
    })
}

fn slides(path: String, mass_kg: f64, load: f64, spring: CoordinateSpring) -> Coordinate {
    Coordinate {
        path,
        kind: CoordinateKind::Slides,
        motion: CoordinateMotion::Free { inertia: mass_kg, load },
        spring,
        nominal_speed_rad_s: 0.0,
        reach_m: 1.0,
        rest_load: 0.0,
        is_held_at_rest: true,
        is_run_in: false,
    }
}
