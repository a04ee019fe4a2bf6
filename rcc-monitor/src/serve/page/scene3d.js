// Arms as capsules on a canvas: orbit by mouse, touch or keys, no library and no graphics card needed.

import { colour } from "./dom.js";

/** Orbit camera: looks at `target` from `distance` m. */
export class Camera {
  constructor() {
    this.yaw = -0.9;
    this.pitch = 0.42;
    this.distance = 2.6;
    this.target = [0.2, 0, 0.45];
  }

  /** Projects a point: x and y in pixels, depth in m, and pixels per metre there; null behind the camera. */
  project([x, y, z], width, height) {
    const [dx, dy, dz] = [x - this.target[0], y - this.target[1], z - this.target[2]];
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const forward = dx * cy * cp + dy * sy * cp - dz * sp;
    const right = -dx * sy + dy * cy;
    const up = dx * cy * sp + dy * sy * sp + dz * cp;
    const depth = this.distance + forward;
    if (depth < 0.05) return null;
    const scale = Math.min(width, height) * 1.15 / depth;
    return { x: width / 2 - right * scale, y: height / 2 - up * scale, depth, scale };
  }
}

export function attachOrbit(canvas, camera, changed) {
  const pointers = new Map();
  let pinch = null;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (pointers.size === 2) {
      const [a, b] = [...pointers.values()];
      const length = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (pinch) camera.distance = limit(camera.distance * (pinch / length));
      pinch = length;
    } else if (event.shiftKey || event.buttons === 2) pan(camera, dx, dy, canvas);
    else {
      camera.yaw += dx * 0.008;
      camera.pitch = Math.max(-1.5, Math.min(1.5, camera.pitch + dy * 0.008));
    }
    changed();
  });
  const release = (event) => {
    pointers.delete(event.pointerId);
    pinch = null;
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.distance = limit(camera.distance * Math.exp(event.deltaY * 0.001));
    changed();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    if (turn) {
      camera.yaw += turn[0];
      camera.pitch = Math.max(-1.5, Math.min(1.5, camera.pitch + turn[1]));
    } else if (event.key === "+") camera.distance = limit(camera.distance * 0.88);
    else if (event.key === "-") camera.distance = limit(camera.distance * 1.14);
    else if (event.key === "0") Object.assign(camera, new Camera());
    else return;
    event.preventDefault();
    changed();
  });
}

const limit = (distance) => Math.max(0.4, Math.min(15, distance));

function pan(camera, dx, dy, canvas) {
  const step = camera.distance / Math.min(canvas.clientWidth, canvas.clientHeight);
  const [cy, sy] = [Math.cos(camera.yaw), Math.sin(camera.yaw)];
  camera.target = [camera.target[0] - dx * sy * step, camera.target[1] + dx * cy * step, camera.target[2] + dy * step];
}

const add = (a, b, by) => a.map((value, index) => value + b[index] * by);

/** Draws floor, arms, flange frames and trails. `arms` are `{origins, flange, hue, trail, dim}`; `origins` are the ends of the links. */
export function draw(canvas, camera, arms) {
  const ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.lineCap = "round";
  const at = (point) => camera.project(point, width, height);
  const line = (a, b, style, wide) => {
    const [p, q] = [at(a), at(b)];
    if (!p || !q) return;
    pen.strokeStyle = style;
    pen.lineWidth = wide;
    pen.beginPath();
    pen.moveTo(p.x, p.y);
    pen.lineTo(q.x, q.y);
    pen.stroke();
  };
  const [grid, strong] = [colour("--grid"), colour("--border")];
  for (let step = -6; step <= 6; step++) {
    const value = step * 0.25;
    line([value, -1.5, 0], [value, 1.5, 0], step % 2 ? grid : strong, 1);
    line([-1.5, value, 0], [1.5, value, 0], step % 2 ? grid : strong, 1);
  }
  line([0, 0, 0], [0.3, 0, 0], colour("--axis-x"), 2);
  line([0, 0, 0], [0, 0.3, 0], colour("--axis-y"), 2);
  for (const arm of arms) shadow(pen, at, arm);
  for (const arm of arms) trail(pen, at, arm);
  const parts = arms.flatMap((arm) => capsules(arm)).map((part) => ({ ...part, p: at(part.a), q: at(part.b) })).filter((part) => part.p && part.q);
  parts.sort((one, other) => Math.max(other.p.depth, other.q.depth) - Math.max(one.p.depth, one.q.depth));
  for (const part of parts) capsule(pen, part);
  for (const arm of arms) frame(line, arm);
}

