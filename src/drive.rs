//! The drive file: what the user writes, read with positions, checked, in SI.
//!
//! TOML with named tables per kind. Every mistake of a file is found in one pass and points at its place; keys that no
//! reader asks for are unknown keys, and the nearest known one is offered. `path=value` overrides replace values before they
//! are read and are checked like them.

pub mod bearings;
pub mod chains;
mod check;
mod contacts;
pub(crate) mod document;
mod effects;
mod guides;
pub mod lifters;
pub mod mechanism;
mod read;
#[doc(hidden)]
pub mod reader;
pub mod sensors;
pub mod shafts;
pub mod torsion;
pub mod valves;

use crate::diag::Report;
use crate::effects::Effect;
use crate::elements::beam::Beam;
use crate::elements::contact_law::ContactLaw;
use crate::geometry::Vec2;
use crate::geometry::chain::abutment::AbutmentChain;
use crate::geometry::chain::bush::BushChain;
use crate::geometry::chain::silent::SilentChain;
use crate::geometry::guide::GuideSide;
use crate::geometry::rail::Stretch;
use crate::geometry::route::Wrap;
use crate::geometry::sprocket::GapForm;
use document::DocumentTable;
use mechanism::{OilSpec, SliderSpec};
use reader::{DriveReader, Places};
use std::f64::consts::PI;
use std::sync::Arc;
use valves::ValveSpec;

/// Bundled drives: name and text.
pub const BUNDLED: [(&str, &str); 15] = [
    ("bush-20-40", include_str!("../assets/drives/bush-20-40.toml")),
    ("silent-20-40", include_str!("../assets/drives/silent-20-40.toml")),
    ("smartchain-20-40", include_str!("../assets/drives/smartchain-20-40.toml")),
    ("arm-20-40", include_str!("../assets/drives/arm-20-40.toml")),
    ("reduction-20-40-20-40", include_str!("../assets/drives/reduction-20-40-20-40.toml")),
    ("tensioner-20-40", include_str!("../assets/drives/tensioner-20-40.toml")),
    ("gasoline-3cyl-bush", include_str!("../assets/drives/gasoline-3cyl-bush.toml")),
    ("gasoline-3cyl-silent", include_str!("../assets/drives/gasoline-3cyl-silent.toml")),
    ("bmw318", include_str!("../assets/drives/bmw318.toml")),
    ("ford-v6", include_str!("../assets/drives/ford-v6.toml")),
    ("v12-primary", include_str!("../assets/drives/v12-primary.toml")),
    ("v12", include_str!("../assets/drives/v12.toml")),
    ("roller-20-40", include_str!("../assets/drives/roller-20-40.toml")),
    ("v12-primary-fgm", include_str!("../assets/drives/v12-primary-fgm.toml")),
    ("bmw318-camshaft", include_str!("../assets/drives/bmw318-camshaft.toml")),
];

/// The bundled drives that differ in their chain alone.
pub const CHAIN_TYPES: [&str; 3] = ["bush-20-40", "silent-20-40", "smartchain-20-40"];

/// What is a chain's own where a drive has several.
#[derive(Clone, Debug, PartialEq)]
pub struct ChainPart {
    /// Type and dimensions of the links.
    pub chain: ChainSpec,
    /// Number of links.
    pub links: usize,
    /// How its links differ from each other.
    pub scatter: ScatterSpec,
    /// Its joints: pin and bush, or pin and pin.
    pub joint: JointSpec,
    /// Contact with the teeth of sprockets.
    pub tooth_contact: ContactSpec,
    /// Contact with guides and rails.
    pub guide_contact: ContactSpec,
    /// Contact of abutments with rings.
    pub ring_contact: ContactSpec,
    /// Rollers on their bushes; None: no rollers.
    pub roller_contact: Option<ContactSpec>,
    /// How this chain is tightened.
    pub preload: PreloadSpec,
    /// What it is made of.
    pub fidelity: ChainFidelity,
}

/// What a chain of a drive is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChainFidelity {
    /// Its links are bodies.
    Links,
    /// It has no bodies: its spans are springs between sprockets.
    Spans,
}

