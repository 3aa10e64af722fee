//! Arms, sliders and oil of a drive: their keys, units and ranges, and what sliders and oil are.

use super::reader::TomlTable;
use super::sensors::MechanismNames;
use super::torsion::ElasticShaftSpec;
use super::{ArmSpec, ContactSpec, OilEffects};
use crate::diag::last_name;
use crate::effects::{Effect, leak_gap, oil_air, orifice_diameter};
use crate::elements::oil::{Oil, OilGrade};
use crate::elements::passage::{AnnularGap, Pipe, ROUGHEST, TRANSITION_REYNOLDS};
use crate::geometry::Vec2;
use crate::units::{DEG, MM, UM};
use std::f64::consts::PI;

/// A body that slides along a line and presses on an arm with its tip: the plunger of a tensioner.
#[derive(Clone, Debug, PartialEq)]
pub struct SliderSpec {
    /// Last part of its path in the file.
    pub name: String,
    /// Centre of the tip's rounding, where it is drawn, and the direction in which the slider moves out.
    pub centre: Vec2,
    /// Direction in which the slider moves out, counterclockwise from +x [rad].
    pub direction_rad: f64,
    /// Mass [kg].
    pub mass_kg: f64,
    /// Stiffness of its spring [N/m].
    pub spring_n_per_m: f64,
    /// Force of the spring where it is drawn, outwards positive [N].
    pub spring_n: f64,
    /// Damping of its motion [N s/m].
    pub damping_n_s_per_m: f64,
    /// Ends of its way from where it is drawn [m].
    pub low_m: Option<f64>,
    /// Largest distance outwards; None: no stop [m].
    pub high_m: Option<f64>,
    /// Teeth that keep it from going back.
    pub ratchet: Option<RatchetSpec>,
    /// Radius of the tip's rounding [m].
    pub tip_radius_m: f64,
    /// Index of the arm that it presses on.
    pub arm: usize,
    /// Radius of the arm's pad; None: flat. It touches the tip in the middle where both are drawn.
    pub pad_radius_m: Option<f64>,
    /// Turn of the pad's normal from the direction against the slider's [rad].
    pub pad_rad: f64,
}

/// A rack of teeth on a slider, and a pawl that lets it out and not back; a tooth stands at the place where the slider is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RatchetSpec {
    /// Distance of the teeth [m].
    pub pitch_m: f64,
    /// How far the slider goes back behind the tooth that it has reached, until the pawl holds it [m].
    pub backlash_m: f64,
}

/// Oil, and all that it is in and flows through.
#[derive(Clone, Debug, PartialEq)]
pub struct OilSpec {
    /// Density, viscosity, bulk modulus and air of the oil.
    pub oil: Oil,
    /// Closed volumes, each with one pressure.
    pub chambers: Vec<ChamberSpec>,
    /// Names of reservoirs and their gauge pressures, which are constant [Pa].
    pub reservoirs: Vec<(String, f64)>,
    /// What oil flows through, between chambers and reservoirs.
    pub passages: Vec<PassageSpec>,
}

/// Narrowest gap and hole that effects leave [m].
const NARROWEST_GAP_M: f64 = 0.1 * UM;
const NARROWEST_HOLE_M: f64 = 1.0 * UM;
/// Most free air that effects leave, as a share.
const MOST_AIR: f64 = 0.5;

impl OilSpec {
    /// Smallest and largest size of an effect that changes the oil, or the named passage, beyond which more of it changes nothing or makes no part
    /// [SI]; None: its row tells.
    pub fn range_of(&self, effect: &Effect, passage: &str) -> Option<(f64, f64)> {
        if *effect == oil_air::ROW {
            return Some((-self.oil.air_share, MOST_AIR - self.oil.air_share));
        }
        let passage = self.passages.iter().find(|p| last_name(&p.path) == passage)?;
        match &passage.law {
            PassageLaw::Leak { gap, .. } if *effect == leak_gap::ROW => {
                // A little less than is allowed, because of rounding.
                Some((NARROWEST_GAP_M - gap.gap_m, (1.0 - 1e-9) * WIDEST_GAP * gap.diameter_m - gap.gap_m))
            }
            PassageLaw::Orifice { diameter_m, .. } if *effect == orifice_diameter::ROW => {
                Some((NARROWEST_HOLE_M - diameter_m, f64::INFINITY))
            }
            PassageLaw::Leak { .. } | PassageLaw::Orifice { .. } | PassageLaw::Check(_) | PassageLaw::Pipe(_) => None,
        }
    }

