//! `pitchline compare`: drives side by side, judged by the impacts on their drivers.

use super::{Failure, Outcome, load_drive, print_json, print_out};
use crate::assemble::AssemblyError;
use crate::compare::laws::{LawRow, under_all_laws};
use crate::compare::{Claim, CompareError, DriveSummary, Plan, Run, merge, run as compare, verdict};
use crate::drive::{Drive, OuterSpec};
use crate::recording::frame::Impact;
use crate::recording::{ViewOptions, create, extensions};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(clap::Args, Debug)]
pub struct CompareArgs {
    /// Drives to compare [default: bush-20-40, silent-20-40, smartchain-20-40]
    drives: Vec<String>,
    /// The drives as a comma-separated list
    #[arg(long = "drives", value_name = "NAME,...", value_delimiter = ',', conflicts_with = "drives")]
    named: Vec<String>,
    /// Speed of the drivers [rpm]; several, separated by commas, show the dependence on speed. The first is recorded
    #[arg(long, value_name = "RPM,...", value_delimiter = ',', value_parser = above_zero)]
    speed_rpm: Vec<f64>,
    /// Load torque on the driven sprockets [N m]
    #[arg(long, value_name = "NM", value_parser = super::finite, allow_negative_numbers = true)]
    load_nm: Option<f64>,
    /// Simulated time after assembling that is evaluated, e.g. 120ms
    #[arg(long, default_value = "120ms", value_parser = super::run::duration)]
    duration: f64,
    /// Part of it that is recorded, from its start
    #[arg(long, default_value = "20ms", value_parser = super::run::duration)]
    recorded: f64,
    /// Time between two recorded frames
    #[arg(long, default_value = "50us", value_parser = super::run::duration)]
    every: f64,
    /// Folder for compare.html, compare.mcap and compare.rrd
    #[arg(short, long = "output", value_name = "FOLDER", default_value = "recordings")]
    output: PathBuf,
    /// Write no files
    #[arg(long)]
    no_output: bool,
    /// Replace a value of every drive, or of one of them: NAME:PATH=VALUE
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Run all drives under three contact laws with three restitutions each, and say whether the claim holds in all; exit code 1 if it
    /// does not. Writes no files
    #[arg(long)]
    laws: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn above_zero(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() && v > 0.0 => Ok(v),
        _ => Err("a number above 0 is needed".into()),
    }
}

/// All drives, with their drivers at the given speed if there is one.
fn drives(args: &CompareArgs, names: &[String], speed_rpm: Option<f64>) -> Result<Vec<Drive>, Failure> {
    let mut drives = Vec::new();
    for name in names {
        let own = |s: &String| match s.split_once(':') {
            Some((drive, set)) if !drive.contains('=') => (drive == name).then(|| set.to_string()),
            _ => Some(s.clone()),
        };
        let mut sets: Vec<String> = args.set.iter().filter_map(own).collect();
        let mut drive = load_drive(name, &sets)?;
        if speed_rpm.is_some() || args.load_nm.is_some() {
            for s in &drive.sprockets {
                match (s.outer, speed_rpm, args.load_nm) {
                    (OuterSpec::Speed { .. }, Some(rpm), _) => {
                        sets.push(format!("speeds.constant.{}.speed_rpm={rpm}", s.name));
                    }
                    (OuterSpec::Load { .. }, _, Some(nm)) => {
                        sets.push(format!("loads.constant.{}.torque_nm={nm}", s.name));
                    }
                    (OuterSpec::Speed { .. }, None, _) | (OuterSpec::Load { .. }, _, None) => {}
                }
            }
            drive = load_drive(name, &sets)?;
        }
        drives.push(drive);
    }
    Ok(drives)
}

/// Refuses a value for a drive that is not compared.
fn check_named(args: &CompareArgs, names: &[String]) -> Result<(), Failure> {
    if let Some(s) = args
        .set
        .iter()
        .find(|s| s.split_once(':').is_some_and(|(drive, _)| !drive.contains('=') && !names.iter().any(|n| n == drive)))
    {
        return Err(Failure::Input(format!("`--set {s}` names a drive that is not compared: {}", names.join(", "))));
    }
    Ok(())
}

