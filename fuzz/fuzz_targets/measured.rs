//! Any bytes as a measured file of each kind: columns, or an error that can be printed; never a panic, never more memory than allowed. The
//! first byte says which kind.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run measured fuzz/corpus/measured tests/data/strangers -- -max_total_time=3600 -rss_limit_mb=1024 -max_len=65536
#![no_main]

use libfuzzer_sys::fuzz_target;
use pitchline::measurement::columns::{ColumnSelection, FileLayout, Memory, read};

const KINDS: [&str; 5] = ["csv", "parquet", "mf4", "csv.gz", "mcap"];

fuzz_target!(init: pitchline::measurement::contained::silence_contained_panics(), |data: &[u8]| {
    let Some((kind, bytes)) = data.split_first() else { return };
    // Fixtures begin as their kind does.
    let (kind, bytes) = match data {
        [b'P', b'A', b'R', b'1', ..] => ("parquet", data),
        [b'M', b'D', b'F', ..] => ("mf4", data),
        [0x1f, 0x8b, ..] => ("csv.gz", data),
        _ => (KINDS[usize::from(*kind) % KINDS.len()], bytes),
    };
    let path = std::path::PathBuf::from(format!("/dev/shm/pitchline-fuzz-measured-{}.{kind}", std::process::id()));
    if std::fs::write(&path, bytes).is_err() {
        return;
    }
    match read(&path, FileLayout::default(), ColumnSelection::All, &mut Memory::for_program(100_000_000)) {
        Ok(columns) => {
            let fits = |(values, wrong): (&Vec<f64>, &Option<String>)| values.len() == columns.rows() || wrong.is_some();
            assert!(columns.values.iter().zip(&columns.wrong).all(fits));
        }
        Err(e) => assert!(!e.to_string().is_empty()),
    }
});
