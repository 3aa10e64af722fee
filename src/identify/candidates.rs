//! Candidate hypotheses: every effect at every possible place, with starting values of a suitable size.

use super::fit::cost_at;
use super::problem::{Global, Law, Local, Point, Problem};
use super::screen::FitStart;
use crate::effects::{EFFECTS, Effect, Kind, Parameter, Part, Physics, Scale, Twin, sign_blind};
use crate::machine::fidelity::RoomForEffect;
use crate::machine::simulate::Samples;
use crate::machine::{Machine, Reads, Sensor, Target};
use crate::measurement::CandidateSpec;
use crate::measurement::segments::{Data, RecordSegment};
use crate::units::within;

/// One hypothesis: an effect at one place, with chosen starting shapes and integers.
#[derive(Clone, Debug, PartialEq)]
pub struct Hypothesis {
    pub effect: &'static Effect,
    pub name: String,
    pub target: Target,
    /// Starting values of all parameters, SI; amplitudes equal their scale.
    pub values: Vec<f64>,
    /// Rows of the parameters.
    pub rows: Vec<&'static Parameter>,
    /// Scale of every parameter, SI.
    pub scales: Vec<f64>,
    /// Whether each record also determines the place of the effect.
    pub has_place: bool,
    /// Number of parameters that each segment has for this effect: its internal state at the start, and the initial
    /// state of an added body. For pulse data, whose segments are many and short, an added body starts in the state of
    /// the body it is attached to.
    pub own_locals: usize,
}

impl Hypothesis {
    /// The path of the effect. Two hypotheses of the same cause share it.
    pub fn path(&self) -> String {
        format!("effects.{}.{}", self.effect.name, self.name)
    }

    /// The path with the integer parameters, which distinguish harmonics.
    pub fn identity(&self) -> String {
        let mut id = self.path();
        for (row, value) in self.rows.iter().zip(&self.values) {
            if row.kind == Kind::Whole && row.key != "blind" {
                id += &format!(" {} {}", row.key, value);
            }
        }
        id
    }

    /// Indices of the amplitude parameters.
    pub fn amplitudes(&self) -> Vec<usize> {
        (0..self.rows.len()).filter(|i| self.rows[*i].kind.is_amplitude()).collect()
    }

    pub fn phase(&self) -> Option<usize> {
        self.rows.iter().position(|r| r.kind == Kind::Phase)
    }

    /// Number of additional parameters in a fit, for the given number of records and segments.
    pub fn freedom(&self, records: usize, parts: usize) -> usize {
        let places = if self.has_place { records } else { 0 };
        let numbers: usize = self
            .rows
            .iter()
            .map(|r| match r.kind {
                Kind::Amplitude | Kind::Shape | Kind::PerMark => 1,
                Kind::Phase => records,
                Kind::Whole | Kind::Index | Kind::Start | Kind::Given | Kind::Tried => 0,
            })
            .sum();
        numbers + places + parts * self.own_locals
    }
}

/// Typical sizes of quantities in the declared model and the records.
#[derive(Clone, Debug)]
pub struct Sizes {
    force: Vec<f64>,
    speed: Vec<f64>,
    tension: Vec<f64>,
    signal: Vec<f64>,
    input: Vec<f64>,
    sample_s: f64,
    /// Middle angular frequency of the samples [rad/s].
    rate: f64,
    length_s: f64,
    /// Orders of every body that stand out of what is left, to be tried beside those of the catalogue.
    pub orders: Vec<Vec<f64>>,
}

fn rms(values: &[f64]) -> f64 {
    libm::sqrt(values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64)
}

