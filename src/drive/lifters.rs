//! Hydraulic lifters of valves: a follower and a plunger with oil between them, from the parts of tensioners.
//!
//! ```text
//! [valves.NAME.lifter]       mass_g, bore_mm, volume_mm3, pressure_bar, spring_n, spring_n_per_mm, in_mm, out_mm, supply, drain
//! [valves.NAME.lifter.leak]  gap_um, length_mm, eccentricity
//! [valves.NAME.lifter.ball]  the keys of `[passages.check.NAME]`
//! ```
//! The oil of each is a chamber `chambers.NAME_lifter`, or `NAME_1_lifter` of the first of several; the passages `NAME_lifter_ball` from the supply and
//! `NAME_lifter_leak` to the drain.

use super::mechanism::{
    BAR, ChamberSpec, CheckSpec, OilSpec, PassageLaw, PassageSpec, PistonSpec, read_check, read_slit,
};
use super::reader::TomlTable;
use crate::diag::last_name;
use crate::elements::hydraulics::{MAX_CHAMBERS, MAX_PASSAGES, PassageEnd, islands};
use crate::elements::passage::AnnularGap;
use crate::units::MM;
use std::f64::consts::PI;

/// What stands between a cam and each valve of a row.
#[derive(Clone, Debug, PartialEq)]
pub struct LifterSpec {
    /// Mass of what moves with the cam [kg].
    pub mass_kg: f64,
    /// Diameter of the plunger [m].
    pub bore_m: f64,
    /// Oil under the plunger while the valve is closed and the cam does not lift [m3].
    pub volume_m3: f64,
    /// Gauge pressure where a run begins [Pa].
    pub start_pa: f64,
    /// Stiffness of the spring that pushes follower and plunger apart [N/m].
    pub spring_n_per_m: f64,
    /// Its force while the valve is closed and the cam does not lift [N].
    pub spring_n: f64,
    /// Ends of the plunger's way from there, into the follower and out of it [m].
    pub in_m: f64,
    /// Largest distance outwards; None: no end [m].
    pub out_m: Option<f64>,
    /// The gap beside the plunger.
    pub gap: AnnularGap,
    /// The check valve through which oil comes in.
    pub ball: CheckSpec,
    /// Names of the reservoirs or chambers from which oil comes, and into which it leaks.
    pub supply: String,
    /// Where leaked oil goes.
    pub drain: String,
}

impl LifterSpec {
    /// Area of the plunger [m2].
    pub fn area_m2(&self) -> f64 {
        0.25 * PI * self.bore_m * self.bore_m
    }

    /// Force with which oil and spring push on a closed valve where a run begins [N].
    pub fn start_n(&self) -> f64 {
        self.spring_n + self.start_pa * self.area_m2()
    }

    /// Oil, check valve and gap of the lifter of the valve with this path.
    pub fn oil_parts(&self, valve: &str) -> (ChamberSpec, [PassageSpec; 2]) {
        let name = format!("{}_lifter", valve.trim_start_matches("valves.").replace('.', "_"));
        let piston = |slider: String, sense: f64| PistonSpec { slider, bore_m: self.bore_m, sense };
        let chamber = ChamberSpec {
            name: name.clone(),
            volume_m3: self.volume_m3,
            pistons: vec![piston(valve.to_string(), 1.0), piston(format!("{valve}.lifter"), -1.0)],
            start_pa: self.start_pa,
        };
        let ball = PassageSpec {
            path: format!("passages.check.{name}_ball"),
            ends: [self.supply.clone(), name.clone()],
            law: PassageLaw::Check(self.ball),
        };
        let leak = PassageSpec {
            path: format!("passages.leak.{name}_leak"),
            ends: [name, self.drain.clone()],
            law: PassageLaw::Leak { gap: self.gap, slider: None },
        };
        (chamber, [ball, leak])
    }
}

