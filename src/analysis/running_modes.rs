//! Modes of a drive that runs: how small disturbances of its motion die away.
//!
//! A run is copied. The copy gets a kick of very little energy, and both go on. The difference between the two is the response of the drive, linearised about
//! the motion that it has: with slack strands, sliding friction, impacts, oil that flows, and links that travel through the spans. Each coordinate that is free
//! and each span (across) is kicked in turn, at several instants of the driver's turns; the mean over these instants is fitted by decaying swings.
//! ```text
//! y(t) = mean over kicks of (copy - run) = sum over modes of r exp(-d t) cos(w t + b)
//! f = sqrt(d^2 + w^2) / (2 pi),   zeta = d / sqrt(d^2 + w^2)
//! ```
//! Source: poles by [`super::realisation`]. Standard errors are those of leaving out the kicks of one instant after the other (jackknife).
//!
//! Where the drive changes periodically, with a cycle of frequency W, the mean holds every mode at w + n W too, with the same d and other shapes: its side bands
//! (Wereley, PhD thesis MIT (1991), chapter 3). Rows that may be such are marked; at another speed a side band moves with W, a mode does not.

use super::decay::{LowPass, PASSED};
use super::mode_shapes::{LinkPlaces, MovingPart};
use super::realisation::{ImpulseResponses, StablePole, residues, stable_poles};
use crate::geometry::{Vec2, perp};
use crate::integrate::explicit::Scratch;
use crate::integrate::{StepError, scheme};
use crate::model::Model;
use crate::side_by_side::parallel;
use crate::state::State;
use crate::statics::Configuration;
use nalgebra::DMatrix;
use std::f64::consts::PI;

/// How a running drive is kicked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KickPlan {
    /// Time after assembly before the first kick [s].
    pub settle_s: f64,
    /// Length of every response [s].
    pub listen_s: f64,
    /// Instants, spread over two turns of the driver. One where it stands still.
    pub instants: usize,
    /// Highest frequency of modes [Hz].
    pub highest_hz: f64,
    pub threads: usize,
}

/// A mode of a running drive.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RunningMode {
    pub frequency_hz: f64,
    pub damping_ratio: f64,
    /// Standard errors; none where the mode is not found when the kicks of an instant are left out, or there is one instant alone.
    pub frequency_error_hz: Option<f64>,
    pub damping_ratio_error: Option<f64>,
    /// In how many orders of the fit it stands.
    pub orders: usize,
    /// Its square over that of the mean responses behind the filter; shares of modes that are not orthogonal do not sum to one.
    pub share: f64,
    /// Frequency of a mode with a larger share from which it lies as far as a multiple of the cycle's frequency, with the same decay [Hz].
    pub side_band_of_hz: Option<f64>,
    /// What moves, by kinetic energy, after the kick that shows it most.
    pub moves: Vec<MovingPart>,
}

/// Modes of a running drive, and how far to believe them.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RunningModes {
    pub modes: Vec<RunningMode>,
    /// Orders of the fit.
    pub orders: usize,
    /// Share of the square of the mean responses that no pole explains.
    pub left: f64,
    /// Root mean square of what responses of one instant differ from the mean, over that of the mean: how much the drive changes over its cycle.
    pub varies: f64,
    /// By how much the response of what is kicked first to ten times the speed differs from ten times its response, over it, at the first instant.
    pub nonlinear: f64,
    /// Mean speed of the driver before the first kick, over two turns, and from the first kick to the last [rad/s].
    pub driver_rad_s: [f64; 2],
    /// Frequency of the cycle over which kicks are spread, two turns of the driver [Hz]; zero where it stands still.
    pub cycle_hz: f64,
    /// What was kicked.
    pub kicked: Vec<String>,
    pub instants: usize,
    /// Energy of a kick [J].
    pub kick_j: f64,
}

/// Why there are no modes of the running drive.
#[derive(Clone, Debug, PartialEq)]
pub enum RunningModesError {
    /// Nothing of the drive is free to move.
    NothingMoves,
    /// The responses are too short for these frequencies: how long they must be [s].
    Short(f64),
    /// The poles that are found cannot be told apart.
    Alike,
    /// A run broke down.
    Run(StepError),
}

