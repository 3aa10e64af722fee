//! Prepares a lumped machine for simulation and computes the forces on its bodies and its fastest rates.

use super::{Body, BodyMotion, Machine, PlacedEffect, Target};
use crate::effects::{
    BodyAt, BodyLaw, ChainAt, ChainTorqueLaw, HighestOrder, Kind, LoadedLaw, MotionLaw, Physics, SpanAt, StateLaw,
    TimedLaw,
};
use std::f64::consts::PI;

/// A machine with its parameter values, prepared for simulation.
pub(super) struct PreparedMachine<'a> {
    pub(super) m: &'a Machine,
    pub(super) values: &'a [f64],
    pub(super) inertia: Vec<f64>,
    /// Stiffness and damping of every spring.
    pub(super) springs: Vec<(f64, f64)>,
    /// Effects on bodies and springs, separated by target.
    pub(super) on_body: Vec<(usize, BodyLaw, Vec<f64>)>,
    timed: Vec<(usize, TimedLaw, Vec<f64>)>,
    /// On the body of an input: index of the input.
    loaded: Vec<(usize, LoadedLaw, Vec<f64>)>,
    /// Each has one inner state, in this order.
    with_state: Vec<(usize, StateLaw, Vec<f64>)>,
    pub(super) on_spring: Vec<Vec<SpringEffect>>,
    pub(super) motion: Vec<(usize, MotionLaw, Vec<f64>)>,
    pub(super) chain_torque: Vec<(ChainTorqueLaw, Vec<f64>)>,
    pub(super) leader_teeth: f64,
    pub(super) max_steps: f64,
    /// The body that represents each body: for an added body without inertia, its host.
    pub(super) stands_for: Vec<usize>,
}

pub(super) enum SpringEffect {
    Length { body: usize, teeth: u32, law: fn(&[f64], u32, f64) -> (f64, f64), p: Vec<f64> },
    Chain { law: fn(&[f64], ChainAt) -> (f64, f64), p: Vec<f64> },
    Force { law: fn(&[f64], SpanAt) -> f64, p: Vec<f64> },
    Loss { law: fn(&[f64], f64, f64) -> f64, p: Vec<f64> },
}

/// Tensions of all springs at one instant, filled by `PreparedMachine::forces_into`.
#[derive(Default)]
pub(super) struct SpringForces {
    pub(super) tension: Vec<f64>,
    slopes: Vec<(usize, f64)>,
}

/// A force on a body as a function of its motion.
type LawOfSpeed<'a> = &'a dyn Fn(BodyAt) -> f64;

/// A speed may change within a sample by so many times what its acceleration at the beginning says.
const MARGIN: f64 = 2.0;
/// A speed that changes within a sample by less than this share of itself sees one slope of every friction curve.
const HARDLY_CHANGES: f64 = 0.05;
/// Shares of a decay time and of a wave that one step may cross: Runge-Kutta then errs by 3e-9 and 8e-9.
const EXACT_DECAY: f64 = 0.05;
const EXACT_WAVE: f64 = 0.01;
/// Change of an inner state that counts as none.
const STAYS: f64 = 1e-9;

