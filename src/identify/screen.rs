//! Screening: the share of the error that a hypothesis would explain if it were small and linear, computed before any
//! fit.
//!
//! A hypothesis changes the residuals along columns d_i (one for every amplitude; two for an amplitude with a phase, in
//! every record). After projecting out the directions of all free parameters, the cost falls by |P e|^2, P the
//! projector on the columns. This is exact for amplitudes that enter linearly (variable projection, Golub and Pereyra
//! 1973).

use super::candidates::Hypothesis;
use super::fit::{Fit, orthonormal, project_out};
use super::problem::{DIVERGED_RESIDUAL, FINE_PITCHES, Local, Point, Problem};
use crate::effects::Kind;
use crate::units::within;
use nalgebra::{DMatrix, DVector};

/// Screening result of a hypothesis.
#[derive(Clone, Debug)]
pub struct ScreeningResult {
    /// Share of the cost that it would remove.
    pub gain: f64,
    pub fit_start: FitStart,
    /// Its columns: residuals of all segments one after the other, with the free parameters projected out.
    pub columns: Vec<Vec<f64>>,
    /// Whether it changes nothing in these records.
    pub idle: bool,
}

impl ScreeningResult {
    /// The result of a hypothesis that was not screened, for lack of time or because no small column can show it. It has no gain and is not idle, so
    /// that nothing speaks for it or against it.
    pub fn unseen(h: &Hypothesis, records: usize) -> ScreeningResult {
        let fit_start = FitStart { values: h.values.clone(), phases: vec![0.0; records], travels: Vec::new() };
        ScreeningResult { gain: 0.0, fit_start, columns: Vec::new(), idle: false }
    }
}

/// Start of a fit of a hypothesis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitStart {
    /// All its parameters, SI.
    pub values: Vec<f64>,
    /// One for each record.
    pub phases: Vec<f64>,
    /// One for each segment of a motion with a period [pitches]; empty: unchanged.
    pub travels: Vec<f64>,
}

/// Residuals of a fit and the directions of its free parameters, for all segments together.
pub struct LinearisedBase {
    pub residual: Vec<f64>,
    /// Residuals before projection.
    raw: Vec<f64>,
    pub basis: Vec<Vec<f64>>,
    /// Fitted segments: index, and offset of their residuals.
    parts: Vec<(usize, usize)>,
    local_bases: Vec<Vec<Vec<f64>>>,
}

// Measured with twice and half of each of the following on the 16 cases of tests/blind_share.rs: no name changes, and sizes only in
// their last digits.
/// Amplitude of a probe, as a fraction of the starting amplitude.
const PROBE: f64 = 1e-3;
/// Factors on the gain of a hypothesis whose best amplitude has the wrong sign, or lies beyond its range: it is fitted later than
/// others, not never, because the fit of all numbers together may move it.
const WRONG_SIGN: f64 = 0.05;
const TOO_LARGE: f64 = 0.5;
/// Amplitude from which the fit then starts, as a fraction of the starting amplitude.
const SMALL: f64 = 0.1;
/// Added to the diagonal of normalised columns, so that equal columns share an amplitude.
const RIDGE: f64 = 1e-9;

impl LinearisedBase {
    pub fn new(problem: &Problem, fit: &Fit) -> LinearisedBase {
        let mut residual = Vec::new();
        let mut parts = Vec::new();
        let n = problem.globals.len();
        let mut columns = vec![Vec::new(); n];
        for (k, r) in fit.residuals.iter().enumerate() {
            if r.is_empty() {
                continue;
            }
            parts.push((k, residual.len()));
            residual.extend_from_slice(r);
            let j = &fit.jacobians[k];
            for (g, column) in columns.iter_mut().enumerate() {
                match j.nrows() == r.len() {
                    true => column.extend(j.column(g).iter()),
                    false => column.resize(residual.len(), 0.0),
                }
            }
        }
        let local_bases = parts.iter().map(|(k, _)| local_basis(problem, &fit.point, *k)).collect();
        let mut base =
            LinearisedBase { raw: residual.clone(), residual, basis: orthonormal(&columns), parts, local_bases };
        let residual = base.residual.clone();
        base.residual = base.projected(&residual);
        base
    }

