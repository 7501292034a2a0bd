# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Straight moves in joint space from rest to rest, like SPEL+'s `Go`, and stops on their line.

All joints start and end together. A move is a single jerk-limited motion along the line. The joint
with the most restrictive limits determines its duration.
"""

from dataclasses import dataclass

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError
from ruckig import Trajectory as RuckigTrajectory

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.trajectory import Trajectory, sample_times, with_gaps

LESS_JERK = 1.0 - 1e-9
"""Factor of the jerk limits in a second attempt, after Ruckig has found no trajectory."""


def calculated(inp: InputParameter) -> RuckigTrajectory | None:
    """Return the trajectory that Ruckig finds, or None if it finds none.

    Ruckig misses some solutions, e.g. if v = a² / j holds exactly, or if a joint needs exactly the
    synchronized duration. A second attempt with slightly lower jerk limits finds them.
    """
    trajectory = _calculated(inp)
    if trajectory is None:
        jerk = inp.max_jerk
        inp.max_jerk = [LESS_JERK * item for item in jerk]
        trajectory = _calculated(inp)
        inp.max_jerk = jerk
    return trajectory


def _calculated(inp: InputParameter) -> RuckigTrajectory | None:
    trajectory = RuckigTrajectory(inp.degrees_of_freedom)
    try:
        result = Ruckig(inp.degrees_of_freedom).calculate(inp, trajectory)
    except (RuckigError, RuntimeError, ValueError):  # ValueError: a code that Result lacks
        return None
    return trajectory if result in (Result.Working, Result.Finished) else None


SHORTEST_MOVE_S = 0.01
"""Duration of a move to the current position, s."""

SAMPLE_PERIOD_S = 0.05
"""Maximum time between points for a controller that executes points at their times, s."""

MIN_APART_S = 1e-3
"""Minimum time between two points at which the jerk changes, s."""

SPEED_SHARE, ACCELERATION_SHARE = 0.999, 0.99
"""Share of the limits that `straight` uses if the motion is sampled."""

LONGEST_SEGMENT_S = 0.5
"""Maximum time between points for other controllers, s. It is short because the driver cannot slow
down a point that it has sent."""

MIN_MOVE = 1e-9
"""Minimum distance of the joint that moves farthest, rad. A shorter move counts as no move."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """A move as seven pieces of constant jerk, and the rest after it as an eighth piece.

    * times: start of each piece, shape (8,), s.
    * distances, velocities, accelerations: values at these times, shape (8,).
    * jerks: jerk of each piece, shape (8,).
    """

    times: Array
    distances: Array
    velocities: Array
    accelerations: Array
    jerks: Array


SPEED_HALVINGS = 20
"""Number of bisection steps in the search for the speed of a given duration. The error is 1e-6."""


class LineMotion:
    """A motion along a line in joint space, from `origin` to `end`, in `duration` s.

    At a distance s, the joints are at origin + s · direction.
    """

    def __init__(
        self,
        limits: JointLimits,
        origin: Array,
        direction: Array,
        trajectory: RuckigTrajectory | None,
        end: Array,
    ) -> None:
        self._limits = limits
        self.origin = origin
        self.direction = direction
        self.end = end
        self._trajectory = trajectory
        self.duration: float = 0.0 if trajectory is None else trajectory.duration

    @property
    def braking(self) -> float:
        """Time at which the deceleration of a move from rest to rest starts, s."""
        if self._trajectory is None:
            return 0.0
        times = self._trajectory.profiles[0][0].t
        cruise = 3
        # without cruise, the deceleration starts in the middle, by symmetry
        return float(sum(times[: cruise + 1])) if times[cruise] > 0.0 else self.duration / 2.0

    @property
    def pieces(self) -> Pieces:
        """The motion along the line, as pieces. Raises ValueError if it ends where it starts."""
        if self._trajectory is None:
            raise ValueError('a move that ends where it starts has no pieces')
        profile = self._trajectory.profiles[0][0]
        times = np.concatenate([[0.0], np.cumsum(profile.t)])
        velocities, accelerations = np.array(profile.v), np.array(profile.a)
        velocities[-1] = accelerations[-1] = 0.0
        jerks = np.array([*profile.j, 0.0])
        return Pieces(times, np.array(profile.p), velocities, accelerations, jerks)

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity, acceleration of each joint, shapes (n,)."""
        if self._trajectory is None or time >= self.duration:
            zeros = np.zeros_like(self.end)
            return self.end.copy(), zeros, zeros.copy()
        (s,), (v,), (a,) = self._trajectory.at_time(max(time, 0.0))
        direction = self.direction
        return self.origin + s * direction, v * direction, a * direction

    def points(self, period: float, *, with_start: bool = True) -> Trajectory:
        """Return the motion as points at most `period` s apart.

        With the start, there is a point wherever the jerk changes: the cubic spline of time
        through the points is then the motion. Raises ValueError if there would be more than
        MAX_POINTS.
        """
        times = sample_times(max(self.duration, SHORTEST_MOVE_S), period)[1:]
        if with_start:
            ends = np.zeros(2) if self._trajectory is None else self.pieces.times
            apart = np.append(True, np.diff(ends) >= MIN_APART_S)
            apart[-1] = True
            times, _ = with_gaps(np.append(ends[apart][:-1], times[-1]), period)
        positions, velocities, _ = zip(*(self.at(time) for time in times.tolist()), strict=True)
        return Trajectory(self._limits.names, times, np.array(positions), np.array(velocities))

    def stop(self, time: float) -> 'LineMotion':
        if self._trajectory is None or time >= self.duration:
            return LineMotion(self._limits, self.end, self.direction, None, self.end)
        state = self._trajectory.at_time(max(time, 0.0))
        inp = _bounds_along(self.direction, self._limits, 1.0, 1.0)
        inp.control_interface = ControlInterface.Velocity
        inp.current_position, inp.current_velocity, inp.current_acceleration = state
        inp.target_velocity = [0.0]
        trajectory = solve(inp)
        (s,), _, _ = trajectory.at_time(trajectory.duration)
        end = self.origin + s * self.direction
        return LineMotion(self._limits, self.origin, self.direction, trajectory, end)


