//! The catalogue of effects: deviations that a real drive may have and the declared one lacks.
//!
//! One file per effect. Its row gives name, equation, unit and range of every parameter, source and signature (order,
//! speed law, channels). Its function is the physics, used by `--set`, by a drive file and by `identify`. In a drive
//! file an effect is a table `[effects.NAME.TARGET]`; the path of a parameter, `effects.NAME.TARGET.KEY`, is its name
//! everywhere. A parameter at its `off` value changes no bit of a run.
//!
//! Signs: a force on a body is positive along its coordinate, the stretch of a span is positive in tension. All values
//! are SI.

pub mod alternate_pitch;
pub mod arm_compliance;
pub mod backlash;
pub mod bearing_clearance;
pub mod blade_stiffness;
pub mod check_leak;
pub mod clock_drift;
pub mod clock_offset;
pub mod constant_torque;
pub mod coulomb_friction;
pub mod coupling_stiffness;
pub mod drift;
pub mod encoder_error;
pub mod flexible_coupling;
pub mod gain_error;
pub mod gap_error;
pub mod guide_compliance;
pub mod guide_friction;
pub mod input_dead_zone;
pub mod input_delay;
pub mod input_gain_by_sign;
pub mod input_gain_curve;
pub mod input_lag;
pub mod input_offset;
pub mod input_saturation;
pub mod joint_clearance;
pub mod joint_damping;
pub mod joint_stiffness;
pub mod latency;
pub mod leak_gap;
pub mod link_mass;
pub mod load_friction;
pub mod low_pass;
pub mod mark_spacing;
pub mod mark_strength;
pub mod missed_pulses;
pub mod offset;
pub mod oil_air;
pub mod oil_viscosity;
pub mod orifice_diameter;
pub mod pin_friction;
pub mod pitch_error;
pub mod polygon;
pub mod presliding_friction;
pub mod quadratic_drag;
pub mod quantisation;
pub mod sensor_resonance;
pub mod sign_blind;
pub mod slack_span;
pub mod span_damping;
pub mod span_hardening;
pub mod span_stiffness;
pub mod speed_fluctuation;
pub mod sprocket_runout;
pub mod stribeck_friction;
pub mod tight_joint;
pub mod time_base;
pub mod tooth_pitch_error;
pub mod torque_ripple;
pub mod torsional_resonance;
pub mod unbalance;
pub mod valve_spring;
pub mod viscous_friction;
pub mod warming_friction;
pub mod wear_elongation;

/// Kind of target of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum On {
    /// A rotor, slider or sprocket that moves freely.
    Body,
    /// A body that turns at a prescribed, constant speed.
    Prescribed,
    /// A body with teeth.
    Sprocket,
    Span,
    /// The chain as a whole; the target's name is free.
    Chain,
    /// Every joint; the target is `chain`.
    Joints,
    /// A straight guide or a rail.
    Guide,
    /// A rail that bends.
    Blade,
    /// A plain bearing.
    Bearing,
    /// The valves of a camshaft.
    Valve,
    /// A torsion spring between two shafts.
    Coupling,
    /// An arm that carries rails.
    Arm,
    /// An annular gap that oil leaks through.
    Leak,
    /// A hole that oil flows through.
    Orifice,
    /// A check valve.
    Check,
    /// All oil of a drive; the target is `oil`.
    Oil,
    /// A measured input of a body.
    Input,
    /// A sensor of any kind except pulse pickups.
    Sensor,
    /// A sensor that reads the angle or speed of a rotating body.
    AngleSensor,
    Pickup,
}

impl On {
    /// Name of the target for users.
    pub fn label(self) -> &'static str {
        match self {
            On::Body => "a free body",
            On::Prescribed => "a body at a prescribed speed",
            On::Sprocket => "a body with teeth",
            On::Span => "a span or coupling",
            On::Chain => "the chain (any name)",
            On::Joints => "the chain's joints (`chain`)",
            On::Guide => "a guide",
            On::Blade => "a rail that bends",
            On::Bearing => "a plain bearing",
            On::Valve => "the valves of a camshaft",
            On::Coupling => "a coupling",
            On::Arm => "a tensioner arm",
            On::Leak => "a leak gap of oil",
            On::Orifice => "an orifice of oil",
            On::Check => "a check valve",
            On::Oil => "all oil (`oil`)",
            On::Input => "a measured input",
            On::Sensor => "a sensor of sampled values",
            On::AngleSensor => "a sensor of an angle or a speed",
            On::Pickup => "a pulse pickup",
        }
    }
}

