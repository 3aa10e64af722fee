//! `pitchline modes`: frequencies, damping and shapes of a drive at rest under its load, or of one that runs.

use super::run::duration;
use super::{Failure, Outcome, load_drive, print_json, print_out};
use crate::analysis::mode_shapes::{LinkPlaces, MovingPart, motion, pitch_m, wave_speed_m_s};
use crate::analysis::running_modes::{KickPlan, RunningMode, RunningModes, STEADY, running_modes};
use crate::assemble::{assemble, at_rest};
use crate::drive::Drive;
use crate::model::Model;
use crate::recording::capture;
use crate::recording::{ViewOptions, create};
use crate::statics::{Mode, Plungers, modes};
use crate::units::RPM;
use std::fmt::Write;
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct ModesArgs {
    /// Drive file or bundled name
    drive: String,
    /// Replace a value of the drive
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Leave out modes above this frequency [Hz] [default: 2000; with --running 400]
    #[arg(long, value_name = "HZ", value_parser = super::finite)]
    below: Option<f64>,
    /// About the motion of the running drive in place of its rest: kick copies of the run, fit how the differences die away
    #[arg(long, conflicts_with_all = ["plungers", "mode"])]
    running: bool,
    /// With --running: time before the first kick
    #[arg(long, value_name = "T", default_value = "200ms", requires = "running", value_parser = duration)]
    settle: f64,
    /// With --running: how long a copy is followed after its kick [default: 30 periods of --below, at least 100 ms]
    #[arg(long, value_name = "T", requires = "running", value_parser = duration)]
    listen: Option<f64>,
    /// With --running: instants of the driver's turns at which copies are kicked
    #[arg(long, value_name = "N", default_value = "4", requires = "running", value_parser = clap::value_parser!(u32).range(1..=64))]
    kicks: u32,
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

/// Highest frequency unless told otherwise [Hz], at rest and running.
const BELOW_HZ: f64 = 2000.0;
const BELOW_RUNNING_HZ: f64 = 400.0;
/// How long copies are followed unless told otherwise: periods of the highest frequency, and at least [s].
const LISTEN_PERIODS: f64 = 30.0;
const LISTEN_S: f64 = 0.1;
/// Shares from which on a reader is told what they mean for the table. assumed.
const MUCH_LEFT: f64 = 0.05;
const RUNS_UP: f64 = 0.05;
const NONLINEAR: f64 = 0.02;

impl ModesArgs {
    fn below_hz(&self) -> f64 {
        self.below.unwrap_or(if self.running { BELOW_RUNNING_HZ } else { BELOW_HZ })
    }

    fn listen_s(&self) -> f64 {
        self.listen.unwrap_or((LISTEN_PERIODS / self.below_hz()).max(LISTEN_S))
    }
}

pub fn run(args: &ModesArgs) -> Result<Outcome, Failure> {
    let drive = load_drive(&args.drive, &args.set)?;
    if args.below_hz() <= 0.0 {
        return Err(Failure::Input(format!("--below {}: there are no modes below it", args.below_hz())));
    }
    if args.running {
        return of_running(args, &drive);
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
        .filter(|(_, mode)| mode.frequency_hz() <= args.below_hz())
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

/// Modes of the running drive.
fn of_running(args: &ModesArgs, drive: &Drive) -> Result<Outcome, Failure> {
    let assembly = assemble(drive).map_err(super::assembly_failure)?;
    let plan = KickPlan {
        settle_s: args.settle,
        listen_s: args.listen_s(),
        instants: args.kicks as usize,
        highest_hz: args.below_hz(),
        threads: std::thread::available_parallelism().map_or(1, usize::from),
    };
    let found = running_modes(&assembly.model, assembly.state, &plan)
        .map_err(|e| Failure::Input(format!("{}: {e} (--listen, --below)", drive.name)))?;
    let driver = assembly.model.sprockets.get(assembly.model.driver);
    let speed_m_s = driver.map_or(0.0, |s| (found.driver_rad_s[0] * s.geometry.rolling_radius_m()).abs());
    if args.json {
        return print_json(&serde_json::json!({
            "drive": drive.name, "running": true, "chain_speed_m_s": speed_m_s, "below_hz": args.below_hz(), "settle_s": args.settle, "listen_s": args.listen_s(),
            "modes": found.modes, "orders": found.orders, "left": found.left, "varies": found.varies, "nonlinear": found.nonlinear,
            "kicked": found.kicked, "instants": found.instants, "kick_j": found.kick_j, "driver_rad_s": found.driver_rad_s, "cycle_hz": found.cycle_hz,
        }));
    }
    print_out(&text_of_running(args, &drive.name, speed_m_s, &found))
}

fn text_of_running(args: &ModesArgs, name: &str, speed_m_s: f64, found: &RunningModes) -> String {
    let mut text = format!(
        "{name} running at {speed_m_s:.2} m/s, {:.0} ms after assembly: {} kicked in turn at {} of the driver's turns, followed for {:.0} ms\n",
        1e3 * args.settle,
        match found.kicked.as_slice() {
            [one] => one.clone(),
            several => format!("{} parts", several.len()),
        },
        match found.instants {
            1 => "1 instant".to_string(),
            n => format!("{n} instants"),
        },
        1e3 * args.listen_s()
    );
    text += "           Hz     +-   damping %     +-    fits  share %   what moves, by kinetic energy\n";
    let error = |value: Option<f64>| value.map_or("-".to_string(), |v| format!("{v:.2}"));
    for mode in &found.modes {
        let RunningMode { frequency_hz, damping_ratio, frequency_error_hz, damping_ratio_error, .. } = mode;
        let named = mode.moves.iter().take(NAMED_PARTS).filter(|p| p.share >= NAMED_SHARE);
        let named: Vec<String> = named.map(|p| format!("{} {:.0} %", p.part, 100.0 * p.share)).collect();
        let _infallible = writeln!(
            text,
            "{frequency_hz:>13.2} {:>6} {:>11.2} {:>6} {:>7} {:>8.1}   {}",
            error(*frequency_error_hz),
            100.0 * damping_ratio,
            error(damping_ratio_error.map(|zeta| 100.0 * zeta)),
            format!("{}/{}", mode.orders, found.orders),
            100.0 * mode.share,
            match mode.side_band_of_hz {
                Some(hz) => format!("perhaps a side band of {hz:.2} Hz; {}", named.join(", ")),
                None => named.join(", "),
            }
        );
    }
    if found.modes.is_empty() {
        text += "no swing stands in several orders of the fit\n";
    }
    let _infallible = writeln!(
        text,
        "{:.1} % of the mean responses' square is left; responses of one instant differ from the mean by {:.0} %; ten times the speed of a kick changes its response by {:.1} %",
        100.0 * found.left,
        100.0 * found.varies,
        100.0 * found.nonlinear
    );
    if found.left > MUCH_LEFT {
        text += "much is left: a longer --listen, more --kicks or a lower --below may tell modes apart\n";
    }
    if found.varies > STEADY {
        let _infallible = writeln!(
            text,
            "the drive changes over its cycle (strands slacken, contacts open): modes have side bands {:.2} Hz apart, which move with the speed",
            found.cycle_hz
        );
    }
    let [first, last] = found.driver_rad_s;
    if (last - first).abs() > RUNS_UP * first.abs() {
        let _infallible = writeln!(
            text,
            "the driver turns at {:.0} 1/min before the first kick and at {:.0} from the first to the last: these are modes of no one speed",
            first.abs() / RPM,
            last.abs() / RPM
        );
    }
    if found.nonlinear > NONLINEAR {
        text += "responses do not grow with the kick: the motion is not smooth about the instant, or not stable\n";
    }
    text
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
        "drive": name, "plungers": args.plungers, "mean_tension_n": mean_n, "modes_in_all": all, "below_hz": args.below_hz(), "modes": modes,
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
    let _infallible = writeln!(text, "{above} modes above {} Hz", args.below_hz());
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
