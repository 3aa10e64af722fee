//! Spectrum of a number of a recording over the angle of the driver: amplitudes by orders, and which part of the drive turns with each.
//!
//! Samples are taken over equal angles of the driver, which its speed does not smear: where it turns unevenly, between frames by a cubic
//! through the four nearest. A Hann window w keeps what is no whole number of periods from leaking far; amplitudes are 2 |X| / sum w, so that
//! a sine shows its own. Zeros behind the samples make the spectrum dense, and a parabola through the logarithms of the three largest
//! values gives place and size of a peak: of a sine alone, right to 2e-4.
//!
//! A sprocket turns at its speed over that of the driver; a tooth passes at teeth times that; a link comes round the chain once a lap, links
//! times as rarely as teeth. An order is named by the multiples of these that lie within a third of the resolution, one order per turns recorded.
//! A peak that stands high over what is around it has a place that is known better than that, and is named by what lies as near as it is known:
//! so a drive that swings at a frequency of its own close to a multiple is not taken for it. Nor is one of the many peaks of a swing that irregular
//! impacts keep up.

use super::signal::Signal;
use crate::diag::last_name;
use crate::recording::frame::{Frame, Header};
use crate::recording::reader::{Entry, Flow, Reader, Wanted};
use crate::statistics::median;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Factor by which zeros lengthen the samples; of long recordings [`FEWER_ZEROS`].
const ZEROS: usize = 8;
const FEWER_ZEROS: usize = 2;
const LONG: usize = 1 << 19;
/// Periods that must be recorded for an order to be told from its neighbours: half the width of the window's main lobe, and a half.
pub const PERIODS: f64 = 2.5;
/// Fewest samples.
const FEWEST: usize = 32;
/// Angles that differ from even ones by less than this share of their distance are even.
const EVEN: f64 = 1e-3;
/// Side lobes of a Hann window: within so many resolutions of a peak they count, and reach this share of it. Harris 1978: -31.5 dB, 0.027; with the
/// scatter of two peaks that overlap, half as much again.
const LOBES: (f64, f64) = (4.5, 0.04);
/// Share of the resolution within which an order is named by what comes back.
const NAMING: f64 = 0.35;
/// Least such share: speeds of parts are means over the recording.
const NAMING_LEAST: f64 = 0.03;
/// Shift of a peak in resolutions for what reaches its place, as a share of it: the Hann window falls by 0.6 x^2 about its middle, and what reaches
/// there changes by at most its own size and a half over a resolution.
const PULL: f64 = 2.0;
/// What irregular impacts excite is no line: a swing of the drive then has peaks all over its resonance. A peak that stands less than this over its
/// surroundings, and has a peak without a name within so many resolutions, of this share of its size or more, is taken for one of them.
pub const LINE_PROMINENCE: f64 = 12.0;
const SWING_REACH: f64 = 6.0;
const SWING_SHARE: f64 = 0.5;
/// Largest multiple by which orders are named.
const MULTIPLES: f64 = 12.0;
/// Multiples up to here are small ones, which name an order before others do. assumed: sixth orders are the highest that are spoken of.
const FEW: f64 = 6.0;

/// What comes back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OrderKind {
    Tooth,
    HalfTooth,
    Sprocket,
    Lap,
}

/// Something that comes back: a turn of a sprocket, a tooth, a lap.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderBase {
    /// `driven`, `tooth`, `half tooth`, `lap`; of several chains with a name.
    pub name: String,
    /// Times per turn of the driver.
    pub order: f64,
    pub kind: OrderKind,
}

/// A number over the angle of the driver.
#[derive(Clone, Debug, Default)]
pub struct AngleRecord {
    /// Turns of the driver, and values there.
    pub turns: Vec<f64>,
    pub values: Vec<f64>,
    /// Times of the values [s].
    pub times_s: Vec<f64>,
    pub bases: Vec<OrderBase>,
    pub driver: String,
    /// Mean speed of the driver [1/s].
    pub turns_per_s: f64,
    /// Between two frames, mean [s].
    pub interval_s: f64,
}

