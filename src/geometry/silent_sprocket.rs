//! Sprocket teeth for silent (inverted-tooth) chain, as arcs and lines.
//!
//! A link is seated when its joints lie on the pitch circle and its outer flanks contact the two teeth on either side
//! of the one in its crotch. This determines the position of the tooth face. Tooth frame: origin on the sprocket axis,
//! +y along the tooth axis; the face towards +x is described, the other one is its mirror image. With alpha, f of the
//! link (see [`super::chain::silent`]), tau = 2 pi / z, m = (cos beta, sin beta) the normal of the face and u = (-sin
//! beta, cos beta):
//!
//! ```text
//! R   = p / (2 sin(pi/z))          pitch circle            d    = R cos(pi/z)        pin line of a seated link
//! r_v = z p / (2 pi)               rolling radius          beta = alpha - tau        half tooth angle; z > 360 deg/alpha
//! e   = R sin(alpha - pi/z) - f    distance of the face plane from the axis
//! r_b = r_v cos alpha              base circle             s_c  = R cos(alpha - pi/z) - r_b     see below
//!
//! line      X . m = e
//! crowned   arc about T = u_c u + (e - rho) m, radius rho, u_c = R cos(alpha - pi/z) - s, contacts the flank of the
//!           seated link at s from the foot of the joint's perpendicular
//! arc       the crowned face with s = s_c, rho = e: T = r_b u. It osculates the involute of r_b, which contacts at s_c
//!           with curvature radius e, but exists below r_b and is an exact arc
//! tip       land on r_a = d + c_a, corner arc r_k about K with |K| = r_a - r_k, |K - T| = rho - r_k
//!           (line: K . m = e - r_k)
//! root      one arc through r_f on the gap axis, tangent to both faces;
//!           r_f = |toe centre of the seated link| - r_t - c_f
//! ```
//! The gap frame has +y along the gap axis. Default face: arc. Defaults of the free dimensions: c_a = 0, r_k = 0.05 p,
//! c_f = 0.1 p. Source: derived here from the seat rule of ASME B29.2M (joints of a seated link on the pitch circle).

use super::chain::silent::{SilentArc, SilentLinkContour, SilentLinkError, SilentLinkForm};
use super::element_gap::element_gap_m;
use super::profile::{Element, Profile, ProfileError};
use super::{Vec2, rotated, unit};
use crate::units::{MM, UM, atan2, sin_cos, wrap_angle};
use std::f64::consts::PI;

/// Maximum number of teeth of a sprocket (also the limit of ISO 606).
pub const LARGEST_TEETH: u32 = 150;

/// The working face of a tooth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ToothFace {
    /// Straight: contacts the straight flank of the link over its whole length.
    Line,
    /// Arc that osculates the involute.
    Arc,
    /// Arc of any radius that contacts the seated flank at `contact_distance_m` from the foot of the joint's
    /// perpendicular.
    Crowned { radius_m: f64, contact_distance_m: f64 },
}

/// Maximum depth of a gap of arcs below its waist, over the pitch. assumed: small flank angles need three quarters of
/// it, and the teeth are still thicker at the root than above.
const LARGEST_UNDERCUT: f64 = 0.1;

/// Dimensions of a sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentSprocketSpec {
    pub teeth: u32,
    pub pitch_m: f64,
    pub face: ToothFace,
    /// The link for which it is designed.
    pub link: SilentLinkForm,
    /// c_a: height of the tip circle over the pin line of a seated link [m].
    pub tip_offset_m: f64,
    /// r_k [m].
    pub corner_radius_m: f64,
    /// c_f: gap between root and toe of the seated link, on the gap axis [m].
    pub root_clearance_m: f64,
}

impl SilentSprocketSpec {
    /// c_a = 0, r_k = 0.05 p, c_f = 0.1 p, for the link of standard proportions.
    pub fn standard(teeth: u32, pitch_m: f64, face: ToothFace) -> SilentSprocketSpec {
        SilentSprocketSpec {
            teeth,
            pitch_m,
            face,
            link: SilentLinkForm::standard(pitch_m),
            tip_offset_m: 0.0,
            corner_radius_m: 0.05 * pitch_m,
            root_clearance_m: 0.1 * pitch_m,
        }
    }
}

