# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Writes a report as one self-contained HTML file, whose security policy blocks all requests."""

import base64
import hashlib
import html
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.inputs import write_file
from epson_driver.motion import Array
from epson_driver.pages import asset, packed_arm, text
from epson_driver.report.figures import Figures, as_json
from epson_driver.report.run import FLAGS, Condition, Run
from epson_driver.report.smooth_study import COLOURS
from epson_driver.robots import RobotModel

MAX_SAMPLES = 15_000
"""Maximum number of joint states in a page, for all runs together. If a recording has more joint
states, the page shows a subset."""

MAX_EVENTS = 2000  # maximum number of events in a page: the JSON file has all of them
MAX_PLAN_POINTS = 4000  # maximum number of points drawn of each plan


def write_report(runs: Sequence[tuple[Run, Figures]], model: RobotModel, output: Path) -> None:
    """Write the page, and the measured values as a JSON file next to it. Print both paths."""
    write_file(output, page(runs, model))
    figures = output.with_suffix('.json')
    content = [as_json(run, numbers, run.events, model) for run, numbers in runs]
    result = json.dumps(content[0] if len(content) == 1 else content, indent=1, allow_nan=False)
    write_file(figures, result + '\n')
    print(f'report: {output}\nmeasured values: {figures}')


def page(runs: Sequence[tuple[Run, Figures]], model: RobotModel) -> str:
    data = {
        'arm': packed_arm(model),
        'model': model.name,
        'description': model.description,
        'units': list(model.limits.units),
        'limits': {
            'low': model.limits.position_min.tolist(),
            'high': model.limits.position_max.tolist(),
            'velocity': model.limits.velocity.tolist(),
            'acceleration': model.limits.acceleration.tolist(),
        },
        'colours': COLOURS,
        'flags': FLAGS,
        'runs': [_run(run, numbers, model, len(runs)) for run, numbers in runs],
    }
    assets = files('epson_driver.report').joinpath('assets')
    own, more = (
        assets.joinpath(name).read_text(encoding='utf-8') for name in ('page.js', 'page.css')
    )
    scripts, style = (asset('bundle.js'), asset('arm.js'), own), asset('bundle.css') + more
    allowed = ' '.join(_hash(script) for script in scripts)
    policy = (
        f"default-src 'none'; script-src {allowed}; style-src {_hash(style)}; "
        "base-uri 'none'; form-action 'none'"
    )
    title = html.escape(' and '.join(run.source for run, _ in runs))
    inert = json.dumps(data, allow_nan=False, separators=(',', ':')).replace('<', '\\u003c')
    code = ''.join(f'<script>{script}</script>\n' for script in scripts)
    body = assets.joinpath('page.html').read_text(encoding='utf-8')
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f'<title>{title}: run report</title>\n<style>{style}</style>\n</head>\n'
        f'<body>\n{body}\n<script id="data" type="application/json">{inert}</script>\n'
        f'{code}</body>\n</html>\n'
    )


def _hash(source: str) -> str:
    digest = hashlib.sha256(source.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def _run(run: Run, numbers: Figures, model: RobotModel, among: int) -> dict[str, Any]:
    stride = -(-len(run.times) // (MAX_SAMPLES // among))
    events = list(run.events)
    figures = as_json(run, numbers, events[:MAX_EVENTS], model)
    return {
        'figures': figures,
        'events_left_out': max(len(events) - MAX_EVENTS, 0),
        'stride': stride,
        'times': text(run.times[::stride].astype('<f4')),
        'positions': text(run.positions[::stride].astype('<f4')),
        'velocities': _scaled(numbers.velocities[::stride]),
        'accelerations': _scaled(numbers.accelerations[::stride]),
        'conditions': _changes(run.conditions),
        'links': [list(link) for link in run.links],
        'plans': [
            {
                'sent': plan.sent,
                'began': plan.sent if motion.began is None else motion.began,
                'times': text(plan.times[:: _every(plan.times)].astype('<f4')),
                'positions': text(plan.positions[:: _every(plan.times)].astype('<f4')),
            }
            for plan, motion in zip(run.plans, numbers.motions, strict=True)
        ],
        'gaps': _gaps(run.times),
        'replies': [[reply.time, reply.latency] for reply in run.replies[: MAX_SAMPLES // 5]],
    }


def _every(times: Array) -> int:
    return -(-len(times) // MAX_PLAN_POINTS)


def _scaled(values: Array) -> dict[str, Any]:
    """Return an array as 16-bit integers, with one scale for each column."""
    largest = np.abs(values).max(axis=0, initial=1e-9)
    return {
        'scale': (largest / 32767.0).tolist(),
        'values': text(np.round(values / largest * 32767.0).astype('<i2')),
    }


def _changes(conditions: Sequence[Condition]) -> list[list[Any]]:
    """Return time, flags, mode and errors of each condition that differs from its predecessor."""
    result: list[list[Any]] = []
    for condition in conditions:
        now = [list(condition.flags), condition.mode, list(condition.error_codes)]
        if not result or now != result[-1][1:]:
            result.append([condition.time, *now])
    return result


def _gaps(times: Array) -> list[list[float]]:
    """Return the time of each joint state, s, and the interval since the previous one, ms.

    A long run is divided into MAX_SAMPLES / 5 sections. Of each section, only the longest interval
    is returned.
    """
    if len(times) < 2:
        return []
    gaps = np.diff(times) * 1e3
    section = -(-len(gaps) // (MAX_SAMPLES // 5))
    starts = range(0, len(gaps), section)
    longest = [start + int(np.argmax(gaps[start : start + section])) for start in starts]
    return [[round(float(times[i + 1]), 4), round(float(gaps[i]), 2)] for i in longest]
