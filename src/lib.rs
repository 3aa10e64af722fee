//! pitchline: a headless simulator and visual debugger for chain drives.
//!
//! See ARCHITECTURE.md for the map. The way through: a drive file is read ([`drive`]), compiled ([`model`]), assembled
//! ([`assemble`]), stepped ([`integrate`]), captured into frames and written to sinks ([`recording`], [`simulate`]).

pub mod aligned;
pub mod analysis;
pub mod assemble;
pub mod breakpoint;
pub mod cli;
pub mod compare;
pub mod contact;
pub mod diag;
pub mod drive;
pub mod effects;
pub mod elements;
pub mod engagement;
pub mod geometry;
pub mod identify;
pub mod impacts;
pub mod input;
pub mod integrate;
#[cfg(any(feature = "live", feature = "http"))]
pub mod local_server;
pub mod lumping;
pub mod machine;
pub mod measurement;
pub mod model;
pub mod output;
pub mod recording;
pub mod render;
pub mod replay;
pub mod sensing;
pub mod simulate;
pub mod state;
pub mod statics;
pub mod units;
