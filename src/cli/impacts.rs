//! `pitchline impacts`: every impact of a recording, and what stands out among them.

use super::{Answer, Failure, Outcome, answer};
use crate::analysis::audit::findings::difference;
use crate::analysis::audit::measures::MeasureKind;
use crate::analysis::audit::{Audit, Finding, Measured, audit, compared, findings, measured};
use crate::analysis::blame::with_causes;
use crate::analysis::compared_impacts::{Common, against, common};
use crate::analysis::suspects::{FoundSuspects, Suspect, suspects};
use crate::recording::frame::{Feature, Header, Impact, Segment};
use crate::recording::places::Loops;
use crate::recording::reader::{Entry, Flow, FrameHead, Reader, WHOLE, Wanted};
use std::path::{Path, PathBuf};

#[derive(clap::Args, Debug)]
pub struct ImpactsArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Order of the list
    #[arg(long, value_enum, default_value = "time")]
    sort: Sort,
    /// Print only the first N in this order [default: 20; all with --json]
    #[arg(long, value_name = "N")]
    top: Option<usize>,
    /// Only impacts on this sprocket or guide
    #[arg(long, visible_alias = "body", value_name = "NAME")]
    sprocket: Option<String>,
    /// Only impacts of this link
    #[arg(long, value_name = "N")]
    link: Option<u32>,
    /// Report differences from the impacts of this recording, over the time that both have
    #[arg(long, value_name = "REC")]
    against: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
enum Sort {
    Time,
    Peak,
    Approach,
    Impulse,
    Rise,
}

/// Default number of lines of the table.
const PRINTED: usize = 20;
/// Suspects that are printed.
const SUSPECTS: usize = 5;

pub fn run(args: &ImpactsArgs) -> Result<Outcome, Failure> {
    let mut reader = super::open_recording(&args.recording)?;
    let header = reader.header().clone();
    let body = args.sprocket.as_ref().map(|name| super::body_named(&header, name)).transpose()?;
    if let Some(link) = args.link
        && link as usize >= header.links.len()
    {
        return Err(Failure::Input(format!(
            "there is no link {link}; they are numbered 0 to {}",
            header.links.len() - 1
        )));
    }
    let (all, heads) = read(&mut reader)?;
    let mut other = args.against.as_deref().map(super::open_recording).transpose()?;
    let (verdict, common) = match &mut other {
        None => (suspects(&all, &header, span(&heads)), None),
        Some(other) => {
            let (their, their_heads) = read(other)?;
            let common = in_common(args, (&heads, &their_heads), &header)?;
            let own = (&all[..], &header, span(&heads));
            (against(own, (&their, other.header(), span(&their_heads)), &common), Some(common))
        }
    };
    let (measured, parts) = measured_parts(&mut reader, other.as_mut())?;
    let verdict = with_causes(verdict, (&measured, &parts), &header).with_many_told();
    let suspects = &verdict.suspects;
    let mut list: Vec<(usize, &Impact)> = all
        .iter()
        .enumerate()
        .filter(|(_, i)| body.is_none_or(|b| i.body as usize == b) && args.link.is_none_or(|l| i.link == l))
        .collect();
    let n_found = list.len();
    let key = |i: &Impact| match args.sort {
        Sort::Time => -i.t_s,
        Sort::Peak => i.peak_force_n,
        Sort::Approach => i.approach_speed_m_s,
        Sort::Impulse => i.impulse_n_s,
        Sort::Rise => -i.own_rise_time_s().unwrap_or(f64::INFINITY),
    };
    list.sort_by(|a, b| key(b.1).total_cmp(&key(a.1)));
    list.truncate(args.top.unwrap_or(if args.json { usize::MAX } else { PRINTED }));
    let found = if args.json {
        Answer::Json(serde_json::json!({
            "recording": args.recording,
            "drive": header.drive_name,
            "impacts_in_all": all.len(),
            "found": n_found,
            "compared": common,
            "links_take_s": verdict.links_take_s,
            "suspects": suspects.iter().map(|s| suspect_json(s, &all, &header)).collect::<Vec<_>>(),
            "healthy": verdict.healthy.iter().map(|s| suspect_json(s, &all, &header)).collect::<Vec<_>>(),
            "measured": measured.iter().find(|f| f.kind > MeasureKind::Consequence),
            "differences": verdict.differences.iter().map(|s| suspect_json(s, &all, &header)).collect::<Vec<_>>(),
            "impacts": list.iter().map(|(n, i)| json(*n, i, &header, &heads, &args.recording)).collect::<Vec<_>>(),
        }))
    } else {
        Answer::Text(text(
            &args.recording,
            &header,
            &heads,
            &list,
            (n_found, &all),
            (&verdict, &measured),
            common.as_ref(),
        ))
    };
    let readers: Vec<&Reader> = std::iter::once(&reader).chain(&other).collect();
    answer(&readers, found, Outcome::Done)
}

