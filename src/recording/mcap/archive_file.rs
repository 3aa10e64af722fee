//! Writes the records of an MCAP file (mcap.dev/spec, version 0), and nothing that knows what they mean.
//!
//! The crate `mcap` writes such files too. It copies a message four times: into a buffer, into zstd's window, into zstd's output,
//! into the file's buffer. That was a third of what recording cost. Here a message is encoded where it lies in its chunk
//! ([`OpenChunk::message`]); the chunk has its checksum computed at one go, is compressed at one go or not at all, and is written
//! from where it lies.
//!
//! Records are: operation code, length of the content as u64, content; numbers are little-endian, texts have their length as u32
//! before them, maps the number of their bytes.

use mcap::records::op;
use std::collections::BTreeMap;
use std::io::Write;

/// Bytes before a record's content: operation code and length.
const RECORD_HEAD: usize = 9;
/// Before the content of a message: channel, number, log time, publish time.
const MESSAGE_HEAD: usize = 2 + 4 + 8 + 8;

/// How a chunk is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// As it is.
    None,
    Zstd,
}

/// Messages that wait for being written together.
pub struct OpenChunk {
    packing: Packing,
    /// Records one after the other.
    content: Vec<u8>,
    /// The message index of each channel: log time and offset of each message.
    index: Vec<Vec<[u64; 2]>>,
    /// Earliest and latest log time of the messages.
    bounds: Option<(u64, u64)>,
}

/// Appends a number.
fn number<const N: usize>(out: &mut Vec<u8>, bytes: [u8; N]) {
    out.extend_from_slice(&bytes);
}

/// Appends a length, which the format keeps in 32 bits.
fn length_u32(out: &mut Vec<u8>, length: usize) {
    number(out, u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes());
}

fn text(out: &mut Vec<u8>, text: &str) {
    length_u32(out, text.len());
    out.extend_from_slice(text.as_bytes());
}

fn texts(out: &mut Vec<u8>, map: &BTreeMap<String, String>) {
    length_u32(out, map.iter().map(|(k, v)| 8 + k.len() + v.len()).sum());
    for (key, value) in map {
        text(out, key);
        text(out, value);
    }
}

/// Appends a record whose content `put` appends.
fn record(out: &mut Vec<u8>, kind: u8, put: impl FnOnce(&mut Vec<u8>)) {
    out.push(kind);
    let length_at = out.len();
    number(out, [0; 8]);
    put(out);
    let length = (out.len() - length_at - 8) as u64;
    out[length_at..length_at + 8].copy_from_slice(&length.to_le_bytes());
}

impl OpenChunk {
    pub fn new(packing: Packing) -> OpenChunk {
        OpenChunk { packing, content: Vec::new(), index: Vec::new(), bounds: None }
    }

    /// Bytes that wait.
    pub fn len(&self) -> usize {
        self.content.len()
    }

    pub fn is_empty(&self) -> bool {
        self.content.is_empty()
    }

    /// Adds a message whose content `put` appends, without touching what stands before.
    pub fn message(&mut self, channel: u16, sequence: u32, log_time_ns: u64, put: impl FnOnce(&mut Vec<u8>)) {
        let place = usize::from(channel);
        if self.index.len() <= place {
            self.index.resize_with(place + 1, Vec::new);
        }
        self.index[place].push([log_time_ns, self.content.len() as u64]);
        let (first, last) = self.bounds.unwrap_or((log_time_ns, log_time_ns));
        self.bounds = Some((first.min(log_time_ns), last.max(log_time_ns)));
        record(&mut self.content, op::MESSAGE, |out| {
            let mut head = [0; MESSAGE_HEAD];
            head[..2].copy_from_slice(&channel.to_le_bytes());
            head[2..6].copy_from_slice(&sequence.to_le_bytes());
            head[6..14].copy_from_slice(&log_time_ns.to_le_bytes());
            head[14..].copy_from_slice(&log_time_ns.to_le_bytes());
            out.extend_from_slice(&head);
            put(out);
        });
    }

    fn clear(&mut self) {
        self.content.clear();
        self.index.iter_mut().for_each(Vec::clear);
        self.bounds = None;
    }
}

/// Records of the table of contents at the end of the file, by kind.
#[derive(Default)]
struct TableOfContents {
    schemas: Vec<u8>,
    channels: Vec<u8>,
    chunks: Vec<u8>,
    attachments: Vec<u8>,
    metadata: Vec<u8>,
    n_schemas: u16,
    n_channels: u16,
    n_chunks: u32,
    n_attachments: u32,
    n_metadata: u32,
    /// Messages of each channel.
    messages: Vec<u64>,
    /// Earliest and latest log time.
    bounds: Option<(u64, u64)>,
}

/// A file to which records are appended.
pub struct ArchiveFile<W: Write> {
    file: W,
    /// Bytes written so far.
    at: u64,
    contents: TableOfContents,
    zstd: zstd::bulk::Compressor<'static>,
    packed: Vec<u8>,
    /// Small records about to be written.
    small: Vec<u8>,
}

