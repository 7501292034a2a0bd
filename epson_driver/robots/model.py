# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot model, read from config/robots/ or from a user's file, and validated."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from epson_driver.inputs import number
from epson_driver.motion import Array, JointLimits
from epson_driver.robots.catalogue import layers, model_name
from epson_driver.robots.chain import (
    JOINT_TYPES,
    PRISMATIC,
    SHOWN_UNITS,
    UNITS,
    Chain,
    Frame,
    reach,
)
from epson_driver.robots.reader import MARKS, Provenance, Range, Reader

POSITION_RANGE: Range = (-6e4, 6e4, 'degrees or mm')
"""Range of position limits: 166 turns, or 60 m of a rail, in each direction."""

SPEED_RANGE: Range = (1e-3, 1e7, 'degrees/s or mm/s')
LIMIT_RANGE: Range = (1e-6, 1e6, 'in its unit')
"""Range of accelerations and jerks. With smaller values, a move would take days. No machine has
larger ones, and the smoother's times would be lost to rounding."""

LENGTH_RANGE: Range = (-1e5, 1e5, 'mm')
ANGLE_RANGE: Range = (-600.0, 600.0, 'degrees')
AXIS_RANGE: Range = (-1.0, 1.0, '')
PULSES_RANGE: Range = (-1e9, 1e9, 'pulses')
WEIGHT_RANGE: Range = (1e-3, 1e5, 'kg')

MAX_PAYLOAD_KG = 1000.0
"""Maximum payload if the model's data contains no payload."""

XYZ = ('x', 'y', 'z')
RADIANS = np.pi / 180.0

JERK_PER_ACCELERATION = 10.0
"""Default ratio of jerk to acceleration, 1/s: an acceleration ramp takes 0.1 s."""

ASSUMED_JERK = Provenance(
    'ten times the acceleration per second, a ramp of 0.1 s (no published value)', (MARKS[-1],)
)

MIN_PULSES_PER_DEGREE = 1e-3
"""Minimum number of pulses per degree or mm. With fewer pulses, a range could be less than a
pulse."""

UNIT_TOLERANCE = 1e-9
"""Maximum deviation of an axis vector's length from 1."""

MAX_IN_RADIANS = 26.0
"""Angle in degrees that every arm exceeds. If no joint can turn this far, the ranges are probably
in rad."""

LEAST_LENGTH_M = 0.02
"""Minimum sum of a chain's lengths. If the sum is smaller, the lengths are probably in m, not in
mm."""

MIN_RANGE = 1e-4

SIX_AXIS, SCARA = 'six-axis', 'SCARA'

_KINDS = {
    ('revolute',) * 6: SIX_AXIS,
    ('revolute', 'revolute', 'prismatic', 'revolute'): SCARA,
}


@dataclass(frozen=True, eq=False)
class RobotModel:
    """The data of one robot model, with joints in the controller's order.

    * pulses_per_degree: encoder pulses per degree, or per mm for a prismatic joint (NaN: unknown).
    * tool0: the controller's Tool 0 in the last link's frame.
    * base: EPSON's world frame in base_link.
    * payload, mass: kg.
    * provenance: key of a quantity in the file, without the unit → the source of the quantity.
    * file: the name or path from which the model was loaded.
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
    file: str

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self.limits.names

    @property
    def sales_name(self) -> str:
        return self.name.upper().replace('_', '-')

    @property
    def kind(self) -> str:
        return _KINDS.get(self.joint_types, f'{len(self.joint_types)} joints')

    @property
    def cautions(self) -> tuple[str, ...]:
        """Range, speed and length values that are not confirmed, one sentence for each."""
        nouns = {'range': 'ranges', 'speed': 'speeds', 'origins': 'lengths', 'heights': 'heights'}
        result = {words: self.provenance.get(key) for key, words in nouns.items()}
        return tuple(
            f'{words} of the {self.name} are {origin.worst} ({origin.source}): compare them with '
            'yours before the arm moves'
            for words, origin in result.items()
            if origin is not None and origin.worst in MARKS[2:]
        )

    def checked_payload(self, payload: float, field: str = 'payload') -> float:
        rule = number(0.0, MAX_PAYLOAD_KG if self.payload is None else self.payload, 'kg')
        return float(rule.checked(payload, field))

    @cached_property
    def reach(self) -> Array:
        """Maximum distance that Tool 0 moves per unit of each joint, shape (n,).

        The unit is m/rad for revolute joints and m/m for prismatic joints.
        """
        limits = self.limits
        strokes = np.maximum(np.abs(limits.position_min), np.abs(limits.position_max))
        return reach(self.chain, self.joint_types, strokes, self.tool0.xyz)

    @cached_property
    def shown_per_unit(self) -> Array:
        """Factors from SI units to EPSON's units, degrees or mm, shape (n,)."""
        return np.array([SHOWN_UNITS[unit][1] for unit in self.limits.units])

    @cached_property
    def pulses_per_unit(self) -> Array:
        """Encoder pulses per rad, or per m for a prismatic joint, shape (n,), NaN if unknown."""
        return self.pulses_per_degree * self.shown_per_unit


