//! Bush chain: inner links of two plates pressed on two bushes, outer links of two plates pressed on two pins.
//!
//! The bushes belong to the inner links, so that a tooth always pushes on an inner link, at either of its ends. The
//! elongation of loaded joints therefore sets the bushes of an outer link further apart than those of an inner one, and
//! a bush chain has a half tooth order. A chain of cranked links, each with a bush in front and a pin behind, has none,
//! because all its links are equal. Plates have the contour of a stadium (two arcs about the joints, two straight
//! edges), so that a plate lies flat on a straight guide. Masses follow from the dimensions unless given: plates minus
//! their holes, tubes, full cylinders.

use super::super::Vec2;
use super::super::profile::{Element, Profile, ProfileError};
use super::LinkShape;
use std::f64::consts::PI;

/// Dimensions of a bush chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BushChain {
    /// Nominal pitch of the drive [m].
    pub pitch_m: f64,
    /// Bush outer diameter d_1 [m].
    pub bush_diameter_m: f64,
    /// Bush bore = pin diameter d_2, for the masses [m].
    pub pin_diameter_m: f64,
    /// Width between inner plates b_1 [m].
    pub inner_width_m: f64,
    pub plate_height_m: f64,
    pub plate_thickness_m: f64,
    pub density_kg_m3: f64,
    /// Cranked links: each carries the bush of its front joint.
    pub is_cranked: bool,
    pub inner: RowSpec,
    pub outer: RowSpec,
}

/// Values that may be set per row; None takes the nominal pitch, the computed mass and inertia.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RowSpec {
    pub pitch_m: Option<f64>,
    pub mass_kg: Option<f64>,
    pub inertia_kg_m2: Option<f64>,
}

impl BushChain {
    /// The two rows: inner first, outer second. A chain alternates them.
    pub fn rows(&self) -> Result<[LinkShape; 2], ProfileError> {
        Ok([self.row(true)?, self.row(false)?])
    }

    fn row(&self, inner: bool) -> Result<LinkShape, ProfileError> {
        let spec = if inner { self.inner } else { self.outer };
        let pitch_m = spec.pitch_m.unwrap_or(self.pitch_m);
        let end_radius = 0.5 * self.plate_height_m;
        let plate = stadium(pitch_m, end_radius)?;
        let bush_radius = 0.5 * self.bush_diameter_m;
        let pin_radius = 0.5 * self.pin_diameter_m;
        let lever = 0.5 * pitch_m;
        let has_bush = inner || self.is_cranked;
        let (mass, inertia) = if self.is_cranked {
            // A cranked link has the mean mass and inertia of the two rows.
            let [a, b] = [true, false].map(|inner| self.mass_and_inertia(&plate, lever, inner));
            (0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1))
        } else {
            self.mass_and_inertia(&plate, lever, inner)
        };
        let circle_radius = if has_bush { bush_radius } else { pin_radius };
        let circles = [(-lever, if self.is_cranked { pin_radius } else { circle_radius }), (lever, circle_radius)];
        Ok(LinkShape {
            name: if inner { "inner" } else { "outer" },
            pitch_m,
            plate,
            plate_end_radius_m: end_radius,
            bush_radius_m: has_bush.then_some(bush_radius),
            circles: circles.map(|(x, radius_m)| (Vec2::new(x, 0.0), radius_m)).to_vec(),
            mass_kg: spec.mass_kg.unwrap_or(mass),
            inertia_kg_m2: spec.inertia_kg_m2.unwrap_or(inertia),
        })
    }

    /// Mass and inertia of a link with two bushes, or with two pins [kg, kg m2].
    fn mass_and_inertia(&self, plate: &Profile, lever: f64, inner: bool) -> (f64, f64) {
        let (bush_radius, pin_radius) = (0.5 * self.bush_diameter_m, 0.5 * self.pin_diameter_m);
        let area = plate.area_properties();
        let plates_kg = 2.0 * self.plate_thickness_m * self.density_kg_m3;
        let hole_radius = if inner { bush_radius } else { pin_radius };
        let hole_area = PI * hole_radius * hole_radius;
        let hole_polar = hole_area * (0.5 * hole_radius * hole_radius + lever * lever);
        let mut mass = plates_kg * (area.area_m2 - 2.0 * hole_area);
        let mut inertia = plates_kg * (area.polar_moment_m4 - 2.0 * hole_polar);
        // Each joint carries a tube through both inner plates, or a pin through all four with some overhang.
        let (outside, bore, length) = if inner {
            (bush_radius, pin_radius, self.inner_width_m + 2.0 * self.plate_thickness_m)
        } else {
            (pin_radius, 0.0, self.inner_width_m + 4.5 * self.plate_thickness_m)
        };
        let tube = PI * (outside * outside - bore * bore) * length * self.density_kg_m3;
        mass += 2.0 * tube;
        inertia += 2.0 * tube * (0.5 * (outside * outside + bore * bore) + lever * lever);
        (mass, inertia)
    }
}

/// Two half circles about the joints and two straight edges, counterclockwise.
fn stadium(pitch_m: f64, radius_m: f64) -> Result<Profile, ProfileError> {
    let h = 0.5 * pitch_m;
    Profile::new(
        vec![
            Element::Line { start: Vec2::new(-h, -radius_m), end: Vec2::new(h, -radius_m) },
            Element::Arc { centre: Vec2::new(h, 0.0), radius_m, start_rad: -0.5 * PI, sweep_rad: PI },
            Element::Line { start: Vec2::new(h, radius_m), end: Vec2::new(-h, radius_m) },
            Element::Arc { centre: Vec2::new(-h, 0.0), radius_m, start_rad: 0.5 * PI, sweep_rad: PI },
        ],
        true,
    )
}
