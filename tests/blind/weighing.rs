//! Contribution of an effect after all free parameters have been adjusted, and its rivals.

use super::effects::{Fault, Law, Scale};
use super::machine::{Kind, Machine, Wish, machine};
use super::numbers::{Random, dot, mean, rms};
use super::records::{Record, records};
use super::simulation::{Nudge, Run, Scene, run};
use super::{COARSE, MARK};
use std::f64::consts::PI;

/// Output of a bench with some effects, with which an additional one is compared.
pub(super) struct Beside<'a> {
    bench: &'a Bench,
    faults: Vec<Fault>,
    parts: usize,
    judging: bool,
    shown: Vec<f64>,
}

impl Beside<'_> {
    /// Contribution of one additional effect, over noise.
    pub(super) fn mark(&self, added: &Fault) -> Vec<f64> {
        let with: Vec<Fault> = self.faults.iter().copied().chain([*added]).collect();
        let with = self.bench.shows(&self.bench.m, &with, self.parts, None, self.judging);
        with.iter().zip(&self.shown).map(|(a, b)| a - b).collect()
    }

    /// The largest of its channels.
    fn size(&self, added: &Fault) -> f64 {
        self.bench.best(&self.mark(added), self.judging)
    }
}

/// A machine with its records and the noise of its channels.
pub(super) struct Bench {
    pub(super) m: Machine,
    pub(super) records: Vec<Record>,
    pub(super) sigma: Vec<f64>,
    pub(super) scale: Scale,
    pub(super) wish: Wish,
}

impl Bench {
    pub(super) fn new(kind: Kind, wish: Wish, random: &mut Random) -> Bench {
        let m = machine(kind, wish, random);
        let mut records = records(&m, wish, random);
        let runs: Vec<Run> = records.iter().map(|rec| run(&Scene { m: &m, faults: &[], rec }, COARSE, None)).collect();
        for (rec, run) in records.iter_mut().zip(&runs) {
            let low = run.angle.iter().copied().fold(f64::MAX, f64::min);
            let high = run.angle.iter().copied().fold(f64::MIN, f64::max);
            rec.bump = [run.angle[run.angle.len() / 2], 0.12 * (high - low).max(1e-9)];
        }
        // The signal is its variation within records; a mean carries no more information.
        let signal: Vec<f64> = (0..m.channels)
            .map(|c| {
                let spreads = runs.iter().map(|r| {
                    let middle = mean(&r.channels[c]);
                    let moves: Vec<f64> = r.channels[c].iter().map(|y| y - middle).collect();
                    rms(&moves).max(if wish.one_speed { 0.05 * middle.abs() } else { 0.0 })
                });
                spreads.sum::<f64>() / runs.len() as f64
            })
            .collect();
        let sigma = signal.iter().map(|s| s * 10.0_f64.powf(-random.between(10.0, 40.0) / 20.0)).collect();
        let speed = [0, 1].map(|b| rms(runs.iter().flat_map(|r| &r.speed[b])));
        let (input, torque) = match kind {
            Kind::Chain => (1.0, m.torque),
            _ => {
                let u = rms(records.iter().flat_map(|r| &r.input));
                (u, u * m.gain)
            }
        };
        let stretch = rms(runs.iter().flat_map(|r| &r.stretch)).max(1e-12);
        let span_s = records.iter().map(|r| r.n as f64 * r.step_s).fold(0.0, f64::max);
        let scale = Scale { speed, torque, stretch, input, signal, sample_s: 1.0 / m.rate_hz, span_s };
        Bench { m, records, sigma, scale, wish }
    }

    /// All records of a machine, each channel by channel over its noise, one after the other.
    pub(super) fn shows(
        &self,
        m: &Machine,
        faults: &[Fault],
        parts: usize,
        nudge: Option<Nudge>,
        judging: bool,
    ) -> Vec<f64> {
        let mut all = Vec::new();
        for rec in self.records.iter().filter(|r| judging || !r.judges) {
            let run = run(&Scene { m, faults, rec }, parts, nudge);
            for (y, sigma) in run.channels.iter().zip(&self.sigma) {
                all.extend(y.iter().map(|y| y / sigma));
            }
        }
        all
    }

