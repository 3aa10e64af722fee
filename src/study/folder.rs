//! The folder of a study: what it is, journals of its shards, tables.
//!
//! | file | what |
//! |---|---|
//! | `study.toml`, `drives/` | the study and its drives as they were read |
//! | `study.json` | fingerprints of study and program |
//! | `shard-I-of-N.rows` | journal: a line a case, in the order in which they ended; appended to and never rewritten |
//! | `shard-I-of-N.parquet` | the same as a table, when the shard is done |
//! | `results.parquet`, `results.csv`, `timing.parquet`, `report.html` | all shards |
//! | `recordings/` | cases that are kept |
//!
//! A line of a journal is JSON, a tab, and the XXH3-64 of the JSON; numbers are the hexadecimal digits of their bits. A line is written at
//! once: a program that is killed leaves at most half of one, which the next reader leaves out.

use super::bind::BoundStudy;
use super::design::StudyPlan;
use super::run::CaseRow;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Part `index` of `count` of a study's cases, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    pub index: usize,
    pub count: usize,
}

impl Shard {
    /// The whole study.
    pub const WHOLE: Shard = Shard { index: 1, count: 1 };

    pub fn name(self) -> String {
        format!("{}-of-{}", self.index, self.count)
    }

    /// Every `count`-th case.
    pub fn has(self, case: usize) -> bool {
        case % self.count == self.index - 1
    }
}

/// What is done with a folder that has cases already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FolderUse {
    /// There must be none.
    Begin,
    /// They are not run again.
    GoOn,
    /// Only read.
    Look,
}

/// Why a folder cannot be used.
#[derive(Debug)]
pub enum FolderError {
    /// It is there, and no study's.
    NotOurs(PathBuf),
    /// Another study, or the same with other values.
    OtherStudy {
        path: PathBuf,
        name: String,
    },
    /// The study is the same, the program another build.
    OtherProgram {
        path: PathBuf,
        version: String,
    },
    /// Cases are done.
    Begun {
        path: PathBuf,
        done: usize,
    },
    NoStudy(PathBuf),
    /// What says whose it is cannot be read.
    Damaged(PathBuf),
    /// It is a file.
    NoFolder(PathBuf),
    /// Another process writes there.
    Busy {
        what: String,
    },
    Io {
        path: PathBuf,
        error: std::io::Error,
    },
    Output(anyhow::Error),
}

impl std::fmt::Display for FolderError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            FolderError::NotOurs(path) => {
                write!(
                    f,
                    "{} has files in it, and none says that it is a study's folder\nhelp: `-o` names another",
                    path.display()
                )
            }
            FolderError::OtherStudy { path, name } => write!(
                f,
                "{} belongs to the study `{name}` as it was then: its factors, plan, responses, duration, drives or goal were others\n\
                 help: `-o` names another folder; {} has the study as it was",
                path.display(),
                path.join(STUDY_FILE).display()
            ),
            FolderError::OtherProgram { path, version } => write!(
                f,
                "{} was begun by another build of pitchline ({version}), whose numbers may differ in their last bits\n\
                 help: go on with that build, or begin anew in another folder (`-o`); `--other-build` goes on all the same",
                path.display()
            ),
            FolderError::Begun { path, done } => {
                write!(
                    f,
                    "{} has {done} cases already\nhelp: `--resume` goes on with what is missing, `-o` names another folder",
                    path.display()
                )
            }
            FolderError::NoStudy(path) => write!(f, "{} holds no study", path.display()),
            FolderError::Damaged(path) => write!(
                f,
                "{} is damaged, and nothing else says whose results these are\nhelp: `-o` names another folder",
                path.display()
            ),
            FolderError::NoFolder(path) => write!(f, "{} is a file, not a folder", path.display()),
            FolderError::Busy { what } => write!(f, "another process {what}; nothing was changed"),
            FolderError::Io { path, error } => {
                write!(
                    f,
                    "{}: {error}\nhelp: what is done is kept; `--resume` goes on when there is room",
                    path.display()
                )
            }
            FolderError::Output(error) => write!(f, "{error:#}"),
        }
    }
}

