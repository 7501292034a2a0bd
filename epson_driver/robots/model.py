# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot model read from config/robots/NAME.yaml, validated."""

from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.inputs import InputError, printable, read_yaml
from epson_driver.motion import Array, JointLimits
from epson_driver.robots.chain import JOINT_TYPES, SHOWN_UNITS, UNITS, Chain, Frame, reach
from epson_driver.robots.reader import CONFIDENCES, Provenance, Range, Reader
from epson_driver.share import share_file, share_folder

POSITION_RANGE: Range = (-1000.0, 1000.0, 'rad or m')
"""159 turns, or a rail of 2 km."""

LIMIT_RANGE: Range = (1e-6, 1e6, 'in its unit')
"""Of velocities, accelerations and jerks (rad or m, per s, s² or s³). Below it, a move would take
days; above it, there is no such machine, and the smoother's times would be lost to rounding."""

LENGTH_RANGE: Range = (-100.0, 100.0, 'm')
ANGLE_RANGE: Range = (-10.0, 10.0, 'rad')
AXIS_RANGE: Range = (-1.0, 1.0, '')
PULSES_RANGE: Range = (-1e9, 1e9, 'pulses')
WEIGHT_RANGE: Range = (1e-3, 1e5, 'kg')

MIN_PULSES_PER_DEGREE = 1e-3
"""Per degree or mm; with fewer, a joint's whole range is less than one pulse."""

UNIT_TOLERANCE = 1e-9
"""How far the length of an axis vector may be from 1."""

MIN_JOINT_RANGE = 1e-6
"""The smallest difference between the position limits of a joint, rad or m."""

SIX_AXIS, SCARA = 'six-axis', 'SCARA'

_KINDS = {
    ('revolute',) * 6: SIX_AXIS,
    ('revolute', 'revolute', 'prismatic', 'revolute'): SCARA,
}


@dataclass(frozen=True, eq=False)
class RobotModel:
    """The data of one robot model; joints are in the controller's order.

    pulses_per_degree: shape (n,), encoder pulses per degree, per mm for a prismatic joint.
    joint_types: 'revolute' or 'prismatic'. chain: the joints, in base_link. tool0: the
    controller's Tool 0 in the last link's frame. base: EPSON's world in base_link. payload,
    mass: of the heaviest load and of the arm itself, kg, None if unknown. provenance: the source
    of each quantity, by its key in the file (without `limits.`).
    """

    name: str
    description: str
    limits: JointLimits
    pulses_per_degree: Array
    joint_types: tuple[str, ...]
    chain: Chain
    tool0: Frame
    base: Frame
    payload: float | None
    mass: float | None
    provenance: dict[str, Provenance]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints in the controller's order."""
        return self.limits.names

    @property
    def kind(self) -> str:
        """What kind of arm the joints make, in words."""
        return _KINDS.get(self.joint_types, f'{len(self.joint_types)} joints')

    @property
    def confidence(self) -> str:
        """The lowest confidence of all quantities."""
        return max((each.worst for each in self.provenance.values()), key=CONFIDENCES.index)

    @cached_property
    def reach(self) -> Array:
        """How far Tool 0 moves at most per unit of each joint, shape (n,), from the chain.

        For a revolute joint: Tool 0's largest distance from its axis, m; for a prismatic one 1.
        """
        limits = self.limits
        strokes = np.maximum(np.abs(limits.position_min), np.abs(limits.position_max))
        return reach(self.chain, self.joint_types, strokes, self.tool0.xyz)

    @cached_property
    def shown_per_unit(self) -> Array:
        """EPSON's units (degrees, mm) per SI unit, shape (n,)."""
        return np.array([SHOWN_UNITS[unit][1] for unit in self.limits.units])

    @cached_property
    def pulses_per_unit(self) -> Array:
        """Encoder pulses per rad, per m for a prismatic joint, shape (n,)."""
        return self.pulses_per_degree * self.shown_per_unit


def robot_models() -> tuple[str, ...]:
    """Return the names of all models in config/robots/, sorted."""
    return tuple(sorted(path.stem for path in share_folder('config', 'robots').glob('*.yaml')))


def load_robot_model(name: str) -> RobotModel:
    """Read config/robots/NAME.yaml, or the file itself if `name` is a path to a .yaml file.

    Names may be written as EPSON does, C4-A601S, and shortened where only one model begins so.
    Raises FileNotFoundError (which lists the models there are) or InputError.
    """
    path = Path(name) if name.endswith('.yaml') else _file_of(name)
    return _parse(read_yaml(path), path)


