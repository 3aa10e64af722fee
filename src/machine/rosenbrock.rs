//! Steps of bodies whose friction is stiff near rest: RODAS, an L-stable Rosenbrock method of order 4 with an embedded result of order 3.
//!
//! ```text
//! (1 / (g h) - J) u_i = f(t + a_i h, y + sum a_ij u_j) + sum c_ij u_j / h + g_i h df/dt        y_1 = y + sum m_j u_j
//! ```
//! J are the slopes of each body's force over its own speed and place, by central differences; no spring joins the bodies. Where a body sticks, its
//! speed follows the force within microseconds, and one step crosses what explicit steps crawl through. The step follows the difference of
//! both results. Source: Hairer and Wanner, Solving Ordinary Differential Equations II, 1996, IV.7 and their program RODAS.

use super::forces::{PreparedMachine, SpringForces};
use super::simulate::Stage;

const STAGES: usize = 6;
const GAMMA: f64 = 0.25;
/// Moments of the stages as shares of the step, and factors of the slope over time.
const ALPHA: [f64; STAGES] = [0.0, 0.386, 0.21, 0.63, 1.0, 1.0];
const GAMMAS: [f64; STAGES] = [0.25, -0.1043, 0.1035, -0.036_200_000_000_000_23, 0.0, 0.0];
/// Weights a_ij: the state of stage i is y + sum a_ij u_j over the earlier stages j. That of the last stage plus u_6 is y_1.
const A: [&[f64]; STAGES] = [
    &[],
    &[1.544],
    &[0.946_678_528_081_582_6, 0.255_701_169_898_328_4],
    &[3.314_825_187_068_521, 2.896_124_015_972_201, 0.998_641_913_997_781_7],
    &[1.221_224_509_226_641, 6.019_134_481_288_629, 12.537_083_329_320_87, -0.687_886_036_105_895],
    &[1.221_224_509_226_641, 6.019_134_481_288_629, 12.537_083_329_320_87, -0.687_886_036_105_895, 1.0],
];
/// Weights c_ij: the right-hand side of stage i holds sum c_ij u_j / h over the earlier stages j.
const C: [&[f64]; STAGES] = [
    &[],
    &[-5.6688],
    &[-2.430_093_356_833_875, -0.206_359_915_709_191_5],
    &[-0.107_352_905_815_137_5, -9.594_562_251_023_355, -20.470_286_148_096_16],
    &[7.496_443_313_967_647, -10.246_804_314_643_52, -33.999_903_528_199_05, 11.708_908_932_061_6],
    &[
        8.083_246_795_921_522,
        -7.981_132_988_064_893,
        -31.521_594_328_743_71,
        16.319_305_431_231_36,
        -6.058_818_238_834_054,
    ],
];

/// Bounds on the change of a step, and its safety.
const GROWS: f64 = 5.0;
const SHRINKS: f64 = 0.2;
const SAFETY: f64 = 0.9;
/// Tries after which a way counts as too stiff.
const MOST_TRIES: usize = 2000;

/// What steps work with.
#[derive(Default)]
pub(super) struct RosenbrockBuffers {
    /// The stages: of places, and of speeds.
    uq: [Vec<f64>; STAGES],
    uv: [Vec<f64>; STAGES],
    q: Vec<f64>,
    v: Vec<f64>,
    speed: Vec<f64>,
    rate: Vec<f64>,
    input: Vec<f64>,
    force: Vec<f64>,
    /// Speed and acceleration at the begin of the step, the slopes of the acceleration over speed and over place, and over time.
    speed_now: Vec<f64>,
    rate_now: Vec<f64>,
    slope: Vec<f64>,
    slope_of_place: Vec<f64>,
    drift: Vec<f64>,
    springs: SpringForces,
    /// Step that the end of the last way has proposed, as a share of a way.
    proposed: Option<f64>,
}

/// What is advanced, and how exactly.
pub(super) struct NodeWay<'a> {
    pub free: &'a [bool],
    /// Begin and length [s].
    pub t_s: f64,
    pub h: f64,
    /// Whether forces change with time.
    pub is_driven: bool,
    /// Whether they change with a place.
    pub is_uneven: bool,
    /// Largest error of a step, for the speed of each body.
    pub tolerance: &'a [f64],
}

impl RosenbrockBuffers {
    fn resize(&mut self, n: usize) {
        let all = self.uq.iter_mut().chain(&mut self.uv);
        let others = [&mut self.q, &mut self.v, &mut self.speed, &mut self.rate, &mut self.input, &mut self.force];
        let at_begin = [&mut self.speed_now, &mut self.rate_now, &mut self.drift];
        let slopes = [&mut self.slope, &mut self.slope_of_place];
        all.chain(others).chain(at_begin).chain(slopes).for_each(|column| column.resize(n, 0.0));
    }

