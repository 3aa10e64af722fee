//! Analysis of the residuals before any effect is named: with which orders of which body they repeat and how these grow
//! with speed, which state they follow, and which force on which body would produce them. The result is a suggestion
//! and no proof: every line is the share of a channel's squared error that one simple form removes, fitted to the same
//! data on which it is measured.

use super::fit::Fit;
use super::model::FittedModel;
use super::problem::Problem;
use super::stats;
use super::unnamed;
use crate::machine::Reads;
use crate::machine::simulate::Samples;
use crate::side_by_side::parallel;
use serde::Serialize;
use std::f64::consts::TAU;

/// A component that repeats with the revolutions of a body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OrderLine {
    /// `order 2 of motor`, `chain loop 1 of crank`.
    pub name: String,
    pub body: String,
    /// Periods per revolution of the body.
    pub order: f64,
    /// Share of the squared error.
    pub share: f64,
    /// Exponent p in amplitude ~ speed^p, if records at different speeds determine it.
    pub speed_exponent: Option<f64>,
}

/// A component that follows a state of a body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StateLine {
    pub body: String,
    pub term: String,
    pub share: f64,
}

/// Amplitudes over order (periods per revolution of a body), the mean over segments, in the channel's unit. Each narrow
/// range of orders is represented by its largest amplitude.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderSpectrum {
    pub body: String,
    pub orders: Vec<f64>,
    pub amplitudes: Vec<f64>,
}

/// Cumulated periodogram of the residuals (Bartlett 1955): white noise stays within `band` of the diagonal in 95 of 100
/// cases.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Periodogram {
    /// Share of the power below frequency band i + 1, where the bands divide half the sampling rate equally.
    pub cumulated: Vec<f64>,
    pub band: f64,
    /// Largest distance from the diagonal.
    pub farthest: f64,
}

/// Residual analysis of a channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelResiduals {
    pub channel: String,
    pub unit: String,
    pub white: bool,
    pub lag1: f64,
    pub periodogram: Periodogram,
    #[serde(skip)]
    pub by_order: Vec<OrderSpectrum>,
    /// Share of the squared error above the noise floor.
    pub above_floor: f64,
    pub orders: Vec<OrderLine>,
    pub states: Vec<StateLine>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Diagnosis {
    pub channels: Vec<ChannelResiduals>,
    /// Forces on bodies: share of the total error that a small force of each form would remove, all channels together.
    pub forces: Vec<StateLine>,
}

/// Highest order examined, besides tooth and chain-loop orders.
const ORDERS: u32 = 6;
/// Maximum number of reported lines of each kind.
const MAX_LINES: usize = 3;
/// A smaller share is not reported.
const MIN_SHARE: f64 = 0.03;
/// A line is significant if its share exceeds this multiple of the share expected from noise.
const CHANCE_FACTOR: f64 = 4.0;

/// Position and speed of a body at the samples of a segment.
struct BodyMotionSamples {
    q: Vec<f64>,
    v: Vec<f64>,
}

/// Residuals of a segment, channel by channel, and the motion of every body in it.
struct SegmentResiduals {
    residuals: Vec<Vec<f64>>,
    moves: Vec<BodyMotionSamples>,
}

/// Analyses the residuals of a model on the data to which it was fitted.
pub fn diagnose(model: &FittedModel, threads: usize) -> Diagnosis {
    let problem = &model.problem;
    let m = &problem.machine;
    let bodies: Vec<usize> = (0..m.bodies.len()).filter(|b| !m.bodies[*b].path.starts_with("effects.")).collect();
    let fitting: Vec<usize> =
        (0..problem.data.segments.len()).filter(|k| problem.data.segments[*k].judge_from > 0).collect();
    let parts: Vec<SegmentResiduals> =
        parallel(fitting.len(), threads, |i| segment_residuals(problem, &model.fit, fitting[i], &bodies))
            .into_iter()
            .flatten()
            .collect();
    let channels = (0..problem.channels.len()).map(|c| channel(problem, &parts, &bodies, c, threads)).collect();
    let mut forces = unnamed::forces(model, threads);
    forces.sort_by(|a: &StateLine, b| b.share.total_cmp(&a.share));
    forces.retain(|f| f.share > MIN_SHARE);
    forces.truncate(MAX_LINES);
    Diagnosis { channels, forces }
}

