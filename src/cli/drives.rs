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
    let titles: Vec<(&str, String)> = BUNDLED
        .iter()
        .map(|(name, text)| (*name, Drive::parse(name, text, &[]).map(|d| d.title).unwrap_or_default()))
        .collect();
    if args.json {
        let list: Vec<_> =
            titles.iter().map(|(name, title)| serde_json::json!({ "name": name, "title": title })).collect();
        return print_json(&serde_json::json!({ "drives": list }));
    }
    let text: String = titles.iter().map(|(name, title)| format!("{name:<21} {title}\n")).collect();
    print_out(&text)
}
