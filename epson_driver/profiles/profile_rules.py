# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The allowed values of each key of a controller profile, and the check of a profile."""

from enum import StrEnum
from typing import Any

from epson_driver.inputs import InputError, Rule, choice, count, number, printable
from epson_driver.simple_message import ByteOrder, Mode


class FieldsUsed(StrEnum):
    """Fields of a JOINT_TRAJ_PT that a controller uses."""

    BOTH = 'both'
    VELOCITY = 'velocity'
    DURATION = 'duration'
    NOTHING = 'nothing'

    @property
    def velocity(self) -> bool:
        return self in (FieldsUsed.BOTH, FieldsUsed.VELOCITY)

    @property
    def duration(self) -> bool:
        return self in (FieldsUsed.BOTH, FieldsUsed.DURATION)


LOOK_AHEAD_S = (0.01, 60.0)

MAX_TEXT_CHARACTERS = 10_000


def _mapped(choices: dict[str, Any]) -> Rule:
    return Rule(lambda value: choices[value], f'must be {" or ".join(choices)}')


def _yes_or_no(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    if len(value) > MAX_TEXT_CHARACTERS:
        raise ValueError
    return value


def _sentences(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise TypeError
    return tuple(value)


def _mapping(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise TypeError
    return value


def _defines(value: Any) -> dict[str, str]:
    """Return the values of #define lines by name.

    Numbers are converted to texts, and null is converted to an empty text.
    """
    defines = {}
    for name, definition in _mapping(value).items():
        if not isinstance(name, str) or isinstance(definition, bool):
            raise TypeError
        if not isinstance(definition, str | int | float | None):
            raise TypeError
        defines[name] = '' if definition is None else str(definition)
    return defines


_TEXT = Rule(_text, 'must be a string')
_YES_OR_NO = Rule(_yes_or_no, 'must be true or false')
_PORT = count(1, 65_535)
_CLIENTS = count(1, 1000)

RULES: dict[str, Rule] = {
    'name': _TEXT,
    'description': _TEXT,
    'approximate': Rule(_sentences, 'must be a list of sentences'),
    'byte_order': _mapped({'little': ByteOrder.LITTLE, 'big': ByteOrder.BIG}),
    'mode': _mapped({'auto': Mode.AUTO, 'manual': Mode.MANUAL}),
    'error_texts': _TEXT,
    'ports.motion': _PORT,
    'ports.state': _PORT,
    'ports.io': _PORT,
    'ports.remote': count(0, 65_535),
    'motion.speed': number(0.01, 1.0),
    'motion.accel': number(0.01, 1.0),
    'motion.power': choice('high', 'low'),
    'motion.cp': _YES_OR_NO,
    'motion.statement_overhead': number(0.0, 1.0),
    'motion.look_ahead': number(*LOOK_AHEAD_S),
    'motion.look_ahead_points': count(1, 100_000),
    'motion.pending_limit': count(1, 100_000),
    'servo.lag': number(0.0, 1.0),
    'servo.encoder': _YES_OR_NO,
    'program.kind': choice('points', 'motoman'),
    'program.interface': choice('streaming', 'download', 'statements', 'rtmc'),
    'program.reply': choice('sequence', 'header'),
    'program.acknowledge': choice('default', 'taken'),
    'program.check_sequence': _YES_OR_NO,
    'program.check_limits': _YES_OR_NO,
    'program.uses': _mapped({item.value: item for item in FieldsUsed}),
    'program.exact_times': _YES_OR_NO,
    'program.late_failure': _YES_OR_NO,
    'program.accepts': choice('exact', 'longer', 'any'),
    'program.special_sequences': choice('all', 'stop'),
    'program.skip_first': number(0.0, 0.1),
    'program.motors': choice('none', 'remote_ethernet', 'restart', 'motoman', 'rtmc'),
    'program.smoothing': choice('none', 'resample', 'thin'),
    'program.resample_period': number(0.004, 1.0),
    'program.thin_deviation': number(0.0001, 1.0),
    'program.setpoint_period': number(0.02, 0.2),
    'program.download.buffer': count(1, 100_000),
    'program.download.overflow': choice('refuse', 'drop'),
    'program.download.dead_time': number(0.0, 10.0),
    'state.period': number(0.001, 1.0),
    'state.joint_positions_per_status': count(1, 1000),
    'state.status_with_joints': _YES_OR_NO,
    'state.status_at_rest': _YES_OR_NO,
    'state.message': choice('joint_position', 'joint_feedback'),
    'state.feedback_time': _YES_OR_NO,
    'state.errors': choice('all', 'alarms'),
    'server.lost_client': choice('brake', 'finish', 'keep'),
    'server.client_timeout': number(0.0, 60.0),
    'server.full': choice('refuse', 'replace'),
    'server.state_clients': _CLIENTS,
    'server.io_clients': _CLIENTS,
    'spel.project': _TEXT,
    'spel.config': Rule(_defines, 'must be a mapping of names to texts or numbers'),
    'io': Rule(_mapping, 'must be a mapping'),
    'remote.session_timeout': number(0.0, 86_400.0),
    'remote.password': _TEXT,
    'remote.clients': _CLIENTS,
    'rtmc.port': count(0, 65_535),
    'rtmc.password': _TEXT,
    'rtmc.cycle': number(0.001, 0.1),
}
"""Full key, such as `motion.speed` → rule. All keys are required."""


def checked(data: dict[Any, Any], file: str) -> dict[str, Any]:
    """Return the sections of a profile, with values converted by `RULES`.

    Raises InputError if a key is unknown or missing, or if a value is invalid.
    """
    flat_values = dict(_flat(data, ''))
    values: dict[str, Any] = {}
    for key in sorted(flat_values.keys() - RULES.keys()):
        raise InputError(f'{file}: {printable(key)} is not a key of a controller profile')
    for key, rule in RULES.items():
        if key not in flat_values:
            raise InputError(f'{file}: {key} is missing')
        value = rule.checked(flat_values[key], f'{file}: {key}')
        *sections, last = key.split('.')
        inner = values
        for section in sections:
            inner = inner.setdefault(section, {})
        inner[last] = value
    return values


def _flat(data: dict[Any, Any], place: str) -> list[tuple[str, Any]]:
    """Return the values of all sections of `RULES` by full key, such as `motion.speed`."""
    flat: list[tuple[str, Any]] = []
    for key, value in data.items():
        name = f'{place}{key}'
        section = any(known.startswith(name + '.') for known in RULES)
        if section and isinstance(value, dict):
            flat += _flat(value, name + '.')
        else:
            flat.append((name, value))
    return flat
