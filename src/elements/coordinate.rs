//! Coordinates: the numbers that sprockets, shafts and arms turn by and sliders move by, and the forces on them besides the chain's.
//!
//! ```text
//! prescribed   q' = const                                       work in  = -Q_chain q' dt
//! held         q' = 0
//! free         I q'' = Q_chain + Q_parts + Q + k (q_free - q) - c q'
//!              work out = -Q q' dt, lost = c q'^2 dt, stored = k (q - q_free)^2 / 2
//! ```
//! q is an angle [rad], I an inertia [kg m2], a force a torque [N m]; for a coordinate that slides, q is a way [m], I a mass [kg] and a force a
//! force [N]. Q_chain is the force of all chain contacts on the bodies that the coordinate carries, Q_parts that of parts that touch each other ([`crate::pairs::part_part`]) and of oil ([`super::hydraulics`]); Q is constant: the load of a sprocket
//! points against the sense in which the chain turns it. The damper sees the speed at the node, the mean of the speeds half a step before and after, so that it takes
//! exactly the energy that it is said to take, at any step. During run-in a second damper pulls the speed towards its nominal value.

/// One number that moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Coordinate {
    /// In the drive file: the sprocket, shaft, arm, slider or ball that it moves.
    pub path: String,
    pub kind: CoordinateKind,
    pub motion: CoordinateMotion,
    pub spring: CoordinateSpring,
    /// Its speed when the chain moves at its nominal speed [rad/s]; zero for what slides.
    pub nominal_speed_rad_s: f64,
    /// Largest distance from the axis at which the chain acts [m]: converts angles and torques into ways and forces. 1 for what slides.
    pub reach_m: f64,
    /// Constant force in place of the oil's where the drive is assembled at rest [N m, N].
    pub rest_load: f64,
    /// Stands still while the drive is assembled at rest: a ball on its seat.
    pub is_held_at_rest: bool,
    /// Is drawn to its nominal speed while the drive is run in.
    pub is_run_in: bool,
}

/// How a coordinate moves what it carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoordinateKind {
    Turns,
    Slides,
}

/// What rules a coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CoordinateMotion {
    /// Speed prescribed [rad/s], counterclockwise positive.
    Prescribed { speed_rad_s: f64 },
    /// Stands where it is: the pawl of a ratchet between two clicks.
    Held,
    Free {
        /// Inertia [kg m2] or mass [kg].
        inertia: f64,
        /// Constant force from outside [N m, N], in the sense of the coordinate; negative of the load for a sprocket that turns
        /// counterclockwise.
        load: f64,
    },
}

/// Spring with a damper beside it, between a coordinate and the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CoordinateSpring {
    /// [N m/rad, N/m].
    pub stiffness: f64,
    /// Where it is free of force [rad, m].
    pub free: f64,
    /// [N m s/rad, N s/m].
    pub damping: f64,
}

impl CoordinateSpring {
    /// Force on the coordinate at `at` [N m, N].
    #[inline(always)]
    pub fn force(&self, at: f64) -> f64 {
        self.stiffness * (self.free - at)
    }

    /// Stored at `at` [J].
    #[inline(always)]
    pub fn energy_j(&self, at: f64) -> f64 {
        0.5 * self.stiffness * (self.free - at) * (self.free - at)
    }

    /// Whether there is one.
    pub fn is_present(&self) -> bool {
        *self != CoordinateSpring::default()
    }
}

impl Coordinate {
    /// Adds the inertia of what turns with it; one with a prescribed motion needs none.
    pub fn add_inertia(&mut self, more: f64) {
        if let CoordinateMotion::Free { inertia, .. } = &mut self.motion {
            *inertia += more;
        }
    }

    /// Inverse inertia [1/(kg m2), 1/kg]; zero where the motion is prescribed.
    #[inline(always)]
    pub fn inverse_inertia(&self) -> f64 {
        match self.motion {
            CoordinateMotion::Prescribed { .. } | CoordinateMotion::Held => 0.0,
            CoordinateMotion::Free { inertia, .. } => 1.0 / inertia,
        }
    }

    /// Constant force from outside [N m, N].
    #[inline(always)]
    pub fn load(&self) -> f64 {
        match self.motion {
            CoordinateMotion::Prescribed { .. } | CoordinateMotion::Held => 0.0,
            CoordinateMotion::Free { load, .. } => load,
        }
    }

    /// Force of what prescribes its motion, or of its load, spring, damper and touching parts [N m, N], at a place and a speed. `chain`,
    /// `parts`: forces of the chain and of touching parts.
    pub fn outer_force(&self, at: f64, speed: f64, chain: f64, parts: f64) -> f64 {
        match self.motion {
            CoordinateMotion::Prescribed { .. } | CoordinateMotion::Held => -chain - parts,
            CoordinateMotion::Free { load, .. } if self.spring.is_present() => {
                load + parts + self.spring.force(at) - self.spring.damping * speed
            }
            CoordinateMotion::Free { load, .. } => load + parts,
        }
    }

    pub fn is_free(&self) -> bool {
        matches!(self.motion, CoordinateMotion::Free { .. })
    }

    /// Acceleration at a node [rad/s2, m/s2]. `at`: the coordinate there; `speed`: half a step before it; `force`: of chain and parts.
    #[inline(always)]
    pub fn acceleration(&self, step_s: f64, at: f64, speed: f64, force: f64) -> f64 {
        match self.motion {
            CoordinateMotion::Prescribed { .. } | CoordinateMotion::Held => 0.0,
            CoordinateMotion::Free { inertia, load } => {
                let CoordinateSpring { damping: c, .. } = self.spring;
                let force = force + load + self.spring.force(at);
                // Speed at the node: v + h/2 a.
                (force - c * speed) * (1.0 / (inertia + 0.5 * step_s * c))
            }
        }
    }
}

/// Cosine and sine of an angle that has grown by the small `turn` [rad]: Taylor composition, then one Newton step back onto
/// the unit circle. No trigonometry, so the same bits on every CPU; the error of a step is below turn^5/30.
#[inline(always)]
pub fn turned(cos: f64, sin: f64, turn: f64) -> (f64, f64) {
    let t2 = turn * turn;
    let a = 1.0 - 0.5 * t2;
    let b = turn * (1.0 - t2 / 6.0);
    let c = cos * a - sin * b;
    let s = sin * a + cos * b;
    let scale = 1.5 - 0.5 * (c * c + s * s);
    (c * scale, s * scale)
}
