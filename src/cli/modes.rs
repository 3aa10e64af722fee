//! `pitchline modes`: frequencies, damping and shapes of a drive at rest under its load.

use super::{Failure, Outcome, load_drive, print_json, print_out};
use crate::analysis::mode_shapes::{LinkPlaces, MovingPart, motion, pitch_m, wave_speed_m_s};
use crate::assemble::at_rest;
use crate::model::Model;
use crate::recording::capture;
use crate::recording::{ViewOptions, create};
use crate::statics::{Mode, Plungers, modes};
use std::fmt::Write;
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct ModesArgs {
    /// Drive file or bundled name
    drive: String,
    /// Replace a value of the drive
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Leave out modes above this frequency [Hz]
    #[arg(long, value_name = "HZ", default_value = "2000", value_parser = super::finite)]
    below: f64,
    /// What plungers of tensioners do: stand on their oil, stand still, or have their springs alone
    #[arg(long, value_name = "HOW", default_value = "oil", value_parser = ["oil", "locked", "open"])]
    plungers: String,
    /// With --output: the mode whose motion is recorded
    #[arg(long, value_name = "N", requires = "output")]
    mode: Option<usize>,
    /// With --mode: largest displacement in the recording [default: a quarter of a pitch]
    #[arg(long, value_name = "MM", requires = "mode", value_parser = super::finite)]
    amplitude: Option<f64>,
    /// Recording of the mode's motion, .mcap or .rrd
    #[arg(short, long, value_name = "FILE", requires = "mode")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Parts that are named, and the share of the energy from which on.
const NAMED_PARTS: usize = 3;
const NAMED_SHARE: f64 = 0.05;
/// Periods of a recorded mode, and frames in each.
const PERIODS: u64 = 4;
const FRAMES_PER_PERIOD: u64 = 48;
/// Amplitude of a recorded mode, in pitches.
const AMPLITUDE: f64 = 0.25;
/// assumed: pitch of a drive without links [m]
const PITCH_WITHOUT_LINKS_M: f64 = 8e-3;

pub fn run(args: &ModesArgs) -> Result<Outcome, Failure> {
    let drive = load_drive(&args.drive, &args.set)?;
    if args.below <= 0.0 {
        return Err(Failure::Input(format!("--below {}: there are no modes below it", args.below)));
    }
    if let Some(output) = &args.output {
        super::run::check_recordings(std::slice::from_ref(output), &[])?;
    }
    let (model, rest) = at_rest(&drive).map_err(super::assembly_failure)?;
    let at = &rest.configuration;
    let plungers = match args.plungers.as_str() {
        "locked" => Plungers::Locked,
        "open" => Plungers::Open,
        _ => Plungers::Oil,
    };
    let all = modes(&model, at, plungers).map_err(|e| Failure::Input(format!("{}: {e}", drive.name)))?;
    let places = LinkPlaces::new(&model, at);
    let shown: Vec<(usize, &Mode, Vec<MovingPart>)> = all
        .iter()
        .enumerate()
        .filter(|(_, mode)| mode.frequency_hz() <= args.below)
        .map(|(number, mode)| (number, mode, places.parts(&model, at, mode)))
        .collect();
    let mean_n = if rest.tensions_n.is_empty() {
        0.0
    } else {
        rest.tensions_n.iter().sum::<f64>() / rest.tensions_n.len() as f64
    };
    if let (Some(output), Some(number)) = (&args.output, args.mode) {
        let mode = all.get(number).ok_or_else(|| {
            Failure::Input(format!("{} has no mode {number}; they are numbered 0 to {}", drive.name, all.len() - 1))
        })?;
        if mode.eigenvalue <= 0.0 {
            return Err(Failure::Input(format!(
                "mode {number} does not swing: its frequency is {:.1} Hz",
                mode.frequency_hz()
            )));
        }
        let pitch_m = pitch_m(&model).unwrap_or(PITCH_WITHOUT_LINKS_M);
        let amplitude_m = args.amplitude.map_or(AMPLITUDE * pitch_m, |mm| 1e-3 * mm);
        let note = vec![format!(
            "mode {number}, {:.1} Hz: displacements from rest, largest {:.3} mm; no run",
            mode.frequency_hz(),
            1e3 * amplitude_m
        )];
        let mut header = capture::header_of(&drive, &model, mean_n, note, 1);
        header.step_s = 1.0 / mode.frequency_hz() / FRAMES_PER_PERIOD as f64;
        let frames = motion(&model, at, mode, (amplitude_m, PERIODS, FRAMES_PER_PERIOD))
            .map_err(|e| Failure::World(e.to_string()))?;
        let mut sink = create(output, &header, ViewOptions::every(0.0))?;
        for frame in &frames {
            sink.frame(frame)?;
        }
        sink.finish()?;
        eprintln!("wrote {}: mode {number} at {:.1} Hz", output.display(), mode.frequency_hz());
    }
    if args.json {
        return print_json(&json(args, &drive.name, (all.len(), &shown), mean_n));
    }
    print_out(&text(args, &drive.name, &model, (all.len(), &shown), mean_n))
}

type ShownModes<'a> = Vec<(usize, &'a Mode, Vec<MovingPart>)>;

