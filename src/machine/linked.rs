//! The fidelity with link bodies: steady motion, read off one period of a run that takes a second; runs are kept.

use super::fidelity::{
    Fidelity, PitchPeriod, RecordsOfSensors, RoomForEffect, RunRequest, SearchEffort, UnrepeatedPart,
};
use super::period::{PeriodOfDrive, lcm};
use super::response::{MAX_PERIOD_S, PeriodicResponse, ResponseError};
use super::simulate::{InitialState, RunError, Samples, Task, between, clock, own_clocks, through_sensor};
use super::{Body, BodyMotion, ChainLoop, Machine, PlacedEffect, Reads, Target};
use crate::drive::Drive;
use crate::drive::bearings::Carried;
use crate::drive::chains::gcd;
use crate::drive::mechanism::PassageLaw;
use crate::drive::sensors::{SensorReads, is_signal};
use crate::effects::{Effect, Kind, On, Parameter, bearing_clearance, guide_friction};
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// What a run was made with: paths of numbers that differ from the file's, and their bits.
type ChangedNumbers = Vec<(String, u64)>;

/// A drive with link bodies behind the machine that records see.
#[derive(Debug)]
pub(super) struct LinkedDrive {
    drive: Drive,
    /// Values of the machine as the file has them.
    file: Vec<f64>,
    period: PeriodOfDrive,
    /// Paths of effects that the drive file declares.
    declared: Vec<String>,
    records: RecordsOfSensors,
    known: Mutex<HashMap<ChangedNumbers, Arc<Result<PeriodicResponse, ResponseError>>>>,
}

/// Distances of the grid on which runs are made, scaled: of sizes of effects over those that they start from, of waves (and their phases [rad]), and of
/// logarithms of numbers. Not varied.
const SIZE_GRID: f64 = 0.5;
const WAVE_GRID: f64 = 0.1;
const NUMBER_GRID: f64 = 0.05;

const EFFORT: SearchEffort = SearchEffort {
    beam: [2; 3],
    fitted: 4,
    effects: 2,
    // A drive with link bodies is too costly to restart, and its parameters are close to the true ones.
    restarts: 0,
    is_thorough: false,
    // The non-repeating part hides smaller steps; the model is nearly linear in the unknowns.
    converged_share: 1e-4,
    iterations: 8,
    noise_alone_is_left: false,
    has_steps: false,
    // Large enough to exceed the non-repeating part.
    small_length_m: 30e-6,
};

impl LinkedDrive {
    pub(super) fn new(drive: &Drive, m: &Machine, period: PeriodOfDrive, declared: Vec<String>) -> LinkedDrive {
        let (drive, file, records, known) = (drive.clone(), m.values.clone(), Default::default(), Mutex::default());
        LinkedDrive { drive, file, period, declared, records, known }
    }

    /// The numbers that turn the file's drive into this machine with these values, in the units of their keys.
    fn numbers(&self, m: &Machine, values: &[f64]) -> Vec<(String, f64)> {
        let mut all = Vec::new();
        let at_sensors =
            |path: &str| path.starts_with("sensors.") || self.drive.signals.iter().any(|s| path.starts_with(&s.path));
        for ((slot, value), file) in m.slots.iter().zip(values).zip(&self.file) {
            if value != file && !at_sensors(&slot.path) {
                all.push((slot.path.clone(), value / slot.unit));
            }
        }
        for p in m.placed.iter().filter(|p| !is_signal(p.effect)) {
            for ((key, row), slot) in m.keys(p.effect, p.target).iter().zip(&p.slots) {
                let value = values[*slot] / row.unit;
                let value = if row.is_integer() { libm::round(value) } else { value };
                all.push((format!("{}.{key}", p.path), value));
            }
        }
        all
    }

