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
    """Return the trajectory of a file; of several documents in it, the first.

    Raises OSError if it cannot be read, TrajectoryFileError if it is something else.
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
            np.array([_seconds(point['time_from_start']) for point in points]),
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