    /// The column with the directions of all free parameters projected out.
    fn projected(&self, column: &[f64]) -> Vec<f64> {
        let mut out = Vec::with_capacity(column.len());
        for (i, (_, from)) in self.parts.iter().enumerate() {
            let to = self.parts.get(i + 1).map_or(column.len(), |(_, from)| *from);
            out.extend(project_out(&column[*from..to], &self.local_bases[i]));
        }
        project_out(&out, &self.basis)
    }

    /// An earlier screening of a hypothesis in a motion with a period, beside what this model has taken up since: its first amplitude, which has one
    /// column. `moved`: for every segment, where the earlier model began and where this one does [pitches]. Each keeps the place that it has found
    /// since, moved on by whole periods of a drive with all links alike, which say where on the loop the effect lies.
    pub fn reused(
        &self,
        earlier: &ScreeningResult,
        h: &Hypothesis,
        (moved, alike): (&[[f64; 2]], f64),
        range: (f64, f64),
    ) -> ScreeningResult {
        let columns: Vec<Vec<f64>> = earlier.columns.iter().map(|c| self.projected(c)).collect();
        let on = |(place, [was, now]): (&f64, &[f64; 2])| now + alike * libm::round((place - was) / alike);
        let travels = earlier.fit_start.travels.iter().zip(moved).map(on).collect();
        let mut fit_start = FitStart { travels, ..earlier.fit_start.clone() };
        let mut gain = 0.0;
        if let ([column], Some(amplitude)) = (&columns[..], h.amplitudes().first()) {
            let (along, size) = dot_and_size(&self.residual, column);
            let (low, high) = multiples(h, *amplitude, range);
            let x = within(-along / f64::max(size, 1e-300), low, high);
            gain = (-(2.0 * x * along + x * x * size) / f64::max(self.cost(), 1e-300)).max(0.0);
            if x != 0.0 {
                fit_start.values[*amplitude] = x * h.values[*amplitude];
            }
        }
        ScreeningResult { gain, fit_start, columns, idle: earlier.idle }
    }

    /// Sum of squares that remains to be explained.
    pub fn cost(&self) -> f64 {
        self.residual.iter().map(|r| r * r).sum()
    }

    /// Share of the cost that these columns would remove.
    pub fn gain(&self, columns: &[Vec<f64>]) -> f64 {
        let basis = orthonormal(columns);
        let taken: f64 = basis
            .iter()
            .map(|b| {
                let along: f64 = b.iter().zip(&self.residual).map(|(b, r)| b * r).sum();
                along * along
            })
            .sum();
        taken / self.cost().max(1e-300)
    }

    /// Columns of a sham: the same columns, cyclically shifted in time within every segment by `thousandths` of its
    /// length.
    pub fn shifted(&self, columns: &[Vec<f64>], thousandths: usize) -> Vec<Vec<f64>> {
        columns
            .iter()
            .map(|c| {
                let mut out = Vec::with_capacity(c.len());
                for (i, (_, from)) in self.parts.iter().enumerate() {
                    let to = self.parts.get(i + 1).map_or(c.len(), |(_, from)| *from);
                    let part = &c[*from..to];
                    let shift = (part.len() * thousandths / 1000).max(1) % part.len().max(1);
                    out.extend(part[shift..].iter().chain(&part[..shift]));
                }
                self.projected(&out)
            })
            .collect()
    }
}

/// Directions of a segment's local parameters.
pub(super) fn local_basis(problem: &Problem, point: &Point, part: usize) -> Vec<Vec<f64>> {
    let locals = &point.locals[part];
    let base = problem.residuals(part, &point.globals, locals);
    let columns: Vec<Vec<f64>> = (0..locals.len())
        .map(|l| {
            let mut moved = locals.clone();
            let d = problem.local_difference(l, moved[l]);
            moved[l] += d;
            let r = problem.residuals(part, &point.globals, &moved);
            r.iter().zip(&base).map(|(a, b)| (a - b) / d).collect()
        })
        .collect();
    orthonormal(&columns)
}

