//! The drive file: what the user writes, read with positions, checked, in SI.
//!
//! TOML with named tables per kind. Every mistake of a file is found in one pass and points at its place; keys that no
//! reader asks for are unknown keys, and the nearest known one is offered. `path=value` overrides replace values before they
//! are read and are checked like them.

mod read;
pub mod reader;
pub mod sensors;

use crate::diag::{Diag, Report};
use crate::elements::contact_law::ContactLaw;
use crate::geometry::Vec2;
use crate::geometry::chain::abutment::AbutmentChain;
use crate::geometry::chain::bush::BushChain;
use crate::geometry::chain::silent::SilentChain;
use crate::geometry::guide::GuideSide;
use crate::geometry::rail::{Rail, Stretch};
use crate::geometry::route::Wrap;
use crate::geometry::sprocket::GapForm;
use reader::{Places, Reader};
use std::f64::consts::PI;

/// Bundled drives: name and text.
pub const BUNDLED: [(&str, &str); 5] = [
    ("bush-20-40", include_str!("../assets/drives/bush-20-40.toml")),
    ("silent-20-40", include_str!("../assets/drives/silent-20-40.toml")),
    ("smartchain-20-40", include_str!("../assets/drives/smartchain-20-40.toml")),
    ("arm-20-40", include_str!("../assets/drives/arm-20-40.toml")),
    ("reduction-20-40-20-40", include_str!("../assets/drives/reduction-20-40-20-40.toml")),
];

/// The bundled drives that differ in their chain alone.
pub const CHAIN_TYPES: [&str; 3] = ["bush-20-40", "silent-20-40", "smartchain-20-40"];

/// What is a chain's own where a drive has several.
#[derive(Clone, Debug)]
pub struct ChainPart {
    pub chain: ChainSpec,
    pub links: usize,
    pub scatter: ScatterSpec,
    pub joint: JointSpec,
    pub tooth_contact: ContactSpec,
    pub guide_contact: ContactSpec,
    pub preload: PreloadSpec,
}

/// A shaft that sprockets sit on.
#[derive(Clone, Debug, PartialEq)]
pub struct ShaftSpec {
    pub name: String,
    pub outer: OuterSpec,
}

/// A checked drive, in SI, with the text it came from.
#[derive(Clone, Debug)]
pub struct Drive {
    pub name: String,
    pub text: String,
    pub overrides: Vec<String>,
    pub title: String,
    /// The chain; of several, the first.
    pub chain: ChainSpec,
    pub links: usize,
    pub scatter: ScatterSpec,
    pub joint: JointSpec,
    pub tooth_contact: ContactSpec,
    pub guide_contact: ContactSpec,
    /// Abutments on rings.
    pub ring_contact: ContactSpec,
    /// The chains behind the first.
    pub more: Vec<ChainPart>,
    /// Names of all chains where there are several.
    pub chain_names: Vec<String>,
    pub shafts: Vec<ShaftSpec>,
    /// In the order in which the chain meets them, one chain after the other.
    pub sprockets: Vec<SprocketDrive>,
    pub guides: Vec<GuideSpec>,
    pub arms: Vec<ArmSpec>,
    pub rails: Vec<RailSpec>,
    pub preload: PreloadSpec,
    pub effects: Effects,
    pub sensors: Vec<sensors::SensorSpec>,
    /// Effects on their signals, in the order in which a signal passes them.
    pub signals: Vec<sensors::SignalSpec>,
    pub run: RunSpec,
    pub places: Places,
}

/// The chain, of one type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChainSpec {
    Bush(BushChain),
    Silent(SilentChain),
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
            ChainSpec::Bush(c) => c.bush_diameter_m,
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
    pub stiffness_n_per_m: f64,
    pub damping_n_s_per_m: f64,
    pub clearance_m: f64,
    pub friction: f64,
    pub stick_speed_rad_s: f64,
}

/// How links differ from each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterSpec {
    /// Standard deviation of the pitch [m].
    pub pitch_m: f64,
    pub seed: u64,
}

/// A contact pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactSpec {
    pub law: ContactLaw,
    pub friction: f64,
    pub stick_speed_m_s: f64,
}

