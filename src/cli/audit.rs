//! `pitchline audit`: what a recording itself says of every part, and what stands out.

use super::{Answer, Failure, Outcome, answer};
use crate::analysis::audit::findings::difference;
use crate::analysis::audit::measures::MeasureKind;
use crate::analysis::audit::{Audit, AuditError, Finding, Measured, audit, compared, findings, measured};
use crate::recording::frame::Header;
use crate::recording::reader::Reader;
use crate::statistics::middle;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(clap::Args, Debug)]
pub struct AuditArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Compare every number with that of this recording of the same drive
    #[arg(long, value_name = "REC")]
    against: Option<PathBuf>,
    /// Print at most N findings (without it, 20; all with --json)
    #[arg(long, value_name = "N")]
    top: Option<usize>,
    /// Print JSON, with every number of every part
    #[arg(long)]
    json: bool,
}

/// Default number of findings that are printed.
const PRINTED: usize = 20;

pub fn run(args: &AuditArgs) -> Result<Outcome, Failure> {
    let mut reader = super::open_recording(&args.recording)?;
    let header = reader.header().clone();
    let mut other = args.against.as_deref().map(super::open_recording).transpose()?;
    if let Some(other) = &other
        && let Some(what) = difference(&header, other.header())
    {
        let (a, b) = (args.recording.display(), other.path().display());
        let help = "help: audit each by itself";
        return Err(Failure::Input(format!("{a} and {b} are recordings of two drives: {what}\n{help}")));
    }
    let own = read(&mut reader)?;
    let found = match &mut other {
        None => findings(&own, &header),
        Some(other) => {
            let good = read(other)?;
            compared(&own, &header, &good, other.header())
        }
    };
    let all = measured(&own, &header);
    let shown = args.top.unwrap_or(if args.json { usize::MAX } else { PRINTED });
    let result = if args.json {
        Answer::Json(json(&args.recording, &header, &own, &all, (&found, shown)))
    } else {
        Answer::Text(text(&args.recording, &header, (&own, &all), &found, shown))
    };
    let readers: Vec<&Reader> = std::iter::once(&reader).chain(&other).collect();
    answer(&readers, result, Outcome::Done)
}

fn read(reader: &mut Reader) -> Result<Audit, Failure> {
    let shown = reader.path().display().to_string();
    let interval_us = reader.header().steps_per_frame as f64 * reader.header().step_s * 1e6;
    audit(reader)?.map_err(|e| {
        Failure::Input(match e {
            AuditError::Short { frames, needed } => format!(
                "{shown} holds {frames} frames; an audit takes {needed} at least: {:.3} ms at a frame every {interval_us:.0} us\nhelp: run it longer, or `pitchline zoom {shown} --from T --to T --every 20us` records a part again with more frames",
                interval_us * needed as f64 * 1e-3,
            ),
            AuditError::Forceless => {
                format!("{shown} holds no forces in joints: an audit needs them\nhelp: run its drive again and record it")
            }
        })
    })
}

fn json(
    recording: &Path,
    header: &Header,
    own: &Audit,
    all: &[Measured],
    (found, shown): (&[Finding], usize),
) -> serde_json::Value {
    let parts = all.iter().map(|m| {
        serde_json::json!({
            "part": m.part.name(header),
            "quantity": m.measure.key,
            "value": m.estimate.value,
            "error": m.estimate.error,
            "samples": m.estimate.samples,
            "declared": m.declared,
            "group": m.group,
        })
    });
    serde_json::json!({
        "recording": recording,
        "drive": header.drive_name,
        "frames": own.frames,
        "from_s": own.from_s,
        "to_s": own.to_s,
        "healthy": found.is_empty(),
        "findings": found.get(..shown.min(found.len())).unwrap_or(found),
        "not_measured": own.lacking,
        "parts": parts.collect::<Vec<_>>(),
    })
}

fn text(
    recording: &Path,
    header: &Header,
    (own, all): (&Audit, &[Measured]),
    found: &[Finding],
    shown: usize,
) -> String {
    let thinned = if own.every > 1 { format!(", one in {} looked at", own.every) } else { String::new() };
    let mut lines = vec![format!(
        "{}: {}, {} frames from {:.3} to {:.3} ms{thinned}",
        recording.display(),
        header.drive_name,
        own.frames,
        own.from_s * 1e3,
        own.to_s * 1e3
    )];
    if found.is_empty() {
        lines.push("nothing stands out: what could be measured is healthy".into());
    } else {
        let mut kind = None;
        for finding in found.iter().take(shown) {
            if kind != Some(finding.kind) {
                kind = Some(finding.kind);
                lines.push(match finding.kind {
                    MeasureKind::Property => "what stands out:".into(),
                    MeasureKind::Assembly => "how it is put together:".into(),
                    MeasureKind::Consequence => "forces and losses:".into(),
                });
            }
            lines.push(format!("  {}", finding.text));
        }
        if found.len() > shown {
            lines.push(format!("  and {} more: --top {}", found.len() - shown, found.len()));
        }
    }
    lines.push("measured:                                                                    median       scatter        lowest       highest      declared".into());
    lines.extend(table(all, header));
    if !own.lacking.is_empty() {
        lines.push("not measured:".into());
        lines.extend(own.lacking.iter().map(|line| format!("  {line}")));
    }
    lines.join("\n") + "\n"
}

/// Five places, without a sign before a zero.
fn number(value: f64) -> String {
    let shown = format!("{value:.5}");
    if shown == "-0.00000" { "0.00000".into() } else { shown }
}

/// A row per group of parts and number.
fn table(all: &[Measured], header: &Header) -> Vec<String> {
    let mut order = Vec::new();
    let mut rows: BTreeMap<(String, &str), Vec<&Measured>> = BTreeMap::new();
    for m in all {
        let key = (m.group.clone().unwrap_or_else(|| m.part.name(header)), m.measure.key);
        if !rows.contains_key(&key) {
            order.push(key.clone());
        }
        rows.entry(key).or_default().push(m);
    }
    let row = |key: &(String, &str)| {
        let group = rows.get(key)?;
        let first = group.first()?;
        let (unit, size) = first.measure.shown_in;
        let values: Vec<f64> = group.iter().map(|m| m.estimate.value / size).collect();
        let (centre, scatter) = middle(&values);
        let ends = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        let name = if group.len() > 1 { format!("{} {}", group.len(), key.0) } else { key.0.clone() };
        let unit = if unit.is_empty() { String::new() } else { format!(" [{unit}]") };
        let what = format!("{name}: {}{unit}", first.measure.words);
        let declared: Vec<f64> = group.iter().filter_map(|m| m.declared).map(|d| d / size).collect();
        let declared = if declared.is_empty() { String::new() } else { format!("{:14.5}", middle(&declared).0) };
        let line = if group.len() > 1 {
            let (low, high) = (number(ends.0), number(ends.1));
            format!("  {what:66} {:>14} {:>13} {low:>13} {high:>13}{declared}", number(centre), number(scatter))
        } else {
            let error = first.estimate.error / size;
            format!("  {what:66} {:>14} {:>13} {:27}{declared}", number(centre), number(error), "")
        };
        Some(line.trim_end().to_string())
    };
    order.iter().filter_map(row).collect()
}