impl Sizes {
    /// Runs the fitted model once and reads the sizes from it.
    pub fn new(problem: &Problem, point: &Point) -> Sizes {
        let m = &problem.machine;
        let data = problem.data;
        if let Some(speeds) = m.mean_speeds(&m.values) {
            return Sizes::of_steady_motion(problem, &speeds);
        }
        let mut all = m.clone();
        all.sensors.clear();
        let mut add = |reads: Reads| {
            all.slots.push(crate::machine::Slot { path: String::new(), unit: 1.0, low: 1.0, high: 1.0 });
            all.values.push(1.0);
            let gain = all.values.len() - 1;
            all.sensors.push(Sensor { name: String::new(), path: String::new(), reads, gain, unit: None });
        };
        (0..m.bodies.len()).for_each(|b| add(Reads::Speed(b)));
        (0..m.springs.len()).for_each(|s| add(Reads::Tension(s)));
        all.placed.retain(|p| !matches!(p.target, Target::Sensor(_)));
        let n = m.bodies.len();
        let (mut force, mut speed) = (vec![0.0_f64; n], vec![0.0_f64; n]);
        let mut tension = vec![0.0_f64; m.springs.len()];
        let (mut sample_s, mut length_s) = (f64::MAX, 0.0_f64);
        let channels: Vec<usize> = (0..all.sensors.len()).collect();
        let mut probe = problem.clone();
        // Its sensors are not those that were measured.
        probe.correction = 0.0;
        probe.machine = all;
        for (k, s) in data.segments.iter().enumerate() {
            let inertia = |b: usize| m.bodies[b].inertia.map_or(1.0, |slot| m.values[slot]);
            match &s.task.samples {
                Samples::Times { step_s, t_s, .. } => {
                    sample_s = sample_s.min(*step_s);
                    length_s = length_s.max(t_s.last().copied().unwrap_or(0.0));
                    probe.channels.clone_from(&channels);
                    let Ok(series) = probe.model(k, &point.globals, &point.locals[k], false) else { continue };
                    for b in 0..n {
                        speed[b] = speed[b].max(rms(&series[b]));
                        let slopes: Vec<f64> = series[b].windows(2).map(|w| (w[1] - w[0]) / step_s).collect();
                        force[b] = force[b].max(inertia(b) * rms(&slopes));
                    }
                    for (t, series) in tension.iter_mut().zip(&series[n..]) {
                        *t = t.max(rms(series));
                    }
                }
                Samples::Pulses { interval_s, .. } => {
                    sample_s = sample_s.min(*interval_s);
                    let known: Vec<f64> = s.measured[0].iter().copied().filter(|v| v.is_finite()).collect();
                    let total: f64 = known.iter().map(|v| libm::exp(*v)).sum();
                    length_s = length_s.max(total);
                    let (Some(first), Some(last)) = (known.first(), known.last()) else { continue };
                    for b in 0..n {
                        // A body that an effect adds starts in the state of its host, so that it adds no information.
                        let Some(v) = s.start.v.get(b).copied() else { continue };
                        speed[b] = speed[b].max(v);
                        let slope = v * (1.0 - libm::exp(first - last)).abs() / total;
                        force[b] = force[b].max(inertia(b) * slope);
                    }
                }
            }
        }
        let spread = |values: &[f64]| rms(values);
        let input = (0..m.inputs.len())
            .map(|i| data.segments.iter().map(|s| s.task.inputs.get(i).map_or(0.0, |u| spread(u))).fold(0.0, f64::max))
            .collect();
        let mut signal = vec![1.0; m.sensors.len()];
        for (c, channel) in data.channels.iter().enumerate() {
            signal[channel.sensor] = super::problem::spread(data, c).max(1e-12);
        }
        Sizes { force, speed, tension, signal, input, sample_s, rate: rate(problem), length_s, orders: Vec::new() }
    }

