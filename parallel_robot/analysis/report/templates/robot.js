// The moving robot as SVG, for the report and the live page. y points up in the robot, down in SVG.

// Style and width of the lines of a part; of any other part, those of OTHER.
const PARTS = { proximal: ['link1', 7], distal: ['link2', 5], platform: ['ink', 3] };
const OTHER = ['faint', 4];

const point = (x, y) => `${x.toFixed(6)},${(-y).toFixed(6)}`;
const points = (numbers) => {
  const pairs = [];
  for (let i = 0; i < numbers.length; i += 2) pairs.push(point(numbers[i], numbers[i + 1]));
  return pairs.join(' ');
};
const dot = ([x, y]) => `M ${point(x, y)} h 0`;

// Reference with the error times `factor`; 0 is the reference.
const place = ([x, y, px, py], factor) => [x + factor * (px - x), y + factor * (py - y)];

function line(svg, style, width, kind = 'polyline') {
  const element = document.createElementNS('http://www.w3.org/2000/svg', kind);
  element.style.stroke = `var(--${style})`;
  element.style.strokeWidth = width;
  return svg.appendChild(element);
}

const look = (svg, [x, y, w, h]) => svg.setAttribute('viewBox', `${x} ${-y - h} ${w} ${h}`);

// True to scale: the path, the parts of the robot, its end effector. The numbers of a posture are
// x, y of the reference, of the end effector, and of both ends of each line, part by part.
class WholeRobot {
  constructor(svg, parts) {
    this.svg = svg;
    svg.replaceChildren();
    this.reference = line(svg, 'reference', 3);
    this.trace = line(svg, 'run0', 1.2);
    this.base = line(svg, 'rule', 1.5, 'polygon');
    let start = 4;
    this.parts = parts.map(([name, count]) => {
      const [style, width] = PARTS[name] ?? OTHER;
      const element = line(svg, style, width, 'path');
      element.dataset.part = name;
      start += 4 * count;
      return { name, element, start: start - 4 * count, end: start };
    });
    this.size = start;
    this.joints = line(svg, 'ink', 9, 'path');
    this.effector = line(svg, 'ink', 8, 'path');
  }

  colour(style) {
    this.trace.style.stroke = this.effector.style.stroke = `var(--${style})`;
  }

  show(v) {
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
    this.effector.setAttribute('d', dot([v[2], v[3]]));
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
  aim(x, y, width) {
    const arm = 0.03 * width;
    this.target.setAttribute('d', `M ${x - arm} ${-y} h ${2 * arm} M ${x} ${-y - arm} v ${2 * arm}`);
  }
}
