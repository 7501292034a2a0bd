# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Box: areas that tell whether the tool is in them (SPEL+ p169 to p174, p349, p437)."""

from collections.abc import Callable
from typing import Any

from epson_driver.spel.actions import bad, within
from epson_driver.spel.frames import Area, in_local
from epson_driver.spel.task import Task
from epson_driver.spel.values import Point, nearest

LAST_AREA = 15
_LIMITS = 6


def define_box(task: Task, number: float, *given: float, words: tuple[str, ...] = ()) -> None:
    """Box n, [robot,] x, x, y, y, z, z[, On|Off] [/LOCAL]: the last value is the local."""
    task.may('box')
    *numbers, local = given
    if len(numbers) > _LIMITS + ('logic' in words):
        _only_robot('Box', numbers.pop(0))
    limits = numbers[:_LIMITS]
    low, high = tuple(limits[::2]), tuple(limits[1::2])
    if any(a > b for a, b in zip(low, high, strict=True)):
        raise bad('Box', 'a lower limit is above the upper one')
    area = Area(low, high, within('Box', nearest(local), 0, 15))
    task.world.areas[_area('Box', number)] = area


def clear_box(task: Task, number: float, robot: float | None = None) -> None:
    """BoxClr n[, robot]."""
    _only_robot('BoxClr', 1 if robot is None else robot)
    task.world.areas.pop(_area('BoxClr', number), None)


def _area(name: str, number: float) -> int:
    return within(name, nearest(number), 1, LAST_AREA)


def _only_robot(name: str, robot: float) -> None:
    if robot != 1:
        raise bad(name, f'robot {robot:g}: there is only robot 1')


def _inside(task: Task, number: int, robot: int = 1) -> int:
    """Return InsideBox: -1 where the tool is in the area."""
    _only_robot('InsideBox', robot)
    area = task.world.areas.get(_area('InsideBox', number))
    if area is None:
        return 0
    here = task.value('realpos', ())
    assert isinstance(here, Point)  # noqa: S101 - RealPos is one
    seen = in_local(here, area.local, task.world.locals).values
    limits = zip(area.low, seen, area.high, strict=False)
    return -all(low == high == 0.0 or low <= at <= high for low, at, high in limits)


def _corner(task: Task, number: int, *given: int) -> Point:
    """Return Box(n[, robot], 1|2)."""
    *robot, which = given
    _only_robot('Box', robot[0] if robot else 1)
    area = task.world.areas.get(_area('Box', number))
    if area is None:
        raise bad('Box', f'{number} is not defined')
    corner = area.low if within('Box', which, 1, 2) == 1 else area.high
    return Point('xy', (*corner, 0.0, 0.0, 0.0), (str(area.local),))


AREA_STATEMENTS: dict[str, Callable[..., None]] = {'box': define_box, 'boxclr': clear_box}

AREA_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'box': _corner,
    'boxdef': lambda task, number, _robot=1: -(_area('BoxDef', number) in task.world.areas),
    'insidebox': _inside,
    'getrobotinsidebox': lambda task, number: -_inside(task, number),
}
