//! `pitchline optimise`: searches the factors of a study for the best values of its goal.

use super::study::{
    StudyArgs, bind, check_nominal, failure, folder_path, progress_bar, runner, short, warn, write_results,
};
use super::{Failure, Outcome, print_json, print_out};
use crate::study::bind::BoundStudy;
use crate::study::engine::quoted;
use crate::study::folder::{FolderUse, Shard, StudyFolder};
use crate::study::optimise::Search;
use crate::study::run::{CaseRow, RunnerError};
use crate::study::summary::summarise;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

#[derive(clap::Args, Debug)]
pub struct OptimiseArgs {
    /// Study file (.toml) with `[optimise]`, or a bundled study
    study: PathBuf,
    /// Folder for results [default: studies/NAME]
    #[arg(short, long = "output", value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Go on with a search from its journal
    #[arg(long)]
    resume: bool,
    /// Threads [default: all cores]; they do not change the result
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Begin no further case after this time, e.g. 90s, 10min, 8h
    #[arg(long, value_name = "T", value_parser = super::study::budget)]
    budget: Option<f64>,
    /// Go on with a search that another build of pitchline began
    #[arg(long)]
    other_build: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &OptimiseArgs) -> Result<Outcome, Failure> {
    let study = StudyArgs {
        study: args.study.clone(),
        output: args.output.clone(),
        resume: args.resume,
        threads: args.threads,
        budget: args.budget,
        other_build: args.other_build,
        json: args.json,
        ..StudyArgs::default()
    };
    let bound = bind(&args.study)?;
    let Some(goal) = &bound.study.goal else {
        let file = args.study.display();
        return Err(Failure::Input(format!(
            "{file} has no `[optimise]`: nothing is searched for\nhelp: `pitchline study {file}` runs its plan"
        )));
    };
    check_nominal(&bound)?;
    let wanted = if args.resume { FolderUse::GoOn } else { FolderUse::Begin };
    let folder = StudyFolder::open(&folder_path(&study, &bound), &bound, wanted, args.other_build).map_err(failure)?;
    let stop = super::run::stop_on_interrupt();
    let mut search = Search::new(&bound, goal);
    advance(&study, &bound, &folder, &stop, &mut search)?;
    let rows: Vec<&CaseRow> = search.rows.iter().collect();
    let summary = summarise(&bound, &rows);
    let outputs = write_results(&bound, &folder, &rows, &summary, &args.study)?;
    let told = if args.json {
        print_json(&json(&bound, &search, &outputs))?
    } else {
        print_out(&text(&bound, &search, &outputs))?
    };
    Ok(match (stop.load(Ordering::Relaxed), search.is_over()) {
        (true, _) => Outcome::Interrupted,
        (false, false) => Outcome::DataLost,
        (false, true) => told,
    })
}

/// Runs generations until the search is over, or its time.
fn advance(
    args: &StudyArgs,
    bound: &BoundStudy,
    folder: &StudyFolder,
    stop: &AtomicBool,
    search: &mut Search<'_>,
) -> Result<(), Failure> {
    let mut journal = folder.journal(bound, Shard::WHOLE).map_err(failure)?;
    let found = folder.rows(bound).map_err(failure)?;
    warn(&found.warnings);
    let known = found.rows;
    let mut cases = search.replay(&known).map_err(|case| {
        Failure::Input(format!(
            "the journal in {} has another point for case {case}: it is not of this search\nhelp: `-o` names another folder",
            folder.path.display()
        ))
    })?;
    let runner = runner(args, bound, folder, Shard::WHOLE, stop);
    while !cases.is_empty() {
        let mut rows: BTreeMap<usize, CaseRow> =
            cases.iter().filter_map(|c| Some((c.number, known.get(&c.number)?.clone()))).collect();
        let missing: Vec<_> = cases.iter().filter(|c| !rows.contains_key(&c.number)).cloned().collect();
        let bar = progress_bar(missing.len());
        let (done, most) = search.generations();
        bar.set_message(format!("generation {done} of at most {most}"));
        let ran = runner.run(
            missing.len(),
            |i| missing.get(i).cloned().unwrap_or_else(|| bound.nominal_case(0)),
            |row| {
                journal.add(&row, true)?;
                bar.inc(1);
                rows.insert(row.case.number, row);
                Ok(())
            },
        );
        bar.finish_and_clear();
        journal.sync().map_err(failure)?;
        ran.map_err(|RunnerError(e)| Failure::World(format!("{e:#}")))?;
        if rows.len() < cases.len() {
            return Ok(());
        }
        search.tell(rows.into_values().collect());
        if let Some((_, best)) = search.best {
            eprintln!("{} cases, best {}", search.rows.len(), short(turned(bound, best)));
        }
        cases = search.ask();
    }
    Ok(())
}

