// A cell of the browser test: its own folder, `rcc-cli up`, the dashboard, and requests to its loader.

import { spawn, execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, existsSync, mkdirSync } from "node:fs";
import { request } from "node:http";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";

export const root = resolve(import.meta.dirname ?? new URL(".", import.meta.url).pathname, "../..");
const programs = process.env.RCC_PROGRAMS || join(root, "target/debug");
const LIMIT_MS = 60_000;

/** Waits until `look` returns something true. */
export async function until(what, look, limit = LIMIT_MS) {
  const begun = Date.now();
  for (;;) {
    const found = await look();
    if (found) return found;
    if (Date.now() - begun > limit) throw new Error(`waited in vain for ${what}`);
    await new Promise((done) => setTimeout(done, 50));
  }
}

export class Cell {
  constructor() {
    const memory = existsSync("/dev/shm") ? "/dev/shm" : tmpdir();
    this.folder = mkdtempSync(join(memory, "rcc-b-"));
    mkdirSync(join(this.folder, "run"), { mode: 0o700 });
    this.env = { ...process.env, RCC_RUNTIME_DIR: join(this.folder, "run"), RCC_STATE_DIR: join(this.folder, "state"), NO_COLOR: "1", RCC_CELL: "demo" };
    this.children = [];
    this.output = "";
  }

  async start() {
    this.up = this.program("rcc-cli", ["up", join(root, "configs/cells/demo.yaml")]);
    await until("the cell", async () => {
      if (this.up.exitCode !== null) throw new Error(`rcc-cli up ended: ${this.output}`);
      const devices = await this.rest("GET", "/devices").catch(() => null);
      return Array.isArray(devices?.body) && devices.body.length && devices.body.every((device) => device.state === "ready");
    });
  }

  program(name, args) {
    const child = spawn(join(programs, name), args, { env: this.env, stdio: ["ignore", "pipe", "pipe"] });
    this.children.push(child);
    child.text = "";
    child.stdout.on("data", (data) => { child.text += data; });
    for (const stream of [child.stdout, child.stderr]) stream.on("data", (data) => { this.output = (this.output + data).slice(-20_000); });
    return child;
  }

  /** Starts the dashboard; returns its process, address and origin. */
  async serve() {
    const child = this.program("rcc-monitor", ["serve", "--port", "0"]);
    const address = await until("the dashboard's address", () => {
      if (child.exitCode !== null) throw new Error(`rcc-monitor serve ended: ${this.output}`);
      return /http:\S+/.exec(child.text)?.[0];
    });
    return { child, address, origin: new URL(address).origin };
  }

  rest(method, path, body = "") {
    return new Promise((done, failed) => {
      const asked = request({ socketPath: join(this.folder, "run/demo/loader.sock"), method, path, headers: { host: "rcc", "content-length": Buffer.byteLength(body) } }, (response) => {
        let text = "";
        response.on("data", (data) => { text += data; });
        response.on("error", failed);
        response.on("end", () => {
          try {
            done({ status: response.statusCode, body: JSON.parse(text) });
          } catch (error) {
            failed(error);
          }
        });
      });
      asked.on("error", failed);
      asked.end(body);
    });
  }

  example(name) {
    return readFileSync(join(root, "configs/nets", name), "utf8");
  }

  async load(text) {
    const { body } = await this.rest("POST", "/commands", text);
    await until(`command ${body.id} to be ready`, async () => {
      const row = (await this.rest("GET", `/commands/${body.id}?brief=true`)).body;
      if (row.state === "rejected") throw new Error(JSON.stringify(row.diagnostics));
      return row.state === "ready";
    });
    return body.id;
  }

  async run(text) {
    const id = await this.load(text);
    await until(`the start of ${id}`, async () => {
      const { status, body } = await this.rest("POST", `/commands/${id}/start`);
      // The device still comes to rest.
      if (status !== 200 && body.code !== "RCC3008") throw new Error(body.message);
      return status === 200;
    });
    return id;
  }

  /** Kills a process of the cell and waits until its successor is announced. */
  async kill(role) {
    const announced = async () => (await this.rest("GET", "/status").catch(() => null))?.body?.processes?.find((one) => one.role === role && one.alive);
    const dead = await until(`the ${role}`, announced);
    process.kill(dead.pid, "SIGKILL");
    await until(`a successor of the ${role}`, async () => {
      const now = await announced();
      return now && now.incarnation !== dead.incarnation;
    });
    await until("the devices", async () => {
      const devices = (await this.rest("GET", "/devices").catch(() => null))?.body;
      return Array.isArray(devices) && devices.every((device) => device.state === "ready");
    });
  }

  async stop() {
    for (const child of [...this.children].reverse()) {
      if (child.exitCode !== null || child.signalCode !== null) continue;
      const ended = new Promise((done) => child.once("exit", done));
      child.kill("SIGINT");
      const timer = setTimeout(() => child.kill("SIGKILL"), 20_000);
      await ended;
      clearTimeout(timer);
    }
    rmSync(this.folder, { recursive: true, force: true });
  }
}

export const sizeOf = (path) => Number(execFileSync("stat", ["-c", "%s", path]));
