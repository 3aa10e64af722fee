//! `pitchline study`: runs a drive for many values of its numbers, and says what they do.

use super::study_engine::{self, EngineArgs};
use super::study_remote;
use super::{Failure, Outcome, drive_text, print_json, print_out};
use crate::assemble::SharedParts;
use crate::measurement::columns::{ColumnSelection, FileLayout, Memory, read as read_columns};
use crate::study::bind::BoundStudy;
use crate::study::case::run_case;
use crate::study::engine::quoted;
use crate::study::folder::{FolderError, FolderUse, Shard, StudyFolder};
use crate::study::run::{CaseRow, CaseRunner, RunnerError};
use crate::study::summary::{DriveResults, ResponseSummary, StudySummary, summarise};
use crate::study::table::{ResultTable, write_table};
use crate::study::{BUNDLED_STUDIES, PlanSpec, Study};
use indicatif::{ProgressBar, ProgressStyle};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

#[derive(clap::Args, Debug, Default)]
pub struct StudyArgs {
    /// Study file (.toml): drives, factors, plan, responses
    pub(super) study: PathBuf,
    /// Folder for results, or s3://BUCKET/PREFIX in an object store [default: studies/NAME]
    #[arg(short, long = "output", value_name = "FOLDER")]
    pub(super) output: Option<PathBuf>,
    /// Folder of this machine in which a study in an object store works [default: one for temporary files]
    #[arg(long, value_name = "FOLDER")]
    pub(super) scratch: Option<PathBuf>,
    /// Go on with a study: cases that are done are not run again
    #[arg(long)]
    pub(super) resume: bool,
    /// Run only this part of the cases, e.g. 2/7; goes on where it was ended
    #[arg(long, value_name = "I/N", value_parser = shard, conflicts_with_all = ["resume", "collect", "status"])]
    pub(super) shard: Option<Shard>,
    /// Write the tables and the report of what is done, and run nothing
    #[arg(long, conflicts_with_all = ["resume", "status"])]
    pub(super) collect: bool,
    /// Say what is done and what is missing
    #[arg(long, conflicts_with = "resume")]
    pub(super) status: bool,
    /// Run one case and record it, beside its results: recordings/case-N.mcap, or --to
    #[arg(long, value_name = "CASE", conflicts_with_all = ["resume", "shard", "collect", "status"])]
    pub(super) record: Option<usize>,
    /// Recording of --record, .mcap or .rrd
    #[arg(long, value_name = "FILE", requires = "record")]
    pub(super) to: Option<PathBuf>,
    /// Threads [default: all cores]; they do not change the results
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) threads: Option<u16>,
    /// Begin no further case after this time, e.g. 90s, 10min, 8h
    #[arg(long, value_name = "T", value_parser = budget)]
    pub(super) budget: Option<f64>,
    /// Go on with a study that another build of pitchline began
    #[arg(long)]
    pub(super) other_build: bool,
    #[command(flatten)]
    pub(super) engine: EngineArgs,
    /// Print JSON
    #[arg(long)]
    pub(super) json: bool,
}

/// `2/7`.
fn shard(text: &str) -> Result<Shard, String> {
    let wrong = || "write the part and how many there are, e.g. 2/7".to_string();
    let (index, count) = text.split_once('/').ok_or_else(wrong)?;
    let (index, count) = (index.parse().map_err(|_| wrong())?, count.parse().map_err(|_| wrong())?);
    if (1..=count).contains(&index) { Ok(Shard { index, count }) } else { Err(wrong()) }
}

/// Longest budget [s]: thirty years.
const LONGEST_BUDGET_S: f64 = 1e9;

/// `90s`, `10min` or `8h`, in seconds.
pub(super) fn budget(text: &str) -> Result<f64, String> {
    let units = [("min", 60.0), ("h", 3600.0), ("s", 1.0)];
    let parsed =
        units.iter().find_map(|(unit, factor)| Some(text.strip_suffix(unit)?.trim().parse::<f64>().ok()? * factor));
    parsed
        .filter(|t| (0.0..=LONGEST_BUDGET_S).contains(t) && *t > 0.0)
        .ok_or_else(|| "write a time, e.g. 90s, 10min or 8h".into())
}

