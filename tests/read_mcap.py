"""Reads a pitchline recording with the public MCAP and protobuf libraries and compares every value, bit by bit.

usage: read_mcap.py RECORDING.mcap EXPECTED.txt    (one value a line, as the 16 hex digits of its f64 bits)
"""

import struct
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def with_fine(coarse, fine):
    """Values of a column whose mantissas continue in another field: of floats, and their next 8 or 16 bits."""
    bits = 8 * len(fine) // len(coarse)
    for value, behind in zip(coarse, struct.unpack(f"<{len(coarse)}{'BH'[bits // 16]}", fine)):
        whole = struct.unpack("<Q", struct.pack("<d", value))[0] | behind << 29 - bits
        yield struct.unpack("<d", struct.pack("<Q", whole))[0]


def numbers(message):
    """All numbers of a message in the order of its schema, the state hash left out."""
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.name == "state_hash" or field.name.endswith("_fine"):
            continue
        fine = getattr(message, field.name + "_fine", b"")
        if fine:
            yield from with_fine(value, fine)
            continue
        if field.message_type is not None:
            yield from numbers(value)
        elif isinstance(value, (int, float)):
            yield value
        else:
            yield from value


def main():
    with open(sys.argv[2], encoding="ascii") as expected_file:
        expected = [line.strip() for line in expected_file]
    found = []
    topics = set()
    with open(sys.argv[1], "rb") as recording:
        reader = make_reader(recording, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            topics.add(channel.topic)
            if channel.topic == "/pitchline/frame":
                found += [struct.pack(">d", float(v)).hex() for v in numbers(message)]
        attachments = [a.name for a in reader.iter_attachments()]
    differing = sum(a != b for a, b in zip(found, expected))
    print(f"{len(found)} values, {differing} differ; topics {sorted(topics)}; attachments {attachments}")
    sys.exit(0 if found == expected and "/scene" in topics and "/drive" in topics and "/tf" in topics and attachments else 1)


main()
