// The gateway for Foxglove and Lichtblick beside a real cell. `.ci/foxglove` runs it.

import assert from "node:assert/strict";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { Cell, until } from "../browser/cell.mjs";
import { McapStreamReader, Viewer, WebSocket, refusal } from "./viewer.mjs";

/** Runs until it is canceled, and watches its clock in every cycle. */
const WATCHED = `net: watched
primitives:
  cancel: {type: Cancel}
  clock: {type: Time}
  end: {type: Termination, inputs: {done: cancel.requested}}
  watch: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: clock.out}}
`;

const cell = new Cell();

async function step(name, work) {
  const begun = Date.now();
  await work();
  console.log(`${((Date.now() - begun) / 1000).toFixed(1).padStart(6)} s  ${name}`);
}

/** Starts the gateway on any free port; returns its process and its address. */
async function gateway(...more) {
  const bind = more.includes("--bind") ? [] : ["--bind", "127.0.0.1:0"];
  const child = cell.program("rcc-foxglove", [...bind, ...more]);
  const address = await until("the gateway's address", () => {
    if (child.exitCode !== null) throw new Error(`rcc-foxglove ended: ${cell.output}`);
    return /ws:\S+/.exec(child.text)?.[0];
  });
  return { child, address };
}

const ended = (child) => until("the end of a program", () => child.exitCode !== null || child.signalCode !== null);
const parameter = (list, name) => list.find((one) => one.name === name);
const state = async (id) => (await cell.rest("GET", `/commands/${id}?brief=true`)).body;
const late = async () => (await cell.rest("GET", "/status")).body.executor.late;
const inputs = (id, values) => cell.rest("PUT", `/commands/${id}/inputs`, JSON.stringify(values));

/** Messages of a topic in a recording, by their cycle. */
function recorded(path, topic) {
  const reader = new McapStreamReader();
  reader.append(readFileSync(path));
  const channels = new Map();
  const found = new Map();
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Channel") channels.set(record.id, record.topic);
    if (record.type === "Message" && channels.get(record.channelId) === topic) found.set(cycleOf(record.data), Buffer.from(record.data));
  }
  return found;
}

/** The first field of the table of a net, after the four bytes that say how it is encoded. */
const cycleOf = (data) => new DataView(data.buffer, data.byteOffset, data.byteLength).getBigUint64(4, true);