def _file_of(name: str) -> Path:
    """Return the file of a model. Raises FileNotFoundError that says which names are near."""
    models = robot_models()
    wanted = name.lower().replace('-', '_')
    found = (
        [wanted] if wanted in models else [m for m in models if wanted and m.startswith(wanted)]
    )
    if len(found) == 1:
        return share_file('config', 'robots', f'{found[0]}.yaml')
    try:
        return share_file('config', 'robots', f'{name}.yaml')
    except FileNotFoundError as error:
        near = found or get_close_matches(wanted, models)
        if not near:
            raise
        raise FileNotFoundError(f'{error}; did you mean {" or ".join(near)}?') from None


def _parse(data: Any, path: Path) -> RobotModel:
    reader = Reader(path)
    names = reader.names(data, 'joint_names')
    types = reader.choices(data, 'joint_types', JOINT_TYPES, len(names))
    columns, provenance = _limits(reader, data, len(names))
    pulses = reader.get(data, 'pulses_per_degree', dict)
    pulses_per_degree = reader.numbers(
        pulses, 'value', 'pulses_per_degree', len(names), PULSES_RANGE
    )
    if np.any(np.abs(pulses_per_degree) < MIN_PULSES_PER_DEGREE):
        rule = f'none may be less than {MIN_PULSES_PER_DEGREE:g}'
        raise reader.error('pulses_per_degree.value', pulses_per_degree.tolist(), rule)
    provenance['pulses_per_degree'] = reader.provenance(pulses, 'pulses_per_degree', len(names))
    chain = _chain(reader, data, len(names), provenance)
    tool0 = _frame(reader, data, 'tool0', provenance)
    base = _frame(reader, data, 'base', provenance, turned_only=True)
    payload = _weight(reader, data, 'payload', provenance)
    mass = _weight(reader, data, 'mass', provenance)
    try:
        limits = JointLimits(names, **columns, units=tuple(UNITS[kind] for kind in types))
    except ValueError as cause:
        raise InputError(f'{printable(path)}: {cause}') from cause
    for joint, width in zip(names, limits.position_max - limits.position_min, strict=True):
        if width < MIN_JOINT_RANGE:
            rule = f'the range of {joint} must be at least {MIN_JOINT_RANGE:g}'
            raise reader.error('limits.position', float(width), rule)
    return RobotModel(
        name=reader.get(data, 'name', str),
        description=reader.get(data, 'description', str),
        limits=limits,
        pulses_per_degree=pulses_per_degree,
        joint_types=types,
        chain=chain,
        tool0=tool0,
        base=base,
        payload=payload,
        mass=mass,
        provenance=provenance,
    )


def _limits(
    reader: Reader, data: Any, count: int
) -> tuple[dict[str, Array], dict[str, Provenance]]:
    limits = reader.get(data, 'limits', dict)
    columns: dict[str, Array] = {}
    provenance: dict[str, Provenance] = {}
    for quantity in ('position', 'velocity', 'acceleration', 'jerk'):
        where = f'limits.{quantity}'
        block = reader.get(limits, quantity, dict, 'limits.')
        if quantity == 'position':
            columns['position_min'] = reader.numbers(block, 'min', where, count, POSITION_RANGE)
            columns['position_max'] = reader.numbers(block, 'max', where, count, POSITION_RANGE)
        else:
            columns[quantity] = reader.numbers(block, 'max', where, count, LIMIT_RANGE)
        provenance[quantity] = reader.provenance(block, where, count)
    return columns, provenance


def _chain(reader: Reader, data: Any, count: int, provenance: dict[str, Provenance]) -> Chain:
    block = reader.get(data, 'chain', dict)
    origins = reader.vectors(block, 'origins', 'chain', count, LENGTH_RANGE)
    axes = reader.vectors(block, 'axes', 'chain', count, AXIS_RANGE)
    for axis in axes:
        if abs(np.linalg.norm(axis) - 1.0) > UNIT_TOLERANCE:
            raise reader.error('chain.axes', axis.tolist(), 'must have length 1')
    provenance['chain'] = reader.provenance(block, 'chain')
    return Chain(origins, axes)


def _frame(
    reader: Reader,
    data: Any,
    key: str,
    provenance: dict[str, Provenance],
    *,
    turned_only: bool = False,
) -> Frame:
    block = reader.get(data, key, dict)
    xyz = np.zeros(3)
    if not turned_only:
        xyz = reader.numbers(block, 'xyz', key, 3, LENGTH_RANGE, 'x, y and z')
    rpy = reader.numbers(block, 'rpy', key, 3, ANGLE_RANGE, 'roll, pitch and yaw')
    provenance[key] = reader.provenance(block, key)
    return Frame(xyz, rpy)


def _weight(
    reader: Reader, data: Any, key: str, provenance: dict[str, Provenance]
) -> float | None:
    if key not in data:
        return None
    block = reader.get(data, key, dict)
    provenance[key] = reader.provenance(block, key)
    return reader.number(block, 'value', key, WEIGHT_RANGE)
