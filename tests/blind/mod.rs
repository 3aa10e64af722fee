//! Blind cases for `pitchline identify`: measured records of drives whose deviation from what is declared is known.
//!
//! Nothing here comes from pitchline. The equations are those of the catalogue's rows, written again and stepped another way:
//! Heun's rule at 20 or 40 steps a sample where the product takes Runge and Kutta's of fourth order, friction by a rule that
//! sticks or by tanh, filters by their exact decay, delays as shifted series. Every record runs for a while before it is
//! recorded, so that filters, delays and hidden springs carry a history that the file does not tell.
//!
//! ```text
//! one    J v' = g u - c v                                                    v measured; a rotor or a slider
//! two    J1 v1' = g u - F - c1 v1     J2 v2' = F - c2 v2                     v1, v2 measured
//!        F = k (q1 - q2) + d (v1 - v2)
//! chain  v1 measured as input         J2 v2' = r2 F - c2 v2 - T              v2, F measured
//!        F = k l + d l'   l = r1 q1 - r2 q2 + what runs out of true
//! ```
//! All values are SI inside. What a case cannot tell apart is found by its own means: the effect's mark with the directions of
//! all free numbers and starts taken away, and whether another effect leaves the same mark.
#![allow(dead_code)] // each test uses its own part

use std::f64::consts::PI;
use std::fmt::Write as _;

/// Name under which the measurement file knows the drive.
pub const DRIVE_FILE: &str = "drive.toml";
/// Name for the measurement file.
pub const MEASUREMENT_FILE: &str = "measurement.toml";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// One effect of the catalogue.
    Single,
    /// None.
    Clean,
    /// A cause that the catalogue does not hold.
    Outside,
    /// One effect, and at least one other that the records cannot tell from it.
    Confusable,
    /// Two effects of different parts.
    Double,
}

/// What is in the drive and not in its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// `effects.NAME.TARGET`; of class Outside `outside.NAME.TARGET`.
    pub path: String,
    /// Path and value of every parameter, in the unit of its key.
    pub sizes: Vec<(String, f64)>,
    /// Root mean square of what it adds to the channel that shows it best, over that channel's noise.
    pub over_floor: f64,
    /// The same on what fits, after the best change (linear) of all free numbers and starts.
    pub after_fit: f64,
    /// Length of that mark in standard deviations of noise, all channels and samples together: below 3 nobody can find it.
    pub sigmas: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    pub name: String,
    pub class: Class,
    pub drive_toml: String,
    pub measurement_toml: String,
    /// Name and content of every measured file.
    pub csvs: Vec<(String, String)>,
    pub truth: Vec<Truth>,
    /// Path and value of every number that is free: where a fit ends that lacks nothing.
    pub numbers: Vec<(String, f64)>,
    /// Paths that explain these records as well as the truth; only effects are asked that this file knows.
    pub rivals: Vec<String>,
}

/// The case of this class and number: always the same.
pub fn case(class: Class, number: u64) -> Case {
    let mut random = Random::new(1 + class as u64, number);
    for attempt in 0..400 {
        if let Some(case) = attempted(class, number, attempt, &mut random) {
            return case;
        }
    }
    panic!("no case of {class:?} {number} in 400 attempts");
}

/// Steps for one sample of what is written. Against four times as many the records move by 0.03 of the noise at most.
const FINE: usize = 20;
/// The same of a chain's machine, whose gauge shows the span's own swing.
const FINE_CHAIN: usize = 40;
/// Of what only weighs it.
const COARSE: usize = 3;
fn fine(kind: Kind) -> usize {
    if kind == Kind::Chain { FINE_CHAIN } else { FINE }
}

/// Smallest and largest mark of an effect over the noise floor.
const MARK: (f64, f64) = (0.5, 20.0);

// ---------------------------------------------------------------------------------------------------------------- numbers

/// xorshift64*, Vigna 2016.
struct Random(u64);

impl Random {
    fn new(class: u64, number: u64) -> Random {
        // A few rounds of splitmix, so that neighbours share nothing.
        let mut x = class.wrapping_mul(0xD6E8_FEB8_6659_FD93) ^ number.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        for _ in 0..3 {
            x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            x ^= x >> 31;
        }
        Random(x | 1)
    }

    /// From 0 to below 1.
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn log_between(&mut self, low: f64, high: f64) -> f64 {
        low * (self.unit() * (high / low).ln()).exp()
    }

    fn below(&mut self, n: usize) -> usize {
        (self.unit() * n as f64) as usize
    }

    fn chance(&mut self, share: f64) -> bool {
        self.unit() < share
    }

    fn sign(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }

    /// Standard normal, Box and Muller 1958.
    fn normal(&mut self) -> f64 {
        let (a, b) = (self.unit().max(1e-300), self.unit());
        (-2.0 * a.ln()).sqrt() * (2.0 * PI * b).cos()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn rms<'a>(values: impl IntoIterator<Item = &'a f64>) -> f64 {
    let (sum, n) = values.into_iter().fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    (sum / f64::max(n, 1.0)).sqrt()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// The series at a place between its values; its first one before its start.
fn at_place(series: &[f64], place: f64) -> f64 {
    let place = place.clamp(0.0, series.len().saturating_sub(1) as f64);
    let low = place as usize;
    let next = (low + 1).min(series.len() - 1);
    series[low] + (series[next] - series[low]) * (place - low as f64)
}

// ----------------------------------------------------------------------------------------------------------------- machine

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    One,
    Two,
    Chain,
}

/// The drive as it is, but for effects.
#[derive(Clone, Debug)]
struct Machine {
    kind: Kind,
    slides: bool,
    inertia: [f64; 2],
    viscous: [f64; 2],
    constant: [f64; 2],
    stiffness: f64,
    damping: f64,
    radius: [f64; 2],
    teeth: [u32; 2],
    links: u32,
    /// First and last link of the span at the start, where the file tells them.
    span_links: Option<(u32, u32)>,
    /// Torque or force for one unit of the input's column.
    gain: f64,
    rate_hz: f64,
    /// Inputs stay until the next sample.
    hold: bool,
    /// Usual speed of the first body, usual torque.
    speed: f64,
    torque: f64,
    channels: usize,
}

/// What a case asks of its machine beyond chance.
#[derive(Clone, Copy, Debug, Default)]
struct Wish {
    teeth: Option<[u32; 2]>,
    /// Never turns back.
    one_way: bool,
    /// Turns back, but not often.
    biased: bool,
    /// One record at one speed.
    one_speed: bool,
    /// No gauge.
    one_channel: bool,
}

fn machine(kind: Kind, wish: Wish, random: &mut Random) -> Machine {
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
    // A thousand samples hold 4 to 20 time constants.
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
    // A tenth of the sampling rate is the usual rate of teeth.
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
    // A prime number of teeth leaves nothing between.
    if found.is_empty() { least } else { random.pick(&found) }
}

impl Machine {
    fn body(&self, body: usize) -> &'static str {
        match (self.kind, body) {
            (Kind::One, _) if self.slides => "stage",
            (Kind::One, _) => "load",
            (Kind::Two, 0) => "motor",
            (Kind::Two, _) => "load",
            (Kind::Chain, 0) => "driver",
            (Kind::Chain, _) => "driven",
        }
    }

    fn spring(&self) -> &'static str {
        if self.kind == Kind::Chain { "tight" } else { "shaft" }
    }

    /// Body of a channel's sensor; None: the spring's gauge.
    fn sensed(&self, channel: usize) -> Option<usize> {
        match (self.kind, channel) {
            (Kind::Chain, 0) => Some(1),
            (Kind::Chain, _) => None,
            (_, c) => Some(c),
        }
    }

    fn sensor(&self, channel: usize) -> &'static str {
        self.sensed(channel).map_or(self.spring(), |b| self.body(b))
    }

    /// Bodies that move freely.
    fn free(&self) -> &'static [usize] {
        match self.kind {
            Kind::One => &[0],
            Kind::Two => &[0, 1],
            Kind::Chain => &[1],
        }
    }

    /// Last body: where a load sits.
    fn last(&self) -> usize {
        usize::from(self.kind != Kind::One)
    }
}

/// A number that the measurement file frees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Number {
    Inertia(usize),
    Viscous(usize),
    Constant(usize),
    Stiffness,
    Damping,
}