/// Highest whole order of a shaft that is looked for before effects are screened, and orders of a body that are kept.
const HIGHEST_SCREENED: usize = 64;
const SCREENED_ORDERS: usize = 3;

/// So many half orders are looked for in drives whose links are bodies, up to order 12: those of an engine's cylinders lie below those of teeth.
const HALF_ORDERS: usize = 24;

/// For every body the whole orders that stand out of the residuals of some channel, the strongest first; of drives whose links are bodies half
/// orders too, where orders, valves or defects are declared already. Nothing for pulses and for other drives with links: their orders are those of
/// teeth, marks and loops.
pub(super) fn standing_orders(model: &FittedModel, threads: usize) -> Vec<Vec<f64>> {
    let problem = &model.problem;
    let m = &problem.machine;
    let mut found: Vec<Vec<f64>> = vec![Vec::new(); m.bodies.len()];
    let fitting: Vec<usize> =
        (0..problem.data.segments.len()).filter(|k| problem.data.segments[*k].judge_from > 0).collect();
    let is_timed = |k: &usize| matches!(problem.data.segments[*k].task.samples, Samples::Times { .. });
    let (step, highest) = match m.period_pitches() {
        None => (1.0, HIGHEST_SCREENED),
        Some(_) if m.has_reference() => (0.5, HALF_ORDERS),
        Some(_) => return found,
    };
    if !fitting.iter().all(is_timed) {
        return found;
    }
    let turning: Vec<usize> =
        (0..m.bodies.len()).filter(|b| !m.bodies[*b].slides && !m.bodies[*b].path.starts_with("effects.")).collect();
    let parts: Vec<SegmentResiduals> =
        parallel(fitting.len(), threads, |i| segment_residuals(problem, &model.fit, fitting[i], &turning))
            .into_iter()
            .flatten()
            .collect();
    let channels: Vec<(f64, f64)> = (0..problem.channels.len())
        .map(|c| {
            let all: Vec<Vec<f64>> = parts.iter().map(|p| p.residuals[c].clone()).collect();
            let whole: f64 = all.iter().flatten().map(|r| r * r).sum();
            (whole.max(1e-300), stats::effective(&all).max(1.0))
        })
        .collect();
    for (i, body) in turning.iter().enumerate() {
        let of_part = |c: usize, p: usize| lines(&parts[p], i, c, (step, step, highest));
        let of_channel = |c: usize| parallel(parts.len(), threads, |p| of_part(c, p));
        let by_channel: Vec<Vec<Vec<Option<Line>>>> = (0..channels.len()).map(of_channel).collect();
        let largest = |which: usize| {
            let share = |(c, (whole, effective)): (usize, &(f64, f64))| {
                let own: Vec<f64> = by_channel[c].iter().filter_map(|lines| lines[which]).map(|l| l.0).collect();
                let share = own.iter().sum::<f64>() / whole;
                let by_chance = 2.0 * own.len() as f64 / effective;
                if share > MIN_SHARE && share > CHANCE_FACTOR * by_chance { share } else { 0.0 }
            };
            channels.iter().enumerate().map(share).fold(0.0, f64::max)
        };
        let shares = (0..highest).map(|i| (largest(i), step * (i + 1) as f64));
        let mut own: Vec<(f64, f64)> = shares.filter(|(share, _)| *share > 0.0).collect();
        own.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.total_cmp(&b.1)));
        found[*body] = own.into_iter().take(SCREENED_ORDERS).map(|(_, order)| order).collect();
    }
    found
}