fn json(args: &ModesArgs, name: &str, (all, shown): (usize, &ShownModes<'_>), mean_n: f64) -> serde_json::Value {
    let modes: Vec<_> = shown
        .iter()
        .map(|(number, mode, parts)| {
            serde_json::json!({
                "number": number,
                "frequency_hz": mode.frequency_hz(),
                "damping_ratio": if mode.damping_ratio.is_nan() { None } else { Some(mode.damping_ratio) },
                "moves": parts,
            })
        })
        .collect();
    serde_json::json!({
        "drive": name, "plungers": args.plungers, "mean_tension_n": mean_n, "modes_in_all": all, "below_hz": args.below, "modes": modes,
    })
}

fn text(args: &ModesArgs, name: &str, model: &Model, (all, shown): (usize, &ShownModes<'_>), mean_n: f64) -> String {
    let mut text = format!(
        "{name} at rest under its load, mean tension {mean_n:.1} N; the driver is held, friction is left out{}\n",
        if model.sliders.is_empty() {
            String::new()
        } else {
            match args.plungers.as_str() {
                "locked" => "; plungers stand still".to_string(),
                "open" => "; plungers have their springs alone".to_string(),
                _ => "; plungers stand on their oil".to_string(),
            }
        }
    );
    text += "   no         Hz  damping %   what moves, by kinetic energy\n";
    for (number, mode, parts) in shown {
        let named = parts.iter().take(NAMED_PARTS).filter(|p| p.share >= NAMED_SHARE);
        let named: Vec<String> = named.map(|p| format!("{} {:.0} %", p.part, 100.0 * p.share)).collect();
        let damping =
            if mode.damping_ratio.is_nan() { "-".to_string() } else { format!("{:.3}", 100.0 * mode.damping_ratio) };
        let _infallible =
            writeln!(text, "{number:>5} {:>10.2} {damping:>10}   {}", mode.frequency_hz(), named.join(", "));
    }
    let above = all - shown.len();
    let _infallible = writeln!(text, "{above} modes above {} Hz", args.below);
    if shown.iter().any(|(_, mode, _)| mode.eigenvalue < 0.0) {
        text += "negative: what moves so does not come back; without friction this rest is none\n";
    }
    let speed_m_s = model.chain_speeds_m_s.first().copied().unwrap_or(0.0).abs();
    if let Some(wave_m_s) = wave_speed_m_s(model, mean_n).filter(|wave_m_s| speed_m_s > 0.0 && *wave_m_s > 0.0) {
        let _infallible = writeln!(
            text,
            "running at {speed_m_s:.2} m/s, waves across the spans ({wave_m_s:.0} m/s at the mean tension) have frequencies lower by some {:.1} %",
            100.0 * (speed_m_s / wave_m_s).powi(2)
        );
    }
    text
}