    /// Root mean square of a difference over noise, for the channel that shows it best.
    pub(super) fn best(&self, difference: &[f64], judging: bool) -> f64 {
        let n = self.m.channels;
        let mut sums = vec![(0.0, 0.0); n];
        let mut at = 0;
        for rec in self.records.iter().filter(|r| judging || !r.judges) {
            for sum in &mut sums {
                let part = &difference[at..at + rec.n];
                *sum = (sum.0 + dot(part, part), sum.1 + rec.n as f64);
                at += rec.n;
            }
        }
        sums.iter().map(|(s, n)| (s / f64::max(*n, 1.0)).sqrt()).fold(0.0, f64::max)
    }

    /// Range of each fitting record in a difference.
    fn slices(&self) -> Vec<std::ops::Range<usize>> {
        let mut at = 0;
        let fitting = self.records.iter().filter(|r| !r.judges);
        fitting
            .map(|r| {
                let from = at;
                at += r.n * self.m.channels;
                from..at
            })
            .collect()
    }

    pub(super) fn beside(&self, faults: &[Fault], parts: usize, judging: bool) -> Beside<'_> {
        let shown = self.shows(&self.m, faults, parts, None, judging);
        Beside { bench: self, faults: faults.to_vec(), parts, judging, shown }
    }

    /// The fault at the size that gives a contribution of `target`; None if no plausible size does.
    pub(super) fn sized(&self, others: &[Fault], fault: &Fault, target: f64) -> Option<Fault> {
        let mut fault = *fault;
        let beside = self.beside(others, COARSE, false);
        if fault.law == Law::SignBlind {
            let found = beside.size(&fault);
            return (found.is_finite() && found > MARK.0).then_some(fault);
        }
        let most = self.scale.size(&self.m, &fault).1;
        for _ in 0..7 {
            let found = beside.size(&fault);
            if !found.is_finite() {
                fault.size *= 0.1;
                continue;
            }
            let ratio = target / found.max(1e-9);
            if (ratio - 1.0).abs() < 0.03 {
                return Some(fault);
            }
            // An effect limited by play or friction is zero at small sizes.
            fault.size *= ratio.clamp(0.05, 8.0);
            if fault.size.abs() > most {
                fault.size = most.copysign(fault.size);
            }
        }
        let found = beside.size(&fault);
        (found.is_finite() && (found / target - 1.0).abs() < 0.3).then_some(fault)
    }

    /// Orthonormal directions in which free parameters and initial states change the fitting data.
    pub(super) fn frame(&self, beside: &Beside) -> Vec<Vec<f64>> {
        let others = &beside.faults;
        let less = |a: Vec<f64>| -> Vec<f64> { a.iter().zip(&beside.shown).map(|(a, b)| a - b).collect() };
        let mut columns = Vec::new();
        for number in self.m.numbers(self.wish) {
            let mut m = self.m.clone();
            *m.number(number) *= 1.0 + 1e-4;
            columns.push(less(self.shows(&m, others, COARSE, None, false)));
        }
        let mut nudges: Vec<Nudge> =
            self.m.free().iter().map(|b| Nudge::Speed(*b, 1e-4 * self.scale.speed[*b])).collect();
        if self.m.kind != Kind::One {
            nudges.push(Nudge::Angle(self.m.last(), 1e-3 * self.scale.stretch / self.m.radius[1]));
        }
        for nudge in nudges {
            let moved = less(self.shows(&self.m, others, COARSE, Some(nudge), false));
            columns.extend(self.slices().into_iter().map(|range| only(&moved, range)));
        }
        let mut frame: Vec<Vec<f64>> = Vec::new();
        for column in columns {
            let size = dot(&column, &column).sqrt();
            // Twice is enough: Kahan and Parlett.
            let mut rest = outside(&outside(&column, &frame), &frame);
            let left = dot(&rest, &rest).sqrt();
            if left > 1e-7 * size && left > 0.0 {
                rest.iter_mut().for_each(|x| *x /= left);
                frame.push(rest);
            }
        }
        frame
    }
}

