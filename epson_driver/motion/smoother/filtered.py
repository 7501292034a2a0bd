# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The second proposer: the speed profile, its jerk limited by a moving average over time.

The mean of u(t) over a window of A/J turns jumps of ü into ramps, and the motion stays on the
path. Where the result exceeds a limit, the speed bound is lowered, and all is done again.
"""

import numpy as np

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother.limit_usage import LimitUsage
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.time_parametrisation import (
    TimeParametrisation,
    from_accelerations,
)

MAX_ROUNDS = 5
MAX_DURATION_S = 20.0
"""A timing that takes longer than this (s) is not tried: the path is no good for this proposer."""

SAMPLE_STEP_S = 0.004
"""Time between the samples of the timing, s."""


def propose(problem: Problem, bounds: SpeedBounds) -> TimeParametrisation | None:
    """Return a verified timing, or None if none was found."""
    factor = np.ones_like(bounds.positions)
    for _ in range(MAX_ROUNDS):
        timing = filtered(problem, bounds, factor)
        if timing is None or problem.effort.used_up:
            return None
        result = problem.usage(timing)
        if result.allowed:
            return timing
        factor *= _tightened(bounds.positions, result, timing, problem)
    return None


def filtered(
    problem: Problem, bounds: SpeedBounds, factor: Array | float = 1.0
) -> TimeParametrisation | None:
    """Return the timing of one round, not verified.

    `factor` lowers the speed bounds, shape (m,).
    """
    window = float(np.max(problem.limits.acceleration / problem.limits.jerk))
    u, v, a = problem.start
    # the past that the moving average needs: constant acceleration, so that its mean is the start
    speed = max(v + a * window / 2.0, 0.0)
    begin = u + speed * window / 2.0 - a * window**2 / 6.0
    if begin >= problem.end:
        return None
    profile = bounds.profile(begin, speed, factor)
    duration = profile.times[-1] + window
    if duration > MAX_DURATION_S:
        return None
    count = int(np.ceil(duration / SAMPLE_STEP_S))
    step = duration / count
    times = np.arange(count + 1) * step
    now = np.interp(times, profile.times, profile.speeds)
    before = np.where(
        times < window,
        speed + a * (times - window),
        np.interp(times - window, profile.times, profile.speeds),
    )
    return from_accelerations(problem.start, problem.end, times, (now - before) / window)


def _tightened(
    us: Array, result: LimitUsage, timing: TimeParametrisation, problem: Problem
) -> Array:
    """Return factors ≤ 1 on the speed bounds where the timing exceeds a limit and around there."""
    ratio = np.maximum(
        np.maximum(result.velocity, np.sqrt(result.acceleration)), np.cbrt(result.jerk)
    )
    too_much = ratio > 1.0
    window = float(np.max(problem.limits.acceleration / problem.limits.jerk))
    factor = np.ones_like(us)
    speed = float(np.max(timing.velocities))
    for u, value in zip(result.positions[too_much], ratio[too_much], strict=True):
        near = np.abs(us - u) < window * speed
        factor[near] = np.minimum(factor[near], 0.97 / value)
    return factor
