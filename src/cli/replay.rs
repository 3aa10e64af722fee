//! `pitchline replay`: runs a recording's drive again and compares, or repairs a file that was cut off.

use super::run::{check_recordings, progress_bar, stop_on_interrupt};
use super::{Answer, Failure, Outcome, add_field, answer, print_json, print_out};
use crate::recording::reader::{Entry, Flow, Reader, Wanted};
use crate::recording::{ViewOptions, create};
use crate::replay::{Replay, Verdict, verify};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

#[derive(clap::Args, Debug)]
pub struct ReplayArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Run the recorded drive again and compare every frame and keyframe, to the bit
    #[arg(long, required_unless_present = "repair")]
    verify: bool,
    /// Copy the intact content of a cut-off or damaged file into a finished one
    #[arg(long, conflicts_with = "verify", requires = "output")]
    repair: bool,
    /// File that --repair writes
    #[arg(short, long = "output", value_name = "FILE", conflicts_with = "verify")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &ReplayArgs) -> Result<Outcome, Failure> {
    match &args.output {
        Some(output) if args.repair => repair(args, output),
        _ => verified(args),
    }
}

fn verified(args: &ReplayArgs) -> Result<Outcome, Failure> {
    // A file that cannot be opened is an error of the user; one that cannot be replayed is a fault of the recording.
    super::open_recording(&args.recording)?;
    let mut replay = Replay::open(&args.recording)?;
    let last = replay.reader.ends()?.map_or(0, |(_, last)| last.step);
    let bar = progress_bar(last, replay.model.step_s);
    let verdict = verify(&mut replay, &stop_on_interrupt(), |step| bar.set_position(step))?;
    bar.finish_and_clear();
    let Some(verdict) = verdict else { return Ok(Outcome::Interrupted) };
    let found = if args.json {
        let mut value = serde_json::json!(verdict);
        add_field(&mut value, "recording", serde_json::json!(args.recording));
        add_field(&mut value, "complete", serde_json::json!(replay.reader.complete()));
        Answer::Json(value)
    } else {
        Answer::Text(text(&args.recording, &verdict))
    };
    let outcome = match (verdict.mismatches, verdict.missing_frames) {
        (0, 0) => Outcome::Done,
        (0, _) => Outcome::DataLost,
        _ => Outcome::Differs,
    };
    answer(&[&replay.reader], found, outcome)
}

fn text(path: &Path, verdict: &Verdict) -> String {
    let how = if verdict.assembled { "assembled anew and run again" } else { "run again from its first keyframe" };
    let mut lines = vec![format!(
        "{}: {how}: {} of {} frames and keyframes differ; last state {}",
        path.display(),
        verdict.mismatches,
        verdict.frames + verdict.keyframes,
        verdict.state_hash
    )];
    if verdict.missing_frames > 0 {
        let stated = verdict.frames + verdict.missing_frames;
        lines.push(format!("  {} of {stated} frames that should be there are missing", verdict.missing_frames));
    }
    if let Some(first) = &verdict.first {
        lines.push(format!(
            "  first at frame {}, step {}, {:.6} ms: {}",
            first.frame,
            first.step,
            first.t_s * 1e3,
            first.what
        ));
    }
    lines.join("\n") + "\n"
}

/// Copies message by message and skips chunks that cannot be read.
fn repair(args: &ReplayArgs, output: &Path) -> Result<Outcome, Failure> {
    check_recordings(&[output.to_path_buf()], &[&args.recording])?;
    let mut reader = super::open_recording(&args.recording)?;
    let mut sink = create(output, reader.header(), ViewOptions::default())?;
    let stop = stop_on_interrupt();
    let (frames, until, damage) = copy(&mut reader, sink.as_mut(), &stop)?;
    if stop.load(Ordering::Relaxed) {
        eprintln!("note: a part of it lies in {}", sink.current_path().display());
        return Ok(Outcome::Interrupted);
    }
    let bytes = sink.finish()?;
    super::print_missing(damage.iter().chain(reader.missing_since_open()));
    let lost: Vec<String> = damage.into_iter().chain(reader.missing().iter().cloned()).collect();
    if args.json {
        print_json(&serde_json::json!({
            "output": output, "bytes": bytes, "frames": frames, "until_s": until, "lost": lost,
        }))?;
    } else {
        let lines: String = lost.iter().map(|l| format!("  {l}\n")).collect();
        print_out(&format!("wrote {}: {frames} frames, up to {:.4} ms\n{lines}", output.display(), until * 1e3))?;
    }
    Ok(if lost.is_empty() { Outcome::Done } else { Outcome::DataLost })
}

/// Frames copied, the time of the last one, and what could not be read.
pub(super) fn copy(
    reader: &mut Reader,
    sink: &mut dyn crate::recording::Sink,
    stop: &AtomicBool,
) -> Result<(u64, f64, Vec<String>), Failure> {
    let wanted = Wanted { frames: true, heads: false, keyframes: true, events: true, impacts: true };
    let (mut frames, mut until) = (0, 0.0);
    let mut cannot_write = None;
    let mut damage: Vec<String> = Vec::new();
    let each = |entry: Entry<'_>| {
        let written = match &entry {
            Entry::Frame(frame) => {
                frames += 1;
                until = frame.t_s;
                sink.frame(frame)
            }
            Entry::Keyframe(keyframe) => sink.keyframe(keyframe),
            Entry::Event(event) => sink.event(event),
            Entry::Impact(impact) => sink.impact(impact),
            Entry::Head(_) => Ok(()),
        };
        Ok(match written {
            Ok(()) if stop.load(Ordering::Relaxed) => Flow::Enough,
            Ok(()) => Flow::On,
            Err(e) => {
                cannot_write = Some(e);
                Flow::Enough
            }
        })
    };
    reader.each_sound(wanted, each, |e, (from_s, to_s)| {
        damage.push(format!("lost: {:.4} to {:.4} ms: {e:#}", from_s * 1e3, to_s * 1e3));
    })?;
    if let Some(e) = cannot_write {
        return Err(e.into());
    }
    Ok((frames, until, damage))
}
