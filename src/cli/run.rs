//! `pitchline run`: assembles a drive or continues a recording, runs it, stops at breakpoints, records it.

use super::{Failure, Outcome, assemble, live, load_drive, pair_stats, print_json, print_out};
use crate::assemble::{Assembly, AssemblyReport, compile_in_place};
use crate::breakpoint::scratch::BreakWatch;
use crate::breakpoint::{Breakpoint, Names};
use crate::drive::Drive;
use crate::impacts::ImpactWatch;
use crate::integrate::explicit::Scratch;
use crate::integrate::{Isa, scheme};
use crate::model::Model;
use crate::recording::capture::Camera;
use crate::recording::frame::{Energy, Header, Parent};
use crate::recording::{Output, Sink, ViewOptions, capture, create, extensions};
use crate::replay::{Replay, drive_of, resting};
use crate::simulate::{Breaks, DenseWindow, Ending, Job, RunLength, Summary, energy_json, hit_text, run_job};
use crate::state::State;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

#[derive(clap::Args, Debug)]
pub struct RunArgs {
    /// Drive file or bundled name (see `pitchline drives`)
    #[arg(required_unless_present = "resume", conflicts_with = "resume")]
    drive: Option<String>,
    /// Continue a recording instead: from its end, or from --at; with --set this makes a new branch
    #[arg(long, value_name = "REC")]
    resume: Option<PathBuf>,
    /// Where to continue, e.g. 12.3ms
    #[arg(long, value_name = "T", requires = "resume", conflicts_with = "drive", value_parser = instant)]
    at: Option<f64>,
    /// Stop when this becomes true, e.g. 'contact.normal_force > 500 N'; may be given several times
    #[arg(long = "break", value_name = "EXPR")]
    breaks: Vec<String>,
    /// Stop after this many hits [default: 1, or none with --around]
    #[arg(long, value_name = "N", requires = "breaks", value_parser = clap::value_parser!(u64).range(1..))]
    hits: Option<u64>,
    /// Do not stop: record densely for this long before and after each hit
    #[arg(long, value_name = "T", requires = "breaks", value_parser = duration)]
    around: Option<f64>,
    /// Time between two frames in these windows [default: every step]
    #[arg(long, value_name = "T", requires = "around", value_parser = duration)]
    around_every: Option<f64>,
    /// Recording to write, .mcap or .rrd; may be given several times [default: recordings/DRIVE.mcap and .rrd; DRIVE-break with --break]
    #[arg(short, long = "output", value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Write no recording
    #[arg(long, conflicts_with = "output")]
    no_output: bool,
    /// Simulated time after assembling, e.g. 0.2s or 90ms
    #[arg(long, default_value = "0.2s", value_parser = duration)]
    duration: f64,
    /// Time between two frames, e.g. 50us; rounded down to whole steps
    #[arg(long, default_value = "50us", value_parser = duration)]
    every: f64,
    /// Time between two pictures (poses and arrows in the viewers); the archive has the numbers of every frame
    /// [default: 200us for viewers and the .rrd, 400us in the archive]
    #[arg(long, value_parser = duration)]
    picture_every: Option<f64>,
    /// Replace a value of the drive
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Measure the cost of contact detection for each pair; this takes some time itself
    #[arg(long)]
    stats: bool,
    #[command(flatten)]
    live: live::LiveArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Frames after which the progress bar is told.
const FRAMES_PER_PROGRESS: u64 = 16;

/// A positive time with its unit, in seconds.
pub(super) fn duration(text: &str) -> Result<f64, String> {
    instant(text).and_then(|t| if t > 0.0 { Ok(t) } else { Err("must be positive".into()) })
}

/// A time with its unit, in seconds.
pub(super) fn instant(text: &str) -> Result<f64, String> {
    let units = [("us", 1e-6), ("ms", 1e-3), ("s", 1.0)];
    let parsed = units.iter().find_map(|(unit, factor)| {
        let number = text.trim().strip_suffix(unit)?;
        number.trim().parse::<f64>().ok().map(|n| n * factor)
    });
    match parsed {
        Some(t) if t.is_finite() && t >= 0.0 => Ok(t),
        Some(_) => Err("must be positive".into()),
        None => Err("write a number with its unit: us, ms or s, e.g. 50us".into()),
    }
}

/// Start of a run.
struct RunStart {
    drive: Drive,
    model: Model,
    state: State,
    header: Header,
    /// Has observed the previous steps, if there are any.
    impacts: ImpactWatch,
    report: Option<AssemblyReport>,
}

pub fn run(args: &RunArgs) -> Result<Outcome, Failure> {
    let drive = match (&args.drive, &args.resume) {
        (Some(drive), _) => load_drive(drive, &args.set)?,
        (None, Some(recording)) => resumed_drive(recording, &args.set)?,
        (None, None) => return Err(Failure::Input("give a drive, or --resume with a recording".into())),
    };
    let breakpoints = parse_breaks(&args.breaks, &drive)?;
    let paths = output_paths(args, &drive)?;
    let mut start = match &args.resume {
        None => assembled(drive)?,
        Some(recording) => resumed(args, recording, drive)?,
    };
    let step_s = start.model.step_s;
    let span = RunLength::new(args.duration, args.every, step_s);
    start.header.steps_per_frame = span.steps_per_frame;
    let breaks = breaks(args, breakpoints, &start.model)?;
    let view = args.picture_every.map_or_else(ViewOptions::default, ViewOptions::every);
    let stop = stop_on_interrupt();
    // Viewers are opened before files, so that a missing viewer leaves no file; in the list they follow the files.
    let mut viewers = live::open(&args.live, &start.header, view, &stop)?;
    let mut sinks = open(&paths, &start.header, view)?;
    sinks.append(&mut viewers);
    let started = Instant::now();
    let RunStart { drive, model, mut state, header, impacts, report } = start;
    let mut scratch = Scratch::new(&model);
    if args.stats {
        scratch.count_pairs(&model);
    }
    let first = state.step;
    let bar = progress_bar(span.steps, step_s);
    let job = Job { header: &header, span, breaks, impacts, camera: Camera::since(header.ledger_origin) };
    let mut frames = 0_u64;
    let progress = |step: u64| {
        // Each call takes a third of a per cent of a recorded run.
        frames += 1;
        if frames.is_multiple_of(FRAMES_PER_PROGRESS) {
            bar.set_position(step - first);
        }
    };
    let result = run_job(&model, &mut state, &mut scratch, job, &mut sinks, &stop, progress);
    bar.finish_and_clear();
    let wall_s = started.elapsed().as_secs_f64();
    let summary = match result {
        Ok(summary) => summary,
        Err(e) => {
            let written: Vec<String> =
                sinks.iter().take(paths.len()).map(|s| s.current_path().display().to_string()).collect();
            let written = written.join(", ");
            // The others are still finished; the first error is reported.
            for sink in &mut sinks {
                let _closed = sink.close();
            }
            return Err(Failure::World(format!("{e:#}\nwhat was written up to there is kept in {written}")));
        }
    };
    live::finish(&mut sinks.split_off(paths.len()));
    let well = matches!(summary.ending, Ending::Done | Ending::Hit);
    let outputs = finish(&mut sinks, well)?;
    if let Ending::Broke(e) = &summary.ending {
        let written: Vec<String> = outputs.iter().map(|o| o.path.display().to_string()).collect();
        let frames = summary.frames;
        return Err(Failure::World(format!("{e}\nthe {frames} frames before it are kept in {}", written.join(", "))));
    }
    let pairs = args.stats.then(|| scratch.pair_counts(&model));
    if args.json {
        let mut answer = json(&drive, &header, report.as_ref(), &summary, &outputs, wall_s, &scratch);
        if let (Some(pairs), Some(answer)) = (&pairs, answer.as_object_mut()) {
            answer.insert("contact_pairs".into(), pair_stats::json(pairs, wall_s));
        }
        print_json(&answer)?;
    } else {
        let said = text(&header, &summary, &outputs, (wall_s, !args.breaks.is_empty()));
        print_out(&(said + &pairs.map_or(String::new(), |pairs| pair_stats::text(&pairs, wall_s))))?;
    }
    Ok(if summary.ending == Ending::Interrupted { Outcome::Interrupted } else { Outcome::Done })
}

/// Set by Ctrl-C, and when nobody can read the result any more.
pub(super) fn stop_on_interrupt() -> Arc<AtomicBool> {
    let stop = stop_on_signal();
    #[cfg(unix)]
    stop_without_reader(&stop);
    stop
}

/// Time limit for the final message of an interrupted program.
const LAST_MESSAGE_TIMEOUT: std::time::Duration = std::time::Duration::from_millis(100);

/// Set by Ctrl-C. A second Ctrl-C ends the program at once and leaves its files as they are.
pub(super) fn stop_on_signal() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    // Fails only if a handler was set before, which then remains.
    let _set = ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            // On another thread, because nobody may read stderr and a second interrupt must not wait for that.
            let (told, is_told) = std::sync::mpsc::channel();
            std::thread::spawn(move || {
                let _written = writeln!(
                    std::io::stderr(),
                    "error: interrupted twice: files are left as they are, a recording may not be finished"
                );
                let _sent = told.send(());
            });
            let _waited = is_told.recv_timeout(LAST_MESSAGE_TIMEOUT);
            std::process::exit(1);
        }
    });
    stop
}