/// The dimensions of the tooth. Points are in the tooth frame unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentSprocket {
    pub spec: SilentSprocketSpec,
    /// R.
    pub pitch_radius_m: f64,
    /// d: distance of the pin line of a seated link from the axis.
    pub chord_radius_m: f64,
    /// r_v.
    pub rolling_radius_m: f64,
    /// beta.
    pub half_tooth_angle_rad: f64,
    /// alpha - pi/z: between the gap axis and a face.
    pub half_gap_angle_rad: f64,
    /// e.
    pub face_offset_m: f64,
    /// r_b.
    pub base_radius_m: f64,
    /// Contact point of the face on the flank of the seated link, measured from the foot of the joint's perpendicular
    /// towards the toe; None for a line, which contacts the whole flank.
    pub contact_distance_m: Option<f64>,
    /// rho; None for a line.
    pub face_radius_m: Option<f64>,
    /// T; None for a line.
    pub face_centre: Option<Vec2>,
    /// r_a.
    pub tip_radius_m: f64,
    /// K.
    pub corner_centre: Vec2,
    /// Radius of the tip circle at which the land vanishes.
    pub pointed_radius_m: f64,
    /// Length of the tip land along the tip circle.
    pub tip_land_m: f64,
    /// r_f.
    pub root_radius_m: f64,
    /// r_r.
    pub root_arc_radius_m: f64,
    /// Smallest gap between the toes of a link that swings in and the gap it enters; see [`SilentSprocketError::Toe`].
    pub toe_clearance_m: f64,
    /// Face, corner and land of the +x side, upwards.
    side: [Element; 3],
}

/// Why no tooth can be made, each with a value that would work.
#[derive(Clone, Debug, PartialEq)]
pub enum SilentSprocketError {
    /// Tooth angle not positive, or too many teeth.
    Teeth {
        teeth: u32,
        least: u32,
    },
    Link(SilentLinkError),
    /// A dimension that is not a positive number.
    Dimension {
        name: &'static str,
        value_m: f64,
    },
    /// Face too near to the axis for its corner arc: largest face distance f of the link [m].
    Face {
        largest_face_distance_m: f64,
    },
    /// Crown radius not larger than the corner radius: largest corner radius [m].
    Corner {
        largest_m: f64,
    },
    /// A crown whose contact point is beyond the end of the flank: largest distance from the foot of the joint's
    /// perpendicular [m].
    Contact {
        largest_m: f64,
    },
    /// Tip circle beyond the point where the corners of a tooth meet: largest tip diameter [m].
    Pointed {
        largest_tip_diameter_m: f64,
    },
    /// Tip circle so low that it removes the contact point: smallest tip diameter [m].
    LowTip {
        smallest_tip_diameter_m: f64,
    },
    /// Root below the point where the two faces of a gap meet, or too far below the waist of the gap: largest clearance
    /// c_f [m].
    DeepRoot {
        largest_clearance_m: f64,
    },
    /// The root arc removes the contact point.
    HighRoot,
    /// The toe of a link that swings in interferes with root or face by this much [m]; smallest sufficient clearance
    /// c_f [m].
    Toe {
        interference_m: f64,
        enough_clearance_m: Option<f64>,
    },
}

