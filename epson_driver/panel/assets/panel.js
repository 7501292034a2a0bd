// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// The page of the panel: draws the parts that arrive over the websocket (window.py), and sends the user's requests
// (requests.py). Texts of robots are never interpreted as HTML.
import { COLOURS, Curves } from './curves.js';
import { Hand } from './hand.js';
import { Points } from './points.js';
import { makeView } from './view.js';

const ALIVE_MS = 300, SILENT_MS = 2000, ANSWER_MS = 500, AGAIN_MS = 1000, NOTE_MS = 8000;
const SIGNS = { good: '✓', warn: '!', bad: '✕', off: '–', unknown: '?' };
const FIELDS = ['X', 'Y', 'Z', 'U', 'V', 'W'];
const NEAR_END = 0.03;

const $ = (id) => document.getElementById(id);
const element = (tag, text = '', className = '') => Object.assign(document.createElement(tag), { textContent: text, className });
const why = (id, text) => { $(id).hidden = !text; say(id, text || ''); };
const say = (id, text) => { if ($(id).textContent !== text) $(id).textContent = text; };

const NO_DRIVER = { colour: 'unknown', reason: 'no driver found', remedy: 'start one in the ROS domain of the panel (ROS_DOMAIN_ID)' };

let undelivered = false; // STOP was pressed without a robot
let socket = null, chosen = '', received = -Infinity, stopAt = null, controls = {}, advice = null, arm = null, path = 0;

/** Send a request, and return the time, s. */
const send = (request) => {
  const at = performance.now() / 1e3;
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ robot: chosen, at, ...request }));
  else if (request.do !== 'alive') note('Not done: no reply from the panel');
  return at;
};

let view = null;
try {
  view = makeView($('scene'), $('view'));
  say('view-note', 'orange: plan · blue: actual · drag to rotate');
} catch {
  $('view').classList.add('none');
  say('view-note', `No 3D view: this browser has no WebGL. Everything else works without it.`);
}
const curves = new Curves($('plots'));
const hand = new Hand(send);
const points = new Points(send, note, view);

// --- the parts -------------------------------------------------------------------------------------

