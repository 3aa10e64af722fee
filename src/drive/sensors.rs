//! Sensors of a drive with links, and what they get wrong.

use super::effects::parameters;
use super::reader::TomlTable;
use crate::effects::{EFFECTS, Effect, Kind, On, Physics};

/// A sensor on a drive with links.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSpec {
    /// Last part of its path in the file; effects are put on it.
    pub name: String,
    /// Path in the file: `sensors.KIND.NAME`.
    pub path: String,
    /// Its row of the catalogue.
    pub kind: &'static SensorKind,
    /// The quantity that it reads.
    pub reads: SensorReads,
    /// Value shown per SI unit.
    pub gain: f64,
    /// Its own unit, where it has one; else SI.
    pub unit: Option<String>,
}

/// A kind of sensor: all that files, lists and readers know of it.
#[derive(Clone, Copy, Debug)]
pub struct SensorKind {
    /// As in `[sensors.KIND.NAME]`.
    pub name: &'static str,
    /// What it reads, in words.
    pub reads: &'static str,
    /// SI unit; of some kinds it depends on what is read.
    pub unit: &'static str,
    /// Keys that say what it reads where NAME does not, and others of its own; `gain` and `unit` have all.
    pub keys: &'static str,
    /// What it reads of a lumped drive; None: lumped drives have none.
    pub lumped: Option<LumpedReads>,
    /// What its table of a drive with links says that it reads; None: drives with links have none.
    pub links: Option<fn(&SensorTable<'_, '_>) -> SensorReads>,
    /// Whether errors of sensors of angles are put on it, besides those of all sensors.
    pub has_angle_errors: bool,
}

/// Rows of the catalogue are told apart by their names.
impl PartialEq for SensorKind {
    fn eq(&self, other: &SensorKind) -> bool {
        self.name == other.name
    }
}

/// What a sensor reads of a lumped drive, in the order in which they are read from the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LumpedReads {
    /// Angle of a rotor.
    Angle,
    /// Position of a slider.
    Position,
    /// Speed of a rotor or slider.
    Speed,
    /// Time between marks.
    Pulses,
    /// Acceleration of a rotor or slider.
    Acceleration,
    /// Force of a spring.
    Tension,
    /// What must turn a body with prescribed motion.
    Torque,
    /// What must push a body with prescribed motion.
    Force,
}

/// All kinds. A drive with links reads them in this order.
pub static SENSORS: [SensorKind; 11] = [
    SensorKind {
        name: "encoder",
        reads: "angle of a rotor",
        unit: "rad",
        keys: "body",
        lumped: Some(LumpedReads::Angle),
        links: Some(|s| SensorReads::Angle(s.turning())),
        has_angle_errors: true,
    },
    SensorKind {
        name: "tachometer",
        reads: "speed of a rotor; lumped: or of a slider",
        unit: "rad/s or m/s",
        keys: "body",
        lumped: Some(LumpedReads::Speed),
        links: Some(|s| SensorReads::Speed(s.turning())),
        has_angle_errors: true,
    },
    SensorKind {
        name: "pulse_pickup",
        reads: "time between the marks of a rotor",
        unit: "s",
        keys: "body, marks",
        lumped: Some(LumpedReads::Pulses),
        links: None,
        has_angle_errors: true,
    },
    SensorKind {
        name: "accelerometer",
        reads: "acceleration of a rotor; lumped: or of a slider",
        unit: "rad/s^2 or m/s^2",
        keys: "body",
        lumped: Some(LumpedReads::Acceleration),
        links: Some(|s| SensorReads::Acceleration(s.turning())),
        has_angle_errors: false,
    },
    SensorKind {
        name: "torque",
        reads: "what must turn a body with prescribed motion from outside",
        unit: "N m or N",
        keys: "body",
        lumped: Some(LumpedReads::Torque),
        links: Some(|s| s.torque()),
        has_angle_errors: false,
    },
    SensorKind {
        name: "strain_gauge",
        reads: "force of a span, coupling or ground; links: of a span, or of a link that goes round",
        unit: "N or N m",
        keys: "span; links: span = [\"A\", \"B\"] or link = 12",
        lumped: Some(LumpedReads::Tension),
        links: Some(|s| tension(s.table, s.targets.spans)),
        has_angle_errors: false,
    },
    SensorKind {
        name: "force",
        reads: "what must push a slider with prescribed motion; links: of a guide, or of a slider's tip",
        unit: "N",
        keys: "body; links: guide, or tip = \"SLIDER\"",
        lumped: Some(LumpedReads::Force),
        links: Some(|s| s.force()),
        has_angle_errors: false,
    },
    SensorKind {
        name: "displacement",
        reads: "position of a slider; links: or lift of a valve",
        unit: "m",
        keys: "body; links: or valve = \"VALVE.NUMBER\"",
        lumped: Some(LumpedReads::Position),
        links: Some(|s| s.displacement()),
        has_angle_errors: false,
    },
    SensorKind {
        name: "twist",
        reads: "turn of an elastic shaft's free end against what turns it",
        unit: "rad",
        keys: "shaft",
        lumped: None,
        links: Some(|s| SensorReads::Twist(s.named("elastic shaft", "shaft", &s.targets.parts.elastic_shafts))),
        has_angle_errors: false,
    },
    SensorKind {
        name: "pressure",
        reads: "gauge pressure in a chamber",
        unit: "Pa",
        keys: "chamber",
        lumped: None,
        links: Some(|s| SensorReads::Pressure(s.named("chamber", "chamber", &s.targets.parts.chambers))),
        has_angle_errors: false,
    },
    SensorKind {
        name: "flow",
        reads: "flow through a passage, from its first end to its second",
        unit: "m^3/s",
        keys: "passage",
        lumped: None,
        links: Some(|s| SensorReads::Flow(s.named("passage", "passage", &s.targets.parts.passages))),
        has_angle_errors: false,
    },
];

