//! Couplings: springs with dampers between two coordinates, as shafts between discs are, and parts of a spring between its masses. Of what slides
//! ways [m] stand in place of angles, forces [N] in place of torques.
//!
//! ```text
//! M = k (q_b - q_a) + c (q_b' - q_a')      on a; -M on b; stored = k (q_b - q_a)^2 / 2, lost = c (q_b' - q_a')^2 dt
//! ```
//! Both coordinates are counted on over turns together, so that the spring is free of torque where the discs stand as they were drawn.

/// A spring and a damper between two coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Coupling {
    /// In the drive file.
    pub path: String,
    /// Indices of the coordinates a and b.
    pub ends: [usize; 2],
    pub stiffness_nm_per_rad: f64,
    pub damping_nm_s_per_rad: f64,
}

impl Coupling {
    /// Torque of the spring, and of the damper, on a [N m]: `at`, `speed` of a and b.
    #[inline(always)]
    pub fn torques_nm(&self, at: [f64; 2], speed: [f64; 2]) -> (f64, f64) {
        (self.stiffness_nm_per_rad * (at[1] - at[0]), self.damping_nm_s_per_rad * (speed[1] - speed[0]))
    }

    /// Energy stored at these angles [J].
    pub fn energy_j(&self, at: [f64; 2]) -> f64 {
        0.5 * self.stiffness_nm_per_rad * (at[1] - at[0]) * (at[1] - at[0])
    }
}
