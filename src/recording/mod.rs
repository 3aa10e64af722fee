//! Recordings: what is recorded ([`frame`]) and where it goes ([`Sink`]). Sinks see a Header and Frames; they never ask the
//! model. A new kind of file is one new module and one arm in [`create`].

pub mod capture;
#[doc(hidden)]
pub mod columns;
#[doc(hidden)]
pub mod contact_labels;
#[doc(hidden)]
pub mod foxglove_layout;
#[cfg(feature = "live")]
#[doc(hidden)]
pub mod foxglove_live;
#[doc(hidden)]
pub mod foxglove_scene;
pub mod frame;
mod frame_bytes;
mod header;
#[doc(hidden)]
pub mod live;
#[doc(hidden)]
pub mod mcap;
#[doc(hidden)]
pub mod palette;
pub mod places;
pub mod reader;
#[cfg(feature = "rerun")]
#[doc(hidden)]
pub mod rerun;
mod stored_floats;
#[doc(hidden)]
pub mod table;
#[doc(hidden)]
pub mod view_geometry;

use frame::{Event, Frame, Header, Impact, Keyframe};
use std::path::{Path, PathBuf};

/// A place where a recording goes. Calls come in order of time; `finish` comes last and once, or `close` and, where all went well,
/// `publish`.
pub trait Sink {
    /// Takes a frame.
    fn frame(&mut self, frame: &Frame) -> anyhow::Result<()>;
    /// Takes a keyframe, behind the frame of the same step.
    fn keyframe(&mut self, keyframe: &Keyframe) -> anyhow::Result<()>;
    /// Takes an event.
    fn event(&mut self, event: &Event) -> anyhow::Result<()>;
    /// Comes when its two tooth periods are over; its time is that of the touch.
    fn impact(&mut self, impact: &Impact) -> anyhow::Result<()>;
    /// Writes what is buffered and closes the file; returns its size [bytes].
    fn close(&mut self) -> anyhow::Result<u64>;
    /// Closes the file and publishes it.
    fn finish(&mut self) -> anyhow::Result<u64> {
        let bytes = self.close()?;
        self.publish()?;
        Ok(bytes)
    }
    /// Gives a finished file the name that was asked for, in place of what was there (see [`crate::output`]).
    fn publish(&mut self) -> anyhow::Result<()> {
        Ok(())
    }
    /// The name that was asked for.
    fn path(&self) -> &Path;
    /// Where the bytes are until then.
    fn current_path(&self) -> &Path {
        self.path()
    }
}

/// How densely the sinks draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewOptions {
    /// Smallest time between two pictures of viewers [s]: of the .rrd and of live runs.
    pub picture_interval_s: f64,
    /// The same of the MCAP archive [s], whose pictures are for the Foxglove app and take more room.
    pub archive_interval_s: f64,
    /// Where a viewer begins; None: at the first frame, with the whole drive.
    pub opens_at: Option<OpensAt>,
}

/// What a viewer shows first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpensAt {
    /// Time [s].
    pub t_s: f64,
    /// Place in the middle of the picture [m].
    pub point_m: [f64; 2],
}

impl ViewOptions {
    /// The same time between pictures everywhere [s].
    pub fn every(interval_s: f64) -> ViewOptions {
        ViewOptions { picture_interval_s: interval_s, archive_interval_s: interval_s, opens_at: None }
    }
}

impl Default for ViewOptions {
    fn default() -> ViewOptions {
        ViewOptions { picture_interval_s: 200e-6, archive_interval_s: 400e-6, opens_at: None }
    }
}

/// Kinds of recording that can be written, by file extension.
pub fn extensions() -> &'static [&'static str] {
    if cfg!(feature = "rerun") { &["mcap", "rrd"] } else { &["mcap"] }
}

/// Opens `path` for writing; the extension says what kind of recording.
///
/// # Errors
/// The extension names no kind of recording, or the file cannot be written.
pub fn create(path: &Path, header: &Header, view: ViewOptions) -> anyhow::Result<Box<dyn Sink>> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    match extension {
        "mcap" => Ok(Box::new(mcap::McapSink::create(path, header, view)?)),
        #[cfg(feature = "rerun")]
        "rrd" => Ok(Box::new(rerun::RerunSink::create(path, header, view)?)),
        _ => anyhow::bail!(
            "{}: recordings end in {}",
            path.display(),
            extensions().iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(" or ")
        ),
    }
}

#[doc(hidden)]
/// Takes a picture only every so often: true when `t_s` has reached the next picture's time.
#[derive(Clone, Copy, Debug)]
pub struct PictureClock {
    pub interval_s: f64,
    next_s: f64,
}

impl PictureClock {
    pub fn new(interval_s: f64) -> PictureClock {
        PictureClock { interval_s, next_s: f64::NEG_INFINITY }
    }

    pub fn due(&mut self, t_s: f64) -> bool {
        // Half a nanosecond of slack: frame times are multiples of a step, not of the interval.
        if t_s + 0.5e-9 < self.next_s {
            return false;
        }
        self.next_s = if self.next_s.is_finite() {
            self.next_s.max(t_s - self.interval_s) + self.interval_s
        } else {
            t_s + self.interval_s
        };
        true
    }
}

/// A sink's file, for messages.
#[derive(Clone, Debug)]
pub struct Output {
    /// Where it lies.
    pub path: PathBuf,
    /// Its size [bytes].
    pub bytes: u64,
}
