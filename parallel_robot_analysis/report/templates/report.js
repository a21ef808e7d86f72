'use strict';
const root = document.documentElement;
const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();
const unpack = (text) =>
  new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const data = (element) => JSON.parse(document.getElementById(`data${element.dataset.group}`).text);

// Plots

function template() {
  const axis = {
    gridcolor: colour('rule'), linecolor: colour('faint'), tickcolor: colour('faint'),
    zerolinecolor: colour('rule'), showline: true, ticks: 'outside', ticklen: 4,
    automargin: true, title: { standoff: 6 }, exponentformat: 'power',
  };
  return {
    layout: {
      font: { family: "system-ui, 'Segoe UI', Roboto, sans-serif", size: 12, color: colour('ink') },
      paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)',
      xaxis: axis, yaxis: axis,
      hoverlabel: { bgcolor: colour('paper'), bordercolor: colour('rule'), font: { color: colour('ink') } },
      modebar: { bgcolor: 'rgba(0,0,0,0)', color: colour('faint'), activecolor: colour('ink') },
    },
  };
}

// Points come in pairs, the extremes of an interval: the larger of the two stands for both.
const magnitude = (y) => y.map((v, i) => Math.max(Math.abs(v), Math.abs(y[i ^ 1] ?? v)));

class Plot {
  constructor(element) {
    this.element = element;
    const { data: traces, layout, log } = data(element).plots[element.dataset.index];
    this.layout = layout;
    this.traces = traces.map((trace) => {
      const y = unpack(trace.y);
      return { ...trace, x: unpack(trace.x), y, signed: y };
    });
    this.button = element.parentElement.querySelector('.log');
    this.button?.addEventListener('click', () => { this.scale(!this.log); this.draw(); });
    if (this.button) this.scale(log);
  }

  scale(log) {
    this.log = log;
    this.button.setAttribute('aria-pressed', log);
    this.button.textContent = log ? 'signed, linear' : 'magnitude, logarithmic';
    for (const trace of this.traces) trace.y = log ? magnitude(trace.signed) : trace.signed;
    for (const key of Object.keys(this.layout).filter((name) => name.startsWith('yaxis'))) {
      const { range, autorange, title, ...axis } = this.layout[key];
      const [quantity, unit] = title.text.replaceAll('|', '').split(' [');
      this.layout[key] = {
        ...axis, type: log ? 'log' : 'linear', uirevision: log, nticks: log ? 6 : 0,
        title: { text: `${log ? `|${quantity}|` : quantity} [${unit}` },
      };
    }
  }

  draw() {
    for (const trace of this.traces) {
      trace.line = { ...trace.line, color: colour(trace.meta) };
      trace.marker = { ...trace.marker, color: colour(trace.meta) };
    }
    this.layout.template = template();
    return Plotly.react(this.element, this.traces, this.layout, {
      responsive: true, displaylogo: false, displayModeBar: 'hover',
      toImageButtonOptions: { format: 'svg' },
      modeBarButtons: [['toImage'], ['zoom2d', 'pan2d'], ['zoomIn2d', 'zoomOut2d', 'resetScale2d']],
    });
  }
}

// Animation; y points up in the robot and down in SVG.

// Style and width of the lines of a part; of any other part, those of OTHER.
const PARTS = { proximal: ['link1', 7], distal: ['link2', 5], platform: ['ink', 3] };
const OTHER = ['faint', 4];

const point = (x, y) => `${x.toFixed(6)},${(-y).toFixed(6)}`;
const points = (numbers) => {
  const pairs = [];
  for (let i = 0; i < numbers.length; i += 2) pairs.push(point(numbers[i], numbers[i + 1]));
  return pairs.join(' ');
};

function line(svg, style, width, kind = 'polyline') {
  const element = document.createElementNS('http://www.w3.org/2000/svg', kind);
  element.style.stroke = `var(--${style})`;
  element.style.strokeWidth = width;
  return svg.appendChild(element);
}

