//! A drive with link bodies in the form that measured records need: shafts, sensors, parameters and places for effects.
//! Its motion is left to the simulation of the links.

use super::linked::LinkedDrive;
use super::period::PeriodOfDrive;
use super::{Body, BodyMotion, ChainLoop, Machine, PlacedEffect, Reads, Sensor, Slot, SpanNumbers, Target};
use crate::assemble::at_rest;
use crate::diag::last_name;
use crate::drive::sensors::SensorReads;
use crate::drive::{ChainFidelity, Drive, OuterSpec, SpanSpec};
use crate::effects::parameter_at;
use crate::units::RPM;
use std::sync::Arc;

/// [kg].
const GRAM: f64 = 1e-3;

impl Machine {
    /// The machine of a drive with link bodies.
    pub fn of_links(drive: &Drive) -> Machine {
        let mut m = Machine {
            name: drive.name.clone(),
            text: drive.text.clone(),
            chains: chains_of(drive),
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
            // What several sprockets sit on has the numbers.
            let on = s.shaft.map_or(("sprockets", &s.name), |k| ("shafts", &drive.shafts[k].name));
            let (inertia, motion) = match s.outer {
                OuterSpec::Speed { speed_rad_s } => {
                    let speed = slot(format!("speeds.constant.{}.speed_rpm", on.1), RPM, speed_rad_s);
                    (None, BodyMotion::Constant(speed))
                }
                OuterSpec::Load { inertia_kg_m2, .. } => {
                    let path = format!("{}.{}.inertia_kg_m2", on.0, on.1);
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
        let bare = drive.bare_shafts().into_iter().map(|k| {
            let OuterSpec::Load { inertia_kg_m2, .. } = drive.shafts[k].outer else { return None };
            Some((format!("shafts.{}", drive.shafts[k].name), "inertia_kg_m2", 1.0, inertia_kg_m2))
        });
        let arms = drive.arms.iter().map(|a| Some((format!("arms.{}", a.name), "inertia_kg_m2", 1.0, a.inertia_kg_m2)));
        let sliders = drive.sliders.iter().map(|s| Some((format!("sliders.{}", s.name), "mass_g", GRAM, s.mass_kg)));
        for (path, key, unit, inertia) in bare.chain(arms).chain(sliders).flatten() {
            m.bodies.push(Body {
                name: last_name(&path).to_string(),
                slides: path.starts_with("sliders."),
                inertia: Some(slot(format!("{path}.{key}"), unit, inertia)),
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
                | SensorReads::Valve(_)
                | SensorReads::Twist(_)
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
        // Without rest there is no run either, whose error says why.
        let spans =
            if drive.span_paths().is_empty() { Vec::new() } else { at_rest(drive).map_or(Vec::new(), |r| r.0.spans) };
        // Effects on a span have numbers of their own, and are added to these.
        let numbers = spans.iter().map(|span| {
            let mut own = |key: &str, value: f64| slot(format!("{}.{key}", span.path), 1.0, value);
            let stiffness = own("stiffness_n_per_m", span.own_n_per_m);
            let damping = own("damping_n_s_per_m", span.own_n_s_per_m);
            SpanNumbers { name: last_name(&span.path).to_string(), stiffness, damping }
        });
        m.spans = numbers.collect();
        for span in &m.spans {
            for (known, range) in
                [(span.stiffness, SpanSpec::STIFFNESS_N_PER_M), (span.damping, SpanSpec::DAMPING_N_S_PER_M)]
            {
                (m.slots[known].low, m.slots[known].high) = (*range.start(), *range.end());
            }
        }
        m.fidelity = Arc::new(LinkedDrive::new(drive, &m, PeriodOfDrive::of(drive), declared(&drive.places)));
        m
    }
}

/// The chains that have links.
fn chains_of(drive: &Drive) -> Vec<ChainLoop> {
    let mut first_link = 0;
    let mut all = Vec::new();
    for chain in (0..drive.chains()).filter(|chain| drive.fidelity_of(*chain) == ChainFidelity::Links) {
        let (name, links) = (drive.chain_names.get(chain).cloned().unwrap_or_default(), drive.links_of(chain) as u32);
        let (leader, sprockets) = (drive.leader_of(chain), drive.sprockets_of(chain).collect());
        all.push(ChainLoop { name, links, first_link, leader, sprockets });
        first_link += links;
    }
    if let [only] = &mut all[..] {
        only.name.clear();
    }
    all
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
