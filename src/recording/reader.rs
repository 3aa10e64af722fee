//! Reads recordings (MCAP) of any length in bounded memory and any part independently; also files that are cut off,
//! damaged or hostile, without trusting any length that they state.
//!
//! Opening skips from record to record and notes the positions of chunks and their time ranges. A chunk is read,
//! checked against its CRC and unpacked only when its content is requested. An inconsistency is an error that names the
//! byte position. A file that ends early (a run was killed) is not an error: it is read up to its last whole chunk.
//! Data missing from such a file, or from a finished one according to its table of contents or its frame interval, are
//! listed in [`Reader::missing`], to be reported first.

#![warn(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::cast_possible_truncation)]

mod chunks;

use super::columns::{ColumnKind, ColumnValues, Rows};
use super::frame::{Event, FORMAT_VERSION, Frame, Header, Impact, Keyframe, TABLES};
use super::header;
use anyhow::{Context, bail, ensure};
use chunks::Chunk;
use prost::Message;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Maximum number of messages, apart from frames, that are kept in memory at once: a hundred times those of a long run.
/// A packed chunk of a few kilobytes may contain millions.
const MOST_MESSAGES: usize = 4_000_000;
/// Maximum number of frames whose step and time are listed: eight minutes of simulated time at a frame every 50 us.
const MOST_HEADS: usize = 10_000_000;
/// Maximum number of sentences in [`Reader::missing`].
const MOST_SENTENCES: usize = 12;
/// Requested messages. Of others only the topic is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Whole frames.
    pub frames: bool,
    /// Step and time of frames only.
    pub heads: bool,
    /// Keyframes, from which a run can go on.
    pub keyframes: bool,
    /// Events: first contacts, hits of break expressions.
    pub events: bool,
    /// Impacts.
    pub impacts: bool,
}

/// A message of a recording.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry<'a> {
    /// In a buffer that is reused for the next frame.
    Frame(&'a Frame),
    /// First fields of a frame.
    Head(FrameHead),
    /// A keyframe.
    Keyframe(Box<Keyframe>),
    /// An event.
    Event(Event),
    /// An impact.
    Impact(Impact),
}

/// The first fields of a [`Frame`].
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct FrameHead {
    /// Step of the frame.
    #[prost(uint64, tag = "1")]
    pub step: u64,
    /// Its time [s].
    #[prost(double, tag = "2")]
    pub t_s: f64,
    /// XXH3-64 of the State there.
    #[prost(fixed64, tag = "3")]
    pub state_hash: u64,
}

/// Whether to continue reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// Go on with the next message.
    On,
    /// Stop reading: nothing more is wanted.
    Enough,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topic {
    Header,
    Frame,
    Keyframe,
    Event,
    Impact,
    Other,
}

/// The first field of a [`Header`].
#[derive(Clone, Copy, PartialEq, prost::Message)]
struct Version {
    #[prost(uint32, tag = "1")]
    format_version: u32,
}

/// Checks the sequence of frames: steps increase, and none is missing.
#[derive(Clone, Copy, Debug, Default)]
struct Rhythm {
    last: Option<u64>,
    /// Heads of frames, and messages other than frames, delivered so far.
    heads: usize,
    kept: usize,
}

/// Callback with topic, log time and content of a message.
type Each<'a> = dyn FnMut(Topic, u64, &[u8]) -> anyhow::Result<Flow> + 'a;

/// An open recording.
pub struct Reader {
    path: PathBuf,
    file: File,
    header: Header,
    chunks: Vec<Chunk>,
    topics: BTreeMap<u16, Topic>,
    complete: bool,
    /// Bytes at the end that do not form a whole record.
    lost_bytes: u64,
    /// Sentences about missing data, and how many of them were found on opening.
    missing: Vec<String>,
    missing_at_open: usize,
    /// Messages of each channel according to the table of contents.
    counted: BTreeMap<u16, u64>,
    /// Messages met in a pass over the whole file.
    met: BTreeMap<u16, u64>,
    packed: Vec<u8>,
    unpacked: Vec<u8>,
    frame: Frame,
}

