//! Arms and sliders, what they touch, and the oil behind them.

use super::{ArmModel, Model, PlacedDrive};
use crate::drive::mechanism::{CheckSpec, OilSpec, PassageLaw, PistonSpec, RatchetSpec, SliderSpec};
use crate::drive::{ArmEffect, Drive, PreloadSpec};
use crate::elements::contact_law::{ContactLaw, PairRadii};
use crate::elements::coordinate::{Coordinate, CoordinateKind, CoordinateMotion, CoordinateSpring};
use crate::elements::coupling::Coupling;
use crate::elements::hydraulics::{Chamber, Network, Passage, PassageEnd, Reservoir};
use crate::elements::passage::{CheckBall, FlowLaw, Orifice};
use crate::geometry::{rotated, unit};
use crate::pairs::part_part::{Pad, Touch, TouchShape};
use std::f64::consts::PI;

/// A slider of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct SliderModel {
    /// Name in the drive file.
    pub name: String,
    /// Index into [`Model::coordinates`](super::Model::coordinates).
    pub coordinate: usize,
}

/// A ratchet of the model: a pawl that is held, and clicks on by a tooth where its slider is that far beyond it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ratchet {
    /// Coordinate of the slider.
    pub slider: usize,
    /// Coordinate of its pawl.
    pub pawl: usize,
    /// Distance of the teeth [m].
    pub pitch_m: f64,
    /// Way back behind the tooth that was reached last, until the pawl holds [m].
    pub backlash_m: f64,
}

/// Appends the coordinates of arms.
pub(super) fn build_arms(drive: &Drive, placed: &PlacedDrive, coordinates: &mut Vec<Coordinate>) -> Vec<ArmModel> {
    let mut arms = Vec::new();
    for (index, spec) in drive.arms.iter().enumerate() {
        let carried = || placed.rails.iter().zip(&drive.rails).filter(|(_, r)| r.arm == Some(index));
        arms.push(ArmModel {
            name: spec.name.clone(),
            pivot: spec.pivot,
            coordinate: coordinates.len(),
            back: coordinates.len(),
            start_rad: if drive.preload == PreloadSpec::Arm(index) { placed.turn_rad } else { 0.0 },
        });
        coordinates.push(Coordinate {
            path: format!("arms.{}", spec.name),
            kind: CoordinateKind::Turns,
            motion: CoordinateMotion::Free { inertia: spec.inertia_kg_m2, load: 0.0 },
            spring: spring(spec.spring_nm_per_rad, spec.spring_torque_nm, spec.damping_nm_s_per_rad).0,
            nominal_speed_rad_s: 0.0,
            reach_m: carried().map(|(rail, _)| rail.reach_m()).fold(SHORTEST_ARM_M, f64::max),
            rest_load: 0.0,
            is_held_at_rest: false,
            is_run_in: true,
        });
    }
    arms
}

/// Teeth that a pawl may pass in a step.
const MOST_TEETH: f64 = 1e6;

/// Reach of an arm that carries nothing [m].
const SHORTEST_ARM_M: f64 = 1e-3;

/// Both ends of the way of every arm that has them.
pub(super) fn build_stops(drive: &Drive, arms: &[ArmModel]) -> Vec<Touch> {
    let Some(contact) = &drive.stop_contact else { return Vec::new() };
    let mut stops = Vec::new();
    for (spec, arm) in drive.arms.iter().zip(arms) {
        for (key, limit, sense) in [("low_deg", spec.low_rad, -1.0), ("high_deg", spec.high_rad, 1.0)] {
            let Some(limit) = limit else { continue };
            stops.push(Touch {
                path: format!("arms.{}.{key}", spec.name),
                shape: TouchShape::Stop { coordinate: arm.coordinate, limit, sense, lever_m: spec.stop_radius_m },
                law: contact.law,
                friction: 0.0,
                stick_speed_m_s: contact.stick_speed_m_s,
                radii: PairRadii { bush_m: STOP_RADIUS_M, body_m: f64::INFINITY },
            });
        }
    }
    stops
}

