//! The command line: one file per verb, and its row in [`verbs`]. Results go to stdout, everything else to stderr.

// These modules read untrusted files, so that every index is checked.
#![warn(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::cast_possible_truncation)]

mod audit;
mod check;
mod compare;
mod completions;
mod damping;
mod diff;
mod drives;
mod effects;
mod explain;
mod export;
mod geometry;
mod geometry_silent;
mod geometry_smartchain;
mod identify;
mod impacts;
mod lap;
mod live;
mod lump;
mod migrate;
mod modes;
mod mounts;
mod optimise;
mod orders;
mod pair_stats;
mod replay;
mod reproduce;
mod run;
mod sheet;
mod snapshot;
mod spectrum;
mod study;
mod study_engine;
mod study_remote;
mod view;
#[cfg(feature = "web")]
mod view_web;
mod zoom;

use clap::{ArgMatches, Args, Command};
use std::io::{Read, Write};
use std::path::Path;

/// What a verb does with its arguments.
type RunVerb = Box<dyn Fn(&ArgMatches) -> Result<Outcome, Failure>>;

/// A verb: a row of [`verbs`].
struct Verb {
    command: Command,
    run: RunVerb,
}

/// A verb with its name, what it does in a line, and its file's arguments and function.
fn verb<A: Args + 'static>(name: &'static str, about: &'static str, run: fn(&A) -> Result<Outcome, Failure>) -> Verb {
    let command = A::augment_args(Command::new(name)).about(about);
    let read = |given: &ArgMatches| A::from_arg_matches(given).map_err(|e| Failure::Input(e.to_string()));
    Verb { command, run: Box::new(move |given| run(&read(given)?)) }
}

/// All verbs, in the order of the help.
fn verbs() -> Vec<Verb> {
    vec![
        verb("run", "Simulate a drive and record it", run::run),
        verb("view", "Open a recording in the Rerun viewer, or in a web browser", view::run),
        verb(
            "compare",
            "Compare drives by the impacts on their drivers: by default bush, silent and abutment chain",
            compare::run,
        ),
        verb("study", "Run a drive for many values of its numbers: tolerances, sweeps, sensitivities", study::run),
        verb("optimise", "Search the factors of a study for the best value of its goal", optimise::run),
        verb("reproduce", "Hold 73 claims of four papers on timing chains against drives like theirs", reproduce::run),
        verb("impacts", "List every impact of a recording, and what stands out among them", impacts::run),
        verb("audit", "Measure every part from the frames of a recording, and say what stands out", audit::run),
        verb("spectrum", "Show the orders of a quantity of a recording, and what turns with them", spectrum::run),
        verb("orders", "Follow the orders of a quantity while the speed changes", orders::run),
        verb(
            "damping",
            "Find frequencies and damping of a quantity from its decay, or from a resonance of a run-up",
            damping::run,
        ),
        verb("lap", "Show a number of links or joints over their way round the loop, by zones", lap::run),
        verb("mounts", "Show the forces on what carries the drive: bearings, guides, pivots, housings", mounts::run),
        verb("modes", "Show frequencies, damping and shapes of a drive at rest under its load", modes::run),
        verb("explain", "Explain the state of a link: every force on it, and their origin", explain::run),
        verb("diff", "Show where two recordings differ, in which body, by how much", diff::run),
        verb("zoom", "Record a part of a recording again, every step of it if wanted", zoom::run),
        verb("replay", "Run a recording's drive again and compare, or repair a file that was cut off", replay::run),
        verb("snapshot", "Draw frames of a recording, as SVG or PNG", snapshot::run),
        verb("drives", "List the bundled drives, or print one", drives::run),
        verb(
            "effects",
            "List the effects that a drive may have in addition to its ideal model, or show one in detail",
            effects::run,
        ),
        verb("sensors", "List the kinds of sensors and the units of measured columns", effects::sensors),
        verb("lump", "Derive a lumped drive from one with link bodies: the same shafts, spans as springs", lump::run),
        verb("check", "Read and assemble a drive, and print derived quantities", check::run),
        verb("geometry", "Print the dimensions of a profile, and draw it", geometry::run),
        verb("identify", "Compare a drive with measured records, and name the effects that it lacks", identify::run),
        verb("export", "Turn a recording into Parquet or CSV tables", export::run),
        verb("completions", "Print a completion script for a shell", completions::run),
    ]
}

/// The command line.
pub fn command() -> Command {
    Command::new("pitchline")
        .version(env!("CARGO_PKG_VERSION"))
        .about("Headless simulator and visual debugger for chain drives")
        .subcommand_required(true)
        .arg_required_else_help(true)
        .subcommands(verbs().into_iter().map(|verb| verb.command))
}

