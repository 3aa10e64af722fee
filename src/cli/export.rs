//! `pitchline export`: a recording as tables for other programs, Parquet or CSV.

use super::{Answer, Failure, Outcome, answer};
use crate::recording::Output;
use crate::recording::frame::{Event, Frame, Header, Impact};
use crate::recording::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use crate::recording::table::{Format, Moment, TABLES, Table, TableWriter};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

#[derive(clap::Args, Debug)]
pub struct ExportArgs {
    /// Recording to read, .mcap
    recording: PathBuf,
    /// Folder for one file per table, or one .parquet or .csv file for a single table
    #[arg(short, long = "output", value_name = "FOLDER_OR_FILE")]
    output: PathBuf,
    #[arg(long, value_name = "TABLE,...", value_delimiter = ',', help = tables_help())]
    tables: Vec<String>,
    /// Format of the files in a folder: parquet or csv [default: parquet]
    #[arg(long, value_parser = format)]
    format: Option<Format>,
    /// Leave out frames and events before this time, e.g. 20ms
    #[arg(long, value_name = "TIME", value_parser = super::run::instant)]
    from: Option<f64>,
    /// Leave out frames and events after this time
    #[arg(long, value_name = "TIME", value_parser = super::run::instant)]
    to: Option<f64>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn format(text: &str) -> Result<Format, String> {
    Format::ALL.into_iter().find(|f| f.name() == text).ok_or_else(|| "write parquet or csv".into())
}

pub fn run(args: &ExportArgs) -> Result<Outcome, Failure> {
    let plan = plan(args)?;
    let stop = super::run::stop_on_interrupt();
    let mut export = Export::new(&plan);
    let reader = read(&args.recording, |item| {
        if stop.load(Ordering::Relaxed) {
            return Ok(ControlFlow::Break(()));
        }
        export.take(item)?;
        Ok(ControlFlow::Continue(()))
    })?;
    // Returning drops the writers, which removes their unfinished files.
    if stop.load(Ordering::Relaxed) {
        return Ok(Outcome::Interrupted);
    }
    let Export { header, writers, frames_seen, frames, last_s, .. } = export;
    if frames == 0 && frames_seen > 0 {
        let shown = args.recording.display();
        return Err(Failure::Input(format!("{shown} has no frame in that time; it ends at {:.6} ms", last_s * 1e3)));
    }
    let outputs = publish(writers)?;
    let found = if args.json {
        Answer::Json(json(&header, frames, reader.complete(), &outputs))
    } else {
        Answer::Text(text(&header, frames, &outputs))
    };
    answer(&[&reader], found, Outcome::Done)
}

/// Files to be written, checked before anything is read.
struct ExportPlan {
    tables: Vec<(Table, PathBuf)>,
    format: Format,
    /// Created if it does not exist.
    folder: Option<PathBuf>,
    from_s: f64,
    to_s: f64,
}

fn plan(args: &ExportArgs) -> Result<ExportPlan, Failure> {
    let (from_s, to_s) = (args.from.unwrap_or(0.0), args.to.unwrap_or(f64::INFINITY));
    if from_s > to_s {
        return Err(Failure::Input("--from is later than --to".into()));
    }
    let tables = chosen(&args.tables)?;
    let shown = args.output.display();
    let (extension, is_folder) = kind_of_output(&args.output);
    if is_folder {
        let format = args.format.unwrap_or(Format::Parquet);
        let file = |t: &Table| args.output.join(format!("{}.{}", t.name, format.name()));
        let tables: Vec<_> = tables.into_iter().map(|t| (t, file(&t))).collect();
        check_files(&args.recording, &tables)?;
        return Ok(ExportPlan { tables, format, folder: Some(args.output.clone()), from_s, to_s });
    }
    let Some(format) = Format::ALL.into_iter().find(|f| f.name() == extension) else {
        return Err(Failure::Input(format!(
            "{shown}: tables end in .parquet or .csv\nhelp: a folder's name ends in `/`"
        )));
    };
    if args.format.is_some_and(|f| f != format) {
        return Err(Failure::Input(format!("{shown} does not end as --format says")));
    }
    if tables.len() != 1 {
        return Err(Failure::Input(format!(
            "{shown} is one file, for {} tables\nhelp: choose one with --tables, e.g. `--tables links`, or give a folder",
            tables.len()
        )));
    }
    let tables: Vec<_> = tables.into_iter().map(|t| (t, args.output.clone())).collect();
    check_files(&args.recording, &tables)?;
    Ok(ExportPlan { tables, format, folder: None, from_s, to_s })
}

fn tables_help() -> String {
    let names: Vec<&str> = TABLES.iter().map(|t| t.name).collect();
    format!("Tables to write: {} [default: all]", names.join(", "))
}

/// Tables by name, in fixed order; all if none is named.
fn chosen(names: &[String]) -> Result<Vec<Table>, Failure> {
    let known = || TABLES.iter().map(|t| t.name);
    for name in names {
        if !known().any(|k| k == name) {
            let help = match crate::diag::nearest(name, known()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("tables: {}", known().collect::<Vec<_>>().join(", ")),
            };
            return Err(Failure::Input(format!("there is no table `{name}`\nhelp: {help}")));
        }
    }
    Ok(TABLES.into_iter().filter(|t| names.is_empty() || names.iter().any(|n| n == t.name)).collect())
}

/// Extension, and whether it is a folder: an existing one, or a name without an extension or with a `/` at its end.
fn kind_of_output(output: &Path) -> (&str, bool) {
    let extension = output.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let ends_in_slash =
        output.as_os_str().as_encoded_bytes().last().is_some_and(|b| std::path::is_separator(char::from(*b)));
    (extension, ends_in_slash || output.is_dir() || output.extension().is_none())
}

fn check_files(recording: &Path, tables: &[(Table, PathBuf)]) -> Result<(), Failure> {
    super::check_outputs(tables.iter().map(|(_, path)| path.as_path()), [recording])
}

/// Items of a recording, in the order in which they are passed on; the header comes first.
enum ExportItem<'a> {
    Header(&'a Header),
    Frame(&'a Frame),
    Event(&'a Event),
    Impact(&'a Impact),
}

/// Passes on a recording item by item until `take` stops; the reader knows what is missing.
fn read(
    path: &Path,
    mut take: impl FnMut(ExportItem<'_>) -> Result<ControlFlow<()>, Failure>,
) -> Result<Reader, Failure> {
    let mut reader = super::open_recording(path)?;
    let header = reader.header().clone();
    let mut failed = None;
    let mut hand_over = |item: ExportItem<'_>| match take(item) {
        Ok(ControlFlow::Continue(())) => Flow::On,
        Ok(ControlFlow::Break(())) => Flow::Enough,
        Err(failure) => {
            failed = Some(failure);
            Flow::Enough
        }
    };
    if hand_over(ExportItem::Header(&header)) == Flow::On {
        let wanted = Wanted { frames: true, events: true, impacts: true, ..Wanted::default() };
        reader.each(wanted, WHOLE, |entry| {
            Ok(match entry {
                Entry::Frame(frame) => hand_over(ExportItem::Frame(frame)),
                Entry::Event(event) => hand_over(ExportItem::Event(&event)),
                Entry::Impact(impact) => hand_over(ExportItem::Impact(&impact)),
                Entry::Head(_) | Entry::Keyframe(_) => Flow::On,
            })
        })?;
    }
    match failed {
        Some(failure) => Err(failure),
        None => Ok(reader),
    }
}

/// An export in progress.
struct Export<'a> {
    plan: &'a ExportPlan,
    header: Header,
    /// Empty before the header.
    writers: Vec<TableWriter>,
    /// Frames read, and frames exported.
    frames_seen: u64,
    frames: u64,
    last_s: f64,
}

impl Export<'_> {
    fn new(plan: &ExportPlan) -> Export<'_> {
        Export { plan, header: Header::default(), writers: Vec::new(), frames_seen: 0, frames: 0, last_s: 0.0 }
    }

    fn take(&mut self, item: ExportItem<'_>) -> Result<(), Failure> {
        match item {
            ExportItem::Header(header) => self.open(header)?,
            ExportItem::Frame(frame) => {
                let at = Moment { header: &self.header, index: self.frames_seen, frame };
                self.frames_seen += 1;
                self.last_s = frame.t_s;
                if self.plan.wants(frame.t_s) {
                    self.frames += 1;
                    for writer in &mut self.writers {
                        writer.frame(&at)?;
                    }
                }
            }
            ExportItem::Impact(impact) => {
                if self.plan.wants(impact.t_s) {
                    for writer in &mut self.writers {
                        writer.impact(&self.header, impact)?;
                    }
                }
            }
            ExportItem::Event(event) => {
                if self.plan.wants(event.t_s) {
                    for writer in &mut self.writers {
                        writer.event(&self.header, event)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn open(&mut self, header: &Header) -> Result<(), Failure> {
        self.header = header.clone();
        if let Some(folder) = &self.plan.folder {
            std::fs::create_dir_all(folder)
                .map_err(|e| Failure::World(format!("cannot make {}: {e}", folder.display())))?;
        }
        for (table, path) in &self.plan.tables {
            self.writers.push(TableWriter::create(*table, path, self.plan.format, header)?);
        }
        Ok(())
    }
}

impl ExportPlan {
    fn wants(&self, t_s: f64) -> bool {
        t_s >= self.from_s && t_s <= self.to_s
    }
}

/// One output file.
struct Exported {
    table: &'static str,
    rows: u64,
    output: Output,
}

/// Finishes all files, then renames them to their final names: either all exist or, unless a disk fails in between,
/// none.
fn publish(mut writers: Vec<TableWriter>) -> Result<Vec<Exported>, Failure> {
    for writer in &mut writers {
        writer.finish()?;
    }
    let mut outputs = Vec::new();
    for writer in writers {
        let table = writer.table().name;
        let (output, rows) = writer.publish()?;
        outputs.push(Exported { table, rows, output });
    }
    Ok(outputs)
}

fn json(header: &Header, frames: u64, complete: bool, outputs: &[Exported]) -> serde_json::Value {
    let outputs = outputs.iter().map(
        |o| serde_json::json!({ "table": o.table, "rows": o.rows, "path": o.output.path, "bytes": o.output.bytes }),
    );
    serde_json::json!({
        "drive": header.drive_name,
        "frames": frames,
        "complete": complete,
        "outputs": outputs.collect::<Vec<_>>(),
    })
}

fn text(header: &Header, frames: u64, outputs: &[Exported]) -> String {
    let mut lines = vec![format!("{}: {frames} frames", header.drive_name)];
    for Exported { table, rows, output } in outputs {
        let megabytes = output.bytes as f64 / 1e6;
        lines.push(format!("  wrote {} ({table}, {rows} rows, {megabytes:.1} MB)", output.path.display()));
    }
    lines.join("\n") + "\n"
}
