//! Reads recordings (MCAP): any length in bounded memory, any part without the rest, and files that are cut off, damaged or
//! hostile without trust in any length they state.
//!
//! Opening hops from record to record and notes where chunks lie and which time they cover; a chunk is read, checked against
//! its CRC and unpacked only when something in it is asked for. What does not hold together is an error that names the byte
//! where it stands. A file that simply ends (a run was killed) is no error: it is read up to its last whole chunk, and says so.

use super::frame::{Event, FORMAT_VERSION, Frame, Header, Impact, Keyframe};
use anyhow::{Context, bail, ensure};
use mcap::records::op;
use prost::Message;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Longest record that is read, packed or unpacked [bytes]: ours stay below 5 MB.
const LONGEST_RECORD: u64 = 64 << 20;
/// Longest message [bytes]: frames and States of the longest chain stay below 2 MB. Small ones may unpack to many times their
/// size, so this bounds memory too.
const LONGEST_MESSAGE: usize = 8 << 20;
/// Most chunks of one file that are kept in mind.
const MOST_CHUNKS: usize = 1 << 22;
/// Bytes before a record's content: operation code and length.
const RECORD_HEAD: u64 = 9;
/// Shortest head of a chunk: start, end, size, CRC, empty name of the compression, packed size.
const CHUNK_HEAD: u64 = 8 + 8 + 8 + 4 + 4 + 8;
/// Longest name of a compression that is believed.
const LONGEST_NAME: u32 = 32;

/// Which messages are asked for. The others are not unpacked further than to their topic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    pub frames: bool,
    /// Step and time of frames only.
    pub heads: bool,
    pub keyframes: bool,
    pub events: bool,
    pub impacts: bool,
}

/// A message of a recording.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry<'a> {
    /// In a buffer that the next frame is read into.
    Frame(&'a Frame),
    Head(FrameHead),
    Keyframe(Box<Keyframe>),
    Event(Event),
    Impact(Impact),
}

/// The first fields of a [`Frame`].
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct FrameHead {
    #[prost(uint64, tag = "1")]
    pub step: u64,
    #[prost(double, tag = "2")]
    pub t_s: f64,
    #[prost(fixed64, tag = "3")]
    pub state_hash: u64,
}

/// Whether to go on reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    On,
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

/// A chunk: where its packed bytes lie and what they hold.
#[derive(Clone, Debug, PartialEq)]
struct Chunk {
    /// Of the record, for messages to people.
    offset: u64,
    data_offset: u64,
    packed: u64,
    unpacked: u64,
    crc: u32,
    compression: Compression,
    start_ns: u64,
    end_ns: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Compression {
    None,
    Zstd,
}

/// Is told topic, log time and content of a message.
type Each<'a> = dyn FnMut(Topic, u64, &[u8]) -> anyhow::Result<Flow> + 'a;

/// An open recording.
pub struct Reader {
    path: PathBuf,
    file: File,
    header: Header,
    chunks: Vec<Chunk>,
    topics: BTreeMap<u16, Topic>,
    complete: bool,
    /// Bytes at the end that hold no whole record.
    lost_bytes: u64,
    packed: Vec<u8>,
    unpacked: Vec<u8>,
    frame: Frame,
}

impl Reader {
    /// Opens a recording and reads its header.
    pub fn open(path: &Path) -> anyhow::Result<Reader> {
        let shown = path.display();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        ensure!(!path.is_dir(), "{shown} is a directory, not a recording");
        let mut file = File::open(path).with_context(|| format!("cannot read {shown}"))?;
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
            packed: Vec::new(),
            unpacked: Vec::new(),
            frame: Frame::default(),
        };
        reader.find_chunks().with_context(|| format!("{shown} is damaged"))?;
        reader.read_header()?;
        Ok(reader)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn header(&self) -> &Header {
        &self.header
    }

    /// False: the file ends before a recording does; it is whole up to its last chunk.
    pub fn complete(&self) -> bool {
        self.complete
    }

    /// What is missing at the end, in one sentence; None for a finished recording.
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

