//! `pitchline reproduce`: holds the claims of four papers against drives like theirs.

use super::{Failure, Outcome, print_json, print_out};
use crate::render::claims::html;
use crate::reproduce::laboratory::{ClaimTrial, Laboratory, WorkPace};
use crate::reproduce::{AnsweredClaim, ClaimVerdict, Paper, PaperClaim, claims};
use indicatif::{ProgressBar, ProgressStyle};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

#[derive(clap::Args, Debug)]
pub struct ReproduceArgs {
    /// Only these claims, e.g. S05; all if none is given
    claims: Vec<String>,
    /// Only this paper
    #[arg(long, value_parser = ["cali", "schaffner", "fritz", "lin"])]
    paper: Option<String>,
    /// Fewer speeds and shorter runs: minutes
    #[arg(long)]
    quick: bool,
    /// Folder for the page and for what was run; a second call goes on with it
    #[arg(short, long = "output", value_name = "FOLDER", default_value = "reproduced")]
    output: PathBuf,
    /// Threads [default: all cores]; they do not change the answers
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// List the claims, and run nothing
    #[arg(long)]
    list: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &ReproduceArgs) -> Result<Outcome, Failure> {
    let chosen = chosen(args)?;
    if args.list {
        let rows: String = chosen.iter().map(|c| format!("{}  {}\n", c.id, c.claim)).collect();
        return print_out(&rows);
    }
    std::fs::create_dir_all(&args.output).map_err(|e| Failure::World(format!("{}: {e}", args.output.display())))?;
    let pace = if args.quick { WorkPace::Quick } else { WorkPace::Whole };
    let journal = args.output.join("trials.jsonl");
    let mut lab =
        Laboratory::open(pace, &journal).map_err(|e| Failure::World(format!("{}: {e}", journal.display())))?;
    let stop = super::run::stop_on_interrupt();
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let threads = args.threads.map_or(cores, usize::from);
    let mut answers: Vec<Option<AnsweredClaim>> = chosen.iter().map(|_| None).collect();
    loop {
        for (claim, answer) in chosen.iter().zip(&mut answers) {
            if answer.is_none() {
                *answer = claim.answer(&lab);
            }
        }
        let wanted = lab.take_wanted();
        if wanted.is_empty() || stop.load(Ordering::Relaxed) {
            break;
        }
        let bar = progress_bar(&wanted);
        let mut broken = Vec::new();
        let done = lab.work(&wanted, threads, &stop, |trial, facts| {
            bar.inc(trial.cost());
            if let Some(why) = &facts.error {
                broken.push(format!("`pitchline {}`: {why}", trial.command()));
            }
        });
        bar.finish_and_clear();
        broken.iter().for_each(|what| eprintln!("warning: {what}"));
        done.map_err(|e| Failure::World(format!("{}: {e}", journal.display())))?;
    }
    let answers: Vec<AnsweredClaim> = answers.into_iter().flatten().collect();
    // The page shows what is known of the others too: a look at one claim leaves it whole.
    let known: Vec<AnsweredClaim> = claims().iter().filter_map(|claim| claim.answer(&lab)).collect();
    let outputs = write(args, &known)?;
    let told = if args.json {
        print_json(&serde_json::json!({"answers": answers, "asked": chosen.len(), "outputs": outputs}))?
    } else {
        print_out(&text(&answers, chosen.len(), &outputs))?
    };
    let is_broken = answers.iter().any(|a| a.is_broken);
    Ok(match (stop.load(Ordering::Relaxed), is_broken) {
        (true, _) => Outcome::Interrupted,
        (false, true) => Outcome::DataLost,
        (false, false) => told,
    })
}

/// The claims that were asked for.
fn chosen(args: &ReproduceArgs) -> Result<Vec<PaperClaim>, Failure> {
    let all = claims();
    for wanted in &args.claims {
        if all.iter().all(|c| !c.id.eq_ignore_ascii_case(wanted)) {
            return Err(Failure::Input(format!(
                "there is no claim `{wanted}`\nhelp: C01 to C27, S01 to S28, F01 to F10, L01 to L08; `pitchline reproduce --list` lists them"
            )));
        }
    }
    let is_wanted = |c: &PaperClaim| {
        (args.claims.is_empty() || args.claims.iter().any(|w| c.id.eq_ignore_ascii_case(w)))
            && args.paper.as_deref().is_none_or(|p| p == c.paper.name())
    };
    let own: Vec<PaperClaim> = all.into_iter().filter(is_wanted).collect();
    if own.is_empty() {
        return Err(Failure::Input("the paper has none of these claims".to_string()));
    }
    Ok(own)
}

/// Progress on stderr, only on a terminal: in simulated time.
fn progress_bar(wanted: &[ClaimTrial]) -> ProgressBar {
    let bar = ProgressBar::new(wanted.iter().map(ClaimTrial::cost).sum());
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} %  {elapsed} elapsed, {eta} to go") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

/// Writes page and JSON.
fn write(args: &ReproduceArgs, answers: &[AnsweredClaim]) -> Result<Vec<PathBuf>, Failure> {
    let pace = if args.quick { "in haste: fewer speeds, shorter runs" } else { "all speeds, whole runs" };
    let json = serde_json::to_string_pretty(answers).map_err(|e| Failure::World(e.to_string()))?;
    let mut outputs = Vec::new();
    for (name, text) in [("claims.html", html(answers, pace)), ("claims.json", json)] {
        let path = args.output.join(name);
        crate::output::write(&path, text.as_bytes()).map_err(|e| Failure::World(e.to_string()))?;
        outputs.push(path);
    }
    Ok(outputs)
}

fn text(answers: &[AnsweredClaim], asked: usize, outputs: &[PathBuf]) -> String {
    let mut text = String::new();
    for paper in Paper::ALL {
        let own: Vec<&AnsweredClaim> = answers.iter().filter(|a| a.paper == paper).collect();
        if own.is_empty() {
            continue;
        }
        let _infallible = writeln!(text, "{}", paper.title());
        for a in own {
            let _infallible = writeln!(text, "  {}  {:<18}  {}", a.id, a.answer.verdict.name(), a.claim);
            let _infallible = writeln!(text, "{:27}{}", "", a.answer.measured);
        }
        text.push('\n');
    }
    let count = |v: ClaimVerdict| answers.iter().filter(|a| a.answer.verdict == v).count();
    let counts: Vec<String> =
        ClaimVerdict::ALL.iter().filter(|v| count(**v) > 0).map(|v| format!("{} {}", count(*v), v.name())).collect();
    let _infallible = writeln!(text, "{} of {asked} claims answered: {}", answers.len(), counts.join(", "));
    for path in outputs {
        let _infallible = writeln!(text, "wrote {}", Path::new(path).display());
    }
    text
}