    /// With what effects change. A check valve that leaks has a hole beside it, as a passage of its own.
    pub fn with_effects(&self, effects: &OilEffects) -> OilSpec {
        let mut spec = self.clone();
        spec.oil.air_share = (spec.oil.air_share + effects.air_share).clamp(0.0, MOST_AIR);
        spec.oil.viscosity_pa_s *= 1.0 + effects.viscosity_share;
        for e in effects.passages.iter().filter(|e| e.size != 0.0) {
            let Some(k) = self.passages.iter().position(|p| last_name(&p.path) == e.passage) else { continue };
            let leak = match &mut spec.passages[k].law {
                PassageLaw::Orifice { diameter_m, .. } => {
                    *diameter_m = (*diameter_m + e.size).max(NARROWEST_HOLE_M);
                    None
                }
                PassageLaw::Leak { gap, .. } => {
                    gap.gap_m = (gap.gap_m + e.size).max(NARROWEST_GAP_M);
                    None
                }
                PassageLaw::Pipe(_) => None,
                PassageLaw::Check(c) => Some(PassageLaw::Orifice {
                    diameter_m: libm::sqrt(4.0 * e.size / PI),
                    discharge: c.discharge,
                    transition_reynolds: c.transition_reynolds,
                }),
            };
            if let Some(law) = leak {
                let ends = self.passages[k].ends.clone();
                spec.passages.push(PassageSpec { path: e.path.clone(), ends, law });
            }
        }
        spec
    }
}

/// A closed volume of oil with one pressure.
#[derive(Clone, Debug, PartialEq)]
pub struct ChamberSpec {
    /// Last part of its path in the file.
    pub name: String,
    /// Where all is drawn [m3].
    pub volume_m3: f64,
    /// What slides in it.
    pub pistons: Vec<PistonSpec>,
    /// Gauge pressure at rest [Pa].
    pub start_pa: f64,
}

/// A slider in a chamber.
#[derive(Clone, Debug, PartialEq)]
pub struct PistonSpec {
    /// Name of the slider; a part of a valve: its path.
    pub slider: String,
    /// Diameter [m].
    pub bore_m: f64,
    /// 1: its way outwards makes the chamber larger; -1: smaller.
    pub sense: f64,
}

/// An opening between two chambers or reservoirs.
#[derive(Clone, Debug, PartialEq)]
pub struct PassageSpec {
    /// Path in the file: `passages.KIND.NAME`.
    pub path: String,
    /// Names of chambers or reservoirs.
    pub ends: [String; 2],
    /// Flow over the difference of pressures.
    pub law: PassageLaw,
}

/// How much flows through a passage.
#[derive(Clone, Debug, PartialEq)]
pub enum PassageLaw {
    /// A sharp-edged hole.
    Orifice {
        /// Diameter of the hole [m].
        diameter_m: f64,
        /// Discharge coefficient of turbulent flow.
        discharge: f64,
        /// Reynolds number at which laminar flow ends.
        transition_reynolds: f64,
    },
    /// `slider`: the plunger in the bore.
    Leak {
        /// Length, diameter, width and eccentricity of the gap.
        gap: AnnularGap,
        /// Name of the plunger that moves in the bore; None: the wall stands still.
        slider: Option<String>,
    },
    /// A ball that opens in one direction.
    Check(CheckSpec),
    /// A long round pipe.
    Pipe(Pipe),
}

/// A ball on its seat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckSpec {
    /// Radius of the edge on which the ball rests [m].
    pub seat_radius_m: f64,
    /// Radius of the ball [m].
    pub ball_radius_m: f64,
    /// Mass of the ball [kg].
    pub mass_kg: f64,
    /// Largest lift of the ball [m].
    pub lift_m: f64,
    /// Stiffness of its spring [N/m].
    pub spring_n_per_m: f64,
    /// Force of the spring on the closed ball [N].
    pub spring_n: f64,
    /// Stiffness of seat and stop [N/m].
    pub stiffness_n_per_m: f64,
    /// Damping of seat and stop [N s/m].
    pub damping_n_s_per_m: f64,
    /// Discharge coefficient of turbulent flow.
    pub discharge: f64,
    /// Reynolds number at which laminar flow ends.
    pub transition_reynolds: f64,
}

