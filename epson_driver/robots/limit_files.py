# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint limits of any arm, from its URDF, from MoveIt's joint_limits.yaml, or from a model."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from epson_driver.inputs import InputError, Rule, decimal, number, printable, read_yaml, shown
from epson_driver.motion import JointLimits
from epson_driver.robots.model import load_robot_model

MOVABLE = {'revolute': 'rad', 'continuous': 'rad', 'prismatic': 'm'}

ENDLESS = 1e4
"""Position limit of a continuous joint, ± rad, because JointLimits allows no infinite limit."""

_SIZE = number(-1e9, 1e9)
NUMBER = Rule(lambda value: _SIZE.read(decimal(str(value).strip())), _SIZE.text)
"""Rule for a number, or for a text that contains one, as in XML."""

QUANTITIES = ('position_min', 'position_max', 'velocity', 'acceleration', 'jerk')
OF_MOVEIT = {
    'velocity': ('max_velocity',),
    'acceleration': ('max_acceleration', 'max_deceleration'),
    'jerk': ('max_jerk',),
}
"""Quantity → keys of joint_limits.yaml that limit it. The smallest value applies."""

Rows = dict[str, dict[str, Any]]
"""Joint → its known limits: quantity → value in SI units, and its `unit`, rad or m."""


def urdf_limits(text: str) -> Rows:
    """Return the limits of a URDF's movable joints. Raises InputError if the text is invalid."""
    try:
        joints = ElementTree.fromstring(text).findall('joint')  # noqa: S314 - expat bounds it
    except ElementTree.ParseError as error:
        raise InputError(f'the robot description is not XML: {error}') from error
    rows: Rows = {}
    for joint in joints:
        name, kind, limit = joint.get('name', ''), joint.get('type', ''), joint.find('limit')
        if kind not in MOVABLE or joint.find('mimic') is not None:
            continue
        row = rows[name] = {'unit': MOVABLE[kind]}
        if kind == 'continuous':
            row |= {'position_min': -ENDLESS, 'position_max': ENDLESS}
        for key, quantity in {
            'lower': 'position_min',
            'upper': 'position_max',
            'velocity': 'velocity',
            'acceleration': 'acceleration',
            'jerk': 'jerk',
        }.items():
            value = None if limit is None else limit.get(key)
            if value is not None and (kind != 'continuous' or not key.endswith('er')):
                row[quantity] = NUMBER.checked(value, f'the robot description, {name}: {key}')
    return rows


def file_limits(name: str) -> Rows:
    """Return the limits of a robot model, or the limits in a joint_limits.yaml of MoveIt."""
    if name.endswith('.yaml'):
        values = read_yaml(Path(name))
        inside = (
            values.get('robot_description_planning', values) if isinstance(values, dict) else {}
        )
        if isinstance(inside, dict) and 'joint_limits' in inside:
            return dict(_moveit_rows(inside['joint_limits'], printable(name)))
    limits = load_robot_model(name).limits
    return {
        joint: {'unit': limits.units[i]} | {key: getattr(limits, key)[i] for key in QUANTITIES}
        for i, joint in enumerate(limits.names)
    }


def limits_of(
    joints: Sequence[str], rows: Mapping[str, Mapping[str, Any]], ratios: tuple[float, float]
) -> tuple[JointLimits, list[str]]:
    """Return the limits of some joints, and a sentence for each assumed limit.

    ratios: default acceleration per velocity limit, and jerk per acceleration limit, 1/s. Raises
    InputError if a position or velocity limit is missing.
    """
    result, assumed = [], []
    for joint in joints:
        row = dict(rows.get(joint, {}))
        for key in ('position_min', 'position_max', 'velocity'):
            if key not in row:
                raise InputError(
                    f'{joint}: no {key.replace("_", " ")} limit: publish the URDF on '
                    'robot_description, or set limits_file'
                )
        for key, base, ratio in zip(
            ('acceleration', 'jerk'), ('velocity', 'acceleration'), ratios, strict=True
        ):
            if key not in row:
                row[key] = ratio * row[base]
                assumed.append(f'{joint}: {key} {row[key]:g}, {ratio:g} times its {base}')
        result.append(row)
    columns = {key: np.array([row[key] for row in result], dtype=float) for key in QUANTITIES}
    units = tuple(row.get('unit', 'rad') for row in result)
    try:
        limits = JointLimits(tuple(joints), **columns, units=units)
    except ValueError as error:
        raise InputError(str(error)) from error
    return limits, assumed


def _moveit_rows(joints: Any, file: str) -> Iterator[tuple[str, dict[str, Any]]]:
    if not isinstance(joints, dict):
        raise InputError(f'{file}: joint_limits = {shown(joints)}: must be a mapping of joints')
    for name, limits in joints.items():
        if not isinstance(limits, dict):
            raise InputError(f'{file}: {name} = {shown(limits)}: must be a mapping of limits')
        row = {}
        if limits.get('has_position_limits', True):
            for key, end in (('min_position', 'position_min'), ('max_position', 'position_max')):
                if key in limits:
                    row[end] = NUMBER.checked(limits[key], f'{file}: {name}: {key}')
        for quantity, keys in OF_MOVEIT.items():
            values = [
                abs(NUMBER.checked(limits[key], f'{file}: {name}: {key}'))
                for key in keys
                if limits.get(f'has_{key.removeprefix("max_")}_limits', False) and key in limits
            ]
            if values:
                row[quantity] = min(values)
        yield name, row
