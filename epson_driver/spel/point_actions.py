# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Statements and functions of points, their labels, postures and files, of locals, and of areas.

The areas Box and Plane detect the tool in them (p169-174, p349, p437, p626).
"""

import math
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from math import inf
from typing import Any

from epson_driver.spel import frames
from epson_driver.spel.actions import print_terminal, within
from epson_driver.spel.builtins import point
from epson_driver.spel.errors import bad
from epson_driver.spel.frames import Area, changed, frame_between, frame_of, local_of
from epson_driver.spel.functions import ANGLES, POSTURES, subject
from epson_driver.spel.project_data import LAST_POINT, point_file, points_of
from epson_driver.spel.task import Task
from epson_driver.spel.values import Point, nearest


def set_coordinate(task: Task, number: int, axis: str, value: float) -> None:
    """CX(P1) = …, and likewise CY, CZ, CU, CV and CW."""
    task.world.points[number] = changed(point(task, number), ':', axis, value)


def delete_points(task: Task, first: int, last: int | None = None) -> None:
    """PDel first[, last]."""
    for number in range(first, (first if last is None else last) + 1):
        task.world.points.pop(number, None)


def _clear_points(task: Task) -> None:
    task.world.points.clear()
    task.world.point_labels.clear()


def set_label(task: Task, number: int, label: str) -> None:
    """PLabel n, name: the label belongs to this point only."""
    within('PLabel', number, 0, LAST_POINT)
    labels = task.world.point_labels
    for key in [key for key, value in labels.items() if value == number]:
        del labels[key]
    if label:
        labels[label.lower()] = number
        task.world.spelling[label.lower()] = label


def label_of(task: Task, number: int) -> str:
    """Return PLabel$."""
    return _written_labels(task).get(number, '')


def _written_labels(task: Task) -> dict[int, str]:
    """Return point number → original spelling of its label."""
    world = task.world
    return {number: world.spelling.get(key, key) for key, number in world.point_labels.items()}


def list_points(task: Task, first: int | None = None, last: int | None = None) -> None:
    """PList [first[, last]]: print points as statements that define them (p632)."""
    if last is None:
        last = LAST_POINT if first is None else first
    for number in range(first or 0, last + 1):
        result = task.world.points.get(number)
        if result is not None:
            turns = result.values[4:]
            scara = not any(turns) and {'a', 'b'}.isdisjoint(result.flags)
            shown = result.values[:4] if scara else result.values
            values = ', '.join(f'{value:8.3f}' for value in shown)
            flags = ''.join(f' /{flag.upper()}' for flag in result.flags if not flag.isdigit())
            text = f'P{number} = XY({values} ){flags} /{local_of(result)}\n'
            print_terminal(task, text)


def load_points(task: Task, name: str, words: tuple[str, ...] = ()) -> None:
    """LoadPoints name[, Merge]: a file of the project, or one written by SavePoints (p513)."""
    world = task.world
    file = world.program.data.point_files.get(name.lower())
    saved = world.files.read(name)
    if saved is not None:
        file = point_file(name, saved)
    if file is None:
        raise bad('LoadPoints', f'the project has no point file {name}')
    if 'merge' not in words:
        _clear_points(task)
    world.load(file.points)
    world.point_labels |= file.labels
    world.spelling |= file.spelling


def save_points(task: Task, name: str) -> None:
    """SavePoints name (p712)."""
    if ' ' in name or not name.lower().endswith('.pts'):
        raise bad('SavePoints', f'{name}: must be a name without blanks that ends in .pts')
    world = task.world
    when = datetime(2000, 1, 1, tzinfo=UTC)
    text = points_of(world.points, _written_labels(task), when)
    world.files.write(name, text.encode('latin-1', 'replace'))


def _posture(name: str) -> Callable[..., None]:
    show = _posture_of(name)

    def run(task: Task, number: int | None = None, value: float | None = None) -> None:
        if number is None or value is None:  # display only
            result = None if number is None else point(task, number)
            print_terminal(task, f'{show(task, result)}\n')
            return
        if name in ANGLES:
            flag = f'{ANGLES[name]}{value:g}'
        else:
            flags, first = POSTURES[name], _first(name)
            flag = flags[within(name, nearest(value), first, first + len(flags) - 1) - first]
        task.world.points[number] = point(task, number).flagged(flag)

    return run


def _posture_of(name: str) -> Callable[..., int]:
    def read(task: Task, of: Point | None = None) -> int:
        result = task.value('here', ()) if of is None else of
        assert isinstance(result, Point)  # noqa: S101 - Here is one
        flag = next((item for item in result.flags if subject(item) == ANGLES.get(name, name)), '')
        if name in ANGLES:
            return nearest(float(flag[3:] or 0))
        return _first(name) + (POSTURES[name].index(flag) if flag else 0)

    return read


def _first(name: str) -> int:
    """Return the number of the usual posture: Hand, Elbow and Wrist count from 1."""
    return int(name[0] != 'j')


def _least_motion(task: Task, of: Point, near: Point | None = None, number: int = 1) -> Point:
    """Return LJM: the point in the posture of the least motion (p508), in its own local."""
    here = near or task.value('here', ())
    assert isinstance(here, Point)  # noqa: S101 - Here is one
    result = task.value('ljm', (of, here, number))
    assert isinstance(result, Point)  # noqa: S101 - LJM is one
    for flag in result.flags:
        of = of.flagged(flag)
    return of


def distance(task: Task, first: Point, second: Point) -> float:
    """Return Dist, mm."""
    a, b = task.world.placed((first, second))
    if a.kind != 'xy' or b.kind != 'xy':
        a, b = (task.world.host.stored_point(item) for item in (a, b))
    return math.dist(a.values[:3], b.values[:3])


def define_local(task: Task, number: int, *arguments: Point, words: tuple[str, ...] = ()) -> None:
    """Local n, origin[, on X, on Y[, X|Y]], or two pairs of points[, L|R] (p514)."""
    task.may('local')
    points = [task.world.host.stored_point(item) for item in arguments]
    if 'pair' in words:
        if len(points) != 4:
            raise bad('Local', 'takes two pairs of points')
        pairs = list(zip(points[::2], task.world.placed(points[1::2]), strict=True))
        fraction = 0.0 if 'l' in words else 1.0 if 'r' in words else 0.5
        frame = frame_between(pairs, fraction, 'baseu' in words)
    else:
        frame = frame_of('Local', task.world.placed(points), 'y' if 'y' in words else 'x')
    task.world.locals[number] = frame


def set_local(task: Task, number: int, local: float) -> None:
    """PLocal(P1) = n."""
    chosen = str(within('PLocal', nearest(local), 0, 15))
    task.world.points[number] = point(task, number).flagged(chosen)


def set_arch(task: Task, number: float, depart: float, approach: float) -> None:
    """Arch n, depart, approach: set the distances of an arch, mm."""
    task.may('arch')
    task.world.arches[nearest(number)] = (float(depart), float(approach))


def _arch(task: Task, number: int, which: int) -> float:
    return task.world.arches[number][which - 1]


def _local(task: Task, number: int) -> Point:
    result = task.world.locals.get(number)
    if result is None:
        raise bad('Local', f'{number} is not defined')
    return Point('xy', result.values[:6])


POINT_STATEMENTS: dict[str, Callable[..., None]] = {
    'coordinate': set_coordinate,
    'pdel': delete_points,
    'plabel': set_label,
    'plist': list_points,
    'clearpoints': _clear_points,
    'loadpoints': load_points,
    'savepoints': save_points,
    'arch': set_arch,
    'plocal': set_local,
    'local': define_local,
    'localclr': lambda task, number: task.world.locals.pop(nearest(number), None),
    **{name: _posture(name) for name in (*POSTURES, *ANGLES)},
}
"""Name of the statement in lower case → function that executes it."""

POINT_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'pnumber': lambda _task, number: number,
    'plabel$': label_of,
    'dist': distance,
    'ljm': _least_motion,
    'arch': _arch,
    'plocal': lambda _task, of: local_of(of),
    'local': _local,
    'localdef': lambda task, number: -(number in task.world.locals),
    **{name: _posture_of(name) for name in (*POSTURES, *ANGLES)},
}
"""Name of the function in lower case → its implementation."""


_LIMITS = 6
_KINDS = ('box', 'plane')


def _key(kind: str, number: float, robot: float | None = None) -> tuple[str, int]:
    """Return the key of an area. Raises SpelError if the number or the robot is invalid."""
    if robot not in (None, 1):
        raise bad(kind.capitalize(), f'robot {robot:g}: must be robot 1')
    return kind, nearest(number)


def define_box(task: Task, number: float, *given: float, words: tuple[str, ...] = ()) -> None:
    """Box n, [robot,] x, x, y, y, z, z[, On|Off] [/LOCAL]: the last value is the local."""
    task.may('box')
    *numbers, local = given
    robot = numbers.pop(0) if len(numbers) > _LIMITS + ('logic' in words) else None
    low, high = tuple(numbers[:_LIMITS:2]), tuple(numbers[1:_LIMITS:2])
    if any(a > b for a, b in zip(low, high, strict=True)):
        raise bad('Box', 'a lower limit is above its upper limit')
    area = Area(low, high, within('Box', nearest(local), 0, 15))
    task.world.areas[_key('box', number, robot)] = area


def define_plane(task: Task, number: int, *given: Any) -> None:
    """Plane n, [robot,] place, or an origin and points on X and Y: its +Z side is inside."""
    task.may('plane')
    robot = None if isinstance(given[0], Point) else given[0]
    points = [task.world.host.stored_point(item) for item in given if isinstance(item, Point)]
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
