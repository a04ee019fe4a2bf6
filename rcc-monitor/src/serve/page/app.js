// The page's frame: views by hash, keyboard, health, and CANCEL, which is always at hand.

import { activeNets, cancelAll } from "./commands.js";
import { confirm, h, setText } from "./dom.js";
import { connect, on, state } from "./stream.js";
import * as arms from "./views/arms.js";
import * as curves from "./views/curves.js";
import * as events from "./views/events.js";
import * as incidents from "./views/incidents.js";
import * as net from "./views/net.js";
import * as nets from "./views/nets.js";
import * as overview from "./views/overview.js";
import * as scope from "./views/scope.js";

const VIEWS = [
  ["overview", "Cell", overview],
  ["nets", "Nets", nets],
  ["curves", "Curves", curves],
  ["scope", "Scope", scope],
  ["arms", "Arms", arms],
  ["events", "Events", events],
  ["incidents", "Incidents", incidents],
];

const view = document.getElementById("view");
let close = null;

function route() {
  const [name = "overview", ...rest] = location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  const known = name === "net" ? ["nets", "Net", net] : VIEWS.find(([id]) => id === name) ?? VIEWS[0];
  close?.();
  view.replaceChildren();
  view.className = `view-${name || "overview"}`;
  close = known[2].open(view, rest) ?? null;
  for (const link of document.querySelectorAll("#nav a")) {
    if (link.dataset.view === known[0]) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.title = `${state.cell?.cell ?? "RCC"}: ${known[1]}`;
  scrollTo(0, 0);
}

document.getElementById("nav").append(...VIEWS.map(([id, title], index) =>
  h("a", { href: `#/${id}`, "data-view": id, title: `${title} (${index + 1})`, "aria-keyshortcuts": String(index + 1) }, title)));

const cancelButton = document.getElementById("cancel");
cancelButton.addEventListener("click", cancelAll);

function help() {
  const keys = [
    ["Shift+C", "CANCEL all active nets"],
    ["1 … 7", "views"],
    ["Space", "pause and continue curves or scope; play an incident"],
    ["← →", "move the cursor of an incident; with Shift ten times as far"],
    ["+ − 0", "zoom curves and graphs, or show all"],
    ["/", "search"],
    ["?", "this help"],
  ];
  confirm("Keys", [h("dl.keys", {}, keys.map(([key, what]) => [h("dt", {}, h("kbd", {}, key)), h("dd", {}, what)]))], "Close");
}

addEventListener("keydown", (event) => {
  const typing = event.target.closest?.("input, select, textarea");
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  // CANCEL works from everywhere but a text field, also while a dialog asks something.
  if (event.shiftKey && event.key === "C" && !(typing && typing.type !== "checkbox")) {
    event.preventDefault();
    cancelAll();
    return;
  }
  if (typing || document.getElementById("dialog").open) return;
  if (event.key === "?") help();
  else if (event.key === "/") {
    const search = view.querySelector("input[type=search]");
    if (search) {
      event.preventDefault();
      search.focus();
    }
  } else if (/^[1-7]$/.test(event.key)) location.hash = `#/${VIEWS[Number(event.key) - 1][0]}`;
});

const health = document.getElementById("health");
const banner = document.getElementById("banner");

function showHealth() {
  const executor = state.cell?.status?.executor;
  const trouble = state.cell?.trouble;
  const late = executor ? executor.late - executor.late_acknowledged : 0;
  const devices = state.cell?.devices ?? [];
  const away = devices.filter((device) => device.state === "offline" || device.state === "online").length;
  let kind = "good", text = "healthy";
  if (!state.connected) [kind, text] = ["bad", "no connection"];
  else if (!state.cell) [kind, text] = ["calm", "waiting"];
  else if (trouble) [kind, text] = ["bad", "cell unreachable"];
  else if (away) [kind, text] = ["warn", `${away} of ${devices.length} devices not ready`];
  else if (late) [kind, text] = ["warn", `${late} late`];
  health.className = kind;
  setText(health, text);
  setText(document.getElementById("cell-name"), state.cell?.cell ?? "RCC");
  const problem = !state.connected
    ? "The dashboard's server does not answer. What is shown is old. If it was started again, open its new address (rcc-cli serve)."
    : trouble ? `${trouble.message}. What is shown is old. ${trouble.help ?? ""}` : "";
  banner.hidden = !problem;
  setText(banner, problem);
  document.body.classList.toggle("stale", Boolean(problem));
}

function showCancel() {
  const count = activeNets().length;
  setText(document.getElementById("cancel-count"), count ? String(count) : "");
  cancelButton.classList.toggle("idle", count === 0);
  cancelButton.setAttribute("aria-label", count ? `CANCEL ${count} active nets` : "CANCEL: no net is active");
}

on("cell", showHealth);
on("connection", showHealth);
on("nets", showCancel);
addEventListener("hashchange", route);
showHealth();
showCancel();
connect();
route();
// For tests: what the page knows.
globalThis.rcc = { state };