pub fn run(args: &StudyArgs) -> Result<Outcome, Failure> {
    let bound = bind(&args.study)?;
    if bound.study.goal.is_some() {
        let file = args.study.display();
        return Err(Failure::Input(format!(
            "{file} has `[optimise]`: its points come from a search\nhelp: `pitchline optimise {file}`"
        )));
    }
    let path = folder_path(args, &bound);
    if let Some(url) = args.output.as_ref().and_then(|o| o.to_str()).filter(|o| o.starts_with("s3://")) {
        return study_remote::run(args, &bound, url);
    }
    if let Some(case) = args.record {
        return record(args, &bound, &path, case);
    }
    if args.status || args.collect {
        let folder = StudyFolder::open(&path, &bound, FolderUse::Look, args.other_build).map_err(failure)?;
        return if args.status { status(args, &bound, &folder) } else { collect(args, &bound, &folder) };
    }
    if let Some(engine) = &args.engine.print_job {
        return study_engine::print_job(args, &bound, engine);
    }
    if args.engine.engine != "local" {
        check_nominal(&bound)?;
        return study_engine::submit(args, &bound);
    }
    let wanted = if args.resume || args.shard.is_some() { FolderUse::GoOn } else { FolderUse::Begin };
    check_nominal(&bound)?;
    let folder = StudyFolder::open(&path, &bound, wanted, args.other_build).map_err(failure)?;
    let shard = args.shard.unwrap_or(Shard::WHOLE);
    let stop = super::run::stop_on_interrupt();
    run_missing(args, &bound, &folder, shard, &stop, &mut || Ok(()))?;
    let is_over = stop.load(Ordering::Relaxed);
    let outcome = match args.shard {
        Some(shard) => finish_shard(args, &bound, &folder, shard)?,
        None => collect(args, &bound, &folder)?,
    };
    Ok(if is_over { Outcome::Interrupted } else { outcome })
}

pub(super) fn folder_path(args: &StudyArgs, bound: &BoundStudy) -> PathBuf {
    args.output.clone().unwrap_or_else(|| Path::new("studies").join(&bound.study.name))
}

pub(super) fn failure(e: FolderError) -> Failure {
    match e {
        FolderError::NotOurs(_)
        | FolderError::OtherStudy { .. }
        | FolderError::OtherProgram { .. }
        | FolderError::Begun { .. }
        | FolderError::NoStudy(_)
        | FolderError::Damaged(_)
        | FolderError::NoFolder(_) => Failure::Input(e.to_string()),
        FolderError::Busy { .. } | FolderError::Io { .. } | FolderError::Output(_) => Failure::World(e.to_string()),
    }
}

/// Reads a study, its drives and its table. All mistakes are found before anything runs.
pub(super) fn bind(path: &Path) -> Result<BoundStudy, Failure> {
    let input = |r: crate::diag::Report| Failure::Input(r.to_string());
    let bundled = BUNDLED_STUDIES.iter().find(|(name, _)| Path::new(name) == path);
    let text = match bundled {
        Some((_, text)) => (*text).to_string(),
        None => super::identify::read_text(path, "study file").map_err(|e| match e {
            Failure::Input(why) if !path.exists() => {
                let names: Vec<&str> = BUNDLED_STUDIES.iter().map(|(name, _)| *name).collect();
                Failure::Input(format!("{why}\nhelp: bundled studies: {}", names.join(", ")))
            }
            other => other,
        })?,
    };
    let study = Study::parse(&path.display().to_string(), &text).map_err(input)?;
    let beside = path.parent().map_or_else(PathBuf::new, PathBuf::from);
    let mut texts = Vec::new();
    for drive in &study.drives {
        let is_bundled = crate::drive::BUNDLED.iter().any(|(name, _)| name == drive);
        let file = if is_bundled { drive.clone() } else { beside.join(drive).display().to_string() };
        let (name, text) = drive_text(&file)?;
        if crate::machine::is_lumped(&text) {
            return Err(Failure::Input(format!("`{drive}` is a lumped drive: it has no links to simulate")));
        }
        texts.push((name, text));
    }
    let rows = match &study.plan {
        PlanSpec::Design(_) => None,
        PlanSpec::File(file) => Some(table_rows(&study, &beside.join(file))?),
    };
    BoundStudy::bind(study, &texts, rows).map_err(input)
}

/// Largest table of cases [bytes in memory].
const TABLE_MEMORY: usize = 1 << 30;