def load_robot_model(name: str) -> RobotModel:
    """Read a model of config/robots/, or the file itself if `name` is a path to a .yaml file.

    `model_name` lists the accepted names. Raises InputError if the name or the data are invalid.
    """
    name = model_name(name)
    made_of = layers(name)
    reader = Reader(made_of)
    count = len(reader.get('origins_mm', list))
    types = reader.choices('joint_types', JOINT_TYPES, count)
    keys = _keys(types)
    reader.check_keys([*OTHER_KEYS, *keys.values()])
    reader.check_sources(QUANTITIES)
    row = made_of[-1].where
    listed = f'EPSON {row[-1]}, ' if row else ''
    return RobotModel(
        name=name if row else reader.get('name', str),
        description=listed + reader.get('description', str, 'a model of its own'),
        limits=_limits(reader, keys, types),
        pulses_per_degree=_pulses(reader, keys['pulses'], count),
        joint_types=types,
        chain=_chain(reader, count),
        tool0=_frame(reader, 'tool0'),
        base=_frame(reader, 'world'),
        payload=_weight(reader, 'payload_kg'),
        mass=_weight(reader, 'mass_kg'),
        provenance=_provenance(reader, keys, count),
        file=name,
    )


QUANTITIES = (
    *('range', 'speed', 'acceleration', 'jerk', 'pulses'),
    *('origins', 'heights', 'tool0', 'world', 'payload', 'mass'),
)
"""Quantities that have a source: their keys without the units. The key `origins_mm` includes
`heights`."""

OTHER_KEYS = (
    *('name', 'description', 'like', 'sources', 'joint_names', 'joint_types', 'zero_outside'),
    *('origins_mm', 'axes', 'tool0_mm', 'tool0_deg', 'world_mm', 'world_deg'),
    *('payload_kg', 'mass_kg'),
)


def _keys(types: tuple[str, ...]) -> dict[str, str]:
    """Return the key in the file for each quantity of the joints. The key contains the units."""
    mixed = PRISMATIC in types
    shown, si = ('deg_mm', 'rad_m') if mixed else ('deg', 'rad')
    return {
        'range': f'range_{shown}',
        'speed': f'speed_{shown}_s',
        'acceleration': f'acceleration_{si}_s2',
        'jerk': f'jerk_{si}_s3',
        'pulses': f'pulses_per_{shown}',
    }


def _si(values: Array, types: tuple[str, ...]) -> Array:
    turns = np.array([item != PRISMATIC for item in types]).reshape(-1, *[1] * (values.ndim - 1))
    return np.where(turns, values * RADIANS, values / 1e3)