/// Radius of curvature of a stop, for laws that depend on it [m]. assumed.
const STOP_RADIUS_M: f64 = 5e-3;

/// Appends the coordinates of sliders and their touches.
pub(super) fn build_sliders(
    drive: &Drive,
    arms: &[ArmModel],
    coordinates: &mut Vec<Coordinate>,
    touches: &mut Vec<Touch>,
) -> Vec<SliderModel> {
    let mut sliders = Vec::new();
    for spec in &drive.sliders {
        let coordinate = coordinates.len();
        coordinates.push(slider_coordinate(drive, spec));
        sliders.push(SliderModel { name: spec.name.clone(), coordinate });
        let Some(contact) = &drive.tip_contact else { continue };
        let touch = |what: &str, shape: TouchShape, friction: f64, bush_m: f64, body_m: f64| Touch {
            path: format!("sliders.{}.{what}", spec.name),
            shape,
            law: contact.law,
            friction,
            stick_speed_m_s: contact.stick_speed_m_s,
            radii: PairRadii { bush_m, body_m },
        };
        let (arm, direction) = (&arms[spec.arm], unit(spec.direction_rad));
        let normal = -rotated(direction, spec.pad_rad);
        let foot = spec.centre - normal * spec.tip_radius_m - arm.pivot;
        let pad = match spec.pad_radius_m {
            None => Pad::Flat { normal, offset_m: normal.dot(&foot) },
            Some(radius_m) => Pad::Round { centre: foot - normal * radius_m, radius_m },
        };
        let shape = TouchShape::Tip {
            slider: coordinate,
            centre: spec.centre,
            direction,
            radius_m: spec.tip_radius_m,
            arm: arm.coordinate,
            pivot: arm.pivot,
            pad,
        };
        touches.push(touch(
            "tip",
            shape,
            contact.friction,
            spec.tip_radius_m,
            spec.pad_radius_m.unwrap_or(f64::INFINITY),
        ));
        for (key, limit, sense) in [("low_mm", spec.low_m, -1.0), ("high_mm", spec.high_m, 1.0)] {
            let Some(limit) = limit else { continue };
            let shape = TouchShape::Stop { coordinate, limit, sense, lever_m: 1.0 };
            touches.push(touch(key, shape, 0.0, STOP_RADIUS_M, f64::INFINITY));
        }
    }
    sliders
}

/// What a spring of this stiffness and this force at zero gives: a spring, or a constant force where it is not stiff.
fn spring(stiffness: f64, force: f64, damping: f64) -> (CoordinateSpring, f64) {
    let (free, load) = if stiffness > 0.0 { (force / stiffness, 0.0) } else { (0.0, force) };
    (CoordinateSpring { stiffness, free, damping }, load)
}

fn slider_coordinate(drive: &Drive, spec: &SliderSpec) -> Coordinate {
    let (mut damping, mut rest_load) = (spec.damping_n_s_per_m, 0.0);
    if let Some(oil) = &drive.oil_with_effects() {
        let is_own = |name: &String| *name == spec.name;
        for p in &oil.passages {
            if let PassageLaw::Leak { gap, slider: Some(name) } = &p.law
                && is_own(name)
            {
                damping += gap.damping_n_s_per_m(oil.oil.viscosity_pa_s);
            }
        }
        rest_load = network(oil, &|name| is_own(&name.to_string()).then_some(0), 1).rest_force(0);
    }
    let (spring, load) = spring(spec.spring_n_per_m, spec.spring_n, damping);
    Coordinate {
        path: format!("sliders.{}", spec.name),
        kind: CoordinateKind::Slides,
        motion: CoordinateMotion::Free { inertia: spec.mass_kg, load },
        spring,
        nominal_speed_rad_s: 0.0,
        reach_m: 1.0,
        rest_load,
        is_held_at_rest: false,
        is_run_in: true,
    }
}