impl<W: Write> ArchiveFile<W> {
    /// Begins the file. `zstd_level` holds for chunks that are packed.
    pub fn new(file: W, profile: &str, library: &str, zstd_level: i32) -> std::io::Result<ArchiveFile<W>> {
        let zstd = zstd::bulk::Compressor::new(zstd_level)?;
        let contents = TableOfContents::default();
        let mut archive = ArchiveFile { file, at: 0, contents, zstd, packed: Vec::new(), small: Vec::new() };
        archive.small.extend_from_slice(mcap::MAGIC);
        record(&mut archive.small, op::HEADER, |out| {
            text(out, profile);
            text(out, library);
        });
        archive.write_small()?;
        Ok(archive)
    }

    pub fn into_inner(self) -> W {
        self.file
    }

    fn write_small(&mut self) -> std::io::Result<()> {
        self.file.write_all(&self.small)?;
        self.at += self.small.len() as u64;
        self.small.clear();
        Ok(())
    }

    /// Writes named texts.
    pub fn metadata(&mut self, name: &str, values: &BTreeMap<String, String>) -> std::io::Result<()> {
        record(&mut self.small, op::METADATA, |out| {
            text(out, name);
            texts(out, values);
        });
        record(&mut self.contents.metadata, op::METADATA_INDEX, |out| {
            number(out, self.at.to_le_bytes());
            number(out, (self.small.len() as u64).to_le_bytes());
            text(out, name);
        });
        self.contents.n_metadata += 1;
        self.write_small()
    }

    /// Writes a file within the file.
    pub fn attachment(&mut self, name: &str, media_type: &str, data: &[u8]) -> std::io::Result<()> {
        let (log_time, create_time) = (0_u64, 0_u64);
        record(&mut self.small, op::ATTACHMENT, |out| {
            let from = out.len();
            number(out, log_time.to_le_bytes());
            number(out, create_time.to_le_bytes());
            text(out, name);
            text(out, media_type);
            number(out, (data.len() as u64).to_le_bytes());
            out.extend_from_slice(data);
            let crc = crc32fast::hash(&out[from..]);
            number(out, crc.to_le_bytes());
        });
        record(&mut self.contents.attachments, op::ATTACHMENT_INDEX, |out| {
            number(out, self.at.to_le_bytes());
            number(out, (self.small.len() as u64).to_le_bytes());
            number(out, log_time.to_le_bytes());
            number(out, create_time.to_le_bytes());
            number(out, (data.len() as u64).to_le_bytes());
            text(out, name);
            text(out, media_type);
        });
        self.contents.n_attachments += 1;
        self.write_small()
    }

    /// Adds a topic with protobuf messages to a chunk; returns the number of its channel, which is that of the call, from 1.
    pub fn channel(&mut self, chunk: &mut OpenChunk, topic: &str, schema: &str, descriptor: &[u8]) -> u16 {
        let contents = &mut self.contents;
        let (schema_id, id) = (contents.n_schemas + 1, contents.n_channels + 1);
        let records = [&mut chunk.content, &mut contents.schemas];
        for out in records {
            record(out, op::SCHEMA, |out| {
                number(out, schema_id.to_le_bytes());
                text(out, schema);
                text(out, "protobuf");
                length_u32(out, descriptor.len());
                out.extend_from_slice(descriptor);
            });
        }
        for out in [&mut chunk.content, &mut contents.channels] {
            record(out, op::CHANNEL, |out| {
                number(out, id.to_le_bytes());
                number(out, schema_id.to_le_bytes());
                text(out, topic);
                text(out, "protobuf");
                texts(out, &BTreeMap::new());
            });
        }
        contents.n_schemas += 1;
        contents.n_channels += 1;
        id
    }