    /// Sizes where mean speeds are known without a run, and runs give most other sizes.
    fn of_steady_motion(problem: &Problem, speeds: &[f64]) -> Sizes {
        let (m, data) = (&problem.machine, problem.data);
        let mut signal = vec![1.0; m.sensors.len()];
        for (c, channel) in data.channels.iter().enumerate() {
            signal[channel.sensor] = super::problem::spread(data, c).max(1e-12);
        }
        let (mut sample_s, mut length_s) = (f64::MAX, 0.0_f64);
        for s in &data.segments {
            if let Samples::Times { step_s, t_s, .. } = &s.task.samples {
                sample_s = sample_s.min(*step_s);
                length_s = length_s.max(t_s.last().copied().unwrap_or(0.0));
            }
        }
        let speed: Vec<f64> = speeds.iter().map(|v| v.abs()).collect();
        // What the declared loads take, as a torque on every shaft.
        let load_nm = |name: &str| m.slot(&format!("loads.constant.{name}.torque_nm")).map(|s| m.values[s]);
        let mut power_w = 0.0;
        for (b, body) in m.bodies.iter().enumerate() {
            // A shaft is there once for each of its sprockets, and may have the load by its own name.
            let of_shaft = body.shaft_name(m).filter(|_| !m.bodies.iter().take(b).any(|o| o.turns_with(body)));
            let loads = [Some(body.name.as_str()), of_shaft].into_iter().flatten().filter_map(load_nm);
            power_w += loads.map(f64::abs).sum::<f64>() * speed[b];
        }
        let force = speed.iter().zip(&m.bodies).map(|(v, body)| match body.slides {
            _ if *v > 0.0 && power_w > 0.0 => power_w / v,
            true => SWINGING_FORCE_N,
            false => SWINGING_TORQUE_NM,
        });
        let force = force.collect();
        let swinging = |b: usize| if m.bodies[b].slides { SWINGING_M_S } else { SWINGING_RAD_S };
        let mut speed: Vec<f64> =
            speed.iter().enumerate().map(|(b, v)| if *v > 0.0 { *v } else { swinging(b) }).collect();
        for (c, channel) in data.channels.iter().enumerate() {
            let Some(b) = m.slider_of(channel.sensor) else { continue };
            let gain = m.values[m.sensors[channel.sensor].gain].abs().max(1e-300);
            let own = data.segments.iter().filter_map(|s| measured_speed(s, c, channel.noise));
            let fastest = own.fold(0.0, f64::max) / gain;
            speed[b] = if fastest > 0.0 { fastest } else { speed[b] };
        }
        let (tension, input) = (Vec::new(), Vec::new());
        Sizes { force, speed, tension, signal, input, sample_s, rate: rate(problem), length_s, orders: Vec::new() }
    }

    /// Values of a whole-numbered parameter that are tried: those of the catalogue, and orders that stand out of what is left.
    fn with_standing_orders(&self, m: &Machine, target: Target, row: &Parameter) -> Vec<f64> {
        let body = match target {
            Target::Body(b) => Some(b),
            Target::Sensor(s) => m.body_of(s),
            Target::Input(_) | Target::Spring(_) | Target::Chain(_) | Target::Part(_) | Target::Span(_) => None,
        };
        let mut all = row.starts.to_vec();
        if row.key == "order" {
            let standing = body.and_then(|b| self.orders.get(b)).into_iter().flatten();
            // The marks of a sensor repeat themselves with every turn.
            let may_be_half = !row.is_integer() && !matches!(target, Target::Sensor(_));
            let is_one = |n: f64| may_be_half || n == libm::trunc(n);
            let fits = |n: &&f64| (row.low..=row.high).contains(*n) && is_one(**n);
            all.extend(standing.filter(fits).filter(|n| !row.starts.contains(n)));
        }
        all
    }

    /// Typical force or torque on a body [N, N m].
    pub fn force(&self, body: usize) -> f64 {
        self.force.get(body).copied().filter(|f| *f > 0.0).unwrap_or(1e-3)
    }

    /// Root mean square speed of a body [rad/s, m/s].
    pub fn speed(&self, body: usize) -> f64 {
        self.speed.get(body).copied().filter(|v| *v > 0.0).unwrap_or(1e-3)
    }

