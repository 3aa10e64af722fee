//! `pitchline compare`: drives side by side, judged by the impacts on their drivers.

use super::{Failure, Outcome, load_drive, print_json, print_out};
use crate::assemble::AssemblyError;
use crate::compare::{CompareError, Plan, Run, Summary, merge, run as compare, verdict};
use crate::recording::{ViewOptions, create, extensions};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(clap::Args, Debug)]
pub struct CompareArgs {
    /// Drives to compare [default: bush-20-40, silent-20-40, smartchain-20-40]
    drives: Vec<String>,
    /// Simulated time after assembling that is judged, e.g. 120ms
    #[arg(long, default_value = "120ms", value_parser = super::run::duration)]
    duration: f64,
    /// How much of it is recorded, from its start
    #[arg(long, default_value = "20ms", value_parser = super::run::duration)]
    recorded: f64,
    /// Time between two recorded frames
    #[arg(long, default_value = "50us", value_parser = super::run::duration)]
    every: f64,
    /// Folder for compare.html, compare.mcap and compare.rrd
    #[arg(short, long = "output", value_name = "FOLDER", default_value = "recordings")]
    output: PathBuf,
    /// Write nothing
    #[arg(long)]
    no_output: bool,
    /// Replace a value of every drive, or of one of them: NAME:PATH=VALUE
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &CompareArgs) -> Result<Outcome, Failure> {
    let bundled = || crate::drive::BUNDLED.iter().map(|(n, _)| (*n).to_string()).collect();
    let names: Vec<String> = if args.drives.is_empty() { bundled() } else { args.drives.clone() };
    let mut drives = Vec::new();
    for name in &names {
        let own = |s: &String| match s.split_once(':') {
            Some((drive, set)) if !drive.contains('=') => (drive == name).then(|| set.to_string()),
            _ => Some(s.clone()),
        };
        drives.push(load_drive(name, &args.set.iter().filter_map(own).collect::<Vec<_>>())?);
    }
    if let Some(s) = args
        .set
        .iter()
        .find(|s| s.split_once(':').is_some_and(|(drive, _)| !drive.contains('=') && !names.iter().any(|n| n == drive)))
    {
        return Err(Failure::Input(format!("`--set {s}` names a drive that is not compared: {}", names.join(", "))));
    }
    if !args.no_output {
        std::fs::create_dir_all(&args.output)
            .map_err(|e| Failure::World(format!("cannot make {}: {e}", args.output.display())))?;
    }
    let stop = super::run::stop_on_interrupt();
    let started = Instant::now();
    let plan = Plan { duration_s: args.duration, recorded_s: args.recorded.min(args.duration), every_s: args.every };
    let runs = match compare(&drives, plan, &stop) {
        Ok(runs) => runs,
        Err(CompareError::Interrupted) => return Ok(Outcome::Interrupted),
        Err(e) => return Err(failure(&e)),
    };
    let wall_s = started.elapsed().as_secs_f64();
    let summaries: Vec<&Summary> = runs.iter().map(|r| &r.summary).collect();
    let claims = verdict(&summaries).unwrap_or_default();
    let mut outputs = Vec::new();
    if !args.no_output {
        outputs = record(&runs, &args.output)?;
        let page = args.output.join("compare.html");
        let shown: Vec<String> = outputs.iter().map(|p| p.display().to_string()).collect();
        std::fs::write(&page, crate::render::compare::html(&runs, &claims, &shown))
            .map_err(|e| Failure::World(format!("cannot write {}: {e}", page.display())))?;
        outputs.push(page);
    }
    let holds = claims.iter().filter(|c| !c.contrast).all(|c| c.holds);
    let speeds = || summaries.iter().map(|s| s.turning_speed_m_s);
    if speeds().any(|v| (v / summaries[0].turning_speed_m_s - 1.0).abs() > 0.02) {
        eprintln!("warning: the drivers turn at different speeds; the recording shows the first one's crank angle");
    }
    if args.json {
        return print_json(&serde_json::json!({
            "drives": summaries,
            "claims": claims,
            "impact_free": (!claims.is_empty()).then_some(holds),
            "simulated_s": args.duration,
            "wall_s": wall_s,
            "outputs": outputs,
        }));
    }
    let mut text = table(&summaries);
    for c in &claims {
        let _infallible = writeln!(text, "{} {}: {}", if c.holds { "yes" } else { "NO " }, c.claim, c.measured);
    }
    if !claims.is_empty() {
        text += if holds {
            "\nThe abutment chain engages without impact.\n"
        } else {
            "\nThe abutment chain does NOT engage without impact here: see the claims that fail.\n"
        };
    }
    let _infallible = writeln!(text, "{:.0} ms of each drive in {wall_s:.1} s", args.duration * 1e3);
    for path in &outputs {
        let _infallible = writeln!(text, "wrote {}", path.display());
    }
    print_out(&text)
}

/// Whose fault it is.
pub(super) fn failure(e: &CompareError) -> Failure {
    match e {
        CompareError::Step { .. } | CompareError::Assembly { error: AssemblyError::RunIn(_), .. } => {
            Failure::World(e.to_string())
        }
        _ => Failure::Input(e.to_string()),
    }
}

fn table(summaries: &[&Summary]) -> String {
    let mut text = format!(
        "{:<18} {:<16} {:>7} {:>8} {:>17} {:>10} {:>8} {:>9} {:>8}\n",
        "drive", "contact", "passes", "touch T", "approach m/s", "engaging N", "lap N", "pitch 2 N", "rise T"
    );
    for s in summaries {
        for (i, k) in s.kinds.iter().enumerate() {
            let _infallible = writeln!(
                text,
                "{:<18} {:<16} {:>7} {:>8.3} {:>8.4} {:>8.4} {:>10.1} {:>8.1} {:>9.1} {:>8}",
                if i == 0 { s.drive.as_str() } else { "" },
                format!("{:?}", k.kind),
                k.passes,
                k.first_touch_t,
                k.approach_median_m_s,
                k.approach_max_m_s,
                k.peak_window_n,
                k.peak_lap_n,
                k.second_pitch_n,
                if k.rise_t.is_nan() { "-".to_string() } else { format!("{:.3}", k.rise_t) }
            );
        }
        let _infallible = writeln!(
            text,
            "{:<18} tight span {:.1} N (rho v2 {:.1} N), tooth-order speed ripple {:.3} %",
            "",
            s.tight_tension_n,
            s.centrifugal_tension_n,
            100.0 * s.speed_ripple
        );
    }
    text + "\n"
}

/// Writes the merged recording in every format there is.
fn record(runs: &[Run], folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let headers: Vec<_> = runs.iter().map(|r| &r.header).collect();
    let (header, parts) = merge::headers("compare", &headers);
    let mut paths = Vec::new();
    for extension in extensions() {
        let path = folder.join(format!("compare.{extension}"));
        let mut sink = create(&path, &header, ViewOptions::default())?;
        let n = runs.iter().map(|r| r.frames.len()).min().unwrap_or(0);
        for i in 0..n {
            let at: Vec<_> = runs.iter().map(|r| &r.frames[i]).collect();
            sink.frame(&merge::frames(&parts, &at))?;
            let (from, to) =
                (if i == 0 { f64::NEG_INFINITY } else { runs[0].frames[i - 1].t_s }, runs[0].frames[i].t_s);
            for (part, run) in parts.iter().zip(runs) {
                for event in run.events.iter().filter(|e| e.t_s > from && e.t_s <= to) {
                    sink.event(&merge::event(part, event))?;
                }
            }
        }
        sink.finish()?;
        paths.push(path);
    }
    Ok(paths)
}
