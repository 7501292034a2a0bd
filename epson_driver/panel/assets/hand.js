// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// Jogging: the arm moves while a button is pressed, or by one step per press. While a button is pressed, requests are sent
// periodically. The motion ends when they end, also if the page is hidden or frozen or its connection is cut.

const PERIOD_MS = 25;
const STEPS = [0.1, 1, 5, 10];
const TURNS = 'UVW';
const FRAME_OF = { joints: 'world', world: 'world', tool: 'tool' };

const $ = (id) => document.getElementById(id);

export class Hand {
  /** `send(request)` sends a request to the panel. */
  constructor(send) {
    this.send = send;
    this.timer = null;
    this.axes = [];
    this.labels = new Map();
    $('step').append(new Option('while held', ''), ...STEPS.map((each) => new Option(`by ${each} mm or °`, each)));
    for (const each of document.querySelectorAll('[name=frame]')) each.addEventListener('change', () => this.build());
    $('hand-speed').addEventListener('input', () => { $('hand-percent').textContent = `${$('hand-speed').value} %`; });
    for (const event of ['blur', 'pagehide']) addEventListener(event, () => this.end());
    document.addEventListener('visibilitychange', () => this.end());
  }

  get frame() {
    return document.querySelector('[name=frame]:checked').value;
  }

  /** Set names and units of the joints, and the tool axes that the arm can move. */
  setArm(joints, units, toolAxes) {
    const key = JSON.stringify([joints, units, toolAxes]);
    if (key === this.key) return;
    this.key = key;
    Object.assign(this, { joints, units, toolAxes });
    this.build();
  }

  /** Allow or forbid motion while a button is pressed. Without it, steps remain. */
  setStreams(allowed) {
    const [held, , first] = $('step').options;
    held.disabled = !allowed;
    if (!allowed && held.selected) first.selected = true;
  }

  build() {
    this.end();
    this.labels.clear();
    const rows = this.frame === 'joints'
      ? (this.joints || []).map((name, j) => [String(j + 1), name])
      : (this.toolAxes || []).map((name) => [name, name]);
    $('axes').replaceChildren(...rows.map(([axis, name]) => this.row(axis, name)));
    this.enable(this.armed);
  }

  row(axis, name) {
    const made = document.createElement('div');
    made.className = 'axis';
    const middle = document.createElement('span');
    const value = document.createElement('small');
    middle.append(name, value);
    this.labels.set(axis, value);
    made.append(this.button(axis, name, -1), middle, this.button(axis, name, 1));
    return made;
  }

  button(axis, name, sign) {
    const made = document.createElement('button');
    made.textContent = sign > 0 ? '+' : '−';
    made.setAttribute('aria-label', `${name} ${sign > 0 ? 'plus' : 'minus'}`);
    made.addEventListener('pointerdown', (event) => {
      if (event.button) return;
      made.setPointerCapture(event.pointerId);
      this.begin(made, axis, sign);
    });
    for (const event of ['pointerup', 'pointercancel', 'lostpointercapture', 'keyup', 'blur']) made.addEventListener(event, () => this.end());
    made.addEventListener('keydown', (event) => {
      if ((event.key === ' ' || event.key === 'Enter') && !event.repeat) this.begin(made, axis, sign);
    });
    made.addEventListener('contextmenu', (event) => event.preventDefault());
    return made;
  }

  begin(button, axis, sign) {
    this.end();
    if (button.disabled) return;
    const frame = FRAME_OF[this.frame], share = $('hand-speed').value / 100;
    if ($('step').value) {
      this.send({ do: 'step', axis, frame, size: sign * $('step').value * (this.turns(axis) ? Math.PI / 180 : 1e-3), share });
      return;
    }
    const go = () => this.send({ do: 'jog', axis, frame, share: sign * share });
    go();
    this.held = button;
    button.classList.add('held');
    this.timer = setInterval(go, PERIOD_MS);
  }

  turns(axis) {
    return this.frame === 'joints' ? this.units[axis - 1] !== 'mm' : TURNS.includes(axis);
  }

  end() {
    if (this.timer === null) return;
    clearInterval(this.timer);
    this.timer = null;
    this.held.classList.remove('held');
    this.send({ do: 'jog', share: 0 });
  }

  enable(armed) {
    this.armed = armed;
    if (!armed) this.end();
    for (const each of document.querySelectorAll('#axes button')) each.disabled = !armed;
  }

  /** Show the values of the axes. joints: texts. tool: X Y Z U V W. */
  show(joints, tool) {
    for (const [axis, label] of this.labels) {
      const place = 'XYZUVW'.indexOf(axis);
      label.textContent = place < 0 ? joints[axis - 1] : `${tool[place].toFixed(1)} ${place < 3 ? 'mm' : '°'}`;
    }
  }
}
