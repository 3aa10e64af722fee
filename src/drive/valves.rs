//! Valve trains of a drive with links: their keys, units and ranges, and what cannot be.
//!
//! ```text
//! [valves.NAME]                   body, along_mm, phases_deg, direction_deg, base_radius_mm, roller_radius_mm, lash_um, mass_g, spring_n_per_mm, spring_n,
//!                                 damping_n_s_per_m, spring_mass_g, spring_parts, spring_damping_percent
//! [valves.NAME.lifter]            see `lifters`
//! [valves.NAME.rocker]            ratio, inertia_kg_m2, arm_mm
//! [valves.NAME.gas]               head_mm, angles_deg, pressures_bar
//! [valves.NAME.lift.harmonic]     lift_mm, half_angle_deg, ramp_um, ramp_deg
//! [valves.NAME.lift.polynomial]   likewise, powers
//! [valves.NAME.lift.table]        angles_deg, lifts_mm
//! [contact.cam], [contact.seat]   laws of cams on followers and of valves on their seats
//! ```

use super::bearings::{BearingSpec, Carried};
use super::lifters::{LifterSpec, read_lifter};
use super::mechanism::{BAR, OilSpec};
use super::reader::TomlTable;
use super::torsion::ElasticShaftSpec;
use super::{ContactSpec, Effects, ShaftSpec, SprocketDrive};
use crate::effects::valve_spring;
use crate::elements::lift_law::{LiftLaw, LiftShape, LiftTable, polynomial};
use crate::elements::load::PressureTable;
use crate::units::{DEG, MM, UM};
use std::f64::consts::PI;
use std::sync::Arc;

/// A rocker arm between cam and valve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RockerSpec {
    /// Way of the valve over the lift of the cam.
    pub ratio: f64,
    /// Moment of inertia about its pivot [kg m2].
    pub inertia_kg_m2: f64,
    /// Distance of the valve from the pivot [m].
    pub arm_m: f64,
}

impl RockerSpec {
    /// The mass at the valve that is as hard to move [kg].
    pub fn moved_kg(&self) -> f64 {
        self.inertia_kg_m2 / (self.arm_m * self.arm_m)
    }
}

/// Gas on the head of a valve.
#[derive(Clone, Debug, PartialEq)]
pub struct GasSpec {
    /// Diameter of the head [m].
    pub head_m: f64,
    /// Pressure in the cylinder above that in the port, over the angle of the cam from full lift.
    pub pressures: PressureTable,
}

/// Cams along an elastic shaft.
#[derive(Clone, Debug, PartialEq)]
pub struct CamPlaces {
    /// Index of the elastic shaft.
    pub shaft: usize,
    /// Distance of every cam from what turns the shaft [m].
    pub along_m: Vec<f64>,
}

/// Valves alike, each with a cam of its own on one shaft.
#[derive(Clone, Debug, PartialEq)]
pub struct ValveSpec {
    /// Last part of its path in the file: `valves.NAME`.
    pub name: String,
    /// The sprocket that turns with the cams.
    pub sprocket: usize,
    /// Where the cams stand along an elastic shaft that turns with that; None: on what turns with the sprocket as one.
    pub along: Option<CamPlaces>,
    /// For each valve the turn of the shaft, in its own sense and from the start of the recording, at which the cam gives full lift [rad].
    pub phases_rad: Vec<f64>,
    /// Lift over the angle of the cam.
    pub law: Arc<LiftLaw>,
    /// Direction in which the cams lift, counterclockwise from +x [rad].
    pub direction_rad: f64,
    /// Radius of the base circle [m].
    pub base_m: f64,
    /// Radius of the follower's roller [m]; None: flat.
    pub roller_m: Option<f64>,
    /// Gap on the base circle [m].
    pub lash_m: f64,
    /// Hydraulic lifters between cams and valves.
    pub lifter: Option<LifterSpec>,
    /// Rocker arms between cams and valves, or their lifters.
    pub rocker: Option<RockerSpec>,
    /// Gas on the heads.
    pub gas: Option<GasSpec>,
    /// Mass of valve and follower, without the spring; with a lifter, of the valve [kg].
    pub mass_kg: f64,
    /// Stiffness of its spring [N/m].
    pub spring_n_per_m: f64,
    /// Force of the spring on the closed valve [N].
    pub spring_n: f64,
    /// Damping of the valve's motion [N s/m].
    pub damping_n_s_per_m: f64,
    /// Mass of the spring [kg].
    pub spring_mass_kg: f64,
    /// Parts of the spring with a mass each between them; 1: a third of its mass goes with the valve.
    pub spring_parts: usize,
    /// Damping ratio of the spring's first surge mode.
    pub spring_damping: f64,
}