    /// Notes where chunks lie. Nothing is unpacked.
    fn find_chunks(&mut self) -> anyhow::Result<()> {
        let length = self.file.metadata()?.len();
        let mut at = mcap::MAGIC.len() as u64;
        loop {
            if length.saturating_sub(at) < RECORD_HEAD {
                break;
            }
            self.file.seek(SeekFrom::Start(at))?;
            let mut head = [0; RECORD_HEAD as usize];
            self.file.read_exact(&mut head)?;
            let content = u64_at(&head, 1);
            let Some(end) = content.checked_add(at + RECORD_HEAD).filter(|end| *end <= length) else { break };
            match head[0] {
                op::CHUNK => {
                    ensure!(self.chunks.len() < MOST_CHUNKS, "more than {MOST_CHUNKS} chunks at byte {at}");
                    let chunk = self.chunk_at(at, content).with_context(|| format!("chunk at byte {at}"))?;
                    self.chunks.push(chunk);
                }
                op::FOOTER => {
                    let mut magic = [0; mcap::MAGIC.len()];
                    self.file.seek(SeekFrom::Start(end))?;
                    self.complete = self.file.read_exact(&mut magic).is_ok() && magic == mcap::MAGIC;
                    at = end + mcap::MAGIC.len() as u64;
                    break;
                }
                0 => bail!("record of kind 0 at byte {at}"),
                _ => {}
            }
            at = end;
        }
        self.lost_bytes = length.saturating_sub(at);
        Ok(())
    }

    /// The head of a chunk whose record begins at `at` and has `content` bytes.
    fn chunk_at(&mut self, at: u64, content: u64) -> anyhow::Result<Chunk> {
        ensure!(content >= CHUNK_HEAD, "too short for a chunk: {content} bytes");
        let room = content.min(CHUNK_HEAD + u64::from(LONGEST_NAME)) as usize;
        let mut head = vec![0; room];
        self.file.read_exact(&mut head)?;
        let name_length = u32_at(&head, 28);
        ensure!(name_length <= LONGEST_NAME && 40 + name_length as usize <= room, "no such compression");
        let name = &head[32..32 + name_length as usize];
        let compression = match name {
            b"" => Compression::None,
            b"zstd" => Compression::Zstd,
            _ => bail!(
                "packed with `{}`; pitchline reads zstd: convert it with `mcap compress --compression zstd`",
                String::from_utf8_lossy(name)
            ),
        };
        let packed = u64_at(&head, 32 + name_length as usize);
        let unpacked = u64_at(&head, 16);
        let head_length = CHUNK_HEAD + u64::from(name_length);
        ensure!(packed <= content - head_length, "{packed} packed bytes do not fit into a record of {content}");
        ensure!(packed.max(unpacked) <= LONGEST_RECORD, "{unpacked} bytes are more than any chunk of ours has");
        Ok(Chunk {
            offset: at,
            data_offset: at + RECORD_HEAD + head_length,
            packed,
            unpacked,
            crc: u32_at(&head, 24),
            compression,
            start_ns: u64_at(&head, 0),
            end_ns: u64_at(&head, 8),
        })
    }

    /// Reads and unpacks chunk `index` into `self.unpacked`.
    fn unpack(&mut self, index: usize) -> anyhow::Result<()> {
        let chunk = self.chunks[index].clone();
        let damaged = || format!("{} is damaged in the chunk at byte {}", self.path.display(), chunk.offset);
        self.packed.resize(chunk.packed as usize, 0);
        self.file.seek(SeekFrom::Start(chunk.data_offset)).with_context(damaged)?;
        self.file.read_exact(&mut self.packed).with_context(damaged)?;
        match chunk.compression {
            Compression::None => std::mem::swap(&mut self.packed, &mut self.unpacked),
            Compression::Zstd => {
                self.unpacked.clear();
                self.unpacked.reserve(chunk.unpacked as usize);
                // Never more than stated: the room of the target is the limit.
                let limit = self.unpacked.capacity().min(chunk.unpacked as usize);
                let mut target = std::io::Cursor::new(std::mem::take(&mut self.unpacked));
                let mut stream = zstd::stream::read::Decoder::with_buffer(self.packed.as_slice())
                    .with_context(damaged)?
                    .take(limit as u64);
                std::io::copy(&mut stream, &mut target).with_context(damaged)?;
                self.unpacked = target.into_inner();
            }
        }
        ensure!(self.unpacked.len() as u64 == chunk.unpacked, "{}: it holds less than it says", damaged());
        ensure!(
            chunk.crc == 0 || crc32fast::hash(&self.unpacked) == chunk.crc,
            "{}: its checksum does not match",
            damaged()
        );
        Ok(())
    }

