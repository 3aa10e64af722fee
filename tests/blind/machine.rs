//! A random machine, and its declaration.

use super::numbers::Random;
use std::f64::consts::PI;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    One,
    Two,
    Chain,
}

/// The true drive without effects.
#[derive(Clone, Debug)]
pub(super) struct Machine {
    pub(super) kind: Kind,
    pub(super) slides: bool,
    pub(super) inertia: [f64; 2],
    pub(super) viscous: [f64; 2],
    pub(super) constant: [f64; 2],
    pub(super) stiffness: f64,
    pub(super) damping: f64,
    pub(super) radius: [f64; 2],
    pub(super) teeth: [u32; 2],
    pub(super) links: u32,
    /// First and last link of the span at the start, if the file states them.
    pub(super) span_links: Option<(u32, u32)>,
    /// Torque or force per unit of the input's column.
    pub(super) gain: f64,
    pub(super) rate_hz: f64,
    /// Inputs stay constant until the next sample.
    pub(super) hold: bool,
    /// Typical speed of the first body, typical torque.
    pub(super) speed: f64,
    pub(super) torque: f64,
    pub(super) channels: usize,
}

/// Requirements of a case on its random machine.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wish {
    pub(super) teeth: Option<[u32; 2]>,
    /// Never reverses.
    pub(super) one_way: bool,
    /// Reverses, but not often.
    pub(super) biased: bool,
    /// One record at one speed.
    pub(super) one_speed: bool,
    /// No gauge.
    pub(super) one_channel: bool,
}

pub(super) fn machine(kind: Kind, wish: Wish, random: &mut Random) -> Machine {
    match kind {
        Kind::Chain => chain_machine(wish, random),
        _ => driven_machine(kind, wish, random),
    }
}

fn driven_machine(kind: Kind, wish: Wish, random: &mut Random) -> Machine {
    let rate_hz = random.log_between(100.0, 500.0).round();
    let slides = kind == Kind::One && !wish.biased && random.chance(0.3);
    let (speed, first) = match slides {
        true => (random.log_between(0.05, 1.0), random.log_between(0.5, 20.0)),
        false => (random.log_between(5.0, (0.15 * rate_hz).min(80.0)), random.log_between(1e-4, 1e-1)),
    };
    let inertia = [first, if kind == Kind::Two { first * random.log_between(0.3, 3.0) } else { 0.0 }];
    let whole: f64 = inertia.iter().sum();
    // A thousand samples contain 4 to 20 time constants.
    let loss = whole / (1000.0 / rate_hz * random.between(0.05, 0.25));
    let lossy = if kind == Kind::Two { random.below(2) } else { 0 };
    let mut viscous = [0.0; 2];
    viscous[lossy] = loss;
    let reduced = if kind == Kind::Two { inertia[0] * inertia[1] / whole } else { 0.0 };
    let omega = 2.0 * PI * rate_hz * random.log_between(0.025, 0.1);
    Machine {
        kind,
        slides,
        inertia,
        viscous,
        constant: [0.0; 2],
        stiffness: reduced * omega * omega,
        damping: 2.0 * random.log_between(0.02, 0.12) * reduced * omega,
        radius: [1.0; 2],
        teeth: [1; 2],
        links: 0,
        span_links: None,
        gain: if random.chance(0.5) { 1.0 } else { random.log_between(0.05, 2.0) },
        rate_hz,
        hold: random.chance(0.5),
        speed,
        torque: 1.5 * loss * speed,
        channels: if kind == Kind::Two { 2 } else { 1 },
    }
}

fn chain_machine(wish: Wish, random: &mut Random) -> Machine {
    let rate_hz = random.log_between(500.0, 2000.0).round();
    let teeth = wish.teeth.unwrap_or_else(|| {
        let z = 13 + random.below(13) as u32;
        let other = 15 + random.below(31) as u32;
        [z, if other == z { other + 1 } else { other }]
    });
    let links = links_for(teeth, random);
    let pitch = random.between(8e-3, 15e-3);
    let radius = teeth.map(|z| pitch * f64::from(z) / (2.0 * PI));
    let inertia = random.log_between(1e-3, 5e-2);
    let omega = 2.0 * PI * rate_hz * random.log_between(0.03, 0.1);
    // The typical tooth frequency is a tenth of the sampling rate.
    let speed = 2.0 * PI * 0.11 * rate_hz / f64::from(teeth[0]);
    let load = radius[1] * random.log_between(50.0, 300.0);
    let driven_speed = speed * radius[0] / radius[1];
    let half = (links - (teeth[0] + teeth[1]) / 2) / 2;
    Machine {
        kind: Kind::Chain,
        slides: false,
        inertia: [random.log_between(1e-3, 1e-2), inertia],
        viscous: [0.0, load * random.between(0.2, 0.6) / driven_speed],
        constant: [0.0, load * random.between(0.3, 0.6)],
        stiffness: inertia * omega * omega / (radius[1] * radius[1]),
        damping: 2.0 * random.log_between(0.02, 0.1) * inertia * omega / (radius[1] * radius[1]),
        radius,
        teeth,
        links,
        span_links: random.chance(0.5).then_some((0, half)),
        gain: 1.0,
        rate_hz,
        hold: false,
        speed,
        torque: load,
        channels: if wish.one_channel { 1 } else { 2 },
    }
}