impl ValveSpec {
    /// Path of the valve with this number, from 0 on; of one alone its name.
    pub fn path(&self, number: usize) -> String {
        if self.phases_rad.len() == 1 {
            format!("valves.{}", self.name)
        } else {
            format!("valves.{}.{}", self.name, number + 1)
        }
    }

    /// Paths of what slides, valve by valve: the valve, then the masses of its spring, then its lifter.
    pub fn slider_paths(&self) -> Vec<String> {
        let of = |number: usize| {
            let valve = self.path(number);
            let masses = (1..self.spring_parts).map(|i| format!("{valve}.spring.{i}"));
            let lifter = self.lifter.iter().map(|_| format!("{valve}.lifter"));
            std::iter::once(valve.clone()).chain(masses).chain(lifter).collect::<Vec<String>>()
        };
        (0..self.phases_rad.len()).flat_map(of).collect()
    }

    /// Paths of its touches: cam and seat of every valve, and the ends of its lifter's way.
    pub fn touch_paths(&self) -> Vec<String> {
        let ends = [
            self.lifter.as_ref().map(|_| "lifter.in_mm"),
            self.lifter.as_ref().and_then(|l| l.out_m).map(|_| "lifter.out_mm"),
        ];
        let what = || ["cam", "seat"].into_iter().chain(ends.into_iter().flatten());
        let of = |number: usize| what().map(move |what| format!("{}.{what}", self.path(number)));
        (0..self.phases_rad.len()).flat_map(of).collect()
    }

    /// Mass that moves with the valve [kg].
    pub fn moved_kg(&self) -> f64 {
        // Behind a lifter the rocker arm moves with that.
        let rocker_kg = self.rocker.filter(|_| self.lifter.is_none()).map_or(0.0, |r| r.moved_kg());
        // A spring in parts has a mass at each joint of two parts. Half a part is left at each end: one moves with the valve, one stands in the head.
        let share = if self.spring_parts == 1 { 1.0 / 3.0 } else { 0.5 / self.spring_parts as f64 };
        self.mass_kg + rocker_kg + share * self.spring_mass_kg
    }

    /// The same with what effects change about its springs.
    pub fn with_effects(&self, effects: &Effects) -> ValveSpec {
        let share = 1.0 + effects.of_part(&valve_spring::ROW, &self.name);
        let (spring_n_per_m, spring_n) = (self.spring_n_per_m * share, self.spring_n * share);
        ValveSpec { spring_n_per_m, spring_n, ..self.clone() }
    }

    /// Speed of the cam at which the spring can no longer hold the follower on it, as rigid parts [rad/s]; infinite where it always can.
    pub fn floats_at_rad_s(&self) -> f64 {
        let lifter_kg = self.lifter.as_ref().map_or(0.0, |l| l.mass_kg);
        let (ratio, rocker_kg) = self.rocker.map_or((1.0, 0.0), |r| (r.ratio, r.moved_kg()));
        let mass_kg = self.mass_kg + lifter_kg + rocker_kg + self.spring_mass_kg / 3.0;
        let bound = |angle: f64| {
            let s = self.law.at(angle);
            let (opened_m, bend_m) = (ratio * (s.lift_m - self.lash_m), ratio * s.bend_m);
            let holds = self.spring_n + self.spring_n_per_m * opened_m;
            if opened_m > 0.0 && bend_m < 0.0 { libm::sqrt(holds / (-bend_m * mass_kg)) } else { f64::INFINITY }
        };
        self.law.sweep(SWEEP).map(bound).fold(f64::INFINITY, f64::min)
    }
}

/// Angles over the lift at which curvature and inertia are looked at.
const SWEEP: usize = 2000;
/// Spring parts where its mass is given and their number is not. assumed: the first surge mode is then right to 0.7 %.
const SPRING_PARTS: usize = 8;

