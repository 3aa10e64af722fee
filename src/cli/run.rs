//! `pitchline run`: assembles a drive, runs it, records it.

use super::{Failure, Outcome, assemble, live, load_drive, print_json, print_out};
use crate::assemble::Assembly;
use crate::drive::Drive;
use crate::integrate::explicit::Scratch;
use crate::recording::frame::Header;
use crate::recording::{Output, Sink, ViewOptions, capture, create, extensions};
use crate::simulate::{Ending, Span, Summary, run as simulate};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

#[derive(clap::Args, Debug)]
pub struct RunArgs {
    /// Drive file or bundled name (see `pitchline drives`)
    drive: String,
    /// Recording to write, .mcap or .rrd; may be given several times [default: recordings/DRIVE.mcap and .rrd]
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
    /// Time between two pictures (poses and arrows in the viewers); numbers are in every frame
    #[arg(long, default_value = "200us", value_parser = duration)]
    picture_every: f64,
    /// Replace a value of the drive
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    live: live::LiveArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// A time with its unit, in seconds.
pub(super) fn duration(text: &str) -> Result<f64, String> {
    let units = [("us", 1e-6), ("ms", 1e-3), ("s", 1.0)];
    let parsed = units.iter().find_map(|(unit, factor)| {
        let number = text.trim().strip_suffix(unit)?;
        number.trim().parse::<f64>().ok().map(|n| n * factor)
    });
    match parsed {
        Some(t) if t.is_finite() && t > 0.0 => Ok(t),
        Some(_) => Err("must be positive".into()),
        None => Err("write a number with its unit: us, ms or s, e.g. 50us".into()),
    }
}

pub fn run(args: &RunArgs) -> Result<Outcome, Failure> {
    let drive = load_drive(&args.drive, &args.set)?;
    let paths = output_paths(args, &drive)?;
    let assembly = assemble(&drive)?;
    let span = Span::new(args.duration, args.every, assembly.model.step_s);
    let header = capture::header(&drive, &assembly.model, &assembly.report, span.steps_per_frame);
    let view = ViewOptions { picture_interval_s: args.picture_every };
    let stop = Arc::new(AtomicBool::new(false));
    // Viewers before files, so that none is overwritten where a viewer is missing; behind them in the list.
    let mut viewers = live::open(&args.live, &header, view, &stop)?;
    let mut sinks = open(&paths, &header, view)?;
    sinks.append(&mut viewers);
    let flag = Arc::clone(&stop);
    // Fails only where a handler was set before: then that one stands.
    let _set = ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    });
    let started = Instant::now();
    let Assembly { model, mut state, report } = assembly;
    let mut scratch = Scratch::new(&model);
    let bar = progress_bar(span.steps, model.step_s);
    let result =
        simulate(&model, &mut state, &mut scratch, &header, span, &mut sinks, &stop, |step| bar.set_position(step));
    bar.finish_and_clear();
    let wall_s = started.elapsed().as_secs_f64();
    let summary = match result {
        Ok(summary) => summary,
        Err(e) => {
            let written = paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
            // The others are still finished; the first error is the one that counts.
            for sink in &mut sinks {
                let _finished = sink.finish();
            }
            return Err(Failure::World(format!("{e:#}\nwhat was written up to there is kept in {written}")));
        }
    };
    live::finish(&mut sinks.split_off(paths.len()));
    let mut outputs = Vec::new();
    for sink in &mut sinks {
        let path = sink.path().to_path_buf();
        outputs.push(Output { bytes: sink.finish()?, path });
    }
    if let Ending::Broke(e) = &summary.ending {
        return Err(Failure::World(format!("{e}\nthe {} frames before it are kept", summary.frames)));
    }
    if args.json {
        print_json(&json(&drive, &header, &report, &summary, &outputs, wall_s, &scratch))?;
    } else {
        print_out(&text(&header, &summary, &outputs, wall_s))?;
    }
    Ok(if summary.ending == Ending::Interrupted { Outcome::Interrupted } else { Outcome::Done })
}