    /// Scale of a parameter for its target, SI.
    fn scale(&self, m: &Machine, target: Target, scale: Scale) -> f64 {
        let body = match target {
            Target::Body(b) => b,
            Target::Input(i) => m.inputs[i].body,
            Target::Spring(_) | Target::Sensor(_) | Target::Chain(_) | Target::Part(_) | Target::Span(_) => 0,
        };
        let known = |of: &[f64], i: usize| of.get(i).copied().filter(|x| *x > 0.0).unwrap_or(1e-3);
        let (force, speed) = (known(&self.force, body), known(&self.speed, body));
        let inertia = m.bodies.get(body).and_then(|b| b.inertia).map_or(1.0, |slot| m.values[slot]);
        let (stiffness, tension) = match target {
            Target::Spring(s) => (m.spring_numbers(&m.values, &m.springs[s]).0.max(1e-9), known(&self.tension, s)),
            Target::Span(s) => (m.values[m.spans[s].stiffness].max(1e-9), 1.0),
            Target::Body(_) | Target::Input(_) | Target::Sensor(_) | Target::Chain(_) | Target::Part(_) => (1.0, 1.0),
        };
        let input = match target {
            Target::Input(i) => known(&self.input, i),
            Target::Body(_)
            | Target::Spring(_)
            | Target::Sensor(_)
            | Target::Chain(_)
            | Target::Part(_)
            | Target::Span(_) => 1.0,
        };
        let signal = match target {
            Target::Sensor(s) => known(&self.signal, s),
            Target::Body(_)
            | Target::Spring(_)
            | Target::Input(_)
            | Target::Chain(_)
            | Target::Part(_)
            | Target::Span(_) => 1.0,
        };
        match scale {
            Scale::One => 1.0,
            Scale::Force => force,
            Scale::Speed => speed,
            Scale::ForcePerSpeed => force / speed,
            Scale::ForcePerSpeed2 => force / (speed * speed),
            Scale::Stretch => tension / stiffness,
            Scale::Stiffness => stiffness,
            Scale::StiffnessPerStretch => stiffness * stiffness / tension,
            Scale::StiffnessTime => stiffness / self.rate,
            Scale::Tension => tension,
            Scale::Inertia => inertia,
            Scale::Signal => signal,
            Scale::SignalPerTime => signal / self.length_s.max(1e-9),
            Scale::Input => input,
            Scale::PerInput => 1.0 / input,
            Scale::SampleTime => self.sample_s,
            Scale::RecordTime => self.length_s,
            Scale::SampleTravel => speed * self.sample_s,
            Scale::Rate => self.rate,
            Scale::Micrometre10 => m.effort().small_length_m,
        }
    }
}

/// A medium angular frequency: a fifth of the highest that the samples resolve [rad/s].
fn rate(problem: &Problem) -> f64 {
    let step = problem
        .data
        .segments
        .iter()
        .map(|s| match &s.task.samples {
            Samples::Times { step_s, .. } => *step_s,
            Samples::Pulses { interval_s, .. } => *interval_s,
        })
        .fold(f64::MAX, f64::min);
    std::f64::consts::PI / step / 5.0
}

/// Root mean square speed of a measured way [m/s], over the shortest time in which it goes so many times the noise; None: it does not.
fn measured_speed(segment: &RecordSegment, channel: usize, noise: f64) -> Option<f64> {
    let Samples::Times { step_s, .. } = &segment.task.samples else { return None };
    let way = &segment.measured[channel][..segment.judge_from];
    let mut lag = 1;
    while lag < way.len() / 2 {
        let steps: Vec<f64> = way.windows(lag + 1).map(|w| w[lag] - w[0]).filter(|d| d.is_finite()).collect();
        let moved = rms(&steps);
        if !steps.is_empty() && moved > MOVED_NOISES * noise {
            return Some(moved / (lag as f64 * step_s));
        }
        lag *= 2;
    }
    None
}

/// assumed: the noise then adds two percent to the speed.
const MOVED_NOISES: f64 = 7.0;

