# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot model read from config/robots/NAME.yaml, validated."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from epson_driver.motion import Array, JointLimits
from epson_driver.share import share_file

CONFIDENCES = ('high', 'medium', 'low')


class RobotModelError(ValueError):
    """A model file that cannot be used. The text names the file, the key and the value."""


@dataclass(frozen=True)
class Provenance:
    """Where a quantity's numbers come from, and how far each joint's can be trusted."""

    source: str
    confidence: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class RobotModel:
    """Data of one robot model. `pulses_per_degree` and `reach` have shape (n,).

    `reach` is the largest distance of Tool 0 from each joint's axis, m. `provenance` maps
    position, velocity, acceleration, jerk, pulses_per_degree and reach to their source.
    """

    name: str
    description: str
    limits: JointLimits
    pulses_per_degree: Array
    reach: Array
    provenance: dict[str, Provenance]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints in the controller's order."""
        return self.limits.names


def load_robot_model(name: str) -> RobotModel:
    """Read config/robots/NAME.yaml, or the file itself if `name` is a path to a .yaml file.

    Raises FileNotFoundError (which lists the models there are) or RobotModelError.
    """
    path = Path(name) if name.endswith('.yaml') else share_file('config', 'robots', name + '.yaml')
    with path.open(encoding='utf-8') as file:
        try:
            data = yaml.safe_load(file)
        except (yaml.YAMLError, ValueError) as cause:  # ValueError: not UTF-8, no such date
            raise RobotModelError(f'{path}: not YAML: {cause}') from cause
    return _parse(data, path)


def _parse(data: Any, path: Path) -> RobotModel:
    reader = _Reader(path)
    names = reader.names(data, 'joint_names')
    limits = reader.get(data, 'limits', dict)
    columns: dict[str, Array] = {}
    provenance: dict[str, Provenance] = {}
    for quantity in ('position', 'velocity', 'acceleration', 'jerk'):
        where = f'limits.{quantity}'
        block = reader.get(limits, quantity, dict, 'limits.')
        if quantity == 'position':
            columns['position_min'] = reader.numbers(block, 'min', where, len(names))
            columns['position_max'] = reader.numbers(block, 'max', where, len(names))
        else:
            columns[quantity] = reader.numbers(block, 'max', where, len(names))
        provenance[quantity] = reader.provenance(block, where, len(names))
    pulses = reader.get(data, 'pulses_per_degree', dict)
    pulses_per_degree = reader.numbers(pulses, 'value', 'pulses_per_degree', len(names))
    if np.any(pulses_per_degree == 0.0):
        raise reader.error('pulses_per_degree.value', pulses_per_degree.tolist(), 'must not be 0')
    provenance['pulses_per_degree'] = reader.provenance(pulses, 'pulses_per_degree', len(names))
    reaches = reader.get(data, 'reach', dict)
    reach = reader.numbers(reaches, 'value', 'reach', len(names))
    if np.any(reach < 0.0):
        raise reader.error('reach.value', reach.tolist(), 'must not be negative')
    provenance['reach'] = reader.provenance(reaches, 'reach', len(names))
    try:
        joint_limits = JointLimits(names, **columns)
    except ValueError as cause:
        raise RobotModelError(f'{path}: {cause}') from cause
    return RobotModel(
        name=reader.get(data, 'name', str),
        description=reader.get(data, 'description', str),
        limits=joint_limits,
        pulses_per_degree=pulses_per_degree,
        reach=reach,
        provenance=provenance,
    )


class _Reader:
    """Typed access to the keys of one file, with errors that name file, key and value."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def error(self, key: str, value: object, rule: str) -> RobotModelError:
        return RobotModelError(f'{self._path}: {key} = {value!r}: {rule}')

    def get(self, block: Any, key: str, kind: type, where: str = '') -> Any:
        if not isinstance(block, dict):
            raise self.error(where.rstrip('.') or 'the file', block, 'must be a mapping')
        if key not in block:
            raise RobotModelError(f'{self._path}: {where}{key} is missing')
        if not isinstance(block[key], kind):
            raise self.error(where + key, block[key], f'must be a {kind.__name__}')
        return block[key]

    def names(self, block: Any, key: str) -> tuple[str, ...]:
        names = self.get(block, key, list)
        if not names or not all(isinstance(name, str) for name in names):
            raise self.error(key, names, 'must be a list of names')
        return tuple(names)

    def numbers(self, block: Any, key: str, where: str, count: int) -> Array:
        values = self.get(block, key, list, where + '.')
        if len(values) != count:
            raise self.error(f'{where}.{key}', values, f'must have {count} numbers, one per joint')
        for value in values:
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise self.error(f'{where}.{key}', value, 'must be a number')
            if not abs(value) <= sys.float_info.max:
                raise self.error(f'{where}.{key}', value, 'must be finite')
        return np.array(values, dtype=float)

    def provenance(self, block: Any, where: str, count: int) -> Provenance:
        confidence = block.get('confidence')
        entries = confidence if isinstance(confidence, list) else [confidence] * count
        if len(entries) != count or any(entry not in CONFIDENCES for entry in entries):
            rule = f'must be one of {", ".join(CONFIDENCES)}, or a list of one per joint'
            raise self.error(f'{where}.confidence', confidence, rule)
        return Provenance(self.get(block, 'source', str, where + '.'), tuple(entries))