impl std::error::Error for FolderError {}

const STUDY_FILE: &str = "study.toml";
const STUDY_MARK: &str = "study.json";

/// What `study.json` says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct StudyMark {
    study: String,
    fingerprint: String,
    /// XXH3-64 of the program file.
    program: String,
    version: String,
}

/// The folder of a study.
#[derive(Clone, Debug)]
pub struct StudyFolder {
    pub path: PathBuf,
}

/// Numbers of the cases that a shard need not run.
#[derive(Default)]
pub struct DoneCases {
    pub numbers: BTreeSet<usize>,
    /// What is wrong with the journals.
    pub warnings: Vec<String>,
}

/// Rows of all journals.
#[derive(Default)]
pub struct FolderRows {
    pub rows: BTreeMap<usize, CaseRow>,
    /// What is wrong with the journals.
    pub warnings: Vec<String>,
}

impl StudyFolder {
    /// Opens the folder for a study, and makes it unless it is only looked at.
    ///
    /// # Errors
    /// It belongs to something else, or has cases already and none were expected.
    pub fn open(
        path: &Path,
        bound: &BoundStudy,
        wanted: FolderUse,
        any_build: bool,
    ) -> Result<StudyFolder, FolderError> {
        let folder = StudyFolder { path: path.to_path_buf() };
        let own = StudyMark {
            study: bound.study.name.clone(),
            fingerprint: format!("{:016x}", bound.fingerprint),
            program: format!("{:016x}", program_hash()),
            version: env!("CARGO_PKG_VERSION").into(),
        };
        if path.exists() && !path.is_dir() {
            return Err(FolderError::NoFolder(path.into()));
        }
        match folder.mark()? {
            Some(mark) if mark.fingerprint != own.fingerprint => {
                return Err(FolderError::OtherStudy { path: path.into(), name: mark.study });
            }
            Some(mark) if mark.program != own.program && !any_build && wanted != FolderUse::Look => {
                return Err(FolderError::OtherProgram { path: path.into(), version: mark.version });
            }
            Some(_) => {}
            None if wanted == FolderUse::Look => return Err(FolderError::NoStudy(path.into())),
            None => folder.found(bound, &own)?,
        }
        if wanted == FolderUse::Begin {
            let done = folder.rows(bound)?.rows.len();
            if done > 0 {
                return Err(FolderError::Begun { path: path.into(), done });
            }
        }
        Ok(folder)
    }

    fn io(&self, name: &str) -> impl Fn(std::io::Error) -> FolderError {
        let path = self.path.join(name);
        move |error| FolderError::Io { path: path.clone(), error }
    }