/// The network, its balls on coordinates from `first_ball` on. Pistons that are not there are left out.
fn network(spec: &OilSpec, slider: &dyn Fn(&str) -> Option<usize>, first_ball: usize) -> Network {
    let end = |name: &String| {
        let chamber = spec.chambers.iter().position(|c| c.name == *name);
        let reservoir = || spec.reservoirs.iter().position(|(r, _)| r == name).unwrap_or(0);
        chamber.map_or_else(|| PassageEnd::Reservoir(reservoir()), PassageEnd::Chamber)
    };
    let mut ball = first_ball;
    let mut passages = Vec::new();
    for p in &spec.passages {
        let law = match &p.law {
            PassageLaw::Orifice { diameter_m, discharge, transition_reynolds } => FlowLaw::Orifice(Orifice {
                diameter_m: *diameter_m,
                discharge: *discharge,
                transition_reynolds: *transition_reynolds,
            }),
            PassageLaw::Leak { gap, slider: wall } => FlowLaw::Leak {
                conductance: gap.conductance(spec.oil.viscosity_pa_s),
                wall: wall.as_deref().and_then(slider).map(|k| (k, gap.wall_m2())),
            },
            PassageLaw::Pipe(pipe) => FlowLaw::Pipe(*pipe),
            PassageLaw::Check(c) => {
                ball += 1;
                FlowLaw::Check(CheckBall {
                    coordinate: ball - 1,
                    seat_radius_m: c.seat_radius_m,
                    ball_radius_m: c.ball_radius_m,
                    discharge: c.discharge,
                    transition_reynolds: c.transition_reynolds,
                })
            }
        };
        passages.push(Passage { path: p.path.clone(), ends: [end(&p.ends[0]), end(&p.ends[1])], law });
    }
    let piston = |p: &PistonSpec| slider(&p.slider).map(|k| (k, p.sense * 0.25 * PI * p.bore_m * p.bore_m));
    let chambers = spec.chambers.iter().map(|c| Chamber {
        name: c.name.clone(),
        volume_m3: c.volume_m3,
        pistons: c.pistons.iter().filter_map(piston).collect(),
        start_pa: c.start_pa,
    });
    let reservoir = |(name, pa): &(String, f64)| Reservoir { name: name.clone(), pressure_pa: *pa };
    Network::new(spec.oil, chambers.collect(), spec.reservoirs.iter().map(reservoir).collect(), passages)
}

impl Model {
    /// Puts the oil of a drive in, and the balls of its check valves.
    pub fn add_oil(&mut self, drive: &Drive) {
        let Some(spec) = &drive.oil_with_effects() else { return };
        let slider = |name: &str| {
            let of_tensioner = self.sliders.iter().find(|s| s.name == name).map(|s| s.coordinate);
            of_tensioner.or_else(|| self.coordinates.iter().position(|c| c.path == name))
        };
        let network = network(spec, &slider, self.coordinates.len());
        for p in &spec.passages {
            if let PassageLaw::Check(ball) = &p.law {
                self.add_ball(&p.path, ball);
            }
        }
        self.oil = Some(network);
    }

    /// Makes a coordinate the back of an arm that gives way: it gets its share of the arm's inertia, the arm's spring, and what presses on the arm.
    pub(super) fn split_arm(&mut self, spec: &ArmEffect, back: usize) {
        let Some(arm) = self.arms.iter_mut().find(|a| a.name == spec.arm) else { return };
        let rails = std::mem::replace(&mut arm.back, back);
        let whole = &mut self.coordinates[rails];
        let inertia = 1.0 / whole.inverse_inertia();
        let share = spec.back_share * inertia;
        whole.add_inertia(-share);
        let (spring, reach_m) = (std::mem::take(&mut whole.spring), whole.reach_m);
        let own = &mut self.coordinates[back];
        own.add_inertia(share);
        (own.spring, own.reach_m) = (spring, reach_m);
        for touch in &mut self.touches {
            touch.shape = touch.shape.clone().renumbered(|q| if q == rails { back } else { q });
        }
        let stiffness = 1.0 / spec.compliance_rad_per_nm;
        let reduced = share * (1.0 - spec.back_share);
        self.couplings.push(Coupling {
            path: spec.path.clone(),
            ends: [rails, back],
            stiffness_nm_per_rad: stiffness,
            damping_nm_s_per_rad: 2.0 * spec.damping_ratio * (stiffness * reduced).sqrt(),
        });
    }