impl std::fmt::Display for SilentSprocketError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            SilentSprocketError::Teeth { teeth, least } => {
                write!(f, "{teeth} teeth are outside {least} ..= {LARGEST_TEETH}, possible at this flank angle")
            }
            SilentSprocketError::Link(ref e) => write!(f, "the link: {e}"),
            SilentSprocketError::Dimension { name, value_m } => {
                write!(f, "{name} = {} mm must be a positive number", value_m / MM)
            }
            SilentSprocketError::Face { largest_face_distance_m } => write!(
                f,
                "no tooth is left; take more teeth, or a link with a face distance below {:.4} mm",
                largest_face_distance_m / MM
            ),
            SilentSprocketError::Corner { largest_m } => write!(
                f,
                "the face is no wider than the corner arc; its radius must be below {:.4} mm, or that of the face above",
                largest_m / MM
            ),
            SilentSprocketError::Contact { largest_m } => {
                write!(f, "the face would touch the flank beyond its end; at most {:.4} mm works", largest_m / MM)
            }
            SilentSprocketError::Pointed { largest_tip_diameter_m } => write!(
                f,
                "the tooth is pointed below this tip circle; its diameter may be at most {:.4} mm",
                round_down_mm(largest_tip_diameter_m)
            ),
            SilentSprocketError::LowTip { smallest_tip_diameter_m } => write!(
                f,
                "the tip circle cuts off the place of contact; its diameter must be at least {:.4} mm",
                -round_down_mm(-smallest_tip_diameter_m)
            ),
            SilentSprocketError::DeepRoot { largest_clearance_m } => {
                write!(f, "this root is too deep between the faces; ")?;
                if largest_clearance_m > 0.0 {
                    write!(f, "the root clearance may be at most {:.4} mm", round_down_mm(largest_clearance_m))
                } else {
                    write!(f, "take more teeth or a larger toe radius")
                }
            }
            SilentSprocketError::HighRoot => {
                write!(f, "the root arc reaches the place of contact; take more root clearance or more teeth")
            }
            SilentSprocketError::Toe { interference_m, enough_clearance_m } => {
                write!(f, "the toe of a link that swings in strikes the tooth by {:.1} um; ", interference_m / UM)?;
                match enough_clearance_m {
                    Some(clearance_m) => write!(f, "a root clearance of {:.4} mm is enough", clearance_m / MM),
                    None => {
                        write!(f, "no root clearance helps: take more teeth, a larger toe radius or a crowned face")
                    }
                }
            }
        }
    }
}

impl std::error::Error for SilentSprocketError {}

/// In mm, rounded down to the digits that an error prints.
fn round_down_mm(value_m: f64) -> f64 {
    libm::floor(value_m / MM * 1e4) / 1e4
}

/// Quantities that follow from pitch, teeth and link alone, and the face.
struct Face {
    normal: Vec2,
    upwards: Vec2,
    offset_m: f64,
    /// Radius and centre of an arc.
    arc: Option<(f64, Vec2)>,
    /// The contact point, below which the corner arc must not reach; for a line, the point opposite the middle of the
    /// link.
    contact: Vec2,
}

impl SilentSprocket {
    /// Computes the tooth and checks it.
    pub fn new(spec: SilentSprocketSpec) -> Result<SilentSprocket, SilentSprocketError> {
        let sprocket = SilentSprocket::shaped(spec)?;
        if sprocket.toe_clearance_m >= -SWING_TOLERANCE_M {
            return Ok(sprocket);
        }
        // A working value is found by trial, in steps suitable for a drawing.
        let step_m = 0.005 * spec.pitch_m;
        let enough_clearance_m = (1..=60).map(|k| spec.root_clearance_m + step_m * f64::from(k)).find(|&clearance_m| {
            let deeper = SilentSprocketSpec { root_clearance_m: clearance_m, ..spec };
            SilentSprocket::shaped(deeper).is_ok_and(|s| s.toe_clearance_m >= -SWING_TOLERANCE_M)
        });
        Err(SilentSprocketError::Toe { interference_m: -sprocket.toe_clearance_m, enough_clearance_m })
    }