/// A sprocket with what turns it.
#[derive(Clone, Debug, PartialEq)]
pub struct SprocketDrive {
    pub name: String,
    /// Index of the chain that runs on it.
    pub chain: usize,
    /// Index of the shaft it sits on; None: its own.
    pub shaft: Option<usize>,
    pub teeth: u32,
    pub form: GapForm,
    pub tip_diameter_m: Option<f64>,
    /// Gaps cut deeper by this [m].
    pub root_relief_m: f64,
    /// Of an abutment chain.
    pub ring: RingForm,
    /// Of a silent chain; what is not given is standard.
    pub face: FaceForm,
    pub root_clearance_m: Option<f64>,
    pub corner_radius_m: Option<f64>,
    pub x_m: f64,
    pub y_m: f64,
    pub wrap: Wrap,
    pub outer: OuterSpec,
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
    Crowned { radius_m: f64, contact_distance_m: f64 },
}

/// What is prescribed at a sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OuterSpec {
    /// Speed in the sense in which the chain moves forwards [rad/s].
    Speed { speed_rad_s: f64 },
    /// Load torque against the motion [N m].
    Load { inertia_kg_m2: f64, torque_nm: f64 },
}

/// A fixed guide along the span from one sprocket to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct GuideSpec {
    pub name: String,
    /// Index of the sprocket that the span leaves.
    pub span: usize,
    pub side: GuideSide,
    pub start_m: f64,
    /// Distance of the end of the guide from the end of the span.
    pub end_m: f64,
    /// Between plate edge and face when the joints lie on the common tangent of the pitch circles.
    pub clearance_m: f64,
    /// How much nearer to the chain it stands where the chain leaves it than where it arrives [m].
    pub end_lift_m: f64,
    pub end_radius_m: f64,
}

/// A body that turns about a pivot, held by a torsion spring.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmSpec {
    pub name: String,
    pub pivot: Vec2,
    /// About the pivot.
    pub inertia_kg_m2: f64,
    pub spring_nm_per_rad: f64,
    /// Torque of the spring on the arm in the position in which it is drawn, counterclockwise positive [N m].
    pub spring_torque_nm: f64,
    pub damping_nm_s_per_rad: f64,
}

/// A guide of arcs and lines, along the way from one sprocket to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct RailSpec {
    pub name: String,
    /// Index of the sprocket that the way leaves.
    pub span: usize,
    /// Index of the arm that carries it; None: fixed.
    pub arm: Option<usize>,
    pub side: GuideSide,
    /// Where the chain arrives, and its heading there.
    pub start: Vec2,
    pub heading_rad: f64,
    pub stretches: Vec<Stretch>,
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
}

impl PreloadSpec {
    /// Tension that is asked for [N]; zero where a spring makes it.
    pub fn tension_n(&self) -> f64 {
        match *self {
            PreloadSpec::Sprocket { tension_n, .. } => tension_n,
            PreloadSpec::Arm(_) => 0.0,
        }
    }
}

/// What departs from the ideal drive.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effects {
    pub gap_errors: Vec<GapError>,
    pub gap_waves: Vec<GapWave>,
    pub pitch_errors: Vec<PitchError>,
    /// Of every link [m].
    pub elongation_m: f64,
    /// By which inner links are longer than outer ones [m].
    pub alternate_m: f64,
    pub tight_joints: Vec<TightJoint>,
    /// Of every pin in its bush, beyond the declared friction.
    pub pin_friction: f64,
    pub guides: Vec<GuideEffect>,
}

/// What a guide has beyond its declared contact.
#[derive(Clone, Debug, PartialEq)]
pub struct GuideEffect {
    pub guide: String,
    pub friction: f64,
    /// Of its mounting, in series with the contact [m/N].
    pub compliance_m_per_n: f64,
}

/// A tooth gap that stands further out than the others of its sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GapError {
    /// Index of the sprocket.
    pub sprocket: usize,
    pub gap: u32,
    /// Negative: cut too deep [m].
    pub outward_m: f64,
}

/// Gaps that lie beside their places by a wave round the sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GapWave {
    /// Index of the sprocket.
    pub sprocket: usize,
    pub amplitude_m: f64,
    pub phase_rad: f64,
    /// None: the whole toothing is displaced; else gaps are early and late so many times a turn.
    pub order: Option<u32>,
}

