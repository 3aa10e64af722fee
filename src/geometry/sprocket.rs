//! Sprocket teeth after ISO 606 (DIN 8196), minimum and maximum tooth-gap form, as arcs.
//!
//! One tooth gap is described in the gap frame: origin on the sprocket axis, +y along the gap axis. From the root
//! outwards: the roller-seating arc (concave, radius r_i, subtending the angle alpha), the flank arc (convex, radius
//! r_e, its centre on the extension of the line from seat centre to seat end, so that the transition is C1), the tip
//! corner, and the tip land on d_a.
//!
//! ```text
//! d   = p / sin(pi/z)                      pitch circle
//! d_f = d - d_1                            root circle
//! min gap: r_i = 0.505 d_1                 r_e = 0.12 d_1 (z + 2)       alpha = 140 deg - 90 deg / z
//! max gap: r_i = 0.505 d_1 + 0.069 cbrt(d_1)  r_e = 0.008 d_1 (z^2 + 180)  alpha = 120 deg - 90 deg / z     (mm)
//! d_a,max = d + 1.25 p - d_1               d_a,min = d + p (1 - 1.6/z) - d_1
//! ```
//! Source: ISO 606:2015, clause on tooth gap forms; d_1 is the roller or bush diameter. Valid for 9 to 150 teeth.

use super::profile::{Element, Profile, ProfileError};
use super::{Vec2, unit};
use crate::units::{DEG, MM, atan2, sin_cos};
use std::f64::consts::PI;

/// Possible numbers of teeth of a sprocket (ISO 606).
pub const TEETH_RANGE: std::ops::RangeInclusive<u32> = 9..=150;

/// Minimum tip land if no tip diameter is given [m]. assumed: below 0.4 mm a tip is knife-edged.
const DEFAULT_TIP_LAND_M: f64 = 0.4e-3;

/// Limit of the tolerance field of ISO 606.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum GapForm {
    /// Smallest gap: the seat is close, the pressure angle small.
    Min,
    /// Largest gap.
    Max,
}

/// Dimensions of a sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SprocketSpec {
    pub teeth: u32,
    pub pitch_m: f64,
    /// Roller or bush diameter d_1 [m].
    pub roller_diameter_m: f64,
    pub form: GapForm,
    /// d_a [m]; None takes the middle of the range that the standard and the tooth allow.
    pub tip_diameter_m: Option<f64>,
}

/// The dimensions of the tooth gap.
#[derive(Clone, Debug, PartialEq)]
pub struct Sprocket {
    pub spec: SprocketSpec,
    pub pitch_radius_m: f64,
    pub root_radius_m: f64,
    pub tip_radius_m: f64,
    pub tip_radius_min_m: f64,
    pub tip_radius_max_m: f64,
    pub seat_radius_m: f64,
    /// Angle alpha that the seating arc subtends [rad].
    pub seat_angle_rad: f64,
    /// Distance of the seat centre from the axis [m], on the gap axis.
    pub seat_centre_m: f64,
    pub flank_radius_m: f64,
    /// Centre of the flank arc on the side +x of the gap frame.
    pub flank_centre: Vec2,
    /// Transition of seat and flank on the side +x.
    pub seat_end: Vec2,
    /// Corner of flank and tip land on the side +x.
    pub tip_corner: Vec2,
    /// Radius at which the two flanks of a tooth would meet [m].
    pub pointed_radius_m: f64,
    /// Length of the tip land along the tip circle [m].
    pub tip_land_m: f64,
    /// Pressure angle at the seat end, to the link chord [rad]: gamma = 90 deg - alpha/2 - 180 deg/z.
    pub seat_pressure_angle_rad: f64,
    /// Smallest gap between flank and bush while its link swings in or out [m]; negative: undercut needed.
    pub articulation_clearance_m: f64,
    /// Displacement of each gap from its nominal position (damage, runout, pitch errors), outwards and counterclockwise
    /// [m]; empty: none is displaced.
    pub gap_shifts: Vec<Vec2>,
}

/// Why no tooth can be made, each with a value that would work.
#[derive(Clone, Debug, PartialEq)]
pub enum SprocketError {
    Teeth(u32),
    /// Roller too large for the pitch or not positive: largest diameter that leaves a tooth [m].
    Roller {
        largest_m: f64,
    },
    /// Tip circle beyond the point where the flanks meet: largest tip diameter [m].
    Pointed {
        largest_tip_diameter_m: f64,
    },
    /// Tip circle so low that no flank is left, or below the pitch circle: smallest tip diameter [m].
    LowTip {
        smallest_tip_diameter_m: f64,
    },
    /// The flank interferes with the swinging bush by this much [m].
    Undercut {
        interference_m: f64,
    },
}

