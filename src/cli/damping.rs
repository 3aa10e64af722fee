//! `pitchline damping`: frequencies and damping of what swings, from its decay or from a resonance that a run-up passes.

use super::sheet::{bracketed, digits};
use super::{Answer, Failure, Outcome, answer};
use crate::analysis::decay::{DampingError, Decay, UNEXPLAINED, decay};
use crate::analysis::half_power::{HalfPower, NoWidth, response};
use crate::analysis::order_spectrum::{AngleRecord, PERIODS, SpectrumError, read};
use crate::analysis::order_tracks::tracks;
use crate::analysis::signal::Signal;
use crate::recording::reader::WHOLE;
use std::fmt::Write;
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct DampingArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Quantity, as `spectrum` takes it: sprocket.driven.speed, sensors.KIND.NAME, arms.NAME.angle
    quantity: String,
    /// Begin here: where what drives it has ended, or before the resonance
    #[arg(long, value_name = "T", value_parser = super::run::instant)]
    from: Option<f64>,
    /// End here
    #[arg(long, value_name = "T", value_parser = super::run::instant)]
    to: Option<f64>,
    /// Take the half power of this order, counted per turn of the driver, over a run-up [default: the decay]
    #[arg(long, value_name = "ORDER", value_parser = super::finite)]
    order: Option<f64>,
    /// With --order: turns of the driver in a window
    #[arg(long, value_name = "TURNS", default_value = "4", value_parser = super::finite, requires = "order")]
    window: f64,
    /// Without --order: only swings up to this frequency [Hz]; faster ones are filtered away
    #[arg(long, value_name = "HZ", value_parser = super::finite, conflicts_with = "order")]
    to_hz: Option<f64>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &DampingArgs) -> Result<Outcome, Failure> {
    let (from_s, to_s) = (args.from.unwrap_or(WHOLE.0), args.to.unwrap_or(WHOLE.1));
    if to_s < from_s {
        return Err(Failure::Input("--from is later than --to".into()));
    }
    for (option, value) in [("--order", args.order), ("--window", Some(args.window)), ("--to-hz", args.to_hz)] {
        if let Some(value) = value.filter(|v| *v <= 0.0) {
            return Err(Failure::Input(format!("{option} {value}: it is above zero")));
        }
    }
    let mut reader = super::open_recording(&args.recording)?;
    let header = reader.header().clone();
    let signal = Signal::find(&args.quantity, &header).map_err(|e| Failure::Input(e.to_string()))?;
    let record = read(&mut reader, &signal, (from_s, to_s))?;
    let name = reader.path().display().to_string();
    let found = match args.order {
        None => of_decay(args, &name, &signal, &record)?,
        Some(order) => of_run_up(args, &name, &signal, &record, order)?,
    };
    answer(&[&reader], found, Outcome::Done)
}

fn of_decay(args: &DampingArgs, name: &str, signal: &Signal, record: &AngleRecord) -> Result<Answer, Failure> {
    let found = decay(&record.times_s, &record.values, args.to_hz).map_err(|e| {
        Failure::Input(match e {
            DampingError::Few(there, needed) => format!(
                "{name}: `{}` has {there} values in this time; a decay takes {needed}: record it more often (--every), or take a longer part",
                signal.name
            ),
            DampingError::Constant => format!("{name}: `{}` does not change in this time", signal.name),
            DampingError::Noise => format!("{name}: no swing of `{}` stands out of noise", signal.name),
        })
    })?;
    if args.json {
        return Ok(Answer::Json(with_names(args, signal, serde_json::json!({ "decay": found }))));
    }
    Ok(Answer::Text(decay_text(name, signal, &found)))
}

/// A result with what it belongs to.
fn with_names(args: &DampingArgs, signal: &Signal, mut value: serde_json::Value) -> serde_json::Value {
    super::add_field(&mut value, "recording", serde_json::json!(args.recording));
    super::add_field(&mut value, "quantity", serde_json::json!(signal.name));
    super::add_field(&mut value, "unit", serde_json::json!(signal.unit));
    value
}