/// Discharge coefficient of sharp edges. Source: Merritt 1967, section 3.4, 0.61; short bores have more.
const DISCHARGE: f64 = 0.61;

pub(super) fn read_arms(root: &TomlTable<'_>, sprockets: &[String]) -> Vec<ArmSpec> {
    let table = root.table("arms");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        if sprockets.contains(&name) {
            t.error(format!("an arm and a sprocket are called `{name}`"), Some("give the arm another name".into()));
        }
        all.push(ArmSpec {
            pivot: Vec2::new(t.required("pivot_x_mm", MM, -1e5..=1e5), t.required("pivot_y_mm", MM, -1e5..=1e5)),
            inertia_kg_m2: t.required("inertia_kg_m2", 1.0, 1e-9..=1e3),
            spring_nm_per_rad: t.number("spring_nm_per_rad", 1.0, 0.0..=1e6).unwrap_or(0.0),
            spring_torque_nm: t.number("spring_torque_nm", 1.0, -1e5..=1e5).unwrap_or(0.0),
            damping_nm_s_per_rad: t.number("damping_nm_s_per_rad", 1.0, 0.0..=1e5).unwrap_or(0.0),
            low_rad: t.number("low_deg", DEG, -180.0..=180.0),
            high_rad: t.number("high_deg", DEG, -180.0..=180.0),
            stop_radius_m: t.number("stop_radius_mm", MM, 0.1..=1e4).unwrap_or(DEFAULT_STOP_RADIUS_M),
            name,
        });
        t.finish();
    }
    table.finish();
    all
}

/// Distance of an arm's stops from its pivot where none is given [m]. assumed: of the size of a tensioner arm's boss.
const DEFAULT_STOP_RADIUS_M: f64 = 30.0 * MM;

/// The contact of arms with their stops: `[contact.stop]`, where an arm has any.
pub(super) fn read_stops(
    t: &TomlTable<'_>,
    arms: &[ArmSpec],
    read: impl Fn(&TomlTable<'_>) -> ContactSpec,
) -> Option<ContactSpec> {
    let has = arms.iter().any(|a| a.low_rad.is_some() || a.high_rad.is_some());
    if !has {
        if t.is_present() {
            t.error("no arm has stops".into(), Some("give one `low_deg` or `high_deg`".into()));
        }
        return None;
    }
    if !t.is_present() {
        let help = "add `[contact.stop]` with a law, e.g. `[contact.stop.linear]`";
        t.error("an arm has stops, and nothing says how hard they are".into(), Some(help.into()));
        return None;
    }
    Some(read(t))
}

pub(super) fn read_sliders(root: &TomlTable<'_>, taken: &[String], arms: &[ArmSpec]) -> Vec<SliderSpec> {
    let table = root.table("sliders");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        if taken.contains(&name) || arms.iter().any(|a| a.name == name) {
            t.error(format!("a slider and another body are called `{name}`"), Some("give it another name".into()));
        }
        let arm = t.text("presses").map_or_else(
            || {
                t.error(format!("slider `{name}` presses on nothing"), Some("add `presses = \"ARM\"`".into()));
                0
            },
            |arm| {
                arms.iter().position(|a| a.name == arm).unwrap_or_else(|| {
                    let known: Vec<&str> = arms.iter().map(|a| a.name.as_str()).collect();
                    let help = format!("arms: {}", known.join(", "));
                    t.error_at("presses", format!("no arm is called `{arm}`"), Some(help));
                    0
                })
            },
        );
        let (low_m, high_m) = (t.number("low_mm", MM, -1e4..=1e4), t.number("high_mm", MM, -1e4..=1e4));
        if let (Some(low), Some(high)) = (low_m, high_m)
            && low >= high
        {
            t.error_at("high_mm", format!("slider `{name}` has no way between its stops"), None);
        }
        let ratchet = read_ratchet(&t);
        all.push(SliderSpec {
            ratchet,
            centre: Vec2::new(t.required("x_mm", MM, -1e5..=1e5), t.required("y_mm", MM, -1e5..=1e5)),
            direction_rad: t.required("direction_deg", DEG, -360.0..=360.0),
            mass_kg: t.required("mass_g", 1e-3, 1e-2..=1e6),
            spring_n_per_m: t.number("spring_n_per_mm", 1e3, 0.0..=1e6).unwrap_or(0.0),
            spring_n: t.number("spring_n", 1.0, -1e6..=1e6).unwrap_or(0.0),
            damping_n_s_per_m: t.number("damping_n_s_per_m", 1.0, 0.0..=1e6).unwrap_or(0.0),
            low_m,
            high_m,
            tip_radius_m: t.number("tip_radius_mm", MM, 0.01..=1e4).unwrap_or(DEFAULT_TIP_RADIUS_M),
            arm,
            pad_radius_m: t.number("pad_radius_mm", MM, 0.1..=1e5),
            pad_rad: t.number("pad_deg", DEG, -80.0..=80.0).unwrap_or(0.0),
            name,
        });
        t.finish();
    }
    table.finish();
    all
}

