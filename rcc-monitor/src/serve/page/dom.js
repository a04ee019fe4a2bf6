// Elements without a framework. Text is always set as text, never as markup: names come from nets and devices.

/** Makes an element: `h("td.number", {title: "…"}, "text", child)`. */
export function h(what, attributes = {}, ...children) {
  const [tag, ...classes] = what.split(".");
  const element = document.createElement(tag);
  if (classes.length) element.className = classes.join(" ");
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && typeof value === "boolean") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.flat(2).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Sets the text of an element only if it differs, so that nothing is laid out anew. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Keeps the children of `parent` in step with `rows`: by key, in order, without making them anew. */
export function reconcile(parent, rows, key, make, update) {
  const known = parent.reconciled ??= new Map();
  const seen = new Set();
  let before = parent.firstElementChild;
  for (const row of rows) {
    const id = key(row);
    seen.add(id);
    let element = known.get(id);
    if (!element) {
      element = make(row);
      known.set(id, element);
    }
    update(element, row);
    if (element === before) before = before.nextElementSibling;
    else parent.insertBefore(element, before);
  }
  for (const [id, element] of known) {
    if (!seen.has(id)) {
      element.remove();
      known.delete(id);
    }
  }
}

/** Draws a line of bars or points from 0 to `high` on a small canvas. */
export function sparkline(canvas, values, high, colour) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width) return;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.fillStyle = colour;
  const step = width / Math.max(values.length, 60);
  values.forEach((value, index) => {
    if (value === null || value === undefined) return;
    const tall = Math.max(1, Math.min(1, value / high) * height);
    pen.fillRect(width - (values.length - index) * step, height - tall, Math.max(1, step - 1), tall);
  });
}

/** Returns a colour of the style sheet. */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** Shows a message for some seconds; errors stay until they are closed. */
export function note(text, kind = "info", help = "") {
  const notes = document.getElementById("notes");
  const shown = h(`div.note.${kind}`, {}, h("div", {}, text, help ? h("small", {}, help) : null),
    h("button.quiet", { "aria-label": "Close", onclick: () => shown.remove() }, "×"));
  notes.append(shown);
  while (notes.children.length > 6) notes.firstElementChild.remove();
  if (kind !== "error") setTimeout(() => shown.remove(), 6000);
}

/** Asks a question in a dialog; resolves to true if it is confirmed. The safe answer has the focus. */
export function confirm(title, lines, action, kind = "primary") {
  const dialog = document.getElementById("dialog");
  return new Promise((resolve) => {
    const close = (answer) => {
      dialog.onclose = null;
      dialog.close();
      resolve(answer);
    };
    dialog.replaceChildren(
      h("h2", { id: "dialog-title" }, title),
      ...lines.map((line) => h("p", {}, line)),
      h("div.actions", {},
        h("button", { autofocus: true, onclick: () => close(false) }, "Back"),
        h(`button.${kind}`, { id: "confirm", onclick: () => close(true) }, action)),
    );
    dialog.onclose = () => resolve(false);
    dialog.showModal();
  });
}