def go(
    limits: JointLimits, start: Array, target: Array, speed: float = 1.0, accel: float = 1.0
) -> LineMotion:
    """Return the fastest move from rest at `start` to rest at `target`, shapes (n,), rad.

    `speed`: fraction (0, 1] of the velocity limits. `accel`: fraction (0, 1] of the acceleration
    and jerk limits. Raises ValueError if a fraction, length or value is invalid, or the target is
    outside the position limits.
    """
    check_fractions(speed, accel)
    _check_vector('start', start, limits)
    check_target(target, limits)
    difference = target - start
    length = float(np.max(np.abs(difference)))
    if length < MIN_MOVE:
        return LineMotion(limits, start.copy(), np.zeros_like(start), None, target.copy())
    direction = difference / length
    inp = _bounds_along(direction, limits, speed, accel)
    inp.current_position = [0.0]
    inp.target_position = [length]
    return LineMotion(limits, start.copy(), direction, solve(inp), target.copy())


def straight(
    start: Array,
    target: Array,
    limits: JointLimits,
    speed: float,
    acceleration: float,
    *,
    sampled: bool,
) -> Trajectory:
    """Return the same move as `go`, as points. Raises the same errors as `go`.

    `sampled`: whether the controller executes points at their times. The motion is then slightly
    slower, as messages carry float32.
    """
    if not sampled:
        return go(limits, start, target, speed, acceleration).points(
            LONGEST_SEGMENT_S, with_start=False
        )
    motion = go(limits, start, target, SPEED_SHARE * speed, ACCELERATION_SHARE * acceleration)
    return motion.points(SAMPLE_PERIOD_S)


def check_fractions(speed: float, accel: float) -> None:
    for name, value in (('speed', speed), ('accel', accel)):
        if not 0.0 < value <= 1.0:
            raise ValueError(f'{name} = {value}: must be in (0, 1]')


def check_target(target: Array, limits: JointLimits) -> None:
    """Raise ValueError unless the target is n finite positions within the position limits."""
    _check_vector('target', target, limits)
    outside = (target < limits.position_min) | (target > limits.position_max)
    if outside.any():
        joint = int(np.argmax(outside))
        low, high = limits.position_min[joint], limits.position_max[joint]
        raise ValueError(
            f'{limits.names[joint]}: target {target[joint]:.6g} is outside the limits '
            f'{low:.6g} … {high:.6g} {limits.units[joint]}'
        )


def _check_vector(name: str, vector: Array, limits: JointLimits) -> None:
    if vector.shape != (len(limits.names),):
        raise ValueError(f'{name}: {vector.size} values for {len(limits.names)} joints')
    if not np.all(np.isfinite(vector)):
        raise ValueError(f'{name} = {vector.tolist()}: not finite')


def go_in(
    limits: JointLimits, start: Array, target: Array, duration: float, speed: float, accel: float
) -> LineMotion:
    """Return the same move as `go`, but slowed down to take at least `duration` s.

    Raises the same errors as `go`.
    """
    motion = go(limits, start, target, speed, accel)
    low, high = 0.0, speed
    if motion.duration >= duration or motion.duration == 0.0:
        return motion
    for _ in range(SPEED_HALVINGS):
        middle = 0.5 * (low + high)
        slower = go(limits, start, target, middle, accel)
        if slower.duration > duration:
            low = middle
        else:
            high, motion = middle, slower
    return motion


def _bounds_along(
    direction: Array, limits: JointLimits, speed: float, accel: float
) -> InputParameter:
    fraction = np.abs(direction)
    inp = InputParameter(1)
    with np.errstate(divide='ignore', over='ignore'):  # a joint at rest imposes no limit
        inp.max_velocity = [float(np.min(limits.velocity / fraction)) * speed]
        inp.max_acceleration = [float(np.min(limits.acceleration / fraction)) * accel]
        inp.max_jerk = [float(np.min(limits.jerk / fraction)) * accel]
    return inp


def solve(inp: InputParameter) -> RuckigTrajectory:
    """Return the trajectory that Ruckig finds. Raises RuntimeError if it finds none."""
    trajectory = calculated(inp)
    if trajectory is None:
        raise RuntimeError(f'ruckig found no trajectory for {inp}')
    return trajectory