/// The keys of a ratchet; both or none.
fn read_ratchet(t: &TomlTable<'_>) -> Option<RatchetSpec> {
    let (pitch, backlash) = ("ratchet_pitch_mm", "ratchet_backlash_mm");
    match (t.number(pitch, MM, 0.05..=100.0), t.number(backlash, MM, 0.0..=100.0)) {
        (Some(pitch_m), Some(backlash_m)) => Some(RatchetSpec { pitch_m, backlash_m }),
        (None, None) => None,
        (Some(_), None) | (None, Some(_)) => {
            t.error(format!("`{pitch}` and `{backlash}` go together"), Some("give both, or none".into()));
            None
        }
    }
}

/// Rounding of a plunger's tip where none is given [m]. assumed.
const DEFAULT_TIP_RADIUS_M: f64 = 5.0 * MM;

/// Dynamic viscosity [Pa s]: as it is, or that of an oil of known grade at a temperature, at which it has this density [kg/m3].
pub(super) fn read_viscosity(t: &TomlTable<'_>, density_kg_m3: impl FnOnce() -> f64) -> f64 {
    let (cold, warm, warmth) = ("viscosity_40_mm2_s", "viscosity_100_mm2_s", "temperature_c");
    let grade = [cold, warm].map(|key| t.number(key, 1.0, OilGrade::LEAST_MM2_S..=1e6));
    let temperature = t.number(warmth, 1.0, -60.0..=250.0);
    let [Some(at_40_mm2_s), Some(at_100_mm2_s)] = grade else {
        if temperature.is_some() || grade.iter().any(Option::is_some) {
            let help = "give all three in place of `viscosity_mpa_s`";
            t.error(format!("`{cold}`, `{warm}` and `{warmth}` go together"), Some(help.into()));
            return f64::NAN;
        }
        return t.required("viscosity_mpa_s", 1e-3, 0.1..=1e5);
    };
    let Some(temperature_c) = temperature else {
        t.error(format!("`{warmth}` is missing"), Some(format!("add `{warmth} = 90`")));
        return f64::NAN;
    };
    if t.number("viscosity_mpa_s", 1e-3, 0.1..=1e5).is_some() {
        t.error_at("viscosity_mpa_s", "the viscosity is given twice".into(), Some(format!("remove it, or `{cold}`")));
    }
    if at_100_mm2_s >= at_40_mm2_s {
        t.error_at(warm, "the oil is as thick at 100 degrees as at 40, or thicker".into(), None);
        return f64::NAN;
    }
    let kinematic_m2_s = OilGrade { at_40_mm2_s, at_100_mm2_s }.kinematic_m2_s(temperature_c);
    if kinematic_m2_s < 1e-6 * OilGrade::LEAST_MM2_S {
        let thin = format!("the oil is thinner than {} mm2/s at this temperature", OilGrade::LEAST_MM2_S);
        t.error_at(warmth, thin, Some("give its `viscosity_mpa_s`: the equation of ASTM D341 ends there".into()));
    }
    let dynamic_pa_s = density_kg_m3() * kinematic_m2_s;
    if dynamic_pa_s > 100.0 {
        t.error_at(warmth, "the oil is thicker than 100 Pa s at this temperature".into(), None);
    }
    dynamic_pa_s
}

