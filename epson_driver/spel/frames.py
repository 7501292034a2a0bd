# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Calculations with poses: offsets, rotations, locals, pallets (SPEL+ manual p592-602)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from epson_driver.spel.errors import ErrorNumber, SpelError, bad, to_add
from epson_driver.spel.functions import AXES, TURNS
from epson_driver.spel.values import Point

_Turn = tuple[tuple[float, ...], ...]
WORLD = Point('xy', (0.0,) * 6)
_TURNED = {'rx': 'w', 'ry': 'v', 'rz': 'u'}
_BASE_U = 'baseu'
PLACES = 9
"""Decimals of computed coordinates, which are in mm and degrees."""
MAX_PLACES = 32_767
"""Maximum number of columns, and of rows, of a pallet. Their product has a lower limit."""


def changed(point: Point, operator: str, axis: str, value: float) -> Point:
    """Return a point with the coordinate `axis` set (`:`) or moved (`+`, `-`).

    Raises SpelError if the point has no such coordinate.
    """
    if point.kind != 'xy' or (axis in AXES and AXES.index(axis) >= len(point.values)):
        raise SpelError(ErrorNumber.ARGUMENT, f'the point has no coordinate {axis.upper()}')
    if axis in AXES:
        values = list(point.values)
        at = AXES.index(axis)
        old = values[at]
        values[at] = {':': value, '+': old + value, '-': old - value}[operator]
        return replace(point, values=tuple(values))
    step = -value if operator == '-' else value
    along = _TURNED.get(axis, axis[2:])
    offset = Point('xy', tuple(step if along == item else 0.0 for item in AXES[:6]))
    if axis in TURNS:
        turned = combined(offset, replace(point, values=(0.0, 0.0, 0.0, *point.values[3:])))
        return replace(point, values=(*point.values[:3], *turned.values[3:]))
    return combined(point, offset)


def added(left: Point, right: Point, sign: float = 1.0) -> Point:
    """Return P1 + P2 or P1 - P2, calculated for each coordinate (SPEL+ manual p593).

    The result has the flags of P1.
    """
    if left.kind != 'xy' or right.kind != 'xy':
        raise SpelError(ErrorNumber.ARGUMENT, '+ and - need points with X, Y and Z')
    values = (a + sign * b for a, b in zip(left.values, right.values, strict=True))
    return replace(left, values=tuple(values))


def combined(frame: Point, point: Point) -> Point:
    """Transform a point from `frame` to the coordinate system in which `frame` is specified.

    The result has the flags of `frame`.
    """
    turn = _matrix(frame)
    moved = [
        frame.values[row] + sum(turn[row][k] * point.values[k] for k in range(3))
        for row in range(3)
    ]
    return replace(frame, values=_values(moved, _product(_tool_turn(frame), _matrix(point))))


def within(frame: Point, point: Point) -> Point:
    """Transform a point to `frame` from the coordinate system in which `frame` is specified."""
    back = tuple(zip(*_matrix(frame), strict=True))
    away = [point.values[k] - frame.values[k] for k in range(3)]
    moved = [sum(back[row][k] * away[k] for k in range(3)) for row in range(3)]
    turned = _product(tuple(zip(*_tool_turn(frame), strict=True)), _matrix(point))
    return replace(point, values=_values(moved, turned))


def local_of(point: Point) -> int:
    return next((int(flag) for flag in reversed(point.flags) if flag.isdigit()), 0)


def in_local(point: Point, number: int, locals_: Mapping[int, Point]) -> Point:
    """Return a point converted to Local `number`.

    Raises SpelError 7007 if the local is not defined.
    """
    world = in_world(point, locals_)
    if number:
        world = within(_frame(number, locals_), world)
    return replace(world, flags=(*world.flags, str(number)))


def in_world(point: Point, locals_: Mapping[int, Point]) -> Point:
    number = local_of(point)
    flags = tuple(flag for flag in point.flags if not flag.isdigit())
    if not number or point.kind != 'xy':
        return replace(point, flags=flags)
    placed = combined(_frame(number, locals_), point)
    return replace(placed, flags=flags)


