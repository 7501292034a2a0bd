# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The events of a world: a table of kinds, and the generation of event lists from a seed.

An event is drawn without knowledge of the world's state, so that a list can be shortened or varied
and played again. Goals are offsets from the arm's position, and publishers and ports have numbers.
"""

import zlib
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

Rng = np.random.Generator
Parameters = dict[str, Any]

MIN_EVENTS, MAX_EVENTS = 6, 50
JOINTS = 6

PUBLISHERS = 4
OUTPUTS = 3
CALM_FRACTION = 0.25
"""Fraction of worlds without failures."""

CLOCK_FRACTION = 0.25
"""Fraction of worlds in which a clock is set or drifts."""

SMOOTH_FRACTION = 0.1
"""Fraction of worlds whose built-in controller moves smoothly through points."""

REAL_TIME_FRACTION = 0.07
"""Fraction of worlds with Real-time Motion Control."""

PREPARES_FRACTION = 0.1
"""Fraction of worlds whose node smooths goals before execution although it need not."""

WORKER_FRACTION = 0.4
"""Fraction of the worlds with a planning process in which it dies, and in which it hangs."""

SMOOTH_PROFILES = (*['simulated'] * 4, 'generic', 'motoman')

SCALES = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 1.0, 1.0)
DISTANCES_RAD = (0.0, 2e-4, 0.005, 0.1, 0.3)
"""Maximum distances of goals in each joint. Some are within the tolerance."""

PORTS = ('motion', 'motion', 'state', 'state', 'io', 'remote')
PENDANT = (
    'ESTOP_PRESS',
    'ESTOP_RELEASE',
    'RESET',
    'MOTORS_ON',
    'MOTORS_OFF',
    'DOOR_OPEN',
    'DOOR_CLOSE',
    'CONTINUE',
    'PAUSE',
    'STOP',
    'START',
    'MODE_MANUAL',
    'MODE_AUTO',
    'POWER_LOW',
    'POWER_HIGH',
)
FAULTS = (
    'cut for={t}',
    'cut port=state for={t}',
    'cut port=motion for={t}',
    'half_open for={t}',
    'delay seconds=0.1 for={t}',
    'jitter seconds=0.08 for={t}',
    'coalesce seconds=0.1 for={t}',
    'one_byte port=state for={t}',
    'one_byte port=motion for={t}',
    'bit_errors rate=0.2 for={t}',
    'wrong_length count=1',
    'lost_reply count=1',
    'late_reply seconds=0.7 count=1',
    'late_reply seconds=2 count=1',
    'wrong_byte_order for={t}',
    'frozen_encoder joint=2 for={t}',
    'servo_error joint=2',
    'estop_at_point point=2',
    'reboot for={t}',
)
"""Faults of the controller, in the syntax of `pendant fault`."""


AXES = ('1', '2', '3', '4', '5', '6', 'X', 'Y', 'Z', 'U', 'V', 'W')
"""Axes for jogging: a joint, or the tool along or about an axis."""


@dataclass(frozen=True)
class Event:
    """An event `after` s after the previous one. Parameters are plain values."""

    after: float
    kind: str
    parameters: Parameters

    def __str__(self) -> str:
        given = ', '.join(f'{name}={value}' for name, value in self.parameters.items())
        return f'{self.kind}({given})'


def _no_parameters(_rng: Rng) -> Parameters:
    return {}


def _goal(rng: Rng) -> Parameters:
    points = int(rng.integers(1, 7))
    far = float(rng.choice(DISTANCES_RAD))
    step = float(rng.choice([0.05, 0.1, 0.2, 1.0, 1.0, 4.0]))
    offsets = rng.uniform(-far, far, (points, JOINTS)).round(4).tolist()
    return {'step': step, 'offsets': offsets, 'from_here': bool(rng.random() < 0.7)}


def _stream(rng: Rng) -> Parameters:
    return {
        'publisher': int(rng.integers(PUBLISHERS)),
        'kind': str(rng.choice(['velocities', 'zeros', 'positions', 'from here', 'window'])),
        'speed': rng.uniform(-0.3, 0.3, JOINTS).round(3).tolist(),
        'period': float(rng.choice([0.01, 0.02, 0.05])),
        'zero_each': int(rng.choice([0, 0, 3, 25])),
    }


def _wrong(rng: Rng) -> Parameters:
    return {
        'kind': str(rng.choice(['no number', 'degrees', 'huge'])),
        'topic': str(rng.choice(['~/servo', '~/servo', '~/joint_jog'])),
    }


def _lines(rng: Rng) -> Parameters:
    far = float(rng.choice([0.005, 0.05, 0.15]))
    ways = rng.uniform(-far, far, (int(rng.integers(1, 4)), 3)).round(4).tolist()
    return {
        'ways': ways,
        'blend': float(rng.choice([0.0, 0.001])),
        'speed': float(rng.choice([0.05, 0.25])),
    }


def _output(rng: Rng) -> Parameters:
    return {'index': int(rng.integers(OUTPUTS))}


def _setting(rng: Rng) -> Parameters:
    return _output(rng) | {'value': int(rng.integers(2))}


def _leave(rng: Rng) -> Parameters:
    return _seconds(rng) | {'lost': bool(rng.random() < 0.5)}


def _publisher(rng: Rng) -> Parameters:
    return {'publisher': int(rng.integers(PUBLISHERS))}


def _scale(rng: Rng) -> Parameters:
    return {'factor': float(rng.choice(SCALES))}


def _pendant(rng: Rng) -> Parameters:
    return {'event': str(rng.choice(PENDANT))}


def _fault(rng: Rng) -> Parameters:
    lasts = round(float(rng.choice([0.1, 0.3, 0.7, 2.0])), 2)
    return {'text': str(rng.choice(FAULTS)).format(t=lasts)}


def _port(rng: Rng) -> Parameters:
    return {'port': str(rng.choice(PORTS))}


def _port_for_a_while(rng: Rng) -> Parameters:
    return _port(rng) | {'seconds': round(float(rng.exponential(0.4)), 3)}


def _seconds(rng: Rng) -> Parameters:
    return {'seconds': round(float(rng.choice([0.02, 0.3, 0.45, 0.7, 2.0, 4.0])), 3)}


def _flip(rng: Rng) -> Parameters:
    return {'port': 'state', 'byte': int(rng.integers(0, 56)), 'bit': int(rng.integers(8))}


def _hand(rng: Rng) -> Parameters:
    return {
        'axis': str(rng.choice(AXES)),
        'frame': str(rng.choice(['world', 'tool'])),
        'share': round(float(rng.uniform(-1.0, 1.0)), 2),
        'arms': bool(rng.random() < 0.8),
    }


def _held(rng: Rng) -> Parameters:
    return _hand(rng) | {'seconds': round(float(rng.exponential(1.0)), 3)}


def _step(rng: Rng) -> Parameters:
    return _hand(rng) | {'size': round(float(rng.choice([0.001, 0.02, 0.1, 0.4])), 3)}


def _set(rng: Rng) -> Parameters:
    return {'seconds': float(rng.choice([-3600.0, -1.0, -0.3, -0.05, 0.05, 0.3, 1.0, 1e8]))}


def _rate(rng: Rng) -> Parameters:
    return {'rate': 1.0 + float(rng.choice([-5e-4, -1e-4, 1e-4, 5e-4]))}


def _worker(rng: Rng) -> Parameters:
    return {'which': str(rng.choice(['planner', 'smoothing']))}


def _pause(rng: Rng) -> Parameters:
    return {'seconds': round(float(rng.choice([0.1, 0.5, 1.0, 1.7, 3.0])), 3)}


KINDS: dict[str, tuple[float, Callable[[Rng], Parameters]]] = {
    'goal': (8.0, _goal),
    'cancel': (2.0, _no_parameters),
    'scale': (2.0, _scale),
    'stop': (2.0, _no_parameters),
    'enable': (4.0, _no_parameters),
    'mend': (4.0, _no_parameters),
    'disable': (1.0, _no_parameters),
    'reset_error': (1.0, _no_parameters),
    'stream': (4.0, _stream),
    'one_setpoint': (1.0, _stream),
    'end_stream': (2.0, _publisher),
    'pendant': (4.0, _pendant),
    'fault': (3.0, _fault),
    'clear_faults': (0.5, _no_parameters),
    'network_stall': (1.0, _port_for_a_while),
    'network_reset': (1.0, _port),
    'network_half_close': (0.5, _port),
    'network_flip': (0.5, _flip),
    'driver_hangs': (1.0, _seconds),
    'driver_dies': (0.7, _seconds),
    'driver_leaves': (0.7, _leave),
    'move_tool': (1.5, _lines),
    'wrong_setpoint': (0.5, _wrong),
    'read_output': (0.7, _output),
    'write_output': (1.0, _setting),
    'second_client': (0.7, _port_for_a_while),
    'panel_jog': (2.5, _held),
    'panel_step': (1.0, _step),
    'panel_arm': (0.5, _no_parameters),
    'panel_enable': (0.7, _no_parameters),
    'panel_stop': (0.5, _no_parameters),
    'panel_disarm': (0.3, _no_parameters),
    'panel_hangs': (0.5, _pause),
    'panel_line_stalls': (0.7, _pause),
    'panel_page_freezes': (1.2, _pause),
    'panel_page_closes': (0.3, _no_parameters),
    'clock_set': (0.0, _set),
    'clock_drifts': (0.0, _rate),
    'worker_dies': (0.0, _worker),
    'worker_hangs': (0.0, _worker),
}
"""Kind of event → its weight, and a function that draws its parameters. 0: see `events_of`."""


Plan = tuple[tuple[float, str, Parameters], ...]
"""Events: maximum time since the previous one, s, the kind, and fixed parameters."""

SITUATION_FRACTION = 0.5
"""Fraction of worlds that include sequences of SITUATIONS."""

FAR = {'step': 1.0, 'offsets': [[0.3, -0.2, 0.3, 0.1, 0.2, 0.3], [-0.3] * JOINTS]}
LONG = FAR | {'step': 6.0}
STICK = {'publisher': 0, 'kind': 'velocities', 'speed': [0.3, -0.1, 0.1, 0.1, 0.1, 0.1]}
LATER: tuple[float, str, Parameters] = (12.0, 'end_stream', {})
"""Event after 12 s, when an arm without a requested motion must be at rest with any controller."""

SITUATIONS: tuple[Plan, ...] = (
    *(
        ((2.0, 'goal', FAR), (0.3, 'goal', FAR | {'from_here': True}), (0.1, ends, {}))
        for ends in ('cancel', 'stop', 'disable')
    ),
    *(
        (
            (0.3, 'panel_arm', {}),
            (0.5, 'panel_step', {'size': 0.4, 'share': 0.05}),
            (0.5, leaves, given),
            (6.0, 'cancel', {}),
        )
        for leaves, given in (
            ('panel_page_freezes', {'seconds': 3.0}),
            ('panel_page_closes', {}),
            ('panel_disarm', {}),
        )
    ),
    (
        (0.3, 'panel_arm', {}),
        (2.0, 'panel_line_stalls', {'seconds': 1.0}),
        (0.3, 'panel_step', {}),
    ),
    *(
        ((2.0, 'goal', LONG), (1.0, ends, given), LATER)
        for ends, given in (
            ('driver_dies', {'seconds': 4.0}),
            ('driver_dies', {'seconds': 0.3}),
            ('driver_hangs', {'seconds': 4.0}),
            ('pendant', {'event': 'ESTOP_PRESS'}),
        )
    ),
    ((2.0, 'goal', LONG), (1.5, 'fault', {'text': 'cut port=motion for=2'}), (0.1, 'stop', {})),
    *(((2.0, 'move_tool', {}), (0.3, ends, {}), LATER) for ends in ('cancel', 'stop')),
    ((0.3, 'network_stall', {'port': 'io', 'seconds': 3.0}), (0.1, 'write_output', {'value': 1})),
    ((1.0, 'network_flip', {}),) * 8,
    ((0.3, 'enable', {}), (0.05, 'disable', {}), (0.5, 'goal', {})),
    *(
        (
            (0.5, 'pendant', {'event': closes}),
            (1.0, 'pendant', {'event': opens}),
            (1.0, 'pendant', {'event': 'MOTORS_ON'}),
            (1.0, again, {}),
            (1.0, 'goal', {'step': 1.0}),
        )
        for closes, opens in (
            ('MOTORS_OFF', 'MOTORS_ON'),
            ('ESTOP_PRESS', 'ESTOP_RELEASE'),
            ('DOOR_OPEN', 'DOOR_CLOSE'),
        )
        for again in ('reset_error', 'goal')
    ),
    *(
        ((1.5, 'stream', {}), (0.7, stops, {}), (0.7, 'mend', {}), (1.5, 'goal', {}))
        for stops in ('stop', 'disable')
    ),
    ((2.0, 'stream', STICK), (1.0, 'end_stream', {'publisher': 0}), LATER),
    ((2.0, 'driver_hangs', {'seconds': 2.0}), (0.3, 'one_setpoint', STICK), (4.0, 'goal', {})),
    ((2.0, 'wrong_setpoint', {}), *((0.03, 'wrong_setpoint', {}),) * 5, (1.5, 'goal', {})),
    (
        (0.3, 'goal', {}),
        (0.3, 'fault', {'text': 'late_reply seconds=0.7 count=1'}),
        (0.5, 'goal', {}),
        (0.5, 'goal', {}),
    ),
)
"""Sequences of events that once revealed an error, or might reveal one. They are mixed with random
events."""

CLOCK_SITUATION: Plan = (
    (1.0, 'mend', {}),
    (0.3, 'enable', {}),
    (1.5, 'stream', STICK | {'period': 0.02, 'zero_each': 0}),
    (1.0, 'driver_hangs', {'seconds': 0.3}),
    (0.2, 'clock_set', {}),
    (0.02, 'end_stream', {'publisher': 0}),
    LATER,
)
"""Setpoints received by a clock that is set before they are read."""

PATIENT: Plan = ((1.0, 'enable', {}), (2.0, 'goal', {'step': 4.0}), LATER)
"""A user waits for a goal during which the arm may be at rest for long."""


CALM_KINDS = frozenset(
    (
        'goal',
        'cancel',
        'scale',
        'stop',
        'enable',
        'stream',
        'one_setpoint',
        'end_stream',
        'move_tool',
        'wrong_setpoint',
        'clock_set',
        'clock_drifts',
    )
)
"""Kinds of events in worlds without failures. None of them may close the gate."""


def events_of(seed: str) -> list[Event]:
    """Return the events of a seed such as `7`, or of a varied one, `7.3`. Raises ValueError."""
    first, *others = (int(part) for part in seed.split('.'))
    rng = np.random.default_rng([first, 0])
    kinds = CALM_KINDS if rng.random() < CALM_FRACTION else KINDS.keys()
    events = [draw(rng, kinds) for _ in range(int(rng.integers(MIN_EVENTS, MAX_EVENTS + 1)))]
    _put_situations(events, np.random.default_rng([first, 3]), calm=kinds is CALM_KINDS)
    _put_clocks(events, np.random.default_rng([first, 4]), calm=kinds is CALM_KINDS)
    if smooth_profile(seed):
        _put_planner(events, np.random.default_rng([first, 6]), calm=kinds is CALM_KINDS)
    if prepared(seed):
        _put_smoothing(events, np.random.default_rng([first, 8]), calm=kinds is CALM_KINDS)
    for other in others:
        events = varied(events, np.random.default_rng([first, other, 1]))
    return events


def _put_situations(events: list[Event], rng: Rng, *, calm: bool) -> None:
    if rng.random() >= SITUATION_FRACTION:
        return
    for _ in range(1 if calm else int(rng.integers(1, 5))):
        plan = SITUATIONS[int(rng.integers(len(SITUATIONS)))]
        _put(events, rng, PATIENT if calm else ((1.0, 'mend', {}), *plan))


def _put(events: list[Event], rng: Rng, plan: Plan) -> None:
    at = int(rng.integers(len(events) + 1))
    events[at:at] = [
        Event(round(float(rng.uniform(0.0, most)), 4), kind, KINDS[kind][1](rng) | given)
        for most, kind, given in plan
    ]


def _put_clocks(events: list[Event], rng: Rng, *, calm: bool) -> None:
    if rng.random() >= CLOCK_FRACTION:
        return
    for kind in ('clock_drifts', *('clock_set',) * int(rng.integers(0, 6))):
        at = int(rng.integers(len(events) + 1))
        events.insert(at, Event(0.0, kind, KINDS[kind][1](rng)))
    if not calm:
        _put(events, rng, CLOCK_SITUATION)


def _put_planner(events: list[Event], rng: Rng, *, calm: bool) -> None:
    if calm:
        return
    _put(events, rng, ((1.0, 'mend', {}), (2.0, 'goal', FAR), (0.7, 'scale', {})))
    _put_worker(events, rng, 'planner', 0.7)


def _put_smoothing(events: list[Event], rng: Rng, *, calm: bool) -> None:
    if calm:
        return
    for ends in ('stop', 'cancel', 'goal', 'scale', 'driver_dies'):
        if rng.random() < WORKER_FRACTION:  # during its preparation or afterwards
            _put(events, rng, ((1.0, 'mend', {}), (1.5, 'goal', {}), (1.0, ends, {})))
    _put_worker(events, rng, 'smoothing', 1.2)


def _put_worker(events: list[Event], rng: Rng, which: str, most: float) -> None:
    for kind in ('worker_dies', 'worker_hangs'):
        if rng.random() < WORKER_FRACTION:
            ends = (most, kind, {'which': which})
            _put(events, rng, ((1.0, 'mend', {}), (1.5, 'goal', FAR), ends))


def smooth_profile(seed: str) -> str:
    """Return the profile of a smoothly moving controller for a seed's world, or ''."""
    rng = np.random.default_rng([int(seed.partition('.')[0]), 5])
    return str(rng.choice(SMOOTH_PROFILES)) if rng.random() < SMOOTH_FRACTION else ''