/// Values of the factors from a table: NaN where a cell is empty.
fn table_rows(study: &Study, path: &Path) -> Result<Vec<Vec<f64>>, Failure> {
    let mut memory = Memory::for_program(TABLE_MEMORY);
    let columns = read_columns(path, FileLayout::default(), ColumnSelection::All, &mut memory)
        .map_err(|e| Failure::Input(e.to_string()))?;
    let mut chosen = Vec::new();
    for factor in &study.factors {
        let name = if factor.each_link { format!("{}_seed", factor.name) } else { factor.name.clone() };
        let mistake = |title: String, help: Option<String>| {
            let diag = study.places.error(&format!("factors.{}", factor.name), title, help);
            Failure::Input(study.places.report(vec![diag]).to_string())
        };
        if !factor.is_numeric() {
            return Err(mistake(format!("{} cannot give texts: a table gives numbers", path.display()), None));
        }
        let found = columns.find(&name);
        if let Some(why) = found.and_then(|k| columns.wrong.get(k)).and_then(Option::as_ref) {
            return Err(mistake(
                format!("{}: {why}", path.display()),
                Some("an empty cell leaves the drive's own value".into()),
            ));
        }
        let Some(values) = found.and_then(|k| columns.values.get(k)) else {
            let help = format!("its columns: {}", columns.names.join(", "));
            return Err(mistake(format!("{} has no column `{name}` for this factor", path.display()), Some(help)));
        };
        const LARGEST_SEED: f64 = (1_u64 << 53) as f64;
        let is_seed = |v: &f64| v.is_nan() || (0.0..=LARGEST_SEED).contains(v) && v.fract() == 0.0;
        if let Some(wrong) = values.iter().find(|v| factor.each_link && !is_seed(v)) {
            return Err(mistake(
                format!("{}: the seed {wrong} is no whole number from 0 to 2^53", path.display()),
                None,
            ));
        }
        chosen.push(values);
    }
    let row = |i: usize| chosen.iter().map(|values| values.get(i).copied().unwrap_or(f64::NAN)).collect();
    Ok((0..columns.rows()).map(row).collect())
}

/// Runs the drives as they are, to learn whether they give what the responses ask for.
pub(super) fn check_nominal(bound: &BoundStudy) -> Result<(), Failure> {
    let shared = SharedParts::default();
    for k in 0..bound.drives.len() {
        let case = bound.nominal_case(k);
        let name = bound.drives.get(k).map_or("", |d| d.name.as_str());
        let found = bound.drive_of(&case).and_then(|drive| run_case(&drive, &bound.needs, bound.study.length, &shared));
        match found {
            Ok(facts) => {
                bound.check_responses(&facts).map_err(|report| Failure::Input(report.to_string()))?;
                warn(&bound.missing(&case, &facts));
            }
            Err(why) => {
                return Err(Failure::Input(format!("`{name}` as it is, before anything is varied: {}", why.0)));
            }
        }
    }
    Ok(())
}

/// Runs what a shard lacks; `added` is called whenever the journal has grown.
pub(super) fn run_missing(
    args: &StudyArgs,
    bound: &BoundStudy,
    folder: &StudyFolder,
    shard: Shard,
    stop: &AtomicBool,
    added: &mut dyn FnMut() -> anyhow::Result<()>,
) -> Result<(), Failure> {
    let mut journal = folder.journal(bound, shard).map_err(failure)?;
    let known = folder.done(bound, shard).map_err(failure)?;
    warn(&known.warnings);
    let missing: Vec<usize> =
        (0..bound.cases()).filter(|case| shard.has(*case) && !known.numbers.contains(case)).collect();
    let runner = runner(args, bound, folder, shard, stop);
    let bar = progress_bar(missing.len());
    let mut errors = 0_usize;
    let done = runner.run(
        missing.len(),
        |i| bound.case(missing.get(i).copied().unwrap_or(0)),
        |row| {
            errors += usize::from(row.error.is_some());
            journal.add(&row, false)?;
            added()?;
            bar.inc(1);
            if errors > 0 {
                bar.set_message(format!("{errors} broke down"));
            }
            Ok(())
        },
    );
    bar.finish_and_clear();
    journal.sync().map_err(failure)?;
    done.map_err(|RunnerError(e)| Failure::World(format!("{e:#}")))
}

pub(super) fn runner<'a>(
    args: &StudyArgs,
    bound: &'a BoundStudy,
    folder: &StudyFolder,
    shard: Shard,
    stop: &'a AtomicBool,
) -> CaseRunner<'a> {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    CaseRunner {
        bound,
        threads: args.threads.map_or(cores, usize::from),
        stop,
        deadline: args.budget.map(|s| Instant::now() + Duration::from_secs_f64(s)),
        recordings: folder.path.join("recordings"),
        shard: shard.name(),
        shared: SharedParts::default(),
    }
}

