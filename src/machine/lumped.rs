//! The lumped fidelity: bodies with one coordinate each, springs between them, any motion from any start, in milliseconds.

use super::fidelity::{
    Fidelity, PitchPeriod, RecordsOfSensors, RoomForEffect, RunRequest, SearchEffort, UnrepeatedPart,
};
use super::simulate::{self, InitialState, RunError, Task};
use super::{Body, BodyMotion, InputKind, Machine, Reads, Target};
use crate::effects::{Effect, Kind, On, Parameter, Physics};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

#[derive(Clone, Copy, Debug)]
pub(super) struct Lumped;

const EFFORT: SearchEffort = SearchEffort {
    beam: [6, 3, 2],
    fitted: 6,
    effects: 4,
    restarts: 4,
    is_thorough: true,
    converged_share: 2e-6,
    iterations: usize::MAX,
    noise_alone_is_left: true,
    has_steps: true,
    small_length_m: 10e-6,
};

impl Fidelity for Lumped {
    fn targets(&self, m: &Machine, effect: &Effect) -> Vec<(String, Target)> {
        if matches!(effect.physics, Physics::LinksOnly) {
            return Vec::new();
        }
        // Parts that were added by effects carry no effects of their own.
        let by_angle = effect.parameters.iter().any(|p| p.kind == Kind::Phase);
        let declared = |path: &str| !path.starts_with("effects.");
        let bodies = |fits: &dyn Fn(&Body) -> bool| {
            let all = m.bodies.iter().enumerate();
            all.filter(|(_, b)| declared(&b.path) && fits(b)).map(|(i, b)| (b.name.clone(), Target::Body(i))).collect()
        };
        let sensors = |fits: &dyn Fn(&Reads) -> bool| {
            let all = m.sensors.iter().enumerate();
            all.filter(|(_, s)| fits(&s.reads)).map(|(i, s)| (s.name.clone(), Target::Sensor(i))).collect()
        };
        let sprung = |i: usize| m.springs.iter().any(|s| s.ends.iter().any(|e| e.body == i));
        match effect.on {
            On::Body => {
                // Where the motion is prescribed, a force on the body shows in what drives it.
                let felt = |i: usize| {
                    let measured = matches!(m.bodies[i].motion, BodyMotion::Measured(_));
                    m.bodies[i].motion == BodyMotion::Free
                        || measured && m.sensors.iter().any(|s| s.reads == Reads::Reaction(i))
                };
                let all = m.bodies.iter().enumerate();
                all.filter(|(i, b)| declared(&b.path) && felt(*i) && !(b.slides && by_angle))
                    .map(|(i, b)| (b.name.clone(), Target::Body(i)))
                    .collect()
            }
            // A measured speed already contains its fluctuation.
            On::Prescribed => bodies(&|b| matches!(b.motion, BodyMotion::Constant(_)) && !b.slides),
            On::Sprocket => {
                let all = m.bodies.iter().enumerate();
                all.filter(|(i, b)| b.teeth.is_some() && sprung(*i))
                    .map(|(i, b)| (b.name.clone(), Target::Body(i)))
                    .collect()
            }
            On::Span => {
                let all = m.springs.iter().enumerate().filter(|(_, s)| declared(&s.path));
                all.map(|(i, s)| (s.name.clone(), Target::Spring(i))).collect()
            }
            On::Chain | On::Joints => {
                let located = m.springs.iter().any(|s| s.links.is_some());
                let needs = effect.on == On::Chain;
                if !m.chains.is_empty() && (located || !needs) {
                    vec![("chain".to_string(), Target::Chain(0))]
                } else {
                    Vec::new()
                }
            }
            On::Guide
            | On::Blade
            | On::Bearing
            | On::Valve
            | On::Coupling
            | On::Arm
            | On::Leak
            | On::Orifice
            | On::Check
            | On::Oil => Vec::new(),
            On::Input => {
                let all = m.inputs.iter().enumerate();
                all.filter(|(_, i)| matches!(i.kind, InputKind::Force(_)))
                    .map(|(k, i)| (i.name.clone(), Target::Input(k)))
                    .collect()
            }
            On::Sensor => sensors(&|r| !matches!(r, Reads::Pulses { .. })),
            On::AngleSensor => sensors(&|r| match r {
                Reads::Angle(b) | Reads::Speed(b) => !m.bodies[*b].slides,
                Reads::Acceleration(_)
                | Reads::Pulses { .. }
                | Reads::Tension(_)
                | Reads::Reaction(_)
                | Reads::Part(_) => false,
            }),
            On::Pickup => sensors(&|r| matches!(r, Reads::Pulses { .. })),
        }
    }

    fn accepts(&self, _effect: &Effect, _target: Target, _p: &Parameter) -> bool {
        true
    }

    fn has_reference(&self) -> bool {
        true
    }

    fn slider_of(&self, _m: &Machine, _sensor: usize) -> Option<usize> {
        None
    }

    fn range(&self, _effect: &Effect, _target: Target) -> Option<(f64, f64)> {
        None
    }

    fn room_for(&self, _m: &Machine, _effect: &Effect, _target: Target, _path: &str) -> RoomForEffect {
        RoomForEffect::Free
    }

    fn has_place(&self, _effect: &Effect) -> bool {
        false
    }

    fn shows_at_start_alone(&self, _effect: &Effect) -> bool {
        false
    }

    fn period_pitches(&self, _m: &Machine) -> Option<PitchPeriod> {
        None
    }

    fn indices(&self, _m: &Machine, _target: Target) -> Option<Vec<f64>> {
        None
    }

    fn mean_speed(&self, _m: &Machine, _values: &[f64], _body: usize) -> Option<f64> {
        None
    }

    fn grid(&self, _m: &Machine, _slot: usize, _logarithm: bool) -> Option<f64> {
        None
    }

    fn run(&self, m: &Machine, r: &RunRequest) -> Result<Vec<Vec<f64>>, RunError> {
        r.runs.fetch_add(1, Ordering::Relaxed);
        simulate::run(m, r.values, r.task, r.start, r.channels, r.max_steps, r.observed)
    }

    fn unrepeated(&self, _m: &Machine, _values: &[f64], _runs: &AtomicU64) -> Option<Vec<UnrepeatedPart>> {
        None
    }

    fn steps_needed(&self, m: &Machine, values: &[f64], task: &Task, start: &InitialState) -> Option<f64> {
        Some(simulate::steps_needed(m, values, task, start))
    }

    fn for_records(&self, _records: RecordsOfSensors) -> Option<Arc<dyn Fidelity>> {
        None
    }

    fn effort(&self) -> &'static SearchEffort {
        &EFFORT
    }
}
