# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The figures of `performance.py` as tables and as a picture."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

BEGIN, END = '<!-- figures: begin -->', '<!-- figures: end -->'
STAGES = {
    'socket': 'event loop and socket',
    'decode': 'frame and decode',
    'velocity': 'checks, time, velocity',
    'message': 'ROS message',
    'publish': 'publish',
}


@dataclass(frozen=True)
class Bar:
    """What is required of a figure, at most or at least. `value`: the median of `runs`."""

    name: str
    value: float
    required: float
    at_least: bool = False
    runs: tuple[float, ...] = ()

    @property
    def met(self) -> bool:
        """Whether it is so."""
        if self.at_least:
            return self.value >= self.required
        return self.value <= self.required

    @staticmethod
    def read(data: dict[str, Any]) -> 'Bar':
        """Return it as JSON has it."""
        return Bar(**data)


def medians(runs: Sequence[Sequence[Bar]]) -> list[Bar]:
    """Return what was found in several runs, one list of bars for each run, as medians."""
    found = []
    for bars in zip(*runs, strict=True):
        values = tuple(bar.value for bar in bars)
        found.append(replace(bars[-1], value=statistics.median(values), runs=values))
    return found


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table: text at the left, numbers at the right."""
    lines = [head, ['---'] + ['---:'] * (len(head) - 1), *rows]
    return '\n'.join('| ' + ' | '.join(line) + ' |' for line in lines) + '\n'


def report(data: dict[str, Any]) -> str:
    """Return all tables, with where and when it was measured."""
    parts = [
        newest(data),
        '**State path**: latency from the byte to the subscriber, CPU of the whole process\n',
        _state(data),
        '**State path, CPU of each stage per message**, us\n',
        _stages(data),
        '**Goals of any length, from the bytes of the request to the first message**\n',
        _lengths(data),
        '**Codec**, us\n',
        _codec(data),
    ]
    return '\n'.join(parts)


def newest(data: dict[str, Any]) -> str:
    """Return the tables that docs/reliability.md keeps."""
    machine = data['machine']
    load = ' and '.join(f'{value:.1f}' for value in machine['load'])
    parts = [
        f'{machine["date"]}, `{machine["command"]}`, {machine["took"]:.0f} s, '
        f'{machine["cores"]} cores of {machine["processor"]},\n'
        f'Python {machine["python"]}; load at begin and end {load}.\n',
        '**Required and found**, the median of the runs (what was missed: bold)\n',
        _bars(data),
        _highest(data),
        '**Motion path**\n',
        _motion(data),
    ]
    return '\n'.join(parts)


def _bars(data: dict[str, Any]) -> str:
    return table(
        ['', 'found', 'required'],
        [
            [
                bar.name,
                f'{bar.value:.2f} ×' if bar.met else f'**{bar.value:.2f} ×**',
                f'{"≥" if bar.at_least else "≤"} {bar.required:.2f} ×',
            ]
            for bar in map(Bar.read, data['bars'])
        ],
    )


def _state(data: dict[str, Any]) -> str:
    head = ['Hz', 'p50, us', 'floor', 'ratio', 'p99, us', 'floor', 'ratio']
    head += ['CPU, us', 'floor', 'ratio', 'lost']
    rows = []
    for rate in data['state']['rates']:
        row = [f'{rate["rate"]:g}']
        for name in ('p50', 'p99', 'cpu'):
            ours, floor = rate['ours'][name], rate['floor'][name]
            row += [f'{ours * 1e6:.0f}', f'{floor * 1e6:.0f}', f'{rate[name + "_ratio"]:.2f}']
        rows.append([*row, str(rate['ours']['lost'])])
    return table(head, rows)


def _highest(data: dict[str, Any]) -> str:
    floor, ours = data['state']['highest']
    return (
        f'Highest rate without loss: driver {ours:.0f} Hz, floor {floor:.0f} Hz '
        f'({ours / floor:.2f} ×).\n'
    )


def _stages(data: dict[str, Any]) -> str:
    stages = data['state']['stages']
    rows = [
        [text, f'{stages[name][1] * 1e6:.1f}', f'{stages[name][0] * 1e6:.1f}']
        for name, text in STAGES.items()
    ]
    sums = [sum(stages[name][place] for name in STAGES) * 1e6 for place in (1, 0)]
    rows.append(['sum', *(f'{value:.1f}' for value in sums)])
    return table(['stage', 'driver', 'floor'], rows)


def _motion(data: dict[str, Any]) -> str:
    trips, motion = data['round_trips'], data['motion']
    goal, download = motion['goal'], motion['download']
    rows = [
        ['bare asyncio streams, round trip', f'{trips["bare"] * 1e6:.0f} us', ''],
    ]
    for name, text in (
        ('link', 'a point by the link'),
        ('goal', 'a point of a goal'),
        ('ping', 'PING of the simulated controller'),
    ):
        ratio = f'{trips[name + "_ratio"]:.2f} ×'
        rows.append([f'{text}, round trip', f'{trips[name] * 1e6:.0f} us', ratio])
    rows += [
        [
            f'goal of {goal["points"]} points: accepted to first point',
            _ms(goal, 'first_point'),
            '',
        ],
        ['the same, to the first movement', _ms(goal, 'movement'), ''],
        [
            f'download of {download["points"]} points: accepted to last point',
            _ms(download, 'last_point'),
            '',
        ],
        ['the same, to the first movement', _ms(download, 'movement'), ''],
    ]
    for each in motion['lengths']:
        more = f'{each["memory"] / 1e6:.1f} MB more'
        text = f'goal of {each["points"]:,} points, the whole process: accepted to first point'
        rows.append([text, _ms(each, 'first_point'), more])
    return table(['', 'time', ''], rows)


def _ms(values: dict[str, Any], name: str) -> str:
    return f'{values[name] * 1e3:.1f} ms'


def _lengths(data: dict[str, Any]) -> str:
    head = ['points', 'rclpy', 'to arrays', 'checks', 'to the first message', 'memory']
    rows = []
    for row in data['goal_length']:
        times = [row[name] for name in ('message', 'arrays', 'checks', 'first')]
        rows.append(
            [f'{row["points"]:,}']
            + [f'{value * 1e3:.2f} ms' for value in times]
            + [f'{row["memory"] / 1e3:.0f} kB']
        )
    last = data['goal_length'][-1]
    each = [
        f'{last[name] / last["points"] * 1e9:.0f} ns' for name in ('message', 'arrays', 'checks')
    ]
    rows.append(['per point, of the longest', *each, '', ''])
    return table(head, rows)


def _codec(data: dict[str, Any]) -> str:
    rows = []
    for row in data['codec']:
        names = ('bare_encode', 'bare_decode', 'encode', 'decode')
        rows.append(
            [row['name']]
            + [f'{row[name] * 1e6:.2f}' for name in names]
            + [f'{row["ratio"]:.2f} ×', f'{(row["encode"] + row["decode"]) / row["barest"]:.1f} ×']
        )
    dribble = data['dribble']
    ratio = dribble['ours'] / dribble['bare']
    rows.append(
        [
            'byte by byte, per byte',
            '',
            f'{dribble["bare"] * 1e6:.2f}',
            '',
            f'{dribble["ours"] * 1e6:.2f}',
            f'{ratio:.2f} ×',
            '',
        ]
    )
    head = ['', 'struct: encode', 'decode', 'driver: encode', 'decode', 'ratio', 'to barest']
    return table(head, rows)


def docs_page(page: str, data: dict[str, Any]) -> str:
    """Return a page with the figures between its two marks."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f'{before}{BEGIN}\n{newest(data)}{END}{after}'