impl<'a> PreparedMachine<'a> {
    pub(super) fn new(m: &'a Machine, values: &'a [f64], max_steps: f64) -> PreparedMachine<'a> {
        let of = |p: &PlacedEffect| p.slots.iter().map(|s| values[*s]).collect::<Vec<f64>>();
        let mut ready = PreparedMachine {
            m,
            values,
            inertia: m.bodies.iter().map(|b| inertia(b, values)).collect(),
            springs: m.springs.iter().map(|s| m.spring_numbers(values, s)).collect(),
            on_body: Vec::new(),
            timed: Vec::new(),
            loaded: Vec::new(),
            with_state: Vec::new(),
            on_spring: m.springs.iter().map(|_| Vec::new()).collect(),
            motion: Vec::new(),
            chain_torque: Vec::new(),
            leader_teeth: m.chains.first().and_then(|c| m.bodies[c.leader].teeth).map_or(0.0, f64::from),
            max_steps,
            stands_for: (0..m.bodies.len()).collect(),
        };
        for spring in m.springs.iter().filter(|s| s.tuned.is_some_and(|slot| values[slot] == 0.0)) {
            if let [near, far] = spring.ends.as_slice() {
                ready.stands_for[far.body] = near.body;
            }
        }
        for p in &m.placed {
            match (p.effect.physics, p.target) {
                (Physics::BodyForce(law), Target::Body(b)) => ready.on_body.push((b, law, of(p))),
                (Physics::TimedForce(law), Target::Body(b)) => ready.timed.push((b, law, of(p))),
                (Physics::StateForce(law), Target::Body(b)) => ready.with_state.push((b, law, of(p))),
                (Physics::LoadedForce(law), Target::Input(k)) => ready.loaded.push((k, law, of(p))),
                (Physics::Motion(law), Target::Body(b)) => ready.motion.push((b, law, of(p))),
                (Physics::SpanForce(law), Target::Spring(s)) => {
                    ready.on_spring[s].push(SpringEffect::Force { law, p: of(p) });
                }
                (Physics::SpanLength(law), Target::Body(body)) => {
                    let teeth = m.bodies[body].teeth.unwrap_or(1);
                    for (s, spring) in m.springs.iter().enumerate() {
                        if spring.ends.iter().any(|e| e.body == body) {
                            ready.on_spring[s].push(SpringEffect::Length { body, teeth, law, p: of(p) });
                        }
                    }
                }
                (Physics::ChainLength(law), Target::Chain(_)) => {
                    for (s, _) in m.springs.iter().enumerate().filter(|(_, s)| s.links.is_some()) {
                        ready.on_spring[s].push(SpringEffect::Chain { law, p: of(p) });
                    }
                }
                (Physics::SpanLoss(law), Target::Chain(_)) => {
                    for on in &mut ready.on_spring {
                        on.push(SpringEffect::Loss { law, p: of(p) });
                    }
                }
                (Physics::ChainTorque(law), Target::Chain(_)) => ready.chain_torque.push((law, of(p))),
                _ => {}
            }
        }
        ready
    }

    fn chain_at(&self, spring: usize, q: &[f64]) -> ChainAt {
        let (from, to) = self.m.springs[spring].links.unwrap_or((0.0, 0.0));
        let (links, leader) = self.m.chains.first().map_or((1.0, 0), |c| (f64::from(c.links), c.leader));
        ChainAt { travel: q[leader] * self.leader_teeth / (2.0 * PI), links, from, to }
    }

    /// Inner states of effects at the start of a record.
    pub(super) fn states(&self) -> Vec<f64> {
        self.with_state.iter().map(|(_, law, p)| p[law.start]).collect()
    }

    pub(super) fn has_states(&self) -> bool {
        !self.with_state.is_empty()
    }

    /// Whether a force changes with time alone.
    pub(super) fn has_timed_forces(&self) -> bool {
        !self.timed.is_empty()
    }

    /// Inner states once the bodies have moved from `z` by the distances `dq`.
    pub(super) fn states_after(&self, z: &[f64], dq: impl Fn(usize) -> f64, out: &mut [f64]) {
        for ((out, z), (body, law, p)) in out.iter_mut().zip(z).zip(&self.with_state) {
            *out = (law.moved)(p, *z, dq(*body));
        }
    }

    /// Force that an input exerts on its body, with what its effects take of it.
    pub(super) fn input_force(&self, input: usize, force: f64, at: BodyAt) -> f64 {
        let own = self.loaded.iter().filter(|(k, _, _)| *k == input);
        force + own.map(|(_, law, p)| law(p, at, force)).sum::<f64>()
    }

    /// Forces on all bodies, without inputs, at a time since the start of the record and with the inner states `z`.
    #[inline(always)]
    pub(super) fn forces_into(
        &self,
        (q, v, z): (&[f64], &[f64], &[f64]),
        t_s: f64,
        force: &mut [f64],
        out: &mut SpringForces,
    ) {
        force.fill(0.0);
        out.tension.clear();
        for (body, law, p) in &self.on_body {
            force[*body] += law(p, BodyAt { q: q[*body], v: v[*body] });
        }
        for (body, law, p) in &self.timed {
            force[*body] += law(p, BodyAt { q: q[*body], v: v[*body] }, t_s);
        }
        for ((body, law, p), z) in self.with_state.iter().zip(z) {
            force[*body] += (law.force)(p, *z);
        }
        for (s, spring) in self.m.springs.iter().enumerate() {
            let (mut stretch, mut rate) = (0.0, 0.0);
            // Derivatives of the length with respect to the bodies' coordinates, in addition to the gains.
            out.slopes.clear();
            for e in &spring.ends {
                let gain = f64::from(e.sign) * self.values[e.gain];
                stretch += gain * q[e.body];
                rate += gain * v[e.body];
            }
            for on in &self.on_spring[s] {
                let (body, (length, slope)) = match on {
                    SpringEffect::Length { body, teeth, law, p } => (*body, law(p, *teeth, q[*body])),
                    SpringEffect::Chain { law, p } => {
                        let leader = self.m.chains.first().map_or(0, |c| c.leader);
                        let (length, slope) = law(p, self.chain_at(s, q));
                        (leader, (length, slope * self.leader_teeth / (2.0 * PI)))
                    }
                    SpringEffect::Force { .. } | SpringEffect::Loss { .. } => continue,
                };
                stretch += length;
                rate += slope * v[body];
                out.slopes.push((body, slope));
            }
            let (k, c) = self.springs[s];
            let declared = k * stretch + c * rate;
            let mut tension = declared;
            for on in &self.on_spring[s] {
                if let SpringEffect::Force { law, p } = on {
                    tension += law(p, SpanAt { stretch, rate, stiffness: k, force: tension });
                }
            }
            for e in &spring.ends {
                force[e.body] -= f64::from(e.sign) * self.values[e.gain] * tension;
            }
            for (body, slope) in &out.slopes {
                force[*body] -= slope * tension;
            }
            for on in &self.on_spring[s] {
                if let SpringEffect::Loss { law, p } = on {
                    for e in &spring.ends {
                        force[e.body] += law(p, tension, v[e.body]);
                    }
                }
            }
            for (law, p) in &self.chain_torque {
                if spring.links.is_some() {
                    let at = self.chain_at(s, q);
                    for e in &spring.ends {
                        // The joint bends at both ends of the span; each end takes half.
                        force[e.body] += 0.5 * law(p, at, v[e.body]);
                    }
                }
            }
            out.tension.push(tension);
        }
    }

    /// Highest order of an effect that depends on angle.
    pub(super) fn highest_order(&self) -> Option<f64> {
        let mut highest: Option<f64> = None;
        // Effects that are off need no steps.
        let on = |p: &PlacedEffect| {
            let rows = p.effect.parameters.iter().zip(&p.slots);
            rows.into_iter().any(|(r, s)| r.kind == Kind::Amplitude && self.values[*s] != r.off * r.unit)
        };
        for p in self.m.placed.iter().filter(|p| on(p)) {
            let order = match p.effect.highest_order {
                HighestOrder::None => continue,
                HighestOrder::Once => 1.0,
                HighestOrder::Parameter(parameter) => p.slots.get(parameter).map_or(1.0, |s| self.values[*s]),
                HighestOrder::Teeth => self.m.bodies.iter().filter_map(|b| b.teeth).max().map_or(1.0, f64::from),
            };
            highest = Some(highest.map_or(order, |h: f64| h.max(order)));
        }
        highest
    }

    /// Calls `look` with each force on a body that depends on its own motion alone, at a time and with these forces of the inputs.
    fn each_law_of_speed(&self, t_s: f64, load: impl Fn(usize) -> f64, mut look: impl FnMut(usize, LawOfSpeed)) {
        for (body, law, p) in &self.on_body {
            look(*body, &|at| law(p, at));
        }
        for (body, law, p) in &self.timed {
            look(*body, &|at| law(p, at, t_s));
        }
        for (k, law, p) in &self.loaded {
            let load = load(*k);
            look(self.m.inputs[*k].body, &|at| law(p, at, load));
        }
    }

    /// Steps that the coming sample of a machine without springs needs, by the friction at the speeds that may come in it, by inner states and
    /// by waves of the highest order: so many, or a share of one, that more would change no digit that a difference quotient of a fit sees.
    /// `inputs`: force of all inputs on each body at the begin and the end; `load`: the larger one of one input; `order`: the highest.
    pub(super) fn steps_of_sample(
        &self,
        (q, v, z): (&[f64], &[f64], &[f64]),
        (t_s, step_s): (f64, f64),
        (inputs, load): ([&[f64]; 2], impl Fn(usize) -> f64),
        order: Option<f64>,
        (force, rate, springs): (&mut [f64], &mut [f64], &mut SpringForces),
    ) -> f64 {
        self.forces_into((q, v, z), t_s, force, springs);
        let most = |i: usize| inputs.iter().map(|input| (force[i] + input[i]).abs()).fold(0.0, f64::max);
        let reach = |i: usize| MARGIN * step_s * most(i) / self.inertia[i];
        let highest = |i: usize| v[i].abs() + reach(i);
        rate.fill(0.0);
        self.each_law_of_speed(t_s, load, |body, law| {
            let near = (v[body].abs() - reach(body)).max(0.0) * v[body].signum();
            let d = 1e-6 * highest(body).max(1e-9);
            let at = |v: f64| law(BodyAt { q: q[body], v });
            let slope = |v: f64| (at(v + d) - at(v - d)).abs() / (2.0 * d);
            let is_steady = reach(body) < HARDLY_CHANGES * v[body].abs();
            let here = slope(v[body]);
            let steepest = if is_steady { here } else { here.max(slope(near)).max(slope(highest(body))) };
            rate[body] += steepest / self.inertia[body];
        });
        let mut states = 0.0_f64;
        for ((body, law, p), z) in self.with_state.iter().zip(z) {
            // A state that has come to its end stays there as long as the body moves on.
            let stays = v[*body].abs() > reach(*body) && ((law.moved)(p, *z, v[*body] * step_s) - z).abs() < STAYS;
            if !stays {
                let swings = libm::sqrt((law.stiffness)(p) / self.inertia[*body]);
                states = states.max(swings).max((law.fastest)(p, highest(*body)));
            }
        }
        let fastest = (0..v.len()).map(highest).fold(0.0, f64::max);
        let waves = order.map_or(0.0, |order| order * fastest / (2.0 * PI));
        let rate = rate.iter().copied().fold(0.0, f64::max);
        (step_s * rate.max(states) / EXACT_DECAY).max(step_s * waves / EXACT_WAVE)
    }

    /// Highest angular frequency, and highest slope of a force over speed divided by inertia [rad/s, 1/s].
    /// `load` is the largest force of each input.
    pub(super) fn rates(&self, speed: &[f64], load: &[f64], turns: bool) -> (f64, f64) {
        let mut omega2 = vec![0.0_f64; self.m.bodies.len()];
        let mut rate = vec![0.0_f64; self.m.bodies.len()];
        for (s, spring) in self.m.springs.iter().enumerate() {
            let (mut k, mut c) = self.springs[s];
            for on in &self.on_spring[s] {
                if let SpringEffect::Force { law, p } = on {
                    let at = |stretch, rate| SpanAt { stretch, rate, stiffness: 0.0, force: 0.0 };
                    k += law(p, at(1e-6, 0.0)).abs() / 1e-6;
                    c += law(p, at(0.0, 1e-6)).abs() / 1e-6;
                }
            }
            for e in &spring.ends {
                let g2 = self.values[e.gain] * self.values[e.gain];
                omega2[e.body] += g2 * k / self.inertia[e.body];
                rate[e.body] += g2 * c / self.inertia[e.body];
            }
        }
        for (body, law, p) in &self.with_state {
            // The state is followed as a wave is, so that its course is exact and not only stable.
            let follows = (law.fastest)(p, speed[*body]);
            omega2[*body] += (law.stiffness)(p) / self.inertia[*body] + follows * follows;
        }
        let load = |k: usize| load.get(k).copied().unwrap_or(0.0);
        self.each_law_of_speed(0.0, load, |body, law| {
            let top = speed[body].abs().max(1e-9);
            let d = 1e-6 * top;
            let slope =
                |v: f64| (law(BodyAt { q: 0.0, v: v + d }) - law(BodyAt { q: 0.0, v: v - d })).abs() / (2.0 * d);
            // A body that turns past marks never comes to rest.
            let least = if turns { 0.3 * top } else { 0.0 };
            rate[body] +=
                [least, 0.5 * (least + top), top].map(slope).into_iter().fold(0.0, f64::max) / self.inertia[body];
        });
        let free = |i: usize| self.m.bodies[i].motion == BodyMotion::Free;
        let most = |of: &[f64]| (0..of.len()).filter(|i| free(*i)).map(|i| of[i]).fold(0.0, f64::max);
        // Two bodies on one spring: the squared frequency is at most the sum of both squares.
        (libm::sqrt(2.0 * most(&omega2)), 2.0 * most(&rate))
    }
}

fn inertia(body: &Body, values: &[f64]) -> f64 {
    let whole = body.inertia.map_or(1.0, |slot| values[slot]);
    match body.minus {
        // Remainder of a body that was split: never zero.
        Some(far) => (whole - values[far]).max(1e-3 * whole),
        // An added body without inertia feels no force; this avoids a division by zero.
        None => whole.max(1e-300),
    }
}
