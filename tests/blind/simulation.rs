//! Simulation of a machine with its effects, with an independent scheme and independent friction laws.

use super::effects::{Fault, Law, On};
use super::machine::{Kind, Machine};
use super::numbers::at_place;
use super::records::Record;
use std::f64::consts::PI;

/// Angles, speeds, and the state of a hysteresis. The third body is one that an effect attaches.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    q: [f64; 3],
    v: [f64; 3],
    z: f64,
}

/// Inputs at an instant.
#[derive(Clone, Copy, Debug, Default)]
struct At {
    torque: f64,
    /// For a driver with prescribed speed.
    speed: f64,
    walk: f64,
    gate: f64,
    /// Elapsed share of the record.
    share: f64,
}

/// Forces and rates.
#[derive(Clone, Copy, Debug, Default)]
struct Act {
    force: [f64; 3],
    inertia: [f64; 3],
    acceleration: [f64; 3],
    /// Speed of the first body.
    speed: f64,
    tension: f64,
    stretch: f64,
    z_rate: f64,
}

/// A machine with effects in a record.
pub(super) struct Scene<'a> {
    pub(super) m: &'a Machine,
    pub(super) faults: &'a [Fault],
    pub(super) rec: &'a Record,
}

impl Scene<'_> {
    fn act(&self, x: &State, at: &At) -> Act {
        let m = self.m;
        let mut a = Act { speed: x.v[0], inertia: [m.inertia[0], m.inertia[1].max(1e-12), 1.0], ..Act::default() };
        if m.kind == Kind::Chain {
            a.speed = self.given_speed(x.q[0], at);
        } else {
            a.force[0] = at.torque;
        }
        let v = [a.speed, x.v[1], x.v[2]];
        for b in 0..2 {
            a.force[b] -= m.viscous[b] * v[b] + m.constant[b];
        }
        if m.kind != Kind::One {
            self.spring(x, &v, &mut a);
        }
        for f in self.faults {
            self.body_law(f, x, &v, at, &mut a);
        }
        for i in 0..3 {
            a.acceleration[i] = a.force[i] / a.inertia[i];
        }
        a
    }

    /// Speed of a driver at an angle.
    fn given_speed(&self, q: f64, at: &At) -> f64 {
        let mut speed = at.speed;
        for f in self.faults.iter().filter(|f| f.law == Law::Fluctuation) {
            speed *= 1.0 + f.size * (f.form[0] * (q + self.rec.angle0[0]) + f.phase).sin();
        }
        speed
    }

    /// The spring between both bodies; work that lengthens it is taken from the body that lengthens it.
    fn spring(&self, x: &State, v: &[f64; 3], a: &mut Act) {
        let m = self.m;
        let mut slope = [m.radius[0], -m.radius[1]];
        let mut stretch = slope[0] * x.q[0] + slope[1] * x.q[1];
        for f in self.faults {
            if let (Some(amplitude), Some(n)) = (f.path_amplitude(), f.order(m)) {
                let angle = n * (x.q[f.at] + self.rec.angle0[f.at]) + f.phase;
                stretch += amplitude * angle.sin();
                slope[f.at] += amplitude * n * angle.cos();
            }
        }
        let rate = slope[0] * v[0] + slope[1] * v[1];
        let mut tension = m.stiffness * stretch + m.damping * rate;
        for f in self.faults {
            match f.law {
                // Within the gap no force acts, also from the damper.
                Law::Backlash => {
                    let play = stretch.abs() - 0.5 * f.size;
                    tension = if play > 0.0 { m.stiffness * play.copysign(stretch) + m.damping * rate } else { 0.0 };
                }
                Law::Hardening => tension += f.size * stretch * stretch.abs(),
                Law::Hysteresis => {
                    // Bouc 1967, Wen 1976: elastic at first, then it yields at the stretch in `form`.
                    let yields = if rate * x.z > 0.0 { x.z.abs() / f.form[0] } else { 0.0 };
                    a.z_rate = rate * (1.0 - yields);
                    tension += f.size * x.z;
                }
                _ => {}
            }
        }
        (a.tension, a.stretch) = (tension, stretch);
        a.force[0] -= slope[0] * tension;
        a.force[1] -= slope[1] * tension;
    }

    fn body_law(&self, f: &Fault, x: &State, v: &[f64; 3], at: &At, a: &mut Act) {
        let (b, t) = (f.at.min(1), f.size);
        let ratio = if f.form[0] > 0.0 { v[b] / f.form[0] } else { 0.0 };
        let angle = x.q[b] + self.rec.angle0[b];
        a.force[b] -= match f.law {
            Law::Coulomb if !f.sticks => t * ratio.tanh(),
            Law::Stribeck => t * (-ratio * ratio).exp() * (5.0 * ratio).tanh(),
            Law::Quadratic => t * v[b] * v[b].abs(),
            Law::Constant => t,
            Law::Viscous => t * v[b],
            Law::Ripple => -t * (f.form[0] * angle + f.phase).sin(),
            Law::Unbalance => -t * v[b] * v[b] * (angle + f.phase).sin(),
            Law::Bump => {
                let away = (x.q[b] - self.rec.bump[0]) / self.rec.bump[1];
                t * (-away * away).exp()
            }
            Law::Intermittent => t * at.gate * if v[b].abs() > f.form[0] { v[b].signum() } else { 0.0 },
            Law::RandomWalk => t * at.walk,
            Law::Cubic => t * ratio * (ratio * ratio - 1.0),
            _ => 0.0,
        };
        match f.law {
            Law::Attached => {
                let omega = 2.0 * PI * f.form[0];
                let pull = t * omega * (omega * (x.q[2] - x.q[b]) + 2.0 * f.form[1] * (x.v[2] - v[b]));
                a.inertia[2] = t.max(1e-12);
                a.force[b] += pull;
                a.force[2] -= pull;
            }
            // The lost mass takes its momentum along.
            Law::Mass => a.inertia[b] *= 1.0 + t * at.share,
            _ => {}
        }
    }

    /// Friction that sticks, implicit: it stops a body if it can within the step.
    fn dry(&self, x: &mut State, h: f64) {
        for f in self.faults.iter().filter(|f| f.sticks) {
            let most = h * f.size / self.m.inertia[f.at];
            let v = &mut x.v[f.at];
            *v = if v.abs() <= most { 0.0 } else { *v - most.copysign(*v) };
        }
    }

    /// Heun's rule between two halves of dry friction; returns the forces at the start.
    fn step(&self, x: &mut State, from: &At, to: &At, h: f64) -> Act {
        self.dry(x, 0.5 * h);
        let a = self.act(x, from);
        let given = self.m.kind == Kind::Chain;
        let mut guess = *x;
        for i in 0..3 {
            guess.q[i] += h * x.v[i];
            guess.v[i] += h * a.acceleration[i];
        }
        guess.z += h * a.z_rate;
        if given {
            let next = self.given_speed(x.q[0] + h * a.speed, to);
            guess.q[0] = x.q[0] + 0.5 * h * (a.speed + next);
        }
        let b = self.act(&guess, to);
        let was = *x;
        for i in 0..3 {
            x.q[i] += 0.5 * h * (was.v[i] + guess.v[i]);
            x.v[i] += 0.5 * h * (a.acceleration[i] + b.acceleration[i]);
        }
        x.z += 0.5 * h * (a.z_rate + b.z_rate);
        if given {
            x.q[0] = was.q[0] + 0.5 * h * (a.speed + b.speed);
            x.v[0] = b.speed;
        }
        self.dry(x, 0.5 * h);
        a
    }

    /// The driving torque in the middle of every step, after the effects of the input.
    fn feed(&self, parts: usize, h: f64) -> Vec<f64> {
        let rec = self.rec;
        let steps = (rec.lead + rec.n) * parts;
        let part = |s: usize| (s % parts) as f64 + 0.5;
        let mut u: Vec<f64> = (0..steps)
            .map(|s| match self.m.hold {
                true => rec.input[s / parts],
                false => at_place(&rec.input, (s / parts) as f64 + part(s) / parts as f64),
            })
            .collect();
        for f in self.faults {
            match f.law {
                Law::GainCurve => u.iter_mut().for_each(|u| *u += f.size * *u * u.abs()),
                Law::Saturation => u.iter_mut().for_each(|u| *u = (f.size * *u).tanh() / f.size),
                Law::DeadZone => u.iter_mut().for_each(|u| *u = (u.abs() - f.size).max(0.0).copysign(*u)),
                Law::InputOffset => u.iter_mut().for_each(|u| *u += f.size),
                Law::InputDelay => u = (0..steps).map(|s| at_place(&u, s as f64 - f.size / h)).collect(),
                Law::Lag => {
                    let (share, mut y) = (-(-h / f.size).exp_m1(), u[0]);
                    for u in &mut u {
                        let before = y;
                        y += share * (*u - y);
                        *u = 0.5 * (before + y);
                    }
                }
                _ => {}
            }
        }
        u.iter_mut().for_each(|u| *u *= self.m.gain);
        u
    }

    /// Inputs at an instant, without the torque; `part` of a sample after `sample`.
    fn at(&self, sample: usize, part: f64) -> At {
        let (rec, next) = (self.rec, (sample + 1).min(self.rec.gate.len() - 1));
        let between = |series: &[f64]| series[sample] + part * (series[next] - series[sample]);
        let share = (sample as f64 + part - rec.lead as f64) / rec.n as f64;
        let speed = if self.m.kind == Kind::Chain { between(&rec.input) } else { 0.0 };
        At { torque: 0.0, speed, walk: between(&rec.walk), gate: rec.gate[sample], share: share.clamp(0.0, 1.0) }
    }

    /// Output of a channel's sensor for its quantity, at all steps.
    pub(super) fn sensor(&self, channel: usize, y: &mut Vec<f64>, angle: &[f64], h: f64) {
        for f in self.faults.iter().filter(|f| f.row().on == On::Channel && f.at == channel) {
            match f.law {
                Law::Encoder => {
                    let start = self.rec.angle0[self.m.sensed(channel).unwrap_or(0)];
                    for (y, q) in y.iter_mut().zip(angle) {
                        *y += f.size * f.form[0] * *y * (f.form[0] * (q + start) + f.phase).cos();
                    }
                }
                Law::SignBlind => y.iter_mut().for_each(|y| *y = y.abs()),
                Law::Latency => *y = (0..y.len()).map(|s| at_place(y, s as f64 - f.size / h)).collect(),
                Law::LowPass => {
                    let (share, mut state, mut before) = (-(-h / f.size).exp_m1(), y[0], y[0]);
                    for y in y.iter_mut() {
                        state += share * (0.5 * (*y + before) - state);
                        (before, *y) = (*y, state);
                    }
                }
                Law::Gain => y.iter_mut().for_each(|y| *y *= 1.0 + f.size),
                Law::Offset => y.iter_mut().for_each(|y| *y += f.size),
                Law::Drift => {
                    let start = self.rec.lead as f64 * self.rec.step_s;
                    y.iter_mut().enumerate().for_each(|(s, y)| *y += f.size * (s as f64 * h - start));
                }
                _ => {}
            }
        }
    }
}