    fn mark(&self) -> Result<Option<StudyMark>, FolderError> {
        let path = self.path.join(STUDY_MARK);
        match std::fs::read(&path) {
            Ok(bytes) => serde_json::from_slice(&bytes).map(Some).map_err(|_| FolderError::Damaged(path)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(FolderError::Io { path, error }),
        }
    }

    /// Makes the folder what it is.
    fn found(&self, bound: &BoundStudy, mark: &StudyMark) -> Result<(), FolderError> {
        // Shards that begin together each find the others' first files; a case that was recorded, and engines, leave folders.
        let is_known = |name: &str| {
            [
                "drives",
                "log",
                "recordings",
                "collect.lock",
                STUDY_FILE,
                STUDY_MARK,
                "job.slurm",
                "ray.json",
                "pitchline_ray.py",
            ]
            .contains(&name)
                || name.starts_with('.')
        };
        let entries = std::fs::read_dir(&self.path).into_iter().flatten().flatten();
        let names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        if names.iter().any(|name| !is_known(name)) {
            // Another shard may have made the folder what it is meanwhile; else nobody knows whose results these are.
            return match self.mark()? {
                Some(there) if there.fingerprint == mark.fingerprint => Ok(()),
                Some(_) | None => Err(FolderError::NotOurs(self.path.clone())),
            };
        }
        std::fs::create_dir_all(self.path.join("drives")).map_err(self.io("drives"))?;
        let write = |name: &str, text: &str| {
            crate::output::write(&self.path.join(name), text.as_bytes()).map_err(FolderError::Output)
        };
        write(STUDY_FILE, &bound.study.text)?;
        for (k, drive) in bound.drives.iter().enumerate() {
            write(&format!("drives/{k}-{}.toml", drive.nominal.name), &drive.nominal.text)?;
        }
        let text = serde_json::to_string_pretty(mark).unwrap_or_default();
        write(STUDY_MARK, &(text + "\n"))
    }

    /// Names of the journals, in order.
    fn journals(&self) -> Result<Vec<String>, FolderError> {
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&self.path).map_err(self.io(""))? {
            let name = entry.map_err(self.io(""))?.file_name().to_string_lossy().into_owned();
            if name.starts_with("shard-") && name.ends_with(".rows") {
                names.push(name);
            }
        }
        names.sort();
        Ok(names)
    }

    /// Cases of a shard that are done, by its own journal and by those of another number of shards: where many shards of one number run, none
    /// reads the journals of the others.
    ///
    /// # Errors
    /// A journal cannot be read.
    pub fn done(&self, bound: &BoundStudy, shard: Shard) -> Result<DoneCases, FolderError> {
        let mut found = DoneCases::default();
        let (own, alike) = (format!("shard-{}.rows", shard.name()), format!("-of-{}.rows", shard.count));
        for name in self.journals()?.into_iter().filter(|name| *name == own || !name.ends_with(&alike)) {
            let bytes = std::fs::read(self.path.join(&name)).map_err(self.io(&name))?;
            let (lines, broken) = lines_of(&bytes);
            if broken > 0 {
                found.warnings.push(damaged(&name, broken));
            }
            let is_ours = |line: &JournalLine| row_of(bound, line, "").is_some();
            found
                .numbers
                .extend(lines.iter().filter(|line| shard.has(line.case) && is_ours(line)).map(|line| line.case));
        }
        Ok(found)
    }

    /// Rows of all journals. A case that two of them have is taken once, and told where they differ.
    ///
    /// # Errors
    /// A journal cannot be read.
    pub fn rows(&self, bound: &BoundStudy) -> Result<FolderRows, FolderError> {
        let mut found = FolderRows::default();
        for name in self.journals()? {
            let bytes = std::fs::read(self.path.join(&name)).map_err(self.io(&name))?;
            let shard = name.trim_start_matches("shard-").trim_end_matches(".rows");
            let (lines, broken) = lines_of(&bytes);
            if broken > 0 {
                found.warnings.push(damaged(&name, broken));
            }
            let rows: Vec<CaseRow> = lines.iter().filter_map(|line| row_of(bound, line, shard)).collect();
            if rows.len() < lines.len() {
                let others = lines.len() - rows.len();
                found.warnings.push(format!("{name}: {others} lines are of another study, and are left out"));
            }
            for row in rows {
                match found.rows.get(&row.case.number) {
                    Some(known) if !known.is_same(&row) => found.warnings.push(format!(
                        "case {} has one result in shard {} and another in shard {shard}: another machine or build ran it; the first is taken",
                        row.case.number, known.shard
                    )),
                    Some(_) => {}
                    None => drop(found.rows.insert(row.case.number, row)),
                }
            }
        }
        Ok(found)
    }

