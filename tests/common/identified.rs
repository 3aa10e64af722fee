//! Reading a measurement file and everything it names, and identifying.

use pitchline::identify::identify;
use pitchline::identify::report::IdentificationReport;
use pitchline::identify::search::{Budget, Context};
use pitchline::machine::Machine;
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::Memory;
use pitchline::measurement::segments::load;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64};

/// Reads a measurement file and everything it names, and identifies.
pub fn identified(path: &Path, threads: usize, budget: Budget) -> Result<IdentificationReport, String> {
    let text = std::fs::read_to_string(path).map_err(|e| e.to_string())?;
    let measurement = Measurement::parse(&path.display().to_string(), &text).map_err(|r| r.to_string())?;
    let folder = path.parent().map_or_else(PathBuf::new, PathBuf::from);
    let drive = std::fs::read_to_string(folder.join(&measurement.drive)).map_err(|e| e.to_string())?;
    let machine = Machine::parse(&measurement.drive, &drive, &[]).map_err(|r| r.to_string())?;
    let data =
        load(&measurement, &machine, &folder, &mut Memory::for_program(1_000_000_000)).map_err(|e| e.to_string())?;
    let (stop, runs) = (AtomicBool::new(false), AtomicU64::new(0));
    let quiet = |_: &str, _: u64| {};
    let context =
        Context { threads, budget, started: std::time::Instant::now(), stop: &stop, progress: &quiet, runs: &runs };
    identify(&measurement, &machine, &data, &context).map_err(|e| e.to_string())
}

pub const ALL: Budget = Budget { runs: None, seconds: None };

/// Paths of the effects that a report gives.
pub fn paths(r: &IdentificationReport) -> Vec<&str> {
    r.effects.iter().map(|e| e.path.as_str()).collect()
}
