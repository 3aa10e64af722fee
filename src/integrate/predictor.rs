//! The scheme of predictor and corrector, with steps of its own that end where a contact begins or ends.
//!
//! ```text
//! predict   a = a_k + (a_k - a_(k-1)) t / t_(k-1) at the end, linear in between        Adams and Bashforth, second order
//! correct   a = a_p, the acceleration by the forces there, linear in between           Adams and Moulton
//! error     |v corrected - v predicted| / 6                                            Milne's device, for t = t_(k-1)
//! ```
//! v and q are the integrals of these lines. Forces are evaluated once more where a step ends. A step whose error is above the tolerance is
//! taken again with a shorter one. Where the set of contacts that carry a force changes within a step, the change is bracketed by halving, up
//! to a moment of 2^-20 of the drive's step; the scheme steps up to it, over it, and begins anew behind it: a force may jump there. Sources:
//! Hairer, Norsett and Wanner 1993, sections III.1 and III.5; roots at contacts as in multibody programs, for example Schaffner et al.
//!
//! A step of the drive is the distance of nodes that are recorded. It holds as many steps of the scheme as the tolerance asks for, and no
//! memory passes from one to the next, so that a run goes on from any node to the same bits.

use super::StepError;
use super::instant::InstantForces;
use super::scheme::{SchemeSummary, unsolved};
use crate::model::Model;

/// The next step over the one that the error would bear.
const CAUTION: f64 = 0.9;
/// A step grows and shrinks by this at most.
const MOST_GROWTH: f64 = 4.0;
/// A step in which the chain comes apart is taken again with this part of it.
const SHORTER: u64 = 8;
/// Steps within one of the drive at most.
const MOST_STEPS: u32 = 100_000;
/// Difference of predictor and corrector over the error, for steps of one length.
const MILNE: f64 = 6.0;

/// A step of the scheme, with what it keeps from one to the next.
pub(super) struct PredictorStep {
    window_s: f64,
    step_s: f64,
    tolerance_m_s: f64,
    arms_m: Vec<f64>,
    /// What the last step has lost and what was done in it, beside the powers of its first node over its whole length.
    losses: Vec<f64>,
    powers: [Vec<f64>; 2],
    touching: [Vec<bool>; 2],
    pub(super) told: SchemeSummary,
}

/// The motion at a moment of a step, `ticks` windows after its beginning.
#[derive(Clone)]
struct StepMoment {
    ticks: u64,
    moved: Vec<f64>,
    speeds: Vec<f64>,
    accelerations: Vec<f64>,
}

/// An acceleration before the last moment, and the time that has passed since [s].
type Past = (Vec<f64>, f64);

impl StepMoment {
    /// The motion `ticks` windows later, where the acceleration changes by so much per second.
    fn later(&self, ticks: u64, window_s: f64, change_per_s: &[f64]) -> StepMoment {
        let time_s = ticks as f64 * window_s;
        let mut next = self.clone();
        next.ticks += ticks;
        for (i, change) in change_per_s.iter().enumerate() {
            let (a, change) = (self.accelerations[i], change * time_s);
            next.speeds[i] += time_s * (a + 0.5 * change);
            next.moved[i] += time_s * (self.speeds[i] + time_s * (0.5 * a + change * (1.0 / 6.0)));
            next.accelerations[i] = a + change;
        }
        next
    }

    /// How its acceleration has changed since another one [1/s].
    fn change_since(&self, past: Option<&Past>) -> Vec<f64> {
        match past {
            Some((past, time_s)) => self.accelerations.iter().zip(past).map(|(a, past)| (a - past) / time_s).collect(),
            None => vec![0.0; self.accelerations.len()],
        }
    }

    fn parts(&self) -> [&[f64]; 3] {
        [&self.moved, &self.speeds, &self.accelerations]
    }
}

impl PredictorStep {
    pub(super) fn new(model: &Model, instant: &InstantForces, tolerance_m_s: f64) -> PredictorStep {
        PredictorStep {
            window_s: instant.window_s(),
            step_s: model.step_s,
            tolerance_m_s,
            arms_m: instant.freedoms.arms_m(model),
            losses: Vec::new(),
            powers: Default::default(),
            touching: Default::default(),
            told: SchemeSummary::PredictorCorrector { own_steps: 0, changes: 0 },
        }
    }

    /// What was lost and done within the last step, in the order of [`InstantForces::add_to_accounts`]. The powers of its first node over its
    /// whole length are not in it.
    pub(super) fn losses(&self) -> &[f64] {
        &self.losses
    }

