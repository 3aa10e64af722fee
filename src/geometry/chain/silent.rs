//! Silent (inverted-tooth) chain with one round pin per joint: links of plates whose outer flanks seat on the teeth.
//!
//! Both ends of a link are mirror images. An end is constructed about its virtual eye E = (+-h, 0), h half the flank
//! pitch; the joints lie at (+-p/2, 0), p the pin pitch. Nominal links have h = p/2; the two are separate because the
//! pitch of the working flanks and the pitch of the pins of a row have different errors. Frame of the link: origin
//! midway between the joints, +x along the travel, +y to its left, where the sprockets are, so that the teeth point to
//! +y. Front end, alpha the flank angle, s = sin alpha, c = cos alpha, f and f_i = f + lambda the distances of the
//! flanks from E:
//!
//! ```text
//! eye arc       about E, radius f, from the back line y = -f to the flank
//! outer flank   E + f (c, s) + u (-s, c),      u = 0 ..= s_o
//! toe arc       about E + (o_x, D), radius r_t  o_x = (f - f_i) / 2c     D = (f + f_i - 2 r_t) / 2s
//! inner flank   E + f_i (-c, s) + u (s, c),    u = s_i0 ..= s_i
//! crotch arc    about (0, -y_c), radius r_c     y_c = (h c - f_i - r_c) / s
//! s_o = c D - s o_x     s_i = c D + s o_x     s_i0 = -h s - c y_c
//! ```
//! All transitions between elements are C1. lambda < 0: the outer flanks mesh; lambda > 0: the inner flank of a link
//! projects beyond the outer flank of the link ahead and contacts the tooth first. Heights that are given by one number
//! (y_c, crotch top, toe low) count outwards from the pin line, away from the sprocket: they are -y.
//! Source: derived here; the link need only hold its joints on the pitch line of the sprocket (ASME B29.2M),
//! proportions f = 0.375 p after its over-pin formulas as remembered (assumed), range of lambda after US 8,628,440.

use super::super::Vec2;
use super::super::profile::{Element, Profile, ProfileError};
use super::LinkShape;
use crate::units::{DEG, MM, sin_cos};
use std::f64::consts::PI;

/// Accepted flank angles [rad]. assumed: papers and patents stay within 20 to 35 deg.
const FLANK_ANGLE_RANGE_RAD: (f64, f64) = (10.0 * DEG, 45.0 * DEG);
/// Accepted lambda / p. Upper end: US 8,628,440 (0.007 to 0.017 for inside meshing). Lower end assumed.
const PROJECTION_RANGE: (f64, f64) = (-0.125, 0.017);
/// Largest difference of flank pitch and pin pitch, over p. assumed: tolerances are a tenth of that.
const FLANK_PITCH_RANGE: f64 = 0.02;
/// Minimum material around a pin hole, over p. assumed: thinner walls cannot be stamped.
const MIN_WALL: f64 = 0.02;

/// Proportions of the contour, the same for all links of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentLinkForm {
    /// alpha, of both flanks to the normal of the pin line [rad].
    pub flank_angle_rad: f64,
    /// f, distance of the outer flank, the eye arc and the back line from the virtual eye [m].
    pub face_distance_m: f64,
    /// lambda = f_i - f: projection of the inner flank beyond the outer flank of the link ahead in a straight chain
    /// [m].
    pub inside_projection_m: f64,
    /// r_t [m].
    pub toe_radius_m: f64,
    /// r_c [m].
    pub crotch_radius_m: f64,
}

impl SilentLinkForm {
    /// alpha = 30 deg, f = 0.375 p, lambda = -0.0625 p, r_t = 0.1 p, r_c = 0.15 p.
    pub fn standard(pitch_m: f64) -> SilentLinkForm {
        SilentLinkForm {
            flank_angle_rad: 30.0 * DEG,
            face_distance_m: 0.375 * pitch_m,
            inside_projection_m: -0.0625 * pitch_m,
            toe_radius_m: 0.1 * pitch_m,
            crotch_radius_m: 0.15 * pitch_m,
        }
    }