/// A shaft that sprockets sit on.
#[derive(Clone, Debug, PartialEq)]
pub struct ShaftSpec {
    /// Last part of its path in the file.
    pub name: String,
    /// What turns it.
    pub outer: OuterSpec,
}

/// A checked drive, in SI, with the text it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Name of the file without its extension, or of the bundled drive.
    pub name: String,
    /// The drive file, unchanged.
    pub text: String,
    /// `path=value` overrides, in the order in which they were given.
    pub overrides: Vec<String>,
    /// Title in the drive file.
    pub title: String,
    /// Where its numbers come from, in words; empty where the file does not say.
    pub source: String,
    /// The chain; of several, the first.
    pub chain: ChainSpec,
    /// Number of links; of several chains, of the first.
    pub links: usize,
    /// What the chain is made of; of several, the first.
    pub fidelity: ChainFidelity,
    /// How links differ from each other.
    pub scatter: ScatterSpec,
    /// Joints of the chain.
    pub joint: JointSpec,
    /// Bushes or flanks on teeth.
    pub tooth_contact: ContactSpec,
    /// Plates on guides and rails.
    pub guide_contact: ContactSpec,
    /// Abutments on rings.
    pub ring_contact: ContactSpec,
    /// Rollers on their bushes; None: no rollers.
    pub roller_contact: Option<ContactSpec>,
    /// Arms on their stops; None where no arm has any.
    pub stop_contact: Option<ContactSpec>,
    /// The chains behind the first.
    pub more: Vec<ChainPart>,
    /// Names of all chains where there are several.
    pub chain_names: Vec<String>,
    /// Spans of chains of spans whose numbers are given.
    pub spans: Vec<SpanSpec>,
    /// Shafts that carry several sprockets; a sprocket may have none.
    pub shafts: Vec<ShaftSpec>,
    /// Shafts that twist, each held by what turns it at one end.
    pub elastic_shafts: Vec<torsion::ElasticShaftSpec>,
    /// Bearings that let sprockets, shafts and rails give way.
    pub bearings: Vec<bearings::BearingSpec>,
    /// How the driver turns, loads and couplings.
    pub train: shafts::ShaftTrain,
    /// In the order in which the chain meets them, one chain after the other.
    pub sprockets: Vec<SprocketDrive>,
    /// Straight guides along spans.
    pub guides: Vec<GuideSpec>,
    /// Tensioner arms.
    pub arms: Vec<ArmSpec>,
    /// Plungers of hydraulic tensioners.
    pub sliders: Vec<SliderSpec>,
    /// Tips of sliders on arms; None without sliders.
    pub tip_contact: Option<ContactSpec>,
    /// Oil behind the sliders; None: no slider is hydraulic.
    pub oil: Option<OilSpec>,
    /// Valves that cams on the shafts lift.
    pub valves: Vec<ValveSpec>,
    /// Cams on followers, and valves on their seats; None without valves.
    pub valve_contacts: Option<[ContactSpec; 2]>,
    /// Curved guides, fixed or on arms.
    pub rails: Vec<RailSpec>,
    /// How the loop of the first chain is tightened.
    pub preload: PreloadSpec,
    /// Departures from the ideal drive.
    pub effects: Effects,
    /// Sensors of the drive, in the order of the file.
    pub sensors: Vec<sensors::SensorSpec>,
    /// Effects on their signals, in the order in which a signal passes them.
    pub signals: Vec<sensors::SignalSpec>,
    /// Step and durations before the recording.
    pub run: RunSpec,
    /// Where every value stands in the file, for errors.
    pub places: Places,
    /// The file as it was parsed.
    pub(crate) document: Arc<DocumentTable>,
}

/// The chain, of one type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChainSpec {
    /// Bush chain: bushes seat in the gaps of ISO 606 sprockets.
    Bush(BushChain),
    /// Silent chain: flanks of inverted teeth bear on the sprocket's faces.
    Silent(SilentChain),
    /// Abutment chain (SmartChain kind): abutments carry the links onto rings beside the teeth.
    Abutment(AbutmentChain),
}