/// A value as the goal has it: what is maximised is not turned.
fn turned(bound: &BoundStudy, value: f64) -> f64 {
    if bound.study.goal.as_ref().is_some_and(|g| g.is_maximised) { -value } else { value }
}

/// Rows of the drives as they are and of the best point, drive by drive.
fn before_and_after<'a>(bound: &BoundStudy, search: &'a Search<'_>) -> Vec<(&'a CaseRow, &'a CaseRow)> {
    let best = search.best.map_or(0, |(case, _)| case);
    (0..bound.drives.len()).filter_map(|d| Some((search.rows.get(d)?, search.rows.get(best + d)?))).collect()
}

fn json(bound: &BoundStudy, search: &Search<'_>, outputs: &[PathBuf]) -> serde_json::Value {
    let row = |row: &CaseRow| {
        let responses: serde_json::Map<String, serde_json::Value> = bound
            .study
            .responses
            .iter()
            .zip(&row.responses)
            .map(|(r, v)| (r.name.clone(), serde_json::json!(v)))
            .collect();
        let margin = Some(bound.worst_margin(&row.responses)).filter(|m| m.is_finite());
        serde_json::json!({"case": row.case.number, "responses": responses, "worst_margin": margin, "set": bound.overrides(&row.case), "error": row.error})
    };
    let drives: Vec<serde_json::Value> = before_and_after(bound, search)
        .into_iter()
        .map(|(before, after)| {
            let drive = bound.drives.get(before.case.drive).map(|d| d.name.clone());
            serde_json::json!({"drive": drive, "as_given": row(before), "best": row(after)})
        })
        .collect();
    serde_json::json!({
        "study": bound.study.name,
        "cases": search.rows.len(),
        "generations": search.generations().0,
        "is_over": search.is_over(),
        "best": search.best.map(|(_, v)| turned(bound, v)),
        "drives": drives,
        "outputs": outputs,
    })
}

fn text(bound: &BoundStudy, search: &Search<'_>, outputs: &[PathBuf]) -> String {
    let mut text = String::new();
    let mut set = Vec::new();
    for (before, after) in before_and_after(bound, search) {
        let drive = bound.drives.get(before.case.drive).map_or("", |d| d.name.as_str());
        let _infallible = writeln!(
            text,
            "{drive}\n  {:<24} {:>12} {:>12} {:>12} {:>9}",
            "response", "bound", "as given", "best", "margin"
        );
        for (k, r) in bound.study.responses.iter().enumerate() {
            let value = |row: &CaseRow| row.responses.get(k).copied().flatten();
            let cell = |v: Option<f64>| v.map_or_else(|| "-".to_string(), short);
            let bounds =
                r.at_most.map(|b| format!("<= {}", short(b))).or(r.at_least.map(|b| format!(">= {}", short(b))));
            let margin =
                if r.has_bound() { format!("{:+.1} %", 100.0 * r.margin(value(after))) } else { String::new() };
            let _infallible = writeln!(
                text,
                "  {:<24} {:>12} {:>12} {:>12} {:>9}",
                r.name,
                bounds.unwrap_or_default(),
                cell(value(before)),
                cell(value(after)),
                margin
            );
        }
        set.push((drive, bound.overrides(&after.case)));
        if let Some(why) = &before.error {
            let _infallible = writeln!(text, "  as given it breaks down: {why}");
        }
    }
    let best = match (search.best, search.rows.is_empty()) {
        (Some((_, v)), _) => short(turned(bound, v)),
        (None, true) => "no case was run".to_string(),
        (None, false) => "no case gives it a value".to_string(),
    };
    let goal = bound.study.goal.as_ref().map_or("", |g| g.formula.text.as_str());
    let (generations, _) = search.generations();
    let _infallible =
        writeln!(text, "\n{goal}: {best}, after {} cases in {generations} generations", search.rows.len());
    if !search.is_over() {
        text += "the search is not over: `--resume` goes on\n";
    }
    for (drive, own) in set.iter().filter(|(_, own)| !own.is_empty()) {
        let values: String = own.iter().map(|value| format!(" --set {}", quoted(value))).collect();
        let _infallible = writeln!(text, "to use it: pitchline run {}{values}", quoted(drive));
    }
    for path in outputs {
        let _infallible = writeln!(text, "wrote {}", path.display());
    }
    text
}