    /// Speeds and accelerations of all bodies at the state in `q` and `v`, a share `x` of the way on.
    fn evaluate(&mut self, ready: &PreparedMachine, way: &NodeWay, x: f64, at: Stage) {
        self.input.fill(0.0);
        at(x, &self.q, &mut self.v, &mut self.input);
        ready.forces_into((&self.q, &self.v, &[]), way.t_s + x * way.h, &mut self.force, &mut self.springs);
        self.speed.copy_from_slice(&self.v);
        for i in 0..self.v.len() {
            self.rate[i] = if way.free[i] { (self.force[i] + self.input[i]) / ready.inertia[i] } else { 0.0 };
        }
    }
}

/// Advances all bodies along a way. `at` gives input forces and prescribed speeds at a share of it. Returns the steps it took, or those
/// after which it gave up.
pub(super) fn advance(
    ready: &PreparedMachine,
    (q, v): (&mut [f64], &mut [f64]),
    way: &NodeWay,
    work: &mut RosenbrockBuffers,
    at: Stage,
) -> Result<usize, usize> {
    let n = q.len();
    work.resize(n);
    let (mut done, mut step) = (0.0_f64, work.proposed.unwrap_or(1.0));
    for tries in 1..=MOST_TRIES {
        // The last step ends where the way does.
        let is_last = done + 1.0001 * step >= 1.0;
        let proposed = step;
        if is_last {
            step = 1.0 - done;
        }
        let error = one_step(ready, (q, v), way, (done, step), work, &mut *at);
        let factor = if error > 0.0 { SAFETY / libm::sqrt(libm::sqrt(error)) } else { GROWS };
        let factor = if factor.is_finite() { crate::units::within(factor, SHRINKS, GROWS) } else { SHRINKS };
        if error <= 1.0 {
            // The last stages left the new state.
            q.copy_from_slice(&work.q);
            v.copy_from_slice(&work.v);
            if is_last {
                work.proposed = Some((step * factor).max(proposed).min(1.0));
                return Ok(tries);
            }
            done += step;
        }
        step *= factor;
    }
    Err(MOST_TRIES)
}

/// Leaves the state after one step in the buffers; returns its error over what is allowed.
fn one_step(
    ready: &PreparedMachine,
    (q, v): (&[f64], &[f64]),
    way: &NodeWay,
    (done, step): (f64, f64),
    work: &mut RosenbrockBuffers,
    at: Stage,
) -> f64 {
    let (n, h) = (q.len(), step * way.h);
    // Slopes over speed, by central differences that are short against what the speed may change by.
    let apart = |i: usize| SLOPE_SHARE * v[i].abs().max(1e2 * way.tolerance[i]);
    for side in [1.0, -1.0] {
        work.q.copy_from_slice(q);
        for i in 0..n {
            work.v[i] = v[i] + side * apart(i);
        }
        work.evaluate(ready, way, done, &mut *at);
        for i in 0..n {
            let rate = work.rate[i] / (2.0 * apart(i));
            work.slope[i] = if side > 0.0 { rate } else { work.slope[i] - rate };
        }
    }
    work.v.copy_from_slice(v);
    for side in [1.0, -1.0] {
        if !way.is_uneven {
            break;
        }
        for i in 0..n {
            work.q[i] = q[i] + side * PLACE_APART;
        }
        work.evaluate(ready, way, done, &mut *at);
        for i in 0..n {
            let rate = work.rate[i] / (2.0 * PLACE_APART);
            work.slope_of_place[i] = if side > 0.0 { rate } else { work.slope_of_place[i] - rate };
        }
    }
    work.q.copy_from_slice(q);
    if way.is_driven {
        work.evaluate(ready, way, done + DRIFT_SHARE * step, &mut *at);
        work.drift.copy_from_slice(&work.rate);
        work.v.copy_from_slice(v);
    }
    work.evaluate(ready, way, done, &mut *at);
    work.speed_now.copy_from_slice(&work.speed);
    work.rate_now.copy_from_slice(&work.rate);
    for i in 0..n {
        work.drift[i] = if way.is_driven { (work.drift[i] - work.rate_now[i]) / (DRIFT_SHARE * h) } else { 0.0 };
    }
    for stage in 0..STAGES {
        if stage > 0 {
            for i in 0..n {
                let sum = |u: &[Vec<f64>; STAGES]| A[stage].iter().zip(u).map(|(a, u)| a * u[i]).sum::<f64>();
                work.q[i] = q[i] + sum(&work.uq);
                work.v[i] = v[i] + sum(&work.uv);
            }
            work.evaluate(ready, way, done + ALPHA[stage] * step, &mut *at);
        }
        for i in 0..n {
            let sum = |u: &[Vec<f64>; STAGES]| C[stage].iter().zip(u).map(|(c, u)| c * u[i]).sum::<f64>() / h;
            let (speed, rate) =
                if stage == 0 { (work.speed_now[i], work.rate_now[i]) } else { (work.speed[i], work.rate[i]) };
            let by_place = if way.is_uneven { work.slope_of_place[i] } else { 0.0 };
            let moved = GAMMA * h * (speed + sum(&work.uq));
            let right = rate + sum(&work.uv) + GAMMAS[stage] * h * work.drift[i] + by_place * moved;
            // The speed is the slope of the place.
            let own = 1.0 / (GAMMA * h) - work.slope[i] - by_place * GAMMA * h;
            let u = if way.free[i] { right / own } else { 0.0 };
            work.uq[stage][i] = moved + GAMMA * h * u;
            work.uv[stage][i] = u;
        }
    }
    let last = STAGES - 1;
    let mut error = 0.0_f64;
    for i in 0..n {
        work.q[i] += work.uq[last][i];
        work.v[i] = if way.free[i] { work.v[i] + work.uv[last][i] } else { v[i] };
        // A prescribed motion is no result of the step.
        if !way.free[i] {
            continue;
        }
        let off = work.uv[last][i].abs().max(work.uq[last][i].abs() / way.h) / way.tolerance[i];
        error = if off.is_finite() { error.max(off) } else { f64::INFINITY };
    }
    error
}

