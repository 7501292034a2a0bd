# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A run in numbers, ready for JSON: rates and timing, replies, and each motion."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.report.measure import Recording, measure
from epson_driver.report.run import NANOSECONDS, Event, Plan, Run
from epson_driver.robots import RobotModel

HALF_WINDOW_S = 0.03
"""Half width of the window around a sample, s, against the jitter of arrival times."""

MIN_NEIGHBOURS, MAX_NEIGHBOURS = 2, 25
LATE_PERIODS = 5.0
"""Gap before a joint state, in periods, above which it counts as very late."""

UNLIKELY_SHARE = 0.3
"""Maximum deviation of a velocity from the fit to many samples, as a share of the fit."""

SHORTEST_SHARE = 0.9
"""Minimum time between two joint states at their sender, as a share of the median gap."""

CHUNK = 20_000
"""Number of samples fitted together. It bounds the memory."""


def likely_derivatives(sent: Array, came: Array, positions: Array) -> tuple[Array, Array]:
    """Return velocities and accelerations from the times of sending, shape (k, m).

    A controller sends periodically, so joint states that arrive in a burst were delayed in
    transit. Around a very late joint state it is unknown whether it was delayed or sent late. A
    value there that deviates strongly from a fit to MAX_NEIGHBOURS samples on either side, by
    arrival times, is replaced by the fit.
    """
    if len(came) < 2 * MIN_NEIGHBOURS + 1:
        return derivatives(sent, positions)
    gaps = np.diff(came)
    shortest = SHORTEST_SHARE * float(np.median(gaps))
    sent, came = apart(sent, shortest), apart(came, shortest)
    velocities, accelerations = derivatives(sent, positions)
    late = np.flatnonzero(gaps > LATE_PERIODS * np.median(gaps))
    doubtful = np.zeros(len(came), dtype=bool)
    for at in late.tolist():
        doubtful[max(at - MAX_NEIGHBOURS, 0) : at + 1 + MAX_NEIGHBOURS] = True
    if not doubtful.any():
        return velocities, accelerations
    reach = min(MAX_NEIGHBOURS, (len(came) - 1) // 2)
    slopes, _ = _fitted(came, positions, reach, degree=1)
    _, bends = _fitted(came, positions, reach, degree=2)
    unlikely = np.abs(velocities - slopes) > UNLIKELY_SHARE * np.abs(slopes)
    unlikely &= doubtful[:, None]
    velocities[unlikely], accelerations[unlikely] = slopes[unlikely], bends[unlikely]
    return velocities, accelerations


def apart(times: Array, shortest: float) -> Array:
    """Return the times, ascending, moved earlier so that none are closer than `shortest` s."""
    steps = shortest * np.arange(len(times))
    return np.asarray(np.minimum.accumulate((times - steps)[::-1])[::-1] + steps)


def derivatives(times: Array, positions: Array) -> tuple[Array, Array]:
    """Return velocities and accelerations, shape (k, m) each, from a parabola fitted in a window.

    Differences of neighbouring samples would turn the jitter of arrival times into spikes.

    times: shape (k,), s, ascending. The window contains the samples up to HALF_WINDOW_S around
    each sample, at least two on either side. Near the ends it is one-sided. With fewer than five
    samples both are 0.
    """
    count = len(times)
    if count < 2 * MIN_NEIGHBOURS + 1:
        return np.zeros_like(positions), np.zeros_like(positions)
    reach = math.ceil(HALF_WINDOW_S / max(float(np.median(np.diff(times))), 1e-6))
    reach = min(max(reach, MIN_NEIGHBOURS), MAX_NEIGHBOURS, (count - 1) // 2)
    return _fitted(times, positions, reach, degree=2)


def _fitted(times: Array, positions: Array, reach: int, degree: int) -> tuple[Array, Array]:
    """Return both derivatives of the polynomial of a degree through `reach` on either side."""
    count = len(times)
    velocities, accelerations = np.empty_like(positions), np.zeros_like(positions)
    offsets = np.arange(-reach, reach + 1)
    for start in range(0, count, CHUNK):
        here = np.arange(start, min(start + CHUNK, count))
        window = np.clip(here, reach, count - 1 - reach)[:, None] + offsets
        since = times[window] - times[here, None]
        scale = np.abs(since).max(axis=1, keepdims=True)
        scale[scale == 0.0] = 1.0
        fraction = since / scale  # within ±2: the normal equations stay well conditioned
        powers = fraction[:, :, None] ** np.arange(degree + 1)
        normal = np.einsum('kwi,kwj->kij', powers, powers) + 1e-12 * np.eye(degree + 1)
        right = np.einsum('kwi,kwm->kim', powers, positions[window] - positions[here, None])
        fitted = np.linalg.solve(normal, right)
        velocities[here] = fitted[:, 1] / scale
        if degree > 1:
            accelerations[here] = 2.0 * fitted[:, 2] / scale**2
    return velocities, accelerations


FORMAT = 1
"""Version of the JSON format. It changes when a name changes its meaning or is removed."""

STANDSTILL_RAD = 5e-4
"""Maximum displacement of a joint that counts as not yet moving, rad or m."""

MAX_PAIRS = 25_000_000
"""Maximum number of point and joint state pairs compared. Longer motions are subsampled."""

STOP_SHARE = 0.02
"""Share of its top speed below which a moving arm counts as stopped, for the list of stops."""

MIN_STOP_S = 0.03


@dataclass(frozen=True)
class Timing:
    """Regularity of messages: rate in Hz, intervals in s, or None for fewer than two."""

    count: int
    rate: float | None = None
    median: float | None = None
    p99: float | None = None
    longest: float | None = None


@dataclass(frozen=True)
class Motion:
    """One trajectory and its execution. Times in s, angles in rad (m), per joint as lists.

    dead_time: from the first point on the wire to the first motion of a joint. moved: duration of
    the motion. stops: stops during the motion that are not in the plan. waypoint_deviation:
    distance from a point to the path, independent of time. None: the arm did not move.
    """

    sent: float
    points: int
    planned: float
    began: float | None = None
    dead_time: float | None = None
    moved: float | None = None
    stops: int | None = None
    commanded_stops: int | None = None
    waypoint_deviation: float | None = None
    end_deviation: float | None = None
    top_velocity: tuple[float, ...] = ()
    top_acceleration: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Figures:
    """All figures of a run. velocities, accelerations: shape (k, m), for the page's curves."""

    velocities: Array
    accelerations: Array
    joint_states: Timing
    traffic: tuple[tuple[str, str, Timing], ...]
    replies: tuple[tuple[str, Timing], ...]
    motions: tuple[Motion, ...]
    stops: tuple[tuple[float, float], ...]
    """Standstills during motions: start and duration, s."""


def figures(run: Run, metric: Array | None = None) -> Figures:
    """Return the figures of a run, with measured velocities if available.

    metric: JointLimits.rad_per_unit of the robot's joints, shape (m,). Without it, no joint is
    treated as prismatic, which matters for detecting standstills.
    """
    metric = np.ones(len(run.joint_names)) if metric is None else metric
    sent = run.times if run.sent is None else run.sent
    fitted, accelerations = likely_derivatives(sent, run.times, run.positions)
    velocities = fitted if run.velocities is None else run.velocities
    motions, stops = [], []
    for number, plan in enumerate(run.plans, start=1):
        until = run.plans[number].sent if number < len(run.plans) else math.inf
        motion = _motion(plan, until, run, velocities, accelerations, metric)
        motions.append(motion)
        if motion.began is not None and motion.moved is not None:
            ended = motion.began + motion.moved
            stops += _standstills(run, velocities * metric, motion.began, ended)
    names = sorted({reply.name for reply in run.replies})
    return Figures(
        velocities,
        accelerations,
        _between(run.times),
        tuple((item.name, item.sender, _between(item.times)) for item in run.traffic),
        tuple(
            (name, _latencies([item.latency for item in run.replies if item.name == name]))
            for name in names
        ),
        tuple(motions),
        tuple(stops),
    )


def _between(times: Array) -> Timing:
    if len(times) < 2:
        return Timing(len(times))
    gaps = np.diff(times)
    span = float(times[-1] - times[0])
    return Timing(
        len(times),
        len(gaps) / span if span > 0.0 else None,
        float(np.median(gaps)),
        float(np.quantile(gaps, 0.99)),
        float(gaps.max()),
    )


def _latencies(values: Sequence[float]) -> Timing:
    return Timing(
        len(values),
        None,
        float(np.median(values)),
        float(np.quantile(values, 0.99)),
        float(max(values)),
    )


def _motion(
    plan: Plan, until: float, run: Run, velocities: Array, accelerations: Array, metric: Array
) -> Motion:
    """Return the figures of a plan's execution, from the joint states until the next plan."""
    bare = Motion(plan.sent, len(plan.times), float(plan.times[-1]))
    here = np.flatnonzero((run.times >= plan.sent) & (run.times < until))
    if len(here) < 2:
        return bare
    positions = run.positions[here]
    before = run.positions[max(int(here[0]) - 1, 0)]
    away = np.abs(positions - before).max(axis=1) > STANDSTILL_RAD
    if not away.any():
        return bare
    first = int(np.argmax(away))
    settled = np.abs(positions - positions[-1]).max(axis=1) > STANDSTILL_RAD
    last = int(np.flatnonzero(settled)[-1]) + 1 if settled.any() else first
    last = max(last, first + 1) if first + 1 < len(here) else last
    moving = here[first : last + 1]
    began = float(run.times[moving[0]])
    names = run.joint_names
    stops = commanded = None
    waypoint = None
    if len(plan.times) > 1 and len(moving) > 4:
        stride = math.ceil(len(plan.times) * len(here) / MAX_PAIRS)
        recording = Recording(
            run.times[here][::stride], positions[::stride], velocities[here][::stride]
        )
        trajectory = Trajectory(names, plan.times, plan.positions)
        measured = measure(trajectory, recording, metric)
        stops, commanded = measured.stops, measured.commanded_stops
        if np.any(metric != 1.0):
            measured = measure(trajectory, recording)
        waypoint = measured.waypoint_deviation
    return Motion(
        sent=plan.sent,
        points=len(plan.times),
        planned=float(plan.times[-1]),
        began=began,
        dead_time=began - plan.sent,
        moved=float(run.times[moving[-1]]) - began,
        stops=stops,
        commanded_stops=commanded,
        waypoint_deviation=waypoint,
        end_deviation=float(np.abs(positions[-1] - plan.positions[-1]).max()),
        top_velocity=tuple(np.abs(velocities[moving]).max(axis=0).tolist()),
        top_acceleration=tuple(np.abs(accelerations[moving]).max(axis=0).tolist()),
    )


def _standstills(
    run: Run, velocities: Array, begin: float, end: float
) -> list[tuple[float, float]]:
    """Return the standstills of the arm between two times: start and duration."""
    here = np.flatnonzero((run.times >= begin) & (run.times <= end))
    speed = np.abs(velocities[here]).max(axis=1)
    still = speed < STOP_SHARE * speed.max()
    moving = np.flatnonzero(~still)
    if moving.size < 2:
        return []
    inside = still[moving[0] : moving[-1]].astype(np.int8)
    edges = np.diff(inside, prepend=0, append=0)
    times = run.times[here][moving[0] :]
    result = [
        (float(times[first]), float(times[last] - times[first]))
        for first, last in zip(
            np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True
        )
    ]
    return [(at, long) for at, long in result if long >= MIN_STOP_S]


def as_json(run: Run, numbers: Figures, events: Sequence[Event], model: RobotModel) -> Any:
    """Return the figures as input for json.dumps. Names end in their unit, if any."""
    limits = model.limits
    return {
        'format': FORMAT,
        'source': run.source,
        'robot_model': model.name,
        'began': datetime.fromtimestamp(run.began / NANOSECONDS, UTC).isoformat(),
        'duration_s': run.ended,
        'joint_names': list(run.joint_names),
        'velocity_limits': limits.velocity.tolist(),
        'acceleration_limits': limits.acceleration.tolist(),
        'velocities': 'computed' if run.velocities is None else 'measured',
        'joint_states': _timing(numbers.joint_states),
        'messages': [
            {'name': name, 'sender': sender} | _timing(timing)
            for name, sender, timing in numbers.traffic
        ],
        'replies': [
            {
                'name': name,
                'count': timing.count,
                'median_s': timing.median,
                'p99_s': timing.p99,
                'longest_s': timing.longest,
            }
            for name, timing in numbers.replies
        ],
        'motions': [_motion_json(motion) for motion in numbers.motions],
        'standstills': [{'time_s': at, 'duration_s': long} for at, long in numbers.stops],
        'events': [
            {
                'time_s': event.time,
                'level': event.level,
                'text': event.text,
                'remedy': event.remedy,
            }
            for event in events
        ],
        'notes': list(run.notes),
    }


_IN_SECONDS = ('sent', 'planned', 'began', 'dead_time', 'moved')


def _motion_json(motion: Motion) -> dict[str, Any]:
    return {
        f'{name}_s' if name in _IN_SECONDS else name: value
        for name, value in asdict(motion).items()
    }


def _timing(timing: Timing) -> dict[str, Any]:
    return {
        'count': timing.count,
        'rate_hz': timing.rate,
        'between_median_s': timing.median,
        'between_p99_s': timing.p99,
        'between_longest_s': timing.longest,
    }
