//! MCAP: the archive. Lossless f64, zstd, chunk-indexed; own protobuf topics, and in addition Foxglove's, so that
//! Foxglove draws a recording without further setup.
//!
//! ```text
//! /pitchline/header    Header, once          /tf        foxglove.FrameTransforms at the picture rate
//! /pitchline/frame     Frame, every frame    /scene     foxglove.SceneUpdate: outlines once, force arrows at the picture rate
//! /pitchline/signals   Signals, every frame  /events    foxglove.Log
//! /pitchline/keyframe  Keyframe              /pitchline/event  Event
//! /pitchline/impact    Impact, two tooth periods after its first contact
//! ```
//! Chunks are closed every [`FRAMES_PER_CHUNK`] frames and written whole. A killed run thus leaves a file that is
//! complete up to the last chunk, and bytes do not depend on timing: two runs of one drive give the same file. Only if
//! a run is so slow that frames would wait longer than [`LONGEST_WAIT`] are chunks closed earlier; the content is then
//! the same, but not its division into chunks.

use super::foxglove_scene as scene;
use super::frame::{Event, Frame, Header, Impact, Keyframe, Signals};
pub use super::reader::nanoseconds;
use super::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use super::{PictureClock, Sink, ViewOptions};
use crate::output::OutputFile;
use anyhow::Context;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use prost::Message;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::{Duration, Instant};

/// Compiled `assets/pitchline.proto` (a FileDescriptorSet); a test keeps the two consistent.
pub const DESCRIPTOR: &[u8] = include_bytes!("../../assets/pitchline.desc");

/// Frames after which a chunk is closed and passed to the system: less than zstd's window of half a megabyte, within
/// which it compresses from one buffer.
pub const FRAMES_PER_CHUNK: u64 = 32;

/// Bytes after which a chunk is closed regardless of its frames, because readers limit the unpacked size.
const LARGEST_CHUNK: usize = 16 << 20;

/// Longest time for which frames may wait in an open chunk: a slow run that is killed loses no more than this.
const LONGEST_WAIT: Duration = Duration::from_millis(100);

/// zstd level. Negative levels skip the entropy coding of literals, which gains nothing for mantissas of forces and
/// positions; the lower the level, the sooner data without repetition are skipped. A recorded run takes some 5 % less
/// with -32 than with -8, for 5 % more bytes. The writer takes the level unsigned and passes its bits on as a signed
/// number.
const FAST_LEVEL: i32 = -32;

