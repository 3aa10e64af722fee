"""Holds the Foxglove schemas inside a recording against Foxglove's own definitions.

usage: check_foxglove.py RECORDING.mcap    (needs mcap and foxglove-schemas-protobuf)
"""

import importlib
import sys

from google.protobuf import descriptor_pb2
from mcap.reader import make_reader


def fields(message):
    return {f.name: (f.number, f.type, f.label, f.type_name) for f in message.field}


def main():
    checked, wrong = set(), []
    with open(sys.argv[1], "rb") as recording:
        schemas = make_reader(recording).get_summary().schemas.values()
    for schema in schemas:
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
            if file.package != "foxglove":
                continue
            for message in file.message_type:
                own = importlib.import_module(f"foxglove_schemas_protobuf.{message.name}_pb2")
                theirs = descriptor_pb2.DescriptorProto()
                getattr(own, message.name).DESCRIPTOR.CopyToProto(theirs)
                checked.add(message.name)
                if fields(message) != fields(theirs):
                    wrong.append(message.name)
    print(f"{len(checked)} messages as Foxglove defines them: {sorted(checked)}")
    if wrong or len(checked) < 5:
        sys.exit(f"not as Foxglove defines them: {wrong}")


main()
