// A viewer of the gateway: Foxglove's own client library, which collects what it is told.

import { createRequire } from "node:module";
import { join } from "node:path";
import { root, until } from "../browser/cell.mjs";

const require = createRequire(join(root, "target/foxglove/"));
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
export const { McapStreamReader } = require("@mcap/core");
export const WebSocket = require("ws");

/** Opens a connection and returns the HTTP status with which it is refused; 101 if it is not. */
export function refusal(address, { protocols = ["foxglove.websocket.v1"], ...options } = {}) {
  return new Promise((done, failed) => {
    const socket = new WebSocket(address, protocols, options);
    socket.on("open", () => { socket.terminate(); done(101); });
    socket.on("unexpected-response", (_, response) => { response.resume(); socket.terminate(); done(response.statusCode); });
    // After a refusal the library complains about its own end.
    socket.on("error", (error) => failed(error));
  });
}

export class Viewer {
  constructor(address, protocol = "foxglove.websocket.v1") {
    this.socket = new WebSocket(address, [protocol]);
    this.client = new FoxgloveClient({ ws: this.socket });
    this.info = null;
    this.channels = new Map();
    this.services = new Map();
    this.statuses = [];
    this.removed = [];
    this.parameters = new Map();
    this.answers = new Map();
    this.messages = new Map();
    this.errors = [];
    this.closed = null;
    this.calls = 0;
    const { client } = this;
    client.on("serverInfo", (info) => { this.info = info; });
    client.on("advertise", (channels) => channels.forEach((one) => this.channels.set(one.id, one)));
    client.on("unadvertise", (ids) => ids.forEach((id) => this.channels.delete(id)));
    client.on("advertiseServices", (services) => services.forEach((one) => this.services.set(one.name, one)));
    client.on("status", (status) => this.statuses.push(status));
    client.on("removeStatus", ({ statusIds }) => this.removed.push(...statusIds));
    client.on("parameterValues", ({ parameters, id }) => {
      for (const one of parameters) this.parameters.set(one.name, one);
      if (id) this.answers.set(id, parameters);
    });
    client.on("message", ({ subscriptionId, timestamp, data }) => this.messages.get(subscriptionId)?.({ timestamp, data }));
    client.on("error", (error) => this.errors.push(error));
    client.on("close", (event) => { this.closed = event; });
  }

  async ready() {
    await until("the server's information", () => {
      if (this.closed || this.errors.length) throw new Error(`not connected: ${this.errors} ${this.closed?.code}`);
      return this.info;
    });
    return this;
  }

  async channel(topic) {
    return until(`the channel ${topic}`, () => [...this.channels.values()].find((one) => one.topic === topic));
  }

  /** Subscribes to a topic; returns its messages, which grow: decoded, with time and bytes. */
  async subscribe(topic) {
    const channel = await this.channel(topic);
    const reader = new MessageReader(parse(channel.schema, { ros2: true }));
    const messages = [];
    this.messages.set(this.client.subscribe(channel.id), ({ timestamp, data }) => {
      messages.push({ time: timestamp, bytes: Buffer.from(data.buffer, data.byteOffset, data.byteLength), value: reader.readMessage(data) });
    });
    return messages;
  }

  async getParameters(names = []) {
    const id = `get-${++this.calls}`;
    this.client.getParameters(names, id);
    return until("parameters", () => this.answers.get(id));
  }

  async setParameters(parameters) {
    const id = `set-${++this.calls}`;
    this.client.setParameters(parameters, id);
    return until("the answer to setting parameters", () => this.answers.get(id));
  }

  /** Calls a service; returns its answer, or throws what it says. */
  async call(name, request) {
    const service = await until(`the service ${name}`, () => this.services.get(name));
    return this.callId(service.id, request);
  }

  async callId(serviceId, request) {
    const callId = ++this.calls;
    let answer = null;
    const answered = (event) => { if (event.callId === callId) answer = { value: JSON.parse(new TextDecoder().decode(event.data)) }; };
    const failed = (event) => { if (event.callId === callId) answer = { failure: event.message }; };
    this.client.on("serviceCallResponse", answered);
    this.client.on("serviceCallFailure", failed);
    this.client.sendServiceCallRequest({ serviceId, callId, encoding: "json", data: new TextEncoder().encode(JSON.stringify(request)) });
    await until(`the answer of service ${serviceId}`, () => answer);
    this.client.off("serviceCallResponse", answered);
    this.client.off("serviceCallFailure", failed);
    if (answer.failure !== undefined) throw new Error(answer.failure);
    return answer.value;
  }

  status(pattern) {
    return until(`a status like ${pattern}`, () => this.statuses.find((one) => pattern.test(one.message)));
  }

  async close() {
    this.client.close();
    await until("the end of the connection", () => this.closed);
  }
}
