//! `pitchline identify`: compares measured records with a drive.

use super::{Failure, Outcome, print_json, print_out};
use crate::identify::report::{IdentificationReport, IdentificationVerdict};
use crate::identify::search::{Budget, Context};
use crate::identify::updated::updated;
use crate::identify::{identify, text};
use crate::machine::Machine;
use crate::measurement::Measurement;
use crate::measurement::columns::Memory;
use crate::measurement::segments::{Data, DataError, load};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;
use std::time::Instant;

#[derive(clap::Args, Debug)]
pub struct IdentifyArgs {
    /// Measurement file (.toml), which names the measured data and the drive
    measurement: PathBuf,
    /// Write the drive with the identified effects (.toml), or measured, before and after on one timeline (.rrd); may
    /// be given twice
    #[arg(short, long = "output", value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Write a report with diagrams
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Stop the search after this many model runs (2000) or this time (90s, 5min); the results so far are reported
    #[arg(long, value_parser = budget)]
    budget: Option<Budget>,
    /// Threads; they do not change the result unless a budget ends the search
    #[arg(long)]
    threads: Option<usize>,
    /// Only read and check the files, and print facts about the data
    #[arg(long)]
    facts: bool,
    /// Memory limit for the measured data, e.g. 500MB or 4GB
    #[arg(long, value_name = "SIZE", default_value = "1GB", value_parser = memory)]
    memory: usize,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// `500MB` or `4GB`.
fn memory(text: &str) -> Result<usize, String> {
    let units = [("GB", 1e9), ("MB", 1e6)];
    let parsed = units.iter().find_map(|(unit, size)| {
        text.trim().strip_suffix(unit).and_then(|number| number.trim().parse::<f64>().ok()).map(|n| n * size)
    });
    match parsed {
        #[expect(clippy::cast_possible_truncation, reason = "what is behind the point is less than a byte")]
        Some(bytes) if (1e6..=1e15).contains(&bytes) => Ok(bytes as usize),
        _ => Err("write a number with MB or GB, from 1MB to 1000000GB, e.g. 4GB".into()),
    }
}

/// `2000`, `90s` or `5min`.
fn budget(text: &str) -> Result<Budget, String> {
    let wrong = || format!("`{text}` is not a budget: write a number of runs (2000) or a time (90s, 5min)");
    if let Ok(runs) = text.parse::<u64>() {
        return Ok(Budget { runs: Some(runs), seconds: None });
    }
    let (number, unit) = match (text.strip_suffix("min"), text.strip_suffix('s')) {
        (Some(n), _) => (n, 60.0),
        (_, Some(n)) => (n, 1.0),
        _ => return Err(wrong()),
    };
    match number.trim().parse::<f64>() {
        Ok(n) if n > 0.0 && n.is_finite() => Ok(Budget { runs: None, seconds: Some(n * unit) }),
        _ => Err(wrong()),
    }
}

/// Largest measurement or drive file [bytes].
const LARGEST: u64 = 1 << 20;

pub(super) fn read_text(path: &Path, what: &str) -> Result<String, Failure> {
    let shown = path.display();
    let cannot = |e: std::io::Error| Failure::Input(format!("cannot read {what} `{shown}`: {e}"));
    let metadata = std::fs::metadata(path).map_err(cannot)?;
    if metadata.is_dir() {
        return Err(Failure::Input(format!("`{shown}` is a directory, not a {what}")));
    }
    if metadata.len() > LARGEST {
        return Err(Failure::Input(format!("`{shown}` has {} bytes; a {what} has at most {LARGEST}", metadata.len())));
    }
    let mut text = String::new();
    crate::input::open(path).and_then(|file| file.take(LARGEST + 1).read_to_string(&mut text)).map_err(cannot)?;
    // Special files do not state their length and may never end.
    if text.len() as u64 > LARGEST {
        return Err(Failure::Input(format!("`{shown}` has more bytes than a {what} has at most: {LARGEST}")));
    }
    Ok(text)
}

/// Everything that is read before a model is run.
struct IdentifyInput {
    measurement: Measurement,
    machine: Machine,
    data: Data,
}

/// Reads measurement, drive and data. All errors are found before a model is run.
fn read(path: &Path, memory: usize) -> Result<IdentifyInput, Failure> {
    let input = |r: crate::diag::Report| Failure::Input(r.to_string());
    let text = read_text(path, "measurement file")?;
    let measurement = Measurement::parse(&path.display().to_string(), &text).map_err(input)?;
    let folder = path.parent().map_or_else(PathBuf::new, PathBuf::from);
    let bundled = crate::drive::BUNDLED.iter().find(|(name, _)| *name == measurement.drive);
    let (name, text) = match bundled {
        Some((name, text)) => ((*name).to_string(), (*text).to_string()),
        None => {
            let path = folder.join(&measurement.drive);
            (path.display().to_string(), read_text(&path, "drive file")?)
        }
    };
    let machine = Machine::of_file(&name, &text).map_err(input)?;
    if machine.sensors.is_empty() {
        let help = "add `[sensors.tachometer.SPROCKET]`; `pitchline sensors` lists the kinds";
        return Err(Failure::Input(format!("drive `{}` has no sensors\nhelp: {help}", measurement.drive)));
    }
    let data = load(&measurement, &machine, &folder, &mut Memory::for_program(memory)).map_err(|e| match e {
        DataError::File(report) => Failure::Input(report.to_string()),
        DataError::World(text) => Failure::Input(text),
    })?;
    Ok(IdentifyInput { measurement, machine, data })
}

/// Refuses outputs that are inputs.
fn check_outputs(args: &IdentifyArgs, measurement: &Measurement) -> Result<(), Failure> {
    let folder = args.measurement.parent().map_or_else(PathBuf::new, PathBuf::from);
    let mut inputs = vec![args.measurement.clone(), folder.join(&measurement.drive)];
    inputs.extend(measurement.files.iter().map(|f| folder.join(&f.path)));
    let outputs = || args.output.iter().chain(&args.report);
    super::check_outputs(outputs().map(PathBuf::as_path), inputs.iter().map(PathBuf::as_path))?;
    for out in outputs() {
        let shown = out.display();
        let kind = out.extension().and_then(|e| e.to_str()).unwrap_or_default();
        let fits = if args.report.as_ref() == Some(out) { kind == "html" } else { matches!(kind, "toml" | "rrd") };
        if !fits {
            return Err(Failure::Input(format!(
                "{shown}: the drive is written as .toml, the series as .rrd, the report as .html"
            )));
        }
        if kind == "rrd" && cfg!(not(feature = "rerun")) {
            return Err(Failure::Input(format!("{shown}: this pitchline was built without rerun")));
        }
    }
    Ok(())
}

pub fn run(args: &IdentifyArgs) -> Result<Outcome, Failure> {
    let IdentifyInput { measurement, machine, data } = read(&args.measurement, args.memory)?;
    check_outputs(args, &measurement)?;
    for w in &data.warnings {
        eprintln!("warning: {w}");
    }
    if args.facts {
        return facts(args, &data);
    }
    let stop = super::run::stop_on_interrupt();
    let runs = AtomicU64::new(0);
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}  {pos} model runs, {elapsed}") {
        bar.set_style(style);
    }
    let say = |stage: &str, runs: u64| {
        bar.set_message(stage.to_string());
        bar.set_position(runs);
    };
    let context = Context {
        threads: args.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from)),
        budget: args.budget.unwrap_or(Budget { runs: None, seconds: None }),
        started: Instant::now(),
        stop: &stop,
        progress: &say,
        runs: &runs,
    };
    let report = identify(&measurement, &machine, &data, &context).map_err(|e| {
        Failure::Input(format!(
            "{e}\nhelp: check the drive's numbers and units, and the record's start (`start = \"rest\"`?)"
        ))
    })?;
    bar.finish_and_clear();
    write(args, &machine, &report)?;
    if args.json {
        let mut json = serde_json::to_value(&report).map_err(|e| Failure::World(e.to_string()))?;
        if let Some(object) = json.as_object_mut() {
            object.insert("missing".into(), serde_json::json!(data.missing));
        }
        print_json(&json)?;
    } else {
        print_out(&text::text(&report))?;
    }
    Ok(if report.interrupted {
        Outcome::Interrupted
    } else if matches!(report.outcome, IdentificationVerdict::Ambiguous | IdentificationVerdict::Lead)
        || !report.doubts.is_empty()
        || report.is_misread
        || !report.converged
        || report.budget_spent
        || !data.missing.is_empty()
        || !report.explained
        || report.numbers_after.iter().any(|n| n.at_bound)
    {
        // A result was printed, but it is uncertain.
        Outcome::DataLost
    } else {
        Outcome::Done
    })
}

