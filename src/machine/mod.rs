//! Lumped model of a drive: rotors and sliders, spans and couplings as springs, loads that depend on speed, inputs and
//! sensors. It has the same effects as a drive with link bodies.
//!
//! ```text
//! J_i q_i'' = sum of inputs, loads and effects - sum over springs (dl/dq_i) F
//! l = g_a q_a - g_b q_b + effects' lengths      F = k l + c l' + effects' forces
//! ```
//! g is the radius at a span's end, or 1 for a coupling. Every parameter is a slot of one list, found by its path in
//! the file, so that a fit changes a machine by writing into a list.

#[doc(hidden)]
pub mod correction;
#[doc(hidden)]
pub mod fidelity;
mod forces;
mod linked;
mod links;
mod lumped;
mod near_rest;
mod period;
mod place;
mod pulses;
mod read;
mod response;
mod rosenbrock;
#[doc(hidden)]
pub mod simulate;

use crate::assemble::{AssemblyError, at_rest};
use crate::diag::{Report, last_name};
use crate::drive::Drive;
use crate::drive::reader::{DriveReader, Places};
use crate::effects::{Effect, Parameter};
use fidelity::{Fidelity, PitchPeriod, RecordsOfSensors, RoomForEffect, RunRequest, SearchEffort, UnrepeatedPart};
use response::WithoutPeriod;
use simulate::{InitialState, RunError, Task};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

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
    /// The chains that have links, where bodies have teeth; without any, no effect of a chain is searched.
    pub chains: Vec<ChainLoop>,
    /// Spans of chains of spans in a drive with links.
    pub spans: Vec<SpanNumbers>,
    /// How many times as many steps a run takes as it needs: a power of two; of lumped drives alone.
    pub refinement: usize,
    /// What differs between a lumped machine and one with link bodies.
    fidelity: Arc<dyn Fidelity>,
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
    /// Slot of its inertia or mass; None: no number of the file says it.
    pub inertia: Option<usize>,
    /// Slot of the inertia that an added second body has taken from it.
    pub minus: Option<usize>,
    pub teeth: Option<u32>,
    pub motion: BodyMotion,
}

impl Body {
    /// Slot of the number that all bodies on one shaft share.
    fn number_of_shaft(&self) -> Option<usize> {
        match self.motion {
            BodyMotion::Constant(slot) => Some(slot),
            BodyMotion::Free | BodyMotion::Measured(_) => self.inertia,
        }
    }

    /// Whether both sit on one shaft.
    pub(crate) fn turns_with(&self, other: &Body) -> bool {
        self.number_of_shaft() == other.number_of_shaft()
    }

    /// Name of the shaft that it sits on, if that has another one.
    pub(crate) fn shaft_name<'m>(&self, m: &'m Machine) -> Option<&'m str> {
        let (table, _) = m.slots.get(self.number_of_shaft()?)?.path.rsplit_once('.')?;
        Some(last_name(table)).filter(|name| *name != self.name)
    }
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
    /// Acceleration that goes with the speed of another input, for the force that this motion needs ([`Reads::Reaction`]).
    Acceleration,
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
    /// A part that is no body here, a span or a link of a chain, a guide, a slider, a chamber, a passage, with the SI unit of what is read.
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
    /// A chain, or, of joints, all chains.
    Chain(usize),
    /// A part of a drive with links that effects act on by its name alone: a guide, a passage of oil, the oil.
    Part(usize),
    /// A span of a chain of spans in a drive with links.
    Span(usize),
}

#[doc(hidden)]
/// Link count of a chain loop, which determines orders.
#[derive(Clone, Debug, PartialEq)]
pub struct ChainLoop {
    /// Empty where it is the only one.
    pub name: String,
    pub links: u32,
    /// Number of its first link, counted through all chains.
    pub first_link: u32,
    /// Body whose teeth count the passing links.
    pub leader: usize,
    /// Bodies whose teeth it passes.
    pub sprockets: Vec<usize>,
}

#[doc(hidden)]
/// Stiffness and damping of a span of a chain of spans.
#[derive(Clone, Debug, PartialEq)]
pub struct SpanNumbers {
    /// `FROM-TO`.
    pub name: String,
    /// Slots of stiffness and damping.
    pub stiffness: usize,
    pub damping: usize,
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