impl ChainSpec {
    /// Its table in the drive file.
    pub fn path(&self) -> &'static str {
        match self {
            ChainSpec::Bush(_) => "chain.bush",
            ChainSpec::Silent(_) => "chain.silent",
            ChainSpec::Abutment(_) => "chain.smartchain",
        }
    }

    /// Nominal pitch [m].
    pub fn pitch_m(&self) -> f64 {
        match self {
            ChainSpec::Bush(c) => c.pitch_m,
            ChainSpec::Silent(c) => c.pitch_m,
            ChainSpec::Abutment(c) => c.pitch_m,
        }
    }

    /// Diameter of the pins [m].
    pub fn pin_diameter_m(&self) -> f64 {
        match self {
            ChainSpec::Bush(c) => c.pin_diameter_m,
            ChainSpec::Silent(c) => c.pin_diameter_m,
            ChainSpec::Abutment(c) => c.pin_diameter_m,
        }
    }

    /// Diameter of what the teeth seat; zero for a silent chain [m].
    pub fn bush_diameter_m(&self) -> f64 {
        match self {
            ChainSpec::Bush(c) => c.seated_diameter_m(),
            ChainSpec::Silent(_) => 0.0,
            ChainSpec::Abutment(c) => c.bush_diameter_m,
        }
    }

    /// Height of the plate edge that slides on plain guides over the joints [m].
    pub fn plate_end_radius_m(&self) -> f64 {
        match self {
            ChainSpec::Bush(c) => 0.5 * c.plate_height_m,
            ChainSpec::Silent(c) => c.form.face_distance_m,
            ChainSpec::Abutment(c) => 0.5 * c.plate_height_m,
        }
    }
}

/// Joints of the chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSpec {
    /// Radial stiffness of pin in bush [N/m].
    pub stiffness_n_per_m: f64,
    /// Radial damping [N s/m].
    pub damping_n_s_per_m: f64,
    /// Radial play of the pin in its bush; tension is zero within it [m].
    pub clearance_m: f64,
    /// Coulomb coefficient of pin in bush.
    pub friction: f64,
    /// Relative speed of two links below which friction is proportional to it [rad/s].
    pub stick_speed_rad_s: f64,
}

/// How links differ from each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterSpec {
    /// Standard deviation of the pitch [m].
    pub pitch_m: f64,
    /// Seed of the random numbers; the same seed gives the same links.
    pub seed: u64,
}

/// A contact pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactSpec {
    /// Normal force over penetration and its rate.
    pub law: ContactLaw,
    /// Coulomb coefficient.
    pub friction: f64,
    /// Sliding speed below which friction is proportional to it [m/s].
    pub stick_speed_m_s: f64,
}

/// A sprocket with what turns it.
#[derive(Clone, Debug, PartialEq)]
pub struct SprocketDrive {
    /// Last part of its path in the file.
    pub name: String,
    /// Index of the chain that runs on it.
    pub chain: usize,
    /// Index of the shaft it sits on; None: its own.
    pub shaft: Option<usize>,
    /// Number of teeth.
    pub teeth: u32,
    /// Smallest or largest tooth gap of ISO 606; of bush and abutment chains.
    pub form: GapForm,
    /// Tip diameter; None: standard [m].
    pub tip_diameter_m: Option<f64>,
    /// Gaps cut deeper by this [m].
    pub root_relief_m: f64,
    /// Of an abutment chain.
    pub ring: RingForm,
    /// Of a silent chain; what is not given is standard.
    pub face: FaceForm,
    /// Clearance between toe and root of a silent chain; None: standard [m].
    pub root_clearance_m: Option<f64>,
    /// Rounding of the tip corners of a silent sprocket; None: standard [m].
    pub corner_radius_m: Option<f64>,
    /// x of its axis as drawn; preload may move it [m].
    pub x_m: f64,
    /// y of its axis as drawn [m].
    pub y_m: f64,
    /// Sense in which the chain goes round it.
    pub wrap: Wrap,
    /// What turns it or loads it.
    pub outer: OuterSpec,
    /// What other chains on its shaft take from it under their constant loads, where it is looked at without them [N m].
    pub passes_on_nm: f64,
}

