# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Trajectory files: trajectory_msgs/JointTrajectory as YAML, as printed by `ros2 topic echo`."""

from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.inputs import (
    JOINT_NAMES,
    InputError,
    count,
    number,
    printable,
    read_yaml,
    shown,
    write_file,
)
from epson_driver.motion import Array, Trajectory

MAX_FILE_BYTES = 64_000_000
"""Maximum file size, bytes: 180,000 points of six joints with velocities and accelerations."""

MAX_DURATION_S = 1_000_000
"""Maximum time of a point, s (11 days). A float cannot resolve nanoseconds at larger times."""

MAX_VALUE = 1e6
"""Maximum absolute value of a number in a point (rad or m). Robot limits are checked later."""

FORM = (
    'must have joint_names: [joint_1, …] and points: [{positions: […], time_from_start: {sec: 0, '
    'nanosec: 0}}, …]'
)

_SECONDS = count(0, MAX_DURATION_S)
_NANOSECONDS = count(0, 2**32 - 1)
_DURATION = number(0, MAX_DURATION_S)
_VALUE = number(-MAX_VALUE, MAX_VALUE)


def read_trajectory(path: Path, *, timed: bool = True) -> Trajectory:
    """Return the trajectory in a file. Only the first of several YAML documents is read.

    A `time_from_start` is a mapping with `sec` and `nanosec`, or a number of seconds. `timed`:
    whether every point must have a time. If False, a point without a time gets 0 s. Raises
    InputError if the content is invalid.
    """
    data = read_yaml(path, largest=MAX_FILE_BYTES, several=True)
    file = printable(path)
    if data is None:
        raise InputError(f'{file}: is empty: {FORM}')
    names = JOINT_NAMES.checked(_field(data, 'joint_names', file), f'{file}: joint_names')
    points = _field(data, 'points', file)
    if not isinstance(points, list):
        raise InputError(f'{file}: points = {shown(points)}: must be a list')
    if not points:
        raise InputError(f'{file}: points is empty')
    joints = len(names)
    return Trajectory(
        names,
        np.array(
            [_time(point, f'{file}: point {index}', timed) for index, point in enumerate(points)]
        ),
        _table(points, 'positions', joints, file),
        _optional(points, 'velocities', joints, file),
        _optional(points, 'accelerations', joints, file),
    )


def write_trajectory(path: Path, trajectory: Trajectory, comment: str) -> None:
    lines = [
        f'# {comment}',
        'header:',
        '  stamp: {sec: 0, nanosec: 0}',
        "  frame_id: ''",
        f'joint_names: [{", ".join(trajectory.joint_names)}]',
        'points:',
    ]
    for index, time in enumerate(trajectory.times.tolist()):
        sec, nanosec = divmod(round(time * 1e9), 10**9)
        lines += [
            f'- positions: {_row_text(trajectory.positions, index)}',
            f'  velocities: {_row_text(trajectory.velocities, index)}',
            f'  accelerations: {_row_text(trajectory.accelerations, index)}',
            '  effort: []',
            f'  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}',
        ]
    write_file(path, '\n'.join(lines) + '\n')


def _row_text(values: Array | None, index: int) -> str:
    row = [] if values is None else values[index].round(9).tolist()
    return f'[{", ".join(str(value + 0.0) for value in row)}]'  # + 0.0: no minus zero


def _field(block: Any, key: str, where: str) -> Any:
    if not isinstance(block, dict):
        raise InputError(f'{where} = {shown(block)}: must be a mapping like a JointTrajectory')
    if key not in block:
        raise InputError(f'{where}: {key} is missing')
    return block[key]


def _time(point: Any, where: str, timed: bool) -> float:
    if not timed and isinstance(point, dict) and 'time_from_start' not in point:
        return 0.0
    duration = _field(point, 'time_from_start', where)
    where += '.time_from_start'
    if not isinstance(duration, dict):
        seconds_alone: float = _DURATION.checked(duration, where)
        return seconds_alone
    seconds: int = _SECONDS.checked(_field(duration, 'sec', where), f'{where}.sec')
    rest: int = _NANOSECONDS.checked(_field(duration, 'nanosec', where), f'{where}.nanosec')
    return seconds + rest * 1e-9


def _optional(points: list[Any], key: str, joints: int, file: str) -> Array | None:
    """Return the values of `key` at all points, or None if no point has this key."""
    return _table(points, key, joints, file) if any(point.get(key) for point in points) else None


def _table(points: list[Any], key: str, joints: int, file: str) -> Array:
    return np.array(
        [_row(point, key, joints, f'{file}: point {index}') for index, point in enumerate(points)]
    )


def _row(point: Any, key: str, joints: int, where: str) -> list[float]:
    row = _field(point, key, where)
    if not isinstance(row, list):
        raise InputError(f'{where}: {key} = {shown(row)}: must be a list of numbers')
    if len(row) != joints:
        raise InputError(f'{where}: {len(row)} {key}, {joints} joints')
    return [_VALUE.checked(value, f'{where}: {key}[{index}]') for index, value in enumerate(row)]