/// Returns None if the model cannot simulate this segment.
fn segment_residuals(problem: &Problem, fit: &Fit, k: usize, bodies: &[usize]) -> Option<SegmentResiduals> {
    let s = &problem.data.segments[k];
    let n = s.judge_from;
    let weighted = problem.residuals(k, &fit.point.globals, &fit.point.locals[k]);
    let residuals: Vec<Vec<f64>> = weighted.chunks(n.max(1)).map(<[f64]>::to_vec).collect();
    let (numbers, _) = problem.numbers(k, &fit.point.globals, &fit.point.locals[k]);
    if let (Samples::Times { t_s, .. }, Some(speeds)) = (&s.task.samples, problem.machine.mean_speeds(&numbers)) {
        let steady = |b: &usize| {
            let v = speeds[*b];
            BodyMotionSamples { q: t_s[..n].iter().map(|t| t * v).collect(), v: vec![v; n] }
        };
        return Some(SegmentResiduals { residuals, moves: bodies.iter().map(steady).collect() });
    }
    match &s.task.samples {
        Samples::Times { .. } => {
            let reads: Vec<Reads> = bodies.iter().flat_map(|b| [Reads::Angle(*b), Reads::Speed(*b)]).collect();
            let shown = problem.with_sensors(&reads);
            let seen = shown.model(k, &fit.point.globals, &fit.point.locals[k], true).ok()?;
            let moves =
                seen.chunks(2).map(|of| BodyMotionSamples { q: of[0][..n].to_vec(), v: of[1][..n].to_vec() }).collect();
            Some(SegmentResiduals { residuals, moves })
        }
        Samples::Pulses { .. } => {
            // A pulse is a fraction of a revolution of the body with the marks. The motion of the other bodies is
            // unknown there.
            let (on, marks) = problem.channels.iter().find_map(|c| match problem.machine.sensors[*c].reads {
                Reads::Pulses { body, marks } => Some((body, marks)),
                Reads::Angle(_)
                | Reads::Speed(_)
                | Reads::Acceleration(_)
                | Reads::Tension(_)
                | Reads::Reaction(_)
                | Reads::Part(_) => None,
            })?;
            let turn = TAU / marks.max(1) as f64;
            let moves = bodies
                .iter()
                .map(|b| BodyMotionSamples {
                    q: (0..n).map(|i| if *b == on { turn * i as f64 } else { 0.0 }).collect(),
                    v: (0..n)
                        .map(|i| if *b == on { turn / libm::exp(s.measured[0][i]) } else { 0.0 })
                        .map(known)
                        .collect(),
                })
                .collect();
            Some(SegmentResiduals { residuals, moves })
        }
    }
}

/// Replaces the value of a missed pulse by zero.
fn known(v: f64) -> f64 {
    if v.is_finite() { v } else { 0.0 }
}

