//! `pitchline spectrum`: which orders a number of a recording has, and what turns with them.

use super::sheet::{SheetArgs, bracketed, digits};
use super::{Answer, Failure, Outcome, answer};
use crate::analysis::audit::findings::difference;
use crate::analysis::order_spectrum::{
    AngleRecord, AngleSpectrum, LINE_PROMINENCE, OscillationDifference, SpectrumError, SpectrumPeak, read, spectrum,
    unresolved,
};
use crate::analysis::signal::Signal;
use crate::recording::reader::{Reader, WHOLE};
use crate::render;
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct SpectrumArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Quantity, as break expressions and tables call it: sprocket.driven.speed, joint[3].force,
    /// span.driven.driver.tension, sensors.KIND.NAME, rotors.driven.speed_rad_s
    quantity: String,
    /// Show the amplitudes of this recording of the same drive beside
    #[arg(long, value_name = "REC")]
    against: Option<PathBuf>,
    /// Print only the N largest peaks
    #[arg(long, value_name = "N", default_value = "20")]
    top: usize,
    /// Leave out orders above this one, counted per turn of the driver
    #[arg(long, value_name = "ORDER", value_parser = super::finite)]
    to_order: Option<f64>,
    #[command(flatten)]
    sheet: SheetArgs,
}

/// Share of the highest order that frames resolve up to which a spectrum is shown: above, interpolation and aliases count.
pub(super) const SHOWN: f64 = 0.9;
/// Ratio of amplitudes from which an order differs from the other recording. assumed: half as much again is seen in the picture.
const DIFFERING_RATIO: f64 = 1.5;
/// Share of the largest amplitude that a differing order has at least. assumed: less is not seen in the picture.
const DIFFERING_SHARE: f64 = 0.02;
/// Prominence of a differing order: what rises less from its surroundings is noise, or a resonance. Peaks of noise reach 3 to 4 times their median.
const DIFFERING_PROMINENCE: f64 = 5.0;
/// Resolutions within which a line leaks into its surroundings, assumed: beyond, its shoulders are below a thousandth; and how many times larger than
/// them it is at least: the largest shoulder of a Hann window is 1/37.
const LEAKS: f64 = 8.0;
const LEAKAGE: f64 = 30.0;

/// A recording's spectrum.
struct SpectrumSheet {
    record: AngleRecord,
    spectrum: AngleSpectrum,
    name: String,
}

pub fn run(args: &SpectrumArgs) -> Result<Outcome, Failure> {
    args.sheet.check(std::iter::once(args.recording.as_path()).chain(args.against.as_deref()))?;
    let mut reader = super::open_recording(&args.recording)?;
    let header = reader.header().clone();
    let signal = Signal::find(&args.quantity, &header).map_err(|e| Failure::Input(e.to_string()))?;
    let mut other = args.against.as_deref().map(super::open_recording).transpose()?;
    if let Some(other) = &other
        && let Some(what) = difference(&header, other.header())
    {
        let (a, b) = (args.recording.display(), other.path().display());
        return Err(Failure::Input(format!("{a} and {b} are recordings of two drives: {what}")));
    }
    let own = sheet(&mut reader, &signal)?;
    let theirs = match &mut other {
        None => None,
        Some(other) => {
            let signal = Signal::find(&args.quantity, other.header()).map_err(|e| Failure::Input(e.to_string()))?;
            Some(sheet(other, &signal)?)
        }
    };
    // The highest order that the frames of both recordings resolve.
    let half_of = |s: &SpectrumSheet| 0.5 / (s.record.interval_s * s.record.turns_per_s).max(1e-12);
    let half = theirs.iter().map(half_of).fold(half_of(&own), f64::min);
    let highest = args.to_order.unwrap_or(SHOWN * half).min(half);
    if highest <= own.spectrum.resolution() {
        return Err(Failure::Input(format!(
            "up to order {highest} there is nothing to show: orders are {:.3} apart",
            own.spectrum.resolution()
        )));
    }
    args.sheet.draw(|| {
        let title = format!("{}: {}", own.name, signal.name);
        let curves: Vec<(&str, &AngleSpectrum)> =
            std::iter::once(&own).chain(&theirs).map(|s| (s.name.as_str(), &s.spectrum)).collect();
        render::spectrum::svg(&title, &bracketed(&signal.unit), &own.record.driver, &curves, highest)
    })?;
    let found = if args.sheet.json {
        Answer::Json(json(args, &signal, &own, theirs.as_ref(), highest))
    } else if args.sheet.csv {
        Answer::Text(csv(&own, theirs.as_ref(), highest))
    } else {
        Answer::Text(text(args, &signal, &own, theirs.as_ref(), highest))
    };
    let readers: Vec<&Reader> = std::iter::once(&reader).chain(&other).collect();
    answer(&readers, found, Outcome::Done)
}

