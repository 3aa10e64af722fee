//! `pitchline lump`: derives a lumped drive from one with link bodies.

use super::{Failure, Outcome, load_drive, print_json, print_out};
use crate::lumping::{LumpError, lumped_text, lumping};
use std::path::{Path, PathBuf};

#[derive(clap::Args, Debug)]
pub struct LumpArgs {
    /// Drive file or bundled name
    drive: String,
    /// Replace a value of the drive
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Write the file here; otherwise it is printed
    #[arg(short, long = "output", value_name = "FILE.toml")]
    output: Option<PathBuf>,
    /// Print its components as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &LumpArgs) -> Result<Outcome, Failure> {
    let drive = load_drive(&args.drive, &args.set)?;
    super::check_outputs(args.output.as_deref(), [Path::new(&args.drive)])?;
    let (l, ..) = lumping(&drive).map_err(|e| match e {
        LumpError::Assembly(e) => super::assembly_failure(e),
        LumpError::Form(text) => Failure::Input(text),
    })?;
    let text = lumped_text(&drive, &l);
    if let Some(path) = &args.output {
        crate::output::write(path, text.as_bytes())?;
    }
    if args.json {
        let spans: Vec<_> = l
            .spans
            .iter()
            .map(|s| {
                serde_json::json!({
                    "name": s.name, "stiffness_n_per_m": s.stiffness_n_per_m, "damping_n_s_per_m": s.damping_n_s_per_m,
                })
            })
            .collect();
        return print_json(&serde_json::json!({ "inertia_kg_m2": l.inertia_kg_m2, "spans": spans }));
    }
    let Some(path) = &args.output else { return print_out(&text) };
    let names: Vec<&str> = l.spans.iter().map(|s| s.name.as_str()).collect();
    print_out(&format!(
        "wrote {}: a lumped drive of {} bodies and the spans {}\n  `pitchline check` reads it, `pitchline identify` holds it against records\n",
        path.display(),
        l.inertia_kg_m2.len(),
        names.join(", ")
    ))
}
