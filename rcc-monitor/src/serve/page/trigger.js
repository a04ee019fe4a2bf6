// The trigger of the scope. Pure.

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
