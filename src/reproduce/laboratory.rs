//! Trials: drives that are run or linearised for the claims, each once, side by side, and kept in a journal.
//!
//! A claim asks for its trials; those that are not there yet are put on a list, and the claim is asked again when they are done. A line of the
//! journal is JSON, a tab, and the XXH3-64 of the JSON: a program that is killed loses the trials that ran. A trial is known by its drive file,
//! what is set in it, what is measured, and the build of pitchline.

use super::facts::SignalFacts;
use super::probes::Probe;
use crate::analysis::mode_shapes::{LinkPlaces, MovingPart};
use crate::analysis::order_spectrum::AngleRecord;
use crate::analysis::running_modes::{KickPlan, running_modes};
use crate::assemble::{Assembly, SharedParts, assemble, at_rest};
use crate::diag::Report;
use crate::drive::{BUNDLED, Drive};
use crate::recording::frame::{Frame, Header};
use crate::statics::{Plungers, modes};
use crate::study::case::{CaseError, CaseLength, CaseNeeds, number_at, run_watched};
use crate::study::folder::program_hash;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::sync_channel;

/// What is done with a drive.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub enum TrialWork {
    /// Frames of the first `settle_s` do not count [s].
    Run {
        duration_s: f64,
        settle_s: f64,
        every_s: f64,
        signals: Vec<String>,
        impacts: bool,
        compare: bool,
        probe: Option<Probe>,
        /// Width of the bins of speed into which the probe sorts its forces [1/min].
        bin_rpm: Option<f64>,
    },
    /// Modes below this frequency [Hz].
    Modes { plungers: &'static str, below_hz: f64 },
    /// Modes of the running drive below this frequency [Hz], kicked at so many instants from `settle_s` on [s].
    Running { settle_s: f64, instants: usize, below_hz: f64 },
    /// The drive at rest under its load.
    Rest,
}

/// One drive, and what is done with it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClaimTrial {
    /// A bundled drive.
    pub drive: String,
    /// `path=value`.
    pub set: Vec<String>,
    pub work: TrialWork,
}

/// What is looked at less than this is not resolved by frames [s].
const EVERY_S: f64 = 50e-6;
/// How long a kicked copy of a running drive is followed [s].
const LISTEN_S: f64 = 0.1;

impl ClaimTrial {
    /// A run whose frames count after `settle_s`.
    pub fn run(drive: &str, settle_s: f64, measured_s: f64) -> ClaimTrial {
        let work = TrialWork::Run {
            duration_s: settle_s + measured_s,
            settle_s,
            every_s: EVERY_S,
            signals: Vec::new(),
            impacts: false,
            compare: false,
            probe: None,
            bin_rpm: None,
        };
        ClaimTrial { drive: drive.into(), set: Vec::new(), work }
    }

    pub fn modes(drive: &str, plungers: Plungers, below_hz: f64) -> ClaimTrial {
        let plungers = match plungers {
            Plungers::Oil => "oil",
            Plungers::Locked => "locked",
            Plungers::Open => "open",
        };
        ClaimTrial { drive: drive.into(), set: Vec::new(), work: TrialWork::Modes { plungers, below_hz } }
    }

    /// Modes of the running drive.
    pub fn running(drive: &str, settle_s: f64, instants: usize, below_hz: f64) -> ClaimTrial {
        ClaimTrial { drive: drive.into(), set: Vec::new(), work: TrialWork::Running { settle_s, instants, below_hz } }
    }

    pub fn rest(drive: &str) -> ClaimTrial {
        ClaimTrial { drive: drive.into(), set: Vec::new(), work: TrialWork::Rest }
    }

    /// With values set, separated by blanks.
    #[must_use]
    pub fn set(mut self, values: &str) -> ClaimTrial {
        self.set.extend(values.split_whitespace().map(str::to_string));
        self
    }

    #[must_use]
    pub fn signals(mut self, names: &[&str]) -> ClaimTrial {
        if let TrialWork::Run { signals, .. } = &mut self.work {
            signals.extend(names.iter().map(|n| n.to_string()));
        }
        self
    }