/// `[oil]`, `[chambers.NAME]`, `[reservoirs.NAME]`, `[passages.KIND.NAME]`; None where there is no chamber, and no valve has a lifter.
pub(super) fn read_oil(root: &TomlTable<'_>, sliders: &[SliderSpec], has_lifters: bool) -> Option<OilSpec> {
    let tables = ["oil", "chambers", "reservoirs", "passages"].map(|name| root.table(name));
    let [oil_table, chamber_table, reservoir_table, passage_table] = &tables;
    if !chamber_table.is_present() && !has_lifters {
        for t in tables.iter().filter(|t| t.is_present()) {
            let help = "add `[chambers.NAME]` with its `volume_mm3`";
            t.error(format!("`{}` without a chamber", t.path()), Some(help.into()));
        }
        return None;
    }
    let density_kg_m3 = oil_table.required("density_kg_per_m3", 1.0, 300.0..=3000.0);
    let oil = Oil {
        density_kg_m3,
        viscosity_pa_s: read_viscosity(oil_table, || density_kg_m3),
        bulk_modulus_pa: oil_table.required("bulk_modulus_gpa", 1e9, 0.01..=100.0),
        air_share: oil_table.number("air_percent", 1e-2, 0.0..=50.0).unwrap_or(0.0),
        air_exponent: oil_table.number("air_exponent", 1.0, 1.0..=1.67).unwrap_or(1.4),
    };
    oil_table.finish();
    let mut reservoirs = Vec::new();
    for (name, t) in reservoir_table.tables() {
        reservoirs.push((name, t.required("pressure_bar", BAR, -0.9..=1e4)));
        t.finish();
    }
    reservoir_table.finish();
    let chambers = read_chambers(chamber_table, sliders);
    let nodes: Vec<String> =
        chambers.iter().map(|c| c.name.clone()).chain(reservoirs.iter().map(|(n, _)| n.clone())).collect();
    let passages = read_passages(passage_table, sliders, &nodes);
    for (_, name) in nodes.iter().enumerate().filter(|(i, name)| nodes[..*i].contains(name)) {
        reservoir_table.error(format!("a chamber and a reservoir are called `{name}`"), Some("rename one".into()));
    }
    for c in chambers.iter().filter(|c| passages.iter().all(|p| !p.ends.contains(&c.name))) {
        let help = "add a passage `between` it and a reservoir";
        chamber_table.table(&c.name).error(format!("chamber `{}` has no way in", c.name), Some(help.into()));
    }
    Some(OilSpec { oil, chambers, reservoirs, passages })
}

/// The slider that a table names.
fn read_slider(t: &TomlTable<'_>, sliders: &[SliderSpec]) -> Option<String> {
    let name = t.text("slider")?;
    if sliders.iter().all(|s| s.name != name) {
        let known: Vec<&str> = sliders.iter().map(|s| s.name.as_str()).collect();
        t.error_at("slider", format!("no slider is called `{name}`"), Some(format!("sliders: {}", known.join(", "))));
    }
    Some(name)
}

fn read_chambers(table: &TomlTable<'_>, sliders: &[SliderSpec]) -> Vec<ChamberSpec> {
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        let bore_m = t.number("bore_mm", MM, 0.1..=1e4);
        let volume_m3 = t.required("volume_mm3", 1e-9, 1e-3..=1e12);
        let piston = read_slider(&t, sliders).map(|slider| {
            if bore_m.is_none() {
                t.error(format!("chamber `{name}` has a slider and no bore"), Some("add `bore_mm = ...`".into()));
            }
            PistonSpec { slider, bore_m: bore_m.unwrap_or(f64::NAN), sense: 1.0 }
        });
        if let Some(PistonSpec { slider, bore_m, .. }) = &piston
            && let Some(low_m) = sliders.iter().find(|s| s.name == *slider).and_then(|s| s.low_m)
            && volume_m3 + 0.25 * PI * bore_m * bore_m * low_m <= 0.0
        {
            let title = format!("slider `{slider}` at its low stop leaves no room in chamber `{name}`");
            t.error_at("volume_mm3", title, Some("make it larger, or move the stop".into()));
        }
        let start_pa = t.number("pressure_bar", BAR, -0.9..=1e4).unwrap_or(0.0);
        all.push(ChamberSpec { name, volume_m3, pistons: piston.into_iter().collect(), start_pa });
        t.finish();
    }
    table.finish();
    all
}