    /// Writes a chunk and the index of its messages, and empties it; an empty one is not written.
    pub fn write_chunk(&mut self, chunk: &mut OpenChunk) -> std::io::Result<()> {
        if chunk.is_empty() {
            return Ok(());
        }
        let crc = crc32fast::hash(&chunk.content);
        let (name, data) = match chunk.packing {
            Packing::None => ("", &chunk.content),
            Packing::Zstd => {
                self.packed.clear();
                self.packed.reserve(zstd::zstd_safe::compress_bound(chunk.content.len()));
                self.zstd.compress_to_buffer(&chunk.content, &mut self.packed)?;
                ("zstd", &self.packed)
            }
        };
        let (unpacked, packed) = (chunk.content.len() as u64, data.len() as u64);
        let (first_ns, last_ns) = chunk.bounds.unwrap_or((0, 0));
        let small = &mut self.small;
        small.push(op::CHUNK);
        let head_length = 8 + 8 + 8 + 4 + 4 + name.len() + 8;
        number(small, (head_length as u64 + packed).to_le_bytes());
        number(small, first_ns.to_le_bytes());
        number(small, last_ns.to_le_bytes());
        number(small, unpacked.to_le_bytes());
        number(small, crc.to_le_bytes());
        text(small, name);
        number(small, packed.to_le_bytes());
        self.file.write_all(small)?;
        self.file.write_all(data)?;
        small.clear();
        let chunk_at = self.at;
        let chunk_length = (RECORD_HEAD + head_length) as u64 + packed;
        self.at += chunk_length;
        let mut offsets = Vec::new();
        for (channel, entries) in chunk.index.iter().enumerate().filter(|(_, entries)| !entries.is_empty()) {
            number(&mut offsets, (channel as u16).to_le_bytes());
            number(&mut offsets, (self.at + small.len() as u64).to_le_bytes());
            record(small, op::MESSAGE_INDEX, |out| {
                number(out, (channel as u16).to_le_bytes());
                length_u32(out, 16 * entries.len());
                for [log_time_ns, offset] in entries {
                    number(out, log_time_ns.to_le_bytes());
                    number(out, offset.to_le_bytes());
                }
            });
        }
        self.contents.count(chunk);
        record(&mut self.contents.chunks, op::CHUNK_INDEX, |out| {
            for value in [first_ns, last_ns, chunk_at, chunk_length] {
                number(out, value.to_le_bytes());
            }
            length_u32(out, offsets.len());
            out.extend_from_slice(&offsets);
            number(out, (small.len() as u64).to_le_bytes());
            text(out, name);
            number(out, packed.to_le_bytes());
            number(out, unpacked.to_le_bytes());
        });
        self.write_small()?;
        chunk.clear();
        Ok(())
    }

    /// Writes the table of contents and the end.
    pub fn finish(&mut self) -> std::io::Result<()> {
        // Chunks and attachments have checksums of their own.
        record(&mut self.small, op::DATA_END, |out| number(out, 0_u32.to_le_bytes()));
        self.write_small()?;
        let start = self.at;
        let mut contents = std::mem::take(&mut self.contents);
        let statistics = contents.statistics();
        let small = &mut self.small;
        let mut groups = Vec::new();
        for (kind, records) in [
            (op::SCHEMA, &contents.schemas),
            (op::CHANNEL, &contents.channels),
            (op::STATISTICS, &statistics),
            (op::CHUNK_INDEX, &contents.chunks),
            (op::ATTACHMENT_INDEX, &contents.attachments),
            (op::METADATA_INDEX, &contents.metadata),
        ] {
            if !records.is_empty() {
                groups.push((kind, start + small.len() as u64, records.len() as u64));
                small.extend_from_slice(records);
            }
        }
        let offsets_start = start + small.len() as u64;
        for (kind, group_start, length) in groups {
            record(small, op::SUMMARY_OFFSET, |out| {
                out.push(kind);
                number(out, group_start.to_le_bytes());
                number(out, length.to_le_bytes());
            });
        }
        small.push(op::FOOTER);
        number(small, (8_u64 + 8 + 4).to_le_bytes());
        number(small, start.to_le_bytes());
        number(small, offsets_start.to_le_bytes());
        // The checksum covers everything from the first schema to here.
        let crc = crc32fast::hash(small);
        number(small, crc.to_le_bytes());
        small.extend_from_slice(mcap::MAGIC);
        self.write_small()?;
        self.file.flush()
    }
}

impl TableOfContents {
    /// Counts the messages of a chunk.
    fn count(&mut self, chunk: &OpenChunk) {
        self.n_chunks += 1;
        self.messages.resize(self.messages.len().max(chunk.index.len()), 0);
        for (count, entries) in self.messages.iter_mut().zip(&chunk.index) {
            *count += entries.len() as u64;
        }
        if let Some((first, last)) = chunk.bounds {
            let (earliest, latest) = self.bounds.unwrap_or((first, last));
            self.bounds = Some((earliest.min(first), latest.max(last)));
        }
    }

    fn statistics(&mut self) -> Vec<u8> {
        let mut out = Vec::new();
        let (first_ns, last_ns) = self.bounds.unwrap_or((0, 0));
        record(&mut out, op::STATISTICS, |out| {
            number(out, self.messages.iter().sum::<u64>().to_le_bytes());
            number(out, self.n_schemas.to_le_bytes());
            for count in [u32::from(self.n_channels), self.n_attachments, self.n_metadata, self.n_chunks] {
                number(out, count.to_le_bytes());
            }
            number(out, first_ns.to_le_bytes());
            number(out, last_ns.to_le_bytes());
            let counted = || self.messages.iter().enumerate().filter(|(_, n)| **n > 0);
            length_u32(out, 10 * counted().count());
            for (channel, n) in counted() {
                number(out, (channel as u16).to_le_bytes());
                number(out, n.to_le_bytes());
            }
        });
        out
    }
}
