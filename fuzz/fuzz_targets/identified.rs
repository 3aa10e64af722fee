//! Any bytes as a small measured machine, and a whole run of `identify` on it: an answer or a reason, never a panic, never an answer behind its
//! budget that does not say so.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run identified -- -max_total_time=36000 -rss_limit_mb=2048 -max_len=4000 -timeout=60
#![no_main]

#[path = "../../tests/problems/mod.rs"]
mod problems;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let folder = std::path::PathBuf::from(format!("/dev/shm/pitchline-fuzz-identified-{}", std::process::id()));
    problems::SmallProblem::new(data, &folder).answers(&folder);
});