/// A joint that turns hard.
#[derive(Clone, Debug, PartialEq)]
pub struct TightJoint {
    pub name: String,
    pub joint: usize,
    pub torque_nm: f64,
}

/// A link that is longer or shorter than the others.
#[derive(Clone, Debug, PartialEq)]
pub struct PitchError {
    pub name: String,
    pub link: usize,
    pub length_m: f64,
}

/// How it is run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunSpec {
    /// Step [s]; None takes the bound's.
    pub step_s: Option<f64>,
    /// With extra damping, before the recording [s].
    pub run_in_s: f64,
    /// Without it, before the recording [s].
    pub settle_s: f64,
}

impl Drive {
    /// Reads and checks a drive. All mistakes come back at once.
    pub fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Drive, Report> {
        let reader = Reader::new(name, text, overrides);
        let root = reader.parse(text)?;
        let drive = read::drive(&reader.root(&root));
        drop(root);
        let places = reader.finish()?;
        let stem = std::path::Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or(name);
        let drive =
            Drive { name: stem.to_string(), text: text.to_string(), overrides: overrides.to_vec(), places, ..drive };
        drive.check_chains()?;
        for chain in 0..drive.chains() {
            drive.alone(chain).check()?;
        }
        Ok(drive)
    }

    /// Number of chains.
    pub fn chains(&self) -> usize {
        1 + self.more.len()
    }

    /// Sprockets of a chain.
    pub fn sprockets_of(&self, chain: usize) -> std::ops::Range<usize> {
        let first = self.sprockets.iter().position(|s| s.chain == chain).unwrap_or(0);
        first..first + self.sprockets.iter().filter(|s| s.chain == chain).count()
    }

    /// Number of links of every chain.
    pub fn links_of(&self, chain: usize) -> usize {
        if chain == 0 { self.links } else { self.more[chain - 1].links }
    }

    /// The drive of one of its chains: what belongs to others is not there. A shaft that turns another chain before it turns this one with
    /// its speed.
    pub fn alone(&self, chain: usize) -> Drive {
        let mut alone = self.clone();
        if self.more.is_empty() {
            return alone;
        }
        let own = self.sprockets_of(chain);
        let first_link: usize = (0..chain).map(|c| self.links_of(c)).sum();
        let links = first_link..first_link + self.links_of(chain);
        if chain > 0 {
            let part = &self.more[chain - 1];
            (alone.chain, alone.links, alone.scatter, alone.joint) = (part.chain, part.links, part.scatter, part.joint);
            (alone.tooth_contact, alone.guide_contact, alone.ring_contact) =
                (part.tooth_contact, part.guide_contact, part.tooth_contact);
            alone.preload = part.preload;
        }
        alone.more.clear();
        alone.chain_names.clear();
        alone.places = self.places.within(&format!("chains.{}", self.chain_names[chain]));
        alone.sprockets = self.sprockets[own.clone()].to_vec();
        let leader = self.leader_of(chain);
        for (k, s) in alone.sprockets.iter_mut().enumerate() {
            s.chain = 0;
            s.outer = match s.outer {
                OuterSpec::Speed { .. } => s.outer,
                _ if own.start + k == leader => OuterSpec::Speed { speed_rad_s: self.shaft_speed_rad_s(leader) },
                outer => outer,
            };
        }
        if let PreloadSpec::Sprocket { moves, .. } = &mut alone.preload {
            *moves -= own.start;
        }
        let kept: Vec<usize> = (0..self.arms.len())
            .filter(|a| self.rails.iter().any(|r| r.arm == Some(*a) && own.contains(&r.span)))
            .collect();
        let arm = |a: usize| kept.iter().position(|k| *k == a).unwrap_or(0);
        alone.arms = kept.iter().map(|a| self.arms[*a].clone()).collect();
        if let PreloadSpec::Arm(a) = &mut alone.preload {
            *a = arm(*a);
        }
        alone.guides.retain(|g| own.contains(&g.span));
        alone.guides.iter_mut().for_each(|g| g.span -= own.start);
        alone.rails.retain(|r| own.contains(&r.span));
        for r in &mut alone.rails {
            (r.span, r.arm) = (r.span - own.start, r.arm.map(arm));
        }
        let e = &mut alone.effects;
        e.gap_errors.retain(|g| own.contains(&g.sprocket));
        e.gap_errors.iter_mut().for_each(|g| g.sprocket -= own.start);
        e.gap_waves.retain(|w| own.contains(&w.sprocket));
        e.gap_waves.iter_mut().for_each(|w| w.sprocket -= own.start);
        e.pitch_errors.retain(|p| links.contains(&p.link));
        e.pitch_errors.iter_mut().for_each(|p| p.link -= links.start);
        e.tight_joints.retain(|t| links.contains(&t.joint));
        e.tight_joints.iter_mut().for_each(|t| t.joint -= links.start);
        alone.sensors.clear();
        alone
    }

