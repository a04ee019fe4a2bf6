// Incidents of the flight recorder: the recorded seconds as curves, evaluated again cycle by cycle, with a slider.

import { getJson, recordIncident } from "../commands.js";
import { h, note, reconcile, setText } from "../dom.js";
import { element, grouped, significant } from "../format.js";
import { COLOURS, csv, download, drawLine, makePlot, onPoint } from "../plot.js";
import { on, state } from "../stream.js";

const PORTS_MAX = 8;
const STEP_MS = 40;

export function open(view, [chosen]) {
  if (chosen) return openOne(view, chosen);
  const body = h("tbody"), empty = h("p.empty", {}, "No incident is kept. One is written when a net ends by a fault, when many cycles in a row are late, or on request.");
  const record = h("button", { onclick: async () => { await recordIncident(); load(); } }, "Record now");
  view.append(h("div.bar", {}, record, h("span.dim", {}, "writes the last seconds of the flight recorder to a file")),
    h("div.scroll", {}, h("table", {}, h("thead", {}, h("tr", {}, ["Time (UTC)", "Reason", "Net", "Cycle", "Span"].map((head) => h("th", {}, head)))), body)), empty);
  async function load() {
    const { answer, error } = await getJson("/api/incidents");
    if (error) return note(error.message, "error", error.help);
    empty.hidden = answer.length > 0;
    reconcile(body, answer.reverse(), (row) => row.file, makeRow, () => {});
  }
  load();
  return on("events", (data) => { if (data.events.some((event) => event.kind === "incident-written")) load(); });
}

function makeRow(row) {
  const name = row.file.split("/").pop();
  const reason = row.reason === "fault" ? `fault: ${row.fault ?? ""}` : row.reason === "late" ? "late cycles" : row.reason === "trigger" ? `trigger: ${row.condition ?? ""}` : "on request";
  return h("tr", {}, h("td", {}, h("a", { href: `#/incidents/${encodeURIComponent(name)}` }, (row.time ?? "").replace("T", " ").slice(0, 23))),
    h("td", {}, h(`span.badge.${row.reason === "request" ? "calm" : row.reason === "trigger" ? "warn" : "bad"}`, {}, reason)), h("td", {}, row.name ?? ""), h("td.number", {}, grouped(row.cycle)), h("td.number", {}, `${significant(row.span_s)} s`));
}