def _limits(reader: Reader, keys: dict[str, str], types: tuple[str, ...]) -> JointLimits:
    count = len(types)
    names = reader.names('joint_names', count)
    ranges = reader.vectors(keys['range'], count, POSITION_RANGE, ('the lowest', 'the highest'))
    zero_outside = reader.get('zero_outside', bool, False)
    for name, (low, high) in zip(names, ranges.tolist(), strict=True):
        if high - low < MIN_RANGE:
            rule = f'{low:g} … {high:g} of {name} must be a range from low to high'
            raise reader.error(keys['range'], ranges.tolist(), rule)
        if not low <= 0.0 <= high and not zero_outside:
            rule = f'0 is outside {low:g} … {high:g} of {name}: zero_outside: true if correct'
            raise reader.error(keys['range'], ranges.tolist(), rule)
    turns = [
        high - low for (low, high), kind in zip(ranges, types, strict=True) if kind != PRISMATIC
    ]
    if turns and max(turns) < MAX_IN_RADIANS:
        rule = f'no joint turns by more than {max(turns):g} degrees: are these radians?'
        raise reader.error(keys['range'], ranges.tolist(), rule)
    acceleration = reader.numbers(keys['acceleration'], count, LIMIT_RANGE)
    jerk = acceleration * JERK_PER_ACCELERATION
    if reader.has(keys['jerk']):
        jerk = reader.numbers(keys['jerk'], count, LIMIT_RANGE)
    position_min, position_max = _si(ranges, types).T
    return JointLimits(
        names,
        position_min=position_min,
        position_max=position_max,
        velocity=_si(reader.numbers(keys['speed'], count, SPEED_RANGE), types),
        acceleration=acceleration,
        jerk=jerk,
        units=tuple(UNITS[kind] for kind in types),
    )


def _pulses(reader: Reader, key: str, count: int) -> Array:
    if not reader.has(key):
        return np.full(count, np.nan)
    pulses = reader.numbers(key, count, PULSES_RANGE, unknown=True)
    if np.any(np.abs(pulses) < MIN_PULSES_PER_DEGREE):
        rule = f'must be at least {MIN_PULSES_PER_DEGREE:g}'
        raise reader.error(key, pulses.tolist(), rule)
    return pulses


def _chain(reader: Reader, count: int) -> Chain:
    axes = reader.vectors('axes', count, AXIS_RANGE, XYZ)
    for axis in axes:
        if abs(np.linalg.norm(axis) - 1.0) > UNIT_TOLERANCE:
            raise reader.error('axes', axis.tolist(), 'must have length 1')
    origins = reader.vectors('origins_mm', count, LENGTH_RANGE, XYZ) / 1e3
    length = float(np.linalg.norm(origins, axis=1).sum())
    if 0.0 < length < LEAST_LENGTH_M:
        rule = f'the whole arm is {length * 1e3:g} mm long: are these metres?'
        raise reader.error('origins_mm', (origins * 1e3).tolist(), rule)
    return Chain(origins, axes)


def _frame(reader: Reader, key: str) -> Frame:
    xyz = reader.numbers(f'{key}_mm', 3, LENGTH_RANGE, 'x, y and z')
    rpy = reader.numbers(f'{key}_deg', 3, ANGLE_RANGE, 'roll, pitch and yaw')
    return Frame(xyz / 1e3, rpy * RADIANS)


def _weight(reader: Reader, key: str) -> float | None:
    return reader.number(key, WEIGHT_RANGE) if reader.has(key) else None


def _provenance(reader: Reader, keys: dict[str, str], count: int) -> dict[str, Provenance]:
    result = {}
    for quantity in QUANTITIES:
        key = keys.get(quantity, '')
        if quantity == 'jerk' and not reader.has(key):
            result[quantity] = ASSUMED_JERK
        elif quantity in ('pulses', 'payload', 'mass') and not reader.has(key or f'{quantity}_kg'):
            continue  # not known
        elif quantity != 'heights' or reader.has_source(quantity):
            result[quantity] = reader.provenance(quantity, count if key else 1)
    return result


SIX_AXES, RS_SERIES, N_SERIES = 5, 6, 7
_JOINT_ROBOT, _SCARA = 1, 3


def robot_type(model: RobotModel) -> int:
    """Return EPSON's number for the type of arm, as in SPEL+'s RobotType and in GetRobotInfo."""
    origins = model.chain.origins
    if model.kind == SCARA:
        return RS_SERIES if origins[1, 2] < 0.0 else _SCARA  # arms below each other
    if model.kind == SIX_AXIS:
        return N_SERIES if origins[2, 0] < 0.0 else SIX_AXES  # the upper arm points back at zero
    return _JOINT_ROBOT