impl Machine {
    /// The torque's gain fixes the scale, so that of two inertias one is free.
    fn numbers(&self, wish: Wish) -> Vec<Number> {
        match self.kind {
            Kind::One => vec![Number::Inertia(0), Number::Viscous(0)],
            Kind::Two => {
                let lossy = usize::from(self.viscous[1] > 0.0);
                vec![Number::Inertia(0), Number::Viscous(lossy), Number::Stiffness, Number::Damping]
            }
            // Without a gauge nothing tells forces.
            Kind::Chain if wish.one_speed => vec![Number::Viscous(1), Number::Stiffness],
            Kind::Chain if wish.one_channel => vec![Number::Viscous(1), Number::Stiffness, Number::Damping],
            Kind::Chain => {
                vec![Number::Inertia(1), Number::Viscous(1), Number::Constant(1), Number::Stiffness, Number::Damping]
            }
        }
    }

    fn number(&mut self, number: Number) -> &mut f64 {
        match number {
            Number::Inertia(b) => &mut self.inertia[b],
            Number::Viscous(b) => &mut self.viscous[b],
            Number::Constant(b) => &mut self.constant[b],
            Number::Stiffness => &mut self.stiffness,
            Number::Damping => &mut self.damping,
        }
    }

    fn number_path(&self, number: Number) -> String {
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

// ----------------------------------------------------------------------------------------------------------------- effects

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Law {
    Coulomb,
    Stribeck,
    Quadratic,
    Constant,
    Viscous,
    Ripple,
    Unbalance,
    Attached,
    Backlash,
    Hardening,
    GainCurve,
    Saturation,
    DeadZone,
    InputOffset,
    Lag,
    InputDelay,
    Fluctuation,
    Runout,
    ToothPitch,
    Polygon,
    Alternate,
    Encoder,
    SignBlind,
    Latency,
    LowPass,
    Gain,
    Offset,
    Drift,
    // Not in the catalogue.
    Bump,
    Hysteresis,
    Intermittent,
    RandomWalk,
    Cubic,
    Mass,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Load,
    Shaft,
    Sprocket,
    Chain,
    Input,
    Sensor,
    Outside,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum On {
    Body,
    Spring,
    Input,
    Channel,
}

/// How an effect is written in files.
struct Row {
    law: Law,
    name: &'static str,
    part: Part,
    on: On,
    /// Key of its size on what turns, and on what slides.
    key: [&'static str; 2],
    /// The key's unit in SI.
    unit: f64,
    /// Keys of its form.
    more: &'static [[&'static str; 2]],
}

const fn row(law: Law, name: &'static str, part: Part, on: On, key: &'static str, unit: f64) -> Row {
    Row { law, name, part, on, key: [key, key], unit, more: &[] }
}

const fn load(law: Law, name: &'static str, sliding: &'static str) -> Row {
    Row { key: ["torque_nm", sliding], ..row(law, name, Part::Load, On::Body, "", 1.0) }
}

const ORDER: &[[&str; 2]] = &[["order", "order"]];
const UM: f64 = 1e-6;
const MS: f64 = 1e-3;
const DEG: f64 = PI / 180.0;

const ROWS: [Row; 34] = [
    Row { more: &[["stick_speed_rad_s", "stick_speed_m_s"]], ..load(Law::Coulomb, "coulomb_friction", "force_n") },
    Row {
        more: &[["stribeck_speed_rad_s", "stribeck_speed_m_s"]],
        ..load(Law::Stribeck, "stribeck_friction", "force_n")
    },
    Row { key: ["torque_nm_s2_per_rad2", "force_n_s2_per_m2"], ..load(Law::Quadratic, "quadratic_drag", "") },
    load(Law::Constant, "constant_torque", "force_n"),
    Row { key: ["torque_nm_s_per_rad", "force_n_s_per_m"], ..load(Law::Viscous, "viscous_friction", "") },
    Row { more: ORDER, ..load(Law::Ripple, "torque_ripple", "force_n") },
    row(Law::Unbalance, "unbalance", Part::Load, On::Body, "inertia_kg_m2", 1.0),
    Row {
        key: ["inertia_kg_m2", "mass_kg"],
        more: &[["frequency_hz", "frequency_hz"], ["damping_ratio", "damping_ratio"]],
        ..row(Law::Attached, "torsional_resonance", Part::Shaft, On::Body, "", 1.0)
    },
    row(Law::Backlash, "backlash", Part::Shaft, On::Spring, "gap_um", UM),
    row(Law::Hardening, "span_hardening", Part::Chain, On::Spring, "stiffness_n_per_m2", 1.0),
    row(Law::GainCurve, "input_gain_curve", Part::Input, On::Input, "per_unit", 1.0),
    row(Law::Saturation, "input_saturation", Part::Input, On::Input, "limit", 1.0),
    row(Law::DeadZone, "input_dead_zone", Part::Input, On::Input, "width", 1.0),
    row(Law::InputOffset, "input_offset", Part::Input, On::Input, "offset", 1.0),
    row(Law::Lag, "input_lag", Part::Input, On::Input, "time_ms", MS),
    row(Law::InputDelay, "input_delay", Part::Input, On::Input, "delay_ms", MS),
    Row { more: ORDER, ..row(Law::Fluctuation, "speed_fluctuation", Part::Input, On::Body, "amplitude_percent", 0.01) },
    row(Law::Runout, "sprocket_runout", Part::Sprocket, On::Body, "amplitude_um", UM),
    Row { more: ORDER, ..row(Law::ToothPitch, "tooth_pitch_error", Part::Sprocket, On::Body, "amplitude_um", UM) },
    row(Law::Polygon, "polygon", Part::Sprocket, On::Body, "amplitude_um", UM),
    row(Law::Alternate, "alternate_pitch", Part::Chain, On::Body, "difference_um", UM),
    Row { more: ORDER, ..row(Law::Encoder, "encoder_error", Part::Sensor, On::Channel, "amplitude_deg", DEG) },
    row(Law::SignBlind, "sign_blind", Part::Sensor, On::Channel, "blind", 1.0),
    row(Law::Latency, "latency", Part::Sensor, On::Channel, "delay_ms", MS),
    row(Law::LowPass, "low_pass", Part::Sensor, On::Channel, "time_ms", MS),
    row(Law::Gain, "gain_error", Part::Sensor, On::Channel, "gain_percent", 0.01),
    row(Law::Offset, "offset", Part::Sensor, On::Channel, "offset", 1.0),
    row(Law::Drift, "drift", Part::Sensor, On::Channel, "per_s", 1.0),
    row(Law::Bump, "bump", Part::Outside, On::Body, "size", 1.0),
    row(Law::Hysteresis, "hysteresis", Part::Outside, On::Spring, "size", 1.0),
    row(Law::Intermittent, "intermittent", Part::Outside, On::Body, "size", 1.0),
    row(Law::RandomWalk, "random_walk", Part::Outside, On::Body, "size", 1.0),
    row(Law::Cubic, "cubic", Part::Outside, On::Body, "size", 1.0),
    row(Law::Mass, "changing_mass", Part::Outside, On::Body, "size", 1.0),
];

/// Rows stand in the order of their laws.
const _: () = {
    let mut i = 0;
    while i < ROWS.len() {
        assert!(ROWS[i].law as usize == i);
        i += 1;
    }
};

/// An effect at its place.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fault {
    law: Law,
    /// Body or channel.
    at: usize,
    size: f64,
    /// Speeds, order, frequency and damping: what the law says.
    form: [f64; 2],
    phase: f64,
    /// Friction that holds until it is overcome.
    sticks: bool,
}

impl Fault {
    fn row(&self) -> &'static Row {
        &ROWS[self.law as usize]
    }