/// How the oscillation of a number in one recording differs from that in another, as simulated and measured ones are compared: over the turns that
/// both have, at the same angles of the driver, each about its mean there.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct OscillationDifference {
    /// Turns that both have.
    pub turns: f64,
    /// Root mean square of the oscillation, own and other.
    pub rms: f64,
    pub rms_other: f64,
    /// Root mean square of the difference, over that of the other's oscillation.
    pub rms_of_difference_share: f64,
}

impl OscillationDifference {
    /// None: they have no turn in common, or the other one does not oscillate.
    pub fn between(own: &AngleRecord, other: &AngleRecord) -> Option<OscillationDifference> {
        // A driver may turn backwards.
        let sign = if own.turns.last()? < own.turns.first()? { -1.0 } else { 1.0 };
        let forwards = |record: &AngleRecord| record.turns.iter().map(|x| sign * x).collect::<Vec<f64>>();
        let (turns, theirs) = (forwards(own), forwards(other));
        let first = turns.first()?.max(*theirs.first()?);
        let last = turns.last()?.min(*theirs.last()?);
        // Angles rise, so that the place in the other record moves on.
        let mut k = 0;
        let mut both: Vec<[f64; 2]> = Vec::new();
        for (turn, value) in turns.iter().zip(&own.values).filter(|(turn, _)| (first..=last).contains(*turn)) {
            while k + 2 < theirs.len() && theirs[k + 1] < *turn {
                k += 1;
            }
            let (from, to) = (*theirs.get(k)?, *theirs.get(k + 1)?);
            let share = if to > from { (turn - from) / (to - from) } else { 0.0 };
            both.push([*value, other.values[k] + share * (other.values[k + 1] - other.values[k])]);
        }
        let n = both.len() as f64;
        let mean = |i: usize| both.iter().map(|b| b[i]).sum::<f64>() / n;
        let means = [mean(0), mean(1)];
        let rms_of = |of: &dyn Fn(&[f64; 2]) -> f64| libm::sqrt(both.iter().map(|b| of(b) * of(b)).sum::<f64>() / n);
        let rms = rms_of(&|b| b[0] - means[0]);
        let rms_other = rms_of(&|b| b[1] - means[1]);
        let difference = rms_of(&|b| (b[0] - means[0]) - (b[1] - means[1]));
        let rms_of_difference_share = difference / rms_other;
        let found = OscillationDifference { turns: last - first, rms, rms_other, rms_of_difference_share };
        (last > first && rms_of_difference_share.is_finite()).then_some(found)
    }
}

/// A peak.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SpectrumPeak {
    pub order: f64,
    pub frequency_hz: f64,
    pub amplitude: f64,
    /// Over the median around it.
    pub prominence: f64,
    pub names: Vec<String>,
}

/// Amplitudes by orders.
#[derive(Clone, Debug, Default)]
pub struct AngleSpectrum {
    pub mean: f64,
    /// Turns of the driver that were recorded; one over them is the resolution.
    pub turns: f64,
    /// Distance of two values [orders].
    pub step: f64,
    pub amplitudes: Vec<f64>,
    pub peaks: Vec<SpectrumPeak>,
    pub turns_per_s: f64,
}

/// Why there is no spectrum.
#[derive(Clone, Debug, PartialEq)]
pub enum SpectrumError {
    /// Values, and how many are needed.
    Few(usize, usize),
    /// The driver stands still.
    Still,
    /// Turns recorded, needed, and time that takes [s].
    Short { turns: f64, needed: f64, needed_s: f64 },
}

/// Reads a signal of a recording, between two times with their ends.
pub fn read(reader: &mut Reader, signal: &Signal, (from_s, to_s): (f64, f64)) -> anyhow::Result<AngleRecord> {
    let header = reader.header().clone();
    let mut recorder = AngleRecorder::new(signal.clone(), &header);
    reader.each(Wanted { frames: true, ..Wanted::default() }, (from_s, to_s), |entry| {
        if let Entry::Frame(frame) = entry
            && (from_s..=to_s).contains(&frame.t_s)
        {
            recorder.add(frame, &header);
        }
        Ok(Flow::On)
    })?;
    Ok(recorder.finish(&header))
}