/// Sizes of what swings about a place, arms and plungers, where nothing says them. assumed: a plunger moves by 0.1 mm at 150 Hz, some 10 N act
/// on it, and an arm has 0.1 m.
const SWINGING_FORCE_N: f64 = 10.0;
const SWINGING_TORQUE_NM: f64 = 1.0;
const SWINGING_M_S: f64 = 0.1;
const SWINGING_RAD_S: f64 = 1.0;

/// A hypothesis whose part leaves less than this share of its starting size is not tried.
const LEAST_ROOM: f64 = 0.01;

/// Maximum number of hypotheses of one effect at one place.
const MAX_FORMS: usize = 24;

/// All hypotheses for a machine. Effects that are left out go into `reasons` with the reason.
pub fn all(
    m: &Machine,
    data: &Data,
    sizes: &Sizes,
    spec: &CandidateSpec,
    fitted: &[usize],
    reasons: &mut Vec<(String, String)>,
) -> Vec<Hypothesis> {
    let mut found = Vec::new();
    let own_unit = data.channels.iter().find_map(|c| m.sensors[c.sensor].unit.as_deref());
    for effect in EFFECTS {
        if spec.without.iter().any(|n| n == effect.name)
            || (!spec.only.is_empty() && spec.only.iter().all(|n| n != effect.name))
        {
            continue;
        }
        for (name, target) in m.targets(effect) {
            let path = format!("effects.{}.{name}", effect.name);
            let mut leave = |why: &str| reasons.push((path.clone(), why.to_string()));
            let channel_at = match target {
                Target::Sensor(s) => data.channels.iter().position(|c| c.sensor == s),
                Target::Body(_)
                | Target::Spring(_)
                | Target::Input(_)
                | Target::Chain(_)
                | Target::Part(_)
                | Target::Span(_) => None,
            };
            let channel = channel_at.and_then(|c| data.channels.get(c));
            if matches!(target, Target::Sensor(_)) && channel.is_none() {
                continue;
            }
            let has_clock = |c: usize| data.segments.iter().any(|s| s.behind_s.get(c).is_some_and(|b| !b.is_empty()));
            if matches!(effect.physics, Physics::OwnClock(_)) && !channel_at.is_some_and(has_clock) {
                if !spec.only.is_empty() {
                    leave("its channel has no file of its own");
                }
                continue;
            }
            // The clock of the whole record cannot be told from that of a file of it.
            if matches!(effect.physics, Physics::Clock(_)) && channel_at.is_some_and(has_clock) {
                leave("its channel has a clock of its own");
                continue;
            }
            // The effect is declared and its parameter is free: no hypothesis is needed.
            let declared = m.placed.iter().any(|p| {
                p.effect == effect
                    && p.target == target
                    && (p.slots.iter().any(|s| fitted.contains(s)) || p.path == path)
            });
            // The same parameter under another name, which is already free.
            let twin = effect.kin.twin.and_then(|twin| match (twin, target) {
                (Twin::SpanStiffness, Target::Spring(s)) => Some(m.springs[s].stiffness),
                (Twin::SpanDamping, Target::Spring(s)) => Some(m.springs[s].damping),
                (Twin::SpanStiffness, Target::Span(s)) => Some(m.spans[s].stiffness),
                (Twin::SpanDamping, Target::Span(s)) => Some(m.spans[s].damping),
                (Twin::SensorGain, Target::Sensor(s)) => Some(m.sensors[s].gain),
                (Twin::SpanStiffness | Twin::SpanDamping | Twin::SensorGain, _) => None,
            });
            if twin.is_some_and(|slot| fitted.contains(&slot)) {
                leave("its number is fitted already");
                continue;
            }
            if declared && effect.parameters.iter().all(|p| !p.kind.is_whole() || p.key == "blind") {
                leave("declared already");
                continue;
            }
            if effect.parameters.iter().all(|p| p.kind == Kind::Given) {
                continue;
            }
            match m.room_for(effect, target, &path) {
                RoomForEffect::Free => {}
                RoomForEffect::Taken => continue,
                RoomForEffect::Refused(why) => {
                    leave(why);
                    continue;
                }
            }
            if *effect == sign_blind::ROW
                && let Some(c) = channel
                && data.facts.iter().any(|f| f.channel == c.name && f.below_zero)
            {
                leave("the channel goes below zero");
                continue;
            }
            let by_angle = effect.parameters.iter().any(|p| p.kind == Kind::Phase);
            if let Some(unit) = own_unit.filter(|_| by_angle) {
                leave(&format!("speeds are in {unit}: a revolution is not known"));
                continue;
            }
            if matches!(effect.physics, Physics::Marks(_)) && m.keys(effect, target).is_empty() {
                leave("one mark only");
                continue;
            }
            let pulses = data.channels.iter().any(|c| c.relative);
            let adds = matches!(effect.physics, Physics::SecondBody { .. }) && !pulses;
            let remembered = effect.parameters.iter().filter(|p| p.kind == Kind::Start).count();
            let own_locals = remembered + if adds { 2 } else { 0 };
            let rows: Vec<&'static Parameter> = m.keys(effect, target).into_iter().map(|(_, p)| p).collect();
            let scales: Vec<f64> = rows.iter().map(|p| sizes.scale(m, target, p.scale)).collect();
            let mut forms: Vec<Vec<f64>> = vec![Vec::new()];
            for (p, scale) in rows.iter().zip(&scales) {
                let starts: Vec<f64> = match p.kind {
                    Kind::Amplitude => {
                        let (low, high) = m.size_range(effect, target, p);
                        let all = p.starts.iter().map(|s| (s * scale, within(s * scale, low * p.unit, high * p.unit)));
                        all.filter(|(start, own)| own.abs() >= LEAST_ROOM * start.abs()).map(|(_, own)| own).collect()
                    }
                    Kind::PerMark => vec![p.starts[0] * scale],
                    // Within the range of the effect, independent of the records.
                    Kind::Shape | Kind::Tried => {
                        p.starts.iter().map(|s| within(s * scale, p.low * p.unit, p.high * p.unit)).collect()
                    }
                    Kind::Whole => sizes.with_standing_orders(m, target, p),
                    Kind::Index => m.indices(target).unwrap_or_else(|| p.starts.to_vec()),
                    Kind::Phase | Kind::Start | Kind::Given => vec![p.default.unwrap_or(0.0) * p.unit],
                };
                forms = forms.iter().flat_map(|f| starts.iter().map(|s| [f.as_slice(), &[*s]].concat())).collect();
            }
            if forms.is_empty() {
                leave("its part leaves no room for it");
            }
            if forms.len() > MAX_FORMS {
                leave(&format!("of {} forms and places the first {MAX_FORMS} are tried", forms.len()));
                forms.truncate(MAX_FORMS);
            }
            for values in forms {
                // The response is evaluated at the starting value, so that this is the scale.
                let scales = match m.shows_at_start_alone(effect) {
                    true => values.iter().map(|v| v.abs()).collect(),
                    false => scales.clone(),
                };
                let h = Hypothesis {
                    effect,
                    name: name.clone(),
                    target,
                    values,
                    rows: rows.clone(),
                    scales,
                    has_place: m.has_place(effect),
                    own_locals,
                };
                let there = m.placed.iter().any(|p| {
                    p.path == path
                        && p.effect == effect
                        && p.slots
                            .iter()
                            .zip(&h.values)
                            .zip(&h.rows)
                            .all(|((s, v), r)| !r.kind.is_whole() || m.values[*s] == *v)
                });
                if !there {
                    found.push(h);
                }
            }
        }
    }
    found
}

