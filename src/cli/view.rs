//! `pitchline view`: opens a recording. An .rrd is shown by the Rerun viewer on this machine, or by the web viewer that
//! this program contains; an .mcap is converted first.

use super::{Failure, Outcome, print_out};
use crate::recording::{ViewOptions, create};
use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long the Rerun viewer has to end by itself.
const VIEWER_TIMEOUT: Duration = Duration::from_secs(2);

#[derive(clap::Args, Debug)]
pub struct ViewArgs {
    /// Recording, .rrd or .mcap
    recording: PathBuf,
    /// Show it in a web browser, even if a Rerun viewer is installed
    #[arg(long)]
    web: bool,
    /// Port of the web viewer on this machine [default: any free port]
    #[arg(long, value_name = "PORT", default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Start the web browser
    #[arg(long)]
    open: bool,
    /// Write an .mcap as .rrd to FILE, and show nothing
    #[arg(short, long, value_name = "FILE", conflicts_with_all = ["web", "port", "open"])]
    output: Option<PathBuf>,
    /// Write to FILE a layout for Foxglove with the names of an .mcap's bodies, and show nothing
    #[arg(long, value_name = "FILE", conflicts_with_all = ["web", "port", "open", "output"])]
    foxglove_layout: Option<PathBuf>,
}

/// File format of a recording, from its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RecordingFormat {
    Rrd,
    Mcap,
}

/// Viewer that shows the recording.
enum Shown {
    /// The `rerun` program with this name.
    Native(OsString),
    Web,
}

pub fn run(args: &ViewArgs) -> Result<Outcome, Failure> {
    let kind = kind(&args.recording)?;
    // Only signals stop it: the reader of the address may close the pipe.
    let stop = super::run::stop_on_signal();
    if let Some(output) = &args.output {
        check_output(&args.recording, kind, output)?;
        super::check_outputs([output.as_path()], [args.recording.as_path()])?;
        return match convert(&args.recording, output, &stop)? {
            Outcome::Interrupted => Ok(Outcome::Interrupted),
            outcome => print_out(&format!("wrote {}\n", output.display())).map(|_| outcome),
        };
    }
    if let Some(layout) = &args.foxglove_layout {
        return write_layout(&args.recording, kind, layout);
    }
    let shown = shown(args.web)?;
    let mut converted = Outcome::Done;
    let (path, _folder) = match kind {
        RecordingFormat::Rrd => (args.recording.clone(), None),
        RecordingFormat::Mcap => {
            let folder = TemporaryFolder::new()?;
            let name = args.recording.file_stem().unwrap_or_default();
            let path = folder.0.join(name).with_added_extension("rrd");
            converted = convert(&args.recording, &path, &stop)?;
            if converted == Outcome::Interrupted {
                return Ok(Outcome::Interrupted);
            }
            (path, Some(folder))
        }
    };
    match shown {
        Shown::Native(program) => match show(&program, &path, &stop)? {
            Outcome::Done => Ok(converted),
            other => Ok(other),
        },
        #[cfg(feature = "web")]
        Shown::Web => super::view_web::serve(&path, args.port, args.open, &stop),
        #[cfg(not(feature = "web"))]
        Shown::Web => Err(without("web")),
    }
}

/// Detects the format of a file.
fn kind(path: &Path) -> Result<RecordingFormat, Failure> {
    let shown = path.display();
    if path.is_dir() {
        return Err(Failure::Input(format!("{shown} is a directory, not a recording")));
    }
    // A pipe may never deliver data.
    if path.exists() && !path.is_file() {
        return Err(Failure::Input(format!(
            "{shown} is a pipe or a device, not a recording: write it to a file first"
        )));
    }
    let mut first = [0; 8];
    let read = crate::input::open(path).and_then(|file| file.take(8).read(&mut first));
    read.map_err(|e| Failure::Input(format!("cannot read {shown}: {e}")))?;
    match first {
        [b'R', b'R', b'F', ..] => Ok(RecordingFormat::Rrd),
        [0x89, b'M', b'C', b'A', b'P', ..] => Ok(RecordingFormat::Mcap),
        _ => Err(Failure::Input(format!("{shown} is no recording; `pitchline run` writes .rrd and .mcap"))),
    }
}

