//! Model of a drive with link bodies for identification: its sensor readings in steady, periodic operation.
//!
//! A drive at constant speed repeats itself after a whole number of pitches: two, if only inner and outer links differ;
//! one loop of the chain with one odd link; one revolution of a sprocket with one odd tooth. Sensor readings are folded
//! on that period. The mean over periods is the model output; the variation from period to period cannot be predicted,
//! because the spans of a fast chain move chaotically: two runs whose preload differs by 1e-5 N have only this mean in
//! common after 0.2 s at 3000 rpm. The position in the period at which a record starts is one parameter, its travel in
//! pitches.

use crate::drive::Drive;
use crate::drive::sensors::SensorReads;
use crate::effects::{Effect, On, Physics};
use crate::elements::driver_motion::Harmonic;
use crate::machine::simulate::{InitialState, RunError, Samples, Task, between, clock, cubic, through_sensor};
use crate::machine::{BodyMotion, Machine, Reads};
use crate::measurement::segments::Data;
use crate::sensing::Tracer;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Settling time after the drive's own run-in [s], for transients of its start.
const SETTLE_S: f64 = 0.06;
/// Shortest and longest duration that is folded [s].
const SHORTEST_S: f64 = 0.3;
const LONGEST_S: f64 = 1.6;
/// Folding continues until the standard error of the mean is below this fraction of a channel's noise.
const MEAN_ERROR_SHARE: f64 = 0.15;
/// Minimum number of readings per two pitches, and the time between two [s].
const MIN_BINS: usize = 64;
const BIN_S: f64 = 5e-6;
/// Maximum number of readings of a long period, to limit memory over hundreds of runs; two pitches keep their minimum.
const MAX_BINS: usize = 1 << 16;

/// Result of a run: one period of every sensor.
#[derive(Clone, Debug)]
pub struct PeriodicResponse {
    pub pitches: f64,
    pub pitches_per_s: f64,
    /// One series of bins over a period for every sensor, SI; angles minus their mean rotation.
    pub means: Vec<Vec<f64>>,
    /// Root mean square of the non-repeating part.
    pub unrepeated: Vec<f64>,
}

/// Runs of one drive; results are cached.
#[derive(Debug)]
pub struct Plant {
    name: String,
    text: String,
    machine: Machine,
    /// For every sensor: noise of its channel in SI units of the reading; 0: no channel reads it.
    noise: Vec<f64>,
    known: Mutex<HashMap<String, Arc<Result<PeriodicResponse, String>>>>,
}

impl Plant {
    pub fn new(drive: &Drive, machine: &Machine, data: &Data) -> Plant {
        let mut noise = vec![0.0; machine.sensors.len()];
        for c in &data.channels {
            let gain = machine.values[machine.sensors[c.sensor].gain].abs();
            noise[c.sensor] = c.noise / gain.max(1e-300);
        }
        Plant {
            name: drive.name.clone(),
            text: drive.text.clone(),
            machine: machine.clone(),
            noise,
            known: Mutex::new(HashMap::new()),
        }
    }

    /// Overrides that turn the file's drive into this machine with these values.
    pub fn overrides(&self, m: &Machine, values: &[f64]) -> Vec<String> {
        let mut all = Vec::new();
        let own = m.slots.iter().zip(values).zip(&self.machine.slots).zip(&self.machine.values);
        for (((slot, value), _), file) in own {
            if value != file && !slot.path.starts_with("sensors.") && !self.is_signal(&slot.path) {
                all.push(format!("{}={}", slot.path, toml_literal(value / slot.unit)));
            }
        }
        for p in m.placed.iter().filter(|p| !matches!(p.effect.physics, Physics::Signal(_) | Physics::Clock(_))) {
            for ((key, row), slot) in m.keys(p.effect, p.target).iter().zip(&p.slots) {
                let value = values[*slot] / row.unit;
                let value = if row.kind.is_whole() { libm::round(value) } else { value };
                all.push(format!("{}.{key}={}", p.path, toml_literal(value)));
            }
        }
        all
    }

    fn is_signal(&self, path: &str) -> bool {
        self.machine.placed.iter().any(|p| path.starts_with(&p.path))
    }

    /// Sensor readings of the drive with these values.
    pub fn response(&self, m: &Machine, values: &[f64], runs: &AtomicU64) -> Arc<Result<PeriodicResponse, String>> {
        let overrides = self.overrides(m, values);
        let key = overrides.join("\n");
        if let Ok(known) = self.known.lock()
            && let Some(response) = known.get(&key)
        {
            return response.clone();
        }
        runs.fetch_add(1, Ordering::Relaxed);
        let response = Arc::new(self.run(m, &overrides));
        if let Ok(mut known) = self.known.lock() {
            known.insert(key, response.clone());
        }
        response
    }

