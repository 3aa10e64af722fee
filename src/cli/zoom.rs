//! `pitchline zoom`: records a part of a recording again, as densely as wanted, with bit-identical steps.

use super::run::{check_recordings, duration, finish, instant, open, stop_on_interrupt, whole_steps};
use super::{Answer, Failure, Outcome, answer};
use crate::recording::frame::Header;
use crate::recording::{OpensAt, ViewOptions, extensions};
use crate::replay::Replay;
use crate::simulate::{Ending, Job, RunLength, run_job};
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct ZoomArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Start of the window, e.g. 12.30ms
    #[arg(long, value_parser = instant, required_unless_present = "impact")]
    from: Option<f64>,
    /// End of the window
    #[arg(long, value_parser = duration, required_unless_present = "impact")]
    to: Option<f64>,
    /// Around this impact instead: a number from `pitchline impacts`
    #[arg(long, value_name = "N", conflicts_with_all = ["from", "to"])]
    impact: Option<usize>,
    /// With --impact: time before and after it
    #[arg(long, value_name = "T", value_parser = duration, default_value = "0.3ms")]
    around: f64,
    /// Steps between two frames, or a time between them, e.g. 2us
    #[arg(long, value_name = "STEPS|T", default_value = "1")]
    every: String,
    /// Recording to write, .mcap or .rrd; may be given several times [default: recordings/DRIVE-zoom.mcap and .rrd]
    #[arg(short, long = "output", value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Share of --around that is shown behind a peak that comes late.
const BEHIND_PEAK: f64 = 0.2;

pub fn run(args: &ZoomArgs) -> Result<Outcome, Failure> {
    super::open_recording(&args.recording)?;
    let mut replay = Replay::open(&args.recording)?;
    let Some((begin, end)) = replay.reader.ends()? else {
        return Err(Failure::Input(format!("{} holds no frames", args.recording.display())));
    };
    let (from_s, to_s, opens_at) = window(args, &mut replay, (begin.t_s, end.t_s))?;
    let (from, to) = (replay.step_at(from_s), replay.step_at(to_s));
    if from < begin.step || to > end.step || from >= to {
        return Err(Failure::Input(format!(
            "the window from {:.4} to {:.4} ms does not lie inside the recording, which goes from {:.4} to {:.4} ms",
            from_s * 1e3,
            to_s * 1e3,
            begin.t_s * 1e3,
            end.t_s * 1e3
        )));
    }
    let steps_per_frame = every(&args.every, replay.model.step_s)?;
    let outputs = if args.output.is_empty() {
        std::fs::create_dir_all("recordings").map_err(|e| Failure::World(format!("cannot make recordings/: {e}")))?;
        let name = &replay.drive.name;
        extensions().iter().map(|e| PathBuf::from(format!("recordings/{name}-zoom.{e}"))).collect()
    } else {
        args.output.clone()
    };
    check_recordings(&outputs, &[&args.recording])?;
    let mut visit = replay.visit(from, |_, _| ())?;
    let parent = Some(replay.parent(&visit.state, false));
    let ledger_origin = replay.origin;
    let header = Header { steps_per_frame, parent, ledger_origin, ..replay.header().clone() };
    // The frame with the peak, not the one before it.
    let (first_s, frame_s) = (from as f64 * replay.model.step_s, steps_per_frame as f64 * replay.model.step_s);
    let at_frame = |at: OpensAt| OpensAt { t_s: first_s + ((at.t_s - first_s) / frame_s).round() * frame_s, ..at };
    let view = ViewOptions { opens_at: opens_at.map(at_frame), ..ViewOptions::every(0.0) };
    let mut sinks = open(&outputs, &header, view)?;
    let job = Job {
        header: &header,
        span: RunLength { steps: to - from, steps_per_frame },
        breaks: None,
        impacts: visit.impacts,
        camera: replay.camera(),
    };
    let stop = stop_on_interrupt();
    let summary = run_job(&replay.model, &mut visit.state, &mut visit.scratch, job, &mut sinks, &stop, |_| ())?;
    let outputs = finish(&mut sinks, matches!(summary.ending, Ending::Done | Ending::Hit))?;
    let found = if args.json {
        Answer::Json(serde_json::json!({
            "recording": args.recording,
            "from_s": from as f64 * header.step_s,
            "to_s": to as f64 * header.step_s,
            "from_step": from,
            "to_step": to,
            "steps_per_frame": steps_per_frame,
            "frames": summary.frames,
            "keyframe_step": visit.since,
            "state_hash": format!("{:016x}", summary.state_hash),
            "outputs": outputs.iter().map(|o| serde_json::json!({ "path": o.path, "bytes": o.bytes })).collect::<Vec<_>>(),
        }))
    } else {
        let mut text = format!(
            "{:.4} to {:.4} ms, every {steps_per_frame} steps of {:.3} us: {} frames, from the keyframe at {:.4} ms\n",
            from as f64 * header.step_s * 1e3,
            to as f64 * header.step_s * 1e3,
            header.step_s * 1e6,
            summary.frames,
            visit.since as f64 * header.step_s * 1e3
        );
        for output in &outputs {
            text += &format!("  wrote {} ({:.1} MB)\n", output.path.display(), output.bytes as f64 / 1e6);
        }
        Answer::Text(text)
    };
    let interrupted = summary.ending == Ending::Interrupted;
    answer(&[&replay.reader], found, if interrupted { Outcome::Interrupted } else { Outcome::Done })
}

/// Begin and end of what is recorded again [s], and where a viewer opens; `all`: begin and end of the recording.
fn window(args: &ZoomArgs, replay: &mut Replay, all: (f64, f64)) -> Result<(f64, f64, Option<OpensAt>), Failure> {
    let Some(number) = args.impact else { return Ok((args.from.unwrap_or(0.0), args.to.unwrap_or(all.1), None)) };
    let impact = super::impacts::numbered(&mut replay.reader, number)?;
    let peak = OpensAt { t_s: impact.t_s + impact.peak_after_s, point_m: [impact.x_m, impact.y_m] };
    let to_s = (impact.t_s + args.around).max(peak.t_s + BEHIND_PEAK * args.around);
    Ok(((impact.t_s - args.around).max(all.0), to_s.min(all.1), Some(peak)))
}

/// A number of steps, or a time rounded to whole steps.
fn every(text: &str, step_s: f64) -> Result<u64, Failure> {
    if let Ok(steps) = text.trim().parse::<u64>()
        && steps > 0
    {
        return Ok(steps);
    }
    let t_s = duration(text).map_err(|e| Failure::Input(format!("--every {text}: {e}, or a number of steps")))?;
    Ok(whole_steps(t_s, step_s))
}