const parts = {
  robots(robots) {
    if (!robots.some((each) => each.name === chosen)) choose(robots.length ? robots[0].name : '');
    const now = robots.find((each) => each.name === chosen);
    const name = now ? now.label : 'No robot found';
    say('name', name);
    say('view-name', now ? name : '');
    say('now', now ? `${SIGNS[now.colour]} ${now.reason}` : '');
    $('now').dataset.colour = now ? now.colour : '';
    if (!now) parts.advice(NO_DRIVER);
    else if (undelivered) parts.alarms([]);
    document.title = now ? `${SIGNS[now.colour]} ${name}: ${now.reason} · epson_driver panel` : 'epson_driver panel';
    $('stop-one').hidden = robots.length < 2;
    $('stop').firstElementChild.textContent = robots.length < 2 ? 'STOP' : 'STOP ALL';
    $('robots').hidden = robots.length < 2;
    keyed($('robots'), robots, (each) => each.name, () => {
      const made = element('button');
      made.addEventListener('click', () => choose(made.dataset.key));
      return made;
    }, (made, each) => {
      if (made.textContent !== each.label) made.textContent = each.label;
      made.dataset.sign = SIGNS[each.colour];
      made.title = each.reason;
      made.setAttribute('aria-current', String(each.name === chosen));
    });
  },
  stopped(at) { if (at === stopAt) stopAt = null; },
  alarms(alarms) {
    undelivered = false;
    $('alarm').hidden = !alarms.length;
    say('alarm', alarms.join(' '));
  },
  arm(next) {
    arm = next;
    say('model', next ? `${next.model}: ${next.description}` : '');
    if (view) view.setArm(next && next.packed, next && next.size);
    points.setBase(next && next.base);
    path = 0;
    describe();
  },
  taught(taught) { points.setTaught(taught); },
  plan(plan) {
    if (view && plan && plan.number !== path) {
      path = plan.number;
      view.setPlan(plan.points);
    }
  },
  lamps(lamps) {
    keyed($('lamps'), lamps, ([name]) => name, ([name]) => {
      const made = element('li');
      made.append(element('i'), element('span', name), element('b'));
      made.dataset.lamp = name;
      return made;
    }, (made, [, text, colour]) => {
      made.dataset.colour = colour;
      made.children[0].textContent = SIGNS[colour];
      made.children[2].textContent = text;
    });
  },
  advice(next) {
    advice = next;
    const { reason, remedy, colour } = advice, arm = advice.armed && controls.armed !== 'yes' ? 'press Arm, then $&' : '$&';
    $('advice').dataset.colour = colour;
    $('advice').replaceChildren(element('b', reason), ...(remedy ? [`→ ${remedy.replace(/Reset error|press Enable|Tasks:/, arm)}`] : []));
  },
  ages(ages) {
    $('ages').replaceChildren(...ages.map(([name, age]) => element('span', `${name} ${age === null ? 'none yet' : `${age.toFixed(1)} s`}`)));
  },
  log(lines) {
    keyed($('log'), lines.toReversed(), (line) => line.join(), ([at, level, text]) => {
      const made = element('li', '', level >= 40 ? 'error' : level >= 30 ? 'warning' : '');
      made.append(element('time', new Date(at * 1e3).toTimeString().slice(0, 8)), text);
      return made;
    });
  },
  io(io) {
    if (typeof io === 'string') $('io').replaceChildren(element('p', io));
    else if (!io.length) $('io').replaceChildren(element('p', 'no points'));
    else {
      keyed($('io'), io, (each) => `${each.type} ${each.start} ${each.values.length}`, (each) => {
        const made = element('div');
        made.append(element('h3', each.name), element('div', '', 'bits'));
        const bits = each.values.map((_, k) => element(each.type === 2 ? 'button' : 'span', each.start + k));
        if (each.type === 2) bits.forEach((bit, k) => {
          bit.dataset.armed = '';
          bit.addEventListener('click', () => send({ do: 'output', index: each.start + k }));
        });
        made.lastElementChild.append(...bits);
        return made;
      }, (made, each) => each.values.forEach((value, k) => {
        const bit = made.lastElementChild.children[k];
        if (each.analog) bit.textContent = value;
        else bit.classList.toggle('on', Boolean(value));
        bit.setAttribute('aria-label', `${each.name} ${each.start + k}: ${each.analog ? value : value ? 'on' : 'off'}`);
      }));
      allow();
    }
  },
  controls(found) {
    controls = found;
    const armed = found.armed === 'yes';
    document.body.classList.toggle('armed', armed);
    $('arm').hidden = armed;
    $('arm').disabled = Boolean(found.forbidden);
    $('disarm').hidden = !armed;
    say('armed-note', { yes: 'This window is armed: motion buttons work here.', no: found.forbidden || 'Arm this window to move the robot.', other: 'Another window is armed.' }[found.armed]);
    if (!armed && found.speed !== null) {
      $('speed').value = Math.round(100 * found.speed);
      say('percent', `${$('speed').value} %`);
    }
    const offered = found.trajectories.length ? found.trajectories : ['no trajectory'];
    if (offered.join('\n') !== [...$('trajectory').options].map((each) => each.value).join('\n')) {
      $('trajectory').replaceChildren(...offered.map((each) => new Option(each)));
    }
    $('pendant').hidden = !found.simulated;
    why('no-streams', found.no_streams);
    why('no-plans', found.no_plans && `No Execute: ${found.no_plans}. Each step, point and "Move to its start" is one motion.`);
    why('no-login', found.no_login && `Grey: ${found.no_login}. Enable and Reset error work instead.`);
    hand.setStreams(!found.no_streams);
    if (advice) parts.advice(advice);
    describe();
    allow();
  },
  pendant({ presses, logins, faults }) {
    $('fault').replaceChildren(...faults.map((each) => new Option(each)));
    $('presses').replaceChildren(...Object.entries(presses).map(([what, ways]) => {
      const made = element('div', '', 'presses');
      made.setAttribute('role', 'group');
      made.setAttribute('aria-label', what);
      made.append(element('em', what), ...ways.map((how) => {
        const button = element('button', how);
        button.dataset.press = `${what} ${how}`;
        if (logins.includes(button.dataset.press)) button.dataset.login = '';
        button.addEventListener('click', () => send({ do: 'press', what, how }));
        return button;
      }));
      return made;
    }));
  },
  pose(pose) {
    for (const each of document.querySelectorAll('.joint-part')) each.classList.toggle('stale', !pose || !pose.fresh);
    points.here = pose && pose.fresh ? pose : null;
    if (!pose || !arm || !controls.joints) return;
    const shown = pose.joints.map((value, j) => `${(value * arm.per_unit[j]).toFixed(1)} ${arm.units[j]}`);
    if (view) view.show(pose.joints, pose.plan, pose.fresh);
    keyed($('joints'), pose.joints, (_, j) => controls.joints[j], (_, j) => {
      const made = element('div', '', 'joint');
      made.append(element('i'), element('em', controls.joints[j]), element('span', '', 'range'), element('b'));
      made.children[2].append(element('s'));
      made.children[0].style.color = made.children[2].style.color = COLOURS[j % COLOURS.length];
      made.title = `${controls.joints[j]}: ${arm.low[j].toFixed(0)} … ${arm.high[j].toFixed(0)} ${arm.units[j]}`;
      return made;
    }, (made, value, j) => {
      const share = (value * arm.per_unit[j] - arm.low[j]) / (arm.high[j] - arm.low[j]);
      // an end at 0, such as the upper end of a SCARA's joint 3, is its home
      made.classList.toggle('near', (share < NEAR_END && arm.low[j] < 0) || (share > 1 - NEAR_END && arm.high[j] > 0));
      made.querySelector('s').style.left = `${100 * Math.min(1, Math.max(0, share))}%`;
      made.children[3].textContent = pose.fresh ? shown[j] : '?';
    });
    keyed($('tool'), FIELDS, (name) => name, (name) => {
      const made = element('div');
      made.append(element('dt', name), element('dd'));
      return made;
    }, (made, _, k) => { made.lastElementChild.textContent = pose.fresh ? pose.tool[k].toFixed(1) : '?'; });
    hand.show(shown, pose.tool);
  },
  history(rows) { curves.setRows(rows); },
  row(row) { curves.add(row); },
  notes(notes) {
    hand.end();
    notes.forEach(note);
  },
};

