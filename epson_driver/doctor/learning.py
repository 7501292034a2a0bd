# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller profile from measured facts.

The profile has a comment with the reason for every key that was not measured.
"""

from collections.abc import Mapping
from typing import Any

import yaml

from epson_driver.doctor.state_facts import Facts
from epson_driver.profiles import ControllerProfile
from epson_driver.profiles.profile_rules import RULES

_MOTION = 'it is visible in a motion only, and the doctor moves nothing'
_PERSON = 'must be entered by hand'
_CHOICE = 'the conversion of trajectories is a choice of the user'

NOT_FOUND: Mapping[str, str] = {
    'name': 'the name of the file',
    'description': _PERSON,
    'approximate': 'the unknown keys are listed here',
    'error_texts': f'the table of its error numbers {_PERSON}',
    'mode': 'no STATUS showed the key switch',
    'byte_order': 'no message received',
    'ports.state': 'no message received',
    'ports.motion': 'not queried (see --ask), or no reply',
    'ports.io': 'not queried (see --io), or no reply',
    'ports.remote': 'not queried (see --remote-port and --ask), or no reply',
    'motion.': _MOTION,
    'servo.': _MOTION,
    'program.interface': 'the transfer of trajectories is a choice of the user',
    'program.kind': 'not queried (see --ask), or no reply',
    'program.reply': 'not queried (see --ask), or it has no replies of this kind',
    'program.acknowledge': _MOTION,
    'program.check_sequence': _MOTION,
    'program.check_limits': 'no point outside the limits is sent to a robot for a test',
    'program.uses': _MOTION,
    'program.exact_times': _MOTION,
    'program.late_failure': 'no point outside the limits is sent to a robot for a test',
    'program.accepts': 'it is visible only after an invalid message, which can end a program',
    'program.special_sequences': 'not queried (see --ask), or it has no special sequences',
    'program.skip_first': _MOTION,
    'program.motors': 'not queried (see --remote-port and --ask), or no reply',
    'program.smoothing': _CHOICE,
    'program.resample_period': _CHOICE,
    'program.setpoint_period': _CHOICE,
    'program.thin_deviation': _CHOICE,
    'program.download.': _MOTION,
    'state.period': 'too few messages received',
    'state.joint_positions_per_status': 'too few messages received',
    'state.status_with_joints': 'too few messages received',
    'state.status_at_rest': _MOTION,
    'state.message': 'no joints received',
    'state.feedback_time': 'the controller sends no JOINT_FEEDBACK',
    'state.errors': 'visible only after an error, an E-stop or a lost link',
    'server.full': 'visible only with one client too many',
    'server.lost_client': 'visible only if the connection is lost during a motion',
    'server.client_timeout': _MOTION,
    'server.state_clients': 'not queried (see --ask), or 20 or more clients are served',
    'server.io_clients': 'not tested repeatedly: outputs may change when a client disconnects',
    'spel.': 'for the simulation only: a SPEL+ program is in its files, not on the wire',
    'io': 'not queried (see --io), or no reply',
    'remote.': 'not queried: it needs an idle session until its timeout',
    'rtmc.': 'not queried: doctor is no client of Real-time Motion Control',
}
"""Reasons why keys were not measured. A name that ends with a dot applies to its whole section."""


def why_not(key: str) -> str:
    section = key[: key.rfind('.') + 1]
    return NOT_FOUND[key] if key in NOT_FOUND else NOT_FOUND[section]


def unknown(facts: Facts) -> list[str]:
    named = ('name', 'description', 'approximate')
    return [key for key in RULES if key not in facts and key not in named]


def profile_text(name: str, facts: Facts, like: str, about: str) -> str:
    missing = unknown(facts)
    data: dict[str, Any] = {
        'like': like,
        'name': name,
        'description': f'measured: {about}',
        'approximate': [
            f'{len(facts)} keys were measured, {len(missing)} were not and are those of {like}.'
        ],
    }
    for key in RULES:
        if key in facts:
            *sections, last = key.split('.')
            inner = data
            for section in sections:
                inner = inner.setdefault(section, {})
            inner[last] = _rounded(facts[key])
    lines = [f'# Made by epson_driver doctor --learn: {about}.', '#', '# Unknown:']
    lines += [f'# * {key}: {why_not(key)}' for key in missing]
    if 'io' in facts:
        lines.append(
            f'# * io: only the numbers of points were measured, all else is that of {like}'
        )
    body = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=100)
    return '\n'.join(lines) + '\n' + body


def differences(facts: Facts, profile: ControllerProfile) -> list[tuple[str, object, object]]:
    """Return each fact that differs from the profile: key, measured value and profile value."""
    result = []
    for key, value in facts.items():
        if key.startswith('ports.') or key in ('io', 'mode'):
            continue
        expected = value_of(profile, key)
        same = expected == value
        if isinstance(value, float) and isinstance(expected, float):
            same = abs(value - expected) <= tolerance(value, expected)
        if key == 'server.state_clients' or (key, expected) in _SEEN_IN_PART:
            continue
        if not same:
            result.append((key, value, expected))
    return result


_SEEN_IN_PART = {('program.motors', 'none'), ('program.motors', 'restart')}
"""Keys, each with a value that a measurement cannot contradict. `none`: Remote Ethernet may be
available, although the driver must not use it. `restart`: a program that must be stopped first is
detected only while it runs."""

TOLERANCE_FRACTION = 0.1
"""Relative tolerance of a measured time, in addition to its uncertainty."""


def tolerance(value: float, expected: float) -> float:
    return TOLERANCE_FRACTION * expected + getattr(value, 'uncertainty', 0.0)


def value_of(profile: ControllerProfile, key: str) -> object:
    result: Any = profile
    for name in key.split('.'):
        result = getattr(result, name)
    if key == 'byte_order':
        return 'little' if result.value == '<' else 'big'
    if key == 'mode':
        return result.name.lower()
    return getattr(result, 'value', result)


def _rounded(value: object) -> object:
    return float(f'{value:.4g}') if isinstance(value, float) else value