/// Ends a long verb, like Ctrl-C, when nobody can read its result any more because the program that started it has
/// ended.
#[cfg(unix)]
fn stop_without_reader(stop: &Arc<AtomicBool>) {
    use rustix::event::{PollFd, PollFlags, poll};
    use rustix::fs::{FileType, fstat};
    let is_pipe = |mode| matches!(FileType::from_raw_mode(mode), FileType::Fifo | FileType::Socket);
    if !fstat(std::io::stdout()).is_ok_and(|there| is_pipe(there.st_mode)) {
        return;
    }
    let stop = Arc::clone(stop);
    std::thread::spawn(move || {
        let stdout = std::io::stdout();
        // Polls for no event: returns when the other end is closed, or on a signal.
        loop {
            let mut ends = [PollFd::new(&stdout, PollFlags::empty())];
            match poll(&mut ends, None) {
                Ok(_) if ends[0].revents().intersects(PollFlags::ERR | PollFlags::HUP) => break,
                Ok(_) | Err(rustix::io::Errno::INTR) => {}
                Err(_) => return,
            }
        }
        if !stop.swap(true, Ordering::Relaxed) {
            eprintln!("nobody reads the result any more: ended as by Ctrl-C");
        }
    });
}

/// Finishes all files. Those of a successful run replace existing files; others are stored next to them.
pub(super) fn finish(sinks: &mut [Box<dyn Sink>], well: bool) -> Result<Vec<Output>, Failure> {
    let mut bytes = Vec::new();
    for sink in sinks.iter_mut() {
        bytes.push(sink.close()?);
    }
    let mut outputs = Vec::new();
    for (sink, bytes) in sinks.iter_mut().zip(bytes) {
        if well {
            sink.publish()?;
        } else if sink.current_path() != sink.path() {
            eprintln!(
                "note: {} existed before and is kept; this run did not finish, it is in {}",
                sink.path().display(),
                sink.current_path().display()
            );
        }
        outputs.push(Output { bytes, path: sink.current_path().to_path_buf() });
    }
    Ok(outputs)
}