/// Residuals of all fitted segments with a hypothesis at the given values, minus those without it; all other parameters
/// fixed.
fn residual_change(
    problem: &Problem,
    base: &LinearisedBase,
    point: &Point,
    h: &Hypothesis,
    values: &[f64],
) -> Vec<f64> {
    residual_change_from(&base.raw, problem, base, point, h, values)
}

/// As [`residual_change`], from residuals `alone` without the hypothesis.
fn residual_change_from(
    alone: &[f64],
    problem: &Problem,
    base: &LinearisedBase,
    point: &Point,
    h: &Hypothesis,
    values: &[f64],
) -> Vec<f64> {
    let mut with = problem.clone();
    let mut name = h.name.clone();
    while with.machine.placed.iter().any(|p| p.path == format!("effects.{}.{name}", h.effect.name)) {
        name.push('+');
    }
    (with.machine, _) = problem.machine.with_effect(h.effect, &name, h.target, values);
    let mut out = Vec::new();
    for (k, from) in &base.parts {
        let now = with.residuals(*k, &point.globals, &point.locals[*k]);
        // A run that failed shows nothing of a small effect.
        let failed = now.iter().all(|r| *r == DIVERGED_RESIDUAL);
        let change = |(a, b): (&f64, &f64)| if failed { f64::NAN } else { a - b };
        out.extend(now.iter().zip(&alone[*from..]).map(change));
    }
    out
}

/// Screens a hypothesis at this fit.
pub fn screen(problem: &Problem, base: &LinearisedBase, fit: &Fit, h: &Hypothesis) -> ScreeningResult {
    let records = problem.data.records.len();
    let mut probe = h.values.clone();
    let amplitudes = h.amplitudes();
    for i in &amplitudes {
        probe[*i] = h.rows[*i].off * h.rows[*i].unit;
    }
    let none = ScreeningResult::unseen(h, records);
    if amplitudes.is_empty() || amplitudes.iter().any(|i| h.rows[*i].off != 0.0) {
        return screen_by_trial(problem, base, &fit.point, h).unwrap_or_else(|| {
            let idle = residual_change(problem, base, &fit.point, h, &h.values).iter().all(|x| *x == 0.0);
            ScreeningResult { idle: idle && idle_when_reversed(problem, base, &fit.point, h), ..none }
        });
    }
    // A wave is the sum of two whose phases are known: where it has a phase, no place on the loop is looked for.
    let at_start = problem.machine.shows_at_start_alone(h.effect);
    if at_start && h.phase().is_none() {
        return screen_on_loop(problem, base, fit, h).unwrap_or(none);
    }
    // Runs of a drive with links lie on a grid.
    let grid =
        at_start.then(|| Point { globals: problem.snapped(&fit.point.globals), locals: fit.point.locals.clone() });
    let point = grid.as_ref().unwrap_or(&fit.point);
    let alone: Option<Vec<f64>> = grid.as_ref().map(|point| {
        let of = |(k, _): &(usize, usize)| problem.residuals(*k, &point.globals, &point.locals[*k]);
        base.parts.iter().flat_map(of).collect()
    });
    let alone = alone.as_ref().unwrap_or(&base.raw);
    let mut columns = Vec::new();
    // Meaning of each column: amplitude, record of its phase, cosine or sine.
    let mut meaning = Vec::new();
    for i in amplitudes {
        let size = if at_start { h.values[i] } else { PROBE * h.values[i] };
        let angles: &[f64] = if h.phase().is_some() { &[0.0, std::f64::consts::FRAC_PI_2] } else { &[0.0] };
        for angle in angles {
            let mut values = probe.clone();
            values[i] = size;
            if let Some(p) = h.phase() {
                values[p] = *angle;
            }
            let column: Vec<f64> =
                residual_change_from(alone, problem, base, point, h, &values).iter().map(|d| d / size).collect();
            if column.iter().any(|x| !x.is_finite()) {
                return none;
            }
            if h.phase().is_none() {
                columns.push(base.projected(&column));
                meaning.push((i, 0, 0));
                continue;
            }
            for record in 0..records {
                let mut own = vec![0.0; column.len()];
                for (at, (k, from)) in base.parts.iter().enumerate() {
                    let to = base.parts.get(at + 1).map_or(column.len(), |(_, from)| *from);
                    if problem.data.segments[*k].record == record {
                        own[*from..to].copy_from_slice(&column[*from..to]);
                    }
                }
                if own.iter().any(|x| *x != 0.0) {
                    columns.push(base.projected(&own));
                    meaning.push((i, record, usize::from(*angle > 0.0)));
                }
            }
        }
    }
    let Some(x) = least_squares(&columns, &base.residual) else { return none };
    let mut values = probe;
    let mut phases = vec![0.0; records];
    if h.phase().is_some() {
        // a sin(n q + phase) = a cos(phase) sin(n q) + a sin(phase) cos(n q)
        let mut pairs = vec![[0.0; 2]; records];
        for ((_, record, part), x) in meaning.iter().zip(&x) {
            pairs[*record][*part] = -x;
        }
        let sizes: Vec<f64> = pairs.iter().map(|[a, b]| libm::sqrt(a * a + b * b)).filter(|s| *s > 0.0).collect();
        let mean = sizes.iter().sum::<f64>() / sizes.len().max(1) as f64;
        values[meaning[0].0] = mean;
        phases = pairs.iter().map(|[a, b]| crate::units::atan2(*b, *a)).collect();
    } else {
        for ((i, ..), x) in meaning.iter().zip(&x) {
            values[*i] = -x;
        }
    }
    let mut gain = base.gain(&columns);
    for (i, row) in h.rows.iter().enumerate() {
        let (low, high) = (row.low * row.unit, row.high * row.unit);
        if row.kind.is_amplitude() && (values[i] < low || values[i] > high) {
            // The sign is wrong or the value exceeds its range: the fit starts from a small value.
            gain *= if values[i] < low { WRONG_SIGN } else { TOO_LARGE };
            values[i] = within(SMALL * h.values[i], low, high);
        }
    }
    ScreeningResult { gain, fit_start: FitStart { values, phases, travels: Vec::new() }, columns, idle: false }
}

