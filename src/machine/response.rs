//! Sensor readings of a drive with link bodies in steady, periodic operation: one period of each.
//!
//! A drive at constant speed repeats itself after a whole number of pitches: two, if only inner and outer links differ;
//! one loop of the chain with one odd link; one revolution of a sprocket with one odd tooth. Sensor readings are folded
//! on that period. The mean over periods is the model output; the variation from period to period cannot be predicted,
//! because the spans of a fast chain move chaotically: two runs whose preload differs by 1e-5 N have only this mean in
//! common after 0.2 s at 3000 rpm. The position in the period at which a record starts is one parameter, its travel in
//! pitches.

use super::fidelity::RecordsOfSensors;
use super::period::PeriodOfDrive;
use super::simulate::{between, cubic};
use crate::assemble::AssemblyError;
use crate::diag::Report;
use crate::drive::Drive;
use crate::drive::sensors::SensorReads;
use crate::elements::driver_motion::Harmonic;
use crate::integrate::StepError;
use crate::sensing::Tracer;

/// Settling time after the drive's own run-in [s], for transients of its start.
const SETTLE_S: f64 = 0.06;
/// Arms and tensioners with dampers, or with oil that leaks, creep to their places. Settling goes on over stretches of whole periods, of this time [s]
/// or more, each cut into so many parts, whose means are held against those of the stretch before. It ends when the mean of these differences is
/// within this multiple of its standard error, or when what an exponential would still creep is below this share of the noise, so many times in a
/// row: once left the plunger of `bmw318` 1.3 noises from its place. It ends after the longest time [s] in
/// any case: what then still creeps is part of what does not repeat. Not varied.
const CREEP_STRETCH_S: f64 = 0.1;
const CREEP_PARTS: usize = 4;
const SURE_OF_CREEP: f64 = 2.0;
const CREEP_SHARE: f64 = 0.1;
const STILL_STRETCHES: usize = 2;
const LONGEST_CREEP_S: f64 = 2.0;
/// Largest ratio of two successive differences that is taken for that of an exponential.
const SLOWEST_CREEP: f64 = 0.95;
/// Shortest and longest duration that is folded [s]. So many times the records at one operating point are enough: the mean of what does not repeat is
/// then known better than in them. Not varied.
const SHORTEST_S: f64 = 0.3;
const LONGEST_S: f64 = 1.6;
const FOLDED_RECORDS: f64 = 2.0;
/// Folding continues until the standard error of the mean is below this fraction of a channel's noise.
const MEAN_ERROR_SHARE: f64 = 0.15;
/// Minimum number of readings per two pitches, and the time between two [s].
const MIN_BINS: usize = 64;
const BIN_S: f64 = 5e-6;
/// Maximum number of readings of a long period, to limit memory over hundreds of runs; two pitches keep their minimum.
const MAX_BINS: usize = 1 << 16;

/// Result of a run: one period of every sensor.
#[derive(Clone, Debug)]
pub(super) struct PeriodicResponse {
    pub(super) pitches: f64,
    /// Period of the same drive if all its links and teeth are alike.
    pub(super) alike: f64,
    pub(super) pitches_per_s: f64,
    /// One series of bins over a period for every sensor, SI; angles minus their mean rotation.
    pub(super) means: Vec<Vec<f64>>,
    /// Root mean square of the non-repeating part.
    pub(super) unrepeated: Vec<f64>,
    /// Periods in the means.
    pub(super) periods: usize,
}

/// Why there is no period of a drive's sensors.
#[derive(Debug)]
pub(super) enum ResponseError {
    /// The drive cannot have these numbers.
    Drive(Report),
    WithoutPeriod(WithoutPeriod),
    Assembly(AssemblyError),
    /// The run broke down.
    Step(StepError),
}

impl std::fmt::Display for ResponseError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ResponseError::Drive(e) => write!(f, "{e}"),
            ResponseError::WithoutPeriod(WithoutPeriod { title, help, .. }) => write!(f, "{title}; {help}"),
            ResponseError::Assembly(e) => write!(f, "{e}"),
            ResponseError::Step(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for ResponseError {}

/// Why a drive has no period, so that records cannot be compared with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct WithoutPeriod {
    pub(super) path: String,
    pub(super) title: String,
    pub(super) help: String,
}

