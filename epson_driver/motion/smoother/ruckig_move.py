# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Timings that are a single jerk-limited move along the path, or a stop, found by Ruckig.

u is the path parameter, u̇, ü, u⃛ are its time derivatives, and q′ is the derivative of the joint
positions with respect to u.
"""

import numpy as np
from ruckig import ControlInterface, InputParameter

from epson_driver.motion.point_to_point import calculated
from epson_driver.motion.smoother.limit_usage import BACKWARD_SPEED
from epson_driver.motion.smoother.request import Problem
from epson_driver.motion.time_parametrisation import (
    State,
    TimeParametrisation,
    from_ruckig,
)

REACHES_IN_STOPPING_DISTANCES = (0.75, 0.25, 0.08, 0.025, 0.008, 0.0025)
"""Lengths of a move that are tried. The unit is the stopping distance from the velocity limit."""

SLOW_TIME_RATIO = 5.0
"""A move is slow if it takes more than this multiple of the sum of the time at the highest speed
and the time of a stop. A sharp bend slows down the whole move, so a move that ends before the bend
is better."""

HARDNESS_SHARES = (0.999, 0.9, 0.5, 0.2)
"""Accelerations and jerks that are tried, as fractions of those that the path's slope allows. The
first is below 1 because of rounding on a path without bends."""

SPEED_BISECTIONS = 6

MAX_SPEED = 10.0
"""Maximum u̇ on a path where no joint moves. Otherwise u̇ is about 1 at full speed."""

MIN_SPEED_SHARE = 3e-3
"""Lowest speed that is tried, as a fraction of the highest."""


def propose(problem: Problem) -> TimeParametrisation | None:
    """Return the verified move with the highest mean speed, or None if none was found.

    The move may end before the end of the path. If all moves are slow, the result is the shortest
    move if the arm is at rest, and None if the arm moves. (The current plan then brings the arm to
    rest soon, and a start from rest has more options.)
    """
    limits = problem.limits
    unit = float(
        np.max(limits.velocity / limits.acceleration) + np.max(limits.acceleration / limits.jerk)
    )
    u = problem.start[0]
    best: TimeParametrisation | None = None
    best_rank = (-np.inf, 0.0)
    for reach in REACHES_IN_STOPPING_DISTANCES:
        end = min(problem.end, u + reach * unit)
        velocity, acceleration, jerk = slope_bounds(problem, end)
        for hardness in HARDNESS_SHARES:
            if problem.effort.used_up:
                break
            timing = _fastest(problem, end, velocity, acceleration * hardness, jerk * hardness)
            if timing is None:
                continue
            rank = _rank(timing, SLOW_TIME_RATIO * (unit + (timing.end - u) / velocity))
            if rank > best_rank:
                best, best_rank = timing, rank
        if problem.effort.used_up or (best_rank[0] == 0.0 and end < problem.end):
            break
    if best_rank[0] < 0.0 and problem.start[1] > 0.0:
        return None
    return best


def only_move(problem: Problem) -> TimeParametrisation | None:
    """Return the verified, optimal move to the end of a straight path, or None."""
    velocity, acceleration, jerk = slope_bounds(problem, problem.end)
    hardness = HARDNESS_SHARES[0]
    return _fastest(problem, problem.end, velocity, acceleration * hardness, jerk * hardness)


def _rank(timing: TimeParametrisation, longest: float) -> tuple[float, float]:
    """Return the sort key of a move. A longer one than `longest` s ranks below all others."""
    if timing.duration > longest:
        return -timing.duration, 0.0
    return 0.0, (timing.end - float(timing.positions[0])) / timing.duration


def _fastest(
    problem: Problem, end: float, velocity: float, acceleration: float, jerk: float
) -> TimeParametrisation | None:
    """Return the verified move to u = `end` with the highest speed, by bisection, or None.

    The speed has a lower bound, because with less the move would reverse from the initial state.
    """
    low, high = velocity * MIN_SPEED_SHARE, velocity
    result: TimeParametrisation | None = None
    for turn in range(SPEED_BISECTIONS):
        if problem.effort.used_up:
            break
        speed = high if turn == 0 else float(np.sqrt(low * high))
        timing = move(problem.start, end, speed, acceleration, jerk)
        if timing is not None and problem.usage(timing).allowed:
            if turn == 0:
                return timing
            result, low = timing, speed
        elif turn > 0 and timing is not None and timing.velocities.min() < -BACKWARD_SPEED:
            low = speed
        else:
            high = speed
    return result


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


def move(
    start: State, end: float, velocity: float, acceleration: float, jerk: float
) -> TimeParametrisation | None:
    """Return the fastest move to rest at u = `end` within bounds of u̇, ü and u⃛, or None."""
    inp = InputParameter(1)
    inp.current_position, inp.current_velocity, inp.current_acceleration = (
        [value] for value in start
    )
    inp.target_position = [end]
    inp.max_velocity = [velocity]
    inp.max_acceleration, inp.max_jerk = [acceleration], [jerk]
    timing = _solved(inp)
    if timing is not None:
        timing.positions[-1] = end  # without the rounding of the integration
    return timing


def brake(start: State, acceleration: float, jerk: float) -> TimeParametrisation | None:
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
    return timing if len(timing.jerks) else None  # None: already at rest


def slope_bounds(problem: Problem, end: float) -> tuple[float, float, float]:
    """Return upper bounds of u̇, ü, u⃛ on the path up to u = `end` that follow from q′ alone."""
    us = np.linspace(problem.start[0], end, 64)
    _, first, _, _ = problem.path.sample(us)
    limits = problem.limits
    fraction = np.max(np.abs(first), axis=0)
    steepest = np.where(fraction > 0.0, fraction, np.inf)
    return (
        min(float(np.max(problem.target_speeds(us, first))), MAX_SPEED),
        float(np.min(np.where(fraction > 0.0, limits.acceleration / steepest, np.inf))),
        float(np.min(np.where(fraction > 0.0, limits.jerk / steepest, np.inf))),
    )