fn channel(
    problem: &Problem,
    parts: &[SegmentResiduals],
    bodies: &[usize],
    c: usize,
    threads: usize,
) -> ChannelResiduals {
    let m = &problem.machine;
    let all: Vec<Vec<f64>> = parts.iter().map(|p| p.residuals[c].clone()).collect();
    // Missing samples are zeros.
    let known: Vec<Vec<f64>> = all.iter().map(|p| p.iter().copied().filter(|r| *r != 0.0).collect()).collect();
    let whole: f64 = all.iter().flatten().map(|r| r * r).sum::<f64>().max(1e-300);
    let samples: usize = known.iter().map(Vec::len).sum();
    let effective = stats::effective(&known).max(1.0);
    let significant =
        |share: f64, numbers: usize| share > MIN_SHARE && share > CHANCE_FACTOR * numbers as f64 / effective;
    let (mut orders, mut states, mut by_order) = (Vec::new(), Vec::new(), Vec::new());
    let shown =
        problem.weights[c] * if problem.data.channels[c].relative { 100.0 } else { problem.data.channels[c].shown };
    for (i, b) in bodies.iter().enumerate() {
        let body = &m.bodies[*b];
        if !body.slides {
            let mut looked: Vec<(String, f64)> =
                (1..=ORDERS).map(|k| (format!("order {k} of {}", body.name), f64::from(k))).collect();
            if let Some(z) = body.teeth {
                looked.push((format!("teeth of {}", body.name), f64::from(z)));
                if let Some(chain) = m.chain_at(*b) {
                    let loops = f64::from(z) / f64::from(chain.links);
                    looked.extend((1..=3).map(|k| (format!("chain loop {k} of {}", body.name), loops * f64::from(k))));
                }
            }
            by_order.extend(spectrum(parts, i, c, shown, threads).map(|(orders, amplitudes)| OrderSpectrum {
                body: body.path.clone(),
                orders,
                amplitudes,
            }));
            for (name, order) in looked {
                let found: Vec<Line> = parts.iter().filter_map(|p| line(p, i, c, order)).collect();
                let share = found.iter().map(|f| f.0).sum::<f64>() / whole;
                if significant(share, 2 * found.len()) {
                    let speed_exponent = exponent(&found);
                    orders.push(OrderLine { name, body: body.path.clone(), order, share, speed_exponent });
                }
            }
        }
        for (term, of) in STATES {
            if term == "q" && !body.slides || term == "1" && i > 0 {
                continue;
            }
            let (mut along, mut size) = (0.0, 0.0);
            for p in parts {
                let x: Vec<f64> = p.moves[i].q.iter().zip(&p.moves[i].v).map(|(q, v)| of(*q, *v)).collect();
                along += x.iter().zip(&p.residuals[c]).map(|(x, r)| x * r).sum::<f64>();
                size += x.iter().map(|x| x * x).sum::<f64>();
            }
            let share = along * along / size.max(1e-300) / whole;
            if significant(share, 1) {
                states.push(StateLine { body: body.path.clone(), term: term.into(), share });
            }
        }
    }
    orders.sort_by(|a: &OrderLine, b| b.share.total_cmp(&a.share));
    orders.truncate(MAX_LINES);
    states.sort_by(|a: &StateLine, b| b.share.total_cmp(&a.share));
    // At a single speed all powers of it fit equally.
    states.dedup_by(|a, b| a.body == b.body && (a.share - b.share).abs() < 1e-3 * b.share);
    states.truncate(MAX_LINES);
    let channel = &problem.data.channels[c];
    let noise = channel.noise / problem.weights[c];
    ChannelResiduals {
        channel: channel.name.clone(),
        unit: if channel.relative { "%".into() } else { channel.unit.clone() },
        periodogram: periodogram(&all),
        by_order,
        white: stats::white(&known),
        lag1: stats::neighbour_correlation(&known),
        above_floor: (1.0 - noise * noise * samples as f64 / whole).max(0.0),
        orders,
        states,
    }
}

/// States that a residual may follow.
type StateTerm = fn(f64, f64) -> f64;
const STATES: [(&str, StateTerm); 6] = [
    ("1", |_, _| 1.0),
    ("v", |_, v| v),
    ("|v|", |_, v| v.abs()),
    ("v |v|", |_, v| v * v.abs()),
    ("sign(v)", |_, v| sign(v)),
    ("q", |q, _| q),
];

fn sign(v: f64) -> f64 {
    if v == 0.0 { 0.0 } else { v.signum() }
}

/// Share of the squares that a wave of one order removes from a channel in a segment, its amplitude, and the mean speed.
type Line = (f64, f64, f64);

/// Samples that are looked at together, for all orders.
const TOGETHER: usize = 512;

