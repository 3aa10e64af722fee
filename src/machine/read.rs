//! Reading a lumped drive, table by table.

use super::{Body, BodyMotion, ChainLoop, End, Input, InputKind, Machine, Reads, Sensor, Slot, Spring, Target};
use crate::drive::reader::TomlTable;
use crate::drive::sensors::{LumpedReads, SENSORS};
use crate::effects::{EFFECTS, Effect, LOADS, On};
use crate::units::{MM, RPM};

/// Maximum number of marks whose spacing is fitted individually.
pub const MAX_MARKS: usize = 60;

/// Reads everything. The reader collects the errors; the returned values are then invalid.
pub(super) fn machine(root: &TomlTable<'_>) -> Machine {
    let mut m = Machine::empty(root.text("title").unwrap_or_default());
    // Text for people alone.
    root.text("source");
    root.choice("fidelity", &[("lumped", ())]);
    bodies(root, &mut m);
    springs(root, &mut m);
    inputs(root, &mut m);
    chain(root, &mut m);
    sensors(root, &mut m);
    loads(root, &mut m);
    read_effects(root, &mut m);
    if m.bodies.is_empty() {
        root.error("a machine needs a body".into(), Some("add `[rotors.NAME]` or `[sliders.NAME]`".into()));
    }
    if m.sensors.is_empty() {
        let kinds = "add `[sensors.tachometer.BODY]`; `pitchline sensors` lists the kinds";
        root.error("a machine needs a sensor".into(), Some(kinds.into()));
    }
    root.finish();
    m
}

/// Adds a slot that the file may give, or must give if there is no default.
fn slot(m: &mut Machine, t: &TomlTable<'_>, key: &str, unit: f64, range: (f64, f64), default: Option<f64>) -> usize {
    let value = match default {
        Some(default) => t.number(key, unit, range.0..=range.1).unwrap_or(default * unit),
        None => t.required(key, unit, range.0..=range.1),
    };
    let path = format!("{}.{key}", t.path());
    m.slots.push(Slot { path, unit, low: range.0, high: range.1 });
    m.values.push(value);
    m.slots.len() - 1
}

fn bodies(root: &TomlTable<'_>, m: &mut Machine) {
    let speeds = root.table("speeds");
    let constant = speeds.table("constant");
    for (kind, slides, key) in [("rotors", false, "inertia_kg_m2"), ("sliders", true, "mass_kg")] {
        let table = root.table(kind);
        for (name, t) in table.tables() {
            let speed = constant.table(&name);
            let motion = if speed.is_present() {
                BodyMotion::Constant(match slides {
                    false => slot(m, &speed, "speed_rpm", RPM, (-1e6, 1e6), None),
                    true => slot(m, &speed, "speed_m_s", 1.0, (-1e4, 1e4), None),
                })
            } else {
                BodyMotion::Free
            };
            speed.finish();
            let needs = if motion == BodyMotion::Free { None } else { Some(1.0) };
            let inertia = Some(slot(m, &t, key, 1.0, (1e-12, 1e9), needs));
            let teeth = t.integer("teeth", 5..=1000).map(|z| z as u32);
            if m.bodies.iter().any(|b| b.name == name) {
                t.error(format!("two bodies are called `{name}`"), Some("give one of them another name".into()));
            }
            m.bodies.push(Body { path: t.path().to_string(), name, slides, inertia, minus: None, teeth, motion });
            t.finish();
        }
        table.finish();
    }
    constant.finish();
    speeds.finish();
}

fn body_names(m: &Machine) -> String {
    m.bodies.iter().map(|b| b.name.clone()).collect::<Vec<_>>().join(", ")
}

fn body_named(m: &Machine, t: &TomlTable<'_>, name: &str) -> usize {
    m.bodies.iter().position(|b| b.name == name).unwrap_or_else(|| {
        t.error(format!("no body is called `{name}`"), Some(format!("bodies: {}", body_names(m))));
        0
    })
}

