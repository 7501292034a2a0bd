# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller profile read from config/controllers/NAME.yaml, validated."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from epson_driver.share import share_file
from epson_driver.simple_message import ByteOrder, Mode

LOOK_AHEAD = (0.01, 60.0)
"""Shortest and longest look-ahead of smooth motion, s."""


class ControllerProfileError(ValueError):
    """A profile that cannot be used. The text names the file, the key and the value."""


@dataclass(frozen=True)
class ControllerProfile:
    """Data of one kind of controller.

    `speed` and `accel` are fractions (0, 1] of the robot's limits, for point-to-point motion; the
    periods are in s; `pending_limit` is how many points may wait for the arm; in smooth motion
    points are taken while less than `look_ahead` s and `look_ahead_points` are ahead; after every
    `joint_positions_per_status` JOINT_POSITION messages comes a STATUS in a slot of its own.
    """

    name: str
    description: str
    byte_order: ByteOrder
    mode: Mode
    speed: float
    accel: float
    cycle_period: float
    pending_limit: int
    look_ahead: float
    look_ahead_points: int
    state_period: float
    joint_positions_per_status: int


@dataclass(frozen=True, slots=True)
class _Rule:
    """What a key must hold: `read` returns the profile's value, or raises for any other."""

    read: Callable[[Any], Any]
    text: str


def _number(low: float, high: float) -> _Rule:
    def read(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise TypeError
        if not (math.isfinite(value) and low <= value <= high):
            raise ValueError
        return float(value)

    return _Rule(read, f'must be a number from {low:g} to {high:g}')


def _count(high: int) -> _Rule:
    def read(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise TypeError
        if not 1 <= value <= high:
            raise ValueError
        return value

    return _Rule(read, f'must be a whole number from 1 to {high}')


def _choice(choices: dict[str, Any]) -> _Rule:
    return _Rule(lambda value: choices[value], f'must be {" or ".join(choices)}')


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


_RULES: dict[str, _Rule] = {
    'name': _Rule(_text, 'must be a text'),
    'description': _Rule(_text, 'must be a text'),
    'byte_order': _choice({'little': ByteOrder.LITTLE, 'big': ByteOrder.BIG}),
    'mode': _choice({'auto': Mode.AUTO, 'manual': Mode.MANUAL}),
    'motion.speed_percent': _number(1.0, 100.0),
    'motion.accel_percent': _number(1.0, 100.0),
    'motion.cycle_period': _number(0.0005, 0.1),
    'motion.pending_limit': _count(100_000),
    'motion.look_ahead': _number(*LOOK_AHEAD),
    'motion.look_ahead_points': _count(100_000),
    'state.period': _number(0.001, 1.0),
    'state.joint_positions_per_status': _count(1000),
}


def load_controller_profile(name: str) -> ControllerProfile:
    """Read config/controllers/NAME.yaml, or the file itself if `name` is a path to a .yaml file.

    Raises FileNotFoundError (which lists the profiles there are) or ControllerProfileError.
    """
    file = name if name.endswith('.yaml') else share_file('config', 'controllers', name + '.yaml')
    path = Path(file)
    try:
        data = yaml.safe_load(path.read_text(encoding='utf-8'))
    except yaml.YAMLError as cause:
        raise ControllerProfileError(f'{path}: not YAML: {cause}') from cause
    values = dict(_values(data, path))
    return ControllerProfile(
        name=values['name'],
        description=values['description'],
        byte_order=values['byte_order'],
        mode=values['mode'],
        speed=values['motion.speed_percent'] / 100.0,
        accel=values['motion.accel_percent'] / 100.0,
        cycle_period=values['motion.cycle_period'],
        pending_limit=values['motion.pending_limit'],
        look_ahead=values['motion.look_ahead'],
        look_ahead_points=values['motion.look_ahead_points'],
        state_period=values['state.period'],
        joint_positions_per_status=values['state.joint_positions_per_status'],
    )


def _values(data: Any, path: Path) -> Iterator[tuple[str, Any]]:
    flat = dict(_flat(data, path))
    for key in flat.keys() - _RULES.keys():
        raise ControllerProfileError(f'{path}: {key} is not a key of a controller profile')
    for key, rule in _RULES.items():
        if key not in flat:
            raise ControllerProfileError(f'{path}: {key} is missing')
        try:
            yield key, rule.read(flat[key])
        except (TypeError, ValueError, KeyError) as cause:
            raise ControllerProfileError(f'{path}: {key} = {flat[key]!r}: {rule.text}') from cause


def _flat(data: Any, path: Path) -> Iterator[tuple[str, Any]]:
    if not isinstance(data, dict):
        raise ControllerProfileError(f'{path}: the file = {data!r}: must be a mapping')
    for key, value in data.items():
        if isinstance(value, dict):
            yield from ((f'{key}.{inner}', held) for inner, held in value.items())
        else:
            yield str(key), value
