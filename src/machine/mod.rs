//! Lumped model of a drive: rotors and sliders, spans and couplings as springs, loads that depend on speed, inputs and
//! sensors. It has the same effects as a drive with link bodies.
//!
//! ```text
//! J_i q_i'' = sum of inputs, loads and effects - sum over springs (dl/dq_i) F
//! l = g_a q_a - g_b q_b + effects' lengths      F = k l + c l' + effects' forces
//! ```
//! g is the radius at a span's end, or 1 for a coupling. Every parameter is a slot of one list, found by its path in
//! the file, so that a fit changes a machine by writing into a list.

mod forces;
mod links;
mod place;
mod pulses;
mod read;
#[doc(hidden)]
pub mod simulate;

pub use links::gcd;

use crate::diag::Report;
use crate::drive::reader::{DriveReader, Places};
use crate::effects::Effect;

/// A checked lumped drive.
#[derive(Clone, Debug)]
pub struct Machine {
    /// Name of the file without its extension.
    pub name: String,
    /// The drive file, unchanged.
    pub text: String,
    /// Title in the file, or the name.
    pub title: String,
    /// Every parameter of the file, of its loads and of its effects.
    pub slots: Vec<Slot>,
    /// One for every slot, SI.
    pub values: Vec<f64>,
    /// What turns or slides.
    pub bodies: Vec<Body>,
    /// Couplings, spans and springs to the ground.
    pub springs: Vec<Spring>,
    /// Measured columns that act on bodies.
    pub inputs: Vec<Input>,
    /// What is compared with measured columns.
    pub sensors: Vec<Sensor>,
    /// Loads and effects; effects on sensors are in the order of the catalogue.
    pub placed: Vec<PlacedEffect>,
    /// The chain, where bodies have teeth; None: no effect of a chain is searched.
    pub chain: Option<ChainLoop>,
    /// For a drive with link bodies: data that the lumped form does not contain.
    pub linked: Option<LinkedDrive>,
    /// Where every value stands in the file, for errors.
    pub places: Places,
}

#[doc(hidden)]
/// A parameter of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Slot {
    pub path: String,
    /// SI value of the unit in its name.
    pub unit: f64,
    /// In the unit of its name.
    pub low: f64,
    pub high: f64,
}

#[doc(hidden)]
/// A body with one coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    pub name: String,
    pub path: String,
    /// Moves along a line instead of round an axis.
    pub slides: bool,
    /// Slot of its inertia or mass.
    pub inertia: usize,
    /// Slot of the inertia that an added second body has taken from it.
    pub minus: Option<usize>,
    pub teeth: Option<u32>,
    pub motion: BodyMotion,
}

#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodyMotion {
    Free,
    /// Slot of the speed.
    Constant(usize),
    /// Index of the input that gives speed or angle.
    Measured(usize),
}

#[doc(hidden)]
/// One end of a spring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct End {
    pub body: usize,
    /// Slot of the radius or ratio.
    pub gain: usize,
    pub sign: i8,
}

#[doc(hidden)]
/// A coupling, a span or a spring to the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Spring {
    pub name: String,
    pub path: String,
    pub ends: Vec<End>,
    /// Slots of stiffness and damping; for a tuned spring, of eigenfrequency and damping ratio.
    pub stiffness: usize,
    pub damping: usize,
    /// Slot of the inertia for which a spring is tuned: k = J w^2, c = 2 zeta J w.
    pub tuned: Option<usize>,
    /// Links at its ends, counted along the loop, for effects of single links.
    pub links: Option<(f64, f64)>,
}

#[doc(hidden)]
/// How a measured column acts on a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Input {
    pub name: String,
    pub path: String,
    pub body: usize,
    pub kind: InputKind,
}

#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputKind {
    /// Force or torque; slot of the gain per unit of the column.
    Force(usize),
    /// The column is a speed.
    Speed,
    /// The column is an angle or a position.
    Angle,
}

#[doc(hidden)]
/// Quantity that a sensor reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reads {
    Angle(usize),
    Speed(usize),
    Acceleration(usize),
    /// Time between the marks of this body.
    Pulses {
        body: usize,
        marks: usize,
    },
    /// Force of this spring.
    Tension(usize),
    /// External force or torque that drives this prescribed body.
    Reaction(usize),
    /// With link bodies: tension of the span that leaves this body, tension of this link, and force on this guide.
    Span(usize),
    Link(usize),
    Guide(usize),
    /// With link bodies: what has no place in a lumped drive, with its SI unit.
    Part(&'static str),
}

#[doc(hidden)]
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    pub name: String,
    pub path: String,
    pub reads: Reads,
    /// Slot of the gain: displayed value per SI unit.
    pub gain: usize,
    /// Its own unit, if it has one; otherwise SI.
    pub unit: Option<String>,
}

