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
    this.button = element.closest('figure').querySelector('.log');
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
      responsive: true, displaylogo: false,
      displayModeBar: matchMedia('(max-width: 40rem)').matches ? false : 'hover',  // it covers the legend
      toImageButtonOptions: { format: 'svg' },
      modeBarButtons: [['toImage'], ['zoom2d', 'pan2d'], ['zoomIn2d', 'zoomOut2d', 'resetScale2d']],
    });
  }
}

// Animation, drawn by robot.js

class Animation {
  constructor(figure) {
    const { animation } = data(figure);
    Object.assign(this, animation);
    this.find = (name) => figure.querySelector(`.${name}`);
    this.runs = animation.runs.map((run) => ({ ...run, frames: unpack(run.frames) }));
    this.width = this.runs[0].frames.length / this.count;
    this.eye = new Eye(animation.place);
    this.whole = new WholeRobot(this.find('whole'), animation.parts, this.eye);
    this.magnified = new PathDetail(this.find('detail'), this.runs.map((run) => run.style));
    for (const { svg } of [this.whole, this.magnified]) this.eye.turnedBy(svg, () => this.turn());
    this.frame = 0;
    this.slider = this.find('time');
    this.slider.addEventListener('input', () => this.show(Number(this.slider.value)));
    this.find('play').addEventListener('click', () => (this.playing ? this.pause() : this.play()));
    this.find('robot')?.addEventListener('change', () => this.show(this.frame));
    this.find('magnify').addEventListener('change', () => this.magnify());
    this.turn();
  }

  // Draw what depends on from where it is seen.
  turn() {
    const square = (around) => (this.eye.size === 2 ? around : this.eye.around(around));
    this.square = square(this.detail);
    look(this.whole.svg, square(this.view));
    look(this.magnified.svg, this.square);
    this.whole.reference.setAttribute('points', this.path(this.runs[0], 0));
    this.runs.forEach((run, i) => this.magnified.references[i].setAttribute('points', this.path(run, 0)));
    this.chosen = undefined;
    this.magnify();
  }

  values(run, frame) {
    return run.frames.subarray(frame * this.width, (frame + 1) * this.width);
  }

  path(run, factor) {
    const all = [];
    for (let frame = 0; frame < this.count; frame += 1) all.push(...place(this.values(run, frame), factor, this.eye.size));
    return this.eye.points(all);
  }

  magnify() {
    this.factor = Number(this.find('magnify').value);
    this.runs.forEach((run, i) => this.magnified.paths[i].setAttribute('points', this.path(run, this.factor)));
    this.show(this.frame);
  }

  show(frame) {
    this.frame = frame;
    this.slider.value = frame;
    this.find('now').textContent = `${(frame * this.step).toFixed(2)} s`;
    const chosen = this.runs[Number(this.find('robot')?.value ?? 0)];
    const v = this.values(chosen, frame);
    this.whole.show(v);
    if (this.chosen !== chosen) {
      this.chosen = chosen;
      this.whole.colour(chosen.style);
      this.whole.trace.setAttribute('points', this.path(chosen, 1));
    }
    this.magnified.aim(this.eye.flat(v), this.square[2]);
    this.runs.forEach((run, i) => {
      const at = place(this.values(run, frame), this.factor, this.eye.size);
      this.magnified.dots[i].setAttribute('d', dot(this.eye.flat(at)));
    });
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