/// Location of the cause, which the channel pattern and the speed law distinguish.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    Load,
    Shaft,
    Sprocket,
    Chain,
    Guide,
    Tensioner,
    Input,
    Sensor,
}

impl Part {
    pub fn label(self) -> &'static str {
        match self {
            Part::Load => "load",
            Part::Shaft => "shaft",
            Part::Sprocket => "sprocket",
            Part::Chain => "chain",
            Part::Guide => "guide",
            Part::Tensioner => "tensioner",
            Part::Input => "input",
            Part::Sensor => "sensor",
        }
    }
}

/// Scale of a starting value, found from the declared model and the records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    One,
    /// Typical magnitude of the force or torque that accelerates the body [N, N m].
    Force,
    /// Root mean square speed of the body [m/s, rad/s].
    Speed,
    ForcePerSpeed,
    ForcePerSpeed2,
    /// Root mean square stretch of the span [m, rad].
    Stretch,
    /// Stiffness of the span.
    Stiffness,
    /// Stiffness over stretch.
    StiffnessPerStretch,
    /// Stiffness over the highest angular frequency that the samples resolve.
    StiffnessTime,
    /// Tension of the span; divided by the stretch it gives the stiffness.
    Tension,
    /// Inertia of the body.
    Inertia,
    /// Standard deviation of the channel.
    Signal,
    /// Standard deviation of the channel over the length of a record.
    SignalPerTime,
    /// Root mean square of the input.
    Input,
    /// Reciprocal of `Input`.
    PerInput,
    /// Time between two samples [s].
    SampleTime,
    /// Length of the longest record [s].
    RecordTime,
    /// How far the body moves between two samples at its root mean square speed [m, rad].
    SampleTravel,
    /// Medium angular frequency of the samples [rad/s].
    Rate,
    /// 10 um.
    Micrometre10,
}

/// One parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// In the drive file, with its unit.
    pub key: &'static str,
    /// The same for a sliding body, whose unit differs.
    pub sliding_key: &'static str,
    /// The key's unit in SI.
    pub unit: f64,
    /// In the key's unit.
    pub low: f64,
    pub high: f64,
    /// Value that switches the effect off, in the key's unit.
    pub off: f64,
    /// Value if the key is not given; None: the key is required.
    pub default: Option<f64>,
    /// The same where the key is that of a sliding body, if it differs.
    pub sliding_default: Option<f64>,
    pub scale: Scale,
    /// Starting values as multiples of the scale.
    pub starts: &'static [f64],
    pub kind: Kind,
    /// Whether drives with links lack it.
    pub lumped_only: bool,
    /// How drives with links have it, if otherwise.
    pub on_links: Option<&'static Parameter>,
}

/// How a parameter is searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Strength of the effect: linear for small values.
    Amplitude,
    /// Shape of the effect, such as a speed, time or frequency: positive, searched by its logarithm.
    Shape,
    /// An angle [rad]; a fit has one for every record.
    Phase,
    /// An integer: an order, a link, a tooth. Not fitted: every value of `starts` is a separate hypothesis.
    Whole,
    /// Index of a link, joint or gap. As [`Kind::Whole`]; in a record it only shifts the position at which the drive
    /// starts.
    Index,
    /// One value for every mark of a pulse pickup except the first. In `key`, `#` stands for the number.
    PerMark,
    /// Internal state at the start of a record segment; fitted for every segment.
    Start,
    /// Never fitted: given by a data sheet, or assumed.
    Given,
    /// A shape that is not fitted, because runs are costly: every value of `starts` is a separate hypothesis.
    Tried,
}

impl Kind {
    /// Whether it is an integer, which no fit changes.
    pub fn is_whole(self) -> bool {
        matches!(self, Kind::Whole | Kind::Index)
    }

    /// Whether it is the strength of the effect.
    pub fn is_amplitude(self) -> bool {
        matches!(self, Kind::Amplitude | Kind::PerMark)
    }
}

