# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint motions made of pieces of constant jerk: the fastest stops and moves from any state."""

from collections.abc import Iterator

import numpy as np
from ruckig import ControlInterface, InputParameter, Synchronization
from ruckig import Trajectory as RuckigTrajectory

from epson_driver.motion.interpolation import after
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.point_to_point import calculated, solve

MAX_ATTEMPTS = 40
"""Maximum number of attempts to stop with a reversal. Each attempt doubles the target's distance
from the position limit."""

MIN_REVERSAL = 1e-9
"""Distance of the target from the position limit in the first attempt to stop and reverse, rad."""

STOP_TOLERANCE = 1e-12
"""Tolerance for rounding at a position limit in a stop, rad."""

State = tuple[Array, Array, Array]
"""Position, velocity, acceleration of each joint, shapes (n,)."""

LIMIT_TOLERANCE_SHARE = 1e-6
"""Tolerance for rounding at a velocity, acceleration or jerk limit, relative to it."""

POSITION_TOLERANCE = 1e-11
"""Tolerance for rounding at a position limit, rad."""

TARGET_TOLERANCE = 1e-9
"""Maximum distance of the end of a move from its target, rad."""

REST_SHARE = 1e-9
"""Fraction of the velocity and acceleration limits that counts as rest."""


class JointMotion:
    """A motion of n joints, in which each joint has k pieces of constant jerk.

    durations, jerks: duration, s, and jerk of each piece, shape (n, k). times: start times of the
    pieces, and the end time, shape (n, k + 1), s. states: positions, velocities and accelerations
    at these times, shape (3, n, k + 1).
    """

    def __init__(self, state: State, durations: Array, jerks: Array) -> None:
        count, pieces = durations.shape
        self.times = np.concatenate([np.zeros((count, 1)), np.cumsum(durations, axis=1)], axis=1)
        self.jerks = jerks
        self.states = np.empty((3, count, pieces + 1))
        self.states[:, :, 0] = state
        for piece in range(pieces):
            t, j = durations[:, piece], jerks[:, piece]
            p, v, a = self.states[:, :, piece]
            self.states[:, :, piece + 1] = after(t, p, v, a, j)
        self.duration = float(self.times[:, -1].max())
        self.end: Array = self.states[0, :, -1].copy()

    def at(self, time: float) -> State:
        """Return the state at a time, s. After the end of the motion, the joints are at rest."""
        if time >= self.duration:
            zeros = np.zeros_like(self.end)
            return self.end.copy(), zeros, zeros.copy()
        time = max(time, 0.0)
        joints = np.arange(len(self.end))
        piece = np.sum(self.times[:, 1:] <= time, axis=1)
        resting = piece == self.jerks.shape[1]
        piece[resting] -= 1
        since = time - self.times[joints, piece]
        p, v, a = self.states[:, joints, piece]
        position, velocity, acceleration = after(since, p, v, a, self.jerks[joints, piece])
        position[resting] = self.end[resting]
        velocity[resting] = acceleration[resting] = 0.0
        return position, velocity, acceleration

    def positions(self, times: Array) -> Array:
        """Return the positions at m times, ≥ 0 s, shape (m, n)."""
        ends, last = self.times[:, 1:], self.jerks.shape[1]
        piece = np.sum(ends <= times[:, None, None], axis=2)
        resting = piece == last
        piece[resting] -= 1
        joints = np.arange(len(self.end))
        since = times[:, None] - self.times[joints, piece]
        p, v, a = self.states[:, joints, piece]
        position = after(since, p, v, a, self.jerks[joints, piece])[0]
        result: Array = np.where(resting, self.end, position)
        return result

    def within(self, limits: JointLimits) -> bool:
        _, velocity, acceleration = self.states
        return bool(
            np.all(np.abs(velocity[:, -1]) <= REST_SHARE * limits.velocity)
            and np.all(np.abs(acceleration[:, -1]) <= REST_SHARE * limits.acceleration)
            and self.respects(limits)
        )

    def respects(self, limits: JointLimits) -> bool:
        """Return whether the motion respects all limits at every instant."""
        lowest, highest = self.extent
        return bool(
            max(self.limit_usage(limits)) <= 1.0 + LIMIT_TOLERANCE_SHARE
            and np.all(lowest >= limits.position_min - POSITION_TOLERANCE)
            and np.all(highest <= limits.position_max + POSITION_TOLERANCE)
        )

    def limit_usage(self, limits: JointLimits) -> tuple[float, float, float]:
        """Return the maximum velocity, acceleration and jerk, as multiples of their limits."""
        _, velocity, acceleration = self.states
        t, j = np.diff(self.times, axis=1), self.jerks
        p, v, a = self.states[:, :, :-1]
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            fastest = _between(-a / j, t)
        speeds = np.concatenate([velocity, after(fastest, p, v, a, j)[1]], axis=1)
        return (
            float(np.max(np.abs(speeds).max(axis=1) / limits.velocity)),
            float(np.max(np.abs(acceleration).max(axis=1) / limits.acceleration)),
            float(np.max(np.abs(j).max(axis=1) / limits.jerk)),
        )

    @property
    def extent(self) -> tuple[Array, Array]:
        """Lowest and highest position of each joint, shapes (n,), rad."""
        t, j = np.diff(self.times, axis=1), self.jerks
        p, v, a = self.states[:, :, :-1]
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            # both zeros of v + a t + j t² / 2
            root = -(a + np.copysign(np.sqrt(np.maximum(a * a - 2.0 * j * v, 0.0)), a))
            reversals = (_between(root / j, t), _between(2.0 * v / root, t))
        places = np.concatenate(
            [self.states[0], *(after(reversal, p, v, a, j)[0] for reversal in reversals)], axis=1
        )
        return places.min(axis=1), places.max(axis=1)


