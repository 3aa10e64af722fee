//! What touches: one file for each kind of contact between two contours, with its equation, its source, the exact touch of one pair and the
//! kernel that does many at a time. Laws of force and friction are in `crate::elements`, and are the same for all.
//!
//! | pair | file |
//! |---|---|
//! | bush or roller, ISO tooth gap | `bush_tooth` (kernel), `bush_gap` (exact) |
//! | roller, its bush | `roller_bush` |
//! | plate end, straight guide | `plate_guide` |
//! | plate, rail of arcs and lines; rail that bends | `plate_rail`, `plate_blade` |
//! | abutment, flank; ring, face, silent tooth | `contour_body` (exact), `arc_lanes`, `flank_lanes` (kernels), `contour_forces` |
//! | parts of tensioners and valves | `part_part` |
//!
//! `contact_group` numbers the groups that a model has: each has a memory in the State and columns in Scratch by its number. Nothing here
//! knows a Model: the steps of `crate::integrate::explicit` load blocks of links, call a kernel and give its forces back.

pub mod arc_lanes;
pub mod bush_gap;
pub mod bush_tooth;
pub mod contact_group;
pub mod contour_body;
pub mod contour_forces;
pub mod flank_lanes;
pub mod part_part;
pub mod plate_blade;
pub mod plate_guide;
pub mod plate_rail;
pub mod roller_bush;