/// Why this drive has no period; None: it has one.
pub(super) fn without_period(drive: &Drive) -> Option<WithoutPeriod> {
    let motion = &drive.train.motion;
    let driver = &drive.sprockets[drive.driver()];
    let turned = driver.shaft.map_or(&driver.name, |k| &drive.shafts[k].name);
    if motion.speeds.len() > 1 {
        return Some(WithoutPeriod {
            path: format!("speeds.table.{turned}"),
            title: format!("the speed of `{turned}` changes with time"),
            help: format!(
                "records are compared over periods of a steady motion: give the drive `[speeds.constant.{turned}]`, cut the records where the speed is constant, and let each set its own `speeds.constant.{turned}.speed_rpm`"
            ),
        });
    }
    let loads = drive.train.order_loads.iter().map(|l| (&l.path, &l.harmonics));
    let speeds = ["constant", "table"].map(|kind| format!("speeds.{kind}.{turned}"));
    let own = speeds.iter().find(|path| drive.places.span(path).is_some()).unwrap_or(&speeds[0]);
    let odd = |(path, all): (&String, &Vec<Harmonic>)| {
        let apart = all.iter().find(|h| turns_of_orders(std::iter::once(*h)).is_none())?;
        Some((path.clone(), apart.order))
    };
    let first = loads.clone().chain([(own, &motion.harmonics)]).find_map(odd);
    let all = loads.clone().flat_map(|(_, all)| all).chain(&motion.harmonics);
    let (path, title) = match (first, turns_of_orders(all)) {
        (Some((path, order)), _) => (path, format!("order {order} does not come back within {MAX_TURNS} turns")),
        (None, None) => (own.clone(), format!("the orders together do not come back within {MAX_TURNS} turns")),
        (None, Some(_)) => return with_long_period(drive),
    };
    let help = "records are compared over periods: give orders that are wholes, halves, thirds and so on".to_string();
    Some(WithoutPeriod { path: format!("{path}.orders"), title, help })
}

/// Why the period of this drive is too long to be run, of some ten seconds or more; None: it is not.
fn with_long_period(drive: &Drive) -> Option<WithoutPeriod> {
    let pitches = PeriodOfDrive::of(drive).declared;
    let period_s = f64::from(pitches) * drive.chain.pitch_m() / drive.chain_speed_m_s().abs().max(1e-9);
    let rpm = drive.nominal_speed_rad_s(drive.driver()).abs() * 30.0 / std::f64::consts::PI;
    if rpm == 0.0 {
        let driver = &drive.sprockets[drive.driver()];
        let turned = driver.shaft.map_or(&driver.name, |k| &drive.shafts[k].name);
        return Some(WithoutPeriod {
            path: format!("speeds.constant.{turned}.speed_rpm"),
            title: format!("`{turned}` stands still"),
            help: "records are compared over periods of a steady motion: give it the speed of the records".to_string(),
        });
    }
    let title = format!(
        "this drive comes back to where it was only after {pitches} pitches of its first chain, {period_s:.1} s at {rpm} 1/min"
    );
    let help = "records are compared over periods: leave single links and teeth as their neighbours, take orders and teeth with a common divisor, or run faster: records set speeds of their own, and the file should have one like theirs".to_string();
    (period_s > MAX_PERIOD_S).then_some(WithoutPeriod { path: "sprockets".to_string(), title, help })
}

/// Means of a sensor over the parts of a stretch.
type PartMeans = [f64; CREEP_PARTS];

/// Mean difference of a stretch from that before, and its standard error. What repeats itself cancels part by part.
fn crept(before: &PartMeans, now: &PartMeans) -> (f64, f64) {
    let n = CREEP_PARTS as f64;
    let differences: Vec<f64> = now.iter().zip(before).map(|(now, before)| now - before).collect();
    let mean = differences.iter().sum::<f64>() / n;
    let squares: f64 = differences.iter().map(|d| (d - mean) * (d - mean)).sum();
    (mean, libm::sqrt(squares / (n * (n - 1.0))))
}

/// Where folding begins.
struct FoldStart {
    /// From the next reading on [s].
    start_s: f64,
    /// Up to the next reading, since settling on creep began [s].
    elapsed_s: f64,
}

