// Reads a recording by its index with @mcap/core: how many messages of each topic, and a hash of those of `machine`.
// node read.cjs NODE_MODULES FILE
const { createRequire } = require("node:module");
const { createHash } = require("node:crypto");
const { promises } = require("node:fs");
const from = createRequire(process.argv[2] + "/");
const { McapIndexedReader } = from("@mcap/core");
const zstd = from("@foxglove/wasm-zstd");

async function main() {
  await zstd.isLoaded;
  const file = await promises.open(process.argv[3], "r");
  const readable = {
    size: async () => BigInt((await file.stat()).size),
    read: async (at, size) => {
      const data = Buffer.alloc(Number(size));
      await file.read(data, 0, Number(size), Number(at));
      return new Uint8Array(data);
    },
  };
  const decompressHandlers = { zstd: (data, size) => zstd.decompress(data, Number(size)) };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const counts = {};
  const hash = createHash("sha256");
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const topic = reader.channelsById.get(message.channelId).topic;
    counts[topic] = (counts[topic] ?? 0) + 1;
    if (topic === "machine") hash.update(message.data);
  }
  console.log(JSON.stringify({ counts, hash: hash.digest("hex") }));
}
main();
