// The cell at a glance: real-time grade, cycles, late cycles with their causes, devices and the quality of their
// connections, active nets, processes.

import { getJson, post } from "../commands.js";
import { colour, h, note, reconcile, setText, sparkline } from "../dom.js";
import { grouped, percent, significant, time } from "../format.js";
import { on, state } from "../stream.js";
import { netCard, updateNetCard } from "./nets.js";

export function open(view) {
  const cycles = panel("Cycles"), grade = panel("Real time"), late = panel("Late cycles"), budget = panel("Load of a cycle");
  const acknowledge = h("button.quiet", { onclick: acknowledgeLate, title: "Count late cycles and worst values anew" }, "Acknowledge");
  late.append(acknowledge);
  const nets = h("div.cards", {}), empty = h("p.empty", {}, "No net is active.");
  const devices = h("div.cards", {});
  const histogram = h("div.histograms", {});
  const processes = h("tbody");
  const problems = h("div.problems", { role: "alert" });
  view.append(
    problems,
    h("div.tiles", {}, cycles, late, budget, grade),
    h("section", {}, h("h2", {}, "Active nets"), nets, empty),
    h("section", {}, h("h2", {}, "Devices"), devices),
    h("section", {}, h("h2", {}, "Timing"), histogram),
    h("details", {}, h("summary", {}, "Processes"),
      h("table", {}, h("thead", {}, h("tr", {}, ["Role", "Label", "PID", "State", "Note"].map((head) => h("th", {}, head)))), processes)),
  );
  let lastCycle = null, rate = null;

  function show() {
    const cell = state.cell;
    const executor = cell?.status?.executor;
    problems.replaceChildren(...(cell?.status?.configuration ?? []).map((text) => h("p.warn", {}, text)));
    if (executor) {
      const now = performance.now();
      if (lastCycle && lastCycle.incarnation === executor.incarnation && now - lastCycle.at > 300) {
        rate = (executor.cycle - lastCycle.cycle) / ((now - lastCycle.at) / 1000);
      }
      lastCycle = { cycle: executor.cycle, at: now, incarnation: executor.incarnation };
      tile(cycles, grouped(executor.cycle), `every ${time(executor.period_ns)}${rate ? `, ${Math.round(rate)} a second` : ""}; clock ${executor.clock.state}${executor.clock.device ? ` to ${executor.clock.device}` : ""}`);
      const open = executor.late - executor.late_acknowledged;
      tile(late, grouped(open), lateWords(executor), open ? "warn" : "good");
      acknowledge.hidden = open === 0 && executor.worst_wake_ns === 0;
      const share = executor.budget_ns ? executor.committed_ns / executor.budget_ns : null;
      tile(budget, time(executor.exec_last_ns), `longest ${time(executor.exec_max_ns)}${share !== null ? `; ${percent(share * 1000)} of the budget of ${time(executor.budget_ns)} promised to nets` : ""}`, executor.exec_max_ns > executor.period_ns ? "warn" : "");
      const granted = executor.grade.startsWith("RT: granted");
      tile(grade, granted ? "granted" : "degraded", executor.grade.replace(/^RT: (granted|degraded, because )\s*/, ""), granted ? "good" : "warn");
    } else {
      [cycles, late, budget, grade].forEach((one) => tile(one, "–", "no executor"));
    }
    reconcile(devices, cell?.devices ?? [], (device) => device.name, deviceCard, updateDevice);
    reconcile(processes, cell?.status?.processes ?? [], (process) => process.incarnation + process.role + process.label,
      () => h("tr", {}, Array.from({ length: 5 }, () => h("td"))), updateProcess);
  }

  function showNets() {
    const active = [...state.nets.values()].filter((net) => net.state === "running" || net.state === "canceling");
    empty.hidden = active.length > 0;
    reconcile(nets, active, (net) => net.id, netCard, updateNetCard);
  }

  async function showTiming() {
    if (document.hidden || !state.connected) return;
    const { answer } = await getJson("/api/timing");
    if (answer) histogram.replaceChildren(...distributions(answer));
  }

  const off = [on("cell", show), on("nets", showNets)];
  const timer = setInterval(showTiming, 2000);
  show();
  showNets();
  showTiming();
  return () => {
    off.forEach((stop) => stop());
    clearInterval(timer);
  };
}

const panel = (title) => h("div.tile", {}, h("h3", {}, title), h("div.big"), h("div.words"));

function tile(panel, big, words, kind = "") {
  panel.className = `tile ${kind}`;
  setText(panel.querySelector(".big"), big);
  setText(panel.querySelector(".words"), words);
}