/** Show items as the children of a list. The element of an item is kept, so that its text can be selected. */
function keyed(list, items, key, make, update = () => {}) {
  const old = new Map([...list.children].map((child) => [child.dataset.key, child]));
  const children = items.map((item, i) => {
    const name = key(item, i);
    const made = old.get(name) || make(item, i);
    made.dataset.key = name;
    update(made, item, i);
    return made;
  });
  for (const child of [...list.children]) if (!children.includes(child)) child.remove();
  children.forEach((child, i) => { if (list.children[i] !== child) list.insertBefore(child, list.children[i] || null); });
}

/** Set the joints of curves and buttons, once both parts with their names and units are known. */
function describe() {
  const names = controls.joints;
  if (!arm || !names || names.length !== arm.units.length) return;
  const key = JSON.stringify([chosen, names, arm.units]);
  if (key !== describe.key) {
    describe.key = key;
    const { rows } = curves;
    curves.setJoints(names, arm.units);
    curves.setRows(rows);
  }
  hand.setArm(names, arm.units, controls.axes);
}

function allow() {
  const armed = controls.armed === 'yes';
  for (const each of document.querySelectorAll('[data-armed]')) {
    const allowed = armed && !('plan' in each.dataset && controls.no_plans);
    if (each.disabled === allowed) each.disabled = !allowed;
  }
  for (const each of document.querySelectorAll('[data-login]')) each.disabled = Boolean(controls.no_login);
  hand.enable(armed);
  points.enable(armed);
}