impl std::fmt::Display for RunningModesError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RunningModesError::NothingMoves => f.write_str("nothing of the drive is free to move"),
            RunningModesError::Short(need_s) => {
                write!(
                    f,
                    "the responses are too short for these frequencies: follow them for {:.0} ms, or look at higher ones",
                    libm::ceil(1e3 * need_s)
                )
            }
            RunningModesError::Alike => f.write_str("the swings of the responses cannot be told apart"),
            RunningModesError::Run(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for RunningModesError {}

/// assumed: moves what weighs a tenth of a kilogram at 15 um/s. Speeds are told to 1e-15 of those of the chain, and contacts of some newtons stay as they are.
const KICK_J: f64 = 1e-11;
/// Factor on the speeds of the kick that shows how linear a response is.
const HARDER: f64 = 10.0;
/// Where across and along a span its motion is looked at, as a share of its length.
const STATIONS: [f64; 3] = [0.25, 0.5, 0.75];
/// Values of a period of the highest frequency before the low-pass filter.
const VALUES_PER_PERIOD: f64 = 64.0;
/// Fewest values behind the filter.
const FEWEST_VALUES: usize = 40;
/// Turns of the driver over which kicks are spread: a cycle of a four-stroke engine.
const TURNS: f64 = 2.0;
/// Kick k is later than even spacing puts it by what k times this has behind the point, in teeth: the golden ratio, so that kicks fall on all phases of
/// meshing.
const TOOTH_SHARE: f64 = 0.618_033_988_749_894_9;
/// Modes with less of the responses are left out. assumed.
const LEAST_SHARE: f64 = 1e-3;
/// A mode of fewer kicks is the same within this distance over its size. assumed.
const SAME_MODE: f64 = 0.15;
/// Responses of one instant that differ less from the mean are those of a steady drive, which has no side bands. assumed.
pub const STEADY: f64 = 0.2;
/// How far a side band may lie from its place, over its frequency, and how far the decays of both may be apart, over one. assumed.
const SIDE_BAND: f64 = 0.02;
const SAME_DECAY: f64 = 0.2;

/// A span as the frame of the drive sees it: fixed, its links pass through.
struct SpanLine {
    name: String,
    from: Vec2,
    along: Vec2,
    length_m: f64,
    mass_kg: f64,
    /// Its links when it was looked at, in the order of the chain, and all links of its chain.
    lanes: Vec<usize>,
    chain: std::ops::Range<usize>,
}

/// What is kicked.
enum Kicked {
    Coordinate(usize),
    Across(usize),
}

/// The drive as kicks see it.
struct Rig<'a> {
    model: &'a Model,
    spans: Vec<SpanLine>,
    kicked: Vec<Kicked>,
    /// Coordinates that are looked at.
    free: Vec<usize>,
}