/// Ring of an abutment chain's sprocket.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RingForm {
    /// Conjugate to the abutments: a circle where they are made for its teeth, lobes elsewhere.
    Conjugate,
    /// A circle in any case.
    Plain,
}

/// Largest deviation of a row's pitch from the sprockets', over it: a chain is worn out at 0.03.
const LARGEST_PITCH_ERROR: f64 = 0.05;

/// Working face of a silent chain's teeth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaceForm {
    /// Osculates the involute.
    Arc,
    /// Arc of this radius that touches the seated flank at a distance from the foot of the joint's perpendicular [m].
    Crowned {
        /// Radius of the arc [m].
        radius_m: f64,
        /// Distance of the contact from the foot of the joint's perpendicular [m].
        contact_distance_m: f64,
    },
}

/// What is prescribed at a sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OuterSpec {
    /// Speed in the sense in which the chain moves forwards [rad/s].
    Speed {
        /// Constant speed, negative backwards [rad/s].
        speed_rad_s: f64,
    },
    /// Load torque against the motion [N m].
    Load {
        /// Inertia of everything that turns with it [kg m2].
        inertia_kg_m2: f64,
        /// Torque of the load [N m].
        torque_nm: f64,
    },
}

/// A fixed guide along the span from one sprocket to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct GuideSpec {
    /// Last part of its path in the file.
    pub name: String,
    /// Index of the sprocket that the span leaves.
    pub span: usize,
    /// On which side of the chain it stands.
    pub side: GuideSide,
    /// Distance of its start from the start of the span [m].
    pub start_m: f64,
    /// Distance of the end of the guide from the end of the span.
    pub end_m: f64,
    /// Between plate edge and face when the joints lie on the common tangent of the pitch circles.
    pub clearance_m: f64,
    /// How much nearer to the chain it stands where the chain leaves it than where it arrives [m].
    pub end_lift_m: f64,
    /// Radius of its lead-in and lead-out [m].
    pub end_radius_m: f64,
}

/// A body that turns about a pivot, held by a torsion spring.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmSpec {
    /// Last part of its path in the file.
    pub name: String,
    /// Point about which it turns [m].
    pub pivot: Vec2,
    /// About the pivot.
    pub inertia_kg_m2: f64,
    /// Torsional stiffness of its spring [N m/rad].
    pub spring_nm_per_rad: f64,
    /// Torque of the spring on the arm in the position in which it is drawn, counterclockwise positive [N m].
    pub spring_torque_nm: f64,
    /// Torsional damping [N m s/rad].
    pub damping_nm_s_per_rad: f64,
    /// Ends of its way from where it is drawn [rad], and how far from the pivot its stops are [m].
    pub low_rad: Option<f64>,
    /// Largest angle from where it is drawn; None: no stop [rad].
    pub high_rad: Option<f64>,
    /// Distance of the stops from the pivot [m].
    pub stop_radius_m: f64,
}

/// A guide of arcs and lines, along the way from one sprocket to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct RailSpec {
    /// Last part of its path in the file.
    pub name: String,
    /// Index of the sprocket that the way leaves.
    pub span: usize,
    /// Index of the arm that carries it; None: fixed.
    pub arm: Option<usize>,
    /// On which side of the chain it stands.
    pub side: GuideSide,
    /// Where the chain arrives, and its heading there.
    pub start: Vec2,
    /// Heading of the rail at `start`, counterclockwise from +x [rad].
    pub heading_rad: f64,
    /// Arcs and lines from there.
    pub stretches: Vec<Stretch>,
    /// How it bends; None: it is rigid.
    pub bending: Option<Beam>,
}

/// How the loop is tightened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PreloadSpec {
    /// The axis of a sprocket is moved.
    Sprocket {
        /// Mean tension of the loop at rest, without load [N].
        tension_n: f64,
        /// Index of the sprocket.
        moves: usize,
        /// Direction of the move from +x; None: away from the sprocket before it.
        direction_rad: Option<f64>,
    },
    /// All axes stay; the spring of the arm with this index tightens it.
    Arm(usize),
    /// All axes stay; a rail of the chain that bends tightens it.
    Blade,
}

