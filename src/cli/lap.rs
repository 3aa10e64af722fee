//! `pitchline lap`: a number of links or joints over their way round the loop.

use super::sheet::{SheetArgs, bracketed, digits};
use super::{Answer, Failure, Outcome, answer};
use crate::analysis::lap::{Lap, LapError, LapPoint, LapRecorder};
use crate::assemble::compile;
use crate::recording::reader::{Entry, Flow, WHOLE, Wanted};
use crate::render;
use std::fmt::Write;
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct LapArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Number of links or joints: joint.force, link.tension, link.speed, links.COLUMN, joints.COLUMN; lateral (beside the mean way), gap
    /// (of plates to guides and rails), contact_force
    #[arg(default_value = "joint.force")]
    quantity: String,
    /// Chain of several, counted from 0
    #[arg(long, value_name = "N", default_value = "0")]
    chain: usize,
    /// Follow this link too, on its own way round: in the picture, as `points` of the JSON, and instead of places in the CSV
    #[arg(long, value_name = "I")]
    link: Option<usize>,
    /// Leave out frames before this time
    #[arg(long, value_name = "T", value_parser = super::run::instant)]
    from: Option<f64>,
    /// Leave out frames after this time
    #[arg(long, value_name = "T", value_parser = super::run::instant)]
    to: Option<f64>,
    #[command(flatten)]
    sheet: SheetArgs,
}

pub fn run(args: &LapArgs) -> Result<Outcome, Failure> {
    let mut reader = super::open_recording(&args.recording)?;
    let header = reader.header().clone();
    let name = reader.path().display().to_string();
    let chains = header.chains();
    let Some(links) = chains.get(args.chain) else {
        let have = match chains.len() {
            0 => "no chain with links".to_string(),
            n => format!("chains 0 to {}", n - 1),
        };
        return Err(Failure::Input(format!("--chain {}: {name} has {have}", args.chain)));
    };
    if let Some(link) = args.link.filter(|i| !links.contains(i)) {
        return Err(Failure::Input(format!(
            "--link {link}: chain {} has links {} to {}",
            args.chain,
            links.start,
            links.end - 1
        )));
    }
    let (from_s, to_s) = (args.from.unwrap_or(WHOLE.0), args.to.unwrap_or(WHOLE.1));
    if to_s < from_s {
        return Err(Failure::Input("--from is later than --to".into()));
    }
    args.sheet.check([args.recording.as_path()])?;
    let model = match args.quantity == "gap" {
        true => {
            let drive = crate::replay::drive_of(reader.path(), &header, &[])?;
            Some(compile(&drive).map_err(|e| Failure::Input(e.to_string()))?.model)
        }
        false => None,
    };
    let told = |e: LapError| {
        Failure::Input(match e {
            LapError::Unknown(why) => why,
            LapError::Short { frames } => {
                format!("{name} has {frames} frames in this time; a way round takes two or more")
            }
        })
    };
    let mut recorder =
        LapRecorder::new(&args.quantity, &header, args.chain, args.link, model.as_ref()).map_err(told)?;
    reader.each(Wanted { frames: true, ..Wanted::default() }, (from_s, to_s), |entry| {
        if let Entry::Frame(frame) = entry
            && (from_s..=to_s).contains(&frame.t_s)
        {
            recorder.add(frame, &header);
        }
        Ok(Flow::On)
    })?;
    let lap = recorder.finish(&header).map_err(told)?;
    args.sheet.draw(|| render::lap::svg(&format!("{name}: {}", lap.quantity), &bracketed(&lap.unit), &lap))?;
    let found = if args.sheet.json {
        let mut json = serde_json::to_value(&lap).map_err(|e| Failure::World(e.to_string()))?;
        if let Some(object) = json.as_object_mut() {
            object.insert("recording".into(), serde_json::json!(args.recording));
        }
        Answer::Json(json)
    } else if args.sheet.csv {
        Answer::Text(csv(&lap))
    } else {
        Answer::Text(text(args, &name, &lap))
    };
    answer(&[&reader], found, Outcome::Done)
}

/// Every place, or the way of the link that is followed.
fn csv(lap: &Lap) -> String {
    if lap.link.is_some() {
        let mut text = String::from("t_s,place_m,value\n");
        for p in &lap.points {
            let _infallible = writeln!(text, "{},{:.6},{:e}", p.t_s, p.place_m, p.value);
        }
        return text;
    }
    let mut text = String::from("from_m,to_m,mean,scatter,lowest,highest,samples\n");
    for p in lap.places.iter().filter(|p| p.samples > 0) {
        let _infallible = writeln!(
            text,
            "{:.6},{:.6},{:e},{:e},{:e},{:e},{}",
            p.from_m, p.to_m, p.mean, p.scatter, p.lowest, p.highest, p.samples
        );
    }
    text
}

fn text(args: &LapArgs, name: &str, lap: &Lap) -> String {
    let mut text = format!(
        "{name}: {} {} of {} links over a loop of {:.2} mm; {} frames from {:.3} to {:.3} ms, {:.3} laps\n\
         from [mm]    to [mm]          mean       scatter        lowest       highest   samples  where\n",
        lap.quantity,
        bracketed(&lap.unit),
        lap.links,
        1e3 * lap.length_m,
        lap.frames,
        1e3 * lap.from_s,
        1e3 * lap.to_s,
        lap.laps
    );
    for zone in &lap.zones {
        let s = &zone.statistics;
        let numbers = match s.samples {
            0 => format!("{:>14}{:>14}{:>14}{:>14}", "-", "-", "-", "-"),
            _ => [s.mean, s.scatter, s.lowest, s.highest].map(|v| format!("{:>14}", digits(v))).concat(),
        };
        let _infallible =
            writeln!(text, "{:9.2}  {:9.2}{numbers}{:>10}  {}", 1e3 * s.from_m, 1e3 * s.to_m, s.samples, zone.name);
    }
    let extreme = |better: fn(f64, f64) -> bool| {
        let mut found: Option<&LapPoint> = None;
        for p in &lap.points {
            found = found.filter(|f| !better(p.value, f.value)).or(Some(p));
        }
        found.map(|p| format!("{} at {:.2} mm ({:.3} ms)", digits(p.value), 1e3 * p.place_m, 1e3 * p.t_s))
    };
    if let (Some(link), Some(low), Some(high)) = (lap.link, extreme(|a, b| a < b), extreme(|a, b| a > b)) {
        let _infallible = writeln!(text, "link {link}: lowest {low}, highest {high}");
    }
    for why in &lap.lacking {
        let _infallible = writeln!(text, "note: {why}");
    }
    text + &args.sheet.drawn()
}
