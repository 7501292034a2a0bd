# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One jerk-limited Ruckig move along the path: to its end from rest, or to a stop."""

import numpy as np
from ruckig import ControlInterface, InputParameter

from epson_driver.motion.limits import JointLimits
from epson_driver.motion.ruckig_trajectory import calculated
from epson_driver.motion.smoother.limit_usage import BACKWARD_SPEED
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.time_parametrisation import (
    State,
    TimeParametrisation,
    from_ruckig,
)

HARDNESS_SHARE = 0.999
"""Of the acceleration and the jerk that the path's slope allows: what is rounded would exceed them
with all of it."""

SPEED_BISECTIONS = 6

MAX_SPEED = 10.0
"""u̇ is about 1 at full speed; a path that stands still allows any."""

MIN_SPEED_SHARE = 3e-3
"""The least share of the highest speed that is tried."""


def only_move(problem: Problem) -> TimeParametrisation | None:
    """Return the verified move along a straight path to its end, or None: no timing is faster."""
    velocity, acceleration, jerk = slope_bounds(problem, problem.end)
    acceleration, jerk = HARDNESS_SHARE * acceleration, HARDNESS_SHARE * jerk
    return _fastest(problem, problem.end, velocity, acceleration, jerk)


def _fastest(
    problem: Problem, end: float, velocity: float, acceleration: float, jerk: float
) -> TimeParametrisation | None:
    """Return the verified move with the highest speed, found by bisection.

    A speed can be too low as well: what is too fast for it turns back.
    """
    low, high = velocity * MIN_SPEED_SHARE, velocity
    found: TimeParametrisation | None = None
    for turn in range(SPEED_BISECTIONS):
        if problem.effort.used_up:
            break
        speed = high if turn == 0 else float(np.sqrt(low * high))
        timing = move(problem.start, end, speed, acceleration, jerk)
        if timing is not None and problem.usage(timing).allowed:
            if turn == 0:
                return timing
            found, low = timing, speed
        elif turn > 0 and timing is not None and timing.velocities.min() < -BACKWARD_SPEED:
            low = speed
        else:
            high = speed
    return found


def stop(problem: Problem) -> TimeParametrisation | None:
    """Return the fastest verified stop on the path, or None if none was found."""
    _, acceleration, jerk = slope_bounds(problem, problem.end)
    for hardness in (1.0, 0.7, 0.5, 0.35):
        timing = brake(problem.start, acceleration * hardness, jerk * hardness)
        if (
            timing is None
            or timing.end > problem.end
            or np.any(timing.velocities < -BACKWARD_SPEED)
        ):
            continue
        if problem.usage(timing).allowed:
            return timing
    return None


def gentle_stop(
    start: State, path: Path, limits: JointLimits, hardness: float = 0.5
) -> TimeParametrisation | None:
    """Return a stop with a part of what the path's slope at the start allows. Not verified."""
    _, first, _ = path.at(start[0])
    with np.errstate(divide='ignore'):
        return brake(
            start,
            hardness * float(np.min(limits.acceleration / np.abs(first))),
            hardness * float(np.min(limits.jerk / np.abs(first))),
        )


def move(
    start: State, end: float, velocity: float, acceleration: float, jerk: float
) -> TimeParametrisation | None:
    """Return the fastest move to rest at `end` within bounds on u̇, ü, u⃛."""
    inp = InputParameter(1)
    inp.current_position, inp.current_velocity, inp.current_acceleration = (
        [value] for value in start
    )
    inp.target_position = [end]
    inp.max_velocity = [velocity]
    inp.max_acceleration, inp.max_jerk = [acceleration], [jerk]
    timing = _solved(inp)
    if timing is not None:
        timing.positions[-1] = end  # without the rounding of the way there
    return timing


def brake(start: State, acceleration: float, jerk: float) -> TimeParametrisation | None:
    """Return the fastest stop within bounds on ü, u⃛."""
    inp = InputParameter(1)
    inp.control_interface = ControlInterface.Velocity
    inp.current_position, inp.current_velocity, inp.current_acceleration = (
        [value] for value in start
    )
    inp.target_velocity = [0.0]
    inp.max_velocity = [max(abs(start[1]), 1.0)]
    inp.max_acceleration, inp.max_jerk = [acceleration], [jerk]
    return _solved(inp)


def _solved(inp: InputParameter) -> TimeParametrisation | None:
    trajectory = calculated(inp)
    if trajectory is None or trajectory.duration == 0.0:
        return None
    timing = from_ruckig(trajectory)
    return timing if len(timing.jerks) else None  # as good as at rest


def slope_bounds(problem: Problem, end: float) -> tuple[float, float, float]:
    """Return bounds on u̇, ü, u⃛ from q′ on the way."""
    us = np.linspace(problem.start[0], end, 64)
    _, first, _, _ = problem.path.sample(us)
    limits = problem.limits
    share = np.max(np.abs(first), axis=0)
    steepest = np.where(share > 0.0, share, np.inf)
    return (
        min(float(np.max(problem.wanted(us, first))), MAX_SPEED),
        float(np.min(np.where(share > 0.0, limits.acceleration / steepest, np.inf))),
        float(np.min(np.where(share > 0.0, limits.jerk / steepest, np.inf))),
    )