    /// The sprocket that drives a chain: with the prescribed speed, or on a shaft that a chain before it turns.
    pub fn leader_of(&self, chain: usize) -> usize {
        let own = self.sprockets_of(chain);
        let turned_before = |k: &usize| {
            let shaft = self.sprockets[*k].shaft;
            shaft.is_some() && self.sprockets[..own.start].iter().any(|s| s.shaft == shaft)
        };
        let prescribed = |k: &usize| matches!(self.sprockets[*k].outer, OuterSpec::Speed { .. });
        own.clone().find(prescribed).or_else(|| own.clone().find(turned_before)).unwrap_or(own.start)
    }

    /// Nominal speed of a sprocket in the sense in which its chain moves forwards [rad/s].
    fn shaft_speed_rad_s(&self, sprocket: usize) -> f64 {
        let s = &self.sprockets[sprocket];
        if let OuterSpec::Speed { speed_rad_s } = s.outer {
            return speed_rad_s;
        }
        let leader = self.leader_of(s.chain);
        if sprocket != leader {
            let (from, to) = (&self.sprockets[leader], s);
            return self.shaft_speed_rad_s(leader) * f64::from(from.teeth) / f64::from(to.teeth);
        }
        // Turned by a chain before this one, in the sense of the sprocket on that chain.
        let other = self.sprockets.iter().position(|o| o.chain < s.chain && o.shaft == s.shaft && s.shaft.is_some());
        other.map_or(0.0, |o| self.shaft_speed_rad_s(o) * self.sprockets[o].wrap.sign() * s.wrap.sign())
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

    /// Checks of how several chains hang together.
    fn check_chains(&self) -> Result<(), Report> {
        if self.more.is_empty() {
            return Ok(());
        }
        let mut diags: Vec<Diag> = Vec::new();
        let mut error = |path: String, title: String, help: &str| {
            diags.push(self.places.error(&path, title, Some(help.to_string())));
        };
        for (chain, name) in self.chain_names.iter().enumerate() {
            let own = self.sprockets_of(chain);
            let leader = self.leader_of(chain);
            let before =
                |s: &SprocketDrive| s.chain < chain && s.shaft.is_some() && s.shaft == self.sprockets[leader].shaft;
            let driven =
                matches!(self.sprockets[leader].outer, OuterSpec::Speed { .. }) || self.sprockets.iter().any(before);
            if !driven {
                error(
                    format!("chains.{name}.route"),
                    format!("nothing turns chain `{name}`"),
                    "put one of its sprockets on a `shaft` that a chain before it turns, or give one a speed; chains stand in the \
                     order in which they drive each other",
                );
            }
            let spec = if chain == 0 { &self.chain } else { &self.more[chain - 1].chain };
            if !matches!(spec, ChainSpec::Bush(_)) {
                error(
                    format!("chains.{name}.chain"),
                    "silent and abutment chains run alone yet".into(),
                    "take bush chains where there are several",
                );
            }
            let preload = if chain == 0 { &self.preload } else { &self.more[chain - 1].preload };
            if let PreloadSpec::Sprocket { moves, .. } = *preload
                && self.sprockets.iter().filter(|s| s.shaft.is_some() && s.shaft == self.sprockets[moves].shaft).count()
                    > 1
            {
                error(
                    format!("chains.{name}.preload.moves"),
                    format!("sprocket `{}` shares its shaft with another chain's", self.sprockets[moves].name),
                    "tighten the chain by a sprocket of its own, or by an arm",
                );
            }
            for r in self.rails.iter().filter(|r| own.contains(&r.span)) {
                if let Some(arm) = r.arm
                    && self.rails.iter().any(|o| o.arm == Some(arm) && !own.contains(&o.span))
                {
                    error(
                        format!("guides.rail.{}.arm", r.name),
                        format!("arm `{}` carries rails of two chains", self.arms[arm].name),
                        "give each chain an arm of its own",
                    );
                }
            }
        }
        let speeds = |of: &dyn Fn(&SprocketDrive) -> bool| {
            self.sprockets.iter().filter(|s| of(s) && matches!(s.outer, OuterSpec::Speed { .. })).count()
        };
        let on_shafts = (0..self.shafts.len()).filter(|k| speeds(&|s| s.shaft == Some(*k)) > 0).count();
        let drivers = speeds(&|s| s.shaft.is_none()) + on_shafts;
        if drivers != 1 {
            error(
                "speeds.constant".into(),
                format!("{drivers} sprockets and shafts have a prescribed speed"),
                "give exactly one a `[speeds.constant.NAME]`",
            );
        }
        for (k, shaft) in self.shafts.iter().enumerate() {
            let mut on = self.sprockets.iter().filter(|s| s.shaft == Some(k));
            let Some(first) = on.next() else {
                error(
                    format!("shafts.{}", shaft.name),
                    format!("no sprocket sits on shaft `{}`", shaft.name),
                    "give one this `shaft`",
                );
                continue;
            };
            for s in on {
                if (s.x_m, s.y_m) != (first.x_m, first.y_m) {
                    error(
                        format!("sprockets.{}.x_mm", s.name),
                        format!("sprockets `{}` and `{}` sit on one shaft and not at one place", first.name, s.name),
                        "give both the same `x_mm` and `y_mm`",
                    );
                }
                if s.chain == first.chain {
                    error(
                        format!("sprockets.{}.shaft", s.name),
                        format!("sprockets `{}` and `{}` of one chain sit on one shaft", first.name, s.name),
                        "a chain that meets one shaft twice is not there yet",
                    );
                }
            }
        }
        if diags.is_empty() { Ok(()) } else { Err(self.places.report(diags)) }
    }

    /// Rows of what turns: shafts and sprockets in the order of the chains, then arms. Paths in the file.
    pub fn coordinate_paths(&self) -> Vec<String> {
        let mut paths: Vec<String> = Vec::new();
        for s in &self.sprockets {
            let path = s
                .shaft
                .filter(|_| !self.more.is_empty())
                .map_or(format!("sprockets.{}", s.name), |k| format!("shafts.{}", self.shafts[k].name));
            if !paths.contains(&path) {
                paths.push(path);
            }
        }
        // Arms in the order of the chains whose rails they carry.
        for chain in 0..self.chains() {
            let own = self.alone(chain).arms;
            paths.extend(own.iter().map(|a| format!("arms.{}", a.name)));
        }
        paths
    }

    /// Sprockets and what else turns, by their paths, each with its row among [`Drive::coordinate_paths`].
    pub fn turning(&self) -> Vec<(String, usize)> {
        let paths = self.coordinate_paths();
        let row = |path: &String| paths.iter().position(|p| p == path);
        let on_shaft = self.sprockets.iter().filter_map(|s| {
            let path = format!("sprockets.{}", s.name);
            let shaft = s.shaft.map(|k| format!("shafts.{}", self.shafts[k].name));
            let found = row(&path).or_else(|| row(&shaft?))?;
            Some((path, found))
        });
        let own = paths.iter().enumerate().filter(|(_, p)| !p.starts_with("sprockets."));
        on_shaft.chain(own.map(|(row, path)| (path.clone(), row))).collect()
    }

    /// Checks that need more than one value.
    fn check(&self) -> Result<(), Report> {
        let mut diags: Vec<Diag> = Vec::new();
        let mut error = |path: &str, title: String, help: &str| {
            diags.push(self.places.error(path, title, Some(help.to_string())));
        };
        let chain = self.chain.path();
        if !self.links.is_multiple_of(2) {
            error(
                &format!("{chain}.links"),
                format!("`{chain}.links` = {} is odd", self.links),
                "the two kinds of links alternate: take an even number",
            );
        }
        let round = match self.chain {
            ChainSpec::Bush(c) => Some((c.pin_diameter_m, c.bush_diameter_m, c.plate_height_m)),
            ChainSpec::Abutment(c) => Some((c.pin_diameter_m, c.bush_diameter_m, c.plate_height_m)),
            ChainSpec::Silent(_) => None,
        };
        let rows = match self.chain {
            ChainSpec::Bush(c) => [c.inner.pitch_m, c.outer.pitch_m],
            ChainSpec::Abutment(c) => c.pitches_m,
            ChainSpec::Silent(c) => [c.even.pin_pitch_m, c.odd.pin_pitch_m],
        };
        let key = if matches!(self.chain, ChainSpec::Silent(_)) { "pin_pitch_mm" } else { "pitch_mm" };
        let nominal_m = self.chain.pitch_m();
        for (row, pitch_m) in ["inner", "outer"].iter().zip(rows) {
            if pitch_m.is_some_and(|p| (p / nominal_m - 1.0).abs() > LARGEST_PITCH_ERROR) {
                let range = [1.0 - LARGEST_PITCH_ERROR, 1.0 + LARGEST_PITCH_ERROR].map(|share| share * nominal_m * 1e3);
                error(
                    &format!("{chain}.{row}.{key}"),
                    format!(
                        "`{chain}.{row}.{key}` = {} mm is far from the sprockets' pitch of {} mm",
                        pitch_m.unwrap_or(0.0) * 1e3,
                        nominal_m * 1e3
                    ),
                    &format!("teeth bear {:.3} to {:.3} mm", range[0], range[1]),
                );
            }
        }
        if let Some((pin_m, bush_m, plate_m)) = round {
            if pin_m >= bush_m {
                error(
                    &format!("{chain}.pin_diameter_mm"),
                    "the pin does not fit into the bush".into(),
                    "make it smaller than `bush_diameter_mm`",
                );
            }
            if bush_m >= plate_m {
                error(
                    &format!("{chain}.plate_height_mm"),
                    "the plate is no higher than the bush".into(),
                    "make it larger than `bush_diameter_mm`",
                );
            }
        }
        if let ChainSpec::Abutment(c) = self.chain {
            let stretch_m = c.design_tension_n / self.joint.stiffness_n_per_m;
            if stretch_m > 0.02 * c.pitch_m {
                error(
                    "chain.smartchain.design_tension_n",
                    format!("the design tension stretches a link by {:.0} um", stretch_m * 1e6),
                    "make it smaller or the joints stiffer: at most 2 % of the pitch",
                );
            }
            if self.sprockets.iter().any(|s| s.teeth < c.teeth && s.ring == RingForm::Conjugate) {
                error(
                    "chain.smartchain.teeth",
                    format!("the abutments are made for {} teeth, and a sprocket has fewer", c.teeth),
                    "make them for the sprocket with the fewest teeth",
                );
            }
            if self.guides.iter().any(|g| g.side == GuideSide::Outside) {
                error(
                    "guides.fixed",
                    "abutments lie inside the loop, and a guide outside".into(),
                    "set its `side` to \"inside\"",
                );
            }
        }
        let contours = match self.chain {
            ChainSpec::Bush(_) => Vec::new(),
            ChainSpec::Silent(_) => vec![("sprocket", self.tooth_contact.law)],
            ChainSpec::Abutment(_) => vec![("ring", self.ring_contact.law), ("guide", self.guide_contact.law)],
        };
        for (name, law) in contours {
            if matches!(law, ContactLaw::HertzLine(_)) {
                error(
                    &format!("contact.{name}.hertz_line"),
                    "flanks and abutments have no constant radius for Hertz's law".into(),
                    "take the linear law, or one with a restitution",
                );
            }
        }
        if matches!(self.chain, ChainSpec::Silent(_)) && self.guides.iter().any(|g| g.side == GuideSide::Inside) {
            error(
                "guides.fixed",
                "a silent chain has its teeth inside the loop, and a guide lies there".into(),
                "set its `side` to \"outside\"",
            );
        }
        if !matches!(self.chain, ChainSpec::Bush(_)) && self.sprockets.iter().any(|s| s.wrap == Wrap::Outside) {
            error(
                "sprockets",
                "this chain has teeth or abutments on one side only, and a sprocket is wrapped outside".into(),
                "wrap all sprockets inside",
            );
        }
        for e in &self.effects.gap_errors {
            let s = &self.sprockets[e.sprocket];
            if e.gap >= s.teeth || matches!(self.chain, ChainSpec::Silent(_)) {
                error(
                    &format!("effects.gap_error.{}.gap", s.name),
                    format!("sprocket `{}` has no gap {} that seats a bush", s.name, e.gap),
                    &format!("bush and abutment chains: 0 to {}", s.teeth - 1),
                );
            }
        }
        for w in self.effects.gap_waves.iter().filter(|_| matches!(self.chain, ChainSpec::Silent(_))) {
            let name = if w.order.is_some() { "tooth_pitch_error" } else { "sprocket_runout" };
            error(
                &format!("effects.{name}.{}", self.sprockets[w.sprocket].name),
                "gaps of a silent chain's sprocket do not move so far".into(),
                "bush and abutment chains take it",
            );
        }
        for s in &self.sensors {
            if let sensors::SensorReads::Link(link) = s.reads
                && link >= self.links
            {
                let help = format!("links are numbered 0 to {}", self.links - 1);
                error(&format!("{}.link", s.path), format!("the chain has no link {link}"), &help);
            }
        }
        for e in self.effects.tight_joints.iter().filter(|e| e.joint >= self.links) {
            error(
                &format!("effects.tight_joint.{}.joint", e.name),
                format!("the chain has no joint {}", e.joint),
                &format!("joints are numbered 0 to {}", self.links - 1),
            );
        }
        for e in self.effects.pitch_errors.iter().filter(|e| e.link >= self.links) {
            error(
                &format!("effects.pitch_error.{}.link", e.name),
                format!("the chain has no link {}", e.link),
                &format!("links are numbered 0 to {}", self.links - 1),
            );
        }
        if matches!(self.chain, ChainSpec::Abutment(_)) && !self.rails.is_empty() {
            error(
                "guides.rail",
                "abutments do not run on rails yet".into(),
                "take straight guides (`[guides.fixed.NAME]`), or another chain",
            );
        }
        if matches!(self.chain, ChainSpec::Silent(_)) && self.rails.iter().any(|r| r.side == GuideSide::Inside) {
            error(
                "guides.rail",
                "a silent chain has its teeth inside the loop, and a rail lies there".into(),
                "set its `side` to \"outside\"",
            );
        }
        for r in &self.rails {
            if let Err(e) = Rail::new(r.side, r.start, r.heading_rad, &r.stretches) {
                error(
                    &format!("guides.rail.{}.lengths_mm", r.name),
                    format!("rail `{}` cannot be made: {e}", r.name),
                    "stretches have a length, and part a large turn in two",
                );
            }
        }
        if let PreloadSpec::Arm(arm) = self.preload
            && !self.rails.iter().any(|r| r.arm == Some(arm))
        {
            error("preload.moves", format!("arm `{}` carries no rail", self.arms[arm].name), "give a rail this `arm`");
        }
        let linear = matches!(self.guide_contact.law, ContactLaw::Linear { .. });
        if !linear && self.effects.guides.iter().any(|e| e.compliance_m_per_n > 0.0) {
            error(
                "effects.guide_compliance",
                "a yielding guide needs the linear contact law".into(),
                "take `[contact.guide.linear]`",
            );
        }
        let drivers = self.sprockets.iter().filter(|s| matches!(s.outer, OuterSpec::Speed { .. })).count();
        if drivers != 1 {
            error(
                "speeds.constant",
                format!("{drivers} sprockets have a prescribed speed"),
                "give exactly one sprocket a `[speeds.constant.NAME]`",
            );
        }
        let sides = |side| self.guides.iter().filter(move |g| g.side == side);
        for (i, g) in self.guides.iter().enumerate() {
            if sides(g.side).take_while(|o| o.name != g.name).any(|o| o.span == g.span) {
                error(
                    &format!("guides.fixed.{}", g.name),
                    format!("guide `{}` lies on the same side of the same span as another", self.guides[i].name),
                    "join the two, or move one to the other side",
                );
            }
        }
        if diags.is_empty() { Ok(()) } else { Err(self.places.report(diags)) }
    }
}
