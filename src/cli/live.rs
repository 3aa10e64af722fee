//! `--live`: shows a run in viewers while it computes.

use super::Failure;
use super::run::duration;
use crate::recording::frame::Header;
use crate::recording::live::{self, Pace, Viewer};
use crate::recording::{Sink, ViewOptions};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

#[derive(clap::Args, Debug)]
pub struct LiveArgs {
    /// Show the run while it computes: rerun[=URL], a running Rerun viewer, or foxglove[=PORT], a server on this
    /// machine for the Foxglove app; may be given several times
    #[arg(long = "live", value_name = "VIEWER", value_parser = Viewer::parse)]
    viewers: Vec<Viewer>,
    /// Simulated seconds per second, e.g. 0.01 [default: as fast as it computes]
    #[arg(long = "live-speed", value_name = "SPEED", requires = "viewers", value_parser = speed)]
    speed: Option<f64>,
    /// How long to wait for a viewer at the start
    #[arg(long = "live-wait", value_name = "TIME", requires = "viewers", default_value = "10s", value_parser = patience)]
    wait_s: f64,
}

/// A waiting time.
fn patience(text: &str) -> Result<f64, String> {
    duration(text).and_then(|t_s| if t_s <= 86_400.0 { Ok(t_s) } else { Err("is at most a day, 86400s".into()) })
}

fn speed(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(speed) if (1e-6..=1e3).contains(&speed) => Ok(speed),
        _ => Err("write a number between 1e-6 and 1000, e.g. 0.01".into()),
    }
}

/// Opens the sinks of all viewers, and the one that limits the pace. `stop` ends the pacing.
pub fn open(
    args: &LiveArgs,
    header: &Header,
    view: ViewOptions,
    stop: &Arc<AtomicBool>,
) -> Result<Vec<Box<dyn Sink>>, Failure> {
    let wait = Duration::from_secs_f64(args.wait_s);
    let mut viewers = Vec::new();
    for viewer in &args.viewers {
        viewers.push(live::open(viewer, header, view, wait, |text| eprintln!("{text}"))?);
    }
    // Last, so that the displayed frame is not delayed.
    if let Some(speed) = args.speed {
        viewers.push(Box::new(Pace::new(speed, Arc::clone(stop))));
    }
    Ok(viewers)
}

/// Waits until the viewers have received everything. They report their errors themselves.
pub fn finish(viewers: &mut [Box<dyn Sink>]) {
    for viewer in viewers {
        let _said = viewer.finish();
    }
}