/** Radius of the first link, and of the last; those between become smaller evenly. */
const RADII = [0.085, 0.045];

/** The links of an arm from the base to the flange, without those that have no length. */
function linksOf(arm) {
  const pairs = arm.origins.slice(1).map((b, index) => ({ a: arm.origins[index], b }));
  const links = pairs.filter(({ a, b }) => Math.hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]) > 1e-4);
  const last = Math.max(links.length - 1, 1);
  return links.map((link, index) => ({ ...link, radius: RADII[0] + (RADII[1] - RADII[0]) * index / last, arm, index }));
}

function capsules(arm) {
  const links = linksOf(arm);
  const joints = links.slice(0, -1).map(({ b, radius }) => ({ a: b, b, radius: radius * 1.16, arm, joint: true }));
  return [...links, ...joints];
}

function capsule(pen, { p, q, radius, arm, joint }) {
  const wide = Math.max(2, 2 * radius * (p.scale + q.scale) / 2);
  const bright = joint ? 46 : 62;
  const [hue, saturation] = [arm.hue, arm.dim ? 6 : joint ? 52 : 22];
  const angle = Math.atan2(q.y - p.y, q.x - p.x);
  const normal = joint ? [-0.6, -0.8] : [Math.sin(angle), -Math.cos(angle)];
  const side = normal[1] > 0 || (normal[1] === 0 && normal[0] > 0) ? -1 : 1;
  const middle = [(p.x + q.x) / 2, (p.y + q.y) / 2];
  const gradient = pen.createLinearGradient(middle[0] + normal[0] * side * wide / 2, middle[1] + normal[1] * side * wide / 2, middle[0] - normal[0] * side * wide / 2, middle[1] - normal[1] * side * wide / 2);
  gradient.addColorStop(0, `hsl(${hue} ${saturation}% ${bright + 22}%)`);
  gradient.addColorStop(0.45, `hsl(${hue} ${saturation}% ${bright}%)`);
  gradient.addColorStop(1, `hsl(${hue} ${saturation}% ${bright - 26}%)`);
  if (joint) {
    pen.fillStyle = gradient;
    pen.beginPath();
    pen.arc(p.x, p.y, wide / 2, 0, 7);
    pen.fill();
    return;
  }
  pen.strokeStyle = `hsl(${hue} ${saturation}% ${bright - 34}%)`;
  pen.lineWidth = wide + 1.5;
  pen.beginPath();
  pen.moveTo(p.x, p.y);
  pen.lineTo(q.x + 0.01, q.y);
  pen.stroke();
  pen.strokeStyle = gradient;
  pen.lineWidth = wide;
  pen.stroke();
}

function shadow(pen, at, arm) {
  pen.strokeStyle = colour("--shadow");
  const flat = ([x, y]) => [x, y, 0];
  for (const { a, b, radius } of linksOf(arm)) {
    const [p, q] = [at(flat(a)), at(flat(b))];
    if (!p || !q) continue;
    pen.lineWidth = radius * (p.scale + q.scale);
    pen.beginPath();
    pen.moveTo(p.x, p.y);
    pen.lineTo(q.x + 0.01, q.y);
    pen.stroke();
  }
}

function trail(pen, at, arm) {
  if (!arm.trail?.length) return;
  pen.strokeStyle = `hsl(${arm.hue} 85% 55%)`;
  pen.lineWidth = 2;
  pen.beginPath();
  let begun = false;
  for (const point of arm.trail) {
    const p = at(point);
    if (!p) continue;
    if (begun) pen.lineTo(p.x, p.y);
    else pen.moveTo(p.x, p.y);
    begun = true;
  }
  pen.stroke();
}

function frame(line, arm) {
  const { position, rotation } = arm.flange;
  ["--axis-x", "--axis-y", "--axis-z"].forEach((name, axis) => {
    line(position, add(position, [rotation[0][axis], rotation[1][axis], rotation[2][axis]], 0.13), colour(name), 2.5);
  });
}
