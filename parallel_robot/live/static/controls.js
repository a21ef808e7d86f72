'use strict';
// What the user can change, and what the node answered.

const find = (id) => document.getElementById(id);

// The token stands behind the # of the printed address: no browser sends that to a server, and it
// is taken out of the address at once, so that it is in no history and no screenshot.
const KEY = 'parallel_robot token';
if (location.hash.length > 1) {
  sessionStorage.setItem(KEY, location.hash.slice(1));
  history.replaceState(null, '', location.pathname);
}
const token = sessionStorage.getItem(KEY) ?? '';

function say(text, bad = false) {
  find('said').textContent = text;
  find('said').classList.toggle('bad', bad);
}

// Whether it was done, and the answer.
async function act(action, value = null) {
  try {
    const response = await fetch(`do/${action}`, {
      method: 'POST',
      headers: { 'Content-Type': 'application/json', Authorization: `Bearer ${token}` },
      body: JSON.stringify(value),
    });
    const text = await response.text();
    if (response.status === 200 || response.status === 409) return JSON.parse(text);
    return { done: false, answer: text };
  } catch {
    return { done: false, answer: 'the server does not answer' };
  }
}

async function tell(name, action, value) {
  say(`${name} …`);
  const { done, answer } = await act(action, value);
  say(done ? `${name}: ${answer || 'done'}` : `${name}: refused: ${answer}`, !done);
  return done;
}

// Fills a list, keeping what is chosen where somebody chooses right now.
function fill(select, options, chosen) {
  const wanted = JSON.stringify(options);
  if (select.dataset.options !== wanted) {
    select.dataset.options = wanted;
    select.replaceChildren(...options.map(({ name, title }) => new Option(title, name)));
  }
  if (document.activeElement !== select || !select.dataset.open) select.value = chosen;
}

class Field {
  constructor(parent, action, { key, name, text, unit, low, high }) {
    Object.assign(this, { key, action });
    this.row = parent.appendChild(document.createElement('div'));
    this.row.className = 'gain';
    const label = this.row.appendChild(document.createElement('label'));
    this.input = this.row.appendChild(document.createElement('input'));
    const shown = this.row.appendChild(document.createElement('span'));
    const range = this.row.appendChild(document.createElement('span'));
    this.why = this.row.appendChild(document.createElement('span'));
    label.htmlFor = this.input.id = key;
    label.textContent = name.replaceAll('_', '_\u200b'); // may break there
    label.title = text;
    this.input.inputMode = 'text';
    shown.className = 'unit';
    shown.textContent = raised(unit);
    range.className = 'range';
    range.id = `${key} range`;
    range.textContent = [text, bounds(low, high)].filter(Boolean).join('; ');
    this.why.className = 'why';
    this.why.setAttribute('role', 'alert');
    this.input.setAttribute('aria-description', range.textContent);
    this.input.addEventListener('change', () => this.send());
  }

  show(value) {
    this.value = value;
    this.row.classList.toggle('several', Array.isArray(value));
    if (document.activeElement !== this.input && !this.refused) this.input.value = written(value);
  }

  async send() {
    const wanted = read(this.input.value);
    const { done, answer } = await act(this.action, { key: this.key, value: wanted });
    this.refused = !done;
    this.input.setAttribute('aria-invalid', String(!done));
    this.why.textContent = done ? '' : `${answer}; still ${written(this.value)}`;
    if (done) say(`${this.key}: ${written(wanted)}`);
  }
}

// rad/s^3 as it is written by hand.
const raised = (unit) => unit.replace(/\^([23])(?![\d.])/g, (_, power) => (power === '2' ? '²' : '³'));
const bounds = (low, high) => {
  if (low !== null && high !== null) return `from ${low} to ${high}`;
  if (low !== null) return `at least ${low}`;
  return high === null ? '' : `at most ${high}`;
};
const written = (value) => (Array.isArray(value) ? value.join(', ') : String(value));
// A number, or several with commas; a text where that is none.
const read = (text) => {
  const numbers = text.split(',').map((part) => (part.trim() === '' ? NaN : Number(part)));
  if (numbers.some(Number.isNaN)) return text.trim();
  return numbers.length > 1 ? numbers : numbers[0];
};

// A form whose fields are the parameters of a law or of a motion; `action` changes one.
class Fields {
  constructor(form, action) {
    Object.assign(this, { form, action });
    form.addEventListener('submit', (event) => event.preventDefault());
  }

  show(list = []) {
    // A node that starts describes its parameters late.
    const described = JSON.stringify(list.map((one) => ({ ...one, value: null })));
    if (described !== this.described) {
      this.described = described;
      this.form.replaceChildren();
      this.fields = list.map((one) => new Field(this.form, this.action, one));
      allow();
    }
    list.forEach((one, k) => this.fields[k].show(one.value));
  }
}

let readOnly = false;
function allow() {
  const can = token && !readOnly;
  for (const element of document.querySelectorAll('.acts, .fields input')) element.disabled = !can;
  if (!can) say(readOnly ? 'This page only shows.' : 'This page only shows: open the address that the command printed.');
}

const stop = () => tell('emergency stop', 'emergency_stop');
find('stop').addEventListener('click', stop);
addEventListener('keydown', (event) => {
  if (event.key !== 'Escape' || find('stop').disabled || find('stop').hidden) return;
  event.preventDefault();
  stop();
}, true);
find('clear').addEventListener('click', () => tell('clear fault', 'clear_fault'));
find('reset').addEventListener('click', () => tell('reset', 'reset'));
find('preset').addEventListener('click', () => tell('preset gains', 'preset'));
find('record').addEventListener('click', () =>
  tell('record', 'record', find('record').getAttribute('aria-pressed') !== 'true'));
find('laws').addEventListener('change', ({ target }) => tell(`law ${target.value}`, 'law', target.value));
find('shapes').addEventListener('change', async ({ target }) => {
  const wanted = { key: 'trajectory.shape', value: target.value };
  if (!await tell(`motion ${target.value}`, 'motion', wanted)) target.value = texts.setup.shape;
});
find('ghost').addEventListener('change', ({ target }) => tell('ghost', 'ghost', target.value));

// The time bar of a bag; while it is dragged, one request is under way at a time.
let seeking = false;
let wanted;
async function seek(time) {
  wanted = time;
  if (seeking) return;
  seeking = true;
  while (wanted !== undefined) {
    const next = wanted;
    wanted = undefined;
    await act('seek', next);
    await new Promise((resume) => setTimeout(resume, 120)); // ten a second are taken
  }
  seeking = false;
}
find('seek').addEventListener('input', ({ target }) => seek(Number(target.value)));
find('play').addEventListener('click', () => act('play', find('play').dataset.playing !== 'true'));
find('back').addEventListener('click', () => act('step', -1));
find('forth').addEventListener('click', () => act('step', 1));
find('speed').addEventListener('change', ({ target }) => act('speed', Number(target.value)));
