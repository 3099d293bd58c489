// Reads a recording with MCAP's own reader in TypeScript and protobufjs, knowing nothing of rigtwin:
//   node read_with_node.cjs FILE   prints what it found as JSON.
// Packages: @mcap/core, @mcap/nodejs, fzstd, protobufjs; NODE_PATH names their folder.
const { open } = require("node:fs/promises");
const { McapIndexedReader } = require("@mcap/core");
const { FileHandleReadable } = require("@mcap/nodejs");
const { decompress } = require("fzstd");
const protobuf = require("protobufjs");
const { FileDescriptorSet } = require("protobufjs/ext/descriptor");

async function main(path) {
  const readable = new FileHandleReadable(await open(path, "r"));
  const reader = await McapIndexedReader.Initialize({
    readable,
    decompressHandlers: { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) },
  });
  const types = new Map();
  for (const schema of reader.schemasById.values()) {
    const root = protobuf.Root.fromDescriptor(FileDescriptorSet.decode(schema.data));
    types.set(schema.id, root.lookupType(schema.name));
  }
  const numbers = {};
  for (const { topic, schemaId } of reader.channelsById.values()) {
    numbers[topic] = types.get(schemaId).fieldsArray.filter(isNumber).map(({ name }) => name);
  }
  const counts = {};
  const channels = {};
  const speeds = [];
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const { topic, schemaId } = reader.channelsById.get(message.channelId);
    counts[topic] = (counts[topic] ?? 0) + 1;
    if (topic.endsWith("/daq/block")) {
      for (const { name, unit, samples } of types.get(schemaId).decode(message.data).channels) {
        channels[name] ??= { unit, count: 0, last: 0 };
        channels[name].count += samples.length;
        channels[name].last = samples[samples.length - 1];
      }
    } else if (topic.endsWith("/daq/summary")) {
      speeds.push(types.get(schemaId).decode(message.data).speed_hz);
    }
  }
  const notes = [...reader.metadataIndexes].map(({ name }) => name);
  console.log(JSON.stringify({ counts, channels, speeds, notes, numbers }));
}

// Whether a plotting program offers a field without a plug-in: one plain number in each message.
function isNumber({ repeated, map, type }) {
  return !repeated && !map && Object.hasOwn(protobuf.types.basic, type) && !["string", "bytes"].includes(type);
}

main(process.argv[2]).catch((error) => {
  console.error(error);
  process.exit(1);
});
