//! Shows a run while it computes: viewers as sinks. A viewer must be present when the run starts. Later it can only
//! lose its own picture, never stop the run.

use super::frame::{Event, Frame, Header, Impact, Keyframe};
use super::{Sink, ViewOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Default address of a Rerun viewer.
pub const RERUN_URL: &str = "rerun+http://127.0.0.1:9876/proxy";
/// Default port on which the Foxglove app looks for a server.
pub const FOXGLOVE_PORT: u16 = 8765;

/// Kind of viewer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Viewer {
    /// A running viewer at this URL.
    Rerun(String),
    /// The Foxglove app, which connects to this port of this machine.
    Foxglove(u16),
}

/// Why a text names no viewer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewerError {
    /// No kind of viewer is called so.
    Unknown,
    /// The text after `foxglove=` is no port number.
    Port,
    /// This program was built without this feature.
    WithoutFeature(&'static str),
}

impl std::fmt::Display for ViewerError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ViewerError::Unknown => write!(f, "write rerun, rerun=URL, foxglove or foxglove=PORT"),
            ViewerError::Port => write!(f, "write foxglove or foxglove=PORT, e.g. foxglove=8765"),
            ViewerError::WithoutFeature(name) => write!(f, "this program was built without the feature `{name}`"),
        }
    }
}

impl std::error::Error for ViewerError {}

impl Viewer {
    /// Reads `rerun`, `rerun=URL`, `foxglove` or `foxglove=PORT`.
    ///
    /// # Errors
    /// The text is none of these, or this program was built without that viewer.
    pub fn parse(text: &str) -> Result<Viewer, ViewerError> {
        let (kind, place) = text.split_once('=').map_or((text, None), |(kind, place)| (kind, Some(place)));
        match kind {
            "rerun" if cfg!(feature = "rerun") => Ok(Viewer::Rerun(place.unwrap_or(RERUN_URL).to_string())),
            "foxglove" if cfg!(feature = "live") => match place.map_or(Ok(FOXGLOVE_PORT), str::parse) {
                Ok(port) => Ok(Viewer::Foxglove(port)),
                Err(_) => Err(ViewerError::Port),
            },
            "rerun" => Err(ViewerError::WithoutFeature("rerun")),
            "foxglove" => Err(ViewerError::WithoutFeature("live")),
            _ => Err(ViewerError::Unknown),
        }
    }
}

/// Connects to a viewer; an error if it is not available within `wait`. Notes for the user go to `say`.
pub fn open(
    viewer: &Viewer,
    header: &Header,
    view: ViewOptions,
    wait: Duration,
    say: fn(&str),
) -> anyhow::Result<Box<dyn Sink>> {
    let sink = connect(viewer, header, view, wait, say)?;
    say(&format!("streaming to {}", sink.path().display()));
    Ok(Box::new(NonCriticalSink { address: sink.path().to_path_buf(), sink: Some(sink), say }))
}

fn connect(
    viewer: &Viewer,
    header: &Header,
    view: ViewOptions,
    wait: Duration,
    say: fn(&str),
) -> anyhow::Result<Box<dyn Sink>> {
    // Each build leaves some of these unused.
    let _parts = (header, view, wait, say);
    match viewer {
        #[cfg(feature = "rerun")]
        Viewer::Rerun(url) => Ok(Box::new(super::rerun::RerunSink::connect(url, header, view, wait)?)),
        #[cfg(feature = "live")]
        Viewer::Foxglove(port) => {
            Ok(Box::new(super::foxglove_live::FoxgloveSink::serve(*port, header, view, wait, say)?))
        }
        #[cfg(not(all(feature = "rerun", feature = "live")))]
        _ => anyhow::bail!("{viewer:?} is not in this program"),
    }
}

/// Tries every tenth of a second until it succeeds or `wait` has passed; then returns the last error.
pub fn wait_for<T>(wait: Duration, mut attempt: impl FnMut() -> anyhow::Result<T>) -> anyhow::Result<T> {
    let started = Instant::now();
    loop {
        match attempt() {
            Err(_) if started.elapsed() < wait => std::thread::sleep(Duration::from_millis(100)),
            done => return done,
        }
    }
}