fn facts(args: &IdentifyArgs, data: &Data) -> Result<Outcome, Failure> {
    if args.json {
        return print_json(
            &serde_json::json!({ "records": data.clocks, "channels": data.facts, "wheels": data.wheels, "warnings": data.warnings }),
        );
    }
    let mut text = String::new();
    for c in &data.clocks {
        text += &format!(
            "record {}: {} samples, {:.6} 1/s, jitter {:.3} %, {} gaps, {:.4} s\n",
            c.record, c.samples, c.rate_hz, c.jitter_percent, c.gaps, c.length_s
        );
    }
    for f in &data.facts {
        text += &format!(
            "channel {} in {}: {} .. {} {}, noise {:.3e}, grid {:.3e}, clipped {:.1} %, {} missing, {} at rest\n",
            f.channel,
            f.record,
            f.low,
            f.high,
            f.unit,
            f.noise,
            f.quantisation,
            f.clipped_percent,
            f.missing,
            f.rest_samples
        );
    }
    for w in &data.wheels {
        text += &format!("{w}\n");
    }
    text += &format!("{} parts to compare\n", data.segments.len());
    print_out(&text)
}

fn write(args: &IdentifyArgs, machine: &Machine, report: &IdentificationReport) -> Result<(), Failure> {
    let put = |path: &Path, text: &str| crate::output::write(path, text.as_bytes()).map_err(Failure::from);
    for out in &args.output {
        if out.extension().is_some_and(|e| e == "toml") {
            put(out, &updated(machine, report).map_err(|e| Failure::World(e.to_string()))?)?;
        } else {
            write_series(out, report)?;
        }
    }
    if let Some(out) = &args.report {
        put(out, &crate::render::identify::html(report))?;
    }
    Ok(())
}

#[cfg(feature = "rerun")]
fn write_series(out: &Path, report: &IdentificationReport) -> Result<(), Failure> {
    use crate::recording::rerun::measured::{Series, write};
    let mut all = Vec::new();
    for (i, c) in report.curves.iter().enumerate() {
        for (name, values) in [("measured", &c.measured), ("before", &c.before), ("after", &c.after)] {
            all.push(Series { path: format!("{}/{}/{i}/{name}", c.record, c.channel), t_s: &c.t_s, values });
        }
    }
    write(out, &report.title, &all).map_err(Failure::from)
}

#[cfg(not(feature = "rerun"))]
fn write_series(out: &Path, _report: &IdentificationReport) -> Result<(), Failure> {
    Err(Failure::Input(format!("{}: this pitchline was built without rerun", out.display())))
}
