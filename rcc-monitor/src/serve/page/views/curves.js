// Live curves of any ports: pick, pause, zoom, look back. Monitored ports have every cycle of their rate, others are
// sampled.

import { h, setText } from "../dom.js";
import { COLOURS, csv, download, joined, makePlot, reduced } from "../plot.js";
import { portPicker } from "../picker.js";
import { elementName } from "../series.js";
import { on, series, state, watch } from "../stream.js";

const SPANS = [2, 5, 10, 30, 60, 120];
const RATES = [10, 50, 250, 1000];
const PORTS_MAX = 16;
const POINTS = 1500;
const FRAME_MS = 45;

const kept = { ports: load(), span: 10, rate: 50, hidden: new Set() };

function load() {
  try {
    return JSON.parse(sessionStorage.getItem("curves")) ?? [];
  } catch {
    return [];
  }
}

const pattern = (one) => `${one.net}/${one.port}`;

/** Adds a port; also from other views. */
export function addCurve(port) {
  if (kept.ports.some((one) => pattern(one) === pattern(port))) return;
  kept.ports.push({ net: port.net, port: port.port, unit: port.unit ?? null });
  if (kept.ports.length > PORTS_MAX) kept.ports.shift();
  sessionStorage.setItem("curves", JSON.stringify(kept.ports));
}

