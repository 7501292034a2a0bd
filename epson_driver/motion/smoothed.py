# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Functions that smooth a whole trajectory, and reduce or retime its points."""

from collections.abc import Callable, Iterator, Sequence
from itertools import chain, pairwise
from math import ceil

import numpy as np

from epson_driver.motion.closest_samples import passed
from epson_driver.motion.fastest import MAX_PATH_TOLERANCE, corners, fastest
from epson_driver.motion.joint_motion import JointMotion
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother import MERGE_TOLERANCE, Mode, Plan, Request, Smoother, plan
from epson_driver.motion.smoother.banded import solve_pentadiagonal
from epson_driver.motion.smoother.execution import Observer
from epson_driver.motion.smoother.waypoints import MIN_DWELL_S, MIN_MOVE, Waypoints
from epson_driver.motion.trajectory import Trajectory, with_gaps

MIN_TOLERANCE = 2.0 * MERGE_TOLERANCE
"""Minimum tolerance of `denoised`, rad (or m). The smoother uses half of it to merge points."""

STIFFNESS = 1e3
"""Weight of the accelerations relative to the deviations. With this weight, about 20 points are
averaged."""

FIXED_WEIGHT = 1e12
"""Weight of a point whose position must not change. No weight is larger."""

MAX_ROUNDS = 40

SPARE_RATIO = 1.02
"""Ratio of the duration of `time_optimal` to that of the fastest motion."""

BEND_SHARE = 0.85
"""BEND_RATIO of `time_optimal`. A spline's distance from a line is overestimated by up to 18 %."""

FLOAT32_RATIO = 1.04
"""Minimum distance between the points of `time_optimal`, relative to the one that the smoother
merges, because messages carry float32."""

MIN_GROWTH_RATIO = 1.2


def denoised(trajectory: Trajectory, limits: JointLimits, tolerance: float) -> Trajectory:
    """Return a trajectory without the noise of a recording.

    A motion through every noisy point would be slower than the recorded motion. For each joint,
    with times in units of the mean spacing, the points q are replaced by the points p that

        minimise   Σ wᵢ (pᵢ - qᵢ)² + STIFFNESS · ∫ p̈² dt,

    where the integral is computed from second differences. The weights w start at 1. While points
    deviate by more than the tolerance, their weights are increased. A remaining excess is clipped.

    The smoother's motion through the points p deviates from each point q by at most `tolerance`,
    rad (or m), in each joint. The two ends do not change, nor does a point at which the arm must
    rest. The joints are in the order of the limits. Raises ValueError if the tolerance is below
    MIN_TOLERANCE.
    """
    if not tolerance >= MIN_TOLERANCE:  # NaN too
        raise ValueError(f'the tolerance {tolerance} rad must be {MIN_TOLERANCE:g} or more')
    original = trajectory.in_order(limits.names)
    gaps = np.diff(original.times)
    if len(gaps) < 2:
        return original
    within = tolerance - MERGE_TOLERANCE
    at_rest = np.abs(np.diff(original.positions, axis=0)).max(axis=1) <= MIN_MOVE
    rests = np.flatnonzero(at_rest & (gaps >= MIN_DWELL_S))
    fixed = np.unique(np.concatenate([[0, len(gaps)], rests, rests + 1]))
    diagonals = _bending(gaps / gaps.mean())
    moved = np.stack([_joint(q, diagonals, within, fixed) for q in original.positions.T], axis=1)
    moved = np.clip(moved, original.positions - within, original.positions + within)
    moved = np.clip(moved, limits.position_min, limits.position_max)
    moved[fixed] = original.positions[fixed]
    return Trajectory(original.joint_names, original.times, moved)


def _bending(gaps: Array) -> tuple[Array, Array, Array]:
    """Return the diagonals of M in STIFFNESS · ∫ p̈² dt = pᵀ M p.

    gaps: times between the points, in units of their mean.
    """
    before, after = 1.0 / gaps[:-1], 1.0 / gaps[1:]
    here = -(before + after)
    weight = 2.0 * STIFFNESS / (gaps[:-1] + gaps[1:])
    main, second, third = np.zeros((3, len(gaps) + 1))
    main[:-2] = weight * before**2
    main[1:-1] += weight * here**2
    main[2:] += weight * after**2
    second[:-2] = weight * before * here
    second[1:-1] += weight * here * after
    third[:-2] = weight * before * after
    return main, second, third


