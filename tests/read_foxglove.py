"""Listens to a live run as Foxglove does: by the schemas that the server sends. Argument: its address, behind `ws://`."""

import asyncio
import base64
import json
import sys

import websockets
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory


def message_class(channel):
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))


async def listen(address):
    channels, drives, scenes, frames, arrows = {}, [], [], [], 0
    url = f"ws://{address}"
    async with websockets.connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
        async for message in socket:
            if isinstance(message, str):
                for channel in json.loads(message).get("channels", []):
                    channels[channel["id"]] = (channel["topic"], message_class(channel))
                    order = {"id": channel["id"], "channelId": channel["id"]}
                    await socket.send(json.dumps({"op": "subscribe", "subscriptions": [order]}))
            elif message[0] == 1:
                topic, kind = channels[int.from_bytes(message[1:5], "little")]
                value = kind.FromString(message[13:])
                if topic == "/drive":
                    drives.append(value)
                elif topic == "/scene":
                    scenes.append(value)
                    arrows += sum(len(entity.arrows) for entity in value.entities)
                elif topic == "/pitchline/frame":
                    frames.append(value)
    return drives, scenes, frames, arrows


drives, scenes, frames, arrows = asyncio.run(listen(sys.argv[1]))
print(f"{len(scenes)} scenes, {len(frames)} frames, {arrows} arrows, last frame at {frames[-1].t_s:.6f} s")
assert len(drives[0].entities) > 90 and drives[0].entities[0].lines, "outlines of the drive"
assert arrows > 0 and len(frames) > 50 and len(frames[-1].links.x_m) == 90