    /// f_i [m].
    pub fn inner_face_distance_m(&self) -> f64 {
        self.face_distance_m + self.inside_projection_m
    }

    /// o_x: offset of the toe arc's centre beyond the eye, away from the middle of the link [m].
    pub fn toe_offset_m(&self) -> f64 {
        -0.5 * self.inside_projection_m / sin_cos(self.flank_angle_rad).1
    }

    /// D: distance of the centre of the toe arc from the pin line, towards the sprocket [m].
    pub fn toe_depth_m(&self) -> f64 {
        let faces_m = self.face_distance_m + self.inner_face_distance_m();
        0.5 * (faces_m - 2.0 * self.toe_radius_m) / sin_cos(self.flank_angle_rad).0
    }
}

/// Dimensions of a silent chain. Even and odd links alternate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentChain {
    /// Nominal pitch of the drive [m].
    pub pitch_m: f64,
    pub form: SilentLinkForm,
    /// Pin = bore of the plates, for the masses [m].
    pub pin_diameter_m: f64,
    /// Over both rows and the heads [m].
    pub pin_length_m: f64,
    /// Sum of the thicknesses of the plates of one row [m].
    pub pack_thickness_m: f64,
    pub density_kg_m3: f64,
    pub even: SilentRowSpec,
    pub odd: SilentRowSpec,
}

/// Values that may be set per row; None takes the nominal pitch, the computed mass and inertia.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SilentRowSpec {
    /// Distance of the joints [m].
    pub pin_pitch_m: Option<f64>,
    /// 2 h, distance of the virtual eyes from which the contour is constructed [m].
    pub flank_pitch_m: Option<f64>,
    pub mass_kg: Option<f64>,
    pub inertia_kg_m2: Option<f64>,
}

/// A link of one row.
#[derive(Clone, Debug, PartialEq)]
pub struct SilentLink {
    pub shape: LinkShape,
    pub contour: SilentLinkContour,
    /// Offset of the centre of mass of plates and pins from the pin line towards +y [m]; the shape, like every link,
    /// has it on the pin line.
    pub centre_of_mass_m: f64,
}

/// A straight flank in the frame of the link, in the direction of travel of the outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flank {
    pub start: Vec2,
    pub end: Vec2,
    /// Outward.
    pub normal: Vec2,
}

impl Flank {
    pub fn element(&self) -> Element {
        Element::Line { start: self.start, end: self.end }
    }
}

/// An arc in the frame of the link. The outward normal of a convex arc at `angle` is the unit vector at `angle`, that
/// of a concave arc its opposite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentArc {
    pub centre: Vec2,
    pub radius_m: f64,
    pub start_rad: f64,
    /// Negative for a concave arc.
    pub sweep_rad: f64,
}

impl SilentArc {
    pub fn element(&self) -> Element {
        let SilentArc { centre, radius_m, start_rad, sweep_rad } = *self;
        Element::Arc { centre, radius_m, start_rad, sweep_rad }
    }
}

/// The contact features of one end of a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkEnd {
    /// E, the virtual eye.
    pub eye_centre: Vec2,
    pub eye: SilentArc,
    pub outer_flank: Flank,
    pub toe: SilentArc,
    pub inner_flank: Flank,
}

/// The contour of a link and its contact features, in the frame of the link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentLinkContour {
    pub form: SilentLinkForm,
    pub pin_pitch_m: f64,
    /// 2 h [m].
    pub flank_pitch_m: f64,
    /// s_o [m].
    pub outer_flank_length_m: f64,
    /// s_i0, from the foot of the eye's perpendicular towards the toe [m].
    pub inner_flank_start_m: f64,
    /// s_i [m].
    pub inner_flank_end_m: f64,
    /// y_c, outwards from the pin line [m].
    pub crotch_centre_m: f64,
    /// The end towards +x, leading.
    pub front: LinkEnd,
    /// The end towards -x, trailing.
    pub rear: LinkEnd,
    pub crotch: SilentArc,
}