/// How a verb ended without failing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    Done,
    /// Compared, with differences.
    Differs,
    /// Done, but with reported losses or uncertainty.
    DataLost,
    /// Stopped by Ctrl-C; files are finished.
    Interrupted,
}

impl Outcome {
    pub fn code(self) -> u8 {
        match self {
            Outcome::Done => 0,
            Outcome::Differs => 1,
            Outcome::DataLost => 3,
            Outcome::Interrupted => 130,
        }
    }
}

/// How a verb failed.
#[derive(Debug)]
pub enum Failure {
    /// An error of the user.
    Input(String),
    /// An error of the environment: files, disks, a run that broke down.
    World(String),
}

impl Failure {
    pub fn code(&self) -> u8 {
        match self {
            Failure::Input(_) => 2,
            Failure::World(_) => 1,
        }
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Failure::Input(text) | Failure::World(text) if text.starts_with("error") => write!(f, "{text}"),
            Failure::Input(text) | Failure::World(text) => write!(f, "error: {text}"),
        }
    }
}

impl From<anyhow::Error> for Failure {
    fn from(e: anyhow::Error) -> Failure {
        Failure::World(format!("{e:#}"))
    }
}

/// Runs the verb of a command line.
pub fn run(given: &ArgMatches) -> Result<Outcome, Failure> {
    let chosen = given.subcommand();
    let found = chosen.and_then(|(name, own)| Some((verbs().into_iter().find(|v| v.command.get_name() == name)?, own)));
    let Some((verb, own)) = found else { return Err(Failure::Input("no verb is given".into())) };
    (verb.run)(own)
}

/// Parses an argument that must be a finite number.
fn finite(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err("a finite number is needed".into()),
    }
}

/// Writes results to stdout; a closed pipe ends the program quietly.
fn print_out(text: &str) -> Result<Outcome, Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Ok(()) => Ok(Outcome::Done),
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(Outcome::Done),
        Err(e) => Err(Failure::World(format!("cannot write to stdout: {e}"))),
    }
}

/// Result of a verb that reads recordings.
enum Answer {
    Json(serde_json::Value),
    Text(String),
}

fn print_missing<'a>(what: impl IntoIterator<Item = &'a String>) {
    for what in what {
        eprintln!("warning: {what}");
    }
}

/// Prints an answer, preceded by a list of data missing from its recordings, which is also `missing` in JSON. An answer
/// from incomplete data ends with exit code 3.
fn answer(readers: &[&crate::recording::reader::Reader], answer: Answer, outcome: Outcome) -> Result<Outcome, Failure> {
    let missing: Vec<&String> = readers.iter().flat_map(|r| r.missing()).collect();
    print_missing(readers.iter().flat_map(|r| r.missing_since_open()));
    match answer {
        Answer::Text(text) => print_out(&text)?,
        Answer::Json(mut value) => {
            add_field(&mut value, "missing", serde_json::json!(missing));
            print_json(&value)?
        }
    };
    Ok(if missing.is_empty() || outcome == Outcome::Interrupted { outcome } else { Outcome::DataLost })
}

/// Adds a field to a JSON object; other values remain unchanged.
fn add_field(object: &mut serde_json::Value, key: &str, value: serde_json::Value) {
    if let Some(object) = object.as_object_mut() {
        object.insert(key.into(), value);
    }
}

fn print_json(value: &serde_json::Value) -> Result<Outcome, Failure> {
    print_out(&format!("{value:#}\n"))
}

/// Refuses outputs that are a directory, an input, or one file by two names, before anything is computed.
fn check_outputs<'a>(
    outputs: impl IntoIterator<Item = &'a Path>,
    inputs: impl IntoIterator<Item = &'a Path> + Clone,
) -> Result<(), Failure> {
    crate::output::check(outputs, inputs).map_err(|e| Failure::Input(e.to_string()))
}

/// Largest drive file that is read [bytes].
const LARGEST_DRIVE: u64 = 1 << 20;

