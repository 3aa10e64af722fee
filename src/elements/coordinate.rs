//! Coordinates: the numbers that sprockets and arms turn by, and what acts on them besides the chain.
//!
//! ```text
//! prescribed   q' = const                                       work in  = -T_chain q' dt
//! free         J q'' = T_chain + T + k (q_free - q) - c q'      work out = -T q' dt, lost = c q'^2 dt, stored = k (q - q_free)^2 / 2
//! ```
//! T_chain is the torque of all chain contacts on the bodies that the coordinate carries; T is constant: the load of a sprocket points
//! against the sense in which the chain turns it. The damper sees the speed at the node, the mean of the speeds half a step before and
//! after, so that it takes exactly the energy that it is said to take, at any step. During run-in a second damper pulls the speed towards
//! its nominal value.

/// One number that moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Coordinate {
    /// In the drive file: the sprocket or arm that it turns.
    pub path: String,
    pub motion: Motion,
    pub spring: TorsionSpring,
    /// Its speed when the chain moves at its nominal speed [rad/s].
    pub nominal_speed_rad_s: f64,
    /// Distance from the axis at which the chain acts, at most [m]: makes ways and forces of angles and torques.
    pub reach_m: f64,
}

/// What rules a coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Speed prescribed [rad/s], counterclockwise positive.
    Prescribed { speed_rad_s: f64 },
    Free {
        inertia_kg_m2: f64,
        /// Constant torque from outside [N m], counterclockwise positive; negative of the load for a sprocket that turns
        /// counterclockwise.
        torque_nm: f64,
    },
}

/// Torsion spring with a damper beside it, between a coordinate and the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TorsionSpring {
    pub stiffness_nm_per_rad: f64,
    /// Angle at which it is free of torque [rad].
    pub free_rad: f64,
    pub damping_nm_s_per_rad: f64,
}

impl TorsionSpring {
    /// Torque on the coordinate [N m].
    #[inline(always)]
    pub fn torque_nm(&self, angle_rad: f64) -> f64 {
        self.stiffness_nm_per_rad * (self.free_rad - angle_rad)
    }

    /// Stored [J].
    #[inline(always)]
    pub fn energy_j(&self, angle_rad: f64) -> f64 {
        0.5 * self.stiffness_nm_per_rad * (self.free_rad - angle_rad) * (self.free_rad - angle_rad)
    }

    /// Whether there is one.
    pub fn is_present(&self) -> bool {
        *self != TorsionSpring::default()
    }
}

impl Coordinate {
    /// Inverse inertia [1/(kg m2)]; zero where the motion is prescribed.
    #[inline(always)]
    pub fn inverse_inertia(&self) -> f64 {
        match self.motion {
            Motion::Prescribed { .. } => 0.0,
            Motion::Free { inertia_kg_m2, .. } => 1.0 / inertia_kg_m2,
        }
    }

    /// Constant torque from outside [N m].
    #[inline(always)]
    pub fn outer_torque_nm(&self) -> f64 {
        match self.motion {
            Motion::Prescribed { .. } => 0.0,
            Motion::Free { torque_nm, .. } => torque_nm,
        }
    }

    /// Torque of what prescribes its motion, or of its load, spring and damper [N m], at an angle and a speed, `chain_nm` that of the chain.
    pub fn outer_torque_on(&self, angle_rad: f64, speed_rad_s: f64, chain_nm: f64) -> f64 {
        match self.motion {
            Motion::Prescribed { .. } => -chain_nm,
            Motion::Free { torque_nm, .. } if self.spring.is_present() => {
                torque_nm + self.spring.torque_nm(angle_rad) - self.spring.damping_nm_s_per_rad * speed_rad_s
            }
            Motion::Free { torque_nm, .. } => torque_nm,
        }
    }

    pub fn is_free(&self) -> bool {
        matches!(self.motion, Motion::Free { .. })
    }

    /// Angular acceleration at a node [rad/s2]: `angle_rad` there, `omega_rad_s` half a step before it, `torque_nm` of the chain.
    #[inline(always)]
    pub fn acceleration(&self, step_s: f64, angle_rad: f64, omega_rad_s: f64, torque_nm: f64) -> f64 {
        match self.motion {
            Motion::Prescribed { .. } => 0.0,
            Motion::Free { inertia_kg_m2, torque_nm: outer_nm } => {
                let TorsionSpring { damping_nm_s_per_rad: c, .. } = self.spring;
                let torque = torque_nm + outer_nm + self.spring.torque_nm(angle_rad);
                // Speed at the node: omega + h/2 alpha.
                (torque - c * omega_rad_s) * (1.0 / (inertia_kg_m2 + 0.5 * step_s * c))
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