/// Parts of the outline, in its order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkPart {
    Back,
    FrontEye,
    FrontOuterFlank,
    FrontToe,
    FrontInnerFlank,
    Crotch,
    RearInnerFlank,
    RearToe,
    RearOuterFlank,
    RearEye,
}

/// Why no link can be made, each with a value that would work.
#[derive(Clone, Debug, PartialEq)]
pub enum SilentLinkError {
    /// A dimension that is not a positive number.
    Dimension {
        name: &'static str,
        value_m: f64,
    },
    FlankAngle {
        angle_rad: f64,
    },
    /// lambda outside the range [m].
    Projection {
        least_m: f64,
        largest_m: f64,
    },
    /// Toe arc larger than the space between the flanks.
    ToeRadius {
        largest_m: f64,
    },
    /// The crotch arc leaves no inner flank.
    CrotchLarge {
        largest_m: f64,
    },
    /// The crotch arc reaches through the back of the plate.
    CrotchDeep {
        least_m: f64,
    },
    /// Flank pitch too far from the pin pitch.
    FlankPitch {
        least_m: f64,
        largest_m: f64,
    },
    /// Pin hole too near to the contour.
    PinHole {
        largest_diameter_m: f64,
    },
    /// Transition that is not C1.
    Kink {
        element: usize,
        kink_rad: f64,
    },
    Profile(ProfileError),
}

