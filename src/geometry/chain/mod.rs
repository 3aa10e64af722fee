//! Chain types: each is a function that returns its links.

pub mod abutment;
pub mod bush;
pub mod silent;

use super::Vec2;
use super::profile::Profile;

/// A roller that turns on a bush, with play.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollerShape {
    /// Outside radius [m].
    pub radius_m: f64,
    /// Outside radius of the bush that it turns on [m].
    pub bush_radius_m: f64,
    /// Radius of its bore less that of the bush [m].
    pub clearance_m: f64,
    pub mass_kg: f64,
    /// About its axis [kg m2].
    pub inertia_kg_m2: f64,
}

/// A row of links: all links of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkShape {
    /// `inner` or `outer`; `even` or `odd` if the rows are alike.
    pub name: &'static str,
    /// Distance of the two joints, unloaded [m]. Joints are at (-pitch/2, 0) and (+pitch/2, 0).
    pub pitch_m: f64,
    /// Contour of the plates.
    pub plate: Profile,
    /// Radius of the plate ends about the joints [m], which slide on guides.
    pub plate_end_radius_m: f64,
    /// Radius of bushes or rollers that this link carries around its joints; they contact the teeth.
    pub bush_radius_m: Option<f64>,
    /// Rollers on those bushes that are bodies of their own; then the radius above is theirs.
    pub roller: Option<RollerShape>,
    /// Circles drawn with the link (bushes, pins): centre and radius [m].
    pub circles: Vec<(Vec2, f64)>,
    pub mass_kg: f64,
    /// About the centre of mass, which is midway between the joints [kg m2].
    pub inertia_kg_m2: f64,
}
