// One net: its graph with live values, its state, and its commands.

import { abort, cancel, getJson, start } from "../commands.js";
import { h, note, setText } from "../dom.js";
import { duration, grouped, isActive, outcome, stateKind, time, value } from "../format.js";
import { addCurve } from "./curves.js";
import { runTime } from "./nets.js";
import { on, series, state, watch } from "../stream.js";

const RATE = 8;
const PORTS_MAX = 60;

export function open(view, [id]) {
  const number = Number(id);
  const title = h("h1", {}, `#${id}`), badge = h("span.badge"), facts = h("p.dim"), words = h("p");
  const [go, stop, end] = [
    h("button.primary", { onclick: () => start(current()) }, "START"),
    h("button.stop", { onclick: () => cancel(current()) }, "CANCEL"),
    h("button.quiet", { onclick: () => abort(current()) }, "ABORT"),
  ];
  const tabs = h("div.segments", { role: "group", "aria-label": "Show" }, ["Graph", "Values", "Text"].map((name) =>
    h("button", { onclick: () => showTab(name) }, name)));
  const zoom = h("div.segments", { role: "group", "aria-label": "Zoom" },
    h("button", { onclick: () => scale(1.25), "aria-label": "Zoom in" }, "+"), h("button", { onclick: () => scale(0.8), "aria-label": "Zoom out" }, "−"), h("button", { onclick: () => fit() }, "Fit"));
  const graph = h("div.graph", { tabindex: 0, role: "img", "aria-label": "Graph of the net with live values" });
  const table = h("tbody");
  const values = h("div.scroll", { hidden: true }, h("table", {}, h("thead", {}, h("tr", {}, h("th", {}, "Port"), h("th", {}, "Value"), h("th", {}, "Type"), h("th", {}))), table));
  const text = h("pre.text", { hidden: true, tabindex: 0 });
  view.append(h("div.net-head", {}, h("div", {}, h("div.title", {}, title, badge), words, facts), h("div.bar", {}, go, stop, end)),
    h("div.bar", {}, tabs, zoom, h("span.dim.hint", {}, "a click on an output draws its curve")), graph, values, text);
  let factor = 1, svg = null, outputs = new Map(), gone = false;
  const current = () => state.nets.get(number);

  function showTab(name) {
    [...tabs.children].forEach((tab) => tab.setAttribute("aria-pressed", String(tab.textContent === name)));
    graph.hidden = name !== "Graph";
    zoom.hidden = graph.hidden;
    values.hidden = name !== "Values";
    text.hidden = name !== "Text";
  }

  function show() {
    const net = current();
    if (!net) {
      setText(badge, "unloaded");
      badge.className = "badge calm";
      [go, stop, end].forEach((button) => { button.hidden = true; });
      return;
    }
    setText(title, `${net.net}#${net.id}`);
    setText(badge, outcome(net));
    badge.className = `badge ${stateKind(net)}`;
    setText(words, net.fault?.words ?? net.finding ?? net.description ?? "");
    const parts = [`${grouped(net.primitives)} primitives`];
    if (net.uses?.length) parts.push(`uses ${net.uses.join(", ")}`);
    if (net.cycles) parts.push(`${grouped(net.cycles)} cycles, ${duration(runTime(net))}`, `last ${time(net.exec_last_ns)}, longest ${time(net.exec_max_ns)}`);
    else if (net.rehearsed) parts.push(`rehearsal: ${net.rehearsed}`);
    setText(facts, parts.join("; "));
    go.hidden = net.state !== "ready" || !state.mayStart;
    stop.hidden = !isActive(net);
    end.hidden = !isActive(net);
  }

  async function load() {
    const { answer, error } = await getJson(`/api/nets/${number}`);
    if (gone) return;
    if (error) {
      setText(words, error.message);
      return;
    }
    text.textContent = answer.text;
    const ports = (answer.names?.primitives ?? []).flatMap((primitive) => primitive.outputs.map((port) => ({ ...port, name: `${primitive.id}.${port.name}` })));
    makeRows(answer.net, ports);
    if (ports.length) watch("net", { ports: patterns(answer, ports), rate: RATE });
    try {
      const response = await fetch(`/api/nets/${number}/graph`);
      if (gone) return;
      if (!response.ok) {
        const error = await response.json();
        graph.replaceChildren(h("p.empty", {}, error.message));
        showTab("Values");
        return;
      }
      draw(await response.text());
    } catch (error) {
      note(error.message, "error");
    }
  }

  /** One pattern for small nets; some ports of large ones. */
  function patterns(answer, ports) {
    return ports.length <= 800 ? [`${answer.net}#${number}/*`] : ports.slice(0, PORTS_MAX).map((port) => `${answer.net}#${number}/${port.name}`);
  }

  function makeRows(net, ports) {
    table.replaceChildren(...ports.map((port) => {
      const cell = h("td.value", {}, "–");
      outputs.set(port.name, { ...port, cell, label: null });
      return h("tr", {}, h("td", {}, port.name), cell, h("td.dim", {}, `${port.type}${port.unit ? ` ${port.unit}` : ""}`),
        h("td", {}, h("button.quiet", { onclick: () => curve(net, port) }, "Curve")));
    }));
  }

  function curve(net, port) {
    addCurve({ net, port: port.name, unit: port.unit });
    location.hash = "#/curves";
  }

  function draw(source) {
    // The page's style sheet has these classes; the policy of the page blocks inline styles.
    const plain = source.replace(/<style>[^]*?<\/style>/, "");
    svg = document.importNode(new DOMParser().parseFromString(plain, "image/svg+xml").documentElement, true);
    svg.removeAttribute("role");
    crop();
    for (const group of svg.querySelectorAll("g.primitive")) {
      const names = [...group.querySelectorAll("text.port[text-anchor=end]")];
      for (const name of names) {
        const begin = `${group.dataset.id}.${name.textContent.replace(/…$/, "")}`;
        const output = [...outputs.entries()].find(([port]) => port === begin) ?? [...outputs.entries()].find(([port]) => name.textContent.endsWith("…") && port.startsWith(begin));
        const label = name.nextElementSibling;
        if (!output || !label) continue;
        output[1].label = label;
        label.classList.add("live");
        for (const element of [name, label]) {
          element.classList.add("clickable");
          element.addEventListener("click", () => curve(current()?.net ?? "", { name: output[0], unit: output[1].unit }));
        }
      }
    }
    graph.replaceChildren(svg);
    fit();
  }

  /** Removes name and description, which are above the graph already. */
  function crop() {
    svg.querySelectorAll(":scope > .title, :scope > .words, :scope > title").forEach((text) => text.remove());
    const [, , width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    const top = Number(/translate\([^,]*,([^)]*)\)/.exec(svg.querySelector("g").getAttribute("transform"))[1]) - 24;
    svg.setAttribute("viewBox", `0 ${top} ${width} ${height - top}`);
  }

  function fit() {
    if (!svg) return;
    const width = Number(svg.getAttribute("viewBox").split(" ")[2]);
    factor = Math.min(1.15, Math.max(0.35, (graph.clientWidth - 4) / width));
    apply();
  }

  function scale(by) {
    factor = Math.min(4, Math.max(0.1, factor * by));
    apply();
  }

  function apply() {
    const [, , width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    svg.setAttribute("width", width * factor);
    svg.setAttribute("height", height * factor);
  }

  function showValues() {
    for (const [, one] of series.all) {
      if (one.about.id !== number) continue;
      const output = outputs.get(one.about.port);
      if (!output) continue;
      setText(output.cell, value(one.last, one.about.unit));
      if (output.label) {
        setText(output.label, value(one.last, one.about.unit, 3));
        output.label.classList.toggle("is-null", one.last === null);
        output.label.classList.toggle("is-true", one.last === true);
      }
    }
  }

  const keys = (event) => {
    if (event.target.closest("input, select, textarea") || graph.hidden || !svg) return;
    if (event.key === "+") scale(1.25);
    else if (event.key === "-") scale(0.8);
    else if (event.key === "0") fit();
  };
  addEventListener("keydown", keys);
  const off = [on("nets", show), on("values", showValues)];
  showTab("Graph");
  show();
  load();
  return () => {
    gone = true;
    removeEventListener("keydown", keys);
    watch("net", null);
    off.forEach((stop) => stop());
  };
}