    #[must_use]
    pub fn every_s(mut self, time_s: f64) -> ClaimTrial {
        if let TrialWork::Run { every_s, .. } = &mut self.work {
            *every_s = time_s;
        }
        self
    }

    #[must_use]
    pub fn impacts(mut self) -> ClaimTrial {
        if let TrialWork::Run { impacts, .. } = &mut self.work {
            *impacts = true;
        }
        self
    }

    #[must_use]
    pub fn compare(mut self) -> ClaimTrial {
        if let TrialWork::Run { compare, .. } = &mut self.work {
            *compare = true;
        }
        self
    }

    #[must_use]
    pub fn probe(mut self, own: Probe) -> ClaimTrial {
        if let TrialWork::Run { probe, .. } = &mut self.work {
            *probe = Some(own);
        }
        self
    }

    #[must_use]
    pub fn bins(mut self, width_rpm: f64) -> ClaimTrial {
        if let TrialWork::Run { bin_rpm, .. } = &mut self.work {
            *bin_rpm = Some(width_rpm);
        }
        self
    }

    /// What it costs, for the progress: some hundred nanoseconds of a step for each link.
    pub fn cost(&self) -> u64 {
        let links = match self.drive.as_str() {
            "v12" => 300,
            name if name.starts_with("v12") => 50,
            _ => 120,
        };
        match &self.work {
            TrialWork::Run { duration_s, .. } => links * (20.0 + 1e3 * duration_s) as u64,
            TrialWork::Modes { .. } | TrialWork::Rest => 50 * links,
            // Some ten copies for every instant.
            TrialWork::Running { instants, .. } => links * (10.0 * 1e3 * LISTEN_S) as u64 * *instants as u64,
        }
    }

    /// The command that does the same by hand.
    pub fn command(&self) -> String {
        let set: String = self.set.iter().map(|s| format!(" --set {s}")).collect();
        match &self.work {
            TrialWork::Run { duration_s, every_s, .. } => {
                format!("run {}{set} --duration {:.1}ms --every {:.0}us", self.drive, 1e3 * duration_s, 1e6 * every_s)
            }
            TrialWork::Modes { plungers, below_hz } => {
                format!("modes {}{set} --plungers {plungers} --below {below_hz}", self.drive)
            }
            TrialWork::Running { settle_s, instants, below_hz } => format!(
                "modes {}{set} --running --settle {:.1}ms --listen {:.0}ms --kicks {instants} --below {below_hz}",
                self.drive,
                1e3 * settle_s,
                1e3 * LISTEN_S
            ),
            TrialWork::Rest => format!("modes {}{set}", self.drive),
        }
    }

    fn drive(&self) -> Result<Drive, CaseError> {
        let bundled = BUNDLED.iter().find(|(name, _)| *name == self.drive);
        let (name, text) = bundled.ok_or_else(|| CaseError(format!("no drive `{}`", self.drive)))?;
        Drive::parse(name, text, &self.set).map_err(|report: Report| CaseError::from(&report))
    }

    /// Fingerprint: drive file, settings, what is measured, program.
    fn key(&self, program: u64) -> String {
        let text = BUNDLED.iter().find(|(name, _)| *name == self.drive).map_or("", |(_, text)| text);
        let json = serde_json::to_string(self).unwrap_or_default();
        let all = format!("{json}\n{text}\n{program:016x}");
        format!("{:016x}", twox_hash::XxHash3_64::oneshot(all.as_bytes()))
    }
}

/// A mode of a drive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModeFacts {
    pub hz: f64,
    pub damping_ratio: Option<f64>,
    /// Parts that move, with their shares of the kinetic energy.
    pub parts: Vec<(String, f64)>,
}

impl ModeFacts {
    /// Share of the kinetic energy of parts whose names begin so.
    pub fn share(&self, prefix: &str) -> f64 {
        self.parts.iter().filter(|(name, _)| name.starts_with(prefix)).map(|p| p.1).sum()
    }
}