fn springs(root: &TomlTable<'_>, m: &mut Machine) {
    for kind in ["couplings", "spans", "grounds"] {
        let table = root.table(kind);
        for (name, t) in table.tables() {
            let key = if kind == "grounds" { "body" } else { "between" };
            let names = match kind {
                "grounds" => t.text(key).map(|n| vec![n]),
                _ => t.texts(key),
            };
            let wanted = if kind == "grounds" { 1 } else { 2 };
            let names = names.unwrap_or_default();
            if names.len() != wanted {
                let example =
                    if wanted == 1 { "body = \"NAME\"".to_string() } else { "between = [\"A\", \"B\"]".to_string() };
                t.error(format!("`{}` does not name the bodies at its ends", t.path()), Some(format!("add {example}")));
            }
            let mut ends = Vec::new();
            for (k, end) in names.iter().take(wanted).enumerate() {
                let body = body_named(m, &t, end);
                let gain = match kind {
                    "spans" => {
                        let key = ["from_radius_mm", "to_radius_mm"][k];
                        let slides = m.bodies.get(body).is_some_and(|b| b.slides);
                        // A slider moves with the span itself.
                        slot(m, &t, key, MM, (1e-3, 1e6), slides.then_some(1.0 / MM))
                    }
                    _ if k == 1 => slot(m, &t, "ratio", 1.0, (-1e6, 1e6), Some(1.0)),
                    _ => {
                        m.slots.push(Slot { path: format!("{}.one", t.path()), unit: 1.0, low: 1.0, high: 1.0 });
                        m.values.push(1.0);
                        m.slots.len() - 1
                    }
                };
                ends.push(End { body, gain, sign: if k == 0 { 1 } else { -1 } });
            }
            let slides = kind == "spans" || ends.iter().all(|e| m.bodies.get(e.body).is_some_and(|b| b.slides));
            let (k, c) = match slides {
                true => ("stiffness_n_per_m", "damping_n_s_per_m"),
                false => ("stiffness_nm_per_rad", "damping_nm_s_per_rad"),
            };
            let stiffness = slot(m, &t, k, 1.0, (0.0, 1e13), None);
            let damping = slot(m, &t, c, 1.0, (0.0, 1e10), Some(0.0));
            let from = t.number("from_link", 1.0, 0.0..=1e5);
            let to = t.number("to_link", 1.0, 0.0..=1e5);
            m.springs.push(Spring {
                path: t.path().to_string(),
                name,
                ends,
                stiffness,
                damping,
                tuned: None,
                links: from.zip(to),
            });
            t.finish();
        }
        table.finish();
    }
}

fn inputs(root: &TomlTable<'_>, m: &mut Machine) {
    let table = root.table("inputs");
    for kind in ["torque", "force", "speed", "angle", "position"] {
        let of_kind = table.table(kind);
        for (name, t) in of_kind.tables() {
            let on = t.text("body").unwrap_or_else(|| name.clone());
            let body = body_named(m, &t, &on);
            let kind = match kind {
                "torque" => InputKind::Force(slot(m, &t, "gain_nm_per_unit", 1.0, (-1e9, 1e9), Some(1.0))),
                "force" => InputKind::Force(slot(m, &t, "gain_n_per_unit", 1.0, (-1e9, 1e9), Some(1.0))),
                "speed" => InputKind::Speed,
                _ => InputKind::Angle,
            };
            if let (Some(b), false) = (m.bodies.get(body), matches!(kind, InputKind::Force(_))) {
                if b.motion != BodyMotion::Free {
                    t.error(format!("the motion of `{}` is given twice", b.name), Some("keep one of them".into()));
                }
                m.bodies[body].motion = BodyMotion::Measured(m.inputs.len());
            }
            m.inputs.push(Input { path: t.path().to_string(), name, body, kind });
            t.finish();
        }
        of_kind.finish();
    }
    table.finish();
}

fn chain(root: &TomlTable<'_>, m: &mut Machine) {
    let t = root.table("chain");
    if t.is_present() {
        let links = t.required_integer("links", 5..=100_000) as u32;
        let leader = t.text("leader");
        let leader = match leader {
            Some(name) => body_named(m, &t, &name),
            None => m.bodies.iter().position(|b| b.teeth.is_some()).unwrap_or(0),
        };
        if m.bodies.get(leader).is_none_or(|b| b.teeth.is_none()) {
            t.error("no body of this chain has teeth".into(), Some("add `teeth = ...` to its `[rotors.NAME]`".into()));
        }
        let sprockets = (0..m.bodies.len()).filter(|b| m.bodies[*b].teeth.is_some()).collect();
        m.chains = vec![ChainLoop { name: String::new(), links, first_link: 0, leader, sprockets }];
    }
    t.finish();
}

fn sensors(root: &TomlTable<'_>, m: &mut Machine) {
    let table = root.table("sensors");
    let mut kinds: Vec<_> = SENSORS.iter().filter_map(|kind| Some((kind.lumped?, kind))).collect();
    kinds.sort_by_key(|(reads, _)| *reads);
    for (of, kind) in kinds {
        let of_kind = table.table(kind.name);
        for (name, t) in of_kind.tables() {
            let on = |key: &str| t.text(key).unwrap_or_else(|| name.clone());
            let body = || body_named(m, &t, &on("body"));
            let reads = match of {
                LumpedReads::Angle | LumpedReads::Position => Reads::Angle(body()),
                LumpedReads::Speed => Reads::Speed(body()),
                LumpedReads::Acceleration => Reads::Acceleration(body()),
                LumpedReads::Pulses => {
                    Reads::Pulses { body: body(), marks: t.required_integer("marks", 1..=100_000) as usize }
                }
                LumpedReads::Tension => Reads::Tension(spring_named(m, &t, &on("span"))),
                LumpedReads::Torque | LumpedReads::Force => Reads::Reaction(prescribed(m, &t, &on("body"))),
            };
            if m.sensors.iter().any(|s| s.name == name) {
                let help = "give one of them another name, and `body` or `span` what it reads: effects refer to names";
                t.error(format!("two sensors are called `{name}`"), Some(help.into()));
            }
            let gain = slot(m, &t, "gain", 1.0, (-1e12, 1e12), Some(1.0));
            let unit = t.text("unit");
            m.sensors.push(Sensor { path: t.path().to_string(), name, reads, gain, unit });
            t.finish();
        }
        of_kind.finish();
    }
    table.finish();
}

