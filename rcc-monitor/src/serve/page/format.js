// Numbers for people. Null is `–`, never zero.

const NARROW = "\u202f";

export function grouped(number) {
  if (number === null || number === undefined) return "–";
  return String(Math.round(number)).replace(/\B(?=(\d{3})+(?!\d))/g, NARROW);
}

/** Formats nanoseconds: `812 ns`, `43.1 µs`, `1.9 ms`. */
export function time(ns) {
  if (ns === null || ns === undefined) return "–";
  for (const [unit, scale] of [["s", 1e9], ["ms", 1e6], ["µs", 1e3]]) {
    if (ns >= scale) return `${significant(ns / scale)} ${unit}`;
  }
  return `${Math.round(ns)} ns`;
}

export function significant(value, digits = 3) {
  return Number(value.toPrecision(digits)).toString();
}

export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  if (seconds < 60) return `${seconds < 10 ? seconds.toFixed(1) : Math.round(seconds)} s`;
  const minutes = Math.floor(seconds / 60);
  if (minutes < 60) return `${minutes} min ${Math.floor(seconds % 60)} s`;
  const hours = Math.floor(minutes / 60);
  return hours < 48 ? `${hours} h ${minutes % 60} min` : `${Math.floor(hours / 24)} d ${hours % 24} h`;
}

/** Formats an element of a port. */
export function element(value) {
  if (value === null || value === undefined) return "–";
  if (typeof value === "number") {
    if (Number.isInteger(value) && Math.abs(value) < 1e9) return String(value);
    const size = Math.abs(value);
    return size !== 0 && (size < 1e-3 || size >= 1e6) ? value.toExponential(3) : value.toFixed(4);
  }
  return String(value);
}

/** Formats a value of a port: at most `most` elements. */
export function value(all, unit, most = 8) {
  const text = Array.isArray(all)
    ? `[${all.slice(0, most).map(element).join(", ")}${all.length > most ? ", …" : ""}]`
    : element(all);
  return unit && unit !== "1" && all !== null ? `${text} ${unit}` : text;
}

export function clock(text) {
  return (text ?? "").slice(11, 23);
}

export function percent(permille) {
  return permille === null || permille === undefined ? "–" : `${(permille / 10).toFixed(permille < 1000 ? 1 : 0)} %`;
}

/** State and outcome of a net in words. */
export function outcome(net) {
  if (net.state !== "terminated") return net.state;
  return net.words ?? net.reason ?? net.state;
}

/** Kind of a net's state, for its colour. */
export function stateKind(net) {
  switch (net.state) {
    case "running": return "run";
    case "canceling": return "warn";
    case "rejected": return "bad";
    case "terminated": return net.reason === "fault" || net.reason === "aborted" ? "bad" : net.reason === "finished" ? "good" : "calm";
    default: return "calm";
  }
}

export const isActive = (net) => net.state === "running" || net.state === "canceling";
