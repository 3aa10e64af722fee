//! Tension of every span, speeds and torques of what turns, and where the energy goes.
//!
//! A span reaches from the last link that touches a sprocket to the first that touches the next one. Links next to a sprocket bend; the tension is
//! read from the joints between.

use super::{Estimate, Topology};
use crate::diag::last_name;
use crate::recording::frame::{Energy, Frame, Header};
use std::collections::BTreeMap;

/// Links beside a sprocket that are left out of its spans.
const BESIDE: usize = 2;

/// Mean and scatter of a number over the frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Running {
    sum: f64,
    squares: f64,
    pub least: f64,
    pub samples: usize,
}

impl Running {
    pub fn add(&mut self, value: f64) {
        self.least = if self.samples == 0 { value } else { self.least.min(value) };
        self.sum += value;
        self.squares += value * value;
        self.samples += 1;
    }

    pub fn mean(&self) -> f64 {
        self.sum / self.samples.max(1) as f64
    }

    /// Standard deviation.
    pub fn scatter(&self) -> f64 {
        (self.squares / self.samples.max(1) as f64 - self.mean() * self.mean()).max(0.0).sqrt()
    }

    /// The standard deviation as a number of its own, known to its own share of 1/sqrt(2 n).
    pub fn scatter_estimate(&self) -> Option<Estimate> {
        let (value, n) = (self.scatter(), self.samples);
        (n > 1).then(|| Estimate { value, error: value / (2.0 * n as f64).sqrt(), samples: n })
    }

    pub fn estimate(&self) -> Option<Estimate> {
        let error = self.scatter() / (self.samples.max(1) as f64).sqrt();
        (self.samples > 0).then(|| Estimate { value: self.mean(), error, samples: self.samples })
    }
}

/// A span by the sprockets that the chain leaves and reaches, as indices into `Header::bodies`.
pub type SpanEnds = (usize, usize);

/// Spans of chains without links: row, and ends, which the path of its row names.
fn rows_of_spans<'a>(header: &'a Header) -> impl Iterator<Item = (usize, SpanEnds)> + 'a {
    let body = |name: &str| header.bodies.iter().position(|b| b.rotor && last_name(&b.path) == name);
    header.spans.iter().enumerate().filter_map(move |(row, path)| {
        let (from, to) = last_name(path).split_once('-')?;
        Some((row, (body(from)?, body(to)?)))
    })
}

/// Whether each chain runs towards its links ahead in this frame: a sprocket that it wraps from outside turns the next chain the other way.
fn run_forwards(frame: &Frame, topology: &Topology) -> Vec<bool> {
    let l = &frame.links;
    let mut along = vec![0.0; topology.pitch_m.len()];
    for (i, (chain, ahead)) in topology.chain.iter().zip(&topology.ahead).enumerate() {
        along[*chain] += (l.x_m[*ahead] - l.x_m[i]) * l.vx_m_s[i] + (l.y_m[*ahead] - l.y_m[i]) * l.vy_m_s[i];
    }
    along.into_iter().map(|sum| if sum == 0.0 { topology.forwards } else { sum > 0.0 }).collect()
}

/// Spans of one frame: its ends, and the mean force in its joints, or its tension where it has none [N].
pub fn spans_of(frame: &Frame, header: &Header, topology: &Topology) -> Vec<(SpanEnds, f64)> {
    let c = &frame.contacts;
    let mut on: Vec<Option<usize>> = vec![None; topology.ahead.len()];
    for row in 0..c.link.len() {
        let body = c.body[row] as usize;
        if c.normal_force_n[row] > 0.0 && header.bodies.get(body).is_some_and(|b| b.rotor) {
            on[c.link[row] as usize] = Some(body);
        }
    }
    let tension = |(row, ends): (usize, SpanEnds)| Some((ends, *frame.spans.tension_n.get(row)?));
    let mut found: Vec<(SpanEnds, f64)> = rows_of_spans(header).filter_map(tension).collect();
    let forwards = run_forwards(frame, topology);
    for start in 0..on.len() {
        let Some(from) = on[start].filter(|_| on[topology.ahead[start]].is_none()) else { continue };
        let mut links = Vec::new();
        let mut at = topology.ahead[start];
        while on[at].is_none() && links.len() < on.len() {
            links.push(at);
            at = topology.ahead[at];
        }
        let Some(to) = on[at].filter(|to| *to != from) else { continue };
        if links.len() <= 2 * BESIDE {
            continue;
        }
        let inner = &links[BESIDE..links.len() - BESIDE];
        let force = |i: usize| libm::hypot(frame.joints.force_x_n[i], frame.joints.force_y_n[i]);
        let mean = inner.iter().map(|i| force(*i)).sum::<f64>() / inner.len() as f64;
        found.push((if forwards[topology.chain[start]] { (from, to) } else { (to, from) }, mean));
    }
    found
}