/// Collects a signal over the angle of the driver, frame by frame.
pub struct AngleRecorder {
    signal: Signal,
    record: AngleRecord,
    frame_times_s: Vec<f64>,
    /// Angles of what turns in the first, the last, and the last but one frame.
    first: Vec<f64>,
    last: Vec<f64>,
    before_last: Vec<f64>,
    /// Chain that touches a body.
    bodies_of: BTreeMap<usize, usize>,
    chain_of: Vec<(usize, usize)>,
}

impl AngleRecorder {
    pub fn new(signal: Signal, header: &Header) -> AngleRecorder {
        AngleRecorder {
            signal,
            record: AngleRecord::default(),
            frame_times_s: Vec::new(),
            first: Vec::new(),
            last: Vec::new(),
            before_last: Vec::new(),
            bodies_of: BTreeMap::new(),
            chain_of: chains(header),
        }
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &Frame, header: &Header) {
        if self.first.is_empty() {
            self.first = frame.rotors.angle_rad.clone();
        }
        std::mem::swap(&mut self.last, &mut self.before_last);
        self.last.clone_from(&frame.rotors.angle_rad);
        self.frame_times_s.push(frame.t_s);
        for (link, body) in frame.contacts.link.iter().zip(&frame.contacts.body) {
            let chain = self.chain_of.get(*link as usize).map_or(0, |c| c.0);
            self.bodies_of.entry(*body as usize).or_insert(chain);
        }
        if let Some(value) = self.signal.value(frame, header).filter(|v| v.is_finite()) {
            self.record.turns.push(frame.crank_angle_rad / (2.0 * PI));
            self.record.values.push(value);
            self.record.times_s.push(frame.t_s);
        }
    }

    /// What was collected, with what comes back in this drive.
    pub fn finish(self, header: &Header) -> AngleRecord {
        let AngleRecorder { mut record, frame_times_s, first, mut last, before_last, bodies_of, chain_of, .. } = self;
        let mut to_s = frame_times_s.last().copied().unwrap_or(0.0);
        // The last frame of a run may come early; cubics about it would smear what even frames hold.
        if let [.., a, b, c] = frame_times_s.as_slice()
            && (c - b) < 0.99 * (b - a)
            && record.turns.len() == frame_times_s.len()
        {
            to_s = *b;
            last = before_last;
            record.turns.pop();
            record.values.pop();
            record.times_s.pop();
        }
        let n = record.turns.len();
        let whole = record.turns.last().copied().unwrap_or(0.0) - record.turns.first().copied().unwrap_or(0.0);
        let time_s = (to_s - frame_times_s.first().copied().unwrap_or(0.0)).max(1e-12);
        (record.turns_per_s, record.interval_s) = (whole.abs() / time_s, time_s / n.saturating_sub(1).max(1) as f64);
        let turned: Vec<f64> = first.iter().zip(&last).map(|(a, b)| (b - a) / (2.0 * PI * whole)).collect();
        let driver = turned.iter().enumerate().min_by(|a, b| (a.1 - 1.0).abs().total_cmp(&(b.1 - 1.0).abs()));
        record.driver =
            driver.and_then(|(k, _)| header.coordinates.get(k)).map_or(String::new(), |p| last_name(p).to_string());
        record.bases = bases(header, &turned, &bodies_of, &chain_of);
        record
    }
}

/// Chain of every link, and its number of links.
fn chains(header: &Header) -> Vec<(usize, usize)> {
    let of = |(chain, links): (usize, std::ops::Range<usize>)| links.clone().map(move |_| (chain, links.len()));
    header.chains().into_iter().enumerate().flat_map(of).collect()
}