/// What frames measure of the parts, where there are enough of them, of one drive, with forces.
fn measured_parts(reader: &mut Reader, other: Option<&mut Reader>) -> Result<(Vec<Finding>, Vec<Measured>), Failure> {
    let header = reader.header().clone();
    if header.is_merged() {
        return Ok((Vec::new(), Vec::new()));
    }
    let Ok(own) = audit(reader)? else { return Ok((Vec::new(), Vec::new())) };
    let good = match other {
        Some(other) if difference(&header, other.header()).is_none() => {
            audit(other)?.ok().map(|good| (good, other.header()))
        }
        _ => None,
    };
    let of = |(good, good_header): (Audit, &Header)| compared(&own, &header, &good, good_header);
    Ok((good.map_or_else(|| findings(&own, &header), of), measured(&own, &header)))
}

/// Time of a recording's frames [s].
fn span(heads: &[FrameHead]) -> (f64, f64) {
    (heads.first().map_or(0.0, |h| h.t_s), heads.last().map_or(0.0, |h| h.t_s))
}

/// The time that two recordings have in common.
fn in_common(args: &ImpactsArgs, heads: (&[FrameHead], &[FrameHead]), header: &Header) -> Result<Common, Failure> {
    let (mine, theirs) = (span(heads.0), span(heads.1));
    common(mine, theirs, header).ok_or_else(|| {
        let ms = |(from_s, to_s): (f64, f64)| format!("goes from {:.3} to {:.3} ms", from_s * 1e3, to_s * 1e3);
        let name = |path: Option<&Path>| path.map_or(String::new(), |p| p.display().to_string());
        Failure::Input(format!(
            "{} {}, {} {}: they have no time in common in which an impact could be observed",
            name(Some(&args.recording)),
            ms(mine),
            name(args.against.as_deref()),
            ms(theirs)
        ))
    })
}

/// All impacts in order of time, and the frames' steps.
fn read(reader: &mut Reader) -> Result<(Vec<Impact>, Vec<FrameHead>), Failure> {
    let (mut impacts, mut heads) = (Vec::new(), Vec::new());
    let wanted = Wanted { heads: true, impacts: true, ..Wanted::default() };
    reader.each(wanted, WHOLE, |entry| {
        match entry {
            Entry::Impact(impact) => impacts.push(impact),
            Entry::Head(head) => heads.push(head),
            Entry::Frame(_) | Entry::Keyframe(_) | Entry::Event(_) => {}
        }
        Ok(Flow::On)
    })?;
    impacts.sort_by_key(|i| (i.step, i.link, i.feature, i.body));
    Ok((impacts, heads))
}

/// All impacts in order of time.
pub(super) fn all(reader: &mut Reader) -> Result<Vec<Impact>, Failure> {
    Ok(read(reader)?.0)
}

/// The impact with this number in order of time.
pub(super) fn numbered(reader: &mut Reader, number: usize) -> Result<Impact, Failure> {
    let (impacts, _) = read(reader)?;
    impacts.get(number).copied().ok_or_else(|| {
        let path = reader.path().display();
        Failure::Input(if impacts.is_empty() {
            format!("{path} holds no impacts; record it anew: `pitchline run`")
        } else {
            format!("there is no impact {number} in {path}; they are numbered 0 to {}", impacts.len() - 1)
        })
    })
}

/// Number of the first impact of a suspect.
fn first_of(suspect: &Suspect, all: &[Impact], header: &Header) -> Option<usize> {
    let body = header.bodies.iter().position(|b| b.path == suspect.body)?;
    all.iter().position(|i| i.t_s == suspect.first_s && i.body as usize == body)
}

fn suspect_json(suspect: &Suspect, all: &[Impact], header: &Header) -> serde_json::Value {
    let mut value = serde_json::json!(suspect);
    super::add_field(&mut value, "first_impact", serde_json::json!(first_of(suspect, all, header)));
    value
}

