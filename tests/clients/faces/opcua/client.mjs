/**
 * A client of node-opcua that is driven by lines of JSON: {"id": 1, "do": "read", ...} is answered by {"id": 1, ...} with
 * the result, or with `refused` in words. `umo` knows nothing of it.
 */

import { createRequire } from "node:module";
import readline from "node:readline";

const require = createRequire(`${process.env.NODE_PATH}/`);
console.log = console.error; // the lines of stdout are answers
const ua = require("node-opcua-client");
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");
const { convertPEMtoDER } = require("node-opcua-crypto");
const types = require("node-opcua-types"); // every structure of the standard
const { CallRequest, WriteRequest } = ua;

const WORDS = 0x80; // ReturnDiagnostics: AdditionalInfo of the operations
const properties = new Map(); // of each node: what is fixed
let client, session, subscription, namespace = -1;
const heard = []; // what the subscription has told

async function connect({ url, station, user, security }) {
  client = ua.OPCUAClient.create({
    applicationName: "umo-test",
    applicationUri: security?.uri ?? "urn:umo:test:client",
    endpointMustExist: false,
    keepSessionAlive: true,
    requestedSessionTimeout: 20000,
    connectionStrategy: { maxRetry: 0, initialDelay: 100, maxDelay: 100 },
    transportTimeout: 10000,
    securityMode: security ? ua.MessageSecurityMode.SignAndEncrypt : ua.MessageSecurityMode.None,
    securityPolicy: security ? ua.SecurityPolicy[security.policy ?? "Basic256Sha256"] : ua.SecurityPolicy.None,
    ...(security ? { certificateFile: security.certificate, privateKeyFile: security.key } : {}),
    clientCertificateManager: new OPCUACertificateManager({ rootFolder: process.env.UMO_PKI, automaticallyAcceptUnknownCertificate: true }),
  });
  await client.connect(url);
  session = await client.createSession(identity(user));
  const namespaces = await session.readNamespaceArray();
  namespace = namespaces.indexOf(`urn:umo:${station}`);
  return { namespaces };
}

function identity(user) {
  if (!user) return { type: ua.UserTokenType.Anonymous };
  if (user.password !== undefined) return { type: ua.UserTokenType.UserName, userName: user.name, password: user.password };
  const fs = require("node:fs");
  const der = convertPEMtoDER(fs.readFileSync(user.certificate, "utf8"));
  return { type: ua.UserTokenType.Certificate, certificateData: der, privateKey: fs.readFileSync(user.key, "utf8") };
}

const node = (name) => (/^(ns|i|s)=/.test(name) ? name : `ns=${namespace};s=${name}`);
const graded = (status) => (status.isGood() ? "good" : status.value & 0x80000000 ? "none" : "doubtful");

async function fixed(id) {
  if (!properties.has(id)) {
    const found = await session.browse({ nodeId: id, browseDirection: 0, referenceTypeId: "HasProperty", includeSubtypes: true, resultMask: 63 });
    const names = found.references.map((each) => each.browseName.name);
    const values = names.length ? await session.read(found.references.map((each) => ({ nodeId: each.nodeId, attributeId: ua.AttributeIds.Value }))) : [];
    properties.set(id, Object.fromEntries(names.map((name, n) => [name, values[n].value.value])));
  }
  return properties.get(id);
}

async function shown(id, data) {
  const about = data.value.value === null ? {} : await fixed(id);
  const states = about.TrueState
    ? { 0: about.FalseState.text, 1: about.TrueState.text }
    : Object.fromEntries((about.EnumValues ?? []).map((each) => [Number(each.value[1]) | 0, each.displayName.text]));
  const named = Object.keys(states).length > 0;
  const value = data.value.value;
  return {
    value: value === null || value === undefined ? null : named ? states[Number(value)] : value,
    grade: graded(data.statusCode),
    status: data.statusCode.name,
    time: data.sourceTimestamp ? data.sourceTimestamp.getTime() / 1000 : null,
    unit: about.EngineeringUnits?.displayName.text ?? null,
    code: about.EngineeringUnits?.unitId ?? null,
    minimum: about.EURange?.low ?? null,
    maximum: about.EURange?.high ?? null,
    states,
  };
}

async function read({ name }) {
  const id = node(name);
  const data = await session.read({ nodeId: id, attributeId: ua.AttributeIds.Value });
  return await shown(id, data);
}

