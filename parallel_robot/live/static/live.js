'use strict';
// The page: takes what the server sends, and draws.

const seen = new History();
const gains = new Fields(find('gains'), 'gain');
const motion = new Fields(find('motion'), 'motion');
const texts = {};
let diagrams = [];
let robot;
let detail;
let eye; // from where both are seen
let view; // of the whole robot: x, y, width, height [m]
let heard = 0; // ms, when the last frame came
let due = false;

function show(value, unit, id, digits = 3) {
  if (!Number.isFinite(value)) {
    find(id).textContent = '–';
    return;
  }
  const [number, prefix] = unit === 'm' ? prefixed(value, digits) : [value.toFixed(2), ''];
  const small = document.createElement('small');
  small.textContent = prefix + unit;
  find(id).replaceChildren(number, small);
}

function build() {
  const layout = seen.layout;
  const like = JSON.stringify([layout.place, layout.parts, layout.curves, layout.units]);
  view = undefined;
  if (like === root.dataset.like) return;
  root.dataset.like = like;
  for (const diagram of diagrams) diagram.remove();
  diagrams = DIAGRAMS.filter(({ group }) => seen.curves(group).length)
    .map((diagram) => ({ ...diagram, title: diagram.title ?? layout.efforts, unit: layout.units[diagram.group] ?? diagram.unit }))
    .map((diagram) => new Diagram(find('curves'), diagram, seen));
  document.querySelector('.stage').hidden = !layout.parts.length;
  eye = new Eye(layout.place);
  robot = new WholeRobot(find('whole'), layout.parts, eye);
  detail = new PathDetail(find('detail'), ['run0']);
  document.body.classList.toggle('turns', eye.size === 3);
  for (const { svg } of [robot, detail]) eye.turnedBy(svg, turned);
  robot.colour('run0');
}

function turned() {
  view = undefined;
  soon();
}

// A square around points that is never smaller than one before, but for the first second.
function around(before, places, margin) {
  let [left, low, right, high] = before ?? [Infinity, Infinity, -Infinity, -Infinity];
  for (const [x, y] of places) {
    if (!Number.isFinite(x + y)) continue;
    left = Math.min(left, x); right = Math.max(right, x);
    low = Math.min(low, y); high = Math.max(high, y);
  }
  const size = Math.max(right - left, high - low, 1e-3) * (1 + 2 * margin);
  return {
    bounds: [left, low, right, high],
    box: [(left + right - size) / 2, (low + high - size) / 2, size, size],
  };
}

function drawRobot() {
  const v = seen.posture;
  if (!v || !seen.layout.parts.length || !Number.isFinite(v[eye.size])) return; // no pose
  robot.show(v);
  const corners = [];
  for (let i = 2 * eye.size; i < robot.size; i += eye.size) corners.push(eye.flat(v, i));
  const whole = around(view, corners, 0.05);
  view = whole.bounds;
  look(robot.svg, whole.box);
  const factor = Number(find('magnify').value);
  const path = seen.path.map((p) => p.places);
  const drawn = (times) => path.map((p) => eye.flat(place(p, times, eye.size)));
  const [desired, actual] = [drawn(0), drawn(1)];
  const text = (places) => places.map((p) => point(...p)).join(' ');
  robot.reference.setAttribute('points', text(desired));
  robot.trace.setAttribute('points', text(actual));
  detail.references[0].setAttribute('points', text(desired));
  detail.paths[0].setAttribute('points', text(drawn(factor)));
  const near = around(undefined, desired, 0.12);
  if (path.length > 1) look(detail.svg, near.box);
  if (!Number.isFinite(v[0])) return; // no reference
  detail.aim(eye.flat(v), near.box[2]);
  detail.dots[0].setAttribute('d', dot(eye.flat(place(v, factor, eye.size))));
}

function draw() {
  due = false;
  if (!seen.layout || seen.now === undefined) return;
  drawRobot();
  for (const diagram of diagrams) diagram.draw();
  const recent = seen.time.length > 1;
  show(recent ? seen.rms(1) : NaN, 'm', 'rms');
  show(recent ? seen.largest('error', 1) : NaN, 'm', 'largest');
  show(recent ? seen.largest('torque', 1) : NaN, seen.layout.units.torque, 'torque');
  show(seen.now, 's', 'time');
  if (!find('bag').hidden && document.activeElement !== find('seek')) find('seek').value = seen.now;
  find('at').textContent = `${seen.now.toFixed(3)} s`;
  const change = seen.changes.findLast(([time]) => time <= seen.now);
  find('changed').hidden = !change;
  if (change) find('changed').textContent = `since ${change[0].toFixed(3)} s: ${change[1]}`;
  root.dataset.ready = 'true';
  root.dataset.now = seen.now;
}

const soon = () => {
  if (!due) requestAnimationFrame(draw);
  due = true;
};

