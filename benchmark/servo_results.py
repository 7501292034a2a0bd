# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The figures of the benchmark of streams: a file, a table, a picture."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

FIGURES, REPORT = 'servo.json', 'servo.md'

WORDS = """Written by `python -m benchmark.servo`: through ROS, the driver, TCP and the simulated
controller, a process each; `servo.scale` 0.25, 4 ms of jitter, 2 % of the messages lost.

* **lag**: the delay with which what was sent is nearest to the measured joint states; **rms**:
  what is left then. Steps and the corners of a ramp are followed by no arm, so their rms is large.
* **speed**: of the joint that was fastest, as a share of its velocity limit."""

DROPOUTS = """A stream of positions, a sine, falls silent for good. **rest**: the arm stands so
much later; **past**: how far joint 1 went past the last setpoint."""


@dataclass(frozen=True)
class Lag:
    """How the arm followed one stream: lag in s, rms in rad, speed as a share of the limit."""

    controller: str
    wave: str
    stream: str
    rate: float
    lag: float
    rms: float
    speed: float


@dataclass(frozen=True)
class Dropout:
    """How the arm came to rest when a stream fell silent: times in s, past and beyond in rad."""

    controller: str
    at: float
    rest: float
    past: float
    beyond: float
    speed: float
    inside: bool


@dataclass(frozen=True)
class Trace:
    """Ways of joint 1 over time, rad: what was sent, and where it was."""

    controller: str
    times: list[float]
    sent: list[float]
    followed: list[float]


@dataclass(frozen=True)
class Results:
    """All of one run."""

    lags: list[Lag]
    dropouts: list[Dropout]
    traces: list[Trace]


def line(lag: Lag) -> str:
    """Return a row of the table."""
    return (
        f'| {lag.controller} | {lag.wave} | {lag.stream} | {lag.rate:g} | {lag.lag * 1e3:.0f} | '
        f'{lag.rms * 1e3:.0f} | {lag.speed:.2f} |'
    )


def dropout_line(dropout: Dropout) -> str:
    """Return a row of the table of dropouts."""
    return (
        f'| {dropout.controller} | {dropout.at:g} | {dropout.rest * 1e3:.0f} | '
        f'{dropout.past * 1e3:.0f} | {dropout.beyond * 1e3:.0f} | {dropout.speed:.2f} | '
        f'{"yes" if dropout.inside else "NO"} |'
    )


def report(results: Results) -> str:
    """Return the figures as Markdown."""
    rows = [
        '# Streams of setpoints',
        '',
        WORDS,
        '',
        '| controller | wave | stream | rate, Hz | lag, ms | rms, mrad | speed |',
        '|---|---|---|---|---|---|---|',
        *map(line, results.lags),
        '',
        '## Dropouts',
        '',
        DROPOUTS,
        '',
        '| controller | silent at, s | rest, ms | past, mrad | beyond, mrad | speed | in range |',
        '|---|---|---|---|---|---|---|',
        *map(dropout_line, results.dropouts),
    ]
    return '\n'.join(rows) + '\n'


def write(results: Results, folder: Path, picture: Path) -> None:
    """Write the figures, and what is made of them."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(_rounded(asdict(results)), indent=1, allow_nan=False)
    (folder / FIGURES).write_text(text + '\n', encoding='utf-8')
    render(read(folder), folder, picture)


def read(folder: Path) -> Results:
    """Return the figures of a folder."""
    data = json.loads((folder / FIGURES).read_text(encoding='utf-8'))
    return Results(
        [Lag(**each) for each in data['lags']],
        [Dropout(**each) for each in data['dropouts']],
        [Trace(**each) for each in data['traces']],
    )


def render(results: Results, folder: Path, picture: Path) -> None:
    """Write the report and the picture."""
    (folder / REPORT).write_text(report(results), encoding='utf-8')
    draw(results, picture)


def draw(results: Results, path: Path) -> None:
    """Draw a stream and how it was followed, and the lag of every kind of stream."""
    import matplotlib as mpl  # here, so that reading the figures needs none

    mpl.use('Agg')
    import matplotlib.pyplot as plt

    kinds = list(dict.fromkeys(lag.controller for lag in results.lags))
    colours = {kind: f'C{index}' for index, kind in enumerate(kinds)}
    figure, (way, bars) = plt.subplots(
        2, 1, figsize=(9.0, 7.2), height_ratios=(3.0, 4.0), layout='constrained'
    )
    for index, trace in enumerate(results.traces):
        if index == 0:
            way.plot(trace.times, trace.sent, color='black', linewidth=1.0, label='sent')
        colour = colours[trace.controller]
        way.plot(trace.times, trace.followed, color=colour, label=trace.controller)
    way.set_title('Positions at 50 Hz, jitter 4 ms, 2 % lost: joint 1')
    way.set_xlabel('time, s')
    way.set_ylabel('way, rad')
    way.grid(alpha=0.3)
    way.legend(fontsize=8, ncols=4, loc='upper center')
    way.set_ylim(top=way.get_ylim()[1] * 1.35)

    rows = list(dict.fromkeys((lag.wave, lag.stream, lag.rate) for lag in results.lags))
    height = 0.8 / len(kinds)
    for lag in results.lags:
        row = rows.index((lag.wave, lag.stream, lag.rate))
        y = row + (kinds.index(lag.controller) - (len(kinds) - 1) / 2.0) * height
        bars.barh(y, lag.lag * 1e3, height * 0.9, color=colours[lag.controller])
    names = [f'{wave}, {stream}, {rate:g} Hz' for wave, stream, rate in rows]
    bars.set_yticks(range(len(rows)), names, fontsize=8)
    bars.invert_yaxis()
    bars.set_title('Lag')
    bars.set_xlabel('ms')
    bars.grid(alpha=0.3, axis='x')
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _rounded(value: object) -> object:
    """Return the same with numbers of five digits."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f'{value:.5g}') if isinstance(value, float) else value
