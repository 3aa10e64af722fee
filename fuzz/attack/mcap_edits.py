"""Changes to the inside of a recording. An edit returns whether a reader could notice it, or should answer as before."""

import math
import random
import struct

import mcap_file
import zstandard
from mcap_file import Chunk, Message, Recording

ODD_NUMBERS = [0.0, -0.0, -1.0, math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 1e-12, 1e12]
ODD_COUNTS = [0, 1, 2, 3, 89, 91, 255, 65536, 1 << 31, (1 << 32) - 1]
FRAME_COLUMNS = ["links", "joints", "contacts", "rotors"]


def _edit_messages(rng: random.Random, recording: Recording, topic: str, change, share: float = 0.2) -> None:
    """Decode some messages of a topic, at least one, change them and encode them again."""
    messages = recording.messages(topic)
    chosen = [m for m in messages if rng.random() < share] or ([rng.choice(messages)] if messages else [])
    for message in chosen:
        value = recording.decode(message)
        change(value)
        message.data = value.SerializeToString()


def _set_odd(rng: random.Random, message) -> None:
    """Set one field of a message, or of one inside it, to something odd."""
    field = rng.choice(message.DESCRIPTOR.fields)
    value = getattr(message, field.name)
    repeated = field.is_repeated
    if field.type == field.TYPE_MESSAGE:
        if repeated and (not value or rng.random() < 0.2):
            rng.choice([lambda: message.ClearField(field.name), lambda: value.add()])()
        else:
            _set_odd(rng, rng.choice(value) if repeated else value)
        return
    if field.type in (field.TYPE_DOUBLE, field.TYPE_FLOAT):
        odd = rng.choice(ODD_NUMBERS)
    elif field.type == field.TYPE_BOOL:
        odd = rng.random() < 0.5
    elif field.type == field.TYPE_STRING:
        odd = rng.choice(["", "\0", "é" * 1000, "a/../../b", "{}%s", "x" * 100_000, "-"])
    else:
        wide = field.type in (field.TYPE_UINT64, field.TYPE_FIXED64)
        unsigned = wide or field.type in (field.TYPE_UINT32, field.TYPE_FIXED32)
        odd = rng.choice(ODD_COUNTS + [(1 << 64) - 1, 1 << 63] * wide) if unsigned else rng.choice([0, 1, 7, -1, (1 << 31) - 1])
    if repeated and len(value) and rng.random() < 0.7:
        value[rng.randrange(len(value))] = odd
    elif repeated:
        value.append(odd)
    else:
        setattr(message, field.name, odd)


def header_value(rng, recording) -> bool:
    def change(header):
        for _ in range(rng.choice([1, 1, 3])):
            _set_odd(rng, header)

    _edit_messages(rng, recording, "/pitchline/header", change)
    return False


def header_teeth(rng, recording) -> bool:
    def change(header):
        rng.choice(header.bodies).teeth = rng.choice(ODD_COUNTS)

    _edit_messages(rng, recording, "/pitchline/header", change)
    return False


def header_lists(rng, recording) -> bool:
    """Links or sprockets that frames have rows of are gone, or there are more of them."""

    def change(header):
        field, rows = rng.choice([(header.links, len(header.links)), (header.bodies, sum(body.rotor for body in header.bodies))])
        if rng.random() < 0.5:
            del field[rng.randrange(rows) :]
        else:
            field.extend([field[0]] * rng.choice([1, 100]))

    _edit_messages(rng, recording, "/pitchline/header", change)
    return True


def header_outline_indices(rng, recording) -> bool:
    def change(header):
        rng.choice(header.links).outline = rng.choice([2, 3, 1000, (1 << 32) - 1])

    _edit_messages(rng, recording, "/pitchline/header", change)
    return True


def header_step(rng, recording) -> bool:
    def change(header):
        if rng.random() < 0.5:
            header.step_s = rng.choice(ODD_NUMBERS + [header.step_s * 2, -header.step_s])
        else:
            header.steps_per_frame = rng.choice([0, 1, 1 << 40, (1 << 64) - 1])

    _edit_messages(rng, recording, "/pitchline/header", change)
    return False


def header_drive_text(rng, recording) -> bool:
    def change(header):
        text = header.drive_text
        place = rng.randrange(len(text))
        header.drive_text = rng.choice(
            ["", text[:place], text + "\n[x", text.replace("90", "91", 1), text.replace("teeth = 20", "teeth = 9"), text.replace("3000", "1e300"), "a = " + "[" * 50_000]
        )

    _edit_messages(rng, recording, "/pitchline/header", change)
    return False


