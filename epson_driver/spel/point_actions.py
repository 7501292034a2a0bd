# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Statements and functions for points: labels, postures, files and local coordinate systems."""

import math
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from epson_driver.spel.actions import print_terminal, within
from epson_driver.spel.builtins import point
from epson_driver.spel.errors import bad, to_add
from epson_driver.spel.frames import changed, frame_between, frame_of, local_of
from epson_driver.spel.project_data import LAST_POINT, point_file, points_of
from epson_driver.spel.task import Task
from epson_driver.spel.values import Point, nearest


def set_coordinate(task: Task, number: int, axis: str, value: float) -> None:
    task.world.points[number] = changed(point(task, number), ':', axis, value)


def delete_points(task: Task, first: int, last: int | None = None) -> None:
    for number in range(first, (first if last is None else last) + 1):
        task.world.points.pop(number, None)


def _clear_points(task: Task) -> None:
    task.world.points.clear()
    task.world.point_labels.clear()


def set_label(task: Task, number: int, label: str) -> None:
    within('PLabel', number, 0, LAST_POINT)
    labels = task.world.point_labels
    for key in [key for key, value in labels.items() if value == number]:
        del labels[key]
    if label:
        labels[label.lower()] = number
        task.world.spelling[label.lower()] = label


def label_of(task: Task, number: int) -> str:
    return _written_labels(task).get(number, '')


def _written_labels(task: Task) -> dict[int, str]:
    """Return the labels of points in their original spelling, by point number."""
    world = task.world
    return {number: world.spelling.get(key, key) for key, number in world.point_labels.items()}


def list_points(task: Task, first: int | None = None, last: int | None = None) -> None:
    """Execute `PList [first[, last]]`: print points as statements (SPEL+ manual p632)."""
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
    """Execute `LoadPoints name[, Merge]`.

    `name`: a file of the project, or one written by `SavePoints`.
    """
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
    """Execute `SavePoints name` (SPEL+ manual p712)."""
    if set(' /\\:') & set(name) or not name.lower().endswith('.pts'):
        raise bad('SavePoints', f'{name}: must be a name without blanks or path, and end in .pts')
    world = task.world
    when = datetime(2000, 1, 1, tzinfo=UTC)
    text = points_of(world.points, _written_labels(task), when)
    world.files.write(name, text.encode('latin-1', 'replace'))


def _set_hand(task: Task, number: int | None = None, value: float | None = None) -> None:
    """Execute `Hand [point[, 1|2]]`.

    1 sets Righty and 2 sets Lefty. Without a value, print the current value.
    """
    if number is None or value is None:
        print_terminal(task, f'{_hand(task, None if number is None else point(task, number))}\n')
    else:
        flag = 'rl'[within('Hand', nearest(value), 1, 2) - 1]
        task.world.points[number] = point(task, number).flagged(flag)


def _hand(task: Task, of: Point | None = None) -> int:
    result = task.value('here', ()) if of is None else of
    assert isinstance(result, Point)  # noqa: S101 - Here is one
    return 2 if 'l' in result.flags else 1


def _least_motion(task: Task, of: Point, near: Point | None = None, number: int = 1) -> Point:
    """Return the result of `LJM`: the point `of` in the posture that is nearest to `near`."""
    here = near or task.value('here', ())
    assert isinstance(here, Point)  # noqa: S101 - Here is one
    result = task.value('ljm', (of, here, number))
    assert isinstance(result, Point)  # noqa: S101 - LJM is one
    for flag in result.flags:
        of = of.flagged(flag)
    return of


def distance(task: Task, first: Point, second: Point) -> float:
    """Return `Dist`: the distance between two points, mm."""
    a, b = task.world.placed((first, second))
    if a.kind != 'xy' or b.kind != 'xy':
        a, b = (task.world.host.stored_point(item) for item in (a, b))
    return math.dist(a.values[:3], b.values[:3])


def define_local(task: Task, number: int, *arguments: Point, words: tuple[str, ...] = ()) -> None:
    """Execute `Local n` with one point, three points, or two pairs (SPEL+ manual p514).

    A pair is a point of the local and the same point in Local 0.
    """
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
    chosen = str(within('PLocal', nearest(local), 0, 15))
    task.world.points[number] = point(task, number).flagged(chosen)


def set_arch(task: Task, number: float, depart: float, approach: float) -> None:
    """Execute `Arch n, depart, approach`: set the distances of an arch, mm."""
    task.may('arch')
    task.world.arches[nearest(number)] = (float(depart), float(approach))


def _arch(task: Task, number: int, which: int) -> float:
    return task.world.arches[number][which - 1]


def _local(task: Task, number: int) -> Point:
    result = task.world.locals.get(number)
    if result is None:
        advice = to_add('locals', f'{number}: [X, Y, Z, U]')
        raise bad('Local', f'{number} is not defined: {advice}')
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
    'hand': _set_hand,
}

POINT_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'pnumber': lambda _task, number: number,
    'plabel$': label_of,
    'dist': distance,
    'ljm': _least_motion,
    'arch': _arch,
    'plocal': lambda task, number: local_of(point(task, number)),
    'local': _local,
    'localdef': lambda task, number: -(number in task.world.locals),
    'hand': _hand,
}