/// What comes back, the most telling first: teeth, half teeth, sprockets, laps.
fn bases(
    header: &Header,
    turned: &[f64],
    bodies_of: &BTreeMap<usize, usize>,
    chain_of: &[(usize, usize)],
) -> Vec<OrderBase> {
    let (mut teeth, mut halves, mut sprockets, mut laps) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let several = chain_of.last().is_some_and(|last| last.0 > 0);
    let mut seen: Vec<usize> = Vec::new();
    for (body, info) in header.bodies.iter().enumerate().filter(|(_, b)| b.rotor) {
        let Some(order) = info.coordinate.and_then(|k| turned.get(k as usize)).map(|o| o.abs()) else { continue };
        let alike = header.bodies.iter().filter(|b| b.rotor && last_name(&b.path) == last_name(&info.path)).count();
        let name = if alike > 1 { info.path.clone() } else { last_name(&info.path).to_string() };
        sprockets.push(OrderBase { name: name.clone(), order, kind: OrderKind::Sprocket });
        let Some(chain) = bodies_of.get(&body).filter(|chain| !seen.contains(chain)) else { continue };
        seen.push(*chain);
        let tooth = order * f64::from(info.teeth);
        let named = |what: &str| if several { format!("{what} at `{name}`") } else { what.to_string() };
        teeth.push(OrderBase { name: named("tooth"), order: tooth, kind: OrderKind::Tooth });
        halves.push(OrderBase { name: named("half tooth"), order: 0.5 * tooth, kind: OrderKind::HalfTooth });
        if let Some((_, links)) = chain_of.iter().find(|c| c.0 == *chain) {
            laps.push(OrderBase { name: named("lap"), order: tooth / *links as f64, kind: OrderKind::Lap });
        }
    }
    [teeth, halves, sprockets, laps].concat()
}

/// The spectrum of a record.
///
/// # Errors
/// It is too short, or the driver stands.
pub fn spectrum(record: &AngleRecord) -> Result<AngleSpectrum, SpectrumError> {
    let n = record.values.len();
    if n < FEWEST {
        return Err(SpectrumError::Few(n, FEWEST));
    }
    let turns = (record.turns[n - 1] - record.turns[0]).abs() * n as f64 / (n - 1) as f64;
    if turns < 1e-6 {
        return Err(SpectrumError::Still);
    }
    let fastest = record.bases.iter().map(|b| b.order).fold(0.0, f64::max);
    if fastest > 0.0 && turns * fastest < PERIODS {
        let needed = PERIODS / fastest;
        return Err(SpectrumError::Short { turns, needed, needed_s: needed / record.turns_per_s.max(1e-12) });
    }
    let mut values = even(&record.turns, &record.values);
    let mean = remove_line(&mut values);
    let window = |i: usize| 0.5 * (1.0 - libm::cos(2.0 * PI * (i as f64 + 0.5) / n as f64));
    let sum: f64 = (0..n).map(window).sum();
    let length = ((if n > LONG { FEWER_ZEROS } else { ZEROS }) * n).next_power_of_two();
    let mut re = vec![0.0; length];
    let mut im = vec![0.0; length];
    values.iter().enumerate().for_each(|(i, v)| re[i] = v * window(i));
    transform(&mut re, &mut im);
    let amplitudes: Vec<f64> = (0..length / 2).map(|k| 2.0 / sum * libm::hypot(re[k], im[k])).collect();
    // One value more would be the first again: n samples span n distances.
    let step = n as f64 / (length as f64 * turns);
    let mut found = AngleSpectrum { mean, turns, step, amplitudes, peaks: Vec::new(), turns_per_s: record.turns_per_s };
    found.peaks = found.find_peaks(&record.bases);
    Ok(found)
}

/// Values at even distances of the angle.
pub(super) fn even(turns: &[f64], values: &[f64]) -> Vec<f64> {
    let n = turns.len();
    let (first, distance) = (turns[0], (turns[n - 1] - turns[0]) / (n - 1) as f64);
    let off = turns.iter().enumerate().map(|(i, t)| ((t - first) / distance - i as f64).abs()).fold(0.0, f64::max);
    if off < EVEN {
        return values.to_vec();
    }
    let place: Vec<f64> = turns.iter().map(|t| (t - first) / distance).collect();
    let mut at = 0;
    let value = |i: usize| {
        let x = i as f64;
        while at + 2 < n && place[at + 1] <= x {
            at += 1;
        }
        let from = at.saturating_sub(1).min(n - 4);
        // Lagrange's cubic through four samples.
        (from..from + 4)
            .map(|k| {
                let others = (from..from + 4).filter(|j| *j != k);
                values[k] * others.map(|j| (x - place[j]) / (place[k] - place[j])).product::<f64>()
            })
            .sum()
    };
    (0..n).map(value).collect()
}

