// The one connection to the server: state, events and values of everything, over server-sent events. A browser allows six
// connections to a host, so one stream serves all views.

import { SeriesStore } from "./series.js";

export const state = {
  viewer: null,
  connected: false,
  cell: null,
  mayStart: false,
  version: "",
  nets: new Map(),
  executor: "",
  events: [],
  arms: new Map(),
  refused: {},
  lost: 0,
  periodS: 0.001,
};

export const series = new SeriesStore();

const EVENTS_MAX = 2000;
const listeners = new Map();
const watches = new Map();
let source = null;

/** Calls `listener` at each event of this kind: cell, nets, events, arms, values, connection, refused, lost. */
export function on(kind, listener) {
  if (!listeners.has(kind)) listeners.set(kind, new Set());
  listeners.get(kind).add(listener);
  return () => listeners.get(kind).delete(listener);
}

function emit(kind, data) {
  for (const listener of listeners.get(kind) ?? []) listener(data);
}

export function connect() {
  source = new EventSource("/api/stream");
  const take = (kind, handle) => source.addEventListener(kind, (event) => handle(JSON.parse(event.data)));
  take("hello", (data) => {
    state.viewer = data.viewer;
    state.mayStart = data.may_start;
    state.version = data.version;
    state.connected = true;
    // Whatever happened in between was missed: curves get a gap.
    series.gap();
    sendWatch();
    emit("connection", true);
  });
  take("cell", (data) => {
    state.cell = data;
    const period = data.status?.executor?.period_ns;
    if (period) state.periodS = period * 1e-9;
    emit("cell", data);
  });
  take("nets", takeNets);
  take("events", (data) => {
    if (data.anew) state.events = [];
    state.events.push(...data.events);
    if (state.events.length > EVENTS_MAX) state.events.splice(0, state.events.length - EVENTS_MAX);
    emit("events", data);
  });
  take("arms", (data) => {
    for (const arm of data.arms) state.arms.set(arm.device, { ...arm, at: performance.now() });
    emit("arms", data);
  });
  take("values", (data) => {
    series.add(data, state.periodS);
    emit("values", data);
  });
  take("refused", (data) => {
    state.refused = data;
    emit("refused", data);
  });
  take("lost", (data) => {
    state.lost += data.updates ?? data.records ?? data.samples ?? data.values ?? 0;
    series.gap(data.samples ? "sample" : data.records ? "monitor" : null);
    emit("lost", data);
  });
  take("trouble", (data) => emit("trouble", data));
  source.onerror = () => {
    state.connected = false;
    state.viewer = null;
    emit("connection", false);
    // The browser connects again by itself, unless the server refused the request (a new server has a new token).
    if (source.readyState === EventSource.CLOSED) {
      source.close();
      setTimeout(connect, 3000);
    }
  };
}

function takeNets(data) {
  if (data.executor && data.executor !== state.executor) {
    if (state.executor) state.nets.clear();
    state.executor = data.executor;
  }
  const ids = new Set(data.ids);
  for (const id of state.nets.keys()) if (!ids.has(id)) state.nets.delete(id);
  for (const row of data.rows) state.nets.set(row.id, row);
  emit("nets", data);
}

/** Watches ports for a view; `null` ends it. All views together have one watch at the highest rate. */
export function watch(view, wanted) {
  if (wanted) watches.set(view, wanted);
  else watches.delete(view);
  sendWatch();
}

let sending = false, again = false;

async function sendWatch() {
  if (sending) {
    again = true;
    return;
  }
  sending = true;
  do {
    again = false;
    if (state.viewer === null) break;
    const all = [...watches.values()];
    const ports = [...new Set(all.flatMap((one) => one.ports ?? []))].sort();
    const rate = Math.max(1, ...all.map((one) => one.rate ?? 1));
    series.keepOnly(ports);
    try {
      const response = await fetch(`/api/viewers/${state.viewer}/watch`, {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({ ports, rate, arms: all.some((one) => one.arms) }),
      });
      if (!response.ok) emit("refused", { "": (await response.json()).message });
    } catch {
      // The stream breaks too, and the next hello sends it again.
    }
  } while (again);
  sending = false;
}
