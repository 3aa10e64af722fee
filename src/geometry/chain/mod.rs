//! Chain types: each is a function that returns its links.

pub mod abutment;
pub mod bush;
pub mod silent;

use super::Vec2;
use super::profile::Profile;

/// A row of links: all links of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkShape {
    /// `inner` or `outer`; `even` or `odd` where the rows are alike.
    pub name: &'static str,
    /// Distance of the two joints, unloaded [m]. Joints sit at (-pitch/2, 0) and (+pitch/2, 0).
    pub pitch_m: f64,
    /// Contour of the plates.
    pub plate: Profile,
    /// Radius of the plate ends about the joints [m]: what slides on guides.
    pub plate_end_radius_m: f64,
    /// Bushes or rollers that this link carries round its joints; they touch the teeth.
    pub bush_radius_m: Option<f64>,
    /// Circles drawn with the link (bushes, pins): centre and radius [m].
    pub circles: Vec<(Vec2, f64)>,
    pub mass_kg: f64,
    /// About the centre of mass, which is midway between the joints [kg m2].
    pub inertia_kg_m2: f64,
}