/// Multiples of a shape's starting value that are tried.
const TRIED_FACTORS: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

/// Screens a hypothesis that is not linear at small values (a limit, a preload, a resonance): tries several values of
/// its first amplitude or shape and projects the residuals on the resulting change. None if it has no such parameter,
/// or changes nothing.
fn screen_by_trial(problem: &Problem, base: &LinearisedBase, point: &Point, h: &Hypothesis) -> Option<ScreeningResult> {
    let form = h.rows.iter().position(|r| matches!(r.kind, Kind::Amplitude | Kind::Shape))?;
    let row = h.rows[form];
    let mut best: Option<ScreeningResult> = None;
    for factor in TRIED_FACTORS {
        let mut values = h.values.clone();
        values[form] = within(factor * h.values[form], row.low * row.unit, row.high * row.unit);
        let change = residual_change(problem, base, point, h, &values);
        if change.iter().any(|x| !x.is_finite()) || change.iter().all(|x| *x == 0.0) {
            continue;
        }
        let column = base.projected(&change);
        let (along, _) = dot_and_size(&base.residual, &column);
        let gain = if along < 0.0 { base.gain(std::slice::from_ref(&column)) } else { 0.0 };
        if best.as_ref().is_none_or(|b| gain > b.gain) {
            let fit_start = FitStart { values, phases: vec![0.0; problem.data.records.len()], travels: Vec::new() };
            best = Some(ScreeningResult { gain, fit_start, columns: vec![column], idle: false });
        }
    }
    best
}

/// Whether an effect on a sensor also changes nothing when all segments start with reversed motion.
fn idle_when_reversed(problem: &Problem, base: &LinearisedBase, point: &Point, h: &Hypothesis) -> bool {
    if !crate::drive::sensors::is_signal(h.effect) {
        return true;
    }
    let mut with = problem.clone();
    (with.machine, _) = problem.machine.with_effect(h.effect, &h.name, h.target, &h.values);
    base.parts.iter().all(|(k, _)| {
        let turned = problem.reversed_locals(*k, &point.locals[*k], true);
        let shows = |of: &Problem, locals: &[f64]| of.residuals(*k, &point.globals, locals);
        turned.is_none_or(|locals| shows(&with, &locals) == shows(problem, &locals))
    })
}