fn assembled(drive: Drive) -> Result<RunStart, Failure> {
    let Assembly { model, state, report } = assemble(&drive)?;
    let mut header = capture::header(&drive, &model, &report, 1);
    header.ledger_origin = Some(ledger_at(&model, &state)?);
    let impacts = ImpactWatch::new(&model);
    Ok(RunStart { drive, model, state, header, impacts, report: Some(report) })
}

fn ledger_at(model: &Model, state: &State) -> Result<Energy, Failure> {
    capture::ledger_at(model, state).map_err(|e| Failure::World(e.to_string()))
}

/// The drive of a recording, with further overrides by the user.
fn resumed_drive(recording: &Path, set: &[String]) -> Result<Drive, Failure> {
    let reader = super::open_recording(recording)?;
    let header = reader.header();
    drive_of(recording, header, &[])?;
    let all: Vec<String> = header.overrides.iter().chain(set).cloned().collect();
    Drive::parse(&header.drive_name, &header.drive_text, &all).map_err(|report| Failure::Input(report.to_string()))
}

/// Continues a recording; changed values of the drive take effect from there.
fn resumed(args: &RunArgs, recording: &Path, drive: Drive) -> Result<RunStart, Failure> {
    let mut replay = Replay::open(recording)?;
    let Some((begin, end)) = replay.reader.ends()? else {
        return Err(Failure::Input(format!("{} holds no frames", recording.display())));
    };
    let step = args.at.map_or(end.step, |t_s| replay.step_at(t_s));
    if !(begin.step..=end.step).contains(&step) {
        return Err(Failure::Input(format!(
            "--at lies outside the recording, which goes from {:.4} to {:.4} ms",
            begin.t_s * 1e3,
            end.t_s * 1e3
        )));
    }
    let changed = !args.set.is_empty();
    let visit = replay.visit(step, |_, _| ())?;
    let parent: Parent = replay.parent(&visit.state, changed);
    if !changed {
        let header = Header { parent: Some(parent), ledger_origin: replay.origin, ..replay.header().clone() };
        let Replay { drive, model, .. } = replay;
        return Ok(RunStart { drive, model, state: visit.state, header, impacts: visit.impacts, report: None });
    }
    let model = compile_in_place(&drive, &replay.model).map_err(super::assembly_failure)?;
    if let Some(moved) = moved_body(&replay.model, &model) {
        return Err(Failure::Input(format!(
            "these changes {moved}, and a run cannot go on from there\nhelp: loads, speeds, contacts, joints and friction may \
             change on the way; for another geometry or preload run the drive from its start"
        )));
    }
    let mut state = resting(&model);
    state.restore(&visit.state.keyframe()).map_err(|e| {
        Failure::Input(format!("these changes make another State of the drive, and the run cannot go on from it: {e}"))
    })?;
    scheme::convert(&replay.model, &model, &mut state, Isa::detect()).map_err(anyhow::Error::from)?;
    // A branch has an energy ledger of its own.
    state.clear_ledger();
    let note = vec!["assembly = none: goes on from a recorded State of another drive".to_string()];
    let mut header = capture::header_of(&drive, &model, replay.header().static_tension_n, note, 1);
    (header.parent, header.ledger_origin) = (Some(parent), Some(ledger_at(&model, &state)?));
    let impacts = ImpactWatch::for_continued_run(&model, state.step);
    Ok(RunStart { drive, model, state, header, impacts, report: None })
}

