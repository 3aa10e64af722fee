//! Analysis of recordings: plain results from Headers, Frames and Impacts.

pub mod arrivals;
pub mod audit;
pub mod blame;
pub mod compared_impacts;
pub mod decay;
pub mod diff;
pub mod explain;
pub mod half_power;
pub mod lap;
pub mod mode_shapes;
pub mod mounts;
pub mod order_spectrum;
pub mod order_tracks;
pub mod realisation;
pub mod running_modes;
pub mod signal;
pub mod suspects;
