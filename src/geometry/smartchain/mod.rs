//! Abutment chains: two shaped abutments on the inner side of each link guide it onto a sprocket without impact.
//!
//! Next to the teeth a ring turns with the sprocket. During hand-over the ring lifts the front abutment of a link, and
//! with it the front joint, along a path that leaves the straight line and joins the pitch circle with continuous
//! acceleration; the rear joint still slides along a straight guide. The guide's face is tangent to the ring at its
//! top. On the way out the rear abutment, a mirror image, does the same in reverse.
//!
//! | file | what |
//! |---|---|
//! | `path` | the joint's path, the motion of sprocket and link against each other, loop closure, quasi-static forces |
//! | `two_link` | the path over two links: more room for smoothness, wider abutments |
//! | `fit` | smooth curves as few tangent arcs, to a given deviation |
//! | `contour` | contours as arcs: closest point, support |
//! | `abutment` | the contour of the abutment, its limits and clearances |
//! | `ring` | the ring of the second sprocket: lobed, conjugate to the one contour a link has |

pub mod abutment;
pub mod contour;
pub mod fit;
pub mod path;
pub mod ring;
pub mod two_link;

pub use abutment::{Abutment, AbutmentError, AbutmentSide, AbutmentSpec};
pub use contour::{AbutmentContour, ContourArc, ContourError, ContourFoot};
pub use path::{Inclination, LinkMotion, PointMotion, Transition, TransitionError, centre_distance, centre_distance_m};
pub use ring::{LobedRing, RingContact, RingError, fits_hollow};
pub use two_link::{LinkInclination, TwoLinks};