fn sheet(reader: &mut Reader, signal: &Signal) -> Result<SpectrumSheet, Failure> {
    let name = reader.path().display().to_string();
    let record = read(reader, signal, WHOLE)?;
    let spectrum = spectrum(&record).map_err(|e| {
        Failure::Input(match e {
            SpectrumError::Few(there, needed) => format!(
                "{name}: `{}` has {there} values; a spectrum takes {needed}: record it longer, or more often (--every)",
                signal.name
            ),
            SpectrumError::Still => format!("{name}: the driver stands still: there are no orders"),
            SpectrumError::Short { turns, needed, needed_s } => format!(
                "{name} is {turns:.3} turns of `{}` long; the highest order of the drive, that of its teeth, takes {needed:.3} turns: {:.3} ms",
                record.driver,
                needed_s * 1e3
            ),
        })
    })?;
    Ok(SpectrumSheet { record, spectrum, name })
}

/// Peaks up to an order, the largest first.
fn shown(spectrum: &AngleSpectrum, highest: f64, top: usize) -> Vec<&SpectrumPeak> {
    spectrum.peaks.iter().filter(|p| p.order <= highest).take(top).collect()
}

/// Orders of either recording whose amplitudes differ, the largest difference first: order, names, own amplitude, the other's.
fn differing(own: &SpectrumSheet, theirs: &SpectrumSheet, highest: f64) -> Vec<(f64, Vec<String>, f64, f64)> {
    let (a, b) = (&own.spectrum, &theirs.spectrum);
    let largest = a.peaks.iter().chain(&b.peaks).map(|p| p.amplitude).fold(0.0, f64::max);
    let mut found: Vec<(f64, Vec<String>, f64, f64)> = Vec::new();
    let mut peaks: Vec<&SpectrumPeak> = a.peaks.iter().chain(&b.peaks).filter(|p| p.order <= highest).collect();
    // The peaks of a swing that irregular impacts keep up are as large as chance has it, in two recordings of one drive too.
    let least = |p: &SpectrumPeak| if p.names.is_empty() { LINE_PROMINENCE } else { DIFFERING_PROMINENCE };
    peaks.retain(|p| p.prominence >= least(p));
    // A line has shoulders in the spectrum of a record that does not hold a whole number of its periods.
    let near = LEAKS * a.resolution().max(b.resolution());
    let lines: Vec<(f64, f64)> = peaks.iter().map(|p| (p.order, p.amplitude)).collect();
    let leaks = |p: &SpectrumPeak| {
        let is_line = |(order, size): &(f64, f64)| (order - p.order).abs() < near && *size > LEAKAGE * p.amplitude;
        p.names.is_empty() && lines.iter().any(is_line)
    };
    peaks.retain(|p| !leaks(p));
    peaks.sort_by(|p, q| q.amplitude.total_cmp(&p.amplitude));
    for peak in peaks {
        let (here, there) = (a.near(peak.order), b.near(peak.order));
        let counts =
            here.max(there) >= DIFFERING_RATIO * here.min(there) && here.max(there) >= DIFFERING_SHARE * largest;
        let is_new = found.iter().all(|(order, ..)| (order - peak.order).abs() > a.resolution());
        if counts && is_new {
            found.push((peak.order, peak.names.clone(), here, there));
        }
    }
    // What no part turns with is a swing of the drive's own, at its start or by irregular impacts: it comes after what parts cause.
    let size = |p: &(f64, Vec<String>, f64, f64)| (p.2 - p.3).abs();
    found.sort_by(|p, q| p.1.is_empty().cmp(&q.1.is_empty()).then(size(q).total_cmp(&size(p))));
    found
}

fn name_of(names: &[String]) -> String {
    if names.is_empty() { "-".into() } else { names.join(", ") }
}

fn text(
    args: &SpectrumArgs,
    signal: &Signal,
    own: &SpectrumSheet,
    theirs: Option<&SpectrumSheet>,
    highest: f64,
) -> String {
    let s = &own.spectrum;
    let unit = bracketed(&signal.unit);
    let mut lines = vec![
        format!(
            "{}: {} {unit}, mean {}; {} values over {:.3} turns of `{}` at {:.3} 1/s",
            own.name,
            signal.name,
            digits(s.mean),
            own.record.values.len(),
            s.turns,
            own.record.driver,
            s.turns_per_s
        ),
        format!("orders are {:.4} apart, and are shown up to {highest:.1}", s.resolution()),
    ];
    let beside = if theirs.is_some() { "  in the other" } else { "" };
    lines.push(format!(
        "      order  frequency [Hz]  {:>16}{beside}  over its surroundings  name",
        format!("size {unit}")
    ));
    for peak in shown(s, highest, args.top) {
        let beside = theirs.map_or(String::new(), |t| format!("{:>14}", digits(t.spectrum.near(peak.order))));
        let times = if peak.prominence >= 1e4 { ">1e4 x".to_string() } else { format!("{:.1} x", peak.prominence) };
        lines.push(format!(
            "{:11.4} {:15.2} {:>17}{beside} {times:>22}  {}",
            peak.order,
            peak.frequency_hz,
            digits(peak.amplitude),
            name_of(&peak.names)
        ));
    }
    if let Some(theirs) = theirs {
        lines.extend(oscillation(own, theirs, &signal.unit));
        let found = differing(own, theirs, highest);
        lines.push(if found.is_empty() {
            "no order differs from the other recording".into()
        } else {
            "what differs:".to_string()
        });
        for (order, names, here, there) in found.iter().take(args.top) {
            lines.push(format!(
                "  {} (order {order:.3}): {} {}, in the other recording {} {}",
                if names.is_empty() { "no part's order".into() } else { name_of(names) },
                digits(*here),
                signal.unit,
                digits(*there),
                signal.unit
            ));
        }
    }
    for (name, needed_s) in unresolved(&own.record, s) {
        lines.push(format!("too short for `{name}`: it takes {:.1} ms", needed_s * 1e3));
    }
    lines.join("\n") + "\n" + &args.sheet.drawn()
}