def header_twice(rng, recording) -> bool:
    original = recording.messages("/pitchline/header")[0]
    value = recording.decode(original)
    value.drive_name = "another"
    del value.links[rng.randrange(len(value.links)) :]
    copy = Message(original.channel, original.sequence, original.log_time, original.publish_time, value.SerializeToString())
    rng.choice(recording.chunks).items.append(copy)
    return True


def header_missing(rng, recording) -> bool:
    return _remove(recording, recording.messages("/pitchline/header"))


def frame_values(rng, recording) -> bool:
    _edit_messages(rng, recording, rng.choice(["/pitchline/frame", "/pitchline/keyframe"]), lambda frame: _set_odd(rng, frame))
    return False


def any_message_values(rng, recording) -> bool:
    topic = rng.choice([topic for topic in recording.topics if recording.messages(topic)])
    _edit_messages(rng, recording, topic, lambda message: _set_odd(rng, message), share=0.5)
    return False


def frame_columns(rng, recording) -> bool:
    """One column of a frame is shorter or longer than its neighbours."""

    def change(frame):
        group = getattr(frame, rng.choice(FRAME_COLUMNS))
        column = getattr(group, rng.choice(group.DESCRIPTOR.fields).name)
        if len(column) and rng.random() < 0.6:
            del column[rng.randrange(len(column)) :]
        else:
            column.extend([0] * rng.choice([1, 3, 10_000]))

    _edit_messages(rng, recording, "/pitchline/frame", change)
    return True


def frame_indices(rng, recording) -> bool:
    """Contacts of links and bodies that there are none of."""

    def change(frame):
        column = rng.choice([frame.contacts.link, frame.contacts.body])
        if len(column):
            column[rng.randrange(len(column))] = rng.choice([90, 1000, (1 << 32) - 1])
        else:
            frame.links.x_m.append(0.0)

    _edit_messages(rng, recording, "/pitchline/frame", change)
    return True


def frame_nan_poses(rng, recording) -> bool:
    def change(frame):
        odd = rng.choice([math.nan, math.inf, 1e308])
        for column in (frame.links.x_m, frame.links.y_m, frame.links.angle_rad):
            column[:] = [odd] * len(column)

    _edit_messages(rng, recording, "/pitchline/frame", change, rng.choice([0.1, 1.0]))
    return False


def frame_steps(rng, recording) -> bool:
    """Steps that go back, stand still or jump."""

    def change(frame):
        frame.step = rng.choice([0, 1, frame.step + 1_000_000, 1 << 40, (1 << 64) - 1])

    _edit_messages(rng, recording, "/pitchline/frame", change)
    return True


def frame_times(rng, recording) -> bool:
    def change(frame):
        frame.t_s = rng.choice([-1.0, frame.t_s + 1.0, math.nan, math.inf, 1e300, -frame.t_s - 1e-9])

    _edit_messages(rng, recording, "/pitchline/frame", change)
    return True


def frames_removed(rng, recording) -> bool:
    """Frames amid others are gone; the first and the last are kept, without which nothing could be noticed."""
    inner = recording.messages("/pitchline/frame")[1:-1]
    count = rng.choice([1, 1, 3, len(inner)])
    return _remove(recording, rng.sample(inner, min(count, len(inner))))


def frames_doubled(rng, recording) -> bool:
    chosen = rng.sample(recording.messages("/pitchline/frame"), 2)
    for chunk in recording.chunks:
        chunk.items = [copy for item in chunk.items for copy in ([item, item] if any(item is c for c in chosen) else [item])]
    return True


def frames_shuffled(rng, recording) -> bool:
    chunk = rng.choice(recording.chunks)
    places = [i for i, item in enumerate(chunk.items) if isinstance(item, Message)]
    for _ in range(rng.choice([1, 5, 50])):
        a, b = rng.choice(places), rng.choice(places)
        chunk.items[a], chunk.items[b] = chunk.items[b], chunk.items[a]
    return True