/// `nodes`: names of chambers and reservoirs.
fn read_passages(table: &TomlTable<'_>, sliders: &[SliderSpec], nodes: &[String]) -> Vec<PassageSpec> {
    let mut all: Vec<PassageSpec> = Vec::new();
    for kind in ["orifice", "leak", "pipe", "check"] {
        let of_kind = table.table(kind);
        for (name, t) in of_kind.tables() {
            if all.iter().any(|p| p.path.ends_with(&format!(".{name}"))) {
                t.error(format!("two passages are called `{name}`"), Some("rename one: sensors go by names".into()));
            }
            let ends = read_ends(&t, nodes);
            let law = match kind {
                "orifice" => {
                    let (discharge, transition_reynolds) = read_edge(&t);
                    let diameter_m = t.required("diameter_mm", MM, 1e-3..=1e3);
                    PassageLaw::Orifice { diameter_m, discharge, transition_reynolds }
                }
                "leak" => PassageLaw::Leak { gap: read_gap(&t), slider: read_slider(&t, sliders) },
                "pipe" => PassageLaw::Pipe(read_pipe(&t)),
                _ => PassageLaw::Check(read_check(&t)),
            };
            all.push(PassageSpec { path: t.path().to_string(), ends, law });
            t.finish();
        }
        of_kind.finish();
    }
    table.finish();
    all
}

/// Discharge coefficient of an edge, and the Reynolds number below which the flow over it is laminar.
fn read_edge(t: &TomlTable<'_>) -> (f64, f64) {
    (
        t.number("discharge", 1.0, 0.1..=1.0).unwrap_or(DISCHARGE),
        t.number("transition_reynolds", 1.0, 1.0..=5000.0).unwrap_or(TRANSITION_REYNOLDS),
    )
}

fn read_pipe(t: &TomlTable<'_>) -> Pipe {
    let pipe = Pipe {
        diameter_m: t.required("diameter_mm", MM, 0.1..=1e3),
        length_m: t.required("length_mm", MM, 1.0..=1e6),
        roughness_m: t.number("roughness_um", UM, 0.0..=1e4).unwrap_or(0.0),
    };
    if pipe.roughness_m > ROUGHEST * pipe.diameter_m {
        t.error_at("roughness_um", "the pipe is rougher than a hundredth of its diameter".into(), None);
    }
    if pipe.length_m < SHORTEST_PIPE * pipe.diameter_m {
        let help = "a short bore is an orifice, with a `discharge` of about 0.8";
        t.error_at(
            "length_mm",
            "the pipe is too short for its flow to be that of a long one".into(),
            Some(help.into()),
        );
    }
    pipe
}

/// Shortest pipe over its diameter. What the flow loses at its ends is left out: in a pipe as short, a fifth of all in laminar flow at Re 100 (1.5
/// against f L/D = 6.4), and four fifths in turbulent flow.
const SHORTEST_PIPE: f64 = 10.0;

fn read_gap(t: &TomlTable<'_>) -> AnnularGap {
    read_slit(t, t.required("diameter_mm", MM, 0.1..=1e4))
}

/// A gap about something of this diameter.
pub(super) fn read_slit(t: &TomlTable<'_>, diameter_m: f64) -> AnnularGap {
    let gap = AnnularGap {
        diameter_m,
        gap_m: t.required("gap_um", UM, 0.1..=1e4),
        length_m: t.required("length_mm", MM, 0.01..=1e4),
        eccentricity: t.number("eccentricity", 1.0, 0.0..=0.99).unwrap_or(0.0),
    };
    if gap.gap_m > WIDEST_GAP * gap.diameter_m {
        let title = "the gap is too wide for a flow along a narrow slit";
        let help = "at most a tenth of the diameter; an orifice is wider";
        t.error_at("gap_um", title.into(), Some(help.into()));
    }
    gap
}