/// Makes the folder for the files, which must not overwrite a drive.
fn make_folder(args: &CompareArgs, names: &[String]) -> Result<(), Failure> {
    let files: Vec<PathBuf> =
        extensions().iter().chain(&["html"]).map(|e| args.output.join(format!("compare.{e}"))).collect();
    super::check_outputs(files.iter().map(PathBuf::as_path), names.iter().map(Path::new))?;
    std::fs::create_dir_all(&args.output)
        .map_err(|e| Failure::World(format!("cannot make {}: {e}", args.output.display())))
}

pub fn run(args: &CompareArgs) -> Result<Outcome, Failure> {
    let bundled = || crate::drive::CHAIN_TYPES.map(str::to_string).to_vec();
    let named = if args.named.is_empty() { &args.drives } else { &args.named };
    let names: Vec<String> = if named.is_empty() { bundled() } else { named.clone() };
    check_named(args, &names)?;
    let first = drives(args, &names, args.speed_rpm.first().copied())?;
    // Errors at other speeds are reported before anything runs.
    let others: Vec<(f64, Vec<Drive>)> = args
        .speed_rpm
        .iter()
        .skip(1)
        .map(|rpm| Ok((*rpm, drives(args, &names, Some(*rpm))?)))
        .collect::<Result<_, Failure>>()?;
    if args.laws {
        return under_laws(args, &first);
    }
    if !args.no_output {
        make_folder(args, &names)?;
    }
    let stop = super::run::stop_on_interrupt();
    let started = Instant::now();
    let plan = Plan { duration_s: args.duration, recorded_s: args.recorded.min(args.duration), every_s: args.every };
    let mut sweep: Vec<(f64, Vec<DriveSummary>)> = Vec::new();
    let all = |drives: &[Drive], plan| match compare(drives, plan, &stop) {
        Ok(runs) => Ok(Some(runs)),
        Err(CompareError::Interrupted) => Ok(None),
        Err(e) => Err(failure(&e)),
    };
    let Some(runs) = all(&first, plan)? else { return Ok(Outcome::Interrupted) };
    if let Some(rpm) = args.speed_rpm.first().filter(|_| !others.is_empty()) {
        sweep.push((*rpm, runs.iter().map(|r| r.summary.clone()).collect()));
    }
    for (rpm, drives) in &others {
        let Some(runs) = all(drives, Plan { recorded_s: 0.0, ..plan })? else { return Ok(Outcome::Interrupted) };
        sweep.push((*rpm, runs.into_iter().map(|r| r.summary).collect()));
    }
    sweep.sort_by(|a, b| a.0.total_cmp(&b.0));
    let wall_s = started.elapsed().as_secs_f64();
    let summaries: Vec<&DriveSummary> = runs.iter().map(|r| &r.summary).collect();
    let claims = verdict(&summaries).unwrap_or_default();
    let mut outputs = Vec::new();
    if !args.no_output {
        outputs = record(&runs, &args.output)?;
        let page = args.output.join("compare.html");
        let shown: Vec<String> = outputs.iter().map(|p| p.display().to_string()).collect();
        crate::output::write(&page, crate::render::compare::html(&runs, &claims, &sweep, &shown).as_bytes())?;
        outputs.push(page);
    }
    let holds = claims.iter().filter(|c| !c.contrast).all(|c| c.holds);
    let speeds = || summaries.iter().map(|s| s.turning_speed_m_s);
    if let Some(first) = speeds().next()
        && speeds().any(|v| (v / first - 1.0).abs() > 0.02)
    {
        eprintln!("warning: the drivers turn at different speeds; the recording shows the first one's crank angle");
    }
    if args.json {
        return print_json(&serde_json::json!({
            "drives": summaries,
            "claims": claims,
            "sweep": sweep.iter().map(|(rpm, of)| serde_json::json!({"speed_rpm": rpm, "drives": of})).collect::<Vec<_>>(),
            "impact_free": (!claims.is_empty()).then_some(holds),
            "simulated_s": args.duration,
            "wall_s": wall_s,
            "outputs": outputs,
        }));
    }
    let mut text = table(&summaries) + &sweep_table(&sweep) + &told(&claims, holds);
    let _infallible = writeln!(text, "{:.0} ms of each drive in {wall_s:.1} s", args.duration * 1e3);
    for path in &outputs {
        let _infallible = writeln!(text, "wrote {}", path.display());
    }
    print_out(&text)
}

