//! MCAP: the archive. Own protobuf topics, and in addition Foxglove's, so that Foxglove draws a recording without further
//! setup.
//!
//! ```text
//! /pitchline/header    Header, once          /tf        foxglove.FrameTransforms at the picture rate
//! /pitchline/frame     Frame, every frame    /scene     foxglove.SceneUpdate: force arrows at the picture rate
//! /pitchline/signals   Signals, every frame  /events    foxglove.Log
//! /pitchline/keyframe  Keyframe              /pitchline/event  Event
//! /pitchline/impact    Impact, two tooth periods after its first contact
//!                                            /drive     foxglove.SceneUpdate, once: outlines and the scale of forces
//! ```
//! Who seeks gets the last message of every topic before that time, and no other: what is sent once has a topic of its own.
//!
//! Frames and keyframes are in chunks of their own, which are not compressed: their floats do not repeat. All else is in chunks that are. A
//! program that shows curves and pictures thus reads a tenth of the file.
//!
//! Chunks are closed every [`FRAMES_PER_CHUNK`] frames and written whole. A killed run thus leaves a file that is
//! complete up to the last chunk, and bytes do not depend on timing: two runs of one drive give the same file. Only if
//! a run is so slow that frames would wait longer than [`LONGEST_WAIT`] are chunks closed earlier; the content is then
//! the same, but not its division into chunks.

mod archive_file;

use super::foxglove_scene as scene;
use super::frame::{Event, Frame, Header, Impact, Keyframe, Signals};
pub use super::reader::nanoseconds;
use super::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use super::{PictureClock, Sink, ViewOptions};
use crate::integrate::Isa;
use crate::output::OutputFile;
use anyhow::Context;
use archive_file::{ArchiveFile, OpenChunk, Packing};
use prost::Message;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::time::{Duration, Instant};

/// Compiled `assets/pitchline.proto` (a FileDescriptorSet); a test keeps the two consistent.
pub const DESCRIPTOR: &[u8] = include_bytes!("../../assets/pitchline.desc");

/// Frames after which chunks are closed and passed to the system: a chunk of frames stays in the processor's cache until then.
pub const FRAMES_PER_CHUNK: u64 = 32;

/// Bytes after which a chunk is closed regardless of its frames, because readers limit the unpacked size.
const LARGEST_CHUNK: usize = 16 << 20;

/// Longest time for which frames may wait in an open chunk: a slow run that is killed loses no more than this.
const LONGEST_WAIT: Duration = Duration::from_millis(100);

/// zstd level of what is no frame. Negative levels skip the entropy coding of literals, which gains little for mantissas of
/// poses; the lower the level, the sooner data without repetition are skipped. Measured for the bush drive, per frame: -32 988 bytes
/// in 0.7 us, -8 847 in 0.9, -3 800 in 1.3, 1 702 in 2.3, 3 669 in 3.3.
const ZSTD_LEVEL: i32 = -8;

/// Topics in the order in which they are registered.
pub const TOPICS: [(&str, &str); 10] = [
    ("/pitchline/header", "pitchline.Header"),
    ("/pitchline/frame", "pitchline.Frame"),
    ("/pitchline/signals", "pitchline.Signals"),
    ("/pitchline/keyframe", "pitchline.Keyframe"),
    ("/pitchline/event", "pitchline.Event"),
    ("/tf", "foxglove.FrameTransforms"),
    ("/scene", "foxglove.SceneUpdate"),
    ("/events", "foxglove.Log"),
    ("/pitchline/impact", "pitchline.Impact"),
    ("/drive", "foxglove.SceneUpdate"),
];
/// Indices of the topics in [`TOPICS`].
pub const HEADER: usize = 0;
pub const FRAME: usize = 1;
pub const SIGNALS: usize = 2;
pub const KEYFRAME: usize = 3;
pub const EVENT: usize = 4;
pub const TRANSFORMS: usize = 5;
pub const SCENE: usize = 6;
pub const LOG: usize = 7;
pub const IMPACT: usize = 8;
pub const DRIVE: usize = 9;

/// Writes an MCAP file.
pub struct McapSink {
    output: OutputFile,
    /// None after an error: nothing more is written; what was written remains.
    archive: Option<ArchiveFile<File>>,
    /// Frames and keyframes, and all else.
    numbers: OpenChunk,
    others: OpenChunk,
    header: Header,
    clock: PictureClock,
    transforms: scene::Transforms,
    forces: scene::ForceArrows,
    isa: Isa,
    sequence: u32,
    frames: u64,
    flushed: Instant,
}