def _joint(
    original: Array, diagonals: tuple[Array, Array, Array], within: float, fixed: Array
) -> Array:
    """Return one joint's denoised positions. Some may exceed the tolerance `within`."""
    main, second, third = diagonals
    weights = np.ones(len(original))
    weights[fixed] = FIXED_WEIGHT
    moved = original
    for _ in range(MAX_ROUNDS):
        result = solve_pentadiagonal(main + weights, second, third, weights * original)
        if result is None:
            break
        moved = result
        excess = np.abs(moved - original) / within
        if excess.max() <= 1.0:
            break
        growth = np.where(excess > 1.0, np.maximum(excess, MIN_GROWTH_RATIO) ** 2, 1.0)
        weights = np.minimum(weights * growth, FIXED_WEIGHT)
    return moved


MAX_STEP_S = 0.004
"""Maximum step of the smoother, s. It is short, because the smoother plans only between steps."""

MIN_SEGMENTS = 2
"""Minimum number of segments for `fastest`. For a single segment, the smoother is optimal."""

ROUNDING_SHARE = 1e-9
"""Fraction of a sample period below which a time difference counts as rounding."""

Planner = Callable[[Request, JointLimits], Plan | None]


def smoothed(
    trajectory: Trajectory,
    limits: JointLimits,
    mode: Mode = Mode.TIME_PRESERVING,
    look_ahead: float = np.inf,
    period: float = MAX_STEP_S,
    planner: Planner = plan,
    *,
    refine: bool = True,
    path_tolerance: float = 0.0,
    catch_up: float = np.inf,
    observer: Observer | None = None,
    checkpoint: Callable[[float], None] = lambda _: None,
) -> Trajectory:
    """Return a smooth motion through a trajectory's points, one point every `period` s.

    The motion starts and ends at rest, at the first and the last point. Its joints are in the
    order of the limits.

    * `mode`: TIME_OPTIMAL ignores the times of the points. TIME_PRESERVING respects them where the
      limits allow it.
    * `look_ahead`: duration, s. The smoother receives the next point while its known motion is
      shorter than this.
    * `refine`: with TIME_OPTIMAL and infinite look-ahead, return the motion of `fastest` if it
      finds one. Otherwise the motion follows the smoother's spline.
    * `path_tolerance`: maximum deviation from each point except the two ends, rad (or m). It is
      used by `fastest`. With TIME_PRESERVING and infinite look-ahead it is used by `denoised`.
    * `planner`, `catch_up`, `observer`: passed to `Smoother`.
    * `checkpoint`: called with the time of each sample, s. It may raise to cancel.

    Raises ValueError if an argument is invalid or the motion would exceed a limit, or RuntimeError
    if the planner raises.
    """
    if not period > 0.0:
        raise ValueError(f'period = {period} s: must be positive')
    if not look_ahead > 0.0:
        raise ValueError(f'look_ahead = {look_ahead} s: must be positive')
    trajectory = trajectory.in_order(limits.names)
    timed = mode is Mode.TIME_PRESERVING
    whole = not timed and refine and look_ahead == np.inf
    if path_tolerance != 0.0:
        minimum = MIN_TOLERANCE if timed else 0.0
        free = whole or (timed and look_ahead == np.inf)
        if not (free and minimum <= path_tolerance <= MAX_PATH_TOLERANCE):
            raise ValueError(
                f'path_tolerance = {path_tolerance} rad: must be 0 … {MAX_PATH_TOLERANCE}, but 0 '
                f'or at least {MIN_TOLERANCE:g} if the points have times, and 0 with a look-ahead '
                'or on the spline'
            )
        if timed:
            trajectory = denoised(trajectory, limits, path_tolerance)
    if whole and (motion := _fastest(trajectory, limits, path_tolerance)) is not None:
        count = ceil(motion.duration / period - ROUNDING_SHARE)
        return _of_samples(limits, 0.0, period, [motion.at(i * period) for i in range(count + 1)])
    positions, times = trajectory.positions, trajectory.times
    durations = np.diff(times, prepend=times[0]).tolist()
    smoother = Smoother(
        limits, positions[0], mode, planner=planner, observer=observer, catch_up=catch_up
    )
    steps = ceil(period / MAX_STEP_S - ROUNDING_SHARE)
    state = smoother.motion
    samples = [state]
    fed = 0
    while fed < len(positions) or smoother.moving:
        checkpoint(len(samples) * period)
        for _ in range(steps):
            while fed < len(positions) and smoother.look_ahead < look_ahead:
                smoother.append(positions[fed], durations[fed])
                fed += 1
                if fed == len(positions):
                    smoother.finish()
            state = smoother.step(period / steps)
            if smoother.violation is not None:
                raise ValueError(f'the smooth motion breaks a limit: {smoother.violation}')
            if smoother.planner_error is not None:
                raise RuntimeError('the planner failed') from smoother.planner_error
        samples.append(state)
    offset = 0.0 if mode is Mode.TIME_OPTIMAL else float(times[0])
    return _of_samples(limits, offset, period, samples)