/// Kicks a drive from its assembled state on.
///
/// # Errors
/// See [`RunningModesError`].
pub fn running_modes(model: &Model, state: State, plan: &KickPlan) -> Result<RunningModes, RunningModesError> {
    let step_s = model.step_s;
    let stride = ((1.0 / (VALUES_PER_PERIOD * plan.highest_hz * step_s)) as u64).max(1);
    let interval_s = step_s * stride as f64;
    let filter = LowPass::new(((PASSED / (plan.highest_hz * interval_s)) as usize).max(1), interval_s);
    let raw = (plan.listen_s / interval_s) as usize;
    let needed = FEWEST_VALUES * filter.every + filter.len();
    if raw < needed {
        return Err(RunningModesError::Short(needed as f64 * interval_s));
    }
    let begun = Begun::new(model, state, plan)?;
    let rig = Rig::new(model, &begun.starts[0]);
    if rig.kicked.is_empty() {
        return Err(RunningModesError::NothingMoves);
    }
    let (by_instant, nonlinear) = responses(&rig, &begun.starts, plan.threads, (raw, stride), &filter)?;
    let instants = by_instant.len();
    let all = mean(by_instant.iter());
    let squares = by_instant.iter().map(|own| ratio(&own.values, &all.values).powi(2));
    let varies = libm::sqrt(squares.sum::<f64>() / instants as f64);
    let (poles, orders) = stable_poles(&all, plan.highest_hz);
    let without: Vec<Vec<StablePole>> = if instants > 1 {
        parallel(instants, plan.threads, |k| {
            let others = by_instant.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, own)| own);
            stable_poles(&mean(others), plan.highest_hz * (1.0 + SAME_MODE)).0
        })
    } else {
        Vec::new()
    };
    let found = residues(&all, &poles).ok_or(RunningModesError::Alike)?;
    let errors = errors(&poles, &without);
    let shown = (0..poles.len()).filter(|p| found.shares[*p] >= LEAST_SHARE);
    let modes = shown.map(|p| {
        let pole = &poles[p];
        let stronger = (0..poles.len()).filter(|o| found.shares[*o] > found.shares[p]).map(|o| &poles[o]);
        RunningMode {
            frequency_hz: pole.frequency_hz(),
            damping_ratio: pole.damping_ratio(),
            frequency_error_hz: errors[p].map(|(hz, _)| hz),
            damping_ratio_error: errors[p].map(|(_, zeta)| zeta),
            orders: pole.orders,
            share: found.shares[p],
            side_band_of_hz: if varies > STEADY { side_band_of(pole, stronger, begun.cycle_hz) } else { None },
            moves: rig.parts(&found.sizes[p]),
        }
    });
    Ok(RunningModes {
        modes: modes.collect(),
        orders,
        left: found.left,
        varies,
        nonlinear,
        driver_rad_s: begun.driver_rad_s,
        cycle_hz: begun.cycle_hz,
        kicked: rig.names(),
        instants,
        kick_j: KICK_J,
    })
}

/// A run from its assembled state to the last kick.
struct Begun {
    /// The run at every instant.
    starts: Vec<State>,
    driver_rad_s: [f64; 2],
    cycle_hz: f64,
}

impl Begun {
    fn new(model: &Model, state: State, plan: &KickPlan) -> Result<Begun, RunningModesError> {
        let mut base = state;
        let step_s = model.step_s;
        let mut scratch = Scratch::new(model);
        let mut go = |base: &mut State, count: u64| -> Result<(), RunningModesError> {
            for _ in 0..count {
                scheme::step(model, base, &mut scratch).map_err(RunningModesError::Run)?;
            }
            Ok(())
        };
        // The driver's mean speed over the last two turns before the first kick: orders are left out, a run-up is not.
        let driver = &model.sprockets[model.driver];
        let angle = |state: &State| state.coordinates.angle[driver.coordinate];
        let settling = (plan.settle_s / step_s) as u64;
        let two_turns = (TURNS * periods(model, driver.nominal_speed_rad_s).0 / step_s) as u64;
        let looked_at = two_turns.min(settling);
        go(&mut base, settling - looked_at)?;
        let before = angle(&base);
        go(&mut base, looked_at)?;
        let whole_s = looked_at as f64 * step_s;
        let first_rad_s = if looked_at == two_turns && looked_at > 0 {
            (angle(&base) - before) / whole_s
        } else {
            driver.nominal_speed_rad_s
        };
        // A copy of the run for every instant.
        let (turn_s, tooth_s) = periods(model, first_rad_s);
        let instants = if turn_s.is_finite() { plan.instants.max(1) } else { 1 };
        let mut after: Vec<u64> = (1..instants)
            .map(|k| {
                let phase = TOOTH_SHARE * k as f64;
                (TURNS * turn_s * k as f64 / instants as f64 + (phase - libm::floor(phase)) * tooth_s) / step_s
            })
            .map(|steps| steps as u64)
            .collect();
        after.sort_unstable();
        let mut starts = vec![base.clone()];
        let (mut gone, at_first) = (0, angle(&base));
        for steps in after {
            go(&mut base, steps - gone)?;
            gone = steps;
            starts.push(base.clone());
        }
        let kicked_s = gone as f64 * step_s;
        let driver_rad_s = [first_rad_s, if gone > 0 { (angle(&base) - at_first) / kicked_s } else { first_rad_s }];
        let cycle_hz = if turn_s.is_finite() { 1.0 / (TURNS * turn_s) } else { 0.0 };
        Ok(Begun { starts, driver_rad_s, cycle_hz })
    }
}