/// Screens a hypothesis in a motion with a period, as of links, joints, teeth or guides: its amplitude, and for every segment the best place on the
/// loop, from one run for each operating point.
fn screen_on_loop(problem: &Problem, base: &LinearisedBase, fit: &Fit, h: &Hypothesis) -> Option<ScreeningResult> {
    let amplitude = *h.amplitudes().first()?;
    let mut with = problem.clone();
    (with.machine, _) = problem.machine.with_effect(h.effect, &h.name, h.target, &h.values);
    let period = with.machine.period_pitches()?;
    let (places, apart) = (if h.has_place { period.places() } else { 1 }, f64::from(period.alike));
    let travel = problem.locals.iter().position(|l| *l == Local::Travel)?;
    // For every segment and place: product with the residual, and square.
    let mut sizes: Vec<Vec<(f64, f64)>> = Vec::new();
    let globals = problem.snapped(&fit.point.globals);
    let alone: Vec<Vec<f64>> =
        base.parts.iter().map(|(k, _)| problem.residuals(*k, &globals, &fit.point.locals[*k])).collect();
    let column = |at: usize, moved_on: f64| -> Vec<f64> {
        let k = base.parts[at].0;
        let mut locals = fit.point.locals[k].clone();
        locals[travel] += moved_on;
        let now = with.residuals(k, &globals, &locals);
        let moved: Vec<f64> = now.iter().zip(&alone[at]).map(|(a, b)| a - b).collect();
        project_out(&moved, &base.local_bases[at])
    };
    let size_of = |at: usize, c: &[f64]| {
        let from = base.parts[at].1;
        dot_and_size(&base.residual[from..from + c.len()], c)
    };
    for at in 0..base.parts.len() {
        let all: Vec<(f64, f64)> =
            (0..places).map(|place| size_of(at, &column(at, apart * f64::from(place)))).collect();
        if all.iter().any(|(a, b)| !a.is_finite() || !b.is_finite()) {
            return None;
        }
        sizes.push(all);
    }
    let row = h.rows[amplitude];
    let (low, high) = multiples(h, amplitude, problem.machine.size_range(h.effect, h.target, row));
    // Share of the cost that factor x removes at place p of a segment: -(2 x along + x^2 size).
    let takes = |x: f64, (along, size): (f64, f64)| -(2.0 * x * along + x * x * size);
    let mut best: Option<(f64, f64, Vec<u32>)> = None;
    for sign in [1.0, -1.0] {
        let mut chosen: Vec<u32> =
            sizes.iter().map(|all| largest(all, |s| -sign * s.0 / libm::sqrt(s.1.max(1e-300)))).collect();
        let mut x = 0.0;
        for _ in 0..6 {
            let picked = || sizes.iter().zip(&chosen).map(|(all, p)| all[*p as usize]);
            let size: f64 = picked().map(|s| s.1).sum();
            let best = -picked().map(|s| s.0).sum::<f64>() / size.max(1e-300);
            x = within(best, low, high);
            let next: Vec<u32> = sizes.iter().map(|all| largest(all, |s| takes(x, s))).collect();
            if next == chosen {
                break;
            }
            chosen = next;
        }
        let gain: f64 = sizes.iter().zip(&chosen).map(|(all, p)| takes(x, all[*p as usize])).sum();
        if best.as_ref().is_none_or(|(g, ..)| gain > *g) {
            best = Some((gain, x, chosen));
        }
    }
    let (_, sign, chosen) = best?;
    let sign = if sign < 0.0 { -1.0 } else { 1.0 };
    // The effect may also shift the drive slightly forwards or backwards, further than a gradient reaches where impacts
    // are sharp. The declared drive is shifted too, so that the comparison contains the effect alone.
    let mut travels: Vec<f64> = fit.point.locals.iter().map(|l| l[travel]).collect();
    let (mut whole, mut rests) = (Vec::with_capacity(base.residual.len()), Vec::with_capacity(base.residual.len()));
    for (at, place) in chosen.iter().enumerate() {
        let k = base.parts[at].0;
        let tried = (-20..=20).map(|i| {
            let mut locals = fit.point.locals[k].clone();
            locals[travel] += FINE_PITCHES * f64::from(i);
            let rest = problem.residuals(k, &globals, &locals);
            locals[travel] += apart * f64::from(*place);
            let now = with.residuals(k, &globals, &locals);
            let change: Vec<f64> = now.iter().zip(&rest).map(|(a, b)| a - b).collect();
            let (change, rest) =
                (project_out(&change, &base.local_bases[at]), project_out(&rest, &base.local_bases[at]));
            let (along, size) = dot_and_size(&rest, &change);
            let taken = if along * sign < 0.0 { along * along / f64::max(size, 1e-300) } else { 0.0 };
            let left = rest.iter().map(|r| r * r).sum::<f64>() - taken;
            (left, locals[travel], change, rest)
        });
        let (_, moved_to, change, rest) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
        whole.extend(change);
        rests.extend(rest);
        travels[k] = moved_to;
    }
    let columns = vec![project_out(&whole, &base.basis)];
    let rests = project_out(&rests, &base.basis);
    let (along, size) = dot_and_size(&rests, &columns[0]);
    let x = within(-along / f64::max(size, 1e-300), low, high);
    let mut values = h.values.clone();
    values[amplitude] = x * h.values[amplitude];
    if values[amplitude] == 0.0 {
        values[amplitude] = SMALL * h.values[amplitude];
    }
    let left = rests.iter().map(|r| r * r).sum::<f64>() + 2.0 * x * along + x * x * size;
    let gain = (1.0 - left / f64::max(base.cost(), 1e-300)).max(0.0);
    let phases = vec![0.0; problem.data.records.len()];
    Some(ScreeningResult { gain, fit_start: FitStart { values, phases, travels }, columns, idle: false })
}