function openOne(view, name) {
  const title = h("h1", {}, "Incident"), words = h("p.dim", { role: "status" }, "reading …");
  const picker = h("select", { "aria-label": "Add a port", onchange: () => { add(picker.value); picker.selectedIndex = 0; } });
  const chips = h("div.chips"), plots = h("div.plots");
  const slider = h("input.wide", { type: "range", min: 0, max: 0, value: 0, "aria-label": "Cycle", oninput: () => move(Number(slider.value)) });
  const play = h("button", { onclick: () => setPlaying(!timer), "aria-keyshortcuts": "Space" }, "Play");
  const where = h("span.mono"), table = h("tbody");
  const save = h("button.quiet", { onclick: saveCsv }, "CSV");
  view.append(h("div.bar", {}, h("a.button.quiet", { href: "#/incidents" }, "← All"), title), words, h("div.bar", {}, picker, save), chips,
    h("div.bar.slider", {}, play, slider, where), plots,
    h("div.scroll", {}, h("table.compact", {}, h("thead", {}, h("tr", {}, h("th", {}, "Port"), h("th.number", {}, "Value at the slider"), h("th", {}, "Unit"))), table)));
  let about = null, ports = [], data = null, rows = [], drawn = [], at = 0, timer = null, gone = false;

  async function load() {
    const { answer, error } = await getJson(`/api/incidents/${encodeURIComponent(name)}`);
    if (gone) return;
    if (error) return setText(words, `${error.message}. ${error.help ?? ""}`);
    about = answer;
    setText(title, `${answer.head.reason === "fault" ? `Fault: ${answer.head.fault ?? ""}` : answer.head.reason === "late" ? "Late cycles" : answer.head.reason === "trigger" ? `Trigger: ${answer.head.condition ?? ""}` : "Recorded on request"}`);
    picker.replaceChildren(h("option", { value: "" }, "Add a port …"), ...answer.nets.map((net) => h("optgroup", { label: net.title },
      net.ports.map((port) => h("option", { value: `${net.net}/${port.port}` }, `${port.port}  ${port.type}${port.unit ? ` ${port.unit}` : ""}`)))));
    const first = answer.nets.find((net) => net.id === answer.head.net) ?? answer.nets[0];
    if (!first) return setText(words, "No net was evaluated in these seconds.");
    const interesting = first.ports.filter((port) => /\.(joints|position|pose|fz|speed|distance)$/.test(port.port));
    ports = (interesting.length ? interesting : first.ports).slice(0, 3).map((port) => `${first.net}/${port.port}`);
    await evaluate();
  }

  function add(port) {
    if (!port || ports.includes(port)) return;
    ports.push(port);
    if (ports.length > PORTS_MAX) ports.shift();
    evaluate();
  }

  const unitOf = (column) => {
    for (const net of about.nets) {
      for (const port of net.ports) {
        const full = `${net.net}/${port.port}`;
        if (column === full || column.startsWith(`${full}[`)) return port.unit ?? "";
      }
    }
    return "";
  };

  async function evaluate() {
    chips.replaceChildren(...ports.map((port) => h("span.chip", {}, port, h("button", { "aria-label": `Remove ${port}`, onclick: () => { ports = ports.filter((one) => one !== port); evaluate(); } }, "×"))));
    if (!ports.length) return;
    setText(words, "evaluating the recorded cycles again …");
    const { answer, error } = await getJson(`/api/incidents/${encodeURIComponent(name)}/values?ports=${ports.map(encodeURIComponent).join(",")}`);
    if (gone) return;
    if (error) return setText(words, `${error.message}. ${error.help ?? ""}`);
    data = answer;
    const head = about.head;
    setText(words, `cycles ${grouped(head.first_cycle)} to ${grouped(head.last_cycle)}, trigger in cycle ${grouped(head.cycle)}; replay ${answer.identical ? "identical with the recording" : "DIFFERS from the recording"}${answer.whole ? "" : "; only a part is shown"}`);
    draw();
  }

  function draw() {
    drawn.forEach((one) => one.made.destroy());
    plots.replaceChildren();
    rows = [];
    drawn = [];
    let number = 0;
    for (const net of data.nets) {
      const cycles = net.cycles;
      const byUnit = Map.groupBy ? Map.groupBy(Object.keys(net.columns), unitOf) : group(Object.keys(net.columns), unitOf);
      for (const [unit, columns] of byUnit) {
        const place = h("div.plot", { role: "img", "aria-label": `Curves of ${columns.join(", ")}` });
        plots.append(place);
        const lines = columns.map((column) => ({ label: column, unit, colour: COLOURS[number++ % COLOURS.length], steps: typeof net.columns[column].find((value) => value !== null) === "boolean" }));
        const made = makePlot(place, lines, {
          xTitle: "cycle", xLabel: (cycle) => grouped(cycle),
          draw: (plot) => {
            drawLine(plot, data.cycle, "--bad", "trigger");
            if (rows.length) drawLine(plot, at, "--accent", "", false);
          },
        });
        onPoint(made.plot, (x) => move(Math.round(x)));
        const numbers = columns.map((column) => net.columns[column].map((value) => (typeof value === "boolean" ? Number(value) : typeof value === "string" ? null : value)));
        made.plot.setData([cycles, ...numbers]);
        drawn.push({ made });
        columns.forEach((column) => rows.push({ column, unit, cycles, values: net.columns[column] }));
      }
    }
    const all = data.nets.flatMap((net) => [net.cycles[0], net.cycles.at(-1)]).filter(Boolean);
    slider.min = Math.min(...all);
    slider.max = Math.max(...all);
    table.replaceChildren(...rows.map((row) => h("tr", {}, h("td", {}, row.column), h("td.number"), h("td.dim", {}, row.unit))));
    move(Math.min(Number(slider.max), Math.max(Number(slider.min), at || data.cycle)));
  }

  function move(cycle) {
    at = Math.min(Number(slider.max), Math.max(Number(slider.min), cycle));
    slider.value = at;
    const time = (at - data.cycle) * about.head.period_ns * 1e-9;
    setText(where, `cycle ${grouped(at)}, ${time >= 0 ? "+" : "−"}${Math.abs(time).toFixed(3)} s`);
    slider.setAttribute("aria-valuetext", where.textContent);
    rows.forEach((row, index) => {
      const place = index_of(row.cycles, at);
      setText(table.children[index].children[1], place < 0 ? "not evaluated" : element(row.values[place]));
    });
    drawn.forEach((one) => one.made.plot.redraw(false));
  }

  function setPlaying(value) {
    clearInterval(timer);
    timer = null;
    setText(play, value ? "Pause" : "Play");
    if (!value || !data) return;
    if (at >= Number(slider.max)) move(Number(slider.min));
    const step = Math.max(1, Math.round(STEP_MS * 1e6 / about.head.period_ns));
    timer = setInterval(() => {
      move(at + step);
      if (at >= Number(slider.max)) setPlaying(false);
    }, STEP_MS);
  }

  function saveCsv() {
    if (!data?.nets.length) return;
    const net = data.nets[0], columns = Object.keys(net.columns);
    download(`${name}.csv`, csv(["cycle", "time_s", ...columns], net.cycles.map((cycle, row) => [cycle, net.seconds[row], ...columns.map((column) => net.columns[column][row])])));
  }

  const keys = (event) => {
    if (!data || event.target.closest("input:not([type=range]), select, textarea, button, dialog")) return;
    if (event.key === " ") setPlaying(!timer);
    else if (event.key === "ArrowLeft" || event.key === "ArrowRight") move(at + (event.key === "ArrowLeft" ? -1 : 1) * (event.shiftKey ? 10 : 1));
    else return;
    event.preventDefault();
  };
  addEventListener("keydown", keys);
  load();
  return () => {
    gone = true;
    clearInterval(timer);
    removeEventListener("keydown", keys);
    drawn.forEach((one) => one.made.destroy());
  };
}

function group(all, key) {
  const out = new Map();
  for (const one of all) out.set(key(one), [...(out.get(key(one)) ?? []), one]);
  return out;
}

/** Index of a sorted value; −1 if it is not there. */
function index_of(sorted, wanted) {
  let low = 0, high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] < wanted) low = middle + 1;
    else high = middle;
  }
  return sorted[low] === wanted ? low : -1;
}