/// What a wave of each of `count` orders from `first` on, `step` apart, removes. None for an order of which the segment is too short, or its
/// sampling too coarse.
fn lines(
    p: &SegmentResiduals,
    body: usize,
    channel: usize,
    (first, step, count): (f64, f64, usize),
) -> Vec<Option<Line>> {
    let (q, r) = (&p.moves[body].q, &p.residuals[channel]);
    let n = r.len();
    if n < 16 {
        return vec![None; count];
    }
    let way: f64 = q.windows(2).map(|w| (w[1] - w[0]).abs()).sum();
    let speed = p.moves[body].v.iter().map(|v| v.abs()).sum::<f64>() / n as f64;
    let mut sums = vec![[0.0; 5]; count];
    // The wave of one order, turned by that of the distance, is the wave of the next: some 1e-13 are lost over thousands of them.
    for (q, r) in q.chunks(TOGETHER).zip(r.chunks(TOGETHER)) {
        let waves = |order: f64| q.iter().map(|q| crate::units::sin_cos(order * q)).collect::<Vec<(f64, f64)>>();
        let (mut wave, turn) = (waves(first), if count > 1 { waves(step) } else { Vec::new() });
        for sums in &mut sums {
            for ((s, c), r) in wave.iter().zip(r) {
                for (sum, x) in sums.iter_mut().zip([c * c, s * s, c * s, c * r, s * r]) {
                    *sum += x;
                }
            }
            for ((s, c), (sin, cos)) in wave.iter_mut().zip(&turn) {
                (*s, *c) = (*s * cos + *c * sin, *c * cos - *s * sin);
            }
        }
    }
    let of = |(i, [cc, ss, cs, cr, sr]): (usize, [f64; 5])| {
        let turns = (first + i as f64 * step) * way / TAU;
        let det = cc * ss - cs * cs;
        if !(3.0..=0.45 * n as f64).contains(&turns) || det < 1e-6 * cc * ss {
            return None;
        }
        let (a, b) = ((ss * cr - cs * sr) / det, (cc * sr - cs * cr) / det);
        Some((a * cr + b * sr, libm::hypot(a, b), speed))
    };
    sums.into_iter().enumerate().map(of).collect()
}

/// The same for one order.
fn line(p: &SegmentResiduals, body: usize, channel: usize, order: f64) -> Option<Line> {
    lines(p, body, channel, (order, 0.0, 1)).into_iter().next().flatten()
}

/// Orders that are computed for a spectrum, and lines that are drawn.
const MAX_ORDERS: usize = 2000;
const ORDER_BINS: usize = 200;

/// Orders, and amplitudes times `shown`. None if the body does not turn often enough.
fn spectrum(
    parts: &[SegmentResiduals],
    body: usize,
    channel: usize,
    shown: f64,
    threads: usize,
) -> Option<(Vec<f64>, Vec<f64>)> {
    let turns = |p: &SegmentResiduals| p.moves[body].q.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / TAU;
    let (longest, samples) =
        parts.iter().map(|p| (turns(p), p.residuals[channel].len())).max_by(|a, b| a.0.total_cmp(&b.0))?;
    if longest < 6.0 || samples < 64 {
        return None;
    }
    // Orders at half the resolution limit of records of this length, up to the maximum count.
    let last = 0.45 * samples as f64 / longest;
    let count = ((2.0 * longest * last) as usize).clamp(ORDER_BINS, MAX_ORDERS);
    let step = last / count as f64;
    let found = parallel(parts.len(), threads, |i| lines(&parts[i], body, channel, (step, step, count)));
    let (mut orders, mut amplitudes) = (Vec::new(), Vec::new());
    for bin in 0..ORDER_BINS {
        let inside = bin * count / ORDER_BINS..(bin + 1) * count / ORDER_BINS;
        let of = |i: usize| {
            let own: Vec<f64> = found.iter().filter_map(|lines| lines[i]).map(|l| l.1).collect();
            let mean = own.iter().sum::<f64>() / own.len().max(1) as f64;
            (step * (i as f64 + 1.0), mean * shown)
        };
        let (order, amplitude) = inside.map(of).max_by(|a, b| a.1.total_cmp(&b.1))?;
        orders.push(order);
        amplitudes.push(amplitude);
    }
    Some((orders, amplitudes))
}

/// Samples per block, and bands of the cumulated periodogram.
const BLOCK: usize = 256;
const BANDS: usize = 64;

