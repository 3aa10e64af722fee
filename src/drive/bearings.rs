//! Bearings of a drive with links: their keys, units and ranges.
//!
//! ```text
//! [bearings.elastic.NAME]  body, mass_kg, direction_deg, stiffness_n_per_m, stiffness_across_n_per_m, damping_n_s_per_m,
//!                          damping_across_n_s_per_m                                       sprocket, shaft, guide or fixed rail
//! [bearings.plain.NAME]    body, mass_kg, diameter_mm, length_mm, clearance_um, viscosity_mpa_s      sprocket or shaft
//!                          (or viscosity_40_mm2_s, viscosity_100_mm2_s, temperature_c, density_kg_per_m3)
//! ```

use super::mechanism::read_viscosity;
use super::reader::TomlTable;
use super::{Drive, Effects, GuideSpec, RailSpec, ShaftSpec, SprocketDrive};
use crate::diag::last_name;
use crate::effects::bearing_clearance;
use crate::elements::plain_bearing::PlainBearing;
use crate::units::{DEG, MM, UM};

/// What lets a body give way in the plane.
#[derive(Clone, Debug, PartialEq)]
pub struct BearingSpec {
    /// Path in the file: `bearings.KIND.NAME`.
    pub path: String,
    /// What it carries.
    pub on: Carried,
    /// Mass that moves with the body [kg].
    pub mass_kg: f64,
    /// What holds it.
    pub law: BearingLaw,
}

/// Least clearance of a plain bearing, in files and with effects [m].
pub(super) const NARROWEST_FILM_M: f64 = 0.1 * UM;

impl BearingSpec {
    /// A plain bearing with what effects change about it; None: it is none.
    pub fn film(&self, effects: &Effects) -> Option<PlainBearing> {
        match &self.law {
            BearingLaw::Plain(bearing) => {
                let wider_m = effects.of_part(&bearing_clearance::ROW, last_name(&self.path));
                Some(PlainBearing { clearance_m: (bearing.clearance_m + wider_m).max(NARROWEST_FILM_M), ..*bearing })
            }
            BearingLaw::Elastic { .. } => None,
        }
    }
}

/// What a bearing carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carried {
    /// The sprocket with this index, on no shaft.
    Sprocket(usize),
    /// All sprockets of the shaft with this index.
    Shaft(usize),
    /// The straight guide with this index.
    Guide(usize),
    /// The fixed rail with this index.
    Rail(usize),
}

/// What holds a body on a bearing.
#[derive(Clone, Debug, PartialEq)]
pub enum BearingLaw {
    /// Springs and dampers in two directions.
    Elastic {
        /// The first of them, counterclockwise from +x; the other is a right angle ahead [rad].
        direction_rad: f64,
        /// Along it and across it [N/m].
        stiffness_n_per_m: [f64; 2],
        /// Along it and across it [N s/m].
        damping_n_s_per_m: [f64; 2],
    },
    /// A film of oil.
    Plain(PlainBearing),
}

/// Names of all that bearings carry.
pub(super) struct CarriedNames<'a> {
    pub(super) sprockets: &'a [SprocketDrive],
    pub(super) shafts: &'a [ShaftSpec],
    pub(super) guides: &'a [GuideSpec],
    pub(super) rails: &'a [RailSpec],
}

impl CarriedNames<'_> {
    fn find(&self, name: &str) -> Option<Carried> {
        let shaft = self.shafts.iter().position(|s| s.name == name).map(Carried::Shaft);
        let sprocket = || self.sprockets.iter().position(|s| s.name == name).map(Carried::Sprocket);
        let guide = || self.guides.iter().position(|g| g.name == name).map(Carried::Guide);
        let rail = || self.rails.iter().position(|r| r.name == name).map(Carried::Rail);
        shaft.or_else(sprocket).or_else(guide).or_else(rail)
    }

    fn all(&self) -> String {
        let names = self.sprockets.iter().map(|s| &s.name).chain(self.shafts.iter().map(|s| &s.name));
        let guides = self.guides.iter().map(|g| &g.name).chain(self.rails.iter().map(|r| &r.name));
        names.chain(guides).cloned().collect::<Vec<_>>().join(", ")
    }

    /// What `name` means; errors of `t` where it cannot be carried.
    fn required(&self, t: &TomlTable<'_>, name: &str) -> Carried {
        let Some(on) = self.find(name) else {
            let help = format!("there are: {}", self.all());
            t.error(format!("no sprocket, shaft, guide or rail is called `{name}`"), Some(help));
            return Carried::Sprocket(0);
        };
        match on {
            Carried::Sprocket(k) => {
                if let Some(shaft) = self.sprockets[k].shaft {
                    let help = format!("write `body = \"{}\"`", self.shafts[shaft].name);
                    t.error(format!("sprocket `{name}` sits on a shaft"), Some(help));
                }
            }
            Carried::Shaft(k) => {
                if self.sprockets.iter().all(|s| s.shaft != Some(k)) {
                    let help = "name a shaft that carries a sprocket".to_string();
                    t.error(format!("no sprocket sits on shaft `{name}`"), Some(help));
                }
            }
            Carried::Guide(_) => {}
            Carried::Rail(k) => {
                if self.rails[k].arm.is_some() {
                    t.error(format!("rail `{name}` turns with an arm"), Some("name a rail without an arm".into()));
                }
                if self.rails[k].bending.is_some() {
                    let help = "hold it softly by `springs_mm` of its bending".to_string();
                    t.error(format!("rail `{name}` bends, and stands on its supports"), Some(help));
                }
            }
        }
        on
    }
}