fn common_divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

/// Links of the loop: coprime to both sprockets, a multiple of the first, or neither.
fn links_for(teeth: [u32; 2], random: &mut Random) -> u32 {
    let wanted = random.unit();
    let fits = |n: u32| {
        let common = teeth.map(|z| common_divisor(n, z));
        let coprime = common == [1, 1];
        match wanted {
            w if w < 0.5 => coprime,
            w if w < 0.75 => common[0] == teeth[0],
            _ => !coprime && common[0] != teeth[0] && common[1] != teeth[1],
        }
    };
    let least = (teeth[0] + teeth[1]) / 2 + 30;
    let found: Vec<u32> = (least..least + 80).filter(|n| fits(*n)).collect();
    // A prime number of teeth leaves no other choice.
    if found.is_empty() { least } else { random.pick(&found) }
}

impl Machine {
    pub(super) fn body(&self, body: usize) -> &'static str {
        match (self.kind, body) {
            (Kind::One, _) if self.slides => "stage",
            (Kind::One, _) => "load",
            (Kind::Two, 0) => "motor",
            (Kind::Two, _) => "load",
            (Kind::Chain, 0) => "driver",
            (Kind::Chain, _) => "driven",
        }
    }

    pub(super) fn spring(&self) -> &'static str {
        if self.kind == Kind::Chain { "tight" } else { "shaft" }
    }

    /// Body of a channel's sensor; None: the spring's gauge.
    pub(super) fn sensed(&self, channel: usize) -> Option<usize> {
        match (self.kind, channel) {
            (Kind::Chain, 0) => Some(1),
            (Kind::Chain, _) => None,
            (_, c) => Some(c),
        }
    }

    pub(super) fn sensor(&self, channel: usize) -> &'static str {
        self.sensed(channel).map_or(self.spring(), |b| self.body(b))
    }

    /// Bodies that move freely.
    pub(super) fn free(&self) -> &'static [usize] {
        match self.kind {
            Kind::One => &[0],
            Kind::Two => &[0, 1],
            Kind::Chain => &[1],
        }
    }

    /// Last body, which carries the load.
    pub(super) fn last(&self) -> usize {
        usize::from(self.kind != Kind::One)
    }
}

/// A parameter that the measurement file frees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    Inertia(usize),
    Viscous(usize),
    Constant(usize),
    Stiffness,
    Damping,
}

impl Machine {
    /// The torque's gain fixes the scale, so that only one of two inertias is free.
    pub(super) fn numbers(&self, wish: Wish) -> Vec<Number> {
        match self.kind {
            Kind::One => vec![Number::Inertia(0), Number::Viscous(0)],
            Kind::Two => {
                let lossy = usize::from(self.viscous[1] > 0.0);
                vec![Number::Inertia(0), Number::Viscous(lossy), Number::Stiffness, Number::Damping]
            }
            // Without a gauge forces are unknown.
            Kind::Chain if wish.one_speed => vec![Number::Viscous(1), Number::Stiffness],
            Kind::Chain if wish.one_channel => vec![Number::Viscous(1), Number::Stiffness, Number::Damping],
            Kind::Chain => {
                vec![Number::Inertia(1), Number::Viscous(1), Number::Constant(1), Number::Stiffness, Number::Damping]
            }
        }
    }

    pub(super) fn number(&mut self, number: Number) -> &mut f64 {
        match number {
            Number::Inertia(b) => &mut self.inertia[b],
            Number::Viscous(b) => &mut self.viscous[b],
            Number::Constant(b) => &mut self.constant[b],
            Number::Stiffness => &mut self.stiffness,
            Number::Damping => &mut self.damping,
        }
    }

    pub(super) fn number_path(&self, number: Number) -> String {
        let (group, inertia) = if self.slides { ("sliders", "mass_kg") } else { ("rotors", "inertia_kg_m2") };
        let springs = if self.kind == Kind::Chain { "spans" } else { "couplings" };
        let unit = if self.kind == Kind::Chain { ["n_per_m", "n_s_per_m"] } else { ["nm_per_rad", "nm_s_per_rad"] };
        let spring = self.spring();
        match number {
            Number::Inertia(b) => format!("{group}.{}.{inertia}", self.body(b)),
            Number::Viscous(b) if self.slides => format!("loads.viscous.{}.force_n_s_per_m", self.body(b)),
            Number::Viscous(b) => format!("loads.viscous.{}.torque_nm_s_per_rad", self.body(b)),
            Number::Constant(b) => format!("loads.constant.{}.torque_nm", self.body(b)),
            Number::Stiffness => format!("{springs}.{spring}.stiffness_{}", unit[0]),
            Number::Damping => format!("{springs}.{spring}.damping_{}", unit[1]),
        }
    }
}