/// Runs on until sensors no longer creep: those that records read; where their noise is not known, all; angles, which turn on, say nothing. Where
/// none is left, or the stretches take too long, it runs for the longest time. Folding begins at the end of a whole number of periods, one or two
/// readings after the next one, so that runs which settle in other times are in phase.
fn creep_to_rest(tracer: &mut Tracer, drive: &Drive, period_s: f64, noise: &[f64]) -> Result<FoldStart, StepError> {
    let step_s = tracer.step_s();
    let per_stretch = libm::ceil(CREEP_STRETCH_S / period_s).max(1.0) as usize;
    let longest = libm::ceil(LONGEST_CREEP_S / period_s) as usize;
    let noise_of = |s: usize| noise.get(s).copied().unwrap_or(0.0);
    let steady: Vec<usize> =
        (0..drive.sensors.len()).filter(|s| !matches!(drive.sensors[*s].reads, SensorReads::Angle(_))).collect();
    let read: Vec<usize> = steady.iter().copied().filter(|s| noise_of(*s) > 0.0).collect();
    let watched = if read.is_empty() { steady } else { read };
    // Readings since the start, but for one, so that one stands before the place where folding begins.
    let until = |periods: f64| (libm::floor(periods * period_s / step_s) as usize).saturating_sub(1);
    let fold_start = |done: usize| {
        let elapsed_s = until(done as f64) as f64 * step_s;
        FoldStart { start_s: done as f64 * period_s - elapsed_s, elapsed_s }
    };
    let mut before: Option<Vec<PartMeans>> = None;
    let mut last: Vec<Option<f64>> = vec![None; watched.len()];
    let (mut done, mut still) = (0, 0);
    let mut can_compare = !watched.is_empty() && (STILL_STRETCHES + 1) * per_stretch <= longest;
    while can_compare {
        let start = until(done as f64);
        let end_of =
            |part: usize| until((done as f64) + per_stretch as f64 * (part as f64 / CREEP_PARTS as f64)) - start;
        tracer.clear_readings();
        tracer.read_on(end_of(CREEP_PARTS))?;
        let means = |s: &usize| -> PartMeans {
            std::array::from_fn(|part| {
                let own = &tracer.readings(*s)[end_of(part)..end_of(part + 1)];
                own.iter().sum::<f64>() / own.len().max(1) as f64
            })
        };
        let now: Vec<PartMeans> = watched.iter().map(means).collect();
        done += per_stretch;
        if let Some(before) = &before {
            let mut is_still = true;
            for (i, s) in watched.iter().enumerate() {
                let (way, error) = crept(&before[i], &now[i]);
                let ratio = last[i].map_or(SLOWEST_CREEP, |last| (way / last).abs().min(SLOWEST_CREEP));
                let to_come = way.abs() * (ratio / (1.0 - ratio)).max(1.0);
                is_still &= !(way.abs() > SURE_OF_CREEP * error && to_come > CREEP_SHARE * noise_of(*s));
                last[i] = Some(way).filter(|way| *way != 0.0);
            }
            still = if is_still { still + 1 } else { 0 };
            if still == STILL_STRETCHES {
                return Ok(fold_start(done));
            }
        }
        before = Some(now);
        can_compare = done + per_stretch <= longest;
    }
    tracer.clear_readings();
    tracer.read_on(until(longest.max(done) as f64) - until(done as f64))?;
    Ok(fold_start(longest.max(done)))
}

/// Longest period that is run [s].
pub(super) const MAX_PERIOD_S: f64 = 10.0;

/// Maximum number of turns of the driver after which orders come back.
const MAX_TURNS: u32 = 12;
/// Deviation of an order from a fraction of whole numbers, relative to one order.
const ORDER_TOLERANCE: f64 = 1e-9;

/// Turns of the driver after which all these orders come back, at least two; None: more than can be folded.
pub(super) fn turns_of_orders<'a>(orders: impl Iterator<Item = &'a Harmonic> + Clone) -> Option<u32> {
    let is_whole = |x: f64| (x - libm::round(x)).abs() <= ORDER_TOLERANCE * x.abs().max(1.0);
    (2..=MAX_TURNS).find(|turns| orders.clone().all(|h| is_whole(f64::from(*turns) * h.order)))
}

