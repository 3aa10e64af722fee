//! Geometry without masses and time: arc-and-line profiles, sprocket teeth, chain links, guides, and the route of a
//! chain around its sprockets.

pub mod chain;
pub mod element_gap;
pub mod guide;
pub mod profile;
pub mod rail;
pub mod route;
pub mod silent_sprocket;
pub mod smartchain;
pub mod sprocket;

/// A point or vector in the plane [m].
pub type Vec2 = nalgebra::Vector2<f64>;

/// `v` rotated by +90 degrees.
pub fn perp(v: Vec2) -> Vec2 {
    Vec2::new(-v.y, v.x)
}

/// z component of a x b.
pub fn cross(a: Vec2, b: Vec2) -> f64 {
    a.x * b.y - a.y * b.x
}

/// Unit vector at `angle_rad` from +x.
pub fn unit(angle_rad: f64) -> Vec2 {
    let (s, c) = crate::units::sin_cos(angle_rad);
    Vec2::new(c, s)
}

/// `v` rotated by `angle_rad`.
pub fn rotated(v: Vec2, angle_rad: f64) -> Vec2 {
    let e = unit(angle_rad);
    Vec2::new(e.x * v.x - e.y * v.y, e.y * v.x + e.x * v.y)
}
