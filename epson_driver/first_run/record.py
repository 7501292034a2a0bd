# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The HTML page with the results of a first run, and with the data for a similar simulation.

The page is HTML without scripts. It contains the data as JSON, and the wire traces as links.
"""

import base64
import html
import json
import re
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.doctor.learning import differences, profile_text
from epson_driver.first_run.steps import StepResult
from epson_driver.first_run.trial_move import FIRST_DURATION_S
from epson_driver.inputs import InputError, choice, number, printable, read_file, write_file
from epson_driver.profiles import ControllerProfile, load_controller_profile
from epson_driver.profiles.profile_rules import RULES
from epson_driver.sim_controller.faults.fault_kinds import Fault, parse

DONE, SKIPPED, FAILED = 'done', 'skipped', 'failed'

VERSION = 1
MAX_FILE_BYTES = 500_000_000

START_S = {False: 0.1257, True: 0.0336}
"""Time from sending a point to the first motion, s, in the simulated controller without servo lag.
The key is whether the arm rests at each point. If the time of a robot is longer, the simulated
controller delays its state messages.
"""

MIN_DELAY_S = 0.01
"""Minimum delay that is simulated, s. A shorter delay is within the measurement's scatter."""

_SECONDS = number(-1e6, 1e6, 's')
START_TIME = 'joint 1: point sent to motion seen'

_DATA = re.compile(r'<script type="application/json" id="first-run">(.*?)</script>', re.DOTALL)
_TRACE = 'data:application/vnd.tcpdump.pcap;base64,'

_STYLE = (
    'body{font:16px/1.5 system-ui,sans-serif;max-width:60em;margin:2em auto;padding:0 1em;'
    'color-scheme:light dark}table{border-collapse:collapse}td,th{border:1px solid #8888;'
    'padding:.2em .6em;text-align:left;overflow-wrap:anywhere}.habit{font-weight:600}'
)


@dataclass
class Entry:
    """The outcome of a step: done, skipped or failed (with the reason), date and results."""

    state: str
    at: str
    found: StepResult = field(default_factory=StepResult)
    why: str = ''
    trace: str = ''


@dataclass
class FirstRunRecord:
    about: dict[str, str]  # descriptions of the robot and the software
    entries: dict[str, Entry] = field(default_factory=dict)  # by step name
    name: str = field(default='first-run', compare=False)  # name of the file

    @property
    def facts(self) -> dict[str, Any]:
        """The latest facts of all steps: profile key, or additional key → value."""
        return self._all('facts')

    @property
    def times(self) -> dict[str, float]:
        return self._all('times')

    @property
    def habits(self) -> list[str]:
        """Sentences about unusual behaviour of the robot.

        The sentences from the steps are followed by the differences from the profile.
        """
        report = [habit for entry in self.entries.values() for habit in entry.found.habits]
        profile = load_controller_profile(self.about['controller'])
        known = {key: value for key, value in self.facts.items() if key in RULES or key == 'io'}
        moves_through = not self.facts.get('rests at points')
        for key, value, expected in differences(known, profile):
            if expected == 'default' and value == 'taken' and moves_through:
                continue
            shown = f'{value:.4g}' if isinstance(value, float) else value
            report.append(f'{key} is {shown}, but {expected} in the profile {profile.name}')
        return list(dict.fromkeys(report))

    def _all(self, name: str) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for entry in self.entries.values():
            result |= getattr(entry.found, name)
        return result

    def save(self, path: Path) -> None:
        write_file(path, ''.join(_page(self)))


def load(path: Path) -> FirstRunRecord:
    name = printable(path)
    content = read_file(path, MAX_FILE_BYTES)
    try:
        result = _DATA.search(content.decode())
        if result is None:
            raise ValueError('the record of the first run is missing')
        data = json.loads(result[1])
        choice(VERSION).checked(data['version'], 'version')
        about = {str(key): str(value) for key, value in data['about'].items()}
        entries = {step: _entry(step, item) for step, item in data['entries'].items()}
        if not {'controller', 'robot', 'address', 'when'} <= about.keys():
            raise ValueError('controller, robot, address or date is missing')
    except KeyError as error:
        raise InputError(
            f'{name}: must be a file written by `epson_driver first_run`: {error} is missing'
        ) from error
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(
            f'{name}: must be a file written by `epson_driver first_run`: {printable(error)}'
        ) from error
    return FirstRunRecord(about, entries, name)


def _entry(step: str, data: Mapping[str, Any]) -> Entry:
    result = StepResult(**data['found'])
    own = {'reply delay', 'lateness'} & result.facts.keys()
    times = result.times | {key: result.facts[key] for key in own}
    for key, value in times.items():
        _SECONDS.checked(value, f'{step}: {key}')
    flat = {**result.facts, **result.facts.get('io', {}), 'io': 0}
    if not all(isinstance(item, str | int | float) for item in flat.values()):
        raise TypeError(f'{step}: each fact must be a string, a number, true or false')
    state = choice(DONE, SKIPPED, FAILED).checked(data['state'], step)
    at, why, trace = texts = [data[key] for key in ('at', 'why', 'trace')]
    if not all(
        isinstance(item, str) for item in (*texts, *result.answers.values(), *result.habits)
    ):
        raise TypeError(f'{step}: date, reason, trace, answers and habits must be strings')
    base64.b64decode(trace, validate=True)
    return Entry(state, at, result, why, trace)


