// The event log: newest first, filtered, with runs of equal events folded.

import { h, reconcile, setText } from "../dom.js";
import { clock, grouped } from "../format.js";
import { on, state } from "../stream.js";

const kept = { severity: "info", text: "", fold: true };
const RANK = { info: 0, warning: 1, error: 2 };
const ROWS_MAX = 400;

export function open(view) {
  const search = h("input", { type: "search", placeholder: "Search events   /", "aria-label": "Search events", value: kept.text, oninput: () => { kept.text = search.value; show(); } });
  const severity = h("div.segments", { role: "group", "aria-label": "Severity" }, [["info", "All"], ["warning", "Warnings"], ["error", "Errors"]].map(([id, title]) =>
    h("button", { "data-id": id, onclick: () => { kept.severity = id; show(); } }, title)));
  const fold = h("input", { type: "checkbox", checked: kept.fold, onchange: () => { kept.fold = fold.checked; show(); } });
  const body = h("tbody");
  const count = h("span.dim");
  view.append(h("div.bar", {}, search, severity, h("label", {}, fold, " Fold equal events"), count),
    h("div.scroll", {}, h("table.events", {}, h("thead", {}, h("tr", {}, h("th", {}, "Time (UTC)"), h("th.number", {}, "Cycle"), h("th", {}, "Who"), h("th", {}, "What"))), body)));

  function show() {
    for (const button of severity.children) button.setAttribute("aria-pressed", String(button.dataset.id === kept.severity));
    const text = kept.text.toLowerCase();
    const rows = state.events.map((event, index) => ({ event, index }))
      .filter(({ event }) => RANK[event.severity] >= RANK[kept.severity])
      .filter(({ event }) => !text || `${event.words} ${event.source.role} ${event.source.label} ${event.kind} ${event.net ?? ""}`.toLowerCase().includes(text));
    const folded = kept.fold ? foldRows(rows) : rows;
    setText(count, `${grouped(rows.length)} of ${grouped(state.events.length)}`);
    reconcile(body, folded.reverse().slice(0, ROWS_MAX), key, makeRow, updateRow);
  }
  const off = on("events", show);
  show();
  return off;
}

const key = ({ event }) => `${event.monotonic_ns}/${event.source.incarnation}/${event.kind}/${event.fields?.command ?? ""}/${event.fields?.device ?? ""}`;

/** Joins neighbours of the same kind and source that differ in numbers only. */
function foldRows(rows) {
  const out = [];
  for (const row of rows) {
    const last = out.at(-1);
    const same = last && last.event.kind === row.event.kind && last.event.source.role === row.event.source.role && last.event.source.label === row.event.source.label
      && shape(last.event) === shape(row.event);
    if (same) {
      last.count += 1;
      last.until = row.event;
      if (row.event.kind === "late") last.late = (last.late ?? last.event.fields.count) + (row.event.fields.count ?? 0);
    } else out.push({ ...row, count: 1 });
  }
  return out;
}

const shape = (event) => (event.kind === "late" ? "late" : event.words.replace(/[0-9][0-9  .,]*/g, "0"));

function makeRow() {
  return h("tr", {}, h("td.mono"), h("td.number"), h("td"), h("td.words"));
}

function updateRow(row, { event, count, until, late }) {
  row.className = event.severity;
  const cells = row.children;
  setText(cells[0], clock(event.time));
  setText(cells[1], event.cycle === null || event.cycle === undefined ? "" : grouped(event.cycle));
  setText(cells[2], `${event.source.role}${event.source.role === "driver" ? ` ${event.source.label}` : ""}`);
  const more = count > 1 ? `  (${late ? `${grouped(late)} late cycles in ` : ""}${count} such events, the last at ${clock(until.time)})` : "";
  setText(cells[3], `${event.words || event.kind}${more}`);
  row.title = `${event.kind}  ${event.time}`;
}
