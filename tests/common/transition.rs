//! How a joint of an abutment chain comes to its seat, for comparisons with runs and tables.

use pitchline::geometry::Vec2;
use pitchline::geometry::smartchain::Transition;
use pitchline::units::sin_cos;

/// Distance of the joint at `tau` from its seat, in the frame of the turning sprocket: outwards along the seat's
/// radius, and ahead of it in the sense of rotation [m]. It decreases with the third power of 1 - tau: seating
/// without impact.
pub fn approach_to_seat_m(transition: &Transition, tau: f64) -> (f64, f64) {
    let pin = transition.pin(tau).position;
    let (sin, cos) = sin_cos(transition.seat_angle_at_rad(tau));
    let (radial, ahead) = (Vec2::new(sin, cos), Vec2::new(cos, -sin));
    (pin.dot(&radial) - transition.pitch_radius_m, pin.dot(&ahead))
}
