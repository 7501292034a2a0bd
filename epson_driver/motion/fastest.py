# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fastest motion from rest to rest through waypoints that are all known in advance.

`transcription` improves an initial motion: a spline through the waypoints, with speeds along it
that ignore the jerk limits. Its result is slowed down until it respects each limit at every
instant. u is the path parameter of the spline.
"""

from collections.abc import Callable
from math import ceil

import numpy as np
import numpy.typing as npt

from epson_driver.motion.joint_motion import JointMotion
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.path import Knots, Path, through
from epson_driver.motion.smoother.request import Problem as PathProblem
from epson_driver.motion.smoother.speed_bounds import SpeedBounds, SpeedProfile
from epson_driver.motion.transcription import STEPS, Problem, Search

MAX_SEARCH_STEPS = 160

MAX_INTERVAL_SHARE = 0.6
"""Maximum time between two knots, as a fraction of the shortest acceleration ramp of a joint."""

MAX_PARTS = 10

MIN_INTERVAL_S = 2e-3
"""Minimum initial duration of the interval between two knots, s."""

BEND_RATIO = 1.5
"""Maximum distance of the motion from the line between two waypoints, relative to the spline's."""

MIN_BEND = 0.002
"""Distance of the motion from the line between two waypoints that is always allowed, rad (m)."""

NEIGHBOUR_SHARE = 0.25
"""Maximum tolerance at a waypoint, as a fraction of the distance to the nearer neighbour."""

MAX_INTERVALS = 2000
"""Maximum number of intervals between knots. The search takes 2 to 4 ms for each of them."""

MAX_LINE_S = 0.1
"""Maximum time of a line from which waypoints may be left out, s."""

MAX_PATH_TOLERANCE = 0.5
"""Maximum tolerance at a waypoint in every joint, rad (or m)."""


def fastest(
    waypoints: Array,
    limits: JointLimits,
    tolerance: float = 0.0,
    *,
    bend_ratio: float = BEND_RATIO,
    interval_share: float = MAX_INTERVAL_SHARE,
    checkpoint: Callable[[], None] = lambda: None,
) -> JointMotion | None:
    """Return the fastest motion found through waypoints, or None if none was found.

    waypoints: shape (k, n), k ≥ 3, rad (or m), each different from the previous one. The motion
    rests exactly at the first and last waypoint, passes the others within `tolerance` in every
    joint, and respects all limits at every instant. The jerks of all joints change at the same
    times. bend_ratio, interval_share: see BEND_RATIO and MAX_INTERVAL_SHARE. checkpoint: called
    before each step of the search. It may raise to cancel.
    """
    path, profile = _spline(waypoints, limits)
    times = np.interp(path.knots.u, profile.positions, profile.times)
    longest = interval_share * float(np.min(limits.acceleration / limits.jerk))
    durations = np.maximum(np.diff(times), MIN_INTERVAL_S).tolist()
    parts = [min(ceil(segment / longest), MAX_PARTS) for segment in durations]
    if sum(parts) > MAX_INTERVALS:
        return None
    segment = np.repeat(np.arange(len(parts)), parts)
    first = np.append(0, np.cumsum(parts))
    instants = np.interp(np.arange(first[-1] + 1), first, times)
    us = np.interp(instants, profile.times, profile.positions)
    us[first] = path.knots.u
    speeds = np.interp(instants, profile.times, profile.speeds)[:, None]
    position, slope, bend, _ = path.sample(us)
    velocity = np.clip(slope * speeds, -0.95 * limits.velocity, 0.95 * limits.velocity)
    upper = 0.9 * limits.acceleration
    acceleration = np.clip(bend * speeds**2, -upper, upper)
    position[first], velocity[[0, -1]], acceleration[[0, -1]] = waypoints, 0.0, 0.0
    chords = np.diff(waypoints, axis=0)
    bends = np.maximum(bend_ratio * path.bends(), MIN_BEND) + tolerance
    tolerances = np.full(len(us), np.inf)
    tolerances[first] = _tolerances(waypoints, limits, tolerance)
    problem = Problem(limits, waypoints[segment], chords[segment], bends[segment], tolerances)
    knots = np.stack([position, velocity, acceleration], axis=2)
    search = Search(problem, knots, np.maximum(np.diff(instants), MIN_INTERVAL_S))
    with np.errstate(over='ignore', invalid='ignore'):  # a step that overflows ends the search
        try:
            return _searched(search, waypoints[0], limits, checkpoint)
        except np.linalg.LinAlgError:
            return None


