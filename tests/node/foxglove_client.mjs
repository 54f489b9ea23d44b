// Foxglove's own client: subscribes to every channel, and tries to publish. After some seconds, and once there was a message of
// each topic that is named, it prints JSON: the server's capabilities and words, and of each channel its schema, the number of
// messages, and the last one (base64).
//
//     node foxglove_client.mjs ws://127.0.0.1:8765 5 /map/occupancy /tf …

import protocol from "@foxglove/ws-protocol";
import { WebSocket } from "ws";

const [url, seconds, ...wanted] = process.argv.slice(2);
// The name of the protocol since 2025; its messages are the same.
const client = new protocol.FoxgloveClient({ ws: new WebSocket(url, ["foxglove.sdk.v1"]) });
const report = { capabilities: null, words: [], channels: {} };
const topics = new Map();
let isOver = false;

function end(code) {
  if (isOver) return;
  isOver = true;
  // A pipe takes megabytes later.
  process.stdout.write(JSON.stringify(report), () => process.exit(code));
}

client.on("error", (error) => {
  if (!isOver) {
    console.error(error);
    process.exit(1);
  }
});
client.on("serverInfo", ({ capabilities }) => (report.capabilities = capabilities));
client.on("status", ({ message }) => report.words.push(message));
client.on("advertise", (channels) => {
  for (const { id, topic, encoding, schemaName, schema, schemaEncoding } of channels) {
    report.channels[topic] = { encoding, schemaName, schema, schemaEncoding, count: 0 };
    topics.set(client.subscribe(id), topic);
  }
});
client.on("message", ({ subscriptionId, data }) => {
  const channel = report.channels[topics.get(subscriptionId)];
  channel.count += 1;
  channel.data = Buffer.from(data.buffer, data.byteOffset, data.byteLength).toString("base64");
});
client.on("open", () => {
  const channel = client.advertise({ topic: "/cmd_vel", encoding: "json", schemaName: "geometry_msgs/Twist" });
  client.sendMessage(channel, new TextEncoder().encode('{"linear":{"x":1}}'));
});
const began = Date.now();
setInterval(() => {
  report.seconds = (Date.now() - began) / 1000;
  if (report.seconds > seconds && wanted.every((topic) => report.channels[topic]?.data)) end(0);
}, 100);
setTimeout(() => end(1), 120_000);