    fn read_header(&mut self) -> anyhow::Result<()> {
        let shown = self.path.display().to_string();
        for index in 0..self.chunks.len().min(4) {
            self.unpack(index)?;
            let unpacked = std::mem::take(&mut self.unpacked);
            let mut found = None;
            self.records(index, &unpacked, &mut |topic, _, data| {
                if topic == Topic::Header {
                    found = Some(Header::decode(data).context("its header cannot be read")?);
                    return Ok(Flow::Enough);
                }
                Ok(Flow::On)
            })?;
            self.unpacked = unpacked;
            if let Some(header) = found {
                ensure!(
                    header.format_version <= FORMAT_VERSION,
                    "{shown}: recorded by {} in format {}; this program reads up to {FORMAT_VERSION}: use a newer one",
                    header.program,
                    header.format_version
                );
                ensure!(!header.links.is_empty(), "{shown}: its chain has no links");
                self.header = header;
                return Ok(());
            }
        }
        let reason = if self.complete { "it is MCAP, of another program" } else { "it ends before its header" };
        bail!("{shown} holds no pitchline recording: {reason}")
    }

    /// Calls `each` with the topic, log time and content of every message of an unpacked chunk.
    fn records(&mut self, index: usize, unpacked: &[u8], each: &mut Each<'_>) -> anyhow::Result<Flow> {
        let offset = self.chunks[index].offset;
        let place = |at: usize| format!("{}: byte {at} of the chunk at byte {offset}", self.path.display());
        let mut at = 0;
        while at < unpacked.len() {
            let head = unpacked.get(at..at + RECORD_HEAD as usize);
            let head = head.with_context(|| format!("{}: half a record", place(at)))?;
            let (kind, length) = (head[0], u64_at(head, 1));
            let begin = at + RECORD_HEAD as usize;
            let end = usize::try_from(length).ok().and_then(|l| begin.checked_add(l)).filter(|e| *e <= unpacked.len());
            let end = end.with_context(|| format!("{}: a record of {length} bytes does not fit", place(at)))?;
            let content = &unpacked[begin..end];
            match kind {
                op::CHANNEL => {
                    let (id, name) = channel(content).with_context(|| format!("{}: half a channel", place(at)))?;
                    self.topics.insert(id, topic(name));
                }
                op::MESSAGE => {
                    ensure!(content.len() >= 22, "{}: half a message", place(at));
                    ensure!(content.len() <= LONGEST_MESSAGE, "{}: a message of {length} bytes", place(at));
                    let channel = u16::from_le_bytes([content[0], content[1]]);
                    let t_ns = u64_at(content, 6);
                    let topic = *self.topics.get(&channel).unwrap_or(&Topic::Other);
                    if each(topic, t_ns, &content[22..]).with_context(|| place(at))? == Flow::Enough {
                        return Ok(Flow::Enough);
                    }
                }
                _ => {}
            }
            at = end;
        }
        Ok(Flow::On)
    }

