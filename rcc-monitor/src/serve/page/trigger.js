// The trigger of the scope. Pure.

/**
 * Returns the trigger as a condition of a rule, for the executor: its text, and whether it waits for an edge; null if no
 * condition says the same.
 */
export function condition({ net, port, type, width }, index, edge, level) {
  const name = `${net}.${port}${width > 1 ? `[${index}]` : ""}`;
  const isBool = type?.startsWith("Bool");
  const when = {
    rising: isBool ? name : `${name} > ${level}`, above: isBool ? name : `${name} > ${level}`,
    falling: isBool ? `not ${name}` : `${name} < ${level}`, below: isBool ? `not ${name}` : `${name} < ${level}`,
  }[edge];
  // A condition names one truth value, not an element of several.
  return when === undefined || (isBool && width > 1) ? null : { when, edge: edge === "rising" || edge === "falling" };
}

/** Returns the time at which a condition is first met after `from`, or null, and whether it was true at the last sample. */
export function crossing({ times, column, length }, from, edge, level, before) {
  let last = before;
  for (let index = 0; index < length; index++) {
    if (times[index] <= from) continue;
    const value = column[index];
    const isNull = Number.isNaN(value);
    if (edge === "null") {
      if (isNull && last === false) return { at: times[index], last: true };
      last = isNull;
      continue;
    }
    // Null is neither above nor below; an edge begins anew after it.
    if (isNull) {
      last = null;
      continue;
    }
    const above = value > level;
    const met = {
      rising: last === false && above,
      falling: last === true && !above,
      either: last !== null && last !== above,
      above,
      below: value < level,
    }[edge];
    if (met) return { at: times[index], last: above };
    last = above;
  }
  return { at: null, last };
}