impl McapSink {
    /// Opens the file and writes everything that does not change.
    pub fn create(path: &Path, header: &Header, view: ViewOptions) -> anyhow::Result<McapSink> {
        let (output, file) = OutputFile::create(path)?;
        let archive = ArchiveFile::new(file, "pitchline", &header.program, ZSTD_LEVEL);
        let mut sink = McapSink {
            output,
            archive: Some(archive.with_context(|| format!("cannot write {}", path.display()))?),
            numbers: OpenChunk::new(Packing::None),
            others: OpenChunk::new(Packing::Zstd),
            header: header.clone(),
            clock: PictureClock::new(view.archive_interval_s),
            transforms: scene::Transforms::new(header),
            forces: scene::ForceArrows::new(header),
            isa: Isa::detect(),
            sequence: 0,
            frames: 0,
            flushed: Instant::now(),
        };
        sink.guarded(McapSink::write_head)?;
        sink.output.show()?;
        Ok(sink)
    }

    fn write_head(&mut self) -> std::io::Result<()> {
        let archive = self.archive.as_mut().ok_or_else(failed_before)?;
        let metadata = BTreeMap::from([
            ("drive".to_string(), self.header.drive_name.clone()),
            ("program".to_string(), self.header.program.clone()),
            ("format_version".to_string(), self.header.format_version.to_string()),
            ("step_s".to_string(), format!("{:e}", self.header.step_s)),
            ("steps_per_frame".to_string(), self.header.steps_per_frame.to_string()),
            ("picture_interval_s".to_string(), format!("{:e}", self.clock.interval_s)),
            ("overrides".to_string(), self.header.overrides.join("\n")),
            ("assembly".to_string(), self.header.assembly.join("\n")),
        ]);
        archive.metadata("pitchline", &metadata)?;
        let name = format!("{}.toml", self.header.drive_name);
        archive.attachment(&name, "application/toml", self.header.drive_text.as_bytes())?;
        for (i, (topic, schema)) in TOPICS.iter().enumerate() {
            let descriptor = scene::schema(schema).unwrap_or(Cow::Borrowed(DESCRIPTOR));
            let channel = archive.channel(&mut self.others, topic, schema, &descriptor);
            assert_eq!(channel, channel_of(i));
        }
        let outlines = scene::outlines(&self.header);
        let header = std::mem::take(&mut self.header);
        self.put(HEADER, 0, &header);
        self.header = header;
        self.put(DRIVE, 0, &outlines);
        self.flush()
    }

    /// Puts a message that is no frame and no keyframe into its chunk.
    fn put(&mut self, topic: usize, t_ns: u64, message: &impl Message) {
        let sequence = self.next_sequence();
        self.others.message(channel_of(topic), sequence, t_ns, |out| message.encode_raw(out));
    }

    fn next_sequence(&mut self) -> u32 {
        let sequence = self.sequence;
        self.sequence = self.sequence.wrapping_add(1);
        sequence
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.flushed = Instant::now();
        let archive = self.archive.as_mut().ok_or_else(failed_before)?;
        archive.write_chunk(&mut self.numbers)?;
        archive.write_chunk(&mut self.others)
    }

    /// Runs `f`. After an error the file is left as it is, so that nothing is written after a gap.
    fn guarded<T>(&mut self, f: impl FnOnce(&mut Self) -> std::io::Result<T>) -> anyhow::Result<T> {
        let result = f(self);
        if result.is_err() {
            self.archive = None;
        }
        result.with_context(|| format!("cannot write {}", self.output.path().display()))
    }

    fn write_frame(&mut self, frame: &Frame) -> std::io::Result<()> {
        let t_ns = nanoseconds(frame.t_s);
        let (sequence, isa) = (self.next_sequence(), self.isa);
        self.numbers.message(channel_of(FRAME), sequence, t_ns, |out| frame.put_bytes(isa, out));
        self.put(SIGNALS, t_ns, &Signals::of(frame, self.header.bodies.len()));
        if self.clock.due(frame.t_s) {
            let sequence = self.next_sequence();
            let (transforms, header) = (&self.transforms, &self.header);
            self.others.message(channel_of(TRANSFORMS), sequence, t_ns, |out| {
                transforms.put_bytes(header, frame, t_ns, out);
            });
            self.put(SCENE, t_ns, &self.forces.of(&self.header, frame, t_ns));
        }
        self.frames += 1;
        if self.frames.is_multiple_of(FRAMES_PER_CHUNK) { self.flush() } else { self.flush_where_due() }
    }