/// Topics in the order in which they are registered.
pub const TOPICS: [(&str, &str); 9] = [
    ("/pitchline/header", "pitchline.Header"),
    ("/pitchline/frame", "pitchline.Frame"),
    ("/pitchline/signals", "pitchline.Signals"),
    ("/pitchline/keyframe", "pitchline.Keyframe"),
    ("/pitchline/event", "pitchline.Event"),
    ("/tf", "foxglove.FrameTransforms"),
    ("/scene", "foxglove.SceneUpdate"),
    ("/events", "foxglove.Log"),
    ("/pitchline/impact", "pitchline.Impact"),
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

/// Writes an MCAP file.
pub struct McapSink {
    output: OutputFile,
    /// None after an error: nothing more is written; what was written remains.
    writer: Option<mcap::Writer<NoSeek<BufWriter<File>>>>,
    channels: [u16; TOPICS.len()],
    header: Header,
    clock: PictureClock,
    transforms: scene::Transforms,
    buffer: Vec<u8>,
    sequence: u32,
    /// Bytes in the open chunk.
    waiting: usize,
    frames: u64,
    last_ns: u64,
    flushed: Instant,
}

impl McapSink {
    /// Opens the file and writes everything that does not change.
    pub fn create(path: &Path, header: &Header, view: ViewOptions) -> anyhow::Result<McapSink> {
        let (output, file) = OutputFile::create(path)?;
        let options = mcap::WriteOptions::new()
            .profile("pitchline")
            .library(header.program.clone())
            .compression(Some(mcap::Compression::Zstd))
            .compression_level(FAST_LEVEL.cast_unsigned())
            .compression_threads(0)
            .chunk_size(None)
            // Chunks and attachments have their own CRCs; the metadata besides them repeat the header.
            .calculate_data_section_crc(false)
            // A pipe cannot seek.
            .disable_seeking(true);
        let writer = mcap::Writer::with_options(NoSeek::new(BufWriter::new(file)), options);
        let mut sink = McapSink {
            output,
            writer: Some(writer.with_context(|| format!("cannot write {}", path.display()))?),
            channels: [0; TOPICS.len()],
            header: header.clone(),
            clock: PictureClock::new(view),
            transforms: scene::Transforms::new(header),
            buffer: Vec::new(),
            sequence: 0,
            waiting: 0,
            frames: 0,
            last_ns: 0,
            flushed: Instant::now(),
        };
        sink.guarded(|sink| sink.write_head())?;
        sink.output.show()?;
        Ok(sink)
    }

    fn write_head(&mut self) -> mcap::McapResult<()> {
        let Some(writer) = &mut self.writer else { return Err(mcap::McapError::AttemptedWriteAfterFailure) };
        let metadata = BTreeMap::from([
            ("drive".to_string(), self.header.drive_name.clone()),
            ("program".to_string(), self.header.program.clone()),
            ("format_version".to_string(), self.header.format_version.to_string()),
            ("step_s".to_string(), format!("{:e}", self.header.step_s)),
            ("steps_per_frame".to_string(), self.header.steps_per_frame.to_string()),
            ("overrides".to_string(), self.header.overrides.join("\n")),
            ("assembly".to_string(), self.header.assembly.join("\n")),
        ]);
        writer.write_metadata(&Metadata { name: "pitchline".into(), metadata })?;
        writer.attach(&mcap::Attachment {
            log_time: 0,
            create_time: 0,
            name: format!("{}.toml", self.header.drive_name),
            media_type: "application/toml".into(),
            data: Cow::Borrowed(self.header.drive_text.as_bytes()),
        })?;
        for (i, (topic, schema)) in TOPICS.iter().enumerate() {
            let data = scene::schema(schema).unwrap_or(Cow::Borrowed(DESCRIPTOR));
            let schema_id = writer.add_schema(schema, "protobuf", &data)?;
            self.channels[i] = writer.add_channel(schema_id, topic, "protobuf", &BTreeMap::new())?;
        }
        let header = self.header.clone();
        self.write(HEADER, 0, &header)?;
        let outlines = scene::outlines(&self.header);
        self.write(SCENE, 0, &outlines)?;
        self.flush()
    }

    fn write(&mut self, channel: usize, t_ns: u64, message: &impl Message) -> mcap::McapResult<()> {
        self.encode(|_, buffer| message.encode_raw(buffer));
        self.write_buffer(channel, t_ns)
    }

    /// Fills the buffer, which is taken out of `self` meanwhile.
    fn encode(&mut self, put_bytes: impl FnOnce(&Self, &mut Vec<u8>)) {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        put_bytes(self, &mut buffer);
        self.buffer = buffer;
    }

    fn write_buffer(&mut self, channel: usize, t_ns: u64) -> mcap::McapResult<()> {
        self.waiting += self.buffer.len();
        let Some(writer) = &mut self.writer else { return Err(mcap::McapError::AttemptedWriteAfterFailure) };
        let header = MessageHeader {
            channel_id: self.channels[channel],
            sequence: self.sequence,
            log_time: t_ns,
            publish_time: t_ns,
        };
        self.sequence = self.sequence.wrapping_add(1);
        self.last_ns = t_ns;
        writer.write_to_known_channel(&header, &self.buffer)
    }

    fn flush(&mut self) -> mcap::McapResult<()> {
        (self.flushed, self.waiting) = (Instant::now(), 0);
        match &mut self.writer {
            Some(writer) => writer.flush(),
            None => Err(mcap::McapError::AttemptedWriteAfterFailure),
        }
    }

    /// Runs `f`. After an error the writer is removed, so that nothing is written after a gap.
    fn guarded(&mut self, f: impl FnOnce(&mut Self) -> mcap::McapResult<()>) -> anyhow::Result<()> {
        let result = f(self);
        if result.is_err()
            && let Some(writer) = self.writer.take()
        {
            // Dropping the writer would write an index over missing data; dropping the buffer would write the rest,
            // which cannot be written either.
            let (_file, _unwritten) = writer.into_inner().into_inner().into_parts();
        }
        result.with_context(|| format!("cannot write {}", self.output.path().display()))
    }

    fn write_frame(&mut self, frame: &Frame) -> mcap::McapResult<()> {
        let t_ns = nanoseconds(frame.t_s);
        self.encode(|_, buffer| frame.put_bytes(buffer));
        self.write_buffer(FRAME, t_ns)?;
        self.write(SIGNALS, t_ns, &Signals::of(frame, self.header.bodies.len()))?;
        if self.clock.due(frame.t_s) {
            self.encode(|sink, buffer| sink.transforms.put_bytes(&sink.header, frame, t_ns, buffer));
            self.write_buffer(TRANSFORMS, t_ns)?;
            self.write(SCENE, t_ns, &scene::forces(&self.header, frame, t_ns))?;
        }
        self.frames += 1;
        if self.frames.is_multiple_of(FRAMES_PER_CHUNK) { self.flush() } else { self.flush_where_due() }
    }

    /// Closes the chunk if it is due: frames may be far apart, and data between them must not wait for the next.
    fn flush_where_due(&mut self) -> mcap::McapResult<()> {
        let due = self.waiting > LARGEST_CHUNK || self.flushed.elapsed() > LONGEST_WAIT;
        if due { self.flush() } else { Ok(()) }
    }
}

impl Sink for McapSink {
    fn frame(&mut self, frame: &Frame) -> anyhow::Result<()> {
        self.guarded(|sink| sink.write_frame(frame))
    }

    fn keyframe(&mut self, keyframe: &Keyframe) -> anyhow::Result<()> {
        let t_ns = nanoseconds(keyframe.step as f64 * self.header.step_s);
        self.guarded(|sink| sink.write(KEYFRAME, t_ns, keyframe))
    }

    fn event(&mut self, event: &Event) -> anyhow::Result<()> {
        // Events are detected at the frame after them, so that log times may decrease within a chunk, which the index
        // allows.
        let t_ns = nanoseconds(event.t_s);
        self.guarded(|sink| {
            sink.write(EVENT, t_ns, event)?;
            sink.write(LOG, t_ns, &scene::log(event, t_ns))?;
            sink.flush_where_due()
        })
    }

    fn impact(&mut self, impact: &Impact) -> anyhow::Result<()> {
        self.guarded(|sink| {
            sink.write(IMPACT, nanoseconds(impact.t_s), impact)?;
            sink.flush_where_due()
        })
    }

    fn close(&mut self) -> anyhow::Result<u64> {
        self.guarded(|sink| match &mut sink.writer {
            Some(writer) => writer.finish().map(|_| ()),
            None => Err(mcap::McapError::AttemptedWriteAfterFailure),
        })?;
        let cannot = || format!("cannot write {}", self.output.path().display());
        let writer = self.writer.take().with_context(cannot)?;
        let file = writer.into_inner().into_inner().into_inner().with_context(cannot)?;
        self.output.sync(&file).with_context(cannot)?;
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
        // Dropped without `finish`: close the open chunk, write no index.
        if let Some(mut writer) = self.writer.take() {
            let _closed = writer.flush();
            let (_file, _unwritten) = writer.into_inner().into_inner().into_parts();
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
