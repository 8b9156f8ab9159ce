// A host application: subscribes to a node, decodes by sparkplug-payload, and speaks JSON lines.
import { createRequire } from "node:module";
import { createInterface } from "node:readline";

const [modules, port, group, node] = process.argv.slice(2);
const require = createRequire(`${modules}/`);
const mqtt = require("mqtt");
const sparkplug = require("sparkplug-payload").get("spBv1.0");

const say = (line) => process.stdout.write(`${JSON.stringify(line)}\n`);
const plain = (value) => JSON.parse(JSON.stringify(value, (_, each) => (typeof each === "bigint" ? Number(each) : each?.low !== undefined && each?.high !== undefined ? each.high * 2 ** 32 + (each.low >>> 0) : each)));
const client = mqtt.connect({ host: "127.0.0.1", port: Number(port), clientId: `host-${process.pid}`, reconnectPeriod: 100 });
const publish = (kind, metrics) =>
  client.publish(`spBv1.0/${group}/${kind}/${node}`, Buffer.from(sparkplug.encodePayload({ timestamp: Date.now(), metrics })), { qos: 0 });

client.on("connect", () =>
  client.subscribe([`spBv1.0/${group}/+/${node}`, "umo/#", "homeassistant/#"], () => {
    say({ kind: "connected" });
    publish("NCMD", [{ name: "Node Control/Rebirth", type: "Boolean", value: true }]);
  }),
);
client.on("message", (topic, bytes, packet) => {
  if (!topic.startsWith("spBv1.0/")) return say({ kind: "plain", topic, text: bytes.toString(), retain: packet.retain });
  const kind = topic.split("/")[2];
  if (kind !== "NCMD") say({ kind, retain: packet.retain, ...plain(sparkplug.decodePayload(bytes)) });
});
createInterface({ input: process.stdin })
  .on("line", (line) => {
    const { metrics, topic, text, retain } = JSON.parse(line);
    if (topic) client.publish(topic, text, { retain: Boolean(retain), qos: 1 });
    else publish("NCMD", metrics);
  })
  .on("close", () => client.end(false, {}, () => process.exit(0)));