fn spring_named(m: &Machine, t: &TomlTable<'_>, name: &str) -> usize {
    m.springs.iter().position(|s| s.name == name).unwrap_or_else(|| {
        let names: Vec<_> = m.springs.iter().map(|s| s.name.clone()).collect();
        let help = format!("spans, couplings and grounds: {}", names.join(", "));
        t.error(format!("no span is called `{name}`"), Some(help));
        0
    })
}

/// A body whose motion is prescribed, so that something outside drives it.
fn prescribed(m: &Machine, t: &TomlTable<'_>, name: &str) -> usize {
    let body = body_named(m, t, name);
    if m.bodies.get(body).is_some_and(|b| b.motion == BodyMotion::Free) {
        t.error(
            format!("`{name}` moves freely: no external torque or force drives it"),
            Some("prescribe its motion with `[inputs.speed.NAME]` or `[speeds.constant.NAME]`, or measure the torque of a coupling with `[sensors.strain_gauge.NAME]`".into()),
        );
    }
    body
}

fn loads(root: &TomlTable<'_>, m: &mut Machine) {
    let table = root.table("loads");
    for (kind, effect) in LOADS {
        let of_kind = table.table(kind);
        for (name, t) in of_kind.tables_or_set() {
            let on = t.text("body").unwrap_or_else(|| name.clone());
            let body = body_named(m, &t, &on);
            place(m, &t, effect, Target::Body(body));
            t.finish();
        }
        of_kind.finish();
    }
    table.finish();
}

fn read_effects(root: &TomlTable<'_>, m: &mut Machine) {
    let table = root.table("effects");
    for effect in EFFECTS {
        let of_kind = table.table(effect.name);
        for (name, t) in of_kind.tables_or_set() {
            match m.target(effect, &name) {
                Ok(target) => place(m, &t, effect, target),
                Err(e) => t.error(e.to_string(), Some("`pitchline effects NAME` says what it is put on".into())),
            }
            t.finish();
        }
        of_kind.finish();
    }
    table.finish();
}

/// Reads an effect's parameters and adds it to the machine.
fn place(m: &mut Machine, t: &TomlTable<'_>, effect: &'static Effect, target: Target) {
    let keys = m.keys(effect, target);
    let slots = keys.iter().map(|(key, p)| slot(m, t, key, p.unit, (p.low, p.high), p.default_for(key))).collect();
    m.attach_effect(effect, t.path().to_string(), target, slots);
}

/// Why an effect cannot be put on what its table names.
#[derive(Clone, Debug, PartialEq, Eq)]
enum TargetError {
    NoChain,
    /// The machine has nothing that bears the effect.
    NoneThere {
        effect: &'static str,
        on: &'static str,
    },
    /// The machine has some, and none with this name.
    Unknown {
        effect: &'static str,
        on: &'static str,
        known: Vec<String>,
    },
}

impl std::fmt::Display for TargetError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            TargetError::NoChain => f.write_str("this machine has no `[chain]`"),
            TargetError::NoneThere { effect, on } => write!(f, "`{effect}` needs {on}, and this machine has none"),
            TargetError::Unknown { effect, on, known } => write!(f, "`{effect}` goes on {on}: {}", known.join(", ")),
        }
    }
}

impl std::error::Error for TargetError {}

impl Machine {
    /// Resolves the target `name` of an effect.
    fn target(&self, effect: &Effect, name: &str) -> Result<Target, TargetError> {
        let known = self.targets(effect);
        // Trailing plus signs distinguish effects of the same kind at the same place.
        let name = name.trim_end_matches('+');
        if effect.on == On::Chain {
            return known.first().map(|(_, t)| *t).ok_or(TargetError::NoChain);
        }
        known.iter().find(|(n, _)| n == name).map(|(_, t)| *t).ok_or_else(|| {
            let (effect, on) = (effect.name, effect.on.label());
            match known.is_empty() {
                true => TargetError::NoneThere { effect, on },
                false => TargetError::Unknown { effect, on, known: known.iter().map(|(n, _)| n.clone()).collect() },
            }
        })
    }
}
