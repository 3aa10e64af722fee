//! Bush chain: inner links of two plates pressed on two bushes, outer links of two plates pressed on two pins.
//!
//! The bushes belong to the inner links, so that a tooth always pushes on an inner link, at either of its ends. The
//! elongation of loaded joints therefore sets the bushes of an outer link further apart than those of an inner one, and
//! a bush chain has a half tooth order. A chain of cranked links, each with a bush in front and a pin behind, has none,
//! because all its links are equal. Plates have the contour of a stadium (two arcs about the joints, two straight
//! edges), so that a plate lies flat on a straight guide. Masses follow from the dimensions unless given: plates minus
//! their holes, tubes, full cylinders.
//!
//! A roller chain has a roller on every bush, which the teeth touch. Rollers are bodies of their own, with play, mass and spin, or parts of the
//! links that carry them: then their mass sits in the joints, and their spin has no inertia.

use super::super::Vec2;
use super::super::profile::{Element, Profile, ProfileError};
use super::{LinkShape, RollerShape};
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
    /// Rollers on the bushes; None: the bushes themselves seat in the teeth.
    pub rollers: Option<RollerSpec>,
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

/// Rollers of a roller chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollerSpec {
    /// Outside diameter d_1 [m].
    pub diameter_m: f64,
    /// Radius of the bore less that of the bush [m].
    pub clearance_m: f64,
    /// None: of a tube as long as the inner plates are apart.
    pub mass_kg: Option<f64>,
    /// None: of that tube with this mass [kg m2].
    pub inertia_kg_m2: Option<f64>,
    /// Bodies of their own; otherwise parts of the links that carry them.
    pub is_separate: bool,
}

impl BushChain {
    /// Diameter of what the teeth seat: of the rollers, or of the bushes where there are none [m].
    pub fn seated_diameter_m(&self) -> f64 {
        self.rollers.map_or(self.bush_diameter_m, |r| r.diameter_m)
    }

    /// The rollers with their masses.
    pub fn roller(&self) -> Option<RollerShape> {
        let spec = self.rollers?;
        let (radius_m, bush_radius_m) = (0.5 * spec.diameter_m, 0.5 * self.bush_diameter_m);
        let bore_m = bush_radius_m + spec.clearance_m;
        let tube_kg = PI * (radius_m * radius_m - bore_m * bore_m) * self.inner_width_m * self.density_kg_m3;
        let mass_kg = spec.mass_kg.unwrap_or(tube_kg);
        let tube_kg_m2 = 0.5 * mass_kg * (radius_m * radius_m + bore_m * bore_m);
        let inertia_kg_m2 = spec.inertia_kg_m2.unwrap_or(tube_kg_m2);
        Some(RollerShape { radius_m, bush_radius_m, clearance_m: spec.clearance_m, mass_kg, inertia_kg_m2 })
    }

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
        let roller = self.roller().filter(|_| has_bush);
        let separate = roller.filter(|_| self.rollers.is_some_and(|r| r.is_separate));
        let (mass, inertia) = if self.is_cranked {
            // A cranked link has the mean mass and inertia of the two rows.
            let [a, b] = [true, false].map(|inner| self.mass_and_inertia(&plate, lever, inner));
            (0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1))
        } else {
            self.mass_and_inertia(&plate, lever, inner)
        };
        let circle_radius = if has_bush { bush_radius } else { pin_radius };
        let circles = [(-lever, if self.is_cranked { pin_radius } else { circle_radius }), (lever, circle_radius)];
        let (mut mass_kg, mut inertia_kg_m2) = (spec.mass_kg.unwrap_or(mass), spec.inertia_kg_m2.unwrap_or(inertia));
        if let Some(r) = roller.filter(|_| separate.is_none()) {
            let in_joints_kg = r.mass_kg * if self.is_cranked { 1.0 } else { 2.0 };
            mass_kg += in_joints_kg;
            inertia_kg_m2 += in_joints_kg * lever * lever;
        }
        Ok(LinkShape {
            name: if inner { "inner" } else { "outer" },
            pitch_m,
            plate,
            plate_end_radius_m: end_radius,
            bush_radius_m: has_bush.then_some(roller.map_or(bush_radius, |r| r.radius_m)),
            roller: separate,
            circles: circles.map(|(x, radius_m)| (Vec2::new(x, 0.0), radius_m)).to_vec(),
            mass_kg,
            inertia_kg_m2,
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