    /// Closes the chunks if they are due: frames may be far apart, and data between them must not wait for the next.
    fn flush_where_due(&mut self) -> std::io::Result<()> {
        let waiting = self.numbers.len().max(self.others.len());
        let due = waiting > LARGEST_CHUNK || self.flushed.elapsed() > LONGEST_WAIT;
        if due { self.flush() } else { Ok(()) }
    }
}

/// Number of a topic's channel.
fn channel_of(topic: usize) -> u16 {
    topic as u16 + 1
}

fn failed_before() -> std::io::Error {
    std::io::Error::other("an earlier write failed")
}

impl Sink for McapSink {
    fn frame(&mut self, frame: &Frame) -> anyhow::Result<()> {
        self.guarded(|sink| sink.write_frame(frame))
    }

    fn keyframe(&mut self, keyframe: &Keyframe) -> anyhow::Result<()> {
        // Behind the frame of its step.
        let (sequence, t_ns) = (self.next_sequence(), nanoseconds(keyframe.step as f64 * self.header.step_s));
        self.numbers.message(channel_of(KEYFRAME), sequence, t_ns, |out| keyframe.encode_raw(out));
        self.guarded(McapSink::flush_where_due)
    }

    fn event(&mut self, event: &Event) -> anyhow::Result<()> {
        // Events are detected at the frame after them, so that log times may decrease within a chunk, which the index
        // allows.
        let t_ns = nanoseconds(event.t_s);
        self.put(EVENT, t_ns, event);
        self.put(LOG, t_ns, &scene::log(event, t_ns));
        self.guarded(McapSink::flush_where_due)
    }

    fn impact(&mut self, impact: &Impact) -> anyhow::Result<()> {
        self.put(IMPACT, nanoseconds(impact.t_s), impact);
        self.guarded(McapSink::flush_where_due)
    }

    fn close(&mut self) -> anyhow::Result<u64> {
        let file = self.guarded(|sink| {
            sink.flush()?;
            let mut archive = sink.archive.take().ok_or_else(failed_before)?;
            archive.finish()?;
            Ok(archive.into_inner())
        })?;
        self.output.sync(&file).with_context(|| format!("cannot write {}", self.output.path().display()))?;
        Ok(file.metadata().map(|m| m.len()).unwrap_or(0))
    }

    fn publish(&mut self) -> anyhow::Result<()> {
        self.output.publish()
    }

    fn path(&self) -> &Path {
        self.output.path()
    }

    fn current_path(&self) -> &Path {
        self.output.current_path()
    }
}

impl Drop for McapSink {
    fn drop(&mut self) {
        // Dropped without `finish`: write what waits, and no table of contents.
        if self.archive.is_some() {
            let _written = self.flush();
        }
    }
}

/// A recording read completely into memory.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    pub header: Header,
    pub frames: Vec<Frame>,
    pub keyframes: Vec<Keyframe>,
    pub events: Vec<Event>,
    pub impacts: Vec<Impact>,
    /// Whether the file ends like a finished recording.
    pub complete: bool,
}

/// Reads a whole recording. For one that was cut off `complete` is false and the frames end with the last whole chunk.
pub fn read(path: &Path) -> anyhow::Result<Recording> {
    let mut reader = Reader::open(path)?;
    let mut recording =
        Recording { header: reader.header().clone(), complete: reader.complete(), ..Recording::default() };
    let wanted = Wanted { frames: true, heads: false, keyframes: true, events: true, impacts: true };
    reader.each(wanted, WHOLE, |entry| {
        match entry {
            Entry::Frame(frame) => recording.frames.push(frame.clone()),
            Entry::Head(_) => {}
            Entry::Keyframe(keyframe) => recording.keyframes.push(*keyframe),
            Entry::Event(event) => recording.events.push(event),
            Entry::Impact(impact) => recording.impacts.push(impact),
        }
        Ok(Flow::On)
    })?;
    Ok(recording)
}