/// Where to write, checked before anything is computed.
fn output_paths(args: &RunArgs, drive: &Drive) -> Result<Vec<PathBuf>, Failure> {
    if args.no_output {
        return Ok(Vec::new());
    }
    let paths = if args.output.is_empty() {
        std::fs::create_dir_all("recordings").map_err(|e| Failure::World(format!("cannot make recordings/: {e}")))?;
        extensions().iter().map(|e| Path::new("recordings").join(format!("{}.{e}", drive.name))).collect()
    } else {
        args.output.clone()
    };
    for (i, path) in paths.iter().enumerate() {
        let shown = path.display();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        if path.is_dir() {
            return Err(Failure::Input(format!("{shown} is a directory, not a file to write")));
        }
        if !extensions().contains(&extension) {
            let all = extensions().iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(" or ");
            return Err(Failure::Input(format!("{shown}: recordings end in {all}")));
        }
        if paths[..i].contains(path) {
            return Err(Failure::Input(format!("{shown} is given twice")));
        }
        if let (Ok(a), Ok(b)) = (path.canonicalize(), Path::new(&args.drive).canonicalize())
            && a == b
        {
            return Err(Failure::Input(format!("{shown} is the drive itself; it is not overwritten")));
        }
    }
    Ok(paths)
}

fn open(paths: &[PathBuf], header: &Header, view: ViewOptions) -> Result<Vec<Box<dyn Sink>>, Failure> {
    let mut sinks = Vec::new();
    for path in paths {
        sinks.push(create(path, header, view)?);
    }
    Ok(sinks)
}

/// On stderr, and only on a terminal.
fn progress_bar(steps: u64, step_s: f64) -> ProgressBar {
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
    report: &crate::assemble::AssemblyReport,
    summary: &Summary,
    outputs: &[Output],
    wall_s: f64,
    scratch: &Scratch,
) -> serde_json::Value {
    let e = &summary.energy;
    let error_fraction = if e.work_in_j.abs() > 0.0 { e.error_j / e.work_in_j } else { 0.0 };
    serde_json::json!({
        "drive": drive.name,
        "simulated_s": summary.steps as f64 * header.step_s,
        "step_s": header.step_s,
        "steps": summary.steps,
        "frames": summary.frames,
        "wall_s": wall_s,
        "interrupted": summary.ending == Ending::Interrupted,
        "vector_unit": scratch.isa,
        "state_hash": format!("{:016x}", summary.state_hash),
        "outputs": outputs.iter().map(|o| serde_json::json!({ "path": o.path, "bytes": o.bytes })).collect::<Vec<_>>(),
        "energy": {
            "work_in_j": e.work_in_j,
            "work_out_j": e.work_out_j,
            "dissipated_j": e.lost_j(),
            "stored_change_j": summary.stored_last_j - summary.stored_first_j,
            "error_j": e.error_j,
            "error_fraction": error_fraction,
            "dissipated_by": {
                "pin_damping_j": e.lost_pin_damping_j,
                "pin_friction_j": e.lost_pin_friction_j,
                "contact_damping_j": e.lost_contact_damping_j,
                "contact_friction_j": e.lost_contact_friction_j,
                "guide_damping_j": e.lost_guide_damping_j,
                "guide_friction_j": e.lost_guide_friction_j,
            },
        },
        "assembly": report,
    })
}

fn text(header: &Header, summary: &Summary, outputs: &[Output], wall_s: f64) -> String {
    let simulated = summary.steps as f64 * header.step_s;
    let e = &summary.energy;
    let mut lines = vec![format!(
        "{}{}: {:.3} ms in {} steps of {:.3} us, {} frames, {:.2} s ({:.2} s per simulated second)",
        header.drive_name,
        if summary.ending == Ending::Interrupted { " (interrupted)" } else { "" },
        simulated * 1e3,
        summary.steps,
        header.step_s * 1e6,
        summary.frames,
        wall_s,
        wall_s / simulated
    )];
    lines.extend(header.assembly.iter().map(|l| format!("  {}", l.replacen(" = ", ": ", 1))));
    lines.push(format!(
        "  energy: {:.3} J in, {:.3} J out, {:.3} J lost, {:+.3} J stored; error {:+.2e} of the work put in",
        e.work_in_j,
        e.work_out_j,
        e.lost_j(),
        summary.stored_last_j - summary.stored_first_j,
        if e.work_in_j == 0.0 { 0.0 } else { e.error_j / e.work_in_j }
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
