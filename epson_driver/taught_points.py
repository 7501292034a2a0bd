# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Taught points in mm and degrees, by name, in files of RC+ (.pts) or of this package (.yaml).

Saving to a .pts file preserves content that this module does not know. A file without a changed
point stays identical byte by byte. A .yaml file has X Y Z U V W, in mm and degrees, by name:

    pick: {x: 350.0, y: 20.0, z: -30.0, u: 45.0, v: 0.0, w: 0.0}

A .csv file has the columns of `COLUMNS`: all data of the points in a .pts file, in Latin-1.
"""

import codecs
import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import atan2, ceil, degrees, hypot, pi, sin
from os import PathLike
from pathlib import Path
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from epson_driver.inputs import (
    ArgumentError,
    InputError,
    count,
    near_names,
    number,
    printable,
    read_file,
    read_yaml,
    shown,
    write_file,
)
from epson_driver.inputs.rc_files import Block, parsed, quoted, sealed
from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw, uvw
from epson_driver.robots.model import SCARA
from epson_driver.robots.opw import KinematicsError, opw_parameters
from epson_driver.tool_motion.tool_pose import finite_numbers, homogeneous

_LENGTH = number(-1e6, 1e6, 'mm')
_ANGLE = number(-36000.0, 36000.0, 'degrees')
_COUNT = count(1, 32767)


@dataclass(frozen=True)
class EpsonPoint:
    """A point as shown on a teach pendant: X, Y, Z in mm, and U, V, W in degrees.

    The point is in EPSON's world coordinate system, unless a method with a `frame` takes it. V and
    W are 0 on a SCARA. Raises ArgumentError if an argument is invalid.
    """

    x: float
    y: float
    z: float
    u: float = 0.0
    v: float = 0.0
    w: float = 0.0

    def __post_init__(self) -> None:
        for name in ('x', 'y', 'z'):
            _LENGTH.argument(plain(getattr(self, name)), name)
        for name in ('u', 'v', 'w'):
            _ANGLE.argument(plain(getattr(self, name)), name)

    @property
    def xyz(self) -> Array:
        """The position, shape (3,), mm."""
        return np.array([self.x, self.y, self.z])

    @property
    def pose(self) -> Array:
        """The point as a homogeneous matrix, shape (4, 4), m."""
        angles = np.radians([self.u, self.v, self.w])
        return homogeneous(rotation_of_uvw(angles), self.xyz / 1e3)

    def moved(
        self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0, u: float = 0.0
    ) -> 'EpsonPoint':
        """Return the point shifted by x, y, z (mm) and u (degrees), like `P1 +Z(50)` in SPEL+."""
        for name, value in (('x', x), ('y', y), ('z', z)):
            _LENGTH.argument(plain(value), name)
        _ANGLE.argument(plain(u), 'u')
        return replace(self, x=self.x + x, y=self.y + y, z=self.z + z, u=self.u + u)

    def before(self, distance: float) -> 'EpsonPoint':
        """Return an approach point, which is `distance` mm before this point on its Z axis."""
        pose = self.pose
        pose[:3, 3] -= pose[:3, 2] * (_LENGTH.argument(plain(distance), 'distance') / 1e3)
        return EpsonPoint.of(pose)

    @classmethod
    def of(cls, pose: npt.ArrayLike) -> 'EpsonPoint':
        """Return the point for a homogeneous matrix, shape (4, 4), m.

        Raises ArgumentError if the shape is different or a number is not finite.
        """
        try:
            pose = finite_numbers('pose', pose)
        except ValueError as error:
            raise ArgumentError(str(error)) from error
        if pose.shape != (4, 4):
            raise ArgumentError(f'pose has shape {pose.shape}: must be (4, 4), m')
        return cls(*(pose[:3, 3] * 1e3).tolist(), *np.degrees(uvw(pose[:3, :3])).tolist())


@dataclass(frozen=True)
class Pallet(Sequence[EpsonPoint]):
    """Points in columns and rows between taught corners, in the order of the rows.

    * first: the corner at which the first row and the first column begin.
    * row_end, column_end: the corners at which the first row and the first column end.
    * opposite: the fourth corner, or None for a parallelogram.

    Indices start at 0, unlike in SPEL+'s Pallet, where they start at 1. All points have the
    orientation of `first`. Raises ArgumentError if an argument is invalid.
    """

    first: EpsonPoint
    row_end: EpsonPoint
    column_end: EpsonPoint
    columns: int
    rows: int
    opposite: EpsonPoint | None = None

    def __post_init__(self) -> None:
        for name in ('columns', 'rows'):
            _COUNT.argument(plain(getattr(self, name)), name)
        for name in ('first', 'row_end', 'column_end', 'opposite'):
            corner = getattr(self, name)
            if not isinstance(corner, EpsonPoint) and (corner, name) != (None, 'opposite'):
                raise ArgumentError(f'{name} = {shown(corner)}: must be an EpsonPoint')

    def __len__(self) -> int:
        return self.columns * self.rows

    @overload
    def __getitem__(self, index: int) -> EpsonPoint: ...
    @overload
    def __getitem__(self, index: slice) -> list[EpsonPoint]: ...
    def __getitem__(self, index: int | slice) -> EpsonPoint | list[EpsonPoint]:
        if isinstance(index, slice):
            return [self[item] for item in range(len(self))[index]]
        row, column = divmod(range(len(self))[index], self.columns)
        across, along = column / max(self.columns - 1, 1), row / max(self.rows - 1, 1)
        a, b, c = (corner.xyz for corner in (self.first, self.row_end, self.column_end))
        d = b + c - a if self.opposite is None else self.opposite.xyz
        x, y, z = (a + across * (b - a) + along * (c - a + across * (d - c - b + a))).tolist()
        return replace(self.first, x=x, y=y, z=z)


def plain(value: object) -> object:
    return value.item() if isinstance(value, np.generic) else value


Posture = dict[str, int]
"""Flags of hand, elbow and wrist, by their keys in a .pts file. A missing flag is 0."""


def posture(model: RobotModel, joints: Array) -> Posture:
    """Return the posture flags for joint positions, shape (n,), rad (m).

    In .pts files, hand 1 is right and 2 left, elbow 1 is above and 2 below. Wrist 1 is the home
    pose with the tool down, 2 is flipped. These values come from public .pts files and from
    programs that write such files. They were not checked on a controller. Raises ValueError if the
    sources disagree about this arm, or do not describe this arm.
    """
    low, high = (-pi / 2.0, pi) if model.name.startswith('rs') else (-pi, pi)
    if not low <= joints[0] <= high:
        raise ValueError(
            f'joint 1 is outside {degrees(low):.0f} … {degrees(high):.0f} degrees, the only range '
            'in which its flag is known'
        )
    if model.kind == SCARA:
        return {'nHand': 1 if joints[1] >= 0.0 else 2, 'nElbow': 1, 'nWrist': 1}
    if model.name.startswith('n'):
        raise ValueError('the posture flags of the N series are unknown')
    try:
        parameters = opw_parameters(model)
    except KinematicsError as error:
        raise ValueError('the flags of this kind of arm are unknown') from error
    a1, a2, _, _, c2, c3, _ = parameters.lengths.values()
    _, second, third, _, fifth, _ = (
        sign * value - offset
        for sign, value, offset in zip(
            parameters.signs, joints.tolist(), parameters.offsets, strict=True
        )
    )
    turn = third + atan2(a2, c3)
    if a1 + c2 * sin(second) + hypot(a2, c3) * sin(second + turn) < 0.0:
        raise ValueError('the posture flags of an arm that reaches over its shoulder are unknown')
    return {
        'nHand': 1,
        'nElbow': 1 if sin(turn) >= 0.0 else 2,
        'nWrist': 1 if fifth >= 0.0 else 2,
        'nJ4Flag': _half_turns(joints[3]),
        'nJ6Flag': _half_turns(joints[5]),
    }


def taught(arm: Kinematics, joints: Array) -> tuple[EpsonPoint, Posture | str]:
    """Return the tool's point and the arm's posture for joint positions, shape (n,).

    If the posture is unknown, the reason is returned as a text instead.
    """
    point = EpsonPoint.of(arm.in_base(arm.forward(joints)))
    try:
        return point, posture(arm.model, joints)
    except ValueError as error:
        return point, str(error)


def _half_turns(angle: float) -> int:
    """Return the number of half turns by which an angle, rad, exceeds ±π.

    The result is 0 up to ±π, 1 up to ±2π, and so on.
    """
    return max(ceil(abs(angle) / pi) - 1, 0)


LAST_NUMBER = 999
MAX_LABEL_CHARACTERS = 16
MAX_BYTES = 4_000_000
"""Maximum size of a .pts file, bytes: about ten times the size of a file with 1000 points."""

_NAME = re.compile(r'(?!p\d+$)[A-Za-z_]\w{0,31}', re.ASCII | re.IGNORECASE)
_AXES = 'XYZUVW'
_FLAGS = ('nHand', 'nElbow', 'nWrist', 'nJ1Flag', 'nJ2Flag', 'nJ4Flag', 'nJ6Flag')
_KEYS = (
    *('nNumber', 'sLabel', 'sDescription', 'nUndefined', 'rX', 'rY', 'rZ', 'rU', 'rV', 'rW'),
    *('rR', 'rS', 'rT', 'nLocal', *_FLAGS, 'rJ1Angle', 'rJ4Angle', 'bSimVisible'),
)
"""The keys of a point in a .pts file, in their order. The first letter is the type: n or r for a
number, s for a string, b for a boolean."""

COLUMNS = tuple(key[1:] for key in _KEYS)
_NEEDED = ('Number', 'X', 'Y', 'Z', 'Hand', 'Elbow', 'Wrist')
"""Columns that a .csv file must have. Other columns default to 0, '' or True."""

_SHOWN = {
    'nHand': {1: '/R', 2: '/L'},
    'nElbow': {1: '/A', 2: '/B'},
    'nWrist': {1: '/NF', 2: '/F'},
}
_NO_PLACE = 0xF
"""Bits of nUndefined that mark X, Y, Z or U as undefined."""

_ONLY_PLACE = '448'
"""nUndefined of a point that has all of X to W. Only R, S and T are undefined."""


@dataclass(frozen=True)
class _StoredPoint:
    """A named point.

    * point: the position, or None if only the label exists.
    * number, block: the point's number and `Block` in a .pts file.
    * posture: the arm's posture at the point, a text with the reason why the posture is unknown,
      or None if `block` contains the posture.
    * why: the reason why the point cannot be used, or ''.
    """

    name: str
    point: EpsonPoint | None
    number: int = -1
    block: Block | None = None
    posture: Posture | str | None = None
    why: str = ''


class UnknownPointError(ArgumentError, KeyError):
    """No point has this name."""

    __str__ = Exception.__str__  # KeyError's would put the text in quotes


class TaughtPoints:
    """Taught points. Names are case-insensitive. P and a number also identify a point: `P3`."""

    def __init__(self) -> None:
        self._points: dict[str, _StoredPoint] = {}
        self._file: tuple[bytes, Block] | None = None
        self._changed = False

    def get(self, name: str) -> EpsonPoint:
        """Return a point.

        Raises KeyError if the name is unknown, InputError if the point is unusable.
        """
        stored = self._existing(name)
        if stored.point is None or stored.why:
            raise InputError(f'point {name} {stored.why or "is not taught yet"}')
        return stored.point

    def set(self, name: str, point: EpsonPoint, taught: Posture | str | None = None) -> None:
        """Set or add a point. `taught`: the arm's posture at it, or why the posture is unknown.

        Raises InputError if the name or the point is invalid, or if the existing point cannot be
        used.
        """
        if not isinstance(point, EpsonPoint):
            raise InputError(f'point {name} = {shown(point)}: must be an EpsonPoint')
        stored = self._find(name)
        if stored is None:
            if not isinstance(name, str) or not _NAME.fullmatch(name):
                raise InputError(
                    f'name = {shown(name)}: must be a word of letters, digits and _, not P and a '
                    'number'
                )
            stored = _StoredPoint(name, None)
        if stored.why:
            raise InputError(f'point {name} {stored.why}')
        self._points[stored.name.lower()] = replace(
            stored, point=point, posture=stored.posture if taught is None else taught
        )
        self._changed = True

    def remove(self, name: str) -> None:
        """Delete a point. Raises KeyError if the name is unknown."""
        del self._points[self._existing(name).name.lower()]
        self._changed = True

    def __iter__(self) -> Iterator[str]:
        return iter([stored.name for stored in self._points.values()])

    def __len__(self) -> int:
        return len(self._points)

    def __contains__(self, name: object) -> bool:
        """Return whether a point exists, with or without a position."""
        return isinstance(name, str) and self._find(name) is not None

    @property
    def places(self) -> dict[str, EpsonPoint]:
        """The points that have a usable position, by name."""
        stored = self._points.values()
        return {item.name: item.point for item in stored if item.point and not item.why}

    def load(self, path: str | PathLike[str]) -> int:
        """Replace all points by the points in a .pts, .csv or .yaml file, and return their number.

        Raises InputError if the file cannot be read or is invalid.
        """
        file = Path(path)
        read = _READERS.get(file.suffix.lower())
        if read is None:
            raise InputError(f'{printable(file)}: {_SUFFIXES}')
        self._points, self._file = read(file)
        self._changed = False
        return len(self)

    def save(self, path: str | PathLike[str]) -> None:
        """Write all points to a .pts, .csv or .yaml file.

        Unchanged content of a .pts file is preserved. Raises OSError if the file cannot be
        written, InputError if its format does not support a point.
        """
        file = Path(path)
        if file.suffix.lower() not in _READERS:
            raise InputError(f'{printable(file)}: {_SUFFIXES}')
        write_file(file, self.content(file.suffix.lower()))

    def content(self, suffix: str) -> bytes:
        """Return the content of a file with this `suffix`.

        Raises the same InputError as `save`.
        """
        if suffix == '.pts':
            return self._pts()
        if suffix == '.csv':
            text = io.StringIO()
            writer = csv.writer(text, lineterminator='\n')
            writer.writerow(COLUMNS)
            for block in self._blocks():
                writer.writerow([_column(block, key) for key in _KEYS])
            return text.getvalue().encode('latin-1')
        return ''.join(map(_yaml_line, self._points.values())).encode()

    def table(self) -> Iterator[tuple[str, ...]]:
        """Yield for each point: number, label, X to W, flags as in SPEL+, and description.

        Raises InputError if a point has no posture, like the points of a .yaml file.
        """
        for block in self._blocks():
            undefined = int(block.number('nUndefined'))
            axes = (
                '-' if undefined >> place & 1 else f'{block.number(f"r{axis}"):.3f}'
                for place, axis in enumerate(_AXES)
            )
            flags = [names.get(int(block.number(key)), '') for key, names in _SHOWN.items()]
            flags += (
                f'/{key[1:3]}F{turns}'
                for key in _FLAGS[3:]
                if (turns := block.text(key, '0')) != '0'
            )
            flags += (
                f'/J{joint}A({angle:g})'
                for joint in (1, 4)
                if (angle := block.number(f'rJ{joint}Angle'))
            )
            if local := int(block.number('nLocal')):
                flags.append(f'/{local}')
            about = block.text('sDescription')
            label = block.text('sLabel')
            yield (
                f'P{int(block.number("nNumber"))}',
                label,
                *axes,
                ' '.join(filter(None, flags)),
                about,
            )

    def _existing(self, name: str) -> _StoredPoint:
        stored = self._find(name)
        if stored is None:
            names = ', '.join(near_names(name, [*self]))
            known = f'the points are {names}' if names else 'teach or load it'
            raise UnknownPointError(f'no point named {name}: {known}')
        return stored

    def _find(self, name: str) -> _StoredPoint | None:
        if not isinstance(name, str):
            raise InputError(f'name = {shown(name)}: must be a string')
        low = name.lower()
        if low[:1] == 'p' and low[1:].isdecimal():
            numbered = (point for point in self._points.values() if point.number == int(low[1:]))
            return next(numbered, None)
        return self._points.get(low)

    def _pts(self) -> bytes:
        if self._file is not None and not self._changed:
            return self._file[0]
        items: list[Any] = [('sVersion', '"2.0.0"'), ('nNumberOfPoints', '0')]
        if self._file is not None:
            items = [
                element for element in self._file[1].items if not _is_point_or_header(element)
            ]
        blocks = self._blocks()
        items = [
            item
            if isinstance(item, Block) or item[0] != 'nNumberOfPoints'
            else (item[0], str(len(blocks)))
            for item in items
        ]
        return sealed(Block('', [*items, *blocks]), datetime.now(UTC)).encode('latin-1')

    def _blocks(self) -> list[Block]:
        used = {stored.number for stored in self._points.values()}
        free = (number for number in range(LAST_NUMBER + 1) if number not in used)
        numbered = []
        for stored in self._points.values():
            number = stored.number if stored.number >= 0 else next(free, LAST_NUMBER + 1)
            if number > LAST_NUMBER:
                raise InputError(f'{len(self)} points: a .pts file has {LAST_NUMBER + 1}')
            numbered.append((number, stored))
        return [
            replace(_block(number, point), name=f'Point{index}')
            for index, (number, point) in enumerate(sorted(numbered, key=lambda item: item[0]), 1)
        ]


def _is_point_or_header(item: Any) -> bool:
    if isinstance(item, Block):
        return re.fullmatch(r'Point\d+', item.name) is not None
    return bool(item[0] == '')


def _block(number: int, stored: _StoredPoint) -> Block:
    old, arm_posture = stored.block, stored.posture
    if old is not None and arm_posture is None and stored.point in (None, _place(old)):
        return old
    has_position = old is not None and not int(old.number('nUndefined')) & _NO_PLACE
    if arm_posture is None and not has_position:
        arm_posture = 'a .pts file needs the posture of the arm, known only for points taught here'
    if isinstance(arm_posture, str):
        raise InputError(
            f'point {stored.name}: {arm_posture}: save a .yaml file, or teach it in RC+'
        )
    if len(stored.name) > MAX_LABEL_CHARACTERS:
        raise InputError(
            f'point {stored.name}: a label of RC+ has at most {MAX_LABEL_CHARACTERS} characters'
        )
    point = stored.point or EpsonPoint(0.0, 0.0, 0.0)
    values = (point.x, point.y, point.z, point.u, point.v, point.w)
    axes = {f'r{axis}': f'{value:.3f}' for axis, value in zip(_AXES, values, strict=True)}
    flags = {key: str((arm_posture or {}).get(key, 0)) for key in _FLAGS}
    if old is not None:
        new = {key: text for key, text in axes.items() if text != f'{old.number(key):.3f}'}
        new |= flags if arm_posture else {}
        if not has_position:
            new['nUndefined'] = _ONLY_PLACE
        items = [
            (item[0], new.get(item[0], item[1])) if isinstance(item, tuple) else item
            for item in old.items
        ]
        return Block(old.name, items)
    first = {'nNumber': str(number), 'sLabel': quoted(stored.name), 'sDescription': '""'}
    first['nUndefined'] = _ONLY_PLACE
    rest = {'rR': '0', 'rS': '0', 'rT': '0', 'nLocal': '0'}
    last = {'rJ1Angle': '0', 'rJ4Angle': '0', 'bSimVisible': 'True'}
    return Block('', [*(first | axes | rest | flags | last).items()])


def _place(block: Block) -> EpsonPoint:
    return EpsonPoint(*(block.number(f'r{axis}') for axis in _AXES))


_Read = tuple[dict[str, _StoredPoint], tuple[bytes, Block] | None]


def _from_pts(file: Path) -> _Read:
    content = read_file(file, MAX_BYTES)
    top = parsed(file.name, content.decode('latin-1'))
    return _of_blocks(file, top.blocks('Point')), (content, top)


def _from_csv(file: Path) -> _Read:
    content = read_file(file, MAX_BYTES).removeprefix(codecs.BOM_UTF8)
    rows = csv.DictReader(io.StringIO(content.decode('latin-1'), newline=''))
    try:
        return _of_blocks(file, list(_of_rows(file, rows))), None
    except csv.Error as error:
        raise InputError(f'{printable(file)}:{rows.line_num}: {error}') from error


def _of_rows(file: Path, rows: 'csv.DictReader[str]') -> Iterator[Block]:
    columns = rows.fieldnames or ()
    if not set(_NEEDED) <= set(columns) <= set(COLUMNS) or len(columns) != len(set(columns)):
        rule = f'must have the columns {", ".join(_NEEDED)}, and may have {", ".join(COLUMNS)}'
        raise InputError(f'{printable(file)}: {rule}')
    for row in rows:
        if None in row or None in row.values():
            rule = f'must have {len(columns)} values'
            raise InputError(f'{printable(file)}:{rows.line_num}: {rule}')
        items = [(key, _value(key, row.get(key[1:], ''))) for key in _KEYS]
        block = Block('', [*items], file.name, dict.fromkeys((*_KEYS, ''), rows.line_num))
        for key in _KEYS:
            if key[0] in 'nr':
                block.number(key)
        yield block


def _value(key: str, column: str) -> str:
    if key == 'nUndefined' and not column:
        return _ONLY_PLACE
    return quoted(column) if key[0] == 's' else column or ('True' if key[0] == 'b' else '0')


def _column(block: Block, key: str) -> str:
    text = block.text(key, 'True' if key[0] == 'b' else '' if key[0] == 's' else '0')
    return text.replace('\\\\', '\\') if key[0] == 's' else text


def _of_blocks(file: Path, blocks: Iterable[Block]) -> dict[str, _StoredPoint]:
    points: dict[str, _StoredPoint] = {}
    for block in blocks:
        number = int(block.number('nNumber', -1))
        if not 0 <= number <= LAST_NUMBER:
            raise InputError(
                f'{printable(file)}: point number {number} is not in 0..{LAST_NUMBER}'
            )
        label = block.text('sLabel')
        name = label if _NAME.fullmatch(label) else f'P{number}'
        if name.lower() in points:
            raise InputError(f'{printable(file)}: two points have the name {name}')
        place = None if int(block.number('nUndefined')) & _NO_PLACE else _place(block)
        local = int(block.number('nLocal'))
        why = ''
        if local:
            saved = f'in SPEL+, P{number} = P{number} @0 converts it to Local 0'
            why = f'is in Local {local} of the controller, whose position is unknown: {saved}'
        points[name.lower()] = _StoredPoint(name, place, number, block, why=why)
    return points


def _from_yaml(file: Path) -> _Read:
    data = read_yaml(file)
    if not isinstance(data, dict):
        raise InputError(f'{printable(file)}: must be a mapping of names to points')
    points: dict[str, _StoredPoint] = {}
    for name, values in data.items():
        if not _NAME.fullmatch(name) or name.lower() in points:
            raise InputError(f'{printable(file)}: {shown(name)} must be a unique name of a point')
        if not isinstance(values, dict) or not {'x', 'y', 'z'} <= set(values) <= set('xyzuvw'):
            raise InputError(f'{printable(file)}: {name}: must have x, y, z, and may have u, v, w')
        try:
            points[name.lower()] = _StoredPoint(name, EpsonPoint(**values))
        except ValueError as error:
            raise InputError(f'{printable(file)}: {name}: {error}') from error
    return points, None


_READERS: dict[str, Callable[[Path], _Read]] = {
    '.pts': _from_pts,
    '.csv': _from_csv,
    '.yaml': _from_yaml,
    '.yml': _from_yaml,
}
_SUFFIXES = 'must be a .pts, a .csv or a .yaml file'


def _yaml_line(stored: _StoredPoint) -> str:
    if stored.point is None or stored.why or not _NAME.fullmatch(stored.name):
        why = stored.why or ('has no label' if stored.point else 'is not taught yet')
        raise InputError(f'point {stored.name} {why}: it cannot be saved as .yaml')
    point = stored.point
    values = ', '.join(f'{axis}: {float(getattr(point, axis))!r}' for axis in 'xyzuvw')
    return f'{stored.name}: {{{values}}}\n'