/// What a trial gave.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrialFacts {
    /// Why it broke down.
    pub error: Option<String>,
    /// As of a case of a study; of a drive at rest its coordinates.
    pub tree: Value,
    pub signals: BTreeMap<String, SignalFacts>,
    pub probe: Value,
    pub modes: Vec<ModeFacts>,
    pub wall_s: f64,
}

impl TrialFacts {
    /// A signal that was asked for; all NaN where it is missing.
    pub fn signal(&self, name: &str) -> SignalFacts {
        self.signals.get(name).cloned().unwrap_or_default()
    }

    /// A number of the tree.
    pub fn number(&self, path: &str) -> f64 {
        number_at(&self.tree, path).unwrap_or(f64::NAN)
    }

    /// A number of the probe.
    pub fn probed(&self, path: &str) -> f64 {
        number_at(&self.probe, path).unwrap_or(f64::NAN)
    }

    /// A list of numbers of the probe.
    pub fn list(&self, key: &str) -> Vec<f64> {
        let list = self.probe.get(key).and_then(Value::as_array);
        list.into_iter().flatten().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
    }
}

/// Why a claim has no answer yet, or none at all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unanswered {
    /// Its trials have to be done first.
    Waiting,
    /// A trial broke down.
    Broken(String),
}

/// How much is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum WorkPace {
    /// Fewer speeds, shorter runs: minutes.
    Quick,
    /// All of it: under two hours on two cores.
    Whole,
}

/// Where trials are done and kept.
pub struct Laboratory {
    pub pace: WorkPace,
    done: BTreeMap<String, Arc<TrialFacts>>,
    wanted: RefCell<BTreeMap<String, ClaimTrial>>,
    /// Trials that the claim at hand asked for.
    asked: RefCell<Vec<ClaimTrial>>,
    journal: File,
    /// XXH3-64 of this program: another build may give other numbers.
    program: u64,
}

impl Laboratory {
    /// With the trials that a journal has.
    ///
    /// # Errors
    /// The journal cannot be read or written.
    pub fn open(pace: WorkPace, journal: &Path) -> std::io::Result<Laboratory> {
        let mut file = File::options().create(true).read(true).append(true).open(journal)?;
        file.try_lock().map_err(|_| std::io::Error::other("another run of pitchline works in this folder"))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        let text = String::from_utf8_lossy(&bytes);
        let mut done = BTreeMap::new();
        for line in text.lines() {
            let Some((json, hash)) = line.rsplit_once('\t') else { continue };
            if format!("{:016x}", twox_hash::XxHash3_64::oneshot(json.as_bytes())) == hash
                && let Ok((key, facts)) = serde_json::from_str::<(String, TrialFacts)>(json)
            {
                done.insert(key, Arc::new(facts));
            }
        }
        // Behind half a line of a run that was killed.
        if !text.is_empty() && !text.ends_with('\n') {
            file.write_all(b"\n")?;
        }
        Ok(Laboratory {
            pace,
            done,
            wanted: RefCell::default(),
            asked: RefCell::default(),
            journal: file,
            program: program_hash(),
        })
    }

    pub fn is_quick(&self) -> bool {
        self.pace == WorkPace::Quick
    }

    /// What these trials gave.
    ///
    /// # Errors
    /// They have to be done first, or one broke down.
    pub fn all(&self, trials: &[ClaimTrial]) -> Result<Vec<Arc<TrialFacts>>, Unanswered> {
        let mut found = Vec::new();
        let mut waiting = false;
        for trial in trials {
            self.asked.borrow_mut().push(trial.clone());
            let key = trial.key(self.program);
            match self.done.get(&key) {
                None => {
                    waiting = true;
                    self.wanted.borrow_mut().insert(key, trial.clone());
                }
                Some(facts) => found.push(facts.clone()),
            }
        }
        if waiting {
            return Err(Unanswered::Waiting);
        }
        match found.iter().zip(trials).find_map(|(f, trial)| f.error.as_ref().map(|e| (e, trial))) {
            Some((error, trial)) => Err(Unanswered::Broken(format!("`{}`: {error}", trial.command()))),
            None => Ok(found),
        }
    }

