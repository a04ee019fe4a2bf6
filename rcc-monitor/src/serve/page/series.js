// Values of ports over time, kept for as long as views look back. Flat arrays of numbers; null is NaN and leaves a gap.

const SAMPLES_MAX = 120_000;

/** Element names of composed types, in the order of the values. */
const PARTS = {
  Vector3: ["x", "y", "z"],
  Pose: ["x", "y", "z", "qx", "qy", "qz", "qw"],
  Rotation: ["qx", "qy", "qz", "qw"],
  Twist: ["vx", "vy", "vz", "wx", "wy", "wz"],
  Wrench: ["fx", "fy", "fz", "tx", "ty", "tz"],
};

export function elementName(type, index, width) {
  if (width === 1) return "";
  const parts = PARTS[type];
  return parts && parts.length === width ? `.${parts[index]}` : `[${index}]`;
}

const toNumber = (value) => {
  if (value === null || value === undefined) return NaN;
  if (value === "inf" || value === "-inf") return NaN;
  return Number(value);
};

/** A ring of samples of one port. */
export class Series {
  constructor(about) {
    this.about = about;
    this.width = 0;
    this.length = 0;
    this.times = new Float64Array(1024);
    this.columns = [];
    this.last = null;
  }

  grow() {
    if (this.length < this.times.length) return;
    if (this.length >= SAMPLES_MAX) {
      // Drops the older half at once, so that appending stays cheap.
      const from = this.length - SAMPLES_MAX / 2;
      const cut = (array) => array.copyWithin(0, from, this.length);
      cut(this.times);
      this.columns.forEach(cut);
      this.length -= from;
      return;
    }
    const wider = (array) => {
      const next = new Float64Array(Math.min(SAMPLES_MAX, array.length * 2));
      next.set(array);
      return next;
    };
    this.times = wider(this.times);
    this.columns = this.columns.map(wider);
  }

  push(time, value) {
    if (this.length && time <= this.times[this.length - 1]) return;
    const elements = Array.isArray(value) ? value : [value];
    while (this.width < elements.length) {
      this.columns.push(new Float64Array(this.times.length).fill(NaN));
      this.width += 1;
    }
    this.grow();
    this.times[this.length] = time;
    for (let index = 0; index < this.width; index++) this.columns[index][this.length] = toNumber(elements[index]);
    this.length += 1;
    this.last = value;
  }

  /** Index of the first sample at or after `time`. */
  from(time) {
    let low = 0, high = this.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.times[middle] < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  get newest() {
    return this.length ? this.times[this.length - 1] : null;
  }
}

/** All series that the page watches, by `net#id/primitive.port`. */
export class SeriesStore {
  constructor() {
    this.all = new Map();
  }

  add(message, periodS) {
    for (const about of message.series) {
      const known = this.all.get(about.key);
      if (known) known.about = about;
      else this.all.set(about.key, new Series(about));
    }
    for (const { key, c, v } of message.data) {
      const series = this.all.get(key);
      if (!series) continue;
      if (series.length && series.gapPending) {
        series.push(c[0] * periodS - 1e-9, Array(series.width).fill(null));
        series.gapPending = false;
      }
      for (let index = 0; index < c.length; index++) series.push(c[index] * periodS, v[index]);
    }
  }

  /** Marks a gap in every curve, or in those of one source: values were missed. */
  gap(source) {
    for (const series of this.all.values()) {
      if (!source || series.about.source === source) series.gapPending = true;
    }
  }

  /** Forgets series that no pattern means any more, and so frees their memory. */
  keepOnly(patterns) {
    const tests = patterns.map(tester);
    for (const [key, series] of this.all) {
      if (!tests.some((test) => test(series.about))) this.all.delete(key);
    }
  }

  /** Returns the series that a pattern means, the newest command of a net last. */
  matching(pattern) {
    const test = tester(pattern);
    return [...this.all.values()].filter((one) => test(one.about)).sort((a, b) => a.about.id - b.about.id);
  }
}

/** Returns a test whether a pattern with `*` and `?` means a port. */
function tester(pattern) {
  const escaped = pattern.replace(/[.+^${}()|[\]\\]/g, "\\$&").replace(/\*/g, ".*").replace(/\?/g, ".");
  const expression = new RegExp(`^${escaped}$`);
  return (about) => expression.test(`${about.net}/${about.port}`) || expression.test(about.key);
}
