# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The section `io` of a controller profile: which points there are, and their safe values."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from epson_driver.controllers.profile_rules import ControllerProfileError
from epson_driver.simple_message import IoType

MAX_POINTS = 4096
"""Points of one type: a whole type can be read, or published, in one message."""

MILLIVOLTS = 1000
"""Analogue values travel in mV: this many in one V."""

LONGEST_PERIOD = 60.0

Point = tuple[IoType, int]
"""A point of a type, by its index."""

OUTPUTS = {'DO': IoType.DIGITAL_OUTPUT, 'AO': IoType.ANALOG_OUTPUT}
"""How outputs are called in a profile: `DO0`, `AO1`."""

ALL = 'all'

NO_POINTS: frozenset[Point] = frozenset()


@dataclass(frozen=True)
class IoProfile:
    """The points of one controller; the defaults are those of an RC620.

    * Numbers of points per type. 24 digital inputs and 16 outputs are its standard I/O; analogue
      I/O is an optional board there; `flags` are SPEL+'s memory I/O bits.
    * `analog_range`: the smallest and the largest value of analogue points, V.
    * `safe`: safe values of outputs, 0 for those that are not in it; of analogue ones in mV, as
      on the wire.
    * `keep_on_reset`, `keep_on_link_loss`: the outputs that stay as they are then. All others
      take their safe value.
    * `publish_period`: subscribed values are sent every so many s, changed or not.
      `publish_interval`: changes are sent at once, but never closer than this, s.
    """

    digital_inputs: int = 24
    digital_outputs: int = 16
    analog_inputs: int = 2
    analog_outputs: int = 2
    flags: int = 512
    analog_range: tuple[float, float] = (-10.0, 10.0)
    safe: Mapping[Point, int] = field(default_factory=dict)
    keep_on_reset: frozenset[Point] = NO_POINTS
    keep_on_link_loss: frozenset[Point] = NO_POINTS
    publish_period: float = 0.1
    publish_interval: float = 0.01

    @property
    def analog_limits(self) -> tuple[int, int]:
        """The smallest and the largest value of analogue points, mV."""
        low, high = self.analog_range
        return math.ceil(low * MILLIVOLTS), math.floor(high * MILLIVOLTS)

    @property
    def outputs(self) -> frozenset[Point]:
        """Every output."""
        return frozenset(
            (io_type, index)
            for io_type, count in (
                (IoType.DIGITAL_OUTPUT, self.digital_outputs),
                (IoType.ANALOG_OUTPUT, self.analog_outputs),
            )
            for index in range(count)
        )


def read_io_profile(data: Mapping[Any, Any], file: str) -> IoProfile:
    """Return what the section `io` of a profile says; a key that it leaves out has its default.

    Outputs are called `DO3` or `AO0`; `all` is every output. Safe values are 0 or 1, or V.
    Raises ControllerProfileError, which names the file, the key and the value.
    """
    try:
        return _read(dict(data))
    except _WrongError as wrong:
        raise ControllerProfileError(f'{file}: io.{wrong}') from None


class _WrongError(Exception):
    """What is wrong with which key."""


def _read(data: dict[Any, Any]) -> IoProfile:
    known = {item.name for item in fields(IoProfile)}
    for key in data:
        if key not in known:
            raise _WrongError(f'{key} is not a key of the I/O')
    plain: dict[str, Any] = {}
    for key in ('digital_inputs', 'digital_outputs', 'analog_inputs', 'analog_outputs', 'flags'):
        if key in data:
            plain[key] = _count(key, data[key])
    for key in ('publish_period', 'publish_interval'):
        if key in data:
            plain[key] = _number(key, data[key], 0.001, LONGEST_PERIOD)
    if 'analog_range' in data:
        plain['analog_range'] = _range('analog_range', data['analog_range'])
    profile = IoProfile(**plain)
    if 'safe' in data:
        plain['safe'] = _safe('safe', data['safe'], profile)
    for key in ('keep_on_reset', 'keep_on_link_loss'):
        if key in data:
            plain[key] = _outputs(key, data[key], profile)
    return IoProfile(**plain)


def _count(key: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_POINTS:
        raise _WrongError(f'{key} = {value!r}: must be a whole number from 0 to {MAX_POINTS}')
    return value


def _number(key: str, value: Any, low: float, high: float) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not low <= value <= high:  # so is NaN
        raise _WrongError(f'{key} = {value!r}: must be a number from {low:g} to {high:g}')
    return float(value)


def _range(key: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise _WrongError(f'{key} = {value!r}: must be two numbers, in V')
    low, high = (_number(f'{key}[{at}]', held, -100.0, 100.0) for at, held in enumerate(value))
    if not low <= 0.0 <= high:
        raise _WrongError(f'{key} = {value!r}: 0 V must be in it')
    return low, high


def _safe(key: str, value: Any, profile: IoProfile) -> dict[Point, int]:
    if not isinstance(value, Mapping):
        raise _WrongError(f'{key} = {value!r}: must be a mapping, such as {{DO3: 1, AO0: 2.5}}')
    safe = {}
    for name, held in value.items():
        point = _output(key, name, profile)
        if point[0] is IoType.ANALOG_OUTPUT:
            volts = _number(f'{key}.{name}', held, *profile.analog_range)
            safe[point] = round(volts * MILLIVOLTS)
        elif held in (0, 1):  # true and false are 1 and 0
            safe[point] = int(held)
        else:
            raise _WrongError(f'{key}.{name} = {held!r}: must be 0 or 1')
    return safe


def _outputs(key: str, value: Any, profile: IoProfile) -> frozenset[Point]:
    if value == ALL:
        return profile.outputs
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise _WrongError(f'{key} = {value!r}: must be a list of outputs, or {ALL}')
    return frozenset(_output(key, name, profile) for name in value)


def _output(key: str, name: Any, profile: IoProfile) -> Point:
    kind, number = str(name)[:2], str(name)[2:]
    counts = {'DO': profile.digital_outputs, 'AO': profile.analog_outputs}
    known = kind in counts and number.isascii() and number.isdigit()
    if not known or len(number) > 4 or int(number) >= counts[kind]:
        outputs = ' or '.join(f'{kind}0 to {kind}{n - 1}' for kind, n in counts.items() if n)
        raise _WrongError(f'{key}: {name!r} is no output: must be {outputs or "left out"}')
    return OUTPUTS[kind], int(number)
