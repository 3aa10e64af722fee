//! What turns a sprocket from outside: a prescribed speed, or an inertia with a load torque.
//!
//! ```text
//! driver   omega = const                       work in  = -T_chain omega dt
//! driven   J omega' = T_chain - T_load sgn     work out = T_load omega dt
//! ```
//! T_chain is the torque of all chain contacts on the sprocket; the load always points against the sense in which the chain
//! turns the sprocket. During run-in a damper pulls the speed towards its nominal value.

/// Outer connection of a sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rotor {
    /// Speed prescribed [rad/s], counterclockwise positive.
    Driven { speed_rad_s: f64 },
    /// Turns freely under chain and load.
    Free {
        inertia_kg_m2: f64,
        /// Torque on the sprocket [N m], counterclockwise positive; negative of the load for a sprocket that turns
        /// counterclockwise.
        torque_nm: f64,
    },
}

impl Rotor {
    /// Inverse inertia [1/(kg m2)]; zero where the speed is prescribed.
    pub fn inverse_inertia(&self) -> f64 {
        match *self {
            Rotor::Driven { .. } => 0.0,
            Rotor::Free { inertia_kg_m2, .. } => 1.0 / inertia_kg_m2,
        }
    }

    /// Torque from outside that is known beforehand [N m].
    pub fn outer_torque_nm(&self) -> f64 {
        match *self {
            Rotor::Driven { .. } => 0.0,
            Rotor::Free { torque_nm, .. } => torque_nm,
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
