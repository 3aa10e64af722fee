//! Samples of a machine without springs, each crossed in the steps that it needs by itself: few where friction is soft, implicit ones or halves
//! of halves where a body may come to rest.

use super::forces::PreparedMachine;
use super::rosenbrock::{self, NodeWay, RosenbrockBuffers};
use super::simulate::{Rk4Buffers, Stage, Task, rk4, top_loads};

/// Explicit steps between two nodes at most: more take longer than implicit ones.
const MOST_EXPLICIT: f64 = 16.0;
/// Implicit steps between two nodes at most, in the mean over a run, and those that a run has beside them.
const MEAN_IMPLICIT: usize = 200;
const SPARE_IMPLICIT: usize = 5000;
/// The least speed that counts as high [rad/s, m/s].
const LEAST_SPEED: f64 = 1e-9;
/// Error of an implicit step over the highest speed: less than a difference quotient of a fit sees.
const IMPLICIT_ERROR: f64 = 1e-8;

/// How samples near rest are crossed.
pub(super) struct NearRest {
    buffers: RosenbrockBuffers,
    /// Whether forces change between two nodes.
    is_driven: bool,
    /// Speed that counts as high for each body, and the error of a step that it allows.
    highest: Vec<f64>,
    tolerance: Vec<f64>,
    refinement: f64,
    /// Highest order of a wave.
    pub(super) order: Option<f64>,
    /// What each body's steps are found with.
    pub(super) rate: Vec<f64>,
    /// Most explicit steps, where there are no others: implicit ones know no inner states.
    most: Option<usize>,
    /// Implicit steps so far.
    taken: usize,
}

impl NearRest {
    pub(super) fn new(ready: &PreparedMachine, task: &Task, h: f64, is_smooth: bool, most: Option<usize>) -> NearRest {
        let mut highest = vec![LEAST_SPEED; ready.m.bodies.len()];
        // What the largest force gives in the time between two nodes.
        for (input, load) in ready.m.inputs.iter().zip(top_loads(ready, task)) {
            highest[input.body] = highest[input.body].max(h * load / ready.inertia[input.body]);
        }
        NearRest {
            buffers: RosenbrockBuffers::default(),
            is_driven: is_smooth || ready.has_timed_forces(),
            tolerance: vec![0.0; highest.len()],
            rate: vec![0.0; highest.len()],
            highest,
            refinement: ready.m.refinement as f64,
            order: ready.highest_order(),
            most,
            taken: 0,
        }
    }

    /// Explicit steps to the next node; 0: implicit ones, or halves of halves. `reach`: what each body's speed may change by.
    pub(super) fn steps(&mut self, needed: f64, v: &[f64], reach: impl Fn(usize) -> f64) -> usize {
        for (i, v) in v.iter().enumerate() {
            self.highest[i] = self.highest[i].max(v.abs()).max(reach(i));
            self.tolerance[i] = IMPLICIT_ERROR / self.refinement * self.highest[i];
        }
        // Few numbers of steps, so that few changes of a machine's numbers change them.
        let steps = libm::ceil(self.refinement * needed).max(1.0);
        let is_many = steps > if self.most.is_some() { 1.0 } else { MOST_EXPLICIT };
        if is_many { 0 } else { (steps as usize).next_power_of_two() }
    }

    /// Crosses the way from node number `node` to the next one. An error says how many steps it would take.
    pub(super) fn cross(
        &mut self,
        ready: &PreparedMachine,
        (q, v, z): (&mut [f64], &mut [f64], &mut [f64]),
        (t, h, share): (f64, f64, &std::cell::Cell<(f64, f64)>),
        work: &mut Rk4Buffers,
        (at, load): (Stage, &dyn Fn(usize) -> f64),
        node: usize,
    ) -> Result<(), usize> {
        if self.most.is_some() {
            self.halve(ready, (q, v, z), (t, h, share), work, (at, load));
            return Ok(());
        }
        let way = NodeWay {
            free: &work.free,
            t_s: t,
            h,
            is_driven: self.is_driven,
            is_uneven: self.order.is_some(),
            tolerance: &self.tolerance,
        };
        self.taken += rosenbrock::advance(ready, (q, v), &way, &mut self.buffers, at)?;
        if self.taken > SPARE_IMPLICIT + MEAN_IMPLICIT * node { Err(MEAN_IMPLICIT) } else { Ok(()) }
    }

    /// Crosses the way between two nodes in explicit steps: each is the longest half of a half that needs no other, or the shortest of all.
    fn halve(
        &mut self,
        ready: &PreparedMachine,
        (q, v, z): (&mut [f64], &mut [f64], &mut [f64]),
        (t, h, share): (f64, f64, &std::cell::Cell<(f64, f64)>),
        work: &mut Rk4Buffers,
        (at, load): (Stage, &dyn Fn(usize) -> f64),
    ) {
        let whole = self.most.unwrap_or(1).next_power_of_two();
        let (mut done, mut length) = (0, whole);
        let [mut begin, mut end, mut force] = [(); 3].map(|()| vec![0.0; q.len()]);
        while done < whole {
            let now = t + h * done as f64 / whole as f64;
            while done % length != 0 {
                length /= 2;
            }
            loop {
                let part = length as f64 / whole as f64;
                share.set((done as f64 / whole as f64, part));
                if length == 1 {
                    break;
                }
                for (x, input) in [(0.0, &mut begin), (1.0, &mut end)] {
                    input.fill(0.0);
                    at(x, q, v, input);
                }
                let forces = (force.as_mut_slice(), self.rate.as_mut_slice(), &mut work.springs);
                let inputs = ([begin.as_slice(), end.as_slice()], load);
                let needed = ready.steps_of_sample((q, v, z), (now, h * part), inputs, self.order, forces);
                if self.refinement * needed <= 1.0 {
                    break;
                }
                length /= 2;
            }
            let part = length as f64 / whole as f64;
            rk4(ready, (&mut *q, &mut *v, &mut *z), (now, h * part), work, (&mut *at, None));
            done += length;
            length = (2 * length).min(whole);
        }
    }
}