    /// The tooth without the check of the swinging toes.
    fn shaped(spec: SilentSprocketSpec) -> Result<SilentSprocket, SilentSprocketError> {
        check_spec(&spec)?;
        let contour =
            SilentLinkContour::new(spec.link, spec.pitch_m, spec.pitch_m).map_err(SilentSprocketError::Link)?;
        let flank = contour.front.outer_flank;
        let largest_m = (flank.end - flank.start).norm();
        if let ToothFace::Crowned { contact_distance_m, .. } = spec.face
            && contact_distance_m > largest_m
        {
            return Err(SilentSprocketError::Contact { largest_m });
        }
        let z = f64::from(spec.teeth);
        let half_pitch_rad = PI / z;
        let alpha = spec.link.flank_angle_rad;
        let pitch_radius_m = 0.5 * spec.pitch_m / sin_cos(half_pitch_rad).0;
        let chord_radius_m = pitch_radius_m * sin_cos(half_pitch_rad).1;
        let rolling_radius_m = z * spec.pitch_m / (2.0 * PI);
        let base_radius_m = rolling_radius_m * sin_cos(alpha).1;
        let half_gap_angle_rad = alpha - half_pitch_rad;
        let foot_m = pitch_radius_m * sin_cos(half_gap_angle_rad).1;
        let (face, contact_distance_m) = place_face(&spec, pitch_radius_m, foot_m - base_radius_m)?;

        let tip_radius_m = chord_radius_m + spec.tip_offset_m;
        let (corner_centre, pointed_radius_m) = face.corner(tip_radius_m, spec.corner_radius_m);
        if tip_radius_m >= pointed_radius_m {
            return Err(SilentSprocketError::Pointed { largest_tip_diameter_m: 2.0 * pointed_radius_m });
        }
        let lowest_m = (face.contact - face.normal * spec.corner_radius_m).norm() + spec.corner_radius_m;
        if tip_radius_m <= lowest_m {
            return Err(SilentSprocketError::LowTip { smallest_tip_diameter_m: 2.0 * lowest_m });
        }

        let toe = contour.front.toe.centre + Vec2::new(0.0, -chord_radius_m);
        let toe_low_m = toe.norm() - spec.link.toe_radius_m;
        let root_radius_m = toe_low_m - spec.root_clearance_m;
        let lowest_root_m = face.lowest_root_m(half_pitch_rad, LARGEST_UNDERCUT * spec.pitch_m);
        if root_radius_m <= lowest_root_m {
            return Err(SilentSprocketError::DeepRoot { largest_clearance_m: toe_low_m - lowest_root_m });
        }
        let root_centre_m = face.root_centre_m(root_radius_m, half_pitch_rad);
        let root_arc_radius_m = root_centre_m - root_radius_m;
        let root_centre = rotated(Vec2::new(0.0, root_centre_m), -half_pitch_rad);
        let side = face.side(root_centre, root_arc_radius_m, corner_centre, spec.corner_radius_m, tip_radius_m);
        let contact_along = side[0].foot_along(face.contact);
        if !(root_arc_radius_m > 0.0 && contact_along > 0.0 && contact_along < 1.0) {
            return Err(SilentSprocketError::HighRoot);
        }

        let land_rad = 0.5 * PI - atan2(corner_centre.y, corner_centre.x);
        let mut sprocket = SilentSprocket {
            spec,
            pitch_radius_m,
            chord_radius_m,
            rolling_radius_m,
            half_tooth_angle_rad: alpha - 2.0 * half_pitch_rad,
            half_gap_angle_rad,
            face_offset_m: face.offset_m,
            base_radius_m,
            contact_distance_m,
            face_radius_m: face.arc.map(|(radius_m, _)| radius_m),
            face_centre: face.arc.map(|(_, centre)| centre),
            tip_radius_m,
            corner_centre,
            pointed_radius_m,
            tip_land_m: 2.0 * tip_radius_m * land_rad,
            root_radius_m,
            root_arc_radius_m,
            toe_clearance_m: 0.0,
            side,
        };
        sprocket.toe_clearance_m = sprocket.swing_clearance_m(&contour);
        Ok(sprocket)
    }

    /// Angle between two gaps, tau [rad].
    pub fn pitch_angle_rad(&self) -> f64 {
        2.0 * PI / f64::from(self.spec.teeth)
    }