/// Takes out mean and slope; returns the mean.
pub(super) fn remove_line(values: &mut [f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let middle = 0.5 * (n - 1.0);
    let squares: f64 = (0..values.len()).map(|i| (i as f64 - middle) * (i as f64 - middle)).sum();
    let slope = values.iter().enumerate().map(|(i, v)| (i as f64 - middle) * (v - mean)).sum::<f64>() / squares;
    values.iter_mut().enumerate().for_each(|(i, v)| *v -= mean + slope * (i as f64 - middle));
    mean
}

/// Fourier transform in place (Cooley and Tukey 1965), of a power of two. Its own: one table of libm's sines gives the same bits on every CPU,
/// which a crate with vector instructions would not.
fn transform(re: &mut [f64], im: &mut [f64]) {
    let n = re.len();
    assert!(n.is_power_of_two() && im.len() == n, "{n} values");
    for i in 1..n {
        let j = i.reverse_bits() >> (usize::BITS - n.trailing_zeros());
        if i < j {
            re.swap(i, j);
            im.swap(i, j);
        }
    }
    let turn: Vec<(f64, f64)> = (0..n / 2).map(|k| libm::sincos(-2.0 * PI * k as f64 / n as f64)).collect();
    let mut half = 1;
    while half < n {
        let stride = n / (2 * half);
        for start in (0..n).step_by(2 * half) {
            for k in 0..half {
                let (s, c) = turn[k * stride];
                let (a, b) = (start + k, start + k + half);
                let (x, y) = (re[b] * c - im[b] * s, re[b] * s + im[b] * c);
                (re[b], im[b]) = (re[a] - x, im[a] - y);
                (re[a], im[a]) = (re[a] + x, im[a] + y);
            }
        }
        half *= 2;
    }
}

impl AngleSpectrum {
    /// One order per turns recorded: lines closer than twice this are one.
    pub fn resolution(&self) -> f64 {
        1.0 / self.turns
    }

    /// Values that the zeros behind the samples put into one resolution.
    pub fn values_per_resolution(&self) -> usize {
        (self.resolution() / self.step) as usize
    }

    /// Largest amplitude within half a resolution of an order.
    pub fn near(&self, order: f64) -> f64 {
        let reach = 0.5 * self.resolution();
        let index = |o: f64| (o / self.step).max(0.0) as usize;
        let (from, to) = (index(order - reach), index(order + reach) + 1);
        self.amplitudes.get(from..to.min(self.amplitudes.len())).unwrap_or_default().iter().copied().fold(0.0, f64::max)
    }

    /// All peaks, the largest first.
    fn find_peaks(&self, bases: &[OrderBase]) -> Vec<SpectrumPeak> {
        let a = &self.amplitudes;
        let wide = (1.5 * self.resolution() / self.step) as usize;
        let mut peaks: Vec<SpectrumPeak> = Vec::new();
        let least = ROUNDING * self.mean.abs();
        let mut tops: Vec<usize> = (wide.max(1)..a.len().saturating_sub(1))
            .filter(|k| a[*k] > a[k - 1] && a[*k] >= a[k + 1] && a[*k] > least)
            .collect();
        tops.sort_by(|x, y| a[*y].total_cmp(&a[*x]));
        tops.truncate(4 * MOST_PEAKS);
        for k in tops {
            let (before, here, after) =
                (libm::log(a[k - 1].max(1e-300)), libm::log(a[k]), libm::log(a[k + 1].max(1e-300)));
            let bend = before - 2.0 * here + after;
            let shift = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
            let order = (k as f64 + shift) * self.step;
            let amplitude = libm::exp(here - 0.25 * (before - after) * shift);
            let is_lobe = peaks.iter().any(|p| {
                let away = (p.order - order).abs() / self.resolution();
                away < 1.0 || (away < LOBES.0 && amplitude < LOBES.1 * p.amplitude)
            });
            if is_lobe || peaks.len() >= MOST_PEAKS {
                continue;
            }
            peaks.push(SpectrumPeak {
                order,
                frequency_hz: order * self.turns_per_s,
                amplitude,
                prominence: amplitude / self.around(k).max(1e-300),
                names: Vec::new(),
            });
        }
        let reaches: Vec<f64> = (0..peaks.len()).map(|i| self.reach(&peaks, i)).collect();
        for (peak, reach) in peaks.iter_mut().zip(reaches) {
            peak.names = self.names(peak.order, reach, bases);
        }
        let without: Vec<(f64, f64)> =
            peaks.iter().filter(|p| p.names.is_empty()).map(|p| (p.order, p.amplitude)).collect();
        for peak in peaks.iter_mut().filter(|p| p.prominence < LINE_PROMINENCE) {
            let near = |order: f64| (order - peak.order).abs() < SWING_REACH * self.resolution();
            if without.iter().any(|(order, amplitude)| near(*order) && *amplitude >= SWING_SHARE * peak.amplitude) {
                peak.names.clear();
            }
        }
        peaks
    }

    /// How far off a peak may be, in resolutions: what is around it and what other peaks leave at its place pull it.
    fn reach(&self, peaks: &[SpectrumPeak], i: usize) -> f64 {
        let own = &peaks[i];
        let lobe = |other: &SpectrumPeak| {
            let x = (other.order - own.order).abs() / self.resolution();
            // Envelope of the Hann window's transform.
            other.amplitude / own.amplitude * (1.0 / (PI * x * (x * x - 1.0).max(1e-3))).min(1.0)
        };
        let left: f64 = peaks.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, other)| lobe(other)).sum();
        (NAMING_LEAST + PULL * (1.0 / own.prominence + left)).min(NAMING)
    }

    /// Median of the amplitudes around a value, without its own peak.
    fn around(&self, k: usize) -> f64 {
        let per_resolution = self.resolution() / self.step;
        let (own, reach) = ((2.5 * per_resolution) as usize, (12.0 * per_resolution) as usize);
        let (from, to) = (k.saturating_sub(reach), (k + reach).min(self.amplitudes.len() - 1));
        median((from..=to).filter(|i| i.abs_diff(k) > own).map(|i| self.amplitudes[i]))
    }

    /// What comes back at this order of a record.
    pub fn names_of(&self, order: f64, record: &AngleRecord) -> Vec<String> {
        self.names(order, NAMING, &record.bases)
    }

    /// What comes back at this order, known to `reach` resolutions.
    fn names(&self, order: f64, reach: f64, bases: &[OrderBase]) -> Vec<String> {
        let times = |base: &OrderBase| libm::round(order / base.order);
        let fits = |base: &&OrderBase| {
            let is_close = (times(base) * base.order - order).abs() < reach * self.resolution();
            // What comes back more rarely than the recording resolves fits everything.
            let is_resolved = base.order * self.turns >= PERIODS;
            // An even number of half teeth is a number of teeth.
            let is_other = base.kind == OrderKind::HalfTooth && times(base) % 2.0 == 0.0;
            is_close && is_resolved && !is_other && (1.0..=MULTIPLES).contains(&times(base))
        };
        let name = |base: &OrderBase| match base.kind {
            OrderKind::Sprocket => format!("{} x {}", times(base), base.name),
            OrderKind::Tooth | OrderKind::HalfTooth | OrderKind::Lap => format!("{} x {}", base.name, times(base)),
        };
        let mut found: Vec<&OrderBase> = bases.iter().filter(fits).collect();
        found.sort_by(|a, b| times(a).total_cmp(&times(b)));
        // Where an order is a small multiple of one part's, that it is also a large multiple of another's says nothing.
        let few = found.iter().filter(|b| times(b) <= FEW).count();
        let names: Vec<String> = found.into_iter().map(name).take(few.clamp(1, 3)).collect();
        if names.is_empty() { self.side_band(order, reach, bases).into_iter().collect() } else { names }
    }

    /// A multiple of teeth, a turn or two of a sprocket beside it: a tooth order whose size changes once a turn.
    fn side_band(&self, order: f64, reach: f64, bases: &[OrderBase]) -> Option<String> {
        let resolved = |b: &&OrderBase| b.order * self.turns >= PERIODS;
        let teeth = bases.iter().filter(|b| b.kind == OrderKind::Tooth);
        let turns = || bases.iter().filter(|b| b.kind == OrderKind::Sprocket).filter(resolved);
        let mut found: Vec<(u32, String)> = Vec::new();
        for tooth in teeth {
            let times = libm::round(order / tooth.order);
            let beside = order - times * tooth.order;
            for turn in turns() {
                let by = libm::round(beside.abs() / turn.order);
                let fits = (by * turn.order - beside.abs()).abs() < reach * self.resolution();
                if fits && (1.0..=2.0).contains(&by) && times >= 1.0 {
                    let sign = if beside > 0.0 { '+' } else { '-' };
                    found.push((by as u32, format!("{} x {times} {sign} {by} x {}", tooth.name, turn.name)));
                }
            }
        }
        found.into_iter().min_by_key(|(by, _)| *by).map(|(_, name)| name)
    }
}

