//! A drive with link bodies in the form that measured records need: shafts, sensors, parameters and places for effects.
//! Its motion is left to the simulation of the links.

use super::linked::LinkedDrive;
use super::response::turns_of_orders;
use super::{Body, BodyMotion, ChainLoop, Machine, PlacedEffect, Reads, Sensor, Slot, Target};
use crate::drive::sensors::SensorReads;
use crate::drive::shafts::Moving;
use crate::drive::{Drive, OuterSpec};
use crate::effects::parameter_at;
use crate::units::RPM;
use std::sync::Arc;

/// Greatest common divisor.
pub fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

pub(super) fn lcm(a: u32, b: u32) -> u32 {
    let (a, b) = (a.max(1), b.max(1));
    (a / gcd(a, b)).saturating_mul(b)
}

impl Machine {
    /// The machine of a drive with link bodies.
    pub fn of_links(drive: &Drive) -> Machine {
        let mut m = Machine {
            name: drive.name.clone(),
            text: drive.text.clone(),
            chain: Some(ChainLoop { links: drive.links as u32, leader: drive.driver() }),
            places: drive.places.clone(),
            ..Machine::empty(drive.title.clone())
        };
        for (path, n) in drive.places.numbers() {
            let (low, high) = parameter_at(path).map_or((n.low, n.high), |p| (p.low, p.high));
            m.slots.push(Slot { path: path.to_string(), unit: n.unit, low, high });
            m.values.push(n.value);
        }
        let mut slot = |path: String, unit: f64, value: f64| match m.slots.iter().position(|s| s.path == path) {
            Some(known) => {
                (m.slots[known].unit, m.values[known]) = (unit, value);
                known
            }
            None => {
                let (low, high) = parameter_at(&path).map_or((f64::MIN, f64::MAX), |p| (p.low, p.high));
                m.slots.push(Slot { path, unit, low, high });
                m.values.push(value);
                m.slots.len() - 1
            }
        };
        for s in &drive.sprockets {
            let (inertia, motion) = match s.outer {
                OuterSpec::Speed { speed_rad_s } => {
                    let speed = slot(format!("speeds.constant.{}.speed_rpm", s.name), RPM, speed_rad_s);
                    (None, BodyMotion::Constant(speed))
                }
                OuterSpec::Load { inertia_kg_m2, .. } => {
                    let path = format!("sprockets.{}.inertia_kg_m2", s.name);
                    (Some(slot(path, 1.0, inertia_kg_m2)), BodyMotion::Free)
                }
            };
            m.bodies.push(Body {
                name: s.name.clone(),
                path: format!("sprockets.{}", s.name),
                slides: false,
                inertia,
                minus: None,
                teeth: Some(s.teeth),
                motion,
            });
        }
        let bare = drive
            .bare_shafts()
            .into_iter()
            .map(|k| (format!("shafts.{}", drive.shafts[k].name), drive.shafts[k].outer));
        let arms = drive
            .arms
            .iter()
            .map(|a| (format!("arms.{}", a.name), OuterSpec::Load { inertia_kg_m2: a.inertia_kg_m2, torque_nm: 0.0 }));
        for (path, outer) in bare.chain(arms) {
            let OuterSpec::Load { inertia_kg_m2, .. } = outer else { continue };
            m.bodies.push(Body {
                name: path.split_once('.').map_or(path.clone(), |(_, name)| name.to_string()),
                slides: false,
                inertia: Some(slot(format!("{path}.inertia_kg_m2"), 1.0, inertia_kg_m2)),
                path,
                minus: None,
                teeth: None,
                motion: BodyMotion::Free,
            });
        }
        for s in &drive.sensors {
            let gain = slot(format!("{}.gain", s.path), 1.0, s.gain);
            let reads = match s.reads {
                SensorReads::Angle(b) => Reads::Angle(b),
                SensorReads::Speed(b) => Reads::Speed(b),
                SensorReads::Acceleration(b) => Reads::Acceleration(b),
                SensorReads::Torque(b) => Reads::Reaction(b),
                SensorReads::Span(_)
                | SensorReads::Link(_)
                | SensorReads::Guide(_)
                | SensorReads::Slider(_)
                | SensorReads::Tip(_)
                | SensorReads::Pressure(_)
                | SensorReads::Flow(_) => Reads::Part(s.reads.unit()),
            };
            let (name, path, unit) = (s.name.clone(), s.path.clone(), s.unit.clone());
            m.sensors.push(Sensor { name, path, reads, gain, unit });
        }
        for s in &drive.signals {
            let keys = s.effect.parameters.iter().zip(&s.values);
            let slots = keys.map(|(p, value)| slot(format!("{}.{}", s.path, p.key), p.unit, *value)).collect();
            let (path, target) = (s.path.clone(), Target::Sensor(s.sensor));
            m.placed.push(PlacedEffect { effect: s.effect, path, target, slots });
        }
        m.fidelity = Arc::new(LinkedDrive::new(drive, &m, repeats(drive), declared(&drive.places), turns_as(drive)));
        m
    }
}

/// For every body of the machine: the sprocket that it turns as fast as.
fn turns_as(drive: &Drive) -> Vec<Option<usize>> {
    let bare = drive.bare_shafts().into_iter().map(|k| drive.sprocket_turning(Moving::Shaft(k)));
    (0..drive.sprockets.len()).map(Some).chain(bare).chain(drive.arms.iter().map(|_| None)).collect()
}

/// Tables of effects that the file declares.
fn declared(places: &crate::drive::reader::Places) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for path in places.paths().filter(|p| p.starts_with("effects.")) {
        let table = path.rsplit_once('.').map_or(path, |(t, _)| t).to_string();
        if table.split('.').count() == 3 && !all.contains(&table) {
            all.push(table);
        }
    }
    all
}

/// Period of the drive in pitches: two, unless one of its parts differs from its neighbours.
fn repeats(drive: &Drive) -> u32 {
    let e = &drive.effects;
    let links = drive.links as u32;
    let teeth = |k: usize| drive.sprockets[k].teeth;
    let mut all = 2;
    let single = !e.pitch_errors.is_empty()
        || !e.link_masses.is_empty()
        || !e.tight_joints.is_empty()
        || drive.scatter.pitch_m > 0.0;
    if single || drive.sensors.iter().any(|s| matches!(s.reads, SensorReads::Link(_))) {
        all = lcm(all, links);
    }
    let motion = &drive.train.motion;
    let orders = motion.harmonics.iter().chain(drive.train.order_loads.iter().flat_map(|l| &l.harmonics));
    if orders.clone().next().is_some() {
        // Orders are of the driver; half ones take two turns. Those without a period are refused where records are compared.
        all = lcm(all, turns_of_orders(orders).unwrap_or(2) * teeth(drive.driver()));
    }
    let train = &drive.train;
    if !train.motion.fluctuations.is_empty() {
        all = lcm(all, teeth(drive.driver()));
    }
    let uneven = train.loads.iter().filter(|l| l.effect.differs_round_turn());
    for k in uneven.filter_map(|l| drive.sprocket_turning(l.on)) {
        all = lcm(all, teeth(k));
    }
    for k in e.gap_errors.iter().map(|g| g.sprocket).chain(e.gap_waves.iter().map(|w| w.sprocket)) {
        all = lcm(all, teeth(k));
    }
    all
}
