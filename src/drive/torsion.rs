//! Elastic shafts of a drive with links, as camshafts are: their keys, units and ranges.
//!
//! ```text
//! [elastic_shafts.NAME]  body, length_mm, diameter_mm, bore_mm, shear_modulus_gpa, density_kg_per_m3, added_inertia_kg_m2, modes, damping_percent
//! ```

use super::SprocketDrive;
use super::reader::TomlTable;
use super::shafts::{Moving, MovingNames};
use crate::elements::torsion::{MAX_TORSION_MODES, UniformShaft};
use crate::units::MM;
use std::f64::consts::PI;

/// A shaft that twists.
#[derive(Clone, Debug, PartialEq)]
pub struct ElasticShaftSpec {
    /// Last part of its path in the file: `elastic_shafts.NAME`.
    pub name: String,
    /// The sprocket, or shaft, that one end turns with.
    pub body: Moving,
    /// A sprocket on that body; None: none is.
    pub sprocket: Option<usize>,
    /// The shaft itself: its stiffness, its inertia and its modes.
    pub shaft: UniformShaft,
}

impl ElasticShaftSpec {
    /// Paths of its modes, which turn.
    pub fn mode_paths(&self) -> impl Iterator<Item = String> + '_ {
        (1..=self.shaft.modes).map(|i| format!("elastic_shafts.{}.mode.{i}", self.name))
    }
}

/// Modes where their number is not given. assumed: the first frequency is then right to 4e-5 on a body with twice the shaft's inertia, to 3e-3 by itself.
const MODES: i64 = 3;
/// Steel.
const SHEAR_MODULUS_PA: f64 = 79.3e9;
const DENSITY_KG_PER_M3: f64 = 7850.0;

/// `[elastic_shafts.NAME]`.
pub(super) fn read_elastic_shafts(root: &TomlTable<'_>, names: &MovingNames<'_>) -> Vec<ElasticShaftSpec> {
    let table = root.table("elastic_shafts");
    let mut all: Vec<ElasticShaftSpec> = Vec::new();
    for (name, t) in table.tables() {
        if names.find(&name).is_some() {
            t.error(format!("something else that moves is called `{name}`"), Some("take another name".into()));
        }
        let body = match t.text("body") {
            Some(body) => names.required(&t, &body),
            None => {
                t.error(format!("nothing turns `{name}`"), Some("name a sprocket or a shaft as `body`".into()));
                Moving::Sprocket(0)
            }
        };
        if matches!(body, Moving::Arm(_) | Moving::Slider(_)) {
            t.error_at("body", "an elastic shaft turns with a sprocket or a shaft".into(), None);
        }
        let length_m = t.required("length_mm", MM, 1.0..=1e5);
        let diameter_m = t.required("diameter_mm", MM, 0.1..=1e4);
        let bore_m = t.number("bore_mm", MM, 0.0..=1e4).unwrap_or(0.0);
        if bore_m >= diameter_m {
            t.error_at("bore_mm", "the bore is as wide as the shaft".into(), Some("give a smaller one".into()));
        }
        let modulus_pa = t.number("shear_modulus_gpa", 1e9, 1e-3..=1e3).unwrap_or(SHEAR_MODULUS_PA);
        let density = t.number("density_kg_per_m3", 1.0, 100.0..=30_000.0).unwrap_or(DENSITY_KG_PER_M3);
        let added_kg_m2 = t.number("added_inertia_kg_m2", 1.0, 0.0..=1e6).unwrap_or(0.0);
        let polar_m4 = PI / 32.0 * (diameter_m.powi(4) - bore_m.powi(4));
        let shaft = UniformShaft {
            length_m,
            stiffness_n_m2: modulus_pa * polar_m4,
            inertia_kg_m2: density * polar_m4 * length_m + added_kg_m2,
            modes: t.integer("modes", 1..=MAX_TORSION_MODES as i64).unwrap_or(MODES) as usize,
            damping_ratio: t.number("damping_percent", 1e-2, 0.0..=100.0).unwrap_or(0.01),
        };
        let sprocket = sprocket_on(body, names.sprockets);
        all.push(ElasticShaftSpec { name, body, sprocket, shaft });
        t.finish();
    }
    table.finish();
    all
}

fn sprocket_on(body: Moving, sprockets: &[SprocketDrive]) -> Option<usize> {
    match body {
        Moving::Sprocket(k) => Some(k),
        Moving::Shaft(shaft) => sprockets.iter().position(|s| s.shaft == Some(shaft)),
        Moving::Arm(_) | Moving::Slider(_) => None,
    }
}