/// Checks the arguments of `--output` before anything is read.
fn check_output(recording: &Path, kind: RecordingFormat, output: &Path) -> Result<(), Failure> {
    let shown = output.display();
    if kind == RecordingFormat::Rrd {
        return Err(Failure::Input(format!("{} is an .rrd already", recording.display())));
    }
    if !cfg!(feature = "rerun") {
        return Err(without("rerun"));
    }
    if output.extension().is_none_or(|e| e != "rrd") {
        return Err(Failure::Input(format!("{shown}: the converted recording ends in .rrd")));
    }
    Ok(())
}

/// Writes a layout for Foxglove, which reads .mcap alone.
fn write_layout(recording: &Path, kind: RecordingFormat, layout: &Path) -> Result<Outcome, Failure> {
    let shown = layout.display();
    if kind == RecordingFormat::Rrd {
        let path = recording.display();
        return Err(Failure::Input(format!("Foxglove does not read {path}; give the .mcap of the same run")));
    }
    if layout.extension().is_none_or(|e| e != "json") {
        return Err(Failure::Input(format!("{shown}: a layout for Foxglove ends in .json")));
    }
    super::check_outputs([layout], [recording])?;
    let reader = super::open_recording(recording)?;
    let text = crate::recording::foxglove_layout::layout(reader.header())?;
    crate::output::write(layout, text.as_bytes())?;
    print_out(&format!("wrote {shown}: import it in Foxglove, then open {}\n", recording.display()))
}

/// Selects the viewer, before anything is converted.
fn shown(web: bool) -> Result<Shown, Failure> {
    let has_web = cfg!(feature = "web");
    if web {
        return if has_web { Ok(Shown::Web) } else { Err(without("web")) };
    }
    match native_viewer() {
        Ok(program) => Ok(Shown::Native(program)),
        Err(reason) if has_web => {
            eprintln!("{reason}; showing the recording in a web browser instead");
            Ok(Shown::Web)
        }
        Err(reason) => Err(Failure::Input(format!(
            "{reason}\nhelp: install it with `pip install rerun-sdk==0.36.3`, or build pitchline with `--features web`"
        ))),
    }
}

fn without(feature: &str) -> Failure {
    Failure::Input(format!(
        "this program was built without the feature `{feature}`\nhelp: build it with `cargo build --release --features {feature}`"
    ))
}

/// Why the Rerun viewer cannot show a recording here.
#[derive(Debug)]
enum NoViewer {
    NotStarted {
        program: String,
        why: std::io::Error,
    },
    TooOld {
        program: String,
        version: (u32, u32),
    },
    /// What it prints for `--version` holds none.
    WithoutVersion {
        program: String,
    },
    NoScreen,
}

impl std::fmt::Display for NoViewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            NoViewer::NotStarted { program, why } => write!(f, "no program `{program}`: {why}"),
            NoViewer::TooOld { program, version: (major, minor) } => {
                write!(f, "`{program}` is version {major}.{minor}, which is too old: 0.36 is needed")
            }
            NoViewer::WithoutVersion { program } => write!(f, "`{program} --version` does not tell a version"),
            NoViewer::NoScreen => f.write_str("there is no screen for the Rerun viewer"),
        }
    }
}

impl std::error::Error for NoViewer {}

/// The `rerun` program if it can show these recordings here, or the reason why not. PITCHLINE_RERUN names another one.
fn native_viewer() -> Result<OsString, NoViewer> {
    let program = std::env::var_os("PITCHLINE_RERUN").unwrap_or_else(|| "rerun".into());
    let shown = program.to_string_lossy().into_owned();
    let out = match Command::new(&program).arg("--version").output() {
        Ok(out) => out,
        Err(why) => return Err(NoViewer::NotStarted { program: shown, why }),
    };
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    match version(&said) {
        // Newer viewers read older files; 0.41 was tried.
        Some(version) if version >= (0, 36) => {}
        Some(version) => return Err(NoViewer::TooOld { program: shown, version }),
        None => return Err(NoViewer::WithoutVersion { program: shown }),
    }
    let has_screen = |variable| std::env::var_os(variable).is_some_and(|value| !value.is_empty());
    if cfg!(target_os = "linux") && !has_screen("DISPLAY") && !has_screen("WAYLAND_DISPLAY") {
        return Err(NoViewer::NoScreen);
    }
    Ok(program)
}