    fn target(&self, m: &Machine) -> &'static str {
        match self.row().on {
            On::Body => m.body(self.at),
            On::Spring => m.spring(),
            On::Input => m.body(0),
            On::Channel => m.sensor(self.at),
        }
    }

    fn path(&self, m: &Machine) -> String {
        let row = self.row();
        let group = if row.part == Part::Outside { "outside" } else { "effects" };
        format!("{group}.{}.{}", row.name, self.target(m))
    }

    fn sizes(&self, m: &Machine) -> Vec<(String, f64)> {
        let (row, path) = (self.row(), self.path(m));
        let which = usize::from(m.slides && row.on == On::Body);
        let mut sizes = vec![(format!("{path}.{}", row.key[which]), self.size / row.unit)];
        // A speed at which friction sticks is no number of a rule that holds.
        if !self.sticks {
            let more = row.more.iter().zip(self.form);
            sizes.extend(more.map(|(keys, value)| (format!("{path}.{}", keys[which]), value)));
        }
        sizes
    }

    /// Waves for one turn of its body, of what comes back by angle.
    fn order(&self, m: &Machine) -> Option<f64> {
        let z = f64::from(m.teeth[self.at.min(1)]);
        match self.law {
            Law::Runout | Law::Unbalance => Some(1.0),
            Law::ToothPitch | Law::Ripple | Law::Encoder | Law::Fluctuation => Some(self.form[0]),
            Law::Polygon => Some(z),
            Law::Alternate => Some(0.5 * z),
            _ => None,
        }
    }

    /// The same for one link of the chain, or for one turn where there is none.
    fn waves(&self, m: &Machine) -> Option<f64> {
        let body = if self.row().on == On::Channel { m.sensed(self.at)? } else { self.at };
        self.order(m).map(|n| n / f64::from(m.teeth[body]))
    }

    /// Length that it adds to the span's path, over sin.
    fn path_amplitude(&self) -> Option<f64> {
        match self.law {
            Law::Runout | Law::ToothPitch | Law::Polygon => Some(self.size),
            Law::Alternate => Some(0.25 * self.size),
            _ => None,
        }
    }

    /// Cannot be negative.
    fn one_signed(&self) -> bool {
        use Law::{
            Backlash, Coulomb, DeadZone, InputDelay, Lag, Latency, LowPass, Quadratic, Saturation, Stribeck, Viscous,
        };
        let late = [InputDelay, Lag, Latency, LowPass].contains(&self.law);
        late || [Backlash, Coulomb, DeadZone, Quadratic, Saturation, Stribeck, Viscous].contains(&self.law)
    }
}

/// Usual sizes, from a run without effects.
struct Scale {
    speed: [f64; 2],
    torque: f64,
    stretch: f64,
    input: f64,
    signal: Vec<f64>,
    sample_s: f64,
    span_s: f64,
}

impl Scale {
    /// A size at which an effect is seen, and the largest that is believable.
    fn size(&self, m: &Machine, f: &Fault) -> (f64, f64) {
        let body = f.at.min(1);
        let v = self.speed[body].max(1e-12);
        let signal = self.signal.get(f.at).copied().unwrap_or(1.0);
        let (t, u) = (self.torque, self.input);
        match f.law {
            Law::Coulomb | Law::Stribeck | Law::Constant | Law::Ripple => (0.1 * t, t),
            Law::Bump | Law::Intermittent | Law::RandomWalk | Law::Cubic => (0.2 * t, 1.5 * t),
            Law::Quadratic | Law::Unbalance => (0.1 * t / (v * v), 1.5 * t / (v * v)),
            Law::Viscous => (0.1 * t / v, t / v),
            Law::Attached => (0.1 * m.inertia[body], 2.0 * m.inertia[body]),
            Law::Backlash => (0.2 * self.stretch, 4.0 * self.stretch),
            Law::Hardening => (0.1 * m.stiffness / self.stretch, 3.0 * m.stiffness / self.stretch),
            Law::Hysteresis => (0.2 * m.stiffness, 2.0 * m.stiffness),
            Law::GainCurve => (0.1 / u, 0.35 / u),
            // One over its limit.
            Law::Saturation => (0.3 / u, 2.0 / u),
            Law::DeadZone => (0.1 * u, u),
            Law::InputOffset => (0.1 * u, u),
            Law::Lag | Law::InputDelay | Law::Latency | Law::LowPass => (self.sample_s, 30.0 * self.sample_s),
            Law::Fluctuation => (0.01, 0.3),
            Law::Runout | Law::ToothPitch => (50e-6, 2e-3),
            Law::Polygon => (5e-6, 3e-4),
            Law::Alternate => (20e-6, 500e-6),
            Law::Encoder => (0.01, 0.3 / f.form[0]),
            Law::SignBlind => (1.0, 1.0),
            Law::Gain | Law::Mass => (0.05, 0.7),
            Law::Offset => (0.1 * signal, 2.0 * signal),
            Law::Drift => (0.1 * signal / self.span_s, 2.0 * signal / self.span_s),
        }
    }
}

/// An effect of chance form at its usual size.
fn fault(law: Law, at: usize, m: &Machine, scale: &Scale, random: &mut Random) -> Fault {
    let v = scale.speed[at.min(1)];
    let form = match law {
        Law::Coulomb => [v * random.log_between(0.02, 0.2), 0.0],
        Law::Stribeck => [v * random.log_between(0.15, 0.6), 0.0],
        Law::Ripple => [1.0 + random.below(3) as f64, 0.0],
        Law::ToothPitch => [2.0 + random.below(3) as f64, 0.0],
        Law::Encoder | Law::Fluctuation => [1.0 + random.below(2) as f64, 0.0],
        Law::Attached => [m.rate_hz * random.log_between(0.015, 0.1), random.log_between(0.02, 0.15)],
        // Share of the usual stretch at which it yields.
        Law::Hysteresis => [scale.stretch * random.between(0.2, 0.8), 0.0],
        Law::Intermittent | Law::Cubic => [0.7 * v, 0.0],
        _ => [0.0; 2],
    };
    let sticks = law == Law::Coulomb && random.chance(0.5);
    let mut fault = Fault { law, at, size: 0.0, form, phase: 0.0, sticks };
    fault.size = scale.size(m, &fault).0;
    use Law::{Bump, Constant, Drift, Gain, GainCurve, InputOffset, Offset, RandomWalk};
    if [Bump, Constant, Drift, Gain, GainCurve, InputOffset, Offset, RandomWalk].contains(&law) {
        fault.size *= random.sign();
    }
    fault
}

// ----------------------------------------------------------------------------------------------------------------- records

/// What happens in a record, but for the machine.
#[derive(Clone, Debug)]
struct Record {
    judges: bool,
    /// Samples before it, and in it.
    lead: usize,
    n: usize,
    /// True time between samples: the recorder's clock is off.
    step_s: f64,
    /// The input at every sample from the lead's start on: torque in its column's unit, or the driver's speed.
    input: Vec<f64>,
    /// Angles from which what is fixed in angle counts.
    angle0: [f64; 2],
    v0: [f64; 2],
    /// Of causes outside the catalogue: a load, a switch, a place and its width.
    walk: Vec<f64>,
    gate: Vec<f64>,
    bump: [f64; 2],
}

fn records(m: &Machine, wish: Wish, random: &mut Random) -> Vec<Record> {
    let clock = random.between(-1e-4, 1e-4);
    let step_s = 1.0 / (m.rate_hz * (1.0 + clock));
    // Rates of teeth, of the sampling rate: what judges is another speed.
    let mut paces = [random.between(0.07, 0.1), random.between(0.13, 0.16), random.between(0.1, 0.13)];
    if random.chance(0.5) {
        paces.swap(0, 2);
    }
    let few = if wish.one_speed { 1 } else { 3 };
    (0..few)
        .map(|k| {
            let lead = 60 + random.below(120);
            let least = if m.kind == Kind::Chain { 900 } else { 600 };
            let n = if wish.one_speed { 1500 } else { least + random.below(1501 - least) };
            let count = lead + n + 1;
            let input = match m.kind {
                Kind::Chain => speeds(m, wish, paces[k] / 0.11 * m.speed, count, random),
                _ => torques(m, wish, count, random),
            };
            let v0 = match (m.kind, wish.one_way) {
                (Kind::Chain, _) => [input[0], input[0] * m.radius[0] / m.radius[1]],
                (_, true) => [m.speed; 2],
                _ => [0.3 * m.speed * random.between(-1.0, 1.0); 2],
            };
            let (walk, gate) = (random_walk(count, random), telegraph(count, random));
            let angle0 = [random.between(0.0, 2.0 * PI), random.between(0.0, 2.0 * PI)];
            Record { judges: k == 2, lead, n, step_s, input, angle0, v0, walk, gate, bump: [0.0, 1.0] }
        })
        .collect()
}

