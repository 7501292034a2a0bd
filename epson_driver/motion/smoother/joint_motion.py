# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motions off the path, from a moving state: the fastest stop, and the move to another start."""

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, Synchronization
from ruckig import Trajectory as RuckigTrajectory

from epson_driver.motion.limits import Array, JointLimits

State = tuple[Array, Array, Array]
"""Position, velocity, acceleration of each joint, shapes (n,)."""


class JointMotion:
    """A motion of n joints as a function of the time since it began. `duration` is in s."""

    def __init__(self, course: RuckigTrajectory) -> None:
        self._course = course
        self.duration: float = course.duration
        self.end: Array = np.array(course.at_time(course.duration)[0])

    def at(self, time: float) -> State:
        """Return position, velocity, acceleration at a time, shapes (n,)."""
        if time >= self.duration:
            zeros = np.zeros_like(self.end)
            return self.end.copy(), zeros, zeros.copy()
        position, velocity, acceleration = self._course.at_time(max(time, 0.0))
        return np.array(position), np.array(velocity), np.array(acceleration)

    def within(self, limits: JointLimits) -> bool:
        """Return whether all positions are within the limits (Ruckig minds the others)."""
        low, high = np.array(
            [(extrema.min, extrema.max) for extrema in self._course.position_extrema]
        ).T
        slack = 1e-9
        return bool(
            np.all(low >= limits.position_min - slack)
            and np.all(high <= limits.position_max + slack)
        )


def fastest_stop(limits: JointLimits, state: State) -> JointMotion:
    """Return the fastest stop of all joints together.

    Each by itself where together a joint would leave its position limits on the longer way.
    """
    together = _stop(limits, state, Synchronization.Time)
    if together.within(limits):
        return together
    return _stop(limits, state, Synchronization.No)


def _stop(limits: JointLimits, state: State, synchronization: Synchronization) -> JointMotion:
    inp = _from(limits, state)
    inp.control_interface = ControlInterface.Velocity
    inp.target_velocity = [0.0] * len(limits.names)
    inp.synchronization = synchronization
    motion = _solved(inp)
    if motion is None:
        raise RuntimeError(f'ruckig found no stop from {state}')
    return motion


def fastest_move(limits: JointLimits, state: State, target: Array) -> JointMotion | None:
    """Return the fastest move to rest at `target`, or None if it would leave position limits."""
    inp = _from(limits, state)
    inp.target_position = target.tolist()
    motion = _solved(inp)
    return motion if motion is not None and motion.within(limits) else None


def _from(limits: JointLimits, state: State) -> InputParameter:
    inp = InputParameter(len(limits.names))
    position, velocity, acceleration = state
    inp.current_position = position.tolist()
    inp.current_velocity = np.clip(velocity, -limits.velocity, limits.velocity).tolist()
    inp.current_acceleration = np.clip(
        acceleration, -limits.acceleration, limits.acceleration
    ).tolist()
    inp.max_velocity = limits.velocity.tolist()
    inp.max_acceleration = limits.acceleration.tolist()
    inp.max_jerk = limits.jerk.tolist()
    return inp


def _solved(inp: InputParameter) -> JointMotion | None:
    course = RuckigTrajectory(inp.degrees_of_freedom)
    try:
        result = Ruckig(inp.degrees_of_freedom).calculate(inp, course)
    except (RuntimeError, ValueError):  # RuckigError; a code that the enum does not have
        return None
    if result not in (Result.Working, Result.Finished):
        return None
    return JointMotion(course)
