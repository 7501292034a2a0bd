# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The figures of docs/reliability.md as pictures."""

import json
import math
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use('Agg')
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from benchmark.reliability_page import FAULTS, SOAK

Figures = dict[str, Any]

QUICK_S, SLOW_S = 0.02, 5.0
"""Ends of the colours' scale, s."""


def faults(folder: Path) -> None:
    """Draw how long it takes until the arm stands, and until it is ready again."""
    cells = json.loads((folder / FAULTS).read_text(encoding='utf-8'))['cells']
    failed = sum(bool(cell['failure']) for cell in cells)
    names = list(dict.fromkeys(cell['fault'] for cell in cells))
    columns = list(dict.fromkeys(_column(cell) for cell in cells))
    figure, axes = plt.subplots(1, 2, figsize=(15, 5.6), sharey=True, layout='constrained')
    held = 'in every one all invariants held' if not failed else f'{failed} FAILED'
    figure.suptitle(
        f'{len(cells)} times a fault struck, in five phases of a motion: {held}', fontsize=15
    )
    _heat(axes[0], cells, names, columns, 'rest', 'Seconds until the arm stood (the longest)')
    image = _heat(
        axes[1], cells, names, columns, 'recovery', 'Seconds until it was ready again, once mended'
    )
    axes[0].set_yticks(range(len(names)), [name.replace('_', ' ') for name in names], fontsize=11)
    figure.supxlabel('grey: there is no such case, or it was not run', fontsize=9, x=0.9)
    bar = figure.colorbar(image, ax=axes, shrink=0.8, ticks=(0.02, 0.1, 0.5, 2.0, 5.0))
    bar.ax.set_yticklabels(['0.02 s', '0.1 s', '0.5 s', '2 s', '5 s'])
    figure.savefig(folder / 'faults.png', dpi=90)
    plt.close(figure)


def _column(cell: Figures) -> str:
    interface = cell['interface']
    return str(cell['profile'] if interface == 'usual' else f'{cell["profile"]}, {interface}')


def _heat(
    axes: Axes, cells: list[Figures], names: list[str], columns: list[str], key: str, title: str
) -> Any:
    """Draw the longest time of all phases: a row for each fault, a column for each controller."""
    rows = []
    for y, name in enumerate(names):
        row = []
        for x, column in enumerate(columns):
            found = [c for c in cells if c['fault'] == name and _column(c) == column]
            if any(cell['failure'] for cell in found):
                axes.text(x, y, '✗', ha='center', va='center', fontsize=16, color='red')
                row.append(math.nan)
                continue
            longest = max((cell[key] for cell in found), default=math.nan)
            row.append(max(longest, QUICK_S))
            if found:
                dark = longest > 0.5
                axes.text(
                    x, y, f'{longest:.2g}' if longest >= 0.01 else '0',
                    ha='center', va='center', fontsize=8, color='white' if dark else 'black',
                )  # fmt: skip
        rows.append(row)
    image = axes.imshow(rows, cmap='YlGnBu', norm=LogNorm(QUICK_S, SLOW_S), aspect='auto')
    axes.set_xticks(range(len(columns)), columns, rotation=50, ha='right', fontsize=9)
    axes.set_title(title, fontsize=12)
    axes.set_facecolor('0.92')
    return image


def soak(folder: Path) -> None:
    """Draw memory, what else the process has open, and the goals, over the time."""
    figures = json.loads((folder / SOAK).read_text(encoding='utf-8'))
    samples = figures['samples']
    minutes = [each['seconds'] / 60.0 for each in samples]
    figure, (memory, counts, goals) = plt.subplots(
        3, 1, figsize=(9, 7.5), sharex=True, layout='constrained', height_ratios=(3, 3, 2)
    )
    bad = len(figures['problems'])
    told = 'all ended once, with the true outcome' if not bad else f'{bad} PROBLEMS'
    figure.suptitle(
        f'{figures["minutes"]:.0f} minutes, {figures["goals"]} goals: {told}', fontsize=14
    )
    for key, name in (('memory', 'driver'), ('controller_memory', 'simulated controller')):
        memory.plot(minutes, [each[key] / 1e6 for each in samples], label=name)
    memory.set_ylim(0.0, None)
    memory.set_ylabel('memory [MB]')
    memory.legend(loc='lower right')
    for key in ('descriptors', 'threads', 'tasks'):
        counts.plot(minutes, [each[key] for each in samples], label=key)
    counts.set_ylim(0.0, None)
    counts.set_ylabel("driver's …")
    counts.legend(loc='lower right')
    goals.plot(minutes, [each['goals'] for each in samples], color='tab:green')
    goals.set_ylabel('goals ended')
    goals.set_xlabel('minutes')
    for axis in (memory, counts, goals):
        axis.grid(alpha=0.3)
    figure.savefig(folder / 'soak.png', dpi=90)
    plt.close(figure)