/// How the oscillations of both recordings differ, in words: as a whole, and in the frequency of the largest line.
fn oscillation(own: &SpectrumSheet, theirs: &SpectrumSheet, unit: &str) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(d) = OscillationDifference::between(&own.record, &theirs.record) {
        lines.push(format!(
            "over {:.3} turns that both have: {} {unit} rms about the mean, in the other recording {} {unit}; the difference is {:.1} % of the other's",
            d.turns,
            digits(d.rms),
            digits(d.rms_other),
            100.0 * d.rms_of_difference_share
        ));
    }
    if let Some((here, there)) = same_line(own, theirs) {
        lines.push(format!(
            "the largest line, {}, lies at {:.2} Hz, in the other recording at {:.2} Hz: {:+.2} %",
            name_of(&here.names),
            here.frequency_hz,
            there.frequency_hz,
            100.0 * (here.frequency_hz / there.frequency_hz - 1.0)
        ));
    }
    lines
}

/// The largest line that has a name, and the line of that name in the other recording.
fn same_line<'a>(own: &'a SpectrumSheet, theirs: &'a SpectrumSheet) -> Option<(&'a SpectrumPeak, &'a SpectrumPeak)> {
    let mut named = own.spectrum.peaks.iter().filter(|p| !p.names.is_empty());
    let other = |own: &SpectrumPeak| theirs.spectrum.peaks.iter().find(|p| p.names == own.names);
    named.find_map(|here| Some((here, other(here)?)))
}

fn csv(own: &SpectrumSheet, theirs: Option<&SpectrumSheet>, highest: f64) -> String {
    let s = &own.spectrum;
    let mut lines =
        vec![format!("order,frequency_hz,amplitude{}", if theirs.is_some() { ",amplitude_other" } else { "" })];
    // Zeros made it denser than it is.
    for (k, amplitude) in s.amplitudes.iter().enumerate().step_by(s.values_per_resolution().div_ceil(2).max(1)) {
        let order = k as f64 * s.step;
        if order > highest {
            break;
        }
        let beside = theirs.map_or(String::new(), |t| format!(",{:e}", t.spectrum.near(order)));
        lines.push(format!("{order},{},{amplitude:e}{beside}", order * s.turns_per_s));
    }
    lines.join("\n") + "\n"
}

fn json(
    args: &SpectrumArgs,
    signal: &Signal,
    own: &SpectrumSheet,
    theirs: Option<&SpectrumSheet>,
    highest: f64,
) -> serde_json::Value {
    let s = &own.spectrum;
    let peaks = shown(s, highest, args.top).into_iter().map(|peak| {
        let mut value = serde_json::json!(peak);
        if let Some(theirs) = theirs {
            super::add_field(&mut value, "amplitude_other", serde_json::json!(theirs.spectrum.near(peak.order)));
        }
        value
    });
    let differing = theirs.map(|theirs| {
        let rows = differing(own, theirs, highest).into_iter().map(|(order, names, here, there)| {
            serde_json::json!({ "order": order, "names": names, "amplitude": here, "amplitude_other": there })
        });
        rows.collect::<Vec<_>>()
    });
    serde_json::json!({
        "recording": args.recording,
        "quantity": signal.name,
        "unit": signal.unit,
        "mean": s.mean,
        "driver": own.record.driver,
        "turns": s.turns,
        "resolution": s.resolution(),
        "highest_order": highest,
        "peaks": peaks.collect::<Vec<_>>(),
        "differing": differing,
        "largest_line": theirs.and_then(|theirs| same_line(own, theirs)).map(|(here, there)| {
            serde_json::json!({ "names": here.names, "frequency_hz": here.frequency_hz, "frequency_hz_other": there.frequency_hz })
        }),
        "oscillation": theirs.and_then(|theirs| OscillationDifference::between(&own.record, &theirs.record)),
        "too_short_for": unresolved(&own.record, s)
            .into_iter()
            .map(|(name, needed_s)| serde_json::json!({ "name": name, "needed_s": needed_s }))
            .collect::<Vec<_>>(),
    })
}