    /// One period of the drive with these values.
    fn response(&self, m: &Machine, values: &[f64], runs: &AtomicU64) -> Arc<Result<PeriodicResponse, ResponseError>> {
        let numbers = self.numbers(m, values);
        let key: ChangedNumbers = numbers.iter().map(|(path, x)| (path.clone(), (x + 0.0).to_bits())).collect();
        if let Ok(known) = self.known.lock()
            && let Some(response) = known.get(&key)
        {
            return response.clone();
        }
        runs.fetch_add(1, Ordering::Relaxed);
        let drive = self.drive.with_numbers(&numbers).map_err(ResponseError::Drive);
        let (alike, pitches) = (self.period.alike, self.pitches(m));
        // An effect's numbers may make its own period longer: half an order takes two turns.
        let repeats = |drive: &Drive| lcm(pitches, PeriodOfDrive::of(drive).declared);
        let run = |drive: Drive| PeriodicResponse::of(&drive, alike, repeats(&drive), &self.records);
        let response = Arc::new(drive.and_then(run));
        if let Ok(mut known) = self.known.lock() {
            known.insert(key, response.clone());
        }
        response
    }

    /// Parts that an effect acts on by their names alone.
    fn parts(&self, effect: &Effect) -> Vec<(String, Target)> {
        let named = |path: &str| crate::diag::last_name(path).to_string();
        let passages = self.drive.oil.iter().flat_map(|oil| &oil.passages);
        let passages = |fits: &dyn Fn(&PassageLaw) -> bool| -> Vec<String> {
            passages.clone().filter(|p| fits(&p.law)).map(|p| named(&p.path)).collect()
        };
        let names: Vec<String> = match effect.links {
            Some(On::Guide) => {
                // A rail on an arm, one that bends and what stands on a bearing give way already.
                let held = |on: Carried| self.drive.bearings.iter().all(|b| b.on != on);
                let rails = self.drive.rails.iter().enumerate().filter(|(k, r)| {
                    *effect == guide_friction::ROW || r.arm.is_none() && r.bending.is_none() && held(Carried::Rail(*k))
                });
                let guides = self.drive.guides.iter().enumerate();
                let guides = guides.filter(|(k, _)| *effect == guide_friction::ROW || held(Carried::Guide(*k)));
                guides.map(|(_, g)| g.name.clone()).chain(rails.map(|(_, r)| r.name.clone())).collect()
            }
            Some(On::Blade | On::Bearing | On::Valve | On::Coupling) => self.drive.parts_for(effect.on),
            Some(On::Arm) => self.drive.arms.iter().map(|a| a.name.clone()).collect(),
            Some(On::Leak) => passages(&|law| matches!(law, PassageLaw::Leak { .. })),
            Some(On::Orifice) => passages(&|law| matches!(law, PassageLaw::Orifice { .. })),
            Some(On::Check) => passages(&|law| matches!(law, PassageLaw::Check(_))),
            Some(On::Oil) => self.drive.oil.iter().map(|_| "oil".to_string()).collect(),
            Some(
                On::Body
                | On::Prescribed
                | On::Sprocket
                | On::Span
                | On::Chain
                | On::Joints
                | On::Input
                | On::Sensor
                | On::AngleSensor
                | On::Pickup,
            )
            | None => Vec::new(),
        };
        names.into_iter().enumerate().map(|(i, name)| (name, Target::Part(i))).collect()
    }

    /// Period in pitches, with all effects that are placed.
    fn pitches(&self, m: &Machine) -> u32 {
        m.placed.iter().fold(self.period.declared, |all, p| lcm(all, self.own_period(m, p.effect, p.target)))
    }

    /// Period in pitches of an effect at a target; 1: it is the same all round, as friction and drag are.
    fn own_period(&self, m: &Machine, effect: &Effect, target: Target) -> u32 {
        match target {
            Target::Body(b) if effect.differs_round_turn() => self.period.of_body(b),
            Target::Chain(c) if effect.links == Some(On::Chain) => self.period.pitches[c].period(m.chains[c].links),
            Target::Body(_)
            | Target::Spring(_)
            | Target::Input(_)
            | Target::Sensor(_)
            | Target::Chain(_)
            | Target::Part(_)
            | Target::Span(_) => 1,
        }
    }

    /// Names under which a drive file puts an effect on what a body sits on: its shaft, and all sprockets of it.
    fn names_of_shaft(&self, m: &Machine, body: usize) -> Vec<String> {
        let own = &m.bodies[body];
        let sprockets = m.bodies.iter().filter(|b| own.turns_with(b)).map(|b| b.name.clone());
        sprockets.chain(own.shaft_name(m).map(str::to_string)).collect()
    }

