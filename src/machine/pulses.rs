//! A pulse pickup on a lumped machine. A pulse occurs where the cubic between two nodes (values and slopes) crosses a
//! mark; its error is of the order of the integration scheme.

use super::forces::PreparedMachine;
use super::simulate::{InitialState, Rk4Buffers, RunError, clock, rk4};
use super::{BodyMotion, Reads, Target};
use crate::effects::{MarkLaw, Physics};
use std::f64::consts::PI;

/// Runs the machine and counts pulses. Values are the natural logarithms of the intervals.
pub(super) fn pulses(
    ready: &PreparedMachine,
    (start, start_s): (&InitialState, f64),
    (intervals, first): (usize, usize),
    (interval_s, longest_s): (f64, f64),
    channels: &[usize],
) -> Result<Vec<Vec<f64>>, RunError> {
    let m = ready.m;
    let Some(sensor) = channels.first() else { return Ok(Vec::new()) };
    let Reads::Pulses { body, marks } = m.sensors[*sensor].reads else {
        return Ok(vec![vec![f64::NAN; intervals]]);
    };
    let body = ready.stands_for[body];
    let laws: Vec<(MarkLaw, Vec<f64>)> = m
        .placed
        .iter()
        .filter(|p| p.target == Target::Sensor(*sensor))
        .filter_map(|p| match p.effect.physics {
            Physics::Marks(law) => Some((law, p.slots.iter().map(|s| ready.values[*s]).collect())),
            Physics::BodyForce(_)
            | Physics::TimedForce(_)
            | Physics::LoadedForce(_)
            | Physics::StateForce(_)
            | Physics::SpanLength(_)
            | Physics::ChainLength(_)
            | Physics::ChainTorque(_)
            | Physics::SpanForce(_)
            | Physics::SpanLoss(_)
            | Physics::SecondBody { .. }
            | Physics::Motion(_)
            | Physics::Input(_)
            | Physics::Signal(_)
            | Physics::Clock(_)
            | Physics::OwnClock(_)
            | Physics::Intake
            | Physics::LinksOnly => None,
        })
        .collect();
    // Position and delay of every mark.
    let table: Vec<(f64, f64)> = (0..marks)
        .map(|mark| laws.iter().map(|(law, p)| law(p, mark)).fold((0.0, 0.0), |(a, b), (c, d)| (a + c, b + d)))
        .collect();
    let gap = 2.0 * PI / marks as f64;
    let place = |k: usize| {
        let mark = (first + k) % marks;
        (gap * ((first + k) as f64 + table[mark].0), table[mark].1)
    };
    let h = step_s(ready, start, interval_s, marks);
    if h < interval_s / ready.max_steps {
        return Err(RunError::Stiff { steps: interval_s / h });
    }
    let h = h / m.refinement as f64;
    let (mut q, mut v) = (start.q.clone(), start.v.clone());
    q[body] = place(0).0;
    let mut z = ready.states();
    let mut work = Rk4Buffers::new(m, z.len());
    let mut out = Vec::with_capacity(intervals);
    let clock = 1.0 + clock(ready.m, ready.values);
    let (mut t, mut k) = (0.0_f64, 1);
    let mut before = place(0).1;
    let mut since = 0.0;
    let mut nothing = |_: f64, _: &[f64], v: &mut [f64], _: &mut [f64]| {
        for (i, b) in m.bodies.iter().enumerate() {
            if let BodyMotion::Constant(slot) = b.motion {
                v[i] = ready.values[slot];
            }
        }
    };
    // Nearly at rest: the next pulse would come far later than any measured one.
    let patience = 4.0 * longest_s.max(interval_s) + 2.0 * h;
    while out.len() < intervals {
        let (qa, va) = (q[body], v[body]);
        rk4(ready, (&mut q, &mut v, &mut z), (start_s + t, h), &mut work, (&mut nothing, None));
        let (qb, vb) = (q[body], v[body]);
        if !(qb.is_finite() && vb.is_finite()) {
            return Err(RunError::Diverged { t_s: t });
        }
        while out.len() < intervals && place(k).0 <= qb {
            let (target, delay) = place(k);
            let now = t + crossing(qa, va, qb, vb, h, target) + delay;
            out.push(libm::log(((now - before) * clock).max(1e-300)));
            before = now;
            k += 1;
            since = t;
        }
        t += h;
        if t - since > patience {
            return Err(RunError::NoPulse { t_s: t, pulses: out.len() });
        }
    }
    Ok(vec![out])
}

/// Time after a node at which the cubic through both nodes reaches `target` [s].
fn crossing(qa: f64, va: f64, qb: f64, vb: f64, h: f64, target: f64) -> f64 {
    let value = |x: f64| {
        let (x2, x3) = (x * x, x * x * x);
        qa * (2.0 * x3 - 3.0 * x2 + 1.0)
            + h * va * (x3 - 2.0 * x2 + x)
            + qb * (3.0 * x2 - 2.0 * x3)
            + h * vb * (x3 - x2)
    };
    let slope = |x: f64| {
        qa * (6.0 * x * x - 6.0 * x)
            + h * va * (3.0 * x * x - 4.0 * x + 1.0)
            + qb * (6.0 * x - 6.0 * x * x)
            + h * vb * (3.0 * x * x - 2.0 * x)
    };
    let (mut low, mut high) = (0.0, 1.0);
    let mut x = if qb > qa { ((target - qa) / (qb - qa)).clamp(0.0, 1.0) } else { 0.5 };
    // Newton's method within a bracket; its quadratic convergence reaches rounding in a few iterations.
    for _ in 0..30 {
        let error = value(x) - target;
        if error > 0.0 {
            high = x;
        } else {
            low = x;
        }
        let newton = x - error / slope(x);
        if (newton - x).abs() < 1e-12 {
            return newton * h;
        }
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        x = next;
    }
    x * h
}

/// Largest suitable step: a revolution if no effect depends on angle, else ten steps for a wave of the highest order.
pub(super) fn step_s(ready: &PreparedMachine, start: &InitialState, interval_s: f64, marks: usize) -> f64 {
    let turn_s = interval_s * marks as f64;
    let coarse = match ready.highest_order() {
        Some(order) => turn_s / (10.0 * order),
        None => turn_s,
    };
    let (omega, rate) = ready.rates(&start.v, &[], true);
    coarse.min(0.2 / omega.max(1e-300)).min(0.1 / rate.max(1e-300))
}