/// Text of a drive: a bundled name, or a file.
fn drive_text(drive: &str) -> Result<(String, String), Failure> {
    if let Some((name, text)) = crate::drive::BUNDLED.iter().find(|(name, _)| *name == drive) {
        return Ok(((*name).to_string(), (*text).to_string()));
    }
    let path = Path::new(drive);
    let names = || crate::drive::BUNDLED.iter().map(|(n, _)| *n);
    let metadata = std::fs::metadata(path).map_err(|e| {
        let help = match crate::diag::nearest(drive, names()) {
            Some(near) => format!("did you mean the bundled drive `{near}`?"),
            None => format!("bundled drives: {}", names().collect::<Vec<_>>().join(", ")),
        };
        Failure::Input(format!("cannot read drive `{drive}`: {e}\nhelp: {help}"))
    })?;
    if metadata.is_dir() {
        return Err(Failure::Input(format!("`{drive}` is a directory, not a drive file")));
    }
    if metadata.len() > LARGEST_DRIVE {
        return Err(Failure::Input(format!(
            "`{drive}` has {} bytes; a drive file has at most {LARGEST_DRIVE}",
            metadata.len()
        )));
    }
    let mut bytes = Vec::new();
    let read = crate::input::open(path).and_then(|file| file.take(LARGEST_DRIVE + 1).read_to_end(&mut bytes));
    read.map_err(|e| Failure::Input(format!("cannot read drive `{drive}`: {e}")))?;
    // Special files do not state their length and may never end.
    if bytes.len() as u64 > LARGEST_DRIVE {
        return Err(Failure::Input(format!("`{drive}` has more bytes than a drive file has at most: {LARGEST_DRIVE}")));
    }
    match String::from_utf8(bytes) {
        Ok(text) => Ok((drive.to_string(), text)),
        Err(e) => Err(Failure::Input(format!(
            "`{drive}` is no drive file: not UTF-8 text at byte {}",
            e.utf8_error().valid_up_to()
        ))),
    }
}

/// Reads a drive with overrides.
fn load_drive(drive: &str, overrides: &[String]) -> Result<crate::drive::Drive, Failure> {
    let (name, text) = drive_text(drive)?;
    if crate::machine::is_lumped(&text) {
        return Err(Failure::Input(format!(
            "`{drive}` is a lumped drive: it has no links to simulate\nhelp: hold it against measured records with `pitchline identify`"
        )));
    }
    crate::drive::Drive::parse(&name, &text, overrides).map_err(|report| Failure::Input(report.to_string()))
}

/// Time after which assembling prints a note; most drives need a tenth of it.
const NOTE_AFTER: std::time::Duration = std::time::Duration::from_secs(3);

/// Assembles a drive.
fn assemble(drive: &crate::drive::Drive) -> Result<crate::assemble::Assembly, Failure> {
    let (done, ended) = std::sync::mpsc::channel::<()>();
    std::thread::spawn(move || {
        if ended.recv_timeout(NOTE_AFTER) == Err(std::sync::mpsc::RecvTimeoutError::Timeout) {
            eprintln!(
                "note: assembling goes on: a long chain, or steps far smaller than the run-in; Ctrl-C ends it, `run.run_in_ms` shortens it"
            );
        }
    });
    let assembled = crate::assemble::assemble(drive).map_err(assembly_failure);
    drop(done);
    assembled
}

fn assembly_failure(e: crate::assemble::AssemblyError) -> Failure {
    use crate::assemble::AssemblyError;
    match e {
        AssemblyError::Input(report) => Failure::Input(report.to_string()),
        AssemblyError::Statics { .. } => Failure::Input(format!("the drive cannot be assembled: {e}")),
        AssemblyError::RunIn(_) => Failure::World(e.to_string()),
    }
}

/// Index of the body of a recording with this path, or whose path ends in this name.
fn body_named(header: &crate::recording::frame::Header, name: &str) -> Result<usize, Failure> {
    // `driver` names `sprockets.driver`, and `bush.driver` the one of the bush drive in a recording of several.
    let is_meant = |path: &str| {
        let mut rest = path.split('.').rev();
        let mut wanted = name.split('.').rev();
        wanted.next() == rest.next() && wanted.all(|word| rest.any(|r| r == word))
    };
    if let Some(k) = header.bodies.iter().position(|b| b.path == name) {
        return Ok(k);
    }
    let meant: Vec<(usize, &str)> =
        header.bodies.iter().map(|b| b.path.as_str()).enumerate().filter(|(_, path)| is_meant(path)).collect();
    match meant[..] {
        [(k, _)] => Ok(k),
        [] => {
            let known: std::collections::BTreeSet<String> =
                header.bodies.iter().map(|b| crate::diag::last_name(&b.path).to_string()).collect();
            let help = match crate::diag::nearest(name, known.iter().map(String::as_str)) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("there are: {}", known.into_iter().collect::<Vec<_>>().join(", ")),
            };
            Err(Failure::Input(format!("no sprocket or guide is called `{name}`\nhelp: {help}")))
        }
        _ => {
            let several = meant.iter().map(|(_, path)| format!("`{path}`")).collect::<Vec<_>>().join(", ");
            Err(Failure::Input(format!("`{name}` may be any of {several}\nhelp: give more of its path")))
        }
    }
}

/// Opens a recording and reports what it lacks. A missing or invalid file is an error of the user.
fn open_recording(path: &Path) -> Result<crate::recording::reader::Reader, Failure> {
    let reader = crate::recording::reader::Reader::open(path).map_err(|e| Failure::Input(format!("{e:#}")))?;
    print_missing(reader.missing());
    Ok(reader)
}