impl Parameter {
    /// A parameter with the same key for rotating and sliding bodies.
    pub const fn new(key: &'static str, unit: f64, low: f64, high: f64, kind: Kind) -> Parameter {
        Parameter {
            key,
            sliding_key: key,
            unit,
            low,
            high,
            off: 0.0,
            default: None,
            sliding_default: None,
            scale: Scale::One,
            starts: &[1.0],
            kind,
            lumped_only: false,
            on_links: None,
        }
    }

    pub const fn sliding(mut self, key: &'static str) -> Parameter {
        self.sliding_key = key;
        self
    }

    pub const fn starts(mut self, scale: Scale, starts: &'static [f64]) -> Parameter {
        self.scale = scale;
        self.starts = starts;
        self
    }

    pub const fn default(mut self, value: f64) -> Parameter {
        self.default = Some(value);
        self
    }

    pub const fn default_of_slides(mut self, value: f64) -> Parameter {
        self.sliding_default = Some(value);
        self
    }

    /// Value if this key of it is not given; None: it is required.
    pub fn default_for(&self, key: &str) -> Option<f64> {
        self.sliding_default.filter(|_| key == self.sliding_key && key != self.key).or(self.default)
    }

    pub const fn lumped_only(mut self) -> Parameter {
        self.lumped_only = true;
        self
    }

    pub const fn on_links(mut self, other: &'static Parameter) -> Parameter {
        self.on_links = Some(other);
        self
    }

    /// Whether only integers make sense: orders whose range begins with a half may be halves, as those of four-stroke engines are.
    pub fn is_integer(&self) -> bool {
        self.kind.is_whole() && self.low == libm::trunc(self.low)
    }

    /// What a file may say, in the key's unit.
    pub fn range(&self) -> std::ops::RangeInclusive<f64> {
        self.low..=self.high
    }

    pub const fn off(mut self, value: f64) -> Parameter {
        self.off = value;
        self
    }
}

/// State of a body at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyAt {
    /// Angle or position [rad, m].
    pub q: f64,
    /// Speed [rad/s, m/s].
    pub v: f64,
}

/// State of a span at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpanAt {
    pub stretch: f64,
    pub rate: f64,
    /// Declared stiffness.
    pub stiffness: f64,
    /// Declared force at this stretch and rate.
    pub force: f64,
}

/// Position of the chain relative to a span.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainAt {
    /// Links that have passed the driver since the start.
    pub travel: f64,
    pub links: f64,
    /// First and last link of the span at the start, counted along the loop.
    pub from: f64,
    pub to: f64,
}

/// Output of a sensor at every node of the integration.
#[derive(Debug)]
pub struct Trace<'a> {
    pub step_s: f64,
    pub values: &'a mut Vec<f64>,
    /// Angle or position of the body that is read [rad, m].
    pub angles: &'a [f64],
    /// 0 for an angle, 1 for a speed: determines how an angle error enters.
    pub derivative: u8,
}

/// How far ahead a channel with a clock of its own is read, at a time since the record began [s].
pub type OwnClockLaw = fn(&[f64], f64) -> f64;
/// Force on a body [N, N m] from the effect's parameters.
pub type BodyLaw = fn(&[f64], BodyAt) -> f64;
/// The same, with the time since the record began [s].
pub type TimedLaw = fn(&[f64], BodyAt, f64) -> f64;
/// Force on a body [N, N m] beside the force of an input that acts on it, which is the last argument [N, N m].
pub type LoadedLaw = fn(&[f64], BodyAt, f64) -> f64;

/// A force on a body with an inner state.
#[derive(Clone, Copy)]
pub struct StateLaw {
    /// Force at a state [N, N m].
    pub force: fn(&[f64], f64) -> f64,
    /// State after a state, once the body has moved on by a distance [m, rad] in one direction.
    pub moved: fn(&[f64], f64, f64) -> f64,
    /// Index of the parameter that is the state at the start of a record.
    pub start: usize,
    /// Stiffness at rest [N/m, N m/rad], and how fast the state follows at a speed [1/s]: what a step must resolve.
    pub stiffness: fn(&[f64]) -> f64,
    pub fastest: fn(&[f64], f64) -> f64,
}
/// Factor of a prescribed speed minus one, as a function of angle.
pub type MotionLaw = fn(&[f64], f64) -> f64;
/// Torque on a sprocket from the chain's position and the sprocket's speed [N m].
pub type ChainTorqueLaw = fn(&[f64], ChainAt, f64) -> f64;
/// Offset of a mark from its even spacing [gaps], and delay of its pulse [s].
pub type MarkLaw = fn(&[f64], usize) -> (f64, f64);