/// What sensors of a drive with links can be on.
#[derive(Clone, Copy)]
pub struct SensorTargets<'a> {
    /// Sprockets of every chain, in the order of its route.
    pub(super) spans: &'a [Vec<String>],
    /// Sprockets, then what else turns.
    pub(super) turning: &'a [String],
    /// The sprocket with the prescribed speed.
    pub(super) driver: Option<&'a str>,
    pub(super) guides: &'a [&'a str],
    pub(super) parts: &'a MechanismNames<'a>,
}

/// The table of a sensor in a drive file.
pub struct SensorTable<'t, 'a> {
    table: &'t TomlTable<'t>,
    name: &'t str,
    targets: SensorTargets<'a>,
}

impl SensorTable<'_, '_> {
    /// Index of what a key names, or else the sensor's own name.
    fn named(&self, what: &str, key: &str, known: &[&str]) -> usize {
        let on = self.table.text(key).unwrap_or_else(|| self.name.to_string());
        index(self.table, what, &on, known)
    }

    /// What turns that it is on.
    fn turning(&self) -> usize {
        let known: Vec<&str> = self.targets.turning.iter().map(String::as_str).collect();
        self.named("sprocket, shaft or arm", "body", &known)
    }

    fn torque(&self) -> SensorReads {
        let k = self.turning();
        let on = self.targets.turning.get(k).map(String::as_str);
        if self.targets.driver != on {
            self.table.error(
                format!("`{}` moves freely: nothing holds it from outside", on.unwrap_or(self.name)),
                Some("a torque sensor sits on the sprocket with the prescribed speed".into()),
            );
        }
        SensorReads::Torque(k)
    }

    fn displacement(&self) -> SensorReads {
        if self.table.has("valve") {
            let known: Vec<&str> = self.targets.parts.valves.iter().map(String::as_str).collect();
            return SensorReads::Valve(self.named("valve", "valve", &known));
        }
        SensorReads::Slider(self.named("slider", "body", &self.targets.parts.sliders))
    }

    fn force(&self) -> SensorReads {
        if self.table.has("tip") {
            return SensorReads::Tip(self.named("slider", "tip", &self.targets.parts.sliders));
        }
        SensorReads::Guide(self.named("guide", "guide", self.targets.guides))
    }
}

/// What it reads; sprockets and guides by index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorReads {
    /// Angle, speed or acceleration of what turns [rad, rad/s, rad/s2]: the index counts sprockets, then shafts without sprockets, then arms.
    Angle(usize),
    /// Speed of this sprocket [rad/s].
    Speed(usize),
    /// Acceleration of this sprocket [rad/s2].
    Acceleration(usize),
    /// What turns the sprocket with the prescribed speed [N m].
    Torque(usize),
    /// Tension in the middle of the span that leaves this sprocket [N].
    Span(usize),
    /// Tension of this link, which goes round with it [N].
    Link(usize),
    /// Sum of the normal forces on this guide [N].
    Guide(usize),
    /// Way of this slider from where it is drawn [m].
    Slider(usize),
    /// Lift of this valve, counted through all of them [m].
    Valve(usize),
    /// Force of this slider's tip [N].
    Tip(usize),
    /// Turn of this elastic shaft's free end against what turns it [rad].
    Twist(usize),
    /// Gauge pressure in this chamber [Pa], and flow through this passage from its first end to its second [m3/s].
    Pressure(usize),
    /// Flow through this passage from its first end to its second [m3/s].
    Flow(usize),
}

impl SensorReads {
    /// SI unit of the reading.
    pub fn unit(self) -> &'static str {
        match self {
            SensorReads::Angle(_) | SensorReads::Twist(_) => "rad",
            SensorReads::Speed(_) => "rad/s",
            SensorReads::Acceleration(_) => "rad/s^2",
            SensorReads::Torque(_) => "N m",
            SensorReads::Span(_) | SensorReads::Link(_) | SensorReads::Guide(_) | SensorReads::Tip(_) => "N",
            SensorReads::Slider(_) | SensorReads::Valve(_) => "m",
            SensorReads::Pressure(_) => "Pa",
            SensorReads::Flow(_) => "m^3/s",
        }
    }
}

