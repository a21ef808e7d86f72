// The moving robot as SVG, for the report and the live page. y points up in the robot, down in SVG.

// Style and width of the lines of a part; of any other part, those of OTHER.
const PARTS = { proximal: ['link1', 7], distal: ['link2', 5], platform: ['ink', 3], link: ['link1', 4] };
const OTHER = ['faint', 4];

const point = (x, y) => `${x.toFixed(6)},${(-y).toFixed(6)}`;
const dot = ([x, y]) => `M ${point(x, y)} h 0`;

// Reference with the error times `factor`, 0 is the reference; of the numbers of a posture.
function place(v, factor, size = 2) {
  const found = [];
  for (let i = 0; i < size; i += 1) found.push(v[i] + factor * (v[size + i] - v[i]));
  return found;
}

function line(svg, style, width, kind = 'polyline') {
  const element = document.createElementNS('http://www.w3.org/2000/svg', kind);
  element.style.stroke = `var(--${style})`;
  element.style.strokeWidth = width;
  return svg.appendChild(element);
}

const look = (svg, [x, y, w, h]) => svg.setAttribute('viewBox', `${x} ${-y - h} ${w} ${h}`);

// From where a robot is seen: in a plane, from above; in space, from wherever it was turned to.
class Eye {
  constructor(size) {
    this.size = size; // coordinates of a place: 2 or 3
    this.home();
  }

  home() {
    this.turn = -0.5; // rad, about z
    this.tilt = 0.35; // rad, pi / 2 is from above
  }

  // Where the place that begins at a number of v is in the picture: across and up [m].
  flat(v, at = 0) {
    if (this.size === 2) return [v[at], v[at + 1]];
    const [c, s] = [Math.cos(this.turn), Math.sin(this.turn)];
    const deep = c * v[at + 1] - s * v[at];
    return [c * v[at] + s * v[at + 1], Math.cos(this.tilt) * v[at + 2] + Math.sin(this.tilt) * deep];
  }

  // The points of a polyline through places that follow each other in one list.
  points(numbers) {
    const found = [];
    for (let i = 0; i < numbers.length; i += this.size) found.push(point(...this.flat(numbers, i)));
    return found.join(' ');
  }

  // The square around a ball: x, y, z of its centre, radius.
  around([x, y, z, radius]) {
    const [across, up] = this.flat([x, y, z]);
    return [across - radius, up - radius, 2 * radius, 2 * radius];
  }

  move(turn, tilt) {
    this.turn += turn;
    this.tilt = Math.min(Math.max(this.tilt + tilt, -Math.PI / 2), Math.PI / 2);
  }

  // Let a picture be turned: by dragging with mouse or finger, by arrow keys; a double click ends it.
  turnedBy(svg, turned) {
    const free = this.size === 3;
    const keys = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
    let before;
    const move = (turn, tilt) => { this.move(turn, tilt); turned(); };
    const takers = {
      onpointerdown: ({ clientX, clientY, pointerId }) => {
        before = [clientX, clientY];
        svg.setPointerCapture(pointerId);
      },
      onpointermove: ({ clientX, clientY }) => {
        if (!before) return;
        move(-0.01 * (clientX - before[0]), 0.01 * (clientY - before[1]));
        before = [clientX, clientY];
      },
      onlostpointercapture: () => { before = undefined; },
      ondblclick: () => { this.home(); turned(); },
      onkeydown: (event) => {
        if (!keys[event.key]) return;
        event.preventDefault();
        move(...keys[event.key]);
      },
    };
    for (const [name, taker] of Object.entries(takers)) svg[name] = free ? taker : null;
    Object.assign(svg.style, { touchAction: free ? 'none' : '', cursor: free ? 'grab' : '' });
    if (free) svg.tabIndex = 0;
    else svg.removeAttribute('tabindex');
  }
}

// True to scale: the path, the parts of the robot, its end effector. The numbers of a posture are
// the places of the reference, of the end effector, and of both ends of each line, part by part.
class WholeRobot {
  constructor(svg, parts, eye = new Eye(2)) {
    this.svg = svg;
    this.eye = eye;
    svg.replaceChildren();
    this.reference = line(svg, 'reference', 3);
    this.trace = line(svg, 'run0', 1.2);
    this.base = line(svg, 'rule', 1.5, 'polygon');
    let start = 2 * eye.size;
    this.parts = parts.map(([name, count]) => {
      const [style, width] = PARTS[name] ?? OTHER;
      const element = line(svg, style, width, 'path');
      element.dataset.part = name;
      start += 2 * eye.size * count;
      return { name, element, start: start - 2 * eye.size * count, end: start };
    });
    this.size = start;
    this.joints = line(svg, 'ink', 9, 'path');
    this.effector = line(svg, 'ink', 8, 'path');
  }

  colour(style) {
    this.trace.style.stroke = this.effector.style.stroke = `var(--${style})`;
  }

  show(v) {
    const { eye } = this;
    const joints = [];
    for (const { name, element, start, end } of this.parts) {
      const starts = [];
      const lines = [];
      for (let i = start; i < end; i += 2 * eye.size) {
        const from = eye.flat(v, i);
        if (!Number.isFinite(from[0])) continue; // no posture
        starts.push(point(...from));
        lines.push(`M ${point(...from)} L ${point(...eye.flat(v, i + eye.size))}`);
        joints.push(dot(from));
      }
      element.setAttribute('d', lines.join(' '));
      if (name === 'proximal') this.base.setAttribute('points', starts.join(' ')); // they are fixed
    }
    this.joints.setAttribute('d', joints.join(' '));
    this.effector.setAttribute('d', dot(eye.flat(v, eye.size)));
  }
}

// The neighbourhood of the path: where the end effectors of some runs are, errors magnified.
class PathDetail {
  constructor(svg, styles) {
    this.svg = svg;
    svg.replaceChildren();
    this.references = styles.map(() => line(svg, 'reference', 4));
    this.paths = styles.map((style) => line(svg, style, 1.3));
    this.target = line(svg, 'ink', 1.5, 'path');
    this.dots = styles.map((style) => line(svg, style, 11, 'path'));
  }

  // The reference as a cross, in a picture of some width.
  aim([x, y], width) {
    const arm = 0.03 * width;
    this.target.setAttribute('d', `M ${x - arm} ${-y} h ${2 * arm} M ${x} ${-y - arm} v ${2 * arm}`);
  }
}