/// Time constants of a course within a record are at most this share of the longest record.
const LONGEST_COURSE: f64 = 0.5;

/// Factor by which a shape parameter may change from its start in both directions.
const FORM_RANGE: f64 = 12.0;

/// Law of a shape that starts at a value, within the range of its effect.
pub fn law_of_shape(start: f64, (low, high): (f64, f64)) -> Law {
    let (low, high) = ((start / FORM_RANGE).max(low.max(1e-300)), (start * FORM_RANGE).min(high));
    Law { scale: start, logarithm: true, low, high }
}

/// Ratio of the cost at the starting values to that at the share `NEGLIGIBLE_SHARE` of them, above which they stop the
/// machine or make it run away. Such values give the fit no direction, because the other parameters have not yet
/// adapted. The shares `REDUCED_SHARES` are then tried.
const DIVERGING_COST_RATIO: f64 = 10.0;
const REDUCED_SHARES: [f64; 3] = [0.5, 0.2, 0.05];
const NEGLIGIBLE_SHARE: f64 = 1e-3;

/// As [`with_hypothesis`], but with a smaller amplitude if the starting value stops the machine or makes it run away.
pub fn with_stable_start<'a>(
    problem: &Problem<'a>,
    point: &Point,
    h: &Hypothesis,
    fit_start: &FitStart,
    threads: usize,
) -> (Problem<'a>, Point) {
    let sized = |share: f64| {
        let size = |(value, row): (&f64, &&Parameter)| match row.kind {
            Kind::Amplitude | Kind::PerMark => share * value,
            Kind::Shape | Kind::Phase | Kind::Whole | Kind::Index | Kind::Start | Kind::Given | Kind::Tried => *value,
        };
        let values = fit_start.values.iter().zip(&h.rows).map(size).collect();
        with_hypothesis(problem, point, h, &FitStart { values, ..fit_start.clone() })
    };
    let whole = sized(1.0);
    let has_size = h.rows.iter().any(|r| matches!(r.kind, Kind::Amplitude | Kind::PerMark));
    if h.effect.part == Part::Tensioner {
        return with_least_cost(problem, point, h, fit_start, whole, threads);
    }
    if !problem.machine.effort().is_thorough || !has_size {
        return whole;
    }
    let cost = |(problem, point): &(Problem, Point)| cost_at(problem, point, threads);
    let hardly = sized(NEGLIGIBLE_SHARE);
    let without = cost(&hardly);
    if cost(&whole) < DIVERGING_COST_RATIO * without {
        return whole;
    }
    REDUCED_SHARES.iter().map(|share| sized(*share)).find(|start| cost(start) < without).unwrap_or(hardly)
}