impl std::fmt::Display for SilentLinkError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            SilentLinkError::Dimension { name, value_m } => {
                write!(f, "{name} = {} mm must be a positive number", value_m / MM)
            }
            SilentLinkError::FlankAngle { angle_rad } => write!(
                f,
                "flank angle {:.3} deg is outside {:.0} ..= {:.0} deg",
                angle_rad / DEG,
                FLANK_ANGLE_RANGE_RAD.0 / DEG,
                FLANK_ANGLE_RANGE_RAD.1 / DEG
            ),
            SilentLinkError::Projection { least_m, largest_m } => write!(
                f,
                "the inside projection must lie within {:.4} ..= {:.4} mm at this pitch",
                least_m / MM,
                largest_m / MM
            ),
            SilentLinkError::ToeRadius { largest_m } => {
                write!(
                    f,
                    "the toe arc leaves no outer or inner flank; its radius may be at most {:.4} mm",
                    largest_m / MM
                )
            }
            SilentLinkError::CrotchLarge { largest_m } => {
                write!(f, "the crotch arc leaves no inner flank; its radius may be at most {:.4} mm", largest_m / MM)
            }
            SilentLinkError::CrotchDeep { least_m } => {
                write!(f, "the crotch arc cuts the plate in two; its radius must be at least {:.4} mm", least_m / MM)
            }
            SilentLinkError::FlankPitch { least_m, largest_m } => write!(
                f,
                "the flank pitch must lie within {:.4} ..= {:.4} mm for this pin pitch",
                least_m / MM,
                largest_m / MM
            ),
            SilentLinkError::PinHole { largest_diameter_m } => {
                write!(f, "the pin hole breaks out of the plate; at most {:.4} mm is possible", largest_diameter_m / MM)
            }
            SilentLinkError::Kink { element, kink_rad } => {
                write!(f, "the contour has a kink of {kink_rad:.3e} rad after element {element}")
            }
            SilentLinkError::Profile(ref e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for SilentLinkError {}

/// Largest kink that counts as rounding [rad].
const KINK_TOLERANCE_RAD: f64 = 1e-9;

impl SilentLinkContour {
    /// Parts of the outline, one per element of [`SilentLinkContour::elements`].
    pub const PARTS: [LinkPart; 10] = [
        LinkPart::Back,
        LinkPart::FrontEye,
        LinkPart::FrontOuterFlank,
        LinkPart::FrontToe,
        LinkPart::FrontInnerFlank,
        LinkPart::Crotch,
        LinkPart::RearInnerFlank,
        LinkPart::RearToe,
        LinkPart::RearOuterFlank,
        LinkPart::RearEye,
    ];

    /// Computes the contour and checks it.
    pub fn new(
        form: SilentLinkForm,
        pin_pitch_m: f64,
        flank_pitch_m: f64,
    ) -> Result<SilentLinkContour, SilentLinkError> {
        check_form(&form, pin_pitch_m, flank_pitch_m)?;
        let half_m = 0.5 * flank_pitch_m;
        let (s, c) = sin_cos(form.flank_angle_rad);
        let (face_m, inner_m) = (form.face_distance_m, form.inner_face_distance_m());
        let (toe_offset_m, toe_depth_m) = (form.toe_offset_m(), form.toe_depth_m());
        let outer_flank_length_m = c * toe_depth_m - s * toe_offset_m;
        let inner_flank_end_m = c * toe_depth_m + s * toe_offset_m;
        if outer_flank_length_m.min(inner_flank_end_m) <= 0.0 {
            let largest_m = 0.5 * (face_m + inner_m) - s * s / c * toe_offset_m.abs();
            return Err(SilentLinkError::ToeRadius { largest_m });
        }
        let crotch_centre_m = (half_m * c - inner_m - form.crotch_radius_m) / s;
        let inner_flank_start_m = -half_m * s - c * crotch_centre_m;
        check_crotch(&form, pin_pitch_m, crotch_centre_m, inner_flank_start_m - inner_flank_end_m)?;

        let alpha = form.flank_angle_rad;
        let eye_centre = Vec2::new(half_m, 0.0);
        let outward = Vec2::new(c, s);
        let inward = Vec2::new(-c, s);
        let on_outer = |u: f64| eye_centre + outward * face_m + Vec2::new(-s, c) * u;
        let on_inner = |u: f64| eye_centre + inward * inner_m + Vec2::new(s, c) * u;
        let front = LinkEnd {
            eye_centre,
            eye: SilentArc { centre: eye_centre, radius_m: face_m, start_rad: -0.5 * PI, sweep_rad: 0.5 * PI + alpha },
            outer_flank: Flank { start: on_outer(0.0), end: on_outer(outer_flank_length_m), normal: outward },
            toe: SilentArc {
                centre: eye_centre + Vec2::new(toe_offset_m, toe_depth_m),
                radius_m: form.toe_radius_m,
                start_rad: alpha,
                sweep_rad: PI - 2.0 * alpha,
            },
            inner_flank: Flank {
                start: on_inner(inner_flank_end_m),
                end: on_inner(inner_flank_start_m),
                normal: inward,
            },
        };
        let contour = SilentLinkContour {
            form,
            pin_pitch_m,
            flank_pitch_m,
            outer_flank_length_m,
            inner_flank_start_m,
            inner_flank_end_m,
            crotch_centre_m,
            front,
            rear: front.mirrored(),
            crotch: SilentArc {
                centre: Vec2::new(0.0, -crotch_centre_m),
                radius_m: form.crotch_radius_m,
                start_rad: -alpha,
                sweep_rad: 2.0 * alpha - PI,
            },
        };
        contour.profile()?;
        Ok(contour)
    }

    /// Height of the crotch over the pin line, outwards [m].
    pub fn crotch_top_m(&self) -> f64 {
        self.crotch_centre_m + self.form.crotch_radius_m
    }

    /// Height of the toes over the pin line, outwards, thus negative [m].
    pub fn toe_low_m(&self) -> f64 {
        -(self.form.toe_depth_m() + self.form.toe_radius_m)
    }

    /// The outline, counterclockwise, as in [`SilentLinkContour::PARTS`].
    pub fn elements(&self) -> [Element; 10] {
        let (front, rear) = (&self.front, &self.rear);
        let back = |x_m: f64| Vec2::new(x_m, -self.form.face_distance_m);
        [
            Element::Line { start: back(rear.eye_centre.x), end: back(front.eye_centre.x) },
            front.eye.element(),
            front.outer_flank.element(),
            front.toe.element(),
            front.inner_flank.element(),
            self.crotch.element(),
            rear.inner_flank.element(),
            rear.toe.element(),
            rear.outer_flank.element(),
            rear.eye.element(),
        ]
    }

    /// The closed outline; all transitions are C1.
    pub fn profile(&self) -> Result<Profile, SilentLinkError> {
        let profile = Profile::new(self.elements().to_vec(), true).map_err(SilentLinkError::Profile)?;
        match profile.kinks_rad().iter().enumerate().find(|(_, kink)| kink.abs() > KINK_TOLERANCE_RAD) {
            Some((element, &kink_rad)) => Err(SilentLinkError::Kink { element, kink_rad }),
            None => Ok(profile),
        }
    }
}

/// Checks that do not need the contour.
fn check_form(form: &SilentLinkForm, pin_pitch_m: f64, flank_pitch_m: f64) -> Result<(), SilentLinkError> {
    let positive = [
        ("the pin pitch", pin_pitch_m),
        ("the flank pitch", flank_pitch_m),
        ("the face distance", form.face_distance_m),
        ("the toe radius", form.toe_radius_m),
        ("the crotch radius", form.crotch_radius_m),
    ];
    for (name, value_m) in positive {
        if !(value_m.is_finite() && value_m > 0.0) {
            return Err(SilentLinkError::Dimension { name, value_m });
        }
    }
    let (least_rad, largest_rad) = FLANK_ANGLE_RANGE_RAD;
    if !(least_rad..=largest_rad).contains(&form.flank_angle_rad) {
        return Err(SilentLinkError::FlankAngle { angle_rad: form.flank_angle_rad });
    }
    let (least_m, largest_m) = (PROJECTION_RANGE.0 * pin_pitch_m, PROJECTION_RANGE.1 * pin_pitch_m);
    if !(least_m..=largest_m).contains(&form.inside_projection_m) || form.inner_face_distance_m() <= 0.0 {
        return Err(SilentLinkError::Projection { least_m: least_m.max(-0.5 * form.face_distance_m), largest_m });
    }
    let (least_m, largest_m) = (pin_pitch_m * (1.0 - FLANK_PITCH_RANGE), pin_pitch_m * (1.0 + FLANK_PITCH_RANGE));
    if !(least_m..=largest_m).contains(&flank_pitch_m) {
        return Err(SilentLinkError::FlankPitch { least_m, largest_m });
    }
    Ok(())
}

/// The crotch must leave an inner flank and a web. `excess_m` is s_i0 - s_i.
fn check_crotch(
    form: &SilentLinkForm,
    pin_pitch_m: f64,
    crotch_centre_m: f64,
    excess_m: f64,
) -> Result<(), SilentLinkError> {
    let (s, c) = sin_cos(form.flank_angle_rad);
    if excess_m >= 0.0 {
        // s_i0 grows by c / s per unit of r_c.
        return Err(SilentLinkError::CrotchLarge { largest_m: form.crotch_radius_m - excess_m * s / c });
    }
    let web_m = form.face_distance_m - (crotch_centre_m + form.crotch_radius_m);
    let least_web_m = MIN_WALL * pin_pitch_m;
    if web_m < least_web_m {
        // The crotch top sinks by 1 / s - 1 per unit of r_c.
        let least_m = form.crotch_radius_m + (least_web_m - web_m) * s / (1.0 - s);
        return Err(SilentLinkError::CrotchDeep { least_m });
    }
    Ok(())
}

impl LinkEnd {
    /// The other end: mirrored about the middle of the link, and traversed backwards.
    fn mirrored(&self) -> LinkEnd {
        let point = |p: Vec2| Vec2::new(-p.x, p.y);
        let flank = |f: Flank| Flank { start: point(f.end), end: point(f.start), normal: point(f.normal) };
        let arc =
            |a: SilentArc| SilentArc { centre: point(a.centre), start_rad: PI - (a.start_rad + a.sweep_rad), ..a };
        LinkEnd {
            eye_centre: point(self.eye_centre),
            eye: arc(self.eye),
            outer_flank: flank(self.outer_flank),
            toe: arc(self.toe),
            inner_flank: flank(self.inner_flank),
        }
    }
}

impl SilentChain {
    /// The two rows: even links first.
    pub fn rows(&self) -> Result<[SilentLink; 2], SilentLinkError> {
        Ok([self.row("even", self.even)?, self.row("odd", self.odd)?])
    }

    fn row(&self, name: &'static str, spec: SilentRowSpec) -> Result<SilentLink, SilentLinkError> {
        for (name, value_m) in [
            ("the pin diameter", self.pin_diameter_m),
            ("the pin length", self.pin_length_m),
            ("the thickness of the plates", self.pack_thickness_m),
        ] {
            if !(value_m.is_finite() && value_m > 0.0) {
                return Err(SilentLinkError::Dimension { name, value_m });
            }
        }
        let pitch_m = spec.pin_pitch_m.unwrap_or(self.pitch_m);
        let contour = SilentLinkContour::new(self.form, pitch_m, spec.flank_pitch_m.unwrap_or(self.pitch_m))?;
        let plate = contour.profile()?;
        let lever_m = 0.5 * pitch_m;
        let pin_radius_m = 0.5 * self.pin_diameter_m;
        // The contour is symmetric, so that one joint represents both.
        let reach_m = -plate.closest(Vec2::new(lever_m, 0.0)).distance_m;
        let largest_radius_m = reach_m - MIN_WALL * self.pitch_m;
        if pin_radius_m > largest_radius_m {
            return Err(SilentLinkError::PinHole { largest_diameter_m: 2.0 * largest_radius_m });
        }

        // Plates minus two holes, and half of each of the two pins, which both rows share.
        let area = plate.area_properties();
        let per_area_kg_m2 = self.pack_thickness_m * self.density_kg_m3;
        let disc_m2 = PI * pin_radius_m * pin_radius_m;
        let at_joints_kg = disc_m2 * (self.pin_length_m - 2.0 * self.pack_thickness_m) * self.density_kg_m3;
        let mass_kg = per_area_kg_m2 * area.area_m2 + at_joints_kg;
        let centre_m = per_area_kg_m2 * area.area_m2 * area.centroid.y / mass_kg;
        // About the middle of the joints first, then about the centre of mass.
        let about_middle = per_area_kg_m2 * (area.polar_moment_m4 + area.area_m2 * area.centroid.norm_squared())
            + at_joints_kg * (0.5 * pin_radius_m * pin_radius_m + lever_m * lever_m);
        let inertia_kg_m2 = about_middle - mass_kg * centre_m * centre_m;
        let shape = LinkShape {
            name,
            pitch_m,
            plate,
            plate_end_radius_m: self.form.face_distance_m,
            bush_radius_m: None,
            roller: None,
            circles: [-lever_m, lever_m].map(|x| (Vec2::new(x, 0.0), pin_radius_m)).to_vec(),
            mass_kg: spec.mass_kg.unwrap_or(mass_kg),
            inertia_kg_m2: spec.inertia_kg_m2.unwrap_or(inertia_kg_m2),
        };
        Ok(SilentLink { shape, contour, centre_of_mass_m: centre_m })
    }
}