/// A sprocket with another position or tooth count in the second model.
fn moved_body(before: &Model, after: &Model) -> Option<String> {
    // Tolerance for another order of summation; far below any effect on contacts.
    const UNMOVED_M: f64 = 1e-9;
    for (a, b) in before.sprockets.iter().zip(&after.sprockets) {
        if a.geometry.teeth() != b.geometry.teeth() {
            return Some(format!("give sprocket `{}` {} teeth", b.name, b.geometry.teeth()));
        }
        let moved_m = (a.frame.origin - b.frame.origin).norm();
        if moved_m > UNMOVED_M {
            return Some(format!("move sprocket `{}` by {:.3} um", b.name, moved_m * 1e6));
        }
    }
    let racks = |m: &Model| m.ratchets.iter().map(|r| (r.pitch_m, r.backlash_m)).collect::<Vec<_>>();
    if racks(before) != racks(after) {
        return Some("change, add or take away a ratchet".to_string());
    }
    let counts = |m: &Model| [m.sprockets.len(), m.guides.len(), m.arms.len(), m.rails.len()];
    let same_number = counts(before) == counts(after);
    (!same_number).then(|| "add or take away a sprocket, a guide or an arm".to_string())
}

/// Reads the break expressions; returns all errors at once.
pub(super) fn parse_breaks(expressions: &[String], drive: &Drive) -> Result<Vec<Breakpoint>, Failure> {
    let names = Names::of(drive);
    let (mut good, mut bad) = (Vec::new(), Vec::new());
    for expression in expressions {
        match Breakpoint::parse(expression, &names) {
            Ok(breakpoint) => good.push(breakpoint),
            Err(report) => bad.push(report.to_string()),
        }
    }
    if bad.is_empty() { Ok(good) } else { Err(Failure::Input(bad.join("\n\n"))) }
}