    /// What one trial gave.
    ///
    /// # Errors
    /// As [`Laboratory::all`].
    pub fn one(&self, trial: &ClaimTrial) -> Result<Arc<TrialFacts>, Unanswered> {
        self.all(std::slice::from_ref(trial)).map(|mut all| all.swap_remove(0))
    }

    /// A bundled drive as it is read.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn drive(&self, name: &str, set: &str) -> Result<Drive, Unanswered> {
        ClaimTrial::rest(name).set(set).drive().map_err(|CaseError(why)| Unanswered::Broken(why))
    }

    /// Trials that were asked for since the last call.
    pub fn take_asked(&self) -> Vec<ClaimTrial> {
        std::mem::take(&mut *self.asked.borrow_mut())
    }

    /// Trials that are missing, the longest first, so that no thread ends late with one.
    pub fn take_wanted(&self) -> Vec<ClaimTrial> {
        let mut wanted: Vec<ClaimTrial> = std::mem::take(&mut *self.wanted.borrow_mut()).into_values().collect();
        wanted.sort_by_key(|trial| std::cmp::Reverse(trial.cost()));
        wanted
    }

    /// Does trials side by side; `each` is called after every one.
    ///
    /// # Errors
    /// The journal cannot be written.
    pub fn work(
        &mut self,
        trials: &[ClaimTrial],
        threads: usize,
        stop: &AtomicBool,
        mut each: impl FnMut(&ClaimTrial, &TrialFacts),
    ) -> std::io::Result<()> {
        let next = AtomicUsize::new(0);
        let shared = SharedParts::default();
        let (sender, receiver) = sync_channel::<(usize, TrialFacts)>(threads);
        let mut failed = Ok(());
        std::thread::scope(|scope| {
            for _ in 0..threads.clamp(1, trials.len().max(1)) {
                let (sender, next, shared) = (sender.clone(), &next, &shared);
                scope.spawn(move || {
                    while !stop.load(Ordering::Relaxed) {
                        let i = next.fetch_add(1, Ordering::Relaxed);
                        let Some(trial) = trials.get(i) else { break };
                        let started = std::time::Instant::now();
                        let mut facts = do_trial(trial, shared, stop);
                        // What an interruption cut off is no result.
                        if stop.load(Ordering::Relaxed) && facts.error.is_some() {
                            break;
                        }
                        facts.wall_s = started.elapsed().as_secs_f64();
                        if sender.send((i, facts)).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(sender);
            for (i, facts) in receiver {
                let Some(trial) = trials.get(i) else { continue };
                each(trial, &facts);
                let key = trial.key(self.program);
                let json = serde_json::to_string(&(&key, &facts)).unwrap_or_default();
                let line = format!("{json}\t{:016x}\n", twox_hash::XxHash3_64::oneshot(json.as_bytes()));
                let written = self.journal.write_all(line.as_bytes());
                failed = std::mem::replace(&mut failed, Ok(())).and(written);
                self.done.insert(key, Arc::new(facts));
            }
        });
        failed
    }
}

/// Does one trial; whatever breaks down in it is its result.
fn do_trial(trial: &ClaimTrial, shared: &SharedParts, stop: &AtomicBool) -> TrialFacts {
    let tried = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| attempt(trial, shared, stop)));
    let tried = tried.unwrap_or_else(|_| Err(CaseError("a mistake of pitchline's own".into())));
    tried.unwrap_or_else(|CaseError(why)| TrialFacts { error: Some(why), ..TrialFacts::default() })
}

fn attempt(trial: &ClaimTrial, shared: &SharedParts, stop: &AtomicBool) -> Result<TrialFacts, CaseError> {
    let drive = trial.drive()?;
    match &trial.work {
        TrialWork::Modes { plungers, below_hz } => {
            let (model, rest) = at_rest(&drive)?;
            let plungers = match *plungers {
                "locked" => Plungers::Locked,
                "open" => Plungers::Open,
                _ => Plungers::Oil,
            };
            let found = modes(&model, &rest.configuration, plungers).map_err(|e| CaseError(e.to_string()))?;
            let places = LinkPlaces::new(&model, &rest.configuration);
            let facts = found.iter().filter(|m| m.frequency_hz() <= *below_hz).map(|m| ModeFacts {
                hz: m.frequency_hz(),
                damping_ratio: Some(m.damping_ratio).filter(|d| d.is_finite()),
                parts: places
                    .parts(&model, &rest.configuration, m)
                    .into_iter()
                    .map(|MovingPart { part, share }| (part, share))
                    .collect(),
            });
            Ok(TrialFacts { modes: facts.collect(), ..TrialFacts::default() })
        }
        TrialWork::Running { settle_s, instants, below_hz } => {
            let Assembly { model, state, .. } = assemble(&drive)?;
            let plan = KickPlan {
                settle_s: *settle_s,
                listen_s: LISTEN_S,
                instants: *instants,
                highest_hz: *below_hz,
                threads: 1,
            };
            let found = running_modes(&model, state, &plan).map_err(|e| CaseError(e.to_string()))?;
            let facts = found.modes.into_iter().map(|m| ModeFacts {
                hz: m.frequency_hz,
                damping_ratio: Some(m.damping_ratio),
                parts: m.moves.into_iter().map(|MovingPart { part, share }| (part, share)).collect(),
            });
            Ok(TrialFacts { modes: facts.collect(), ..TrialFacts::default() })
        }
        TrialWork::Rest => {
            let (model, rest) = at_rest(&drive)?;
            let mut at = serde_json::Map::new();
            for (spec, value) in model.coordinates.iter().zip(&rest.configuration.coordinates) {
                at.insert(crate::diag::last_name(&spec.path).to_string(), serde_json::json!(value));
            }
            let mean = rest.tensions_n.iter().sum::<f64>() / rest.tensions_n.len().max(1) as f64;
            let tree = serde_json::json!({"coordinates": at, "mean_tension_n": mean});
            Ok(TrialFacts { tree, ..TrialFacts::default() })
        }
        TrialWork::Run { duration_s, settle_s, every_s, signals, impacts, compare, probe, bin_rpm } => {
            let needs =
                CaseNeeds { compare: *compare, impacts: *impacts, signals: signals.clone(), impacts_from_s: *settle_s };
            let length = CaseLength { duration_s: *duration_s, every_s: *every_s };
            let mut own = probe.as_ref().map(|p| p.begin(&drive, *bin_rpm));
            let mut watch = |frame: &Frame, header: &Header| {
                if let Some(own) = &mut own
                    && frame.t_s >= *settle_s
                {
                    own.see(frame, header);
                }
                !stop.load(Ordering::Relaxed)
            };
            let found = run_watched(&drive, &needs, length, shared, Some(&mut watch))?;
            let facts = signals
                .iter()
                .zip(&found.signals)
                .map(|(name, record)| (name.clone(), SignalFacts::of(&after(record, *settle_s))))
                .collect();
            let probe = own.map_or(Value::Null, |own| own.finish());
            Ok(TrialFacts { tree: found.tree, signals: facts, probe, ..TrialFacts::default() })
        }
    }
}

/// A record from a time on.
fn after(record: &AngleRecord, from_s: f64) -> AngleRecord {
    let first = record.times_s.partition_point(|t| *t < from_s);
    let cut = |v: &Vec<f64>| v.get(first..).unwrap_or_default().to_vec();
    let (turns, times_s) = (cut(&record.turns), cut(&record.times_s));
    let span = |v: &[f64]| v.last().copied().unwrap_or(0.0) - v.first().copied().unwrap_or(0.0);
    let turns_per_s = span(&turns).abs() / span(&times_s).max(1e-12);
    AngleRecord { turns, times_s, values: cut(&record.values), turns_per_s, ..record.clone() }
}