/// Names and places that valves refer to.
pub(super) struct CamCarriers<'a> {
    pub(super) sprockets: &'a [SprocketDrive],
    pub(super) shafts: &'a [ShaftSpec],
    pub(super) elastic_shafts: &'a [ElasticShaftSpec],
    pub(super) bearings: &'a [BearingSpec],
    /// Where the oil of lifters may come from and go to.
    pub(super) oil: Option<&'a OilSpec>,
}

impl CamCarriers<'_> {
    /// The elastic shaft called so, with its index.
    fn elastic(&self, name: &str) -> Option<(usize, &ElasticShaftSpec)> {
        self.elastic_shafts.iter().enumerate().find(|(_, s)| s.name == name)
    }

    /// The sprocket called so, or the first on the shaft or elastic shaft called so.
    fn find(&self, name: &str) -> Option<usize> {
        if let Some((_, elastic)) = self.elastic(name) {
            return elastic.sprocket;
        }
        let shaft = self.shafts.iter().position(|s| s.name == name);
        let on_shaft = || self.sprockets.iter().position(|s| shaft.is_some() && s.shaft == shaft);
        self.sprockets.iter().position(|s| s.name == name).or_else(on_shaft)
    }

    fn has_bearing(&self, sprocket: usize) -> bool {
        let shaft = self.sprockets.get(sprocket).and_then(|s| s.shaft);
        self.bearings.iter().any(|b| match b.on {
            Carried::Sprocket(k) => k == sprocket,
            Carried::Shaft(k) => shaft == Some(k),
            Carried::Guide(_) | Carried::Rail(_) => false,
        })
    }
}

/// Whether a valve has a lifter.
pub(super) fn have_lifters(root: &TomlTable<'_>) -> bool {
    root.table("valves").tables().iter().any(|(_, t)| t.table("lifter").is_present())
}

/// The lifter of every valve that has one, by the valve's path.
pub(super) fn lifters(valves: &[ValveSpec]) -> Vec<(String, &LifterSpec)> {
    let of = |v| {
        let ValveSpec { lifter, phases_rad, .. }: &ValveSpec = v;
        lifter.iter().flat_map(move |l| (0..phases_rad.len()).map(move |n| (v.path(n), l)))
    };
    valves.iter().flat_map(of).collect()
}

/// Name of every valve: its path below `valves`.
pub(super) fn names(valves: &[ValveSpec]) -> Vec<String> {
    let name = |path: String| path.trim_start_matches("valves.").to_string();
    valves.iter().flat_map(|v| (0..v.phases_rad.len()).map(move |n| name(v.path(n)))).collect()
}

/// `[valves.NAME]`.
pub(super) fn read_valves(root: &TomlTable<'_>, carriers: &CamCarriers<'_>) -> Vec<ValveSpec> {
    let table = root.table("valves");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        let spec = read_valve(name, &t, carriers);
        t.finish();
        all.push(spec);
    }
    table.finish();
    all
}

