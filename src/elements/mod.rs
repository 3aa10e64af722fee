//! Everything that makes a force. Each file opens with its equation, its sign convention and its source, and computes its
//! own share of the energy ledger.

pub mod arc_lanes;
pub mod beam;
pub mod blade;
pub mod body_frame;
pub mod contact_law;
pub mod contour_forces;
pub mod coordinate;
pub mod coupling;
pub mod driver_motion;
pub mod end_contact;
pub mod flank_lanes;
pub mod friction;
pub mod guide_contact;
pub mod hydraulics;
pub mod link_joint;
pub mod load;
pub mod oil;
pub mod passage;
pub mod plain_bearing;
pub mod rail_contact;
pub mod span;
pub mod tooth_contact;
pub mod touch;