fn decay_text(name: &str, signal: &Signal, found: &Decay) -> String {
    let unit = bracketed(&signal.unit);
    let mut text = format!(
        "{name}: {} {unit}, {} values from {:.3} to {:.3} ms",
        signal.name,
        found.values,
        1e3 * found.from_s,
        1e3 * found.to_s
    );
    if found.every > 1 {
        let _infallible =
            write!(text, "; every {}th behind a low-pass filter, up to {:.0} Hz", found.every, found.highest_hz);
    }
    let _infallible = writeln!(
        text,
        "\n{:>24}{:>24}{:>15}{:>18}{:>10}",
        "frequency [Hz]",
        "damping ratio [%]",
        "log decrement",
        format!("size {unit}"),
        "share [%]"
    );
    for s in &found.swings {
        let (frequency, ratio) = match s.log_decrement {
            Some(_) => (
                format!("{:.4} +- {:.4}", s.frequency_hz, s.frequency_error_hz),
                format!("{:.4} +- {:.4}", 100.0 * s.damping_ratio, 100.0 * s.damping_ratio_error),
            ),
            None => (format!("creeps, {:.4} 1/s", s.decay_rate_per_s), "-".to_string()),
        };
        let decrement = s.log_decrement.map_or("-".to_string(), |d| format!("{d:.5}"));
        let is_long = s.log_decrement.is_some() && s.frequency_hz * (found.to_s - found.from_s) < 1.0;
        let remark = match s.decay_rate_per_s < -2.0 * s.decay_rate_error_per_s.max(0.0) {
            _ if is_long => "  less than a period",
            true => "  grows",
            false => "",
        };
        let _infallible = writeln!(
            text,
            "{frequency:>24}{ratio:>24}{decrement:>15}{:>18}{:>10.2}{remark}",
            digits(s.amplitude),
            100.0 * s.share
        );
    }
    let _infallible = writeln!(
        text,
        "about {} {}; {:.3} % of the square of what moves ({} {}, rms) is left",
        digits(found.rest),
        signal.unit,
        100.0 * found.left,
        digits(found.moves_rms),
        signal.unit
    );
    if found.left > UNEXPLAINED {
        text += "note: what is left is so much that this number does not move as a sum of decaying swings does: take a part in which nothing drives it\n";
    }
    text
}

fn of_run_up(
    args: &DampingArgs,
    name: &str,
    signal: &Signal,
    record: &AngleRecord,
    order: f64,
) -> Result<Answer, Failure> {
    let half = 0.5 / (record.interval_s * record.turns_per_s).max(1e-12);
    if order > half {
        return Err(Failure::Input(format!(
            "--order {order}: frames are {:.1} us apart and resolve orders up to {half:.1}; record more often (--every)",
            1e6 * record.interval_s
        )));
    }
    if order * args.window < PERIODS {
        return Err(Failure::Input(format!(
            "--window {}: order {order} has {:.2} periods in a window, and is told from the mean from {PERIODS} on: give --window {:.1}",
            args.window,
            order * args.window,
            PERIODS / order
        )));
    }
    let found = tracks(record, args.window, &[order], (1, order)).map_err(|e| {
        Failure::Input(match e {
            SpectrumError::Few(there, needed) => format!(
                "{name}: a window of {} turns, or all of it, has {there} values of `{}`, it takes {needed}: record more often (--every), or give --window more turns",
                args.window, signal.name
            ),
            SpectrumError::Still => format!("{name}: the driver stands still: take the decay, without --order"),
            SpectrumError::Short { turns, needed, .. } => {
                format!("{name} is {turns:.3} turns of `{}` long, and one window takes {needed:.3}", record.driver)
            }
        })
    })?;
    let points = found.tracks.first().map(|track| response(&found, track)).unwrap_or_default();
    let peak = HalfPower::of(&points).map_err(|e| {
        Failure::Input(match e {
            NoWidth::Few(windows) => format!(
                "{name}: {windows} windows of {} turns; a peak takes 5: a longer run-up, or a smaller --window",
                args.window
            ),
            NoWidth::AtEnd(hz) => format!(
                "{name}: order {order} of `{}` is largest at {hz:.2} Hz, at an end of the run-up: it passes no resonance",
                signal.name
            ),
            NoWidth::Overlaps(hz) => format!(
                "{name}: order {order} of `{}` has its peak at {hz:.2} Hz, and does not fall to 0.707 of it on both sides: the run-up is too short, or another resonance is near",
                signal.name
            ),
        })
    })?;
    if args.json {
        let mut value = serde_json::json!({ "half_power": peak, "order": order, "doubts": peak.doubts() });
        let points = points.iter().map(|p| serde_json::json!([p.hz, p.amplitude])).collect::<Vec<_>>();
        super::add_field(&mut value, "response", serde_json::json!(points));
        return Ok(Answer::Json(with_names(args, signal, value)));
    }
    let mut text = format!(
        "{name}: order {order} of {} {}, {} windows of {} turns of `{}`, {:.2} to {:.2} Hz\n\
         peak {} at {:.3} Hz ({:.0} 1/min); 0.707 of it at {:.3} and {:.3} Hz: damping ratio {:.3}{}\n",
        signal.name,
        bracketed(&signal.unit),
        points.len(),
        args.window,
        record.driver,
        points.first().map_or(f64::NAN, |p| p.hz),
        points.last().map_or(f64::NAN, |p| p.hz),
        digits(peak.amplitude),
        peak.frequency_hz,
        60.0 * peak.frequency_hz / order,
        peak.between_hz[0],
        peak.between_hz[1],
        100.0 * peak.damping_ratio,
        match peak.damping_ratio_error {
            e if e.is_nan() => " %, from so few windows that its error is not known".to_string(),
            e => format!(" +- {:.3} %", 100.0 * e),
        }
    );
    for doubt in peak.doubts() {
        let _infallible = writeln!(text, "note: {doubt}");
    }
    Ok(Answer::Text(text))
}