function lateWords(executor) {
  const last = executor.last_late;
  if (!last) return `of ${grouped(executor.cycle)}; longest wake-up delay ${time(executor.worst_wake_ns)}`;
  const net = last.net && last.cause === "computed long" ? `, ${last.net} ${time(last.net_ns)}` : "";
  return `last: cycle ${grouped(last.cycle)} ${last.cause} (woke ${time(last.wake_ns)} late, computed ${time(last.exec_ns)}${net}), skipped ${last.skipped_periods}`;
}

async function acknowledgeLate() {
  const { answer, error } = await post("/api/acknowledge");
  if (error) note(error.message, "error", error.help);
  else note(`${grouped(answer.late)} late cycles acknowledged`, "good");
}

const DEVICE_KIND = { ready: "good", commanded: "run", stopping: "warn", online: "warn", offline: "bad" };

function deviceCard(device) {
  return h("article.card.device", { "aria-label": `Device ${device.name}` },
    h("header", {}, h("strong", {}, device.name), h("span.badge")),
    h("div.meta"), h("canvas.spark", { role: "img" }), h("div.facts"));
}

function updateDevice(card, device) {
  const badge = card.querySelector(".badge");
  setText(badge, device.state);
  badge.className = `badge ${DEVICE_KIND[device.state] ?? "calm"}`;
  const peer = device.history?.peer;
  setText(card.querySelector(".meta"), device.reason || `${device.driver}${peer ? ` at ${peer}` : ""}${device.holder ? `, held by ${device.holder}` : ""}`);
  card.classList.toggle("trouble", Boolean(device.reason));
  const history = device.history;
  const spark = card.querySelector("canvas");
  spark.setAttribute("aria-label", `quality of the connection in the last minute, now ${percent(device.quality_permille)}`);
  sparkline(spark, history?.quality ?? [], 1000, colour(device.quality_permille >= 900 ? "--good" : device.quality_permille >= 500 ? "--warn" : "--bad"));
  setText(card.querySelector(".facts"), `quality ${percent(device.quality_permille)}; lost ${grouped(device.losses)}${history ? `; late ${grouped(history.late_total)}, refused ${grouped(history.refused_total)}` : ""}${device.joints.length ? `; ${device.joints.length} joints` : ""}${device.channels.length ? `; ${device.channels.length} channels` : ""}`);
}

function updateProcess(row, process) {
  const texts = [process.role, process.label, process.pid ? String(process.pid) : "–", process.alive ? "alive" : "dead", process.note];
  texts.forEach((text, index) => setText(row.children[index], text));
  row.className = process.alive ? "" : "bad";
}

/** Bars of the distributions of wake-up delay and computing time, on a logarithmic axis. */
function distributions(timing) {
  const rows = [["Wake-up delay", timing.wake], ["Computing time", timing.exec]];
  return rows.map(([title, histogram]) => {
    const buckets = histogram.buckets;
    const most = Math.max(1, ...buckets.map((bucket) => Math.log10(bucket.count + 1)));
    const bars = buckets.map((bucket) => {
      const bar = h("i", { title: `up to ${time(bucket.to_ns)}: ${grouped(bucket.count)} cycles` });
      bar.style.height = `${Math.max(3, (Math.log10(bucket.count + 1) / most) * 100)}%`;
      if (bucket.to_ns > timing.period_ns) bar.className = "over";
      return bar;
    });
    const words = `median ${time(histogram.p50_ns)}, 99 % ${time(histogram.p99_ns)}, 99.9 % ${time(histogram.p999_ns)}, longest ${time(histogram.max_ns)}`;
    return h("figure", {}, h("figcaption", {}, h("strong", {}, title), ` ${words}`),
      h("div.bars", { role: "img", "aria-label": `${title}: ${words}` }, bars),
      h("div.ends", {}, h("span", {}, buckets.length ? `≤ ${time(buckets[0].to_ns)}` : ""), h("span", {}, buckets.length ? `≤ ${time(buckets.at(-1).to_ns)}` : "")));
  }).concat(primitives(timing));
}

function primitives(timing) {
  const all = timing.primitives.reduce((sum, one) => sum + one.sum_ns, 0) || 1;
  const rows = timing.primitives.slice(0, 6).map((one) => {
    const bar = h("i");
    bar.style.width = `${(one.sum_ns / all) * 100}%`;
    return h("tr", {}, h("td", {}, one.type), h("td.number", {}, `${significant((one.sum_ns / all) * 100, 2)} %`), h("td.share", {}, bar));
  });
  return rows.length ? [h("figure", {}, h("figcaption", {}, h("strong", {}, "Computing time by primitive")), h("table.compact", {}, h("tbody", {}, rows)))] : [];
}