    /// Elements of one gap in the gap frame, from the axis of the tooth on the side +x to that of the tooth on the side
    /// -x: land, corner, face, root, face, corner, land. The material is on the left.
    pub fn gap_elements(&self) -> [Element; 7] {
        let half_pitch_rad = 0.5 * self.pitch_angle_rad();
        let left = self.side.map(|e| e.moved(half_pitch_rad, Vec2::zeros()));
        let right = left.map(|e| mirrored(&e));
        let root_centre_m = self.root_radius_m + self.root_arc_radius_m;
        let low = left[0].start();
        let half_sweep_rad = atan2(-low.x, root_centre_m - low.y);
        let root = Element::Arc {
            centre: Vec2::new(0.0, root_centre_m),
            radius_m: self.root_arc_radius_m,
            start_rad: -0.5 * PI + half_sweep_rad,
            sweep_rad: -2.0 * half_sweep_rad,
        };
        [right[2], right[1], right[0], root, left[0], left[1], left[2]]
    }

    /// Elements of gap `k` in the frame of the sprocket, as in [`SilentSprocket::gap_elements`]. Its axis is at k tau
    /// from +x, so that a joint seated in it lies at R from the axis in that direction.
    pub fn gap(&self, k: i32) -> [Element; 7] {
        let turn_rad = f64::from(k) * self.pitch_angle_rad() - 0.5 * PI;
        self.gap_elements().map(|e| e.moved(turn_rad, Vec2::zeros()))
    }

    /// The whole contour in the frame of the sprocket. Elements of gap k are 7k .. 7k+7.
    pub fn profile(&self) -> Result<Profile, ProfileError> {
        let elements = (0..self.spec.teeth as i32).flat_map(|k| self.gap(k)).collect();
        Profile::new(elements, true)
    }

    /// Pose of the link frame in the frame of the sprocket if the link's front joint is seated in gap 0 and the link is
    /// turned by `turn_rad` out of the seat about that joint: angle and origin.
    pub fn pose_at_seat(&self, pin_pitch_m: f64, turn_rad: f64) -> (f64, Vec2) {
        let joint = Vec2::new(self.pitch_radius_m, 0.0);
        let angle_rad = 0.5 * PI - 0.5 * self.pitch_angle_rad() + turn_rad;
        (angle_rad, joint - unit(angle_rad) * (0.5 * pin_pitch_m))
    }

    /// Overlap up to which an element counts as inside the tooth and not behind it [m]: half the thickness of the tooth
    /// at the ends of its faces.
    pub fn deepest_overlap_m(&self) -> f64 {
        self.side[0].end().x
    }

    /// Smallest gap between the toes of a nominal link and the gaps they enter, while it swings about its seated front
    /// joint through one pitch angle [m].
    fn swing_clearance_m(&self, contour: &SilentLinkContour) -> f64 {
        const SAMPLES: u32 = 180;
        let pitch_angle_rad = self.pitch_angle_rad();
        // Front toe: root and the face ahead; rear toe, one gap back: root and the face behind.
        let (ahead, behind) = (self.gap(0), self.gap(-1));
        let pairs = [(contour.front.toe, [ahead[3], ahead[4]]), (contour.rear.toe, [behind[3], behind[2]])];
        let deepest_m = self.deepest_overlap_m();
        let mut smallest_m = f64::INFINITY;
        for k in 0..=SAMPLES {
            let turn_rad = pitch_angle_rad * f64::from(k) / f64::from(SAMPLES);
            let (angle_rad, origin) = self.pose_at_seat(self.spec.pitch_m, turn_rad);
            for (toe, tooth) in &pairs {
                let toe = SilentArc::element(toe).moved(angle_rad, origin);
                for element in tooth {
                    smallest_m = smallest_m.min(element_gap_m(&toe, element, deepest_m));
                }
            }
        }
        smallest_m
    }
}