/// Numbers of a span of a chain of spans that its user knows: they take the place of those that follow from the links.
#[derive(Clone, Debug, PartialEq)]
pub struct SpanSpec {
    /// Index of the chain.
    pub chain: usize,
    /// `FROM-TO`, the sprockets that the span leaves and reaches.
    pub name: String,
    /// Stiffness [N/m].
    pub stiffness_n_per_m: Option<f64>,
    /// Damping [N s/m].
    pub damping_n_s_per_m: Option<f64>,
}

impl SpanSpec {
    /// Stiffnesses that a span may be given [N/m].
    pub const STIFFNESS_N_PER_M: std::ops::RangeInclusive<f64> = 1.0..=1e12;
    /// Dampings that a span may be given [N s/m].
    pub const DAMPING_N_S_PER_M: std::ops::RangeInclusive<f64> = 0.0..=1e9;
}

impl PreloadSpec {
    /// Tension that is asked for [N]; zero where a spring makes it.
    pub fn tension_n(&self) -> f64 {
        match *self {
            PreloadSpec::Sprocket { tension_n, .. } => tension_n,
            PreloadSpec::Arm(_) | PreloadSpec::Blade => 0.0,
        }
    }
}

/// What departs from the ideal drive.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effects {
    /// Tooth gaps cut too deep or too shallow.
    pub gap_errors: Vec<GapError>,
    /// Waves round sprockets: runout, or uneven tooth pitch.
    pub gap_waves: Vec<GapWave>,
    /// Single links that are longer or shorter.
    pub pitch_errors: Vec<PitchError>,
    /// Single links that are heavier or lighter.
    pub link_masses: Vec<LinkMass>,
    /// Of every link [m].
    pub elongation_m: f64,
    /// By which inner links are longer than outer ones [m].
    pub alternate_m: f64,
    /// Joints that turn hard.
    pub tight_joints: Vec<TightJoint>,
    /// Of every pin in its bush, beyond the declared friction.
    pub pin_friction: f64,
    /// Stiffness of every joint beyond the declared one, as a share of it.
    pub joint_stiffness_share: f64,
    /// Damping of every joint beyond the declared one [N s/m].
    pub joint_damping_n_s_per_m: f64,
    /// Radial play of every pin in its bush beyond the declared one [m].
    pub joint_clearance_m: f64,
    /// By how much numbers of blades, plain bearings, valves and couplings differ, in the order of the file.
    pub parts: Vec<PartEffect>,
    /// Friction and compliance of guides.
    pub guides: Vec<GuideEffect>,
    /// Arms that give way, in the order of the file.
    pub arms: Vec<ArmEffect>,
    /// What effects change about the oil, and about what it flows through.
    pub oil: OilEffects,
    /// Stiffness and damping of spans, in chains of spans.
    pub spans: Vec<SpanEffect>,
}

/// By how much a number of a part differs from the declared one.
#[derive(Clone, Debug, PartialEq)]
pub struct PartEffect {
    /// The row of the catalogue, which says what number.
    pub effect: &'static Effect,
    /// Name of the part.
    pub part: String,
    /// A share of the declared number, or a length [m]; the row says.
    pub size: f64,
}

/// What a span of a chain of spans has beyond its declared stiffness and damping.
#[derive(Clone, Debug, PartialEq)]
pub struct SpanEffect {
    /// `FROM-TO`.
    pub span: String,
    /// More stiffness [N/m].
    pub stiffness_n_per_m: f64,
    /// More damping [N s/m].
    pub damping_n_s_per_m: f64,
}

/// What a guide has beyond its declared contact.
#[derive(Clone, Debug, PartialEq)]
pub struct GuideEffect {
    /// Name of the guide.
    pub guide: String,
    /// Coulomb coefficient beyond the declared one.
    pub friction: f64,
    /// What it stands on; None: it stands still.
    pub mount: Option<GuideMount>,
}