impl PeriodicResponse {
    /// Runs a drive that repeats itself after `repeats` pitches, after `alike` ones if all its links and teeth are alike, for these records.
    pub(super) fn of(
        drive: &Drive,
        alike: u32,
        repeats: u32,
        records: &RecordsOfSensors,
    ) -> Result<PeriodicResponse, ResponseError> {
        if let Some(why) = without_period(drive) {
            return Err(ResponseError::WithoutPeriod(why));
        }
        let noise = &records.noise;
        let longest_s = match records.at_one_point_s > 0.0 {
            true => (FOLDED_RECORDS * records.at_one_point_s).clamp(SHORTEST_S, LONGEST_S),
            false => LONGEST_S,
        };
        let pitches = f64::from(repeats);
        let pitches_per_s = drive.chain_speed_m_s().abs() / drive.chain.pitch_m();
        let period_s = pitches / pitches_per_s;
        let parts = (repeats / alike).max(1);
        let part_s = period_s / f64::from(parts);
        let pair_s = 2.0 / pitches_per_s;
        let bin_s = BIN_S.max(period_s / MAX_BINS as f64).min(pair_s / MIN_BINS as f64);
        let mut tracer = Tracer::new(drive, bin_s).map_err(ResponseError::Assembly)?;
        // Periods begin where the driver's mean angle has its place, so that the phase of a wave on its speed does not move the whole drive: the
        // teeth would hold the phase where it is.
        let ahead_s = tracer.driver_lead_s(period_s);
        tracer.run_for(SETTLE_S).map_err(ResponseError::Step)?;
        let from = match drive.sliders.is_empty() && drive.arms.is_empty() {
            true => FoldStart { start_s: 0.0, elapsed_s: 0.0 },
            false => creep_to_rest(&mut tracer, drive, period_s, noise).map_err(ResponseError::Step)?,
        };
        tracer.clear_readings();
        let turning: Vec<Option<f64>> = drive
            .sensors
            .iter()
            .map(|s| match s.reads {
                SensorReads::Angle(k) => Some(tracer.nominal_speed(k)),
                SensorReads::Speed(_)
                | SensorReads::Acceleration(_)
                | SensorReads::Torque(_)
                | SensorReads::Span(_)
                | SensorReads::Link(_)
                | SensorReads::Guide(_)
                | SensorReads::Slider(_)
                | SensorReads::Valve(_)
                | SensorReads::Twist(_)
                | SensorReads::Tip(_)
                | SensorReads::Pressure(_)
                | SensorReads::Flow(_) => None,
            })
            .collect();
        // The number of bins is an integer for every part, because waves are also folded on these.
        let bins = parts as usize * libm::ceil(part_s / bin_s) as usize;
        let mut fold = PeriodFold::new(drive.sensors.len(), bins);
        let mut wanted = (libm::ceil(SHORTEST_S / period_s) as usize).max(2);
        loop {
            // Two readings beyond the end, for the cubic interpolation.
            let covered_s = from.start_s + wanted as f64 * period_s + 3.0 * tracer.step_s();
            tracer.run_until(covered_s).map_err(ResponseError::Step)?;
            fold.add_periods(&tracer, &turning, (&from, period_s), wanted);
            let sure = (0..drive.sensors.len()).all(|s| {
                let noise = noise.get(s).copied().unwrap_or(0.0);
                noise <= 0.0 || fold.unrepeated(s) / libm::sqrt(wanted as f64) < MEAN_ERROR_SHARE * noise
            });
            if sure || 2.0 * wanted as f64 * period_s > longest_s {
                break;
            }
            wanted *= 2;
        }
        Ok(PeriodicResponse {
            pitches,
            alike: f64::from(alike),
            pitches_per_s,
            unrepeated: (0..drive.sensors.len()).map(|s| fold.unrepeated(s)).collect(),
            means: fold.means(),
            periods: fold.periods,
        }
        .begun_earlier(ahead_s, &turning))
    }

    /// The same with periods that begin this much earlier; `turning`: nominal speeds of the sensors that read angles.
    fn begun_earlier(self, by_s: f64, turning: &[Option<f64>]) -> PeriodicResponse {
        if by_s == 0.0 {
            return self;
        }
        let earlier = |(s, speed): (usize, &Option<f64>)| -> Vec<f64> {
            let n = self.means[s].len();
            let place = |b: usize| b as f64 / n as f64 * self.pitches - by_s * self.pitches_per_s;
            let turned = speed.map_or(0.0, |w| -w * by_s);
            (0..n).map(|b| self.at(s, place(b)) + turned).collect()
        };
        PeriodicResponse { means: turning.iter().enumerate().map(earlier).collect(), ..self }
    }

    /// The mean over all parts of the period that are alike but for single links and teeth: the response of a drive whose links and teeth are all alike.
    pub(super) fn folded(&self) -> PeriodicResponse {
        let parts = (self.pitches / self.alike) as usize;
        let fold = |means: &Vec<f64>| -> Vec<f64> {
            let n = means.len() / parts.max(1);
            (0..n).map(|b| (0..parts).map(|p| means[p * n + b]).sum::<f64>() / parts as f64).collect()
        };
        if parts < 2 || self.means.iter().any(|w| w.len() % parts != 0) {
            return self.clone();
        }
        PeriodicResponse { pitches: self.alike, means: self.means.iter().map(fold).collect(), ..self.clone() }
    }

    pub(super) fn scaled_by(&self, weight: f64) -> PeriodicResponse {
        let mut all = self.clone();
        all.means.iter_mut().flatten().for_each(|x| *x *= weight);
        all
    }

