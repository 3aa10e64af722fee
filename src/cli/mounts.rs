//! `pitchline mounts`: forces on what carries the drive, and the order that leads each.

use super::sheet::digits;
use super::{Answer, Failure, Outcome, answer};
use crate::analysis::mounts::{Balance, Mount, mounts};
use crate::analysis::order_spectrum::{AngleRecorder, SpectrumPeak, spectrum};
use crate::analysis::signal::Signal;
use crate::recording::frame::Frame;
use crate::recording::reader::{Entry, Flow, WHOLE, Wanted};
use std::fmt::Write;
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct MountsArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Leave out frames before this time
    #[arg(long, value_name = "T", value_parser = super::run::instant)]
    from: Option<f64>,
    /// Leave out frames after this time
    #[arg(long, value_name = "T", value_parser = super::run::instant)]
    to: Option<f64>,
    /// Print JSON
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print the forces of all frames as CSV
    #[arg(long)]
    csv: bool,
}

/// A mount over the frames.
#[derive(serde::Serialize)]
struct MountForces {
    mount: String,
    /// Mean force, and its direction from +x.
    mean_x_n: f64,
    mean_y_n: f64,
    mean_n: f64,
    direction_deg: f64,
    /// Root mean square of what differs from the mean.
    swing_n: f64,
    largest_n: f64,
    largest_at_s: f64,
    /// The order with the largest amplitude, of x or y; None where the recording is too short for a spectrum.
    lead: Option<LeadingOrder>,
    notes: Vec<String>,
}

#[derive(serde::Serialize)]
struct LeadingOrder {
    axis: &'static str,
    #[serde(flatten)]
    peak: SpectrumPeak,
}

/// One mount with what is collected of it.
struct WatchedMount {
    mount: Mount,
    series: Vec<(f64, [f64; 2])>,
    axes: [AngleRecorder; 2],
}

pub fn run(args: &MountsArgs) -> Result<Outcome, Failure> {
    let mut reader = super::open_recording(&args.recording)?;
    let header = reader.header().clone();
    let name = reader.path().display().to_string();
    let (from_s, to_s) = (args.from.unwrap_or(WHOLE.0), args.to.unwrap_or(WHOLE.1));
    if to_s < from_s {
        return Err(Failure::Input("--from is later than --to".into()));
    }
    let told = |why: String| Failure::Input(format!("{name}: {why}"));
    let recorder = |mount: &Mount, axis: &str| -> Result<AngleRecorder, Failure> {
        let signal = Signal::find(&format!("mount.{}.{axis}", mount.path), &header);
        Ok(AngleRecorder::new(signal.map_err(|e| told(e.to_string()))?, &header))
    };
    let watched = |mount: Mount| -> Result<WatchedMount, Failure> {
        let axes = [recorder(&mount, "x")?, recorder(&mount, "y")?];
        Ok(WatchedMount { mount, series: Vec::new(), axes })
    };
    let found = mounts(&header).map_err(told)?;
    let mut all: Vec<WatchedMount> = found.into_iter().map(watched).collect::<Result<_, _>>()?;
    let mut balance = Balance::default();
    reader.each(Wanted { frames: true, ..Wanted::default() }, (from_s, to_s), |entry| {
        if let Entry::Frame(frame) = entry
            && (from_s..=to_s).contains(&frame.t_s)
        {
            balance.add(frame, &header);
            all.iter_mut().for_each(|w| w.add(frame, &header));
        }
        Ok(Flow::On)
    })?;
    let frames = all.first().map_or(0, |w| w.series.len());
    if frames == 0 {
        return Err(told("there are no frames in this time".into()));
    }
    let (left_n, largest_n) = balance.left_n();
    if args.csv {
        return answer(&[&reader], Answer::Text(csv(&all)), Outcome::Done);
    }
    let rows: Vec<MountForces> = all.into_iter().map(|w| w.finish(&header)).collect();
    let found = if args.json {
        Answer::Json(serde_json::json!({
            "recording": args.recording,
            "frames": frames,
            "mounts": rows,
            "unbalanced_n": left_n,
            "largest_contact_n": largest_n,
        }))
    } else {
        Answer::Text(text(&name, frames, &rows, (left_n, largest_n)))
    };
    answer(&[&reader], found, Outcome::Done)
}

impl WatchedMount {
    fn add(&mut self, frame: &Frame, header: &crate::recording::frame::Header) {
        self.series.push((frame.t_s, self.mount.force(frame)));
        self.axes.iter_mut().for_each(|axis| axis.add(frame, header));
    }

