//! `pitchline drives`: the bundled drives.

use super::{Failure, Outcome, print_json, print_out};
use crate::drive::{BUNDLED, Drive};

#[derive(clap::Args, Debug)]
pub struct DrivesArgs {
    /// Print the file of this drive, for example as a start for a new one
    name: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &DrivesArgs) -> Result<Outcome, Failure> {
    if let Some(name) = &args.name {
        let (_, text) = super::drive_text(name)?;
        return print_out(&text);
    }
    let of = |name: &'static str| Drive::bundled(name).map(|d| (name, d.title, d.source));
    let drives: Vec<(&str, String, String)> = BUNDLED.iter().filter_map(|(name, _)| of(name)).collect();
    if args.json {
        let list = drives
            .iter()
            .map(|(name, title, source)| serde_json::json!({ "name": name, "title": title, "source": source }));
        return print_json(&serde_json::json!({ "drives": list.collect::<Vec<_>>() }));
    }
    let text: String =
        drives.iter().map(|(name, title, source)| format!("{name:<21} {title}\n{:<21} {source}\n", "")).collect();
    print_out(&text)
}