/// Steps of chance height and length in both directions, and a swept sine.
fn torques(m: &Machine, wish: Wish, count: usize, random: &mut Random) -> Vec<f64> {
    let strength = m.torque / m.gain * random.between(0.7, 1.3);
    let bias = match (wish.one_way, wish.biased) {
        (true, _) => 1.3,
        (_, true) => random.between(0.4, 0.9),
        _ => 0.15 * random.between(-1.0, 1.0),
    };
    let height = if wish.one_way { 0.5 } else { 1.0 };
    let sweep = height * random.between(0.2, 0.5);
    let (mut level, mut left) = (0.0_f64, 0);
    let (mut phase, ratio) = (random.between(0.0, 2.0 * PI), count as f64 / 24.0);
    (0..count)
        .map(|i| {
            if left == 0 {
                // More often than not it turns back.
                let sign = if random.chance(0.7) { -level.signum() } else { level.signum() };
                level = sign * random.between(0.2, 1.0);
                left = 20 + random.below(130);
            }
            left -= 1;
            // From two periods in the record to a twelfth of the sampling rate.
            phase += 2.0 * PI * 2.0 / count as f64 * ratio.powf(i as f64 / count as f64);
            strength * (bias + height * level + sweep * phase.sin())
        })
        .collect()
}

/// A driver's speed that changes slowly, and hums from low to high.
fn speeds(m: &Machine, wish: Wish, middle: f64, count: usize, random: &mut Random) -> Vec<f64> {
    if wish.one_speed {
        return vec![middle; count];
    }
    let period = count as f64 * random.between(0.5, 1.3);
    let (start, swing) = (random.between(0.0, 2.0 * PI), random.between(0.08, 0.18));
    let (hum, mut phase) = (random.between(0.003, 0.01), 0.0_f64);
    // Where little damps, less of it shows the resonance.
    let hum = hum * (m.damping / m.stiffness * m.rate_hz).clamp(0.3, 1.0);
    (0..count)
        .map(|i| {
            let share = i as f64 / count as f64;
            phase += 2.0 * PI * 0.01 * 12.0_f64.powf(share);
            middle * (1.0 + swing * (2.0 * PI * i as f64 / period + start).sin() + hum * phase.sin())
        })
        .collect()
}

/// A random walk of mean square one over its length.
fn random_walk(count: usize, random: &mut Random) -> Vec<f64> {
    let mut at = 0.0;
    let mut walk: Vec<f64> = (0..count)
        .map(|_| {
            at += random.normal();
            at
        })
        .collect();
    let middle = mean(&walk);
    walk.iter_mut().for_each(|w| *w -= middle);
    let size = rms(&walk).max(1e-12);
    walk.iter_mut().for_each(|w| *w /= size);
    walk
}

/// On and off for chance times.
fn telegraph(count: usize, random: &mut Random) -> Vec<f64> {
    let (mut on, mut left) = (0.0, 0);
    (0..count)
        .map(|_| {
            if left == 0 {
                on = 1.0 - on;
                left = 15 + random.below(120);
            }
            left -= 1;
            on
        })
        .collect()
}

// -------------------------------------------------------------------------------------------------------------- simulation

/// Angles, speeds, and what a hysteresis remembers. The third body is one that an effect attaches.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    q: [f64; 3],
    v: [f64; 3],
    z: f64,
}

/// What drives at an instant.
#[derive(Clone, Copy, Debug, Default)]
struct At {
    torque: f64,
    /// Of a driver whose speed is given.
    speed: f64,
    walk: f64,
    gate: f64,
    /// Of the record that has passed.
    share: f64,
}

/// What acts.
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
struct Scene<'a> {
    m: &'a Machine,
    faults: &'a [Fault],
    rec: &'a Record,
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

    /// The spring between both bodies; work that lengthens it is taken from who lengthens it.
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
                // Within the gap only the damper carries.
                Law::Backlash if stretch.abs() < 0.5 * f.size => tension -= m.stiffness * stretch,
                Law::Backlash => tension -= m.stiffness * 0.5 * f.size.copysign(stretch),
                Law::Hardening => tension += f.size * stretch * stretch.abs(),
                Law::Hysteresis => {
                    // Bouc 1967, Wen 1976: elastic at first, then it yields at the form's stretch.
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
            // What leaves takes its momentum along.
            Law::Mass => a.inertia[b] *= 1.0 + t * at.share,
            _ => {}
        }
    }

    /// Friction that sticks, implicit: it stops what it can stop.
    fn dry(&self, x: &mut State, h: f64) {
        for f in self.faults.iter().filter(|f| f.sticks) {
            let most = h * f.size / self.m.inertia[f.at];
            let v = &mut x.v[f.at];
            *v = if v.abs() <= most { 0.0 } else { *v - most.copysign(*v) };
        }
    }

    /// Heun's rule between two halves of dry friction; returns what acted at the start.
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

    /// An instant, but for the torque; `part` of a sample after `sample`.
    fn at(&self, sample: usize, part: f64) -> At {
        let (rec, next) = (self.rec, (sample + 1).min(self.rec.gate.len() - 1));
        let between = |series: &[f64]| series[sample] + part * (series[next] - series[sample]);
        let share = (sample as f64 + part - rec.lead as f64) / rec.n as f64;
        let speed = if self.m.kind == Kind::Chain { between(&rec.input) } else { 0.0 };
        At { torque: 0.0, speed, walk: between(&rec.walk), gate: rec.gate[sample], share: share.clamp(0.0, 1.0) }
    }

    /// What a channel's sensor makes of its quantity, at all steps.
    fn sensor(&self, channel: usize, y: &mut Vec<f64>, angle: &[f64], h: f64) {
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

/// A number of the start that no file tells.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Nudge {
    Speed(usize, f64),
    Angle(usize, f64),
}

/// What a record would show without noise.
struct Run {
    channels: Vec<Vec<f64>>,
    /// Angle of the last body.
    angle: Vec<f64>,
    stretch: Vec<f64>,
    speed: [Vec<f64>; 2],
}

fn run(scene: &Scene, parts: usize, nudge: Option<Nudge>) -> Run {
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

// ---------------------------------------------------------------------------------------------------------------- weighing

/// What a bench shows with some effects: what one more is held against.
struct Beside<'a> {
    bench: &'a Bench,
    faults: Vec<Fault>,
    parts: usize,
    judging: bool,
    shown: Vec<f64>,
}

impl Beside<'_> {
    /// What one effect more adds, over noise.
    fn mark(&self, added: &Fault) -> Vec<f64> {
        let with: Vec<Fault> = self.faults.iter().copied().chain([*added]).collect();
        let with = self.bench.shows(&self.bench.m, &with, self.parts, None, self.judging);
        with.iter().zip(&self.shown).map(|(a, b)| a - b).collect()
    }

    /// The largest of its channels.
    fn size(&self, added: &Fault) -> f64 {
        self.bench.best(&self.mark(added), self.judging)
    }
}

/// A machine with its records and the noise of its channels.
struct Bench {
    m: Machine,
    records: Vec<Record>,
    sigma: Vec<f64>,
    scale: Scale,
    wish: Wish,
}

impl Bench {
    fn new(kind: Kind, wish: Wish, random: &mut Random) -> Bench {
        let m = machine(kind, wish, random);
        let mut records = records(&m, wish, random);
        let runs: Vec<Run> = records.iter().map(|rec| run(&Scene { m: &m, faults: &[], rec }, COARSE, None)).collect();
        for (rec, run) in records.iter_mut().zip(&runs) {
            let low = run.angle.iter().copied().fold(f64::MAX, f64::min);
            let high = run.angle.iter().copied().fold(f64::MIN, f64::max);
            rec.bump = [run.angle[run.angle.len() / 2], 0.12 * (high - low).max(1e-9)];
        }
        // What changes within records is the signal: a mean carries no more.
        let signal: Vec<f64> = (0..m.channels)
            .map(|c| {
                let spreads = runs.iter().map(|r| {
                    let middle = mean(&r.channels[c]);
                    let moves: Vec<f64> = r.channels[c].iter().map(|y| y - middle).collect();
                    rms(&moves).max(if wish.one_speed { 0.05 * middle.abs() } else { 0.0 })
                });
                spreads.sum::<f64>() / runs.len() as f64
            })
            .collect();
        let sigma = signal.iter().map(|s| s * 10.0_f64.powf(-random.between(10.0, 40.0) / 20.0)).collect();
        let speed = [0, 1].map(|b| rms(runs.iter().flat_map(|r| &r.speed[b])));
        let (input, torque) = match kind {
            Kind::Chain => (1.0, m.torque),
            _ => {
                let u = rms(records.iter().flat_map(|r| &r.input));
                (u, u * m.gain)
            }
        };
        let stretch = rms(runs.iter().flat_map(|r| &r.stretch)).max(1e-12);
        let span_s = records.iter().map(|r| r.n as f64 * r.step_s).fold(0.0, f64::max);
        let scale = Scale { speed, torque, stretch, input, signal, sample_s: 1.0 / m.rate_hz, span_s };
        Bench { m, records, sigma, scale, wish }
    }

