//! Profiles: teeth, links, abutments and rings of one chain as the drawing has them, wherever the sprockets stand.

use super::Toothing;
use crate::diag::{Diag, Report};
use crate::drive::{ChainSpec, Drive, FaceForm, RingForm, SprocketDrive};
use crate::geometry::chain::LinkShape;
use crate::geometry::chain::silent::SilentLinkError;
use crate::geometry::silent_sprocket::{SilentSprocket, SilentSprocketError, SilentSprocketSpec, ToothFace};
use crate::geometry::smartchain::{Abutment, LobedRing, RingError, fits_hollow};
use crate::geometry::sprocket::{Sprocket, SprocketSpec};
use crate::pairs::contour_body::LinkContour;

#[doc(hidden)]
/// Profiles of a drive's parts, without defects of single gaps.
#[derive(Clone, Debug)]
pub struct Profiles {
    pub sprockets: Vec<Toothing>,
    pub rows: Vec<LinkShape>,
    pub contour: Option<LinkContour>,
    /// Both abutments of a link; None: the chain has none.
    pub abutment: Option<Abutment>,
    /// Per sprocket of an abutment chain; None: a circle.
    pub rings: Vec<Option<LobedRing>>,
    /// See [`super::Model::line_end_m`].
    pub line_end_m: Vec<f64>,
    /// Distance of each sprocket's axis from the line on which the chain runs up to it [m].
    pub line_radii_m: Vec<f64>,
}

impl Profiles {
    /// Computes them.
    ///
    /// # Errors
    /// A part cannot be made.
    pub fn new(drive: &Drive) -> Result<Profiles, Report> {
        let sprockets = toothings(drive)?;
        let chain_error = |text: String, help: Option<String>| {
            drive.places.report(vec![drive.places.error(drive.chain.path(), text, help)])
        };
        let mut rings = vec![None; sprockets.len()];
        let mut abutment = None;
        let mut contour = None;
        let mut line_end_m = vec![0.0; sprockets.len()];
        let mut line_radii_m: Vec<f64> = sprockets.iter().map(Toothing::pitch_radius_m).collect();
        let rows: Vec<LinkShape> = match &drive.chain {
            ChainSpec::Bush(c) => {
                let rows = c.rows().map_err(|e| chain_error(format!("the link plates cannot be made: {e}"), None))?;
                if !rows.iter().all(|r| r.mass_kg > 0.0 && r.inertia_kg_m2 > 0.0) {
                    let help = "make the bores smaller, or give the rows their `mass_g` and `inertia_g_mm2`";
                    return Err(chain_error(
                        "the links have no mass left beside their bores".into(),
                        Some(help.into()),
                    ));
                }
                rows.to_vec()
            }
            ChainSpec::Silent(c) => {
                let links = c.rows().map_err(|e| chain_error(format!("the links cannot be made: {e}"), None))?;
                contour = Some(LinkContour::Flanks(links.iter().map(|l| l.contour).collect()));
                links.into_iter().map(|l| l.shape).collect()
            }
            ChainSpec::Abutment(c) => {
                let made = |e: &dyn std::fmt::Display| chain_error(format!("the abutments cannot be made: {e}"), None);
                let transition = |teeth: u32| c.transition(teeth).map_err(|e| made(&e));
                let a = Abutment::new(transition(c.teeth)?, c.abutment_spec()).map_err(|e| made(&e))?;
                let ring_error = |e: &RingError, name: &str, help: Option<String>| {
                    chain_error(format!("the ring of sprocket `{name}` cannot be made: {e}"), help)
                };
                for (k, s) in drive.sprockets.iter().enumerate() {
                    let own = if s.teeth == c.teeth { a.transition } else { transition(s.teeth)? };
                    line_radii_m[k] = own.line_height_m;
                    line_end_m[k] = own.line_end_x_m;
                    if s.teeth != c.teeth && s.ring == RingForm::Conjugate {
                        let help = format!("`sprockets.{}.ring = \"plain\"` gives it a round one, at a cost", s.name);
                        rings[k] = Some(LobedRing::new(&a, own).map_err(|e| ring_error(&e, &s.name, Some(help)))?);
                    } else {
                        fits_hollow(&a, own.pitch_radius_m - c.abutment_distance_m)
                            .map_err(|e| ring_error(&e, &s.name, None))?;
                    }
                }
                let rows = c.rows(drive.joint.stiffness_n_per_m, &a.front, &a.rear).map_err(|e| made(&e))?;
                contour = Some(LinkContour::Abutments { front: a.front.clone(), rear: a.rear.clone() });
                abutment = Some(a);
                rows.to_vec()
            }
        };
        Ok(Profiles { sprockets, rows, contour, abutment, rings, line_end_m, line_radii_m })
    }