async function main() {
  await cell.start();
  const plain = await gateway();
  const viewer = await new Viewer(plain.address).ready();

  await step("a viewer is told the cell, its channels, and no services", async () => {
    assert.equal(viewer.info.name, "rcc demo");
    assert.deepEqual(viewer.info.capabilities, ["parameters", "parametersSubscribe"]);
    for (const topic of ["/tf", "/rosout", "/diagnostics", "/robot_description", "/devices/lwr", "/devices/io", "/lwr/measured/joint_states", "/lwr/commanded/pose", "/lwr/measured/wrench"]) {
      const channel = await viewer.channel(topic);
      assert.deepEqual([channel.encoding, channel.schemaEncoding], ["cdr", "ros2msg"], topic);
    }
    const sdk = await new Viewer(plain.address, "foxglove.sdk.v1").ready();
    assert.equal(sdk.socket.protocol, "foxglove.sdk.v1");
    await sdk.close();
  });

  await step("the arm, its description, diagnostics and events are decoded", async () => {
    const [description] = await until("the description", ((list) => async () => (await list).length && list)(viewer.subscribe("/robot_description")));
    assert.match(description.value.data, /<robot name="demo">[^]*lwr_joint_7/);
    const joints = await viewer.subscribe("/lwr/measured/joint_states");
    const frames = await viewer.subscribe("/tf");
    const health = await viewer.subscribe("/diagnostics");
    const log = await viewer.subscribe("/rosout");
    await until("messages of all", () => joints.length > 20 && frames.length > 20 && health.length);
    const last = joints.at(-1).value;
    assert.deepEqual(last.name, [1, 2, 3, 4, 5, 6, 7].map((number) => `lwr_joint_${number}`));
    assert.ok(last.position.length === 7 && last.position.every(Number.isFinite));
    const seconds = joints.at(-1).time - joints[0].time;
    const rate = (joints.length - 1) / (Number(seconds) * 1e-9);
    assert.ok(rate < 130, `${rate} Hz`);
    assert.deepEqual(frames.at(-1).value.transforms.map((one) => one.child_frame_id).slice(0, 2), ["lwr_base", "lwr_link_1"]);
    assert.deepEqual(health.at(-1).value.status.map((one) => one.name), ["executor", "device lwr", "device io", "foxglove"]);
    const id = await cell.run(WATCHED);
    await until("the event of the start", () => log.find((one) => one.value.msg.includes(`#${id}`)));
    await cell.rest("POST", `/commands/${id}/cancel`);
  });

  await step("what a net sends live is what a recording of it contains, byte by byte", async () => {
    const all = await gateway("--rate", "1000");
    const fast = await new Viewer(all.address).ready();
    const path = join(cell.folder, "run.mcap");
    const recorder = cell.program("rcc-monitor", ["record", path]);
    await until("the recorder", () => existsSync(path));
    await fast.channel("/devices/lwr");
    const id = await cell.run(cell.example("circle.yaml"));
    const live = await fast.subscribe("/nets/circle");
    await until("the end of the circle", async () => (await state(id)).state === "terminated");
    await until("its last messages", async () => (await state(id)).ended_cycle - Number(live.at(-1).value.cycle) < 100);
    recorder.kill("SIGINT");
    await ended(recorder);
    const file = recorded(path, "/nets/circle");
    const same = live.filter((one) => file.get(one.value.cycle)?.equals(one.bytes)).length;
    const missing = live.filter((one) => !file.has(one.value.cycle)).length;
    console.log(`          ${live.length} live, ${file.size} recorded, ${missing} of the live ones not recorded`);
    assert.equal(same, live.length - missing, "the same cycle has the same bytes");
    assert.ok(live.length > 1000 && same > 0.95 * live.length, "most cycles are in both");
    assert.equal(live.at(-1).value.move_joints.length, 7);
    // A second net of this name with another monitor takes the topic.
    const before = (await fast.channel("/nets/circle")).id;
    const other = await cell.run(cell.example("circle.yaml").replace(/\n  watch_joints:.*/, "\n"));
    await until("the new type", async () => (await fast.channel("/nets/circle")).id !== before);
    assert.doesNotMatch((await fast.channel("/nets/circle")).schema, /move_joints/);
    await cell.rest("POST", `/commands/${other}/cancel`);
    await fast.close();
    all.child.kill("SIGINT");
    await ended(all.child);
    assert.equal(all.child.exitCode, 0);
  });

  const belt = await cell.run(cell.example("belt.yaml"));

  await step("Inputs are parameters, which are read and watched, but not set", async () => {
    const all = await viewer.getParameters();
    assert.deepEqual(all.map((one) => one.name), ["belt/lamp", "belt/speed"]);
    assert.deepEqual(parameter(all, "belt/speed"), { name: "belt/speed", value: "null" });
    assert.equal(parameter(all, "belt/lamp").value, false);
    viewer.client.subscribeParameterUpdates(["belt/lamp"]);
    await inputs(belt, { lamp: true });
    await until("the changed lamp", () => viewer.parameters.get("belt/lamp")?.value === true);
    const refused = await viewer.setParameters([{ name: "belt/lamp", value: false }]);
    assert.deepEqual(refused, [{ name: "belt/lamp", value: true }], "the value that holds is told");
    await viewer.status(/--control/);
    await assert.rejects(viewer.callId(2, { net: "belt" }), /--control/);
    assert.equal((await state(belt)).state, "running");
  });

  await step("with --control, parameters are set, and LOAD, START and CANCEL are services", async () => {
    const control = await gateway("--control");
    const operator = await new Viewer(control.address).ready();
    assert.ok(operator.info.capabilities.includes("services"));
    const set = await operator.setParameters([{ name: "belt/speed", value: 0.2 }, { name: "belt/lamp", value: false }]);
    assert.deepEqual(parameter(set, "belt/speed"), { name: "belt/speed", value: 0.2, type: "float64" });
    assert.equal(parameter(set, "belt/lamp").value, false);
    await until("the lamp, at the other viewer", () => viewer.parameters.get("belt/lamp")?.value === false);
    // Texts are constants of the language; its check refuses what is out of range or has no such input.
    assert.equal(parameter(await operator.setParameters([{ name: "belt/speed", value: "300 mm/s" }]), "belt/speed").value, 0.3);
    await operator.setParameters([{ name: "belt/speed", value: 7 }]);
    await operator.status(/no parameter was set: RCC/);
    await operator.setParameters([{ name: "belt/none", value: 1 }]);
    await operator.status(/no parameter `belt\/none`/);
    assert.equal(parameter(await operator.setParameters([{ name: "belt/speed", value: "null" }]), "belt/speed").value, "null");

    await assert.rejects(operator.call("/rcc/load", { text: "net: x\nprimitives: {a: {type: Nothing}}\n" }), /RCC1/);
    await assert.rejects(operator.call("/rcc/start", { net: "no-such-net" }), /RCC3001/);
    await assert.rejects(operator.call("/rcc/start", { name: "belt" }), /not understood/);
    const loaded = await operator.call("/rcc/load", { text: WATCHED });
    assert.equal((await state(loaded.id)).state, "ready");
    assert.equal((await operator.call("/rcc/start", { net: loaded.net })).id, loaded.id);
    assert.equal((await state(loaded.id)).state, "running");
    await operator.call("/rcc/cancel", { net: `${loaded.net}#${loaded.id}` });
    await until("the end of the net", async () => (await state(loaded.id)).reason === "canceled");
    await operator.close();
    control.child.kill("SIGTERM");
    await ended(control.child);
  });

  await step("other pages, foreign names, and clients without the token are refused", async () => {
    const url = new URL(plain.address);
    const bare = `ws://${url.host}/`;
    assert.equal(await refusal(bare), 401);
    assert.equal(await refusal(`${bare}?token=0123456789abcdef0123456789abcdef`), 403);
    assert.equal(await refusal(plain.address, { origin: "https://evil.example" }), 403);
    assert.equal(await refusal(plain.address, { origin: `http://${url.host}` }), 403);
    assert.equal(await refusal(plain.address, { headers: { host: `evil.example:${url.port}` } }), 421);
    assert.equal(await refusal(plain.address, { protocols: ["rosbridge"] }), 400);
    for (const origin of ["file://", "https://app.foxglove.dev"]) assert.equal(await refusal(plain.address, { origin }), 101);
    // Other machines: only with a token of a private file.
    const open = cell.program("rcc-foxglove", ["--bind", "0.0.0.0:0"]);
    await ended(open);
    assert.equal(open.exitCode, 1);
    assert.match(cell.output, /0\.0\.0\.0:0 is reached by other machines: add --token-file/);
    const [file, token] = [join(cell.folder, "token"), "fedcba9876543210fedcba9876543210"];
    writeFileSync(file, token, { mode: 0o600 });
    const reached = await gateway("--bind", "0.0.0.0:0", "--token-file", file, "--host", "robot", "--origin", "http://localhost:8080");
    const port = new URL(reached.address).port;
    assert.ok(!reached.child.text.includes(token), "the token stays in its file");
    assert.equal(await refusal(`ws://127.0.0.1:${port}/`), 401);
    const address = `ws://127.0.0.1:${port}/?token=${token}`;
    assert.equal(await refusal(address, { headers: { host: `robot:${port}` }, origin: "http://localhost:8080" }), 101);
    assert.equal(await refusal(address, { headers: { host: `other:${port}` } }), 421);
    assert.equal(await refusal(`ws://127.0.0.1:${port}/`, { headers: { authorization: `Bearer ${token}` } }), 101);
    reached.child.kill("SIGTERM");
    await ended(reached.child);
  });

  await step("a client that stops reading loses the oldest, is disconnected, and the others lose nothing", async () => {
    const all = await gateway("--rate", "1000");
    const good = await new Viewer(all.address).ready();
    const seen = await good.subscribe("/devices/lwr");
    const slow = await new Viewer(all.address).ready();
    await slow.channel("/devices/lwr");
    for (let number = 0; number < 40; number++) await slow.subscribe("/devices/lwr");
    const before = { count: seen.length, late: await late() };
    slow.socket._socket.pause();
    await until("the gateway to give it up", () => /took nothing for 10s and was disconnected; \d+ messages had been dropped/.test(cell.output), 90_000);
    const [, dropped] = /disconnected; (\d+) messages/.exec(cell.output);
    const after = { count: seen.length, late: await late() };
    console.log(`          ${dropped} messages dropped for it; the other got ${after.count - before.count}; late cycles ${before.late} → ${after.late}`);
    assert.ok(Number(dropped) > 1000);
    assert.ok(!good.closed && !good.statuses.some((one) => one.id === "slow"), "the other lost nothing");
    // A pause that is shorter costs messages, and the viewer is told how many.
    const tired = await new Viewer(all.address).ready();
    await tired.channel("/devices/lwr");
    for (let number = 0; number < 40; number++) await tired.subscribe("/devices/lwr");
    tired.socket._socket.pause();
    const begun = seen.length;
    await until("more messages than buffers hold", () => seen.length > begun + 5000);
    tired.socket._socket.resume();
    await tired.status(/messages were dropped: this viewer reads too slowly/);
    assert.equal(tired.closed, null);
    await tired.close();
    slow.socket.terminate();
    // Garbage ends nothing but what was garbage.
    good.socket.send("no JSON");
    good.socket.send(new Uint8Array([2, 1, 2]));
    good.socket.send(JSON.stringify({ op: "subscribe", subscriptions: [{ id: 999, channelId: 9999 }] }));
    good.socket.send(JSON.stringify({ op: "fetchAsset", uri: "x", requestId: 1 }));
    for (const words of [/request not understood/, /frame not understood/, /no channel 9999/, /not offered/]) await good.status(words);
    const now = seen.length;
    await until("further messages", () => seen.length > now + 100);
    await good.close();
    all.child.kill("SIGTERM");
    await ended(all.child);
  });

  await step("viewers stay connected while executor and loader are killed, and everything goes on", async () => {
    const joints = await viewer.subscribe("/lwr/measured/joint_states");
    await cell.kill("loader");
    await until("parameters, again", async () => (await viewer.getParameters()).length === 2);
    await cell.kill("executor");
    await viewer.status(/has no executor/);
    await until("the executor, again", () => viewer.removed.includes("cell"));
    const now = joints.length;
    await until("further messages", () => joints.length > now + 10);
    const values = await viewer.subscribe("/nets/watched");
    await cell.run(WATCHED);
    await until("values of a net of the new executor", () => values.length > 10);
    assert.equal(viewer.closed, null);
    assert.deepEqual(viewer.errors, []);
  });

  await step("the end of the gateway is told, and without viewers it is not in the cell", async () => {
    plain.child.kill("SIGINT");
    await until("the end of the connection", () => viewer.closed);
    assert.equal(viewer.closed.code, 1001);
    await ended(plain.child);
    assert.equal(plain.child.exitCode, 0);
    const idle = await gateway();
    const isInCell = () => readFileSync(`/proc/${idle.child.pid}/maps`, "utf8").includes("/dev/shm/rcc_");
    assert.equal(isInCell(), false);
    const socket = new WebSocket(idle.address, ["foxglove.websocket.v1"]);
    await until("the gateway in the cell", isInCell);
    socket.terminate();
    await until("the gateway to leave", () => !isInCell());
    idle.child.kill("SIGINT");
    await ended(idle.child);
  });
}

try {
  await main();
  console.log("Foxglove's client sees the cell");
} catch (error) {
  console.error(error, cell.output);
  process.exitCode = 1;
} finally {
  await cell.stop();
}