/// The claims, a line each, and what they come to.
fn told(claims: &[Claim], holds: bool) -> String {
    let mut text = String::new();
    for c in claims {
        let _infallible = writeln!(text, "{} {}: {}", if c.holds { "yes" } else { "NO " }, c.claim, c.measured);
    }
    text += match (claims.is_empty(), holds) {
        (true, _) => "",
        (false, true) => "\nThe abutment chain engages without impact.\n",
        (false, false) => "\nThe abutment chain does NOT engage without impact here: see the claims that fail.\n",
    };
    text
}

/// `--laws`: the claim under other contact laws.
fn under_laws(args: &CompareArgs, drives: &[Drive]) -> Result<Outcome, Failure> {
    if args.speed_rpm.len() > 1 {
        return Err(Failure::Input("`--laws` takes one speed: give `--speed-rpm` one number".into()));
    }
    let stop = super::run::stop_on_interrupt();
    let plan = Plan { duration_s: args.duration, recorded_s: 0.0, every_s: args.every };
    let told = |row: &LawRow| eprintln!("{}, restitution {}: done", row.law.words(), row.restitution);
    let rows = match under_all_laws(drives, plan, &stop, told) {
        Ok(rows) => rows,
        Err(CompareError::Interrupted) => return Ok(Outcome::Interrupted),
        Err(e) => return Err(failure(&e)),
    };
    let holds = rows.iter().all(LawRow::holds);
    let printed = if args.json {
        print_json(&serde_json::json!({"laws": rows, "holds_in_all": holds, "simulated_s": args.duration}))?
    } else {
        print_out(&laws_table(&rows))?
    };
    Ok(if holds || printed == Outcome::Interrupted { printed } else { Outcome::Differs })
}

/// A line for each law and restitution: fastest touch in shares of p omega, and largest force while engaging.
fn laws_table(rows: &[LawRow]) -> String {
    let Some(first) = rows.first() else { return String::new() };
    let mut text = format!("{:<27} {:>4}", "contact law", "e");
    for d in &first.drives {
        let _infallible = write!(text, "  {:>24}", format!("{} %, N", d.drive));
    }
    text += "  claim\n";
    for row in rows {
        let _infallible = write!(text, "{:<27} {:>4.1}", row.law.words(), row.restitution);
        for d in &row.drives {
            let _infallible = write!(text, "  {:>14.2} {:>9.1}", 100.0 * d.touch_share, d.peak_n);
        }
        text += if row.holds() { "  yes\n" } else { "  NO\n" };
    }
    text += "\n%: first touch over p omega, of an abutment chain the fastest, of another the median seating; N: largest force while engaging\n";
    for row in rows.iter().filter(|row| !row.failing.is_empty()) {
        for claim in &row.failing {
            let _infallible = writeln!(text, "NO {}, restitution {}: {claim}", row.law.words(), row.restitution);
        }
    }
    let without = |abutments: bool| first.drives.iter().any(|d| d.abutments == abutments);
    let claim = match (without(true), without(false)) {
        (true, true) => "Abutment chains engage without impact, the others strike their teeth",
        (true, false) => "Abutment chains engage without impact",
        (false, _) => "All chains strike their teeth",
    };
    let failing = rows.iter().filter(|row| !row.holds()).count();
    text + &match failing {
        0 => format!("\n{claim}: under all {} laws.\n", rows.len()),
        n => format!("\n{claim}: NOT under {n} of {} laws.\n", rows.len()),
    }
}

