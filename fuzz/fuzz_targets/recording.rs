//! Any bytes are a recording or an error that can be printed; never a panic, never much memory.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run recording fuzz/corpus/recording recordings/samples -- -max_total_time=600 -rss_limit_mb=512 -max_len=65536
#![no_main]

use libfuzzer_sys::fuzz_target;
use pitchline::recording::reader::{Flow, Reader, WHOLE, Wanted};

fuzz_target!(|data: &[u8]| {
    // The reader seeks; a file in memory is quick enough.
    let path = std::path::PathBuf::from(format!("/dev/shm/pitchline-fuzz-{}.mcap", std::process::id()));
    if std::fs::write(&path, data).is_err() {
        return;
    }
    match Reader::open(&path) {
        Ok(mut reader) => {
            let wanted = Wanted { frames: true, heads: false, keyframes: true, events: true, impacts: true };
            let read = reader.each(wanted, WHOLE, |_| Ok(Flow::On));
            let _printable = read.map_err(|e| format!("{e:#}"));
            let _near = reader.frame_at(1e-3).map_err(|e| format!("{e:#}"));
            let _before = reader.keyframe_before(1e-3).map_err(|e| format!("{e:#}"));
            let _loss = reader.loss();
        }
        Err(e) => assert!(!format!("{e:#}").is_empty()),
    }
});