def frames_emptied(rng, recording) -> bool:
    for message in rng.sample(recording.messages("/pitchline/frame"), 2):
        message.data = rng.choice([b"", b"\x00", message.data[: len(message.data) // 2], rng.randbytes(200)])
    return True


def keyframe_columns(rng, recording) -> bool:
    """A keyframe's columns are renamed, doubled, gone, or of another length."""

    def change(keyframe):
        columns = keyframe.columns
        column = rng.choice(columns)
        kind = rng.randrange(5)
        if kind == 0:
            column.name = rng.choice(["", columns[0].name, "nothing"])
        elif kind == 1:
            del column.values[:]
        elif kind == 2:
            column.values.extend([0.0] * rng.choice([1, 100_000]))
        elif kind == 3:
            columns.extend([column])
        elif len(column.values):
            column.values[rng.randrange(len(column.values))] = rng.choice(ODD_NUMBERS)

    _edit_messages(rng, recording, "/pitchline/keyframe", change)
    return False


def keyframes_missing(rng, recording) -> bool:
    return _remove(recording, recording.messages("/pitchline/keyframe"))


def impact_indices(rng, recording) -> bool:
    def change(impact):
        impact.link, impact.body, impact.feature = (rng.choice([0, 90, 1000, (1 << 32) - 1]) for _ in range(3))

    if recording.messages("/pitchline/impact"):
        _edit_messages(rng, recording, "/pitchline/impact", change)
    return False


def impact_order(rng, recording) -> bool:
    def change(impact):
        impact.step = rng.choice([0, 1 << 50, (1 << 64) - 1])
        impact.t_s = rng.choice(ODD_NUMBERS)

    if recording.messages("/pitchline/impact"):
        _edit_messages(rng, recording, "/pitchline/impact", change)
    return False


def log_times(rng, recording) -> bool:
    """The time beside a message is not that of the frame in it."""
    for message in rng.sample(recording.messages("/pitchline/frame"), 3):
        message.log_time = rng.choice([0, message.log_time + 1, message.log_time * 2, (1 << 64) - 1, 1 << 63])
    return True


def chunk_times(rng, recording) -> bool:
    chunk = rng.choice(recording.chunks)
    chunk.lies[rng.choice(["start", "end"])] = rng.choice([0, 1, 5_000_000, (1 << 64) - 1])
    return True


def chunk_sizes(rng, recording) -> bool:
    chunk = rng.choice(recording.chunks)
    size = rng.choice([0, 1, 1 << 20, 1 << 31, 1 << 40, (1 << 64) - 1])
    chunk.lies[rng.choice(["uncompressed_size", "packed_size"])] = size
    return True


def chunk_checksum(rng, recording) -> bool:
    rng.choice(recording.chunks).lies["crc"] = rng.choice([1, 0xFFFFFFFF])
    return True


def chunk_unknown_compression(rng, recording) -> bool:
    rng.choice(recording.chunks).compression = rng.choice(["zstd ", "ZSTD", "brotli", "x" * 1000])
    return True


def chunks_removed(rng, recording) -> bool:
    """A chunk amid others with frames is gone: one at an end could not be missed."""
    if len(recording.chunks) > 3:
        recording.chunks.pop(rng.randrange(2, len(recording.chunks) - 1))
    else:
        recording.chunks[0].compression = "none"
    return True


def chunks_shuffled(rng, recording) -> bool:
    """Messages keep their times; only the chunks stand in another order. The one with the header may come last."""
    rng.shuffle(recording.chunks)
    return True


def chunks_doubled(rng, recording) -> bool:
    recording.chunks.append(rng.choice(recording.chunks[1:] or recording.chunks))
    return True


def packed_otherwise(rng, recording) -> bool:
    """The same messages in the same order: another compression, other chunks."""
    items = [item for chunk in recording.chunks for item in chunk.items]
    size = rng.choice([7, 40, len(items)])
    method = rng.choice(["", "lz4", "zstd"])
    recording.chunks = [Chunk(items[i : i + size], method) for i in range(0, len(items), size)]
    return True


def channel_ids(rng, recording) -> bool:
    """Messages of one channel state another, or one that there is none of."""
    messages = [m for topic in recording.topics for m in recording.messages(topic)]
    for message in rng.sample(messages, min(len(messages), rng.choice([1, 5]))):
        message.channel = rng.choice([0, 99, 65535, *recording.channels])
    return False


def record_kinds(rng, recording) -> bool:
    """Records within a chunk are of another kind, or of none."""
    chunk = rng.choice(recording.chunks)
    place = rng.randrange(len(chunk.items))
    item = chunk.items[place]
    content = struct.pack("<HIQQ", item.channel, 0, 0, 0) + item.data if isinstance(item, Message) else item[1]
    chunk.items[place] = (rng.choice([0, 1, 2, 3, 4, 6, 7, 8, 9, 15, 128, 255]), content)
    return False


def schema_changed(rng, recording) -> bool:
    for chunk in recording.chunks:
        for place, item in enumerate(chunk.items):
            if not isinstance(item, Message) and rng.random() < 0.3:
                content = bytearray(item[1])
                content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
                chunk.items[place] = (item[0], bytes(content))
    return False


def _remove(recording: Recording, messages: list[Message]) -> bool:
    gone = {id(message) for message in messages}
    for chunk in recording.chunks:
        chunk.items = [item for item in chunk.items if id(item) not in gone]
    return True


EDITS = [
    header_value, header_teeth, header_lists, header_outline_indices, header_step, header_drive_text, header_twice, header_missing,
    frame_values, any_message_values, frame_columns, frame_indices, frame_nan_poses, frame_steps, frame_times,
    frames_removed, frames_doubled, frames_shuffled, frames_emptied, keyframe_columns, keyframes_missing,
    impact_indices, impact_order, log_times, chunk_times, chunk_sizes, chunk_checksum, chunk_unknown_compression,
    chunks_removed, chunks_shuffled, chunks_doubled, packed_otherwise, channel_ids, record_kinds, schema_changed,
]  # fmt: skip


def _length_delimited(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def header_of_empty_messages(rng, recording) -> None:
    """Two bytes each in the file, a whole structure each in memory."""
    field = rng.choice([4, 7, 8, 9, 10, 11, 14, 17])
    recording.messages("/pitchline/header")[0].data += _length_delimited(field, b"") * rng.choice([100_000, 1_000_000, 4_000_000])


def header_of_nested_messages(rng, recording) -> None:
    outline = _length_delimited(rng.choice([2, 4]), b"") * rng.choice([1000, 1_000_000])
    body = _length_delimited(7, outline)
    message = recording.messages("/pitchline/header")[0]
    message.data += rng.choice([_length_delimited(9, outline), _length_delimited(10, body)]) * rng.choice([1, 3])


def header_deeply_nested(rng, recording) -> None:
    inner = b""
    for _ in range(rng.choice([50, 200, 20_000])):
        inner = _length_delimited(7, inner[-100_000:])
    recording.messages("/pitchline/header")[0].data += _length_delimited(10, inner)


def frame_of_zeros(rng, recording) -> None:
    """Megabytes of zeros pack into nothing."""
    frame = rng.choice(recording.messages("/pitchline/frame"))
    zeros = bytes(8 * rng.choice([100_000, 1_000_000, 8_000_000]))
    frame.data += _length_delimited(5, _length_delimited(1, zeros))


def zstd_bomb(rng, recording) -> None:
    chunk = rng.choice(recording.chunks)
    size = rng.choice([1 << 26, 1 << 29, 1 << 30])
    compressor = zstandard.ZstdCompressor(level=1).compressobj()
    block = bytes(1 << 22)
    chunk.lies["body"] = b"".join(compressor.compress(block) for _ in range(size >> 22)) + compressor.flush()
    chunk.lies["uncompressed_size"] = rng.choice([size, 1000, 1 << 34, (1 << 63) - 1])


def stated_sizes(rng, recording) -> None:
    for chunk in recording.chunks:
        if rng.random() < 0.7:
            chunk.lies["uncompressed_size"] = rng.choice([1 << 30, 1 << 32, 1 << 34, (1 << 63) - 1, (1 << 64) - 1])


def inner_lengths(rng, recording) -> None:
    """The last record of a chunk, cut within its length."""
    chunk = rng.choice(recording.chunks)
    chunk.items.append((rng.choice([mcap_file.MESSAGE, mcap_file.SCHEMA, mcap_file.CHANNEL]), b"\xff" * rng.choice([0, 1, 5, 21])))


def many_frames(rng, recording) -> None:
    """Very many frames of no content, or of one and the same."""
    frames = recording.messages("/pitchline/frame")
    last = frames[-1]
    data = rng.choice([b"", last.data[:30]])
    count = rng.choice([10_000, 100_000])
    items = [Message(last.channel, 0, last.log_time + i, last.log_time + i, data) for i in range(count)]
    recording.chunks.append(Chunk(items))


def many_chunks(rng, recording) -> None:
    recording.chunks += [Chunk([], rng.choice(["", "zstd"])) for _ in range(rng.choice([1000, 30_000]))]


def many_impacts(rng, recording) -> None:
    impacts = recording.messages("/pitchline/impact")
    copies = [Message(m.channel, 0, m.log_time, m.log_time, rng.choice([m.data, b""])) for m in impacts] * 10_000
    recording.chunks.append(Chunk(copies[:60_000]))


BOMBS = [
    header_of_empty_messages, header_of_empty_messages, header_of_nested_messages, header_deeply_nested, frame_of_zeros,
    zstd_bomb, stated_sizes, inner_lengths, many_frames, many_chunks, many_impacts,
]  # fmt: skip
