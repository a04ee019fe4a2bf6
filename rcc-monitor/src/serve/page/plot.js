// Curves: uPlot with the page's colours, a legend with values, zoom by wheel and keys, and cursors.

/* global uPlot */

import { colour } from "./dom.js";
import { element } from "./format.js";

export const COLOURS = Array.from({ length: 10 }, (_, index) => `--curve-${index}`);

const axis = (more) => ({
  stroke: () => colour("--dim"),
  grid: { stroke: () => colour("--grid"), width: 1 },
  ticks: { stroke: () => colour("--grid"), width: 1, size: 4 },
  font: "11px system-ui, sans-serif",
  ...more,
});

/** Makes a plot in `parent`; `lines` are `{label, unit, colour}`; `hooks` may draw and be told of zooms. */
export function makePlot(parent, lines, hooks = {}) {
  const units = [...new Set(lines.map((line) => line.unit ?? ""))];
  const scale = (unit) => (units.length <= 1 ? "y" : `y${units.indexOf(unit ?? "")}`);
  const shown = units.slice(0, 2);
  const options = {
    width: Math.max(200, parent.clientWidth),
    height: Math.max(160, parent.clientHeight),
    pxAlign: 0,
    cursor: { drag: { x: true, y: false }, focus: { prox: 24 }, points: { size: 6 } },
    focus: { alpha: 0.35 },
    legend: { live: true },
    scales: { x: { time: false, range: hooks.range ?? undefined } },
    axes: [
      axis({ values: (_, splits) => splits.map((split) => hooks.xLabel ? hooks.xLabel(split) : `${Number(split.toFixed(4))}`), label: hooks.xTitle ?? "s", labelSize: 18, labelFont: "11px system-ui", size: 34 }),
      ...shown.map((unit, index) => axis({
        scale: scale(unit), side: index === 0 ? 3 : 1, size: 58, label: unit || "", labelSize: unit ? 16 : 0, labelFont: "11px system-ui",
        grid: { show: index === 0, stroke: () => colour("--grid"), width: 1 },
        values: (_, splits) => splits.map((split) => Math.abs(split) >= 1e5 || (split !== 0 && Math.abs(split) < 1e-4) ? split.toExponential(1) : `${Number(split.toFixed(6))}`),
      })),
    ],
    series: [
      { label: "t", value: (_, raw) => (raw === null || raw === undefined ? "–" : `${raw.toFixed(3)} s`) },
      ...lines.map((line) => ({
        label: line.label,
        scale: scale(line.unit),
        stroke: () => colour(line.colour),
        width: 1.5,
        spanGaps: false,
        points: { show: false },
        paths: line.steps ? uPlot.paths.stepped({ align: 1 }) : undefined,
        value: (_, raw) => (raw === null || raw === undefined || Number.isNaN(raw) ? "–" : `${element(raw)}${line.unit ? ` ${line.unit}` : ""}`),
      })),
    ],
    hooks: {
      draw: hooks.draw ? [hooks.draw] : [],
      setSelect: hooks.zoomed ? [(plot) => plot.select.width > 2 && hooks.zoomed(plot.posToVal(plot.select.left, "x"), plot.posToVal(plot.select.left + plot.select.width, "x"))] : [],
      setCursor: hooks.moved ? [(plot) => hooks.moved(plot.cursor.left >= 0 ? plot.posToVal(plot.cursor.left, "x") : null)] : [],
    },
  };
  const empty = [[], ...lines.map(() => [])];
  const plot = new uPlot(options, empty, parent);
  // The legend is as high as its lines need; the curves get the rest.
  const fit = () => {
    const style = getComputedStyle(parent);
    const legend = parent.querySelector(".u-legend")?.offsetHeight ?? 0;
    const width = parent.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    const height = Math.max(120, parent.clientHeight - parseFloat(style.paddingTop) - parseFloat(style.paddingBottom) - legend);
    if (width > 0 && (plot.width !== width || plot.height !== height)) plot.setSize({ width, height });
  };
  fit();
  const observer = new ResizeObserver(fit);
  observer.observe(parent);
  observer.observe(parent.querySelector(".u-legend"));
  const scheme = matchMedia("(prefers-color-scheme: dark)");
  const redraw = () => plot.redraw();
  scheme.addEventListener("change", redraw);
  return {
    plot,
    destroy() {
      scheme.removeEventListener("change", redraw);
      observer.disconnect();
      plot.destroy();
    },
  };
}