    /// All records of a machine, each channel by channel over its noise, one after the other.
    fn shows(&self, m: &Machine, faults: &[Fault], parts: usize, nudge: Option<Nudge>, judging: bool) -> Vec<f64> {
        let mut all = Vec::new();
        for rec in self.records.iter().filter(|r| judging || !r.judges) {
            let run = run(&Scene { m, faults, rec }, parts, nudge);
            for (y, sigma) in run.channels.iter().zip(&self.sigma) {
                all.extend(y.iter().map(|y| y / sigma));
            }
        }
        all
    }

    /// Root mean square of the channel that shows it best, of a difference over noise.
    fn best(&self, difference: &[f64], judging: bool) -> f64 {
        let n = self.m.channels;
        let mut sums = vec![(0.0, 0.0); n];
        let mut at = 0;
        for rec in self.records.iter().filter(|r| judging || !r.judges) {
            for sum in &mut sums {
                let part = &difference[at..at + rec.n];
                *sum = (sum.0 + dot(part, part), sum.1 + rec.n as f64);
                at += rec.n;
            }
        }
        sums.iter().map(|(s, n)| (s / f64::max(*n, 1.0)).sqrt()).fold(0.0, f64::max)
    }

    /// Where each record's share of a difference begins and ends, of those that fit.
    fn slices(&self) -> Vec<std::ops::Range<usize>> {
        let mut at = 0;
        let fitting = self.records.iter().filter(|r| !r.judges);
        fitting
            .map(|r| {
                let from = at;
                at += r.n * self.m.channels;
                from..at
            })
            .collect()
    }

    fn beside(&self, faults: &[Fault], parts: usize, judging: bool) -> Beside<'_> {
        let shown = self.shows(&self.m, faults, parts, None, judging);
        Beside { bench: self, faults: faults.to_vec(), parts, judging, shown }
    }

    /// The fault at the size that leaves a mark of `target`; None where no believable size does.
    fn sized(&self, others: &[Fault], fault: &Fault, target: f64) -> Option<Fault> {
        let mut fault = *fault;
        let beside = self.beside(others, COARSE, false);
        if fault.law == Law::SignBlind {
            let found = beside.size(&fault);
            return (found.is_finite() && found > MARK.0).then_some(fault);
        }
        let most = self.scale.size(&self.m, &fault).1;
        for _ in 0..7 {
            let found = beside.size(&fault);
            if !found.is_finite() {
                fault.size *= 0.1;
                continue;
            }
            let ratio = target / found.max(1e-9);
            if (ratio - 1.0).abs() < 0.03 {
                return Some(fault);
            }
            // What is bounded by play or friction begins with nothing.
            fault.size *= ratio.clamp(0.05, 8.0);
            if fault.size.abs() > most {
                fault.size = most.copysign(fault.size);
            }
        }
        let found = beside.size(&fault);
        (found.is_finite() && (found / target - 1.0).abs() < 0.3).then_some(fault)
    }

    /// Directions in which free numbers and starts move what fits: orthonormal.
    fn frame(&self, beside: &Beside) -> Vec<Vec<f64>> {
        let others = &beside.faults;
        let less = |a: Vec<f64>| -> Vec<f64> { a.iter().zip(&beside.shown).map(|(a, b)| a - b).collect() };
        let mut columns = Vec::new();
        for number in self.m.numbers(self.wish) {
            let mut m = self.m.clone();
            *m.number(number) *= 1.0 + 1e-4;
            columns.push(less(self.shows(&m, others, COARSE, None, false)));
        }
        let mut nudges: Vec<Nudge> =
            self.m.free().iter().map(|b| Nudge::Speed(*b, 1e-4 * self.scale.speed[*b])).collect();
        if self.m.kind != Kind::One {
            nudges.push(Nudge::Angle(self.m.last(), 1e-3 * self.scale.stretch / self.m.radius[1]));
        }
        for nudge in nudges {
            let moved = less(self.shows(&self.m, others, COARSE, Some(nudge), false));
            columns.extend(self.slices().into_iter().map(|range| only(&moved, range)));
        }
        let mut frame: Vec<Vec<f64>> = Vec::new();
        for column in columns {
            let size = dot(&column, &column).sqrt();
            // Twice is enough: Kahan and Parlett.
            let mut rest = outside(&outside(&column, &frame), &frame);
            let left = dot(&rest, &rest).sqrt();
            if left > 1e-7 * size && left > 0.0 {
                rest.iter_mut().for_each(|x| *x /= left);
                frame.push(rest);
            }
        }
        frame
    }
}

/// A column in this range, and nothing elsewhere.
fn only(column: &[f64], range: std::ops::Range<usize>) -> Vec<f64> {
    let mut own = vec![0.0; column.len()];
    own[range.clone()].copy_from_slice(&column[range]);
    own
}

/// A column without its share along the frame.
fn outside(column: &[f64], frame: &[Vec<f64>]) -> Vec<f64> {
    let mut rest = column.to_vec();
    for direction in frame {
        let along = dot(&rest, direction);
        rest.iter_mut().zip(direction).for_each(|(x, d)| *x -= along * d);
    }
    rest
}

/// Two marks differ where what is left of one after the other is longer than this [standard deviations, squared].
const TELLING: f64 = 12.0;

impl Bench {
    /// Paths of effects that leave the mark of `fault` as well, beside others.
    fn rivals(&self, beside: &Beside, fault: &Fault, mark: &[f64], frame: &[Vec<f64>]) -> Vec<String> {
        let whole = dot(mark, mark);
        let own = fault.path(&self.m);
        let mut found: Vec<String> = Vec::new();
        for rival in self.alternatives(fault) {
            let path = rival.path(&self.m);
            if path == own || found.contains(&path) || beside.faults.iter().any(|o| o.path(&self.m) == path) {
                continue;
            }
            let left = match rival.order(&self.m) {
                Some(_) => self.left_by_wave(beside, rival, mark, frame),
                None => self.left_by_size(beside, rival, mark, frame),
            };
            if left < TELLING && left < 0.5 * whole {
                found.push(path);
            }
        }
        found
    }

    /// Effects that could be mistaken for this one: of the same waves, or without waves as it is.
    fn alternatives(&self, fault: &Fault) -> Vec<Fault> {
        use Law::{Alternate, Encoder, Fluctuation, Polygon, Ripple, Runout, ToothPitch, Unbalance};
        let (m, v) = (&self.m, self.scale.speed);
        let mut all = Vec::new();
        let mut add = |law: Law, at: usize, form: f64| {
            let mut f = Fault { law, at, size: 0.0, form: [form, 0.0], phase: 0.0, sticks: false };
            f.size = self.scale.size(m, &f).0;
            all.push(f);
        };
        if let Some(waves) = fault.waves(m) {
            let sprockets = if m.kind == Kind::Chain { 0..2 } else { 0..0 };
            for at in sprockets {
                [Runout, Polygon, Alternate].iter().for_each(|law| add(*law, at, 0.0));
                [2.0, 3.0, 4.0].iter().for_each(|n| add(ToothPitch, at, *n));
            }
            if m.kind == Kind::Chain {
                [1.0, 2.0].iter().for_each(|n| add(Fluctuation, 0, *n));
            }
            if !m.slides {
                for at in m.free() {
                    [1.0, 2.0, 3.0].iter().for_each(|n| add(Ripple, *at, *n));
                    add(Unbalance, *at, 1.0);
                }
                let speeds = (0..m.channels).filter(|c| m.sensed(*c).is_some());
                speeds.for_each(|c| [1.0, 2.0].iter().for_each(|n| add(Encoder, c, *n)));
            }
            all.retain(|f| f.waves(m).is_some_and(|w| (w - waves).abs() < 1e-9));
            return all;
        }
        for at in m.free() {
            [Law::Coulomb, Law::Stribeck].iter().for_each(|law| add(*law, *at, 0.3 * v[*at]));
            add(Law::Coulomb, *at, 0.05 * v[*at]);
            [Law::Quadratic, Law::Constant, Law::Viscous].iter().for_each(|law| add(*law, *at, 0.0));
        }
        if m.kind != Kind::Chain {
            use Law::{DeadZone, GainCurve, InputDelay, InputOffset, Lag, Saturation};
            let laws = [GainCurve, Saturation, DeadZone, InputOffset, InputDelay, Lag];
            laws.iter().for_each(|law| add(*law, 0, 0.0));
        }
        if m.kind != Kind::One {
            [Law::Backlash, Law::Hardening].iter().for_each(|law| add(*law, 0, 0.0));
        }
        for c in 0..m.channels {
            [Law::Latency, Law::LowPass, Law::Gain, Law::Offset, Law::Drift].iter().for_each(|law| add(*law, c, 0.0));
        }
        // One time for another.
        let late = |f: &Fault| matches!(f.law, Law::InputDelay | Law::Lag | Law::Latency | Law::LowPass);
        if late(fault) {
            all.iter_mut().filter(|f| late(f)).for_each(|f| f.size = fault.size);
        }
        all
    }