impl std::fmt::Display for SprocketError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            SprocketError::Teeth(z) => {
                write!(f, "{z} teeth are outside {} ..= {}", TEETH_RANGE.start(), TEETH_RANGE.end())
            }
            SprocketError::Roller { largest_m } => {
                write!(f, "the roller leaves no tooth; this pitch takes at most {:.3} mm", largest_m / MM)
            }
            SprocketError::Pointed { largest_tip_diameter_m } => write!(
                f,
                "the tooth is pointed below this tip circle; at most {:.3} mm is possible",
                largest_tip_diameter_m / MM
            ),
            SprocketError::LowTip { smallest_tip_diameter_m } => {
                write!(
                    f,
                    "the tip circle cuts off the working flank; at least {:.3} mm is needed",
                    smallest_tip_diameter_m / MM
                )
            }
            SprocketError::Undercut { interference_m } => write!(
                f,
                "the flank stands {:.1} um in the way of the bush that swings in; take more teeth, a smaller bush or the maximum form",
                interference_m * 1e6
            ),
        }
    }
}

impl std::error::Error for SprocketError {}

impl Sprocket {
    /// Computes the tooth gap and checks it.
    pub fn new(spec: SprocketSpec) -> Result<Sprocket, SprocketError> {
        let SprocketSpec { teeth, pitch_m, roller_diameter_m, form, tip_diameter_m } = spec;
        if !TEETH_RANGE.contains(&teeth) {
            return Err(SprocketError::Teeth(teeth));
        }
        let z = f64::from(teeth);
        let half_pitch_angle = PI / z;
        let pitch_radius_m = 0.5 * pitch_m / sin_cos(half_pitch_angle).0;
        let largest_roller_m = 0.8 * pitch_m;
        if !(roller_diameter_m > 0.0 && roller_diameter_m <= largest_roller_m) {
            return Err(SprocketError::Roller { largest_m: largest_roller_m });
        }
        let root_radius_m = pitch_radius_m - 0.5 * roller_diameter_m;
        let d1_mm = roller_diameter_m / MM;
        let (seat_radius_m, flank_radius_m, seat_angle_rad) = match form {
            GapForm::Min => (0.505 * roller_diameter_m, 0.12 * roller_diameter_m * (z + 2.0), (140.0 - 90.0 / z) * DEG),
            GapForm::Max => (
                (0.505 * d1_mm + 0.069 * libm::cbrt(d1_mm)) * MM,
                0.008 * roller_diameter_m * (z * z + 180.0),
                (120.0 - 90.0 / z) * DEG,
            ),
        };
        let seat_centre_m = root_radius_m + seat_radius_m;
        let (sin_half, cos_half) = sin_cos(0.5 * seat_angle_rad);
        let to_seat_end = Vec2::new(sin_half, -cos_half);
        let seat_centre = Vec2::new(0.0, seat_centre_m);
        let seat_end = seat_centre + to_seat_end * seat_radius_m;
        let flank_centre = seat_centre + to_seat_end * (seat_radius_m + flank_radius_m);

        // The tooth axis is the ray at pi/z from the gap axis; the flank circle meets it at the pointed radius.
        let (sin_t, cos_t) = sin_cos(half_pitch_angle);
        let tooth_axis = Vec2::new(sin_t, cos_t);
        let along = flank_centre.dot(&tooth_axis);
        let reach = flank_radius_m * flank_radius_m - (flank_centre.norm_squared() - along * along);
        if reach <= 0.0 || super::cross(seat_end, tooth_axis) >= 0.0 {
            return Err(SprocketError::Roller { largest_m: largest_roller_m.min(0.9 * roller_diameter_m) });
        }
        let pointed_radius_m = along + libm::sqrt(reach);

        let tip_radius_min_m = pitch_radius_m + 0.5 * (pitch_m * (1.0 - 1.6 / z) - roller_diameter_m);
        let tip_radius_max_m = pitch_radius_m + 0.5 * (1.25 * pitch_m - roller_diameter_m);
        let flank = FlankCircle { centre: flank_centre, radius_m: flank_radius_m };
        let tip_radius_m = match tip_diameter_m {
            Some(d) => 0.5 * d,
            None => {
                let mut high = tip_radius_max_m.min(pointed_radius_m);
                while flank.tip_land_m(high, half_pitch_angle) < DEFAULT_TIP_LAND_M && high > tip_radius_min_m {
                    high -= 1e-3 * pitch_m;
                }
                0.5 * (tip_radius_min_m + high.max(tip_radius_min_m))
            }
        };
        if tip_radius_m >= pointed_radius_m {
            let floor_mm = libm::floor(2.0 * pointed_radius_m / MM * 1e3 - 1.0) / 1e3;
            return Err(SprocketError::Pointed { largest_tip_diameter_m: floor_mm * MM });
        }
        // A flank must be left above the seat, and the pitch circle must stay inside the gap.
        let lowest = seat_end.norm().max(pitch_radius_m) + 0.02 * pitch_m;
        if tip_radius_m.is_nan() || tip_radius_m < lowest {
            return Err(SprocketError::LowTip { smallest_tip_diameter_m: 2.0 * lowest });
        }
        let tip_corner = flank.at_radius(tip_radius_m);
        let mut sprocket = Sprocket {
            spec,
            pitch_radius_m,
            root_radius_m,
            tip_radius_m,
            tip_radius_min_m,
            tip_radius_max_m,
            seat_radius_m,
            seat_angle_rad,
            seat_centre_m,
            flank_radius_m,
            flank_centre,
            seat_end,
            tip_corner,
            pointed_radius_m,
            tip_land_m: flank.tip_land_m(tip_radius_m, half_pitch_angle),
            seat_pressure_angle_rad: 0.5 * PI - 0.5 * seat_angle_rad - half_pitch_angle,
            articulation_clearance_m: 0.0,
            gap_shifts: Vec::new(),
        };
        sprocket.articulation_clearance_m = sprocket.swing_clearance_m();
        if sprocket.articulation_clearance_m < -SWING_TOLERANCE_M {
            return Err(SprocketError::Undercut { interference_m: -sprocket.articulation_clearance_m });
        }
        Ok(sprocket)
    }