/// Responses at every instant to kicks of all parts, and by how much one of them is not linear.
fn responses(
    rig: &Rig<'_>,
    starts: &[State],
    threads: usize,
    (raw, stride): (usize, u64),
    filter: &LowPass,
) -> Result<(Vec<ImpulseResponses>, f64), RunningModesError> {
    let instants = starts.len();
    // Every instant's run once a part; parts as many as keep the threads busy.
    let parts = threads.div_ceil(instants).clamp(1, rig.kicked.len());
    let width = rig.kicked.len().div_ceil(parts);
    let jobs: Vec<(usize, std::ops::Range<usize>)> = (0..instants)
        .flat_map(|k| (0..rig.kicked.len()).step_by(width).map(move |from| (k, from)))
        .map(|(k, from)| (k, from..(from + width).min(rig.kicked.len())))
        .collect();
    let kick_m = libm::sqrt(KICK_J);
    let heard = parallel(jobs.len() + 1, threads, |j| match jobs.get(j) {
        Some((k, inputs)) => {
            let kicks: Vec<(usize, f64)> = inputs.clone().map(|i| (i, kick_m)).collect();
            rig.listen(&starts[*k], &kicks, (raw, stride), filter)
        }
        None => rig.listen(&starts[0], &[(0, HARDER * kick_m)], (raw, stride), filter),
    });
    let mut heard = heard.into_iter().collect::<Result<Vec<_>, StepError>>().map_err(RunningModesError::Run)?;
    let harder = heard.pop().unwrap_or_default();
    let step_s = rig.model.step_s * stride as f64 * filter.every as f64;
    let by_instant: Vec<ImpulseResponses> = (0..instants)
        .map(|k| {
            let own: Vec<&Vec<DMatrix<f64>>> =
                jobs.iter().zip(&heard).filter(|((instant, _), _)| *instant == k).map(|(_, h)| h).collect();
            ImpulseResponses { step_s, values: beside(&own) }
        })
        .collect();
    let plain: Vec<DMatrix<f64>> = by_instant[0].values.iter().map(|y| y.columns(0, 1) * HARDER).collect();
    let nonlinear = ratio(&harder, &plain);
    Ok((by_instant, nonlinear))
}

/// The first of stronger poles that a pole may be a side band of [Hz].
fn side_band_of<'a>(pole: &StablePole, stronger: impl Iterator<Item = &'a StablePole>, cycle_hz: f64) -> Option<f64> {
    if cycle_hz <= 0.0 {
        return None;
    }
    let hz = |p: &StablePole| p.rad_s / (2.0 * PI);
    let mut of = stronger.filter(|other| {
        let apart = (hz(pole) - hz(other)).abs() / cycle_hz;
        let whole = libm::round(apart);
        let is_apart = whole >= 1.0 && (apart - whole).abs() * cycle_hz < SIDE_BAND * hz(pole);
        is_apart && (pole.decay_per_s - other.decay_per_s).abs() < SAME_DECAY * other.decay_per_s.abs()
    });
    of.next().map(StablePole::frequency_hz)
}

/// A turn of the driver, and a tooth of it [s]; infinite where it stands still.
fn periods(model: &Model, driver_rad_s: f64) -> (f64, f64) {
    let turn_s = 2.0 * PI / driver_rad_s.abs();
    (turn_s, turn_s / f64::from(model.sprockets[model.driver].geometry.teeth()))
}

/// Responses of several kicks beside each other.
fn beside(parts: &[&Vec<DMatrix<f64>>]) -> Vec<DMatrix<f64>> {
    let Some(first) = parts.first() else { return Vec::new() };
    (0..first.len())
        .map(|k| {
            let columns: Vec<_> = parts.iter().flat_map(|own| own[k].column_iter()).collect();
            DMatrix::from_columns(&columns)
        })
        .collect()
}