    /// Squared length that a rival of best size leaves of a mark.
    fn left_by_size(&self, beside: &Beside, mut rival: Fault, mark: &[f64], frame: &[Vec<f64>]) -> f64 {
        let whole = dot(mark, mark);
        // A fit is held to less than what is believable.
        let most = 10.0 * self.scale.size(&self.m, &rival).1;
        let mut least = whole;
        // Marks do not grow quite as sizes do: a few rounds find the size.
        for round in 0..6 {
            let raw = beside.mark(&rival);
            let own = outside(&raw, frame);
            let (size, all) = (dot(&own, &own), dot(&raw, &raw));
            // What free numbers take over leaves nothing but rounding.
            if !size.is_finite() || size < 1e-8 * all || size == 0.0 {
                break;
            }
            let factor = dot(&own, mark) / size;
            let wrong = rival.one_signed() && factor <= 0.0;
            if wrong || (rival.size * factor).abs() > most {
                break;
            }
            let left = whole - factor * factor * size;
            if (factor - 1.0).abs() < 0.2 || round > 3 {
                least = least.min(left);
            }
            if left > 0.5 * whole || (factor - 1.0).abs() < 1e-3 {
                break;
            }
            rival.size *= factor;
        }
        least
    }

    /// The same for a rival with one size and a phase in every record.
    fn left_by_wave(&self, beside: &Beside, rival: Fault, mark: &[f64], frame: &[Vec<f64>]) -> f64 {
        let waves = [rival, Fault { phase: 0.5 * PI, ..rival }].map(|f| beside.mark(&f));
        let slices = self.slices();
        let columns: Vec<Vec<f64>> =
            slices.iter().flat_map(|range| waves.iter().map(|w| outside(&only(w, range.clone()), frame))).collect();
        let Some(fit) = least_squares(&columns, mark) else { return f64::MAX };
        let sizes: Vec<f64> = fit.chunks(2).map(|x| x[0].hypot(x[1])).collect();
        // The size that all records share, by how well each tells it.
        let weights: Vec<f64> = columns.chunks(2).map(|c| dot(&c[0], &c[0]) + dot(&c[1], &c[1])).collect();
        let size = dot(&weights, &sizes) / weights.iter().sum::<f64>();
        let mut left = mark.to_vec();
        for (i, (column, x)) in columns.iter().zip(&fit).enumerate() {
            let x = x * size / sizes[i / 2].max(1e-300);
            left.iter_mut().zip(column).for_each(|(l, c)| *l -= x * c);
        }
        dot(&left, &left)
    }
}

/// The x that brings the columns nearest to `right`; by Gauss and Jordan, few columns that are hardly alike.
fn least_squares(columns: &[Vec<f64>], right: &[f64]) -> Option<Vec<f64>> {
    let n = columns.len();
    let mut a: Vec<Vec<f64>> = columns.iter().map(|c| columns.iter().map(|d| dot(c, d)).collect()).collect();
    let mut x: Vec<f64> = columns.iter().map(|c| dot(c, right)).collect();
    for i in 0..n {
        let pivot = a[i][i];
        if pivot.is_nan() || pivot <= 1e-9 * dot(&columns[i], &columns[i]) {
            return None;
        }
        let own = a[i].clone();
        for k in (0..n).filter(|k| *k != i) {
            let share = a[k][i] / pivot;
            a[k].iter_mut().zip(&own).for_each(|(x, y)| *x -= share * y);
            x[k] -= share * x[i];
        }
    }
    Some((0..n).map(|i| x[i] / a[i][i]).collect())
}

// ------------------------------------------------------------------------------------------------------------------- cases

/// Effects that this kind of machine shows: those that its free numbers take over (a gauge's gain where all forces are free)
/// are left out, and those that need another motion (friction's sign on a chain that never turns back).
fn laws(kind: Kind) -> Vec<(Law, &'static [usize])> {
    use Law::{
        Alternate, Attached, Backlash, Constant, Coulomb, DeadZone, Drift, Encoder, Gain, GainCurve, Hardening,
        InputDelay, Lag, Latency, LowPass, Offset, Polygon, Quadratic, Ripple, Runout, SignBlind, Stribeck, ToothPitch,
    };
    const FIRST: &[usize] = &[0];
    const LAST: &[usize] = &[1];
    const BOTH: &[usize] = &[0, 1];
    let every = |laws: &[Law], at: &'static [usize]| -> Vec<(Law, &'static [usize])> {
        laws.iter().map(|l| (*l, at)).collect()
    };
    match kind {
        Kind::One => every(
            &[
                Coulomb, Stribeck, Quadratic, Constant, Ripple, Attached, GainCurve, DeadZone, Lag, InputDelay,
                Encoder, LowPass, Latency, SignBlind, Offset, Drift,
            ],
            FIRST,
        ),
        Kind::Two => [
            every(&[Coulomb, Stribeck, Quadratic, Constant, Ripple, Attached], BOTH),
            every(&[Backlash, Hardening, GainCurve, DeadZone, Lag, InputDelay], FIRST),
            every(&[Encoder, LowPass, Latency, SignBlind, Gain, Offset, Drift], BOTH),
        ]
        .concat(),
        Kind::Chain => [
            every(&[Quadratic, Ripple, Attached], LAST),
            every(&[Hardening], FIRST),
            every(&[Runout, ToothPitch, Polygon, Alternate], BOTH),
            every(&[Encoder, Gain, Offset], FIRST),
            every(&[LowPass, Latency, Drift], BOTH),
        ]
        .concat(),
    }
}

/// What a case is to hold.
struct Draft {
    kind: Kind,
    wish: Wish,
    laws: Vec<(Law, usize, Option<f64>)>,
}

/// By number, so that every effect has its turn on every machine.
fn single(turn: u64, random: &mut Random) -> Draft {
    let all: Vec<(Kind, Law, &[usize])> = [Kind::One, Kind::Two, Kind::Chain]
        .into_iter()
        .flat_map(|kind| laws(kind).into_iter().map(move |(law, at)| (kind, law, at)))
        .collect();
    // A stride without common divisor mixes neighbours.
    let (kind, law, places) = all[(turn as usize * 11 + 5) % all.len()];
    let wish = Wish { biased: law == Law::SignBlind, ..Wish::default() };
    Draft { kind, wish, laws: vec![(law, random.pick(places), None)] }
}

fn double(random: &mut Random) -> Draft {
    let kind = random.pick(&[Kind::One, Kind::Two, Kind::Chain]);
    let all = laws(kind);
    let part = |law: Law| ROWS[law as usize].part;
    let (first, places) = random.pick(&all);
    let spring = |law: Law| matches!(law, Law::Backlash | Law::Hardening);
    let fits = |law: Law| part(law) != part(first) && !(spring(law) && spring(first));
    let others: Vec<(Law, &[usize])> = all.into_iter().filter(|(l, _)| fits(*l)).collect();
    let (second, more) = random.pick(&others);
    let wish = Wish { biased: first == Law::SignBlind || second == Law::SignBlind, ..Wish::default() };
    Draft { kind, wish, laws: vec![(first, random.pick(places), None), (second, random.pick(more), None)] }
}

