# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Box and Plane: areas that detect the tool in them (p169-174, p349, p437, p626)."""

from collections.abc import Callable
from functools import partial
from math import inf
from typing import Any

from epson_driver.spel import frames
from epson_driver.spel.actions import within
from epson_driver.spel.errors import bad
from epson_driver.spel.frames import Area
from epson_driver.spel.task import Task
from epson_driver.spel.values import Point, nearest

_LIMITS = 6
_KINDS = ('box', 'plane')


def _key(kind: str, number: float, robot: float | None = None) -> tuple[str, int]:
    """Return the key of an area. Raises SpelError for an invalid number or robot."""
    if robot not in (None, 1):
        raise bad(kind.capitalize(), f'robot {robot:g}: there is only robot 1')
    return kind, nearest(number)


def define_box(task: Task, number: float, *given: float, words: tuple[str, ...] = ()) -> None:
    """Box n, [robot,] x, x, y, y, z, z[, On|Off] [/LOCAL]: the last value is the local."""
    task.may('box')
    *numbers, local = given
    robot = numbers.pop(0) if len(numbers) > _LIMITS + ('logic' in words) else None
    low, high = tuple(numbers[:_LIMITS:2]), tuple(numbers[1:_LIMITS:2])
    if any(a > b for a, b in zip(low, high, strict=True)):
        raise bad('Box', 'a lower limit is above the upper one')
    area = Area(low, high, within('Box', nearest(local), 0, 15))
    task.world.areas[_key('box', number, robot)] = area


def define_plane(task: Task, number: int, *given: Any) -> None:
    """Plane n, [robot,] place, or an origin and points on X and Y: its +Z side is inside."""
    task.may('plane')
    robot = None if isinstance(given[0], Point) else given[0]
    points = [task.world.host.stored_point(each) for each in given if isinstance(each, Point)]
    frame = frames.frame_of('Plane', task.world.placed(points))
    task.world.areas[_key('plane', number, robot)] = Area((-inf, -inf, 0.0), (inf,) * 3, frame)


def _clear(kind: str, task: Task, number: float, robot: float | None = None) -> None:
    task.world.areas.pop(_key(kind, number, robot), None)


def _found(task: Task, kind: str, number: int, robot: int | None = None) -> Area:
    area = task.world.areas.get(_key(kind, number, robot))
    if area is None:
        raise bad(kind.capitalize(), f'{number} is not defined')
    return area


def _defined(kind: str, task: Task, number: int, robot: int | None = None) -> int:
    return -(_key(kind, number, robot) in task.world.areas)


def _inside(kind: str, task: Task, number: int, robot: int | None = None) -> int:
    """Return InsideBox and InsidePlane: -1 if the tool is in the area."""
    area = task.world.areas.get(_key(kind, number, robot))
    if area is None:
        return 0
    here = task.value('realpos', ())
    assert isinstance(here, Point)  # noqa: S101 - RealPos is one
    if isinstance(area.frame, Point):
        here = frames.within(area.frame, here)
    else:
        here = frames.in_local(here, area.frame, task.world.locals)
    limits = zip(area.low, here.values, area.high, strict=False)
    return -all(low == high == 0.0 or low <= at <= high for low, at, high in limits)


def _robots(kind: str, task: Task, number: int) -> int:
    """Return GetRobotInsideBox and GetRobotInsidePlane: bit 0 is robot 1."""
    return -_inside(kind, task, number)


def _corner(task: Task, number: int, *given: int) -> Point:
    """Return Box(n[, robot], 1|2)."""
    *robot, which = given
    area = _found(task, 'box', number, *robot)
    corner = area.low if which == 1 else area.high
    return Point('xy', (*corner, 0.0, 0.0, 0.0), (str(area.frame),))


AREA_STATEMENTS: dict[str, Callable[..., None]] = {
    'box': define_box,
    'plane': define_plane,
    **{f'{kind}clr': partial(_clear, kind) for kind in _KINDS},
}

AREA_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'box': _corner,
    'plane': lambda task, number, *robot: _found(task, 'plane', number, *robot).frame,
    **{f'{kind}def': partial(_defined, kind) for kind in _KINDS},
    **{f'inside{kind}': partial(_inside, kind) for kind in _KINDS},
    **{f'getrobotinside{kind}': partial(_robots, kind) for kind in _KINDS},
}