/// Most peaks that are found.
const MOST_PEAKS: usize = 60;
/// Amplitudes below this share of the mean are rounding: recordings keep ten digits and more of a number.
const ROUNDING: f64 = 1e-9;

/// Bases that the record is too short for, with the time they take [s].
pub fn unresolved(record: &AngleRecord, spectrum: &AngleSpectrum) -> Vec<(String, f64)> {
    let short = record.bases.iter().filter(|b| b.order > 0.0 && b.order * spectrum.turns < PERIODS);
    short.map(|b| (b.name.clone(), PERIODS / b.order / spectrum.turns_per_s.max(1e-12))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bases() -> Vec<OrderBase> {
        let base = |name: &str, order, kind| OrderBase { name: name.into(), order, kind };
        vec![
            base("tooth", 20.0, OrderKind::Tooth),
            base("half tooth", 10.0, OrderKind::HalfTooth),
            base("driver", 1.0, OrderKind::Sprocket),
            base("driven", 0.5, OrderKind::Sprocket),
            base("lap", 2.0 / 9.0, OrderKind::Lap),
        ]
    }

    /// Two sines and a large mean, with a driver that speeds up and down by 10 %.
    fn record(swing: f64) -> AngleRecord {
        let (n, turns_per_s, interval_s) = (4000, 50.0, 50e-6 * 1.0371);
        let turns: Vec<f64> = (0..n)
            .map(|i| f64::from(i) * interval_s)
            .map(|t| turns_per_s * t + swing * libm::sin(2.0 * PI * 20.0 * t))
            .collect();
        let value = |x: &f64| {
            100.0
                + 0.3 * libm::sin(2.0 * PI * 0.5 * x + 1.0)
                + 2.0 * libm::cos(2.0 * PI * 20.0 * x)
                + 0.05 * libm::cos(2.0 * PI * 30.0 * x)
        };
        let values = turns.iter().map(value).collect();
        AngleRecord {
            turns,
            values,
            bases: bases(),
            driver: "driver".into(),
            turns_per_s,
            interval_s,
            ..AngleRecord::default()
        }
    }

    /// Over two turns: an amplitude 10 % larger differs by 10 %; a phase of 0.1 rad by 2 sin 0.05; a mean, other places of the values and more turns by nothing.
    #[test]
    fn oscillations_differ_by_the_rms_of_their_difference() {
        let wave = |n: u32, amplitude: f64, phase: f64, mean: f64| {
            let turns: Vec<f64> = (0..=n).map(|i| f64::from(i) * 2.0 / 2000.0).collect();
            let values = turns.iter().map(|x| mean + amplitude * libm::sin(2.0 * PI * 3.0 * x + phase)).collect();
            AngleRecord { turns, values, ..AngleRecord::default() }
        };
        let other = wave(2000, 2.0, 0.0, 5.0);
        let share = |own: &AngleRecord| {
            OscillationDifference::between(own, &other).expect("both oscillate").rms_of_difference_share
        };
        assert!((share(&wave(2000, 2.2, 0.0, 7.0)) - 0.1).abs() < 1e-6);
        // The last value is the first one of another period.
        assert!((share(&wave(2000, 2.0, 0.1, 5.0)) - 2.0 * libm::sin(0.05)).abs() < 1e-4);
        let mut elsewhere = wave(2500, 2.0, 0.0, 5.0);
        let at = |x: &f64| 2.0 * libm::sin(2.0 * PI * 3.0 * x);
        elsewhere.turns.iter_mut().for_each(|x| *x += 3e-4);
        elsewhere.values = elsewhere.turns.iter().map(at).collect();
        // Straight lines between values that are a thousandth of a turn apart.
        assert!(share(&elsewhere) < 1e-4, "{}", share(&elsewhere));
        let found = OscillationDifference::between(&elsewhere, &other).expect("both oscillate");
        assert!((found.turns - (2.0 - 3e-4)).abs() < 1e-12 && (found.rms_other - libm::sqrt(2.0)).abs() < 1e-3);
        assert!(OscillationDifference::between(&other, &AngleRecord::default()).is_none());
        let backwards =
            |record: &AngleRecord| AngleRecord { turns: record.turns.iter().map(|x| -x).collect(), ..record.clone() };
        let own = backwards(&wave(2000, 2.2, 0.0, 7.0));
        let found = OscillationDifference::between(&own, &backwards(&other)).expect("both oscillate");
        assert!((found.rms_of_difference_share - 0.1).abs() < 1e-6);
    }

    #[test]
    fn sines_show_their_orders_and_sizes_at_even_and_uneven_speed() {
        for swing in [0.0, 0.04] {
            let s = spectrum(&record(swing)).expect("ten turns");
            let named = |name: &str| s.peaks.iter().find(|p| p.names.iter().any(|n| n == name)).expect("a peak");
            for (name, order, size) in
                [("tooth x 1", 20.0, 2.0), ("1 x driven", 0.5, 0.3), ("half tooth x 3", 30.0, 0.05)]
            {
                let peak = named(name);
                println!("{name}: {} at {}", peak.amplitude, peak.order);
                // Measured 2e-4 at even speed, 1.2e-3 at uneven speed, where a cubic stands between frames.
                assert!((peak.amplitude / size - 1.0).abs() < 0.01, "{name}: {peak:?}");
                assert!((peak.order - order).abs() < 0.01, "{name}: {peak:?}");
            }
            assert!((s.mean - 100.0).abs() < 0.2);
        }
    }

    /// A line beside a multiple that the recording does not part from it is named where noise hides its place, and not where it stands out.
    #[test]
    fn what_swings_beside_an_order_is_not_named_by_it() {
        let mut r = record(0.0);
        // Resolution: 1/10.4 orders; a third of one beside 5 x driver.
        let beside = |x: &f64| 1.0 * libm::sin(2.0 * PI * 5.025 * x);
        for (value, x) in r.values.iter_mut().zip(&r.turns) {
            *value += beside(x);
        }
        let s = spectrum(&r).expect("ten turns");
        let peak = s.peaks.iter().find(|p| (p.order - 5.025).abs() < 0.01).expect("a peak");
        assert!(peak.names.is_empty() && !s.names_of(peak.order, &r).is_empty(), "{peak:?}");
    }

    #[test]
    fn too_little_is_refused() {
        let mut r = record(0.0);
        r.turns.truncate(20);
        r.values.truncate(20);
        assert_eq!(spectrum(&r).err(), Some(SpectrumError::Few(20, FEWEST)));
        let mut r = record(0.0);
        r.turns.iter_mut().for_each(|t| *t *= 0.01);
        assert!(matches!(spectrum(&r).err(), Some(SpectrumError::Short { .. })));
        r.turns.iter_mut().for_each(|t| *t = 0.0);
        assert_eq!(spectrum(&r).err(), Some(SpectrumError::Still));
    }
}