/// Major and minor version in `rerun-cli 0.36.3 (...)`.
fn version(text: &str) -> Option<(u32, u32)> {
    let mut numbers = text.split_whitespace().nth(1)?.split('.').map(str::parse);
    Some((numbers.next()?.ok()?, numbers.next()?.ok()?))
}

/// Runs the Rerun viewer until its window is closed.
fn show(program: &OsString, path: &Path, stop: &AtomicBool) -> Result<Outcome, Failure> {
    // A separate window, accessible only from this machine.
    let mut viewer = Command::new(program)
        .arg(path)
        .args(["--bind", "127.0.0.1", "--port", "auto"])
        .spawn()
        .map_err(|e| Failure::World(format!("cannot start {}: {e}", program.display())))?;
    let mut asked = None;
    loop {
        let ended = viewer.try_wait().map_err(|e| Failure::World(format!("lost {}: {e}", program.display())))?;
        let interrupted = stop.load(Ordering::Relaxed);
        match ended {
            Some(_) if interrupted => return Ok(Outcome::Interrupted),
            // Ctrl-C in a terminal also reaches the viewer, which gets a moment to end by itself.
            None if interrupted && asked.get_or_insert_with(Instant::now).elapsed() > VIEWER_TIMEOUT => {
                let _killed = viewer.kill();
                let _ended = viewer.wait();
                return Ok(Outcome::Interrupted);
            }
            Some(status) if status.success() => return Ok(Outcome::Done),
            Some(status) => return Err(Failure::World(format!("{} ended with {status}", program.display()))),
            None => std::thread::sleep(Duration::from_millis(50)),
        }
    }
}

/// Writes an .mcap as .rrd, with the rows that the run itself would have written.
fn convert(from: &Path, to: &Path, stop: &AtomicBool) -> Result<Outcome, Failure> {
    if !cfg!(feature = "rerun") {
        return Err(without("rerun"));
    }
    let mut reader = super::open_recording(from)?;
    let mut sink = create(to, reader.header(), ViewOptions::default())?;
    let (_, _, damage) = super::replay::copy(&mut reader, sink.as_mut(), stop)?;
    if stop.load(Ordering::Relaxed) {
        eprintln!("note: a part of it lies in {}", sink.current_path().display());
        return Ok(Outcome::Interrupted);
    }
    sink.finish()?;
    super::print_missing(damage.iter().chain(reader.missing_since_open()));
    Ok(if damage.is_empty() && reader.missing().is_empty() { Outcome::Done } else { Outcome::DataLost })
}

/// A folder that only this user can read, removed when dropped.
struct TemporaryFolder(PathBuf);

impl TemporaryFolder {
    fn new() -> Result<TemporaryFolder, Failure> {
        let base = std::env::temp_dir();
        let mut builder = std::fs::DirBuilder::new();
        #[cfg(unix)]
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        // The name may belong to a run that was killed.
        for attempt in 0..100 {
            let path = base.join(format!("pitchline-view-{}-{attempt}", std::process::id()));
            match builder.create(&path) {
                Ok(()) => return Ok(TemporaryFolder(path)),
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(Failure::World(format!("cannot make {}: {e}", path.display()))),
            }
        }
        Err(Failure::World(format!("cannot make a folder in {}: all names are taken", base.display())))
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        if let Err(e) = std::fs::remove_dir_all(&self.0) {
            eprintln!("warning: cannot remove {}: {e}", self.0.display());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read() {
        assert_eq!(version("rerun-cli 0.36.3 (base lance) [rustc 1.95.0]"), Some((0, 36)));
        assert!(version("rerun-cli 0.4.0") < Some((0, 36)) && version("rerun-cli 1.0.0") > Some((0, 36)));
        assert_eq!(version("nonsense"), None);
    }
}