fn read_valve(name: String, t: &TomlTable<'_>, carriers: &CamCarriers<'_>) -> ValveSpec {
    let body = t.text("body");
    let sprocket = body.as_deref().and_then(|body| carriers.find(body));
    if sprocket.is_none() {
        let known: Vec<&str> = carriers.sprockets.iter().map(|s| s.name.as_str()).collect();
        let help = Some(format!("name a sprocket, or a shaft with one: {}", known.join(", ")));
        match &body {
            Some(body) if carriers.elastic(body).is_some() => t.error_at(
                "body",
                format!("`{body}` turns with a shaft that carries no sprocket"),
                Some("cams need an axis: give its `body` a sprocket".into()),
            ),
            Some(body) => t.error_at("body", format!("no cam can turn with `{body}`"), help),
            None => t.error(format!("nothing turns the cams of `{name}`"), help),
        }
    }
    let elastic = body.as_deref().and_then(|body| carriers.elastic(body));
    // Along an elastic shaft cams stand on other bearings than its sprocket.
    if elastic.is_none() && sprocket.is_some_and(|k| carriers.has_bearing(k)) {
        let help = "leave out the bearing, let the cams turn with an `[elastic_shafts.NAME]`, or give the torque of the valves as `[loads.orders.NAME]`";
        t.error_at(
            "body",
            "cams stand on axes that do not give way, and this one has a bearing".into(),
            Some(help.into()),
        );
    }
    let phases_rad = t.list("phases_deg", DEG, -3600.0..=3600.0).unwrap_or_else(|| vec![0.0]);
    let along = read_places(t, elastic, phases_rad.len());
    let roller_m = t.number("roller_radius_mm", MM, 0.1..=1e3);
    let base_m = t.required("base_radius_mm", MM, 0.1..=1e3);
    let law = read_lift(&t.table("lift"));
    let spring_mass_kg = t.number("spring_mass_g", 1e-3, 0.0..=1e5).unwrap_or(0.0);
    let parts = t.integer("spring_parts", 1..=64).map(|n| n as usize);
    if spring_mass_kg == 0.0 && parts.is_some_and(|n| n > 1) {
        t.error_at("spring_parts", "a spring without mass has no surge".into(), Some("give `spring_mass_g`".into()));
    }
    let default_parts = if spring_mass_kg > 0.0 { SPRING_PARTS } else { 1 };
    if spring_mass_kg == 0.0 && t.has("spring_damping_percent") {
        let help = "give `spring_mass_g`, or damp the valve with `damping_n_s_per_m`";
        t.error_at("spring_damping_percent", "a spring without mass has no surge".into(), Some(help.into()));
    }
    let spring_n = t.required("spring_n", 1.0, 0.0..=1e6);
    let lash_m = t.number("lash_um", UM, 0.0..=5000.0).unwrap_or(0.0);
    let lifter = read_lifter(&t.table("lifter"), carriers.oil, spring_n);
    if lifter.is_some() && lash_m > 0.0 {
        t.error_at("lash_um", "a hydraulic lifter leaves no lash".into(), Some("remove one of both".into()));
    }
    let spec = ValveSpec {
        lifter,
        rocker: read_rocker(&t.table("rocker")),
        gas: read_gas(&t.table("gas")),
        sprocket: sprocket.unwrap_or(0),
        along,
        phases_rad,
        direction_rad: t.number("direction_deg", DEG, -360.0..=360.0).unwrap_or(0.5 * PI),
        base_m,
        roller_m,
        lash_m,
        mass_kg: t.required("mass_g", 1e-3, 0.1..=1e6),
        spring_n_per_m: t.required("spring_n_per_mm", 1e3, 0.01..=1e5),
        spring_n,
        damping_n_s_per_m: t.number("damping_n_s_per_m", 1.0, 0.0..=1e6).unwrap_or(0.0),
        spring_mass_kg,
        spring_parts: parts.unwrap_or(default_parts),
        spring_damping: t.number("spring_damping_percent", 1e-2, 0.0..=100.0).unwrap_or(0.02),
        law: Arc::new(law),
        name,
    };
    if spec.phases_rad.is_empty() {
        t.error_at("phases_deg", "no valve".into(), Some("give one phase for each valve".into()));
    }
    check_contour(t, &spec);
    spec
}

/// Where `cams` cams stand along an elastic shaft.
fn read_places(t: &TomlTable<'_>, on: Option<(usize, &ElasticShaftSpec)>, cams: usize) -> Option<CamPlaces> {
    let Some((shaft, spec)) = on else {
        if t.has("along_mm") {
            let help = "name an elastic shaft as `body` (`[elastic_shafts.NAME]`)";
            t.error_at("along_mm", "these cams turn with their sprocket as one".into(), Some(help.into()));
        }
        return None;
    };
    let along_m = t.list("along_mm", MM, 0.0..=1e5);
    // What is out of range has been told.
    if along_m.is_none() && t.has("along_mm") {
        return None;
    }
    let along_m = along_m.unwrap_or_default();
    if along_m.len() != cams {
        let title = format!("{} places along `{}` for {cams} cams", along_m.len(), spec.name);
        t.error_at("along_mm", title, Some("give the distance of every cam from what turns the shaft".into()));
        return None;
    }
    let length_m = spec.shaft.length_m;
    if let Some(beyond) = along_m.iter().find(|at| **at > length_m) {
        let title = format!("{:.1} mm lies beyond the shaft's end at {:.1} mm", beyond / MM, length_m / MM);
        t.error_at("along_mm", title, None);
    }
    Some(CamPlaces { shaft, along_m })
}