/// Interference below this is rounding of the construction [m]: a straight face contacts the seated flank up to its
/// toe.
const SWING_TOLERANCE_M: f64 = 1e-9;

/// Checks that do not need the tooth.
fn check_spec(spec: &SilentSprocketSpec) -> Result<(), SilentSprocketError> {
    let mut dimensions = vec![
        ("the pitch", spec.pitch_m),
        ("the corner radius", spec.corner_radius_m),
        ("the root clearance", spec.root_clearance_m),
    ];
    if let ToothFace::Crowned { radius_m, contact_distance_m } = spec.face {
        dimensions.extend([("the crown radius", radius_m), ("the contact distance", contact_distance_m)]);
    }
    for (name, value_m) in dimensions {
        if !(value_m.is_finite() && value_m > 0.0) {
            return Err(SilentSprocketError::Dimension { name, value_m });
        }
    }
    if !spec.tip_offset_m.is_finite() {
        return Err(SilentSprocketError::Dimension { name: "the tip radius", value_m: spec.tip_offset_m });
    }
    // beta > 0, with a margin for rounding: at z = 360 deg / alpha the faces of a tooth are parallel.
    let least = libm::floor(2.0 * PI / spec.link.flank_angle_rad + 1e-9) + 1.0;
    if f64::from(spec.teeth) < least || spec.teeth > LARGEST_TEETH {
        return Err(SilentSprocketError::Teeth { teeth: spec.teeth, least: least as u32 });
    }
    Ok(())
}

/// The face and its contact point on the seated flank. `involute_distance_m` is s_c.
fn place_face(
    spec: &SilentSprocketSpec,
    pitch_radius_m: f64,
    involute_distance_m: f64,
) -> Result<(Face, Option<f64>), SilentSprocketError> {
    let half_pitch_rad = PI / f64::from(spec.teeth);
    let (sin_gap, cos_gap) = sin_cos(spec.link.flank_angle_rad - half_pitch_rad);
    let (sin_tooth, cos_tooth) = sin_cos(spec.link.flank_angle_rad - 2.0 * half_pitch_rad);
    let (normal, upwards) = (Vec2::new(cos_tooth, sin_tooth), Vec2::new(-sin_tooth, cos_tooth));
    let offset_m = pitch_radius_m * sin_gap - spec.link.face_distance_m;
    let (distance_m, radius_m) = match spec.face {
        ToothFace::Line => (None, None),
        ToothFace::Arc => (Some(involute_distance_m), Some(offset_m)),
        ToothFace::Crowned { radius_m, contact_distance_m } => (Some(contact_distance_m), Some(radius_m)),
    };
    if let Some(largest_m) = radius_m.filter(|r| *r <= spec.corner_radius_m && *r < offset_m) {
        return Err(SilentSprocketError::Corner { largest_m });
    }
    if offset_m <= spec.corner_radius_m {
        let largest_face_distance_m = pitch_radius_m * sin_gap - spec.corner_radius_m;
        return Err(SilentSprocketError::Face { largest_face_distance_m });
    }
    // A line has no single contact point: the one opposite the middle of the link represents it.
    let middle_m = 0.5 * spec.pitch_m * sin_cos(spec.link.flank_angle_rad).0;
    let contact_m = pitch_radius_m * cos_gap - distance_m.unwrap_or(middle_m);
    let contact = upwards * contact_m + normal * offset_m;
    let arc = radius_m.map(|radius_m| (radius_m, contact - normal * radius_m));
    Ok((Face { normal, upwards, offset_m, arc, contact }, distance_m))
}