    fn run(&self, m: &Machine, overrides: &[String]) -> Result<PeriodicResponse, String> {
        let drive = Drive::parse(&self.name, &self.text, overrides).map_err(|e| e.to_string())?;
        if drive.train.motion.speeds.len() > 1 {
            return Err("the speed changes with time: measured records are compared at constant speeds".into());
        }
        let half_orders = |h: &Harmonic| libm::round(2.0 * h.order) == 2.0 * h.order;
        let orders = drive.train.order_loads.iter().flat_map(|l| &l.harmonics).chain(&drive.train.motion.harmonics);
        if !orders.clone().all(half_orders) {
            return Err("orders that are no halves have no period: measured records are compared over periods".into());
        }
        let pitches = f64::from(m.repeats());
        let pitches_per_s = drive.chain_speed_m_s().abs() / drive.chain.pitch_m();
        let period_s = pitches / pitches_per_s;
        let pairs = (m.repeats() / 2).max(1);
        let pair_s = period_s / f64::from(pairs);
        let bin_s = BIN_S.max(period_s / MAX_BINS as f64).min(pair_s / MIN_BINS as f64);
        let mut tracer = Tracer::new(&drive, bin_s)?;
        tracer.run_for(SETTLE_S)?;
        tracer.clear_readings();
        let turning: Vec<Option<f64>> = drive
            .sensors
            .iter()
            .map(|s| if let SensorReads::Angle(k) = s.reads { Some(tracer.nominal_speed(k)) } else { None })
            .collect();
        // The number of bins is an integer for every two pitches, because waves are also folded on these.
        let bins = pairs as usize * libm::ceil(pair_s / bin_s) as usize;
        let mut fold = PeriodFold::new(drive.sensors.len(), bins);
        let mut wanted = (libm::ceil(SHORTEST_S / period_s) as usize).max(2);
        loop {
            // Two readings beyond the end, for the cubic interpolation.
            tracer.run_until(wanted as f64 * period_s + 3.0 * tracer.step_s())?;
            fold.add_periods(&tracer, &turning, period_s, wanted);
            let sure = (0..drive.sensors.len()).all(|s| {
                let noise = self.noise.get(s).copied().unwrap_or(0.0);
                noise <= 0.0 || fold.unrepeated(s) / libm::sqrt(wanted as f64) < MEAN_ERROR_SHARE * noise
            });
            if sure || 2.0 * wanted as f64 * period_s > LONGEST_S {
                break;
            }
            wanted *= 2;
        }
        Ok(PeriodicResponse {
            pitches,
            pitches_per_s,
            unrepeated: (0..drive.sensors.len()).map(|s| fold.unrepeated(s)).collect(),
            means: fold.means(),
        })
    }

    /// Channel readings at the samples of a task: the weighted mean of runs with the values of `corners`.
    pub fn samples(
        &self,
        (m, values): (&Machine, &[f64]),
        (corners, folded): (&[(f64, Vec<f64>)], bool),
        (task, start): (&Task, &InitialState),
        channels: &[usize],
        runs: &AtomicU64,
    ) -> Result<Vec<Vec<f64>>, RunError> {
        let (travel, angles) = (start.travel, &start.q);
        let mut response: Option<PeriodicResponse> = None;
        for (weight, values) in corners {
            let run = self.response(m, values, runs);
            let Ok(run) = run.as_ref() else { return Err(RunError::Diverged { t_s: 0.0 }) };
            match &mut response {
                None if *weight == 1.0 => response = Some(run.clone()),
                None => response = Some(run.scaled_by(*weight)),
                Some(response) => response.add(run, *weight),
            }
        }
        let Some(response) = response else { return Err(RunError::Diverged { t_s: 0.0 }) };
        let response = &if folded { response.folded() } else { response };
        let Samples::Times { t_s, step_s, .. } = &task.samples else {
            return Err(RunError::NoPulse { t_s: 0.0, pulses: 0 });
        };
        let clock = clock(m, values);
        Ok(channels
            .iter()
            .map(|c| self.channel((m, values), response, (t_s, *step_s), travel, angles, *c, clock))
            .collect())
    }

    fn channel(
        &self,
        (m, values): (&Machine, &[f64]),
        response: &PeriodicResponse,
        (t_s, step_s): (&[f64], f64),
        travel: f64,
        angles: &[f64],
        sensor: usize,
        clock: f64,
    ) -> Vec<f64> {
        let gain = values[m.sensors[sensor].gain];
        let body = m.body_of(sensor);
        let speed = body.map_or(0.0, |b| nominal_speed(m, values, b));
        let turns = matches!(m.sensors[sensor].reads, Reads::Angle(_));
        let at = |t: f64| {
            let mean = response.at(sensor, travel + t * response.pitches_per_s);
            if turns { mean + angles[body.unwrap_or(0)] + speed * t } else { mean }
        };
        let altered = m.placed.iter().any(|p| p.target == crate::machine::Target::Sensor(sensor));
        if !altered {
            return t_s.iter().map(|t| gain * at(t / (1.0 + clock))).collect();
        }
        // Signal effects need evenly spaced nodes, finer than the samples.
        let h = 0.25 * step_s;
        let last = t_s.last().copied().unwrap_or(0.0) / (1.0 + clock);
        let nodes = libm::ceil(last / h) as usize + 3;
        let series = (0..nodes).map(|i| gain * at(i as f64 * h)).collect();
        let turned: Vec<f64> = (0..nodes).map(|i| speed * i as f64 * h).collect();
        let series = through_sensor(m, values, sensor, series, &turned, h);
        t_s.iter().map(|t| between(&series, t / (1.0 + clock) / h)).collect()
    }
}