pub(super) fn warn(warnings: &[String]) {
    for what in warnings {
        eprintln!("warning: {what}");
    }
}

/// Progress on stderr, only on a terminal.
pub(super) fn progress_bar(cases: usize) -> ProgressBar {
    let bar = ProgressBar::new(cases as u64);
    if let Ok(style) =
        ProgressStyle::with_template("{bar:40} {pos} of {len} cases  {msg}  {elapsed} elapsed, {eta} to go")
    {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

/// Writes the table of a shard.
pub(super) fn finish_shard(
    args: &StudyArgs,
    bound: &BoundStudy,
    folder: &StudyFolder,
    shard: Shard,
) -> Result<Outcome, Failure> {
    let found = folder.rows(bound).map_err(failure)?;
    let own: Vec<&CaseRow> = found.rows.values().filter(|row| shard.has(row.case.number)).collect();
    let path = folder.path.join(format!("shard-{}.parquet", shard.name()));
    write_table(&path, ResultTable::Results, bound, &own)?;
    let all = (0..bound.cases()).filter(|case| shard.has(*case)).count();
    let said = format!(
        "shard {} of {}: {} of {all} cases done\nwrote {}\n",
        shard.index,
        shard.count,
        own.len(),
        path.display()
    );
    let told = if args.json {
        print_json(&serde_json::json!({"shard": shard.name(), "cases": all, "done": own.len(), "outputs": [path]}))?
    } else {
        print_out(&said)?
    };
    Ok(if own.len() < all && told == Outcome::Done { Outcome::DataLost } else { told })
}

/// Writes tables and report of all that is done.
pub(super) fn collect(args: &StudyArgs, bound: &BoundStudy, folder: &StudyFolder) -> Result<Outcome, Failure> {
    let _held = folder.collecting().map_err(failure)?;
    let found = folder.rows(bound).map_err(failure)?;
    warn(&found.warnings);
    let rows: Vec<&CaseRow> = found.rows.values().collect();
    let summary = summarise(bound, &rows);
    let outputs = write_results(bound, folder, &rows, &summary, &args.study)?;
    let is_whole = rows.len() >= bound.cases();
    let told = if args.json {
        let mut value = serde_json::json!(summary);
        super::add_field(&mut value, "outputs", serde_json::json!(outputs));
        print_json(&value)?
    } else {
        print_out(&text(bound, &summary, &record_command(&args.study, &folder.path), &outputs))?
    };
    Ok(if is_whole { told } else { Outcome::DataLost })
}

/// The command that records a case, but for the case.
fn record_command(study: &Path, folder: &Path) -> String {
    let (study, folder) = (quoted(&study.display().to_string()), quoted(&folder.display().to_string()));
    format!("pitchline study {study} -o {folder} --record")
}

/// The tables and the report.
pub(super) fn write_results(
    bound: &BoundStudy,
    folder: &StudyFolder,
    rows: &[&CaseRow],
    summary: &StudySummary,
    study: &Path,
) -> Result<Vec<PathBuf>, Failure> {
    let path = |name: &str| folder.path.join(name);
    write_table(&path("results.parquet"), ResultTable::Results, bound, rows)?;
    write_table(&path("results.csv"), ResultTable::Results, bound, rows)?;
    write_table(&path("timing.parquet"), ResultTable::Timing, bound, rows)?;
    let page = crate::render::study::html(bound, rows, summary, &record_command(study, &folder.path));
    crate::output::write(&path("report.html"), page.as_bytes())?;
    Ok(["results.parquet", "results.csv", "timing.parquet", "report.html"].map(path).to_vec())
}

/// What is done, by shards.
pub(super) fn status(args: &StudyArgs, bound: &BoundStudy, folder: &StudyFolder) -> Result<Outcome, Failure> {
    let found = folder.rows(bound).map_err(failure)?;
    let missing: Vec<usize> = (0..bound.cases()).filter(|case| !found.rows.contains_key(case)).collect();
    let mut shards: std::collections::BTreeMap<&str, (usize, f64)> = std::collections::BTreeMap::new();
    for row in found.rows.values() {
        let own = shards.entry(row.shard.as_str()).or_default();
        *own = (own.0 + 1, own.1 + row.wall_s);
    }
    let errors = found.rows.values().filter(|row| row.error.is_some()).count();
    if args.json {
        return print_json(&serde_json::json!({
            "cases": bound.cases(),
            "done": found.rows.len(),
            "errors": errors,
            "missing": missing.len(),
            "missing_cases": ranges(&missing),
            "shards": shards.iter().map(|(name, (n, s))| serde_json::json!({"shard": name, "done": n, "case_s": s})).collect::<Vec<_>>(),
            "warnings": found.warnings,
        }));
    }
    warn(&found.warnings);
    let mut said = format!("{} of {} cases done, {errors} broke down\n", found.rows.len(), bound.cases());
    for (name, (n, wall_s)) in &shards {
        let _infallible = writeln!(said, "  shard {name}: {n} cases, {:.3} s each", wall_s / *n as f64);
    }
    if !missing.is_empty() {
        let _infallible = writeln!(said, "missing: {}", ranges(&missing));
    }
    print_out(&said)
}

/// `3-7, 12, 15-16`; long lists are cut.
fn ranges(numbers: &[usize]) -> String {
    const MOST: usize = 20;
    let mut found: Vec<(usize, usize)> = Vec::new();
    for n in numbers {
        match found.last_mut() {
            Some((_, to)) if *to + 1 == *n => *to = *n,
            _ => found.push((*n, *n)),
        }
    }
    let shown: Vec<String> = found
        .iter()
        .take(MOST)
        .map(|(from, to)| if from == to { from.to_string() } else { format!("{from}-{to}") })
        .collect();
    let rest = found.len().saturating_sub(MOST);
    shown.join(", ") + &if rest > 0 { format!(", and {rest} more ranges") } else { String::new() }
}

/// Runs and records one case.
fn record(args: &StudyArgs, bound: &BoundStudy, folder: &Path, number: usize) -> Result<Outcome, Failure> {
    if number >= bound.cases() {
        return Err(Failure::Input(format!(
            "there is no case {number}: they are numbered 0 to {}",
            bound.cases().saturating_sub(1)
        )));
    }
    if args.to.is_none() {
        StudyFolder::open(folder, bound, FolderUse::GoOn, true).map_err(failure)?;
    }
    let path = args.to.clone().unwrap_or_else(|| folder.join("recordings").join(format!("case-{number:06}.mcap")));
    super::run::check_recordings(std::slice::from_ref(&path), &[&args.study])?;
    if let Some(parent) = path.parent() {
        std::fs::create_dir_all(parent)
            .map_err(|e| Failure::World(format!("cannot make {}: {e}", parent.display())))?;
    }
    let case = bound.case(number);
    let drive = bound.drive_of(&case).map_err(|e| Failure::World(e.0))?;
    let stop = AtomicBool::new(false);
    let here = StudyFolder { path: folder.to_path_buf() };
    let runner = runner(args, bound, &here, Shard::WHOLE, &stop);
    let row = runner.one(&case)?;
    if row.error.is_none() {
        runner.record(&drive, &path)?;
    }
    let mut said = String::new();
    for (factor, cell) in bound.study.factors.iter().zip(&case.cells) {
        let _infallible = writeln!(said, "  {:<24} {}", factor.name, crate::study::summary::shown(cell));
    }
    for (response, value) in bound.study.responses.iter().zip(&row.responses) {
        let mark = if response.has_bound() && !response.keeps(*value) { "  fails" } else { "" };
        let _infallible = writeln!(said, "  {:<24} {}{mark}", response.name, number_text(*value));
    }
    match &row.error {
        Some(why) => return Err(Failure::World(format!("case {number} breaks down: {why}"))),
        None => {
            let _infallible = writeln!(said, "wrote {}", path.display());
        }
    }
    print_out(&said)
}

fn number_text(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |v| format!("{v:.6}"))
}

/// The result in words.
fn text(bound: &BoundStudy, summary: &StudySummary, record: &str, outputs: &[PathBuf]) -> String {
    let mut text = format!("{}: {} of {} cases done ({})\n", summary.study, summary.done, summary.cases, summary.plan);
    for drive in &summary.drives {
        text += &drive_text_of(bound, drive, record);
    }
    text += "\n";
    for path in outputs {
        let _infallible = writeln!(text, "wrote {}", path.display());
    }
    text
}

fn drive_text_of(bound: &BoundStudy, drive: &DriveResults, record: &str) -> String {
    let mut text = format!("\n{}: {} cases\n", drive.drive, drive.done);
    if let Some(kept) = drive.keeps_all.filter(|_| drive.done > 0) {
        let _infallible = writeln!(
            text,
            "  all bounds kept: {:.1} % of the cases (95 %: {:.1} to {:.1})",
            100.0 * kept.value,
            100.0 * kept.low,
            100.0 * kept.high
        );
    }
    if drive.errors > 0 {
        let _infallible = writeln!(text, "  cases that broke down: {}", drive.errors);
        for (why, n) in drive.reasons.iter().take(REASONS) {
            let _infallible = writeln!(text, "    {n} x {why}");
        }
    }
    let _infallible = writeln!(
        text,
        "\n  {:<24} {:>10} {:>10} {:>10} {:>10} {:>10}  bound, share that fails",
        "response", "min", "5 %", "median", "95 %", "max"
    );
    for r in &drive.responses {
        let _infallible = writeln!(
            text,
            "  {:<24} {:>10} {:>10} {:>10} {:>10} {:>10}  {}",
            r.name,
            short(r.min),
            short(r.p05),
            short(r.median),
            short(r.p95),
            short(r.max),
            bound_text(r)
        );
    }
    for r in drive.responses.iter().filter(|r| !r.sensitivities.is_empty() || r.left_out > 0) {
        text += &sensitivity_text(r);
    }
    let worst: Vec<_> = drive.worst.iter().take(WORST_SHOWN).collect();
    if !worst.is_empty() && bound.study.responses.iter().any(crate::study::Response::has_bound) {
        text += "\n  worst cases\n";
        for case in worst {
            let margin = match (&case.error, case.worst_margin) {
                (Some(why), _) => why.clone(),
                (None, Some(margin)) => format!("margin {:+.1} %", 100.0 * margin),
                (None, None) => "a value is missing".into(),
            };
            let _infallible = writeln!(text, "  {:>8}  {margin}", case.case);
        }
        let first = drive.worst.first().map_or(0, |c| c.case);
        let _infallible = writeln!(text, "  record one: {record} {first}");
    }
    text
}

/// Reasons and worst cases in the text; JSON and the report have more.
const REASONS: usize = 5;
const WORST_SHOWN: usize = 5;

/// Four digits.
pub(super) fn short(x: f64) -> String {
    match x.abs() {
        _ if x.is_nan() => "-".into(),
        0.0 => "0".into(),
        1e-3..1e5 => {
            let above = [1e-2, 1e-1, 1.0, 10.0, 100.0, 1000.0].iter().filter(|power| x.abs() >= **power).count();
            format!("{x:.*}", 6_usize.saturating_sub(above))
        }
        _ => format!("{x:.3e}"),
    }
}

fn bound_text(r: &ResponseSummary) -> String {
    let bounds: Vec<String> = r
        .at_most
        .iter()
        .map(|b| format!("at most {}", short(*b)))
        .chain(r.at_least.iter().map(|b| format!("at least {}", short(*b))))
        .collect();
    match r.fails {
        Some(fails) => format!(
            "{}: {:.1} % (95 %: {:.1} to {:.1})",
            bounds.join(", "),
            100.0 * fails.value,
            100.0 * fails.low,
            100.0 * fails.high
        ),
        None => String::new(),
    }
}

fn sensitivity_text(r: &ResponseSummary) -> String {
    let mut text = format!("\n  what moves {}", r.name);
    if r.left_out > 0 {
        let _infallible = write!(text, " (rows of the plan left out, because a value is missing: {})", r.left_out);
    }
    text += "\n";
    for s in &r.sensitivities {
        let said = match (s.sobol, s.morris, s.rank_correlation) {
            (Some(own), _, _) => format!(
                "first order {:.2} ({:.2} to {:.2}), total {:.2} ({:.2} to {:.2})",
                own.first.value, own.first.low, own.first.high, own.total.value, own.total.low, own.total.high
            ),
            (None, Some(own), _) => format!(
                "mu* {} ({} to {}), mu {}, sigma {}",
                short(own.mu_star.value),
                short(own.mu_star.low),
                short(own.mu_star.high),
                short(own.mu),
                short(own.sigma)
            ),
            (None, None, Some(own)) => {
                format!("rank correlation {:+.2} ({:+.2} to {:+.2})", own.value, own.low, own.high)
            }
            (None, None, None) => "-".into(),
        };
        let _infallible = writeln!(text, "    {:<24} {said}", s.factor);
    }
    text
}
