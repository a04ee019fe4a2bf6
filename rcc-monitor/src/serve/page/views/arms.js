// The arms in 3D, with joints, their ranges, and the flange.

import { h, reconcile, setText } from "../dom.js";
import { Camera, attachOrbit, draw } from "../scene3d.js";
import { on, state, watch } from "../stream.js";

const TRAIL_MAX = 600;
const HUES = [212, 28, 152, 280];
const OLD_MS = 3000;
const camera = new Camera();

export function open(view) {
  const canvas = h("canvas.scene", { tabindex: 0, role: "img", "aria-label": "The arms of the cell in 3D. Arrow keys orbit, plus and minus zoom, 0 resets." });
  const side = h("div.arm-list"), empty = h("p.empty", {}, "No arm tells its position. It is shown while its driver is alive, and at 25 Hz while a net reads or commands it.");
  const clear = h("button.quiet", { onclick: () => { trails.clear(); schedule(); } }, "Clear trails");
  const reset = h("button.quiet", { onclick: () => { Object.assign(camera, new Camera()); fitted = false; schedule(); } }, "Reset view");
  view.append(h("div.arms", {}, h("div.stage", {}, canvas, h("div.bar.over", {}, reset, clear)), h("div", {}, empty, side)));
  const trails = new Map();
  let frame = null, fitted = false;

  function take({ arms }) {
    for (const arm of arms) {
      const trail = trails.get(arm.device) ?? [];
      const last = trail.at(-1), next = arm.flange.position;
      if (!last || Math.hypot(...next.map((value, index) => value - last[index])) > 0.002) trail.push(next);
      if (trail.length > TRAIL_MAX) trail.shift();
      trails.set(arm.device, trail);
    }
    schedule();
  }

  function schedule() {
    frame ??= requestAnimationFrame(show);
  }

  function show() {
    frame = null;
    const known = state.cell?.arms ?? [];
    const arms = known.map((about, index) => ({ about, now: state.arms.get(about.device), hue: HUES[index % HUES.length] })).filter((arm) => arm.now);
    empty.hidden = arms.length > 0;
    if (!fitted && arms.length > 1) {
      const middle = [0, 1, 2].map((axis) => arms.reduce((sum, arm) => sum + arm.now.origins[arm.now.origins.length >> 1][axis], 0) / arms.length);
      camera.target = middle;
      camera.distance = 3.4;
      fitted = true;
    }
    draw(canvas, camera, arms.map((arm) => ({ ...arm.now, hue: arm.hue, trail: trails.get(arm.about.device), dim: performance.now() - arm.now.at > OLD_MS })));
    reconcile(side, arms, (arm) => arm.about.device, makeArm, updateArm);
  }

  attachOrbit(canvas, camera, schedule);
  const observer = new ResizeObserver(schedule);
  observer.observe(canvas);
  watch("arms", { arms: true });
  const timer = setInterval(schedule, 1000);
  const off = [on("arms", take), on("cell", schedule)];
  schedule();
  return () => {
    watch("arms", null);
    clearInterval(timer);
    observer.disconnect();
    cancelAnimationFrame(frame);
    off.forEach((stop) => stop());
  };
}

// `+ 0` avoids "-0.00".
const degrees = (angle) => (Math.round(angle * 18000 / Math.PI) / 100 + 0).toFixed(2);

function makeArm(arm) {
  const rows = arm.about.joints.map((name) => h("tr", {}, h("td", {}, name), h("td.number"), h("td.range", {}, h("i"))));
  const swatch = h("i.swatch");
  swatch.style.background = `hsl(${arm.hue} 52% 50%)`;
  return h("article.card", {}, h("header", {}, swatch, h("strong", {}, arm.about.device), h("span.dim", {}, arm.about.robot)),
    h("div.meta"), h("table.compact.joints", {}, h("tbody", {}, rows)), h("div.facts.mono"));
}

function updateArm(card, arm) {
  const old = performance.now() - arm.now.at > OLD_MS;
  setText(card.querySelector(".meta"), old ? `old: ${arm.now.source}` : arm.now.source);
  card.classList.toggle("trouble", old);
  [...card.querySelectorAll("tbody tr")].forEach((row, index) => {
    const [low, high] = arm.about.ranges[index], joint = arm.now.joints[index];
    setText(row.children[1], arm.about.linear ? `${joint.toFixed(4)} m` : `${degrees(joint)}°`);
    const share = (joint - low) / (high - low);
    const mark = row.querySelector("i");
    mark.style.left = `calc(8px + ${Math.max(0, Math.min(1, share))} * (100% - 16px))`;
    mark.className = share < 0.05 || share > 0.95 ? "near" : "";
    const bound = (value) => arm.about.linear ? `${value.toFixed(3)} m` : `${(value * 180 / Math.PI).toFixed(0)}°`;
    row.title = `${bound(low)} to ${bound(high)}`;
  });
  const [x, y, z] = arm.now.flange.position;
  setText(card.querySelector(".facts"), `flange  x ${x.toFixed(4)}  y ${y.toFixed(4)}  z ${z.toFixed(4)} m`);
}