def _fastest(trajectory: Trajectory, limits: JointLimits, tolerance: float) -> JointMotion | None:
    waypoints = _merged(trajectory, limits)
    return fastest(waypoints, limits, tolerance) if len(waypoints) > MIN_SEGMENTS else None


def _merged(trajectory: Trajectory, limits: JointLimits) -> Array:
    """Return the positions of a trajectory, shape (k, n). Points close together are merged."""
    points = Waypoints(limits, trajectory.positions[0], Mode.TIME_OPTIMAL)
    for position in trajectory.positions:
        points.append(position, None, 0.0, in_motion=False)
    points.finish()
    return np.array([points.origin.anchor, *(point.position for point in points.ahead)])


def _of_samples(
    limits: JointLimits, start: float, period: float, samples: Sequence[tuple[Array, ...]]
) -> Trajectory:
    columns = (np.array(column) for column in zip(*samples, strict=True))
    times = np.asarray(start + period * np.arange(len(samples)))
    return Trajectory(limits.names, times, *columns)


def every(trajectory: Trajectory, parts: int) -> Trajectory:
    """Return every `parts`-th point of evenly spaced points, and always the last point.

    The times of the result are evenly spaced, so the last point may be later than before.
    """
    count = len(trajectory.times)
    chosen = np.arange(0, count + parts - 1, parts)
    period = float(trajectory.times[1] - trajectory.times[0])
    times = trajectory.times[0] + chosen * period
    chosen = np.minimum(chosen, count - 1)
    return Trajectory(
        trajectory.joint_names,
        times,
        trajectory.positions[chosen],
        None if trajectory.velocities is None else trajectory.velocities[chosen],
        None if trajectory.accelerations is None else trajectory.accelerations[chosen],
    )


def time_optimal(
    trajectory: Trajectory,
    limits: JointLimits,
    longest: float = np.inf,
    tolerance: float = 0.0,
    checkpoint: Callable[[], None] = lambda: None,
) -> Trajectory | None:
    """Return points, with velocities, of the fastest motion through a trajectory's points.

    The cubic spline of time through the returned points is this motion. It takes SPARE_RATIO times
    as long as possible, because otherwise the arm could not brake on its path. It passes the given
    points within `tolerance`, rad (or m), in each joint. It leaves the lines between them at most
    `tolerance` farther than the smoother's spline does. Given points that do not bend the path are
    skipped (`corners`). The returned points are at most `longest` s apart. The result is None if
    `fastest` finds no motion. Raises the errors of `smoothed`. `checkpoint` is called during the
    search, and may raise to cancel.
    """
    trajectory = trajectory.in_order(limits.names)
    waypoints = _merged(trajectory, limits)
    if len(waypoints) > MIN_SEGMENTS:
        waypoints = waypoints[corners(waypoints, limits)]
    if len(waypoints) <= MIN_SEGMENTS:
        return retimed(trajectory, limits, longest)
    motion = fastest(
        waypoints,
        limits,
        tolerance,
        bend_ratio=BEND_SHARE,
        interval_share=1.0,
        checkpoint=checkpoint,
    )
    if motion is None:
        return None
    times, _ = with_gaps(SPARE_RATIO * _knot_times(motion), longest)
    states = [motion.at(time / SPARE_RATIO) for time in times.tolist()]
    positions, velocities, _ = map(np.array, zip(*states, strict=True))
    return Trajectory(limits.names, times, positions, velocities / SPARE_RATIO)


def _knot_times(motion: JointMotion) -> Array:
    """Return the times at which the jerk changes, s, except where the smoother merges points."""
    positions = motion.states[0].T
    kept = [0]
    for index in range(1, len(positions) - 1):
        if _far(positions[index], positions[kept[-1]]):
            kept.append(index)
    while len(kept) > 1 and not _far(positions[-1], positions[kept[-1]]):
        kept.pop()
    return np.append(motion.times[0][kept], motion.duration)


def _far(position: Array, other: Array) -> bool:
    return bool(np.abs(position - other).max() > FLOAT32_RATIO * MERGE_TOLERANCE)


def retimed(trajectory: Trajectory, limits: JointLimits, longest: float = np.inf) -> Trajectory:
    """Return a trajectory's points, with velocities, at the times of the time-optimal motion.

    The motion is on the smoother's spline. Repeated points are omitted. Between two points more
    than `longest` s apart, points of the motion are inserted. Raises the errors of `smoothed`.
    """
    motion = smoothed(trajectory, limits, Mode.TIME_OPTIMAL, refine=False)
    own_times, own_positions = _own_points(trajectory, motion)
    times, own = with_gaps(own_times, longest)
    positions = _at(times, motion.times, motion.positions)
    positions[own] = own_positions
    return Trajectory(limits.names, times, positions, _at(times, motion.times, motion.velocities))