/// `[valves.NAME.lifter]`, if it is there. `spring_n`: of the valve's spring on the closed valve [N].
pub(super) fn read_lifter(t: &TomlTable<'_>, oil: Option<&OilSpec>, spring_n: f64) -> Option<LifterSpec> {
    if !t.is_present() {
        return None;
    }
    let bore_m = t.required("bore_mm", MM, 0.1..=1e3);
    let [supply, drain] = ["supply", "drain"].map(|key| read_end(t, key, oil));
    let start_of = |name: &str| {
        let oil = oil?;
        let chamber = oil.chambers.iter().find(|c| c.name == name).map(|c| c.start_pa);
        chamber.or_else(|| oil.reservoirs.iter().find(|(r, _)| r == name).map(|(_, pa)| *pa))
    };
    let (leak, ball) = (t.table("leak"), t.table("ball"));
    let spec = LifterSpec {
        mass_kg: t.required("mass_g", 1e-3, 0.1..=1e6),
        bore_m,
        volume_m3: t.required("volume_mm3", 1e-9, 1e-3..=1e9),
        start_pa: t.number("pressure_bar", BAR, -0.9..=1e4).or_else(|| start_of(&supply)).unwrap_or(0.0),
        spring_n_per_m: t.number("spring_n_per_mm", 1e3, 0.0..=1e5).unwrap_or(0.0),
        spring_n: t.number("spring_n", 1.0, 0.0..=1e5).unwrap_or(0.0),
        in_m: t.required("in_mm", MM, 1e-3..=100.0),
        out_m: t.number("out_mm", MM, 1e-3..=100.0),
        gap: read_slit(&leak, bore_m),
        ball: read_check(&ball),
        supply,
        drain,
    };
    if spec.volume_m3 <= spec.area_m2() * spec.in_m {
        let least = libm::ceil(spec.area_m2() * spec.in_m / 1e-9);
        let title = "the plunger's way in is longer than the room under it";
        t.error_at("volume_mm3", title.into(), Some(format!("more than {least} mm3, or a shorter `in_mm`")));
    }
    let highest_pa = start_of(&spec.supply).map_or(spec.start_pa, |supply_pa| supply_pa.max(spec.start_pa));
    let pushes_n = spec.spring_n + highest_pa * spec.area_m2();
    if pushes_n >= spring_n {
        let title = format!("the lifter holds the valve open: it pushes with {pushes_n:.4} N");
        let help = format!("less than the {spring_n} N of the valve's spring: less spring, bore or pressure");
        t.error(title, Some(help));
    }
    [&leak, &ball, t].iter().for_each(|t| t.finish());
    Some(spec)
}

fn read_end(t: &TomlTable<'_>, key: &str, oil: Option<&OilSpec>) -> String {
    let reservoirs = oil.iter().flat_map(|o| &o.reservoirs).map(|(name, _)| name.as_str());
    let nodes: Vec<&str> = reservoirs.chain(oil.iter().flat_map(|o| &o.chambers).map(|c| c.name.as_str())).collect();
    let help = match nodes.is_empty() {
        true => "add `[reservoirs.NAME]` with its `pressure_bar`, and name it here".to_string(),
        false => format!("name one of {}", nodes.join(", ")),
    };
    let name = t.text(key).unwrap_or_default();
    if name.is_empty() {
        t.error(format!("`{key}` is missing"), Some(help));
    } else if !nodes.contains(&name.as_str()) {
        t.error_at(key, format!("neither a reservoir nor a chamber is called `{name}`"), Some(help));
    }
    name
}

/// Puts the oil of lifters behind all other oil. Each is a valve's path and its lifter.
pub(super) fn add_oil(root: &TomlTable<'_>, oil: &mut OilSpec, lifters: &[(String, &LifterSpec)]) {
    for (valve, lifter) in lifters {
        let (chamber, passages) = lifter.oil_parts(valve);
        let nodes = || oil.chambers.iter().map(|c| &c.name).chain(oil.reservoirs.iter().map(|(name, _)| name));
        let is_taken = |name: &str| oil.passages.iter().any(|o| last_name(&o.path) == name);
        let mut names: Vec<&str> = passages.iter().map(|p| last_name(&p.path)).filter(|name| is_taken(name)).collect();
        names.extend(nodes().any(|name| *name == chamber.name).then_some(chamber.name.as_str()));
        for name in names {
            let title = format!("`{name}` is the name of a part of the lifter of `{valve}`");
            root.error(title, Some("rename the chamber, reservoir or passage of that name".into()));
        }
        oil.chambers.push(chamber);
        oil.passages.extend(passages);
    }
}

/// Numbers of chambers and passages of the largest island of each, with holes beside check valves.
pub(super) fn largest_island(oil: &OilSpec, hole_beside: impl Fn(&PassageSpec) -> bool) -> [usize; 2] {
    let end = |name: &String| match oil.chambers.iter().position(|c| c.name == *name) {
        Some(chamber) => PassageEnd::Chamber(chamber),
        None => PassageEnd::Reservoir(0),
    };
    let holed = oil.passages.iter().filter(|p| hole_beside(p));
    let ends: Vec<[PassageEnd; 2]> =
        oil.passages.iter().chain(holed).map(|p| [end(&p.ends[0]), end(&p.ends[1])]).collect();
    let all = islands(oil.chambers.len(), &ends);
    let most = |of: &dyn Fn(&crate::elements::hydraulics::Island) -> usize| all.iter().map(of).max().unwrap_or(0);
    [most(&|i| i.chambers.len()), most(&|i| i.passages.len())]
}

/// More chambers or passages that are joined than are computed.
pub(super) fn check_islands(root: &TomlTable<'_>, oil: &OilSpec) {
    let largest = largest_island(oil, |_| false);
    for (what, n, most) in [("chambers", largest[0], MAX_CHAMBERS), ("passages", largest[1], MAX_PASSAGES)] {
        if n > most {
            let help = "a reservoir in between parts them";
            root.error(format!("{n} {what} are joined: at most {most} are computed"), Some(help.into()));
        }
    }
}