    /// The tooth with its gaps cut deeper by `relief_m`: a nominal bush on the pitch circle has this gap at the root
    /// and needs another support.
    pub fn relieved(mut self, relief_m: f64) -> Result<Sprocket, SprocketError> {
        let down = Vec2::new(0.0, relief_m);
        let flank = FlankCircle { centre: self.flank_centre - down, radius_m: self.flank_radius_m };
        let half_pitch_angle = 0.5 * self.pitch_angle_rad();
        self.flank_centre = flank.centre;
        self.seat_end -= down;
        self.seat_centre_m -= relief_m;
        self.root_radius_m -= relief_m;
        self.tip_land_m = flank.tip_land_m(self.tip_radius_m, half_pitch_angle);
        self.tip_corner = flank.at_radius(self.tip_radius_m);
        if self.tip_land_m.is_nan() || self.tip_land_m <= 0.0 {
            return Err(SprocketError::Pointed { largest_tip_diameter_m: 2.0 * (self.tip_radius_m - relief_m) });
        }
        self.articulation_clearance_m = self.swing_clearance_m();
        Ok(self)
    }

    /// Displacement of gap `tooth` from its nominal position: outwards, counterclockwise [m].
    pub fn gap_shift_m(&self, tooth: u32) -> Vec2 {
        self.gap_shifts.get(tooth as usize).copied().unwrap_or_else(Vec2::zeros)
    }

    /// Angle between two gaps [rad].
    pub fn pitch_angle_rad(&self) -> f64 {
        2.0 * PI / f64::from(self.spec.teeth)
    }

    /// Rolling radius z p / (2 pi) [m]: mean chain speed = rolling radius x speed.
    pub fn rolling_radius_m(&self) -> f64 {
        f64::from(self.spec.teeth) * self.spec.pitch_m / (2.0 * PI)
    }

