//! What recordings tell: plain results from Headers, Frames and Impacts.

pub mod suspects;
