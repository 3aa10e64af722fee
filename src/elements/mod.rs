//! Everything that makes a force. Each file opens with its equation, its sign convention and its source, and computes its
//! own share of the energy ledger.

pub mod beam;
pub mod body_frame;
pub mod contact_law;
pub mod coordinate;
pub mod coupling;
pub mod driver_motion;
pub mod friction;
pub mod hydraulics;
pub mod lift_law;
pub mod link_joint;
pub mod load;
pub mod oil;
pub mod passage;
pub mod plain_bearing;
pub mod span;
pub mod torsion;
