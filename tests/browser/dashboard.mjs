// The dashboard in Debian's Chromium, beside a real cell. `.ci/browser` runs it.

import assert from "node:assert/strict";
import { connect } from "node:net";
import { join } from "node:path";
import { Cell, root, until } from "./cell.mjs";

const { chromium } = await import(join(root, "target/browser/node_modules/playwright-core/index.mjs"));
const argument = (name) => process.argv.indexOf(name);
const minutes = argument("--minutes") > 0 ? Number(process.argv[argument("--minutes") + 1]) : 0.25;
const pictures = argument("--pictures") > 0;
/** Files of the page from the source tree instead of the program, for work on the page: nothing has to be built. */
const fromSource = argument("--source") > 0;
const TYPES = { js: "text/javascript", css: "text/css", svg: "image/svg+xml" };

const NETS = 200;
/** The executor's table has 64 places; some are taken by the nets of the other steps. */
const AT_A_TIME = 50;
/** Growth of the page's memory after garbage collection that is no leak: buffers of curves and compiled code. */
const GROWTH_MAX = 12 << 20;
const VIEWS = ["overview", "nets", "curves", "scope", "arms", "events", "incidents"];
const FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--js-flags=--expose-gc"];

const small = (number) => `net: small-${number}
primitives:
  blink: {type: Blink, parameters: {on: 250 ms, off: 250 ms}}
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: cancel.requested}}
discard: [blink.out]
`;

const cell = new Cell();
let browser = null;
const troubles = [];

async function step(name, work) {
  const begun = Date.now();
  await work();
  assert.deepEqual(troubles, [], `${name}: the page complains`);
  console.log(`${((Date.now() - begun) / 1000).toFixed(1).padStart(6)} s  ${name}`);
}

async function openPage(server, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 820 }, acceptDownloads: true, ...options });
  const page = await context.newPage();
  page.on("pageerror", (error) => troubles.push(error.message));
  page.on("console", (message) => {
    // A server that is restarted on purpose is told by the network, not by the page.
    if (message.type() === "error" && !/Failed to load resource|net::ERR/.test(message.text())) troubles.push(message.text());
  });
  page.on("request", (request) => {
    if (!request.url().startsWith(server.origin) && !request.url().startsWith("blob:")) troubles.push(`foreign request ${request.url()}`);
  });
  if (fromSource) {
    await page.route("**/assets/**", (route) => {
      const path = new URL(route.request().url()).pathname.replace("/assets/", "");
      return route.fulfill({ path: join(root, "rcc-monitor/src/serve/page", path), contentType: TYPES[path.split(".").pop()] });
    });
  }
  await page.goto(server.address);
  assert.ok(!page.url().includes("token"), "the token stays in the address");
  await page.waitForFunction(() => globalThis.rcc?.state?.cell?.status);
  return page;
}

const go = async (page, hash) => {
  await page.evaluate((hash) => { location.hash = `#/${hash}`; }, hash);
  await page.waitForFunction((view) => document.getElementById("view").classList.contains(`view-${view}`), hash.split("/")[0]);
};

async function pick(page, text) {
  await page.fill(".picker input", text);
  await page.waitForFunction(() => document.querySelector(".options li[aria-selected=true]"));
  await page.press(".picker input", "Enter");
  await page.press(".picker input", "Escape");
  await page.evaluate(() => document.activeElement.blur());
}

/** The pictures of docs/dashboard.md; others are of use while the page is changed. */
const KEPT = ["overview", "net", "curves", "scope", "arms"];
const picture = async (page, name) => {
  if (pictures && KEPT.includes(name)) await page.screenshot({ path: join(root, `docs/pictures/dashboard-${name}.png`) });
};

