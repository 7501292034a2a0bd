# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The section `io` of a controller profile: the I/O points, and the safe values of outputs."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from epson_driver.inputs import InputError, choice, count, number, printable, shown
from epson_driver.simple_message import IoType

MAX_POINTS = 4096
"""Maximum number of points of each type. One message can contain all of them."""

MILLIVOLTS = 1000
"""mV per V. Messages contain analogue values in mV."""

MAX_PERIOD_S = 60.0

Point = tuple[IoType, int]

OUTPUTS = {'DO': IoType.DIGITAL_OUTPUT, 'AO': IoType.ANALOG_OUTPUT}
"""Prefix of output names in a profile (`DO0`, `AO1`) → type of the outputs."""

ALL = 'all'

IoAccess = Literal['server', 'remote_ethernet', 'motoman', 'rtmc']

ACCESSES: tuple[IoAccess, ...] = ('server', 'remote_ethernet', 'motoman', 'rtmc')

NO_POINTS: frozenset[Point] = frozenset()


@dataclass(frozen=True)
class IoProfile:
    """Inputs and outputs of a controller. The defaults are those of an RC620.

    * `access`: how a driver accesses the points. 'server': with the messages of docs/io.md at the
      I/O port, if a program on the controller serves it. 'remote_ethernet': with EPSON's commands
      at the remote port. 'motoman': with MotoROS' messages at the I/O port. 'rtmc': by Real-time
      Motion Control.
    * `digital_inputs` to `flags`: number of points of each type. 24 digital inputs and 16 outputs
      are standard on an RC620, and analogue I/O is an optional board. `flags` are SPEL+'s memory
      I/O bits.
    * `analog_range`: smallest and largest value of analogue points, V.
    * `safe`: safe values of outputs (default: 0). Analogue values are in mV.
    * `keep_on_reset`, `keep_on_link_loss`: outputs that stay unchanged on a reset or a lost link.
      All others are set to their safe values.
    * `publish_period`: period, s, at which a driver polls the values, and at which a server sends
      them to subscribers even if unchanged. `publish_interval`: minimum time between two messages
      about changes, s.
    """

    access: IoAccess = 'server'
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
        """Smallest and largest value of analogue points, mV."""
        low, high = self.analog_range
        return math.ceil(low * MILLIVOLTS), math.floor(high * MILLIVOLTS)

    @property
    def outputs(self) -> frozenset[Point]:
        return frozenset(
            (io_type, index)
            for io_type, count in (
                (IoType.DIGITAL_OUTPUT, self.digital_outputs),
                (IoType.ANALOG_OUTPUT, self.analog_outputs),
            )
            for index in range(count)
        )


def read_io_profile(data: Mapping[Any, Any], file: str) -> IoProfile:
    """Read the section `io` of a profile, with defaults for missing keys.

    Outputs have names like `DO3` or `AO0`, and `all` means every output. Safe values are 0 or 1
    for digital outputs, and are in V for analogue outputs. Raises InputError if the section is
    invalid.
    """
    place = f'{file}: io.'
    known = {item.name for item in fields(IoProfile)}
    for key in data:
        if key not in known:
            raise InputError(f'{place}{printable(key)} is not a key of the section io')
    plain: dict[str, Any] = {
        key: rule.checked(data[key], place + key) for key, rule in _RULES.items() if key in data
    }
    if 'analog_range' in data:
        plain['analog_range'] = _range(place + 'analog_range', data['analog_range'])
    profile = IoProfile(**plain)
    if 'safe' in data:
        plain['safe'] = _safe(place + 'safe', data['safe'], profile)
    for key in ('keep_on_reset', 'keep_on_link_loss'):
        if key in data:
            plain[key] = _outputs(place + key, data[key], profile)
    return IoProfile(**plain)


_RULES = {
    'access': choice(*ACCESSES),
    **dict.fromkeys(('digital_inputs', 'digital_outputs', 'flags'), count(0, MAX_POINTS)),
    **dict.fromkeys(('analog_inputs', 'analog_outputs'), count(0, MAX_POINTS)),
    **dict.fromkeys(('publish_period', 'publish_interval'), number(0.001, MAX_PERIOD_S)),
}
_VOLTS = number(-100.0, 100.0)


def _range(where: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise InputError(f'{where} = {shown(value)}: must be two numbers, in V')
    low, high = (_VOLTS.checked(item, f'{where}[{index}]') for index, item in enumerate(value))
    if not low <= 0.0 <= high:
        raise InputError(f'{where} = {shown(value)}: must include 0 V')
    return low, high


def _safe(where: str, value: Any, profile: IoProfile) -> dict[Point, int]:
    if not isinstance(value, Mapping):
        rule = 'must be a mapping, such as {DO3: 1, AO0: 2.5}'
        raise InputError(f'{where} = {shown(value)}: {rule}')
    volts = number(*profile.analog_range)
    safe = {}
    for name, setting in value.items():
        point = _output(where, name, profile)
        if point[0] is IoType.ANALOG_OUTPUT:
            safe[point] = round(volts.checked(setting, f'{where}.{name}') * MILLIVOLTS)
        elif setting in (0, 1):  # true and false are 1 and 0
            safe[point] = int(setting)
        else:
            raise InputError(f'{where}.{name} = {shown(setting)}: must be 0 or 1')
    return safe


def _outputs(where: str, value: Any, profile: IoProfile) -> frozenset[Point]:
    if value == ALL:
        return profile.outputs
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InputError(f'{where} = {shown(value)}: must be a list of outputs, or {ALL}')
    return frozenset(_output(where, name, profile) for name in value)


def _output(where: str, name: Any, profile: IoProfile) -> Point:
    kind, index = str(name)[:2], str(name)[2:]
    counts = {'DO': profile.digital_outputs, 'AO': profile.analog_outputs}
    known = kind in counts and index.isascii() and index.isdigit()
    if not known or len(index) > 4 or int(index) >= counts[kind]:
        outputs = ' or '.join(f'{kind}0 to {kind}{n - 1}' for kind, n in counts.items() if n)
        raise InputError(f'{where}: {shown(name)} must be an output: {outputs or "left out"}')
    return OUTPUTS[kind], int(index)