/// An effect on a sensor's signal.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalSpec {
    /// Row of the catalogue.
    pub effect: &'static Effect,
    /// Path in the file: `effects.NAME.SENSOR`.
    pub path: String,
    /// Index of the sensor.
    pub sensor: usize,
    /// Of its parameters, in their order, SI.
    pub values: Vec<f64>,
}

/// Whether an effect is one of signals that drives with links take.
pub fn is_signal(effect: &Effect) -> bool {
    matches!(effect.physics, Physics::Signal(_) | Physics::Clock(_) | Physics::OwnClock(_))
        && matches!(effect.on, On::Sensor | On::AngleSensor)
}

/// Names of sliders, valves, elastic shafts, chambers and passages.
pub struct MechanismNames<'a> {
    pub(super) sliders: Vec<&'a str>,
    pub(super) valves: Vec<String>,
    pub(super) elastic_shafts: Vec<&'a str>,
    pub(super) chambers: Vec<&'a str>,
    pub(super) passages: Vec<&'a str>,
}

/// Reads `[sensors.KIND.NAME]`.
pub(super) fn sensors(root: &TomlTable<'_>, targets: SensorTargets<'_>) -> Vec<SensorSpec> {
    let table = root.table("sensors");
    let mut all: Vec<SensorSpec> = Vec::new();
    for kind in &SENSORS {
        let of_kind = table.table(kind.name);
        for (name, t) in of_kind.tables() {
            let Some(links) = kind.links else {
                t.error(
                    format!("a drive with links has no sensor of the kind `{}`", kind.name),
                    Some("`pitchline sensors` lists the kinds".into()),
                );
                continue;
            };
            let reads = links(&SensorTable { table: &t, name: &name, targets });
            if all.iter().any(|s| s.name == name) {
                t.error(
                    format!("two sensors are called `{name}`"),
                    Some("give one of them another name, and `body`, `span` or `guide` what it reads: effects are put on names".into()),
                );
            }
            let gain = t.number("gain", 1.0, -1e12..=1e12).unwrap_or(1.0);
            all.push(SensorSpec { path: t.path().to_string(), name, kind, reads, gain, unit: t.text("unit") });
            t.finish();
        }
        if kind.links.is_some() {
            of_kind.finish();
        }
    }
    table.finish();
    all
}

fn index(t: &TomlTable<'_>, what: &str, name: &str, known: &[&str]) -> usize {
    known.iter().position(|n| *n == name).unwrap_or_else(|| {
        t.error(format!("no {what} is called `{name}`"), Some(format!("{what}s: {}", known.join(", "))));
        0
    })
}

/// `span = ["driven", "driver"]` or `link = 12`.
fn tension(t: &TomlTable<'_>, chains: &[Vec<String>]) -> SensorReads {
    let link = t.integer("link", 0..=100_000);
    let span = t.texts("span");
    if let (Some(link), None) = (link, &span) {
        return SensorReads::Link(link as usize);
    }
    // Every sprocket with the next one of its chain.
    let of_chain = |names: &'_ Vec<String>| {
        let next = names.iter().cycle().skip(1).cloned();
        names.iter().cloned().zip(next).collect::<Vec<(String, String)>>()
    };
    let spans: Vec<(String, String)> = chains.iter().flat_map(of_chain).collect();
    let meant = |(from, to): &(String, String)| span.as_ref().is_some_and(|s| *s == [from.clone(), to.clone()]);
    match spans.iter().position(meant) {
        Some(sprocket) if link.is_none() => SensorReads::Span(sprocket),
        _ => {
            let known: Vec<String> = spans.iter().map(|(from, to)| format!("[\"{from}\", \"{to}\"]")).collect();
            t.error(
                format!("`{}` does not say whose tension it reads", t.path()),
                Some(format!("add `link = 0`, or `span` with one of {}", known.join(", "))),
            );
            SensorReads::Link(0)
        }
    }
}

/// Reads effects on sensors out of `[effects]`, in the order in which a signal passes them.
pub(super) fn signals(t: &TomlTable<'_>, sensors: &[SensorSpec]) -> Vec<SignalSpec> {
    let mut all = Vec::new();
    for effect in EFFECTS.into_iter().filter(|e| is_signal(e)) {
        let of_kind = t.table(effect.name);
        for (name, own) in of_kind.tables_or_set() {
            let values = parameters(&own, effect, false);
            let fits = |s: &SensorSpec| {
                s.name == name.trim_end_matches('+') && (s.kind.has_angle_errors || effect.on == On::Sensor)
            };
            match sensors.iter().position(fits) {
                Some(sensor) => all.push(SignalSpec { effect, path: own.path().to_string(), sensor, values }),
                None => {
                    let known: Vec<&str> = sensors.iter().map(|s| s.name.as_str()).collect();
                    own.error(
                        format!("`{}` goes on {}, and `{name}` is none", effect.name, effect.on.label()),
                        Some(format!("sensors: {}", known.join(", "))),
                    );
                }
            }
            own.finish();
        }
        of_kind.finish();
    }
    debug_assert!(all.iter().all(|s| s.effect.parameters.iter().all(|p| p.kind != Kind::PerMark)));
    all
}