function choose(robot) {
  if (robot === chosen) return;
  hand.end();
  chosen = robot;
  controls = {};
  curves.setRows([]);
  for (const id of ['lamps', 'log', 'joints', 'tool', 'io']) $(id).replaceChildren();
  advice = null;
  $('advice').replaceChildren();
  $('arm').disabled = true;
  say('armed-note', '');
  parts.arm(null);
  document.body.classList.remove('armed');
  allow();
  points.choose(robot);
  send({ do: 'choose', robot });
}

function note(text) {
  const made = $('notes').appendChild(element('p', text));
  setTimeout(() => made.remove(), NOTE_MS);
  while ($('notes').children.length > 4) $('notes').firstElementChild.remove();
}

// --- the connection --------------------------------------------------------------------------------

function connect() {
  const made = new WebSocket(`ws://${location.host}/`);
  made.addEventListener('open', () => {
    socket = made;
    if (chosen) send({ do: 'choose', robot: chosen });
    alive();
  });
  made.addEventListener('message', ({ data }) => {
    received = performance.now();
    const message = JSON.parse(data);
    for (const key of ['robots', 'stopped', 'alarms', 'notes', 'pendant']) if (key in message) parts[key](message[key]);
    if (message.robot !== chosen) return;
    for (const key of ['arm', 'controls', 'plan', 'lamps', 'advice', 'ages', 'log', 'io', 'taught', 'history', 'pose', 'row']) {
      if (key in message) parts[key](message[key]);
    }
  });
  made.addEventListener('close', () => {
    received = -Infinity;
    setTimeout(connect, AGAIN_MS);
  });
}

const alive = () => { if (!document.hidden) send({ do: 'alive' }); };
setInterval(alive, ALIVE_MS);

setInterval(() => {
  const now = performance.now(), gone = now - received > SILENT_MS, lost = stopAt !== null && (gone || now - 1e3 * stopAt > ANSWER_MS);
  document.body.classList.toggle('gone', gone || lost);
  say('silence-text', lost ? 'STOP was not delivered: no reply from the panel. Press the E-stop.'
    : gone ? 'No connection to the panel: the display may be wrong, and STOP does not work. Press the E-stop.' : '');
  if (gone) hand.end();
}, 100);

// --- buttons and keys ------------------------------------------------------------------------------

const stop = (word) => {
  hand.end();
  stopAt = send({ do: word });
  if (chosen) return;
  parts.alarms(['STOP was not delivered: no driver found. Press the E-stop.']);
  undelivered = true;
};
$('stop').addEventListener('click', () => stop('stop'));
addEventListener('keydown', (event) => { if (event.key === 'Escape') stop('stop'); }, true);
$('stop-one').addEventListener('click', () => stop('stop_one'));
for (const each of document.querySelectorAll('[data-do]')) each.addEventListener('click', () => send({ do: each.dataset.do }));
$('speed').addEventListener('input', () => {
  say('percent', `${$('speed').value} %`);
  send({ do: 'speed', value: $('speed').value / 100 });
});
$('execute').addEventListener('click', () => send({ do: 'execute', name: $('trajectory').value }));
$('go-to-start').addEventListener('click', () => send({ do: 'go_to_start', name: $('trajectory').value }));
$('switch-input').addEventListener('click', () => send({ do: 'input', index: Number($('input').value) }));
$('start-fault').addEventListener('click', () => send({ do: 'fault', text: `${$('fault').value} ${$('details').value}`.trim() }));

allow();
connect();