    /// Speed that a body turns with in the mean [rad/s].
    fn speed(&self, m: &Machine, values: &[f64], body: usize) -> f64 {
        let driver = m.bodies.iter().find_map(|b| match b.motion {
            BodyMotion::Constant(slot) => Some(values[slot] * f64::from(b.teeth.unwrap_or(1))),
            BodyMotion::Free | BodyMotion::Measured(_) => None,
        });
        let pitches_rad_s = driver.unwrap_or(0.0);
        self.period.turns[body].map_or(0.0, |(turns, sense)| pitches_rad_s * turns.value() * sense)
    }

    /// A channel at the samples.
    fn channel(
        &self,
        (m, values): (&Machine, &[f64]),
        response: &PeriodicResponse,
        (start_s, t_s, step_s): (f64, &[f64], f64),
        start: &InitialState,
        sensor: usize,
    ) -> Vec<f64> {
        let clock = clock(m, values);
        let gain = values[m.sensors[sensor].gain];
        let body = m.body_of(sensor);
        let speed = body.map_or(0.0, |b| self.speed(m, values, b));
        let turns = matches!(m.sensors[sensor].reads, Reads::Angle(_));
        let clocks = own_clocks(m, values, sensor);
        let at = |t: f64| {
            let t = t + clocks.iter().map(|(law, p)| law(p, start_s + t)).sum::<f64>();
            let mean = response.at(sensor, start.travel + t * response.pitches_per_s);
            if turns { mean + start.q[body.unwrap_or(0)] + speed * t } else { mean }
        };
        let altered = m.placed.iter().any(|p| p.target == Target::Sensor(sensor));
        if !altered {
            return t_s.iter().map(|t| gain * at(t / (1.0 + clock))).collect();
        }
        // Signal effects need evenly spaced nodes, finer than the samples.
        let h = 0.25 * step_s;
        let last = t_s.last().copied().unwrap_or(0.0) / (1.0 + clock);
        let nodes = libm::ceil(last / h) as usize + 3;
        let series = (0..nodes).map(|i| gain * at(i as f64 * h)).collect();
        let turned: Vec<f64> = (0..nodes).map(|i| speed * i as f64 * h).collect();
        let series = through_sensor(m, values, sensor, series, &turned, (None, h));
        t_s.iter().map(|t| between(&series, t / (1.0 + clock) / h)).collect()
    }
}

impl Fidelity for LinkedDrive {
    fn targets(&self, m: &Machine, effect: &Effect) -> Vec<(String, Target)> {
        if is_signal(effect) {
            let turns = |r: Reads| matches!(r, Reads::Angle(_) | Reads::Speed(_));
            let all = m.sensors.iter().enumerate();
            let fits = all.filter(|(_, s)| effect.on == On::Sensor || turns(s.reads));
            return fits.map(|(i, s)| (s.name.clone(), Target::Sensor(i))).collect();
        }
        let bodies = |fits: &dyn Fn(&Body) -> bool| {
            let all = m.bodies.iter().enumerate().filter(|(_, b)| fits(b));
            all.map(|(i, b)| (b.name.clone(), Target::Body(i))).collect()
        };
        // A shaft is there once for each of its sprockets.
        let first_of_shaft =
            |b: &Body| m.bodies.iter().find(|o| o.turns_with(b)).is_some_and(|first| first.path == b.path);
        match effect.links {
            Some(On::Sprocket) => bodies(&|b| {
                b.teeth.is_some() && m.chains.iter().any(|c| c.sprockets.iter().any(|s| m.bodies[*s].path == b.path))
            }),
            Some(On::Chain) => {
                let name = |c: &ChainLoop| if c.name.is_empty() { "found".to_string() } else { c.name.clone() };
                m.chains.iter().enumerate().map(|(i, c)| (name(c), Target::Chain(i))).collect()
            }
            Some(On::Joints) => vec![("chain".to_string(), Target::Chain(0))],
            Some(On::Span) => m.spans.iter().enumerate().map(|(i, s)| (s.name.clone(), Target::Span(i))).collect(),
            Some(On::Body) => bodies(&|b| b.motion == BodyMotion::Free && first_of_shaft(b)),
            Some(On::Prescribed) => bodies(&|b| b.motion != BodyMotion::Free && first_of_shaft(b)),
            Some(
                On::Guide
                | On::Blade
                | On::Bearing
                | On::Valve
                | On::Coupling
                | On::Arm
                | On::Leak
                | On::Orifice
                | On::Check
                | On::Oil,
            ) => self.parts(effect),
            Some(On::Input | On::Sensor | On::AngleSensor | On::Pickup) | None => Vec::new(),
        }
    }

