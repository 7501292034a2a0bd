# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The benchmark's figures as pictures."""

from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from benchmark.cases import Case

OPTIMAL = {
    'time-optimal, all known': ('tab:blue', 'o'),
    'time-optimal, 3·A/J known': ('tab:cyan', 's'),
}
TIMED = {
    'time-preserving, all known': ('tab:blue', 'o'),
    'time-preserving, 3·A/J known': ('tab:cyan', 's'),
}
REQUIRED, GOAL = 'tab:red', 'tab:green'
BELOW = {'loc': 'upper center', 'fontsize': 8, 'ncols': 2, 'bbox_to_anchor': (0.5, -0.06)}
MARGIN = 1.01
"""Where figures stand beside an axis, as a share of its width."""


def overview(cases: list[Case], path: Path) -> None:
    """Draw the times per trajectory and the use of the limits per strategy."""
    height = 1.6 + 0.21 * len(cases)
    figure, ((times, commands), (accelerations, jerks)) = plt.subplots(
        2,
        2,
        figsize=(13, height + 4.6),
        height_ratios=(height, 4.0),
        sharey='row',
        layout='constrained',
    )
    _times(times, cases)
    _commands(commands, cases)
    times.set_yticks(range(len(cases)), [f'{case.name}, {case.limits}' for case in cases])
    times.set_ylim(len(cases) - 0.4, -0.6)
    rows = _uses(accelerations, cases, 'acceleration', 1.0)
    _uses(jerks, cases, 'jerk', 1.02)
    accelerations.set_yticks(range(len(rows)), rows)
    accelerations.set_ylim(len(rows) - 0.4, -0.6)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _times(axes: Axes, cases: list[Case]) -> None:
    axes.set_title(
        'As fast as possible: time / optimum within all limits\n'
        '(at the right: of stopping at every point)'
    )
    bounds = [(case.references.toppra / case.references.opt, y) for y, case in enumerate(cases)]
    _dots(axes, bounds, 'tab:gray', '|', 'TOPP-RA (no jerk limit)')
    for y, case in enumerate(cases):
        _beside(axes, y, f'{case.references.ptp / case.references.opt:.1f}')
    for name, (colour, marker) in OPTIMAL.items():
        found = [
            (case.strategies[name].duration / case.references.opt, y)
            for y, case in enumerate(cases)
            if name in case.strategies
        ]
        _dots(axes, found, colour, marker, name)
    axes.axvline(1.0, color='black', linewidth=0.6)
    axes.axvline(1.35, color=REQUIRED, linewidth=1, label='required: 1.35')
    axes.axvline(1.10, color=GOAL, linewidth=1, linestyle='--', label='goal: 1.1')
    axes.set_xlabel('time / optimum')
    axes.grid(alpha=0.3)
    axes.legend(**BELOW)


def _commands(axes: Axes, cases: list[Case]) -> None:
    axes.set_title('Keeping the commanded times: time / commanded time\n')
    timed = [(y, case, case.commanded) for y, case in enumerate(cases) if case.commanded]
    optima = [(case.references.spline / commanded, y) for y, case, commanded in timed]
    _dots(axes, optima, 'tab:gray', '|', 'optimum')
    for name, (colour, marker) in TIMED.items():
        found = [
            (case.strategies[name].duration / commanded, y)
            for y, case, commanded in timed
            if name in case.strategies
        ]
        _dots(axes, found, colour, marker, name)
    for share, bound, colour in ((1.2, 1.2, 'tab:orange'), (1.5, 1.1, REQUIRED)):
        judged = [
            (bound, y)
            for y, case, commanded in timed
            if (commanded - case.rests) / case.references.spline >= share
            and not (share < 1.5 <= (commanded - case.rests) / case.references.spline)
        ]
        label = f'required: {bound:g} (from {share:g} · optimum on)'
        _dots(axes, judged, colour, '|', label)
    for y, case in enumerate(cases):
        if not case.commanded:
            axes.text(1.05, y, 'came without times', va='center', fontsize=8, color='tab:gray')
    axes.axvline(1.0, color='black', linewidth=0.6)
    axes.set_xscale('log')
    axes.set_xticks([0.25, 0.5, 1, 2, 4], ['0.25', '0.5', '1', '2', '4'])
    axes.minorticks_off()
    axes.set_xlabel('time / commanded time')
    axes.grid(alpha=0.3)
    axes.legend(**BELOW)


def _uses(axes: Axes, cases: list[Case], quantity: str, required: float) -> list[str]:
    """Draw the largest use of a limit, a dot per trajectory; return the strategies drawn."""
    rows: dict[str, list[float]] = {}
    for case in cases:
        for name, spline in case.splines.items():
            rows.setdefault(f'spline in time, {name}', []).append(getattr(spline, quantity))
    for case in cases:
        for name, metrics in case.strategies.items():
            rows.setdefault(name, []).append(getattr(metrics, quantity))
    for y, (name, values) in enumerate(rows.items()):
        colour = 'tab:orange' if name.startswith('spline') else 'tab:blue'
        axes.plot(values, [y] * len(values), '.', alpha=0.5, color=colour)
        _beside(axes, y, f'{max(values):.3f}' if max(values) < 10.0 else f'{max(values):.0f}')
    axes.axvline(required, color=REQUIRED, linewidth=1, label=f'required: {required:g}')
    axes.set_xscale('log')
    axes.set_xlabel(f'largest {quantity} / limit of each trajectory (right: of all)')
    axes.set_title(f'Use of the {quantity} limit, sampled at 1 kHz')
    axes.grid(alpha=0.3)
    axes.legend(loc='lower right', fontsize=8)
    return list(rows)


def _beside(axes: Axes, y: int, text: str) -> None:
    """Write at the right of the axes."""
    axes.text(MARGIN, y, text, va='center', fontsize=8, transform=axes.get_yaxis_transform())


def _dots(
    axes: Axes, found: list[tuple[float, int]], colour: str, marker: str, label: str
) -> None:
    if found:
        xs, ys = zip(*found, strict=True)
        axes.plot(xs, ys, marker, color=colour, label=label, markersize=9 if marker == '|' else 5)