def _between(times: Array, durations: Array) -> Array:
    """Return times clipped to 0 … duration, with 0 for NaN."""
    between: Array = np.clip(np.where(np.isnan(times), 0.0, times), 0.0, durations)
    return between


def stop_joints(limits: JointLimits, state: State) -> JointMotion:
    """Return the fastest stop of each joint separately.

    A joint whose fastest stop would pass its position limit brakes harder and reverses.
    """
    joints = enumerate(zip(*state, strict=True))
    return motion_of(state, [_stop(limits, joint, own) for joint, own in joints])


def _stop(limits: JointLimits, joint: int, state: tuple[float, float, float]) -> RuckigTrajectory:
    low = min(limits.position_min[joint], state[0]) - STOP_TOLERANCE
    high = max(limits.position_max[joint], state[0]) + STOP_TOLERANCE
    inp = InputParameter(1)
    inp.max_velocity = [limits.velocity[joint]]
    inp.max_acceleration = [limits.acceleration[joint]]
    inp.max_jerk = [limits.jerk[joint]]
    (inp.current_position, inp.current_velocity, inp.current_acceleration) = (
        [value] for value in state
    )
    inp.target_velocity = [0.0]
    inp.control_interface = ControlInterface.Velocity
    trajectory = solve(inp)
    if _within(trajectory, low, high):
        return trajectory
    end = trajectory.at_time(trajectory.duration)[0][0]
    limit, inward = (high, -1.0) if end > high or state[1] > 0.0 else (low, 1.0)
    inp.control_interface = ControlInterface.Position
    for attempt in range(MAX_ATTEMPTS):
        target = limit + inward * MIN_REVERSAL * 2.0**attempt
        if not low <= target <= high:
            break
        inp.target_position = [target]
        reversal = calculated(inp)
        if reversal is not None and _within(reversal, low, high):
            return reversal
    return trajectory


def _within(trajectory: RuckigTrajectory, low: float, high: float) -> bool:
    (extrema,) = trajectory.position_extrema
    return bool(extrema.min >= low and extrema.max <= high)


def fastest_stop(limits: JointLimits, state: State) -> JointMotion:
    """Return the fastest stop in which all joints end together, within the limits.

    If a joint would leave its position limits in this stop, all joints stop independently. A joint
    that would still leave its limits reverses (see `stop_joints`).
    """
    motion = None
    for motion in _stops(limits, state):
        if motion.within(limits):
            return motion
    if motion is None:
        raise RuntimeError(f'ruckig found no stop from {state}')
    return motion


def _stops(limits: JointLimits, state: State) -> Iterator[JointMotion]:
    inp = _ruckig_input(limits, state)
    inp.control_interface = ControlInterface.Velocity
    inp.target_velocity = [0.0] * len(limits.names)
    for synchronization in (Synchronization.Time, Synchronization.No):
        inp.synchronization = synchronization
        motion = _solved(inp, state)
        if motion is not None:
            yield motion
    yield stop_joints(limits, state)


def fastest_move(limits: JointLimits, state: State, target: Array) -> JointMotion | None:
    """Return the fastest move to rest at `target`, or None if it would exceed a limit."""
    inp = _ruckig_input(limits, state)
    corrected = target
    for _ in range(2):  # Ruckig may miss the target by 1e-8 rad: the second attempt corrects this
        inp.target_position = corrected.tolist()
        motion = _solved(inp, state)
        if motion is None:
            return None
        missed = motion.end - target
        if np.max(np.abs(missed)) <= TARGET_TOLERANCE:
            return motion if motion.within(limits) else None
        corrected = corrected - missed
    return None


def _ruckig_input(limits: JointLimits, state: State) -> InputParameter:
    """Return Ruckig's input. Limits that the state exceeds by rounding are raised to the state."""
    inp = InputParameter(len(limits.names))
    position, velocity, acceleration = state
    inp.current_position = position.tolist()
    inp.current_velocity = velocity.tolist()
    inp.current_acceleration = acceleration.tolist()
    inp.max_velocity = np.maximum(limits.velocity, np.abs(velocity)).tolist()
    inp.max_acceleration = np.maximum(limits.acceleration, np.abs(acceleration)).tolist()
    inp.max_jerk = limits.jerk.tolist()
    return inp


def _solved(inp: InputParameter, state: State) -> JointMotion | None:
    trajectory = calculated(inp)
    return None if trajectory is None else motion_of(state, [trajectory])


def motion_of(state: State, trajectories: list[RuckigTrajectory]) -> JointMotion:
    """Return one motion from one Ruckig trajectory of all joints, or from one for each joint."""
    profiles = [profile for trajectory in trajectories for profile in trajectory.profiles[0]]
    durations = [[*profile.brake.t, *profile.t] for profile in profiles]
    jerks = [[*profile.brake.j, *profile.j] for profile in profiles]
    return JointMotion(state, np.array(durations), np.array(jerks))