/// Number of the first frame at or after first contact.
fn frame_of(impact: &Impact, heads: &[FrameHead]) -> Option<usize> {
    let at = heads.partition_point(|h| h.step < impact.step);
    let is_inside = heads.first().is_some_and(|h| h.step <= impact.step);
    (at < heads.len() && is_inside).then_some(at)
}

fn json(number: usize, i: &Impact, header: &Header, heads: &[FrameHead], recording: &Path) -> serde_json::Value {
    let body = header.bodies.get(i.body as usize);
    serde_json::json!({
        "number": number,
        "link": i.link,
        "joint": Loops::new(header).joint(i),
        "feature": Feature::name(i.feature),
        "body": body.map(|b| b.path.as_str()),
        "tooth": body.filter(|b| b.rotor).map(|_| i.tooth),
        "segment": Segment::name(i.segment),
        "step": i.step,
        "t_s": i.t_s,
        "frame": frame_of(i, heads),
        "approach_speed_m_s": i.approach_speed_m_s,
        "peak_force_n": i.peak_force_n,
        "peak_after_s": i.peak_after_s,
        "impulse_n_s": i.impulse_n_s,
        "rise_time_s": i.own_rise_time_s(),
        "touch_force_n": i.touch_force_n,
        "touch_offset_s": i.touch_offset_s,
        "second_period_mean_n": i.second_period_mean_n,
        "watched_s": i.watched_s,
        "x_m": i.x_m,
        "y_m": i.y_m,
        "open_in_rerun": open_in_rerun(number, header, recording),
        "open_in_foxglove": open_in_foxglove(i),
    })
}

/// The viewer cannot be started at a given time; instead the command makes a recording around the impact. Several drives
/// side by side cannot be run again: their recording is opened as it is.
fn open_in_rerun(number: usize, header: &Header, recording: &Path) -> String {
    let path = recording.display();
    if header.is_merged() {
        return format!("pitchline view {path}");
    }
    format!("pitchline zoom {path} --impact {number} -o impact-{number}.rrd && pitchline view impact-{number}.rrd")
}

/// Foxglove's playback bar takes a time of day; recordings start at 1970.
fn open_in_foxglove(i: &Impact) -> String {
    let ns = crate::recording::mcap::nanoseconds(i.t_s);
    let (s, ns) = (ns / 1_000_000_000, ns % 1_000_000_000);
    format!("1970-01-01T{:02}:{:02}:{:02}.{ns:09}Z", s / 3600, s / 60 % 60, s % 60)
}