/// Wrapper of a viewer's sink. Its failure is reported once, and the run continues without it.
struct NonCriticalSink {
    address: PathBuf,
    /// None after an error.
    sink: Option<Box<dyn Sink>>,
    say: fn(&str),
}

impl NonCriticalSink {
    fn guarded(&mut self, f: impl FnOnce(&mut dyn Sink) -> anyhow::Result<()>) {
        let Some(sink) = &mut self.sink else { return };
        if let Err(e) = f(sink.as_mut()) {
            self.sink = None;
            (self.say)(&format!("warning: lost the viewer at {}, going on without it: {e:#}", self.address.display()));
        }
    }
}

impl Sink for NonCriticalSink {
    fn frame(&mut self, frame: &Frame) -> anyhow::Result<()> {
        self.guarded(|sink| sink.frame(frame));
        Ok(())
    }

    fn keyframe(&mut self, keyframe: &Keyframe) -> anyhow::Result<()> {
        self.guarded(|sink| sink.keyframe(keyframe));
        Ok(())
    }

    fn event(&mut self, event: &Event) -> anyhow::Result<()> {
        self.guarded(|sink| sink.event(event));
        Ok(())
    }

    fn impact(&mut self, impact: &Impact) -> anyhow::Result<()> {
        self.guarded(|sink| sink.impact(impact));
        Ok(())
    }

    fn close(&mut self) -> anyhow::Result<u64> {
        self.guarded(|sink| sink.close().map(|_| ()));
        Ok(0)
    }

    fn path(&self) -> &Path {
        &self.address
    }
}

/// Limits a run to `speed` simulated seconds per second by waiting in every frame.
pub struct Pace {
    speed: f64,
    /// Wall time of the first frame, and its simulated time [s].
    first: Option<(Instant, f64)>,
    stop: Arc<AtomicBool>,
}

impl Pace {
    /// `stop` ends the waiting.
    pub fn new(speed: f64, stop: Arc<AtomicBool>) -> Pace {
        Pace { speed, first: None, stop }
    }
}

impl Sink for Pace {
    fn frame(&mut self, frame: &Frame) -> anyhow::Result<()> {
        let (started, first_s) = *self.first.get_or_insert_with(|| (Instant::now(), frame.t_s));
        let due = Duration::try_from_secs_f64(((frame.t_s - first_s) / self.speed).max(0.0)).unwrap_or(Duration::MAX);
        while let Some(left) = due.checked_sub(started.elapsed())
            && !self.stop.load(Ordering::Relaxed)
        {
            std::thread::sleep(left.min(Duration::from_millis(50)));
        }
        Ok(())
    }

    fn keyframe(&mut self, _keyframe: &Keyframe) -> anyhow::Result<()> {
        Ok(())
    }

    fn event(&mut self, _event: &Event) -> anyhow::Result<()> {
        Ok(())
    }

    fn impact(&mut self, _impact: &Impact) -> anyhow::Result<()> {
        Ok(())
    }

    fn close(&mut self) -> anyhow::Result<u64> {
        Ok(0)
    }

    fn path(&self) -> &Path {
        Path::new("pace")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_held_back_to_its_pace_and_let_go_when_stopped() {
        let stop = Arc::new(AtomicBool::new(false));
        let mut pace = Pace::new(0.1, Arc::clone(&stop));
        let at = |t_s: f64| Frame { t_s, ..Frame::default() };
        let started = Instant::now();
        // Time counts from the first frame, wherever a run starts.
        for t_s in [5.0, 5.004, 5.012] {
            pace.frame(&at(t_s)).unwrap();
        }
        assert!(started.elapsed() >= Duration::from_millis(120), "{:?}", started.elapsed());
        stop.store(true, Ordering::Relaxed);
        pace.frame(&at(1e6)).unwrap();
        assert!(started.elapsed() < Duration::from_secs(60));
    }

    #[test]
    fn viewers_are_named_with_their_place() {
        assert!(Viewer::parse("vlc").unwrap_err().to_string().contains("foxglove=PORT"));
        assert!(Viewer::parse("foxglove=x").is_err());
        #[cfg(feature = "live")]
        assert_eq!(Viewer::parse("foxglove=1234"), Ok(Viewer::Foxglove(1234)));
        #[cfg(feature = "rerun")]
        assert_eq!(Viewer::parse("rerun"), Ok(Viewer::Rerun(RERUN_URL.into())));
    }
}
