//! The command line: one file per verb. Results go to stdout, everything else to stderr.

mod check;
mod compare;
mod drives;
mod geometry;
mod geometry_silent;
mod geometry_smartchain;
mod live;
mod run;
mod tune;
mod view;
#[cfg(feature = "web")]
mod view_web;

use clap::{CommandFactory, Parser, Subcommand};
use std::io::Write;
use std::path::Path;

/// Headless simulator and visual debugger for chain drives.
#[derive(Parser, Debug)]
#[command(name = "pitchline", version, about, arg_required_else_help = true)]
pub struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand, Debug)]
enum Verb {
    /// Simulate a drive and record it
    Run(run::RunArgs),
    /// Open a recording in the Rerun viewer, or in a web browser
    View(view::ViewArgs),
    /// Compare drives by the impacts on their drivers: bush, silent and abutment chain unless told otherwise
    Compare(compare::CompareArgs),
    /// Search the free numbers of an abutment chain's drive, and print the margin to every bound
    Tune(tune::TuneArgs),
    /// List the bundled drives, or print one
    Drives(drives::DrivesArgs),
    /// Read a drive, assemble it, and say what follows from it
    Check(check::CheckArgs),
    /// The numbers of a profile, and its drawing
    #[command(subcommand)]
    Geometry(geometry::GeometryVerb),
    /// Print a completion script for a shell
    Completions {
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
}

/// How a verb ended without failing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    Done,
    /// Stopped by Ctrl-C; files are finished.
    Interrupted,
}

impl Outcome {
    pub fn code(self) -> u8 {
        match self {
            Outcome::Done => 0,
            Outcome::Interrupted => 130,
        }
    }
}

/// How a verb failed.
#[derive(Debug)]
pub enum Failure {
    /// The user's mistake.
    Input(String),
    /// The world's: files, disks, a run that broke down.
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
pub fn run(cli: Cli) -> Result<Outcome, Failure> {
    match cli.verb {
        Verb::Run(args) => run::run(&args),
        Verb::View(args) => view::run(&args),
        Verb::Compare(args) => compare::run(&args),
        Verb::Tune(args) => tune::run(&args),
        Verb::Drives(args) => drives::run(&args),
        Verb::Check(args) => check::run(&args),
        Verb::Geometry(verb) => geometry::run(&verb),
        Verb::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "pitchline", &mut script);
            print_out(&String::from_utf8_lossy(&script))
        }
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

fn print_json(value: &serde_json::Value) -> Result<Outcome, Failure> {
    print_out(&format!("{value:#}\n"))
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
    let bytes = std::fs::read(path).map_err(|e| Failure::Input(format!("cannot read drive `{drive}`: {e}")))?;
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
    crate::drive::Drive::parse(&name, &text, overrides).map_err(|report| Failure::Input(report.to_string()))
}

/// Assembles a drive.
fn assemble(drive: &crate::drive::Drive) -> Result<crate::assemble::Assembly, Failure> {
    use crate::assemble::AssemblyError;
    crate::assemble::assemble(drive).map_err(|e| match e {
        AssemblyError::Input(report) => Failure::Input(report.to_string()),
        AssemblyError::Statics { .. } => Failure::Input(format!("the drive cannot be assembled: {e}")),
        AssemblyError::RunIn(_) => Failure::World(e.to_string()),
    })
}