type CrankAndRotors = (f64, Vec<f64>);

/// Share of the crank's turn by which the driver's may differ: frames are rounded.
const AS_THE_CRANK: f64 = 1e-6;

/// Sums over spans, shafts and accounts.
#[derive(Clone, Debug, Default)]
pub struct SpanPass {
    pub spans: BTreeMap<SpanEnds, Running>,
    /// Distance of the axes at its ends.
    axes: BTreeMap<SpanEnds, Running>,
    /// Mean over the spans of each frame.
    loop_n: Running,
    /// Speed, torque of chains and outer torque of each row of `rotors`, and its angle.
    turning: Vec<[Running; 4]>,
    ends: Option<((f64, Energy), (f64, Energy))>,
    /// Angle of the crank and of each row of `rotors`, in the first frame and in the last [rad].
    turned: Option<(CrankAndRotors, CrankAndRotors)>,
}

/// What the frames tell of spans, shafts and energies.
#[derive(Clone, Debug, Default)]
pub struct SpanFit {
    pub spans: Vec<(SpanEnds, Estimate)>,
    pub axes: BTreeMap<SpanEnds, Running>,
    pub preload_n: Option<Estimate>,
    /// Speed, torque of chains, outer torque, angle of each row of `rotors`.
    pub turning: Vec<[Option<Estimate>; 4]>,
    /// Row of the driver, which turns as the crank does; None where the recording is too short to tell.
    pub driver: Option<usize>,
    /// Standard deviation of the speed of each [rad/s].
    pub speed_scatter: Vec<Option<Estimate>>,
    /// Change of each account per time [W].
    pub power_w: Vec<f64>,
}

impl SpanPass {
    pub fn take(&mut self, frame: &Frame, header: &Header, topology: &Topology) {
        let found = spans_of(frame, header, topology);
        for (ends, force) in &found {
            self.spans.entry(*ends).or_default().add(*force);
            let [from, to] = [ends.0, ends.1].map(|b| header.bodies.get(b).map_or([0.0; 2], |b| b.pose(frame).0));
            self.axes.entry(*ends).or_default().add(libm::hypot(to[0] - from[0], to[1] - from[1]));
        }
        if !found.is_empty() {
            self.loop_n.add(found.iter().map(|(_, f)| f).sum::<f64>() / found.len() as f64);
        }
        let r = &frame.rotors;
        self.turning.resize(r.speed_rad_s.len(), [Running::default(); 4]);
        for (k, sums) in self.turning.iter_mut().enumerate() {
            let values = [r.speed_rad_s[k], r.chain_torque_nm[k], r.outer_torque_nm[k], r.angle_rad[k]];
            sums.iter_mut().zip(values).for_each(|(sum, value)| sum.add(value));
        }
        let turned = (frame.crank_angle_rad, r.angle_rad.clone());
        self.turned = Some((self.turned.take().map_or_else(|| turned.clone(), |(first, _)| first), turned));
        let now = (frame.t_s, frame.energy);
        self.ends = Some((self.ends.map_or(now, |(first, _)| first), now));
    }

    fn driver(&self) -> Option<usize> {
        let ((from, before), (to, after)) = self.turned.as_ref()?;
        let crank_rad = to - from;
        let off = |k: &usize| ((after[*k] - before[*k]).abs() - crank_rad.abs()).abs();
        let nearest = (0..after.len().min(before.len())).min_by(|a, b| off(a).total_cmp(&off(b)))?;
        (off(&nearest) <= AS_THE_CRANK * crank_rad.abs()).then_some(nearest)
    }

    pub fn fit(&self) -> SpanFit {
        let power_w = self.ends.map_or(Vec::new(), |((from_s, from), (to_s, to))| {
            let time_s = (to_s - from_s).max(1e-12);
            from.accounts().zip(to.accounts()).map(|((_, a), (_, b))| (b - a) / time_s).collect()
        });
        SpanFit {
            spans: self.spans.iter().filter_map(|(ends, sum)| Some((*ends, sum.estimate()?))).collect(),
            axes: self.axes.clone(),
            preload_n: self.loop_n.estimate(),
            turning: self.turning.iter().map(|sums| std::array::from_fn(|i| sums[i].estimate())).collect(),
            driver: self.driver(),
            speed_scatter: self.turning.iter().map(|sums| sums[0].scatter_estimate()).collect(),
            power_w,
        }
    }
}
