'use strict';
// Diagrams that roll by, drawn by uPlot.

const root = document.documentElement;
const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();
const DIAGRAMS = [
  { group: 'error', title: 'End-effector error', unit: 'm', log: true },
  { group: 'joints', title: 'Joint errors' }, // the unit is that of the robot
  { group: 'torque', ghost: 'ghost' }, // torques or forces
];
const HEIGHTS = { error: 82, joints: 78, torque: 98 }; // px; the last one has the axis of time
const DECADES = 8; // most of a logarithmic axis

class Diagram {
  constructor(parent, { group, title, unit, log, ghost }, history) {
    Object.assign(this, { group, unit, log, ghost, history });
    this.figure = parent.appendChild(document.createElement('figure'));
    this.figure.className = 'curve';
    const caption = this.figure.appendChild(document.createElement('figcaption'));
    this.title = caption.appendChild(document.createElement('span'));
    const name = this.title.appendChild(document.createElement('b'));
    name.textContent = title;
    if (group !== 'torque') {
      const seen = this.title.appendChild(document.createElement('span'));
      seen.className = 'seenword';
      seen.textContent = ', seen';
    }
    this.unitShown = this.title.appendChild(document.createTextNode(''));
    this.legend = caption.appendChild(document.createElement('span'));
    this.legend.className = 'legend';
    this.factor = 1;
    this.build();
    new ResizeObserver(() => this.plot.setSize(this.size())).observe(parent);
  }

  size() {
    return { width: this.figure.clientWidth, height: HEIGHTS[this.group] };
  }

  build() {
    const main = this.history.curves(this.group);
    const ghosts = this.ghost ? this.history.curves(this.ghost) : [];
    const style = (k) => (this.group === 'error' ? 'run0' : `joint${k % 12}`);
    const axis = { stroke: () => colour('faint'), font: '11px system-ui', ticks: { show: false } };
    const grid = { stroke: () => colour('rule'), width: 1 };
    const series = [
      ...main.map((_, k) => ({ stroke: () => colour(style(k)), width: 1.25 })),
      ...ghosts.map((_, k) => ({ stroke: () => colour(style(k)), width: 1.25, dash: [5, 4], alpha: 0.75 })),
    ].map((one) => ({ ...one, points: { show: false }, spanGaps: false }));
    this.plot = new uPlot({
      ...this.size(),
      padding: [8, 8, 4, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: {
        x: { time: false, range: () => this.history.shown() },
        y: this.log ? { distr: 3, range: (_, low, high) => decades(low, high) } : { range: (_, low, high) => span(low, high) },
      },
      axes: [
        { ...axis, grid, size: this.group === 'torque' ? 20 : 4, gap: 2, space: 80, values: (_, all) => all.map((t) => (this.group === 'torque' ? `${t} s` : '')) },
        { ...axis, grid, size: 62, gap: 6, space: 18, values: ({ scales: { y } }, all) => this.labels(all, Math.max(Math.abs(y.min), Math.abs(y.max))), ...(this.log ? { splits: (_, __, low, high) => powers(low, high), filter: (_, all) => all } : {}) },
      ],
      series: [{}, ...series],
      hooks: { draw: [(plot) => this.mark(plot)] },
    }, this.data(), this.figure);
    this.legend.replaceChildren(
      ...(main.length > 1 ? main.map((curve, k) => this.key(curve.name, style(k))) : []),
      ...(ghosts.length ? [this.ghostKey = this.key('', 'faint', true)] : []),
    );
    this.name('');
  }

  // Dotted lines where law or gains changed.
  mark(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.strokeStyle = colour('faint');
    ctx.setLineDash([2, 3]);
    for (const [time] of this.history.changes) {
      const x = plot.valToPos(time, 'x', true);
      if (x < bbox.left || x > bbox.left + bbox.width) continue;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }

  key(text, style, dashed = false) {
    const key = document.createElement('span');
    const swatch = key.appendChild(document.createElement('i'));
    swatch.style.borderColor = `var(--${style})`;
    swatch.className = dashed ? 'dashed' : '';
    key.append(text);
    return key;
  }

  // The name of the ghost's law, in the legend.
  name(law) {
    if (!this.ghostKey) return;
    this.ghostKey.hidden = !law;
    this.ghostKey.lastChild.data = law ? `${law} would ask for` : '';
  }

  data() {
    const groups = this.ghost ? [this.group, this.ghost] : [this.group];
    return [this.history.time, ...groups.flatMap((group) => this.history.curves(group).map((c) => c.values))];
  }

  // Labels of an axis: of a logarithmic one each with its unit, of a linear one with that above.
  labels(all, largest) {
    if (this.log)
      return all.map((value) => {
        const [number, prefix] = prefixed(1.0000001 * value, 1);
        return `${Number(number)} ${prefix}${this.unit}`;
      });
    const [factor, prefix] = prefixOf(largest);
    this.unitShown.data = ` [${prefix}${this.unit}]`;
    return all.map((value) => `${Number((value / factor).toPrecision(4))}`.replace('-', '−'));
  }

  draw() {
    this.plot.setData(this.data());
  }

  remove() {
    this.plot.destroy();
    this.figure.remove();
  }
}

// Whole decades around positive values.
function decades(low, high) {
  if (!(high > 0)) return [1e-6, 1e-2];
  const top = Math.ceil(Math.log10(high));
  const bottom = low > 0 ? Math.floor(Math.log10(low)) : top - 4;
  return [10 ** Math.max(Math.min(bottom, top - 1), top - DECADES), 10 ** top];
}

// Powers of ten from one to another, at most five of them.
function powers(low, high) {
  const [first, last] = [low, high].map((value) => Math.round(Math.log10(value)));
  const step = Math.ceil((last - first) / 4);
  const all = [];
  for (let power = first; power <= last; power += step) all.push(10 ** power);
  return all;
}

function span(low, high) {
  if (low === null || !Number.isFinite(low + high)) return [-1, 1];
  const margin = 0.08 * Math.max(high - low, 1e-7);
  return [low - margin, high + margin];
}