impl Face {
    /// K for a tip circle, and the radius of the tip circle at which K would lie on the tooth axis.
    fn corner(&self, tip_radius_m: f64, corner_radius_m: f64) -> (Vec2, f64) {
        let reach_m = tip_radius_m - corner_radius_m;
        match self.arc {
            None => {
                let inset_m = self.offset_m - corner_radius_m;
                let along_m = libm::sqrt((reach_m * reach_m - inset_m * inset_m).max(0.0));
                let apex_m = inset_m / self.normal.y;
                (self.normal * inset_m + self.upwards * along_m, apex_m + corner_radius_m)
            }
            Some((radius_m, centre)) => {
                // Intersection of two circles, on the side +x of the tooth axis.
                let inner_m = radius_m - corner_radius_m;
                let centre2 = centre.norm_squared();
                let along = 0.5 * (reach_m * reach_m - inner_m * inner_m + centre2) / centre2;
                let height = libm::sqrt((reach_m * reach_m / centre2 - along * along).max(0.0));
                let apex_m = centre.y + libm::sqrt((inner_m * inner_m - centre.x * centre.x).max(0.0));
                (centre * along - super::perp(centre) * height, apex_m + corner_radius_m)
            }
        }
    }

    /// Lowest root radius: where the two faces of a gap would meet, or `undercut_m` below the root at which the gap is
    /// as wide as its mouth [m].
    fn lowest_root_m(&self, half_pitch_rad: f64, undercut_m: f64) -> f64 {
        match self.arc {
            None => self.offset_m / rotated(self.normal, half_pitch_rad).y,
            Some((radius_m, centre)) => {
                let g = rotated(centre, half_pitch_rad);
                let reach2 = radius_m * radius_m - g.x * g.x;
                if reach2 > 0.0 { g.y + libm::sqrt(reach2) } else { g.y + radius_m - g.x.abs() - undercut_m }
            }
        }
    }

    /// Distance of the centre of the root arc from the sprocket axis [m].
    fn root_centre_m(&self, root_radius_m: f64, half_pitch_rad: f64) -> f64 {
        match self.arc {
            None => (root_radius_m - self.offset_m) / (1.0 - rotated(self.normal, half_pitch_rad).y),
            Some((radius_m, centre)) => {
                let g = rotated(centre, half_pitch_rad);
                let excess_m = radius_m - root_radius_m;
                0.5 * (g.norm_squared() - excess_m * excess_m) / (excess_m + g.y)
            }
        }
    }

    /// Face, corner and land on the side +x of the tooth axis, upwards. `root_centre` in the tooth frame.
    fn side(
        &self,
        root_centre: Vec2,
        root_arc_radius_m: f64,
        corner_centre: Vec2,
        corner_radius_m: f64,
        tip_radius_m: f64,
    ) -> [Element; 3] {
        let angle = |v: Vec2| atan2(v.y, v.x);
        let (face, face_end_rad) = match self.arc {
            None => {
                let start = root_centre - self.normal * root_arc_radius_m;
                let end = corner_centre + self.normal * corner_radius_m;
                (Element::Line { start, end }, angle(self.normal))
            }
            Some((radius_m, centre)) => {
                let (start_rad, end_rad) = (angle(root_centre - centre), angle(corner_centre - centre));
                let sweep_rad = wrap_angle(end_rad - start_rad);
                (Element::Arc { centre, radius_m, start_rad, sweep_rad }, end_rad)
            }
        };
        let tip_rad = angle(corner_centre);
        let corner = Element::Arc {
            centre: corner_centre,
            radius_m: corner_radius_m,
            start_rad: face_end_rad,
            sweep_rad: wrap_angle(tip_rad - face_end_rad),
        };
        let land = Element::Arc {
            centre: Vec2::zeros(),
            radius_m: tip_radius_m,
            start_rad: tip_rad,
            sweep_rad: 0.5 * PI - tip_rad,
        };
        [face, corner, land]
    }
}

/// Mirror image in the y axis, traversed backwards, so that the material stays on the left.
fn mirrored(element: &Element) -> Element {
    let point = |p: Vec2| Vec2::new(-p.x, p.y);
    match *element {
        Element::Line { start, end } => Element::Line { start: point(end), end: point(start) },
        Element::Arc { centre, radius_m, start_rad, sweep_rad } => {
            Element::Arc { centre: point(centre), radius_m, start_rad: PI - (start_rad + sweep_rad), sweep_rad }
        }
    }
}
