//! Any three texts, parted by lines of `%%%`, are a measurement file, a lumped drive and a CSV, or a report that says what is
//! wrong; never a panic. Data that binds is run once.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run measurement -- -max_total_time=600
#![no_main]

use libfuzzer_sys::fuzz_target;
use pitchline::machine::Machine;
use pitchline::machine::simulate::{Samples, run};
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::Memory;
use pitchline::measurement::segments::load;

fuzz_target!(|text: &str| {
    let mut parts = text.split("%%%\n");
    let (measurement, drive, csv) = (parts.next(), parts.next(), parts.next());
    let machine = Machine::parse("drive.toml", drive.unwrap_or_default(), &[]);
    if let Err(report) = &machine {
        assert!(!report.to_string().is_empty());
    }
    let measurement = Measurement::parse("measurement.toml", measurement.unwrap_or_default());
    if let Err(report) = &measurement {
        assert!(!report.to_string().is_empty());
    }
    let (Ok(machine), Ok(measurement)) = (machine, measurement) else { return };
    // Every file that it names is the same table; it may name none of this machine.
    let folder = std::path::PathBuf::from(format!("/dev/shm/pitchline-fuzz-measurement-{}", std::process::id()));
    let is_plain = |path: &str| path.strip_suffix(".csv").is_some_and(|n| n.bytes().all(|b| b.is_ascii_alphanumeric()));
    if measurement.files.iter().any(|f| !is_plain(&f.path)) || std::fs::create_dir_all(&folder).is_err() {
        return;
    }
    for f in &measurement.files {
        let _written = std::fs::write(folder.join(&f.path), csv.unwrap_or_default());
    }
    match load(&measurement, &machine, &folder, &mut Memory::for_program(100_000_000)) {
        Ok(data) => {
            let channels: Vec<usize> = data.channels.iter().map(|c| c.sensor).collect();
            for s in data.segments.iter().take(2) {
                let steps = match &s.task.samples {
                    Samples::Times { t_s, step_s, .. } => t_s.last().copied().unwrap_or(0.0) / step_s,
                    Samples::Pulses { intervals, longest_s, interval_s, .. } => {
                        *intervals as f64 * longest_s / interval_s
                    }
                };
                if steps < 2000.0 {
                    let _run = run(&machine, &machine.values, &s.task, &s.start, &channels, 4.0, None);
                }
            }
        }
        Err(e) => assert!(!e.to_string().is_empty()),
    }
    let _removed = std::fs::remove_dir_all(&folder);
});
