# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reading planned trajectories: trajectory_msgs/JointTrajectory as YAML (`ros2 topic echo`)."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from epson_driver.motion import Array, Trajectory


class TrajectoryFileError(ValueError):
    """A file that is no trajectory; the text names the file, the point and the key."""


def read_trajectory(path: Path) -> Trajectory:
    """Return the trajectory of a file.

    Raises OSError if it cannot be read, TrajectoryFileError if it is something else.
    """
    loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)  # ten times faster, where built
    try:
        data = yaml.load(path.read_text(encoding='utf-8'), Loader=loader)  # noqa: S506 - safe
        names = tuple(str(name) for name in data['joint_names'])
        points = data['points']
        if not points:
            raise TrajectoryFileError(f'{path}: points is empty')
        return Trajectory(
            names,
            np.array([_seconds(point['time_from_start']) for point in points]),
            _table(points, 'positions', len(names)),
            _optional(points, 'velocities', len(names)),
            _optional(points, 'accelerations', len(names)),
        )
    except yaml.YAMLError as error:
        raise TrajectoryFileError(f'{path}: not YAML: {error}') from error
    except (KeyError, TypeError) as error:
        raise TrajectoryFileError(f'{path}: no JointTrajectory: {error!r}') from error


def _seconds(duration: Any) -> float:
    return float(duration['sec']) + float(duration['nanosec']) * 1e-9


def _optional(points: list[Any], key: str, joints: int) -> Array | None:
    return _table(points, key, joints) if points[0].get(key) else None


def _table(points: list[Any], key: str, joints: int) -> Array:
    for index, point in enumerate(points):
        if len(point[key]) != joints:
            raise TrajectoryFileError(f'point {index}: {len(point[key])} {key}, {joints} joints')
    return np.array([point[key] for point in points], dtype=float)
