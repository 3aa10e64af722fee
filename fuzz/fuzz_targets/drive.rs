//! Any text is a drive or a report of mistakes that can be printed; never a panic. What parses is placed as well.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run drive fuzz/corpus/drive assets/drives -- -max_total_time=600
#![no_main]

use libfuzzer_sys::fuzz_target;
use pitchline::drive::Drive;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    // The last line may be an override.
    let (body, set) = text.rsplit_once("\n--set ").map_or((text, None), |(b, s)| (b, Some(s.to_string())));
    let overrides: Vec<String> = set.into_iter().collect();
    match Drive::parse("fuzz.toml", body, &overrides) {
        Ok(drive) => match pitchline::model::place(&drive) {
            Ok(_) => {}
            Err(report) => assert!(!report.to_string().is_empty()),
        },
        Err(report) => assert!(!report.to_string().is_empty()),
    }
});
