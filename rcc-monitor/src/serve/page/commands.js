// Operations on nets. CANCEL needs no confirmation; START and ABORT do.

import { confirm, note } from "./dom.js";
import { isActive } from "./format.js";
import { state } from "./stream.js";

export async function post(path, body) {
  try {
    const response = await fetch(path, {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: body === undefined ? undefined : JSON.stringify(body),
    });
    const answer = await response.json().catch(() => ({ message: `status ${response.status}` }));
    return response.ok ? { answer } : { error: answer };
  } catch (error) {
    return { error: { message: `the dashboard's server does not answer (${error.message})`, help: "rcc-cli cancel NET" } };
  }
}

export async function getJson(path) {
  try {
    const response = await fetch(path);
    const answer = await response.json();
    return response.ok ? { answer } : { error: answer };
  } catch (error) {
    return { error: { message: `the dashboard's server does not answer (${error.message})` } };
  }
}

const failed = (error) => note(error.message ?? "failed", "error", error.help ?? "");

export async function cancelAll() {
  const { answer, error } = await post("/api/cancel");
  if (error) return failed(error);
  if (!answer.length) return note("No net is active.");
  for (const one of answer) {
    if (one.error) note(`${one.net}#${one.id}: ${one.error.message}`, "error", "ABORT it in its view");
    else note(`${one.net}#${one.id}: CANCEL requested`, "good");
  }
}

export async function cancel(net) {
  const { error } = await post(`/api/nets/${net.id}/cancel`);
  if (error) failed(error);
  else note(`${net.net}#${net.id}: CANCEL requested`, "good");
}

export async function abort(net) {
  const lines = ["The net ends at once; the drivers bring its devices to rest. CANCEL ends it in its own way."];
  if (!await confirm(`Abort ${net.net}#${net.id}?`, lines, "ABORT", "danger")) return;
  const { error } = await post(`/api/nets/${net.id}/abort`);
  if (error) failed(error);
}

export async function start(net) {
  const title = `${net.net}#${net.id}`;
  const uses = net.uses?.length ? `It commands ${net.uses.join(", ")}.` : "It commands no device.";
  const lines = [uses];
  if (net.rehearsed) lines.push(`Rehearsal: ${net.rehearsed}`);
  if (net.uses?.length) lines.push("Make sure that nobody is within reach, and that the emergency stop is at hand.");
  if (!await confirm(`Start ${title}?`, lines, "START")) return;
  const { error } = await post(`/api/nets/${net.id}/start`, { confirm: title });
  if (error) failed(error);
}

export async function recordIncident() {
  const { answer, error } = await post("/api/incidents");
  if (error) failed(error);
  else note(`Recorded ${answer.file?.split("/").pop()}`, "good");
  return answer;
}

/** Arms a condition at the executor, which judges it in every cycle and writes one incident. */
export async function armTrigger(when, edge) {
  const { answer, error } = await post("/api/triggers", { when, edge });
  if (error) failed(error);
  else note(`Armed: ${when}`, "good", "The executor judges it in every cycle, also when this page is closed.");
  return answer;
}

export async function disarmTrigger(rule) {
  const { error } = await post(`/api/triggers/${rule}/disarm`);
  if (error) failed(error);
}

export async function armedTriggers() {
  const { answer } = await getJson("/api/triggers");
  return answer?.filter((one) => one.state === "armed" || one.state === "due") ?? [];
}

export const activeNets = () => [...state.nets.values()].filter(isActive);