    /// Where all parts of the drive are alike, the position of a sprocket or the chain at the start of a record is found as the record's travel, so
    /// that effects on them have no phase of their own. Beside declared orders, valves or defects, waves on what turns have one.
    fn accepts(&self, effect: &Effect, target: Target, p: &Parameter) -> bool {
        let turns = matches!(target, Target::Body(b) if self.period.turns.get(b).is_some_and(Option::is_some));
        is_signal(effect) || !p.lumped_only && (p.kind != Kind::Phase || turns && self.has_reference())
    }

    fn has_reference(&self) -> bool {
        self.period.declared > self.period.alike
    }

    fn slider_of(&self, m: &Machine, sensor: usize) -> Option<usize> {
        let SensorReads::Slider(k) = self.drive.sensors.get(sensor)?.reads else { return None };
        let name = &self.drive.sliders.get(k)?.name;
        m.bodies.iter().position(|b| b.slides && b.name == *name)
    }

    fn range(&self, effect: &Effect, target: Target) -> Option<(f64, f64)> {
        let Target::Part(part) = target else { return None };
        let (name, _) = self.parts(effect).into_iter().nth(part)?;
        if *effect == bearing_clearance::ROW {
            return self.drive.clearance_range_m(&name);
        }
        self.drive.oil.as_ref()?.range_of(effect, &name)
    }

    fn room_for(&self, m: &Machine, effect: &Effect, target: Target, path: &str) -> RoomForEffect {
        // A shaft has as many names as sprockets.
        let is_on_shaft = matches!(effect.links, Some(On::Body | On::Prescribed));
        let names =
            if let (Target::Body(b), true) = (target, is_on_shaft) { self.names_of_shaft(m, b) } else { Vec::new() };
        let others = names.iter().map(|name| format!("effects.{}.{name}", effect.name));
        if std::iter::once(path.to_string()).chain(others).any(|p| self.declared.contains(&p)) {
            return RoomForEffect::Refused("declared already");
        }
        if m.placed.iter().any(|p| p.path == path) {
            return RoomForEffect::Taken;
        }
        let pitches_m =
            f64::from(lcm(self.pitches(m), self.own_period(m, effect, target))) * self.drive.chain.pitch_m();
        if pitches_m > MAX_PERIOD_S * self.drive.chain_speed_m_s().abs() {
            return RoomForEffect::Refused(
                "with it the drive comes back to where it was only after more than ten seconds",
            );
        }
        let has_place = self.has_place(effect);
        if has_place && m.placed.iter().any(|p| self.has_place(p.effect)) {
            return RoomForEffect::Refused(
                "only one effect with a place on the loop at a time: its position relative to a second one is not searched",
            );
        }
        if has_place && self.drive.sensors.iter().any(|s| matches!(s.reads, SensorReads::Link(_))) {
            return RoomForEffect::Refused(
                "a gauge that goes round with the chain: where the effect lies to it is not looked for",
            );
        }
        RoomForEffect::Free
    }

    /// A wave with a phase has no other place.
    fn has_place(&self, effect: &Effect) -> bool {
        let is_wave = effect.parameters.iter().any(|p| p.kind == Kind::Phase);
        effect.links == Some(On::Chain) || effect.differs_round_turn() && !(is_wave && self.has_reference())
    }

    fn shows_at_start_alone(&self, effect: &Effect) -> bool {
        !is_signal(effect)
    }

    fn period_pitches(&self, m: &Machine) -> Option<PitchPeriod> {
        Some(PitchPeriod { whole: self.pitches(m), alike: self.period.alike })
    }

