// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// The report page: draws the arm (three.js) and the curves (uPlot) from the data in #data, at a time that the user selects.
(() => {
  'use strict';
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($('data').textContent);
  const { runs, arm, colours, flags } = data;
  const joints = runs[0].figures.joint_names;
  const compare = runs.length > 1;
  const letter = (r) => 'AB'[r];
  const RUN_COLOURS = ['#2272c3', '#d97706'];
  const TAU = 2 * Math.PI;

  // --- data ---------------------------------------------------------------------------------------

  const { bytes } = drawing;
  const floats = (text) => new Float32Array(bytes(text));
  const column = (values, index, count, scale = 1) => {
    const result = new Array(values.length / count);
    for (let k = 0; k < result.length; k++) result[k] = values[k * count + index] * scale;
    return result;
  };
  const columns = (values) => joints.map((_, j) => column(values, j, joints.length));
  const scaled = (packed) => {
    const values = new Int16Array(bytes(packed.values));
    return joints.map((_, j) => column(values, j, joints.length, packed.scale[j]));
  };
  for (const run of runs) {
    const motion = run.figures.motions.find((each) => each.began_s !== null);
    run.shift = compare ? (motion ? motion.began_s : 0) : 0;
    run.at = Array.from(floats(run.times), (t) => t - run.shift);
    run.q = columns(floats(run.positions));
    run.v = scaled(run.velocities);
    run.a = scaled(run.accelerations);
    for (const plan of run.plans) {
      plan.at = Array.from(floats(plan.times), (t) => t + plan.began - run.shift);
      plan.q = columns(floats(plan.positions));
    }
    run.error = joints.map((_, j) => run.at.map((t) => {
      const plan = planAt(run, t);
      return plan ? between(run.at, run.q[j], t) - between(plan.at, plan.q[j], t) : null;
    }));
  }
  const first = Math.min(...runs.map((run) => Math.min(run.at[0], -run.shift)));
  const last = Math.max(...runs.map((run) => Math.max(run.at[run.at.length - 1], run.figures.duration_s - run.shift)));

  /** Return the index of the last entry at or before a time, or -1. */
  function before(times, time) {
    let low = -1, high = times.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle; else high = middle;
    }
    return low;
  }
  function between(times, values, time) {
    const index = before(times, time);
    if (index < 0) return values[0];
    if (index >= times.length - 1) return values[times.length - 1];
    const share = (time - times[index]) / (times[index + 1] - times[index]);
    return values[index] + share * (values[index + 1] - values[index]);
  }
  function planAt(run, time) {
    for (let p = run.plans.length - 1; p >= 0; p--) {
      const { at } = run.plans[p];
      if (time >= at[0]) return time <= at[at.length - 1] ? run.plans[p] : null;
    }
    return null;
  }
  const conditionAt = (run, time) => {
    const index = before(run.conditions.map((each) => each[0] - run.shift), time);
    return index < 0 ? null : run.conditions[index];
  };
  const linkAt = (run, time) => {
    const ports = new Map();
    for (const [at, port, up] of run.links) if (at - run.shift <= time) ports.set(port, up);
    return ports;
  };

  // --- texts --------------------------------------------------------------------------------------

  const mixed = data.units.includes('m'); // some joints are prismatic
  const per = (time) => (mixed ? `rad${time}, m${time}` : `rad${time}`);
  const milli = mixed ? 'mrad, mm' : 'mrad';
  const fixed = (value, digits, unit = '') => (value === null || value === undefined ? '–' : value.toFixed(digits) + unit);
  const ms = (seconds, digits = 1) => (seconds === null || seconds === undefined ? '–' : (seconds * 1e3).toFixed(digits) + ' ms');
  function element(tag, text, className) {
    const made = document.createElement(tag);
    if (text !== undefined && text !== null) made.textContent = text;
    if (className) made.className = className;
    return made;
  }
  function table(heads, rows, numbers = []) {
    const made = element('table', null, 'wide');
    const head = made.appendChild(element('tr'));
    heads.forEach((text, i) => head.appendChild(element('th', text, numbers.includes(i) ? 'number' : '')));
    for (const row of rows) {
      const line = made.appendChild(element('tr'));
      row.forEach((text, i) => {
        const cell = line.appendChild(element('td', text, numbers.includes(i) ? 'number' : ''));
        cell.dataset.head = heads[i]; // shown next to the cell on narrow screens
        cell.classList.toggle('none', text === '' || text === '–');
      });
    }
    return made;
  }

  $('title').textContent = runs.map((run) => (compare ? `${letter(runs.indexOf(run))}: ` : '') + run.figures.source).join('  ·  ');
  $('subtitle').textContent = runs.map((run) => `${run.figures.began.replace('T', ' ').slice(0, 19)} UTC, ${run.figures.duration_s.toFixed(1)} s`)
    .join('  ·  ') + `  ·  ${data.description}` + (compare ? '  ·  0 s: start of the motion' : '');
  const legend = (text, colour, dashed) => {
    const made = element('span');
    const mark = made.appendChild(element('i', null, dashed ? 'dashed' : ''));
    mark.style.borderColor = colour;
    made.append(text);
    $('legend').appendChild(made);
  };
  runs.forEach((run, i) => legend(compare ? `${letter(i)}: ${run.figures.source}` : 'measured', RUN_COLOURS[i], compare && i));
  legend('plan', '#0f766e', true);

  const motionsOf = (run) => run.figures.motions.filter((each) => each.began_s !== null);
  const total = (run, key) => motionsOf(run).reduce((sum, m) => sum + m[key], 0).toFixed(2);
  const cards = [
    [compare ? 'in motion' : `in motion, planned ${total(runs[0], 'planned_s')} s`, (run) => [total(run, 'moved_s'), 's']],
    ['longest dead time', (run) => {
      const worst = Math.max(...motionsOf(run).map((m) => m.dead_time_s));
      return Number.isFinite(worst) ? [(worst * 1e3).toFixed(0), 'ms'] : ['–', ''];
    }],
    ['unplanned stops', (run) => {
      const stops = motionsOf(run).reduce((sum, m) => sum + (m.stops || 0), 0);
      return [stops, '', stops > 0];
    }],
    ['largest waypoint error', (run) => {
      const worst = Math.max(...motionsOf(run).map((m) => m.waypoint_deviation ?? -1));
      return worst >= 0 ? [(worst * 1e3).toFixed(1), mixed ? 'mrad or mm' : milli] : ['–', ''];
    }],
    ['highest velocity', (run) => {
      const share = Math.max(...motionsOf(run).flatMap((m) => m.top_velocity.map((v, j) => v / run.figures.velocity_limits[j])));
      return Number.isFinite(share) ? [(share * 100).toFixed(0), '% of the limit'] : ['–', ''];
    }],
    ['joint states', (run) => [fixed(run.figures.joint_states.rate_hz, 0), 'Hz']],
    ['longest joint state gap', (run) => [fixed(run.figures.joint_states.between_longest_s * 1e3, 0), 'ms', run.figures.joint_states.between_longest_s > 0.3]],
    ['errors and warnings', (run) => {
      const count = run.figures.events.filter((each) => each.level !== 'info').length;
      return [count, '', count > 0];
    }],
  ];
  for (const [name, value] of cards) {
    const card = $('cards').appendChild(element('div', null, 'card'));
    const bold = card.appendChild(element('b'));
    let units = '';
    runs.forEach((run, i) => {
      const [number, unit, bad] = value(run);
      if (i) bold.appendChild(element('small', ' · '));
      const shownNumber = bold.appendChild(element('em', number, bad ? 'bad' : ''));
      if (compare) shownNumber.style.color = RUN_COLOURS[i];
      if (!compare) bold.append(' ', element('small', unit));
      else units = unit && ` (${unit})`;
    });
    card.appendChild(element('span', name + units));
  }

  const which = (run) => (compare ? [letter(runs.indexOf(run))] : []);
  const motionRows = runs.flatMap((run) => run.figures.motions.map((m) => [...which(run), `${(m.sent_s - run.shift).toFixed(2)} s`, m.points, fixed(m.planned_s, 2), fixed(m.moved_s, 2),
    m.dead_time_s === null ? '–' : (m.dead_time_s * 1e3).toFixed(0), m.stops === null ? '–' : m.commanded_stops ? `${m.stops} + ${m.commanded_stops}` : m.stops,
    m.waypoint_deviation === null ? '–' : (m.waypoint_deviation * 1e3).toFixed(2), m.end_deviation === null ? '–' : (m.end_deviation * 1e3).toFixed(3),
    m.top_velocity.length ? Math.max(...m.top_velocity).toFixed(2) : '–', m.top_acceleration.length ? Math.max(...m.top_acceleration).toFixed(1) : '–']));
  const motionHeads = ['sent', 'points', 'planned s', 'moved s', 'dead time ms', 'stops', `waypoint error ${milli}`, `end error ${milli}`, `top velocity ${per('/s')}`, `top acceleration ${per('/s²')}`];
  $('motions').append(motionRows.length ? table(compare ? ['run', ...motionHeads] : motionHeads, motionRows, motionHeads.map((_, i) => i + compare)) : element('p', 'no trajectory was sent'));
  if (motionRows.length) $('motions').append(element('p', 'Stops: unplanned + planned. Dead time: from the first point sent to the first motion.'));
  const messageRows = runs.flatMap((run) => [
    ...run.figures.messages.map((m) => [...which(run), m.name, m.sender, m.count, fixed(m.rate_hz, 1), ms(m.between_median_s), ms(m.between_p99_s), ms(m.between_longest_s)]),
    ...run.figures.replies.map((m) => [...which(run), `reply to ${m.name}`, 'controller', m.count, '', ms(m.median_s), ms(m.p99_s), ms(m.longest_s)]),
  ]);
  const messageHeads = ['message', 'from', 'count', 'Hz', 'median', '99 %', 'longest'];
  $('messages').append(table(compare ? ['run', ...messageHeads] : messageHeads, messageRows, [2, 3, 4, 5, 6].map((i) => i + compare)),
    element('p', 'Intervals between messages of a kind, and latencies of replies.'));
  for (const run of runs) {
    const who = compare ? `${letter(runs.indexOf(run))}: ` : '';
    for (const note of run.figures.notes) $('notes').append(element('li', who + note));
    if (run.stride > 1) $('notes').append(element('li', `${who}the curves show one in ${run.stride} of ${run.figures.joint_states.count} joint states, the figures use all`));
    if (run.events_left_out) $('notes').append(element('li', `${who}${run.events_left_out} more events are in the JSON`));
  }
  $('notes').append(element('li', 'accelerations, and velocities that the controller does not send, are computed from parabolas fitted to 60 ms of joint states'));
  const events = runs.flatMap((run, r) => run.figures.events.map((event) => ({ ...event, at: event.time_s - run.shift, run: r }))).sort((a, b) => a.at - b.at);
  const eventTable = $('events').appendChild(element('table'));
  const eventRows = events.map((event) => {
    const row = eventTable.appendChild(element('tr'));
    row.append(element('td', `${event.at.toFixed(3)} s`), ...(compare ? [element('td', letter(event.run))] : []));
    const cell = row.appendChild(element('td', event.text, event.level));
    if (event.remedy) cell.appendChild(element('small', `→ ${event.remedy}`));
    row.addEventListener('click', () => setTime(event.at));
    return row;
  });

  // --- the arm ------------------------------------------------------------------------------------

  const makeArm = drawing.armsOf(arm);
  const poseAt = (times, q, time) => q.map((values) => between(times, values, time));
  let view = null;
  try {
    view = makeView();
  } catch {
    $('view').classList.add('none');
    $('view-note').textContent = 'No 3D view: this browser has no WebGL. Everything else works without it.';
  }
  function makeView() {
    const { scene, soon, lookAt } = drawing.stage($('scene'), $('view'));
    const arms = runs.map((_, i) => makeArm(i ? RUN_COLOURS[1] : null, i ? 0.5 : 1));
    const ghost = makeArm('#0f9d8a', 0.22);
    ghost.base.visible = false;
    for (const each of [...arms, ghost]) scene.add(each.base);
    const path = (times, q, colour) => {
      const points = [], step = Math.max(1, Math.floor(times.length / 900));
      for (let k = 0; k < times.length; k += step) {
        ghost.set(q.map((values) => values[k]));
        points.push(ghost.tool());
      }
      scene.add(new lib.Line(new lib.BufferGeometry().setFromPoints(points), new lib.LineBasicMaterial({ color: colour })));
      return points;
    };
    const all = runs.flatMap((run, i) => [...path(run.at, run.q, RUN_COLOURS[i]), ...run.plans.flatMap((plan) => path(plan.at, plan.q, '#0f9d8a'))]);
    const tip = new lib.Mesh(new lib.SphereGeometry(0.011, 20, 14), new lib.MeshStandardMaterial({ color: RUN_COLOURS[0] }));
    scene.add(tip);
    const size = Math.max(0.5, ...all.map((point) => Math.max(Math.hypot(point.x, point.y), point.z)));
    lookAt(size);
    return {
      set(time) {
        runs.forEach((run, i) => arms[i].set(poseAt(run.at, run.q, time)));
        tip.position.copy(arms[0].tool());
        const plan = planAt(runs[0], time);
        const there = plan ? poseAt(plan.at, plan.q, time) : [];
        const here = poseAt(runs[0].at, runs[0].q, time);
        ghost.set(there);
        ghost.showWhereApart(there, here);
        soon();
      },
    };
  }
  if (view) $('view-note').textContent = compare ? 'A in colour · B in orange · green: plan of A · drag to rotate' : 'green: plan, where it differs from the arm · drag to rotate';

  // --- lamps and joints ---------------------------------------------------------------------------

  const tri = (condition, name) => (condition ? condition[1][flags.indexOf(name)] : -1);
  const triText = (value, yes, no, yesClass, noClass) => (value === 1 ? [yes, yesClass] : value === 0 ? [no, noClass] : ['unknown', '']);
  function lampsAt(run, time) {
    const c = conditionAt(run, time), links = linkAt(run, time);
    const down = [...links].filter(([, up]) => !up).map(([port]) => port);
    const error = tri(c, 'in_error');
    return [
      ['link', ...(links.size ? down.length ? [`${down.join(', ')} lost`, 'bad'] : ['connected', 'good'] : ['unknown', ''])],
      ['motors', ...triText(tri(c, 'drives_powered'), 'on', 'off', 'good', 'warn')],
      ['E-stop', ...triText(tri(c, 'e_stopped'), 'pressed', 'released', 'bad', 'good')],
      ['error', ...(error === 1 ? [c[3].join(', ') || 'yes', 'bad'] : error === 0 ? ['none', 'good'] : ['unknown', ''])],
      ['key switch', ...(c ? { 1: ['manual', 'warn'], 2: ['automatic', 'good'] }[c[2]] || ['unknown', ''] : ['unknown', ''])],
      ['motion', ...triText(tri(c, 'in_motion'), 'moving', 'at rest', 'good', '')],
      ['ready', ...triText(tri(c, 'motion_possible'), 'yes', 'no', 'good', 'warn')],
    ];
  }
  const lampElements = runs.flatMap((run, r) => lampsAt(run, first).map(([name]) => {
    const made = $('lamps').appendChild(element('div', null, 'lamp'));
    made.dataset.lamp = name;
    made.append(element('i'), element('b'), element('span', compare ? `${name} ${letter(r)}` : name));
    return made;
  }));
  const unit = (j) => (data.units[j] === 'm' ? ['mm', 1e3] : ['°', 180 / Math.PI]);
  const jointHead = $('joints').appendChild(element('tr'));
  ['joint', per(''), mixed ? '°, mm' : '°', 'velocity', 'range'].forEach((text, i) => jointHead.appendChild(element('th', text, i && i < 4 ? 'number' : '')));
  const jointRows = joints.map((name, j) => {
    const row = $('joints').appendChild(element('tr'));
    const cells = [name, '', '', '', null].map((text, i) => row.appendChild(element('td', text, i && i < 4 ? 'number' : '')));
    const range = cells[4].appendChild(element('span', null, 'range'));
    range.style.color = colours[j % colours.length];
    return [...cells, range.appendChild(element('i'))];
  });
  function showNumbers(time) {
    const run = runs[0], q = poseAt(run.at, run.q, time), v = poseAt(run.at, run.v, time);
    q.forEach((value, j) => {
      const [sign, factor] = unit(j);
      jointRows[j][1].textContent = value.toFixed(4);
      jointRows[j][2].textContent = (value * factor).toFixed(2) + sign;
      jointRows[j][3].textContent = v[j].toFixed(3);
      const share = (value - data.limits.low[j]) / (data.limits.high[j] - data.limits.low[j]);
      jointRows[j][5].style.left = `calc(${(Math.min(Math.max(share, 0), 1) * 100).toFixed(2)}% - 2px)`;
    });
    let wrong = false;
    runs.flatMap((each) => lampsAt(each, time)).forEach(([name, text, state], i) => {
      lampElements[i].className = `lamp ${state}`;
      lampElements[i].children[1].textContent = text;
      wrong ||= state === 'bad' || (name === 'motors' && state === 'warn');
    });
    let last = null;
    events.forEach((event, i) => {
      eventRows[i].classList.toggle('past', event.at <= time);
      if (event.at <= time && event.level !== 'info' && event.remedy) last = event;
    });
    $('advice').replaceChildren(...(wrong && last ? [element('b', last.text), element('span', `→ ${last.remedy}`)] : []));
  }

  // --- curves -------------------------------------------------------------------------------------

  const shown = joints.map(() => true);
  const plots = [];
  let zooming = false;
  joints.forEach((name, j) => {
    const chip = $('chips').appendChild(element('button', null, 'chip'));
    chip.appendChild(element('i')).style.color = colours[j % colours.length];
    chip.append(name);
    chip.setAttribute('aria-pressed', 'true');
    chip.addEventListener('click', () => {
      shown[j] = !shown[j];
      chip.setAttribute('aria-pressed', String(shown[j]));
      for (const plot of plots) if (plot.perJoint) runs.forEach((_, r) => plot.u.setSeries(1 + r * joints.length + j, { show: shown[j] }));
    });
  });

  function drawPlans(u) {
    const { ctx } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
    ctx.clip();
    const dot = 2.2 * devicePixelRatio;
    for (const plan of runs.flatMap((run) => run.plans)) {
      joints.forEach((_, j) => {
        if (!shown[j]) return;
        ctx.fillStyle = ctx.strokeStyle = colours[j % colours.length];
        if (plan.at.length > 150) {
          ctx.setLineDash([2 * devicePixelRatio, 4 * devicePixelRatio]);
          ctx.beginPath();
          plan.at.forEach((t, k) => ctx[k ? 'lineTo' : 'moveTo'](u.valToPos(t, 'x', true), u.valToPos(plan.q[j][k], 'y', true)));
          ctx.stroke();
          return;
        }
        plan.at.forEach((t, k) => {
          ctx.beginPath();
          ctx.arc(u.valToPos(t, 'x', true), u.valToPos(plan.q[j][k], 'y', true), dot, 0, TAU);
          ctx.fill();
        });
      });
    }
    ctx.restore();
  }

  /** Return the range of the position axis: that of the measured values, extended to the visible points of the plans. */
  function withPlans(u, low, high) {
    const { min, max } = u.scales.x;
    let lowest = low ?? 0, highest = high ?? 0;
    for (const plan of runs.flatMap((run) => run.plans)) plan.at.forEach((t, k) => {
      if (t < min || t > max) return;
      joints.forEach((_, j) => {
        if (!shown[j]) return;
        lowest = Math.min(lowest, plan.q[j][k]);
        highest = Math.max(highest, plan.q[j][k]);
      });
    });
    return lib.uPlot.rangeNum(lowest, highest, 0.1, true);
  }

  function addPlot(name, hint, series, options = {}) {
    const box = $('plots').appendChild(element('div', null, 'plot'));
    const line = box.appendChild(element('div', name, 'name'));
    line.appendChild(element('span', hint));
    const tables = series.map(({ x, y }) => [x, y]);
    const joined = lib.uPlot.join(tables, tables.map(() => [0, 1]));
    const axis = { stroke: '#74818e', grid: { stroke: '#7b88952b', width: 1 }, ticks: { show: false }, font: '11px system-ui, sans-serif' };
    const u = new lib.uPlot({
      width: box.clientWidth - 16, height: options.height || 158, legend: { show: false }, padding: [8, 20, 0, 0],
      cursor: { sync: { key: 'time' }, points: { show: false }, drag: { x: true, y: false } },
      scales: { x: { time: false, range: (_, low, high) => [low ?? first, high ?? last] }, y: options.y || {} },
      axes: [{ ...axis, size: 24, values: (_, ticks) => ticks.map((t) => `${+t.toFixed(4)} s`) }, { ...axis, size: 52 }],
      series: [{}, ...series.map((each) => ({ width: 1.4, points: { show: false }, ...each.style }))],
      hooks: {
        draw: options.draw ? [options.draw] : [],
        setScale: [(self, key) => {
          if (key !== 'x') return;
          mark(self);
          if (zooming) return;
          zooming = true;
          const { min, max } = self.scales.x;
          for (const other of plots) if (other.u !== self) other.u.setScale('x', { min, max });
          zooming = false;
        }],
      },
    }, joined, box);
    const now = u.over.appendChild(element('div', null, 'now'));
    u.now = now;
    let pressed = 0;
    u.over.addEventListener('mousedown', (event) => { pressed = event.offsetX; });
    u.over.addEventListener('click', (event) => { if (Math.abs(event.offsetX - pressed) < 3) setTime(u.posToVal(event.offsetX, 'x')); });
    u.over.addEventListener('dblclick', () => u.setScale('x', { min: first, max: last }));
    plots.push({ u, box, perJoint: Boolean(options.perJoint) });
    u.setScale('x', { min: first, max: last });
  }
  function mark(u) {
    if (!u.now) return;
    const left = u.valToPos(time, 'x');
    u.now.style.left = `${left}px`;
    u.now.style.display = left < 0 || left > u.over.clientWidth ? 'none' : 'block';
  }
  const jointSeries = (values) => runs.flatMap((run, r) => joints.map((_, j) => ({
    x: run.at, y: values(run)[j], style: { stroke: colours[j % colours.length], dash: r ? [5, 4] : undefined, width: r ? 1.1 : 1.4 },
  })));
  const PAPER_WIDTH = 660; // between the margins of A4 and Letter, CSS pixels
  let time = first;
  const measured = runs.every((run) => run.figures.velocities === 'measured');
  addPlot('Position', `${per('')} · ${compare ? 'dashed: B · dots: points of the plans' : 'dots: points of the plan'}`, jointSeries((run) => run.q), { perJoint: true, height: 200, draw: drawPlans, y: { range: withPlans } });
  addPlot('Velocity', `${per('/s')} · ${measured ? 'measured' : 'from the positions'}`, jointSeries((run) => run.v), { perJoint: true });
  addPlot('Acceleration', `${per('/s²')} · from the positions`, jointSeries((run) => run.a), { perJoint: true });
  if (runs.some((run) => run.plans.length)) addPlot('Deviation from the plan', `${per('')} · measured − planned, with the plan starting at the first motion`, jointSeries((run) => run.error), { perJoint: true, height: 130 });
  addPlot('Interval between joint states', 'ms', runs.map((run, r) => ({ x: run.gaps.map((gap) => gap[0] - run.shift), y: run.gaps.map((gap) => gap[1]), style: { stroke: RUN_COLOURS[r], width: 1 } })), { height: 110, y: { range: (_, low, high) => [0, Math.max(high * 1.1, 1)] } });
  if (runs.some((run) => run.replies.length)) addPlot('Reply latency', 'ms', runs.map((run, r) => ({
    x: run.replies.map((each) => each[0] - run.shift), y: run.replies.map((each) => each[1] * 1e3),
    style: { stroke: RUN_COLOURS[r], width: 0, paths: () => null, points: { show: true, size: 5, stroke: RUN_COLOURS[r], fill: `${RUN_COLOURS[r]}55` } },
  })), { height: 110, y: { range: (_, low, high) => [0, Math.max((high || 0) * 1.1, 1)] } });
  const sizePlots = (width) => { for (const { u, box } of plots) u.setSize({ width: width || box.clientWidth - 16, height: u.height }); };
  new ResizeObserver(() => { sizePlots(); drawLanes(); }).observe($('plots'));
  addEventListener('beforeprint', () => sizePlots(PAPER_WIDTH));
  addEventListener('afterprint', () => sizePlots());

  // --- time ---------------------------------------------------------------------------------------

  const LANES = [['drives_powered', 'motors', '#1c9a5b', '#e7b45c'], ['e_stopped', 'E-stop', '#d5342b', '#1c9a5b24'], ['in_error', 'error', '#d5342b', '#1c9a5b24'], ['in_motion', 'motion', '#2272c3', '#2272c324']];
  const LEFT = 46;
  $('lanes').style.height = `${10 + LANES.length * (compare ? 16 : 11)}px`;
  function drawLanes() {
    const canvas = $('lanes'), ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const ctx = canvas.getContext('2d');
    ctx.scale(ratio, ratio);
    const x = (t) => LEFT + 8 + (width - LEFT - 16) * (t - first) / (last - first);
    const rows = LANES.length * runs.length, each = (height - 8) / rows;
    runs.forEach((run, r) => LANES.forEach(([flag, name, on, off], l) => {
      const top = (l * runs.length + r) * each;
      run.conditions.forEach((condition, k) => {
        const from = x(condition[0] - run.shift), next = run.conditions[k + 1];
        const to = x(next ? next[0] - run.shift : Math.min(last, run.figures.duration_s - run.shift));
        const value = tri(condition, flag);
        ctx.fillStyle = value === 1 ? on : value === 0 ? off : '#8795a344';
        ctx.fillRect(from, top + 1, Math.max(to - from, 0.7), each - 1.5);
      });
      if (r === 0) {
        ctx.fillStyle = '#74818e';
        ctx.font = '10px system-ui, sans-serif';
        ctx.fillText(name, 0, top + each * runs.length / 2 + 4);
      }
    }));
    for (const event of events) {
      ctx.fillStyle = { error: '#d5342b', warning: '#e08a00', info: '#8795a3' }[event.level];
      ctx.fillRect(x(event.at) - 0.75, height - 7, 1.5, 7);
    }
    ctx.fillStyle = getComputedStyle(document.body).color;
    ctx.fillRect(x(time) - 0.75, 0, 1.5, height);
  }
  $('lanes').addEventListener('click', (event) => setTime(first + (last - first) * (event.offsetX - LEFT - 8) / ($('lanes').clientWidth - LEFT - 16)));
  const slider = $('time');
  slider.min = first;
  slider.max = last;
  slider.step = Math.min(0.01, (last - first) / 1000) || 0.01;
  slider.addEventListener('input', () => setTime(Number(slider.value)));

  function setTime(target) {
    time = Math.min(Math.max(target, first), last);
    slider.value = time;
    $('clock').textContent = `${time.toFixed(3)} s`;
    if (view) view.set(time);
    showNumbers(time);
    for (const { u } of plots) mark(u);
    drawLanes();
  }
  let playing = null;
  function play() {
    if (playing !== null) {
      playing = null;
      $('play').textContent = '▶';
      return;
    }
    if (time >= last) setTime(first);
    playing = performance.now();
    $('play').textContent = '❚❚';
    requestAnimationFrame(function step(now) {
      if (playing === null) return;
      setTime(time + Math.max(now - playing, 0) / 1e3 * Number($('speed').value));
      playing = now;
      if (time >= last) play(); else requestAnimationFrame(step);
    });
  }
  $('play').addEventListener('click', play);
  const start = runs[0].figures.motions.find((each) => each.began_s !== null);
  setTime(start ? start.began_s - runs[0].shift + start.moved_s * 0.4 : first);
  document.body.dataset.ready = 'yes';
})();
