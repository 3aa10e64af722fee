//! The file of a recording: positions of its chunks, its table of contents, and the unpacked content of chunks.

#![warn(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::cast_possible_truncation)]

use super::{Each, Flow, Reader, Topic, topic};
use anyhow::{Context, bail, ensure};
use mcap::records::op;
use std::collections::BTreeSet;
use std::io::{Read, Seek, SeekFrom};

/// Longest record that is read, packed or unpacked [bytes]; those of this program are below 5 MB.
const LONGEST_RECORD: u64 = 64 << 20;
/// Longest message [bytes]; frames and States of the longest chain are below 2 MB. Small messages may unpack to many
/// times their size, so that this also limits memory.
const LONGEST_MESSAGE: usize = 8 << 20;
/// Maximum number of chunks of one file.
const MAX_CHUNKS: usize = 1 << 22;
/// Records of a table of contents: entry of a chunk, and message counts.
const CHUNK_INDEX_LENGTH: usize = 32;
const STATISTICS_LENGTH: usize = 46;
/// Bytes before a record's content: operation code and length.
const RECORD_HEAD: u64 = 9;
/// Shortest head of a chunk: start, end, size, CRC, empty name of the compression, packed size.
const CHUNK_HEAD: u64 = 8 + 8 + 8 + 4 + 4 + 8;
/// Longest accepted name of a compression.
const LONGEST_NAME: u32 = 32;

/// A chunk: position of its packed bytes, and their properties.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Chunk {
    /// Position of the record, for error messages.
    pub(super) offset: u64,
    pub(super) data_offset: u64,
    pub(super) packed: u64,
    pub(super) unpacked: u64,
    pub(super) crc: u32,
    pub(super) compression: Compression,
    pub(super) start_ns: u64,
    pub(super) end_ns: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Zstd,
}

/// Entry of a chunk in the table of contents.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ChunkIndex {
    pub(super) offset: u64,
    pub(super) start_ns: u64,
    pub(super) end_ns: u64,
}

impl Reader {
    /// Compares the table of contents of a finished file with the chunks that were found.
    fn check_contents(&mut self, index: &[ChunkIndex], n_chunks: Option<u32>) {
        let shown = self.path.display().to_string();
        let found: BTreeSet<u64> = self.chunks.iter().map(|c| c.offset).collect();
        if let Some(n) = n_chunks
            && n as usize != self.chunks.len()
            && index.iter().all(|entry| found.contains(&entry.offset))
        {
            self.miss(format!("{shown}: it states {n} chunks and contains {}", self.chunks.len()));
        }
        for entry in index {
            // Chunks are sorted by position.
            let at = self.chunks.binary_search_by_key(&entry.offset, |c| c.offset).ok();
            let Some(chunk) = at.and_then(|at| self.chunks.get_mut(at)) else {
                let (from, to) = (entry.start_ns as f64 * 1e-6, entry.end_ns as f64 * 1e-6);
                self.miss(format!("{shown}: no chunk at byte {}, {from:.4} to {to:.4} ms", entry.offset));
                continue;
            };
            if (chunk.start_ns, chunk.end_ns) != (entry.start_ns, entry.end_ns) {
                // The union of both ranges is searched, because either may be right.
                chunk.start_ns = chunk.start_ns.min(entry.start_ns);
                chunk.end_ns = chunk.end_ns.max(entry.end_ns);
                self.miss(format!(
                    "{shown}: the chunk at byte {} has other times in the table of contents",
                    entry.offset
                ));
            }
        }
    }