/// A column restricted to this range, zero elsewhere.
fn only(column: &[f64], range: std::ops::Range<usize>) -> Vec<f64> {
    let mut own = vec![0.0; column.len()];
    own[range.clone()].copy_from_slice(&column[range]);
    own
}

/// A column minus its projection onto the frame.
pub(super) fn outside(column: &[f64], frame: &[Vec<f64>]) -> Vec<f64> {
    let mut rest = column.to_vec();
    for direction in frame {
        let along = dot(&rest, direction);
        rest.iter_mut().zip(direction).for_each(|(x, d)| *x -= along * d);
    }
    rest
}

/// Two contributions differ if the remainder of one after the other is longer than this [standard deviations, squared].
const TELLING: f64 = 12.0;

impl Bench {
    /// Paths of effects that give the same contribution as `fault`, beside others.
    pub(super) fn rivals(&self, beside: &Beside, fault: &Fault, mark: &[f64], frame: &[Vec<f64>]) -> Vec<String> {
        let whole = dot(mark, mark);
        let own = fault.path(&self.m);
        let mut found: Vec<String> = Vec::new();
        for rival in self.alternatives(fault) {
            let path = rival.path(&self.m);
            if path == own || found.contains(&path) || beside.faults.iter().any(|o| o.path(&self.m) == path) {
                continue;
            }
            let left = match rival.order(&self.m) {
                Some(_) => self.left_by_wave(beside, rival, mark, frame),
                None => self.left_by_size(beside, rival, mark, frame),
            };
            if left < TELLING && left < 0.5 * whole {
                found.push(path);
            }
        }
        found
    }

    /// Effects that could be mistaken for this one: with the same waves, or without waves like it.
    fn alternatives(&self, fault: &Fault) -> Vec<Fault> {
        use Law::{Alternate, Encoder, Fluctuation, Polygon, Ripple, Runout, ToothPitch, Unbalance};
        let (m, v) = (&self.m, self.scale.speed);
        let mut all = Vec::new();
        let mut add = |law: Law, at: usize, form: f64| {
            let mut f = Fault { law, at, size: 0.0, form: [form, 0.0], phase: 0.0, sticks: false };
            f.size = self.scale.size(m, &f).0;
            all.push(f);
        };
        if let Some(waves) = fault.waves(m) {
            let sprockets = if m.kind == Kind::Chain { 0..2 } else { 0..0 };
            for at in sprockets {
                [Runout, Polygon, Alternate].iter().for_each(|law| add(*law, at, 0.0));
                [2.0, 3.0, 4.0].iter().for_each(|n| add(ToothPitch, at, *n));
            }
            if m.kind == Kind::Chain {
                [1.0, 2.0].iter().for_each(|n| add(Fluctuation, 0, *n));
            }
            if !m.slides {
                for at in m.free() {
                    [1.0, 2.0, 3.0].iter().for_each(|n| add(Ripple, *at, *n));
                    add(Unbalance, *at, 1.0);
                }
                let speeds = (0..m.channels).filter(|c| m.sensed(*c).is_some());
                speeds.for_each(|c| [1.0, 2.0].iter().for_each(|n| add(Encoder, c, *n)));
            }
            all.retain(|f| f.waves(m).is_some_and(|w| (w - waves).abs() < 1e-9));
            return all;
        }
        for at in m.free() {
            [Law::Coulomb, Law::Stribeck].iter().for_each(|law| add(*law, *at, 0.3 * v[*at]));
            add(Law::Coulomb, *at, 0.05 * v[*at]);
            [Law::Quadratic, Law::Constant, Law::Viscous].iter().for_each(|law| add(*law, *at, 0.0));
        }
        if m.kind != Kind::Chain {
            use Law::{DeadZone, GainCurve, InputDelay, InputOffset, Lag, Saturation};
            let laws = [GainCurve, Saturation, DeadZone, InputOffset, InputDelay, Lag];
            laws.iter().for_each(|law| add(*law, 0, 0.0));
        }
        if m.kind != Kind::One {
            [Law::Backlash, Law::Hardening].iter().for_each(|law| add(*law, 0, 0.0));
        }
        for c in 0..m.channels {
            [Law::Latency, Law::LowPass, Law::Gain, Law::Offset, Law::Drift].iter().for_each(|law| add(*law, c, 0.0));
        }
        // One delay for another.
        let late = |f: &Fault| matches!(f.law, Law::InputDelay | Law::Lag | Law::Latency | Law::LowPass);
        if late(fault) {
            all.iter_mut().filter(|f| late(f)).for_each(|f| f.size = fault.size);
        }
        all
    }