fn text(
    recording: &Path,
    header: &Header,
    heads: &[FrameHead],
    list: &[(usize, &Impact)],
    (found, all): (usize, &[Impact]),
    (verdict, measured): (&FoundSuspects, &[Finding]),
    common: Option<&Common>,
) -> String {
    let suspects = &verdict.suspects;
    let loops = Loops::new(header);
    let mut lines = vec![format!("{}: {found} of {} impacts, {} shown", recording.display(), all.len(), list.len())];
    if all.is_empty() {
        lines.push(
            "  none: no impact was observed for two tooth periods within the recording; recordings of earlier versions contain none".into(),
        );
    }
    if !list.is_empty() {
        lines.push(
            "   no.  frame     t [ms]  link  part               joint  body             tooth  where                  v [m/s]  peak [N]  rise [us]  impulse [mN s]"
                .into(),
        );
    }
    for (number, i) in list {
        let body = header.bodies.get(i.body as usize);
        let tooth = body.filter(|b| b.rotor).map_or("-".to_string(), |_| i.tooth.to_string());
        let joint = loops.joint(i).map_or("-".to_string(), |j| j.to_string());
        lines.push(format!(
            "{number:6} {:6} {:10.4} {:5}  {:18} {joint:>5}  {:16} {tooth:>5}  {:22} {:7.3}  {:8.1}  {:>9}  {:14.3}",
            frame_of(i, heads).map_or("-".to_string(), |f| f.to_string()),
            i.t_s * 1e3,
            i.link,
            Feature::name(i.feature),
            body.map_or("?", |b| b.path.rsplit('.').next().unwrap_or(&b.path)),
            Segment::name(i.segment),
            i.approach_speed_m_s,
            i.peak_force_n,
            i.own_rise_time_s().map_or("law".to_string(), |s| format!("{:.2}", s * 1e6)),
            i.impulse_n_s * 1e3,
        ));
    }
    if let Some(Common { from_s, to_s, .. }) = common.filter(|c| c.is_part) {
        let (from_ms, to_ms) = (from_s * 1e3, to_s * 1e3);
        lines.push(format!("compared from {from_ms:.3} to {to_ms:.3} ms, which both recordings have"));
    }
    if list.iter().any(|(_, i)| i.own_rise_time_s().is_none()) {
        lines.push(
            "  rise law: a damper beside the spring of its contact gives more than a tenth of the peak at the touch itself; how fast the force rises then is set by the law"
                .into(),
        );
    }
    lines.extend(verdict_text(verdict, measured));
    if common.is_some() {
        let found = &verdict.differences;
        lines.push(if found.is_empty() {
            "bodies whose impacts differ from the other recording: none".into()
        } else {
            "bodies whose impacts differ from the other recording (what follows; `audit --against` measures the causes):".into()
        });
        lines.extend(found.iter().take(SUSPECTS).flat_map(suspect_text));
    }
    if let Some(takes_s) = verdict.links_take_s {
        let takes_ms = takes_s * 1e3;
        lines.push(format!(
            "links are not judged: they must arrive twice, which takes {takes_ms:.0} ms; `audit` measures them"
        ));
    }
    // The first suspect's impact, else the first of the list.
    let example = suspects.first().and_then(|s| first_of(s, all, header)).and_then(|n| Some((n, all.get(n)?)));
    if let Some((number, i)) = example.as_ref().or(list.first()) {
        lines.push(format!("open impact {number}: {}", open_in_rerun(*number, header, recording)));
        lines.push(format!("  or in Foxglove go to {}; the log /events has them all", open_in_foxglove(i)));
        lines.push(if header.is_merged() {
            "  to look closer and to explain it, record its drive alone: `pitchline run`".into()
        } else {
            format!("  why: pitchline explain {} --impact {number}", recording.display())
        });
    }
    lines.join("\n") + "\n"
}

/// What stands out: with a measured cause, without one, and what is measured to be right; then what frames tell where no suspect has a cause.
fn verdict_text(verdict: &FoundSuspects, measured: &[Finding]) -> Vec<String> {
    let suspects = &verdict.suspects;
    let mut lines = Vec::new();
    if suspects.is_empty() {
        let but = if verdict.healthy.is_empty() { "" } else { " that is measured to be odd" };
        lines.push(format!("what stands out: nothing{but}"));
    } else {
        lines.push("what stands out:".into());
        let (caused, other): (Vec<&Suspect>, Vec<&Suspect>) = suspects.iter().partition(|s| s.cause.is_some());
        lines.extend(caused.iter().take(SUSPECTS).flat_map(|s| suspect_text(s)));
        if !caused.is_empty() && !other.is_empty() {
            lines.push("also, though nothing odd is measured of it or near it:".into());
        }
        lines.extend(other.iter().take(SUSPECTS).flat_map(|s| suspect_text(s)));
    }
    if !verdict.healthy.is_empty() {
        lines.push("stands out, though its place or length is measured to be right:".into());
        lines.extend(verdict.healthy.iter().take(SUSPECTS).flat_map(suspect_text));
    }
    // Forces and losses follow from parts, and from what was recorded.
    let odd = measured.iter().find(|f| f.kind > MeasureKind::Consequence);
    if let Some(odd) = odd.filter(|_| suspects.first().is_none_or(|s| s.cause.is_none())) {
        lines.push(format!("what the frames tell (`audit`): {}", odd.text));
    }
    lines
}

/// Shadows of a suspect that are printed.
const SHADOWS: usize = 6;

/// A suspect, and what stands out because of it alone.
fn suspect_text(suspect: &Suspect) -> Vec<String> {
    let mut lines = match &suspect.cause {
        Some(cause) => vec![format!("  {}", cause.text), format!("    shows as {}", suspect.text)],
        None => vec![format!("  {}", suspect.text)],
    };
    let n = suspect.shadows.len();
    if n > 0 {
        let shown = suspect.shadows.iter().take(SHADOWS).cloned().collect::<Vec<_>>().join(", ");
        let more = if n > SHADOWS { format!(" and {} more", n - SHADOWS) } else { String::new() };
        lines.push(format!("    its shadow, not a cause of their own: {shown}{more}"));
    }
    lines
}
