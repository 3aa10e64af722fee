//! The effects known to this code, their sizes and places.

use super::machine::Machine;
use super::numbers::Random;
use std::f64::consts::PI;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Law {
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
pub(super) enum Part {
    Load,
    Shaft,
    Sprocket,
    Chain,
    Input,
    Sensor,
    Outside,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum On {
    Body,
    Spring,
    Input,
    Channel,
}

/// Notation of an effect in files.
pub(super) struct Row {
    pub(super) law: Law,
    pub(super) name: &'static str,
    pub(super) part: Part,
    pub(super) on: On,
    /// Key of its size for rotating and for sliding bodies.
    pub(super) key: [&'static str; 2],
    /// The key's unit in SI.
    pub(super) unit: f64,
    /// Keys of its shape parameters.
    pub(super) more: &'static [[&'static str; 2]],
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

pub(super) const ROWS: [Row; 34] = [
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

/// Rows are in the order of their laws.
const _: () = {
    let mut i = 0;
    while i < ROWS.len() {
        assert!(ROWS[i].law as usize == i);
        i += 1;
    }
};

/// An effect at its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fault {
    pub(super) law: Law,
    /// Body or channel.
    pub(super) at: usize,
    pub(super) size: f64,
    /// Speeds, order, frequency and damping, depending on the law.
    pub(super) form: [f64; 2],
    pub(super) phase: f64,
    /// Friction that sticks until it is overcome.
    pub(super) sticks: bool,
}

impl Fault {
    pub(super) fn row(&self) -> &'static Row {
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

    pub(super) fn path(&self, m: &Machine) -> String {
        let row = self.row();
        let group = if row.part == Part::Outside { "outside" } else { "effects" };
        format!("{group}.{}.{}", row.name, self.target(m))
    }

    pub(super) fn sizes(&self, m: &Machine) -> Vec<(String, f64)> {
        let (row, path) = (self.row(), self.path(m));
        let which = usize::from(m.slides && row.on == On::Body);
        let mut sizes = vec![(format!("{path}.{}", row.key[which]), self.size / row.unit)];
        // A speed at which friction sticks is not a parameter of the sticking rule.
        if !self.sticks {
            let more = row.more.iter().zip(self.form);
            sizes.extend(more.map(|(keys, value)| (format!("{path}.{}", keys[which]), value)));
        }
        sizes
    }

    /// Waves per revolution of its body, for effects that repeat by angle.
    pub(super) fn order(&self, m: &Machine) -> Option<f64> {
        let z = f64::from(m.teeth[self.at.min(1)]);
        match self.law {
            Law::Runout | Law::Unbalance => Some(1.0),
            Law::ToothPitch | Law::Ripple | Law::Encoder | Law::Fluctuation => Some(self.form[0]),
            Law::Polygon => Some(z),
            Law::Alternate => Some(0.5 * z),
            _ => None,
        }
    }

    /// The same per link of the chain, or per revolution if there is none.
    pub(super) fn waves(&self, m: &Machine) -> Option<f64> {
        let body = if self.row().on == On::Channel { m.sensed(self.at)? } else { self.at };
        self.order(m).map(|n| n / f64::from(m.teeth[body]))
    }

    /// Length that it adds to the span's path, divided by sin.
    pub(super) fn path_amplitude(&self) -> Option<f64> {
        match self.law {
            Law::Runout | Law::ToothPitch | Law::Polygon => Some(self.size),
            Law::Alternate => Some(0.25 * self.size),
            _ => None,
        }
    }

    /// Whether it cannot be negative.
    pub(super) fn one_signed(&self) -> bool {
        use Law::{
            Backlash, Coulomb, DeadZone, InputDelay, Lag, Latency, LowPass, Quadratic, Saturation, Stribeck, Viscous,
        };
        let late = [InputDelay, Lag, Latency, LowPass].contains(&self.law);
        late || [Backlash, Coulomb, DeadZone, Quadratic, Saturation, Stribeck, Viscous].contains(&self.law)
    }
}

/// Typical sizes, from a run without effects.
pub(super) struct Scale {
    pub(super) speed: [f64; 2],
    pub(super) torque: f64,
    pub(super) stretch: f64,
    pub(super) input: f64,
    pub(super) signal: Vec<f64>,
    pub(super) sample_s: f64,
    pub(super) span_s: f64,
}

impl Scale {
    /// A detectable size of an effect, and the largest plausible one.
    pub(super) fn size(&self, m: &Machine, f: &Fault) -> (f64, f64) {
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
            // Reciprocal of its limit.
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

/// An effect of random shape at its typical size.
pub(super) fn fault(law: Law, at: usize, m: &Machine, scale: &Scale, random: &mut Random) -> Fault {
    let v = scale.speed[at.min(1)];
    let form = match law {
        Law::Coulomb => [v * random.log_between(0.02, 0.2), 0.0],
        Law::Stribeck => [v * random.log_between(0.15, 0.6), 0.0],
        Law::Ripple => [1.0 + random.below(3) as f64, 0.0],
        Law::ToothPitch => [2.0 + random.below(3) as f64, 0.0],
        Law::Encoder | Law::Fluctuation => [1.0 + random.below(2) as f64, 0.0],
        Law::Attached => [m.rate_hz * random.log_between(0.015, 0.1), random.log_between(0.02, 0.15)],
        // Fraction of the typical stretch at which it yields.
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