/// Sizes from which the fit of a tensioner's effect may start, over the one that screening gives and over that of the catalogue. Not varied.
const SMALLER: f64 = 0.3;
const OF_CATALOGUE: [f64; 2] = [1.0, 4.0];

/// The start of several sizes that leaves least. A tensioner swings another way as soon as it is a little softer or harder, so that what a small
/// effect does tells little of what a large one does: a hole beside a check ball of 0.2 mm2 was fitted with less than nothing.
fn with_least_cost<'a>(
    problem: &Problem<'a>,
    point: &Point,
    h: &Hypothesis,
    fit_start: &FitStart,
    first: (Problem<'a>, Point),
    threads: usize,
) -> (Problem<'a>, Point) {
    let scaled = |values: &[f64], share: f64| -> Vec<f64> {
        values.iter().zip(&h.rows).map(|(v, row)| if row.kind.is_amplitude() { share * v } else { *v }).collect()
    };
    let is_opposite = fit_start.values.iter().zip(&h.values).any(|(a, b)| a * b < 0.0);
    let sign = if is_opposite { -1.0 } else { 1.0 };
    let smaller = FitStart { values: scaled(&fit_start.values, SMALLER), ..fit_start.clone() };
    let of_catalogue = OF_CATALOGUE.map(|share| {
        let values = scaled(&h.values, sign * share);
        FitStart { values, travels: Vec::new(), ..fit_start.clone() }
    });
    let starts = std::iter::once(smaller).chain(of_catalogue).map(|start| with_hypothesis(problem, point, h, &start));
    let cost = |(problem, point): &(Problem, Point)| cost_at(problem, point, threads);
    let mut least = (cost(&first), first);
    for start in starts {
        let own = cost(&start);
        if own < least.0 {
            least = (own, start);
        }
    }
    least.1
}