fn out_of_catalogue(number: u64, random: &mut Random) -> Draft {
    let (kind, law) = match number % 6 {
        0 => (random.pick(&[Kind::One, Kind::Two, Kind::Chain]), Law::Bump),
        1 => (random.pick(&[Kind::Two, Kind::Chain]), Law::Hysteresis),
        2 => (random.pick(&[Kind::One, Kind::Two, Kind::Chain]), Law::Intermittent),
        3 => (random.pick(&[Kind::One, Kind::Two, Kind::Chain]), Law::RandomWalk),
        4 => (random.pick(&[Kind::One, Kind::Two]), Law::Cubic),
        _ => (random.pick(&[Kind::One, Kind::Two]), Law::Mass),
    };
    let at = if law == Law::Hysteresis || kind == Kind::One { 0 } else { 1 };
    Draft { kind, wish: Wish::default(), laws: vec![(law, at, None)] }
}

fn confusable(number: u64, random: &mut Random) -> Draft {
    let none = Wish::default();
    let (kind, wish, law) = match number % 7 {
        // On a linear machine with one sensor a delay is a delay, wherever it sits.
        0 => (Kind::One, none, (random.pick(&[Law::InputDelay, Law::Latency]), 0, None)),
        1 => (Kind::One, none, (random.pick(&[Law::Lag, Law::LowPass]), 0, None)),
        2 => match random.chance(0.5) {
            true => (Kind::One, none, (random.pick(&[Law::InputOffset, Law::Constant, Law::Offset]), 0, None)),
            false if random.chance(0.5) => (Kind::Two, none, (Law::InputOffset, 0, None)),
            false => (Kind::Two, none, (Law::Constant, random.below(2), None)),
        },
        // Friction of what never turns back is a constant load.
        3 => {
            let wish = Wish { one_way: true, ..none };
            (Kind::One, wish, (random.pick(&[Law::Coulomb, Law::DeadZone, Law::Constant]), 0, None))
        }
        // One speed, one channel: whatever comes back once a turn.
        4 => {
            let teeth = Some([19, 15 + 2 * random.below(10) as u32 + u32::from(random.chance(0.5)) * 16]);
            let wish = Wish { one_speed: true, one_channel: true, teeth, ..none };
            let (law, at) = random.pick(&[(Law::Encoder, 0), (Law::Runout, 1), (Law::Ripple, 1)]);
            (Kind::Chain, wish, (law, at, Some(1.0)))
        }
        // As many teeth on both: both turn alike.
        5 => {
            let z = 15 + random.below(12) as u32;
            (Kind::Chain, Wish { teeth: Some([z, z]), one_channel: true, ..none }, (Law::Runout, random.below(2), None))
        }
        // Two turns of one for one turn of the other.
        _ => {
            let z = 13 + random.below(8) as u32;
            let law = random.pick(&[(Law::Runout, 1, None), (Law::ToothPitch, 0, Some(2.0))]);
            (Kind::Chain, Wish { teeth: Some([2 * z, z]), one_channel: true, ..none }, law)
        }
    };
    Draft { kind, wish, laws: vec![law] }
}

fn draft(class: Class, number: u64, attempt: u64, random: &mut Random) -> Draft {
    match class {
        // After many failures on one effect, the next one.
        Class::Single => single(number + attempt / 40, random),
        Class::Double => double(random),
        Class::Outside => out_of_catalogue(number, random),
        Class::Confusable => confusable(number, random),
        Class::Clean => {
            let kind = random.pick(&[Kind::One, Kind::Two, Kind::Chain]);
            Draft { kind, wish: Wish::default(), laws: Vec::new() }
        }
    }
}

/// One attempt at a case; None where no believable size makes a mark of the size that was drawn.
fn attempted(class: Class, number: u64, attempt: u64, random: &mut Random) -> Option<Case> {
    let draft = draft(class, number, attempt, random);
    let bench = Bench::new(draft.kind, draft.wish, random);
    let mut faults: Vec<Fault> = Vec::new();
    for (law, at, order) in &draft.laws {
        if bench.m.slides && matches!(law, Law::Ripple | Law::Encoder) {
            return None;
        }
        let mut f = fault(*law, *at, &bench.m, &bench.scale, random);
        if let Some(order) = order {
            f.form[0] = *order;
        }
        let low = match class {
            Class::Single => MARK.0,
            Class::Double | Class::Confusable => 1.0,
            _ => 2.0,
        };
        let target = random.log_between(low, MARK.1);
        faults.push(bench.sized(&faults, &f, target)?);
    }
    let shown = bench.shows(&bench.m, &faults, fine(draft.kind), None, true);
    let (truth, rivals) = weighed(&bench, &faults, &shown, class)?;
    let written = Written::new(&bench, class, number, random);
    let mut name = format!("{class:?}-{number:03}-{:?}", bench.m.kind).to_lowercase();
    for f in &faults {
        name += &format!("-{}", f.row().name.replace('_', "-"));
    }
    let columns = written.columns(&bench, &shown, random);
    Some(Case {
        drive_toml: written.drive(&bench.m, &name),
        measurement_toml: written.measurement(&bench, &name),
        csvs: written.csvs(&bench, &columns),
        numbers: written.numbers(&bench.m),
        name,
        class,
        truth,
        rivals,
    })
}

/// What each fault leaves, and who leaves the same; None where the class is missed.
fn weighed(bench: &Bench, faults: &[Fault], shown: &[f64], class: Class) -> Option<(Vec<Truth>, Vec<String>)> {
    let mut truth = Vec::new();
    let mut rivals: Vec<String> = Vec::new();
    let mut marks: Vec<Vec<f64>> = Vec::new();
    for (i, f) in faults.iter().enumerate() {
        let others: Vec<Fault> = faults.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, f)| *f).collect();
        let without = bench.shows(&bench.m, &others, fine(bench.m.kind), None, true);
        let added: Vec<f64> = shown.iter().zip(&without).map(|(a, b)| a - b).collect();
        let over_floor = bench.best(&added, true);
        if !(over_floor > 0.8 * MARK.0 && (over_floor < 1.3 * MARK.1 || f.law == Law::SignBlind)) {
            return None;
        }
        let beside = bench.beside(&others, COARSE, false);
        let frame = bench.frame(&beside);
        let mark = outside(&beside.mark(f), &frame);
        let sigmas = dot(&mark, &mark).sqrt();
        if class != Class::Outside && sigmas > 3.0 {
            rivals.extend(bench.rivals(&beside, f, &mark, &frame));
        }
        let after_fit = bench.best(&mark, false);
        truth.push(Truth { path: f.path(&bench.m), sizes: f.sizes(&bench.m), over_floor, after_fit, sigmas });
        marks.push(mark);
    }
    rivals.sort();
    rivals.dedup();
    if class == Class::Confusable && (rivals.is_empty() || truth.iter().any(|t| t.sigmas < 6.0)) {
        return None;
    }
    if let [a, b] = marks.as_slice() {
        // Two effects that leave one mark are one.
        let along = dot(a, b);
        if along * along > 0.7 * dot(a, a) * dot(b, b) {
            return None;
        }
    }
    Some((truth, rivals))
}

// ------------------------------------------------------------------------------------------------------------------- files

/// How a case is put into files.
struct Written {
    /// The drive as its file declares it.
    declared: Machine,
    free: Vec<Number>,
    /// How well the file says that its numbers are known [percent].
    spread: Option<f64>,
    /// Correlation of neighbours in the noise.
    colour: f64,
    one_file: bool,
    time_column: bool,
    rpm: bool,
}

const NAMES: [&str; 3] = ["first", "second", "third"];

impl Written {
    fn new(bench: &Bench, class: Class, number: u64, random: &mut Random) -> Written {
        let free = bench.m.numbers(bench.wish);
        let mut declared = bench.m.clone();
        for n in &free {
            *declared.number(*n) *= 1.0 + random.between(-0.15, 0.15);
        }
        let wrong = class == Class::Clean && number % 3 == 1;
        if wrong && bench.m.kind == Kind::One && random.chance(0.5) {
            // Inertia and loss take it over.
            declared.gain *= 1.0 + random.sign() * random.between(0.15, 0.35);
        } else if wrong {
            let n = random.pick(&free);
            *declared.number(n) *= if random.chance(0.5) { random.between(0.4, 0.6) } else { random.between(1.6, 2.3) };
        }
        let spread = if bench.wish.one_speed || (!wrong && random.chance(0.33)) { Some(15.0) } else { None };
        let colour = if class == Class::Clean && number.is_multiple_of(3) { random.between(0.5, 0.9) } else { 0.0 };
        let (one_file, time_column) = (random.chance(0.5), random.chance(0.5));
        Written { declared, free, spread, colour, one_file, time_column, rpm: !bench.m.slides && random.chance(0.3) }
    }