    /// Puts the pawls of ratchets in.
    pub fn add_ratchets(&mut self, drive: &Drive) {
        let Some(contact) = &drive.tip_contact else { return };
        for spec in &drive.sliders {
            let Some(ratchet) = spec.ratchet else { continue };
            let Some(slider) = self.sliders.iter().find(|s| s.name == spec.name).map(|s| s.coordinate) else {
                continue;
            };
            let pawl = self.coordinates.len();
            self.coordinates.push(Coordinate {
                path: format!("sliders.{}_pawl", spec.name),
                kind: CoordinateKind::Slides,
                motion: CoordinateMotion::Held,
                spring: CoordinateSpring::default(),
                nominal_speed_rad_s: 0.0,
                reach_m: 1.0,
                rest_load: 0.0,
                is_held_at_rest: true,
                is_run_in: false,
            });
            self.touches.push(Touch {
                path: format!("sliders.{}.ratchet", spec.name),
                shape: TouchShape::Between { front: slider, back: pawl, limit_m: -ratchet.backlash_m, sense: -1.0 },
                law: contact.law,
                friction: 0.0,
                stick_speed_m_s: contact.stick_speed_m_s,
                radii: PairRadii { bush_m: STOP_RADIUS_M, body_m: f64::INFINITY },
            });
            let RatchetSpec { pitch_m, backlash_m } = ratchet;
            self.ratchets.push(Ratchet { slider, pawl, pitch_m, backlash_m });
        }
    }

    /// Lets pawls click on over the teeth that have passed them. No pawl holds anything then, so that no energy is in it.
    #[inline(always)]
    pub fn click(&self, q: &mut [f64]) {
        for r in &self.ratchets {
            let teeth = libm::floor((q[r.slider] - q[r.pawl]) / r.pitch_m);
            // A slider that is out of all bounds is told by the step.
            if (1.0..MOST_TEETH).contains(&teeth) {
                q[r.pawl] += teeth * r.pitch_m;
            }
        }
    }

    /// Puts every pawl behind the last tooth that its slider has reached.
    pub fn engage_pawls(&self, q: &mut [f64]) {
        for r in &self.ratchets {
            q[r.pawl] = libm::floor(q[r.slider] / r.pitch_m) * r.pitch_m;
        }
    }

    fn add_ball(&mut self, path: &str, ball: &CheckSpec) {
        let coordinate = self.coordinates.len();
        let (spring, load) = spring(ball.spring_n_per_m, -ball.spring_n, 0.0);
        self.coordinates.push(Coordinate {
            path: path.to_string(),
            kind: CoordinateKind::Slides,
            motion: CoordinateMotion::Free { inertia: ball.mass_kg, load },
            spring,
            nominal_speed_rad_s: 0.0,
            reach_m: 1.0,
            rest_load: 0.0,
            is_held_at_rest: true,
            is_run_in: true,
        });
        let law =
            ContactLaw::Linear { stiffness_n_per_m: ball.stiffness_n_per_m, damping_n_s_per_m: ball.damping_n_s_per_m };
        for (key, limit, sense) in [("seat", 0.0, -1.0), ("stop", ball.lift_m, 1.0)] {
            self.touches.push(Touch {
                path: format!("{path}.{key}"),
                shape: TouchShape::Stop { coordinate, limit, sense, lever_m: 1.0 },
                law,
                friction: 0.0,
                stick_speed_m_s: 0.1,
                radii: PairRadii { bush_m: ball.ball_radius_m, body_m: f64::INFINITY },
            });
        }
    }

    /// Number of coordinates that turn: they stand before those that slide.
    pub fn n_turning(&self) -> usize {
        self.coordinates.iter().take_while(|c| c.kind == CoordinateKind::Turns).count()
    }
}