/// The law of an effect.
#[derive(Clone, Copy)]
pub enum Physics {
    /// Force on a body [N, N m].
    BodyForce(BodyLaw),
    /// Force on a body that changes with time [N, N m].
    TimedForce(TimedLaw),
    /// Force on the body of an input that depends on the input's force [N, N m].
    LoadedForce(LoadedLaw),
    /// Force on a body with an inner state [N, N m].
    StateForce(StateLaw),
    /// Lengthening of a span's path at a sprocket as a function of the sprocket's angle, and its slope [m, m/rad].
    SpanLength(fn(&[f64], u32, f64) -> (f64, f64)),
    /// Lengthening of a span as a function of the chain's travel, and its slope [m, m/link].
    ChainLength(fn(&[f64], ChainAt) -> (f64, f64)),
    /// Torque on a sprocket as a function of the chain's travel; the arguments are those of the span that ends there [N
    /// m].
    ChainTorque(ChainTorqueLaw),
    /// Additional force of a span [N, N m].
    SpanForce(fn(&[f64], SpanAt) -> f64),
    /// Torque on the bodies at both ends, from tension and speed [N m].
    SpanLoss(fn(&[f64], f64, f64) -> f64),
    /// A second body behind a spring: attached to the declared body, or taking the sensors with it.
    SecondBody {
        sensors_move: bool,
    },
    /// Factor of a prescribed speed as a function of angle.
    Motion(MotionLaw),
    /// Transforms an input that is given at equal steps [s]. If the last argument is true, the input is constant during
    /// each step and the result is its mean over every step.
    Input(fn(&[f64], &mut [f64], f64, bool)),
    Signal(fn(&[f64], &mut Trace)),
    /// Offset of a mark from its even spacing [gaps], and delay of its pulse [s].
    Marks(MarkLaw),
    /// Time read by the recorder per true time, minus one.
    Clock(fn(&[f64]) -> f64),
    OwnClock(OwnClockLaw),
    /// Intervals that contain two pulses; detected when the record is read.
    Intake,
    /// Only for drives with link bodies.
    LinksOnly,
}

/// A row of the catalogue.
pub struct Effect {
    pub name: &'static str,
    pub title: &'static str,
    pub part: Part,
    pub on: On,
    pub equation: &'static str,
    pub source: &'static str,
    /// Orders of its shaft at which it appears, or its other signature.
    pub order: &'static str,
    /// How its magnitude, as a force, depends on speed.
    pub speed_law: &'static str,
    pub channels: &'static str,
    pub parameters: &'static [Parameter],
    /// Whether it only dissipates energy.
    pub dissipative: bool,
    pub physics: Physics,
    /// Kind of target in drives with link bodies, if they support it.
    pub links: Option<On>,
    pub highest_order: HighestOrder,
    pub kin: Kin,
}

/// Highest order of a body's turns at which a law varies with an angle: a step must follow it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HighestOrder {
    /// It does not depend on an angle, or only as its signal does.
    None,
    Once,
    /// The value of the parameter with this index.
    Parameter(usize),
    /// As often as teeth pass.
    Teeth,
}

/// How an effect relates to others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kin {
    /// Family of the effects that have the same cause and different laws; None: it is a family of its own.
    pub family: Option<&'static str>,
    /// What records show of it, which is hard to tell from others of the same look.
    pub look: Option<Look>,
    /// The number of the drive that does the same.
    pub twin: Option<Twin>,
}

impl Kin {
    pub const NONE: Kin = Kin { family: None, look: None, twin: None };
}

/// Effects that records confuse; an experiment tells them apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    Friction,
    /// Repeats with every turn of a shaft.
    OncePerTurn,
    /// The marks of a pulse pickup or an encoder.
    Marks,
    /// Repeats with the chain.
    Chain,
    Lag,
}

/// A number of the declared drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Twin {
    SpanStiffness,
    SpanDamping,
    SensorGain,
}

impl Effect {
    /// Family of effects with the same cause and different laws; friction is one family.
    pub fn family(&self) -> &'static str {
        self.kin.family.unwrap_or(self.name)
    }

    /// Path of a parameter in a drive file.
    pub fn path(&self, target: &str, key: &str) -> String {
        format!("effects.{}.{target}.{key}", self.name)
    }
}