    /// A wrong gain stretches all that it drives.
    fn numbers(&self, m: &Machine) -> Vec<(String, f64)> {
        let mut found = m.clone();
        let stretch = self.declared.gain / m.gain;
        self.free.iter().map(|n| (m.number_path(*n), stretch * *found.number(*n))).collect()
    }

    /// Name, unit and size in SI of a column of speeds; else of the gauge.
    fn unit(&self, m: &Machine, channel: usize) -> (&'static str, f64) {
        match m.sensed(channel) {
            None => ("N", 1.0),
            Some(_) if m.slides => ("m/s", 1.0),
            Some(_) if self.rpm => ("rpm", PI / 30.0),
            Some(_) => ("rad/s", 1.0),
        }
    }

    /// Columns of every record: input, then channels with their noise, in the units of the file.
    fn columns(&self, bench: &Bench, shown: &[f64], random: &mut Random) -> Vec<Vec<Vec<f64>>> {
        let mut all = Vec::new();
        let mut at = 0;
        for rec in &bench.records {
            let mut columns = vec![rec.input[rec.lead..rec.lead + rec.n].to_vec()];
            for (c, sigma) in bench.sigma.iter().enumerate() {
                let unit = sigma / self.unit(&bench.m, c).1;
                let mut noise = random.normal();
                let fresh = (1.0 - self.colour * self.colour).sqrt();
                let noisy = shown[at..at + rec.n].iter().map(|y| {
                    let value = unit * (y + noise);
                    noise = self.colour * noise + fresh * random.normal();
                    value
                });
                columns.push(noisy.collect());
                at += rec.n;
            }
            all.push(columns);
        }
        all
    }

    fn header(&self, m: &Machine) -> String {
        let time = if self.time_column { "t," } else { "" };
        let channels: Vec<String> = (0..m.channels).map(|c| format!("sensor_{}", m.sensor(c))).collect();
        format!("{time}input,{}\n", channels.join(","))
    }

    fn csvs(&self, bench: &Bench, records: &[Vec<Vec<f64>>]) -> Vec<(String, String)> {
        let header = self.header(&bench.m);
        let mut files = Vec::new();
        let mut together = header.clone();
        let mut row = 0;
        for (k, columns) in records.iter().enumerate() {
            let mut own = String::new();
            for i in 0..columns[0].len() {
                if self.time_column {
                    let t = if self.one_file { row } else { i } as f64 / bench.m.rate_hz;
                    let _ = write!(own, "{t:.9},");
                }
                let _ = write!(own, "{:.9e}", columns[0][i]);
                for c in &columns[1..] {
                    let _ = write!(own, ",{:.7e}", c[i]);
                }
                own.push('\n');
                row += 1;
            }
            if self.one_file {
                together += &own;
            } else {
                files.push((format!("{}.csv", NAMES[k]), format!("{header}{own}")));
            }
        }
        if self.one_file {
            files.push(("records.csv".to_string(), together));
        }
        files
    }

    fn drive(&self, true_machine: &Machine, name: &str) -> String {
        let d = &self.declared;
        let mut text = format!("title = \"{name}\"\nfidelity = \"lumped\"\n");
        let mut put = |table: String, lines: &[String]| {
            let _ = write!(text, "\n[{table}]\n");
            for l in lines {
                let _ = writeln!(text, "{l}");
            }
        };
        let line = |key: &str, value: f64| format!("{key} = {value:.9e}");
        for b in 0..=d.last() {
            let (group, key) = if d.slides { ("sliders", "mass_kg") } else { ("rotors", "inertia_kg_m2") };
            let mut lines = vec![line(key, d.inertia[b])];
            if d.kind == Kind::Chain {
                lines.push(format!("teeth = {}", d.teeth[b]));
            }
            put(format!("{group}.{}", d.body(b)), &lines);
            let key = if d.slides { "force_n_s_per_m" } else { "torque_nm_s_per_rad" };
            if d.viscous[b] > 0.0 {
                put(format!("loads.viscous.{}", d.body(b)), &[line(key, d.viscous[b])]);
            }
            if d.constant[b] != 0.0 {
                put(format!("loads.constant.{}", d.body(b)), &[line("torque_nm", d.constant[b])]);
            }
        }
        let between = format!("between = [\"{}\", \"{}\"]", d.body(0), d.body(1));
        match d.kind {
            Kind::One => {}
            Kind::Two => put(
                "couplings.shaft".into(),
                &[between, line("stiffness_nm_per_rad", d.stiffness), line("damping_nm_s_per_rad", d.damping)],
            ),
            Kind::Chain => {
                put("chain".into(), &[format!("links = {}", d.links)]);
                // Radii are those of the pitch circles' ratio, which the chain keeps.
                let [from, to] = true_machine.radius.map(|r| 1e3 * r);
                let mut lines = vec![between, line("from_radius_mm", from), line("to_radius_mm", to)];
                lines.push(line("stiffness_n_per_m", d.stiffness));
                lines.push(line("damping_n_s_per_m", d.damping));
                if let Some((from, to)) = d.span_links {
                    lines.push(format!("from_link = {from}\nto_link = {to}"));
                }
                put("spans.tight".into(), &lines);
            }
        }
        match (d.kind, d.slides) {
            (Kind::Chain, _) => put("inputs.speed.driver".into(), &[]),
            (_, true) => put("inputs.force.stage".into(), &[line("gain_n_per_unit", d.gain)]),
            (_, false) => put(format!("inputs.torque.{}", d.body(0)), &[line("gain_nm_per_unit", d.gain)]),
        }
        for c in 0..d.channels {
            let kind = if d.sensed(c).is_some() { "tachometer" } else { "strain_gauge" };
            put(format!("sensors.{kind}.{}", d.sensor(c)), &[]);
        }
        text
    }

    fn measurement(&self, bench: &Bench, name: &str) -> String {
        let m = &bench.m;
        let mut text = format!("title = \"{name}\"\ndrive = \"{DRIVE_FILE}\"\n");
        let files: &[&str] = if self.one_file { &["records"] } else { &NAMES[..bench.records.len()] };
        for file in files {
            let _ = write!(text, "\n[files.{file}]\npath = \"{file}.csv\"\n");
        }
        for c in 0..m.channels {
            let (sensor, unit) = (m.sensor(c), self.unit(m, c).0);
            let kind = if m.sensed(c).is_some() { "tachometer" } else { "strain_gauge" };
            let _ = write!(
                text,
                "\n[channels.{sensor}]\nsensor = \"sensors.{kind}.{sensor}\"\ncolumn = \"sensor_{sensor}\"\nunit = \"{unit}\"\n"
            );
        }
        let (input, unit) = match (m.kind, m.slides, m.gain == 1.0) {
            (Kind::Chain, ..) => ("speed.driver".to_string(), "rad/s"),
            (_, true, _) => ("force.stage".to_string(), "N"),
            (_, false, true) => (format!("torque.{}", m.body(0)), "N m"),
            (_, false, false) => (format!("torque.{}", m.body(0)), "V"),
        };
        let _ = write!(text, "\n[inputs.drive]\ninput = \"inputs.{input}\"\ncolumn = \"input\"\nunit = \"{unit}\"\n");
        if m.hold {
            text += "hold = true\n";
        }
        let mut row = 1;
        for (k, rec) in bench.records.iter().enumerate() {
            let _ = write!(text, "\n[records.{}]\n", NAMES[k]);
            if self.one_file {
                let _ = write!(text, "from_row = {row}\nto_row = {}\n", row + rec.n - 1);
            } else {
                let _ = writeln!(text, "file = \"{}\"", NAMES[k]);
            }
            match self.time_column {
                true => text += "time_column = \"t\"\ntime_unit = \"s\"\n",
                false => text += &format!("rate_hz = {}\n", m.rate_hz),
            }
            if rec.judges {
                text += "use = \"judge\"\n";
            }
            if bench.wish.one_speed {
                let _ = writeln!(text, "judge_from_row = {}", row + 2 * rec.n / 3);
            }
            row += rec.n;
        }
        for n in &self.free {
            let _ = write!(text, "\n[fit.\"{}\"]\n", m.number_path(*n));
            if let Some(spread) = self.spread {
                let _ = writeln!(text, "spread_percent = {spread:.1}");
            }
        }
        text
    }
}