/// Mean speed of a sprocket: chain speed divided by its teeth [rad/s].
pub(super) fn nominal_speed(m: &Machine, values: &[f64], body: usize) -> f64 {
    let driver = m.bodies.iter().find_map(|b| match b.motion {
        BodyMotion::Constant(slot) => Some((values[slot], b.teeth.unwrap_or(1))),
        BodyMotion::Free | BodyMotion::Measured(_) => None,
    });
    let Some((speed, teeth)) = driver else { return 0.0 };
    let turns_as = m.linked.as_ref().map_or(Some(body), |linked| linked.turns_as[body]);
    turns_as.map_or(0.0, |like| speed * f64::from(teeth) / f64::from(m.bodies[like].teeth.unwrap_or(1)))
}

impl PeriodicResponse {
    /// The mean over all pairs of links: the response of a drive whose links and teeth are all alike.
    fn folded(&self) -> PeriodicResponse {
        let pairs = (self.pitches / 2.0) as usize;
        let fold = |means: &Vec<f64>| -> Vec<f64> {
            let n = means.len() / pairs.max(1);
            (0..n).map(|b| (0..pairs).map(|p| means[p * n + b]).sum::<f64>() / pairs as f64).collect()
        };
        if pairs < 2 || self.means.iter().any(|w| w.len() % pairs != 0) {
            return self.clone();
        }
        PeriodicResponse { pitches: 2.0, means: self.means.iter().map(fold).collect(), ..self.clone() }
    }

    fn scaled_by(&self, weight: f64) -> PeriodicResponse {
        let mut all = self.clone();
        all.means.iter_mut().flatten().for_each(|x| *x *= weight);
        all
    }

    fn add(&mut self, other: &PeriodicResponse, weight: f64) {
        for (own, other) in self.means.iter_mut().zip(&other.means) {
            own.iter_mut().zip(other).for_each(|(x, y)| *x += weight * y);
        }
    }

    /// Mean of a sensor at a position in the period [pitches]: cubic through four bins.
    pub fn at(&self, sensor: usize, pitches: f64) -> f64 {
        let means = &self.means[sensor];
        let n = means.len();
        let x = pitches / self.pitches;
        let at = (x - libm::floor(x)) * n as f64;
        let low = libm::floor(at);
        let (x, low) = (at - low, low as usize);
        let value = |k: usize| means[(low + n + k - 1) % n];
        let (a, b, c, d) = (value(0), value(1), value(2), value(3));
        cubic([a, b, c, d], x)
    }
}

/// Sums over periods.
struct PeriodFold {
    periods: usize,
    sums: Vec<Vec<f64>>,
    squares: Vec<Vec<f64>>,
}

impl PeriodFold {
    fn new(sensors: usize, bins: usize) -> PeriodFold {
        PeriodFold { periods: 0, sums: vec![vec![0.0; bins]; sensors], squares: vec![vec![0.0; bins]; sensors] }
    }

    /// Adds the new periods up to `until`.
    fn add_periods(&mut self, tracer: &Tracer, turning: &[Option<f64>], period_s: f64, until: usize) {
        for period in self.periods..until {
            for (s, (sums, squares)) in self.sums.iter_mut().zip(&mut self.squares).enumerate() {
                let bins = sums.len();
                let series = tracer.readings(s);
                for (b, (sum, square)) in sums.iter_mut().zip(squares.iter_mut()).enumerate() {
                    let t_s = (period as f64 + b as f64 / bins as f64) * period_s;
                    let turned = turning[s].map_or(0.0, |w| w * t_s);
                    let value = between(series, t_s / tracer.step_s()) - turned;
                    *sum += value;
                    *square += value * value;
                }
            }
        }
        self.periods = until;
    }

    /// Root mean square over bins of the deviation from period to period.
    fn unrepeated(&self, sensor: usize) -> f64 {
        let n = self.periods as f64;
        let pairs = self.sums[sensor].iter().zip(&self.squares[sensor]);
        let total: f64 = pairs.map(|(s, q)| ((q - s * s / n) / (n - 1.0).max(1.0)).max(0.0)).sum();
        libm::sqrt(total / self.sums[sensor].len() as f64)
    }

    fn means(&self) -> Vec<Vec<f64>> {
        let n = self.periods as f64;
        self.sums.iter().map(|s| s.iter().map(|x| x / n).collect()).collect()
    }
}

/// Formats a number so that TOML reads back the same bits.
fn toml_literal(x: f64) -> String {
    if x == libm::trunc(x) && x.abs() < 1e9 { format!("{}", x as i64) } else { format!("{x:?}") }
}

/// Whether an effect is at a place on the loop, which a record's travel determines.
pub fn has_place(effect: &Effect) -> bool {
    effect.links == Some(On::Chain) || effect.differs_round_turn()
}