impl Rhythm {
    /// Takes the next frame's step; if frames are missing before it, returns the steps that enclose the gap.
    fn gap(&mut self, step: u64, longest: u64) -> anyhow::Result<Option<(u64, u64)>> {
        let last = self.last.replace(step);
        let Some(last) = last else { return Ok(None) };
        ensure!(step > last, "a frame of step {step} behind one of step {last}");
        Ok((longest > 0 && step - last > longest).then_some((last, step)))
    }
}

impl Reader {
    /// Opens a recording (`.mcap`) and reads its header. A file that was cut off is opened as well: see [`Reader::missing`].
    ///
    /// # Errors
    /// The file cannot be read, is no recording, or has another format version.
    pub fn open(path: &Path) -> anyhow::Result<Reader> {
        let shown = path.display();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        let there = std::fs::metadata(path).with_context(|| format!("cannot read {shown}"))?;
        ensure!(!there.is_dir(), "{shown} is a directory, not a recording");
        // A pipe cannot seek, and may never deliver data.
        ensure!(there.is_file(), "{shown} is a pipe or a device, not a recording: write it to a file first");
        let mut file = crate::input::open(path).with_context(|| format!("cannot read {shown}"))?;
        let mut magic = [0; mcap::MAGIC.len()];
        let begins = file.read_exact(&mut magic).is_ok() && magic == mcap::MAGIC;
        ensure!(
            begins || extension != "rrd",
            "{shown} is a view for the Rerun viewer; give the .mcap that was written beside it"
        );
        ensure!(begins, "{shown} is no MCAP file: it does not begin as one");
        let mut reader = Reader {
            path: path.to_path_buf(),
            file,
            header: Header::default(),
            chunks: Vec::new(),
            topics: BTreeMap::new(),
            complete: false,
            lost_bytes: 0,
            missing: Vec::new(),
            missing_at_open: 0,
            counted: BTreeMap::new(),
            met: BTreeMap::new(),
            packed: Vec::new(),
            unpacked: Vec::new(),
            frame: Frame::default(),
        };
        reader.find_chunks().with_context(|| format!("{shown} is damaged"))?;
        reader.read_header()?;
        if let Some(loss) = reader.loss() {
            reader.miss(loss);
        }
        // In a finished file the table of contents is more reliable.
        if !reader.complete || reader.counted.is_empty() {
            reader.look_for_gaps();
        }
        reader.missing_at_open = reader.missing.len();
        Ok(reader)
    }

    /// Path as it was given to [`Reader::open`].
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The header: names, dimensions and columns that frames refer to.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// False: the file ends early and is whole up to its last chunk.
    pub fn complete(&self) -> bool {
        self.complete
    }

    /// One sentence about the missing end; None for a finished recording.
    pub fn loss(&self) -> Option<String> {
        let until = self.chunks.last().map_or(0, |c| c.end_ns);
        (!self.complete).then(|| {
            format!(
                "{} was not finished: it is whole up to {:.3} ms, {} bytes of an unfinished chunk behind that are lost",
                self.path.display(),
                until as f64 * 1e-6,
                self.lost_bytes
            )
        })
    }

    /// Sentences about data that the recording lacks, as far as it has been read.
    pub fn missing(&self) -> &[String] {
        &self.missing
    }

    /// Those that were found by reading after it was opened.
    pub fn missing_since_open(&self) -> &[String] {
        self.missing.get(self.missing_at_open..).unwrap_or_default()
    }

    fn miss(&mut self, what: String) {
        if self.missing.len() < MOST_SENTENCES && !self.missing.contains(&what) {
            self.missing.push(what);
        }
    }

    /// Nominal time between two frames [ns]; None if the header does not state it.
    fn frame_interval_ns(&self) -> Option<f64> {
        let interval = self.header.steps_per_frame as f64 * self.header.step_s * 1e9;
        (interval > 0.0).then_some(interval)
    }

