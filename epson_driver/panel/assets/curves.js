// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// The curves of the last 20 s, drawn with uPlot (`lib` of bundle.js).

export const COLOURS = ['#1971c2', '#e8590c', '#2f9e44', '#ae4fcb', '#e03131', '#0c8599', '#c77700', '#7a8591'];
const SPAN_S = 20, MIN_RANGE = 0.1;
const QUANTITIES = [['Position', ''], ['Velocity', '/s'], ['Plan − measured', '']];

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Curves {
  constructor(holder) {
    this.holder = holder;
    this.rows = [];
    this.plots = [];
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.build());
    new ResizeObserver(() => this.resize()).observe(holder);
    setInterval(() => this.draw(), 250);
  }

  setJoints(names, units) {
    this.names = names;
    this.units = units;
    this.rows = [];
    this.build();
  }

  setRows(rows) {
    this.rows = rows;
    this.changed = true;
  }

  add(row) {
    if (this.rows.length && row[0] <= this.rows[this.rows.length - 1][0]) return;
    this.rows.push(row);
    while (row[0] - this.rows[0][0] > SPAN_S) this.rows.shift();
    this.changed = true;
  }

  build() {
    for (const plot of this.plots) plot.destroy();
    this.plots = [];
    this.holder.replaceChildren();
    if (!this.names) return;
    const unit = [...new Set(this.units)].sort().join(', ');
    const axis = { font: '11px system-ui', stroke: css('--soft'), size: 22, ticks: { show: false }, grid: { stroke: css('--line'), width: 1 } };
    QUANTITIES.forEach(([title, per]) => {
      const box = document.createElement('div');
      box.className = 'plot';
      const head = box.appendChild(document.createElement('h3'));
      head.textContent = `${title} [${unit.split(', ').map((each) => each + per).join(', ')}]`;
      this.holder.append(box);
      this.plots.push(new lib.uPlot({
        width: this.width(), height: this.height(),
        scales: { x: { time: false, range: [-SPAN_S, 0] }, y: { range: (_, low, high) => [Math.min(low ?? 0, -MIN_RANGE) * 1.05, Math.max(high ?? 0, MIN_RANGE) * 1.05] } },
        axes: [{ ...axis, values: (_, ticks) => ticks.map((t) => (t ? `${t} s` : 'now')) }, { ...axis, size: 44, space: 18 }],
        cursor: { drag: { x: false, y: false } },
        series: [{}, ...this.names.map((name, j) => ({ label: name, stroke: COLOURS[j % COLOURS.length], width: 1.5, spanGaps: false,
          value: (_, value) => (value === null || value === undefined ? '–' : value.toFixed(1)) }))],
        padding: [6, 10, 0, 0],
      }, this.data(this.plots.length + 1), box));
    });
    this.changed = true;
  }

  data(quantity) {
    const now = this.rows.length ? this.rows[this.rows.length - 1][0] : 0;
    return [this.rows.map((row) => row[0] - now), ...this.names.map((_, j) => this.rows.map((row) => (row[quantity] ? row[quantity][j] : null)))];
  }

  draw() {
    if (!this.changed || !this.names || document.hidden) return;
    this.changed = false;
    this.plots.forEach((plot, i) => {
      plot.setData(this.data(i + 1));
      if (plot.cursor.idx === null || plot.cursor.left < 0) plot.setLegend({ idx: this.rows.length - 1 }, false);
    });
  }

  width() {
    return Math.max(120, this.holder.clientWidth - 20);
  }

  height() {
    return innerHeight > 850 ? 104 : 78;
  }

  resize() {
    for (const plot of this.plots) plot.setSize({ width: this.width(), height: this.height() });
  }
}