/// What an arm gives way by.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmEffect {
    /// Path in the file.
    pub path: String,
    /// Name of the arm.
    pub arm: String,
    /// Turn of its rails against its back under a torque [rad/(N m)]; positive.
    pub compliance_rad_per_nm: f64,
    /// Share of its inertia that the back has.
    pub back_share: f64,
    /// Damping of rails and back against each other over its critical damping.
    pub damping_ratio: f64,
}

/// What the oil of a drive, and what it flows through, have beyond what is declared.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OilEffects {
    /// Free air, as a share of the volume at ambient pressure.
    pub air_share: f64,
    /// Viscosity, as a share of the declared one.
    pub viscosity_share: f64,
    /// What effects change about single passages, in the order of the file.
    pub passages: Vec<PassageEffect>,
}

/// What a passage has beyond what is declared.
#[derive(Clone, Debug, PartialEq)]
pub struct PassageEffect {
    /// Path of the effect in the file.
    pub path: String,
    /// Name of the passage.
    pub passage: String,
    /// By which a gap or a hole is wider [m]; area of the hole beside a ball [m2].
    pub size: f64,
}

/// Spring and damper that a straight guide or a fixed rail stands on, behind its contacts; it moves along its normal.
#[derive(Clone, Debug, PartialEq)]
pub struct GuideMount {
    /// Path in the file.
    pub path: String,
    /// Way of the spring under a newton [m/N].
    pub compliance_m_per_n: f64,
    /// Moves with the face [kg].
    pub mass_kg: f64,
    /// Damping of the mass on the spring over its critical damping.
    pub damping_ratio: f64,
}

impl GuideMount {
    /// [N/m]
    pub fn stiffness_n_per_m(&self) -> f64 {
        1.0 / self.compliance_m_per_n
    }

    /// [N s/m]
    pub fn damping_n_s_per_m(&self) -> f64 {
        2.0 * self.damping_ratio * (self.mass_kg / self.compliance_m_per_n).sqrt()
    }
}

impl Effects {
    /// What this effect adds to its number of a part; zero where the file says nothing of it.
    pub fn of_part(&self, effect: &Effect, part: &str) -> f64 {
        self.parts.iter().filter(|e| e.effect == effect && e.part == part).map(|e| e.size).sum()
    }

    /// Guides that stand on mounts, in the order of the file.
    pub fn mounts(&self) -> impl Iterator<Item = (&str, &GuideMount)> + Clone {
        self.guides.iter().filter_map(|e| Some((e.guide.as_str(), e.mount.as_ref()?)))
    }
}

/// A tooth gap that stands further out than the others of its sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GapError {
    /// Index of the sprocket.
    pub sprocket: usize,
    /// Number of the gap, counted counterclockwise from the sprocket's mark.
    pub gap: u32,
    /// Negative: cut too deep [m].
    pub outward_m: f64,
}

/// Gaps that lie beside their places by a wave round the sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GapWave {
    /// Index of the sprocket.
    pub sprocket: usize,
    /// Amplitude of the wave [m].
    pub amplitude_m: f64,
    /// Phase of the wave [rad].
    pub phase_rad: f64,
    /// None: the whole toothing is displaced; else gaps are early and late so many times a turn.
    pub order: Option<u32>,
}

/// A joint that turns hard.
#[derive(Clone, Debug, PartialEq)]
pub struct TightJoint {
    /// Last part of its path in the file.
    pub name: String,
    /// Index of the joint.
    pub joint: usize,
    /// Torque of its friction [N m].
    pub torque_nm: f64,
}

/// A link that is heavier or lighter than those of its row.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkMass {
    /// Last part of its path in the file.
    pub name: String,
    /// Index of the link.
    pub link: usize,
    /// By which share of its row's mass it is heavier; negative: lighter.
    pub mass_share: f64,
    /// The same for its moment of inertia.
    pub inertia_share: f64,
}

/// A link that is longer or shorter than the others.
#[derive(Clone, Debug, PartialEq)]
pub struct PitchError {
    /// Last part of its path in the file.
    pub name: String,
    /// Index of the link.
    pub link: usize,
    /// Difference from the nominal pitch; negative: shorter [m].
    pub length_m: f64,
}

