//! What differs between the two fidelities of a machine, lumped and with link bodies, as one interface. All else (sensors, effects,
//! inputs, fits) sees a [`Machine`] and asks these questions; nothing outside this folder asks which fidelity it is.

use super::correction::Observed;
use super::simulate::{InitialState, RunError, Task};
use super::{Machine, Target};
use crate::effects::{Effect, Parameter};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// What is run: one part of a record.
#[derive(Clone, Copy)]
pub struct RunRequest<'a> {
    /// One for every slot, SI.
    pub values: &'a [f64],
    /// Values with weights that add up to one, between which the run is interpolated where [`Fidelity::grid`] has a grid; elsewhere
    /// the values alone.
    pub corners: &'a [(f64, Vec<f64>)],
    /// Mean over all parts of a period that are alike, where the motion has a period.
    pub folded: bool,
    pub task: &'a Task,
    pub start: &'a InitialState,
    /// What was measured, where a run predicts; drives with links do not.
    pub observed: Option<Observed<'a>>,
    /// Indices of sensors.
    pub channels: &'a [usize],
    /// Steps per sample beyond which a model counts as too stiff.
    pub max_steps: f64,
    /// Counts runs.
    pub runs: &'a AtomicU64,
}

/// How much a search may ask of runs: they take milliseconds, or seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchEffort {
    /// Sets of effects kept after each round; the last number holds for later rounds.
    pub beam: [usize; 3],
    /// Hypotheses that are fitted in a round for each set.
    pub fitted: usize,
    /// Maximum number of effects.
    pub effects: usize,
    /// Fits of the declared model from other values than the file's. Without any, the file's values count as close to the true ones.
    pub restarts: usize,
    /// Whether fits that only make sure are run: from smaller sizes, and with records left out in turn.
    pub is_thorough: bool,
    /// A fit ends when the cost falls by less than this share, and after at most so many steps.
    pub converged_share: f64,
    pub iterations: usize,
    /// Whether noise alone is left when the model is right.
    pub noise_alone_is_left: bool,
    /// Whether a run takes more steps where [`Machine::refinement`] asks for them.
    pub has_steps: bool,
    /// A length that shows in records [m]: `Scale::Micrometre10`.
    pub small_length_m: f64,
}

/// Pitches of the driver's chain after which a motion repeats itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PitchPeriod {
    pub whole: u32,
    /// If all links and teeth of each part were alike: a share of the whole.
    pub alike: u32,
}

impl PitchPeriod {
    /// Number of places of a single link, joint or tooth that a record can start at, `alike` pitches apart.
    pub fn places(self) -> u32 {
        (self.whole / self.alike.max(1)).max(1)
    }
}

/// The part of a sensor's readings that differs from period to period, so that no model tells it (root mean square, SI).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UnrepeatedPart {
    pub size: f64,
    /// What of it is left in the mean over periods, which a run returns.
    pub in_mean: f64,
}

/// Whether an effect may be added at a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoomForEffect {
    Free,
    /// It is there already, through the search itself.
    Taken,
    /// Why not.
    Refused(&'static str),
}

/// What records tell of how exactly a model must be run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordsOfSensors {
    /// Noise of every sensor in SI units of its reading; 0: no record reads it, or it is not known. Empty: no records are known.
    pub noise: Vec<f64>,
    /// Duration of the records at the operating point that has most [s]; 0: unknown.
    pub at_one_point_s: f64,
}

/// The questions.
pub trait Fidelity: std::fmt::Debug + Send + Sync {
    /// All possible targets of an effect, with their names.
    fn targets(&self, m: &Machine, effect: &Effect) -> Vec<(String, Target)>;

    /// Whether an effect has this parameter at this target.
    fn accepts(&self, effect: &Effect, target: Target, p: &Parameter) -> bool;

    /// Whether parts of the drive that differ from their neighbours tell where it stands, so that waves on shafts have phases.
    fn has_reference(&self) -> bool;

    /// The body whose way along its line a sensor measures, as [`super::Reads`] does not say it.
    fn slider_of(&self, m: &Machine, sensor: usize) -> Option<usize>;

    /// Range of an effect's size that the part it acts on allows [SI]; None: that of its row.
    fn range(&self, effect: &Effect, target: Target) -> Option<(f64, f64)>;

    /// Whether an effect may be added to those that are there.
    fn room_for(&self, m: &Machine, effect: &Effect, target: Target, path: &str) -> RoomForEffect;

    /// Whether an effect is at a place on the loop that each record determines for itself, by where it starts.
    fn has_place(&self, effect: &Effect) -> bool;

    /// Whether an effect is looked at with its starting values, because a small one is lost in what does not repeat itself.
    fn shows_at_start_alone(&self, effect: &Effect) -> bool;

    /// Period of the motion: a record then starts somewhere in it. None: it starts in a state of its own.
    fn period_pitches(&self, m: &Machine) -> Option<PitchPeriod>;

    /// Numbers of links, joints or gaps at this target that no start of a record makes the same; None: those of the effect's row.
    fn indices(&self, m: &Machine, target: Target) -> Option<Vec<f64>>;

    /// Mean speed of a body where it is known without a run [rad/s].
    fn mean_speed(&self, m: &Machine, values: &[f64], body: usize) -> Option<f64>;

    /// Spacing of the values that are run, for a scaled parameter; None: every value is run.
    fn grid(&self, m: &Machine, slot: usize, logarithm: bool) -> Option<f64>;

    /// One series for every channel, at the samples; for pulses, ln of the intervals.
    fn run(&self, m: &Machine, request: &RunRequest) -> Result<Vec<Vec<f64>>, RunError>;

    /// For every sensor, what of its readings does not repeat itself; None: all repeats itself, or there is no run with these values.
    fn unrepeated(&self, m: &Machine, values: &[f64], runs: &AtomicU64) -> Option<Vec<UnrepeatedPart>>;

    /// Steps that a sample of this task, or the shortest interval between pulses, needs; None: the step does not depend on values.
    fn steps_needed(&self, m: &Machine, values: &[f64], task: &Task, start: &InitialState) -> Option<f64>;

    /// The same, for such records; None: they change nothing.
    fn for_records(&self, records: RecordsOfSensors) -> Option<Arc<dyn Fidelity>>;

    /// How much a search may ask of runs.
    fn effort(&self) -> &'static SearchEffort;
}