fn breaks(args: &RunArgs, breakpoints: Vec<Breakpoint>, model: &Model) -> Result<Option<Breaks>, Failure> {
    if breakpoints.is_empty() {
        return Ok(None);
    }
    if args.around.is_some_and(|t_s| t_s > LONGEST_AROUND_S) {
        let most = LONGEST_AROUND_S * 1e3;
        return Err(Failure::Input(format!("--around is at most {most} ms: what it covers is held in memory")));
    }
    let steps = |t_s: f64| whole_steps(t_s, model.step_s);
    let around_every = args.around_every.map_or(1, steps);
    let around = args.around.map(|t_s| DenseWindow { steps: steps(t_s), steps_per_frame: around_every });
    let hits = match (args.hits, around) {
        (Some(hits), _) => Some(usize::try_from(hits).unwrap_or(usize::MAX)),
        (None, Some(_)) => None,
        (None, None) => Some(1),
    };
    let continues_run = args.resume.is_some();
    let watch = |b| {
        let mut watch = BreakWatch::new(b, model);
        watch.continues_run = continues_run;
        watch
    };
    Ok(Some(Breaks { watches: breakpoints.into_iter().map(watch).collect(), hits, around }))
}

/// Steps that fit into a time, at least one.
#[expect(clippy::cast_possible_truncation, reason = "a number of steps, rounded")]
pub(super) fn whole_steps(t_s: f64, step_s: f64) -> u64 {
    (t_s / step_s * (1.0 + 1e-9)).floor().max(1.0) as u64
}

/// Longest window before and after a hit [s].
const LONGEST_AROUND_S: f64 = 0.1;

/// Output paths, checked before anything is computed.
fn output_paths(args: &RunArgs, drive: &Drive) -> Result<Vec<PathBuf>, Failure> {
    if args.no_output {
        return Ok(Vec::new());
    }
    let paths = if args.output.is_empty() {
        std::fs::create_dir_all("recordings").map_err(|e| Failure::World(format!("cannot make recordings/: {e}")))?;
        let name = match (&args.resume, args.at) {
            (None, _) => drive.name.clone(),
            (Some(_), None) => format!("{}-resumed", drive.name),
            (Some(_), Some(t_s)) => format!("{}-from-{:.3}ms", drive.name, t_s * 1e3),
        };
        // A run that a break expression ends does not replace the whole recording.
        let name = if args.breaks.is_empty() { name } else { format!("{name}-break") };
        extensions().iter().map(|e| Path::new("recordings").join(format!("{name}.{e}"))).collect()
    } else {
        args.output.clone()
    };
    let inputs: Vec<&Path> = args.drive.iter().map(Path::new).chain(args.resume.as_deref()).collect();
    check_recordings(&paths, &inputs)?;
    Ok(paths)
}

/// Checks that recordings have a known format and do not overwrite an input.
pub(super) fn check_recordings(paths: &[PathBuf], inputs: &[&Path]) -> Result<(), Failure> {
    for path in paths {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        if !path.is_dir() && !extensions().contains(&extension) {
            let all = extensions().iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(" or ");
            return Err(Failure::Input(format!("{}: recordings end in {all}", path.display())));
        }
    }
    super::check_outputs(paths.iter().map(PathBuf::as_path), inputs.iter().copied())
}

pub(super) fn open(paths: &[PathBuf], header: &Header, view: ViewOptions) -> Result<Vec<Box<dyn Sink>>, Failure> {
    let mut sinks = Vec::new();
    for path in paths {
        sinks.push(create(path, header, view)?);
    }
    Ok(sinks)
}

/// Hits in the printed text; JSON contains more.
const HITS_PRINTED: usize = 20;

/// Progress bar on stderr, only on a terminal.
pub(super) fn progress_bar(steps: u64, step_s: f64) -> ProgressBar {
    let bar = ProgressBar::new(steps);
    let template = "{bar:40} {percent:>3} %  {msg}  {elapsed} elapsed, {eta} to go";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_message(format!("{:.0} ms simulated", steps as f64 * step_s * 1e3));
    bar
}