def thinned(
    trajectory: Trajectory,
    limits: JointLimits,
    spacing: float,
    deviation: float = np.inf,
) -> Trajectory:
    """Return a trajectory with fewer points, for a controller that moves straight between them.

    It has as few points as possible. They are `spacing` to twice `spacing` s apart, and closer
    where a joint would otherwise deviate by more than `deviation`, rad (or m), from the smooth
    motion. They are points of the trajectory or, where these are too far apart, of the motion.
    Raises the errors of `smoothed`.
    """
    if not (spacing > 0.0 and deviation > 0.0):
        raise ValueError(f'spacing = {spacing} s, deviation = {deviation}: must be positive')
    motion = smoothed(trajectory, limits)
    times, positions = _own_points(trajectory, motion)
    indices = [0]
    while indices[-1] < len(times) - 1:
        indices.append(_farthest(motion, times, indices[-1], spacing, deviation))
    new_times, result = [times[:1]], [positions[:1]]
    for before, index in pairwise(indices):
        parts = max(ceil((times[index] - times[before]) / (2.0 * spacing) - 1e-9), 1)
        ends = np.linspace(times[before], times[index], parts + 1).tolist()
        segments = [_segment_ends(motion, segment, deviation) for segment in pairwise(ends)]
        between = list(chain.from_iterable(segments))
        inserted = _at(np.array(between), motion.times, motion.positions)
        inserted[-1] = positions[index]
        new_times.append(np.array(between))
        result.append(inserted)
    times = np.concatenate(new_times)
    velocities = _at(times, motion.times, motion.velocities)
    return Trajectory(limits.names, times, np.concatenate(result), velocities)


def _farthest(
    motion: Trajectory, times: Array, first: int, spacing: float, deviation: float
) -> int:
    """Return the index of the last point to which the arm may move straight from point `first`.

    times: times of all points, s. If none is near enough, the result is the next point.
    """
    start, end = times[first], times[-1]
    for index in range(int(times.searchsorted(start + 2.0 * spacing, 'right')) - 1, first, -1):
        whole = index == len(times) - 1 or end - times[index] >= spacing
        if whole and _is_straight(motion, (start, times[index]), deviation):
            return index
    return first + 1


def _is_straight(motion: Trajectory, segment: tuple[float, float], deviation: float) -> bool:
    """Return whether a part of a motion deviates from a straight line by at most `deviation`."""
    start, end = motion.times.searchsorted(segment)
    inside = motion.positions[start:end]
    first, last = _at(np.array(segment), motion.times, motion.positions)
    return len(inside) < 2 or _off_line(inside, first, last) <= deviation


def _segment_ends(
    motion: Trajectory, segment: tuple[float, float], deviation: float
) -> Iterator[float]:
    """Yield the end times, s, of straight pieces that replace a part of a motion.

    A joint deviates from the motion by at most `deviation`, rad (or m).
    """
    if _is_straight(motion, segment, deviation):
        yield segment[1]
    else:
        middle = sum(segment) / 2.0
        yield from _segment_ends(motion, (segment[0], middle), deviation)
        yield from _segment_ends(motion, (middle, segment[1]), deviation)


def _off_line(positions: Array, first: Array, last: Array) -> float:
    along = last - first
    square = float(along @ along)
    offsets = positions - first
    fraction = (
        np.clip(offsets @ along / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(offsets))
    )
    return float(np.abs(offsets - fraction[:, None] * along).max())


def _own_points(trajectory: Trajectory, motion: Trajectory) -> tuple[Array, Array]:
    """Return the times at which a motion passes a trajectory's points, s, and these points.

    A point is omitted if it repeats the previous point, or the motion does not pass it later.
    """
    positions = trajectory.in_order(motion.joint_names).positions
    apart = np.abs(np.diff(positions, axis=0)).max(axis=1) >= MERGE_TOLERANCE
    indices = np.concatenate([np.flatnonzero(apart), [len(positions) - 1]])  # the last of each run
    positions = positions[indices]
    _, times = passed(positions, motion)
    times[0], times[-1] = motion.times[0], motion.times[-1]
    forward = np.concatenate([[True], times[1:] > np.maximum.accumulate(times)[:-1]])
    forward[-1] = True
    return times[forward], positions[forward]


def _at(times: Array, sampled: Array, values: Array | None) -> Array:
    """Return `values`, given at the times `sampled`, interpolated linearly at `times`, (m, n)."""
    assert values is not None  # noqa: S101 - for the type checker
    return np.stack([np.interp(times, sampled, column) for column in values.T], axis=1)