    /// Finds the positions of chunks without unpacking them.
    pub(super) fn find_chunks(&mut self) -> anyhow::Result<()> {
        let length = self.file.metadata()?.len();
        let (mut index, mut n_chunks) = (Vec::new(), None);
        let mut at = mcap::MAGIC.len() as u64;
        loop {
            if length.saturating_sub(at) < RECORD_HEAD {
                break;
            }
            self.file.seek(SeekFrom::Start(at))?;
            let (mut kind, mut content) = ([0; 1], [0; 8]);
            self.file.read_exact(&mut kind)?;
            self.file.read_exact(&mut content)?;
            let ([kind], content) = (kind, u64::from_le_bytes(content));
            let Some(end) = content.checked_add(at + RECORD_HEAD).filter(|end| *end <= length) else { break };
            match kind {
                op::CHUNK => {
                    ensure!(self.chunks.len() < MAX_CHUNKS, "more than {MAX_CHUNKS} chunks at byte {at}");
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
                op::CHUNK_INDEX if content >= CHUNK_INDEX_LENGTH as u64 && index.len() < MAX_CHUNKS => {
                    let mut entry = [0; CHUNK_INDEX_LENGTH];
                    self.file.read_exact(&mut entry)?;
                    let (start_ns, end_ns, offset) = (u64_at(&entry, 0), u64_at(&entry, 8), u64_at(&entry, 16));
                    index.push(ChunkIndex { offset, start_ns, end_ns });
                }
                op::STATISTICS if (STATISTICS_LENGTH as u64..=LONGEST_RECORD).contains(&content) => {
                    let mut counts = vec![0; in_memory(content)];
                    self.file.read_exact(&mut counts)?;
                    n_chunks = Some(u32_at(&counts, 22));
                    let (counts, _) = counts.get(STATISTICS_LENGTH..).unwrap_or_default().as_chunks::<10>();
                    let count = |[a, b, n @ ..]: &[u8; 10]| (u16::from_le_bytes([*a, *b]), u64::from_le_bytes(*n));
                    self.counted = counts.iter().map(count).collect();
                }
                0 => bail!("record of kind 0 at byte {at}"),
                _ => {}
            }
            at = end;
        }
        self.lost_bytes = length.saturating_sub(at);
        if self.complete {
            self.check_contents(&index, n_chunks);
        }
        Ok(())
    }

    /// The head of a chunk whose record begins at `at` and has `content` bytes.
    fn chunk_at(&mut self, at: u64, content: u64) -> anyhow::Result<Chunk> {
        ensure!(content >= CHUNK_HEAD, "too short for a chunk: {content} bytes");
        let room = in_memory(content.min(CHUNK_HEAD + u64::from(LONGEST_NAME)));
        let mut head = vec![0; room];
        self.file.read_exact(&mut head)?;
        let name_length = u32_at(&head, 28);
        let name_end = 32 + in_memory(u64::from(name_length));
        ensure!(name_length <= LONGEST_NAME && name_end + 8 <= room, "no such compression");
        let name = head.get(32..name_end).unwrap_or_default();
        let compression = match name {
            b"" => Compression::None,
            b"zstd" => Compression::Zstd,
            _ => bail!(
                "packed with `{}`; pitchline reads zstd: convert it with `mcap compress --compression zstd`",
                String::from_utf8_lossy(name)
            ),
        };
        let packed = u64_at(&head, name_end);
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

    pub(super) fn chunk(&self, index: usize) -> anyhow::Result<Chunk> {
        self.chunks.get(index).copied().with_context(|| format!("{} has no chunk {index}", self.path.display()))
    }

    /// Reads and unpacks chunk `index` into `self.unpacked`.
    pub(super) fn unpack(&mut self, index: usize) -> anyhow::Result<()> {
        let chunk = self.chunk(index)?;
        let damaged = || format!("{} is damaged in the chunk at byte {}", self.path.display(), chunk.offset);
        self.packed.resize(in_memory(chunk.packed), 0);
        self.file.seek(SeekFrom::Start(chunk.data_offset)).with_context(damaged)?;
        self.file.read_exact(&mut self.packed).with_context(damaged)?;
        match chunk.compression {
            Compression::None => std::mem::swap(&mut self.packed, &mut self.unpacked),
            Compression::Zstd => {
                self.unpacked.clear();
                self.unpacked.reserve(in_memory(chunk.unpacked));
                // Never more than stated: the capacity of the target is the limit.
                let limit = self.unpacked.capacity().min(in_memory(chunk.unpacked));
                let mut target = std::io::Cursor::new(std::mem::take(&mut self.unpacked));
                let mut stream = zstd::stream::read::Decoder::with_buffer(self.packed.as_slice())
                    .with_context(damaged)?
                    .take(limit as u64);
                std::io::copy(&mut stream, &mut target).with_context(damaged)?;
                self.unpacked = target.into_inner();
            }
        }
        ensure!(self.unpacked.len() as u64 == chunk.unpacked, "{}: it contains less than it states", damaged());
        ensure!(
            chunk.crc == 0 || crc32fast::hash(&self.unpacked) == chunk.crc,
            "{}: its checksum does not match",
            damaged()
        );
        Ok(())
    }

    /// Calls `each` with topic, log time and content of every message of an unpacked chunk.
    pub(super) fn records(&mut self, index: usize, unpacked: &[u8], each: &mut Each<'_>) -> anyhow::Result<Flow> {
        let Chunk { offset, start_ns, end_ns, .. } = self.chunk(index)?;
        let place = |at: usize| format!("{}: byte {at} of the chunk at byte {offset}", self.path.display());
        let mut rest = unpacked;
        while let [kind, behind @ ..] = rest {
            let at = unpacked.len() - rest.len();
            let length = behind.split_first_chunk().with_context(|| format!("{}: half a record", place(at)));
            let (length, behind) = length.map(|(length, behind)| (u64::from_le_bytes(*length), behind))?;
            let split = usize::try_from(length).ok().and_then(|length| behind.split_at_checked(length));
            let split = split.with_context(|| format!("{}: a record of {length} bytes does not fit", place(at)));
            let (content, behind) = split?;
            match *kind {
                op::CHANNEL => {
                    let (id, name) = channel(content).with_context(|| format!("{}: half a channel", place(at)))?;
                    self.topics.insert(id, topic(name));
                }
                op::MESSAGE => {
                    // Channel, number, log time and publish time, then the content.
                    let split = content.split_first_chunk::<22>();
                    let (head, said) = split.with_context(|| format!("{}: half a message", place(at)))?;
                    ensure!(content.len() <= LONGEST_MESSAGE, "{}: a message of {length} bytes", place(at));
                    let [a, b, ..] = *head;
                    let (channel, t_ns) = (u16::from_le_bytes([a, b]), u64_at(head, 6));
                    // Searches by time skip chunks according to their stated range.
                    let inside = end_ns == 0 || (start_ns..=end_ns).contains(&t_ns);
                    ensure!(inside, "{}: a message of {t_ns} ns in a chunk of {start_ns} to {end_ns} ns", place(at));
                    *self.met.entry(channel).or_default() += 1;
                    let topic = *self.topics.get(&channel).unwrap_or(&Topic::Other);
                    if each(topic, t_ns, said).with_context(|| place(at))? == Flow::Enough {
                        return Ok(Flow::Enough);
                    }
                }
                _ => {}
            }
            rest = behind;
        }
        Ok(Flow::On)
    }
}

/// Number and topic of a channel record. Parsed here, because the crate's reader allocates whatever length a text
/// states.
fn channel(content: &[u8]) -> Option<(u16, &str)> {
    let id = u16::from_le_bytes(*content.first_chunk()?);
    // After the number of its schema.
    let length = u32::from_le_bytes(*content.get(4..)?.first_chunk()?);
    let name = content.get(8..)?.get(..usize::try_from(length).ok()?)?;
    Some((id, std::str::from_utf8(name).ok()?))
}

/// Converts a length that has been found to be small.
fn in_memory(length: u64) -> usize {
    usize::try_from(length).unwrap_or(usize::MAX)
}

/// The caller has checked the length; beyond the end the value is zero.
fn u64_at(bytes: &[u8], at: usize) -> u64 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |word| u64::from_le_bytes(*word))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |word| u32::from_le_bytes(*word))
}