/// `[bearings]`.
pub(super) fn read_bearings(root: &TomlTable<'_>, names: &CarriedNames<'_>) -> Vec<BearingSpec> {
    let table = root.table("bearings");
    let mut all: Vec<BearingSpec> = Vec::new();
    for kind in ["elastic", "plain"] {
        let of_kind = table.table(kind);
        for (name, t) in of_kind.tables() {
            let on = names.required(&t, &t.text("body").unwrap_or(name));
            if all.iter().any(|b| b.on == on) {
                t.error("the body has a bearing already".into(), Some("keep one of them".into()));
            }
            let mass_kg = t.required("mass_kg", 1.0, 1e-4..=1e4);
            let law = if kind == "elastic" { read_elastic(&t) } else { read_plain(&t, on) };
            all.push(BearingSpec { path: t.path().to_string(), on, mass_kg, law });
            t.finish();
        }
        of_kind.finish();
    }
    table.finish();
    all
}

fn read_elastic(t: &TomlTable<'_>) -> BearingLaw {
    let stiffness = t.required("stiffness_n_per_m", 1.0, 1e3..=1e12);
    let damping = t.number("damping_n_s_per_m", 1.0, 0.0..=1e9).unwrap_or(0.0);
    BearingLaw::Elastic {
        direction_rad: t.number("direction_deg", DEG, -360.0..=360.0).unwrap_or(0.0),
        stiffness_n_per_m: [stiffness, t.number("stiffness_across_n_per_m", 1.0, 1e3..=1e12).unwrap_or(stiffness)],
        damping_n_s_per_m: [damping, t.number("damping_across_n_s_per_m", 1.0, 0.0..=1e9).unwrap_or(damping)],
    }
}

fn read_plain(t: &TomlTable<'_>, on: Carried) -> BearingLaw {
    if let Carried::Guide(_) | Carried::Rail(_) = on {
        t.error("a plain bearing carries what turns".into(), Some("hold the rail by `[bearings.elastic.NAME]`".into()));
    }
    let radius_m = t.required("diameter_mm", 0.5 * MM, 0.5..=1e4);
    let clearance_m = t.required("clearance_um", UM, 0.1..=1e4);
    if clearance_m >= radius_m {
        t.error_at("clearance_um", "the clearance is larger than the journal".into(), None);
    }
    BearingLaw::Plain(PlainBearing {
        radius_m,
        length_m: t.required("length_mm", MM, 0.1..=1e4),
        clearance_m,
        viscosity_pa_s: read_viscosity(t, || t.required("density_kg_per_m3", 1.0, 300.0..=3000.0)),
    })
}

impl Drive {
    /// Bearings of one chain of several: of its sprockets, of shafts that carry one of them, of its guides and rails, which `guide` and `rail` number anew.
    pub(super) fn bearings_of(
        &self,
        own: &std::ops::Range<usize>,
        guide: impl Fn(usize) -> Option<usize>,
        rail: impl Fn(usize) -> Option<usize>,
    ) -> Vec<BearingSpec> {
        let on = |carried: Carried| match carried {
            Carried::Sprocket(k) => own.contains(&k).then(|| Carried::Sprocket(k - own.start)),
            Carried::Shaft(k) => self.sprockets[own.clone()].iter().any(|s| s.shaft == Some(k)).then_some(carried),
            Carried::Guide(k) => guide(k).map(Carried::Guide),
            Carried::Rail(k) => rail(k).map(Carried::Rail),
        };
        self.bearings.iter().filter_map(|b| Some(BearingSpec { on: on(b.on)?, ..b.clone() })).collect()
    }

    /// Whether the sprocket with this index is on the bearing.
    pub fn is_on_bearing(&self, bearing: &BearingSpec, sprocket: usize) -> bool {
        match bearing.on {
            Carried::Sprocket(k) => k == sprocket,
            Carried::Shaft(k) => self.sprockets[sprocket].shaft == Some(k),
            Carried::Guide(_) | Carried::Rail(_) => false,
        }
    }
}