@dataclass(frozen=True)
class ReplicaSettings:
    """Settings of a simulated controller that behaves like the robot."""

    robot: str
    profile: ControllerProfile
    motion: str  # 'smooth', or 'ptp' for a stop at each point
    faults: tuple[Fault, ...]  # active from the start


def replica_settings(record: FirstRunRecord) -> ReplicaSettings:
    facts = record.facts
    stops = bool(facts.get('rests at points'))
    known = {key: value for key, value in facts.items() if key in RULES or key == 'io'}
    about = f'first-run, {record.about["address"]}, {record.about["when"]}'
    text = profile_text('first_run', known, record.about['controller'], about)
    with tempfile.TemporaryDirectory(prefix='epson_driver_first_run_') as folder:
        path = Path(folder, 'first_run.yaml')
        write_file(path, text)
        try:
            profile = load_controller_profile(str(path))
        except InputError as error:
            raise InputError(f'{record.name}: {error}'.replace(f'{path}: ', '')) from error
    replies = float(facts.get('reply delay', 0.0))
    late = {'motion': replies, 'state': _state_delay(record, profile, replies, stops)}
    faults = [
        parse(f'delay:seconds={min(delay, 60.0):.4f},port={port}')
        for port, delay in late.items()
        if delay > MIN_DELAY_S
    ]
    return ReplicaSettings(
        record.about['robot'], profile, 'ptp' if stops else 'smooth', tuple(faults)
    )


def _state_delay(
    record: FirstRunRecord, profile: ControllerProfile, replies: float, stops: bool
) -> float:
    """Return the extra delay of state messages, s, compared with the simulated controller.

    `replies`: delay of the controller's replies, s. `stops`: whether the arm stops at each point.
    If the robot's servo lag is longer than in the profile, the difference is included, because it
    has the same effect.
    """
    start = record.times.get(START_TIME)
    if start is None or profile.spel.project:
        return 0.0
    early = 0.0 if stops else min(replies, FIRST_DURATION_S)  # the first point has ended
    late = start - (START_S[stops] + profile.servo.lag - early)
    return late if late > float(record.facts.get('lateness', 0.0)) else 0.0


def _page(record: FirstRunRecord) -> Iterator[str]:
    title = f'First run of {record.about["robot"]} at {record.about["address"]}'
    yield f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><title>{_text(title)}</title>\n'
    policy = "default-src 'none'; style-src 'unsafe-inline'"
    yield f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
    yield '<meta name="viewport" content="width=device-width">\n'
    yield f'<style>{_STYLE}</style>\n<h1>{_text(title)}</h1>\n'
    yield from _table('Robot', record.about)
    yield '<h2>Differences from the profile</h2>\n'
    if habits := record.habits:
        yield (
            '<ul>'
            + ''.join(f'<li class="habit">{_text(habit)}</li>\n' for habit in habits)
            + '</ul>'
        )
    else:
        yield f'<p>None: it behaves like the profile {_text(record.about["controller"])}.</p>\n'
    yield from _table(
        'Times', {key: f'{value * 1e3:.1f} ms' for key, value in record.times.items()}
    )
    yield '<h2>Steps</h2>\n'
    for name, entry in record.entries.items():
        why = f': {entry.why}' if entry.why else ''
        yield f'<h3>{_text(name)}</h3>\n'
        yield f'<p>{_text(entry.state)}, {_text(entry.at)}{_text(why)}</p>\n'
        yield from _table('', entry.found.facts | entry.found.answers)
        if entry.trace:
            file = f'{name.replace(" ", "_").replace("/", "")}.pcap'
            link = (
                f'<a download="{_text(file)}" href="{_TRACE}{_text(entry.trace)}">wire trace</a>'
            )
            yield f'<p>{link} (Wireshark, <code>epson_driver report</code>)</p>\n'
    data = {'version': VERSION, 'about': record.about}
    data |= {'entries': {name: asdict(element) for name, element in record.entries.items()}}
    text = json.dumps(data, default=np.generic.item).replace('<', '\\u003c')
    yield f'<script type="application/json" id="first-run">{text}</script>\n</html>\n'


def _table(title: str, rows: Mapping[str, object]) -> Iterator[str]:
    if not rows:
        return
    if title:
        yield f'<h2>{title}</h2>\n'
    yield '<table>\n'
    for key, value in rows.items():
        yield f'<tr><th>{_text(key)}</th><td>{_text(value)}</td></tr>\n'
    yield '</table>\n'


def _text(value: object) -> str:
    return html.escape(printable(str(value)))


def packed(trace: bytes) -> str:
    return base64.b64encode(trace).decode('ascii')