/// Share of a step over which forces are differenced in time.
const DRIFT_SHARE: f64 = 1e-3;
/// Distances of central differences: as a share of the speed, and of places that forces change with [rad].
const SLOPE_SHARE: f64 = 1e-5;
const PLACE_APART: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;
    use crate::machine::simulate::MAX_STEPS;

    const DISC: &str = r#"
fidelity = "lumped"
[rotors.disc]
inertia_kg_m2 = 0.01
[loads.friction.disc]
torque_nm = 0.5
stick_speed_rad_s = 0.2
[loads.harmonic.disc]
torque_nm = 0.2
order = 3.0
phase_deg = 20.0
[inputs.torque.disc]
[sensors.tachometer.disc]
"#;

    fn disc() -> Machine {
        Machine::parse("disc.toml", DISC, &[]).expect("a machine")
    }

    /// Place and speed after `h` seconds in equal steps, with a torque that rises from 0.1 to 1 N m.
    fn after(steps: usize, h: f64) -> [f64; 2] {
        let m = disc();
        let ready = PreparedMachine::new(&m, &m.values, MAX_STEPS);
        let mut work = RosenbrockBuffers::default();
        work.resize(1);
        let (mut q, mut v) = ([0.3], [-1.0]);
        let way = NodeWay { free: &[true], t_s: 0.0, h, is_driven: true, is_uneven: true, tolerance: &[1e-8] };
        let mut at = |x: f64, _: &[f64], _: &mut [f64], force: &mut [f64]| force[0] += 0.1 + 0.9 * x;
        for i in 0..steps {
            one_step(&ready, (&q, &v), &way, (i as f64 / steps as f64, 1.0 / steps as f64), &mut work, &mut at);
            q.copy_from_slice(&work.q);
            v.copy_from_slice(&work.v);
        }
        [q[0], v[0]]
    }

    #[test]
    fn errors_fall_with_the_fourth_power_of_the_step() {
        let exact = after(4096, 0.04);
        let error = |steps| (0..2).map(|i| (after(steps, 0.04)[i] - exact[i]).abs()).collect::<Vec<f64>>();
        let (coarse, fine) = (error(64), error(128));
        for i in 0..2 {
            let order = libm::log2(coarse[i] / fine[i]);
            assert!((3.6..5.0).contains(&order), "{i}: {order}, {} {}", coarse[i], fine[i]);
        }
    }

    /// A disc that sticks creeps with T / sqrt(1 - T^2) of its stick speed, T the torque over the friction.
    #[test]
    fn a_disc_that_sticks_takes_few_steps_however_stiff_it_is() {
        let mut m = Machine::parse("disc.toml", DISC, &["loads.harmonic.disc.torque_nm=0".into()]).expect("a machine");
        let stick = m.slot("loads.friction.disc.stick_speed_rad_s").expect("a number");
        for stick_speed in [1e-2, 1e-4, 1e-6] {
            m.values[stick] = stick_speed;
            let ready = PreparedMachine::new(&m, &m.values, MAX_STEPS);
            let (mut q, mut v) = ([0.0], [0.0]);
            let way =
                NodeWay { free: &[true], t_s: 0.0, h: 0.01, is_driven: false, is_uneven: false, tolerance: &[1e-8] };
            let mut at = |_: f64, _: &[f64], _: &mut [f64], force: &mut [f64]| force[0] += 0.3;
            let mut work = RosenbrockBuffers::default();
            let first = advance(&ready, (&mut q, &mut v), &way, &mut work, &mut at).expect("it ends");
            let next = advance(&ready, (&mut q, &mut v), &way, &mut work, &mut at).expect("it ends");
            let creep = stick_speed * 0.6 / 0.8;
            assert!((v[0] - creep).abs() < 1e-8 + 1e-6 * creep, "{stick_speed}: {}", v[0]);
            assert!(first < 60 && next <= 2, "{stick_speed}: {first} {next}");
        }
    }
}