    /// The journal of a shard, to be appended to by this process alone.
    ///
    /// # Errors
    /// Another process has it, or it cannot be written.
    pub fn journal(&self, bound: &BoundStudy, shard: Shard) -> Result<CaseJournal, FolderError> {
        let name = format!("shard-{}.rows", shard.name());
        let path = self.path.join(&name);
        let io = self.io(&name);
        let mut file = File::options().read(true).append(true).create(true).open(&path).map_err(&io)?;
        locked(&file, &path, format!("runs shard {} in {}", shard.name(), self.path.display()))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(&io)?;
        // Half a line at the end is from a program that was killed.
        let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |end| end + 1);
        if whole < bytes.len() {
            file.set_len(whole as u64).map_err(&io)?;
        }
        file.seek(SeekFrom::End(0)).map_err(&io)?;
        Ok(CaseJournal { study: format!("{:016x}", bound.fingerprint), path, file, synced: Instant::now() })
    }

    /// Held while the tables of all shards are written.
    ///
    /// # Errors
    /// Another process writes them.
    pub fn collecting(&self) -> Result<File, FolderError> {
        let path = self.path.join("collect.lock");
        let file =
            File::options().write(true).create(true).truncate(false).open(&path).map_err(self.io("collect.lock"))?;
        locked(&file, &path, format!("collects {}", self.path.display()))?;
        Ok(file)
    }
}

fn locked(file: &File, path: &Path, what: String) -> Result<(), FolderError> {
    match file.try_lock() {
        Ok(()) => Ok(()),
        Err(TryLockError::WouldBlock) => Err(FolderError::Busy { what }),
        Err(TryLockError::Error(error)) => Err(FolderError::Io { path: path.into(), error }),
    }
}

/// A case in a journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct JournalLine {
    /// Fingerprint of the study.
    study: String,
    case: usize,
    /// Only of a search, whose points do not follow from their numbers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    point: Option<Vec<String>>,
    responses: Vec<Option<String>>,
    state: Option<String>,
    error: Option<String>,
    wall_s: f64,
}

/// Whole lines of a journal, and the number of others.
fn lines_of(bytes: &[u8]) -> (Vec<JournalLine>, usize) {
    let (mut lines, mut broken) = (Vec::new(), 0);
    let end = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |end| end + 1);
    for line in bytes.get(..end).unwrap_or_default().split(|b| *b == b'\n').filter(|line| !line.is_empty()) {
        let parsed = line.iter().rposition(|b| *b == b'\t').and_then(|tab| {
            let (json, sum) = (line.get(..tab)?, line.get(tab + 1..)?);
            let is_whole = sum == format!("{:016x}", twox_hash::XxHash3_64::oneshot(json)).as_bytes();
            is_whole.then(|| serde_json::from_slice(json).ok())?
        });
        match parsed {
            Some(line) => lines.push(line),
            None => broken += 1,
        }
    }
    (lines, broken)
}

fn damaged(name: &str, lines: usize) -> String {
    format!("{name}: {lines} lines are damaged; their cases count as missing")
}

fn bits_of(x: f64) -> String {
    format!("{:016x}", x.to_bits())
}

fn number_of(bits: &str) -> Option<f64> {
    u64::from_str_radix(bits, 16).ok().map(f64::from_bits)
}

fn row_of(bound: &BoundStudy, line: &JournalLine, shard: &str) -> Option<CaseRow> {
    if line.study != format!("{:016x}", bound.fingerprint) {
        return None;
    }
    let case = match (&line.point, bound.design.plan() == &StudyPlan::Search) {
        (Some(point), true) => {
            let point: Vec<f64> = point.iter().map(|x| number_of(x)).collect::<Option<_>>()?;
            let drives = bound.drives.len().max(1);
            (point.len() == bound.study.factors.len()).then(|| bound.case_at(line.case, line.case % drives, point))?
        }
        (None, false) => (line.case < bound.cases()).then(|| bound.case(line.case))?,
        (Some(_), false) | (None, true) => return None,
    };
    if line.responses.len() != bound.study.responses.len() {
        return None;
    }
    let response = |bits: &Option<String>| match bits {
        Some(bits) => number_of(bits).map(Some),
        None => Some(None),
    };
    Some(CaseRow {
        case,
        responses: line.responses.iter().map(response).collect::<Option<_>>()?,
        state_hash: line.state.as_deref().and_then(|s| u64::from_str_radix(s, 16).ok()),
        error: line.error.clone(),
        wall_s: line.wall_s,
        shard: shard.to_string(),
    })
}