    /// Elements of one gap in the gap frame, from the axis of the tooth on the side +x to that of the tooth on the side
    /// -x: tip land, flank, seat, flank, tip land. The material is on the left.
    pub fn gap_elements(&self) -> [Element; 5] {
        let half = 0.5 * self.pitch_angle_rad();
        let axis = 0.5 * PI;
        let corner_rad = atan2(self.tip_corner.y, self.tip_corner.x);
        let origin = Vec2::zeros();
        let land = |start_rad: f64, end_rad: f64| Element::Arc {
            centre: origin,
            radius_m: self.tip_radius_m,
            start_rad,
            sweep_rad: end_rad - start_rad,
        };
        let c = self.flank_centre;
        let at_corner = atan2(self.tip_corner.y - c.y, self.tip_corner.x - c.x);
        let at_seat = atan2(self.seat_end.y - c.y, self.seat_end.x - c.x);
        // Both angles are near pi: wraps the sweep into (0, pi).
        let sweep = crate::units::wrap_angle(at_seat - at_corner);
        let right = Element::Arc { centre: c, radius_m: self.flank_radius_m, start_rad: at_corner, sweep_rad: sweep };
        let left = Element::Arc {
            centre: Vec2::new(-c.x, c.y),
            radius_m: self.flank_radius_m,
            start_rad: PI - at_seat,
            sweep_rad: sweep,
        };
        let seat = Element::Arc {
            centre: Vec2::new(0.0, self.seat_centre_m),
            radius_m: self.seat_radius_m,
            start_rad: -0.5 * PI + 0.5 * self.seat_angle_rad,
            sweep_rad: -self.seat_angle_rad,
        };
        [land(axis - half, corner_rad), right, seat, left, land(PI - corner_rad, axis + half)]
    }

    /// The whole contour in the sprocket's frame: gap k has its axis at angle k x 2 pi / z from +x. Elements of gap k
    /// are 5k .. 5k+5 as in [`Sprocket::gap_elements`].
    pub fn profile(&self) -> Result<Profile, ProfileError> {
        let gap = self.gap_elements();
        let mut elements = Vec::with_capacity(5 * self.spec.teeth as usize);
        for k in 0..self.spec.teeth {
            let turn = f64::from(k) * self.pitch_angle_rad() - 0.5 * PI;
            elements.extend(gap.iter().map(|e| e.moved(turn, Vec2::zeros())));
        }
        Profile::new(elements, true)
    }

    /// Smallest gap between the flank and a bush that swings about the neighbouring seated joint through one pitch
    /// angle [m]. Nominal bush, nominal pitch, seated on the pitch circle.
    fn swing_clearance_m(&self) -> f64 {
        const SAMPLES: u32 = 64;
        let pitch_angle = self.pitch_angle_rad();
        let seated = Vec2::new(0.0, self.pitch_radius_m);
        let neighbour = unit(0.5 * PI + pitch_angle) * self.pitch_radius_m;
        let bush_radius = 0.5 * self.spec.roller_diameter_m;
        let profile = self.gap_elements();
        let mut smallest = f64::INFINITY;
        for k in 0..=SAMPLES {
            let turn = pitch_angle * f64::from(k) / f64::from(SAMPLES);
            // The link straightens: the bush swings outwards about the neighbour.
            let bush = neighbour + super::rotated(seated - neighbour, turn);
            for element in &profile {
                if (0.0..=1.0).contains(&element.foot_along(bush)) {
                    smallest = smallest.min(element.closest(bush).distance_m - bush_radius);
                }
            }
        }
        smallest
    }
}

/// Interference below this is rounding of the construction [m]: the nominal bush contacts the root exactly when seated.
const SWING_TOLERANCE_M: f64 = 1e-9;

struct FlankCircle {
    centre: Vec2,
    radius_m: f64,
}

impl FlankCircle {
    /// Point of the flank at a distance `radius_m` from the axis, on the side of the gap.
    fn at_radius(&self, radius_m: f64) -> Vec2 {
        let d2 = self.centre.norm_squared();
        let along = 0.5 * (radius_m * radius_m - self.radius_m * self.radius_m + d2) / d2;
        let height = libm::sqrt((radius_m * radius_m / d2 - along * along).max(0.0));
        // Of the two intersections the one further counterclockwise is on the gap's side.
        self.centre * along + super::perp(self.centre) * height
    }

    fn tip_land_m(&self, tip_radius_m: f64, half_pitch_angle_rad: f64) -> f64 {
        let corner = self.at_radius(tip_radius_m);
        let from_axis = 0.5 * PI - atan2(corner.y, corner.x);
        2.0 * tip_radius_m * (half_pitch_angle_rad - from_axis)
    }
}