/** Calls `chosen(x, event)` for a press and release at one place; a drag is a zoom. */
export function onPoint(plot, chosen) {
  let from = null;
  plot.over.addEventListener("pointerdown", (event) => { from = event.button === 0 ? [event.clientX, event.clientY] : null; });
  plot.over.addEventListener("pointerup", (event) => {
    const moved = from && Math.hypot(event.clientX - from[0], event.clientY - from[1]);
    from = null;
    if (moved === null || moved > 3) return;
    chosen(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"), event);
  });
}

/** Draws a vertical line with a label; for `hooks.draw`. */
export function drawLine(plot, x, name, label = "", dashed = true) {
  const at = plot.valToPos(x, "x", true);
  const { left, top, width, height } = plot.bbox;
  if (!(at >= left && at <= left + width)) return;
  const pen = plot.ctx;
  pen.save();
  pen.strokeStyle = colour(name);
  pen.fillStyle = colour(name);
  pen.lineWidth = 1.5 * devicePixelRatio;
  if (dashed) pen.setLineDash([5 * devicePixelRatio, 4 * devicePixelRatio]);
  pen.beginPath();
  pen.moveTo(at, top);
  pen.lineTo(at, top + height);
  pen.stroke();
  pen.font = `${11 * devicePixelRatio}px system-ui`;
  pen.textAlign = "left";
  pen.fillText(label, at + 4 * devicePixelRatio, top + 12 * devicePixelRatio);
  pen.restore();
}

/** Draws a horizontal line at a value of a scale. */
export function drawLevel(plot, value, name, scaleName = "y") {
  const at = plot.valToPos(value, scaleName in plot.scales ? scaleName : "y0", true);
  const { left, top, width, height } = plot.bbox;
  if (!(at >= top && at <= top + height)) return;
  const pen = plot.ctx;
  pen.save();
  pen.strokeStyle = colour(name);
  pen.lineWidth = devicePixelRatio;
  pen.setLineDash([2 * devicePixelRatio, 4 * devicePixelRatio]);
  pen.beginPath();
  pen.moveTo(left, at);
  pen.lineTo(left + width, at);
  pen.stroke();
  pen.restore();
}

/** Puts series with times of their own on one axis: a value between two samples is absent, not a gap. */
export function joined(parts) {
  const single = parts.length === 1 || parts.every((part) => sameTimes(part.times, parts[0].times));
  if (single) return [parts[0]?.times ?? [], ...parts.flatMap((part) => part.columns.map(withGaps))];
  const tables = parts.map((part) => [part.times, ...part.columns.map(withGaps)]);
  const modes = parts.map((part) => [null, ...part.columns.map(() => 2)]);
  return uPlot.join(tables, modes);
}

function sameTimes(a, b) {
  return a.length === b.length && a[0] === b[0] && a[a.length - 1] === b[b.length - 1];
}

/** uPlot leaves a gap at null, and would draw through NaN's neighbours. */
function withGaps(column) {
  return Array.from(column, (value) => (Number.isNaN(value) ? null : value));
}

/** Reduces columns to about `most` points; each step keeps the smallest and the largest value, so that no peak is lost. */
export function reduced(times, columns, most) {
  const count = times.length;
  if (count <= most * 2) return { times, columns };
  const step = Math.ceil(count / most);
  const outTimes = [];
  const out = columns.map(() => []);
  for (let from = 0; from < count; from += step) {
    const to = Math.min(count, from + step);
    outTimes.push(times[from], times[Math.min(to - 1, from + (step >> 1))]);
    columns.forEach((column, index) => {
      let least = Infinity, most_ = -Infinity, leastAt = from, mostAt = from, gap = false;
      for (let at = from; at < to; at++) {
        const value = column[at];
        if (Number.isNaN(value)) gap = true;
        else {
          if (value < least) [least, leastAt] = [value, at];
          if (value > most_) [most_, mostAt] = [value, at];
        }
      }
      if (gap || least === Infinity) out[index].push(least === Infinity ? NaN : least, NaN);
      else out[index].push(...(leastAt <= mostAt ? [least, most_] : [most_, least]));
    });
  }
  return { times: outTimes, columns: out };
}

/** Offers text as a file. */
export function download(name, text, type = "text/csv") {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

export function csv(head, rows) {
  const cell = (value) => (value === null || value === undefined || Number.isNaN(value) ? "" : String(value));
  return [head.map((name) => `"${name.replaceAll("\"", "\"\"")}"`).join(","), ...rows.map((row) => row.map(cell).join(","))].join("\n") + "\n";
}