def turned_step(step: Point, locals_: Mapping[int, Point]) -> Point:
    """Convert a step to Local 0.

    A step is along the axes of the local in its flag (SPEL+ manual p163).
    """
    number = local_of(step)
    flags = tuple(flag for flag in step.flags if not flag.isdigit())
    if not number or step.kind != 'xy':
        return replace(step, flags=flags)
    frame = _frame(number, locals_)
    turn = replace(frame, values=(0.0, 0.0, 0.0, *frame.values[3:]))
    return replace(combined(combined(turn, step), within(turn, WORLD)), flags=flags)


def _frame(number: int, locals_: Mapping[int, Point]) -> Point:
    frame = locals_.get(number)
    if frame is None:
        advice = to_add('locals', f'{number}: [X, Y, Z, U]')
        text = f'Local {number} is not defined: {advice}'
        raise SpelError(ErrorNumber.POINT_UNDEFINED, text)
    return frame


def frame_of(name: str, points: Sequence[Point], axis: str = 'x') -> Point:
    """Return the frame with this origin, a point on its X axis and a point on its Y axis.

    A single pose can also define the frame. Only the axis `axis`, 'x' or 'y', passes exactly
    through its point. Raises SpelError, with the statement's `name`, if the points do not define a
    frame.
    """
    if any(point.kind != 'xy' for point in points) or len(points) not in (1, 3):
        raise bad(name, 'takes a pose, or an origin and points on X and Y')
    origin = points[0]
    if len(points) == 1:
        return replace(origin, flags=())
    first, second = (_away(origin, point) for point in points[1:])
    normal = _cross(first, second)
    if math.hypot(*normal) < 1e-6:
        raise bad(name, 'the points are in one line')
    z = _unit(normal)
    if axis == 'y':
        y = _unit(second)
        x = _cross(y, z)
    else:
        x = _unit(first)
        y = _cross(z, x)
    return Point('xy', _values(origin.values[:3], tuple(zip(x, y, z, strict=True))))


def frame_between(
    pairs: Sequence[tuple[Point, Point]], fraction: float, base_u: bool = False
) -> Point:
    """Return the frame that maps two points of a local to two points in Local 0.

    `pairs`: two pairs, each of a point in the local and the same point in Local 0 (SPEL+ manual
    p514). If the two points of the local are not as far apart as those in Local 0, the frame is
    exact only at one place between them: at `fraction` of the distance from the first point.

    With `base_u`, the U of points is not rotated with the frame. It is increased by the difference
    of U in the pairs, interpolated at `fraction` (p515). The seventh value of the result is this
    increase minus the frame's rotation.
    """
    (here, there), (here2, there2) = pairs
    turn = _heading(there, there2) - _heading(here, here2)
    first, second = (base.values[3] - local.values[3] for local, base in pairs)
    moved = first + fraction * math.remainder(second - first, 360.0)
    here, there = (
        added(here, _step(here, here2, fraction)),
        added(there, _step(there, there2, fraction)),
    )
    turned = combined(Point('xy', (0.0, 0.0, 0.0, turn, 0.0, 0.0)), here)
    frame = (*_away(turned, there), turn, 0.0, 0.0)
    return Point('xy', (*frame, moved - turn), (_BASE_U,)) if base_u else Point('xy', frame)


def _step(first: Point, second: Point, fraction: float) -> Point:
    return Point('xy', (*(fraction * item for item in _away(first, second)), 0.0, 0.0, 0.0))


def _heading(first: Point, second: Point) -> float:
    x, y, _ = _away(first, second)
    return math.degrees(math.atan2(y, x))


def _away(first: Point, second: Point) -> tuple[float, ...]:
    return tuple(b - a for a, b in zip(first.values[:3], second.values[:3], strict=True))


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, ...]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(vector: Sequence[float]) -> tuple[float, ...]:
    length = math.hypot(*vector)
    return tuple(item / length for item in vector)


