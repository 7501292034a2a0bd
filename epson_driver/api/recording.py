# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of measured joints, saved to files, and converted to trajectories for replay."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from epson_driver.api.errors import RobotError, checked_arguments
from epson_driver.api.ownership import Unique
from epson_driver.inputs import number
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.trajectory_file import read_trajectory, write_trajectory

if TYPE_CHECKING:  # the driver is loaded with the first Robot
    from epson_driver.driver.state.robot_state import JointSample

LONGEST_S = 3600.0
"""Maximum duration of a recording, s, because recordings are stored in memory."""

MAX_GAP_S = 0.5
"""Longest gap between samples, s. The path in a longer gap is unknown."""

NEAR = {'rad': 2e-3, 'm': 2e-4}
"""Maximum deviation of the replayed path from the recorded path, by unit."""

REST = {'rad': 0.02, 'm': 0.002}
"""Speed below which a joint counts as at rest, per s, by unit. Measured positions jitter."""

SLOPE_SAMPLES = 3
"""Number of samples before and after a sample from which its velocity is computed."""

RATE = number(0.1, 1000.0, 'per s')
SPEED = number(0.01, 1.0)


class Recording(Unique):
    """Measured joint positions, recorded by `Robot.record` or loaded from a file.

    Recording ends with `stop`, when the Robot is closed, or after an hour.
    """

    def __init__(self, joint_names: tuple[str, ...], period: float = 0.0) -> None:
        self.joint_names = joint_names
        self._period = period
        self._rows: list[tuple[float, Array]] = []
        self._start = self._next = 0.0
        self._stop: Callable[[], None] = lambda: None

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self._rows)

    def __repr__(self) -> str:
        return f'<Recording: {len(self)} samples, {self.duration:.3g} s>'

    @property
    def times(self) -> Array:
        """Time of each sample from the first one, shape (k,), s."""
        return np.array([time for time, _ in self._rows])

    @property
    def positions(self) -> Array:
        """Joint positions of the samples, shape (k, n), rad (m)."""
        return np.array([row for _, row in self._rows]).reshape(-1, len(self.joint_names))

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return self._rows[-1][0] if self._rows else 0.0

    def stop(self) -> None:
        """Stop recording."""
        self._stop()

    @checked_arguments
    def save(self, path: str | PathLike[str]) -> None:
        """Stop, and write the recording as a ROS trajectory (YAML).

        Raises RobotError if the recording is empty or if the file cannot be written. In the second
        case it is also an OSError.
        """
        self.stop()
        self._check_any()
        recorded = Trajectory(self.joint_names, self.times, self.positions)
        write_trajectory(Path(path), recorded, 'measured joints')

    @classmethod
    @checked_arguments
    def load(cls, path: str | PathLike[str]) -> 'Recording':
        """Read a saved recording or another trajectory file.

        Raises ArgumentError if the file cannot be read or is invalid.
        """
        read = read_trajectory(Path(path))
        result = cls(read.joint_names)
        result._rows = list(
            zip((read.times - read.times[0]).tolist(), read.positions, strict=True)
        )
        return result

    def start(self, add: Callable[[Callable[['JointSample'], None]], Callable[[], None]]) -> None:
        """Start recording.

        add: function that registers a callback for samples, and returns a function to remove it.
        """
        self._stop = add(self._take)

    def plan(self, limits: JointLimits, speed: float) -> Trajectory:
        """Return the recording as a trajectory from rest to rest.

        speed: fraction of the recorded speed. The time before the first motion is skipped. Raises
        ValueError if the joint names differ from the arm's, or the samples have a gap longer than
        MAX_GAP_S.
        """
        self._check_any()
        if self.joint_names != limits.names:
            raise ValueError(
                f'the recording is of {", ".join(self.joint_names)}: this arm has '
                f'{", ".join(limits.names)}'
            )
        times, positions = self.times, limits.settled(self.positions)
        gaps = np.diff(times)
        if len(gaps) and (gaps.max() > MAX_GAP_S or gaps.min() <= 0.0):
            where = int(gaps.argmax() if gaps.max() > MAX_GAP_S else gaps.argmin())
            raise ValueError(
                f'{times[where]:.3g} s after the start of the recording, two samples are '
                f'{gaps[where]:.3g} s apart: must be more than 0 s and at most {MAX_GAP_S:g} s'
            )
        near = np.array([NEAR[unit] for unit in limits.units])
        velocities = _slopes(times, positions)
        rest = np.array([REST[unit] for unit in limits.units])
        resting = np.all(np.abs(velocities) < rest, axis=1)
        resting[[0, -1]] = True
        velocities[resting] = 0.0
        changes = np.flatnonzero(np.diff(resting))  # the last sample of a rest, and of a motion
        start = int(changes[0]) if len(changes) else 0
        anchors = {start, len(times) - 1, *(changes + resting[changes + 1])[1:].tolist()}
        indices = _corners(times, positions / near, sorted(anchors))
        times, path, velocities = times[indices], positions[indices], velocities[indices]
        for index in range(1, len(path)):  # keep the arm at rest instead of letting it creep
            pair = slice(index - 1, index + 1)
            if not velocities[pair].any() and (np.abs(np.diff(path[pair], axis=0)) < near).all():
                path[index] = path[index - 1]
        return Trajectory(limits.names, (times - times[0]) / speed, path, velocities * speed)

    def _check_any(self) -> None:
        if not self._rows:
            raise RobotError('the recording is empty, because no joint positions were received')

    def _take(self, sample: 'JointSample') -> None:
        if not self._rows:
            self._start = sample.measured
        time = sample.measured - self._start
        if time < self._next - self._period / 4.0:
            return
        self._next = max(self._next + self._period, time + max(self._period / 2.0, 1e-3))
        self._rows.append((time, sample.positions.copy()))
        if time > LONGEST_S:
            self.stop()


def _corners(times: Array, rows: Array, anchors: Sequence[int]) -> Array:
    """Return the indices of the rows that a replay needs, including `anchors`.

    A polyline through these rows deviates from every row by at most 1, in the unit of `rows`.
    """
    indices, open_parts = set(anchors), list(pairwise(anchors))
    while open_parts:
        first, last = open_parts.pop()
        if last - first < 2:
            continue
        fraction = (times[first + 1 : last] - times[first]) / (times[last] - times[first])
        path = rows[first] + fraction[:, None] * (rows[last] - rows[first])
        away = np.abs(rows[first + 1 : last] - path).max(axis=1)
        if away.max() > 1.0:
            middle = first + 1 + int(away.argmax())
            indices.add(middle)
            open_parts += [(first, middle), (middle, last)]
    return np.array(sorted(indices))


def _slopes(times: Array, positions: Array) -> Array:
    """Return the velocity at each sample, shape (k, n): the slope of a line through neighbours."""
    result = np.zeros_like(positions)
    for index in range(len(times)):
        near = slice(max(index - SLOPE_SAMPLES, 0), index + SLOPE_SAMPLES + 1)
        passed = times[near] - times[near].mean()
        if len(passed) > 1:
            result[index] = passed @ positions[near] / (passed @ passed)
    return result