const variant = (given) => {
  if (given === null) return {};
  if (given === "NaN") return { dataType: ua.DataType.Double, value: NaN };
  if (given?.type === "ByteString") return { dataType: ua.DataType.ByteString, value: Buffer.from(given.value, "hex") };
  if (given?.type === "LocalizedText") return { dataType: ua.DataType.LocalizedText, value: ua.coerceLocalizedText(given.value) };
  if (given && typeof given === "object") return { dataType: ua.DataType[given.type], value: given.value };
  if (typeof given === "boolean") return { dataType: ua.DataType.Boolean, value: given };
  return typeof given === "number" ? { dataType: ua.DataType.Double, value: given } : { dataType: ua.DataType.String, value: given };
};

/** Write several nodes in one request; the StatusCode and the words of each. */
async function write({ values }) {
  const request = new WriteRequest({
    requestHeader: { returnDiagnostics: WORDS },
    nodesToWrite: values.map(([name, value]) => ({ nodeId: node(name), attributeId: ua.AttributeIds.Value, value: { value: variant(value) } })),
  });
  const response = await session.performMessageTransaction(request);
  return { results: response.results.map((each, n) => ({ status: each.name, words: response.diagnosticInfos?.[n]?.additionalInfo ?? "" })) };
}

async function call({ object, method, given }) {
  const request = new CallRequest({
    requestHeader: { returnDiagnostics: WORDS, timeoutHint: 20000 },
    methodsToCall: [{ objectId: node(object), methodId: node(method), inputArguments: given.map(variant) }],
  });
  const response = await session.performMessageTransaction(request);
  const result = response.results[0];
  return {
    status: result.statusCode.name,
    words: response.diagnosticInfos?.[0]?.additionalInfo ?? "",
    inputs: (result.inputArgumentDiagnosticInfos ?? []).map((each) => each?.additionalInfo ?? ""),
    output: (result.outputArguments ?? []).map((each) => (typeof each.value === "bigint" || Array.isArray(each.value) ? Number(each.value[1] ?? each.value) : each.value)),
  };
}

async function browse({ name, reference }) {
  const found = await session.browse({ nodeId: name === "" ? "RootFolder" : node(name), browseDirection: 0, referenceTypeId: reference ?? "HierarchicalReferences", includeSubtypes: true, resultMask: 63 });
  return {
    references: found.references.map((each) => ({
      name: each.browseName.toString(), node: each.nodeId.toString(), kind: ua.NodeClass[each.nodeClass], type: each.typeDefinition?.toString() ?? "",
    })),
  };
}

async function path({ start, path: text }) {
  const result = await session.translateBrowsePath(ua.makeBrowsePath(start ? node(start) : "RootFolder", text));
  return { status: result.statusCode.name, targets: (result.targets ?? []).map((each) => each.targetId.toString()) };
}

const LATE = 2000; // ms
let counted = 0, late = 0; // values that the subscription has told, if they are only counted; those older than LATE

const counting = (data) => {
  counted++;
  late += Date.now() - data.sourceTimestamp.getTime() > LATE;
};

async function subscribe({ names, interval, sampling, queue, count }) {
  subscription = await session.createSubscription2({ requestedPublishingInterval: interval, requestedMaxKeepAliveCount: 5, requestedLifetimeCount: 100, maxNotificationsPerPublish: 0, publishingEnabled: true });
  const items = names.map((name) => ({ nodeId: node(name), attributeId: ua.AttributeIds.Value }));
  const group = ua.ClientMonitoredItemGroup.create(subscription, items, { samplingInterval: sampling ?? interval, queueSize: queue ?? 10, discardOldest: true }, ua.TimestampsToReturn.Both);
  group.on("changed", (item, data, n) => count ? counting(data) : heard.push([names[n], data.value.value, data.statusCode.name, data.sourceTimestamp?.getTime() / 1000]));
  await new Promise((resolve) => group.on("initialized", resolve));
  return { interval: subscription.publishingInterval, items: group.monitoredItems.filter((each) => each.statusCode.isGood()).length };
}

async function listen({ fields, type }) {
  subscription = await session.createSubscription2({ requestedPublishingInterval: 100, requestedMaxKeepAliveCount: 5, requestedLifetimeCount: 100, maxNotificationsPerPublish: 0, publishingEnabled: true });
  const filter = ua.constructEventFilter(fields, type ? ua.ofType(type) : undefined);
  const item = await subscription.monitor({ nodeId: "i=2253", attributeId: ua.AttributeIds.EventNotifier }, { samplingInterval: 0, queueSize: 100, discardOldest: true, filter }, ua.TimestampsToReturn.Both);
  item.on("changed", (values) => heard.push(Object.fromEntries(fields.map((each, n) => [each, plain(values[n].value)]))));
  return { status: item.statusCode.name };
}

