//! Any three texts, parted by lines of `%%%`, are a measurement file, a lumped drive and a CSV, or a report that says what is
//! wrong; never a panic. Data that binds is run once.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run measurement -- -max_total_time=600
#![no_main]

use libfuzzer_sys::fuzz_target;
use pitchline::machine::Machine;
use pitchline::machine::simulate::{Samples, run};
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::{ColumnSelection, FileLayout, Memory, parse_csv};
use pitchline::measurement::segments::from_tables;

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
    let mut memory = Memory::of_program(100_000_000);
    let columns = parse_csv(csv.unwrap_or_default().as_bytes(), FileLayout::default(), ColumnSelection::All, &mut memory);
    let (Ok(machine), Ok(measurement), Ok(columns)) = (machine, measurement, columns) else { return };
    let tables: Vec<_> = measurement.files.iter().map(|f| (f.name.clone(), columns.clone())).collect();
    match from_tables(&measurement, &machine, &tables) {
        Ok(data) => {
            let channels: Vec<usize> = data.channels.iter().map(|c| c.sensor).collect();
            for s in data.segments.iter().take(2) {
                let steps = match &s.task.samples {
                    Samples::Times { t_s, step_s, .. } => t_s.last().copied().unwrap_or(0.0) / step_s,
                    Samples::Pulses { intervals, longest_s, interval_s, .. } => *intervals as f64 * longest_s / interval_s,
                };
                if steps < 2000.0 {
                    let _run = run(&machine, &machine.values, &s.task, &s.start, &channels, 4.0);
                }
            }
        }
        Err(e) => assert!(!e.to_string().is_empty()),
    }
});