    /// As [`Reader::each`] over everything, past chunks that cannot be read: those are told to `damaged` with the times that they
    /// cover [s].
    pub fn each_sound(
        &mut self,
        wanted: Wanted,
        mut each: impl FnMut(Entry<'_>) -> anyhow::Result<Flow>,
        mut damaged: impl FnMut(anyhow::Error, (f64, f64)),
    ) -> anyhow::Result<()> {
        for index in 0..self.chunks.len() {
            let span_s = (self.chunks[index].start_ns as f64 * 1e-9, self.chunks[index].end_ns as f64 * 1e-9);
            match self.each_of(index, wanted, (0, u64::MAX), &mut each) {
                Ok(Flow::On) => {}
                Ok(Flow::Enough) => break,
                Err(e) => damaged(e, span_s),
            }
        }
        Ok(())
    }

    /// Calls `each` with what is wanted of the recording between two times, ends included, in the order of the file.
    pub fn each(
        &mut self,
        wanted: Wanted,
        (from_s, to_s): (f64, f64),
        mut each: impl FnMut(Entry<'_>) -> anyhow::Result<Flow>,
    ) -> anyhow::Result<()> {
        let (from_ns, to_ns) = (nanoseconds(from_s), nanoseconds(to_s));
        for index in 0..self.chunks.len() {
            let chunk = &self.chunks[index];
            // The first holds the channels; an unwritten time range counts as any.
            let outside = chunk.end_ns < from_ns || chunk.start_ns > to_ns;
            if outside && chunk.end_ns != 0 {
                continue;
            }
            if self.each_of(index, wanted, (from_ns, to_ns), &mut each)? == Flow::Enough {
                break;
            }
        }
        Ok(())
    }

    fn each_of(
        &mut self,
        index: usize,
        wanted: Wanted,
        (from_ns, to_ns): (u64, u64),
        each: &mut dyn FnMut(Entry<'_>) -> anyhow::Result<Flow>,
    ) -> anyhow::Result<Flow> {
        self.unpack(index)?;
        let unpacked = std::mem::take(&mut self.unpacked);
        let mut frame = std::mem::take(&mut self.frame);
        let (links, bodies) = (self.header.links.len(), self.header.bodies.len());
        let sensors = self.header.sensors.len();
        let flow = self.records(index, &unpacked, &mut |topic, t_ns, data| {
            if t_ns < from_ns || t_ns > to_ns {
                return Ok(Flow::On);
            }
            let entry = match topic {
                Topic::Frame if wanted.frames => {
                    frame.clear();
                    frame.merge(data)?;
                    check(&frame, links, bodies, sensors)?;
                    Entry::Frame(&frame)
                }
                Topic::Frame if wanted.heads => Entry::Head(FrameHead::decode(data)?),
                Topic::Keyframe if wanted.keyframes => Entry::Keyframe(Box::new(Keyframe::decode(data)?)),
                Topic::Event if wanted.events => Entry::Event(Event::decode(data)?),
                Topic::Impact if wanted.impacts => {
                    let impact = Impact::decode(data)?;
                    let inside = (impact.link as usize) < links && (impact.body as usize) < bodies;
                    ensure!(inside, "an impact of a link or body that there is not");
                    Entry::Impact(impact)
                }
                _ => return Ok(Flow::On),
            };
            each(entry)
        });
        (self.unpacked, self.frame) = (unpacked, frame);
        flow
    }

    /// The last keyframe at or before `t_s`.
    pub fn keyframe_before(&mut self, t_s: f64) -> anyhow::Result<Option<Keyframe>> {
        let until = nanoseconds(t_s);
        let wanted = Wanted { keyframes: true, ..Wanted::default() };
        for index in (0..self.chunks.len()).rev() {
            if self.chunks[index].start_ns > until && index > 0 {
                continue;
            }
            let mut last: Option<Keyframe> = None;
            self.each_of(index, wanted, (0, until), &mut |entry| {
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

    /// Step and time of the first and the last frame, from the chunks at both ends alone.
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
                self.each_of(index, wanted, (0, u64::MAX), &mut |entry| {
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
        Ok(found[0].zip(found[1]))
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

    /// The frame nearest to `t_s`, and its number.
    pub fn frame_near(&mut self, t_s: f64) -> anyhow::Result<Option<(usize, Frame)>> {
        let heads = self.heads()?;
        let Some(number) =
            (0..heads.len()).min_by(|a, b| (heads[*a].t_s - t_s).abs().total_cmp(&(heads[*b].t_s - t_s).abs()))
        else {
            return Ok(None);
        };
        Ok(self.frame_at(heads[number].t_s)?.map(|frame| (number, frame)))
    }

    /// The frame of exactly this time.
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

fn nanoseconds(t_s: f64) -> u64 {
    // Saturates: infinity is the end of time.
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

/// Number and topic of a channel record. Read here, because the crate's own reader reserves whatever length a text states.
fn channel(content: &[u8]) -> Option<(u16, &str)> {
    let id = u16::from_le_bytes(*content.first_chunk()?);
    // Behind the number of its schema.
    let length = u32::from_le_bytes(*content.get(4..)?.first_chunk()?);
    let name = content.get(8..)?.get(..usize::try_from(length).ok()?)?;
    Some((id, std::str::from_utf8(name).ok()?))
}

/// Columns of one table have one length, that of the header where it tells one, and indices point into the header; readers rely
/// on it.
fn check(frame: &Frame, n_links: usize, n_bodies: usize, n_sensors: usize) -> anyhow::Result<()> {
    let l = &frame.links;
    let n = l.x_m.len();
    let links = [&l.y_m, &l.angle_rad, &l.vx_m_s, &l.vy_m_s, &l.omega_rad_s];
    ensure!(links.iter().all(|c| c.len() == n), "columns of links have different lengths");
    let j = &frame.joints;
    let joints = [&j.force_x_n, &j.force_y_n, &j.friction_torque_nm];
    ensure!(joints.iter().all(|c| c.len() == n), "columns of joints have different lengths");
    let c = &frame.contacts;
    let n = c.link.len();
    let whole = [&c.feature, &c.body, &c.tooth, &c.segment].iter().all(|c| c.len() == n) && c.stick.len() == n;
    let floats = [
        &c.point_body_x_m,
        &c.point_body_y_m,
        &c.point_link_x_m,
        &c.point_link_y_m,
        &c.normal_x,
        &c.normal_y,
        &c.penetration_m,
        &c.approach_speed_m_s,
        &c.normal_speed_m_s,
        &c.tangential_speed_m_s,
        &c.normal_force_n,
        &c.tangential_force_n,
        &c.age_s,
    ];
    ensure!(whole && floats.iter().all(|c| c.len() == n), "columns of contacts have different lengths");
    ensure!(frame.links.x_m.len() == n_links, "a frame of {} links in a recording of {n_links}", frame.links.x_m.len());
    let inside = c.link.iter().all(|l| (*l as usize) < n_links) && c.body.iter().all(|b| (*b as usize) < n_bodies);
    ensure!(inside, "a contact of a link or body that there is not");
    ensure!(frame.sensors.len() <= n_sensors, "more readings than sensors");
    let r = &frame.rotors;
    let n = r.angle_rad.len();
    ensure!(n <= n_bodies, "more rotors than bodies");
    let rotors = [&r.speed_rad_s, &r.chain_torque_nm, &r.outer_torque_nm];
    ensure!(rotors.iter().all(|c| c.len() == n), "columns of rotors have different lengths");
    Ok(())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let mut word = [0; 8];
    word.copy_from_slice(&bytes[at..at + 8]);
    u64::from_le_bytes(word)
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    let mut word = [0; 4];
    word.copy_from_slice(&bytes[at..at + 4]);
    u32::from_le_bytes(word)
}

/// Frames of a recording one after the other, a chunk in memory at a time.
pub struct Cursor<'a> {
    reader: &'a mut Reader,
    chunk: usize,
    frames: std::collections::VecDeque<Frame>,
}

impl<'a> Cursor<'a> {
    pub fn new(reader: &'a mut Reader) -> Cursor<'a> {
        Cursor { reader, chunk: 0, frames: std::collections::VecDeque::new() }
    }

    /// From the beginning again.
    pub fn rewound(self) -> Cursor<'a> {
        Cursor::new(self.reader)
    }

    pub fn next_frame(&mut self) -> anyhow::Result<Option<Frame>> {
        while self.frames.is_empty() && self.chunk < self.reader.chunks.len() {
            let frames = &mut self.frames;
            let wanted = Wanted { frames: true, ..Wanted::default() };
            self.reader.each_of(self.chunk, wanted, (0, u64::MAX), &mut |entry| {
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
