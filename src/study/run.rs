//! Running cases on all cores of one machine.

use super::KeepSpec;
use super::bind::{BoundStudy, CaseSpec};
use super::case::{CaseError, run_case};
use crate::assemble::SharedParts;
use crate::drive::Drive;
use crate::simulate::Simulation;
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::sync_channel;
use std::time::Instant;

/// A case and what came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseRow {
    pub case: CaseSpec,
    /// None: missing or not finite. Empty of a case that broke down.
    pub responses: Vec<Option<f64>>,
    /// XXH3-64 of the last State.
    pub state_hash: Option<u64>,
    /// Why there are no responses.
    pub error: Option<String>,
    pub wall_s: f64,
    /// The shard that ran it.
    pub shard: String,
}

impl CaseRow {
    /// Whether another run of the case gave the same bits.
    pub fn is_same(&self, other: &CaseRow) -> bool {
        let bits = |row: &CaseRow| row.responses.iter().map(|v| v.map(f64::to_bits)).collect::<Vec<_>>();
        bits(self) == bits(other) && self.state_hash == other.state_hash && self.error == other.error
    }
}

/// How cases are run.
pub struct CaseRunner<'a> {
    pub bound: &'a BoundStudy,
    pub threads: usize,
    /// No case is begun after it is set; those that run are ended.
    pub stop: &'a AtomicBool,
    /// Nor after this.
    pub deadline: Option<Instant>,
    /// Where recordings of cases go.
    pub recordings: PathBuf,
    pub shard: String,
    /// What cases have in common.
    pub shared: SharedParts,
}

/// Why cases could not be run.
#[derive(Debug)]
pub struct RunnerError(pub anyhow::Error);

impl CaseRunner<'_> {
    /// Whether no further case is begun.
    pub fn is_over(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.deadline.is_some_and(|at| Instant::now() >= at)
    }

    /// Runs `cases` cases side by side, made one by one by `case`, and hands over each as it ends: in an order that depends on the threads.
    ///
    /// # Errors
    /// A recording cannot be written, or `done` fails: no further case is begun then.
    pub fn run(
        &self,
        cases: usize,
        case: impl Fn(usize) -> CaseSpec + Sync,
        mut done: impl FnMut(CaseRow) -> Result<(), anyhow::Error>,
    ) -> Result<(), RunnerError> {
        let next = AtomicUsize::new(0);
        let has_failed = AtomicBool::new(false);
        let (sender, receiver) = sync_channel::<Result<CaseRow, anyhow::Error>>(self.threads);
        let mut failure = None;
        std::thread::scope(|scope| {
            for _ in 0..self.threads.clamp(1, cases.max(1)) {
                let sender = sender.clone();
                let (next, has_failed, case) = (&next, &has_failed, &case);
                scope.spawn(move || {
                    while !self.is_over() && !has_failed.load(Ordering::Relaxed) {
                        let i = next.fetch_add(1, Ordering::Relaxed);
                        if i >= cases || sender.send(self.one(&case(i))).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(sender);
            for row in receiver {
                if let Err(error) = row.and_then(&mut done) {
                    has_failed.store(true, Ordering::Relaxed);
                    failure.get_or_insert(error);
                }
            }
        });
        failure.map_or(Ok(()), |error| Err(RunnerError(error)))
    }

    /// Runs one case; whatever breaks down in it is its result.
    ///
    /// # Errors
    /// Its recording cannot be written.
    pub fn one(&self, case: &CaseSpec) -> Result<CaseRow, anyhow::Error> {
        let started = Instant::now();
        let tried = std::panic::catch_unwind(AssertUnwindSafe(|| self.attempt(case)));
        let tried = tried.unwrap_or_else(|panic| {
            let said =
                panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
            Err(CaseError(format!("a mistake of pitchline's own: {}", said.unwrap_or("no word"))))
        });
        let row = |responses, state_hash, error| CaseRow {
            case: case.clone(),
            responses,
            state_hash,
            error,
            wall_s: started.elapsed().as_secs_f64(),
            shard: self.shard.clone(),
        };
        let missing = vec![None; self.bound.study.responses.len()];
        let (drive, responses, hash) = match tried {
            Ok(found) => found,
            Err(CaseError(why)) => return Ok(row(missing, None, Some(one_line(&why)))),
        };
        let is_kept = match &self.bound.study.keep {
            KeepSpec::Nothing => false,
            KeepSpec::Everything => true,
            KeepSpec::Where(formula) => formula.holds(|name| self.bound.named(name, case, &responses)),
        };
        if is_kept {
            std::fs::create_dir_all(&self.recordings)?;
            self.record(&drive, &self.recordings.join(format!("case-{:06}.mcap", case.number)))?;
        }
        Ok(row(responses, Some(hash), None))
    }

    fn attempt(&self, case: &CaseSpec) -> Result<(Drive, Vec<Option<f64>>, u64), CaseError> {
        let drive = self.bound.drive_of(case)?;
        let facts = run_case(&drive, &self.bound.needs, self.bound.study.length, &self.shared)?;
        let responses = self.bound.responses(case, &facts);
        Ok((drive, responses, facts.state_hash))
    }

    /// Runs a drive again and records it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn record(&self, drive: &Drive, path: &Path) -> Result<(), anyhow::Error> {
        let length = self.bound.study.length;
        let mut simulation = Simulation::new(drive)?;
        simulation.run(length.duration_s, length.every_s, &[path])?;
        Ok(())
    }
}

/// Without line ends, so that a row of a table is a line.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