class Animation {
  constructor(figure) {
    const { animation } = data(figure);
    Object.assign(this, animation);
    this.find = (name) => figure.querySelector(`.${name}`);
    this.runs = animation.runs.map((run) => ({ ...run, frames: unpack(run.frames) }));
    this.width = this.runs[0].frames.length / this.count;
    const [whole, detail] = [this.find('whole'), this.find('detail')];
    for (const [svg, [x, y, w, h]] of [[whole, this.view], [detail, this.detail]])
      svg.setAttribute('viewBox', `${x} ${-y - h} ${w} ${h}`);
    line(whole, 'reference', 3).setAttribute('points', this.path(this.runs[0], 0));
    this.trace = line(whole, 'run0', 1.2);
    this.base = line(whole, 'rule', 1.5, 'polygon');
    let start = 4;
    this.parts = animation.parts.map(([name, count]) => {
      const [style, width] = PARTS[name] ?? OTHER;
      const element = line(whole, style, width, 'path');
      element.dataset.part = name;
      start += 4 * count;
      return { name, element, start: start - 4 * count, end: start };
    });
    this.joints = line(whole, 'ink', 9, 'path');
    this.effector = line(whole, 'ink', 8, 'path');
    for (const run of this.runs) line(detail, 'reference', 4).setAttribute('points', this.path(run, 0));
    for (const run of this.runs) run.path = line(detail, run.style, 1.3);
    this.target = line(detail, 'ink', 1.5, 'path');
    for (const run of this.runs) run.dot = line(detail, run.style, 11, 'path');
    this.frame = 0;
    this.slider = this.find('time');
    this.slider.addEventListener('input', () => this.show(Number(this.slider.value)));
    this.find('play').addEventListener('click', () => (this.playing ? this.pause() : this.play()));
    this.find('robot')?.addEventListener('change', () => this.show(this.frame));
    this.find('magnify').addEventListener('change', () => this.magnify());
    this.magnify();
  }

  values(run, frame) {
    return run.frames.subarray(frame * this.width, (frame + 1) * this.width);
  }

  // Reference with the error times `factor`; 0 is the reference.
  place([x, y, px, py], factor) {
    return [x + factor * (px - x), y + factor * (py - y)];
  }

  path(run, factor) {
    const all = [];
    for (let frame = 0; frame < this.count; frame += 1) all.push(...this.place(this.values(run, frame), factor));
    return points(all);
  }

  magnify() {
    this.factor = Number(this.find('magnify').value);
    for (const run of this.runs) run.path.setAttribute('points', this.path(run, this.factor));
    this.show(this.frame);
  }

  show(frame) {
    this.frame = frame;
    this.slider.value = frame;
    this.find('now').textContent = `${(frame * this.step).toFixed(2)} s`;
    const chosen = this.runs[Number(this.find('robot')?.value ?? 0)];
    const v = this.values(chosen, frame);
    const dot = ([px, py]) => `M ${point(px, py)} h 0`;
    const joints = [];
    for (const { name, element, start, end } of this.parts) {
      const starts = [];
      const lines = [];
      for (let i = start; i < end; i += 4) {
        starts.push(v[i], v[i + 1]);
        lines.push(`M ${point(v[i], v[i + 1])} L ${point(v[i + 2], v[i + 3])}`);
        joints.push(dot([v[i], v[i + 1]]));
      }
      element.setAttribute('d', lines.join(' '));
      if (name === 'proximal') this.base.setAttribute('points', points(starts)); // they are fixed
    }
    this.joints.setAttribute('d', joints.join(' '));
    if (this.chosen !== chosen) {
      this.chosen = chosen;
      this.trace.style.stroke = this.effector.style.stroke = `var(--${chosen.style})`;
      this.trace.setAttribute('points', this.path(chosen, 1));
    }
    const [x, y, px, py] = v;
    this.effector.setAttribute('d', dot([px, py]));
    const arm = 0.03 * this.detail[2];
    this.target.setAttribute('d', `M ${x - arm} ${-y} h ${2 * arm} M ${x} ${-y - arm} v ${2 * arm}`);
    for (const run of this.runs) run.dot.setAttribute('d', dot(this.place(this.values(run, frame), this.factor)));
  }

  play() {
    const from = this.frame >= this.count - 1 ? 0 : this.frame;
    let elapsed = from * this.step;
    let before = performance.now();
    this.find('play').textContent = '❚❚';
    const tick = (now) => {
      elapsed += ((now - before) / 1000) * Number(this.find('speed').value);
      before = now;
      this.show(Math.min(Math.floor(elapsed / this.step), this.count - 1));
      if (this.frame < this.count - 1) this.playing = requestAnimationFrame(tick);
      else this.pause();
    };
    this.playing = requestAnimationFrame(tick);
  }

  pause() {
    cancelAnimationFrame(this.playing);
    this.playing = undefined;
    this.find('play').textContent = '▶';
  }
}

// Theme: the system's until the button is used; paper is white.

const dark = matchMedia('(prefers-color-scheme: dark)');
const paint = (name) => {
  root.dataset.theme = name;
  return Promise.all(plots.map((plot) => plot.draw()));
};
let theme = dark.matches ? 'dark' : 'light';
root.dataset.theme = theme;
const plots = [...document.querySelectorAll('.plot')].map((element) => new Plot(element));
const animations = [...document.querySelectorAll('.animation')].map((figure) => new Animation(figure));
document.getElementById('theme').addEventListener('click', () => paint((theme = theme === 'dark' ? 'light' : 'dark')));
dark.addEventListener('change', () => paint((theme = dark.matches ? 'dark' : 'light')));
addEventListener('beforeprint', () => { paint('light'); plots.forEach((plot) => Plotly.Plots.resize(plot.element)); });
addEventListener('afterprint', () => paint(theme));
paint(theme).then(() => { root.dataset.ready = 'true'; });