fn mean<'a>(all: impl Iterator<Item = &'a ImpulseResponses>) -> ImpulseResponses {
    let all: Vec<&ImpulseResponses> = all.collect();
    let mut sum = all[0].clone();
    for own in &all[1..] {
        sum.values.iter_mut().zip(&own.values).for_each(|(s, v)| *s += v);
    }
    sum.values.iter_mut().for_each(|v| *v /= all.len() as f64);
    sum
}

/// Root mean square of the difference over that of the second.
fn ratio(values: &[DMatrix<f64>], than: &[DMatrix<f64>]) -> f64 {
    let difference: f64 = values.iter().zip(than).map(|(a, b)| (a - b).norm_squared()).sum();
    let size: f64 = than.iter().map(DMatrix::norm_squared).sum();
    libm::sqrt(difference / size)
}

/// Standard errors of the frequency and damping of every pole by leaving out the kicks of one instant after the other. None where a pole is not found
/// again without the kicks of one: poles are paired, the nearest first, each with one, and none beyond half the way to the next pole.
fn errors(poles: &[StablePole], without: &[Vec<StablePole>]) -> Vec<Option<(f64, f64)>> {
    let reach: Vec<f64> = (0..poles.len())
        .map(|p| {
            let others = poles.iter().enumerate().filter(|(o, _)| *o != p);
            others.map(|(_, other)| 0.5 * poles[p].distance(other)).fold(SAME_MODE, f64::min)
        })
        .collect();
    let mut found: Vec<Vec<StablePole>> = vec![Vec::new(); poles.len()];
    for others in without {
        let mut pairs: Vec<(usize, usize, f64)> = (0..poles.len())
            .flat_map(|p| (0..others.len()).map(move |o| (p, o)))
            .map(|(p, o)| (p, o, poles[p].distance(&others[o])))
            .filter(|(p, _, distance)| *distance < reach[*p])
            .collect();
        pairs.sort_by(|a, b| a.2.total_cmp(&b.2));
        let (mut taken_poles, mut taken) = (vec![false; poles.len()], vec![false; others.len()]);
        for (p, o, _) in pairs {
            if !taken_poles[p] && !taken[o] {
                (taken_poles[p], taken[o]) = (true, true);
                found[p].push(others[o]);
            }
        }
    }
    let spread = |found: &Vec<StablePole>, of: fn(&StablePole) -> f64| {
        let n = found.len() as f64;
        let middle = found.iter().map(of).sum::<f64>() / n;
        libm::sqrt((n - 1.0) / n * found.iter().map(|p| (of(p) - middle).powi(2)).sum::<f64>())
    };
    let is_whole = |own: &Vec<StablePole>| own.len() > 1 && own.len() == without.len();
    found
        .iter()
        .map(|own| {
            is_whole(own).then(|| (spread(own, StablePole::frequency_hz), spread(own, StablePole::damping_ratio)))
        })
        .collect()
}