    /// Checks that chunks follow each other without a gap longer than the frame interval. The first contains the
    /// header.
    fn look_for_gaps(&mut self) {
        let Some(interval_ns) = self.frame_interval_ns() else { return };
        let mut until_ns = 0;
        let shown = self.path.display().to_string();
        for Chunk { start_ns, end_ns, .. } in self.chunks.clone() {
            // Half a frame of tolerance, because times are whole nanoseconds.
            if until_ns > 0 && start_ns.saturating_sub(until_ns) as f64 > 1.5 * interval_ns {
                let (from, to) = (until_ns as f64 * 1e-6, start_ns as f64 * 1e-6);
                self.miss(format!("{shown}: nothing between {from:.4} and {to:.4} ms"));
            }
            until_ns = until_ns.max(end_ns);
        }
    }

    fn read_header(&mut self) -> anyhow::Result<()> {
        let shown = self.path.display().to_string();
        for index in 0..self.chunks.len().min(4) {
            self.unpack(index)?;
            let unpacked = std::mem::take(&mut self.unpacked);
            let mut found = None;
            self.records(index, &unpacked, &mut |topic, _, data| {
                if topic == Topic::Header {
                    // Other versions may have another format, or another meaning of the same names.
                    let version = Version::decode(data).context("its header cannot be read")?.format_version;
                    found = Some(if version != FORMAT_VERSION { Err(version) } else { Ok(header::decode(data)?) });
                    return Ok(Flow::Enough);
                }
                Ok(Flow::On)
            })?;
            self.unpacked = unpacked;
            match found {
                Some(Ok(header)) => {
                    self.header = header;
                    return Ok(());
                }
                Some(Err(version)) => {
                    let newer = version > FORMAT_VERSION;
                    let help = if newer { "use a newer one" } else { "run its drive again, or use an older one" };
                    bail!("{shown}: recorded in format {version}; this program reads format {FORMAT_VERSION}: {help}")
                }
                None => {}
            }
        }
        let reason = if self.complete { "it is an MCAP file of another program" } else { "it ends before its header" };
        bail!("{shown} holds no pitchline recording: {reason}")
    }