def picture(data: dict[str, Any], path: Path) -> None:
    """Draw the ratios beside what is required, and what the stages of a state message cost."""
    import matplotlib as mpl

    mpl.use('Agg')
    import matplotlib.pyplot as plt

    bars = [bar for bar in map(Bar.read, data['bars']) if not bar.at_least]
    figure, (ratios, stages) = plt.subplots(
        1, 2, figsize=(13, 0.42 * len(bars) + 1.6), width_ratios=(3, 2), layout='constrained'
    )
    places = range(len(bars))
    colours = ['tab:green' if bar.met else 'tab:red' for bar in bars]
    ratios.barh(places, [bar.value for bar in bars], color=colours, height=0.6)
    for place, bar in zip(places, bars, strict=True):
        ratios.plot([bar.required] * 2, [place - 0.42, place + 0.42], color='black', linewidth=2)
        ratios.text(
            max(bar.value, bar.required) + 0.05, place, f'{bar.value:.2f}', va='center', fontsize=8
        )
    ratios.axvline(1.0, color='tab:gray', linewidth=0.8)
    ratios.set_yticks(places, [bar.name for bar in bars], fontsize=8)
    ratios.invert_yaxis()
    ratios.set_xlabel('driver / the program that does the least (black: at most so much)')
    ratios.set_title('As little as can be is 1')
    left = [0.0, 0.0]
    for name, text in STAGES.items():
        floor, ours = (value * 1e6 for value in data['state']['stages'][name])
        stages.barh(['driver', 'floor'], [ours, floor], left=left, label=text, height=0.5)
        left = [left[0] + ours, left[1] + floor]
    stages.set_xlabel('CPU, us per joint state')
    stages.set_title('What a joint state costs')
    stages.legend(fontsize=8, loc='upper center', bbox_to_anchor=(0.5, -0.15), ncols=2)
    figure.savefig(path, dpi=110)
    plt.close(figure)