impl Effect {
    /// The order among these values of its parameters; None: it is no wave.
    pub fn order_in(&self, values: &[f64]) -> Option<f64> {
        self.parameters.iter().zip(values).find(|(p, _)| p.key == "order").map(|(_, order)| *order)
    }

    /// Whether it differs round the turn of the body that it acts on; friction and drag are the same all round.
    pub fn differs_round_turn(&self) -> bool {
        self.links == Some(On::Sprocket) || self.parameters.iter().any(|p| p.kind == Kind::Phase)
    }
}

impl std::fmt::Debug for Effect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

impl PartialEq for Effect {
    fn eq(&self, other: &Effect) -> bool {
        self.name == other.name
    }
}

/// The catalogue. Effects on sensors are in the order in which a signal passes them.
pub const EFFECTS: [&Effect; 65] = [
    &sprocket_runout::ROW,
    &tooth_pitch_error::ROW,
    &gap_error::ROW,
    &polygon::ROW,
    &pitch_error::ROW,
    &link_mass::ROW,
    &alternate_pitch::ROW,
    &wear_elongation::ROW,
    &tight_joint::ROW,
    &pin_friction::ROW,
    &joint_clearance::ROW,
    &joint_stiffness::ROW,
    &joint_damping::ROW,
    &span_stiffness::ROW,
    &span_hardening::ROW,
    &span_damping::ROW,
    &slack_span::ROW,
    &backlash::ROW,
    &guide_compliance::ROW,
    &guide_friction::ROW,
    &arm_compliance::ROW,
    &blade_stiffness::ROW,
    &leak_gap::ROW,
    &orifice_diameter::ROW,
    &check_leak::ROW,
    &oil_air::ROW,
    &oil_viscosity::ROW,
    &bearing_clearance::ROW,
    &coupling_stiffness::ROW,
    &torsional_resonance::ROW,
    &flexible_coupling::ROW,
    &coulomb_friction::ROW,
    &stribeck_friction::ROW,
    &presliding_friction::ROW,
    &warming_friction::ROW,
    &viscous_friction::ROW,
    &quadratic_drag::ROW,
    &constant_torque::ROW,
    &torque_ripple::ROW,
    &unbalance::ROW,
    &valve_spring::ROW,
    &speed_fluctuation::ROW,
    &load_friction::ROW,
    &input_gain_curve::ROW,
    &input_gain_by_sign::ROW,
    &input_saturation::ROW,
    &input_dead_zone::ROW,
    &input_offset::ROW,
    &input_delay::ROW,
    &input_lag::ROW,
    &mark_spacing::ROW,
    &mark_strength::ROW,
    &missed_pulses::ROW,
    &encoder_error::ROW,
    &sign_blind::ROW,
    &latency::ROW,
    &low_pass::ROW,
    &sensor_resonance::ROW,
    &gain_error::ROW,
    &offset::ROW,
    &drift::ROW,
    &quantisation::ROW,
    &time_base::ROW,
    &clock_offset::ROW,
    &clock_drift::ROW,
];

/// Declared loads are effects under another name: table of `[loads]`, row of the catalogue.
pub const LOADS: [(&str, &Effect); 6] = [
    ("constant", &constant_torque::ROW),
    ("viscous", &viscous_friction::ROW),
    ("quadratic", &quadratic_drag::ROW),
    ("friction", &coulomb_friction::ROW),
    ("stribeck", &stribeck_friction::ROW),
    ("harmonic", &torque_ripple::ROW),
];

/// The row with this `name`.
pub fn named(name: &str) -> Option<&'static Effect> {
    EFFECTS.iter().find(|e| e.name == name).copied()
}

/// The parameter that a path in a drive file names, `effects.NAME.TARGET.KEY`.
pub fn parameter_at(path: &str) -> Option<&'static Parameter> {
    let (name, rest) = path.strip_prefix("effects.")?.split_once('.')?;
    let (_, key) = rest.rsplit_once('.')?;
    named(name)?.parameters.iter().find(|p| p.key == key || p.sliding_key == key)
}

/// Smooth sign for friction: v / sqrt(v^2 + width^2), an odd function from -1 to 1. Its maximum slope equals that of
/// tanh(v / width), which took a fifth of a search's time.
pub fn soft_sign(v: f64, width: f64) -> f64 {
    v / libm::sqrt(v * v + width * width)
}