    /// The machine of a drive file of either fidelity. `name` is what errors call the text.
    ///
    /// # Errors
    /// All mistakes at once, each with its place in the text.
    pub fn of_file(name: &str, text: &str) -> Result<Machine, Report> {
        if is_lumped(text) {
            return Machine::parse(name, text, &[]);
        }
        let drive = Drive::parse(name, text, &[])?;
        if let Some(WithoutPeriod { path, title, help }) = response::without_period(&drive) {
            return Err(drive.places.report(vec![drive.places.error(&path, title, Some(help))]));
        }
        let machine = Machine::of_links(&drive);
        // What spans have follows from the drive at rest, without which they have no numbers.
        if machine.spans.is_empty()
            && !drive.span_paths().is_empty()
            && let Err(AssemblyError::Input(report)) = at_rest(&drive)
        {
            return Err(report);
        }
        Ok(machine)
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
            chains: Vec::new(),
            spans: Vec::new(),
            refinement: 1,
            fidelity: Arc::new(lumped::Lumped),
            places: Places::empty(),
        }
    }

    /// The body whose way along its line a sensor of a drive with links measures.
    pub fn slider_of(&self, sensor: usize) -> Option<usize> {
        self.fidelity.slider_of(self, sensor)
    }

    /// The same for such records.
    pub fn for_records(&self, records: RecordsOfSensors) -> Machine {
        let fidelity = self.fidelity.for_records(records).unwrap_or_else(|| self.fidelity.clone());
        Machine { fidelity, ..self.clone() }
    }

    /// Index of the slot with this path.
    pub fn slot(&self, path: &str) -> Option<usize> {
        self.slots.iter().position(|s| s.path == path)
    }

    /// Value of a slot in the unit of its name.
    pub fn shown(&self, slot: usize, value: f64) -> f64 {
        value / self.slots[slot].unit
    }

    /// Name and tooth count of the bodies whose teeth a chain passes, in order.
    pub fn toothed(&self, chain: &ChainLoop) -> Vec<(String, u32)> {
        let own = chain.sprockets.iter().map(|b| &self.bodies[*b]);
        own.filter_map(|b| b.teeth.map(|z| (b.name.clone(), z))).collect()
    }

    /// The chain whose links pass the teeth of a body.
    pub fn chain_at(&self, body: usize) -> Option<&ChainLoop> {
        self.chains.iter().find(|c| c.sprockets.contains(&body))
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
            Reads::Tension(_) | Reads::Part(_) => None,
        }
    }
}

/// The questions of [`Fidelity`], asked of a machine.
impl Machine {
    /// All possible targets of an effect, with their names.
    pub fn targets(&self, effect: &Effect) -> Vec<(String, Target)> {
        self.fidelity.targets(self, effect)
    }

    fn accepts(&self, effect: &Effect, target: Target, p: &Parameter) -> bool {
        self.fidelity.accepts(effect, target, p)
    }

    pub(crate) fn room_for(&self, effect: &Effect, target: Target, path: &str) -> RoomForEffect {
        self.fidelity.room_for(self, effect, target, path)
    }

    pub(crate) fn has_reference(&self) -> bool {
        self.fidelity.has_reference()
    }

    pub(crate) fn has_place(&self, effect: &Effect) -> bool {
        self.fidelity.has_place(effect)
    }

    pub(crate) fn shows_at_start_alone(&self, effect: &Effect) -> bool {
        self.fidelity.shows_at_start_alone(effect)
    }

    pub(crate) fn period_pitches(&self) -> Option<PitchPeriod> {
        self.fidelity.period_pitches(self)
    }

    pub(crate) fn indices(&self, target: Target) -> Option<Vec<f64>> {
        self.fidelity.indices(self, target)
    }

    /// Mean speed of every body, where it is known without a run [rad/s].
    pub(crate) fn mean_speeds(&self, values: &[f64]) -> Option<Vec<f64>> {
        (0..self.bodies.len()).map(|b| self.fidelity.mean_speed(self, values, b)).collect()
    }

    pub(crate) fn grid(&self, slot: usize, logarithm: bool) -> Option<f64> {
        self.fidelity.grid(self, slot, logarithm)
    }

    pub(crate) fn run(&self, request: &RunRequest) -> Result<Vec<Vec<f64>>, RunError> {
        self.fidelity.run(self, request)
    }

    pub(crate) fn unrepeated(&self, values: &[f64], runs: &AtomicU64) -> Option<Vec<UnrepeatedPart>> {
        self.fidelity.unrepeated(self, values, runs)
    }

    pub(crate) fn steps_needed(&self, values: &[f64], task: &Task, start: &InitialState) -> Option<f64> {
        self.fidelity.steps_needed(self, values, task, start)
    }

    pub(crate) fn effort(&self) -> &'static SearchEffort {
        self.fidelity.effort()
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