#[doc(hidden)]
/// An effect at its place.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedEffect {
    pub effect: &'static Effect,
    pub path: String,
    pub target: Target,
    /// Slots of its parameters, in their order.
    pub slots: Vec<usize>,
}

#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    Body(usize),
    Spring(usize),
    Input(usize),
    Sensor(usize),
    Chain,
    Guide(usize),
}

#[doc(hidden)]
/// Link count of the chain loop, which determines orders.
#[derive(Clone, Debug, PartialEq)]
pub struct ChainLoop {
    pub links: u32,
    /// Body whose teeth count the passing links.
    pub leader: usize,
}

#[doc(hidden)]
/// Data of a drive with link bodies besides its shafts, as far as measured records need them.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkedDrive {
    pub guides: Vec<String>,
    /// Period of the declared drive in pitches.
    pub repeats: u32,
    /// Paths of effects that the drive file declares.
    pub declared: Vec<String>,
    /// Per body: the sprocket whose teeth tell its mean speed; None: it does not turn on.
    pub turns_as: Vec<Option<usize>>,
}

/// Whether a drive file has `fidelity = "lumped"`, in any TOML notation. In a file with errors, the readable part is
/// used.
pub fn is_lumped(text: &str) -> bool {
    let (root, _mistakes) = toml::de::DeTable::parse_recoverable(text);
    root.get_ref().get("fidelity").and_then(|value| value.get_ref().as_str()) == Some("lumped")
}

impl Machine {
    /// Reads and checks a machine. `name` is what errors call the text; `overrides` are `path=value`.
    ///
    /// # Errors
    /// All mistakes at once, each with its place in the text or in an override.
    pub fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Machine, Report> {
        let reader = DriveReader::new(name, text, overrides);
        let root = reader.parse(text)?;
        let machine = read::machine(&reader.root(&root));
        drop(root);
        let places = reader.finish()?;
        let stem = std::path::Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or(name);
        Ok(Machine { name: stem.to_string(), text: text.to_string(), places, ..machine })
    }

    /// A machine without content.
    fn empty(title: String) -> Machine {
        Machine {
            name: String::new(),
            text: String::new(),
            title,
            slots: Vec::new(),
            values: Vec::new(),
            bodies: Vec::new(),
            springs: Vec::new(),
            inputs: Vec::new(),
            sensors: Vec::new(),
            placed: Vec::new(),
            chain: None,
            linked: None,
            places: Places::empty(),
        }
    }

    /// Index of the slot with this path.
    pub fn slot(&self, path: &str) -> Option<usize> {
        self.slots.iter().position(|s| s.path == path)
    }

    /// Value of a slot in the unit of its name.
    pub fn shown(&self, slot: usize, value: f64) -> f64 {
        value / self.slots[slot].unit
    }

    /// Name and tooth count of the bodies with teeth, in order.
    pub fn toothed(&self) -> Vec<(String, u32)> {
        self.bodies.iter().filter_map(|b| b.teeth.map(|z| (b.name.clone(), z))).collect()
    }

    /// Stiffness and damping of a spring.
    pub fn spring_numbers(&self, values: &[f64], spring: &Spring) -> (f64, f64) {
        let (a, b) = (values[spring.stiffness], values[spring.damping]);
        match spring.tuned {
            None => (a, b),
            Some(inertia) => (values[inertia] * a * a, 2.0 * b * values[inertia] * a),
        }
    }

    /// The body that a sensor reads, if any.
    pub fn body_of(&self, sensor: usize) -> Option<usize> {
        match self.sensors[sensor].reads {
            Reads::Angle(b) | Reads::Speed(b) | Reads::Acceleration(b) | Reads::Reaction(b) => Some(b),
            Reads::Pulses { body, .. } => Some(body),
            Reads::Tension(_) | Reads::Span(_) | Reads::Link(_) | Reads::Guide(_) | Reads::Part(..) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::is_lumped;

    #[test]
    fn a_lumped_drive_is_one_however_toml_writes_it() {
        for text in [
            "fidelity = \"lumped\"",
            "fidelity='lumped'",
            "title = 'x'\n'fidelity' = 'lumped' # so",
            "fidelity = 'lumped'\nx = =",
        ] {
            assert!(is_lumped(text), "{text}");
        }
        for text in [
            "",
            "# fidelity = \"lumped\"",
            "title = \"\"\"\nfidelity = \"lumped\"\n\"\"\"",
            "[run]\nfidelity = \"lumped\"",
            "fidelity = 1",
        ] {
            assert!(!is_lumped(text), "{text}");
        }
    }
}
