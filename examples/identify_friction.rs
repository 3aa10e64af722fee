//! Compares a lumped drive with measured records and prints the effect that the drive lacks.
//!
//! `cargo run --release --example identify_friction -- tests/data/rig/rig-measured.toml`

use pitchline::identify::identify;
use pitchline::identify::search::{Budget, Context};
use pitchline::identify::updated::updated;
use pitchline::machine::Machine;
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::Memory;
use pitchline::measurement::segments::load;
use std::error::Error;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "tests/data/rig/rig-measured.toml".into());
    print!("{}", report(Path::new(&path))?);
    Ok(())
}

/// What this program prints.
pub fn report(path: &Path) -> Result<String, Box<dyn Error>> {
    // The measurement file names the drive and the measured files, all beside it.
    let folder = path.parent().unwrap_or(Path::new("."));
    let measurement = Measurement::parse(&path.display().to_string(), &std::fs::read_to_string(path)?)?;
    let drive = std::fs::read_to_string(folder.join(&measurement.drive))?;
    let machine = Machine::parse(&measurement.drive, &drive, &[])?;
    // At most 100 MB of measured values.
    let data = load(&measurement, &machine, folder, &mut Memory::for_program(100_000_000))?;
    // Another thread may set `stop`; the budget may limit runs or seconds; `progress` is told every stage.
    let (stop, runs) = (AtomicBool::new(false), AtomicU64::new(0));
    let context = Context {
        threads: 2,
        budget: Budget { runs: None, seconds: None },
        started: std::time::Instant::now(),
        stop: &stop,
        progress: &|_, _| (),
        runs: &runs,
    };
    let found = identify(&measurement, &machine, &data, &context)?;
    let mut told = format!("{:?}\n", found.outcome);
    for effect in &found.effects {
        told += &format!("{}\n", effect.path);
        for number in &effect.parameters {
            told += &format!("  {} = {:.4} +- {:.4}\n", number.path, number.value, number.standard_error);
        }
    }
    // The drive file with the fitted numbers and the new effect.
    let updated = updated(&machine, &found)?;
    told += &format!("{} lines of the updated drive\n", updated.lines().count());
    Ok(told)
}