    /// Squared length of a contribution that remains after a rival of best size.
    fn left_by_size(&self, beside: &Beside, mut rival: Fault, mark: &[f64], frame: &[Vec<f64>]) -> f64 {
        let whole = dot(mark, mark);
        // A fit has narrower limits than the plausible range.
        let most = 10.0 * self.scale.size(&self.m, &rival).1;
        let mut least = whole;
        // Contributions are not quite proportional to sizes: a few rounds find the size.
        for round in 0..6 {
            let raw = beside.mark(&rival);
            let own = outside(&raw, frame);
            let (size, all) = (dot(&own, &own), dot(&raw, &raw));
            // If free parameters absorb it, only rounding is left.
            if !size.is_finite() || size < 1e-8 * all || size == 0.0 {
                break;
            }
            let factor = dot(&own, mark) / size;
            let wrong = rival.one_signed() && factor <= 0.0;
            if wrong || (rival.size * factor).abs() > most {
                break;
            }
            let left = whole - factor * factor * size;
            if (factor - 1.0).abs() < 0.2 || round > 3 {
                least = least.min(left);
            }
            if left > 0.5 * whole || (factor - 1.0).abs() < 1e-3 {
                break;
            }
            rival.size *= factor;
        }
        least
    }

    /// The same for a rival with one size and a phase in every record.
    fn left_by_wave(&self, beside: &Beside, rival: Fault, mark: &[f64], frame: &[Vec<f64>]) -> f64 {
        let waves = [rival, Fault { phase: 0.5 * PI, ..rival }].map(|f| beside.mark(&f));
        let slices = self.slices();
        let columns: Vec<Vec<f64>> =
            slices.iter().flat_map(|range| waves.iter().map(|w| outside(&only(w, range.clone()), frame))).collect();
        let Some(fit) = least_squares(&columns, mark) else { return f64::MAX };
        let sizes: Vec<f64> = fit.chunks(2).map(|x| x[0].hypot(x[1])).collect();
        // The common size of all records, weighted by their information.
        let weights: Vec<f64> = columns.chunks(2).map(|c| dot(&c[0], &c[0]) + dot(&c[1], &c[1])).collect();
        let size = dot(&weights, &sizes) / weights.iter().sum::<f64>();
        let mut left = mark.to_vec();
        for (i, (column, x)) in columns.iter().zip(&fit).enumerate() {
            let x = x * size / sizes[i / 2].max(1e-300);
            left.iter_mut().zip(column).for_each(|(l, c)| *l -= x * c);
        }
        dot(&left, &left)
    }
}

/// The least-squares solution for `right`; by Gauss and Jordan, for few columns that are nearly independent.
fn least_squares(columns: &[Vec<f64>], right: &[f64]) -> Option<Vec<f64>> {
    let n = columns.len();
    let mut a: Vec<Vec<f64>> = columns.iter().map(|c| columns.iter().map(|d| dot(c, d)).collect()).collect();
    let mut x: Vec<f64> = columns.iter().map(|c| dot(c, right)).collect();
    for i in 0..n {
        let pivot = a[i][i];
        if pivot.is_nan() || pivot <= 1e-9 * dot(&columns[i], &columns[i]) {
            return None;
        }
        let own = a[i].clone();
        for k in (0..n).filter(|k| *k != i) {
            let share = a[k][i] / pivot;
            a[k].iter_mut().zip(&own).for_each(|(x, y)| *x -= share * y);
            x[k] -= share * x[i];
        }
    }
    Some((0..n).map(|i| x[i] / a[i][i]).collect())
}