    /// Links and teeth that lie as far apart as a start of a record can move them are the same. In a drive with one chain two differ.
    fn indices(&self, m: &Machine, target: Target) -> Option<Vec<f64>> {
        let (first, passed, all) = match target {
            Target::Chain(c) => {
                let chain = &m.chains[c];
                (chain.first_link, self.period.pitches[c].scaled(self.period.alike, 1), chain.links)
            }
            Target::Body(b) => {
                let teeth = m.bodies[b].teeth?;
                (0, self.period.turns[b]?.0.scaled(teeth * self.period.alike, 1), teeth)
            }
            Target::Spring(_) | Target::Input(_) | Target::Sensor(_) | Target::Part(_) | Target::Span(_) => {
                return None;
            }
        };
        let apart = gcd(passed.times, u64::from(all)).max(2);
        Some((0..apart).map(|i| f64::from(first) + i as f64).collect())
    }

    fn mean_speed(&self, m: &Machine, values: &[f64], body: usize) -> Option<f64> {
        Some(self.speed(m, values, body))
    }

    /// The response of the links is known only up to its non-repeating part: a fit is smooth on a grid, and needs few runs.
    fn grid(&self, m: &Machine, slot: usize, logarithm: bool) -> Option<f64> {
        let placed = m.placed.iter().find(|p| p.slots.contains(&slot));
        let at_sensor = placed.is_some_and(|p| is_signal(p.effect)) || m.sensors.iter().any(|s| s.gain == slot);
        // A wave is linear in amplitude and phase over a small part of a turn alone.
        let has_phase = |p: &&PlacedEffect| {
            p.effect.parameters.iter().any(|row| row.kind == Kind::Phase && self.accepts(p.effect, p.target, row))
        };
        let by_size = if placed.filter(has_phase).is_some() { WAVE_GRID } else { SIZE_GRID };
        (!at_sensor).then_some(if placed.is_some() && !logarithm { by_size } else { NUMBER_GRID })
    }

    /// The weighted mean of the runs with the values of the corners.
    fn run(&self, m: &Machine, r: &RunRequest) -> Result<Vec<Vec<f64>>, RunError> {
        let mut response: Option<PeriodicResponse> = None;
        for (weight, values) in r.corners {
            let run = self.response(m, values, r.runs);
            let run = run.as_ref().as_ref().map_err(|why| RunError::Refused { why: why.to_string() })?;
            match &mut response {
                None if *weight == 1.0 => response = Some(run.clone()),
                None => response = Some(run.scaled_by(*weight)),
                Some(response) => response.add(run, *weight),
            }
        }
        let Some(response) = response else { return Err(RunError::Diverged { t_s: 0.0 }) };
        let response = &if r.folded { response.folded() } else { response };
        let Samples::Times { t_s, step_s, .. } = &r.task.samples else {
            return Err(RunError::NoPulse { t_s: 0.0, pulses: 0 });
        };
        let of =
            |sensor: &usize| self.channel((m, r.values), response, (r.task.start_s, t_s, *step_s), r.start, *sensor);
        Ok(r.channels.iter().map(of).collect())
    }

    fn unrepeated(&self, m: &Machine, values: &[f64], runs: &AtomicU64) -> Option<Vec<UnrepeatedPart>> {
        let response = self.response(m, values, runs);
        let r = response.as_ref().as_ref().ok()?;
        let part = |size: &f64| UnrepeatedPart { size: *size, in_mean: size / libm::sqrt(r.periods as f64) };
        Some(r.unrepeated.iter().map(part).collect())
    }

    fn steps_needed(&self, _m: &Machine, _values: &[f64], _task: &Task, _start: &InitialState) -> Option<f64> {
        None
    }

    fn for_records(&self, records: RecordsOfSensors) -> Option<Arc<dyn Fidelity>> {
        Some(Arc::new(LinkedDrive {
            drive: self.drive.clone(),
            file: self.file.clone(),
            period: self.period.clone(),
            declared: self.declared.clone(),
            records,
            known: Mutex::default(),
        }))
    }

    fn effort(&self) -> &'static SearchEffort {
        &EFFORT
    }
}