/// Range of an amplitude, in its key's unit, in multiples of its starting value, which may be negative; at most a million.
fn multiples(h: &Hypothesis, amplitude: usize, (low, high): (f64, f64)) -> (f64, f64) {
    let ends = [low, high].map(|end| end * h.rows[amplitude].unit / h.values[amplitude]);
    (ends[0].min(ends[1]).max(-1e6), ends[0].max(ends[1]).min(1e6))
}

/// Product of two columns, and the square of the second.
fn dot_and_size(rest: &[f64], change: &[f64]) -> (f64, f64) {
    rest.iter().zip(change).fold((0.0, 0.0), |(along, size), (r, c)| (along + r * c, size + c * c))
}

/// Index of the largest value.
fn largest(all: &[(f64, f64)], of: impl Fn((f64, f64)) -> f64) -> u32 {
    let mut best = 0;
    for i in 1..all.len() {
        if of(all[i]) > of(all[best]) {
            best = i;
        }
    }
    best as u32
}

/// The least-squares solution of columns x = right.
fn least_squares(columns: &[Vec<f64>], right: &[f64]) -> Option<Vec<f64>> {
    let n = columns.len();
    let sizes: Vec<f64> = columns.iter().map(|c| libm::sqrt(c.iter().map(|x| x * x).sum::<f64>())).collect();
    if sizes.iter().all(|s| *s <= 0.0) {
        return None;
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let scale = |i: usize| if sizes[i] > 0.0 { sizes[i] } else { 1.0 };
    let mut a = DMatrix::zeros(n, n);
    let mut b = DVector::zeros(n);
    for i in 0..n {
        b[i] = dot(&columns[i], right) / scale(i);
        for j in 0..n {
            a[(i, j)] = dot(&columns[i], &columns[j]) / (scale(i) * scale(j));
        }
        a[(i, i)] += RIDGE;
    }
    let x = a.full_piv_lu().solve(&b)?;
    Some((0..n).map(|i| x[i] / scale(i)).collect())
}
