// Shows the values under the pointer; a drag zooms all panels over time, a double click shows everything again.
"use strict";
const picture = document.querySelector("body > svg");
const tip = document.getElementById("tip");
const xmlns = "http://www.w3.org/2000/svg";
const numbers = (text) => text.split(" ").map(Number);
const views = [...document.querySelectorAll("svg.view")].map((view) => {
  const [x, y, width, height] = ["x", "y", "width", "height"].map((name) => Number(view.getAttribute(name)));
  const curves = [...view.querySelectorAll("path[data-name]")].map((path) => ({
    name: path.dataset.name,
    points: path.getAttribute("d").split("M").slice(1).map((part) => part.split("L").map((pair) => pair.split(",").map(Number))),
  }));
  return { view, x, y, width, height, curves, range: numbers(view.dataset.range), time: view.classList.contains("time") };
});
const timed = views.filter((view) => view.time);
// The visible part of all panels over time, as shares of their whole range.
let shown = [0, 1];
let pressed = null;
const made = (name, id) => {
  const element = document.createElementNS(xmlns, name);
  element.id = id;
  element.setAttribute("class", "mark");
  element.style.display = "none";
  element.style.pointerEvents = "none";
  picture.append(element);
  return element;
};
const cursor = made("path", "cursor");
const span = made("rect", "span");

function at(event) {
  const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(picture.getScreenCTM().inverse());
  const view = views.find((one) => point.x >= one.x && point.x <= one.x + one.width && point.y >= one.y && point.y <= one.y + one.height);
  return { x: point.x, y: point.y, view };
}

// Position in the whole picture of a panel, 0 to 1, of an x of the page.
const share = (view, x) => shown[0] + ((x - view.x) / view.width) * (shown[1] - shown[0]);
const value = (view, part) => view.range[0] + part * (view.range[1] - view.range[0]);
const written = (number) => String(Number(number.toPrecision(6)));

function height(points, x) {
  for (const segment of points) {
    for (let i = 1; i < segment.length; i++) {
      const [[a, from], [b, to]] = [segment[i - 1], segment[i]];
      if (a <= x && x <= b) return b > a ? from + ((to - from) * (x - a)) / (b - a) : to;
    }
  }
  return null;
}

function hover(event) {
  const { x, y, view } = at(event);
  cursor.style.display = tip.style.display = "none";
  if (!view) return;
  const lines = [];
  const [, , bottom, top] = view.range;
  const up = (pixels) => top - (pixels / view.height) * (top - bottom);
  if (view.time) {
    const part = share(view, x);
    lines.push(`t = ${written(value(view, part))} s`);
    for (const curve of view.curves) {
      const pixels = height(curve.points, part * view.width);
      lines.push(`${curve.name}: ${pixels === null ? "null" : written(up(pixels))}`);
    }
    const first = timed[0], last = timed[timed.length - 1];
    cursor.setAttribute("d", `M${x},${first.y}V${last.y + last.height}`);
    cursor.style.display = "";
  } else {
    lines.push(`${written(value(view, (x - view.x) / view.width))}, ${written(up(y - view.y))}`);
  }
  tip.textContent = lines.join("\n");
  tip.style.display = "block";
  tip.style.left = `${Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 4)}px`;
  tip.style.top = `${Math.min(event.clientY + 14, innerHeight - tip.offsetHeight - 4)}px`;
}

const ticks = [...picture.querySelectorAll("text.tick")].map((text) => ({ text, x: Number(text.getAttribute("x")), y: Number(text.getAttribute("y")), whole: text.textContent }));
function show(from, to) {
  shown = [from, to];
  const whole = from === 0 && to === 1;
  for (const view of timed) {
    view.view.setAttribute("viewBox", `${from * view.width} 0 ${(to - from) * view.width} ${view.height}`);
    for (const tick of ticks) {
      const own = tick.y > view.y + view.height && tick.y < view.y + view.height + 30 && tick.x >= view.x - 1 && tick.x <= view.x + view.width + 1;
      if (own) tick.text.textContent = whole ? tick.whole : written(value(view, share(view, tick.x)));
    }
  }
}

picture.addEventListener("pointermove", (event) => {
  hover(event);
  if (pressed === null) return;
  const { x } = at(event), { view } = pressed;
  const [from, to] = [Math.min(x, pressed.x), Math.max(x, pressed.x)];
  const box = { x: Math.max(from, view.x), y: view.y, width: Math.max(0, Math.min(to, view.x + view.width) - Math.max(from, view.x)), height: view.height };
  for (const [name, length] of Object.entries(box)) span.setAttribute(name, length);
  span.style.display = "";
});
picture.addEventListener("pointerleave", () => { cursor.style.display = tip.style.display = "none"; });
picture.addEventListener("pointerdown", (event) => {
  const { x, view } = at(event);
  pressed = view && view.time ? { x, view } : null;
});
addEventListener("pointerup", (event) => {
  span.style.display = "none";
  if (pressed === null) return;
  const { view } = pressed;
  const inside = (x) => Math.min(Math.max(x, view.x), view.x + view.width);
  const ends = [inside(at(event).x), pressed.x].sort((a, b) => a - b);
  pressed = null;
  if (ends[1] - ends[0] > 5) show(share(view, ends[0]), share(view, ends[1]));
});
picture.addEventListener("dblclick", () => show(0, 1));