def real_time(seed: str) -> bool:
    """Return whether the world of a seed has Real-time Motion Control."""
    rng = np.random.default_rng([int(seed.partition('.')[0]), 9])
    return bool(rng.random() < REAL_TIME_FRACTION)


def prepared(seed: str) -> str:
    """Return the node's smoothing of goals in a seed's world, or ''."""
    rng = np.random.default_rng([int(seed.partition('.')[0]), 7])
    how = str(rng.choice(['resample', 'resample', 'thin', 'time_optimal']))
    return how if rng.random() < PREPARES_FRACTION else ''


def draw(rng: Rng, kinds: Collection[str]) -> Event:
    names = [kind for kind in KINDS if kind in kinds]
    weights = np.array([KINDS[kind][0] for kind in names])
    kind = str(rng.choice(names, p=weights / weights.sum()))
    gaps = (0.0, 0.0003, 0.01, rng.uniform(0.0, 0.3), rng.uniform(0.0, 1.5))
    return Event(round(float(rng.choice(gaps)), 4), kind, KINDS[kind][1](rng))


def varied(events: list[Event], rng: Rng) -> list[Event]:
    changed = list(events)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(changed) + 1))
        what = rng.integers(4)
        if what == 0 or at == len(changed):
            changed.insert(at, draw(rng, KINDS))
        elif what == 1:
            del changed[at]
        elif what == 2:
            changed.insert(int(rng.integers(len(changed) + 1)), changed[at])
        else:
            old = changed[at]
            changed[at] = Event(
                round(old.after * float(rng.choice([0.0, 0.5, 2.0])), 4), old.kind, old.parameters
            )
    return changed


def number_of(seed: str) -> int:
    """Return a seed for the parts of a world that are not events: delays, its controller."""
    return zlib.crc32(seed.partition('.')[0].encode())