    fn finish(self, header: &crate::recording::frame::Header) -> MountForces {
        let n = self.series.len().max(1) as f64;
        let sum = self.series.iter().fold([0.0; 2], |[x, y], (_, [fx, fy])| [x + fx, y + fy]);
        let mean = sum.map(|sum| sum / n);
        let off = |f: &[f64; 2]| (f[0] - mean[0]).powi(2) + (f[1] - mean[1]).powi(2);
        let swing_n = libm::sqrt(self.series.iter().map(|(_, f)| off(f)).sum::<f64>() / n);
        let size = |f: &[f64; 2]| libm::hypot(f[0], f[1]);
        let largest = self.series.iter().max_by(|a, b| size(&a.1).total_cmp(&size(&b.1)));
        let (largest_at_s, largest_n) = largest.map_or((0.0, 0.0), |(t_s, f)| (*t_s, size(f)));
        let lead = |(axis, recorder): (&'static str, AngleRecorder)| {
            let found = spectrum(&recorder.finish(header)).ok()?;
            let peak = found.peaks.into_iter().max_by(|a, b| a.amplitude.total_cmp(&b.amplitude))?;
            Some(LeadingOrder { axis, peak })
        };
        let leads = ["x", "y"].into_iter().zip(self.axes).filter_map(lead);
        MountForces {
            mean_x_n: mean[0],
            mean_y_n: mean[1],
            mean_n: size(&mean),
            direction_deg: libm::atan2(mean[1], mean[0]).to_degrees(),
            swing_n,
            largest_n,
            largest_at_s,
            lead: leads.max_by(|a, b| a.peak.amplitude.total_cmp(&b.peak.amplitude)),
            mount: self.mount.path,
            notes: self.mount.notes,
        }
    }
}

fn csv(all: &[WatchedMount]) -> String {
    let mut text = String::from("t_s");
    for w in all {
        for axis in ["x", "y"] {
            let name = format!("{}.{axis}_n", w.mount.path);
            let is_plain = !name.contains([',', '"', '\n', '\r']);
            let quoted = if is_plain { name } else { format!("\"{}\"", name.replace('"', "\"\"")) };
            let _infallible = write!(text, ",{quoted}");
        }
    }
    text.push('\n');
    let times = all.first().map(|w| w.series.iter().map(|(t_s, _)| *t_s)).into_iter().flatten();
    for (k, t_s) in times.enumerate() {
        let _infallible = write!(text, "{t_s}");
        for (_, [x, y]) in all.iter().filter_map(|w| w.series.get(k)) {
            let _infallible = write!(text, ",{x:e},{y:e}");
        }
        text.push('\n');
    }
    text
}

fn text(name: &str, frames: usize, rows: &[MountForces], (left_n, largest_n): (f64, f64)) -> String {
    let wide = rows.iter().map(|r| r.mount.len()).max().unwrap_or(0).max(5);
    let mut text = format!(
        "{name}: forces on what carries the drive, {frames} frames\n\
         {:wide$}    mean [N]  direction [deg]   swing rms [N]  largest [N]   at [ms]  leading order\n",
        "mount"
    );
    for r in rows {
        let lead = r.lead.as_ref().map_or("-".to_string(), |lead| {
            let p = &lead.peak;
            let names = if p.names.is_empty() { String::new() } else { format!(", {}", p.names.join(", ")) };
            let (order, hz) = (p.order, p.frequency_hz);
            format!("{order:.3} in {}: {} N at {hz:.1} Hz{names}", lead.axis, digits(p.amplitude))
        });
        let _infallible = writeln!(
            text,
            "{:wide$}  {:>10}  {:>15}  {:>14}  {:>11}  {:>8}  {lead}",
            r.mount,
            digits(r.mean_n),
            if r.mean_n > 0.0 { format!("{:.2}", r.direction_deg) } else { "-".into() },
            digits(r.swing_n),
            digits(r.largest_n),
            if r.largest_n > 0.0 { format!("{:.3}", 1e3 * r.largest_at_s) } else { "-".into() },
        );
    }
    for (r, note) in rows.iter().flat_map(|r| r.notes.iter().map(move |note| (r, note))) {
        let _infallible = writeln!(text, "note: {}: {note}", r.mount);
    }
    if rows.iter().all(|r| r.lead.is_none()) {
        text.push_str("note: no leading orders: the recording has too few frames or turns for a spectrum\n");
    }
    if largest_n == 0.0 {
        return text;
    }
    let _infallible = writeln!(
        text,
        "all contacts together change the momentum of links and rollers within {} N (rms; the largest contact has {} N)",
        digits(left_n),
        digits(largest_n)
    );
    text
}