const plain = (value) => (value === null || value === undefined ? null : value.text !== undefined ? value.text : value instanceof ua.NodeId ? value.toString() : value instanceof Date ? value.getTime() / 1000 : Buffer.isBuffer(value) ? value.toString("hex") : value);

/** A request of node-opcua as it is: `given` are the fields of its class. The code of the response, or of the fault. */
async function send({ request, given }) {
  const made = new types[`${request}Request`](revived(given));
  let response;
  try {
    response = await session.performMessageTransaction(made);
  } catch (error) {
    response = error.response;
    if (!response) throw error;
  }
  return { status: response.responseHeader.serviceResult.name, response: described(response) };
}

/** Node identifiers, variants, structures: {"node": ...}, {"type": ...}, {"class": ..., "given": ...}. */
function revived(value) {
  if (Array.isArray(value)) return value.map(revived);
  if (value === null || typeof value !== "object") return value === "NaN" ? NaN : value;
  if ("node" in value) return ua.resolveNodeId(value.node === "" ? "i=0" : node(value.node));
  if ("class" in value) return new types[value.class](revived(value.given));
  if ("type" in value) return new ua.Variant(variant(value));
  return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, revived(each)]));
}

const described = (value) => {
  if (value === null || value === undefined || typeof value !== "object") return value ?? null;
  if (value instanceof ua.StatusCode) return value.name;
  if (value instanceof ua.NodeId) return value.toString();
  if (Array.isArray(value)) return value.map(described);
  if (Buffer.isBuffer(value) || value instanceof Date) return plain(value);
  return Object.fromEntries(Object.entries(value).filter(([name]) => !name.startsWith("_")).map(([name, each]) => [name, described(each)]));
};

/** A monitored item with these parameters; what it tells is heard with its handle. */
async function monitor({ handle, name, interval, given }) {
  const mine = await session.createSubscription2({ requestedPublishingInterval: interval, requestedMaxKeepAliveCount: 5, requestedLifetimeCount: 100, maxNotificationsPerPublish: 0, publishingEnabled: true });
  const { mode, ...parameters } = revived(given);
  try {
    const item = await mine.monitor({ nodeId: node(name), attributeId: ua.AttributeIds.Value }, parameters, ua.TimestampsToReturn.Both, mode === undefined ? ua.MonitoringMode.Reporting : mode);
    item.on("changed", (data) => heard.push([handle, data.value.value, data.statusCode.name.split("#")[0], data.statusCode.name.includes("Overflow")]));
    return { status: item.statusCode.name };
  } catch (error) {
    return { status: (/Bad\w+/.exec(error.message) ?? [error.message])[0] };
  }
}

const doing = {
  send, monitor, connect, read, write, call, browse, path, subscribe, listen,
  arguments: async ({ name }) => {
    const told = await session.getArgumentDefinition(node(name));
    return { arguments: told.inputArguments.map((each) => [each.name, each.dataType.toString(), each.description.text]) };
  },
  text: async ({ name }) => ({ text: plain((await session.read({ nodeId: name, attributeId: ua.AttributeIds.Value })).value.value) }),
  refresh: async () => {
    const result = await session.call({ objectId: "i=2782", methodId: "i=3875", inputArguments: [{ dataType: ua.DataType.UInt32, value: subscription.subscriptionId }] });
    return { status: result.statusCode.name };
  },
  counted: async () => ({ count: counted, late }),
  heard: async () => ({ heard: heard.splice(0) }),
  endpoints: async ({ url }) => {
    const found = ua.OPCUAClient.create({ endpointMustExist: false, connectionStrategy: { maxRetry: 0 } });
    await found.connect(url);
    const all = await found.getEndpoints();
    await found.disconnect();
    return { endpoints: all.map((each) => [each.securityPolicyUri.split("#")[1], ua.MessageSecurityMode[each.securityMode]]) };
  },
  close: async () => {
    if (session) await session.close(true).catch(() => null);
    if (client) await client.disconnect().catch(() => null);
    return {};
  },
};

readline.createInterface({ input: process.stdin }).on("line", async (line) => {
  const asked = JSON.parse(line);
  let answer;
  try {
    answer = await doing[asked.do](asked);
  } catch (error) {
    answer = { refused: String(error.message ?? error), status: error.response?.responseHeader?.serviceResult?.name ?? "" };
  }
  process.stdout.write(`${JSON.stringify({ id: asked.id, ...answer })}\n`);
  if (asked.do === "close") process.exit(0);
});
process.stdin.on("end", () => process.exit(0));