/// An initial value that no file contains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Nudge {
    Speed(usize, f64),
    Angle(usize, f64),
}

/// Noise-free record.
pub(super) struct Run {
    pub(super) channels: Vec<Vec<f64>>,
    /// Angle of the last body.
    pub(super) angle: Vec<f64>,
    pub(super) stretch: Vec<f64>,
    pub(super) speed: [Vec<f64>; 2],
}

pub(super) fn run(scene: &Scene, parts: usize, nudge: Option<Nudge>) -> Run {
    let (m, rec) = (scene.m, scene.rec);
    let h = rec.step_s / parts as f64;
    let feed = if m.kind == Kind::Chain { Vec::new() } else { scene.feed(parts, h) };
    let mut x = State { v: [rec.v0[0], rec.v0[1], rec.v0[m.last()]], ..State::default() };
    if m.kind == Kind::Chain {
        // It starts under its load.
        let tension = (m.constant[1] + m.viscous[1] * x.v[1]) / m.radius[1];
        x.q[1] = -tension / m.stiffness / m.radius[1];
        x.q[2] = x.q[1];
    }
    let steps = (rec.lead + rec.n - 1) * parts;
    let mut raw = vec![Vec::new(); m.channels];
    let mut angle = vec![Vec::new(); 2];
    let mut out = Run { channels: Vec::new(), angle: Vec::new(), stretch: Vec::new(), speed: [Vec::new(), Vec::new()] };
    let mut to = scene.at(0, 0.0);
    for s in 0..=steps {
        let (sample, part) = (s / parts, s % parts);
        if s == rec.lead * parts {
            match nudge {
                Some(Nudge::Speed(b, d)) => x.v[b] += d,
                Some(Nudge::Angle(b, d)) => x.q[b] += d,
                None => {}
            }
        }
        let torque = feed.get(s).copied().unwrap_or(0.0);
        let from = At { torque, ..to };
        to = At { torque, ..scene.at(sample, (part + 1) as f64 / parts as f64) };
        let before = x;
        let act = scene.step(&mut x, &from, &to, h);
        let speed = [if m.kind == Kind::Chain { act.speed } else { before.v[0] }, before.v[1]];
        for (c, raw) in raw.iter_mut().enumerate() {
            raw.push(m.sensed(c).map_or(act.tension, |b| speed[b]));
        }
        angle.iter_mut().zip(before.q).for_each(|(a, q)| a.push(q));
        if part == 0 && sample >= rec.lead {
            out.angle.push(before.q[m.last()]);
            out.stretch.push(act.stretch);
            out.speed.iter_mut().zip(speed).for_each(|(all, v)| all.push(v));
        }
    }
    for (c, mut y) in raw.into_iter().enumerate() {
        scene.sensor(c, &mut y, &angle[m.sensed(c).unwrap_or(0)], h);
        out.channels.push(y.into_iter().skip(rec.lead * parts).step_by(parts).collect());
    }
    out
}
