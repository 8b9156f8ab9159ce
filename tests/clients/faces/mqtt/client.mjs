// A host application: subscribes to a node, decodes by sparkplug-payload, and speaks JSON lines.
import { createRequire } from "node:module";
import { createInterface } from "node:readline";

const [modules, port, group, node, primary] = process.argv.slice(2);
const require = createRequire(`${modules}/`);
const mqtt = require("mqtt");
const sparkplug = require("sparkplug-payload").get("spBv1.0");

const say = (line) => process.stdout.write(`${JSON.stringify(line)}\n`);
const plain = (value) => JSON.parse(JSON.stringify(value, (_, each) => (typeof each === "bigint" ? Number(each) : each?.low !== undefined && each?.high !== undefined ? each.high * 2 ** 32 + (each.low >>> 0) : each)));
// With `primary` it is the primary host of this name: its STATE is online, and offline by its will.
const state = { topic: `spBv1.0/STATE/${primary}`, qos: 1, retain: true };
const stated = (online, timestamp) => JSON.stringify({ online, timestamp });
const options = { host: "127.0.0.1", port: Number(port), clientId: `host-${process.pid}`, reconnectPeriod: 100 };
if (primary) options.will = { ...state, payload: stated(false, Date.now()) };
const client = mqtt.connect(options);
const publish = (kind, metrics, retain) =>
  client.publish(`spBv1.0/${group}/${kind}/${node}`, Buffer.from(sparkplug.encodePayload({ timestamp: Date.now(), metrics })), { qos: 0, retain: Boolean(retain) });

const begun = Date.now();

client.on("connect", () =>
  client.subscribe([`spBv1.0/${group}/+/${node}`, "umo/#", "homeassistant/#"], { qos: 1 }, () => {
    say({ kind: "connected" });
    if (primary) client.publish(state.topic, stated(true, begun), state);
    publish("NCMD", [{ name: "Node Control/Rebirth", type: "Boolean", value: true }]);
  }),
);
client.on("message", (topic, bytes, packet) => {
  if (!topic.startsWith("spBv1.0/")) return say({ kind: "plain", topic, text: bytes.toString(), retain: packet.retain });
  const kind = topic.split("/")[2];
  if (kind !== "NCMD") say({ kind, retain: packet.retain, qos: packet.qos, ...plain(sparkplug.decodePayload(bytes)) });
});
createInterface({ input: process.stdin })
  .on("line", (line) => {
    const { metrics, topic, text, retain } = JSON.parse(line);
    if (topic) client.publish(topic, text, { retain: Boolean(retain), qos: 1 });
    else publish("NCMD", metrics, retain);
  })
  .on("close", () => client.end(false, {}, () => process.exit(0)));