def _tool_turn(frame: Point) -> _Turn:
    """Return the rotation by which a frame turns orientations.

    With BaseU it differs from the rotation of the frame's axes.
    """
    if _BASE_U not in frame.flags:
        return _matrix(frame)
    u, v, w, *more = frame.values[3:]
    return _matrix(replace(frame, values=(0.0, 0.0, 0.0, u + sum(more), v, w)))


def _matrix(point: Point) -> _Turn:
    """Return the rotation matrix of U about Z, V about Y, and W about X."""
    u, v, w = (math.radians(value) for value in point.values[3:6])
    cu, su, cv, sv, cw, sw = (f(item) for item in (u, v, w) for f in (math.cos, math.sin))
    return (
        (cu * cv, cu * sv * sw - su * cw, cu * sv * cw + su * sw),
        (su * cv, su * sv * sw + cu * cw, su * sv * cw - cu * sw),
        (-sv, cv * sw, cv * cw),
    )


def _product(a: Sequence[Sequence[float]], b: Sequence[Sequence[float]]) -> _Turn:
    columns = list(zip(*b, strict=True))
    return tuple(
        tuple(sum(x * y for x, y in zip(row, column, strict=True)) for column in columns)
        for row in a
    )


def _values(place: Sequence[float], turn: Sequence[Sequence[float]]) -> tuple[float, ...]:
    v = math.asin(max(-1.0, min(1.0, -turn[2][0])))
    if abs(turn[2][0]) > 1.0 - 1e-12:  # V is straight up or down: W is 0
        u, w = math.atan2(-turn[0][1], turn[1][1]), 0.0
    else:
        u, w = math.atan2(turn[1][0], turn[0][0]), math.atan2(turn[2][1], turn[2][2])
    angles = (math.degrees(item) for item in (u, v, w))
    return tuple(round(item, PLACES) + 0.0 for item in (*place, *angles))


@dataclass(frozen=True, slots=True)
class Pallet:
    """Positions in columns and rows between corners (statement `Pallet`).

    * corners: the first position, the other ends of its row and of its column, and, if taught,
      the opposite corner.
    * outside: whether positions beyond the pallet's columns and rows are allowed.
    """

    corners: tuple[Point, ...]
    columns: int
    rows: int
    outside: bool

    def place(self, number: int, position: int, row: int | None) -> Point:
        """Return the point at one position of the pallet.

        Without a `row`, positions are counted along the rows, and `position` is the number of the
        position. With a `row`, `position` is the number of the column. All numbers start at 1. The
        orientation is taken from the first corner. Raises SpelError, with the pallet's `number`,
        if the position does not exist.
        """
        if row is None:
            column, row = (position - 1) % self.columns + 1, (position - 1) // self.columns + 1
            within = 1 <= position <= self.columns * self.rows
        else:
            column = position
            within = self.outside or (1 <= column <= self.columns and 1 <= row <= self.rows)
        if not within:
            text = (
                f'Pallet {number}: {self.columns} columns, {self.rows} rows have no such position'
            )
            raise SpelError(ErrorNumber.ARGUMENT, text)
        across = (column - 1) / max(self.columns - 1, 1)
        along = (row - 1) / max(self.rows - 1, 1)
        first, second, third, *opposite = (corner.values for corner in self.corners)
        moved = []
        for axis in range(3):
            a, b, c = first[axis], second[axis], third[axis]
            d = opposite[0][axis] if opposite else b + c - a
            near = a + across * (b - a)
            moved.append(near + along * (c + across * (d - c) - near))
        return Point('xy', (*moved, *first[3:]), self.corners[0].flags)


def new_pallet(corners: tuple[Point, ...], columns: int, rows: int, out: bool) -> Pallet:
    for name, count in (('columns', columns), ('rows', rows)):
        if not 1 <= count <= MAX_PLACES:
            raise bad('Pallet', f'{count} {name} are not in 1..{MAX_PLACES}')
    if columns * rows >= MAX_PLACES:
        raise bad('Pallet', f'{columns} times {rows} positions: must be fewer than {MAX_PLACES}')
    if any(corner.kind != 'xy' or len(corner.values) < 3 for corner in corners):
        raise bad('Pallet', 'the corners must be points with X, Y and Z')
    return Pallet(corners, columns, rows, out)
