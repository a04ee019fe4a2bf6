// A scope: waits until a port crosses a level, and keeps what happened before and after. Monitored ports have every cycle
// of their rate, others are sampled at up to 250 Hz; the flight recorder has every cycle of every port, so a trigger may
// have it written to a file.

import { armTrigger, armedTriggers, disarmTrigger, recordIncident } from "../commands.js";
import { h, note, setText } from "../dom.js";
import { element } from "../format.js";
import { COLOURS, csv, download, drawLevel, drawLine, joined, makePlot, onPoint } from "../plot.js";
import { portPicker } from "../picker.js";
import { elementName } from "../series.js";
import { on, series, state, watch } from "../stream.js";
import { condition, crossing } from "../trigger.js";

const SPANS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20];
const CHANNELS_MAX = 8;
const EDGES = [["rising", "rises above"], ["falling", "falls below"], ["either", "crosses"], ["above", "is above"], ["below", "is below"], ["null", "becomes null"]];
const SHOT_EVERY_S = 0.1;

const kept = { channels: [], trigger: "", edge: "rising", level: 0, span: 1, before: 30, repeat: false, incident: false };

const pattern = (one) => `${one.net}/${one.port}`;

export function open(view) {
  const picker = portPicker("Add a channel", (port) => {
    if (!kept.channels.some((one) => pattern(one) === pattern(port))) kept.channels.push({ net: port.net, port: port.port, width: port.width, type: port.type, unit: port.unit });
    if (kept.channels.length > CHANNELS_MAX) kept.channels.shift();
    choose();
  });
  const select = (label, options, current, change) => {
    const made = h("select", { "aria-label": label, onchange: () => { change(made.value); rearm(); } }, options.map(([id, title]) => h("option", { value: id, selected: String(id) === String(current) }, title)));
    return made;
  };
  const triggers = select("Trigger", [], "", (id) => { kept.trigger = id; });
  const edges = select("Condition", EDGES, kept.edge, (id) => { kept.edge = id; });
  const level = h("input", { type: "number", step: "any", value: kept.level, "aria-label": "Level", onchange: () => { kept.level = Number(level.value) || 0; rearm(); } });
  const spans = select("Time", SPANS.map((span) => [span, span < 1 ? `${span * 1000} ms` : `${span} s`]), kept.span, (id) => { kept.span = Number(id); });
  const before = select("Before the trigger", [0, 10, 30, 50, 70, 90].map((part) => [part, `${part} % before`]), kept.before, (id) => { kept.before = Number(id); });
  const single = h("button", { onclick: () => { kept.repeat = false; rearm(); } }, "Single");
  const repeat = h("button", { onclick: () => { kept.repeat = true; rearm(); } }, "Repeat");
  const stop = h("button.quiet", { onclick: () => { phase = "stopped"; show(); }, "aria-keyshortcuts": "Space" }, "Stop");
  const incident = h("input", { type: "checkbox", checked: kept.incident, onchange: () => { kept.incident = incident.checked; } });
  const atExecutor = h("button.quiet", { onclick: armAtExecutor, title: "The executor judges the condition in every cycle and writes one incident, also when this page is closed" }, "Arm at the executor");
  const armed = h("div.chips", { "aria-label": "Armed at the executor" });
  const save = h("button.quiet", { onclick: saveCsv }, "CSV");
  const status = h("span.badge", { role: "status" });
  const chips = h("div.chips"), place = h("div.plot.tall", { role: "img", "aria-label": "Captured curves" }), cursors = h("div.cursors", { "aria-label": "Cursors" });
  const hint = h("p.empty", {}, "Add channels; the first one triggers. A click sets cursor A, with Shift cursor B.");
  view.append(h("div.bar", {}, picker, single, repeat, stop, status, save),
    h("div.bar", {}, h("span.dim", {}, "Trigger when"), triggers, edges, level, spans, before, h("label", { title: "The flight recorder has every cycle of every port" }, incident, " write an incident"), atExecutor),
    armed, chips, hint, place, cursors);

  let phase = "stopped", armedFrom = 0, searchedTo = 0, at = null, shot = null, made = null, marks = [null, null], lastShot = 0, wasTrue = null;

  const found = () => kept.channels.map((one) => series.matching(pattern(one)).at(-1)).filter(Boolean);

  function choose() {
    watch("scope", kept.channels.length ? { ports: kept.channels.map(pattern), rate: 1000 } : null);
    const options = kept.channels.flatMap((one) => Array.from({ length: one.width || 1 }, (_, index) => [`${pattern(one)}|${index}`, `${pattern(one)}${elementName(one.type, index, one.width || 1)}`]));
    if (!options.some(([id]) => id === kept.trigger)) kept.trigger = options[0]?.[0] ?? "";
    triggers.replaceChildren(...options.map(([id, title]) => h("option", { value: id, selected: id === kept.trigger }, title)));
    chips.replaceChildren(...kept.channels.map((one) => h("span.chip", {}, pattern(one), h("span.dim.rate", {}, ""),
      h("button", { "aria-label": `Remove ${pattern(one)}`, onclick: () => { kept.channels = kept.channels.filter((other) => other !== one); choose(); } }, "×"))));
    hint.hidden = kept.channels.length > 0;
    rearm();
  }

  /** The trigger as a condition of the executor; null if there is none that says the same. */
  function asCondition() {
    const [name, index] = kept.trigger.split("|");
    const channel = kept.channels.find((one) => pattern(one) === name);
    return channel ? condition(channel, Number(index), kept.edge, kept.level) : null;
  }

  async function armAtExecutor() {
    const wanted = asCondition();
    if (wanted) await armTrigger(wanted.when, wanted.edge);
    showArmed();
  }

  async function showArmed() {
    const all = await armedTriggers();
    armed.replaceChildren(...all.map((one) => h("span.chip", {}, `armed: ${one.when}`,
      h("button", { "aria-label": `Disarm ${one.when}`, onclick: async () => { await disarmTrigger(one.rule); showArmed(); } }, "×"))));
  }

  function source() {
    const [name, index] = kept.trigger.split("|");
    const one = series.matching(name ?? "").at(-1);
    return one ? { times: one.times, column: one.columns[Number(index)], length: one.length, newest: one.newest, about: one.about } : null;
  }

  function rearm() {
    const now = source();
    phase = kept.channels.length ? "armed" : "stopped";
    armedFrom = searchedTo = now?.newest ?? 0;
    at = null;
    wasTrue = null;
    show();
  }

  function take() {
    if (phase === "armed") search();
    if (phase === "triggered") {
      const newest = Math.min(...found().map((one) => one.newest ?? -Infinity));
      const end = at + kept.span * (1 - kept.before / 100);
      if (newest >= end) finish(end);
    }
    showRates();
  }

  function search() {
    const now = source();
    if (!now?.column || now.newest === null) return;
    if (now.newest < searchedTo) armedFrom = searchedTo = now.times[0];
    const result = crossing(now, searchedTo, kept.edge, kept.level, wasTrue);
    wasTrue = result.last;
    searchedTo = now.newest;
    if (result.at !== null && result.at - lastShot >= (kept.repeat ? SHOT_EVERY_S : 0)) {
      at = result.at;
      phase = "triggered";
      if (kept.incident) {
        // Once for each arming: a file is written for it.
        if (kept.repeat) kept.incident = incident.checked = false;
        recordIncident();
      }
      show();
    }
  }

  function finish(end) {
    const start = end - kept.span;
    const members = found();
    shot = {
      at, members: members.map((one) => ({ about: one.about, width: one.width, last: one.last })),
      parts: members.map((one) => {
        const [first, last] = [one.from(start), one.from(end + 1e-9)];
        return { times: Array.from(one.times.subarray(first, last), (time) => time - at), columns: one.columns.map((column) => column.slice(first, last)) };
      }),
      start: start - at, end: end - at,
    };
    lastShot = at;
    if (kept.repeat) {
      phase = "armed";
      wasTrue = null;
      searchedTo = Math.max(searchedTo, end);
    } else phase = "complete";
    draw();
    show();
  }

  function draw() {
    made?.destroy();
    place.replaceChildren();
    if (!shot) return;
    let number = 0;
    const lines = shot.members.flatMap((one) => Array.from({ length: one.width }, (_, index) => ({
      label: `${one.about.port}${elementName(one.about.type, index, one.width)}`, unit: one.about.unit ?? "", colour: COLOURS[number++ % COLOURS.length],
      steps: one.about.type.startsWith("Bool"),
    })));
    made = makePlot(place, lines, {
      range: zoom ? () => zoom : () => [shot.start, shot.end],
      zoomed: (from, to) => { zoom = [from, to]; draw(); },
      xTitle: "s from the trigger",
      draw: (plot) => {
        drawLine(plot, 0, "--accent", "trigger");
        if (!["null"].includes(kept.edge)) drawLevel(plot, kept.level, "--accent");
        marks.forEach((mark, index) => mark !== null && drawLine(plot, mark, "--dim", "AB"[index], false));
      },
    });
    made.plot.setData(joined(shot.parts));
    onPoint(made.plot, (x, event) => {
      marks[event.shiftKey ? 1 : 0] = x;
      made.plot.redraw(false);
      showCursors();
    });
    made.plot.over.addEventListener("dblclick", () => { zoom = null; draw(); });
    showCursors();
  }
  let zoom = null;

  function valueAt(part, column, time) {
    let index = part.times.findIndex((one) => one >= time);
    if (index < 0) index = part.times.length - 1;
    return column[index];
  }

  function showCursors() {
    const [a, b] = marks;
    if (!shot || (a === null && b === null)) return cursors.replaceChildren();
    const rows = shot.members.flatMap((one, index) => Array.from({ length: one.width }, (_, at) => {
      const [va, vb] = [a, b].map((mark) => (mark === null ? null : valueAt(shot.parts[index], shot.parts[index].columns[at], mark)));
      const name = `${one.about.port}${elementName(one.about.type, at, one.width)}`;
      const text = (value) => element(Number.isNaN(value) ? null : value);
      return h("tr", {}, h("td", {}, name), h("td.number", {}, text(va)), h("td.number", {}, text(vb)), h("td.number", {}, va === null || vb === null ? "–" : text(vb - va)), h("td.dim", {}, one.about.unit ?? ""));
    }));
    const time = (mark) => (mark === null ? "–" : `${(mark * 1000).toFixed(1)} ms`);
    const between = a !== null && b !== null ? `${((b - a) * 1000).toFixed(1)} ms${a !== b ? ` (${(1 / Math.abs(b - a)).toFixed(2)} Hz)` : ""}` : "–";
    cursors.replaceChildren(h("table.compact", {}, h("thead", {}, h("tr", {}, h("th", {}, ""), h("th.number", {}, `A ${time(a)}`), h("th.number", {}, `B ${time(b)}`), h("th.number", {}, `B − A ${between}`), h("th", {}, ""))), h("tbody", {}, rows)));
  }

  function show() {
    const words = { stopped: "stopped", armed: shot && kept.repeat ? "repeating" : "waiting for the trigger", triggered: "triggered", complete: "complete" };
    setText(status, words[phase]);
    status.className = `badge ${{ armed: "warn", triggered: "run", complete: "good" }[phase] ?? "calm"}`;
    single.setAttribute("aria-pressed", String(!kept.repeat && phase !== "stopped"));
    atExecutor.disabled = !asCondition();
    repeat.setAttribute("aria-pressed", String(kept.repeat && phase !== "stopped"));
  }

  function showRates() {
    kept.channels.forEach((one, index) => {
      const known = series.matching(pattern(one)).at(-1);
      const label = chips.children[index]?.querySelector(".rate");
      if (!label || !known || known.length < 20) return;
      const rate = 19 / (known.times[known.length - 1] - known.times[known.length - 20]);
      setText(label, ` ${known.about.source === "monitor" ? "every sample of its monitor" : "sampled"}, ${Math.round(rate)} Hz`);
    });
  }

  function saveCsv() {
    if (!shot) return note("Nothing is captured yet.");
    const table = joined(shot.parts);
    const head = ["time_s", ...shot.members.flatMap((one) => Array.from({ length: one.width }, (_, index) => `${one.about.net}/${one.about.port}${one.width > 1 ? `[${index}]` : ""}`))];
    download("scope.csv", csv(head, Array.from(table[0], (time, row) => [time.toFixed(6), ...table.slice(1).map((column) => column[row])])));
  }

  const keys = (event) => {
    if (event.target.closest("input, select, textarea, button, dialog")) return;
    if (event.key === " ") {
      event.preventDefault();
      if (phase === "stopped" || phase === "complete") rearm();
      else { phase = "stopped"; show(); }
    } else if (event.key === "0") { zoom = null; draw(); }
  };
  addEventListener("keydown", keys);
  const off = [on("values", take), on("refused", () => {
    const text = kept.channels.map((one) => state.refused[pattern(one)]).filter(Boolean).join("; ");
    if (text) setText(status, text);
  }), on("events", (data) => { if (data.events.some((event) => event.kind === "incident-written")) showArmed(); }), picker.stop];
  choose();
  showArmed();
  return () => {
    removeEventListener("keydown", keys);
    watch("scope", null);
    off.forEach((stop) => stop());
    made?.destroy();
  };
}