/// The problem with a hypothesis added. Its parameters are free and begin at the starting values.
pub fn with_hypothesis<'a>(
    problem: &Problem<'a>,
    point: &Point,
    h: &Hypothesis,
    fit_start: &FitStart,
) -> (Problem<'a>, Point) {
    let (values, phases) = (&fit_start.values, &fit_start.phases);
    let mut next = problem.clone();
    let mut point = point.clone();
    if let Some(at) = problem.locals.iter().position(|l| *l == Local::Travel) {
        for (locals, travel) in point.locals.iter_mut().zip(&fit_start.travels) {
            locals[at] = *travel;
        }
    }
    // A second harmonic of an effect that is already present needs a name of its own.
    let mut name = h.name.clone();
    while next.machine.placed.iter().any(|p| p.path == format!("effects.{}.{name}", h.effect.name)) {
        name.push('+');
    }
    let (machine, slots) = next.machine.with_effect(h.effect, &name, h.target, values);
    next.machine = machine;
    // What goes on for longer than a record is no course within it.
    let longest_s = next.data.clocks.iter().map(|c| c.length_s).fold(0.0, f64::max);
    for (row, slot) in h.rows.iter().zip(&slots).filter(|(row, _)| row.scale == Scale::RecordTime && longest_s > 0.0) {
        let own = &mut next.machine.slots[*slot];
        own.high = own.high.min(LONGEST_COURSE * longest_s / row.unit).max(own.low);
    }
    for (i, (row, slot)) in h.rows.iter().zip(&slots).enumerate() {
        let s = &next.machine.slots[*slot];
        let (low, high) = (s.low * s.unit, s.high * s.unit);
        let law = match row.kind {
            Kind::Amplitude | Kind::PerMark => Law { scale: h.scales[i].abs(), logarithm: false, low, high },
            Kind::Shape => law_of_shape(values[i], (low, high)),
            Kind::Phase => Law { scale: 1.0, logarithm: false, low: -1e3, high: 1e3 },
            Kind::Start => {
                let law = Law { scale: h.scales[i].abs(), logarithm: false, low, high };
                next.locals.push(Local::Slot { slot: *slot, law });
                point.locals.iter_mut().for_each(|own| own.push(law.scaled(values[i])));
                continue;
            }
            Kind::Whole | Kind::Index | Kind::Given | Kind::Tried => continue,
        };
        if row.kind == Kind::Phase {
            for (record, phase) in phases.iter().enumerate() {
                next.globals.push(Global { slot: *slot, record: Some(record), law, prior: None });
                point.globals.push(law.scaled(*phase));
            }
        } else {
            next.globals.push(Global { slot: *slot, record: None, law, prior: None });
            point.globals.push(law.scaled(values[i]));
        }
    }
    if let (Physics::SecondBody { .. }, Target::Body(near)) = (h.effect.physics, h.target)
        && h.own_locals > 0
    {
        let body = next.machine.bodies.len() - 1;
        let of_near = |l: &Local| match l {
            Local::Speed { body, scale } if *body == near => Some(*scale),
            Local::Travel | Local::Angle { .. } | Local::Speed { .. } | Local::Slot { .. } => None,
        };
        let speed = next.locals.iter().find_map(of_near).unwrap_or(1.0);
        let rate = h.rows.iter().zip(values).find(|(r, _)| r.key == "frequency_hz").map_or(1.0, |(_, w)| *w);
        next.locals.push(Local::Speed { body, scale: speed });
        next.locals.push(Local::Angle { body, scale: speed / rate.max(1e-9) });
        point.locals.iter_mut().for_each(|own| own.extend([0.0, 0.0]));
    }
    (next, point)
}