export function open(view) {
  const picker = portPicker("Add a port", (port) => { addCurve(port); choose(); });
  const spans = h("select", { "aria-label": "Time shown", onchange: () => { kept.span = Number(spans.value); fixed = null; } },
    SPANS.map((span) => h("option", { value: span, selected: span === kept.span }, `${span} s`)));
  const rates = h("select", { "aria-label": "Rate", onchange: () => { kept.rate = Number(rates.value); choose(); } },
    RATES.map((rate) => h("option", { value: rate, selected: rate === kept.rate }, rate === 1000 ? "every cycle" : `${rate} Hz`)));
  const pause = h("button", { onclick: () => setPaused(!paused), "aria-keyshortcuts": "Space" }, "Pause");
  const all = h("button.quiet", { onclick: () => { fixed = null; setPaused(false); } }, "Live");
  const save = h("button.quiet", { onclick: saveCsv }, "CSV");
  const chips = h("div.chips", { "aria-label": "Shown ports" });
  const plots = h("div.plots");
  const hint = h("p.empty", {}, "Pick ports above, or click an output in a net's graph. Values are shown while their net runs; null leaves a gap.");
  const troubles = h("p.warn", { role: "status" });
  view.append(h("div.bar", {}, picker, spans, rates, pause, all, save), chips, troubles, hint, plots);
  let paused = false, fixed = null, made = "", drawn = [], last = 0, frame = null;

  function choose() {
    watch("curves", kept.ports.length ? { ports: kept.ports.map(pattern), rate: kept.rate } : null);
    sessionStorage.setItem("curves", JSON.stringify(kept.ports));
    chips.replaceChildren(...kept.ports.map((port) => h("span.chip", {}, pattern(port),
      h("button", { "aria-label": `Remove ${pattern(port)}`, onclick: () => { kept.ports = kept.ports.filter((one) => one !== port); choose(); } }, "×"))));
    hint.hidden = kept.ports.length > 0;
    made = "";
    draw();
  }

  function setPaused(value) {
    paused = value;
    setText(pause, paused ? "Continue" : "Pause");
    pause.setAttribute("aria-pressed", String(paused));
    if (paused) fixed ??= range();
    else fixed = null;
    draw();
  }

  function newest() {
    const times = found().map((one) => one.newest).filter((time) => time !== null);
    return times.length ? Math.max(...times) : null;
  }

  const found = () => kept.ports.map((port) => series.matching(pattern(port)).at(-1)).filter(Boolean);

  function range() {
    const end = newest() ?? 0;
    return [end - kept.span, end];
  }

  /** One plot for each unit, so that every axis means one thing. */
  function groups() {
    const all = new Map();
    for (const one of found()) {
      const unit = one.about.type.startsWith("Bool") ? "true/false" : one.about.unit ?? (one.about.type === "Pose" ? "m, 1" : "");
      if (!all.has(unit)) all.set(unit, []);
      all.get(unit).push(one);
    }
    return [...all.entries()];
  }

  function make(shown) {
    drawn.forEach((one) => one.made.destroy());
    plots.replaceChildren();
    let number = 0;
    drawn = shown.map(([unit, members]) => {
      const place = h("div.plot", { role: "img", "aria-label": `Curves of ${members.map((one) => one.about.port).join(", ")}` });
      plots.append(place);
      const lines = members.flatMap((one) => Array.from({ length: one.width }, (_, index) => ({
        label: `${kept.ports.some((other) => other.net !== one.about.net) ? `${one.about.net}/` : ""}${one.about.port}${elementName(one.about.type, index, one.width)}`,
        unit: unit === "true/false" || unit === "m, 1" ? "" : unit, colour: COLOURS[number++ % COLOURS.length], steps: unit === "true/false",
      })));
      const made = makePlot(place, lines, {
        range: () => fixed ?? range(),
        zoomed: (from, to) => { fixed = [from, to]; paused = true; setText(pause, "Continue"); draw(); },
      });
      return { made, members };
    });
  }

  function draw() {
    frame = null;
    const shown = groups();
    const signature = JSON.stringify(shown.map(([unit, members]) => [unit, members.map((one) => [one.about.key, one.width])]));
    if (signature !== made) {
      made = signature;
      make(shown);
    }
    const [from, to] = fixed ?? range();
    for (const { made: { plot }, members } of drawn) {
      const parts = members.map((one) => {
        const first = Math.max(0, one.from(from) - 1), end = Math.min(one.length, one.from(to) + 1);
        return reduced(one.times.subarray(first, end), one.columns.map((column) => column.subarray(first, end)), POINTS);
      });
      plot.setData(joined(parts), false);
      plot.setScale("x", { min: from, max: to });
    }
  }

  function schedule() {
    if (paused || document.hidden || frame !== null) return;
    const wait = Math.max(0, FRAME_MS - (performance.now() - last));
    frame = setTimeout(() => requestAnimationFrame(() => { last = performance.now(); draw(); }), wait);
  }

  function saveCsv() {
    const members = found();
    if (!members.length) return;
    const [from, to] = fixed ?? range();
    const parts = members.map((one) => ({ times: one.times.subarray(one.from(from), one.from(to)), columns: one.columns.map((column) => column.subarray(one.from(from), one.from(to))) }));
    const table = joined(parts);
    const head = ["time_s", ...members.flatMap((one) => Array.from({ length: one.width }, (_, index) => `${one.about.net}/${one.about.port}${one.width > 1 ? `[${index}]` : ""}`))];
    download("curves.csv", csv(head, Array.from(table[0], (time, row) => [time, ...table.slice(1).map((column) => column[row])])));
  }

  const keys = (event) => {
    if (event.target.closest("input, select, textarea, button, dialog")) return;
    if (event.key === " ") {
      event.preventDefault();
      setPaused(!paused);
    } else if (event.key === "0") { fixed = null; setPaused(false); }
    else if (event.key === "+" || event.key === "-") {
      const [from, to] = fixed ?? range();
      if (paused) {
        const half = (to - from) * (event.key === "+" ? 0.4 : 0.625), middle = (from + to) / 2;
        fixed = [middle - half, middle + half];
        draw();
      } else {
        const next = SPANS[Math.min(SPANS.length - 1, Math.max(0, SPANS.indexOf(kept.span) + (event.key === "+" ? -1 : 1)))];
        kept.span = next;
        spans.value = String(next);
        schedule();
      }
    }
  };
  addEventListener("keydown", keys);
  const showRefused = () => setText(troubles, kept.ports.map((port) => state.refused[pattern(port)] && `${pattern(port)}: ${state.refused[pattern(port)]}`).filter(Boolean).join("; "));
  const off = [on("values", schedule), on("refused", showRefused), on("connection", () => { state.refused = {}; showRefused(); }), picker.stop];
  choose();
  return () => {
    clearTimeout(frame);
    removeEventListener("keydown", keys);
    watch("curves", null);
    off.forEach((stop) => stop());
    drawn.forEach((one) => one.made.destroy());
  };
}
