"""Takes MCAP recordings apart into records and packs them again, with correct checksums unless told otherwise."""

import struct
import zlib
from collections import Counter, defaultdict
from dataclasses import dataclass, field

import lz4.frame
import zstandard
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)


@dataclass
class Message:
    channel: int
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


@dataclass
class Chunk:
    """Messages of one chunk, and what is to be stated of it in place of the truth."""

    items: list  # Message, or (opcode, content) of any other record
    compression: str = "zstd"
    lies: dict = field(default_factory=dict)


@dataclass
class Recording:
    header: bytes
    chunks: list[Chunk]
    others: list[tuple[int, bytes]]  # attachments and metadata
    schemas: dict[int, bytes]  # content of the records
    channels: dict[int, bytes]
    topics: dict[str, int]
    classes: dict[str, type]
    counts: dict[int, int]  # messages of each channel, as the file was read

    def messages(self, topic: str) -> list[Message]:
        channel = self.topics[topic]
        return [item for chunk in self.chunks for item in chunk.items if isinstance(item, Message) and item.channel == channel]

    def decode(self, message: Message):
        topic = next(name for name, channel in self.topics.items() if channel == message.channel)
        return self.classes[topic].FromString(message.data)


def split_records(data: bytes):
    """(opcode, content, offset) of every record; stops where the data does."""
    position = 0
    while position + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        yield opcode, data[position + 9 : position + 9 + length], position
        position += 9 + length


