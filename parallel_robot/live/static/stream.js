'use strict';
// What the server sends: texts, and frames as frames.py of the server describes them.

const WINDOW = 12; // s of motion that are shown
const HEAD = 24; // bytes of a frame before its numbers

class History {
  constructor() {
    this.layout = undefined;
    this.changes = []; // of law and gains of a bag, each time [s] and text
    this.clear();
  }

  clear() {
    this.time = [];
    this.values = (this.layout?.curves ?? []).map(() => []);
    this.path = []; // { t, places }, those of the reference and of the end effector
    this.posture = undefined;
    this.now = undefined;
    this.fresh = true;
  }

  // The place of the numbers, and their meaning; those of another motion are forgotten.
  take(layout) {
    this.layout = layout;
    this.clear();
  }

  add(buffer) {
    const view = new DataView(buffer);
    for (let at = 0; at < buffer.byteLength; ) {
      const length = view.getUint32(at, true);
      if (this.layout && view.getUint32(at + 4, true) === this.layout.number)
        this.frame(view, buffer.slice(at, at + length), at);
      at += length;
    }
    this.forget();
  }

  frame(view, bytes, at) {
    const now = view.getFloat64(at + 8, true);
    const seconds = view.getFloat32(at + 16, true);
    const count = view.getUint32(at + 20, true);
    const numbers = new Float32Array(bytes, HEAD);
    const curves = numbers.length - 2 * this.layout.curves.length;
    const size = 2 * this.layout.place;
    const path = curves - size * count;
    this.now = now;
    this.posture = numbers.subarray(0, path);
    for (let k = 0; k < count; k += 1) {
      const places = numbers.subarray(path + size * k, path + size * (k + 1));
      if (places.every(Number.isFinite))
        this.path.push({ t: now - (seconds * (count - 1 - k)) / count, places });
    }
    this.time.push(now - 0.75 * seconds, now - 0.25 * seconds);
    this.values.forEach((values, k) =>
      values.push(...[0, 1].map((i) => finite(numbers[curves + 2 * k + i]))));
  }

  forget() {
    const from = this.time.findIndex((t) => t > this.now - WINDOW);
    if (from > 200) for (const row of [this.time, ...this.values]) row.splice(0, from);
    const first = this.path.findIndex((place) => place.t > this.now - WINDOW);
    if (first > 50) this.path.splice(0, first);
  }

  // Begin and end of the time axis: the last seconds, or as many as there are.
  shown() {
    const now = this.now ?? WINDOW;
    const from = Math.max(this.time[0] ?? 0, now - WINDOW);
    return [from, Math.max(now, from + 1)];
  }

  // Values of the curves of a diagram, each with its name.
  curves(group) {
    return this.layout.curves
      .map((curve, k) => ({ ...curve, values: this.values[k] }))
      .filter((curve) => curve.group === group);
  }

  // The largest magnitude of a diagram in the last seconds.
  largest(group, seconds) {
    const first = this.time.findIndex((t) => t > this.now - seconds);
    const all = this.curves(group).flatMap((curve) => curve.values.slice(first));
    return Math.max(...all.filter((value) => value !== null).map(Math.abs));
  }

  rms(seconds) {
    const recent = this.path.filter((place) => place.t > this.now - seconds);
    const size = this.layout.place;
    const square = ({ places }) => {
      let sum = 0;
      for (let i = 0; i < size; i += 1) sum += (places[size + i] - places[i]) ** 2;
      return sum;
    };
    const squares = recent.map(square);
    return Math.sqrt(squares.reduce((sum, value) => sum + value, 0) / squares.length);
  }
}

const finite = (value) => (Number.isFinite(value) ? value : null);

// Calls `take(texts)` and `frames(buffer)` for ever; `connected(bool)` when that changes.
function listen({ take, frames, connected }) {
  let pause = 500; // ms
  const open = () => {
    const socket = new WebSocket(`ws://${location.host}/frames`);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => { pause = 500; connected(true); };
    socket.onmessage = ({ data }) => (typeof data === 'string' ? take(JSON.parse(data)) : frames(data));
    socket.onclose = () => {
      connected(false);
      setTimeout(open, pause);
      pause = Math.min(2 * pause, 4000);
    };
  };
  open();
}

// A number with its unit and the prefix that fits: 2.98 µm.
const PREFIXES = [[1, ''], [1e-3, 'm'], [1e-6, 'µ'], [1e-9, 'n']];
const prefixOf = (size) => PREFIXES.find(([one]) => size >= one) ?? PREFIXES[3];
function prefixed(value, digits = 3) {
  const [factor, prefix] = prefixOf(Math.abs(value));
  return [(value / factor).toPrecision(digits), prefix];
}