/// Periodogram from blocks of at most 256 samples, each with its mean removed.
fn periodogram(parts: &[Vec<f64>]) -> Periodogram {
    let (mut power, mut counts) = ([0.0; BANDS], [0_usize; BANDS]);
    for block in parts.iter().flat_map(|p| p.chunks(BLOCK)).filter(|b| b.len() >= 2 * BANDS) {
        let (n, mean) = (block.len(), block.iter().sum::<f64>() / block.len() as f64);
        let half = (n - 1) / 2;
        // Repeated rotation by one angle loses some 1e-13 over a block.
        for k in 1..=half {
            let (sin, cos) = crate::units::sin_cos(TAU * k as f64 / n as f64);
            let (mut c, mut s, mut re, mut im) = (1.0, 0.0, 0.0, 0.0);
            for x in block {
                re += (x - mean) * c;
                im += (x - mean) * s;
                (c, s) = (c * cos - s * sin, s * cos + c * sin);
            }
            let band = (2 * k * BANDS / n).min(BANDS - 1);
            power[band] += (re * re + im * im) / n as f64;
            counts[band] += 1;
        }
    }
    let (whole, ordinates): (f64, usize) = (power.iter().sum(), counts.iter().sum());
    if ordinates == 0 || whole <= 0.0 {
        return Periodogram::default();
    }
    let mut sum = 0.0;
    let cumulated: Vec<f64> = power
        .iter()
        .map(|p| {
            sum += p / whole;
            sum
        })
        .collect();
    // Expectation for white noise: the bands at the ends hold fewer ordinates.
    let diagonal = |i: usize| counts[..=i].iter().sum::<usize>() as f64 / ordinates as f64;
    let farthest = cumulated.iter().enumerate().map(|(i, c)| (c - diagonal(i)).abs()).fold(0.0, f64::max);
    // 95 % point of Kolmogorov and Smirnov.
    Periodogram { cumulated, band: 1.36 / libm::sqrt(ordinates as f64), farthest }
}

/// Slope of the logarithm of amplitude over that of speed; None unless speeds differ by at least a third.
fn exponent(found: &[Line]) -> Option<f64> {
    let points: Vec<(f64, f64)> =
        found.iter().filter(|f| f.1 > 0.0 && f.2 > 0.0).map(|f| (libm::log(f.2), libm::log(f.1))).collect();
    let low = points.iter().map(|p| p.0).fold(f64::MAX, f64::min);
    let high = points.iter().map(|p| p.0).fold(f64::MIN, f64::max);
    if points.len() < 2 || high - low < libm::log(4.0 / 3.0) {
        return None;
    }
    let n = points.len() as f64;
    let (x, y) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let (xy, xx) = points.iter().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - x) * (p.1 - y), s.1 + (p.0 - x) * (p.0 - x)));
    Some(xy / xx)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::stats::Random;

    #[test]
    fn white_noise_stays_near_the_diagonal_and_a_slow_wave_leaves_it() {
        let mut random = Random::new(5);
        let mut noise = || (0..2048).map(|_| random.below(2001) as f64 / 1000.0 - 1.0).collect::<Vec<f64>>();
        let beyond = (0..100).map(|_| periodogram(&[noise()])).filter(|p| p.farthest > p.band).count();
        assert!((1..=12).contains(&beyond), "{beyond} of 100 outside the band of 95 %");
        let white = noise();
        let slow = white.iter().enumerate().map(|(i, x)| x + libm::sin(0.05 * i as f64)).collect();
        let p = periodogram(&[slow]);
        assert!(p.farthest > 10.0 * p.band, "{} of {}", p.farthest, p.band);
    }

    #[test]
    fn a_wave_stands_at_its_order_with_its_amplitude() {
        let q: Vec<f64> = (0..2000).map(|i| 0.1 * f64::from(i) + 1e-5 * f64::from(i * i)).collect();
        let residuals = vec![q.iter().map(|q| 0.7 * libm::sin(3.0 * q + 0.4)).collect()];
        let part = SegmentResiduals { residuals, moves: vec![BodyMotionSamples { v: vec![1.0; q.len()], q }] };
        let (orders, amplitudes) = spectrum(&[part], 0, 0, 10.0, 1).expect("turns often enough");
        let top = (0..orders.len()).max_by(|a, b| amplitudes[*a].total_cmp(&amplitudes[*b])).expect("lines");
        assert!(
            (orders[top] - 3.0).abs() < 0.02 && (amplitudes[top] - 7.0).abs() < 0.7,
            "{} {}",
            orders[top],
            amplitudes[top]
        );
    }
}
