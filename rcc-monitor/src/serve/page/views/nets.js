// All nets with state and outcome, searchable, and their commands.

import { cancel, start } from "../commands.js";
import { h, reconcile, setText } from "../dom.js";
import { duration, grouped, isActive, outcome, stateKind, time } from "../format.js";
import { on, state } from "../stream.js";

const kept = { text: "", filter: "all" };
const FILTERS = [["all", "All"], ["active", "Active"], ["ready", "Ready"], ["ended", "Ended"], ["bad", "Faults"]];

export function open(view) {
  const search = h("input", { type: "search", placeholder: "Search nets   /", "aria-label": "Search nets", value: kept.text, oninput: () => { kept.text = search.value; show(); } });
  const filters = h("div.segments", { role: "group", "aria-label": "Filter" }, FILTERS.map(([id, title]) =>
    h("button", { "data-filter": id, onclick: () => { kept.filter = id; show(); } }, title)));
  const count = h("span.dim");
  const body = h("tbody");
  const heads = [["Net", ""], ["State", ""], ["Cycles", "number"], ["Time", "number"], ["Last", "number"], ["Longest", "number"], ["Uses", "wide"], ["", ""]];
  const empty = h("p.empty", {}, "No net is loaded. `rcc-cli load FILE` loads one.");
  view.append(h("div.bar", {}, search, filters, count),
    h("div.scroll", {}, h("table.nets", {}, h("thead", {}, h("tr", {}, heads.map(([title, kind]) => h(kind ? `th.${kind}` : "th", {}, title)))), body)), empty);

  function show() {
    const text = kept.text.toLowerCase();
    const all = [...state.nets.values()].sort((a, b) => isActive(b) - isActive(a) || b.id - a.id);
    const rows = all.filter((net) => matches(net, text) && passes(net, kept.filter));
    for (const button of filters.children) button.setAttribute("aria-pressed", String(button.dataset.filter === kept.filter));
    setText(count, `${rows.length} of ${all.length}`);
    empty.hidden = all.length > 0;
    reconcile(body, rows, (net) => net.id, makeRow, updateRow);
  }
  const off = on("nets", show);
  show();
  return off;
}

const matches = (net, text) => !text || `${net.net}#${net.id} ${net.description ?? ""} ${(net.uses ?? []).join(" ")}`.toLowerCase().includes(text);

function passes(net, filter) {
  switch (filter) {
    case "active": return isActive(net);
    case "ready": return net.state === "ready";
    case "ended": return net.state === "terminated";
    case "bad": return stateKind(net) === "bad";
    default: return true;
  }
}

function makeRow(net) {
  const link = h("a", { href: `#/net/${net.id}` }, h("strong", {}, net.net), h("span.dim", {}, `#${net.id}`));
  const [go, stop] = [h("button.quiet", { onclick: () => start(state.nets.get(net.id)) }, "START"), h("button.quiet.stop", { onclick: () => cancel(state.nets.get(net.id)) }, "CANCEL")];
  go.setAttribute("aria-label", `START ${net.net}`);
  stop.setAttribute("aria-label", `CANCEL ${net.net}`);
  return h("tr", {}, h("td", {}, link), h("td", {}, h("span.badge")), h("td.number"), h("td.number"), h("td.number"), h("td.number"), h("td.wide"), h("td.buttons", {}, go, stop));
}

function updateRow(row, net) {
  const badge = row.querySelector(".badge");
  setText(badge, outcome(net));
  badge.className = `badge ${stateKind(net)}`;
  const title = net.fault?.words ?? net.finding ?? net.description ?? "";
  if (row.title !== title) row.title = title;
  const cells = row.children;
  setText(cells[2], grouped(net.cycles));
  setText(cells[3], net.cycles ? duration(runTime(net)) : "–");
  setText(cells[4], net.cycles ? time(net.exec_last_ns) : "–");
  setText(cells[5], net.cycles ? time(net.exec_max_ns) : "–");
  setText(cells[6], (net.uses ?? []).join(", "));
  const [go, stop] = cells[7].children;
  go.hidden = net.state !== "ready" || !state.mayStart;
  stop.hidden = !isActive(net);
}

export function runTime(net) {
  const now = state.cell?.status?.executor?.cycle ?? 0;
  const last = isActive(net) ? Math.max(now, net.started_cycle) : net.ended_cycle;
  return Math.max(0, last - net.started_cycle + 1) * state.periodS;
}

/** A card of an active net, for the overview. */
export function netCard(net) {
  const stop = h("button.stop", { onclick: () => cancel(state.nets.get(net.id)), "aria-label": `CANCEL ${net.net}` }, "CANCEL");
  return h("article.card", { "aria-label": `Net ${net.net}` },
    h("header", {}, h("a", { href: `#/net/${net.id}` }, h("strong", {}, net.net), h("span.dim", {}, `#${net.id}`)), h("span.badge")),
    h("div.meta"), h("div.facts"), h("footer", {}, stop, h("a.button.quiet", { href: `#/net/${net.id}` }, "Graph")));
}

export function updateNetCard(card, net) {
  const badge = card.querySelector(".badge");
  setText(badge, outcome(net));
  badge.className = `badge ${stateKind(net)}`;
  setText(card.querySelector(".meta"), net.description ?? "");
  setText(card.querySelector(".facts"), `${duration(runTime(net))}; ${grouped(net.cycles)} cycles; ${time(net.exec_last_ns)}, longest ${time(net.exec_max_ns)}${net.uses?.length ? `; uses ${net.uses.join(", ")}` : ""}`);
}
