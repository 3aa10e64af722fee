//! pitchline: a headless simulator and visual debugger for chain drives.
//!
//! A drive file is read ([`drive`]), assembled ([`assemble`](mod@assemble)) into a [`model`], stepped and recorded ([`simulate`],
//! [`recording`]), stopped at expressions ([`breakpoint`]), or compared with measured records ([`identify`](mod@identify)). The programs in `examples/`
//! show each of these. Quantities are SI and radians, with their units at the end of their names; the same input gives the
//! same bits on every processor.
//!
//! ```
//! use pitchline::{drive::Drive, simulate::Simulation};
//!
//! // A bundled drive with its first tooth gap of the driver 30 um too shallow.
//! let set = ["gap=0", "outward_um=30"].map(|value| format!("effects.gap_error.driver.{value}"));
//! let (name, text) = pitchline::drive::BUNDLED[0];
//! let drive = Drive::parse(name, text, &set)?;
//! let mut simulation = Simulation::new(&drive)?;
//! simulation.stop_at("impact.approach_speed > 1.5 m/s and impact.body == \"driver\"")?;
//! // At most 20 ms, a frame every 50 us, no recording.
//! let summary = simulation.run(20e-3, 50e-6, &[])?;
//! let hit = summary.hits.first().ok_or("no such impact")?;
//! println!("{:.3} ms: {:?}", hit.t_s * 1e3, hit.subject);
//! println!("{} contacts at this instant", simulation.frame()?.contacts.link.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Modules without documentation here are the inside of the program `pitchline`, public for its tests alone; they change without
//! notice. ARCHITECTURE.md is their map.

#![warn(missing_docs)]
// Units stand in brackets, such as [m], which rustdoc takes for links; heads of files speak of private items below them.
#![allow(rustdoc::broken_intra_doc_links, rustdoc::private_intra_doc_links)]

pub mod assemble;
pub mod breakpoint;
pub mod diag;
pub mod drive;
pub mod identify;
pub mod machine;
pub mod measurement;
pub mod model;
pub mod recording;
pub mod simulate;

// The inside of the program, public for src/main.rs, tests, benches and fuzzers.
#[doc(hidden)]
pub mod aligned;
#[doc(hidden)]
pub mod analysis;
#[doc(hidden)]
pub mod cli;
#[doc(hidden)]
pub mod compare;
#[doc(hidden)]
pub mod effects;
#[doc(hidden)]
pub mod elements;
#[doc(hidden)]
pub mod engagement;
#[doc(hidden)]
pub mod geometry;
#[doc(hidden)]
pub mod impacts;
#[doc(hidden)]
pub mod input;
#[doc(hidden)]
pub mod integrate;
#[doc(hidden)]
pub mod lanes;
#[cfg(any(feature = "live", feature = "http"))]
#[doc(hidden)]
pub mod local_server;
#[doc(hidden)]
pub mod lumping;
#[doc(hidden)]
pub mod output;
#[doc(hidden)]
pub mod pairs;
#[doc(hidden)]
pub mod products;
#[doc(hidden)]
pub mod random;
#[doc(hidden)]
pub mod render;
#[doc(hidden)]
pub mod replay;
#[doc(hidden)]
pub mod reproduce;
#[doc(hidden)]
pub mod sensing;
#[doc(hidden)]
pub mod side_by_side;
#[doc(hidden)]
pub mod state;
#[doc(hidden)]
pub mod statics;
#[doc(hidden)]
pub mod statistics;
#[doc(hidden)]
pub mod study;
#[doc(hidden)]
pub mod units;