fn read_rocker(t: &TomlTable<'_>) -> Option<RockerSpec> {
    if !t.is_present() {
        return None;
    }
    let ratio = t.required("ratio", 1.0, 0.1..=10.0);
    let inertia_kg_m2 = t.number("inertia_kg_m2", 1.0, 0.0..=1e3).unwrap_or(0.0);
    let arm_m = t.number("arm_mm", MM, 0.1..=1e4);
    if inertia_kg_m2 > 0.0 && arm_m.is_none() {
        t.error_at(
            "inertia_kg_m2",
            "how far the valve is from the pivot is not said".into(),
            Some("add `arm_mm`".into()),
        );
    }
    t.finish();
    Some(RockerSpec { ratio, inertia_kg_m2, arm_m: arm_m.unwrap_or(1.0) })
}

fn read_gas(t: &TomlTable<'_>) -> Option<GasSpec> {
    if !t.is_present() {
        return None;
    }
    let head_m = t.required("head_mm", MM, 0.1..=1e3);
    let angles = t.list("angles_deg", DEG, -180.0..=180.0).unwrap_or_default();
    let pressures = t.list("pressures_bar", BAR, -10.0..=1e3).unwrap_or_default();
    let counts = (angles.len(), pressures.len());
    let pressures = PressureTable::new(angles, pressures);
    if pressures.is_none() {
        let title = format!("{} angles, {} pressures: not a table", counts.0, counts.1);
        t.error(title, Some("give at least two of each, the angles rising from -180 to 180 at most".into()));
    }
    t.finish();
    Some(GasSpec { head_m, pressures: pressures? })
}

/// A cam whose contour would cut itself under its follower.
fn check_contour(t: &TomlTable<'_>, spec: &ValveSpec) {
    let rows = || spec.law.sweep(SWEEP).map(|angle| spec.law.at(angle));
    if let Some(low) = rows().map(|s| s.lift_m).reduce(f64::min).filter(|low| *low < -1e-9) {
        let title = format!("the lift goes {:.3} mm below the base circle", -low / MM);
        t.error(title, Some("take other `powers`, or closer points of the table".into()));
        return;
    }
    match spec.roller_m {
        None => {
            // Radius of curvature of a contour under a flat follower: R_b + s + s''.
            let least = rows().map(|s| s.lift_m + s.bend_m).fold(0.0, f64::min);
            if spec.base_m + least <= 0.0 {
                let title = "the cam would cut itself: a flat follower cannot follow this lift".to_string();
                let at_least = libm::ceil(-least / MM * 100.0 + 0.5) / 100.0;
                let help = format!("at least {at_least:.2} mm, a smaller lift, or a roller");
                t.error_at("base_radius_mm", title, Some(help));
            }
        }
        Some(roller_m) => {
            // The contour lies a roller's radius within the path of the centre: where that is sharper than the roller, it would cut itself.
            let cuts = |roller_m: f64| {
                rows().any(|s| {
                    let r = spec.base_m + roller_m + s.lift_m;
                    let square = r * r + s.slope_m * s.slope_m;
                    let bend = r * r + 2.0 * s.slope_m * s.slope_m - r * s.bend_m;
                    bend * roller_m >= square * libm::sqrt(square)
                })
            };
            if cuts(roller_m) {
                let (mut low, mut high) = (0.0, roller_m);
                for _ in 0..40 {
                    let middle = 0.5 * (low + high);
                    if cuts(middle) {
                        high = middle;
                    } else {
                        low = middle;
                    }
                }
                let title = format!("the roller is too large for this cam: {:.2} mm", roller_m / MM);
                let help = format!("at most {:.2} mm", libm::floor(low / MM * 100.0) / 100.0);
                t.error_at("roller_radius_mm", title, Some(help));
            }
        }
    }
}

fn read_lift(t: &TomlTable<'_>) -> LiftLaw {
    let [harmonic, poly, table] = ["harmonic", "polynomial", "table"].map(|kind| t.table(kind));
    let given: Vec<&TomlTable<'_>> = [&harmonic, &poly, &table].into_iter().filter(|t| t.is_present()).collect();
    if given.len() != 1 {
        let title = if given.is_empty() { "no lift law".to_string() } else { "more than one lift law".to_string() };
        t.error(title, Some("give one of `lift.harmonic`, `lift.polynomial`, `lift.table`".into()));
    }
    let law = if table.is_present() {
        lift_table(&table)
    } else if poly.is_present() {
        let powers = poly.list("powers", 1.0, 2.0..=200.0).unwrap_or_else(|| POWERS.to_vec());
        let mut whole: Vec<u32> = powers.iter().map(|p| *p as u32).collect();
        whole.sort_unstable();
        whole.dedup();
        if whole.len() != powers.len() || powers.iter().any(|p| p.fract() != 0.0) || whole.len() < 3 {
            let help = "at least three, e.g. [2, 8, 14, 20]";
            poly.error_at("powers", "powers are different whole numbers".into(), Some(help.into()));
            whole = POWERS.map(|p| p as u32).to_vec();
        }
        lift_of(&poly, polynomial(&whole))
    } else {
        lift_of(&harmonic, LiftShape::Harmonic)
    };
    [&harmonic, &poly, &table, t].iter().for_each(|t| t.finish());
    law
}

