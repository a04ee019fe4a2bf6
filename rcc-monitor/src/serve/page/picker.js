// Chooses ports of loaded nets: a search field with a list, usable with the keyboard alone.

import { getJson } from "./commands.js";
import { h } from "./dom.js";
import { isActive } from "./format.js";
import { on, state } from "./stream.js";

const details = new Map();

/** Returns the ports of a net: `{port, type, unit, width, monitored, input}`. */
export async function portsOf(net) {
  const key = `${state.executor}/${net.id}`;
  if (!details.has(key)) {
    if (details.size > 100) details.clear();
    details.set(key, getJson(`/api/nets/${net.id}`).then(({ answer }) => {
      const names = answer?.names;
      if (!names) {
        details.delete(key);
        return [];
      }
      const monitored = new Set(names.monitors.map((monitor) => monitor.source));
      const of = (primitive, ports, input) => ports.map((port) => ({
        port: `${primitive.id}.${port.name}`, type: port.type, unit: port.unit, width: port.width, kind: primitive.type, input,
        monitored: monitored.has(`${primitive.id}.${port.name}`),
      }));
      return names.primitives.flatMap((primitive) => [...of(primitive, primitive.outputs, false), ...of(primitive, primitive.inputs, true)]);
    }));
  }
  return details.get(key);
}

/** Makes the field; `pick({net, id, port, type, unit, width, monitored})` is called for each choice. */
export function portPicker(label, pick) {
  const list = h("ul.options", { role: "listbox", id: `options-${Math.random().toString(36).slice(2)}`, hidden: true });
  const field = h("input", {
    type: "search", placeholder: `${label}   /`, "aria-label": label, role: "combobox", "aria-expanded": "false",
    "aria-controls": list.id, "aria-autocomplete": "list", autocomplete: "off", spellcheck: "false",
  });
  const box = h("div.picker", {}, field, list);
  let options = [], marked = 0, turn = 0;

  async function show() {
    const mine = ++turn;
    const text = field.value.trim().toLowerCase();
    const newest = new Map();
    for (const net of [...state.nets.values()].filter((net) => net.state !== "rejected" && net.state !== "loading")) newest.set(net.net, net);
    const nets = [...newest.values()].sort((a, b) => isActive(b) - isActive(a) || b.id - a.id);
    const words = text.split(/[\s/]+/).filter(Boolean);
    const wanted = nets.filter((net) => !words.length || nets.length <= 12 || words.some((word) => net.net.toLowerCase().includes(word))).slice(0, 12);
    const all = await Promise.all(wanted.map(async (net) => (await portsOf(net)).map((port) => ({ ...port, net: net.net, id: net.id, active: isActive(net) }))));
    if (mine !== turn) return;
    options = all.flat().filter((one) => !one.input || text.includes("."))
      .filter((one) => { const name = `${one.net}/${one.port} ${one.kind}`.toLowerCase(); return words.every((word) => name.includes(word)); })
      .sort((a, b) => b.active - a.active || b.monitored - a.monitored).slice(0, 60);
    marked = 0;
    draw();
  }

  function draw() {
    const rows = options.map((one, index) => h("li", {
      role: "option", id: `${list.id}-${index}`, "aria-selected": String(index === marked), onmousedown: (event) => { event.preventDefault(); choose(one); },
    }, h("span", {}, h("span.dim", {}, `${one.net}/`), one.port), h("span.dim", {}, `${one.type}${one.unit ? ` ${one.unit}` : ""}${one.monitored ? ", every cycle" : ""}${one.input ? ", input" : ""}`)));
    list.replaceChildren(...(rows.length ? rows : [h("li.dim", {}, state.nets.size ? "no such port" : "no net is loaded")]));
    list.hidden = false;
    field.setAttribute("aria-expanded", "true");
    field.setAttribute("aria-activedescendant", rows.length ? `${list.id}-${marked}` : "");
    list.children[marked]?.scrollIntoView({ block: "nearest" });
  }

  function hide() {
    list.hidden = true;
    turn++;
    field.setAttribute("aria-expanded", "false");
  }

  function choose(one) {
    pick(one);
    field.value = "";
    hide();
  }

  field.addEventListener("focus", show);
  field.addEventListener("input", show);
  field.addEventListener("blur", hide);
  field.addEventListener("keydown", (event) => {
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      marked = (marked + (event.key === "ArrowDown" ? 1 : -1) + options.length) % Math.max(1, options.length);
      draw();
    } else if (event.key === "Enter" && options[marked]) {
      event.preventDefault();
      choose(options[marked]);
      show();
    } else if (event.key === "Escape") hide();
  });
  box.stop = on("nets", () => { if (!list.hidden && !options.length) show(); });
  return box;
}
