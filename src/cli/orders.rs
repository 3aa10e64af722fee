//! `pitchline orders`: orders of a number while the speed changes.

use super::sheet::{SheetArgs, bracketed, digits};
use super::spectrum::SHOWN;
use super::{Answer, Failure, Outcome, answer};
use crate::analysis::order_spectrum::{AngleRecord, SpectrumError, read};
use crate::analysis::order_tracks::{OrderTracks, tracks};
use crate::analysis::signal::Signal;
use crate::recording::reader::WHOLE;
use crate::render;
use std::fmt::Write;
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct OrdersArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Quantity, as `spectrum` takes it: sprocket.driven.speed, sensors.KIND.NAME, arms.NAME.speed
    quantity: String,
    /// Follow these orders, counted per turn of the driver [default: the largest of the recording]
    #[arg(long = "order", value_name = "ORDER", value_parser = super::finite)]
    order: Vec<f64>,
    /// Turns of the driver in a window: more tell closer orders apart, fewer follow faster changes
    #[arg(long, value_name = "TURNS", default_value = "4", value_parser = super::finite)]
    window: f64,
    /// Without --order: how many
    #[arg(long, value_name = "N", default_value = "6")]
    top: usize,
    /// Leave out orders above this one
    #[arg(long, value_name = "ORDER", value_parser = super::finite)]
    to_order: Option<f64>,
    #[command(flatten)]
    sheet: SheetArgs,
}

pub fn run(args: &OrdersArgs) -> Result<Outcome, Failure> {
    if args.window <= 0.0 {
        return Err(Failure::Input(format!("--window {}: a window takes some turns", args.window)));
    }
    if let Some(order) = args.order.iter().find(|order| **order <= 0.0) {
        return Err(Failure::Input(format!("--order {order}: orders are above zero")));
    }
    args.sheet.check([args.recording.as_path()])?;
    let mut reader = super::open_recording(&args.recording)?;
    let header = reader.header().clone();
    let signal = Signal::find(&args.quantity, &header).map_err(|e| Failure::Input(e.to_string()))?;
    let record = read(&mut reader, &signal, WHOLE)?;
    let half = 0.5 / (record.interval_s * record.turns_per_s).max(1e-12);
    let highest = args.to_order.unwrap_or(SHOWN * half).min(half);
    if let Some(order) = args.order.iter().find(|order| **order > half) {
        return Err(Failure::Input(format!(
            "--order {order}: frames are {:.1} us apart and resolve orders up to {half:.1}; record more often (--every)",
            1e6 * record.interval_s
        )));
    }
    let name = reader.path().display().to_string();
    let found = tracks(&record, args.window, &args.order, (args.top, highest)).map_err(|e| {
        Failure::Input(match e {
            SpectrumError::Few(there, needed) => format!(
                "{name}: a window of {} turns has {there} values of `{}`, it takes {needed}: record more often (--every), or give --window more turns",
                args.window, signal.name
            ),
            SpectrumError::Still => format!("{name}: the driver stands still: there are no orders"),
            SpectrumError::Short { turns, needed, needed_s } => format!(
                "{name} is {turns:.3} turns of `{}` long, and one window takes {needed:.3}: record {:.1} ms, or give --window fewer turns",
                record.driver,
                1e3 * needed_s
            ),
        })
    })?;
    args.sheet.draw(|| {
        let title = format!("{name}: {}", signal.name);
        render::orders::svg(&title, &bracketed(&signal.unit), &record.driver, &found, highest)
    })?;
    let found = if args.sheet.json {
        Answer::Json(serde_json::json!({
            "recording": args.recording,
            "quantity": signal.name,
            "unit": signal.unit,
            "driver": record.driver,
            "window_turns": args.window,
            "speed_rpm": found.turns_per_s.iter().map(|v| 60.0 * v).collect::<Vec<_>>(),
            "time_s": found.times_s,
            "mean": found.means,
            "orders": found.tracks,
        }))
    } else if args.sheet.csv {
        Answer::Text(csv(&found))
    } else {
        Answer::Text(text(args, &name, &signal, &record, &found))
    };
    answer(&[&reader], found, Outcome::Done)
}

fn csv(found: &OrderTracks) -> String {
    let mut text = String::from("time_s,speed_rpm,mean");
    for track in &found.tracks {
        let _infallible = write!(text, ",order_{}", track.order);
    }
    text.push('\n');
    for (k, ((time, turns), mean)) in found.times_s.iter().zip(&found.turns_per_s).zip(&found.means).enumerate() {
        let _infallible = write!(text, "{time},{},{mean:e}", 60.0 * turns);
        for track in &found.tracks {
            let _infallible = write!(text, ",{:e}", track.amplitudes.get(k).copied().unwrap_or(f64::NAN));
        }
        text.push('\n');
    }
    text
}

fn text(args: &OrdersArgs, name: &str, signal: &Signal, record: &AngleRecord, found: &OrderTracks) -> String {
    let speeds = found.turns_per_s.iter().map(|v| 60.0 * v);
    let (low, high) = speeds.fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
    let unit = bracketed(&signal.unit);
    let mut text = format!(
        "{name}: {} {unit} in {} windows of {} turns of `{}`, {low:.0} to {high:.0} 1/min\n\
         \x20     order  {:>16}  at [1/min]    at [Hz]  {:>12}  name\n",
        signal.name,
        found.turns_per_s.len(),
        args.window,
        record.driver,
        format!("largest {unit}"),
        "mean",
    );
    for track in &found.tracks {
        let at = track.largest();
        let turns = found.turns_per_s.get(at).copied().unwrap_or(f64::NAN);
        let mean = track.amplitudes.iter().sum::<f64>() / track.amplitudes.len().max(1) as f64;
        let _infallible = writeln!(
            text,
            "{:11.4}  {:>16}  {:10.0} {:10.2}  {:>12}  {}",
            track.order,
            digits(track.amplitudes.get(at).copied().unwrap_or(f64::NAN)),
            60.0 * turns,
            track.order * turns,
            digits(mean),
            if track.names.is_empty() { "-".to_string() } else { track.names.join(", ") }
        );
    }
    text + &args.sheet.drawn()
}