/// Source: Stoddart 1953: powers that lift fast and end softly.
const POWERS: [f64; 4] = [2.0, 8.0, 14.0, 20.0];

fn lift_of(t: &TomlTable<'_>, shape: LiftShape) -> LiftLaw {
    if !t.is_present() {
        return LiftLaw::new(shape, 1e-3, 1.0, (0.0, 0.0));
    }
    let (lift_m, half_rad) = (t.required("lift_mm", MM, 1e-3..=1e3), t.required("half_angle_deg", DEG, 1.0..=170.0));
    let ramp = (t.number("ramp_um", UM, 0.0..=5000.0).unwrap_or(0.0), t.number("ramp_deg", DEG, 0.1..=90.0));
    if ramp.0 > 0.0 && ramp.1.is_none() {
        t.error_at("ramp_um", "how long the ramps are is not said".into(), Some("add `ramp_deg`".into()));
    }
    let ramp = (ramp.0, if ramp.0 > 0.0 { ramp.1.unwrap_or(10.0 * DEG) } else { 0.0 });
    if half_rad + ramp.1 > PI {
        t.error_at("half_angle_deg", "lift and ramps take more than a turn".into(), None);
    }
    LiftLaw::new(shape, lift_m, half_rad, ramp)
}

/// Share of the largest lift by which a table may lie lower at angle 0.
const FULL_AT_ZERO: f64 = 1e-3;

fn lift_table(t: &TomlTable<'_>) -> LiftLaw {
    let angles = t.list("angles_deg", DEG, -180.0..=180.0).unwrap_or_default();
    let lifts = t.list("lifts_mm", MM, 0.0..=1e3).unwrap_or_default();
    let counts = (angles.len(), lifts.len());
    let highest = lifts.iter().copied().fold(0.0, f64::max);
    let ends_at_rest = lifts.first() == Some(&0.0) && lifts.last() == Some(&0.0);
    match LiftTable::new(angles, lifts) {
        Some(table) if ends_at_rest => {
            let law = LiftLaw::of_table(table);
            if law.at(0.0).lift_m < (1.0 - FULL_AT_ZERO) * highest {
                let title = "the lift is not largest at angle 0, where phases count from";
                t.error_at("angles_deg", title.into(), Some("shift the angles".into()));
            }
            return law;
        }
        Some(_) => t.error_at("lifts_mm", "a table begins and ends with no lift".into(), None),
        None => {
            let title = format!("{} angles, {} lifts: not a table", counts.0, counts.1);
            t.error(title, Some("give at least four of each, the angles rising from -180 to 180 at most".into()));
        }
    }
    LiftLaw::new(LiftShape::Harmonic, 1e-3, 1.0, (0.0, 0.0))
}

/// `[contact.cam]` and `[contact.seat]`: where there are valves.
pub(super) fn read_valve_contacts(
    [cam, seat]: [&TomlTable<'_>; 2],
    valves: &[ValveSpec],
    read: impl Fn(&TomlTable<'_>) -> ContactSpec,
) -> Option<[ContactSpec; 2]> {
    for t in [cam, seat] {
        match (valves.is_empty(), t.is_present()) {
            (true, true) => t.error("there is no valve".into(), Some("add `[valves.NAME]`".into())),
            (false, false) => {
                let help = format!("add `[{path}]` with a law, e.g. `[{path}.hunt_crossley]`", path = t.path());
                t.error(format!("valves need the law in `[{}]`, which is missing", t.path()), Some(help));
            }
            (true, false) | (false, true) => {}
        }
    }
    (!valves.is_empty() && cam.is_present() && seat.is_present()).then(|| [read(cam), read(seat)])
}