    /// Speeds and accelerations at the end of a step, from those at its beginning.
    pub(super) fn solve(
        &mut self,
        instant: &mut InstantForces,
        [speeds, accelerations]: [&[f64]; 2],
    ) -> Result<[Vec<f64>; 2], StepError> {
        let whole = instant.ticks();
        let (moved, speeds, accelerations) = (vec![0.0; speeds.len()], speeds.to_vec(), accelerations.to_vec());
        let mut at = StepMoment { ticks: 0, moved, speeds, accelerations };
        at.accelerations = instant.accelerations(0, at.parts())?;
        self.begin(instant);
        let mut past: Option<Past> = None;
        let (mut length, mut usual) = (whole, whole);
        for _ in 0..MOST_STEPS {
            length = length.clamp(1, whole - at.ticks);
            // A line through two moments that are close to each other leads far off.
            let is_long = |past: &&Past| past.1 * MOST_GROWTH > length as f64 * self.window_s;
            let change = at.change_since(past.as_ref().filter(is_long));
            let predicted = at.later(length, self.window_s, &change);
            let forces = match instant.accelerations(predicted.ticks, predicted.parts()) {
                Ok(forces) => forces,
                // A chain that comes apart in a long step may hold in a shorter one.
                Err(_) if length > 1 => {
                    length = (length / SHORTER).max(1);
                    usual = length;
                    continue;
                }
                Err(e) => return Err(e),
            };
            if length > 1 && self.differs(instant) {
                length = self.last_before_change(instant, &at, &change, length)?.max(1);
                continue;
            }
            let time_s = length as f64 * self.window_s;
            let over = self.error(&predicted, &forces, time_s) / self.tolerance_m_s;
            if over > 1.0 && length > 1 {
                length = next_length(length, over);
                usual = length;
                continue;
            }
            let corrected: Vec<f64> = forces.iter().zip(&at.accelerations).map(|(f, a)| (f - a) / time_s).collect();
            let mut next = at.later(length, self.window_s, &corrected);
            next.accelerations = instant.accelerations(next.ticks, next.parts())?;
            let is_same = self.take(instant, time_s);
            instant.keep(next.ticks);
            if let SchemeSummary::PredictorCorrector { own_steps, changes } = &mut self.told {
                (*own_steps, *changes) = (*own_steps + 1, *changes + u64::from(!is_same));
            }
            past = is_same.then_some((at.accelerations, time_s));
            at = next;
            if at.ticks == whole {
                self.end();
                return Ok([at.speeds, at.accelerations]);
            }
            // A step that was cut at a change says nothing of the next one.
            usual = if length < usual { usual } else { next_length(length, over) };
            length = usual;
        }
        Err(unsolved(instant.time_s(), "its contacts".into(), f64::NAN))
    }

    /// Powers and contacts of the first node.
    fn begin(&mut self, instant: &mut InstantForces) {
        instant.powers(&mut self.powers[0]);
        // Its powers stand in the accounts for the whole step, half of which belongs to the step before.
        self.losses.clear();
        self.losses.extend(self.powers[0].iter().map(|power| -0.5 * self.step_s * power));
        instant.touching(&mut self.touching[0]);
        instant.keep(0);
    }

    /// Books a step, whose end has been evaluated; returns whether the same contacts carry a force as at its beginning.
    fn take(&mut self, instant: &mut InstantForces, time_s: f64) -> bool {
        let [before, now] = &mut self.powers;
        instant.powers(now);
        for (sum, (a, b)) in self.losses.iter_mut().zip(before.iter().zip(now.iter())) {
            *sum += 0.5 * time_s * (a + b);
        }
        self.powers.swap(0, 1);
        let is_same = !self.differs(instant);
        if !is_same {
            let [last, now] = &self.touching;
            instant.add_parted([last, now], &mut self.losses);
        }
        self.touching.swap(0, 1);
        is_same
    }

    /// Half a step of the last node's powers will stand in the accounts by its own step.
    fn end(&mut self) {
        for (sum, power) in self.losses.iter_mut().zip(&self.powers[0]) {
            *sum -= 0.5 * self.step_s * power;
        }
    }

    /// Whether other contacts carry a force at the trial than at the last moment.
    fn differs(&mut self, instant: &InstantForces) -> bool {
        let [last, now] = &mut self.touching;
        instant.touching(now);
        now != last
    }

    /// The last window of a step up to which its contacts are those of its beginning.
    fn last_before_change(
        &mut self,
        instant: &mut InstantForces,
        at: &StepMoment,
        change: &[f64],
        length: u64,
    ) -> Result<u64, StepError> {
        let (mut same, mut other) = (0, length);
        while other - same > 1 {
            let middle = same + (other - same) / 2;
            let there = at.later(middle, self.window_s, change);
            instant.accelerations(there.ticks, there.parts())?;
            if self.differs(instant) { other = middle } else { same = middle }
        }
        Ok(same)
    }

    /// Largest error of a speed [m/s], of what turns at its arm.
    fn error(&self, predicted: &StepMoment, forces: &[f64], time_s: f64) -> f64 {
        let apart = |i: usize| (forces[i] - predicted.accelerations[i]).abs() * self.arms_m[i];
        0.5 * time_s / MILNE * (0..forces.len()).map(apart).fold(0.0, largest)
    }
}

/// The larger of two sizes; what is no number is larger than all.
pub(super) fn largest(most: f64, size: f64) -> f64 {
    if size.is_nan() { f64::INFINITY } else { most.max(size) }
}

/// The next step, from the error of the last one over the tolerance. The error grows with the third power.
fn next_length(length: u64, over: f64) -> u64 {
    let factor = (CAUTION / libm::cbrt(over.max(1e-9))).clamp(1.0 / MOST_GROWTH, MOST_GROWTH);
    ((length as f64 * factor) as u64).max(1)
}
