# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The function `smooth`, which smooths waypoints into a motion."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import JointLimits
from epson_driver.motion.trajectory import Trajectory, problems

MAX_MENTIONED_PROBLEMS = 3


def smooth(
    waypoints: npt.ArrayLike,
    limits: JointLimits,
    times: npt.ArrayLike | None = None,
    *,
    period: float = 0.004,
    path_tolerance: float = 0.0,
    catch_up: float = np.inf,
    refine: bool = True,
    look_ahead: float = np.inf,
    planner: Callable[..., Any] | None = None,
) -> Trajectory:
    """Return a smooth motion from rest to rest through waypoints, one point every `period` s.

    waypoints: shape (k, n), rad (or m), with the joints in the order of the limits. times:
    commanded time of each waypoint, shape (k,), s. The motion respects these times where the
    limits allow it. Without times, the motion is as fast as the limits allow. `smoothed` describes
    the other arguments. Raises ValueError if an argument is invalid or the motion would exceed a
    limit.
    """
    from epson_driver.motion.smoothed import smoothed  # most programs need no smoother
    from epson_driver.motion.smoother import Mode, plan

    positions = np.asarray(waypoints, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != len(limits.names):
        shape = f'(k, {len(limits.names)}), one column for each of {", ".join(limits.names)}'
        raise ValueError(f'waypoints have the shape {positions.shape}: must be {shape}')
    count = len(positions)
    planned = np.asarray(np.arange(count) * 0.5 if times is None else times, dtype=np.float64)
    if planned.shape != (count,):
        raise ValueError(f'times have the shape {planned.shape}: must be ({count},)')
    trajectory = Trajectory(limits.names, planned, positions)
    if result := list(problems(trajectory, limits, too_fast=False)):
        more = len(result) - MAX_MENTIONED_PROBLEMS
        text = '; '.join(result[:MAX_MENTIONED_PROBLEMS])
        raise ValueError(f'{text}; and {more} more' if more > 0 else text)
    return smoothed(
        trajectory,
        limits,
        Mode.TIME_OPTIMAL if times is None else Mode.TIME_PRESERVING,
        look_ahead,
        period,
        planner or plan,
        refine=refine,
        path_tolerance=path_tolerance,
        catch_up=catch_up,
    )