def corners(waypoints: Array, limits: JointLimits) -> npt.NDArray[np.intp]:
    """Return the indices of waypoints that determine the path, among them the first and the last.

    The others are within MIN_BEND of a line between two of them that takes at most MAX_LINE_S at
    full speed.
    """
    path, profile = _spline(waypoints, limits)
    times = np.interp(path.knots.u, profile.positions, profile.times)
    indices = [0]
    while (start := indices[-1]) < len(waypoints) - 1:
        end = int(times.searchsorted(times[start] + MAX_LINE_S, side='right')) - 1
        while end > start + 1 and _distance(waypoints[start : end + 1]) > MIN_BEND:
            end -= 1
        indices.append(max(end, start + 1))
    return np.array(indices)


def _distance(points: Array) -> float:
    """Return the maximum distance of points, in any joint, from the line between both ends."""
    chord, since = points[-1] - points[0], points - points[0]
    along = np.clip(since @ chord / (chord @ chord), 0.0, 1.0)
    return float(np.abs(since - along[:, None] * chord).max())


def _spline(waypoints: Array, limits: JointLimits) -> tuple[Path, SpeedProfile]:
    start = np.zeros((1, waypoints.shape[1]))
    path = through(
        Knots(np.zeros(1), waypoints[:1], start, start), waypoints[1:], limits, False, True
    )
    return path, SpeedBounds(PathProblem(path, (0.0, 0.0, 0.0), limits)).profile()


def _searched(
    search: Search, start: Array, limits: JointLimits, checkpoint: Callable[[], None]
) -> JointMotion | None:
    for _ in range(MAX_SEARCH_STEPS):
        checkpoint()
        if not search.step():
            return None
        if search.converged:
            motion = _slowed(start, *search.result(), limits)
            if motion is not None:
                return motion  # otherwise rounding took it out of the range: continue
    return None


def _tolerances(waypoints: Array, limits: JointLimits, tolerance: float) -> Array:
    """Return the tolerance at each waypoint, shape (k,), which is 0 close to a position limit."""
    lengths = np.abs(np.diff(waypoints, axis=0)).max(axis=1)
    result = np.zeros(len(waypoints))
    result[1:-1] = np.minimum(tolerance, NEIGHBOUR_SHARE * np.minimum(lengths[:-1], lengths[1:]))
    room = np.minimum(waypoints - limits.position_min, limits.position_max - waypoints)
    result[room.min(axis=1) < result] = 0.0
    return result


def _slowed(
    start: Array, jerks: Array, durations: Array, limits: JointLimits
) -> JointMotion | None:
    """Return the motion slowed down just enough to respect the limits, or None if it still fails.

    jerks: shape (m, n, STEPS), rad/s³. durations: duration of each interval, shape (m,), s.
    """
    n = len(start)
    steps = np.tile(np.repeat(durations / STEPS, STEPS), (n, 1))
    pieces = jerks.transpose(1, 0, 2).reshape(n, -1)
    at_rest = (start, np.zeros(n), np.zeros(n))
    motion = JointMotion(at_rest, steps, pieces)
    velocity, acceleration, jerk = motion.limit_usage(limits)
    slower = max(1.0, velocity, acceleration**0.5, jerk ** (1.0 / 3.0))
    motion = JointMotion(at_rest, slower * steps, pieces / slower**3)
    return motion if motion.within(limits) else None
