//! `pitchline tune`: optimises the free parameters of an abutment chain's drive for its stiffness, load and speed.

use super::{Failure, Outcome, load_drive, print_json, print_out};
use crate::compare::CompareError;
use crate::compare::tune::{Margin, smallest_margin, tune};
use std::fmt::Write;

#[derive(clap::Args, Debug)]
pub struct TuneArgs {
    /// Drive with an abutment chain
    #[arg(default_value = "smartchain-20-40")]
    drive: String,
    /// Replace a value of the drive
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &TuneArgs) -> Result<Outcome, Failure> {
    let drive = load_drive(&args.drive, &args.set)?;
    let stop = super::run::stop_on_interrupt();
    let told = |runs: usize, margin: f64| eprintln!("{runs} runs, worst margin {:+.1} %", 100.0 * margin);
    let tuned = match tune(&drive, &stop, told) {
        Ok(Some(tuned)) => tuned,
        Ok(None) => {
            return Err(Failure::Input(format!("`{}` has no abutment chain ([chain.smartchain]) to tune", args.drive)));
        }
        Err(CompareError::Interrupted) => return Ok(Outcome::Interrupted),
        Err(e) => return Err(super::compare::failure(&e)),
    };
    if args.json {
        return print_json(&serde_json::json!({
            "drive": drive.name,
            "tuned": tuned,
            "worst_margin": smallest_margin(&tuned.best),
        }));
    }
    let mut text = format!("{:<26} {:>10} {:>12} {:>12} {:>9}\n", "bound", "limit", "as given", "tuned", "margin");
    for (before, after) in tuned.start.iter().zip(&tuned.best) {
        let _infallible = writeln!(
            text,
            "{:<26} {:>10} {:>12} {:>12} {:>9}",
            after.name,
            shown(after.bound, after.unit),
            shown(before.value, before.unit),
            shown(after.value, after.unit),
            margin(after)
        );
    }
    let _infallible = writeln!(
        text,
        "\nworst margin {:+.1} % (as given {:+.1} %), {} runs; to use it:",
        100.0 * smallest_margin(&tuned.best),
        100.0 * smallest_margin(&tuned.start),
        tuned.runs
    );
    for f in &tuned.values {
        let _infallible = writeln!(text, "  --set {}={}", f.path, (f.value * 1e6).round() / 1e6);
    }
    print_out(&text)
}

fn shown(value: f64, unit: &str) -> String {
    format!("{value:.4} {unit}").trim_end().to_string()
}

fn margin(m: &Margin) -> String {
    format!("{:+.1} %", 100.0 * m.margin)
}