/// A journal that is being appended to.
pub struct CaseJournal {
    study: String,
    path: PathBuf,
    file: File,
    synced: Instant,
}

/// Time between two syncs to the disk: what a machine that loses its power may lose; a program that is killed loses nothing.
const SYNC_EVERY: Duration = Duration::from_secs(1);

impl CaseJournal {
    /// Adds a case.
    ///
    /// # Errors
    /// The disk is full, or gone.
    pub fn add(&mut self, row: &CaseRow, is_search: bool) -> Result<(), FolderError> {
        let line = JournalLine {
            study: self.study.clone(),
            case: row.case.number,
            point: is_search.then(|| row.case.point.iter().map(|x| bits_of(*x)).collect()),
            responses: row.responses.iter().map(|v| v.map(bits_of)).collect(),
            state: row.state_hash.map(|h| format!("{h:016x}")),
            error: row.error.clone(),
            wall_s: row.wall_s,
        };
        let json = serde_json::to_string(&line).unwrap_or_default();
        let sum = twox_hash::XxHash3_64::oneshot(json.as_bytes());
        let io = |error| FolderError::Io { path: self.path.clone(), error };
        self.file.write_all(format!("{json}\t{sum:016x}\n").as_bytes()).map_err(io)?;
        if self.synced.elapsed() >= SYNC_EVERY {
            self.sync()?;
        }
        Ok(())
    }

    /// # Errors
    /// The disk is full, or gone.
    pub fn sync(&mut self) -> Result<(), FolderError> {
        self.synced = Instant::now();
        self.file.sync_data().map_err(|error| FolderError::Io { path: self.path.clone(), error })
    }
}

/// XXH3-64 of the program file: the same build gives the same bits. 0: it cannot be read.
pub fn program_hash() -> u64 {
    let bytes = std::env::current_exe().and_then(std::fs::read);
    bytes.map_or(0, |bytes| twox_hash::XxHash3_64::oneshot(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_share_the_cases_among_them() {
        let of = |count: usize| {
            (0..100)
                .map(|case| (1..=count).filter(|index| Shard { index: *index, count }.has(case)).count())
                .collect::<Vec<_>>()
        };
        assert!([1, 2, 7].into_iter().all(|count| of(count) == vec![1; 100]));
    }

    #[test]
    fn a_journal_that_is_cut_off_or_damaged_loses_only_those_lines() {
        let line = |case: usize| {
            let own = JournalLine {
                study: "0".into(),
                case,
                point: None,
                responses: vec![Some(bits_of(0.1)), None],
                state: None,
                error: None,
                wall_s: 0.5,
            };
            let json = serde_json::to_string(&own).expect("json");
            let sum = twox_hash::XxHash3_64::oneshot(json.as_bytes());
            format!("{json}\t{sum:016x}\n")
        };
        let mut text = line(3) + &line(4) + &line(5);
        assert_eq!(lines_of(text.as_bytes()).0.len(), 3);
        let cut = &text.as_bytes()[..text.len() - 7];
        assert_eq!((lines_of(cut).0.len(), lines_of(cut).1), (2, 0), "half a line at the end");
        text.replace_range(10..11, "9");
        let (lines, broken) = lines_of(text.as_bytes());
        assert_eq!((lines.len(), broken), (2, 1));
        assert_eq!(number_of(&bits_of(0.1)), Some(0.1));
    }
}