/// Whether the user or the environment caused the error.
pub(super) fn failure(e: &CompareError) -> Failure {
    match e {
        CompareError::Step { .. } | CompareError::Assembly { error: AssemblyError::RunIn(_), .. } => {
            Failure::World(e.to_string())
        }
        CompareError::Assembly { .. }
        | CompareError::Drive(_)
        | CompareError::NothingSeen { .. }
        | CompareError::NoLinks { .. }
        | CompareError::Interrupted => Failure::Input(e.to_string()),
    }
}

fn table(summaries: &[&DriveSummary]) -> String {
    let mut text = format!(
        "{:<18} {:<22} {:>7} {:>8} {:>17} {:>10} {:>8} {:>9} {:>8}\n",
        "drive", "contact", "passes", "touch T", "approach m/s", "engaging N", "lap N", "pitch 2 N", "rise T"
    );
    for s in summaries {
        for (i, k) in s.kinds.iter().enumerate() {
            let _infallible = writeln!(
                text,
                "{:<18} {:<22} {:>7} {:>8.3} {:>8.4} {:>8.4} {:>10.1} {:>8.1} {:>9.1} {:>8}",
                if i == 0 { s.drive.as_str() } else { "" },
                k.kind.words(),
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
        let fastest: Vec<String> = s
            .touches
            .iter()
            .map(|t| {
                let name = crate::diag::last_name(&t.body);
                format!("{name} {:.3} m/s ({}, {:.0} N)", t.approach_max_m_s, t.part, t.peak_there_n)
            })
            .collect();
        let _infallible = writeln!(text, "{:<18} fastest touch anywhere: {}", "", fastest.join(", "));
    }
    text + "  touch: tooth periods T since the front joint of a link passed the end of the straight span; approach: closing speed then, median and largest;\n  \
            engaging, lap: largest force while the link engages, and all round the driver; pitch 2: mean force over the second tooth period\n\n"
}

/// Largest contact force and highest approach speed over the speed.
fn sweep_table(sweep: &[(f64, Vec<DriveSummary>)]) -> String {
    let Some((_, first)) = sweep.first() else { return String::new() };
    let mut text = format!("{:>8}", "rpm");
    for s in first {
        let _infallible = write!(text, "  {:>28}", format!("{} N, m/s", s.drive));
    }
    text.push('\n');
    for (rpm, of) in sweep {
        let _infallible = write!(text, "{rpm:>8.0}");
        for s in of {
            let _infallible = write!(text, "  {:>18.1} {:>9.4}", s.largest_n().0, s.fastest_touch_m_s());
        }
        text.push('\n');
    }
    text + "\n"
}

/// Writes the merged recording in every available format.
fn record(runs: &[Run], folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let headers: Vec<_> = runs.iter().map(|r| &r.header).collect();
    let (header, parts) = merge::headers("compare", &headers);
    let mut paths = Vec::new();
    for extension in extensions() {
        let path = folder.join(format!("compare.{extension}"));
        let mut sink = create(&path, &header, ViewOptions::default())?;
        let n = runs.iter().map(|r| r.frames.len()).min().unwrap_or(0);
        let mut from = f64::NEG_INFINITY;
        for i in 0..n {
            let at: Vec<_> = runs.iter().filter_map(|r| r.frames.get(i)).collect();
            sink.frame(&merge::frames(&parts, &at))?;
            let to = at.first().filter(|_| i + 1 < n).map_or(f64::INFINITY, |frame| frame.t_s);
            for (part, run) in parts.iter().zip(runs) {
                let over = |i: &&Impact| (i.t_s + i.watched_s > from) && (i.t_s + i.watched_s <= to);
                for impact in run.impacts.iter().filter(over) {
                    sink.impact(&merge::impact(part, impact))?;
                }
                for event in run.events.iter().filter(|e| e.t_s > from && e.t_s <= to) {
                    sink.event(&merge::event(part, event))?;
                }
            }
            from = to;
        }
        sink.finish()?;
        paths.push(path);
    }
    Ok(paths)
}