const takers = {
  layout: (layout) => { seen.take(layout); build(); },
  page: (page) => { readOnly = page.readOnly; allow(); },
  setup: (setup) => {
    root.dataset.seen = setup.seen;
    const options = setup.laws;
    fill(find('ghost'), [{ name: '', title: 'none' }, ...options], texts.state?.ghost ?? '');
    fill(find('laws'), options, texts.state?.law ?? '');
    fill(find('shapes'), Object.keys(setup.shapes).map((name) => ({ name, title: name })), setup.shape);
    find('motionof').textContent = setup.shape ? `Parameters of ${setup.shape}` : 'Motion';
    motion.show(setup.shapes[setup.shape]);
    find('scenario').textContent = [setup.scenario, setup.robot].filter(Boolean).join(', ') || 'waiting for the nodes of a run';
    find('preset').disabled ||= setup.preset === 'paper';
  },
  state: (state) => {
    find('law').textContent = state.title || '–';
    document.title = `${state.title || 'parallel_robot'} · live`;
    const fault = state.fault ? `Fault: ${state.fault}` : state.trouble;
    find('fault').hidden = !fault;
    if (find('fault').textContent !== fault) find('fault').textContent = fault;
    find('laws').value = state.law;
    find('ghost').value = state.ghost;
    for (const diagram of diagrams) diagram.name(titleOf(state.ghost));
    showLoop(state);
    if (state.recording) showRecording(state.recording);
  },
  bag: (bag) => {
    if (!document.body.classList.contains('plays')) {
      document.body.classList.add('plays');
      for (const element of document.querySelectorAll('.graph, aside')) element.hidden = true;
      find('bag').append(find('ghostrow'), find('said'));
    }
    find('bag').hidden = false;
    find('seek').max = bag.duration;
    if (bag.changes.length !== seen.changes.length)
      find('changes').replaceChildren(...bag.changes.map(([time, text]) => new Option(text, time)));
    seen.changes = bag.changes;
    find('play').textContent = bag.playing ? '❚❚' : '▶';
    find('play').dataset.playing = bag.playing;
    if (document.activeElement !== find('speed')) find('speed').value = bag.speed;
  },
};

const titleOf = (law) => texts.setup?.laws.find(({ name }) => name === law)?.title ?? law;

function showLoop(state) {
  const [p50, p99, largest] = state.lag;
  const number = (word) => Number(word).toFixed(Number(word) < 100 ? 2 : 0);
  if (p99) show(Number(p99), 'ms', 'lag');
  else find('lag').textContent = '–';
  find('lags').textContent = p99 ? `${number(p50)}, ${number(p99)}, ${number(largest)}` : '–';
  find('limits').textContent = state.limits || 'none acts';
  find('limits').className = state.limits ? 'bad' : '';
  find('answered').textContent = state.answered ? `${state.answered}, ${state.skipped}` : '–';
  find('nodes').replaceChildren(...state.nodes.map((node) => {
    const row = document.createElement('tr');
    const cells = [
      node.name,
      node.silent ? `silent for ${node.silent} s` : node.rate && `${Number(node.rate).toFixed(0)} Hz`,
      node.processor && `${Number(node.processor).toFixed(1)} %`,
    ];
    row.title = node.says;
    for (const text of cells) row.appendChild(document.createElement('td')).textContent = text || '–';
    if (node.silent || node.level) row.children[node.silent ? 1 : 0].className = 'bad';
    return row;
  }));
}

function showRecording({ running, bag, says }) {
  find('record').setAttribute('aria-pressed', running);
  find('record').textContent = running ? 'End recording' : 'Record';
  find('recording').hidden = !(running || says);
  find('recording').textContent = running ? `records ${bag}` : says;
}

let connected = false;
function showConnection() {
  const silent = (performance.now() - heard) / 1000;
  const moving = silent < 1.5;
  const plays = !find('bag').hidden;
  const text = !connected ? 'no connection' : plays ? (moving ? 'plays' : 'paused') : moving ? 'live' : 'no states';
  const chip = find('connection');
  if (chip.textContent !== text) chip.textContent = text;
  chip.className = `chip ${!connected ? 'bad' : moving && !plays ? 'good' : ''}`;
}

listen({
  take: (found) => {
    for (const [name, value] of Object.entries(found)) {
      texts[name] = value;
      takers[name]?.(value);
    }
    if (found.setup || found.state) {
      const { law, title } = texts.state ?? {};
      find('gainsof').textContent = title ? `Gains of ${title}` : 'Gains';
      gains.show(texts.setup?.gains[law]);
    }
    soon();
  },
  frames: (data) => {
    heard = performance.now();
    seen.add(data);
    soon();
  },
  connected: (is) => { connected = is; showConnection(); },
});
setInterval(showConnection, 500);

const dark = matchMedia('(prefers-color-scheme: dark)');
let theme;
const paint = (name) => {
  theme = root.dataset.theme = name;
  for (const diagram of diagrams) diagram.plot.redraw();
};
find('theme').addEventListener('click', () => paint(theme === 'dark' ? 'light' : 'dark'));
dark.addEventListener('change', () => paint(dark.matches ? 'dark' : 'light'));
paint(dark.matches ? 'dark' : 'light');
find('magnify').addEventListener('change', soon);
allow();
