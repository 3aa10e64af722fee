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
    /// The quantity that it reads.
    pub reads: SensorReads,
    /// Value shown per SI unit.
    pub gain: f64,
    /// Its own unit, where it has one; else SI.
    pub unit: Option<String>,
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
    /// Way of this slider from where it is drawn [m], and the force of its tip [N].
    Slider(usize),
    /// Force of this slider's tip [N].
    Tip(usize),
    /// Gauge pressure in this chamber [Pa], and flow through this passage from its first end to its second [m3/s].
    Pressure(usize),
    /// Flow through this passage from its first end to its second [m3/s].
    Flow(usize),
}

impl SensorReads {
    /// SI unit of the reading.
    pub fn unit(self) -> &'static str {
        match self {
            SensorReads::Angle(_) => "rad",
            SensorReads::Speed(_) => "rad/s",
            SensorReads::Acceleration(_) => "rad/s^2",
            SensorReads::Torque(_) => "N m",
            SensorReads::Span(_) | SensorReads::Link(_) | SensorReads::Guide(_) | SensorReads::Tip(_) => "N",
            SensorReads::Slider(_) => "m",
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
    matches!(effect.physics, Physics::Signal(_) | Physics::Clock(_))
        && matches!(effect.on, On::Sensor | On::AngleSensor)
}

/// Kinds that lumped drives alone have.
const LUMPED_ONLY: [&str; 1] = ["pulse_pickup"];

/// Names of sliders, chambers and passages.
pub(super) struct MechanismNames<'a> {
    pub(super) sliders: Vec<&'a str>,
    pub(super) chambers: Vec<&'a str>,
    pub(super) passages: Vec<&'a str>,
}

/// What reads a slider, a chamber or a passage.
fn of_mechanism(t: &TomlTable<'_>, kind: &str, name: &str, parts: &MechanismNames<'_>) -> SensorReads {
    let on = |key: &str| t.text(key).unwrap_or_else(|| name.to_string());
    match kind {
        "displacement" => SensorReads::Slider(index(t, "slider", &on("body"), &parts.sliders)),
        "pressure" => SensorReads::Pressure(index(t, "chamber", &on("chamber"), &parts.chambers)),
        _ => SensorReads::Flow(index(t, "passage", &on("passage"), &parts.passages)),
    }
}

/// What reads the force on a guide, or of the tip of a slider.
fn force(t: &TomlTable<'_>, name: &str, guides: &[&str], parts: &MechanismNames<'_>) -> SensorReads {
    if t.has("tip") {
        let on = t.text("tip").unwrap_or_default();
        return SensorReads::Tip(index(t, "slider", &on, &parts.sliders));
    }
    let on = t.text("guide").unwrap_or_else(|| name.to_string());
    SensorReads::Guide(index(t, "guide", &on, guides))
}

/// What reads the turning of a sprocket, a shaft or an arm, or the torque of the driver.
fn of_turning((t, kind, name): (&TomlTable<'_>, &str, &str), turning: &[String], driver: Option<&str>) -> SensorReads {
    let on = t.text("body").unwrap_or_else(|| name.to_string());
    let known: Vec<&str> = turning.iter().map(String::as_str).collect();
    let k = index(t, "sprocket, shaft or arm", &on, &known);
    if kind == "torque" && driver != Some(on.as_str()) {
        t.error(
            format!("`{on}` moves freely: nothing holds it from outside"),
            Some("a torque sensor sits on the sprocket with the prescribed speed".into()),
        );
    }
    match kind {
        "encoder" => SensorReads::Angle(k),
        "tachometer" => SensorReads::Speed(k),
        "accelerometer" => SensorReads::Acceleration(k),
        _ => SensorReads::Torque(k),
    }
}

/// Reads `[sensors.KIND.NAME]`. `chains`: the sprockets of each; `turning`: sprockets, then what else turns.
pub(super) fn sensors(
    root: &TomlTable<'_>,
    (chains, turning): (&[Vec<String>], &[String]),
    driver: Option<&str>,
    guides: &[&str],
    parts: &MechanismNames<'_>,
) -> Vec<SensorSpec> {
    let table = root.table("sensors");
    let mut all: Vec<SensorSpec> = Vec::new();
    for kind in LUMPED_ONLY {
        let of_kind = table.table(kind);
        for (_, t) in of_kind.tables() {
            t.error(
                format!("a drive with links has no sensor of the kind `{kind}`"),
                Some("`pitchline sensors` lists the kinds".into()),
            );
        }
    }
    for kind in [
        "encoder",
        "tachometer",
        "accelerometer",
        "torque",
        "strain_gauge",
        "force",
        "displacement",
        "pressure",
        "flow",
    ] {
        let of_kind = table.table(kind);
        for (name, t) in of_kind.tables() {
            let reads = match kind {
                "strain_gauge" => tension(&t, chains),
                "displacement" | "pressure" | "flow" => of_mechanism(&t, kind, &name, parts),
                "force" => force(&t, &name, guides, parts),
                _ => of_turning((&t, kind, &name), turning, driver),
            };
            if all.iter().any(|s| s.name == name) {
                t.error(
                    format!("two sensors are called `{name}`"),
                    Some("give one of them another name, and `body`, `span` or `guide` what it reads: effects are put on names".into()),
                );
            }
            let gain = t.number("gain", 1.0, -1e12..=1e12).unwrap_or(1.0);
            all.push(SensorSpec { path: t.path().to_string(), name, reads, gain, unit: t.text("unit") });
            t.finish();
        }
        of_kind.finish();
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
    // Of every sprocket the next one of its chain.
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
                let turns = matches!(s.reads, SensorReads::Angle(_) | SensorReads::Speed(_));
                s.name == name.trim_end_matches('+') && (turns || effect.on == On::Sensor)
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