impl<'a> Rig<'a> {
    fn new(model: &'a Model, at: &State) -> Rig<'a> {
        let l = &at.links;
        let links =
            (0..model.chain.lanes).map(|i| (Vec2::new(l.x[i], l.y[i]), libm::atan2(l.sin[i], l.cos[i]))).collect();
        let configuration = Configuration { links, coordinates: at.coordinates.angle.clone() };
        let chain_of = |lane: usize| model.chain.loops.iter().find(|l| l.contains(&lane)).cloned();
        let spans: Vec<SpanLine> = LinkPlaces::new(model, &configuration)
            .spans(model)
            .into_iter()
            .filter_map(|(name, lanes)| {
                let place = |lane: &usize| configuration.links[*lane].0;
                let (from, to) = (place(lanes.first()?), place(lanes.last()?));
                let length_m = (to - from).norm();
                Some(SpanLine {
                    name,
                    from,
                    along: (to - from) / length_m,
                    length_m,
                    mass_kg: lanes.iter().map(|lane| model.chain.mass[*lane]).sum(),
                    chain: chain_of(lanes[0])?,
                    lanes,
                })
            })
            .collect();
        let free: Vec<usize> = (0..model.coordinates.len())
            .filter(|k| model.coordinates[*k].is_free() && !model.coordinates[*k].is_held_at_rest)
            .collect();
        // Valves ride on their cams: what they do shows on the shaft.
        let coordinates = free.iter().filter(|k| !model.coordinates[**k].path.starts_with("valves."));
        let kicked = coordinates.map(|k| Kicked::Coordinate(*k)).chain((0..spans.len()).map(Kicked::Across)).collect();
        Rig { model, spans, kicked, free }
    }

    fn names(&self) -> Vec<String> {
        let name = |own: &Kicked| match own {
            Kicked::Coordinate(k) => self.model.coordinates[*k].path.clone(),
            Kicked::Across(s) => format!("span {} across", self.spans[*s].name),
        };
        self.kicked.iter().map(name).collect()
    }

    /// Gives a copy of a run speeds whose energy is `size` squared [J].
    fn kick(&self, state: &mut State, own: &Kicked, size: f64) {
        match own {
            Kicked::Coordinate(k) => {
                state.coordinates.omega[*k] += size * libm::sqrt(2.0 * self.model.coordinates[*k].inverse_inertia());
            }
            Kicked::Across(s) => {
                let span = &self.spans[*s];
                let across = perp(span.along);
                // Half a wave over the links: half of the mass moves.
                let speed = size * libm::sqrt(4.0 / span.mass_kg);
                // The links of this instant: those of the first kick have gone on.
                let along = |lane: usize| (self.place(state, lane) - span.from).dot(&span.along) / span.length_m;
                let within: Vec<(usize, f64)> = self
                    .near(span, state)
                    .map(|lane| (lane, along(lane)))
                    .filter(|(_, share)| (0.0..=1.0).contains(share))
                    .collect();
                for (lane, share) in within {
                    let v = across * (speed * libm::sin(PI * share));
                    state.links.vx[lane] += v.x;
                    state.links.vy[lane] += v.y;
                }
            }
        }
    }

    fn place(&self, state: &State, lane: usize) -> Vec2 {
        Vec2::new(state.links.x[lane], state.links.y[lane])
    }

    /// Links of a span's chain that lie nearer to its line than a quarter of its length, which those of other spans do not.
    fn near<'b>(&self, span: &'b SpanLine, state: &'b State) -> impl Iterator<Item = usize> + 'b {
        let across = perp(span.along);
        let reach_m = 0.25 * span.length_m;
        span.chain.clone().filter(move |lane| {
            let d = Vec2::new(state.links.x[*lane], state.links.y[*lane]) - span.from;
            d.dot(&across).abs() < reach_m
                && state.links.cos[*lane] * span.along.x + state.links.sin[*lane] * span.along.y > 0.0
        })
    }

    /// What is looked at of a copy, less the same of the run: speeds times the roots of what moves with them.
    fn difference(&self, run: &State, copy: &State, stations: &[(usize, [(usize, f64); 2])]) -> Vec<f64> {
        let of_coordinates = self.free.iter().map(|k| {
            (copy.coordinates.omega[*k] - run.coordinates.omega[*k])
                / libm::sqrt(self.model.coordinates[*k].inverse_inertia())
        });
        let mut all: Vec<f64> = of_coordinates.collect();
        for (s, weights) in stations {
            let span = &self.spans[*s];
            let mut v = Vec2::zeros();
            for (lane, weight) in weights {
                v.x += weight * (copy.links.vx[*lane] - run.links.vx[*lane]);
                v.y += weight * (copy.links.vy[*lane] - run.links.vy[*lane]);
            }
            let root = libm::sqrt(span.mass_kg / STATIONS.len() as f64);
            all.extend([root * v.dot(&span.along), root * v.dot(&perp(span.along))]);
        }
        all
    }

    /// For every station of every span, the two links between whose centres it lies, with their weights.
    fn stations(&self, state: &State) -> Vec<(usize, [(usize, f64); 2])> {
        let mut all = Vec::new();
        for (s, span) in self.spans.iter().enumerate() {
            let links: Vec<(usize, f64)> = self
                .near(span, state)
                .map(|lane| (lane, (self.place(state, lane) - span.from).dot(&span.along) / span.length_m))
                .collect();
            for at in STATIONS {
                let behind = links.iter().filter(|(_, x)| *x <= at).max_by(|a, b| a.1.total_cmp(&b.1));
                let ahead = links.iter().filter(|(_, x)| *x > at).min_by(|a, b| a.1.total_cmp(&b.1));
                let weights = match (behind, ahead) {
                    (Some((b, xb)), Some((a, xa))) => {
                        let share = (at - xb) / (xa - xb);
                        [(*b, 1.0 - share), (*a, share)]
                    }
                    // The chain has left its span: nothing is seen there.
                    (Some((lane, _)), None) | (None, Some((lane, _))) => [(*lane, 0.0); 2],
                    (None, None) => [(span.lanes[0], 0.0); 2],
                };
                all.push((s, weights));
            }
        }
        all
    }

    /// Responses to kicks at an instant, behind the filter: outputs by kicks.
    fn listen(
        &self,
        start: &State,
        kicks: &[(usize, f64)],
        (raw, stride): (usize, u64),
        filter: &LowPass,
    ) -> Result<Vec<DMatrix<f64>>, StepError> {
        let model = self.model;
        let mut run = (start.clone(), Scratch::new(model));
        let mut copies: Vec<(State, Scratch)> = kicks
            .iter()
            .map(|(i, size)| {
                let mut copy = start.clone();
                self.kick(&mut copy, &self.kicked[*i], *size);
                (copy, Scratch::new(model))
            })
            .collect();
        let mut rows: Vec<Vec<Vec<f64>>> = vec![Vec::with_capacity(raw); kicks.len()];
        for _ in 0..raw {
            for (state, scratch) in std::iter::once(&mut run).chain(&mut copies) {
                for _ in 0..stride {
                    scheme::step(model, state, scratch)?;
                }
            }
            let stations = self.stations(&run.0);
            for (row, (copy, _)) in rows.iter_mut().zip(&copies) {
                row.push(self.difference(&run.0, copy, &stations));
            }
        }
        let outputs = self.free.len() + 2 * STATIONS.len() * self.spans.len();
        let thinned: Vec<Vec<Vec<f64>>> = rows
            .iter()
            .map(|row| (0..outputs).map(|o| filter.thinned(&row.iter().map(|r| r[o]).collect::<Vec<f64>>())).collect())
            .collect();
        let values = thinned.first().and_then(|row| row.first()).map_or(0, Vec::len);
        Ok((0..values).map(|k| DMatrix::from_fn(outputs, kicks.len(), |o, i| thinned[i][o][k])).collect())
    }

    /// Shares of the kinetic energy in a mode, the largest first, after the kick that shows it most.
    fn parts(&self, sizes: &DMatrix<f64>) -> Vec<MovingPart> {
        let columns = sizes.column_iter().max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
        let Some(own) = columns else { return Vec::new() };
        let whole = own.norm_squared();
        let mut parts: Vec<MovingPart> = Vec::new();
        let mut add = |part: String, share: f64| match parts.iter_mut().find(|p| p.part == part) {
            Some(p) => p.share += share,
            None => parts.push(MovingPart { part, share }),
        };
        for (row, k) in self.free.iter().enumerate() {
            add(self.model.coordinates[*k].path.clone(), own[row] * own[row] / whole);
        }
        for (j, square) in own.iter().skip(self.free.len()).map(|v| v * v / whole).enumerate() {
            let span = &self.spans[j / (2 * STATIONS.len())];
            add(format!("span {} {}", span.name, if j % 2 == 0 { "along" } else { "across" }), square);
        }
        parts.sort_by(|a, b| b.share.total_cmp(&a.share));
        parts
    }
}