fn json(
    drive: &Drive,
    header: &Header,
    report: Option<&AssemblyReport>,
    summary: &Summary,
    outputs: &[Output],
    wall_s: f64,
    scratch: &Scratch,
) -> serde_json::Value {
    let e = &summary.energy;
    serde_json::json!({
        "drive": drive.name,
        "simulated_s": summary.steps as f64 * header.step_s,
        "step_s": header.step_s,
        "steps": summary.steps,
        "frames": summary.frames,
        "wall_s": wall_s,
        "interrupted": summary.ending == Ending::Interrupted,
        "stopped_at_break": summary.ending == Ending::Hit,
        "from_s": header.parent.as_ref().map_or(0.0, |p| p.t_s),
        "impacts": summary.impacts,
        "n_hits": summary.n_hits,
        "lift_offs": summary.lift_offs,
        "hits": summary.hits.iter().map(|h| serde_json::json!({
            "step": h.step,
            "t_s": h.t_s,
            "what": hit_text(h, header),
            "subject": subject_json(h, header),
        })).collect::<Vec<_>>(),
        "scheme": summary.scheme,
        "vector_unit": scratch.isa,
        "state_hash": format!("{:016x}", summary.state_hash),
        "outputs": outputs.iter().map(|o| serde_json::json!({ "path": o.path, "bytes": o.bytes })).collect::<Vec<_>>(),
        "energy": energy_json(e, [summary.stored_first_j, summary.stored_last_j]),
        "assembly": report,
    })
}

fn subject_json(hit: &crate::breakpoint::Hit, header: &Header) -> serde_json::Value {
    use crate::breakpoint::Subject;
    use crate::recording::frame::Feature;
    match hit.subject {
        Subject::Drive => serde_json::Value::Null,
        Subject::Link(link) => serde_json::json!({ "link": link }),
        Subject::Joint(joint) => serde_json::json!({ "joint": joint }),
        Subject::Contact { link, feature, body } => serde_json::json!({
            "link": link,
            "feature": Feature::name(feature),
            "body": header.bodies.get(body as usize).map(|b| b.path.as_str()),
            "tooth": hit.impact.map(|i| i.tooth),
        }),
    }
}

fn text(header: &Header, summary: &Summary, outputs: &[Output], (wall_s, asked): (f64, bool)) -> String {
    let simulated = summary.steps as f64 * header.step_s;
    let e = &summary.energy;
    let mut lines = vec![format!(
        "{}{}: {:.3} ms in {} steps of {:.3} us, {} frames, {:.2} s ({:.2} s per simulated second)",
        header.drive_name,
        match summary.ending {
            Ending::Interrupted => " (interrupted)",
            Ending::Hit => " (stopped at a breakpoint)",
            Ending::Done | Ending::Broke(_) => "",
        },
        simulated * 1e3,
        summary.steps,
        header.step_s * 1e6,
        summary.frames,
        wall_s,
        wall_s / simulated.max(header.step_s)
    )];
    lines.extend(summary.scheme.iter().map(|s| format!("  scheme: {}", s.text())));
    if let Some(parent) = &header.parent {
        let branch = if parent.changed { "a branch of" } else { "goes on from" };
        lines.push(format!(
            "  {branch} {} at {:.4} ms, state {:016x}",
            parent.recording,
            parent.t_s * 1e3,
            parent.state_hash
        ));
    }
    if asked && summary.hits.is_empty() {
        lines.push("  no hit: the expression was never fulfilled".into());
    }
    for hit in summary.hits.iter().take(HITS_PRINTED) {
        lines.push(format!("  break at {:.4} ms, step {}: {}", hit.t_s * 1e3, hit.step, hit_text(hit, header)));
    }
    if summary.n_hits > HITS_PRINTED as u64 {
        lines.push(format!("  ... and {} more hits", summary.n_hits - HITS_PRINTED as u64));
    }
    lines.extend(header.assembly.iter().map(|l| format!("  {}", l.replacen(" = ", ": ", 1))));
    lines.extend(summary.lift_offs.iter().map(|l| format!("  {}", l.text())));
    lines.push(format!(
        "  energy: {:.3} J in, {:.3} J out, {:.3} J lost, {:+.3} J stored; error {:+.2e} of the work put in",
        e.put_in_j(),
        e.work_out_j,
        e.lost_j(),
        summary.stored_last_j - summary.stored_first_j,
        if e.put_in_j() == 0.0 { 0.0 } else { e.error_j / e.put_in_j() }
    ));
    lines.push(format!("  state hash: {:016x}", summary.state_hash));
    for output in outputs {
        let per_frame = output.bytes as f64 / summary.frames.max(1) as f64;
        lines.push(format!(
            "  wrote {} ({:.1} MB, {per_frame:.0} bytes per frame)",
            output.path.display(),
            output.bytes as f64 / 1e6
        ));
    }
    lines.join("\n") + "\n"
}