    /// Whether two drives have the same profiles: what is drawn of chain and sprockets is the same.
    pub fn are_shared(one: &Drive, other: &Drive) -> bool {
        let is_drawn_alike = |(a, b): (&SprocketDrive, &SprocketDrive)| {
            let drawn = |s: &SprocketDrive| {
                (
                    s.teeth,
                    s.form,
                    s.tip_diameter_m,
                    s.root_relief_m,
                    s.ring,
                    s.face,
                    s.root_clearance_m,
                    s.corner_radius_m,
                )
            };
            drawn(a) == drawn(b)
        };
        one.chain == other.chain
            && one.joint.stiffness_n_per_m == other.joint.stiffness_n_per_m
            && one.sprockets.len() == other.sprockets.len()
            && one.sprockets.iter().zip(&other.sprockets).all(is_drawn_alike)
    }
}

/// Teeth of all sprockets.
fn toothings(drive: &Drive) -> Result<Vec<Toothing>, Report> {
    let mut diags = Vec::new();
    let mut sprockets = Vec::new();
    for s in &drive.sprockets {
        match toothing(drive, s) {
            Ok(toothing) => sprockets.push(toothing),
            Err((e, key)) => {
                // What is wrong with the link is so for every sprocket.
                let (path, title) = if key.contains('.') {
                    (key.to_string(), e)
                } else {
                    (format!("sprockets.{}.{key}", s.name), format!("sprocket `{}` cannot be made: {e}", s.name))
                };
                if diags.iter().all(|d: &Diag| d.title != title) {
                    diags.push(drive.places.error(&path, title, None));
                }
            }
        }
    }
    if !diags.is_empty() {
        return Err(drive.places.report(diags));
    }
    Ok(sprockets)
}

/// Teeth of a sprocket, or why there are none and the key to blame.
fn toothing(drive: &Drive, s: &SprocketDrive) -> Result<Toothing, (String, &'static str)> {
    if let ChainSpec::Silent(c) = &drive.chain {
        let face = match s.face {
            FaceForm::Arc => ToothFace::Arc,
            FaceForm::Crowned { radius_m, contact_distance_m } => ToothFace::Crowned { radius_m, contact_distance_m },
        };
        let mut spec = SilentSprocketSpec::standard(s.teeth, c.pitch_m, face);
        spec.link = c.form;
        if let Some(tip_m) = s.tip_diameter_m {
            let half_rad = std::f64::consts::PI / f64::from(s.teeth);
            let (sin, cos) = crate::units::sin_cos(half_rad);
            spec.tip_offset_m = 0.5 * tip_m - 0.5 * c.pitch_m * cos / sin;
        }
        spec.root_clearance_m = s.root_clearance_m.unwrap_or(spec.root_clearance_m);
        spec.corner_radius_m = s.corner_radius_m.unwrap_or(spec.corner_radius_m);
        return match SilentSprocket::new(spec) {
            Ok(sprocket) => Ok(Toothing::Silent(Box::new(sprocket))),
            Err(e) => Err((e.to_string(), silent_key(&e))),
        };
    }
    let key = if s.tip_diameter_m.is_some() { "tip_diameter_mm" } else { "teeth" };
    let spec = SprocketSpec {
        teeth: s.teeth,
        pitch_m: drive.chain.pitch_m(),
        roller_diameter_m: drive.chain.bush_diameter_m(),
        form: s.form,
        tip_diameter_m: s.tip_diameter_m,
    };
    let sprocket = Sprocket::new(spec).map_err(|e| (e.to_string(), key))?;
    let relieved = sprocket.relieved(s.root_relief_m).map_err(|e| (e.to_string(), "root_relief_um"))?;
    Ok(Toothing::Iso(Box::new(relieved)))
}

/// The value to blame: of the sprocket, or of the link that it is made for.
fn silent_key(e: &SilentSprocketError) -> &'static str {
    match e {
        SilentSprocketError::Pointed { .. } | SilentSprocketError::LowTip { .. } => "tip_diameter_mm",
        SilentSprocketError::DeepRoot { .. } | SilentSprocketError::HighRoot | SilentSprocketError::Toe { .. } => {
            "root_clearance_mm"
        }
        SilentSprocketError::Face { .. } => "chain.silent.face_distance_mm",
        SilentSprocketError::Corner { .. } => "corner_radius_mm",
        SilentSprocketError::Contact { .. } => "contact_distance_mm",
        SilentSprocketError::Link(e) => match e {
            SilentLinkError::FlankAngle { .. } => "chain.silent.flank_angle_deg",
            SilentLinkError::Projection { .. } => "chain.silent.inside_projection_mm",
            SilentLinkError::ToeRadius { .. } => "chain.silent.toe_radius_mm",
            SilentLinkError::CrotchLarge { .. } | SilentLinkError::CrotchDeep { .. } => "chain.silent.crotch_radius_mm",
            SilentLinkError::Dimension { .. }
            | SilentLinkError::FlankPitch { .. }
            | SilentLinkError::PinHole { .. }
            | SilentLinkError::Kink { .. }
            | SilentLinkError::Profile(_) => "chain.silent",
        },
        SilentSprocketError::Teeth { .. } | SilentSprocketError::Dimension { .. } => "teeth",
    }
}