    /// As [`Reader::each`] over the whole file, but skips chunks that cannot be read: these are passed to `damaged`
    /// with their time range [s].
    pub fn each_sound(
        &mut self,
        wanted: Wanted,
        mut each: impl FnMut(Entry<'_>) -> anyhow::Result<Flow>,
        mut damaged: impl FnMut(anyhow::Error, (f64, f64)),
    ) -> anyhow::Result<()> {
        let mut rhythm = Rhythm::default();
        for index in 0..self.chunks.len() {
            let chunk = self.chunk(index)?;
            let span_s = (chunk.start_ns as f64 * 1e-9, chunk.end_ns as f64 * 1e-9);
            match self.each_of(index, wanted, (0, u64::MAX), &mut rhythm, &mut each) {
                Ok(Flow::On) => {}
                Ok(Flow::Enough) => break,
                Err(e) => {
                    // Its frames have already been reported as lost.
                    rhythm.last = None;
                    damaged(e, span_s);
                }
            }
        }
        Ok(())
    }

    /// Calls `each` with the requested messages between two times, ends included, in file order.
    pub fn each(
        &mut self,
        wanted: Wanted,
        (from_s, to_s): (f64, f64),
        mut each: impl FnMut(Entry<'_>) -> anyhow::Result<Flow>,
    ) -> anyhow::Result<()> {
        let (from_ns, to_ns) = (nanoseconds(from_s), nanoseconds(to_s));
        let mut rhythm = Rhythm::default();
        let mut whole = true;
        self.met.clear();
        for index in 0..self.chunks.len() {
            let chunk = self.chunk(index)?;
            // The first contains the channels; an unwritten time range matches any time.
            let outside = chunk.end_ns < from_ns || chunk.start_ns > to_ns;
            if outside && chunk.end_ns != 0 {
                whole = false;
                continue;
            }
            if self.each_of(index, wanted, (from_ns, to_ns), &mut rhythm, &mut each)? == Flow::Enough {
                return Ok(());
            }
        }
        if whole {
            self.check_counts();
        }
        Ok(())
    }

    /// Compares the messages of a complete pass with the counts in the table of contents.
    fn check_counts(&mut self) {
        let shown = self.path.display().to_string();
        for (channel, stated) in self.counted.clone() {
            let met = self.met.get(&channel).copied().unwrap_or(0);
            if met != stated {
                self.miss(format!("{shown}: it states {stated} messages of channel {channel} and contains {met}"));
            }
        }
    }

    fn each_of(
        &mut self,
        index: usize,
        wanted: Wanted,
        (from_ns, to_ns): (u64, u64),
        rhythm: &mut Rhythm,
        each: &mut dyn FnMut(Entry<'_>) -> anyhow::Result<Flow>,
    ) -> anyhow::Result<Flow> {
        self.unpack(index)?;
        let mut gaps = Vec::new();
        let (longest, step_s) = (self.header.steps_per_frame, self.header.step_s);
        let unpacked = std::mem::take(&mut self.unpacked);
        let mut frame = std::mem::take(&mut self.frame);
        let stated = StatedLengths::of(&self.header);
        let flow = self.records(index, &unpacked, &mut |topic, t_ns, data| {
            if t_ns < from_ns || t_ns > to_ns {
                return Ok(Flow::On);
            }
            let entry = match topic {
                Topic::Frame if wanted.frames => {
                    frame.clear();
                    frame.merge(data)?;
                    frame.derive();
                    check(&frame, &stated)?;
                    check_time(frame.step, frame.t_s, (step_s, t_ns))?;
                    gaps.extend(rhythm.gap(frame.step, longest)?);
                    Entry::Frame(&frame)
                }
                Topic::Frame if wanted.heads => {
                    let head = FrameHead::decode(data)?;
                    check_time(head.step, head.t_s, (step_s, t_ns))?;
                    gaps.extend(rhythm.gap(head.step, longest)?);
                    Entry::Head(head)
                }
                Topic::Keyframe if wanted.keyframes => Entry::Keyframe(Box::new(Keyframe::decode(data)?)),
                Topic::Event if wanted.events => Entry::Event(Event::decode(data)?),
                Topic::Impact if wanted.impacts => {
                    let impact = Impact::decode(data)?;
                    let inside = (impact.link as usize) < stated.links && (impact.body as usize) < stated.bodies;
                    ensure!(inside, "an impact of a link or body that there is not");
                    Entry::Impact(impact)
                }
                Topic::Header | Topic::Frame | Topic::Keyframe | Topic::Event | Topic::Impact | Topic::Other => {
                    return Ok(Flow::On);
                }
            };
            match entry {
                Entry::Frame(_) => {}
                Entry::Head(_) => {
                    rhythm.heads += 1;
                    ensure!(rhythm.heads <= MOST_HEADS, "more than {MOST_HEADS} frames");
                }
                Entry::Keyframe(_) | Entry::Event(_) | Entry::Impact(_) => {
                    rhythm.kept += 1;
                    ensure!(rhythm.kept <= MOST_MESSAGES, "more than {MOST_MESSAGES} messages");
                }
            }
            each(entry)
        });
        (self.unpacked, self.frame) = (unpacked, frame);
        for (from, to) in gaps {
            let ms = |step: u64| step as f64 * self.header.step_s * 1e3;
            let n = (to - from - 1) / longest;
            let (shown, from_ms, to_ms) = (self.path.display(), ms(from), ms(to));
            self.miss(format!("{shown}: {n} frames are missing between {from_ms:.4} and {to_ms:.4} ms"));
        }
        flow
    }

    /// The last keyframe at or before `t_s`.
    pub fn keyframe_before(&mut self, t_s: f64) -> anyhow::Result<Option<Keyframe>> {
        let until = nanoseconds(t_s);
        let wanted = Wanted { keyframes: true, ..Wanted::default() };
        for index in (0..self.chunks.len()).rev() {
            if self.chunk(index)?.start_ns > until && index > 0 {
                continue;
            }
            let mut last: Option<Keyframe> = None;
            self.each_of(index, wanted, (0, until), &mut Rhythm::default(), &mut |entry| {
                if let Entry::Keyframe(keyframe) = entry {
                    last = Some(*keyframe);
                }
                Ok(Flow::On)
            })?;
            if last.is_some() {
                return Ok(last);
            }
        }
        Ok(None)
    }

    /// The first keyframe.
    pub fn first_keyframe(&mut self) -> anyhow::Result<Option<Keyframe>> {
        let mut first = None;
        self.each(Wanted { keyframes: true, ..Wanted::default() }, WHOLE, |entry| {
            if let Entry::Keyframe(keyframe) = entry {
                first = Some(*keyframe);
            }
            Ok(Flow::Enough)
        })?;
        Ok(first)
    }

    /// Step and time of the first and the last frame, read only from the chunks at both ends.
    pub fn ends(&mut self) -> anyhow::Result<Option<(FrameHead, FrameHead)>> {
        let wanted = Wanted { heads: true, ..Wanted::default() };
        let mut found: [Option<FrameHead>; 2] = [None, None];
        let n = self.chunks.len();
        for (end, last) in found.iter_mut().zip([false, true]) {
            let mut order: Vec<usize> = (0..n).collect();
            if last {
                order.reverse();
            }
            for index in order {
                self.each_of(index, wanted, (0, u64::MAX), &mut Rhythm::default(), &mut |entry| {
                    if let Entry::Head(head) = entry {
                        *end = Some(if last { head } else { end.unwrap_or(head) });
                    }
                    Ok(Flow::On)
                })?;
                if end.is_some() {
                    break;
                }
            }
        }
        let [first, last] = found;
        Ok(first.zip(last))
    }

    /// Step and time of every frame, in order.
    pub fn heads(&mut self) -> anyhow::Result<Vec<FrameHead>> {
        let mut heads = Vec::new();
        self.each(Wanted { heads: true, ..Wanted::default() }, WHOLE, |entry| {
            if let Entry::Head(head) = entry {
                heads.push(head);
            }
            Ok(Flow::On)
        })?;
        Ok(heads)
    }

    /// The frame at exactly this time.
    pub fn frame_at(&mut self, t_s: f64) -> anyhow::Result<Option<Frame>> {
        let mut found = None;
        self.each(Wanted { frames: true, ..Wanted::default() }, (t_s, t_s), |entry| {
            if let Entry::Frame(frame) = entry {
                found = Some(frame.clone());
            }
            Ok(Flow::Enough)
        })?;
        Ok(found)
    }
}

/// All times.
pub const WHOLE: (f64, f64) = (0.0, f64::INFINITY);

/// Simulated time as a log time, for writing and for searching.
#[expect(clippy::cast_possible_truncation, reason = "floats become the nearest number that there is")]
pub fn nanoseconds(t_s: f64) -> u64 {
    // Saturates: infinity becomes the largest time.
    (t_s * 1e9).round() as u64
}

fn topic(name: &str) -> Topic {
    match name {
        "/pitchline/header" => Topic::Header,
        "/pitchline/frame" => Topic::Frame,
        "/pitchline/keyframe" => Topic::Keyframe,
        "/pitchline/event" => Topic::Event,
        "/pitchline/impact" => Topic::Impact,
        _ => Topic::Other,
    }
}

/// What a header says of the lengths of tables.
struct StatedLengths {
    links: usize,
    bodies: usize,
    sensors: usize,
    /// Rows that the tables of a frame may have, in their order.
    most: Vec<usize>,
}

impl StatedLengths {
    fn of(header: &Header) -> StatedLengths {
        let links = header.links.len();
        let most = |rows: Rows| match rows {
            Rows::Link | Rows::Joint => links,
            Rows::Roller => header.rollers.len(),
            Rows::Contact => usize::MAX,
            Rows::Rotor | Rows::Slider | Rows::Touch | Rows::Chamber | Rows::Passage | Rows::Span => {
                header.row_paths(rows).map_or(0, <[String]>::len)
            }
        };
        let most = TABLES.iter().map(|table| most(table.rows)).collect();
        StatedLengths { links, bodies: header.bodies.len(), sensors: header.sensors.len(), most }
    }
}

/// Checks that columns of one table have equal lengths, those of the header where it states them, and that indices
/// point into the header; readers rely on it.
fn check(frame: &Frame, stated: &StatedLengths) -> anyhow::Result<()> {
    let StatedLengths { links: n_links, bodies: n_bodies, sensors: n_sensors, ref most } = *stated;
    let mut limits = most.iter().copied();
    let frame_links = frame.links.x_m.len();
    ensure!(frame_links == n_links, "a frame of {frame_links} links in a recording of {n_links}");
    ensure!(frame.sensors.len() <= n_sensors, "more readings than sensors");
    let mut checked = Ok(());
    frame.each_table(|table, columns| {
        let name = table.message.name;
        let first = columns.first().map_or(0, ColumnValues::len);
        let most = limits.next().unwrap_or(0);
        let n = if matches!(table.rows, Rows::Link | Rows::Joint) { n_links } else { first };
        let check = || {
            ensure!(n <= most, "more {name} than the header states");
            for (column, values) in table.message.columns.iter().zip(columns) {
                let (given, column_name) = (values.len(), column.name);
                ensure!(
                    given == n,
                    "columns of {name} have different lengths: {column_name} has {given} values of {n}"
                );
                let most = match column.kind {
                    ColumnKind::Link => n_links,
                    ColumnKind::Body => n_bodies,
                    ColumnKind::Value | ColumnKind::Height | ColumnKind::Feature | ColumnKind::Segment => usize::MAX,
                    ColumnKind::Kinetic
                    | ColumnKind::Elastic
                    | ColumnKind::WorkIn
                    | ColumnKind::WorkOut
                    | ColumnKind::Lost
                    | ColumnKind::Error => usize::MAX,
                };
                let inside = values.are_below(most);
                ensure!(inside, "a contact of a link or body that there is not");
            }
            Ok(())
        };
        if checked.is_ok() {
            checked = check();
        }
    });
    checked
}

/// Checks that a frame's step, time and log time agree: t = step x h.
fn check_time(step: u64, t_s: f64, (step_s, t_ns): (f64, u64)) -> anyhow::Result<()> {
    let stated_s = step as f64 * step_s;
    // The step number of a run that was continued with another step size is rounded.
    let fits = (t_s - stated_s).abs() <= 1e-9 * stated_s.max(1.0) && nanoseconds(t_s).abs_diff(t_ns) <= 1;
    ensure!(fits, "a frame of step {step} states {t_s} s and has log time {t_ns} ns, but its step is at {stated_s} s");
    Ok(())
}

/// Iterates over the frames of a recording, with one chunk in memory at a time.
pub struct Cursor<'a> {
    reader: &'a mut Reader,
    chunk: usize,
    rhythm: Rhythm,
    frames: std::collections::VecDeque<Frame>,
}

impl<'a> Cursor<'a> {
    /// Begins at the first frame.
    pub fn new(reader: &'a mut Reader) -> Cursor<'a> {
        Cursor { reader, chunk: 0, rhythm: Rhythm::default(), frames: std::collections::VecDeque::new() }
    }

    /// Restarts from the beginning.
    pub fn rewound(self) -> Cursor<'a> {
        Cursor::new(self.reader)
    }

    /// The next frame; None: there are no more.
    ///
    /// # Errors
    /// The file cannot be read, or a chunk of it is damaged.
    pub fn next_frame(&mut self) -> anyhow::Result<Option<Frame>> {
        while self.frames.is_empty() && self.chunk < self.reader.chunks.len() {
            let frames = &mut self.frames;
            let wanted = Wanted { frames: true, ..Wanted::default() };
            self.reader.each_of(self.chunk, wanted, (0, u64::MAX), &mut self.rhythm, &mut |entry| {
                if let Entry::Frame(frame) = entry {
                    frames.push_back(frame.clone());
                }
                Ok(Flow::On)
            })?;
            self.chunk += 1;
        }
        Ok(self.frames.pop_front())
    }
}