/// Names of sliders, valves, chambers and passages, for sensors.
pub(super) fn parts<'a>(
    sliders: &'a [SliderSpec],
    (valves, elastic_shafts): (Vec<String>, &'a [ElasticShaftSpec]),
    oil: Option<&'a OilSpec>,
) -> MechanismNames<'a> {
    MechanismNames {
        valves,
        elastic_shafts: elastic_shafts.iter().map(|s| s.name.as_str()).collect(),
        sliders: sliders.iter().map(|s| s.name.as_str()).collect(),
        chambers: oil.iter().flat_map(|o| &o.chambers).map(|c| c.name.as_str()).collect(),
        passages: oil.iter().flat_map(|o| &o.passages).map(|p| crate::diag::last_name(&p.path)).collect(),
    }
}

fn read_ends(t: &TomlTable<'_>, nodes: &[String]) -> [String; 2] {
    let between = t.texts("between").unwrap_or_default();
    match <[String; 2]>::try_from(between) {
        Ok([a, b]) if a != b && nodes.contains(&a) && nodes.contains(&b) => [a, b],
        _ => {
            t.error(
                format!("`{}` does not say between what it lies", t.path()),
                Some(format!("add `between = [\"A\", \"B\"]` with two of {}", nodes.join(", "))),
            );
            [String::new(), String::new()]
        }
    }
}

pub(super) fn read_check(t: &TomlTable<'_>) -> CheckSpec {
    let seat_radius_m = 0.5 * t.required("seat_mm", MM, 0.1..=1e3);
    let ball_radius_m = 0.5 * t.required("ball_mm", MM, 0.1..=1e3);
    if ball_radius_m <= seat_radius_m {
        t.error("the ball falls through its seat".into(), Some("make `ball_mm` larger than `seat_mm`".into()));
    }
    let (discharge, transition_reynolds) = read_edge(t);
    // Steel where it is not given.
    let steel_kg = 7850.0 * 4.0 / 3.0 * PI * ball_radius_m * ball_radius_m * ball_radius_m;
    CheckSpec {
        seat_radius_m,
        ball_radius_m,
        mass_kg: t.number("mass_g", 1e-3, 1e-3..=1e4).unwrap_or(steel_kg),
        lift_m: t.required("lift_mm", MM, 1e-3..=100.0),
        spring_n_per_m: t.number("spring_n_per_mm", 1e3, 0.0..=1e4).unwrap_or(0.0),
        spring_n: t.number("spring_n", 1.0, 0.0..=1e4).unwrap_or(0.0),
        stiffness_n_per_m: t.number("stiffness_n_per_m", 1.0, 1e3..=1e10).unwrap_or(1e7),
        damping_n_s_per_m: t.number("damping_n_s_per_m", 1.0, 0.0..=1e6).unwrap_or(5.0),
        discharge,
        transition_reynolds,
    }
}

/// Widest gap over the diameter: beyond it the slit is not narrow.
pub(super) const WIDEST_GAP: f64 = 0.1;

/// [Pa].
pub(super) const BAR: f64 = 1e5;

/// Tips of sliders on arms, and sliders on their stops: `[contact.tip]`.
pub(super) fn read_tips(
    t: &TomlTable<'_>,
    sliders: &[SliderSpec],
    read: impl Fn(&TomlTable<'_>) -> ContactSpec,
) -> Option<ContactSpec> {
    match (sliders.is_empty(), t.is_present()) {
        (true, false) => None,
        (true, true) => {
            t.error("no slider touches anything".into(), Some("add `[sliders.NAME]`".into()));
            None
        }
        (false, false) => {
            let help = "add `[contact.tip]` with a law, e.g. `[contact.tip.linear]`";
            t.error("a slider has a tip, and nothing says how hard it is".into(), Some(help.into()));
            None
        }
        (false, true) => Some(read(t)),
    }
}
