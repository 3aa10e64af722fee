// Reads a pitchline recording with the reader that Foxglove uses, by the schemas in the file.
//
// usage: node read_mcap.mjs RECORDING.mcap MODULES    (a folder with node_modules: @mcap/core, @mcap/support, protobufjs)
//
// Prints JSON: messages per topic, and of every frame its step, its time and the place of its first link.
import { createRequire } from "node:module";
import { open } from "node:fs/promises";
import path from "node:path";

const [recording, modules] = process.argv.slice(2);
const require = createRequire(path.join(path.resolve(modules), "none.js"));
const { McapIndexedReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");
const protobuf = require("protobufjs");
const descriptor = require("protobufjs/ext/descriptor");

const file = await open(recording, "r");
const reader = await McapIndexedReader.Initialize({
  readable: {
    size: async () => BigInt((await file.stat()).size),
    read: async (offset, length) => {
      const { buffer } = await file.read(new Uint8Array(Number(length)), 0, Number(length), Number(offset));
      return buffer;
    },
  },
  decompressHandlers: await loadDecompressHandlers(),
});
const types = new Map();
for (const [id, channel] of reader.channelsById) {
  const schema = reader.schemasById.get(channel.schemaId);
  const root = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(schema.data));
  types.set(id, root.lookupType(schema.name));
}
const topics = {};
const frames = [];
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const topic = reader.channelsById.get(message.channelId).topic;
  topics[topic] = (topics[topic] ?? 0) + 1;
  const value = types.get(message.channelId).decode(message.data);
  if (topic === "/pitchline/frame") {
    const links = value.links;
    // As text: not every parser of JSON rounds numbers as it should.
    frames.push([Number(value.step), value.tS, links.xM[0], links.xM.length].map(String));
  }
}
console.log(JSON.stringify({ topics, frames }));
await file.close();