def read_string(data: bytes, position: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", data, position)
    return data[position + 4 : position + 4 + length].decode(), position + 4 + length


def string(text: str) -> bytes:
    raw = text.encode()
    return struct.pack("<I", len(raw)) + raw


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def record_offsets(data: bytes) -> list[tuple[int, int]]:
    """(opcode, offset in the file) of every record outside of chunks."""
    return [(opcode, len(MAGIC) + offset) for opcode, _, offset in split_records(data[len(MAGIC) : -len(MAGIC)])]


def unpack(data: bytes) -> Recording:
    recording = Recording(b"", [], [], {}, {}, {}, {}, Counter())
    for opcode, content, _ in split_records(data[len(MAGIC) : -len(MAGIC)]):
        if opcode == HEADER:
            recording.header = content
        elif opcode == CHUNK:
            recording.chunks.append(_unpack_chunk(content, recording))
        elif opcode in (ATTACHMENT, METADATA):
            recording.others.append((opcode, content))
        elif opcode == DATA_END:
            break
    for chunk in recording.chunks:
        recording.counts.update(item.channel for item in chunk.items if isinstance(item, Message))
    return recording


def _unpack_chunk(content: bytes, recording: Recording) -> Chunk:
    compression, position = read_string(content, 28)
    body = content[position + 8 :]
    if compression == "zstd":
        body = zstandard.ZstdDecompressor().decompress(body, max_output_size=struct.unpack_from("<Q", content, 16)[0])
    chunk = Chunk([], compression)
    for opcode, inner, _ in split_records(body):
        if opcode == MESSAGE:
            channel, sequence, log_time, publish_time = struct.unpack_from("<HIQQ", inner)
            chunk.items.append(Message(channel, sequence, log_time, publish_time, inner[22:]))
            continue
        chunk.items.append((opcode, inner))
        number = struct.unpack_from("<H", inner)[0]
        if opcode == SCHEMA:
            recording.schemas[number] = inner
        elif opcode == CHANNEL:
            recording.channels[number] = inner
            topic, _ = read_string(inner, 4)
            recording.topics[topic] = number
            recording.classes[topic] = _message_class(recording.schemas[struct.unpack_from("<H", inner, 2)[0]])
    return chunk


def _message_class(schema: bytes) -> type:
    name, position = read_string(schema, 2)
    _, position = read_string(schema, position)
    files = descriptor_pb2.FileDescriptorSet.FromString(schema[position + 4 :])
    pool = descriptor_pool.DescriptorPool()
    pending = list(files.file)
    while pending:
        file = next(f for f in pending if all(_known(pool, d) for d in f.dependency))
        pool.Add(file)
        pending.remove(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def _known(pool: descriptor_pool.DescriptorPool, file: str) -> bool:
    try:
        pool.FindFileByName(file)
    except KeyError:
        return False
    return True


def compress(body: bytes, compression: str) -> bytes:
    if compression == "zstd":
        return zstandard.ZstdCompressor(level=1).compress(body)
    if compression == "lz4":
        return lz4.frame.compress(body)
    return body


def pack(recording: Recording, counts: dict[int, int] | None = None) -> bytes:
    """The file of a recording. `counts` replaces the numbers of messages that its statistics state."""
    out = bytearray(MAGIC + record(HEADER, recording.header))
    indexes = defaultdict(list)
    for opcode, content in recording.others:
        offset = len(out)
        out += record(opcode, content)
        indexes[METADATA_INDEX if opcode == METADATA else ATTACHMENT_INDEX].append(_index_of(opcode, content, offset))
    actual = Counter()
    times = []
    for chunk in recording.chunks:
        indexes[CHUNK_INDEX].append(_pack_chunk(out, chunk, actual, times))
    out += record(DATA_END, struct.pack("<I", 0))
    stated = actual if counts is None else counts
    per_channel = b"".join(struct.pack("<HQ", channel, count) for channel, count in sorted(stated.items()))
    statistics = struct.pack(
        "<QHIIIIQQ", sum(stated.values()), len(recording.schemas), len(recording.channels), len(indexes[ATTACHMENT_INDEX]),
        len(indexes[METADATA_INDEX]), len(recording.chunks), min(times, default=0), max(times, default=0),
    ) + struct.pack("<I", len(per_channel)) + per_channel
    groups = [
        (SCHEMA, list(recording.schemas.values())), (CHANNEL, list(recording.channels.values())), (STATISTICS, [statistics]),
        (CHUNK_INDEX, indexes[CHUNK_INDEX]), (ATTACHMENT_INDEX, indexes[ATTACHMENT_INDEX]), (METADATA_INDEX, indexes[METADATA_INDEX]),
    ]
    summary_start = len(out)
    offsets = bytearray()
    for opcode, contents in groups:
        start = len(out)
        for content in contents:
            out += record(opcode, content)
        if len(out) > start:
            offsets += record(SUMMARY_OFFSET, struct.pack("<BQQ", opcode, start, len(out) - start))
    offset_start = len(out)
    out += offsets
    footer = struct.pack("<QQ", summary_start, offset_start)
    out += struct.pack("<BQ", FOOTER, 20) + footer
    out += struct.pack("<I", zlib.crc32(out[summary_start:])) + MAGIC
    return bytes(out)


def _index_of(opcode: int, content: bytes, offset: int) -> bytes:
    length = len(content) + 9
    if opcode == METADATA:
        return struct.pack("<QQ", offset, length) + string(read_string(content, 0)[0])
    log_time, create_time = struct.unpack_from("<QQ", content)
    name, position = read_string(content, 16)
    media_type, position = read_string(content, position)
    return struct.pack("<QQQQQ", offset, length, log_time, create_time, struct.unpack_from("<Q", content, position)[0]) + string(name) + string(media_type)


def _pack_chunk(out: bytearray, chunk: Chunk, actual: Counter, times: list[int]) -> bytes:
    """Append a chunk and its message indexes; the chunk's index is returned."""
    body = bytearray()
    places = defaultdict(list)
    for item in chunk.items:
        if isinstance(item, Message):
            places[item.channel].append((item.log_time, len(body)))
            times.append(item.log_time)
            actual[item.channel] += 1
            body += record(MESSAGE, struct.pack("<HIQQ", item.channel, item.sequence, item.log_time, item.publish_time) + item.data)
        else:
            body += record(*item)
    own_times = [time for entries in places.values() for time, _ in entries]
    start = chunk.lies.get("start", min(own_times, default=0))
    end = chunk.lies.get("end", max(own_times, default=0))
    size = chunk.lies.get("uncompressed_size", len(body))
    packed = chunk.lies.get("body", None) or compress(bytes(body), chunk.compression)
    content = struct.pack("<QQQI", start, end, size, chunk.lies.get("crc", zlib.crc32(body))) + string(chunk.compression)
    content += struct.pack("<Q", chunk.lies.get("packed_size", len(packed))) + packed
    offset = len(out)
    out += record(CHUNK, content)
    length = len(out) - offset
    index_offsets = {}
    index_start = len(out)
    for channel, entries in places.items():
        index_offsets[channel] = len(out)
        raw = b"".join(struct.pack("<QQ", time, place) for time, place in entries)
        out += record(MESSAGE_INDEX, struct.pack("<HI", channel, len(raw)) + raw)
    raw_offsets = b"".join(struct.pack("<HQ", channel, place) for channel, place in index_offsets.items())
    return (
        struct.pack("<QQQQ", start, end, offset, length)
        + struct.pack("<I", len(raw_offsets)) + raw_offsets
        + struct.pack("<Q", len(out) - index_start) + string(chunk.compression) + struct.pack("<QQ", len(packed), size)
    )