    pub(super) fn add(&mut self, other: &PeriodicResponse, weight: f64) {
        for (own, other) in self.means.iter_mut().zip(&other.means) {
            own.iter_mut().zip(other).for_each(|(x, y)| *x += weight * y);
        }
    }

    /// Mean of a sensor at a position in the period [pitches]: cubic through four bins.
    pub(super) fn at(&self, sensor: usize, pitches: f64) -> f64 {
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
    fn add_periods(
        &mut self,
        tracer: &Tracer,
        turning: &[Option<f64>],
        (from, period_s): (&FoldStart, f64),
        until: usize,
    ) {
        for period in self.periods..until {
            for (s, (sums, squares)) in self.sums.iter_mut().zip(&mut self.squares).enumerate() {
                let bins = sums.len();
                let series = tracer.readings(s);
                for (b, (sum, square)) in sums.iter_mut().zip(squares.iter_mut()).enumerate() {
                    let t_s = from.start_s + (period as f64 + b as f64 / bins as f64) * period_s;
                    let turned = turning[s].map_or(0.0, |w| w * (from.elapsed_s + t_s));
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

#[cfg(test)]
mod tests {
    use super::{PeriodicResponse, RecordsOfSensors, SensorReads, Tracer, creep_to_rest};
    use crate::drive::{BUNDLED, Drive};

    #[test]
    fn folding_begins_a_whole_number_of_periods_after_the_start_however_long_it_settles() {
        let (name, text) = BUNDLED.iter().find(|(name, _)| *name == "tensioner-20-40").unwrap_or(&BUNDLED[0]);
        // A speed that swings makes the plunger pump; through a gap of 12 um it creeps.
        let swings = "orders = [2]\namplitudes_deg = [1.5]\nphases_deg = [0]\nspeed_rpm = 3000";
        let text = format!("{}\n[sensors.encoder.driver]\n", text.replace("speed_rpm = 3000", swings));
        let drive = Drive::parse(name, &text, &["effects.leak_gap.plunger.gap_um=-18".to_string()])
            .unwrap_or_else(|e| panic!("{e}"));
        let speed = drive.nominal_speed_rad_s(drive.driver());
        // One turn, which is no whole number of readings.
        let period_s = 20.0 * drive.chain.pitch_m() / drive.chain_speed_m_s().abs();
        let mut stretches = Vec::new();
        let encoder = drive.sensors.iter().position(|s| matches!(s.reads, SensorReads::Angle(_))).unwrap_or(0);
        for noise in [1e9, 1e-9].map(|noise| vec![noise; drive.sensors.len()]) {
            let mut tracer = Tracer::new(&drive, 7.3e-5).unwrap_or_else(|e| panic!("{e}"));
            tracer.run_for(0.01).unwrap_or_else(|e| panic!("{e}"));
            tracer.clear_readings();
            let angle = |tracer: &Tracer| tracer.readings(encoder).last().copied().unwrap_or(f64::NAN);
            // The first reading after the start is that from which periods count.
            let mut twin = Tracer::new(&drive, 7.3e-5).unwrap_or_else(|e| panic!("{e}"));
            twin.run_for(0.01).and_then(|()| twin.read_on(1)).unwrap_or_else(|e| panic!("{e}"));
            let from = creep_to_rest(&mut tracer, &drive, period_s, &noise).unwrap_or_else(|e| panic!("{e}"));
            tracer.read_on(1).unwrap_or_else(|e| panic!("{e}"));
            let periods = ((angle(&tracer) - angle(&twin)) / speed + from.start_s) / period_s;
            // The speed swings by 5 %, for two readings at most.
            assert!((periods - periods.round()).abs() < 0.1 * tracer.step_s() / period_s, "{periods} periods");
            assert!((1.0..2.0).contains(&(from.start_s / tracer.step_s())), "{}", from.start_s);
            assert!((from.elapsed_s + from.start_s - periods.round() * period_s).abs() < 1e-9);
            stretches.push(periods.round());
        }
        // An angle that is folded does not hang on it either.
        let encoder_alone = |noise: f64| {
            let noise = (0..drive.sensors.len()).map(|s| if s == encoder { 1e9 } else { noise }).collect();
            let records = RecordsOfSensors { noise, at_one_point_s: 0.1 };
            PeriodicResponse::of(&drive, 20, 20, &records).unwrap_or_else(|e| panic!("{e}"))
        };
        let [soon, late] = [1e9, 1e-9].map(|noise| encoder_alone(noise).at(encoder, 0.0));
        assert!((soon - late).abs() < 1e-6, "{soon} {late}");
        assert!(stretches[1] > stretches[0], "{stretches:?}");
    }
}
