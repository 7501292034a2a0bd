# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Trajectories in files: trajectory_msgs/JointTrajectory as YAML (`ros2 topic echo`)."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from epson_driver.motion import Array, Trajectory


class TrajectoryFileError(ValueError):
    """A file that is no trajectory; the text names the file, the point and the key."""


def read_trajectory(path: Path, *, timed: bool = True) -> Trajectory:
    """Return the trajectory of a file; of several documents in it, the first.

    `timed`: whether a point must have a time; otherwise one that has none is at 0 s. Raises
    OSError if it cannot be read, TrajectoryFileError if it is something else.
    """
    loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)  # ten times faster, where built
    try:
        with path.open(encoding='utf-8') as file:
            data: Any = next(yaml.load_all(file, Loader=loader), None)
        names = tuple(str(name) for name in data['joint_names'])
        points = data['points']
        if not points:
            raise ValueError('points is empty')
        return Trajectory(
            names,
            np.array([_time(point, timed) for point in points]),
            _table(points, 'positions', len(names)),
            _optional(points, 'velocities', len(names)),
            _optional(points, 'accelerations', len(names)),
        )
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise TrajectoryFileError(f'{path}: not YAML: {error}') from error
    except KeyError as error:
        raise TrajectoryFileError(f'{path}: no JointTrajectory: {error} is missing') from error
    except TypeError as error:
        raise TrajectoryFileError(f'{path}: no JointTrajectory: {error}') from error
    except ValueError as error:
        raise TrajectoryFileError(f'{path}: {error}') from error


def write_trajectory(path: Path, trajectory: Trajectory, comment: str) -> None:
    """Write a trajectory as a file that `read_trajectory` reads, under a line of comment.

    Raises OSError if it cannot be written.
    """
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
            f'- positions: {_written(trajectory.positions, index)}',
            f'  velocities: {_written(trajectory.velocities, index)}',
            f'  accelerations: {_written(trajectory.accelerations, index)}',
            '  effort: []',
            f'  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}',
        ]
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')


def _written(values: Array | None, index: int) -> str:
    row = [] if values is None else values[index].round(9).tolist()
    return f'[{", ".join(str(value + 0.0) for value in row)}]'  # + 0.0: no minus zero


def _time(point: Any, timed: bool) -> float:
    if not timed and 'time_from_start' not in point:
        return 0.0
    return _seconds(point['time_from_start'])


def _seconds(duration: Any) -> float:
    return float(duration['sec']) + float(duration['nanosec']) * 1e-9


def _optional(points: list[Any], key: str, joints: int) -> Array | None:
    """Return None if no point has the quantity; one point that has it obliges the others."""
    return _table(points, key, joints) if any(point.get(key) for point in points) else None


def _table(points: list[Any], key: str, joints: int) -> Array:
    for index, point in enumerate(points):
        if len(point[key]) != joints:
            raise ValueError(f'point {index}: {len(point[key])} {key}, {joints} joints')
    return np.array([point[key] for point in points], dtype=float)