async function main() {
  await cell.start();
  let server = await cell.serve();
  browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: FLAGS });
  const page = await openPage(server);
  const belt = await cell.run(cell.example("belt.yaml"));
  let speed = 0;
  const setting = setInterval(async () => {
    const next = speed === 0.1 ? 0.3 : 0.1;
    const body = JSON.stringify({ speed: next, lamp: next > 0.2 });
    // What was not taken is set again, so that the value always changes in the end.
    const answer = await cell.rest("PUT", "/commands/belt/inputs", body).catch(() => null);
    if (answer?.status === 200) speed = next;
  }, 900);
  // Does not keep this program alive after a step has failed.
  setting.unref();

  await step("the overview shows devices, nets and timing", async () => {
    await page.waitForSelector(".device:has-text('lwr') .badge.good");
    await page.waitForSelector(".card:has-text('belt') .badge.run");
    await page.waitForSelector(".bars i");
    await until("the number of running nets", async () => (await page.textContent("#cancel-count")) === "1");
    await picture(page, "overview");
  });

  await step("the graph of a net shows live values, and a click draws a curve", async () => {
    await go(page, `net/${belt}`);
    const label = page.locator("g.primitive[data-id=soft] text.live");
    await label.waitFor();
    await until("a live value", async () => /m\/s/.test(await label.textContent()) && /\d/.test(await label.textContent()));
    const first = await label.textContent();
    await until("another value", async () => (await label.textContent()) !== first);
    await picture(page, "net");
    await label.click();
    await page.waitForSelector(".chip:has-text('belt/soft.out')");
  });

  await step("curves of sampled and monitored ports are drawn, paused and continued", async () => {
    await pick(page, "belt wanted.out");
    const circle = await cell.load(cell.example("circle.yaml"));
    await page.waitForFunction((id) => globalThis.rcc.state.nets.get(id)?.state === "ready", circle);
    await pick(page, "circle move.joints");
    await until("the start", async () => (await cell.rest("POST", `/commands/${circle}/start`)).status === 200);
    await until("two plots", async () => (await page.locator(".plot canvas").count()) >= 2);
    await page.waitForTimeout(pictures ? 8000 : 500);
    await picture(page, "curves");
    const range = () => page.evaluate(() => document.querySelector(".u-axis") && performance.now());
    assert.ok(await range());
    await page.keyboard.press(" ");
    assert.equal(await page.getAttribute("button:has-text('Continue')", "aria-pressed"), "true");
    await page.keyboard.press(" ");
    const [saved] = await Promise.all([page.waitForEvent("download"), page.click("button:has-text('CSV')")]);
    const text = (await (await import("node:fs/promises")).readFile(await saved.path())).toString();
    assert.match(text, /^"time_s","belt\/soft\.out"/);
    assert.ok(text.split("\n").length > 20, text);
  });

  await step("the scope waits for an edge and keeps what was before it", async () => {
    await go(page, "scope");
    await pick(page, "belt soft.out");
    await page.fill("[aria-label=Level]", "0.2");
    await page.dispatchEvent("[aria-label=Level]", "change");
    const over = page.locator(".u-over");
    // The first capture lacks what was before the edge if the values have only just begun to arrive.
    await until("a capture that rises through 0.2", async () => {
      await page.waitForSelector(".badge:has-text('complete')");
      const box = await over.boundingBox();
      await page.mouse.click(box.x + box.width * 0.1, box.y + 50);
      await page.keyboard.down("Shift");
      await page.mouse.click(box.x + box.width * 0.6, box.y + 50);
      await page.keyboard.up("Shift");
      const row = await page.locator(".cursors tbody tr").first().locator("td").allTextContents();
      if (Number(row[1]) < 0.2 && Number(row[2]) > 0.2) return true;
      await page.click("button:has-text('Single')");
      return false;
    });
    await picture(page, "scope");
  });

  await step("the executor judges the trigger of the scope, and writes an incident", async () => {
    const incidents = async () => (await cell.rest("GET", "/incidents")).body;
    await page.selectOption("[aria-label=Condition]", "null");
    assert.ok(await page.isDisabled("button:has-text('Arm at the executor')"), "no condition says this");
    await page.selectOption("[aria-label=Condition]", "above");
    await page.fill("[aria-label=Level]", "50");
    await page.dispatchEvent("[aria-label=Level]", "change");
    await page.click("button:has-text('Arm at the executor')");
    // It never holds, and is taken back.
    await page.click("[aria-label='Disarm belt.soft.out > 50']");
    await page.waitForFunction(() => !document.querySelector("[aria-label^=Disarm]"));
    const before = (await incidents()).length;
    await page.selectOption("[aria-label=Condition]", "rising");
    await page.fill("[aria-label=Level]", "0.2");
    await page.dispatchEvent("[aria-label=Level]", "change");
    await page.click("button:has-text('Arm at the executor')");
    await until("the incident", async () => (await incidents()).length > before);
    const newest = (await incidents()).find((one) => one.reason === "trigger");
    assert.equal(newest.condition, "belt.soft.out > 0.2");
    await page.waitForFunction(() => !document.querySelector("[aria-label^=Disarm]"));
  });

  await step("an arm moves in 3D, while it is commanded and while it rests", async () => {
    await go(page, "arms");
    await page.waitForSelector(".arm-list .card:has-text('told by the driver')");
    const joints = () => page.locator(".joints td.number").allTextContents();
    const before = await joints();
    assert.equal(before.length, 7);
    await cell.run(cell.example("circle.yaml"));
    await page.waitForSelector(".arm-list .card:has-text('commanded by circle')");
    await until("another position", async () => (await joints())[0] !== before[0]);
    await page.waitForTimeout(pictures ? 2500 : 200);
    await picture(page, "arms");
    const pixels = await page.evaluate(() => {
      const canvas = document.querySelector("canvas.scene");
      const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
      return data.filter((value, index) => index % 4 === 3 && value === 255).length;
    });
    assert.ok(pixels > 2000, `${pixels} pixels are drawn`);
  });

  await step("an incident is shown as curves with a slider", async () => {
    await go(page, "incidents");
    await page.click("button:has-text('Record now')");
    await page.click("table a");
    await page.waitForSelector("p:has-text('identical with the recording')");
    const where = () => page.textContent(".slider .mono");
    const before = await where();
    await page.keyboard.press("ArrowLeft");
    assert.notEqual(await where(), before);
    assert.ok(await page.locator(".plot canvas").count() >= 1);
    await picture(page, "incident");
  });

  await step("events are folded and filtered", async () => {
    await go(page, "events");
    await page.waitForSelector("tr:has-text('circle')");
    await page.fill("input[type=search]", "belt");
    await until("filtered rows", async () => (await page.locator("table.events tbody tr").allTextContents()).every((text) => /belt/.test(text)));
    await page.fill("input[type=search]", "");
    await picture(page, "events");
  });

  await step(`${NETS} nets come and go, as many at a time as the executor has places for`, async () => {
    clearInterval(setting);
    await go(page, "nets");
    const rows = page.locator("table.nets tbody tr:has-text('small-')");
    const told = async () => {
      const states = (await cell.rest("GET", "/commands")).body.map((command) => command.state);
      return `${await rows.count()} rows, states of the executor: ${states.join(" ")}`;
    };
    for (let first = 0; first < NETS; first += AT_A_TIME) {
      const ids = [];
      for (let number = first; number < first + AT_A_TIME; number++) ids.push(await cell.run(small(number)));
      await until("all rows", async () => (await rows.count()) === AT_A_TIME).catch(async (error) => {
        throw new Error(`${error.message}: ${await told()}`);
      });
      await page.fill("input[type=search]", `small-${first + 7}`);
      await until("the found row", async () => (await page.locator("table.nets tbody tr").count()) === 1);
      await page.fill("input[type=search]", "");
      await page.evaluate(() => document.activeElement.blur());
      await until("the count", async () => Number(await page.textContent("#cancel-count")) >= AT_A_TIME);
      if (first === 0) await picture(page, "nets");
      await page.keyboard.press("Shift+C");
      await until("the end of all nets", async () => (await page.textContent("#cancel-count")) === "");
      for (const id of ids) assert.equal((await cell.rest("DELETE", `/commands/${id}`)).status, 200);
    }
    await until("an empty list", async () => (await rows.count()) === 0);
  });

  await step("START takes a confirmation whose safe answer has the focus", async () => {
    const id = await cell.load(cell.example("belt.yaml"));
    const button = page.locator(`tr:has(a[href='#/net/${id}']) button:has-text('START')`);
    await button.click();
    await page.waitForSelector("dialog[open]");
    assert.equal(await page.evaluate(() => document.activeElement.textContent), "Back");
    await page.keyboard.press("Enter");
    assert.equal((await cell.rest("GET", `/commands/${id}`)).body.state, "ready");
    await button.click();
    await page.click("#confirm");
    await until("the start", async () => (await cell.rest("GET", `/commands/${id}`)).body.state === "running");
  });

  await step("the page comes back after loader and executor were killed", async () => {
    for (const role of ["loader", "executor"]) {
      await cell.kill(role);
      await page.waitForFunction(() => document.getElementById("banner").hidden && !globalThis.rcc.state.cell.trouble);
    }
    await until("an empty list", async () => (await page.evaluate(() => globalThis.rcc.state.nets.size)) === 0);
    const id = await cell.run(cell.example("belt.yaml"));
    await page.waitForFunction((id) => globalThis.rcc.state.nets.get(id)?.state === "running", id);
  });

  await step("a suspended page and one that reads nothing delay no other, and the suspended one comes back", async () => {
    const other = await openPage(server);
    const session = await other.context().newCDPSession(other);
    await session.send("Page.setWebLifecycleState", { state: "frozen" });
    const url = new URL(server.origin);
    const cookies = (await other.context().cookies(server.origin)).map((one) => `${one.name}=${one.value}`).join("; ");
    const silent = connect(Number(url.port), "127.0.0.1", () => silent.write(`GET /api/stream HTTP/1.1\r\nhost: ${url.host}\r\ncookie: ${cookies}\r\n\r\n`));
    silent.pause();
    const cycle = () => page.evaluate(() => globalThis.rcc.state.cell.status.executor.cycle);
    const before = await cycle();
    await until("a hundred updates of the other page", async () => (await cycle()) > before + 4000);
    await session.send("Page.setWebLifecycleState", { state: "active" });
    const now = await cycle();
    await until("the page that was suspended", async () => (await other.evaluate(() => globalThis.rcc.state.cell.status.executor.cycle)) >= now);
    silent.destroy();
    await other.context().close();
  });

  await step("controls have names, and nothing is wider than a narrow or a dark screen", async () => {
    const narrow = await openPage(server, { viewport: { width: 390, height: 800 }, colorScheme: "dark", hasTouch: true });
    for (const view of VIEWS) {
      await go(narrow, view);
      await narrow.waitForTimeout(150);
      const found = await narrow.evaluate(() => ({
        wide: document.documentElement.scrollWidth - innerWidth,
        nameless: [...document.querySelectorAll("button, input, select, canvas[role=img], a")].filter((element) =>
          !(element.getAttribute("aria-label") || element.title || element.textContent.trim() || element.closest("label")?.textContent.trim())).map((element) => element.outerHTML),
      }));
      assert.ok(found.wide <= 0, `${view} is ${found.wide} pixels too wide`);
      assert.deepEqual(found.nameless, [], view);
      if (view === "overview") await picture(narrow, "narrow");
    }
    await narrow.context().close();
  });

  await step(`the page's memory does not grow (${minutes} min)`, async () => {
    const session = await page.context().newCDPSession(page);
    const turn = async () => {
      for (const view of VIEWS) {
        await go(page, view);
        await page.waitForTimeout(250);
      }
    };
    const size = async () => {
      await go(page, "overview");
      await session.send("HeapProfiler.collectGarbage");
      const { usedSize } = await session.send("Runtime.getHeapUsage");
      const { nodes, jsEventListeners } = await session.send("Memory.getDOMCounters");
      return { usedSize, nodes, jsEventListeners };
    };
    await turn();
    await turn();
    const before = await size();
    const end = Date.now() + minutes * 60_000;
    let turns = 0;
    do {
      await turn();
      turns += 1;
    } while (Date.now() < end);
    const after = await size();
    console.log(`          ${turns} turns: ${(before.usedSize / 1e6).toFixed(1)} → ${(after.usedSize / 1e6).toFixed(1)} MB, ${before.nodes} → ${after.nodes} nodes, ${before.jsEventListeners} → ${after.jsEventListeners} listeners`);
    assert.ok(after.usedSize - before.usedSize < GROWTH_MAX, "the heap grows");
    assert.ok(after.nodes < before.nodes + 3000, "nodes are kept");
    assert.ok(after.jsEventListeners < before.jsEventListeners + 400, "listeners are kept");
  });

  await step("a killed dashboard is noticed, and the next one serves its own address", async () => {
    server.child.kill("SIGKILL");
    await page.waitForSelector("#banner:not([hidden])");
    assert.match(await page.textContent("#banner"), /does not answer/);
    server = await cell.serve();
    await openPage(server);
  });
}

try {
  await main();
  console.log("the dashboard works");
} catch (error) {
  console.error(error, cell.output);
  process.exitCode = 1;
} finally {
  await browser?.close();
  await cell.stop();
}
