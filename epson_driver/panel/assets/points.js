// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// Taught points: kept in this browser for each robot, saved as a JSON file, with the fields of the Python API's EpsonPoint
// (x, y, z in mm, u, v, w in degrees) and the joints (rad, m).

const FIELDS = ['x', 'y', 'z', 'u', 'v', 'w'];
const MOST = 200;

const $ = (id) => document.getElementById(id);

export class Points {
  constructor(send, note) {
    Object.assign(this, { send, note, here: null, robot: '', points: {}, armed: false });
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
      this.note('Not taught: it is not known where the arm is');
      return;
    }
    let number = 0;
    while (`P${number}` in this.points) number++;
    const name = $('point-name').value.trim() || `P${number}`;
    const { joints, tool } = this.here;
    this.points[name] = { ...Object.fromEntries(FIELDS.map((field, k) => [field, tool[k]])), joints };
    $('point-name').value = '';
    this.keep();
  }

  keep() {
    localStorage.setItem(this.key, JSON.stringify(this.points));
    this.draw();
  }

  draw() {
    $('points').replaceChildren(...Object.entries(this.points).map(([name, point]) => {
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
      go.addEventListener('click', () => this.send({ do: 'go_to', name, joints: point.joints }));
      const forget = document.createElement('button');
      forget.textContent = '✕';
      forget.setAttribute('aria-label', `Forget ${name}`);
      forget.addEventListener('click', () => {
        delete this.points[name];
        this.keep();
      });
      made.append(label, go, forget);
      return made;
    }));
    this.enable(this.armed);
  }

  enable(armed) {
    this.armed = armed;
    for (const each of document.querySelectorAll('#points [data-armed]')) each.disabled = !armed;
  }

  save() {
    const link = document.createElement('a');
    const robot = this.robot.split('/').filter(Boolean).join('_') || 'robot';
    link.href = URL.createObjectURL(new Blob([JSON.stringify(this.points, null, 1)], { type: 'application/json' }));
    link.download = `${robot}_points.json`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }

  async load() {
    const [file] = $('points-file').files;
    $('points-file').value = '';
    if (!file) return;
    try {
      Object.assign(this.points, checked(JSON.parse(await file.text())));
      this.keep();
    } catch (error) {
      this.note(`${file.name} has no points: ${error.message}`);
    }
  }
}

/** Return what is in a file if it is points. Raises an error that names the first that is none. */
function checked(found) {
  if (typeof found !== 'object' || found === null || Array.isArray(found)) throw new Error('it must be an object of points by name');
  const entries = Object.entries(found);
  if (entries.length > MOST) throw new Error(`${entries.length} points: at most ${MOST}`);
  for (const [name, point] of entries) {
    const numbers = point && Array.isArray(point.joints) ? [...FIELDS.map((field) => point[field]), ...point.joints] : [NaN];
    if (!numbers.every(Number.isFinite)) throw new Error(`${name.slice(0, 40)} must have numbers x, y, z, u, v, w and a list joints`);
  }
  return found;
}
