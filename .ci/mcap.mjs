// Prints each message of an MCAP file as a line of JSON, decoded with the libraries of Foxglove and Lichtblick; null is NaN.
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";

const require = createRequire(process.cwd() + "/target/mcap/");
const { McapStreamReader } = require("@mcap/core");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");

const reader = new McapStreamReader();
reader.append(await readFile(process.argv[2]));
const [schemas, channels] = [new Map(), new Map()];
const plain = (_, value) => {
  if (typeof value === "bigint") return Number(value);
  if (typeof value === "number" && Number.isNaN(value)) return null;
  if (ArrayBuffer.isView(value)) return Array.from(value, (one) => (Number.isNaN(one) ? null : Number(one)));
  return value;
};
for (let record; (record = reader.nextRecord()); ) {
  if (record.type === "Schema") {
    const text = new TextDecoder().decode(record.data);
    schemas.set(record.id, new MessageReader(parse(text, { ros2: true })));
  } else if (record.type === "Channel") {
    channels.set(record.id, record);
  } else if (record.type === "Message") {
    const { topic, schemaId } = channels.get(record.channelId);
    const message = schemas.get(schemaId).readMessage(record.data);
    console.log(JSON.stringify([topic, Number(record.logTime), message], plain));
  }
}