/// How steps follow one another, see [`crate::integrate::scheme`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Scheme {
    /// Explicit scheme whose contact forces are means over a step.
    #[default]
    Leapfrog,
    /// Implicit scheme of Hilber, Hughes and Taylor.
    Hht {
        /// In -1/3 .. 0: damping of what a step does not resolve.
        alpha: f64,
    },
    /// Scheme of Moreau and Jean: it takes bushes, teeth and parts that touch each other as rigid.
    Moreau {
        /// Opening speed after an impact over the closing speed before it, 0 .. 1.
        restitution: f64,
    },
    /// Explicit scheme of predictor and corrector, which chooses steps of its own.
    PredictorCorrector {
        /// Largest error of a speed in one of them [m/s].
        tolerance_m_s: f64,
    },
}

/// How it is run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunSpec {
    /// How steps follow one another.
    pub scheme: Scheme,
    /// Step [s]; None takes the bound's.
    pub step_s: Option<f64>,
    /// With extra damping, before the recording [s].
    pub run_in_s: f64,
    /// Without it, before the recording [s].
    pub settle_s: f64,
}

impl Drive {
    /// Reads and checks a drive. `name` is what errors call the text; `overrides` are `path=value`, as for `--set`.
    ///
    /// # Errors
    /// All mistakes at once, each with its place in the text or in an override.
    pub fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Drive, Report> {
        let reader = DriveReader::new(name, text, overrides);
        let document = Arc::new(reader.parse(text)?);
        let drive = Drive::read(reader, &document)?;
        let stem = std::path::Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or(name);
        Ok(Drive { name: stem.to_string(), text: text.to_string(), overrides: overrides.to_vec(), document, ..drive })
    }

    /// This drive with other numbers, by their paths, in the units of their keys; a table of effects may be new. Ranges and checks are
    /// those of the file's reader; no text is written or parsed.
    ///
    /// # Errors
    /// A number is outside its range, the numbers do not fit each other, or the drive has no such number.
    pub fn with_numbers(&self, numbers: &[(String, f64)]) -> Result<Drive, Report> {
        let reader = DriveReader::new(&self.name, &self.text, &self.overrides).with_numbers(numbers);
        let drive = Drive::read(reader, &self.document)?;
        let (name, text, overrides) = (self.name.clone(), self.text.clone(), self.overrides.clone());
        Ok(Drive { name, text, overrides, document: self.document.clone(), ..drive })
    }

    /// Reads and checks; name, text and document are the caller's.
    fn read(reader: DriveReader, document: &DocumentTable) -> Result<Drive, Report> {
        let drive = read::drive(&reader.root(document));
        let drive = Drive { places: reader.finish()?, ..drive };
        drive.check_chains()?;
        drive.check_train()?;
        for chain in 0..drive.chains() {
            drive.single_chain(chain).check()?;
        }
        Ok(drive)
    }

    /// A bundled drive: one of the names in [`BUNDLED`]. None: there is no such drive.
    pub fn bundled(name: &str) -> Option<Drive> {
        let (name, text) = BUNDLED.iter().find(|(bundled, _)| *bundled == name)?;
        Drive::parse(name, text, &[]).ok()
    }

    /// Oil, and what it is in and flows through, with what effects change.
    pub fn oil_with_effects(&self) -> Option<OilSpec> {
        self.oil.as_ref().map(|oil| oil.with_effects(&self.effects.oil))
    }

    /// Index of the sprocket whose speed is prescribed.
    pub fn driver(&self) -> usize {
        self.sprockets.iter().position(|s| matches!(s.outer, OuterSpec::Speed { .. })).unwrap_or(0)
    }

    /// Nominal chain speed z p n, forwards positive [m/s].
    pub fn chain_speed_m_s(&self) -> f64 {
        let driver = &self.sprockets[self.driver()];
        match driver.outer {
            OuterSpec::Speed { speed_rad_s } => {
                speed_rad_s * f64::from(driver.teeth) * self.chain.pitch_m() / (2.0 * PI)
            }
            OuterSpec::Load { .. } => 0.0,
        }
    }
}
