// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// Taught points, stored in this browser per robot. Save writes the YAML file that the Python API's robot.points reads:
//   pick: {x: 350.0, y: 20.0, z: -30.0, u: 45.0, v: 0.0, w: 0.0}

const FIELDS = ['x', 'y', 'z', 'u', 'v', 'w'];
const MAX_POINTS = 200;
const NAME = /^(?!p\d+$)[a-z_]\w{0,31}$/i;
const LINE = /^([A-Za-z_]\w*)\s*:\s*\{([^{}]*)\}\s*(?:#.*)?$/;

const $ = (id) => document.getElementById(id);

export class Points {
  constructor(send, note, view) {
    Object.assign(this, { send, note, view, here: null, robot: '', points: {}, taught: {}, base: null, armed: false });
    $('teach').addEventListener('click', () => this.teach());
    $('point-name').addEventListener('keydown', (event) => { if (event.key === 'Enter') this.teach(); });
    $('save-points').addEventListener('click', () => this.save());
    $('load-points').addEventListener('click', () => $('points-file').click());
    $('points-file').addEventListener('change', () => this.load());
  }

  choose(robot) {
    this.robot = robot;
    try {
      this.points = checked(JSON.parse(localStorage.getItem(this.key) || '{}'));
    } catch (error) {
      this.points = {};
      this.note(`The points of this browser cannot be read: ${error.message}`);
    }
    this.draw();
  }

  get key() {
    return `epson_driver points ${this.robot}`;
  }

  teach() {
    if (!this.here) {
      this.note('Not taught: the position of the arm is unknown');
      return;
    }
    let number = 1;
    while (`point_${number}` in this.points) number++;
    const name = $('point-name').value.trim() || `point_${number}`;
    if (!NAME.test(name)) {
      this.note(`Not taught: ${name} must be a name: letters, digits and _, at most 32, not P and a number`);
      return;
    }
    const { tool } = this.here;
    this.points[name] = Object.fromEntries(FIELDS.map((field, k) => [field, tool[k]]));
    $('point-name').value = '';
    this.keep();
  }

  keep() {
    localStorage.setItem(this.key, JSON.stringify(this.points));
    this.draw();
  }

  draw() {
    const own = Object.entries(this.points), ofDriver = Object.entries(this.taught);
    $('points').replaceChildren(...[...own, ...ofDriver].map(([name, point], k) => {
      const made = document.createElement('li');
      const label = document.createElement('b');
      const numbers = document.createElement('small');
      label.textContent = name;
      numbers.textContent = FIELDS.map((field) => point[field].toFixed(1)).join(' ');
      label.append(numbers);
      const go = document.createElement('button');
      go.textContent = 'Go to';
      go.setAttribute('aria-label', `Go to ${name}`);
      go.dataset.armed = '';
      go.addEventListener('click', () => this.send({ do: 'go_to', name, ...point }));
      const forget = document.createElement('button');
      forget.textContent = '✕';
      forget.setAttribute('aria-label', `Forget ${name}`);
      forget.addEventListener('click', () => {
        delete this.points[name];
        this.keep();
      });
      if (k < own.length) made.append(label, go, forget);
      else made.append(label, go, 'of the driver');
      made.addEventListener('pointerenter', () => this.mark(name));
      made.addEventListener('pointerleave', () => this.mark());
      return made;
    }));
    this.mark();
    this.enable(this.armed);
  }

  /** Set the driver's taught points, [x, y, z, u, v, w] by name. */
  setTaught(taught) {
    this.taught = Object.fromEntries(Object.entries(taught).map(([name, values]) =>
      [name, Object.fromEntries(FIELDS.map((field, k) => [field, values[k]]))]));
    this.draw();
  }

  /** Set the pose of EPSON's world in base_link: the upper three rows of its matrix, m. */
  setBase(base) {
    this.base = base;
    this.mark();
  }

  /** Draw all points as markers in the view. The marker of `chosen` is larger. */
  mark(chosen) {
    if (!this.view) return;
    const places = this.base ? { ...this.points, ...this.taught } : {};
    const at = ({ x, y, z }) => this.base.map(([a, b, c, d]) => (a * x + b * y + c * z) / 1e3 + d);
    this.view.setPoints(Object.fromEntries(Object.entries(places).map(([name, point]) => [name, at(point)])), chosen);
  }

  enable(armed) {
    this.armed = armed;
    for (const each of document.querySelectorAll('#points [data-armed]')) each.disabled = !armed;
  }

  save() {
    const link = document.createElement('a');
    const robot = this.robot.split('/').filter(Boolean).join('_') || 'robot';
    link.href = URL.createObjectURL(new Blob([written(this.points)], { type: 'application/yaml' }));
    link.download = `${robot}_points.yaml`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }

  async load() {
    const [file] = $('points-file').files;
    $('points-file').value = '';
    if (!file) return;
    try {
      Object.assign(this.points, checked(read(await file.text())));
      this.keep();
    } catch (error) {
      this.note(`${file.name} has no points: ${error.message}`);
    }
  }
}

const written = (points) => Object.entries(points).map(([name, point]) =>
  `${name}: {${FIELDS.map((field) => `${field}: ${point[field].toFixed(3)}`).join(', ')}}\n`).join('');

/** Return the points in the text of a file of robot.points. Throws an error that names the first invalid line. */
function read(text) {
  const result = {};
  text.split('\n').forEach((line, i) => {
    if (!line.trim() || line.trim().startsWith('#')) return;
    const match = LINE.exec(line.trim());
    if (!match) throw new Error(`line ${i + 1} is not a point`);
    const fields = match[2].split(',').map((each) => each.split(':').map((part) => part.trim()));
    result[match[1]] = { u: 0, v: 0, w: 0, ...Object.fromEntries(fields.map(([field, value]) => [field, value ? Number(value) : NaN])) };
  });
  return result;
}

/** Return points if they are valid. Throws an error that names the first invalid one. */
function checked(points) {
  const entries = Object.entries(points);
  if (entries.length > MAX_POINTS) throw new Error(`${entries.length} points: at most ${MAX_POINTS}`);
  for (const [name, point] of entries) {
    const good = Object.keys(point).length === FIELDS.length && FIELDS.every((field) => Number.isFinite(point[field]));
    if (!NAME.test(name) || !good) throw new Error(`${name.slice(0, 40)} must have x, y, z, and may have u, v, w`);
  }
  return points;
}
